"""Trajectories: validation, exact derivatives, force schedules, limits, and the registry."""

from __future__ import annotations

import math
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis import trajectories
from leg_dynamics.analysis.trajectories import Trajectory, force_during, named, omnileg_eq52, sample_times
from leg_dynamics.errors import JointLimitError, NonFiniteError, ShapeError, TrajectoryError

LIMITS = SimpleNamespace(lower=np.radians([-65.0, -65.0, 0.0]), upper=np.radians([65.0, 65.0, 85.0]))
NAMES, UNITS = ("alpha", "beta", "gamma"), ("rad", "rad", "rad")


def still(time, n=2, **more):
    zeros = np.zeros((len(time), n))
    return Trajectory(time, zeros, zeros, zeros, **more)


def test_eq52_at_known_times():
    motion = omnileg_eq52(6.0, 10.0)
    assert len(motion) == 61
    assert motion.duration == 6.0
    at = {t: motion.q[np.flatnonzero(np.isclose(motion.time, t))[0]] for t in (0.0, 1.0, 1.5, 3.0)}
    np.testing.assert_array_equal(at[0.0], 0.0)
    np.testing.assert_allclose(np.degrees(at[1.5]), [30.0, 30.0, 25.0], rtol=1e-15)
    np.testing.assert_allclose(np.degrees(at[1.0]), np.array([30.0, 30.0, 25.0]) * math.sqrt(3.0) / 2.0, rtol=1e-14)
    np.testing.assert_allclose(at[3.0], 0.0, atol=1e-15)
    # The motion starts at full speed: amplitude * pi / 3.
    np.testing.assert_allclose(motion.v[0], np.radians([30.0, 30.0, 25.0]) * math.pi / 3.0, rtol=1e-15)


def test_eq52_derivatives_are_those_of_the_positions():
    # Complex step on the formula itself: an oracle without cancellation.
    h = 1e-30
    motion = omnileg_eq52(6.0, 7.3)
    amplitude = np.radians([30.0, 30.0, 25.0])
    omega = math.pi / 3.0
    v = np.imag(amplitude * np.sin(omega * (motion.time[:, None] + 1j * h))) / h
    a = np.imag(amplitude * omega * np.cos(omega * (motion.time[:, None] + 1j * h))) / h
    np.testing.assert_allclose(motion.v, v, atol=1e-15)
    np.testing.assert_allclose(motion.a, a, atol=1e-15)


def test_eq52_gamma_amplitude_scales_gamma_only():
    printed, other = omnileg_eq52(1.0, 10.0), omnileg_eq52(1.0, 10.0, gamma_amplitude=math.radians(45.0))
    np.testing.assert_array_equal(printed.q[:, :2], other.q[:, :2])
    np.testing.assert_allclose(other.q[1:, 2] / printed.q[1:, 2], 45.0 / 25.0)


def test_default_duration_is_the_papers():
    assert omnileg_eq52().time[-1] == 2.0


def test_arrays_are_private_and_read_only():
    time = np.array([0.0, 1.0])
    motion = still(time)
    time[0] = 5.0
    assert motion.time[0] == 0.0
    for array in (motion.time, motion.q, motion.v, motion.a):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(AttributeError):
        motion.name = "other"


def test_pickle_keeps_everything_and_stays_read_only():
    motion = omnileg_eq52(0.5, 10.0).with_foot_force((1.0, 2.0, 3.0))
    copy = pickle.loads(pickle.dumps(motion))
    for field in ("time", "q", "v", "a", "foot_force"):
        np.testing.assert_array_equal(getattr(copy, field), getattr(motion, field))
        assert not getattr(copy, field).flags.writeable
    assert copy.name == motion.name == "eq52"


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        (([0.0, 0.0], *[np.zeros((2, 1))] * 3), TrajectoryError, "must increase"),
        (([1.0, 0.5], *[np.zeros((2, 1))] * 3), TrajectoryError, "sample 1 at 0.5 s"),
        (([], *[np.zeros((0, 1))] * 3), TrajectoryError, "no sample"),
        (([[0.0]], *[np.zeros((1, 1))] * 3), ShapeError, "time has shape"),
        (([0.0, math.nan], *[np.zeros((2, 1))] * 3), NonFiniteError, "time holds NaN"),
        (([0.0, 1.0], np.zeros((3, 1)), np.zeros((2, 1)), np.zeros((2, 1))), ShapeError, "q has shape"),
        (([0.0, 1.0], np.zeros((2, 1)), np.zeros((2, 2)), np.zeros((2, 1))), ShapeError, "v has shape"),
        (([0.0, 1.0], np.zeros((2, 1)), np.zeros((2, 1)), np.full((2, 1), math.inf)), NonFiniteError, "a holds"),
        (([0.0, 1.0], np.zeros((2, 1)), np.zeros((2, 1)), [["a"], ["b"]]), ShapeError, "a: real numbers only, not str"),
    ],
)
def test_bad_arrays_are_named(arguments, error, text):
    with pytest.raises(error, match=text):
        Trajectory(*arguments)


def test_foot_force_shapes():
    time = [0.0, 1.0, 2.0]
    assert still(time).foot_force is None
    np.testing.assert_array_equal(still(time, foot_force=[1.0, 2.0, 3.0]).foot_force, [[1.0, 2.0, 3.0]] * 3)
    with pytest.raises(ShapeError, match="foot_force has shape"):
        still(time, foot_force=np.zeros((2, 3)))
    with pytest.raises(NonFiniteError, match="foot_force holds"):
        still(time, foot_force=[0.0, math.nan, 0.0])


