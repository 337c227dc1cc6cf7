"""Equations (1)-(53) of Xu et al. 2025 exactly as printed, right or wrong, on NumPy.

Wrong formulas live here and nowhere else: never compute a leg with them. Names and symbols are the paper's. A state
q (..., 3) is (alpha, beta, gamma) in rad; lengths in m; vectors (..., 3) in the frame that the paper names, Z0 down.
Columns (..., 3, 3) hold a velocity for a unit rate of alpha, beta, gamma.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Array = np.ndarray

X = np.array([1.0, 0.0, 0.0])
Y = np.array([0.0, 1.0, 0.0])
Z = np.array([0.0, 0.0, 1.0])

COMPLEX_STEP = 1e-30

TABLE_2 = {"L1": 0.15, "L3": 0.075, "L4": 0.095, "L5": 0.160}
"""Lengths of Table 2, m."""

L2_RANGE = (0.017, 0.19)
"""Range of the shank's length in Table 2, m."""

RANGES = ((0.0, 65.0), (0.0, 65.0), (0.0, 85.0))
"""Ranges of alpha, beta and gamma in Table 2, deg."""

GRAVITY = 9.81


def stack(*components: Any) -> Array:
    """Vector (..., 3) of components."""
    return np.stack(np.broadcast_arrays(*components), axis=-1)


def rot(axis: Array, angle: Any) -> Array:
    """Rotation by `angle` (...) about a constant unit axis: Rodrigues' formula, as printed below (4)."""
    x, y, z = axis
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = np.asarray(angle)[..., None, None]
    return np.eye(3) + hat * np.sin(angle) + hat @ hat * (1.0 - np.cos(angle))


def derivative(function: Callable[[Array], Array], q: Array) -> Array:
    """Influence coefficients (..., k, 3) of a function (..., k) of q: exact partial derivatives by complex steps."""
    columns = [function(q + 1j * COMPLEX_STEP * unit).imag / COMPLEX_STEP for unit in np.eye(3)]
    return np.stack(columns, axis=-1)


# Kinematics


def axes_of_branch_1() -> Array:
    """Unit axes of the joints of branch 1, (4, 3). Equation (1)."""
    return np.array([Y, X, X, Y])


def points_of_branch_1(leg: Any) -> Array:
    """Points on the axes of branch 1, (4, 3). Equation (2)."""
    return np.array([[0.0, leg.L3, 0.0], [0.0, leg.L3, 0.0], [0.0, leg.L3, leg.L1], [0.0, leg.L3, leg.L1]])


def zero_pose(leg: Any) -> Array:
    """Pose M of the knee in the straight leg, (4, 4). Equation (3)."""
    M = np.eye(4)
    M[:3, 3] = (0.0, 0.0, leg.L1)
    return M


def exponential(omega: Array, point: Array, theta: Array) -> Array:
    """Motion exp(S theta) of a joint, (..., 4, 4), with v = q x omega. Equation (4), third line."""
    v = np.cross(point, omega)
    R = rot(omega, theta)
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = (np.eye(3) - R) @ np.cross(omega, v) + np.outer(omega, omega) @ v * np.asarray(theta)[..., None]
    T[..., 3, 3] = 1.0
    return T


def branch_pose(leg: Any, axes: Array, points: Array, angles: Array) -> Array:
    """Pose (..., 4, 4) of the knee at the end of a branch with the joint angles (..., 4). Equation (4)."""
    T = np.eye(4)
    for i in range(4):
        T = T @ exponential(axes[i], points[i], angles[..., i])
    return T @ zero_pose(leg)


def branch_rotation(k: int) -> Array:
    """The matrix that leads from branch 1 to branch k. Equation (5), its matrix."""
    delta = np.pi / 2.0 * (k - 1)
    c, s = np.cos(delta), np.sin(delta)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def branch_rotation_by_label(k: int) -> Array:
    """What "rot(Z0, delta)" means. Equation (5), its label."""
    return rot(Z, np.pi / 2.0 * (k - 1))


def axes_of_branch(k: int, rotation: Callable[[int], Array] = branch_rotation) -> Array:
    """Unit axes of branch k, (4, 3). Equation (6)."""
    return axes_of_branch_1() @ rotation(k).T


def points_of_branch(leg: Any, k: int, rotation: Callable[[int], Array] = branch_rotation) -> Array:
    """Points on the axes of branch k, (4, 3). Equation (7)."""
    return points_of_branch_1(leg) @ rotation(k).T


