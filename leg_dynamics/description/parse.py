"""URDF+ text to a validated `Description`: one function an element, then the checks that need the whole file."""

from __future__ import annotations

import gc
import math
import posixpath
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType
from typing import TypeVar
from urllib.parse import unquote

from leg_dynamics.description.constraints import CONSTRAINT_TAGS, read_clearance, read_cone, read_telescopes
from leg_dynamics.description.model import (
    DRIVEN,
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

__all__ = ["build", "driven_joints", "parse"]

_READ_TAGS = frozenset(
    {"link", "joint", "loop", "coupling", "transmission", "configuration", "material", *CONSTRAINT_TAGS}
)
# Other programs' extensions, which say nothing about the mechanism.
_FOREIGN_TAGS = frozenset({"gazebo", "sensor", "ros2_control", "mujoco", "drake", "group", "group_state", "version"})
# Warnings of elements that nobody knows, one a kind.
_MOST_UNKNOWN = 20
_LOOPS_WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")
_DEFAULT_AXIS = (1.0, 0.0, 0.0)
_ORIGIN = (0.0, 0.0, 0.0)
_SHORTEST_AXIS = 1e-9
_MOMENTS = ("ixx", "iyy", "izz")
# The product of a mass and two lengths of that size is still a number.
_LARGEST = 1e100
# rad: beyond, nothing is left of an angle's digits once turns are taken off.
_LARGEST_ANGLE = 1e6
_ANGLES = ("_yaw", "_pitch", "_roll")  # coordinates of joints that have several
_SEVERAL = frozenset(kind for kind in JOINT_TYPES if len(Joint("", kind, "", "").coordinates) > 1)
# Folders that a relative mesh name may climb: a robot's urdf/ lies beside its meshes/, seldom deeper.
_MOST_CLIMBS = 3

_NAMED = 5  # joints that one warning names
# Of `pr2_mechanism`, the format before ROS's transmission_interface.
_OLD_JOINTS = ("flexJoint", "rollJoint", "gap_joint")
_OLD_ACTUATORS = ("leftActuator", "rightActuator")

Colour = tuple[float, float, float, float]
_Named = TypeVar("_Named", Link, Joint, Loop, Coupling, Configuration, Cone, Clearance)


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
    _check_mesh_names(elements["link"], document)
    if not links:
        raise root.error("the file has no <link>")
    joints = _unique(elements["joint"], lambda node: _joint(node, links))
    _warn_about_missing_bounds(elements["joint"])
    _warn_about_fixed_mimics(elements["joint"])
    loops = _unique(elements["loop"], lambda node: _loop(node, links))
    couplings = _unique(elements["coupling"], lambda node: _coupling(node, links))
    transmissions = _transmissions(elements["transmission"], joints, document)
    several = {name: joint for joint in joints.values() if joint.type in _SEVERAL for name in joint.coordinates}
    configurations = _unique(elements["configuration"], lambda node: _configuration(node, joints, several))
    cones = _unique(elements["cone"], lambda node: read_cone(node, links))
    telescopes = read_telescopes(elements["telescope"], joints)
    clearances = _unique(elements["clearance"], lambda node: read_clearance(node, links))
    return Description(
        name=root.required("name"),
        links=tuple(links.values()),
        joints=tuple(joints.values()),
        loops=tuple(loops.values()),
        couplings=tuple(couplings.values()),
        transmissions=transmissions,
        configurations=tuple(configurations.values()),
        urdf=text,
        file=document.file,
        source=document.source,
        parameters=parameters,
        cones=tuple(cones.values()),
        telescopes=telescopes,
        clearances=tuple(clearances.values()),
        driven=_driven(root, transmissions),
    )


def _driven(root: Node, transmissions: Sequence[Transmission]) -> str:
    """What motors drive where there are no transmissions, see `Description`."""
    if "driven" not in root.attributes:
        return DRIVEN[0]
    driven = _choice(root, "driven", DRIVEN)
    if driven == "none" and transmissions:
        raise root.error(
            f'{root.label} states driven="none" and has a transmission on joint {transmissions[0].joint!r}: delete one'
            " of the two"
        )
    return driven


def _sorted_by_tag(root: Node) -> dict[str, list[Node]]:
    """The root's children by tag; a warning for what would be lost in silence."""
    if root.tag != "robot":
        raise root.error(f"the root element is <{root.tag}>, a mechanism file's is <robot>")
    elements: dict[str, list[Node]] = {tag: [] for tag in sorted(_READ_TAGS)}
    unknown: list[Node] = []
    for node in root.children:
        if node.tag in elements:
            elements[node.tag].append(node)
        elif node.tag not in _FOREIGN_TAGS:
            unknown.append(node)
    for node in unknown[:_MOST_UNKNOWN]:
        hint = nearest(node.tag.lower(), _READ_TAGS)
        node.document.warn(f"<{node.tag}> is not a URDF+ element and is ignored{hint}", node.line)
    if more := unknown[_MOST_UNKNOWN:]:
        root.document.warn(f"{len(more)} more kinds of elements are not URDF+ and are ignored", more[0].line)
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
    if node is None:
        return Pose()
    xyz = node.vector("xyz", _ORIGIN)
    _computable(node, "xyz", *xyz)
    return Pose(xyz, node.vector("rpy", _ORIGIN))


def _computable(node: Node, what: str, *values: float) -> None:
    """Refuse lengths, masses and moments whose products are no longer numbers."""
    largest = max(map(abs, values))
    if largest > _LARGEST:
        raise node.error(
            f"{what} of <{node.tag}> is {largest:g}, too large to compute with, the most is {_LARGEST:g}: check the "
            "unit, m, kg or kg·m²"
        )


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
    tensor = [inertia.number(key, None if key in _MOMENTS else 0.0) for key in (*_MOMENTS, "ixy", "ixz", "iyz")]
    _computable(inertia, "a moment", *tensor)
    ixx, iyy, izz, ixy, ixz, iyz = tensor
    return Inertial(
        mass=_non_negative_mass(node.exactly_one("mass")),
        origin=_pose(node.at_most_one("origin")),
        ixx=ixx,
        ixy=ixy,
        ixz=ixz,
        iyy=iyy,
        iyz=iyz,
        izz=izz,
    )


def _non_negative_mass(node: Node) -> float:
    mass = node.number("value")
    _computable(node, "value", mass)
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


def _check_mesh_names(links: Iterable[Node], document: Document) -> None:
    """Refuse names that climb where no mesh of a robot lies; one warning for those that only this machine may have."""
    shapes = (shape for link in links for tag in ("visual", "collision") for shape in link.all(tag))
    meshes = (mesh for shape in shapes for geometry in shape.all("geometry") for mesh in geometry.all("mesh"))
    fixed: list[Node] = []
    folder = posixpath.dirname(document.file.replace("\\", "/"))
    for mesh in meshes:
        name = mesh.attributes.get("filename", "")
        scheme, colon, place = name.partition("://")
        if not colon:
            scheme, place = "", name
        elif scheme in ("package", "file"):
            place = unquote(place)
        place = place.replace("\\", "/")
        if scheme == "package":  # of any name or, as CAD exporters write, of none
            place = place.partition("/")[2].lstrip("/")
        place = posixpath.normpath(place)
        if scheme == "package" and place.split("/")[0] == "..":
            raise mesh.error(
                f"mesh {name[:80]!r} leaves its package: write package://NAME/PATH with a path inside the package"
            )
        if scheme not in ("", "file"):
            continue
        climbs = place.split("/").count("..")
        if climbs > _MOST_CLIMBS:
            raise mesh.error(
                f"mesh {name[:80]!r} climbs {climbs} folders, the most is {_MOST_CLIMBS}: put the meshes into a folder "
                "beside the file's, or name them by package://"
            )
        if (scheme or place.startswith("/")) and not (folder and place.startswith(f"{folder}/")):
            fixed.append(mesh)
    if fixed:
        document.warn(
            f"mesh {fixed[0].attributes['filename'][:80]!r} and {len(fixed) - 1} more lie at absolute paths outside "
            "the file's folder, which other machines do not have: name them by package://, or relative to the file",
            fixed[0].line,
        )


def _joint(node: Node, links: Mapping[str, Link]) -> Joint:
    kind = _choice(node, "type", JOINT_TYPES)
    # A fixed joint has no coordinate to mimic with.
    mimic = None if kind == "fixed" else _mimic(node.at_most_one("mimic"), kind)
    independent = _flag(node, "independent")
    if mimic is not None and independent:
        node.document.warn(f'{node.label} mimics {mimic.joint!r}: independent="true" is ignored', node.line)
    driven = _flag(node, "driven")
    several = kind in _SEVERAL
    if several and driven:
        node.document.warn(f'{node.label} is {kind}, which no motor drives: driven="true" is ignored', node.line)
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
        armature=0.0 if dynamics is None else _non_negative(dynamics, "armature", 0.0),
        driven=not several and driven is not False,
    )


