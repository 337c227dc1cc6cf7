"""Path laws of a swing: how far along and how high the foot is at a share of its flight, with two derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis.trajectories import PiecewisePolynomial, minimum_jerk, quintic
from leg_dynamics.analysis.trajectories.gait import lift_profile

__all__ = ["LAWS", "Law", "law"]

LAWS = ("polynomial", "cycloid", "minimum_jerk")
"""Names of the path laws; all have continuous acceleration and start and end at rest on the ground.

``polynomial``: the quintic along, and 64 u³ (1 - u)³ up. ``cycloid``: u - sin(2 pi u) / (2 pi) along, and one such
arc up and one down. ``minimum_jerk``: the curve of least jerk through the apex (Flash & Hogan 1985).
"""


class Law(NamedTuple):
    """Both profiles at shares u of the swing, each (3, ...): value and two derivatives by u."""

    along: NDArray[np.float64]
    """From 0 to 1."""
    lift: NDArray[np.float64]
    """From 0 by 1 to 0."""


def law(name: str, u: NDArray[np.float64]) -> Law:
    """Evaluate a path law at shares u of the swing, in [0, 1]."""
    if name == "cycloid":
        return Law(_cycloid(u), _cycloid_arcs(u))
    curve = _quintic()
    along = np.stack([curve.value(u, k)[..., 0] for k in range(3)])
    bump = _bump() if name == "polynomial" else _apex()
    return Law(along, np.stack([bump.value(u, k)[..., 0] for k in range(3)]))


def _quintic() -> PiecewisePolynomial:
    return quintic([0.0], [1.0], 1.0)


def _bump() -> PiecewisePolynomial:
    return PiecewisePolynomial(np.array([0.0, 1.0]), lift_profile(1.0)[:, None, None])


def _apex() -> PiecewisePolynomial:
    return minimum_jerk([[0.0], [1.0], [0.0]], [0.0, 0.5, 1.0])


def _cycloid(u: NDArray[np.float64]) -> NDArray[np.float64]:
    w = 2.0 * np.pi
    return np.stack([u - np.sin(w * u) / w, 1.0 - np.cos(w * u), w * np.sin(w * u)])


def _cycloid_arcs(u: NDArray[np.float64]) -> NDArray[np.float64]:
    # Up in the first half, the same down in the second: acceleration is zero at the ground and at the apex.
    rising = u <= 0.5
    arc = _cycloid(np.where(rising, 2.0 * u, 2.0 - 2.0 * u))
    return np.stack([arc[0], np.where(rising, 2.0, -2.0) * arc[1], 4.0 * arc[2]])