def test_force_window_includes_both_ends():
    motion = omnileg_eq52(2.0, 10.0).with_foot_force((0.0, -20.0, 20.0), 0.5, 1.0)
    acting = motion.time[motion.foot_force.any(axis=1)]
    assert (acting[0], acting[-1], len(acting)) == (0.5, 1.0, 6)
    np.testing.assert_array_equal(motion.foot_force[10], [0.0, -20.0, 20.0])
    np.testing.assert_array_equal(motion.foot_force[11], 0.0)


@pytest.mark.parametrize(("start", "end", "acting"), [(1.5, None, 6), (None, 0.5, 6)])
def test_half_open_force_window(start, end, acting):
    motion = omnileg_eq52(2.0, 10.0).with_foot_force((0.0, 0.0, 1.0), start, end)
    assert np.count_nonzero(motion.foot_force[:, 2]) == acting


@pytest.mark.parametrize(
    ("force", "window", "error", "text"),
    [
        ((1.0, 2.0, 3.0), (5.0, 6.0), TrajectoryError, "no sample lies in the force window"),
        ((1.0, 2.0, 3.0), (0.51, 0.59), TrajectoryError, "no sample lies in the force window"),
        ((1.0, 2.0, 3.0), (1.0, 0.5), TrajectoryError, "earlier to a later"),
        ((1.0, 2.0, 3.0), (0.0, math.nan), NonFiniteError, "end of the force"),
        ((1.0, 2.0), (0.0, 1.0), ShapeError, "three components"),
        ((1.0, 2.0, math.inf), (0.0, 1.0), NonFiniteError, "force = "),
    ],
)
def test_bad_force_window(force, window, error, text):
    with pytest.raises(error, match=text):
        force_during(np.arange(11) / 10.0, force, *window)


@pytest.mark.parametrize(("duration", "rate", "count"), [(2.0, 1000.0, 2001), (0.3, 10.0, 4), (0.35, 10.0, 4)])
def test_sample_times(duration, rate, count):
    time = sample_times(duration, rate)
    assert len(time) == count
    np.testing.assert_array_equal(time, np.arange(count) / rate)


@pytest.mark.parametrize(
    ("duration", "rate", "text"),
    [
        (0.0, 10.0, "duration"),
        (-1.0, 10.0, "duration"),
        (math.nan, 10.0, "duration"),
        (1.0, 0.0, "rate"),
        (1.0, math.inf, "rate"),
        (1e9, 1e9, "more than the limit"),
    ],
)
def test_bad_sampling(duration, rate, text):
    with pytest.raises(TrajectoryError, match=text):
        sample_times(duration, rate)


def test_limits_hold_over_the_papers_two_seconds():
    omnileg_eq52(2.0, 100.0).check_limits(LIMITS, NAMES, UNITS)


def test_limits_name_joint_time_and_excess():
    motion = omnileg_eq52(6.0, 10.0)
    with pytest.raises(JointLimitError, match=r"at t = 3\.1 s: gamma = -0\.0456\d* rad is outside \[0, ") as caught:
        motion.check_limits(LIMITS, NAMES, UNITS)
    # 3.0 and 6.0 s are zero up to rounding, so inside; everything between is not.
    np.testing.assert_array_equal(caught.value.rows, np.arange(31, 60))
    np.testing.assert_allclose(caught.value.margin, motion.q[31:60, 2])


def test_registry_knows_only_trajectory_modules():
    assert next(iter(named("omnileg"))) == "eq52"
    assert named("omnileg")["eq52_45deg"](0.1, 10.0).name == "eq52_45deg"
    for name in ("no_such_leg", "csv_file", "", "../omnileg", "os"):
        assert not named(name)


def test_a_new_leg_is_a_new_file(tmp_path, monkeypatch):
    (tmp_path / "pendulum_for_test.py").write_text("TRAJECTORIES = {'swing': lambda duration=None, rate=1.0: rate}\n")
    monkeypatch.setattr(trajectories, "__path__", [*trajectories.__path__, str(tmp_path)])
    assert named("pendulum_for_test")["swing"](rate=3.0) == 3.0


def test_repr_says_what_it_is():
    assert repr(omnileg_eq52(1.0, 10.0)) == "<Trajectory 'eq52': 11 samples of 3 coordinates, 0 to 1 s>"
    assert "force on the foot" in repr(omnileg_eq52(1.0, 10.0).with_foot_force((0.0, 0.0, 1.0)))


@pytest.mark.parametrize(
    ("leg", "place", "words", "module"),
    [
        ("quadruped_leg", 2, "(theta3 is a joint of module 'm01')", "m01"),
        ("omnileg", 0, "have the limits ignored", None),
    ],
)
def test_limits_of_a_leg_name_the_module_where_there_is_one(leg, place, words, module):
    model = ld.load(leg)
    q = np.zeros((3, 3))
    q[:, 2] = 0.5 if leg == "omnileg" else -0.5
    q[1, place] = -1.3
    motion = Trajectory(np.arange(3.0), q, 0.0 * q, 0.0 * q)
    with pytest.raises(JointLimitError) as raised:
        motion.check_limits_of(model)
    assert str(raised.value).endswith(words)
    assert raised.value.joint == model.joint_names[place]
    assert raised.value.evidence.get("module") == module
