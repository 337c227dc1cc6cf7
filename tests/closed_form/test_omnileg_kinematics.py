from __future__ import annotations

import math

import casadi
import numpy as np
import pytest

from leg_dynamics.closed_form import omnileg
from leg_dynamics.closed_form.algebra import cross, matvec, transpose

POSE = tuple(np.radians([30.0, 20.0, 40.0]).tolist())


def rows(states):
    return [tuple(row) for row in states[0].tolist()]


def test_the_screws_of_branch_1_are_the_papers(golden_leg):
    y, x = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
    assert [omnileg.joint_axis(1, i) for i in (1, 2, 3, 4)] == [y, x, x, y]
    assert [omnileg.joint_point(golden_leg, 1, i)[2] for i in (1, 2, 3, 4)] == [0.0, 0.0, 0.15, 0.15]
    for screw, i in zip(omnileg.branch_screws(golden_leg, 1), (1, 2, 3, 4), strict=True):
        assert screw.v == cross(omnileg.joint_point(golden_leg, 1, i), screw.omega)


def test_branches_2_and_3_sit_at_plus_x_and_minus_y_with_turned_axes(golden_leg):
    assert omnileg.joint_point(golden_leg, 2, 1) == (0.075, 0.0, 0.0)
    assert omnileg.joint_point(golden_leg, 3, 3) == (0.0, -0.075, 0.15)
    assert omnileg.joint_axis(2, 1) == (1.0, 0.0, 0.0)
    assert omnileg.joint_axis(2, 2) == (0.0, -1.0, 0.0)
    assert omnileg.joint_axis(3, 1) == (0.0, -1.0, 0.0)
    assert omnileg.joint_axis(3, 2) == (-1.0, 0.0, 0.0)


def test_the_exponential_is_the_matrix_exponential_of_the_twist():
    linalg = pytest.importorskip("scipy.linalg")
    rng = np.random.default_rng(3)
    for _ in range(5):
        omega, point, pitch = rng.normal(size=3), rng.normal(size=3), rng.normal()
        omega /= np.linalg.norm(omega)
        v = np.cross(point, omega) + pitch * omega
        twist = np.zeros((4, 4))
        twist[:3, 3] = v
        twist[:3, :3] = [[0, -omega[2], omega[1]], [omega[2], 0, -omega[0]], [-omega[1], omega[0], 0]]
        theta = rng.normal()
        pose = omnileg.exponential(omnileg.Screw(tuple(omega.tolist()), tuple(v.tolist())), theta)
        expected = linalg.expm(twist * theta)
        np.testing.assert_allclose(pose.rotation, expected[:3, :3], atol=1e-14)
        np.testing.assert_allclose(pose.position, expected[:3, 3], atol=1e-14)


def test_the_product_of_exponentials_of_every_branch_ends_in_the_knee(golden_leg, random_leg, states):
    for leg in (golden_leg, random_leg):
        for q in rows(states):
            for k, angles in enumerate(omnileg.branch_angles(q), 1):
                pose = omnileg.branch_pose(leg, k, angles)
                np.testing.assert_allclose(pose.rotation, np.eye(3), atol=1e-15)
                np.testing.assert_allclose(pose.position, omnileg.knee_position(leg, q), atol=1e-15)
            assert max(map(abs, omnileg.closure_residual(leg, q))) < 1e-15


def test_theta22_with_the_printed_sign_misses_the_knee_by_nine_centimetres(golden_leg):
    theta22 = omnileg.passive_angles(POSE)[1]
    assert theta22 == pytest.approx(-math.atan(math.tan(POSE[1]) * math.cos(POSE[0])), abs=1e-15)
    printed = omnileg.branch_pose(golden_leg, 2, (POSE[0], -theta22, theta22, -POSE[0]))
    gap = np.linalg.norm(np.subtract(printed.position, omnileg.knee_position(golden_leg, POSE)))
    assert gap == pytest.approx(0.0902, abs=5e-5)


