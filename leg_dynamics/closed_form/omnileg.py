"""OmniLeg (Xu et al. 2025): kinematics and dynamics in closed form, equation by equation.

Coordinates are q = (alpha, beta, gamma) in rad: motors M2, M1, M3. All vectors are in the hip frame O0 X0 Y0 Z0, whose
Z0 points DOWN along the straight leg. Where the paper prints a wrong sign or leaves out a factor, the formula here is
the corrected one and its docstring says what changed. Equation numbers end the line that states the equation.

The paper's tangents are written with

    D = 1 - sin^2(alpha) sin^2(beta) = cos^2(alpha) + sin^2(alpha) cos^2(beta) = cos^2(beta) + cos^2(alpha) sin^2(beta)

because 1 + tan^2(alpha) + tan^2(beta) = D / (cos^2(alpha) cos^2(beta)). Both forms agree for |alpha|, |beta| < 90 deg;
beyond, the one with D follows the mechanism continuously, the one with tangents jumps.

Every formula takes Python floats, NumPy arrays or CasADi symbols as components (see `algebra`) and never looks at a
value. Domain margins are returned as values. Branch numbers, branch names and the transmission model are plain Python
and choose the formula.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from leg_dynamics.closed_form import _omnileg_composite
from leg_dynamics.closed_form._omnileg_composite import (
    BASE_PARAMETER_NAMES,
    BASE_PARAMETER_UNITS,
    CompositeParameters,
)
from leg_dynamics.closed_form.algebra import (
    IDENTITY,
    ZERO,
    Matrix,
    Scalar,
    Vector,
    acos,
    add,
    atan2,
    cos,
    cross,
    determinant,
    dot,
    fabs,
    fmax,
    fmin,
    matmul,
    matvec,
    negate,
    rotate_tensor,
    rotation_z,
    scale,
    sign,
    sin,
    skew,
    solve,
    solve_symmetric,
    sqrt,
    subtract,
    total,
    transpose,
    where,
    where_domain,
)
from leg_dynamics.closed_form.rigid_body import (
    FIXED,
    STILL,
    Angle,
    Body,
    CentreOfMass,
    Dissipation,
    Motion,
    Turning,
    gravity_force,
    hinged,
    inertia_matrix,
    kinetic,
    potential,
    shifted,
    virtual_work,
)
from leg_dynamics.description.model import STANDSTILL
from leg_dynamics.errors import RouteError

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description

__all__ = [
    "ARCCOS_TOLERANCE",
    "BASE_PARAMETER_NAMES",
    "BASE_PARAMETER_UNITS",
    "BODY_NAMES",
    "BRANCHES",
    "JOINT_NAMES",
    "OPTIONS",
    "SINGULARITY_LIMIT",
    "TRANSMISSIONS",
    "TREE_JOINT_NAMES",
    "Angle",
    "Body",
    "CentreOfMass",
    "CompositeParameters",
    "Dissipation",
    "InverseKinematics",
    "Motion",
    "OmniLeg",
    "Pose",
    "Screw",
    "Turning",
    "base_parameters",
    "bias",
    "body_motions",
    "branch_angles",
    "branch_motions",
    "branch_pose",
    "branch_rotation",
    "branch_screws",
    "cardan_angles",
    "centre_of_mass",
    "closure_residual",
    "composite_bias",
    "composite_forward_dynamics",
    "composite_gravity_torque",
    "composite_inverse_dynamics",
    "composite_mass_matrix",
    "composite_parameters",
    "composite_potential_energy",
    "dissipation_torque",
    "exponential",
    "foot_acceleration",
    "foot_bias_acceleration",
    "foot_force",
    "foot_force_torque",
    "foot_jacobian",
    "foot_jacobian_derivative",
    "foot_jacobian_determinant",
    "foot_position",
    "foot_second_order_coefficients",
    "foot_velocity",
    "forward_dynamics",
    "from_urdf",
    "gravity_torque",
    "inverse_dynamics",
    "inverse_kinematics",
    "inverse_kinematics_thigh_up",
    "joint_axis",
    "joint_point",
    "kinetic_energy",
    "knee_position",
    "lagrangian",
    "leg_length_change",
    "mass_matrix",
    "passive_angles",
    "potential_energy",
    "product_of_exponentials",
    "regressor",
    "shank_motions",
    "singularity_margins",
    "transmission_angular_velocities",
    "transmission_motions",
    "tree_coefficients",
    "tree_coordinates",
    "with_every_number",
    "zero_pose",
]

JOINT_NAMES = ("alpha", "beta", "gamma")
BRANCHES = ("gamma_positive", "gamma_negative")
"""Names of the inverse kinematic solutions, the default first; both have the thigh pointing down."""

TRANSMISSIONS = ("exact", "paper", "none")
"""Models of the Cardan shaft A4B4 and its crosses in the dynamics, see `OmniLeg.transmission`."""
OPTIONS: Mapping[str, tuple[str, ...]] = MappingProxyType({"transmission": TRANSMISSIONS})
"""What `from_urdf` can be asked for, the default first."""

ARCCOS_TOLERANCE = 1e-12
"""Excess over 1 of the arccos argument of (13) that counts as rounding: 1.9e-13 m of leg length at L4 = 95 mm.

