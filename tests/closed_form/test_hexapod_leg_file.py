from __future__ import annotations

import pickle
from xml.etree import ElementTree

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics import closed_form
from leg_dynamics.closed_form import hexapod_leg as hexapod
from leg_dynamics.closed_form import hexapod_leg_preliminary
from leg_dynamics.description import parse, read, render, shipped_urdf
from leg_dynamics.errors import FormulaAssumptionError, LegDynamicsWarning, ParameterError
from leg_dynamics.routes import sibling, with_text
from leg_dynamics.verification.perturbation import with_random_inertia


@pytest.fixture
def robot():
    return ElementTree.fromstring(shipped_urdf("hexapod_leg").read_text())


def load(robot):
    return hexapod.from_urdf(parse(ElementTree.tostring(robot, encoding="unicode"), file="mine.urdf"))


def named(robot, tag, name):
    return robot.find(f"{tag}[@name='{name}']")


def test_shipped_numbers():
    leg = hexapod.from_urdf(read("hexapod_leg"))
    assert (leg.a, leg.b, leg.c, leg.e, leg.side) == (0.2, 0.07, 0.05, 0.45, 1.0)
    assert dict(leg.parameters) == {"a": 0.2, "b": 0.07, "c": 0.05, "e": 0.45}
    assert leg.gravity == (0.0, 0.0, 9.81)
    assert leg.drive_mass == (0.0, 0.0, 0.0)
    assert leg.dissipation == ()
    assert leg.assembly_mode == "B2_down_B3_down"
    assert tuple(body.name for body in leg.bodies) == hexapod.BODY_NAMES
    rod = next(body for body in leg.bodies if body.name == "rod_2")
    assert rod.com == (0.0, 0.0, -0.155)
    assert pickle.loads(pickle.dumps(leg)) == leg


def test_drives_and_losses_come_from_the_file():
    parameters = {
        "l1_drive_mass": 2.0,
        "l2_rotor_inertia": 1e-4,
        "l2_gear_ratio": 300,
        "l3_damping": 5,
        "l1_friction": 7,
    }
    leg = hexapod.from_urdf(read("hexapod_leg", parameters=parameters))
    assert leg.drive_mass == pytest.approx((2.0, 9.0, 0.0))
    assert leg.dissipation == (hexapod.Dissipation("l1", 0.0, 7.0), hexapod.Dissipation("l3", 5.0, 0.0))


def test_the_preliminary_design_and_the_mirrored_leg_load():
    assert {"hexapod_leg", "hexapod_leg_preliminary"} <= set(closed_form.names())
    first = hexapod_leg_preliminary.from_urdf(read("hexapod_leg_preliminary"))
    assert (first.b, first.e) == (0.08, 0.45)
    leg = ld.load("hexapod_leg_preliminary")
    assert leg.route == "closed_form"
    np.testing.assert_allclose(leg.inverse_kinematics([0, 0, 0.7]), (0.7, 0.4657, 0.7159), atol=5e-5)
    by_name = ld.load("hexapod_leg", urdf="hexapod_leg_preliminary")
    assert by_name.replace(b=0.09).backend.numbers.b == 0.09
    right, left = ld.load("hexapod_leg"), ld.load("hexapod_leg", parameters={"side": -1})
    mirror = np.diag([1.0, -1.0, 1.0])
    q, v, a = np.array([0.7, 0.45, 0.68]), np.array([0.2, -0.3, 0.1]), np.array([1.0, 2.0, -3.0])
    force, gravity = np.array([20.0, 30.0, -200.0]), np.array([1.0, 2.0, 9.0])
    np.testing.assert_allclose(left.foot_position(q), mirror @ right.foot_position(q), atol=1e-15)
    np.testing.assert_allclose(left.jacobian(q), mirror @ right.jacobian(q), atol=1e-14)
    np.testing.assert_allclose(
        left.torque(q, v, a, foot_force=mirror @ force, gravity=mirror @ gravity),
        right.torque(q, v, a, foot_force=force, gravity=gravity),
        rtol=1e-12,
    )


def test_frames_of_links_may_be_turned(robot):
    """A round rod with its frame turned about its own axis is the same rod."""
    expected = load(robot)
    joint = named(robot, "joint", "l3")
    joint.find("origin").set("rpy", f"0 0 {np.pi / 2!r}")
    found = load(robot)
    assert found.bodies[-1].mass == expected.bodies[-1].mass
    np.testing.assert_allclose(found.bodies[-1].com, expected.bodies[-1].com, atol=1e-16)
    np.testing.assert_allclose(found.bodies[-1].inertia, expected.bodies[-1].inertia, atol=1e-16)


def move(tag, name, path, attribute, value):
    def change(robot):
        element = named(robot, tag, name)
        (element if path is None else element.find(path)).set(attribute, value)

    return change


def remove(tag, name):
    return lambda robot: robot.remove(named(robot, tag, name))


def remove_telescopes(robot):
    for element in robot.findall("telescope"):
        robot.remove(element)


def both(first, second):
    return lambda robot: (first(robot), second(robot))


def add(text):
    return lambda robot: robot.append(ElementTree.fromstring(text))


