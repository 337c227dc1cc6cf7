"""OmniLeg's equations (44)-(46) reduced to composite (base) inertial parameters.

A body enters the motion only through sums over the bodies that turn alike. With the right variables little remains of
the 25 bodies; `omnileg` keeps the equations body by body, and a test holds both against each other.

1. The thigh is one universal joint. With theta = theta12 of (12), r = R_y(beta) R_x(theta) Z0 is the direction of
   the rods and L1 r the knee. In the frame (x, y, r) of rod A1B1

       r'  = V x - theta' y,                           V = beta' cos(theta)
       r'' = X x - Y y - (theta'^2 + V^2) r,           X = beta'' cos(theta) - 2 theta' beta' sin(theta)
                                                       Y = theta'' + V beta' sin(theta)

   and branch 2, r · y_2 = 0 with y_2 = (0, cos(alpha), sin(alpha)), gives with j = sin(alpha) sin(beta) / sqrt(D)

       theta' = theta_alpha alpha' - j V,              theta_alpha = cos(beta) / D
       Y      = theta_alpha alpha'' - j X - 2 r_x alpha' (V - j theta')

   without any second derivative of (12). A force F that r needs (inertia less weight) is a torque -F · y about theta,
   and F · x times cos(theta) about beta; a torque about theta is theta_alpha of it about alpha and -j cos(theta) of it
   about beta.
2. A rod's tensor about its U joint weighs |r'|^2 (transverse), its spin about r, which is r_y beta' (of rod 2
   r_x alpha'), and with what is left beta'^2 (alpha'^2). The knee and all it carries add L1^2 m to the transverse
   part, and the crosses turn about fixed axes.
3. The Cardan shaft needs none of its angles, only the axis y_4 = (-sin(gamma), cos(gamma), 0) that the crosses A4 and
   B4 share with the input and output shaft. In the rod's frame it is (p, q, y_r), and cos^2(b) = p^2 + q^2 = 1 / w.
   With z = r_z and nu = p theta' + q V

       a' = w (nu + gamma' z y_r),                     spin about r: n = gamma' z + a' y_r

   The code has P = -p and u = -y_r = sin(b), which saves signs.

What remains of products of inertia and first moments beside these axes is added term by term: where such a parameter is
exactly zero, its terms vanish from a traced graph. There are two divisions, 1 / D and w.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leg_dynamics.closed_form.algebra import (
    IDENTITY,
    ZERO,
    Matrix,
    Scalar,
    Vector,
    add,
    cos,
    cross,
    dot,
    fabs,
    matvec,
    scale,
    sin,
    sqrt,
    subtract,
    transpose,
    where,
)

if TYPE_CHECKING:
    from leg_dynamics.closed_form.omnileg import Body, OmniLeg

__all__ = [
    "BASE_PARAMETER_NAMES",
    "BASE_PARAMETER_UNITS",
    "ROUNDING",
    "CompositeParameters",
    "composite_parameters",
    "forward_dynamics",
    "gravity_torque",
    "inverse_dynamics",
    "mass_matrix",
    "potential_energy",
    "regressor",
]

ROUNDING = 1e-14
"""A composite parameter this small against the sum of its summands' sizes is rounding, and set to exactly zero.

