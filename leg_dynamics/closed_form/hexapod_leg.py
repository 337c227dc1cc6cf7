"""Hexapod leg (U+UPR)P+UPS (Rong et al. 2012): kinematics and dynamics in closed form, equation by equation.

Coordinates are q = (l1, l2, l3): the lengths of the three driven struts in m; efforts are forces along them in N, and a
positive one extends. All vectors are in the hip frame A1-xyz: x ahead to A2, z DOWN, y to the right. Strut 1 turns by
alpha about x and then by beta about p, so that it points along w = (sin(beta), -sin(alpha) cos(beta),
cos(alpha) cos(beta)). A leg with side = -1 is the mirror image in the x-z plane. Where the paper prints a wrong formula
or leaves a term out, the one here is corrected and its docstring says what changed; equation numbers end the line that
states the equation. The paper has neither forward kinematics nor dynamics.

Forward kinematics needs two square roots. With k2 and h2 the coordinates of B2 along x and across it in the plane of
struts 1 and 2, and f = -side B3y and h3 = B3z those of B3,

    k2 = e sin(beta) + b cos(beta) = (a² + b² + e² - l2²) / (2 a)                 h2 = e cos(beta) - b sin(beta)
    f  = m sin(alpha) side - c cos(alpha) = (l3² - l1² - a² - c²) / (2 a)         h3 = m cos(alpha) + c sin(alpha) side

where m = l1 cos(beta), so that k2² + h2² = b² + e² and f² + h3² = m² + c². The lengths give k2 and f; the signs of h2
and h3, whether B2 and B3 lie below or above the hip, are free: four assembly modes. Their angles follow without
branches. The passive joints are singular where h2 = 0 (struts 1 and 2 in line with B2 across), h3 = 0 (B3 level with
the hip), or strut 3 along x.

Every formula takes Python floats, NumPy arrays or CasADi symbols as components (see `algebra`) and never looks at a
value. Domain margins are returned as values. The assembly mode is plain Python and chooses the formula.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from leg_dynamics.closed_form import _hexapod_leg_composite as composite
from leg_dynamics.closed_form._hexapod_leg_composite import (
    BASE_PARAMETER_NAMES,
    BASE_PARAMETER_UNITS,
    BaseParameters,
    Chain,
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
    rotation_x,
    rotation_y,
    scale,
    sign,
    sin,
    solve,
    solve_symmetric,
    sqrt,
    subtract,
    total,
    transpose,
    where,
)
from leg_dynamics.closed_form.rigid_body import (
    FIXED,
    Angle,
    Body,
    Dissipation,
    Motion,
    Slide,
    gravity_force,
    hinged,
    inertia_matrix,
    kinetic,
    potential,
    slid,
    virtual_work,
)
from leg_dynamics.description.model import STANDSTILL
from leg_dynamics.errors import RouteError

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description

__all__ = [
    "ASSEMBLY_MODES",
    "BASE_PARAMETER_NAMES",
    "BASE_PARAMETER_UNITS",
    "BODY_NAMES",
    "BRANCHES",
    "BRANCH_ENDS",
    "JOINT_NAMES",
    "SINGULARITY_LIMIT",
    "TREE_JOINT_NAMES",
    "Angle",
    "BaseParameters",
    "Body",
    "CompositeParameters",
    "Dissipation",
    "HexapodLeg",
    "InverseKinematics",
    "Motion",
    "assembly_margins",
    "assembly_ranges",
    "ball_angle",
    "base_parameters",
    "bias",
    "body_motions",
    "closure_residual",
    "composite_bias",
    "composite_forward_dynamics",
    "composite_gravity_torque",
    "composite_inverse_dynamics",
    "composite_mass_matrix",
    "composite_parameters",
    "composite_potential_energy",
    "condition_number",
    "dissipation_torque",
    "extension_rates",
    "extension_rates_of_twist",
    "foot_acceleration",
    "foot_bias_acceleration",
    "foot_force",
    "foot_force_torque",
    "foot_jacobian",
    "foot_jacobian_derivative",
    "foot_position",
    "foot_velocity",
    "forward_dynamics",
    "from_urdf",
    "gravity_torque",
    "hip_points",
    "in_branch",
    "inverse_dynamics",
    "inverse_jacobian",
    "inverse_jacobian_determinant",
    "inverse_kinematics",
    "kinetic_energy",
    "lagrangian",
    "mass_matrix",
    "mean_condition_number",
    "platform_angles",
    "platform_angular_velocity",
    "platform_direction",
    "platform_rotation",
    "potential_energy",
    "regressor",
    "singular_values",
    "singularity_margins",
    "strut_length_1",
    "strut_length_2",
    "strut_length_3",
    "strut_margins",
    "strut_vectors",
    "tree_coefficients",
    "tree_coordinates",
    "twist_jacobian",
    "universal_margins",
    "velocity_residual",
]

JOINT_NAMES = ("l1", "l2", "l3")
ASSEMBLY_MODES = ("B2_down_B3_down", "B2_down_B3_up", "B2_up_B3_down", "B2_up_B3_up")
"""Ways to assemble the leg with given strut lengths, the paper's first: where B2 and B3 lie, see the module."""
BRANCHES = ASSEMBLY_MODES
"""Names of the inverse kinematic solutions: the strut lengths that put the foot at a point in that assembly mode."""
_SIGNS = {name: (h2, h3) for name, (h2, h3) in zip(ASSEMBLY_MODES, ((1, 1), (1, -1), (-1, 1), (-1, -1)), strict=True)}

SINGULARITY_LIMIT = 1e-6
"""Least usable value of `singularity_margins`; below, rates of passive angles lose more than half of their digits."""

BRANCH_ENDS = MappingProxyType(
    {
        "hinge_margin": "B2 would lie {missing:.3g} m beyond the x axis",
        "ball_margin": "B3 would lie {missing:.3g} m beyond the plane of the hip's joints",
    }
)
"""What ends a branch where a margin of `InverseKinematics` is negative."""

_AXIS_CLEARANCE = 1e-9
"""Distance (m) of the foot from the x axis below which alpha has no meaning left."""

TREE_JOINT_NAMES = tuple(f"{name}{i}" for i in (1, 2, 3) for name in ("alpha", "beta", "l"))
BODY_NAMES = tuple(f"{name}_{i}" for i in (1, 2, 3) for name in ("cross", "sleeve", "rod"))


@dataclass(frozen=True)
class HexapodLeg:
    """Geometry and inertia of a hexapod leg: lengths in m, SI units.

    Scalars may be floats, arrays or CasADi symbols; `dataclasses.replace` makes a changed copy. A cross's frame is the
    hip's, turned by alpha_i about x; a sleeve's and a rod's are turned by beta_i about y too, so that z runs along the
    strut. Origins are A_i for cross and sleeve, the strut's end for the rod.
    """

    a: Scalar
    """A1 to A2 along x, and A1 to A3 along y."""
    b: Scalar
    """B0 to B2, along u; not negative."""
    c: Scalar
    """B1 to B3, along p; not negative."""
    e: Scalar
    """A1 to B0, along w."""
    bodies: tuple[Body, ...]
    """The nine moving bodies, in the order of `BODY_NAMES`."""
    side: Scalar = 1.0
    """1 where A3 is at +y; -1 for the mirror image."""
    gravity: Vector = (0.0, 0.0, 9.81)
    """Acceleration of gravity in the hip frame, m/s²; the default is a level hip, z down."""
    drive_mass: Vector = ZERO
    """Inertia of the drives felt along the struts: motor-side inertia times reduction squared, kg."""
    dissipation: tuple[Dissipation, ...] = ()
    """The tree joints that have damping or friction; all others are left out."""
    assembly_mode: str = ASSEMBLY_MODES[0]
    """Which of `ASSEMBLY_MODES` every formula of q is about."""

    def __post_init__(self) -> None:
        if self.assembly_mode not in ASSEMBLY_MODES:
            raise RouteError(
                f"assembly mode {self.assembly_mode!r} does not exist: choose one of {', '.join(ASSEMBLY_MODES)}"
            )

    @property
    def parameters(self) -> Mapping[str, Scalar]:
        """The named lengths (m) that (29) and (33) list, limits aside."""
        return MappingProxyType({"a": self.a, "b": self.b, "c": self.c, "e": self.e})  # (29), (33)


