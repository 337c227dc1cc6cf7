"""Volume of the reachable set and means over it, with an error estimate that decides how many samples are taken.

V is the integral of |det J| over the feasible independent coordinates: one foot position has one set of coordinates
as long as det J keeps its sign inside one assembly mode (checked, see `Injectivity`). The integral is taken by several
independently scrambled Sobol sequences (randomised quasi-Monte Carlo, Owen 1997). Each gives an unbiased estimate;
their spread gives a confidence interval that needs no smoothness, so it holds at the jumps that constraints make.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from leg_dynamics.analysis.workspace.poses import PoseEvaluator, Poses
from leg_dynamics.errors import LegDynamicsWarning, ParameterError, WorkspaceError

__all__ = [
    "CONFIDENCE",
    "Estimate",
    "Level",
    "Reachable",
    "cartesian_volume",
    "choose_sign",
    "reachable_set",
    "sobol_sequence",
]

REPLICATES = 16
CONFIDENCE = 0.99
_FIRST, _LAST = 6, 17
"""Powers of two: samples of a replicate at the first level and at the last."""

_LAST_NUMERIC = 10
"""At the last level of a route that is not compiled."""


@dataclass(frozen=True)
class Estimate:
    """A number and the half width of its confidence interval (at `CONFIDENCE`)."""

    value: float
    half_width: float

    def to_dict(self) -> dict[str, float]:
        """Both numbers."""
        return asdict(self)


@dataclass(frozen=True)
class Level:
    """One refinement: samples, estimated volume (m^n), half width, and the change since the level before."""

    samples: int
    volume: float
    half_width: float
    change: float


class Reachable(NamedTuple):
    """The feasible samples and what was estimated from all samples.

    `weights` (N,) are the volumes that the samples stand for; they add up to `volume.value`. `other_sign` is the volume
    of feasible poses with the other sign of det J, which are not among the samples.
    """

    poses: Poses
    weights: np.ndarray
    volume: Estimate
    mean: Estimate
    deviation: Estimate
    other_sign: float
    levels: tuple[Level, ...]
    converged: bool
    sampled: int


def choose_sign(evaluate: PoseEvaluator, q: np.ndarray) -> float:
    """Sign of det J that counts: that of the home pose where it is feasible and regular, else that of most volume."""
    if len(evaluate.leg.joint_names) != 3:
        return 0.0
    home = evaluate(q[None])
    if home.feasible[0] and home.condition[0] < 1e6:
        return math.copysign(1.0, float(home.volume[0]))
    lower, upper, _ = evaluate.box()
    poses = evaluate(lower + (upper - lower) * sobol_sequence(3, 0).random(4096 if evaluate.is_compiled else 512))
    volume = poses.volume[poses.feasible]
    return math.copysign(1.0, float(volume.sum())) if volume.size else 0.0


def reachable_set(
    evaluate: PoseEvaluator,
    *,
    tolerance: float,
    seed: int = 0,
    most_samples: int | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Reachable:
    """Sample the reachable set, finer and finer until its volume is known to the tolerance.

    Parameters
    ----------
    evaluate : PoseEvaluator
        Its `sign` chooses the poses that count.
    tolerance : float
        Of the volume, relative; both the half width and the change since the level before must be below it.
    seed : int
        Of the scrambling.
    most_samples : int, optional
        Where to give up; 2 million by default, 16,384 where the route is not compiled.
    progress : callable, optional
        Called with a text and a share.

    Returns
    -------
    Reachable

    Raises
    ------
    WorkspaceError
        No sample is feasible; says which constraint most of the best samples break.
    ParameterError
        The tolerance or the number of samples is not usable.

    Warns
    -----
    LegDynamicsWarning
        The tolerance was not reached.
    """
    check_tolerance(tolerance)
    last = _LAST if evaluate.is_compiled else _LAST_NUMERIC
    most = REPLICATES << last if most_samples is None else most_samples
    if isinstance(most, bool) or not isinstance(most, int) or most < REPLICATES << _FIRST:
        raise ParameterError(f"most_samples = {most!r} must be a whole number, at least {REPLICATES << _FIRST}")
    lower, upper, _ = evaluate.box()
    cell = float(np.prod(upper - lower))
    sequences = [sobol_sequence(len(lower), seed * REPLICATES + k) for k in range(REPLICATES)]
    # per replicate: integrals of 1, k, k^2 over the volume, and the other sign's volume, all times the samples
    sums = np.zeros((REPLICATES, 4))
    levels: list[Level] = []
    kept: list[Poses] = []
    best: list[Poses] = []
    each, added, converged = 0, 1 << _FIRST, False
    while not converged and REPLICATES * (each + added) <= most:
        poses = evaluate(lower + (upper - lower) * np.concatenate([sequence.random(added) for sequence in sequences]))
        owner = np.repeat(np.arange(REPLICATES), added)
        other = poses.normalised == -np.inf
        sums[:, 3] += np.bincount(owner[other], np.abs(poses.volume[other]), REPLICATES)
        rows = np.flatnonzero(poses.feasible)
        inside = poses[rows]
        weight, owner = np.abs(inside.volume), owner[rows]
        # a singular pose has no volume; its infinite condition number would make 0 * inf
        condition = np.where(weight > 0.0, inside.condition, 0.0)
        for power in range(3):
            sums[:, power] += np.bincount(owner, weight * condition**power, REPLICATES)
        kept.append(inside)
        if rows.size == 0:
            best.append(_best(poses))
        each, added = each + added, each + added
        volume = _estimate(cell * sums[:, 0] / each)
        change = abs(volume.value - levels[-1].volume) if levels else math.inf
        levels.append(Level(REPLICATES * each, volume.value, volume.half_width, change))
        allowed = tolerance * volume.value
        converged = volume.value > 0.0 and volume.half_width <= allowed and change <= allowed
        if progress is not None:
            progress(f"volume {volume.value:.4g} ± {volume.half_width:.1g}", min(1.0, REPLICATES * each / most))
    if volume.value == 0.0:
        _raise_empty(evaluate, Poses.joined(best), REPLICATES * each)
    if not converged:
        warnings.warn(
            f"the volume is known to {volume.half_width / volume.value:.2g} of itself only after {REPLICATES * each} "
            f"samples, not to the {tolerance:g} asked for: allow more samples, or a larger tolerance",
            LegDynamicsWarning,
            stacklevel=3,
        )
    poses = Poses.joined(kept)
    factor = cell / (REPLICATES * each)
    mean, deviation = _moments(sums)
    other = float(factor * sums[:, 3].sum())
    return Reachable(
        poses,
        np.abs(poses.volume) * factor,
        volume,
        mean,
        deviation,
        other,
        tuple(levels),
        converged,
        REPLICATES * each,
    )


def cartesian_volume(
    feasible: Callable[[np.ndarray], np.ndarray],
    lower: np.ndarray,
    upper: np.ndarray,
    *,
    tolerance: float,
    seed: int = 0,
    most_samples: int = REPLICATES << 14,
) -> tuple[Estimate, int]:
    """Volume of the foot positions in a box that inverse kinematics finds feasible poses for.

    Parameters
    ----------
    feasible : callable
        Positions (N, 3), m, to (N,) bool.
    lower, upper : (3,) array
        Corners of the box, m.
    tolerance : float
        Relative.
    seed, most_samples : int

    Returns
    -------
    Estimate
        m^3.
    int
        Samples taken.
    """
    check_tolerance(tolerance)
    sequences = [sobol_sequence(3, 7919 + seed * REPLICATES + k) for k in range(REPLICATES)]
    cell, hits = float(np.prod(upper - lower)), np.zeros(REPLICATES)
    each, added, volume = 0, 1 << _FIRST, Estimate(0.0, math.inf)
    while REPLICATES * (each + added) <= most_samples:
        points = np.concatenate([sequence.random(added) for sequence in sequences])
        hits += feasible(lower + (upper - lower) * points).reshape(REPLICATES, added).sum(axis=1)
        each, added = each + added, each + added
        previous, volume = volume.value, _estimate(cell * hits / each)
        allowed = tolerance * volume.value
        if volume.value > 0.0 and volume.half_width <= allowed and abs(volume.value - previous) <= allowed:
            break
    return volume, REPLICATES * each


def check_tolerance(tolerance: Any) -> None:
    """Refuse what is no relative tolerance, by a `ParameterError`."""
    number = isinstance(tolerance, int | float | np.floating) and not isinstance(tolerance, bool)
    if not (number and 0.0 < tolerance < 1.0):
        raise ParameterError(
            f"tolerance = {tolerance!r} must be a number between 0 and 1: it is relative to the volume"
        )


def sobol_sequence(dimensions: int, seed: int) -> Any:
    """A scrambled Sobol sequence, `scipy.stats.qmc.Sobol`; the same for the same seed."""
    from scipy.stats import qmc

    # `seed`, which SciPy before 1.15 knows as well
    return qmc.Sobol(dimensions, scramble=True, seed=np.random.default_rng(seed))


def _estimate(values: np.ndarray) -> Estimate:
    """Mean of independent estimates, and Student's confidence interval."""
    from scipy.stats import t

    factor = float(t.ppf(0.5 + CONFIDENCE / 2.0, len(values) - 1))
    return Estimate(float(values.mean()), factor * float(values.std(ddof=1)) / math.sqrt(len(values)))


