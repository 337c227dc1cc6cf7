"""Curves that are polynomials in time, piece by piece, with exact derivatives of every order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis.trajectories.trajectory import Trajectory, sample_times
from leg_dynamics.errors import NonFiniteError, ShapeError, TrajectoryError

if TYPE_CHECKING:
    from leg_dynamics.analysis.trajectories.foot_path import FootPath

__all__ = ["DerivativeJump", "PiecewisePolynomial", "minimum_jerk", "quintic"]

TIME_TOLERANCE = 1e-9
"""Share of the duration by which a time may lie outside a curve: rounding of sample times."""


@dataclass(frozen=True, eq=False)
class DerivativeJump:
    """A place where a derivative is discontinuous.

    Attributes
    ----------
    time : float
        s.
    left, right : numpy.ndarray, shape (d,)
        The derivative just before and just after.
    """

    time: float
    left: NDArray[np.float64]
    right: NDArray[np.float64]

    @property
    def jump(self) -> NDArray[np.float64]:
        """Right minus left, shape (d,)."""
        return self.right - self.left


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """A curve of d coordinates: in joint space (rad or m), or of the foot (m, hip frame, d = 3).

    Parameters
    ----------
    breaks : array_like, shape (k + 1,)
        Times between the k pieces and at both ends, s, strictly increasing.
    coefficients : array_like, shape (degree + 1, k, d)
        Of the powers of (t - start of the piece), highest power first (as in ``scipy.interpolate.PPoly``).
    name : str
        Given to what is sampled from the curve.

    Raises
    ------
    ShapeError, NonFiniteError, TrajectoryError
        The arrays do not make a curve.
    """

    breaks: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    name: str = "curve"

    def __post_init__(self) -> None:
        try:
            breaks = np.array(self.breaks, dtype=float)
            coefficients = np.array(self.coefficients, dtype=float)
        except (TypeError, ValueError) as error:
            raise ShapeError(f"a curve is made of real numbers: {error}") from None
        if breaks.ndim != 1 or breaks.size < 2:
            raise ShapeError(f"breaks have shape {breaks.shape}; give at least a start and an end, shape (k + 1,)")
        pieces = breaks.size - 1
        if coefficients.ndim != 3 or coefficients.shape[1] != pieces or 0 in coefficients.shape:
            raise ShapeError(
                f"coefficients have shape {coefficients.shape}; {pieces} pieces need (degree + 1, {pieces}, d)"
            )
        if not (np.isfinite(breaks).all() and np.isfinite(coefficients).all()):
            raise NonFiniteError("a break or a coefficient of the curve is NaN or infinite")
        late = np.flatnonzero(np.diff(breaks) <= 0.0)
        if late.size:
            i = int(late[0])
            raise TrajectoryError(f"breaks must increase, but {breaks[i + 1]:g} s follows {breaks[i]:g} s")
        for field, array in (("breaks", breaks), ("coefficients", coefficients)):
            array.setflags(write=False)
            object.__setattr__(self, field, array)

    def __reduce__(self) -> tuple[Any, ...]:
        # Through the constructor, so that an unpickled copy is read-only too.
        return PiecewisePolynomial, (self.breaks, self.coefficients, self.name)

    def __repr__(self) -> str:
        return (
            f"<PiecewisePolynomial {self.name!r}: {self.breaks.size - 1} pieces of degree "
            f"{self.coefficients.shape[0] - 1} in {self.dimension} coordinates, "
            f"{self.start_time:g} to {self.end_time:g} s>"
        )

    @classmethod
    def through_samples(
        cls, time: ArrayLike, x: ArrayLike, v: ArrayLike, a: ArrayLike, name: str = "curve"
    ) -> PiecewisePolynomial:
        """Join samples by quintics that meet coordinates, rates and accelerations at each sample.

        Parameters
        ----------
        time : array_like, shape (T,)
            s, strictly increasing, at least two.
        x, v, a : array_like, shape (T, d)
            Coordinates and their first two derivatives.
        name : str
            Name of the curve.

        Returns
        -------
        PiecewisePolynomial
            With continuous acceleration.
        """
        time, x, v, a = (np.asarray(values, dtype=float) for values in (time, x, v, a))
        if time.ndim != 1 or time.size < 2 or any(u.ndim != 2 or u.shape != (time.size, x.shape[1]) for u in (x, v, a)):
            raise ShapeError(
                f"time, x, v, a have shapes {time.shape}, {x.shape}, {v.shape}, {a.shape}; give (T,) with T >= 2 "
                "and three times (T, d)"
            )
        if not (np.diff(time) > 0.0).all():
            raise TrajectoryError("times must increase from sample to sample; sort them and drop repeated ones")
        h = np.diff(time)[:, None]
        rest = x[1:] - x[:-1] - h * (v[:-1] + h * a[:-1] / 2.0)
        rate_rest = h * (v[1:] - v[:-1] - h * a[:-1])
        acceleration_rest = h**2 * (a[1:] - a[:-1])
        coefficients = [
            (6.0 * rest - 3.0 * rate_rest + 0.5 * acceleration_rest) / h**5,
            (-15.0 * rest + 7.0 * rate_rest - acceleration_rest) / h**4,
            (10.0 * rest - 4.0 * rate_rest + 0.5 * acceleration_rest) / h**3,
            a[:-1] / 2.0,
            v[:-1],
            x[:-1],
        ]
        return cls(time, np.stack(coefficients), name)

    @property
    def start_time(self) -> float:
        """First time, s."""
        return float(self.breaks[0])

    @property
    def end_time(self) -> float:
        """Last time, s."""
        return float(self.breaks[-1])

    @property
    def duration(self) -> float:
        """Last time minus first time, s."""
        return self.end_time - self.start_time

    @property
    def dimension(self) -> int:
        """Number of coordinates d."""
        return int(self.coefficients.shape[2])

    def value(self, time: ArrayLike, derivative: int = 0) -> NDArray[np.float64]:
        """Evaluate the curve or one of its derivatives.

        Parameters
        ----------
        time : array_like, shape (...)
            s, within the curve. At a break, the piece that starts there counts.
        derivative : int
            Order, 0 for the coordinates themselves.

        Returns
        -------
        numpy.ndarray, shape (..., d)

        Raises
        ------
        TrajectoryError
            A time lies outside the curve, or the order is negative.
        """
        from scipy.interpolate import PPoly

        time = np.asarray(time, dtype=float)
        if not np.isfinite(time).all():
            raise NonFiniteError("a time is NaN or infinite")
        self._check_derivative(derivative)
        slack = TIME_TOLERANCE * self.duration
        if time.size and (time.min() < self.start_time - slack or time.max() > self.end_time + slack):
            raise TrajectoryError(
                f"times {time.min():g} to {time.max():g} s leave the curve {self.name!r}, which runs from "
                f"{self.start_time:g} to {self.end_time:g} s; shorten the times, or repeat or extend the curve"
            )
        return np.asarray(PPoly(self.coefficients, self.breaks)(time, nu=derivative))

    def _check_derivative(self, derivative: int) -> None:
        if isinstance(derivative, bool) or not isinstance(derivative, int | np.integer) or derivative < 0:
            raise TrajectoryError(f"the order of a derivative is 0, 1, 2, ..., not {derivative!r}")

    def _piece_ends(self, derivative: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """A derivative at the start and at the end of each piece, from within the piece, each (k, d)."""
        c, h = self._derived(derivative), np.diff(self.breaks)[:, None]
        return c[-1], _horner(c, h)

    def _derived(self, derivative: int) -> NDArray[np.float64]:
        """Coefficients of a derivative."""
        c = self.coefficients
        for _ in range(derivative):
            powers = np.arange(c.shape[0] - 1, 0, -1.0)[:, None, None]
            c = c[:-1] * powers if c.shape[0] > 1 else np.zeros_like(c)
        return c

    def ends(self, derivative: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The curve, or a derivative, at its start and at its end, each of shape (d,)."""
        self._check_derivative(derivative)
        start, end = self._piece_ends(derivative)
        return start[0], end[-1]

    def jumps(self, derivative: int = 3, tolerance: float = 1e-9) -> tuple[DerivativeJump, ...]:
        """Discontinuities of a derivative at the breaks inside the curve; by default of the jerk.

        Parameters
        ----------
        derivative : int
            Order; 3 is the jerk.
        tolerance : float
            A jump below this share of the largest polynomial's terms, added without sign, is rounding.

        Returns
        -------
        tuple of DerivativeJump
            In order of time. For what happens from the end to the start of a cycle, ask ``repeat(curve, 2)``.
        """
        self._check_derivative(derivative)
        starts, ends = self._piece_ends(derivative)
        scale = float(_horner(np.abs(self._derived(derivative)), np.diff(self.breaks)[:, None]).max())
        return tuple(
            DerivativeJump(float(self.breaks[i + 1]), ends[i].copy(), starts[i + 1].copy())
            for i in range(len(starts) - 1)
            if np.abs(starts[i + 1] - ends[i]).max() > tolerance * scale
        )

    def translated(self, offset: ArrayLike) -> PiecewisePolynomial:
        """Return the curve moved by `offset`, shape (d,), in the coordinates' unit."""
        offset = np.asarray(offset, dtype=float)
        if offset.shape != (self.dimension,):
            raise ShapeError(f"the offset has shape {offset.shape}; the curve has {self.dimension} coordinates")
        coefficients = self.coefficients.copy()
        coefficients[-1] += offset
        return PiecewisePolynomial(self.breaks, coefficients, self.name)

    def sample_times(self, rate: float = 1000.0) -> NDArray[np.float64]:
        """Times from the start, 1/rate apart; the end is among them where the duration is a multiple of 1/rate."""
        return self.start_time + sample_times(self.duration, rate)

    def trajectory(self, rate: float = 1000.0, *, times: ArrayLike | None = None) -> Trajectory:
        """Sample a curve in joint space; derivatives are exact.

        Parameters
        ----------
        rate : float
            Samples a second.
        times : array_like, shape (T,), optional
            s; in place of `rate`.

        Returns
        -------
        Trajectory
        """
        t = self.sample_times(rate) if times is None else np.asarray(times, dtype=float)
        return Trajectory(t, self.value(t), self.value(t, 1), self.value(t, 2), name=self.name)

    def foot_path(self, rate: float = 1000.0, *, times: ArrayLike | None = None) -> FootPath:
        """Sample a curve of the foot (d = 3, m, hip frame); derivatives are exact.

        Parameters
        ----------
        rate : float
            Samples a second.
        times : array_like, shape (T,), optional
            s; in place of `rate`.

        Returns
        -------
        FootPath
        """
        from leg_dynamics.analysis.trajectories.foot_path import FootPath

        t = self.sample_times(rate) if times is None else np.asarray(times, dtype=float)
        return FootPath(t, self.value(t), self.value(t, 1), self.value(t, 2), name=self.name)


