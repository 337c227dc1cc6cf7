"""Hexapod leg's numbers from a URDF+ file, and the check that the file is the mechanism of the formulas."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leg_dynamics.closed_form.hexapod_leg import (
    BODY_NAMES,
    JOINT_NAMES,
    TREE_JOINT_NAMES,
    HexapodLeg,
)
from leg_dynamics.closed_form.reading import FileReader
from leg_dynamics.description.topology import split_independent

if TYPE_CHECKING:
    from leg_dynamics.closed_form.rigid_body import Body
    from leg_dynamics.description.model import Description, Loop, LoopEnd

_X, _Y, _Z = np.eye(3)
_STRUTS = (1, 2, 3)
_AXES = {"alpha": _X, "beta": _Y, "l": _Z}
_HINGES = ("revolute", "continuous")


class _Lengths(NamedTuple):
    a: float
    b: float
    c: float
    e: float
    side: float


def _text(vector: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.12g}" for value in vector) + ")"


class _Reader(FileReader):
    def check_positive(self, name: str, value: float) -> None:
        if value <= self.tolerance:
            raise self.broken(f"the length {name} (m)", value, "a positive one", self.tolerance)

    def check_not_negative(self, name: str, value: float) -> None:
        if value < -self.tolerance:
            raise self.broken(f"the length {name} (m)", value, "one that is not negative", self.tolerance)

    def check_place(self, element: str, found: np.ndarray, expected: np.ndarray) -> None:
        if np.linalg.norm(found - expected) > self.tolerance:
            raise self.broken(f"{element} in the hip frame (m)", _text(found), _text(expected), self.tolerance)

    def check_direction(self, element: str, found: np.ndarray, expected: np.ndarray) -> None:
        if np.linalg.norm(found - expected) > self.tolerance:
            raise self.broken(f"the axis of {element} in the hip frame", _text(found), _text(expected), self.tolerance)

    def check_tree(self) -> None:
        description, pose = self.description, self.pose
        moving = {joint.name: joint for joint in description.moving_joints}
        for i in _STRUTS:
            links = ("hip", f"cross_{i}", f"sleeve_{i}", f"rod_{i}")
            for kind, parent, child in zip(("alpha", "beta", "l"), links, links[1:], strict=False):
                name, types = f"{kind}{i}", ("prismatic",) if kind == "l" else _HINGES
                joint = moving.get(name)
                if joint is None:
                    raise self.broken(f"joint {name!r}", "missing or fixed", f"a {types[0]} joint")
                if joint.type not in types:
                    raise self.broken(f"the type of joint {name!r}", joint.type, " or ".join(types))
                found = pose.body_of(joint.parent, self.bodies), pose.body_of(joint.child, self.bodies)
                if found != (parent, child):
                    raise self.broken(
                        f"joint {name!r}", f"from {joint.parent!r} to {joint.child!r}", f"from {parent!r} to {child!r}"
                    )
        for name, joint in moving.items():
            if name not in TREE_JOINT_NAMES:
                raise self.broken(f"joint {name!r}", f"a further moving joint ({joint.type})", "none or fixed")
            if joint.mimic is not None:
                raise self.broken(f"joint {name!r}", f"a mimic of {joint.mimic.joint!r}", "free (loops say the rest)")
        for joint in description.path("hip"):
            if joint.type != "fixed":
                raise self.broken(f"joint {joint.name!r} above the hip", joint.type, "fixed")
        if (carrier := pose.body_of("foot", self.bodies)) != "rod_1":
            raise self.broken("link 'foot'", f"on {carrier!r}", "fixed to 'rod_1'")
        for coupling in description.couplings:
            raise self.broken(f"coupling {coupling.name!r}", "present", "none")
        independent, _ = split_independent(description)
        if independent != JOINT_NAMES:
            raise self.broken("the list of independent joints", ", ".join(independent), ", ".join(JOINT_NAMES))

    def loops(self) -> tuple[Loop, Loop]:
        """The hinge B2 and the ball B3."""
        wanted = {frozenset({"sleeve_1", "rod_2"}): _HINGES, frozenset({"rod_1", "rod_3"}): ("spherical",)}
        found: dict[frozenset[str], Loop] = {}
        for loop in self.description.loops:
            ends = frozenset(self.pose.body_of(end.link, self.bodies) for end in (loop.predecessor, loop.successor))
            if ends not in wanted or ends in found:
                raise self.broken(
                    f"loop {loop.name!r}", f"between {' and '.join(sorted(ends))}", "one of the leg's two loops"
                )
            if loop.type not in wanted[ends]:
                raise self.broken(f"the type of loop {loop.name!r}", loop.type, " or ".join(wanted[ends]))
            found[ends] = loop
        for ends in wanted:
            if ends not in found:
                raise self.broken(f"the loop between {' and '.join(sorted(ends))}", "missing", "present")
        hinge, ball = (found[ends] for ends in wanted)
        return hinge, ball

    def end_on(self, loop: Loop, body: str) -> LoopEnd:
        ends = (loop.predecessor, loop.successor)
        return next(end for end in ends if self.pose.body_of(end.link, self.bodies) == body)

    def place(self, end: LoopEnd) -> np.ndarray:
        """Where a loop end is while all coordinates are zero, m."""
        return self.pose.loop_end(end, _X)[0]

    def lengths(self, hinge: Loop, ball: Loop) -> _Lengths:
        first, third = self.place(self.end_on(hinge, "sleeve_1")), self.place(self.end_on(ball, "rod_1"))
        a3 = self.pose.joint_centre("alpha3")
        return _Lengths(
            a=float(self.pose.joint_centre("alpha2")[0]),
            b=float(first[0]),
            c=float(abs(third[1])),
            e=float(first[2]),
            side=-1.0 if a3[1] < 0.0 else 1.0,
        )

    def check_geometry(self, lengths: _Lengths, hinge: Loop, ball: Loop) -> None:
        a, b, c, e, side = lengths
        self.check_positive("a", a)
        hips = (np.zeros(3), a * _X, side * a * _Y)
        for i, hip in zip(_STRUTS, hips, strict=True):
            for kind, axis in _AXES.items():
                name = f"{kind}{i}"
                self.check_place(f"the centre of joint {name!r}", self.pose.joint_centre(name), hip)
                self.check_direction(f"joint {name!r}", self.pose.joint_axis(name), axis)
        self.check_positive("e", e)
        for name, value in (("b", b), ("c", c)):
            self.check_not_negative(name, value)
        self.check_place("the origin of link 'foot'", self.pose.transform("foot")[:3, 3], hips[0])
        self.check_place(f"loop {hinge.name!r} on strut 1", self.place(self.end_on(hinge, "sleeve_1")), b * _X + e * _Z)
        self.check_place(f"loop {hinge.name!r} on strut 2", self.place(self.end_on(hinge, "rod_2")), hips[1])
        self.check_place(f"loop {ball.name!r} on strut 1", self.place(self.end_on(ball, "rod_1")), side * c * _Y)
        self.check_place(f"loop {ball.name!r} on strut 3", self.place(self.end_on(ball, "rod_3")), hips[2])
        assert hinge.axis is not None
        axes = [self.pose.loop_end(end, hinge.axis)[1] for end in (hinge.predecessor, hinge.successor)]
        for axis in axes:
            self.check_direction(f"loop {hinge.name!r}", axis if axes[0] @ _Y > 0.0 else -axis, _Y)

    def inertias(self, lengths: _Lengths) -> tuple[Body, ...]:
        hips = (np.zeros(3), lengths.a * _X, lengths.side * lengths.a * _Y)
        origins = {name: hips[int(name[-1]) - 1] for name in BODY_NAMES}
        return self.merged_bodies(dict.fromkeys(BODY_NAMES, np.eye(3)), origins)


def read(description: Description, tolerance: float) -> HexapodLeg:
    """Check the file and return its numbers; see `leg_dynamics.closed_form.hexapod_leg.from_urdf`."""
    reader = _Reader(description, tolerance, BODY_NAMES, ("foot",))
    reader.check_tree()
    hinge, ball = reader.loops()
    lengths = reader.lengths(hinge, ball)
    reader.check_geometry(lengths, hinge, ball)
    return HexapodLeg(
        **lengths._asdict(),
        bodies=reader.inertias(lengths),
        gravity=reader.gravity(),
        drive_mass=reader.drive_inertia(JOINT_NAMES),
        dissipation=reader.dissipation(TREE_JOINT_NAMES),
    )
