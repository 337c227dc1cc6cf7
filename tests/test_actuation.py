"""Verdicts on actuation, efforts that are not unique or not enough, and what actuators can do."""

from __future__ import annotations

import itertools
import json
import math
import pickle
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

import leg_dynamics as ld
from leg_dynamics.actuation import Actuation, Policy, _Share, actuation_of, feasibility
from leg_dynamics.errors import (
    ActuationError,
    DescriptionError,
    EffortLimitError,
    NonFiniteError,
    ParameterError,
    RowFailures,
    ShapeError,
    SingularityError,
)

from .five_bar import five_bar

ROUTES = ("pinocchio", "symbolic")


STATE = np.array([1.9, 1.1]), np.array([0.7, -0.4]), np.array([3.0, 2.0])


@pytest.mark.parametrize("route", ROUTES)
def test_rates_of_the_actuated_joints_by_differences(route):
    leg = ld.load(five_bar(("ma", "ka", "mb", "kb")), route=route)
    q, h = STATE[0], 1e-6
    A = leg.actuator_jacobian(q)
    for column, direction in enumerate(np.eye(2)):
        ahead, behind = leg.assemble(q + h * direction), leg.assemble(q - h * direction)
        rates = [(ahead[name] - behind[name]) / (2 * h) for name in ("ma", "ka", "mb", "kb")]
        np.testing.assert_allclose(A[:, column], rates, atol=1e-8)
    assert leg.actuator_jacobian(np.array([q, q])).shape == (2, 4, 2)


def test_verdicts():
    assert ld.load("omnileg").actuation.kind == "exact"
    both = ld.load(five_bar())
    assert both.actuation == ld.load(five_bar(), route="symbolic").actuation
    assert (both.actuation.kind, both.actuation.idle, both.actuation.preload) == ("exact", (), 0)
    three = ld.load(five_bar(("ma", "mb", "ka"))).actuation
    assert (three.kind, three.preload, three.redundant) == ("redundant", 1, ("M_ma", "M_mb", "M_ka"))
    assert "can work against each other in 1 way (2 motions, 3 actuators)" in str(three)
    one = ld.load(five_bar(("mb",))).actuation
    assert (one.kind, one.idle) == ("under-actuated", ("ma",))
    assert one.to_dict()["idle"] == ["ma"]


def test_two_motors_on_one_motion_leave_the_other_idle():
    A = np.array([[[1.0, 0.0], [2.0, 0.0]]])
    verdict = actuation_of(A, ("x", "y"), ("x", "z"), ("X", "Z"))
    assert (verdict.kind, verdict.rank, verdict.idle, verdict.redundant) == (
        "idle and redundant",
        1,
        ("y",),
        ("X", "Z"),
    )
    assert "no actuator holds y" in str(verdict)
    assert "work against each other" in str(verdict)
    no_pose = actuation_of(np.full((1, 1, 2), np.nan), ("x", "y"), ("x",), ("X",))
    assert no_pose.idle == ("x", "y")


@pytest.mark.parametrize("route", ROUTES)
def test_redundant_efforts_are_the_smallest_that_balance_the_work(route):
    leg = ld.load(five_bar(("ma", "mb", "ka", "kb")), route=route)
    tau, force, A = leg.torque(*STATE), leg.generalized_force(*STATE), leg.actuator_jacobian(STATE[0])
    np.testing.assert_allclose(A.T @ tau, force, atol=1e-10)
    np.testing.assert_allclose(tau, np.linalg.pinv(A.T) @ force, atol=1e-10)
    exact = ld.load(five_bar(), route=route).torque(*STATE)
    np.testing.assert_allclose(exact, force, atol=1e-10)
    assert np.linalg.norm(tau) < np.linalg.norm(exact)


