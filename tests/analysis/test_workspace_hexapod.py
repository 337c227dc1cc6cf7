"""The hexapod leg against the audit of Rong 2012 (section 3), and every margin against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.workspace import PoseEvaluator, constraints_of, margins, workspace
from leg_dynamics.description import link_transforms
from leg_dynamics.errors import NonFiniteError, ShapeError

AUDIT = {
    "hexapod_leg": {
        "volume": 0.413,
        "box": ((-0.65, 0.57), (-0.60, 0.77), (0.22, 0.90)),
        "step": (1.050, 0.312, 0.354),
        "condition": (9.18, 2.24, 5.37),
    },
    "hexapod_leg_preliminary": {
        "volume": 0.440,
        "box": ((-0.75, 0.49), (-0.60, 0.77), (0.18, 0.90)),
        "step": (1.010, 0.283, 0.430),
        "condition": (9.18, 2.33, 5.09),
    },
}
# The audit's workspace has strut limits, U joint angles and the ball's cone.
BEYOND_THE_AUDIT = ("clearance", "telescope")


@pytest.fixture(scope="module", params=AUDIT)
def case(request):
    return AUDIT[request.param], workspace(ld.load(request.param), ignore=BEYOND_THE_AUDIT)


def test_volume(case):
    audit, found = case
    assert found.converged
    assert found.volume.value == pytest.approx(audit["volume"], rel=0.01)
    cartesian = found.injectivity.cartesian
    assert abs(cartesian.value - found.volume.value) <= cartesian.half_width + found.volume.half_width
    assert found.injectivity.several == 0.0
    assert found.injectivity.other_sign == 0.0


def test_box(case):
    audit, found = case
    # the audit's ends come from a grid, and lie inside
    for low, high, (audit_low, audit_high) in zip(found.lower, found.upper, audit["box"], strict=True):
        assert audit_low - 0.02 < low < audit_low + 0.005
        assert audit_high - 0.005 < high < audit_high + 0.02


def test_step_sizes(case):
    audit, found = case
    step = found.step
    assert (step.length, step.front, step.back) == pytest.approx(audit["step"], abs=0.005)
    assert step.longest >= step.length
    assert step.extent >= step.longest


def test_condition_number(case):
    audit, found = case
    mean, deviation, least = audit["condition"]
    assert found.mean.value == pytest.approx(mean, rel=0.01)
    assert found.deviation.value == pytest.approx(deviation, rel=0.01)
    assert found.dexterity.smallest == pytest.approx(least, rel=0.01)
    assert found.dexterity.unit == "m/m"


def test_step_ends_are_exact():
    """In the plane y = 0: x = l1 sin(beta), z = l1 cos(beta), and l2 gives beta (audit, closed forms)."""
    leg = ld.load("hexapod_leg")
    a, b, e = (leg.parameters[name].value for name in "abe")
    low, high = leg.limits.lower, leg.limits.upper

    def beta(l2):
        # l2^2 = a^2 + b^2 + e^2 - 2 a (e sin + b cos)
        size, phase = math.hypot(e, b), math.atan2(b, e)
        return math.asin((a**2 + b**2 + e**2 - l2**2) / (2.0 * a * size)) - phase

    step = workspace(leg, ignore=BEYOND_THE_AUDIT, tolerance=0.01).step
    forward, backward = beta(low[1]), beta(high[1])
    assert step.front == pytest.approx(0.715 - low[0] * math.cos(forward), abs=1e-6)
    assert step.back == pytest.approx(0.715 - low[0] * math.cos(backward), abs=1e-6)
    assert step.front_at[0] == pytest.approx(low[0] * math.sin(forward), abs=1e-6)
    # at z = h the third strut ends the chord: l3^2 = l1^2 + a^2 + c^2 - 2 a c with alpha = 0
    c = leg.parameters["c"].value
    l1 = math.sqrt(high[2] ** 2 - a**2 - c**2 + 2.0 * a * c)
    assert step.end == pytest.approx(math.sqrt(l1**2 - 0.715**2), abs=1e-6)
    assert step.start == pytest.approx(-step.end, abs=1e-9)


def random_poses(leg, count=400):
    box = leg.limits.upper - leg.limits.lower
    q = leg.limits.lower + box * np.random.default_rng(5).random((count, 3))
    closed = np.isfinite(leg.foot_position(q, on_error="nan")).all(axis=1)
    return q[closed]


def test_margins_against_brute_force():
    leg = ld.load("hexapod_leg")
    q = random_poses(leg)
    found, tree = margins(leg, q), leg.assemble(q)
    poses = link_transforms(leg.description, tree)
    for joint in leg.description.moving_joints:
        if math.isfinite(joint.limits.lower):
            np.testing.assert_allclose(
                found[f"{joint.name} lower limit"], tree[joint.name] - joint.limits.lower, atol=1e-12
            )
            np.testing.assert_allclose(
                found[f"{joint.name} upper limit"], joint.limits.upper - tree[joint.name], atol=1e-12
            )
    for cone in leg.description.cones:
        one = poses[cone.link][:, :3, :3] @ cone.axis
        other = poses[cone.other_link][:, :3, :3] @ cone.other_axis
        angle = np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
        np.testing.assert_allclose(found[f"cone {cone.name}"], cone.upper - angle, atol=1e-7)
    for telescope in leg.description.telescopes:
        gap = telescope.sleeve + telescope.rod - telescope.overlap - tree[telescope.joint]
        np.testing.assert_allclose(found[f"telescope {telescope.joint}"], gap, atol=1e-12)
    assert leg.description.clearances
    share = np.linspace(0.0, 1.0, 301)[:, None]
    for clearance in leg.description.clearances:
        lines = []
        for segment in (clearance.first, clearance.second):
            local = np.array(segment.start) + share * (np.array(segment.end) - np.array(segment.start))
            pose = poses[segment.link]
            lines.append(np.einsum("nij,kj->nki", pose[:, :3, :3], local) + pose[:, None, :3, 3])
        nearest = np.array(
            [
                np.linalg.norm(one[:, None] - other[None, :], axis=-1).min()
                for one, other in zip(lines[0][:60], lines[1][:60], strict=True)
            ]
        )
        brute = nearest - clearance.first.radius - clearance.second.radius - clearance.minimum
        exact = found[f"clearance {clearance.name}"][:60]
        assert (exact <= brute + 1e-12).all()
        np.testing.assert_allclose(exact, brute, atol=2e-3)


def test_the_active_constraint_is_the_smallest_normalised_margin():
    leg = ld.load("hexapod_leg")
    evaluate = PoseEvaluator(leg)
    q = random_poses(leg)
    every = np.stack(list(margins(leg, q).values()), axis=-1)
    normalised = every / [each.scale for each in constraints_of(leg.description)]
    poses = evaluate(q)
    np.testing.assert_array_equal(poses.active, normalised.argmin(axis=1))
    rows = np.arange(len(q))
    np.testing.assert_allclose(poses.margin, every[rows, poses.active], atol=1e-14)
    np.testing.assert_allclose(poses.normalised, normalised.min(axis=1), atol=1e-14)
    np.testing.assert_array_equal(poses.feasible, (every >= 0.0).all(axis=1))
    np.testing.assert_allclose(evaluate.all_margins(q), every, atol=1e-14)


def test_the_sleeves_collide_near_the_shortest_strut_1():
    """Audit: -1.1 mm on the home axis at l1 = 530 mm; clear by 3.4 mm at 550."""
    leg = ld.load("hexapod_leg")
    short, longer = (
        float(margins(leg, leg.inverse_kinematics([0.0, 0.0, z], limits="ignore"))["clearance sleeves_1_3"])
        for z in (0.53, 0.55)
    )
    assert short == pytest.approx(-0.0011, abs=1e-4)
    assert longer == pytest.approx(0.0034, abs=1e-4)


def test_a_pose_in_another_assembly_mode_is_no_solution():
    found = workspace(ld.load("hexapod_leg"), tolerance=0.02)
    for each in found.slices:
        inside = np.isfinite(each.condition)
        assert 0.2 < inside.mean() < 0.6
        assert (each.normalised[inside] >= 0.0).all()


def test_the_routes_agree():
    formulas, symbolic = ld.load("hexapod_leg"), ld.load("hexapod_leg", route="symbolic")
    q = random_poses(formulas, 300)
    one, other = PoseEvaluator(formulas)(q), PoseEvaluator(symbolic)(q)
    both = np.isfinite(other.normalised)
    assert both.mean() > 0.95
    np.testing.assert_array_equal(one.active[both], other.active[both])
    np.testing.assert_allclose(one.condition[both], other.condition[both], rtol=1e-6)
    np.testing.assert_allclose(one.margin[both], other.margin[both], atol=1e-8)


def test_margins_refuse_what_is_no_pose():
    leg = ld.load("hexapod_leg")
    with pytest.raises(NonFiniteError, match="first row 1"):
        margins(leg, [[0.7, 0.4, 0.7], [0.7, math.nan, 0.7]])
    with pytest.raises(ShapeError):
        margins(leg, [0.7, 0.4])
    assert all(math.isnan(value) for value in margins(leg, [0.9, 0.01, 0.53]).values())
