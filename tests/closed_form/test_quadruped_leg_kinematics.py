from __future__ import annotations

import dataclasses
import itertools

import casadi
import numpy as np
import pytest

from leg_dynamics.closed_form import quadruped_leg as quadruped
from leg_dynamics.errors import JointLimitError, NonFiniteError, OutOfReachError, RouteError, SingularityError

POSE = tuple(np.radians((0.0, -30.0, -60.0)).tolist())
MOUNT = (0.1125, -0.055, 0.0)
COUNT = 4000


@pytest.fixture(scope="module")
def leg():
    return quadruped.QuadrupedLeg(0.075, 0.075, 0.140, bodies=())


@pytest.fixture(scope="module", params=[(0.075, 0.075, 0.140), (0.04, 0.11, 0.123), (0.0, 0.2, 0.06)], ids=str)
def any_leg(request):
    return quadruped.QuadrupedLeg(*request.param, bodies=())


@pytest.fixture(scope="module")
def angles():
    """Joint angles (3, 4000) in all directions."""
    return tuple(np.random.default_rng(11).uniform(-np.pi, np.pi, (3, COUNT)))


def branches_of(leg, q):
    """Signs of each pose's branch: (4000,) booleans by name."""
    p = quadruped.foot_position(leg, q)
    front = p[0] * np.cos(q[0]) + p[1] * np.sin(q[0]) > 0.0
    positive = q[2] > 0.0
    return {
        name: (front == name.startswith("front")) & (positive == name.endswith("positive"))
        for name in quadruped.BRANCHES
    }


def slope(function, point, h=1e-4):
    """Fourth-order differences of a function of three components: one more axis, last."""
    columns = []
    for i in range(3):
        at = [tuple(x + k * h * (i == j) for j, x in enumerate(point)) for k in (-2, -1, 1, 2)]
        values = [np.asarray(function(p)) for p in at]
        columns.append((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h))
    return np.stack(columns, axis=-1)


def test_equation_4_coefficient_by_coefficient():
    """The foot is linear in l1, l2, l3, a, b, c at fixed angles: compare every coefficient and the constant."""
    lengths = casadi.SX.sym("lengths", 6)
    l1, l2, l3, a, b, c = (lengths[i] for i in range(6))
    foot = casadi.vertcat(
        *quadruped.foot_position_in_body(quadruped.QuadrupedLeg(l1, l2, l3, bodies=()), POSE, (a, b, c))
    )
    printed = casadi.vertcat(np.sqrt(3.0) / 2.0 * l2 + l1 + a, b, -(l3 + l2 / 2.0) + c)  # (4)
    assert not casadi.depends_on(casadi.jacobian(foot, lengths), lengths)
    difference = casadi.Function("difference", [lengths], [casadi.jacobian(foot - printed, lengths), foot - printed])
    coefficients, constant = difference(np.zeros(6))
    np.testing.assert_allclose(coefficients.full(), 0.0, atol=5e-16)
    np.testing.assert_array_equal(constant.full(), 0.0)


def test_equation_4_with_numbers(leg):
    foot = quadruped.foot_position_in_body(leg, POSE, MOUNT)
    np.testing.assert_allclose(foot, (0.0375 * np.sqrt(3.0) + 0.1875, -0.055, -0.1775), atol=1e-16)
    np.testing.assert_allclose(foot, (0.2525, -0.055, -0.1775), atol=5e-5)
    rng = np.random.default_rng(1)
    l1, l2, l3, a, b, c = rng.uniform(-1.0, 1.0, (6, COUNT))
    found = quadruped.foot_position_in_body(quadruped.QuadrupedLeg(l1, l2, l3, bodies=()), POSE, (a, b, c))
    expected = (np.sqrt(3.0) / 2.0 * l2 + l1 + a, b, -(l3 + 0.5 * l2) + c)
    np.testing.assert_allclose(quadruped_array(found), expected, atol=1e-15)


def quadruped_array(nested):
    if isinstance(nested, tuple):
        return np.array([quadruped_array(part) for part in nested])
    return np.broadcast_to(nested, COUNT)


def test_lengths_of_a_leg_of_two_modules():
    np.testing.assert_allclose(quadruped.module_lengths(0.150, 0.0375, 0.0275), (0.075, 0.075, 0.140), rtol=1e-15)
    np.testing.assert_allclose(quadruped.module_lengths(0.150, 0.055, 0.0275), (0.040, 0.110, 0.1225), rtol=1e-14)
    np.testing.assert_allclose(quadruped.module_lengths(0.150, 0.030, 0.0275), (0.090, 0.060, 0.1475), rtol=1e-14)


