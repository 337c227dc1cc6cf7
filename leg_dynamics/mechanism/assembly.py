"""Where an assembly mode starts: closed, regular poses from the file's configurations, or found by multi-start."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

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
DIRECTED_ATTEMPTS = 40
MULTI_START_POSES = 12
# A descent that has not arrived after so many evaluations creeps along a valley that does not reach zero.
MULTI_START_EVALUATIONS = 100
SHOWN = 8
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
    multi-start chooses the closed pose nearest to home and a `LegDynamicsWarning` says so. A file without
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
        Where a configuration is open or singular, or a pose had to be chosen.
    """
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
                stacklevel=4,
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
    from leg_dynamics.mechanism.modes import find_modes

    modes = find_modes(mechanism)[1:]
    others = "; ".join(map(str, modes[:3])) or "none found"
    more = f" and {len(modes) - 3} more" if len(modes) > 3 else ""
    warnings.warn(
        f"{description.file}: the file {reason}; taking the closed pose nearest to it, "
        f"{_label(mechanism, poses[0])}; other assembly modes there: {others}{more}; choose one by mode=, or state a "
        "configuration",
        LegDynamicsWarning,
        stacklevel=4,
    )
    return (poses[0],)


def _no_pose(mechanism: Mechanism, start: np.ndarray) -> AssemblyError:
    residual = float(np.linalg.norm(mechanism.evaluate(start).residual))
    state = mechanism.correct(start, SEED_CORRECTION)
    if state is not None:
        return AssemblyError(
            f"no regular closed pose of {mechanism.description.name!r} was found in {MULTI_START_ATTEMPTS} attempts: "
            f"the given pose is closed (residual {state.residual:.3g}) but nearly singular, smallest pivot "
            f"{state.smallest_pivot:.3g}, the least accepted is {REGULAR:g}: check that the dimensions fit each other, "
            "or add a regular <configuration>",
            residual=state.residual,
            margin=state.smallest_pivot - REGULAR,
        )
    return AssemblyError(
        f"no regular closed pose of {mechanism.description.name!r} was found in {MULTI_START_ATTEMPTS} attempts "
        f"(residual of the given pose {residual:.3g}): add a <configuration> that closes the loops",
        residual=residual,
        margin=-residual,
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
        solution = descend(mechanism, start + 0.1 * attempt * unit * generator.standard_normal(mechanism.nv))
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
    share = sigma / sigma[0]
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


def descend(mechanism: Mechanism, start: np.ndarray, free: np.ndarray | None = None) -> Any:
    """Least squares of the loops' residual from tree coordinates (nv,), over those in `free`, or all."""
    places = np.arange(mechanism.nv) if free is None else free

    def place(x: np.ndarray) -> np.ndarray:
        q = start.copy()
        q[places] = x
        return q

    return least_squares(
        lambda x: mechanism.evaluate(place(x)).residual,
        start[places],
        jac=lambda x: np.array(mechanism.evaluate(place(x)).jacobian[:, places]),
        x_scale=mechanism.closure.coordinate_unit[places],
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
        max_nfev=MULTI_START_EVALUATIONS,
    )


def find_closed_poses(mechanism: Mechanism, start: np.ndarray, seed: int = 0) -> list[ClosedState]:
    """Closed regular poses from deterministic starting points, nearest to `start` (nv,) first."""
    generator = np.random.default_rng(seed)
    unit = mechanism.closure.coordinate_unit
    lower, upper = mechanism.search_box()
    found: list[ClosedState] = []
    mirrored = False
    for attempt in range(MULTI_START_ATTEMPTS):
        if attempt < 10:
            guess = start + 0.1 * attempt * unit * generator.standard_normal(mechanism.nv)
        else:
            guess = generator.uniform(lower, upper)
        solution = descend(mechanism, guess)
        if np.abs(solution.fun).max(initial=0.0) > 1e-6:
            continue
        state = _close_seed(mechanism, wrapped(mechanism, solution.x))
        if state is None or not state.smallest_pivot > WELL_REGULAR:
            mirrored |= state is None and mechanism.is_mirrored(solution.x)
            continue
        if all(pose_difference(mechanism, state, other) > DISTINCT_POSE for other in found):
            found.append(state)
        if len(found) >= MULTI_START_POSES:
            break

    # A start that is closed but singular is no matter of mirrored pairs.
    if not found and mirrored and mechanism.correct(start, SEED_CORRECTION) is None:
        return _directed_poses(mechanism, start, seed)
    usual = float(np.median([state.smallest_pivot for state in found])) if found else 0.0
    found = [state for state in found if state.smallest_pivot >= REGULAR_SHARE * usual]

    def nearness(state: ClosedState) -> tuple[float, ...]:
        return (round(float(np.linalg.norm((state.q - start) / unit)), 9), *state.q.tolist())

    return sorted(found, key=nearness)


def _directed_poses(mechanism: Mechanism, start: np.ndarray, seed: int = 0) -> list[ClosedState]:
    """As `find_closed_poses` with directions compared as well, for loops that would close onto the mirrored pair.

    Slower, and less regular poses count too.
    """
    generator = np.random.default_rng(seed)
    unit = mechanism.closure.coordinate_unit
    lower, upper = mechanism.search_box()
    found: list[ClosedState] = []
    for attempt in range(DIRECTED_ATTEMPTS):
        if attempt < DIRECTED_ATTEMPTS // 2:
            guess = start + 0.05 * attempt * unit * generator.standard_normal(mechanism.nv)
        else:
            guess = generator.uniform(lower, upper)
        solution = least_squares(
            mechanism.directed_residual, guess, x_scale=unit, xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=60
        )
        if np.abs(solution.fun).max(initial=0.0) > 1e-6:
            continue
        state = _close_seed(mechanism, wrapped(mechanism, solution.x))
        if state is None:
            continue
        if all(pose_difference(mechanism, state, other) > DISTINCT_POSE for other in found):
            found.append(state)
        if len(found) >= MULTI_START_POSES // 2:
            break
    usual = float(np.median([state.smallest_pivot for state in found])) if found else 0.0
    kept = [state for state in found if state.smallest_pivot >= REGULAR_SHARE * usual]
    return sorted(kept, key=lambda state: float(np.linalg.norm((state.q - start) / unit)))


def wrapped(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """Turn angles into (-pi, pi]; displacements stay, and angles in couplings, where a whole turn counts."""
    is_angle = np.array([mechanism.description.joint(name).unit == "rad" for name in mechanism.tree.joint_names])
    is_free = is_angle & ~mechanism.closure.coupling_matrix.any(axis=0)
    return np.where(is_free, np.arctan2(np.sin(q), np.cos(q)), q)
