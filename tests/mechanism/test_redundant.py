"""Poses of redundant legs. The oracle of the six-joint leg is a product of NumPy matrices that knows no pinocchio."""

from __future__ import annotations

import math
import pickle
from dataclasses import fields

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize

import leg_dynamics as ld
from leg_dynamics.errors import (
    JointLimitError,
    LegDynamicsError,
    MissingFootError,
    NonFiniteError,
    OutOfReachError,
    ParameterError,
    ShapeError,
    UnsupportedError,
)
from leg_dynamics.mechanism.redundant import bounded_least_squares

SIX = {"frozen": 0}
SWING = math.radians(70.0)
LOWER = np.array([-SWING, -math.pi, -SWING, -SWING, -math.pi, -SWING])
MIDDLE_JOINTS = [1, 4]


@pytest.fixture(scope="module")
def leg():
    return ld.load("quadruped_leg", route="pinocchio", parameters=SIX)


@pytest.fixture(scope="module")
def hexapod_leg():
    return ld.load("hexapod_leg", route="pinocchio")


@pytest.fixture(scope="module")
def omnileg():
    return ld.load("omnileg", route="pinocchio")


def denavit_hartenberg(theta, d, a, alpha):
    """Standard transform Rz(theta) Tz(d) Tx(a) Rx(alpha)."""
    ct, st, ca, sa = math.cos(theta), math.sin(theta), math.cos(alpha), math.sin(alpha)
    return np.array(
        [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]]
    )


def foot_pose(q, f=0.0375, s=0.075, foot_radius=0.0275):
    """Two modules in a row: swing, middle, swing, swing, middle, swing; a middle joint is a twist alpha."""
    upper_2, middle_2, lower_2, upper_1, middle_1, lower_1 = q
    return (
        denavit_hartenberg(upper_2, 0.0, s, middle_2)
        @ denavit_hartenberg(lower_2, 0.0, 2.0 * f, 0.0)
        @ denavit_hartenberg(upper_1, 0.0, s, middle_1)
        @ denavit_hartenberg(lower_1, 0.0, f + foot_radius, 0.0)
    )


def foot_twists(q, step=1e-6):
    """(v, ω) per joint by central differences, (6, 6)."""
    rotation = foot_pose(q)[:3, :3]
    columns = []
    for unit in step * np.eye(6):
        rate = (foot_pose(q + unit) - foot_pose(q - unit)) / (2.0 * step)
        spin = rate[:3, :3] @ rotation.T
        columns.append([*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]])
    return np.array(columns).T


def angle_between(one, other):
    """Rotation angle, accurate where it is small: |R - S| = 2 sqrt 2 sin(angle / 2)."""
    return 2.0 * math.asin(min(1.0, float(np.linalg.norm(one - other)) / math.sqrt(8.0)))


def inside_limits(leg, q):
    return bool((q >= leg.limits.lower).all() and (q <= leg.limits.upper).all())


# --------------------------------------------------------------------------------------------- forward kinematics


def test_position_rotation_and_jacobian_are_those_of_the_matrix_product(leg):
    for q in np.random.default_rng(0).uniform(LOWER, -LOWER, (200, 6)):
        pose = foot_pose(q)
        np.testing.assert_allclose(leg.foot_position(q), pose[:3, 3], atol=1e-15)
        np.testing.assert_allclose(leg.foot_rotation(q), pose[:3, :3], atol=1e-14)
        np.testing.assert_allclose(leg.geometric_jacobian(q), foot_twists(q), atol=2e-9)


def test_the_oracle_holds_for_other_lengths():
    lengths = {"f": 0.03, "s": 0.09, "foot_radius": 0.01}
    leg = ld.load("quadruped_leg", route="pinocchio", parameters={**SIX, **lengths})
    q = np.random.default_rng(1).uniform(LOWER, -LOWER)
    np.testing.assert_allclose(leg.foot_position(q), foot_pose(q, **lengths)[:3, 3], atol=1e-15)
    assert np.abs(foot_pose(q, **lengths) - foot_pose(q)).max() > 1e-3