# 3.1 and 3.2 Position, (1)-(9)


def hip_points(leg: HexapodLeg) -> tuple[Vector, Vector, Vector]:
    """Centres A1, A2, A3 of the U joints in the hip, m."""
    return ZERO, (leg.a, 0.0, 0.0), (0.0, leg.side * leg.a, 0.0)


def platform_rotation(alpha: Scalar, beta: Scalar) -> Matrix:
    """Rotation R = [u p w] of the platform and of strut 1."""
    return matmul(rotation_x(sin(alpha), cos(alpha)), rotation_y(sin(beta), cos(beta)))  # (1)


def strut_vectors(leg: HexapodLeg, p: Vector) -> tuple[Vector, Vector, Vector]:
    """Vectors along the struts from the U joints to their ends, m, for a foot B1 at p (m) and |beta| < 90 deg.

    The struts' directions times their lengths in the loops (2)-(4), b and c being vectors along u and p.
    """
    alpha, beta = platform_angles(p)
    u, pv, w = transpose(platform_rotation(alpha, beta))
    _, a2, a3 = hip_points(leg)
    first = scale(strut_length_1(p), w)  # (2)
    second = subtract(add(scale(leg.e, w), scale(leg.b, u)), a2)  # (3)
    third = subtract(add(p, scale(leg.side * leg.c, pv)), a3)  # (4)
    return first, second, third


def strut_length_1(p: Vector) -> Scalar:
    """Length of strut 1, m."""
    return sqrt(dot(p, p))  # (5)


def strut_length_2(leg: HexapodLeg, p: Vector) -> Scalar:
    """Length of strut 2, m. It depends on beta alone: l2² = a² + b² + e² - 2 a (e sin(beta) + b cos(beta))."""
    second = strut_vectors(leg, p)[1]
    return sqrt(dot(second, second))  # (6)


def strut_length_3(leg: HexapodLeg, p: Vector) -> Scalar:
    """Length of strut 3, m. It depends on l1, alpha and beta, so that sideways swings are not decoupled from it."""
    third = strut_vectors(leg, p)[2]
    return sqrt(dot(third, third))  # (7)


def platform_direction(p: Vector) -> Vector:
    """Direction w of strut 1 and of the platform's normal."""
    return scale(1.0 / strut_length_1(p), p)  # (8)


def platform_angles(p: Vector) -> tuple[Scalar, Scalar]:
    """Angles alpha, beta of strut 1, rad, of the solution with |beta| < 90 deg.

    The paper swaps the two: (1) makes beta the arcsine of w_x, and alpha follows from w_y and w_z.
    """
    x, y, z = platform_direction(p)
    return atan2(-y, z), atan2(x, sqrt(y * y + z * z))  # (9)


class InverseKinematics(NamedTuple):
    """Strut lengths and how far the request is inside its domain; a negative margin means there is no solution."""

    q: Vector
    """(l1, l2, l3) in m."""
    hinge_margin: Scalar
    """Height of B2 on its own side of the x axis, m."""
    ball_margin: Scalar
    """Height of B3 on its own side of the hip plane, m."""
    axis_margin: Scalar
    """Distance of the foot from the x axis, on which alpha means nothing, m."""

    @property
    def margin(self) -> Scalar:
        """The smallest margin, m."""
        return fmin(self.axis_margin, fmin(self.hinge_margin, self.ball_margin))

    @property
    def singular_margin(self) -> Scalar:
        """Negative where the foot is on the x axis: lengths that put it there exist for any alpha."""
        return self.axis_margin


def inverse_kinematics(leg: HexapodLeg, p: Vector, branch: str = ASSEMBLY_MODES[0]) -> InverseKinematics:
    """Strut lengths that put the foot B1 at p (m) while the leg is in an assembly mode: (5)-(9).

    Strut 1 has |beta| < 90 deg where B2 is down and |beta| > 90 deg where it is up. Lengths exist for every point off
    the x axis, but not each point belongs to each mode: a foot well above the hip has B3 up.

    Parameters
    ----------
    leg : HexapodLeg
        Its own `assembly_mode` is not used.
    p : tuple of 3 scalars
        Foot position in the hip frame, m.
    branch : str
        One of `BRANCHES`.
    """
    hinge_side, ball_side = _SIGNS[branch]
    a, b, c, e = leg.a, leg.b, leg.c, leg.e
    x, y, z = p
    radius_squared = y * y + z * z
    radius = sqrt(radius_squared)
    apart = where(radius > _AXIS_CLEARANCE, radius, 1.0)
    squared = x * x + radius_squared
    l1 = sqrt(squared)  # (5)
    length = where(l1 > _AXIS_CLEARANCE, l1, 1.0)
    sb, cb = x / length, hinge_side * radius / length  # (8), (9)
    k2, h2 = e * sb + b * cb, e * cb - b * sb
    # B3z and -side B3y; with (9), sin(alpha) = -y / (radius hinge_side) and cos(alpha) = z / (radius hinge_side).
    sideways, height = hinge_side * leg.side * c * y / apart, hinge_side * c * z / apart
    f, h3 = -(leg.side * y) - height, z - sideways
    l2 = sqrt((k2 - a) * (k2 - a) + h2 * h2)  # (6)
    l3 = sqrt(x * x + (f + a) * (f + a) + h3 * h3)  # (7)
    return InverseKinematics((l1, l2, l3), hinge_side * h2, ball_side * h3, radius - _AXIS_CLEARANCE)


def in_branch(leg: HexapodLeg, branch: str) -> HexapodLeg:
    """Return the leg in the assembly mode that a branch of the inverse kinematics belongs to."""
    return replace(leg, assembly_mode=branch)


# Forward kinematics, which the paper lacks


class _Pose(NamedTuple):
    """A closed leg, mirrored to the right side: sines and cosines of its passive angles and what they come from."""

    l1: Scalar
    l2: Scalar
    l3: Scalar
    k2: Scalar
    h2: Scalar
    f: Scalar
    h3: Scalar
    x: Scalar
    """x of B1 and of B3: l1 sin(beta)."""
    m: Scalar
    """l1 cos(beta)."""
    y: Scalar
    """-y of B3 from A3."""
    swing: Scalar
    """Distance of B3 from the proximal axis of strut 3."""
    sa: Scalar
    ca: Scalar
    sb: Scalar
    cb: Scalar
    sb2: Scalar
    cb2: Scalar
    sa3: Scalar
    ca3: Scalar
    sb3: Scalar
    cb3: Scalar
    over_l2: Scalar
    """1 / l2, and so on: divisions are dear."""
    over_h2: Scalar
    over_h3: Scalar
    over_swing: Scalar


