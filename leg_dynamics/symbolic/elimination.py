"""A static elimination for the unknowns: which rows, in which order, chosen once from many closed states.

The order is found by Gaussian elimination on all sampled states at the same time. A pivot is as good as its smallest
value over the samples, counted in the sign that it has at the seed, relative to its row; among the good ones the one
with the least fill-in and the cheapest row is taken. The elimination is then written out on symbols, entry by entry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leg_dynamics.errors import SingularityError
from leg_dynamics.symbolic.scalars import Scalar, is_zero, mul, sub

__all__ = ["Factor", "Pivots", "choose_pivots"]

# Entries below this share of their row, in all samples, are zeros of the mechanism.
STRUCTURAL_ZERO = 1e-12
# Samples near a singular pose, which a mode may contain, must not decide: this share of them is left aside.
LEFT_ASIDE = 0.02
# How much worse than the best a pivot may be if it is cheaper: several are tried.
ACCEPTED_SHARES = (0.25, 0.6, 0.95)
VALID_SHARE = 0.01
USABLE = 1e-6
SMALLEST_QUALITY = 1e-9
NEW_REFERENCE = 8.0


@dataclass(frozen=True)
class Pivots:
    """A static elimination order.

    Attributes
    ----------
    rows : tuple of int
        Candidates chosen, in pivot order.
    columns : tuple of int
        The unknown that each eliminates.
    signs : tuple of float
        Sign of each pivot at the seed.
    sizes : tuple of float
        Typical size of each pivot's row: what "small" is relative to.
    pattern : (nz, nz) bool array
        Which entries are not zero, rows and columns in pivot order.
    valid : float
        Share of the samples in which every pivot has the seed's sign and a usable size.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    signs: tuple[float, ...]
    sizes: tuple[float, ...]
    pattern: np.ndarray
    valid: float


def choose_pivots(K: np.ndarray, costs: Sequence[float], references: Sequence[object]) -> Pivots:
    """Choose rows and an elimination order: the cheapest of those that serve the most samples.

    Parameters
    ----------
    K : (S, r, nz) array
        Derivatives of the candidate rows with respect to the unknowns at closed states, the seed first.
    costs : sequence of float
        Work to evaluate each row.
    references : sequence
        Frame that each row is written in: rows of frames already in use are cheaper.

    Raises
    ------
    SingularityError
        The rows do not determine the unknowns at the seed.
    """
    orders = [_choose(K, costs, references, share) for share in ACCEPTED_SHARES]
    most = max(order.valid for order in orders)
    return next(order for order in orders if order.valid >= most - VALID_SHARE)


def _choose(K: np.ndarray, costs: Sequence[float], references: Sequence[object], accepted_share: float) -> Pivots:
    samples, _, unknowns = K.shape
    size = np.linalg.norm(K, axis=2)
    reduced = K.copy()
    usable = size[0] > STRUCTURAL_ZERO
    relative = np.where(size > 0.0, size, 1.0)[:, :, None]
    open_columns = np.ones(unknowns, dtype=bool)
    in_use: set[object] = set()
    rows: list[int] = []
    columns: list[int] = []
    aside = int(LEFT_ASIDE * samples)
    structural_cost = np.array(costs, dtype=float)
    for _ in range(unknowns):
        share = reduced / relative
        signed = share * np.sign(reduced[0])
        quality = np.partition(signed, aside, axis=0)[aside]
        # Mixed signs in the samples left aside count as well, if nothing better is there.
        at_seed = np.abs(share[0])
        quality = np.where(at_seed > SMALLEST_QUALITY, quality, -np.inf)
        quality[~usable] = -np.inf
        quality[:, ~open_columns] = -np.inf
        best = float(quality.max(initial=-np.inf))
        if not best > -np.inf:
            sigma = np.linalg.svd(K[0], compute_uv=False)
            raise SingularityError(
                "the loops do not determine the dependent joints at the seed: choose other independent joints or "
                "another configuration",
                margin=float(sigma[-1]) if sigma.size else 0.0,
            )
        present: np.ndarray = np.max(np.abs(share), axis=0) > STRUCTURAL_ZERO
        count = present[:, open_columns].sum(axis=1)
        extra = np.array([0.0 if reference in in_use else NEW_REFERENCE for reference in references])
        price = 6.0 * (count - 1) + structural_cost + extra
        accepted = quality >= (accepted_share * best if best > 0.0 else best)
        order = np.where(accepted, price[:, None] - 1e-3 * quality, np.inf)
        i, j = (int(x) for x in np.unravel_index(np.argmin(order), order.shape))
        rows.append(i)
        columns.append(j)
        in_use.add(references[i])
        usable[i] = False
        open_columns[j] = False
        pivot = reduced[:, i, j]
        pivot = np.where(pivot == 0.0, 1e-300, pivot)
        with np.errstate(over="ignore", invalid="ignore"):
            factor = reduced[:, :, j] / pivot[:, None]
            reduced = reduced - factor[:, :, None] * reduced[:, i, None, :]
        reduced[:, :, j] = 0.0
        reduced = np.where(np.isfinite(reduced), reduced, 0.0)
        # Rounding left by the elimination is not a new entry.
        small = np.abs(reduced) <= STRUCTURAL_ZERO * relative
        reduced = np.where(small.all(axis=0), 0.0, reduced)
    chosen = K[:, rows][:, :, columns]
    scale = size[:, rows, None]
    pattern = (np.abs(chosen) > STRUCTURAL_ZERO * np.where(scale > 0.0, scale, 1.0)).any(axis=0)
    pivots = _pivots(chosen, pattern)
    signs = np.sign(pivots[0])
    sizes = np.median(size[:, rows], axis=0)
    valid = np.all(pivots * signs > USABLE * sizes, axis=1)
    return Pivots(
        tuple(rows),
        tuple(columns),
        tuple(float(x) for x in signs),
        tuple(float(x) for x in sizes),
        pattern,
        float(valid.mean()),
    )


