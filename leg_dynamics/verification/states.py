"""States to verify at: the whole box, its corners, and the neighbourhood of zero where legs like to be singular."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from leg_dynamics.leg import Leg

__all__ = ["States", "domain", "sample_states"]

SPEED = 5.0
ACCELERATION = 50.0
FORCE = 50.0
NEAR_ZERO_SHARE = 0.15


@dataclass(frozen=True)
class States:
    """A batch of states: q, v, a (N, n), foot forces and gravity vectors (N, 3)."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    foot_force: np.ndarray
    gravity: np.ndarray

    def __len__(self) -> int:
        return len(self.q)

    def first(self, count: int) -> States:
        """The first `count` states."""
        return States(*(getattr(self, name)[:count] for name in ("q", "v", "a", "foot_force", "gravity")))


def domain(leg: Leg) -> tuple[np.ndarray, np.ndarray]:
    """Box in which a leg is verified: its formulas' stated domain, else its joint limits (within ±pi, ±1 m)."""
    stated = getattr(leg.backend, "domain", None)
    if stated is not None:
        return np.array(stated[0], dtype=float), np.array(stated[1], dtype=float)
    reach = np.array([np.pi if unit == "rad" else 1.0 for unit in leg.units.joints])
    return np.maximum(leg.limits.lower, -reach), np.minimum(leg.limits.upper, reach)


def sample_states(box: tuple[np.ndarray, np.ndarray], samples: int, seed: int) -> States:
    """Random states in a box, with its corners and states that have coordinates close to zero.

    Parameters
    ----------
    box : pair of (n,) arrays
    samples : int
        Number of states; the corners and the near-zero states are among them.
    seed : int
    """
    generator = np.random.default_rng(seed)
    lower, upper = box
    n = len(lower)
    q = generator.uniform(lower, upper, (samples, n))
    near = generator.random((samples, n)) < NEAR_ZERO_SHARE
    tiny = 10.0 ** generator.uniform(-9.0, -1.0, (samples, n)) * generator.choice([-1.0, 1.0], (samples, n))
    inside = (tiny > lower) & (tiny < upper)
    q = np.where(near & inside, tiny, q)
    corners = np.array(list(itertools.product(*zip(lower, upper, strict=True)))) if n <= 10 else np.zeros((0, n))
    special = np.vstack([corners, np.zeros((1, n))]) if (lower <= 0).all() and (upper >= 0).all() else corners
    q[: min(samples, len(special))] = special[:samples]
    directions = generator.standard_normal((samples, 3))
    return States(
        q=q,
        v=generator.uniform(-SPEED, SPEED, (samples, n)),
        a=generator.uniform(-ACCELERATION, ACCELERATION, (samples, n)),
        foot_force=generator.uniform(-FORCE, FORCE, (samples, 3)),
        gravity=9.81 * directions / np.linalg.norm(directions, axis=1, keepdims=True),
    )
