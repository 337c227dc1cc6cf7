"""Workspace of any leg: its constraints, reachable set, boundary, dexterity, step length and height."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.analysis.dexterity import Dexterity, home_coordinates, weighted_dexterity
from leg_dynamics.analysis.workspace.boundary import boundary, climb
from leg_dynamics.analysis.workspace.constraints import Constraint, constraints_of
from leg_dynamics.analysis.workspace.foot import FootEvaluator, Slice, slice_at
from leg_dynamics.analysis.workspace.poses import PoseEvaluator, Poses, margins
from leg_dynamics.analysis.workspace.result import Injectivity, Workspace
from leg_dynamics.analysis.workspace.sampling import (
    Estimate,
    Level,
    Reachable,
    cartesian_volume,
    choose_sign,
    reachable_set,
)
from leg_dynamics.analysis.workspace.step import DEFINITION, Step, step_sizes
from leg_dynamics.errors import LegDynamicsWarning, ParameterError, WorkspaceError

if TYPE_CHECKING:
    from leg_dynamics.leg import Leg

__all__ = [
    "DEFINITION",
    "Constraint",
    "Dexterity",
    "Estimate",
    "FootEvaluator",
    "Injectivity",
    "Level",
    "PoseEvaluator",
    "Poses",
    "Slice",
    "Step",
    "Workspace",
    "boundary",
    "cartesian_volume",
    "constraints_of",
    "margins",
    "reachable_set",
    "step_sizes",
    "workspace",
]

TOLERANCE, NUMERIC_TOLERANCE = 0.002, 0.02
"""Of the volume where none is asked for: of compiled routes, and of the others, which are a thousand times slower."""

_SEVERAL = 0.002
"""Share of samples with several poses above which the volume is said to count positions more than once."""


def workspace(
    leg: Leg,
    *,
    tolerance: float | None = None,
    ignore: Iterable[str] = (),
    height: float | None = None,
    characteristic_length: float | None = None,
    most_samples: int | None = None,
    seed: int = 0,
    progress: Callable[[str, float], None] | None = None,
) -> Workspace:
    """Compute the workspace of a leg's foot.

    Poses count that fulfil every constraint (see `constraints_of`) in the leg's assembly mode, on the home pose's side
    of the singularities (the sign of det J).

    Parameters
    ----------
    leg : Leg
        With a foot and one, two or three independent coordinates.
    tolerance : float, optional
        Relative, of the volume; the number of samples follows from it. 0.002 by default, 0.02 for a route that is not
        compiled.
    ignore : iterable of str
        Names or kinds (``joint``, ``cone``, ``telescope``, ``clearance``) of constraints to leave out.
    height : float, optional
        z of the foot's home position for step sizes and slices, m; that of the home configuration by default.
    characteristic_length : float, optional
        m; makes rad and m comparable in the condition number of a leg that has both.
    most_samples : int, optional
        Where to give up refining.
    seed : int
        Of all random numbers: the same seed gives the same result, to the bit.
    progress : callable, optional
        Called with a text and a share from 0 to 1.

    Returns
    -------
    Workspace

    Raises
    ------
    WorkspaceError
        The workspace is empty (says which constraint is in the way), flat, or infinite.
    UnsupportedError
        The leg has more than three independent coordinates.
    MissingFootError
        It has no foot.
    ParameterError
        An argument is not usable.

    Warns
    -----
    LegDynamicsWarning
        The tolerance was not reached, or foot positions have several feasible poses.
    """
    say = progress or (lambda what, share: None)
    ignored = tuple(ignore)
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise ParameterError(f"seed = {seed!r} must be a whole number, not negative")
    if height is not None and not np.isfinite(height):
        raise ParameterError(f"height = {height!r} must be a finite number of metres")
    evaluate = PoseEvaluator(leg, characteristic_length=characteristic_length, ignore=ignored)
    if tolerance is None:
        tolerance = TOLERANCE if evaluate.is_compiled else NUMERIC_TOLERANCE
    home = home_coordinates(leg)
    evaluate.sign = choose_sign(evaluate, home)

    began, before = time.perf_counter(), evaluate.count
    reachable = reachable_set(
        evaluate,
        tolerance=tolerance,
        seed=seed,
        most_samples=most_samples,
        progress=lambda what, share: say(what, 0.5 * share),
    )
    seconds, evaluated = time.perf_counter() - began, evaluate.count - before
    assert evaluated == reachable.sampled
    poses, weights = reachable.poses, reachable.weights
    regular = np.isfinite(poses.condition)
    statistics = weighted_dexterity(
        poses.condition[regular],
        poses.smallest[regular],
        weights[regular],
        evaluate.unit,
        evaluate.characteristic_length,
    )
    say("boundary", 0.55)
    border, border_active = boundary(evaluate, {1: 1001, 2: 121}.get(len(home), 28) if evaluate.is_compiled else 8)
    say("extremes", 0.6)
    goals = [lambda found, k=k, side=side: side * found.foot[:, k] for k in range(3) for side in (-1.0, 1.0)]
    *ends, best = climb(evaluate, Poses.joined([poses, border]), [*goals, lambda found: -found.condition], seed)
    statistics = replace(statistics, smallest=float(best.condition[0]))
    lower, upper = (np.array([ends[2 * k + side].foot[0, k] for k in range(3)]) for side in (0, 1))

    foot = FootEvaluator(evaluate, poses)
    down = 1.0 if leg.gravity[2] >= 0.0 else -1.0
    step, reason, slices = None, "", []
    say("slices", 0.7)
    if not foot.available:
        reason = "the leg has not three coordinates: most foot positions have no pose"
        injectivity = Injectivity(0, 0.0, None, 0, reachable.other_sign)
    else:
        at_home = leg.foot_position(home)
        if height is not None:
            at_home = np.array([at_home[0], at_home[1], height])
        resolution = (161 if leg.route == "closed_form" else 81) if foot.is_quick else 25
        slices = [slice_at(foot, k, float(at_home[k]), lower, upper, resolution) for k in (1, 2)]
        say("step sizes", 0.8)
        try:
            step = step_sizes(foot, at_home, lower, upper, down)
        except WorkspaceError as error:
            reason = str(error)
        say("injectivity", 0.9)
        injectivity = _injectivity(foot, reachable, lower, upper, tolerance, seed)
    say("done", 1.0)
    result = Workspace(
        leg=leg.name,
        route=leg.route,
        joint_names=leg.joint_names,
        joint_units=leg.units.joints,
        parameters={name: each.value for name, each in leg.parameters.items()},
        constraints=evaluate.constraints,
        ignored=ignored,
        names=evaluate.names,
        poses=poses,
        weights=weights,
        volume=reachable.volume,
        mean=reachable.mean,
        deviation=reachable.deviation,
        dexterity=statistics,
        lower=lower,
        upper=upper,
        best=best,
        border=border,
        border_active=border_active,
        step=step,
        step_reason=reason,
        slices=tuple(slices),
        injectivity=injectivity,
        levels=reachable.levels,
        tolerance=tolerance,
        converged=reachable.converged,
        sampled=reachable.sampled,
        evaluated=evaluate.count,
        seconds=seconds,
        seed=seed,
        down=down,
    )
    if injectivity.several > _SEVERAL:
        warnings.warn(
            f"{100 * injectivity.several:.2g} % of the foot positions have several feasible poses: the volume counts "
            "each of them; `injectivity.cartesian` counts positions once",
            LegDynamicsWarning,
            stacklevel=2,
        )
    return result


def _injectivity(
    foot: FootEvaluator, reachable: Reachable, lower: np.ndarray, upper: np.ndarray, tolerance: float, seed: int
) -> Injectivity:
    """Count the poses of some samples' foot positions, and take the volume by positions."""
    poses = reachable.poses
    count = min(len(poses), 4000 if foot.is_quick else 100)
    rows = np.random.default_rng(seed).choice(len(poses), count, replace=False)
    _, found = foot.counted(poses.foot[rows])
    pad = 0.01 * (upper - lower)
    most = (1 << 18) if foot.is_quick else (1 << 10)
    cartesian, samples = cartesian_volume(
        lambda p: foot(p).feasible,
        lower - pad,
        upper + pad,
        tolerance=max(tolerance, 0.004),
        seed=seed,
        most_samples=most,
    )
    return Injectivity(count, float(np.mean(found > 1)), cartesian, samples, reachable.other_sign)
