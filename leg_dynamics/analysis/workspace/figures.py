"""Plots of a workspace, built without touching matplotlib's global state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from leg_dynamics.analysis.workspace.foot import Slice
    from leg_dynamics.analysis.workspace.result import Workspace

__all__ = ["CAPTIONS", "workspace_figures"]

CAPTIONS: Mapping[str, str] = {
    "slices": "Sections through the home position, coloured by condition number; the border's colour says which "
    "constraint ends the workspace there.",
    "cloud": "Feasible samples, one dot for equal volumes, coloured by condition number.",
    "constraints": "Share of the volume in which each constraint is the nearest, and of the boundary that it ends.",
    "convergence": "Volume and its confidence interval at each doubling of the samples.",
}

_CLOUD = 6000
# Okabe and Ito's palette, then lighter kin of it.
_COLOURS = (
    *("#D55E00", "#CC79A7", "#000000", "#E69F00", "#56B4E9", "#F0E442", "#8C564B", "#FF8FA3", "#7F7F7F", "#B5EAD7"),
)


def workspace_figures(result: Workspace) -> dict[str, Figure]:
    """Draw a workspace.

    Parameters
    ----------
    result : Workspace

    Returns
    -------
    dict of str to matplotlib.figure.Figure
        ``slices`` (where there are any), ``cloud``, ``constraints`` (where there are any), ``convergence``; each on
        the Agg canvas. `CAPTIONS` says what they show.
    """
    figures = {}
    if result.slices:
        figures["slices"] = _slices(result)
    figures["cloud"] = _cloud(result)
    if result.constraints:
        figures["constraints"] = _constraints(result)
    figures["convergence"] = _convergence(result)
    return figures


def _figure(width: float, height: float) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _norm(result: Workspace) -> Any:
    """Logarithmic scale from the least condition number to that which a fiftieth of the volume exceeds."""
    from matplotlib.colors import LogNorm

    order = np.argsort(result.poses.condition)
    share = np.cumsum(result.weights[order]) / result.weights.sum()
    high = float(result.poses.condition[order][min(int(np.searchsorted(share, 0.98)), len(order) - 1)])
    low = max(1.0, result.dexterity.smallest)
    return LogNorm(low, max(high, 1.01 * low))


def _slices(result: Workspace) -> Figure:
    from matplotlib.lines import Line2D

    figure, norm = _figure(5.6 * len(result.slices) + 1.2, 6.4), _norm(result)
    axes = np.atleast_1d(figure.subplots(1, len(result.slices)))
    borders = [_border(each) for each in result.slices]
    indices = np.unique(np.concatenate([border[2] for border in borders]))
    colours = {int(index): _COLOURS[k % len(_COLOURS)] for k, index in enumerate(indices)}
    shown = None
    for axis, each, border in zip(axes, result.slices, borders, strict=True):
        values = np.ma.masked_invalid(each.condition)
        shown = axis.pcolormesh(
            each.first, each.second, values, norm=norm, cmap="viridis_r", shading="nearest", rasterized=True
        )
        # where the nearest constraint changes inside
        regions = np.where(np.isfinite(each.condition), each.active, np.nan)
        _region_lines(axis, each, regions)
        x, y, active = border
        axis.scatter(x, y, c=[colours[int(index)] for index in active], s=5.0, linewidths=0.0, zorder=3)
        axis.set_title(each.plane, fontsize="medium")
        axis.set_xlabel(f"{each.axes[0]} [m]")
        axis.set_ylabel(f"{each.axes[1]} [m]")
        axis.set_aspect("equal")
        if each.axes[1] == "z" and result.step is not None:
            axis.plot([result.step.start, result.step.end], [result.step.home[2]] * 2, color="white", linewidth=1.2)
            axis.plot(*result.step.home[::2], "o", color="white", markersize=4.0)
        if each.axes[1] == "z" and result.down > 0.0:
            axis.invert_yaxis()
    if shown is not None:
        _colour_bar(figure, shown, list(axes), shrink=0.8)
    handles = [
        Line2D([], [], marker="o", linestyle="none", color=colour, markersize=5.0, label=result.names[index])
        for index, colour in colours.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
    figure.suptitle(f"workspace of {result.leg}, hip frame")
    return figure


def _colour_bar(figure: Figure, shown: Any, axes: Any, **place: Any) -> None:
    from matplotlib.ticker import StrMethodFormatter

    plain = StrMethodFormatter("{x:g}")
    bar = figure.colorbar(shown, ax=axes, label="condition number k", **place)
    bar.ax.yaxis.set_major_formatter(plain)
    bar.ax.yaxis.set_minor_formatter(plain)


def _region_lines(axis: Axes, each: Slice, regions: np.ndarray) -> None:
    for index in np.unique(regions[np.isfinite(regions)])[1:]:
        share = (regions == index).astype(float)
        axis.contour(each.first, each.second, share, levels=[0.5], colors="white", linewidths=0.4, alpha=0.6)


def _border(each: Slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Feasible cells beside infeasible ones, and the constraint that their neighbour breaks."""
    inside = np.isfinite(each.condition)
    rows, columns, active = [], [], []
    for axis, shift in ((0, 1), (0, -1), (1, 1), (1, -1)):
        outside = ~np.roll(inside, shift, axis)
        r, c = np.nonzero(inside & outside)
        rows.append(r)
        columns.append(c)
        active.append(np.roll(each.active, shift, axis)[r, c])
    r, c = np.concatenate(rows), np.concatenate(columns)
    return each.first[c], each.second[r], np.concatenate(active)


