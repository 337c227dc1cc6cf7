"""Equations (1)-(33) of Rong et al. 2012 exactly as printed, right or wrong, on NumPy.

Wrong formulas live here and nowhere else: never compute a leg with them. Names and symbols are the paper's. Vectors
(..., 3) are in the frame A1-xyz, lengths in m, angles in rad. w1, w2, w3 are the directions of the struts, b and c the
vectors B0B2 and B1B3, a2 and a3 those from A1 to A2 and A3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray


def dot(first: Array, second: Array) -> Array:
    """Scalar product of vectors (..., 3)."""
    product: Array = np.einsum("...i,...i->...", *np.broadcast_arrays(first, second))
    return product


def times(scalar: Any, vector: Array) -> Array:
    """Scalars (...) times vectors (..., 3)."""
    return np.asarray(scalar)[..., None] * vector


# 3.1 and 3.2 Position


def rotation(alpha: Array, beta: Array) -> Array:
    """R = Rot(x, alpha) Rot(p1, beta) = [u p w], (..., 3, 3). Equation (1)."""
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    zero, one = np.zeros_like(sa), np.ones_like(sa)
    about_x = np.stack([one, zero, zero, zero, ca, -sa, zero, sa, ca], axis=-1).reshape(*sa.shape, 3, 3)
    about_y = np.stack([cb, zero, sb, zero, one, zero, -sb, zero, cb], axis=-1).reshape(*sa.shape, 3, 3)
    return about_x @ about_y


def foot_by_strut_1(l1: Array, w1: Array) -> Array:
    """Vector l1 of strut 1. Equation (2)."""
    return times(l1, w1)


def hinge_by_strut_2(a2: Array, l2: Array, w2: Array, b: Array) -> Array:
    """Right-hand side of e w1 = a2 + l2 w2 - b. Equation (3)."""
    return a2 + times(l2, w2) - b


def foot_by_strut_3(a3: Array, l3: Array, w3: Array, c: Array) -> Array:
    """Right-hand side of l1 = a3 + l3 w3 - c. Equation (4)."""
    return a3 + times(l3, w3) - c


def length_1(p: Array) -> Array:
    """Length of strut 1. Equation (5)."""
    x, y, z = np.moveaxis(p, -1, 0)
    length: Array = np.sqrt(x**2 + y**2 + z**2)
    return length


def length_2(e: float, w1: Array, b: Array, a2: Array) -> Array:
    """Length of strut 2; the bold e is read as the length e. Equation (6)."""
    return np.linalg.norm(e * w1 + b - a2, axis=-1)


def length_3(p: Array, c: Array, a3: Array) -> Array:
    """Length of strut 3. Equation (7)."""
    return np.linalg.norm(p + c - a3, axis=-1)


def direction(p: Array, l1: Array) -> Array:
    """Direction w = w1 of strut 1. Equation (8)."""
    return times(1.0 / l1, p)


def angles(w: Array) -> tuple[Array, Array]:
    """Angles (alpha, beta) of the platform. Equation (9)."""
    return np.arcsin(w[..., 0]), np.arctan(-w[..., 1] / w[..., 2])


# 3.3 Velocity


def velocity_by_strut_1(rate: Array, w1: Array, l1: Array, omega1: Array) -> Array:
    """Right-hand side of v1 = l1' w1 + l1 omega1 x w1. Equation (10)."""
    return times(rate, w1) + times(l1, np.cross(omega1, w1))


def velocity_by_strut_2(rate: Array, w2: Array, l2: Array, omega2: Array, omega1: Array, b: Array) -> Array:
    """Right-hand side of e omega1 x w1 = l2' w2 + l2 omega2 x w2 - omega1 x b. Equation (11)."""
    return times(rate, w2) + times(l2, np.cross(omega2, w2)) - np.cross(omega1, b)


def velocity_by_strut_3(rate: Array, w3: Array, l3: Array, omega3: Array, omega1: Array, c: Array) -> Array:
    """Right-hand side of v1 = l3' w3 + l3 omega3 x w3 - omega1 x c. Equation (12)."""
    return times(rate, w3) + times(l3, np.cross(omega3, w3)) - np.cross(omega1, c)


def rate_1(w1: Array, v1: Array) -> Array:
    """Rate of strut 1. Equation (13)."""
    return dot(w1, v1)


def rate_2(e: float, w1: Array, w2: Array, b: Array, omega1: Array) -> Array:
    """Rate of strut 2, solved for. Equation (14)."""
    return e * dot(np.cross(w1, w2), omega1) + dot(np.cross(b, w2), omega1)


def rate_3(w3: Array, c: Array, v1: Array, omega1: Array) -> Array:
    """Rate of strut 3, solved for. Equation (15)."""
    return dot(w3, v1) + dot(np.cross(c, w3), omega1)


