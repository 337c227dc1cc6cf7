"""Plots of a torque computation; figures are built without touching matplotlib's global state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.analysis.trajectories import Trajectory
from leg_dynamics.errors import ShapeError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["torque_figure"]

# Okabe and Ito's palette: told apart by most colour-blind readers, and in print.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_STYLES = ("-", "--", "-.", ":")
_MARKERS = 25
"""Markers of the second route along the whole motion: enough to compare, few enough to see the line."""


def torque_figure(
    trajectory: Trajectory,
    torque: ArrayLike,
    *,
    joint_names: Sequence[str],
    units: Sequence[str],
    actuator_names: Sequence[str],
    actuator_units: Sequence[str],
    route: str = "",
    second_torque: ArrayLike | None = None,
    second_route: str = "second route",
    title: str = "",
) -> Figure:
    """Draw positions, rates and actuator efforts over time, and how far a second route differs.

    Parameters
    ----------
    trajectory : Trajectory
        The motion, T samples of n coordinates.
    torque : array_like, shape (T, m)
        Actuator efforts, N·m or N.
    joint_names, units : sequence of str
        Of the n coordinates; units are ``rad`` or ``m``.
    actuator_names, actuator_units : sequence of str
        Of the m actuators; units are ``N·m`` or ``N``.
    route : str
        Where `torque` comes from.
    second_torque : array_like, shape (T, m), optional
        The same efforts by another route, drawn as markers and as a difference panel.
    second_route : str
        Where `second_torque` comes from.
    title : str
        Heading of the figure.

    Returns
    -------
    matplotlib.figure.Figure
        On the Agg canvas; save it with its ``savefig``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    time, samples = trajectory.time, len(trajectory)
    effort = _checked("torque", torque, (samples, len(actuator_names)))
    panels = 3 if second_torque is None else 4
    figure = Figure(figsize=(9.0, 2.1 * panels + 1.2), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(panels, 1, sharex=True))

    _lines(axes[0], time, trajectory.q, joint_names)
    axes[0].set_ylabel(f"position [{_joined(units)}]")
    _lines(axes[1], time, trajectory.v, joint_names)
    axes[1].set_ylabel(f"velocity [{_joined([f'{unit}/s' for unit in units])}]")
    _lines(axes[2], time, effort, actuator_names)
    what = "torque" if all(unit == "N·m" for unit in actuator_units) else "effort"
    axes[2].set_ylabel(f"{what} [{_joined(actuator_units)}]")

    if second_torque is not None:
        other = _checked("second_torque", second_torque, effort.shape)
        every = max(1, samples // _MARKERS)
        for k in range(effort.shape[1]):
            axes[2].plot(
                time[::every],
                other[::every, k],
                linestyle="none",
                marker="o",
                markersize=4.5,
                markerfacecolor="none",
                markeredgecolor=_colour(k),
            )
        axes[2].plot([], [], linestyle="none", marker="o", markerfacecolor="none", color="0.3", label=second_route)
        difference = np.abs(effort - other)
        for k, name in enumerate(actuator_names):
            axes[3].plot(
                time, difference[:, k], linestyle="none", marker=".", markersize=2.5, color=_colour(k), label=name
            )
        if difference.max(initial=0.0) > 0.0:
            # Exact zeros have no place on a logarithmic axis; they fall below its lower end.
            axes[3].set_yscale("log", nonpositive="mask")
        axes[3].set_ylabel(f"|difference| [{_joined(actuator_units)}]")
        axes[3].set_title(
            f"{route or 'first route'} against {second_route}: largest difference {difference.max(initial=0.0):.2g}",
            fontsize="medium",
            loc="left",
        )
    if route:
        axes[2].set_title(
            f"line: {route}" + ("" if second_torque is None else f", circles: {second_route}"),
            fontsize="medium",
            loc="left",
        )
    for axis in axes:
        axis.grid(visible=True, color="0.88")
        axis.set_axisbelow(True)
        axis.margins(x=0.01)
        _shade_force(axis, trajectory)
        axis.legend(loc="center left", bbox_to_anchor=(1.005, 0.5), frameon=False, markerscale=1.0)
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(title or trajectory.name)
    figure.align_ylabels(axes)
    return figure


def _lines(axis: Axes, time: np.ndarray, values: np.ndarray, names: Sequence[str], *, linewidth: float = 1.6) -> None:
    for k, name in enumerate(names):
        # Coordinates often coincide (alpha and beta in eq. 52): later ones are dashed over earlier ones.
        axis.plot(
            time,
            values[:, k],
            color=_colour(k),
            linestyle=_STYLES[k % len(_STYLES)],
            linewidth=1.6,
            label=name,
        )


def _colour(k: int) -> str:
    return _COLOURS[k % len(_COLOURS)]


def _shade_force(axis: Axes, trajectory: Trajectory) -> None:
    """Shade each span of samples with a force on the foot: a gait has one a stance."""
    if trajectory.foot_force is None:
        return
    acting = np.flatnonzero(trajectory.foot_force.any(axis=1))
    if acting.size and acting.size < len(trajectory):
        for number, run in enumerate(np.split(acting, np.flatnonzero(np.diff(acting) > 1) + 1)):
            axis.axvspan(
                trajectory.time[run[0]],
                trajectory.time[run[-1]],
                color="0.5",
                alpha=0.12,
                linewidth=0.0,
                label="" if number else "force on foot",
            )


def _joined(units: Sequence[str]) -> str:
    return ", ".join(dict.fromkeys(units))


def _checked(name: str, values: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if array.shape != shape:
        raise ShapeError(f"{name} has shape {array.shape}, but this motion and these actuators need {shape}")
    return array
