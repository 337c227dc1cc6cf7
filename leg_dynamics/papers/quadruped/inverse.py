"""Equations (12) and (13) of Chen & Dong 2021 and the inverse kinematics as a whole, counted over random poses.

Feet are placed by the modules of the leg's file at known angles inside ±70°; a formula is right where it returns them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leg_dynamics.papers.comparison import EXACT, claim, compare
from leg_dynamics.papers.figures import COLOURS, STYLES, drawing, dress
from leg_dynamics.papers.framework import Check, Context, Figure, Plot, Section, Verdict
from leg_dynamics.papers.judge import judge, text, worst
from leg_dynamics.papers.quadruped import printed
from leg_dynamics.papers.quadruped.equations import over
from leg_dynamics.papers.quadruped.facts import (
    Facts,
    counted_poses,
    every,
    facts_of,
    foot_poses,
    formula,
    wrapped,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

__all__ = ["CHECKS", "RATIOS", "VARIANTS", "VERDICTS", "branches_of", "plots", "right", "sections", "threshold_ratio"]

Array = np.ndarray

RIGHT = 1e-6
"""rad; an angle nearer than this to the true one is right: wrong ones are off by far more."""

RATIOS = (0.5, 1.0, 28.0 / 15.0, 3.0, 4.5)
"""l3 / l2 that (12) as printed is tried with; the third is the shipped leg's."""


def threshold_ratio(swing: float) -> float:
    """Least l3 / l2 at which (12) as printed has a value with |theta3| up to `swing`, rad.

    Its argument is twice the cosine of the angle at the pitch axis between link 2 and the foot, so that it needs 60 deg
    there: l3 sin(theta3) = sqrt(3) (l2 + l3 cos(theta3)).
    """
    return float(np.sqrt(3.0) / (np.sin(swing) - np.sqrt(3.0) * np.cos(swing)))


# ---------------------------------------------------------------------- (12), by variants


def _corrected(context: Context, f: Facts) -> Array:
    return formula(context, f, "theta2", *f.in_plane, np.sign(f.q[:, 2]))


def _with_quadrant(f: Facts) -> Array:
    t, z = f.in_plane
    return np.asarray(np.arcsin(printed.theta_2_sine(f.lengths, t, z, 2.0)) - np.arctan2(t, z))


VARIANTS: Mapping[str, Callable[[Context, Facts], Array]] = {
    "as printed": lambda _, f: printed.theta_2(f.lengths, *f.in_plane),
    "2 l₂": lambda _, f: printed.theta_2(f.lengths, *f.in_plane, 2.0),
    "2 l₂ and −arcsin": lambda _, f: printed.theta_2(f.lengths, *f.in_plane, 2.0, -1.0),
    "2 l₂ and atan2": lambda _, f: _with_quadrant(f),
    "corrected": _corrected,
}
"""Forms of (12) from the printed one to the right one."""


def right(context: Context, f: Facts, name: str) -> tuple[Array, Array]:
    """Where a variant has a value, and where it is the angle the foot was placed with; (N,) each."""
    angle = VARIANTS[name](context, f)
    with np.errstate(invalid="ignore"):
        return np.isfinite(angle), np.abs(wrapped(angle - f.q[:, 1])) < RIGHT


def _by_ratio(context: Context) -> dict[float, int]:
    """Poses with a value of (12) as printed, by l3 / l2, at the angles of `counted_poses`."""
    q = counted_poses(context).q
    found = {}
    for ratio in RATIOS:
        lengths = printed.Lengths(0.1, 0.1, 0.1 * ratio)
        t = lengths.l2 * np.cos(q[:, 1]) + lengths.l3 * np.cos(q[:, 1] + q[:, 2])
        z = lengths.l2 * np.sin(q[:, 1]) + lengths.l3 * np.sin(q[:, 1] + q[:, 2])
        found[ratio] = int(np.isfinite(printed.theta_2(lengths, t, z)).sum())
    return found


