"""How far from the hip the foot can be at most, whatever the joints do: what settles targets in the wrong unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import Mechanism

__all__ = ["from_hip", "is_beyond", "longest_reach", "reach_text"]

# Relative rounding of a sum of lengths.
ROUNDING = 1e-12


def longest_reach(mechanism: Mechanism) -> float:
    """Bound from above of the distance from the hip's origin to the foot, m; infinite with a slide on the way.

    The links on the way from the root to the foot laid out straight, each from joint to joint. Limits of joints do not
    count, since solutions outside them are told from points that nothing reaches.

    Parameters
    ----------
    mechanism : Mechanism
        Without a foot there is no bound.
    """
    foot, model = mechanism.foot_frame, mechanism.tree.model
    if foot is None:
        return np.inf
    frame = model.frames[foot]
    end, joint, lengths = np.array(frame.placement.translation), int(frame.parentJoint), 0.0
    moves = mechanism.tree.support(foot) != 0.0
    names = [name for name, moved in zip(mechanism.tree.joint_names, moves, strict=True) if moved]
    if any(mechanism.description.joint(name).unit == "m" for name in names):
        return np.inf
    while joint > 0:
        lengths += float(np.linalg.norm(end))
        end, joint = np.array(model.jointPlacements[joint].translation), int(model.parents[joint])
    return lengths + float(np.linalg.norm(end - mechanism.hip_origin))


def is_beyond(p: np.ndarray, reach: float) -> np.ndarray:
    """Whether feet at p (..., 3), hip frame, m, are farther than that from the hip's origin, (...)."""
    beyond: np.ndarray = from_hip(p) > reach * (1.0 + ROUNDING)
    return beyond


def from_hip(p: np.ndarray) -> np.ndarray:
    """Distance of feet at p (..., 3) from the hip's origin, (...) m; large ones do not overflow."""
    distance: np.ndarray = np.hypot(np.hypot(p[..., 0], p[..., 1]), p[..., 2])
    return distance


def reach_text(p: np.ndarray, reach: float) -> str:
    """Words for a foot at p (3,) that lies beyond the reach."""
    distance = float(from_hip(p))
    unit = "; is the point in millimetres?" if 50.0 * reach < distance <= 1e3 * reach else ""
    return (
        f"it is {distance:.6g} m from the hip, and the links on the way from there to the foot have a length of "
        f"{reach:.6g} m together{unit}"
    )