BROKEN = {
    "A3 not at a right angle": (move("joint", "alpha3", "origin", "xyz", "0.01 0.2 0"), "alpha3"),
    "unequal arms": (move("joint", "alpha3", "origin", "xyz", "0 0.21 0"), "alpha3"),
    "an offset cross": (move("joint", "beta2", "origin", "xyz", "0 0 0.01"), "beta2"),
    "other axis": (move("joint", "beta1", "axis", "xyz", "0 -1 0"), "beta1"),
    "tilted slide": (move("joint", "l1", "axis", "xyz", "0 0.1 1"), "l1"),
    "a strut of other zero": (move("joint", "l2", "origin", "xyz", "0 0 0.3"), "l2"),
    "foot elsewhere": (move("joint", "foot_mount", "origin", "xyz", "0 0 0.05"), "foot"),
    "foot on another rod": (move("joint", "foot_mount", "parent", "link", "rod_3"), "foot"),
    "B2 beside the plane": (move("loop", "loop_B2", "predecessor/origin", "xyz", "0.07 0.01 0.45"), "loop_B2"),
    "B3 ahead": (move("loop", "loop_B3", "predecessor/origin", "xyz", "0.01 0.05 0"), "loop_B3"),
    "B3 on the other side": (move("loop", "loop_B3", "predecessor/origin", "xyz", "0 -0.05 0"), "loop_B3"),
    "hinge about another axis": (move("loop", "loop_B2", "axis", "xyz", "1 0 0"), "loop_B2"),
    "ball as hinge": (move("loop", "loop_B3", None, "type", "universal"), "loop_B3"),
    "no ball": (remove("loop", "loop_B3"), "rod_1 and rod_3"),
    "a loop too many": (
        add("<loop name='x' type='spherical'><predecessor link='hip'/><successor link='rod_3'/></loop>"),
        "loop 'x'",
    ),
    "a coupling": (
        add("<coupling name='x'><predecessor link='cross_1'/><successor link='cross_2'/><ratio value='1'/></coupling>"),
        "coupling 'x'",
    ),
    "a further joint": (move("joint", "link_B0B2_mount", None, "type", "continuous"), "link_B0B2_mount"),
    "a hinge as strut": (both(move("joint", "l3", None, "type", "revolute"), remove_telescopes), "l3"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_assumptions_are_named(robot, case):
    change, element = BROKEN[case]
    change(robot)
    with pytest.raises(FormulaAssumptionError) as caught:
        load(robot)
    assert element in str(caught.value)
    assert caught.value.expected is not None


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"a": -0.2}, "a = -0.2 m must be greater than 0 m: it is 0.2 m too small"),
        ({"a": 0.0}, "a = 0 m must be greater than 0 m: it is just that"),
        ({"e": 0.0}, "e = 0 m must be greater than 0 m"),
        ({"b": -0.07}, "b = -0.07 m must be at least 0 m"),
        ({"c": -0.05}, "c = -0.05 m must be at least 0 m"),
        ({"h": -1.0}, "h = -1 m must be greater than 0 m"),
        ({"rod_13_length": -0.5}, "rod_13_length = -0.5 m"),
        ({"l1_min": 0.95}, "l1_min = 0.95 m must be at most l1_max = 0.9 m: it is 0.05 m too large"),
        ({"l3_max": 0.5}, "l3_min = 0.53 m must be at most l3_max = 0.5 m"),
        ({"sleeve_13_wall": 0.05}, "sleeve_13_wall = 0.05 m must be at most sleeve_13_diameter/2 = 0.0325 m"),
        ({"rod_13_diameter": 0.0551}, "at most sleeve_13_diameter - 2*sleeve_13_wall = 0.055 m: it is 0.0001 m too"),
        ({"universal_range": 180.1}, "universal_range = 180.1 deg must be at most 180 deg"),
        ({"a": float("nan")}, "finite"),
    ],
)
@pytest.mark.parametrize("name", ["hexapod_leg", "hexapod_leg_preliminary"])
def test_impossible_parameters_are_refused(name, parameters, words):
    if name == "hexapod_leg_preliminary" and any(key.startswith("l") for key in parameters):
        parameters = {"l1_max": 0.9, "l3_min": 0.53} | parameters
    for make in (ld.load, render):
        with pytest.raises(ParameterError) as caught:
            make(name, parameters=parameters)
        assert words in str(caught.value)
        assert "pinocchio" not in str(caught.value)


@pytest.mark.parametrize(
    "parameters",
    [
        {"l1_min": 0.9},
        {"rod_13_diameter": 0.055},
        {"rod_13_wall": 0.015},
        {"universal_range": 180.0},
        {"rod_2_length": 0.29},
        {"overlap_min": 0.29},
        {"h": 0.531},
    ],
)
def test_parameters_at_their_limits_are_accepted(parameters):
    if "l1_min" in parameters:
        parameters = {**parameters, "h": 0.9, "l3_max": 0.95}
    leg = ld.load("hexapod_leg", parameters=parameters)
    assert {name: leg.parameters[name].value for name in parameters} == parameters


