"""Where an assembly mode starts: closed, regular poses from the file's configurations, or found by multi-start."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from leg_dynamics.errors import AssemblyError, LegDynamicsWarning, SingularityError
from leg_dynamics.mechanism.mobility import ROUNDED_ADVICE, ROUNDED_SHARE, check_independent, wrong_independent

if TYPE_CHECKING:
    from leg_dynamics.description.model import Configuration
    from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = [
    "SAME_POSE",
    "close_configuration",
    "configuration_coordinates",
    "descend",
    "find_closed_poses",
    "find_seeds",
    "pose_difference",
    "pose_label",
    "wrapped",
]

# A configuration may be written with rounded numbers; it must still be close to a closed pose.
SEED_CORRECTION = 0.05
REGULAR = 1e-6
# Multi-start has the choice: it leaves poses alone that are nearly singular, by themselves and beside the others.
WELL_REGULAR = 1e-3
REGULAR_SHARE = 0.3
SAME_POSE = 1e-6
DISTINCT_POSE = 1e-3
MULTI_START_ATTEMPTS = 60
MULTI_START_POSES = 12
DESCENT_STEPS = 100
DESCENT_CLOSED = 1e-13
DESCENT_LONGEST = 0.5
DESCENT_RANK = 1e-6
# Steps in a row that may gain next to nothing: a descent that creeps along a valley does not reach zero.
DESCENT_IDLE = 25
NEARLY_CLOSED = 1e-6
NEARER_STEPS = 40
NEARER_LONGEST = 0.3
NEARER_ENOUGH = 1e-6
NEARER_REGULAR = 0.5
SHOWN = 8
# A smaller one is below what is promised of results.
SAID_GAP = 1e-10
# A residual that cannot be made smaller, or a singular value, is taken for rounding of the file's numbers below this,
# and for zero below that.
ROUNDED = 1e-2
ROUNDED_CLOSED = 1e-9
ROUNDED_ATTEMPTS = 8


def configuration_coordinates(mechanism: Mechanism, values: dict[str, float]) -> np.ndarray:
    """Tree coordinates (nv,) of a named configuration; joints it does not name are at zero."""
    return np.array([values.get(name, 0.0) for name in mechanism.tree.joint_names])


def _close_seed(mechanism: Mechanism, q: np.ndarray) -> ClosedState | None:
    state = mechanism.correct(q, SEED_CORRECTION)
    if state is None or not state.smallest_pivot > REGULAR:
        return None
    return mechanism.complete(state)


def close_configuration(mechanism: Mechanism, configuration: Configuration) -> ClosedState | None:
    """The closed, regular pose that a configuration means, its rounded numbers corrected; None where there is none."""
    return _close_seed(mechanism, configuration_coordinates(mechanism, dict(configuration.values)))


def pose_difference(mechanism: Mechanism, first: ClosedState, second: ClosedState) -> float:
    """Largest difference of two poses' tree coordinates, whole turns aside."""
    return float(np.abs(wrapped(mechanism, first.q - second.q) / mechanism.closure.coordinate_unit).max())


def _same_mode(mechanism: Mechanism, first: ClosedState, second: ClosedState) -> bool:
    try:
        reached = mechanism.follow(first, second.y)
    except (AssemblyError, SingularityError):
        return False
    return pose_difference(mechanism, reached, second) < SAME_POSE


def find_seeds(mechanism: Mechanism) -> tuple[ClosedState, ...]:
    """Closed poses of one assembly mode, the first of which defines it.

    The file's configurations are tried in order, ``home`` first; later ones serve as further starting points
    where continuation shows that they belong to the same mode. Where none is closed and regular, a deterministic
    multi-start chooses a closed pose near home and a `LegDynamicsWarning` says so. A file without
    configurations that is closed and regular with all joints at zero starts from there.

    Raises
    ------
    AssemblyError
        No closed, regular pose exists among the multi-start's attempts.
    DescriptionError
        The independent joints do not fit the mobility.

    Warns
    -----
    LegDynamicsWarning
        Where a configuration is open or singular, a pose had to be chosen, or the loops close to the rounding of the
        file's numbers only.
    """
    seeds = _seeds_of(mechanism)
    gap = mechanism.gap
    if gap > SAID_GAP:
        loops = ", ".join(mechanism.rounding.loops[:SHOWN])
        warnings.warn(
            f"{mechanism.description.file}: the numbers are rounded, and loops ({loops}) that say a thing more than "
            f"once contradict each other: they stay open by up to {gap:.2g} rad or {gap * mechanism.closure.length:.2g}"
            " m; poses are those of the smallest gap, and results are good to about that share: write the numbers "
            "with all digits for more",
            LegDynamicsWarning,
            stacklevel=4,
        )
    return seeds