def _pose(leg: HexapodLeg, q: Vector) -> _Pose:
    a, b, c, e = leg.a, leg.b, leg.c, leg.e
    hinge_side, ball_side = _SIGNS[leg.assembly_mode]
    l1, l2, l3 = q
    half, arm = 1.0 / (2.0 * a), b * b + e * e
    over_arm = 1.0 / arm
    k2 = (a * a + arm - l2 * l2) * half
    h2 = hinge_side * sqrt(arm - k2 * k2)
    sb, cb = (e * k2 - b * h2) * over_arm, (b * k2 + e * h2) * over_arm
    x, m = l1 * sb, l1 * cb
    f = (l3 * l3 - l1 * l1 - (a * a + c * c)) * half
    ball = m * m + c * c
    h3 = ball_side * sqrt(ball - f * f)
    over_ball = 1.0 / ball
    sa, ca = (m * f + c * h3) * over_ball, (m * h3 - c * f) * over_ball
    y = f + a
    swing = sqrt(l3 * l3 - x * x)
    over_l2, over_l3, over_swing = 1.0 / l2, 1.0 / l3, 1.0 / swing
    return _Pose(
        l1=l1,
        l2=l2,
        l3=l3,
        k2=k2,
        h2=h2,
        f=f,
        h3=h3,
        x=x,
        m=m,
        y=y,
        swing=swing,
        sa=sa,
        ca=ca,
        sb=sb,
        cb=cb,
        sb2=(k2 - a) * over_l2,
        cb2=h2 * over_l2,
        sa3=y * over_swing,
        ca3=h3 * over_swing,
        sb3=x * over_l3,
        cb3=swing * over_l3,
        over_l2=over_l2,
        over_h2=1.0 / h2,
        over_h3=1.0 / h3,
        over_swing=over_swing,
    )


def assembly_margins(leg: HexapodLeg, q: Vector) -> Vector:
    """1 - k2² / (b² + e²) and 1 - f² / (m² + c²): negative where the lengths do not close; zero where modes meet.

    Where the first is negative, there is no m, and the second repeats it.
    """
    pose = _pose(leg, q)
    hinge = 1.0 - pose.k2 * pose.k2 / (leg.b * leg.b + leg.e * leg.e)
    ball = 1.0 - pose.f * pose.f / (pose.m * pose.m + leg.c * leg.c)
    return hinge, where(hinge >= 0.0, ball, hinge)


def assembly_ranges(leg: HexapodLeg, q: Vector) -> Matrix:
    """Least and greatest length of each strut with which the leg closes, the others as they are, m.

    Triangle inequalities: A1 is a from A2 and sqrt(b² + e²) from B2, whatever l1; across the x axis B3 is sqrt(m² + c²)
    from A1, with m = l1 cos(beta), and A3 is a from A1. The range of strut 1 is wider than it need be: what is exact is
    asked of strut 3.
    """
    pose = _pose(leg, q)
    arm = sqrt(leg.b * leg.b + leg.e * leg.e)
    middle = pose.l1 * pose.l1 + leg.a * leg.a + leg.c * leg.c
    half = 2.0 * leg.a * sqrt(pose.m * pose.m + leg.c * leg.c)
    return (
        (0.0 * pose.l1, leg.a + leg.c + pose.l3),
        (sqrt((leg.a - arm) * (leg.a - arm)), leg.a + arm),
        (sqrt(middle - half), sqrt(middle + half)),
    )


def singularity_margins(leg: HexapodLeg, q: Vector) -> Vector:
    """Values that vanish where passive joints lose their direction, negative where the struts do not close the leg.

    Those of `assembly_margins`; the square of B3's distance from the proximal axis of strut 3 over a², where the first
    is not negative; and the lengths over a, since a strut of no length has no direction.
    """
    pose = _pose(leg, q)
    hinge, ball = assembly_margins(leg, q)
    over_a = 1.0 / leg.a
    swing = (pose.l3 * pose.l3 - pose.x * pose.x) * (over_a * over_a)
    return hinge, ball, where(hinge >= 0.0, swing, hinge), pose.l1 * over_a, pose.l2 * over_a, pose.l3 * over_a


def foot_position(leg: HexapodLeg, q: Vector) -> Vector:
    """Position of the foot B1, m, in the leg's assembly mode: (2) with the angles of the forward kinematics."""
    pose = _pose(leg, q)
    return pose.x, -(leg.side * pose.m * pose.sa), pose.m * pose.ca  # (2)


def tree_coordinates(leg: HexapodLeg, q: Vector) -> dict[str, Scalar]:
    """All nine tree joint coordinates at which both loops close: angles in rad, lengths in m."""
    pose = _pose(leg, q)
    alpha, beta = atan2(leg.side * pose.sa, pose.ca), atan2(pose.sb, pose.cb)
    return {
        "alpha1": alpha,
        "beta1": beta,
        "l1": pose.l1,
        "alpha2": alpha,
        "beta2": atan2(pose.sb2, pose.cb2),
        "l2": pose.l2,
        "alpha3": atan2(leg.side * pose.sa3, pose.ca3),
        "beta3": atan2(pose.sb3, pose.cb3),
        "l3": pose.l3,
    }


def closure_residual(leg: HexapodLeg, q: Vector) -> Vector:
    """What the loops (2), (3) and (4) leave with each strut's own direction and length, m: nine zeros."""
    pose = _pose(leg, q)
    _, a2, a3 = hip_points(leg)
    u, p, w = transpose(matmul(rotation_x(leg.side * pose.sa, pose.ca), rotation_y(pose.sb, pose.cb)))
    w2 = transpose(matmul(rotation_x(leg.side * pose.sa, pose.ca), rotation_y(pose.sb2, pose.cb2)))[2]
    w3 = transpose(matmul(rotation_x(leg.side * pose.sa3, pose.ca3), rotation_y(pose.sb3, pose.cb3)))[2]
    foot = foot_position(leg, q)
    first = subtract(foot, scale(pose.l1, w))  # (2)
    second = subtract(scale(leg.e, w), subtract(add(a2, scale(pose.l2, w2)), scale(leg.b, u)))  # (3)
    third = subtract(foot, subtract(add(a3, scale(pose.l3, w3)), scale(leg.side * leg.c, p)))  # (4)
    return (*first, *second, *third)


# 3.3 Velocity at a foot position, (10)-(25)


def _frame(leg: HexapodLeg, p: Vector) -> tuple[Scalar, Scalar, Scalar, Vector, Vector, Vector, Vector, Vector]:
    """sin(beta), cos(beta), l1, u, p, w and the directions of struts 2 and 3 for a foot at p."""
    alpha, beta = platform_angles(p)
    u, pv, w = transpose(platform_rotation(alpha, beta))
    first, second, third = strut_vectors(leg, p)
    w2 = scale(1.0 / sqrt(dot(second, second)), second)
    w3 = scale(1.0 / sqrt(dot(third, third)), third)
    return sin(beta), cos(beta), sqrt(dot(first, first)), u, pv, w, w2, w3


def twist_jacobian(leg: HexapodLeg, p: Vector) -> Matrix:
    """Rates of the struts by (v1, omega1), shape (3, 6): columns 1-3 dimensionless, 4-6 in m."""
    _, _, _, u, pv, w, w2, w3 = _frame(leg, p)
    arm_2 = add(scale(leg.e, cross(w, w2)), cross(scale(leg.b, u), w2))
    arm_3 = cross(scale(leg.side * leg.c, pv), w3)
    return (*w, *ZERO), (*ZERO, *arm_2), (*w3, *arm_3)  # (16)