def closure_gap(
    leg: Any, angles: tuple[Array, Array, Array], rotation: Callable[[int], Array] = branch_rotation
) -> Array:
    """Largest difference (...) of knee poses between the branches, each from its own angles. Equation (8)."""
    T = [
        branch_pose(leg, axes_of_branch(k, rotation), points_of_branch(leg, k, rotation), a)
        for k, a in enumerate(angles, 1)
    ]
    return np.abs(np.stack([T[1] - T[0], T[2] - T[0]])).max(axis=(0, -2, -1))


def knee_position(leg: Any, q: Array) -> Array:
    """Position of O0'. Equation (9)."""
    alpha, beta = q[..., 0], q[..., 1]
    angle = np.arctan(np.tan(alpha) * np.cos(beta))
    return stack(leg.L1 * np.cos(angle), -leg.L1 * np.sin(angle), leg.L1 * np.cos(beta) * np.cos(angle))


def leg_length_change(leg: Any, q: Array) -> Array:
    """Shortening of the shank. Equation (10)."""
    return 2.0 * leg.L4 - 2.0 * leg.L4 * np.cos(q[..., 2])


def foot_position(leg: Any, q: Array) -> Array:
    """Position of the foot. Equation (11)."""
    alpha, beta, gamma = q[..., 0], q[..., 1], q[..., 2]
    root = np.sqrt(1.0 + np.cos(beta) ** 2 * np.tan(alpha) ** 2)
    return stack(
        leg.L1 * np.sin(beta) / root,
        -leg.L1 * np.cos(beta) * np.tan(alpha) / root,
        leg.L1 * np.cos(beta) / root + 2.0 * leg.L4 * np.cos(gamma) + leg.L5,
    )


def passive_angles(q: Array) -> Array:
    """Angles theta12 and theta22, (..., 2). Equation (12)."""
    alpha, beta = q[..., 0], q[..., 1]
    theta12 = np.arctan(np.tan(alpha) * np.cos(beta))
    theta22 = np.arctan(np.tan(beta) * np.cos(alpha))
    return np.stack([theta12, theta22], axis=-1)


def inverse_kinematics(leg: Any, p: Array) -> Array:
    """Motor angles for a foot position, brackets as printed. Equation (13)."""
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    with np.errstate(invalid="ignore"):
        root = np.sqrt(leg.L1**2 - (x**2 + y**2))
        gamma = np.arccos(z - leg.L5 - root / (2.0 * leg.L4))
    return stack(np.arctan(y / root), np.arctan(x / root), gamma)


def foot_jacobian(leg: Any, q: Array) -> Array:
    """Partial derivatives of (11), (..., 3, 3). Equation (14)."""
    return derivative(lambda q: foot_position(leg, q), q)


# Motion of the bodies: angular velocities and velocities as columns, (..., 3, 3)


def columns(q: Array, alpha: Any = 0.0, beta: Any = 0.0, gamma: Any = 0.0) -> Array:
    """Columns (..., 3, 3) of the three vectors."""
    parts = [np.broadcast_to(part, (*q.shape[:-1], 3)) for part in (alpha, beta, gamma)]
    return np.stack(parts, axis=-1)


def omega_cross_A1(q: Array) -> Array:
    """Angular velocity [0, beta', 0] of the cross A1. Equation (15)."""
    return columns(q, beta=Y)


def omega_cross_B1(q: Array) -> Array:
    """Angular velocity [0, -beta', 0] of the cross B1. Equation (16)."""
    return columns(q, beta=-Y)


def directions_of_A1(q: Array) -> tuple[Array, Array]:
    """Directions of the two axes of the U joint A1. Equation (18)."""
    turn = rot(Y, q[..., 1])
    return turn @ Y, turn @ rot(X, passive_angles(q)[..., 0]) @ X


def omega_rod(q: Array) -> Array:
    """Angular velocity of the rod A1B1, theta12' as the total differential of (12). Equation (17)."""
    r_11, r_12 = directions_of_A1(q)
    rate_12 = derivative(passive_angles, q)[..., 0, :]
    return r_11[..., None] * Y + r_12[..., None] * rate_12[..., None, :]  # beta' is the second rate


def rod_rotation(q: Array) -> Array:
    """Rotation of the rod A1B1. Equation (19), second line."""
    return rot(Y, q[..., 1]) @ rot(X, passive_angles(q)[..., 0])


def rod_centre_from_A1(q: Array, centre: Array) -> Array:
    """Centre of mass of the rod from A1. Equation (19)."""
    return rod_rotation(q) @ centre