At gamma = 0 rounding lifts the argument above 1 in about one pose in six, by less than 1e-15.
"""

SINGULARITY_LIMIT = 1e-6
"""Least usable value of `singularity_margins`; below, rates of passive angles lose more than half of their digits."""

TREE_JOINT_NAMES = (
    "alpha",
    "beta",
    "gamma",
    "theta12",
    "theta13",
    "theta14",
    "theta22",
    "theta23",
    "theta31",
    "theta32",
    "theta33",
    "cardan_A4_y",
    "cardan_A4_x",
    "gamma_output",
    "cardan_B4_y",
    "gamma_C1",
    "gamma_C2",
    "gamma_C3",
    "phi_D1",
    "phi_D2",
    "phi_D3",
    "epsilon_E1",
)

BODY_NAMES = (
    *(f"cross_A{k}" for k in (1, 2, 3)),
    *(f"rod_A{k}B{k}" for k in (1, 2, 3)),
    *(f"cross_B{k}" for k in (1, 2, 3)),
    "knee",
    "input_shaft",
    "cross_A4",
    "shaft_A4B4",
    "cross_B4",
    "output_shaft",
    *(f"driven_gear_{i}" for i in (1, 2, 3)),
    *(f"link_C{i}D{i}" for i in (1, 2, 3)),
    *(f"link_D{i}E{i}" for i in (1, 2, 3)),
    "foot",
)


@dataclass(frozen=True)
class OmniLeg:
    """Geometry and inertia of an OmniLeg: lengths in m, angles in rad, SI units.

    Scalars may be floats, arrays or CasADi symbols; `dataclasses.replace` makes a changed copy.
    """

    L1: Scalar
    """Length of the thigh rods A_k B_k."""
    L3: Scalar
    """Distance of the U joints A_k from O0 (and B_k from O0')."""
    L4: Scalar
    """Length of each shank link, C_i D_i and D_i E_i."""
    L5: Scalar
    """Height of the C plane below O0'."""
    R_C: Scalar
    """Radius of the circle of the C_i."""
    psi: Vector
    """Directions of the three shank chains about Z0."""
    bodies: tuple[Body, ...]
    """The 25 moving bodies, in the order of `BODY_NAMES`."""
    gravity: Vector = (0.0, 0.0, 9.81)
    """Acceleration of gravity in the hip frame, m/s²; the default is a level hip, Z0 down."""
    rotor_inertia: Vector = ZERO
    """Inertia of the rotors M2, M1, M3 felt at their joints: motor-side inertia times reduction squared, kg·m²."""
    dissipation: tuple[Dissipation, ...] = ()
    """The tree joints that have damping or friction; all others are left out."""
    transmission: str = "exact"
    """How the Cardan shaft A4B4 and the crosses A4, B4 enter the dynamics; kinematics and closure are always exact.

    ``exact``: with their true motion, coupled to alpha, beta and gamma by the U joints.
    ``paper``: (26)-(31); they move as rod A1B1 and crosses A1, B1 do, and gamma' about the fixed Z0 is added to their
    angular velocity. Lagrange's equation then takes these velocities as they are, although no orientation has them.
    ``none``: point masses in their true centres of mass, without rotary inertia.
    """

    def __post_init__(self) -> None:
        if self.transmission not in TRANSMISSIONS:
            raise RouteError(
                f"transmission {self.transmission!r} does not exist: choose one of {', '.join(TRANSMISSIONS)}"
            )

    @property
    def parameters(self) -> Mapping[str, Scalar]:
        """Named lengths (m) and angles (rad)."""
        psi = {f"psi_{i}": value for i, value in enumerate(self.psi, 1)}
        lengths = {"L1": self.L1, "L3": self.L3, "L4": self.L4, "L5": self.L5, "R_C": self.R_C}
        return MappingProxyType(lengths | psi)


# 2 Kinematics: thigh by screws, (1)-(9)


class Screw(NamedTuple):
    """Unit axis omega and moment v = q x omega of a joint, S = (omega, v)."""

    omega: Vector
    v: Vector


class Pose(NamedTuple):
    """Rotation and position of a moving frame in the hip frame: T = [R P; 0 1]."""

    rotation: Matrix
    position: Vector


def _after(first: Pose, second: Pose) -> Pose:
    return Pose(matmul(first.rotation, second.rotation), add(first.position, matvec(first.rotation, second.position)))


def branch_rotation(k: int) -> Matrix:
    """Rotation that leads from branch 1 to branch k: about Z0 by -delta, delta = (k - 1) pi/2.

    The matrix is as printed; printed as "rot(Z0, delta)" it is rot(Z0, -delta), and (11) needs it so.
    """
    sine, cosine = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0))[k - 1]
    return (cosine, sine, 0.0), (-sine, cosine, 0.0), (0.0, 0.0, 1.0)  # (5)


def joint_axis(k: int, i: int) -> Vector:
    """Unit axis of joint i = 1..4 of branch k in the straight pose."""
    omega_1i = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))[i - 1]  # (1)
    return matvec(branch_rotation(k), omega_1i)  # (6)


def joint_point(leg: OmniLeg, k: int, i: int) -> Vector:
    """Point on the axis of joint i = 1..4 of branch k in the straight pose, m: A_k for 1, 2 and B_k for 3, 4."""
    q_1i = (0.0, leg.L3, (0.0, 0.0, leg.L1, leg.L1)[i - 1])  # (2)
    return matvec(branch_rotation(k), q_1i)  # (7)


def branch_screws(leg: OmniLeg, k: int) -> tuple[Screw, Screw, Screw, Screw]:
    """Joint screws S = (omega, q x omega) of branch k in the straight pose."""
    omega = [joint_axis(k, i) for i in (1, 2, 3, 4)]
    q = [joint_point(leg, k, i) for i in (1, 2, 3, 4)]
    s1, s2, s3, s4 = (Screw(w, cross(p, w)) for w, p in zip(omega, q, strict=True))
    return s1, s2, s3, s4


def zero_pose(leg: OmniLeg) -> Pose:
    """Pose M of the knee frame O0' in the straight pose."""
    return Pose(IDENTITY, (0.0, 0.0, leg.L1))  # (3)


def exponential(screw: Screw, theta: Scalar) -> Pose:
    """Rigid motion exp(S theta), with Rodrigues' formula for the rotation.

    The paper's e^theta-hat is exp(omega-hat theta).
    """
    omega, v = screw
    hat = skew(omega)
    hat_squared = matmul(hat, hat)
    s, c = sin(theta), cos(theta)
    rotation = tuple(
        tuple(i + s * h + (1.0 - c) * h2 for i, h, h2 in zip(*rows, strict=True))
        for rows in zip(IDENTITY, hat, hat_squared, strict=True)
    )
    moment = cross(omega, v)
    translation = add(
        subtract(moment, matvec(rotation, moment)), scale(dot(omega, v) * theta, omega)
    )  # (4), third line
    return Pose(rotation, translation)


def product_of_exponentials(screws: tuple[Screw, ...], angles: Vector, zero: Pose) -> Pose:
    """Forward kinematics of a serial chain: the product of its joints' motions times its zero pose."""
    pose = zero
    for screw, angle in zip(reversed(screws), reversed(angles), strict=True):
        pose = _after(exponential(screw, angle), pose)  # (4)
    return pose


def branch_angles(q: Vector) -> tuple[Vector, Vector, Vector]:
    """Angles (theta_k1 .. theta_k4) of the three branches that meet at a knee which never rotates, rad."""
    alpha, beta, _ = q
    theta12, theta22 = passive_angles(q)
    return (
        (beta, theta12, -theta12, -beta),
        (alpha, theta22, -theta22, -alpha),
        (-beta, -theta12, theta12, beta),
    )


def branch_pose(leg: OmniLeg, k: int, angles: Vector) -> Pose:
    """Pose of the knee frame O0' at the end of branch k, from that branch's own four angles."""
    return product_of_exponentials(branch_screws(leg, k), angles, zero_pose(leg))


def closure_residual(leg: OmniLeg, q: Vector) -> Vector:
    """Difference that T1 = T2 = T3 leaves: 24 numbers, rotations and positions (m) of T2 - T1 and T3 - T1; zero."""
    one, two, three = (branch_pose(leg, k, angles) for k, angles in enumerate(branch_angles(q), 1))
    residual: list[Scalar] = []
    for other in (two, three):
        for row, reference in zip(other.rotation, one.rotation, strict=True):
            residual.extend(subtract(row, reference))  # (8)
        residual.extend(subtract(other.position, one.position))  # (8)
    return tuple(residual)


