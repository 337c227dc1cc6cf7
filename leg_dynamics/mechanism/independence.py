"""Which joints can be independent where a file's flags are missing or wrong: stated ones first, then driven ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from leg_dynamics.description.flags import with_independent
from leg_dynamics.description.topology import split_independent
from leg_dynamics.errors import DescriptionError
from leg_dynamics.mechanism.assembly import configuration_coordinates
from leg_dynamics.mechanism.mechanism import Mechanism
from leg_dynamics.mechanism.mobility import ROUNDED_ADVICE, is_clear, pose_rank, project
from leg_dynamics.mechanism.rounded import closing_gap, doubtful_share

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description

__all__ = ["independent_set"]

POSES = 8
ATTEMPTS = 40
# Standard deviation of the poses around home, rad or shares of the mechanism's length.
SPREAD = 0.2
# A chosen set's dependent columns must be that far from singular at its best pose, relative to the largest value.
REGULAR = 1e-6


def independent_set(description: Description, seed: int = 0) -> tuple[str, ...] | None:
    """Joints that determine all the others at generic closed poses.

    Joints that the file states as independent stay so as far as the loops let them be, then driven ones; passive ones
    fill up what is left of the mobility, those whose motion determines the others best.

    Parameters
    ----------
    description : Description
    seed : int
        Of the random poses.

    Returns
    -------
    tuple of str or None
        Joint names in the tree's order; None where no closed pose is found, or its own flags fit already.

    Raises
    ------
    DescriptionError
        The mobility hangs on rows that count by no more than the rounding of the file's numbers.
    """
    followers = {joint.name for joint in description.joints if joint.mimic is not None}
    movable = {joint.name for joint in description.moving_joints} - followers
    stated = {joint.name for joint in description.joints if joint.independent_is_stated and joint.independent}
    own, _ = split_independent(description)
    # Only the closed poses of this one are used, and those do not depend on its flags.
    mechanism = Mechanism(with_independent(description, movable))
    driven = {transmission.joint for transmission in description.transmissions}
    home = description.home
    mechanism.rounding = closing_gap(
        mechanism,
        configuration_coordinates(mechanism, {} if home is None else dict(home.values)),
        [len(each) for each in ((own if stated else ()), driven) if each],
    )
    poses = _closed_poses(mechanism, np.random.default_rng(seed))
    if not poses:
        return None
    ranks = [pose_rank(mechanism, q, "pose") for q in poses]
    clear = [number for number, each in enumerate(ranks) if is_clear(mechanism, each)]
    if clear:
        poses, ranks = [poses[number] for number in clear], [ranks[number] for number in clear]
    unit = mechanism.closure.coordinate_unit
    rows = [mechanism.evaluate(q).jacobian * unit for q in poses]
    rank = max(each.rank for each in ranks)
    names = mechanism.tree.joint_names
    dependent = np.array([k for k, name in enumerate(names) if name not in own], dtype=np.intp)
    regular = max(REGULAR, mechanism.rank_share)
    if len(dependent) == rank and _usual(rows, dependent, rank) > regular:
        return None
    share = min(doubtful_share(mechanism, q) for q in poses)
    if share > mechanism.rank_share and not mechanism.rounding.exact:
        raise DescriptionError(
            f"the loops' rows leave {len(names) - rank} motions, but one of the rows counts by {share:.3g} of the "
            f"largest only, as where {ROUNDED_ADVICE}",
            file=description.file,
            mobility=len(names) - rank,
            share=share,
        )
    # What is taken as dependent first stands first.
    groups: list[list[int]] = [[], [], [], [], []]
    for k, name in enumerate(names):
        groups[0 if name in followers else 1 + (name in driven) + 2 * (name in stated)].append(k)
    best: list[int] = []
    best_value = regular
    for K in rows:
        chosen = _basis(K, groups, rank, regular)
        value = _usual(rows, np.array(chosen, dtype=np.intp), rank) if len(chosen) == rank else 0.0
        if value > best_value:
            best, best_value = chosen, value
    if not best:
        return None
    return tuple(name for k, name in enumerate(names) if k not in best)


def _closed_poses(mechanism: Mechanism, generator: np.random.Generator) -> list[np.ndarray]:
    home = mechanism.description.home
    start = configuration_coordinates(mechanism, {} if home is None else dict(home.values))
    unit = mechanism.closure.coordinate_unit
    lower, upper = mechanism.search_box()
    found: list[np.ndarray] = []
    for attempt in range(ATTEMPTS):
        if attempt < ATTEMPTS // 2:
            guess = start + SPREAD * unit * generator.standard_normal(mechanism.nv)
        else:
            guess = generator.uniform(lower, upper)
        closed = project(mechanism, guess)
        if closed is not None:
            found.append(closed)
        if len(found) == POSES:
            break
    return found


def _basis(K: np.ndarray, groups: list[list[int]], rank: int, regular: float) -> list[int]:
    """Columns that span all, taken from the first groups as far as those are independent of each other."""
    chosen: list[int] = []
    rest = K.copy()
    scale = max(1.0, float(np.linalg.norm(K, 2)))
    for group in groups:
        if not group or len(chosen) == rank:
            continue
        _, triangle, order = scipy.linalg.qr(rest[:, group], mode="economic", pivoting=True)
        pivots = np.abs(np.diagonal(triangle))
        count = min(int(np.count_nonzero(pivots > regular * scale)), rank - len(chosen))
        taken = [group[k] for k in order[:count]]
        chosen += taken
        basis, _ = np.linalg.qr(rest[:, taken])
        rest = rest - basis @ (basis.T @ rest)
    return chosen


def _usual(rows: list[np.ndarray], dependent: np.ndarray, rank: int) -> float:
    """Median over the poses of the dependent columns' smallest singular value, relative to the largest."""
    if len(dependent) != rank:
        return 0.0
    if rank == 0:
        return np.inf
    values = []
    for K in rows:
        sigma = np.linalg.svd(K[:, dependent], compute_uv=False)
        values.append(float(sigma[rank - 1] / max(1.0, sigma[0])))
    return float(np.median(values))