def test_foot_position_equals_the_compact_formula(golden_leg, states):
    for q in [POSE, *rows(states)]:
        ta, tb = math.tan(q[0]), math.tan(q[1])
        direction = np.array([tb, -ta, 1.0]) / math.sqrt(1.0 + ta * ta + tb * tb)
        expected = 0.15 * direction + [0.0, 0.0, 2 * 0.095 * math.cos(q[2]) + 0.16]
        np.testing.assert_allclose(omnileg.foot_position(golden_leg, q), expected, atol=1e-12, rtol=0)
    np.testing.assert_allclose(omnileg.foot_position(golden_leg, POSE)[:2], (0.0451, -0.0715), atol=5e-5)


def test_straight_and_bent_leg_lengths(golden_leg):
    assert omnileg.foot_position(golden_leg, (0.0, 0.0, 0.0)) == (0.0, 0.0, 0.5)
    assert omnileg.leg_length_change(golden_leg, 0.0) == 0.0
    assert omnileg.leg_length_change(golden_leg, math.radians(60)) == pytest.approx(0.095, abs=1e-15)


def test_beyond_90_degrees_the_formulas_follow_the_mechanism_continuously(golden_leg):
    before, after = (omnileg.knee_position(golden_leg, (math.radians(a), 0.3, 0.0)) for a in (89.999, 90.001))
    np.testing.assert_allclose(before, after, atol=1e-5)
    past = (math.radians(110.0), 0.3, 0.7)
    assert omnileg.knee_position(golden_leg, past)[2] < 0.0
    assert max(map(abs, omnileg.closure_residual(golden_leg, past))) < 1e-15


def test_jacobian_and_its_derivative_are_derivatives_of_the_foot_position(random_leg, states, symbols):
    q, v, a, _ = symbols
    position = casadi.vertcat(*omnileg.foot_position(random_leg, q))
    jacobian = casadi.jacobian(position, casadi.vertcat(*q))
    rate = casadi.vertcat(*v)
    derivative = casadi.reshape(casadi.jtimes(casadi.vec(jacobian), casadi.vertcat(*q), rate), 3, 3)
    velocity = casadi.mtimes(jacobian, rate)
    acceleration = casadi.mtimes(jacobian, casadi.vertcat(*a)) + casadi.mtimes(derivative, rate)
    oracle = casadi.Function("oracle", [*q, *v, *a], [jacobian, derivative, velocity, acceleration])
    for state in zip(*(array.tolist() for array in states), strict=True):
        expected = [np.array(value) for value in oracle(*state[0], *state[1], *state[2])]
        scale = 1.0 + np.abs(expected[3]).max()
        np.testing.assert_allclose(omnileg.foot_jacobian(random_leg, state[0]), expected[0], atol=1e-13)
        found = omnileg.foot_jacobian_derivative(random_leg, *state[:2])
        np.testing.assert_allclose(found, expected[1], atol=1e-12)
        np.testing.assert_allclose(omnileg.foot_velocity(random_leg, *state[:2]), expected[2].ravel(), atol=1e-12)
        found = omnileg.foot_acceleration(random_leg, *state)
        np.testing.assert_allclose(found, expected[3].ravel(), atol=1e-12 * scale)
        bias = matvec(omnileg.foot_jacobian_derivative(random_leg, *state[:2]), state[1])
        found = omnileg.foot_bias_acceleration(random_leg, *state[:2])
        np.testing.assert_allclose(found, bias, atol=1e-12 * scale)


def test_jacobian_agrees_with_central_differences(golden_leg):
    step = 1e-6
    for j in range(3):
        ahead, behind = (tuple(x + s * step * (i == j) for i, x in enumerate(POSE)) for s in (1, -1))
        slope = np.subtract(omnileg.foot_position(golden_leg, ahead), omnileg.foot_position(golden_leg, behind)) / 2e-6
        np.testing.assert_allclose(transpose(omnileg.foot_jacobian(golden_leg, POSE))[j], slope, atol=1e-9)


