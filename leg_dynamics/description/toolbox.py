"""Dialect of toolbox-parallel-robots: plain URDF, and a YAML file beside it that names loops, motors and other joints.

closed_loop: [[frame_a, frame_b], ...]     frames that coincide: names of joints (their child's frame) or of links
type: [6d, 3d, ...]                        whole frames, or their origins only; 6d where there is no list
name_mot: [joint, ...]                     the driven joints, or one text that their names contain
joint_name: [joint, ...]                   joints that the URDF only stands in for ...
joint_type: [SPHERICAL, ...]               ... and what they are: SPHERICAL, FIXED, UJOINT_xy
                                               or CARDAN (both about x, then about y)
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from leg_dynamics.description.lowering import replace_by_chain, turns
from leg_dynamics.description.model import Description, Joint
from leg_dynamics.description.xml_reader import nearest
from leg_dynamics.description.yaml_reader import Entry, compose

__all__ = ["Toolbox", "is_toolbox", "sidecar_of", "toolbox_text"]

_CONTENTS = "closed loops and motors: closed_loop, type, name_mot, joint_name, joint_type"
_KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")
_SUFFIXES = (".yaml", ".yml")
_MARK = re.compile(r"^\s*(closed_loop|name_mot)\s*:", re.MULTILINE)
_LOOP_TYPES = {"3d": "spherical", "6d": "fixed"}
_AXES = {"SPHERICAL": "xyz", "UJOINT_xy": "xy", "CARDAN": "xy", "FIXED": ""}


@dataclass(frozen=True)
class Toolbox:
    """What the YAML file says: pairs of frames and their loop types, motors, and other joints by type."""

    loops: tuple[tuple[str, str, str], ...]
    motors: tuple[str, ...]
    replaced: Mapping[str, str]


def is_toolbox(path: Path) -> bool:
    """Whether a file is such a YAML file, by its name and its keys."""
    if not path.name.endswith(_SUFFIXES):
        return False
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return _MARK.search(file.read(1 << 16)) is not None
    except OSError:
        return False


def sidecar_of(urdf: Path) -> Path | None:
    """The YAML file of the same name beside a URDF file; None where there is none."""
    found = (urdf.with_suffix(suffix) for suffix in _SUFFIXES)
    return next((path for path in found if path.is_file() and is_toolbox(path)), None)


def toolbox_text(sidecar: Path, tree: Description) -> str:
    """URDF+ text of a tree and its YAML file.

    Parameters
    ----------
    sidecar : pathlib.Path
        The YAML file.
    tree : Description
        The URDF file, validated.

    Returns
    -------
    str
        The tree with the joints replaced, ``<loop>`` and ``<transmission>`` added. A spherical or universal joint is a
        chain of revolute ones about the axes of the joint's frame, with massless links between.

    Raises
    ------
    DescriptionError
        The YAML file is wrong, or names what the URDF file does not have; with file and line.
    """
    toolbox = _read(sidecar, tree)
    root = ElementTree.fromstring(tree.urdf)
    joints = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for name, kind in toolbox.replaced.items():
        _replace(root, joints[name], _AXES[kind])
    child = {joint.name: joint.child for joint in tree.joints}
    for number, (first, second, kind) in enumerate(toolbox.loops, 1):
        loop = ElementTree.SubElement(root, "loop", name=f"loop_{number}", type=kind)
        ElementTree.SubElement(loop, "predecessor", link=child.get(first, first))
        ElementTree.SubElement(loop, "successor", link=child.get(second, second))
    for name in toolbox.motors:
        transmission = ElementTree.SubElement(root, "transmission", name=f"transmission_{name}")
        ElementTree.SubElement(transmission, "joint", name=name)
        ElementTree.SubElement(transmission, "actuator", name=name)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _replace(root: ElementTree.Element, joint: ElementTree.Element, axes: str) -> None:
    for tag in ("limit", "mimic", "dynamics"):
        for found in joint.findall(tag):
            joint.remove(found)
    replace_by_chain(root, joint, turns(axes))


def _read(path: Path, tree: Description) -> Toolbox:
    top = Entry(compose(path, _CONTENTS), str(path), "the file")
    sections = top.mapping(_KEYS)
    joints = {joint.name: joint for joint in tree.joints}
    frames = (*joints, *(link.name for link in tree.links))

    def known(entry: Entry, names: Iterable[str], what: str) -> str:
        name, listed = entry.text(), tuple(names)
        if name not in listed:
            raise entry.error(f"{entry.label} names an unknown {what} {name!r}{nearest(name, listed)}", name=name)
        return name

    pairs = sections["closed_loop"].sequence() if "closed_loop" in sections else []
    kinds = sections["type"].sequence() if "type" in sections else []
    if kinds and len(kinds) != len(pairs):
        raise sections["type"].error(f"type has {len(kinds)} entries for {len(pairs)} closed loops: give one each")
    loops = []
    for number, pair in enumerate(pairs):
        first, second = (known(end, frames, "joint or link") for end in pair.sequence(2))
        kind = kinds[number].text().lower() if kinds else "6d"
        if kind not in _LOOP_TYPES:
            raise kinds[number].error(f"{kinds[number].label} must be 3d or 6d, got {kinds[number].shown()}")
        loops.append((first, second, _LOOP_TYPES[kind]))

    names = sections["joint_name"].sequence() if "joint_name" in sections else []
    types = sections["joint_type"].sequence() if "joint_type" in sections else []
    if len(names) != len(types):
        raise sections["joint_name" if "joint_name" in sections else "joint_type"].error(
            f"joint_name has {len(names)} entries and joint_type {len(types)}: give one type a joint"
        )
    replaced = {
        known(name, joints, "joint"): kind.choice(tuple(_AXES)) for name, kind in zip(names, types, strict=True)
    }
    return Toolbox(tuple(loops), _motors(sections.get("name_mot"), joints, replaced, known), replaced)


def _motors(
    entry: Entry | None,
    joints: Mapping[str, Joint],
    replaced: Mapping[str, str],
    known: Callable[[Entry, Iterable[str], str], str],
) -> tuple[str, ...]:
    if entry is None:
        return ()
    moving = [name for name, joint in joints.items() if joint.is_single_coordinate and name not in replaced]
    if entry.node.id == "scalar":
        part = entry.text()
        found = tuple(name for name in moving if part in name)
        if not found:
            raise entry.error(f"no moving joint has {part!r} in its name: give a list of joints")
        return found
    motors = [known(each, joints, "joint") for each in entry.sequence()]
    for each, name in zip(entry.sequence(), motors, strict=True):
        if name not in moving:
            raise each.error(f"{each.label} drives joint {name!r}, which does not have one coordinate", name=name)
    return tuple(motors)
