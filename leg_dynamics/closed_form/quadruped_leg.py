"""Leg of a modular quadruped (Chen and Dong 2021): kinematics and dynamics in closed form, equation by equation.

Coordinates are q = (theta1, theta2, theta3) in rad, efforts are torques in N·m. The hip frame is the paper's O_0: z up,
x outwards, y ahead at theta1 = 0. theta1 turns the leg about z; theta2 and theta3 lift its links in the leg's plane,
about -y at theta1 = 0. Frames are standard (distal) Denavit-Hartenberg ones: Table 1, which heads its columns a_(i-1)
and alpha_(i-1), means a_i and alpha_i. From the pitch axis, the foot lies in
the leg's plane at

    T = l2 cos(theta2) + l3 cos(theta2 + theta3) outwards and Z = l2 sin(theta2) + l3 sin(theta2 + theta3) upwards

Every foot has up to four solutions: the hip turned to the foot (front, l1 + T > 0) or away from it (back, l1 + T < 0),
times the sign of theta3; the paper's knee has theta3 < 0. Where the paper prints a wrong formula, the one here is
corrected and its docstring says what changed; equation numbers end the line that states the equation. The paper has no
velocities and no dynamics.

The foot's Jacobian is singular where theta3 is 0 or 180 deg and where the foot lies on the hip axis. The dynamics is
regular everywhere.

Every formula takes Python floats, NumPy arrays or CasADi symbols as components (see `algebra`) and never looks at a
value. Domain margins are returned as values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from leg_dynamics.closed_form import _quadruped_leg_composite as composite
from leg_dynamics.closed_form._quadruped_leg_composite import (
    BASE_PARAMETER_NAMES,
    BASE_PARAMETER_UNITS,
    CompositeParameters,
    plane_of,
)
from leg_dynamics.closed_form.algebra import (
    IDENTITY,
    ZERO,
    Matrix,
    Scalar,
    Vector,
    add,
    asin,
    atan2,
    cos,
    fabs,
    fmax,
    fmin,
    matmul,
    matvec,
    negate,
    sign,
    sin,
    solve_symmetric,
    sqrt,
    subtract,
    total,
    transpose,
    where,
)
from leg_dynamics.closed_form.rigid_body import (
    FIXED,
    STILL,
    Angle,
    Body,
    Dissipation,
    Motion,
    Turning,
    centre_of_mass,
    gravity_force,
    hinged,
    inertia_matrix,
    kinetic,
    potential,
    virtual_work,
)
from leg_dynamics.description.model import STANDSTILL

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description

__all__ = [
    "BASE_PARAMETER_NAMES",
    "BASE_PARAMETER_UNITS",
    "BODY_NAMES",
    "BRANCHES",
    "CLEARANCE",
    "JOINT_NAMES",
    "REACH_TOLERANCE",
    "TREE_JOINT_NAMES",
    "Body",
    "CompositeParameters",
    "Dissipation",
    "InverseKinematics",
    "Motion",
    "QuadrupedLeg",
    "base_parameters",
    "bias",
    "body_motions",
    "composite_bias",
    "composite_forward_dynamics",
    "composite_gravity_torque",
    "composite_inverse_dynamics",
    "composite_mass_matrix",
    "composite_parameters",
    "composite_potential_energy",
    "dissipation_torque",
    "foot_acceleration",
    "foot_angular_velocity",
    "foot_bias_acceleration",
    "foot_force",
    "foot_force_torque",
    "foot_from_link_1",
    "foot_from_link_2",
    "foot_jacobian",
    "foot_jacobian_derivative",
    "foot_jacobian_determinant",
    "foot_position",
    "foot_position_in_body",
    "foot_velocity",
    "forward_dynamics",
    "from_urdf",
    "gravity_torque",
    "inverse_dynamics",
    "inverse_jacobian",
    "inverse_kinematics",
    "inverse_kinematics_in_body",
    "kinetic_energy",
    "knee_components",
    "lagrangian",
    "limit_margins",
    "link_transforms",
    "mass_matrix",
    "module_lengths",
    "potential_energy",
    "regressor",
    "standard_transform",
    "theta1",
    "theta2",
    "theta3",
    "transform_foot_to_body",
    "transform_foot_to_hip",
    "transform_hip_to_body",
    "tree_coordinates",
    "with_every_number",
]

JOINT_NAMES = ("theta1", "theta2", "theta3")
TREE_JOINT_NAMES = JOINT_NAMES
BODY_NAMES = ("link_1", "link_2", "link_3")
"""The three bodies: each is the child link of a joint with all that is fixed to it."""

BRANCHES = ("front_knee_negative", "front_knee_positive", "back_knee_negative", "back_knee_positive")
"""Names of the inverse kinematic solutions, the paper's first.

