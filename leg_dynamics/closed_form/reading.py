"""Zero pose and merged inertia of a URDF+ file, read through yourdfpy: what closed-form modules take numbers from."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from leg_dynamics.closed_form.rigid_body import Body, Dissipation
from leg_dynamics.errors import FormulaAssumptionError

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description, LoopEnd

__all__ = ["FileReader", "MergedInertia", "ZeroPose", "broken_assumption", "without_rounding"]

_ROUNDING = 1e-15
_STANDARD_GRAVITY = 9.81


def broken_assumption(
    description: Description, element: str, found: object, expected: object, tolerance: float | None = None
) -> FormulaAssumptionError:
    """Error that names the joint, link or loop, what the file says and what the formulas need."""
    within = "" if tolerance is None else f" to within {tolerance:g}"
    return FormulaAssumptionError(
        f"{description.file}: {element} is {found}, but the closed-form formulas need {expected}{within}; "
        "change the file, or use route='pinocchio', which has no such assumption",
        element=element,
        found=found,
        expected=expected,
        tolerance=tolerance,
    )


def without_rounding(values: np.ndarray, size: float) -> np.ndarray:
    """Set entries to zero that are rounding (1e-15) of numbers of that size; zeros keep graphs small."""
    return np.where(np.abs(values) <= _ROUNDING * size, 0.0, values)


def _clean_rotation(rotation: np.ndarray) -> np.ndarray:
    nearest = np.rint(rotation)
    return np.where(np.abs(rotation - nearest) <= _ROUNDING, nearest, rotation)


class MergedInertia(NamedTuple):
    """Mass (kg), centre of mass (m) and tensor about it (kg·m²) of a rigid group of links, in a chosen frame."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray


class ZeroPose:
    """Where links, joint axes and loop ends are, in one link's frame, while every joint coordinate is zero.

    Parameters
    ----------
    description : Description
        The file; its text is parsed again, by yourdfpy.
    frame : str
        Link in whose frame positions and directions are given.
    """

    def __init__(self, description: Description, frame: str) -> None:
        import yourdfpy

        self.description = description
        self.frame = frame
        if not description.has_link(frame):
            raise broken_assumption(description, f"link {frame!r}", "missing", "present")
        text = description.urdf.lstrip()
        if text.startswith("<?xml"):
            text = text.partition("?>")[2]
        robot = yourdfpy.URDF.load(io.BytesIO(text.encode()), build_scene_graph=False, load_meshes=False).robot
        for link in robot.links:
            link.visuals = []  # only transforms are wanted, and shapes are slow to build
        self._urdf = yourdfpy.URDF(robot=robot, build_scene_graph=True, load_meshes=False)
        self._parent = {joint.child: joint for joint in description.joints}

    def transform(self, link: str, frame: str | None = None) -> np.ndarray:
        """Pose of a link in `frame` (default: the frame of this object), shape (4, 4)."""
        transform = np.array(self._urdf.get_transform(frame_to=link, frame_from=frame or self.frame))
        transform[:3, :3] = _clean_rotation(transform[:3, :3])
        return transform

    def joint_axis(self, name: str) -> np.ndarray:
        """Unit axis of a joint, shape (3,)."""
        joint = self._urdf.joint_map[name]
        axis = self.transform(joint.child)[:3, :3] @ joint.axis
        return axis / np.linalg.norm(axis)

    def joint_centre(self, name: str) -> np.ndarray:
        """Origin of a joint's frame, shape (3,), m."""
        return self.transform(self._urdf.joint_map[name].child)[:3, 3]

    def joint_offset(self, first: str, second: str) -> np.ndarray:
        """Vector between the origins of two joints' frames, shape (3,), m, not by way of this object's frame."""
        base, tip = (self._urdf.joint_map[name].child for name in (first, second))
        return self.transform(base)[:3, :3] @ self.transform(tip, base)[:3, 3]

    def loop_end(self, end: LoopEnd, axis: Iterable[float]) -> tuple[np.ndarray, np.ndarray]:
        """Position and axis direction of one end of a loop joint, each of shape (3,)."""
        pose = self.transform(end.link) @ end.origin.matrix()
        return pose[:3, 3], pose[:3, :3] @ np.array(tuple(axis))

    def body_of(self, link: str, bodies: Sequence[str]) -> str:
        """The one of `bodies` that a link is or is fixed to, else the outermost link that it is fixed to."""
        while link not in bodies and (joint := self._parent.get(link)) is not None and joint.type == "fixed":
            link = joint.parent
        return link

    def carrier_of(self, body: str, bodies: Sequence[str]) -> tuple[str, Any]:
        """Body that carries a body, and the joint between them (the first one that moves, or a fixed one)."""
        joint = self._parent[body]
        while joint.type == "fixed" and joint.parent not in bodies and joint.parent in self._parent:
            joint = self._parent[joint.parent]
        return self.body_of(joint.parent, bodies), joint

    def merged_inertia(self, links: Iterable[str], rotation: np.ndarray, origin: np.ndarray) -> MergedInertia:
        """Inertia of a rigid group of links in the frame of that rotation (3, 3) and origin (3,), m."""
        parts = []
        for link in links:
            inertial = self._urdf.link_map[link].inertial
            if inertial is None or not inertial.mass:
                continue
            pose = self.transform(link)
            local = np.eye(4) if inertial.origin is None else inertial.origin
            turn = _clean_rotation(rotation.T @ pose[:3, :3])
            shift = without_rounding(rotation.T @ (pose[:3, 3] - origin), 1.0)
            axes = turn @ _clean_rotation(local[:3, :3])
            tensor = np.zeros((3, 3)) if inertial.inertia is None else axes @ inertial.inertia @ axes.T
            com = without_rounding(shift + turn @ local[:3, 3], 1.0)
            parts.append(MergedInertia(float(inertial.mass), com, without_rounding(tensor, np.abs(tensor).max())))
        if len(parts) == 1:
            return parts[0]
        mass = sum(part.mass for part in parts)
        if not parts or mass == 0.0:
            return MergedInertia(0.0, np.zeros(3), np.zeros((3, 3)))
        com = sum((part.mass * part.com for part in parts), np.zeros(3)) / mass
        inertia = np.zeros((3, 3))
        for part in parts:
            d = part.com - com
            inertia += part.inertia + part.mass * (d @ d * np.eye(3) - np.outer(d, d))
        return MergedInertia(mass, com, inertia)


