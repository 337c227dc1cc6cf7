"""OmniLeg's numbers from a URDF+ file, and the check that the file is the mechanism of the formulas."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leg_dynamics.closed_form.omnileg import (
    BODY_NAMES,
    JOINT_NAMES,
    TREE_JOINT_NAMES,
    OmniLeg,
)
from leg_dynamics.closed_form.reading import FileReader
from leg_dynamics.description.topology import split_independent

if TYPE_CHECKING:
    from leg_dynamics.closed_form.rigid_body import Body
    from leg_dynamics.description.model import Description, Loop

_X, _Y, _Z = np.eye(3)
_HINGES = ("revolute", "continuous")
_CHAINS = (1, 2, 3)

_PARENT_AND_CHILD = {
    "alpha": ("hip", "cross_A2"),
    "beta": ("hip", "cross_A1"),
    "gamma": ("hip", "input_shaft"),
    "theta12": ("cross_A1", "rod_A1B1"),
    "theta13": ("rod_A1B1", "cross_B1"),
    "theta14": ("cross_B1", "knee"),
    "theta22": ("cross_A2", "rod_A2B2"),
    "theta23": ("rod_A2B2", "cross_B2"),
    "theta31": ("hip", "cross_A3"),
    "theta32": ("cross_A3", "rod_A3B3"),
    "theta33": ("rod_A3B3", "cross_B3"),
    "cardan_A4_y": ("input_shaft", "cross_A4"),
    "cardan_A4_x": ("cross_A4", "shaft_A4B4"),
    "gamma_output": ("knee", "output_shaft"),
    "cardan_B4_y": ("output_shaft", "cross_B4"),
    "gamma_C1": ("knee", "link_C1D1"),
    "gamma_C2": ("knee", "link_C2D2"),
    "gamma_C3": ("knee", "link_C3D3"),
    "phi_D1": ("link_C1D1", "link_D1E1"),
    "phi_D2": ("link_C2D2", "link_D2E2"),
    "phi_D3": ("link_C3D3", "link_D3E3"),
    "epsilon_E1": ("link_D1E1", "foot"),
}


class _Lengths(NamedTuple):
    L1: float
    L3: float
    L4: float
    L5: float
    R_C: float
    psi: tuple[float, float, float]


class _Line(NamedTuple):
    point: np.ndarray
    direction: np.ndarray


def _text(vector: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.12g}" for value in vector) + ")"


class _Reader(FileReader):
    def check_line(self, element: str, centre: np.ndarray, axis: np.ndarray, line: _Line, *, signed: bool) -> None:
        expected = line.direction
        aligned = axis if signed or axis @ expected >= 0.0 else -axis
        if np.linalg.norm(aligned - expected) > self.tolerance:
            raise self.broken(f"the axis of {element} in the hip frame", _text(axis), _text(expected), self.tolerance)
        offset = centre - line.point
        if np.linalg.norm(offset - (offset @ expected) * expected) > self.tolerance:
            raise self.broken(
                f"the centre of {element} in the hip frame (m)",
                _text(centre),
                f"a point on the line through {_text(line.point)} along {_text(expected)}",
                self.tolerance,
            )

    def check_tree(self) -> None:
        description, pose = self.description, self.pose
        moving = {joint.name: joint for joint in description.moving_joints}
        for name in TREE_JOINT_NAMES:
            if name not in moving:
                raise self.broken(f"joint {name!r}", "missing or fixed", "a hinge")
            joint = moving[name]
            if joint.type not in _HINGES:
                raise self.broken(f"the type of joint {name!r}", joint.type, "revolute or continuous")
            found = pose.body_of(joint.parent, self.bodies), pose.body_of(joint.child, self.bodies)
            if found != _PARENT_AND_CHILD[name]:
                raise self.broken(
                    f"joint {name!r}",
                    f"from {joint.parent!r} to {joint.child!r}",
                    "from {!r} to {!r}".format(*_PARENT_AND_CHILD[name]),
                )
        for name, joint in moving.items():
            if name not in TREE_JOINT_NAMES:
                raise self.broken(f"joint {name!r}", f"a further moving joint ({joint.type})", "none or fixed")
            if joint.mimic is not None:
                raise self.broken(
                    f"joint {name!r}", f"a mimic of {joint.mimic.joint!r}", "free (loops and couplings say the rest)"
                )
        for i in _CHAINS:
            carrier, joint = pose.carrier_of(f"driven_gear_{i}", self.bodies)
            if carrier != f"link_C{i}D{i}" or joint.type != "fixed":
                raise self.broken(
                    f"link 'driven_gear_{i}'", f"on {carrier!r} ({joint.type})", f"fixed to 'link_C{i}D{i}'"
                )
        for joint in description.path("hip"):
            if joint.type != "fixed":
                raise self.broken(f"joint {joint.name!r} above the hip", joint.type, "fixed")
        independent, _ = split_independent(description)
        if independent != JOINT_NAMES:
            raise self.broken("the list of independent joints", ", ".join(independent), ", ".join(JOINT_NAMES))

    def lengths(self) -> _Lengths:
        pose = self.pose
        directions = [pose.joint_axis(f"gamma_C{i}") for i in _CHAINS]
        return _Lengths(
            L1=float(pose.joint_offset("theta12", "theta13")[2]),
            L3=float(pose.joint_centre("theta12")[1]),
            L4=float(pose.joint_offset("gamma_C1", "phi_D1")[2]),
            L5=float(pose.joint_offset("theta14", "gamma_C1")[2]),
            R_C=float(pose.joint_centre("gamma_C1") @ directions[0]),
            psi=tuple(float(np.arctan2(axis[1], axis[0])) for axis in directions),  # type: ignore[arg-type]
        )

    def check_axes(self, lengths: _Lengths) -> None:
        l1, l3 = lengths.L1, lengths.L3
        for name in ("L1", "L3", "L4"):
            value = getattr(lengths, name)
            if value <= self.tolerance:
                raise self.broken(f"the length {name} (m)", value, "positive", self.tolerance)
        a1, a2, a3 = l3 * _Y, l3 * _X, -l3 * _Y
        down, o0 = l1 * _Z, np.zeros(3)
        lines = {
            "alpha": _Line(a2, _X),
            "beta": _Line(a1, _Y),
            "gamma": _Line(o0, _Z),
            "theta12": _Line(a1, _X),
            "theta13": _Line(a1 + down, _X),
            "theta14": _Line(a1 + down, _Y),
            "theta22": _Line(a2, -_Y),
            "theta23": _Line(a2 + down, -_Y),
            "theta31": _Line(a3, -_Y),
            "theta32": _Line(a3, -_X),
            "theta33": _Line(a3 + down, -_X),
            "cardan_A4_y": _Line(o0, _Y),
            "cardan_A4_x": _Line(o0, _X),
            "gamma_output": _Line(down, _Z),
            "cardan_B4_y": _Line(down, _Y),
        }
        for i, chain in enumerate(self.chains(lengths), 1):
            lines |= {f"gamma_C{i}": chain[0], f"phi_D{i}": chain[1]}
        lines["epsilon_E1"] = self.chains(lengths)[0][2]
        for name, line in lines.items():
            self.check_line(
                f"joint {name!r}", self.pose.joint_centre(name), self.pose.joint_axis(name), line, signed=True
            )
        for i in _CHAINS:
            radius = float(self.pose.joint_centre(f"gamma_C{i}") @ self.pose.joint_axis(f"gamma_C{i}"))
            if abs(radius - lengths.R_C) > self.tolerance:
                raise self.broken(f"the radius of joint 'gamma_C{i}' (m)", radius, lengths.R_C, self.tolerance)
        foot = self.pose.transform("foot")[:3, 3]
        expected = self.foot(lengths)
        if np.linalg.norm(foot - expected) > self.tolerance:
            raise self.broken(
                "the origin of link 'foot' in the hip frame (m)", _text(foot), _text(expected), self.tolerance
            )

    @staticmethod
    def foot(lengths: _Lengths) -> np.ndarray:
        return (lengths.L1 + lengths.L5 + 2.0 * lengths.L4) * _Z

    @staticmethod
    def chains(lengths: _Lengths) -> list[tuple[_Line, _Line, _Line]]:
        """Hinge lines C_i, D_i, E_i of the three shank chains."""
        chains = []
        for psi in lengths.psi:
            direction = np.array([np.cos(psi), np.sin(psi), 0.0])
            centre = lengths.R_C * direction + (lengths.L1 + lengths.L5) * _Z
            c, d, e = (_Line(centre + n * lengths.L4 * _Z, direction) for n in (0, 1, 2))
            chains.append((c, d, e))
        return chains

    def check_loops(self, lengths: _Lengths) -> None:
        down = lengths.L1 * _Z
        chains = self.chains(lengths)
        wanted = {
            frozenset({"knee", "cross_B2"}): _Line(lengths.L3 * _X + down, _X),
            frozenset({"knee", "cross_B3"}): _Line(-lengths.L3 * _Y + down, _Y),
            frozenset({"shaft_A4B4", "cross_B4"}): _Line(down, _X),
            frozenset({"link_D2E2", "foot"}): chains[1][2],
            frozenset({"link_D3E3", "foot"}): chains[2][2],
        }
        found: dict[frozenset[str], Loop] = {}
        for loop in self.description.loops:
            ends = frozenset(self.pose.body_of(end.link, self.bodies) for end in (loop.predecessor, loop.successor))
            if ends not in wanted or ends in found:
                raise self.broken(
                    f"loop {loop.name!r}", f"between {' and '.join(sorted(ends))}", "one of the five loops of the leg"
                )
            found[ends] = loop
        for ends, line in wanted.items():
            if ends not in found:
                raise self.broken(f"the loop between {' and '.join(sorted(ends))}", "missing", "present")
            self.check_loop(found[ends], line)

    def check_loop(self, loop: Loop, line: _Line) -> None:
        if loop.type not in _HINGES or loop.axis is None:
            raise self.broken(f"the type of loop {loop.name!r}", loop.type, "revolute or continuous")
        centres = []
        for side in ("predecessor", "successor"):
            centre, axis = self.pose.loop_end(getattr(loop, side), loop.axis)
            self.check_line(f"loop {loop.name!r} at its {side}", centre, axis, line, signed=False)
            centres.append((centre, axis))
        (first, axis), (second, other) = centres
        gap = float(np.linalg.norm(first - second))
        if axis @ other < 0.0:
            raise self.broken(
                f"the axis of loop {loop.name!r} in the zero pose", "opposite at its two ends", "the same"
            )
        if gap > self.tolerance:
            raise self.broken(f"the gap (m) of loop {loop.name!r} in the zero pose", gap, "closed", self.tolerance)

    def check_couplings(self) -> None:
        found = set()
        for coupling in self.description.couplings:
            paths = [
                {joint.name for joint in self.description.path(link) if joint.type != "fixed"}
                for link in (coupling.predecessor, coupling.successor)
            ]
            driver, driven = paths[0] - paths[1], paths[1] - paths[0]
            if driven == {"gamma_output"}:
                driver, driven = driven, driver
            wanted = next((i for i in _CHAINS if driven == {f"gamma_C{i}"}), None)
            if driver != {"gamma_output"} or wanted is None or wanted in found:
                raise self.broken(
                    f"coupling {coupling.name!r}",
                    f"between {coupling.predecessor!r} and {coupling.successor!r}",
                    "one of the bevel gear pairs from 'output_shaft' to 'driven_gear_1', 2, 3",
                )
            if abs(coupling.ratio - 1.0) > self.tolerance:
                raise self.broken(f"the ratio of coupling {coupling.name!r}", coupling.ratio, 1.0, self.tolerance)
            found.add(wanted)
        for i in _CHAINS:
            if i not in found:
                raise self.broken(f"the coupling between 'output_shaft' and 'driven_gear_{i}'", "missing", "present")

    def inertias(self, lengths: _Lengths) -> tuple[Body, ...]:
        down, o0 = lengths.L1 * _Z, np.zeros(3)
        origins = dict.fromkeys(("input_shaft", "cross_A4", "shaft_A4B4"), o0)
        origins |= dict.fromkeys(("knee", "cross_B4", "output_shaft"), down)
        origins["foot"] = self.foot(lengths)
        for k, direction in enumerate((_Y, _X, -_Y), 1):
            centre = lengths.L3 * direction
            origins |= {f"cross_A{k}": centre, f"rod_A{k}B{k}": centre, f"cross_B{k}": centre + down}
        rotations = dict.fromkeys(origins, np.eye(3))
        for i, (c, d, _) in enumerate(self.chains(lengths), 1):
            turn = np.column_stack((c.direction, np.cross(_Z, c.direction), _Z))
            for name, line in ((f"driven_gear_{i}", c), (f"link_C{i}D{i}", c), (f"link_D{i}E{i}", d)):
                origins[name], rotations[name] = line.point, turn
        return self.merged_bodies(rotations, origins)


def read(description: Description, tolerance: float) -> OmniLeg:
    """Check the file and return its numbers; see `leg_dynamics.closed_form.omnileg.from_urdf`."""
    reader = _Reader(description, tolerance, BODY_NAMES)
    reader.check_tree()
    lengths = reader.lengths()
    reader.check_axes(lengths)
    reader.check_loops(lengths)
    reader.check_couplings()
    return OmniLeg(
        **lengths._asdict(),
        bodies=reader.inertias(lengths),
        gravity=reader.gravity(),
        rotor_inertia=reader.drive_inertia(JOINT_NAMES),
        dissipation=reader.dissipation(TREE_JOINT_NAMES),
    )
