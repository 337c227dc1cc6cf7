from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.closed_form import hexapod_leg as hexapod
from leg_dynamics.description import read
from leg_dynamics.errors import (
    AssemblyError,
    BranchError,
    JointLimitError,
    NonFiniteError,
    OutOfReachError,
    RouteError,
    SingularityError,
)

X = (0.25, 0.2, 0.65)
LENGTHS = (0.72457, 0.39877, 0.68439)
JV = [[0.3450, 0.2760, 0.8971], [-0.2587, 0.0280, 0.0909], [0.3653, 0.0060, 0.9479]]


@pytest.fixture(scope="module")
def leg():
    return hexapod.from_urdf(read("hexapod_leg"))


@pytest.fixture(scope="module", params=[1.0, -1.0], ids=["right", "left"])
def sided(leg, request):
    return dataclasses.replace(leg, side=request.param)


@pytest.fixture(scope="module")
def feet():
    """Foot positions (3, 400) inside 57 deg of both angles of strut 1."""
    rng = np.random.default_rng(11)
    alpha, beta, l1 = rng.uniform([-1.0, -1.0, 0.53], [1.0, 1.0, 0.9], (400, 3)).T
    return l1 * np.sin(beta), -l1 * np.sin(alpha) * np.cos(beta), l1 * np.cos(alpha) * np.cos(beta)


def slope(function, point, h=1e-5):
    """Fourth-order differences of a function of three components: one more axis, last."""
    columns = []
    for i in range(3):
        at = [tuple(x + k * h * (i == j) for j, x in enumerate(point)) for k in (-2, -1, 1, 2)]
        values = [np.asarray(function(p)) for p in at]
        columns.append((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h))
    return np.stack(columns, axis=-1)


def test_golden_pose(leg):
    found = hexapod.inverse_kinematics(leg, X)
    np.testing.assert_allclose(found.q, LENGTHS, atol=5e-6)
    np.testing.assert_allclose(np.degrees(hexapod.platform_angles(X)), (-17.103, 20.184), atol=5e-4)
    np.testing.assert_allclose(hexapod.inverse_jacobian(leg, X), JV, atol=5e-5)
    np.testing.assert_allclose(
        (hexapod.strut_length_1(X), hexapod.strut_length_2(leg, X), hexapod.strut_length_3(leg, X)), found.q, rtol=1e-15
    )


def test_the_angles_are_swapped_as_printed(leg):
    w = hexapod.platform_direction(X)
    alpha, beta = hexapod.platform_angles(X)
    np.testing.assert_allclose(np.array(hexapod.platform_rotation(alpha, beta))[:, 2], w, atol=1e-15)
    printed = hexapod.platform_rotation(np.arcsin(w[0]), np.arctan(-w[1] / w[2]))
    assert np.linalg.norm(np.array(printed)[:, 2] - w) > 0.1


def test_lengths_follow_the_audits_scalar_forms(leg, feet):
    alpha, beta = hexapod.platform_angles(feet)
    l1, l2, l3 = hexapod.inverse_kinematics(leg, feet).q
    a, b, c, e = leg.a, leg.b, leg.c, leg.e
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    np.testing.assert_allclose(l2**2, a * a + b * b + e * e - 2 * a * (e * sb + b * cb), rtol=1e-13)
    np.testing.assert_allclose(l3**2, l1**2 + a * a + c * c + 2 * a * l1 * sa * cb - 2 * a * c * ca, rtol=1e-13)


def test_foot_position_undoes_inverse_kinematics(sided, feet):
    found = hexapod.inverse_kinematics(sided, feet)
    assert (found.margin > 0).all()
    np.testing.assert_allclose(hexapod.foot_position(sided, found.q), feet, atol=1e-10)
    np.testing.assert_allclose(np.broadcast_arrays(*hexapod.closure_residual(sided, found.q)), 0.0, atol=1e-14)


