"""The command `design`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from leg_dynamics.cli.files import check_folder, check_writable, write_atomically
from leg_dynamics.cli.loading import load_quick
from leg_dynamics.cli.options import (
    FootOption,
    JsonOption,
    LegName,
    RouteOption,
    SetOption,
    UrdfOption,
    read_numbers,
    read_path,
)
from leg_dynamics.cli.output import (
    add_row,
    format_number,
    new_table,
    output_console,
    print_json,
    say,
    say_written,
    steps,
)
from leg_dynamics.errors import StudyError

if TYPE_CHECKING:
    from leg_dynamics.analysis.design import StudyResult


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
        typer.Option(
            "--output", parser=read_path, metavar="DIR", help="Keep the study, its tables and its plots here."
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the study that --output holds.")] = False,
    route: RouteOption = None,
    set_: SetOption = None,
    foot: FootOption = None,
    urdf: UrdfOption = None,
    html: Annotated[
        Path | None, typer.Option("--html", parser=read_path, metavar="F.html", help="Write one self-contained page.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Study a leg's design: sweep parameters, or draw many designs, filter them, and choose one."""
    from leg_dynamics.analysis.design import Range, Stage, Study, gait_path, run
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
    check_writable(html)
    if output is not None:
        check_folder(output, files=(output / "summary.json", output / "designs.csv", output / "manifest.json"))
    stages = [Stage(tuple(map(Range.parse, sweep)))] if sweep else []
    for texts in ([list(vary)] if vary else []) + [text.split(",") for text in stage or ()]:
        stages.append(Stage(tuple(map(Range.parse, texts)), samples))
    model = load_quick(leg, route, set_, foot, urdf)
    path = None
    if gait is not None:
        period, stride, clearance = read_numbers("--gait", gait, 3)
        force = None if support_force is None else read_numbers("--support-force", support_force, 3)
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
    with steps("design") as step:
        result = run(study, output, progress=step, resume=resume, workers=workers, scheduler=scheduler)
    written = [] if output is None else list(result.write(output))
    if html is not None:
        page = render_page(result)
        write_atomically(html, lambda path: path.write_text(page, encoding="utf-8", newline="\n"))
        written.append(html)
    if as_json:
        print_json(result.to_dict() | {"files": [str(path) for path in written]})
    else:
        if result.any_possible:
            _show_design(result)
        for file in written:
            say_written(file)
    if not result.any_possible:
        raise StudyError(result.why_nothing())


def _show_design(result: StudyResult) -> None:
    console, study = output_console(), result.study
    for stage in result.stages:
        facts = stage.to_dict()
        title = f"{study.leg.name}, stage {stage.number + 1}: {', '.join(facts['ranges'])}"
        if facts["kind"] == "sweep":
            table = new_table(title, *study.columns, *(["reason"] if facts["failed"] else []))
            for row in stage.rows:
                design = {**{n: study.leg.parameters[n].value for n in study.columns if n in study.leg.parameters}}
                values = {**design, **row.design, **row.values}
                cells = ["" if math.isnan(values[name]) else format_number(values[name]) for name in study.columns]
                add_row(table, *cells, *([row.reason] if facts["failed"] else []))
        else:
            table = new_table(title, "", "unit", "median of valid", "accepted p10", "p50", "p90", "chosen")
            shown = {**facts["medians"], **facts["accepted_percentiles"]}
            for name in shown:
                percentiles = facts["accepted_percentiles"].get(name, {})
                cells = [facts["medians"].get(name), *(percentiles.get(f"p{p}") for p in (10, 50, 90))]
                chosen = None if facts["chosen"] is None else facts["chosen"][name]
                add_row(table, name, study.columns[name], *(format_number(cell) for cell in (*cells, chosen)))
        console.print(table)
        failed = ", ".join(f"{count} {name}" for name, count in facts["reasons"].items())
        say(
            f"{facts['designs']} designs, {facts['accepted']} accepted, {facts['failed']} failed"
            + (f" ({failed})" if failed else "")
            + (f": {facts['why_none']}" if facts["why_none"] else "")
        )
        if facts["failed"] and facts["kind"] != "sweep" and not facts["why_none"]:
            say(f"commonest reason: {facts['commonest_reason']}")
    if result.plan.resolution.samples:
        say(result.plan.resolution.justification)
