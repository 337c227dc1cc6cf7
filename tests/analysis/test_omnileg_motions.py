"""The motions of Xu et al. 2025: the printed polynomials, golden poses, peaks, and the command line's names."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.trajectories import (
    Trajectory,
    named,
    named_cycle,
    omnileg_eq51,
    omnileg_eq51_path,
    omnileg_eq52,
    omnileg_eq53,
    omnileg_eq53_cycle,
)
from leg_dynamics.errors import (
    JointLimitError,
    NonFiniteError,
    OutOfReachError,
    SingularityError,
    TrajectoryError,
)

TIMES = np.linspace(0.0, 5.0, 101)


@pytest.fixture(scope="module")
def leg():
    return ld.load("omnileg")


def printed_eq51(t, T=5.0):
    s = np.where(t <= 2.5, t, T - t)
    X = 0.1 * (0.06144 * s**5 - 0.384 * s**4 + 0.64 * s**3)
    Y = 0.1 * (0.00192 * t**5 - 0.024 * t**4 + 0.08 * t**3)
    Z = 0.05 * (-0.004096 * t**6 + 0.06144 * t**5 - 0.3072 * t**4 + 0.512 * t**3)
    return X, Y, Z


def test_eq51_is_the_printed_polynomial():
    X, Y, Z = printed_eq51(TIMES)
    np.testing.assert_allclose(omnileg_eq51_path().value(TIMES), np.stack([X, Y, 0.42 - Z], axis=1), atol=1e-14)
    literal = omnileg_eq51_path(0.35, z_sign="literal").value(TIMES)
    np.testing.assert_allclose(literal, np.stack([X, Y, 0.35 + Z], axis=1), atol=1e-14)


def test_eq51_derivatives_are_those_of_finite_differences():
    path, t, h = omnileg_eq51_path(), np.linspace(0.013, 4.987, 60), 1e-5
    for order in range(3):
        difference = (path.value(t + h, order) - path.value(t - h, order)) / (2.0 * h)
        np.testing.assert_allclose(path.value(t, order + 1), difference, atol=1e-8)


def test_eq51_peaks():
    path = omnileg_eq51_path().foot_path(1000.0)
    lifted = np.abs(path.position - [0.0, 0.0, 0.42])
    np.testing.assert_allclose(lifted.max(axis=0), [0.1, 0.1, 0.05], atol=1e-14)
    np.testing.assert_allclose(path.time[lifted.argmax(axis=0)], [2.5, 5.0, 2.5])
    np.testing.assert_allclose(np.abs(path.velocity).max(axis=0), [0.075, 0.0375, 0.03435], atol=5e-6)
    np.testing.assert_allclose(np.abs(path.acceleration).max(axis=0), [0.0924, 0.0231, 0.0480], atol=5e-5)
    assert np.linalg.norm(path.velocity, axis=1).max() == pytest.approx(0.0851, abs=5e-5)
    assert np.linalg.norm(path.acceleration, axis=1).max() == pytest.approx(0.1016, abs=5e-5)
    assert np.hypot(path.position[:, 0], path.position[:, 1]).max() == pytest.approx(0.1165, abs=5e-5)


def test_eq51_jerk_jumps_in_the_middle_only():
    (jump,) = omnileg_eq51_path().jumps(3)
    assert jump.time == 2.5
    np.testing.assert_allclose([jump.left[0], jump.right[0]], [0.384, -0.384], rtol=1e-12)
    np.testing.assert_allclose(jump.jump[1:], 0.0, atol=1e-12)
    assert omnileg_eq51_path().jumps(2) == ()


def test_eq51_golden_poses(leg):
    motion = omnileg_eq51(leg, rate=100.0)
    assert (motion.name, motion.time[-1]) == ("eq51", 5.0)
    golden = {1.25: (-4.1976, 19.5196, 58.9975), 2.5: (-26.5651, 45.0, 54.6235), 5.0: (-41.8103, 0.0, 38.7411)}
    for time, angles in golden.items():
        np.testing.assert_allclose(np.degrees(motion.q[round(time * 100)]), angles, atol=1e-4)
    low, high = np.degrees(motion.q.min(axis=0)), np.degrees(motion.q.max(axis=0))
    np.testing.assert_allclose(low, [-41.81, 0.0, 38.74], atol=5e-3)
    np.testing.assert_allclose(high, [0.0, 46.03, 59.13], atol=5e-3)
    assert np.linalg.cond(leg.jacobian(motion.q)).max() < 3.21
    # From rest to rest.
    np.testing.assert_allclose(motion.v[[0, -1]], 0.0, atol=1e-13)
    np.testing.assert_allclose(motion.a[[0, -1]], 0.0, atol=1e-12)


def test_eq51_time_stretches():
    slow, printed = omnileg_eq51_path(duration=10.0), omnileg_eq51_path()
    np.testing.assert_allclose(slow.value(2.0 * TIMES), printed.value(TIMES), atol=1e-15)
    np.testing.assert_allclose(slow.value(2.0 * TIMES, 2), printed.value(TIMES, 2) / 4.0, atol=1e-15)


def test_eq51_outside_its_window_says_the_window(leg):
    with pytest.raises(OutOfReachError, match=r"at t = 2\.\d+ s: .*z in \[0\.3391, 0\.4618\] m are feasible") as caught:
        omnileg_eq51(leg, rate=100.0, z0=0.5)
    (window,) = caught.value.windows
    assert window.upper == pytest.approx(0.4618 - 0.5, abs=5e-5)
    with pytest.raises(JointLimitError, match=r"gamma = .*z in \[0\.3391, 0\.4618\] m"):
        omnileg_eq51(leg, rate=100.0, z0=0.33)
    with pytest.raises(OutOfReachError, match=r"z in \[0\.3266, 0\.3971\] m"):
        omnileg_eq51(leg, rate=100.0, z_sign="literal")
    # Without limits the lower end is farther down.
    assert np.degrees(omnileg_eq51(leg, rate=100.0, z0=0.33, limits="ignore").q[:, 2].max()) > 85.0
    with pytest.raises(OutOfReachError, match=r"no height in z makes the whole path feasible"):
        omnileg_eq53(leg, rate=10.0, cycle=omnileg_eq53_cycle(start=(0.2, 0.0)))
    for z0 in (0.3392, 0.4617):
        assert len(omnileg_eq51(leg, rate=100.0, z0=z0)) == 501


def test_eq51_to_the_straight_leg_is_singular(leg):
    with pytest.raises(SingularityError, match=r"t = 5 s: .*singular value") as caught:
        omnileg_eq51(leg, rate=10.0, z0=0.35 + math.sqrt(0.15**2 - 0.1**2) - 1e-15)
    assert caught.value.time == 5.0


def test_eq51_durations(leg):
    assert omnileg_eq51(leg, 2.0, 10.0).time[-1] == 2.0
    with pytest.raises(TrajectoryError, match="lasts 5 s and does not repeat"):
        omnileg_eq51(leg, 5.1, 10.0)


def test_bad_parameters_are_named():
    for make in (omnileg_eq51_path, omnileg_eq53_cycle):
        with pytest.raises(TrajectoryError, match="z_sign is"):
            make(z_sign="down")
        with pytest.raises(NonFiniteError, match="z0"):
            make(math.nan)
    with pytest.raises(TrajectoryError, match="duration"):
        omnileg_eq51_path(duration=0.0)


def test_eq52_golden_foot_motion(leg):
    motion = omnileg_eq52(6.0, 100.0)
    p = leg.foot_position(motion.q)
    np.testing.assert_allclose(p[100], [0.060188, -0.060188, 0.460106], atol=1e-6)
    np.testing.assert_allclose(np.abs(p[:, :2]).max(axis=0), 0.06708, atol=5e-6)
    np.testing.assert_allclose([p[:, 2].min(), p[:, 2].max()], [0.44839, 0.5], atol=5e-6)
    v0 = leg.foot_velocity(motion.q[0], motion.v[0])
    a0 = leg.foot_acceleration(motion.q[0], motion.v[0], motion.a[0])
    np.testing.assert_allclose(v0, [0.082247, -0.082247, 0.0], atol=5e-7)
    np.testing.assert_allclose(a0, [0.0, 0.0, -0.129862], atol=5e-7)


def test_eq52_at_45_deg_spans_more_height(leg):
    motion = omnileg_eq52(6.0, 100.0, gamma_amplitude=math.radians(45.0))
    z = leg.foot_position(motion.q)[:, 2]
    assert np.ptp(z) == pytest.approx(0.08946, abs=5e-6)


def printed_eq53(t, L, H, L_h, T):
    step = 6.0 * t**5 / T**5 - 15.0 * t**4 / T**4 + 10.0 * t**3 / T**3
    Z = H * (-64.0 * t**6 / T**6 + 192.0 * t**5 / T**5 - 192.0 * t**4 / T**4 + 64.0 * t**3 / T**3)
    return np.stack([L_h * step, L * step, Z], axis=1)


def test_eq53_is_the_printed_polynomial_forth_and_back():
    t = np.linspace(0.0, 1.0, 41)
    curve = omnileg_eq53_cycle().curve
    np.testing.assert_allclose(
        curve.value(t), np.array([0.0, 0.0, 0.42]) + printed_eq53(t, 0.1, -0.05, 0.0, 1.0), atol=1e-15
    )
    back = np.array([0.0, 0.1, 0.42]) + printed_eq53(t, -0.1, 0.0, 0.0, 1.0)
    np.testing.assert_allclose(curve.value(1.0 + t), back, atol=1e-15)
    other = omnileg_eq53_cycle(
        0.4, step=0.06, height=0.03, lateral_step=0.04, half_cycle=0.5, start=(0.01, -0.03), z_sign="literal"
    )
    expected = np.array([0.01, -0.03, 0.4]) + printed_eq53(t / 2.0, 0.06, 0.03, 0.04, 0.5)
    np.testing.assert_allclose(other.curve.value(t / 2.0), expected, atol=1e-15)
    assert other.duration == 1.0


def test_eq53_peaks():
    path = omnileg_eq53_cycle().curve.foot_path(2000.0)
    np.testing.assert_allclose(np.abs(path.velocity).max(axis=0), [0.0, 0.1875, 0.172], atol=5e-4)
    np.testing.assert_allclose(np.abs(path.acceleration).max(axis=0), [0.0, 0.577, 1.2], atol=5e-4)


def test_eq53_repeats_over_three_cycles(leg):
    motion = omnileg_eq53(leg, 6.0, 50.0)
    assert (motion.name, len(motion)) == ("eq53", 301)
    for values in (motion.q, motion.v, motion.a):
        np.testing.assert_allclose(values[:101], values[200:], atol=1e-10)
    # Along Y, beta never moves.
    np.testing.assert_allclose(motion.q[:, 1], 0.0, atol=1e-15)
    assert len(omnileg_eq53(leg, rate=50.0)) == 101
    centred = omnileg_eq53_cycle(0.474, start=(0.0, -0.05))
    assert omnileg_eq53(leg, 0.5, 50.0, cycle=centred).time[-1] == 0.5


def test_registry_binds_a_leg_to_foot_paths(leg):
    motions = named(leg)
    assert list(motions) == list(named("omnileg"))
    assert {"eq51", "eq52", "eq52_45deg", "eq53"} <= set(motions)
    for name, factory in motions.items():
        motion = factory(0.5, 20.0)
        assert isinstance(motion, Trajectory)
        assert (motion.name, motion.time[-1]) == (name, 0.5)
    assert motions["eq51"]().time[-1] == 5.0
    assert motions["eq53"](7.0, 10.0).time[-1] == 7.0
    np.testing.assert_allclose(np.degrees(motions["eq52_45deg"](1.5, 2.0).q[-1]), [30.0, 30.0, 45.0])
    for name in ("eq51", "eq53"):
        with pytest.raises(TrajectoryError, match=rf"'{name}' is a path of the foot"):
            named("omnileg")[name](1.0, 10.0)
    assert pickle.loads(pickle.dumps(motions["eq53"]))(0.1, 10.0).name == "eq53"


def test_registry_can_ignore_limits():
    # Longer shanks lower the foot: gamma = 85 deg no longer suffices.
    longer = ld.load("omnileg").replace(L4=0.14)
    assert named(longer)["eq51"](5.0, 10.0).q[:, 2].max() > 0.0
    short = ld.load("omnileg").replace(L5=0.245)
    with pytest.raises(JointLimitError, match="gamma"):
        named(short)["eq51"](5.0, 10.0)
    assert np.degrees(named(short, limits="ignore")["eq51"](5.0, 10.0).q[:, 2].max()) > 85.0


def test_registry_knows_the_gait_behind_a_trajectory(leg):
    for owner in (leg, "omnileg"):
        cycle = named_cycle(owner, "eq53")
        np.testing.assert_array_equal(cycle.curve.coefficients, omnileg_eq53_cycle().curve.coefficients)
        assert [named_cycle(owner, name) for name in ("eq51", "eq52", "no_such")] == [None] * 3
    assert named_cycle("no_such", "eq53") is None


def test_no_motion_has_two_names():
    motions = named(ld.load("omnileg"))
    assert list(motions) == ["eq52", "eq52_45deg", "eq51", "eq53"]
    ends = {factory(1.3, 10.0).q[-1].tobytes() for factory in motions.values()}
    assert len(ends) == len(motions)
