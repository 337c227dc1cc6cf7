"""Assembly modes: the closed poses that a mechanism can be put together in at the same independent coordinates."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.errors import AssemblyError, DescriptionError, LegDynamicsError, ParameterError
from leg_dynamics.mechanism.assembly import (
    DISTINCT_POSE,
    NEARLY_CLOSED,
    SAME_POSE,
    close_configuration,
    configuration_coordinates,
    descend,
    pose_label,
    wrapped,
)
from leg_dynamics.mechanism.mobility import check_independent

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = ["MODE_ATTEMPTS", "AssemblyMode", "find_modes", "mode_near", "search_modes"]

MODE_ATTEMPTS = 100
# Cells that a rotation's entry, or a length of the mechanism, is cut into for a name, and the digits of that.
NAME_CELLS = 50.0
NAME_DIGITS = 5
# A pose nearer to singular than this is where modes meet, and belongs to none.
REGULAR = 1e-6
# A pose that is given to tell a mode may be that far from closed, rad or shares of the mechanism's length.
NEAR = 0.5


@dataclass(frozen=True)
class AssemblyMode:
    """One closed pose at given independent coordinates, and the mode that it stands for.

    Attributes
    ----------
    name : str
        Such as ``mode_3fa2c``, made from where the bodies stand: it does not depend on the mode in use, nor on how many
        were found. At other independent coordinates the names are others.
    coordinates : mapping of str to float
        Every moving joint of the tree, rad or m.
    regularity : float
        Smallest singular value of the closure, dimensionless: 0 where modes meet.
    configurations : tuple of str
        Configurations of the file that lie in it.
    """

    name: str
    coordinates: Mapping[str, float]
    regularity: float
    configurations: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "coordinates", MappingProxyType(dict(self.coordinates)))

    def __reduce__(self) -> tuple[Any, ...]:
        return AssemblyMode, (self.name, dict(self.coordinates), self.regularity, self.configurations)

    def to_dict(self) -> dict[str, Any]:
        """The mode as JSON-ready values."""
        return {
            "name": self.name,
            "coordinates": dict(self.coordinates),
            "regularity": self.regularity,
            "configurations": list(self.configurations),
        }

    def __str__(self) -> str:
        return f"{self.name} {pose_label(self.coordinates)}"


def find_modes(
    mechanism: Mechanism, y: np.ndarray | None = None, attempts: int = MODE_ATTEMPTS, seed: int = 0
) -> tuple[AssemblyMode, ...]:
    """Closed, regular poses at the same independent coordinates, by multi-start over the dependent ones.

    Poses count as one where all bodies with mass stand the same.
    Two of them may still be joined by a way around the singular poses: they are told apart at these coordinates only.

    Parameters
    ----------
    mechanism : Mechanism
    y : (n,) array, optional
        Independent coordinates, rad or m; the home pose's where None.
    attempts : int
        Starting points. More of them find more modes of a mechanism with many.
    seed : int
        Of the starting points.

    Returns
    -------
    tuple of AssemblyMode
        The mode in use first, then the others by their distance from it.

    Raises
    ------
    AssemblyError, SingularityError
        The mode in use has no pose at y.
    """
    return search_modes(mechanism, y, attempts, seed)[0]


def search_modes(
    mechanism: Mechanism, y: np.ndarray | None = None, attempts: int = MODE_ATTEMPTS, seed: int = 0
) -> tuple[tuple[AssemblyMode, ...], int]:
    """As `find_modes`, with the number of starts that closed the loops."""
    current = mechanism.seeds[0] if y is None else mechanism.close(y)
    found, closed = _solutions(mechanism, current, attempts, seed)
    unit = mechanism.closure.coordinate_unit
    others = sorted(
        found,
        key=lambda state: (
            round(float(np.linalg.norm(wrapped(mechanism, state.q - current.q) / unit)), 9),
            *state.q.round(9).tolist(),
        ),
    )
    return _named(mechanism, [current, *others]), closed


def _solutions(mechanism: Mechanism, current: ClosedState, attempts: int, seed: int) -> tuple[list[ClosedState], int]:
    """Other regular closed poses at the current one's independent coordinates, and how many starts closed."""
    dependent = mechanism.dependent
    if not len(dependent) or not mechanism.closure.loops:
        return [], 0
    generator = np.random.default_rng(seed)
    lower, upper = (bound[dependent] for bound in mechanism.search_box())
    is_angle = np.array([mechanism.description.joint(mechanism.tree.joint_names[k]).unit == "rad" for k in dependent])
    # Limits belong to a mode's use, not to its existence.
    lower, upper = np.where(is_angle, -math.pi, lower), np.where(is_angle, math.pi, upper)

    found: list[ClosedState] = []
    closed = 0
    for _ in range(attempts):
        q = current.q.copy()
        q[dependent] = generator.uniform(lower, upper)
        q, residual = descend(mechanism, q, dependent)
        if residual > max(NEARLY_CLOSED, mechanism.tolerance):
            continue
        closed += 1
        state = mechanism.correct(wrapped(mechanism, q), 0.05)
        if state is None or not state.smallest_pivot > REGULAR:
            continue
        if not all(_apart(mechanism, state, other) > DISTINCT_POSE for other in (current, *found)):
            continue
        state = mechanism.complete(state)
        try:
            check_independent(mechanism, state)
        except DescriptionError:
            # An overconstrained mechanism may close where it cannot move.
            continue
        found.append(state)
    return found, closed