front: the hip is turned to the foot; back: away from it, the leg reaching over its own hip axis. knee: sign of theta3.
"""
_SIGNS = dict(zip(BRANCHES, ((1, -1), (1, 1), (-1, -1), (-1, 1)), strict=True))

CLEARANCE = 1e-9
"""Distance (m) of the foot from the hip axis, or from the pitch axis, below which theta1, or theta2, is undefined."""

REACH_TOLERANCE = 1e-12
"""Excess over the reach that counts as rounding, as a share of l1 + l2 + l3: a straight leg has none to spare."""

_QUARTER_TURN = 0.5 * math.pi


@dataclass(frozen=True)
class QuadrupedLeg:
    """Geometry and inertia of a quadruped leg: lengths in m, SI units.

    Scalars may be floats, arrays or CasADi symbols; `dataclasses.replace` makes a changed copy. Link 1's frame is the
    hip's, turned by theta1. Links 2 and 3 have the axes of their Denavit-Hartenberg frames (x along the link, y up in
    the leg's plane, z along their own joint axis) and their origin on that axis, in the leg's plane.
    """

    l1: Scalar
    """Hip axis to pitch axis."""
    l2: Scalar
    """Pitch axis to knee axis."""
    l3: Scalar
    """Knee axis to foot."""
    bodies: tuple[Body, ...]
    """The three moving bodies, in the order of `BODY_NAMES`."""
    gravity: Vector = (0.0, 0.0, -9.81)
    """Acceleration of gravity in the hip frame, m/s²; the default is a level hip, z up."""
    drive_inertia: Vector = ZERO
    """Inertia of the drives felt at the joints: motor-side inertia times reduction squared, kg·m²."""
    dissipation: tuple[Dissipation, ...] = ()
    """The joints that have damping or friction; all others are left out."""

    @property
    def parameters(self) -> Mapping[str, Scalar]:
        """The lengths of Table 1, m."""
        return MappingProxyType({"l1": self.l1, "l2": self.l2, "l3": self.l3})


def module_lengths(length: Scalar, face: Scalar, foot: Scalar) -> Vector:
    """Lengths l1, l2, l3 (m) of a leg of two modules of which three joints are left, which the paper does not give.

    A module of a given length has two swing axes, each at the distance `face` from the connection face behind it. The
    leg's joints are both swings of the upper module and the upper swing of the lower one, whose end bears the foot.

    Parameters
    ----------
    length : scalar
        Length of a module, face to face, m; 0.150 in section 1.1.
    face : scalar
        Swing axis to connection face, m.
    foot : scalar
        Connection face to the ground, m.
    """
    between = length - 2.0 * face
    return between, 2.0 * face, between + face + foot


# 2.2 Forward kinematics, (1)-(4)


def standard_transform(sine: Scalar, cosine: Scalar, a: Scalar, twist_sine: Scalar, twist_cosine: Scalar) -> Matrix:
    """Standard Denavit-Hartenberg transform of frame i to frame i - 1 with d = 0, shape (4, 4).

    Parameters
    ----------
    sine, cosine : scalar
        Of theta_i.
    a : scalar
        Length a_i along the new x, m.
    twist_sine, twist_cosine : scalar
        Of alpha_i about the new x.
    """
    return (
        (cosine, -(sine * twist_cosine), sine * twist_sine, a * cosine),
        (sine, cosine * twist_cosine, -(cosine * twist_sine), a * sine),
        (0.0, twist_sine, twist_cosine, 0.0),
        (0.0, 0.0, 0.0, 1.0),
    )


def link_transforms(leg: QuadrupedLeg, q: Vector) -> tuple[Matrix, Matrix, Matrix]:
    """A_01, A_12 and A_23 of Table 1: alpha1 = 90 deg, all other twists and all offsets d are zero; (4, 4) each."""
    (s1, s2, s3), (c1, c2, c3) = map(sin, q), map(cos, q)
    return (
        standard_transform(s1, c1, leg.l1, 1.0, 0.0),
        standard_transform(s2, c2, leg.l2, 0.0, 1.0),
        standard_transform(s3, c3, leg.l3, 0.0, 1.0),
    )


def transform_hip_to_body(mount: Vector) -> Matrix:
    """A_c0: the hip O_0 in the body frame O_c, shape (4, 4).

    Parameters
    ----------
    mount : tuple of 3 scalars
        Place (a, b, c) of O_0 in the body, m. The text below Fig. 3 calls it the place of O_c.
    """
    a, b, c = mount
    return (1.0, 0.0, 0.0, a), (0.0, 1.0, 0.0, b), (0.0, 0.0, 1.0, c), (0.0, 0.0, 0.0, 1.0)  # (1)


def transform_foot_to_body(leg: QuadrupedLeg, q: Vector, mount: Vector) -> Matrix:
    """A_c3 = A_c0 A_01 A_12 A_23: the foot frame O_3 in the body frame, shape (4, 4)."""
    at = plane_of(q)
    px, py, pz = foot_position_in_body(leg, q, mount)
    return (
        (at.c1 * at.c23, -(at.c1 * at.s23), at.s1, px),
        (at.s1 * at.c23, -(at.s1 * at.s23), -at.c1, py),
        (at.s23, at.c23, 0.0, pz),
        (0.0, 0.0, 0.0, 1.0),
    )  # (2)


def transform_foot_to_hip(leg: QuadrupedLeg, q: Vector) -> Matrix:
    """A_03: the foot frame O_3 in the hip frame, shape (4, 4)."""
    return transform_foot_to_body(leg, q, ZERO)


def foot_position(leg: QuadrupedLeg, q: Vector) -> Vector:
    """Position of the foot in the hip frame, m: (3) without the mount."""
    at = plane_of(q)
    radius = leg.l3 * at.c23 + leg.l2 * at.c2 + leg.l1
    return radius * at.c1, radius * at.s1, leg.l3 * at.s23 + leg.l2 * at.s2


def foot_position_in_body(leg: QuadrupedLeg, q: Vector, mount: Vector) -> Vector:
    """Position of the foot in the body frame, m; `mount` is (a, b, c) of (1).

    At (0, -30, -60) deg it is (sqrt(3)/2 l2 + l1 + a, b, -(l3 + l2/2) + c), equation (4).
    """
    return add(foot_position(leg, q), mount)  # (3)


def tree_coordinates(leg: QuadrupedLeg, q: Vector) -> dict[str, Scalar]:
    """Coordinates of the three tree joints, rad: q itself, for the leg has no loop."""
    return dict(zip(TREE_JOINT_NAMES, q, strict=True))


# 2.3 Inverse kinematics, (5)-(13)


def foot_from_link_1(leg: QuadrupedLeg, pose: Matrix, angle_1: Scalar, mount: Vector) -> Matrix:
    """A_01^-1 A_c0^-1 A_c3: the foot frame of a pose (5) in frame 1, which must equal A_12 A_23; shape (4, 4).

    Printed with l for l1, without f13, and with a second line for f33 that repeats f31.

    Parameters
    ----------
    leg : QuadrupedLeg
    pose : Matrix
        Pose (n, o, alpha, p) of the foot in the body frame, shape (4, 4). The paper calls it A_e3.
    angle_1 : scalar
        theta1, rad.
    mount : tuple of 3 scalars
        (a, b, c) of (1), m.
    """
    (nx, ox, ax, px), (ny, oy, ay, py), (nz, oz, az, pz), last = pose  # (5)
    a, b, c = mount
    s1, c1 = sin(angle_1), cos(angle_1)
    return (
        (nx * c1 + ny * s1, ox * c1 + oy * s1, ax * c1 + ay * s1, s1 * (py - b) + c1 * (px - a) - leg.l1),
        (nz, oz, az, pz - c),
        (nx * s1 - ny * c1, ox * s1 - oy * c1, ax * s1 - ay * c1, s1 * (px - a) + c1 * (b - py)),
        last,
    )  # (6), (7)


def foot_from_link_2(leg: QuadrupedLeg, pose: Matrix, angle_1: Scalar, angle_2: Scalar, mount: Vector) -> Matrix:
    """A_12^-1 A_01^-1 A_c0^-1 A_c3: the foot frame of a pose in frame 2, which must equal A_23; arguments as in (7)."""
    top, middle, bottom, last = foot_from_link_1(leg, pose, angle_1, mount)
    s2, c2 = sin(angle_2), cos(angle_2)
    along = tuple(c2 * x + s2 * y for x, y in zip(top, middle, strict=True))
    up = tuple(c2 * y - s2 * x for x, y in zip(top, middle, strict=True))
    return (*along[:3], along[3] - leg.l2), up, bottom, last  # (9)


def theta1(p: Vector, hip: float = 1.0) -> Scalar:
    """Hip angle, rad in (-pi, pi], for a foot at p (m) in the hip frame.

    Printed as an arctangent, which loses the quadrant, and without the second solution pi away.

    Parameters
    ----------
    p : tuple of 3 scalars
    hip : {1.0, -1.0}
        1 turns the leg to the foot, -1 away from it.
    """
    return atan2(hip * p[1], hip * p[0])  # (8)


def knee_components(leg: QuadrupedLeg, t: Scalar, z: Scalar, angle_2: Scalar) -> tuple[Scalar, Scalar]:
    """l3 cos(theta3) and l3 sin(theta3), m: the foot (t, z) of the leg's plane in frame 2, from the knee.

    Parameters
    ----------
    leg : QuadrupedLeg
    t, z : scalar
        The paper's T and p_z - c, m.
    angle_2 : scalar
        theta2, rad.
    """
    s2, c2 = sin(angle_2), cos(angle_2)
    return s2 * z + c2 * t - leg.l2, c2 * z - s2 * t  # (10), (11)


def theta2(leg: QuadrupedLeg, t: Scalar, z: Scalar, knee: float = -1.0) -> Scalar:
    """Pitch angle, rad, not wrapped, for the foot (t, z) of the leg's plane, m.

    Printed with l2 for 2 l2 in the denominator, which asks for the arcsine of more than 1 in every pose of a real leg;
    with an arctangent for the angle of (t, z); and with +arcsine, which is the knee theta3 > 0. For the paper's knee
    the arcsine goes to its supplement: pi - arcsin(D) - atan2(t, z), or -arcsin(D) - arctan(t/z) below the hip.

    Parameters
    ----------
    leg : QuadrupedLeg
    t, z : scalar
        The paper's T and p_z - c, m.
    knee : {-1.0, 1.0}
        Sign of theta3.
    """
    squared = t * t + z * z
    d = (squared + leg.l2 * leg.l2 - leg.l3 * leg.l3) / (2.0 * leg.l2 * sqrt(squared))
    return _QUARTER_TURN + knee * (asin(d) - _QUARTER_TURN) - atan2(t, z)  # (12)


def theta3(leg: QuadrupedLeg, t: Scalar, z: Scalar, angle_2: Scalar) -> Scalar:
    """Knee angle, rad in (-pi, pi]; printed as the arcsine of (11) alone, which loses |theta3| > 90 deg."""
    along, up = knee_components(leg, t, z, angle_2)
    return atan2(up, along)  # (13)


class InverseKinematics(NamedTuple):
    """Joint angles and how far the request is inside its domain; a negative margin means there is no solution."""

    q: Vector
    """(theta1, theta2, theta3), rad, each in (-pi, pi]."""
    stretch_margin: Scalar
    """l2 + l3 less the distance of the foot from the pitch axis, m."""
    fold_margin: Scalar
    """The distance of the foot from the pitch axis less |l2 - l3|, m."""
    axis_margin: Scalar
    """Distance of the foot from the hip axis, on which theta1 is undefined, less `CLEARANCE`, m."""
    pitch_margin: Scalar
    """Distance of the foot from the pitch axis, on which theta2 is undefined, less `CLEARANCE`, m."""

    @property
    def reach_margin(self) -> Scalar:
        """Smaller of the first two, m: negative outside the reach of thigh and shank."""
        return fmin(self.stretch_margin, self.fold_margin)

    @property
    def singular_margin(self) -> Scalar:
        """Smaller of the last two, m: negative where a foot within the reach has no unique angles, else not."""
        return where(self.reach_margin < 0.0, 0.0, fmin(self.axis_margin, self.pitch_margin))

    @property
    def margin(self) -> Scalar:
        """The smallest margin that is missing or left, m."""
        return where(self.reach_margin < 0.0, self.reach_margin, fmin(self.reach_margin, self.singular_margin))


def inverse_kinematics(leg: QuadrupedLeg, p: Vector, branch: str = BRANCHES[0]) -> InverseKinematics:
    """Joint angles that put the foot at p, (5)-(13) by the half-angle forms, which keep the digits of a straight leg.

    The paper's arcsine of (12) is ill-conditioned where the leg is straight. With s = 2 l2 l3 |sin(theta3)|, four
    times the area of the triangle hip, knee, foot, the angles of (12) and (13) are arctangents of s and the cosines.
    A straight leg is as ill-conditioned as the mechanism itself: 1 um of the foot is 0.4 deg of theta3 at
    l2, l3 = 75, 140 mm.

    Parameters
    ----------
    leg : QuadrupedLeg
    p : tuple of 3 scalars
        Foot position in the hip frame, m.
    branch : str
        One of `BRANCHES`.
    """
    hip, knee = _SIGNS[branch]
    l2, l3 = leg.l2, leg.l3
    x, y, z = p
    radius = sqrt(x * x + y * y)
    t = hip * radius - leg.l1
    squared = t * t + z * z
    distance = sqrt(squared)
    stretch, fold = _without_rounding(leg, l2 + l3 - distance), _without_rounding(leg, distance - fabs(l2 - l3))
    # (l2 + l3)² - d² and d² - (l2 - l3)², as products: differences of squares would lose the small ones.
    s = sqrt(stretch * (l2 + l3 + distance) * fold * (distance + fabs(l2 - l3)))
    bend = squared + l2 * l2 - l3 * l3
    angle_2 = atan2(z * bend - knee * t * s, t * bend + knee * z * s)  # (12)
    angle_3 = atan2(knee * s, squared - l2 * l2 - l3 * l3)  # (13)
    angles = theta1(p, hip), angle_2, angle_3
    return InverseKinematics(angles, stretch, fold, radius - CLEARANCE, distance - CLEARANCE)


def _without_rounding(leg: QuadrupedLeg, margin: Scalar) -> Scalar:
    """The margin, m, or 0 where only rounding makes it negative."""
    return where(margin >= -REACH_TOLERANCE * (leg.l1 + leg.l2 + leg.l3), fmax(margin, 0.0), margin)


def inverse_kinematics_in_body(
    leg: QuadrupedLeg, p: Vector, mount: Vector, branch: str = BRANCHES[0]
) -> InverseKinematics:
    """Joint angles that put the foot at p (m) of the body frame; `mount` is (a, b, c) of (1)."""
    return inverse_kinematics(leg, subtract(p, mount), branch)


def limit_margins(q: Vector, lower: Vector, upper: Vector) -> Vector:
    """Distances of the three angles from the nearer of their own two limits, rad; the paper's are -70 and 70 deg."""
    return tuple(fmin(angle - least, most - angle) for angle, least, most in zip(q, lower, upper, strict=True))


