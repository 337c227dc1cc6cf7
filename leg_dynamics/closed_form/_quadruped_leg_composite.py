"""Quadruped leg: Lagrange's equations in base parameters.

The leg's plane turns with theta1 about z; links 2 and 3 turn in it by phi2 = theta2 and phi3 = theta2 + theta3. With
S = sin(phi), C = cos(phi), each link's tensor about its own joint and its first moment there, where link 2 carries
link 3's mass as a point on the knee axis and link 1 both masses as a point on the pitch axis, the mass matrix is

    M11 = inertia_1 + sum over links 2, 3 of [difference S² + 2 product_xy S C + 2 r (C moment_x - S moment_y)]
    M12 = M13 + product_2_xz S2 + product_2_yz C2             M13 = product_3_xz S3 + product_3_yz C3
    M22 = inertia_2 + inertia_3 + 2 k        M23 = inertia_3 + k        M33 = inertia_3 + drive_3

where r is the distance of the link's joint from the hip axis (l1, l1 + l2 C2) and
k = l2 (cos(theta3) moment_3_x - sin(theta3) moment_3_y). In Lagrange's equations most products of M12 and M13 cancel.
Equal to the sum over the three bodies for arbitrary masses, centres of mass and tensors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from leg_dynamics.closed_form.algebra import Matrix, Scalar, Vector, add, cos, scale, sin, transpose
from leg_dynamics.closed_form.rigid_body import Body

if TYPE_CHECKING:
    from leg_dynamics.closed_form.quadruped_leg import QuadrupedLeg

__all__ = [
    "BASE_PARAMETER_NAMES",
    "BASE_PARAMETER_UNITS",
    "CompositeParameters",
    "Plane",
    "composite_parameters",
    "foot_pull",
    "gravity_torque",
    "inertia_torque",
    "mass_matrix",
    "plane_of",
    "potential_energy",
    "regressor",
]


class CompositeParameters(NamedTuple):
    """What the dynamics sees of three bodies and the drives; torques without losses are linear in it.

    Axes of links 2 and 3: x along the link, y up in the leg's plane, z along the joint's axis. Products of inertia
    carry their minus sign.
    """

    inertia_1: Scalar
    """About the hip axis, of everything while links 2 and 3 lie level, without their moments; drive 1 included."""
    moment_1_x: Scalar
    """First moment of link 1 with both other masses on the pitch axis, outwards."""
    moment_1_y: Scalar
    """First moment of all three links across the leg's plane, along the hip's y at theta1 = 0."""
    difference_2: Scalar
    """Ixx - Iyy."""
    product_2_xy: Scalar
    product_2_xz: Scalar
    """Of link 2, and of link 3's first moment across the plane at distance l2."""
    product_2_yz: Scalar
    inertia_2: Scalar
    """Izz about the pitch axis, drive 2 included."""
    moment_2_x: Scalar
    moment_2_y: Scalar
    difference_3: Scalar
    product_3_xy: Scalar
    product_3_xz: Scalar
    product_3_yz: Scalar
    inertia_3: Scalar
    """Izz about the knee axis."""
    moment_3_x: Scalar
    moment_3_y: Scalar
    drive_3: Scalar
    """Inertia of the knee's drive, which does not turn with theta2."""
    fixed_z: Scalar
    """First moment of link 1 along the hip axis: of no effect but on the potential energy's constant."""


BASE_PARAMETER_NAMES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"exact": tuple(name for name in CompositeParameters._fields if name != "fixed_z")}
)
"""Names of the base parameters: the minimal set on which torques depend, linearly."""

BASE_PARAMETER_UNITS: Mapping[str, str] = MappingProxyType(
    {name: "kg·m" if name.startswith(("moment", "fixed")) else "kg·m²" for name in CompositeParameters._fields}
)
"""Unit of each composite parameter."""


def _tensor_about_origin(body: Body) -> Matrix:
    """Tensor of a body about its frame's origin."""
    x, y, z = body.com
    m = body.mass
    shift = (
        (m * (y * y + z * z), -(m * x * y), -(m * x * z)),
        (-(m * x * y), m * (x * x + z * z), -(m * y * z)),
        (-(m * x * z), -(m * y * z), m * (x * x + y * y)),
    )
    return tuple(add(row, moved) for row, moved in zip(body.inertia, shift, strict=True))