@pytest.mark.parametrize("name", ["omnileg", "hexapod_leg"])
def test_jacobians_of_legs_with_loops(name, request):
    """Velocity rows against the closed form, angular ones against differences of the rotation."""
    leg = request.getfixturevalue(name)
    home = leg.backend.mechanism.seeds[0].y
    closed = ld.load(name, route="closed_form")
    for shift in np.random.default_rng(2).uniform(-0.05, 0.05, (5, 3)):
        q = home + shift + [0.0, 0.0, 0.06]
        J = leg.geometric_jacobian(q)
        assert J.shape == (6, 3)
        np.testing.assert_allclose(J[:3], closed.jacobian(q), atol=1e-9)
        rotation = leg.foot_rotation(q)
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-13)
        assert np.linalg.det(rotation) > 0.0
        for k, unit in enumerate(1e-6 * np.eye(3)):
            spin = (leg.foot_rotation(q + unit) - leg.foot_rotation(q - unit)) / 2e-6 @ rotation.T
            np.testing.assert_allclose(J[3:, k], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-7)


def test_a_batch_is_its_rows_and_one_joint_is_enough(leg, lab):
    q = np.random.default_rng(3).uniform(LOWER, -LOWER, (2, 3, 6))
    assert leg.foot_rotation(q).shape == (2, 3, 3, 3)
    assert leg.geometric_jacobian(q).shape == (2, 3, 6, 6)
    np.testing.assert_array_equal(leg.geometric_jacobian(q)[1, 2], leg.geometric_jacobian(q[1, 2]))
    text = lab.Text("arm").joint("turn", "revolute", "base", "body", (0, 0, 1), (0.1, 0, 0), independent=True)
    text.joint("mount", "fixed", "body", "tip", xyz=(0.2, 0, 0))
    arm = ld.load(text.xml, route="pinocchio", foot="tip")
    np.testing.assert_allclose(arm.geometric_jacobian([0.0]).ravel(), [0.0, 0.2, 0.0, 0.0, 0.0, 1.0], atol=1e-15)
    target = [0.1 + 0.2 * math.cos(0.4), 0.2 * math.sin(0.4), 0.0]
    np.testing.assert_allclose(arm.pose_inverse_kinematics(target).q, [0.4], atol=1e-9)
    assert arm.rank_report([0.0]).lost_directions.shape == (5, 6)


# --------------------------------------------------------------------------------------------- rank


def scaled_jacobian(leg, q, length):
    J = leg.geometric_jacobian(q) * np.where(np.array(leg.units.joints) == "m", length, 1.0)
    return J / np.array([length] * 3 + [1.0] * 3)[:, None]


@pytest.mark.parametrize(
    ("degrees", "rank", "position", "rotation"),
    [
        ((0, 0, 0, 0, 0, 0), 3, 1, 2),
        ((0, 90, 0, 0, 0, 0), 4, 2, 3),
        ((0, 0, 0, 0, 90, 0), 4, 2, 3),
        ((10, 70, 30, -45, -60, 35), 6, 3, 3),
    ],
)
def test_ranks_of_the_six_joint_leg(leg, degrees, rank, position, rotation):
    q = np.radians(degrees)
    report = leg.rank_report(q)
    assert (report.rank, report.full_rank, report.deficient) == (rank, 6, rank < 6)
    # By differences of the oracle, whose error is 1e-9.
    independent = [np.linalg.matrix_rank(rows, tol=1e-6) for rows in (foot_twists(q), *np.split(foot_twists(q), 2))]
    assert [report.rank, report.position_rank, report.rotation_rank] == independent == [rank, position, rotation]
    assert report.gap[0] > 1e-2
    assert report.gap[1] < 1e-14
    assert report.lost_directions.shape == report.self_motions.shape == (6 - rank, 6)
    length = report.characteristic_length
    np.testing.assert_allclose(report.lost_directions @ scaled_jacobian(leg, q, length), 0.0, atol=1e-14)
    np.testing.assert_allclose(report.lost_directions @ report.lost_directions.T, np.eye(6 - rank), atol=1e-14)
    np.testing.assert_allclose(leg.geometric_jacobian(q) @ report.self_motions.T, 0.0, atol=1e-14)


