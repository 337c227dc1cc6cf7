"""Dialect of toolbox-parallel-robots: plain URDF, and a YAML file beside it that names loops, motors and other joints.

closed_loop: [[frame_a, frame_b], ...]     frames that coincide: names of joints (their child's frame) or of links
type: [6d, 3d, ...]                        whole frames, or their origins only; 6d where there is no list
name_mot: [joint, ...]                     the driven joints, or one text that their names contain
joint_name: [joint, ...]                   joints that the URDF only stands in for ...
joint_type: [SPHERICAL, ...]               ... and what they are: SPHERICAL, FIXED, UJOINT_xy
                                               or CARDAN (both about x, then about y)

Two more keys say what that file cannot and the URDF file neither, as it does not know the joints of a chain:

home: {joint: value, ...}                  a closed pose, rad or m, before any of the URDF's configurations
independent: [joint, ...]                  the independent joints, instead of the URDF's flags
"""

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from leg_dynamics.description.lowering import replace_by_chain, turns
from leg_dynamics.description.model import Description, Joint
from leg_dynamics.description.poses import set_home
from leg_dynamics.description.xml_reader import Document, nearest
from leg_dynamics.description.yaml_reader import Entry, compose

__all__ = ["Toolbox", "chain_links", "is_sidecar", "is_toolbox", "sidecar_behind", "sidecar_of", "toolbox_text"]

_CONTENTS = "closed loops and motors: closed_loop, type, name_mot, joint_name, joint_type"
_KEYS = ("closed_loop", "type", "name_mot", "joint_name", "joint_type")
# Not the toolbox's own: they do not tell that a file is of this kind.
_MORE_KEYS = ("home", "independent")
_OWN_KEYS = ("closed_loop", "name_mot", "joint_name", "joint_type")  # which no other kind of file has
_SUFFIXES = (".yaml", ".yml")
_MARK = re.compile(r"^\s*(closed_loop|name_mot)\s*:", re.MULTILINE)
_LOOP_TYPES = {"3d": "spherical", "6d": "fixed"}
_AXES = {"SPHERICAL": "xyz", "UJOINT_xy": "xy", "CARDAN": "xy", "FIXED": ""}


@dataclass(frozen=True)
class Toolbox:
    """What the YAML file says: pairs of frames and their loop types, motors, other joints by type, a pose, flags.

    `home` and `independent` are empty where the file has none.
    """

    loops: tuple[tuple[str, str, str], ...]
    motors: tuple[str, ...]
    replaced: Mapping[str, str]
    home: Mapping[str, float]
    independent: tuple[str, ...]


def is_toolbox(path: Path) -> bool:
    """Whether a file is such a YAML file, by its name and the beginning of its text."""
    if not (path.name.endswith(_SUFFIXES) and path.is_file()):
        return False
    try:
        with path.open("rb") as file:
            head = file.read(1 << 16)
    except OSError:
        return False
    wide = head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return _MARK.search(head.decode("utf-16" if wide else "utf-8", errors="replace")) is not None


def sidecar_of(urdf: Path) -> Path | None:
    """The YAML file of the same name beside a URDF file that has no loops or motors of its own; None without one.

    Raises
    ------
    DescriptionError
        What lies there is no readable mapping: the file may have been the sidecar, before it was damaged.

    Warns
    -----
    LegDynamicsWarning
        It is a mapping of something else, and not used.
    """
    beside = [path for path in (urdf.with_suffix(suffix) for suffix in _SUFFIXES) if os.path.lexists(path)]
    found = next((path for path in beside if is_sidecar(path)), None)
    if beside and found is None:
        Document(str(beside[0])).warn(
            f"the file is not used: it has none of the keys {', '.join(_OWN_KEYS)}, and {urdf.name} beside it is read "
            "without loops; rename it if it has nothing to do with that file",
            1,
        )
    return found


def is_sidecar(path: Path) -> bool:
    """As `is_toolbox`, of the whole file: whether it has a key of this dialect, be it in the wrong place.

    Raises
    ------
    DescriptionError
        It is no readable mapping.
    """
    if is_toolbox(path):
        return True
    if not path.is_file():
        reason = "it is no regular file" if path.exists() else "no such file"
        raise Document(str(path)).error(
            f"the file cannot be read: {reason}; it should hold {_CONTENTS}, or have another name"
        )
    top = Entry(compose(path, _CONTENTS), str(path), "the file")
    top.mapping()
    pending, seen = [top.node], set()
    while pending:
        node = pending.pop()
        if id(node) in seen or node.id == "scalar":  # aliases are one node
            continue
        seen.add(id(node))
        if node.id == "mapping":
            if any(key.value in _OWN_KEYS for key, _ in node.value if key.id == "scalar"):
                return True
            pending += [value for _, value in node.value]
        else:
            pending += node.value
    keys = {str(key.value) for key, _ in top.node.value}
    return bool(keys & {*_KEYS}) and keys <= {*_KEYS, *_MORE_KEYS}


def sidecar_behind(description: Description) -> Path | None:
    """The YAML file that a description was read with; None where there was none."""
    urdf, joined, name = description.file.rpartition(" with ")
    path = Path(urdf).parent / name
    beside = joined and path.name == name and path.suffix in _SUFFIXES and path.stem == Path(urdf).stem
    return path if beside and path.is_file() else None


