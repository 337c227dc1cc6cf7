"""How far a path of the foot can be moved before the leg cannot follow it."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.trajectories.foot_path import FootLeg, check_leg
from leg_dynamics.analysis.trajectories.polynomial import PiecewisePolynomial
from leg_dynamics.errors import OutOfReachError, RowError, ShapeError, TrajectoryError

__all__ = ["OffsetWindow", "feasible_offset_windows"]

OFFSET_TOLERANCE = 1e-12
"""m; of a window's ends, which lie at least this far inside."""

PROBE = 1e-7
"""m; how far outside a window one looks for what ended it: beyond any route's tolerance on reach."""

MAX_COUNT = 100_000
"""Of scanned offsets, and of times; their product is the number of poses to solve for."""

ROUNDING = 1e-14
"""m or rad; of a margin."""

TIME_TOLERANCE = 1e-9
"""s; the margin is level where it is least, so that it is then met to rounding."""

REFINEMENTS = 3
"""Each one narrows the time at which the path touches the boundary eightfold, then minimises the margin around it."""


@dataclass(frozen=True)
class OffsetWindow:
    """Offsets along one direction for which a whole path of the foot is feasible.

    Attributes
    ----------
    lower, upper : float
        m; both ends are feasible themselves (an end that `reach` sets may be a singular pose).
    lower_reason, upper_reason : str
        What ends the window: ``reach``, the name of a joint at its limit, or ``search`` where the search ended.
    lower_time, upper_time : float
        s; when on the path that happens.
    """

    lower: float
    upper: float
    lower_reason: str
    upper_reason: str
    lower_time: float
    upper_time: float

    def __contains__(self, offset: float) -> bool:
        return self.lower <= offset <= self.upper


def feasible_offset_windows(
    leg: FootLeg,
    path: PiecewisePolynomial,
    direction: ArrayLike = (0.0, 0.0, 1.0),
    *,
    branch: str | None = None,
    limits: str = "error",
    search: tuple[float, float] | None = None,
    scan: int = 33,
    samples: int = 33,
) -> tuple[OffsetWindow, ...]:
    """Find the offsets for which the leg can follow a path of the foot.

    The offsets are scanned, and each end of a feasible stretch is found by root finding (Brent) on the margin of
    the inverse kinematics, worst over the path. That takes some thousand solutions: milliseconds with closed-form
    kinematics, half a minute with numeric ones, for which `search` and smaller counts help.

    Parameters
    ----------
    leg
        Any leg with a foot.
    path : PiecewisePolynomial
        Curve of the foot, m, hip frame.
    direction : array_like, shape (3,)
        Path positions are moved by offset times this vector, hip frame.
    branch : str, optional
        Branch of the inverse kinematics; the leg's first where not given.
    limits : {"error", "ignore"}
        Whether the joint limits bound the window too.
    search : tuple of float, optional
        Offsets between which to look, m; where not given, all at which the foot could be on the path.
    scan : int
        Offsets scanned; a window, or a gap in one, narrower than their spacing can be missed.
    samples : int
        Times on the path in the scan; the times that set the ends are then refined.

    Returns
    -------
    tuple of OffsetWindow
        In increasing order; empty where no offset is feasible.

    Raises
    ------
    ShapeError, NonFiniteError, TrajectoryError
        The arguments are not usable.
    """
    check_leg(leg, "inverse_kinematics", "foot_position")
    arguments.kind("path", path, PiecewisePolynomial, hint="quintic, minimum_jerk and gait_cycle(...).curve are some")
    if path.dimension != 3:
        raise ShapeError(
            f"a path of the foot has three coordinates, x, y, z in metres, but {path.name!r} has {path.dimension}"
        )
    vector = arguments.vector("direction", direction, 3)
    if not vector.any():
        raise TrajectoryError("the direction of the offset is zero; give a direction, such as (0, 0, 1)")
    arguments.choice("limits", limits, ("error", "ignore"))
    scan, samples = arguments.whole("scan", scan, 2, MAX_COUNT), arguments.whole("samples", samples, 2, MAX_COUNT)
    margin = _Margin(leg, path, vector, branch, limits)
    times = np.union1d(np.linspace(path.start_time, path.end_time, samples), path.breaks)
    low, high = (
        _search_range(leg, path.value(times), vector) if search is None else arguments.vector("search", search, 2, "m")
    )
    if low >= high:
        raise TrajectoryError(f"the search runs from a lower to a higher offset, not from {low:g} to {high:g} m")
    offsets = np.linspace(low, high, scan)
    feasible = np.array([margin.worst(offset, times) >= 0.0 for offset in offsets])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], feasible, [False]]).astype(int)))
    windows = []
    for first, past in zip(edges[::2], edges[1::2], strict=True):
        lower = _end(margin, times, offsets, int(first), int(first) - 1)
        upper = _end(margin, times, offsets, int(past) - 1, int(past))
        # Refining the times can only shrink a window, so a sliver may vanish.
        if lower[0] <= upper[0]:
            windows.append(OffsetWindow(lower[0], upper[0], lower[1], upper[1], lower[2], upper[2]))
    return tuple(windows)


