"""Figures 1 to 9 of Chen & Dong 2021: verdicts, what the text says of them, and drawings from the assumed gait.

No figure's numbers are in the text, and the gait behind Figs 5 to 9 is not given. What the text says in words is judged
on the gait of `walking`; the figures themselves stay open.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.papers.comparison import EXACT, claim
from leg_dynamics.papers.figures import COLOURS, STYLES, drawing, dress, shade
from leg_dynamics.papers.framework import Context, Figure, Plot, Section, Status, Verdict
from leg_dynamics.papers.judge import judge, text, worst
from leg_dynamics.papers.quadruped import printed, reported
from leg_dynamics.papers.quadruped.claims import assembly, foot_screws
from leg_dynamics.papers.quadruped.facts import facts_of, robot_file
from leg_dynamics.papers.quadruped.stability import plain, swayed
from leg_dynamics.papers.quadruped.walking import (
    ADVANCE,
    CLEARANCE,
    DUTY,
    NEUTRAL,
    PERIOD,
    SWAY_BOUND,
    SWAYED_DUTY,
    FootCurves,
    foot_curves,
    robot_of,
    walk_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from leg_dynamics.analysis.gait import GaitStudy

__all__ = ["VERDICTS", "curves", "maxima", "parabola", "plots", "sections", "steps"]

Array = np.ndarray

SAMPLES = 4001

JUMP = 1e-6
"""s between the two sides of a moment that are compared."""

STILL = 1e-12
"""m, m/s: a foot that rests."""


def curves(context: Context) -> FootCurves:
    """Leg IV's foot in the assumed gait with even motion of the body."""
    found: FootCurves = context.once(
        "quadruped: curves", lambda: foot_curves(context, walk_of(context), np.linspace(0.0, PERIOD, SAMPLES))
    )
    return found


def _swayed_curves(context: Context) -> FootCurves:
    found: FootCurves = context.once(
        "quadruped: swayed curves",
        lambda: foot_curves(context, swayed(context).walk, np.linspace(0.0, PERIOD, SAMPLES)),
    )
    return found


def maxima(values: Array) -> int:
    """How often a curve rises and then falls."""
    ways = np.sign(np.diff(values))
    ways = ways[ways != 0.0]
    return int(((ways[:-1] > 0.0) & (ways[1:] < 0.0)).sum())


def parabola(height: float, share: Array) -> Array:
    """The parabola from 0 through its height to 0, over the share of the way."""
    return np.asarray(4.0 * height * share * (1.0 - share))


def steps(context: Context) -> tuple[float, float]:
    """Greatest jump of the foot's velocity (m/s) and angular velocity (rad/s) at both ends of leg IV's step."""
    ends = np.array(reported.STEP_OF_IV)
    both = foot_curves(context, walk_of(context), np.sort(np.concatenate([ends - JUMP, ends + JUMP])))
    return worst(both.velocity[1::2] - both.velocity[::2]), worst(both.spin[1::2] - both.spin[::2])


# ---------------------------------------------------------------------- what the text says of Figs 6 to 9


def _on(context: Context) -> str:
    return f"assumed gait, {SAMPLES} instants of a cycle"


def arch(context: Context) -> Verdict:
    """Fig. 6 in words."""
    f = curves(context)
    y, z = f.position[:, 1], f.position[:, 2]
    flying = f.swings
    share = (y[flying] - y[flying][0]) / (y[flying][-1] - y[flying][0])
    off = float(np.abs(z[flying] - parabola(CLEARANCE, share)).max())
    grounded = worst(z[~flying])
    lengths = np.linalg.norm(np.diff(f.position, axis=0), axis=1)
    room = float(lengths.max() - f.speed.max() * (f.time[1] - f.time[0]))
    ahead = bool((np.diff(y[flying]) > 0.0).all())
    return claim(
        "the foot of leg IV goes like a parabola, without a break",
        "Section 3: the path of leg IV's foot in the yOz plane resembles a parabola and is continuous",
        judge(
            [maxima(z[flying]) - 1.0, 0.0 if ahead else 1.0, max(0.0, room), grounded, max(0.0, off - 0.2 * CLEARANCE)],
            1e-9,
        ),
        f"So it does in the assumed gait: one arch of {1e3 * ADVANCE:.0f} mm by {1e3 * CLEARANCE:.0f} mm, always "
        "ahead, "
        f"{1e3 * off:.1f} mm from a parabola at most; on the ground the foot rests. No number of the figure is in "
        "print.",
        [
            Figure("greatest distance in height from a parabola", off, "m", _on(context)),
            Figure("height of the foot on the ground", grounded, "m", _on(context)),
            Figure("maxima of the height", maxima(z[flying]), "", _on(context)),
        ],
    )


