"""Robots of identical 3-DOF modules as data: a YAML graph of modules and face-to-face bonds, read and checked.

A module has three faces, L, U and S, and three joints, lower, middle and upper: xacro/common/module.xacro says how it
is built. An assembly names its modules, the bonds between their faces, where the base is, hips and feet, and which
joints are frozen. Its file is plain data: reading one runs no code from it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from leg_dynamics.description.xml_reader import nearest
from leg_dynamics.description.yaml_reader import Entry, compose
from leg_dynamics.errors import DescriptionError

__all__ = [
    "BODIES",
    "FACES",
    "GENDERS",
    "JOINTS",
    "Assembly",
    "Bond",
    "Face",
    "Module",
    "ModuleJoint",
    "Mount",
    "Root",
    "is_assembly",
    "read_assembly",
]

FACES = ("L", "U", "S")
GENDERS = ("active", "passive", "none")
JOINTS = ("lower", "middle", "upper")
BODIES = ("lower_bracket", "lower_half", "upper_half", "upper_bracket")
_SUFFIXES = (".yaml", ".yml")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
# Of the paper's modules in general (section 1.1); a third face is fitted where the file says so.
_USUAL_GENDERS = {"L": "passive", "U": "active", "S": "none"}
_ROLLS = (0, 90, 180, 270)
_OWN_LINKS = ("base", "world", "ground_face")


class Face(NamedTuple):
    """One face of one module: ``m07.U``."""

    module: str
    face: str

    def __str__(self) -> str:
        return f"{self.module}.{self.face}"

    @property
    def link(self) -> str:
        """Name of the link that is the face's frame."""
        return f"{self.module}_face_{self.face}"


@dataclass(frozen=True)
class Module:
    """A module: the gender of each face, and its own mass in kg where it has one."""

    name: str
    genders: Mapping[str, str] = field(hash=False)
    mass: float | None = None
    line: int | None = None


@dataclass(frozen=True)
class Bond:
    """Two faces latched onto each other.

    `roll` (deg) turns the second about the first one's outward normal; at 0 the modules' z axes agree. It is the same
    number seen from the other side. `ring` says that the bond closes a ring.
    """

    first: Face
    second: Face
    roll: int = 0
    ring: bool = False
    line: int | None = None


@dataclass(frozen=True)
class Root:
    """Where the base is.

    A fixed base is bolted to `face` like a bond, `rpy` (deg) turning the ground's face in the base, or sits in the
    middle of a module (`face` is None), whose frame it then turns. A floating base is the frame of `face`, or that
    middle.
    """

    module: str
    face: str | None
    floating: bool
    roll: int = 0
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    line: int | None = None

    @property
    def bolted(self) -> bool:
        """Whether the ground takes the face."""
        return self.face is not None and not self.floating


@dataclass(frozen=True)
class ModuleJoint:
    """A joint of a module: its name in the mechanism, `angle` (deg) at home and while frozen, own `limits` (deg)."""

    name: str
    module: str
    kind: str
    angle: float = 0.0
    frozen: bool = False
    limits: tuple[float, float] | None = None


class Mount(NamedTuple):
    """How a module hangs in the tree: by which face, on which face of which parent, at which roll (deg).

    `face` is S too where the root is the module's middle. `parent` is None at the root.
    """

    module: str
    face: str
    parent: Face | None
    roll: int


@dataclass(frozen=True)
class Assembly:
    """A checked assembly; build one with `read_assembly`."""

    name: str
    file: str
    modules: Mapping[str, Module]
    bonds: tuple[Bond, ...]
    root: Root
    hips: Mapping[str, Face]
    feet: Mapping[str, Face]
    joints: tuple[ModuleJoint, ...]
    parameters: Mapping[str, float]

    @property
    def rings(self) -> tuple[Bond, ...]:
        """The bonds that close rings."""
        return tuple(bond for bond in self.bonds if bond.ring)

    @cached_property
    def mounts(self) -> tuple[Mount, ...]:
        """The modules as a tree, depth first from the root, branches in the bonds' order."""
        ordered = [Mount(self.root.module, self.root.face or "S", None, self.root.roll)]
        pending = self._branches(ordered[0])
        while pending:
            mount = pending.pop()
            ordered.append(mount)
            pending.extend(self._branches(mount))
        return tuple(ordered)

    def _branches(self, mount: Mount) -> list[Mount]:
        """The mounts of the modules bonded to a mounted one, last first."""
        found = []
        for bond in self.bonds:
            for here, there in ((bond.first, bond.second), (bond.second, bond.first)):
                came_from = mount.parent is not None and here == Face(mount.module, mount.face)
                if here.module == mount.module and not bond.ring and not came_from:
                    found.append(Mount(there.module, there.face, here, bond.roll))
        return found[::-1]

    def joint(self, module: str, kind: str) -> ModuleJoint:
        """A module's joint, by kind: lower, middle or upper."""
        return self._joints[module, kind]

    @cached_property
    def _joints(self) -> dict[tuple[str, str], ModuleJoint]:
        return {(joint.module, joint.kind): joint for joint in self.joints}


