"""The loop rows K of any mechanism at one closed pose, K * tree rates = 0, from its description alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from leg_dynamics.description import Description, coupling_equations, joints_depth_first, link_transforms
from leg_dynamics.description.model import Loop

__all__ = ["LoopRows", "loop_rows"]


class LoopRows(NamedTuple):
    """`matrix` (rows, joints), dimensionless: lengths in units of the characteristic length; `joints` its columns."""

    matrix: np.ndarray
    joints: tuple[str, ...]


def loop_rows(description: Description, tree: Mapping[str, np.ndarray], length: float) -> LoopRows:
    """Rows of all loops, couplings and mimics.

    Parameters
    ----------
    description : Description
    tree : mapping of str to float
        Closed tree coordinates, rad or m. A coordinate that is left out is 0.
    length : float
        m; translations are divided by it, and a prismatic joint's rate counts in it.

    Returns
    -------
    LoopRows
    """
    poses = link_transforms(description, {name: float(value) for name, value in tree.items()})
    moving = [joint for joint in joints_depth_first(description) if joint.is_single_coordinate]
    index = {joint.name: k for k, joint in enumerate(moving)}
    twists = {}
    for joint in moving:
        frame = poses[joint.parent] @ joint.origin.matrix()
        axis = frame[:3, :3] @ np.asarray(joint.axis)
        if joint.type == "prismatic":
            twists[joint.name] = (np.zeros(3), axis * length)
        else:
            twists[joint.name] = (axis, np.cross(frame[:3, 3], axis))

    def motion(link: str, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angular velocity of a link and velocity of a point of it by the joint rates, (3, joints) each."""
        turning, moved = np.zeros((3, len(moving))), np.zeros((3, len(moving)))
        for joint in description.path(link):
            if joint.name in index:
                omega, at_origin = twists[joint.name]
                turning[:, index[joint.name]] = omega
                moved[:, index[joint.name]] = at_origin + np.cross(omega, point)
        return turning, moved

    rows = [_rows(loop, poses, motion, length) for loop in description.loops]
    for equation in coupling_equations(description):
        row = np.zeros((1, len(moving)))
        for name, coefficient in equation.coefficients.items():
            row[0, index[name]] = coefficient
        rows.append(row / np.abs(row).max())
    joints = tuple(joint.name for joint in moving)
    return LoopRows(np.concatenate(rows) if rows else np.zeros((0, len(moving))), joints)


def _rows(loop: Loop, poses: Mapping[str, np.ndarray], motion, length: float) -> np.ndarray:  # type: ignore[no-untyped-def]
    one, other = (poses[end.link] @ end.origin.matrix() for end in (loop.predecessor, loop.successor))
    # Both points coincide at a closed pose, except along a free slide: the successor's is taken for both bodies.
    point = other[:3, 3]
    (turning_one, moving_one), (turning, moving) = (
        motion(loop.predecessor.link, point),
        motion(loop.successor.link, point),
    )
    turn, shift = turning - turning_one, (moving - moving_one) / length
    if loop.type == "spherical":
        return shift
    if loop.type == "universal":
        # the angle between the predecessor's x and the successor's y stays a right one
        normal = np.cross(one[:3, 0], other[:3, 1])
        return np.concatenate([shift, normal[None] @ turn])
    if loop.type == "fixed":
        return np.concatenate([shift, turn])
    assert loop.axis is not None
    axis = one[:3, :3] @ np.asarray(loop.axis)
    across = np.linalg.svd(axis[None])[2][1:]
    if loop.type == "planar":
        return np.concatenate([axis[None] @ shift, across @ turn])
    if loop.type == "prismatic":
        return np.concatenate([across @ shift, turn])
    return np.concatenate([shift, across @ turn])