def test_the_straight_leg_loses_two_pushes_and_a_turn(leg):
    report = leg.rank_report(np.zeros(6))
    np.testing.assert_allclose(report.lost_directions, np.eye(6)[[0, 2, 4]], atol=1e-12)
    text = str(report)
    assert "rank 3 of 6 (position 1, rotation 2)" in text
    assert "lost: +1 v_x\n" in text
    assert "dimensionless, lengths over 0.226037 m" in text
    assert report.to_dict()["lost_directions"][0][0] == pytest.approx(1.0)


def test_a_lost_direction_is_a_wrench_that_loads_no_joint(leg):
    q = np.radians([0.0, 90.0, 0.0, 0.0, 0.0, 0.0])
    report = leg.rank_report(q)
    wrenches = report.lost_directions / np.array([report.characteristic_length] * 3 + [1.0] * 3)
    np.testing.assert_allclose(wrenches @ foot_twists(q), 0.0, atol=1e-8)


def test_ranks_of_legs_with_loops_and_of_the_reduced_leg(hexapod_leg, omnileg):
    home = hexapod_leg.backend.mechanism.seeds[0].y
    report = hexapod_leg.rank_report(home, characteristic_length=0.5)
    assert (report.rank, report.full_rank, report.deficient) == (3, 3, False)
    expected = np.linalg.svd(scaled_jacobian(hexapod_leg, home, 0.5), compute_uv=False)
    np.testing.assert_allclose(report.singular_values, expected, rtol=1e-12)
    np.testing.assert_allclose(report.lost_directions @ scaled_jacobian(hexapod_leg, home, 0.5), 0.0, atol=1e-12)
    assert report.self_motions.shape == (0, 3)
    # The stretched OmniLeg: gamma does not move the foot.
    stretched = omnileg.rank_report(np.zeros(3))
    assert (stretched.rank, stretched.full_rank) == (2, 3)
    np.testing.assert_allclose(stretched.self_motions, [[0.0, 0.0, 1.0]], atol=1e-9)
    assert omnileg.rank_report([0.1, 0.2, 0.5]).rank == 3
    reduced = ld.load("quadruped_leg", route="pinocchio")
    assert reduced.rank_report(np.radians([0.0, -30.0, -60.0])).rank == 3


def test_arguments_of_the_rank_report(leg):
    for length in (0.0, -1.0, np.nan, np.inf, "1", True):
        with pytest.raises(ParameterError, match="characteristic_length must be a positive"):
            leg.rank_report(np.zeros(6), characteristic_length=length)
    with pytest.raises(ParameterError, match="share of the largest singular value, below 1"):
        leg.rank_report(np.zeros(6), tolerance=1.0)
    with pytest.raises(ShapeError, match="one sample"):
        leg.rank_report(np.zeros((2, 6)))
    with pytest.raises(NonFiniteError):
        leg.rank_report([np.nan] * 6)
    near = np.full(6, 1e-4)
    assert leg.rank_report(near, tolerance=1e-2).rank == 3
    assert leg.rank_report(near, tolerance=1e-12).rank > 3


# --------------------------------------------------------------------------------------------- bounded least squares


def test_bounded_least_squares_is_that_of_another_solver():
    rng = np.random.default_rng(4)
    bound_rows = 0
    for _ in range(200):
        n = int(rng.integers(1, 7))
        E, f = rng.normal(size=(n + 2, n)), 3.0 * rng.normal(size=n + 2)
        lower, upper = -rng.uniform(0.0, 1.0, n) * (rng.random(n) < 0.7), rng.uniform(0.01, 1.0, n)
        x = bounded_least_squares(E, f, np.vstack([np.eye(n), -np.eye(n)]), np.concatenate([lower, -upper]))
        other = lsq_linear(E, f, (lower, upper), method="bvls", tol=1e-14)
        np.testing.assert_allclose(x, other.x, atol=1e-9)
        bound_rows += int((other.active_mask != 0).sum())
    assert bound_rows > 100


# --------------------------------------------------------------------------------------------- inverse kinematics


