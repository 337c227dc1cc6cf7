"""Newton-Euler dynamics by virtual work over the orientations of the bodies.

Every body exerts a force F at its origin and a moment N: tau_k = sum over bodies of dp/du_k . F + domega/du_k . N.
Positions are sums of arms p = sum O l, so the moments (O l) x F are collected by orientation and projected on each
turn's axis once. Inertial parameters that the motion cannot tell apart are merged beforehand (`reduce_inertia`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leg_dynamics.symbolic.motion import Frames, Motion, Orientation, Position
from leg_dynamics.symbolic.scalars import (
    ZERO,
    Scalar,
    Vector,
    add,
    add_vectors,
    cross,
    dot,
    is_zero,
    matvec,
    mul,
    scale,
    sub_vectors,
)
from leg_dynamics.symbolic.tree import BodyInertia, Tree, symmetric

__all__ = ["Body", "Load", "bodies_of", "mass_moment", "project", "reduce_inertia", "tree_loads"]

PARAMETERS = 10
# A column this much shorter after projection, relative to itself, says nothing new; the gap to the next is checked.
DEPENDENT = 1e-9
EXACT = 1e-11
NO_VALUE = 1e-14
# Of singular values, relative to the largest: columns that the samples tell apart by less are not merged.
WEAKEST = 1e-5
BALANCINGS = 3
# Of a coordinate's largest force: what merged bodies may differ by, a hundred times less in the legs that are shipped.
CONFIRMED = 1e-13
# The search for the cheapest combination: rounds, and shares of the largest term that count as small and as nothing.
REWEIGHTINGS = 4
SMALL_SHARE = 1e-3
NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class Body:
    """A body's orientation, origin and inertia in the axes of that orientation."""

    orientation: Orientation
    origin: Position
    inertia: BodyInertia


@dataclass(frozen=True)
class Load:
    """What the surroundings exert on a body: a force at `origin` (None: no force), a moment on `orientation`."""

    origin: Position | None
    force: Vector
    orientation: Orientation
    moment: Vector


def bodies_of(tree: Tree, frames: Frames) -> list[Body]:
    """The moving bodies, those without inertia left out.

    A body that only differs by a constant rotation from a word's last turn is described in that turn's axes.
    """
    bodies = []
    for number, inertia in enumerate(tree.inertia):
        if all(is_zero(value) for value in inertia.values()):
            continue
        orientation, origin = frames.body(number)
        if orientation.axis is None and orientation.parent is not None:
            assert orientation.matrix is not None
            bodies.append(Body(orientation.parent, origin, inertia.turned(orientation.matrix)))
        else:
            bodies.append(Body(orientation, origin, inertia))
    return bodies


def _load(body: Body, motion: Motion, gravity: Vector) -> Load:
    """Force and moment about the body's origin that its motion needs."""
    inertia, node = body.inertia, body.orientation
    force: Vector = ZERO
    moment: Vector = ZERO
    has_first = not all(is_zero(x) for x in inertia.first)
    if has_first or not is_zero(inertia.mass):
        acceleration = sub_vectors(motion.acceleration(body.origin), gravity)
        force = scale(inertia.mass, acceleration)
        if has_first:
            arm = motion.arm(node, inertia.first)
            if node.parent is not None:
                force = add_vectors(force, matvec(motion.gyration(node), arm))
                moment = cross(arm, acceleration)
    if node.parent is not None and not all(is_zero(x) for x in inertia.second):
        spin, rate = motion.local_spin(node)
        second = symmetric(inertia.second)
        local = add_vectors(matvec(second, rate), cross(spin, matvec(second, spin)))
        moment = add_vectors(moment, motion.arm(node, local))
    return Load(body.origin, force, node, moment)


def tree_loads(bodies: Sequence[Body], motion: Motion, gravity: Vector) -> list[Load]:
    """Loads of all bodies for the motion's u, rates and accelerations; gravity in reference axes."""
    return [_load(body, motion, gravity) for body in bodies]