def is_assembly(path: Path) -> bool:
    """Whether a file's name is that of an assembly."""
    return path.name.endswith(_SUFFIXES)


def read_assembly(path: Path) -> Assembly:
    """Read and check an assembly.

    Parameters
    ----------
    path : pathlib.Path
        A YAML file; angles in deg, masses in kg. A face is written ``MODULE.FACE``, such as ``m07.U``; a joint
        ``MODULE_lower``, ``MODULE_middle`` or ``MODULE_upper``, unless ``joint_names`` gives it another name. Its keys:

        modules
            By name: the genders of its faces ``L``, ``U`` and ``S`` where they are not passive, active and none, and
            its ``mass`` where it is not ``module_mass``.
        bonds
            Each with its two ``faces``, its ``roll`` (0, 90, 180 or 270, default 0), and ``ring: true`` where it closes
            a ring.
        root
            ``base: fixed`` or ``floating``, and what it holds: see `Root`.
        hips, feet
            Names of frames, and the faces they belong to: a hip where the tree enters a module, half a ball of rubber
            on a free face.
        joint_names
            New names of joints, and what they are called otherwise.
        frozen, home
            Angles of joints: of those that are fixed, and of the others in the configuration ``home`` (default 0).
        limits
            Lower and upper limit of joints that differ from the module's.
        parameters
            Values that differ from xacro/common/module_parameters.yaml, and of the switches.

        ``modules`` and ``root`` are required.

    Returns
    -------
    Assembly

    Raises
    ------
    DescriptionError
        At the first thing that cannot be true, with file and line; where it is about a module or a face, `module` and
        `face` name them.

    Examples
    --------
    A module on the ground that carries another one, turned by a quarter::

        modules:
          low: {}
          high: {S: passive, mass: 1.5}
        bonds:
          - {faces: [low.U, high.L], roll: 90}
        root: {face: low.L, base: fixed}
        home: {low_upper: 20}
    """
    top = _Entry(compose(path, "an assembly: modules and a root"), str(path), "the file")
    sections = top.mapping(
        (
            "modules",
            "bonds",
            "root",
            "hips",
            "feet",
            "joint_names",
            "frozen",
            "limits",
            "home",
            "parameters",
        ),
        required=("modules", "root"),
    )
    name = path.name.rpartition(".")[0]
    if not _FILE_NAME.fullmatch(name):
        raise top.error(
            f"the file name {path.name!r} cannot name a robot: letters, digits, _, - and . before the suffix, a letter "
            "or a digit first"
        )
    modules = _modules(sections["modules"])
    listed = sections["bonds"].sequence() if "bonds" in sections else ()
    bonds = tuple(_bond(entry, modules) for entry in listed)
    root = _root(sections["root"], modules)
    hips = _places(sections.get("hips"), modules)
    feet = _places(sections.get("feet"), modules)
    used = _faces_in_use(bonds, root, feet, modules, top)
    _check_graph(bonds, modules, root, top)
    joints = _joints(sections, modules)
    assembly = Assembly(
        name=name,
        file=str(path),
        modules=modules,
        bonds=bonds,
        root=root,
        hips={hip: face for hip, (face, _) in hips.items()},
        feet={foot: face for foot, (face, _) in feet.items()},
        joints=joints,
        parameters={} if "parameters" not in sections else _numbers(sections["parameters"]),
    )
    _check_hips(assembly, hips, used)
    _check_names(assembly, top)
    return assembly


