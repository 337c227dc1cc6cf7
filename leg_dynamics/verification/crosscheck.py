"""Independent routes held against each other, and each against finite differences and energy."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from leg_dynamics.errors import AssemblyError, ParameterError, RowError, ShapeError, SingularityError
from leg_dynamics.leg import Leg
from leg_dynamics.routes import load, routes_of, sibling, with_text
from leg_dynamics.verification.comparison import ROUTE_TOLERANCE, Progress, check, compare, relative
from leg_dynamics.verification.first_principles import GAP_TOLERANCE, against_first_principles
from leg_dynamics.verification.perturbation import with_random_inertia
from leg_dynamics.verification.report import Check, CrosscheckReport
from leg_dynamics.verification.states import (
    ROOM_SHARE,
    States,
    domain,
    nearly_singular,
    sample_states,
    smallest_singular_values,
    with_room,
)
from leg_dynamics.verification.swing import SECONDS, energy_drift, free_swing

__all__ = ["crosscheck", "crosscheck_legs"]

ENERGY_TOLERANCE = 1e-9
FIRST_PRINCIPLES_SAMPLES = 50
SWING_NODES = 400
SWING_USED = 0.8
"""Share of a swing that is used where it ran into a singular closure, next to which no integrator is accurate."""
SWING_SHARE = 0.2
SWING_SPEED = 1.0
MOST_DRAWN = 20
"""States drawn for each one asked for, at most: legs whose loops close in a small part of their joint limits."""
MOST_NEARLY_SINGULAR = 0.25
"""Share of the states that may be left out as nearly singular: with more of them the rest would say too little."""


def crosscheck(
    leg: Any,
    against: str | os.PathLike[str] | Leg | None = None,
    samples: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    tolerance: float | None = None,
    **load_options: Any,
) -> CrosscheckReport:
    """Hold the routes of a leg against each other and against first principles, or own formulas against a leg.

    Parameters
    ----------
    leg : str, path-like or Leg; or any object
        A shipped name or anything `leg_dynamics.load` takes, or a loaded leg. A leg without closed form is held
        against first principles only. With `against`: an object with some of the interface's methods, see
        `leg_dynamics.verification.own_formulas`.
    against : str, path-like or Leg, optional
        The leg that own formulas are held against, as for `leg`.
    samples : int
        Random states to compare at, with the corners of the domain and near-zero coordinates among them. States at
        which the loops cannot be closed do not count, up to 20 times as many.
    seed : int
        Of the random states and inertias, at least 0.
    progress : callable, optional
        Called with (what is being checked, share done in 0..1).
    tolerance : float, optional
        Of own formulas, relative to 1 + magnitude; 1e-9 where not given.
    **load_options
        Passed to `leg_dynamics.load`: ``urdf``, ``parameters``, ``foot``, and with `against` ``route``.

    Returns
    -------
    CrosscheckReport
        ``.passed``, ``.worst``, ``.checks``; prints as a table with rich. With `against` an `OwnFormulasReport`, whose
        ``.causes`` are the failing equations that no other one explains.

    Raises
    ------
    ShapeError
        `samples` is not a positive whole number.
    ParameterError
        `seed` is not a whole number, or is negative; load options were given with a leg that is loaded already;
        `against` is a number; own formulas are no object with methods of the interface, or state coordinates,
        equations or a gravity that do not fit; a tolerance was given without them or is not a positive number.
    MissingFootError
        Own formulas have a foot and the leg they are held against names none.
    AssemblyError
        No route can assemble the leg in any of the states.
    SingularityError
        All states that can be assembled are nearly singular.
    """
    if isinstance(samples, bool) or not isinstance(samples, (int, np.integer)) or samples < 1:
        raise ShapeError(f"samples must be a whole number, at least 1, got {samples!r}")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ParameterError(
            f"seed must be a whole number, at least 0, got {seed!r}: any such number draws other states, such as "
            "seed=0",
            parameter="seed",
        )
    if against is not None:
        return _own_formulas(leg, against, int(samples), int(seed), progress, tolerance, load_options)
    if tolerance is not None:
        raise ParameterError(
            f"tolerance={tolerance!r} goes with own formulas, crosscheck(leg, against): that between routes is "
            f"{ROUTE_TOLERANCE:g}",
            parameter="tolerance",
        )
    if isinstance(leg, Leg):
        if load_options:
            raise ParameterError(f"{', '.join(load_options)}: options of load, but {leg.name!r} is loaded already")
        given, name = leg, leg.name
    else:
        given = load(leg, **load_options)
        text = os.fspath(leg)
        name = given.name if text.lstrip("\ufeff \t\r\n").startswith("<") else text
    if given.transmission != "exact":
        name = f"{name}, transmission {given.transmission!r}"
    legs = [given if route == given.route else sibling(given, route) for route in routes_of(given)]
    return crosscheck_legs(legs, name, int(samples), int(seed), progress)


def _own_formulas(
    own: Any,
    against: Any,
    samples: int,
    seed: int,
    progress: Progress | None,
    tolerance: float | None,
    load_options: dict[str, Any],
) -> CrosscheckReport:
    from leg_dynamics.verification.own_comparison import hold
    from leg_dynamics.verification.own_formulas import OwnFormulas

    if isinstance(against, (int, float, np.number)):
        raise ParameterError(
            f"against is a leg to hold own formulas against, got the number {against!r}: for a number of states write "
            f"samples={against!r}",
            parameter="against",
        )
    if isinstance(against, Leg):
        if load_options:
            raise ParameterError(f"{', '.join(load_options)}: options of load, but {against.name!r} is loaded already")
        reference = against
    else:
        reference = load(against, **load_options)
    formulas = OwnFormulas(own, reference)
    tell: Progress = progress if progress is not None else lambda what, share: None
    text = reference.description.urdf
    drawn = _draw([reference], samples, seed, text, lambda what, share: tell(what, 0.1 * share))
    counts = drawn.left_out, len(drawn.hidden)
    states = drawn.states.take(drawn.states.along_a_path())
    report = hold(formulas, states, samples, seed, counts, tolerance, lambda what, share: tell(what, 0.1 + 0.9 * share))
    tell("done", 1.0)
    return report


def crosscheck_legs(
    legs: Sequence[Leg], name: str, samples: int, seed: int, progress: Progress | None = None
) -> CrosscheckReport:
    """Hold some legs, which are meant to be the same, against the first of them and each against first principles.

    Parameters
    ----------
    legs : sequence of Leg
        One or more. The free swing is integrated by the last one.
    name : str
        What the report calls them.
    samples, seed, progress
        As in `crosscheck`.
    """

    def part(start: float, end: float) -> Progress:
        return lambda what, share: tell(what, start + share * (end - start))

    def tell(what: str, share: float) -> None:
        if progress is not None:
            progress(what, share)

    reference, others = legs[0], legs[1:]
    changed_text = with_random_inertia(reference.description, seed)
    drawn = _draw(legs, samples, seed, changed_text, part(0.0, 0.05))
    unordered = drawn.states
    states = unordered.take(unordered.along_a_path())

    checks: list[Check] = []
    span = 0.75 / max(1, len(others))
    for number, other in enumerate(others):
        group = f"{reference.route} against {other.route}"
        start = 0.05 + number * span
        errors = relative(drawn.assembled[0], drawn.assembled[number + 1], 1)
        quantity = "joint angles that close the loops"
        detail = _assembly_reason((reference, other), unordered, errors)
        checks.append(check(group, quantity, errors, ROUTE_TOLERANCE, reference, unordered.q, detail=detail))
        checks += compare(reference, other, states, group, part(start, start + 0.6 * span))
        changed = with_text(reference, changed_text), with_text(other, changed_text)
        group = f"{group}, random inertias"
        checks += compare(*changed, states, group, part(start + 0.6 * span, start + span), kinematics=False)

    tell(f"{legs[-1].route}: free swing", 0.8)
    regularity = _regularity(legs, states)
    start_q, start_v = _swing_start(reference, states, regularity)
    swing = free_swing(legs[-1], start_q, start_v, SECONDS)
    if swing.stopped:
        swing = swing.until(SWING_USED * swing.seconds)
    swing = swing.thinned(SWING_NODES)
    for number, leg in enumerate(legs):
        tell(f"{leg.route}: first principles", 0.9 + 0.1 * number / len(legs))
        spread = np.unique(np.linspace(0, len(states) - 1, FIRST_PRINCIPLES_SAMPLES).round().astype(np.intp))
        roomy = with_room(leg, states.take(spread))
        roomy = roomy.take(np.flatnonzero(regularity(roomy.q) > ROOM_SHARE))
        if len(roomy) == 0:
            raise AssemblyError(
                f"{leg.name!r} has no state with room around it to take differences in by {leg.route!r}"
            )
        checks += against_first_principles(leg, roomy)
        group = f"{leg.route}: first principles"
        quantity = f"energy of a {swing.seconds:.3g} s free swing"
        measure = "relative to the largest kinetic energy"
        detail = f"the swing ended early: {swing.stopped}" if swing.stopped else ""
        allowed = max(ENERGY_TOLERANCE, GAP_TOLERANCE * leg.loop_gap)
        checks.append(check(group, quantity, energy_drift(leg, swing), allowed, leg, swing.q, measure, detail))
        if leg is not legs[-1]:
            still = np.zeros((1, len(leg.actuator_names)))
            errors = relative(
                leg.acceleration(swing.q, swing.v, still, on_error="nan"),
                legs[-1].acceleration(swing.q, swing.v, still, on_error="nan"),
                1,
            )
            checks.append(check(group, "acceleration along the swing", errors, ROUTE_TOLERANCE, leg, swing.q))
    if len(drawn.hidden):
        share = np.array([len(drawn.hidden) / drawn.closed])
        measure, detail = "share of the states that can be assembled", "rounding hides the digits to compare there"
        first = drawn.hidden[:1]
        quantity = "left out as nearly singular"
        checks.append(check("states", quantity, share, MOST_NEARLY_SINGULAR, reference, first, measure, detail))
    tell("done", 1.0)
    routes = tuple(leg.route for leg in legs)
    counts = len(states), drawn.left_out, len(drawn.hidden)
    return CrosscheckReport(name, routes, samples, seed, tuple(checks), *counts)


class _Drawn(NamedTuple):
    """States to compare at, in random order, with each leg's tree coordinates; and what was left out on the way.

    `closed` of the states drawn can be assembled; those in `hidden` (k, n) are nearly singular, and `left_out` others
    cannot be assembled.
    """

    states: States
    assembled: list[np.ndarray]
    closed: int
    hidden: np.ndarray
    left_out: int


def _draw(legs: Sequence[Leg], samples: int, seed: int, changed_text: str, tell: Progress) -> _Drawn:
    """Draw states until `samples` of them can be compared, or `MOST_DRAWN` times as many were drawn."""
    reference = legs[0]
    parts: list[States] = []
    coordinates: list[list[np.ndarray]] = [[] for _ in legs]
    hidden_q: list[np.ndarray] = []
    found = total = closed = left_out = 0
    while found < samples and total < MOST_DRAWN * samples:
        tell("states, and joint angles that close the loops", found / samples)
        # A tenth more than are missing, by the share that could be used so far.
        missing = math.ceil(1.1 * (samples - found) * total / max(found, 1)) if total else samples
        every = sample_states(
            domain(reference), min(missing, MOST_DRAWN * samples - total), seed + total, reference.units.joints
        )
        # In the random order: each closure has to come from far away. Later ones come from the row before.
        assembled = [_assembled(leg, every, reference.tree_joint_names) for leg in legs]
        usable = np.flatnonzero(~np.all([np.isnan(angles).any(axis=1) for angles in assembled], axis=0))
        hidden = _hidden(legs, every.take(usable), changed_text)
        chosen = usable[~hidden][: samples - found]
        parts.append(every.take(chosen))
        for rows, angles in zip(coordinates, assembled, strict=True):
            rows.append(angles[chosen])
        hidden_q.append(every.q[usable[hidden]])
        found += len(chosen)
        total += len(every)
        closed += len(usable)
        left_out += len(every) - len(usable)
    if not closed:
        _refuse(reference, every, total)
    if not found:
        raise SingularityError(
            f"all {closed} of {total} states at which {reference.name!r} can be assembled are so nearly singular that "
            "rounding hides the digits to compare: choose other independent joints",
            rows=np.arange(closed),
        )
    whole = [np.concatenate(rows) for rows in coordinates]
    return _Drawn(States.joined(parts), whole, closed, np.concatenate(hidden_q), left_out)


def _hidden(legs: Sequence[Leg], states: States, changed_text: str) -> np.ndarray:
    """States that are nearly singular with the leg's own or with the changed inertias, (N,) bool."""
    hidden = np.zeros(len(states), dtype=bool)
    for leg in legs:
        hidden |= nearly_singular(leg, states)
        if hasattr(leg.backend, "rounding_errors"):
            hidden |= nearly_singular(with_text(leg, changed_text), states)
    return hidden