def extension_rates_of_twist(leg: HexapodLeg, p: Vector, v1: Vector, omega1: Vector) -> Vector:
    """Rates of the struts, m/s, for a velocity of B1 (m/s) and an angular velocity of strut 1 (rad/s)."""
    return matvec(twist_jacobian(leg, p), (*v1, *omega1))  # (13), (14), (15), (17)


def platform_angular_velocity(leg: HexapodLeg, p: Vector, v1: Vector) -> Vector:
    """Angular velocity omega1 of strut 1 and platform, rad/s, for a velocity of B1, m/s.

    Printed without its second term, as though strut 1 could not turn about w; a U joint blocks x cross p instead, and
    w · omega1 = alpha' sin(beta).
    """
    sb, cb, l1, _, pv, w, _, _ = _frame(leg, p)
    across = scale(1.0 / l1, cross(w, v1))  # (18)
    spin = -(sb / (l1 * cb)) * dot(pv, v1)
    return add(across, scale(spin, w))  # (19)


def inverse_jacobian(leg: HexapodLeg, p: Vector) -> Matrix:
    """Jacobian J_v of the strut lengths by the foot position, dimensionless, for a foot at p (m).

    Row 2 is printed without (e / l1) [w2 - (w1 · w2) w1], which (20) still has; row 3 without the last term, which
    comes from the spin that (19) lacks.
    """
    sb, cb, l1, u, pv, w, w2, w3 = _frame(leg, p)
    along_2, along_3 = dot(w2, w), dot(w3, w)
    c = leg.side * leg.c
    row_2 = add(
        scale(-(leg.b * along_2 / l1), u),
        scale(leg.e / l1, subtract(w2, scale(along_2, w))),
    )  # (20), (22)
    row_3 = total(
        (w3, scale(-(c * along_3 / l1), pv), scale(c * sb / (cb * l1) * dot(w3, u), pv)),
    )  # (21), (23)
    return w, row_2, row_3  # (24)


def extension_rates(leg: HexapodLeg, p: Vector, v1: Vector) -> Vector:
    """Rates of the struts, m/s, for a foot at p (m) that moves with v1 (m/s)."""
    return matvec(inverse_jacobian(leg, p), v1)  # (25)


def inverse_jacobian_determinant(leg: HexapodLeg, p: Vector) -> Scalar:
    """Determinant of J_v, dimensionless; the printed J_v hides that it vanishes with b sin(beta) - e cos(beta).

    -side a² (b sin(beta) - e cos(beta)) B3z / (l1² l2 l3 cos(beta)), B3z = l1 cos(alpha) cos(beta) + side c sin(alpha).
    """
    sb, cb, l1, _, pv, _, _, _ = _frame(leg, p)
    _, second, third = strut_vectors(leg, p)
    ball = p[2] + leg.side * leg.c * pv[2]
    l2, l3 = sqrt(dot(second, second)), sqrt(dot(third, third))
    return -(leg.side * leg.a * leg.a * (leg.b * sb - leg.e * cb) * ball) / (l1 * l1 * l2 * l3 * cb)


# 4 Workspace and 5 dexterity, (26)-(33). Sets, areas and volumes of the workspace are those of the analysis room.


def strut_margins(q: Vector, lower: Vector, upper: Vector) -> Vector:
    """Distances of the three lengths from the nearer of their own two limits, m; the paper has one pair for all."""
    return tuple(
        fmin(length - least, most - length) for length, least, most in zip(q, lower, upper, strict=True)
    )  # (26)


def ball_angle(leg: HexapodLeg, q: Vector, h: Scalar) -> Scalar:
    """Angle eta_b of the ball B3 away from the initial pose at height h (m), rad.

    Printed as arccos(q3 · l3) with l3 a vector of some length; here l3 is its direction, and the arctangent keeps the
    digits of small angles. q3, fixed on the platform, is
    strut 3's own direction in the initial pose, or the initial angle would not be 0.
    """
    pose = _pose(leg, q)
    rotation = matmul(rotation_x(leg.side * pose.sa, pose.ca), rotation_y(pose.sb, pose.cb))
    offset = leg.side * (leg.c - leg.a)
    length = sqrt(offset * offset + h * h)
    q3 = matvec(rotation, (0.0, offset / length, h / length))
    l3 = (pose.x / pose.l3, -(leg.side * pose.y) / pose.l3, pose.h3 / pose.l3)
    across = cross(q3, l3)
    return atan2(sqrt(dot(across, across)), dot(q3, l3))  # (27)


def universal_margins(leg: HexapodLeg, q: Vector, limit: Scalar) -> Vector:
    """limit - |angle| for alpha1, beta1, alpha2, ... beta3, rad: both signs count, which is not printed."""
    angles = tree_coordinates(leg, q)
    return tuple(limit - fabs(angles[f"{name}{i}"]) for i in (1, 2, 3) for name in ("alpha", "beta"))  # (28)


def singular_values(a: Matrix) -> Vector:
    """Singular values of a 3 x 3 matrix, greatest first, from the eigenvalues of A A^T in closed form."""
    gram = matmul(a, transpose(a))
    mean = (gram[0][0] + gram[1][1] + gram[2][2]) / 3.0
    d0, d1, d2 = gram[0][0] - mean, gram[1][1] - mean, gram[2][2] - mean
    off = gram[0][1] * gram[0][1] + gram[0][2] * gram[0][2] + gram[1][2] * gram[1][2]
    spread = sqrt(fmax((d0 * d0 + d1 * d1 + d2 * d2 + 2.0 * off) / 6.0, 1e-60))
    shifted = ((d0, *gram[0][1:]), (gram[1][0], d1, gram[1][2]), (*gram[2][:2], d2))
    phase = acos(fmin(fmax(determinant(shifted) / (2.0 * spread * spread * spread), -1.0), 1.0)) / 3.0
    greatest = mean + 2.0 * spread * cos(phase)
    least = mean + 2.0 * spread * cos(phase + 2.0 * math.pi / 3.0)
    # The product is exact where the least eigenvalue would be rounding of the greatest.
    middle = 3.0 * mean - greatest - least
    first, second = sqrt(greatest), sqrt(fmax(middle, 0.0))
    return first, second, fabs(determinant(a)) / (first * second)


def condition_number(jacobian: Matrix) -> Scalar:
    """Condition number k of a Jacobian, its greatest singular value over its least."""
    values = singular_values(jacobian)
    return values[0] / values[2]  # (30)


def mean_condition_number(numbers: Sequence[Scalar], weights: Sequence[Scalar]) -> tuple[Scalar, Scalar]:
    """Mean kbar and deviation ktilde of condition numbers over a workspace, weights being the volumes of its cells.

    (32) is printed with the volume outside the root, where it would have the dimension of a volume to the power -1/2.
    """
    volume = sum(weights)
    mean = sum(k * weight for k, weight in zip(numbers, weights, strict=True)) / volume  # (31)
    square = sum((k - mean) * (k - mean) * weight for k, weight in zip(numbers, weights, strict=True)) / volume
    return mean, sqrt(square)  # (32)


# Motion in the coordinates q: the loops differentiated once and twice. The rates of the passive angles are linear in v.


class _Rates(NamedTuple):
    """First time derivatives, mirrored to the right side."""

    alpha: Scalar
    beta: Scalar
    beta2: Scalar
    alpha3: Scalar
    beta3: Scalar
    f: Scalar
    m: Scalar
    x: Scalar
    h3: Scalar


def _turn_2(leg: HexapodLeg, pose: _Pose) -> Scalar:
    """beta2' over beta'."""
    return (leg.b * leg.b + leg.e * leg.e - leg.a * pose.k2) * (pose.over_l2 * pose.over_l2)


