"""Equations (1)-(13) and Table 1 of Chen & Dong 2021 exactly as printed, right or wrong, on NumPy.

Wrong formulas live here and nowhere else: never compute a leg with them. Names and symbols are the paper's. Angles are
arrays (...) in rad, lengths in m, matrices (..., 4, 4). A mount is the place (a, b, c) of O_0 in the body.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray


class Lengths(NamedTuple):
    """l1, l2, l3, m."""

    l1: float
    l2: float
    l3: float


def matrix(rows: Any) -> Array:
    """Entries that are arrays or numbers as matrices (..., 4, 4)."""
    entries = np.broadcast_arrays(*(np.asarray(entry, dtype=float) for row in rows for entry in row))
    return np.stack(entries, axis=-1).reshape(*entries[0].shape, 4, 4)


def joined(theta_i: Array, theta_j: Array) -> tuple[Array, Array]:
    """c_ij and s_ij, as explained below (3)."""
    ci, si, cj, sj = np.cos(theta_i), np.sin(theta_i), np.cos(theta_j), np.sin(theta_j)
    return ci * cj - si * sj, si * cj + ci * sj


# Table 1


def table_rows(lengths: Lengths) -> tuple[tuple[float, float, float], ...]:
    """The columns a_(i-1), alpha_(i-1) and d_i of Table 1."""
    return ((lengths.l1, 0.5 * np.pi, 0.0), (lengths.l2, 0.0, 0.0), (lengths.l3, 0.0, 0.0))


def turn_and_shift(axis: int, angle: Array | float, shift: float) -> Array:
    """Screw motion along x (0) or z (2): a rotation about the axis and a shift along it."""
    s, c = np.sin(angle), np.cos(angle)
    if axis == 0:
        return matrix(((1.0, 0.0, 0.0, shift), (0.0, c, -s, 0.0), (0.0, s, c, 0.0), (0.0, 0.0, 0.0, 1.0)))
    return matrix(((c, -s, 0.0, 0.0), (s, c, 0.0, 0.0), (0.0, 0.0, 1.0, shift), (0.0, 0.0, 0.0, 1.0)))


def link_by_table(theta: Array, row: tuple[float, float, float], *, proximal: bool) -> Array:
    """A of one row of Table 1.

    Proximal (modified) Denavit-Hartenberg frames are what a_(i-1) and alpha_(i-1) mean: first along the old x, then
    about the new z. Distal (standard) ones go about the old z first, with a_i and alpha_i.
    """
    a, alpha, d = row
    along, about = turn_and_shift(0, alpha, a), turn_and_shift(2, theta, d)
    product: Array = along @ about if proximal else about @ along
    return product


def foot_by_table(lengths: Lengths, q: Array, mount: Array, *, proximal: bool) -> Array:
    """A_c0 A_01 A_12 A_23 by Table 1, for angles q (..., 3)."""
    pose = hip_to_body(mount)
    for i, row in enumerate(table_rows(lengths)):
        pose = pose @ link_by_table(q[..., i], row, proximal=proximal)
    return pose


# 2.2 Forward kinematics


def hip_to_body(mount: Array) -> Array:
    """A_c0. Equation (1)."""
    a, b, c = mount
    return matrix(((1.0, 0.0, 0.0, a), (0.0, 1.0, 0.0, b), (0.0, 0.0, 1.0, c), (0.0, 0.0, 0.0, 1.0)))


def foot_to_body(lengths: Lengths, q: Array, mount: Array) -> Array:
    """A_c3. Equation (2)."""
    (l1, l2, l3), (a, b, c) = lengths, mount
    t1, t2, t3 = np.moveaxis(q, -1, 0)
    c23, s23 = joined(t2, t3)
    c1, s1, c2, s2 = np.cos(t1), np.sin(t1), np.cos(t2), np.sin(t2)
    return matrix(
        (
            (c1 * c23, -c1 * s23, s1, (l3 * c23 + l2 * c2 + l1) * c1 + a),
            (s1 * c23, -s1 * s23, -c1, s1 * (l3 * c23 + l2 * c2) + l1 * s1 + b),
            (s23, c23, 0.0, (l3 * s23 + l2 * s2) + c),
            (0.0, 0.0, 0.0, 1.0),
        )
    )


TERMS = ("l₃ c₂₃ c₁", "l₂ c₂ c₁", "l₁ c₁", "a", "s₁ l₃ c₂₃", "s₁ l₂ c₂", "l₁ s₁", "b", "l₃ s₂₃", "l₂ s₂", "c")
"""Terms of (3): four of P_x, four of P_y, three of P_z."""

PLUS = (1.0,) * len(TERMS)


def foot_in_body(lengths: Lengths, q: Array, mount: Array, signs: Any = PLUS) -> Array:
    """P_x, P_y, P_z, (..., 3); a sign before each of its `TERMS`, all plus in print. Equation (3)."""
    (l1, l2, l3), (a, b, c) = lengths, mount
    t1, t2, t3 = np.moveaxis(q, -1, 0)
    c23, s23 = joined(t2, t3)
    c1, s1, c2, s2 = np.cos(t1), np.sin(t1), np.cos(t2), np.sin(t2)
    one = np.ones_like(c1)
    x = (l3 * c23 * c1, l2 * c2 * c1, l1 * c1, a * one)
    y = (s1 * l3 * c23, s1 * l2 * c2, l1 * s1, b * one)
    z = (l3 * s23, l2 * s2, c * one)
    terms = [sign * term for sign, term in zip(signs, (*x, *y, *z), strict=True)]
    return np.stack([sum(terms[:4]), sum(terms[4:8]), sum(terms[8:])], axis=-1)


POSE_4 = (0.0, -30.0, -60.0)
"""deg; the pose of (4)."""


def foot_at_pose_4(lengths: Lengths, mount: Array) -> Array:
    """P_x, P_y, P_z at `POSE_4`, (3,). Equation (4)."""
    (l1, l2, l3), (a, b, c) = lengths, mount
    return np.array([0.5 * np.sqrt(3.0) * l2 + l1 + a, b, -(l3 + 0.5 * l2) + c])


# 2.3 Inverse kinematics. A pose is (5): the columns n, o, alpha and p.


def columns(pose: Array) -> tuple[Array, Array, Array, Array]:
    """n, o, alpha and p of a pose, each (..., 3). Equation (5)."""
    n, o, alpha, p = np.moveaxis(pose[..., :3, :], -1, 0)
    return n, o, alpha, p


def product_12_23(lengths: Lengths, q: Array) -> Array:
    """A_12 A_23, right-hand side of (6) and (7)."""
    _, l2, l3 = lengths
    c23, s23 = joined(q[..., 1], q[..., 2])
    c2, s2 = np.cos(q[..., 1]), np.sin(q[..., 1])
    return matrix(
        (
            (c23, -s23, 0.0, l2 * c2 + l3 * c23),
            (s23, c23, 0.0, l2 * s2 + l3 * s23),
            (0.0, 0.0, 1.0, 0.0),
            (0.0, 0.0, 0.0, 1.0),
        )
    )


def product_by_inverses(lengths: Lengths, pose: Array, theta1: Array, mount: Array) -> Array:
    """A_01^-1 A_c0^-1 A_c3, left-hand side of (6), with A_01 of Table 1."""
    first = link_by_table(theta1, table_rows(lengths)[0], proximal=False)
    return np.linalg.inv(hip_to_body(mount) @ first) @ pose


class Frame1(NamedTuple):
    """What (7) prints beside its matrix; f13 it does not print, and f33 it prints twice."""

    f33_first: Array
    f33_second: Array


def foot_from_link_1(pose: Array, theta1: Array, mount: Array, length: float) -> tuple[Array, Frame1]:
    """Left-hand side of (7), with NaN for f13, its second f33, and `length` for its l; and both f33. Equation (7)."""
    a, b, c = mount
    (nx, ny, nz), (ox, oy, oz), (ax, ay, az), (px, py, pz) = (np.moveaxis(v, -1, 0) for v in columns(pose))
    s1, c1 = np.sin(theta1), np.cos(theta1)
    both = Frame1(nx * s1 - ny * c1, ax * s1 - ay * c1)
    rows = (
        (nx * c1 + ny * s1, ox * c1 + oy * s1, np.nan, s1 * (py - b) + c1 * (px - a) - length),
        (nz, oz, az, pz - c),
        (nx * s1 - ny * c1, ox * s1 - oy * c1, both.f33_second, s1 * (px - a) + c1 * (b - py)),
        (0.0, 0.0, 0.0, 1.0),
    )
    return matrix(rows), both


def theta_1(p: Array, mount: Array) -> Array:
    """theta1. Equation (8)."""
    a, b, _ = mount
    angle: Array = np.arctan((p[..., 1] - b) / (p[..., 0] - a))
    return angle


def T(lengths: Lengths, p: Array, theta1: Array, mount: Array) -> Array:
    """T, as explained below (9)."""
    a, b, _ = mount
    s1, c1 = np.sin(theta1), np.cos(theta1)
    distance: Array = p[..., 1] * s1 - b * s1 + p[..., 0] * c1 - a * c1 - lengths.l1
    return distance


def foot_from_link_2(lengths: Lengths, pose: Array, theta1: Array, theta2: Array, mount: Array) -> Array:
    """A_12^-1 A_01^-1 A_c0^-1 A_c3. Equation (9)."""
    a, b, c = mount
    (nx, ny, nz), (ox, oy, oz), (ax, ay, az), p = (np.moveaxis(v, -1, 0) for v in columns(pose))
    px, py, pz = p
    s1, c1, s2, c2 = np.sin(theta1), np.cos(theta1), np.sin(theta2), np.cos(theta2)
    t = T(lengths, np.moveaxis(p, 0, -1), theta1, mount)
    rows = (
        (
            nz * s2 + nx * c1 * c2 + ny * c2 * s1,
            oz * s2 + ox * c1 * c2 + oy * c2 * s1,
            az * s2 + ax * c1 * c2 + ay * c2 * s1,
            s2 * (pz - c) + c2 * t - lengths.l2,
        ),
        (
            nz * c2 - nx * c1 * s2 - ny * s1 * s2,
            oz * c2 - ox * c1 * s2 - oy * s1 * s2,
            az * c2 - ax * c1 * s2 - ay * s1 * s2,
            c2 * (pz - c) - s2 * t,
        ),
        (nx * s1 - ny * c1, ox * s1 - oy * c1, ax * s1 - ay * c1, c1 * (b - py) + s1 * (px - a)),
        (0.0, 0.0, 0.0, 1.0),
    )
    return matrix(rows)


def along_link_2(lengths: Lengths, t: Array, z: Array, theta2: Array) -> Array:
    """Left-hand side of (10); z is p_z - c. Equation (10)."""
    left: Array = np.sin(theta2) * z + np.cos(theta2) * t - lengths.l2
    return left


def across_link_2(t: Array, z: Array, theta2: Array) -> Array:
    """Left-hand side of (11). Equation (11)."""
    left: Array = np.cos(theta2) * z - np.sin(theta2) * t
    return left


def theta_2_sine(lengths: Lengths, t: Array, z: Array, factor: float = 1.0) -> Array:
    """Argument of the arcsine of (12); `factor` stands before l2 in the denominator, 1 in print."""
    _, l2, l3 = lengths
    sine: Array = (z**2 + t**2 + l2**2 - l3**2) / (factor * l2 * np.sqrt(z**2 + t**2))
    return sine


def theta_2(lengths: Lengths, t: Array, z: Array, factor: float = 1.0, sign: Array | float = 1.0) -> Array:
    """theta2, NaN where there is none; factor and the arcsine's sign are 1 in print. Equation (12)."""
    with np.errstate(invalid="ignore"):
        angle: Array = sign * np.arcsin(theta_2_sine(lengths, t, z, factor)) - np.arctan(t / z)
    return angle


def theta_3(lengths: Lengths, t: Array, z: Array, theta2: Array) -> Array:
    """theta3, NaN where there is none. Equation (13)."""
    with np.errstate(invalid="ignore"):
        angle: Array = np.arcsin(across_link_2(t, z, theta2) / lengths.l3)
    return angle