def _pivots(matrices: np.ndarray, pattern: np.ndarray) -> np.ndarray:
    """Pivots (S, nz) of matrices (S, nz, nz) in their order."""
    rows = [{int(j): matrices[:, i, j] for j in np.flatnonzero(pattern[i])} for i in range(len(pattern))]
    with np.errstate(all="ignore"):
        pivots = Factor(rows).pivots
    return np.column_stack(pivots) if pivots else np.zeros((len(matrices), 0))


class Factor:
    """A = L U without pivoting, U with unit diagonal; entries are scalars, zeros are left out.

    Parameters
    ----------
    matrix : sequence of dict
        Row i maps column numbers to entries; every pivot must be there.
    """

    def __init__(self, matrix: Sequence[dict[int, Scalar]]) -> None:
        self.size = len(matrix)
        work = [{j: x for j, x in row.items() if not is_zero(x)} for row in matrix]
        self.pivots: list[Scalar] = []
        self._inverse: list[Scalar] = []
        self._lower: list[dict[int, Scalar]] = [{} for _ in matrix]
        self._upper: list[dict[int, Scalar]] = [{} for _ in matrix]
        for k in range(self.size):
            pivot = work[k].get(k, 0.0)
            self.pivots.append(pivot)
            inverse = 1.0 / pivot if not is_zero(pivot) else float("nan")
            self._inverse.append(inverse)
            self._upper[k] = {j: mul(x, inverse) for j, x in work[k].items() if j > k}
            for i in range(k + 1, self.size):
                below = work[i].pop(k, 0.0)
                if is_zero(below):
                    continue
                self._lower[i][k] = below
                for j, x in self._upper[k].items():
                    work[i][j] = sub(work[i].get(j, 0.0), mul(below, x))

    def solve(self, right: Sequence[Scalar]) -> list[Scalar]:
        """Solution x of A x = right."""
        x: list[Scalar] = []
        for k in range(self.size):
            value = right[k]
            for i, entry in self._lower[k].items():
                value = sub(value, mul(entry, x[i]))
            x.append(mul(value, self._inverse[k]))
        for k in reversed(range(self.size)):
            for j, entry in self._upper[k].items():
                x[k] = sub(x[k], mul(entry, x[j]))
        return x

    def solve_transposed(self, right: Sequence[Scalar]) -> list[Scalar]:
        """Solution x of A^T x = right."""
        x = list(right)
        for k in range(self.size):
            for j, entry in self._upper[k].items():
                x[j] = sub(x[j], mul(entry, x[k]))
        for k in reversed(range(self.size)):
            x[k] = mul(x[k], self._inverse[k])
            for i, entry in self._lower[k].items():
                x[i] = sub(x[i], mul(entry, x[k]))
        return x