A summand's size is what it could be if its body were turned: |com| for a coordinate of it, the trace for an element of
the tensor, 1 for a direction cosine. The 25 summands of a parameter leave less than 1e-15 of that.
"""


class CompositeParameters(NamedTuple):
    """Composite inertial parameters; torques are linear in them.

    K below is the term of the kinetic energy that a parameter multiplies, U that of the potential energy. m, h = m com
    and J are a body's mass, first moment and tensor about its frame's origin (the centre of its joint); J_yz is an
    element of the tensor. The groups are: rods_1 = rods 1 and 3, rods_2 = rod 2; crosses_1 = crosses A1, A3, B1, B3,
    crosses_2 = A2, B2, crosses_4 = A4, B4; carried = all that hangs on the knee, itself included; uppers = driven gears
    and links C_i D_i, in the chain's frame; lowers = links D_i E_i. In the model ``paper`` crosses_1 contains
    crosses_4, and rods_1 contains the Cardan shaft; all terms of the Cardan shaft are zero then. In the model ``none``
    crosses_4 and the Cardan shaft have no tensor about their centres of mass.
    """

    inertia_alpha: Scalar
    """kg·m², K = alpha'^2 / 2: J_xx of crosses_2, J_xx - J_yy of rods_2, rotor M2."""
    inertia_beta: Scalar
    """kg·m², K = beta'^2 / 2: J_yy of crosses_1, J_yy - J_xx of rods_1, rotor M1."""
    inertia_gamma: Scalar
    """kg·m², K = gamma'^2 / 2: J_zz of both shafts, J_xx of uppers, lowers and crosses_4, rotor M3.

    Plus L4^2 m - 2 L4 h_z of lowers; in the model ``paper`` I_zz of crosses_4 and Cardan shaft instead of J_xx.
    """
    transverse: Scalar
    """kg·m², K = |r'|^2 / 2: J_xx of rods_1, J_yy of rods_2, J_xx of the Cardan shaft, L1^2 m of carried."""
    spin_1: Scalar
    """kg·m², K = (r_y beta')^2 / 2: J_xx + J_zz - J_yy of rods_1."""
    spin_2: Scalar
    """kg·m², K = (r_x alpha')^2 / 2: J_yy + J_zz - J_xx of rods_2."""
    rods_1_xy: Scalar
    """kg·m², K = J_xy of rods_1 times beta' theta' cos(theta)."""
    rods_1_xz: Scalar
    """kg·m², K = -beta' theta' sin(theta): J_xz of rods_1, -L1 h_x of the carried crosses_1."""
    rods_1_yz: Scalar
    """kg·m², K = J_yz of rods_1 times -beta'^2 sin(theta) cos(theta)."""
    crosses_1_carried: Scalar
    """kg·m², K = L1 h_z of the carried crosses_1 times beta'^2 cos(theta)."""
    rods_2_xy: Scalar
    """kg·m², K = J_xy of rods_2 times alpha' r_x'."""
    rods_2_xz: Scalar
    """kg·m², K = J_xz of rods_2 times alpha'^2 r_x W, W = cos(beta) / sqrt(D)."""
    rods_2_yz: Scalar
    """kg·m², K = -alpha' W': J_yz of rods_2, -L1 h_y of cross B2."""
    crosses_2_carried: Scalar
    """kg·m², K = L1 h_z of cross B2 times alpha'^2 W."""
    moment_r: Scalar
    """kg·m, U = -g · r: L1 m of carried, h_z of all rods and the Cardan shaft."""
    moment_1_x: Scalar
    """kg·m, U = -g · x: h_x of rods_1 and crosses_1, x = R_y(beta) X0."""
    moment_1_y: Scalar
    """kg·m, U = -g · y: h_y of rods_1, y = r x x."""
    moment_1_z: Scalar
    """kg·m, U = -g · R_y(beta) Z0: h_z of crosses_1."""
    moment_2_x: Scalar
    """kg·m, U = -g · x_2: h_x of rods_2, x_2 = y_2 x r."""
    moment_2_y: Scalar
    """kg·m, U = -g · y_2: h_y of rods_2 and crosses_2, y_2 = R_x(alpha) Y0."""
    moment_2_z: Scalar
    """kg·m, U = -g · R_x(alpha) Z0: h_z of crosses_2."""
    shank_cos_cos: Scalar
    """kg·m², K = (d/dt cos(gamma))^2 / 2: 4 L4^2 m of the foot, 4 L4 h_z of lowers."""
    shank_cos_sin: Scalar
    """kg·m², K = d/dt cos(gamma) · d/dt sin(gamma): -2 L4 h_y of lowers."""
    shank_cos_x: Scalar
    """kg·m: the shank's first moment is shank_cos cos(gamma) + shank_sin sin(gamma), and coupled to L1 r'.

    K = L1 r' · d/dt (first moment), U = -g · (first moment). It consists of h of output shaft, uppers and lowers, of
    h_y of cross B4, and of the weights of lowers and foot in their joints.
    """
    shank_cos_y: Scalar
    """kg·m, see `shank_cos_x`."""
    shank_cos_z: Scalar
    """kg·m, see `shank_cos_x`: h_z of uppers and lowers, L4 m of lowers, 2 L4 m of the foot."""
    shank_sin_x: Scalar
    """kg·m, see `shank_cos_x`."""
    shank_sin_y: Scalar
    """kg·m, see `shank_cos_x`."""
    shank_sin_z: Scalar
    """kg·m, see `shank_cos_x`: h_y of uppers minus h_y of lowers."""
    input_x: Scalar
    """kg·m, U = -g · R_z(gamma) X0: h_x of the input shaft."""
    input_y: Scalar
    """kg·m, U = -g · R_z(gamma) Y0: h_y of the input shaft and cross A4."""
    cardan_a: Scalar
    """kg·m², K = a'^2 / 2: J_yy of crosses_4, J_yy - J_xx of the Cardan shaft."""
    cardan_c: Scalar
    """kg·m², K = (gamma' cos(a))^2 / 2: J_zz - J_xx of crosses_4, J_yy - J_xx of the Cardan shaft."""
    cardan_spin: Scalar
    """kg·m², K = n^2 / 2, n the Cardan shaft's spin about r: its J_xx + J_zz - J_yy."""
    cardan_cross_xy: Scalar
    """kg·m², K = J_xy of crosses_4 times the product of their angular velocities about their x and y axes."""
    cardan_cross_xz: Scalar
    """kg·m², as `cardan_cross_xy`, x and z."""
    cardan_cross_yz: Scalar
    """kg·m², as `cardan_cross_xy`, y and z."""
    cardan_shaft_xy: Scalar
    """kg·m², K = J_xy of the Cardan shaft times the product of its angular velocities about its x and y axes."""
    cardan_shaft_xz: Scalar
    """kg·m², as `cardan_shaft_xy`, x and z; -L1 h_x of cross B4 added."""
    cardan_shaft_yz: Scalar
    """kg·m², as `cardan_shaft_xy`, y and z."""
    cardan_cross_carried: Scalar
    """kg·m², K = L1 h_z of cross B4 times r' · c', c the z axis of crosses_4."""
    cardan_moment_x: Scalar
    """kg·m, U = -g · (their x axis): h_x of crosses_4 and Cardan shaft."""
    cardan_moment_y: Scalar
    """kg·m, U = -g · (its y axis): h_y of the Cardan shaft."""
    cardan_moment_z: Scalar
    """kg·m, U = -g · (their z axis): h_z of crosses_4."""
    paper_shaft_x: Scalar
    """kg·m², model ``paper``, K = I_xx of the Cardan shaft times -gamma' theta' sin(beta).

    I is a tensor about the centre of mass, here and below.
    """
    paper_shaft_y: Scalar
    """kg·m², model ``paper``: I_yy - I_zz of the Cardan shaft.

    K = gamma' beta' sin(theta) r_z + (gamma' sin(theta) cos(beta))^2 / 2.
    """
    paper_beta: Scalar
    """kg·m², model ``paper``, K = (gamma' sin(beta))^2 / 2: I_xx - I_zz of Cardan shaft and crosses_4."""
    paper_cross_xy: Scalar
    """kg·m², model ``paper``, K = I_xy of crosses_4 times -gamma' beta' sin(beta)."""
    paper_cross_xz: Scalar
    """kg·m², model ``paper``, K = I_xz of crosses_4 times -gamma'^2 sin(beta) cos(beta)."""
    paper_cross_yz: Scalar
    """kg·m², model ``paper``, K = I_yz of crosses_4 times gamma' beta' cos(beta)."""
    paper_shaft_xy: Scalar
    """kg·m², model ``paper``, K = I_xy (gamma' (e_x w_y + e_y w_x) + gamma'^2 e_x e_y) of the Cardan shaft.

    e is Z0 and w the angular velocity of rod A1B1, both in its frame.
    """
    paper_shaft_xz: Scalar
    """kg·m², as `paper_shaft_xy`, x and z."""
    paper_shaft_yz: Scalar
    """kg·m², as `paper_shaft_xy`, y and z."""
    fixed_x: Scalar
    """kg·m, U = -g · (fixed_x, fixed_y, fixed_z): first moment of all that never moves or is a constant lever.

    It makes the potential energy equal to the one body by body; no torque depends on it.
    """
    fixed_y: Scalar
    """kg·m, see `fixed_x`."""
    fixed_z: Scalar
    """kg·m, see `fixed_x`."""


