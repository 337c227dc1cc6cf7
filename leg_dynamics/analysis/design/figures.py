"""Plots of a study, built without touching matplotlib's global state."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from leg_dynamics.analysis.design.result import StageResult, StudyResult

__all__ = ["caption", "study_figures"]

# Okabe and Ito's palette: told apart by most colour-blind readers, and in print.
_BLUE, _ORANGE, _GREY = "#0072B2", "#D55E00", "0.72"
_MOST_PANELS, _MOST_PAIRS, _MOST_DOTS = 24, 6, 4000


def caption(name: str) -> str:
    """What a figure of `study_figures` shows."""
    kind = name.partition("_")[0]
    return {
        "sweep": "Objectives over one parameter, the others as in the leg that the study starts from.",
        "histograms": "Parameters of the accepted designs (orange) beside those of all designs (grey), with their "
        "10th, 50th and 90th percentile; the dashed line is the chosen design.",
        "objectives": "Pairs of objectives: accepted designs orange, all others grey; the star is the chosen design.",
    }[kind]


def study_figures(result: StudyResult) -> dict[str, Figure]:
    """Draw a study.

    Parameters
    ----------
    result : StudyResult

    Returns
    -------
    dict of str to matplotlib.figure.Figure
        ``sweep_PARAMETER``, or ``histograms_STAGE`` and ``objectives_STAGE``, each on the Agg canvas.
    """
    figures: dict[str, Figure] = {}
    for stage in result.stages:
        if result.study.stages[stage.number].is_sweep:
            figures |= {
                f"sweep_{each.name}": _sweep(stage, each.name) for each in result.study.stages[stage.number].ranges
            }
            continue
        figures[f"histograms_{stage.number + 1}"] = _histograms(stage)
        if len(result.study.objectives) > 1:
            figures[f"objectives_{stage.number + 1}"] = _objectives(stage)
    return figures


def _panels(count: int, title: str) -> tuple[Figure, list[Axes]]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = min(count, 3)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(1.0 + 3.6 * columns, 0.8 + 2.7 * rows), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.subplots(rows, columns, squeeze=False)
    flat = list(axes.ravel())
    for axis in flat[count:]:
        axis.set_visible(False)
    for axis in flat[:count]:
        axis.grid(visible=True, color="0.9")
        axis.set_axisbelow(True)
    figure.suptitle(title)
    return figure, flat[:count]


def _label(stage: StageResult, name: str) -> str:
    unit = stage.study.columns[name]
    return name if unit == "1" else f"{name} [{unit}]"


def _sweep(stage: StageResult, name: str) -> Figure:
    ranges = stage.study.stages[stage.number].ranges
    start = sum(each.steps or 0 for each in itertools.takewhile(lambda each: each.name != name, ranges))
    rows = slice(start, start + next(each.steps or 0 for each in ranges if each.name == name))
    objectives = stage.study.objectives[:_MOST_PANELS]
    figure, axes = _panels(len(objectives), f"{stage.study.leg.name}: sweep of {name}")
    x, base = stage.column(name)[rows], stage.study.leg.parameters[name].value
    for axis, objective in zip(axes, objectives, strict=True):
        axis.plot(x, stage.column(objective.name)[rows], color=_BLUE, marker=".", markersize=4.0)
        axis.axvline(base, color="0.5", linewidth=0.8, linestyle=":")
        _mark_filters(axis, stage, objective.name)
        axis.set_xlabel(_label(stage, name))
        axis.set_ylabel(_label(stage, objective.name))
        axis.ticklabel_format(useOffset=False)
    return figure


def _mark_filters(axis: Axes, stage: StageResult, name: str) -> None:
    for each in stage.study.filters:
        if each.name == name:
            axis.axhline(each.value, color=_ORANGE, linewidth=0.8, linestyle="--")


def _histograms(stage: StageResult) -> Figure:
    ranges = stage.study.stages[stage.number].ranges[:_MOST_PANELS]
    accepted = sum(row.accepted for row in stage.rows)
    title = f"{stage.study.leg.name}, stage {stage.number + 1}: {accepted:,} of {len(stage.rows):,} designs accepted"
    figure, axes = _panels(len(ranges), title)
    for axis, each in zip(axes, ranges, strict=True):
        edges = np.linspace(each.lower, each.upper, 26)
        every, kept = stage.column(each.name), stage.column(each.name, accepted=True)
        for values, colour, alpha in ((every, _GREY, 0.6), (kept, _ORANGE, 0.75)):
            if values.size:
                # as shares, so that few accepted ones can be seen beside all
                axis.hist(
                    values, edges.tolist(), weights=np.full(values.size, 100.0 / values.size), color=colour, alpha=alpha
                )
        if kept.size:
            numbers = np.percentile(kept, (10, 50, 90))
            for value, style in zip(numbers, (":", "-", ":"), strict=True):
                axis.axvline(value, color=_BLUE, linestyle=style, linewidth=1.1)
            axis.set_title(" / ".join(f"{value:.4g}" for value in numbers), fontsize="small", color=_BLUE)
        if stage.chosen is not None:
            axis.axvline(stage.chosen.design[each.name], color="black", linestyle="--", linewidth=1.0)
        axis.set_xlabel(_label(stage, each.name))
        axis.set_ylabel("% of designs")
    return figure


def _objectives(stage: StageResult) -> Figure:
    names: Sequence[str] = [each.name for each in stage.study.objectives]
    pairs = list(itertools.combinations(names, 2))[:_MOST_PAIRS]
    figure, axes = _panels(len(pairs), f"{stage.study.leg.name}, stage {stage.number + 1}: objectives")
    accepted = np.array([row.accepted for row in stage.rows])
    # dots beyond some thousand only make the file large
    shown = np.zeros(len(accepted), dtype=bool)
    shown[:: max(1, len(accepted) // _MOST_DOTS)] = True
    for axis, (one, other) in zip(axes, pairs, strict=True):
        x, y = stage.column(one), stage.column(other)
        for rows, colour, size in ((shown & ~accepted, _GREY, 4.0), (shown & accepted, _ORANGE, 6.0)):
            axis.scatter(x[rows], y[rows], s=size, color=colour, linewidths=0.0, rasterized=True)
        if stage.chosen is not None:
            axis.plot(stage.chosen.values[one], stage.chosen.values[other], "*", color="black", markersize=10.0)
        for each in stage.study.filters:
            if each.name == one:
                axis.axvline(each.value, color=_BLUE, linewidth=0.8, linestyle="--")
            if each.name == other:
                axis.axhline(each.value, color=_BLUE, linewidth=0.8, linestyle="--")
        axis.set_xlabel(_label(stage, one))
        axis.set_ylabel(_label(stage, other))
    return figure