@pytest.mark.parametrize("mode", hexapod.ASSEMBLY_MODES)
def test_every_assembly_mode_closes_and_has_its_own_inverse(sided, mode):
    leg = dataclasses.replace(sided, assembly_mode=mode)
    rng = np.random.default_rng(3)
    p = tuple(rng.uniform(-0.8, 0.8, (3, 4000)))
    found = hexapod.inverse_kinematics(leg, p, mode)
    inside = found.margin > 1e-6
    assert 200 < inside.sum() < 3800
    q = tuple(component[inside] for component in found.q)
    np.testing.assert_allclose(hexapod.foot_position(leg, q), [x[inside] for x in p], atol=1e-9)
    np.testing.assert_allclose(np.broadcast_arrays(*hexapod.closure_residual(leg, q)), 0.0, atol=1e-9)


def test_the_four_modes_are_four_poses_of_the_same_lengths(leg):
    q = hexapod.inverse_kinematics(leg, X).q
    legs = {mode: dataclasses.replace(leg, assembly_mode=mode) for mode in hexapod.ASSEMBLY_MODES}
    feet = {mode: np.array(hexapod.foot_position(one, q)) for mode, one in legs.items()}
    for one, other in itertools.combinations(feet.values(), 2):
        assert np.linalg.norm(one - other) > 0.05
    for mode, one in legs.items():
        np.testing.assert_allclose(hexapod.closure_residual(one, q), 0.0, atol=1e-14)
        b2, b3 = (word == "down" for word in mode.split("_")[1::2])
        u, p, w = np.array(rotation(one, q)).T
        # B2 in the plane of struts 1 and 2, which turns with alpha: its distance from the x axis, downwards.
        normal = np.cross((1.0, 0.0, 0.0), p)
        assert ((one.e * w + one.b * u) @ normal > 0) == b2
        assert (feet[mode][2] + one.c * p[2] > 0) == b3


def rotation(leg, q):
    angles = hexapod.tree_coordinates(leg, q)
    return hexapod.platform_rotation(angles["alpha1"], angles["beta1"])


def test_an_unknown_assembly_mode_is_refused(leg):
    with pytest.raises(RouteError, match="B2_down_B3_down"):
        dataclasses.replace(leg, assembly_mode="sideways")


def test_jacobians_are_inverse_to_each_other_and_to_differences(sided, feet):
    q = hexapod.inverse_kinematics(sided, feet).q
    J = np.moveaxis(np.array(hexapod.foot_jacobian(sided, q)), -1, 0)
    inverse = np.moveaxis(
        np.array([list(map(np.asarray, row)) for row in hexapod.inverse_jacobian(sided, feet)]), -1, 0
    )
    np.testing.assert_allclose(J @ inverse, np.broadcast_to(np.eye(3), J.shape), atol=1e-11)
    differences = slope(lambda p: hexapod.inverse_kinematics(sided, p).q, feet)
    np.testing.assert_allclose(np.moveaxis(differences, 1, 0), inverse, atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(inverse), hexapod.inverse_jacobian_determinant(sided, feet), rtol=1e-10)


def test_jacobian_derivative_and_bias_against_differences(sided, feet):
    q = hexapod.inverse_kinematics(sided, feet).q
    rng = np.random.default_rng(0)
    v = tuple(rng.normal(size=(3, 400)) * 0.3)

    def jacobian_at(t):
        J = hexapod.foot_jacobian(sided, tuple(x + t * rate for x, rate in zip(q, v, strict=True)))
        return np.array([[np.broadcast_to(value, 400) for value in row] for row in J])

    h = 1e-5
    numeric = (jacobian_at(-2 * h) - 8 * jacobian_at(-h) + 8 * jacobian_at(h) - jacobian_at(2 * h)) / (12 * h)
    exact = np.array([[np.broadcast_to(x, 400) for x in row] for row in hexapod.foot_jacobian_derivative(sided, q, v)])
    scale = 1 + np.abs(exact).max(axis=(0, 1))
    assert (np.abs(exact - numeric).max(axis=(0, 1)) / scale).max() < 1e-8
    bias = np.einsum("ijk,jk->ik", exact, np.array(v))
    np.testing.assert_allclose(hexapod.foot_bias_acceleration(sided, q, v), bias, atol=1e-10 * scale.max())


