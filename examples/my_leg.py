"""Formulas of a leg as one writes them by hand, held against the file of the same leg.

The leg (my_leg.urdf) moves in the plane x-z: thigh and crank turn about the hip's axis, each by a motor, and a coupler
keeps the shank parallel to the crank. theta1 and theta2 count from straight down, forward.

    python examples/my_leg.py                    everything agrees
    python examples/my_leg.py --plant jacobian   with one sign error, which the report finds; exit status 1
"""

from __future__ import annotations

import argparse
import sys
from math import acos, atan2, cos, hypot, sin
from pathlib import Path

import numpy as np
from rich.console import Console

import leg_dynamics as ld

URDF = Path(__file__).with_name("my_leg.urdf")
FAULTS = (
    "position",
    "inverse",
    "jacobian",
    "jacobian_derivative",
    "mass",
    "coriolis",
    "gravity",
    "foot_force",
)


class MyLeg:
    """The leg's equations (1) to (13); `fault` plants a sign error in one of them."""

    l1, l2, b = 0.22, 0.24, 0.06  # thigh, shank, crank, m
    m1, c1, I1 = 0.80, 0.09, 0.0031  # thigh: mass, centre of mass from the hip, inertia about it
    m2, c2, I2 = 0.35, 0.08, 0.0022  # shank, from the knee
    m3, c3, I3 = 0.12, 0.03, 0.00005  # crank, from the hip
    m4, c4, I4 = 0.15, 0.11, 0.0008  # coupler, from the crank's pin
    g = 9.81

    joint_names = ("theta1", "theta2")

    def __init__(self, fault: str | None = None) -> None:
        self.fault = fault

    def sign(self, fault: str) -> float:
        return -1.0 if fault == self.fault else 1.0

    def assemble(self, q):
        """The knee bends by the difference of the angles, the crank's pin back (1)."""
        return {"theta1": q[0], "theta2": q[1], "knee": q[1] - q[0], "crank_pin": q[0] - q[1]}

    def foot_position(self, q):
        """The shank has the crank's direction (2)."""
        t1, t2 = q
        x = self.l1 * sin(t1) + self.sign("position") * self.l2 * sin(t2)
        z = -self.l1 * cos(t1) - self.l2 * cos(t2)
        return [x, 0.0, z]

    def inverse_kinematics(self, p):
        """Triangle of hip, knee and foot, the knee in front (3)."""
        x, _, z = p
        r = hypot(x, z)
        hip = acos((self.l1**2 + r**2 - self.l2**2) / (2 * self.l1 * r))
        foot = acos((self.l2**2 + r**2 - self.l1**2) / (2 * self.l2 * r))
        direction = atan2(x, -z)
        return [direction + self.sign("inverse") * hip, direction - foot]

    def jacobian(self, q):
        """Derivative of (2) by the angles (4)."""
        t1, t2 = q
        dz2 = self.sign("jacobian") * self.l2 * sin(t2)
        return [[self.l1 * cos(t1), self.l2 * cos(t2)], [0.0, 0.0], [self.l1 * sin(t1), dz2]]

    def jacobian_derivative(self, q, v):
        """Derivative of (4) by the time (5)."""
        (t1, t2), (w1, w2) = q, v
        dx1 = -self.sign("jacobian_derivative") * self.l1 * sin(t1) * w1
        return [[dx1, -self.l2 * sin(t2) * w2], [0.0, 0.0], [self.l1 * cos(t1) * w1, self.l2 * cos(t2) * w2]]

    def foot_acceleration(self, q, v, a):
        """From (4) and (5) (6)."""
        return np.array(self.jacobian(q)) @ a + np.array(self.jacobian_derivative(q, v)) @ v

    def coupling(self):
        return self.m2 * self.l1 * self.c2 - self.sign("mass") * self.m4 * self.b * self.c4

    def mass_matrix(self, q):
        """From the kinetic energy of the four links (7)."""
        m11 = self.I1 + self.m1 * self.c1**2 + self.m2 * self.l1**2 + self.I4 + self.m4 * self.c4**2
        m22 = self.I2 + self.m2 * self.c2**2 + self.I3 + self.m3 * self.c3**2 + self.m4 * self.b**2
        m12 = self.coupling() * cos(q[0] - q[1])
        return [[m11, m12], [m12, m22]]

    def potential_energy(self, q):
        """Heights of the centres of mass (8)."""
        moment1 = self.m1 * self.c1 + self.m2 * self.l1 + self.m4 * self.c4
        moment2 = self.m2 * self.c2 - self.m3 * self.c3 - self.m4 * self.b
        return -self.g * (moment1 * cos(q[0]) + moment2 * cos(q[1]))

    def gravity_torque(self, q):
        """Derivative of (8) (9)."""
        moment1 = self.m1 * self.c1 + self.m2 * self.l1 + self.m4 * self.c4
        moment2 = self.m2 * self.c2 - self.m3 * self.c3 - self.m4 * self.b
        return [self.g * moment1 * sin(q[0]), self.sign("gravity") * self.g * moment2 * sin(q[1])]

    def bias(self, q, v):
        """Centrifugal terms from (7), and (9) (10)."""
        c = self.coupling() * sin(q[0] - q[1])
        g1, g2 = self.gravity_torque(q)
        return [c * v[1] ** 2 + g1, -self.sign("coriolis") * c * v[0] ** 2 + g2]

    def torque(self, q, v, a, foot_force=None):
        """Equation of motion, with the force that the ground applies to the foot (11)."""
        tau = np.array(self.mass_matrix(q)) @ a + self.bias(q, v)
        if foot_force is not None:
            tau -= self.sign("foot_force") * np.transpose(self.jacobian(q)) @ foot_force
        return tau

    def acceleration(self, q, v, tau):
        """(11) solved for the accelerations, without a force (12)."""
        return np.linalg.solve(self.mass_matrix(q), np.subtract(tau, self.bias(q, v)))

    def kinetic_energy(self, q, v):
        """With (7) (13)."""
        return 0.5 * v @ np.array(self.mass_matrix(q)) @ v


def main() -> int:
    parser = argparse.ArgumentParser(description="Cross-check the formulas of MyLeg with my_leg.urdf.")
    parser.add_argument("--plant", choices=FAULTS, help="plant a sign error in one equation")
    parser.add_argument("--samples", type=int, default=300, help="random states")
    given = parser.parse_args()
    report = ld.crosscheck(MyLeg(given.plant), URDF, samples=given.samples)
    Console().print(report)
    return 0 if report.passed else 1


if __name__ == "__main__":
    sys.exit(main())