def _flag(node: Node, attribute: str) -> bool | None:
    """The ``independent`` or ``driven`` flag of a joint, None where it is not stated."""
    if attribute not in node.attributes:
        return None
    value = node.attributes[attribute]
    if value.lower() not in ("true", "false"):
        raise node.error(f"{attribute} of {node.label} must be true or false, got {value[:80]!r}")
    return value.lower() == "true"


def _mimic(node: Node | None, kind: str) -> Mimic | None:
    if node is None:
        return None
    multiplier, offset = node.number("multiplier", 1.0), node.number("offset", 0.0)
    _computable(node, "multiplier", multiplier)
    most, unit = (_LARGEST, "m") if kind == "prismatic" else (_LARGEST_ANGLE, "rad")
    if abs(offset) > most:
        raise node.error(
            f"offset of <mimic> is {offset:g} {unit}, too large to compute with, the most is {most:g} {unit}: "
            "check the unit"
        )
    return Mimic(node.required("joint"), multiplier, offset)


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
    effort, velocity = _non_negative(node, "effort", math.inf), _non_negative(node, "velocity", math.inf)
    effort_lower = node.number("effort_lower", 0.0 - effort)
    if effort_lower > 0.0:
        raise node.error(
            f"positive effort_lower {effort_lower:g} of <limit>: it is the end of the negative efforts, at most 0; "
            "without it efforts are limited alike both ways"
        )
    return JointLimits(lower, upper, effort, velocity, effort_lower + 0.0)  # no negative zero


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