def _assembled(leg: Leg, states: States, names: Sequence[str]) -> np.ndarray:
    coordinates = leg.assemble(states.q, on_error="nan")
    return np.stack([coordinates[name] for name in names], axis=-1)


def _refuse(leg: Leg, states: States, count: int) -> None:
    """Raise what says why nothing can be checked."""
    try:
        leg.assemble(states.q[0])
    except RowError as error:
        raise AssemblyError(
            f"no route can assemble {leg.name!r} at any of {count} states within its joint limits; at the first "
            f"one: {error}",
            rows=np.arange(count),
        ) from error


def _assembly_reason(legs: tuple[Leg, Leg], states: States, errors: np.ndarray) -> str:
    for row in np.flatnonzero(np.isnan(errors))[:1]:
        for leg in legs:
            try:
                leg.assemble(states.q[row])
            except RowError as error:
                return f"{leg.route}: {type(error).__name__}: {error}"
    return ""


def _regularity(legs: Sequence[Leg], states: States) -> Callable[[np.ndarray], np.ndarray]:
    """Smallest singular value at poses (N, n) as a share of the states' median; infinite where no route can tell."""
    for leg in legs:
        values = smallest_singular_values(leg, states.q)
        if values is not None:
            usual = float(np.nanmedian(values))
            if not np.isfinite(usual):  # an open chain has no closure
                break
            return lambda q: np.asarray(smallest_singular_values(leg, q)) / usual
    return lambda q: np.full(len(q), np.inf)


def _swing_start(
    leg: Leg, states: States, regularity: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Off the middle of the box in every coordinate, and moving.

    Where the leg cannot be assembled there, or hardly: at the nearest state that is as regular as half of them,
    moving away, since a singular pose lies between.
    """
    lower, upper = domain(leg)
    signs = np.where(np.arange(len(lower)) % 2 == 0, 1.0, -1.0)
    aim = 0.5 * (lower + upper) + SWING_SHARE * (upper - lower) * signs
    speed = SWING_SPEED * signs * np.linspace(1.0, 2.0, len(lower))
    if np.isfinite(next(iter(leg.assemble(aim, on_error="nan").values()))) and regularity(aim[None])[0] > ROOM_SHARE:
        return aim, speed
    share = regularity(states.q)
    q = states.q[share >= 1.0] if (share >= 1.0).any() else states.q
    start = q[np.argmin(np.abs(q - aim).max(axis=1))]
    away = np.where(start < aim, -1.0, 1.0)
    return start, away * np.abs(speed)