def equation_12(context: Context) -> Verdict:
    """The factor, the sign and the quadrant."""
    f = counted_poses(context)
    count = len(f.q)
    known = {name: right(context, f, name) for name in VARIANTS}
    knee_in, below = f.q[:, 2] < 0.0, f.in_plane[1] < 0.0
    wide = facts_of(context)[0]
    wide_value, wide_right = right(context, wide, "as printed")
    without = int((~known["as printed"][0]).sum())
    ratios = _by_ratio(context)
    limit = float(context.limits[1][2])
    half = knee_in & known["2 l₂"][1]

    def mended(facts: Facts) -> Array:
        t, z = facts.in_plane
        knee = np.sign(facts.q[:, 2])
        lost = np.where(knee * z < 0.0, np.pi, 0.0)
        return wrapped(printed.theta_2(facts.lengths, t, z, 2.0, knee) + lost - facts.q[:, 1])

    corrected = every(context, lambda facts: wrapped(_corrected(context, facts) - facts.q[:, 1]))
    as_printed = every(context, lambda facts: wrapped(VARIANTS["as printed"](context, facts) - facts.q[:, 1]))
    explained = every(context, mended)
    return Verdict(
        "(12)",
        "equation",
        "θ₂ from the foot",
        judge(as_printed, EXACT, corrected=corrected, explained=explained),
        f"As printed it asks for the arcsine of more than 1 in {without} of {count} random poses inside ±70°; over the "
        f"full circle it has a value in {int(wide_value.sum())} of {len(wide.q)} and is right in "
        f"{int(wide_right.sum())}. With the factor 2 restored and the sign as printed it is right in "
        f"{int(half.sum())} of the {int(knee_in.sum())} poses with the paper's knee (θ₃ < 0); with −arcsin as well in "
        f"{int((known['2 l₂ and −arcsin'][1] & knee_in & below).sum())} of those {int((knee_in & below).sum())} with "
        f"the foot below the hip; corrected in {int(known['corrected'][1].sum())} of all {count} "
        f"(to {text(worst(corrected))} rad). No lengths help: up to l₃/l₂ = {threshold_ratio(limit):.3g} no pose "
        "inside "
        f"±70° has a value, and with ratios from {min(RATIOS):g} to {max(RATIOS):g} {sum(ratios.values())} poses do. "
        f"The defects: the factor 2, the sign that belongs to the knee, and the half-turn that the arctangent loses "
        f"where θ₃ (p_z − c) < 0 (to {text(worst(explained))}).",
        (
            Figure("no value as printed", without, "", f"of {count} poses inside ±70°"),
            Figure("no value as printed, full circle", (~wide_value).sum(), "", f"of {len(wide.q)} poses"),
            Figure("right as printed, full circle", wide_right.sum(), "", f"of {len(wide.q)} poses"),
            *(
                Figure(f"right, {name}", hits.sum(), "", f"of {count} poses inside ±70°")
                for name, (_, hits) in known.items()
            ),
            Figure("right with the factor 2 and the printed sign, θ₃ < 0", half.sum(), "", f"of {knee_in.sum()} poses"),
            Figure("least l₃/l₂ for a value inside ±70°", threshold_ratio(limit), "", "60° at the pitch axis"),
            *(
                Figure(f"values as printed, l₃/l₂ = {ratio:.3g}", number, "", f"of {count} poses inside ±70°")
                for ratio, number in ratios.items()
            ),
            Figure("corrected form, worst difference", worst(corrected), "rad", over(context, "true θ₂")),
        ),
        "θ₂ = arcsin(((p_z−c)² + T² + l₂² − l₃²)/(l₂√((p_z−c)² + T²))) − arctan(T/(p_z−c))",
        "D = (…)/(2 l₂√…);  θ₃ > 0: θ₂ = arcsin D − atan2(T, p_z−c);  θ₃ < 0: θ₂ = π − arcsin D − atan2(T, p_z−c), "
        "which is −arcsin D − arctan(T/(p_z−c)) below the hip",
    )


def equation_13(context: Context) -> Verdict:
    """The knee's angle."""

    def as_printed(f: Facts) -> Array:
        return printed.theta_3(f.lengths, *f.in_plane, f.q[:, 1])

    def off(f: Facts) -> Array:
        return wrapped(as_printed(f) - f.q[:, 2])

    def own(f: Facts) -> Array:
        return wrapped(formula(context, f, "theta3", *f.in_plane, f.q[:, 1]) - f.q[:, 2])

    def supplemented(f: Facts) -> Array:
        angle = as_printed(f)
        return wrapped(np.where(np.cos(f.q[:, 2]) < 0.0, np.pi - angle, angle) - f.q[:, 2])

    differences = every(context, off)
    inside = np.concatenate([f.inside for f in facts_of(context)])
    obtuse = np.concatenate([np.cos(f.q[:, 2]) < 0.0 for f in facts_of(context)])
    wrong = np.abs(differences) > RIGHT
    return compare(
        "(13)",
        "θ₃ from the foot and θ₂",
        over(context, "angle that the foot was placed with"),
        "rad",
        differences,
        every(context, own),
        note=f"Inside ±70° it holds (to {text(worst(differences[inside]))} rad). Beyond 90° it is wrong in "
        f"{int((wrong & obtuse).sum())} of {int(obtuse.sum())} poses, below in {int((wrong & ~obtuse).sum())}.",
        forms=("θ₃ = arcsin((c₂(p_z − c) − s₂T)/l₃)", "θ₃ = atan2 of (11) and (10)"),
        repair=("the arcsine's supplement is lost where cos θ₃ < 0", every(context, supplemented)),
        figures=[
            Figure("wrong with |θ₃| > 90°", (wrong & obtuse).sum(), "", f"of {int(obtuse.sum())} poses"),
            Figure("wrong with |θ₃| ≤ 90°", (wrong & ~obtuse).sum(), "", f"of {int((~obtuse).sum())} poses"),
            Figure("worst difference inside ±70°", worst(differences[inside]), "rad", f"{int(inside.sum())} poses"),
        ],
    )


