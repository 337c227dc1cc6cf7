"""Next to singular poses of the closure: what is returned keeps its nine digits, what cannot keep them is refused."""

from __future__ import annotations

import math
import pickle
import warnings

import mpmath
import numpy as np
import pinocchio as pin
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse
from leg_dynamics.errors import LegDynamicsWarning, RowFailures, SingularityError
from leg_dynamics.mechanism.mechanism import DOUBTFUL_INVERSE, PROMISED, Mechanism
from leg_dynamics.verification.states import domain, sample_states

FAST = np.array([5.0])
PUSH = np.array([50.0])


def tree_inverse(mechanism, q, qd, qdd, G):
    """G^T rnea by a model and data of its own."""
    model = mechanism.tree.model.copy()
    model.gravity.linear = mechanism.hip_rotation @ mechanism.gravity
    return G.T @ pin.rnea(model, model.createData(), mechanism.tree.to_configuration(q), qd, qdd)


def exact_parallelogram(mechanism, theta, v, a):
    """Angles are (theta, -theta, theta), so that G is constant and g is zero."""
    values = {"crank": 1.0, "coupler": -1.0, "rocker": 1.0}
    G = np.array([[values[name]] for name in mechanism.tree.joint_names])
    return tree_inverse(mechanism, G[:, 0] * theta, G @ v, G @ a, G)


def exact_four_bar(mechanism, linkage, theta, v, a):
    """Angles and their derivatives with 50 digits, by circle intersection."""
    with mpmath.workdps(50):
        ground, crank, coupler, rocker = map(
            mpmath.mpf, (linkage.ground, linkage.crank, linkage.coupler, linkage.rocker)
        )

        def angles(theta):
            x, y = ground - crank * mpmath.cos(theta), -crank * mpmath.sin(theta)
            distance = mpmath.sqrt(x * x + y * y)
            along = (coupler**2 - rocker**2 + distance**2) / (2 * distance)
            height = mpmath.sqrt(coupler**2 - along**2)
            mx, my = (along * x - height * y) / distance, (along * y + height * x) / distance
            return mpmath.atan2(my, mx) - theta, mpmath.atan2(my - y, mx - x)

        at = mpmath.mpf(float(theta))
        functions = {"coupler": lambda t: angles(t)[0], "rocker": lambda t: angles(t)[1], "crank": lambda t: t}
        h = mpmath.mpf(10) ** -16
        q, G, rate = [], [], []
        for name in mechanism.tree.joint_names:
            f = functions[name]
            q.append(float(f(at)))
            G.append(float((f(at + h) - f(at - h)) / (2 * h)))
            rate.append(float((f(at + h) - 2 * f(at) + f(at - h)) / h**2))
    G = np.array(G)[:, None]
    return tree_inverse(mechanism, np.array(q), G @ v, G @ a + np.array(rate) * v[0] ** 2, G)


def sweep(route, thetas, v, exact):
    """For each pose: error of the torque, infinite where it was refused, and its estimate."""
    mechanism = route.mechanism
    errors, estimates = [], []
    for theta in thetas:
        y = np.array([theta])
        expected = exact(theta)
        state = mechanism.close(y)

        def torque(state):
            return mechanism.generalized_force(state, v, PUSH)

        value = torque(state)
        estimates.append(mechanism.rounding_error(state, value, torque))
        failures = RowFailures()
        got = route.generalized_force(y, v, PUSH, None, None, failures)
        assert bool(failures) == bool(np.isnan(got).any()) == (estimates[-1] > PROMISED)
        error = np.abs(value - expected).max() / (1.0 + np.abs(expected).max())
        errors.append((error, bool(failures)))
    return np.array([e for e, _ in errors]), np.array([r for _, r in errors]), np.array(estimates)


GAPS = np.geomspace(1e-1, 1e-6, 41)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_where_modes_cross_results_are_good_to_nine_digits_or_refused(lab, sign):
    route = ld.load(lab.PARALLELOGRAM.text(0.8 * sign, sign).xml).backend
    exact = lambda theta: exact_parallelogram(route.mechanism, theta, FAST, PUSH)  # noqa: E731
    error, refused, _ = sweep(route, sign * GAPS, FAST, exact)
    assert error[~refused].max() <= PROMISED
    assert refused[GAPS < 2e-3].all()
    assert not refused[GAPS > 2e-2].any()
    # The limit is needed: beyond it digits are really lost.
    assert error[refused].max() > 1e-3