def _rates(leg: HexapodLeg, pose: _Pose, v: Vector) -> _Rates:
    v1, v2, v3 = v
    over_a = 1.0 / leg.a
    beta = -(pose.l2 * v2 * over_a * pose.over_h2)
    f = (pose.l3 * v3 - pose.l1 * v1) * over_a
    m = pose.cb * v1 - pose.x * beta
    alpha = (f - pose.sa * m) * pose.over_h3
    x = pose.sb * v1 + pose.m * beta
    h3 = pose.ca * m - pose.f * alpha
    return _Rates(
        alpha=alpha,
        beta=beta,
        beta2=_turn_2(leg, pose) * beta,
        alpha3=(pose.ca3 * f - pose.sa3 * h3) * pose.over_swing,
        beta3=(x - pose.sb3 * v3) * pose.over_swing,
        f=f,
        m=m,
        x=x,
        h3=h3,
    )


def _work(leg: HexapodLeg, pose: _Pose, turns: tuple[Scalar, Scalar, Scalar, Scalar, Scalar], thrust: Vector) -> Vector:
    """Forces along the struts that do the same work as moments `turns` on the passive angles and forces `thrust`.

    The transpose of `_rates`, its lines in reverse order; angles in the order of `_Coefficients`.
    """
    alpha, beta, beta2, alpha3, beta3 = turns
    over_a = 1.0 / leg.a
    x = beta3 * pose.over_swing
    swung = alpha3 * pose.over_swing
    h3 = -(pose.sa3 * swung)
    tilt = (alpha - pose.f * h3) * pose.over_h3
    m = pose.ca * h3 - pose.sa * tilt
    f = (pose.ca3 * swung + tilt) * over_a
    whole_beta = beta + _turn_2(leg, pose) * beta2 + pose.m * x - pose.x * m
    return (
        thrust[0] + pose.sb * x + pose.cb * m - pose.l1 * f,
        thrust[1] - pose.l2 * over_a * pose.over_h2 * whole_beta,
        thrust[2] + pose.l3 * f - pose.sb3 * x,
    )


class _Accelerations(NamedTuple):
    """Second time derivatives, mirrored to the right side."""

    alpha: Scalar
    beta: Scalar
    beta2: Scalar
    alpha3: Scalar
    beta3: Scalar


def _accelerations(leg: HexapodLeg, pose: _Pose, rates: _Rates, v: Vector, a: Vector) -> _Accelerations:
    v1, v2, v3 = v
    a1, a2, a3 = a
    over_a = 1.0 / leg.a
    square = rates.beta * rates.beta
    beta = (pose.k2 * square - (v2 * v2 + pose.l2 * a2) * over_a) * pose.over_h2
    f = (v3 * v3 + pose.l3 * a3 - v1 * v1 - pose.l1 * a1) * over_a
    m = pose.cb * a1 - 2.0 * pose.sb * v1 * rates.beta - pose.m * square - pose.x * beta
    twice = 2.0 * rates.m
    alpha = (f - pose.sa * m - (pose.ca * twice - pose.f * rates.alpha) * rates.alpha) * pose.over_h3
    x = pose.sb * a1 + 2.0 * pose.cb * v1 * rates.beta - pose.x * square + pose.m * beta
    h3 = pose.ca * m - (pose.sa * rates.m + rates.f) * rates.alpha - pose.f * alpha
    turn_2 = _turn_2(leg, pose)
    turn_2_rate = -((leg.a * pose.cb2 * rates.beta + 2.0 * turn_2 * v2) * pose.over_l2)
    swing_rate = pose.sa3 * rates.f + pose.ca3 * rates.h3
    return _Accelerations(
        alpha=alpha,
        beta=beta,
        beta2=turn_2 * beta + turn_2_rate * rates.beta,
        alpha3=(pose.ca3 * f - pose.sa3 * h3 - 2.0 * swing_rate * rates.alpha3) * pose.over_swing,
        beta3=(x - pose.sb3 * a3 - (2.0 * pose.cb3 * v3 - pose.x * rates.beta3) * rates.beta3) * pose.over_swing,
    )


class _Coefficients(NamedTuple):
    """Derivatives of the passive angles by l1, l2, l3, mirrored to the right side."""

    alpha: Vector
    beta: Vector
    beta2: Vector
    alpha3: Vector
    beta3: Vector


def _coefficients(leg: HexapodLeg, pose: _Pose) -> _Coefficients:
    units = [_rates(leg, pose, unit)[:5] for unit in IDENTITY]
    alpha, beta, beta2, alpha3, beta3 = zip(*units, strict=True)
    # beta depends on l2 alone: exact zeros keep graphs small.
    return _Coefficients(alpha, (0.0, beta[1], 0.0), (0.0, beta2[1], 0.0), alpha3, beta3)


def tree_coefficients(leg: HexapodLeg, q: Vector) -> dict[str, Vector]:
    """First-order influence coefficients of the nine tree joints: derivatives by l1, l2, l3."""
    first = _coefficients(leg, _pose(leg, q))
    alpha = scale(leg.side, first.alpha)
    l1, l2, l3 = IDENTITY
    return {
        "alpha1": alpha,
        "beta1": first.beta,
        "l1": l1,
        "alpha2": alpha,
        "beta2": first.beta2,
        "l2": l2,
        "alpha3": scale(leg.side, first.alpha3),
        "beta3": first.beta3,
        "l3": l3,
    }


class _Foot(NamedTuple):
    """Direction w of strut 1 with its derivatives by alpha and beta."""

    w: Vector
    w_a: Vector
    w_b: Vector
    w_aa: Vector
    w_ab: Vector


def _foot(leg: HexapodLeg, pose: _Pose) -> _Foot:
    sa, ca, sb, cb = leg.side * pose.sa, pose.ca, pose.sb, pose.cb
    return _Foot(
        w=(sb, -(sa * cb), ca * cb),
        w_a=(0.0, -(ca * cb), -(sa * cb)),
        w_b=(cb, sa * sb, -(ca * sb)),
        w_aa=(0.0, sa * cb, -(ca * cb)),
        w_ab=(0.0, ca * sb, sa * sb),
    )


def foot_jacobian(leg: HexapodLeg, q: Vector) -> Matrix:
    """Foot Jacobian dx/dl, rows x, y, z, columns l1, l2, l3, dimensionless: the inverse of (24), without inverting it.

    It stays finite where strut 1 lies along x and (24) does not exist.
    """
    pose = _pose(leg, q)
    foot, first = _foot(leg, pose), _coefficients(leg, pose)
    columns = []
    for i, unit in enumerate(IDENTITY):
        swing = add(scale(leg.side * first.alpha[i] * pose.l1, foot.w_a), scale(first.beta[i] * pose.l1, foot.w_b))
        columns.append(add(swing, foot.w) if unit[0] else swing)
    return transpose(tuple(columns))


