"""Robots whose legs are a universal joint and a slide without mass: kinematics that fit on a line of trigonometry."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from leg_dynamics.analysis.gait import Limb, Robot
from leg_dynamics.errors import OutOfReachError

HEIGHT = 0.5


class Telescope:
    """foot = r (sin b, -sin a cos b, cos a cos b) in a hip frame with z down; its efforts carry the foot force only."""

    name = "telescope"
    joint_names = ("alpha", "beta", "r")
    branches = ("down", "up")

    def __init__(self, shortest=0.2, longest=1.0, flip_at=None):
        self.limits = SimpleNamespace(
            lower=np.array([-1.2, -1.2, shortest]),
            upper=np.array([1.2, 1.2, longest]),
            velocity=np.full(3, 10.0),
            effort=np.full(3, 1e4),
        )
        self.flip_at = flip_at

    def foot_position(self, q):
        a, b, r = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
        return r[..., None] * np.stack([np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)], axis=-1)

    def inverse_kinematics(self, p, branch=None, limits="error"):
        p = np.asarray(p, dtype=float)
        x, y, z = np.moveaxis(p, -1, 0)
        r = np.linalg.norm(p, axis=-1)
        far = np.flatnonzero(r > 2.0)
        if far.size:
            raise OutOfReachError("the foot is too far away", rows=far, margin=2.0 - r[far])
        q = np.stack([np.arctan2(-y, z), np.arcsin(x / r), r], axis=-1)
        if branch == "up":
            q[..., 2] *= -1.0
        if self.flip_at is not None:
            # The same foot by another pose: a turned by half a circle, b to the other side.
            late = x > self.flip_at
            q[late] = np.stack([q[late, 0] + np.pi, np.pi - q[late, 1], r[late]], axis=-1)
        return q

    def jacobian(self, q):
        a, b, r = np.moveaxis(np.asarray(q, dtype=float), -1, 0)
        sa, ca, sb, cb = np.sin(a), np.cos(a), np.sin(b), np.cos(b)
        columns = (
            np.stack([0.0 * a, -r * ca * cb, -r * sa * cb], axis=-1),
            np.stack([r * cb, r * sa * sb, -r * ca * sb], axis=-1),
            np.stack([sb, -sa * cb, ca * cb], axis=-1),
        )
        return np.stack(columns, axis=-1)

    def jacobian_derivative(self, q, v):
        h = 1e-6
        return (self.jacobian(q + h * v) - self.jacobian(q - h * v)) / (2.0 * h)

    def torque(self, q, v, a, foot_force=None, gravity=None):
        return -np.einsum("...ij,...i->...j", self.jacobian(q), foot_force)


def toy_robot(count, leg=None, spacing=0.5, width=0.4, mass=20.0, **trunk):
    """An even number of legs in two rows, left legs mirrored; names run from the front, left first."""
    rows = count // 2
    limbs = []
    for row in range(rows):
        for side, y, mirror in (("L", width / 2, (1, -1, 1)), ("R", -width / 2, (1, 1, 1))):
            hip = np.diag([1.0, -1.0, -1.0, 1.0])
            hip[:3, 3] = (spacing * (0.5 * (rows - 1) - row), y, 0.0)
            home = hip[:3, 3] - np.array([0.0, 0.0, HEIGHT])
            limbs.append(Limb(f"{side}{row}", leg or Telescope(), hip, home, mirror))
    return Robot(f"toy {count}", tuple(limbs), trunk_mass=mass, **trunk)
