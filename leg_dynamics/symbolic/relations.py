"""Linear relations that the closed loops impose on the joints everywhere in the assembly mode, found from samples.

A parallel mechanism often turns passive joints in step: two angles equal, one twice the other, a platform that only
translates. Such a relation is an identity of analytic functions: one that holds on many generic states of the mode
holds on all of it. It removes an unknown exactly, as a coupling does. Whatever is not exact to rounding stays an
unknown.
"""

from __future__ import annotations

import numpy as np

from leg_dynamics.symbolic.coordinates import Coordinates, Relation

__all__ = ["find_relations"]

EXACT = 1e-12
# Coefficients are whole numbers over this; anything else is a coincidence of the samples.
DENOMINATOR = 12.0
SMALL_COEFFICIENT = 1e-7


def find_relations(coordinates: Coordinates, u: np.ndarray, unit: np.ndarray) -> list[Relation]:
    """Unknowns that are the same linear combination of other coordinates in all samples.

    Parameters
    ----------
    coordinates : Coordinates
    u : (S, nu) array
        Closed states of one assembly mode.
    unit : (nu,) array
        1 for angles, the mechanism's length for displacements.

    Returns
    -------
    list of Relation
        Each expresses a joint by independent joints and unknowns that stay.
    """
    n = coordinates.n
    scaled = u / unit
    kept = list(range(n))
    relations: list[Relation] = []
    for k in range(n, u.shape[1]):
        basis = np.column_stack([scaled[:, kept], np.ones(len(u))])
        if len(u) < 3 * basis.shape[1]:
            break
        solution, _, rank, _ = np.linalg.lstsq(basis, scaled[:, k], rcond=1e-10)
        coefficients = np.round(solution[:-1] * DENOMINATOR) / DENOMINATOR
        if rank < basis.shape[1] or np.abs(coefficients - solution[:-1]).max(initial=0.0) > SMALL_COEFFICIENT:
            kept.append(k)
            continue
        left = scaled[:, k] - scaled[:, kept] @ coefficients
        constant = float(np.median(left))
        if abs(constant) < EXACT:
            constant = 0.0
        if np.abs(left - constant).max() > EXACT:
            kept.append(k)
            continue
        terms = tuple(
            (coordinates.names[other], float(coefficient * unit[k] / unit[other]))
            for other, coefficient in zip(kept, coefficients, strict=True)
            if coefficient != 0.0
        )
        relations.append(Relation(coordinates.names[k], terms, constant * float(unit[k])))
    return relations
