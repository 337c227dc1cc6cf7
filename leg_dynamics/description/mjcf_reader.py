"""Dialect of MuJoCo: an MJCF model becomes URDF+ text, read from the model that MuJoCo itself compiles.

Defaults, includes, frames, replicas, inertia from shapes: whatever a file leaves to MuJoCo's compiler is what MuJoCo
makes of it. Hinges and slides keep their names, positive directions and zeros, so that their coordinates are MuJoCo's
qpos; a ball joint is a chain of three hinges, a free joint a floating one. MuJoCo is the optional extra ``mujoco``.
"""

from __future__ import annotations

import math
import posixpath
import re
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from leg_dynamics.description.lowering import replace_by_chain, turns
from leg_dynamics.description.mjcf import STANDARD_GRAVITY, has_mujoco
from leg_dynamics.description.mjcf_guard import check_mjcf
from leg_dynamics.description.model import Description, Joint
from leg_dynamics.description.parse import build
from leg_dynamics.description.xml_reader import Document, Node, read_root
from leg_dynamics.errors import UnsupportedError

__all__ = ["build_mjcf", "is_mjcf", "mjcf_text"]

_LINE = re.compile(r"\bline (\d+)")
_UNOPENED = re.compile(r"Error opening file '([^']+)'")
_SKIPPED = re.compile(r"\s*(<\?|<!--)")
_ROOT = re.compile(r"\s*<mujoco(?=[\s/>])")
_BALL_AXES = "xyz"
# Difference between two linear equations of the same joints, relative: the rounding of a printed ratio.
_SAME = 1e-9


def is_mjcf(text: str) -> bool:
    """Whether the root element of an XML text is ``<mujoco>``, as far as its beginning tells."""
    start = 1 if text.startswith("\ufeff") else 0
    # Step by step, as a pattern for any number of comments would try all ways to divide them.
    while (skipped := _SKIPPED.match(text, start)) is not None:
        closing = "?>" if skipped[1] == "<?" else "-->"
        if (end := text.find(closing, skipped.end())) < 0:
            return False
        start = end + len(closing)
    return _ROOT.match(text, start) is not None


def build_mjcf(text: str, document: Document, path: Path | None = None) -> Description:
    """An MJCF model as a description, through `mjcf_text`.

    Parameters
    ----------
    text : str
        The MJCF file.
    document : Document
        Its name, for errors.
    path : pathlib.Path, optional
        Where the file lies, for what it includes; without it, includes and meshes are not found.

    Returns
    -------
    Description
        Its `urdf` is the URDF+ text: nothing of MuJoCo is needed any more.

    Raises
    ------
    UnsupportedError, DescriptionError, UnsafeXmlError
        As `mjcf_text`.
    """
    # Lines of the text that is made here are no lines of the file; what is odd about the model was said on the way.
    made = replace(document, lines={}, quiet=True)
    built = build(mjcf_text(text, document, path), made)
    ownless: dict[str, Any] = {
        kind: tuple(replace(each, line=None) for each in getattr(built, kind))
        for kind in ("links", "joints", "loops", "transmissions", "configurations")
    }
    return replace(built, dialect="MJCF", **ownless)


def mjcf_text(text: str, document: Document, path: Path | None = None) -> str:
    """URDF+ text of an MJCF model.

    Bodies become links of the same names, the world is the root ``world``, and named sites are links fixed to their
    bodies. Several joints of one body are a chain about massless links. An actuator on a hinge or slide marks the joint
    as driven; what it can exert at the joint (gear included) is the joint's effort limit, each way its own, with a
    reduction of 1. A range without 0 is a limit of 0, so that nothing is feasible that the file forbids. Several on one
    joint are one actuator, called ``first+second``, and what they can exert adds up, end by end. Where a model has
    actuators and none of them is on a hinge or slide that moves, nothing is driven; a model without actuators does not
    say what is, and counts as driven at its independent hinges and slides. Connect and weld equalities become spherical
    and fixed loops, linear joint equalities mimic joints, keyframes configurations (qpos0 is ``home`` where there is
    none). Contacts and shapes are left out.

    Parameters
    ----------
    text, document, path
        As for `build_mjcf`.

    Returns
    -------
    str
        Deterministic: unnamed bodies and joints are named after their numbers and bodies.

    Raises
    ------
    UnsupportedError
        MuJoCo is not installed, or the model has what URDF+ cannot express and what changes its motion: springs, losses
        of ball joints, equalities of tendons, ...; the sentence names it.
    UnsafeXmlError
        The file has a document type or is nested too deeply; MuJoCo does not see it.
    DescriptionError
        MuJoCo refuses the model, with the line where it says one.

    Warns
    -----
    LegDynamicsWarning
        For inactive equalities and actuators, actuators that drive no single joint, several on one joint, ranges of
        efforts without 0, gravity other than 9.81 m/s² downwards, mocap bodies (fixed where they are), gravity
        compensation and fluids.
    """
    root = read_root(text, document)
    _refuse_nan(root)
    check_mjcf(root, document, path)
    if not has_mujoco():
        raise UnsupportedError(
            f"{document.file} is an MJCF model, and MuJoCo, which reads it, is not installed: "
            "pip install 'leg-dynamics[mujoco]'"
        )
    model, said = _compiled(text, document, path, root)
    result = _Reader(model, document, root).text()
    for warning in said:
        document.warn(f"MuJoCo warns of the model: {warning}")
    return result


