"""What Chen & Dong 2021 says of the walk's rhythm, its steadiness and the design, judged by the gait of `walking`."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leg_dynamics.papers.comparison import claim
from leg_dynamics.papers.figures import COLOURS, STYLES, drawing, dress
from leg_dynamics.papers.framework import Context, Figure, Plot, Section, Status, Verdict
from leg_dynamics.papers.judge import judge
from leg_dynamics.papers.quadruped import printed, reported
from leg_dynamics.papers.quadruped.facts import facts_of, hip_in_body
from leg_dynamics.papers.quadruped.walking import (
    ADVANCE,
    CLEARANCE,
    DUTY,
    EDGE,
    HARMONICS,
    NEUTRAL,
    PERIOD,
    SWAY_BOUND,
    SWAYED_DUTY,
    Numbering,
    cap,
    foot_curves,
    margins_of,
    numberings,
    places_of,
    robot_of,
    studied,
    swaying,
    walk_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from leg_dynamics.analysis.gait import GaitStudy, Walk

__all__ = ["VERDICTS", "Caps", "caps_of", "plain", "plots", "round_the_body", "sections", "shipped", "swayed"]

Array = np.ndarray

ZERO = 1e-6
"""m; a margin this small is none: samples stand off the switches of the gait by `EDGE` of a period."""

DUTIES = (DUTY, 0.8, 0.85, 0.9)

BOUNDS = (0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03)
"""m; of the sway, for the drawing."""

STEPS = (0.06, 0.03)
"""m; step and clearance that the audit tries the pose of (4) with."""

POSE_OF_4 = (30.0, printed.POSE_4[1], printed.POSE_4[2])
"""deg; splay, and theta2 and theta3 of (4)."""


class Caps(NamedTuple):
    """Of one numbering of the legs at the inferred duty factor, m."""

    numbering: Numbering
    uniform: float
    """Least margin of a body that moves evenly, centre of mass in its middle."""
    whole: float
    """The same with all masses where they are."""
    drift: float
    """How far the moving legs then take the centre of mass sideways."""
    straight: float
    """What no motion of the body straight ahead can exceed, however uneven, with that drift either way."""
    free: float
    """What no motion of the body at all can exceed."""


def caps_of(context: Context) -> tuple[Caps, ...]:
    """Every numbering of the legs, best first."""

    def compute() -> tuple[Caps, ...]:
        found = []
        for each in numberings(context):
            walk = walk_of(context, each.order)
            uniform = float(margins_of(walk)[1].min())
            result = studied(context, walk, load="none")
            drift = float(np.abs(result.com[:, 1]).max())
            margin = float(result.margin.min())
            found.append(Caps(each, uniform, margin, drift, cap(walk, drift), cap(walk, np.inf)))
        return tuple(sorted(found, key=lambda each: -each.uniform))

    result: tuple[Caps, ...] = context.once("quadruped: caps", compute)
    return result


def shipped(context: Context) -> Caps:
    """The numbering of the robot's file."""
    return next(each for each in caps_of(context) if each.numbering.order == reported.ORDER)


def round_the_body(context: Context) -> Caps:
    """The best numbering in which the legs swing round the body."""
    return next(each for each in caps_of(context) if each.numbering.round_the_body)


def plain(context: Context, duty: float = DUTY) -> GaitStudy:
    """The file's robot with a body that moves evenly."""
    result: GaitStudy = context.once(
        f"quadruped: plain {duty}", lambda: studied(context, walk_of(context, duty=duty), load="equal")
    )
    return result


def swayed(context: Context) -> GaitStudy:
    """The file's robot with shorter steps and the best sway."""
    return swaying(context, reported.ORDER, SWAYED_DUTY, (SWAY_BOUND, SWAY_BOUND))


def _round_swayed(context: Context) -> GaitStudy:
    order = round_the_body(context).numbering.order
    return swaying(context, order, DUTY, (SWAY_BOUND, SWAY_BOUND))


