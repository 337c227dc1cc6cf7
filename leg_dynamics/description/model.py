"""What a mechanism file says, as immutable values: links, joints, loops, couplings, actuators, named poses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from leg_dynamics.errors import DescriptionError

__all__ = [
    "Clearance",
    "Cone",
    "Configuration",
    "Coupling",
    "Description",
    "Equation",
    "Geometry",
    "Inertial",
    "Joint",
    "JointLimits",
    "Link",
    "Loop",
    "LoopEnd",
    "Mimic",
    "Parameter",
    "Pose",
    "Segment",
    "Telescope",
    "Transmission",
    "Visual",
]

Vector3 = tuple[float, float, float]

STANDSTILL = 1e-11
"""A joint slower than this share of the independent speeds together rests: no Coulomb friction acts on it.

Below lies the rounding of rates that cancel. Were the routes' shares different, so would be the friction.
"""

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
# What a joint without exactly one coordinate appends to its name for each of them.
_COORDINATES = {
    "fixed": (),
    "floating": ("_x", "_y", "_z", "_yaw", "_pitch", "_roll"),
    "planar": ("_x", "_y", "_yaw"),
}
DRIVEN = ("independent", "none")
LOOP_TYPES = ("revolute", "continuous", "prismatic", "fixed", "planar", "spherical", "universal")

_Value = TypeVar("_Value")


def _read_only(mapping: Mapping[str, _Value]) -> Mapping[str, _Value]:
    """A private copy of a mapping that nobody can change."""
    return MappingProxyType(dict(mapping))


def _rebuild(kind: type, values: tuple[Any, ...]) -> Any:
    return kind(*values)


def _reduce(instance: Any) -> tuple[Any, ...]:
    """Pickle a dataclass by its fields: read-only mappings as plain ones, cached values left out."""
    values = (getattr(instance, each.name) for each in fields(instance))
    return _rebuild, (type(instance), tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values))


@dataclass(frozen=True, slots=True)
class Pose:
    """A rigid transform as URDF writes it: metres, and fixed-axis roll, pitch, yaw in rad."""

    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy: Vector3 = (0.0, 0.0, 0.0)

    def rotation(self) -> np.ndarray:
        """Rotation matrix R = Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3)."""
        sr, sp, sy = map(math.sin, self.rpy)
        cr, cp, cy = map(math.cos, self.rpy)
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )

    def matrix(self) -> np.ndarray:
        """Homogeneous transform, shape (4, 4)."""
        transform = np.eye(4)
        transform[:3, :3] = self.rotation()
        transform[:3, 3] = self.xyz
        return transform


@dataclass(frozen=True, slots=True)
class Inertial:
    """Mass (kg), pose of the centre-of-mass frame in the link, and inertia about it (kg·m²) in that frame's axes."""

    mass: float
    origin: Pose
    ixx: float
    ixy: float
    ixz: float
    iyy: float
    iyz: float
    izz: float

    def tensor(self) -> np.ndarray:
        """Inertia about the centre of mass in the inertial frame's axes, shape (3, 3), kg·m²."""
        return np.array(
            [[self.ixx, self.ixy, self.ixz], [self.ixy, self.iyy, self.iyz], [self.ixz, self.iyz, self.izz]]
        )


@dataclass(frozen=True, slots=True)
class Geometry:
    """A drawable shape: ``box`` (x, y, z), ``cylinder`` (radius, length), ``sphere`` (radius,) or ``mesh`` (scale)."""

    kind: str
    size: tuple[float, ...]
    filename: str | None = None


@dataclass(frozen=True, slots=True)
class Visual:
    """A shape, where it sits in its link, and its colour (red, green, blue, opacity in 0..1)."""

    origin: Pose
    geometry: Geometry
    rgba: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid body; `line` is where the file defines it."""

    name: str
    inertial: Inertial | None = None
    visuals: tuple[Visual, ...] = ()
    line: int | None = None


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Position (rad or m), effort (N·m or N) and speed limits; infinite where the file gives none.

    Efforts are from `effort_lower`, at most 0, to `effort`, at least 0; -effort where `effort_lower` is not given.
    """

    lower: float = -math.inf
    upper: float = math.inf
    effort: float = math.inf
    velocity: float = math.inf
    effort_lower: float = math.nan

    def __post_init__(self) -> None:
        if math.isnan(self.effort_lower):
            # A difference: -effort would be a negative zero.
            object.__setattr__(self, "effort_lower", 0.0 - self.effort)