def straight_line(context: Context) -> Verdict:
    """Fig. 7 in words."""
    f, result = curves(context), plain(context)
    x, y = f.body[:, 0], f.body[:, 1]
    slowest = float(np.diff(y).min() / (f.time[1] - f.time[0]))
    drift = float(np.abs(result.com[:, 1]).max())
    sideways = float(np.abs(_swayed_curves(context).body[:, 0]).max())
    back = float(np.diff(_swayed_curves(context).body[:, 1]).min() / (f.time[1] - f.time[0]))
    return claim(
        "the body goes straight along y, with x about 0",
        "Section 3: the body's centre moves by about 0 along x and continuously ahead along y",
        judge([worst(x), max(0.0, -slowest), y[-1] - ADVANCE], EXACT),
        f"So does the body in the assumed gait with even motion, by {1e3 * ADVANCE:.0f} mm a cycle; the legs move the "
        f"centre of mass of the whole robot by up to {1e3 * drift:.1f} mm sideways. It then has no margin of static "
        f"stability at duty {DUTY:g}. The walk with sway leaves the line by {1e3 * sideways:.0f} mm.",
        [
            Figure("greatest |x| of the body", worst(x), "m", _on(context)),
            Figure("greatest |x| of the centre of mass", drift, "m", "assumed gait, all masses"),
            Figure("least speed ahead", slowest, "m/s", _on(context)),
            Figure("greatest |x| of the body with sway", sideways, "m", f"duty {SWAYED_DUTY:g}"),
            Figure("least speed ahead with sway", back, "m/s", f"duty {SWAYED_DUTY:g}"),
        ],
    )


def speed_once(context: Context) -> Verdict:
    """Fig. 8 in words."""
    f = curves(context)
    jump, _ = steps(context)
    resting = worst(f.velocity[~f.swings])
    acceleration = float(np.abs(np.gradient(f.velocity, f.time, axis=0)).max())
    times = f.time[f.swings]
    # |v|² = (c s')² + (h l')² near the apex of quintic and bump: a second peak beyond 5/16 of the step.
    high = 0.03
    double = maxima(foot_curves(context, walk_of(context, clearance=high), f.time).speed)
    return claim(
        "leg IV's foot speeds up and slows down once, from 10 to 15 s, without a jump",
        "Section 3: the speed of leg IV's foot is continuous; from 10 to 15 s it rises and falls",
        judge(
            [
                maxima(f.speed) - 1.0,
                max(0.0, jump - 4.0 * JUMP * acceleration),
                resting,
                max(0.0, reported.STEP_OF_IV[0] - times[0]),
                max(0.0, times[-1] - reported.STEP_OF_IV[1]),
            ],
            STILL,
        ),
        f"So it does in the assumed gait, up to {1e3 * f.speed.max():.1f} mm/s, and rests else. One rise and fall is "
        "not "
        f"a matter of course: with the same path law and a clearance of {1e3 * high:.0f} mm the speed has {double} "
        "peaks, "
        f"above {1e3 * 0.3125 * ADVANCE:.1f} mm (5/16 of the step) more than one.",
        [
            Figure("greatest speed", f.speed.max(), "m/s", _on(context)),
            Figure("peaks of the speed", maxima(f.speed), "", _on(context)),
            Figure("jump of the velocity at the step's ends", jump, "m/s", f"{JUMP:g} s before and after"),
            Figure(f"peaks of the speed, clearance {1e3 * high:.0f} mm", double, "", _on(context)),
        ],
    )