def _warn_about_fixed_mimics(joints: Iterable[Node]) -> None:
    """One warning for all fixed joints that say they mimic another."""
    fixed = [
        joint for joint in joints if joint.attributes.get("type") == "fixed" and joint.at_most_one("mimic") is not None
    ]
    if fixed:
        fixed[0].document.warn(
            f"{fixed[0].label} is fixed and has a <mimic>, as have {len(fixed) - 1} more joints: ignored, they do not "
            "move",
            fixed[0].line,
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


def _transmissions(nodes: Iterable[Node], joints: Mapping[str, Joint], document: Document) -> tuple[Transmission, ...]:
    """The actuators. Of a drive that joins several joints and motors, the file does not say enough: its joints."""
    lines: dict[str, int] = {}
    found: list[Transmission] = []
    idle: list[Node] = []
    joined: list[Node] = []
    for node in nodes:
        if (name := node.required("name")) in lines:
            raise node.error(f"duplicate <transmission> name {name!r}: the first is on line {lines[name]}")
        lines[name] = node.line
        driven, motors = driven_joints(node), _either(node, "actuator", _OLD_ACTUATORS)
        if driven and all(_stands_still(each, joints) for each in driven):
            idle.append(node)
        elif driven and len(driven) == len(motors) and (len(driven) > 1 or not node.all("joint")):
            found += _joined(node, driven, joints)
            joined.append(node)
        else:
            found.append(_transmission(node, joints))
    if idle:
        if not found:  # no motor in the whole file: a wrong name, rather than a part of a robot
            _moving_joint(driven_joints(idle[0])[0], joints)
        names = [each.required("name") for node in idle for each in driven_joints(node)]
        shown = ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
        document.warn(
            f"{_counted(idle, 'is', 'are')} for joints that are fixed or not in the file ({shown}): ignored",
            idle[0].line,
        )
    if joined:
        document.warn(
            f"{_counted(joined, 'does', 'do')} not join one motor to one joint by a gear ratio: read as an actuator of "
            "the joint's own name on each joint, with efforts at the joints, not at the motors",
            joined[0].line,
        )
    return _apart(found, document)


def driven_joints(node: Node) -> list[Node]:
    """The elements of a ``<transmission>`` that name its joints."""
    return _either(node, "joint", _OLD_JOINTS)


def _either(node: Node, tag: str, old_tags: tuple[str, ...]) -> list[Node]:
    """The children of a tag, or else of the tags that stood for it in old files."""
    return node.all(tag) or [child for child in node.children if child.tag in old_tags]


def _stands_still(node: Node, joints: Mapping[str, Joint]) -> bool:
    """Whether a joint reference is to a fixed joint, or to one of a larger robot that this file is a part of."""
    name = node.required("name")
    return name not in joints or joints[name].type == "fixed"


def _counted(nodes: Sequence[Node], one: str, several: str) -> str:
    """The first of some elements, how many more there are, and the verb that fits."""
    return f"{nodes[0].label} {one}" if len(nodes) == 1 else f"{nodes[0].label} and {len(nodes) - 1} more {several}"


def _joined(node: Node, driven: Iterable[Node], joints: Mapping[str, Joint]) -> list[Transmission]:
    """The joints of a drive that joins several, each with an effort of its own."""
    for each in (node, *node.children):
        rotor = each.at_most_one("rotorInertia")
        if rotor is not None and rotor.parse_numbers(rotor.text, "the text", 1)[0] != 0.0:
            raise rotor.error(
                f"{node.label} joins several joints and has a rotorInertia: a rotor that several joints turn is not "
                "supported; leave its inertia out, or give each joint a transmission of its own"
            )
    names = [_moving_joint(each, joints) for each in driven]
    return [Transmission(f"{node.required('name')}_{name}", name, name, line=node.line) for name in names]


def _apart(transmissions: list[Transmission], document: Document) -> tuple[Transmission, ...]:
    """Joints that share a motor become actuators of their own: what joins them is not in the file."""
    joints: dict[str, set[str]] = {}
    for each in transmissions:
        joints.setdefault(each.actuator, set()).add(each.joint)
    shared = [name for name, driven in joints.items() if len(driven) > 1]
    if shared:
        line = next(each.line for each in transmissions if each.actuator in shared)
        more = f" and {len(shared) - 1} more each have" if len(shared) > 1 else " has"
        document.warn(
            f"actuator {shared[0]!r}{more} transmissions to several joints ({', '.join(sorted(joints[shared[0]]))}), "
            "and the file does not say how they share it: read as one actuator of the joint's own name on each joint",
            line,
        )
    return tuple(replace(each, actuator=each.joint) if each.actuator in shared else each for each in transmissions)


def _transmission(node: Node, joints: Mapping[str, Joint]) -> Transmission:
    """A ROS ``<transmission>``; the reduction stands in ``<actuator>`` or, in old files, beside it."""
    counts = len(node.all("joint")), len(node.all("actuator"))
    if max(counts) > 1:
        raise node.error(
            f"{node.label} joins {counts[0]} joints and {counts[1]} actuators: only one of each, or as many actuators "
            "as joints, is supported"
        )
    joint = _moving_joint(node.exactly_one("joint"), joints)
    actuator = node.at_most_one("actuator")
    reduction = _text_number(node, actuator, "mechanicalReduction", 1.0)
    if reduction == 0.0:
        raise node.error(f"mechanicalReduction of {node.label} is zero; give the motor turns a joint turn")
    rotor_inertia = _text_number(node, actuator, "rotorInertia", 0.0)
    if rotor_inertia < 0.0:
        raise node.error(f"negative rotorInertia {rotor_inertia:g} kg·m² of {node.label}")
    stall_torque = _text_number(node, actuator, "stallTorque", math.inf)
    no_load_speed = _text_number(node, actuator, "noLoadSpeed", math.inf)
    for tag, value in (("stallTorque", stall_torque), ("noLoadSpeed", no_load_speed)):
        if not value > 0.0:
            raise node.error(f"{tag} {value:g} of {node.label} must be positive: it is an end of the torque-speed line")
    if math.isinf(stall_torque) != math.isinf(no_load_speed):
        raise node.error(
            f"{node.label} has only one of stallTorque (N·m) and noLoadSpeed (rad/s): the torque-speed line needs both"
        )
    return Transmission(
        name=node.required("name"),
        joint=joint,
        actuator=joint if actuator is None else actuator.required("name"),
        reduction=reduction,
        rotor_inertia=rotor_inertia,
        line=node.line,
        stall_torque=stall_torque,
        no_load_speed=no_load_speed,
    )


def _text_number(transmission: Node, actuator: Node | None, tag: str, default: float) -> float:
    """The number in an element's text, looked for in the actuator first."""
    node = (actuator and actuator.at_most_one(tag)) or transmission.at_most_one(tag)
    return default if node is None else node.parse_numbers(node.text, "the text", 1)[0]


def _configuration(node: Node, joints: Mapping[str, Joint], several: Mapping[str, Joint]) -> Configuration:
    """A named pose; joints of several coordinates, by the names of these in `several`, have a value for each."""
    values: dict[str, float] = {}
    for value in node.all("joint"):
        name = value.required("name")
        if name in joints and joints[name].type in _SEVERAL:
            raise value.error(
                f"joint {name!r} is {joints[name].type}: give its coordinates {', '.join(joints[name].coordinates)}"
            )
        if name in joints or name not in several:
            name = _moving_joint(value, joints)
        if name in values:
            raise value.error(f"{node.label} gives joint {name!r} two values")
        values[name] = value.number("value")
        slides = joints[name].type == "prismatic" if name in joints else not name.endswith(_ANGLES)
        most, unit = (_LARGEST, "m") if slides else (_LARGEST_ANGLE, "rad")
        if abs(values[name]) > most:
            raise value.error(
                f"{node.label} has joint {name!r} at {values[name]:g} {unit}, too large to compute with, the most is "
                f"{most:g} {unit}: check the unit"
            )
    return Configuration(node.required("name"), values, node.line)
