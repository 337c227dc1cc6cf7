"""The robots of the distribution example-robot-data, by name.

It installs files and no Python module: they are found through the distribution's own list of files. Beside the URDF
file of a robot there may be a SRDF file, whose group states are its named poses.
"""

from __future__ import annotations

import functools
import importlib.metadata
import re
from pathlib import Path, PurePosixPath
from xml.sax.saxutils import quoteattr

from leg_dynamics.description.model import Description
from leg_dynamics.description.parse import build
from leg_dynamics.description.xml_reader import Document, Node, nearest, read_root
from leg_dynamics.errors import LegNotFoundError

__all__ = ["PREFIX", "robot_data_file", "robot_data_names", "with_group_states"]

PREFIX = "example-robot-data:"
"""What a name starts with where it could be another thing: ``example-robot-data:solo12``."""

_DISTRIBUTION = "example-robot-data"
_FOLDER = "example-robot-data/robots/"
_HOMES = ("half_sitting", "standing", "reference", "home")
# What the project's own loader calls them, where the file is called otherwise or shares its name.
_ALIASES = {
    "alexander": "alexander_v1.lowerBodyOnly",
    "allegro_left": "allegro_left_hand",
    "allegro_right": "allegro_right_hand",
    "anymal": "anymal_b_simple_description/anymal",
    "anymal_b": "anymal_b_simple_description/anymal",
    "anymal_c": "anymal_c_simple_description/anymal",
    "anymal_kinova": "anymal-kinova",
    "asr_twodof": "TwoDofs",
    "b1_z1": "b1-z1",
    "borinot": "borinot_flying_arm_2",
    "g1": "g1_29dof_rev_1_0",
    "hector": "quadrotor_base",
    "hextilt": "hextilt_flying_arm_5",
    "hyq": "hyq_no_sensors",
    "solo8": "solo",
    "talos": "talos_reduced",
    "talos_arm": "talos_left_arm",
    "talos_box": "talos_reduced_box",
    "talos_full": "talos_full_v2",
    "talos_full_box": "talos_full_v2_box",
    "ur3": "ur3_robot",
    "ur3_limited": "ur3_joint_limited_robot",
    "ur5": "ur5_robot",
    "ur5_limited": "ur5_joint_limited_robot",
    "ur10": "ur10_robot",
    "ur10_limited": "ur10_joint_limited_robot",
}


@functools.cache
def _installed() -> dict[str, Path]:
    """Every file of the distribution below its folder of robots, by its path there with ``/``; empty without it."""
    try:
        distribution = importlib.metadata.distribution(_DISTRIBUTION)
    except importlib.metadata.PackageNotFoundError:
        return {}
    found = {}
    for file in distribution.files or ():
        _, folder, inner = file.as_posix().partition(_FOLDER)
        if folder:
            found[inner] = Path(str(distribution.locate_file(file))).resolve()
    return dict(sorted(found.items()))


@functools.cache
def _robots() -> dict[str, str]:
    """The URDF files: to each full name, FOLDER/STEM, the file's path in the distribution."""
    return {_full_name(inner): inner for inner in _installed() if inner.endswith(".urdf")}


def _full_name(inner: str) -> str:
    path = PurePosixPath(inner)
    return f"{path.parts[0]}/{path.stem}"


@functools.cache
def _by_name() -> dict[str, tuple[str, ...]]:
    """The full names that a name in lower case can mean; an alias means the one that the project's loader takes."""
    meanings: dict[str, tuple[str, ...]] = {}
    for full in _robots():
        meanings[full.lower()] = (full,)
        stem = full.split("/")[1].lower()
        meanings[stem] = (*meanings.get(stem, ()), full)
    aliases = {alias: meanings[target.lower()] for alias, target in _ALIASES.items() if target.lower() in meanings}
    return meanings | aliases


@functools.cache
def robot_data_names() -> tuple[str, ...]:
    """One name for every robot of the installed distribution example-robot-data.

    Returns
    -------
    tuple of str
        Sorted; the stem of the URDF file, or FOLDER/STEM where the stem alone means several files or another one. Empty
        where the distribution is not installed.
    """
    names = []
    for full in _robots():
        stem = full.split("/")[1]
        names.append(stem if _by_name()[stem.lower()] == (full,) else full)
    return tuple(sorted(names, key=str.lower))