class _Thigh(NamedTuple):
    """Sines, cosines and the rod direction r with its derivatives: everything that alpha and beta enter through."""

    sa: Scalar
    ca: Scalar
    sb: Scalar
    cb: Scalar
    s: Scalar
    """1 / sqrt(D)"""
    s2: Scalar
    """1 / D"""
    log_s: Vector
    """Derivatives of ln s."""
    r: Vector
    r_a: Vector
    r_b: Vector


def _thigh(q: Vector) -> _Thigh:
    alpha, beta, _ = q
    sa, ca, sb, cb = sin(alpha), cos(alpha), sin(beta), cos(beta)
    # The sum form of D does not cancel near alpha = beta = 90 deg.
    s2 = 1.0 / (cb * cb + (ca * sb) * (ca * sb))
    s = sqrt(s2)
    s3 = s * s2
    log_s = (s2 * sa * ca * sb * sb, s2 * sa * sa * sb * cb)
    r = (s * ca * sb, -(s * sa * cb), s * ca * cb)
    r_a = (-(s3 * sa * sb * cb * cb), -(s3 * ca * cb), -(s3 * sa * cb * cb * cb))
    r_b = (s3 * ca * cb, s3 * sa * sb * ca * ca, -(s3 * ca * ca * ca * sb))
    return _Thigh(sa, ca, sb, cb, s, s2, log_s, r, r_a, r_b)


def _thigh_second(thigh: _Thigh) -> tuple[Vector, Vector, Vector]:
    """Second derivatives of the rod direction: r_aa, r_ab, r_bb."""
    sa, ca, sb, cb, s, s2, (p_a, p_b), _, r_a, r_b = thigh
    s3 = s * s2
    m_aa = (-(ca * sb * cb * cb), sa * cb, -(ca * cb * cb * cb))
    m_ab = (sa * cb * (2.0 * sb * sb - cb * cb), ca * sb, 3.0 * sa * sb * cb * cb)
    m_bb = (-(ca * sb), sa * cb * ca * ca, -(ca * ca * ca * cb))
    return (
        add(scale(s3, m_aa), scale(3.0 * p_a, r_a)),
        add(scale(s3, m_ab), scale(3.0 * p_b, r_a)),
        add(scale(s3, m_bb), scale(3.0 * p_b, r_b)),
    )


def _thigh_bias(thigh: _Thigh, v: Vector) -> Vector:
    """Second time derivative of the rod direction at zero joint acceleration."""
    r_aa, r_ab, r_bb = _thigh_second(thigh)
    va, vb, _ = v
    return total((scale(va * va, r_aa), scale(2.0 * va * vb, r_ab), scale(vb * vb, r_bb)))


def knee_position(leg: OmniLeg, q: Vector) -> Vector:
    """Position of the knee frame's origin O0', m: L1 times the direction of the thigh rods.

    Printed without sin(beta) in the x component.
    """
    alpha, beta, _ = q
    sa, ca, sb, cb = sin(alpha), cos(alpha), sin(beta), cos(beta)
    root_d = sqrt(cb * cb + (ca * sb) * (ca * sb))
    return (
        leg.L1 * ca * sb / root_d,
        -(leg.L1 * sa * cb) / root_d,
        leg.L1 * ca * cb / root_d,
    )  # (9)


# 2 Kinematics: shank by geometry and the whole leg, (10)-(14)


def leg_length_change(leg: OmniLeg, gamma: Scalar) -> Scalar:
    """Shortening of the shank, Delta L2, in m."""
    return 2.0 * leg.L4 - 2.0 * leg.L4 * cos(gamma)  # (10)


def foot_position(leg: OmniLeg, q: Vector) -> Vector:
    """Position P_F of the centre of the foot's E plane, m. It depends on gamma too."""
    thigh = _thigh(q)
    x, y, z = scale(leg.L1, thigh.r)
    return x, y, z + 2.0 * leg.L4 * cos(q[2]) + leg.L5  # (11)


def passive_angles(q: Vector) -> tuple[Scalar, Scalar]:
    """Passive angles theta12 and theta22 of the U joints A1 and A2, rad.

    theta22 is printed without its minus sign; with (5) and (6) branch 2 then misses the knee by centimetres.
    """
    alpha, beta, _ = q
    sa, ca, sb, cb = sin(alpha), cos(alpha), sin(beta), cos(beta)
    return atan2(sa * cb, ca), -atan2(sb * ca, cb)  # (12)


class InverseKinematics(NamedTuple):
    """Joint angles and how far the request is inside its domain; a negative margin means there is no solution."""

    q: Vector
    """(alpha, beta, gamma) in rad; NaN where a margin is negative beyond `ARCCOS_TOLERANCE`."""
    reach_margin: Scalar
    """L1 minus the horizontal distance of the foot, m."""
    argument_margin: Scalar
    """1 minus the absolute value of the arccos argument."""
    stretch_margin: Scalar
    """2 L4 minus the shank length that is asked for, m: 2 L4 times `argument_margin`."""

    @property
    def margin(self) -> Scalar:
        """The smaller margin in metres, or minus the distance that both together miss.

        It is 0 where only rounding within `ARCCOS_TOLERANCE` lifts the argument above 1.
        """
        stretch = self.stretch_margin
        tolerated = where(self.argument_margin >= -ARCCOS_TOLERANCE, fmax(stretch, 0.0), stretch)
        missing = -sqrt(fmin(self.reach_margin, 0.0) ** 2 + fmin(tolerated, 0.0) ** 2)
        return where(missing < 0.0, missing, fmin(self.reach_margin, tolerated))


def _inverse_kinematics(leg: OmniLeg, p: Vector, thigh: float, knee: float) -> InverseKinematics:
    x, y, z = p
    rho_squared = x * x + y * y
    height_squared = leg.L1 * leg.L1 - rho_squared
    height = sqrt(height_squared)
    argument = (z - leg.L5 - thigh * height) / (2.0 * leg.L4)
    # Beyond the horizontal reach the knee is level with the hip at best: what the shank then misses counts as well.
    nearest = (z - leg.L5 - thigh * sqrt(fmax(height_squared, 0.0))) / (2.0 * leg.L4)
    alpha = atan2(-y, thigh * height)  # (13)
    beta = atan2(thigh * x, height)  # (13)
    gamma = knee * acos(where_domain(argument, ARCCOS_TOLERANCE))  # (13)
    argument_margin = 1.0 - fabs(nearest)
    return InverseKinematics(
        (alpha, beta, gamma),
        leg.L1 - sqrt(rho_squared),
        argument_margin,
        2.0 * leg.L4 * argument_margin,
    )