def foot_jacobian_derivative(leg: HexapodLeg, q: Vector, v: Vector) -> Matrix:
    """Time derivative of `foot_jacobian`, 1/s."""
    pose = _pose(leg, q)
    foot, first, rates = _foot(leg, pose), _coefficients(leg, pose), _rates(leg, pose, v)
    v1, v2, v3 = v
    turn = leg.side * rates.alpha
    w_rate = add(scale(turn, foot.w_a), scale(rates.beta, foot.w_b))
    w_a_rate = add(scale(turn, foot.w_aa), scale(rates.beta, foot.w_ab))
    w_b_rate = subtract(scale(turn, foot.w_ab), scale(rates.beta, foot.w))
    l1, arm_a, arm_b = pose.l1, scale(pose.l1, foot.w_a), scale(pose.l1, foot.w_b)
    arm_a_rate = add(scale(v1, foot.w_a), scale(l1, w_a_rate))
    arm_b_rate = add(scale(v1, foot.w_b), scale(l1, w_b_rate))
    h2_rate = -(pose.k2 * rates.beta)
    beta_rate = -((v2 / leg.a + first.beta[1] * h2_rate) / pose.h2)
    m_first = (pose.cb, -(pose.x * first.beta[1]), 0.0)
    m_first_rate = (-(pose.sb * rates.beta), -(rates.x * first.beta[1] + pose.x * beta_rate), 0.0)
    f_first_rate = (-(v1 / leg.a), 0.0, v3 / leg.a)
    sa_rate = pose.ca * rates.alpha
    columns = []
    for i, unit in enumerate(IDENTITY):
        alpha_rate = (
            f_first_rate[i] - m_first_rate[i] * pose.sa - m_first[i] * sa_rate - first.alpha[i] * rates.h3
        ) / pose.h3
        column = add(scale(leg.side * alpha_rate, arm_a), scale(leg.side * first.alpha[i], arm_a_rate))
        if unit[0]:
            column = add(column, w_rate)
        if unit[1]:
            column = total((column, scale(beta_rate, arm_b), scale(first.beta[1], arm_b_rate)))
        columns.append(column)
    return transpose(tuple(columns))


def foot_bias_acceleration(leg: HexapodLeg, q: Vector, v: Vector) -> Vector:
    """Foot acceleration at zero acceleration of the struts, Jdot v, m/s²."""
    pose = _pose(leg, q)
    foot, rates = _foot(leg, pose), _rates(leg, pose, v)
    second = _accelerations(leg, pose, rates, v, ZERO)
    turn, beta = leg.side * rates.alpha, rates.beta
    w_rate = add(scale(turn, foot.w_a), scale(beta, foot.w_b))
    w_bias = total(
        (
            scale(leg.side * second.alpha, foot.w_a),
            scale(second.beta, foot.w_b),
            scale(turn * turn, foot.w_aa),
            scale(2.0 * turn * beta, foot.w_ab),
            scale(-(beta * beta), foot.w),
        )
    )
    return add(scale(2.0 * v[0], w_rate), scale(pose.l1, w_bias))


def foot_velocity(leg: HexapodLeg, q: Vector, v: Vector) -> Vector:
    """Foot velocity v1 = J v, m/s."""
    return matvec(foot_jacobian(leg, q), v)


def foot_acceleration(leg: HexapodLeg, q: Vector, v: Vector, a: Vector) -> Vector:
    """Foot acceleration J a + Jdot v, m/s²."""
    return add(matvec(foot_jacobian(leg, q), a), foot_bias_acceleration(leg, q, v))


def velocity_residual(leg: HexapodLeg, q: Vector, v: Vector) -> Vector:
    """What the loops' derivatives (10), (11) and (12) leave with each strut's own angular velocity, m/s: nine zeros."""
    pose = _pose(leg, q)
    rates = _rates(leg, pose, v)
    motions = body_motions(leg, q, v)
    turnings = [motions[f"sleeve_{i}"].turning for i in (1, 2, 3)]
    (omega1, omega2, omega3), directions = [t.velocity for t in turnings], [transpose(t.rotation) for t in turnings]
    u, p, w = directions[0]
    w2, w3 = directions[1][2], directions[2][2]
    foot = _foot(leg, pose)
    swing = add(scale(leg.side * rates.alpha, foot.w_a), scale(rates.beta, foot.w_b))
    v1 = add(scale(v[0], foot.w), scale(pose.l1, swing))
    first = subtract(v1, add(scale(v[0], w), scale(pose.l1, cross(omega1, w))))  # (10)
    second = subtract(
        scale(leg.e, cross(omega1, w)),
        subtract(
            add(scale(v[1], w2), scale(pose.l2, cross(omega2, w2))),
            cross(omega1, scale(leg.b, u)),
        ),
    )  # (11)
    third = subtract(
        v1,
        subtract(
            add(scale(v[2], w3), scale(pose.l3, cross(omega3, w3))),
            cross(omega1, scale(leg.side * leg.c, p)),
        ),
    )  # (12)
    return (*first, *second, *third)


# Dynamics body by body, by virtual work. The functions after these compute the same strut by strut.


def body_motions(leg: HexapodLeg, q: Vector, v: Vector) -> dict[str, Motion]:
    """Motion of the frames of the nine bodies, by name."""
    pose = _pose(leg, q)
    first, rates = _coefficients(leg, pose), _rates(leg, pose, v)
    second = _accelerations(leg, pose, rates, v, ZERO)
    side = leg.side

    def mirrored(sine: Scalar, cosine: Scalar, coefficients: Vector, rate: Scalar, acceleration: Scalar) -> Angle:
        return Angle(side * sine, cosine, scale(side, coefficients), side * rate, side * acceleration)

    alpha = mirrored(pose.sa, pose.ca, first.alpha, rates.alpha, second.alpha)
    alpha_3 = mirrored(pose.sa3, pose.ca3, first.alpha3, rates.alpha3, second.alpha3)
    angles = (
        (alpha, Angle(pose.sb, pose.cb, first.beta, rates.beta, second.beta)),
        (alpha, Angle(pose.sb2, pose.cb2, first.beta2, rates.beta2, second.beta2)),
        (alpha_3, Angle(pose.sb3, pose.cb3, first.beta3, rates.beta3, second.beta3)),
    )
    motions = {}
    for i, (hip, (proximal, distal)) in enumerate(zip(hip_points(leg), angles, strict=True)):
        cross_turning = hinged(FIXED, "x", proximal)
        still = (ZERO, ZERO, ZERO)
        sleeve = Motion(hinged(cross_turning, "y", distal), hip, still, ZERO)
        motions[f"cross_{i + 1}"] = Motion(cross_turning, hip, still, ZERO)
        motions[f"sleeve_{i + 1}"] = sleeve
        motions[f"rod_{i + 1}"] = slid(sleeve, Slide(q[i], IDENTITY[i], v[i], 0.0))
    return motions


def kinetic_energy(leg: HexapodLeg, q: Vector, v: Vector) -> Scalar:
    """Kinetic energy of the nine bodies and the drives, J."""
    energy = kinetic(leg.bodies, body_motions(leg, q, v), v)
    for mass, rate in zip(leg.drive_mass, v, strict=True):
        energy = energy + 0.5 * mass * rate * rate
    return energy


def potential_energy(leg: HexapodLeg, q: Vector, gravity: Vector) -> Scalar:
    """Potential energy -sum m g · c, J, zero for masses in A1."""
    return potential(leg.bodies, body_motions(leg, q, ZERO), gravity)


def lagrangian(leg: HexapodLeg, q: Vector, v: Vector, gravity: Vector) -> Scalar:
    """L = K - P, J."""
    return kinetic_energy(leg, q, v) - potential_energy(leg, q, gravity)


def _with_drives(leg: HexapodLeg, matrix: Matrix) -> Matrix:
    return tuple(
        tuple(value + leg.drive_mass[i] if i == j else value for j, value in enumerate(row))
        for i, row in enumerate(matrix)
    )


def mass_matrix(leg: HexapodLeg, q: Vector) -> Matrix:
    """Mass matrix with the drives, kg."""
    return _with_drives(leg, inertia_matrix(leg.bodies, body_motions(leg, q, ZERO)))


