"""The spanning tree as bodies moved by one joint each: links that are fixed to each other are one body.

A joint carries the frame of its child: placed in the parent body by a constant transform, turned or pushed along a
constant axis by a linear form of u. Joints with several coordinates would be several such steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from leg_dynamics.description.model import Description, Joint, Loop, LoopEnd, Pose
from leg_dynamics.description.topology import joints_depth_first
from leg_dynamics.errors import DescriptionError, ParameterError, UnsupportedError
from leg_dynamics.symbolic.coordinates import Coordinates, Form
from leg_dynamics.symbolic.numbers import Numbers
from leg_dynamics.symbolic.scalars import (
    IDENTITY,
    ZERO,
    Matrix,
    Scalar,
    Vector,
    add,
    add_vectors,
    align_z,
    atan2,
    axis_rotation,
    clean_matrix,
    cos,
    cross,
    dot,
    matmul,
    matvec,
    mul,
    neg,
    scale,
    sin,
    sqrt,
    sub,
    transpose,
)

__all__ = ["GROUND", "BodyInertia", "Placement", "Tree", "TreeJoint", "build_tree", "characteristic_length"]

GROUND = -1
"""Index of the body that carries the root link."""


@dataclass(frozen=True)
class Placement:
    """A constant pose in a body's frame: rotation (floats) and origin (m)."""

    body: int
    rotation: Matrix
    origin: Vector


@dataclass(frozen=True)
class TreeJoint:
    """A moving joint and the body it carries, both under its index; `axis` in the joint's frame."""

    name: str
    kind: str
    parent: int
    placement: Placement
    axis: tuple[float, float, float]
    form: Form
    unit: float
    damping: Scalar
    friction: Scalar
    rotor: Scalar

    @property
    def turns(self) -> bool:
        """Whether the joint rotates; otherwise it slides."""
        return self.kind != "prismatic"


@dataclass(frozen=True)
class BodyInertia:
    """Mass (kg), first moment (kg·m) and inertia about the frame's origin (kg·m²; xx, xy, xz, yy, yz, zz)."""

    mass: Scalar
    first: Vector
    second: tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]

    def __add__(self, other: BodyInertia) -> BodyInertia:
        second = tuple(add(a, b) for a, b in zip(self.second, other.second, strict=True))
        return BodyInertia(add(self.mass, other.mass), add_vectors(self.first, other.first), second)

    def values(self) -> tuple[Scalar, ...]:
        """The ten numbers."""
        return (self.mass, *self.first, *self.second)

    def turned(self, rotation: Matrix) -> BodyInertia:
        """The same body in the axes that `rotation` maps the old ones to."""
        matrix = symmetric(self.second)
        turned = matmul(matmul(rotation, matrix), transpose(rotation))
        return BodyInertia(self.mass, matvec(rotation, self.first), upper(turned))


NO_INERTIA = BodyInertia(0.0, ZERO, (0.0,) * 6)


def symmetric(entries: tuple[Scalar, ...]) -> Matrix:
    """The matrix of six entries xx, xy, xz, yy, yz, zz."""
    xx, xy, xz, yy, yz, zz = entries
    return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))


def upper(m: Matrix) -> tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]:
    """The six entries xx, xy, xz, yy, yz, zz of a symmetric matrix."""
    return (m[0][0], m[0][1], m[0][2], m[1][1], m[1][2], m[2][2])


@dataclass(frozen=True)
class Tree:
    """Bodies and joints in depth-first order, the ground's frame being that of the `hip` link.

    Attributes
    ----------
    joints : tuple of TreeJoint
        Joint i carries body i. Turns by parameters are among them, see `TURN`.
    links : mapping of str to Placement
    inertia : tuple of BodyInertia
        By body, in its frame.
    length : float
        The mechanism's characteristic length, m.
    gravity : tuple of three floats
        The file's, in the hip frame, m/s².
    ends : mapping of (str, str) to Placement
        Loop frames, z along the loop's axis, by loop and role (``predecessor``, ``successor``).
    """

    joints: tuple[TreeJoint, ...]
    links: Mapping[str, Placement]
    inertia: tuple[BodyInertia, ...]
    length: float
    gravity: tuple[float, float, float]
    ends: Mapping[tuple[str, str], Placement] = field(default_factory=dict)

    def name_of(self, body: int) -> str:
        """The joint that carries a body."""
        return "ground" if body == GROUND else self.joints[body].name

    def ancestors(self, body: int) -> list[int]:
        """The body and those that carry it, ground last."""
        chain = [body]
        while body != GROUND:
            body = self.joints[body].parent
            chain.append(body)
        return chain


STANDARD_GRAVITY = 9.81
# In the names of joints that turn by a parameter, which no file's joint has.
TURN = "\n"
ROLL_PITCH_YAW = (0, 1, 2)