def turn_rate_once(context: Context) -> Verdict:
    """Fig. 9 in words."""
    f = curves(context)
    _, jump = steps(context)
    fastest = float(np.abs(np.gradient(f.spin, f.time, axis=0)).max())
    before = float(f.turn_rate[~f.swings].max())
    return claim(
        "leg IV's foot turns faster and slower once, from 10 to 15 s, without a jump",
        "Section 3: the angular velocity of leg IV's foot is continuous; from 10 to 15 s it rises and falls",
        judge([maxima(f.turn_rate[f.swings]) - 1.0, max(0.0, jump - 4.0 * JUMP * fastest)], STILL),
        f"So does its magnitude in the assumed gait, up to {np.degrees(f.turn_rate.max()):.1f}°/s from at most "
        f"{np.degrees(before):.1f}°/s on the ground, where the leg turns about its foot. Which component the figure "
        "has, "
        "and of which body, is not printed.",
        [
            Figure("greatest angular speed in the air", f.turn_rate[f.swings].max(), "rad/s", _on(context)),
            Figure("greatest angular speed on the ground", before, "rad/s", _on(context)),
            Figure("jump at the step's ends", jump, "rad/s", f"{JUMP:g} s before and after"),
        ],
    )


# ---------------------------------------------------------------------- figures


def _drawing_only(item: str, title: str, finding: str) -> Callable[[Context], Verdict]:
    def verdict(context: Context) -> Verdict:
        return Verdict(item, "figure", title, Status.OUT_OF_REACH, finding)

    verdict.__name__ = f"figure_{item.rpartition(' ')[2]}"
    verdict.__doc__ = f"{title}."
    return verdict


figure_1 = _drawing_only(
    "Fig. 1",
    "Outside of a module",
    "A drawing; the text's size and ranges have verdicts among the claims.",
)
figure_2 = _drawing_only(
    "Fig. 2",
    "Inside of a module",
    "A drawing; neither drives, axes nor masses of it are in the text.",
)


def figure_3(context: Context) -> Verdict:
    """The robot of ten modules."""
    from leg_dynamics.description import read

    whole = context.once("quadruped: all joints", lambda: read("quadruped", parameters={"frozen": 0}))
    held = robot_file(context)
    moving = [sum(joint.type != "fixed" for joint in file.joints) for file in (whole, held)]
    wanted = [3 * reported.MODULES, 3 * reported.LEGS]
    return Verdict(
        "Fig. 3",
        "figure",
        "Structure of the quadruped",
        judge(np.subtract(moving, wanted), 0.0),
        f"The drawing cannot be read here. By the text the robot has {wanted[0]} joints, and {wanted[1]} when the body "
        f"and three joints a leg rest; the file of {len(assembly(context).modules)} modules has {moving[0]} and "
        f"{moving[1]}. How its body holds together has a verdict among the claims.",
        (
            Figure("joints", moving[0], "", "of the robot's file, nothing at rest"),
            Figure("joints left", moving[1], "", "of the robot's file as shipped"),
        ),
    )