def composite_parameters(l1: Scalar, l2: Scalar, bodies: Sequence[Body], drives: Vector) -> CompositeParameters:
    """Reduce three bodies and the drives.

    Parameters
    ----------
    l1, l2 : scalar
        Lengths, m.
    bodies : sequence of 3 Body
        Each in the frame that `leg_dynamics.closed_form.quadruped_leg.QuadrupedLeg` says.
    drives : tuple of 3 scalars
        Inertia of the drives felt at the joints, kg·m².
    """
    first, second, third = bodies
    x1, y1, z1 = scale(first.mass, first.com)
    x2, y2, z2 = scale(second.mass, second.com)
    x3, y3, z3 = scale(third.mass, third.com)
    (xx2, xy2, xz2), (_, yy2, yz2), (_, _, zz2) = _tensor_about_origin(second)
    (xx3, xy3, xz3), (_, yy3, yz3), (_, _, zz3) = _tensor_about_origin(third)
    carried = second.mass + third.mass
    knee = third.mass * l2
    return CompositeParameters(
        inertia_1=_tensor_about_origin(first)[2][2] + carried * l1 * l1 + yy2 + knee * l2 + yy3 + drives[0],
        moment_1_x=x1 + carried * l1,
        moment_1_y=y1 - z2 - z3,
        difference_2=xx2 - yy2 - knee * l2,
        product_2_xy=xy2,
        product_2_xz=xz2 - l2 * z3,
        product_2_yz=yz2,
        inertia_2=zz2 + knee * l2 + drives[1],
        moment_2_x=x2 + knee,
        moment_2_y=y2,
        difference_3=xx3 - yy3,
        product_3_xy=xy3,
        product_3_xz=xz3,
        product_3_yz=yz3,
        inertia_3=zz3,
        moment_3_x=x3,
        moment_3_y=y3,
        drive_3=drives[2],
        fixed_z=z1,
    )


class Plane(NamedTuple):
    """Sines and cosines of a pose: theta1, theta2, theta3 and theta2 + theta3."""

    s1: Scalar
    c1: Scalar
    s2: Scalar
    c2: Scalar
    s3: Scalar
    c3: Scalar
    s23: Scalar
    c23: Scalar


def plane_of(q: Vector) -> Plane:
    """c_ij and s_ij as below (3), from the sines and cosines of the joint angles."""
    s1, c1, s2, c2, s3, c3 = sin(q[0]), cos(q[0]), sin(q[1]), cos(q[1]), sin(q[2]), cos(q[2])
    return Plane(s1, c1, s2, c2, s3, c3, s2 * c3 + c2 * s3, c2 * c3 - s2 * s3)


class _Moments(NamedTuple):
    """First moments of links 2 and 3 outwards and upwards, kg·m."""

    out_2: Scalar
    up_2: Scalar
    out_3: Scalar
    up_3: Scalar


def _moments(pi: CompositeParameters, at: Plane) -> _Moments:
    return _Moments(
        out_2=at.c2 * pi.moment_2_x - at.s2 * pi.moment_2_y,
        up_2=at.s2 * pi.moment_2_x + at.c2 * pi.moment_2_y,
        out_3=at.c23 * pi.moment_3_x - at.s23 * pi.moment_3_y,
        up_3=at.s23 * pi.moment_3_x + at.c23 * pi.moment_3_y,
    )


def _matrix(leg: QuadrupedLeg, pi: CompositeParameters, at: Plane, of: _Moments) -> Matrix:
    knee = leg.l2 * (at.c3 * pi.moment_3_x - at.s3 * pi.moment_3_y)
    m11 = (
        pi.inertia_1
        + at.s2 * (pi.difference_2 * at.s2 + 2.0 * pi.product_2_xy * at.c2)
        + at.s23 * (pi.difference_3 * at.s23 + 2.0 * pi.product_3_xy * at.c23)
        + 2.0 * (leg.l1 * of.out_2 + (leg.l1 + leg.l2 * at.c2) * of.out_3)
    )
    m13 = pi.product_3_xz * at.s23 + pi.product_3_yz * at.c23
    m12 = m13 + pi.product_2_xz * at.s2 + pi.product_2_yz * at.c2
    m23 = pi.inertia_3 + knee
    return (m11, m12, m13), (m12, pi.inertia_2 + m23 + knee, m23), (m13, m23, pi.inertia_3 + pi.drive_3)


def mass_matrix(leg: QuadrupedLeg, parameters: CompositeParameters, q: Vector) -> Matrix:
    """Mass matrix with the drives, kg·m²."""
    at = plane_of(q)
    return _matrix(leg, parameters, at, _moments(parameters, at))