def solve_all(leg, targets, with_rotation):
    """Solved share, by the oracle; what is not solved must be a named error of the two expected kinds."""
    solved = 0
    for q in targets:
        pose = foot_pose(q)
        try:
            solution = leg.pose_inverse_kinematics(pose[:3, 3], pose[:3, :3] if with_rotation else None)
        except (OutOfReachError, JointLimitError) as error:
            assert error.margin[0] < 0.0  # noqa: PT017
            continue
        reached = foot_pose(solution.q)
        assert inside_limits(leg, solution.q)
        assert np.linalg.norm(reached[:3, 3] - pose[:3, 3]) < 1e-10
        assert solution.position_error < 1e-10
        if with_rotation:
            assert angle_between(reached[:3, :3], pose[:3, :3]) < 1e-10
            assert solution.rotation_error < 1e-10
        solved += 1
    return solved / len(targets)


@pytest.mark.parametrize("with_rotation", [True, False])
def test_reachable_targets_are_reached(leg, with_rotation):
    """The oracle's own poses inside the limits."""
    targets = np.random.default_rng(6).uniform(LOWER, -LOWER, (100, 6))
    assert solve_all(leg, targets, with_rotation) >= 0.99


@pytest.mark.slow
def test_a_thousand_reachable_poses(leg):
    assert solve_all(leg, np.random.default_rng(7).uniform(LOWER, -LOWER, (1000, 6)), True) >= 0.99


@pytest.mark.slow
def test_poses_at_the_limits_and_nearly_straight_ones(leg):
    """Where descents get stuck: half of the swings at a limit, and ranks that nearly drop to 3."""
    rng = np.random.default_rng(8)
    q = rng.uniform(LOWER, -LOWER, (200, 6))
    at_limit = rng.random((200, 6)) < 0.5
    at_limit[:, MIDDLE_JOINTS] = False
    sides = np.where(rng.random((200, 6)) < 0.5, LOWER, -LOWER)
    # The file's limits are the nearest float below the nominal ones, or above.
    edge = np.clip(np.where(at_limit, sides, q), leg.limits.lower, leg.limits.upper)
    assert solve_all(leg, edge, True) >= 0.99
    assert solve_all(leg, 1e-3 * rng.normal(size=(200, 6)), True) >= 0.99


def test_a_solution_tells_its_rank_and_singular_values(leg):
    q = np.radians([10.0, 70.0, 30.0, -45.0, -60.0, 35.0])
    pose = foot_pose(q)
    full = leg.pose_inverse_kinematics(pose[:3, 3], pose[:3, :3], start=q)
    assert (int(full.rank), int(full.redundancy), full.singular_values.shape) == (6, 0, (6,))
    np.testing.assert_allclose(full.q, q, atol=1e-12)
    length = full.characteristic_length
    expected = np.linalg.svd(scaled_jacobian(leg, full.q, length), compute_uv=False)
    np.testing.assert_allclose(full.singular_values, expected, rtol=1e-10)
    place = leg.pose_inverse_kinematics(pose[:3, 3])
    assert (int(place.rank), int(place.redundancy), place.singular_values.shape) == (3, 3, (3,))
    assert place.rotation_error == 0.0
    straight = leg.pose_inverse_kinematics(foot_pose(np.zeros(6))[:3, 3], np.eye(3), start=np.zeros(6))
    assert straight.rank < 6
    np.testing.assert_allclose(leg.foot_position(straight.q), [0.29, 0.0, 0.0], atol=1e-10)


@pytest.mark.parametrize("with_rotation", [True, False])
def test_a_straight_leg_bends_when_the_foot_is_pulled_in(leg, with_rotation):
    """The error has no slope there: J^T e = 0."""
    target = np.array([0.2, 0.0, 0.0])
    np.testing.assert_allclose(foot_twists(np.zeros(6))[:3].T @ (target - [0.29, 0.0, 0.0]), 0.0, atol=1e-9)
    rotation = np.eye(3) if with_rotation else None
    solution = leg.pose_inverse_kinematics(target, rotation, start=np.zeros(6), starts=1)
    np.testing.assert_allclose(foot_pose(solution.q)[:3, 3], target, atol=1e-10)
    assert inside_limits(leg, solution.q)


# --------------------------------------------------------------------------------------------- null space


