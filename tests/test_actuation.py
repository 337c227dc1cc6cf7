"""Verdicts on actuation, efforts that are not unique or not enough, and what actuators can do."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from scipy.optimize import minimize

import leg_dynamics as ld
from leg_dynamics.actuation import Policy, actuation_of
from leg_dynamics.errors import (
    ActuationError,
    DescriptionError,
    EffortLimitError,
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


def test_preload_keeps_only_what_does_no_work():
    leg = ld.load(five_bar(("ma", "mb", "ka")))
    A = leg.actuator_jacobian(STATE[0])
    null = np.linalg.svd(A.T)[2][-1]
    tau = leg.torque(*STATE)
    np.testing.assert_allclose(leg.torque(*STATE, preload=5.0 * null), tau + 5.0 * null, atol=1e-9)
    np.testing.assert_allclose(leg.torque(*STATE, preload=A @ np.array([3.0, 1.0])), tau, atol=1e-9)
    many = leg.torque(*(np.array([x, x]) for x in STATE), preload=np.array([0.0 * null, 5.0 * null]))
    np.testing.assert_allclose(many[1] - many[0], 5.0 * null, atol=1e-9)


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
    policy = Policy.of(2, np.full(2, np.inf))
    tau, _ = policy.efforts(A, np.array([[1.0, 1.0]]), verdict, ("x", "y"), failures)
    assert np.isnan(tau).all()
    error = failures.combined(None)
    assert isinstance(error, SingularityError)
    assert (error.kind, error.direction) == ("parallel", {"x": 0.0, "y": 1.0})


@pytest.mark.parametrize(
    ("options", "error", "text"),
    [
        ({"weights": [1.0, 2.0]}, ShapeError, "weights must be 3 numbers"),
        ({"weights": [1.0, -2.0, 1.0]}, ParameterError, "positive"),
        ({"weights": "abc"}, ShapeError, "weights"),
        ({"bounds": [1.0]}, ShapeError, "bounds must be 3"),
        ({"bounds": ([1.0] * 3, [0.0] * 3)}, ParameterError, "lower <= upper"),
        ({"bounds": [math.nan] * 3}, ParameterError, "lower <= upper"),
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
        Policy.of(2, np.full(2, np.inf), bounds=True)


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
