"""What a preview of a walk shows: the robot's file, its joints and the ground below, for level and tilted bodies."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis.gait.study import GaitStudy
from leg_dynamics.description import parse
from leg_dynamics.description.model import Description
from leg_dynamics.errors import DescriptionError

__all__ = ["Picture", "picture"]


class Picture(NamedTuple):
    """A walk for a preview, whose root frame is level and moves over the ground; T instants, N legs."""

    description: Description
    """The robot's file; where the body tilts, with a level root above its own and two joints between them."""
    values: dict[str, NDArray[np.float64]]
    """Tree coordinates by joint, (T,)."""
    position: NDArray[np.float64]
    """Of the root frame in the world, m, (T, 2)."""
    yaw: NDArray[np.float64]
    """rad, (T,)."""
    feet: NDArray[np.float64]
    """In the root frame, m, (T, N, 3)."""
    centre: NDArray[np.float64]
    """Projected centre of mass in the root frame, m, (T, 2)."""


def picture(study: GaitStudy) -> Picture:
    """Prepare a walk for a preview.

    Raises
    ------
    DescriptionError
        The robot has no file.
    """
    description = study.robot.description
    if description is None:
        raise DescriptionError(f"{study.robot.name!r} has no file, so that there is nothing to show")
    values, body = study.joint_values(), study.body
    if study.walk.tilt is not None:
        description, (pitch, roll) = _on_level_root(description)
        angles = study.walk.tilt.value(study.time / study.walk.period, study.walk.period)
        values |= {roll: angles[:, 0], pitch: angles[:, 1]}
    feet, centre = body.level(study.feet.position), body.level(study.com)
    return Picture(description, values, body.position[:, :2], body.yaw, feet, centre[:, :2])


def _on_level_root(description: Description) -> tuple[Description, tuple[str, str]]:
    """The robot on a pitch and a roll joint below a new root, and the joints' names."""
    root = ET.fromstring(description.urdf)
    taken = {link.name for link in description.links} | {joint.name for joint in description.joints}

    def free(name: str) -> str:
        while name in taken:
            name += "_"
        return name

    level, between, pitch, roll = map(free, ("level", "pitched", "body_pitch", "body_roll"))
    for link in (level, between):
        ET.SubElement(root, "link", name=link)
    rows = ((pitch, level, between, "0 1 0"), (roll, between, description.root, "1 0 0"))
    for name, parent, child, axis in rows:
        joint = ET.SubElement(root, "joint", name=name, type="continuous", independent="true")
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "axis", xyz=axis)
    return parse(ET.tostring(root, encoding="unicode")), (pitch, roll)
