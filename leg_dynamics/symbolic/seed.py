"""The closed pose that defines the assembly mode: from the file's configurations, or given by the caller."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from leg_dynamics.description.model import Description
from leg_dynamics.errors import AssemblyError, DescriptionError
from leg_dynamics.symbolic.closure import evaluate_rows
from leg_dynamics.symbolic.coordinates import Coordinates
from leg_dynamics.symbolic.motion import Motion
from leg_dynamics.symbolic.sampling import ClosureArrays

__all__ = ["find_seed", "needs_seed"]

# A configuration may be written with rounded numbers; it must still be close to a closed pose.
SEED_CORRECTION = 0.05
CLOSED = 1e-10
REGULAR = 1e-6
RANK = 1e-9
# Cosine between axes that must point the same way; mirrored pairs have -1.
SAME_WAY_COSINE = 0.5


def _configurations(description: Description) -> list[Mapping[str, float]]:
    home = description.home
    if home is None:
        return [{}]
    others = [each for each in description.configurations if each is not home]
    return [home.values, *(each.values for each in others)]


def _close(arrays: ClosureArrays, coordinates: Coordinates, values: Mapping[str, float]) -> np.ndarray | None:
    """The closed, regular state that a configuration means; None where there is none."""
    u = np.array([[values.get(name, 0.0) for name in coordinates.names]])
    if not arrays.closure.basic or coordinates.unknowns == 0:
        return u[0] if _is_closed(arrays, u) else None
    for _ in range(12):
        phi, K = arrays.rows(u)
        step, *_ = np.linalg.lstsq(K[0][:, coordinates.n :], -phi[0], rcond=None)
        if not np.linalg.norm(step) <= SEED_CORRECTION:
            return None
        u[0, coordinates.n :] += step * arrays.unit[coordinates.n :]
        if np.abs(step).max() < 1e-14:
            break
    _, K = arrays.rows(u)
    sigma = np.linalg.svd(K[0][:, coordinates.n :], compute_uv=False)
    if not _is_closed(arrays, u) or len(sigma) < coordinates.unknowns or not sigma[-1] > REGULAR * max(1.0, sigma[0]):
        return None
    return u[0]


def _is_closed(arrays: ClosureArrays, u: np.ndarray) -> bool:
    phi, _ = arrays.rows(u)
    if not np.abs(phi).max(initial=0.0) <= CLOSED:
        return False
    cosines, _ = evaluate_rows(arrays.closure.same_way, Motion([float(x) for x in u[0]]), columns=False)
    return all(cosine > SAME_WAY_COSINE for cosine in cosines)


def find_seed(
    description: Description,
    coordinates: Coordinates,
    arrays: ClosureArrays,
    given: Mapping[str, float] | None = None,
) -> np.ndarray:
    """The closed state u (nu,) that defines the assembly mode.

    Parameters
    ----------
    description : Description
    coordinates : Coordinates
        All unknowns that couplings leave.
    arrays : ClosureArrays
    given : mapping of str to float, optional
        Tree coordinates of a closed pose, rad or m; without it, the file's configurations are tried, ``home`` first,
        and a file that has none is tried with all joints at zero.

    Raises
    ------
    AssemblyError
        No configuration is closed and regular: the caller must give one.
    DescriptionError
        The number of independent joints is not the mechanism's mobility.
    """
    for values in [given] if given is not None else _configurations(description):
        u = _close(arrays, coordinates, values)
        if u is not None:
            _check_mobility(description, coordinates, arrays, u)
            return u
    source = "the given seed" if given is not None else "no configuration of the file"
    raise AssemblyError(
        f"{description.file}: {source} is closed and regular, so the assembly mode is not defined: add a "
        "<configuration> that closes the loops, or use route='pinocchio', which searches for one",
        residual=np.nan,
    )


def needs_seed(description: Description, coordinates: Coordinates, arrays: ClosureArrays) -> bool:
    """Whether the file itself defines no assembly mode, so that a seed must be given."""
    return all(_close(arrays, coordinates, values) is None for values in _configurations(description))


def _check_mobility(description: Description, coordinates: Coordinates, arrays: ClosureArrays, u: np.ndarray) -> None:
    if not arrays.closure.basic:
        if coordinates.unknowns:
            raise DescriptionError(
                f"{coordinates.unknowns} dependent joints, {', '.join(coordinates.names[coordinates.n :])}, are held "
                "by no loop or coupling: mark them independent or add the missing loops",
                file=description.file,
            )
        return
    _, K = arrays.rows(u[None])
    sigma = np.linalg.svd(K[0], compute_uv=False)
    rank = int((sigma > RANK * max(1.0, float(sigma.max(initial=0.0)))).sum())
    mobility = len(u) - rank
    if mobility != coordinates.n:
        raise DescriptionError(
            f"{coordinates.n} joints are independent ({', '.join(coordinates.names[: coordinates.n])}) and the "
            f"mechanism's mobility is {mobility} (loop rows of rank {rank}): mark as many joints independent",
            file=description.file,
            mobility=mobility,
            independent=coordinates.n,
        )
