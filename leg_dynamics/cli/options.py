"""Options that several commands share, and how their texts are read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer


def read_path(text: str) -> Path:
    """The path of an option; pathlib would read an empty text as the current folder."""
    if not text:
        raise typer.BadParameter("the path is empty; name a file or a folder")
    return Path(text)


LegName = Annotated[str, typer.Argument(metavar="LEG", help="Shipped name, or path to .urdf / .urdf.xacro / .yaml.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Change a parameter of an xacro leg; repeatable."),
]
FootOption = Annotated[str | None, typer.Option("--foot", metavar="LINK", help="Foot link of a file of your own.")]
UrdfOption = Annotated[
    Path | None,
    typer.Option("--urdf", parser=read_path, metavar="FILE", help="Geometry and inertia for a named leg's formulas."),
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


def read_parameters(set_: Sequence[str] | None) -> dict[str, float] | None:
    """The parameters that --set gives, by name; None where it is absent."""
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
        (parameters[name],) = read_numbers("--set", value, 1)
    return parameters


def read_numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    """So many finite numbers, separated by commas."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        what = "one finite number" if count == 1 else f"{count} finite numbers separated by commas"
        raise typer.BadParameter(f"{text!r} is not {what}", param_hint=option)
    return numbers
