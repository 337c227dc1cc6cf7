"""Hexapod leg: the dynamics strut by strut instead of body by body.

Each strut is a serial U-P chain whose first axis stands still, so that its mass matrix depends on its own distal angle
beta and length l alone: with cross and sleeve about the U joint and the rod about its end, its kinetic energy is

    (A alpha'² + 2 B alpha' beta' + C beta'² + 2 D alpha' l' + 2 E beta' l' + F l'²) / 2

and Lagrange's equations of a strut are a dozen products; many of their velocity terms cancel. The leg's coordinates
enter only through the rates of the chain's. Equal to the sum over the nine bodies for arbitrary masses, centres of mass
and tensors.

Of the 45 numbers of `CompositeParameters` and the three drive masses, nine do nothing that others cannot do, see
`base_parameters`; 39 remain. Per strut, with S = sin(beta) and C = cos(beta),

1. S² zz = zz - C² zz, and alpha2 = alpha1: zz counts with the crosses of its own axis, and C² sees xx - zz alone. A
   first moment along y, the axis that crosses and strut share, counts with the crosses too.
2. Strut 2 ends in the hinge B2 of sleeve 1, at (b, 0, e) in its frame, so that with k2 and h2 of `hexapod_leg`

       l2 (sin(beta2), cos(beta2)) = (k2 - a, h2),           (k2, h2)' = beta' (h2, -k2)

   and what lies on the hinge's axis may be fixed to sleeve 1. The mass of rod 2 becomes a point mass in B2, which adds
   e², b² + e², b² and -b e times it to xx, yy, zz and xz, and (b, 0, e) times it to the first moment. The first moment
   y of rod 2 has the kinetic energy y alpha' h2' = -y alpha' (e S + b C) beta', as -b y in xy and -e y in yz have.
3. Strut 3 ends in the ball B3 of rod 1, at (0, side c, 0) from its end: the mass of rod 3 becomes a point mass there,
   which adds to the mass of rod 1, side c of it to the first moment y, and c² to xx and zz.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
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
    "BASE_PARAMETER_NAMES",
    "BASE_PARAMETER_UNITS",
    "BaseParameters",
    "Chain",
    "CompositeParameters",
    "CrossParameters",
    "StrutParameters",
    "base_parameters",
    "composite_parameters",
    "cross_force",
    "single_base_parameters",
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


class BaseParameters(NamedTuple):
    """Base inertial parameters: the fewest numbers that forces without losses are linear in.

    K below is the term of the kinetic energy that a parameter multiplies, U that of the potential energy. alpha, beta
    and l are the strut's own; u and w are the axes x and z of its sleeve, y_i and z_i axes of its cross. J is the
    tensor of sleeve and rod about the U joint at length zero (J_xy ... with their minus sign), H their first moment
    there, h the rod's share of it, and m a mass.
    """

    inertia_alpha: Scalar
    """K = alpha1'^2 / 2: crosses 1 and 2 about x, J_zz of struts 1 and 2, b² m of rod 2, c² m of rod 3."""
    moment_alpha_y: Scalar
    """U = -g · y_1: that of crosses 1 and 2, H_y of struts 1 and 2, side c m of rod 3."""
    moment_alpha_z: Scalar
    """U = -g · z_1: that of crosses 1 and 2."""
    inertia_alpha3: Scalar
    """K = alpha3'^2 / 2: cross 3 about x, J_zz of strut 3."""
    moment_alpha3_y: Scalar
    """U = -g · y_3: that of cross 3, H_y of strut 3."""
    moment_alpha3_z: Scalar
    """U = -g · z_3: that of cross 3."""
    difference_1: Scalar
    """K = (alpha' cos(beta))^2 / 2: J_xx - J_zz of strut 1, (e² - b²) m of rod 2."""
    inertia_1: Scalar
    """K = beta'^2 / 2: J_yy of strut 1, (b² + e²) m of rod 2."""
    product_1_xy: Scalar
    """K = alpha' beta' cos(beta): J_xy of strut 1, -b h_y of rod 2."""
    product_1_xz: Scalar
    """K = alpha'^2 sin(beta) cos(beta): J_xz of strut 1, -b e m of rod 2."""
    product_1_yz: Scalar
    """K = alpha' beta' sin(beta): J_yz of strut 1, -e h_y of rod 2."""
    moment_1_x: Scalar
    """U = -g · u: H_x of strut 1, b m of rod 2."""
    moment_1_z: Scalar
    """U = -g · w: H_z of strut 1, e m of rod 2."""
    rod_moment_1_x: Scalar
    """K = -(alpha'^2 l sin(beta) cos(beta) + beta' l'): h_x of rod 1."""
    rod_moment_1_y: Scalar
    """K = alpha' (l cos(beta))': h_y of rod 1, side c m of rod 3."""
    rod_moment_1_z: Scalar
    """K = l ((alpha' cos(beta))^2 + beta'^2): h_z of rod 1."""
    rod_mass_1: Scalar
    """K = |(l w)'|^2 / 2, U = -g · w l: m of rods 1 and 3."""
    drive_mass_1: Scalar
    """K = l'^2 / 2: the drive."""
    difference_2: Scalar
    """As `difference_1`, of strut 2: J_xx - J_zz."""
    inertia_2: Scalar
    """As `inertia_1`, of strut 2: J_yy."""
    product_2_xy: Scalar
    product_2_xz: Scalar
    product_2_yz: Scalar
    moment_2_x: Scalar
    moment_2_z: Scalar
    rod_moment_2_x: Scalar
    rod_moment_2_z: Scalar
    drive_mass_2: Scalar
    difference_3: Scalar
    """As `difference_1`, of strut 3: J_xx - J_zz."""
    inertia_3: Scalar
    """As `inertia_1`, of strut 3: J_yy."""
    product_3_xy: Scalar
    product_3_xz: Scalar
    product_3_yz: Scalar
    moment_3_x: Scalar
    moment_3_z: Scalar
    rod_moment_3_x: Scalar
    rod_moment_3_y: Scalar
    rod_moment_3_z: Scalar
    drive_mass_3: Scalar


