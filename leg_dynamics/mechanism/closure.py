"""Loop-closure rows: residual phi(q), Jacobian K with K qd = d(phi)/dt, and the drift k with K qdd = k.

Every loop joint is built from two kinds of row, both exact on and off the closed surface. In world axes, with
d and p1 fixed on the predecessor, e and p2 fixed on the successor and (v, w) the successor's twist relative to the
predecessor at the world origin:

* translation row: phi = d . (p2 - p1), d(phi)/dt = d . (v + w x p2), wrench (d, p2 x d);
* rotation row: phi = d . e, d(phi)/dt = d . (w x e), wrench (0, e x d).

So K = (W J) * S: the rows' wrenches W times the world-frame joint Jacobian, masked by which tree joints lie on
the successor's side (+1) and on the predecessor's side (-1). Couplings add constant rows.

Rows of length are divided by the mechanism's characteristic length, so that residuals, pivots and singular values mean
the same for a leg of millimetres and for a crane. The length is a power of two: scaling adds no rounding.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from leg_dynamics.description.model import Description, Loop
from leg_dynamics.description.topology import coupling_equations
from leg_dynamics.errors import DescriptionError
from leg_dynamics.mechanism.tree import Tree

__all__ = ["Closure", "ClosureRows", "characteristic_length", "cross_rows", "rotation_from_z"]

X, Y, Z, ORIGIN = 0, 1, 2, 3
# The universe is frame 0: its origin is a zero vector among the frames' rows.
WORLD_ORIGIN = ORIGIN
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
# Closed pairs have cosine +1 where they are right; the rows of a fixed pair also vanish at cosines 0 and -1.
SAME_WAY_COSINE = 0.5
YZX = np.array([1, 2, 0])
ZXY = np.array([2, 0, 1])
# The motion cross product V1 x V2 = (w1 x v2 + v1 x w2, w1 x w2) as products of components times signs.
CROSS_TERMS = [
    (row + part, sign, one + first, other + second)
    for part, one, other in ((0, 3, 0), (0, 0, 3), (3, 3, 3))
    for row in range(3)
    for sign, first, second in ((1.0, (row + 1) % 3, (row + 2) % 3), (-1.0, (row + 2) % 3, (row + 1) % 3))
]
CROSS_FIRST = np.array([term[2] for term in CROSS_TERMS])
CROSS_SECOND = np.array([term[3] for term in CROSS_TERMS])
CROSS_SIGN = np.zeros((len(CROSS_TERMS), 6))
for _term, (_component, _sign, _, _) in enumerate(CROSS_TERMS):
    CROSS_SIGN[_term, _component] = _sign


def cross_rows(a: np.ndarray, b: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """Row-wise cross product of two (r, 3) arrays; `np.cross` costs ten times as much at this size."""
    return np.subtract(a.take(YZX, 1) * b.take(ZXY, 1), a.take(ZXY, 1) * b.take(YZX, 1), out)


def _einsum_rows(a: np.ndarray, b: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    result: np.ndarray = np.einsum("ij,ij->i", a, b, out=out)
    return result


# Row-wise scalar product of two (r, c) arrays; NumPy 2 has one that is three times as fast.
dot_rows = getattr(np, "vecdot", _einsum_rows)


def rotation_from_z(axis: tuple[float, float, float]) -> np.ndarray:
    """A rotation whose third column is `axis`, exact for axes along a coordinate direction; shape (3, 3)."""
    z = np.array(axis, dtype=float)
    helper = np.zeros(3)
    helper[int(np.argmin(np.abs(z)))] = 1.0
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def characteristic_length(model: pin.Model, frames: list[int]) -> float:
    """Size of the largest body, m, rounded to a power of two; 1 where all joints sit in one point.

    A body's size is the diagonal of the box around its joints and loop ends, so it does not depend on where the
    mechanism stands in the world.

    Parameters
    ----------
    model : pinocchio.Model
    frames : list of int
        Frames of the loop ends.
    """
    points: list[list[np.ndarray]] = [[] if joint == 0 else [np.zeros(3)] for joint in range(model.njoints)]
    for joint in range(1, model.njoints):
        points[model.parents[joint]].append(np.array(model.jointPlacements[joint].translation))
    for frame in frames:
        points[model.frames[frame].parentJoint].append(np.array(model.frames[frame].placement.translation))
    size = max((float(np.linalg.norm(np.ptp(body, axis=0))) for body in points if body), default=0.0)
    return 2.0 ** round(math.log2(size)) if size > 0.0 else 1.0


@dataclass(slots=True)
class ClosureRows:
    """What one evaluation of the closure gives: `residual` (r,) and `jacobian` (r, nv).

    Rows are dimensionless (lengths over `Closure.length`, sines and angles); columns are per rad or per m. For the loop
    rows, before that division: `wrenches` (., 6) are forces and moments at the world origin, `directions` and `arms`
    (., 3) the vectors they are made of.
    """

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
    length : float
        The mechanism's characteristic length, m.
    row_unit : (r,) array
        What one unit of a row's residual is in m or rad: `length` or 1.
    coordinate_unit : (nv,) array
        `length` for prismatic joints, 1 for the others.
    """

    def __init__(self, description: Description, tree: Tree) -> None:
        self.loops = description.loops
        self.nv = tree.model.nv
        ends = [self._ends(loop, tree) for loop in self.loops]
        self.ends = tuple(ends)
        self.length = characteristic_length(tree.model, [frame for pair in ends for frame in pair])
        is_length = np.array([description.joint(name).type == "prismatic" for name in tree.joint_names], dtype=bool)
        self.coordinate_unit = np.where(is_length, self.length, 1.0)
        directions: list[int] = []
        arms: list[int] = []
        origins: list[int] = []
        linear: list[int] = []
        is_translation: list[float] = []
        owner: list[int] = []
        names: list[str] = []
        for number, (loop, (predecessor, successor)) in enumerate(zip(self.loops, ends, strict=True)):
            for column in TRANSLATIONS[loop.type]:
                directions.append(4 * predecessor + column)
                arms.append(4 * successor + ORIGIN)
                origins.append(4 * predecessor + ORIGIN)
                linear.append(4 * predecessor + column)
                is_translation.append(1.0)
                names.append(f"{loop.name}:{'xyz'[column]}")
            for first, second in ROTATIONS[loop.type]:
                directions.append(4 * predecessor + first)
                arms.append(4 * successor + second)
                origins.append(WORLD_ORIGIN)
                linear.append(WORLD_ORIGIN)
                is_translation.append(0.0)
                names.append(f"{loop.name}:{'xyz'[first]}.{'xyz'[second]}'")
            owner += [number] * (len(names) - len(owner))
        self.vectors = np.array([*directions, *arms, *origins, *linear], dtype=np.intp)
        self.is_translation = np.array(is_translation).reshape(-1, 1)
        self.owner = np.array(owner, dtype=np.intp)
        loop_unit = np.where(self.is_translation[:, 0] > 0.0, self.length, 1.0)
        self.loop_scale = 1.0 / loop_unit
        self.minus_loop_scale = -self.loop_scale
        supports = np.array([[tree.support(a), tree.support(b)] for a, b in ends]).reshape(len(ends), 2, self.nv)
        self.loop_predecessor = np.ascontiguousarray(supports[:, 0])
        self.loop_successor = np.ascontiguousarray(supports[:, 1])
        self.loop_sign = self.loop_successor - self.loop_predecessor
        self.loop_sides = np.concatenate([self.loop_predecessor, self.loop_successor, self.loop_sign])
        self.row_sign_transposed = np.ascontiguousarray((self.loop_sign[self.owner] / loop_unit[:, None]).T)
        self.sliding = any(loop.type not in NO_SLIDING for loop in self.loops)
        self.same_way = np.array(
            [
                (4 * predecessor + column, 4 * successor + column)
                for loop, (predecessor, successor) in zip(self.loops, ends, strict=True)
                for column in SAME_WAY[loop.type]
            ],
            dtype=np.intp,
        ).reshape(-1, 2)
        self.same_way_owner = np.array(
            [number for number, loop in enumerate(self.loops) for _ in SAME_WAY[loop.type]], dtype=np.intp
        )

        equations = coupling_equations(description)
        index = {name: i for i, name in enumerate(tree.joint_names)}
        self.coupling_matrix = np.zeros((len(equations), self.nv))
        for row, equation in enumerate(equations):
            for joint, coefficient in equation.coefficients.items():
                self.coupling_matrix[row, index[joint]] = coefficient
        self.coupling_constant = np.array([equation.constant for equation in equations])
        coupling_unit = (np.abs(self.coupling_matrix) * self.coordinate_unit).max(axis=1, initial=0.0)
        coupling_unit = 2.0 ** np.round(np.log2(np.where(coupling_unit > 0.0, coupling_unit, 1.0)))
        self.coupling_rows = self.coupling_matrix / coupling_unit[:, None]
        self.coupling_level = self.coupling_constant / coupling_unit
        self.has_levels = bool(self.coupling_level.any())
        self.coupling_names = tuple(equation.name for equation in equations)
        self.loop_rows = len(names)
        self.rows = self.loop_rows + len(equations)
        self.template = np.zeros((self.nv, self.rows))
        self.template[:, self.loop_rows :] = self.coupling_rows.T
        self.row_unit = np.concatenate([loop_unit, coupling_unit])
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
        """Residual and Jacobian of all rows, exact off the closed surface too.

        Parameters
        ----------
        coordinates : (nv,) array
            Tree coordinates, rad or m.
        frames : (4 nframes, 3) array
            `FrameMemory.rows` at these coordinates.
        joint_jacobian : (6, nv) array
            World-frame joint Jacobian, linear part first.
        """
        if joint_jacobian.ndim == 1:
            # The bindings drop the column axis of a single joint.
            joint_jacobian = joint_jacobian.reshape(6, 1)
        loops = self.loop_rows
        vectors = frames.take(self.vectors, 0)
        direction, arm, origin = vectors[:loops], vectors[loops : 2 * loops], vectors[2 * loops : 3 * loops]
        wrenches = np.empty((loops, 6))
        wrenches[:, :3] = vectors[3 * loops :]
        cross_rows(arm, direction, wrenches[:, 3:])
        residual = dot_rows(direction, arm - origin)
        residual *= self.loop_scale
        # Column-major for LAPACK: built as its transpose. `dot` is `@` at half the call's price.
        transposed = self.template.copy()
        np.multiply(joint_jacobian.T.dot(wrenches.T), self.row_sign_transposed, transposed[:, :loops])
        if self.coupling_names:
            coupled = self.coupling_rows.dot(coordinates)
            if self.has_levels:
                coupled -= self.coupling_level
            residual = np.concatenate((residual, coupled))
        return ClosureRows(residual, transposed.T, wrenches, direction, arm)

    def points_the_same_way(self, frames: np.ndarray) -> bool:
        """Whether no loop is closed onto the mirrored pair (axes anti-parallel, frames half a turn apart)."""
        if self.same_way.size == 0:
            return True
        first, second = frames.take(self.same_way[:, 0], 0), frames.take(self.same_way[:, 1], 0)
        return bool((dot_rows(first, second) > SAME_WAY_COSINE).all())

    def directions(self, frames: np.ndarray) -> np.ndarray:
        """Differences of unit vectors that closed loops bring together, (k, 3)."""
        return frames.take(self.same_way[:, 0], 0) - frames.take(self.same_way[:, 1], 0)

    def direction_jacobian(self, frames: np.ndarray, joint_jacobian: np.ndarray) -> np.ndarray:
        """Derivative of `directions` by the tree coordinates, (3 k, nv).

        Parameters
        ----------
        frames, joint_jacobian
            As for `evaluate`.
        """
        turning = joint_jacobian.reshape(6, self.nv)[3:].T
        rates = []
        for side, support in ((0, self.loop_predecessor), (1, self.loop_successor)):
            vectors = frames.take(self.same_way[:, side], 0)
            masks = support.take(self.same_way_owner, 0)
            rates.append(np.cross(turning[None], vectors[:, None]) * masks[:, :, None])
        result: np.ndarray = np.swapaxes(rates[0] - rates[1], 1, 2).reshape(-1, self.nv)
        return result

    def drift(
        self,
        rows: ClosureRows,
        velocity: np.ndarray,
        joint_jacobian: np.ndarray,
        joint_jacobian_rate: np.ndarray,
    ) -> np.ndarray:
        """Right-hand side k of K qdd = k on the closed surface: minus the second derivative of phi at qdd = 0, (r,).

        With V1, V2 the loop ends' spatial velocities and dA their relative spatial acceleration at qdd = 0, the
        relative acceleration seen from the predecessor is dA - V1 x V2; sliding pairs add d . (w x u), where u is
        the arm's velocity relative to the predecessor.

        Parameters
        ----------
        rows : ClosureRows
            Of a closed pose.
        velocity : (nv,) array
            Tree velocities qd with K qd = 0.
        joint_jacobian, joint_jacobian_rate : (6, nv) array
            World-frame joint Jacobian and its time derivative, linear part first.
        """
        k = np.zeros(self.rows)
        if not self.loops:
            return k
        if joint_jacobian.ndim == 1:
            joint_jacobian, joint_jacobian_rate = joint_jacobian.reshape(6, 1), joint_jacobian_rate.reshape(6, 1)
        count = len(self.loops)
        sides = self.loop_sides * velocity
        twists = sides[: 2 * count].dot(joint_jacobian.T)
        first, second = twists[:count], twists[count:]
        products = first.take(CROSS_FIRST, 1) * second.take(CROSS_SECOND, 1)
        relative = sides[2 * count :].dot(joint_jacobian_rate.T) - products.dot(CROSS_SIGN)
        acceleration = dot_rows(rows.wrenches, relative.take(self.owner, 0))
        if self.sliding:
            motion = (second - first).take(self.owner, 0)
            spin = motion[:, 3:]
            slide = cross_rows(spin, rows.arms) + motion[:, :3] * self.is_translation
            acceleration += dot_rows(rows.directions, cross_rows(spin, slide))
        np.multiply(acceleration, self.minus_loop_scale, k[: self.loop_rows])
        return k


def _span(owner: list[int], number: int) -> tuple[int, int]:
    """First row of a loop and the one after its last; rows lie in the order of their loops."""
    return bisect_left(owner, number), bisect_right(owner, number)