def test_transforms_multiply_to_equation_2(leg, angles):
    product = quadruped_array(quadruped.transform_hip_to_body(MOUNT))
    for transform in quadruped.link_transforms(leg, angles):
        product = np.einsum("ijk,jlk->ilk", product, quadruped_array(transform))
    found = quadruped_array(quadruped.transform_foot_to_body(leg, angles, MOUNT))
    np.testing.assert_allclose(found, product, atol=1e-15)
    rotation = np.moveaxis(found[:3, :3], -1, 0)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-14)
    in_hip = quadruped_array(quadruped.transform_foot_to_hip(leg, angles))
    np.testing.assert_allclose(in_hip[:3, 3], quadruped_array(quadruped.foot_position(leg, angles)), atol=1e-16)
    np.testing.assert_allclose(found[:3, 3] - np.array(MOUNT)[:, None], in_hip[:3, 3], atol=1e-16)


def test_table_1_means_standard_parameters(leg):
    """Read as modified parameters, the same table puts the foot of equation (4) elsewhere."""
    product = np.eye(4)
    for angle, length, twist in zip(POSE, (leg.l1, leg.l2, leg.l3), (np.pi / 2, 0.0, 0.0), strict=True):
        about_x = np.array(quadruped.standard_transform(0.0, 1.0, length, np.sin(twist), np.cos(twist)))
        about_z = np.array(quadruped.standard_transform(np.sin(angle), np.cos(angle), 0.0, 0.0, 1.0))
        product = product @ about_x @ about_z
    np.testing.assert_allclose(product[:3, 3] + MOUNT, (0.3837, -0.055, -0.070), atol=2e-2)
    assert np.linalg.norm(product[:3, 3] - quadruped.foot_position(leg, POSE)) > 0.1


def test_equations_7_and_9_leave_the_links_that_follow(leg, angles):
    pose = quadruped.transform_foot_to_body(leg, angles, MOUNT)
    _, second, third = (quadruped_array(transform) for transform in quadruped.link_transforms(leg, angles))
    found = quadruped_array(quadruped.foot_from_link_1(leg, pose, angles[0], MOUNT))
    np.testing.assert_allclose(found, np.einsum("ijk,jlk->ilk", second, third), atol=1e-15)
    found = quadruped_array(quadruped.foot_from_link_2(leg, pose, angles[0], angles[1], MOUNT))
    np.testing.assert_allclose(found, third, atol=1e-15)


def test_inverse_kinematics_returns_the_pose_on_its_branch(any_leg, angles):
    """4,000 poses in all directions; each lies in one of the four branches."""
    p = quadruped.foot_position(any_leg, angles)
    seen = np.zeros(COUNT, dtype=int)
    for branch, rows in branches_of(any_leg, angles).items():
        found = quadruped.inverse_kinematics(any_leg, tuple(x[rows] for x in p), branch)
        assert rows.sum() > 100, branch
        assert (found.margin >= 0.0).all()
        np.testing.assert_allclose(found.q, [x[rows] for x in angles], atol=1e-10, rtol=0, err_msg=branch)
        seen += rows
    assert (seen == 1).all()


def test_every_branch_that_reaches_a_foot_puts_it_there(any_leg):
    p = tuple(np.random.default_rng(3).uniform(-0.35, 0.35, (3, COUNT)))
    found = {branch: quadruped.inverse_kinematics(any_leg, p, branch) for branch in quadruped.BRANCHES}
    for branch, solution in found.items():
        inside = solution.margin > 0.0
        assert 50 < inside.sum() < COUNT
        q = tuple(x[inside] for x in solution.q)
        assert (np.abs(q) <= np.pi).all()
        np.testing.assert_allclose(quadruped.foot_position(any_leg, q), [x[inside] for x in p], atol=1e-13)
        outside = solution.reach_margin < 0.0
        assert np.isnan(solution.q[1][outside]).all()
        assert branches_of(any_leg, q)[branch].all()
    everywhere = np.all([solution.margin > 1e-6 for solution in found.values()], axis=0)
    for one, other in itertools.combinations(found.values(), 2):
        apart = np.abs(np.angle(np.exp(1j * (np.array(one.q) - np.array(other.q))))).max(axis=0)
        assert (apart[everywhere] > 1e-6).all()


