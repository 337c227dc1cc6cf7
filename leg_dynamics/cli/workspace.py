"""The command `workspace`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from leg_dynamics.cli.files import check_folder, check_writable, write_atomically
from leg_dynamics.cli.loading import load_quick
from leg_dynamics.cli.options import FootOption, JsonOption, LegName, RouteOption, SetOption, UrdfOption, read_path
from leg_dynamics.cli.output import add_row, new_table, output_console, print_json, say, say_written, steps

if TYPE_CHECKING:
    from leg_dynamics.analysis.workspace import Workspace


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
        typer.Option(
            "--output", parser=read_path, metavar="DIR", help="Write summary, samples, boundary and plots here."
        ),
    ] = None,
    html: Annotated[
        Path | None, typer.Option("--html", parser=read_path, metavar="F.html", help="Write one self-contained page.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute the foot's workspace: volume, boundary, dexterity, step sizes, and the constraints that set them."""
    from leg_dynamics.analysis.workspace import workspace
    from leg_dynamics.analysis.workspace.page import render_page

    check_writable(html)
    if output is not None:
        check_folder(output, files=(output / "summary.json", output / "samples.csv", output / "boundary.csv"))
    model = load_quick(leg, route, set_, foot, urdf)
    with steps("workspace") as step:
        result = workspace(model, tolerance=tolerance, ignore=ignore or (), height=height, seed=seed, progress=step)
    written = [] if output is None else list(result.write(output))
    if html is not None:
        page = render_page(result)
        write_atomically(html, lambda path: path.write_text(page, encoding="utf-8", newline="\n"))
        written.append(html)
    if as_json:
        print_json(result.to_dict() | {"files": [str(path) for path in written]})
        return
    _show_workspace(result)
    for path in written:
        say_written(path)


def _show_workspace(result: Workspace) -> None:
    console = output_console()
    left_out = f", without {', '.join(result.ignored)}" if result.ignored else ""
    say(f"{result.leg}: workspace of the foot, hip frame, route {result.route}{left_out}")
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
    table = new_table("", "quantity", "value", "unit", "limited by")
    for row in rows:
        add_row(table, *row)
    console.print(table)
    say(step.definition if step is not None else f"no step sizes: {result.step_reason}")
    if step is not None and step.note:
        say(step.note)
    nearest, ended = result.active_shares(), result.border_shares()
    total = max(sum(ended.values()), 1)
    table = new_table("Constraints that limit the leg", "constraint", "nearest in", "ends the boundary in")
    for name in dict.fromkeys([*nearest, *ended]):
        add_row(table, name, f"{100 * nearest.get(name, 0.0):.1f} %", f"{100 * ended.get(name, 0) / total:.1f} %")
    console.print(table)
    say(result.justification)
