"""Motion of rigid bodies by influence coefficients, and d'Alembert's principle of virtual work over them.

A body's velocity is linear in the rates of the independent coordinates; the factors are its influence coefficients, one
column a coordinate. What is left of its acceleration where the coordinates have none is its bias. Works on floats,
arrays and CasADi symbols alike, see `algebra`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from leg_dynamics.closed_form.algebra import (
    IDENTITY,
    ZERO,
    Matrix,
    Scalar,
    Vector,
    add,
    cross,
    dot,
    matmul,
    matvec,
    rotate_tensor,
    rotation_x,
    rotation_y,
    rotation_z,
    scale,
    subtract,
    total,
    transpose,
)

__all__ = [
    "FIXED",
    "STILL",
    "Angle",
    "Body",
    "CentreOfMass",
    "Dissipation",
    "Motion",
    "Slide",
    "Turning",
    "centre_of_mass",
    "gravity_force",
    "hinged",
    "inertia_matrix",
    "kinetic",
    "potential",
    "shifted",
    "slid",
    "virtual_work",
]


class Body(NamedTuple):
    """A rigid body in its own frame."""

    name: str
    mass: Scalar
    """kg"""
    com: Vector
    """Centre of mass, m."""
    inertia: Matrix
    """Full tensor about the centre of mass, kg·m²."""


class Dissipation(NamedTuple):
    """Losses of one tree joint, both along its own coordinate."""

    joint: str
    damping: Scalar
    """Viscous, N·m·s/rad or N·s/m."""
    friction: Scalar
    """Coulomb, N·m or N."""


class Angle(NamedTuple):
    """An angle through its sine and cosine, with its rates.

    `first` holds the influence coefficients (derivatives by the independent coordinates), `rate` is first · v, and
    `second` is the angle's second time derivative where the independent coordinates have none.
    """

    sine: Scalar
    cosine: Scalar
    first: Vector
    rate: Scalar
    second: Scalar


class Slide(NamedTuple):
    """A distance (m) with its influence coefficients, rate and bias acceleration, as for `Angle`."""

    distance: Scalar
    first: Vector
    rate: Scalar
    second: Scalar


class Turning(NamedTuple):
    """Rotation of a body: R to the hip frame, columns and value of its angular velocity, and its bias acceleration."""

    rotation: Matrix
    columns: tuple[Vector, Vector, Vector]
    """Angular velocity for a unit rate of each coordinate."""
    velocity: Vector
    """Angular velocity, rad/s."""
    bias: Vector
    """Angular acceleration at zero acceleration of the coordinates, rad/s²."""


class Motion(NamedTuple):
    """Motion of a body's frame."""

    turning: Turning
    origin: Vector
    """Position of the frame's origin, m."""
    columns: tuple[Vector, Vector, Vector]
    """Velocity of the origin for a unit rate of each coordinate."""
    bias: Vector
    """Acceleration of the origin at zero acceleration of the coordinates, m/s²."""


class CentreOfMass(NamedTuple):
    """Motion of a body's centre of mass."""

    position: Vector
    """m"""
    columns: tuple[Vector, Vector, Vector]
    """Velocity for a unit rate of each coordinate."""
    bias: Vector
    """Acceleration at zero acceleration of the coordinates, m/s²."""


STILL = (ZERO, ZERO, ZERO)
"""Influence coefficients of what does not move; also the tensor of a point mass."""
FIXED = Turning(IDENTITY, STILL, ZERO, ZERO)
"""The hip itself."""


def hinged(parent: Turning, axis: str, angle: Angle) -> Turning:
    """Rotation of a body hinged to `parent` about its x, y or z axis: angular velocities add up."""
    index = "xyz".index(axis)
    about = (rotation_x, rotation_y, rotation_z)[index](angle.sine, angle.cosine)
    direction = transpose(parent.rotation)[index]
    first, second, third = (
        add(column, scale(rate, direction)) for column, rate in zip(parent.columns, angle.first, strict=True)
    )
    return Turning(
        matmul(parent.rotation, about),
        (first, second, third),
        add(parent.velocity, scale(angle.rate, direction)),
        total((parent.bias, scale(angle.second, direction), scale(angle.rate, cross(parent.velocity, direction)))),
    )