def test_velocity_equations_hold(sided, feet):
    q = hexapod.inverse_kinematics(sided, feet).q
    rng = np.random.default_rng(1)
    v = tuple(rng.normal(size=(3, 400)))
    residual = np.broadcast_arrays(*hexapod.velocity_residual(sided, q, v))
    v1 = hexapod.foot_velocity(sided, q, v)
    assert np.abs(residual).max() < 1e-12 * (1 + np.abs(v1).max())  # (10)-(12)
    omega = hexapod.body_motions(sided, q, v)["sleeve_1"].turning.velocity
    np.testing.assert_allclose(hexapod.platform_angular_velocity(sided, feet, v1), omega, atol=1e-10)  # (19)
    np.testing.assert_allclose(hexapod.extension_rates_of_twist(sided, feet, v1, omega), v, atol=1e-10)  # (17)
    np.testing.assert_allclose(hexapod.extension_rates(sided, feet, v1), v, atol=1e-10)  # (25)


def test_what_the_paper_leaves_out_is_not_small(leg):
    home = (0.0, 0.0, 0.715)
    row = np.array(hexapod.inverse_jacobian(leg, home))[1]
    assert row[0] == pytest.approx(-0.2687, abs=5e-5)
    _, second, _ = hexapod.strut_vectors(leg, home)
    w2 = np.array(second) / np.linalg.norm(second)
    assert -leg.b * w2[2] / 0.715 == pytest.approx(-0.0941, abs=5e-5)  # (22) as printed
    alpha_rate_spin = np.array(hexapod.platform_angular_velocity(leg, X, (0.0, 1.0, 0.0))) @ np.array(
        hexapod.platform_direction(X)
    )
    assert abs(alpha_rate_spin) > 0.4  # (19) as printed makes it zero


def test_strut_2_depends_on_beta_alone(leg):
    lengths = [
        hexapod.strut_length_2(leg, (l1 * np.sin(0.3), -l1 * np.sin(a) * np.cos(0.3), l1 * np.cos(a) * np.cos(0.3)))
        for a in (-0.7, 0.0, 0.9)
        for l1 in (0.6, 0.8)
    ]
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-14)


def test_tree_coordinates_and_coefficients(sided, feet):
    q = hexapod.inverse_kinematics(sided, feet).q
    found = hexapod.tree_coordinates(sided, q)
    assert tuple(found) == hexapod.TREE_JOINT_NAMES
    np.testing.assert_allclose((found["alpha1"], found["beta1"]), hexapod.platform_angles(feet), atol=1e-12)
    np.testing.assert_array_equal(found["alpha2"], found["alpha1"])
    coefficients = hexapod.tree_coefficients(sided, q)
    numeric = slope(lambda at: list(hexapod.tree_coordinates(sided, at).values()), q)
    for name, expected in zip(found, numeric, strict=True):
        exact = np.stack(np.broadcast_arrays(*coefficients[name], np.zeros(400))[:3], axis=-1)
        np.testing.assert_allclose(exact, expected, atol=1e-7, err_msg=name)


def test_ball_and_universal_angles_of_the_initial_pose(leg):
    q = hexapod.inverse_kinematics(leg, (0.0, 0.0, 0.715)).q
    assert hexapod.ball_angle(leg, q, 0.715) == pytest.approx(0.0, abs=1e-15)
    angles = hexapod.tree_coordinates(leg, q)
    assert np.degrees(angles["beta2"]) == pytest.approx(-16.11, abs=5e-3)
    assert np.degrees(angles["alpha3"]) == pytest.approx(11.85, abs=5e-3)
    margins = hexapod.universal_margins(leg, q, np.radians(60.0))
    assert np.degrees(min(margins)) == pytest.approx(60 - 16.11, abs=5e-3)
    assert hexapod.strut_margins(q, (0.53, 0.33, 0.53), (0.9, 0.6, 0.9)) == pytest.approx(
        (0.185, 0.6 - q[1], 0.9 - q[2])
    )


def test_condition_number_is_that_of_the_singular_values(leg, feet):
    J = hexapod.inverse_jacobian(leg, feet)
    matrices = np.moveaxis(np.array([[np.asarray(x) for x in row] for row in J]), -1, 0)
    values = np.linalg.svd(matrices, compute_uv=False)
    np.testing.assert_allclose(np.array(hexapod.singular_values(J)).T, values, rtol=1e-10)
    np.testing.assert_allclose(hexapod.condition_number(J), values[:, 0] / values[:, 2], rtol=1e-10)
    assert hexapod.condition_number(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))) == pytest.approx(1.0)
    mean, deviation = hexapod.mean_condition_number((4.0, 6.0, 6.0), (2.0, 1.0, 1.0))
    assert (mean, deviation) == pytest.approx((5.0, 1.0))


