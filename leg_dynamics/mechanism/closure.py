"""Loop-closure rows: residual phi(q), Jacobian K with K qd = d(phi)/dt, and the drift k with K qdd = k.

Every loop joint is built from two kinds of row, both exact on and off the closed surface. In world axes, with
d and p1 fixed on the predecessor, e and p2 fixed on the successor and (v, w) the successor's twist relative to the
predecessor at the world origin:

* translation row: phi = d . (p2 - p1), d(phi)/dt = d . (v + w x p2), wrench (d, p2 x d);
* rotation row: phi = d . e, d(phi)/dt = d . (w x e), wrench (0, e x d).

So K = (W J) * S: the rows' wrenches W times the world-frame joint Jacobian, masked by which tree joints lie on
the successor's side (+1) and on the predecessor's side (-1). Couplings add constant rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leg_dynamics.description.model import Description, Loop
from leg_dynamics.description.topology import coupling_equations
from leg_dynamics.errors import DescriptionError
from leg_dynamics.mechanism.tree import Tree

__all__ = ["Closure", "ClosureRows"]

X, Y, Z, ORIGIN = 0, 1, 2, 3
TRANSLATIONS = {
    "revolute": (X, Y, Z),
    "continuous": (X, Y, Z),
    "spherical": (X, Y, Z),
    "universal": (X, Y, Z),
    "fixed": (X, Y, Z),
    "prismatic": (X, Y),
    "planar": (Z,),
}
SAME_ORIENTATION = ((X, Y), (Y, Z), (Z, X))
SAME_AXIS = ((X, Z), (Y, Z))
ROTATIONS: dict[str, tuple[tuple[int, int], ...]] = {
    "revolute": SAME_AXIS,
    "continuous": SAME_AXIS,
    "spherical": (),
    "universal": ((X, Y),),
    "fixed": SAME_ORIENTATION,
    "prismatic": SAME_ORIENTATION,
    "planar": SAME_AXIS,
}
# Column pairs that must point the same way on a closed loop: the rows above vanish for the opposite way too.
SAME_WAY: dict[str, tuple[int, ...]] = {
    "revolute": (Z,),
    "continuous": (Z,),
    "spherical": (),
    "universal": (),
    "fixed": (X, Y, Z),
    "prismatic": (X, Y, Z),
    "planar": (Z,),
}
# Loops whose relative motion is a pure spin about one common axis or point: d(phi)/dt needs no term from sliding.
NO_SLIDING = ("revolute", "continuous", "spherical", "fixed")
YZX = np.array([1, 2, 0])
ZXY = np.array([2, 0, 1])
W1_V1_W1 = np.array([3, 4, 5, 0, 1, 2, 3, 4, 5])
V2_W2_W2 = np.array([0, 1, 2, 3, 4, 5, 3, 4, 5])


def cross_rows(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row-wise cross product of two (r, 3) arrays; `np.cross` costs ten times as much at this size."""
    return a.take(YZX, 1) * b.take(ZXY, 1) - a.take(ZXY, 1) * b.take(YZX, 1)


def rotation_from_z(axis: tuple[float, float, float]) -> np.ndarray:
    """A rotation whose third column is `axis`, exact for axes along a coordinate direction; shape (3, 3)."""
    z = np.array(axis, dtype=float)
    helper = np.zeros(3)
    helper[int(np.argmin(np.abs(z)))] = 1.0
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


@dataclass(frozen=True)
class ClosureRows:
    """What one evaluation of the closure gives: `residual` (r,) and `jacobian` (r, nv); metres and sines of angles."""

    residual: np.ndarray
    jacobian: np.ndarray
    wrenches: np.ndarray
    directions: np.ndarray
    arms: np.ndarray


