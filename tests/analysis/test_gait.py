"""Gait cycles: closure, continuity, stance and support force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from leg_dynamics.analysis.trajectories import GaitCycle, gait_cycle, quintic, repeat, seam
from leg_dynamics.errors import NonFiniteError, ShapeError, TrajectoryError

START, STEP, LIFT = (0.0, -0.05, 0.4), (0.02, 0.1, 0.0), (0.0, 0.0, -0.05)


@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.sampled_from(["minimum_jerk", "uniform"]))
@settings(max_examples=15, deadline=None)
def test_every_cycle_closes_with_continuous_acceleration(swing, stance, how):
    cycle = gait_cycle(START, STEP, LIFT, swing, stance, stance=how)
    assert cycle.duration == pytest.approx(swing + stance)
    assert cycle.duty_factor == pytest.approx(stance / (swing + stance))
    scale = np.abs(cycle.curve.foot_path(times=np.linspace(0.0, cycle.curve.end_time, 50)).acceleration).max()
    assert seam(cycle.curve).worst() < 1e-11 * (1.0 + scale)
    assert repeat(cycle.curve, 2).jumps(2, 1e-9) == ()


def test_swing_lifts_and_stance_stays_on_the_ground():
    cycle = gait_cycle(START, STEP, LIFT, 1.0)
    np.testing.assert_allclose(cycle.curve.value(0.5), [0.01, 0.0, 0.35], atol=1e-15)
    np.testing.assert_allclose(cycle.curve.value(1.0), [0.02, 0.05, 0.4], atol=1e-15)
    stance = cycle.curve.value(np.linspace(1.0, 2.0, 21))
    np.testing.assert_allclose(stance[:, 2], 0.4, atol=1e-15)
    # Back on a straight line.
    np.testing.assert_allclose(stance[:, 0], 0.02 * (stance[:, 1] + 0.05) / 0.1, atol=1e-15)


def test_uniform_stance_has_constant_velocity():
    cycle = gait_cycle(START, STEP, LIFT, 0.5, 2.0, stance="uniform")
    velocity = cycle.curve.value(np.linspace(0.5, 2.5, 21), 1)
    np.testing.assert_allclose(velocity, [[-0.01, -0.05, 0.0]] * 21, atol=1e-14)


def test_stance_and_support_force():
    cycle = gait_cycle(START, STEP, LIFT, 1.0, 2.0)
    times = np.array([0.0, 0.5, 0.999, 1.0, 2.9, 3.0, 3.5, 4.0, 3.0 * 7 + 0.5, 3.0 * 7 + 1.5])
    expected = [True, False, False, True, True, True, False, True, False, True]
    np.testing.assert_array_equal(cycle.in_stance(times), expected)
    force = cycle.support_force(times, (0.0, 0.0, -44.4))
    np.testing.assert_array_equal(force[:, 2], np.where(expected, -44.4, 0.0))
    # Usable as a path's force.
    path = cycle.curve.foot_path(10.0)
    assert path.with_foot_force(cycle.support_force(path.time, (0.0, 0.0, -1.0))).foot_force.sum() == -22.0
    with pytest.raises(ShapeError, match="three components"):
        cycle.support_force(times, (1.0, 2.0))


def test_open_cycles_are_refused():
    swing = quintic(START, (0.0, 0.05, 0.4), 1.0)
    with pytest.raises(TrajectoryError, match="do not join"):
        GaitCycle(swing, quintic(START, START, 1.0))
    with pytest.raises(TrajectoryError, match="'gait' is not periodic"):
        GaitCycle(swing, quintic((0.0, 0.05, 0.4), (0.0, 0.0, 0.4), 1.0))
    with pytest.raises(ShapeError, match="three coordinates"):
        GaitCycle(quintic([0.0], [1.0], 1.0), quintic([1.0], [0.0], 1.0))


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"start": (0.0, 0.0)}, ShapeError, "start has shape"),
        ({"lift": (0.0, 0.0, math.nan)}, NonFiniteError, "lift"),
        ({"swing_duration": 0.0}, TrajectoryError, "swing duration"),
        ({"stance_duration": -1.0}, TrajectoryError, "stance duration"),
        ({"stance": "hop"}, TrajectoryError, '"minimum_jerk" or "uniform"'),
    ],
)
def test_bad_gaits_are_named(change, error, text):
    with pytest.raises(error, match=text):
        gait_cycle(**{"start": START, "step": STEP, "lift": LIFT, "swing_duration": 1.0} | change)
