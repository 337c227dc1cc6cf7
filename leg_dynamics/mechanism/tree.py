"""The adapter to pinocchio's tree: model from a description, frames of the loop ends, world frames without copies."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from leg_dynamics.description.model import Description, Joint, Link, Pose
from leg_dynamics.description.topology import joints_depth_first
from leg_dynamics.errors import DescriptionError, UnsupportedError
from leg_dynamics.mechanism.tree_check import check_tree

__all__ = ["FrameMemory", "Tree", "create_data", "tree_urdf"]

STANDARD_GRAVITY = 9.81
# What stands for an infinite limit: URDF readers want finite numbers.
UNLIMITED = 1e100
# pinocchio's data holds arrays of third derivatives, about eight of nv x nv x nv numbers.
DATA_BYTES = 64
MOST_DATA_BYTES = 4 << 30
# Its reader calls itself for each link of a chain; some thousands of calls overflow the stack of a thread.
MOST_DEPTH = 1000
# And its time grows with the square of the links.
MOST_LINKS = 10_000
# Principal moments of a body, relative to the largest: a smaller one is the rounding of a rod's or point's inertia.
SMALLEST_MOMENT = 1e-12
# kg: adding bodies, pinocchio divides by their mass or by this, the larger one, and misplaces lighter ones' centres.
SMALLEST_MASS = float(np.finfo(float).eps)


def _se3(pose: Pose) -> pin.SE3:
    return pin.SE3(pose.rotation(), np.array(pose.xyz))


def _finite(value: float) -> str:
    return repr(min(max(value, -UNLIMITED), UNLIMITED))


def _words(values: Iterable[float]) -> str:
    return " ".join(map(repr, values))


def _add_origin(element: ElementTree.Element, pose: Pose) -> None:
    ElementTree.SubElement(element, "origin", xyz=_words(pose.xyz), rpy=_words(pose.rpy))


def _add_link(root: ElementTree.Element, link: Link) -> None:
    element = ElementTree.SubElement(root, "link", name=link.name)
    if (body := link.inertial) is None:
        return
    inertial = ElementTree.SubElement(element, "inertial")
    _add_origin(inertial, body.origin)
    ElementTree.SubElement(inertial, "mass", value=repr(body.mass))
    moments = {name: repr(getattr(body, name)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
    ElementTree.SubElement(inertial, "inertia", moments)


def _add_joint(root: ElementTree.Element, joint: Joint) -> None:
    element = ElementTree.SubElement(root, "joint", name=joint.name, type=joint.type)
    ElementTree.SubElement(element, "parent", link=joint.parent)
    ElementTree.SubElement(element, "child", link=joint.child)
    _add_origin(element, joint.origin)
    if joint.type == "fixed":
        return
    bounds = {name: _finite(getattr(joint.limits, name)) for name in ("lower", "upper", "effort", "velocity")}
    # The unit vector: pinocchio's reader squares what the file says, and squares overflow or vanish.
    ElementTree.SubElement(element, "axis", xyz=_words(joint.axis))
    ElementTree.SubElement(element, "limit", bounds)
    ElementTree.SubElement(element, "dynamics", damping=_finite(joint.damping), friction=_finite(joint.friction))


def tree_urdf(description: Description) -> str:
    """Links and joints as strict URDF, written from the description: readers of URDF differ in what they let pass.

    urdfdom for example drops a body without a word where a blank follows its mass. Axes are unit vectors, limits,
    damping and friction complete, infinite limits large numbers. Loops, couplings, mimicry and shapes are left out:
    pinocchio's tree has no use for them.
    """
    # Without the version: only the loops' dialect has other ones.
    root = ElementTree.Element("robot", name=description.name)
    for link in description.links:
        _add_link(root, link)
    for joint in description.joints:
        _add_joint(root, joint)
    return ElementTree.tostring(root, encoding="unicode")


def create_data(model: pin.Model) -> pin.Data:
    """pinocchio's working memory for a model.

    Raises
    ------
    UnsupportedError
        The model has so many joints that the memory, which grows with their third power, is out of reach.
    """
    if DATA_BYTES * model.nv**3 <= MOST_DATA_BYTES:
        try:
            return model.createData()
        except MemoryError:
            pass
    raise UnsupportedError(_too_many_joints(model.nv), joints=model.nv)


def _most_joints() -> int:
    return math.floor((MOST_DATA_BYTES / DATA_BYTES) ** (1 / 3))


def _too_many_joints(joints: int) -> str:
    return (
        f"{joints} tree joints are too many: pinocchio would need {DATA_BYTES * joints**3 / 2**30:.3g} GiB for each "
        f"thread, the limit is {MOST_DATA_BYTES / 2**30:.3g} GiB, about {_most_joints()} "
        "joints; fix joints that need not move, or model a part of the mechanism"
    )


def _unsupported(description: Description, message: str, line: int | None, **evidence: Any) -> UnsupportedError:
    """The error for what this route cannot compute of a file, naming file and line."""
    place = description.file if line is None else f"{description.file}:{line}"
    return UnsupportedError(f"{place}: {message}", file=description.file, line=line, **evidence)


def _check_size(description: Description) -> None:
    """Refuse a tree that pinocchio's reader would take the interpreter down with."""
    joints = len(description.moving_joints)
    if DATA_BYTES * joints**3 > MOST_DATA_BYTES:
        line = description.moving_joints[_most_joints()].line
        raise _unsupported(description, _too_many_joints(joints), line, joints=joints)
    links = len(description.links)
    if links > MOST_LINKS:
        raise _unsupported(
            description,
            f"{links} links are too many for pinocchio's reader, the limit is {MOST_LINKS}: merge links that fixed "
            "joints hold together",
            description.links[MOST_LINKS].line,
            links=links,
        )
    depth = {description.root: 0}
    for joint in joints_depth_first(description):
        depth[joint.child] = depth[joint.parent] + 1
    deepest = max(depth.values())
    if deepest > MOST_DEPTH:
        raise _unsupported(
            description,
            f"{deepest} joints in a chain are too many for pinocchio's reader, the limit is {MOST_DEPTH}: merge links "
            "that fixed joints hold together",
            next(joint.line for joint in description.joints if depth[joint.child] > MOST_DEPTH),
            depth=deepest,
        )