def lowest_cost_nearby(leg, q, position, posture, half_range):
    """By another solver, on the oracle."""
    limits = np.maximum(leg.limits.lower, -10.0), np.minimum(leg.limits.upper, 10.0)
    result = minimize(
        lambda x: 0.5 * np.sum(((x - posture) / half_range) ** 2),
        q,
        jac=lambda x: (x - posture) / half_range**2,
        bounds=list(zip(*limits, strict=True)),
        constraints={
            "type": "eq",
            "fun": lambda x: 10.0 * (foot_pose(x)[:3, 3] - position),
            "jac": lambda x: 10.0 * foot_twists(x)[:3],
        },
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 200},
    )
    assert np.abs(foot_pose(result.x)[:3, 3] - position).max() < 1e-7
    return result.fun


@pytest.mark.parametrize("far", [False, True])
def test_self_motion_brings_the_leg_to_the_posture(leg, far):
    """The cost is a minimum among poses with that foot and within the limits; a posture outside presses on them."""
    rng = np.random.default_rng(9)
    half_range = np.array([SWING, math.pi, SWING, SWING, math.pi, SWING])
    pressed = 0
    for _ in range(12):
        position = foot_pose(rng.uniform(LOWER, -LOWER))[:3, 3]
        posture = rng.uniform(1.5 * LOWER, -1.5 * LOWER) if far else rng.uniform(LOWER, -LOWER)
        solution = leg.pose_inverse_kinematics(position, posture=posture)
        away = (solution.q - posture) / half_range
        assert solution.posture_cost == pytest.approx(0.5 * away @ away, rel=1e-6)
        assert inside_limits(leg, solution.q)
        assert np.linalg.norm(foot_pose(solution.q)[:3, 3] - position) < 1e-10
        lowest = lowest_cost_nearby(leg, solution.q, position, posture, half_range)
        assert solution.posture_cost <= lowest + 1e-6
        pressed += len(solution.joints_at_limits())
    assert pressed > 2


def test_a_posture_with_the_foot_at_the_target_is_the_solution(leg):
    posture = np.radians([20.0, 60.0, -30.0, 40.0, -100.0, 25.0])
    position = foot_pose(posture)[:3, 3]
    solution = leg.pose_inverse_kinematics(position, start=posture + 0.2, posture=posture)
    np.testing.assert_allclose(solution.q, posture, atol=1e-7)
    assert solution.posture_cost < 1e-14
    # Without a posture: the middle of the limits.
    middle = leg.pose_inverse_kinematics(position, start=posture)
    swings = [0, 2, 3, 5]
    assert np.abs(middle.q[swings]).max() < np.abs(posture[swings]).max()


def test_joints_at_their_limits_are_named(leg):
    q = np.radians([69.9999, 10.0, 69.9999, 30.0, 5.0, 20.0])
    solution = leg.pose_inverse_kinematics(foot_pose(q)[:3, 3], posture=np.radians([150.0, 10, 150.0, 30.0, 5.0, 20.0]))
    reached = solution.joints_at_limits()
    assert reached
    for name, side in reached.items():
        place = leg.joint_names.index(name)
        assert solution.q[place] == getattr(leg.limits, side)[place]
        assert solution.active_limits[leg.tree_joint_names.index(name)] == (1 if side == "upper" else -1)
    free = [name for name in leg.joint_names if name not in reached]
    for name in free:
        place = leg.joint_names.index(name)
        assert leg.limits.lower[place] + 1e-9 < solution.q[place] < leg.limits.upper[place] - 1e-9


def test_a_path_through_the_stretched_pose_is_followed(leg):
    """Out to full stretch and back: the rank drops on the way, and the joints do not jump."""
    previous = np.radians([0.0, 90.0, -30.0, -60.0, 0.0, 10.0])
    begin, end = foot_pose(previous)[:3, 3], np.array([0.29, 0.0, 0.0])
    fractions = np.sin(np.linspace(0.0, math.pi, 61))
    largest = 0.0
    for fraction in fractions:
        position = begin + fraction * (end - begin)
        solution = leg.pose_inverse_kinematics(position, start=previous, posture=previous)
        assert np.linalg.norm(foot_pose(solution.q)[:3, 3] - position) < 1e-10
        largest = max(largest, float(np.abs(solution.q - previous).max()))
        previous = solution.q
    assert largest < 0.5