def figure_4(context: Context) -> Verdict:
    """Frames of leg IV."""
    f = facts_of(context)[0]
    poses = [np.broadcast_to(np.eye(4), f.pose.shape)]
    for i, row in enumerate(printed.table_rows(f.lengths)):
        poses.append(poses[-1] @ printed.link_by_table(f.q[:, i], row, proximal=False))
    axes = foot_screws(f.leg, f.q)[:, 3:]
    to_hip = _hip_rotation(context)
    off = np.stack([to_hip @ axes[:, :, i, None] - poses[i][:, :3, 2, None] for i in range(3)])
    heights = 1e3 * np.array([pose[0, 2, 3] for pose in poses[1:]])
    return Verdict(
        "Fig. 4",
        "figure",
        "Denavit-Hartenberg frames of leg IV",
        judge(off, EXACT),
        f"The drawing cannot be read here. The frames that Table 1 means have their z axes along the three axes of the "
        f"file's leg (to {text(worst(off))}). In the pose of (4), with which the text compares it, O_1, O_2 and O_3 "
        "are "
        f"at {', '.join(f'{height + 0.0:.1f}' for height in heights)} mm above the hip.",
        (Figure("z axes against the file's joint axes, worst", worst(off), "", f"{len(f.q)} poses"),),
    )


def _hip_rotation(context: Context) -> Array:
    from leg_dynamics.description import link_transforms

    leg = facts_of(context)[0].leg
    rotation: Array = np.linalg.inv(link_transforms(leg.description, {})["hip"])[:3, :3]
    return rotation


def _open(item: str, title: str, words: Callable[[Context], Verdict], facts: Callable[[Context], str]) -> Any:
    def verdict(context: Context) -> Verdict:
        said = words(context)
        return Verdict(
            item,
            "figure",
            title,
            # Its curve depends on stride, clearance, path law, pose and masses, none of which is given.
            Status.NOT_REPRODUCIBLE,
            f"The curve depends on a gait that is not given, and no number of it is in the text. {facts(context)} What "
            f"the text says of it is {'confirmed' if said.status is Status.CONFIRMED else said.status.value} for that "
            "gait, see the claims.",
            said.figures,
        )

    verdict.__name__ = f"figure_{item.rpartition(' ')[2]}"
    verdict.__doc__ = f"{title}."
    return verdict


def figure_5(context: Context) -> Verdict:
    """Stills of the walk."""
    result = plain(context)
    nearest = result.nearest_limits()[0]
    return Verdict(
        "Fig. 5",
        "figure",
        "Stills of the walk",
        # Nothing about the walk but the order of the legs is given.
        Status.NOT_REPRODUCIBLE,
        "Pictures of a walk that is not given. The assumed one makes the same steps in the same order, "
        f"{len(robot_of(context))} "
        f"in {PERIOD:g} s, and keeps {np.degrees(nearest.least):.1f}° from all limits.",
        (
            Figure("nearest limit", nearest.least, "rad", nearest.name),
            Figure("advance", ADVANCE, "m", "a cycle, assumed"),
            Figure("clearance", CLEARANCE, "m", "assumed"),
        ),
    )


figure_6 = _open(
    "Fig. 6",
    "Path of leg IV's foot",
    arch,
    lambda context: f"Assumed: step {1e3 * ADVANCE:.0f} mm, clearance {1e3 * CLEARANCE:.0f} mm.",
)
figure_7 = _open(
    "Fig. 7",
    "Way of the body's centre",
    straight_line,
    lambda context: f"Assumed: {1e3 * ADVANCE / PERIOD:g} mm/s, even.",
)
figure_8 = _open(
    "Fig. 8",
    "Speed of leg IV's foot",
    speed_once,
    lambda context: (
        f"Assumed: a quintic along and 64 u³(1 − u)³ up; greatest {1e3 * curves(context).speed.max():.1f} mm/s."
    ),
)
figure_9 = _open(
    "Fig. 9",
    "Angular speed of leg IV's foot",
    turn_rate_once,
    lambda context: f"In the assumed gait the greatest is {np.degrees(curves(context).turn_rate.max()):.1f}°/s.",
)


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (
    figure_1,
    figure_2,
    figure_3,
    figure_4,
    figure_5,
    figure_6,
    figure_7,
    figure_8,
    figure_9,
    arch,
    straight_line,
    speed_once,
    turn_rate_once,
)
"""One function an item."""


# ---------------------------------------------------------------------- drawings