def _names(transmission: str) -> tuple[str, ...]:
    absent = ("fixed_", "cardan_") if transmission == "paper" else ("fixed_", "paper_")
    return tuple(name for name in CompositeParameters._fields if not name.startswith(absent))


BASE_PARAMETER_NAMES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {transmission: _names(transmission) for transmission in ("exact", "paper", "none")}
)
"""Names of the base parameters of each transmission model: the minimal set on which torques depend, linearly."""

_FIRST_MOMENTS = ("moment_", "shank_cos_x", "shank_cos_y", "shank_cos_z", "shank_sin_", "input_", "cardan_moment_")
BASE_PARAMETER_UNITS: Mapping[str, str] = MappingProxyType(
    {name: "kg·m" if name.startswith((*_FIRST_MOMENTS, "fixed_")) else "kg·m²" for name in CompositeParameters._fields}
)
"""Unit of each composite parameter."""


# From 25 bodies to the parameters


class _Term:
    """A value and the size that it is to be compared with, see `ROUNDING`."""

    __slots__ = ("size", "value")

    def __init__(self, value: Scalar, size: Scalar) -> None:
        self.value = value
        self.size = size

    def __add__(self, other: _Term) -> _Term:
        return _Term(self.value + other.value, self.size + other.size)

    def __sub__(self, other: _Term) -> _Term:
        return _Term(self.value - other.value, self.size + other.size)

    def __mul__(self, other: _Term) -> _Term:
        return _Term(self.value * other.value, self.size * other.size)

    def __rmul__(self, factor: Scalar) -> _Term:
        return _Term(factor * self.value, fabs(factor) * self.size)

    def rounded(self) -> Scalar:
        """The value, or 0 where nothing but rounding is left of it; symbols have no size and stay as they are."""
        if all(isinstance(part, int | float | np.ndarray) for part in (self.value, self.size)):
            return where(fabs(self.value) <= ROUNDING * self.size, 0.0, self.value)
        return self.value


_NONE = _Term(0.0, 0.0)
_PAIRS = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


class _Moments:
    """Mass, first moment and tensor about the frames' origins of bodies that turn alike."""

    def __init__(
        self,
        mass: _Term = _NONE,
        first: tuple[_Term, _Term, _Term] = (_NONE, _NONE, _NONE),
        tensor: Mapping[str, _Term] | None = None,
    ) -> None:
        self.mass = mass
        self.x, self.y, self.z = first
        self._tensor = dict.fromkeys(_PAIRS, _NONE) if tensor is None else tensor

    def __getitem__(self, pair: str) -> _Term:
        """Element of the tensor."""
        return self._tensor[pair]

    def __add__(self, other: _Moments) -> _Moments:
        first = (self.x + other.x, self.y + other.y, self.z + other.z)
        return _Moments(self.mass + other.mass, first, {pair: self[pair] + other[pair] for pair in _PAIRS})


def _central(body: Body) -> _Moments:
    """Tensor of a body about its centre of mass, nothing else."""
    trace = fabs(body.inertia[0][0]) + fabs(body.inertia[1][1]) + fabs(body.inertia[2][2])
    return _Moments(tensor={pair: _Term(body.inertia[i][j], trace) for pair, (i, j) in _PAIRS.items()})


def _about_origin(body: Body) -> _Moments:
    """Moments of a point mass in the body's centre of mass about the origin of its frame."""
    reach = fabs(body.com[0]) + fabs(body.com[1]) + fabs(body.com[2])
    mass = _Term(body.mass, fabs(body.mass))
    x, y, z = com = tuple(_Term(component, reach) for component in body.com)
    squares = {"xx": y * y + z * z, "yy": x * x + z * z, "zz": x * x + y * y}
    products = {pair: -1.0 * (com[i] * com[j]) for pair, (i, j) in _PAIRS.items() if i != j}
    tensor = {pair: mass * value for pair, value in (squares | products).items()}
    return _Moments(mass, (mass * x, mass * y, mass * z), tensor)


def _sum(moments: Iterable[_Moments]) -> _Moments:
    return sum(moments, start=_Moments())