def optimum(A, force, weights, preload, lower=None, upper=None):
    """The same optimum by a general method."""
    m = len(weights)
    bounds = None if lower is None else list(zip(lower, upper, strict=True))
    constraint = {"type": "eq", "fun": lambda tau: A.T @ tau - force, "jac": lambda tau: A.T}
    start = np.linalg.pinv(A.T) @ force
    found = minimize(
        lambda tau: float(weights @ (tau - preload) ** 2),
        start if bounds is None else np.clip(start, lower, upper),
        jac=lambda tau: 2.0 * weights * (tau - preload),
        constraints=[constraint],
        bounds=bounds,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert found.success, found.message
    assert len(found.x) == m
    return found.x


def test_weights_preload_and_bounds_against_a_general_optimiser():
    leg = ld.load(five_bar(("ma", "mb", "ka", "kb")))
    force, A = leg.generalized_force(*STATE), leg.actuator_jacobian(STATE[0])
    weights, preload = np.array([1.0, 4.0, 0.5, 2.0]), np.array([2.0, -1.0, 3.0, 0.5])
    weighted = leg.torque(*STATE, weights=weights, preload=preload)
    np.testing.assert_allclose(weighted, optimum(A, force, weights, preload), atol=1e-6)
    tight = 0.8 * np.abs(weighted).max()
    upper = np.full(4, tight)
    bounded = leg.torque(*STATE, weights=weights, preload=preload, bounds=upper)
    np.testing.assert_allclose(bounded, optimum(A, force, weights, preload, -upper, upper), atol=1e-6)
    np.testing.assert_allclose(A.T @ bounded, force, atol=1e-9)
    assert np.abs(bounded).max() <= tight * (1 + 1e-9)
    assert np.abs(weighted).max() > tight
    one_sided = leg.torque(*STATE, bounds=(np.zeros(4) - 50.0, np.array([0.0, 50.0, 50.0, 50.0])))
    assert one_sided[0] <= 1e-9
    np.testing.assert_allclose(A.T @ one_sided, force, atol=1e-9)


def test_bounds_that_are_wide_change_nothing():
    leg = ld.load(five_bar(("ma", "mb", "ka")))
    np.testing.assert_array_equal(leg.torque(*STATE, bounds=True), leg.torque(*STATE))


def test_bounds_that_are_not_enough_say_how_much_is():
    leg = ld.load(five_bar(("ma", "mb", "ka")))
    A, force = leg.actuator_jacobian(STATE[0]), leg.generalized_force(*STATE)
    with pytest.raises(EffortLimitError, match="times the bounds are needed") as caught:
        leg.torque(*STATE, bounds=[0.01, 0.01, 0.01])
    times = caught.value.needed
    assert caught.value.margin[0] == pytest.approx(1.0 - times)
    # With just so much it goes, and with a little less it does not.
    tau = leg.torque(*STATE, bounds=np.full(3, 0.01 * times * (1 + 1e-6)))
    np.testing.assert_allclose(A.T @ tau, force, atol=1e-7)
    with pytest.raises(EffortLimitError):
        leg.torque(*STATE, bounds=np.full(3, 0.01 * times * (1 - 1e-3)))
    rows = leg.torque(*(np.array([x, x]) for x in STATE), bounds=[0.01, 0.01, 0.01], on_error="nan")
    assert np.isnan(rows).all()


def test_bounds_of_an_exactly_actuated_leg():
    leg = ld.load(five_bar(effort=0.5))
    with pytest.raises(EffortLimitError) as caught:
        leg.torque(*STATE, bounds=True)
    assert caught.value.needed == pytest.approx(np.abs(leg.torque(*STATE)).max() / 0.5, rel=1e-6)


def test_bounds_of_the_file_hold_at_both_ends():
    q, v, a = STATE
    motors = ("ma", "mb", "ka")
    free = ld.load(five_bar(motors))
    wish, A = free.torque(q, v, a), free.actuator_jacobian(q)
    lower, upper = 1.5 * wish.min(), 0.9 * wish.max()
    assert -lower > 2.0 * upper > 0.0
    leg = ld.load(five_bar(motors, effort=upper, effort_lower=lower))
    tau = leg.torque(q, v, a, bounds=True)
    np.testing.assert_array_equal(tau, leg.torque(q, v, a, bounds=(np.full(3, lower), np.full(3, upper))))
    np.testing.assert_allclose(A.T @ tau, A.T @ wish, atol=1e-9)
    assert (tau >= lower * (1.0 + 1e-9)).all()
    assert (tau <= upper * (1.0 + 1e-9)).all()
    assert leg.feasible(q, v, a, bounds=True)
    assert not leg.feasible(q, v, a)
    # One end alone is enough of a limit.
    one_sided = Policy.of(3, (np.full(3, lower), np.full(3, np.inf)), bounds=True)
    assert (one_sided.lower.tolist(), one_sided.upper.tolist()) == ([lower] * 3, [math.inf] * 3)


def test_preload_keeps_only_what_does_no_work():
    leg = ld.load(five_bar(("ma", "mb", "ka")))
    A = leg.actuator_jacobian(STATE[0])
    null = np.linalg.svd(A.T)[2][-1]
    tau = leg.torque(*STATE)
    np.testing.assert_allclose(leg.torque(*STATE, preload=5.0 * null), tau + 5.0 * null, atol=1e-9)
    np.testing.assert_allclose(leg.torque(*STATE, preload=A @ np.array([3.0, 1.0])), tau, atol=1e-9)
    many = leg.torque(*(np.array([x, x]) for x in STATE), preload=np.array([0.0 * null, 5.0 * null]))
    np.testing.assert_allclose(many[1] - many[0], 5.0 * null, atol=1e-9)


def test_a_preload_whose_digits_do_not_hold_the_motion_is_refused():
    leg = ld.load(five_bar(("ma", "mb", "ka")))
    A, force = leg.actuator_jacobian(STATE[0]), leg.generalized_force(*STATE)
    null = np.linalg.svd(A.T)[2][-1]
    size = 1.0 + np.abs(force).max()
    for scale in (1.0, 1e3, 1e6):
        tau = leg.torque(*STATE, preload=scale * null)
        assert np.abs(A.T @ tau - force).max() <= 1e-8 * size
    for huge in (1e9, 1e12, 1e17, 1e300, 1.7e308):
        with pytest.raises(NonFiniteError, match="is too large for the motion's part") as caught:
            leg.torque(*STATE, preload=[huge] * 3)
        assert not caught.value.margin[0] >= 0.0
    usable = float(str(caught.value).rsplit(" ", 1)[1])
    assert np.isfinite(leg.torque(*STATE, preload=usable * null)).all()
    bounded = leg.torque(*STATE, preload=[1e8] * 3, bounds=[50.0] * 3)
    np.testing.assert_allclose(A.T @ bounded, force, atol=1e-9)
    states = [np.array([x, x]) for x in STATE]
    some = leg.torque(*states, preload=[[1.0] * 3, [1e17] * 3], on_error="nan")
    assert np.isfinite(some[0]).all()
    assert np.isnan(some[1]).all()


@pytest.mark.parametrize("route", ROUTES)
def test_idle_motions_are_named_or_left_unbalanced(route):
    leg = ld.load(five_bar(("mb",)), route=route)
    with pytest.raises(
        ActuationError, match=r"no actuator holds ma \(2 motions, 1 actuators on mb\).*allow_idle=True"
    ) as e:
        leg.torque(*STATE)
    assert e.value.idle == ("ma",)
    tau, residual = leg.torque(*STATE, allow_idle=True)
    force = leg.generalized_force(*STATE)
    np.testing.assert_allclose(tau, force[1:], atol=1e-12)
    np.testing.assert_allclose(residual, [force[0], 0.0], atol=1e-12)
    # An actuator on a dependent joint acts on the idle coordinate as well.
    other = ld.load(five_bar(("kb",)), route=route)
    assert other.actuation.idle in (("ma",), ("mb",))
    tau, residual = other.torque(*STATE, allow_idle=True)
    A = other.actuator_jacobian(STATE[0])
    np.testing.assert_allclose(A.T @ tau + residual, force, atol=1e-10)
    assert np.count_nonzero(residual) == 1


def test_an_exact_leg_has_no_residual():
    leg = ld.load("omnileg")
    q = np.array([0.1, 0.2, 0.3])
    found = leg.torque(q, 0 * q, 0 * q, allow_idle=True)
    np.testing.assert_allclose(found.torque, leg.torque(q, 0 * q, 0 * q), atol=1e-14)
    assert not found.residual.any()


def test_out_receives_shared_efforts():
    leg = ld.load(five_bar(("ma", "mb", "ka")))
    out = np.empty(3)
    assert leg.torque(*STATE, out=out) is out
    np.testing.assert_array_equal(out, leg.torque(*STATE))
    with pytest.raises(ShapeError, match="out must be"):
        leg.torque(*STATE, out=np.empty(2))


def test_actuators_that_lose_a_motion_at_a_pose():
    """Motors on both knees hold nothing in a direction where both knees stand still."""
    A = np.array([[[1.0, 0.0], [0.0, 0.0]]])
    verdict = actuation_of(np.array([np.eye(2)]), ("x", "y"), ("x", "y"), ("X", "Y"))
    failures = RowFailures()
    policy = Policy.of(2, free_of(2))
    tau, _ = policy.efforts(A, np.array([[1.0, 1.0]]), verdict, ("x", "y"), failures)
    assert np.isnan(tau).all()
    error = failures.combined(None)
    assert isinstance(error, SingularityError)
    assert (error.kind, error.direction) == ("parallel", {"x": 0.0, "y": 1.0})


def test_a_motion_that_the_only_actuator_loses():
    """One held motion: the limit is an absolute one, whatever the weight."""
    leg = ld.load(five_bar(("kb",)))
    assert (leg.joint_names, leg.actuation.idle) == (("ma", "mb"), ("ma",))

    def rate(ma):
        return leg.actuator_jacobian([ma, 1.1])[0, 1]

    q = np.array([brentq(rate, 0.4, 0.6, xtol=1e-15), 1.1])
    assert abs(rate(q[0])) < 1e-9
    for weight in (1e-12, 1.0, 1e12):
        with pytest.raises(SingularityError, match="the limit is 1e-07") as caught:
            leg.torque(q, STATE[1], STATE[2], weights=[weight], allow_idle=True)
        assert abs(caught.value.margin[0]) < 1e-7


@pytest.mark.parametrize(("least", "held"), [(1e-12, False), (0.9e-7, False), (1.1e-7, True), (1e-3, True)])
@pytest.mark.parametrize("weights", [[1.0, 1.0, 1.0], [1e6, 1e-6, 1.0], [1e-6, 1e6, 1e-6]])
def test_weights_do_not_decide_what_is_held(least, held, weights):
    B = np.array([[1.0, 0.0, 0.0], [0.0, least, 0.0]])
    tau, error = efforts_of(Policy.of(3, free_of(3), weights), B, np.array([1.0, 1.0]))
    assert (error is None) == held
    if held:
        np.testing.assert_allclose(tau, [1.0, 1.0 / least, 0.0], rtol=1e-9)
    else:
        assert isinstance(error, SingularityError)


# ------------------------------------------------------------------------------------- bounded efforts, at any scale


def efforts_of(policy, B, force):
    """Efforts with B @ efforts = force, and the error where there are none."""
    n, m = B.shape
    verdict = Actuation("redundant", n, m, n, m - n, (), ())
    failures = RowFailures()
    tau, _ = policy.efforts(B.T[None], force[None], verdict, [f"y{k}" for k in range(n)], failures)
    return tau[0], failures.combined(None) if failures else None


def solved(matrix, right):
    """Gauss-Jordan elimination in rational numbers; None for a singular matrix."""
    rows = [[*row, x] for row, x in zip(matrix, right, strict=True)]
    for c in range(len(rows)):
        pivot = next((k for k in range(c, len(rows)) if rows[k][c]), None)
        if pivot is None:
            return None
        rows[c], rows[pivot] = rows[pivot], rows[c]
        rows[c] = [x / rows[c][c] for x in rows[c]]
        for k in range(len(rows)):
            if k != c and rows[k][c]:
                rows[k] = [x - rows[k][c] * y for x, y in zip(rows[k], rows[c], strict=True)]
    return [row[-1] for row in rows]


def exact_optimum(B, force, weights, preload, lower, upper):
    """The optimum in rational numbers, of all choices of active bounds the one that proves optimal; None without."""
    n, m = B.shape
    columns = [[Fraction(x) for x in column] for column in B.T.tolist()]
    force, weights, preload = ([Fraction(x) for x in values.tolist()] for values in (force, weights, preload))
    sides = [[Fraction(x) if math.isfinite(x) else None for x in side.tolist()] for side in (lower, upper)]
    for count in range(m - n + 1):
        for active in itertools.combinations(range(m), count):
            loose = [i for i in range(m) if i not in active]
            gram = [
                [sum(columns[i][a] * columns[i][b] / weights[i] for i in loose) for b in range(n)] for a in range(n)
            ]
            for chosen in itertools.product((0, 1), repeat=count):
                tau = list(preload)
                for i, side in zip(active, chosen, strict=True):
                    tau[i] = sides[side][i]
                if None in tau:
                    continue
                price = solved(gram, [force[a] - sum(columns[i][a] * tau[i] for i in range(m)) for a in range(n)])
                if price is None:
                    break
                pull = [sum(x * y for x, y in zip(column, price, strict=True)) for column in columns]
                for i in loose:
                    tau[i] += pull[i] / weights[i]
                inside = all(
                    (low is None or x >= low) and (high is None or x <= high)
                    for x, low, high in zip(tau, *sides, strict=True)
                )
                if inside and all(
                    (weights[i] * (tau[i] - preload[i]) - pull[i]) * (1 - 2 * side) >= 0
                    for i, side in zip(active, chosen, strict=True)
                ):
                    return np.array([float(x) for x in tau])
    return None


def random_problem(random, mixed, weighted):
    n = int(random.integers(1, 4))
    m = n + int(random.integers(0, 3))
    B = random.normal(size=(n, m))
    B[random.random(B.shape) < 0.2 * (random.random() < 0.5)] = 0.0
    if np.linalg.svd(B, compute_uv=False)[-1] < 1e-2:
        return random_problem(random, mixed, weighted)
    unit = 10.0 ** random.uniform(-9.0, 6.0) * (10.0 ** random.uniform(-3.0, 3.0, m) if mixed else np.ones(m))
    weights = 10.0 ** random.uniform(-6.0, 6.0, m) if weighted else np.ones(m)
    if random.random() < 0.5:
        lower, upper = -unit * random.uniform(0.2, 1.5, m), unit * random.uniform(0.2, 1.5, m)
    else:
        lower, upper = np.sort(unit * random.uniform(-1.2, 1.2, (2, m)), axis=0)
    lower[random.random(m) < 0.1] = -np.inf
    upper[random.random(m) < 0.1] = np.inf
    preload = unit * random.normal(size=m) * (random.random() < 0.4)
    # Inside by more than rounding, or the rational numbers would see no solution.
    within = 0.01 * np.minimum(unit, upper - lower)
    wanted = np.clip(unit * random.uniform(-1.0, 1.0, m), lower + within, upper - within)
    return B, B @ wanted * random.choice([1.0, 2.0, 4.0]), weights, preload, lower, upper


def check_optimal(tau, best, B, force, lower, upper):
    balance = np.abs(B @ tau - force)
    assert (balance <= 1e-12 * (np.abs(force) + np.abs(B) @ np.abs(tau))).all()
    for beyond, bound in ((lower - tau, lower), (tau - upper, upper)):
        finite = np.isfinite(bound)
        assert (beyond[finite] <= 1e-9 * np.abs(bound[finite]) + 1e-14 * np.abs(tau).max()).all()
    np.testing.assert_allclose(tau, best, rtol=0.0, atol=1e-9 * np.abs(best).max())


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("weighted", [False, True])
def test_bounded_efforts_are_the_exact_optimum_at_any_scale(mixed, weighted, monkeypatch):
    random = np.random.default_rng([7, mixed, weighted])
    problems = [random_problem(random, mixed, weighted) for _ in range(75)]
    best = [exact_optimum(*problem) for problem in problems]
    assert 15 < sum(each is None for each in best) < 60
    # By the quadratic program first, and by the active-set method alone.
    for _ in range(2):
        for (B, force, weights, preload, lower, upper), each in zip(problems, best, strict=True):
            policy = Policy.of(len(weights), (lower, upper), weights, (lower, upper), preload)
            tau, error = efforts_of(policy, B, force)
            if each is None:
                assert np.isnan(tau).all()
                assert isinstance(error, EffortLimitError)
                assert error.needed > 1.0
            else:
                assert error is None
                check_optimal(tau, each, B, force, lower, upper)
        monkeypatch.setattr(_Share, "_by_interior", lambda share, free: None)


def test_the_quadratic_program_agrees_with_the_active_set_method(monkeypatch):
    """With weights near each other it does find the active bounds."""
    random = np.random.default_rng(3)
    by_interior, answers = _Share._by_interior, []

    def recorded(share, free):
        found = by_interior(share, free)
        if found is not None:
            answers.append(found)
            np.testing.assert_allclose(found, share._by_active_set(free), rtol=0.0, atol=1e-12 * np.abs(found).max())
        return found

    monkeypatch.setattr(_Share, "_by_interior", recorded)
    for _ in range(100):
        B, force, weights, preload, lower, upper = random_problem(random, False, False)
        efforts_of(Policy.of(len(weights), (lower, upper), weights, (lower, upper), preload), B, force)
    assert len(answers) > 10


def test_a_small_leg_on_a_strong_lift():
    """Efforts of 1e-8 beside others of 1e4, also where rounding couples the two."""
    small = np.array([[0.8, -0.3, 0.5], [0.2, 0.9, -0.4]]), np.array([0.9e-8, 1.1e-8]), np.full(3, 1.5e-8)
    strong = np.array([[1.0, 0.7]]), np.array([2.1e4]), np.array([1.1e4, 2e4])
    alone = [
        exact_optimum(B, force, np.ones(len(limit)), np.zeros(len(limit)), -limit, limit)
        for B, force, limit in (small, strong)
    ]
    for dust in (0.0, 1e-17):
        B = np.full((3, 5), dust)
        B[:2, :3], B[2:, 3:] = small[0], strong[0]
        force = np.concatenate([small[1] + dust * alone[1].sum(), strong[1]])
        for order in ([0, 1, 2, 3, 4], [3, 0, 4, 2, 1]):
            limit = np.concatenate([small[2], strong[2]])[order]
            tau, error = efforts_of(Policy.of(5, (-limit, limit), bounds=True), B[:, order], force)
            assert error is None
            assert (np.abs(B[:, order] @ tau - force) <= 1e-12 * np.abs(force)).all()
            np.testing.assert_allclose(tau, np.concatenate(alone)[order], rtol=1e-12)
            # The small one cannot, and is not hidden by the strong one.
            limit = np.concatenate([0.5 * small[2], strong[2]])[order]
            tau, error = efforts_of(Policy.of(5, (-limit, limit), bounds=True), B[:, order], force)
            _, apart = efforts_of(Policy.of(3, free_of(3), bounds=0.5 * small[2]), *small[:2])
            assert np.isnan(tau).all()
            assert error.needed == pytest.approx(apart.needed, rel=1e-9)


def test_an_optimum_between_weights_that_differ_much():
    leg = ld.load(five_bar(("ma", "mb", "ka", "kb")))
    state = [1.9, 1.1], [0.46219779, 0.90619581], [6.02951137, -0.41268135]
    weights = np.array([0.04673735, 2.81286622, 18.48985078, 26.13750982])
    lower = np.array([-0.4887706583274258, -0.8583999064710289, -0.712459577855272, -0.5130592350917185])
    upper = np.array([0.5740669384782291, 0.8691248984080703, 0.8470099938712355, 0.8585553476441304])
    tau = leg.torque(*state, weights=weights, bounds=(lower, upper))
    np.testing.assert_allclose(tau, [0.574067, -0.855760, -0.712460, 0.638344], atol=1e-5)
    B, force = leg.actuator_jacobian(state[0]).T, leg.generalized_force(*state)
    check_optimal(tau, exact_optimum(B, force, weights, np.zeros(4), lower, upper), B, force, lower, upper)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e6])