def test_at_a_dead_centre_results_are_good_to_nine_digits_or_refused(lab):
    linkage = lab.FourBar(ground=0.4, crank=0.3, coupler=0.25, rocker=0.2)
    reach = math.acos((0.3**2 + 0.4**2 - 0.45**2) / (2 * 0.3 * 0.4))
    route = ld.load(linkage.text(0.9).xml).backend
    gaps = np.geomspace(1e-1, 3e-9, 41)
    exact = lambda theta: exact_four_bar(route.mechanism, linkage, theta, FAST, PUSH)  # noqa: E731
    error, refused, estimate = sweep(route, reach - gaps, FAST, exact)
    assert error[~refused].max() <= PROMISED
    assert not refused[gaps > 1e-5].any()
    assert refused[gaps < 1e-8].all()
    # A bound of the error, and not an idle one.
    doubtful = estimate > 1e-13
    assert doubtful.sum() > 10
    assert (error[doubtful] < 3.0 * estimate[doubtful]).all()
    assert (error[doubtful] > 0.1 * estimate[doubtful]).any()


def test_the_error_says_value_limit_margin_and_what_to_do(lab):
    leg = ld.load(lab.PARALLELOGRAM.text(0.8).xml)
    with pytest.raises(SingularityError) as caught:
        leg.torque([1e-3], FAST, PUSH)
    error = caught.value
    assert error.limit == PROMISED < error.error < 1e-3
    np.testing.assert_allclose(error.margin, error.limit - error.error)
    assert error.smallest_singular_value == pytest.approx(3.7e-4, rel=0.02)
    for words in ("crank = 0.001", f"{error.error:.3g}", "1e-09", "move away", "lower speed"):
        assert words in str(error)
    again = pickle.loads(pickle.dumps(error))
    assert (again.error, again.limit) == (error.error, error.limit)


def test_each_result_has_its_own_limit(lab):
    """Poses are known better than velocities, and these better than accelerations; slow motions better than fast."""
    leg = ld.load(lab.PARALLELOGRAM.text(0.8).xml, foot="coupler_link")
    y = np.array([2e-3])
    assert leg.assemble(y)["rocker"] == pytest.approx(2e-3, abs=1e-9)
    assert np.isfinite(leg.mass_matrix(y)).all()
    assert np.isfinite(leg.torque(y, 0.1 * FAST, PUSH)).all()
    with pytest.raises(SingularityError):
        leg.bias(y, FAST)
    nearer = np.array([1e-5])
    assert leg.assemble(nearer)["rocker"] == pytest.approx(1e-5, abs=1e-9)
    with pytest.raises(SingularityError):
        leg.mass_matrix(nearer)
    # The coupler starts at the crank's end: no loop moves that point.
    centripetal = leg.foot_acceleration(nearer, FAST, 0.0 * PUSH)
    np.testing.assert_allclose(np.linalg.norm(centripetal), 0.2 * 25.0, rtol=1e-9)


def test_a_refused_row_leaves_the_others_alone(lab):
    leg = ld.load(lab.PARALLELOGRAM.text(0.8).xml)
    y = np.array([[0.5], [1e-4], [0.05], [2e-3]])
    tau = leg.torque(y, FAST, PUSH, on_error="nan")
    assert np.isnan(tau[:, 0]).tolist() == [False, True, False, True]
    with pytest.raises(SingularityError) as caught:
        leg.torque(y, FAST, PUSH)
    assert caught.value.rows.tolist() == [1, 3]
    np.testing.assert_allclose(tau[2], leg.torque(y[2], FAST, PUSH), rtol=1e-9)


def test_loop_forces_are_refused_too(lab):
    route = ld.load(lab.PARALLELOGRAM.text(0.8).xml).backend
    assert route.loop_forces(np.array([0.05]), FAST, PUSH).wrenches
    with pytest.raises(SingularityError, match="rounding"):
        route.loop_forces(np.array([1e-4]), FAST, PUSH)


def test_the_way_to_a_nearly_singular_pose_does_not_show(lab):
    """Rounding decides what is left: the pose is the same from either side and from afar."""
    mechanism = Mechanism(parse(lab.PARALLELOGRAM.text(0.8).xml))
    y = np.array([0.02])
    values = []
    for before in (0.8, 0.3, 0.021, 0.02 + 1e-9, 0.019, 0.012):
        mechanism.forget(every_pose=True)
        mechanism.close(np.array([before]))
        values.append(mechanism.generalized_force(mechanism.close(y), FAST, PUSH))
    assert np.ptp(values) < 1e-9


