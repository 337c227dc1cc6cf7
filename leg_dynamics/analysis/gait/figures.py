"""Plots of a gait study: motion over the ground, foot paths, speeds and efforts, stability, limits.

Stills, body, steps and speeds of the feet are Figs. 5 to 9 of Chen 2021, actuator speeds Fig. 10 of Rong 2012.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.analysis.gait.robot import Limb
from leg_dynamics.analysis.gait.stills import draw_stills
from leg_dynamics.analysis.gait.study import GaitStudy
from leg_dynamics.analysis.gait.tracks import Tracks, tracks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["CAPTIONS", "gait_figures"]

# Okabe and Ito's palette: told apart by most colour-blind readers, and in print.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_STYLES = ("-", "--", "-.", ":")


def gait_figures(study: GaitStudy) -> dict[str, Figure]:
    """The plots by name, those of `CAPTIONS`, on the Agg canvas of matplotlib; no stills of a robot without a file."""
    seen = tracks(study)
    stills = (
        {} if study.robot.description is None else {"stills": draw_stills(study, _figure(11.0, 7.4), _title(study))}
    )
    return stills | {
        "body": _body(study, seen),
        "steps": _steps(study, seen),
        "foot_speeds": _foot_speeds(study, seen),
        "feet": _feet(study),
        "speeds": _curves(study, "speed"),
        "efforts": _curves(study, "effort"),
        "stability": _stability(study),
        "limits": _limits(study),
    }


CAPTIONS = {
    "stills": "The robot at the middle of each swing, or evenly through the cycle; on the ground the polygon of the "
    "standing feet and the centre of mass",
    "body": "Way of the body and of the centre of mass over the ground",
    "steps": "Paths of the feet over the ground, seen from the right",
    "foot_speeds": "Speeds of the feet over the ground, and how fast the links that bear them turn",
    "feet": "Paths of the feet in the body frame",
    "speeds": "Speeds of the driven joints; shaded: foot on the ground",
    "efforts": "Efforts of the actuators; shaded: foot on the ground",
    "stability": "Static stability margin, feet on the ground, and vertical foot forces",
    "limits": "How near each leg comes to its limits",
}


def _figure(width: float, height: float) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _title(study: GaitStudy) -> str:
    walk = study.walk
    speed = f"{np.hypot(walk.twist.forward, walk.twist.sideward):.3g} m/s"
    turn = f", {walk.twist.turn:.3g} rad/s" if walk.twist.turn else ""
    tilt = "" if walk.tilt is None else ", tilted body"
    rhythm = f"period {walk.period:g} s, duty {walk.table.duty:.3g}"
    return f"{study.robot.name}, {walk.table.name} gait: {rhythm}, {speed}{turn}{tilt}"


def _tidy(axis: Axes) -> None:
    axis.grid(visible=True, color="0.88")
    axis.set_axisbelow(True)


def _colour(k: int) -> str:
    return _COLOURS[k % len(_COLOURS)]


def _feet(study: GaitStudy) -> Figure:
    figure = _figure(10.0, 7.5)
    top, side = figure.subplots(2, 1, height_ratios=(3, 2))
    for i, limb in enumerate(study.robot.limbs):
        x, y, z = study.feet.position[:, i].T
        style = _STYLES[(i // len(_COLOURS)) % len(_STYLES)]
        top.plot(x, y, color=_colour(i), linestyle=style, label=limb.name)
        top.plot(*limb.hip[:2, 3], marker="o", color=_colour(i), markerfacecolor="none", linestyle="none")
        side.plot(x, z, color=_colour(i), linestyle=style, linewidth=1.4)
    top.plot([], [], marker="o", color="0.3", markerfacecolor="none", linestyle="none", label="hips")
    x, y, _ = study.com.T
    top.plot(x, y, color="k", marker=".", markersize=3, linewidth=0.8, label="centre of mass")
    for axis, name in ((top, "y [m], left"), (side, "z [m], up")):
        axis.set_aspect("equal", adjustable="datalim")
        axis.set_ylabel(name)
        _tidy(axis)
    top.set_title("feet seen from above, body frame", loc="left", fontsize="medium")
    side.set_title("feet seen from the right, body frame", loc="left", fontsize="medium")
    side.set_xlabel("x [m], ahead")
    top.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
    figure.suptitle(_title(study))
    return figure


def _body(study: GaitStudy, seen: Tracks) -> Figure:
    figure = _figure(10.0, 6.0)
    ahead, beside = figure.subplots(2, 1, sharex=True, height_ratios=(3, 3))
    for k, (name, place) in enumerate((("body's origin", seen.body), ("centre of mass", seen.com))):
        ahead.plot(study.time, place[:, 0], color=_colour(k), linestyle=_STYLES[k], label=name)
        beside.plot(study.time, place[:, 1], color=_colour(k), linestyle=_STYLES[k], label=f"{name}, left")
    height = seen.com[:, 2] - seen.com[:, 2].mean()
    beside.plot(study.time, height, color=_colour(2), linestyle=_STYLES[2], label="centre of mass, up, less its mean")
    for axis, name in ((ahead, "x [m], ahead"), (beside, "y, z [m]")):
        axis.set_ylabel(name)
        axis.margins(x=0.01)
        _tidy(axis)
        axis.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
    beside.set_xlabel("time [s]")
    figure.align_ylabels()
    figure.suptitle(_title(study))
    return figure


def _panels(study: GaitStudy, height: float, *, share_x: bool) -> tuple[Figure, list[Axes]]:
    """A figure with one axis a leg, and one spare where their number is odd."""
    count = len(study.robot)
    columns = 2 if count > 1 else 1
    rows = -(-count // columns)
    figure = _figure(11.0, height * rows + 1.0)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=share_x, sharey=True)).ravel().tolist()
    for axis, limb in zip(axes, study.robot.limbs, strict=False):
        axis.set_title(limb.name, loc="left", fontsize="medium")
        _tidy(axis)
    for axis in axes[count:]:
        axis.set_visible(False)
    figure.suptitle(_title(study))
    return figure, axes


def _steps(study: GaitStudy, seen: Tracks) -> Figure:
    """One panel a leg, from one footprint to the next: Chen 2021, Fig. 6."""
    figure, axes = _panels(study, 1.9, share_x=False)
    ground = seen.feet[..., 2].min()
    for i, (axis, motion) in enumerate(zip(axes, study.limbs, strict=False)):
        x, z = seen.feet[:, i, 0], seen.feet[:, i, 2] - ground
        for first, last in _runs(motion.stance, standing=False):
            rows = slice(max(first - 1, 0), last + 2)
            axis.plot(x[rows], z[rows], color=_colour(i))
        axis.plot(x[motion.stance], z[motion.stance], linestyle="none", marker="o", markersize=3, color="0.3")
    figure.supxlabel("x [m], ahead")
    figure.supylabel("z [m], up")
    return figure


def _foot_speeds(study: GaitStudy, seen: Tracks) -> Figure:
    """Chen 2021, Figs. 8 and 9, for all legs."""
    turning = bool(np.isfinite(seen.foot_spin).all())
    figure = _figure(10.0, 6.0 if turning else 3.6)
    axes = np.atleast_1d(figure.subplots(1 + turning, 1, sharex=True)).tolist()
    rows = ((seen.foot_speed, "speed [m/s]"), (seen.foot_turn_rate, "turn rate [rad/s]"))
    for axis, (values, name) in zip(axes, rows, strict=False):
        for i, leg in enumerate(study.robot.leg_names):
            style = _STYLES[(i // len(_COLOURS)) % len(_STYLES)]
            axis.plot(study.time, values[:, i], color=_colour(i), linestyle=style, label=leg)
        axis.set_ylabel(name)
        axis.margins(x=0.01)
        _tidy(axis)
    axes[0].legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
    axes[-1].set_xlabel("time [s]")
    figure.align_ylabels()
    figure.suptitle(_title(study))
    return figure


def _curves(study: GaitStudy, what: str) -> Figure:
    """One panel a leg, with its stance shaded: Rong 2012, Fig. 10, for all six legs."""
    figure, axes = _panels(study, 1.9, share_x=True)
    for axis, motion in zip(axes, study.limbs, strict=False):
        limb = motion.limb
        if what == "speed":
            values, names, signs = motion.trajectory.v, limb.leg.joint_names, limb.signs
        else:
            values, names = motion.effort, getattr(limb.leg, "actuator_names", limb.leg.joint_names)
            signs = limb.signs if values.shape[1] == len(limb.signs) else np.ones(values.shape[1])
        for k, name in enumerate(names):
            style = _STYLES[k % len(_STYLES)]
            axis.plot(study.time, signs[k] * values[:, k], color=_colour(k), linestyle=style, label=name)
        for first, last in _spans(motion.stance):
            axis.axvspan(study.time[first], study.time[last], color="0.5", alpha=0.12, linewidth=0.0)
        axis.margins(x=0.01)
    unit = _unit(study.robot.limbs[0], what)
    figure.supylabel(f"{what} [{unit}]" if unit else what)
    figure.supxlabel("time [s]; shaded: foot on the ground")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", frameon=False)
    return figure


def _unit(limb: Limb, what: str) -> str:
    units = getattr(limb.leg, "units", None)
    if units is None:
        return ""
    listed = [f"{unit}/s" for unit in units.joints] if what == "speed" else units.actuators
    return ", ".join(dict.fromkeys(listed))


def _stability(study: GaitStudy) -> Figure:
    figure = _figure(10.0, 6.0)
    margin, rhythm, load = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 3))
    # Minus infinity, no foot on the ground, has no place on the axis.
    margin.plot(study.time, np.where(np.isfinite(study.margin), study.margin, np.nan), color=_colour(0))
    margin.axhline(0.0, color="0.4", linewidth=0.8)
    margin.set_ylabel("margin [m]")
    least = int(study.margin.argmin())
    margin.set_title(
        f"static stability margin: least {study.margin[least]:.4f} m at {study.time[least]:.3f} s",
        loc="left",
        fontsize="medium",
    )
    names, vertical = study.robot.leg_names, study.level_force[..., 2]
    for i in range(len(names)):
        spans = [(study.time[a], study.time[b] - study.time[a]) for a, b in _spans(study.stance[:, i])]
        rhythm.broken_barh(spans, (i - 0.35, 0.7), facecolors=_colour(i))
    rhythm.set_yticks(range(len(names)), names)
    rhythm.invert_yaxis()
    rhythm.set_title("feet on the ground", loc="left", fontsize="medium")
    for i, name in enumerate(names):
        style = _STYLES[(i // len(_COLOURS)) % len(_STYLES)]
        load.plot(study.time, vertical[:, i], color=_colour(i), linestyle=style, label=name)
    load.set_ylabel("vertical force [N]")
    load.set_title(f"foot forces, {study.load}", loc="left", fontsize="medium")
    load.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False)
    load.set_xlabel("time [s]")
    for axis in (margin, rhythm, load):
        axis.margins(x=0.01)
        _tidy(axis)
    figure.align_ylabels((margin, load))
    figure.suptitle(_title(study))
    return figure


def _limits(study: GaitStudy) -> Figure:
    """Least normalised margin of each leg, with the limits that it belongs to."""
    figure = _figure(10.0, 5.0)
    axis = figure.subplots()
    for i, name in enumerate(study.robot.leg_names):
        own = [each for each in study.limits if name in each.leg.split(" + ")]
        if own:
            margins = np.stack([each.margin / each.scale for each in own])
            nearest = min(own, key=lambda each: each.least_normalised)
            style = _STYLES[(i // len(_COLOURS)) % len(_STYLES)]
            label = f"{name}: {nearest.name.removeprefix(name).strip('_ ')}, {nearest.least:.4g} {nearest.unit}"
            axis.plot(study.time, margins.min(axis=0), color=_colour(i), linestyle=style, label=label)
    axis.axhline(0.0, color="0.4", linewidth=0.8)
    axis.set_ylabel("margin over half range [1]")
    axis.set_xlabel("time [s]")
    axis.set_title(
        "least margin of all limits, passive joints included; below zero: broken", loc="left", fontsize="medium"
    )
    axis.margins(x=0.01)
    _tidy(axis)
    if study.limits:
        figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize="small")
    figure.suptitle(_title(study))
    return figure


def _spans(stance: np.ndarray) -> list[tuple[int, int]]:
    """First and last sample of each run of stance."""
    return _runs(stance, standing=True)


def _runs(stance: np.ndarray, *, standing: bool) -> list[tuple[int, int]]:
    """First and last sample of each run of stance, or of swing."""
    runs = []
    for stands, group in itertools.groupby(range(stance.size), key=lambda k: bool(stance[k])):
        indices = list(group)
        if stands == standing:
            runs.append((indices[0], indices[-1]))
    return runs