def rod_velocity_from_A1(q: Array, centre: Array) -> Array:
    """Velocity of the rod's centre of mass. Equation (20)."""
    return np.cross(omega_rod(q), rod_centre_from_A1(q, centre)[..., None], axis=-2)


def rod_centre(leg: Any, q: Array, centre: Array) -> Array:
    """Centre of mass of the rod from O0. Equation (22)."""
    return rod_centre_from_A1(q, centre) + np.array([0.0, leg.L3, 0.0])


def omega_input_shaft(q: Array) -> Array:
    """Angular velocity [0, 0, gamma'] of the input shaft. Equation (24)."""
    return columns(q, gamma=Z)


def velocity_input_shaft(q: Array) -> Array:
    """Velocity of the input shaft. Equation (25)."""
    return columns(q)


def omega_cross_A4(q: Array) -> Array:
    """Angular velocity [0, beta', gamma'] of the cross A4. Equation (26)."""
    return columns(q, beta=Y, gamma=Z)


def omega_cross_B4(q: Array) -> Array:
    """Angular velocity [0, beta', gamma'] of the cross B4, last form. Equation (27)."""
    return columns(q, beta=Y, gamma=Z)


def omega_cross_B4_as_sum(q: Array) -> Array:
    """The sum of (16) and gamma' about Z0 that (27) states first."""
    return omega_cross_B1(q) + omega_input_shaft(q)


def velocity_cross_A4(q: Array) -> Array:
    """Velocity of the cross A4. Equation (28)."""
    return columns(q)


def omega_shaft(q: Array) -> Array:
    """Angular velocity of the shaft A4B4: the rod's, and gamma' about Z0. Equation (29)."""
    return omega_rod(q) + columns(q, gamma=Z)


def velocity_shaft(q: Array, centre: Array) -> Array:
    """Velocity of the shaft's centre of mass: that of the rod. Equation (30)."""
    return rod_velocity_from_A1(q, centre)


def shaft_centre(q: Array, centre: Array) -> Array:
    """Centre of mass of the shaft, turned as the rod. Equation (31)."""
    return rod_rotation(q) @ centre


def knee_jacobian(leg: Any, q: Array) -> Array:
    """Partial derivatives of (9). Equation (32)."""
    return derivative(lambda q: knee_position(leg, q), q)


def knee_centre(position: Array, centre: Array) -> Array:
    """Centre of mass of the knee assembly, given the position of O0'. Equation (33)."""
    return centre + position


R_GAMMA_OF_29 = Z
"""r_gamma where the paper defines it, in (29)."""


def omega_C1D1(q: Array, r_gamma: Array = R_GAMMA_OF_29) -> Array:
    """Angular velocity of the link C1D1 in the frame at C1. Equation (34)."""
    return columns(q, gamma=r_gamma)


def C1D1_centre(q: Array, centre: Array) -> Array:
    """Centre of mass of C1D1 from C1. Equation (35)."""
    return rot(X, q[..., 2]) @ centre


def C1D1_velocity(q: Array, centre: Array, r_gamma: Array = R_GAMMA_OF_29) -> Array:
    """Velocity of the centre of mass of C1D1 in the frame at C1. Equation (36)."""
    return np.cross(omega_C1D1(q, r_gamma), C1D1_centre(q, centre)[..., None], axis=-2)


PHI_OF_TABLE_1 = 1.0
"""phi / gamma: Table 1 calls gamma the turn of C_i and of D_i, and no equation says otherwise."""


def omega_D1E1(q: Array, phi_per_gamma: float) -> Array:
    """Angular velocity of the link D1E1 in the frame at C1, both axes along X_C1. Equation (37)."""
    return columns(q, gamma=X + X * phi_per_gamma)


def D1E1_lever(q: Array, centre: Array) -> Array:
    """Centre of mass of D1E1 from D1, with the rotation of E1 "relative to C1", -gamma about X. Equation (39)."""
    return rot(X, q[..., 2]) @ rot(X, -q[..., 2]) @ centre


def D1E1_centre(leg: Any, q: Array, lever: Array) -> Array:
    """Centre of mass of D1E1 from C1, with the vector of (39) for the second term. Equation (38)."""
    return rot(X, q[..., 2]) @ np.array([0.0, 0.0, leg.L4]) + lever


def D1E1_velocity(position: Array, phi_per_gamma: float) -> Array:
    """Velocity of the centre of mass of D1E1 for gamma' = 1, both columns from the one symbol. Equation (40)."""
    return np.cross(X, position) + np.cross(X, position) * phi_per_gamma


