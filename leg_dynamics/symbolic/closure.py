"""Loop-closure rows: components of vectors that vanish on a closed loop, in the axes of any body of that loop.

A loop's translation rows are components of the vector from the predecessor's to the successor's loop frame, its
rotation rows components of the successor's axes in the predecessor's frame (or of the difference of the two hinge
axes). Each may be written in the axes of every body of the loop: on the closed surface all say the same, but they
differ in cost, and in which pivots stay large. Rows are dimensionless: lengths over the mechanism's characteristic
length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leg_dynamics.description.model import Description, Loop
from leg_dynamics.errors import DescriptionError
from leg_dynamics.symbolic.motion import Frames, Motion, Position
from leg_dynamics.symbolic.scalars import (
    IDENTITY,
    Matrix,
    Scalar,
    Vector,
    mul,
)
from leg_dynamics.symbolic.tree import GROUND, Placement, Tree

__all__ = ["Closure", "Row", "evaluate_rows"]

X, Y, Z = 0, 1, 2
UNITS: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
TRANSLATIONS = {
    "revolute": (X, Y, Z),
    "continuous": (X, Y, Z),
    "spherical": (X, Y, Z),
    "universal": (X, Y, Z),
    "fixed": (X, Y, Z),
    "prismatic": (X, Y),
    "planar": (Z,),
}
SAME_AXIS = ((X, Z), (Y, Z))
SAME_ORIENTATION = ((X, Y), (Y, Z), (Z, X))
# Pairs (predecessor's axis, successor's axis) that stay at right angles.
ROTATIONS: dict[str, tuple[tuple[int, int], ...]] = {
    "revolute": SAME_AXIS,
    "continuous": SAME_AXIS,
    "spherical": (),
    "universal": ((X, Y),),
    "fixed": SAME_ORIENTATION,
    "prismatic": SAME_ORIENTATION,
    "planar": SAME_AXIS,
}
# Axes that point the same way on a closed loop: the rotation rows vanish for the opposite way too.
SAME_WAY: dict[str, tuple[int, ...]] = {
    "revolute": (Z,),
    "continuous": (Z,),
    "spherical": (),
    "universal": (),
    "fixed": (X, Y, Z),
    "prismatic": (X, Y, Z),
    "planar": (Z,),
}


@dataclass(frozen=True, eq=False)
class Row:
    """One component of a vector that vanishes: `scale` makes it dimensionless.

    `reference` names the loop and the frame whose axes it is written in.
    """

    name: str
    vector: Position
    component: int
    scale: float
    reference: tuple[object, ...]

    @property
    def cost(self) -> int:
        """A measure of the work to evaluate it."""
        return self.vector.cost


class Closure:
    """The rows of every loop of a description.

    Parameters
    ----------
    description : Description
    tree : Tree

    Attributes
    ----------
    basic : list of Row
        One set that says all a loop says, in the predecessor's loop frame: residuals and ranks are taken from these.
    candidates : list of Row
        The same in other axes too, to choose independent rows from.
    same_way : list of Row
        Their value is the cosine between axes that must point the same way, 1 on a closed loop.
    """

    def __init__(self, description: Description, tree: Tree) -> None:
        self.tree = tree
        self._frames: dict[tuple[object, ...], Frames] = {}
        self.basic: list[Row] = []
        self.candidates: list[Row] = []
        self.same_way: list[Row] = []
        for loop in description.loops:
            if loop.type not in TRANSLATIONS:
                raise DescriptionError(f"loop {loop.name!r} has unsupported type {loop.type!r}", line=loop.line)
            self._add(loop)

    def frames(self, body: int = GROUND, axes: Matrix = IDENTITY) -> Frames:
        """Frames relative to axes fixed on a body, shared between loops."""
        key = (body, tuple(round(x, 12) for row in axes for x in row))
        if key not in self._frames:
            self._frames[key] = Frames(self.tree, body, axes)
        return self._frames[key]

    def _add(self, loop: Loop) -> None:
        predecessor = self.tree.ends[loop.name, "predecessor"]
        successor = self.tree.ends[loop.name, "successor"]
        basic = self._in_end_frame(loop, predecessor, successor, mirrored=False)
        self.basic += basic
        rows = list(basic)
        symmetric = loop.type in ("revolute", "continuous", "planar", "fixed", "prismatic")
        if symmetric:
            rows += self._in_end_frame(loop, successor, predecessor, mirrored=True)
        one, other = self.tree.ancestors(predecessor.body), self.tree.ancestors(successor.body)
        shared = set(one) & set(other)
        nearest = next(body for body in one if body in shared)
        around = [*one[: one.index(nearest) + 1], *other[: other.index(nearest)]]
        for body in around:
            frames = self.frames(body)
            reference = (loop.name, body)
            where = self.tree.name_of(body)
            start, first = frames.place(predecessor)
            end, second = frames.place(successor)
            if len(TRANSLATIONS[loop.type]) == 3:
                gap = second.minus(first)
                rows += self._components(
                    f"{loop.name}:gap in {where}", gap, (X, Y, Z), 1.0 / self.tree.length, reference
                )
            if ROTATIONS[loop.type] == SAME_AXIS:
                difference = Position(1.0).plus(end, UNITS[Z]).minus(Position(1.0).plus(start, UNITS[Z]))
                rows += self._components(f"{loop.name}:axes in {where}", difference, (X, Y, Z), 1.0, reference)
        self.candidates += [row for row in rows if row.vector.terms]
        frames = self.frames(predecessor.body, predecessor.rotation)
        orientation, _ = frames.place(successor)
        for axis in SAME_WAY[loop.type]:
            vector = Position(1.0).plus(orientation, UNITS[axis])
            self.same_way.append(Row(f"{loop.name}:same {'xyz'[axis]}", vector, axis, 1.0, (loop.name,)))

    @staticmethod
    def _components(
        name: str, vector: Position, components: Sequence[int], scale: float, reference: tuple[object, ...]
    ) -> list[Row]:
        return [Row(f"{name}.{'xyz'[i]}", vector, i, scale, reference) for i in components]

    def _in_end_frame(self, loop: Loop, fixed: Placement, moving: Placement, *, mirrored: bool) -> list[Row]:
        """Rows in the axes of one of the loop's two frames."""
        frames = self.frames(fixed.body, fixed.rotation)
        reference = (loop.name, fixed.body, "end")
        _, start = frames.place(fixed)
        orientation, origin = frames.place(moving)
        gap = origin.minus(start)
        side = "successor" if mirrored else "predecessor"
        rows = self._components(f"{loop.name}:{side}", gap, TRANSLATIONS[loop.type], 1.0 / self.tree.length, reference)
        for first, second in ROTATIONS[loop.type]:
            vector = Position(1.0).plus(orientation, UNITS[second])
            rows.append(Row(f"{loop.name}:{side} {'xyz'[first]}.{'xyz'[second]}", vector, first, 1.0, reference))
        return rows


