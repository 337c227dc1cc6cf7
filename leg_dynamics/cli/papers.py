"""The commands `demo` and `reproduce`: what papers publish, computed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from leg_dynamics.cli.application import FAILED
from leg_dynamics.cli.files import check_folder, write_atomically
from leg_dynamics.cli.loading import load_leg
from leg_dynamics.cli.motion import (
    compare_efforts,
    poses_along,
    show_summary,
    summarize,
    torque_along,
    write_plot,
    write_table,
)
from leg_dynamics.cli.options import JsonOption, read_path
from leg_dynamics.cli.output import complain, output_console, print_json, say_written, steps
from leg_dynamics.errors import OutputError
from leg_dynamics.papers import names as paper_names


def demo(
    output: Annotated[
        Path, typer.Option("--output", parser=read_path, metavar="DIR", help="Folder for the results.")
    ] = Path("demo"),
    samples: Annotated[int, typer.Option("--samples", min=1, metavar="N", help="States of the cross-check.")] = 300,
) -> None:
    """Compute the OmniLeg's torques along Xu 2025 eq. (52) by two routes, cross-check them, draw and animate them."""
    from leg_dynamics.analysis.trajectories import omnileg_eq52
    from leg_dynamics.preview import write_html

    table, plot, page = output / "torque.csv", output / "torque.png", output / "preview.html"
    check_folder(output, files=(table, plot, page))
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"the folder {output} cannot be made: {error.strerror}; choose another --output") from None
    console = output_console()
    leg, other = load_leg("omnileg"), load_leg("omnileg", route="pinocchio")
    motion = omnileg_eq52(2.0, 1000.0).with_foot_force((0.0, -20.0, 20.0), 0.0, 1.0)
    efforts, second = torque_along(leg, motion), torque_along(other, motion)
    result = summarize(leg, motion, efforts)
    result["comparison"] = compare_efforts(leg, other, efforts, second)
    show_summary(result)
    from leg_dynamics.verification.crosscheck import crosscheck

    with steps("cross-check") as step:
        report = crosscheck("omnileg", samples=samples, seed=0, progress=step)
    console.print(report)

    write_table(table, leg, motion, efforts)
    write_plot(plot, leg, motion, efforts, other.route, second)
    animation = omnileg_eq52(2.0, 60.0)
    values, trace = poses_along(leg, animation)
    title = "OmniLeg along Xu 2025 eq. (52)"
    write_atomically(
        page, lambda path: write_html(leg.description, animation.time, values, path, foot_trace=trace, title=title)
    )
    for path in (table, plot, page):
        say_written(path)
    if not (report.passed and result["comparison"]["passed"]):
        complain("error: the routes disagree; see the tables above")
        raise typer.Exit(FAILED)


def reproduce_paper(
    paper: Annotated[
        str,
        typer.Argument(metavar="PAPER", help=f"The paper, by its leg or robot: {', '.join(paper_names())}."),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            parser=read_path,
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
        check_folder(output / "plots", files=fixed)
    with steps(paper) as step:
        report = papers.find(paper).reproduce(progress=step)
        if output is not None:
            # Again, with the plots' names: nothing is written where something cannot be.
            drawings = (output / "plots" / f"{drawing.name}.png" for drawing in report.plots)
            check_folder(output / "plots", files=(*fixed, *drawings))
        written = () if output is None else report.write(output, progress=step)
    if as_json:
        print_json(report.to_dict() | {"files": [str(path) for path in written]})
    else:
        output_console().print(report)
        for path in written:
            say_written(path)
    if not report.passed:
        failing = ", ".join(check.name for check in report.checks if check.state == "fails")
        complain(f"error: what must hold does not: {failing}")
        raise typer.Exit(FAILED)
