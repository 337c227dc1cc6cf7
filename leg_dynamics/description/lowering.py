"""Joints of several coordinates as chains of joints with one coordinate each, about massless links."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from leg_dynamics.description.model import Description, Joint, Vector3
from leg_dynamics.description.parse import build
from leg_dynamics.description.xml_reader import Document
from leg_dynamics.errors import DescriptionError, UnsupportedError

__all__ = ["Step", "replace_by_chain", "single_coordinate", "turns"]

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_AXES = {"x": _X, "y": _Y, "z": _Z}


@dataclass(frozen=True)
class Step:
    """One joint of a chain: what its name appends to the replaced joint's, its type, and its unit axis."""

    suffix: str
    type: str
    axis: Vector3


def turns(axes: str) -> tuple[Step, ...]:
    """Revolute steps without limits about coordinate axes, ``"xyz"`` say; each about the axes that the last one left.

    A ball joint is ``turns("xyz")``: its rotation is Rx(x) Ry(y) Rz(z), singular where y is a right angle.
    """
    return tuple(Step(f"_{axis}", "continuous", _AXES[axis]) for axis in axes)


def replace_by_chain(root: ElementTree.Element, joint: ElementTree.Element, steps: Sequence[Step]) -> None:
    """Put a chain of joints in the place of one joint; without steps, weld it.

    No joint of the chain is driven. The first one keeps the element, so its origin, parent, flags and other children;
    the others and the massless links between follow behind it. Each is named after the joint, NAME_x, and the link that
    it carries NAME_x_link. The last one carries the joint's child.

    Parameters
    ----------
    root : Element
        The ``<robot>``.
    joint : Element
        One of its joints. Its axis is replaced.
    steps : sequence of Step
        The first one nearest to the parent.
    """
    for found in joint.findall("axis"):
        joint.remove(found)
    if not steps:
        joint.set("type", "fixed")
        return
    name, child = str(joint.get("name")), joint.find("child")
    assert child is not None
    last = str(child.get("link"))
    copied = [each for each in joint if each.tag in ("limit", "dynamics")]
    flag = joint.get("independent")
    # No motor drives a single coordinate of it.
    joint.set("driven", "false")
    place = list(root).index(joint)
    for number, step in enumerate(steps):
        first, end = number == 0, last
        this = joint if first else ElementTree.Element("joint")
        this.set("name", f"{name}{step.suffix}")
        this.set("type", step.type)
        if number < len(steps) - 1:
            end = f"{name}{step.suffix}_link"
            place += 1
            root.insert(place, ElementTree.Element("link", name=end))
        if first:
            child.set("link", end)
        else:
            place += 1
            root.insert(place, this)
            if flag is not None:
                this.set("independent", flag)
            this.set("driven", "false")
            ElementTree.SubElement(this, "parent", link=f"{name}{steps[number - 1].suffix}_link")
            ElementTree.SubElement(this, "child", link=end)
            for each in copied:
                ElementTree.SubElement(this, each.tag, each.attrib)
        ElementTree.SubElement(this, "axis", xyz=" ".join(map(_number, step.axis)))


def _number(value: float) -> str:
    return repr(int(value)) if value.is_integer() else repr(value)


def single_coordinate(description: Description) -> Description:
    """Return the mechanism with a chain of one-coordinate joints for every joint of several coordinates.

    A floating joint NAME becomes prismatic joints NAME_x, NAME_y, NAME_z along the axes of the joint's frame, then
    revolute ones NAME_yaw, NAME_pitch, NAME_roll about z, y, x: the child's rotation is Rz(yaw) Ry(pitch) Rx(roll). At
    a pitch of a right angle these coordinates are singular, and so is the mass matrix. A planar joint becomes
    prismatic joints NAME_x, NAME_y across its normal n and a revolute one NAME_yaw about it: x is along the next
    coordinate axis, in the order x, y, z, x, after the one that n is nearest to, projected into the plane, and y along
    n times x.

    Parameters
    ----------
    description : Description
        Its configurations may give the new coordinates by their names, see `Joint.coordinates`.

    Returns
    -------
    Description
        With independent flags and limits of effort and speed carried over to each joint of a chain, none of which is
        driven; the same object where there is nothing to replace.

    Raises
    ------
    UnsupportedError
        Such a joint has damping, friction or armature, which does not say what coordinate it belongs to.
    DescriptionError
        The file has a joint or link with one of the new names.
    """
    several = [joint for joint in description.joints if len(joint.coordinates) > 1]
    if not several:
        return description
    _check_names(description, several)
    root = ElementTree.fromstring(description.urdf)
    elements = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for joint in several:
        element = elements[joint.name]
        for found in element.findall("dynamics"):
            element.remove(found)
        for limit in element.findall("limit"):
            _drop_bounds(element, limit)
        replace_by_chain(root, element, _steps(joint))
    ElementTree.indent(root)
    document = Document(description.file, source=description.source, quiet=True)
    return build(ElementTree.tostring(root, encoding="unicode"), document, description.parameters)


def _check_names(description: Description, several: Sequence[Joint]) -> None:
    joints = {joint.name for joint in description.joints}
    for joint in several:
        losses = {"damping": joint.damping, "friction": joint.friction, "armature": joint.armature}
        for what, value in losses.items():
            if value != 0.0:
                raise UnsupportedError(
                    f"{what} {value:g} of the {joint.type} joint {joint.name!r} does not say which of its coordinates "
                    "it belongs to: write the joint as a chain of joints with one coordinate each",
                    joint=joint.name,
                )
        for name in joint.coordinates:
            taken = name in joints or (name != joint.coordinates[-1] and description.has_link(f"{name}_link"))
            if taken:
                raise DescriptionError(
                    f"the {joint.type} joint {joint.name!r} is computed as joints {', '.join(joint.coordinates)} with "
                    f"links between, and the file has another joint {name!r} or link '{name}_link': rename that one",
                    file=description.file,
                    line=joint.line,
                    joint=joint.name,
                )
            joints.add(name)


def _drop_bounds(joint: ElementTree.Element, limit: ElementTree.Element) -> None:
    """Position bounds mean nothing for several coordinates; a limit without content goes."""
    for bound in ("lower", "upper"):
        limit.attrib.pop(bound, None)
    if not limit.attrib:
        joint.remove(limit)


def _steps(joint: Joint) -> tuple[Step, ...]:
    axes: tuple[Vector3, ...] = (_X, _Y, _Z, _Z, _Y, _X)
    kinds: tuple[str, ...] = ("prismatic", "prismatic", "prismatic", "continuous", "continuous", "continuous")
    if joint.type == "planar":
        axes, kinds = (*_plane(joint.axis), joint.axis), ("prismatic", "prismatic", "continuous")
    suffixes = (name.removeprefix(joint.name) for name in joint.coordinates)
    return tuple(Step(*each) for each in zip(suffixes, kinds, axes, strict=True))


def _plane(normal: Vector3) -> tuple[Vector3, Vector3]:
    """Two unit vectors across a unit normal, right-handed with it."""
    nearest = max(range(3), key=lambda k: abs(normal[k]))
    k = (nearest + 1) % 3
    # The part of that coordinate axis across the normal; at least 0.7 long, as the normal is nearer to another axis.
    across = [float(i == k) - normal[k] * normal[i] for i in range(3)]
    length = math.hypot(*across)
    (a, b, c), (x, y, z) = (across[0] / length, across[1] / length, across[2] / length), normal
    return (a, b, c), (y * c - z * b, z * a - x * c, x * b - y * a)