def twist_jacobian(e: float, w1: Array, w2: Array, w3: Array, b: Array, c: Array) -> Array:
    """Matrix J of the struts' rates by (v1, omega1), (..., 3, 6). Equation (16)."""
    zero = np.zeros_like(w1)
    rows = (
        np.concatenate([w1, zero], axis=-1),
        np.concatenate([zero, e * np.cross(w1, w2) + np.cross(b, w2)], axis=-1),
        np.concatenate([w3, np.cross(c, w3)], axis=-1),
    )
    return np.stack(np.broadcast_arrays(*rows), axis=-2)


def rates_of_twist(J: Array, v1: Array, omega1: Array) -> Array:
    """Rates of the struts, (v1, omega1) read as one column. Equation (17)."""
    column = np.concatenate(np.broadcast_arrays(v1, omega1), axis=-1)
    rates: Array = np.einsum("...ij,...j->...i", J, column)
    return rates


def swing(l1: Array, w1: Array, omega1: Array) -> Array:
    """Right-hand side of w1 x v1 = l1 [omega1 - (w1 omega1) w1]. Equation (18)."""
    return times(l1, omega1 - times(dot(w1, omega1), w1))


def angular_velocity(l1: Array, w1: Array, v1: Array) -> Array:
    """Angular velocity omega1. Equation (19)."""
    return times(1.0 / l1, np.cross(w1, v1))


def rate_2_of_velocity(e: float, l1: Array, w1: Array, w2: Array, b: Array, v1: Array) -> Array:
    """Rate of strut 2 by v1, solved for. Equation (20)."""
    across = np.cross(w1, v1)
    return e / l1 * dot(np.cross(w1, w2), across) + dot(np.cross(b, w2), across) / l1


def rate_3_of_velocity(l1: Array, w1: Array, w3: Array, c: Array, v1: Array) -> Array:
    """Rate of strut 3 by v1, solved for. Equation (21)."""
    return dot(w3, v1) + dot(np.cross(c, w3), np.cross(w1, v1)) / l1


def simplified_rate_2(l1: Array, w1: Array, w2: Array, b: Array, v1: Array) -> Array:
    """Rate of strut 2 by v1. Equation (22)."""
    return -1.0 / l1 * dot(w2, w1) * dot(b, v1)


def simplified_rate_3(l1: Array, w1: Array, w3: Array, c: Array, v1: Array) -> Array:
    """Rate of strut 3 by v1. Equation (23)."""
    return dot(w3, v1) - 1.0 / l1 * dot(w3, w1) * dot(c, v1)


def jacobian(l1: Array, w1: Array, w2: Array, w3: Array, b: Array, c: Array) -> Array:
    """Matrix J_v of the struts' rates by v1, (..., 3, 3). Equation (24)."""
    rows = (w1, times(-dot(w2, w1) / l1, b), w3 - times(dot(w3, w1) / l1, c))
    return np.stack(np.broadcast_arrays(*rows), axis=-2)


def rates(J: Array, v1: Array) -> Array:
    """Rates of the struts, J_v v1. Equation (25)."""
    product: Array = np.einsum("...ij,...j->...i", J, v1)
    return product


# 4 Workspace and 5 dexterity


def lengths_allowed(q: Array, l_min: Any, l_max: Any) -> Array:
    """Whether lengths (..., 3) are within one pair of limits for all struts. Equation (26)."""
    allowed: Array = ((q >= l_min) & (q <= l_max)).all(axis=-1)
    return allowed


def ball_angle(q3: Array, l3: Array) -> Array:
    """Angle eta_b of the ball from a unit vector q3 and the vector l3 of strut 3. Equation (27)."""
    return np.arccos(dot(q3, l3))


def angle_allowed(angle: Array, limit: Any) -> Array:
    """Whether an angle of a U joint is allowed. Equation (28)."""
    allowed: Array = angle <= limit
    return allowed


STEP_ARGUMENTS = ("a", "b", "c", "e", "ball_range", "universal_range", "l_max", "l_max")
"""What the indices L and Z are functions of, with l_max twice. Equation (29)."""


def condition_number(J: Array) -> Array:
    """Condition number of a matrix (..., n, n). Equation (30)."""
    sigma = np.linalg.svd(J, compute_uv=False)
    ratio: Array = sigma[..., 0] / sigma[..., -1]
    return ratio


def mean(k: Array, dS: Array) -> float:
    """Mean condition number over the workspace. Equation (31)."""
    return float(np.sum(k * dS) / np.sum(dS))


def deviation(k: Array, dS: Array) -> float:
    """Deviation of the condition number over the workspace. Equation (32)."""
    return float(np.sqrt(np.sum((k - mean(k, dS)) ** 2 * dS)) / np.sum(dS))


DEXTERITY_ARGUMENTS = ("a", "b", "c", "e", "ball_range", "universal_range", "l_min", "l_max")
"""What the indices of dexterity are functions of, with one pair of limits for all struts. Equation (33)."""
