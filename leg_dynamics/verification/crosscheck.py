"""Independent routes held against each other, and each against finite differences and energy."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from leg_dynamics.errors import AssemblyError, ParameterError, RowError, ShapeError
from leg_dynamics.leg import Leg
from leg_dynamics.routes import load, routes_of, sibling, with_text
from leg_dynamics.verification.comparison import ROUTE_TOLERANCE, Progress, check, compare, relative
from leg_dynamics.verification.first_principles import against_first_principles
from leg_dynamics.verification.perturbation import with_random_inertia
from leg_dynamics.verification.report import Check, CrosscheckReport
from leg_dynamics.verification.states import States, domain, sample_states, with_room
from leg_dynamics.verification.swing import SECONDS, energy_drift, free_swing

__all__ = ["crosscheck", "crosscheck_legs"]

ENERGY_TOLERANCE = 1e-9
FIRST_PRINCIPLES_SAMPLES = 50
SWING_NODES = 400
SWING_USED = 0.8
"""Share of a swing that is used where it ran into a singular closure, next to which no integrator is accurate."""
SWING_SHARE = 0.2
SWING_SPEED = 1.0


def crosscheck(
    leg: str | os.PathLike[str] | Leg,
    samples: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
    **load_options: Any,
) -> CrosscheckReport:
    """Hold the routes of a leg against each other and against first principles.

    Parameters
    ----------
    leg : str, path-like or Leg
        A shipped name or anything `leg_dynamics.load` takes, or a loaded leg. A leg without closed form is held
        against first principles only.
    samples : int
        Random states, with the corners of the domain and near-zero coordinates among them.
    seed : int
    progress : callable, optional
        Called with (what is being checked, share done in 0..1).
    **load_options
        Passed to `leg_dynamics.load`: ``urdf``, ``parameters``, ``foot``.

    Returns
    -------
    CrosscheckReport
        ``.passed``, ``.worst``, ``.checks``; prints as a table with rich.

    Raises
    ------
    ShapeError
        `samples` is not a positive whole number.
    ParameterError
        Load options were given with a leg that is loaded already.
    AssemblyError
        No route can assemble the leg in any of the states.
    """
    if isinstance(samples, bool) or not isinstance(samples, (int, np.integer)) or samples < 1:
        raise ShapeError(f"samples must be a whole number, at least 1, got {samples!r}")
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
    return crosscheck_legs(legs, name, int(samples), seed, progress)


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
    tell("joint angles that close the loops", 0.0)
    every = sample_states(domain(reference), samples, seed, reference.units.joints)
    # In the random order: each closure has to come from far away. Later ones come from the row before.
    assembled = [_assembled(leg, every, reference.tree_joint_names) for leg in legs]
    usable = ~np.all([np.isnan(angles).any(axis=1) for angles in assembled], axis=0)
    if not usable.any():
        _refuse(reference, every)
    left_out = int(np.count_nonzero(~usable))
    unordered = every.take(np.flatnonzero(usable))
    states = unordered.take(unordered.along_a_path())

    checks: list[Check] = []
    span = 0.75 / max(1, len(others))
    for number, other in enumerate(others):
        group = f"{reference.route} against {other.route}"
        start = 0.05 + number * span
        errors = relative(assembled[0][usable], assembled[number + 1][usable], 1)
        quantity = "joint angles that close the loops"
        detail = _assembly_reason((reference, other), unordered, errors)
        checks.append(check(group, quantity, errors, ROUTE_TOLERANCE, reference, unordered.q, detail=detail))
        checks += compare(reference, other, states, group, part(start, start + 0.6 * span))
        text = with_random_inertia(reference.description, seed)
        changed = with_text(reference, text), with_text(other, text)
        group = f"{group}, random inertias"
        checks += compare(*changed, states, group, part(start + 0.6 * span, start + span), kinematics=False)

    tell(f"{legs[-1].route}: free swing", 0.8)
    start_q, start_v = _swing_start(reference, states)
    swing = free_swing(legs[-1], start_q, start_v, SECONDS)
    if swing.stopped:
        swing = swing.until(SWING_USED * swing.seconds)
    swing = swing.thinned(SWING_NODES)
    for number, leg in enumerate(legs):
        tell(f"{leg.route}: first principles", 0.9 + 0.1 * number / len(legs))
        spread = np.unique(np.linspace(0, len(states) - 1, FIRST_PRINCIPLES_SAMPLES).round().astype(np.intp))
        roomy = with_room(leg, states.take(spread))
        if len(roomy) == 0:
            raise AssemblyError(
                f"{leg.name!r} has no state with room around it to take differences in by {leg.route!r}"
            )
        checks += against_first_principles(leg, roomy)
        group = f"{leg.route}: first principles"
        quantity = f"energy of a {swing.seconds:.3g} s free swing"
        measure = "relative to the largest kinetic energy"
        detail = f"the swing ended early: {swing.stopped}" if swing.stopped else ""
        checks.append(check(group, quantity, energy_drift(leg, swing), ENERGY_TOLERANCE, leg, swing.q, measure, detail))
        if leg is not legs[-1]:
            still = np.zeros((1, len(leg.actuator_names)))
            errors = relative(
                leg.acceleration(swing.q, swing.v, still, on_error="nan"),
                legs[-1].acceleration(swing.q, swing.v, still, on_error="nan"),
                1,
            )
            checks.append(check(group, "acceleration along the swing", errors, ROUTE_TOLERANCE, leg, swing.q))
    tell("done", 1.0)
    return CrosscheckReport(name, tuple(leg.route for leg in legs), samples, seed, tuple(checks), left_out)


def _assembled(leg: Leg, states: States, names: Sequence[str]) -> np.ndarray:
    coordinates = leg.assemble(states.q, on_error="nan")
    return np.stack([coordinates[name] for name in names], axis=-1)


def _refuse(leg: Leg, states: States) -> None:
    """Raise what says why nothing can be checked."""
    try:
        leg.assemble(states.q[0])
    except RowError as error:
        raise AssemblyError(
            f"no route can assemble {leg.name!r} at any of {len(states)} states within its joint limits; at the first "
            f"one: {error}",
            rows=np.arange(len(states)),
        ) from error


def _assembly_reason(legs: tuple[Leg, Leg], states: States, errors: np.ndarray) -> str:
    for row in np.flatnonzero(np.isnan(errors))[:1]:
        for leg in legs:
            try:
                leg.assemble(states.q[row])
            except RowError as error:
                return f"{leg.route}: {type(error).__name__}: {error}"
    return ""


def _swing_start(leg: Leg, states: States) -> tuple[np.ndarray, np.ndarray]:
    """Off the middle of the box in every coordinate, or the nearest state that was assembled, and moving."""
    lower, upper = domain(leg)
    signs = np.where(np.arange(len(lower)) % 2 == 0, 1.0, -1.0)
    aim = 0.5 * (lower + upper) + SWING_SHARE * (upper - lower) * signs
    speed = SWING_SPEED * signs * np.linspace(1.0, 2.0, len(lower))
    if np.isfinite(next(iter(leg.assemble(aim, on_error="nan").values()))):
        return aim, speed
    return states.q[np.argmin(np.abs(states.q - aim).max(axis=1))], speed
