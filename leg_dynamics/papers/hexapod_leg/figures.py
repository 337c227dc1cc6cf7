"""Figures 1 to 10 of Rong et al. 2012: verdicts, drawings of what they can show, and the tables of the page."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.papers.comparison import EXACT
from leg_dynamics.papers.figures import COLOURS, STYLES, drawing, dress, legend_below, shade
from leg_dynamics.papers.framework import Context, Figure, Plot, Section, Status, Verdict
from leg_dynamics.papers.hexapod_leg import printed, reported, second, study, trends
from leg_dynamics.papers.hexapod_leg.claims import clearance, coupling_ratio, out_of_plane
from leg_dynamics.papers.hexapod_leg.facts import facts_of, preliminary, preliminary_workspace, workspace_of
from leg_dynamics.papers.hexapod_leg.gait import ASSUMED, SUPPORT, Walk, walk
from leg_dynamics.papers.hexapod_leg.screws import screws_of
from leg_dynamics.papers.judge import judge, text, worst
from leg_dynamics.verification.first_principles import loop_residual

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from leg_dynamics.analysis.workspace import Workspace

__all__ = ["VERDICTS", "plots", "sections"]

Array = np.ndarray

DESIGNS = ("preliminary", "final")


def _designs(context: Context) -> tuple[tuple[str, Workspace, study.Design], ...]:
    legs = (preliminary(context), context.leg)
    return tuple(
        (name, workspace_of(context, leg), study.design_of(leg)) for name, leg in zip(DESIGNS, legs, strict=True)
    )


# ---------------------------------------------------------------------- verdicts


def figure_1(context: Context) -> Verdict:
    """Structure of the leg."""
    facts = facts_of(context)
    residual = worst(loop_residual(context.leg.description, dict(facts.mechanism.coordinates)))
    s = screws_of(context)
    away = {
        which: sum(
            each.holds
            for pair in trends.length_statements(context, which == "behind", towards=False).values()
            for each in pair
        )
        for which in ("behind", "ahead")
    }
    frames = worst(facts.mechanism.rotation("sleeve_1") - facts.platform)
    return Verdict(
        "Fig. 1",
        "figure",
        "Structure of the leg (U+UPR)P+UPS, with its points and frames",
        judge([residual, frames, s.mobility - 3], EXACT),
        f"The drawing cannot be read here. What the text says of it closes (to {text(residual)} m, rad) and has "
        "mobility "
        f"{s.mobility}; the frames of strut 1 and platform stay parallel (to {text(frames)}). That b points towards A2 "
        f"is inferred: with b away from it {max(away.values())} of the directions in Fig. 3 would hold at most.",
        (
            Figure("loop residual", residual, "m, rad", f"{len(facts.q)} poses"),
            Figure("frames of strut 1 and platform", frames, "", f"{len(facts.q)} poses"),
            Figure("mobility", s.mobility, "", "rank of the loop rows"),
            *(
                Figure(f"directions of Fig. 3 with b away from A2, Z {which}", count, "", "of 8")
                for which, count in away.items()
            ),
        ),
    )


def figure_2(context: Context) -> Verdict:
    """Workspace of the preliminary design."""
    found = preliminary_workspace(context)
    design = study.design_of(preliminary(context))
    other = study.steps(context, replace(design, b=-design.b))
    step = found.step
    assert step is not None
    return Verdict(
        "Fig. 2",
        "figure",
        "Workspace of the preliminary design",
        # The drawing has no number in the text, and depends on a direction that is not printed.
        Status.NOT_REPRODUCIBLE,
        f"Computed: {found.volume.value:.3f} ± {found.volume.half_width:.3f} m³, x {found.lower[0]:.2f} to "
        f"{found.upper[0]:.2f}, y {found.lower[1]:.2f} to {found.upper[1]:.2f}, z {found.lower[2]:.2f} to "
        f"{found.upper[2]:.2f} m. The text quotes no number of the figure, and the direction of b is not printed: "
        "with b "
        f"away from A2, L would be {1e3 * other.length:.0f} instead of {1e3 * step.length:.0f} mm.",
        (
            Figure("volume", found.volume.value, "m³", found.justification),
            *(
                Figure(f"{'xyz'[k]}, {end}", value, "m", "extreme of the workspace")
                for end, corner in (("least", found.lower.tolist()), ("greatest", found.upper.tolist()))
                for k, value in enumerate(corner)
            ),
            Figure("L", step.length, "m", "b towards A2"),
            Figure("L with b away from A2", float(other.length), "m", "by interpolation"),
        ),
    )


def figure_3(context: Context) -> Verdict:
    """L and Z against four parameters."""
    behind, ahead = (trends.length_statements(context, back=back) for back in (True, False))
    failing = [f"{each.of} {each.says} with {name}" for name, pair in behind.items() for each in pair if not each.holds]
    other = sum(not each.holds for pair in ahead.values() for each in pair)
    count = sum(len(pair) for pair in behind.values())
    length = study.sweep(context, "b").steps.length
    mended = trends.falls(length, study.LENGTH_NOISE)
    without_b = [each for name, pair in behind.items() for each in pair if not (name == "b" and each.of == "L")]
    left = sum(not each.holds for each in without_b)
    return Verdict(
        "Fig. 3",
        "figure",
        "L and Z against a, b, l₂min and l₂max",
        judge(float(len(failing)), 0.0, corrected=float(left + (not mended)), explained=float(left)),
        f"{count - len(failing)} of the {count} directions that the text reads off hold if Z is the swing away from "
        "A2; "
        f"it is {count - other} if Z is the swing towards A2. Fails: {', '.join(failing) or 'none'}.",
        (
            Figure("directions that hold, Z behind", count - len(failing), "", f"of {count}"),
            Figure("directions that hold, Z ahead", count - other, "", f"of {count}"),
            Figure("L at the least b", length[0], "m", "b = 20 mm"),
            Figure("L at the greatest b", length[-1], "m", "b = 150 mm"),
        ),
        "L rises with b",
        "L falls with b",
    )


def figure_4(context: Context) -> Verdict:
    """Map of the condition number."""
    _, design = preliminary_workspace(context), study.design_of(preliminary(context))
    rows = {which: study.measure(context, design, which) for which in study.JACOBIANS}
    return Verdict(
        "Fig. 4",
        "figure",
        "Condition number over the workspace of the preliminary design",
        # The figure's numbers are not in the text, nor with which form of (24) it was computed.
        Status.NOT_REPRODUCIBLE,
        "Computed k̄, k̃ and least k: "
        + "; ".join(
            f"{which} {found.mean.value:.2f}, {found.deviation.value:.2f}, {found.smallest:.2f}"
            for which, found in rows.items()
        )
        + ". The text quotes no number of the figure. k depends on the pose, as it says.",
        tuple(
            Figure(f"{name}, {which}", value, "", "preliminary design")
            for which, found in rows.items()
            for name, value in (("k̄", found.mean.value), ("k̃", found.deviation.value), ("least k", found.smallest))
        ),
    )


def figure_5(context: Context) -> Verdict:
    """Dexterity against four parameters."""
    kinds: dict[str, list[bool]] = {"exact": [], "printed": []}
    for which, holds in kinds.items():
        for name, sign in (("a", -1.0), ("b", 1.0), ("c", 1.0)):
            found = trends.curves(study.sweep(context, name), which)
            test = trends.falls if sign < 0.0 else trends.flattens
            holds += [test(found.mean, found.mean_noise), test(found.deviation, found.deviation_noise)]
    by_b = {which: trends.curves(study.sweep(context, "b"), which).mean for which in kinds}
    failing = kinds["exact"].count(False)
    return Verdict(
        "Fig. 5",
        "figure",
        "k̄ and k̃ against a, b, c and the stroke of strut 2",
        judge(float(failing), 0.0),
        f"Of the {len(kinds['exact'])} directions for a, b and c, {kinds['exact'].count(True)} hold with the exact "
        f"Jacobian and {kinds['printed'].count(True)} with (24) as printed. The text says that k̄ changes little with "
        "b: "
        f"true of the exact one ({by_b['exact'][0]:.2f} to {by_b['exact'][-1]:.2f}), not of the printed one "
        f"({by_b['printed'][0]:.0f} to {by_b['printed'][-1]:.1f}), so (24) as printed is not what drew the figure. "
        "Each "
        "sentence has a verdict among the claims.",
        (
            Figure("directions that hold, exact Jacobian", kinds["exact"].count(True), "", "of a, b, c; k̄ and k̃"),
            Figure("directions that hold, printed Jacobian", kinds["printed"].count(True), "", "of a, b, c; k̄ and k̃"),
        ),
    )


def _percentiles(drawn: study.MonteCarlo) -> dict[str, tuple[float, float, float, float]]:
    """10, 50, 90 % of each parameter among designs that meet L and Z, and the share below the chosen value."""
    good = drawn.values[drawn.far_enough]
    return {
        name: (*np.percentile(good[:, k], [10.0, 50.0, 90.0]), float(np.mean(good[:, k] < reported.FINAL[name])))
        for k, name in enumerate(drawn.names)
    }


def figure_6(context: Context) -> Verdict:
    """Histograms of accepted parameters."""
    drawn = study.monte_carlo(context)
    shares = _percentiles(drawn)
    accept = reported.ACCEPTED
    with np.errstate(invalid="ignore"):
        count = int((drawn.far_enough & (drawn.mean <= accept["kbar"])).sum())
    again = second.designs_again(context)
    accepted = (again.length >= accept["L"]) & (again.back >= accept["Z"])
    own = drawn.far_enough[again.rows]
    return Verdict(
        "Fig. 6",
        "figure",
        "Histograms of a, b, l₂min and l₂max of the designs that meet the conditions",
        judge(0.0 if count else 1.0, 0.0),
        f"With k̄ ≤ {accept['kbar']:g} no design is left to draw. With L and Z alone the chosen values are at "
        + ", ".join(f"{100 * found[3]:.0f} % ({trends.NAMES[name]})" for name, found in shares.items())
        + " of the accepted ones: a and b are ordinary, l₂min and l₂max lie near the edges. Of the first "
        f"{len(again.rows)} designs L and Z by poses of the leg's file accept {int(accepted.sum())}, and by the "
        f"formulas {int(own.sum())}; {int((accepted != own).sum())} are accepted by one only.",
        tuple(
            Figure(f"{trends.NAMES[name]}, {which}", value, "m", "designs that meet L and Z, Z behind")
            for name, found in shares.items()
            for which, value in zip(("10 %", "median", "90 %"), found[:3], strict=True)
        ),
    )


def _drawing_only(item: str, title: str, finding: str) -> Callable[[Context], Verdict]:
    def verdict(context: Context) -> Verdict:
        return Verdict(item, "figure", title, Status.OUT_OF_REACH, finding)

    verdict.__name__ = f"figure_{item.rpartition(' ')[2]}"
    verdict.__doc__ = f"{title}."
    return verdict


figure_7 = _drawing_only(
    "Fig. 7",
    "Virtual prototype of the leg",
    "A drawing; there is nothing in it to compute. The leg's file draws the tubes of Table 1, which has its own "
    "verdict.",
)
figure_8 = _drawing_only(
    "Fig. 8",
    "The six-legged robot",
    "A drawing; hip positions, body and masses are not in the text. The robot's file assumes them and says so.",
)


def figure_9(context: Context) -> Verdict:
    """Simulated tripod gait."""
    lower, upper = context.limits
    walks = [walk(context, *each) for each in ASSUMED]
    inside = [bool(((each.q >= lower) & (each.q <= upper)).all()) for each in walks]
    robots = [second.walk_again(context, *each) for each in ASSUMED]
    nearest = [each.nearest_limits()[0] for each in robots]
    return Verdict(
        "Fig. 9",
        "figure",
        "Simulated tripod gait",
        # Nothing about the gait but its name is given.
        Status.NOT_REPRODUCIBLE,
        f"Period, stride, clearance, duty factor, path and body are not given. {sum(inside)} of {len(walks)} assumed "
        f"foot cycles, with strides up to {1e3 * max(each.stride for each in walks):.0f} mm, stay inside the limits of "
        f"length. On the robot of the shipped file, with U joints, balls, tubes and clearances counted, "
        f"{sum(all(limit.holds for limit in each.limits) for each in robots)} break no limit, and "
        f"{sum(bool(each.margin.min() > 0.0) for each in robots)} keep the centre of mass inside the standing feet.",
        (
            *(
                Figure(
                    f"least margin, stride {1e3 * each.stride:.0f} mm, {each.period:g} s",
                    float(np.minimum(each.q - lower, upper - each.q).min()),
                    "m",
                    "assumed foot cycle",
                )
                for each in walks
            ),
            *(
                Figure(
                    f"nearest of all limits, stride {1e3 * each.walk.stride:.0f} mm, {each.walk.period:g} s",
                    limit.least,
                    limit.unit,
                    f"{limit.name} at {each.time[limit.row]:.3g} s",
                )
                for each, limit in zip(robots, nearest, strict=True)
            ),
            *(
                Figure(
                    f"static stability margin, stride {1e3 * each.walk.stride:.0f} mm, {each.walk.period:g} s",
                    float(each.margin.min()),
                    "m",
                    "least over the cycle, assumed hips and body",
                )
                for each in robots
            ),
        ),
    )


def figure_10(context: Context) -> Verdict:
    """Speeds of the struts."""
    walks = [walk(context, *each) for each in ASSUMED]
    again = second.gait_difference(context)
    return Verdict(
        "Fig. 10",
        "figure",
        "Speeds of the struts in the tripod gait",
        # The curves depend on a gait that is not given.
        Status.NOT_REPRODUCIBLE,
        "Depends on a gait that is not given. With assumed ones the stance asks for "
        + ", ".join(f"{1e3 * np.abs(each.rates[each.stance]).max():.0f}" for each in walks)
        + " mm/s at most, the swing for "
        + ", ".join(f"{1e3 * np.abs(each.rates).max():.0f}" for each in walks)
        + f" mm/s, at body speeds of {', '.join(f'{each.speed:g}' for each in walks)} m/s. The six legs of the robot's "
        f"file, by the numeric route, move the same: {again.speed:.0e} m/s is the greatest difference in "
        f"{again.instants} poses.",
        tuple(
            Figure(
                f"strut {k + 1}, {phase}, {each.speed:g} m/s in {each.period:g} s", value, "m/s", "assumed gait, peak"
            )
            for each in walks
            for phase, rows in (("swing", ~each.stance), ("stance", each.stance))
            for k, value in enumerate(np.abs(each.rates[rows]).max(axis=0))
        ),
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
    figure_10,
)
"""One function a figure."""


# ---------------------------------------------------------------------- drawings


def plots(context: Context) -> tuple[Plot, ...]:
    """All drawings, built when they are asked for."""

    def draw(function: Callable[..., Drawing], *arguments: Any) -> Callable[[], Drawing]:
        return functools.partial(function, context, *arguments)

    return (
        Plot(
            "jacobian",
            "Two errors as printed",
            "Left: how far (9) as printed puts B1 from where it is, with strut 1 at h. Right: ∂l₂/∂x in the plane α = "
            "0, "
            "by (24) as printed, corrected, and for b = 0, where the printed one vanishes. Final design.",
            draw(_draw_jacobian),
            ("(9)", "(22)", "(24)"),
        ),
        Plot(
            "decoupling",
            "How far the rotations are decoupled",
            "Shares of the workspace's volume. Left: |∂l₃/∂β| beside |∂l₃/∂α|, which decoupling would make zero. "
            "Right: "
            "strut 3's angle out of the plane of strut 1 and A3, which the text has at zero. Final design.",
            draw(_draw_decoupling),
            (
                "claim: sideways swing by strut 3 alone, fully decoupled",
                "claim: chain UPS lies in one plane with chain UP",
            ),
        ),
        Plot(
            "fig2",
            "Workspace",
            "Left: outer and inner surface of the preliminary design's workspace, z down, coloured by height. Right: "
            "its sections y "
            "= 0 "
            "and x = 0 with those of the final design; the dot is the initial pose.",
            draw(_draw_workspace),
            ("Fig. 2",),
        ),
        Plot(
            "fig3",
            "L and Z against one parameter",
            "Others as in section 4.1; the vertical line is the preliminary value. The text's directions hold for Z "
            "behind, but for L against b.",
            draw(_draw_lengths),
            ("Fig. 3",),
        ),
        Plot(
            "fig4",
            "Condition number in two sections of the workspace",
            "Preliminary design, sections y = 0 and x = 0, by the exact Jacobian and by (24) as printed; one scale of "
            "colours.",
            draw(_draw_condition),
            ("Fig. 4", "(24)"),
        ),
        Plot(
            "fig5",
            "k̄ and k̃ against one parameter",
            "Others as in section 4.1; the vertical line is the preliminary value. Dashed: (24) as printed. The 99 % "
            "intervals are no larger than the dots.",
            draw(_draw_dexterity),
            ("Fig. 5",),
        ),
        Plot(
            "fig6",
            "Designs that meet the conditions on L and Z",
            f"Of {study.DESIGNS} random designs in the paper's box; with k̄ ≤ 4.3 none would be left. The vertical "
            "line "
            "is the value chosen.",
            draw(_draw_histograms),
            ("Fig. 6",),
        ),
        Plot(
            "k_of_designs",
            "L, Z and k̄ of random designs",
            "Each dot is one design of the paper's box. The paper's conditions ask for the shaded corner.",
            draw(_draw_designs),
            ("claim: k̄ = 4.3 and k̃ = 4.7 are middle values", "claim: designs that meet all four conditions"),
        ),
        Plot(
            "struts",
            "What Table 1 leaves of room",
            "Left: gap between the sleeves of struts 1 and 3, straight down, tubes from the U joints on. Right: "
            "overlap "
            "of rod and sleeve over the strut's length; the range of section 6.1 is drawn solid.",
            draw(_draw_room),
            ("Table 1", "claim: the struts do not interfere", "claim: the tubes of strut 2 fit its range"),
        ),
        Plot(
            "fig10",
            "Speeds and forces of the struts in an assumed gait",
            f"Two assumed foot cycles, stance shaded, {SUPPORT:g} N on the foot in stance, masses of the leg's file "
            "(steel). Not the paper's curves: it gives no period, stride or path.",
            draw(_draw_gait),
            ("Fig. 9", "Fig. 10"),
        ),
    )


def _draw_jacobian(context: Context) -> Drawing:
    figure = drawing(10.5, 4.3)
    left, right = figure.subplots(1, 2)
    degrees = np.linspace(-60.0, 60.0, 121)
    alpha, beta = np.meshgrid(np.radians(degrees), np.radians(degrees))
    design = study.design_of(context.leg)
    w = printed.rotation(alpha, beta)[..., 2]
    there = printed.rotation(*printed.angles(w))[..., 2]
    off = design.h * np.linalg.norm(there - w, axis=-1)
    shades = left.contourf(degrees, degrees, off, levels=np.linspace(0.0, 1.4, 15), cmap="viridis", extend="max")
    figure.colorbar(shades, ax=left, label="B1 missed [m]")
    dress(left, title="(9) as printed", xlabel="α [deg]", ylabel="β [deg]")
    left.set_aspect("equal")
    line = np.radians(np.linspace(-47.0, 40.0, 200))
    p = design.h * np.stack([np.sin(line), 0.0 * line, np.cos(line)], axis=-1)
    bare = replace(context.numbers, b=1e-12)
    for k, (label, leg, function) in enumerate(
        (
            ("corrected", context.numbers, study.exact_jacobian),
            ("as printed", context.numbers, lambda _, leg, p: study.printed_jacobian(leg, p)),
            ("corrected, b = 0", bare, study.exact_jacobian),
            ("as printed, b = 0", bare, lambda _, leg, p: study.printed_jacobian(leg, p)),
        )
    ):
        right.plot(
            np.degrees(line), function(context, leg, p)[:, 1, 0], color=COLOURS[k], linestyle=STYLES[k], label=label
        )
    dress(right, title="Row 2 of (24)", xlabel="β [deg]", ylabel="∂l₂/∂x")
    right.legend(fontsize=8.5, frameon=False)
    return figure


def _draw_decoupling(context: Context) -> Drawing:
    figure = drawing(10.5, 3.6)
    axes = figure.subplots(1, 2)
    weights = workspace_of(context, context.leg).weights
    weights = 100.0 * weights / weights.sum()
    for axis, values, title, xlabel in (
        (axes[0], coupling_ratio(context), "Coupling of strut 3 with β", "|∂l₃/∂β| / |∂l₃/∂α|"),
        (axes[1], np.degrees(out_of_plane(context)), "Strut 3 out of the plane", "angle [deg]"),
    ):
        mean = float(values @ weights / weights.sum())
        axis.hist(values, bins=44, weights=weights, color=COLOURS[0], edgecolor="white", linewidth=0.4)
        axis.axvline(mean, color=COLOURS[1], linewidth=1.6, label=f"mean {mean:.2f}")
        axis.axvline(values.max(), color="0.4", linewidth=1.2, linestyle=":", label=f"largest {values.max():.1f}")
        dress(axis, title=title, xlabel=xlabel, ylabel="share of the volume [%]")
        axis.legend(fontsize=9, frameon=False)
    return figure


def _section(context: Context, design: study.Design, plane: int, count: int = 221) -> tuple[Array, Array, Array, Array]:
    """A section through the initial pose: the two coordinates (m), foot positions (N, 3), feasibility as a grid."""
    across = np.linspace(-0.85, 0.85, count)
    down = np.linspace(0.1, 0.95, count // 2)
    u, z = np.meshgrid(across, down)
    zero = np.zeros_like(u)
    p = (u, zero, z) if plane == 0 else (zero, u, z)
    inside = study.poses_at(context, design, p).feasible()
    return across, down, np.stack(p, axis=-1), inside


def _shells(context: Context, design: study.Design) -> list[Array]:
    """Outer and inner surface of the workspace as grids of points (M, M, 3) over α and β; NaN where it has none."""
    angle = np.radians(np.linspace(-60.0, 60.0, 49))
    length = np.linspace(design.l1_min, design.l1_max, 121)
    alpha, beta = np.meshgrid(angle, angle, indexing="ij")
    w = printed.rotation(alpha, beta)[..., 2]
    p = w[..., None, :] * length[:, None]
    inside = study.poses_at(context, design, tuple(np.moveaxis(p, -1, 0))).feasible()
    some: Array = np.asarray(inside.any(axis=-1))
    ends = (len(length) - 1 - inside[..., ::-1].argmax(axis=-1), inside.argmax(axis=-1))
    return [np.where(some[..., None], length[end][..., None] * w, np.nan) for end in ends]


def _by_height(z: Array) -> Array:
    """Colours of points by z."""
    import matplotlib as mpl

    low, high = np.nanmin(z), np.nanmax(z)
    colours: Array = mpl.colormaps["viridis"]((np.nan_to_num(z, nan=low) - low) / (high - low))
    return colours


def _draw_workspace(context: Context) -> Drawing:
    figure = drawing(11.0, 5.6)
    halves: Any = figure.subfigures(1, 2, width_ratios=(1.15, 1.0))
    solid = halves[0].add_subplot(projection="3d")
    for surface in _shells(context, study.design_of(preliminary(context))):
        x, y, z = np.moveaxis(surface, -1, 0)
        solid.plot_surface(
            x, y, z, facecolors=_by_height(z), rstride=1, cstride=1, linewidth=0.15, edgecolor="white", shade=False
        )
    solid.set_xlabel("x [m]", labelpad=6)
    solid.set_ylabel("y [m]", labelpad=6)
    solid.set_zlabel("z [m], down", labelpad=6)
    solid.tick_params(labelsize=8)
    for axis in (solid.xaxis, solid.yaxis, solid.zaxis):
        axis.set_pane_color((0.97, 0.97, 0.97, 1.0))
    solid.invert_zaxis()
    solid.view_init(elev=20, azim=-58)
    solid.set_box_aspect((1.25, 1.38, 0.72), zoom=0.9)
    panels = halves[1].subplots(2, 1)
    for plane, axis in enumerate(panels):
        for k, (name, _, design) in enumerate(_designs(context)):
            across, down, _, inside = _section(context, design, plane, 441)
            axis.contour(across, down, inside.astype(float), levels=[0.5], colors=COLOURS[k], linestyles=STYLES[k])
            axis.plot([], [], color=COLOURS[k], linestyle=STYLES[k], label=name)
            axis.plot([0.0], [design.h], color=COLOURS[k], marker="o", markersize=4.5)
        dress(axis, xlabel=f"{'xy'[plane]} [m]", ylabel="z [m], down", title=("y = 0", "x = 0")[plane])
        axis.invert_yaxis()
        axis.set_aspect("equal")
    panels[0].legend(fontsize=9, frameon=False, loc="upper right")
    return figure


PRELIMINARY_VALUE = {name: reported.PRELIMINARY[name] for name in study.SWEEPS}


def _draw_lengths(context: Context) -> Drawing:
    figure = drawing(10.5, 6.4)
    axes = figure.subplots(2, 2).ravel()
    for axis, name in zip(axes, ("a", "b", "l2_min", "l2_max"), strict=True):
        swept = study.sweep(context, name)
        for k, (label, values) in enumerate(
            (("L", swept.steps.length), ("Z behind (−x)", swept.steps.back), ("Z ahead (+x)", swept.steps.front))
        ):
            axis.plot(1e3 * swept.values, 1e3 * values, color=COLOURS[k], linestyle=STYLES[k], marker=".", label=label)
        axis.axvline(1e3 * PRELIMINARY_VALUE[name], color="0.6", linewidth=1.0)
        dress(axis, xlabel=f"{trends.NAMES[name]} [mm]", ylabel="[mm]")
        axis.set_ylim(0.0, 1200.0)
    legend_below(figure, axes[0])
    return figure


def _draw_dexterity(context: Context) -> Drawing:
    figure = drawing(10.5, 9.0)
    axes = figure.subplots(3, 2).ravel()
    for axis, name in zip(axes, ("a", "b", "c", "l2_max", "l2_min"), strict=False):
        swept = study.sweep(context, name)
        for which, style in (("exact", "-"), ("printed", "--")):
            found = swept.exact if which == "exact" else swept.printed
            for k, (label, estimates) in enumerate(
                (("k̄", [each.mean for each in found]), ("k̃", [each.deviation for each in found]))
            ):
                axis.errorbar(
                    1e3 * swept.values,
                    [each.value for each in estimates],
                    yerr=[each.half_width for each in estimates],
                    color=COLOURS[k],
                    linestyle=style,
                    marker=".",
                    capsize=1.5,
                    linewidth=1.5,
                    label=f"{label}, {which}",
                )
        if swept.printed[0].mean.value > 30.0:
            axis.set_yscale("log")
            axis.set_yticks([2.0, 5.0, 10.0, 20.0, 50.0], labels=["2", "5", "10", "20", "50"])
            axis.minorticks_off()
        axis.axvline(1e3 * PRELIMINARY_VALUE[name], color="0.6", linewidth=1.0)
        dress(axis, xlabel=f"{trends.NAMES[name]} [mm]", ylabel="k̄, k̃")
    axes[5].set_axis_off()
    handles, labels = axes[0].get_legend_handles_labels()
    axes[5].legend(handles, labels, loc="center", frameon=False, fontsize=11)
    return figure


def _draw_condition(context: Context) -> Drawing:
    figure = drawing(10.5, 6.6)
    axes = figure.subplots(2, 2)
    leg = preliminary(context)
    design, numbers = study.design_of(leg), context.formulas.from_urdf(leg.description)
    mesh: Any = None
    for row, (label, function) in enumerate(
        (("exact", study.exact_jacobian), ("(24) as printed", lambda _, leg, p: study.printed_jacobian(leg, p)))
    ):
        for plane in (0, 1):
            across, down, p, inside = _section(context, design, plane, 281)
            k = np.full(inside.shape, np.nan)
            k[inside] = study.condition_of(context, function(context, numbers, p[inside]))
            axis = axes[row, plane]
            mesh = axis.pcolormesh(across, down, k, vmin=5.0, vmax=20.0, cmap="viridis", rasterized=True)
            dress(
                axis,
                xlabel=f"{'xy'[plane]} [m]",
                ylabel="z [m], down",
                title=f"{label}, {('y = 0', 'x = 0')[plane]}",
            )
            axis.invert_yaxis()
            axis.set_aspect("equal")
    figure.colorbar(mesh, ax=axes, label="condition number k", extend="max", shrink=0.85)
    return figure


def _draw_histograms(context: Context) -> Drawing:
    figure = drawing(10.5, 5.6)
    axes = figure.subplots(2, 2).ravel()
    drawn = study.monte_carlo(context)
    good = drawn.values[drawn.far_enough]
    for k, (axis, name) in enumerate(zip(axes, drawn.names, strict=True)):
        low, high = reported.PRIMARY_RANGES[name]
        shares = np.full(len(good), 100.0 / len(good))
        axis.hist(
            1e3 * good[:, k], bins=1e3 * np.linspace(low, high, 21), weights=shares, color=COLOURS[0], edgecolor="white"
        )
        axis.axvline(1e3 * reported.FINAL[name], color=COLOURS[1], linewidth=1.8, label="chosen in section 6.1")
        dress(axis, xlabel=f"{trends.NAMES[name]} [mm]", ylabel="share of designs [%]")
    legend_below(figure, axes[0])
    return figure


def _draw_designs(context: Context) -> Drawing:
    figure = drawing(10.5, 4.0)
    axes = figure.subplots(1, 2)
    drawn = study.monte_carlo(context)
    accept = reported.ACCEPTED
    final = workspace_of(context, context.leg)
    step = final.step
    assert step is not None
    for axis, values, limit, chosen, label in (
        (axes[0], drawn.steps.length, accept["L"], step.length, "L [mm]"),
        (axes[1], drawn.steps.back, accept["Z"], step.back, "Z behind [mm]"),
    ):
        seen = (values > 0.0) & drawn.counted
        axis.plot(
            1e3 * values[seen],
            drawn.mean[seen],
            linestyle="none",
            marker=".",
            markersize=2.2,
            color=COLOURS[0],
            rasterized=True,
        )
        top = 1e3 * float(values.max()) * 1.03
        axis.fill_between([1e3 * limit, top], 3.0, accept["kbar"], color=COLOURS[2], alpha=0.35, linewidth=0.0)
        axis.plot(
            [1e3 * chosen], [final.mean.value], color=COLOURS[1], marker="D", linestyle="none", label="final design"
        )
        axis.axhline(accept["kbar"], color=COLOURS[2], linewidth=1.0)
        axis.set_ylim(3.0, 22.0)
        dress(axis, xlabel=label, ylabel="k̄")
    axes[0].legend(frameon=False, fontsize=9, loc="upper left")
    return figure


def _draw_room(context: Context) -> Drawing:
    figure = drawing(10.5, 3.8)
    left, right = figure.subplots(1, 2)
    z = np.linspace(0.5, 0.6, 201)
    numbers = context.numbers
    q = np.stack(
        [np.asarray(each) + 0.0 * z for each in context.formulas.inverse_kinematics(numbers, (0.0 * z, 0.0 * z, z)).q],
        axis=-1,
    )
    gap = 1e3 * clearance(context, q)
    left.plot(1e3 * z, gap, color=COLOURS[0])
    left.fill_between(1e3 * z, gap, 0.0, where=gap < 0.0, color=COLOURS[1], alpha=0.3, linewidth=0.0)
    left.axhline(0.0, color="0.3", linewidth=0.8)
    left.axvline(1e3 * reported.FINAL["l1_min"], color=COLOURS[1], linestyle="--", label="l₁min of section 6.1")
    dress(left, title="Sleeves 1 and 3", xlabel="l₁ [mm], straight down", ylabel="gap [mm]")
    left.legend(frameon=False, fontsize=9)
    for k, (label, tubes, name) in enumerate((("struts 1 and 3", "13", "l1"), ("strut 2", "2", "l2"))):
        total = reported.TUBES[f"sleeve_{tubes}"][0] + reported.TUBES[f"rod_{tubes}"][0]
        low, high = reported.FINAL[f"{name}_min"], reported.FINAL[f"{name}_max"]
        whole = np.linspace(reported.TUBES[f"sleeve_{tubes}"][0], total, 2)
        right.plot(1e3 * whole, 1e3 * (total - whole), color=COLOURS[k], linestyle=":", linewidth=1.0)
        inside = np.linspace(low, high, 2)
        right.plot(1e3 * inside, 1e3 * (total - inside), color=COLOURS[k], linewidth=2.6, label=label)
        right.annotate(
            f"{1e3 * (total - high):.0f} mm",
            (1e3 * high, 1e3 * (total - high)),
            xytext=(8, 8),
            textcoords="offset points",
            fontsize=9,
            color=COLOURS[k],
        )
    dress(right, title="Rod in its sleeve", xlabel="length of the strut [mm]", ylabel="overlap [mm]")
    right.set_ylim(bottom=0.0)
    right.legend(frameon=False, fontsize=9)
    return figure


def _draw_gait(context: Context) -> Drawing:
    figure = drawing(10.5, 6.2)
    axes = figure.subplots(2, 2, sharex="col")
    chosen: tuple[Walk, ...] = (walk(context, *ASSUMED[0]), walk(context, *ASSUMED[2]))
    for column, each in enumerate(chosen):
        title = (
            f"{each.period:g} s, stride {1e3 * each.stride:.0f} mm, lift {1e3 * each.clearance:.0f} mm "
            f"({each.speed:g} m/s)"
        )
        for row, (values, unit) in enumerate(((1e3 * each.rates, "speed [mm/s]"), (each.force, "force [N]"))):
            axis = axes[row, column]
            for k in range(3):
                # The first moment is the last of the stance before.
                axis.plot(
                    each.time[1:],
                    values[1:, k],
                    color=COLOURS[k],
                    linestyle=STYLES[k],
                    linewidth=1.8,
                    label=f"strut {k + 1}",
                )
            shade(axis, 0.5 * each.period, each.period, "stance" if row == 0 else "")
            dress(axis, ylabel=unit, title=title if row == 0 else "", xlabel="time [s]" if row else "")
    legend_below(figure, axes[0, 0])
    return figure


# ---------------------------------------------------------------------- tables


def _uncertain(value: float, half_width: float, digits: int = 3) -> str:
    return f"{value:.{digits}f} ± {half_width:.{digits}f}"


def sections(context: Context) -> tuple[Section, ...]:
    """Tables of the page, each with its plots."""
    return (
        _section_kinematics(),
        _section_designs(context),
        _section_trends(),
        _section_monte_carlo(context),
        _section_room(),
        _section_gait(context),
    )


def _section_kinematics() -> Section:
    return Section(
        "kinematics",
        "Position and velocity",
        (
            "(9) names the two angles the wrong way round, (22) drops a term on the way from (20), and (19) takes "
            "strut 1 "
            "for a strut that cannot spin. The first is a slip of the pen, the second changes the Jacobian (24) "
            "throughout, the third a little.",
        ),
        plots=("jacobian", "decoupling"),
    )


def _section_designs(context: Context) -> Section:
    rows: list[tuple[str, ...]] = []
    names: list[str] = []
    columns: list[list[str]] = []
    for _, found, design in _designs(context):
        step = found.step
        assert step is not None
        measured = {which: study.measure(context, design, which) for which in study.JACOBIANS}
        entries = {
            "volume [m³]": _uncertain(found.volume.value, found.volume.half_width, 4),
            "x [m]": f"{found.lower[0]:.3f} to {found.upper[0]:.3f}",
            "y [m]": f"{found.lower[1]:.3f} to {found.upper[1]:.3f}",
            "z [m]": f"{found.lower[2]:.3f} to {found.upper[2]:.3f}",
            "L [mm], chord at h": f"{1e3 * step.length:.1f}",
            "longest chord at any height [mm]": f"{1e3 * step.longest:.1f}",
            "Z_f [mm], towards A2": f"{1e3 * step.front:.1f}",
            "Z_b [mm], away from A2": f"{1e3 * step.back:.1f}",
            "k̄, exact": _uncertain(found.mean.value, found.mean.half_width),
            "k̃, exact": _uncertain(found.deviation.value, found.deviation.half_width),
            "least k, exact": f"{found.dexterity.smallest:.2f}",
        }
        for which in ("without spin", "printed"):
            one = measured[which]
            label = "(24) as printed" if which == "printed" else "exact but for the spin"
            entries |= {
                f"k̄, {label}": _uncertain(one.mean.value, one.mean.half_width),
                f"k̃, {label}": _uncertain(one.deviation.value, one.deviation.half_width),
                f"least k, {label}": f"{one.smallest:.2f} (of samples)",
            }
        names = list(entries)
        columns.append(list(entries.values()))
    rows = [(name, *(column[k] for column in columns)) for k, name in enumerate(names)]
    first, last = (found for _, found, _ in _designs(context))
    return Section(
        "designs",
        "The two designs",
        (
            "Limits: lengths of all struts, ±60° at all U joints, 35° at the ball; not the overlap of rods nor the gap "
            "between sleeves, of which the paper gives no numbers. h is the middle of the range of strut 1. The final "
            "design's angles are not restated in the paper and are taken over.",
            f"Preliminary: {first.justification}. Final: {last.justification}.",
        ),
        ("quantity", *DESIGNS),
        tuple(rows),
        ("fig2", "fig4"),
        note="± is a 99 % interval. Condition numbers are weighted by the volume of foot positions.",
    )


def _section_trends() -> Section:
    return Section(
        "trends",
        "One parameter at a time",
        (
            "Fig. 3 and Fig. 5 move one parameter of the preliminary design. The ranges are those of section 6.1; c, "
            "which "
            "has none, is moved over that of b. L and Z are taken at the middle of the range of strut 1.",
        ),
        plots=("fig3", "fig5"),
    )


def _section_monte_carlo(context: Context) -> Section:
    drawn = study.monte_carlo(context)
    shares = _percentiles(drawn)
    rows = tuple(
        (
            trends.NAMES[name],
            "{:.0f} to {:.0f}".format(*(1e3 * end for end in reported.PRIMARY_RANGES[name])),
            *(f"{1e3 * value:.0f}" for value in found[:3]),
            f"{1e3 * reported.FINAL[name]:.0f}",
            f"{100 * found[3]:.0f} %",
        )
        for name, found in shares.items()
    )
    share = drawn.far_enough.mean()
    width = 1.96 * float(np.sqrt(share * (1.0 - share) / len(drawn.values)))
    return Section(
        "monte-carlo",
        "Monte Carlo method",
        (
            f"{len(drawn.values)} designs, uniform in the paper's box, the secondary parameters as in section 4.1; "
            f"{2 * study.FEW} poses each. {100 * share:.1f} ± {100 * width:.1f} % (95 %) meet the conditions on L and "
            "Z, "
            "with Z behind.",
            "The paper does not say how its histograms were weighted, nor which Jacobian it used.",
        ),
        ("parameter", "range [mm]", "10 % [mm]", "median [mm]", "90 % [mm]", "chosen [mm]", "accepted below it"),
        rows,
        ("fig6", "k_of_designs"),
        note="Percentiles are of the designs that meet L and Z.",
    )


def _section_room() -> Section:
    return Section(
        "room",
        "Room for the struts",
        (
            "The lengths of Table 1 against the ranges of section 6.1. Where on its strut a tube starts is not "
            "printed; "
            "here sleeves start at the U joints and rods end at the struts' ends.",
        ),
        plots=("struts",),
    )


def _section_gait(context: Context) -> Section:
    rows = []
    for each in (walk(context, *assumed) for assumed in ASSUMED):
        peak = 1e3 * np.abs(each.rates).max(axis=0)
        stance = 1e3 * np.abs(each.rates[each.stance]).max(axis=0)
        second = each.force[each.stance][:, 1]
        rows.append(
            (
                f"{each.period:g}",
                f"{each.stride:g}",
                f"{each.clearance:g}",
                f"{each.speed:g}",
                ", ".join(f"{value:.0f}" for value in peak),
                ", ".join(f"{value:.0f}" for value in stance),
                f"{second.min():.0f} to {second.max():+.0f}",
            )
        )
    return Section(
        "gait",
        "Tripod gait, assumed",
        (
            "The paper names the gait and gives no number of it. Assumed here: duty factor 1/2, a foot path in the "
            "plane "
            f"y = 0 with continuous acceleration, a body of constant velocity, {SUPPORT:g} N on each foot in stance (a "
            "third of 136 kg).",
        ),
        (
            "period [s]",
            "stride [m]",
            "lift [m]",
            "body [m/s]",
            "peak speeds, struts 1, 2, 3 [mm/s]",
            "in stance [mm/s]",
            "force of strut 2 in stance [N]",
        ),
        tuple(rows),
        ("fig10",),
    )
