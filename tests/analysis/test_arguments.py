"""What is no number, no motion or no leg is refused by name, never computed with and never a traceback of a library."""

from __future__ import annotations

import decimal
import fractions
import math

import numpy as np
import pytest

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.trajectories import (
    FootPath,
    PiecewisePolynomial,
    Trajectory,
    blend,
    check_periodic,
    concatenate,
    connect,
    feasible_offset_windows,
    follow,
    force_during,
    from_csv,
    gait_cycle,
    jerk_jumps,
    minimum_jerk,
    named,
    omnileg_eq51_path,
    omnileg_eq52,
    omnileg_eq53,
    omnileg_eq53_cycle,
    quintic,
    repeat,
    resample,
    sample_times,
    seam,
    time_scale,
)
from leg_dynamics.errors import LegDynamicsError, NonFiniteError, ShapeError, TrajectoryError

from .toy_legs import Polar

CURVE = quintic([0.0, 0.5, 0.4], [0.1, 0.0, 0.5], 1.0)
MOTION = CURVE.trajectory(10.0)
PATH = CURVE.foot_path(10.0)
CYCLE = omnileg_eq53_cycle()
POSE = Trajectory([0.0], [[1.0]], [[0.0]], [[0.0]])
FORCE = (0.0, 0.0, -1.0)


class Unreadable:
    """Neither a number nor a motion nor a leg."""

    def __str__(self):
        return "unreadable"


NUMBERS = {
    "sample_times": lambda x: sample_times(x, 10.0),
    "sample_times, rate": lambda x: sample_times(1.0, x),
    "force_during, start": lambda x: force_during([0.0, 1.0], FORCE, x, 1.0),
    "force_during, end": lambda x: force_during([0.0, 1.0], FORCE, 0.0, x),
    "with_foot_force, start": lambda x: MOTION.with_foot_force(FORCE, x, 1.0),
    "quintic, duration": lambda x: quintic([0.0], [1.0], x),
    "quintic, start_time": lambda x: quintic([0.0], [1.0], 1.0, start_time=x),
    "minimum_jerk, end_velocity": lambda x: minimum_jerk([[0.0], [1.0]], [0.0, 1.0], end_velocity=x),
    "minimum_jerk, time": lambda x: minimum_jerk([[0.0], [1.0]], [0.0, x]),
    "value": CURVE.value,
    "jumps, order": CURVE.jumps,
    "jumps, tolerance": lambda x: CURVE.jumps(3, x),
    "trajectory, rate": lambda x: CURVE.trajectory(x, times=[0.0]),
    "trajectory, times": lambda x: CURVE.trajectory(times=[x]),
    "translated": lambda x: CURVE.translated([0.0, 0.0, x]),
    "through_samples": lambda x: PiecewisePolynomial.through_samples([0.0, x], [[0.0]] * 2, [[0.0]] * 2, [[0.0]] * 2),
    "breaks": lambda x: PiecewisePolynomial([0.0, x], [[[1.0]]]),
    "coefficients": lambda x: PiecewisePolynomial([0.0, 1.0], [[[x]]]),
    "Trajectory": lambda x: Trajectory([0.0], [[x]], [[0.0]], [[0.0]]),
    "time_scale": lambda x: time_scale(MOTION, x),
    "time_scale of a curve": lambda x: time_scale(CURVE, x),
    "resample, times": lambda x: resample(MOTION, times=[x]),
    "resample, rate": lambda x: resample(MOTION, x),
    "blend": lambda x: blend(MOTION, MOTION, x),
    "connect": lambda x: connect(MOTION, MOTION, x),
    "connect, rate": lambda x: connect(MOTION, MOTION, 1.0, x),
    "repeat": lambda x: repeat(omnileg_eq52(6.0, 10.0), x),
    "jerk_jumps of a curve": lambda x: jerk_jumps(omnileg_eq51_path(), x),
    "jerk_jumps of samples": lambda x: jerk_jumps(MOTION, x),
    "check_periodic": lambda x: check_periodic(omnileg_eq52(6.0, 10.0), tolerance=x),
    "concatenate": lambda x: concatenate(MOTION, time_scale(MOTION, 1.0), tolerance=x),
    "in_stance": lambda x: CYCLE.in_stance([x]),
    "support_force, time": lambda x: CYCLE.support_force([x], FORCE),
    "support_force, force": lambda x: CYCLE.support_force([1.5], (0.0, 0.0, x)),
    "gait_cycle, step": lambda x: gait_cycle((0.0, 0.0, 0.4), (x, 0.0, 0.0), (0.0, 0.0, -0.1), 1.0),
    "gait_cycle, swing": lambda x: gait_cycle((0.0, 0.0, 0.4), (0.1, 0.0, 0.0), (0.0, 0.0, -0.1), x),
    "eq51, z0": omnileg_eq51_path,
    "eq51, duration": lambda x: omnileg_eq51_path(duration=x),
    "eq52, amplitude": lambda x: omnileg_eq52(gamma_amplitude=x),
    "eq52, duration": lambda x: omnileg_eq52([x]),
    "eq53, step": lambda x: omnileg_eq53_cycle(step=x),
    "eq53, half cycle": lambda x: omnileg_eq53_cycle(half_cycle=x),
    "eq53, start": lambda x: omnileg_eq53_cycle(start=(0.0, x)),
    "windows, direction": lambda x: feasible_offset_windows(Polar(), CURVE, (0.0, 0.0, x)),
    "windows, search": lambda x: feasible_offset_windows(Polar(), CURVE, search=(0.0, x)),
    "windows, scan": lambda x: feasible_offset_windows(Polar(), CURVE, scan=x),
    "follow, duration": lambda x: follow(Polar(), CURVE, [x]),
    "follow, rate": lambda x: follow(Polar(), CURVE, 1.0, x),
}