def test_determinant_of_the_jacobian(golden_leg, states):
    for q in rows(states):
        numeric = np.linalg.det(omnileg.foot_jacobian(golden_leg, q))
        ta2, tb2 = math.tan(q[0]) ** 2, math.tan(q[1]) ** 2
        audit = -2 * 0.095 * math.sin(q[2]) * 0.15**2 * (1 + ta2) * (1 + tb2) / (1 + ta2 + tb2) ** 2
        found = omnileg.foot_jacobian_determinant(golden_leg, q)
        assert found == pytest.approx(numeric, rel=1e-12, abs=1e-17)
        assert found == pytest.approx(audit, rel=1e-12, abs=1e-17)
    assert omnileg.foot_jacobian_determinant(golden_leg, (0.4, -0.3, 0.0)) == 0.0


def test_speeds_and_accelerations_of_scenario_52_at_the_start(golden_leg):
    amplitude, w = np.array([math.pi / 6, math.pi / 6, math.radians(25)]), math.pi / 3
    q, v, a = (0.0, 0.0, 0.0), tuple((amplitude * w).tolist()), (0.0, 0.0, 0.0)
    np.testing.assert_allclose(omnileg.foot_velocity(golden_leg, q, v), (0.082247, -0.082247, 0.0), atol=5e-7)
    np.testing.assert_allclose(omnileg.foot_acceleration(golden_leg, q, v, a), (0.0, 0.0, -0.129862), atol=5e-7)
    at_one = tuple((amplitude * math.sin(w)).tolist())
    np.testing.assert_allclose(omnileg.foot_position(golden_leg, at_one), (0.060188, -0.060188, 0.460106), atol=5e-7)


@pytest.mark.parametrize("branch", omnileg.BRANCHES)
def test_inverse_kinematics_undoes_forward_kinematics(golden_leg, branch):
    rng = np.random.default_rng(11)
    q = rng.uniform(np.radians([-65, -65, 1]), np.radians([65, 65, 85]), (500, 3))
    q[0], q[1], q[2] = (0.0, 0.5, 0.3), (0.5, 0.0, 0.3), (0.0, 0.0, math.radians(1.0))
    q[:, 2] *= 1.0 if branch == "gamma_positive" else -1.0
    worst = 0.0
    for row in q.tolist():
        found = omnileg.inverse_kinematics(golden_leg, omnileg.foot_position(golden_leg, tuple(row)), branch)
        worst = max(worst, np.abs(np.subtract(found.q, row)).max())
        assert min(found.reach_margin, found.stretch_margin, found.argument_margin, found.margin) > 0.0
        assert found.stretch_margin == pytest.approx(2 * 0.095 * found.argument_margin, abs=1e-18)
    assert worst < 1e-9


@pytest.mark.parametrize("q", [(2.6, 0.3, 0.5), (-2.2, -0.9, 1.3), (2.0, 0.0, 0.8)])
def test_the_thigh_up_solution_is_the_other_pose_with_the_same_foot_position(golden_leg, q):
    p = omnileg.foot_position(golden_leg, q)
    assert omnileg.knee_position(golden_leg, q)[2] < 0.0
    up = omnileg.inverse_kinematics_thigh_up(golden_leg, p)
    np.testing.assert_allclose(up.q, q, atol=1e-12)
    mirrored = omnileg.inverse_kinematics_thigh_up(golden_leg, p, "gamma_negative")
    np.testing.assert_allclose(mirrored.q, (*q[:2], -q[2]), atol=1e-12)


