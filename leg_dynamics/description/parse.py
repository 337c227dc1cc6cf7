"""URDF+ text to a validated `Description`: one function an element, then the checks that need the whole file."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import TypeVar

from leg_dynamics.description.constraints import CONSTRAINT_TAGS, read_clearance, read_cone, read_telescopes
from leg_dynamics.description.model import (
    JOINT_TYPES,
    LOOP_TYPES,
    Clearance,
    Cone,
    Configuration,
    Coupling,
    Description,
    Geometry,
    Inertial,
    Joint,
    JointLimits,
    Link,
    Loop,
    LoopEnd,
    Mimic,
    Parameter,
    Pose,
    Transmission,
    Vector3,
    Visual,
)
from leg_dynamics.description.validate import validate
from leg_dynamics.description.xml_reader import Document, Node, nearest, read_root

__all__ = ["build", "parse"]

_READ_TAGS = frozenset(
    {"link", "joint", "loop", "coupling", "transmission", "configuration", "material", *CONSTRAINT_TAGS}
)
# Other programs' extensions, which say nothing about the mechanism.
_FOREIGN_TAGS = frozenset({"gazebo", "sensor", "ros2_control", "mujoco", "drake", "group", "group_state", "version"})
_LOOPS_WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")
_DEFAULT_AXIS = (1.0, 0.0, 0.0)
_ORIGIN = (0.0, 0.0, 0.0)
_SHORTEST_AXIS = 1e-9

Colour = tuple[float, float, float, float]
_Named = TypeVar("_Named", Link, Joint, Loop, Coupling, Transmission, Configuration, Cone, Clearance)


def parse(text: str, *, file: str = "<string>") -> Description:
    """Read and validate URDF+ text.

    Parameters
    ----------
    text : str
        The XML document: plain URDF, or URDF with ``<loop>``, ``<coupling>``, ``<configuration>``, the
        ``independent`` flag, and the constraints ``<cone>``, ``<telescope>`` and ``<clearance>``.
    file : str
        What errors call it.

    Returns
    -------
    Description
        The validated mechanism.

    Raises
    ------
    DescriptionError
        At the first thing that cannot be true, with file and line.
    UnsafeXmlError
        For document types, entities, and absurd nesting.

    Warns
    -----
    LegDynamicsWarning
        For non-physical inertia, and for odd input with one safe reading.
    """
    return build(text, Document(file))


def build(text: str, document: Document, parameters: Mapping[str, Parameter] = MappingProxyType({})) -> Description:
    """As `parse`, for a text that may be rendered from a source with parameters.

    Parameters
    ----------
    text : str
        The XML document.
    document : Document
        File name and source, for errors.
    parameters : mapping of str to Parameter
        What the text was rendered with.

    Returns
    -------
    Description
        The validated mechanism.

    Raises
    ------
    DescriptionError
        See `parse`.
    """
    with _collector_paused():
        description = _build(text, document, parameters)
        validate(description, document)
    return description


@contextmanager
def _collector_paused() -> Iterator[None]:
    """No garbage collection meanwhile: a tree of a million live objects would be walked again and again."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _build(text: str, document: Document, parameters: Mapping[str, Parameter]) -> Description:
    root = read_root(text, document, keep=_READ_TAGS)
    elements = _sorted_by_tag(root)
    colours = _named_colours(elements["link"], elements["material"])
    links = _unique(elements["link"], lambda node: _link(node, colours))
    if not links:
        raise root.error("the file has no <link>")
    joints = _unique(elements["joint"], lambda node: _joint(node, links))
    _warn_about_missing_bounds(elements["joint"])
    loops = _unique(elements["loop"], lambda node: _loop(node, links))
    couplings = _unique(elements["coupling"], lambda node: _coupling(node, links))
    transmissions = _unique(elements["transmission"], lambda node: _transmission(node, joints))
    configurations = _unique(elements["configuration"], lambda node: _configuration(node, joints))
    cones = _unique(elements["cone"], lambda node: read_cone(node, links))
    telescopes = read_telescopes(elements["telescope"], joints)
    clearances = _unique(elements["clearance"], lambda node: read_clearance(node, links))
    return Description(
        name=root.required("name"),
        links=tuple(links.values()),
        joints=tuple(joints.values()),
        loops=tuple(loops.values()),
        couplings=tuple(couplings.values()),
        transmissions=tuple(transmissions.values()),
        configurations=tuple(configurations.values()),
        urdf=text,
        file=document.file,
        source=document.source,
        parameters=parameters,
        cones=tuple(cones.values()),
        telescopes=telescopes,
        clearances=tuple(clearances.values()),
    )