def _mm(value: float) -> str:
    """A margin in mm; rounding is not shown as a sign."""
    return f"{1e3 * value:.2f}" if abs(value) > ZERO else "0"


# ---------------------------------------------------------------------- claims


def rhythm(context: Context) -> Verdict:
    """III, I, IV, II; IV from 10 to 15 s."""
    walk = walk_of(context)
    names = sorted(reported.ORDER)
    touch = np.array(walk.table.phases) * PERIOD
    lift = np.mod(touch - (1.0 - DUTY) * PERIOD, PERIOD)
    times = {name: (float(lift[k]), float(touch[k] or PERIOD)) for k, name in enumerate(names)}
    order = tuple(sorted(times, key=lambda name: times[name][0]))
    off = np.subtract(times["IV"], reported.STEP_OF_IV)
    together = np.arange(2000) / 2000.0
    air = int((~walk.table.in_stance(together)).sum(axis=-1).max())
    return claim(
        "legs step in the order III, I, IV, II, and IV from 10 to 15 s",
        "Sections 1.2 and 3: order of the legs and time of leg IV's step",
        judge([*off, float(order != reported.ORDER), air - 1.0], 1e-9),
        f"The two fit together if the legs lift off evenly and T = {PERIOD:g} s with a duty factor of {DUTY:g}: "
        + ", ".join(f"{name} {times[name][0]:g} to {times[name][1]:g} s" for name in order)
        + ". Neither number is in the paper; both are inferred. One leg at a time is in the air.",
        [
            Figure("period", PERIOD, "s", "inferred: leg IV is third of four and lifts off at 10 s"),
            Figure("duty factor", DUTY, "", "inferred: 5 s of the period in the air"),
            *(
                Figure(f"leg {name} {what}", time, "s", "gait engine")
                for name in order
                for what, time in zip(("lifts off", "touches down"), times[name], strict=True)
            ),
        ],
    )