def composite_parameters(leg: OmniLeg) -> CompositeParameters:
    """Composite parameters of a leg: sums over bodies that turn alike, see `CompositeParameters`.

    Sums of numbers that cancel but for rounding (chains at 0 and +-120 deg) are exactly zero, see `ROUNDING`; sums that
    contain CasADi symbols are left as they are.
    """
    paper = leg.transmission == "paper"
    bodies = {body.name: body for body in leg.bodies}
    cardan = ("cross_A4", "shaft_A4B4", "cross_B4")

    def group(*names: str) -> _Moments:
        return _sum(
            _about_origin(bodies[name])
            if leg.transmission == "none" and name in cardan
            else _about_origin(bodies[name]) + _central(bodies[name])
            for name in names
        )

    def length(value: Scalar) -> _Term:
        return _Term(value, fabs(value))

    L1, L3, L4, L5, R_C = map(length, (leg.L1, leg.L3, leg.L4, leg.L5, leg.R_C))
    rotor_2, rotor_1, rotor_3 = map(length, leg.rotor_inertia)
    carried_1, carried_2, carried_4 = group("cross_B1", "cross_B3"), group("cross_B2"), group("cross_B4")
    cross_a4, shaft = group("cross_A4"), group("shaft_A4B4")
    crosses_1, rods_1 = group("cross_A1", "cross_A3") + carried_1, group("rod_A1B1", "rod_A3B3")
    crosses_2, rods_2 = group("cross_A2") + carried_2, group("rod_A2B2")
    shaft_in, shaft_out = group("input_shaft"), group("output_shaft")
    knee, foot = group("knee"), group("foot")
    uppers = [group(f"driven_gear_{i}", f"link_C{i}D{i}") for i in (1, 2, 3)]
    lowers = [group(f"link_D{i}E{i}") for i in (1, 2, 3)]
    shank = _sum((*uppers, *lowers))
    upper, lower = _sum(uppers), _sum(lowers)
    carried = _sum((carried_1, carried_2, carried_4, knee, shaft_out, shank, foot))
    crosses_4 = cross_a4 + carried_4
    if paper:  # they turn as branch 1 does, and what gamma' adds to them needs their tensors about the centres of mass
        spun_cross = _central(bodies["cross_A4"]) + _central(bodies["cross_B4"])
        spun_shaft = _central(bodies["shaft_A4B4"])
        carried_1, crosses_1, rods_1 = carried_1 + carried_4, crosses_1 + crosses_4, rods_1 + shaft
        cross_a4 = carried_4 = crosses_4 = shaft = _Moments()
    else:
        spun_cross = spun_shaft = _Moments()

    # First moments of the shank, at cos(gamma) and sin(gamma); D_i carries the lower link.
    cos_x, cos_y = shaft_out.x, shaft_out.y + carried_4.y
    sin_x, sin_y = -1.0 * cos_y, shaft_out.x
    fixed_x = knee.x + crosses_2.x + foot.x
    fixed_y = knee.y + crosses_1.y + foot.y
    fixed_z = knee.z + foot.z + shaft_in.z + shaft_out.z + L5 * (shank.mass + foot.mass)
    for psi, up, low in zip(leg.psi, uppers, lowers, strict=True):
        s, c = (_Term(_Term(value, 1.0).rounded(), 1.0) for value in (sin(psi), cos(psi)))
        at_cos, at_sin = up.y + low.y, low.z - up.z - L4 * low.mass
        cos_x, cos_y = cos_x - s * at_cos, cos_y + c * at_cos
        sin_x, sin_y = sin_x - s * at_sin, sin_y + c * at_sin
        radial = up.x + low.x + R_C * (up.mass + low.mass)
        fixed_x, fixed_y = fixed_x + c * radial, fixed_y + s * radial
    fixed_x = fixed_x + L3 * group("cross_A2", "rod_A2B2", "cross_B2").mass
    fixed_y = fixed_y + L3 * group("cross_A1", "rod_A1B1", "cross_B1").mass
    fixed_y = fixed_y - L3 * group("cross_A3", "rod_A3B3", "cross_B3").mass

    terms = CompositeParameters(
        inertia_alpha=crosses_2["xx"] + rods_2["xx"] - rods_2["yy"] + rotor_2,
        inertia_beta=crosses_1["yy"] + rods_1["yy"] - rods_1["xx"] + rotor_1,
        inertia_gamma=(
            (shaft_in["zz"] + shaft_out["zz"] + shank["xx"] + L4 * L4 * lower.mass - 2.0 * (L4 * lower.z) + rotor_3)
            + (crosses_4["xx"] + spun_cross["zz"] + spun_shaft["zz"])
        ),
        transverse=rods_1["xx"] + rods_2["yy"] + shaft["xx"] + L1 * L1 * carried.mass,
        spin_1=rods_1["xx"] + rods_1["zz"] - rods_1["yy"],
        spin_2=rods_2["yy"] + rods_2["zz"] - rods_2["xx"],
        rods_1_xy=rods_1["xy"],
        rods_1_xz=rods_1["xz"] - L1 * carried_1.x,
        rods_1_yz=rods_1["yz"],
        crosses_1_carried=L1 * carried_1.z,
        rods_2_xy=rods_2["xy"],
        rods_2_xz=rods_2["xz"],
        rods_2_yz=rods_2["yz"] - L1 * carried_2.y,
        crosses_2_carried=L1 * carried_2.z,
        moment_r=rods_1.z + rods_2.z + shaft.z + L1 * carried.mass,
        moment_1_x=rods_1.x + crosses_1.x,
        moment_1_y=rods_1.y,
        moment_1_z=crosses_1.z,
        moment_2_x=rods_2.x,
        moment_2_y=rods_2.y + crosses_2.y,
        moment_2_z=crosses_2.z,
        shank_cos_cos=4.0 * (L4 * L4 * foot.mass) + 4.0 * (L4 * lower.z),
        shank_cos_sin=-2.0 * (L4 * lower.y),
        shank_cos_x=cos_x,
        shank_cos_y=cos_y,
        shank_cos_z=shank.z + L4 * lower.mass + 2.0 * (L4 * foot.mass),
        shank_sin_x=sin_x,
        shank_sin_y=sin_y,
        shank_sin_z=upper.y - lower.y,
        input_x=shaft_in.x,
        input_y=shaft_in.y + cross_a4.y,
        cardan_a=crosses_4["yy"] + shaft["yy"] - shaft["xx"],
        cardan_c=crosses_4["zz"] - crosses_4["xx"] + shaft["yy"] - shaft["xx"],
        cardan_spin=shaft["xx"] + shaft["zz"] - shaft["yy"],
        cardan_cross_xy=crosses_4["xy"],
        cardan_cross_xz=crosses_4["xz"],
        cardan_cross_yz=crosses_4["yz"],
        cardan_shaft_xy=shaft["xy"],
        cardan_shaft_xz=shaft["xz"] - L1 * carried_4.x,
        cardan_shaft_yz=shaft["yz"],
        cardan_cross_carried=L1 * carried_4.z,
        cardan_moment_x=crosses_4.x + shaft.x,
        cardan_moment_y=shaft.y,
        cardan_moment_z=crosses_4.z,
        paper_shaft_x=spun_shaft["xx"],
        paper_shaft_y=spun_shaft["yy"] - spun_shaft["zz"],
        paper_beta=spun_shaft["xx"] - spun_shaft["zz"] + spun_cross["xx"] - spun_cross["zz"],
        paper_cross_xy=spun_cross["xy"],
        paper_cross_xz=spun_cross["xz"],
        paper_cross_yz=spun_cross["yz"],
        paper_shaft_xy=spun_shaft["xy"],
        paper_shaft_xz=spun_shaft["xz"],
        paper_shaft_yz=spun_shaft["yz"],
        fixed_x=fixed_x,
        fixed_y=fixed_y,
        fixed_z=fixed_z,
    )
    return CompositeParameters(*(term.rounded() for term in terms))


