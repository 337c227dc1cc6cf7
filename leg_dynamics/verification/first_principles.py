"""One route against what mechanics demands of any leg: finite differences, closed loops, energy, Lagrange's equations.

Each check holds independent outputs of the route against each other, so that no two of them fail for the same reason
alone:

* the tree's own forward kinematics, computed here from the description: loops closed, foot where it is said to be;
* differences of the foot position against J, Jdot and the foot acceleration;
* differences of the potential against the gravity torque;
* differences of M against the Coriolis force (below);
* torque = M a + h - J^T F as a whole vector, and its inverses;
* power of the actuators and of the foot force against the rate of total energy along a motion.

Coriolis force and skewness. c(q, v) = h - gravity - friction is a quadratic form in v. Its polar form
C(q, v) w = (c(v + w) - c(v - w)) / 4 is symmetric in v and w, hence C is the matrix of Christoffel symbols if c
comes from Lagrange's equations with M. Conversely, a symmetric C with Mdot = C + C^T for every v is unique, as the
Levi-Civita connection of a metric is. So `Mdot - 2C skew`, tested as a whole matrix with this C, is equivalent to
Lagrange's equations for the velocity terms; the power balance sees nothing of it but v^T (Mdot - 2C) v = 0.
Friction is odd in v: the even part of h leaves it out.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leg_dynamics.description import coupling_equations, link_transforms
from leg_dynamics.description.model import Description, Loop
from leg_dynamics.leg import Leg
from leg_dynamics.verification.comparison import ROUTE_TOLERANCE, check, relative
from leg_dynamics.verification.report import Check
from leg_dynamics.verification.states import SPEED, States, domain

__all__ = ["against_first_principles", "loop_residual"]

DIFFERENCE_TOLERANCE = 1e-7
DIFFERENCE_STEP = 1e-4
SYMMETRY_TOLERANCE = 1e-12
GAP_TOLERANCE = 100.0
"""Of results of rounded files, times the gap of their loops: twenty times as much was seen where speeds are high."""
WELL_CONDITIONED = 1e-3
SEARCHED_SHARE = 0.9
"""Share of the box in which inverse kinematics has to find its way: a numeric search may step over the very edge."""

# Fourth-order central differences.
OFFSETS = np.array([-2.0, -1.0, 1.0, 2.0])
WEIGHTS = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0

Function = Callable[[np.ndarray], np.ndarray]


def slope(function: Function, q: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Derivative of a function of q (N, n) along `direction` (N, n): (N, ...)."""
    points = q[:, None] + DIFFERENCE_STEP * OFFSETS[:, None] * direction[:, None]
    return np.tensordot(function(points), WEIGHTS, (1, 0)) / DIFFERENCE_STEP


def gradient(function: Function, q: np.ndarray) -> np.ndarray:
    """Derivatives of a function of q (N, n) by each coordinate, as the last axis: (N, ..., n)."""
    n = q.shape[1]
    points = q[:, None, None] + DIFFERENCE_STEP * OFFSETS[:, None] * np.eye(n)[:, None]
    return np.moveaxis(np.tensordot(function(points), WEIGHTS, (2, 0)), 1, -1) / DIFFERENCE_STEP


