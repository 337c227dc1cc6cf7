"""Loops that say a thing more than once, in numbers with few digits.

A planar four-bar of hinges, its links' frames turned at random, so that no number is a round one. The oracle is
trigonometry in the plane.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import leg_dynamics as ld
from leg_dynamics.description import parse
from leg_dynamics.errors import AssemblyError, DescriptionError, LegDynamicsError, LegDynamicsWarning
from leg_dynamics.mechanism.mechanism import Mechanism
from leg_dynamics.mechanism.rounded import GREATEST_GAP, closing_gap, settle

from ..five_bar import five_bar
from ..four_bar import COUPLER, CRANK, GROUND, HOME, ROCKER, passive

GRAVITY = (0.0, -9.81, 0.0)
LOOPS = {
    "revolute": ("<axis xyz='{}'/>", 5),
    "spherical": ("", 3),
}


def text(digits, loop="revolute", flags=True, home=True, seed=1, scale=1.0):
    """URDF+ of the four-bar; `digits` behind the point, all where None."""
    generator = np.random.default_rng(seed)
    turned = {name: Rotation.random(random_state=generator) for name in ("crank", "coupler", "rocker")}
    turned["base"] = Rotation.identity()

    def numbers(values):
        return " ".join(repr(float(x)) if digits is None else f"{x:.{digits}f}" for x in values)

    def seen(name, vector):
        """A vector of the plane in a link's own axes."""
        return turned[name].inv().apply(vector)

    def link(name, length):
        return (
            f'<link name="{name}"><inertial><origin xyz="{numbers(seen(name, (scale * length / 2, 0, 0)))}"/>'
            '<mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )

    def joint(name, parent, child, x, independent):
        relative = turned[parent].inv() * turned[child]
        flag = f' independent="{independent}"' if flags else ""
        return (
            f'<joint name="{name}" type="continuous"{flag}><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{numbers(seen(parent, (scale * x, 0, 0)))}" rpy="{numbers(relative.as_euler("xyz"))}"/>'
            f'<axis xyz="{numbers(seen(child, (0, 0, 1)))}"/></joint>'
        )

    ends = [
        f'<{role} link="{name}"><origin xyz="{numbers(seen(name, (scale * length, 0, 0)))}" '
        f'rpy="{numbers(turned[name].inv().as_euler("xyz"))}"/></{role}>'
        for role, name, length in (("predecessor", "coupler", COUPLER), ("successor", "rocker", ROCKER))
    ]
    values = dict(zip("abc", (HOME, *map(float, passive(HOME))), strict=True))
    stated = "".join(f'<joint name="{name}" value="{value:.6f}"/>' for name, value in values.items())
    return (
        '<robot name="turned"><link name="base"/>'
        + link("crank", CRANK)
        + link("coupler", COUPLER)
        + link("rocker", ROCKER)
        + joint("a", "base", "crank", 0.0, "true")
        + joint("b", "crank", "coupler", CRANK, "false")
        + joint("c", "base", "rocker", GROUND, "false")
        + f'<loop name="pin" type="{loop}">{"".join(ends)}{LOOPS[loop][0].format("0 0 1")}</loop>'
        + '<transmission name="t"><joint name="a"/><actuator name="motor"/></transmission>'
        + (f'<configuration name="home">{stated}</configuration>' if home else "")
        + "</robot>"
    )


def height(a):
    """Sum of the heights of the three centres of mass, m."""
    b, c = passive(a)
    knee = CRANK * math.sin(a)
    return 0.5 * knee + knee + 0.5 * COUPLER * math.sin(a + b) + 0.5 * ROCKER * math.sin(c)


def weight(a):
    """Torque of the crank against gravity, N·m."""
    step = 1e-5
    return 9.81 * (height(a + step) - height(a - step)) / (2.0 * step)


def test_with_all_digits_nothing_is_rounded():
    leg = ld.load(text(None), route="pinocchio")
    assert leg.loop_gap == 0.0
    assert leg.torque([1.0], [0.0], [0.0], gravity=GRAVITY) == pytest.approx(weight(1.0), abs=1e-8)


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("flags", [True, False])
@pytest.mark.parametrize("digits", [4, 5, 6, 8, 9, 10, 11, 12])
def test_rounded_numbers_make_no_rigid_frame(digits, loop, flags):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        leg = ld.load(text(digits, loop, flags), route="pinocchio")
        report = leg.mobility_report()
        torque = leg.torque([[1.0], [1.3], [0.8]], np.zeros((3, 1)), np.zeros((3, 1)), gravity=GRAVITY)
    assert (report.mobility, report.redundant) == (1, LOOPS[loop][1] - 2)
    assert leg.joint_names == ("a",)
    gap = leg.loop_gap
    assert gap <= 3.0 * 10.0**-digits + 1e-11
    assert gap > 0.0 or digits == 12
    said = [str(each.message) for each in caught if "contradict each other" in str(each.message)]
    assert len(said) == (gap > 1e-10)
    expected = [weight(a) for a in (1.0, 1.3, 0.8)]
    # Lengths and angles are off by half of the last digit.
    np.testing.assert_allclose(torque[:, 0], expected, atol=30.0 * 10.0**-digits + 1e-8)
    tree = leg.assemble([1.1])
    np.testing.assert_allclose([tree["b"], tree["c"]], passive(1.1), atol=30.0 * 10.0**-digits)


def test_the_warning_says_which_loops_and_by_how_much():
    leg = ld.load(text(5), route="pinocchio")
    with pytest.warns(LegDynamicsWarning, match=r"loops \(pin\) .* stay open by up to [\d.e-]+ rad or [\d.e-]+ m; .*"):
        leg.home  # noqa: B018


def test_without_a_home_a_pose_is_found():
    leg = ld.load(text(6, home=False), route="pinocchio")
    with pytest.warns(LegDynamicsWarning, match=r"no configuration|contradict"):
        assert len(leg.assembly_modes()) == 2


@pytest.mark.parametrize("digits", [2, 3])
def test_what_is_no_rounding_is_refused_by_name(digits):
    with pytest.raises(LegDynamicsError, match=r"rounded|close"):
        ld.load(text(digits), route="pinocchio").home  # noqa: B018


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_the_routes_agree_to_more_than_the_gap(route):
    legs = [ld.load(text(6), route=name) for name in (route, "pinocchio")]
    with pytest.warns(LegDynamicsWarning, match="contradict"):
        forces = [leg.generalized_force([1.0], [2.0], [3.0], gravity=GRAVITY) for leg in legs]
    assert legs[0].loop_gap == legs[1].loop_gap > 1e-8
    np.testing.assert_allclose(*forces, rtol=1e-9)


@pytest.mark.slow
def test_the_crosscheck_of_a_rounded_file_passes(tmp_path):
    file = tmp_path / "turned.urdf"
    file.write_text(text(6), encoding="utf-8")
    with pytest.warns(LegDynamicsWarning, match="contradict"):
        report = ld.crosscheck(file, samples=20)
    assert report.passed
    (closing, *_) = [check for check in report.checks if check.quantity == "loops and couplings close"]
    assert 1e-8 < closing.worst < closing.tolerance < 1e-3


@pytest.mark.parametrize("crank", [0.02, 0.002, 0.0002])
def test_short_links_are_no_rounding(crank):
    """Their rows count by little as well, but they close."""
    link = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
    joint = (
        '<joint name="{0}" type="continuous" independent="{4}"><parent link="{1}"/><child link="{2}"/>'
        '<origin xyz="{3} 0 0"/><axis xyz="0 0 1"/></joint>'
    )
    rod, rocker, ground = 1.0, 0.5, 1.0
    # Of the crank at a right angle to the ground.
    far = math.hypot(ground, crank)
    bend = math.acos((rod**2 + far**2 - rocker**2) / (2.0 * rod * far))
    b = -math.pi / 2.0 - math.atan2(crank, ground) + bend
    tip = np.array([rod * math.cos(math.pi / 2.0 + b), crank + rod * math.sin(math.pi / 2.0 + b)])
    c = math.atan2(tip[1], tip[0] - ground)
    mechanism = Mechanism(
        parse(
            '<robot name="r"><link name="base"/>'
            + "".join(link.format(name) for name in ("crank", "rod", "rocker"))
            + joint.format("a", "base", "crank", 0, "true")
            + joint.format("b", "crank", "rod", crank, "false")
            + joint.format("c", "base", "rocker", ground, "false")
            + f'<loop name="pin" type="revolute"><predecessor link="rod"><origin xyz="{rod} 0 0"/></predecessor>'
            f'<successor link="rocker"><origin xyz="{rocker} 0 0"/></successor><axis xyz="0 0 1"/></loop>'
            f'<configuration name="home"><joint name="a" value="{math.pi / 2!r}"/><joint name="b" value="{b!r}"/>'
            f'<joint name="c" value="{c!r}"/></configuration></robot>'
        )
    )
    assert mechanism.gap == 0.0
    assert mechanism.seeds[0].residual < 1e-12


def test_an_open_loop_is_no_rounding():
    """A pin that lies above the plane of its linkage, on each side of the limit."""
    for rise, rounded in ((1e-5, True), (2e-3, False)):
        raised = five_bar().replace(
            '<successor link="b2"><origin xyz="0.25 0 0"/>', f'<successor link="b2"><origin xyz="0.25 {rise} 0"/>'
        )
        mechanism = Mechanism(parse(raised))
        assert (0.0 < mechanism.gap <= GREATEST_GAP) == rounded
        if rounded:
            assert mechanism.gap * mechanism.closure.length == pytest.approx(rise, rel=1e-6)
        else:
            with pytest.raises(AssemblyError, match="smallest residual found"):
                mechanism.seeds  # noqa: B018


def test_the_pose_of_smallest_gap_has_no_slope():
    mechanism = Mechanism(parse(text(5)))
    order = [mechanism.tree.joint_names.index(name) for name in "abc"]
    start = np.empty(3)
    start[order] = [HOME, *passive(HOME)]
    found = settle(mechanism, start, mechanism.rank_share)
    assert found is not None
    rows = mechanism.evaluate(found[0])
    assert 0.0 < found[1] <= 2.0 * mechanism.gap
    assert closing_gap(mechanism, found[0]).residual == pytest.approx(mechanism.gap, rel=3.0)
    # Along the two directions that count.
    left, sigma, _ = np.linalg.svd(rows.jacobian * mechanism.closure.coordinate_unit, full_matrices=False)
    assert np.abs(left[:, :2].T @ rows.residual).max() < 1e-10
    assert sigma[2] < 1e-3 < sigma[1]


def parallelogram(cranks, crank, digits=None, seed=1, loop="revolute", flags=True, drives=1):
    """A rod on `cranks` cranks, 1 m apart, its frames turned at random: one loop for each crank after the first."""
    generator = np.random.default_rng(seed)
    rotations = [Rotation.random(random_state=generator) for _ in range(cranks + 1)]
    rod, arms = rotations[0], rotations[1:]

    def numbers(values):
        return " ".join(repr(float(x)) if digits is None else f"{x:.{digits}f}" for x in values)

    def frame(rotation, place, turned):
        return f'<origin xyz="{numbers(rotation.inv().apply(place))}" rpy="{numbers(turned.as_euler("xyz"))}"/>'

    def joint(name, parent, child, origin, axis, independent):
        flag = f' independent="{independent}"' if flags else ""
        return (
            f'<joint name="{name}" type="continuous"{flag}><parent link="{parent}"/><child link="{child}"/>{origin}'
            f'<axis xyz="{numbers(axis)}"/></joint>'
        )

    axis = np.array([0.0, 0.0, 1.0])
    inertial = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
    identity = Rotation.identity()
    # All point along y at home.
    tip = np.array([0.0, crank, 0.0])
    parts = ['<robot name="parallelogram"><link name="base"/>', f'<link name="rod">{inertial}</link>']
    for k, arm in enumerate(arms):
        parts.append(f'<link name="crank{k}">{inertial}</link>')
        origin = frame(identity, np.array([float(k), 0.0, 0.0]), arm)
        parts.append(joint(f"turn{k}", "base", f"crank{k}", origin, arm.inv().apply(axis), str(k == 0).lower()))
    parts.append(
        joint("hinge", "crank0", "rod", frame(arms[0], tip, arms[0].inv() * rod), rod.inv().apply(axis), "false")
    )
    for k, arm in list(enumerate(arms))[1:]:
        place = np.array([float(k), 0.0, 0.0])
        if loop == "revolute":
            ends = (frame(rod, place, rod.inv()), frame(arm, tip, arm.inv()))
            parts.append(
                f'<loop name="pin{k}" type="revolute"><predecessor link="rod">{ends[0]}</predecessor>'
                f'<successor link="crank{k}">{ends[1]}</successor><axis xyz="0 0 1"/></loop>'
            )
            continue
        parts.append(f'<link name="stub{k}"/>')
        parts.append(joint(f"pin{k}", f"crank{k}", f"stub{k}", frame(arm, tip, arm.inv()), axis, "false"))
        parts.append(
            f'<loop name="weld{k}" type="fixed"><predecessor link="rod">{frame(rod, place, rod.inv())}</predecessor>'
            f'<successor link="stub{k}"/></loop>'
        )
    parts += [
        f'<transmission name="t{k}"><joint name="turn{k}"/><actuator name="m{k}"/></transmission>'
        for k in range(drives)
    ]
    home = '<joint name="turn0" value="0"/>'
    return "".join(parts) + f'<configuration name="home">{home}</configuration></robot>'


@pytest.mark.parametrize("crank", [0.01, 3e-3, 1e-3])
@pytest.mark.parametrize(("flags", "drives"), [(True, 1), (False, 1), (True, 0), (False, 0)])
def test_short_cranks_on_a_welded_loop_are_no_rounding(crank, flags, drives):
    """The loop's rows count by as little as the cranks are short, and all numbers have all digits."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        leg = ld.load(parallelogram(2, crank, None, 1, "fixed", flags, drives), route="pinocchio")
        assert leg.loop_gap == 0.0
        assert leg.mobility_report().mobility == 1
    tree = leg.assemble([0.5])
    moved = {name: float(tree[name]) for name in ("turn0", "turn1", "hinge", "pin1")}
    turn = moved[leg.joint_names[0]]
    expected = {"turn0": turn, "turn1": turn, "hinge": -turn, "pin1": -turn}
    assert moved == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("flags", [True, False])
@pytest.mark.parametrize(("seed", "digits"), [(1, 10), (2, 8), (3, 9), (4, 6), (5, 7), (6, 5), (8, 7)])
def test_poses_beside_a_bifurcation_do_not_count(seed, digits, flags):
    """Where all cranks are in line with the rod, rows that only rounding makes count by its square root."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        leg = ld.load(parallelogram(3, 0.5, digits, seed, "revolute", flags), route="pinocchio")
        report = leg.mobility_report()
    assert leg.joint_names == ("turn0",)
    assert (report.mobility, report.redundant) == (1, 7)
    assert 0.0 < leg.loop_gap < 30.0 * 10.0**-digits
    tree = leg.assemble([0.3])
    assert float(tree["turn2"]) == pytest.approx(0.3, abs=100.0 * 10.0**-digits)
    assert leg.backend.mechanism.rounding.loops


def test_motions_that_are_meant_decide_about_exact_poses():
    """A five-bar with one hinge askew keeps one exact motion; its flags or drives say that two are meant."""
    turned = '<origin xyz="0.2 0 0" rpy="-1.5708 0 0"/><axis xyz="0 0 1"/>'
    skew = five_bar().replace('<origin xyz="0.2 0 0"/><axis xyz="0 1 0"/>', turned, 1)
    end = '<predecessor link="a2"><origin xyz="0.25 0 0"'
    skew = skew.replace(f"{end}/>", f'{end} rpy="1.5708 0 0"/>')
    silent = skew.replace(' independent="true"', "").replace(' independent="false"', "")
    for text_ in (skew, silent):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            leg = ld.load(text_, route="pinocchio")
            assert len(leg.home) == 2
        assert any("loops (pin) that say" in str(each.message) for each in caught)
        assert leg.joint_names == ("ma", "mb")
        assert 1e-7 < leg.loop_gap < 1e-4


def flat_triangle(height, flags="", more=""):
    """Two bars on a base of 1 m, whose pin is `height` m beside the line."""
    side, corner = math.hypot(0.5, height), math.atan2(height, 0.5)
    link = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
    return (
        f'<robot name="frame"><link name="base"/>{link.format("left")}{link.format("right")}'
        f'<joint name="a" type="continuous" {flags}><parent link="base"/><child link="left"/><axis xyz="0 0 1"/>'
        "</joint>"
        f'<joint name="b" type="continuous"><parent link="left"/><child link="right"/><origin xyz="{side!r} 0 0"/>'
        '<axis xyz="0 0 1"/></joint>'
        f'<loop name="pin" type="revolute"><predecessor link="right"><origin xyz="{side!r} 0 0"/></predecessor>'
        f'<successor link="base"><origin xyz="1 0 0"/></successor><axis xyz="0 0 1"/></loop>{more}'
        f'<configuration name="home"><joint name="a" value="{corner!r}"/><joint name="b" value="{-2.0 * corner!r}"/>'
        "</configuration></robot>"
    )


@pytest.mark.parametrize("flags", ["", 'independent="true"'])
@pytest.mark.parametrize("height", [3e-4, 1e-3, 2e-3])
def test_a_flat_triangle_is_a_frame_and_no_rounded_mechanism(height, flags):
    """It closes to the last digit, and its weakest row counts by more than rounding."""
    with pytest.raises(DescriptionError, match="leave 0 motions, but one of the rows counts by"):
        ld.load(flat_triangle(height, flags), route="pinocchio")


@pytest.mark.parametrize("height", [1e-3, 2e-3])
def test_drives_do_not_turn_a_frame_into_a_rounded_mechanism(height):
    """As many drives as motions, were it one."""
    swing = (
        '<link name="swing"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>'
        '<joint name="c" type="continuous"><parent link="base"/><child link="swing"/><axis xyz="0 0 1"/></joint>'
    )
    drives = "".join(
        f'<transmission name="t{name}"><joint name="{name}"/><actuator name="m{name}"/></transmission>' for name in "ac"
    )
    with pytest.raises(DescriptionError, match="leave 1 motions, but one of the rows counts by"):
        ld.load(flat_triangle(height, more=swing + drives), route="pinocchio")
    with pytest.warns(LegDynamicsWarning, match="the loops leave 1 motion: taking c as independent"):
        leg = ld.load(flat_triangle(height, more=swing), route="pinocchio")
    assert leg.joint_names == ("c",)
    assert leg.loop_gap == 0.0