# Motion: all that depends on q, v and a alone


class _Place(NamedTuple):
    """What the equations need of the angles; see the module's text for the symbols."""

    sa: Scalar
    ca: Scalar
    sb: Scalar
    cb: Scalar
    sg: Scalar
    cg: Scalar
    sin_theta: Scalar
    cos_theta: Scalar
    theta_alpha: Scalar
    """d theta / d alpha"""
    j: Scalar
    """d theta / d beta = -j cos(theta)"""
    lever: Scalar
    """sin(beta) cos(alpha); dW = -lever (dV - j dtheta)"""
    W: Scalar
    """r · R_x(alpha) Z0"""
    rx: Scalar
    rz: Scalar
    yx: Scalar
    """x component of y; its y component is cos(theta)"""
    yz: Scalar
    x: Scalar
    """Component of r along R_z(gamma) X0"""
    u: Scalar
    """sin(b)"""
    P: Scalar
    q: Scalar
    cos2: Scalar
    """cos^2(b)"""
    w: Scalar
    """1 / cos^2(b)"""
    zw: Scalar


def _reciprocal(x: Scalar) -> Scalar:
    """1 / x as one division: CasADi turns every product with an inverse into a division of its own."""
    return 2.0 / (x + x)


def _place(q: Vector) -> _Place:
    alpha, beta, gamma = q
    sa, ca, sb, cb, sg, cg = sin(alpha), cos(alpha), sin(beta), cos(beta), sin(gamma), cos(gamma)
    lever = ca * sb
    # The sum form of D does not cancel near alpha = beta = 90 deg.
    s = sqrt(1.0 / (cb * cb + lever * lever))
    W = s * cb
    sin_theta, cos_theta = W * sa, s * ca
    rx, rz = s * lever, cos_theta * cb
    yx, yz = sin_theta * sb, sin_theta * cb
    P, q_ = sg * cb, cg * cos_theta - sg * yx
    cos2 = P * P + q_ * q_  # not 1 - sin^2(b), which cancels near b = 90 deg
    w = _reciprocal(cos2)
    return _Place(
        *(sa, ca, sb, cb, sg, cg, sin_theta, cos_theta),
        theta_alpha=s * W,
        j=s * (sa * sb),
        lever=lever,
        W=W,
        rx=rx,
        rz=rz,
        yx=yx,
        yz=yz,
        x=cg * rx - sg * sin_theta,
        u=sg * rx + cg * sin_theta,
        P=P,
        q=q_,
        cos2=cos2,
        w=w,
        zw=rz * w,
    )


class _Move(NamedTuple):
    """Rates and accelerations; see the module's text for the symbols."""

    v: Vector
    a: Vector
    theta: Scalar
    """theta'"""
    V: Scalar
    spin: Scalar
    """beta' sin(theta): minus the spin of the rods 1 and 3."""
    X: Scalar
    Y: Scalar
    push: Scalar
    """alpha' r_x: the spin of rod 2."""
    slip: Scalar
    """V - j theta' = -W' / lever"""
    lag: Scalar
    """2 r_x alpha' (V - j theta'): what velocities leave of Y."""
    speed2: Scalar
    """|r'|^2"""
    fall: Scalar
    """-r_z''"""
    cos_fall: Scalar
    """-d²/dt² cos(gamma)"""
    sin_rise: Scalar
    """d²/dt² sin(gamma)"""


def _move(place: _Place, v: Vector, a: Vector) -> _Move:
    va, vb, vg = v
    aa, ab, ag = a
    V, spin, push = vb * place.cos_theta, vb * place.sin_theta, va * place.rx
    theta = place.theta_alpha * va - place.j * V
    slip = V - place.j * theta
    lag = 2.0 * (push * slip)
    X = place.cos_theta * ab - 2.0 * (spin * theta)
    Y = place.theta_alpha * aa - place.j * X - lag
    speed2 = theta * theta + V * V
    vg2 = vg * vg
    return _Move(
        v,
        a,
        theta,
        V,
        spin,
        X,
        Y,
        push,
        slip,
        lag,
        speed2,
        fall=place.sb * X + place.yz * Y + place.rz * speed2,
        cos_fall=place.sg * ag + place.cg * vg2,
        sin_rise=place.cg * ag - place.sg * vg2,
    )


def _r_acceleration(place: _Place, move: _Move) -> Vector:
    """r'' in the hip frame."""
    return (
        place.cb * move.X - place.yx * move.Y - place.rx * move.speed2,
        place.sin_theta * move.speed2 - place.cos_theta * move.Y,
        -move.fall,
    )


# Torques. Helpers return what they add to theta, to V (which is worth cos(theta) of it about beta), alpha, beta, gamma.


def _torque(
    leg: OmniLeg, pi: CompositeParameters, place: _Place, move: _Move, gravity: Vector, force: Vector = ZERO
) -> Vector:
    """(45) and (46) without damping and friction; the environment applies `force` to the foot."""
    aa, ab, ag = move.a
    pull, gamma = _shank(leg, pi, place, move, gravity, force)
    alpha, pull_2, theta_2, sweep_2 = _branch_2(pi, place, move, gravity)
    theta_1, beta = _branch_1(pi, place, move, gravity)
    if leg.transmission == "paper":
        pull_4: Vector = ZERO
        sweep_4: Scalar = 0.0
        theta_4, beta_4, gamma_4 = _paper(pi, place, move)
        beta = beta + beta_4
    else:
        pull_4, theta_4, sweep_4, gamma_4 = _cardan(pi, place, move, gravity)
    # All that acts on r: pull is minus the force that r needs, so weight and foot force less inertia.
    x, y, z = (a + b + c for a, b, c in zip(pull, (pull_2, 0.0, 0.0), pull_4, strict=True))
    theta = pi.transverse * move.Y - pi.spin_1 * (move.V * move.spin) + place.cos_theta * y
    theta = theta + place.sin_theta * (place.sb * x + place.cb * z) + (theta_1 + theta_2 + theta_4)
    sweep = (pi.transverse - pi.spin_1) * move.X + (place.sb * z - place.cb * x) + (sweep_2 + sweep_4)
    return (
        pi.inertia_alpha * aa + place.theta_alpha * theta + alpha,
        (pi.inertia_beta + pi.spin_1) * ab + place.cos_theta * (sweep - place.j * theta) + beta,
        pi.inertia_gamma * ag + gamma + gamma_4,
    )