def _refuse_nan(root: Node) -> None:
    """MuJoCo reads NaN as a number and writes of it to a log in the current folder."""
    for node in root.walk():
        for attribute, value in node.attributes.items():
            if attribute != "name" and "nan" in value.lower().split():
                raise node.error(f"{attribute} of {node.label} must be finite, got {value[:80]!r}")


def _compiled(text: str, document: Document, path: Path | None, root: Node) -> tuple[Any, list[str]]:
    """MuJoCo's model, and what it warned of."""
    import mujoco

    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    # Else MuJoCo writes its warnings into a file in the current folder.
    mujoco.set_mju_user_warning(said.append)
    try:
        make = mujoco.MjModel.from_xml_string if path is None else mujoco.MjModel.from_xml_path
        model = make(text if path is None else str(path))
    except (ValueError, mujoco.FatalError) as error:
        message = " ".join(str(error).split())
        found = _LINE.search(message)
        # Of what line of which file MuJoCo does not say.
        line = None if found is None or "<include" in text else int(found[1])
        line = line or _line_of_unopened(message, root)
        raise document.error(f"MuJoCo refuses the model: {message}{_advice(message, path)}", line) from error
    finally:
        mujoco.set_mju_user_warning(before)
    return model, [" ".join(warning.split()) for warning in dict.fromkeys(said)]


def _line_of_unopened(message: str, root: Node) -> int | None:
    """The line of the only element that names the file which MuJoCo could not open; None where there are others."""
    if (found := _UNOPENED.search(message)) is None:
        return None
    lines = [
        node.line
        for node in root.walk()
        if any(
            name.startswith("file") and value and found[1].endswith(posixpath.normpath(value))
            for name, value in node.attributes.items()
        )
    ]
    return lines[0] if len(lines) == 1 else None


def _advice(message: str, path: Path | None) -> str:
    """What to do about a file that MuJoCo could not open; empty for all else that it says."""
    found = _UNOPENED.search(message)
    if found is None:
        return ""
    if path is None:
        return (
            f"; the model is text, which has no folder to look for {found[1]!r} in: save it beside its files and load "
            "it by its path"
        )
    return (
        f"; looked for at {path.absolute().parent / found[1]}: put the file there, or correct its file=, or the "
        "meshdir, texturedir or assetdir of <compiler>; a mesh that is only drawn can be deleted with its <geom>, if "
        "the body has an <inertial>"
    )


@dataclass(frozen=True)
class _Follows:
    """This joint = multiplier * joint + offset."""

    joint: int
    multiplier: float
    offset: float


class _Names:
    """Given names first; others made up so that no two are alike."""

    def __init__(self, given: Iterable[str]) -> None:
        self.taken = {name for name in given if name}

    def free(self, name: str, suffixes: Collection[str] = ("",)) -> str:
        """The name, with underscores if need be, such that it is free with each suffix; takes them."""
        while any(f"{name}{suffix}" in self.taken for suffix in suffixes):
            name += "_"
        self.taken.update(f"{name}{suffix}" for suffix in suffixes)
        return name


