"""`python -m benchmarks`: measure, print, write. Exit code 1 where a case of the project is wrong, 2 for bad usage."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks.cases import FULL, QUICK, available_legs
from benchmarks.suite import run


def _writable(text: str) -> Path:
    path = Path(text)
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text!r} is not a file in an existing folder")
    return path


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmarks from the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="What a torque costs from Python.")
    parser.add_argument(
        "--leg", default="omnileg", choices=available_legs(), help="leg to measure (default: %(default)s)"
    )
    parser.add_argument("--quick", action="store_true", help="fewer repetitions, smaller batches: under half a minute")
    parser.add_argument("--json", type=_writable, metavar="FILE", help="write every figure as JSON")
    parser.add_argument("--markdown", type=_writable, metavar="FILE", help="write the report as Markdown")
    options = parser.parse_args(arguments)

    columns = (TextColumn("{task.description:<40}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("loading", total=1)
        report = run(
            options.leg,
            QUICK if options.quick else FULL,
            progress=lambda what, done, total: bar.update(task, description=what, completed=done, total=total),
        )
    # In a file or a pipe the narrow default would cut the tables.
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(report)
    for path, text in ((options.json, report.to_json), (options.markdown, report.to_markdown)):
        if path is not None:
            path.write_text(text(), encoding="utf-8")
            console.print(f"written: {path}")
    return 0 if report.sound else 1


if __name__ == "__main__":
    sys.exit(main())
