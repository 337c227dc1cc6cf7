"""Legs whose kinematics is a textbook's: oracles that share nothing with the package."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from leg_dynamics.errors import JointLimitError, OutOfReachError


class Polar:
    """Azimuth, elevation, radius: foot = r (cos e cos a, cos e sin a, sin e); singular at r = 0 and e = +-90 deg."""

    name = "polar"
    joint_names = ("azimuth", "elevation", "radius")
    limits = SimpleNamespace(lower=np.array([-3.0, -1.5, 0.0]), upper=np.array([3.0, 1.5, 2.0]))
    forbidden = (0.0, 0.0)
    """Radii that cannot be reached: a hole that splits the workspace."""

    def foot_position(self, q, *, on_error="raise"):
        a, e, r = np.moveaxis(np.asarray(q), -1, 0)
        return np.stack([r * np.cos(e) * np.cos(a), r * np.cos(e) * np.sin(a), r * np.sin(e)], axis=-1)

    def inverse_kinematics(self, p, branch=None, limits="error", *, on_error="raise"):
        p = np.asarray(p, dtype=float)
        r = np.linalg.norm(p, axis=-1)
        q = np.stack([np.arctan2(p[:, 1], p[:, 0]), np.arctan2(p[:, 2], np.hypot(p[:, 0], p[:, 1])), r], axis=-1)
        low, high = self.forbidden
        rows = np.flatnonzero((r > low) & (r < high))
        if rows.size and on_error == "raise":
            margin = -np.minimum(r - low, high - r)[rows]
            raise OutOfReachError("the foot is in the hole", rows=rows, margin=margin)
        q[rows] = np.nan
        if limits == "error":
            margin = np.minimum(q - self.limits.lower, self.limits.upper - q).min(axis=1)
            if (margin < 0.0).any():
                rows = np.flatnonzero(margin < 0.0)
                raise JointLimitError("a joint is outside", rows=rows, margin=margin[rows])
        return q

    def jacobian(self, q):
        a, e, r = np.moveaxis(np.asarray(q), -1, 0)
        ca, sa, ce, se = np.cos(a), np.sin(a), np.cos(e), np.sin(e)
        zero = 0.0 * a
        return np.stack(
            [
                np.stack([-r * ce * sa, -r * se * ca, ce * ca], axis=-1),
                np.stack([r * ce * ca, -r * se * sa, ce * sa], axis=-1),
                np.stack([zero, r * ce, se], axis=-1),
            ],
            axis=-2,
        )

    def jacobian_derivative(self, q, v):
        # Central difference along the motion: independent of any formula.
        h = 1e-6
        return (self.jacobian(q + h * v) - self.jacobian(q - h * v)) / (2.0 * h)