def project(loads: Sequence[Load], motion: Motion, size: int) -> list[Scalar]:
    """Generalised forces of loads at each of u's coordinates, (size,), N·m or N."""
    forces: dict[tuple[Orientation, int | None, tuple[object, ...]], tuple[Vector, Vector]] = {}
    moments: dict[Orientation, Vector] = {}
    # From the last body: sums of forces are then those of the outer part of each chain, and are shared.
    for load in reversed(loads):
        if load.origin is not None and not all(is_zero(x) for x in load.force):
            for (node, k), vector in load.origin.terms.items():
                key = (node, k, tuple(x if isinstance(x, float) else id(x) for x in vector))
                _, summed = forces.get(key, (vector, ZERO))
                forces[key] = (vector, add_vectors(summed, load.force))
        if not all(is_zero(x) for x in load.moment):
            moments[load.orientation] = add_vectors(moments.get(load.orientation, ZERO), load.moment)
    tau: list[Scalar] = [0.0] * size
    for (node, k, _), (vector, force) in forces.items():
        if k is not None:
            tau[k] = add(tau[k], dot(motion.arm(node, vector), force))
        if node.parent is not None:
            arm = motion.arm(node, vector)
            lever = arm if k is None else scale(motion.u[k], arm)
            moments[node] = add_vectors(moments.get(node, ZERO), cross(lever, force))
    # Inwards: the moment on a word is also one on the words before it.
    pending = sorted(moments, key=_length, reverse=True)
    handled: set[Orientation] = set()
    while pending:
        node = pending.pop(0)
        if node in handled or node.parent is None:
            continue
        handled.add(node)
        moment = moments[node]
        if node.axis is not None:
            assert node.form is not None
            along = dot(motion.axis(node), moment)
            for k, coefficient in node.form.terms:
                tau[k] = add(tau[k], mul(coefficient, along))
        if node.parent.parent is not None or node.parent.axis is not None:
            moments[node.parent] = add_vectors(moments.get(node.parent, ZERO), moment)
            if node.parent not in pending:
                pending.append(node.parent)
                pending.sort(key=_length, reverse=True)
    return tau


def _length(node: Orientation) -> int:
    length, word = 0, node
    while word.parent is not None:
        length, word = length + 1, word.parent
    return length


def mass_moment(bodies: Sequence[Body], size: float) -> tuple[Scalar, Position]:
    """Total mass and first moment as a position: potential energy is -gravity . moment."""
    total: Scalar = 0.0
    moment = Position(size)
    for body in bodies:
        total = add(total, body.inertia.mass)
        for (node, k), vector in body.origin.terms.items():
            moment = moment.plus(node, scale(body.inertia.mass, vector), k)
        moment = moment.plus(body.orientation, body.inertia.first)
    return total, moment


def regressor(
    bodies: Sequence[Body],
    u: np.ndarray,
    rates: np.ndarray,
    accelerations: np.ndarray,
    gravity: np.ndarray,
    directions: np.ndarray,
) -> np.ndarray:
    """Generalised force at the independent coordinates of a unit of each inertial parameter.

    Parameters
    ----------
    bodies : sequence of Body
        b bodies.
    u, rates, accelerations : (S, nu) array
    gravity : (S, 3) array
    directions : (S, nu, n) array
        du/dy.

    Returns
    -------
    (S, n, b, 10) array
    """
    samples, size = u.shape
    motion = Motion(
        [u[:, k] for k in range(size)],
        [rates[:, k] for k in range(size)],
        [accelerations[:, k] for k in range(size)],
    )
    down: Vector = (gravity[:, 0], gravity[:, 1], gravity[:, 2])
    result = np.zeros((samples, directions.shape[2], len(bodies), PARAMETERS))
    for number, body in enumerate(bodies):
        for parameter in range(PARAMETERS):
            values = [0.0] * PARAMETERS
            values[parameter] = 1.0
            unit = BodyInertia(values[0], (values[1], values[2], values[3]), tuple(values[4:]))  # type: ignore[arg-type]
            load = _load(Body(body.orientation, body.origin, unit), motion, down)
            tau = np.zeros((samples, size))
            for k, force in enumerate(project([load], motion, size)):
                tau[:, k] = force
            result[:, :, number, parameter] = np.einsum("sk,skn->sn", tau, directions)
    return result


def _prices(bodies: Sequence[Body]) -> np.ndarray:
    """Work that each inertial parameter causes, (b, 10): what to keep is chosen by it."""
    prices = np.zeros((len(bodies), PARAMETERS))
    for number, body in enumerate(bodies):
        depth, reach = body.orientation.depth, body.origin.cost
        prices[number, 0] = 10.0 + 10.0 * reach
        prices[number, 1:4] = 20.0 + 12.0 * depth + 10.0 * reach
        prices[number, 4:] = 15.0 + 20.0 * depth
        for entry in (1, 2, 4):
            prices[number, 4 + entry] += 4.0
    return prices


