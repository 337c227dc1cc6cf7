"""Hexapod leg: the dynamics strut by strut instead of body by body.

Each strut is a serial U-P chain whose first axis stands still, so that its mass matrix depends on its own distal angle
beta and length l alone: with cross and sleeve about the U joint and the rod about its end, its kinetic energy is

    (A alpha'² + 2 B alpha' beta' + C beta'² + 2 D alpha' l' + 2 E beta' l' + F l'²) / 2

and Lagrange's equations of a strut are a dozen products; many of their velocity terms cancel. The leg's coordinates
enter only through the rates of the chain's. Equal to the sum over the nine bodies for arbitrary masses, centres of mass
and tensors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from leg_dynamics.closed_form.algebra import (
    ZERO,
    Matrix,
    Scalar,
    Vector,
    add,
    dot,
    scale,
)
from leg_dynamics.closed_form.rigid_body import Body

__all__ = [
    "Chain",
    "CompositeParameters",
    "CrossParameters",
    "StrutParameters",
    "composite_parameters",
    "cross_force",
    "strut_force",
    "strut_gravity",
    "strut_inertia",
    "strut_moment",
    "strut_potential",
    "turned_about_x",
]


class CrossParameters(NamedTuple):
    """What the dynamics sees of crosses that turn about one proximal axis x."""

    inertia: Scalar
    """About that axis, kg·m²."""
    moment_y: Scalar
    """First moment of mass in the cross's frame, kg·m."""
    moment_z: Scalar


class StrutParameters(NamedTuple):
    """A sleeve and its rod together: the sleeve about the U joint, the rod about its end, where the strut ends."""

    tensor: tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]
    """xx, yy, zz, xy, xz, yz of the tensor (products with their minus sign) at length zero, kg·m²."""
    moment: Vector
    """First moment of both at length zero, kg·m."""
    rod_moment: Vector
    """The rod's share of it, kg·m."""
    rod_mass: Scalar
    """kg"""


class CompositeParameters(NamedTuple):
    """Reduced inertia of a leg; forces without dissipation are linear in it."""

    first_crosses: CrossParameters
    """Crosses 1 and 2, which turn as one: alpha2 = alpha1."""
    third_cross: CrossParameters
    struts: tuple[StrutParameters, StrutParameters, StrutParameters]
    fixed: Vector
    """First moment of what never moves, kg·m: of no effect but on the potential energy's constant."""


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


def _cross_parameters(crosses: Sequence[Body]) -> CrossParameters:
    inertia: Scalar = 0.0
    moment: Vector = ZERO
    for body in crosses:
        inertia = inertia + _tensor_about_origin(body)[0][0]
        moment = add(moment, scale(body.mass, body.com))
    return CrossParameters(inertia, moment[1], moment[2])


def _strut_parameters(sleeve: Body, rod: Body) -> StrutParameters:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = (
        add(first, second)
        for first, second in zip(_tensor_about_origin(sleeve), _tensor_about_origin(rod), strict=True)
    )
    rod_moment = scale(rod.mass, rod.com)
    moment = add(scale(sleeve.mass, sleeve.com), rod_moment)
    return StrutParameters((xx, yy, zz, xy, xz, yz), moment, rod_moment, rod.mass)


def composite_parameters(bodies: Sequence[Body], hips: Mapping[int, Vector]) -> CompositeParameters:
    """Reduce nine bodies.

    Parameters
    ----------
    bodies : sequence of Body
        cross_1, sleeve_1, rod_1, ..., rod_3; frames of cross and sleeve at the U joint, of the rod at its end.
    hips : mapping of int to vector
        Centres A1, A2, A3 of the U joints, m.
    """
    by_name = {body.name: body for body in bodies}
    fixed: Vector = ZERO
    for i, place in hips.items():
        for kind in ("cross", "sleeve", "rod"):
            fixed = add(fixed, scale(by_name[f"{kind}_{i}"].mass, place))
        body = by_name[f"cross_{i}"]
        fixed = add(fixed, (body.mass * body.com[0], 0.0, 0.0))
    first, second, third = (_strut_parameters(by_name[f"sleeve_{i}"], by_name[f"rod_{i}"]) for i in (1, 2, 3))
    return CompositeParameters(
        first_crosses=_cross_parameters((by_name["cross_1"], by_name["cross_2"])),
        third_cross=_cross_parameters((by_name["cross_3"],)),
        struts=(first, second, third),
        fixed=fixed,
    )


class Chain(NamedTuple):
    """A strut's distal angle through sine and cosine, its length (m), and rates of (alpha, beta, length)."""

    sine: Scalar
    cosine: Scalar
    length: Scalar
    rates: Vector
    accelerations: Vector


def turned_about_x(sine: Scalar, cosine: Scalar, vector: Vector) -> Vector:
    """A vector of the hip in the frame of a cross that has turned about x."""
    x, y, z = vector
    return x, cosine * y + sine * z, cosine * z - sine * y


