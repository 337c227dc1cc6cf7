"""Forward dynamics by pinocchio's own constrained algorithms: constraintDynamics and lcaba, made safe to call.

Both know rigid point and frame constraints only. A hinge loop becomes two coincident point pairs on its axis
(six rows of rank five), a spherical loop one pair, a fixed loop a frame pair. Couplings have no counterpart; they are
imposed by their multipliers: the constrained acceleration is affine in the joint torques, so
K_c qdd(tau + K_c^T lambda) = k_c is a small linear system for lambda.
"""

from __future__ import annotations

import threading
from typing import Literal

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from leg_dynamics.errors import NonFiniteError, SingularityError, UnsupportedError
from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism
from leg_dynamics.mechanism.tree import create_data

__all__ = ["ConstrainedDynamics"]

# Half the distance of a hinge's two points, in lengths of the mechanism.
HINGE_HALF_LENGTH = 0.5
PROXIMAL_ACCURACY = 1e-12
PROXIMAL_ITERATIONS = 300
# The proximal weight as a share of the smallest inverse inertia that the loops see (eigenvalue of K M^-1 K^T): a
# smaller one costs lcaba its digits, a larger one takes more iterations.
PROXIMAL_SHARE = 1.0
EIGENVALUE_SHARE = 1e-9
# Tree accelerations must keep the loops closed to this share of the largest.
CLOSED_SHARE = 1e-6
COUPLING_RANK = 1e-7
# The algorithms square speeds: beyond this, no result is finite.
LARGEST_SPEED = 1e150

Algorithm = Literal["constraintDynamics", "lcaba"]


class _Workspace(threading.local):
    """One thread's model copy and the data of both algorithms, initialised in the order that they need."""

    def __init__(self, model: pin.Model, constraints: pin.StdVec_RigidConstraintModel) -> None:
        self.model = model.copy()
        self.data = create_data(self.model)
        self.constraint_data = self._constraint_data(constraints)
        self.lcaba_data = create_data(self.model)
        self.lcaba_constraint_data = self._constraint_data(constraints)
        if len(constraints):
            # Without these calls the algorithms read unallocated memory.
            pin.initConstraintDynamics(self.model, self.data, constraints, self.constraint_data)
            pin.computeJointMinimalOrdering(self.model, self.lcaba_data, constraints)

    @staticmethod
    def _constraint_data(constraints: pin.StdVec_RigidConstraintModel) -> pin.StdVec_RigidConstraintData:
        data = pin.StdVec_RigidConstraintData()
        for constraint in constraints:
            data.append(constraint.createData())
        return data


