"""Inverse dynamics of a hinge-loop mechanism as a user of pinocchio and NumPy would write it after reading the manuals.

Each hinge loop is two coincident pairs of points on its axis, the constraint Jacobian is pinocchio's own, the dependent
rates come from `numpy.linalg.pinv`, the positions from Newton on the points' distances. Correct, and shares no
code with the mechanism room.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from leg_dynamics.description.model import Description
from leg_dynamics.description.topology import coupling_equations, independent_joints
from leg_dynamics.errors import UnsupportedError

HALF_LENGTH = 0.05
CLOSED = 1e-12
ITERATIONS = 30


class Naive:
    """One mechanism; `last` is the warm start of the next closure, at first the zero pose."""

    def __init__(self, description: Description) -> None:
        self.model = pin.buildModelFromXML(description.urdf)
        if self.model.nq != self.model.nv:
            raise UnsupportedError("the naive case knows revolute and prismatic joints only")
        names = list(self.model.names[1:])
        self.independent = [names.index(name) for name in independent_joints(description)]
        self.dependent = [i for i in range(self.model.nv) if i not in self.independent]
        self.constraints = pin.StdVec_RigidConstraintModel()
        self.point_frames: list[tuple[int, int]] = []
        for loop in description.loops:
            if loop.type not in ("revolute", "continuous") or loop.axis is None:
                raise UnsupportedError(f"the naive case knows hinge loops only, {loop.name!r} is {loop.type}")
            for side in (HALF_LENGTH, -HALF_LENGTH):
                ends = []
                for end in (loop.predecessor, loop.successor):
                    body = self.model.frames[self.model.getFrameId(end.link)]
                    place = body.placement * pin.SE3(end.origin.rotation(), np.array(end.origin.xyz))
                    ends.append((body.parentJoint, place * pin.SE3(np.eye(3), side * np.array(loop.axis))))
                (joint1, place1), (joint2, place2) = ends
                self.constraints.append(
                    pin.RigidConstraintModel(
                        pin.ContactType.CONTACT_3D, self.model, joint1, place1, joint2, place2, pin.LOCAL
                    )
                )
                self.point_frames.append(
                    tuple(
                        self.model.addFrame(
                            pin.Frame(f"{loop.name} {side} {number}", joint, place, pin.FrameType.OP_FRAME)
                        )
                        for number, (joint, place) in enumerate(ends)
                    )
                )
        self.data = self.model.createData()
        self.constraint_data = pin.StdVec_RigidConstraintData()
        for constraint in self.constraints:
            self.constraint_data.append(constraint.createData())
        equations = coupling_equations(description)
        self.couplings = np.zeros((len(equations), self.model.nv))
        for row, equation in enumerate(equations):
            for name, coefficient in equation.coefficients.items():
                self.couplings[row, names.index(name)] = coefficient
        self.constants = np.array([equation.constant for equation in equations])
        self.last = np.zeros(self.model.nv)

    def constraint_jacobian(self, q):
        """K with K qd = 0; point rows are the velocity of point 1 relative to point 2 in the axes of end 1."""
        pin.computeJointJacobians(self.model, self.data, q)
        # Without calc the Jacobian below is silently wrong.
        for constraint, data in zip(self.constraints, self.constraint_data, strict=True):
            constraint.calc(self.model, self.data, data)
        points = pin.getConstraintsJacobian(self.model, self.data, self.constraints, self.constraint_data)
        return np.vstack([points, self.couplings])

    def residual(self, q):
        """Distances of the point pairs and of the couplings; call after `constraint_jacobian`."""
        points = [-data.c1Mc2.translation for data in self.constraint_data]
        return np.concatenate([*points, self.couplings @ q - self.constants])

    def close(self, y):
        q = self.last.copy()
        q[self.independent] = y
        for _ in range(ITERATIONS):
            K = self.constraint_jacobian(q)
            residual = self.residual(q)
            if np.abs(residual).max() < CLOSED:
                self.last = q
                return q
            q[self.dependent] -= np.linalg.pinv(K[:, self.dependent]) @ residual
        raise ArithmeticError(f"Newton does not converge in {ITERATIONS} steps from the last pose")

    def drift(self, q, qd):
        """k in K qdd = k."""
        pin.forwardKinematics(self.model, self.data, q, qd, np.zeros(self.model.nv))
        pin.updateFramePlacements(self.model, self.data)
        rows = []
        for first, second in self.point_frames:
            a1 = pin.getFrameClassicalAcceleration(self.model, self.data, first, pin.LOCAL_WORLD_ALIGNED).linear
            a2 = pin.getFrameClassicalAcceleration(self.model, self.data, second, pin.LOCAL_WORLD_ALIGNED).linear
            rows.append(self.data.oMf[first].rotation.T @ (a2 - a1))
        return np.concatenate([*rows, np.zeros(len(self.couplings))])

    def torque(self, q, v, a):
        """Torque at the independent joints with the closed tree coordinates q given."""
        K = self.constraint_jacobian(q)
        inverse = np.linalg.pinv(K[:, self.dependent])
        G = np.zeros((self.model.nv, len(self.independent)))
        G[self.independent] = np.eye(len(self.independent))
        G[self.dependent] = -inverse @ K[:, self.independent]
        qd = G @ v
        g = np.zeros(self.model.nv)
        g[self.dependent] = inverse @ self.drift(q, qd)
        return G.T @ pin.rnea(self.model, self.data, q, qd, G @ a + g)

    def torque_with_newton(self, y, v, a):
        return self.torque(self.close(y), v, a)
