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
from leg_dynamics.errors import AssemblyError, LegDynamicsError, LegDynamicsWarning
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
    assert 1e-8 < closing.worst < closing.tolerance < 1e-4


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
    assert closing_gap(mechanism, found[0]) == pytest.approx(mechanism.gap, rel=3.0)
    # Along the two directions that count.
    left, sigma, _ = np.linalg.svd(rows.jacobian * mechanism.closure.coordinate_unit, full_matrices=False)
    assert np.abs(left[:, :2].T @ rows.residual).max() < 1e-10
    assert sigma[2] < 1e-3 < sigma[1]