def _seeds_of(mechanism: Mechanism) -> tuple[ClosedState, ...]:
    description = mechanism.description
    home = description.home
    ordered = [] if home is None else [home, *(c for c in description.configurations if c is not home)]
    attempts = [(configuration, close_configuration(mechanism, configuration)) for configuration in ordered]
    closed = [state for _, state in attempts if state is not None]
    if closed:
        check_independent(mechanism, closed[0])
        unused = [configuration.name for configuration, state in attempts if state is None]
        if unused:
            warnings.warn(
                f"{description.file}: configuration {', '.join(map(repr, unused))} is open or singular and starts "
                "no assembly mode",
                LegDynamicsWarning,
                stacklevel=5,
            )
        return (closed[0], *(state for state in closed[1:] if _same_mode(mechanism, closed[0], state)))

    start = configuration_coordinates(mechanism, dict(home.values) if home is not None else {})
    if home is None and (state := _close_seed(mechanism, start)) is not None:
        check_independent(mechanism, state)
        return (state,)
    poses = find_closed_poses(mechanism, start)
    if not poses:
        raise _rounded(mechanism, start) or wrong_independent(mechanism, start) or _no_pose(mechanism, start)
    check_independent(mechanism, poses[0])
    reason = "gives no configuration" if home is None else f"has an open or singular configuration {home.name!r}"
    # Only now: the modes at this pose are found from it.
    mechanism.adopt_seeds((poses[0],))
    from leg_dynamics.mechanism.modes import MODE_ATTEMPTS, search_modes

    if not description.loops:
        # Couplings and mimics leave no choice.
        return (poses[0],)
    modes, arrived = search_modes(mechanism)
    others = "; ".join(map(str, modes[1:4])) or f"none found from {MODE_ATTEMPTS} starts, {arrived} of which closed"
    more = f" and {len(modes) - 4} more" if len(modes) > 4 else ""
    warnings.warn(
        f"{description.file}: the file {reason}; taking the closed pose {_label(mechanism, poses[0])}; other assembly "
        f"modes there: {others}{more}; choose one by mode=, or state a configuration",
        LegDynamicsWarning,
        stacklevel=5,
    )
    return (poses[0],)


def _no_pose(mechanism: Mechanism, start: np.ndarray) -> AssemblyError:
    residual = float(np.linalg.norm(mechanism.evaluate(start).residual))
    state = mechanism.correct(start, SEED_CORRECTION)
    if state is not None:
        return AssemblyError(
            f"{mechanism.description.file}: no regular closed pose of {mechanism.description.name!r} was found in "
            f"{MULTI_START_ATTEMPTS} attempts: the given pose is closed (residual {state.residual:.3g}) but nearly "
            f"singular, smallest pivot {state.smallest_pivot:.3g}, the least accepted is {REGULAR:g}: check that the "
            "dimensions fit each other, or add a regular <configuration>",
            residual=state.residual,
            margin=state.smallest_pivot - REGULAR,
            file=mechanism.description.file,
        )
    return AssemblyError(
        f"{mechanism.description.file}: no regular closed pose of {mechanism.description.name!r} was found in "
        f"{MULTI_START_ATTEMPTS} attempts (residual of the given pose {residual:.3g}): add a <configuration> that "
        "closes the loops",
        residual=residual,
        margin=-residual,
        file=mechanism.description.file,
    )


