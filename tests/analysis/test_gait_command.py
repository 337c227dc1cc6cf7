"""The command ``leg-dynamics gait``."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from leg_dynamics import cli
from leg_dynamics.description import shipped_urdf

QUICK = ("--samples", "40")


def run(*arguments):
    result = CliRunner().invoke(cli.app, ["gait", *map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_help_documents_exit_codes():
    assert "Exit codes" in run("--help").stdout


def test_a_table_of_peaks():
    result = run("hexapod", "--stride", "0.4", "--period", "4")
    assert result.exit_code == 0
    assert "tripod gait" in result.stdout
    assert "front_left_l2" in result.stdout
    assert "+0.2549" in result.stdout


def test_everything_is_written(tmp_path):
    page, folder = tmp_path / "walk.html", tmp_path / "results"
    way = (
        "--velocity",
        "0.05,0.02",
        "--turn",
        "0.1",
        "--clearance",
        "0.05",
        "--body-height",
        "0.72",
        "--friction",
        "0.6",
    )
    result = run("hexapod", "--gait", "wave", *way, *QUICK, "--output", folder, "--html", page, "--json")
    assert result.exit_code == 0
    facts = json.loads(result.stdout)
    assert facts["gait"] == "wave"
    assert facts["velocity [m/s]"] == [0.05, 0.02]
    assert facts["body_height [m]"] == pytest.approx(0.72)
    assert facts["stability_margin [m]"]["least"] > 0.0
    assert len(facts["legs"]) == 6
    assert len(facts["files"]) == 9
    assert facts["limits_hold"] is True
    assert facts["nearest_limit"]["margin"] > 0.0
    assert (folder / "cycle.csv").is_file()
    assert "wave gait" in page.read_text(encoding="utf-8")


def test_parameters_go_to_the_robot_and_to_its_legs(tmp_path):
    light = json.loads(run("hexapod", *QUICK, "--json", "--set", "density=2700", "--set", "body_mass=30").stdout)
    steel = json.loads(run(shipped_urdf("hexapod"), "--leg", "hexapod_leg", *QUICK, "--json").stdout)
    assert light["mass [kg]"] < steel["mass [kg]"] - 30.0


def test_limits_and_a_tilted_body(tmp_path):
    page = tmp_path / "walk.html"
    way = ("--tilt", "0.02,0.05", "--tilt-sine", "0,0.02", "--clearance", "0.06", *QUICK)
    result = run("hexapod", *way, "--html", page)
    assert result.exit_code == 0
    assert "roll 0.02 ... 0.02 rad, pitch 0.03 ... 0.07 rad" in result.stdout
    assert "clearance front_right_sleeves_1_3" in result.stdout
    assert "BROKEN" not in result.stdout
    assert "nearest limit clearance front_right_sleeves_1_3" in page.read_text(encoding="utf-8")
    tight = ("--set", "universal_range=12")
    broken = json.loads(run("hexapod", *way, *tight, "--ignore-limits", "--json").stdout)
    assert broken["limits_hold"] is False
    assert broken["nearest_limit"]["unit"] == "rad"
    assert broken["nearest_limit"]["margin"] < 0.0
    assert "BROKEN" in run("hexapod", *way, *tight, "--ignore-limits").stdout
    refused = run("hexapod", *way, *tight)
    assert refused.exit_code == 2
    assert "breaks its limit" in " ".join(refused.stderr.split())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("hexapod", "--stride", "0.1", "--velocity", "0.1,0"), "goes with no --stride"),
        (("hexapod", "--velocity", "fast"), "2 finite numbers"),
        (("hexapod", "--gait", "gallop"), "gait must be"),
        (("hexapod", "--duty", "1"), "duty factor"),
        (("hexapod", "--period", "nan"), "period"),
        (("hexapod", "--law", "spline"), "path law"),
        (("hexapod", "--load", "heavy"), "load must be"),
        (("hexapod", "--samples", "1"), "samples"),
        (("hexapod", "--tilt", "0.1"), "2 finite numbers"),
        (("hexapod", "--tilt", "1.6,0"), "right angle"),
        (("hexapod", "--stride", "1.5"), "front_right"),
        (("hexapod", "--stride", "0.8", "--period", "2"), "support polygon"),
        (("hexapod", "--leg", "hexapod_leg_preliminary"), "neither 'hexapod_leg_preliminary'"),
        (("no_such_robot",), "no_such_robot"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(arguments, words):
    result = run(*arguments)
    assert result.exit_code == 2
    assert words in " ".join(result.stderr.replace("│", " ").split())
