"""`leg-dynamics bench` finds the benchmarks beside a checkout's package, and says so where there are none."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from typer.testing import CliRunner

from benchmarks import __main__ as command
from leg_dynamics import cli


def test_arguments_go_through(monkeypatch):
    heard = []

    def main(arguments, program):
        heard.append((arguments, program))
        return 1

    monkeypatch.setattr(command, "main", main)
    result = CliRunner().invoke(cli.app, ["bench", "--quick", "--json", "out.json", "--compare", "old.json"])
    assert heard == [(["--quick", "--json", "out.json", "--compare", "old.json"], "leg-dynamics bench")]
    assert result.exit_code == 1


def test_help_is_that_of_the_benchmarks():
    result = CliRunner().invoke(cli.app, ["bench", "--help"])
    assert result.exit_code == 0
    for option in ("--quick", "--json [FILE]", "--html FILE", "--compare FILE"):
        assert option in result.output


def test_outside_of_a_checkout_one_line_says_where_they_are(monkeypatch, tmp_path):
    installed = tmp_path / "site-packages" / "leg_dynamics" / "cli" / "bench.py"
    monkeypatch.setattr("leg_dynamics.cli.bench.__file__", str(installed))
    result = CliRunner().invoke(cli.app, ["bench", "--quick"])
    assert result.exit_code == 2
    assert "the benchmarks are not part of the installed package" in result.output
    assert len(result.output.strip().splitlines()) == 1


def test_from_any_folder(tmp_path):
    code = (
        "from leg_dynamics.cli import main; import sys; sys.argv = ['leg-dynamics', 'bench', '--leg', 'nobody']; main()"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "invalid choice: 'nobody'" in done.stderr
