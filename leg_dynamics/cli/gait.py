"""The command `gait`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from leg_dynamics.cli.application import FAILED
from leg_dynamics.cli.files import check_folder, check_writable, write_atomically
from leg_dynamics.cli.loading import load_robot
from leg_dynamics.cli.options import JsonOption, LimitsOption, RouteOption, SetOption, read_numbers, read_path
from leg_dynamics.cli.output import (
    add_row,
    complain,
    error_console,
    format_number,
    new_table,
    output_console,
    print_json,
    say,
    say_written,
)

if TYPE_CHECKING:
    from leg_dynamics.analysis.gait import GaitStudy, Tilt

_NEAREST_LIMITS = 2


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
        typer.Option(
            "--output", parser=read_path, metavar="DIR", help="Write summary, table of the cycle and plots here."
        ),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option("--html", parser=read_path, metavar="F.html", help="Write a page that shows the robot walking."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Walk a robot through one cycle of a gait: stability, foot forces, actuator speeds and efforts."""
    from leg_dynamics.analysis import gait as gaits

    check_writable(html)
    if output is not None:
        check_folder(output, files=[output / name for name in gaits.FILES])
    if stride is not None and velocity is not None:
        raise typer.BadParameter("it goes with no --stride: the duty factor links both", param_hint="--velocity")
    model = load_robot(robot, leg, route, set_)
    with error_console().status("walking"):
        planned = gaits.plan_walk(
            model,
            gait=tuple(gait.split(",")) if gait is not None and "," in gait else gait,
            group=group,
            period=period,
            stride=stride,
            velocity=None if velocity is None else read_numbers("--velocity", velocity, 2),
            turn=turn,
            clearance=clearance,
            duty=duty,
            law=law,
            splay=splay,
            reach=reach,
            body_height=body_height,
            sway=None if sway is None else read_numbers("--sway", sway, 2),
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
        print_json(facts | {"files": [str(path) for path in written]})
    else:
        _show_gait(facts)
        for path in written:
            say_written(path)
    if not (facts["drives_suffice"] or ignore_limits):
        complain("error: the drives cannot do this gait; see its summary")
        raise typer.Exit(FAILED)


def _tilt(fixed: str | None, sine: str | None, cosine: str | None) -> Tilt | None:
    """The tilt of a walk's body from its options."""
    import numpy as np

    from leg_dynamics.analysis.gait import Tilt

    if fixed is None and sine is None and cosine is None:
        return None
    options = {"--tilt": fixed, "--tilt-sine": sine, "--tilt-cosine": cosine}
    (roll, pitch), *waves = (read_numbers(option, text or "0,0", 2) for option, text in options.items())
    return Tilt(roll, pitch, sine=np.array([waves[0]]), cosine=np.array([waves[1]]))


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
    write_atomically(
        path,
        lambda place: write_html(scene.description, result.time, scene.values, place, walking=walking, title=title),
    )


def _show_gait(result: Mapping[str, Any]) -> None:
    console = output_console()
    forward, left = result["velocity [m/s]"]
    say(
        f"{result['robot']}: {result['gait']} gait, period {result['period [s]']:g} s, duty {result['duty']:.4g}, "
        f"stride {result['stride [m]']:.4g} m, {forward:.4g} m/s ahead, {left:.4g} m/s left, "
        f"{result['turn [rad/s]']:.4g} rad/s, clearance {result['clearance [m]']:g} m, path law {result['path_law']}"
    )
    phases = ", ".join(f"{name} {phase:.4g}" for name, phase in result["phases"].items())
    say(f"touch-down as a share of the period: {phases}")
    margin = result["stability_margin [m]"]
    least = "no foot on the ground" if margin["least"] is None else f"{round(margin['least'], 4) + 0.0:.4f}"
    say(f"static stability margin: {least} m at {margin['at [s]']:.4g} s, up to {format_number(margin['greatest'])} m")
    bound = result["margin_bound [m]"]
    if bound is not None:
        say(f"no motion of the body has more than {bound:.4f} m with these feet, steps and times")
    for each in result["alternatives"]:
        margin = each["least_margin [m]"]
        say(f"  {each['walk']}: " + ("a foot is out of reach" if margin is None else f"{round(margin, 4) + 0.0:.4f} m"))
    shifts = [f"{name} {low:.4g} ... {high:.4g} m" for name, (low, high) in result["sway [m]"].items() if high > low]
    if shifts:
        say(f"body sways: {', '.join(shifts)}")
    if result["body_tilt [rad]"] != {"roll": [0.0, 0.0], "pitch": [0.0, 0.0]}:
        roll, pitch = (" ... ".join(f"{end:.4g}" for end in tilt) for tilt in result["body_tilt [rad]"].values())
        say(f"body tilted: roll {roll} rad, pitch {pitch} rad")
    say(f"{result['mass [kg]']:.4g} kg; centre of mass: {result['centre_of_mass']}")
    say(f"foot forces: {result['load']}; largest {result['largest_foot_force [N]']:.1f} N")
    table = new_table("Joints", "joint", "peak speed", "on the ground", "unit", "least distance to a limit", "")
    for leg in result["legs"]:
        for row in leg["joints"]:
            unit, note = row["unit"], "" if row["speed_within_limit"] else "TOO FAST"
            speed, ground = f"{row['speed']:+.4f}", f"{row['stance_speed']:+.4f}"
            add_row(table, row["joint"], speed, ground, f"{unit}/s", f"{row['position_margin']:.4f} {unit}", note)
    console.print(table)
    table = new_table("Actuators", "actuator", "peak effort", "on the ground", "unit", "peak power", "")
    for leg in result["legs"]:
        for row in leg["actuators"]:
            ends = " ... ".join(f"{end:+.4g}" for end in row["stance_effort"])
            note = "" if row["effort_within_limit"] else "TOO STRONG"
            add_row(
                table, row["actuator"], f"{row['effort']:+.4g}", ends, row["unit"], f"{row['power [W]']:.1f} W", note
            )
    console.print(table)
    table = new_table("Limits, the nearest of each leg", "leg", "limit", "least margin", "over half range", "at", "")
    rows = [row for leg in result["legs"] for row in leg["limits"][:_NEAREST_LIMITS]]
    rows += [row for leg in result["legs"] for row in leg["limits"][_NEAREST_LIMITS:] if not row["holds"]]
    for row in [*result["limits_between_legs"], *rows]:
        note = "" if row["holds"] else "BROKEN"
        least, share = f"{row['margin']:+.4f} {row['unit']}", f"{row['normalised']:+.3f}"
        add_row(table, row["leg"], row["limit"], least, share, f"{row['at [s]']:.4g} s", note)
    console.print(table)
    say(result["verdict"])
    if result["choices"]:
        table = new_table("Why it walks like this", "parameter", "value", "why")
        for choice in result["choices"]:
            add_row(table, *choice.values())
        console.print(table)