class _Planter:
    """Grows the tree: joints so far, and frames that are turned by numbers or by parameters."""

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.joints: list[TreeJoint] = []

    def turned(self, place: Placement, axis: int, form: Form) -> Placement:
        """A frame turned about one of its coordinate axes; a turn by a parameter is a joint."""
        if not form.terms:
            return _place(place, axis_rotation(axis, form.constant), ZERO)
        direction = (float(axis == 0), float(axis == 1), float(axis == 2))
        name = f"{TURN}{len(self.joints)}"
        self.joints.append(TreeJoint(name, "revolute", place.body, place, direction, form, 1.0, 0.0, 0.0, 0.0))
        return Placement(len(self.joints) - 1, IDENTITY, ZERO)

    def placed(self, parent: Placement, pose: Pose, position: str, angles: str) -> Placement:
        """The frame of a pose whose numbers have these names."""
        origin, rpy = self.numbers.vector(position), self.numbers.angles(angles)
        if all(isinstance(angle, float) for angle in rpy):
            return _place(parent, clean_matrix(pose.rotation()), origin)
        place = _place(parent, IDENTITY, origin)
        for axis in reversed(ROLL_PITCH_YAW):
            place = self.turned(place, axis, self.numbers.turn(rpy[axis]))
        return place

    def aimed(self, place: Placement, name: str, axis: Sequence[float]) -> tuple[Placement, list[tuple[int, Form]]]:
        """The frame turned so that its z axis is along NAME.x, .y, .z, and the turns that were made for it."""
        align = align_z(axis)
        x, y, z = matvec(transpose(align), self.numbers.vector(name))
        # R_x(a) R_y(b) e_z = (sin b, -sin a cos b, cos a cos b)
        a, b = atan2(neg(y), z), atan2(x, sqrt(add(mul(y, y), mul(z, z))))
        place = _place(place, align, ZERO)
        turns = [(0, self.numbers.turn(a)), (1, self.numbers.turn(b))]
        for each in turns:
            place = self.turned(place, *each)
        return place, turns

    def joint(self, joint: Joint, parent: Placement, form: Form, unit: float, rotor: Scalar) -> Placement:
        """Add a moving joint and return the frame of its child."""
        place = self.placed(parent, joint.origin, f"{joint.name}.origin", f"{joint.name}.origin")
        value = self.numbers.values
        losses = (value[f"{joint.name}.damping"], value[f"{joint.name}.friction"], rotor)
        x, y, z = joint.axis
        axis = (x + 0.0, y + 0.0, z + 0.0)
        symbolic = not all(isinstance(value[f"{joint.name}.axis.{each}"], float) for each in "xyz")
        turns: list[tuple[int, Form]] = []
        if symbolic:
            place, turns = self.aimed(place, f"{joint.name}.axis", axis)
        along = (0.0, 0.0, 1.0) if symbolic else axis
        self.joints.append(TreeJoint(joint.name, joint.type, place.body, place, along, form, unit, *losses))
        child = Placement(len(self.joints) - 1, IDENTITY, ZERO)
        for number, turn in reversed(turns):
            child = self.turned(child, number, turn.scaled(-1.0))
        return _place(child, transpose(align_z(axis)), ZERO) if symbolic else child

    def loop_end(self, loop: Loop, role: str, end: LoopEnd, link: Placement) -> Placement:
        """The frame of a loop's end, z along the loop's axis."""
        name = f"{loop.name}.{role}"
        place = self.placed(link, end.origin, name, name)
        if loop.axis is None:
            return place
        if all(isinstance(self.numbers.values[f"{loop.name}.axis.{each}"], float) for each in "xyz"):
            return _place(place, align_z(loop.axis), ZERO)
        return self.aimed(place, f"{loop.name}.axis", loop.axis)[0]


def _place(parent: Placement, rotation: Matrix, origin: Vector) -> Placement:
    turned = clean_matrix(matmul(parent.rotation, rotation))
    return Placement(parent.body, turned, add_vectors(parent.origin, matvec(parent.rotation, origin)))


def build_tree(
    description: Description, coordinates: Coordinates, numbers: Numbers, hip: str | None, length: float
) -> Tree:
    """Bodies and joints of a description.

    Parameters
    ----------
    description : Description
    coordinates : Coordinates
        Every tree joint as a form of u.
    numbers : Numbers
    hip : str or None
        Link whose frame is the ground's; the root where None.
    length : float
        See `characteristic_length`.

    Raises
    ------
    UnsupportedError
        A joint is floating or planar.
    DescriptionError
        The hip link moves relative to the root.
    """
    root = description.root
    hip = root if hip is None else hip
    start = _hip_placement(description, numbers, hip)
    rotor = {joint.name: numbers.values[f"{joint.name}.armature"] for joint in description.moving_joints}
    for each in description.transmissions:
        inertia_of, reduction = (numbers.values[f"{each.name}.{key}"] for key in ("rotor_inertia", "reduction"))
        rotor[each.joint] = add(rotor[each.joint], mul(inertia_of, mul(reduction, reduction)))
    links = {root: start}
    planter = _Planter(numbers)
    for joint in joints_depth_first(description):
        parent = links[joint.parent]
        if joint.type == "fixed":
            name = f"{joint.name}.origin"
            links[joint.child] = planter.placed(parent, joint.origin, name, name)
            continue
        if not joint.is_single_coordinate:
            raise UnsupportedError(
                f"joint {joint.name!r} is {joint.type}: this route handles revolute, continuous and prismatic joints; "
                "give the leg a fixed base",
                joint=joint.name,
            )
        unit = length if joint.type == "prismatic" else 1.0
        form = coordinates.forms[joint.name]
        links[joint.child] = planter.joint(joint, parent, form, unit, rotor[joint.name])
    ends = {
        (loop.name, role): planter.loop_end(loop, role, end, links[end.link])
        for loop in description.loops
        for role, end in (("predecessor", loop.predecessor), ("successor", loop.successor))
    }
    joints = planter.joints
    inertia = [NO_INERTIA] * len(joints)
    for link in description.links:
        place = links[link.name]
        if link.inertial is None or place.body == GROUND:
            continue
        inertia[place.body] = inertia[place.body] + _inertia(link.name, link.inertial.origin, numbers, place)
    down = matvec(start.rotation, (0.0, 0.0, -STANDARD_GRAVITY))
    gravity = (down[0] + 0.0, down[1] + 0.0, down[2] + 0.0)
    return Tree(tuple(joints), links, tuple(inertia), length, gravity, ends)