def test_bounds_at_their_boundary_cases(scale):
    random = np.random.default_rng(11)
    for _ in range(20):
        B, weights = random.normal(size=(2, 5)), 10.0 ** random.uniform(-2.0, 2.0, 5)
        force = scale * random.normal(size=2)
        free, _ = efforts_of(Policy.of(5, free_of(5), weights), B, force)
        wide = scale * 100.0
        # Exactly at the optimum, above, below and both.
        for lower, upper in ((free, wide + free), (free - wide, free), (free, free)):
            tau, error = efforts_of(Policy.of(5, free_of(5), weights, (lower, upper)), B, force)
            assert error is None
            np.testing.assert_array_equal(tau, free)
        # A corner that nothing but itself fulfils, and that all bounds meet at.
        corner = scale * random.uniform(-1.0, 1.0, 5)
        sign = np.sign(B[0])
        lower, upper = np.where(sign > 0.0, corner - wide, corner), np.where(sign > 0.0, corner, corner + wide)
        for low, high in ((lower, upper), (corner, corner)):
            tau, error = efforts_of(Policy.of(5, free_of(5), weights, (low, high)), B, B @ corner)
            assert error is None
            np.testing.assert_allclose(tau, corner, rtol=0.0, atol=1e-9 * np.abs(corner).max())
        # One effort given.
        low, high = free - wide, free + wide
        low[1] = high[1] = free[1] + 0.3 * scale
        tau, error = efforts_of(Policy.of(5, free_of(5), weights, (low, high)), B, force)
        assert error is None
        assert tau[1] == low[1]
        # And all of them, beside a solution.
        tau, error = efforts_of(Policy.of(5, free_of(5), weights, (free * 1.001, free * 1.001)), B, force)
        assert isinstance(error, EffortLimitError)
        assert np.isnan(tau).all()