# Velocity, which the paper lacks


class _Foot(NamedTuple):
    """The foot in the leg's plane: r outwards from the hip axis, and derivatives by theta2 and theta3."""

    s1: Scalar
    c1: Scalar
    r: Scalar
    r_2: Scalar
    r_3: Scalar
    z_2: Scalar
    z_3: Scalar


def _foot(leg: QuadrupedLeg, q: Vector) -> _Foot:
    at = plane_of(q)
    r_3, z_3 = -(leg.l3 * at.s23), leg.l3 * at.c23
    z_2 = leg.l2 * at.c2 + z_3
    return _Foot(at.s1, at.c1, leg.l1 + z_2, r_3 - leg.l2 * at.s2, r_3, z_2, z_3)


def foot_jacobian(leg: QuadrupedLeg, q: Vector) -> Matrix:
    """Foot Jacobian, rows x, y, z, columns theta1, theta2, theta3, m/rad: the derivative of (3)."""
    s1, c1, r, r_2, r_3, z_2, z_3 = _foot(leg, q)
    return (-(s1 * r), c1 * r_2, c1 * r_3), (c1 * r, s1 * r_2, s1 * r_3), (0.0, z_2, z_3)


def foot_jacobian_determinant(leg: QuadrupedLeg, q: Vector) -> Scalar:
    """Determinant of the foot Jacobian, m³/rad³: zero with theta3 at 0 or 180 deg, or the foot on the hip axis."""
    return -(leg.l2 * leg.l3 * sin(q[2]) * _foot(leg, q).r)