def steady(context: Context) -> Verdict:
    """Static stability at the inferred duty factor."""
    caps, best = caps_of(context), caps_of(context)[0]
    own, turning = shipped(context), round_the_body(context)
    worst_one = caps[-1]
    straight = max(each.straight for each in caps)
    slower, swaying_one, round_one = plain(context, SWAYED_DUTY), swayed(context), _round_swayed(context)
    dwell = {duty: float(margins_of(walk_of(context, duty=duty))[1].min()) for duty in DUTIES}
    stuck = [each for each in caps if each.free <= ZERO]
    total = sum(each.numbering.ways for each in caps)
    on_it = places_of(context)
    return claim(
        "the robot walks steadily",
        "Sections 3 and 4: with legs III, I, IV, II stepping in turn and the body going straight ahead the robot walks "
        "steadily",
        # Each is 1 where there is no margin.
        judge(
            float(straight <= ZERO),
            0.0,
            corrected=[float(each.margin.min() <= ZERO) for each in (slower, swaying_one, round_one)],
            explained=float(slower.margin.min() <= ZERO),
        ),
        f"Static stability is not shown. With steps of 5 s a body that moves evenly has a least margin of "
        f"{_mm(best.uniform)} mm for the best of {total} ways to number the legs "
        f"({', '.join(best.numbering.places)}, the "
        f"file's) and {_mm(worst_one.uniform)} mm for the worst. In {sum(e.numbering.ways for e in stuck)} of them "
        "a leg "
        "touches down as the one diagonally across lifts off: the feet before and after share that diagonal alone, "
        "and no "
        f"motion of the body gives more than {_mm(max(e.free for e in stuck))} mm. In the other "
        f"{sum(e.numbering.ways for e in caps if e not in stuck)} legs swing round the body, and it has to sway "
        "sideways, "
        f"which Fig. 7 excludes: straight ahead they reach {_mm(turning.straight)} mm. Shorter steps help: duty "
        f"{SWAYED_DUTY:g} gives {_mm(slower.margin.min())} mm with all masses, and {_mm(swaying_one.margin.min())} "
        "mm with "
        f"a sway of up to {1e3 * SWAY_BOUND:.0f} mm each way. Round the body that sway turns {_mm(turning.whole)} mm "
        "into "
        f"{_mm(round_one.margin.min())} mm at duty {DUTY:g}.",
        [
            *(
                Figure(
                    f"least margin, {', '.join(each.numbering.places)}",
                    each.uniform,
                    "m",
                    f"even motion, duty {DUTY:g}, centre of mass in the middle",
                )
                for each in caps
            ),
            *(
                Figure(
                    f"least margin, all masses, {', '.join(each.numbering.places)}",
                    each.whole,
                    "m",
                    f"even motion, duty {DUTY:g}; legs move the centre of mass by {1e3 * each.drift:.1f} mm sideways",
                )
                for each in caps
            ),
            *(
                Figure(
                    f"cap, {', '.join(each.numbering.places)}, {what}",
                    value,
                    "m",
                    f"of any motion of the body, duty {DUTY:g}",
                )
                for each in caps
                for what, value in (("straight ahead", each.straight), ("free", each.free))
            ),
            *(
                Figure(f"least margin, duty {duty:g}", value, "m", "even motion, legs as in the file")
                for duty, value in dwell.items()
            ),
            Figure("least margin, all masses, even motion", plain(context).margin.min(), "m", f"duty {DUTY:g}"),
            Figure("least margin, all masses, shorter steps", slower.margin.min(), "m", f"duty {SWAYED_DUTY:g}"),
            Figure(
                "least margin, all masses, shorter steps and sway",
                swaying_one.margin.min(),
                "m",
                f"duty {SWAYED_DUTY:g}, sway up to {1e3 * SWAY_BOUND:.0f} mm each way",
            ),
            Figure(
                "least margin, all masses, round the body and sway",
                round_one.margin.min(),
                "m",
                f"duty {DUTY:g}, sway up to {1e3 * SWAY_BOUND:.0f} mm each way",
            ),
            Figure("cap of the file's numbering", own.free, "m", f"legs {', '.join(sorted(on_it))}, duty {DUTY:g}"),
        ],
        (
            f"steps of 5 s in {PERIOD:g} s, body straight ahead",
            f"steps shorter than {PERIOD / len(reported.ORDER):g} s, or legs round the body and a sway",
        ),
    )


def _knee_range(context: Context, walk: Walk) -> tuple[float, float]:
    """Least and greatest theta3 of leg IV, deg."""
    q = np.degrees(foot_curves(context, walk, np.linspace(0.0, PERIOD, 2001)).q[:, 2])
    return float(q.min()), float(q.max())


def _trials(context: Context) -> dict[str, Walk]:
    step, lift = STEPS
    return {
        "pose of (4), splay 30°": walk_of(context, advance=step, clearance=lift, neutral=POSE_OF_4),
        "(−40°, −30°), splay 20°": walk_of(context, advance=step, clearance=lift, neutral=(20.0, -40.0, -30.0)),
        "assumed here": walk_of(context),
    }