@pytest.mark.parametrize(
    "value", ["1", "one", Unreadable(), math.nan, -math.inf, 1.0 + 1.0j, 10**400], ids=lambda value: str(value)[:12]
)
@pytest.mark.parametrize("call", NUMBERS.values(), ids=NUMBERS)
def test_what_is_no_finite_number_is_refused(call, value):
    with pytest.raises(LegDynamicsError) as caught:
        call(value)
    assert isinstance(caught.value, ShapeError | NonFiniteError | TrajectoryError)


@pytest.mark.parametrize("call", [NUMBERS[name] for name in NUMBERS if "windows, s" not in name and "rate" not in name])
def test_none_is_no_number(call):
    try:
        call(None)
    except LegDynamicsError:
        return
    # Where None has a meaning of its own: the default.
    assert call in [NUMBERS[name] for name in ("with_foot_force, start", "jerk_jumps of a curve", "eq52, duration")]


MOTIONS = {
    "seam": seam,
    "check_periodic": check_periodic,
    "repeat": lambda x: repeat(x, 2),
    "time_scale": lambda x: time_scale(x, 2.0),
    "concatenate": lambda x: concatenate(x, x),
    "resample": lambda x: resample(x, 10.0),
    "blend": lambda x: blend(x, x, 0.1),
    "connect": lambda x: connect(x, x, 1.0),
    "jerk_jumps": lambda x: jerk_jumps(x, 1.0),
}


@pytest.mark.parametrize("value", [None, 5, "eq52", [MOTION], Unreadable()])
@pytest.mark.parametrize("call", MOTIONS.values(), ids=MOTIONS)
def test_what_is_no_motion_is_refused(call, value):
    with pytest.raises(ShapeError, match=f"motion is a .*, not {type(value).__name__}"):
        call(value)


@pytest.mark.parametrize("name", ["blend", "connect", "resample"])
def test_what_needs_samples_says_how_to_take_them(name):
    with pytest.raises(ShapeError, match="not PiecewisePolynomial; sample the curve first"):
        MOTIONS[name](CURVE)


LEGS = {
    "to_joint": PATH.to_joint,
    "feasible_offset_windows": lambda leg: feasible_offset_windows(leg, CURVE),
    "omnileg_eq53": omnileg_eq53,
    "follow": lambda leg: follow(leg, CURVE),
    "from_csv": lambda leg: from_csv("motion.csv", leg),
}


@pytest.mark.parametrize("leg", [None, 5, "omnileg", MOTION])
@pytest.mark.parametrize("call", LEGS.values(), ids=LEGS)
def test_what_is_no_leg_is_refused(call, leg):
    with pytest.raises(ShapeError, match=rf"{type(leg).__name__} is no leg: .*leg_dynamics\.load"):
        call(leg)


