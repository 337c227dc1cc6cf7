"""Indices of one design: volume, dexterity, step length and height, at a fixed resolution.

Definitions are those of `leg_dynamics.analysis.workspace`, Rong 2012 (31), (32) corrected, L and Z. Every design is
sampled by the same points of a scrambled Sobol sequence in the box of its own coordinates: designs that differ little
then differ little in their errors too, and nothing depends on which other designs are computed beside.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from leg_dynamics.analysis.design.poses import OnePose
from leg_dynamics.analysis.workspace.sampling import sobol_sequence
from leg_dynamics.analysis.workspace.step import home_inside, no_step, with_home

__all__ = ["DEXTERITY", "STEP", "Sampler", "dexterity_indices", "half_widths", "step_indices"]

DEXTERITY = ("V", "kbar", "ktilde", "k_min")
STEP = ("L", "Z", "Z_b", "Z_f")

_BLOCK = 8192
_LINE = 257
"""Points of the line through home on either side."""
_SECTION, _ROUNDS = 64, 5
"""Parts of an interval with an end of the workspace in it, again and again: 64^-5 of a step is below a nanometre."""
_COLUMNS, _FEWER, _HEIGHTS, _ZOOMS = 65, 17, 129, 7
"""Of the half plane (x, z) that is searched for the greatest lift: columns at first, and around the best one then."""
_HALVINGS = 24
_REPLICATES = 16


class Sampler:
    """Points of the unit cube that every design is sampled by.

    Parameters
    ----------
    dimensions : int
    count : int
        A power of two.
    seed : int
        Of the scrambling.
    """

    def __init__(self, dimensions: int, count: int, seed: int) -> None:
        self.points = sobol_sequence(dimensions, seed).random(count)


def _inside(rows: np.ndarray, sign: float) -> np.ndarray:
    good = rows[:, 0] >= 0.0
    return good & (rows[:, 2] * sign > 0.0) if sign else good


def _feasible(one: OnePose, points: np.ndarray, sign: float) -> tuple[np.ndarray, float]:
    """Rows of the feasible samples, and the volume of coordinates that a sample stands for."""
    q = one.lower + (one.upper - one.lower) * points
    parts = [one.poses(q[start : start + _BLOCK]) for start in range(0, len(q), _BLOCK)]
    rows = np.concatenate(parts)
    return rows[_inside(rows, sign)], float(np.prod(one.upper - one.lower)) / len(q)


def dexterity_indices(one: OnePose, points: np.ndarray, sign: float) -> tuple[dict[str, float], np.ndarray | None]:
    """Volume and dexterity.

    Parameters
    ----------
    one : OnePose
    points : (S, n) array
        In the unit cube.
    sign : float
        Of det J of the poses that count; 0 for both.

    Returns
    -------
    dict of str to float
        ``V`` (m^n), ``kbar``, ``ktilde``, ``k_min`` (the least of the samples); V = 0 and NaN where none is feasible.
    (2, 3) array or None
        Corners of the box of the feasible feet, m.
    """
    rows, cell = _feasible(one, points, sign)
    weight = np.abs(rows[:, 2])
    regular = np.isfinite(rows[:, 1]) & (weight > 0.0)
    rows, weight = rows[regular], weight[regular]
    if not len(rows):
        return {"V": 0.0, "kbar": math.nan, "ktilde": math.nan, "k_min": math.nan}, None
    total, k = weight.sum(), rows[:, 1]
    mean = float((weight * k).sum() / total)
    deviation = math.sqrt(float((weight * (k - mean) ** 2).sum() / total))
    values = {"V": float(total * cell), "kbar": mean, "ktilde": deviation, "k_min": float(k.min())}
    return values, np.array([rows[:, 3:6].min(axis=0), rows[:, 3:6].max(axis=0)])


def half_widths(ones: Iterable[OnePose], names: Iterable[str], count: int, sign: float, seed: int) -> dict[str, float]:
    """Relative half widths, 99 % confidence, of some indices at a number of samples: the worst of some designs.

    From the spread of 16 independently scrambled sequences, each as long as the one that the study uses.
    """
    from scipy.stats import t

    factor = float(t.ppf(0.995, _REPLICATES - 1))
    worst = dict.fromkeys(names, 0.0)
    for one in ones:
        found = []
        for replicate in range(_REPLICATES):
            sampler = Sampler(len(one.lower), count, (seed + 1) * 1_000_003 + replicate)
            found.append([dexterity_indices(one, sampler.points, sign)[0][name] for name in worst])
        values = np.array(found)
        mean = np.abs(values.mean(axis=0))
        # a workspace that most sequences miss tells nothing about the resolution of the others
        if not np.isfinite(mean).all() or not mean[0] > 0.0:
            continue
        spread = factor * values.std(axis=0, ddof=1) / np.maximum(mean, 1e-300)
        worst = {name: max(old, float(new)) for (name, old), new in zip(worst.items(), spread, strict=True)}
    return worst


def step_indices(one: OnePose, box: np.ndarray, sign: float, down: float) -> dict[str, float]:
    """Step length L and heights Z_f, Z_b (Z is Z_b, the one whose trends the paper's figures have), m.

    As `leg_dynamics.analysis.workspace.step_sizes` has them.

    Parameters
    ----------
    one : OnePose
        With three coordinates.
    box : (2, 3) array
        Corners of the box of the feasible feet, m.
    sign : float
    down : float
        +1 where the hip frame's z points down, -1 where it points up.

    Returns
    -------
    dict of str to float

    Raises
    ------
    WorkspaceError
        The home position is not feasible: no step starts there.
    """
    home = home_inside(lambda point: bool(_inside(one.feet(point[None]), sign)[0]), one.home, box[0], box[1])
    if home is None:
        raise no_step(one.home, *one.active_at(one.home))
    lower, upper = with_home(box[0], box[1], home)
    pad = 0.05 * (upper - lower) + 1e-3
    plane = _Plane(one, home, sign, down, lower - pad, upper + pad)
    back, front = plane.lift(-1.0), plane.lift(1.0)
    return {"L": plane.chord(), "Z": back, "Z_b": back, "Z_f": front}


class _Plane:
    """The x-z plane through home."""

    def __init__(
        self, one: OnePose, home: np.ndarray, sign: float, down: float, lower: np.ndarray, upper: np.ndarray
    ) -> None:
        self.one, self.sign, self.down, self.lower, self.upper = one, sign, down, lower, upper
        self.x0, self.y0, self.h = (float(value) for value in home)

    def feasible(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        x, z = np.broadcast_arrays(x, z)
        points = np.stack([x, np.full(x.shape, self.y0), z], axis=-1).reshape(-1, 3)
        return _inside(self.one.feet(points), self.sign).reshape(x.shape)

    def chord(self) -> float:
        h, ends = np.array(self.h), []
        for bound in (self.lower[0], self.upper[0]):
            line = np.linspace(self.x0, bound, _LINE)
            outside = np.flatnonzero(~self.feasible(line, h))
            if outside.size == 0:
                ends.append(float(bound))
                continue
            good, bad = line[outside[0] - 1], line[outside[0]]
            for _ in range(_ROUNDS):
                part = np.linspace(good, bad, _SECTION + 1)
                inside = self.feasible(part[1:-1], h)
                first = len(inside) if inside.all() else int(np.argmin(inside))
                good, bad = part[first], part[first + 1]
            ends.append(float(good))
        return ends[1] - ends[0]

    def lift(self, side: float) -> float:
        """Greatest rise above home of the feasible feet on one side of it."""
        low, high = (self.x0, float(self.upper[0])) if side > 0.0 else (float(self.lower[0]), self.x0)
        if not low < high:
            return math.nan
        best, at = -math.inf, math.nan
        first, last = low, high
        for zoom in range(_ZOOMS):
            x = np.linspace(first, last, _COLUMNS if zoom == 0 else _FEWER)
            rise = self._rises(x)
            top = int(np.argmax(rise))
            if rise[top] > best:
                best, at = float(rise[top]), float(x[top])
            if not math.isfinite(best):
                return math.nan
            step = x[1] - x[0]
            first, last = max(low, at - step), min(high, at + step)
        return best

    def _rises(self, x: np.ndarray) -> np.ndarray:
        """Rise of the highest feasible foot at each x (N,); -inf where there is none."""
        ends = (self.lower[2], self.upper[2]) if self.down > 0.0 else (self.upper[2], self.lower[2])
        # From the top down, home's own height too: a workspace may be thinner than the lines are apart.
        z = np.sort(np.append(np.linspace(*ends, _HEIGHTS), self.h))[:: int(self.down)]
        inside = self.feasible(x[:, None], z[None, :])
        rise = np.full(len(x), -np.inf)
        columns = np.flatnonzero(inside.any(axis=1))
        if not columns.size:
            return rise
        highest = np.maximum(inside[columns].argmax(axis=1), 1)
        bad, good = z[highest - 1], z[highest]
        for _ in range(_HALVINGS):
            middle = 0.5 * (bad + good)
            is_good = self.feasible(x[columns], middle)
            bad, good = np.where(is_good, bad, middle), np.where(is_good, middle, good)
        rise[columns] = self.down * (self.h - good)
        return rise