def test_named_errors_of_the_interface():
    leg = ld.load("hexapod_leg")
    with pytest.raises(BranchError) as caught:
        leg.inverse_kinematics([0.1, 0.1, -0.3], limits="ignore")
    assert caught.value.margin == pytest.approx(-0.3158, abs=1e-4)
    for point in ([0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.5, 0.9e-9, 0.0]):
        with pytest.raises(SingularityError, match="not unique") as failed:
            leg.inverse_kinematics(point)
        assert -1e-9 <= failed.value.margin < 0.0
    leg.inverse_kinematics([0.2, 2e-9, 0.6], limits="ignore")
    with pytest.raises(JointLimitError) as caught:
        leg.inverse_kinematics([0.1, 0.1, 1.3])
    assert caught.value.margin == pytest.approx(0.9 - np.linalg.norm([0.1, 0.1, 1.3]))
    with pytest.raises(NonFiniteError):
        leg.inverse_kinematics([0.1, np.nan, 0.3])
    with pytest.raises(SingularityError) as failed:
        leg.foot_position([0.7, leg.numbers["a"] + np.hypot(leg.numbers["b"], leg.numbers["e"]), 0.7])
    assert abs(failed.value.margin) < 1e-12
    rows = leg.foot_position([[0.55, 0.4, 0.9], [0.7, 0.45, 0.7]], on_error="nan")
    assert np.isnan(rows[0]).all()
    assert np.isfinite(rows[1]).all()


def test_a_branch_ends_where_b2_passes_the_x_axis():
    """h2 = e cos(beta) - b sin(beta) = 0: a foot path on either side of it, and the branch that holds the rest."""
    leg = ld.load("hexapod_leg")
    end = np.arctan2(leg.numbers["e"], leg.numbers["b"])
    inside, outside = (0.7 * np.array([np.sin(beta), 0.0, np.cos(beta)]) for beta in (end - 1e-6, end + 1e-6))
    assert np.isfinite(leg.inverse_kinematics(inside, limits="ignore")).all()
    with pytest.raises(BranchError, match=r"'B2_down_B3_down'.*B2 would lie .* beyond the x axis") as caught:
        leg.inverse_kinematics(outside, limits="ignore")
    error = caught.value
    assert isinstance(error, OutOfReachError)
    assert (error.branch, error.holding) == ("B2_down_B3_down", ("B2_up_B3_down",))
    assert error.margin == pytest.approx(-1e-6 * np.hypot(leg.numbers["e"], leg.numbers["b"]), rel=1e-6)
    q = leg.inverse_kinematics(outside, error.holding[0], limits="ignore")
    other = dataclasses.replace(leg.backend.numbers, assembly_mode=error.holding[0])
    np.testing.assert_allclose(hexapod.foot_position(other, tuple(q)), outside, atol=1e-9)
    path = 0.7 * np.array([[np.sin(beta), 0.0, np.cos(beta)] for beta in np.radians(np.linspace(40.0, 89.0, 50))])
    with pytest.raises(BranchError, match=r"8 of 50 rows failed; first row 42: branch .* 0.00669 m") as failed:
        leg.inverse_kinematics(path, limits="ignore")
    assert failed.value.rows.tolist() == list(range(42, 50))


def test_the_branch_of_another_mode_says_what_it_misses():
    leg, point = ld.load("hexapod_leg"), [0.25, 0.2, 0.65]
    with pytest.raises(BranchError, match=r"B3 would lie 0\.635 m beyond the plane of the hip's joints") as caught:
        leg.inverse_kinematics(point, "B2_down_B3_up")
    assert caught.value.holding == ("B2_down_B3_down", "B2_up_B3_down")
    for branch in caught.value.holding:
        assert np.isfinite(leg.inverse_kinematics(point, branch, limits="ignore")).all()