# ---------------------------------------------------------------------- all of it


class Branches(NamedTuple):
    """The four solutions of (N,) feet."""

    q: dict[str, Array]
    """By branch, (N, 3) rad."""
    reached: dict[str, Array]
    """By branch, (N,) bool: whether the foot is within its reach."""
    missed: float
    """Greatest distance of a foot by the file's modules from the one asked for, m."""
    own: float
    """Greatest difference of a foot's nearest solution from the angles it was placed with, rad."""


def branches_of(context: Context) -> Branches:
    """Every solution of every foot of `counted_poses`."""

    def compute() -> Branches:
        f = counted_poses(context)
        angles, reached, missed = {}, {}, 0.0
        nearest = np.full(len(f.q), np.inf)
        for branch in context.formulas.BRANCHES:
            found = context.formulas.inverse_kinematics(f.numbers, tuple(f.from_hip.T), branch)
            angles[branch] = np.stack([np.broadcast_to(each, len(f.q)) for each in found.q], axis=-1)
            reached[branch] = np.asarray(found.margin) >= 0.0
            there = foot_poses(f.leg, angles[branch][reached[branch]])[:, :3, 3]
            missed = max(missed, worst(there - f.from_hip[reached[branch]]))
            off = np.abs(wrapped(angles[branch] - f.q)).max(axis=1)
            nearest = np.fmin(nearest, np.where(reached[branch], off, np.inf))
        return Branches(angles, reached, missed, float(nearest.max()))

    result: Branches = context.once("quadruped: branches", compute)
    return result


def _chain(context: Context) -> tuple[Array, Array]:
    """Angles by (8), (12) and (13) as printed, (N, 3), and where they are the right ones, (N,)."""
    f = counted_poses(context)
    first = printed.theta_1(f.p, f.mount)
    t, z = printed.T(f.lengths, f.p, first, f.mount), f.p[:, 2] - f.mount[2]
    second = printed.theta_2(f.lengths, t, z)
    angles = np.stack([first, second, printed.theta_3(f.lengths, t, z, second)], axis=-1)
    with np.errstate(invalid="ignore"):
        return angles, np.abs(wrapped(angles - f.q)).max(axis=1) < RIGHT


