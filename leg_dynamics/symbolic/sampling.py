"""Closed states of the assembly mode, many at a time: continuation from the seed over the joint limits, in NumPy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi
import numpy as np

from leg_dynamics.symbolic.closure import Closure, evaluate_rows
from leg_dynamics.symbolic.motion import Motion

__all__ = ["ClosureArrays", "Ways", "sample_closed", "ways_from"]

NEWTON_ITERATIONS = 8
CLOSED = 1e-13
CONTINUATION_STEP = 0.2
# A home pose far outside the joint limits is not followed for ever.
MOST_STAGES = 200
# Ways that are shorter by these shares are tried where a larger share of the samples than that does not leave the seed.
SHORTER = (0.25, 0.06, 0.015)
MOST_STUCK = 0.25
# The tangent must predict the corrected point to this share of the step, or the state stays where it was.
CORRECTION_SHARE = 0.3


@dataclass(frozen=True)
class ClosureArrays:
    """A closure on arrays of states: `n` independent coordinates first, `unit` (nu,) in rad or m."""

    closure: Closure
    n: int
    unit: np.ndarray

    @cached_property
    def _graph(self) -> casadi.Function:
        """Residuals and derivatives of the basic rows as one column: hundreds of calls are worth a graph."""
        u = casadi.SX.sym("u", self.unit.size)
        residuals, derivatives = evaluate_rows(self.closure.basic, Motion([u[k] for k in range(self.unit.size)]))
        entries = [row.get(k, 0.0) for row in derivatives for k in range(self.unit.size)]
        return casadi.Function("rows", [u], casadi.cse([casadi.densify(casadi.vertcat(*residuals, *entries))]))

    @cached_property
    def _graphs(self) -> dict[int, casadi.Function]:
        return {}

    def _graph_of(self, count: int) -> casadi.Function:
        """The graph for many states at once."""
        if count not in self._graphs:
            self._graphs[count] = self._graph.map(count)
        return self._graphs[count]

    def rows(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (S, r) and dimensionless derivatives (S, r, nu) of the basic rows."""
        count, size = u.shape
        rows = len(self.closure.basic)
        if rows == 0 or count == 0:
            return np.zeros((count, rows)), np.zeros((count, rows, size))
        # Through buffers: a matrix of CasADi comes back number by number, which takes most of the time.
        states, found = np.ascontiguousarray(u), np.empty((count, rows * (1 + size)))
        buffer: Any
        buffer, evaluate = self._graph_of(count).buffer()
        buffer.set_arg(0, states.data)
        buffer.set_res(0, found.data)
        evaluate()
        return found[:, :rows].copy(), found[:, rows:].reshape(count, rows, size) * self.unit

    def solve(self, K: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Least-squares solution of K_z x = right, (S, nz, c), in units of `unit`."""
        Kz = K[:, :, self.n :]
        normal = Kz.transpose(0, 2, 1) @ Kz
        # A share of the rounding keeps singular states from stopping the others.
        normal += 1e-15 * np.eye(normal.shape[1])
        result: np.ndarray = np.linalg.solve(normal, Kz.transpose(0, 2, 1) @ right)
        return result

    def correct(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Newton on the unknowns: states, residuals (S,) and the largest total correction (S,)."""
        u = u.copy()
        moved = np.zeros(len(u))
        phi, K = self.rows(u)
        for _ in range(NEWTON_ITERATIONS):
            step = self.solve(K, -phi[:, :, None])[:, :, 0]
            size = np.abs(step).max(axis=1, initial=0.0)
            # A wild step is a lost state: it must not overflow the sines of the others.
            step[~(size < 1e3)] = 0.0
            u[:, self.n :] += step * self.unit[self.n :]
            moved += np.where(size < 1e3, size, np.inf)
            phi, K = self.rows(u)
            if size.max(initial=0.0) < 1e-13:
                break
        return u, np.abs(phi).max(axis=1, initial=0.0), moved


@dataclass(frozen=True)
class Ways:
    """Straight ways in the independent coordinates, followed from the seed.

    Attributes
    ----------
    target : (S, n) array
        Independent coordinates at the ends.
    poses : (T, S, nu) array
        S ways at T evenly spaced poses, the seed first. A way that cannot be followed further stays at its last pose.
    following : (T, S) bool array
        Where a way was still followed.
    distance : (S,) array
        Between two poses: the largest change of an independent coordinate, lengths as shares of the mechanism's.
    """

    target: np.ndarray
    poses: np.ndarray
    following: np.ndarray
    distance: np.ndarray


def ways_from(
    arrays: ClosureArrays,
    seed: np.ndarray,
    target: np.ndarray,
    longest: float = CONTINUATION_STEP,
    *,
    all_or_none: bool = False,
) -> Ways:
    """Follow straight ways from the seed (nu,) to target (S, n), all in as many steps of at most `longest`.

    With `all_or_none` nothing is followed any more once one way is lost.
    """
    count, n = target.shape
    u = np.tile(seed, (count, 1))
    farthest = float(np.abs((target - seed[:n]) / arrays.unit[:n]).max(initial=0.0))
    stages = max(1, int(np.ceil(min(farthest / longest, MOST_STAGES))))
    following = np.ones(count, dtype=bool)
    change = (target - seed[:n]) / stages
    poses, followed = [u.copy()], [following]
    for _ in range(stages):
        _, K = arrays.rows(u)
        scaled = (change / arrays.unit[:n])[:, :, None]
        tangent = arrays.solve(K, -(K[:, :, :n] @ scaled))[:, :, 0]
        size = np.abs(np.concatenate([scaled[:, :, 0], tangent], axis=1)).max(axis=1)
        trial = u.copy()
        trial[:, :n] += change
        trial[:, n:] += np.where(size < 1e2, 1.0, 0.0)[:, None] * tangent * arrays.unit[n:]
        trial, residual, moved = arrays.correct(trial)
        good = following & (residual < CLOSED) & (moved <= CORRECTION_SHARE * size + 1e-9)
        u[good] = trial[good]
        following = good | (following & (size == 0.0))
        poses.append(u.copy())
        followed.append(following)
        if all_or_none and not following.all():
            break
    distance = np.abs(change / arrays.unit[:n]).max(axis=1)
    return Ways(target, np.stack(poses), np.stack(followed), distance)


def sample_closed(
    arrays: ClosureArrays, seed: np.ndarray, lower: np.ndarray, upper: np.ndarray, count: int, random_seed: int = 0
) -> tuple[np.ndarray, Ways | None]:
    """Closed states reached from the seed by continuation, the seed first.

    A state that cannot be followed further stays at the last closed pose on its way; where most do not leave the seed,
    they are sought nearer to it.

    Parameters
    ----------
    arrays : ClosureArrays
    seed : (nu,) array
        A closed, regular state.
    lower, upper : (n,) array
        Box of the independent coordinates.
    count : int
    random_seed : int

    Returns
    -------
    (count, nu) array
        The states.
    Ways or None
        How those were sought that are not nearer; None where there are no loops to close.
    """
    generator = np.random.default_rng(random_seed)
    n = arrays.n
    target = generator.uniform(lower, upper, (count, n))
    target[0] = seed[:n]
    if arrays.unit.size == n or not arrays.closure.basic:
        u = np.tile(seed, (count, 1))
        u[:, :n] = target
        return u, None
    ways = ways_from(arrays, seed, target)
    samples = ways.poses[-1]
    # Where the first step is too long for most, beside a singular pose, shorter ones lead to poses that differ.
    for share in SHORTER:
        stuck = np.flatnonzero((samples == seed).all(axis=1))
        if len(stuck) <= MOST_STUCK * count:
            break
        nearer = seed[:n] + share * (target[stuck] - seed[:n])
        samples[stuck] = ways_from(arrays, seed, nearer, share * CONTINUATION_STEP).poses[-1]
    return samples, ways