def test_the_corrected_equations_are_the_same_solution(leg):
    """(8), (12) and (13) one after the other, as the paper states them."""
    rng = np.random.default_rng(2)
    q = tuple(rng.uniform((-1.2, -1.2, 0.05), (1.2, 1.2, 3.0), (COUNT, 3)).T)
    for branch in quadruped.BRANCHES:
        hip, knee = (1.0 if branch.startswith("front") else -1.0), (1.0 if branch.endswith("positive") else -1.0)
        pose = (q[0], q[1], knee * q[2])
        p = quadruped.foot_position(leg, pose)
        rows = branches_of(leg, pose)[branch]
        p, pose = tuple(x[rows] for x in p), tuple(x[rows] for x in pose)
        angle_1 = quadruped.theta1(p, hip)
        t = np.cos(angle_1) * p[0] + np.sin(angle_1) * p[1] - leg.l1
        angle_2 = quadruped.theta2(leg, t, p[2], knee)
        angle_3 = quadruped.theta3(leg, t, p[2], angle_2)
        np.testing.assert_allclose(np.angle(np.exp(1j * (angle_2 - pose[1]))), 0.0, atol=1e-11)
        np.testing.assert_allclose((angle_1, angle_3), (pose[0], pose[2]), atol=1e-11)
        np.testing.assert_allclose(
            quadruped.knee_components(leg, t, p[2], angle_2),
            (leg.l3 * np.cos(pose[2]), leg.l3 * np.sin(pose[2])),
            atol=1e-13,
        )  # (10), (11)


def test_the_default_branch_is_the_papers_knee(leg):
    p = quadruped.foot_position(leg, POSE)
    np.testing.assert_allclose(quadruped.inverse_kinematics(leg, p).q, POSE, atol=1e-14)
    other = quadruped.inverse_kinematics(leg, p, "front_knee_positive").q
    np.testing.assert_allclose(np.degrees(other), (0.0, -109.8, 60.0), atol=0.05)
    found = quadruped.inverse_kinematics_in_body(leg, quadruped.foot_position_in_body(leg, POSE, MOUNT), MOUNT)
    np.testing.assert_allclose(found.q, POSE, atol=1e-14)


def test_margins_are_distances(leg):
    front = quadruped.inverse_kinematics(leg, (0.4, 0.0, 0.0))
    assert front.stretch_margin == pytest.approx(0.29 - 0.4)
    assert front.margin == front.reach_margin == front.stretch_margin
    folded = quadruped.inverse_kinematics(leg, (0.0, 0.1, 0.0))
    assert folded.fold_margin == pytest.approx(0.025 - 0.065)
    assert np.isnan(folded.q[2])
    inside = quadruped.inverse_kinematics(leg, (0.0, 0.2, -0.1))
    distance = np.hypot(0.125, 0.1)
    assert inside.margin == pytest.approx(min(0.215 - distance, distance - 0.065))
    assert inside.axis_margin == pytest.approx(0.2)
    margins = quadruped.limit_margins(POSE, (-1.2,) * 3, (1.1,) * 3)
    assert margins == pytest.approx((1.1, 1.2 - np.pi / 6.0, 1.2 - np.pi / 3.0))


@pytest.mark.parametrize("branch", quadruped.BRANCHES)
def test_straight_and_folded_legs_are_within_reach(any_leg, branch):
    """Rounding puts every other of them a little outside; angles are then known to half their digits."""
    rng = np.random.default_rng(4)
    hip, pitch = rng.uniform(-np.pi, np.pi, (2, 1000))
    knee = np.repeat((0.0, np.pi), 500)
    p = quadruped.foot_position(any_leg, (hip, pitch, knee))
    found = quadruped.inverse_kinematics(any_leg, p, branch)
    radius = any_leg.l1 + np.cos(pitch) * (any_leg.l2 + np.cos(knee) * any_leg.l3)
    own = (radius > 0.0) == branch.startswith("front")
    assert own.sum() > 50
    assert (found.margin[own] >= 0.0).all()
    q = tuple(x[own] for x in found.q)
    np.testing.assert_allclose(quadruped.foot_position(any_leg, q), [x[own] for x in p], atol=1e-12)
    np.testing.assert_allclose(np.abs(q[2]), knee[own], atol=1e-5)
    np.testing.assert_allclose(q[0], hip[own], atol=1e-12)


