"""Joining, repeating, stretching, resampling and blending motions, and reports of what is not smooth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from leg_dynamics.analysis.trajectories import (
    FootPath,
    PiecewisePolynomial,
    Trajectory,
    blend,
    check_periodic,
    concatenate,
    connect,
    jerk_jumps,
    minimum_jerk,
    omnileg_eq51_path,
    omnileg_eq52,
    quintic,
    repeat,
    resample,
    seam,
    time_scale,
)
from leg_dynamics.errors import ShapeError, TrajectoryError

FORTH = quintic([0.0, 1.0, 0.4], [0.1, 0.5, 0.5], 2.0, name="forth")
BACK = quintic([0.1, 0.5, 0.5], [0.0, 1.0, 0.4], 1.0, start_time=7.0, name="back")
KINDS = (lambda curve: curve, lambda curve: curve.trajectory(10.0), lambda curve: curve.foot_path(10.0))


def coordinates(motion):
    return (
        (motion.q, motion.v, motion.a)
        if isinstance(motion, Trajectory)
        else (
            motion.position,
            motion.velocity,
            motion.acceleration,
        )
    )


def sampled(curve, kind, rate=10.0):
    return curve.trajectory(rate) if kind is Trajectory else curve.foot_path(rate)


def check_consistent(motion, tolerance, kinks=()):
    """The rates and accelerations are those of the coordinates, by differences, which fail where the jerk jumps."""
    x, v, a = coordinates(motion)
    smooth = np.all([np.abs(motion.time - kink) > 0.005 for kink in (-1.0, *kinks)], axis=0)
    for values, rates in ((x, v), (v, a)):
        difference = np.gradient(values, motion.time, axis=0, edge_order=2)
        np.testing.assert_allclose(difference[smooth], rates[smooth], atol=tolerance * np.abs(rates).max())


@pytest.mark.parametrize("kind", [Trajectory, FootPath])
def test_concatenated_samples_are_those_of_the_concatenated_curve(kind):
    curve = concatenate(FORTH, BACK)
    motion = concatenate(sampled(FORTH, kind), sampled(BACK, kind))
    assert type(motion) is kind
    assert curve.name == motion.name == "forth + back"
    assert curve.breaks.tolist() == [0.0, 2.0, 3.0]
    assert len(motion) == 31
    np.testing.assert_allclose(motion.time, np.arange(31) / 10.0, atol=1e-14)
    for order, values in enumerate(coordinates(motion)):
        np.testing.assert_allclose(values, curve.value(motion.time, order), atol=1e-13)


def test_curves_of_different_degree_concatenate():
    line = PiecewisePolynomial([0.0, 1.0], [[[1.0]], [[0.0]]])
    rest = quintic([1.0], [2.0], 1.0, start_velocity=1.0)
    curve = concatenate(line, rest, name="both")
    assert curve.name == "both"
    np.testing.assert_allclose(curve.value([0.0, 0.5, 1.0, 2.0])[:, 0], [0.0, 0.5, 1.0, 2.0], atol=1e-15)


def test_forces_join_with_zeros_where_there_are_none():
    pushed = FORTH.trajectory(10.0).with_foot_force([1.0, 2.0, 3.0])
    motion = concatenate(pushed, BACK.trajectory(10.0))
    np.testing.assert_array_equal(motion.foot_force[:21], [[1.0, 2.0, 3.0]] * 21)
    np.testing.assert_array_equal(motion.foot_force[21:], 0.0)
    assert concatenate(FORTH.trajectory(10.0), BACK.trajectory(10.0)).foot_force is None


@pytest.mark.parametrize("make", KINDS)
def test_jumps_are_refused_with_their_values(make):
    off = BACK.translated([0.0, 0.0, 0.01])
    with pytest.raises(TrajectoryError, match=r"'forth' and 'back' do not join .*position jumps by \(0, 0, 0\.01\)"):
        concatenate(make(FORTH), make(off))
    rising = quintic([0.1, 0.5, 0.5], [0.0, 1.0, 0.4], 1.0, start_velocity=[0.0, 0.2, 0.0])
    with pytest.raises(TrajectoryError, match="velocity jumps") as caught:
        concatenate(make(FORTH), make(rising))
    assert caught.value.derivative == "velocity"
    np.testing.assert_allclose(caught.value.seam.velocity, [0.0, 0.2, 0.0], atol=1e-15)
    assert concatenate(make(FORTH), make(rising), continuity="position").duration == pytest.approx(3.0)
    pulling = quintic([0.1, 0.5, 0.5], [0.0, 1.0, 0.4], 1.0, start_acceleration=[0.3, 0.0, 0.0])
    assert concatenate(make(FORTH), make(pulling)).duration == pytest.approx(3.0)
    with pytest.raises(TrajectoryError, match="acceleration jumps"):
        concatenate(make(FORTH), make(pulling), continuity="acceleration")


def test_only_like_motions_join():
    with pytest.raises(ShapeError, match="joined with their like"):
        concatenate(FORTH, BACK.trajectory(10.0))
    with pytest.raises(ShapeError, match="PiecewisePolynomial of 1"):
        concatenate(FORTH, quintic([0.0], [1.0], 1.0))
    with pytest.raises(ShapeError, match="not list"):
        concatenate(FORTH, [1.0])
    with pytest.raises(TrajectoryError, match="continuity must be"):
        concatenate(FORTH, BACK, continuity="jerk")


@pytest.mark.parametrize("make", KINDS)
def test_repetition(make):
    cycle = concatenate(make(FORTH), make(BACK), name="cycle")
    three = repeat(cycle, 3)
    assert three.name == "cycle"
    assert three.duration == pytest.approx(9.0)
    assert repeat(cycle, 1).duration == pytest.approx(3.0)
    with pytest.raises(TrajectoryError, match="position jumps"):
        repeat(make(FORTH), 2)
    for count in (0, -1, 1.5, True):
        with pytest.raises(TrajectoryError, match="at least 1"):
            repeat(cycle, count)


def test_repeated_samples_are_periodic():
    cycle = concatenate(FORTH, BACK)
    three = repeat(cycle.trajectory(10.0), 3)
    assert len(three) == 91
    np.testing.assert_allclose(three.q[:31], three.q[60:], atol=1e-14)
    np.testing.assert_allclose(three.q, repeat(cycle, 3).value(three.time), atol=1e-13)


@given(st.floats(0.05, 20.0))
@settings(max_examples=25, deadline=None)
def test_time_scaling_follows_the_chain_rule(speed):
    fast = time_scale(BACK, speed)
    assert fast.start_time == 7.0
    assert fast.duration == pytest.approx(1.0 / speed)
    t = np.linspace(7.0, 8.0, 11)
    for order in range(4):
        expected = BACK.value(t, order) * speed**order
        got = fast.value(np.minimum(7.0 + (t - 7.0) / speed, fast.end_time), order)
        np.testing.assert_allclose(got, expected, atol=1e-9 * (1.0 + np.abs(expected).max()))
    motion = time_scale(BACK.trajectory(10.0).with_foot_force([0.0, 0.0, 1.0]), speed)
    np.testing.assert_array_equal(motion.q, BACK.trajectory(10.0).q)
    np.testing.assert_allclose(motion.a, fast.value(motion.time, 2), atol=1e-9 * (1.0 + np.abs(motion.a).max()))
    assert motion.foot_force[0, 2] == 1.0


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf])
def test_bad_speeds_are_named(speed):
    with pytest.raises(TrajectoryError, match="speed factor"):
        time_scale(FORTH, speed)


@pytest.mark.parametrize("kind", [Trajectory, FootPath])
def test_resampling_a_quintic_is_exact(kind):
    motion = resample(sampled(FORTH, kind, 5.0), 37.0)
    assert type(motion) is kind
    for order, values in enumerate(coordinates(motion)):
        np.testing.assert_allclose(values, FORTH.value(motion.time, order), atol=1e-12)


def test_resampling_a_sine_converges_and_interpolates_forces():
    def error(rate):
        fine = resample(omnileg_eq52(2.0, rate), 100.0)
        exact = omnileg_eq52(2.0, 100.0)
        return np.abs(fine.q - exact.q).max(), np.abs(fine.a - exact.a).max()

    coarse, fine = error(5.0), error(10.0)
    assert fine[0] < 1e-8
    # Orders six and four.
    assert coarse[0] / fine[0] > 40.0
    assert coarse[1] / fine[1] > 10.0
    motion = omnileg_eq52(2.0, 1.0).with_foot_force([[0.0, 0.0, 0.0], [0.0, 0.0, 4.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(resample(motion, times=[0.25, 1.0, 1.5]).foot_force[:, 2], [1.0, 4.0, 2.0])


def test_resampling_keeps_the_samples_and_refuses_nonsense():
    motion = BACK.trajectory(10.0)
    same = resample(motion, times=motion.time)
    for before, after in zip(coordinates(motion), coordinates(same), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-12)
    assert resample(motion, 10.0).time[0] == 7.0
    with pytest.raises(TrajectoryError, match="either the rate or the times"):
        resample(motion)
    with pytest.raises(TrajectoryError, match="either the rate or the times"):
        resample(motion, 10.0, times=[7.0])
    with pytest.raises(TrajectoryError, match="leave the curve"):
        resample(motion, times=[6.0, 7.5])
    with pytest.raises(TrajectoryError, match="one sample"):
        resample(Trajectory([0.0], [[0.0]], [[0.0]], [[0.0]]), 10.0)
    with pytest.raises(ShapeError, match="sample the curve first"):
        resample(FORTH, 10.0)


@pytest.mark.parametrize("kind", [Trajectory, FootPath])
def test_blend_is_smooth_and_keeps_both_outside_the_overlap(kind):
    first = sampled(quintic([0.0, 1.0, 2.0], [1.0, 0.0, 2.5], 2.0, end_velocity=0.3), kind, 500.0)
    second = sampled(quintic([5.0, 1.0, 2.0], [1.0, 3.0, 0.0], 3.0, start_velocity=1.0), kind, 400.0)
    motion = blend(first, second, 0.8)
    assert motion.duration == pytest.approx(2.0 + 3.0 - 0.8)
    assert motion.name == "quintic to quintic"
    check_consistent(motion, 2e-4, kinks=(1.2, 2.0))
    before, after = first.time < 1.2, motion.time > 2.0 + 1e-9
    for whole, one, two in zip(coordinates(motion), coordinates(first), coordinates(second), strict=True):
        np.testing.assert_array_equal(whole[: before.sum()], one[before])
        np.testing.assert_array_equal(whole[after], two[-after.sum() :])
    # At the end of the overlap it already is the second motion, up to its acceleration.
    at_end = resample(second, times=[second.time[0] + 0.8])
    for whole, two in zip(coordinates(motion), coordinates(at_end), strict=True):
        np.testing.assert_allclose(whole[len(first) - 1], two[0], atol=1e-9)


@given(st.floats(0.05, 1.0))
@settings(max_examples=20, deadline=None)
def test_a_blend_stays_between_its_motions(duration):
    low, high = quintic([0.0], [0.5], 1.0).trajectory(50.0), quintic([1.0], [0.6], 2.0).trajectory(50.0)
    q = blend(low, high, duration).q
    assert q.min() >= 0.0
    assert q.max() <= 1.0


def test_blending_a_motion_into_its_own_continuation_changes_nothing():
    whole = omnileg_eq52(4.0, 100.0)
    head = Trajectory(whole.time[:251], whole.q[:251], whole.v[:251], whole.a[:251])
    tail = Trajectory(whole.time[150:], whole.q[150:], whole.v[150:], whole.a[150:])
    again = blend(head, tail, 1.0, name="again")
    assert again.name == "again"
    np.testing.assert_allclose(again.time, whole.time, atol=1e-12)
    for one, two in zip(coordinates(again), coordinates(whole), strict=True):
        np.testing.assert_allclose(one, two, atol=1e-10)


def test_forces_are_blended_alike():
    first = quintic([0.0], [1.0], 1.0).trajectory(100.0)
    pushed = first.with_foot_force([0.0, 0.0, 10.0])
    for force in (blend(first, pushed, 0.5).foot_force, 10.0 - blend(pushed, first, 0.5).foot_force):
        np.testing.assert_allclose(force[:51, 2], 0.0, atol=1e-12)
        np.testing.assert_allclose(force[75, 2], 5.0, rtol=1e-12)
        np.testing.assert_allclose(force[101:, 2], 10.0)
    assert blend(first, first, 0.5).foot_force is None


@pytest.mark.parametrize("duration", [0.0, -1.0, 1.5, math.nan])
def test_bad_blends_are_named(duration):
    first = quintic([0.0], [1.0], 1.0).trajectory(100.0)
    with pytest.raises(TrajectoryError, match="at most the shorter motion's 1 s"):
        blend(first, quintic([0.0], [1.0], 2.0).trajectory(10.0), duration)
    assert blend(first, first, 1.0).duration == pytest.approx(1.0)


@pytest.mark.parametrize("kind", [Trajectory, FootPath])
def test_connection_is_smooth(kind):
    first = sampled(quintic([0.0, 0.0, 0.4], [0.1, 0.0, 0.5], 1.0, end_velocity=0.2, end_acceleration=1.0), kind, 500.0)
    second = sampled(quintic([0.3, 0.1, 0.2], [0.1, 0.0, 0.5], 1.0, start_velocity=-0.2), kind, 500.0)
    motion = connect(first, second, 0.513, 500.0)
    assert motion.duration == pytest.approx(2.513)
    check_consistent(motion, 2e-4, kinks=(1.0, 1.513))
    assert connect(first, second, 0.5, 100.0, name="joined").name == "joined"
    assert jerk_jumps(motion, 1e-3)
    # The acceleration is the ends' own, not only nearly so.
    a = coordinates(motion)[2]
    np.testing.assert_array_equal(a[len(first) - 1], coordinates(first)[2][-1])
    np.testing.assert_allclose(a[-len(second)], coordinates(second)[2][0], atol=1e-9)


def test_seam_and_periodicity():
    motion = omnileg_eq52(6.0, 10.0)
    assert seam(motion).worst() < 1e-14
    assert check_periodic(motion).worst("velocity") < 1e-14
    part = omnileg_eq52(2.0, 10.0)
    found = seam(part)
    np.testing.assert_allclose(found.position, -part.q[-1])
    np.testing.assert_allclose(found.velocity, part.v[0] - part.v[-1])
    np.testing.assert_allclose(found.acceleration, -part.a[-1])
    assert found.worst("position") == pytest.approx(math.radians(30.0) * math.sqrt(3.0) / 2.0)
    with pytest.raises(TrajectoryError, match=r"'eq52' is not periodic: .*position jumps by \(-0\.4534"):
        check_periodic(part)
    # Half a period: the position returns, the velocity does not.
    half = omnileg_eq52(3.0, 10.0)
    assert check_periodic(half, continuity="position").worst("position") < 1e-14
    with pytest.raises(TrajectoryError, match="velocity jumps"):
        check_periodic(half)
    with pytest.raises(TrajectoryError, match=r"'eq51' is not periodic: .*position jumps by \(0, -0\.1, 0\)"):
        check_periodic(omnileg_eq51_path())
    with pytest.raises(TrajectoryError, match="continuity must be"):
        check_periodic(motion, continuity="snap")


def test_jerk_jumps_of_a_curve_and_of_its_samples_agree():
    curve = omnileg_eq51_path()
    (exact,) = jerk_jumps(curve)
    for motion in (curve.trajectory(100.0), curve.foot_path(100.0)):
        (found,) = jerk_jumps(motion, 0.1)
        assert found.time == pytest.approx(exact.time)
        np.testing.assert_allclose(found.jump, exact.jump, atol=2e-3)
    assert len(jerk_jumps(curve, 0.7)) == 1
    assert jerk_jumps(curve, 0.8) == jerk_jumps(curve.foot_path(100.0), 0.8) == ()


def test_jerk_jumps_see_repeated_cycles_and_uneven_samples():
    cycle = concatenate(FORTH, BACK)
    assert [jump.time for jump in jerk_jumps(repeat(cycle, 2))] == pytest.approx([2.0, 3.0, 5.0])
    smooth = minimum_jerk([[0.0], [1.0]], [0.0, 1.0])
    times = np.sort(np.append(np.linspace(0.0, 1.0, 200), [0.3001, 0.6702]))
    assert jerk_jumps(smooth.trajectory(times=times), 1.0) == ()


def test_jerk_jumps_of_samples_need_a_threshold_and_five_samples():
    motion = omnileg_eq52(1.0, 10.0)
    for threshold in (None, 0.0, -1.0, math.nan):
        with pytest.raises(TrajectoryError, match="threshold"):
            jerk_jumps(motion, threshold)
    with pytest.raises(TrajectoryError, match="4 samples"):
        jerk_jumps(omnileg_eq52(0.3, 10.0), 1.0)
