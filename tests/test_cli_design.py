"""The command `design`."""

from __future__ import annotations

import json

import pytest
import yaml
from typer.testing import CliRunner

import leg_dynamics as ld
from leg_dynamics.cli import app

LEG = "hexapod_leg_preliminary"
QUICK = ("--objective", "L", "--tolerance", "0.2", "--workers", "1")


def run(*arguments, code=0):
    result = CliRunner().invoke(app, ["design", *arguments])
    assert result.exit_code == code, result.output
    return result


def test_monte_carlo_in_json(tmp_path):
    folder, page = tmp_path / "study", tmp_path / "page.html"
    arguments = (LEG, "--vary", "a=0.1:0.35", "--samples", "12", "--filter", "L>=0.9", *QUICK, "--output", str(folder))
    found = json.loads(run(*arguments, "--json", "--html", str(page)).stdout)
    (stage,) = found["stages"]
    assert stage["designs"] == 12
    assert 0 < stage["accepted"] <= 12
    assert found["units"] == {"a": "m", "L": "m"}
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    parameters = yaml.safe_load((folder / "chosen.yaml").read_text(encoding="utf-8"))
    assert parameters == found["chosen_parameters"]
    assert ld.load(LEG, parameters=parameters).parameters["a"].value == stage["chosen"]["a"]
    table = (folder / "designs.csv").read_bytes()
    assert "already holds a study" in run(*arguments, code=2).output
    run(*arguments, "--resume")
    assert (folder / "designs.csv").read_bytes() == table
    assert "seed" in run(*arguments, "--resume", "--seed", "1", code=2).output


def test_sweep_as_a_table():
    text = run(LEG, "--sweep", "a=0.1:0.35:3", "--ignore", "clearance", *QUICK).output
    assert "3 designs, 3 accepted, 0 failed" in text
    assert "1.12" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "either --sweep, or --vary"),
        (("--vary", "a=0.1:0.3", "--sweep", "a=0.1:0.3:3"), "either --sweep, or --vary"),
        (("--vary", "a=0.3:0.1"), "smaller one first"),
        (("--vary", "aa=0.1:0.3"), "did you mean 'a'"),
        (("--vary", "a=0.1:0.3", "--filter", "L=1"), "no filter"),
        (("--vary", "a=0.1:0.3", "--objective", "kba"), "did you mean 'kbar'"),
        (("--vary", "a=0.1:0.3", "--objective", "peak_force"), "give a gait"),
        (("--vary", "a=0.1:0.3", "--support-force", "0,0,-400"), "give --gait"),
        (("--vary", "a=0.1:0.3", "--gait", "1,2", "--objective", "peak_speed"), "3 finite numbers"),
        (("--vary", "a=0.1:0.3", "--gait", "2,0.3,0.1"), "ask for one with --objective"),
        (("--vary", "a=0.1:0.3", "--gait", "2,0.3,0.1", "--objective", "L"), "ask for one with --objective"),
        (("--vary", "a=0.1:0.3", "--resume"), "--output"),
        (("--vary", "a=0.1:0.3", "--choose", "best"), "median"),
        (("--vary", "a=0.1:0.3", "--tolerance", "7"), "tolerance"),
    ],
)
def test_bad_usage(arguments, words):
    assert words in " ".join(run(LEG, *arguments, code=2).output.replace("│", " ").split())


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        (("--vary", "a=-0.3:-0.1"), "must be greater than 0 m"),
        (("--vary", "l1_min=1:2"), "must be at most l1_max = 0.9 m"),
        (("--sweep", "rod_2_diameter=0.06:0.08:3"), "at most sleeve_2_diameter - 2*sleeve_2_wall = 0.055 m"),
    ],
)
def test_nothing_possible_is_an_error(tmp_path, ranges, words):
    folder = tmp_path / "study"
    result = run(LEG, *ranges, "--samples", "3", *QUICK, "--output", str(folder), code=2)
    error = " ".join(result.stderr.split())
    assert "error: none of the 3 designs is possible, most often by ParameterError: " in error
    assert words in error
    assert "(3 of 3 designs)" in error
    assert "poses a design" not in result.output
    found = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert found["resolution"] == ""
    assert found["stages"][0]["reasons"] == {"ParameterError": 3}
    assert len((folder / "designs.csv").read_text(encoding="utf-8").splitlines()) == 4


def test_some_impossible_designs_are_none():
    text = run(LEG, "--sweep", "a=-0.2:0.2:3", *QUICK).output
    assert "3 designs, 1 accepted, 2 failed (2 ParameterError)" in text
    assert "poses a design" in text


def test_a_home_out_of_reach_is_blank_with_a_reason():
    """Strut 2 is 0.4657 m long at home: below that limit no step starts there, above it one does."""
    text = run(LEG, "--sweep", "l2_max=0.46:0.47:2", "--objective", "V", *QUICK).output
    assert "2 designs, 1 accepted, 1 failed (1 WorkspaceError)" in text
    words = " ".join(text.split())
    assert "the home position [0.0, 0.0, 0.7] m is not feasible ('l2 upper limit', margin -0.00572" in words
    assert "nan" not in text
