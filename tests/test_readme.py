"""The README's examples run and print what their comments promise."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


EXAMPLES = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


def test_the_examples_print_what_their_comments_say(monkeypatch) -> None:
    monkeypatch.chdir(README.parent)
    # Each goes on from the one before.
    code = "".join(EXAMPLES)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(README), "exec"), {"__name__": "example"})
    promised = [re.split(r"# (?:.*?: )?(?=[\[{T])", line)[1] for line in code.splitlines() if line.startswith("print")]
    assert printed.getvalue().splitlines() == promised


def test_the_examples_have_ten_lines() -> None:
    assert len(EXAMPLES) == 5
    for code in EXAMPLES:
        assert len([line for line in code.splitlines() if line.strip()]) <= 10


def test_the_picture_exists() -> None:
    (picture,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", README.read_text(encoding="utf-8"))
    assert (README.parent / picture).is_file()