def robot_data_file(name: str) -> Path:
    """The URDF file of a robot of example-robot-data.

    Parameters
    ----------
    name : str
        Without regard to case: one of `robot_data_names`, FOLDER/STEM of a file, or a short name of the project's own
        loader, such as ``talos``, ``anymal``, ``hyq`` or ``ur5``. With or without `PREFIX`.

    Returns
    -------
    pathlib.Path
        An existing file.

    Raises
    ------
    LegNotFoundError
        There is no such robot, the name means several, or the distribution is not installed.
    """
    asked = name.removeprefix(PREFIX)
    if not _robots():
        raise LegNotFoundError(
            f"there is no robot {asked[:80]!r}: the distribution {_DISTRIBUTION} is not installed; pip install "
            f"{_DISTRIBUTION}",
            name=asked,
            known=(),
        )
    meanings = _by_name().get(asked.strip().lower(), ())
    if len(meanings) == 1:
        return _installed()[_robots()[meanings[0]]]
    if meanings:
        listed = " or ".join(repr(PREFIX + full) for full in meanings)
        raise LegNotFoundError(
            f"{asked[:80]!r} is the name of {len(meanings)} robots of {_DISTRIBUTION}: say {listed}",
            name=asked,
            known=meanings,
        )
    raise LegNotFoundError(
        f"there is no robot {asked[:80]!r} in {_DISTRIBUTION}{nearest(asked[:80].lower(), _by_name())} (all "
        f"{len(_robots())} names: leg_dynamics.description.robot_data.robot_data_names())",
        name=asked,
        known=robot_data_names(),
    )


def _srdf_of(urdf: Path) -> Path | None:
    """The SRDF file of a robot of the distribution: of the URDF file's name, or the only one of its folder."""
    inner = next((inner for inner in _robots().values() if _installed()[inner] == urdf), None)
    if inner is None:
        return None
    folder = PurePosixPath(inner).parts[0]
    found = {
        PurePosixPath(other).stem: path
        for other, path in _installed().items()
        if other.startswith(f"{folder}/") and other.endswith(".srdf")
    }
    return found.get(urdf.stem, next(iter(found.values())) if len(found) == 1 else None)


def with_group_states(urdf: Path, text: str) -> str:
    """URDF text with the named poses of the SRDF file that belongs to it.

    A URDF file of example-robot-data has the SRDF file of its own name, or the only one in its robot's folder; any
    other file has none. Every ``<group_state>`` becomes a ``<configuration>``: the joints of this file that have one
    coordinate, a mimicking joint where the mimicked one puts it; the others of the SRDF file are left out, for example
    a floating base. The first of half_sitting, standing, reference and home comes first, as the pose that `home` of a
    description is.

    Parameters
    ----------
    urdf : pathlib.Path
        The URDF file.
    text : str
        Its text.

    Returns
    -------
    str
        The same text where there is no pose to add, or the file has configurations of its own.

    Raises
    ------
    DescriptionError
        The text is no mechanism, or the SRDF file is no XML, or has a coordinate that is no number.
    """
    srdf = _srdf_of(urdf.resolve())
    if srdf is None:
        return text
    tree = build(text, Document(str(urdf), quiet=True))
    if tree.configurations:
        return text
    root = read_root(srdf.read_text(encoding="utf-8"), Document(str(srdf)), keep=("group_state",))
    states: dict[str, dict[str, float]] = {}
    for node in root.all("group_state"):
        values = _values(node, tree)
        if values and node.attributes.get("name"):
            states.setdefault(node.attributes["name"], values)
    first = next((name for name in _HOMES if name in states), None)
    configurations = "".join(
        f"<configuration name={quoteattr(name)}>"
        + "".join(f'<joint name={quoteattr(joint)} value="{value!r}"/>' for joint, value in states[name].items())
        + "</configuration>"
        for name in sorted(states, key=lambda name: name != first)
    )
    *_, end = re.finditer(r"</robot\s*>", text)
    return f"{text[: end.start()]}{configurations}{text[end.start() :]}"


def _values(state: Node, tree: Description) -> dict[str, float]:
    """The coordinates that a group state gives to joints of the tree, in the tree's order."""
    given: dict[str, float] = {}
    for node in state.all("joint"):
        if len(node.attributes.get("value", "").split()) == 1:  # several are of a floating base
            given[node.required("name")] = node.number("value")
    mimics = {joint.name: joint.mimic for joint in tree.joints if joint.is_single_coordinate}

    def value_of(joint: str) -> float | None:
        mimic = mimics[joint]
        if mimic is None:
            return given.get(joint)
        value = value_of(mimic.joint)
        return None if value is None else mimic.multiplier * value + mimic.offset

    values = ((joint, value_of(joint)) for joint in mimics)
    return {joint: value for joint, value in values if value is not None}