def test_whole_turns_of_joints_without_limits_are_taken_off(leg):
    q = np.radians([10.0, 20.0, 30.0, -40.0, 50.0, -60.0])
    pose = foot_pose(q)
    turned = q + 2.0 * math.pi * np.array([0, 3, 0, 0, -2, 0])
    near_home = leg.pose_inverse_kinematics(pose[:3, 3], pose[:3, :3], start=turned)
    np.testing.assert_allclose(near_home.q, q, atol=1e-10)
    near_start = leg.pose_inverse_kinematics(pose[:3, 3], pose[:3, :3], start=turned, posture=turned)
    np.testing.assert_allclose(near_start.q, turned, atol=1e-10)


# --------------------------------------------------------------------------------------------- no solution


def test_out_of_reach_states_the_missing_distance(leg):
    with pytest.raises(OutOfReachError, match=r"nearest of \d+ descents.* is 0\.21 m away") as caught:
        leg.pose_inverse_kinematics([0.5, 0.0, 0.0])
    assert caught.value.margin[0] == pytest.approx(-0.21, abs=1e-6)
    nearest = foot_pose(caught.value.nearest)[:3, 3]
    assert np.linalg.norm(nearest - [0.5, 0.0, 0.0]) == pytest.approx(0.21, abs=1e-6)
    for far in (1e9, 1e200):
        with pytest.raises(OutOfReachError) as caught:
            leg.pose_inverse_kinematics([0.0, far, 0.0], np.eye(3), starts=3)
        assert caught.value.margin[0] == pytest.approx(-far, rel=1e-6)


def test_an_orientation_out_of_reach_states_the_angle(hexapod_leg):
    home = hexapod_leg.backend.mechanism.seeds[0].y
    position, rotation = hexapod_leg.foot_position(home), hexapod_leg.foot_rotation(home)
    turn = denavit_hartenberg(0.7, 0.0, 0.0, 0.0)[:3, :3]
    np.testing.assert_allclose(hexapod_leg.pose_inverse_kinematics(position, rotation).q, home, atol=1e-9)
    with pytest.raises(OutOfReachError, match=r"with that orientation.* m and 0\.7 rad away") as caught:
        hexapod_leg.pose_inverse_kinematics(position, turn @ rotation)
    # The leg does not turn about its own axis.
    assert caught.value.missing_angle == pytest.approx(0.7, abs=1e-6)
    assert caught.value.margin[0] == pytest.approx(0.0, abs=1e-6)


def test_beyond_the_limits_states_the_joint_and_the_excess(leg):
    behind = np.array([-0.2, 0.0, 0.0])
    with pytest.raises(JointLimitError, match=r"outside the limits only: theta1 = .* by 0\.517") as caught:
        leg.pose_inverse_kinematics(behind)
    assert caught.value.joint == "theta1"
    nearest = caught.value.nearest
    np.testing.assert_allclose(foot_pose(nearest)[:3, 3], behind, atol=1e-10)
    excess = np.maximum(leg.limits.lower - nearest, nearest - leg.limits.upper).max()
    assert caught.value.margin[0] == pytest.approx(-excess, rel=1e-12)
    solution = leg.pose_inverse_kinematics(behind, limits="ignore")
    np.testing.assert_allclose(foot_pose(solution.q)[:3, 3], behind, atol=1e-10)
    assert not inside_limits(leg, solution.q)


# --------------------------------------------------------------------------------------------- legs with loops


@pytest.mark.parametrize("name", ["omnileg", "hexapod_leg"])
@pytest.mark.parametrize("with_rotation", [False, True])
def test_legs_with_loops(name, with_rotation, request):
    """Three coordinates, no redundancy: position alone gives the pose of the closed form's inverse kinematics."""
    leg = request.getfixturevalue(name)
    closed = ld.load(name, route="closed_form")
    mechanism = leg.backend.mechanism
    rng = np.random.default_rng(10)
    count = 0
    while count < 12:
        q = rng.uniform(leg.limits.lower, leg.limits.upper)
        position = closed.foot_position(q, on_error="nan")
        known = closed.inverse_kinematics(position, on_error="nan") if np.isfinite(position).all() else [np.nan]
        if not np.isfinite(known).all():  # passive joints beyond their limits
            continue
        count += 1
        solution = leg.pose_inverse_kinematics(position, leg.foot_rotation(q) if with_rotation else None)
        assert inside_limits(leg, solution.q)
        np.testing.assert_allclose(closed.foot_position(solution.q), position, atol=1e-10)
        tree = np.array(list(leg.assemble(solution.q).values()))
        assert (tree >= mechanism.lower - 1e-9).all()
        assert (tree <= mechanism.upper + 1e-9).all()
        if with_rotation:
            np.testing.assert_allclose(leg.foot_rotation(solution.q), leg.foot_rotation(q), atol=1e-9)