@dataclass(frozen=True, slots=True)
class Mimic:
    """This joint = multiplier * joint + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Joint:
    """A tree joint: unit `axis` in the joint frame, `damping` in N·m·s/rad or N·s/m, `friction` in N·m or N.

    `armature` is inertia that turns (kg·m²) or slides (kg) with the joint's own speed, beside that of the links and of
    transmissions' rotors.
    `independent` is what the file states (true by default); fixed and mimicking joints are never independent.
    `driven` is whether a motor may drive it where the file has no transmissions; a joint of several coordinates, or one
    of the chain that it became, is never driven.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Pose = Pose()
    axis: Vector3 = (1.0, 0.0, 0.0)
    limits: JointLimits = JointLimits()
    damping: float = 0.0
    friction: float = 0.0
    independent: bool = True
    independent_is_stated: bool = False
    mimic: Mimic | None = None
    line: int | None = None
    armature: float = 0.0
    driven: bool = True

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the joint's coordinates: its own name, or that with a suffix each where it has several."""
        return tuple(f"{self.name}{suffix}" for suffix in _COORDINATES.get(self.type, ("",)))

    @property
    def is_single_coordinate(self) -> bool:
        """Whether the joint has exactly one coordinate."""
        return self.type in ("revolute", "continuous", "prismatic")

    @property
    def unit(self) -> str:
        """Unit of the joint's coordinate."""
        return "m" if self.type == "prismatic" else "rad"


@dataclass(frozen=True, slots=True)
class LoopEnd:
    """One side of a loop joint: a link and the loop frame's pose in it."""

    link: str
    origin: Pose = Pose()


@dataclass(frozen=True, slots=True)
class Loop:
    """A joint that closes a loop (URDF+, Chignoli et al. 2024).

    `axis` is a unit vector in the predecessor's loop frame: the hinge or slide direction, or a planar pair's
    normal; None for ``fixed``, ``spherical`` and ``universal`` (predecessor frame x and successor frame y meet at
    a right angle).
    """

    name: str
    type: str
    predecessor: LoopEnd
    successor: LoopEnd
    axis: Vector3 | None = None
    line: int | None = None


@dataclass(frozen=True, slots=True)
class Coupling:
    """successor path = ratio * predecessor path, each the sum of joint coordinates from the nearest common ancestor."""

    name: str
    predecessor: str
    successor: str
    ratio: float
    line: int | None = None


@dataclass(frozen=True, slots=True)
class Transmission:
    """An actuator on a joint: gear `reduction` (motor turns a joint turn) and `rotor_inertia` (kg·m², motor side).

    `stall_torque` (N·m) and `no_load_speed` (rad/s), on the motor's side, are the ends of its torque-speed line;
    infinite where the file states none.
    """

    name: str
    joint: str
    actuator: str
    reduction: float = 1.0
    rotor_inertia: float = 0.0
    line: int | None = None
    stall_torque: float = math.inf
    no_load_speed: float = math.inf

    @property
    def line_at_joint(self) -> tuple[float, float]:
        """Stall effort and no-load speed of the joint, N·m or N, rad/s or m/s."""
        ratio = abs(self.reduction)
        return self.stall_torque * ratio, self.no_load_speed / ratio


@dataclass(frozen=True, slots=True)
class Configuration:
    """A named pose: tree joint coordinates (rad or m) by `Joint.coordinates`, the seed of an assembly mode."""

    name: str
    values: Mapping[str, float] = field(hash=False)
    line: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", _read_only(self.values))

    def __reduce__(self) -> tuple[Any, ...]:
        return _reduce(self)


@dataclass(frozen=True, slots=True)
class Equation:
    """A linear condition between tree joint coordinates: the sum of coefficient * q equals `constant`."""

    name: str
    coefficients: Mapping[str, float] = field(hash=False)
    constant: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "coefficients", _read_only(self.coefficients))

    def __reduce__(self) -> tuple[Any, ...]:
        return _reduce(self)


@dataclass(frozen=True, slots=True)
class Cone:
    """The angle between unit `axis`, fixed on `link`, and unit `other_axis`, fixed on `other_link`, is at most `upper`.

    Each axis is in its link's frame; `upper` in rad.
    """

    name: str
    link: str
    axis: Vector3
    other_link: str
    other_axis: Vector3
    upper: float
    line: int | None = None


