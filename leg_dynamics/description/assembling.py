"""A checked assembly of modules with its parameters: where everything is at home, and its xacro document."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.description.frames import axis_rotation
from leg_dynamics.description.model import Parameter, Pose
from leg_dynamics.description.modules import Assembly, Bond, Face, ModuleJoint, Mount, read_assembly
from leg_dynamics.description.parameters import load_parameters
from leg_dynamics.description.shipped import shipped_folder
from leg_dynamics.description.xml_reader import nearest
from leg_dynamics.errors import DescriptionError, ParameterError

__all__ = ["Settings", "assembly_parameters", "write_document"]

_SIZES = ("length", "width", "f", "s")
# m; one in the last digits of a module's length.
_FITS = 1e-12
# m and rad; a home pose written to seven decimals of a degree is closed.
_CLOSED = 1e-6
# Of the largest column: a joint that moves the ring's end by less beyond the others does not hold it.
_SMALLEST_COLUMN = 1e-9
_EQUAL_COLUMNS = 1e-6
# From the root's side on: joint, body before it and behind it, sign of its coordinate.
_CHAINS = {
    "L": (
        ("lower", "lower_bracket", "lower_half", 1.0),
        ("middle", "lower_half", "upper_half", 1.0),
        ("upper", "upper_half", "upper_bracket", 1.0),
    ),
    "U": (
        ("upper", "upper_bracket", "upper_half", -1.0),
        ("middle", "upper_half", "lower_half", -1.0),
        ("lower", "lower_half", "lower_bracket", -1.0),
    ),
    "S": (
        ("lower", "lower_half", "lower_bracket", -1.0),
        ("middle", "lower_half", "upper_half", 1.0),
        ("upper", "upper_half", "upper_bracket", 1.0),
    ),
}
_BODY_OF_FACE = {"L": "lower_bracket", "U": "upper_bracket", "S": "lower_half"}
_X, _Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def assembly_parameters(path: Path, values: Mapping[str, float] | None) -> dict[str, Parameter]:
    """The parameters of an assembly after overrides.

    Parameters
    ----------
    path : pathlib.Path
        The assembly's YAML file.
    values : mapping of str to float or None
        Overrides.

    Returns
    -------
    dict of str to Parameter
        Those of the module, then ``frozen`` and one ``freeze_JOINT`` a joint.

    Raises
    ------
    DescriptionError
        The assembly is wrong.
    ParameterError
        A parameter does not exist, or its value is not usable.
    """
    return dict(Settings(read_assembly(path), values).parameters)


class Settings:
    """An assembly with the values of its parameters.

    Parameters
    ----------
    assembly : Assembly
    values : mapping of str to float or None
        Overrides.

    Attributes
    ----------
    parameters : dict of str to Parameter
        With the values in place.

    Raises
    ------
    ParameterError
        A name is unknown, a value is no finite number or no size, a switch is neither 0 nor 1, or 2 f + s is not the
        module's length.
    """

    def __init__(self, assembly: Assembly, values: Mapping[str, float] | None) -> None:
        self.assembly = assembly
        _, shared = load_parameters(_parameters_file())
        self.module_parameters = tuple(shared)
        self.parameters = shared | {each.name: each for each in self._switches()}
        for name, value in assembly.parameters.items():
            self._set(name, value, f"parameters of {assembly.file}")
        for name, value in (values or {}).items():
            self._set(name, value, Path(assembly.file).name)
        self._check()

    def _switches(self) -> Iterator[Parameter]:
        source = Path(self.assembly.file).name
        if self.assembly.root.floating:
            meaning = "1 writes the free base as a joint of the file, 0 leaves it to readers"
            yield Parameter("floating_joint", 0.0, "1", source, meaning)
        yield Parameter("frozen", 1.0, "1", source, "1 freezes the joints whose freeze_JOINT is 1, 0 none")
        for joint in self.assembly.joints:
            yield Parameter(f"freeze_{joint.name}", float(joint.frozen), "1", source, f"1 holds {joint.name} at home")

    def _set(self, name: str, value: Any, where: str) -> None:
        if name not in self.parameters:
            raise ParameterError(
                f"{where}: there is no parameter {name!r}{nearest(str(name), self.parameters)} (there are "
                f"{', '.join(self.module_parameters)}, frozen and freeze_JOINT)",
                name=name,
                known=tuple(self.parameters),
            )
        try:
            usable = not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value)
        except OverflowError:
            usable = False
        if not usable:
            raise ParameterError(f"parameter {name!r} must be a finite number, got {value!r}", name=name)
        self.parameters[name] = replace(self.parameters[name], value=float(value))

    def _check(self) -> None:
        for name, parameter in self.parameters.items():
            if name not in self.module_parameters and parameter.value not in (0.0, 1.0):
                raise ParameterError(f"{name} must be 0 or 1, got {parameter.value:g}", name=name)
        for name in (*_SIZES, "foot_radius", "swing_range", "module_mass"):
            if not self[name] > 0.0:
                unit = self.parameters[name].unit
                raise ParameterError(f"{name} must be positive, got {self[name]:g} {unit}", name=name)
        excess = 2.0 * self["f"] + self["s"] - self["length"]
        if not abs(excess) <= _FITS:
            raise ParameterError(
                f"a module of length {self['length']:g} m has 2 f + s = {2.0 * self['f'] + self['s']:g} m, "
                f"{abs(excess):.3g} m too {'much' if excess > 0.0 else 'little'}: set f = {self['f']:g} together with "
                f"s = {self['length'] - 2.0 * self['f']:.12g}, or with length = {2.0 * self['f'] + self['s']:.12g}",
                name="f",
                margin=-abs(excess),
            )

    def __getitem__(self, name: str) -> float:
        return self.parameters[name].value

    def is_frozen(self, joint: ModuleJoint) -> bool:
        """Whether a joint is frozen with these values."""
        return self["frozen"] != 0.0 and self[f"freeze_{joint.name}"] != 0.0

    def limits(self, joint: ModuleJoint) -> tuple[float, float]:
        """Limits of a joint, deg."""
        reach = math.inf if joint.kind == "middle" else self["swing_range"]
        return joint.limits or (-reach, reach)

    def mass(self, module: str) -> float:
        """Mass of a module, kg."""
        own = self.assembly.modules[module].mass
        return self["module_mass"] if own is None else own

    def check_angles(self) -> None:
        """Every joint's angle is within its limits at home; DescriptionError where one is not."""
        for joint in self.assembly.joints:
            lower, upper = self.limits(joint)
            margin = min(joint.angle - lower, upper - joint.angle)
            if margin < 0.0:
                what = "is frozen" if self.is_frozen(joint) else "is at home"
                raise DescriptionError(
                    f"joint {joint.name!r} of module {joint.module!r} {what} at {joint.angle:g} deg, {-margin:g} deg "
                    f"beyond its limits {lower:g} ... {upper:g} deg",
                    file=self.assembly.file,
                    module=joint.module,
                    margin=margin,
                )