def test_a_side_that_is_neither_is_no_leg_of_the_formulas():
    with pytest.raises(FormulaAssumptionError, match="alpha3"):
        ld.load("hexapod_leg", parameters={"side": 0.5})


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (
            {"rod_2_length": 0.289},
            "sleeve 0.31 m and rod 0.289 m, come apart at 0.599 m, 0.001 m before its upper limit",
        ),
        ({"rod_2_length": 0.1}, "come apart at 0.41 m, 0.19 m before its upper limit 0.6 m"),
        ({"rod_2_length": 0.01}, "overlap by 0 m only below 0.32 m, before its lower limit 0.33 m"),
        ({"overlap_min": 0.2901}, "overlap by 0.2901 m only below 0.3299 m, before its lower limit 0.33 m"),
        ({"h": 0.52}, "configuration 'home' has joint 'l1' at 0.52 m, 0.01 m beyond its lower limit 0.53 m"),
        ({"h": 5.0}, "at 5.00225 m, 4.1 m beyond its upper limit 0.9 m (1 more outside theirs)"),
    ],
)
def test_limits_that_contradict_each_other_are_one_warning(parameters, words):
    with pytest.warns(LegDynamicsWarning) as caught:
        read("hexapod_leg", parameters=parameters)
    (warning,) = caught
    assert words in str(warning.message)


def test_a_robot_warns_once_of_all_its_legs():
    with pytest.warns(LegDynamicsWarning, match=r"as do those of 5 more telescopes") as caught:
        read("hexapod", parameters={"rod_2_length": 0.28})
    assert len(caught) == 1


@pytest.mark.parametrize("zero", ["b", "c"])
def test_links_may_have_no_length(zero):
    leg = ld.load("hexapod_leg", parameters={zero: 0.0})
    other = sibling(leg, "pinocchio")
    rng = np.random.default_rng(3)
    alpha, beta, l1 = rng.uniform([-0.5, -0.5, 0.6], [0.5, 0.3, 0.85], (30, 3)).T
    p = np.stack([l1 * np.sin(beta), -l1 * np.sin(alpha) * np.cos(beta), l1 * np.cos(alpha) * np.cos(beta)], axis=-1)
    q = leg.inverse_kinematics(p, limits="ignore")
    v, a, force = rng.normal(size=(3, 30, 3))
    expected = other.torque(q, v, a, foot_force=force)
    assert (np.abs(leg.torque(q, v, a, foot_force=force) - expected) / (1 + np.abs(expected))).max() < 1e-9


@pytest.mark.parametrize("overrides", [{}, {"side": -1, "l1_friction": 20, "l3_damping": 40, "l2_drive_mass": 3.0}])
def test_routes_agree_at_random_states(overrides):
    leg = ld.load("hexapod_leg", parameters=overrides)
    other = sibling(leg, "pinocchio")
    rng = np.random.default_rng(2)
    alpha, beta, l1 = rng.uniform([-1.0, -0.8, 0.55], [1.0, 0.6, 0.88], (200, 3)).T
    p = np.stack([l1 * np.sin(beta), -l1 * np.sin(alpha) * np.cos(beta), l1 * np.cos(alpha) * np.cos(beta)], axis=-1)
    q = leg.inverse_kinematics(p, on_error="nan")
    q = q[np.isfinite(q).all(axis=1)][:40]
    assert len(q) == 40
    v, a, force, gravity = (rng.normal(scale=s, size=(40, 3)) for s in (0.5, 5.0, 300.0, 6.0))
    text = with_random_inertia(leg.description, 4)
    for one, two in ((leg, other), (with_text(leg, text), with_text(other, text))):
        expected = two.torque(q, v, a, foot_force=force, gravity=gravity)
        found = one.torque(q, v, a, foot_force=force, gravity=gravity)
        assert (np.abs(found - expected) / (1 + np.abs(expected))).max() < 1e-9
        for name, arguments in (("mass_matrix", (q,)), ("acceleration", (q, v, a)), ("potential_energy", (q,))):
            expected, found = getattr(two, name)(*arguments), getattr(one, name)(*arguments)
            assert (np.abs(found - expected) / (1 + np.abs(expected))).max() < 1e-9, name
    for name, arguments in (("foot_position", (q,)), ("jacobian", (q,)), ("jacobian_derivative", (q, v))):
        np.testing.assert_allclose(getattr(leg, name)(*arguments), getattr(other, name)(*arguments), atol=1e-9)
    closed, numeric = leg.assemble(q), other.assemble(q)
    for name in leg.tree_joint_names:
        np.testing.assert_allclose(closed[name], numeric[name], atol=1e-9, err_msg=name)


def test_mobility_and_redundant_rows():
    report = ld.load("hexapod_leg", route="pinocchio").backend.mobility_report(samples=4)
    assert (report.joints, report.rows, report.gruebler, report.mobility, report.redundant) == (9, 8, 1, 3, 2)
    assert {pose.rank for pose in report.poses} == {6}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexapod_leg", "hexapod_leg_preliminary"])
def test_crosscheck(name):
    report = ld.crosscheck(name, samples=200)
    assert report.passed, report.worst