def inverse_kinematics(leg: OmniLeg, p: Vector, branch: str = "gamma_positive") -> InverseKinematics:
    """Joint angles that put the foot at p (m), thigh pointing down.

    Printed with +P_y for alpha, where (11) needs -P_y, and with the bracket of gamma closed too early.
    Near the straight leg gamma is as ill-conditioned as the mechanism: 1 um of P_z is 0.19 deg at gamma = 0.

    Parameters
    ----------
    leg : OmniLeg
    p : tuple of 3 scalars
        Foot position in the hip frame, m.
    branch : {"gamma_positive", "gamma_negative"}
        Side to which the shank folds.
    """
    return _inverse_kinematics(leg, p, 1.0, {"gamma_positive": 1.0, "gamma_negative": -1.0}[branch])


def inverse_kinematics_thigh_up(leg: OmniLeg, p: Vector, branch: str = "gamma_positive") -> InverseKinematics:
    """Return the other solution, thigh pointing UP: |alpha| > 90 deg, outside every limit; for reports only."""
    return _inverse_kinematics(leg, p, -1.0, {"gamma_positive": 1.0, "gamma_negative": -1.0}[branch])


def foot_jacobian(leg: OmniLeg, q: Vector) -> Matrix:
    """First-order influence coefficients J_vF of the foot, rows x, y, z, columns alpha, beta, gamma; m/rad."""
    thigh = _thigh(q)
    column_a, column_b = scale(leg.L1, thigh.r_a), scale(leg.L1, thigh.r_b)
    column_g = (0.0, 0.0, -(2.0 * leg.L4 * sin(q[2])))
    return transpose((column_a, column_b, column_g))  # (14)