def test_angles_are_wrapped_into_one_turn(leg):
    for wraps in itertools.product((-1, 0, 1), repeat=3):
        turned = tuple(x + 2.0 * np.pi * k for x, k in zip(POSE, wraps, strict=True))
        found = quadruped.inverse_kinematics(leg, quadruped.foot_position(leg, turned))
        np.testing.assert_allclose(found.q, POSE, atol=1e-14)
    behind = (np.pi - 1e-3, -0.5, -1.0), (-np.pi + 1e-3, -0.5, -1.0)
    for q in behind:
        np.testing.assert_allclose(quadruped.inverse_kinematics(leg, quadruped.foot_position(leg, q)).q, q, atol=1e-13)


def test_a_foot_on_an_axis_has_no_unique_angles(leg):
    on_hip_axis = quadruped.inverse_kinematics(leg, (0.0, 0.0, -0.15))
    assert on_hip_axis.reach_margin > 0.0
    assert on_hip_axis.singular_margin == on_hip_axis.margin == -quadruped.CLEARANCE
    equal = dataclasses.replace(leg, l3=leg.l2)
    on_pitch_axis = quadruped.inverse_kinematics(equal, (0.0, leg.l1, 0.0))
    assert on_pitch_axis.singular_margin == pytest.approx(-quadruped.CLEARANCE)
    out_of_reach = quadruped.inverse_kinematics(leg, (0.0, 0.0, -0.3))
    assert out_of_reach.singular_margin == 0.0
    assert out_of_reach.margin == pytest.approx(0.215 - np.hypot(0.075, 0.3))


def test_jacobian_against_differences_and_its_determinant(any_leg, angles):
    J = np.moveaxis(quadruped_array(quadruped.foot_jacobian(any_leg, angles)), -1, 0)
    numeric = np.moveaxis(slope(lambda q: quadruped_array(quadruped.foot_position(any_leg, q)), angles), 1, 0)
    np.testing.assert_allclose(J, numeric, atol=1e-11)
    determinant = quadruped.foot_jacobian_determinant(any_leg, angles)
    np.testing.assert_allclose(np.linalg.det(J), determinant, atol=1e-16)
    _, _, q3 = angles
    q23 = angles[1] + q3
    radius = any_leg.l1 + any_leg.l2 * np.cos(angles[1]) + any_leg.l3 * np.cos(q23)
    np.testing.assert_allclose(determinant, -any_leg.l2 * any_leg.l3 * np.sin(q3) * radius, atol=1e-17)
    inverse = np.moveaxis(quadruped_array(quadruped.inverse_jacobian(any_leg, angles)), -1, 0)
    error = np.abs(inverse @ J - np.eye(3)).max(axis=(1, 2))
    assert (error * np.abs(np.sin(q3)) * np.abs(radius)).max() < 1e-14


def test_jacobian_is_singular_where_the_determinant_vanishes(leg):
    for q in ((0.3, -0.5, 0.0), (0.3, 0.4, np.pi)):
        assert np.linalg.matrix_rank(np.array(quadruped.foot_jacobian(leg, q)), tol=1e-12) == 2
        assert quadruped.foot_jacobian_determinant(leg, q) == pytest.approx(0.0, abs=1e-18)
    foot_on_the_axis = quadruped.inverse_kinematics(leg, (1e-8, 0.0, -0.15)).q
    assert quadruped.foot_jacobian_determinant(leg, foot_on_the_axis) == pytest.approx(0.0, abs=1e-9)