def free_of(m):
    return np.full(m, -np.inf), np.full(m, np.inf)


@pytest.mark.parametrize("zero", [True, False])
def test_what_the_bounds_lack_is_just_enough(zero):
    """As a multiple of the bounds; of the larger magnitude of each two where zero is not between them."""
    random = np.random.default_rng(5)
    checked = 0
    while checked < 25:
        B, force, weights, preload, lower, upper = random_problem(random, True, False)
        if zero:
            lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
        elif ((lower <= 0.0) & (upper >= 0.0)).all():
            continue
        m = len(weights)
        _, error = efforts_of(Policy.of(m, (lower, upper), weights, (lower, upper), preload), B, force)
        if error is None or not np.isfinite(error.needed):
            continue
        assert ("times the bounds are needed" in error.message) == zero
        assert ("has to move outwards by" in error.message) != zero
        assert error.margin[0] == 1.0 - error.needed < 0.0
        sides = np.abs([lower, upper])
        unit = np.where(np.isfinite(sides), sides, 0.0).max(axis=0)
        for excess, enough in (((error.needed - 1.0) * (1 + 1e-6), True), ((error.needed - 1.0) * (1 - 1e-3), False)):
            wider = (
                ((1.0 + excess) * lower, (1.0 + excess) * upper)
                if zero
                else (lower - excess * unit, upper + excess * unit)
            )
            _, again = efforts_of(Policy.of(m, (lower, upper), weights, wider, preload), B, force)
            assert (again is None) == enough
        checked += 1