def _shank(
    leg: OmniLeg, pi: CompositeParameters, place: _Place, move: _Move, gravity: Vector, force: Vector
) -> tuple[Vector, Scalar]:
    """Pull of the knee's load and the foot force on r, and the torque about gamma, by the shank's first moments."""
    at_cos = (pi.shank_cos_x, pi.shank_cos_y, pi.shank_cos_z)
    at_sin = (pi.shank_sin_x, pi.shank_sin_y, pi.shank_sin_z)
    gx, gy, _ = gravity
    swing = _r_acceleration(place, move)[:2]
    cos_lift, sin_lift = (
        (leg.L1 * at[0]) * swing[0] + (leg.L1 * at[1]) * swing[1] - (leg.L1 * at[2]) * move.fall - dot(at, gravity)
        for at in (at_cos, at_sin)
    )
    cos_drag = pi.shank_cos_cos * move.cos_fall - pi.shank_cos_sin * move.sin_rise - cos_lift
    sin_force = sin_lift - pi.shank_cos_sin * move.cos_fall
    input_x, input_y = pi.input_x * gx + pi.input_y * gy, pi.input_x * gy - pi.input_y * gx
    pull = tuple(
        pi.moment_r * g + (leg.L1 * c) * move.cos_fall - (leg.L1 * s) * move.sin_rise + leg.L1 * f
        for g, c, s, f in zip(gravity, at_cos, at_sin, force, strict=True)
    )
    lift = cos_drag + (2.0 * leg.L4) * force[2]  # (14): the foot is 2 L4 cos(gamma) below the knee
    return pull, place.sg * (lift + input_x) + place.cg * (sin_force - input_y)


def _branch_1(pi: CompositeParameters, place: _Place, move: _Move, gravity: Vector) -> tuple[Scalar, Scalar]:
    """Products of inertia and first moments of rods_1 and crosses_1, about theta and beta."""
    s, c = place.sin_theta, place.cos_theta
    gx, gy, gz = gravity
    ab, vb = move.a[1], move.v[1]
    vb2 = vb * vb
    along_x, along_z = place.cb * gx - place.sb * gz, place.sb * gx + place.cb * gz
    bend = c * c - s * s
    theta_second = move.Y - move.V * move.spin
    rate2 = move.theta * move.theta
    theta = (
        pi.rods_1_xy * (c * ab)
        - pi.rods_1_xz * (s * ab)
        + pi.rods_1_yz * (bend * vb2)
        + pi.crosses_1_carried * (s * vb2)
        - pi.moment_1_y * (c * along_z - s * gy)
    )
    beta = (
        pi.rods_1_xy * (c * theta_second - s * rate2)
        - pi.rods_1_xz * (s * theta_second + c * rate2)
        - pi.rods_1_yz * (2.0 * (s * c * ab + bend * (vb * move.theta)))
        + pi.crosses_1_carried * (2.0 * (c * ab - s * (vb * move.theta)))
        + pi.moment_1_x * along_z
        - pi.moment_1_y * (s * along_x)
        - pi.moment_1_z * along_x
    )
    return theta, beta


def _branch_2(
    pi: CompositeParameters, place: _Place, move: _Move, gravity: Vector
) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """Spin, products of inertia and first moments of rods_2 and crosses_2.

    Their energy depends on alpha, U = r_x and W alone: returned are the torque about alpha, the pull on U, and what W
    needs, about theta and V. The spin uses 2 alpha' U U' = lag cos(beta).
    """
    va, aa = move.v[0], move.a[0]
    gx, gy, gz = gravity
    U, W = place.rx, place.W
    va2 = va * va
    U_rate = place.cb * move.V - place.yx * move.theta
    W_rate = -(place.lever * move.slip)
    U_second = _r_acceleration(place, move)[0]
    W_second = va2 * W - place.lever * (move.X - place.j * move.Y) - W * move.speed2
    along_y, along_z = place.ca * gy + place.sa * gz, place.ca * gz - place.sa * gy
    alpha = (
        pi.spin_2 * (U * (U * aa) + place.cb * move.lag)
        + pi.rods_2_xy * U_second
        + pi.rods_2_xz * (2.0 * (aa * U * W + va * (U_rate * W + U * W_rate)))
        - pi.rods_2_yz * W_second
        + pi.crosses_2_carried * (2.0 * (aa * W + va * W_rate))
        - pi.moment_2_x * (U * along_y)
        - pi.moment_2_y * along_z
        + pi.moment_2_z * along_y
    )
    pull = pi.spin_2 * (va * move.push) - pi.rods_2_xy * aa + pi.rods_2_xz * (va2 * W) - pi.moment_2_x * along_z
    need = -(pi.rods_2_yz * aa) - pi.rods_2_xz * (va2 * U) - pi.crosses_2_carried * va2 - pi.moment_2_x * gx
    return alpha, pull, place.lever * place.j * need, -(place.lever * need)


def _products(xy: Scalar, xz: Scalar, yz: Scalar, w: Vector, w_rate: Vector) -> Vector:
    """J w' + w x J w of a tensor whose diagonal is zero, in the body's own frame."""
    tensor = (0.0, xy, xz), (xy, 0.0, yz), (xz, yz, 0.0)
    return add(matvec(tensor, w_rate), cross(w, matvec(tensor, w)))


