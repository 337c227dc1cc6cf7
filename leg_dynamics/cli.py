"""The command ``leg-dynamics``."""

from __future__ import annotations

import codecs
import contextlib
import dataclasses
import errno
import functools
import json
import math
import os
import re
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import typer

from leg_dynamics.errors import (
    ActuationError,
    CrosscheckError,
    DescriptionError,
    FormulaAssumptionError,
    JointLimitError,
    LegDynamicsError,
    LegDynamicsWarning,
    MissingFootError,
    NonFiniteError,
    OutputError,
    RouteError,
    RowError,
    StudyError,
    TrajectoryError,
    UnsupportedError,
)
from leg_dynamics.papers import names as paper_names

if TYPE_CHECKING:
    import numpy as np
    from rich.console import Console

    from leg_dynamics.analysis.design import Study, StudyResult
    from leg_dynamics.analysis.gait import GaitStudy, Robot, Tilt
    from leg_dynamics.analysis.trajectories import Trajectory
    from leg_dynamics.analysis.workspace import Workspace
    from leg_dynamics.inspection import Inspection
    from leg_dynamics.leg import Leg
    from leg_dynamics.preview import Cloud

__all__ = ["app", "main"]

OK, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130
EXIT_CODES = (
    "Exit codes: 0 done; 1 a check failed or two routes disagree; 2 bad usage, bad input or unwritable output, said "
    "in one line; 130 interrupted."
)
SHOWN_MODES, SHOWN_JOINTS = 8, 6
LEAST_DIFFERENCE = 1e-6
AGREEMENT = 1e-9
"""Two routes agree where their difference is at most this times (1 + magnitude)."""
CHUNK = 256
"""Rows computed between two steps of a progress bar."""
MAX_FORCE = 1e30
"""N; the largest component of a force on the foot: a preview draws in single precision."""
MAX_EFFORT = 1e150
"""N·m or N; the square of a larger torque leaves the range of floating-point numbers."""
FULL_RATE, PREVIEW_RATE = 1000.0, 60.0
"""Samples a second of a named trajectory, computed and shown."""
MIN_PREVIEW_SAMPLES = 6
"""Of a moving preview: as many as a file of samples must have."""
PLOT_SUFFIXES = (".png", ".svg", ".pdf")
FORCE_NOTE = (
    "The foot force is the one that the environment applies to the foot, in the hip frame "
    "(Xu 2025 eq. 49-50 count the opposite one, which the foot exerts)."
)

app = typer.Typer(
    name="leg-dynamics",
    help="Torques, Jacobians and design maps of closed-loop robot legs. "
    "LEG is a shipped name (see `list`) or a path to a .urdf, .urdf.xacro or .xacro file, or to the .yaml file of an "
    "assembly of modules; an xacro file can run Python code, so render only files that you trust.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _path(text: str) -> Path:
    # pathlib reads an empty text as the current folder.
    if not text:
        raise typer.BadParameter("the path is empty; name a file or a folder")
    return Path(text)


# Parameters that several commands share.
LegName = Annotated[str, typer.Argument(metavar="LEG", help="Shipped name, or path to .urdf / .urdf.xacro / .yaml.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Change a parameter of an xacro leg; repeatable."),
]
FootOption = Annotated[str | None, typer.Option("--foot", metavar="LINK", help="Foot link of a file of your own.")]
UrdfOption = Annotated[
    Path | None,
    typer.Option("--urdf", parser=_path, metavar="FILE", help="Geometry and inertia for a named leg's formulas."),
]
RouteOption = Annotated[
    str | None,
    typer.Option("--route", metavar="ROUTE", help="closed_form, pinocchio, ...; the leg's default if absent."),
]
ModeOption = Annotated[
    str | None,
    typer.Option("--mode", metavar="NAME", help="The assembly mode, as `info` lists them; default: the file's home."),
]
TransmissionOption = Annotated[
    str,
    typer.Option(
        "--transmission",
        metavar="exact|paper|none",
        help="Model of the drive train, by the closed form: exact, as published, or without its rotary inertia.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else, on standard output.")]
TrajectoryOption = Annotated[
    str | None,
    typer.Option(
        "--trajectory",
        metavar="NAME|FILE.csv",
        help="A named trajectory of the leg (its first if absent), or a CSV file with columns t, q1..qn "
        "(or joint names), or t, x, y, z of the foot; s, rad, m.",
    ),
]
FootForceOption = Annotated[
    str | None,
    typer.Option("--foot-force", metavar="X,Y,Z", help="N, applied by the environment to the foot, in the hip frame."),
]
WindowOption = Annotated[
    str | None, typer.Option("--force-window", metavar="T0,T1", help="When the force acts, s; always if absent.")
]
SupportOption = Annotated[
    str | None,
    typer.Option(
        "--support-force",
        metavar="X,Y,Z",
        help="N, applied by the ground to the foot in the stance of a gait, such as eq53, and not in its swing.",
    ),
]
DurationOption = Annotated[
    float | None, typer.Option("--duration", metavar="S", help="Length of a named trajectory, s.")
]
RateOption = Annotated[
    float | None, typer.Option("--rate", metavar="1/S", help="Samples a second of a named trajectory.")
]
LimitsOption = Annotated[bool, typer.Option("--ignore-limits", help="Allow motions outside the joint limits.")]


class _Report(Protocol):
    """What the cross-check returns."""

    @property
    def passed(self) -> bool: ...

    def to_dict(self) -> dict[str, Any]: ...


def _reported(command: Callable[..., None]) -> Callable[..., None]:
    """Turn errors of this package into one line and an exit code, and its warnings into one line each."""

    @functools.wraps(command)
    def wrapper(*args: Any, **kwargs: Any) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("always", LegDynamicsWarning)
            show = warnings.showwarning

            def showwarning(message: Any, category: type[Warning], *place: Any, **more: Any) -> None:
                if issubclass(category, LegDynamicsWarning):
                    _complain(f"warning: {_as_options(str(message), kwargs)}")
                else:
                    show(message, category, *place, **more)

            warnings.showwarning = showwarning
            try:
                try:
                    command(*args, **kwargs)
                finally:
                    # Here, where a failure still has a word in the exit code.
                    sys.stdout.flush()
            except KeyboardInterrupt:
                _complain("interrupted")
                raise typer.Exit(INTERRUPTED) from None
            except CrosscheckError as error:
                _complain(f"error: {_as_options(str(error), kwargs)}")
                raise typer.Exit(FAILED) from None
            except LegDynamicsError as error:
                _complain(f"error: {_as_options(str(error), kwargs)}")
                raise typer.Exit(USAGE) from None
            except OSError as error:
                _report_os_error(error)
                raise typer.Exit(USAGE) from None

    return wrapper


def _as_options(text: str, given: Mapping[str, Any]) -> str:
    """A message whose advice to call `load` with a route names the option, where the command has it."""
    return re.sub(r"\broute='(\w+)'", r"--route \1", text) if "route" in given else text


def _report_os_error(error: OSError) -> None:
    """Say in one line which file, or that standard output, failed; raise again what is neither."""
    if error.filename is not None:
        _complain(f"error: {error.filename}: {error.strerror}")
        return
    if error.errno not in (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF):
        raise error
    # What is still buffered would fail again when the interpreter ends.
    with contextlib.suppress(OSError), open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())
    # Nobody reads a broken pipe, as in `| head`: no reason to complain.
    if error.errno != errno.EPIPE:
        _complain(f"error: the output cannot be written: {error.strerror}")


def _command(name: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    def register(function: Callable[..., None]) -> Callable[..., None]:
        return app.command(name, epilog=EXIT_CODES)(_reported(function))

    return register


def _print_version(wanted: bool) -> None:
    if wanted:
        import leg_dynamics

        print(f"leg-dynamics {leg_dynamics.__version__}")
        raise typer.Exit(OK)


@app.callback()
def _global_options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_print_version)
    ] = False,
) -> None: ...


@_command("list")
def list_legs(as_json: JsonOption = False) -> None:
    """List the shipped legs."""
    import leg_dynamics
    from leg_dynamics import description
    from leg_dynamics.analysis.trajectories import named

    rows = []
    for name in leg_dynamics.available():
        mechanism = description.read(name)
        rows.append(
            {
                "name": name,
                "joints": [j.name for j in mechanism.moving_joints if j.independent],
                "actuators": [transmission.actuator for transmission in mechanism.transmissions],
                "links": len(mechanism.links),
                "loops": len(mechanism.loops),
                "couplings": len(mechanism.couplings),
                "trajectories": list(named(mechanism.name)),
            }
        )
    if as_json:
        _print_json({"legs": rows})
        return
    table = _table("Shipped legs", "name", "coordinates", "actuators", "links", "loops", "couplings", "trajectories")
    for row in rows:
        _add_row(table, *(", ".join(value) if isinstance(value, list) else str(value) for value in row.values()))
    _console().print(table)