def _product(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.einsum("...ij,...j->...i", matrix, vector)


def _dot(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", first, second)


# ---------------------------------------------------------------------- the tree itself


def _loop_rows(loop: Loop, motion: np.ndarray) -> list[np.ndarray]:
    """What vanishes where the successor's loop frame has the pose `motion` (N, 4, 4) in the predecessor's."""
    p, R = motion[:, :3, 3], motion[:, :3, :3]
    axis = np.array(loop.axis if loop.axis is not None else (0.0, 0.0, 1.0))
    along = p @ axis
    same_place = [p]
    same_axis = [R @ axis - axis]
    same_axes = [(R - np.eye(3)).reshape(-1, 9)]
    return {
        "revolute": same_place + same_axis,
        "continuous": same_place + same_axis,
        "spherical": same_place,
        "fixed": same_place + same_axes,
        "prismatic": [p - along[:, None] * axis, *same_axes],
        "planar": [along[:, None], *same_axis],
        "universal": [p, R[:, 0, 1:2]],
    }[loop.type]


def loop_residual(description: Description, coordinates: dict[str, np.ndarray]) -> np.ndarray:
    """Largest violation of any loop or coupling at tree coordinates of shape (N,), in m or rad, shape (N,).

    Computed from the description by plain forward kinematics, without any route.
    """
    count = len(next(iter(coordinates.values())))
    failing = np.isnan(np.stack(list(coordinates.values()), axis=-1)).any(axis=-1)
    usable = {name: np.where(failing, 0.0, values) for name, values in coordinates.items()}
    links = link_transforms(description, usable)
    rows = [np.zeros((count, 1))]
    for loop in description.loops:
        frames = [links[end.link] @ end.origin.matrix() for end in (loop.predecessor, loop.successor)]
        rows += _loop_rows(loop, np.linalg.inv(frames[0]) @ frames[1])
    for equation in coupling_equations(description):
        total = sum(factor * usable[name] for name, factor in equation.coefficients.items())
        rows.append(np.reshape(total - equation.constant, (-1, 1)))
    return np.where(failing, np.nan, np.abs(np.concatenate(rows, axis=1)).max(axis=1))


def _tree_foot(leg: Leg, coordinates: dict[str, np.ndarray]) -> np.ndarray:
    """Foot position in the hip frame by the description's forward kinematics, (N, 3)."""
    description = leg.description
    failing = np.isnan(np.stack(list(coordinates.values()), axis=-1)).any(axis=-1)
    links = link_transforms(description, {n: np.where(failing, 0.0, x) for n, x in coordinates.items()})
    hip = links["hip" if description.has_link("hip") else description.root]
    assert leg.foot is not None
    foot = (np.linalg.inv(hip) @ links[leg.foot])[:, :3, 3]
    return np.where(failing[:, None], np.nan, foot)


# ---------------------------------------------------------------------- the checks


def against_first_principles(leg: Leg, states: States) -> list[Check]:
    """Every identity that the leg's methods have to satisfy, at some states."""
    q = states.q
    group = f"{leg.route}: first principles"
    square = len(leg.actuator_names) == len(leg.joint_names)
    checks: list[Check] = []

    least = GAP_TOLERANCE * leg.loop_gap

    def add(quantity: str, errors: np.ndarray, tolerance: float, measure: str | None = None, q: np.ndarray = q) -> None:
        allowed = max(tolerance, least) if tolerance > 0.0 else tolerance
        checks.append(check(group, quantity, errors, allowed, leg, q, measure))

    coordinates = leg.assemble(q, on_error="nan")
    kept = np.stack([coordinates[name] for name in leg.joint_names], axis=-1) - q
    closed = np.maximum(loop_residual(leg.description, coordinates), np.abs(kept).max(axis=1))
    add("loops and couplings close", closed, ROUTE_TOLERANCE, "absolute, m or rad")
    if leg.foot is not None:
        _foot_checks(leg, states, coordinates, add)
    _mass_checks(leg, states, add)
    _force_checks(leg, states, add)
    if square:
        _effort_checks(leg, states, add)
    return checks


Add = Callable[..., None]


def _foot_checks(leg: Leg, states: States, coordinates: dict[str, np.ndarray], add: Add) -> None:
    q, v, a = states.q, states.v, states.a
    foot = leg.foot_position(q, on_error="nan")
    add("foot position against the tree", relative(foot, _tree_foot(leg, coordinates), 1), ROUTE_TOLERANCE)
    J = leg.jacobian(q, on_error="nan")
    numeric = gradient(lambda q: leg.foot_position(q, on_error="nan"), q)
    add("J against differences", relative(J, numeric, 2), DIFFERENCE_TOLERANCE)
    Jdot = leg.jacobian_derivative(q, v, on_error="nan")
    numeric = slope(lambda q: leg.jacobian(q, on_error="nan"), q, v)
    add("Jdot against differences", relative(Jdot, numeric, 2), DIFFERENCE_TOLERANCE)
    acceleration = leg.foot_acceleration(q, v, a, on_error="nan")
    add(
        "foot acceleration = J a + Jdot v",
        relative(acceleration, _product(J, a) + _product(Jdot, v), 1),
        ROUTE_TOLERANCE,
    )
    if len(leg.joint_names) == 3:
        _inverse_kinematics_check(leg, states, add)


def _inverse_kinematics_check(leg: Leg, states: States, add: Add) -> None:
    """What inverse kinematics finds must put the foot there, whichever of several solutions it is."""
    lower, upper = domain(leg)
    off_centre = np.abs(states.q - 0.5 * (lower + upper)) / (0.5 * (upper - lower))
    inside = states.take(np.flatnonzero((off_centre <= SEARCHED_SHARE).all(axis=1)))
    if len(inside) == 0:
        return
    foot = leg.foot_position(inside.q, on_error="nan")
    found = leg.inverse_kinematics(foot, limits="ignore", on_error="nan")
    errors = relative(foot, leg.foot_position(found, on_error="nan"), 1)
    add("foot position of inverse kinematics", errors, ROUTE_TOLERANCE, q=inside.q)


def _mass_checks(leg: Leg, states: States, add: Add) -> None:
    mass = leg.mass_matrix(states.q, on_error="nan")
    finite = np.isfinite(mass).all(axis=(1, 2))
    asymmetry = np.abs(mass - np.swapaxes(mass, -1, -2)).max(axis=(-2, -1))
    size = np.abs(mass).max(axis=(-2, -1))
    add("mass matrix symmetric", asymmetry / size, SYMMETRY_TOLERANCE, "relative to the largest entry")
    smallest = np.full(len(mass), np.nan)
    smallest[finite] = np.linalg.eigvalsh(mass[finite])[:, 0]
    verdict = np.where(smallest > 0.0, 0.0, np.inf)
    add("mass matrix positive", verdict, 0.0, "0 where the smallest eigenvalue is positive")


def _force_checks(leg: Leg, states: States, add: Add) -> None:
    q, v, a = states.q, states.v, states.a
    force = states.foot_force if leg.foot is not None else None
    mass = leg.mass_matrix(q, on_error="nan")
    gravity = leg.gravity_torque(q, states.gravity, on_error="nan")

    def potential(q: np.ndarray) -> np.ndarray:
        tilted = states.gravity.reshape(len(states), *[1] * (q.ndim - 2), 3)
        return leg.potential_energy(q, tilted, on_error="nan")

    add("gravity against potential", relative(gravity, gradient(potential, q), 1), DIFFERENCE_TOLERANCE)

    def bias(v: np.ndarray) -> np.ndarray:
        return leg.bias(q, v, states.gravity, on_error="nan")

    def coriolis(v: np.ndarray) -> np.ndarray:
        return 0.5 * (bias(v) + bias(-v)) - gravity

    own = coriolis(v)
    speed = np.abs(v).max(axis=1, keepdims=True)
    speed = np.where(speed > 0.0, speed, 1.0)
    columns = [
        (coriolis(v + speed * unit) - coriolis(v - speed * unit)) / (4.0 * speed)
        for unit in np.eye(len(leg.joint_names))
    ]
    C = np.stack(columns, axis=-1)
    add("Coriolis force = C v", relative(_product(C, v), own, 1), ROUTE_TOLERANCE)
    mass_rate = slope(lambda q: leg.mass_matrix(q, on_error="nan"), q, v)
    add("Mdot - 2C skew", relative(mass_rate, C + np.swapaxes(C, -1, -2), 2), DIFFERENCE_TOLERANCE)

    total = _product(mass, a) + bias(v)
    if force is not None:
        total = total - _product(np.swapaxes(leg.jacobian(q, on_error="nan"), -1, -2), force)
    generalized = leg.generalized_force(q, v, a, force, states.gravity, on_error="nan")
    add("generalized force = M a + h - J'F", relative(generalized, total, 1), ROUTE_TOLERANCE)


def _effort_checks(leg: Leg, states: States, add: Add) -> None:
    q, v, a, gravity = states.q, states.v, states.a, states.gravity
    force = states.foot_force if leg.foot is not None else None
    tau = leg.torque(q, v, a, force, gravity, on_error="nan")
    back = leg.acceleration(q, v, tau, force, gravity, on_error="nan")
    add("acceleration of torque", relative(back, a, 1), ROUTE_TOLERANCE)
    add("power balance", _power_imbalance(leg, states, tau), DIFFERENCE_TOLERANCE)
    if force is None or len(leg.joint_names) != 3:
        return
    J = leg.jacobian(q, on_error="nan")
    sigma = np.full((len(q), 3), np.nan)
    finite = np.isfinite(J).all(axis=(1, 2))
    sigma[finite] = np.linalg.svd(J[finite], compute_uv=False)
    found = leg.foot_force(q, v, a, tau, gravity, on_error="nan")
    errors = relative(found, force, 1)
    errors[sigma[:, 2] < WELL_CONDITIONED * sigma[:, 0]] = 0.0
    add("foot force of torque", errors, ROUTE_TOLERANCE, "relative to 1 + magnitude, where J has an inverse")


def _power_imbalance(leg: Leg, states: States, tau: np.ndarray) -> np.ndarray:
    """Power of actuators and foot force minus friction, against the rate of total energy along q + v t + a t²/2."""
    q, v, a, gravity = states.q, states.v, states.a, states.gravity
    step = DIFFERENCE_STEP / SPEED
    time = step * OFFSETS[:, None]
    path = q[:, None] + time * v[:, None] + 0.5 * time**2 * a[:, None]
    rates = v[:, None] + time * a[:, None]

    def rate(values: np.ndarray) -> np.ndarray:
        return np.tensordot(values, WEIGHTS, (1, 0)) / step

    energy = leg.kinetic_energy(path, rates, on_error="nan") + leg.potential_energy(
        path, gravity[:, None], on_error="nan"
    )
    coordinates = leg.assemble(path, on_error="nan")
    actuated = np.stack([rate(coordinates[name]) for name in leg.backend.actuator_joints], axis=-1)
    power = _dot(tau, actuated)
    if leg.foot is not None:
        foot = np.swapaxes(leg.foot_position(path, on_error="nan"), 1, 2)
        power = power + _dot(states.foot_force, np.stack([rate(foot[:, i]) for i in range(3)], axis=-1))
    friction = 0.5 * (leg.bias(q, v, gravity, on_error="nan") - leg.bias(q, -v, gravity, on_error="nan"))
    taken = _dot(friction, v)
    # Friction that gives energy is no friction.
    taken = np.where(taken < -1e-9 * (1.0 + np.abs(power)), np.nan, taken)
    return relative(power - taken, rate(energy), 0)
