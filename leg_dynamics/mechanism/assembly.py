"""Where an assembly mode starts: closed, regular poses from the file's configurations, or found by multi-start."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from leg_dynamics.errors import AssemblyError, LegDynamicsWarning, SingularityError

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = ["configuration_coordinates", "find_closed_poses", "find_seeds"]

# A configuration may be written with rounded numbers; it must still be close to a closed pose.
SEED_CORRECTION = 0.05
REGULAR = 1e-6
SAME_POSE = 1e-6
MULTI_START_ATTEMPTS = 60


def configuration_coordinates(mechanism: Mechanism, values: dict[str, float]) -> np.ndarray:
    """Tree coordinates (nv,) of a named configuration; joints it does not name are at zero."""
    return np.array([values.get(name, 0.0) for name in mechanism.tree.joint_names])


def _close_seed(mechanism: Mechanism, q: np.ndarray) -> ClosedState | None:
    state = mechanism._correct(q, SEED_CORRECTION)
    if state is None or state.smallest_pivot < REGULAR:
        return None
    return mechanism._complete(state)


def _same_mode(mechanism: Mechanism, first: ClosedState, second: ClosedState) -> bool:
    try:
        reached = mechanism._follow(first, second.y)
    except (AssemblyError, SingularityError):
        return False
    return bool(np.abs(reached.q - second.q).max() < SAME_POSE)


def find_seeds(mechanism: Mechanism) -> tuple[ClosedState, ...]:
    """Closed poses of one assembly mode, the first of which defines it.

    The file's configurations are tried in order, ``home`` first; later ones serve as further starting points
    where continuation shows that they belong to the same mode. Where none is closed and regular, a deterministic
    multi-start chooses the closed pose nearest to home and a `LegDynamicsWarning` says so.

    Raises
    ------
    AssemblyError
        No closed, regular pose exists among the multi-start's attempts.
    """
    description = mechanism.description
    home = description.home
    ordered = [] if home is None else [home, *(c for c in description.configurations if c is not home)]
    closed = [
        state
        for configuration in ordered
        if (state := _close_seed(mechanism, configuration_coordinates(mechanism, dict(configuration.values)))) is not None
    ]
    if closed:
        return (closed[0], *(state for state in closed[1:] if _same_mode(mechanism, closed[0], state)))

    start = configuration_coordinates(mechanism, dict(home.values) if home is not None else {})
    if not ordered and (state := _close_seed(mechanism, start)) is not None:
        return (state,)
    poses = find_closed_poses(mechanism, start)
    if not poses:
        rows = mechanism._evaluate(start)
        residual = float(np.abs(rows.residual).max())
        raise AssemblyError(
            f"no regular closed pose of {description.name!r} was found in {MULTI_START_ATTEMPTS} attempts (residual of the given "
            f"pose {residual:.3g}): add a <configuration> that closes the loops",
            residual=residual,
            margin=-residual,
        )
    reason = "gives no configuration" if home is None else f"has an open or singular configuration {home.name!r}"
    others = "; ".join(_label(mechanism, pose) for pose in poses[1:4]) or "none found"
    warnings.warn(
        f"{description.file}: the file {reason}; taking the closed pose nearest to it, {_label(mechanism, poses[0])}; other closed "
        f"poses, perhaps of other assembly modes: {others}",
        LegDynamicsWarning,
        stacklevel=4,
    )
    return (poses[0],)


def _label(mechanism: Mechanism, state: ClosedState) -> str:
    pairs = zip(mechanism.tree.joint_names, state.q, strict=True)
    return "(" + ", ".join(f"{name} {value:.4g}" for name, value in pairs) + ")"


def find_closed_poses(mechanism: Mechanism, start: np.ndarray, seed: int = 0) -> list[ClosedState]:
    """Closed regular poses from deterministic starting points, nearest to `start` first."""
    generator = np.random.default_rng(seed)
    lower = np.where(np.isfinite(mechanism.lower), np.maximum(mechanism.lower, -np.pi), -np.pi)
    upper = np.where(np.isfinite(mechanism.upper), np.minimum(mechanism.upper, np.pi), np.pi)
    found: list[ClosedState] = []

    def residual(q: np.ndarray) -> np.ndarray:
        return mechanism._evaluate(q).residual.copy()

    def jacobian(q: np.ndarray) -> np.ndarray:
        return np.array(mechanism._evaluate(q).jacobian)

    for attempt in range(MULTI_START_ATTEMPTS):
        if attempt < 10:
            guess = start + 0.1 * attempt * generator.standard_normal(mechanism.nv)
        else:
            guess = generator.uniform(lower, upper)
        solution = least_squares(residual, guess, jac=jacobian, method="trf", xtol=1e-14, ftol=1e-14, gtol=1e-14)
        if np.abs(solution.fun).max(initial=0.0) > 1e-6:
            continue
        state = _close_seed(mechanism, np.where(np.abs(solution.x) > np.pi, _wrapped(mechanism, solution.x), solution.x))
        if state is None or state.smallest_pivot < 1e-3:
            continue
        if all(np.abs(state.q - other.q).max() > 1e-3 for other in found):
            found.append(state)
        if len(found) >= 12:
            break
    return sorted(found, key=lambda state: (round(float(np.linalg.norm(state.q - start)), 9), tuple(state.q)))


def _wrapped(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """Turn angles into (-pi, pi]; displacements stay."""
    is_angle = np.array([mechanism.description.joint(name).type != "prismatic" for name in mechanism.tree.joint_names])
    return np.where(is_angle, np.arctan2(np.sin(q), np.cos(q)), q)