@pytest.mark.parametrize("kind", ["spherical", "universal", "planar"])
@pytest.mark.parametrize("seed", [1, 4])
def test_redundant_legs_with_loops(lab, kind, seed):
    """Four or five coordinates, angles and lengths: foot reached, posture cost stationary along every self-motion."""
    mechanism = lab.closed_mechanism(kind, seed)
    leg = ld.load(mechanism.description.urdf, route="pinocchio", foot="link_b3")
    home = mechanism.seeds[0].y
    n = len(home)
    assert n == 8 - lab.LOOP_ROWS[kind] > 3
    posture = home + 0.03 * np.cos(np.arange(n))
    target = leg.foot_position(home + 0.02 * np.sin(1.0 + np.arange(n)))
    solution = leg.pose_inverse_kinematics(target, start=home, posture=posture)
    np.testing.assert_allclose(leg.foot_position(solution.q), target, atol=1e-10)
    assert (solution.rank, solution.redundancy) == (3, n - 3)
    half_range = np.array([math.pi if unit == "rad" else 4.0 * mechanism.closure.length for unit in leg.units.joints])
    gradient = (solution.q - posture) / half_range**2
    assert solution.posture_cost == pytest.approx(0.5 * np.sum(((solution.q - posture) / half_range) ** 2), rel=1e-9)
    self_motions = np.linalg.svd(leg.jacobian(solution.q) * half_range)[2][3:] * half_range
    np.testing.assert_allclose(self_motions @ gradient, 0.0, atol=1e-7)
    assert np.abs(self_motions @ ((home - posture) / half_range**2)).max() > 1e-4


def test_limits_of_passive_joints_count(hexapod_leg):
    """Struts inside their limits, a universal joint beyond its own."""
    leg, rng = hexapod_leg, np.random.default_rng(11)
    mechanism = leg.backend.mechanism
    found = 0
    for q in rng.uniform(leg.limits.lower, leg.limits.upper, (4000, 3)):
        try:
            tree = np.array(list(leg.assemble(q).values()))
        except LegDynamicsError:
            continue
        excess = np.maximum(mechanism.lower - tree, tree - mechanism.upper)
        if excess.max() < 0.05:
            continue
        found += 1
        with pytest.raises(JointLimitError) as caught:
            leg.pose_inverse_kinematics(leg.foot_position(q), leg.foot_rotation(q), start=q, starts=4)
        assert caught.value.joint == leg.tree_joint_names[int(excess.argmax())]
        assert caught.value.margin[0] == pytest.approx(-excess.max(), abs=1e-7)
        free = leg.pose_inverse_kinematics(leg.foot_position(q), leg.foot_rotation(q), start=q, limits="ignore")
        np.testing.assert_allclose(free.q, q, atol=1e-7)
        if found == 3:
            break
    assert found == 3


# --------------------------------------------------------------------------------------------- the interface