def _cardan(
    pi: CompositeParameters, place: _Place, move: _Move, gravity: Vector
) -> tuple[Vector, Scalar, Scalar, Scalar]:
    """Cardan shaft and its crosses with their true motion: pull on r, theta, V, gamma.

    The moment about a, and the moments m about the shaft's axes, are mapped by a' = w (p theta' + q V + y_r z gamma'),
    by n = y_r a' + z gamma' and by the transverse velocities of the shaft.
    """
    P, q, u, w, x, z = place.P, place.q, place.u, place.w, place.x, place.rz
    vg, ag = move.v[2], move.a[2]
    S = P * move.V + q * move.theta  # minus r' · y_4
    nu = q * move.V - P * move.theta
    g, xi, zag = vg * z, vg * x, z * ag
    u_rate = S + xi
    a_rate = w * (nu - g * u)
    ua = u * a_rate
    n = g - ua
    bend = q * move.X - P * move.Y
    a_second = w * (bend - u * zag - g * S - u_rate * (n - ua))
    n_second = zag - vg * (place.sb * move.V + place.yz * move.theta) - u * a_second - a_rate * u_rate

    # Parts beside the axes: what follows vanishes where crosses and shaft are symmetric.
    ic = sqrt(w)
    c, sin_a, cos_a = place.cos2 * ic, x * ic, z * ic
    gx, gy, gz = (
        place.cg * gravity[0] + place.sg * gravity[1],
        place.cg * gravity[1] - place.sg * gravity[0],
        gravity[2],
    )
    g_x, g_z, g_r = cos_a * gx - sin_a * gz, sin_a * gx + cos_a * gz, x * gx - u * gy + z * gz
    w_shaft = (S * ic, nu * ic, n)
    w_shaft_rate = ((P * move.X + q * move.Y) * ic + w_shaft[1] * n, bend * ic - w_shaft[0] * n, n_second)
    m1, m2, m3 = _products(pi.cardan_shaft_xy, pi.cardan_shaft_xz, pi.cardan_shaft_yz, w_shaft, w_shaft_rate)
    m1, m3 = m1 - pi.cardan_moment_y * g_r, m3 + pi.cardan_moment_y * g_x
    w_cross = (-(vg * sin_a), a_rate, vg * cos_a)
    w_cross_rate = (-(ag * sin_a + vg * a_rate * cos_a), a_second, ag * cos_a - vg * a_rate * sin_a)
    k1, k2, k3 = _products(pi.cardan_cross_xy, pi.cardan_cross_xz, pi.cardan_cross_yz, w_cross, w_cross_rate)
    rx, ry, rz = _r_acceleration(place, move)
    carried = pi.cardan_cross_carried
    force_x = carried * (cos_a * (place.cg * rx + place.sg * ry) - sin_a * rz) - pi.cardan_moment_z * g_x
    force_y = carried * (place.cg * ry - place.sg * rx) - pi.cardan_moment_z * gy
    k1, k2, k3 = k1 - force_y, k2 + force_x + pi.cardan_moment_x * g_z, k3 - pi.cardan_moment_x * gy
    c1, c2, c3 = (  # c'' in the frame of the crosses
        w_cross_rate[1] + w_cross[0] * w_cross[2],
        w_cross[1] * w_cross[2] - w_cross_rate[0],
        -(w_cross[0] * w_cross[0] + w_cross[1] * w_cross[1]),
    )
    cx, cz = cos_a * c1 + sin_a * c3, cos_a * c3 - sin_a * c1
    pull = scale(-carried, (place.cg * cx - place.sg * c2, place.sg * cx + place.cg * c2, cz))

    moment_a = pi.cardan_a * a_second + pi.cardan_c * (g * xi * w) + k2
    moment_n = pi.cardan_spin * n_second + m3
    spin = pi.cardan_spin * n
    about_p = moment_a - u * moment_n - spin * S + c * m2
    about_q = spin * nu + c * m1
    gamma = place.zw * (moment_n - u * moment_a + pi.cardan_c * (zag - 2.0 * (xi * a_rate)))
    gamma = gamma + (cos_a * k3 - sin_a * k1)
    return pull, w * (q * about_q - P * about_p), w * (q * about_p + P * about_q), gamma


def _paper(pi: CompositeParameters, place: _Place, move: _Move) -> tuple[Scalar, Scalar, Scalar]:
    """What gamma' about the fixed Z0 adds in the model ``paper``, (26), (27), (29), about theta, beta and gamma.

    Its energy is gamma' (b beta' + t theta') + c gamma'^2 / 2 with functions b, t, c of beta and theta; e is Z0 in the
    frame of rod A1B1, (ex, ey, ez), and a trailing _b or _t is a derivative by beta or theta.
    """
    s, c, sb, cb = place.sin_theta, place.cos_theta, place.sb, place.cb
    vb, vg = move.v[1:]
    ab, ag = move.a[1:]
    vt, at = move.theta, move.Y - move.V * move.spin
    ex, ey, ez = -sb, place.yz, place.rz
    ey_b, ez_b = -place.yx, -place.rx  # ex_b = -cb, ey_t = ez, ez_t = -ey
    xx, yy, bb = pi.paper_shaft_x, pi.paper_shaft_y, pi.paper_beta
    xy, xz, yz = pi.paper_shaft_xy, pi.paper_shaft_xz, pi.paper_shaft_yz
    cross_xy, cross_xz, cross_yz = pi.paper_cross_xy, pi.paper_cross_xz, pi.paper_cross_yz

    t = xx * ex + xy * ey + xz * ez
    t_b = xy * ey_b + xz * ez_b - xx * cb
    t_t = xy * ez - xz * ey
    b = yy * (s * ez) + xy * (ex * c) - xz * (ex * s) + yz * (ez * c - ey * s) + cross_xy * ex + cross_yz * cb
    b_b = yy * (s * ez_b) - xy * (cb * c) + xz * (cb * s) + yz * (ez_b * c - ey_b * s) - cross_xy * cb - cross_yz * sb
    b_t = yy * (ez * c - ey * s) - xy * (ex * s) - xz * (ex * c) - yz * (2.0 * (ey * c + ez * s))
    c_ = bb * (ex * ex) + yy * (ey * ey)
    c_ = c_ + 2.0 * (cross_xz * (ex * cb) + xy * (ex * ey) + xz * (ex * ez) + yz * (ey * ez))
    half_c_b = bb * (sb * cb) + yy * (ey * ey_b) + cross_xz * (sb * sb - cb * cb)
    half_c_b = half_c_b + xy * (ex * ey_b - cb * ey) + xz * (ex * ez_b - cb * ez) + yz * (ey_b * ez + ey * ez_b)
    half_c_t = yy * (ey * ez) + xy * (ex * ez) - xz * (ex * ey) + yz * (ez * ez - ey * ey)

    twist = vg * (b_t - t_b)
    vg2 = vg * vg
    theta = t * ag - twist * vb - vg2 * half_c_t
    beta = b * ag + twist * vt - vg2 * half_c_b
    gamma = b * ab + t * at + c_ * ag + 2.0 * (vg * (half_c_b * vb + half_c_t * vt))
    gamma = gamma + b_b * (vb * vb) + (b_t + t_b) * (vb * vt) + t_t * (vt * vt)
    return theta, beta, gamma