def sound_design(context: Context) -> Verdict:
    """Swing limits and neighbouring legs."""
    step, lift = STEPS
    ranges = {name: _knee_range(context, walk) for name, walk in _trials(context).items()}
    of_4, other, _ = ranges.values()
    apart = abs(hip_in_body(context, "II")[1, 3] - hip_in_body(context, "IV")[1, 3])
    gap = apart - reported.SIZE[1]
    nearest = plain(context).nearest_limits()[0]
    return claim(
        "the design is sound",
        "Sections 3 and 4: the simulation shows that the design is reasonable",
        # Stride, clearance and pose of the simulated walk are not given, and the swings' limits depend on them.
        Status.NOT_REPRODUCIBLE,
        "Stride, clearance and stance are not given. From the pose of (4), splayed by 30°, a step of "
        f"{1e3 * step:.0f} mm "
        f"by {1e3 * lift:.0f} mm asks for θ₃ = {of_4[0]:.0f}°, beyond ±{reported.SWING:.0f}°; from (−40°, −30°), "
        "splayed "
        f"by 20°, for {other[0]:.0f}° to {other[1]:.0f}°, which fits. Legs are {1e3 * reported.SIZE[1]:.0f} mm wide "
        "and "
        f"their hips {1e3 * apart:.0f} mm apart, so that neighbours have {abs(1e3 * gap):.0f} mm between them at θ₁ "
        "= 0: "
        f"they have to be splayed. The walk assumed here keeps {np.degrees(nearest.least):.0f}° from all limits.",
        [
            *(
                Figure(f"θ₃ of leg IV, {end}, {name}", np.radians(value), "rad", "over a cycle")
                for name, both in ranges.items()
                for end, value in zip(("least", "greatest"), both, strict=True)
            ),
            Figure("room between neighbouring legs", gap, "m", "hips' distance less the module's width, θ₁ = 0"),
            Figure("nearest limit of the walk assumed here", nearest.least, "rad", nearest.name),
        ],
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (rhythm, steady, sound_design)
"""One function a claim."""


# ---------------------------------------------------------------------- page


def plots(context: Context) -> tuple[Plot, ...]:
    """Drawings of this module."""
    return (
        Plot(
            "stability",
            "Static stability over a cycle",
            "Left: margin of four walks, all masses counted; beyond the panel while all feet stand. Right: what a "
            "sway adds, with the centre of mass in the "
            f"middle, over its greatest value; at duty {DUTY:g} the file's numbering has no more than 0.",
            functools.partial(_draw_margins, context),
            ("claim: the robot walks steadily",),
        ),
        Plot(
            "knee",
            "θ₃ of leg IV against the limit of ±70°",
            f"Steps of {1e3 * STEPS[0]:.0f} mm by {1e3 * STEPS[1]:.0f} mm from two poses, and the walk assumed here "
            f"({1e3 * ADVANCE:.0f} mm by {1e3 * CLEARANCE:.0f} mm).",
            functools.partial(_draw_knee, context),
            ("claim: the design is sound", "(4)"),
        ),
    )


def _draw_margins(context: Context) -> Drawing:
    from leg_dynamics.papers.quadruped.walking import best_sway

    figure = drawing(11.0, 4.6)
    left, right = figure.subplots(1, 2)
    walks = (
        (f"even motion, duty {DUTY:g}", plain(context)),
        (f"even motion, duty {SWAYED_DUTY:g}", plain(context, SWAYED_DUTY)),
        (f"sway, duty {SWAYED_DUTY:g}", swayed(context)),
        (f"round the body, sway, duty {DUTY:g}", _round_swayed(context)),
    )
    for k, (label, result) in enumerate(walks):
        left.plot(result.time, 1e3 * result.margin, color=COLOURS[k], linestyle=STYLES[k], label=label)
    left.axhline(0.0, color="0.3", linewidth=0.9)
    dress(left, title="Margin", xlabel="time [s]", ylabel="[mm]")
    left.set_ylim(-2.0, 34.0)
    left.legend(framealpha=1.0, edgecolor="white", fontsize=8.5, loc="upper center", ncols=2)
    order, turning = reported.ORDER, round_the_body(context).numbering.order
    for k, (label, swing, duty) in enumerate(
        (
            (f"file's numbering, duty {DUTY:g}", order, DUTY),
            (f"file's numbering, duty {SWAYED_DUTY:g}", order, SWAYED_DUTY),
            (f"round the body, duty {DUTY:g}", turning, DUTY),
            (f"round the body, duty {SWAYED_DUTY:g}", turning, SWAYED_DUTY),
        )
    ):
        walk = walk_of(context, swing, duty=duty)
        best = [best_sway(walk, (bound, bound))[0] for bound in BOUNDS]
        right.plot(1e3 * np.array(BOUNDS), 1e3 * np.array(best), color=COLOURS[k], linestyle=STYLES[k], label=label)
    right.axhline(0.0, color="0.3", linewidth=0.9)
    dress(right, title="Least margin with the best sway", xlabel="greatest sway, each way [mm]", ylabel="[mm]")
    right.legend(frameon=False, fontsize=8.5)
    return figure


def _draw_knee(context: Context) -> Drawing:
    figure = drawing(9.0, 3.8)
    axis = figure.subplots(1, 1)
    time = np.linspace(0.0, PERIOD, 1001)
    for k, (label, walk) in enumerate(_trials(context).items()):
        q = np.degrees(foot_curves(context, walk, time).q[:, 2])
        axis.plot(time, q, color=COLOURS[k], linestyle=STYLES[k], label=label)
    axis.axhline(-reported.SWING, color="0.3", linewidth=0.9)
    axis.annotate("limit", (0.2, -reported.SWING), (0, 3), textcoords="offset points", fontsize=8.5, color="0.3")
    axis.axvspan(*reported.STEP_OF_IV, color="0.5", alpha=0.12, linewidth=0.0)
    dress(axis, xlabel="time [s]", ylabel="θ₃ [deg]")
    axis.legend(frameon=False, fontsize=9, loc="upper right")
    return figure


def _shipped_walk(context: Context) -> str:
    """How the walk of the gait command differs from those of this page."""
    from leg_dynamics.analysis.gait import settings_for

    usual = settings_for(robot_of(context))
    return (
        f"The sway here is a check of the claim, with {HARMONICS} harmonics, up to {1e3 * SWAY_BOUND:.0f} mm each way "
        "and the same pause after each step; the walk of “leg-dynamics gait quadruped” optimises further, with "
        f"{usual.harmonics} harmonics up to {1e3 * max(usual.sway):.0f} mm, pauses only after every {usual.group} legs "
        f"of a side at duty {usual.duty:g}, and a neutral pose chosen for it, so that its margin is another."
    )


def sections(context: Context) -> tuple[Section, ...]:
    """Numberings and walks."""
    rows = tuple(
        (
            ", ".join(each.numbering.places),
            str(each.numbering.ways),
            _mm(each.uniform),
            _mm(each.whole),
            _mm(each.straight),
            _mm(each.free),
            *(_mm(float(margins_of(walk_of(context, each.numbering.order, duty=d))[1].min())) for d in DUTIES[1:]),
        )
        for each in caps_of(context)
    )
    joints = facts_of(context)[0].leg.joint_names
    return (
        Section(
            "static-stability",
            "Static stability",
            (
                "The paper does not say which leg is where. The 24 numberings make six cyclic orders of places. The "
                "margin is the distance of the centre of mass, projected down, from the edges of the standing feet; "
                "its "
                "caps are the most that a body may have at the moments when one foot touches down and the next lifts "
                "off, wherever it is then.",
                f"Assumed: step {1e3 * ADVANCE:.0f} mm, neutral pose ({NEUTRAL[0]:.0f}°, {NEUTRAL[1]:.0f}°, "
                f"{NEUTRAL[2]:.0f}°) for splay, {joints[1]} and {joints[2]}; samples are {EDGE:.0e} of a period off "
                "the "
                "switches.",
                _shipped_walk(context),
            ),
            (
                "swing in turn",
                "numberings",
                "even motion [mm]",
                "all masses [mm]",
                "cap, straight ahead [mm]",
                "cap, any motion [mm]",
                *(f"even, duty {duty:g} [mm]" for duty in DUTIES[1:]),
            ),
            rows,
            ("stability", "knee"),
            note=f"Duty {DUTY:g} but for the last columns; centre of mass in the middle of the body.",
        ),
    )