class _Entry(Entry):
    """A node of an assembly."""

    def identifier(self, what: str) -> str:
        """A text that can be part of the names of links and joints."""
        name = self.text()
        if not _NAME.fullmatch(name):
            raise self.error(f"{name!r} cannot name {what}: letters, digits and _ only, a letter first", name=name)
        return name

    def roll(self) -> int:
        roll = self.number()
        if roll not in _ROLLS:
            shown = ", ".join(map(str, _ROLLS))
            raise self.error(f"{self.label} must be one of {shown} deg, a quarter turn, got {roll:g}")
        return int(roll)

    def face(self, modules: Mapping[str, Module]) -> Face:
        text = self.text()
        module, _, letter = text.rpartition(".")
        if not module:
            raise self.error(f"{self.label} must be MODULE.FACE, such as m01.U, got {text!r}")
        if module not in modules:
            hint = nearest(module, modules)
            raise self.error(f"{self.label} names an unknown module {module!r}{hint}", module=module, face=letter)
        if letter not in FACES:
            raise self.error(
                f"{self.label} names an unknown face {letter!r} of module {module!r}: it has {', '.join(FACES)}",
                module=module,
                face=letter,
            )
        return Face(module, letter)


def _modules(entry: _Entry) -> dict[str, Module]:
    modules: dict[str, Module] = {}
    for key_node, _ in entry.node.value if entry.node.id == "mapping" else ():
        _Entry(key_node, entry.file, "the name of a module").identifier("a module")
    for name, module in entry.mapping().items():
        for key_node, _ in module.node.value if module.node.id == "mapping" else ():
            letter = key_node.value
            # Faces are letters; a longer key is another misspelling.
            if key_node.id == "scalar" and len(letter) == 1 and letter not in FACES:
                raise _Entry(key_node, entry.file, letter).error(
                    f"{module.label} names an unknown face {letter!r} of module {name!r}: it has {', '.join(FACES)}",
                    module=name,
                    face=letter,
                )
        values = module.about(module=name, face=None).mapping((*FACES, "mass"))
        genders = dict(_USUAL_GENDERS)
        for face in FACES:
            if face in values:
                genders[face] = values[face].about(face=face).choice(GENDERS)
        mass = values["mass"].number() if "mass" in values else None
        if mass is not None and not mass > 0.0:
            raise values["mass"].error(f"the mass of module {name!r} must be positive, got {mass:g} kg", module=name)
        modules[name] = Module(name, genders, mass, module.line)
    if not modules:
        raise entry.error("there is no module: an assembly has at least one")
    return modules


def _bond(entry: _Entry, modules: Mapping[str, Module]) -> Bond:
    values = entry.mapping(("faces", "roll", "ring"), required=("faces",))
    first, second = (each.face(modules) for each in values["faces"].sequence(2))
    evidence = {"module": first.module, "face": first.face, "other": str(second)}
    if first.module == second.module:
        raise entry.error(f"a bond joins {first} and {second}, two faces of one module {first.module!r}", **evidence)
    genders = [modules[each.module].genders[each.face] for each in (first, second)]
    for face, other, gender in zip((first, second), (second, first), genders, strict=True):
        if gender == "none":
            raise entry.error(
                f"module {face.module!r} has no face {face.face}, which its bond with {other} needs: fit one with "
                f"{face.module}: {{{face.face}: active}} or passive",
                **evidence | {"module": face.module, "face": face.face},
            )
    if genders[0] == genders[1]:
        raise entry.error(
            f"{first} and {second} are both {genders[0]}: a bond needs an active and a passive face; turn one of the "
            "modules round, or fit the other kind of face",
            **evidence,
        )
    roll = values["roll"].about(**evidence).roll() if "roll" in values else 0
    ring = values["ring"].about(**evidence).flag() if "ring" in values else False
    return Bond(first, second, roll, ring, entry.line)


def _root(entry: _Entry, modules: Mapping[str, Module]) -> Root:
    values = entry.mapping(("face", "module", "base", "roll", "rpy"), required=("base",))
    floating = values["base"].choice(("fixed", "floating")) == "floating"
    if ("face" in values) == ("module" in values):
        raise entry.error("root needs either a face, such as m01.L, or a module, in whose middle the base is")
    if "face" in values:
        face = values["face"].face(modules)
        module, letter = face.module, face.face
        if modules[module].genders[letter] == "none":
            raise entry.error(f"module {module!r} has no face {letter} for the root", module=module, face=letter)
    else:
        module, letter = values["module"].text(), None
        if module not in modules:
            raise entry.error(f"root names an unknown module {module!r}{nearest(module, modules)}", module=module)
    evidence = {"module": module, "face": letter}
    if "roll" in values and (letter is None or floating):
        raise values["roll"].error("root has a roll only where a fixed base is bolted to a face", **evidence)
    if "rpy" in values and letter is not None and floating:
        raise values["rpy"].error(
            "a floating base at a face is that face's frame: leave rpy out, or use module", **evidence
        )
    roll = values["roll"].about(**evidence).roll() if "roll" in values else 0
    roll_pitch_yaw = [0.0, 0.0, 0.0]
    if "rpy" in values:
        roll_pitch_yaw = [each.number() for each in values["rpy"].about(**evidence).sequence(3)]
    a, b, c = roll_pitch_yaw
    return Root(module, letter, floating, roll, (a, b, c), entry.line)