def _rounded(mechanism: Mechanism, start: np.ndarray) -> AssemblyError | None:
    """The error to raise where the loops nearly close, but rounding of the file's numbers keeps them from it."""
    found = _rounded_numbers(mechanism, start)
    if found is None:
        return None
    smallest, loops, what = found
    return AssemblyError(
        f"the loops of {mechanism.description.name!r} close nearly, but not regularly and to rounding: {what}, in "
        f"{', '.join(loops)}; their rows contradict each other by that much, as where {ROUNDED_ADVICE}",
        residual=smallest,
        margin=-smallest,
        loops=loops,
    )


def _rounded_numbers(
    mechanism: Mechanism, start: np.ndarray, seed: int = 0
) -> tuple[float, tuple[str, ...], str] | None:
    """Smallest norm of the residual, the loops that it is in, and words for it, where rounding may be the reason."""
    generator = np.random.default_rng(seed)
    unit = mechanism.closure.coordinate_unit
    best, at, rows = np.inf, start, np.zeros(0)
    for attempt in range(ROUNDED_ATTEMPTS):
        guess = start + 0.1 * attempt * unit * generator.standard_normal(mechanism.nv)
        solution = least_squares(
            lambda q: mechanism.evaluate(q).residual,
            guess,
            jac=lambda q: np.array(mechanism.evaluate(q).jacobian),
            x_scale=unit,
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
            max_nfev=100,
        )
        norm = float(np.linalg.norm(solution.fun))
        if norm < best:
            best, at, rows = norm, solution.x, np.abs(solution.fun)
    if not best < ROUNDED or not mechanism.closure.rows:
        return None
    owners = np.array(mechanism.closure.row_owner)
    if best > ROUNDED_CLOSED:
        names = tuple(dict.fromkeys(owners[rows > 0.1 * rows.max()].tolist()))
        return best, names, f"the smallest residual found is {best:.3g}"
    left, sigma, _ = np.linalg.svd(mechanism.evaluate(at).jacobian * unit, full_matrices=False)
    share = sigma / max(1.0, float(sigma[0]))
    small = np.flatnonzero((share > ROUNDED_CLOSED) & (share < ROUNDED_SHARE))
    if not small.size:
        return None
    taking = np.abs(left[:, small]).max(axis=1) > 0.1
    names = tuple(dict.fromkeys(owners[taking].tolist()))
    return best, names, f"the rows have a singular value of {share[small[-1]]:.3g} of the largest"


def _label(mechanism: Mechanism, state: ClosedState) -> str:
    return pose_label(dict(zip(mechanism.tree.joint_names, state.q.tolist(), strict=True)))


def pose_label(coordinates: Mapping[str, float]) -> str:
    """Joint coordinates as words, the first of many."""
    shown = [f"{name} {value:.4g}" for name, value in list(coordinates.items())[:SHOWN]]
    return "(" + ", ".join([*shown, "..."] if len(coordinates) > SHOWN else shown) + ")"