class _Reader:
    """One compiled model on its way to URDF+."""

    def __init__(self, model: Any, document: Document, source: Node) -> None:
        import mujoco

        self.mj = mujoco
        self.source = source
        self.model = model
        self.document = document
        self.root = ElementTree.Element("robot", name=self._model_name())
        self.bodies = self._given(mujoco.mjtObj.mjOBJ_BODY, model.nbody)
        self.links = _Names(self.bodies)
        self.bodies = [name or self.links.free(f"body_{number}") for number, name in enumerate(self.bodies)]
        self.kinds = [mujoco.mjtJoint(int(kind)) for kind in model.jnt_type]
        self.joint_names = _Names(self._given(mujoco.mjtObj.mjOBJ_JOINT, model.njnt))
        self.joints = self._joints()
        self.locked: dict[int, float] = {}
        self.follows: dict[int, _Follows] = {}
        self.rotor = np.zeros(model.njnt)
        self.motor_damping = np.zeros(model.njnt)

    def text(self) -> str:
        self._check_finite()
        self._refuse_forces()
        self._read_joint_equalities()
        efforts, driven = self._actuators()
        if self._actuator_count() and not driven:
            self.root.set("driven", "none")
        for body in range(self.model.nbody):
            self._add_link(body)
            if body > 0:
                self._add_joints(body, efforts)
        self._add_sites()
        self._add_loops()
        for joint, actuator in driven.items():
            transmission = ElementTree.SubElement(self.root, "transmission", name=f"transmission_{self.joints[joint]}")
            ElementTree.SubElement(transmission, "joint", name=self.joints[joint])
            ElementTree.SubElement(transmission, "actuator", name=actuator)
        self._add_configurations()
        self._warn_about_gravity()
        ElementTree.indent(self.root)
        return ElementTree.tostring(self.root, encoding="unicode")

    def _check_finite(self) -> None:
        """MuJoCo takes infinite numbers, and makes NaN of some."""
        objects = self.mj.mjtObj
        for prefix, kind, what, fields in (
            ("body", objects.mjOBJ_BODY, "body", ("pos", "quat", "mass", "inertia", "ipos", "iquat")),
            ("jnt", objects.mjOBJ_JOINT, "joint", ("pos", "axis")),
            ("dof", objects.mjOBJ_JOINT, "joint", ("damping", "frictionloss", "armature")),
            ("site", objects.mjOBJ_SITE, "site", ("pos", "quat")),
            ("eq", objects.mjOBJ_EQUALITY, "equality", ("data",)),
            ("actuator", objects.mjOBJ_ACTUATOR, "actuator", ("gear", "gainprm", "forcerange", "ctrlrange")),
            ("key", objects.mjOBJ_KEY, "keyframe", ("qpos",)),
        ):
            for field in fields:
                values = np.asarray(getattr(self.model, f"{prefix}_{field}"), dtype=float)
                bad = np.flatnonzero(~np.isfinite(values.reshape(len(values), math.prod(values.shape[1:]))).all(axis=1))
                if bad.size:
                    number = int(self.model.dof_jntid[bad[0]] if prefix == "dof" else bad[0])
                    line = self._line_of(kind, number, what)
                    raise self.document.error(f"{field} of {self._name_of(kind, number, what)} is not finite", line)
        for joint, start in enumerate(self.model.jnt_qposadr):
            if not math.isfinite(self.model.qpos0[start]):
                name = self._name_of(objects.mjOBJ_JOINT, joint, "joint")
                raise self.document.error(f"the coordinate of {name} in the file's pose (ref) is not finite")

    # names

    def _line_of(self, kind: Any, number: int, what: str) -> int | None:
        """The file's line of a named body, joint, equality, ..., None where this file has no such name."""
        name = self.mj.mj_id2name(self.model, kind, number)
        section = {"equality": "equality", "actuator": "actuator", "keyframe": "keyframe"}.get(what, "worldbody")
        lines = [
            node.line
            for part in self.source.all(section)
            for node in part.walk()
            if name and node.attributes.get("name") == name and (section != "worldbody" or node.tag == what)
        ]
        return lines[0] if len(lines) == 1 else None

    def _given(self, kind: Any, count: int) -> list[str]:
        names = (self.mj.mj_id2name(self.model, kind, number) or "" for number in range(count))
        return [name if name.strip() else "" for name in names]

    def _model_name(self) -> str:
        name = bytes(self.model.names).split(b"\0", 1)[0].decode(errors="replace").strip()
        return name or "mujoco_model"

    def _joints(self) -> list[str]:
        names, count = [], dict.fromkeys(range(self.model.nbody), 0)
        for number, given in enumerate(self._given(self.mj.mjtObj.mjOBJ_JOINT, self.model.njnt)):
            body = int(self.model.jnt_bodyid[number])
            count[body] += 1
            name = given
            if not given:
                ordinal = f"_{count[body]}" if self.model.body_jntnum[body] > 1 else ""
                name = self.joint_names.free(f"{self.bodies[body]}_joint{ordinal}")
            names.append(name if self._is_scalar(number) else self._chain_name(name, self._suffixes(number)))
        return names

    def _chain_name(self, name: str, suffixes: tuple[str, ...]) -> str:
        """A name for a joint of several coordinates such that the chain's joints and links find theirs free."""
        name = self.joint_names.free(name, suffixes)
        links = [f"{name}{suffix}_link" for suffix in suffixes[:-1]]
        if self.links.taken.isdisjoint(links):
            self.links.taken.update(links)
            return name
        return self._chain_name(f"{name}_", suffixes)

    def _suffixes(self, joint: int) -> tuple[str, ...]:
        """What a joint of several coordinates appends to its name for each."""
        if self.kinds[joint] == self.mj.mjtJoint.mjJNT_FREE:
            return Joint("", "floating", "", "").coordinates
        return tuple(step.suffix for step in turns(_BALL_AXES))

    def _name_of(self, kind: Any, number: int, what: str) -> str:
        name = self.mj.mj_id2name(self.model, kind, number)
        return f"{what} {name!r}" if name else f"{what} number {number}"

    def _listed(self, kind: Any, numbers: Iterable[int], what: str) -> str:
        """One to three of them by name, and how many more."""
        found = [self._name_of(kind, number, what) for number in numbers]
        return ", ".join(found[:3]) + (f" and {len(found) - 3} more" if len(found) > 3 else "")

    # forces that a description cannot hold

    def _disabled(self, *flags: str) -> bool:
        """Whether one of these parts of the simulation is switched off; releases name them differently."""
        bits = (int(getattr(self.mj.mjtDisableBit, f"mjDSBL_{flag}", 0)) for flag in flags)
        return any(bit & int(self.model.opt.disableflags) for bit in bits)

    def _column(self, name: str, count: int) -> np.ndarray:
        """Largest magnitude in each row of a field, zeros where this release does not have it; shape (count,)."""
        values = np.abs(np.asarray(getattr(self.model, name, np.zeros((count, 1))), dtype=float))
        return values.reshape(count, math.prod(values.shape[1:])).max(axis=1, initial=0.0)

    def _refuse(self, message: str, **evidence: Any) -> UnsupportedError:
        place = self.document.file if evidence.get("line") is None else f"{self.document.file}:{evidence['line']}"
        return UnsupportedError(f"{place}: {message}", file=self.document.file, **evidence)

    def _refuse_forces(self) -> None:
        model, objects = self.model, self.mj.mjtObj
        if not self._disabled("SPRING", "PASSIVE"):
            stiff = self._column("jnt_stiffness", model.njnt) + self._column("jnt_stiffnesspoly", model.njnt)
            if np.any(stiff):
                springs = self._listed(objects.mjOBJ_JOINT, np.flatnonzero(stiff).tolist(), "joint")
                raise self._refuse(
                    f"springs (stiffness up to {stiff.max():g}) act on {springs}, and a description has none: set "
                    "stiffness to 0 and add the springs' forces to the result"
                )
        losses = ["frictionloss", "dampingpoly", "damping", "stiffness", "stiffnesspoly", "armature"]
        for what in losses:
            if self._ignores(what):
                continue
            values = self._column(f"tendon_{what}", model.ntendon)
            if np.any(values):
                tendons = self._listed(objects.mjOBJ_TENDON, np.flatnonzero(values).tolist(), "tendon")
                raise self._refuse(f"{tendons} has {what} {values.max():g}: tendons cannot be expressed; set it to 0")
        for name, count, owner, kind in (
            ("dof_dampingpoly", model.nv, model.dof_jntid, objects.mjOBJ_JOINT),
            ("actuator_dampingpoly", self._actuator_count(), None, objects.mjOBJ_ACTUATOR),
        ):
            values = self._column(name, count)
            if np.any(values) and not self._ignores("damping"):
                numbers = np.flatnonzero(values)
                numbers = numbers if owner is None else np.unique(np.asarray(owner)[numbers])
                what = "joint" if kind == objects.mjOBJ_JOINT else "actuator"
                raise self._refuse(
                    f"{self._listed(kind, numbers.tolist(), what)} has damping that is not linear in the speed: "
                    "only linear damping can be expressed"
                )
        if model.nflex:
            raise self._refuse("the model has flexible bodies (flex): only rigid bodies can be expressed")
        self._refuse_losses_of_several_coordinates()
        self._warn_about_forces()

    def _ignores(self, what: str) -> bool:
        """Whether the file's flags switch a kind of passive force off."""
        if what.startswith("damping"):
            return self._disabled("DAMPER", "PASSIVE")
        if what.startswith("stiffness"):
            return self._disabled("SPRING", "PASSIVE")
        return what == "frictionloss" and self._disabled("FRICTIONLOSS", "CONSTRAINT")

    def _refuse_losses_of_several_coordinates(self) -> None:
        for joint, kind in enumerate(self.kinds):
            if kind not in (self.mj.mjtJoint.mjJNT_BALL, self.mj.mjtJoint.mjJNT_FREE):
                continue
            start, count = int(self.model.jnt_dofadr[joint]), len(self._suffixes(joint))
            for what in ("damping", "frictionloss", "armature"):
                value = float(np.max(getattr(self.model, f"dof_{what}")[start : start + count]))
                if value != 0.0 and not self._ignores(what):
                    free = kind == self.mj.mjtJoint.mjJNT_FREE
                    raise self._refuse(
                        f"{'free' if free else 'ball'} joint {self.joints[joint]!r} has {what} {value:g}, which acts "
                        "on its angular velocity and on no coordinate of a chain: set it to 0"
                        + (", or use <freejoint>, which takes no defaults" if free else ", or use hinges"),
                        joint=self.joints[joint],
                    )

    def _warn_about_forces(self) -> None:
        model, warn = self.model, self.document.warn
        lifted = np.flatnonzero(np.asarray(model.body_gravcomp)).tolist()
        if lifted:
            bodies = self._listed(self.mj.mjtObj.mjOBJ_BODY, lifted, "body")
            warn(f"gravity compensation (gravcomp) of {bodies} is left out: efforts carry the whole weight")
        if model.opt.density > 0.0 or model.opt.viscosity > 0.0:
            warn("forces of the fluid (density, viscosity) are left out")
        if model.nplugin:
            warn(f"{model.nplugin} plugin instances are left out")

    def _warn_about_gravity(self) -> None:
        gravity = np.array(self.model.opt.gravity, dtype=float)
        if self._disabled("GRAVITY"):
            gravity[:] = 0.0
        if not np.array_equal(gravity, (0.0, 0.0, -STANDARD_GRAVITY)):
            shown = ", ".join(f"{value + 0.0:g}" for value in gravity)
            self.document.warn(
                f"the file's gravity is ({shown}) m/s², and a description's is (0, 0, -{STANDARD_GRAVITY:g}): pass "
                f"gravity=({shown}), turned into the hip's frame where there is one"
            )

    # equalities

    def _equality_name(self, number: int) -> str:
        return self._name_of(self.mj.mjtObj.mjOBJ_EQUALITY, number, "equality")

    def _equalities(self) -> list[int]:
        """Numbers of those that hold."""
        if self._disabled("EQUALITY", "CONSTRAINT"):
            return []
        return [number for number in range(self.model.neq) if self.model.eq_active0[number]]

    def _read_joint_equalities(self) -> None:
        model, kinds, active = self.model, self.mj.mjtEq, self._equalities()
        if inactive := [number for number in range(model.neq) if number not in active]:
            names = self._listed(self.mj.mjtObj.mjOBJ_EQUALITY, inactive, "equality")
            self.document.warn(f"inactive, so left out: {names}")
        for number in active:
            kind = self.mj.mjtEq(int(model.eq_type[number]))
            if kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
                continue
            if kind != kinds.mjEQ_JOINT:
                what = kind.name.removeprefix("mjEQ_").lower()
                raise self._refuse(
                    f"{self._equality_name(number)} is of type {what}: connect, weld and linear joint equalities can "
                    "be expressed",
                    equality=number,
                )
            self._read_joint_equality(number)
        ends = {joint: self._leader(joint) for joint in self.follows}
        still = {joint: end.offset for joint, end in ends.items() if end.joint < 0}
        self.locked |= still
        self.follows = {joint: follows for joint, follows in self.follows.items() if joint not in still}

    def _read_joint_equality(self, number: int) -> None:
        model = self.model
        first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        constant, slope, *higher = (float(value) for value in model.eq_data[number][:5])
        if second >= 0 and any(higher):
            raise self._refuse(
                f"{self._equality_name(number)} is not linear (polycoef {constant:g} {slope:g} "
                f"{' '.join(f'{value:g}' for value in higher)}): only the first two coefficients can be expressed",
                equality=number,
                line=self._line_of(self.mj.mjtObj.mjOBJ_EQUALITY, number, "equality"),
            )
        start = constant + self._zero(first)
        if second < 0 or slope == 0.0:
            relation = _Follows(-1, 0.0, start)
        else:
            relation = _Follows(second, slope, start - slope * self._zero(second))
        self._relate(number, first, relation)

    def _zero(self, joint: int) -> float:
        """A hinge's or slide's coordinate where the bodies are as the file places them."""
        return float(self.model.qpos0[self.model.jnt_qposadr[joint]])

    def _leader(self, joint: int) -> _Follows:
        """A joint by the one that it follows in the end; joint -1 has coordinate 0."""
        multiplier, offset = 1.0, 0.0
        while (found := self.follows.get(joint)) is not None:
            multiplier, offset = multiplier * found.multiplier, offset + multiplier * found.offset
            joint = found.joint
        if joint in self.locked:
            return _Follows(-1, 0.0, offset + multiplier * self.locked[joint])
        return _Follows(joint, multiplier, offset)

    def _relate(self, number: int, first: int, relation: _Follows) -> None:
        """Add first = multiplier * other + offset to the mimics so that these stay a forest."""
        one = self._leader(first)
        other = _Follows(-1, 0.0, relation.offset)
        if relation.joint >= 0:
            end = self._leader(relation.joint)
            multiplier = relation.multiplier * end.multiplier
            other = _Follows(end.joint, multiplier, relation.offset + relation.multiplier * end.offset)
        if one.joint != other.joint and one.joint >= 0:
            # one.multiplier * a + one.offset = other.multiplier * b + other.offset
            multiplier = other.multiplier / one.multiplier
            offset = (other.offset - one.offset) / one.multiplier
            if other.joint >= 0:
                self.follows[one.joint] = _Follows(other.joint, multiplier, offset)
            else:
                self.locked[one.joint] = offset
        elif one.joint != other.joint:
            self.locked[other.joint] = (one.offset - other.offset) / other.multiplier
        else:
            slope = abs(one.multiplier - other.multiplier)
            miss = abs(one.offset - other.offset)
            if slope <= _SAME * abs(one.multiplier) and miss <= _SAME * max(1.0, abs(one.offset)):
                self.document.warn(f"{self._equality_name(number)} says what others say already: left out")
                return
            raise self._refuse(
                f"{self._equality_name(number)} contradicts the other joint equalities of joint "
                f"{self.joints[first]!r}, or holds it in place together with them: delete one of them",
                equality=number,
            )

    def _add_loops(self) -> None:
        kinds, names = self.mj.mjtEq, _Names(self._given(self.mj.mjtObj.mjOBJ_EQUALITY, self.model.neq))
        for number in self._equalities():
            kind = self.mj.mjtEq(int(self.model.eq_type[number]))
            if kind not in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
                continue
            data, weld = self.model.eq_data[number], kind == kinds.mjEQ_WELD
            given = self.mj.mj_id2name(self.model, self.mj.mjtObj.mjOBJ_EQUALITY, number)
            name = given or names.free(f"equality_{number}")
            # A weld without torque holds its point only.
            rigid = weld and float(data[10]) != 0.0
            loop = ElementTree.SubElement(self.root, "loop", name=name, type="fixed" if rigid else "spherical")
            ids = int(self.model.eq_obj1id[number]), int(self.model.eq_obj2id[number])
            ends: list[tuple[int, np.ndarray, np.ndarray]]
            if int(self.model.eq_objtype[number]) == int(self.mj.mjtObj.mjOBJ_SITE):
                ends = [self._site(site) for site in ids]
            elif weld:
                ends = [(ids[0], data[3:6], self._rotation(data[6:10])), (ids[1], data[:3], np.eye(3))]
            else:
                ends = [(ids[0], data[:3], np.eye(3)), (ids[1], data[3:6], np.eye(3))]
            for role, (body, position, rotation) in zip(("predecessor", "successor"), ends, strict=True):
                end = ElementTree.SubElement(loop, role, link=self.bodies[body])
                _add_origin(end, position, rotation)

    def _site(self, site: int) -> tuple[int, np.ndarray, np.ndarray]:
        """Body of a site, and its position and rotation there."""
        rotation = self._rotation(self.model.site_quat[site])
        return int(self.model.site_bodyid[site]), self.model.site_pos[site], rotation

    # actuators

    def _actuators(self) -> tuple[dict[int, tuple[float, float]], dict[int, str]]:
        """Least and greatest effort, N·m or N at the joint, and the actuator of each driven joint, both by joint."""
        model, kinds, objects = self.model, self.mj.mjtTrn, self.mj.mjtObj
        ranges: dict[int, tuple[float, float]] = {}
        drives: dict[int, list[int]] = {}
        dropped: list[int] = []
        inactive: list[int] = []
        armature = self._column("actuator_armature", self._actuator_count())
        damping = self._column("actuator_damping", self._actuator_count())
        for number in range(self._actuator_count()):
            kind, joint = self.mj.mjtTrn(int(model.actuator_trntype[number])), int(model.actuator_trnid[number][0])
            gear = float(model.actuator_gear[number][0])
            on_joint = kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT) and self._is_scalar(joint)
            if not on_joint or joint in self.locked or gear == 0.0:
                if not on_joint and (armature[number] or damping[number]):
                    raise self._refuse(
                        f"{self._name_of(objects.mjOBJ_ACTUATOR, number, 'actuator')} drives no single joint "
                        "and has armature or damping, which cannot be expressed: set them to 0"
                    )
                dropped.append(number)
                continue
            # A rotor turns, and its bearings brake, also where the file switches its force off.
            self.rotor[joint] += armature[number] * gear * gear
            self.motor_damping[joint] += damping[number] * gear * gear
            if not self._is_active(number):
                inactive.append(number)
                continue
            ends = sorted(gear * end for end in self._forces(number))
            before = ranges.get(joint, (0.0, 0.0))
            ranges[joint] = before[0] + ends[0], before[1] + ends[1]
            drives.setdefault(joint, []).append(number)
        for joint in range(model.njnt):
            if self._is_scalar(joint) and model.jnt_actfrclimited[joint]:
                lower, upper = ranges.get(joint, (-math.inf, math.inf))
                least, most = map(float, model.jnt_actfrcrange[joint])
                # As MuJoCo clamps: of a range beyond its own the joint gets the nearer end.
                ranges[joint] = min(max(lower, least), most), max(min(upper, most), least)
        for why, numbers in (
            ("they drive no single joint that moves", dropped),
            ("the file switches them off", inactive),
        ):
            if numbers:
                self.document.warn(f"left out, as {why}: {self._listed(objects.mjOBJ_ACTUATOR, numbers, 'actuator')}")
        return self._with_rest(ranges), self._merged(drives)

    def _is_active(self, number: int) -> bool:
        """Whether the file lets an actuator exert its force."""
        if self._disabled("ACTUATION"):
            return False
        group, switched_off = int(self.model.actuator_group[number]), int(self.model.opt.disableactuator)
        # MuJoCo can switch off groups 0 to 30 only.
        return not (0 <= group <= 30 and switched_off >> group & 1)

    def _with_rest(self, ranges: Mapping[int, tuple[float, float]]) -> dict[int, tuple[float, float]]:
        """Ranges of efforts as a description has them: no effort at all is within."""
        without = []
        efforts: dict[int, tuple[float, float]] = {}
        for joint, (lower, upper) in ranges.items():
            rounding = _SAME * max(abs(lower), abs(upper))
            if lower <= rounding and upper >= -rounding:
                efforts[joint] = min(lower, 0.0), max(upper, 0.0)
            else:
                efforts[joint] = 0.0, 0.0
                without.append(f"{lower:g} to {upper:g} at joint {self.joints[joint]!r}")
        if without:
            shown = ", ".join(without[:3]) + (f" and {len(without) - 3} more" if len(without) > 3 else "")
            self.document.warn(
                f"no effort of 0 is possible ({shown}), and the limits of a description always allow it: limited to 0 "
                "both ways, so that no effort counts as feasible; torque(.., bounds=(lower, upper)) takes both ends"
            )
        return efforts

    def _merged(self, drives: Mapping[int, Sequence[int]]) -> dict[int, str]:
        """One actuator for each joint, named after all that drive it."""
        given = self._given(self.mj.mjtObj.mjOBJ_ACTUATOR, self._actuator_count())
        names = _Names(given)
        driven: dict[int, str] = {}
        for joint, numbers in drives.items():
            parts = [given[number] or names.free(f"actuator_{number}") for number in numbers]
            if len(parts) == 1:
                driven[joint] = parts[0]
                continue
            driven[joint] = names.free("+".join(parts))
            self.document.warn(
                f"actuators {', '.join(map(repr, parts))} drive the same joint {self.joints[joint]!r}: taken as one, "
                f"{driven[joint]!r}, whose effort is the sum of theirs at the joint"
            )
        return driven

    def _actuator_count(self) -> int:
        return len(self.model.actuator_trntype)

    def _is_scalar(self, joint: int) -> bool:
        return self.kinds[joint] in (self.mj.mjtJoint.mjJNT_HINGE, self.mj.mjtJoint.mjJNT_SLIDE)

    def _forces(self, number: int) -> tuple[float, float]:
        """What an actuator can exert before its gear, as far as the file bounds it."""
        model = self.model
        lower, upper = -math.inf, math.inf
        if model.actuator_forcelimited[number]:
            lower, upper = (float(value) for value in model.actuator_forcerange[number])
        # A motor's force is its control times a gain.
        plain = (
            int(model.actuator_gaintype[number]) == int(self.mj.mjtGain.mjGAIN_FIXED)
            and int(model.actuator_biastype[number]) == int(self.mj.mjtBias.mjBIAS_NONE)
            and int(model.actuator_dyntype[number]) == int(self.mj.mjtDyn.mjDYN_NONE)
        )
        if plain and model.actuator_ctrllimited[number] and not self._disabled("CLAMPCTRL"):
            gain = float(model.actuator_gainprm[number][0])
            ends = sorted(gain * float(value) for value in model.actuator_ctrlrange[number])
            lower, upper = max(lower, ends[0]), min(upper, ends[1])
        return lower, upper

    # the tree

    def _rotation(self, quaternion: Any) -> np.ndarray:
        unit, matrix = np.array(quaternion, dtype=float), np.empty(9)
        self.mj.mju_normalize4(unit)
        self.mj.mju_quat2Mat(matrix, unit)
        return matrix.reshape(3, 3)

    def _turn(self, axis: np.ndarray, angle: float) -> np.ndarray:
        quaternion = np.empty(4)
        self.mj.mju_axisAngle2Quat(quaternion, np.array(axis, dtype=float), angle)
        return self._rotation(quaternion)

    def _add_link(self, body: int) -> None:
        model = self.model
        link = ElementTree.SubElement(self.root, "link", name=self.bodies[body])
        if body == 0 or (model.body_mass[body] == 0.0 and not np.any(model.body_inertia[body])):
            return
        inertial = ElementTree.SubElement(link, "inertial")
        _add_origin(inertial, model.body_ipos[body], self._rotation(model.body_iquat[body]))
        ElementTree.SubElement(inertial, "mass", value=_number(model.body_mass[body]))
        moments = dict(zip(("ixx", "iyy", "izz"), map(_number, model.body_inertia[body]), strict=True))
        ElementTree.SubElement(inertial, "inertia", moments | {"ixy": "0", "ixz": "0", "iyz": "0"})

    def _add_joints(self, body: int, efforts: Mapping[int, tuple[float, float]]) -> None:
        """The chain from a body's parent to the body."""
        model, name = self.model, self.bodies[body]
        parent = self.bodies[int(model.body_parentid[body])]
        position, rotation = np.array(model.body_pos[body]), self._rotation(model.body_quat[body])
        first = int(model.body_jntadr[body])
        numbers = range(first, first + int(model.body_jntnum[body]))
        if not numbers:
            if model.body_mocapid[body] >= 0:
                self.document.warn(f"body {name!r} is moved by motion capture (mocap): fixed where the file places it")
            self._add_weld(f"{name}_fixed", parent, name, position, rotation)
            return
        if self.kinds[first] == self.mj.mjtJoint.mjJNT_FREE:
            # Its coordinates are the body's pose in the world.
            self._add_joint(first, "floating", parent, name, np.zeros(3), np.eye(3))
            return
        # Between joints the frames have the body's axes; each has its origin in the anchor of the joint before.
        anchor = np.zeros(3)
        for number in numbers:
            here = np.array(model.jnt_pos[number])
            last = number == numbers[-1] and not np.any(here)
            child = name if last else self.links.free(f"{self.joints[number]}_link")
            if not last:
                ElementTree.SubElement(self.root, "link", name=child)
            self._add_moving(number, parent, child, position + rotation @ (here - anchor), rotation, efforts)
            parent, position, rotation, anchor = child, np.zeros(3), np.eye(3), here
        if parent != name:
            self._add_weld(f"{name}_frame", parent, name, -anchor, np.eye(3))

    def _add_weld(self, name: str, parent: str, child: str, position: np.ndarray, rotation: np.ndarray) -> None:
        joint = ElementTree.SubElement(self.root, "joint", name=self.joint_names.free(name), type="fixed")
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        _add_origin(joint, position, rotation)

    def _add_joint(
        self, number: int, kind: str, parent: str, child: str, position: np.ndarray, rotation: np.ndarray
    ) -> ElementTree.Element:
        joint = ElementTree.SubElement(self.root, "joint", name=self.joints[number], type=kind)
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        _add_origin(joint, position, rotation)
        return joint

    def _add_moving(
        self,
        number: int,
        parent: str,
        child: str,
        position: np.ndarray,
        rotation: np.ndarray,
        efforts: Mapping[int, tuple[float, float]],
    ) -> None:
        """A hinge, slide or ball joint, or what a joint equality locks."""
        model = self.model
        if self.kinds[number] == self.mj.mjtJoint.mjJNT_BALL:
            joint = self._add_joint(number, "floating", parent, child, position, rotation)
            replace_by_chain(self.root, joint, turns(_BALL_AXES))
            if model.jnt_limited[number]:
                self.document.warn(
                    f"the range of ball joint {self.joints[number]!r} is left out: it bounds no coordinate of its own"
                )
            return
        slides = self.kinds[number] == self.mj.mjtJoint.mjJNT_SLIDE
        axis = np.array(model.jnt_axis[number])
        # The bodies are as the file places them where the coordinate is qpos0.
        shift = self.locked.get(number, 0.0) - self._zero(number)
        if slides:
            position = position + rotation @ (shift * axis)
        else:
            rotation = rotation @ self._turn(axis, shift)
        if number in self.locked:
            self._add_joint(number, "fixed", parent, child, position, rotation)
            return
        limited = bool(model.jnt_limited[number]) and not self._disabled("LIMIT", "CONSTRAINT")
        ends = np.isfinite(model.jnt_range[number])
        limited = limited and bool(ends.any())
        if limited and not ends.all():
            raise self._refuse(
                f"the range of joint {self.joints[number]!r} has one end only: give both, or none",
                joint=self.joints[number],
            )
        kind = "prismatic" if slides else ("revolute" if limited else "continuous")
        joint = self._add_joint(number, kind, parent, child, position, rotation)
        ElementTree.SubElement(joint, "axis", xyz=_numbers(axis))
        bounds = dict(zip(("lower", "upper"), map(_number, model.jnt_range[number]), strict=True)) if limited else {}
        bounds |= _effort_attributes(*efforts.get(number, (-math.inf, math.inf)))
        if bounds:
            ElementTree.SubElement(joint, "limit", bounds)
        self._add_dynamics(joint, number)
        if (follows := self.follows.get(number)) is not None:
            ElementTree.SubElement(
                joint,
                "mimic",
                joint=self.joints[follows.joint],
                multiplier=_number(follows.multiplier),
                offset=_number(follows.offset),
            )

    def _add_dynamics(self, joint: ElementTree.Element, number: int) -> None:
        dof = int(self.model.jnt_dofadr[number])
        damping = float(np.ravel(self.model.dof_damping[dof])[0]) + float(self.motor_damping[number])
        values = {
            "damping": 0.0 if self._ignores("damping") else damping,
            "friction": 0.0 if self._ignores("frictionloss") else float(self.model.dof_frictionloss[dof]),
            "armature": float(self.model.dof_armature[dof]) + float(self.rotor[number]),
        }
        if any(values.values()):
            ElementTree.SubElement(joint, "dynamics", {name: _number(value) for name, value in values.items()})

    def _add_sites(self) -> None:
        given = self._given(self.mj.mjtObj.mjOBJ_SITE, self.model.nsite)
        bodies = frozenset(self.links.taken)
        self.links.taken.update(name for name in given if name)
        for number, name in enumerate(given):
            if not name:
                continue
            body, position, rotation = self._site(number)
            link = self.links.free(f"{name}_site") if name in bodies else name
            ElementTree.SubElement(self.root, "link", name=link)
            self._add_weld(f"{link}_fixed", self.bodies[body], link, position, rotation)

    # poses

    def _add_configurations(self) -> None:
        given = self._given(self.mj.mjtObj.mjOBJ_KEY, self.model.nkey)
        names = _Names(given)
        poses = [
            (name or names.free(f"key_{number}"), self.model.key_qpos[number]) for number, name in enumerate(given)
        ]
        for name, qpos in sorted(poses or [("home", self.model.qpos0)], key=lambda pose: pose[0] != "home"):
            values = self._coordinates(np.asarray(qpos, dtype=float))
            if not values:
                return
            configuration = ElementTree.SubElement(self.root, "configuration", name=name)
            for joint, value in values.items():
                ElementTree.SubElement(configuration, "joint", name=joint, value=_number(value))

    def _coordinates(self, qpos: np.ndarray) -> dict[str, float]:
        """Coordinates of our joints for MuJoCo's."""
        values: dict[str, float] = {}
        for number, kind in enumerate(self.kinds):
            start, name = int(self.model.jnt_qposadr[number]), self.joints[number]
            if self._is_scalar(number):
                if number not in self.locked:
                    values[name] = float(qpos[start])
                continue
            found: tuple[float, ...]
            if kind == self.mj.mjtJoint.mjJNT_BALL:
                found = _ball_angles(self._rotation(qpos[start : start + 4]))
            else:
                roll, pitch, yaw = _roll_pitch_yaw(self._rotation(qpos[start + 3 : start + 7]))
                found = (*map(float, qpos[start : start + 3]), yaw, pitch, roll)
            values |= zip((f"{name}{suffix}" for suffix in self._suffixes(number)), found, strict=True)
        # MuJoCo lets a pose break its soft equalities.
        for number in self.follows:
            end = self._leader(number)
            values[self.joints[number]] = end.multiplier * values[self.joints[end.joint]] + end.offset
        return values