@pytest.mark.parametrize(
    ("t", "degrees"),
    [(1.25, (-4.1976, 19.5196, 58.9975)), (2.5, (-26.5651, 45.0, 54.6235)), (5.0, (-41.8103, 0.0, 38.7411))],
)
def test_golden_angles_of_scenario_51(golden_leg, t, degrees):
    s = t if t <= 2.5 else 5.0 - t
    x = 0.1 * (0.06144 * s**5 - 0.384 * s**4 + 0.64 * s**3)
    y = 0.1 * (0.00192 * t**5 - 0.024 * t**4 + 0.08 * t**3)
    z = 0.05 * (-0.004096 * t**6 + 0.06144 * t**5 - 0.3072 * t**4 + 0.512 * t**3)
    found = omnileg.inverse_kinematics(golden_leg, (x, y, 0.42 - z))
    np.testing.assert_allclose(np.degrees(found.q), degrees, atol=5.1e-5)


def test_reach_limits_on_each_side(golden_leg):
    inside = omnileg.inverse_kinematics(golden_leg, (0.15 - 1e-9, 0.0, 0.3))
    outside = omnileg.inverse_kinematics(golden_leg, (0.15 + 1e-9, 0.0, 0.3))
    assert inside.margin == pytest.approx(1e-9, rel=1e-6)
    assert all(map(math.isfinite, inside.q))
    assert outside.margin == outside.reach_margin == pytest.approx(-1e-9, rel=1e-6)
    assert math.isnan(outside.q[2])


@pytest.mark.parametrize("sign", [1, -1])
def test_stretch_limits_on_each_side(golden_leg, sign):
    edge = 0.15 + 0.16 + sign * 2 * 0.095
    inside = omnileg.inverse_kinematics(golden_leg, (0.0, 0.0, edge - sign * 1e-9))
    outside = omnileg.inverse_kinematics(golden_leg, (0.0, 0.0, edge + sign * 1e-9))
    assert inside.margin == pytest.approx(1e-9, rel=1e-5)
    assert math.isfinite(inside.q[2])
    assert outside.margin == pytest.approx(-1e-9, rel=1e-5)
    assert math.isnan(outside.q[2])


def test_rounding_of_the_arccos_argument_counts_as_a_straight_leg(golden_leg):
    tolerated = 0.5 * omnileg.ARCCOS_TOLERANCE * 2 * 0.095
    found = omnileg.inverse_kinematics(golden_leg, (0.0, 0.0, 0.5 + tolerated))
    assert found.argument_margin < 0.0
    assert found.q[2] == 0.0
    assert found.margin == 0.0
    beyond = omnileg.inverse_kinematics(golden_leg, (0.0, 0.0, 0.5 + 4 * tolerated))
    assert beyond.margin < 0.0
    assert math.isnan(beyond.q[2])


def test_every_straight_pose_is_within_reach_of_its_own_foot_position(golden_leg):
    rng = np.random.default_rng(5)
    over = 0
    for alpha, beta in rng.uniform(-1.1, 1.1, (300, 2)).tolist():
        p = omnileg.foot_position(golden_leg, (alpha, beta, 0.0))
        found = omnileg.inverse_kinematics(golden_leg, p)
        over += found.argument_margin < 0.0
        assert found.margin >= 0.0
        np.testing.assert_allclose(omnileg.foot_position(golden_leg, found.q), p, atol=1e-14)
    assert over > 0


def test_inverse_kinematics_of_a_batch_marks_its_own_rows(golden_leg):
    p = (np.array([0.0, 0.2, 0.03]), np.array([0.0, 0.0, 0.01]), np.array([0.45, 0.4, 0.9]))
    found = omnileg.inverse_kinematics(golden_leg, p)
    np.testing.assert_array_equal(np.sign(found.margin), [1.0, -1.0, -1.0])
    np.testing.assert_array_equal(np.isnan(found.q[2]), [False, True, True])


def test_an_unknown_branch_is_refused(golden_leg):
    with pytest.raises(KeyError):
        omnileg.inverse_kinematics(golden_leg, (0.0, 0.0, 0.4), "sideways")


