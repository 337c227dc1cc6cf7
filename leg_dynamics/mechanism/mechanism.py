"""A closed-loop mechanism at one state: closing the loops, G and g, torques by virtual work, accelerations, forces.

Symbols: independent coordinates y, tree coordinates q, loop rows phi(q) = 0 with K qd = 0 and K qdd = k,
qd = G yd, qdd = G ydd + g, and tau = G^T rnea(q, G yd, G ydd + g).
"""

from __future__ import annotations

import copy
import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from scipy.linalg import blas, lapack

from leg_dynamics.description.model import STANDSTILL, Description
from leg_dynamics.description.topology import actuated_joints, independent_joints
from leg_dynamics.description.turns import WholeTurns
from leg_dynamics.errors import (
    ActuationError,
    AssemblyError,
    DescriptionError,
    LegDynamicsError,
    MissingFootError,
    NonFiniteError,
    SingularityError,
)
from leg_dynamics.mechanism.closure import Closure, ClosureRows
from leg_dynamics.mechanism.tree import STANDARD_GRAVITY, FrameMemory, Tree, create_data

if TYPE_CHECKING:
    from leg_dynamics.mechanism.rounded import Gap
    from leg_dynamics.mechanism.singular import Singular

__all__ = ["ClosedState", "LoopForces", "Mechanism"]

# All lengths are relative to the mechanism's characteristic length (`Closure.length`), angles in rad.
# Newton is quadratic: after a step below STEP_TOLERANCE the error is at rounding level.
STEP_TOLERANCE = 1e-9
RESIDUAL_TARGET = 4e-15
RESIDUAL_TOLERANCE = 1e-10
# Where rounding keeps the loops open, poses elsewhere may be open by that many times as much, and rows that contradict
# each other count by that many times as much.
GAP_TOLERANCE = 10.0
GAP_SHARE = 30.0
# Elsewhere they may count by that many times as much as at the poses that were tried, and never by more than this.
SHARES, GREATEST_SHARE = 10.0, 2e-2
POLISH = 1e-13
NEWTON_ITERATIONS = 12
CONTINUATION_STEP = 0.3
SMALLEST_STEP = 1e-6
# Further away than this from every seed nothing is followed: it would take minutes.
FARTHEST = 1e3
# The tangent must predict the corrected point to this share of the step, or the step is halved.
CORRECTION_SHARE = 0.3
SAFE_CORRECTION = 0.01
# Kept for each thread.
KNOWN_POSES = 20_000
KNOWN_ANCHORS = 4_000
# Side of a cell with one anchor, rad or lengths of the mechanism; the anchor must predict the poses in it to this share
# of the motion.
ANCHOR_CELL = 0.1
ANCHOR_SHARE = 0.25
POSE_ROUNDING = 1e-9
RIGHT_BEFORE = 1e-4
# Near a singular pose the tangent may turn by this share in a step.
TURNED_SHARE = 0.2
RANK_TOLERANCE = 1e-9
# Rounding of the efforts grows like 1e-16 / sigma: below this their digits are fewer than `PROMISED`.
HELD_TOLERANCE = 1e-7
# At a dead centre G grows like 1/sigma, at a bifurcation it does not: their product tells them apart.
DEAD_CENTRE = 0.03
# Where a mode ends, the smallest singular value has fallen to about the square root of the smallest step.
END_SHARE = 1e-2
# What a result promises, relative to 1 + its largest magnitude: the tolerance that routes must agree within.
PROMISED = 1e-9
# Rounding of one residual, in units of the loop ends' distance from the world's origin plus a length of the mechanism.
ROUNDING = 2.0**-52
# Poses whose inverse is larger than this are brought to the limit of rounding, and what is computed there is doubted.
# Rounding moves the pose by eps / sigma, G by eps / sigma**2 and g by eps / sigma**3: above sigma = 0.02 that stays
# below 1e-10 at joint speeds of 5 rad/s.
DOUBTFUL_INVERSE = 50.0
# Beside a bifurcation Newton halves the error until it is far below the distance to the singular pose.
SETTLING_STEPS = 40
SINGULAR_STEPS = 60
NEARLY_THERE = 1e-3
# Rounding leaves a pose beside a bifurcation uncertain by its square root, 1e-8: nearer than this to a singular pose it
# may be the singular pose itself, where G is noise although it stays bounded.
RESOLVED = 1e7
# Pivots of the mass matrix with unit diagonal: below this a motion has hardly any mass of its own, and its
# acceleration fewer digits than `PROMISED`.
SMALLEST_MASS = 1e-6
# Of a term of the mass matrix, relative to it: several tens of operations.
MASS_ROUNDING = 64.0 * 2.0**-53


@dataclass(slots=True)
class ClosedState:
    """A closed pose with everything that depends on the pose alone.

    `q` (nv,) tree coordinates; `y` (n,) independent ones; `residual` the norm of phi, dimensionless as in
    `ClosureRows`; `dependent_jacobian` (r, nv - n) the dependent columns of K per unit of `Closure.coordinate_unit`;
    `factor` and `triangle` its QR factors; `smallest_pivot` the smallest |R_ii| over the largest or 1, NaN before it
    was measured; `G` (nv, n) per rad and m. `inverse_norm` bounds 1 / (smallest singular value) from above once it was
    asked for (`Mechanism.inverse_norm`), else 0.
    """

    y: np.ndarray
    q: np.ndarray
    rows: ClosureRows
    residual: float
    dependent_jacobian: np.ndarray
    factor: tuple[np.ndarray, np.ndarray]
    triangle: np.ndarray
    smallest_pivot: float
    G: np.ndarray
    inverse_norm: float = 0.0


@dataclass(frozen=True)
class LoopForces:
    """Minimum-norm loop forces: what each loop joint transmits from its predecessor to its successor.

    The norm weighs forces by the mechanism's characteristic length, so that N and N·m add up.

    `wrenches` maps a loop to (force N, moment N·m) in the predecessor's loop frame (z along the loop axis);
    `couplings` maps a coupling to its multiplier: the generalised force on a joint is the sum of its coefficients
    times the multipliers. Where `redundant_rows` > 0 the mechanism is overconstrained: internal forces are not unique,
    and these are the ones of smallest norm; actuator torques are unique all the same. `imbalance` is the largest
    remaining error of the tree's balance, N·m or N.
    """

    wrenches: dict[str, tuple[np.ndarray, np.ndarray]]
    couplings: dict[str, float]
    redundant_rows: int
    imbalance: float

    @property
    def unique(self) -> bool:
        """Whether the forces are determined by the motion alone."""
        return self.redundant_rows == 0


class _Workspace(threading.local):
    """One thread's pinocchio model copy and data, the state it closed last, and poses that it followed from a seed.

    `followed` holds tree coordinates by the bytes of y, and `led` those of a motion that is being computed; `anchors`
    one state in each cell of the space of y.
    """

    def __init__(self, tree: Tree) -> None:
        self.model = tree.model.copy()
        self.data = create_data(self.model)
        self.memory = FrameMemory(self.model, self.data)
        self.last: ClosedState | None = None
        self.followed: dict[bytes, np.ndarray] = {}
        self.led: dict[bytes, np.ndarray] = {}
        self.anchors: dict[tuple[int, ...], ClosedState] = {}
        self.followed_from: tuple[ClosedState, ...] | None = None


