"""A closed-loop mechanism at one state: closing the loops, G and g, torques by virtual work, accelerations, forces.

Symbols: independent coordinates y, tree coordinates q, loop rows phi(q) = 0 with K qd = 0 and K qdd = k,
qd = G yd, qdd = G ydd + g, and tau = G^T rnea(q, G yd, G ydd + g).
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.linalg import blas, lapack

from leg_dynamics.description.model import Description
from leg_dynamics.description.topology import actuated_joints, independent_joints
from leg_dynamics.errors import (
    ActuationError,
    AssemblyError,
    DescriptionError,
    MissingFootError,
    SingularityError,
)
from leg_dynamics.mechanism.closure import Closure, ClosureRows
from leg_dynamics.mechanism.tree import STANDARD_GRAVITY, FrameMemory, Tree

__all__ = ["ClosedState", "LoopForces", "Mechanism"]

# Newton is quadratic: after a step below STEP_TOLERANCE the error is at rounding level.
STEP_TOLERANCE = 1e-9
RESIDUAL_TARGET = 4e-15
RESIDUAL_TOLERANCE = 1e-10
NEWTON_ITERATIONS = 12
CONTINUATION_STEP = 0.3
SMALLEST_STEP = 1e-5
# The tangent must predict the corrected point to this share of the step, or the step is halved.
CORRECTION_SHARE = 0.3
SAFE_CORRECTION = 0.01
RANK_TOLERANCE = 1e-9


@dataclass(slots=True)
class ClosedState:
    """A closed pose with everything that depends on the pose alone.

    `q` (nv,) tree coordinates; `y` (n,) independent ones; `residual` the largest |phi|; `factor` the QR factors of
    the dependent columns of K; `G` (nv, n); `smallest_pivot` the smallest |R_ii|.
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


@dataclass(frozen=True)
class LoopForces:
    """Minimum-norm loop forces: what each loop joint transmits from its predecessor to its successor.

    `wrenches` maps a loop to (force N, moment N·m) in the predecessor's loop frame (z along the loop axis);
    `couplings` maps a coupling to its multiplier. Where `redundant_rows` > 0 the mechanism is overconstrained:
    internal forces are not unique, and these are the ones of smallest norm; actuator torques are unique all the same.
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
    """One thread's pinocchio model copy and data, and the state it closed last."""

    def __init__(self, tree: Tree) -> None:
        self.model = tree.model.copy()
        self.data = self.model.createData()
        self.memory = FrameMemory(self.model, self.data)
        self.last: ClosedState | None = None


