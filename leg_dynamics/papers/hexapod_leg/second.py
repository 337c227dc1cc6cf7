"""Second calculations of the gait and of the designs: by the analysis room, and by force.

The gait of the items is one leg's foot cycle by the paper's formulas; here the six-legged robot of the shipped file
walks, its legs by the numeric route. The designs of the items are formulas on arrays; here they are poses of the leg's
file with its own constraints, and plain vectors (`brute_force`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leg_dynamics.papers.framework import Check, Context
from leg_dynamics.papers.hexapod_leg import brute_force, reported, study
from leg_dynamics.papers.hexapod_leg.facts import BEYOND_THE_PAPER, preliminary
from leg_dynamics.papers.hexapod_leg.gait import ASSUMED, SUPPORT, walk

if TYPE_CHECKING:
    from leg_dynamics.analysis.gait import GaitStudy

__all__ = ["CHECKS", "Again", "brute_means", "brute_medians", "designs_again", "gait_difference", "walk_again"]

Array = np.ndarray

GRAVITY = 9.81

DESIGNS = 100
"""Of the Monte Carlo method's, computed again by the analysis room."""

CHORDS = 1000
"""Of the Monte Carlo method's, whose chord is marched along."""

FEET = 300_000
"""Random feet of a design, by force."""

STROKES = (0.1, 0.3, 0.35, 0.4)
"""m; least lengths of strut 2 at which the mean condition number is computed by force."""


# ---------------------------------------------------------------------- the gait


def walk_again(context: Context, period: float, stride: float, clearance: float) -> GaitStudy:
    """The robot on one of the assumed gaits; its body as heavy as `SUPPORT` a standing foot asks for."""
    from leg_dynamics.analysis import gait
    from leg_dynamics.description import read

    def compute() -> GaitStudy:
        robot = context.once("hexapod: robot again", lambda: gait.robot_from(read("hexapod"), context.pinocchio))
        home = [limb.leg.inverse_kinematics(limb.to_leg(limb.home))[None] for limb in robot.limbs]
        legs = robot.centre_of_mass(home)[0] - robot.trunk_mass
        heavy = replace(robot, trunk_mass=3.0 * SUPPORT / GRAVITY - legs)
        plan = gait.plan(heavy, "tripod", period=period, stride=stride, clearance=clearance)
        return gait.study(heavy, plan, samples=40, load="equal", limits="ignore")

    result: GaitStudy = context.once(f"hexapod: walk again {period} {stride} {clearance}", compute)
    return result


class Difference(NamedTuple):
    """Greatest difference between both calculations of the gaits, over all legs and instants compared."""

    speed: float
    """m/s."""
    force: float
    """N."""
    share: float
    """The greater of both, of the greatest speed or force of its gait."""
    instants: int


def gait_difference(context: Context) -> Difference:
    """Speeds and forces of every leg of the robot against those of the one leg's cycle."""

    def compute() -> Difference:
        worst, share, instants = [0.0, 0.0], 0.0, 0
        for assumed in ASSUMED:
            one, again = walk(context, *assumed), walk_again(context, *assumed)
            for motion, phase in zip(again.limbs, again.walk.table.phases, strict=True):
                # The cycle begins with the swing, half a period before the touch-down; forces jump between both.
                since = np.mod(again.time / one.period - phase + 0.5, 1.0)
                inner = np.abs(np.mod(since, 0.5) - 0.25) < 0.249
                instants += int(inner.sum())
                for k, (mine, other) in enumerate(((one.rates, motion.trajectory.v), (one.force, motion.effort))):
                    columns = [np.interp(since[inner] * one.period, one.time, column) for column in mine.T]
                    off = float(np.abs(np.stack(columns, axis=-1) - other[inner]).max())
                    worst[k], share = max(worst[k], off), max(share, off / float(np.abs(mine).max()))
        return Difference(worst[0], worst[1], share, instants)

    result: Difference = context.once("hexapod: difference of the gaits", compute)
    return result


def gaits_agree(context: Context) -> Check:
    """Speeds and forces of every leg against those of the one leg's cycle."""
    found = gait_difference(context)
    return Check(
        "speeds and forces in the tripod gait, two ways",
        found.share,
        1e-9,
        "of the greatest one",
        "one leg's foot cycle by the formulas against six legs of the robot's file by the numeric route, "
        f"{len(ASSUMED)} gaits, {found.instants} poses",
    )


# ---------------------------------------------------------------------- the designs


class Again(NamedTuple):
    """Some of the Monte Carlo method's designs by the analysis room."""

    rows: Array
    """Which, (D,)."""
    length: Array
    """L, m; 0 where the initial pose is not feasible."""
    back: Array
    """Z behind, m; NaN where the initial pose is not feasible."""
    mean: Array
    """k̄."""
    half_width: float
    """Of k̄, relative, at 99 %."""


