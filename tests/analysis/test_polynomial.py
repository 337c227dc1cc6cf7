"""Piecewise polynomials: exact derivatives, boundary conditions, least jerk, jumps, and what is refused."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import make_interp_spline

from leg_dynamics.analysis.trajectories import PiecewisePolynomial, minimum_jerk, quintic
from leg_dynamics.errors import NonFiniteError, ShapeError, TrajectoryError

VALUES = arrays(float, (6, 2), elements=st.floats(-10.0, 10.0, allow_subnormal=False))


@given(VALUES, st.floats(0.1, 20.0), st.floats(-50.0, 50.0))
@settings(max_examples=60, deadline=None)
def test_quintic_meets_all_boundary_values(values, duration, start_time):
    p0, p1, v0, v1, a0, a1 = values
    curve = quintic(
        p0,
        p1,
        duration,
        start_velocity=v0,
        end_velocity=v1,
        start_acceleration=a0,
        end_acceleration=a1,
        start_time=start_time,
    )
    T = curve.duration
    for order, (start, end) in enumerate(((p0, p1), (v0, v1), (a0, a1))):
        # Rounding of the end time alone moves a value by its derivative times that rounding.
        scale = (np.abs(values) * [[1.0], [1.0], [T], [T], [T**2], [T**2]]).max() / T**order + 1e-300
        np.testing.assert_allclose(curve.ends(order)[0], start, atol=1e-13 * scale, rtol=0)
        np.testing.assert_allclose(curve.ends(order)[1], end, atol=1e-11 * scale, rtol=0)
        both = curve.value([curve.start_time, curve.end_time], order)
        np.testing.assert_allclose(both, [start, end], atol=1e-11 * scale, rtol=0)


def test_minimum_jerk_from_rest_is_the_textbook_polynomial():
    t = np.linspace(0.0, 2.0, 41)
    u = t / 2.0
    curve = quintic([1.0], [4.0], 2.0)
    np.testing.assert_allclose(curve.value(t)[:, 0], 1.0 + 3.0 * (10 * u**3 - 15 * u**4 + 6 * u**5), atol=1e-14)
    np.testing.assert_allclose(curve.value(1.0, 1), [3.0 * 1.875 / 2.0], rtol=1e-14)
    # The jerk is 60 D / T^3 at both ends.
    np.testing.assert_allclose([j[0] for j in curve.ends(3)], 60.0 * 3.0 / 8.0, rtol=1e-14)
    np.testing.assert_array_equal(curve.ends(7), np.zeros((2, 1)))


def test_derivatives_are_those_of_finite_differences():
    curve = minimum_jerk([[0.0, 1.0], [2.0, -1.0], [1.0, 0.5], [3.0, 3.0]], [0.0, 0.7, 1.1, 2.5], start_velocity=0.4)
    t, h = np.linspace(0.05, 2.45, 50), 1e-5
    for order in range(4):
        difference = (curve.value(t + h, order) - curve.value(t - h, order)) / (2.0 * h)
        scale = np.abs(curve.value(t, order + 1)).max()
        np.testing.assert_allclose(curve.value(t, order + 1), difference, atol=1e-6 * scale)


def squared_jerk(curve):
    nodes, weights = np.polynomial.legendre.leggauss(8)
    total = 0.0
    for a, b in zip(curve.breaks[:-1], curve.breaks[1:], strict=True):
        t = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        total += 0.5 * (b - a) * float(weights @ (curve.value(t, 3) ** 2).sum(axis=1))
    return total


@given(arrays(float, (3, 1), elements=st.floats(-1.0, 1.0)))
@settings(max_examples=30, deadline=None)
def test_minimum_jerk_is_the_minimum_among_curves_through_the_points(change):
    times, points = np.array([0.0, 0.8, 1.0, 2.0]), np.array([[0.0], [1.0], [-0.5], [2.0]])
    best = minimum_jerk(points, times, end_velocity=0.3, end_acceleration=-0.2)
    v, a = best.value(times, 1), best.value(times, 2)
    np.testing.assert_allclose(best.value(times), points, atol=1e-12)
    np.testing.assert_allclose([v[0, 0], v[-1, 0], a[0, 0], a[-1, 0]], [0.0, 0.3, 0.0, -0.2], atol=1e-9)
    # Other rates at the via points, the same points and ends.
    v[1:3] += change[:2]
    a[1:3] += change[2]
    other = PiecewisePolynomial.through_samples(times, points, v, a)
    assert squared_jerk(other) >= squared_jerk(best) * (1.0 - 1e-9)


def test_via_points_leave_jerk_and_snap_continuous():
    curve = minimum_jerk(np.array([[0.0], [3.0], [1.0]]), [10.0, 10.2, 11.0])
    assert curve.jumps(3) == curve.jumps(4) == ()
    assert [jump.time for jump in curve.jumps(5)] == [10.2]


def test_jumps_name_time_and_both_sides():
    there, back = quintic([0.0, 0.0], [0.1, 0.0], 2.5), quintic([0.1, 0.0], [0.0, 0.0], 2.5)
    curve = PiecewisePolynomial([0.0, 2.5, 5.0], np.concatenate([there.coefficients, back.coefficients], axis=1))
    assert curve.jumps(2) == ()
    (jump,) = curve.jumps()
    assert jump.time == 2.5
    np.testing.assert_allclose([jump.left, jump.right], [[0.384, 0.0], [-0.384, 0.0]], rtol=1e-12)
    np.testing.assert_allclose(jump.jump, [-0.768, 0.0], rtol=1e-12)


def test_through_samples_reproduces_a_quintic():
    curve = quintic([1.0, 2.0], [-1.0, 4.0], 3.0, start_velocity=[1.0, 2.0], end_acceleration=0.7)
    t = np.array([0.0, 0.1, 1.7, 2.0, 3.0])
    again = PiecewisePolynomial.through_samples(t, curve.value(t), curve.value(t, 1), curve.value(t, 2))
    fine = np.linspace(0.0, 3.0, 61)
    for order in range(3):
        np.testing.assert_allclose(again.value(fine, order), curve.value(fine, order), atol=1e-9)


def test_samples_name_and_times():
    curve = quintic([0.0, 0.0, 0.4], [0.1, 0.0, 0.4], 2.0, start_time=5.0, name="reach")
    motion, path = curve.trajectory(10.0), curve.foot_path(times=[5.5, 6.0])
    assert motion.name == path.name == "reach"
    assert (motion.time[0], motion.time[-1], len(motion)) == (5.0, 7.0, 21)
    np.testing.assert_array_equal(motion.a, curve.value(motion.time, 2))
    np.testing.assert_array_equal(path.position, curve.value([5.5, 6.0]))
    np.testing.assert_array_equal(curve.trajectory(times=[5.5]).q, path.position[:1])
    np.testing.assert_array_equal(curve.foot_path(10.0).velocity, motion.v)
    with pytest.raises(ShapeError, match="position has shape"):
        quintic([0.0], [1.0], 1.0).foot_path()
    assert repr(curve) == "<PiecewisePolynomial 'reach': 1 pieces of degree 5 in 3 coordinates, 5 to 7 s>"


def test_translation():
    curve = quintic([0.0, 1.0], [2.0, 3.0], 1.0)
    moved = curve.translated([1.0, -1.0])
    np.testing.assert_allclose(moved.value(0.3) - curve.value(0.3), [1.0, -1.0], atol=1e-15)
    np.testing.assert_array_equal(moved.value(0.3, 1), curve.value(0.3, 1))
    with pytest.raises(ShapeError, match="offset"):
        curve.translated([1.0, 2.0, 3.0])


def test_curves_are_immutable_and_picklable():
    curve = quintic([0.0], [1.0], 1.0)
    copy = pickle.loads(pickle.dumps(curve))
    np.testing.assert_array_equal(copy.coefficients, curve.coefficients)
    for array in (curve.breaks, curve.coefficients, copy.breaks, copy.coefficients):
        assert not array.flags.writeable
    with pytest.raises(AttributeError):
        curve.name = "other"


@pytest.mark.parametrize(
    ("breaks", "coefficients", "error", "text"),
    [
        ([0.0], np.zeros((2, 1, 1)), ShapeError, "at least a start and an end"),
        ([0.0, 1.0], np.zeros((2, 2, 1)), ShapeError, "1 pieces need"),
        ([0.0, 1.0], np.zeros((2, 1, 0)), ShapeError, "coefficients have shape"),
        ([0.0, "b"], np.zeros((2, 1, 1)), ShapeError, "real numbers"),
        ([0.0, math.nan], np.zeros((2, 1, 1)), NonFiniteError, "NaN"),
        ([0.0, 1.0], np.full((2, 1, 1), math.inf), NonFiniteError, "infinite"),
        ([0.0, 1.0, 1.0], np.zeros((2, 2, 1)), TrajectoryError, "must increase"),
    ],
)
def test_bad_curves_are_named(breaks, coefficients, error, text):
    with pytest.raises(error, match=text):
        PiecewisePolynomial(breaks, coefficients)


def test_bad_evaluations_are_named():
    curve = quintic([0.0], [1.0], 2.0)
    # Rounding of sample times is not an error.
    np.testing.assert_allclose(curve.value(2.0 * (1.0 + 1e-15)), [1.0])
    assert curve.value(np.empty(0)).shape == (0, 1)
    for time in (-1e-6, 2.001):
        with pytest.raises(TrajectoryError, match=r"which runs from 0 to 2 s"):
            curve.value(time)
    with pytest.raises(NonFiniteError, match="a time"):
        curve.value(math.nan)
    for order in (-1, 1.5, True):
        with pytest.raises(TrajectoryError, match="order of a derivative"):
            curve.value(0.0, order)


@pytest.mark.parametrize("duration", [0.0, -1.0, math.nan, math.inf])
def test_bad_durations_are_named(duration):
    with pytest.raises(TrajectoryError, match="duration must be a positive number of seconds"):
        quintic([0.0], [1.0], duration)


@pytest.mark.parametrize(
    ("points", "times", "error", "text"),
    [
        ([[0.0]], [0.0], ShapeError, "m >= 2"),
        ([0.0, 1.0], [0.0, 1.0], ShapeError, "points have shape"),
        ([[0.0], [1.0]], [0.0, 1.0, 2.0], ShapeError, "times"),
        ([[0.0], [1.0, 2.0]], [0.0, 1.0], ShapeError, "points must be an array"),
        ([[0.0], [math.nan]], [0.0, 1.0], NonFiniteError, "NaN"),
        ([[0.0], [1.0]], [1.0, 1.0], TrajectoryError, "must increase"),
    ],
)
def test_bad_points_are_named(points, times, error, text):
    with pytest.raises(error, match=text):
        minimum_jerk(points, times)
    with pytest.raises(ShapeError, match="do not fit"):
        minimum_jerk([[0.0], [1.0]], [0.0, 1.0], end_velocity=[1.0, 2.0])


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (([0.0], [[0.0]], [[0.0]], [[0.0]]), ShapeError),
        (([0.0, 1.0], [[0.0], [1.0]], [[0.0]], [[0.0], [0.0]]), ShapeError),
        (([1.0, 0.0], *[[[0.0], [1.0]]] * 3), TrajectoryError),
    ],
)
def test_bad_samples_are_named(arguments, error):
    with pytest.raises(error):
        PiecewisePolynomial.through_samples(*arguments)


@pytest.mark.parametrize("count", [3, 4, 5, 12])
def test_via_points_agree_with_a_general_spline_solver(count):
    random = np.random.default_rng(count)
    times, points = np.cumsum(random.uniform(0.3, 1.5, count)), random.normal(size=(count, 2))
    v0, a0, v1, a1 = random.normal(size=(4, 2))
    curve = minimum_jerk(points, times, start_velocity=v0, start_acceleration=a0, end_velocity=v1, end_acceleration=a1)
    oracle = make_interp_spline(times, points, k=5, bc_type=([(1, v0), (2, a0)], [(1, v1), (2, a1)]))
    dense = np.linspace(times[0], times[-1], 301)
    for order in range(4):
        scale = np.abs(oracle(dense, nu=order)).max()
        np.testing.assert_allclose(curve.value(dense, order), oracle(dense, nu=order), atol=1e-9 * scale)


@pytest.mark.parametrize("turn", [False, True])
@pytest.mark.parametrize("step", [1e-1, 1e-2, 1e-3])
def test_unequal_steps_pass_their_points(step, turn):
    times = [0.0, 1.0 - step, 1.0] if turn else [0.0, step, 1.0]
    curve = minimum_jerk([[0.0], [1.0], [2.0]], times)
    np.testing.assert_allclose(curve.value(times)[:, 0], [0.0, 1.0, 2.0], atol=2e-9)
    # The left side of a point too: the value there is the next piece's.
    np.testing.assert_allclose(curve.value(np.nextafter(times[1:], 0.0))[:, 0], [1.0, 2.0], atol=3e-9)
    # The gradient of the integral vanishes: no jump, in units of the largest terms.
    assert curve.jumps(3, 1e-9) == curve.jumps(4, 1e-9) == ()


@pytest.mark.parametrize("turn", [False, True])
@pytest.mark.parametrize("step", [1e-6, 1e-9, 1e-15])
def test_steps_too_unequal_to_pass_the_points_are_refused(step, turn):
    times = [0.0, 1.0 - step, 1.0] if turn else [0.0, step, 1.0]
    with pytest.raises(
        TrajectoryError, match=r"miss its point at t = \S+ s by .* times shorter than the longest"
    ) as error:
        minimum_jerk([[0.0], [1.0], [2.0]], times)
    assert error.value.ratio == pytest.approx(np.diff(times).max() / np.diff(times).min())


def test_steps_out_of_range_are_refused():
    for step in (1e-70, 1e-200, 5e-324):
        with pytest.raises(TrajectoryError, match=r"the step of \S+ s"):
            minimum_jerk([[0.0], [1.0], [2.0]], [0.0, step, 1.0])
    with pytest.raises(TrajectoryError, match="too short or too long"):
        quintic([0.0], [1.0], 1e-100)


def test_close_points_that_fit_the_motion_may_be_close():
    # Where the points lie on a smooth motion, even a large ratio of steps does no harm.
    times = np.array([0.0, 1.0, 1.0 + 1e-4, 2.0])
    smooth = quintic([0.0], [1.0], 2.0)
    curve = minimum_jerk(smooth.value(times), times)
    dense = np.linspace(0.0, 2.0, 101)
    np.testing.assert_allclose(curve.value(dense), smooth.value(dense), atol=1e-9)