@dataclass(frozen=True)
class Tree:
    """The spanning tree as pinocchio reads it, plus where each tree coordinate sits in its vectors.

    Tree coordinates are angles (rad) and displacements (m), one a moving joint, in pinocchio's velocity order.
    pinocchio stores a `continuous` joint as (cos, sin); `to_configuration` is the only place that knows.

    Attributes
    ----------
    model : pinocchio.Model
        Carries one extra frame for each loop end.
    joint_names : tuple of str
        Tree joints in velocity order, length nv.
    """

    model: pin.Model
    joint_names: tuple[str, ...]
    angle_index: np.ndarray
    circle_index: np.ndarray
    circle_coordinate: np.ndarray
    plain_coordinate: np.ndarray

    @classmethod
    def from_description(cls, description: Description) -> Tree:
        """Let pinocchio parse the tree and check that it has the joints, placements and bodies of the description.

        Raises
        ------
        UnsupportedError
            A joint has more than one coordinate (floating, planar), or carries a mass that is no mass to pinocchio.
        DescriptionError
            pinocchio refuses the tree, or reads other joints, placements, masses or inertias.
        """
        for joint in description.moving_joints:
            if not joint.is_single_coordinate:
                raise _unsupported(
                    description,
                    f"joint {joint.name!r} is {joint.type}: this route handles revolute, continuous and prismatic "
                    "joints; give the leg a fixed base",
                    joint.line,
                    joint=joint.name,
                )
        _check_size(description)
        try:
            model = pin.buildModelFromXML(tree_urdf(description))
        except (ValueError, RuntimeError) as error:
            raise DescriptionError(f"pinocchio cannot read the tree: {error}", file=description.file) from error
        names = tuple(model.names[1:])
        expected = {joint.name for joint in description.moving_joints}
        if set(names) != expected:
            raise DescriptionError(
                f"pinocchio reads other joints than the description: {sorted(set(names) ^ expected)}",
                file=description.file,
            )
        for name, inertia in zip(names, list(model.inertias)[1:], strict=True):
            if 0.0 < inertia.mass < SMALLEST_MASS:
                raise _unsupported(
                    description,
                    f"joint {name!r} carries {inertia.mass:g} kg, which pinocchio cannot add up, the least is "
                    f"{SMALLEST_MASS:.3g} kg: check the unit, or leave the mass out (0)",
                    description.joint(name).line,
                    joint=name,
                    mass=float(inertia.mass),
                )
        check_tree(model, description)
        idx_q = np.array([model.joints[i].idx_q for i in range(1, model.njoints)], dtype=np.intp)
        is_circle = np.array([model.joints[i].nq == 2 for i in range(1, model.njoints)], dtype=bool)
        armature = model.armature
        for joint in description.moving_joints:
            armature[model.joints[model.getJointId(joint.name)].idx_v] += joint.armature
        for transmission in description.transmissions:
            index = model.joints[model.getJointId(transmission.joint)].idx_v
            armature[index] += transmission.rotor_inertia * transmission.reduction**2
        model.armature = armature
        return cls(
            model=model,
            joint_names=names,
            angle_index=idx_q[~is_circle],
            circle_index=idx_q[is_circle],
            circle_coordinate=np.flatnonzero(is_circle),
            plain_coordinate=np.flatnonzero(~is_circle),
        )

    def has_inertia_everywhere(self) -> bool:
        """Whether every joint has an armature, or carries a body with mass and inertia about every axis.

        Then the tree's mass matrix is regular in every pose: joint by joint, no kinetic energy means no speed.
        """
        for index in range(1, self.model.njoints):
            if self.model.armature[self.model.joints[index].idx_v] > 0.0:
                continue
            inertia = self.model.inertias[index]
            moments = np.linalg.eigvalsh(inertia.inertia)
            if not (inertia.mass > 0.0 and moments[0] > SMALLEST_MOMENT * moments[-1]):
                return False
        return True

    def to_configuration(self, coordinates: np.ndarray) -> np.ndarray:
        """Turn tree coordinates, shape (nv,), into pinocchio's configuration vector, shape (nq,)."""
        if self.circle_index.size == 0:
            return coordinates
        configuration = np.empty(self.model.nq)
        configuration[self.angle_index] = coordinates[self.plain_coordinate]
        angle = coordinates[self.circle_coordinate]
        configuration[self.circle_index] = np.cos(angle)
        configuration[self.circle_index + 1] = np.sin(angle)
        return configuration

    def add_frame(self, name: str, link: str, placement: pin.SE3) -> int:
        """Attach a frame to a link of the model and return its index."""
        body = self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]
        frame = pin.Frame(name, body.parentJoint, body.placement * placement, pin.FrameType.OP_FRAME)
        return int(self.model.addFrame(frame))

    def add_loop_end(self, name: str, link: str, pose: Pose, alignment: np.ndarray) -> int:
        """Attach a loop end: the file's pose, turned so that the loop axis becomes the frame's z."""
        return self.add_frame(name, link, _se3(pose) * pin.SE3(alignment, np.zeros(3)))

    def support(self, frame: int) -> np.ndarray:
        """1.0 for each tree coordinate that moves this frame, else 0.0; shape (nv,)."""
        mask = np.zeros(self.model.nv)
        joint = self.model.frames[frame].parentJoint
        while joint > 0:
            mask[self.model.joints[joint].idx_v] = 1.0
            joint = self.model.parents[joint]
        return mask