@_command("info")
def info_leg(
    leg: LegName,
    route: RouteOption = None,
    set_: SetOption = None,
    foot: FootOption = None,
    urdf: UrdfOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check a mechanism file: coordinates, limits, loops, mobility, actuation, assembly modes; exit 1 on errors."""
    report = _inspected(leg, set_, foot, urdf)
    if report.leg is None:
        _show_unreadable(report, as_json)
        raise typer.Exit(FAILED)
    with warnings.catch_warnings():
        # They are among the findings.
        warnings.simplefilter("ignore", LegDynamicsWarning)
        model = _load(leg, route, set_, foot, urdf)
    mechanism = model.description
    mobility = report.mobility
    moving_mass = math.fsum(link.inertial.mass for link in mechanism.links if link.inertial is not None)
    joints = [
        {
            "name": name,
            "unit": unit,
            "lower": float(model.limits.lower[i]),
            "upper": float(model.limits.upper[i]),
            "velocity": float(model.limits.velocity[i]),
            "effort": float(model.limits.effort[i]),
        }
        for i, (name, unit) in enumerate(zip(model.joint_names, model.units.joints, strict=True))
    ]
    actuators = [
        {"name": name, "unit": unit} for name, unit in zip(model.actuator_names, model.units.actuators, strict=True)
    ]
    facts = {
        "name": mechanism.name,
        "file": mechanism.file,
        "route": model.route,
        "foot": model.foot,
        "links": len(mechanism.links),
        "tree_joints": len(mechanism.moving_joints),
        "loops": len(mechanism.loops),
        "couplings": len(mechanism.couplings),
        "mass": moving_mass,
        "configurations": [configuration.name for configuration in mechanism.configurations],
    }
    parameters = [dataclasses.asdict(parameter) for parameter in mechanism.parameters.values()]
    if as_json:
        _print_json(
            facts
            | {
                "joints": joints,
                "actuators": actuators,
                "parameters": parameters,
            }
            | report.to_dict()
        )
        if not report.passed:
            raise typer.Exit(FAILED)
        return
    console = _console()
    table = _table(f"{mechanism.name}", "", "")
    table.show_header = False
    for key, value in facts.items():
        text = ", ".join(value) if isinstance(value, list) else _number(value)
        _add_row(table, key.replace("_", " "), text + (" kg" if key == "mass" else ""))
    console.print(table)
    table = _table("Independent coordinates", "name", "unit", "lower", "upper", "velocity limit", "effort limit")
    for row in joints:
        _add_row(table, *(_number(value) for value in row.values()))
    console.print(table)
    table = _table("Actuators", "name", "unit")
    for actuator in actuators:
        _add_row(table, *actuator.values())
    console.print(table)
    if parameters:
        table = _table("Parameters", "name", "value", "unit", "source", "description")
        for parameter in parameters:
            _add_row(table, *(_number(parameter[key]) for key in ("name", "value", "unit", "source", "description")))
        console.print(table)
    if mobility is not None:
        console.print(mobility)
    _show_inspection(console, report)
    if not report.passed:
        raise typer.Exit(FAILED)


@_command("render")
def render_leg(
    leg: LegName,
    check: Annotated[bool, typer.Option("--check", help="Fail where the shipped URDF+ is stale.")] = False,
    set_: SetOption = None,
    output: Annotated[
        Path | None, typer.Option("--output", parser=_path, metavar="FILE", help="Write here, not to stdout.")
    ] = None,
) -> None:
    """Render a leg's xacro source, or an assembly of modules, to URDF+."""
    from leg_dynamics import description

    if check and (set_ or output):
        raise typer.BadParameter("--check compares the shipped files; it goes with neither --set nor --output")
    text = _rendered(leg, _parameters(set_))
    if check:
        if leg not in description.shipped_names():
            raise typer.BadParameter(f"--check is for shipped legs: {', '.join(description.shipped_names())}")
        shipped = Path(description.shipped_urdf(leg))
        stored = shipped.read_text(encoding="utf-8") if shipped.is_file() else ""
        if stored != text:
            pairs = enumerate(zip(stored.splitlines(), text.splitlines(), strict=False), start=1)
            shorter = min(len(stored.splitlines()), len(text.splitlines())) + 1
            line = next((number for number, (old, new) in pairs if old != new), shorter)
            _complain(f"{shipped}:{line}: stale: differs from its source; render it again")
            raise typer.Exit(FAILED)
        print(f"{leg}: up to date")
    elif output is None:
        sys.stdout.write(text)
    else:
        _write_atomically(output, lambda path: path.write_text(text, encoding="utf-8", newline="\n"))
        _say_written(output)


@_command("torque")
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
        Path | None, typer.Option("--output", parser=_path, metavar="F.csv", help="Write the table here.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", parser=_path, metavar="F.png", help="Draw it here (png, svg or pdf).")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute the actuator torques along a trajectory."""
    for path in (output, plot):
        _check_writable(path)
    if plot is not None and plot.suffix.lower() not in PLOT_SUFFIXES:
        raise typer.BadParameter(f"{plot.name!r} does not end in {', '.join(PLOT_SUFFIXES)}", param_hint="--plot")
    load = _Load.read(foot_force, force_window, support_force)
    from leg_dynamics.routes import sibling

    model = _load(leg, route, set_, foot, urdf, transmission, mode)
    if compare == model.route:
        raise typer.BadParameter(
            f"{compare} is the route itself; compare it with another one, or choose another --route",
            param_hint="--compare",
        )
    motion = _trajectory(model, trajectory, duration, rate, ignore_limits)
    motion = load.on(motion, model, trajectory)
    efforts, residual = _efforts(model, motion, allow_idle, bounded)
    result = _summary(model, motion, efforts, residual)
    other = None
    if compare is not None:
        second = sibling(model, compare)
        other, _ = _efforts(second, motion, allow_idle, bounded)
        result["comparison"] = _comparison(model, second, efforts, other)
    files: dict[str, str] = {}
    if output is not None:
        _write_table(output, model, motion, efforts)
        files["table"] = str(output)
    if plot is not None:
        _write_plot(plot, model, motion, efforts, compare, other)
        files["plot"] = str(plot)
    if as_json:
        _print_json(result | {"files": files})
    else:
        _show_summary(result)
        for path in (output, plot):
            if path is not None:
                _say_written(path)
    if compare is not None and not result["comparison"]["passed"]:
        _complain(f"error: the routes {model.route} and {compare} disagree")
        raise typer.Exit(FAILED)


@_command("crosscheck")
def crosscheck_leg(
    leg: LegName,
    samples: Annotated[int, typer.Option("--samples", min=1, metavar="N", help="Random states.")] = 1000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the random states.")] = 0,
    set_: SetOption = None,
    foot: FootOption = None,
    urdf: UrdfOption = None,
    transmission: TransmissionOption = "exact",
    own: Annotated[
        str | None,
        typer.Option(
            "--own",
            metavar="FILE.py:NAME",
            help="Compare formulas of your own with the leg instead: a class, an object, or without NAME the functions "
            "of the file. This imports the file and runs its code.",
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option("--tolerance", metavar="X", help="Of own formulas, relative to 1 + magnitude; 1e-9 if absent."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compare the leg's routes with each other and with physical laws; exit 1 if they disagree."""
    options = _load_options(set_, foot, urdf, transmission)
    if own is not None:
        report = _own_crosscheck(own, leg, samples, seed, tolerance, **options)
    elif tolerance is not None:
        raise typer.BadParameter("it goes with formulas of your own, --own", param_hint="--tolerance")
    else:
        report = _crosscheck(leg, samples, seed, **options)
    if as_json:
        _print_json(report.to_dict())
    else:
        _console().print(report)
    if not report.passed:
        raise typer.Exit(FAILED)


@_command("preview")
def preview_leg(
    leg: LegName,
    trajectory: TrajectoryOption = None,
    route: RouteOption = None,
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
    html: Annotated[
        Path | None,
        typer.Option("--html", parser=_path, metavar="F.html", help="Write one self-contained page, not a live view."),
    ] = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Live view: do not open a browser.")] = False,
    workspace: Annotated[
        bool, typer.Option("--workspace", help="Show the foot's workspace as points, coloured by condition number.")
    ] = False,
) -> None:
    """Show the moving leg in 3-D: live on this machine, or as one HTML file that plays offline.

    Along a trajectory the motors are coloured by their torque; a force on the foot is an arrow.
    """
    from leg_dynamics.preview import show_live, write_html

    _check_writable(html)
    load = _Load.read(foot_force, force_window, support_force)
    model = _load(leg, route, set_, foot, urdf, transmission)
    motion = _preview_motion(model, trajectory, duration, rate, ignore_limits)
    motion = load.on(motion, model, trajectory)
    loads = _preview_loads(model, motion)
    if workspace:
        loads["cloud"] = _workspace_cloud(model)
    values, trace = _animation(model, motion)
    if html is not None:
        title = f"{model.description.name}, {motion.name}"
        _write_atomically(
            html,
            lambda path: write_html(
                model.description, motion.time, values, path, foot_trace=trace, title=title, **loads
            ),
        )
        _say_written(html)
        return
    view = show_live(
        model.description, motion.time, values, foot_trace=trace, open_browser=not no_browser, loop=True, **loads
    )
    print(f"{view.url}  (Ctrl-C ends the view)", flush=True)
    view.wait()


@app.command(
    "bench",
    epilog=EXIT_CODES,
    add_help_option=False,
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
)
@_reported
def bench(context: typer.Context) -> None:
    """Measure what a torque costs, beside other ways to it; needs a checkout. Options: see `bench --help`."""
    raise typer.Exit(_benchmarks()(context.args, program="leg-dynamics bench"))


@_command("design")
def design_leg(
    leg: LegName,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="NAME=LO:HI", help="Draw a parameter from a range; repeatable."),
    ] = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option("--sweep", metavar="NAME=LO:HI:N", help="Sweep one parameter, the others fixed; repeatable."),
    ] = None,
    stage: Annotated[
        list[str] | None,
        typer.Option(
            "--stage",
            metavar="NAME=LO:HI,...",
            help="A further stage that starts from the design which the one before chose; repeatable.",
        ),
    ] = None,
    samples: Annotated[int, typer.Option("--samples", min=1, metavar="N", help="Designs of each stage.")] = 1000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of all random numbers.")] = 0,
    filter_: Annotated[
        list[str] | None,
        typer.Option("--filter", metavar="NAME>=X", help="What an accepted design fulfils (>=, <=, >, <); repeatable."),
    ] = None,
    objective: Annotated[
        list[str] | None,
        typer.Option(
            "--objective",
            metavar="NAME",
            help="V, kbar, ktilde, k_min, L, Z, Z_b, Z_f, mass, and with --gait peak_force, peak_speed, peak_power; "
            "repeatable.",
        ),
    ] = None,
    choose: Annotated[
        str,
        typer.Option("--choose", metavar="RULE", help="The accepted design next to the median, or min:NAME, max:NAME."),
    ] = "median",
    gait: Annotated[
        str | None,
        typer.Option("--gait", metavar="T,S,H", help="Cycle of the foot: period s, stride m, clearance m."),
    ] = None,
    support_force: Annotated[
        str | None,
        typer.Option("--support-force", metavar="X,Y,Z", help="N, by the ground on the foot in the gait's stance."),
    ] = None,
    tolerance: Annotated[
        float, typer.Option("--tolerance", metavar="X", help="Of V, kbar, ktilde, relative; decides on the samples.")
    ] = 0.03,
    ignore: Annotated[
        list[str] | None,
        typer.Option("--ignore", metavar="NAME|KIND", help="Leave out a constraint, see `workspace`; repeatable."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, metavar="N", help="Processes; one a processor if absent.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="tcp://HOST:PORT", help="Compute on this Dask cluster instead."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", parser=_path, metavar="DIR", help="Keep the study, its tables and its plots here."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the study that --output holds.")] = False,
    route: RouteOption = None,
    set_: SetOption = None,
    foot: FootOption = None,
    urdf: UrdfOption = None,
    html: Annotated[
        Path | None, typer.Option("--html", parser=_path, metavar="F.html", help="Write one self-contained page.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Study a leg's design: sweep parameters, or draw many designs, filter them, and choose one."""
    from leg_dynamics.analysis.design import Range, Stage, Study, gait_path
    from leg_dynamics.analysis.design.page import render_page

    if bool(sweep) == bool(vary or stage):
        raise typer.BadParameter("give either --sweep, or --vary (and perhaps --stage)")
    if resume and output is None:
        raise typer.BadParameter("--resume goes on with the study in a folder: name it with --output")
    peaks = ("peak_force", "peak_speed", "peak_power")
    asked = (*(objective or ()), *(filter_ or ()), choose)
    if gait is not None and not any(peak in text for peak in peaks for text in asked):
        raise typer.BadParameter(f"--gait serves the objectives {', '.join(peaks)}: ask for one with --objective")
    if support_force is not None and gait is None:
        raise typer.BadParameter("--support-force acts in the stance of a gait: give --gait too")
    _check_writable(html)
    if output is not None:
        _check_folder(output, files=(output / "summary.json", output / "designs.csv", output / "manifest.json"))
    stages = [Stage(tuple(map(Range.parse, sweep)))] if sweep else []
    for texts in ([list(vary)] if vary else []) + [text.split(",") for text in stage or ()]:
        stages.append(Stage(tuple(map(Range.parse, texts)), samples))
    model = _load_quick(leg, route, set_, foot, urdf)
    path = None
    if gait is not None:
        period, stride, clearance = _numbers("--gait", gait, 3)
        force = None if support_force is None else _numbers("--support-force", support_force, 3)
        path = gait_path(model, period, stride, clearance, support_force=force)  # type: ignore[arg-type]
    study = Study(
        model,
        tuple(stages),
        objectives=tuple(objective or ()),
        filters=tuple(filter_ or ()),
        choose=choose,
        seed=seed,
        tolerance=tolerance,
        ignore=tuple(ignore or ()),
        path=path,
    )
    result = _design(study, output, resume=resume, workers=workers, scheduler=scheduler)
    written = [] if output is None else list(result.write(output))
    if html is not None:
        page = render_page(result)
        _write_atomically(html, lambda path: path.write_text(page, encoding="utf-8", newline="\n"))
        written.append(html)
    if as_json:
        _print_json(result.to_dict() | {"files": [str(path) for path in written]})
    else:
        if result.any_possible:
            _show_design(result)
        for file in written:
            _say_written(file)
    if not result.any_possible:
        raise StudyError(result.why_nothing())


@_command("workspace")
def workspace_leg(
    leg: LegName,
    tolerance: Annotated[
        float | None, typer.Option("--tolerance", metavar="X", help="Of the volume, relative; decides on the samples.")
    ] = None,
    ignore: Annotated[
        list[str] | None,
        typer.Option(
            "--ignore",
            metavar="NAME|KIND",
            help="Leave out a constraint, or all that are a joint, cone, telescope or clearance; repeatable.",
        ),
    ] = None,
    height: Annotated[
        float | None, typer.Option("--height", metavar="Z", help="z of the foot's home position, m, hip frame.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the samples.")] = 0,
    route: RouteOption = None,
    set_: SetOption = None,
    foot: FootOption = None,
    urdf: UrdfOption = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", parser=_path, metavar="DIR", help="Write summary, samples, boundary and plots here."),
    ] = None,
    html: Annotated[
        Path | None, typer.Option("--html", parser=_path, metavar="F.html", help="Write one self-contained page.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute the foot's workspace: volume, boundary, dexterity, step sizes, and the constraints that set them."""
    from leg_dynamics.analysis.workspace.page import render_page

    _check_writable(html)
    if output is not None:
        _check_folder(output, files=(output / "summary.json", output / "samples.csv", output / "boundary.csv"))
    result = _workspace(
        _load_quick(leg, route, set_, foot, urdf), tolerance=tolerance, ignore=ignore or (), height=height, seed=seed
    )
    written = [] if output is None else list(result.write(output))
    if html is not None:
        page = render_page(result)
        _write_atomically(html, lambda path: path.write_text(page, encoding="utf-8", newline="\n"))
        written.append(html)
    if as_json:
        _print_json(result.to_dict() | {"files": [str(path) for path in written]})
        return
    _show_workspace(result)
    for path in written:
        _say_written(path)


@_command("gait")
def gait_robot(
    robot: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT",
            help="Robot with legs: hexapod, quadruped, or path to .urdf / .urdf.xacro / .yaml. The quadruped has "
            "defaults of its own: it creeps III,I,IV,II in 20 s with a sway.",
        ),
    ],
    gait: Annotated[
        str | None,
        typer.Option(
            "--gait",
            metavar="tripod|wave|ripple|LEG,LEG,...",
            help="Which leg swings when: a name (tripod if absent), or every leg in the order of their swings.",
        ),
    ] = None,
    group: Annotated[
        int | None,
        typer.Option("--group", metavar="N", help="Legs of such an order that swing without a pause in between; 1."),
    ] = None,
    leg: Annotated[
        list[str] | None,
        typer.Option("--leg", metavar="LEG", help="What its legs are; shipped ones that fit if absent; repeatable."),
    ] = None,
    period: Annotated[float | None, typer.Option("--period", metavar="S", help="Of the gait, s; 4 if absent.")] = None,
    stride: Annotated[
        float | None,
        typer.Option(
            "--stride", metavar="M", help="How far a foot goes back below the body on the ground, m; 0.2 if absent."
        ),
    ] = None,
    velocity: Annotated[
        str | None, typer.Option("--velocity", metavar="VX,VY", help="Of the body, m/s ahead and left, not --stride.")
    ] = None,
    turn: Annotated[float, typer.Option("--turn", metavar="W", help="Turn rate of the body, rad/s to the left.")] = 0.0,
    clearance: Annotated[
        float | None, typer.Option("--clearance", metavar="M", help="Height of the swing, m; 0.1 if absent.")
    ] = None,
    duty: Annotated[
        float | None, typer.Option("--duty", metavar="X", help="Share of the period on the ground; the gait's own.")
    ] = None,
    law: Annotated[
        str, typer.Option("--law", metavar="polynomial|cycloid|minimum_jerk", help="Path law of the swing.")
    ] = "polynomial",
    body_height: Annotated[
        float | None, typer.Option("--body-height", metavar="M", help="Body frame above the ground, m; home if absent.")
    ] = None,
    splay: Annotated[
        float | None,
        typer.Option(
            "--splay",
            metavar="RAD",
            help="Legs turned from sideways, front ones ahead, rear ones back; home if absent.",
        ),
    ] = None,
    reach: Annotated[
        float | None,
        typer.Option("--reach", metavar="M", help="Feet from their hips, seen from above, m; home if absent."),
    ] = None,
    sway: Annotated[
        str | None,
        typer.Option(
            "--sway",
            metavar="AHEAD,LEFT",
            help="Let the body leave its even motion by up to so many m each way, for the greatest stability margin; "
            "0,0 if absent.",
        ),
    ] = None,
    harmonics: Annotated[
        int | None, typer.Option("--harmonics", metavar="N", help="Of the sway: its highest frequency; 4 if absent.")
    ] = None,
    tilt: Annotated[
        str | None,
        typer.Option(
            "--tilt", metavar="ROLL,PITCH", help="Of the body, rad: right side down, head down; 0,0 if absent."
        ),
    ] = None,
    tilt_sine: Annotated[
        str | None,
        typer.Option("--tilt-sine", metavar="ROLL,PITCH", help="Rad that the tilt swings by, as sin(2 pi t / period)."),
    ] = None,
    tilt_cosine: Annotated[
        str | None, typer.Option("--tilt-cosine", metavar="ROLL,PITCH", help="The same, as cos(2 pi t / period).")
    ] = None,
    load: Annotated[
        str,
        typer.Option(
            "--load",
            metavar="balanced|equal|none",
            help="Foot forces: least ones that balance the robot, equal ones that ignore moments, or none.",
        ),
    ] = "balanced",
    friction: Annotated[
        float | None, typer.Option("--friction", metavar="MU", help="Keep balanced forces in a friction pyramid.")
    ] = None,
    samples: Annotated[int, typer.Option("--samples", metavar="N", help="Steps of a period.")] = 400,
    ignore_limits: LimitsOption = False,
    route: RouteOption = None,
    set_: SetOption = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", parser=_path, metavar="DIR", help="Write summary, table of the cycle and plots here."),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option("--html", parser=_path, metavar="F.html", help="Write a page that shows the robot walking."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Walk a robot through one cycle of a gait: stability, foot forces, actuator speeds and efforts."""
    from leg_dynamics.analysis import gait as gaits

    _check_writable(html)
    if output is not None:
        _check_folder(output, files=[output / name for name in gaits.FILES])
    if stride is not None and velocity is not None:
        raise typer.BadParameter("it goes with no --stride: the duty factor links both", param_hint="--velocity")
    model = _robot(robot, leg, route, set_)
    with _error_console().status("walking"):
        planned = gaits.plan_walk(
            model,
            gait=tuple(gait.split(",")) if gait is not None and "," in gait else gait,
            group=group,
            period=period,
            stride=stride,
            velocity=None if velocity is None else _numbers("--velocity", velocity, 2),
            turn=turn,
            clearance=clearance,
            duty=duty,
            law=law,
            splay=splay,
            reach=reach,
            body_height=body_height,
            sway=None if sway is None else _numbers("--sway", sway, 2),
            harmonics=harmonics,
            tilt=_tilt(tilt, tilt_sine, tilt_cosine),
        )
        result = gaits.study(
            model,
            planned.walk,
            samples=samples,
            load=load,
            friction=friction,
            limits="ignore" if ignore_limits else "error",
            choices=planned.choices,
            alternatives=planned.alternatives,
        )
        written = [] if output is None else list(gaits.write(result, output))
    if html is not None:
        _write_walk(html, result)
        written.append(html)
    facts = gaits.summary(result)
    if as_json:
        _print_json(facts | {"files": [str(path) for path in written]})
    else:
        _show_gait(facts)
        for path in written:
            _say_written(path)
    if not (facts["drives_suffice"] or ignore_limits):
        _complain("error: the drives cannot do this gait; see its summary")
        raise typer.Exit(FAILED)


@_command("demo")
def demo(
    output: Annotated[
        Path, typer.Option("--output", parser=_path, metavar="DIR", help="Folder for the results.")
    ] = Path("demo"),
    samples: Annotated[int, typer.Option("--samples", min=1, metavar="N", help="States of the cross-check.")] = 300,
) -> None:
    """Compute the OmniLeg's torques along Xu 2025 eq. (52) by two routes, cross-check them, draw and animate them."""
    from leg_dynamics.analysis.trajectories import omnileg_eq52
    from leg_dynamics.preview import write_html

    table, plot, page = output / "torque.csv", output / "torque.png", output / "preview.html"
    _check_folder(output, files=(table, plot, page))
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder {output} cannot be made: {error.strerror}; choose another --output") from None
    console = _console()
    leg, other = _load("omnileg"), _load("omnileg", route="pinocchio")
    motion = omnileg_eq52(2.0, 1000.0).with_foot_force((0.0, -20.0, 20.0), 0.0, 1.0)
    efforts, second = _torque(leg, motion), _torque(other, motion)
    result = _summary(leg, motion, efforts)
    result["comparison"] = _comparison(leg, other, efforts, second)
    _show_summary(result)
    report = _crosscheck("omnileg", samples, 0)
    console.print(report)

    _write_table(table, leg, motion, efforts)
    _write_plot(plot, leg, motion, efforts, other.route, second)
    animation = omnileg_eq52(2.0, 60.0)
    values, trace = _animation(leg, animation)
    title = "OmniLeg along Xu 2025 eq. (52)"
    _write_atomically(
        page, lambda path: write_html(leg.description, animation.time, values, path, foot_trace=trace, title=title)
    )
    for path in (table, plot, page):
        _say_written(path)
    if not (report.passed and result["comparison"]["passed"]):
        _complain("error: the routes disagree; see the tables above")
        raise typer.Exit(FAILED)


@_command("reproduce")
def reproduce_paper(
    paper: Annotated[
        str,
        typer.Argument(metavar="PAPER", help=f"The paper, by its leg or robot: {', '.join(paper_names())}."),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            parser=_path,
            metavar="DIR",
            help="Write index.html, report.json and the plots into this folder.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Judge a paper's equations, tables, figures and claims by computing them; exit 1 if what must hold fails."""
    from leg_dynamics import papers

    fixed = () if output is None else (output / "index.html", output / "report.json")
    if output is not None:
        _check_folder(output / "plots", files=fixed)
    with _progress() as progress:
        task = progress.add_task(paper, total=1.0)

        def step(what: str, share: float) -> None:
            progress.update(task, description=what, completed=share)

        report = papers.find(paper).reproduce(progress=step)
        if output is not None:
            # Again, with the plots' names: nothing is written where something cannot be.
            drawings = (output / "plots" / f"{drawing.name}.png" for drawing in report.plots)
            _check_folder(output / "plots", files=(*fixed, *drawings))
        written = () if output is None else report.write(output, progress=step)
    if as_json:
        _print_json(report.to_dict() | {"files": [str(path) for path in written]})
    else:
        _console().print(report)
        for path in written:
            _say_written(path)
    if not report.passed:
        failing = ", ".join(check.name for check in report.checks if check.state == "fails")
        _complain(f"error: what must hold does not: {failing}")
        raise typer.Exit(FAILED)


# Loading and input.


def _load(
    name: str,
    route: str | None = None,
    set_: Sequence[str] | None = None,
    foot: str | None = None,
    urdf: Path | None = None,
    transmission: str = "exact",
    mode: str | None = None,
) -> Leg:
    import leg_dynamics

    options = _load_options(set_, foot, urdf, transmission) | {"mode": mode}
    with _error_console().status("loading"):
        return leg_dynamics.load(name, route, **options)


def _rendered(name: str, parameters: dict[str, float] | None) -> str:
    """Render a source to a text that `load` accepts; what it would refuse is refused here."""
    import leg_dynamics
    from leg_dynamics import description
    from leg_dynamics.routes import has_closed_form

    if parameters and name in description.shipped_names() and has_closed_form(name):
        return leg_dynamics.load(name, parameters=parameters).description.urdf
    if parameters:
        return description.read(name, parameters=parameters).urdf
    text = description.render(name)
    description.parse(text, file=description.rendered_name(Path(name)))
    return text


def _load_quick(name: str, route: str | None, set_: Sequence[str] | None, foot: str | None, urdf: Path | None) -> Leg:
    """Load a leg for many thousand poses: compiled, where the caller names no route."""
    from leg_dynamics.routes import sibling

    model = _load(name, route, set_, foot, urdf)
    return sibling(model, "symbolic") if route is None and model.route == "pinocchio" else model


def _robot(name: str, legs: Sequence[str] | None, route: str | None, set_: Sequence[str] | None) -> Robot:
    """Read a robot and the legs that it walks on: the named ones, or shipped ones that fit, one model or several."""
    import leg_dynamics
    from leg_dynamics import description
    from leg_dynamics.analysis.gait import robot_from
    from leg_dynamics.analysis.gait.reading import leg_prefixes, moving_hip
    from leg_dynamics.analysis.gait.robot import hip_link

    mechanism = description.read(name, parameters=_parameters(set_))

    def own(candidate: str) -> list[str]:
        """The parameters that the leg has as well: a robot's body has some of its own."""
        known = description.read(candidate).parameters
        return [text for text in set_ or () if text.partition("=")[0].strip() in known]

    if legs:
        return robot_from(mechanism, [_load(leg, route, own(leg)) for leg in legs])
    reason = ""
    partly: list[Leg] = []
    refused: dict[str, str] = {}
    for candidate in leg_dynamics.available():
        usual = description.read(candidate)
        if not usual.has_link("foot"):
            continue
        try:
            model = _load(candidate, route, own(candidate))
        except (DescriptionError, FormulaAssumptionError, RouteError) as error:
            # Only a leg that the robot could have is missed.
            for prefix in leg_prefixes(mechanism, [usual]):
                refused[candidate] = str(error)
                if moving := moving_hip(mechanism, prefix + hip_link(usual)):
                    reason = reason or f": the hip of {prefix!r} hangs on the moving joint {moving!r}"
            continue
        try:
            return robot_from(mechanism, model)
        except DescriptionError as error:
            # Some of the robot's legs may be this one, and some another.
            if "prefixes" in error.evidence:
                partly.append(model)
                reason = reason or f": {error.message.removeprefix(f'{mechanism.file}: ')}"
    if len(partly) > 1:
        try:
            return robot_from(mechanism, partly)
        except DescriptionError as error:
            reason = f": {error.message.removeprefix(f'{mechanism.file}: ')}"
    if refused:
        values = f" with {', '.join(set_)}" if set_ else ""
        reasons = "; ".join(f"{candidate}: {why}" for candidate, why in refused.items())
        raise DescriptionError(
            f"the legs of {mechanism.name!r} cannot be compared with the shipped ones that their links are named "
            f"after, for these do not load{values} ({reasons}){reason.replace(':', '; besides,', 1)}; choose values "
            "that these legs take too, or name another leg with --leg",
            file=mechanism.file,
            refused=refused,
        )
    raise DescriptionError(
        f"{mechanism.name!r} has no legs that are a shipped one or its mirror image{reason}; give a robot, such as "
        "hexapod or quadruped, and name its leg with --leg",
        file=mechanism.file,
    )


def _tilt(fixed: str | None, sine: str | None, cosine: str | None) -> Tilt | None:
    """The tilt of a walk's body from its options."""
    import numpy as np

    from leg_dynamics.analysis.gait import Tilt

    if fixed is None and sine is None and cosine is None:
        return None
    options = {"--tilt": fixed, "--tilt-sine": sine, "--tilt-cosine": cosine}
    (roll, pitch), *waves = (_numbers(option, text or "0,0", 2) for option, text in options.items())
    return Tilt(roll, pitch, sine=np.array([waves[0]]), cosine=np.array([waves[1]]))


def _load_options(
    set_: Sequence[str] | None, foot: str | None, urdf: Path | None, transmission: str = "exact"
) -> dict[str, Any]:
    return {
        "parameters": _parameters(set_),
        "foot": foot,
        "urdf": None if urdf is None else str(urdf),
        "transmission": transmission,
    }


def _parameters(set_: Sequence[str] | None) -> dict[str, float] | None:
    if not set_:
        return None
    parameters: dict[str, float] = {}
    for text in set_:
        name, equals, value = text.partition("=")
        name = name.strip()
        if not (name and equals):
            raise typer.BadParameter(f"{text!r} is not NAME=VALUE, such as L1=0.2", param_hint="--set")
        if name in parameters:
            raise typer.BadParameter(f"{name} is set twice", param_hint="--set")
        (parameters[name],) = _numbers("--set", value, 1)
    return parameters


def _numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        what = "one finite number" if count == 1 else f"{count} finite numbers separated by commas"
        raise typer.BadParameter(f"{text!r} is not {what}", param_hint=option)
    return numbers


@dataclasses.dataclass(frozen=True)
class _Load:
    """The force on the foot that the options ask for: always, in a window, or in the stance of a gait."""

    force: tuple[float, ...] | None
    window: tuple[float, ...] | None
    in_stance: bool

    @classmethod
    def read(cls, foot_force: str | None, force_window: str | None, support_force: str | None) -> _Load:
        if support_force is not None and (foot_force is not None or force_window is not None):
            raise typer.BadParameter(
                "the gait says when it acts; it goes with neither --foot-force nor --force-window",
                param_hint="--support-force",
            )
        option, text = ("--foot-force", foot_force) if support_force is None else ("--support-force", support_force)
        force = None if text is None else _numbers(option, text, 3)
        window = None if force_window is None else _numbers("--force-window", force_window, 2)
        if force is None:
            if window is not None:
                raise typer.BadParameter("--force-window needs --foot-force")
        elif max(map(abs, force)) > MAX_FORCE:
            raise typer.BadParameter(
                f"{text!r} is out of range: no component may exceed {MAX_FORCE:g} N", param_hint=option
            )
        return cls(force, window, support_force is not None)

    def on(self, motion: Trajectory, leg: Leg, choice: str | None) -> Trajectory:
        """Return the motion with this force; `choice` is the trajectory that the options name."""
        if self.force is None:
            return motion
        if not self.in_stance:
            return motion.with_foot_force(self.force, *(self.window or (None, None)))
        from leg_dynamics.analysis.trajectories import named, named_cycle

        names = list(named(leg.description.name))
        cycle = named_cycle(leg.description.name, choice or next(iter(names), ""))
        if cycle is None:
            gaits = [name for name in names if named_cycle(leg.description.name, name) is not None]
            raise TrajectoryError(
                f"{motion.name!r} is no gait with a stance for --support-force to act in (gaits of "
                f"{leg.description.name!r}: {', '.join(gaits) or 'none'}); use --foot-force, with --force-window"
            )
        return motion.with_foot_force(cycle.support_force(motion.time, self.force))


def _trajectory(
    leg: Leg, choice: str | None, duration: float | None, rate: float | None, ignore_limits: bool
) -> Trajectory:
    from leg_dynamics.analysis.trajectories import from_csv, named

    names = named(leg, limits="ignore" if ignore_limits else "error")
    known = f"named ones of {leg.description.name!r}: {', '.join(names) or 'none'}"
    if choice is None:
        if not names:
            raise TrajectoryError(f"no trajectory is given; pass --trajectory FILE.csv ({known})")
        choice = next(iter(names))
    if choice in names:
        motion = names[choice](duration, FULL_RATE if rate is None else rate)
        if not ignore_limits:
            motion.check_limits_of(leg)
        return motion
    # pathlib reads an empty text as the current folder, which exists.
    if not (choice and (choice.lower().endswith(".csv") or Path(choice).exists())):
        raise TrajectoryError(f"there is neither a trajectory nor a file {choice!r} ({known})")
    if duration is not None or rate is not None:
        raise typer.BadParameter("--duration and --rate go with a named trajectory; a file brings its own times")
    from leg_dynamics.description.places import with_place

    try:
        return from_csv(choice, leg, limits="ignore" if ignore_limits else "error")
    except JointLimitError as error:
        raise with_place(leg.description, None, error) from None


def _preview_motion(
    leg: Leg, choice: str | None, duration: float | None, rate: float | None, ignore_limits: bool
) -> Trajectory:
    import numpy as np

    from leg_dynamics.analysis.trajectories import Trajectory, named

    if choice is None and not named(leg.description.name):
        home = leg.description.home
        pose = np.array([[0.0 if home is None else home.values.get(name, 0.0) for name in leg.joint_names]])
        return Trajectory([0.0], pose, 0.0 * pose, 0.0 * pose, name="home pose")  # type: ignore[arg-type]
    motion = _trajectory(
        leg, choice, duration, PREVIEW_RATE if rate is None and _is_named(leg, choice) else rate, ignore_limits
    )
    if len(motion) < MIN_PREVIEW_SAMPLES and _is_named(leg, choice):
        length = _trajectory(leg, choice, duration, FULL_RATE, ignore_limits).duration
        raise TrajectoryError(
            f"{len(motion)} {'samples show' if len(motion) > 1 else 'sample shows'} nothing of how {motion.name!r} "
            f"moves in {length:g} s: a preview needs at least {MIN_PREVIEW_SAMPLES}, so a --rate of "
            f"{(MIN_PREVIEW_SAMPLES - 1) / length if length else math.inf:.3g} a second or more, or a longer --duration"
        )
    return motion


def _is_named(leg: Leg, choice: str | None) -> bool:
    from leg_dynamics.analysis.trajectories import named

    return choice is None or choice in named(leg.description.name)


# Computation.


def _torque(leg: Leg, motion: Trajectory) -> np.ndarray:
    return _efforts(leg, motion)[0]


def _efforts(
    leg: Leg, motion: Trajectory, allow_idle: bool = False, bounded: bool = False
) -> tuple[np.ndarray, np.ndarray | None]:
    """Efforts along a motion, (N, m), in one assembly mode, and what they leave unbalanced, (N, n), where allowed."""
    import numpy as np

    from leg_dynamics.analysis.trajectories import assemble_along
    from leg_dynamics.analysis.trajectories.following import located

    with _error_console().status("following the assembly mode"):
        assemble_along(leg, motion)
    policy: dict[str, Any] = {"bounds": True} if bounded else {}
    parts: list[np.ndarray] = []
    left: list[np.ndarray] = []
    for rows in _chunks(len(motion), f"torque, {leg.route}"):
        force = None if motion.foot_force is None else motion.foot_force[rows]
        state: Any = motion.q[rows], motion.v[rows], motion.a[rows], force
        try:
            # An overflow is told below.
            with np.errstate(over="ignore", invalid="ignore"):
                if allow_idle:
                    torque, residual = leg.torque(*state, allow_idle=True, **policy)
                    left.append(residual)
                else:
                    torque = leg.torque(*state, **policy)
        except RowError as error:
            raise located(error, leg, motion, rows.start) from error
        parts.append(torque)
    efforts = np.concatenate(parts)
    # Written so that a NaN fails.
    bad = np.argwhere(~(np.abs(efforts) <= MAX_EFFORT))
    if bad.size:
        row, k = bad[0]
        raise NonFiniteError(
            f"the torque overflows: {leg.actuator_names[k]} is {efforts[row, k]:.3g} {leg.units.actuators[k]} at "
            f"t = {motion.time[row]:g} s, beyond {MAX_EFFORT:g}; slow the motion down, or lower the force and the "
            "parameters",
            rows=np.unique(bad[:, 0]),
        )
    return efforts, np.concatenate(left) if left else None


def _animation(leg: Leg, motion: Trajectory) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Tree joint coordinates along the motion, and the foot's path in the root frame."""
    import numpy as np

    from leg_dynamics.description import link_transforms

    parts = [leg.assemble(motion.q[rows]) for rows in _chunks(len(motion), "poses")]
    values = {joint: np.concatenate([part[joint] for part in parts]) for joint in parts[0]}
    if leg.foot is None:
        return values, None
    return values, link_transforms(leg.description, values)[leg.foot][..., :3, 3]


def _preview_loads(leg: Leg, motion: Trajectory) -> dict[str, Any]:
    """What a preview draws of the forces: that on the foot in the root frame, and the efforts along a motion."""
    from leg_dynamics.preview import in_root_frame

    loads: dict[str, Any] = {}
    if motion.foot_force is not None:
        # The torque would say so too, but a still has none.
        if leg.foot is None:
            raise MissingFootError(f"{leg.description.name} has no foot for the force to act on; name it with --foot")
        loads["foot_force"] = in_root_frame(leg.description, motion.foot_force)
    if len(motion) > 1:
        try:
            efforts = _torque(leg, motion)
        except ActuationError as error:
            _complain(f"note: the motors are not coloured by torque: {error}")
        else:
            loads["efforts"] = dict(zip(leg.actuator_names, efforts.T, strict=True))
    return loads


def _workspace(leg: Leg, **options: Any) -> Workspace:
    from leg_dynamics.analysis.workspace import workspace

    with _progress() as progress:
        task = progress.add_task("workspace", total=1.0)

        def step(what: str, share: float) -> None:
            progress.update(task, description=what, completed=share)

        return workspace(leg, progress=step, **options)


def _design(study: Study, output: Path | None, **options: Any) -> StudyResult:
    from leg_dynamics.analysis.design import run

    with _progress() as progress:
        task = progress.add_task("design", total=1.0)

        def step(what: str, share: float) -> None:
            progress.update(task, description=what, completed=share)

        return run(study, output, progress=step, **options)


def _workspace_cloud(leg: Leg) -> Cloud:
    """The leg's workspace in the root frame, one point for equal volumes."""
    import numpy as np

    from leg_dynamics.description import link_transforms
    from leg_dynamics.preview import Cloud

    result = _workspace(leg, tolerance=0.02)
    share = result.weights / result.weights.sum()
    rows = np.random.default_rng(0).choice(len(share), 8000, p=share)
    poses = result.poses[np.unique(rows)]
    mechanism = leg.description
    hip = link_transforms(mechanism, {})["hip"] if mechanism.has_link("hip") else np.eye(4)
    return Cloud.of(poses.foot @ hip[:3, :3].T + hip[:3, 3], poses.condition, "points: condition number")


def _inspected(name: str, set_: Sequence[str] | None, foot: str | None, urdf: Path | None) -> Inspection:
    from leg_dynamics.inspection import inspect

    with _error_console().status("looking at the mechanism"):
        return inspect(name if urdf is None else urdf, foot=foot, parameters=_parameters(set_))


def _crosscheck(name: Any, samples: int, seed: int, **load_options: Any) -> _Report:
    from leg_dynamics.verification.crosscheck import crosscheck

    with _progress() as progress:
        task = progress.add_task("cross-check", total=1.0)

        def step(what: str, share: float) -> None:
            progress.update(task, description=what, completed=share)

        return crosscheck(name, samples=samples, seed=seed, progress=step, **load_options)


def _own_crosscheck(
    own: str, name: str, samples: int, seed: int, tolerance: float | None, **load_options: Any
) -> _Report:
    from leg_dynamics.verification.own_file import read_own

    # What the file prints must not get among the JSON.
    with contextlib.redirect_stdout(sys.stderr):
        formulas = read_own(own)
        return _crosscheck(formulas, samples, seed, against=name, tolerance=tolerance, **load_options)


def _summary(leg: Leg, motion: Trajectory, efforts: np.ndarray, residual: np.ndarray | None = None) -> dict[str, Any]:
    import numpy as np

    from leg_dynamics.analysis.trajectories.following import limit_flags

    peaks = np.abs(efforts).argmax(axis=0)
    flags = limit_flags(leg.feasible(motion.q, motion.v, motion.a, torque=efforts), motion.time)
    idle = {}
    if residual is not None:
        idle = {
            name: float(np.abs(residual[:, leg.joint_names.index(name)]).max(initial=0.0))
            for name in leg.actuation.idle
        }
    return {
        "leg": leg.description.name,
        "route": leg.route,
        "transmission": leg.recipe.transmission,
        "trajectory": motion.name,
        "samples": len(motion),
        "start": float(motion.time[0]),
        "end": float(motion.time[-1]),
        "foot_force": None if motion.foot_force is None else FORCE_NOTE,
        "feasible": all(flag["feasible"] for flag in flags),
        "actuation": leg.actuation.to_dict(),
        "unbalanced": idle,
        "actuators": [
            {
                "name": name,
                "unit": unit,
                "peak": float(efforts[peaks[k], k]),
                "time_of_peak": float(motion.time[peaks[k]]),
                "rms": float(np.sqrt(np.mean(efforts[:, k] ** 2))),
                "limits": {key: value for key, value in flags[k].items() if key != "actuator"},
            }
            for k, (name, unit) in enumerate(zip(leg.actuator_names, leg.units.actuators, strict=True))
        ],
    }


def _comparison(first: Leg, second: Leg, efforts: np.ndarray, other: np.ndarray) -> dict[str, Any]:
    import numpy as np

    difference = np.abs(efforts - other)
    relative = difference / (1.0 + np.maximum(np.abs(efforts), np.abs(other)))
    return {
        "routes": [first.route, second.route],
        "largest_difference": float(difference.max()),
        "largest_relative_difference": float(relative.max()),
        "tolerance": AGREEMENT,
        # Written so that a NaN fails.
        "passed": bool(relative.max() <= AGREEMENT),
    }


# Output.


def _benchmarks() -> Callable[..., int]:
    """The command of the benchmarks, which a checkout has beside this package and a wheel has not."""
    import importlib

    root = Path(__file__).resolve().parents[1]
    if not (root / "benchmarks" / "__main__.py").is_file():
        raise UnsupportedError(
            "the benchmarks are not part of the installed package: clone the repository and run `make bench`, or "
            "leg-dynamics bench, there"
        )
    if str(root) not in sys.path:
        sys.path.insert(0, str(root))
    main: Callable[..., int] = importlib.import_module("benchmarks.__main__").main
    return main


def _show_summary(result: Mapping[str, Any]) -> None:
    console = _console()
    _say(
        f"{result['leg']} along {result['trajectory']}, {result['start']:g} to {result['end']:g} s, "
        f"{result['samples']} samples, route {result['route']}"
        + ("" if result["transmission"] == "exact" else f", transmission {result['transmission']}")
    )
    table = _table("", "actuator", "peak", "at", "rms", "unit", "limits")
    for row in result["actuators"]:
        cells = f"{row['peak']:+.6f}", f"{row['time_of_peak']:.3f} s", f"{row['rms']:.6f}", row["unit"]
        _add_row(table, row["name"], *cells, _limit_text(row["limits"]))
    console.print(table)
    for name, value in result["unbalanced"].items():
        _say(f"no actuator holds {name}: up to {value:.6g} N·m (or N) are left unbalanced there")
    if result["foot_force"] is not None:
        _say(result["foot_force"])
    if "comparison" in result:
        comparison = result["comparison"]
        _say(
            f"largest difference between {' and '.join(comparison['routes'])}: "
            f"{comparison['largest_difference']:.3g} (relative to 1 + magnitude: "
            f"{comparison['largest_relative_difference']:.3g}, tolerance {comparison['tolerance']:g}): "
            f"{'agree' if comparison['passed'] else 'DISAGREE'}"
        )


_MARKS = {"error": "[red]error[/red]", "warning": "[yellow]warning[/yellow]", "note": "note"}


def _show_inspection(console: Console, report: Inspection) -> None:
    from rich.markup import escape

    if report.loops:
        table = _table("Loops and couplings", "name", "type", "rows", "needed", "redundant", "with")
        for each in report.loops:
            counts = (str(count) for count in (each.rows, each.needed, each.redundant))
            shown = ", ".join(each.with_[:3]) + (" ..." if len(each.with_) > 3 else "")
            _add_row(table, each.loop, each.type, *counts, shown)
        console.print(table)
    if report.actuation is not None:
        console.print(escape(f"actuation: {report.actuation}"))
    if report.condition is not None:
        condition = report.condition
        console.print(
            f"closure at home: smallest singular value {condition.smallest:.3g} of largest {condition.largest:.3g}"
        )
    if len(report.modes) > 1:
        title = f"Assembly modes at home: {len(report.modes)} found"
        table = _table(title, "name", "configurations", "smallest singular value", "joints that differ")
        home = report.modes[0].coordinates
        for mode in report.modes[:SHOWN_MODES]:
            apart = {name: abs(value - home[name]) for name, value in mode.coordinates.items()}
            most = sorted(apart, key=lambda name: -apart[name])[:SHOWN_JOINTS]
            differing = [name for name in most if apart[name] > LEAST_DIFFERENCE]
            values = ", ".join(f"{name} {round(mode.coordinates[name], 4) + 0.0:g}" for name in differing)
            shown = "in use" if mode is report.modes[0] else values
            _add_row(table, mode.name, ", ".join(mode.configurations), f"{mode.regularity:.3g}", shown)
        console.print(table)
    if report.legs:
        console.print(escape("legs: " + ", ".join(f"{name} (foot {foot})" for name, foot in report.legs.items())))
    _show_findings(console, report)


def _show_findings(console: Console, report: Inspection) -> None:
    from rich.markup import escape

    for each in report.findings:
        place = f"{Path(each.file).name}:{each.line}: " if each.line is not None else ""
        console.print(f"{_MARKS[each.severity]} {escape(f'[{each.code}] {place}{each.text}')}")
        if each.fix:
            console.print(escape(f"    fix: {each.fix}"))
    counts = [sum(each.severity == severity for each in report.findings) for severity in _MARKS]
    words = (f"{n} {word}{'s' * (n != 1)}" for n, word in zip(counts, _MARKS, strict=True))
    console.print(f"{report.name}: {', '.join(words)}", markup=False, highlight=False)


def _show_unreadable(report: Inspection, as_json: bool) -> None:
    """What there is to say of a file that is no mechanism to load."""
    if as_json:
        _print_json(report.to_dict())
    else:
        _show_findings(_console(), report)


def _limit_text(flags: Mapping[str, Any]) -> str:
    """The nearest of an actuator's limits, or the broken ones with their times."""
    names = {"effort": "effort", "speed": "speed", "curve": "torque-speed line"}
    broken = [
        f"BEYOND {name} by {-flags[f'{kind}_margin']:.1%} at {flags[f'{kind}_time']:.3f} s"
        for kind, name in names.items()
        if not flags[f"{kind}_margin"] >= 0.0
    ]
    if broken:
        return ", ".join(broken)
    least = min(names, key=lambda kind: flags[f"{kind}_margin"])
    return f"{flags[f'{least}_margin']:.1%} of {names[least]} left"


def _show_design(result: StudyResult) -> None:
    console, study = _console(), result.study
    for stage in result.stages:
        facts = stage.to_dict()
        title = f"{study.leg.name}, stage {stage.number + 1}: {', '.join(facts['ranges'])}"
        if facts["kind"] == "sweep":
            table = _table(title, *study.columns, *(["reason"] if facts["failed"] else []))
            for row in stage.rows:
                design = {**{n: study.leg.parameters[n].value for n in study.columns if n in study.leg.parameters}}
                values = {**design, **row.design, **row.values}
                cells = ["" if math.isnan(values[name]) else _number(values[name]) for name in study.columns]
                _add_row(table, *cells, *([row.reason] if facts["failed"] else []))
        else:
            table = _table(title, "", "unit", "median of valid", "accepted p10", "p50", "p90", "chosen")
            shown = {**facts["medians"], **facts["accepted_percentiles"]}
            for name in shown:
                percentiles = facts["accepted_percentiles"].get(name, {})
                cells = [facts["medians"].get(name), *(percentiles.get(f"p{p}") for p in (10, 50, 90))]
                chosen = None if facts["chosen"] is None else facts["chosen"][name]
                _add_row(table, name, study.columns[name], *(_number(cell) for cell in (*cells, chosen)))
        console.print(table)
        failed = ", ".join(f"{count} {name}" for name, count in facts["reasons"].items())
        _say(
            f"{facts['designs']} designs, {facts['accepted']} accepted, {facts['failed']} failed"
            + (f" ({failed})" if failed else "")
            + (f": {facts['why_none']}" if facts["why_none"] else "")
        )
        if facts["failed"] and facts["kind"] != "sweep" and not facts["why_none"]:
            _say(f"commonest reason: {facts['commonest_reason']}")
    if result.plan.resolution.samples:
        _say(result.plan.resolution.justification)


def _show_workspace(result: Workspace) -> None:
    console = _console()
    left_out = f", without {', '.join(result.ignored)}" if result.ignored else ""
    _say(f"{result.leg}: workspace of the foot, hip frame, route {result.route}{left_out}")
    volume, other, unit = result.volume, result.injectivity.cartesian, result.unit
    rows = [("volume", f"{volume.value:.5g} ± {volume.half_width:.2g}", unit, "")]
    if other is not None:
        rows.append(("volume by foot positions", f"{other.value:.5g} ± {other.half_width:.2g}", unit, ""))
    for k, axis in enumerate("xyz"):
        rows.append((axis, f"{result.lower[k]:.4f} ... {result.upper[k]:.4f}", "m", ""))
    settled = result.deviation_is_settled
    deviation = f"{result.deviation.value:.4g}" + (f" ± {result.deviation.half_width:.2g}" if settled else "")
    why = "" if settled else f"not settled: k is up to {result.poses.condition.max():.3g} in these samples"
    rows += [
        ("mean condition number", f"{result.mean.value:.4g} ± {result.mean.half_width:.2g}", "1", ""),
        ("its deviation", deviation, "1", why),
        ("least condition number", f"{result.dexterity.smallest:.4g}", "1", ""),
        ("smallest singular value", f"{result.dexterity.smallest_singular_value:.3g}", result.dexterity.unit, ""),
    ]
    step = result.step
    if step is not None:
        rows += [
            ("step length L", f"{step.length:.4f}", "m", f"{step.start_limit} ... {step.end_limit}"),
            ("longest chord", f"{step.longest:.4f}", "m", f"at z = {step.longest_height:.4f} m"),
            ("x-extent", f"{step.extent:.4f}", "m", ""),
            ("step height Z_f", f"{step.front:.4f}", "m", step.front_limit),
            ("step height Z_b", f"{step.back:.4f}", "m", step.back_limit),
        ]
    table = _table("", "quantity", "value", "unit", "limited by")
    for row in rows:
        _add_row(table, *row)
    console.print(table)
    _say(step.definition if step is not None else f"no step sizes: {result.step_reason}")
    if step is not None and step.note:
        _say(step.note)
    nearest, ended = result.active_shares(), result.border_shares()
    total = max(sum(ended.values()), 1)
    table = _table("Constraints that limit the leg", "constraint", "nearest in", "ends the boundary in")
    for name in dict.fromkeys([*nearest, *ended]):
        _add_row(table, name, f"{100 * nearest.get(name, 0.0):.1f} %", f"{100 * ended.get(name, 0) / total:.1f} %")
    console.print(table)
    _say(result.justification)


def _write_walk(path: Path, result: GaitStudy) -> None:
    from leg_dynamics.analysis.gait import picture
    from leg_dynamics.preview import Walking, write_html

    scene, table = picture(result), result.walk.table
    walking = Walking.of(scene.position, scene.yaw, scene.feet, result.stance, scene.centre)
    title = f"{scene.description.name}, {table.name} gait, {result.walk.period:g} s, duty {table.duty:.3g}"
    if result.limits:
        nearest = result.nearest_limits()[0]
        title += (
            f"; nearest limit {nearest.name}, {nearest.least:.4g} {nearest.unit} at {result.time[nearest.row]:.3g} s"
        )
    _write_atomically(
        path,
        lambda place: write_html(scene.description, result.time, scene.values, place, walking=walking, title=title),
    )


def _show_gait(result: Mapping[str, Any]) -> None:
    console = _console()
    forward, left = result["velocity [m/s]"]
    _say(
        f"{result['robot']}: {result['gait']} gait, period {result['period [s]']:g} s, duty {result['duty']:.4g}, "
        f"stride {result['stride [m]']:.4g} m, {forward:.4g} m/s ahead, {left:.4g} m/s left, "
        f"{result['turn [rad/s]']:.4g} rad/s, clearance {result['clearance [m]']:g} m, path law {result['path_law']}"
    )
    phases = ", ".join(f"{name} {phase:.4g}" for name, phase in result["phases"].items())
    _say(f"touch-down as a share of the period: {phases}")
    margin = result["stability_margin [m]"]
    least = "no foot on the ground" if margin["least"] is None else f"{round(margin['least'], 4) + 0.0:.4f}"
    _say(f"static stability margin: {least} m at {margin['at [s]']:.4g} s, up to {_number(margin['greatest'])} m")
    bound = result["margin_bound [m]"]
    if bound is not None:
        _say(f"no motion of the body has more than {bound:.4f} m with these feet, steps and times")
    for each in result["alternatives"]:
        margin = each["least_margin [m]"]
        _say(
            f"  {each['walk']}: " + ("a foot is out of reach" if margin is None else f"{round(margin, 4) + 0.0:.4f} m")
        )
    shifts = [f"{name} {low:.4g} ... {high:.4g} m" for name, (low, high) in result["sway [m]"].items() if high > low]
    if shifts:
        _say(f"body sways: {', '.join(shifts)}")
    if result["body_tilt [rad]"] != {"roll": [0.0, 0.0], "pitch": [0.0, 0.0]}:
        roll, pitch = (" ... ".join(f"{end:.4g}" for end in tilt) for tilt in result["body_tilt [rad]"].values())
        _say(f"body tilted: roll {roll} rad, pitch {pitch} rad")
    _say(f"{result['mass [kg]']:.4g} kg; centre of mass: {result['centre_of_mass']}")
    _say(f"foot forces: {result['load']}; largest {result['largest_foot_force [N]']:.1f} N")
    table = _table("Joints", "joint", "peak speed", "on the ground", "unit", "least distance to a limit", "")
    for leg in result["legs"]:
        for row in leg["joints"]:
            unit, note = row["unit"], "" if row["speed_within_limit"] else "TOO FAST"
            speed, ground = f"{row['speed']:+.4f}", f"{row['stance_speed']:+.4f}"
            _add_row(table, row["joint"], speed, ground, f"{unit}/s", f"{row['position_margin']:.4f} {unit}", note)
    console.print(table)
    table = _table("Actuators", "actuator", "peak effort", "on the ground", "unit", "peak power", "")
    for leg in result["legs"]:
        for row in leg["actuators"]:
            ends = " ... ".join(f"{end:+.4g}" for end in row["stance_effort"])
            note = "" if row["effort_within_limit"] else "TOO STRONG"
            _add_row(
                table, row["actuator"], f"{row['effort']:+.4g}", ends, row["unit"], f"{row['power [W]']:.1f} W", note
            )
    console.print(table)
    table = _table("Limits, the nearest of each leg", "leg", "limit", "least margin", "over half range", "at", "")
    rows = [row for leg in result["legs"] for row in leg["limits"][:_NEAREST_LIMITS]]
    rows += [row for leg in result["legs"] for row in leg["limits"][_NEAREST_LIMITS:] if not row["holds"]]
    for row in [*result["limits_between_legs"], *rows]:
        note = "" if row["holds"] else "BROKEN"
        least, share = f"{row['margin']:+.4f} {row['unit']}", f"{row['normalised']:+.3f}"
        _add_row(table, row["leg"], row["limit"], least, share, f"{row['at [s]']:.4g} s", note)
    console.print(table)
    _say(result["verdict"])
    if result["choices"]:
        table = _table("Why it walks like this", "parameter", "value", "why")
        for choice in result["choices"]:
            _add_row(table, *choice.values())
        console.print(table)


_NEAREST_LIMITS = 2


def _write_table(path: Path, leg: Leg, motion: Trajectory, efforts: np.ndarray) -> None:
    import numpy as np

    header, columns = ["t [s]"], [motion.time[:, None], motion.q, motion.v, motion.a, efforts]
    for symbol, suffix in (("q", ""), ("v", "/s"), ("a", "/s^2")):
        header += [f"{symbol}_{n} [{u}{suffix}]" for n, u in zip(leg.joint_names, leg.units.joints, strict=True)]
    # ASCII, because spreadsheets guess encodings.
    header += [f"tau_{n} [{u.replace('·', '*')}]" for n, u in zip(leg.actuator_names, leg.units.actuators, strict=True)]
    if leg.foot is not None:
        header += [f"foot_{axis} [m]" for axis in "xyz"]
        columns.append(leg.foot_position(motion.q))
    if motion.foot_force is not None:
        header += [f"foot_force_{axis} [N]" for axis in "xyz"]
        columns.append(motion.foot_force)
    # Adding zero turns -0 into 0.
    rows = np.hstack(columns) + 0.0

    def write(temporary: Path) -> None:
        with temporary.open("w", encoding="utf-8", newline="\n") as file:
            np.savetxt(file, rows, fmt="%.17g", delimiter=",", header=",".join(header), comments="")

    _write_atomically(path, write)


def _write_plot(
    path: Path, leg: Leg, motion: Trajectory, efforts: np.ndarray, route: str | None, other: np.ndarray | None
) -> None:
    from leg_dynamics.analysis.plots import torque_figure

    figure = torque_figure(
        motion,
        efforts,
        joint_names=leg.joint_names,
        units=leg.units.joints,
        actuator_names=leg.actuator_names,
        actuator_units=leg.units.actuators,
        route=leg.route,
        second_torque=other,
        second_route=route or "",
        title=f"{leg.description.name} along {motion.name}",
    )
    _write_atomically(path, lambda temporary: figure.savefig(temporary, format=path.suffix.lower().lstrip(".")))


def _check_writable(path: Path | None) -> Path | None:
    """Refuse an output path before the computation, not after it; return the file behind a symbolic link."""
    if path is None:
        return None
    try:
        return _output_target(path)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}", path=str(path)) from error


def _check_folder(folder: Path, files: Iterable[Path] = ()) -> None:
    """Refuse a folder that is not one and cannot be made, by what stands in its place, and files that cannot be."""
    for place in (*reversed(folder.parents), folder):
        if place.is_dir() or not os.path.lexists(place):
            continue
        if place.is_symlink():
            what = f"a link to {os.readlink(place)}, which is no folder"
        else:
            what = next((kind for test, kind in _KINDS if test(place.lstat().st_mode)), "a file")
        raise OutputError(f"{place} is {what}, but a folder is needed there; move it or name another", path=str(place))
    for file in files:
        # What is not there yet comes with its folder.
        if file.is_dir():
            raise OutputError(
                f"{file} is a folder, but a file is written there; move it or name another", path=str(file)
            )
        if os.path.lexists(file):
            _check_writable(file)


_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISLNK, "a loop of symbolic links"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISCHR, "a character device"),
    (stat.S_ISBLK, "a block device"),
    (stat.S_ISSOCK, "a socket"),
)


def _output_target(path: Path) -> Path:
    # Only a regular file may be replaced: anything else would be destroyed by it.
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    place = f"{path}" if target == path else f"{path} (a link to {target})"
    _check_folder(target.parent)
    if not target.parent.is_dir():
        raise OutputError(f"the folder {target.parent} of {target.name} does not exist; make it first", path=str(path))
    try:
        mode = target.lstat().st_mode
    except FileNotFoundError:
        return target
    if not stat.S_ISREG(mode):
        kind = next((kind for test, kind in _KINDS if test(mode)), "not a regular file")
        raise OutputError(f"{place} is {kind}; name a file", path=str(path))
    # The bits too, because root may write everything.
    if not (mode & 0o222 and os.access(target, os.W_OK)):
        raise OutputError(
            f"{place} is write-protected (mode {stat.S_IMODE(mode):o}); name another file or allow writing",
            path=str(path),
        )
    return target


def _write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file beside the target, then put it in place in one step."""
    target = _check_writable(path)
    assert target is not None
    temporary: Path | None = None
    try:
        descriptor, name = tempfile.mkstemp(dir=target.parent, prefix=f".{path.stem}.", suffix=path.suffix)
        os.close(descriptor)
        temporary = Path(name)
        write(temporary)
        # mkstemp's files are private; a result keeps the permissions of the old file, or gets those of any new one.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(stat.S_IMODE(target.stat().st_mode) if target.exists() else 0o666 & ~mask)
        temporary.replace(target)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}", path=str(path)) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def _print_json(value: Any) -> None:
    print(json.dumps(_plain(value), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    """Only what JSON knows: NaN and infinity become null."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def _number(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _table(title: str, *columns: str) -> Any:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(title) if title else None, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    for column in columns:
        # Cut off, long names that begin alike look the same.
        table.add_column(column, overflow="fold")
    return table


def _add_row(table: Any, *cells: str) -> None:
    """Add cells as plain text: a name from a file may look like markup."""
    from rich.text import Text

    table.add_row(*(Text(cell) for cell in cells))


def _console() -> Console:
    from rich.console import Console as RichConsole

    class Console(RichConsole):
        def on_broken_pipe(self) -> None:
            # The library's own way out is exit code 1: a failed check.
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    # A pipe has no width of its own; 80 would cut tables off.
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 160
    return Console(width=width, highlight=False, emoji=False)


def _error_console() -> Console:
    from rich.console import Console

    return Console(stderr=True, highlight=False, emoji=False)


def _progress() -> Any:
    from rich.progress import Progress

    return Progress(console=_error_console(), transient=True, disable=not sys.stderr.isatty())


def _chunks(count: int, what: str) -> Iterator[slice]:
    """Slices that cover `count` rows, with a progress bar while they are worked on."""
    with _progress() as progress:
        task = progress.add_task(what, total=count)
        for start in range(0, count, CHUNK):
            yield slice(start, start + CHUNK)
            progress.update(task, completed=min(count, start + CHUNK))


def _say(text: str) -> None:
    print(text)


def _say_written(path: Path) -> None:
    print(f"wrote {path}")


def _complain(text: str) -> None:
    # Where standard error fails there is nowhere left to say so; the exit code does.
    with contextlib.suppress(OSError):
        print(f"leg-dynamics: {' '.join(str(text).split())}", file=sys.stderr)


_ASCII = {"·": "*", "×": "x", "²": "^2", "°": " deg", "−": "-", "–": "-", "…": "...", "±": "+-", "≤": "<=", "≥": ">="}


def _ascii_substitute(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_ASCII.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


def main() -> None:
    """Run the command line; a terminal that lacks a letter gets an ASCII one in its place."""
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stdout is None:
        _complain("error: standard output is closed; redirect it to a file or to the null device")
        raise SystemExit(USAGE)
    codecs.register_error("leg_dynamics_ascii", _ascii_substitute)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="leg_dynamics_ascii")
    try:
        try:
            app(prog_name="leg-dynamics")
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        # Before a command has begun.
        raise SystemExit(INTERRUPTED) from None
    except OSError as error:
        # Outside of any command: help and version.
        _report_os_error(error)
        raise SystemExit(USAGE) from None


if __name__ == "__main__":
    main()