def dissipation_torque(leg: HexapodLeg, q: Vector, v: Vector) -> Vector:
    """Force that overcomes damping and Coulomb friction of the tree joints, N.

    A joint slower than `STANDSTILL` of the three speeds together rests, and has no Coulomb friction.
    """
    if not leg.dissipation:
        return ZERO
    speed = fabs(v[0]) + fabs(v[1]) + fabs(v[2])
    coefficients = tree_coefficients(leg, q)
    force: Vector = ZERO
    for joint, damping, friction in leg.dissipation:
        first = coefficients[joint]
        rate = dot(first, v)
        way = where(fabs(rate) > STANDSTILL * speed, sign(rate), 0.0)
        force = add(force, scale(damping * rate + friction * way, first))
    return force


def inverse_dynamics(leg: HexapodLeg, q: Vector, v: Vector, a: Vector, gravity: Vector) -> Vector:
    """Forces of the struts without a foot force, N, by virtual work of the nine bodies; drives and losses included.

    Parameters
    ----------
    leg : HexapodLeg
    q, v, a : tuples of 3 scalars
        Lengths (m), rates (m/s) and accelerations (m/s²) of the struts.
    gravity : tuple of 3 scalars
        Acceleration of gravity in the hip frame, m/s².
    """
    drives = tuple(mass * a_i for mass, a_i in zip(leg.drive_mass, a, strict=True))
    work = virtual_work(leg.bodies, body_motions(leg, q, v), a, gravity)
    return total((work, drives, dissipation_torque(leg, q, v)))


def bias(leg: HexapodLeg, q: Vector, v: Vector, gravity: Vector) -> Vector:
    """`inverse_dynamics` at zero acceleration, N."""
    return inverse_dynamics(leg, q, v, ZERO, gravity)


def gravity_torque(leg: HexapodLeg, q: Vector, gravity: Vector) -> Vector:
    """Forces of the struts that hold the leg still against gravity, N."""
    return gravity_force(leg.bodies, body_motions(leg, q, ZERO), gravity)


def forward_dynamics(leg: HexapodLeg, q: Vector, v: Vector, torque: Vector, gravity: Vector) -> Vector:
    """Accelerations of the struts (m/s²) under their forces (N), without a foot force."""
    return solve_symmetric(mass_matrix(leg, q), subtract(torque, bias(leg, q, v, gravity)))


# The same dynamics strut by strut


def composite_parameters(leg: HexapodLeg) -> CompositeParameters:
    """Inertia of the nine bodies reduced to what their motion can tell; depends on a and side only by a constant."""
    return composite.composite_parameters(leg.bodies, dict(enumerate(hip_points(leg), 1)))


def base_parameters(leg: HexapodLeg) -> Vector:
    """Fewest numbers that forces without losses are linear in: `BaseParameters`, in its order."""
    return composite.base_parameters(composite_parameters(leg), leg.b, leg.side * leg.c, leg.e, leg.drive_mass)


def regressor(leg: HexapodLeg, q: Vector, v: Vector, a: Vector, gravity: Vector) -> Matrix:
    """Matrix Y (3 x 39) of inverse dynamics without losses = Y pi, pi = `base_parameters`: what identification needs.

    Of the leg only lengths, side and assembly mode are used. Drives are in pi; losses and a foot force are not:
    subtract `dissipation_torque` and `foot_force_torque` from measured forces. A column's unit is N over its
    `BASE_PARAMETER_UNITS`.

    Over random states Y has full column rank, in gravity of random directions as well as in that of a level hip, which
    leaves no column zero: no parameter is a sum of others. In gravity along the hip's x alone the four columns of
    moments about x, ``moment_alpha_y`` to ``moment_alpha3_z``, are zero, and without gravity all ten that are no rod's.
    Only a leg with b² + e² = a² has a parameter fewer: strut 2 turns half as fast as strut 1 then, beta2' = beta' / 2,
    and ``inertia_1`` and ``inertia_2`` / 4 are felt as one.
    """
    pose = _pose(leg, q)
    chains = _chains(leg, pose, v, a)
    columns = []
    for parameters, drives in composite.single_base_parameters():
        force = _composite_force(leg, parameters, pose, chains, gravity, ZERO)
        columns.append(add(force, tuple(mass * a_i for mass, a_i in zip(drives, a, strict=True))))
    return transpose(tuple(columns))


class _Chains(NamedTuple):
    """Struts 1 and 2 share a proximal angle; sine and cosine of it, and of strut 3's."""

    sa: Scalar
    ca: Scalar
    sa3: Scalar
    ca3: Scalar
    chains: tuple[Chain, Chain, Chain]


def _chains(leg: HexapodLeg, pose: _Pose, v: Vector, a: Vector) -> _Chains:
    rates = _rates(leg, pose, v)
    second = _accelerations(leg, pose, rates, v, a)
    side = leg.side
    alpha, alpha_bias = side * rates.alpha, side * second.alpha
    first = Chain(pose.sb, pose.cb, pose.l1, (alpha, rates.beta, v[0]), (alpha_bias, second.beta, a[0]))
    other = Chain(pose.sb2, pose.cb2, pose.l2, (alpha, rates.beta2, v[1]), (alpha_bias, second.beta2, a[1]))
    third = Chain(
        pose.sb3,
        pose.cb3,
        pose.l3,
        (side * rates.alpha3, rates.beta3, v[2]),
        (side * second.alpha3, second.beta3, a[2]),
    )
    return _Chains(side * pose.sa, pose.ca, side * pose.sa3, pose.ca3, (first, other, third))


def _foot_pull(leg: HexapodLeg, pose: _Pose, force: Vector) -> Vector:
    """Work of a foot force for a unit of alpha, beta and l1."""
    foot = _foot(leg, pose)
    return pose.l1 * dot(force, foot.w_a), pose.l1 * dot(force, foot.w_b), dot(force, foot.w)


def composite_inverse_dynamics(
    leg: HexapodLeg,
    parameters: CompositeParameters,
    q: Vector,
    v: Vector,
    a: Vector,
    gravity: Vector,
    force: Vector = ZERO,
) -> Vector:
    """Forces of the struts, N: `inverse_dynamics` strut by strut, and with a force `foot_force_torque`.

    Parameters
    ----------
    leg : HexapodLeg
        Its bodies are not used.
    parameters : CompositeParameters
        Those of this leg, see `composite_parameters`; forces without dissipation are linear in them.
    q, v, a : tuples of 3 scalars
        Lengths (m), rates (m/s) and accelerations (m/s²) of the struts.
    gravity : tuple of 3 scalars
        Acceleration of gravity in the hip frame, m/s².
    force : tuple of 3 scalars
        Force that the environment applies to the foot, N.
    """
    pose = _pose(leg, q)
    work = _composite_force(leg, parameters, pose, _chains(leg, pose, v, a), gravity, _foot_pull(leg, pose, force))
    drives = tuple(mass * a_i for mass, a_i in zip(leg.drive_mass, a, strict=True))
    return total((work, drives, dissipation_torque(leg, q, v)))


