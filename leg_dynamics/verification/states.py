"""States to verify at: the whole box, its corners, and the neighbourhood of zero where legs like to be singular."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leg_dynamics.errors import RowFailures
from leg_dynamics.leg import Leg

__all__ = ["States", "domain", "nearly_singular", "sample_states", "smallest_singular_values", "with_room"]

SPEED = 5.0
ACCELERATION = 50.0
FORCE = 50.0
SLIDE_SHARE = 0.2
"""Metres are large beside radians: share of SPEED and ACCELERATION that slides get, in m/s and m/s².

A difference along v then stays inside the ROOM around a state.
"""
NEAR_ZERO_SHARE = 0.15
RESTING_SHARE = 0.1
BEYOND_STRAIGHT = np.pi / 4.0
"""How far the box reaches past a limit at 0 rad, rad."""
LARGEST_CORNER_COUNT = 2**10
NEIGHBOUR_DISTANCE = 0.2
"""Numeric closures start from the row before where it is nearer than about this, rad or m."""
ROOM = {"rad": 0.05, "m": 0.01}
"""Differences need a leg that can be assembled this far around a state: near a singular closure they mean nothing."""
ROOM_SHARE = 0.1
"""Nor do they mean anything where the closure's smallest singular value is below this share of its usual size."""
KNOWN_TO = 1e-10
"""States at which rounding moves results by more are left out: a tenth of what routes have to agree within."""


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

    def take(self, rows: np.ndarray) -> States:
        """The states of some rows, in that order."""
        return States(self.q[rows], self.v[rows], self.a[rows], self.foot_force[rows], self.gravity[rows])

    @classmethod
    def joined(cls, parts: Sequence[States]) -> States:
        """The states of several, one after the other."""
        fields = ("q", "v", "a", "foot_force", "gravity")
        return cls(**{field: np.concatenate([getattr(part, field) for part in parts]) for field in fields})

    def first(self, count: int) -> States:
        """The first `count` states."""
        return self.take(np.arange(min(count, len(self))))

    def along_a_path(self) -> np.ndarray:
        """Row numbers in an order in which neighbours are close: to and fro through a grid of cells."""
        q = self.q
        if len(q) == 0:
            return np.zeros(0, dtype=np.intp)
        n = q.shape[1]
        low, high = q.min(axis=0), q.max(axis=0)
        width = np.maximum((high - low) / max(1.0, round(len(q) ** (1.0 / n))), NEIGHBOUR_DISTANCE)
        cells = np.floor((q - low) / width)
        keys: list[np.ndarray] = []
        backwards = np.zeros(len(q), dtype=bool)
        for axis in range(n - 1):
            keys.append(np.where(backwards, -cells[:, axis], cells[:, axis]))
            backwards = backwards ^ (cells[:, axis] % 2 == 1)
        keys.append(np.where(backwards, -q[:, -1], q[:, -1]))
        return np.lexsort(keys[::-1])


def with_room(leg: Leg, states: States) -> States:
    """The states around which the leg can be assembled too, in each coordinate's direction and along the motion.

    Each pose has to be reached from far away: differences take them in another order, after other poses.
    """
    room = np.array([ROOM[unit] for unit in leg.units.joints])
    steps = np.diag(room)
    along = states.v * np.divide(1.0, np.abs(states.v / room).max(axis=1, initial=1e-300))[:, None]
    moves = np.concatenate([np.zeros_like(steps[:1]), steps, -steps])[:, None] + np.zeros((len(states), 1))
    around = states.q + np.concatenate([moves, along[None], -along[None]])
    coordinates = np.stack(list(leg.assemble(around, on_error="nan").values()), axis=-1)
    return states.take(np.flatnonzero(np.isfinite(coordinates).all(axis=(0, 2))))


def smallest_singular_values(leg: Leg, q: np.ndarray) -> np.ndarray | None:
    """Smallest singular value of the closure at poses (N, n), (N,); None where the leg's route knows none."""
    values = getattr(leg.backend, "smallest_singular_values", None)
    return None if values is None else np.asarray(values(q, RowFailures()))


def nearly_singular(leg: Leg, states: States) -> np.ndarray:
    """States at which rounding alone moves results by more than `KNOWN_TO`, (N,) bool; none by routes that cannot tell.

    No two derivations can agree much better there, however right they are.
    """
    errors = getattr(leg.backend, "rounding_errors", None)
    if errors is None:
        return np.zeros(len(states), dtype=bool)
    return np.asarray(errors(states.q, states.v, states.a) > KNOWN_TO)


def domain(leg: Leg) -> tuple[np.ndarray, np.ndarray]:
    """Box in which a leg is verified: its joint limits, within ±pi rad or ±1 m, and both sides of a straight leg.

    Formulas hold beyond joint limits, and nothing but inverse kinematics enforces them. A limit at 0 rad is where a leg
    is straight, its Jacobian singular, and where signs of passive joints change: there the box reaches pi/4 further.
    """
    turning = np.array([unit == "rad" for unit in leg.units.joints])
    reach = np.where(turning, np.pi, 1.0)
    lower, upper = np.maximum(leg.limits.lower, -reach), np.minimum(leg.limits.upper, reach)
    beyond = np.minimum(BEYOND_STRAIGHT, upper - lower)
    return (
        np.where(turning & (lower == 0.0), -beyond, lower),
        np.where(turning & (upper == 0.0), beyond, upper),
    )


def sample_states(box: tuple[np.ndarray, np.ndarray], samples: int, seed: int, units: Sequence[str] = ()) -> States:
    """Random states in a box, with its corners and states that have coordinates close to zero.

    Parameters
    ----------
    box : pair of (n,) arrays
    samples : int
        Number of states; the corners and the near-zero states are among them.
    seed : int
    units : sequence of str
        Units of the n coordinates, ``rad`` or ``m``; all rad where none are given.
    """
    generator = np.random.default_rng(seed)
    lower, upper = box
    n = len(lower)
    q = generator.uniform(lower, upper, (samples, n))
    near = generator.random((samples, n)) < NEAR_ZERO_SHARE
    tiny = 10.0 ** generator.uniform(-9.0, -1.0, (samples, n)) * generator.choice([-1.0, 1.0], (samples, n))
    inside = (tiny > lower) & (tiny < upper)
    q = np.where(near & inside, tiny, q)
    special = _special(lower, upper)
    count = min(len(special), (samples + 1) // 2)
    q[:count] = special[:count]
    directions = generator.standard_normal((samples, 3))
    # Resting joints too: Coulomb friction jumps there.
    moving = generator.random((samples, n)) >= RESTING_SHARE
    share = np.array([SLIDE_SHARE if unit == "m" else 1.0 for unit in units or ("rad",) * n])
    return States(
        q=q,
        v=generator.uniform(-SPEED, SPEED, (samples, n)) * moving * share,
        a=generator.uniform(-ACCELERATION, ACCELERATION, (samples, n)) * share,
        foot_force=generator.uniform(-FORCE, FORCE, (samples, 3)),
        gravity=9.81 * directions / np.linalg.norm(directions, axis=1, keepdims=True),
    )


def _special(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Zero, where it is in the box, and the corners, (k, n)."""
    n = len(lower)
    rows = np.zeros((0, n))
    if 2**n <= LARGEST_CORNER_COUNT:
        rows = np.array(list(itertools.product(*zip(lower, upper, strict=True))))
    zero = np.zeros((1, n))
    return np.vstack([zero, rows]) if ((lower <= 0) & (upper >= 0)).all() else rows