def omega_in_hip(rotation: Array, omega: Array) -> Array:
    """Angular velocity taken from the frame at C1 to O0. Equation (41)."""
    return rotation @ omega


def position_in_hip(knee: Array, C1: Array, rotation: Array, position: Array) -> Array:
    """Position taken from the frame at C1 to O0. Equation (42)."""
    return knee + C1 + position @ rotation.T


def velocity_in_hip(knee: Array, rotation: Array, velocity: Array) -> Array:
    """Velocity taken from the frame at C1 to O0. Equation (43)."""
    return knee + rotation @ velocity


# Dynamics


def mass_matrix(bodies: list[tuple[float, Array, Array, Array]]) -> Array:
    """Mass matrix of the kinetic energy (44): of each body mass, inertia tensor, angular and linear columns.

    The tensor is used as given, although the angular velocity is in O0 and the tensor is constant in the body.
    """
    M: Any = 0.0
    for mass, inertia, omega, v in bodies:
        M = M + np.swapaxes(omega, -1, -2) @ inertia @ omega + mass * np.swapaxes(v, -1, -2) @ v
    return M


def potential_energy(bodies: list[tuple[float, Array]]) -> Array:
    """P = m g P_z of bodies (mass, centre of mass (..., 3)), Z0 pointing down. Equation (44)."""
    return sum(mass * GRAVITY * centre[..., 2] for mass, centre in bodies)  # type: ignore[return-value]


def lagrange(M_a: Array, M_rate_v: Array, gradient_of_L_at_rest: Array) -> Array:
    """d/dt (dL/dv) - dL(q)/dq, where L(q) holds no velocity. Equation (45)."""
    return M_a + M_rate_v - gradient_of_L_at_rest


def equation_of_motion(M_a: Array, V: Array, G: Array, gradient_of_L: Array) -> Array:
    """M a + V + G dL/dq, component by component: numbers in SI units, N·m beside (N·m)². Equation (46)."""
    return M_a + V + G * gradient_of_L


def foot_output_force(J: Array, tau: Array) -> Array:
    """F = (J^T)^-1 tau; NaN where J has no inverse. Equation (47), and (48) for tau = M a + V + G."""
    F = np.full(tau.shape, np.nan)
    for row in np.ndindex(tau.shape[:-1]):
        try:
            F[row] = np.linalg.solve(J[row].T, tau[row])
        except np.linalg.LinAlgError:
            continue
    return F


def force_with_external(F: Array, F_f: Array) -> Array:
    """F + F_f. Equation (49)."""
    return F + F_f


def torque_with_external(J: Array, F_ff: Array) -> Array:
    """J^T F_ff. Equation (50)."""
    return np.einsum("...ji,...j->...i", J, F_ff)


# Motions


def path_51(t: Array, T: float) -> Array:
    """Displacement X, Y, Z of the foot at times t in [0, 5] s. Equation (51); the paper gives no T."""

    def forth(s: Array) -> Array:
        return 0.1 * (0.06144 * s**5 - 0.384 * s**4 + 0.64 * s**3)

    x = np.where(t <= 2.5, forth(t), forth(T - t))
    y = 0.1 * (0.00192 * t**5 - 0.024 * t**4 + 0.08 * t**3)
    z = 0.05 * (-0.004096 * t**6 + 0.06144 * t**5 - 0.3072 * t**4 + 0.512 * t**3)
    return stack(x, y, z)


def motion_52(t: Array, gamma_amplitude: float = 25.0 * np.pi / 180.0) -> Array:
    """Motor angles at times t in [0, 6] s. Equation (52)."""
    sine = np.sin(np.pi * t / 3.0)
    return stack(np.pi / 6.0 * sine, np.pi / 6.0 * sine, gamma_amplitude * sine)


GAIT = {"L": 0.1, "H": 0.05, "L_h": 0.0, "T": 1.0}
"""Parameters of (53): m and s; H is 0 during stance."""


def path_53(t: Array, *, L: float, H: float, L_h: float, T: float) -> Array:
    """Displacement X, Y, Z of the foot during one step, t in [0, T]. Equation (53)."""
    s = t / T
    step = 6.0 * s**5 - 15.0 * s**4 + 10.0 * s**3
    lift = -64.0 * s**6 + 192.0 * s**5 - 192.0 * s**4 + 64.0 * s**3
    return stack(L_h * step, L * step, H * lift)
