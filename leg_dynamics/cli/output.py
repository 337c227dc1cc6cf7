"""What the commands say: lines, tables, JSON and numbers; progress and complaints on standard error."""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

CHUNK = 256
"""Rows computed between two steps of a progress bar."""
_ASCII = {"·": "*", "×": "x", "²": "^2", "°": " deg", "−": "-", "–": "-", "…": "...", "±": "+-", "≤": "<=", "≥": ">="}


# What a terminal obeys, or turns round: control characters but newline and tab, and those of writing direction.
_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")


def shown(text: str) -> str:
    """A text in which what a terminal would obey is escaped: names come from files."""
    return _OBEYED.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


def say(text: str) -> None:
    """Print one line on standard output."""
    print(shown(text))


def say_written(path: Path) -> None:
    """Say that a file is written."""
    print(shown(f"wrote {path}"))


def complain(text: str) -> None:
    """Print one line on standard error."""
    # Where standard error fails there is nowhere left to say so; the exit code does.
    with contextlib.suppress(OSError):
        print(f"leg-dynamics: {shown(' '.join(str(text).split()))}", file=sys.stderr)


def ascii_substitute(error: UnicodeError) -> tuple[str, int]:
    """Replace what a terminal's encoding lacks by ASCII: a handler of encoding errors."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_ASCII.get(letter, "?") for letter in error.object[error.start : error.end]), error.end


def print_json(value: Any) -> None:
    """Print a value as JSON on standard output."""
    print(json.dumps(_plain(value), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    """Only what JSON knows: NaN and infinity become null."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def format_number(value: Any) -> str:
    """A value as tables show it."""
    if value is None:
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def new_table(title: str, *columns: str) -> Any:
    """An empty table with these columns."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(shown(title)) if title else None, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD
    )
    for column in columns:
        # Cut off, long names that begin alike look the same.
        table.add_column(Text(shown(column)), overflow="fold")
    return table


def add_row(table: Any, *cells: str) -> None:
    """Add cells as plain text: a name from a file may look like markup."""
    from rich.text import Text

    table.add_row(*(Text(shown(cell)) for cell in cells))


def output_console() -> Console:
    """A console on standard output, which shows what it prints as `shown` does."""
    from rich.console import Console as RichConsole
    from rich.console import RenderHook
    from rich.segment import Segment

    class Escaped:
        def __init__(self, renderable: Any) -> None:
            self.renderable = renderable

        def __rich_console__(self, console: RichConsole, options: Any) -> Iterator[Segment]:
            for text, style, control in console.render(self.renderable, options):
                yield Segment(text if control else shown(text), style, control)

    class Escaping(RenderHook):
        def process_renderables(self, renderables: list[Any]) -> list[Any]:
            return [Escaped(each) for each in renderables]

    class Console(RichConsole):
        def on_broken_pipe(self) -> None:
            # The library's own way out is exit code 1: a failed check.
            raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))

    # A pipe has no width of its own; 80 would cut tables off.
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 160
    console = Console(width=width, highlight=False, emoji=False)
    console.push_render_hook(Escaping())
    return console


def error_console() -> Console:
    """A console on standard error, for what must not get among the results."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, emoji=False)


def progress_bar() -> Any:
    """A progress bar on standard error, where that is a terminal."""
    from rich.progress import Progress

    return Progress(console=error_console(), transient=True, disable=not sys.stderr.isatty())


@contextlib.contextmanager
def steps(what: str) -> Iterator[Callable[[str, float], None]]:
    """Show a progress bar; what is yielded takes the name of each step and the share of the work that is done."""
    with progress_bar() as progress:
        task = progress.add_task(what, total=1.0)

        def step(name: str, share: float) -> None:
            progress.update(task, description=name, completed=share)

        yield step


def chunks(count: int, what: str) -> Iterator[slice]:
    """Slices that cover `count` rows, with a progress bar while they are worked on."""
    with progress_bar() as progress:
        task = progress.add_task(what, total=count)
        for start in range(0, count, CHUNK):
            yield slice(start, start + CHUNK)
            progress.update(task, completed=min(count, start + CHUNK))