def cross_force(parameters: CrossParameters, acceleration: Scalar, gravity: Vector) -> Scalar:
    """Generalised force of crosses at their angle alpha, N·m; gravity in their frame."""
    _, gy, gz = gravity
    return parameters.inertia * acceleration - (parameters.moment_y * gz - parameters.moment_z * gy)


class _Inertia(NamedTuple):
    """Elements of a strut's mass matrix, and their derivatives where they have one of their own."""

    aa: Scalar
    ab: Scalar
    bb: Scalar
    al: Scalar
    bl: Scalar
    ll: Scalar
    depth: Scalar
    """Half the derivative of bb by the length, kg·m."""


def _inertia(parameters: StrutParameters, sb: Scalar, cb: Scalar, length: Scalar) -> _Inertia:
    xx, yy, zz, xy, xz, yz = parameters.tensor
    x, y, z = parameters.rod_moment
    mass = parameters.rod_mass
    growth = length * (2.0 * z + mass * length)
    return _Inertia(
        aa=cb * cb * (xx + growth) + sb * sb * zz + 2.0 * (sb * cb) * (xz - length * x),
        ab=cb * xy + sb * (yz - length * y),
        bb=yy + growth,
        al=cb * y,
        bl=-x,
        ll=mass,
        depth=z + mass * length,
    )


def _aa_by_beta(parameters: StrutParameters, sb: Scalar, cb: Scalar, length: Scalar) -> Scalar:
    """Half the derivative of aa by beta, kg·m²."""
    xx, _, zz, _, xz, _ = parameters.tensor
    x, _, z = parameters.rod_moment
    growth = length * (2.0 * z + parameters.rod_mass * length)
    return sb * cb * (zz - xx - growth) + (cb * cb - sb * sb) * (xz - length * x)


def strut_moment(parameters: StrutParameters, length: Scalar) -> Vector:
    """First moment of sleeve and rod about the U joint in the sleeve's frame, kg·m."""
    x, y, z = parameters.moment
    return x, y, z + parameters.rod_mass * length


def strut_force(parameters: StrutParameters, chain: Chain, gravity: Vector) -> Vector:
    """Generalised forces of sleeve and rod at (alpha, beta, length), N·m, N·m, N.

    Parameters
    ----------
    parameters : StrutParameters
    chain : Chain
    gravity : tuple of 3 scalars
        Acceleration of gravity in the cross's frame, m/s².
    """
    sb, cb, length, (va, vb, vl), (alpha, beta, slide) = chain
    m = _inertia(parameters, sb, cb, length)
    _, y, _ = parameters.rod_moment
    by_beta = _aa_by_beta(parameters, sb, cb, length)
    by_length = cb * (cb * m.depth + sb * m.bl)  # half the derivative of aa
    ab_by_beta = cb * (parameters.tensor[5] - length * y) - sb * parameters.tensor[3]
    held_alpha, held_beta, held = strut_gravity(parameters, sb, cb, length, gravity)
    return (
        m.aa * alpha
        + m.ab * beta
        + m.al * slide
        + 2.0 * va * (by_beta * vb + by_length * vl)
        + vb * (ab_by_beta * vb - 2.0 * sb * y * vl)
        + held_alpha,
        m.ab * alpha + m.bb * beta + m.bl * slide + 2.0 * m.depth * vl * vb - by_beta * va * va + held_beta,
        m.al * alpha + m.bl * beta + m.ll * slide - by_length * va * va - m.depth * vb * vb + held,
    )


def strut_inertia(parameters: StrutParameters, sb: Scalar, cb: Scalar, length: Scalar) -> Matrix:
    """Mass matrix of sleeve and rod at (alpha, beta, length); sine and cosine are those of beta."""
    m = _inertia(parameters, sb, cb, length)
    return (m.aa, m.ab, m.al), (m.ab, m.bb, m.bl), (m.al, m.bl, m.ll)


def strut_potential(parameters: StrutParameters, sb: Scalar, cb: Scalar, length: Scalar, gravity: Vector) -> Scalar:
    """Potential energy of sleeve and rod, J, zero for masses in the U joint; gravity in the cross's frame."""
    gx, gy, gz = gravity
    return -dot(strut_moment(parameters, length), (cb * gx - sb * gz, gy, sb * gx + cb * gz))


def strut_gravity(parameters: StrutParameters, sb: Scalar, cb: Scalar, length: Scalar, gravity: Vector) -> Vector:
    """The part of `strut_force` that gravity alone causes."""
    gx, gy, gz = gravity
    x, y, z = strut_moment(parameters, length)
    along, across = sb * gx + cb * gz, cb * gx - sb * gz
    return (cb * z - sb * x) * gy - y * gz, x * along - z * across, -(parameters.rod_mass * along)
