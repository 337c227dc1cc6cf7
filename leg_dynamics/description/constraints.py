"""Elements that say where a mechanism may not go: angles between links, telescopes, clearances. An own extension.

    <cone name="ball_3" link="rod_3">                     an axis fixed on one link stays within `upper` of an axis
      <axis xyz="0 0 1"/>                                 fixed on another: a ball joint's range, rad
      <other link="rod_1"><axis xyz="0 1 0"/></other>
      <limit upper="0.6109"/>
    </cone>
    <telescope joint="l2" sleeve="0.31" rod="0.31" overlap="0.02"/>    sleeve + rod - joint coordinate >= overlap, m
    <clearance name="sleeves_1_3" minimum="0.0">          two capsules, each fixed on a link, stay `minimum` apart, m
      <segment link="sleeve_1" from="0 0 0" to="0 0 0.4" radius="0.03"/>
      <segment link="sleeve_3" from="0 0 0" to="0 0 0.4" radius="0.03"/>
    </clearance>

Kinematics and dynamics do not enforce them, as they do not enforce joint limits; the analyses of the workspace do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from leg_dynamics.description.model import Clearance, Cone, Joint, Link, Segment, Telescope, Vector3
from leg_dynamics.description.xml_reader import Node, nearest

__all__ = ["CONSTRAINT_TAGS", "read_clearance", "read_cone", "read_telescopes"]

CONSTRAINT_TAGS = ("cone", "telescope", "clearance")
_SHORTEST_AXIS = 1e-9


def read_cone(node: Node, links: Mapping[str, Link]) -> Cone:
    """A ``<cone>``; links must exist and differ, the limit lie in (0, pi]."""
    other = node.exactly_one("other")
    link, other_link = _link(node, links), _link(other, links)
    if link == other_link:
        raise other.error(f"{node.label} has both axes on link {link!r}: the angle between them cannot change")
    limit = node.exactly_one("limit")
    upper = limit.number("upper")
    if not 0.0 < upper <= math.pi:
        raise limit.error(f"upper of {node.label} is {upper:g} rad: an angle between two axes lies in 0 ... pi")
    return Cone(node.required("name"), link, _axis(node, node), other_link, _axis(other, node), upper, node.line)


def read_telescopes(nodes: list[Node], joints: Mapping[str, Joint]) -> tuple[Telescope, ...]:
    """All ``<telescope>`` elements; each names a prismatic joint, each joint has at most one."""
    found: dict[str, Telescope] = {}
    for node in nodes:
        name = node.required("joint")
        if name not in joints:
            raise node.error(f"<telescope> names an unknown joint {name!r}{nearest(name, joints)}")
        if joints[name].type != "prismatic":
            raise node.error(f"joint {name!r} of <telescope> is {joints[name].type}: only a prismatic one slides")
        if name in found:
            raise node.error(f"joint {name!r} has a second <telescope>: the first is on line {found[name].line}")
        sleeve, rod, overlap = (_length(node, key) for key in ("sleeve", "rod", "overlap"))
        if sleeve + rod <= overlap:
            raise node.error(
                f"the telescope of joint {name!r} can never overlap by {overlap:g} m: sleeve and rod are "
                f"{sleeve + rod:g} m together"
            )
        found[name] = Telescope(name, sleeve, rod, overlap, node.line)
    return tuple(found.values())


def read_clearance(node: Node, links: Mapping[str, Link]) -> Clearance:
    """A ``<clearance>`` of two ``<segment>`` capsules on different links."""
    segments = node.all("segment")
    if len(segments) != 2:
        raise node.error(f"{node.label} has {len(segments)} <segment> elements: a clearance is between two")
    first, second = (_segment(segment, links) for segment in segments)
    if first.link == second.link:
        raise node.error(f"{node.label} has both segments on link {first.link!r}: their distance cannot change")
    return Clearance(node.required("name"), first, second, _length(node, "minimum", 0.0), node.line)


def _segment(node: Node, links: Mapping[str, Link]) -> Segment:
    ends = [node.parse_numbers(node.required(key), key, 3) for key in ("from", "to")]
    (ax, ay, az), (bx, by, bz) = ends
    return Segment(_link(node, links), (ax, ay, az), (bx, by, bz), _length(node, "radius", 0.0))


def _length(node: Node, attribute: str, default: float | None = None) -> float:
    value = node.number(attribute, default)
    if value < 0.0:
        raise node.error(f"{attribute} of {node.label} is {value:g} m: a length is not negative")
    return value


def _link(node: Node, links: Mapping[str, Link]) -> str:
    name = node.required("link")
    if name not in links:
        raise node.error(f"<{node.tag}> names an unknown link {name!r}{nearest(name, links)}")
    return name


def _axis(owner: Node, cone: Node) -> Vector3:
    node = owner.exactly_one("axis")
    x, y, z = node.parse_numbers(node.required("xyz"), "xyz", 3)
    largest = max(abs(x), abs(y), abs(z))
    if largest < _SHORTEST_AXIS:
        raise node.error(f"{cone.label} has a zero axis ({x:g}, {y:g}, {z:g}): an axis needs a direction")
    x, y, z = x / largest, y / largest, z / largest  # so that squares neither overflow nor vanish
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length