BASE_PARAMETER_NAMES: Mapping[str, tuple[str, ...]] = MappingProxyType({"exact": BaseParameters._fields})
"""Names of the base parameters: the minimal set on which forces depend, linearly."""


def _unit(name: str) -> str:
    if "moment" in name:
        return "kg·m"
    return "kg" if "mass" in name else "kg·m²"


BASE_PARAMETER_UNITS: Mapping[str, str] = MappingProxyType({name: _unit(name) for name in BaseParameters._fields})
"""Unit of each base parameter."""


def base_parameters(
    parameters: CompositeParameters, b: Scalar, c: Scalar, e: Scalar, drive_mass: Vector
) -> BaseParameters:
    """Regroup composite parameters, see the module, 1 to 3.

    Parameters
    ----------
    parameters : CompositeParameters
    b, e : scalar
        x and z of B2 in the frame of sleeve 1, m.
    c : scalar
        y of B3 in the frame of rod 1, m: negative on the left side.
    drive_mass : tuple of 3 scalars
        Inertia of the drives felt along the struts, kg.
    """
    crosses, cross_3 = parameters.first_crosses, parameters.third_cross
    one, two, three = parameters.struts
    xx1, yy1, zz1, xy1, xz1, yz1 = one.tensor
    xx2, yy2, zz2, xy2, xz2, yz2 = two.tensor
    xx3, yy3, zz3, xy3, xz3, yz3 = three.tensor
    mass_2, mass_3 = two.rod_mass, three.rod_mass
    side_2 = two.rod_moment[1]
    return BaseParameters(
        inertia_alpha=crosses.inertia + zz1 + zz2 + b * b * mass_2 + c * c * mass_3,
        moment_alpha_y=crosses.moment_y + one.moment[1] + two.moment[1] + c * mass_3,
        moment_alpha_z=crosses.moment_z,
        inertia_alpha3=cross_3.inertia + zz3,
        moment_alpha3_y=cross_3.moment_y + three.moment[1],
        moment_alpha3_z=cross_3.moment_z,
        difference_1=xx1 - zz1 + (e * e - b * b) * mass_2,
        inertia_1=yy1 + (b * b + e * e) * mass_2,
        product_1_xy=xy1 - b * side_2,
        product_1_xz=xz1 - b * e * mass_2,
        product_1_yz=yz1 - e * side_2,
        moment_1_x=one.moment[0] + b * mass_2,
        moment_1_z=one.moment[2] + e * mass_2,
        rod_moment_1_x=one.rod_moment[0],
        rod_moment_1_y=one.rod_moment[1] + c * mass_3,
        rod_moment_1_z=one.rod_moment[2],
        rod_mass_1=one.rod_mass + mass_3,
        drive_mass_1=drive_mass[0],
        difference_2=xx2 - zz2,
        inertia_2=yy2,
        product_2_xy=xy2,
        product_2_xz=xz2,
        product_2_yz=yz2,
        moment_2_x=two.moment[0],
        moment_2_z=two.moment[2],
        rod_moment_2_x=two.rod_moment[0],
        rod_moment_2_z=two.rod_moment[2],
        drive_mass_2=drive_mass[1],
        difference_3=xx3 - zz3,
        inertia_3=yy3,
        product_3_xy=xy3,
        product_3_xz=xz3,
        product_3_yz=yz3,
        moment_3_x=three.moment[0],
        moment_3_z=three.moment[2],
        rod_moment_3_x=three.rod_moment[0],
        rod_moment_3_y=three.rod_moment[1],
        rod_moment_3_z=three.rod_moment[2],
        drive_mass_3=drive_mass[2],
    )