def test_no_multiple_of_zero_is_enough():
    policy = Policy.of(2, free_of(2), bounds=([0.0, 0.0], [1.0, 0.0]))
    _, error = efforts_of(policy, np.array([[1.0, 1.0]]), np.array([-1.0]))
    assert math.isinf(error.needed)
    assert "no multiple of the bounds is enough" in error.message


def test_actuators_that_move_nothing_keep_to_their_preload():
    policy = Policy.of(3, free_of(3), bounds=[5.0, 1.0, 1.0], preload=np.array([0.0, 3.0, 0.5]))
    tau, error = efforts_of(policy, np.array([[2.0, 0.0, 0.0]]), np.array([4.0]))
    assert error is None
    np.testing.assert_allclose(tau, [2.0, 1.0, 0.5], rtol=1e-15)


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"weights": [1.0, 2.0]}, ShapeError, "weights must be 3 numbers"),
        ({"weights": [1.0, -2.0, 1.0]}, ParameterError, "positive"),
        ({"weights": "abc"}, ShapeError, "weights"),
        ({"weights": ["1", "2", "3"]}, ShapeError, "weights must be 3 numbers"),
        ({"weights": np.array([1, 2, 3], "timedelta64[s]")}, ShapeError, "weights must be 3 numbers"),
        ({"weights": [True, True, True]}, ShapeError, "weights must be 3 numbers"),
        ({"bounds": np.array(["2020", "2021", "2022"], "datetime64")}, ShapeError, "bounds must be 3 numbers"),
        ({"bounds": ([-9.0] * 3, np.array([1, 2, 3], "timedelta64[s]"))}, ShapeError, r"bounds\[1\] must be 3"),
        ({"bounds": [1.0]}, ShapeError, "bounds must be 3"),
        ({"bounds": ([1.0] * 3, [0.0] * 3)}, ParameterError, "lower <= upper"),
        ({"bounds": [math.nan] * 3}, ParameterError, "lower <= upper"),
        ({"bounds": ([math.inf] * 3, [math.inf] * 3)}, ParameterError, "must leave finite efforts"),
        ({"bounds": ([-1.0] * 3, [1.0, 1.0, -math.inf])}, ParameterError, "lower <= upper"),
        ({"bounds": ([-math.inf] * 3, [1.0, 1.0, -math.inf])}, ParameterError, "must leave finite efforts"),
        ({"preload": [1.0]}, ShapeError, "preload"),
        ({"preload": [math.inf, 0.0, 0.0]}, ParameterError, "preload must be finite"),
        ({"allow_idle": 1}, ParameterError, "allow_idle"),
    ],
)
def test_bad_choices(options, error, text):
    leg = ld.load(five_bar(("ma", "mb", "ka")))
    with pytest.raises(error, match=text):
        leg.torque(*STATE, **options)


