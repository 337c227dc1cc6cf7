"""Where the closure is singular: the determinant of the dependent block, and whether the joint limits hold such poses.

Assembly modes meet, or end, where the loop rows lose rank in the dependent joints. What joints do after such a pose is
ambiguous, even if relations between them, or formulas for one loop after another, go on smoothly. So the block is taken
in all the unknowns that couplings leave, before any relation removes some of them.

The measure is the determinant's square f. Along a straight way in the independent coordinates it is smooth both
where two modes cross (f ~ distance²) and at a dead centre (f ~ distance), and never negative before the first of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from leg_dynamics.symbolic.closure import Row, evaluate_rows
from leg_dynamics.symbolic.coordinates import Form
from leg_dynamics.symbolic.elimination import Factor
from leg_dynamics.symbolic.motion import Motion
from leg_dynamics.symbolic.sampling import ClosureArrays, Ways, ways_from
from leg_dynamics.symbolic.scalars import Scalar, add, cos, is_zero, mul, neg, sin, sub

__all__ = ["Block", "Regularity", "determinant", "measured", "survey"]

# Beyond so many partial determinants the product of the pivots is cheaper.
MOST_MINORS = 400
# A pose with less than this share of the usual smallest singular value is near a singular one.
SAFE_SHARE = 0.1
# Boxes around the joint limits that are tried: room, rad or shares of the mechanism's length, and how far a limit at
# zero is moved over, rad; then the ways to each.
ROOMS = ((0.8, 3.0), (0.1, 3.0), (0.02, 3.0), (0.02, 0.8), (0.02, 0.0))
BEYOND = 96
FINER = 0.15
FINEST = 0.03
MOST_LOST = 0.05
# The walk is given up at these shares of the usual and of the seed's determinant²: what is nearer to a singular pose is
# left to the fallback.
FLOOR = 1e-4
SEED_FLOOR = 0.02
# Sampled second derivatives are a lower bound of the largest.
BEND_MARGIN = 1.5
BEND_SHARES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
SMALLEST_BEND = 1e-3
SHORTEST = 0.02


@dataclass(frozen=True)
class Block:
    """Independent loop rows and all unknowns that couplings leave, in pivot order.

    Attributes
    ----------
    rows : tuple of Row
        In terms of `forms`.
    columns : tuple of int
        Index of each unknown among `forms`.
    units : tuple of float
        Of the unknowns: 1 for angles, the mechanism's length for displacements.
    forms : tuple of Form
        The coordinates behind the rows, as forms of the model's u.
    """

    rows: tuple[Row, ...]
    columns: tuple[int, ...]
    units: tuple[float, ...]
    forms: tuple[Form, ...]

    def determinant(self, pose: Motion) -> Scalar:
        """Determinant of the rows' derivatives, dimensionless, at a pose in terms of the model's u."""
        if all(form == Form(((k, 1.0),)) for k, form in enumerate(self.forms)):
            # No relations: the pose itself, with what parameters add to it.
            _, partials = evaluate_rows(self.rows, pose)
        else:
            _, partials = evaluate_rows(self.rows, self._full(pose))
        entries = [
            {
                j: mul(unit, row[column])
                for j, (column, unit) in enumerate(zip(self.columns, self.units, strict=True))
                if column in row and not is_zero(row[column])
            }
            for row in partials
        ]
        return determinant(entries)

    def _full(self, pose: Motion) -> Motion:
        """The pose in all unknowns that couplings leave; sines and cosines are composed, not made again."""
        known = {}
        for k, form in enumerate(self.forms):
            if form.terms:
                s, c = pose.sincos(form.linear)
                if form.constant != 0.0:
                    s0, c0 = sin(form.constant), cos(form.constant)
                    s, c = add(mul(s, c0), mul(c, s0)), sub(mul(c, c0), mul(s, s0))
                known[Form(((k, 1.0),))] = (s, c)
        return Motion([form.of(pose.u) for form in self.forms], sincos=known)


def determinant(rows: Sequence[dict[int, Scalar]]) -> Scalar:
    """Determinant of a sparse square matrix, without divisions unless that takes too many products."""
    minors: dict[int, Scalar] = {0: 1.0}
    for row in rows:
        following: dict[int, Scalar] = {}
        for used, minor in minors.items():
            for j, entry in row.items():
                if used >> j & 1:
                    continue
                # Each column to the right that is taken already is one interchange.
                odd = (used >> (j + 1)).bit_count() % 2
                term = mul(minor, entry)
                key = used | 1 << j
                following[key] = add(following.get(key, 0.0), neg(term) if odd else term)
        if len(following) > MOST_MINORS:
            result: Scalar = 1.0
            for pivot in Factor(rows).pivots:
                result = mul(result, pivot)
            return result
        minors = following
    return minors.get((1 << len(rows)) - 1, 0.0)


@dataclass(frozen=True)
class Regularity:
    """What is known of the closure's singular poses on straight ways from home.

    Attributes
    ----------
    crosses : bool
        Whether ways inside the joint limits meet singular poses, or come so near that each way must be checked.
    lower, upper : (n,) array
        Where it is known that they do not: the joint limits and some room around them. Infinite for angles that may
        go round and round. Without meaning where `crosses`.
    block : Block or None
        Whose determinant tells, where `crosses`.
    sign : float
        The determinant's at home. It changes where a way leaves its assembly mode.
    scale : float
        Usual size of the determinant squared.
    floor : float
        Share of `scale` that counts as singular.
    bend, bend_share : float
        Bound of how f / scale falls: its second derivative along a way is at least -(bend + bend_share f / scale),
        per unit of scaled distance squared.
    """

    crosses: bool
    lower: np.ndarray
    upper: np.ndarray
    block: Block | None = None
    sign: float = 1.0
    scale: float = 1.0
    floor: float = 0.0
    bend: float = 0.0
    bend_share: float = 0.0


def _meet_singular(arrays: ClosureArrays, ways: Ways) -> bool:
    """Whether ways come near a singular pose, or cannot be followed to their ends."""
    lost = ~ways.following[-1]
    if lost.mean() > MOST_LOST:
        return True
    poses = ways.poses[:, ~lost]
    smallest = _smallest(arrays, poses)
    usual = float(np.median(smallest))
    if lost.any():
        # Perhaps the steps were too long.
        again = ways_from(arrays, ways.poses[0, 0], ways.target[lost], FINEST, all_or_none=True)
        if not again.following[-1].all():
            return True
        smallest = np.concatenate([smallest, _smallest(arrays, again.poses)])
    return bool(smallest.min() < SAFE_SHARE * usual)


def _smallest(arrays: ClosureArrays, poses: np.ndarray) -> np.ndarray:
    """Smallest singular values of the dependent block at poses (..., nu), as a flat array."""
    _, K = arrays.rows(poses.reshape(-1, poses.shape[-1]))
    return np.asarray(np.linalg.svd(K[:, :, arrays.n :], compute_uv=False)[:, -1])


def survey(
    arrays: ClosureArrays,
    seed: np.ndarray,
    ways: Ways,
    lower: np.ndarray,
    upper: np.ndarray,
    turns: np.ndarray,
) -> Regularity:
    """Judge the joint limits by ways from home that fill them, and find how far beyond nothing changes.

    Parameters
    ----------
    arrays : ClosureArrays
        In all unknowns that couplings leave.
    seed : (nu,) array
    ways : Ways
        To random poses in the box of the joint limits.
    lower, upper : (n,) array
        That box.
    turns : (n,) bool array
        Whether whole turns of an independent coordinate change nothing.
    """
    n = arrays.n
    if _meet_singular(arrays, ways):
        return Regularity(True, lower, upper)
    generator = np.random.default_rng(2)
    for room, mirrored in ROOMS:
        around = room * arrays.unit[:n]
        # A limit at zero is where a leg is straight: what lies on the other side is often asked for.
        low = np.where(turns & (lower == 0.0), -np.minimum(mirrored, upper), lower) - around
        high = np.where(turns & (upper == 0.0), np.minimum(mirrored, -lower), upper) + around
        target = generator.uniform(low, high, (BEYOND, n))
        # Half of them on the faces: there the box ends.
        rows = np.arange(BEYOND // 2)
        side = generator.integers(n, size=len(rows))
        target[rows, side] = np.where(generator.random(len(rows)) < 0.5, low[side], high[side])
        if not _meet_singular(arrays, ways_from(arrays, seed, target, FINER)):
            whole = turns & (low <= -np.pi) & (high >= np.pi)
            return Regularity(False, np.where(whole, -np.inf, low), np.where(whole, np.inf, high))
    return Regularity(False, lower, upper)


def measured(regularity: Regularity, block: Block, ways: Ways) -> Regularity:
    """Add what a walk along a way needs to know of the block's determinant; `block` in terms of the ways' poses."""
    count = ways.poses.shape[0] * ways.poses.shape[1]
    flat = ways.poses.reshape(count, -1)
    value = block.determinant(Motion([flat[:, k] for k in range(flat.shape[1])]))
    values = np.broadcast_to(np.asarray(value, dtype=float), count).reshape(ways.following.shape)
    f = values**2
    scale = float(np.median(f[ways.following]))
    if not scale > 0.0:
        scale = 1.0
    share = np.where(ways.following, f / scale, np.nan)
    long = ways.distance > SHORTEST
    falls = -(share[2:, long] - 2.0 * share[1:-1, long] + share[:-2, long]) / ways.distance[long] ** 2
    known = np.isfinite(falls)
    bend, bend_share = _envelope(share[1:-1, long][known], falls[known])
    return replace(
        regularity,
        block=block,
        sign=float(np.sign(values[0, 0])),
        scale=scale,
        floor=min(FLOOR, SEED_FLOOR * float(share[0, 0])),
        bend=bend,
        bend_share=bend_share,
    )


def _envelope(values: np.ndarray, falls: np.ndarray) -> tuple[float, float]:
    """The bound falls <= a + b values that lets walks make the longest steps, with a margin."""
    best, found = np.inf, (1.0, 1.0)
    for b in BEND_SHARES:
        a = max(float((falls - b * values).max(initial=0.0)), SMALLEST_BEND)
        steps = np.sqrt((a + b * values) / np.maximum(values, 1e-12))
        price = float(steps.mean()) if steps.size else a
        if price < best:
            best, found = price, (BEND_MARGIN * a, BEND_MARGIN * b)
    return found