def reduce_inertia(bodies: Sequence[Body], columns: np.ndarray) -> list[Body]:
    """Bodies with fewer inertial parameters and the same generalised forces in every closed motion.

    Parameters that the sampled motions cannot tell apart are merged into the cheapest of them; then, for these values,
    the cheapest combination with the same forces is sought. The samples are split: one part finds the
    dependencies, the other must confirm them to rounding, or the bodies stay as they are. So they do where the samples
    tell the parameters that stay apart too weakly.

    Parameters
    ----------
    bodies : sequence of Body
    columns : (S, n, b, 10) array
        See `regressor`.
    """
    count = len(bodies)
    if count == 0:
        return []
    theta = np.array([body.inertia.values() for body in bodies], dtype=float).reshape(-1)
    half = len(columns) // 2
    matrix = columns.reshape(len(columns), -1, count * PARAMETERS)
    learn, confirm = (part.reshape(-1, count * PARAMETERS) for part in (matrix[:half], matrix[half:]))
    price = _prices(bodies).reshape(-1)
    size = np.linalg.norm(learn, axis=0)
    seen = np.flatnonzero(size > EXACT * size.max(initial=0.0))
    unit_columns, weights, size = _balanced(learn[:, seen])
    kept, basis = _independent_columns(unit_columns, price[seen])
    target = weights * (learn @ theta)
    supports = [kept]
    if kept.size < len(learn):
        supports.insert(0, _sparsest(basis.T @ unit_columns, basis.T @ target, price[seen]))
    for support in supports:
        sigma = np.linalg.svd(unit_columns[:, support], compute_uv=False)
        # What the samples hardly tell apart would be merged with few digits, and other poses may tell it apart well.
        if sigma.min(initial=np.inf) < WEAKEST * sigma.max(initial=0.0):
            continue
        solution, *_ = np.linalg.lstsq(unit_columns[:, support], target, rcond=None)
        solution[np.abs(solution) <= NO_VALUE * np.abs(solution).max(initial=0.0)] = 0.0
        merged = np.zeros_like(theta)
        merged[seen[support]] = solution / size[support]
        # Coordinate by coordinate: what is nothing beside a heavy part is all that a light one has.
        error = np.abs(confirm @ (merged - theta)).reshape(-1, columns.shape[1]).max(axis=0, initial=0.0)
        weight = np.abs(confirm * theta).sum(axis=1).reshape(-1, columns.shape[1]).max(axis=0, initial=0.0)
        if (error <= CONFIRMED * weight).all():
            return _with_inertia(bodies, merged.reshape(count, PARAMETERS))
    return list(bodies)


def _balanced(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns of unit length from rows of like weight, the rows' weights, and what the columns were divided by.

    A pose beside a singular one, where small rates move much, would else stand for all.
    """
    weights, size = np.ones(len(columns)), np.ones(columns.shape[1])
    for _ in range(BALANCINGS):
        balanced = weights[:, None] * columns / size
        length = np.linalg.norm(balanced, axis=1)
        weights = weights / np.where(length > 0.0, length, 1.0)
        size = size * np.linalg.norm(weights[:, None] * columns / size, axis=0)
    return weights[:, None] * columns / size, weights, size


def _independent_columns(columns: np.ndarray, price: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The cheapest columns that span all of them, and an orthonormal basis of their space."""
    basis = np.zeros((columns.shape[0], 0))
    kept: list[int] = []
    for k in np.argsort(price, kind="stable").tolist():
        column = columns[:, k]
        for _ in range(2):
            column = column - basis @ (basis.T @ column)
        size = float(np.linalg.norm(column))
        if size > DEPENDENT and basis.shape[1] < basis.shape[0]:
            kept.append(k)
            basis = np.column_stack([basis, column / size])
    return np.array(kept, dtype=np.intp), basis


def _sparsest(columns: np.ndarray, target: np.ndarray, price: np.ndarray) -> np.ndarray:
    """Columns of a cheap combination that equals the target: linear programs with weights that approach a count."""
    from scipy.optimize import linprog

    count = columns.shape[1]
    scale_of = float(np.abs(target).max(initial=0.0))
    if scale_of == 0.0:
        return np.zeros(0, dtype=np.intp)
    weights = price.copy()
    x = np.zeros(count)
    for _ in range(REWEIGHTINGS):
        found = linprog(
            np.concatenate([weights, weights]),
            A_eq=np.hstack([columns, -columns]),
            b_eq=target / scale_of,
            bounds=(0, None),
            method="highs",
        )
        if found.x is None:
            break
        x = found.x[:count] - found.x[count:]
        weights = price / (np.abs(x) + SMALL_SHARE * np.abs(x).max(initial=1.0))
    return np.flatnonzero(np.abs(x) > NEGLIGIBLE * np.abs(x).max(initial=0.0))


def _with_inertia(bodies: Sequence[Body], values: np.ndarray) -> list[Body]:
    result = []
    for body, ten in zip(bodies, values.tolist(), strict=True):
        if any(ten):
            inertia = BodyInertia(ten[0], (ten[1], ten[2], ten[3]), tuple(ten[4:]))
            result.append(Body(body.orientation, body.origin, inertia))
    return result