def solutions(context: Context) -> Verdict:
    """One solution as printed, four in truth."""
    f, found = counted_poses(context), branches_of(context)
    count = len(f.q)
    _, chain = _chain(context)
    lower, upper = context.limits
    reached = np.stack(list(found.reached.values()))
    inside = np.stack([((q >= lower) & (q <= upper)).all(axis=1) for q in found.q.values()]) & reached
    several = int((inside.sum(axis=0) > 1).sum())
    four = int(reached.all(axis=0).sum())
    return claim(
        "the inverse kinematics gives θ₁, θ₂ and θ₃",
        "Section 2.3: inverse kinematics finds the angles of leg IV from its foot",
        judge(
            float(count - chain.sum()),
            0.0,
            corrected=0.0 if max(found.own, found.missed) <= EXACT else 1.0,
            explained=0.0 if found.own <= EXACT else 1.0,
        ),
        f"(8), (12) and (13) as printed return the angles of {int(chain.sum())} of {count} feet. Corrected they return "
        f"those of all, to {text(found.own)} rad, and every branch meets its foot, to {text(found.missed)} m. The "
        "paper "
        f"mentions one solution. {four} feet have all four, hip turned to the foot or away and knee in or out; "
        f"{several} have more than one inside ±70°.",
        [
            Figure("feet right as printed", chain.sum(), "", f"of {count}"),
            Figure("angles, corrected, worst difference", found.own, "rad", f"{count} feet, nearest of the branches"),
            Figure(
                "foot missed, corrected, worst", found.missed, "m", f"{int(reached.sum())} solutions of {count} feet"
            ),
            Figure("feet with four solutions", four, "", f"of {count}"),
            Figure("feet with more than one solution inside ±70°", several, "", f"of {count}"),
        ],
        ("(8), (12), (13): one solution", "four branches, (8), (12) and (13) corrected"),
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (equation_12, equation_13, solutions)
"""One function an item."""


def inverse_returns(context: Context) -> Check:
    """All branches over all poses."""
    found = branches_of(context)
    return Check(
        "inverse kinematics on all branches",
        max(found.own, found.missed),
        EXACT,
        "rad, m",
        f"{len(counted_poses(context).q)} feet placed by the file's modules inside ±70°: own angles, and the foot of "
        "every branch",
    )


CHECKS: tuple[Callable[[Context], Check], ...] = (inverse_returns,)
"""What must hold."""


# ---------------------------------------------------------------------- page


def plots(context: Context) -> tuple[Plot, ...]:
    """Drawings of this module."""
    return (
        Plot(
            "inverse",
            "(12) and (13) as printed",
            "Left: argument of the arcsine of (12) over the knee's angle, which has to stay below 1; the shaded knee "
            "is inside ±70°. Right: the solutions for the foot of (4); only one is inside ±70°.",
            functools.partial(_draw, context),
            ("(12)", "(13)", "claim: the inverse kinematics gives θ₁, θ₂ and θ₃"),
        ),
    )


def _draw(context: Context) -> Drawing:
    figure = drawing(10.5, 4.2)
    left, right_panel = figure.subplots(1, 2, width_ratios=(1.0, 1.1))
    f = facts_of(context)[0]
    knee = np.radians(np.linspace(-179.0, 179.0, 359))
    l1, l2, l3 = f.lengths
    t, z = l2 + l3 * np.cos(knee), l3 * np.sin(knee)
    for k, (label, factor) in enumerate((("l₂ in the denominator, as printed", 1.0), ("2 l₂, corrected", 2.0))):
        sine = printed.theta_2_sine(f.lengths, t, z, factor)
        left.plot(np.degrees(knee), sine, color=COLOURS[1 - k], linestyle=STYLES[k], label=label)
    swing = np.degrees(float(context.limits[1][2]))
    left.axvspan(-swing, swing, color="0.5", alpha=0.12, linewidth=0.0)
    left.axhline(1.0, color="0.3", linewidth=0.9)
    left.set_xticks([-180, -90, 0, 90, 180])
    dress(left, title="Argument of the arcsine", xlabel="θ₃ [deg]")
    left.legend(frameon=False, fontsize=9)
    foot = f.from_hip[0]
    for k, branch in enumerate(context.formulas.BRANCHES):
        found = context.formulas.inverse_kinematics(f.numbers, tuple(foot), branch)
        if float(found.margin) < 0.0:
            continue
        q1, q2, q3 = (float(np.asarray(each)) for each in found.q)
        way = np.cos(q1)
        x = way * np.array([0.0, l1, l1 + l2 * np.cos(q2), l1 + l2 * np.cos(q2) + l3 * np.cos(q2 + q3)])
        height = np.array([0.0, 0.0, l2 * np.sin(q2), l2 * np.sin(q2) + l3 * np.sin(q2 + q3)])
        angles = ", ".join(f"{round(np.degrees(each)) + 0}°" for each in (q1, q2, q3))
        label = f"{branch.replace('_', ' ')}: {angles}"
        right_panel.plot(1e3 * x, 1e3 * height, color=COLOURS[k], linestyle=STYLES[k], marker="o", label=label)
    dress(right_panel, title="Solutions for the foot of (4)", xlabel="outwards [mm]", ylabel="up [mm]")
    right_panel.set_aspect("equal")
    right_panel.set_xlim(-60.0, 240.0)
    right_panel.set_ylim(-250.0, 20.0)
    right_panel.legend(frameon=False, fontsize=8.5, loc="lower left")
    return figure


def sections(context: Context) -> tuple[Section, ...]:
    """The table of variants."""
    f = counted_poses(context)
    knee_in, below = f.q[:, 2] < 0.0, f.in_plane[1] < 0.0
    rows = []
    for name in VARIANTS:
        valued, hits = right(context, f, name)
        parts = [knee_in & below, knee_in & ~below, ~knee_in & below, ~knee_in & ~below]
        shares = (f"{int(hits[part].sum())} of {int(part.sum())}" for part in parts)
        rows.append((name, f"{int(valued.sum())} of {len(f.q)}", *shares))
    return (
        Section(
            "inverse-kinematics",
            "Inverse kinematics",
            (
                f"{len(f.q)} feet placed by the modules of the leg's file at random angles inside ±70°. (12) as "
                "printed "
                "cannot be evaluated at one of them. The factor 2 alone does not save it: the printed sign belongs to "
                "the other knee, and the arctangent loses half a turn below the hip.",
            ),
            (
                "(12)",
                "has a value",
                "right: θ₃ < 0, foot below the hip",
                "θ₃ < 0, above",
                "θ₃ > 0, below",
                "θ₃ > 0, above",
            ),
            tuple(rows),
            ("inverse",),
            note="Right is nearer than 1e-06 rad to the angle that the foot was placed with.",
        ),
    )
