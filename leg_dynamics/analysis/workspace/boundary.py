"""The boundary of the reachable set and its extremes: where a margin vanishes, and how far the set reaches."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence

import numpy as np

from leg_dynamics.analysis.workspace.poses import PoseEvaluator, Poses

__all__ = ["boundary", "climb"]

_BISECTIONS = 40
_PROBE, _ROUNDING = 1e-6, 1e-9
"""Of a coordinate's range, for differences; of a normalised margin, which an optimum on a constraint misses."""

_CLOUD, _ROUNDS, _CLIMBERS = 64, 90, 4


def boundary(evaluate: PoseEvaluator, resolution: int) -> tuple[Poses, np.ndarray]:
    """Points of the boundary, by the changes between feasible and infeasible along the edges of a grid.

    Parameters
    ----------
    evaluate : PoseEvaluator
    resolution : int
        Grid points a coordinate. One more lies beyond each end, so that the coordinates' own limits are boundaries too;
        a whole turn has no ends.

    Returns
    -------
    Poses
        The last feasible poses, within 2^-40 of a grid step of the boundary; a feature thinner than a step is missed.
    (N,) array of int
        The constraint that is broken just beyond each, as in `Poses.active`.
    """
    lower, upper, turn = evaluate.box()
    axes = []
    for low, high, whole in zip(lower, upper, turn, strict=True):
        step = (high - low) / (resolution - 1)
        axes.append(np.linspace(low, high, resolution) if whole else np.arange(-1, resolution + 1) * step + low)
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = evaluate(grid.reshape(-1, len(axes))).feasible.reshape(grid.shape[:-1])
    ends: list[tuple[np.ndarray, np.ndarray]] = []
    for axis in range(len(axes)):
        before, after = (np.moveaxis(grid, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
        here, there = (np.moveaxis(inside, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
        leaving, entering = here & ~there, ~here & there
        ends += [(before[leaving], after[leaving]), (after[entering], before[entering])]
    good, bad = (np.concatenate([pair[k] for pair in ends]) for k in (0, 1))
    return bisected(evaluate, good, bad)


def bisected(
    evaluate: Callable[[np.ndarray], Poses], good: np.ndarray, bad: np.ndarray, halvings: int = _BISECTIONS
) -> tuple[Poses, np.ndarray]:
    """Last feasible points between feasible and infeasible ones, and the constraint broken just beyond, (N,)."""
    for _ in range(halvings):
        middle = 0.5 * (good + bad)
        inside = evaluate(middle).feasible[:, None]
        good, bad = np.where(inside, middle, good), np.where(inside, bad, middle)
    return evaluate(good), evaluate(bad).active


def climb(
    evaluate: PoseEvaluator, starts: Poses, goals: Sequence[Callable[[Poses], np.ndarray]], seed: int = 0
) -> list[Poses]:
    """The feasible pose that maximises each goal, from the best of the given ones by a shrinking random search.

    It needs no derivative, and walks along constraints into their corners, where such maxima lie.

    Parameters
    ----------
    evaluate : PoseEvaluator
    starts : Poses
        Feasible.
    goals : sequence of callable
        Poses to (N,) numbers.
    seed : int

    Returns
    -------
    list of Poses
        One pose a goal.
    """
    lower, upper, _ = evaluate.box()
    generator = np.random.default_rng(seed)
    # several climbers a goal, each from the best of its own part of the poses: one alone may end in a wrong corner
    parts = np.array_split(generator.permutation(len(starts)), min(_CLIMBERS, len(starts)))
    climbing = [(goal, starts[part]) for goal in goals for part in parts]
    best = [poses[[int(np.nanargmax(goal(poses)))]] for goal, poses in climbing]
    radius = np.full(len(best), 0.05)
    rounds, cloud = (_ROUNDS, _CLOUD) if evaluate.is_compiled else (_ROUNDS // 5, _CLOUD // 4)
    for _ in range(rounds):
        steps = generator.standard_normal((len(best), cloud, len(lower))) * radius[:, None, None] * (upper - lower)
        centres = np.concatenate([pose.q for pose in best])[:, None, :]
        poses = evaluate(np.clip(centres + steps, lower, upper).reshape(-1, len(lower)))
        for k, (goal, _) in enumerate(climbing):
            mine = poses[k * cloud : (k + 1) * cloud]
            values = np.where(mine.feasible, goal(mine), -math.inf)
            top = int(np.argmax(values))
            if values[top] > goal(best[k])[0]:
                best[k] = mine[[top]]
                radius[k] = min(0.1, 1.1 * radius[k])
            else:
                radius[k] *= 0.8
    found = []
    for number, goal in enumerate(goals):
        candidates = best[number * len(parts) : (number + 1) * len(parts)]
        first = int(np.argmax([float(goal(pose)[0]) for pose in candidates]))
        found.append(_polished(evaluate, candidates[first], goal, lower, upper))
    return found


def _polished(
    evaluate: PoseEvaluator, best: Poses, goal: Callable[[Poses], np.ndarray], lower: np.ndarray, upper: np.ndarray
) -> Poses:
    """Walk on along the constraints by sequential quadratic programming; the old pose where that finds no better."""
    from scipy.optimize import minimize

    span, start = upper - lower, best.q[0]
    scale = abs(float(goal(best)[0])) or 1.0
    probes = np.concatenate([np.zeros((1, len(span))), _PROBE * np.eye(len(span)), -_PROBE * np.eye(len(span))])

    def values(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Goal and normalised margins at u and beside it, in units of the coordinates' ranges."""
        q = start + (u + probes) * span
        margins = evaluate.all_margins(q) / [each.scale for each in evaluate.constraints]
        return -goal(evaluate(q)) / scale, margins

    def slope(columns: np.ndarray) -> np.ndarray:
        count = len(span)
        return ((columns[1 : count + 1] - columns[count + 1 :]) / (2.0 * _PROBE)).T

    constraint = {"type": "ineq", "fun": lambda u: values(u)[1][0], "jac": lambda u: slope(values(u)[1])}
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            result = minimize(
                lambda u: values(u)[0][0],
                np.zeros(len(span)),
                jac=lambda u: slope(values(u)[0]),
                method="SLSQP",
                bounds=list(zip((lower - start) / span, (upper - start) / span, strict=True)),
                constraints=[constraint] if evaluate.constraints else [],
                options={"maxiter": 60, "ftol": 1e-14},
            )
    except (ValueError, ArithmeticError):  # it walked where nothing can be closed
        return best
    q = (start + result.x * span)[None]
    if not np.isfinite(q).all():
        return best
    pose = evaluate(q)
    better = pose.normalised[0] >= -_ROUNDING and goal(pose)[0] > goal(best)[0]
    return pose if better else best