def _sorted_by_tag(root: Node) -> dict[str, list[Node]]:
    """The root's children by tag; a warning for what would be lost in silence."""
    if root.tag != "robot":
        raise root.error(f"the root element is <{root.tag}>, a mechanism file's is <robot>")
    elements: dict[str, list[Node]] = {tag: [] for tag in sorted(_READ_TAGS)}
    for node in root.children:
        if node.tag in elements:
            elements[node.tag].append(node)
        elif node.tag not in _FOREIGN_TAGS:
            hint = nearest(node.tag.lower(), _READ_TAGS)
            node.document.warn(f"<{node.tag}> is not a URDF+ element and is ignored{hint}", node.line)
    return elements


def _unique(nodes: Iterable[Node], read: Callable[[Node], _Named]) -> dict[str, _Named]:
    """Read the elements of one kind into a dictionary by name."""
    found: dict[str, _Named] = {}
    for node in nodes:
        if (name := node.required("name")) in found:
            raise node.error(f"duplicate <{node.tag}> name {name!r}: the first is on line {found[name].line}")
        found[name] = read(node)
    return found


def _reference(node: Node, attribute: str, known: Mapping[str, object], kind: str) -> str:
    """An attribute that must name a known link or joint."""
    name = node.required(attribute)
    if name not in known:
        raise node.error(f"<{node.tag}> names an unknown {kind} {name!r}{nearest(name, known)}")
    return name


def _choice(node: Node, attribute: str, allowed: tuple[str, ...]) -> str:
    value = node.required(attribute)
    if value not in allowed:
        raise node.error(f"unsupported {attribute} {value!r} of {node.label}: it must be one of {', '.join(allowed)}")
    return value


def _non_negative(node: Node, attribute: str, default: float | None = None) -> float:
    value = node.number(attribute, default)
    if value < 0.0:
        raise node.error(f"negative {attribute} {value:g} of <{node.tag}>")
    return value


def _pose(node: Node | None) -> Pose:
    return Pose() if node is None else Pose(node.vector("xyz", _ORIGIN), node.vector("rpy", _ORIGIN))


def _axis(owner: Node) -> Vector3:
    """The unit vector of an element's ``<axis>``."""
    node = owner.at_most_one("axis")
    if node is None:
        return _DEFAULT_AXIS
    axis = node.vector("xyz", _DEFAULT_AXIS)
    largest = max(map(abs, axis))
    if largest < _SHORTEST_AXIS:
        raise node.error(f"{owner.label} has a zero axis {axis}: an axis needs a direction")
    x, y, z = (component / largest for component in axis)  # so that squares neither overflow nor vanish
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


def _colour(node: Node) -> Colour | None:
    """Red, green, blue and opacity of a ``<material>``, or None."""
    if (colour := node.at_most_one("color")) is None:
        return None
    red, green, blue, opacity = colour.parse_numbers(colour.required("rgba"), "rgba", 4)
    if not all(0.0 <= value <= 1.0 for value in (red, green, blue, opacity)):
        colour.document.warn(f"rgba {colour.attributes['rgba']!r} leaves 0..1: the colour is ignored", colour.line)
        return None
    return red, green, blue, opacity


def _named_colours(links: Iterable[Node], materials: Iterable[Node]) -> dict[str, Colour]:
    """Colours by material name: a material may be defined at the root or where it is first used."""
    colours: dict[str, Colour] = {}
    inline = (material for link in links for visual in link.all("visual") for material in visual.all("material"))
    for node in (*materials, *inline):
        name = node.attributes.get("name", "")
        if name and name not in colours and node.children and (colour := _colour(node)) is not None:
            colours[name] = colour
    return colours


def _link(node: Node, colours: Mapping[str, Colour]) -> Link:
    inertial = node.at_most_one("inertial")
    visuals = (_visual(visual, colours) for visual in node.all("visual"))
    return Link(
        name=node.required("name"),
        inertial=None if inertial is None else _inertial(inertial),
        visuals=tuple(visual for visual in visuals if visual is not None),
        line=node.line,
    )