def test_bounds_of_the_file_need_limits():
    with pytest.raises(ParameterError, match="no actuated joint has an effort limit"):
        Policy.of(2, free_of(2), bounds=True)


# ------------------------------------------------------------------------------------------------------- feasibility


def test_margins_are_those_of_the_file():
    leg = ld.load(five_bar(effort=6.0))
    q, v, a = STATE
    found = leg.feasible(q, v, a)
    tau = leg.torque(q, v, a)
    np.testing.assert_allclose(found.effort_margin, 1.0 - np.abs(tau) / 6.0)
    np.testing.assert_allclose(found.speed_margin, 1.0 - np.abs(v) / 10.0)
    assert (found.curve_margin == 1.0).all()
    assert bool(found) == bool((np.abs(tau) <= 6.0).all())
    assert not leg.feasible(q, 20.0 * v, a)
    assert "BEYOND its speed limit" in str(leg.feasible(q, [20.0, 0.0], a, torque=[0.0, 0.0]))
    assert pickle.loads(pickle.dumps(found)).actuators == ("M_ma", "M_mb")


def test_margins_are_those_of_the_side_that_the_effort_is_on():
    leg = ld.load(five_bar(effort=5.0, effort_lower=-4.0))
    for limits in (leg.limits, leg.actuator_limits):
        assert (limits.effort_lower.tolist(), limits.effort.tolist()) == ([-4.0] * 2, [5.0] * 2)
        assert not limits.effort_lower.flags.writeable
    q, v, a = STATE
    efforts = np.array([[-4.0, 5.0], [-5.0, 4.0], [-1.0, 1.0], [6.0, 0.0]])
    found = leg.feasible(np.tile(q, (4, 1)), v, a, torque=efforts)
    np.testing.assert_allclose(found.effort_margin, [[0.0, 0.0], [-0.25, 0.2], [0.75, 0.8], [-0.2, 1.0]], atol=1e-15)
    assert found.ok.tolist() == [[True, True], [False, True], [True, True], [False, True]]
    assert (found.worst()[0]["effort_margin"], found.worst()[0]["effort_sample"]) == (-0.25, 1)
    push = ld.load(five_bar(effort=5.0, effort_lower=0.0)).feasible(q, v, a, torque=[2.5, -1e-9])
    assert push.effort_margin.tolist() == [0.5, -math.inf]
    assert str(push).endswith("M_mb: BEYOND its effort limit, which is 0")
    pull = ld.load(five_bar(effort=0.0, effort_lower=-5.0)).feasible(q, v, a, torque=[1e-9, -2.5])
    assert pull.effort_margin.tolist() == [-math.inf, 0.5]


