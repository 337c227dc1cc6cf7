"""Legs as files: list the shipped ones, check one, render one."""

from __future__ import annotations

import dataclasses
import math
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from leg_dynamics.cli.application import FAILED
from leg_dynamics.cli.files import write_atomically
from leg_dynamics.cli.loading import load_leg
from leg_dynamics.cli.options import (
    FootOption,
    JsonOption,
    LegName,
    RouteOption,
    SetOption,
    UrdfOption,
    read_parameters,
    read_path,
)
from leg_dynamics.cli.output import (
    add_row,
    complain,
    error_console,
    format_number,
    new_table,
    output_console,
    print_json,
    say_written,
)
from leg_dynamics.errors import LegDynamicsError, LegDynamicsWarning

if TYPE_CHECKING:
    from rich.console import Console

    from leg_dynamics.inspection import Inspection

SHOWN_MODES, SHOWN_JOINTS = 8, 6
# Notes of one kind; --json has all.
SHOWN_ALIKE = 6
LEAST_DIFFERENCE = 1e-6
_MARKS = {"error": "[red]error[/red]", "warning": "[yellow]warning[/yellow]", "note": "note"}


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
        print_json({"legs": rows})
        return
    table = new_table("Shipped legs", "name", "coordinates", "actuators", "links", "loops", "couplings", "trajectories")
    for row in rows:
        add_row(table, *(", ".join(value) if isinstance(value, list) else str(value) for value in row.values()))
    output_console().print(table)