def _inertial(node: Node) -> Inertial:
    inertia = node.exactly_one("inertia")
    return Inertial(
        mass=_non_negative_mass(node.exactly_one("mass")),
        origin=_pose(node.at_most_one("origin")),
        ixx=inertia.number("ixx"),
        ixy=inertia.number("ixy", 0.0),
        ixz=inertia.number("ixz", 0.0),
        iyy=inertia.number("iyy"),
        iyz=inertia.number("iyz", 0.0),
        izz=inertia.number("izz"),
    )


def _non_negative_mass(node: Node) -> float:
    mass = node.number("value")
    if mass < 0.0:
        raise node.error(f"negative mass {mass:g} kg")
    return mass


def _visual(node: Node, colours: Mapping[str, Colour]) -> Visual | None:
    geometry = _geometry(node.exactly_one("geometry"))
    material = node.at_most_one("material")
    colour = None if material is None else _colour(material) or colours.get(material.attributes.get("name", ""))
    return None if geometry is None else Visual(_pose(node.at_most_one("origin")), geometry, colour)


def _geometry(node: Node) -> Geometry | None:
    if len(node.children) != 1:
        raise node.error(f"<geometry> must hold one shape, found {len(node.children)}")
    shape = node.children[0]
    if shape.tag == "box":
        return Geometry("box", shape.parse_numbers(shape.required("size"), "size", 3))
    if shape.tag == "cylinder":
        return Geometry("cylinder", (_non_negative(shape, "radius"), _non_negative(shape, "length")))
    if shape.tag == "sphere":
        return Geometry("sphere", (_non_negative(shape, "radius"),))
    if shape.tag == "mesh":
        return Geometry("mesh", shape.vector("scale", (1.0, 1.0, 1.0)), shape.required("filename"))
    shape.document.warn(f"the visual shape <{shape.tag}> is not drawn: box, cylinder, sphere and mesh are", shape.line)
    return None


def _joint(node: Node, links: Mapping[str, Link]) -> Joint:
    kind = _choice(node, "type", JOINT_TYPES)
    mimic = _mimic(node.at_most_one("mimic"))
    independent = _independent(node)
    if mimic is not None and independent:
        node.document.warn(f'{node.label} mimics {mimic.joint!r}: independent="true" is ignored', node.line)
    dynamics = node.at_most_one("dynamics")
    return Joint(
        name=node.required("name"),
        type=kind,
        parent=_reference(node.exactly_one("parent"), "link", links, "link"),
        child=_reference(node.exactly_one("child"), "link", links, "link"),
        origin=_pose(node.at_most_one("origin")),
        # CAD exporters write "0 0 0" where an axis means nothing.
        axis=_DEFAULT_AXIS if kind in ("fixed", "floating") else _axis(node),
        limits=_limits(node, kind),
        damping=0.0 if dynamics is None else _non_negative(dynamics, "damping", 0.0),
        friction=0.0 if dynamics is None else _non_negative(dynamics, "friction", 0.0),
        independent=kind != "fixed" and mimic is None and independent is not False,
        independent_is_stated=kind != "fixed" and independent is not None,
        mimic=mimic,
        line=node.line,
    )


def _independent(node: Node) -> bool | None:
    """The ``independent`` flag, None where it is not stated."""
    if "independent" not in node.attributes:
        return None
    value = node.attributes["independent"]
    if value.lower() not in ("true", "false"):
        raise node.error(f"independent of {node.label} must be true or false, got {value!r}")
    return value.lower() == "true"


def _mimic(node: Node | None) -> Mimic | None:
    if node is None:
        return None
    return Mimic(node.required("joint"), node.number("multiplier", 1.0), node.number("offset", 0.0))


def _limits(joint: Node, kind: str) -> JointLimits:
    """A joint's limits; a bound that URDF does not apply, or that the file leaves out, is infinite."""
    node = joint.at_most_one("limit")
    if node is None:
        return JointLimits()
    lower, upper = -math.inf, math.inf
    if "lower" in node.attributes or "upper" in node.attributes:
        lower, upper = node.number("lower", 0.0), node.number("upper", 0.0)  # URDF's default of a single missing one
        if lower > upper:
            raise node.error(f"lower limit {lower:g} of {joint.label} exceeds its upper limit {upper:g}")
    if kind not in ("revolute", "prismatic"):
        lower, upper = -math.inf, math.inf
    return JointLimits(lower, upper, _non_negative(node, "effort", math.inf), _non_negative(node, "velocity", math.inf))


