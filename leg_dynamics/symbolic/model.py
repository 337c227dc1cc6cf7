"""What is settled about a mechanism before any graph is made: coordinates, rows, pivots, merged inertia."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from leg_dynamics.description.model import Description
from leg_dynamics.description.topology import actuated_joints
from leg_dynamics.symbolic.closure import Closure, Row, row_arrays, second_derivatives
from leg_dynamics.symbolic.coordinates import Coordinates, Form, Relation, reduce_coordinates
from leg_dynamics.symbolic.dynamics import Body, bodies_of, mass_moment, reduce_inertia, regressor
from leg_dynamics.symbolic.elimination import Pivots, choose_pivots
from leg_dynamics.symbolic.explicit import Explicit, find_explicit
from leg_dynamics.symbolic.motion import Motion, Orientation, Position
from leg_dynamics.symbolic.numbers import Extra, Numbers, is_inertial, with_varied_ratios
from leg_dynamics.symbolic.regularity import Block, Regularity, measured, survey
from leg_dynamics.symbolic.relations import find_relations
from leg_dynamics.symbolic.sampling import ClosureArrays, sample_closed
from leg_dynamics.symbolic.scalars import Scalar
from leg_dynamics.symbolic.seed import find_seed
from leg_dynamics.symbolic.tree import Tree, build_tree, characteristic_length

__all__ = ["Model", "build_model"]

SAMPLES = 240
# Joint limits nearer to each other than this, rad or shares of the mechanism's length, tell too little.
NARROW = 0.2
# Poses that must differ for inertia to be merged; half of them must confirm it.
DISTINCT = 40
SPEED = 3.0
ACCELERATION = 20.0
# Merging is decided where the closure does not magnify rounding.
WELL_CONDITIONED = 1e-2
SINGULAR = 1e-12


@dataclass(frozen=True)
class Model:
    """A mechanism ready to be written out.

    Attributes
    ----------
    coordinates : Coordinates
    tree : Tree
    rows : tuple of Row
        As many as unknowns, in pivot order.
    columns : tuple of int
        The unknown (counted from 0 within z) that each row eliminates.
    signs, sizes : tuple of float
        Of the pivots, see `Pivots`.
    pattern : (nz, nz) bool array
    checked, same_way : tuple of Row
        What every row of a batch is checked with: all a loop says, and axes that must not be reversed.
    seed : (nu,) array
        The closed state that defines the assembly mode.
    samples : (S, nu) array
        Closed states of that mode.
    directions : (S, nu, n) array
        du/dy at the samples; NaN where the chosen rows are singular.
    bodies : tuple of Body
        With merged inertia.
    moment : Position
        First moment of all masses about the hip's origin, kg·m.
    foot : Position or None
    ground : Orientation
        Of the hip frame.
    actuated : tuple of str
    numbers : Numbers
    explicit : Explicit or None
        How to close the loops without iteration, where that is possible.
    regularity : Regularity or None
        Where singular poses of the closure are; None where there are no loops to close.
    """

    coordinates: Coordinates
    tree: Tree
    rows: tuple[Row, ...]
    columns: tuple[int, ...]
    signs: tuple[float, ...]
    sizes: tuple[float, ...]
    pattern: np.ndarray
    checked: tuple[Row, ...]
    same_way: tuple[Row, ...]
    seed: np.ndarray
    samples: np.ndarray
    directions: np.ndarray
    bodies: tuple[Body, ...]
    mass: Scalar
    moment: Position
    foot: Position | None
    ground: Orientation
    actuated: tuple[str, ...]
    numbers: Numbers
    explicit: Explicit | None
    regularity: Regularity | None

    @property
    def n(self) -> int:
        """Number of independent coordinates."""
        return self.coordinates.n

    @property
    def nz(self) -> int:
        """Number of unknowns."""
        return self.coordinates.unknowns

    @property
    def extras(self) -> list[Extra]:
        """Coordinates beside u that stand for parameters."""
        return self.numbers.extras.found

    @property
    def iterates(self) -> bool:
        """Whether closing the loops needs Newton's method."""
        return self.nz > 0 and self.explicit is None

    @property
    def walks(self) -> bool:
        """Whether every pose must be walked to, because singular poses lie between some of them and home."""
        return self.regularity is not None and self.regularity.crosses

    @property
    def unit(self) -> np.ndarray:
        """Of u: 1 for angles, the characteristic length (m) for displacements; (nu,)."""
        by_name = {joint.name: joint.unit for joint in self.tree.joints}
        return np.array([by_name[name] for name in self.coordinates.names])

    @property
    def restarts(self) -> bool:
        """Whether Newton's method starts from any closed pose that it is given."""
        return self.iterates and not self.walks