@dataclass(frozen=True, slots=True)
class Telescope:
    """Tubes of a prismatic joint, lengths in m: sleeve + rod - joint coordinate is at least `overlap`."""

    joint: str
    sleeve: float
    rod: float
    overlap: float
    line: int | None = None


@dataclass(frozen=True, slots=True)
class Segment:
    """A capsule fixed on a link: all points within `radius` of a line from `start` to `end`, in the link's frame, m."""

    link: str
    start: Vector3
    end: Vector3
    radius: float


@dataclass(frozen=True, slots=True)
class Clearance:
    """Two capsules on two links stay at least `minimum` apart, m, between their surfaces."""

    name: str
    first: Segment
    second: Segment
    minimum: float
    line: int | None = None


@dataclass(frozen=True, slots=True)
class Parameter:
    """A named design parameter: its value, unit, and where the number comes from."""

    name: str
    value: float
    unit: str
    source: str
    description: str = ""


@dataclass(frozen=True, eq=False)
class Description:
    """A validated mechanism: a tree of links and joints plus the constraints that close it.

    Build one with `leg_dynamics.description.read` or `parse`; the constructor itself does not validate.
    Equality and hashing go by content (`urdf` text), so a description can key a cache. `file` is where error
    messages point, `source` the xacro file behind it, if any. `driven` is what motors drive where there are no
    transmissions: ``independent`` joints, or ``none`` (the file's ``<robot driven="none">``).
    `dialect` is the language of the file that was read, ``URDF+`` or ``MJCF``; what is made from it is URDF+.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    loops: tuple[Loop, ...]
    couplings: tuple[Coupling, ...]
    transmissions: tuple[Transmission, ...]
    configurations: tuple[Configuration, ...]
    urdf: str
    file: str = "<string>"
    source: str | None = None
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    cones: tuple[Cone, ...] = ()
    telescopes: tuple[Telescope, ...] = ()
    clearances: tuple[Clearance, ...] = ()
    driven: str = DRIVEN[0]
    dialect: str = "URDF+"

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", _read_only(self.parameters))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Description) and self.urdf == other.urdf

    def __hash__(self) -> int:
        return hash(self.urdf)

    def __reduce__(self) -> tuple[Any, ...]:
        return _reduce(self)

    def __repr__(self) -> str:
        return (
            f"<Description {self.name!r}: {len(self.links)} links, {len(self.joints)} joints, "
            f"{len(self.loops)} loops, {len(self.couplings)} couplings>"
        )

    def __str__(self) -> str:
        from leg_dynamics.description.summary import summarize

        return summarize(self)

    @cached_property
    def _links(self) -> dict[str, Link]:
        return {link.name: link for link in self.links}

    @cached_property
    def _joints(self) -> dict[str, Joint]:
        return {joint.name: joint for joint in self.joints}

    @cached_property
    def _parent_joint(self) -> dict[str, Joint]:
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def root(self) -> str:
        """Name of the one link that is no joint's child."""
        return next(link.name for link in self.links if link.name not in self._parent_joint)

    @property
    def moving_joints(self) -> tuple[Joint, ...]:
        """Joints that are not fixed, in file order."""
        return tuple(joint for joint in self.joints if joint.type != "fixed")

    @property
    def home(self) -> Configuration | None:
        """The configuration named ``home``, else the first one, else None."""
        by_name = {c.name: c for c in self.configurations}
        return by_name.get("home", self.configurations[0] if self.configurations else None)

    def has_link(self, name: str) -> bool:
        """Whether a link of that name exists."""
        return name in self._links

    def link(self, name: str) -> Link:
        """The link of that name; DescriptionError where there is none."""
        try:
            return self._links[name]
        except KeyError:
            raise DescriptionError(f"there is no link {name!r}", file=self.file) from None

    def joint(self, name: str) -> Joint:
        """The joint of that name; DescriptionError where there is none."""
        try:
            return self._joints[name]
        except KeyError:
            raise DescriptionError(f"there is no joint {name!r}", file=self.file) from None

    def path(self, link: str) -> tuple[Joint, ...]:
        """Joints from the root to a link, root first."""
        joints: list[Joint] = []
        self.link(link)
        while (joint := self._parent_joint.get(link)) is not None:
            joints.append(joint)
            link = joint.parent
        return tuple(reversed(joints))
