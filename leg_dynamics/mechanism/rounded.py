"""Loops that close but for the rounding of their file's numbers.

Where loops say the same thing more than once, numbers with few digits make them contradict each other: a planar loop of
hinges whose axes are 3.7e-6 rad from parallel (an angle of 1.5708) is a rigid frame to the letter. What was meant is
found by leaving out the rows that count by no more than that, and poses are those of the smallest residual.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import Mechanism

__all__ = ["GREATEST_GAP", "Gap", "closing_gap", "doubtful_share", "open_loops", "settle"]

# Residuals, rad or shares of the mechanism's length: above this they are no rounding.
GREATEST_GAP = 3e-4
# Singular values of the rows, relative to the largest, columns of unit length: below this they may be of rounding's
# making, and below that they are zero.
DOUBTFUL_SHARE = 3e-3
ZERO_SHARE = 1e-9
# Of exactly closed poses: numbers with four digits make rows that count by less.
SMALL_SHARE = 3e-4
SHORTEST = 1e-3
NEIGHBOURS = 6
SPREAD = 0.2
ATTEMPTS = 20
ITERATIONS = 60
LONGEST_STEP = 0.5
SETTLED = 1e-11


def _scaled(mechanism: Mechanism, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residual, rows with columns of unit length, and those lengths: short links alone do not make rows small.

    Columns that are shorter still stay short: of a hinge that turns nothing but rounding.
    """
    rows = mechanism.evaluate(q)
    K = rows.jacobian * mechanism.closure.coordinate_unit
    length = np.linalg.norm(K, axis=0)
    length = np.maximum(length, SHORTEST * max(1.0, float(length.max(initial=0.0))))
    return rows.residual, K / length, length


def _shares(K: np.ndarray) -> np.ndarray:
    """Singular values of rows relative to the largest, or to one where all are smaller."""
    sigma: np.ndarray = np.linalg.svd(K, compute_uv=False)
    return sigma / max(1.0, float(sigma.max(initial=0.0)))


def doubtful_share(mechanism: Mechanism, q: np.ndarray) -> float:
    """By how little a row counts at a pose, q (nv,), where rounding may be all that it counts by; else 0."""
    share = _shares(_scaled(mechanism, q)[1])
    return float(share[(share > ZERO_SHARE) & (share < DOUBTFUL_SHARE)].max(initial=0.0))


def settle(mechanism: Mechanism, q: np.ndarray, share: float) -> tuple[np.ndarray, float] | None:
    """The nearest pose of smallest residual.

    Parameters
    ----------
    mechanism : Mechanism
    q : (nv,) array
        Tree coordinates to start from.
    share : float
        Rows that count by less than this do not move it.

    Returns
    -------
    (nv,) array, float
        The pose and its largest residual; None where the steps come to no end.
    """
    unit = mechanism.closure.coordinate_unit
    for _ in range(ITERATIONS):
        residual, K, length = _scaled(mechanism, q)
        step = np.linalg.lstsq(K, -residual, rcond=share)[0] / length
        largest = float(np.abs(step).max(initial=0.0))
        if not largest < np.inf:
            return None
        if largest <= SETTLED:
            return q, float(np.abs(residual).max(initial=0.0))
        q = q + unit * step * min(1.0, LONGEST_STEP / largest)
    return None


@dataclass(frozen=True)
class Gap:
    """What rounding of a file's numbers leaves of its loops.

    Attributes
    ----------
    residual : float
        Largest residual that the loops keep at their best poses, rad or shares of `Closure.length`.
    share : float
        Rows that contradict each other count by no more than this, relative to the largest singular value.
    loops : tuple of str
        Loops and couplings that keep most of the residual.
    exact : bool
        Whether rows that count by little are known to be meant.
    """

    residual: float = 0.0
    share: float = 0.0
    loops: tuple[str, ...] = ()
    exact: bool = False