def _gravity(pi: CompositeParameters, at: Plane, of: _Moments, gravity: Vector) -> Vector:
    gx, gy, gz = gravity
    out, across = at.c1 * gx + at.s1 * gy, at.c1 * gy - at.s1 * gx
    third = of.up_3 * out - of.out_3 * gz
    return (
        pi.moment_1_y * out - (pi.moment_1_x + of.out_2 + of.out_3) * across,
        of.up_2 * out - of.out_2 * gz + third,
        third,
    )


def gravity_torque(parameters: CompositeParameters, q: Vector, gravity: Vector) -> Vector:
    """Torque that holds the leg still against gravity, N·m."""
    at = plane_of(q)
    return _gravity(parameters, at, _moments(parameters, at), gravity)


def potential_energy(parameters: CompositeParameters, q: Vector, gravity: Vector) -> Scalar:
    """Potential energy, J, zero for masses at the hip's origin."""
    at = plane_of(q)
    of = _moments(parameters, at)
    gx, gy, gz = gravity
    out, across = at.c1 * gx + at.s1 * gy, at.c1 * gy - at.s1 * gx
    return -(
        (parameters.moment_1_x + of.out_2 + of.out_3) * out
        + parameters.moment_1_y * across
        + (parameters.fixed_z + of.up_2 + of.up_3) * gz
    )


def inertia_torque(
    leg: QuadrupedLeg, parameters: CompositeParameters, at: Plane, v: Vector, a: Vector, gravity: Vector
) -> Vector:
    """Torque of inertia and gravity, N·m, linear in the parameters."""
    pi, of = parameters, _moments(parameters, at)
    (m11, m12, m13), (_, m22, m23), (_, _, m33) = _matrix(leg, pi, at, of)
    v1, v2, v3 = v
    a1, a2, a3 = a
    v23 = v2 + v3
    reach = leg.l1 + leg.l2 * at.c2
    # Half the derivatives of M11 by theta3 and theta2, those of M12 by phi2 and phi3, and that of k by theta3.
    by_3 = pi.difference_3 * at.s23 * at.c23 + pi.product_3_xy * (at.c23 * at.c23 - at.s23 * at.s23) - reach * of.up_3
    by_2 = (
        by_3
        + pi.difference_2 * at.s2 * at.c2
        + pi.product_2_xy * (at.c2 * at.c2 - at.s2 * at.s2)
        - leg.l1 * of.up_2
        - leg.l2 * at.s2 * of.out_3
    )
    turn_2 = pi.product_2_xz * at.c2 - pi.product_2_yz * at.s2
    turn_3 = pi.product_3_xz * at.c23 - pi.product_3_yz * at.s23
    fold = -(leg.l2 * (at.s3 * pi.moment_3_x + at.c3 * pi.moment_3_y))
    held_1, held_2, held_3 = _gravity(pi, at, of, gravity)
    return (
        m11 * a1
        + m12 * a2
        + m13 * a3
        + 2.0 * v1 * (by_2 * v2 + by_3 * v3)
        + turn_2 * v2 * v2
        + turn_3 * v23 * v23
        + held_1,
        m12 * a1 + m22 * a2 + m23 * a3 - by_2 * v1 * v1 + fold * v3 * (v2 + v23) + held_2,
        m13 * a1 + m23 * a2 + m33 * a3 - by_3 * v1 * v1 - fold * v2 * v2 + held_3,
    )


def foot_pull(leg: QuadrupedLeg, at: Plane, force: Vector) -> Vector:
    """J^T F, N·m: work of a force on the foot (N) for a unit of each joint angle."""
    fx, fy, fz = force
    out, across = at.c1 * fx + at.s1 * fy, at.c1 * fy - at.s1 * fx
    shank = leg.l3 * (at.c23 * fz - at.s23 * out)
    radius = leg.l1 + leg.l2 * at.c2 + leg.l3 * at.c23
    return radius * across, leg.l2 * (at.c2 * fz - at.s2 * out) + shank, shank


def regressor(leg: QuadrupedLeg, q: Vector, v: Vector, a: Vector, gravity: Vector) -> Matrix:
    """Matrix Y (3 x 18) with inverse dynamics = Y pi, pi in the order of `BASE_PARAMETER_NAMES`.

    Each column is the torque of a leg whose only parameter is one: the same code, on the same motion.
    """
    at = plane_of(q)
    nothing = CompositeParameters(*(0.0 for _ in CompositeParameters._fields))
    names = BASE_PARAMETER_NAMES["exact"]
    return transpose(tuple(inertia_torque(leg, nothing._replace(**{name: 1.0}), at, v, a, gravity) for name in names))