class Closure:
    """The loops and couplings of a description as rows on a pinocchio tree.

    Parameters
    ----------
    description : Description
    tree : Tree
        Receives two frames for each loop.

    Attributes
    ----------
    row_names : tuple of str
        ``loop:component`` or ``coupling``, length r.
    row_owner : tuple of str
        Loop or coupling behind each row, length r.
    """

    def __init__(self, description: Description, tree: Tree) -> None:
        self.loops = description.loops
        self.nv = tree.model.nv
        ends = [self._ends(loop, tree) for loop in self.loops]
        self.ends = tuple(ends)
        directions: list[int] = []
        arms: list[int] = []
        origins: list[int] = []
        is_translation: list[float] = []
        owner: list[int] = []
        names: list[str] = []
        for number, (loop, (predecessor, successor)) in enumerate(zip(self.loops, ends, strict=True)):
            for column in TRANSLATIONS[loop.type]:
                directions.append(4 * predecessor + column)
                arms.append(4 * successor + ORIGIN)
                origins.append(4 * predecessor + ORIGIN)
                is_translation.append(1.0)
                names.append(f"{loop.name}:{'xyz'[column]}")
            for first, second in ROTATIONS[loop.type]:
                directions.append(4 * predecessor + first)
                arms.append(4 * successor + second)
                origins.append(4 * predecessor + ORIGIN)
                is_translation.append(0.0)
                names.append(f"{loop.name}:{'xyz'[first]}.{'xyz'[second]}'")
            owner += [number] * (len(names) - len(owner))
        self.directions = np.array(directions, dtype=np.intp)
        self.arms = np.array(arms, dtype=np.intp)
        self.origins = np.array(origins, dtype=np.intp)
        self.is_translation = np.array(is_translation).reshape(-1, 1)
        self.owner = np.array(owner, dtype=np.intp)
        supports = np.array([[tree.support(a), tree.support(b)] for a, b in ends]).reshape(-1, 2, self.nv)
        self.loop_predecessor = np.ascontiguousarray(supports[:, 0])
        self.loop_successor = np.ascontiguousarray(supports[:, 1])
        self.loop_both = np.concatenate([self.loop_predecessor, self.loop_successor])
        self.loop_sign = self.loop_successor - self.loop_predecessor
        self.row_sign = self.loop_sign[self.owner]
        self.sliding = any(loop.type not in NO_SLIDING for loop in self.loops)
        self.same_way = np.array(
            [
                (4 * predecessor + column, 4 * successor + column)
                for loop, (predecessor, successor) in zip(self.loops, ends, strict=True)
                for column in SAME_WAY[loop.type]
            ],
            dtype=np.intp,
        ).reshape(-1, 2)

        equations = coupling_equations(description)
        index = {name: i for i, name in enumerate(tree.joint_names)}
        self.coupling_matrix = np.zeros((len(equations), self.nv))
        for row, equation in enumerate(equations):
            for joint, coefficient in equation.coefficients.items():
                self.coupling_matrix[row, index[joint]] = coefficient
        self.coupling_constant = np.array([equation.constant for equation in equations])
        self.coupling_names = tuple(equation.name for equation in equations)
        self.loop_rows = len(names)
        self.rows = self.loop_rows + len(equations)
        self.row_names = (*names, *self.coupling_names)
        self.row_owner = (*(self.loops[i].name for i in owner), *self.coupling_names)
        self.slices = tuple(slice(*_span(owner, number)) for number in range(len(self.loops)))

    @staticmethod
    def _ends(loop: Loop, tree: Tree) -> tuple[int, int]:
        if loop.type not in TRANSLATIONS:
            raise DescriptionError(f"loop {loop.name!r} has unsupported type {loop.type!r}", line=loop.line)
        alignment = np.eye(3) if loop.axis is None else rotation_from_z(loop.axis)
        predecessor = tree.add_loop_end(
            f"{loop.name}/predecessor", loop.predecessor.link, loop.predecessor.origin, alignment
        )
        successor = tree.add_loop_end(f"{loop.name}/successor", loop.successor.link, loop.successor.origin, alignment)
        return predecessor, successor

    def evaluate(self, coordinates: np.ndarray, frames: np.ndarray, joint_jacobian: np.ndarray) -> ClosureRows:
        """Residual and Jacobian of all rows.

        Parameters
        ----------
        coordinates : (nv,) array
            Tree coordinates, rad or m.
        frames : (4 nframes, 3) array
            `FrameMemory.rows` at these coordinates.
        joint_jacobian : (6, nv) array
            World-frame joint Jacobian, linear part first.
        """
        direction = frames.take(self.directions, 0)
        arm = frames.take(self.arms, 0)
        offset = arm - frames.take(self.origins, 0) * self.is_translation
        residual = np.empty(self.rows)
        np.einsum("ij,ij->i", direction, offset, out=residual[: self.loop_rows])
        wrenches = np.empty((self.loop_rows, 6))
        np.multiply(direction, self.is_translation, out=wrenches[:, :3])
        wrenches[:, 3:] = cross_rows(arm, direction)
        jacobian = np.empty((self.rows, self.nv), order="F")
        np.multiply(wrenches @ joint_jacobian, self.row_sign, out=jacobian[: self.loop_rows])
        if self.coupling_names:
            jacobian[self.loop_rows :] = self.coupling_matrix
            residual[self.loop_rows :] = self.coupling_matrix @ coordinates - self.coupling_constant
        return ClosureRows(residual, jacobian, wrenches, direction, arm)

    def points_the_same_way(self, frames: np.ndarray) -> bool:
        """Whether no loop is closed onto the mirrored pair (axes anti-parallel, frames half a turn apart)."""
        if self.same_way.size == 0:
            return True
        first, second = frames.take(self.same_way[:, 0], 0), frames.take(self.same_way[:, 1], 0)
        return bool((np.einsum("ij,ij->i", first, second) > 0.0).all())

    def drift(
        self,
        rows: ClosureRows,
        velocity: np.ndarray,
        joint_jacobian: np.ndarray,
        joint_jacobian_rate: np.ndarray,
    ) -> np.ndarray:
        """Right-hand side k of K qdd = k: minus the second derivative of phi at qdd = 0, shape (r,).

        With V1, V2 the loop ends' spatial velocities and dA their relative spatial acceleration at qdd = 0, the
        relative acceleration seen from the predecessor is dA - V1 x V2; sliding pairs add d . (w x u), where u is
        the arm's velocity relative to the predecessor. `velocity` must satisfy K qd = 0.
        """
        k = np.zeros(self.rows)
        if not self.loops:
            return k
        twists = self.loop_both @ (joint_jacobian * velocity).T
        count = len(self.loops)
        first, second = twists[:count], twists[count:]
        relative = self.loop_sign @ (joint_jacobian_rate * velocity).T
        # w1 x v2, v1 x w2 and w1 x w2 of all loops in one pass
        crosses = cross_rows(first.take(W1_V1_W1, 1).reshape(-1, 3), second.take(V2_W2_W2, 1).reshape(-1, 3))
        crosses = crosses.reshape(count, 3, 3)
        relative[:, :3] -= crosses[:, 0]
        relative -= crosses[:, 1:].reshape(count, 6)
        acceleration = np.einsum("ij,ij->i", rows.wrenches, relative.take(self.owner, 0))
        if self.sliding:
            spin = (second[:, 3:] - first[:, 3:]).take(self.owner, 0)
            slide = cross_rows(spin, rows.arms) + (second - first)[:, :3].take(self.owner, 0) * self.is_translation
            acceleration += np.einsum("ij,ij->i", rows.directions, cross_rows(spin, slide))
        np.negative(acceleration, out=k[: self.loop_rows])
        return k


def _span(owner: list[int], number: int) -> tuple[int, int]:
    mine = [row for row, loop in enumerate(owner) if loop == number]
    return (mine[0], mine[-1] + 1) if mine else (0, 0)
