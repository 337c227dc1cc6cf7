"""What a terminal would obey is escaped, wherever the command prints it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from leg_dynamics.cli.output import add_row, complain, new_table, output_console, print_json, say, shown

OBEYED = [
    *map(chr, range(9)),
    *map(chr, range(11, 32)),
    *map(chr, range(127, 160)),
    "\u202e",
    "\u2066",
    "\u200f",
    "\u2028",
]
RAW = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
EXAMPLE = Path(__file__).parents[1] / "examples" / "my_leg.urdf"


def test_controls_are_escaped_and_letters_are_not():
    for letter in OBEYED:
        assert re.fullmatch(r"a\\[xu]?[0-9a-z]+b", shown(f"a{letter}b")), letter
    text = "knie_α ü 膝\tN·m² ±5\nnext \\x1b"
    assert shown(text) == text


def test_every_way_of_printing_escapes(capsys):
    name = "\x9b31m\x1b[2J\u202eknee"
    say(name)
    complain(name)
    print_json({name: name})
    table = new_table(name, name)
    add_row(table, name)
    console = output_console()
    console.print(table)
    console.print(name, markup=False)
    printed = capsys.readouterr()
    for text in printed:
        assert not RAW.search(text), RAW.search(text)
    assert printed.out.count("\\x9b31m\\x1b[2J\\u202eknee") == 5
    assert "\\u009b31m" in printed.out  # JSON has its own way


def test_colours_still_reach_a_terminal(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.delenv("NO_COLOR", raising=False)
    output_console().print("[red]\x9bword[/red]")
    assert re.search(r"\x1b\[31m\\x9bword\x1b\[0m", capsys.readouterr().out)


@pytest.mark.parametrize("arguments", [("info",), ("info", "--json")])
def test_names_of_a_file_cannot_reach_the_terminal(tmp_path, arguments):
    path = tmp_path / "my\x9b2J_leg.urdf"
    path.write_text(EXAMPLE.read_text(encoding="utf-8").replace("crank_pin", "&#x9b;31m&#x202e;pin"), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "leg_dynamics", arguments[0], str(path), *arguments[1:]],
        capture_output=True,
        encoding="utf-8",
        timeout=120,
    )
    assert "pin" in done.stdout
    assert not RAW.search(done.stdout + done.stderr)
