from __future__ import annotations

import math
import pickle
from xml.etree import ElementTree

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics import closed_form
from leg_dynamics.closed_form import quadruped_leg as quadruped
from leg_dynamics.description import parse
from leg_dynamics.errors import FormulaAssumptionError, LegDynamicsWarning

NAMES = ("quadruped_leg", "quadruped_leg_reversed")


@pytest.fixture
def robot(quadruped_lab):
    return ElementTree.fromstring(quadruped_lab.leg_text())


def load(robot):
    return quadruped.from_urdf(parse(ElementTree.tostring(robot, encoding="unicode"), file="mine.urdf"))


def named(robot, tag, name):
    return robot.find(f"{tag}[@name='{name}']")


def test_lengths_and_drives_come_from_the_file(robot):
    leg = load(robot)
    np.testing.assert_allclose((leg.l1, leg.l2, leg.l3), (0.075, 0.075, 0.140), rtol=1e-14)
    assert dict(leg.parameters) == {"l1": leg.l1, "l2": leg.l2, "l3": leg.l3}
    assert leg.gravity == (0.0, 0.0, -9.81)
    assert leg.drive_inertia == pytest.approx((50**2 * 2e-7, 80**2 * 3e-7, 50**2 * 1e-7))
    assert leg.dissipation == tuple(quadruped.Dissipation(name, 0.05, 0.02) for name in ("theta1", "theta3"))
    assert tuple(body.name for body in leg.bodies) == quadruped.BODY_NAMES
    assert [body.mass for body in leg.bodies] == pytest.approx([0.4 + 0.45, 0.5 + 0.55, 0.6 + 0.65 + 0.7])
    assert pickle.loads(pickle.dumps(leg)) == leg


def test_bodies_are_in_their_own_frames(robot):
    """A point mass on the foot lies l3 along link 3; one on the knee axis l2 along link 2."""
    for element in robot.findall("link"):
        inertial = element.find("inertial")
        if inertial is not None and element.get("name") != "foot":
            element.remove(inertial)
    origin = named(robot, "link", "foot").find("inertial/origin")
    origin.set("xyz", "0 0 0")
    leg = load(robot)
    np.testing.assert_allclose(leg.bodies[2].com, (leg.l3, 0.0, 0.0), atol=1e-15)
    assert [body.mass for body in leg.bodies[:2]] == [0.0, 0.0]
    origin.set("xyz", "0 0 0.02")
    # the foot's frame is turned by 0.4 + pi about x, seen from link 3
    expected = (leg.l3, -0.02 * np.sin(0.4 + np.pi), 0.02 * np.cos(0.4 + np.pi))
    np.testing.assert_allclose(load(robot).bodies[2].com, expected, atol=1e-15)


def test_frames_may_lie_anywhere_on_their_axes(robot):
    """Move each joint's frame along its axis, and what it carries back."""
    expected = load(robot)
    moved = {
        "theta1": "0 0 -0.5",
        "m02_mid": "0.045 0 0.5",
        "theta2": "0.03 0 0.2",
        "bond": "0.0375 0 -0.2",
        "theta3": "0.0375 0 0.3",
        "foot_mount": f"0.1025 {-0.3 * math.sin(0.4)!r} {-0.3 * math.cos(0.4)!r}",
    }
    for name, xyz in moved.items():
        named(robot, "joint", name).find("origin").set("xyz", xyz)
    found = load(robot)
    np.testing.assert_allclose((found.l1, found.l2, found.l3), (expected.l1, expected.l2, expected.l3), rtol=1e-13)
    assert found.bodies[2].com != expected.bodies[2].com


def change(tag, name, path, attribute, value):
    def changed(robot):
        element = named(robot, tag, name)
        (element if path is None else element.find(path)).set(attribute, value)

    return changed


def add(text):
    return lambda robot: robot.append(ElementTree.fromstring(text))


def rename(old, new):
    def changed(robot):
        named(robot, "joint", old).set("name", new)
        for element in robot.iter("joint"):
            if element.get("name") == old:
                element.set("name", new)

    return changed


def mimic(robot):
    named(robot, "joint", "theta3").append(ElementTree.fromstring("<mimic joint='theta2' multiplier='2'/>"))


def both(first, second):
    return lambda robot: (first(robot), second(robot))