def test_the_torque_speed_line_holds_while_driving():
    drive = "<stallTorque>2</stallTorque><noLoadSpeed>50</noLoadSpeed>"
    leg = ld.load(five_bar(drive=drive, ratio=5.0))  # at the joint: 10 N·m at rest, 10 rad/s without load
    q, _, a = STATE
    driving = leg.feasible(q, [4.0, 0.0], a, torque=[6.0, 10.0])
    np.testing.assert_allclose(driving.curve_margin, [1.0 - 0.6 - 0.4, 0.0], atol=1e-15)
    braking = leg.feasible(q, [4.0, 0.0], a, torque=[-6.0, 10.0])
    np.testing.assert_allclose(braking.curve_margin, [0.4, 0.0], atol=1e-15)
    assert not leg.feasible(q, [4.1, 0.0], a, torque=[6.0, 0.0])
    worst = leg.feasible(np.array([q, q]), [[1.0, 0.0], [4.1, 0.0]], a, torque=[[6.0, 0.0], [6.0, 0.0]]).worst()[0]
    assert (worst["curve_sample"], worst["feasible"]) == (1, False)


def curve(effort, speed, line=(12.0, 100.0 / 6.0)):
    """Margin to a torque-speed line at one effort and speed."""
    infinite = np.array([np.inf])
    unlimited = SimpleNamespace(effort=infinite, effort_lower=-infinite, velocity=infinite)
    return float(feasibility(np.array([effort]), np.array([speed]), unlimited, [line], ["M"]).curve_margin[0])