def test_cardan_angles_turn_z_into_the_rod_direction(golden_leg, states):
    for q in rows(states):
        a, b = omnileg.cardan_angles(q)
        shaft = omnileg.transmission_motions(golden_leg, q, (0.0, 0.0, 0.0))["shaft_A4B4"].turning.rotation
        direction = np.array(omnileg.knee_position(golden_leg, q)) / golden_leg.L1
        np.testing.assert_allclose(np.array(shaft)[:, 2], direction, atol=1e-15)
        turns = [np.array(r) for r in _elementary(q[2], a, b)]
        np.testing.assert_allclose(turns[0] @ turns[1] @ turns[2], shaft, atol=1e-15)


def _elementary(gamma, a, b):
    from leg_dynamics.closed_form.algebra import rotation_x, rotation_y, rotation_z

    for rotation, angle in ((rotation_z, gamma), (rotation_y, a), (rotation_x, b)):
        yield rotation(math.sin(angle), math.cos(angle))


def test_angular_velocity_columns_of_the_cardan_cross_at_the_audits_pose(golden_leg):
    """Audit on (26): at (30, 30, 40) deg the true columns are far from the printed 0 and [0, 1, 0]."""
    q = tuple(np.radians([30.0, 30.0, 40.0]).tolist())
    columns = omnileg.body_motions(golden_leg, q, (0.0, 0.0, 0.0))["cross_A4"].turning.columns
    np.testing.assert_allclose(columns[0], (0.548, -0.653, 0.0), atol=5e-4)
    np.testing.assert_allclose(columns[1], (-0.653, 0.778, 0.0), atol=5e-4)


def test_the_output_shaft_turns_as_the_input_shaft(random_leg, states):
    for q, v in zip(states[0].tolist(), states[1].tolist(), strict=True):
        motions = omnileg.transmission_motions(random_leg, tuple(q), tuple(v))
        assert motions["output_shaft"].turning == motions["input_shaft"].turning


def test_tree_coefficients_are_derivatives_of_the_tree_coordinates(random_leg, states, symbols):
    q = symbols[0]
    names = omnileg.TREE_JOINT_NAMES
    coordinates = omnileg.tree_coordinates(random_leg, q)
    assert tuple(coordinates) == names
    jacobian = casadi.jacobian(casadi.vertcat(*(coordinates[name] for name in names)), casadi.vertcat(*q))
    oracle = casadi.Function("oracle", [*q], [jacobian])
    for row in rows(states):
        found = omnileg.tree_coefficients(random_leg, row)
        assert tuple(found) == names
        np.testing.assert_allclose([found[name] for name in names], np.array(oracle(*row)), atol=1e-13)


def test_rates_of_the_passive_angles_have_the_short_form_with_d(golden_leg):
    a, b, _ = POSE
    d = 1.0 - (math.sin(a) * math.sin(b)) ** 2
    found = omnileg.tree_coefficients(golden_leg, POSE)
    expected12 = (math.cos(b) / d, -math.sin(a) * math.cos(a) * math.sin(b) / d, 0.0)
    expected22 = (math.sin(b) * math.cos(b) * math.sin(a) / d, -math.cos(a) / d, 0.0)
    np.testing.assert_allclose(found["theta12"], expected12, atol=1e-15)
    np.testing.assert_allclose(found["theta22"], expected22, atol=1e-15)


