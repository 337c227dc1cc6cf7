"""Static stability: how far the centre of mass, projected along gravity, is inside the polygon of the standing feet."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.errors import ShapeError

__all__ = ["project", "support_margin"]

_SAME_SIDE = 1e-12
"""Share of the feet's extent by which a foot may lie beyond an edge and still count as on it."""


def support_margin(feet: ArrayLike, stance: ArrayLike, point: ArrayLike) -> NDArray[np.float64]:
    """Signed distance of a point to the edges of the convex hull of the standing feet (McGhee & Frank 1968).

    Parameters
    ----------
    feet : array_like, shape (..., N, 2)
        m, in the ground's plane.
    stance : array_like of bool, shape (..., N)
        Which of them stand.
    point : array_like, shape (..., 2)
        Projected centre of mass, m.

    Returns
    -------
    numpy.ndarray, shape (...)
        m. Three feet or more that are not in line: the distance to the nearest edge, positive inside, negative
        outside. In line, or two feet: minus the distance to their segment; one: minus the distance to it; none: -inf.
    """
    P, on, c = np.asarray(feet, dtype=float), np.asarray(stance, dtype=bool), np.asarray(point, dtype=float)
    if P.shape[-1:] != (2,) or c.shape[-1:] != (2,) or on.shape != P.shape[:-1]:
        raise ShapeError(
            f"feet (..., N, 2), stance (..., N) and point (..., 2) are needed, not {P.shape}, {on.shape}, {c.shape}"
        )
    shape = np.broadcast_shapes(P.shape[:-2], c.shape[:-1])
    if on.shape[-1] == 0:
        return np.full(shape, -np.inf)
    start, edge = P[..., :, None, :], P[..., None, :, :] - P[..., :, None, :]
    both = on[..., :, None] & on[..., None, :]
    length = np.hypot(edge[..., 0], edge[..., 1])
    toward = c[..., None, None, :] - start
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.clip(np.where(length > 0.0, (toward * edge).sum(axis=-1) / length**2, 0.0), 0.0, 1.0)
        left = np.where(length > 0.0, _cross(edge, toward) / length, np.inf)
        others = P[..., None, None, :, :] - start[..., None, :]
        beside = np.where(length[..., None] > 0.0, _cross(edge[..., None, :], others) / length[..., None], 0.0)
    nearest = np.where(both, np.linalg.norm(toward - along[..., None] * edge, axis=-1), np.inf)
    outside = nearest.min(axis=(-2, -1))
    # A pair of feet is an edge, run counter-clockwise, where no standing foot lies to its right.
    extent = np.where(both, length, 0.0).max(axis=(-2, -1))[..., None, None, None]
    hull = both & (length > 0.0) & ((beside >= -_SAME_SIDE * extent) | ~on[..., None, None, :]).all(axis=-1)
    inside = np.where(hull, left, np.inf).min(axis=(-2, -1))
    standing = on.any(axis=-1)
    margin = np.where((inside > 0.0) & np.isfinite(inside), inside, -outside)
    return np.broadcast_to(np.where(standing, margin, -np.inf), shape) + 0.0


def project(point: ArrayLike, gravity: ArrayLike, height: ArrayLike) -> NDArray[np.float64]:
    """Where the line along gravity through a point meets a level plane, m, (..., 2).

    Parameters
    ----------
    point, gravity : array_like, shape (..., 3)
        m and m/s², z up; gravity less the body's acceleration gives the zero-moment point.
    height : array_like, shape (...)
        Of the plane, m.
    """
    p, g = np.asarray(point, dtype=float), np.asarray(gravity, dtype=float)
    fall = (np.asarray(height, dtype=float) - p[..., 2]) / g[..., 2]
    return np.asarray(p[..., :2] + fall[..., None] * g[..., :2])


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
