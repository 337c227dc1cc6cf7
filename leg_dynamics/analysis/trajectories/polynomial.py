"""Curves that are polynomials in time, piece by piece, with exact derivatives of every order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.trajectories.trajectory import Trajectory, sample_times
from leg_dynamics.errors import NonFiniteError, ShapeError, TrajectoryError

if TYPE_CHECKING:
    from leg_dynamics.analysis.trajectories.foot_path import FootPath

__all__ = ["DerivativeJump", "PiecewisePolynomial", "minimum_jerk", "quintic"]

TIME_TOLERANCE = 1e-9
"""Share of the duration by which a time may lie outside a curve: rounding of sample times."""

PASSING_TOLERANCE = 1e-9
"""Share of the span of a motion by which a curve through points may miss one of them."""

ROUNDING = 1e-14
"""The same, of the coordinates' magnitude."""

HIGHEST_DERIVATIVE = 1000
"""Far above the degree of any curve that floating-point numbers can hold."""

_JERK = np.array(
    [[192.0, 36.0, 168.0, -24.0], [36.0, 9.0, 24.0, -3.0], [168.0, 24.0, 192.0, -36.0], [-24.0, -3.0, -36.0, 9.0]]
)
_JERK_STEP = np.array([-360.0, -60.0, -360.0, 60.0])
"""Gradient of half the integral of squared jerk over a quintic of unit duration, by its ends' (v, a): that of (v, a, v,
a) and that of the step in position. It holds (snap, -jerk) at the start and (-snap, jerk) at the end."""


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
        arguments.text("the name of a curve", self.name)
        breaks = arguments.reals("breaks of a curve", self.breaks)
        coefficients = arguments.reals("coefficients of a curve", self.coefficients)
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
        time, x, v, a = (
            arguments.reals(what, values) for what, values in (("time", time), ("x", x), ("v", v), ("a", a))
        )
        if time.ndim != 1 or time.size < 2 or any(u.ndim != 2 or u.shape != (time.size, x.shape[1]) for u in (x, v, a)):
            raise ShapeError(
                f"time, x, v, a have shapes {time.shape}, {x.shape}, {v.shape}, {a.shape}; give (T,) with T >= 2 "
                "and three times (T, d)"
            )
        if not all(np.isfinite(values).all() for values in (time, x, v, a)):
            raise NonFiniteError("a time, coordinate, rate or acceleration is NaN or infinite")
        if not (np.diff(time) > 0.0).all():
            raise TrajectoryError("times must increase from sample to sample; sort them and drop repeated ones")
        # An overflow is told below.
        with np.errstate(all="ignore"):
            h = np.diff(time)[:, None]
            rest = x[1:] - x[:-1] - h * (v[:-1] + h * a[:-1] / 2.0)
            rate_rest = h * (v[1:] - v[:-1] - h * a[:-1])
            acceleration_rest = h**2 * (a[1:] - a[:-1])
            coefficients = np.stack(
                [
                    (6.0 * rest - 3.0 * rate_rest + 0.5 * acceleration_rest) / h**5,
                    (-15.0 * rest + 7.0 * rate_rest - acceleration_rest) / h**4,
                    (10.0 * rest - 4.0 * rate_rest + 0.5 * acceleration_rest) / h**3,
                    a[:-1] / 2.0,
                    v[:-1],
                    x[:-1],
                ]
            )
        wild = np.flatnonzero(~np.isfinite(coefficients).all(axis=(0, 2)))
        if wild.size:
            i = int(wild[0])
            raise TrajectoryError(
                f"no polynomial of floating-point numbers goes from t = {time[i]:g} s to {time[i + 1]:g} s: the step "
                f"of {h[i, 0]:.3g} s is too short or too long for these coordinates; give times in seconds",
                step=float(h[i, 0]),
            )
        return cls(time, coefficients, name)

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

        time = arguments.reals("time", time)
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
        arguments.whole("the order of a derivative", derivative, 0, HIGHEST_DERIVATIVE)

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
            A jump below this share of the largest polynomial's terms, added without sign, is rounding; zero or more.

        Returns
        -------
        tuple of DerivativeJump
            In order of time. For what happens from the end to the start of a cycle, ask ``repeat(curve, 2)``.
        """
        self._check_derivative(derivative)
        tolerance = arguments.tolerance("tolerance", tolerance)
        starts, ends = self._piece_ends(derivative)
        scale = float(_horner(np.abs(self._derived(derivative)), np.diff(self.breaks)[:, None]).max())
        return tuple(
            DerivativeJump(float(self.breaks[i + 1]), ends[i].copy(), starts[i + 1].copy())
            for i in range(len(starts) - 1)
            if np.abs(starts[i + 1] - ends[i]).max() > tolerance * scale
        )

    def translated(self, offset: ArrayLike) -> PiecewisePolynomial:
        """Return the curve moved by `offset`, shape (d,), in the coordinates' unit."""
        offset = arguments.reals("offset", offset)
        if offset.shape != (self.dimension,):
            raise ShapeError(f"the offset has shape {offset.shape}; the curve has {self.dimension} coordinates")
        coefficients = self.coefficients.copy()
        coefficients[-1] += offset
        return PiecewisePolynomial(self.breaks, coefficients, self.name)

    def sample_times(self, rate: float = 1000.0) -> NDArray[np.float64]:
        """Times from the start, 1/rate apart; the end is among them where the duration is a multiple of 1/rate."""
        return self.start_time + sample_times(self.duration, rate)

    def trajectory(self, rate: float | None = None, *, times: ArrayLike | None = None) -> Trajectory:
        """Sample a curve in joint space; derivatives are exact.

        Parameters
        ----------
        rate : float, optional
            Samples a second; 1000 where neither it nor `times` is given.
        times : array_like, shape (T,), optional
            s; in place of `rate`.

        Returns
        -------
        Trajectory
        """
        t = self._times(rate, times)
        return Trajectory(t, self.value(t), self.value(t, 1), self.value(t, 2), name=self.name)

    def foot_path(self, rate: float | None = None, *, times: ArrayLike | None = None) -> FootPath:
        """Sample a curve of the foot (d = 3, m, hip frame); derivatives are exact.

        Parameters
        ----------
        rate : float, optional
            Samples a second; 1000 where neither it nor `times` is given.
        times : array_like, shape (T,), optional
            s; in place of `rate`.

        Returns
        -------
        FootPath
        """
        from leg_dynamics.analysis.trajectories.foot_path import FootPath

        t = self._times(rate, times)
        return FootPath(t, self.value(t), self.value(t, 1), self.value(t, 2), name=self.name)

    def _times(self, rate: float | None, times: ArrayLike | None) -> NDArray[np.float64]:
        if times is None:
            return self.sample_times(1000.0 if rate is None else rate)
        if rate is not None:
            raise TrajectoryError("give either the rate or the times of the samples, not both")
        return arguments.reals("times", times)


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
    begin = arguments.real("start_time", start_time)
    return minimum_jerk(
        [start, end],
        [begin, begin + arguments.positive("duration", duration, "seconds")],
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

    Raises
    ------
    ShapeError, NonFiniteError
        The arrays do not fit, or hold NaN or infinity.
    TrajectoryError
        Times do not increase, or their steps are so unequal that the curve, which swings the farther between the
        points, cannot pass them in floating-point numbers.
    """
    x, t = arguments.reals("points", points), arguments.reals("times", times)
    given = (start_velocity, start_acceleration, end_velocity, end_acceleration)
    values = [arguments.reals("a boundary value", value) for value in given]
    try:
        boundary = [np.array(np.broadcast_to(value, x.shape[1:])) for value in values]
    except ValueError as error:
        raise ShapeError(f"points (m, d), times (m,) and boundary values (d,) do not fit: {error}") from None
    if x.ndim != 2 or len(x) < 2 or t.shape != (len(x),) or x.shape[1] == 0:
        raise ShapeError(f"points have shape {x.shape} and times {t.shape}; give (m, d) and (m,) with m >= 2")
    if not all(np.isfinite(values).all() for values in (x, t, *boundary)):
        raise NonFiniteError("a point, time or boundary value is NaN or infinite")
    if not (np.diff(t) > 0.0).all():
        raise TrajectoryError("times must increase from point to point; sort the points and drop repeated times")
    v0, a0, v1, a1 = boundary
    v, a = np.zeros_like(x), np.zeros_like(x)
    v[[0, -1]], a[[0, -1]] = [v0, v1], [a0, a1]
    if len(x) > 2:
        _solve_knots(t, x, v, a)
        if not (np.isfinite(v).all() and np.isfinite(a).all()):
            _refuse_steps(t, f"the rates of {name!r} leave the range of floating-point numbers")
    curve = PiecewisePolynomial.through_samples(t, x, v, a, name)
    _check_passes(curve, x, boundary)
    return curve


def _solve_knots(
    t: NDArray[np.float64], x: NDArray[np.float64], v: NDArray[np.float64], a: NDArray[np.float64]
) -> None:
    """Fill in the rates and accelerations of the inner points for which the integral of squared jerk is least.

    The integral is a positive definite quadratic form of them, and its gradient vanishes where jerk and snap are
    continuous. Each piece is seen in its own time and each point in that of its shorter neighbour: then unequal steps
    cost the block tridiagonal system no digits.
    """
    from scipy.linalg import LinAlgError, solveh_banded

    h = np.diff(t)
    tau = np.minimum(np.append(h, h[-1]), np.insert(h, 0, h[0]))
    unit = np.stack([tau, tau**2], axis=-1)
    step = np.diff(x, axis=0)[:, None, :]
    count = 2 * len(t)
    # Out of range, the solution is not finite, which the caller sees.
    with np.errstate(all="ignore"):
        weight = (h.min() / h) ** 5
        # From the units of a point to those of the piece: (V, A) = (h v, h^2 a).
        start, end = h / tau[:-1], h / tau[1:]
        factors = np.stack([start, start**2, end, end**2], axis=1)
        pieces = weight[:, None, None] * factors[:, :, None] * _JERK * factors[:, None, :]
        pull = -weight[:, None, None] * (factors * _JERK_STEP)[:, :, None] * step
        known = np.stack([v, a], axis=1) * unit[..., None]
        # Lower bands of the matrix over all points, (v, a) of one after (v, a) of the other.
        bands, right = np.zeros((4, count)), np.zeros((count, x.shape[1]))
        for row in range(4):
            right[row : row + count - 2 : 2] += pull[:, row]
            for column in range(row + 1):
                bands[row - column, column : column + count - 2 : 2] += pieces[:, row, column]
        # The ends are given: what they contribute goes to the right side.
        right[2:4] -= pieces[0, 2:, :2] @ known[0]
        right[-4:-2] -= pieces[-1, :2, 2:] @ known[-1]
        inner = bands[: min(4, count - 4), 2:-2].copy()
        scale = 1.0 / np.sqrt(inner[0])
        for offset, band in enumerate(inner):
            band[: scale.size - offset] *= scale[: scale.size - offset] * scale[offset:]
            band[scale.size - offset :] = 0.0
        try:
            solved = solveh_banded(inner, right[2:-2] * scale[:, None], lower=True) * scale[:, None]
        except (LinAlgError, ValueError):
            solved = np.full_like(right[2:-2], np.nan)
        solved = solved.reshape(len(t) - 2, 2, -1) / unit[1:-1, :, None]
    v[1:-1], a[1:-1] = solved[:, 0], solved[:, 1]


def _refuse_steps(t: NDArray[np.float64], what: str) -> NoReturn:
    h = np.diff(t)
    i = int(h.argmin())
    with np.errstate(over="ignore"):
        ratio = float(h.max() / h[i])
    raise TrajectoryError(
        f"{what}: the step of {h[i]:.3g} s from t = {t[i]:g} s is {ratio:.3g} times shorter than the longest, "
        "so that the curve of least jerk swings far out between the points; even out the times, or leave one of two "
        "close points out",
        ratio=ratio,
    )


def _check_passes(curve: PiecewisePolynomial, x: NDArray[np.float64], boundary: Sequence[NDArray[np.float64]]) -> None:
    """Refuse a curve that rounding keeps from its points."""
    v0, a0, v1, a1 = (np.abs(value) for value in boundary)
    duration = curve.duration
    span = np.max([np.ptp(x, axis=0), v0 * duration, v1 * duration, a0 * duration**2, a1 * duration**2], axis=0)
    allowed = np.maximum(PASSING_TOLERANCE * span, ROUNDING * np.abs(x).max(axis=0))
    missed = np.abs(curve._piece_ends(0)[1] - x[1:])
    bad = np.argwhere(~(missed <= allowed))
    if bad.size:
        i, k = map(int, bad[0])
        _refuse_steps(
            curve.breaks,
            f"rounding makes {curve.name!r} miss its point at t = {curve.breaks[i + 1]:g} s by {missed[i, k]:.3g} in "
            f"coordinate {k}, more than {PASSING_TOLERANCE:g} of the span of the motion",
        )


def _horner(coefficients: NDArray[np.float64], h: NDArray[np.float64]) -> NDArray[np.float64]:
    value = np.zeros_like(coefficients[0])
    for coefficient in coefficients:
        value = value * h + coefficient
    return value