def _places(entry: _Entry | None, modules: Mapping[str, Module]) -> dict[str, tuple[Face, _Entry]]:
    """Named faces: of hips, of feet."""
    if entry is None:
        return {}
    for key_node, _ in entry.node.value if entry.node.id == "mapping" else ():
        _Entry(key_node, entry.file, f"a name in {entry.label}").identifier("a frame")
    return {name: (value.face(modules), value) for name, value in entry.mapping().items()}


def _faces_in_use(
    bonds: Iterable[Bond],
    root: Root,
    feet: Mapping[str, tuple[Face, _Entry]],
    modules: Mapping[str, Module],
    top: _Entry,
) -> dict[Face, str]:
    """What takes each face; an error where two things do."""
    taken: dict[Face, str] = {}
    claims: list[tuple[Face, str, int | None]] = []
    for bond in bonds:
        claims.append((bond.first, f"the bond with {bond.second}", bond.line))
        claims.append((bond.second, f"the bond with {bond.first}", bond.line))
    if root.face is not None and root.bolted:
        claims.append((Face(root.module, root.face), "the ground", root.line))
    for name, (face, entry) in feet.items():
        if modules[face.module].genders[face.face] == "none":
            raise entry.error(
                f"module {face.module!r} has no face {face.face} for the foot {name!r}",
                module=face.module,
                face=face.face,
            )
        claims.append((face, f"the foot {name!r}", entry.line))
    for face, what, line in claims:
        if face in taken:
            raise DescriptionError(
                f"face {face} is occupied: it holds {taken[face]} and cannot hold {what} as well",
                file=top.file,
                line=line,
                module=face.module,
                face=face.face,
            )
        taken[face] = what
    return taken


def _check_graph(bonds: Iterable[Bond], modules: Mapping[str, Module], root: Root, top: _Entry) -> None:
    """The bonds that are not said to close a ring make one tree, and those that are do close one."""
    neighbours: dict[str, list[str]] = {name: [] for name in modules}
    rings = [bond for bond in bonds if bond.ring]

    def path(start: str, end: str) -> list[str] | None:
        came_from: dict[str, str | None] = {start: None}
        pending = [start]
        while pending:
            name = pending.pop()
            for other in neighbours[name]:
                if other not in came_from:
                    came_from[other] = name
                    pending.append(other)
        if end not in came_from:
            return None
        names = [end]
        while (previous := came_from[names[-1]]) is not None:
            names.append(previous)
        return names[::-1]

    for bond in bonds:
        if bond.ring:
            continue
        if (around := path(bond.first.module, bond.second.module)) is not None:
            raise DescriptionError(
                f"the bond of {bond.first} and {bond.second} closes a ring {' - '.join([*around, around[0]])}, which "
                "is not declared: say ring: true at the bond that shall close it, or remove a bond",
                file=top.file,
                line=bond.line,
                module=bond.first.module,
                face=bond.first.face,
                ring=tuple(around),
            )
        neighbours[bond.first.module].append(bond.second.module)
        neighbours[bond.second.module].append(bond.first.module)
    for name, module in modules.items():
        if path(root.module, name) is None:
            ring = next((b for b in rings if name in (b.first.module, b.second.module)), None)
            hint = "bond it to another module"
            if ring is not None:
                hint = f"the bond of {ring.first} and {ring.second} closes no ring: drop its ring: true"
            raise DescriptionError(
                f"module {name!r} is disconnected from the root {root.module!r}: {hint}",
                file=top.file,
                line=module.line if ring is None else ring.line,
                module=name,
                face=None if ring is None else (ring.first if ring.first.module == name else ring.second).face,
            )


def _numbers(entry: _Entry) -> dict[str, float]:
    return {name: value.number() for name, value in entry.mapping().items()}