BROKEN = {
    "hip axis the other way": (change("joint", "theta1", "axis", "xyz", "0 0 -1"), "theta1"),
    "pitch axis the other way": (change("joint", "theta2", "axis", "xyz", "0 0 -1"), "theta2"),
    "tilted knee axis": (change("joint", "theta3", "axis", "xyz", "0 0.01 -1"), "theta3"),
    "middle joint at another angle": (change("joint", "m02_mid", "origin", "rpy", "1.5 0 0"), "theta2"),
    "hip axis beside the hip": (change("joint", "theta1", "origin", "xyz", "0 0.001 0"), "theta1"),
    "pitch axis above the hip": (change("joint", "m02_mid", "origin", "xyz", "0.045 0 0"), "theta2"),
    "knee out of line": (change("joint", "theta3", "origin", "xyz", "0.0375 0.002 0"), "theta3"),
    "foot out of the plane": (change("joint", "foot_mount", "origin", "xyz", "0.1 0 0.001"), "foot"),
    "foot above the line": (change("joint", "foot_mount", "origin", "xyz", "0.1 0.001 0"), "foot"),
    "foot on another link": (change("joint", "foot_mount", "parent", "link", "m02_lower"), "foot"),
    "a knee before the pitch axis": (change("joint", "theta3", "origin", "xyz", "-0.1 0 0"), "length l2"),
    "a foot at the knee": (change("joint", "foot_mount", "origin", "xyz", "-0.0375 0 0"), "length l3"),
    "a pitch axis behind the hip": (change("joint", "theta2", "origin", "xyz", "-0.1 0 0.01"), "length l1"),
    "a frozen joint let go": (change("joint", "m01_rest", None, "type", "continuous"), "m01_rest"),
    "a joint above the hip": (change("joint", "base_to_hip", None, "type", "continuous"), "base_to_hip"),
    "a slide as knee": (change("joint", "theta3", None, "type", "prismatic"), "theta3"),
    "a knee by another name": (rename("theta3", "knee"), "joint 'theta3'"),
    "joints out of order": (
        both(rename("theta2", "x"), both(rename("theta3", "theta2"), rename("x", "theta3"))),
        "joint 'theta2'",
    ),
    "a loop": (
        add("<loop name='ring' type='spherical'><predecessor link='hip'/><successor link='m01_lower'/></loop>"),
        "loop 'ring'",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_assumptions_are_named(robot, case):
    breaking, element = BROKEN[case]
    breaking(robot)
    with pytest.raises(FormulaAssumptionError, match=r"^mine\.urdf: ") as caught:
        load(robot)
    assert element in str(caught.value)
    assert caught.value.expected is not None


@pytest.mark.parametrize(
    ("breaking", "warning", "words"),
    [
        (
            add(
                "<coupling name='g'><predecessor link='m02_upper'/><successor link='m01_lower'/><ratio value='1'/>"
                "</coupling>"
            ),
            "on one side only",
            "coupling 'g'",
        ),
        (mimic, "is ignored", "joint 'theta3' is a mimic of 'theta2'"),
    ],
    ids=["coupling", "mimic"],
)
def test_coupled_joints_are_refused(robot, breaking, warning, words):
    breaking(robot)
    with pytest.warns(LegDynamicsWarning, match=warning), pytest.raises(FormulaAssumptionError, match=words):
        load(robot)


def test_missing_links_are_named(quadruped_lab):
    for name in ("hip", "foot"):
        text = quadruped_lab.leg_text().replace(f'"{name}"', '"other"')
        with pytest.raises(FormulaAssumptionError, match=f"link '{name}'"):
            quadruped.from_urdf(parse(text))


@pytest.mark.parametrize("name", NAMES)
def test_shipped_legs_load_by_every_route(name):
    assert name in closed_form.names()
    leg = ld.load(name)
    assert (leg.route, leg.joint_names, leg.branches) == ("closed_form", quadruped.JOINT_NAMES, quadruped.BRANCHES)
    numbers = leg.backend.numbers
    np.testing.assert_allclose((numbers.l1, numbers.l2, numbers.l3), (0.075, 0.075, 0.140), rtol=1e-12)
    np.testing.assert_allclose((-leg.limits.lower, leg.limits.upper), np.radians(70.0), rtol=1e-9)
    pose = np.radians((0.0, -30.0, -60.0))
    rng = np.random.default_rng(6)
    q = rng.uniform(leg.limits.lower, leg.limits.upper, (50, 3))
    v, a, force, gravity = rng.normal(scale=5.0, size=(4, 50, 3))
    for route in ("closed_form", "pinocchio", "symbolic"):
        other = ld.load(name, route)
        expected = (0.075 + 0.0375 * np.sqrt(3.0), 0.0, -0.1775)  # (4)
        np.testing.assert_allclose(other.foot_position(pose), expected, atol=1e-12)
        np.testing.assert_allclose(other.foot_position(q), leg.foot_position(q), atol=1e-12)
        np.testing.assert_allclose(
            other.torque(q, v, a, force, gravity), leg.torque(q, v, a, force, gravity), atol=1e-9
        )


def test_shipped_formulas_take_another_file(quadruped_lab):
    leg = ld.load("quadruped_leg", urdf=quadruped_lab.leg_text(0.05, 0.09, 0.2))
    assert leg.route == "closed_form"
    np.testing.assert_allclose(leg.foot_position([0.0, 0.0, 0.0]), (0.34, 0.0, 0.0), atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_crosscheck(name):
    report = ld.crosscheck(name, samples=200)
    assert report.passed, report.worst