def chain_links(sidecar: Path) -> frozenset[str]:
    """Names of the massless links between the joints of the chains that a YAML file asks for.

    Parameters
    ----------
    sidecar : pathlib.Path
        A YAML file that `toolbox_text` takes.
    """
    sections = Entry(compose(sidecar, _CONTENTS), str(sidecar), "the file").mapping((*_KEYS, *_MORE_KEYS))
    return frozenset(
        f"{name}{step.suffix}_link"
        for name, kind in _replaced(sections, Entry.text).items()
        for step in turns(_AXES[kind])[:-1]
    )


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
        The tree with the joints replaced, ``<loop>``, ``<transmission>``, home and flags added. A spherical or
        universal joint is a chain of revolute ones about the axes of the joint's frame, with massless links between;
        joints of a chain are called JOINT_x, JOINT_y, JOINT_z.

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
    if toolbox.independent:
        for joint in root.findall("joint"):
            joint.set("independent", "true" if joint.get("name") in toolbox.independent else "false")
    if toolbox.home:
        set_home(root, toolbox.home)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _replace(root: ElementTree.Element, joint: ElementTree.Element, axes: str) -> None:
    for tag in ("limit", "mimic", "dynamics"):
        for found in joint.findall(tag):
            joint.remove(found)
    replace_by_chain(root, joint, turns(axes))


def _read(path: Path, tree: Description) -> Toolbox:
    top = Entry(compose(path, _CONTENTS), str(path), "the file")
    sections = top.mapping((*_KEYS, *_MORE_KEYS))
    joints = {joint.name: joint for joint in tree.joints}
    frames = (*joints, *(link.name for link in tree.links))

    def known(entry: Entry, names: Iterable[str], what: str) -> str:
        name, listed = entry.text(), tuple(names)
        if name not in listed:
            raise entry.error(f"{entry.label} names an unknown {what} {name!r}{nearest(name, listed)}", name=name)
        return name

    pairs = sections["closed_loop"].sequence() if "closed_loop" in sections else []
    kinds = sections["type"].sequence() if "type" in sections else []
    if "type" in sections and len(kinds) != len(pairs):
        raise sections["type"].error(f"type has {len(kinds)} entries for {len(pairs)} closed loops: give one each")
    loops = []
    for number, pair in enumerate(pairs):
        first, second = (known(end, frames, "joint or link") for end in pair.sequence(2))
        kind = kinds[number].text().lower() if kinds else "6d"
        if kind not in _LOOP_TYPES:
            raise kinds[number].error(f"{kinds[number].label} must be 3d or 6d, got {kinds[number].shown()}")
        loops.append((first, second, _LOOP_TYPES[kind]))

    replaced = _replaced(sections, lambda entry: known(entry, joints, "joint"))
    for pose in tree.configurations:
        for name in pose.values:
            if name in replaced:
                raise sections["joint_name"].error(
                    f"configuration {pose.name!r} of {tree.file} gives joint {name!r}, which joint_name replaces: give "
                    "the pose as home in this file, and delete it there",
                    name=name,
                )
    moving = _moving(joints, replaced)
    coordinates = [name for joint in moving.values() for name in joint.coordinates]
    given = sections["home"].mapping() if "home" in sections else {}
    for name, value in given.items():
        if name not in coordinates:
            raise value.error(f"home gives an unknown joint {name!r}{nearest(name, coordinates)}", name=name)
    return Toolbox(
        tuple(loops),
        _motors(sections.get("name_mot"), joints, replaced, known),
        replaced,
        {name: value.number() for name, value in given.items()},
        _independent(sections.get("independent"), moving, known),
    )


def _replaced(sections: Mapping[str, Entry], name_of: Callable[[Entry], str]) -> dict[str, str]:
    """The other joints and what they are."""
    names = sections["joint_name"].sequence() if "joint_name" in sections else []
    types = sections["joint_type"].sequence() if "joint_type" in sections else []
    if len(names) != len(types):
        raise sections["joint_name" if "joint_name" in sections else "joint_type"].error(
            f"joint_name has {len(names)} entries and joint_type {len(types)}: give one type a joint"
        )
    return {name_of(name): kind.choice(tuple(_AXES)) for name, kind in zip(names, types, strict=True)}


def _moving(joints: Mapping[str, Joint], replaced: Mapping[str, str]) -> dict[str, Joint]:
    """The moving joints that there will be."""
    found: dict[str, Joint] = {}
    for name, joint in joints.items():
        if name in replaced:
            chain = (f"{name}{step.suffix}" for step in turns(_AXES[replaced[name]]))
            found |= {each: Joint(each, "continuous", "", "") for each in chain}
        elif joint.type != "fixed":
            found[name] = joint
    return found


def _independent(
    entry: Entry | None, moving: Mapping[str, Joint], known: Callable[[Entry, Iterable[str], str], str]
) -> tuple[str, ...]:
    if entry is None:
        return ()
    able = [name for name, joint in moving.items() if joint.mimic is None]
    names = tuple(known(each, able, "joint") for each in entry.sequence())
    if not names:
        raise entry.error("independent names no joint: name those that the mechanism moves by, or delete it")
    return names


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
