"""Forward kinematics of the spanning tree in plain NumPy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.description.model import Description, Joint, Vector3
from leg_dynamics.description.topology import joints_depth_first
from leg_dynamics.errors import DescriptionError, NonFiniteError, ShapeError, UnsupportedError

__all__ = ["axis_rotation", "link_transforms"]


def link_transforms(description: Description, joint_values: Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
    """Pose of every link in the root link's frame, for given tree joint coordinates.

    Loops, couplings and mimics are not enforced: each coordinate is taken as given.

    Parameters
    ----------
    description : Description
        A mechanism of revolute, continuous, prismatic and fixed joints.
    joint_values : mapping of str to array_like
        Coordinates by joint name, rad or m, each of any shape; the shapes broadcast together. A missing one is 0.

    Returns
    -------
    dict of str to numpy.ndarray
        Homogeneous transforms by link name, shape (..., 4, 4): they map link coordinates to root coordinates.

    Raises
    ------
    UnsupportedError
        Where the mechanism has a floating or planar joint.
    DescriptionError
        Where a value names an unknown or a fixed joint.
    ShapeError
        Where values are not real numbers or do not broadcast.
    NonFiniteError
        Where a value is NaN or infinite.
    """
    values, shape = _broadcast(description, joint_values)
    transforms = {description.root: np.broadcast_to(np.eye(4), (*shape, 4, 4)).copy()}
    for joint in joints_depth_first(description):
        step = joint.origin.matrix()
        if joint.type != "fixed":
            step = step @ _motion(joint, values.get(joint.name, np.zeros(())))
        transforms[joint.child] = transforms[joint.parent] @ step
    return transforms


def axis_rotation(axis: Vector3, angle: ArrayLike) -> np.ndarray:
    """Rotation about a unit axis (Rodrigues): cos I + sin [a]x + (1 - cos) a a^T.

    Parameters
    ----------
    axis : tuple of three floats
        Unit vector.
    angle : array_like
        rad, any shape.

    Returns
    -------
    numpy.ndarray
        Shape (..., 3, 3).
    """
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    cos, sin = np.cos(angle)[..., None, None], np.sin(angle)[..., None, None]
    rotation: np.ndarray = cos * np.eye(3) + sin * cross + (1.0 - cos) * np.outer(axis, axis)
    return rotation


def _motion(joint: Joint, value: np.ndarray) -> np.ndarray:
    """The transform of a single-coordinate joint, shape (..., 4, 4)."""
    motion = np.broadcast_to(np.eye(4), (*value.shape, 4, 4)).copy()
    if joint.type == "prismatic":
        motion[..., :3, 3] = value[..., None] * np.asarray(joint.axis)
    else:
        motion[..., :3, :3] = axis_rotation(joint.axis, value)
    return motion


def _broadcast(
    description: Description, joint_values: Mapping[str, ArrayLike]
) -> tuple[dict[str, np.ndarray], tuple[int, ...]]:
    """The checked values as arrays, and their common shape."""
    for joint in description.joints:
        if joint.type in ("floating", "planar"):
            raise UnsupportedError(f"joint {joint.name!r} is {joint.type}: link_transforms needs one coordinate")
    values: dict[str, np.ndarray] = {}
    for name, value in joint_values.items():
        if description.joint(name).type == "fixed":
            raise DescriptionError(f"joint {name!r} is fixed and takes no value", file=description.file)
        values[name] = _real(name, value)
    try:
        shape = np.broadcast_shapes(*(value.shape for value in values.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in values.items())
        raise ShapeError(f"joint values do not broadcast together: {shapes}") from None
    return values, shape


def _real(name: str, value: ArrayLike) -> np.ndarray:
    try:
        given = np.asarray(value)
    except ValueError:  # ragged
        raise ShapeError(f"the value of joint {name!r} is no array of numbers: its rows differ in length") from None
    if given.dtype.kind not in "fiu":
        raise ShapeError(f"the value of joint {name!r} must be real numbers, got dtype {given.dtype}")
    array = given.astype(float)
    bad = np.flatnonzero(~np.isfinite(array))
    if bad.size:
        raise NonFiniteError(f"the value of joint {name!r} is NaN or infinite in {bad.size} entries", rows=bad)
    return array