def inverse_jacobian(leg: QuadrupedLeg, q: Vector) -> Matrix:
    """Joint rates by the foot's velocity, rad/m; infinite or NaN where `foot_jacobian_determinant` is zero."""
    s1, c1, r, r_2, r_3, z_2, z_3 = _foot(leg, q)
    over_r, over = 1.0 / r, 1.0 / (leg.l2 * leg.l3 * sin(q[2]))
    out_2, out_3 = z_3 * over, -(z_2 * over)
    return (
        (-(s1 * over_r), c1 * over_r, 0.0),
        (c1 * out_2, s1 * out_2, -(r_3 * over)),
        (c1 * out_3, s1 * out_3, r_2 * over),
    )


def foot_jacobian_derivative(leg: QuadrupedLeg, q: Vector, v: Vector) -> Matrix:
    """Time derivative of `foot_jacobian`, m/(rad·s)."""
    s1, c1, r, r_2, r_3, z_2, z_3 = _foot(leg, q)
    v1, v2, v3 = v
    r_rate = r_2 * v2 + r_3 * v3
    r_3_rate, z_3_rate = -(z_3 * (v2 + v3)), r_3 * (v2 + v3)
    r_2_rate = -(z_2 * v2 + z_3 * v3)
    return (
        (-(s1 * r_rate) - c1 * r * v1, c1 * r_2_rate - s1 * r_2 * v1, c1 * r_3_rate - s1 * r_3 * v1),
        (c1 * r_rate - s1 * r * v1, s1 * r_2_rate + c1 * r_2 * v1, s1 * r_3_rate + c1 * r_3 * v1),
        (0.0, r_rate, z_3_rate),
    )