def _hip_placement(description: Description, numbers: Numbers, hip: str) -> Placement:
    """Pose of the root link in the hip link's frame."""
    place = Placement(GROUND, IDENTITY, ZERO)
    for joint in description.path(hip):
        if joint.type != "fixed":
            raise DescriptionError(f"the hip link {hip!r} moves relative to the root", file=description.file)
        if not all(isinstance(angle, float) for angle in numbers.angles(f"{joint.name}.origin")):
            raise ParameterError(
                f"{joint.name!r} holds the hip link, and gravity is given in its frame: turn gravity instead of it",
                parameter=joint.name,
            )
        place = _place(place, clean_matrix(joint.origin.rotation()), numbers.vector(f"{joint.name}.origin"))
    inverse = transpose(place.rotation)
    origin = matvec(inverse, place.origin)
    return Placement(GROUND, inverse, (neg(origin[0]), neg(origin[1]), neg(origin[2])))


def _inertia(name: str, pose: Pose, numbers: Numbers, place: Placement) -> BodyInertia:
    """A link's inertia in the frame of its body (parallel-axis theorem)."""
    value = numbers.values
    axes = clean_matrix(matmul(place.rotation, _rotation(pose, numbers.angles(f"{name}.inertial"))))
    mass = value[f"{name}.mass"]
    com = add_vectors(place.origin, matvec(place.rotation, numbers.vector(f"{name}.com")))
    entries = tuple(value[f"{name}.{entry}"] for entry in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    central = BodyInertia(mass, ZERO, entries).turned(axes)
    squared = dot(com, com)
    shift = [[mul(mass, neg(mul(com[i], com[j]))) for j in range(3)] for i in range(3)]
    for i in range(3):
        shift[i][i] = mul(mass, sub(squared, mul(com[i], com[i])))
    parallel = (shift[0][0], shift[0][1], shift[0][2], shift[1][1], shift[1][2], shift[2][2])
    return BodyInertia(mass, scale(mass, com), central.second) + BodyInertia(0.0, ZERO, parallel)


def _rotation(pose: Pose, rpy: Vector) -> Matrix:
    """Rz(yaw) Ry(pitch) Rx(roll), with symbols where an angle is one."""
    if all(isinstance(angle, float) for angle in rpy):
        return clean_matrix(pose.rotation())
    result = IDENTITY
    for axis in reversed(ROLL_PITCH_YAW):
        s, c = sin(rpy[axis]), cos(rpy[axis])
        b, d = (axis + 1) % 3, (axis + 2) % 3
        rows = [list(row) for row in IDENTITY]
        rows[b][b], rows[d][d], rows[b][d], rows[d][b] = c, c, neg(s), s
        result = matmul(result, (tuple(rows[0]), tuple(rows[1]), tuple(rows[2])))
    return result


def characteristic_length(description: Description) -> float:
    """Size of the largest body, m, rounded to a power of two; 1 where all joints sit in one point.

    A body's size is the diagonal of the box around its joints and loop ends in its own frame.
    """
    place: dict[str, tuple[str, np.ndarray]] = {description.root: (description.root, np.eye(4))}
    points: dict[str, list[np.ndarray]] = {description.root: []}
    for joint in joints_depth_first(description):
        body, transform = place[joint.parent]
        there = transform @ joint.origin.matrix()
        if joint.type == "fixed":
            place[joint.child] = (body, there)
            continue
        points[body].append(there[:3, 3])
        place[joint.child] = (joint.child, np.eye(4))
        points[joint.child] = [np.zeros(3)]
    for loop in description.loops:
        for end in (loop.predecessor, loop.successor):
            body, transform = place[end.link]
            points[body].append((transform @ end.origin.matrix())[:3, 3])
    size = max((float(np.linalg.norm(np.ptp(body, axis=0))) for body in points.values() if body), default=0.0)
    return 2.0 ** round(math.log2(size)) if size > 0.0 else 1.0


__all__ += ["NO_INERTIA", "cross", "symmetric", "upper"]