# The equations


def inverse_dynamics(
    leg: OmniLeg, parameters: CompositeParameters, q: Vector, v: Vector, a: Vector, gravity: Vector, force: Vector
) -> Vector:
    """Joint torques of (45) and (50), N·m, without damping and friction."""
    place = _place(q)
    return _torque(leg, parameters, place, _move(place, v, a), gravity, force)


def _mass_matrix(leg: OmniLeg, parameters: CompositeParameters, place: _Place) -> Matrix:
    columns = [_torque(leg, parameters, place, _move(place, ZERO, unit), ZERO) for unit in IDENTITY]
    return tuple(tuple(columns[min(i, j)][max(i, j)] for j in range(3)) for i in range(3))


def mass_matrix(leg: OmniLeg, parameters: CompositeParameters, q: Vector) -> Matrix:
    """Inertia matrix M of (46), kg·m²: torques of unit accelerations out of rest, without gravity."""
    return _mass_matrix(leg, parameters, _place(q))


def gravity_torque(leg: OmniLeg, parameters: CompositeParameters, q: Vector, gravity: Vector) -> Vector:
    """G of (46), N·m: torques at rest."""
    return inverse_dynamics(leg, parameters, q, ZERO, ZERO, gravity, ZERO)


def forward_dynamics(
    leg: OmniLeg, parameters: CompositeParameters, q: Vector, v: Vector, torque: Vector, gravity: Vector, force: Vector
) -> Vector:
    """Joint accelerations, rad/s², without damping and friction; M and the bias share the kinematics."""
    place = _place(q)
    bias = _torque(leg, parameters, place, _move(place, v, ZERO), gravity, force)
    return _solve_symmetric(_mass_matrix(leg, parameters, place), subtract(torque, bias))


def _solve_symmetric(matrix: Matrix, b: Vector) -> Vector:
    """Solution of a symmetric positive definite system by cofactors: one division, where elimination needs three."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix
    c_xx, c_xy, c_xz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    inverse = _reciprocal(xx * c_xx + xy * c_xy + xz * c_xz)
    cofactors = (
        (c_xx, c_xy, c_xz),
        (c_xy, xx * zz - xz * xz, xy * xz - xx * yz),
        (c_xz, xy * xz - xx * yz, xx * yy - xy * xy),
    )
    return scale(inverse, matvec(cofactors, b))


def potential_energy(leg: OmniLeg, parameters: CompositeParameters, q: Vector, gravity: Vector) -> Scalar:
    """Potential energy of (44), J, zero at O0; its constant is what `CompositeParameters.fixed_x` and so on say."""
    pi, place = parameters, _place(q)
    gx, gy, gz = gravity
    x, z = place.cb * gx - place.sb * gz, place.sb * gx + place.cb * gz
    y_2, z_2 = place.ca * gy + place.sa * gz, place.ca * gz - place.sa * gy
    moment = (
        pi.moment_r * (place.cos_theta * z - place.sin_theta * gy)
        + pi.moment_1_x * x
        + pi.moment_1_y * (place.cos_theta * gy + place.sin_theta * z)
        + pi.moment_1_z * z
        + pi.moment_2_x * (place.W * gx - place.rx * z_2)
        + pi.moment_2_y * y_2
        + pi.moment_2_z * z_2
        + dot((pi.fixed_x, pi.fixed_y, pi.fixed_z), gravity)
        + place.cg * dot((pi.shank_cos_x, pi.shank_cos_y, pi.shank_cos_z), gravity)
        + place.sg * dot((pi.shank_sin_x, pi.shank_sin_y, pi.shank_sin_z), gravity)
    )
    g_x, g_y = place.cg * gx + place.sg * gy, place.cg * gy - place.sg * gx
    moment = moment + pi.input_x * g_x + pi.input_y * g_y
    if leg.transmission != "paper":
        ic = sqrt(place.w)
        sin_a, cos_a = place.x * ic, place.rz * ic
        along_z = sin_a * g_x + cos_a * gz
        moment = moment + pi.cardan_moment_x * (cos_a * g_x - sin_a * gz) + pi.cardan_moment_z * along_z
        moment = moment + pi.cardan_moment_y * (place.cos2 * ic * g_y + place.u * along_z)
    return -moment


def regressor(leg: OmniLeg, q: Vector, v: Vector, a: Vector, gravity: Vector) -> Matrix:
    """Matrix Y (3 x n) with inverse dynamics = Y pi, pi in the order of `BASE_PARAMETER_NAMES` of the leg's model.

    Each column is the torque of a leg whose only parameter is one: the same code, on the same motion.
    """
    place = _place(q)
    move = _move(place, v, a)
    nothing = CompositeParameters(*(0.0 for _ in CompositeParameters._fields))
    return transpose(
        tuple(
            _torque(leg, nothing._replace(**{name: 1.0}), place, move, gravity)
            for name in BASE_PARAMETER_NAMES[leg.transmission]
        )
    )