class FileReader:
    """What every leg with formulas reads from its file: named links in the hip's frame, motors, losses, gravity.

    Parameters
    ----------
    description : Description
    tolerance : float
        Greatest deviation from an assumption, m or rad.
    bodies : tuple of str
        Links that move rigidly, each with what is fixed to it.
    others : tuple of str
        Further links that must be there.
    """

    def __init__(
        self, description: Description, tolerance: float, bodies: tuple[str, ...], others: tuple[str, ...] = ()
    ) -> None:
        self.description = description
        self.tolerance = tolerance
        for name in (*bodies, *others):
            if not description.has_link(name):
                raise self.broken(f"link {name!r}", "missing", "present")
        self.pose = ZeroPose(description, "hip")
        self.moving = bodies
        self.bodies = (*bodies, "hip")

    def broken(
        self, element: str, found: object, expected: object, tolerance: float | None = None
    ) -> FormulaAssumptionError:
        """Error that names what breaks an assumption."""
        return broken_assumption(self.description, element, found, expected, tolerance)

    def merged_bodies(self, rotations: Mapping[str, np.ndarray], origins: Mapping[str, np.ndarray]) -> tuple[Body, ...]:
        """Inertia of every moving body in the frame of that rotation (3, 3) and origin (3,), m."""
        groups: dict[str, list[str]] = {name: [] for name in self.moving}
        for link in self.description.links:
            body = self.pose.body_of(link.name, self.bodies)
            if body in groups:
                groups[body].append(link.name)
        bodies = []
        for name, links in groups.items():
            mass, com, inertia = self.pose.merged_inertia(links, rotations[name], origins[name])
            tensor = tuple(tuple(row) for row in (0.5 * (inertia + inertia.T)).tolist())
            bodies.append(Body(name, float(mass), tuple(com.tolist()), tensor))
        return tuple(bodies)

    def drive_inertia(self, joints: tuple[str, ...]) -> tuple[float, ...]:
        """Rotor inertia and armature felt at each of the driven joints, kg·m² or kg; other joints can have none."""
        felt = {name: self.description.joint(name).armature for name in joints}
        for joint in self.description.moving_joints:
            if joint.armature != 0.0 and joint.name not in felt:
                raise self.broken(f"armature of joint {joint.name!r}, which no motor drives", joint.armature, 0.0)
        for transmission in self.description.transmissions:
            if transmission.joint not in felt:
                expected = f"{', '.join(joints[:-1])} or {joints[-1]}"
                raise self.broken(f"the joint of transmission {transmission.name!r}", transmission.joint, expected)
            felt[transmission.joint] += transmission.rotor_inertia * transmission.reduction**2
        return tuple(felt.values())

    def dissipation(self, joints: Iterable[str]) -> tuple[Dissipation, ...]:
        """Damping and friction of those joints that have any."""
        listed = (self.description.joint(name) for name in joints)
        return tuple(Dissipation(j.name, j.damping, j.friction) for j in listed if j.damping or j.friction)

    def gravity(self) -> tuple[float, ...]:
        """Acceleration of gravity in the hip frame while the root is level, m/s²."""
        rotation = self.pose.transform("hip", self.description.root)[:3, :3]
        down = np.array([0.0, 0.0, -_STANDARD_GRAVITY])
        return tuple(without_rounding(rotation.T @ down, _STANDARD_GRAVITY).tolist())