def info_leg(
    leg: LegName,
    route: RouteOption = None,
    set_: SetOption = None,
    foot: FootOption = None,
    urdf: UrdfOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check a mechanism file: coordinates, limits, loops, mobility, actuation, assembly modes; exit 1 on errors."""
    try:
        report = _inspected(leg, set_, foot, urdf)
        if report.leg is None:
            _show_unreadable(report, as_json)
            raise typer.Exit(FAILED)
        with warnings.catch_warnings():
            # They are among the findings.
            warnings.simplefilter("ignore", LegDynamicsWarning)
            model = load_leg(leg, route, set_, foot, urdf)
    except LegDynamicsError as error:
        if as_json:
            from leg_dynamics.inspection import refused

            print_json(refused(leg if urdf is None else urdf, error).to_dict())
        raise
    mechanism = model.description
    mobility = report.mobility
    moving_mass = math.fsum(link.inertial.mass for link in mechanism.links if link.inertial is not None)
    joints: list[dict[str, Any]] = [
        {
            "name": name,
            "unit": unit,
            "lower": float(model.limits.lower[i]),
            "upper": float(model.limits.upper[i]),
            "velocity": float(model.limits.velocity[i]),
            "effort_lower": float(model.limits.effort_lower[i]),
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
        print_json(
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
    console = output_console()
    table = new_table(f"{mechanism.name}", "", "")
    table.show_header = False
    for key, value in facts.items():
        text = ", ".join(value) if isinstance(value, list) else format_number(value)
        add_row(table, key.replace("_", " "), text + (" kg" if key == "mass" else ""))
    console.print(table)
    table = new_table("Independent coordinates", "name", "unit", "lower", "upper", "velocity limit", "effort limit")
    for row in joints:
        shown = [format_number(row[key]) for key in ("name", "unit", "lower", "upper", "velocity")]
        add_row(table, *shown, _effort_range(row["effort_lower"], row["effort"]))
    console.print(table)
    table = new_table("Actuators", "name", "unit")
    for actuator in actuators:
        add_row(table, *actuator.values())
    console.print(table)
    if parameters:
        table = new_table("Parameters", "name", "value", "unit", "source", "description")
        for parameter in parameters:
            add_row(
                table, *(format_number(parameter[key]) for key in ("name", "value", "unit", "source", "description"))
            )
        console.print(table)
    if mobility is not None:
        console.print(mobility)
    _show_inspection(console, report)
    if not report.passed:
        raise typer.Exit(FAILED)


def _effort_range(lower: float, upper: float) -> str:
    """One number where efforts are limited alike both ways."""
    return format_number(upper) if lower == -upper else f"{format_number(lower)} ... {format_number(upper)}"


def _inspected(name: str, set_: Sequence[str] | None, foot: str | None, urdf: Path | None) -> Inspection:
    from leg_dynamics.inspection import inspect

    with error_console().status("looking at the mechanism"):
        return inspect(name if urdf is None else urdf, foot=foot, parameters=read_parameters(set_))


def _show_inspection(console: Console, report: Inspection) -> None:
    from rich.markup import escape

    if report.loops:
        table = new_table("Loops and couplings", "name", "type", "rows", "needed", "redundant", "with")
        for each in report.loops:
            counts = (str(count) for count in (each.rows, each.needed, each.redundant))
            shown = ", ".join(each.with_[:3]) + (" ..." if len(each.with_) > 3 else "")
            add_row(table, each.loop, each.type, *counts, shown)
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
        table = new_table(title, "name", "configurations", "smallest singular value", "joints that differ")
        home = report.modes[0].coordinates
        for mode in report.modes[:SHOWN_MODES]:
            apart = {name: abs(value - home[name]) for name, value in mode.coordinates.items()}
            most = sorted(apart, key=lambda name: -apart[name])[:SHOWN_JOINTS]
            differing = [name for name in most if apart[name] > LEAST_DIFFERENCE]
            values = ", ".join(f"{name} {round(mode.coordinates[name], 4) + 0.0:g}" for name in differing)
            shown = "in use" if mode is report.modes[0] else values
            add_row(table, mode.name, ", ".join(mode.configurations), f"{mode.regularity:.3g}", shown)
        console.print(table)
    if report.legs:
        console.print(escape("legs: " + ", ".join(f"{name} (foot {foot})" for name, foot in report.legs.items())))
    _show_findings(console, report)


def _show_findings(console: Console, report: Inspection) -> None:
    from rich.markup import escape

    count: dict[str, int] = {}
    for each in report.findings:
        count[each.code] = count.get(each.code, 0) + 1
        if each.severity == "note" and count[each.code] > SHOWN_ALIKE:
            continue
        place = f"{Path(each.file).name}:{each.line}: " if each.line is not None else ""
        console.print(f"{_MARKS[each.severity]} {escape(f'[{each.code}] {place}{each.text}')}")
        if each.fix:
            console.print(escape(f"    fix: {each.fix}"))
    notes = {each.code for each in report.findings if each.severity == "note"}
    for code, total in count.items():
        if code in notes and total > SHOWN_ALIKE:
            console.print(f"{_MARKS['note']} {escape(f'[{code}] and {total - SHOWN_ALIKE} more, which --json lists')}")
    counts = [sum(each.severity == severity for each in report.findings) for severity in _MARKS]
    words = (f"{n} {word}{'s' * (n != 1)}" for n, word in zip(counts, _MARKS, strict=True))
    console.print(f"{report.name}: {', '.join(words)}", markup=False, highlight=False)


def _show_unreadable(report: Inspection, as_json: bool) -> None:
    """What there is to say of a file that is no mechanism to load."""
    if as_json:
        print_json(report.to_dict())
    else:
        _show_findings(output_console(), report)


def render_leg(
    leg: LegName,
    check: Annotated[bool, typer.Option("--check", help="Fail where the shipped URDF+ is stale.")] = False,
    set_: SetOption = None,
    output: Annotated[
        Path | None, typer.Option("--output", parser=read_path, metavar="FILE", help="Write here, not to stdout.")
    ] = None,
) -> None:
    """Render a leg's xacro source, or an assembly of modules, to URDF+."""
    from leg_dynamics import description

    if check and (set_ or output):
        raise typer.BadParameter("--check compares the shipped files; it goes with neither --set nor --output")
    text = _rendered(leg, read_parameters(set_))
    if check:
        if leg not in description.shipped_names():
            raise typer.BadParameter(f"--check is for shipped legs: {', '.join(description.shipped_names())}")
        shipped = Path(description.shipped_urdf(leg))
        stored = shipped.read_text(encoding="utf-8") if shipped.is_file() else ""
        if stored != text:
            pairs = enumerate(zip(stored.splitlines(), text.splitlines(), strict=False), start=1)
            shorter = min(len(stored.splitlines()), len(text.splitlines())) + 1
            line = next((number for number, (old, new) in pairs if old != new), shorter)
            complain(f"{shipped}:{line}: stale: differs from its source; render it again")
            raise typer.Exit(FAILED)
        print(f"{leg}: up to date")
    elif output is None:
        sys.stdout.write(text)
    else:
        write_atomically(output, lambda path: path.write_text(text, encoding="utf-8", newline="\n"))
        say_written(output)


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