def foot_bias_acceleration(leg: QuadrupedLeg, q: Vector, v: Vector) -> Vector:
    """Foot acceleration at zero joint acceleration, Jdot v, m/s²."""
    return matvec(foot_jacobian_derivative(leg, q, v), v)


def foot_velocity(leg: QuadrupedLeg, q: Vector, v: Vector) -> Vector:
    """Foot velocity J v, m/s."""
    return matvec(foot_jacobian(leg, q), v)


def foot_acceleration(leg: QuadrupedLeg, q: Vector, v: Vector, a: Vector) -> Vector:
    """Foot acceleration J a + Jdot v, m/s²."""
    return add(matvec(foot_jacobian(leg, q), a), foot_bias_acceleration(leg, q, v))


def foot_angular_velocity(leg: QuadrupedLeg, q: Vector, v: Vector) -> Vector:
    """Angular velocity of link 3, which bears the foot, in the hip frame, rad/s."""
    turn = v[1] + v[2]
    return turn * sin(q[0]), -(turn * cos(q[0])), v[0]


# Dynamics body by body, by virtual work. The functions after these compute the same in base parameters.


def _own(angle: Scalar, first: Vector, v: Vector) -> Angle:
    """A sum of joint angles and its rate."""
    return Angle(sin(angle), cos(angle), first, first[0] * v[0] + first[1] * v[1] + first[2] * v[2], 0.0)