def test_moves_of_the_pose_are_those_of_its_small_singular_values(lab):
    """The estimate is first order in each direction: half a residual's noise moves the result half as far."""
    mechanism = Mechanism(parse(lab.parallelogram(0.8, 2).xml))
    state = mechanism.close(np.array([0.01]))
    assert (mechanism.singular_values(state) * DOUBTFUL_INVERSE < 1.0).sum() == 2
    moved = []

    def pose(state):
        moved.append(state)
        return state.q

    error = mechanism.rounding_error(state, state.q, pose)
    assert len(moved) == 2
    assert 1e-15 < error < 1e-12
    for each in moved:
        assert each.y == state.y
        assert each.residual < 1e-14


def test_no_estimate_where_it_is_not_needed(omnileg, omnileg_box):
    calls = []
    for y in np.random.default_rng(0).uniform(*omnileg_box, (20, 3)):
        state = omnileg.close(y)
        assert not omnileg.doubtful(state)
        assert omnileg.inverse_norm(state) >= 1.0 / omnileg.singular_values(state)[-1]
        assert omnileg.rounding_error(state, state.q, calls.append) == 0.0
    assert calls == []


def test_a_tree_is_never_doubtful(lab):
    mechanism = Mechanism(parse(lab.open_chain().xml))
    state = mechanism.close(np.zeros(mechanism.n))
    assert mechanism.inverse_norm(state) == 0.0
    assert not mechanism.doubtful(state)


@pytest.mark.parametrize("name", ["omnileg", "hexapod_leg"])
def test_the_shipped_legs_lose_no_pose_of_their_box(name):
    formulas, numeric = ld.load(name), ld.load(name, route="pinocchio")
    states = sample_states(domain(formulas), 300, 3, formulas.units.joints)
    expected = formulas.torque(states.q, states.v, states.a, on_error="nan")
    found = numeric.torque(states.q, states.v, states.a, on_error="nan")
    known = np.isfinite(expected).all(axis=1)
    assert known.sum() > 150
    error = np.abs(found - expected)[known] / (1.0 + np.abs(expected[known]).max(axis=1, keepdims=True))
    assert error.max() < PROMISED


@pytest.mark.parametrize("gap", [1e-2, 1e-3, 1e-4, 1e-5, 3e-6])
def test_the_hexapod_leg_keeps_the_edge_of_its_reach(gap):
    """At a dead centre everything grows, and what rounding adds grows no faster than its square."""
    formulas, numeric = ld.load("hexapod_leg"), ld.load("hexapod_leg", route="pinocchio")
    home = numeric.backend.mechanism.seeds[0].y
    direction = np.array([-1.0, -0.3, 0.0])
    low, high = 0.0, 0.6
    for _ in range(50):
        middle = 0.5 * (low + high)
        inside = np.isfinite(formulas.foot_position(home + middle * direction, on_error="nan")).all()
        low, high = (middle, high) if inside else (low, middle)
    y = home + (low - gap) * direction
    v, a = np.array([1.0, -0.5, 0.7]), np.array([5.0, 3.0, -8.0])
    expected, found = formulas.torque(y, v, a), numeric.torque(y, v, a)
    assert np.abs(found - expected).max() < PROMISED * (1.0 + np.abs(expected).max())


def test_a_multi_start_keeps_away_from_singular_poses(lab):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        seed = Mechanism(parse(lab.PARALLELOGRAM.text(home=False).xml)).seeds[0]
    assert seed.smallest_pivot > 0.02


def test_a_route_tells_its_singular_values_and_rounding_errors(lab):
    route = ld.load(lab.PARALLELOGRAM.text(0.8).xml, foot="coupler_link").backend
    y = np.array([[0.5], [0.01], [1e-4], [-0.5]])
    failures = RowFailures()
    sigma = route.smallest_singular_values(y, failures)
    assert failures.rows.tolist() == [3]
    assert np.isnan(sigma).tolist() == [False, False, False, True]
    np.testing.assert_allclose(sigma[1:3] / y[1:3, 0], 0.371, rtol=0.01)
    errors = route.rounding_errors(y, np.full((4, 1), 5.0), np.full((4, 1), 50.0))
    assert errors[0] == 0.0
    assert 1e-10 < errors[1] < 1e-6 < errors[2]
    assert np.isnan(errors[3])
    assert (route.rounding_errors(y, np.full((4, 1), 0.5), np.full((4, 1), 50.0))[1:3] < 0.1 * errors[1:3]).all()