def _moments(sums: np.ndarray) -> tuple[Estimate, Estimate]:
    """Mean condition number and its deviation; intervals from the replicates left out one by one (jackknife)."""

    def moments(total: np.ndarray) -> tuple[float, float]:
        mean = total[1] / total[0]
        return mean, math.sqrt(max(total[2] / total[0] - mean**2, 0.0))

    total = sums.sum(axis=0)
    without = np.array([moments(total - row) for row in sums])
    whole, count = np.array(moments(total)), len(sums)
    pseudo = count * whole - (count - 1) * without
    return tuple(  # type: ignore[return-value]
        Estimate(float(value), _estimate(column).half_width) for value, column in zip(whole, pseudo.T, strict=True)
    )


def _best(poses: Poses) -> Poses:
    """The few poses that are nearest to being feasible, or any where none can be closed."""
    order = np.argsort(np.where(np.isnan(poses.normalised), -np.inf, poses.normalised))[::-1]
    return poses[order[:4]]


def _raise_empty(evaluate: PoseEvaluator, best: Poses, count: int) -> None:
    values = np.where(np.isfinite(best.normalised), best.normalised, -np.inf)
    nearest = int(np.argmax(values))
    if not math.isfinite(values[nearest]):
        raise WorkspaceError(
            f"the workspace of {evaluate.leg.name!r} is empty: at none of {count} samples can the loops be closed; "
            "check lengths and limits",
            margin=-math.inf,
            constraint="assembly",
            samples=count,
        )
    index, margin = int(best.active[nearest]), float(best.margin[nearest])
    name, unit = evaluate.name_of(index), evaluate.constraints[index].unit
    raise WorkspaceError(
        f"the workspace of {evaluate.leg.name!r} is empty: none of {count} samples fulfils all constraints, the best "
        f"one misses {name!r} ({evaluate.constraints[index].meaning}) by {-margin:.4g} {unit}; widen that limit, or "
        "ask for more samples if the workspace is tiny",
        margin=margin,
        constraint=name,
        samples=count,
    )