def search_box(description: Description, names: Sequence[str], length: float) -> tuple[np.ndarray, np.ndarray]:
    """Joint limits, cut to half a turn and to four lengths of the mechanism either way.

    What is found from samples must not be a coincidence of poses that are all the same: a narrow range is widened.
    """
    lower, upper = [], []
    for name in names:
        joint = description.joint(name)
        turns = joint.unit == "rad"
        reach = math.pi if turns else 4.0 * length
        low, high = joint.limits.lower, joint.limits.upper
        low, high = max(low, -reach) if high > -reach else low, min(high, reach) if low < reach else high
        lacking = max(NARROW * (1.0 if turns else length) - (high - low), 0.0)
        lower.append(low - 0.5 * lacking)
        upper.append(high + 0.5 * lacking)
    return np.array(lower), np.array(upper)


def _units(tree: Tree, coordinates: Coordinates) -> np.ndarray:
    by_name = {joint.name: joint.unit for joint in tree.joints}
    return np.array([by_name[name] for name in coordinates.names])


def build_model(
    description: Description,
    foot: str | None = None,
    hip: str | None = None,
    *,
    seed: Mapping[str, float] | None = None,
    parameters: Sequence[str] = (),
    simplify: bool = True,
) -> Model:
    """Settle coordinates, rows, pivots and inertia of a mechanism.

    Parameters
    ----------
    description : Description
    foot, hip : str or None
        Link whose origin is the foot; link in whose frame foot quantities, forces and gravity are expressed.
    seed : mapping of str to float, optional
        Tree coordinates of a closed pose where the file has no usable configuration.
    parameters : sequence of str
        Numbers that become symbols, see `leg_dynamics.symbolic.numbers.parameter_names`. Relations between joints hold
        for one geometry only, merged inertia for one set of masses: with such parameters they are not used.
    simplify : bool
        Use relations between joints and merge inertia.

    Raises
    ------
    AssemblyError, DescriptionError, SingularityError, UnsupportedError
        The mechanism has no defined assembly mode, is inconsistent, singular at its seed, or has joints with several
        coordinates.
    """
    geometric = any(not is_inertial(description, name) for name in parameters)
    simplify = simplify and not geometric
    length = characteristic_length(description)
    plain = Numbers.of(description)
    coordinates = reduce_coordinates(description)
    tree = build_tree(description, coordinates, plain, hip, length)
    closure = Closure(description, tree)
    arrays = ClosureArrays(closure, coordinates.n, _units(tree, coordinates))
    state = find_seed(description, coordinates, arrays, seed)
    lower, upper = search_box(description, coordinates.names[: coordinates.n], length)
    samples, ways = sample_closed(arrays, state, lower, upper, SAMPLES)
    regularity = None
    if ways is not None:
        regularity = survey(arrays, state, ways, lower, upper, _turns(description, coordinates))
        if regularity.crosses:
            block = _block(closure, coordinates, samples, arrays.unit)
            regularity = measured(regularity, block, ways)
    original = coordinates.names
    if simplify and coordinates.unknowns:
        relations: list[Relation] = find_relations(coordinates, samples, arrays.unit)
        if relations:
            reduced = reduce_coordinates(description, relations)
            order = [coordinates.names.index(name) for name in reduced.names]
            smaller = build_tree(description, reduced, plain, hip, length)
            closed = Closure(description, smaller)
            residual, _ = row_arrays(closed.basic, samples[:, order])
            if np.abs(residual).max(initial=0.0) < 1e-12:
                coordinates, tree, closure = reduced, smaller, closed
                state, samples = state[order], samples[:, order]
    unit = _units(tree, coordinates)
    n = coordinates.n
    _, K = row_arrays(closure.candidates, samples)
    K *= unit
    pivots = Pivots((), (), (), (), np.zeros((0, 0), dtype=bool), 1.0)
    if coordinates.unknowns:
        costs = [row.cost for row in closure.candidates]
        pivots = choose_pivots(K[:, :, n:], costs, [row.reference for row in closure.candidates])
    frames = closure.frames()
    bodies: list[Body] = bodies_of(tree, frames)
    directions = _directions(K[:, list(pivots.rows)], unit, n)
    rows = tuple(closure.candidates[row] for row in pivots.rows)
    pattern = pivots.pattern
    if simplify and not parameters and _are_varied(samples[:, :n] / unit[:n]):
        bodies = _merged(bodies, rows, K[:, list(pivots.rows)], samples, unit, n)
    explicit = None
    if simplify and coordinates.unknowns and not (regularity is not None and regularity.crosses):
        explicit = find_explicit(closure.candidates, n, samples)
    numbers = plain
    if parameters:
        numbers = plain.with_symbols(parameters, len(coordinates.names))
        if geometric:
            coordinates = with_varied_ratios(description, coordinates, numbers)
        tree = build_tree(description, coordinates, numbers, hip, length)
        if geometric:
            closure = Closure(description, tree)
            frames = closure.frames()
            by_name = {row.name: row for row in closure.candidates}
            rows = tuple(by_name[row.name] for row in rows)
            # Entries that vanish for these numbers need not vanish for others.
            pattern = np.ones_like(pattern)
        bodies = bodies_of(tree, frames)
    if regularity is not None and regularity.block is not None:
        # Its rows are those of the unknowns before relations, which are not used where numbers change the geometry.
        block = replace(regularity.block, forms=tuple(coordinates.forms[name] for name in original))
        if geometric:
            block = replace(block, rows=tuple(by_name[row.name] for row in block.rows))
        regularity = replace(regularity, block=block)
    mass, moment = mass_moment(bodies_of(tree, frames), tree.length)
    foot_at = None if foot is None else frames.place(tree.links[foot])[1]
    return Model(
        coordinates,
        tree,
        rows,
        pivots.columns,
        pivots.signs,
        pivots.sizes,
        pattern,
        tuple(closure.basic),
        tuple(closure.same_way),
        state,
        samples,
        directions,
        tuple(bodies),
        mass,
        moment,
        foot_at,
        frames.root,
        actuated_joints(description),
        numbers,
        explicit,
        regularity,
    )