def quintic(
    start: ArrayLike,
    end: ArrayLike,
    duration: float,
    *,
    start_velocity: ArrayLike = 0.0,
    end_velocity: ArrayLike = 0.0,
    start_acceleration: ArrayLike = 0.0,
    end_acceleration: ArrayLike = 0.0,
    start_time: float = 0.0,
    name: str = "quintic",
) -> PiecewisePolynomial:
    """Go from point to point by the quintic with the given rates and accelerations at both ends.

    Parameters
    ----------
    start, end : array_like, shape (d,)
        rad or m; joint coordinates or a position of the foot.
    duration : float
        s, positive.
    start_velocity, end_velocity, start_acceleration, end_acceleration : array_like, shape (d,) or scalar
        rad/s or m/s, and per second once more; zero where not given.
    start_time : float
        s.
    name : str
        Name of the curve.

    Returns
    -------
    PiecewisePolynomial
        One piece. Among all motions with these ends it has the least integral of squared jerk.
    """
    return minimum_jerk(
        [start, end],
        [start_time, start_time + positive_seconds("duration", duration)],
        start_velocity=start_velocity,
        end_velocity=end_velocity,
        start_acceleration=start_acceleration,
        end_acceleration=end_acceleration,
        name=name,
    )


def minimum_jerk(
    points: Sequence[ArrayLike] | NDArray[np.float64],
    times: ArrayLike,
    *,
    start_velocity: ArrayLike = 0.0,
    end_velocity: ArrayLike = 0.0,
    start_acceleration: ArrayLike = 0.0,
    end_acceleration: ArrayLike = 0.0,
    name: str = "minimum_jerk",
) -> PiecewisePolynomial:
    """Pass through points at given times with the least integral of squared jerk (Flash & Hogan 1985).

    Between two points this is the quintic; with more points the quintic spline whose snap is continuous.

    Parameters
    ----------
    points : array_like, shape (m, d)
        rad or m, m >= 2.
    times : array_like, shape (m,)
        s, strictly increasing.
    start_velocity, end_velocity, start_acceleration, end_acceleration : array_like, shape (d,) or scalar
        At the first and at the last point; zero where not given.
    name : str
        Name of the curve.

    Returns
    -------
    PiecewisePolynomial
    """
    try:
        x = np.array(points, dtype=float)
        t = np.array(times, dtype=float)
        boundary = [
            np.array(np.broadcast_to(np.asarray(value, dtype=float), x.shape[1:]))
            for value in (start_velocity, start_acceleration, end_velocity, end_acceleration)
        ]
    except (TypeError, ValueError) as error:
        raise ShapeError(f"points (m, d), times (m,) and boundary values (d,) do not fit: {error}") from None
    if x.ndim != 2 or len(x) < 2 or t.shape != (len(x),) or x.shape[1] == 0:
        raise ShapeError(f"points have shape {x.shape} and times {t.shape}; give (m, d) and (m,) with m >= 2")
    if not all(np.isfinite(values).all() for values in (x, t, *boundary)):
        raise NonFiniteError("a point, time or boundary value is NaN or infinite")
    if not (np.diff(t) > 0.0).all():
        raise TrajectoryError("times must increase from point to point; sort the points and drop repeated times")
    v0, a0, v1, a1 = boundary
    if len(x) == 2:
        return PiecewisePolynomial.through_samples(t, x, np.stack([v0, v1]), np.stack([a0, a1]), name)
    from scipy.interpolate import make_interp_spline

    # Scaled to steps of about one, so that the spline's system keeps its digits.
    scale = (t[-1] - t[0]) / (len(t) - 1)
    s = (t - t[0]) / scale
    ends = ([(1, v0 * scale), (2, a0 * scale**2)], [(1, v1 * scale), (2, a1 * scale**2)])
    spline = make_interp_spline(s, x, k=5, bc_type=ends, axis=0)
    v, a = spline(s, nu=1) / scale, spline(s, nu=2) / scale**2
    # Each piece is a quintic, which its ends determine; the given ends stay exact.
    v[[0, -1]], a[[0, -1]] = [v0, v1], [a0, a1]
    return PiecewisePolynomial.through_samples(t, x, v, a, name)


def _horner(coefficients: NDArray[np.float64], h: NDArray[np.float64]) -> NDArray[np.float64]:
    value = np.zeros_like(coefficients[0])
    for coefficient in coefficients:
        value = value * h + coefficient
    return value


def positive_seconds(what: str, value: float) -> float:
    """Return `value` as a float, or refuse it by the name `what` where it is not a positive number of seconds."""
    if not (math.isfinite(value) and value > 0.0):
        raise TrajectoryError(f"the {what} must be a positive number of seconds, but is {value:g}")
    return float(value)