def evaluate_rows(
    rows: Sequence[Row], motion: Motion, columns: bool = True
) -> tuple[list[Scalar], list[dict[int, Scalar]]]:
    """Residuals of rows and, by u's index, their derivatives."""
    residuals: list[Scalar] = []
    derivatives: list[dict[int, Scalar]] = []
    values: dict[int, Vector] = {}
    partials: dict[int, dict[int, Vector]] = {}
    for row in rows:
        key = id(row.vector)
        if key not in values:
            values[key] = motion.position(row.vector)
            partials[key] = motion.partials(row.vector) if columns else {}
        residuals.append(mul(row.scale, values[key][row.component]))
        derivatives.append({k: mul(row.scale, column[row.component]) for k, column in partials[key].items()})
    return residuals, derivatives


def second_derivatives(rows: Sequence[Row], motion: Motion) -> list[Scalar]:
    """Second time derivatives of rows for the motion's rates and accelerations."""
    values: dict[int, Vector] = {}
    result: list[Scalar] = []
    for row in rows:
        key = id(row.vector)
        if key not in values:
            values[key] = motion.acceleration(row.vector)
        result.append(mul(row.scale, values[key][row.component]))
    return result


def row_arrays(rows: Sequence[Row], u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (S, r) and derivatives (S, r, nu) of rows at states u (S, nu)."""
    count, size = u.shape
    motion = Motion([u[:, k] for k in range(size)])
    residuals, derivatives = evaluate_rows(rows, motion)
    phi = np.zeros((count, len(rows)))
    K = np.zeros((count, len(rows), size))
    for i, (value, row) in enumerate(zip(residuals, derivatives, strict=True)):
        phi[:, i] = value
        for k, derivative in row.items():
            K[:, i, k] = derivative
    return phi, K