class _Margin:
    """Distance of each time on the path to infeasibility, negative outside; its sign is what counts."""

    def __init__(
        self, leg: FootLeg, path: PiecewisePolynomial, direction: NDArray[np.float64], branch: str | None, limits: str
    ) -> None:
        self.leg, self.path, self.direction, self.branch = leg, path, direction, branch
        bounded = limits == "error"
        self.lower = np.asarray(leg.limits.lower) if bounded else np.array(-np.inf)
        self.upper = np.asarray(leg.limits.upper) if bounded else np.array(np.inf)

    def rows(self, offset: float, times: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Margins, shape (T,), m out of reach and rad or m to a limit; and the joint nearest to a limit, -1: reach."""
        p = self.path.value(times) + offset * self.direction
        q = np.asarray(self.leg.inverse_kinematics(p, self.branch, "ignore", on_error="nan"))
        reached = ~np.isnan(q).any(axis=1)
        to_limit = np.minimum(q - self.lower, self.upper - q)
        joint = np.where(reached, to_limit.argmin(axis=1), -1)
        # Far from every limit any point is equally good; root finding then bisects.
        margins = np.where(reached, np.minimum(to_limit.min(axis=1), 1.0), -1.0)
        lost = np.flatnonzero(~reached)
        if lost.size:
            try:
                self.leg.inverse_kinematics(p[lost], self.branch, "ignore")
            except OutOfReachError as error:
                margins[lost[error.rows]] = np.where(error.margin < 0.0, error.margin, -1.0)
            except RowError:
                pass
        return margins, joint

    def worst(self, offset: float, times: NDArray[np.float64]) -> float:
        return float(self.rows(offset, times)[0].min())

    def critical_time(self, offset: float, guess: float, start: float, end: float) -> float:
        """Time of the least margin between two times around a guess, s; the guess where nothing is worse."""
        from scipy.optimize import minimize_scalar

        def at(time: float) -> float:
            return float(self.rows(offset, np.array([time]))[0][0])

        found = minimize_scalar(at, bounds=(start, end), method="bounded", options={"xatol": TIME_TOLERANCE})
        # A path at rest is level to rounding: its own times, such as its end, are then the better answer.
        return float(found.x) if found.fun < at(guess) - ROUNDING else guess


def _end(
    margin: _Margin, times: NDArray[np.float64], offsets: NDArray[np.float64], inside: int, outside: int
) -> tuple[float, str, float]:
    """The end of a window between two scanned offsets: the last feasible offset, what ends it, and when."""
    from scipy.optimize import brentq

    coarse, good = times, float(offsets[inside])
    if not 0 <= outside < offsets.size:
        return good, "search", float(margin.path.start_time)
    bad = float(offsets[outside])
    spacing = margin.path.duration / (times.size - 1)
    inwards = float(np.sign(good - bad))
    edge, when, why = good, float(times[0]), -1
    for _ in range(REFINEMENTS + 1):
        while margin.worst(good, times) < 0.0:
            # At a refined time even this offset fails: look one step further inside, and remember that time.
            coarse, bad = times, good
            good += inwards * abs(float(offsets[1] - offsets[0]))
            if not offsets[0] <= good <= offsets[-1]:
                return inwards * np.inf, "reach", when
        edge = float(brentq(margin.worst, good, bad, args=(times,), xtol=OFFSET_TOLERANCE, rtol=1e-14))
        step = OFFSET_TOLERANCE
        while margin.worst(edge, times) < 0.0:
            edge += inwards * step
            step *= 2.0
        margins, joints = margin.rows(edge - inwards * PROBE, times)
        worst = int(margins.argmin())
        when, why = float(times[worst]), int(joints[worst])
        near = np.clip(np.linspace(when - spacing, when + spacing, 17), margin.path.start_time, margin.path.end_time)
        when = margin.critical_time(edge - inwards * PROBE, when, near[0], near[-1])
        times = np.union1d(coarse, np.append(near, when))
        spacing /= 8.0
    # An end between two times of the last search would be infeasible at the time between: only this test counts.
    edge, step = edge + inwards * OFFSET_TOLERANCE, OFFSET_TOLERANCE
    while margin.worst(edge, times) < 0.0:
        edge, step = edge + inwards * step, 2.0 * step
    return edge, "reach" if why < 0 else margin.leg.joint_names[why], when


def _search_range(leg: Any, positions: NDArray[np.float64], direction: NDArray[np.float64]) -> tuple[float, float]:
    """Offsets beyond which the path is farther along the direction than the foot ever gets."""
    lower = np.where(np.isfinite(leg.limits.lower), leg.limits.lower, -np.pi)
    upper = np.where(np.isfinite(leg.limits.upper), leg.limits.upper, np.pi)
    count = 7 if lower.size <= 3 else 3
    axes = [np.linspace(a, b, count) for a, b in zip(lower, upper, strict=True)]
    poses = np.array(list(itertools.product(*axes)))
    foot = np.asarray(leg.foot_position(poses, on_error="nan")) @ direction
    foot = foot[np.isfinite(foot)]
    if not foot.size:
        raise TrajectoryError("no pose within the joint limits could be assembled; give the search range")
    square = float(direction @ direction)
    along = positions @ direction
    slack = 0.1 * float(foot.max() - foot.min()) + 1e-3
    low, high = float(foot.min() - along.min()) - slack, float(foot.max() - along.max()) + slack
    # A path longer than the workspace leaves nothing to search, but the answer is then "none", not an error.
    return (min(low, high) / square, (max(low, high) + 1e-6) / square)