def _number(value: float) -> str:
    value = float(value)
    return repr(int(value)) if value.is_integer() and abs(value) < 1e6 else repr(value)


def _effort_attributes(lower: float, upper: float) -> dict[str, str]:
    """Attributes of ``<limit>`` for a range of efforts, N·m or N; none where there is no end."""
    found = {} if math.isinf(upper) else {"effort": _number(upper)}
    if lower != -upper:
        # No attribute says that only the lower end is infinite.
        found["effort_lower"] = _number(max(lower, -sys.float_info.max))
    return found


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(_number, values))


def _add_origin(element: ElementTree.Element, position: np.ndarray, rotation: np.ndarray) -> None:
    rpy = (0.0, 0.0, 0.0) if np.array_equal(rotation, np.eye(3)) else _roll_pitch_yaw(rotation)
    if np.any(position) or any(rpy):
        ElementTree.SubElement(element, "origin", xyz=_numbers(position), rpy=_numbers(rpy))


def _roll_pitch_yaw(rotation: np.ndarray) -> tuple[float, float, float]:
    """Angles of Rz(yaw) Ry(pitch) Rx(roll), exact at a pitch of a right angle too, where one of many yaws is taken."""
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    roll = math.atan2(s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1])
    return roll, pitch, yaw


def _ball_angles(rotation: np.ndarray) -> tuple[float, float, float]:
    """Angles x, y, z of Rx(x) Ry(y) Rz(z), the chain ``turns("xyz")``."""
    # The inverse is Rz(-z) Ry(-y) Rx(-x).
    roll, pitch, yaw = _roll_pitch_yaw(rotation.T)
    return -roll, -pitch, -yaw
