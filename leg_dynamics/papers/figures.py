"""Drawing helpers of the papers; nothing here touches matplotlib's global state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["BAND", "COLOURS", "STYLES", "drawing", "dress", "legend_below", "magnitude", "panel", "path_views", "shade"]

# Okabe and Ito's palette: told apart by most colour-blind readers, and in print.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
STYLES = ("-", "--", "-.", ":")
BAND = "#5b6470"
"""Of shaded spans."""


def drawing(width: float, height: float, *, title: str = "") -> Figure:
    """An empty figure on the Agg canvas.

    Parameters
    ----------
    width, height : float
        Inches.
    title : str
        Above all panels; none where empty.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.06, wspace=0.03, hspace=0.03)  # type: ignore[union-attr,call-arg]
    if title:
        figure.suptitle(title, fontsize=12, fontweight="bold")
    return figure


def panel(
    axis: Axes,
    time: np.ndarray,
    values: np.ndarray,
    labels: Sequence[str],
    *,
    ylabel: str = "",
    title: str = "",
    xlabel: str = "",
    style: str | None = None,
    colours: Sequence[str] = COLOURS,
    width: float = 1.7,
    alpha: float = 1.0,
) -> None:
    """Draw the columns of `values` over time.

    Parameters
    ----------
    axis : Axes
    time : numpy.ndarray, shape (T,)
        s.
    values : numpy.ndarray, shape (T, n)
    labels : sequence of str
        Of the n columns.
    ylabel, title, xlabel : str
    style : str, optional
        Line style of all columns; where not given, each has its own, so that lines that coincide stay visible.
    colours : sequence of str
    width, alpha : float
        Of the lines.
    """
    for k, label in enumerate(labels):
        axis.plot(
            time,
            values[:, k],
            color=colours[k % len(colours)],
            linestyle=style or STYLES[k % len(STYLES)],
            linewidth=width,
            alpha=alpha,
            label=label,
        )
    dress(axis, ylabel=ylabel, title=title, xlabel=xlabel)


def dress(axis: Any, *, ylabel: str = "", title: str = "", xlabel: str = "") -> None:
    """Grid, labels and quiet edges of one panel."""
    axis.grid(visible=True, color="0.9", linewidth=0.8)
    axis.set_axisbelow(True)
    axis.margins(x=0.01)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axis.spines[side].set_color("0.45")
    axis.tick_params(labelsize=9, color="0.45")
    if ylabel:
        axis.set_ylabel(ylabel, fontsize=9.5)
    if xlabel:
        axis.set_xlabel(xlabel, fontsize=9.5)
    if title:
        axis.set_title(title, fontsize=10, loc="left")


def magnitude(axis: Axes, time: np.ndarray, values: np.ndarray, labels: Sequence[str], **texts: str) -> None:
    """Draw absolute values on a logarithmic axis, as dots; exact zeros have no place there and are left out."""
    for k, label in enumerate(labels):
        axis.plot(
            time,
            np.abs(values[:, k]),
            linestyle="none",
            marker=".",
            markersize=3.0,
            color=COLOURS[k % len(COLOURS)],
            label=label,
        )
    if np.any(values != 0.0):
        axis.set_yscale("log", nonpositive="mask")
    dress(axis, **texts)


def shade(axis: Axes, start: float, end: float, label: str = "", *, above: bool = False) -> None:
    """Shade a span of time, and name it at its top; above the panel where the lines leave no room."""
    axis.axvspan(start, end, color=BAND, alpha=0.11, linewidth=0.0)
    if label:
        axis.annotate(
            label,
            (0.5 * (start + end), 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 4 if above else -3),
            textcoords="offset points",
            ha="center",
            va="bottom" if above else "top",
            fontsize=8.5,
            color="0.3",
        )


def legend_below(figure: Figure, axis: Axes, columns: int | None = None) -> None:
    """One legend for all panels, from the lines of `axis`, under the figure."""
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=columns or len(labels), frameon=False, fontsize=9.5
    )


def path_views(figure: Figure, paths: Sequence[tuple[str, np.ndarray]]) -> None:
    """Draw paths of the foot in space and in three projections; z points down, as in the hip frame.

    Parameters
    ----------
    figure : Figure
        Empty.
    paths : sequence of (str, numpy.ndarray of shape (T, 3))
        Name and positions, m.
    """
    halves: Any = figure.subfigures(1, 2, width_ratios=(1.2, 1.0))
    space, views = halves
    solid = space.add_subplot(projection="3d")
    floor = 1e3 * max(p[:, 2].max() for _, p in paths)
    # Paths may coincide or retrace themselves: wide below narrow shows both, dashes would not.
    widths = np.linspace(1.8, 4.2, len(paths))[::-1] if len(paths) > 1 else np.array([2.0])
    for k, (name, p) in enumerate(paths):
        x, y, z = (1e3 * p).T
        solid.plot(x, y, np.full_like(z, floor), color="0.72", linewidth=1.4)
        solid.plot(x, y, z, color=COLOURS[k], linewidth=widths[k], label=name)
        solid.plot(x[:1], y[:1], z[:1], color="black", marker="o", markersize=5, linestyle="none")
    solid.set_xlabel("X [mm]", labelpad=6)
    solid.set_ylabel("Y [mm]", labelpad=6)
    solid.set_zlabel("Z [mm], down", labelpad=8)
    solid.tick_params(labelsize=8)
    for axis in (solid.xaxis, solid.yaxis, solid.zaxis):
        axis.set_pane_color((0.97, 0.97, 0.97, 1.0))
        axis.set_major_locator(_few_ticks())
    solid.invert_zaxis()
    solid.view_init(elev=24, azim=64)
    solid.set_box_aspect((1.0, 1.0, 0.75), zoom=0.88)
    if len(paths) > 1:
        solid.legend(loc="upper left", fontsize=9.5, frameon=False)
    for axis, (i, j) in zip(views.subplots(3, 1), ((0, 2), (1, 2), (0, 1)), strict=True):
        for k, (_, p) in enumerate(paths):
            axis.plot(1e3 * p[:, i], 1e3 * p[:, j], color=COLOURS[k], linewidth=widths[k])
            axis.plot(1e3 * p[0, i], 1e3 * p[0, j], color="black", marker="o", markersize=4.5)
        dress(axis, xlabel=f"{'XYZ'[i]} [mm]", ylabel=f"{'XYZ'[j]} [mm]" + (", down" if j == 2 else ""))
        axis.margins(0.06)
        if j == 2:
            axis.invert_yaxis()


def _few_ticks() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(5)