def _even(result: Workspace, count: int) -> np.ndarray:
    """Rows of samples that are spread evenly over the volume."""
    chosen = np.random.default_rng(0).choice(
        len(result.weights), min(count, len(result.weights)), p=result.weights / result.weights.sum()
    )
    return np.unique(chosen)


def _cloud(result: Workspace) -> Figure:
    figure = _figure(7.6, 6.4)
    axis: Any = figure.add_subplot(projection="3d")
    poses = result.poses[_even(result, _CLOUD)]
    shown = axis.scatter(
        *poses.foot.T, c=poses.condition, norm=_norm(result), cmap="viridis_r", s=3.0, linewidths=0.0, rasterized=True
    )
    for name, letter in zip(("set_xlabel", "set_ylabel", "set_zlabel"), "xyz", strict=True):
        getattr(axis, name)(f"{letter} [m]")
    axis.set_box_aspect(np.maximum(np.ptp(poses.foot, axis=0), 1e-3))
    if result.down > 0.0:  # the picture's z points up
        axis.invert_zaxis()
        axis.invert_yaxis()
    _colour_bar(figure, shown, axis, shrink=0.7, pad=0.1)
    figure.suptitle(f"workspace of {result.leg}, V = {result.volume.value:.4g} {result.unit}")
    return figure


def _constraints(result: Workspace) -> Figure:
    nearest, ended = result.active_shares(), result.border_shares()
    total = max(sum(ended.values()), 1)
    names = list(dict.fromkeys([*nearest, *ended]))
    figure = _figure(8.0, 1.4 + 0.32 * len(names))
    axis = figure.subplots()
    place = np.arange(len(names))[::-1]
    shares = [100.0 * nearest.get(name, 0.0) for name in names]
    axis.barh(place + 0.2, shares, 0.4, color="#0072B2", label="nearest, % of the volume")
    ends = [100.0 * ended.get(name, 0) / total for name in names]
    axis.barh(place - 0.2, ends, 0.4, color="#E69F00", label="ends it, % of the boundary points")
    axis.set_yticks(place, names)
    axis.set_xlabel("%")
    axis.legend(frameon=False)
    axis.grid(visible=True, axis="x", color="0.88")
    axis.set_axisbelow(True)
    figure.suptitle(f"active constraints of {result.leg}")
    return figure


def _convergence(result: Workspace) -> Figure:
    figure = _figure(7.0, 4.0)
    axis = figure.subplots()
    samples = [level.samples for level in result.levels]
    volume = np.array([level.volume for level in result.levels])
    width = [level.half_width for level in result.levels]
    axis.errorbar(samples, volume, width, marker="o", markersize=4.0, capsize=3.0, color="#0072B2", label="V, 99 %")
    band = result.tolerance * result.volume.value
    axis.axhspan(
        result.volume.value - band,
        result.volume.value + band,
        color="#E69F00",
        alpha=0.25,
        linewidth=0.0,
        label=f"± {100 * result.tolerance:g} %",
    )
    if result.injectivity.cartesian is not None:
        other = result.injectivity.cartesian
        axis.errorbar(
            [result.injectivity.samples],
            [other.value],
            [other.half_width],
            marker="s",
            markersize=5.0,
            capsize=3.0,
            color="#D55E00",
            linestyle="none",
            label="by foot positions",
        )
    axis.set_xscale("log")
    axis.set_xlabel("samples")
    axis.set_ylabel(f"volume [{result.unit}]")
    axis.grid(visible=True, color="0.88")
    axis.legend(frameon=False)
    figure.suptitle(f"volume of the workspace of {result.leg}")
    return figure