def closing_gap(mechanism: Mechanism, start: np.ndarray, meant: Collection[int] = (), seed: int = 0) -> Gap:
    """Whether rounding keeps the loops from closing, and by how much.

    Where they close to the last digit, rows that count by little may still be rounding's: a mechanism of two motions
    can keep one that is exact. Then the number of motions that is meant decides, and where that is neither, the size.

    Parameters
    ----------
    mechanism : Mechanism
        Only its rows are used, not what is independent.
    start : (nv,) array
        Tree coordinates near closed ones.
    meant : collection of int
        Numbers of motions that the file speaks for, the surest first: of flags, of drives.
    seed : int
        Of the poses that are tried.

    Returns
    -------
    Gap
        Zero where the loops close to the last digit, or not even nearly.
    """
    if not mechanism.closure.loops:
        return Gap()
    from leg_dynamics.mechanism.mobility import project

    generator = np.random.default_rng(seed)
    unit = mechanism.closure.coordinate_unit
    guesses = [start, *(start + SPREAD * unit * generator.standard_normal(mechanism.nv) for _ in range(NEIGHBOURS))]
    closed = []
    for guess in guesses:
        pose = project(mechanism, guess, exactly=True)
        if pose is not None:
            if not doubtful_share(mechanism, pose):
                return Gap()
            closed.append(pose)
    if closed:
        is_exact = _is_exact(mechanism, closed, meant)
        if is_exact is not False:
            return Gap(exact=is_exact is True)
    lower, upper = mechanism.search_box()
    guesses += [generator.uniform(lower, upper) for _ in range(ATTEMPTS)]
    found: list[tuple[float, np.ndarray]] = []
    for guess in guesses:
        settled = settle(mechanism, guess, DOUBTFUL_SHARE)
        if settled is not None and settled[1] <= GREATEST_GAP:
            found.append((settled[1], settled[0]))
        if len(found) > NEIGHBOURS:
            break
    residual, worst = max(found, key=lambda each: each[0], default=(0.0, start))
    if not residual:
        return Gap()
    return Gap(residual, max(_smallest_shares(mechanism, pose) for _, pose in found), open_loops(mechanism, worst))


def _smallest_shares(mechanism: Mechanism, q: np.ndarray) -> float:
    """Largest of the singular values that rounding may have made, relative to the largest of all."""
    share = _shares(mechanism.evaluate(q).jacobian * mechanism.closure.coordinate_unit)
    return float(share[share < DOUBTFUL_SHARE].max(initial=0.0))


def _is_exact(mechanism: Mechanism, closed: list[np.ndarray], meant: Collection[int]) -> bool | None:
    """Whether rows that count by little at exactly closed poses are meant to count.

    None where they are not, and count by more than what is taken for rounding.
    """
    # Of the poses that tell most; at the others a motion more may be free.
    counts = []
    for q in closed:
        share = _shares(_scaled(mechanism, q)[1])
        counts.append([mechanism.nv - int(np.count_nonzero(share > least)) for least in (ZERO_SHARE, DOUBTFUL_SHARE)])
    exact, nearly = np.min(counts, axis=0).tolist()
    is_large = max(doubtful_share(mechanism, q) for q in closed) > SMALL_SHARE
    # That nothing moves is what rounding makes of a mechanism: no number speaks for it.
    possible = (exact, nearly) if exact > 0 else (nearly,)
    known = [number for number in meant if number in possible]
    if exact > 0 and (known[0] == exact if known else is_large):
        return True
    return None if is_large else False


def open_loops(mechanism: Mechanism, q: np.ndarray) -> tuple[str, ...]:
    """Names of the loops and couplings that keep most of the residual at a pose, q (nv,)."""
    residual = np.abs(mechanism.evaluate(q).residual)
    owners = np.array(mechanism.closure.row_owner)
    return tuple(dict.fromkeys(owners[residual > 0.1 * residual.max(initial=0.0)].tolist()))