def slid(base: Motion, slide: Slide) -> Motion:
    """Motion of a frame that slides along the z axis of `base` and turns with it."""
    turning = base.turning
    direction = transpose(turning.rotation)[2]
    lever = scale(slide.distance, direction)
    first, second, third = (
        total((linear, cross(angular, lever), scale(rate, direction)))
        for linear, angular, rate in zip(base.columns, turning.columns, slide.first, strict=True)
    )
    w = turning.velocity
    bias = total(
        (
            base.bias,
            cross(turning.bias, lever),
            cross(w, cross(w, lever)),
            scale(2.0 * slide.rate, cross(w, direction)),
            scale(slide.second, direction),
        )
    )
    return Motion(turning, add(base.origin, lever), (first, second, third), bias)


def shifted(base: Motion, lever: Vector) -> CentreOfMass:
    """Motion of the point of a body at `lever` (hip frame, m) from its frame's origin."""
    w = base.turning.velocity
    first, second, third = (
        add(linear, cross(angular, lever)) for linear, angular in zip(base.columns, base.turning.columns, strict=True)
    )
    return CentreOfMass(
        add(base.origin, lever),
        (first, second, third),
        total((base.bias, cross(base.turning.bias, lever), cross(w, cross(w, lever)))),
    )


def centre_of_mass(motion: Motion, com: Vector) -> CentreOfMass:
    """Position, influence coefficients and bias acceleration of a point `com` given in the body's frame (m)."""
    return shifted(motion, matvec(motion.turning.rotation, com))


def kinetic(bodies: Sequence[Body], motions: Mapping[str, Motion], v: Vector) -> Scalar:
    """Kinetic energy, J: sum of m c'·c' / 2 + w·I w / 2."""
    energy: Scalar = 0.0
    for body in bodies:
        motion = motions[body.name]
        w = motion.turning.velocity
        velocity = matvec(transpose(centre_of_mass(motion, body.com).columns), v)
        tensor = rotate_tensor(motion.turning.rotation, body.inertia)
        energy = energy + 0.5 * dot(w, matvec(tensor, w)) + 0.5 * body.mass * dot(velocity, velocity)
    return energy


def potential(bodies: Sequence[Body], motions: Mapping[str, Motion], gravity: Vector) -> Scalar:
    """Potential energy of gravity, J, zero for masses at the hip's origin."""
    energy: Scalar = 0.0
    for body in bodies:
        energy = energy - body.mass * dot(gravity, centre_of_mass(motions[body.name], body.com).position)
    return energy


def gravity_force(bodies: Sequence[Body], motions: Mapping[str, Motion], gravity: Vector) -> Vector:
    """Generalised force that holds the bodies still against gravity."""
    force: Vector = ZERO
    for body in bodies:
        weight = scale(body.mass, gravity)
        columns = centre_of_mass(motions[body.name], body.com).columns
        force = tuple(f - dot(column, weight) for f, column in zip(force, columns, strict=True))
    return force


def inertia_matrix(bodies: Sequence[Body], motions: Mapping[str, Motion]) -> Matrix:
    """Mass matrix of three coordinates: sum of m v_i · v_j + w_i · I w_j."""
    upper: dict[tuple[int, int], Scalar] = {(i, j): 0.0 for i in range(3) for j in range(i, 3)}
    for body in bodies:
        motion = motions[body.name]
        angular = motion.turning.columns
        linear = centre_of_mass(motion, body.com).columns
        tensor = rotate_tensor(motion.turning.rotation, body.inertia)
        momenta = tuple(matvec(tensor, w) for w in angular)
        for (i, j), value in upper.items():
            upper[i, j] = value + body.mass * dot(linear[i], linear[j]) + dot(angular[i], momenta[j])
    return tuple(tuple(upper[min(i, j), max(i, j)] for j in range(3)) for i in range(3))


def virtual_work(bodies: Sequence[Body], motions: Mapping[str, Motion], a: Vector, gravity: Vector) -> Vector:
    """Generalised force of inertia and gravity: sum of v_i · m (c'' - g) + w_i · (I w' + w x I w)."""
    result: Vector = ZERO
    for body in bodies:
        motion = motions[body.name]
        angular, w = motion.turning.columns, motion.turning.velocity
        centre = centre_of_mass(motion, body.com)
        tensor = rotate_tensor(motion.turning.rotation, body.inertia)
        acceleration = add(matvec(transpose(centre.columns), a), centre.bias)
        angular_acceleration = add(matvec(transpose(angular), a), motion.turning.bias)
        force = scale(body.mass, subtract(acceleration, gravity))
        moment = add(matvec(tensor, angular_acceleration), cross(w, matvec(tensor, w)))
        result = tuple(
            value + dot(linear_i, force) + dot(angular_i, moment)
            for value, linear_i, angular_i in zip(result, centre.columns, angular, strict=True)
        )
    return result