def _representative(pi: BaseParameters) -> tuple[CompositeParameters, Vector]:
    """Composite parameters and drive masses with these base parameters, and zero where nothing but they would count."""
    return CompositeParameters(
        first_crosses=CrossParameters(pi.inertia_alpha, pi.moment_alpha_y, pi.moment_alpha_z),
        third_cross=CrossParameters(pi.inertia_alpha3, pi.moment_alpha3_y, pi.moment_alpha3_z),
        struts=(
            StrutParameters(
                (pi.difference_1, pi.inertia_1, 0.0, pi.product_1_xy, pi.product_1_xz, pi.product_1_yz),
                (pi.moment_1_x, 0.0, pi.moment_1_z),
                (pi.rod_moment_1_x, pi.rod_moment_1_y, pi.rod_moment_1_z),
                pi.rod_mass_1,
            ),
            StrutParameters(
                (pi.difference_2, pi.inertia_2, 0.0, pi.product_2_xy, pi.product_2_xz, pi.product_2_yz),
                (pi.moment_2_x, 0.0, pi.moment_2_z),
                (pi.rod_moment_2_x, 0.0, pi.rod_moment_2_z),
                0.0,
            ),
            StrutParameters(
                (pi.difference_3, pi.inertia_3, 0.0, pi.product_3_xy, pi.product_3_xz, pi.product_3_yz),
                (pi.moment_3_x, 0.0, pi.moment_3_z),
                (pi.rod_moment_3_x, pi.rod_moment_3_y, pi.rod_moment_3_z),
                0.0,
            ),
        ),
        fixed=ZERO,
    ), (pi.drive_mass_1, pi.drive_mass_2, pi.drive_mass_3)


def single_base_parameters() -> tuple[tuple[CompositeParameters, Vector], ...]:
    """Composite parameters and drive masses of the legs whose only base parameter is one, in the parameters' order."""
    nothing = BaseParameters(*(0.0 for _ in BaseParameters._fields))
    return tuple(_representative(nothing._replace(**{name: 1.0})) for name in BaseParameters._fields)


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
