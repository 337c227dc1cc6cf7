"""The command `bench`, whose options are those of the benchmarks."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import typer

from leg_dynamics.errors import UnsupportedError

OWN_OPTIONS = {"allow_extra_args": True, "ignore_unknown_options": True}
"""The settings of a command that hands its arguments on."""


def run_benchmarks(context: typer.Context) -> None:
    """Measure what a torque costs, beside other ways to it; needs a checkout. Options: see `bench --help`."""
    raise typer.Exit(_benchmarks()(context.args, program="leg-dynamics bench"))


def _benchmarks() -> Callable[..., int]:
    """The command of the benchmarks, which a checkout has beside this package and a wheel has not."""
    import importlib

    root = Path(__file__).resolve().parents[2]
    if not (root / "benchmarks" / "__main__.py").is_file():
        raise UnsupportedError(
            "the benchmarks are not part of the installed package: clone the repository and run `make bench`, or "
            "leg-dynamics bench, there"
        )
    if str(root) not in sys.path:
        sys.path.insert(0, str(root))
    main: Callable[..., int] = importlib.import_module("benchmarks.__main__").main
    return main