def test_other_wrong_objects_are_named():
    with pytest.raises(ShapeError, match="cycle is a GaitCycle, not int; omnileg_eq53_cycle makes one"):
        omnileg_eq53(Polar(), cycle=5)
    for call in (lambda path: feasible_offset_windows(Polar(), path), lambda path: follow(Polar(), path)):
        for path in (None, PATH):
            with pytest.raises(ShapeError, match=f"path is a PiecewisePolynomial, not {type(path).__name__}"):
                call(path)
    with pytest.raises(ShapeError, match="NoneType is no leg: it has no name"):
        named(None)
    with pytest.raises(ShapeError, match="the swing is a PiecewisePolynomial, not Trajectory"):
        type(CYCLE)(MOTION, CURVE)
    with pytest.raises(ShapeError, match="path of a CSV file is a str or PathLike, not NoneType"):
        from_csv(None, type("Leg", (), {"joint_names": (), "units": None, "limits": None})())
    with pytest.raises(ShapeError, match="NoneType is no joint limits"):
        MOTION.check_limits(None, ("a", "b", "c"), ("rad",) * 3)
    with pytest.raises(TrajectoryError, match="limits must be"):
        PATH.to_joint(Polar(), limits=["error"])
    with pytest.raises(ShapeError, match="the name of a motion is a text, not int 5"):
        Trajectory([0.0], [[0.0]], [[0.0]], [[0.0]], name=5)
    with pytest.raises(ShapeError, match="the name of a curve is a text"):
        quintic([0.0], [1.0], 1.0, name=None)


def test_wrong_shapes_are_told_by_what_is_wrong():
    plane = quintic([0.0, 0.0], [1.0, 1.0], 1.0, name="plane")
    with pytest.raises(ShapeError, match=r"a path of the foot has three coordinates.* but 'plane' has 2"):
        feasible_offset_windows(Polar(), plane)
    with pytest.raises(ShapeError, match=r"^start has shape \(1,\); give two components, m$"):
        omnileg_eq53_cycle(start=(0.0,))


def test_a_jump_of_the_jerk_is_not_lost_to_a_bad_threshold():
    path = omnileg_eq51_path()
    (jump,) = jerk_jumps(path, 0.1)
    np.testing.assert_allclose(np.abs(jump.jump), [0.768, 0.0, 0.0], atol=1e-12)
    for threshold in (math.nan, 0.0, -1.0):
        with pytest.raises(TrajectoryError, match="least jump of the jerk"):
            jerk_jumps(path, threshold)
    for tolerance in (math.nan, -1.0, math.inf):
        with pytest.raises(TrajectoryError, match="the tolerance is"):
            path.jumps(3, tolerance)
    assert len(path.jumps(3, 0.0)) == 1


def test_a_rate_beside_times_is_refused():
    for sample in (CURVE.trajectory, CURVE.foot_path):
        with pytest.raises(TrajectoryError, match="either the rate or the times"):
            sample(5, times=[0.0, 0.5])
        assert len(sample()) == 1001


def test_a_pose_is_no_period():
    with pytest.raises(TrajectoryError, match="one sample only"):
        repeat(POSE, 2)
    with pytest.raises(TrajectoryError, match="one sample only"):
        concatenate(POSE, POSE)
    assert repeat(POSE, 1).duration == 0.0


def test_complex_numbers_keep_their_imaginary_part_out():
    with pytest.raises(ShapeError, match="q: real numbers only, not complex"):
        Trajectory([0.0], np.array([[1.0 + 1.0j]]), [[0.0]], [[0.0]])
    with pytest.raises(ShapeError, match="foot_force: real numbers only"):
        FootPath([0.0], [[0.0] * 3], [[0.0] * 3], [[0.0] * 3]).with_foot_force([0.0, 0.0, 1.0j])


def test_support_force_of_one_time():
    np.testing.assert_array_equal(CYCLE.support_force(1.5, FORCE), FORCE)
    np.testing.assert_array_equal(CYCLE.support_force(0.5, FORCE), np.zeros(3))
    assert CYCLE.support_force([[0.5, 1.5]], FORCE).shape == (1, 2, 3)


@pytest.mark.parametrize("motion", [MOTION, PATH, CURVE])
@pytest.mark.parametrize("speed", [1e200, 1e-320, 1e308])
def test_extreme_speed_factors_are_named(motion, speed):
    with pytest.raises(TrajectoryError, match="takes 'quintic' out of the range of floating-point numbers"):
        time_scale(motion, speed)


def test_truth_values_are_no_numbers():
    for call in (lambda: arguments.real("value", True), lambda: arguments.reals("values", np.array([True]))):
        with pytest.raises(ShapeError, match="not bool"):
            call()
    with pytest.raises(TrajectoryError, match="whole number"):
        repeat(omnileg_eq52(6.0, 10.0), True)


def test_every_kind_of_number_counts():
    for value in (2, np.float32(2.0), np.int8(2), np.array(2.0), fractions.Fraction(2), decimal.Decimal(2)):
        assert arguments.real("value", value) == 2.0
        np.testing.assert_array_equal(arguments.reals("values", [value, 1.0]), [2.0, 1.0])
    given = np.ones(2)
    assert arguments.reals("values", given) is not given
    assert arguments.reals("values", []).shape == (0,)
    assert arguments.whole("count", np.int64(3), 1, 5) == 3