def _joints(sections: Mapping[str, _Entry], modules: Mapping[str, Module]) -> tuple[ModuleJoint, ...]:
    """All joints with their names, angles, limits and whether they are frozen."""
    places = {f"{module}_{kind}": (module, kind) for module in modules for kind in JOINTS}

    def module_of(own: str) -> str | None:
        """The module of a joint, or the one that a joint that does not exist is called after."""
        called = [module for module in modules if own.startswith(f"{module}_")]
        return places[own][0] if own in places else max(called, key=len, default=None)

    chosen: dict[str, str] = {}
    if "joint_names" in sections:
        entry = sections["joint_names"]
        for key_node, _ in entry.node.value if entry.node.id == "mapping" else ():
            _Entry(key_node, entry.file, "the name of a joint").identifier("a joint")
        for name, value in entry.mapping().items():
            own = value.text()
            if own not in places:
                hint = nearest(own, places)
                raise value.error(
                    f"{value.label} names an unknown joint {own!r}{hint}", name=own, module=module_of(own), face=None
                )
            if own in chosen:
                raise value.error(
                    f"joint {own!r} has two names, {chosen[own]!r} and {name!r}",
                    name=own,
                    module=module_of(own),
                    face=None,
                )
            chosen[own] = name
    names = {own: chosen.get(own, own) for own in places}
    by_name: dict[str, str] = {}
    for own, name in names.items():
        if name in by_name:
            raise sections["joint_names"].error(
                f"joints {by_name[name]!r} and {own!r} are both named {name!r}", name=name
            )
        by_name[name] = own

    def entries(section: str) -> dict[str, _Entry]:
        if section not in sections:
            return {}
        found = sections[section].mapping()
        for name, value in found.items():
            if name not in by_name:
                hint = f"; it is named {names[name]!r} here" if name in names else nearest(name, by_name)
                module = module_of(name)
                raise value.error(
                    f"{section} names an unknown joint {name!r}{hint}", name=name, module=module, face=None
                )
        known = {}
        for name, value in found.items():
            module, own = places[by_name[name]][0], by_name[name]
            # A joint's own name begins with its module's, another name need not.
            label = value.label if name == own else f"{value.label} (of module {module!r})"
            known[name] = _Entry(value.node, value.file, label, name=name, module=module, face=None)
        return known

    frozen, home, limits = entries("frozen"), entries("home"), entries("limits")
    for name in frozen.keys() & home.keys():
        raise home[name].error(f"joint {name!r} is in frozen and in home: frozen says its angle")
    joints = []
    for own, (module, kind) in places.items():
        name = names[own]
        angle = (frozen | home)[name].number() if name in frozen or name in home else 0.0
        bounds = None
        if name in limits:
            lower, upper = (each.number() for each in limits[name].sequence(2))
            if not lower < upper:
                raise limits[name].error(
                    f"limits of {name!r}, a joint of module {module!r}: {lower:g} deg must be below {upper:g} deg"
                )
            bounds = (lower, upper)
        joints.append(ModuleJoint(name, module, kind, angle, name in frozen, bounds))
    return tuple(joints)


def _check_hips(assembly: Assembly, hips: Mapping[str, tuple[Face, _Entry]], used: Mapping[Face, str]) -> None:
    """A hip is where the tree enters a module through a swing."""
    entered = {mount.module: mount for mount in assembly.mounts}
    seen: dict[Face, str] = {}
    for name, (face, entry) in hips.items():
        mount = entered[face.module]
        evidence = {"module": face.module, "face": face.face}
        if face.face == "S":
            raise entry.error(f"hip {name!r} is at {face}, which has no swing: take a face L or U", **evidence)
        if mount.face != face.face or face not in used:
            held = Face(face.module, mount.face) in used
            way = (
                f"the base holds module {face.module!r} by its face {mount.face}" if held else "nothing holds it there"
            )
            raise entry.error(
                f"hip {name!r} is at {face}, but {way}: a hip is where a module is held, on the side of the base",
                **evidence,
            )
        if face in seen:
            raise entry.error(f"hips {seen[face]!r} and {name!r} are at one face {face}", **evidence)
        seen[face] = name


def _check_names(assembly: Assembly, top: _Entry) -> None:
    """No hip or foot has the name of another link."""
    links = dict.fromkeys(_OWN_LINKS, "the base's")
    for module in assembly.modules:
        for name in (*(f"{module}_{body}" for body in BODIES), *(Face(module, face).link for face in FACES)):
            links[name] = f"a link of module {module!r}"
    for what, places in (("hip", assembly.hips), ("foot", assembly.feet)):
        for name, face in places.items():
            if name in links:
                raise top.error(
                    f"the {what} at {face} is named {name!r}, which is {links[name]} name already: choose another",
                    module=face.module,
                    face=face.face,
                    name=name,
                )
            links[name] = f"a {what}'s"
