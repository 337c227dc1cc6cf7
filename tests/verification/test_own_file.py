"""Own formulas from a file, and the command that takes them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from leg_dynamics.cli import app
from leg_dynamics.errors import ParameterError
from leg_dynamics.verification.own_file import read_own

EXAMPLES = Path(__file__).parents[2] / "examples"
URDF = str(EXAMPLES / "my_leg.urdf")
SOURCE = """
import dataclasses
import neighbour
print("loud")

@dataclasses.dataclass
class Mine:
    g: float = 9.81
    def potential_energy(self, q):
        return neighbour.value

class Needy:
    def __init__(self, length):
        self.length = length

class Sick:
    def __init__(self):
        raise OSError("no table")

mine = Mine(1.0)

def potential_energy(q):
    return 0.0
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "neighbour.py").write_text("value = 3.0\n", encoding="utf-8")
    path = tmp_path / "mine.py"
    path.write_text(SOURCE, encoding="utf-8")
    return path


def test_a_class_an_object_and_a_module(file):
    path = list(sys.path)
    assert read_own(f"{file}:Mine").potential_energy(None) == 3.0
    assert read_own(f"{file}:mine").g == 1.0
    assert read_own(str(file)).potential_energy(None) == 0.0
    assert sys.path == path


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (":Mein", "has no Mein: it defines Mine, Needy, Sick"),
        (":Needy", "Needy() cannot be made: TypeError: "),
        (":Sick", "mine.py:18: Sick() cannot be made: OSError: no table"),
    ],
)
def test_names_of_no_use(file, name, said):
    with pytest.raises(ParameterError) as caught:
        read_own(f"{file}{name}")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = 1\nraise ValueError('no')\n", "bad.py:2: does not run: ValueError: no"),
        ("import sys\nsys.exit(3)\n", "bad.py:2: does not run: SystemExit: 3"),
        ("x = 1\ny = (\n", "does not run: SyntaxError: "),
    ],
)
def test_files_that_do_not_run(tmp_path, text, said):
    path = tmp_path / "bad.py"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError) as caught:
        read_own(f"{path}:Mine")
    assert said in str(caught.value)


@pytest.mark.parametrize("place", ["nowhere.py:Mine", "nowhere.py", "mine.txt:Mine", "Mine", "", ":Mine"])
def test_no_file(place, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.txt").write_text("", encoding="utf-8")
    with pytest.raises(ParameterError, match=r"give FILE\.py:NAME"):
        read_own(place)


def run(*arguments):
    return CliRunner().invoke(app, ["crosscheck", URDF, "--samples", "12", *map(str, arguments)])


def test_the_command(monkeypatch):
    monkeypatch.setenv("COLUMNS", "140")
    result = run("--own", EXAMPLES / "my_leg.py:MyLeg")
    assert result.exit_code == 0
    assert "MyLeg against" in result.stdout
    assert "DISAGREES" not in result.stdout


def test_the_command_fails_where_the_formulas_do(file):
    result = run("--own", f"{file}:Mine", "--json")
    assert result.exit_code == 1
    report = json.loads(result.stdout)  # what the file printed is elsewhere
    assert "loud" in result.stderr
    (check,) = report["checks"]
    assert (check["method"], check["own"], check["passed"]) == ("potential_energy", 3.0, False)


def test_the_command_fails_where_the_formulas_end_the_process(tmp_path):
    path = tmp_path / "ends.py"
    path.write_text("import sys\ndef potential_energy(q):\n    sys.exit(0)\n", encoding="utf-8")
    result = run("--own", path, "--json")
    assert result.exit_code == 1
    (check,) = json.loads(result.stdout)["checks"]
    assert check["detail"].startswith("raised SystemExit: 0 (ends.py:3), at 12 of 12 states")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--own", "nowhere.py:MyLeg"), "no Python file"),
        (("--own", f"{EXAMPLES / 'my_leg.py'}:MyLeg", "--tolerance", "0"), "tolerance must be a number"),
        (("--tolerance", "1e-6"), "--own"),
    ],
)
def test_bad_usage(arguments, said, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    result = run(*arguments)
    assert result.exit_code == 2
    assert said in result.stderr
    assert result.stdout == ""
