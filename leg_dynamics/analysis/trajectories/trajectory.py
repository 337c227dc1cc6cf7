"""A sampled motion of the independent coordinates, with the force on the foot along it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.errors import JointLimitError, NonFiniteError, ShapeError, TrajectoryError

if TYPE_CHECKING:
    from leg_dynamics.leg import Leg

__all__ = ["Trajectory", "force_during", "sample_times"]

LIMIT_TOLERANCE = 1e-9
"""rad or m; a coordinate that leaves its limits by less than this is rounding, not motion."""

MAX_SAMPLES = 10_000_000


class _Limits(Protocol):
    """Joint limits, each of shape (n,)."""

    @property
    def lower(self) -> Any: ...

    @property
    def upper(self) -> Any: ...


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion sampled at T times; the arrays are private, read-only copies.

    Parameters
    ----------
    time : array_like, shape (T,)
        s, finite and strictly increasing.
    q, v, a : array_like, shape (T, n)
        Independent coordinates (rad or m), their rates and their accelerations.
    foot_force : array_like, shape (T, 3) or (3,), optional
        Force that the environment applies to the foot, N, in the leg's hip frame; None where there is none.
    name : str
        Shown in tables and plots.

    Raises
    ------
    ShapeError
        Where a shape does not fit.
    NonFiniteError
        Where a value is NaN or infinite; `rows` are the samples.
    TrajectoryError
        Where there is no sample or the time does not increase.
    """

    time: NDArray[np.float64]
    q: NDArray[np.float64]
    v: NDArray[np.float64]
    a: NDArray[np.float64]
    foot_force: NDArray[np.float64] | None = None
    name: str = "trajectory"

    def __post_init__(self) -> None:
        validate_motion(self, ("q", "v", "a"))

    def __reduce__(self) -> tuple[Any, ...]:
        # Through the constructor, so that an unpickled copy is validated and read-only too.
        return Trajectory, (self.time, self.q, self.v, self.a, self.foot_force, self.name)

    def __len__(self) -> int:
        return self.time.size

    def __repr__(self) -> str:
        force = "" if self.foot_force is None else ", with a force on the foot"
        return (
            f"<Trajectory {self.name!r}: {len(self)} samples of {self.q.shape[1]} coordinates, "
            f"{self.time[0]:g} to {self.time[-1]:g} s{force}>"
        )

    @property
    def duration(self) -> float:
        """Last time minus first time, s."""
        return float(self.time[-1] - self.time[0])

    def with_foot_force(self, force: ArrayLike, start: float | None = None, end: float | None = None) -> Trajectory:
        """Return a copy with a constant force on the foot, or with a whole schedule.

        Parameters
        ----------
        force : array_like, shape (3,) or (T, 3)
            N, applied by the environment to the foot, in the hip frame.
        start, end : float, optional
            Window in s, both ends included, outside of which the force is zero; only with shape (3,).
            The trajectory's own ends where not given.

        Returns
        -------
        Trajectory
            With `foot_force` of shape (T, 3).
        """
        if start is not None or end is not None:
            start = float(self.time[0]) if start is None else start
            end = float(self.time[-1]) if end is None else end
            force = force_during(self.time, force, start, end)
        return replace(self, foot_force=arguments.reals("foot_force", force))

    def check_limits(self, limits: _Limits, joint_names: Sequence[str], units: Sequence[str]) -> None:
        """Refuse a motion that leaves the joint limits.

        Parameters
        ----------
        limits
            Anything with `lower` and `upper` of shape (n,), such as ``leg.limits``.
        joint_names, units : sequence of str
            Of the n independent coordinates, for the message.

        Raises
        ------
        JointLimitError
            With the failing samples in `rows` and their (negative) excess in `margin`, rad or m.
        """
        arguments.having("joint limits", limits, ("lower", "upper"), "give those of a leg, leg.limits")
        # One temporary at a time: a long trajectory is large.
        margin = np.minimum(self.q - np.asarray(limits.lower), np.asarray(limits.upper) - self.q)
        worst = margin.min(axis=1)
        rows = np.flatnonzero(worst < -LIMIT_TOLERANCE)
        if not rows.size:
            return
        row = int(rows[0])
        joint = int(margin[row].argmin())
        raise JointLimitError(
            f"trajectory {self.name!r} leaves the joint limits at {rows.size} of {len(self)} samples, first at "
            f"t = {self.time[row]:g} s: {joint_names[joint]} = {self.q[row, joint]:.6g} {units[joint]} is outside "
            f"[{np.asarray(limits.lower)[joint]:.6g}, {np.asarray(limits.upper)[joint]:.6g}] by "
            f"{-margin[row, joint]:.3g} {units[joint]}; shorten or shrink the motion, or have the limits ignored",
            rows=rows,
            margin=worst[rows],
            joint=joint_names[joint],
        )

    def check_limits_of(self, leg: Leg) -> None:
        """As `check_limits`; where the leg is assembled from modules, the error names the joint's module too."""
        from leg_dynamics.description.places import with_place

        try:
            self.check_limits(leg.limits, leg.joint_names, leg.units.joints)
        except JointLimitError as error:
            raise with_place(leg.description, None, error) from None


