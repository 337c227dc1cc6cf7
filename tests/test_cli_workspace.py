"""`leg-dynamics workspace` and `preview --workspace`: what they print, write and refuse."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from leg_dynamics import cli

PLANAR = """<robot name="arm"><link name="base"/>
  <link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="tip"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="0.3" upper="2.5" effort="1" velocity="1"/></joint>
  <joint name="end" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="0.3 0 0"/></joint>
</robot>"""


def run(*arguments):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_json_and_files(tmp_path):
    page = tmp_path / "page.html"
    done = run(
        *("workspace", "hexapod_leg", "--json", "--tolerance", "0.01", "--ignore", "clearance"),
        *("--output", tmp_path / "out", "--html", page),
    )
    assert done.exit_code == 0
    result = json.loads(done.stdout)
    assert result["volume"]["value"] == pytest.approx(0.4142, rel=0.01)
    assert result["ignored"] == ["clearance"]
    assert result["step"]["length"] == pytest.approx(1.05, abs=0.005)
    assert result == json.loads((tmp_path / "out" / "summary.json").read_text()) | {"files": result["files"]}
    assert str(page) in result["files"]
    text = page.read_text(encoding="utf-8")
    assert "Content-Security-Policy" in text
    assert "<script" not in text


def test_tables_and_a_changed_parameter(monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    done = run("workspace", "hexapod_leg", "--tolerance", "0.05", "--set", "l2_max=0.55")
    assert done.exit_code == 0
    for words in ("volume by foot positions", "step height Z_b", "clearance sleeves_1_3", "scrambled Sobol", "L: "):
        assert words in done.stdout


def test_a_step_of_no_length_is_explained(tmp_path):
    """The OmniLeg's home is the straight leg, on the edge of its workspace; a bent one is inside."""
    page = tmp_path / "page.html"
    done = run("workspace", "omnileg", "--tolerance", "0.05", "--html", page)
    words = (
        "L is 0 because the home position (0, 0, 0.5) m is on the edge of the workspace, which ends there along x by"
    )
    assert words in done.stdout
    assert words in page.read_text(encoding="utf-8")
    inside = run("workspace", "omnileg", "--tolerance", "0.05", "--height", "0.42", "--json")
    step = json.loads(inside.stdout)["step"]
    assert step["length"] > 0.1
    assert step["note"] == ""


def test_a_file_of_ones_own(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(PLANAR)
    done = run("workspace", file, "--foot", "tip", "--json")
    assert done.exit_code == 0
    result = json.loads(done.stdout)
    assert (result["route"], result["volume"]["unit"], result["step"]) == ("symbolic", "m²", None)
    assert result["volume"]["value"] == pytest.approx(0.24 * (0.95533649 + 0.80114362), rel=0.002)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--tolerance", "0"), "between 0 and 1"),
        (("--tolerance", "nan"), "between 0 and 1"),
        (("--ignore", "clearence"), "did you mean 'clearance'"),
        (("--height", "inf"), "finite"),
        (("--set", "clearance_min=0.4"), "is empty"),
        (("--html", "/nowhere/page.html"), "does not exist"),
    ],
)
def test_errors_are_one_line(options, message):
    done = run("workspace", "hexapod_leg", *options)
    assert done.exit_code == 2
    assert done.stdout == ""
    (line,) = done.stderr.strip().splitlines()
    assert message in line


def test_the_preview_shows_it(tmp_path):
    page = tmp_path / "page.html"
    done = run("preview", "hexapod_leg", "--workspace", "--html", page)
    assert done.exit_code == 0
    assert "points: condition number" in page.read_text(encoding="utf-8")