def descend(mechanism: Mechanism, start: np.ndarray, free: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Damped Newton steps of smallest norm towards a closed pose, pairs the right way round.

    Parameters
    ----------
    mechanism : Mechanism
    start : (nv,) array
        Tree coordinates.
    free : array of int, optional
        Coordinates that may move; all where None.

    Returns
    -------
    (nv,) array
        Where it arrived.
    float
        Largest residual there, 0 to rounding where the loops are closed.
    """
    places = np.arange(mechanism.nv) if free is None else free
    unit = mechanism.closure.coordinate_unit[places]
    rank = max(DESCENT_RANK, mechanism.rank_share)
    q, best, arrived, idle = start.copy(), np.inf, start, 0
    for _ in range(DESCENT_STEPS):
        residual, jacobian = mechanism.directed_rows(q)
        size = float(np.abs(residual).max(initial=0.0))
        if size < best:
            idle = 0 if size < 0.9 * best else idle + 1
            best, arrived = size, q
        else:
            idle += 1
        if not size > max(DESCENT_CLOSED, mechanism.gap) or idle > DESCENT_IDLE:
            break
        step = np.linalg.lstsq(jacobian[:, places] * unit, -residual, rcond=rank)[0]
        largest = float(np.abs(step).max(initial=0.0))
        if not 0.0 < largest < np.inf:
            break
        q = q.copy()
        q[places] += unit * step * min(1.0, DESCENT_LONGEST / largest)
    return arrived, best


def find_closed_poses(mechanism: Mechanism, start: np.ndarray, seed: int = 0) -> list[ClosedState]:
    """Closed regular poses from deterministic starting points.

    First the one that leaves the independent coordinates as they are in `start` (nv,), where there is one; then by
    their distance from it, the first of these moved on as near to it as it gets without becoming less regular.
    """
    generator = np.random.default_rng(seed)
    unit = mechanism.closure.coordinate_unit
    lower, upper = mechanism.search_box()
    guesses: list[tuple[np.ndarray, np.ndarray | None]] = [(start, mechanism.dependent), (start, None)]
    guesses += [(start + 0.1 * k * unit * generator.standard_normal(mechanism.nv), None) for k in range(1, 10)]
    guesses += [(generator.uniform(lower, upper), None) for _ in range(MULTI_START_ATTEMPTS - len(guesses))]
    found: list[ClosedState] = []
    kept: ClosedState | None = None
    for number, (guess, free) in enumerate(guesses):
        q, residual = descend(mechanism, guess, free)
        if residual > max(NEARLY_CLOSED, mechanism.tolerance):
            continue
        state = _close_seed(mechanism, wrapped(mechanism, q))
        if state is None or not state.smallest_pivot > WELL_REGULAR:
            continue
        if number == 0:
            kept = state
        if all(pose_difference(mechanism, state, other) > DISTINCT_POSE for other in found):
            found.append(state)
        if len(found) >= MULTI_START_POSES:
            break
    usual = float(np.median([state.smallest_pivot for state in found])) if found else 0.0
    found = [state for state in found if state.smallest_pivot >= REGULAR_SHARE * usual]

    def nearness(state: ClosedState) -> tuple[float, ...]:
        return (round(float(np.linalg.norm((state.q - start) / unit)), 9), *state.q.tolist())

    ordered = sorted(found, key=nearness)
    if kept is not None and any(state is kept for state in found):
        return [kept, *(state for state in ordered if state is not kept)]
    return [_nearer(mechanism, ordered[0], start), *ordered[1:]] if ordered else []


def _nearer(mechanism: Mechanism, state: ClosedState, start: np.ndarray) -> ClosedState:
    """The pose moved along the closed ones towards tree coordinates `start` (nv,), as far as it stays regular."""
    unit = mechanism.closure.coordinate_unit
    least = NEARER_REGULAR * state.smallest_pivot
    share = 1.0
    for _ in range(NEARER_STEPS):
        K = state.rows.jacobian * unit
        towards = (start - state.q) / unit
        rank = max(DESCENT_RANK, mechanism.rank_share)
        step = towards - np.linalg.lstsq(K, K @ towards, rcond=rank)[0] if len(K) else towards
        largest = float(np.abs(step).max(initial=0.0))
        if largest < NEARER_ENOUGH or share < NEARER_ENOUGH:
            break
        q, residual = descend(mechanism, state.q + unit * step * share * min(1.0, NEARER_LONGEST / largest))
        moved = _close_seed(mechanism, q) if residual <= max(NEARLY_CLOSED, mechanism.tolerance) else None
        shorter = moved is not None and np.linalg.norm((start - moved.q) / unit) < np.linalg.norm(towards)
        if moved is None or not shorter or moved.smallest_pivot < least:
            share *= 0.5
            continue
        state, share = moved, min(1.0, 2.0 * share)
    return state


def wrapped(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """Turn angles into (-pi, pi]; displacements stay, and angles in couplings, where a whole turn counts."""
    is_angle = np.array([mechanism.description.joint(name).unit == "rad" for name in mechanism.tree.joint_names])
    is_free = is_angle & ~mechanism.closure.coupling_matrix.any(axis=0)
    return np.where(is_free, np.arctan2(np.sin(q), np.cos(q)), q)