def _parameters_file() -> Path:
    return shipped_folder("xacro") / "common" / "module_parameters.yaml"


def _pose(xyz: tuple[float, float, float] = (0.0, 0.0, 0.0), *turns: NDArray[np.float64]) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    for turn in turns:
        pose[:3, :3] = pose[:3, :3] @ turn
    return pose


def _bonded(roll: float) -> NDArray[np.float64]:
    """The second face's frame in the first one's."""
    return _pose((0.0, 0.0, 0.0), axis_rotation(_X, math.radians(roll)), axis_rotation(_Z, math.pi))


@dataclass(frozen=True)
class _Line:
    """A joint's axis at home, in the base: a unit vector (the way its coordinate counts), and a point on it."""

    joint: ModuleJoint
    axis: NDArray[np.float64]
    point: NDArray[np.float64]


class _Home:
    """Where bodies, faces and axes are at home, in the base's frame."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        assembly, root = settings.assembly, settings.assembly.root
        self._bodies: dict[tuple[str, str], NDArray[np.float64]] = {}
        self._lines: dict[tuple[str, str], tuple[_Line, ...]] = {}
        for mount in assembly.mounts:
            if mount.parent is not None:
                start = self.face(mount.parent) @ _bonded(mount.roll)
            elif root.face is None:
                start = _turned(root.rpy) @ _pose((0.0, settings["width"] / 2.0, 0.0), _quarter())
            elif root.bolted:
                start = _turned(root.rpy) @ _bonded(mount.roll)
            else:
                start = np.eye(4)
            above = self._lines[mount.parent.module, _BODY_OF_FACE[mount.parent.face]] if mount.parent else ()
            self._place(mount, start @ np.linalg.inv(self._face_in_body(mount.face)), above)

    def _face_in_body(self, face: str) -> NDArray[np.float64]:
        f, s, width = (self.settings[name] for name in ("f", "s", "width"))
        if face == "L":
            return _pose((-f, 0.0, 0.0), axis_rotation(_Z, math.pi))
        return _pose((f, 0.0, 0.0)) if face == "U" else _pose((s / 2.0, width / 2.0, 0.0), _quarter())

    def _place(self, mount: Mount, start: NDArray[np.float64], above: tuple[_Line, ...]) -> None:
        name = mount.module
        first = _BODY_OF_FACE[mount.face]
        self._bodies[name, first], self._lines[name, first] = start, above
        for kind, before, behind, sign in _CHAINS[mount.face]:
            joint = self.settings.assembly.joint(name, kind)
            shift = sign * self.settings["s"] if kind == "middle" else 0.0
            axis = _X if kind == "middle" else _Z
            turn = axis_rotation(axis, sign * math.radians(joint.angle))
            pose = self._bodies[name, before] @ _pose((shift, 0.0, 0.0), turn)
            line = _Line(joint, sign * pose[:3, :3] @ np.array(axis), pose[:3, 3])
            self._bodies[name, behind], self._lines[name, behind] = pose, (*self._lines[name, before], line)

    def face(self, face: Face) -> NDArray[np.float64]:
        """Pose of a face, (4, 4)."""
        return self._bodies[face.module, _BODY_OF_FACE[face.face]] @ self._face_in_body(face.face)

    def check_ring(self, bond: Bond) -> None:
        """Two faces that close a ring meet; DescriptionError where they do not."""
        gap = np.linalg.inv(self.face(bond.first) @ _bonded(bond.roll)) @ self.face(bond.second)
        distance = float(np.linalg.norm(gap[:3, 3]))
        # Twice the sine of half the angle between the two.
        chord = float(np.linalg.norm(gap[:3, :3] - np.eye(3)) / math.sqrt(2.0))
        turn = math.degrees(2.0 * math.asin(min(chord / 2.0, 1.0)))
        if not (distance <= _CLOSED and chord <= _CLOSED):
            raise DescriptionError(
                f"the ring does not close at home: {bond.second} is {1e3 * distance:.6g} mm and {turn:.6g} deg away "
                f"from where its bond with {bond.first} at roll {bond.roll} wants it; change home, or the roll",
                file=self.settings.assembly.file,
                line=bond.line,
                module=bond.second.module,
                face=bond.second.face,
                margin=-distance,
            )

    def ring_rows(self, bond: Bond) -> dict[str, NDArray[np.float64]]:
        """By joint: the twist of the second face against the first one, at that face, lengths in modules; (6,)."""
        at = self.face(bond.first)[:3, 3]
        columns: dict[str, NDArray[np.float64]] = {}
        for face, sign in ((bond.first, -1.0), (bond.second, 1.0)):
            for line in self._lines[face.module, _BODY_OF_FACE[face.face]]:
                arm = np.cross(line.axis, at - line.point) / self.settings["length"]
                twist = sign * np.concatenate([line.axis, arm])
                columns[line.joint.name] = columns.get(line.joint.name, 0.0) + twist
        return columns


def _quarter() -> NDArray[np.float64]:
    return axis_rotation(_Z, math.pi / 2.0)


def _turned(rpy: tuple[float, float, float]) -> NDArray[np.float64]:
    a, b, c = map(math.radians, rpy)
    return Pose(rpy=(a, b, c)).matrix()


def _dependent_joints(settings: Settings) -> tuple[str, ...]:
    """Joints that the rings determine at home: greedily those whose columns of the rings' rows stand out most.

    The first one counts where columns are as long as each other but for rounding.
    """
    assembly = settings.assembly
    if not assembly.rings:
        return ()
    home = _Home(settings)
    free = [joint.name for joint in assembly.joints if not settings.is_frozen(joint)]
    rings = []
    for bond in assembly.rings:
        home.check_ring(bond)
        columns = home.ring_rows(bond)
        rings.append(np.array([columns.get(name, np.zeros(6)) for name in free]).reshape(len(free), 6))
    remaining = np.concatenate(rings, axis=1)
    chosen: list[str] = []
    longest = float(np.linalg.norm(remaining, axis=1).max(initial=0.0))
    while len(chosen) < min(remaining.shape):
        size = np.linalg.norm(remaining, axis=1)
        if not size.max() > _SMALLEST_COLUMN * longest:
            break
        pick = int(np.argmax(size >= (1.0 - _EQUAL_COLUMNS) * size.max()))
        direction = remaining[pick] / size[pick]
        remaining = remaining - np.outer(remaining @ direction, direction)
        remaining[pick] = 0.0
        chosen.append(free[pick])
    return tuple(chosen)


def write_document(path: Path, values: Mapping[str, float] | None, folder: Path) -> tuple[Path, dict[str, str]]:
    """Write an assembly as a xacro document, its joints and its parameters.

    Parameters
    ----------
    path : pathlib.Path
        The assembly's YAML file.
    values : mapping of str to float or None
        Overrides of its parameters.
    folder : pathlib.Path
        Where to write.

    Returns
    -------
    tuple of pathlib.Path and dict
        The document, and the xacro arguments that it needs.

    Raises
    ------
    DescriptionError
        The assembly is wrong, a home angle is outside its limits, or a ring does not close.
    ParameterError
        As `Settings`.
    """
    import yaml

    settings = Settings(read_assembly(path), values)
    settings.check_angles()
    dependent = _dependent_joints(settings)
    parameters = {name: {"value": settings[name]} for name in settings.module_parameters}
    joints = {joint.name: _joint(settings, joint, joint.name not in dependent) for joint in settings.assembly.joints}
    files = {"parameters": parameters, "joints": joints}
    arguments = {}
    for name, content in files.items():
        file = folder / f"{name}.yaml"
        file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        arguments[name] = str(file)
    document = folder / "assembly.xacro"
    document.write_text("\n".join(_lines(settings)) + "\n", encoding="utf-8")
    return document, arguments


def _joint(settings: Settings, joint: ModuleJoint, independent: bool) -> dict[str, Any]:
    """What xacro's `module_joint` needs to know."""
    lower, upper = settings.limits(joint)
    bounded = math.isfinite(lower) and math.isfinite(upper)
    kind = "fixed" if settings.is_frozen(joint) else "revolute" if bounded else "continuous"
    facts = {"name": joint.name, "type": kind, "angle": math.radians(joint.angle), "independent": independent}
    return facts | ({"lower": math.radians(lower), "upper": math.radians(upper)} if bounded else {})