class Mechanism:
    """Kinematics and dynamics of any description, one state at a time.

    Parameters
    ----------
    description : Description
    foot : str, optional
        Link whose origin is the foot; without it the foot methods raise `MissingFootError`.
    hip : str, optional
        Link in whose axes foot quantities, forces and gravity are expressed; the root where None.

    Raises
    ------
    DescriptionError, UnsupportedError
        The file cannot be modelled.
    """

    def __init__(self, description: Description, foot: str | None = None, hip: str | None = None) -> None:
        self.description = description
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
        self._selection = np.zeros((self.nv, self.n))
        self._selection[self.independent, np.arange(self.n)] = 1.0
        if self.closure.rows < len(self.dependent):
            raise DescriptionError(
                f"{len(self.dependent)} dependent joints but only {self.closure.rows} loop and coupling rows: the mechanism "
                f"has more than {self.n} free motions; mark more joints independent or add the missing loops",
                file=description.file,
            )
        self._workspace = _Workspace(self.tree)
        self._seed_lock = threading.RLock()
        self._seeds: tuple[ClosedState, ...] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {"description": self.description, "foot": self.foot, "hip": self.hip}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    @staticmethod
    def _independent(description: Description) -> tuple[str, ...]:
        names = independent_joints(description)
        if not names:
            raise DescriptionError("no joint is independent: mark at least one independent", file=description.file)
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

    def _evaluate(self, q: np.ndarray) -> ClosureRows:
        work = self._workspace
        pin.computeJointJacobians(work.model, work.data, self.tree.to_configuration(q))
        pin.updateFramePlacements(work.model, work.data)
        return self.closure.evaluate(q, work.memory.rows(), work.data.J)

    def _state(self, q: np.ndarray, rows: ClosureRows) -> ClosedState:
        residual = float(np.abs(rows.residual).max(initial=0.0))
        y = q[self.independent]
        count = len(self.dependent)
        if count == 0:
            empty = np.zeros((0, 0))
            return ClosedState(y, q, rows, residual, empty, (empty, empty), empty, np.inf, self._selection)
        columns = rows.jacobian.T
        dependent = columns.take(self.dependent, 0).T
        qr, reflectors, _, _ = lapack.dgeqrf(dependent)
        pivots = np.abs(qr.diagonal())
        smallest = float(pivots.min())
        state = ClosedState(
            y,
            q,
            rows,
            residual,
            dependent,
            (qr, reflectors),
            np.asfortranarray(qr[:count]),
            smallest / float(pivots.max()),
            self._selection,
        )
        return state

    def _solve(self, state: ClosedState, right_hand_side: np.ndarray) -> np.ndarray:
        qr, reflectors = state.factor
        # dormqr's smallest workspace and dtrsm keep to unthreaded code: dgels, dtrtrs and blocked dormqr wake BLAS threads,
        # which at this size cost a hundred times the arithmetic when other work shares the cores.
        rotated, _, _ = lapack.dormqr("L", "T", qr, reflectors, right_hand_side, max(1, right_hand_side.shape[1]))
        return blas.dtrsm(1.0, state.triangle, rotated[: len(self.dependent)])

    def _complete(self, state: ClosedState) -> ClosedState:
        """Fill in G; the pose must be regular."""
        if len(self.dependent) == 0:
            return state
        if state.smallest_pivot < RANK_TOLERANCE:
            raise self._singular(state)
        G = self._selection.copy()
        G[self.dependent] = self._solve(state, -state.rows.jacobian.T.take(self.independent, 0).T)
        state.G = G
        return state

    def _singular(self, state: ClosedState) -> SingularityError:
        sigma = np.linalg.svd(state.dependent_jacobian, compute_uv=False)
        return SingularityError(
            f"the closure is singular at {self._pose(state.y)}: smallest singular value {sigma[-1]:.3g} of largest "
            f"{sigma[0]:.3g}; the independent joints do not determine the others there: move away from this pose, or "
            "choose other independent joints",
            margin=float(sigma[-1]),
            residual=state.residual,
        )

    def _pose(self, y: np.ndarray) -> str:
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.joint_names, y, strict=True))

    def _correct(self, q: np.ndarray, allowed: float) -> ClosedState | None:
        """Newton on the dependent coordinates with y fixed; None where it would leave the neighbourhood `allowed`."""
        previous = np.inf
        state: ClosedState | None = None
        for _ in range(NEWTON_ITERATIONS):
            rows = self._evaluate(q)
            state = self._state(q, rows)
            if state.residual <= RESIDUAL_TARGET or previous <= STEP_TOLERANCE:
                break
            if state.smallest_pivot < RANK_TOLERANCE:
                return None
            step = self._solve(state, -rows.residual.reshape(-1, 1)).ravel()
            size = float(np.abs(step).max(initial=0.0))
            if not size <= min(allowed, 0.5 * previous if previous > 1e-6 else np.inf):
                return None
            q = q.copy()
            q[self.dependent] += step
            previous = size
        if state is None or not state.residual <= RESIDUAL_TOLERANCE:
            return None
        # Too small a correction to turn a pair over needs no look at it.
        if allowed > SAFE_CORRECTION and not self.closure.points_the_same_way(self._workspace.memory.rows()):
            return None
        return state

    def _crossed_singularity(self, before: ClosedState, after: ClosedState, step: float) -> bool:
        """Whether the closure's orientation flipped between two neighbouring poses.

        For K1 and K2 close together and regular, K1^T K2 is close to a positive definite matrix; its determinant
        turns negative when a singular value passes through zero in between. Far from singular poses the
        test is not needed.
        """
        if min(before.smallest_pivot, after.smallest_pivot) > 2.0 * step:
            return False
        lu, pivots, _ = lapack.dgetrf(before.dependent_jacobian.T @ after.dependent_jacobian)
        swaps = int(np.count_nonzero(pivots != np.arange(len(pivots))))
        negatives = int(np.count_nonzero(lu.diagonal() < 0.0))
        return (swaps + negatives) % 2 == 1

    def _advance(self, start: ClosedState, y: np.ndarray) -> ClosedState | None:
        """One predictor-corrector step from a closed pose to y in the same assembly mode, or None."""
        change = y - start.y
        movement = start.G @ change
        size = float(np.abs(movement).max(initial=0.0))
        q = start.q + movement
        q[self.independent] = y
        state = self._correct(q, CORRECTION_SHARE * size + 1e-7)
        if state is None or state.smallest_pivot < RANK_TOLERANCE:
            return None
        if len(self.dependent) and self._crossed_singularity(start, state, size):
            return None
        return self._complete(state)

    def _follow(self, start: ClosedState, y: np.ndarray) -> ClosedState:
        """Continuation along the straight line in y from a closed pose, halving the step where Newton strays."""
        total = float(np.abs(y - start.y).max(initial=0.0))
        done, step = 0.0, min(1.0, CONTINUATION_STEP / total) if total > 0 else 1.0
        state, origin = start, start.y
        while done < 1.0:
            share = min(step, 1.0 - done)
            target = y if done + share >= 1.0 else origin + (done + share) * (y - origin)
            reached = self._advance(state, target)
            if reached is None:
                step = share / 2.0
                if step < SMALLEST_STEP:
                    raise self._lost(state, target, done)
                continue
            state, done, step = reached, done + share, step * 1.5
        return state

    def _lost(self, state: ClosedState, target: np.ndarray, done: float) -> AssemblyError | SingularityError:
        if state.smallest_pivot < 1e-4 and len(self.dependent):
            sigma = np.linalg.svd(state.dependent_jacobian, compute_uv=False)
            if sigma[-1] < 1e-3 * sigma[0]:
                return SingularityError(
                    f"the assembly mode cannot be followed past a singular pose of the closure near {self._pose(state.y)} "
                    f"(smallest singular value {sigma[-1]:.3g} of {sigma[0]:.3g}, {done:.1%} of the way); take a path around it or "
                    "start from a configuration on the other side",
                    margin=float(sigma[-1]),
                    residual=state.residual,
                )
        q = state.q.copy()
        q[self.independent] = target
        residual = float(np.abs(self._evaluate(q).residual).max())
        return AssemblyError(
            f"the loops cannot be closed at {self._pose(target)}: the assembly mode was followed to {done:.1%} of the way "
            f"({self._pose(state.y)}), one step further the residual is {residual:.3g} against {RESIDUAL_TOLERANCE:g}; "
            "the pose is out of this mode's reach",
            margin=RESIDUAL_TOLERANCE - residual,
            residual=residual,
            reached=state.y.copy(),
        )

    @property
    def seeds(self) -> tuple[ClosedState, ...]:
        """Closed, regular poses that define the assembly mode: the file's configurations, home first."""
        if self._seeds is None:
            with self._seed_lock:
                if self._seeds is None:
                    from leg_dynamics.mechanism.assembly import find_seeds

                    self._seeds = find_seeds(self)
        return self._seeds

    def close(self, y: np.ndarray) -> ClosedState:
        """Tree coordinates that close the loops at y (n,), in the assembly mode of the nearest seed.

        Raises
        ------
        AssemblyError
            The mode has no such pose; carries `residual` and the last pose `reached`.
        SingularityError
            The way there, or the pose itself, is singular.
        """
        work = self._workspace
        last = work.last
        if last is not None and float(np.abs(y - last.y).max()) <= CONTINUATION_STEP:
            state = self._advance(last, y)
            if state is not None:
                work.last = state
                return state
        seeds = self.seeds
        start = min(seeds, key=lambda seed: float(np.abs(y - seed.y).max()))
        state = self._follow(start, y)
        work.last = state
        return state

    # ------------------------------------------------------------------ kinematics

    def _bias_acceleration(self, state: ClosedState, qd: np.ndarray) -> np.ndarray:
        """g (nv,): tree accelerations at ydd = 0. Leaves J, dJ and the placements of this state in the workspace."""
        work = self._workspace
        pin.computeJointJacobiansTimeVariation(work.model, work.data, self.tree.to_configuration(state.q), qd)
        g = np.zeros(self.nv)
        if len(self.dependent):
            k = self.closure.drift(state.rows, qd, work.data.J, work.data.dJ)
            g[self.dependent] = self._solve(state, k.reshape(-1, 1)).ravel()
        return g

    def _need_foot(self) -> int:
        if self.foot_frame is None:
            raise MissingFootError(
                f"the foot of {self.description.name!r} is not named: load it with foot='LINK', one of "
                f"{', '.join(link.name for link in self.description.links[-8:])}"
            )
        return self.foot_frame

    def _place(self, state: ClosedState) -> None:
        work = self._workspace
        pin.computeJointJacobians(work.model, work.data, self.tree.to_configuration(state.q))
        pin.updateFramePlacements(work.model, work.data)

    def foot_position(self, state: ClosedState) -> np.ndarray:
        """Foot position in the hip frame, m, shape (3,)."""
        frame = self._need_foot()
        self._place(state)
        origin = self._workspace.memory.rows()[4 * frame + 3]
        return self.hip_rotation.T @ (origin - self.hip_origin)

    def _tree_foot_jacobian(self) -> np.ndarray:
        work = self._workspace
        return pin.getFrameJacobian(work.model, work.data, self._need_foot(), pin.LOCAL_WORLD_ALIGNED)[:3]

    def foot_jacobian(self, state: ClosedState) -> np.ndarray:
        """Foot Jacobian in the hip frame: velocity = J yd, shape (3, n)."""
        self._need_foot()
        self._place(state)
        return self.hip_rotation.T @ (self._tree_foot_jacobian() @ state.G)

    def foot_bias_acceleration(self, state: ClosedState, v: np.ndarray) -> np.ndarray:
        """Foot acceleration in the hip frame at ydd = 0, m/s², shape (3,)."""
        frame = self._need_foot()
        qd = state.G @ v
        g = self._bias_acceleration(state, qd)
        work = self._workspace
        pin.updateFramePlacements(work.model, work.data)
        rate = pin.getFrameJacobianTimeVariation(work.model, work.data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        return self.hip_rotation.T @ (rate @ qd + self._tree_foot_jacobian() @ g)

    def foot_jacobian_derivative(self, state: ClosedState, v: np.ndarray) -> np.ndarray:
        """Time derivative of the foot Jacobian along v, shape (3, n).

        The bias acceleration is the quadratic form a(v) = v^T H v of the symmetric second-order influence
        coefficients H; its polar form (a(v + s e) - a(v - s e)) / 4 s is column e of Jdot, without truncation error.
        """
        speed = float(np.abs(v).max())
        if speed == 0.0:
            return np.zeros((3, self.n))
        columns = [
            (self.foot_bias_acceleration(state, v + unit) - self.foot_bias_acceleration(state, v - unit)) / (4.0 * speed)
            for unit in speed * np.eye(self.n)
        ]
        return np.stack(columns, axis=1)

    # ------------------------------------------------------------------ dynamics

    def _set_gravity(self, gravity: np.ndarray | None) -> None:
        vector = self.gravity if gravity is None else gravity
        self._workspace.model.gravity.linear = self.hip_rotation @ vector

    def _dissipation(self, qd: np.ndarray) -> np.ndarray:
        return self.damping * qd + self.friction * np.sign(qd)

    def tree_torque(
        self, state: ClosedState, v: np.ndarray, a: np.ndarray, gravity: np.ndarray | None = None
    ) -> np.ndarray:
        """Open-tree joint torques of the closed motion, rnea(q, G yd, G ydd + g) plus joint friction, shape (nv,)."""
        work = self._workspace
        qd = state.G @ v
        qdd = state.G @ a + self._bias_acceleration(state, qd)
        if gravity is not None:
            self._set_gravity(gravity)
        tau = pin.rnea(work.model, work.data, self.tree.to_configuration(state.q), qd, qdd)
        if gravity is not None:
            self._set_gravity(None)
        return tau + self._dissipation(qd) if self.dissipates else tau

    def generalized_force(
        self,
        state: ClosedState,
        v: np.ndarray,
        a: np.ndarray,
        foot_force: np.ndarray | None = None,
        gravity: np.ndarray | None = None,
    ) -> np.ndarray:
        """Generalised force at y that produces the motion: tau = G^T rnea - J^T foot_force, shape (n,)."""
        tau = state.G.T @ self.tree_torque(state, v, a, gravity)
        if foot_force is not None:
            tau -= self.foot_jacobian(state).T @ foot_force
        return tau

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
            kind = "redundantly actuated" if transfer.shape[1] > self.n else "under-actuated"
            raise ActuationError(
                f"{self.description.name!r} has {self.n} independent motions and {transfer.shape[1]} actuators: it is {kind} and "
                "the efforts are not unique; use generalized_force, which always is",
                motions=self.n,
                actuators=transfer.shape[1],
            )
        sigma = np.linalg.svd(transfer, compute_uv=False)
        if sigma[-1] < RANK_TOLERANCE * max(1.0, sigma[0]):
            raise SingularityError(
                f"the actuators do not hold every motion at {self._pose(state.y)}: smallest singular value {sigma[-1]:.3g}",
                margin=float(sigma[-1]),
            )
        return np.linalg.solve(transfer, generalized)

    def mass_matrix(self, state: ClosedState) -> np.ndarray:
        """G^T M G, kg·m² (rad), kg (m), shape (n, n)."""
        work = self._workspace
        tree_mass = pin.crba(work.model, work.data, self.tree.to_configuration(state.q))
        tree_mass = np.triu(tree_mass) + np.triu(tree_mass, 1).T
        reduced = state.G.T @ tree_mass @ state.G
        return 0.5 * (reduced + reduced.T)

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

        An open chain whose every joint is independent goes to pinocchio's articulated-body algorithm.
        """
        if self.closure.rows == 0 and self.directly_actuated and not self.dissipates:
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
            return result[self.independent]
        drive = tau if self.directly_actuated else state.G[self.actuated].T @ tau
        force = drive - self.generalized_force(state, v, np.zeros(self.n), foot_force, gravity)
        return np.linalg.solve(self.mass_matrix(state), force)

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
        """
        balance = self.tree_torque(state, v, a, gravity)
        generalized = state.G.T @ balance
        if foot_force is not None:
            self._place(state)
            world_force = self.hip_rotation @ foot_force
            tree_force = self._tree_foot_jacobian().T @ world_force
            balance = balance - tree_force
            generalized = generalized - state.G.T @ tree_force
        balance = balance.copy()
        balance[self.actuated] -= self.actuator_effort(state, generalized)
        K = state.rows.jacobian
        multipliers, _, rank, _ = np.linalg.lstsq(K.T, balance, rcond=RANK_TOLERANCE)
        wrenches = {}
        self._place(state)
        frames = self._workspace.memory.rows()
        for number, loop in enumerate(self.closure.loops):
            rows = self.closure.slices[number]
            total = multipliers[rows] @ state.rows.wrenches[rows]
            predecessor, _ = self.closure.ends[number]
            axes, origin = frames[4 * predecessor : 4 * predecessor + 3], frames[4 * predecessor + 3]
            moment = total[3:] - np.cross(origin, total[:3])
            wrenches[loop.name] = (axes @ total[:3], axes @ moment)
        couplings = dict(
            zip(self.closure.coupling_names, multipliers[self.closure.loop_rows :].tolist(), strict=True)
        )
        imbalance = float(np.abs(K.T @ multipliers - balance).max(initial=0.0))
        return LoopForces(wrenches, couplings, self.closure.rows - int(rank), imbalance)
