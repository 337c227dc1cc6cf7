"""The command `torque`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from leg_dynamics.cli.application import FAILED
from leg_dynamics.cli.files import check_writable
from leg_dynamics.cli.loading import FootLoad, choose_trajectory, load_leg
from leg_dynamics.cli.motion import (
    compare_efforts,
    efforts_along,
    followed,
    show_summary,
    summarize,
    write_plot,
    write_table,
)
from leg_dynamics.cli.options import (
    DurationOption,
    FootForceOption,
    FootOption,
    JsonOption,
    LegName,
    LimitsOption,
    ModeOption,
    RateOption,
    RouteOption,
    SetOption,
    SupportOption,
    TrajectoryOption,
    TransmissionOption,
    UrdfOption,
    WindowOption,
    read_path,
)
from leg_dynamics.cli.output import complain, print_json, say_written

PLOT_SUFFIXES = (".png", ".svg", ".pdf")


def torque_leg(
    leg: LegName,
    trajectory: TrajectoryOption = None,
    route: RouteOption = None,
    compare: Annotated[
        str | None, typer.Option("--compare", metavar="ROUTE", help="Compute by this route too; exit 1 if they differ.")
    ] = None,
    foot_force: FootForceOption = None,
    force_window: WindowOption = None,
    support_force: SupportOption = None,
    transmission: TransmissionOption = "exact",
    duration: DurationOption = None,
    rate: RateOption = None,
    ignore_limits: LimitsOption = False,
    set_: SetOption = None,
    foot: FootOption = None,
    urdf: UrdfOption = None,
    mode: ModeOption = None,
    allow_idle: Annotated[
        bool,
        typer.Option("--allow-idle", help="Leave motions that no actuator holds unbalanced, and show by how much."),
    ] = False,
    bounded: Annotated[
        bool, typer.Option("--bounded", help="Keep redundant actuators within the file's effort limits.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("--output", parser=read_path, metavar="F.csv", help="Write the table here.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", parser=read_path, metavar="F.png", help="Draw it here (png, svg or pdf).")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute the actuator torques along a trajectory."""
    for path in (output, plot):
        check_writable(path)
    if plot is not None and plot.suffix.lower() not in PLOT_SUFFIXES:
        raise typer.BadParameter(f"{plot.name!r} does not end in {', '.join(PLOT_SUFFIXES)}", param_hint="--plot")
    load = FootLoad.read(foot_force, force_window, support_force)
    from leg_dynamics.routes import sibling

    model = load_leg(leg, route, set_, foot, urdf, transmission, mode)
    if compare == model.route:
        raise typer.BadParameter(
            f"{compare} is the route itself; compare it with another one, or choose another --route",
            param_hint="--compare",
        )
    motion = choose_trajectory(model, trajectory, duration, rate, ignore_limits)
    motion = load.on(motion, model, trajectory)
    files: dict[str, str] = {}
    with followed(model, motion):
        efforts, residual = efforts_along(model, motion, allow_idle, bounded)
        result = summarize(model, motion, efforts, residual)
        other = None
        if compare is not None:
            second = sibling(model, compare)
            with followed(second, motion):
                other, _ = efforts_along(second, motion, allow_idle, bounded)
            result["comparison"] = compare_efforts(model, second, efforts, other)
        if output is not None:
            write_table(output, model, motion, efforts)
            files["table"] = str(output)
    if plot is not None:
        write_plot(plot, model, motion, efforts, compare, other)
        files["plot"] = str(plot)
    if as_json:
        print_json(result | {"files": files})
    else:
        show_summary(result)
        for path in (output, plot):
            if path is not None:
                say_written(path)
    if compare is not None and not result["comparison"]["passed"]:
        complain(f"error: the routes {model.route} and {compare} disagree")
        raise typer.Exit(FAILED)