def _warn_about_missing_bounds(joints: Iterable[Node]) -> None:
    """One warning for all limits without bounds: by the letter of URDF they would lock their joints at zero."""
    limits = [
        limit
        for joint in joints
        if joint.attributes.get("type") in ("revolute", "prismatic")
        and (limit := joint.at_most_one("limit")) is not None
        if "lower" not in limit.attributes and "upper" not in limit.attributes
    ]
    if limits:
        limits[0].document.warn(
            f"<limit> gives neither lower nor upper, here and at {len(limits) - 1} more joints: read as unlimited",
            limits[0].line,
        )


def _loop(node: Node, links: Mapping[str, Link]) -> Loop:
    kind = _choice(node, "type", LOOP_TYPES)
    predecessor = _loop_end(node.exactly_one("predecessor"), links)
    successor = _loop_end(node.exactly_one("successor"), links)
    if predecessor.link == successor.link:
        raise node.error(f"both ends of {node.label} are on link {predecessor.link!r}")
    if kind not in _LOOPS_WITH_AXIS and node.at_most_one("axis") is not None:
        node.document.warn(f"{node.label} is {kind} and has no axis: its <axis> is ignored", node.line)
    axis = _axis(node) if kind in _LOOPS_WITH_AXIS else None
    return Loop(node.required("name"), kind, predecessor, successor, axis, node.line)


def _loop_end(node: Node, links: Mapping[str, Link]) -> LoopEnd:
    return LoopEnd(_reference(node, "link", links, "link"), _pose(node.at_most_one("origin")))


def _coupling(node: Node, links: Mapping[str, Link]) -> Coupling:
    ratio_node = node.exactly_one("ratio")
    if (ratio := ratio_node.number("value")) == 0.0:
        raise ratio_node.error(f"{node.label} has ratio zero: it would couple nothing")
    return Coupling(
        name=node.required("name"),
        predecessor=_reference(node.exactly_one("predecessor"), "link", links, "link"),
        successor=_reference(node.exactly_one("successor"), "link", links, "link"),
        ratio=ratio,
        line=node.line,
    )


def _moving_joint(node: Node, joints: Mapping[str, Joint]) -> str:
    """A joint reference that needs exactly one coordinate there."""
    joint = joints[_reference(node, "name", joints, "joint")]
    if not joint.is_single_coordinate:
        raise node.error(f"joint {joint.name!r} is {joint.type}: it does not have one coordinate")
    return joint.name


def _transmission(node: Node, joints: Mapping[str, Joint]) -> Transmission:
    """A ROS ``<transmission>``; the reduction stands in ``<actuator>`` or, in old files, beside it."""
    if len(node.all("joint")) > 1 or len(node.all("actuator")) > 1:
        raise node.error(f"{node.label} joins several joints or actuators: only one of each is supported")
    joint = _moving_joint(node.exactly_one("joint"), joints)
    actuator = node.at_most_one("actuator")
    reduction = _text_number(node, actuator, "mechanicalReduction", 1.0)
    if reduction == 0.0:
        raise node.error(f"mechanicalReduction of {node.label} is zero; give the motor turns a joint turn")
    rotor_inertia = _text_number(node, actuator, "rotorInertia", 0.0)
    if rotor_inertia < 0.0:
        raise node.error(f"negative rotorInertia {rotor_inertia:g} kg·m² of {node.label}")
    return Transmission(
        name=node.required("name"),
        joint=joint,
        actuator=joint if actuator is None else actuator.required("name"),
        reduction=reduction,
        rotor_inertia=rotor_inertia,
        line=node.line,
    )


def _text_number(transmission: Node, actuator: Node | None, tag: str, default: float) -> float:
    """The number in an element's text, looked for in the actuator first."""
    node = (actuator and actuator.at_most_one(tag)) or transmission.at_most_one(tag)
    return default if node is None else node.parse_numbers(node.text, "the text", 1)[0]


def _configuration(node: Node, joints: Mapping[str, Joint]) -> Configuration:
    values: dict[str, float] = {}
    for value in node.all("joint"):
        if (name := _moving_joint(value, joints)) in values:
            raise value.error(f"{node.label} gives joint {name!r} two values")
        values[name] = value.number("value")
    return Configuration(node.required("name"), values, node.line)
