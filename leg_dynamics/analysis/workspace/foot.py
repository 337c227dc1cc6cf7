"""Feasible poses for given foot positions: slices, chords, and the check that a position has one pose."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.analysis.workspace.poses import ASSEMBLY, PoseEvaluator, Poses

if TYPE_CHECKING:
    from leg_dynamics.leg import Leg

__all__ = ["FootEvaluator", "Slice", "slice_at"]

_DISTINCT = 1e-3
"""rad or m; two solutions nearer than this are one: near a singularity the root of `_ARRIVED` is left of an error."""

_SEEDS, _ITERATIONS = 20_000, 20
_ARRIVED = 1e-9
"""m; after one more step of Newton's method nothing is left of it."""

_SAME_PLACE = 1e-6
"""m; how near to its goal the foot of a solution must be."""


class FootEvaluator:
    """Evaluates foot positions over all their poses: by the leg's formulas, else by Newton's method from near samples.

    Parameters
    ----------
    evaluate : PoseEvaluator
    samples : Poses
        Feasible poses all over the workspace, where Newton's method starts: of a route without formulas, whose own
        inverse kinematics takes a thousand times longer and stays with one branch.

    Attributes
    ----------
    available : bool
        Whether the leg has three coordinates, so that positions have single poses.
    """

    def __init__(self, evaluate: PoseEvaluator, samples: Poses) -> None:
        from scipy.spatial import cKDTree

        self.evaluate = evaluate
        self.leg = evaluate.leg
        self.available = len(self.leg.joint_names) == 3
        self._samples = samples[:: max(1, len(samples) // _SEEDS)]
        self._near = cKDTree(self._samples.foot)
        self._branches = self._own_branches() if leg_has_formulas(self.leg) else ()

    @property
    def is_quick(self) -> bool:
        """Whether many thousand positions take no time."""
        return self.evaluate.is_compiled

    def _apart(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Largest difference of two poses in a coordinate, whole turns not counted, (N,)."""
        difference = np.abs(one - other)
        turning = np.array([unit == "rad" for unit in self.leg.units.joints])
        turned = difference - 2.0 * math.pi * np.round(difference / (2.0 * math.pi))
        return np.abs(np.where(turning, turned, difference)).max(axis=1, initial=0.0)

    def _own_branches(self) -> tuple[str, ...]:
        """Branches of the inverse kinematics that lead into the leg's assembly mode; the others are never solutions."""
        p = self._samples.foot[:: max(1, len(self._samples) // 2000)]

        def leads_home(branch: str) -> bool:
            q = self.leg.inverse_kinematics(p, branch, limits="ignore", on_error="nan")
            return bool(np.isfinite(self._evaluated(q, p).foot).any())

        return tuple(branch for branch in self.leg.branches if leads_home(branch))

    def __call__(self, p: np.ndarray) -> Poses:
        """The pose of each position p (N, 3) that is furthest inside its constraints; NaN where there is none."""
        return self.counted(p, 1)[0]

    def counted(self, p: np.ndarray, starts: int = 4) -> tuple[Poses, np.ndarray]:
        """As calling, with the number of distinct feasible poses of each position, (N,).

        `starts` near samples are tried where there are no formulas: of a position that several sheets of the workspace
        cover, the near samples lie on all of them.
        """
        best: Poses | None = None
        count = np.zeros(len(p), dtype=int)
        found: list[Poses] = []
        for q in self._solutions(p, starts):
            poses = self._evaluated(q, p)
            new = poses.feasible.copy()
            for other in found:
                new &= ~(other.feasible & (self._apart(other.q, poses.q) < _DISTINCT))
            count += new
            found.append(poses)
            if best is None:
                best = poses
            else:
                better = np.nan_to_num(poses.normalised, nan=-math.inf) > np.nan_to_num(best.normalised, nan=-math.inf)
                best = Poses.where(better, poses, best)
        assert best is not None
        return best, count

    def _solutions(self, p: np.ndarray, starts: int) -> Iterator[np.ndarray]:
        if self._branches:
            for branch in self._branches:
                yield self.leg.inverse_kinematics(p, branch, limits="ignore", on_error="nan")
            return
        _, nearest = self._near.query(p, k=min(starts, len(self._samples)))
        for column in nearest.reshape(len(p), -1).T:
            yield self._newton(self._samples.q[column], p)

    def _newton(self, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Poses whose feet are at p, from nearby ones; NaN where the method does not arrive."""
        lower, upper, _ = self.evaluate.box()
        longest = 0.2 * (upper - lower)
        q, active = q.copy(), np.arange(len(q))
        arrived = np.zeros(len(q), dtype=bool)
        for _ in range(_ITERATIONS):
            foot, J = self.evaluate.foot_and_jacobian(q[active])
            missing = p[active] - foot
            regular = np.isfinite(missing).all(axis=1) & (np.abs(np.linalg.det(np.nan_to_num(J))) > 1e-12)
            near = np.abs(missing).max(axis=1, initial=0.0) < _ARRIVED
            arrived[active[near & regular]] = True
            # arrived rows take this step as well, which makes them exact
            active, missing, J, near = active[regular], missing[regular], J[regular], near[regular]
            if active.size == 0:
                break
            step = np.linalg.solve(J, missing[..., None])[..., 0]
            step /= np.maximum(np.abs(step / longest).max(axis=1, keepdims=True), 1.0)
            q[active] += step
            active = active[~near]
        return np.where(arrived[:, None], q, np.nan)

    def _evaluated(self, q: np.ndarray, p: np.ndarray) -> Poses:
        nothing = np.full(len(q), np.nan)
        poses = Poses(
            q, np.full(p.shape, np.nan), nothing, nothing, np.full(len(q), ASSEMBLY), nothing, nothing, nothing
        )
        known = np.flatnonzero(np.isfinite(q).all(axis=1))
        if known.size == 0:
            return poses
        found = self.evaluate(q[known])
        # A branch may belong to another assembly mode, in which these coordinates put the foot elsewhere.
        there = np.abs(found.foot - p[known]).max(axis=1, initial=0.0) < _SAME_PLACE
        rows, arrived = np.zeros(len(q), dtype=int), np.zeros(len(q), dtype=bool)
        rows[known], arrived[known] = np.arange(known.size), there
        return Poses.where(arrived, found[rows], poses)


def leg_has_formulas(leg: Leg) -> bool:
    """Whether the inverse kinematics is a formula for each branch, in machine code."""
    return leg.route == "closed_form"


@dataclass(frozen=True)
class Slice:
    """A plane section of the workspace.

    Attributes
    ----------
    plane : str
        For example ``y = 0``.
    axes : tuple of str
        Names of the horizontal and the vertical coordinate.
    first, second : (A,), (B,) array
        Their values, m.
    condition : (B, A) array
        Condition number; NaN outside.
    active : (B, A) array of int
        Index of the active constraint where the position is feasible; where not, of the one broken most.
    normalised : (B, A) array
        Smallest normalised margin; NaN where nothing assembles.
    """

    plane: str
    axes: tuple[str, str]
    first: np.ndarray
    second: np.ndarray
    condition: np.ndarray
    active: np.ndarray
    normalised: np.ndarray


def slice_at(
    foot: FootEvaluator, normal: int, value: float, lower: np.ndarray, upper: np.ndarray, resolution: int
) -> Slice:
    """Section of the workspace by a plane across a coordinate axis.

    Parameters
    ----------
    foot : FootEvaluator
    normal : int
        0, 1 or 2: the axis that stands on the plane.
    value : float
        m; where.
    lower, upper : (3,) array
        Corners of the workspace's box, m; a margin is added.
    resolution : int
        Positions a side.
    """
    one, two = (axis for axis in range(3) if axis != normal)
    pad = 0.04 * (upper - lower)
    first, second = (np.linspace(lower[k] - pad[k], upper[k] + pad[k], resolution) for k in (one, two))
    points = np.empty((resolution, resolution, 3))
    points[..., normal], points[..., one], points[..., two] = value, first[None, :], second[:, None]
    poses = foot(points.reshape(-1, 3))
    shape = (resolution, resolution)
    condition = np.where(poses.feasible, poses.condition, np.nan).reshape(shape)
    return Slice(
        f"{'xyz'[normal]} = {round(value, 9) + 0.0:.4g} m",
        ("xyz"[one], "xyz"[two]),
        first,
        second,
        condition,
        poses.active.reshape(shape),
        poses.normalised.reshape(shape),
    )
