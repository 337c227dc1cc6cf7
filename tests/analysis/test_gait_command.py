"""The command ``leg-dynamics gait``."""

from __future__ import annotations

import csv
import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from leg_dynamics import cli
from leg_dynamics.description import shipped_urdf, shipped_xacro

QUICK = ("--samples", "40")


def run(*arguments):
    # Wide enough that no name in a table is broken.
    result = CliRunner().invoke(cli.app, ["gait", *map(str, arguments)], env={"COLUMNS": "160"})
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
    assert len(facts["files"]) == 13
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


def test_the_quadruped_creeps_by_itself(tmp_path):
    page = tmp_path / "walk.html"
    result = run("quadruped", *QUICK, "--html", page)
    assert result.exit_code == 0
    assert "III-I-IV-II gait, period 20 s, duty 0.8" in result.stdout
    assert "even motion of the body: 0.0015 m" in result.stdout
    assert "Why it walks like this" in result.stdout
    assert "BROKEN" not in result.stdout
    assert "III-I-IV-II gait" in page.read_text(encoding="utf-8")
    facts = json.loads(run("quadruped", *QUICK, "--json").stdout)
    assert facts["limits_hold"] is True
    assert facts["stability_margin [m]"]["least"] > 0.008
    assert [leg["name"] for leg in facts["legs"]] == ["I", "II", "III", "IV"]
    assert {each["parameter"] for each in facts["choices"]} >= {"gait", "period", "splay", "clearance"}


def test_the_quadruped_without_pauses_and_without_sway():
    facts = json.loads(run("quadruped", *QUICK, "--duty", "0.75", "--sway", "0,0", "--load", "equal", "--json").stdout)
    assert facts["stability_margin [m]"]["least"] == pytest.approx(0.0, abs=1e-8)
    assert facts["margin_bound [m]"] == pytest.approx(0.0, abs=1e-9)
    assert facts["sway [m]"]["left"] == [0.0, 0.0]
    leg = next(leg for leg in facts["legs"] if leg["name"] == "IV")
    assert (leg["lifts_off [s]"], leg["touches_down [s]"]) == pytest.approx((10.0, 15.0))


def test_legs_and_order_of_the_quadruped_by_hand():
    legs = ("--leg", "quadruped_leg", "--leg", "quadruped_leg_reversed")
    way = ("--splay", "0.4", "--reach", "0.12", "--sway", "0.01,0.01", "--harmonics", "2", "--set", "module_mass=2")
    result = run("quadruped", *QUICK, *legs, "--gait", "III,I,II,IV", "--group", "1", *way, "--load", "none", "--json")
    facts = json.loads(result.stdout)
    assert facts["gait"] == "III-I-II-IV"
    assert facts["mass [kg]"] == pytest.approx(20.2)
    reasons = {each["parameter"]: each["reason"] for each in facts["choices"]}
    assert reasons["splay"] == reasons["gait"] == reasons["legs that swing without a pause"] == "as asked for"
    assert reasons["period"].startswith("inferred")
    wave = json.loads(run("quadruped", *QUICK, "--gait", "wave", "--json").stdout)
    assert wave["stability_margin [m]"]["least"] > 0.008
    refused = run("quadruped", *QUICK, "--leg", "quadruped_leg")
    assert refused.exit_code == 2
    assert "neither 'quadruped_leg' nor a mirror image" in " ".join(refused.stderr.split())


def said(result):
    return " ".join(result.stderr.replace("│", " ").split())


@pytest.mark.parametrize("swing_range", [50, 59])
def test_a_leg_that_does_not_load_is_the_reason(swing_range):
    result = run("quadruped", *QUICK, "--set", f"swing_range={swing_range}")
    assert result.exit_code == 2
    text = said(result)
    assert f"do not load with swing_range={swing_range} (quadruped_leg: " in text
    assert f"joint 'theta3' of module 'm01' is at home at -60 deg, {60 - swing_range} deg beyond its limits" in text
    assert "quadruped_leg_reversed: " in text
    assert "hexapod_leg" not in text
    assert "no legs" not in text


def test_a_free_robot_has_all_its_reasons():
    text = said(run("quadruped", "--set", "frozen=0"))
    assert "do not load with frozen=0 (quadruped_leg: " in text
    assert "joint 'theta2' is from 'm02_lower_half'" in text
    assert "or use --route pinocchio" in text
    assert "route=" not in text
    assert "besides, the hip of 'I_' hangs on the moving joint 'm06_middle'" in text
    # And without the legs' formulas there is that one reason only.
    text = said(run("quadruped", "--set", "frozen=0", "--route", "pinocchio"))
    assert "the hip of 'I_' hangs on the moving joint 'm06_middle'" in text