def _call(macro: str, **attributes: object) -> str:
    # It imports urllib.request, and most readers of a file never write one.
    from xml.sax.saxutils import quoteattr

    shown = " ".join(f"{name}={quoteattr(str(value))}" for name, value in attributes.items())
    return f"  <xacro:{macro} {shown}/>" if attributes else f"  <xacro:{macro}/>"


def _lines(settings: Settings) -> Iterator[str]:
    """The document: macros of common/module.xacro, one call a thing."""
    assembly, root = settings.assembly, settings.assembly.root
    yield f'<robot name="{assembly.name}" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    for name in ("parameters", "joints"):
        variable = name.removesuffix("s")
        yield _call("arg", name=name, default="")
        yield _call("property", name=variable, value=f"${{xacro.load_yaml('$(arg {name})')}}", lazy_eval="false")
    macros = str(shipped_folder("xacro") / "common" / "module.xacro")
    yield _call("include", filename=macros.replace("$", "$$"))
    yield _call("material_definitions")
    if assembly.root.floating and settings["floating_joint"]:
        yield _call("floating_base")
    yield '  <link name="base"/>'
    hips = {face: name for name, face in assembly.hips.items()}
    roll, pitch, yaw = root.rpy
    for mount in assembly.mounts:
        held, parent = Face(mount.module, mount.face), mount.parent
        if parent is None and root.bolted:
            yield _call("ground_face", roll=roll, pitch=pitch, yaw=yaw)
        if parent is not None or root.bolted:
            place: dict[str, object] = {
                "parent": "ground_face" if parent is None else parent.link,
                "name": mount.module,
            }
            place |= {"face": mount.face, "roll": mount.roll}
            yield _call("hip_bond", hip=hips[held], **place) if held in hips else _call("bond", **place)
        elif root.face is None:
            yield _call("base_at_middle", name=mount.module, roll=roll, pitch=pitch, yaw=yaw)
        else:
            yield _call("base_at_face", name=mount.module, face=root.face)
        joints = {
            kind: f"${{joint['{assembly.joint(mount.module, kind).name}']}}" for kind in ("lower", "middle", "upper")
        }
        genders = assembly.modules[mount.module].genders
        yield _call("module", name=mount.module, root=mount.face, mass=settings.mass(mount.module), **genders, **joints)
        for name, foot in assembly.feet.items():
            if foot.module == mount.module:
                # The foot's z continues that of the chain, as the hip's begins it.
                yield _call("foot_cap", name=name, parent=foot.link, turn=180 if mount.face == "U" else 0)
    for bond in assembly.rings:
        yield _call(
            "ring_bond",
            name=f"ring_{bond.first.module}_{bond.first.face}_{bond.second.module}_{bond.second.face}",
            predecessor=bond.first.link,
            successor=bond.second.link,
            roll=bond.roll,
        )
    yield '  <configuration name="home">'
    for mount in assembly.mounts:
        for kind, *_ in _CHAINS[mount.face]:
            joint = assembly.joint(mount.module, kind)
            if not settings.is_frozen(joint):
                yield f'    <joint name="{joint.name}" value="{math.radians(joint.angle)!r}"/>'
    yield "  </configuration>"
    yield "</robot>"
