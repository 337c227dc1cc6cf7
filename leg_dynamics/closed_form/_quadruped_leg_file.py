"""Quadruped leg's numbers from a URDF+ file, and the check that the file is the mechanism of the formulas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.closed_form.quadruped_leg import BODY_NAMES, JOINT_NAMES, QuadrupedLeg
from leg_dynamics.closed_form.reading import FileReader, broken_assumption
from leg_dynamics.description.topology import split_independent

if TYPE_CHECKING:
    from leg_dynamics.closed_form.rigid_body import Body
    from leg_dynamics.description.model import Description

_X, _Y, _Z = np.eye(3)
_AXES = {"theta1": _Z, "theta2": -_Y, "theta3": -_Y}
_HINGES = ("revolute", "continuous")


def _text(vector: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.12g}" for value in vector + 0.0) + ")"


class _Reader(FileReader):
    def check_tree(self) -> None:
        description, pose = self.description, self.pose
        for name, parent, child in zip(JOINT_NAMES, ("hip", *self.moving), self.moving, strict=False):
            joint = description.joint(name)
            if joint.type not in _HINGES:
                raise self.broken(f"the type of joint {name!r}", joint.type, " or ".join(_HINGES))
            if pose.body_of(joint.parent, self.bodies) != parent:
                raise self.broken(
                    f"joint {name!r}", f"from {joint.parent!r} to {joint.child!r}", f"from {parent!r} to {child!r}"
                )
        for joint in description.moving_joints:
            if joint.name not in JOINT_NAMES:
                raise self.broken(f"joint {joint.name!r}", f"a further moving joint ({joint.type})", "none or fixed")
            if joint.mimic is not None:
                raise self.broken(f"joint {joint.name!r}", f"a mimic of {joint.mimic.joint!r}", "free")
        for joint in description.path("hip"):
            if joint.type != "fixed":
                raise self.broken(f"joint {joint.name!r} above the hip", joint.type, "fixed")
        if (carrier := pose.body_of("foot", self.bodies)) != self.moving[-1]:
            raise self.broken("link 'foot'", f"on {carrier!r}", f"fixed to {self.moving[-1]!r}")
        for loop in description.loops:
            raise self.broken(f"loop {loop.name!r}", "present", "none")
        for coupling in description.couplings:
            raise self.broken(f"coupling {coupling.name!r}", "present", "none")
        independent, _ = split_independent(description)
        if independent != JOINT_NAMES:
            raise self.broken("the list of independent joints", ", ".join(independent), ", ".join(JOINT_NAMES))

    def check_place(self, element: str, found: np.ndarray, expected: np.ndarray) -> None:
        if np.linalg.norm(found - expected) > self.tolerance:
            raise self.broken(f"{element} in the hip frame (m)", _text(found), _text(expected), self.tolerance)

    def length(self, name: str, value: float, least: float) -> float:
        if not value > least:
            wanted = "positive" if least > 0.0 else "not negative"
            raise self.broken(f"the length {name} (m)", value, wanted, self.tolerance)
        return value

    def lengths(self) -> tuple[float, float, float]:
        """l1, l2, l3, m; a joint's frame may lie anywhere on its axis."""
        for name, axis in _AXES.items():
            found = self.pose.joint_axis(name)
            if np.linalg.norm(found - axis) > self.tolerance:
                raise self.broken(
                    f"the axis of {name} in the hip frame at zero angles", _text(found), _text(axis), self.tolerance
                )
        hip, pitch, knee = (self.pose.joint_centre(name) for name in JOINT_NAMES)
        foot = self.pose.transform("foot")[:3, 3]
        self.check_place("the point of theta1's axis in the plane z = 0", hip * (_X + _Y), np.zeros(3))
        for name, centre in (("theta2", pitch), ("theta3", knee)):
            self.check_place(f"the point of {name}'s axis in the plane y = 0", centre * (_X + _Z), centre * _X)
        self.check_place("the origin of link 'foot'", foot, foot * _X)
        return (
            self.length("l1", float(pitch[0]), -self.tolerance),
            self.length("l2", float(knee[0] - pitch[0]), self.tolerance),
            self.length("l3", float(foot[0] - knee[0]), self.tolerance),
        )

    def inertias(self, l1: float, l2: float) -> tuple[Body, ...]:
        upright = np.column_stack((_X, _Z, -_Y))
        frames = ((np.eye(3), 0.0), (upright, l1), (upright, l1 + l2))
        rotations = {name: rotation for name, (rotation, _) in zip(self.moving, frames, strict=True)}
        origins = {name: x * _X for name, (_, x) in zip(self.moving, frames, strict=True)}
        bodies = self.merged_bodies(rotations, origins)
        return tuple(body._replace(name=name) for name, body in zip(BODY_NAMES, bodies, strict=True))


def read(description: Description, tolerance: float) -> QuadrupedLeg:
    """Check the file and return its numbers; see `leg_dynamics.closed_form.quadruped_leg.from_urdf`."""
    moving = {joint.name: joint for joint in description.moving_joints}
    for name in JOINT_NAMES:
        if name not in moving:
            raise broken_assumption(description, f"joint {name!r}", "missing or fixed", f"a {_HINGES[0]} joint")
    children = tuple(moving[name].child for name in JOINT_NAMES)
    reader = _Reader(description, tolerance, children, ("foot",))
    reader.check_tree()
    l1, l2, l3 = reader.lengths()
    return QuadrupedLeg(
        l1,
        l2,
        l3,
        bodies=reader.inertias(l1, l2),
        gravity=reader.gravity(),
        drive_inertia=reader.drive_inertia(JOINT_NAMES),
        dissipation=reader.dissipation(JOINT_NAMES),
    )