class ConstrainedDynamics:
    """Tree accelerations under loop constraints, by two algorithms of pinocchio. Safe to use from several threads.

    Parameters
    ----------
    mechanism : Mechanism

    Raises
    ------
    UnsupportedError
        A loop is prismatic, planar or universal, which pinocchio's rigid constraints cannot express.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        model = mechanism.tree.model
        half = HINGE_HALF_LENGTH * mechanism.closure.length
        self.constraints = pin.StdVec_RigidConstraintModel()
        for loop, (predecessor, successor) in zip(mechanism.closure.loops, mechanism.closure.ends, strict=True):
            first, second = model.frames[predecessor], model.frames[successor]
            for kind, offset in self._pairs(loop.type, loop.name):
                shift = pin.SE3(np.eye(3), np.array([0.0, 0.0, offset * half]))
                self.constraints.append(
                    pin.RigidConstraintModel(
                        kind,
                        model,
                        first.parentJoint,
                        first.placement * shift,
                        second.parentJoint,
                        second.placement * shift,
                        pin.LOCAL,
                    )
                )
        self._workspace = _Workspace(model, self.constraints)

    @staticmethod
    def _pairs(kind: str, name: str) -> list[tuple[pin.ContactType, float]]:
        if kind in ("revolute", "continuous"):
            return [(pin.ContactType.CONTACT_3D, 1.0), (pin.ContactType.CONTACT_3D, -1.0)]
        if kind == "spherical":
            return [(pin.ContactType.CONTACT_3D, 0.0)]
        if kind == "fixed":
            return [(pin.ContactType.CONTACT_6D, 0.0)]
        raise UnsupportedError(
            f"loop {name!r} is {kind}: pinocchio's rigid constraints are points and frames; use the projected "
            "forward dynamics",
            loop=name,
        )

    def _settings(self, state: ClosedState, q: np.ndarray) -> pin.ProximalSettings | None:
        """Proximal settings for one pose; None where its mass matrix is singular."""
        work = self._workspace
        closure = self.mechanism.closure
        K = state.rows.jacobian[: closure.loop_rows] * closure.length
        factor, info = lapack.dpotrf(np.triu(pin.crba(work.model, work.data, q)), lower=0)
        if info:
            return None
        sigma = np.linalg.svd(np.linalg.solve(np.triu(factor).T, K.T), compute_uv=False) ** 2
        seen = sigma[sigma > EIGENVALUE_SHARE * sigma.max(initial=0.0)]
        weight = PROXIMAL_SHARE * float(seen.min(initial=np.inf)) if seen.size else 1.0
        return pin.ProximalSettings(PROXIMAL_ACCURACY, PROXIMAL_ACCURACY, weight, PROXIMAL_ITERATIONS)

    def _solve(
        self, algorithm: Algorithm, settings: pin.ProximalSettings, q: np.ndarray, qd: np.ndarray, tau: np.ndarray
    ) -> np.ndarray:
        work = self._workspace
        if not len(self.constraints):
            return np.array(pin.aba(work.model, work.data, q, qd, tau))
        if algorithm == "lcaba":
            return np.array(
                pin.lcaba(
                    work.model,
                    work.lcaba_data,
                    q,
                    qd,
                    tau,
                    self.constraints,
                    work.lcaba_constraint_data,
                    settings,
                )
            )
        return np.array(
            pin.constraintDynamics(work.model, work.data, q, qd, tau, self.constraints, work.constraint_data, settings)
        )

    def acceleration(
        self,
        state: ClosedState,
        v: np.ndarray,
        tau: np.ndarray,
        foot_force: np.ndarray | None = None,
        gravity: np.ndarray | None = None,
        algorithm: Algorithm = "constraintDynamics",
    ) -> np.ndarray:
        """Accelerations of the independent coordinates, shape (n,).

        Parameters
        ----------
        state : ClosedState
        v : (n,) array
        tau : (m,) array
            Actuator efforts, N·m or N.
        foot_force, gravity : (3,) array, optional
            Hip frame, N and m/s².
        algorithm : {"constraintDynamics", "lcaba"}
            Without loops both are the articulated-body algorithm.

        Raises
        ------
        NonFiniteError
            Speeds or efforts are too large to compute with.
        SingularityError
            The algorithm returns no finite acceleration, or none that keeps the loops closed.
        UnsupportedError
            There is no such algorithm.
        """
        if algorithm not in ("constraintDynamics", "lcaba"):
            raise UnsupportedError(f"algorithm must be 'constraintDynamics' or 'lcaba', got {algorithm!r}")
        mechanism = self.mechanism
        closure = mechanism.closure
        in_hip = mechanism.gravity if gravity is None else gravity
        self._workspace.model.gravity.linear = mechanism.hip_rotation @ in_hip
        q = mechanism.tree.to_configuration(state.q)
        qd = state.G @ v
        effort = np.zeros(mechanism.nv)
        effort[mechanism.actuated] = tau
        if mechanism.dissipates:
            effort -= mechanism.joint_friction(state, v, qd)
        if foot_force is not None:
            mechanism.place(state)
            effort += mechanism.tree_foot_jacobian().T @ (mechanism.hip_rotation @ foot_force)
        if not max(float(np.abs(qd).max()), float(np.sqrt(np.abs(effort).max()))) <= LARGEST_SPEED:
            raise NonFiniteError(
                f"the accelerations at {mechanism.pose_text(state.y)} are too large for a float: check the units of v, "
                "tau and foot_force"
            )
        settings = self._settings(state, q)
        if settings is None:
            raise self._no_acceleration(algorithm, state)
        qdd = self._solve(algorithm, settings, q, qd, effort)
        couplings = closure.coupling_rows
        if len(couplings) and np.isfinite(qdd).all():
            moved = [self._solve(algorithm, settings, q, qd, effort + row) for row in couplings]
            response = np.column_stack(moved) - qdd[:, None]
            compliance = couplings @ response
            multipliers, *_ = np.linalg.lstsq(compliance, -(couplings @ qdd), rcond=COUPLING_RANK)
            qdd = self._solve(algorithm, settings, q, qd, effort + couplings.T @ multipliers)
        if not np.isfinite(qdd).all():
            raise self._no_acceleration(algorithm, state)
        closed = state.G @ qdd[mechanism.independent] + mechanism.bias_acceleration(state, qd)
        error = float(np.abs((qdd - closed) / closure.coordinate_unit).max())
        if not error <= CLOSED_SHARE * (1.0 + float(np.abs(qdd / closure.coordinate_unit).max())):
            raise SingularityError(
                f"{algorithm} did not converge at {mechanism.pose_text(state.y)}: its accelerations open the loops "
                f"by {error:.3g}; use the projected forward dynamics",
                margin=-error,
            )
        return qdd[mechanism.independent]

    def _no_acceleration(self, algorithm: str, state: ClosedState) -> SingularityError:
        return SingularityError(
            f"{algorithm} gives no finite acceleration at {self.mechanism.pose_text(state.y)}: the mass matrix or the "
            "constraints are singular there; use the projected forward dynamics"
        )