def test_batches_and_failing_rows(leg):
    rng = np.random.default_rng(12)
    poses = np.array([foot_pose(q) for q in rng.uniform(LOWER, -LOWER, (4, 6))])
    p, rotation = poses[:, :3, 3], poses[:, :3, :3]
    whole = leg.pose_inverse_kinematics(p.reshape(2, 2, 3), rotation.reshape(2, 2, 3, 3))
    assert whole.q.shape == whole.singular_values.shape == whole.active_limits.shape == (2, 2, 6)
    assert whole.rank.tolist() == [[6, 6], [6, 6]]
    single = leg.pose_inverse_kinematics(p[3], rotation[3])
    for field in fields(single):
        value, one = getattr(whole, field.name), getattr(single, field.name)
        np.testing.assert_array_equal(value[1, 1] if isinstance(value, np.ndarray) else value, one)
    with pytest.raises(ShapeError, match="one sample"):
        whole.joints_at_limits()
    same_place = leg.pose_inverse_kinematics(p[0], rotation[0], start=np.zeros((3, 6)))
    assert same_place.q.shape == (3, 6)

    p[1], rotation[2] = [3.0, 0.0, 0.0], np.nan
    with pytest.raises(NonFiniteError) as caught:
        leg.pose_inverse_kinematics(p, rotation, starts=5)
    assert caught.value.rows.tolist() == [2]
    rotation[2] = np.eye(3)
    p[2] = [4.0, 0.0, 0.0]
    with pytest.raises(OutOfReachError, match="2 of 4 rows failed") as caught:
        leg.pose_inverse_kinematics(p, rotation, starts=5)
    assert caught.value.rows.tolist() == [1, 2]
    partly = leg.pose_inverse_kinematics(p, rotation, starts=5, on_error="nan")
    assert partly.rank.tolist() == [6, -1, -1, 6]
    assert partly.redundancy.tolist() == [0, -1, -1, 0]
    assert np.isnan(partly.q).all(axis=1).tolist() == [False, True, True, False]
    np.testing.assert_array_equal(partly.q[0], whole.q[0, 0])


def test_the_result_depends_on_the_arguments_alone(leg):
    pose = foot_pose(np.radians([10.0, 20.0, 30.0, -40.0, 50.0, -60.0]))
    first = leg.pose_inverse_kinematics(pose[:3, 3])
    leg.pose_inverse_kinematics([0.2, 0.1, 0.0])
    copy = pickle.loads(pickle.dumps(leg))
    for other in (leg.pose_inverse_kinematics(pose[:3, 3]), copy.pose_inverse_kinematics(pose[:3, 3])):
        np.testing.assert_array_equal(other.q, first.q)


def test_bad_arguments_are_named(leg):
    p, eye = [0.2, 0.0, 0.0], np.eye(3)
    for rotation, match in (
        (2.0 * eye, "differs from the identity by 3"),
        (np.diag([1.0, 1.0, -1.0]), "it mirrors"),
        (1e200 * eye, "no rotation matrix"),
        (np.zeros((3, 3)), "differs from the identity by 1"),
        (np.eye(4), "last axis holds"),
        (np.zeros(3), r"expected \(3, 3\)"),
        ("no", "real numbers"),
    ):
        with pytest.raises(ShapeError, match=match):
            leg.pose_inverse_kinematics(p, rotation)
    with pytest.raises(ShapeError, match="start has shape"):
        leg.pose_inverse_kinematics(p, start=np.zeros(3))
    with pytest.raises(ShapeError, match="posture has shape"):
        leg.pose_inverse_kinematics(p, posture=np.zeros(5))
    with pytest.raises(NonFiniteError, match="start"):
        leg.pose_inverse_kinematics(p, start=np.full(6, np.inf))
    with pytest.raises(JointLimitError, match=r"the start's theta2 = 1\.5 rad is outside") as caught:
        leg.pose_inverse_kinematics(p, start=[0.0, 9.0, 1.5, 0.0, 0.0, 0.0])
    assert caught.value.margin[0] == pytest.approx(SWING - 1.5, abs=1e-6)
    for starts in (0, 1.5, True, "many"):
        with pytest.raises(ParameterError, match="starts must be a whole number"):
            leg.pose_inverse_kinematics(p, starts=starts)
    with pytest.raises(ParameterError, match="limits must be"):
        leg.pose_inverse_kinematics(p, limits="soft")


def test_other_routes_and_legs_without_a_foot(lab):
    closed, q = ld.load("quadruped_leg", route="closed_form"), np.zeros(3)
    calls = ("foot_rotation", "geometric_jacobian", "rank_report", "pose_inverse_kinematics")
    for name in calls:
        with pytest.raises(UnsupportedError, match=f"has no {name}: load the leg by route pinocchio"):
            getattr(closed, name)(q)
    footless = ld.load(lab.FourBar().text().xml, route="pinocchio")
    q = np.zeros(len(footless.joint_names))
    for name in calls:
        with pytest.raises(MissingFootError):
            getattr(footless, name)(q)