def _turns(description: Description, coordinates: Coordinates) -> np.ndarray:
    """Whether a whole turn of each independent coordinate is one of every joint that it turns by a coupling, (n,)."""
    whole = np.array([description.joint(name).unit == "rad" for name in coordinates.names[: coordinates.n]])
    for form in coordinates.forms.values():
        for k, coefficient in form.terms:
            if k < coordinates.n and not float(coefficient).is_integer():
                whole[k] = False
    return whole


def _block(closure: Closure, coordinates: Coordinates, samples: np.ndarray, unit: np.ndarray) -> Block:
    """Rows that determine the unknowns in as many samples as possible."""
    n = coordinates.n
    _, K = row_arrays(closure.candidates, samples)
    costs = [row.cost for row in closure.candidates]
    pivots = choose_pivots((K * unit)[:, :, n:], costs, [row.reference for row in closure.candidates])
    columns = tuple(n + column for column in pivots.columns)
    return Block(
        tuple(closure.candidates[row] for row in pivots.rows),
        columns,
        tuple(float(unit[column]) for column in columns),
        tuple(Form(((k, 1.0),)) for k in range(len(unit))),
    )


def _directions(K: np.ndarray, unit: np.ndarray, n: int) -> np.ndarray:
    """du/dy (S, nu, n) from the chosen rows K (S, nz, nu), in units of `unit`; NaN where they are singular."""
    count, unknowns, size = len(K), K.shape[1], len(unit)
    result = np.full((count, size, n), np.nan)
    regular = np.arange(count)
    if unknowns:
        sigma = np.linalg.svd(K[:, :, n:], compute_uv=False)
        regular = np.flatnonzero(sigma[:, -1] > SINGULAR * sigma[:, 0])
    result[regular, :n] = np.eye(n)
    if unknowns:
        solved = np.linalg.solve(K[regular][:, :, n:], K[regular][:, :, :n] / unit[:n])
        result[regular, n:] = -solved * unit[n:, None]
    return result


def _are_varied(y: np.ndarray) -> bool:
    """Whether samples (S, n), without units, differ by enough to tell what holds for all poses from a coincidence."""
    distinct = np.unique(y.round(6), axis=0)
    return bool(len(distinct) >= DISTINCT and np.ptp(y, axis=0).min(initial=np.inf) >= 0.5 * NARROW)


def _merged(
    bodies: list[Body],
    rows: Sequence[Row],
    K: np.ndarray,
    samples: np.ndarray,
    unit: np.ndarray,
    n: int,
) -> list[Body]:
    """Bodies with merged inertia, from random closed motions; K (S, nz, nu) belongs to `rows`, in units of `unit`."""
    generator = np.random.default_rng(1)
    size = samples.shape[1]
    good = np.arange(len(samples))
    if size > n:
        sigma = np.linalg.svd(K[:, :, n:], compute_uv=False)[:, -1]
        good = np.flatnonzero(sigma > WELL_CONDITIONED * sigma.max())
    u, K, count = samples[good], K[good], len(good)
    directions = _directions(K, unit, n)
    rates = np.einsum("skn,sn->sk", directions, unit[:n] * generator.uniform(-SPEED, SPEED, (count, n)))
    pushes = unit[:n] * generator.uniform(-ACCELERATION, ACCELERATION, (count, n))
    accelerations = np.einsum("skn,sn->sk", directions, pushes)
    if size > n:
        columns = range(size)
        motion = Motion([u[:, k] for k in columns], [rates[:, k] for k in columns], [0.0] * size)
        drift = np.zeros((count, size - n, 1))
        for i, value in enumerate(second_derivatives(rows, motion)):
            drift[:, i, 0] = value
        accelerations[:, n:] -= np.linalg.solve(K[:, :, n:], drift)[:, :, 0] * unit[n:]
    gravity = generator.uniform(-10.0, 10.0, (count, 3))
    return reduce_inertia(bodies, regressor(bodies, u, rates, accelerations, gravity, directions))