def test_passive_limits_hold_in_the_modes_of_other_branches():
    """Limits from the pose itself: just wide enough for every passive joint of the mode, or just too narrow for one."""
    base, point, branch = ld.load("hexapod_leg"), np.array([0.25, 0.2, 0.65]), "B2_up_B3_down"
    q = base.inverse_kinematics(point, branch, limits="ignore")
    turned = hexapod.tree_coordinates(dataclasses.replace(base.backend.numbers, assembly_mode=branch), tuple(q))
    needed = np.degrees(max(abs(value) for name, value in turned.items() if name[0] in "ab"))
    assert 150.0 < needed < 179.0
    wide = {"l2_max": 0.8, "rod_2_length": 0.5}
    for reach, fits in ((needed + 0.01, True), (needed - 0.01, False)):
        leg = ld.load("hexapod_leg", parameters={**wide, "universal_range": reach})
        if fits:
            np.testing.assert_array_equal(leg.inverse_kinematics(point, branch), q)
        else:
            with pytest.raises(JointLimitError, match=r"(alpha|beta)\d = ") as caught:
                leg.inverse_kinematics(point, branch)
            assert caught.value.margin == pytest.approx(-np.radians(0.01), abs=1e-6)
            assert np.isnan(leg.inverse_kinematics([point, point], branch, on_error="nan")).all()


def test_lengths_close_inside_their_ranges_only(leg):
    q = np.random.default_rng(4).uniform([0.3, 0.1, 0.1], [1.0, 0.9, 1.3], (20_000, 3))
    with np.errstate(invalid="ignore"):
        margins = np.min(hexapod.assembly_margins(leg, tuple(q.T)), axis=0)
        ranges = hexapod.assembly_ranges(leg, tuple(q.T))
        inside = np.all([(low <= x) & (x <= high) for x, (low, high) in zip(q.T, ranges, strict=True)], axis=0)
    assert 2000 < inside.sum() < 18_000
    assert np.array_equal(inside, margins >= 0.0)


@pytest.mark.parametrize(
    ("q", "name", "limit"),
    [
        ([0.55, 0.9, 0.6], "l2", 0.2 + np.hypot(0.07, 0.45)),
        ([0.7, 0.2, 0.7], "l2", np.hypot(0.07, 0.45) - 0.2),
        ([0.55, 0.4, 0.9], "l3", None),
        ([0.7, 0.45, 0.2], "l3", None),
        ([0.55, -0.4, 0.6], "l2", np.hypot(0.07, 0.45) - 0.2),
        ([-0.7, 0.45, 0.7], "l1", 0.0),
    ],
)
def test_lengths_that_cannot_close_are_an_assembly_error_by_every_route(q, name, limit):
    leg = ld.load("hexapod_leg")
    with pytest.raises(AssemblyError, match=f"{name} must lie in") as failed:
        leg.foot_position(q)
    error = failed.value
    value = q[int(name[1]) - 1]
    assert (error.coordinate, error.value) == (name, value)
    assert error.margin == pytest.approx(-abs(value - error.limit))
    if limit is not None:
        assert error.limit == pytest.approx(limit, abs=1e-12)
    else:
        # At the limit it closes: just inside the same lengths have a foot, with strut 3 that long.
        q[2] = error.limit + 1e-6 * np.sign(0.7 - error.limit)
        assert np.isfinite(leg.foot_position(q)).all()
        q[2] = value
    for route in ("pinocchio", "symbolic"):
        with pytest.raises(AssemblyError):
            ld.load("hexapod_leg", route=route).foot_position(q)


def test_a_batch_names_each_kind_of_row():
    leg = ld.load("hexapod_leg")
    q = np.array([[0.7, 0.45, 0.7], [0.7, 0.8, 0.7], [0.7, 0.2 + np.hypot(0.07, 0.45), 0.7], [0.7, 0.45, 1.2]])
    with pytest.raises(AssemblyError, match="2 with AssemblyError, the rest with SingularityError") as failed:
        leg.torque(q, np.zeros(3), np.zeros(3))
    assert failed.value.rows.tolist() == [1, 3]
    assert failed.value.all_rows.tolist() == [1, 2, 3]
    assert (failed.value.margin < 0.0).all()
    assert np.isnan(leg.foot_position(q, on_error="nan")).any(axis=1).tolist() == [False, True, True, True]