def foot_second_order_coefficients(leg: OmniLeg, q: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """Second-order influence coefficients: for x, y and z of the foot the symmetric matrix d²P/dq_i dq_j, m/rad²."""
    second = _thigh_second(_thigh(q))
    r_aa, r_ab, r_bb = (scale(leg.L1, value) for value in second)
    z_gg = -(2.0 * leg.L4 * cos(q[2]))
    x, y, z = (((r_aa[c], r_ab[c], 0.0), (r_ab[c], r_bb[c], 0.0), (0.0, 0.0, (0.0, 0.0, z_gg)[c])) for c in (0, 1, 2))
    return x, y, z


def foot_jacobian_derivative(leg: OmniLeg, q: Vector, v: Vector) -> Matrix:
    """Time derivative of `foot_jacobian`, m/(rad·s)."""
    return tuple(matvec(hessian, v) for hessian in foot_second_order_coefficients(leg, q))


def foot_bias_acceleration(leg: OmniLeg, q: Vector, v: Vector) -> Vector:
    """Foot acceleration at zero joint acceleration, Jdot v, m/s²."""
    x, y, z = scale(leg.L1, _thigh_bias(_thigh(q), v))
    return x, y, z - 2.0 * leg.L4 * cos(q[2]) * v[2] * v[2]


def foot_velocity(leg: OmniLeg, q: Vector, v: Vector) -> Vector:
    """Foot velocity J v, m/s; the foot does not rotate."""
    return matvec(foot_jacobian(leg, q), v)  # (14)


def foot_acceleration(leg: OmniLeg, q: Vector, v: Vector, a: Vector) -> Vector:
    """Foot acceleration J a + Jdot v, m/s²: the time derivative of (14)."""
    return add(matvec(foot_jacobian(leg, q), a), foot_bias_acceleration(leg, q, v))


def foot_jacobian_determinant(leg: OmniLeg, q: Vector) -> Scalar:
    """Determinant of J_vF in m³/rad³: zero only at gamma = 0 (or 180 deg) and where alpha or beta is 90 deg."""
    alpha, beta, gamma = q
    ca, sb, cb = cos(alpha), sin(beta), cos(beta)
    d = cb * cb + (ca * sb) * (ca * sb)
    ratio = leg.L1 * ca * cb / d
    return -(2.0 * leg.L4 * sin(gamma)) * ratio * ratio


def singularity_margins(leg: OmniLeg, q: Vector) -> Vector:
    """D, and the squared cosine of the Cardan angle b: the passive angles are undefined where one of them vanishes.

    Both are 1 in the straight pose. Neither gets below 0.09 inside |alpha|, |beta| <= 65 deg.
    """
    thigh = _thigh(q)
    sg, cg = sin(q[2]), cos(q[2])
    y = cg * thigh.r[1] - sg * thigh.r[0]
    return 1.0 / thigh.s2, 1.0 - y * y


# 3 Dynamics: motion of every body, (15)-(43)


def _opposite(angle: Angle) -> Angle:
    return Angle(-angle.sine, angle.cosine, negate(angle.first), -angle.rate, -angle.second)


def _own(angle: Scalar, index: int, v: Vector) -> Angle:
    """One of alpha, beta, gamma themselves."""
    return Angle(sin(angle), cos(angle), IDENTITY[index], v[index], 0.0)


def centre_of_mass(motion: Motion, com: Vector) -> CentreOfMass:
    """Position, influence coefficients and bias acceleration of a point `com` given in the body's frame (m)."""
    lever = matvec(motion.turning.rotation, com)  # (19), (31), (35), (39)
    return shifted(motion, lever)  # (20), (22), (23), (36), (40), (42), (43)


def _rod_angles(thigh: _Thigh, v: Vector) -> tuple[Angle, Angle]:
    """theta12 and -theta22 with their total differentials, from (12)."""
    sa, ca, sb, cb, s, s2, (p_a, p_b), _, _, _ = thigh
    va, vb, _ = v
    growth = 2.0 * (p_a * va + p_b * vb)
    first12 = (s2 * cb, -(s2 * sa * ca * sb), 0.0)
    rate12 = first12[0] * va + first12[1] * vb
    second12 = growth * rate12 - s2 * vb * (sb * va + (ca * ca - sa * sa) * sb * va + sa * ca * cb * vb)
    first22 = (-(s2 * sb * cb * sa), s2 * ca, 0.0)
    rate22 = first22[0] * va + first22[1] * vb
    second22 = growth * rate22 - s2 * va * (sa * vb + (cb * cb - sb * sb) * sa * vb + sb * cb * ca * va)
    return (
        Angle(s * sa * cb, s * ca, first12, rate12, second12),
        Angle(s * sb * ca, s * cb, first22, rate22, second22),
    )


def _branch_turnings(thigh: _Thigh, q: Vector, v: Vector) -> tuple[tuple[Turning, Turning], tuple[Turning, Turning]]:
    """Crosses and rods of the branches 1 (and 3, which is its mirror image) and 2."""
    theta12, minus_theta22 = _rod_angles(thigh, v)
    cross_1 = hinged(FIXED, "y", Angle(thigh.sb, thigh.cb, IDENTITY[1], v[1], 0.0))  # (15)
    rod_1 = hinged(cross_1, "x", theta12)  # (17), (18), (21)
    cross_2 = hinged(FIXED, "x", Angle(thigh.sa, thigh.ca, IDENTITY[0], v[0], 0.0))
    rod_2 = hinged(cross_2, "y", minus_theta22)  # axis -Y by (6)
    return (cross_1, rod_1), (cross_2, rod_2)


def _knee_motion(leg: OmniLeg, thigh: _Thigh, v: Vector) -> Motion:
    columns = (scale(leg.L1, thigh.r_a), scale(leg.L1, thigh.r_b), ZERO)
    return Motion(FIXED, scale(leg.L1, thigh.r), columns, scale(leg.L1, _thigh_bias(thigh, v)))  # (32), (33)


def _at(motion: Motion, turning: Turning, offset: Vector) -> Motion:
    """Motion of a frame that moves with the origin of the non-rotating `motion`, at a constant offset from it."""
    return Motion(turning, add(motion.origin, offset), motion.columns, motion.bias)


def branch_motions(leg: OmniLeg, q: Vector, v: Vector) -> dict[str, Motion]:
    """Motion of both crosses and the rod of the three thigh branches.

    (16) is printed with -beta' for the cross B1; theta14' = -beta' is the knee relative to the cross, which itself
    turns with +beta' like the cross A1. Branch 3 turns exactly as branch 1.
    """
    thigh = _thigh(q)
    return _branch_motions(leg, thigh, _branch_turnings(thigh, q, v), _knee_motion(leg, thigh, v))


def _branch_motions(
    leg: OmniLeg,
    thigh: _Thigh,
    turnings: tuple[tuple[Turning, Turning], tuple[Turning, Turning]],
    knee: Motion,
) -> dict[str, Motion]:
    motions = {}
    for k, (cross_turning, rod_turning) in zip((1, 2, 3), (*turnings, turnings[0]), strict=True):
        centre = joint_point(leg, k, 1)
        motions[f"cross_A{k}"] = Motion(cross_turning, centre, STILL, ZERO)  # (15)
        motions[f"rod_A{k}B{k}"] = Motion(rod_turning, centre, STILL, ZERO)  # (17)-(23)
        motions[f"cross_B{k}"] = _at(knee, cross_turning, centre)  # (16)
    return motions


class _Cardan(NamedTuple):
    a: Angle
    b: Angle


def _cardan(thigh: _Thigh, q: Vector, v: Vector) -> _Cardan:
    sg, cg = sin(q[2]), cos(q[2])
    vg = v[2]

    def unwind(u: Vector) -> Vector:
        return cg * u[0] + sg * u[1], cg * u[1] - sg * u[0], u[2]

    x, y, z = unwind(thigh.r)
    column_a, column_b, column_g = unwind(thigh.r_a), unwind(thigh.r_b), (y, -x, 0.0)
    columns = (column_a, column_b, column_g)
    swing = add(scale(v[0], column_a), scale(v[1], column_b))
    dx, dy, dz = add(swing, scale(vg, column_g))
    bx, by, bz = unwind(_thigh_bias(thigh, v))
    ddx = bx + vg * (2.0 * swing[1] - vg * x)
    ddy = by - vg * (2.0 * swing[0] + vg * y)
    ddz = bz
    c2 = x * x + z * z
    c = sqrt(c2)
    a_first = tuple((z * u[0] - x * u[2]) / c2 for u in columns)
    a_rate = (z * dx - x * dz) / c2
    a_second = (z * ddx - x * ddz - 2.0 * a_rate * (x * dx + z * dz)) / c2
    b_first = tuple(-u[1] / c for u in columns)
    b_rate = -dy / c
    b_second = -(ddy + y * b_rate * b_rate) / c
    return _Cardan(Angle(x / c, z / c, a_first, a_rate, a_second), Angle(-y, c, b_first, b_rate, b_second))


def cardan_angles(q: Vector) -> tuple[Scalar, Scalar]:
    """Angles a, b of the U joint A4 (and of B4), rad: Rz(gamma) Ry(a) Rx(b) turns Z0 into the rod direction r.

    a = atan2(r'x, r'z) and b = asin(-r'y) with r' = Rz(-gamma) r.
    """
    sg, cg = sin(q[2]), cos(q[2])
    x, y, z = _thigh(q).r
    rx, ry = cg * x + sg * y, cg * y - sg * x
    return atan2(rx, z), atan2(-ry, sqrt(rx * rx + z * z))


def transmission_motions(leg: OmniLeg, q: Vector, v: Vector) -> dict[str, Motion]:
    """Motion of the input shaft, the Cardan shaft with its two crosses, and the output shaft.

    In the models ``exact`` and ``none`` the crosses and the Cardan shaft follow the U joints A4 and B4; the output
    shaft then turns exactly as the input one. In the model ``paper`` they move as crosses and rod of branch 1 do; what
    (26), (27) and (29) add to their angular velocity is no rotation of theirs: see `transmission_angular_velocities`.
    """
    thigh = _thigh(q)
    return _transmission_motions(leg, thigh, q, v, _branch_turnings(thigh, q, v), _knee_motion(leg, thigh, v))


def _transmission_motions(
    leg: OmniLeg,
    thigh: _Thigh,
    q: Vector,
    v: Vector,
    turnings: tuple[tuple[Turning, Turning], tuple[Turning, Turning]],
    knee: Motion,
) -> dict[str, Motion]:
    shaft = hinged(FIXED, "z", _own(q[2], 2, v))  # (24)
    cross_4, rod_4 = turnings[0] if leg.transmission == "paper" else _cardan_turnings(thigh, q, v, shaft)
    return {
        "input_shaft": Motion(shaft, ZERO, STILL, ZERO),  # (24), (25)
        "cross_A4": Motion(cross_4, ZERO, STILL, ZERO),  # (26), (28)
        "shaft_A4B4": Motion(rod_4, ZERO, STILL, ZERO),  # (29)-(31)
        "cross_B4": _at(knee, cross_4, ZERO),  # (27)
        "output_shaft": _at(knee, shaft, ZERO),  # (24)
    }


def _cardan_turnings(thigh: _Thigh, q: Vector, v: Vector, shaft: Turning) -> tuple[Turning, Turning]:
    """Crosses and Cardan shaft as the U joints hold them; (26), (27) and (29) neglect their coupling."""
    a, b = _cardan(thigh, q, v)
    cross_4 = hinged(shaft, "y", a)
    return cross_4, hinged(cross_4, "x", b)


_SPINNING = ("cross_A4", "shaft_A4B4", "cross_B4")
_Z0 = IDENTITY[2]


def transmission_angular_velocities(leg: OmniLeg, q: Vector, v: Vector) -> dict[str, Vector]:
    """Angular velocities of the crosses A4, B4 and the Cardan shaft in the leg's transmission model, rad/s.

    The printed ones, of the model ``paper``, are [0, beta', gamma'] and the rod's angular velocity plus [0, 0, gamma'].
    At (30, 30, 40) deg the cross truly has [.548, -.653, 0] alpha' + [-.653, .778, 0] beta' + [.520, -.620, 1] gamma'.
    """
    motions = transmission_motions(leg, q, v)
    velocities = {name: motions[name].turning.velocity for name in _SPINNING}
    if leg.transmission == "paper":
        spin = scale(v[2], _Z0)
        velocities = {name: add(velocity, spin) for name, velocity in velocities.items()}  # (26), (27), (29)
    return velocities


def shank_motions(leg: OmniLeg, q: Vector, v: Vector) -> dict[str, Motion]:
    """Motion of the driven gears, the links C_i D_i and D_i E_i, and the foot.

    gamma turns C_i D_i about the outward radial axis X_Ci; phi = -2 gamma turns D_i E_i relative to it.
    """
    return _shank_motions(leg, q, v, _knee_motion(leg, _thigh(q), v))


def _shank_motions(leg: OmniLeg, q: Vector, v: Vector, knee: Motion) -> dict[str, Motion]:
    gamma = _own(q[2], 2, v)
    motions = {}
    for i, psi in enumerate(leg.psi, 1):
        s, c = sin(psi), cos(psi)
        chain = Turning(rotation_z(s, c), STILL, ZERO, ZERO)
        upper = hinged(chain, "x", gamma)  # (34), (41)
        lower = hinged(chain, "x", _opposite(gamma))  # (37): gamma + phi = -gamma
        at_c = _at(knee, upper, (leg.R_C * c, leg.R_C * s, leg.L5))
        at_d = shifted(at_c, matvec(upper.rotation, (0.0, 0.0, leg.L4)))  # (38)
        motions[f"driven_gear_{i}"] = at_c
        motions[f"link_C{i}D{i}"] = at_c  # (34)-(36), (41)-(43)
        motions[f"link_D{i}E{i}"] = Motion(lower, *at_d)  # (37)-(43)
    below = (0.0, 0.0, leg.L5 + 2.0 * leg.L4 * gamma.cosine)
    columns = (knee.columns[0], knee.columns[1], (0.0, 0.0, -(2.0 * leg.L4 * gamma.sine)))
    fall = (0.0, 0.0, -(2.0 * leg.L4 * gamma.cosine * v[2] * v[2]))
    motions["foot"] = Motion(FIXED, add(knee.origin, below), columns, add(knee.bias, fall))  # (14)
    return motions


def body_motions(leg: OmniLeg, q: Vector, v: Vector) -> dict[str, Motion]:
    """Motion of the frames of all 25 moving bodies, keyed by body name."""
    thigh = _thigh(q)
    knee = _knee_motion(leg, thigh, v)
    turnings = _branch_turnings(thigh, q, v)
    return {
        **_branch_motions(leg, thigh, turnings, knee),
        "knee": knee,
        **_transmission_motions(leg, thigh, q, v, turnings, knee),
        **_shank_motions(leg, q, v, knee),
    }


def tree_coordinates(leg: OmniLeg, q: Vector) -> dict[str, Scalar]:
    """Angles of all 22 tree joints at which every loop closes and every gear pair meshes, rad."""
    alpha, beta, gamma = q
    theta12, theta22 = passive_angles(q)
    a, b = cardan_angles(q)
    return {
        "alpha": alpha,
        "beta": beta,
        "gamma": gamma,
        "theta12": theta12,
        "theta13": -theta12,
        "theta14": -beta,
        "theta22": theta22,
        "theta23": -theta22,
        "theta31": -beta,
        "theta32": -theta12,
        "theta33": theta12,
        "cardan_A4_y": a,
        "cardan_A4_x": b,
        "gamma_output": gamma,
        "cardan_B4_y": a,
        "gamma_C1": gamma,
        "gamma_C2": gamma,
        "gamma_C3": gamma,
        "phi_D1": -2.0 * gamma,
        "phi_D2": -2.0 * gamma,
        "phi_D3": -2.0 * gamma,
        "epsilon_E1": gamma,
    }


def tree_coefficients(leg: OmniLeg, q: Vector) -> dict[str, Vector]:
    """First-order influence coefficients of the 22 tree joints: derivatives by alpha, beta and gamma."""
    thigh = _thigh(q)
    theta12, minus_theta22 = (angle.first for angle in _rod_angles(thigh, ZERO))
    a, b = (angle.first for angle in _cardan(thigh, q, ZERO))
    alpha, beta, gamma = IDENTITY
    return {
        "alpha": alpha,
        "beta": beta,
        "gamma": gamma,
        "theta12": theta12,
        "theta13": negate(theta12),
        "theta14": negate(beta),
        "theta22": negate(minus_theta22),
        "theta23": minus_theta22,
        "theta31": negate(beta),
        "theta32": negate(theta12),
        "theta33": theta12,
        "cardan_A4_y": a,
        "cardan_A4_x": b,
        "gamma_output": gamma,
        "cardan_B4_y": a,
        "gamma_C1": gamma,
        "gamma_C2": gamma,
        "gamma_C3": gamma,
        "phi_D1": scale(-2.0, gamma),
        "phi_D2": scale(-2.0, gamma),
        "phi_D3": scale(-2.0, gamma),
        "epsilon_E1": gamma,
    }


# 3 Dynamics: Lagrange, (44)-(46)


def _dynamic_bodies(leg: OmniLeg) -> tuple[Body, ...]:
    """The bodies as the transmission model weighs them."""
    if leg.transmission != "none":
        return leg.bodies
    return tuple(body._replace(inertia=STILL) if body.name in _SPINNING else body for body in leg.bodies)


class _Spin(NamedTuple):
    """A body that the model ``paper`` gives gamma' about Z0 on top of its turning; T is its inertia in the hip frame.

    Its kinetic energy grows by gamma' Z0 · T w + gamma'^2 Z0 · T Z0 / 2; all below follows from these two terms.
    """

    turning: Turning
    tensor: Matrix
    reach: Vector
    """T Z0, kg·m²."""


def _spins(leg: OmniLeg, motions: Mapping[str, Motion]) -> tuple[_Spin, ...]:
    if leg.transmission != "paper":
        return ()
    spins = []
    for body in leg.bodies:
        if body.name in _SPINNING:
            turning = motions[body.name].turning
            tensor = rotate_tensor(turning.rotation, body.inertia)
            spins.append(_Spin(turning, tensor, matvec(tensor, _Z0)))
    return tuple(spins)


def _spin_energy(spin: _Spin, v: Vector) -> Scalar:
    return v[2] * dot(spin.reach, spin.turning.velocity) + 0.5 * v[2] * v[2] * spin.reach[2]


def _spin_inertia(spin: _Spin, i: int, j: int) -> Scalar:
    """Element (i, j) of what the spin adds to the mass matrix: (w_i + z_i) · T (w_j + z_j) - w_i · T w_j."""
    columns, reach = spin.turning.columns, spin.reach
    element: Scalar = 0.0
    if i == 2:
        element = element + dot(reach, columns[j])
    if j == 2:
        element = element + dot(reach, columns[i])
    return element + reach[2] if i == j == 2 else element


def _spin_torque(spin: _Spin, v: Vector, a: Vector) -> Vector:
    """What the spin adds to d/dt dL/dv - dL/dq.

    With T' = w x T - T w x and d/dt w_i - dw/dq_i = w x w_i, which hold for the turning itself.
    """
    (_, columns, w, w_bias), tensor, reach = spin
    rate, growth = v[2], a[2]
    momentum = matvec(tensor, w)
    crossed = subtract(subtract(matvec(tensor, cross(_Z0, w)), cross(momentum, _Z0)), cross(reach, w))
    moment = total((scale(growth, reach), scale(rate, crossed), scale(-(rate * rate), cross(reach, _Z0))))
    w_rate = add(matvec(transpose(columns), a), w_bias)
    own = dot(reach, w_rate) + cross(w, momentum)[2] + growth * reach[2] + 2.0 * rate * cross(w, reach)[2]
    alpha, beta, gamma = (dot(column, moment) for column in columns)
    return alpha, beta, gamma + own


def kinetic_energy(leg: OmniLeg, q: Vector, v: Vector) -> Scalar:
    """Kinetic energy of the 25 bodies and the rotors, J. The tensor of (44) is R I R^T, about the centre of mass."""
    motions = body_motions(leg, q, v)
    energy = kinetic(_dynamic_bodies(leg), motions, v)  # (44)
    for spin in _spins(leg, motions):
        energy = energy + _spin_energy(spin, v)
    for inertia, rate in zip(leg.rotor_inertia, v, strict=True):
        energy = energy + 0.5 * inertia * rate * rate
    return energy


def potential_energy(leg: OmniLeg, q: Vector, gravity: Vector) -> Scalar:
    """Potential energy -sum m g · c, J, zero at O0.

    (44) writes m g P with P a height; Z0 points down, so that P_z itself would have the wrong sign.
    """
    return potential(leg.bodies, body_motions(leg, q, ZERO), gravity)  # (44)


def lagrangian(leg: OmniLeg, q: Vector, v: Vector, gravity: Vector) -> Scalar:
    """L = K - P, J."""
    return kinetic_energy(leg, q, v) - potential_energy(leg, q, gravity)


def mass_matrix(leg: OmniLeg, q: Vector) -> Matrix:
    """Inertia matrix M of (46), kg·m²: sum over bodies of m v_i · v_j + w_i · I w_j, plus the rotors."""
    motions = body_motions(leg, q, ZERO)
    matrix = inertia_matrix(_dynamic_bodies(leg), motions)  # (46)
    for spin in _spins(leg, motions):
        matrix = tuple(
            tuple(value + _spin_inertia(spin, i, j) for j, value in enumerate(row)) for i, row in enumerate(matrix)
        )
    return tuple(
        tuple(value + leg.rotor_inertia[i] if i == j else value for j, value in enumerate(row))
        for i, row in enumerate(matrix)
    )


def dissipation_torque(leg: OmniLeg, q: Vector, v: Vector) -> Vector:
    """Torque that overcomes damping and Coulomb friction of the tree joints, N·m.

    A joint slower than `STANDSTILL` of the three speeds together rests, and has no Coulomb friction.
    """
    if not leg.dissipation:
        return ZERO
    speed = fabs(v[0]) + fabs(v[1]) + fabs(v[2])
    coefficients = tree_coefficients(leg, q)
    torque: Vector = ZERO
    for joint, damping, friction in leg.dissipation:
        first = coefficients[joint]
        rate = dot(first, v)
        way = where(fabs(rate) > STANDSTILL * speed, sign(rate), 0.0)
        torque = add(torque, scale(damping * rate + friction * way, first))
    return torque


def inverse_dynamics(leg: OmniLeg, q: Vector, v: Vector, a: Vector, gravity: Vector) -> Vector:
    """Joint torques of (45) without a foot force, N·m: M a + V + G, plus rotors, damping and friction.

    This is (45) with the chain rule carried out: with w = sum w_i v_i and c' = sum v_i v_i (influence coefficients),
    d/dt dL/dv_i - dL/dq_i = sum over bodies of m v_i · (c'' - g) + w_i · (I w' + w x I w), where I = R I_body R^T.

    Parameters
    ----------
    leg : OmniLeg
    q, v, a : tuples of 3 scalars
        Angles (rad), velocities (rad/s) and accelerations (rad/s²) of alpha, beta, gamma.
    gravity : tuple of 3 scalars
        Acceleration of gravity in the hip frame, m/s².
    """
    torque = add(
        dissipation_torque(leg, q, v), tuple(inertia * a_i for inertia, a_i in zip(leg.rotor_inertia, a, strict=True))
    )
    motions = body_motions(leg, q, v)
    torque = add(torque, virtual_work(_dynamic_bodies(leg), motions, a, gravity))  # (45)
    for spin in _spins(leg, motions):
        torque = add(torque, _spin_torque(spin, v, a))
    return torque


def bias(leg: OmniLeg, q: Vector, v: Vector, gravity: Vector) -> Vector:
    """V + G of (46), and the torque that overcomes damping and friction: `inverse_dynamics` at a = 0, N·m."""
    return inverse_dynamics(leg, q, v, ZERO, gravity)  # (46)


def gravity_torque(leg: OmniLeg, q: Vector, gravity: Vector) -> Vector:
    """G of (46): joint torques that hold the leg still against gravity, N·m."""
    return gravity_force(leg.bodies, body_motions(leg, q, ZERO), gravity)  # (46)


def forward_dynamics(leg: OmniLeg, q: Vector, v: Vector, torque: Vector, gravity: Vector) -> Vector:
    """Joint accelerations (rad/s²) under joint torques (N·m), without a foot force: (46) solved for them."""
    return solve_symmetric(mass_matrix(leg, q), subtract(torque, bias(leg, q, v, gravity)))


# 3 Dynamics: (44)-(46) reduced to composite parameters. The functions above are the paper's equations body by body and
# the oracle of the functions below, which are equal to them and cost a tenth of their arithmetic.


def with_every_number(leg: OmniLeg) -> OmniLeg:
    """Return the same leg with damping and friction of all 22 tree joints written out, zeros included."""
    given = {each.joint: each for each in leg.dissipation}
    return replace(leg, dissipation=tuple(given.get(name, Dissipation(name, 0.0, 0.0)) for name in TREE_JOINT_NAMES))


def composite_parameters(leg: OmniLeg) -> CompositeParameters:
    """Composite inertial parameters of a leg: what (44)-(46) need of its masses, centres of mass, tensors and rotors.

    They depend on the leg's lengths and transmission model too; compute them anew after changing either. Sums that
    cancel but for rounding are exactly zero.
    """
    return _omnileg_composite.composite_parameters(leg)


def base_parameters(leg: OmniLeg) -> Vector:
    """Composite parameters that torques depend on, in the order of `BASE_PARAMETER_NAMES` of the leg's model."""
    parameters = composite_parameters(leg)
    return tuple(getattr(parameters, name) for name in BASE_PARAMETER_NAMES[leg.transmission])


def composite_inverse_dynamics(
    leg: OmniLeg,
    parameters: CompositeParameters,
    q: Vector,
    v: Vector,
    a: Vector,
    gravity: Vector,
    force: Vector = ZERO,
) -> Vector:
    """Joint torques of (45), N·m: `inverse_dynamics` by composite parameters, and with a force `foot_force_torque`.

    Parameters
    ----------
    leg : OmniLeg
        Only its lengths L1 and L4, its transmission model and its dissipation are used.
    parameters : CompositeParameters
        Those of this leg, see `composite_parameters`; torques without dissipation are linear in them.
    q, v, a : tuples of 3 scalars
        Angles (rad), velocities (rad/s) and accelerations (rad/s²) of alpha, beta, gamma.
    gravity : tuple of 3 scalars
        Acceleration of gravity in the hip frame, m/s².
    force : tuple of 3 scalars
        Force that the environment applies to the foot, N; (49) and (50) have the opposite sign.
    """
    torque = _omnileg_composite.inverse_dynamics(leg, parameters, q, v, a, gravity, force)  # (45), (50)
    return add(torque, dissipation_torque(leg, q, v))


def composite_bias(leg: OmniLeg, parameters: CompositeParameters, q: Vector, v: Vector, gravity: Vector) -> Vector:
    """V + G of (46), and the torque that overcomes damping and friction, N·m: `bias` by composite parameters."""
    return composite_inverse_dynamics(leg, parameters, q, v, ZERO, gravity)  # (46)


def composite_mass_matrix(leg: OmniLeg, parameters: CompositeParameters, q: Vector) -> Matrix:
    """Inertia matrix M of (46), kg·m², rotors included: `mass_matrix` by composite parameters."""
    return _omnileg_composite.mass_matrix(leg, parameters, q)  # (46)


def composite_gravity_torque(leg: OmniLeg, parameters: CompositeParameters, q: Vector, gravity: Vector) -> Vector:
    """G of (46), N·m: `gravity_torque` by composite parameters."""
    return _omnileg_composite.gravity_torque(leg, parameters, q, gravity)  # (46)


def composite_potential_energy(leg: OmniLeg, parameters: CompositeParameters, q: Vector, gravity: Vector) -> Scalar:
    """Potential energy of (44), J, zero at O0: `potential_energy` by composite parameters.

    Its part that no torque can tell is -gravity · (fixed_x, fixed_y, fixed_z) of the parameters.
    """
    return _omnileg_composite.potential_energy(leg, parameters, q, gravity)  # (44)


def composite_forward_dynamics(
    leg: OmniLeg,
    parameters: CompositeParameters,
    q: Vector,
    v: Vector,
    torque: Vector,
    gravity: Vector,
    force: Vector = ZERO,
) -> Vector:
    """Joint accelerations (rad/s²): `forward_dynamics`, (46) solved by composite parameters.

    `force` (N) is what the environment applies to the foot. M and the bias share one set of kinematics.
    """
    driving = subtract(torque, dissipation_torque(leg, q, v))
    return _omnileg_composite.forward_dynamics(leg, parameters, q, v, driving, gravity, force)  # (46)


def regressor(leg: OmniLeg, q: Vector, v: Vector, a: Vector, gravity: Vector) -> Matrix:
    """Matrix Y (3 x n) of (45) = Y pi, pi = `base_parameters`: what identification needs.

    Of the leg only L1 and the transmission model are used. Rotors are in pi; damping, friction and a foot force are
    not: subtract `dissipation_torque` and `foot_force_torque` from measured torques. Over random states Y has full
    column rank, so that no parameter is a sum of others. A column's unit is N·m over its `BASE_PARAMETER_UNITS`.
    """
    return _omnileg_composite.regressor(leg, q, v, a, gravity)


# 3 Dynamics: foot force, (47)-(50). Here a foot force is the one that the ENVIRONMENT applies to the FOOT:
# torque = M a + V + G - J^T F. The paper adds J^T F_f in (49) and (50), so its F_f is what the foot exerts.


def foot_force_torque(leg: OmniLeg, q: Vector, force: Vector) -> Vector:
    """Part of the joint torques that a force on the foot (N) causes, -J^T F, N·m.

    (49) and (50) have the opposite sign, because their F_f is the force that the foot exerts.
    """
    return negate(matvec(transpose(foot_jacobian(leg, q)), force))  # (50)


def foot_force(leg: OmniLeg, q: Vector, v: Vector, a: Vector, torque: Vector, gravity: Vector) -> tuple[Vector, Scalar]:
    """Force that the environment applies to the foot (N) while `torque` (N·m) drives the motion, and det J.

    F = J^-T (M a + V + G - torque); the paper's (47) and (48) give its opposite. There is no J^-T where det J
    vanishes, which is at gamma = 0, the paper's own initial pose: look at the second result.
    """
    jacobian = foot_jacobian(leg, q)
    missing = subtract(inverse_dynamics(leg, q, v, a, gravity), torque)
    return solve(transpose(jacobian), missing), determinant(jacobian)  # (47), (48)


def from_urdf(description: Description, *, tolerance: float = 1e-9, transmission: str = "exact") -> OmniLeg:
    """Take the leg's geometry and inertia from a URDF+ description, exactly, and check every assumption made here.

    Link frames may be turned in any way, as long as links and joints have the shipped file's names, each joint's
    origin is its centre, and the zero pose is the straight leg: poses come from yourdfpy's forward kinematics, and
    links fixed to a body are merged into it.

    Parameters
    ----------
    description : Description
        A validated description; yourdfpy reads its text, loops, couplings and transmissions are its own.
    tolerance : float
        Greatest deviation from an assumption, m or rad.
    transmission : {"exact", "paper", "none"}
        How the Cardan shaft and its crosses enter the dynamics, see `OmniLeg.transmission`.

    Returns
    -------
    OmniLeg

    Raises
    ------
    FormulaAssumptionError
        With `element`, `found`, `expected` and `tolerance`, where the file is not the mechanism of the formulas.
    RouteError
        There is no such transmission model.
    """
    from leg_dynamics.closed_form import _omnileg_file

    return replace(_omnileg_file.read(description, tolerance), transmission=transmission)
