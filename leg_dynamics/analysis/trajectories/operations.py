"""Joins, repeats, stretches, resamples and blends motions, and says where they are not smooth.

A motion is a `Trajectory` (joint space), a `FootPath` (foot space) or, where no samples are needed, a
`PiecewisePolynomial`. Nothing here looks at joint limits or reach: check the result.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.trajectories.foot_path import FootPath
from leg_dynamics.analysis.trajectories.polynomial import DerivativeJump, PiecewisePolynomial, quintic
from leg_dynamics.analysis.trajectories.trajectory import MAX_SAMPLES, Trajectory, sample_times
from leg_dynamics.errors import NonFiniteError, ShapeError, TrajectoryError

__all__ = [
    "Seam",
    "blend",
    "check_periodic",
    "concatenate",
    "connect",
    "jerk_jumps",
    "repeat",
    "resample",
    "seam",
    "time_scale",
]

Sampled = TypeVar("Sampled", Trajectory, FootPath)
Motion = TypeVar("Motion", bound="Trajectory | FootPath | PiecewisePolynomial")
Array = NDArray[np.float64]

SAMPLED = (Trajectory, FootPath)
MOTIONS = (*SAMPLED, PiecewisePolynomial)

CONTINUITY = ("position", "velocity", "acceleration")


@dataclass(frozen=True, eq=False)
class Seam:
    """What jumps where one motion ends and another (or the same one again) starts: start minus end.

    Attributes
    ----------
    position, velocity, acceleration : numpy.ndarray, shape (d,)
        rad or m, and per second, and per second squared.
    """

    position: Array
    velocity: Array
    acceleration: Array

    def worst(self, order: str = "acceleration") -> float:
        """Largest jump among the position and its derivatives up to `order`."""
        names = CONTINUITY[: _continuity_order(order) + 1]
        return max(float(np.abs(getattr(self, name)).max()) for name in names)


def seam(motion: Trajectory | FootPath | PiecewisePolynomial) -> Seam:
    """Jumps from the end of a motion back to its own start; all zero where it is periodic."""
    _check_kinds(motion)
    return _seam_between(motion, motion)


def check_periodic(
    motion: Trajectory | FootPath | PiecewisePolynomial, *, continuity: str = "acceleration", tolerance: float = 1e-6
) -> Seam:
    """Refuse a motion that cannot be repeated smoothly.

    Parameters
    ----------
    motion : Trajectory, FootPath or PiecewisePolynomial
        One period, both of its ends included.
    continuity : {"position", "velocity", "acceleration"}
        Highest derivative that must not jump.
    tolerance : float
        In SI units of each.

    Returns
    -------
    Seam
        What little it jumps.

    Raises
    ------
    TrajectoryError
        With the jump.
    """
    found = seam(motion)
    _refuse_jump(found, f"{motion.name!r} is not periodic: from its end to its start", continuity, tolerance)
    return found


def concatenate(
    first: Motion, *rest: Motion, continuity: str = "velocity", tolerance: float = 1e-6, name: str | None = None
) -> Motion:
    """Play motions one after the other.

    Each starts when the one before it ends, whatever its own first time is. Of the two samples at a joint the
    earlier motion's is kept (the acceleration and the force may jump there). Where only some have a force on the
    foot, it is zero in the others.

    Parameters
    ----------
    first, *rest : Trajectory, FootPath or PiecewisePolynomial
        All of one kind and dimension.
    continuity : {"position", "velocity", "acceleration"}
        Highest derivative that must not jump at a joint.
    tolerance : float
        In SI units of each.
    name : str, optional
        Of the result; the names joined by plus signs where not given.

    Returns
    -------
    Trajectory, FootPath or PiecewisePolynomial

    Raises
    ------
    TrajectoryError
        Something jumps at a joint; see `connect` and `blend`.
    ShapeError
        The motions are of different kinds or dimensions.
    """
    motions: tuple[Trajectory | FootPath | PiecewisePolynomial, ...] = (first, *rest)
    _check_kinds(*motions)
    for motion in motions if rest else ():
        if motion.duration == 0.0:
            raise TrajectoryError(
                f"{motion.name!r} has one sample only, which is a pose and no motion to be joined or repeated; give it "
                "at least two samples"
            )
    for i, (before, after) in enumerate(itertools.pairwise(motions)):
        found = _seam_between(before, after)
        where = f"{before.name!r} and {after.name!r} do not join (motions {i} and {i + 1}): there"
        _refuse_jump(found, where, continuity, tolerance)
    title = " + ".join(motion.name for motion in motions) if name is None else name
    starts = list(itertools.accumulate((motion.duration for motion in motions), initial=_start(first)))
    shifts = [start - _start(motion) for start, motion in zip(starts[:-1], motions, strict=True)]
    if isinstance(first, PiecewisePolynomial):
        curves = cast("tuple[PiecewisePolynomial, ...]", motions)
        terms = max(curve.coefficients.shape[0] for curve in curves)
        pieces = [np.pad(c.coefficients, ((terms - c.coefficients.shape[0], 0), (0, 0), (0, 0))) for c in curves]
        breaks = [first.breaks[:1], *(c.breaks[1:] + shift for c, shift in zip(curves, shifts, strict=True))]
        return cast("Motion", PiecewisePolynomial(np.concatenate(breaks), np.concatenate(pieces, axis=1), title))
    sampled = cast("tuple[Trajectory | FootPath, ...]", motions)
    # The first sample of each later motion coincides with the last one before it.
    skips = [0] + [1] * len(rest)
    time = np.concatenate([m.time[k:] + shift for m, k, shift in zip(sampled, skips, shifts, strict=True)])
    x, v, a = (
        np.concatenate([_coordinates(m)[field][k:] for m, k in zip(sampled, skips, strict=True)]) for field in range(3)
    )
    force = None
    if any(m.foot_force is not None for m in sampled):
        force = np.concatenate([_force(m)[k:] for m, k in zip(sampled, skips, strict=True)])
    return _make(first, time, x, v, a, force, title)


def repeat(motion: Motion, times: int, *, continuity: str = "velocity", tolerance: float = 1e-6) -> Motion:
    """Play a periodic motion several times.

    Parameters
    ----------
    motion : Trajectory, FootPath or PiecewisePolynomial
        One period, both of its ends included.
    times : int
        How often, at least once.
    continuity, tolerance
        As for `concatenate`.

    Returns
    -------
    Trajectory, FootPath or PiecewisePolynomial
        With the same name.

    Raises
    ------
    TrajectoryError
        The motion is not periodic, or `times` is not a positive whole number.
    """
    _check_kinds(motion)
    size = motion.breaks.size if isinstance(motion, PiecewisePolynomial) else len(motion)
    count = arguments.whole("the number of times to repeat a motion", times, 1, max(1, MAX_SAMPLES // size))
    return concatenate(*[motion] * count, continuity=continuity, tolerance=tolerance, name=motion.name)


def time_scale(motion: Motion, speed: float) -> Motion:
    """Play the same path faster or slower.

    Parameters
    ----------
    motion : Trajectory, FootPath or PiecewisePolynomial
        The motion; its first time stays.
    speed : float
        Factor on the speed, positive: rates grow by it, accelerations by its square, the duration shrinks by it.
        The force on the foot stays with its sample.

    Returns
    -------
    Trajectory, FootPath or PiecewisePolynomial
    """
    _check_kinds(motion)
    # A NumPy number overflows to infinity, which the constructors refuse, where a Python one raises.
    factor = np.float64(arguments.positive("speed factor", speed))
    start = _start(motion)
    try:
        with np.errstate(all="ignore"):
            if isinstance(motion, PiecewisePolynomial):
                powers = factor ** np.arange(motion.coefficients.shape[0] - 1.0, -1.0, -1.0)[:, None, None]
                breaks = start + (motion.breaks - start) / factor
                return cast("Motion", PiecewisePolynomial(breaks, motion.coefficients * powers, motion.name))
            x, v, a = _coordinates(motion)
            time = start + (motion.time - start) / factor
            return _make(motion, time, x, v * factor, a * factor**2, motion.foot_force, motion.name)
    except (NonFiniteError, TrajectoryError) as error:
        raise TrajectoryError(
            f"a speed factor of {factor:g} takes {motion.name!r} out of the range of floating-point numbers "
            f"({error.message}); choose one nearer to 1"
        ) from error


def resample(motion: Sampled, rate: float | None = None, *, times: ArrayLike | None = None) -> Sampled:
    """Take a motion at other times.

    Between samples it is the quintic that meets coordinates, rates and accelerations of both neighbours, whose
    derivatives are the new rates and accelerations. The force is interpolated linearly.

    Parameters
    ----------
    motion : Trajectory or FootPath
        At least two samples.
    rate : float, optional
        Samples a second, from the first time on.
    times : array_like, shape (T,), optional
        s, within the motion; in place of `rate`.

    Returns
    -------
    Trajectory or FootPath
    """
    _check_kinds(motion, kinds=SAMPLED)
    if (rate is None) == (times is None):
        raise TrajectoryError("give either the rate or the times of the new samples")
    curve = _curve(motion)
    if times is None:
        t = float(motion.time[0]) + sample_times(motion.duration, cast("float", rate))
    else:
        t = arguments.reals("times", times)
    return _make(motion, t, curve.value(t), curve.value(t, 1), curve.value(t, 2), _force_at(motion, t), motion.name)


def blend(first: Sampled, second: Sampled, duration: float, *, name: str | None = None) -> Sampled:
    """Cross-fade from one motion into another while both go on.

    The second starts `duration` before the first ends. Over that time the result is (1 - s) first + s second with
    the minimum-jerk step s from 0 to 1, so that its acceleration is continuous where theirs are; derivatives are
    exact at the first motion's samples (the second is resampled there). In joint space a blend of motions within
    the joint limits stays within them. Forces on the foot are weighted alike.

    Parameters
    ----------
    first, second : Trajectory or FootPath
        Of one kind and dimension.
    duration : float
        s, positive, at most that of either motion.
    name : str, optional
        Of the result.

    Returns
    -------
    Trajectory or FootPath
    """
    _check_kinds(first, second, kinds=SAMPLED)
    available = min(first.duration, second.duration)
    duration = arguments.number("duration", duration)
    if not 0.0 < duration <= available * (1.0 + 1e-12):
        raise TrajectoryError(
            f"a blend takes more than 0 s and at most the shorter motion's {available:g} s, not {duration:g} s"
        )
    start = float(first.time[-1]) - duration
    shift = start - float(second.time[0])
    overlap = first.time > start
    during = first.time[overlap]
    own = during - shift
    u = (during - start)[:, None] / duration
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    ds = 30.0 * u**2 * (1.0 - u) ** 2 / duration
    dds = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / duration**2
    curve = _curve(second)
    x1, v1, a1 = (values[overlap] for values in _coordinates(first))
    gap, rate_gap, acceleration_gap = curve.value(own) - x1, curve.value(own, 1) - v1, curve.value(own, 2) - a1
    mixed = (
        x1 + s * gap,
        v1 + s * rate_gap + ds * gap,
        a1 + s * acceleration_gap + 2.0 * ds * rate_gap + dds * gap,
    )
    after = second.time + shift > first.time[-1] + 1e-9 * duration
    time = np.concatenate([first.time, second.time[after] + shift])
    parts = zip(_coordinates(first), mixed, _coordinates(second), strict=True)
    x, v, a = (np.concatenate([before[~overlap], middle, later[after]]) for before, middle, later in parts)
    force = None
    if first.foot_force is not None or second.foot_force is not None:
        before, later = _force(first), _force_at(second, own)
        later = np.zeros((own.size, 3)) if later is None else later
        middle = before[overlap] + s * (later - before[overlap])
        force = np.concatenate([before[~overlap], middle, _force(second)[after]])
    return _make(first, time, x, v, a, force, f"{first.name} to {second.name}" if name is None else name)


def connect(
    first: Sampled, second: Sampled, duration: float, rate: float = 1000.0, *, name: str | None = None
) -> Sampled:
    """Play one motion, a quintic from its end to the other's start, and the other; the acceleration is continuous.

    Parameters
    ----------
    first, second : Trajectory or FootPath
        Of one kind and dimension.
    duration : float
        Of the quintic, s, positive.
    rate : float
        Samples a second of the quintic; its end is always sampled. There is no force on the foot along it.
    name : str, optional
        Of the result.

    Returns
    -------
    Trajectory or FootPath
    """
    _check_kinds(first, second, kinds=SAMPLED)
    ends = [values[-1] for values in _coordinates(first)]
    starts = [values[0] for values in _coordinates(second)]
    bridge = quintic(
        ends[0],
        starts[0],
        duration,
        start_velocity=ends[1],
        end_velocity=starts[1],
        start_acceleration=ends[2],
        end_acceleration=starts[2],
    )
    inner = sample_times(duration, rate)
    t = np.append(inner[inner < duration * (1.0 - 1e-9)], duration)
    middle = _make(first, t, bridge.value(t), bridge.value(t, 1), bridge.value(t, 2), None, "connection")
    title = f"{first.name} to {second.name}" if name is None else name
    return concatenate(first, middle, second, name=title)


def jerk_jumps(
    motion: Trajectory | FootPath | PiecewisePolynomial, threshold: float | None = None
) -> tuple[DerivativeJump, ...]:
    """Report where the jerk is discontinuous.

    Parameters
    ----------
    motion : Trajectory, FootPath or PiecewisePolynomial
        A curve is judged exactly, at its breaks. Samples are judged by the one-sided slopes of the acceleration
        over two steps on each side, so that a jump between two samples is reported at one of them.
    threshold : float, optional
        Least jump to report, rad/s³ or m/s³, positive; needed for samples, whose slopes differ a little everywhere.

    Returns
    -------
    tuple of DerivativeJump
        In order of time.
    """
    _check_kinds(motion)
    if threshold is not None:
        threshold = arguments.positive("threshold, the least jump of the jerk to report,", threshold)
    if isinstance(motion, PiecewisePolynomial):
        return tuple(j for j in motion.jumps(3) if threshold is None or np.abs(j.jump).max() >= threshold)
    if threshold is None:
        raise TrajectoryError("sampled motions need a threshold: the least jump of the jerk to report, positive")
    if len(motion) < 5:
        raise TrajectoryError(f"{len(motion)} samples are too few to see a jump of the jerk; five are needed")
    t, a = motion.time, _coordinates(motion)[2]
    right = _slope(t[2:-2], t[3:-1], t[4:], a[2:-2], a[3:-1], a[4:])
    left = _slope(t[2:-2], t[1:-3], t[:-4], a[2:-2], a[1:-3], a[:-4])
    size = np.abs(right - left).max(axis=1)
    found = np.flatnonzero(size >= threshold)
    # A jump also shows at its neighbours, whose slopes reach over it: one report a run of neighbours.
    runs = np.split(found, np.flatnonzero(np.diff(found) > 1) + 1) if found.size else []
    peaks = [int(run[size[run].argmax()]) for run in runs]
    return tuple(DerivativeJump(float(t[i + 2]), left[i], right[i]) for i in peaks)


def _slope(t0: Array, t1: Array, t2: Array, a0: Array, a1: Array, a2: Array) -> Array:
    """Derivative at t0 of the parabola through three samples."""
    h1, h2 = (t1 - t0)[:, None], (t2 - t0)[:, None]
    return ((a1 - a0) * h2 / h1 - (a2 - a0) * h1 / h2) / (h2 - h1)


def _coordinates(motion: Trajectory | FootPath) -> tuple[Array, Array, Array]:
    if isinstance(motion, Trajectory):
        return motion.q, motion.v, motion.a
    return motion.position, motion.velocity, motion.acceleration


def _make(like: Any, time: Array, x: Array, v: Array, a: Array, force: Array | None, name: str) -> Any:
    return type(like)(time, x, v, a, force, name)


def _curve(motion: Trajectory | FootPath) -> PiecewisePolynomial:
    if len(motion) < 2:
        raise TrajectoryError(f"{motion.name!r} has one sample only; between samples there must be two")
    return PiecewisePolynomial.through_samples(motion.time, *_coordinates(motion), motion.name)


def _force(motion: Trajectory | FootPath) -> Array:
    return np.zeros((len(motion), 3)) if motion.foot_force is None else motion.foot_force


def _force_at(motion: Trajectory | FootPath, t: Array) -> Array | None:
    if motion.foot_force is None:
        return None
    return np.stack([np.interp(t, motion.time, component) for component in motion.foot_force.T], axis=-1)


def _start(motion: Trajectory | FootPath | PiecewisePolynomial) -> float:
    return motion.start_time if isinstance(motion, PiecewisePolynomial) else float(motion.time[0])


def _dimension(motion: Trajectory | FootPath | PiecewisePolynomial) -> int:
    return motion.dimension if isinstance(motion, PiecewisePolynomial) else int(_coordinates(motion)[0].shape[1])


def _check_kinds(*motions: Any, kinds: tuple[type, ...] = MOTIONS) -> None:
    """Refuse what is not one of the kinds, and motions of different kinds or dimensions."""
    for motion in motions:
        curve = isinstance(motion, PiecewisePolynomial)
        hint = "sample the curve first, with its trajectory or foot_path" if curve else ""
        arguments.kind("a motion" if kinds is MOTIONS else "a sampled motion", motion, *kinds, hint=hint)
    first = motions[0]
    for other in motions[1:]:
        if type(first) is not type(other) or _dimension(first) != _dimension(other):
            raise ShapeError(
                f"motions are joined with their like: {first.name!r} is a {type(first).__name__} of "
                f"{_dimension(first)} coordinates, {other.name!r} a {type(other).__name__} of {_dimension(other)}"
            )


def _end_values(motion: Trajectory | FootPath | PiecewisePolynomial, order: int) -> tuple[Array, Array]:
    if isinstance(motion, PiecewisePolynomial):
        return motion.ends(order)
    values = _coordinates(motion)[order]
    return values[0], values[-1]


def _seam_between(
    before: Trajectory | FootPath | PiecewisePolynomial, after: Trajectory | FootPath | PiecewisePolynomial
) -> Seam:
    return Seam(*(_end_values(after, order)[0] - _end_values(before, order)[1] for order in range(3)))


def _continuity_order(continuity: str) -> int:
    return CONTINUITY.index(arguments.choice("continuity", continuity, CONTINUITY))


def _refuse_jump(found: Seam, where: str, continuity: str, tolerance: float) -> None:
    tolerance = arguments.tolerance("tolerance", tolerance)
    for name in CONTINUITY[: _continuity_order(continuity) + 1]:
        jump = getattr(found, name)
        if not np.abs(jump).max() <= tolerance:
            values = ", ".join("0" if abs(value) <= tolerance else f"{value:.4g}" for value in jump)
            raise TrajectoryError(
                f"{where} the {name} jumps by ({values}), more than {tolerance:g}; connect or blend the motions, "
                "or ask for less continuity",
                seam=found,
                derivative=name,
            )
