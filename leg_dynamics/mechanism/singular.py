"""What kind of singular pose of the closure one is in, and which motion it sets free.

Of the loop rows K three parts can lose rank (Gosselin and Angeles 1990; Zlatanov et al. 1995): K itself, which is a
`constraint` singularity; its columns of the joints that no actuator holds, a `parallel` one; and where both stay
regular, its columns of the dependent joints only, which is no property of the mechanism but of the choice of
`coordinates`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = ["Singular", "describe"]

# Columns whose smallest singular value, relative to its usual one, is no larger than that times the dependent ones' are
# singular as they are.
COMPARABLE = 10.0
# Of the usual value: what has fallen below is rounding, however small the dependent columns' value is.
VANISHED = 1e-7
# A larger share of the usual value has not fallen: then the seed is near a singular pose itself and tells nothing.
FALLEN = 0.5
RANK_SHARE = 1e-6
# Joints that take part in a motion by less than this share of the largest are not named.
SHOWN = 0.05


@dataclass(frozen=True)
class Singular:
    """A singular pose's kind and the motion that it sets free.

    Attributes
    ----------
    kind : str
        ``constraint``, ``parallel`` or ``coordinates``.
    direction : dict of str to float
        Rates of the tree joints in the free motion, the largest 1, in rad and lengths of the mechanism.
    """

    kind: str
    direction: dict[str, float]

    def __str__(self) -> str:
        moving = ", ".join(f"{name} {x:+.3g}" for name, x in self.direction.items() if abs(x) >= SHOWN)
        what = {
            "constraint": "a constraint singularity, where the loops' rows lose rank and the mechanism gains a motion",
            "parallel": "a parallel singularity, where the mechanism can still move with all actuators locked",
            "coordinates": "singular only for these independent coordinates, which do not determine the motion",
        }[self.kind]
        return f"{what} ({moving})"


def describe(mechanism: Mechanism, state: ClosedState) -> Singular:
    """Kind and free motion of a pose at or very near a singular one of the closure.

    Parameters
    ----------
    mechanism : Mechanism
        With dependent joints and at least one seed.
    state : ClosedState
        Without need of G.
    """
    seed = mechanism.seeds[0]
    free = np.setdiff1d(np.arange(mechanism.nv), mechanism.actuated)
    value, usual = _smallest(mechanism, seed, state, mechanism.dependent)
    relative = value <= FALLEN * usual
    least = value / usual if relative else value
    kind = "coordinates"
    # Near a singular pose of more columns theirs falls as fast as that of the dependent ones; of fewer, it stays.
    for name, columns in (("constraint", np.arange(mechanism.nv)), ("parallel", free)):
        value, usual = _smallest(mechanism, seed, state, columns)
        if value < max(COMPARABLE * least * (usual if relative else 1.0), VANISHED * usual):
            kind = name
            break
    _, _, right = np.linalg.svd(state.dependent_jacobian)
    motion = np.zeros(mechanism.nv)
    motion[mechanism.dependent] = right[-1]
    motion /= motion[np.argmax(np.abs(motion))]
    return Singular(kind, dict(zip(mechanism.tree.joint_names, motion.tolist(), strict=True)))


def _smallest(mechanism: Mechanism, seed: ClosedState, state: ClosedState, columns: np.ndarray) -> tuple[float, float]:
    """The singular value that must not vanish for some columns to have their usual rank, and its usual value.

    Infinite where there is nothing that could vanish.
    """
    usual = _singular_values(mechanism, seed, columns)
    rank = int(np.count_nonzero(usual > RANK_SHARE * usual.max(initial=0.0)))
    if not rank:
        return np.inf, np.inf
    return float(_singular_values(mechanism, state, columns)[rank - 1]), float(usual[rank - 1])


def _singular_values(mechanism: Mechanism, state: ClosedState, columns: np.ndarray) -> np.ndarray:
    K = state.rows.jacobian * mechanism.closure.coordinate_unit
    if not columns.size:
        return np.zeros(0)
    values: np.ndarray = np.linalg.svd(K[:, columns], compute_uv=False)
    return values