def test_beyond_the_no_load_speed_a_motor_holds_no_effort_of_zero():
    for effort in (1e-12, 0.0, -1e-12):
        assert curve(effort, 50.0) == pytest.approx(-2.0)
        assert curve(-effort, -50.0) == pytest.approx(-2.0)
    assert curve(0.0, 100.0 / 6.0) == pytest.approx(0.0)


@pytest.mark.parametrize("speed", np.linspace(-2.5, 2.5, 26))
def test_the_line_is_that_of_a_motor_between_its_full_voltages(speed):
    stall, free = 12.0, 7.0
    efforts = np.linspace(-1.3, 1.3, 261)
    margins = np.array([curve(stall * u, free * speed, (stall, free)) for u in efforts])
    # With voltage V, of full voltage, the current over that at stall is V - speed / free, and so is the effort.
    voltage = efforts + speed
    can = (np.abs(voltage) <= 1.0 + 1e-9) & (np.abs(efforts) <= 1.0 + 1e-9)
    # At lower speeds braking is done within full voltage anyway.
    np.testing.assert_array_equal(margins >= -1e-9, can)
    assert np.abs(np.diff(margins)).max() < 0.011  # continuous: slopes are at most 1 per stall effort


def test_a_limit_of_zero_and_rows_that_cannot_be_computed_are_json():
    leg = ld.load(five_bar(effort=0.0))
    found = leg.feasible(STATE[0], STATE[1], STATE[2], torque=[0.5, 0.0])
    assert found.effort_margin.tolist() == [-math.inf, 1.0]
    worst = found.worst()
    assert [row["effort_margin"] for row in worst] == [-1e9, 1.0]
    assert [row["feasible"] for row in worst] == [False, True]
    assert json.loads(json.dumps(worst, allow_nan=False)) == worst
    assert str(found).startswith("M_ma: BEYOND its effort limit, which is 0; M_mb: within")
    lost = ld.load(five_bar()).feasible(np.array([STATE[0], [0.0, math.pi]]), STATE[1], STATE[2], on_error="nan")
    row = lost.worst()[0]
    assert (row["effort_margin"], row["effort_sample"], row["feasible"]) == (None, 1, False)
    assert json.dumps(lost.worst(), allow_nan=False)
    assert str(lost).startswith("M_ma: sample 1 could not be computed")


def test_efforts_are_within_their_bounds_to_the_last_digit():
    """Also where a bound that is just too narrow for the optimum would be let pass."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        B, Q = rng.normal(size=(2, 4)), rng.normal(size=2)
        free = _Share(B, Q, np.ones(4), np.zeros(4), np.full(4, -np.inf), np.full(4, np.inf)).optimum()
        bound = np.abs(free) * (1.0 - 10.0 ** rng.uniform(-14.0, -8.0, 4))
        bound[int(rng.integers(4))] = np.inf
        bound[int(rng.integers(4))] = np.inf
        share = _Share(B, Q, np.ones(4), np.zeros(4), -bound, bound)
        if np.isfinite(bound).sum() > 2:
            continue
        efforts = share.optimum()
        assert (np.abs(efforts) <= bound).all()
        np.testing.assert_allclose(B @ efforts, Q, atol=1e-12 * (1.0 + np.abs(B).max() * np.abs(efforts).max()))
        np.testing.assert_allclose(efforts, free, atol=1e-5 * np.abs(free).max())


def test_bounds_that_are_too_narrow_by_rounding_keep_the_balance():
    share = _Share(np.ones((1, 2)), np.array([2.0]), np.ones(2), np.zeros(2), -np.ones(2), np.full(2, 1.0 - 1e-12))
    efforts = share.optimum()
    assert efforts.sum() == pytest.approx(2.0, abs=1e-15)
    assert (efforts <= 1.0 + 1e-9).all()


def test_speed_of_a_motor_on_a_dependent_joint():
    leg = ld.load(five_bar(("ma", "kb")))
    q, v, a = STATE
    np.testing.assert_allclose(leg.feasible(q, v, a).speed, leg.actuator_jacobian(q) @ v)


def test_rows_that_cannot_be_computed_are_not_feasible():
    leg = ld.load(five_bar())
    found = leg.feasible(np.array([STATE[0], [0.0, math.pi]]), STATE[1], STATE[2], on_error="nan")
    assert found.ok.tolist() == [[True, True], [False, False]]
    assert not found


@pytest.mark.parametrize(
    ("drive", "text"),
    [
        ("<stallTorque>2</stallTorque>", "only one of stallTorque"),
        ("<stallTorque>0</stallTorque><noLoadSpeed>1</noLoadSpeed>", "must be positive"),
    ],
)
def test_half_a_torque_speed_line_is_refused(drive, text):
    with pytest.raises(DescriptionError, match=text):
        ld.load(five_bar(drive=drive))


def test_efforts_given_and_chosen_contradict():
    with pytest.raises(ParameterError, match="torque is given"):
        ld.load(five_bar()).feasible(*STATE, torque=[0.0, 0.0], weights=[1.0, 1.0])
