"""What to write into a mechanism's file, in the language that it is written in: URDF+, MJCF, or URDF beside YAML."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from leg_dynamics.description.model import Description, Loop
from leg_dynamics.description.toolbox import chain_links, sidecar_behind

__all__ = ["Fixes", "fixes_of"]

# Names that YAML reads as text without quotes, but for a few words.
_PLAIN = re.compile(r"[A-Za-z_][\w.-]*")
_YAML_WORDS = frozenset({"y", "n", "yes", "no", "on", "off", "true", "false", "null"})


def fixes_of(description: Description) -> Fixes:
    """The texts for the file that a description was read from."""
    if description.dialect == "MJCF":
        return _MjcfFixes(description)
    sidecar = sidecar_behind(description)
    return Fixes(description) if sidecar is None else _ToolboxFixes(description, sidecar)


class Fixes:
    """Texts for URDF+.

    Parameters
    ----------
    description : Description
        As it was read: the names in it are the file's.
    """

    has_velocity_limits = True
    names_joints = True
    """Whether every joint of the description has its name from the file."""
    position_limits = '<limit lower=".." upper=".." effort=".." velocity=".."/>'
    effort_limits = (
        'state effort=".." (N·m or N) and velocity=".." (rad/s or m/s) in <limit>: feasibility is judged by them'
    )
    inertial = "give each link its <inertial> where it stands for a real body"
    rotor = "if it is a rotor, state rotorInertia and mechanicalReduction in its <transmission>"
    loops = "add <loop> elements, or put the YAML file that names the closed loops beside the URDF file"
    other_home = "give a <configuration name='home'> further from it"

    def __init__(self, description: Description) -> None:
        self.description = description

    def line(self, line: int | None) -> int | None:
        """A description's line as the file's, None where it is none."""
        return line

    def own_links(self, names: Sequence[str]) -> list[str]:
        """Those of the links that are in the file."""
        return list(names)

    def home(self, values: Mapping[str, float]) -> str:
        """A home pose: coordinates (rad or m) by name."""
        inside = "".join(f'<joint name={quoteattr(name)} value="{x:.12g}"/>' for name, x in values.items())
        return f'<configuration name="home">{inside}</configuration>'

    def flags(self, independent: Collection[str]) -> str:
        """Flags that make these coordinates the independent ones."""
        true, false, part = self._split(independent)
        texts = [
            f'independent="{flag}" for {", ".join(names)}'
            for flag, names in (("true", true), ("false", false))
            if names
        ]
        return f"state {' and '.join(texts)}{_partly(part)}" if texts else ""

    def _split(self, independent: Collection[str]) -> tuple[list[str], list[str], list[str]]:
        """Joints whose coordinates are independent, those whose are not, and those of which some are."""
        true: list[str] = []
        false: list[str] = []
        part: list[str] = []
        for joint in self.description.moving_joints:
            count = sum(name in independent for name in joint.coordinates)
            (true if count == len(joint.coordinates) else part if count else false).append(joint.name)
        return true, false, part

    def motors(self, joints: Sequence[str]) -> str:
        """Actuators on these joints."""
        return "".join(
            f"<transmission name={quoteattr(f't_{name}')}><joint name={quoteattr(name)}/>"
            f"<actuator name={quoteattr(f'motor_{name}')}/></transmission>"
            for name in joints
        )

    def spherical(self, name: str) -> str:
        """A loop as a spherical one."""
        without = " without its <axis>" if self._loop(name).axis is not None else ""
        return f'<loop name="{name}" type="spherical">{without} leaves the same motion'

    def deletion(self, name: str) -> str:
        """A loop or coupling left out."""
        kind = "loop" if any(loop.name == name for loop in self.description.loops) else "coupling"
        return f'delete <{kind} name="{name}">'

    def _loop(self, name: str) -> Loop:
        return next(loop for loop in self.description.loops if loop.name == name)


class _MjcfFixes(Fixes):
    has_velocity_limits = False
    names_joints = False
    position_limits = 'range=".. .." of the <joint>'
    effort_limits = (
        'state forcerange=".. .." of the actuator, or actuatorfrcrange of the joint: feasibility is judged by it'
    )
    inertial = "give each body its <inertial> where it stands for a real body"
    rotor = "if it is a rotor, state the armature of the joint that it turns with"
    loops = "add <connect> or <weld> to <equality>"
    other_home = 'give a <key name="home"> further from it'

    def line(self, line: int | None) -> int | None:
        return None

    def home(self, values: Mapping[str, float]) -> str:
        shown = ", ".join(f"{name} {x:.12g}" for name, x in values.items())
        return f'<key name="home" qpos=".."/> in <keyframe>, with {shown}'

    def flags(self, independent: Collection[str]) -> str:
        said = super().flags(independent)
        return f"MJCF has no such flags: save leg_dynamics.description.read(..).urdf, and there {said}" if said else ""

    def motors(self, joints: Sequence[str]) -> str:
        motors = "".join(f"<motor name={quoteattr(f'motor_{name}')} joint={quoteattr(name)}/>" for name in joints)
        return f"<actuator>{motors}</actuator>"

    def spherical(self, name: str) -> str:
        return f"<connect> in place of <weld> for {name!r} leaves the same motion"

    def deletion(self, name: str) -> str:
        kind = "weld" if self._loop(name).type == "fixed" else "connect"
        return f"delete <{kind}> {name!r}"


class _ToolboxFixes(Fixes):
    """The URDF file cannot name the joints of a chain, nor have loops or transmissions: the YAML file does."""

    rotor = 'if it is a rotor, state <dynamics armature=".."/> of the joint that it turns with'

    def __init__(self, description: Description, sidecar: Path) -> None:
        super().__init__(description)
        self._where = f"in {sidecar.name}: "
        self._made = chain_links(sidecar)
        self.loops = f"add pairs of frames to closed_loop of {sidecar.name}"
        self.other_home = f"give a home further from it in {sidecar.name}"

    def line(self, line: int | None) -> int | None:
        return None

    def own_links(self, names: Sequence[str]) -> list[str]:
        return [name for name in names if name not in self._made]

    def home(self, values: Mapping[str, float]) -> str:
        pairs = ", ".join(f"{_yaml_text(name)}: {_yaml_number(x)}" for name, x in values.items())
        return f"{self._where}home: {{{pairs}}}"

    def flags(self, independent: Collection[str]) -> str:
        true, _, part = self._split(independent)
        return f"{self._where}independent: [{', '.join(map(_yaml_text, true))}]{_partly(part)}"

    def motors(self, joints: Sequence[str]) -> str:
        return f"{self._where}name_mot: [{', '.join(map(_yaml_text, joints))}]"

    def spherical(self, name: str) -> str:
        kinds = ("3d" if loop.type == "spherical" or loop.name == name else "6d" for loop in self.description.loops)
        return f"{self._where}type: [{', '.join(kinds)}] leaves the same motion"

    def deletion(self, name: str) -> str:
        number = self.description.loops.index(self._loop(name)) + 1
        return f"{self._where}delete entry {number} of closed_loop, and of type where that is given"


def _partly(joints: Sequence[str]) -> str:
    if not joints:
        return ""
    shown = ", ".join(joints)
    return f"; of {shown} only some coordinates are independent, which no flag says: write it as a chain of joints"


def _yaml_text(text: str) -> str:
    plain = _PLAIN.fullmatch(text) and text.lower() not in _YAML_WORDS
    return text if plain else json.dumps(text, ensure_ascii=False)


def _yaml_number(value: float) -> str:
    """A number that YAML 1.1 takes for one: 1e-09 would be text there."""
    mantissa, mark, exponent = f"{value:.12g}".partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}e{exponent}" if mark else mantissa