def test_a_robot_without_such_legs_is_not_told_of_their_parameters():
    text = said(run("snake", "--set", "swing_range=59"))
    assert "no legs" in text
    assert "theta3" not in text


def test_a_copy_of_the_quadruped_walks_alike(tmp_path):
    copy = tmp_path / "other_name.yaml"
    shutil.copy(shipped_xacro("quadruped"), copy)
    own, other = (json.loads(run(name, *QUICK, "--json").stdout) for name in ("quadruped", copy))
    assert other.pop("robot") == "other_name"
    assert own.pop("robot") == "quadruped"
    assert other == own


def test_the_alternative_says_where_the_body_goes():
    way = ("--velocity", "0,0.003", "--load", "none", "--json")
    names = [each["walk"] for each in json.loads(run("quadruped", *QUICK, *way).stdout)["alternatives"]]
    assert "straight to the left, at a speed that changes (sway 0,0.02 m)" in names
    assert not any("ahead" in name for name in names)


def test_world_feet_are_rebuilt_from_the_columns(tmp_path):
    tilt = ("--tilt", "0.01,-0.02", "--tilt-sine", "0.01,0.01", "--body-height", "0.18")
    way = ("--turn", "0.01", *tilt, "--load", "none", "--ignore-limits")
    assert run("quadruped", *QUICK, *way, "--output", tmp_path).exit_code == 0
    with (tmp_path / "cycle.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))

    def table(*names):
        return np.array([[float(row[name]) for name in names] for row in rows])

    (sr, sp, sy), (cr, cp, cy) = (f(table("roll [rad]", "pitch [rad]", "yaw [rad]").T) for f in (np.sin, np.cos))
    body = table(*(f"body_world_{axis} [m]" for axis in "xyz"))
    for leg in ("I", "II", "III", "IV"):
        x, y, z = table(*(f"{leg}_foot_{axis} [m]" for axis in "xyz")).T
        y, z = cr * y - sr * z, sr * y + cr * z
        x, z = cp * x + sp * z, cp * z - sp * x
        x, y = cy * x - sy * y, sy * x + cy * y
        world = table(*(f"{leg}_foot_world_{axis} [m]" for axis in "xyz"))
        np.testing.assert_allclose(body + np.stack([x, y, z], axis=1), world, rtol=0.0, atol=1e-10)
    assert abs(table("yaw [rad]")[-1, 0] - 0.2) < 1e-10


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--clearance", "0.03"), "(I_theta3 is a joint of module 'I_m01')"),
        (("--velocity", "0.02,0", "--sway", "0,0"), "(the foot is on face U of module 'I_m01')"),
        (("--sway", "0.2,0.2"), "make the sway smaller (the foot is on face U of module 'I_m01')"),
    ],
)
def test_errors_of_a_robot_of_modules_name_module_and_face(arguments, words):
    text = said(run("quadruped", *QUICK, *arguments))
    assert text.endswith(words)
    assert text.count(" module ") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("quadruped", "--gait", "III,I"), "every leg once"),
        (("quadruped", "--gait", "III"), "order in which they swing"),
        (("quadruped", "--group", "3"), "groups of 3"),
        (("quadruped", "--sway", "0.02"), "2 finite numbers"),
        (("quadruped", "--sway=-0.1,0"), "sway ahead"),
        (("quadruped", "--sway", "0.2,0.2"), "make the sway smaller"),
        (("quadruped", "--splay", "1.6"), "right angle"),
        (("quadruped", "--clearance", "0.03"), "_theta3"),
        (("snake",), "no legs"),
        (("ring",), "no legs"),
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


def test_a_gait_beyond_the_drives_says_so_and_fails():
    """Speeds go with one over the period: just above and just below that at which the fastest strut has 1.2 m/s."""
    way = ("hexapod", "--stride", "0.5", *QUICK)
    hasty = run(*way, "--period", "0.2")
    assert hasty.exit_code == 1
    assert "the drives CANNOT do this gait: 18 joints are too fast, the worst is " in hasty.stdout
    assert "where 1.2 m/s are allowed; 6 actuators are too strong" in hasty.stdout
    assert "the drives cannot do this gait" in hasty.stderr
    assert run(*way, "--period", "0.2", "--ignore-limits").exit_code == 0
    facts = json.loads(run(*way, "--period", "4", "--json").stdout)
    fastest = max(abs(row["speed"]) for leg in facts["legs"] for row in leg["joints"])
    assert facts["drives_suffice"]
    for share, code in ((1.001, 0), (0.999, 1)):
        found = run(*way, "--period", 4.0 * fastest / 1.2 * share, "--load", "none", "--json")
        assert (found.exit_code, json.loads(found.stdout)["drives_suffice"]) == (code, code == 0)
