"""The command `crosscheck`."""

from __future__ import annotations

import contextlib
import sys
from typing import Annotated, Any, Protocol

import typer

from leg_dynamics.cli.application import FAILED
from leg_dynamics.cli.loading import load_options
from leg_dynamics.cli.options import FootOption, JsonOption, LegName, SetOption, TransmissionOption, UrdfOption
from leg_dynamics.cli.output import output_console, print_json, steps


class _Report(Protocol):
    """What the cross-check returns."""

    @property
    def passed(self) -> bool: ...

    def to_dict(self) -> dict[str, Any]: ...


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
    options = load_options(set_, foot, urdf, transmission)
    if own is not None:
        report = _own_crosscheck(own, leg, samples, seed, tolerance, **options)
    elif tolerance is not None:
        raise typer.BadParameter("it goes with formulas of your own, --own", param_hint="--tolerance")
    else:
        report = _crosscheck(leg, samples, seed, **options)
    if as_json:
        print_json(report.to_dict())
    else:
        output_console().print(report)
    if not report.passed:
        raise typer.Exit(FAILED)


def _crosscheck(name: Any, samples: int, seed: int, **options: Any) -> _Report:
    from leg_dynamics.verification.crosscheck import crosscheck

    with steps("cross-check") as step:
        return crosscheck(name, samples=samples, seed=seed, progress=step, **options)


def _own_crosscheck(own: str, name: str, samples: int, seed: int, tolerance: float | None, **options: Any) -> _Report:
    from leg_dynamics.verification.own_file import read_own

    # What the file prints must not get among the JSON.
    with contextlib.redirect_stdout(sys.stderr):
        formulas = read_own(own)
        return _crosscheck(formulas, samples, seed, against=name, tolerance=tolerance, **options)
