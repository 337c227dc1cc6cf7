"""`python -m benchmarks`, also `leg-dynamics bench`: measure, print, write."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import NoReturn

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks.cases import FULL, QUICK, available_legs
from benchmarks.comparison import ComparisonError, compare
from benchmarks.report import SCHEMA
from benchmarks.suite import run

STANDARD_OUTPUT = "-"
EXIT_CODES = (
    "Exit codes: 0 measured, whether or not goals are met; 1 a case of the project itself is wrong or cannot run; "
    "2 bad usage, said in one line."
)


def _writable(text: str) -> Path:
    path = Path(text)
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise argparse.ArgumentTypeError(f"{text!r} is not a file in an existing folder")
    return path


def _writable_or_output(text: str) -> Path | str:
    return text if text == STANDARD_OUTPUT else _writable(text)


def _earlier(text: str) -> dict:
    """An earlier report, read before anything is measured."""
    try:
        report = json.loads(Path(text).read_text(encoding="utf-8"))
        compare({"leg": report["leg"], "results": [], "yardstick": ""}, report, SCHEMA)
    except OSError as problem:
        raise argparse.ArgumentTypeError(f"cannot read {text!r}: {problem.strerror}") from None
    except (ComparisonError, ValueError, KeyError, TypeError, AttributeError) as problem:
        raise argparse.ArgumentTypeError(f"{text!r} cannot be compared with: {problem}") from None
    return report


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Say what is wrong in one line, as the other commands do."""
        self.exit(2, f"{self.prog}: error: {message}\n")


def parser(program: str) -> argparse.ArgumentParser:
    """The command's arguments."""
    made = _Parser(
        prog=program,
        description="What a torque costs from Python: every route and its peers, accuracy first, then time as ratios.",
        epilog=EXIT_CODES,
    )
    made.add_argument("--leg", default="omnileg", choices=available_legs(), help="leg to measure (%(default)s)")
    made.add_argument("--quick", action="store_true", help="fewer rounds, smaller batches: one to two minutes")
    made.add_argument(
        "--json",
        nargs="?",
        const=STANDARD_OUTPUT,
        type=_writable_or_output,
        metavar="FILE",
        help="write every figure as JSON; without FILE to standard output, and nothing else there",
    )
    made.add_argument("--markdown", type=_writable, metavar="FILE", help="write the report as Markdown")
    made.add_argument("--html", type=_writable, metavar="FILE", help="write the report as one HTML page with charts")
    made.add_argument("--compare", type=_earlier, metavar="FILE", help="hold the ratios against an earlier --json FILE")
    return made


def main(arguments: list[str] | None = None, program: str = "python -m benchmarks") -> int:
    """Run the benchmarks from the command line."""
    options = parser(program).parse_args(arguments)
    columns = (TextColumn("{task.description:<50}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("loading", total=1.0)
        report = run(
            options.leg,
            QUICK if options.quick else FULL,
            progress=lambda what, share: bar.update(task, description=what[:50], completed=share),
        )
    if options.compare is not None:
        report = report.against(options.compare)
    printed = options.json == STANDARD_OUTPUT
    # In a file or a pipe the narrow default would cut the tables.
    console = Console(width=None if sys.stdout.isatty() else 200, stderr=printed)
    if printed:
        sys.stdout.write(report.to_json())
    else:
        console.print(report)
    wanted = ((options.json, report.to_json), (options.markdown, report.to_markdown), (options.html, report.to_html))
    for path, text in wanted:
        if isinstance(path, Path):
            path.write_text(text(), encoding="utf-8")
            console.print(f"wrote {path}")
    return 0 if report.sound else 1


if __name__ == "__main__":
    sys.exit(main())