def test_motion_of_every_body_agrees_with_automatic_differentiation(random_leg, states, symbols):
    """Columns and bias terms of all 25 bodies against derivatives of their rotation and centre of mass."""
    q, v, _, _ = symbols
    state, rate = casadi.vertcat(*q), casadi.vertcat(*v)
    motions = omnileg.body_motions(random_leg, q, v)
    assert sorted(motions) == sorted(omnileg.BODY_NAMES)
    outputs, found = [], []
    for body in random_leg.bodies:
        motion = motions[body.name]
        rotation = casadi.vertcat(*(casadi.horzcat(*row) for row in motion.turning.rotation))
        centre = casadi.vertcat(*motion.origin) + casadi.mtimes(rotation, casadi.DM(body.com))
        linear = casadi.jacobian(centre, state)
        spins = []
        for j in range(3):
            turning = casadi.mtimes(casadi.jtimes(rotation, state, casadi.DM(np.eye(3)[j])), rotation.T)
            spins.append(casadi.vertcat(turning[2, 1], turning[0, 2], turning[1, 0]))
        angular = casadi.horzcat(*spins)
        for columns in (angular, linear):
            outputs += [columns, casadi.jtimes(casadi.mtimes(columns, rate), state, rate)]
        com = omnileg.centre_of_mass(motion, body.com)
        for columns, bias in ((motion.turning.columns, motion.turning.bias), (com.columns, com.bias)):
            found += [casadi.horzcat(*(casadi.vertcat(*column) for column in columns)), casadi.vertcat(*bias)]
        outputs += [casadi.mtimes(angular, rate), centre]
        found += [casadi.vertcat(*motion.turning.velocity), casadi.vertcat(*com.position)]
    difference = casadi.Function("difference", [*q, *v], [casadi.vertcat(*map(casadi.vec, outputs))])
    formulas = casadi.Function("formulas", [*q, *v], [casadi.vertcat(*map(casadi.vec, found))])
    for state_q, state_v in zip(states[0].tolist(), states[1].tolist(), strict=True):
        expected = np.array(difference(*state_q, *state_v)).ravel()
        actual = np.array(formulas(*state_q, *state_v)).ravel()
        assert expected.size == 25 * (12 + 12 + 6)
        np.testing.assert_allclose(actual, expected, atol=1e-12 * (1.0 + np.abs(expected).max()), rtol=0)


def test_motion_of_every_body_agrees_with_finite_differences(random_leg):
    q, v = np.array(POSE), np.array([1.3, -0.7, 2.1])
    h = 1e-4

    def pose(t):
        motions = omnileg.body_motions(random_leg, tuple((q + t * v).tolist()), (0.0, 0.0, 0.0))
        return np.array(
            [omnileg.centre_of_mass(motions[body.name], body.com).position for body in random_leg.bodies]
        ), np.array([motions[body.name].turning.rotation for body in random_leg.bodies])

    (before, r_before), (now, r_now), (after, r_after) = pose(-h), pose(0.0), pose(h)
    motions = omnileg.body_motions(random_leg, tuple(q.tolist()), tuple(v.tolist()))
    for n, body in enumerate(random_leg.bodies):
        com = omnileg.centre_of_mass(motions[body.name], body.com)
        np.testing.assert_allclose(np.array(com.columns).T @ v, (after[n] - before[n]) / (2 * h), atol=1e-6)
        np.testing.assert_allclose(com.bias, (after[n] - 2 * now[n] + before[n]) / h**2, atol=2e-6)
        spin = (r_after[n] - r_before[n]) / (2 * h) @ r_now[n].T
        np.testing.assert_allclose(motions[body.name].turning.velocity, (spin[2, 1], spin[0, 2], spin[1, 0]), atol=1e-6)


def test_singularity_margins_are_one_when_straight_and_vanish_at_right_angles(golden_leg):
    assert omnileg.singularity_margins(golden_leg, (0.0, 0.0, 0.0)) == (1.0, 1.0)
    corner = omnileg.singularity_margins(golden_leg, (math.radians(65), math.radians(65), 0.0))
    assert min(corner) > 0.09
    right, quarter = math.pi / 2, math.pi / 4
    assert omnileg.singularity_margins(golden_leg, (right, right, 0.0))[0] == pytest.approx(0.0, abs=1e-15)
    assert omnileg.singularity_margins(golden_leg, (right, 0.0, 0.0))[1] == pytest.approx(0.0, abs=1e-15)
    assert omnileg.singularity_margins(golden_leg, (right, 0.0, quarter))[1] == pytest.approx(0.5, abs=1e-15)