_UPRIGHT: Matrix = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
"""Rotation by alpha1 = 90 deg about x."""


def body_motions(leg: QuadrupedLeg, q: Vector, v: Vector) -> dict[str, Motion]:
    """Motion of the frames of the three bodies, by name."""

    def tip(base: Motion, length: Scalar, turning: Turning) -> Motion:
        return Motion(turning, *centre_of_mass(base, (length, 0.0, 0.0)))

    turning_1 = hinged(FIXED, "z", _own(q[0], IDENTITY[0], v))
    upright = turning_1._replace(rotation=matmul(turning_1.rotation, _UPRIGHT))
    turning_2 = hinged(upright, "z", _own(q[1], IDENTITY[1], v))
    turning_3 = hinged(turning_2, "z", _own(q[2], IDENTITY[2], v))
    link_1 = Motion(turning_1, ZERO, STILL, ZERO)
    link_2 = tip(link_1, leg.l1, turning_2)
    return dict(zip(BODY_NAMES, (link_1, link_2, tip(link_2, leg.l2, turning_3)), strict=True))


def kinetic_energy(leg: QuadrupedLeg, q: Vector, v: Vector) -> Scalar:
    """Kinetic energy of the three bodies and the drives, J."""
    energy = kinetic(leg.bodies, body_motions(leg, q, v), v)
    for inertia, rate in zip(leg.drive_inertia, v, strict=True):
        energy = energy + 0.5 * inertia * rate * rate
    return energy


def potential_energy(leg: QuadrupedLeg, q: Vector, gravity: Vector) -> Scalar:
    """Potential energy -sum m g · c, J, zero for masses at the hip's origin."""
    return potential(leg.bodies, body_motions(leg, q, ZERO), gravity)


def lagrangian(leg: QuadrupedLeg, q: Vector, v: Vector, gravity: Vector) -> Scalar:
    """L = K - P, J."""
    return kinetic_energy(leg, q, v) - potential_energy(leg, q, gravity)


