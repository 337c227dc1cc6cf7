"""Forward dynamics by pinocchio's own constrained algorithms: constraintDynamics and lcaba, made safe to call.

Both know rigid point and frame constraints only. A hinge loop becomes two coincident point pairs on its axis
(six rows of rank five), a spherical loop one pair, a fixed loop a frame pair. Couplings have no counterpart; they are
imposed by their multipliers: the constrained acceleration is affine in the joint torques, so
K_c qdd(tau + K_c^T lambda) = k_c is a small linear system for lambda.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from leg_dynamics.errors import SingularityError, UnsupportedError
from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = ["ConstrainedDynamics"]

HINGE_HALF_LENGTH = 0.05


class ConstrainedDynamics:
    """Tree accelerations under loop constraints, by two algorithms of pinocchio.

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
        self.model = mechanism.tree.model.copy()
        self.constraints = pin.StdVec_RigidConstraintModel()
        for loop, (predecessor, successor) in zip(mechanism.closure.loops, mechanism.closure.ends, strict=True):
            for kind, offset in self._pairs(loop.type, loop.name):
                first, second = (self.model.frames[i] for i in (predecessor, successor))
                shift = pin.SE3(np.eye(3), np.array([0.0, 0.0, offset]))
                self.constraints.append(
                    pin.RigidConstraintModel(
                        kind,
                        self.model,
                        first.parentJoint,
                        first.placement * shift,
                        second.parentJoint,
                        second.placement * shift,
                        pin.LOCAL,
                    )
                )
        self.settings = pin.ProximalSettings(1e-12, 1e-12, 1e-6, 50)
        self.data = self.model.createData()
        self.constraint_data = pin.StdVec_RigidConstraintData()
        for constraint in self.constraints:
            self.constraint_data.append(constraint.createData())
        # Without this call constraintDynamics reads unallocated memory.
        pin.initConstraintDynamics(self.model, self.data, self.constraints)
        self.lcaba_data = self.model.createData()
        self.lcaba_constraint_data = pin.StdVec_RigidConstraintData()
        for constraint in self.constraints:
            self.lcaba_constraint_data.append(constraint.createData())
        if len(self.constraints):
            pin.computeJointMinimalOrdering(self.model, self.lcaba_data, self.constraints)

    @staticmethod
    def _pairs(kind: str, name: str) -> list[tuple[pin.ContactType, float]]:
        if kind in ("revolute", "continuous"):
            return [(pin.ContactType.CONTACT_3D, HINGE_HALF_LENGTH), (pin.ContactType.CONTACT_3D, -HINGE_HALF_LENGTH)]
        if kind == "spherical":
            return [(pin.ContactType.CONTACT_3D, 0.0)]
        if kind == "fixed":
            return [(pin.ContactType.CONTACT_6D, 0.0)]
        raise UnsupportedError(
            f"loop {name!r} is {kind}: pinocchio's rigid constraints are points and frames; use the projected forward dynamics",
            loop=name,
        )

    def _solve(self, algorithm: str, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
        if algorithm == "lcaba" and len(self.constraints):
            return np.array(
                pin.lcaba(
                    self.model,
                    self.lcaba_data,
                    q,
                    qd,
                    tau,
                    self.constraints,
                    self.lcaba_constraint_data,
                    self.settings,
                )
            )
        return np.array(
            pin.constraintDynamics(
                self.model, self.data, q, qd, tau, self.constraints, self.constraint_data, self.settings
            )
        )

    def acceleration(
        self,
        state: ClosedState,
        v: np.ndarray,
        tau: np.ndarray,
        foot_force: np.ndarray | None = None,
        gravity: np.ndarray | None = None,
        algorithm: str = "constraintDynamics",
    ) -> np.ndarray:
        """Accelerations of the independent coordinates, shape (n,); `algorithm` is constraintDynamics or lcaba.

        Raises
        ------
        SingularityError
            The algorithm returns no finite acceleration.
        """
        mechanism = self.mechanism
        closure = mechanism.closure
        self.model.gravity.linear = mechanism.hip_rotation @ (mechanism.gravity if gravity is None else gravity)
        q = mechanism.tree.to_configuration(state.q)
        qd = state.G @ v
        effort = np.zeros(mechanism.nv)
        effort[mechanism.actuated] = tau
        if mechanism.dissipates:
            effort -= mechanism._dissipation(qd)
        if foot_force is not None:
            mechanism._place(state)
            effort += mechanism._tree_foot_jacobian().T @ (mechanism.hip_rotation @ foot_force)
        qdd = self._solve(algorithm, q, qd, effort)
        couplings = closure.coupling_matrix
        if len(couplings):
            response = np.column_stack(
                [self._solve(algorithm, q, qd, effort + row) - qdd for row in couplings]
            )
            compliance = couplings @ response
            multipliers, *_ = np.linalg.lstsq(compliance, -(couplings @ qdd), rcond=1e-7)
            qdd = self._solve(algorithm, q, qd, effort + couplings.T @ multipliers)
        if not np.isfinite(qdd).all():
            raise SingularityError(
                f"{algorithm} gives no finite acceleration at {mechanism._pose(state.y)}: the mass matrix or the "
                "constraints are singular there; use the projected forward dynamics"
            )
        return qdd[mechanism.independent]