def force_during(time: ArrayLike, force: ArrayLike, start: float, end: float) -> NDArray[np.float64]:
    """Sample a constant force that acts from `start` to `end`, both included.

    Parameters
    ----------
    time : array_like, shape (T,)
        s.
    force : array_like, shape (3,)
        N.
    start, end : float
        s.

    Returns
    -------
    numpy.ndarray, shape (T, 3)
        N; zero outside the window.

    Raises
    ------
    TrajectoryError
        Where the window is empty or holds no sample: a force that never acts is a mistake.
    """
    time = arguments.reals("time", time)
    if time.ndim != 1 or not time.size:
        raise ShapeError(f"time has shape {time.shape}; give one time in seconds a sample, shape (T,)")
    _check_finite("time", time[:, None])
    vector = arguments.vector("force", force, 3, "N")
    start, end = arguments.real("start of the force", start), arguments.real("end of the force", end)
    if start > end:
        raise TrajectoryError(f"a force window runs from an earlier to a later time, but got {start:g} to {end:g} s")
    inside = (time >= start) & (time <= end)
    if not inside.any():
        raise TrajectoryError(
            f"no sample lies in the force window {start:g} to {end:g} s: the trajectory runs from "
            f"{time[0]:g} to {time[-1]:g} s in {time.size} samples; move or widen the window",
            window=(start, end),
        )
    return np.where(inside[:, None], vector, 0.0)


def sample_times(duration: float, rate: float) -> NDArray[np.float64]:
    """Times 0, 1/rate, 2/rate, ... up to and including `duration` where it is a multiple of 1/rate.

    Parameters
    ----------
    duration : float
        s, positive.
    rate : float
        Samples a second, positive.

    Returns
    -------
    numpy.ndarray, shape (T,)
        s.
    """
    duration, rate = (
        arguments.positive("duration", duration, "seconds"),
        arguments.positive("rate", rate, "samples a second"),
    )
    intervals = duration * rate
    if intervals + 1.0 > MAX_SAMPLES:
        raise TrajectoryError(
            f"{duration:g} s at {rate:g} samples a second are {intervals:.3g} samples, more than the limit of "
            f"{MAX_SAMPLES}; lower the rate or shorten the motion",
        )
    # A relative allowance, so that e.g. 0.3 s at 10 a second does end at 0.3 s.
    return np.arange(math.floor(intervals * (1.0 + 1e-12)) + 1) / rate


def validate_motion(motion: Any, fields: tuple[str, str, str], columns: int | None = None) -> None:
    """Check a sampled motion and replace its arrays by read-only copies.

    Parameters
    ----------
    motion
        A frozen dataclass with `time`, three coordinate arrays, `foot_force` and `name`.
    fields : tuple of str
        Names of the coordinates, rates and accelerations.
    columns : int, optional
        Required number of coordinates; any where not given.

    Raises
    ------
    ShapeError, NonFiniteError, TrajectoryError
        As `Trajectory` says.
    """
    arguments.text("the name of a motion", motion.name)
    time = _private_copy("time", motion.time)
    if time.ndim != 1:
        raise ShapeError(f"time has shape {time.shape}; give one time in seconds a sample, shape (T,)")
    if time.size == 0:
        raise TrajectoryError(f"trajectory {motion.name!r} has no sample; give at least one")
    _check_finite("time", time[:, None])
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if late.size:
        i = int(late[0])
        raise TrajectoryError(
            f"time must increase from sample to sample, but sample {i} is at {time[i]:g} s and sample {i + 1} at "
            f"{time[i + 1]:g} s; sort the samples and drop repeated ones",
            rows=late + 1,
        )
    object.__setattr__(motion, "time", time)
    for field in fields:
        values = _private_copy(field, getattr(motion, field))
        if values.ndim != 2 or values.shape[0] != time.size or (columns or values.shape[1]) != values.shape[1]:
            expected = f"({time.size}, {'n' if columns is None else columns})"
            raise ShapeError(f"{field} has shape {values.shape}; {time.size} times need shape {expected}")
        columns = values.shape[1]
        _check_finite(field, values)
        object.__setattr__(motion, field, values)
    if motion.foot_force is not None:
        force = _private_copy("foot_force", motion.foot_force)
        if force.shape not in ((3,), (time.size, 3)):
            raise ShapeError(f"foot_force has shape {force.shape}; give (3,) or ({time.size}, 3), in N")
        force = _private_copy("foot_force", np.broadcast_to(force, (time.size, 3)))
        _check_finite("foot_force", force)
        object.__setattr__(motion, "foot_force", force)


def _private_copy(name: str, values: ArrayLike) -> NDArray[np.float64]:
    array = arguments.reals(name, values)
    array.setflags(write=False)
    return array


def _check_finite(name: str, values: NDArray[np.float64]) -> None:
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        rows = np.flatnonzero(~finite)
        raise NonFiniteError(
            f"{name} holds NaN or infinity at {rows.size} of {finite.size} samples, first at sample {rows[0]}",
            rows=rows,
        )