class FrameMemory:
    """All frames' world placements as one array, read in place.

    Row 4 f + c holds column c of frame f's rotation (world axes) for c in 0..2 and its origin for c = 3. Reading
    the frames one by one through the bindings costs more than the whole of the closure's algebra; pinocchio keeps
    them in one block whose layout is checked here, and where the check fails the rows are copied instead.
    """

    def __init__(self, model: pin.Model, data: pin.Data) -> None:
        self._data = data
        self._count = model.nframes
        self._view = self._map()

    def _map(self) -> np.ndarray | None:
        first = self._data.oMf[0].rotation
        address = first.__array_interface__["data"][0]
        for index in range(self._count):
            placement = self._data.oMf[index]
            rotation, origin = placement.rotation, placement.translation
            if rotation.flags.owndata or not rotation.flags.f_contiguous:
                return None
            if rotation.__array_interface__["data"][0] != address + 96 * index:
                return None
            if origin.__array_interface__["data"][0] != address + 96 * index + 72:
                return None
        return np.lib.stride_tricks.as_strided(first.T, shape=(4 * self._count, 3), strides=(24, 8), writeable=False)

    def rows(self) -> np.ndarray:
        """Placements after the last `pin.updateFramePlacements`, shape (4 nframes, 3)."""
        if self._view is not None:
            return self._view
        copied = np.empty((4 * self._count, 3))
        for index in range(self._count):
            placement = self._data.oMf[index]
            copied[4 * index : 4 * index + 3] = placement.rotation.T
            copied[4 * index + 3] = placement.translation
        return copied
