"""How the standing feet share the load: least forces that balance it, pushing only, and within friction if asked."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.errors import ShapeError

__all__ = ["LoadSharing", "share_load"]

BALANCE_TOLERANCE = 1e-9
"""Relative to the load: a larger residual means that the feet cannot balance it at all."""

_PUSH_TOLERANCE = 1e-12


class LoadSharing(NamedTuple):
    """Foot forces of T instants."""

    force: NDArray[np.float64]
    """Of the ground on each foot, N, (T, N, 3); zero in the air, NaN where there is no solution."""
    residual: NDArray[np.float64]
    """Norm of the missing force (N) and moment (N·m over the feet's distance from the centre of mass), (T,)."""
    feasible: NDArray[np.bool_]
    """Whether the load is balanced by feet that only push, within friction, (T,)."""


def share_load(
    feet: ArrayLike,
    stance: ArrayLike,
    centre: ArrayLike,
    load: ArrayLike,
    moment: ArrayLike | None = None,
    *,
    friction: float | None = None,
) -> LoadSharing:
    """Distribute a load over the standing feet.

    Of all forces with sum(f) = load and sum((r - centre) x f) = moment, and f_z >= 0, those with the least sum of
    squares. The ground is level. Without active bounds they follow from the pseudo-inverse; else they solve a
    least-distance problem in the null space, exactly, by non-negative least squares (Lawson & Hanson 1974, chapter 23).

    Parameters
    ----------
    feet : array_like, shape (T, N, 3)
        m, z up.
    stance : array_like of bool, shape (T, N)
    centre : array_like, shape (T, 3)
        Centre of mass, m.
    load : array_like, shape (T, 3)
        Sum of the ground's forces, N: mass times (acceleration - gravity).
    moment : array_like, shape (T, 3), optional
        Sum of their moments about the centre of mass, N·m: the rate of angular momentum; zero where not given.
    friction : float, optional
        Coefficient; each force then stays in the pyramid inscribed in the friction cone, |f_x|, |f_y| <= mu f_z /
        sqrt(2). Without it the feet do not slip at all.

    Returns
    -------
    LoadSharing
    """
    r, on = np.asarray(feet, dtype=float), np.asarray(stance, dtype=bool)
    c, F = np.asarray(centre, dtype=float), np.asarray(load, dtype=float)
    M = np.zeros_like(F) if moment is None else np.asarray(moment, dtype=float)
    if r.ndim != 3 or r.shape[2] != 3 or on.shape != r.shape[:2] or not c.shape == F.shape == M.shape == (len(r), 3):
        raise ShapeError(
            f"feet (T, N, 3), stance (T, N), centre, load and moment (T, 3) are needed, not {r.shape}, {on.shape}, "
            f"{c.shape}, {F.shape}, {M.shape}"
        )
    bound = None if friction is None else arguments.positive("friction coefficient", friction) / np.sqrt(2.0)
    force = np.full(r.shape, np.nan)
    residual, feasible = np.full(len(r), np.inf), np.zeros(len(r), dtype=bool)
    for contacts in np.unique(on, axis=0):
        rows = np.flatnonzero((on == contacts).all(axis=1))
        legs = np.flatnonzero(contacts)
        force[np.ix_(rows, np.flatnonzero(~contacts))] = 0.0
        if not legs.size:
            residual[rows] = np.linalg.norm(F[rows], axis=1)
            feasible[rows] = residual[rows] == 0.0
            continue
        arms = r[np.ix_(rows, legs)] - c[rows, None, :]
        # Moments in units of force, so that the least-squares residual means something.
        span = np.linalg.norm(arms, axis=-1).max(axis=1)
        A = np.concatenate([np.tile(np.eye(3), (rows.size, 1, legs.size)), _moments(arms, span)], axis=1)
        b = np.concatenate([F[rows], M[rows] / span[:, None]], axis=1)
        least = np.einsum("tij,tj->ti", np.linalg.pinv(A, rcond=1e-10), b)
        # One step of refinement: pinv alone leaves some digits of the residual.
        least += np.einsum("tij,tj->ti", np.linalg.pinv(A, rcond=1e-10), b - np.einsum("tij,tj->ti", A, least))
        G = _bounds(legs.size, bound)
        scale = np.maximum(np.linalg.norm(b, axis=1), 1e-300)
        for k, row in enumerate(rows):
            f = least[k]
            residual[row] = np.linalg.norm(A[k] @ f - b[k])
            balanced = residual[row] <= BALANCE_TOLERANCE * scale[k]
            if balanced and (G @ f < -_PUSH_TOLERANCE * scale[k]).any():
                bounded = _least_distance(A[k], f / scale[k], G)
                if bounded is None:
                    balanced = False
                else:
                    f = bounded * scale[k]
                    residual[row] = np.linalg.norm(A[k] @ f - b[k])
            feasible[row] = balanced
            if balanced:
                force[row, legs] = f.reshape(-1, 3)
    return LoadSharing(force, residual, feasible)


def _moments(arms: NDArray[np.float64], span: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of the moments of all forces, (T, 3, 3 n)."""
    x, y, z = np.moveaxis(arms / span[:, None, None], -1, 0)
    zero = np.zeros_like(x)
    crosses = np.stack([[zero, -z, y], [z, zero, -x], [-y, x, zero]])  # (3, 3, T, n)
    return np.asarray(crosses.transpose(2, 0, 3, 1).reshape(len(arms), 3, -1))


def _bounds(count: int, bound: float | None) -> NDArray[np.float64]:
    """Rows g with g f >= 0: pushing, and the friction pyramid."""
    one = [[0.0, 0.0, 1.0]]
    if bound is not None:
        one += [[s, 0.0, bound] for s in (1.0, -1.0)] + [[0.0, s, bound] for s in (1.0, -1.0)]
    return np.kron(np.eye(count), np.array(one))


def _least_distance(
    A: NDArray[np.float64], start: NDArray[np.float64], G: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """The least change of the least forces `start`, within the null space of A, that fulfils G f >= 0; None if none."""
    from scipy.optimize import nnls

    _, sigma, V = np.linalg.svd(A)
    Z = V[int((sigma > 1e-10 * sigma[0]).sum()) :].T
    if not Z.shape[1]:
        return None
    reduced, need = G @ Z, -(G @ start)
    E = np.vstack([reduced.T, need])
    e = np.append(np.zeros(Z.shape[1]), 1.0)
    weights, _ = nnls(E, e, maxiter=50 * E.shape[1])
    rest = E @ weights - e
    # At the optimum rest[-1] = -|rest|², which rounding may turn into zero: no forces fulfil all bounds.
    if np.linalg.norm(rest) < 1e-9 or rest[-1] == 0.0:
        return None
    f = start - Z @ (rest[:-1] / rest[-1])
    return f if (G @ f >= -1e-9).all() else None