def mass_matrix(leg: QuadrupedLeg, q: Vector) -> Matrix:
    """Mass matrix with the drives, kg·m²."""
    matrix = inertia_matrix(leg.bodies, body_motions(leg, q, ZERO))
    return tuple(
        tuple(value + leg.drive_inertia[i] if i == j else value for j, value in enumerate(row))
        for i, row in enumerate(matrix)
    )


def dissipation_torque(leg: QuadrupedLeg, v: Vector) -> Vector:
    """Torque that overcomes damping and Coulomb friction of the joints, N·m.

    A joint slower than `STANDSTILL` of the three speeds together rests, and has no Coulomb friction.
    """
    torque = list(ZERO)
    if not leg.dissipation:
        return ZERO
    speed = fabs(v[0]) + fabs(v[1]) + fabs(v[2])
    for joint, damping, friction in leg.dissipation:
        i = JOINT_NAMES.index(joint)
        way = where(fabs(v[i]) > STANDSTILL * speed, sign(v[i]), 0.0)
        torque[i] = torque[i] + damping * v[i] + friction * way
    return tuple(torque)


def inverse_dynamics(leg: QuadrupedLeg, q: Vector, v: Vector, a: Vector, gravity: Vector) -> Vector:
    """Joint torques without a foot force, N·m, by virtual work of the three bodies; drives and losses included.

    Parameters
    ----------
    leg : QuadrupedLeg
    q, v, a : tuples of 3 scalars
        Joint angles (rad), rates (rad/s) and accelerations (rad/s²).
    gravity : tuple of 3 scalars
        Acceleration of gravity in the hip frame, m/s².
    """
    drives = tuple(inertia * a_i for inertia, a_i in zip(leg.drive_inertia, a, strict=True))
    work = virtual_work(leg.bodies, body_motions(leg, q, v), a, gravity)
    return total((work, drives, dissipation_torque(leg, v)))


def bias(leg: QuadrupedLeg, q: Vector, v: Vector, gravity: Vector) -> Vector:
    """`inverse_dynamics` at zero acceleration, N·m."""
    return inverse_dynamics(leg, q, v, ZERO, gravity)


def gravity_torque(leg: QuadrupedLeg, q: Vector, gravity: Vector) -> Vector:
    """Joint torques that hold the leg still against gravity, N·m."""
    return gravity_force(leg.bodies, body_motions(leg, q, ZERO), gravity)


def forward_dynamics(leg: QuadrupedLeg, q: Vector, v: Vector, torque: Vector, gravity: Vector) -> Vector:
    """Joint accelerations (rad/s²) under joint torques (N·m), without a foot force."""
    return solve_symmetric(mass_matrix(leg, q), subtract(torque, bias(leg, q, v, gravity)))


# The same dynamics in base parameters


def with_every_number(leg: QuadrupedLeg) -> QuadrupedLeg:
    """Return the same leg with damping and friction of all joints written out, zeros included."""
    given = {each.joint: each for each in leg.dissipation}
    return replace(leg, dissipation=tuple(given.get(name, Dissipation(name, 0.0, 0.0)) for name in JOINT_NAMES))


def composite_parameters(leg: QuadrupedLeg) -> CompositeParameters:
    """Inertia of the three bodies and the drives reduced to what motion can tell; depends on l1 and l2 too."""
    return composite.composite_parameters(leg.l1, leg.l2, leg.bodies, leg.drive_inertia)


def base_parameters(leg: QuadrupedLeg) -> Vector:
    """Composite parameters that torques depend on, in the order of `BASE_PARAMETER_NAMES`."""
    parameters = composite_parameters(leg)
    return tuple(getattr(parameters, name) for name in BASE_PARAMETER_NAMES["exact"])


def regressor(leg: QuadrupedLeg, q: Vector, v: Vector, a: Vector, gravity: Vector) -> Matrix:
    """Matrix Y (3 x 18) of inverse dynamics without losses = Y pi, pi = `base_parameters`: what identification needs.

    Over random states and directions of gravity it has full column rank, so that no parameter is a sum of others. A
    column's unit is N·m over its `BASE_PARAMETER_UNITS`.
    """
    return composite.regressor(leg, q, v, a, gravity)