def designs_again(context: Context) -> Again:
    """L, Z_b and k̄ of the first designs of the Monte Carlo method, by `leg_dynamics.analysis.design`."""

    def compute() -> Again:
        from leg_dynamics.analysis.design import Range, Stage, Study
        from leg_dynamics.analysis.design.study import Evaluator, Plan

        drawn = study.monte_carlo(context)
        ranges = tuple(Range(name, *reported.PRIMARY_RANGES[name]) for name in drawn.names)
        objectives = ("L", "Z_b", "V", "kbar")
        plan = Plan.of(
            Study(
                preliminary(context),
                (Stage(ranges, DESIGNS),),
                objectives=objectives,
                ignore=BEYOND_THE_PAPER,
                seed=context.seed,
            )
        )
        evaluator = Evaluator(plan)
        rows = np.arange(DESIGNS)
        found = [
            evaluator.row(int(k), dict(zip(drawn.names, map(float, drawn.values[k]), strict=True))).values for k in rows
        ]
        length, back, _, mean = np.array([[each[name] for name in objectives] for each in found]).T
        # The analysis room gives no step where the initial pose is not feasible; the items count that as a step of 0.
        length = np.nan_to_num(length, nan=0.0)
        return Again(rows, length, back, mean, plan.resolution.half_widths["kbar"])

    result: Again = context.once("hexapod: designs again", compute)
    return result


def steps_of_designs_agree(context: Context) -> Check:
    """L and Z_b of random designs against the analysis room."""
    drawn, again = study.monte_carlo(context), designs_again(context)
    length, back = drawn.steps.length[again.rows], drawn.steps.back[again.rows]
    # Where the initial pose is not feasible there is no step at all, and no Z.
    standing = (length > 0.0) | (again.length > 0.0)
    worst = max(float(np.abs(length - again.length).max()), float(np.abs(back - again.back)[standing].max(initial=0.0)))
    return Check(
        "L and Z behind of random designs, two ways",
        worst,
        study.LENGTH_NOISE,
        "m",
        f"{DESIGNS} designs: formulas of section 4, interpolated, against poses and constraints of the leg's file",
    )


def dexterity_of_designs_agree(context: Context) -> Check:
    """k̄ of random designs against the analysis room."""
    drawn, again = study.monte_carlo(context), designs_again(context)
    mine = drawn.mean[again.rows]
    both = np.isfinite(mine) & np.isfinite(again.mean)
    error = float(np.median(np.abs(mine[both] / again.mean[both] - 1.0))) if both.any() else np.nan
    return Check(
        "k̄ of random designs, two ways",
        error,
        0.01,
        "relative, median of the designs",
        f"{int(both.sum())} designs; {2 * study.FEW} points each against as many as make k̄ certain to "
        f"{100 * again.half_width:.1g} %",
    )


# ---------------------------------------------------------------------- by force


class Medians(NamedTuple):
    """Medians of the chords of some random designs, m, by force and by the items' own way; all, and where it is > 0."""

    designs: int
    away: float
    """Share of the designs whose initial pose is not feasible."""
    every: float
    able: float
    own_every: float
    own_able: float
    worst: float
    """Greatest difference of one chord."""


def brute_medians(context: Context) -> Medians:
    """L of the first designs of the Monte Carlo method, by marching."""

    def compute() -> Medians:
        drawn = study.monte_carlo(context)
        base = study.design_of(preliminary(context))
        found = np.array(
            [
                brute_force.chord(replace(base, **dict(zip(drawn.names, map(float, row), strict=True))))
                for row in drawn.values[:CHORDS]
            ]
        )
        own = drawn.steps.length[:CHORDS]
        return Medians(
            len(found),
            float((found == 0.0).mean()),
            float(np.median(found)),
            float(np.median(found[found > 0.0])),
            float(np.median(own)),
            float(np.median(own[own > 0.0])),
            float(np.abs(found - own).max()),
        )

    result: Medians = context.once("hexapod: chords by force", compute)
    return result


def brute_means(context: Context) -> dict[float, brute_force.Mean]:
    """Mean condition number by force, by the least length of strut 2 (m), the other lengths as in section 4.1."""

    def compute() -> dict[float, brute_force.Mean]:
        base = study.design_of(preliminary(context))
        return {
            value: brute_force.mean_condition(replace(base, l2_min=value), context.rng(60), FEET)[1]
            for value in STROKES
        }

    result: dict[float, brute_force.Mean] = context.once("hexapod: means by force", compute)
    return result


def chords_agree(context: Context) -> Check:
    """L of random designs by marching."""
    found = brute_medians(context)
    return Check(
        "L of random designs, by force",
        found.worst,
        2.0 * brute_force.MARCH + study.LENGTH_NOISE,
        "m",
        f"{found.designs} designs, marched along in steps of {1e3 * brute_force.MARCH:g} mm",
    )


def means_agree(context: Context) -> Check:
    """k̄ over the least length of strut 2, by force."""
    base = study.design_of(preliminary(context))
    worst = 0.0
    for value, mean in brute_means(context).items():
        own = study.measure(context, replace(base, l2_min=value)).mean
        worst = max(worst, abs(own.value - mean.value) / (own.half_width + mean.half_width))
    return Check(
        "k̄ over l₂min, by force",
        worst,
        1.0,
        "of the two 99 % intervals",
        f"differences of lengths at {FEET} random feet, of which the feasible ones count, against (24) as corrected",
    )


CHECKS: tuple[Callable[[Context], Check], ...] = (
    gaits_agree,
    steps_of_designs_agree,
    dexterity_of_designs_agree,
    chords_agree,
    means_agree,
)