def plots(context: Context) -> tuple[Plot, ...]:
    """Drawings from the assumed gait."""

    def draw(function: Callable[[Context], Drawing]) -> Callable[[], Drawing]:
        return functools.partial(function, context)

    assumed = (
        f"Assumed gait: step {1e3 * ADVANCE:.0f} mm, clearance {1e3 * CLEARANCE:.0f} mm, {PERIOD:g} s. Not the paper's "
        "curve, which has no numbers in print."
    )
    return (
        Plot(
            "fig5",
            "The four steps from above",
            f"In the middle of each step, standing feet joined. Above: even motion, duty {DUTY:g}; below: with sway, "
            "duty "
            f"{SWAYED_DUTY:g}. The cross is the centre of mass of all modules, the square the body's middle. Ahead "
            "is up.",
            draw(_draw_stills),
            ("Fig. 5", "claim: the robot walks steadily"),
        ),
        Plot(
            "fig6",
            "Path of leg IV's foot in the yOz plane",
            f"Left: over the ground, with a parabola of the same height. Right: seen from the body. {assumed}",
            draw(_draw_path),
            ("Fig. 6", "claim: the foot of leg IV goes like a parabola, without a break"),
        ),
        Plot(
            "fig7",
            "Way of the body",
            f"x to the right, y ahead. Solid: even motion; dashed: with sway at duty {SWAYED_DUTY:g}. {assumed}",
            draw(_draw_body),
            ("Fig. 7", "claim: the body goes straight along y, with x about 0"),
        ),
        Plot(
            "fig8",
            "Speed of leg IV's foot",
            f"Over the ground; the step is shaded. {assumed}",
            draw(_draw_speed),
            ("Fig. 8", "claim: leg IV's foot speeds up and slows down once, from 10 to 15 s, without a jump"),
        ),
        Plot(
            "fig9",
            "Angular speed of leg IV's foot",
            f"Of the link that bears the foot, and the parts about the vertical and in the leg's plane. {assumed}",
            draw(_draw_turn_rate),
            ("Fig. 9", "claim: leg IV's foot turns faster and slower once, from 10 to 15 s, without a jump"),
        ),
    )


def _draw_stills(context: Context) -> Drawing:
    figure = drawing(11.0, 4.9)
    panels = figure.subplots(2, 4, sharex=True, sharey=True)
    for row, result in enumerate((plain(context), swayed(context))):
        table = result.walk.table
        for column, leg in enumerate(reported.ORDER):
            number = robot_of(context).leg_names.index(leg)
            middle = float(np.mod(table.phases[number] - 0.5 * (1.0 - table.duty), 1.0)) * PERIOD
            _draw_still(panels[row, column], context, result, int(np.abs(result.time - middle).argmin()))
            dress(
                panels[row, column],
                title=f"leg {leg}, {middle:.3g} s",
                xlabel="to the left [mm]" if row else "",
                ylabel="ahead [mm]" if not column else "",
            )
    return figure


def _draw_still(axis: Any, context: Context, result: GaitStudy, k: int) -> None:
    feet, hips = result.feet.position[k], np.array([limb.hip[:3, 3] for limb in robot_of(context).limbs])
    standing = result.stance[k]
    # In axes that go along with the even motion, so that a sway shows.
    shift = result.body.position[k] - [result.walk.twist.forward * result.time[k], 0.0, 0.0]
    feet, hips, com = (1e3 * (each + shift) for each in (feet, hips, result.com[k]))
    corners = feet[standing][:, :2]
    ring = corners[np.argsort(np.arctan2(*(corners - corners.mean(axis=0)).T[::-1]))]
    axis.fill(ring[:, 1], ring[:, 0], color=COLOURS[2], alpha=0.15, linewidth=0.0)
    axis.plot(*np.vstack([ring, ring[:1]]).T[::-1], color=COLOURS[2], linewidth=1.2)
    for name, foot, hip, on in zip(robot_of(context).leg_names, feet, hips, standing, strict=True):
        axis.plot([hip[1], foot[1]], [hip[0], foot[0]], color="0.45", linewidth=2.0)
        axis.plot(foot[1], foot[0], "o", color=COLOURS[0] if on else "white", markeredgecolor=COLOURS[0], markersize=7)
        aside = 8 if foot[0] > 0.0 else -16
        axis.annotate(name, (foot[1], foot[0]), (0, aside), textcoords="offset points", ha="center", fontsize=8.5)
    outline = hips[[0, 1, 3, 2, 0]]
    axis.plot(outline[:, 1], outline[:, 0], color="0.45", linewidth=2.0)
    axis.plot(1e3 * shift[1], 1e3 * shift[0], "s", color="0.45", markersize=5)
    axis.plot(com[1], com[0], "x", color=COLOURS[1], markersize=9, markeredgewidth=2.2)
    axis.set_aspect("equal")
    axis.set_xlim(340.0, -340.0)
    axis.set_ylim(-190.0, 190.0)


