"""Closed states of the assembly mode, many at a time: continuation from the seed over the joint limits, in NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leg_dynamics.symbolic.closure import Closure, row_arrays

__all__ = ["ClosureArrays", "sample_closed"]

NEWTON_ITERATIONS = 8
CLOSED = 1e-13
CONTINUATION_STEP = 0.2
# The tangent must predict the corrected point to this share of the step, or the state stays where it was.
CORRECTION_SHARE = 0.3


@dataclass(frozen=True)
class ClosureArrays:
    """A closure on arrays of states: `n` independent coordinates first, `unit` (nu,) in rad or m."""

    closure: Closure
    n: int
    unit: np.ndarray

    def rows(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (S, r) and dimensionless derivatives (S, r, nu) of the basic rows."""
        phi, K = row_arrays(self.closure.basic, u)
        return phi, K * self.unit

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


def sample_closed(
    arrays: ClosureArrays, seed: np.ndarray, lower: np.ndarray, upper: np.ndarray, count: int, random_seed: int = 0
) -> np.ndarray:
    """Closed states reached from the seed by continuation, the seed first.

    A state that cannot be followed further stays at the last closed pose on its way.

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
    """
    generator = np.random.default_rng(random_seed)
    n = arrays.n
    target = generator.uniform(lower, upper, (count, n))
    target[0] = seed[:n]
    u = np.tile(seed, (count, 1))
    if u.shape[1] == n or not arrays.closure.basic:
        u[:, :n] = target
        return u
    stages = max(1, int(np.ceil(np.abs((target - seed[:n]) / arrays.unit[:n]).max() / CONTINUATION_STEP)))
    following = np.ones(count, dtype=bool)
    change = (target - seed[:n]) / stages
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
    return u