def test_jacobian_derivative_and_bias_against_differences(any_leg, angles):
    v = tuple(np.random.default_rng(0).normal(size=(3, COUNT)))

    def at(t):
        q = tuple(x + t * rate for x, rate in zip(angles, v, strict=True))
        return quadruped_array(quadruped.foot_jacobian(any_leg, q)), quadruped_array(
            quadruped.transform_foot_to_hip(any_leg, q)
        )[:3, :3]

    h = 1e-3
    far, near, ahead, further = (at(k * h) for k in (-2, -1, 1, 2))
    numeric, turning = (
        (a - 8 * b + 8 * c - d) / (12 * h) for a, b, c, d in zip(far, near, ahead, further, strict=True)
    )
    exact = quadruped_array(quadruped.foot_jacobian_derivative(any_leg, angles, v))
    np.testing.assert_allclose(exact, numeric, atol=1e-9)
    bias = np.einsum("ijk,jk->ik", exact, np.array(v))
    np.testing.assert_allclose(quadruped.foot_bias_acceleration(any_leg, angles, v), bias, atol=1e-14)
    velocity = np.einsum("ijk,jk->ik", at(0.0)[0], np.array(v))
    np.testing.assert_allclose(quadruped.foot_velocity(any_leg, angles, v), velocity, atol=1e-14)
    acceleration = quadruped.foot_acceleration(any_leg, angles, v, v)
    np.testing.assert_allclose(acceleration, bias + velocity, atol=1e-14)
    spin = np.einsum("ijk,ljk->ilk", turning, at(0.0)[1])
    omega = (spin[2, 1], spin[0, 2], spin[1, 0])
    np.testing.assert_allclose(quadruped.foot_angular_velocity(any_leg, angles, v), omega, atol=1e-8)


@pytest.fixture(scope="module")
def loaded(quadruped_lab):
    return quadruped_lab.load()


def test_named_errors_of_the_interface(loaded):
    assert loaded.branches == quadruped.BRANCHES
    np.testing.assert_allclose(loaded.inverse_kinematics(loaded.foot_position(POSE)), POSE, atol=1e-13)
    with pytest.raises(OutOfReachError, match=r"0\.11 m are missing") as caught:
        loaded.inverse_kinematics([0.4, 0.0, 0.0])
    assert caught.value.margin == pytest.approx(-0.11)
    with pytest.raises(SingularityError, match="not unique") as unclear:
        loaded.inverse_kinematics([0.0, 0.0, -0.15], limits="ignore")
    assert unclear.value.margin == pytest.approx(-quadruped.CLEARANCE)
    with pytest.raises(SingularityError, match="the joint angles at"):
        loaded.inverse_kinematics([3e-10, -4e-10, -0.15], limits="ignore")
    with pytest.raises(JointLimitError, match=r"theta3 = -1\.5") as outside:
        loaded.inverse_kinematics(loaded.foot_position([0.1, -0.2, np.radians(-88.0)]))
    assert outside.value.margin == pytest.approx(np.radians(-18.0))
    assert outside.value.joint == "theta3"
    with pytest.raises(JointLimitError, match="theta1"):
        loaded.inverse_kinematics([0.06, -0.03, -0.12], "back_knee_negative")
    with pytest.raises(RouteError, match="front_knee_negative"):
        loaded.inverse_kinematics([0.2, 0.0, -0.1], "up")
    with pytest.raises(NonFiniteError):
        loaded.inverse_kinematics([0.1, np.nan, 0.3])


def test_rows_of_a_batch_fail_for_their_own_reasons(loaded):
    good = loaded.foot_position(POSE)
    p = np.array([good, [0.0, 0.0, -0.15], [0.5, 0.0, 0.0], good, [0.0, 0.0, -0.16]])
    q = loaded.inverse_kinematics(p, on_error="nan")
    np.testing.assert_array_equal(np.isnan(q).any(axis=1), [False, True, True, False, True])
    with pytest.raises(SingularityError, match="2 with SingularityError, the rest with OutOfReachError") as caught:
        loaded.inverse_kinematics(p)
    np.testing.assert_array_equal(caught.value.rows, [1, 4])
    np.testing.assert_array_equal(caught.value.all_rows, [1, 2, 4])
    with pytest.raises(OutOfReachError) as missing:
        loaded.inverse_kinematics(p[2:])
    np.testing.assert_array_equal(missing.value.rows, [0])
    assert missing.value.margin == pytest.approx(-0.21)


def test_foot_force_of_a_straight_leg_is_a_singularity_error(loaded):
    q, zero = np.array([0.1, -0.4, -0.9]), np.zeros(3)
    tau = loaded.torque(q, zero, zero, foot_force=[1.0, 2.0, 30.0])
    np.testing.assert_allclose(loaded.foot_force(q, zero, zero, tau), [1.0, 2.0, 30.0], atol=1e-10)
    with pytest.raises(SingularityError) as caught:
        loaded.foot_force([0.1, -0.4, 1e-9], zero, zero, tau)
    assert 0.0 <= caught.value.margin < 1e-8
    assert np.isfinite(loaded.torque([0.1, -0.4, 0.0], zero, zero)).all()