def _draw_path(context: Context) -> Drawing:
    figure = drawing(10.5, 3.8)
    left, right = figure.subplots(1, 2)
    f = curves(context)
    y, z = 1e3 * f.position[:, 1], 1e3 * f.position[:, 2]
    share = np.linspace(0.0, 1.0, 101)
    left.plot(y, z, color=COLOURS[0], linewidth=2.0, label="foot of leg IV")
    left.plot(
        1e3 * ADVANCE * share,
        1e3 * parabola(CLEARANCE, share),
        color=COLOURS[1],
        linestyle="--",
        label="parabola",
    )
    dress(left, title="Over the ground", xlabel="y, ahead [mm]", ylabel="z, up [mm]")
    left.set_ylim(top=1.35e3 * CLEARANCE)
    left.legend(frameon=False, fontsize=9)
    seen = f.position - f.body
    from_hip = 1e3 * (seen - seen[0])
    right.plot(from_hip[:, 1], from_hip[:, 2], color=COLOURS[0], linewidth=2.0)
    right.plot(from_hip[:1, 1], from_hip[:1, 2], "o", color="black", markersize=5)
    dress(right, title="Seen from the body", xlabel="y, ahead [mm]", ylabel="z, up [mm]")
    right.set_ylim(top=1.35e3 * CLEARANCE)
    return figure


def _draw_body(context: Context) -> Drawing:
    figure = drawing(10.5, 3.8)
    axes = figure.subplots(1, 2)
    for k, (label, f) in enumerate((("even motion", curves(context)), ("with sway", _swayed_curves(context)))):
        for axis, column in zip(axes, (1, 0), strict=True):
            axis.plot(f.time, 1e3 * f.body[:, column], color=COLOURS[k], linestyle=STYLES[k], label=label)
    dress(axes[0], title="y, ahead", xlabel="time [s]", ylabel="[mm]")
    dress(axes[1], title="x, to the right", xlabel="time [s]", ylabel="[mm]")
    reach = 1.4e3 * SWAY_BOUND
    axes[1].set_ylim(-reach, reach)
    axes[0].legend(frameon=False, fontsize=9)
    return figure


def _draw_speed(context: Context) -> Drawing:
    figure = drawing(9.0, 3.6)
    axis = figure.subplots(1, 1)
    f = curves(context)
    for k, (label, values) in enumerate(
        (("speed", f.speed), ("along y", f.velocity[:, 1]), ("along z", f.velocity[:, 2]))
    ):
        axis.plot(f.time, 1e3 * values, color=COLOURS[k], linestyle=STYLES[k], label=label)
    shade(axis, *reported.STEP_OF_IV, "step", above=True)
    dress(axis, xlabel="time [s]", ylabel="[mm/s]")
    axis.legend(frameon=False, fontsize=9, loc="upper left")
    return figure