class Mechanism:
    """Kinematics and dynamics of any description, one state at a time.

    Parameters
    ----------
    description : Description
    foot : str, optional
        Link whose origin is the foot; without it the foot methods raise `MissingFootError`.
    hip : str, optional
        Link in whose axes foot quantities, forces and gravity are expressed; the root where None.
    remembers : bool
        Whether the closure may start from the last pose. Without, a pose does not depend on those before. Poses that
        were followed from a seed are kept either way: they depend on nothing else.

    Raises
    ------
    DescriptionError, UnsupportedError
        The file cannot be modelled.
    """

    def __init__(
        self, description: Description, foot: str | None = None, hip: str | None = None, *, remembers: bool = True
    ) -> None:
        self.description = description
        self.remembers = remembers
        self.foot = foot
        self.hip = hip if hip is not None else description.root
        self.tree = Tree.from_description(description)
        self.closure = Closure(description, self.tree)
        model = self.tree.model
        self.nv = model.nv
        self.joint_names = self._independent(description)
        self.actuator_joints = actuated_joints(description)
        position = {name: i for i, name in enumerate(self.tree.joint_names)}
        self.independent = np.array([position[name] for name in self.joint_names], dtype=np.intp)
        self.dependent = np.array([i for i in range(self.nv) if i not in set(self.independent.tolist())], dtype=np.intp)
        self.actuated = np.array([position[name] for name in self.actuator_joints], dtype=np.intp)
        self.n = len(self.independent)
        self.directly_actuated = np.array_equal(self.actuated, self.independent)
        joints = [description.joint(name) for name in self.tree.joint_names]
        self.damping = np.array([joint.damping for joint in joints])
        self.friction = np.array([joint.friction for joint in joints])
        self.dissipates = bool(self.damping.any() or self.friction.any())
        self.lower = np.array([joint.limits.lower for joint in joints])
        self.upper = np.array([joint.limits.upper for joint in joints])
        self.foot_frame = None if foot is None else self._frame("foot", foot)
        self.hip_rotation = self._hip_rotation(self.hip)
        self.gravity = self.hip_rotation.T @ np.array([0.0, 0.0, -STANDARD_GRAVITY])
        model.gravity.linear = np.array([0.0, 0.0, -STANDARD_GRAVITY])
        unit = self.closure.coordinate_unit
        self._unit = unit[self.independent]
        self._dependent_unit = unit[self.dependent]
        self._has_lengths = bool((unit != 1.0).any())
        self._selection = np.zeros((self.nv, self.n))
        self._selection[self.independent, np.arange(self.n)] = 1.0
        self._is_open = self.closure.rows == 0
        self._has_every_mass = self.tree.has_inertia_everywhere()
        none = np.zeros((0, 3))
        self._no_rows = ClosureRows(np.zeros(0), np.zeros((0, self.nv)), np.zeros((0, 6)), none, none)
        if self.closure.rows < len(self.dependent):
            raise DescriptionError(
                f"{len(self.dependent)} dependent joints but only {self.closure.rows} loop and coupling rows: the "
                f"mechanism has at least {self.nv - self.closure.rows} free motions and {self.n} joints are "
                "independent; mark more joints independent or add the missing loops",
                file=description.file,
                independent=self.n,
            )
        self._workspace = _Workspace(self.tree)
        self._seed_lock = threading.RLock()
        self._seeds: tuple[ClosedState, ...] | None = None
        self._no_seeds: LegDynamicsError | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {"description": self.description, "foot": self.foot, "hip": self.hip, "remembers": self.remembers}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    @staticmethod
    def _independent(description: Description) -> tuple[str, ...]:
        names = independent_joints(description)
        if not names:
            advice = (
                "mark at least one independent" if description.moving_joints else "every joint is fixed, nothing moves"
            )
            raise DescriptionError(f"no joint is independent: {advice}", file=description.file)
        return names

    def _frame(self, role: str, link: str) -> int:
        self.description.link(link)
        return self.tree.add_frame(f"{role}/{link}", link, pin.SE3.Identity())

    def _hip_rotation(self, hip: str) -> np.ndarray:
        frame = self._frame("hip", hip)
        if self.tree.support(frame).any():
            raise DescriptionError(f"the hip link {hip!r} moves relative to the root", file=self.description.file)
        self.hip_origin = np.array(self.tree.model.frames[frame].placement.translation)
        return np.array(self.tree.model.frames[frame].placement.rotation)

    # ------------------------------------------------------------------ closing the loops

    def evaluate(self, q: np.ndarray) -> ClosureRows:
        """Loop and coupling rows at tree coordinates q (nv,), closed or not."""
        work = self._workspace
        pin.computeJointJacobians(work.model, work.data, self.tree.to_configuration(q))
        pin.updateFramePlacements(work.model, work.data)
        return self.closure.evaluate(q, work.memory.rows(), work.data.J)

    def _state(self, q: np.ndarray, rows: ClosureRows) -> ClosedState:
        y = q[self.independent]
        count = len(self.dependent)
        if count == 0:
            residual = float(np.linalg.norm(rows.residual))
            empty = np.zeros((0, 0))
            return ClosedState(y, q, rows, residual, empty, (empty, empty), empty, np.inf, self._selection)
        dependent = rows.jacobian.T.take(self.dependent, 0).T
        if self._has_lengths:
            dependent *= self._dependent_unit
        qr, reflectors, _, _ = lapack.dgeqrf(dependent)
        return ClosedState(
            y,
            q,
            rows,
            math.sqrt(rows.residual.dot(rows.residual)),
            dependent,
            (qr, reflectors),
            np.asfortranarray(qr[:count]),
            np.nan,
            self._selection,
        )

    def _solve(self, state: ClosedState, right_hand_side: np.ndarray) -> np.ndarray:
        """Least-squares solution of (dependent columns) x = right-hand side, in units of `coordinate_unit`."""
        qr, reflectors = state.factor
        # dormqr's smallest workspace and dtrsm keep to unthreaded code: dgels, dtrtrs and blocked dormqr wake BLAS
        # threads, which at this size cost a hundred times the arithmetic when other work shares the cores.
        rotated, _, _ = lapack.dormqr("L", "T", qr, reflectors, right_hand_side, right_hand_side.shape[1])
        return blas.dtrsm(1.0, state.triangle, rotated[: len(self.dependent)])

    def _measure_pivots(self, state: ClosedState) -> None:
        if len(self.dependent):
            pivots = abs(state.triangle.diagonal()).tolist()
            # K is dimensionless: a single small column is singular too.
            state.smallest_pivot = min(pivots) / max(1.0, *pivots)

    def complete(self, state: ClosedState) -> ClosedState:
        """Fill in G of a closed pose.

        Raises
        ------
        SingularityError
            The independent joints do not determine the others there.
        """
        if len(self.dependent) == 0:
            return state
        if state.smallest_pivot != state.smallest_pivot:
            self._measure_pivots(state)
        if not state.smallest_pivot > RANK_TOLERANCE:
            raise self._singular(state)
        G = self._selection.copy()
        dependent = self._solve(state, -state.rows.jacobian.T.take(self.independent, 0).T)
        G[self.dependent] = dependent * self._dependent_unit[:, None] if self._has_lengths else dependent
        state.G = G
        return state

    def place_of(self, q: np.ndarray) -> ClosedState:
        """The state at any tree coordinates q (nv,), closed or not; without G."""
        return self._state(q, self.evaluate(q))

    def state_of(self, q: np.ndarray) -> ClosedState:
        """The state at tree coordinates q (nv,) that close the loops already.

        Raises
        ------
        AssemblyError
            They do not close the loops.
        SingularityError
            The independent joints do not determine the others there.
        """
        state = self._state(q, self.evaluate(q))
        if not state.residual <= self.tolerance:
            raise AssemblyError(
                f"these tree coordinates leave a loop residual of {state.residual:.3g}, the tolerance is "
                f"{self.tolerance:g}: close them first",
                residual=state.residual,
                margin=self.tolerance - state.residual,
            )
        return self.complete(state)

    def _singular(self, state: ClosedState) -> SingularityError:
        sigma = np.linalg.svd(state.dependent_jacobian, compute_uv=False)
        singular = self.singular(state)
        return SingularityError(
            f"the closure is singular at {self.pose_text(state.y)}: smallest singular value {sigma[-1]:.3g} of largest "
            f"{sigma[0]:.3g}; the independent joints do not determine the others there: {singular}; move away from "
            "this pose, or choose other independent joints",
            margin=float(sigma[-1]),
            residual=state.residual,
            kind=singular.kind,
            direction=singular.direction,
            pose=self.pose(state.y),
            tree_coordinates=state.q.copy(),
        )

    def singular(self, state: ClosedState) -> Singular:
        """Kind and free motion of a pose at or near a singular one."""
        from leg_dynamics.mechanism.singular import describe

        return describe(self, state)

    def pose(self, y: np.ndarray) -> dict[str, float]:
        """Independent coordinates (n,) by name."""
        return dict(zip(self.joint_names, y.tolist(), strict=True))

    def search_box(self) -> tuple[np.ndarray, np.ndarray]:
        """Joint limits (nv,), cut to half a turn and to four lengths of the mechanism either way."""
        is_length = [self.description.joint(name).unit == "m" for name in self.tree.joint_names]
        reach = np.where(is_length, 4.0 * self.closure.length, np.pi)
        lower = np.where(self.upper > -reach, np.maximum(self.lower, -reach), self.lower)
        upper = np.where(self.lower < reach, np.minimum(self.upper, reach), self.upper)
        return lower, upper

    def pose_text(self, y: np.ndarray) -> str:
        """Independent coordinates (n,) as words for an error message."""
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.joint_names, y, strict=True))

    def distance(self, change: np.ndarray) -> float:
        """Largest change of the independent coordinates (n,), lengths relative to the mechanism's."""
        if self._has_lengths:
            change = change / self._unit
        return float(abs(change).max())

    def is_mirrored(self, q: np.ndarray) -> bool:
        """Whether a pair points the wrong way at tree coordinates q (nv,), where the rows vanish as well."""
        self.evaluate(q)
        return not self.closure.points_the_same_way(self._workspace.memory.rows())

    def directed_rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual and Jacobian at tree coordinates q (nv,), with rows that a pair closed onto its mirror image breaks.

        Dimensionless, columns per rad or m: the rows of `ClosureRows`, then three for each direction that a closed loop
        brings together.
        """
        rows = self.evaluate(q)
        if not self.closure.same_way.size:
            return rows.residual, rows.jacobian
        frames = self._workspace.memory.rows()
        directions = self.closure.directions(frames).ravel()
        rates = self.closure.direction_jacobian(frames, self._workspace.data.J)
        return np.concatenate([rows.residual, directions]), np.vstack([rows.jacobian, rates])

    def correct(self, q: np.ndarray, allowed: float) -> ClosedState | None:
        """Newton on the dependent coordinates with y fixed; None where it would leave the neighbourhood `allowed`.

        Parameters
        ----------
        q : (nv,) array
            Tree coordinates to start from.
        allowed : float
            Largest norm of a step of the dependent coordinates, rad, or shares of the mechanism's length.

        Returns
        -------
        ClosedState or None
            Without G: see `complete`.
        """
        previous = np.inf
        state: ClosedState | None = None
        for _ in range(NEWTON_ITERATIONS):
            rows = self.evaluate(q)
            state = self._state(q, rows)
            # Without dependent joints there is nothing to move: the residual decides.
            if state.residual <= RESIDUAL_TARGET or previous <= STEP_TOLERANCE or not len(self.dependent):
                break
            # At a singular pose the step is infinite or NaN, and refused.
            step = self._solve(state, -rows.residual.reshape(-1, 1)).ravel()
            size = math.sqrt(step.dot(step))
            if not size <= min(allowed, 0.5 * previous if previous > 1e-6 else np.inf):
                return None
            q = q.copy()
            q[self.dependent] += step * self._dependent_unit if self._has_lengths else step
            if size <= POLISH:
                # Below the accuracy of any use of K: the rows need no second look.
                state.q = q
                break
            previous = size
        if state is None or not state.residual <= self.tolerance:
            return None
        self._measure_pivots(state)
        # Too small a correction to turn a pair over needs no look at it.
        if allowed > SAFE_CORRECTION and not self.closure.points_the_same_way(self._workspace.memory.rows()):
            return None
        return state

    def inverse_norm(self, state: ClosedState) -> float:
        """Bound from above of 1 / (smallest singular value) of the dependent columns; 0 without dependent joints."""
        if state.inverse_norm == 0.0 and len(self.dependent):
            # The reflectors below the diagonal count as well: a safe bound, and dtrtri wakes no threads.
            inverse = lapack.dtrtri(state.triangle)[0].ravel("K")
            state.inverse_norm = math.sqrt(inverse.dot(inverse))
        return state.inverse_norm

    def _crosses_singularity(self, before: ClosedState, after: ClosedState) -> bool:
        """Whether the closure may have been singular, or another branch met, between two neighbouring poses.

        On the straight line from K1 to K2 the rank drops exactly where K1^+ K2 has a real eigenvalue <= 0, however many
        singular values pass through zero at once (a determinant's sign would miss an even number). It cannot where
        |K2 - K1| is below the smallest singular value of K1. Beyond a bifurcation, though, the other branch has the
        signs that this one had before: a jump to it shows in the tangents, whose difference does not shrink with the
        step.
        """
        change = (after.dependent_jacobian - before.dependent_jacobian).ravel("K")
        if math.sqrt(change.dot(change)) * self.inverse_norm(before) < 1.0:
            return False
        along = after.y - before.y
        turned, moved = (after.G - before.G).dot(along), before.G.dot(along)
        if self._has_lengths:
            turned, moved = turned / self.closure.coordinate_unit, moved / self.closure.coordinate_unit
        if turned.dot(turned) > TURNED_SHARE**2 * moved.dot(moved):
            return True
        eigenvalues = np.linalg.eigvals(self._solve(before, after.dependent_jacobian))
        return bool((eigenvalues.real <= 0.0).any())

    def advance(self, start: ClosedState, y: np.ndarray) -> ClosedState | None:
        """One predictor-corrector step from a closed pose to y (n,) in the same assembly mode, or None."""
        movement = start.G.dot(y - start.y)
        q = start.q + movement
        q[self.independent] = y
        if len(self.dependent) == 0:
            return self.correct(q, 0.0)
        if self._has_lengths:
            movement /= self.closure.coordinate_unit
        state = self.correct(q, CORRECTION_SHARE * math.sqrt(movement.dot(movement)) + 1e-7)
        if state is None or not state.smallest_pivot > RANK_TOLERANCE:
            return None
        state = self.complete(state)
        return None if self._crosses_singularity(start, state) else state

    def neighbour(self, start: ClosedState, y: np.ndarray, halvings: int = 4) -> ClosedState | None:
        """The closed pose at y (n,) not far from another one of the mode; None where a few steps do not reach it.

        Where it fails it is much quicker than `follow`, which goes on to find out where the mode ends.
        """
        if self._is_open:
            return self.close(y)
        state = self.advance(start, y) if self.distance(y - start.y) <= CONTINUATION_STEP else None
        if state is None and halvings > 0:
            middle = self.neighbour(start, 0.5 * (start.y + y), halvings - 1)
            return None if middle is None else self.neighbour(middle, y, halvings - 1)
        try:
            return None if state is None else self._settled(state)
        except SingularityError:
            return None

    def follow(self, start: ClosedState, y: np.ndarray) -> ClosedState:
        """Continuation along the straight line in y from a closed pose, halving the step where Newton strays.

        Raises
        ------
        AssemblyError
            The mode ends on the way; carries `residual` and the last pose `reached`.
        SingularityError
            The closure is singular on the way, so that its continuation is ambiguous.
        """
        total = self.distance(y - start.y)
        if self.closure.loops and not total <= FARTHEST:
            raise AssemblyError(
                f"{self.pose_text(y)} is {total:.3g} away from the nearest known closed pose, more than "
                f"{FARTHEST:g}: take whole turns off the coordinates",
                margin=FARTHEST - total,
                residual=np.nan,
                reached=start.y.copy(),
            )
        # Couplings alone are linear: one step is exact.
        longest = CONTINUATION_STEP / total if self.closure.loops and total > 0.0 else 1.0
        done, step = 0.0, min(1.0, longest)
        state, origin = start, start.y
        while done < 1.0:
            share = min(step, 1.0 - done)
            target = y if done + share >= 1.0 else origin + (done + share) * (y - origin)
            reached = self.advance(state, target)
            if reached is None:
                step = share / 2.0
                if step < SMALLEST_STEP:
                    raise self._lost(state, y, done)
                continue
            state, done, step = reached, done + share, min(step * 1.5, 2.0 * longest)
        return state

    def at_any_cost(self, y: np.ndarray) -> ClosedState:
        """The pose at y (n,), also where it is singular and the mode can be followed to it no further.

        Raises
        ------
        AssemblyError
            The loops do not close there.
        """
        try:
            return self.close(y)
        except (AssemblyError, SingularityError) as error:
            last = getattr(error, "tree_coordinates", None)
            if last is None:
                raise
            # From further away it could arrive on another branch.
            if self.distance(y - last[self.independent]) > NEARLY_THERE:
                raise
            q = last.copy()
            q[self.independent] = y
            state = self._nearest_closed(q)
            # At a singular pose the residual is flat: it is small within the square root of rounding.
            if not state.residual <= self.tolerance:
                raise
            self._measure_pivots(state)
            return state

    def _nearest_closed(self, q: np.ndarray) -> ClosedState:
        """Where the residual is smallest over the dependent coordinates, from q (nv,)."""
        state = self._state(q, self.evaluate(q))
        # Beside a singular pose each step of Newton halves the distance.
        for _ in range(SINGULAR_STEPS):
            step = np.linalg.lstsq(state.dependent_jacobian, -state.rows.residual, rcond=1e-12)[0]
            moved = state.q.copy()
            moved[self.dependent] += step * self._dependent_unit
            better = self._state(moved, self.evaluate(moved))
            if not better.residual < state.residual:
                break
            state = better
        return state

    def _lost(self, state: ClosedState, y: np.ndarray, done: float) -> AssemblyError | SingularityError:
        """The error for a mode that was followed to `state` and not on to y."""
        q = state.q.copy()
        q[self.independent] = y
        residual = self._smallest_residual(q)
        followed = f"the assembly mode was followed to {done:.1%} of the way ({self.pose_text(state.y)})"
        if len(self.dependent):
            sigma = np.linalg.svd(state.dependent_jacobian, compute_uv=False)
            share = float(sigma[-1] / sigma[0]) if sigma[0] > 0.0 else 0.0
            if share < 1e-3 and share * float(np.abs(state.G).max()) < DEAD_CENTRE:
                singular = self.singular(state)
                return SingularityError(
                    f"the way to {self.pose_text(y)} passes a singular pose of the closure, where assembly modes meet: "
                    f"{followed}, smallest singular value {sigma[-1]:.3g} of {sigma[0]:.3g}, {singular}; take a path "
                    "around it or start from a configuration on the other side",
                    margin=float(sigma[-1]),
                    residual=residual,
                    reached=state.y.copy(),
                    tree_coordinates=state.q.copy(),
                    kind=singular.kind,
                    direction=singular.direction,
                    pose=self.pose(state.y),
                )
        end, evidence = "", {}
        if len(self.dependent) and share < END_SHARE:
            singular = self.singular(state)
            end = f" The mode ends at {singular}."
            evidence = {"kind": singular.kind, "direction": singular.direction, "pose": self.pose(state.y)}
        if residual <= self.tolerance:
            reason = "they can be closed there, but only at or beyond a singular pose of this mode"
        else:
            reason = f"there the residual cannot be made smaller than {residual:.3g}"
            reason += f", the tolerance is {self.tolerance:g}"
        return AssemblyError(
            f"the loops cannot be closed at {self.pose_text(y)}: {followed}; {reason}: stay inside this mode's "
            f"reach, or give a configuration of the mode that you mean.{end}",
            margin=min(self.tolerance - residual, 0.0),
            residual=residual,
            reached=state.y.copy(),
            tree_coordinates=state.q.copy(),
            **evidence,
        )

    def _smallest_residual(self, q: np.ndarray) -> float:
        """Norm of phi where it is smallest over the dependent coordinates, from q."""
        return float(np.linalg.norm(self.evaluate(self._smallest(q)).residual))

    def _smallest(self, q: np.ndarray) -> np.ndarray:
        """Tree coordinates (nv,) whose residual is smallest over the dependent coordinates, from q."""
        if len(self.dependent) == 0:
            return q
        from scipy.optimize import least_squares

        def place(x: np.ndarray) -> np.ndarray:
            moved = q.copy()
            moved[self.dependent] = x
            return moved

        solution = least_squares(
            lambda x: self.evaluate(place(x)).residual,
            q[self.dependent],
            jac=lambda x: self.evaluate(place(x)).jacobian[:, self.dependent],
            x_scale=self._dependent_unit,
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=20,
        )
        return place(solution.x)

    @cached_property
    def rounding(self) -> Gap:
        """What rounding of the file's numbers leaves of the loops. May be set before it is first asked for."""
        from leg_dynamics.mechanism.assembly import configuration_coordinates
        from leg_dynamics.mechanism.rounded import closing_gap

        home = self.description.home
        start = configuration_coordinates(self, {} if home is None else dict(home.values))
        return closing_gap(self, start, (self.n,))

    @property
    def gap(self) -> float:
        """Residual that rounding of the file's numbers leaves in the loops, rad or shares of `Closure.length`, or 0."""
        return self.rounding.residual

    @cached_property
    def tolerance(self) -> float:
        """Norm of the residual up to which loops count as closed."""
        return max(RESIDUAL_TOLERANCE, GAP_TOLERANCE * self.gap)

    @cached_property
    def rank_share(self) -> float:
        """Singular values of the rows that are smaller than this, relative to the largest, count as zero."""
        return max(RANK_TOLERANCE, min(max(GAP_SHARE * self.gap, SHARES * self.rounding.share), GREATEST_SHARE))

    @property
    def seeds(self) -> tuple[ClosedState, ...]:
        """Closed, regular poses that define the assembly mode: the file's configurations, home first.

        Raises
        ------
        AssemblyError
            No closed, regular pose was found.
        DescriptionError
            The independent joints do not fit the mechanism's mobility.
        """
        if self._seeds is None:
            with self._seed_lock:
                if self._seeds is None:
                    from leg_dynamics.mechanism.assembly import find_seeds

                    if self._no_seeds is not None:
                        raise copy.copy(self._no_seeds)
                    try:
                        self._seeds = find_seeds(self)
                    except LegDynamicsError as error:
                        # The search takes seconds and would end the same way for every call.
                        self._no_seeds = copy.copy(error)
                        raise
        return self._seeds

    @property
    def is_open(self) -> bool:
        """Whether there is nothing to close: every joint of the tree is independent."""
        return self._is_open

    def adopt_seeds(self, seeds: tuple[ClosedState, ...]) -> None:
        """Let these closed poses define the assembly mode from now on."""
        with self._seed_lock:
            self._seeds = seeds

    def forget(self, every_pose: bool = False) -> None:
        """Let this thread's next pose start from a seed, or, with `every_pose`, repeat all the work that led to one."""
        self._workspace.last = None
        if every_pose:
            self._workspace.followed.clear()
            self._workspace.anchors.clear()

    @contextmanager
    def led(self, poses: np.ndarray) -> Iterator[None]:
        """While inside, this thread's poses at the coordinates of closed ones, (N, nv), are those, and no others led.

        For motions that lead, in the mode of the seeds, to where no straight way from them does. Coordinates at which
        a motion has two poses tell neither.
        """
        work, unit = self._workspace, self.closure.coordinate_unit
        before, known = work.led, dict[bytes, np.ndarray]()
        two: set[bytes] = set()
        for q in poses:
            key = q[self.independent].tobytes()
            other = known.setdefault(key, q)
            if other is not q and np.abs((self.unwound(other) - self.unwound(q)) / unit).max() > POSE_ROUNDING:
                two.add(key)
        self.forget()
        work.led = {key: q for key, q in known.items() if key not in two}
        try:
            yield
        finally:
            work.led = before
            self.forget()

    def close(self, y: np.ndarray) -> ClosedState:
        """Tree coordinates that close the loops at y (n,): where the straight way from the nearest seed leads.

        The last pose of this thread is a shorter way where it is near (see `remembers`) and the arrival is known to lie
        on the same sheet of poses as one nearby that was followed from a seed. For around a cusp one sheet runs
        smoothly into another, and small steps would carry a mechanism to the other assembly mode unnoticed. At the edge
        of what straight ways reach, a neighbour may lead a little further than the straight way would.

        Raises
        ------
        AssemblyError
            The mode has no such pose; carries `residual` and the last pose `reached`.
        SingularityError
            The way there, or the pose itself, is singular.
        DescriptionError
            The independent joints do not fit the mechanism's mobility.
        """
        if self._is_open:
            # Every joint of the tree is independent, in an order of its own.
            q = np.empty(self.nv)
            q[self.independent] = y
            return self._state(q, self._no_rows)
        work = self._workspace
        last, near = work.last, None
        distance = np.inf if last is None else self.distance(y - last.y)
        if last is not None and distance == 0.0:
            return last
        key = y.tobytes()
        known = work.led.get(key)
        if known is not None:
            work.last = self._settled(self.complete(self._state(known.copy(), self.evaluate(known))))
            return work.last
        if last is not None and self.remembers and distance <= CONTINUATION_STEP:
            near = self.advance(last, y)
            if near is not None and self._is_anchored(near):
                work.last = self._settled(near)
                return work.last
        if work.followed_from is not self.seeds:
            work.followed, work.anchors, work.followed_from = {}, {}, self.seeds
        known = work.followed.get(key)
        if known is not None:
            work.last = self._anchored(self.complete(self._state(known.copy(), self.evaluate(known))))
            return work.last
        failure: AssemblyError | SingularityError | None = None
        for seed in sorted(self.seeds, key=lambda seed: self.distance(y - seed.y)):
            try:
                work.last = self._anchored(self._settled(self.follow(seed, y)))
                # A doubtful pose is settled anew each time.
                if self.inverse_norm(work.last) <= DOUBTFUL_INVERSE:
                    if len(work.followed) >= KNOWN_POSES:
                        del work.followed[next(iter(work.followed))]
                    work.followed[key] = work.last.q.copy()
                return work.last
            except (AssemblyError, SingularityError) as error:
                failure = failure if failure is not None else error
        assert failure is not None
        if last is not None and near is not None and self._meets(failure, last, y):
            work.last = self._settled(near)
            return work.last
        raise failure

    def _meets(self, failure: AssemblyError | SingularityError, last: ClosedState, y: np.ndarray) -> bool:
        """Whether a way that failed did so right before y, on the sheet of `last`.

        Near a singular pose small steps lead further than those from afar.
        """
        q = getattr(failure, "tree_coordinates", None)
        if q is None or self.distance(q[self.independent] - y) > RIGHT_BEFORE:
            return False
        try:
            beside = self.follow(self.complete(self._state(q, self.evaluate(q))), last.y)
        except (AssemblyError, SingularityError):
            return False
        return float(np.abs((beside.q - last.q) / self.closure.coordinate_unit).max()) <= POSE_ROUNDING

    def _cell(self, y: np.ndarray) -> tuple[int, ...]:
        scaled = y / self._unit if self._has_lengths else y
        return tuple(np.floor(scaled * (1.0 / ANCHOR_CELL)).astype(int).tolist())

    def _anchored(self, state: ClosedState) -> ClosedState:
        """Let a pose that was followed from a seed vouch for its neighbours."""
        anchors = self._workspace.anchors
        cell = self._cell(state.y)
        if len(anchors) >= KNOWN_ANCHORS and cell not in anchors:
            del anchors[next(iter(anchors))]
        anchors[cell] = state
        return state

    def _is_anchored(self, state: ClosedState) -> bool:
        """Whether a pose is the neighbour of its cell's anchor, and not above or below it on another sheet."""
        if not len(self.dependent) or not self.closure.loops:
            return True
        work = self._workspace
        anchor = work.anchors.get(self._cell(state.y)) if work.followed_from is self.seeds else None
        if anchor is None:
            return False
        along = state.y - anchor.y
        expected = anchor.G.dot(along)
        off = state.q - anchor.q - expected
        if self._has_lengths:
            off, expected = off / self.closure.coordinate_unit, expected / self.closure.coordinate_unit
        return bool(off.dot(off) <= ANCHOR_SHARE**2 * expected.dot(expected) + POSE_ROUNDING**2)

    def unwound(self, q: np.ndarray) -> np.ndarray:
        """Tree coordinates (nv,) with passive angles in the turn that `WholeTurns` gives from the first seed.

        How many turns there are depends on the way that the closure took.
        """
        return self._whole_turns(q)

    @cached_property
    def _whole_turns(self) -> WholeTurns:
        home = np.full(self.nv, np.nan) if self._is_open else self.seeds[0].q
        return WholeTurns(self.description, self.tree.joint_names, self.joint_names, home)

    # ------------------------------------------------------------------ what rounding leaves of a result

    def _noise(self, state: ClosedState) -> float:
        """Size of the residual's rounding errors, dimensionless."""
        return ROUNDING * (1.0 + float(np.abs(state.rows.arms).max(initial=0.0)) / self.closure.length)

    def _settled(self, state: ClosedState) -> ClosedState:
        """The same pose; where it is nearly singular, with Newton continued to the limit of rounding.

        Raises
        ------
        SingularityError
            Rounding does not tell it from a singular pose.
        """
        if self.inverse_norm(state) <= DOUBTFUL_INVERSE:
            return state
        if self.inverse_norm(state) > RESOLVED and self.singular_values(state)[-1] * RESOLVED < 1.0:
            raise self._singular(state)
        limit = self._noise(state)
        for _ in range(SETTLING_STEPS):
            step = self._solve(state, -state.rows.residual.reshape(-1, 1)).ravel()
            if not math.sqrt(step.dot(step)) > limit * self.inverse_norm(state):
                break
            q = state.q.copy()
            q[self.dependent] += step * self._dependent_unit
            better = self._state(q, self.evaluate(q))
            if not better.residual < state.residual:
                break
            state = self.complete(better)
        # After a last, small step of Newton the rows may belong to the pose before it.
        state = self.complete(self._state(state.q, self.evaluate(state.q)))
        self.inverse_norm(state)
        return state

    def singular_values(self, state: ClosedState) -> np.ndarray:
        """Of the dependent columns per `Closure.coordinate_unit`, dimensionless, falling, shape (nv - n,)."""
        return np.linalg.svd(state.dependent_jacobian, compute_uv=False)

    def doubtful(self, state: ClosedState) -> bool:
        """Whether a pose is so nearly singular that its results need a look at `rounding_error`."""
        return self.inverse_norm(state) > DOUBTFUL_INVERSE

    def rounding_error(self, state: ClosedState, value: np.ndarray, function: Callable[[ClosedState], Any]) -> float:
        """How far rounding of the loops' residual moves a result, relative to 1 + its largest magnitude.

        The residual is known to some 1e-16 only. In the direction of a singular value sigma the pose is then known to
        1e-16 / sigma. The result is computed once more at the pose moved by that much, for each small singular value,
        and the changes are added. 0 where no singular value is small; NaN where the result is not finite.

        Parameters
        ----------
        state : ClosedState
        value : array
            ``function(state)``.
        function : callable
            The result as a function of the closed state.
        """
        if not self.doubtful(state):
            return 0.0
        _, sigma, directions = np.linalg.svd(state.dependent_jacobian, full_matrices=False)
        noise = self._noise(state)
        change = np.zeros(np.shape(value))
        for k in np.flatnonzero(sigma * DOUBTFUL_INVERSE < 1.0):
            q = state.q.copy()
            q[self.dependent] += noise / sigma[k] * directions[k] * self._dependent_unit
            change += np.abs(function(self.complete(self._state(q, self.evaluate(q)))) - value)
        return float(change.max(initial=0.0) / (1.0 + np.abs(value).max(initial=0.0)))

    def check_rounding(self, state: ClosedState, value: np.ndarray, function: Callable[[ClosedState], Any]) -> None:
        """Refuse a result at a nearly singular pose that rounding alone moves by more than `PROMISED`.

        Raises
        ------
        SingularityError
            Carries `error`, `limit` and `smallest_singular_value`; `margin` is the limit minus the error.
        """
        error = self.rounding_error(state, value, function)
        if error <= PROMISED or not np.isfinite(value).all():
            return
        sigma = self.singular_values(state)
        singular = self.singular(state)
        raise SingularityError(
            f"the closure is nearly singular at {self.pose_text(state.y)}: smallest singular value {sigma[-1]:.3g} of "
            f"largest {sigma[0]:.3g}, so that rounding changes this result by {error:.3g} of 1 + its magnitude, the "
            f"limit is {PROMISED:g}; {singular}: move away from this pose; what depends on the velocity is known "
            "better at a lower speed",
            margin=PROMISED - error,
            kind=singular.kind,
            direction=singular.direction,
            pose=self.pose(state.y),
            error=error,
            limit=PROMISED,
            smallest_singular_value=float(sigma[-1]),
            residual=state.residual,
        )

    # ------------------------------------------------------------------ kinematics

    def closure_drift(self, state: ClosedState, qd: np.ndarray) -> np.ndarray:
        """k of `Closure.drift`, (r,). Leaves J, dJ and the placements of this state in the workspace."""
        work = self._workspace
        pin.computeJointJacobiansTimeVariation(work.model, work.data, self.tree.to_configuration(state.q), qd)
        return self.closure.drift(state.rows, qd, work.data.J, work.data.dJ)

    def bias_acceleration(self, state: ClosedState, qd: np.ndarray) -> np.ndarray:
        """g (nv,): tree accelerations at ydd = 0. Leaves J, dJ and the placements of this state in the workspace."""
        k = self.closure_drift(state, qd)
        g = np.zeros(self.nv)
        if len(self.dependent):
            solution = self._solve(state, k.reshape(-1, 1)).ravel()
            g[self.dependent] = solution * self._dependent_unit if self._has_lengths else solution
        return g

    def _need_foot(self) -> int:
        if self.foot_frame is None:
            raise MissingFootError(
                f"the foot of {self.description.name!r} is not named: load it with foot='LINK', one of "
                f"{', '.join(link.name for link in self.description.links[-8:])}"
            )
        return self.foot_frame

    def place(self, state: ClosedState) -> None:
        """Bring this thread's pinocchio data to a pose: joint Jacobians and frame placements."""
        work = self._workspace
        pin.computeJointJacobians(work.model, work.data, self.tree.to_configuration(state.q))
        pin.updateFramePlacements(work.model, work.data)

    def joint_placements(self) -> Any:
        """World placement of each joint's body, pinocchio's ``oMi``, at the pose of the last `place`."""
        return self._workspace.data.oMi

    def foot_position(self, state: ClosedState) -> np.ndarray:
        """Foot position in the hip frame, m, shape (3,)."""
        frame = self._need_foot()
        self.place(state)
        origin = self._workspace.memory.rows()[4 * frame + 3]
        return self.hip_rotation.T @ (origin - self.hip_origin)

    def tree_foot_jacobian(self) -> np.ndarray:
        """Foot velocity in world axes per tree velocity, (3, nv), at the pose of the last `place`."""
        work = self._workspace
        jacobian = pin.getFrameJacobian(work.model, work.data, self._need_foot(), pin.LOCAL_WORLD_ALIGNED)
        # The bindings drop the column axis of a single joint.
        return jacobian[:3] if jacobian.ndim == 2 else jacobian[:3].reshape(3, 1)

    def foot_jacobian(self, state: ClosedState) -> np.ndarray:
        """Foot Jacobian in the hip frame: velocity = J yd, shape (3, n)."""
        self._need_foot()
        self.place(state)
        return self.hip_rotation.T @ (self.tree_foot_jacobian() @ state.G)

    def foot_motion(self, state: ClosedState) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position (3,) m, rotation R_HF (3, 3) and geometric Jacobian (6, n) of the foot, hip frame.

        The Jacobian's first three rows give the foot's velocity, the others its angular velocity.
        """
        frame = self._need_foot()
        self.place(state)
        work = self._workspace
        rows = work.memory.rows()
        axes, origin = rows[4 * frame : 4 * frame + 3], rows[4 * frame + 3]
        to_hip = self.hip_rotation.T
        jacobian = pin.getFrameJacobian(work.model, work.data, frame, pin.LOCAL_WORLD_ALIGNED).reshape((6, self.nv))
        whole = jacobian @ state.G
        return to_hip @ (origin - self.hip_origin), to_hip @ axes.T, np.vstack([to_hip @ whole[:3], to_hip @ whole[3:]])

    def foot_bias_acceleration(self, state: ClosedState, v: np.ndarray) -> np.ndarray:
        """Foot acceleration in the hip frame at ydd = 0, m/s², shape (3,)."""
        frame = self._need_foot()
        qd = state.G @ v
        g = self.bias_acceleration(state, qd)
        work = self._workspace
        pin.updateFramePlacements(work.model, work.data)
        rate = pin.getFrameJacobianTimeVariation(work.model, work.data, frame, pin.LOCAL_WORLD_ALIGNED)
        return self.hip_rotation.T @ (rate.reshape((6, self.nv))[:3] @ qd + self.tree_foot_jacobian() @ g)

    def foot_jacobian_derivative(self, state: ClosedState, v: np.ndarray) -> np.ndarray:
        """Time derivative of the foot Jacobian along v, shape (3, n).

        The bias acceleration is the quadratic form a(v) = v^T H v of the symmetric second-order influence
        coefficients H; its polar form (a(v + s e) - a(v - s e)) / 4 s is column e of Jdot, without truncation error.
        """
        speed = float(np.abs(v).max())
        if speed == 0.0:
            return np.zeros((3, self.n))
        a = self.foot_bias_acceleration
        columns = [a(state, v + unit) - a(state, v - unit) for unit in speed * np.eye(self.n)]
        return np.stack(columns, axis=1) / (4.0 * speed)

    # ------------------------------------------------------------------ dynamics

    def _set_gravity(self, gravity: np.ndarray | None) -> None:
        vector = self.gravity if gravity is None else gravity
        self._workspace.model.gravity.linear = self.hip_rotation @ vector

    def joint_friction(self, state: ClosedState, v: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Damping and Coulomb friction of the tree joints, opposing qd = G v, shape (nv,), N·m or N.

        A joint slower than `STANDSTILL` of the independent speeds together rests, and has no Coulomb friction; lengths
        count relative to the mechanism's.
        """
        moves = np.abs(qd / self.closure.coordinate_unit) > STANDSTILL * np.abs(v / self._unit).sum()
        return self.damping * qd + self.friction * np.where(moves, np.sign(qd), 0.0)

    def tree_torque(
        self, state: ClosedState, v: np.ndarray, a: np.ndarray, gravity: np.ndarray | None = None
    ) -> np.ndarray:
        """Open-tree joint torques of the closed motion, rnea(q, G yd, G ydd + g) plus joint friction, shape (nv,)."""
        work = self._workspace
        qd = state.G.dot(v)
        qdd = state.G.dot(a)
        if not self._is_open:
            qdd += self.bias_acceleration(state, qd)
        if gravity is not None:
            self._set_gravity(gravity)
        tau = pin.rnea(work.model, work.data, self.tree.to_configuration(state.q), qd, qdd)
        if gravity is not None:
            self._set_gravity(None)
        return tau + self.joint_friction(state, v, qd) if self.dissipates else tau

    def generalized_force(
        self,
        state: ClosedState,
        v: np.ndarray,
        a: np.ndarray,
        foot_force: np.ndarray | None = None,
        gravity: np.ndarray | None = None,
    ) -> np.ndarray:
        """Generalised force at y that produces the motion: tau = G^T rnea - J^T foot_force, shape (n,)."""
        tree_torque = self.tree_torque(state, v, a, gravity)
        if foot_force is not None:
            # Of a closed pose, the joint Jacobians are still in the workspace.
            if self._is_open:
                self.place(state)
            tree_torque = tree_torque - self.tree_foot_jacobian().T @ (self.hip_rotation @ foot_force)
        return state.G.T.dot(tree_torque)

    def actuator_effort(self, state: ClosedState, generalized: np.ndarray) -> np.ndarray:
        """Actuator efforts that do the same work as a generalised force at y, shape (m,).

        Raises
        ------
        ActuationError
            The actuators leave a motion free that the force drives, or more actuators than motions share the load.
        SingularityError
            The actuators lose a motion at this pose.
        """
        if self.directly_actuated:
            return generalized
        transfer = state.G[self.actuated].T
        if transfer.shape[1] != self.n:
            raise ActuationError.of_counts(repr(self.description.name), self.joint_names, self.actuator_joints)
        scaled = transfer * self._unit[:, None] / self.closure.coordinate_unit[self.actuated]
        sigma = np.linalg.svd(scaled, compute_uv=False)
        if not sigma[-1] > HELD_TOLERANCE * max(1.0, sigma[0]):
            raise self._not_held(state, sigma, np.linalg.svd(scaled)[0][:, -1])
        return np.linalg.solve(transfer, generalized)

    def check_held(self, before: ClosedState, after: ClosedState) -> None:
        """Check that exactly as many actuators as motions hold them all the way between two neighbouring poses.

        Raises
        ------
        SingularityError
            A motion may be lost between the poses.
        """
        if self.directly_actuated or len(self.actuated) != self.n:
            return
        scale = self._unit[None, :] / self.closure.coordinate_unit[self.actuated][:, None]
        first, second = before.G[self.actuated] * scale, after.G[self.actuated] * scale
        sigma = np.linalg.svd(first, compute_uv=False)
        if not sigma[-1] > HELD_TOLERANCE * max(1.0, sigma[0]):
            raise self._not_held(before, sigma, np.linalg.svd(first.T)[0][:, -1])
        if np.linalg.norm(second - first, 2) < sigma[-1]:
            return
        if self.distance(after.y - before.y) < SMALLEST_STEP:
            raise self._not_held(before, sigma, np.linalg.svd(first.T)[0][:, -1])
        middle = self.follow(before, 0.5 * (before.y + after.y))
        self.check_held(before, middle)
        self.check_held(middle, after)

    def _not_held(self, state: ClosedState, sigma: np.ndarray, motion: np.ndarray) -> SingularityError:
        """The error at a pose where the actuators lose the motion (n,), in units of the independent coordinates."""
        motion = motion / motion[np.argmax(np.abs(motion))]
        shown = ", ".join(f"{name} {x:+.3g}" for name, x in zip(self.joint_names, motion, strict=True) if abs(x) > 0.05)
        return SingularityError(
            f"the actuators do not hold every motion at {self.pose_text(state.y)}, a parallel singularity: with all of "
            f"them locked the mechanism can still move ({shown}), smallest singular value {sigma[-1]:.3g} of "
            f"{sigma[0]:.3g}; move away from this pose, or use generalized_force, which is always unique",
            margin=float(sigma[-1]),
            kind="parallel",
            direction=dict(zip(self.joint_names, motion.tolist(), strict=True)),
            pose=self.pose(state.y),
        )

    def _tree_mass(self, state: ClosedState) -> np.ndarray:
        work = self._workspace
        tree_mass = pin.crba(work.model, work.data, self.tree.to_configuration(state.q))
        return np.asarray(np.triu(tree_mass) + np.triu(tree_mass, 1).T)

    def mass_matrix(self, state: ClosedState) -> np.ndarray:
        """G^T M G, kg·m² (rad), kg (m), shape (n, n)."""
        return self._reduced(state, self._tree_mass(state))

    @staticmethod
    def _reduced(state: ClosedState, tree_mass: np.ndarray) -> np.ndarray:
        reduced: np.ndarray = state.G.T @ tree_mass @ state.G
        return 0.5 * (reduced + reduced.T)

    def cancellation(self, state: ClosedState, tree_mass: np.ndarray | None = None) -> float:
        """How many times what cancels in the mass matrix's diagonal is larger than what is left, at least 1.

        A heavy link that a loop keeps from turning: its inertia is in every term, and in the sum only by rounding.
        """
        tree_mass = self._tree_mass(state) if tree_mass is None else tree_mass
        left = np.abs(np.diagonal(state.G.T @ tree_mass @ state.G))
        terms = np.einsum("ji,jk,ki->i", np.abs(state.G), np.abs(tree_mass), np.abs(state.G))
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.where(terms > 0.0, terms / left, 1.0).max(initial=1.0))

    def potential_energy(self, state: ClosedState, gravity: np.ndarray | None = None) -> np.ndarray:
        """Potential energy of the moving bodies, zero at the hip's origin, J, shape ()."""
        work = self._workspace
        pin.centerOfMass(work.model, work.data, self.tree.to_configuration(state.q))
        vector = self.gravity if gravity is None else gravity
        height = self.hip_rotation.T @ (work.data.com[0] - self.hip_origin)
        return np.asarray(-work.data.mass[0] * (vector @ height))

    def bias(self, state: ClosedState, v: np.ndarray, gravity: np.ndarray | None = None) -> np.ndarray:
        """Generalised force at ydd = 0: Coriolis, centrifugal, gravity and joint friction, shape (n,)."""
        return self.generalized_force(state, v, np.zeros(self.n), None, gravity)

    def acceleration(
        self,
        state: ClosedState,
        v: np.ndarray,
        tau: np.ndarray,
        foot_force: np.ndarray | None = None,
        gravity: np.ndarray | None = None,
    ) -> np.ndarray:
        """Forward dynamics by projection: M ydd = G_a^T tau - bias + J^T foot_force, shape (n,).

        An open chain whose every joint is independent goes to pinocchio's articulated-body algorithm, unless massless
        links could make its mass matrix singular, which that algorithm does not notice.

        Raises
        ------
        SingularityError
            A motion carries no mass, so that its acceleration is not determined.
        """
        if self._is_open and self._has_every_mass and self.directly_actuated and not self.dissipates:
            work = self._workspace
            effort = np.zeros(self.nv)
            effort[self.actuated] = tau
            if foot_force is not None:
                effort += state.G @ (self.foot_jacobian(state).T @ foot_force)
            if gravity is not None:
                self._set_gravity(gravity)
            configuration = self.tree.to_configuration(state.q)
            result = pin.aba(work.model, work.data, configuration, state.G @ v, effort)
            if gravity is not None:
                self._set_gravity(None)
            if not np.isfinite(result).all() and not self._overflows(state):
                raise self._massless(state, 0.0)
            return result[self.independent]
        drive = tau if self.directly_actuated else state.G[self.actuated].T @ tau
        force = drive - self.generalized_force(state, v, np.zeros(self.n), foot_force, gravity)
        tree_mass = self._tree_mass(state)
        mass = self._reduced(state, tree_mass)
        # With unit diagonal the pivots of the Cholesky factor are free of units.
        scale = np.sqrt(np.diagonal(mass))
        pivot = 0.0
        if scale.min() > 0.0:
            factor, info = lapack.dpotrf(mass / np.outer(scale, scale), lower=1)
            pivot = 0.0 if info else float(np.diagonal(factor).min()) ** 2
        if not pivot > SMALLEST_MASS:
            if not np.isfinite(mass).all():
                return np.full(self.n, np.nan)
            raise self._massless(state, pivot)
        if not self._is_open and (cancelled := self.cancellation(state, tree_mass)) * MASS_ROUNDING > PROMISED:
            raise self._massless(state, 1.0 / cancelled)
        solution, _ = lapack.dpotrs(factor, force / scale, lower=1)
        return solution.ravel() / scale

    def _overflows(self, state: ClosedState) -> bool:
        """Whether an infinite acceleration of the open chain is too large a number, not a motion without mass."""
        work = self._workspace
        rest = np.zeros(self.nv)
        at_rest = pin.aba(work.model, work.data, self.tree.to_configuration(state.q), rest, rest)
        return bool(np.isfinite(at_rest).all() or not np.isfinite(self.mass_matrix(state)).all())

    def _massless(self, state: ClosedState, pivot: float) -> SingularityError:
        return SingularityError(
            f"the mass matrix is singular at {self.pose_text(state.y)}, or nearly (smallest pivot {pivot:.3g} of 1, "
            f"the least accepted is {SMALLEST_MASS:g}): a motion carries no mass; give the links it moves, or the "
            "rotors, their inertia, or move away from this pose where three hinges stand for a ball or floating joint "
            "and the middle one is at a right angle",
            margin=pivot,
        )

    def loop_forces(
        self,
        state: ClosedState,
        v: np.ndarray,
        a: np.ndarray,
        foot_force: np.ndarray | None = None,
        gravity: np.ndarray | None = None,
    ) -> LoopForces:
        """Forces in the cut loop joints for this motion, the ones of smallest norm where they are not unique.

        The tree's balance is rnea = S^T tau + J_F^T foot_force + K^T lambda with tau the actuator efforts; a row's
        multiplier times its wrench is what the predecessor exerts on the successor.

        Raises
        ------
        ActuationError, SingularityError
            The actuator efforts are not unique, so that the loop forces are not either.
        NonFiniteError
            The torques are too large for a float.
        """
        balance = self.tree_torque(state, v, a, gravity)
        generalized = state.G.T @ balance
        if foot_force is not None:
            self.place(state)
            world_force = self.hip_rotation @ foot_force
            tree_force = self.tree_foot_jacobian().T @ world_force
            balance = balance - tree_force
            generalized = generalized - state.G.T @ tree_force
        if not np.isfinite(balance).all():
            raise NonFiniteError(
                f"the loop forces at {self.pose_text(state.y)} are too large for a float: check the "
                "units of the arguments"
            )
        balance = balance.copy()
        balance[self.actuated] -= self.actuator_effort(state, generalized)
        K, unit = state.rows.jacobian, self.closure.coordinate_unit
        multipliers, _, rank, _ = np.linalg.lstsq((K * unit).T, balance * unit, rcond=self.rank_share)
        multipliers /= self.closure.row_unit
        wrenches = {}
        self.place(state)
        frames = self._workspace.memory.rows()
        for number, loop in enumerate(self.closure.loops):
            rows = self.closure.slices[number]
            total = multipliers[rows] @ state.rows.wrenches[rows]
            predecessor, _ = self.closure.ends[number]
            axes, origin = frames[4 * predecessor : 4 * predecessor + 3], frames[4 * predecessor + 3]
            moment = total[3:] - np.cross(origin, total[:3])
            wrenches[loop.name] = (axes @ total[:3], axes @ moment)
        coupling = multipliers[self.closure.loop_rows :].tolist()
        couplings = dict(zip(self.closure.coupling_names, coupling, strict=True))
        imbalance = float(np.abs(K.T @ (multipliers * self.closure.row_unit) - balance).max(initial=0.0))
        return LoopForces(wrenches, couplings, self.closure.rows - int(rank), imbalance)
