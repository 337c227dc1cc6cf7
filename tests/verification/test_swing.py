from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from leg_dynamics.routes import load
from leg_dynamics.verification.swing import Swing, energy_drift, free_swing

START = np.array([0.3, -0.2]), np.array([1.0, 0.5])


def test_a_single_pendulum_follows_its_equation():
    text = """<robot name="p"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.3"/><mass value="2"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
      <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
      <limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
    leg = load(text)
    g = np.linalg.norm(leg.gravity)
    swing = free_swing(leg, np.array([0.5]), np.array([1.0]), 2.0)

    def field(_, y):
        return [y[1], -2.0 * g * 0.3 * np.sin(y[0]) / (0.01 + 2.0 * 0.3**2)]

    exact = solve_ivp(field, (0.0, 2.0), [0.5, 1.0], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    np.testing.assert_allclose([swing.q[-1, 0], swing.v[-1, 0]], exact, atol=1e-9)
    assert (swing.seconds, swing.stopped) == (2.0, "")
    assert energy_drift(leg, swing).max() < 1e-10


@pytest.mark.parametrize(("damping", "friction"), [(0.0, 0.0), (0.05, 0.0), (0.05, 0.02)])
def test_energy_is_kept_with_and_without_friction(pendulum, damping, friction):
    leg = load(pendulum(damping, friction))
    swing = free_swing(leg, *START, 1.0)
    assert swing.seconds == 1.0
    drift = energy_drift(leg, swing)
    assert drift.shape == swing.time.shape
    assert drift.max() < 1e-9
    # Friction is compensated, so the motion is that of the leg without it.
    np.testing.assert_allclose(swing.q[-1], free_swing(load(pendulum()), *START, 1.0).q[-1], atol=1e-8)


@pytest.mark.parametrize("method", ["mass_matrix", "potential_energy", "acceleration"])
def test_a_small_error_in_any_part_shows(pendulum, plant, method):
    leg = plant(load(pendulum()), **{method: lambda result, *_: result * (1.0 + 1e-6)})
    assert energy_drift(leg, free_swing(leg, *START, 1.0)).max() > 1e-8


def test_a_swing_into_a_singular_closure_ends_there_and_says_why(four_bar):
    leg = load(four_bar)
    swing = free_swing(leg, np.array([1.0]), np.array([5.0]), 5.0)
    assert 0.0 < swing.seconds < 1.0
    assert "turning = 1.82" in swing.stopped
    assert swing.q[-1, 0] < np.arccos(-0.25)
    early = swing.until(0.5 * swing.seconds)
    assert 0.0 < early.seconds <= 0.5 * swing.seconds
    assert early.stopped == swing.stopped
    assert energy_drift(leg, early).max() < 1e-9


def test_a_start_that_cannot_be_assembled(four_bar):
    leg = load(four_bar)
    swing = free_swing(leg, np.array([3.0]), np.array([1.0]))
    assert swing.seconds == 0.0
    assert swing.stopped
    assert np.isnan(energy_drift(leg, swing)).all()


def test_no_motion_has_no_drift(pendulum):
    leg = load(pendulum())
    rest = Swing(np.array([0.0, 1.0]), np.zeros((2, 2)), np.zeros((2, 2)))
    assert np.isnan(energy_drift(leg, rest)).all()


def test_thinning_keeps_both_ends():
    time = np.linspace(0.0, 2.0, 1001)
    swing = Swing(time, time[:, None], time[:, None], "why")
    few = swing.thinned(50)
    assert len(few.time) == 50
    assert (few.time[0], few.time[-1], few.seconds, few.stopped) == (0.0, 2.0, 2.0, "why")
    assert len(swing.thinned(5000).time) == 1001
    assert swing.until(-1.0).time.tolist() == [0.0]


@pytest.mark.slow
def test_the_formulas_own_swing(closed):
    swing = free_swing(closed, np.radians([30.0, -20.0, 40.0]), np.array([1.0, 2.0, -1.0]))
    assert swing.seconds == 5.0
    assert energy_drift(closed, swing).max() < 1e-9