def _placements(mechanism: Mechanism, state: ClosedState) -> np.ndarray:
    """Where the bodies stand that have mass, or all where none has: rotations and origins in lengths, (bodies, 12).

    A ball or universal joint of hinges about massless links has two sets of angles for each of its poses.
    """
    mechanism.place(state)
    model, placements = mechanism.tree.model, mechanism.joint_placements()
    heavy = [k for k in range(1, model.njoints) if model.inertias[k].mass > 0.0] or list(range(1, model.njoints))
    rows = [[*placements[k].rotation.ravel(), *placements[k].translation / mechanism.closure.length] for k in heavy]
    return np.array(rows)


def _apart(mechanism: Mechanism, first: ClosedState, second: ClosedState) -> float:
    """Largest difference of where two poses' bodies stand."""
    return float(np.abs(_placements(mechanism, first) - _placements(mechanism, second)).max())


def _named(mechanism: Mechanism, states: list[ClosedState]) -> tuple[AssemblyMode, ...]:
    """The modes of some poses at the same independent coordinates, with the configurations that lead to each."""
    held: list[list[str]] = [[] for _ in states]
    for configuration in mechanism.description.configurations:
        start = close_configuration(mechanism, configuration)
        if start is None:
            continue
        try:
            reached = mechanism.follow(start, states[0].y)
        except LegDynamicsError:
            continue
        for place, state in enumerate(states):
            if _apart(mechanism, reached, state) < SAME_POSE:
                held[place].append(configuration.name)
    modes = []
    for state, names in zip(states, held, strict=True):
        sigma = mechanism.singular_values(state)
        coordinates = dict(zip(mechanism.tree.joint_names, mechanism.unwound(state.q).tolist(), strict=True))
        name = _address(mechanism, state)
        modes.append(AssemblyMode(name, coordinates, float(sigma.min(initial=np.inf)), tuple(names)))
    return tuple(modes)


def _address(mechanism: Mechanism, state: ClosedState) -> str:
    """A name made from where the bodies stand: the same whichever mode is in use, and however many are found."""
    # The offset keeps round numbers from the edge of rounding.
    cells = np.rint(_placements(mechanism, state) * NAME_CELLS + math.pi / 7.0).astype(np.int64)
    return f"mode_{hashlib.sha256(cells.tobytes()).hexdigest()[:NAME_DIGITS]}"


def mode_near(mechanism: Mechanism, values: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """Tree coordinates of the closed pose near some joint coordinates.

    Parameters
    ----------
    mechanism : Mechanism
    values : mapping of str to float
        rad or m. Joints left out are as in the file's home configuration, else zero.

    Raises
    ------
    ParameterError
        A joint is unknown, or a value is not a finite number.
    AssemblyError
        No closed, regular pose is near.
    """
    names = mechanism.tree.joint_names
    for name, value in values.items():
        if name not in names:
            raise ParameterError(
                f"mode names an unknown joint {name!r}; the moving joints are {', '.join(names)}", parameter="mode"
            )
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not math.isfinite(value):
            raise ParameterError(f"mode has {name} = {value!r}, which is not a finite number", parameter="mode")
    home = mechanism.description.home
    start = configuration_coordinates(mechanism, ({} if home is None else dict(home.values)) | dict(values))
    state = mechanism.correct(start, NEAR)
    if state is None:
        # The independent coordinates given need not be exact either.
        from leg_dynamics.mechanism.mobility import project

        closed = project(mechanism, start)
        unit = mechanism.closure.coordinate_unit
        if closed is not None and float(np.abs((closed - start) / unit).max()) <= NEAR:
            state = mechanism.correct(closed, NEAR)
    if state is None or not state.smallest_pivot > REGULAR:
        residual = float(np.linalg.norm(mechanism.evaluate(start).residual))
        raise AssemblyError(
            f"there is no regular closed pose of {mechanism.description.name!r} within {NEAR:g} rad (or lengths of the "
            f"mechanism) of the mode's coordinates, whose loop residual is {residual:.3g}: give coordinates nearer to "
            "a closed pose, of more joints",
            residual=residual,
            margin=-residual,
        )
    return tuple(zip(names, state.q.tolist(), strict=True))