def _composite_force(
    leg: HexapodLeg, parameters: CompositeParameters, pose: _Pose, chains: _Chains, gravity: Vector, pulls: Vector
) -> Vector:
    """Forces of the struts without drives and losses, linear in the parameters where the foot is not pulled."""
    sa, ca, sa3, ca3, (one, two, three) = chains
    down = composite.turned_about_x(sa, ca, gravity)
    down_3 = composite.turned_about_x(sa3, ca3, gravity)
    alpha_1, beta_1, thrust_1 = composite.strut_force(parameters.struts[0], one, down)
    alpha_2, beta_2, thrust_2 = composite.strut_force(parameters.struts[1], two, down)
    alpha_3, beta_3, thrust_3 = composite.strut_force(parameters.struts[2], three, down_3)
    pull_alpha, pull_beta, pull = pulls
    alpha = alpha_1 + alpha_2 + composite.cross_force(parameters.first_crosses, one.accelerations[0], down) - pull_alpha
    alpha_3 = alpha_3 + composite.cross_force(parameters.third_cross, three.accelerations[0], down_3)
    turns = (leg.side * alpha, beta_1 - pull_beta, beta_2, leg.side * alpha_3, beta_3)
    return _work(leg, pose, turns, (thrust_1 - pull, thrust_2, thrust_3))


def composite_bias(leg: HexapodLeg, parameters: CompositeParameters, q: Vector, v: Vector, gravity: Vector) -> Vector:
    """`bias` strut by strut, N."""
    return composite_inverse_dynamics(leg, parameters, q, v, ZERO, gravity)


def composite_mass_matrix(leg: HexapodLeg, parameters: CompositeParameters, q: Vector) -> Matrix:
    """`mass_matrix` strut by strut, kg."""
    pose = _pose(leg, q)
    first = _coefficients(leg, pose)
    alpha, alpha_3 = scale(leg.side, first.alpha), scale(leg.side, first.alpha3)
    angles = (
        (alpha, first.beta, pose.sb, pose.cb, pose.l1),
        (alpha, first.beta2, pose.sb2, pose.cb2, pose.l2),
        (alpha_3, first.beta3, pose.sb3, pose.cb3, pose.l3),
    )
    upper: dict[tuple[int, int], Scalar] = {(i, j): 0.0 for i in range(3) for j in range(i, 3)}
    for i, (proximal, distal, sb, cb, length) in enumerate(angles):
        (aa, ab, al), (_, bb, bl), (_, _, ll) = composite.strut_inertia(parameters.struts[i], sb, cb, length)
        if i != 1:  # crosses 1 and 2 turn as one
            aa = aa + (parameters.first_crosses if i == 0 else parameters.third_cross).inertia
        slide = IDENTITY[i]
        momentum_a = total((scale(aa, proximal), scale(ab, distal), scale(al, slide)))
        momentum_b = total((scale(ab, proximal), scale(bb, distal), scale(bl, slide)))
        momentum_l = total((scale(al, proximal), scale(bl, distal), scale(ll, slide)))
        for (j, k), value in upper.items():
            upper[j, k] = value + proximal[j] * momentum_a[k] + distal[j] * momentum_b[k] + slide[j] * momentum_l[k]
    symmetric = tuple(tuple(upper[min(i, j), max(i, j)] for j in range(3)) for i in range(3))
    return _with_drives(leg, symmetric)


def composite_gravity_torque(leg: HexapodLeg, parameters: CompositeParameters, q: Vector, gravity: Vector) -> Vector:
    """`gravity_torque` strut by strut, N."""
    pose = _pose(leg, q)
    down = composite.turned_about_x(leg.side * pose.sa, pose.ca, gravity)
    down_3 = composite.turned_about_x(leg.side * pose.sa3, pose.ca3, gravity)
    struts = parameters.struts
    alpha_1, beta_1, thrust_1 = composite.strut_gravity(struts[0], pose.sb, pose.cb, pose.l1, down)
    alpha_2, beta_2, thrust_2 = composite.strut_gravity(struts[1], pose.sb2, pose.cb2, pose.l2, down)
    alpha_3, beta_3, thrust_3 = composite.strut_gravity(struts[2], pose.sb3, pose.cb3, pose.l3, down_3)
    alpha = alpha_1 + alpha_2 + composite.cross_force(parameters.first_crosses, 0.0, down)
    alpha_3 = alpha_3 + composite.cross_force(parameters.third_cross, 0.0, down_3)
    turns = (leg.side * alpha, beta_1, beta_2, leg.side * alpha_3, beta_3)
    return _work(leg, pose, turns, (thrust_1, thrust_2, thrust_3))


def composite_potential_energy(leg: HexapodLeg, parameters: CompositeParameters, q: Vector, gravity: Vector) -> Scalar:
    """`potential_energy` strut by strut, J."""
    pose = _pose(leg, q)
    down = composite.turned_about_x(leg.side * pose.sa, pose.ca, gravity)
    down_3 = composite.turned_about_x(leg.side * pose.sa3, pose.ca3, gravity)
    struts = parameters.struts
    energy = -dot(parameters.fixed, gravity)
    for crosses, own in ((parameters.first_crosses, down), (parameters.third_cross, down_3)):
        energy = energy - crosses.moment_y * own[1] - crosses.moment_z * own[2]
    energy = energy + composite.strut_potential(struts[0], pose.sb, pose.cb, pose.l1, down)
    energy = energy + composite.strut_potential(struts[1], pose.sb2, pose.cb2, pose.l2, down)
    return energy + composite.strut_potential(struts[2], pose.sb3, pose.cb3, pose.l3, down_3)


def composite_forward_dynamics(
    leg: HexapodLeg,
    parameters: CompositeParameters,
    q: Vector,
    v: Vector,
    torque: Vector,
    gravity: Vector,
    force: Vector = ZERO,
) -> Vector:
    """Accelerations of the struts (m/s²): `forward_dynamics` strut by strut, with a force (N) on the foot."""
    missing = subtract(torque, composite_inverse_dynamics(leg, parameters, q, v, ZERO, gravity, force))
    return solve_symmetric(composite_mass_matrix(leg, parameters, q), missing)


# Foot force. It is the one that the ENVIRONMENT applies to the FOOT: force of the struts = M a + h - J^T F.


def foot_force_torque(leg: HexapodLeg, q: Vector, force: Vector) -> Vector:
    """Part of the struts' forces that a force on the foot (N) causes, -J^T F, N."""
    return negate(matvec(transpose(foot_jacobian(leg, q)), force))


def foot_force(
    leg: HexapodLeg, q: Vector, v: Vector, a: Vector, torque: Vector, gravity: Vector
) -> tuple[Vector, Scalar]:
    """Force that the environment applies to the foot (N) while forces `torque` (N) drive the motion, and det J.

    F = J^-T (M a + h - torque). There is none where det J vanishes, with strut 1 along x: look at the second result.
    """
    jacobian = foot_jacobian(leg, q)
    missing = subtract(inverse_dynamics(leg, q, v, a, gravity), torque)
    return solve(transpose(jacobian), missing), determinant(jacobian)


def from_urdf(description: Description, *, tolerance: float = 1e-9) -> HexapodLeg:
    """Take the leg's geometry and inertia from a URDF+ description, exactly, and check every assumption made here.

    Link frames may be turned in any way, as long as links and joints have the shipped file's names, each joint's
    origin is its centre, and a strut of coordinate zero ends in its U joint: poses come from yourdfpy's forward
    kinematics, and links fixed to a body are merged into it.

    Parameters
    ----------
    description : Description
        A validated description; yourdfpy reads its text, loops, couplings and transmissions are its own.
    tolerance : float
        Greatest deviation from an assumption, m or rad.

    Returns
    -------
    HexapodLeg
        In the paper's assembly mode; `dataclasses.replace` chooses another one.

    Raises
    ------
    FormulaAssumptionError
        With `element`, `found`, `expected` and `tolerance`, where the file is not the mechanism of the formulas.
    """
    from leg_dynamics.closed_form import _hexapod_leg_file

    return _hexapod_leg_file.read(description, tolerance)