def _draw_turn_rate(context: Context) -> Drawing:
    figure = drawing(9.0, 3.6)
    axis = figure.subplots(1, 1)
    f = curves(context)
    # θ₁ turns about the vertical, θ₂ + θ₃ in the leg's plane.
    for k, (label, values) in enumerate(
        (
            ("magnitude", f.turn_rate),
            ("about the vertical", f.spin[:, 2]),
            ("in the leg's plane", f.v[:, 1] + f.v[:, 2]),
        )
    ):
        axis.plot(f.time, np.degrees(values), color=COLOURS[k], linestyle=STYLES[k], label=label)
    shade(axis, *reported.STEP_OF_IV, "step", above=True)
    dress(axis, xlabel="time [s]", ylabel="[deg/s]")
    axis.legend(frameon=False, fontsize=9, loc="upper left")
    return figure


# ---------------------------------------------------------------------- table


def sections(context: Context) -> tuple[Section, ...]:
    """What is assumed of the walk, and what it asks of the drives."""
    values = context.leg.parameters
    lengths = facts_of(context)[0].lengths
    assumed = (
        (
            "swing axis to face f, axis to axis s",
            f"{1e3 * values['f'].value:.4g}, {1e3 * values['s'].value:.4g} mm",
            "2 f + s = 150 mm",
        ),
        ("foot", f"{1e3 * values['foot_radius'].value:.4g} mm", "a quarter of the module's width"),
        ("l₁, l₂, l₃", ", ".join(f"{1e3 * each:.4g}" for each in lengths) + " mm", "s, 2 f, s + f + foot"),
        ("mass of a module", f"{values['module_mass'].value:g} kg", "assumed"),
        ("period, duty factor", f"{PERIOD:g} s, {DUTY:g}", "inferred: IV is third of four and steps from 10 to 15 s"),
        ("places of the legs", "I, II in front, III, IV behind, odd ones left", "best margin of all numberings"),
        ("neutral pose: splay, θ₂, θ₃", ", ".join(f"{each:.0f}°" for each in NEUTRAL), "room for the sway"),
        ("step", f"{1e3 * ADVANCE:.0f} mm", "assumed"),
        ("clearance", f"{1e3 * CLEARANCE:.0f} mm", "one peak of the foot's speed"),
        ("path law", "quintic along, 64 u³(1 − u)³ up", "continuous acceleration"),
        ("body", "even motion", "Fig. 7"),
        (
            "with sway",
            f"duty {SWAYED_DUTY:g}, up to {1e3 * SWAY_BOUND:.0f} mm each way, two harmonics",
            "greatest least margin; never back",
        ),
    )
    rows = []
    for label, result in ((f"even motion, duty {DUTY:g}", plain(context)), ("with sway", swayed(context))):
        peaks = [motion.peaks() for motion in result.limbs]
        speed = np.degrees(np.abs([each.speed for each in peaks]).max(axis=0))
        effort = np.abs([each.effort for each in peaks]).max(axis=0)
        nearest = result.nearest_limits()[0]
        rows.append(
            (
                label,
                f"{1e3 * result.margin.min() + 0.0:.2f}".replace("-0.00", "0.00"),
                f"{np.degrees(nearest.least):.1f}",
                ", ".join(f"{each:.0f}" for each in speed),
                ", ".join(f"{each:.2f}" for each in effort),
                result.load,
            )
        )
    return (
        Section(
            "assumptions",
            "What is assumed",
            (
                "The paper gives the order of the legs and the time of one step. Everything else behind Figs 5 to 9 is "
                "chosen here, and the drawings are of that gait.",
            ),
            ("quantity", "value", "why"),
            assumed,
        ),
        Section(
            "walk",
            "The walk",
            (
                f"On the robot of ten modules, {plain(context).mass:.1f} kg. Efforts hold the robot's weight with the "
                "standing feet: in equal shares where the margin is zero and moments cannot be balanced, else "
                "balanced.",
            ),
            (
                "body",
                "least margin [mm]",
                "nearest limit [deg]",
                "peak speeds θ₁, θ₂, θ₃ [deg/s]",
                "peak torques [N·m]",
                "load",
            ),
            tuple(rows),
            ("fig5", "fig6", "fig7", "fig8", "fig9"),
        ),
    )