def composite_inverse_dynamics(
    leg: QuadrupedLeg,
    parameters: CompositeParameters,
    q: Vector,
    v: Vector,
    a: Vector,
    gravity: Vector,
    force: Vector = ZERO,
) -> Vector:
    """Joint torques, N·m: `inverse_dynamics` in base parameters, and with a force `foot_force_torque`.

    Parameters
    ----------
    leg : QuadrupedLeg
        Its bodies and drives are not used.
    parameters : CompositeParameters
        Those of this leg, see `composite_parameters`; torques without dissipation are linear in them.
    q, v, a : tuples of 3 scalars
        Joint angles (rad), rates (rad/s) and accelerations (rad/s²).
    gravity : tuple of 3 scalars
        Acceleration of gravity in the hip frame, m/s².
    force : tuple of 3 scalars
        Force that the environment applies to the foot, N.
    """
    at = plane_of(q)
    work = composite.inertia_torque(leg, parameters, at, v, a, gravity)
    return total((subtract(work, composite.foot_pull(leg, at, force)), dissipation_torque(leg, v)))


def composite_bias(leg: QuadrupedLeg, parameters: CompositeParameters, q: Vector, v: Vector, gravity: Vector) -> Vector:
    """`bias` in base parameters, N·m."""
    return composite_inverse_dynamics(leg, parameters, q, v, ZERO, gravity)


def composite_mass_matrix(leg: QuadrupedLeg, parameters: CompositeParameters, q: Vector) -> Matrix:
    """`mass_matrix` in base parameters, kg·m²."""
    return composite.mass_matrix(leg, parameters, q)


def composite_gravity_torque(leg: QuadrupedLeg, parameters: CompositeParameters, q: Vector, gravity: Vector) -> Vector:
    """`gravity_torque` in base parameters, N·m."""
    return composite.gravity_torque(parameters, q, gravity)


def composite_potential_energy(
    leg: QuadrupedLeg, parameters: CompositeParameters, q: Vector, gravity: Vector
) -> Scalar:
    """`potential_energy` in base parameters, J."""
    return composite.potential_energy(parameters, q, gravity)


def composite_forward_dynamics(
    leg: QuadrupedLeg,
    parameters: CompositeParameters,
    q: Vector,
    v: Vector,
    torque: Vector,
    gravity: Vector,
    force: Vector = ZERO,
) -> Vector:
    """Joint accelerations (rad/s²): `forward_dynamics` in base parameters, with a force (N) on the foot."""
    missing = subtract(torque, composite_inverse_dynamics(leg, parameters, q, v, ZERO, gravity, force))
    return solve_symmetric(composite_mass_matrix(leg, parameters, q), missing)


# Foot force. It is the one that the ENVIRONMENT applies to the FOOT: joint torque = M a + h - J^T F.


def foot_force_torque(leg: QuadrupedLeg, q: Vector, force: Vector) -> Vector:
    """Part of the joint torques that a force on the foot (N) causes, -J^T F, N·m."""
    return negate(composite.foot_pull(leg, plane_of(q), force))


def foot_force(
    leg: QuadrupedLeg, q: Vector, v: Vector, a: Vector, torque: Vector, gravity: Vector
) -> tuple[Vector, Scalar]:
    """Force that the environment applies to the foot (N) while torques (N·m) drive the motion, and det J.

    F = J^-T (M a + h - torque). There is none where det J vanishes: look at the second result.
    """
    missing = subtract(inverse_dynamics(leg, q, v, a, gravity), torque)
    return matvec(transpose(inverse_jacobian(leg, q)), missing), foot_jacobian_determinant(leg, q)


def from_urdf(description: Description, *, tolerance: float = 1e-9) -> QuadrupedLeg:
    """Take the leg's geometry and inertia from a URDF+ description, exactly, and check every assumption made here.

    Links may have any name but for `hip` and `foot`, and frames may be turned in any way, or moved along their joint's
    axis, as long as the joints have the names of `JOINT_NAMES` and turn about the axes of Table 1 while all angles are
    zero: poses come from yourdfpy's forward kinematics, and links fixed to a body are merged into it.

    Parameters
    ----------
    description : Description
        A validated description; yourdfpy reads its text, loops, couplings and transmissions are its own.
    tolerance : float
        Greatest deviation from an assumption, m or rad.

    Returns
    -------
    QuadrupedLeg

    Raises
    ------
    FormulaAssumptionError
        With `element`, `found`, `expected` and `tolerance`, where the file is not the mechanism of the formulas.
    """
    from leg_dynamics.closed_form import _quadruped_leg_file

    return _quadruped_leg_file.read(description, tolerance)
