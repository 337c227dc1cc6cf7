"""The table of robots: complete, true about what loads, and timed only where the answers are right."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import leg_dynamics as ld
from benchmarks import robots
from benchmarks.cases import YARDSTICK
from benchmarks.gate import check
from benchmarks.report import Result
from benchmarks.robots import HEADER, NONE, ROUTES, YES, RobotSubject, Row, feet, main, page, reason, row
from leg_dynamics.description import read
from leg_dynamics.description.robot_data import PREFIX, robot_data_names
from leg_dynamics.errors import DescriptionError, LegDynamicsError, ParameterError

pytestmark = pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
DOCUMENT = Path(__file__).parents[2] / "docs" / "robots.md"


def table(text: str) -> list[list[str]]:
    """The cells of the table's rows, heading and rule left out."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines[2:]]


@pytest.fixture(scope="module")
def written() -> dict[str, list[str]]:
    text = DOCUMENT.read_text(encoding="utf-8")
    version = metadata.version("example-robot-data")
    if f"example-robot-data {version}" not in text:
        pytest.skip(f"docs/robots.md is about another release than the installed {version}")
    return {cells[0]: cells[1:] for cells in table(text)}


@pytest.fixture
def small(tiny):
    return replace(tiny, states=4)


def test_every_robot_is_in_the_table_once(written) -> None:
    names = [cells[0] for cells in table(DOCUMENT.read_text(encoding="utf-8"))]
    assert names == list(robot_data_names())
    assert all(len(cells) == len(HEADER) - 1 for cells in written.values())


def test_what_loads_has_times_and_what_does_not_has_a_reason(written) -> None:
    for name, (loads, freedoms, actuators, _, *times) in written.items():
        if loads == YES:
            assert int(freedoms) > 0 < int(actuators.split()[0]), name
            assert all(float(time.replace(",", "")) > 0.0 for time in times), name
        else:
            assert re.match(r"no: \w.{10,}$", loads), name
            assert {freedoms, actuators, *times} == {NONE}, name


def test_what_the_table_refuses_is_refused_with_that_sentence(written) -> None:
    refused = {name: cells[0] for name, cells in written.items() if cells[0] != YES}
    assert refused
    for name, loads in refused.items():
        with pytest.raises(LegDynamicsError) as caught:
            ld.load(PREFIX + name, route="pinocchio")
        assert loads == f"no: {reason(caught.value)}"


@pytest.mark.slow
@pytest.mark.parametrize("name", robot_data_names())
def test_what_the_table_says_loads_does(name: str, written) -> None:
    loads, freedoms, actuators, ends, *_ = written[name]
    if loads != YES:
        pytest.skip("refused, which another test is about")
    for route in ROUTES:
        leg = ld.load(PREFIX + name, route=route)
        assert (len(leg.joint_names), len(leg.actuator_names)) == (int(freedoms), int(actuators.split()[0]))
    assert feet(leg.description) == ends
    unique = RobotSubject(name).method == "torque"
    assert unique == (robots.GENERALIZED.strip() not in actuators)


def test_the_reason_is_the_first_sentence_without_place_and_folders() -> None:
    error = DescriptionError("it is odd: 1 | 2; try another", file="/some/folder/x.urdf", line=3)
    assert reason(error) == "it is odd: 1 \\| 2"
    assert reason(DescriptionError("there is no <link> here")) == "there is no `<link>` here"
    assert reason(DescriptionError("odd. Try another", file="x.urdf")) == "odd"
    assert reason(ParameterError("cannot read /a/b/c.urdf: gone")) == "cannot read c.urdf: gone"


def test_feet_are_named_counted_or_absent() -> None:
    assert feet(read(f"{PREFIX}bolt")) == "FL_FOOT, FR_FOOT"
    assert feet(read(f"{PREFIX}romeo_small")) == "l_sole, r_sole, one of 2 of torso"
    assert feet(read(f"{PREFIX}panda")) == NONE


@pytest.mark.parametrize(
    ("name", "method"), [("double_pendulum", "torque"), ("z1", "generalized_force"), ("finger_edu", "torque")]
)
def test_a_row_is_right_and_timed(small, name: str, method: str) -> None:
    measured = row(name, small)
    assert [result.status for result in measured.results] == ["ok"] * 3, [result.reason for result in measured.results]
    assert measured.sound
    assert measured.results[0].key.endswith(YARDSTICK)
    assert measured.generalized == (method != "torque")
    cells = measured.cells()
    assert len(cells) == len(HEADER)
    assert ("¹" in cells[3]) == measured.generalized
    assert all(float(cell.replace(",", "")) > 0.0 for cell in cells[5:])
    # Ratios are of the same run.
    yardstick, *routes = measured.results
    for result, cell in zip(routes, cells[6::2], strict=True):
        ratios = np.divide(result.samples, yardstick.samples)
        np.testing.assert_allclose(float(cell.replace(",", "")), np.median(ratios), rtol=0.01)


def test_the_yardstick_gets_the_friction_that_it_leaves_out(small) -> None:
    subject = RobotSubject("z1", small)
    work, v = subject.rnea(), subject.states[1]
    joints = [subject.pinocchio.description.joint(name) for name in subject.pinocchio.joint_names]
    for index in range(len(v)):
        expected = [j.damping * s + j.friction * np.sign(s) for j, s in zip(joints, v[index], strict=True)]
        np.testing.assert_allclose(work.answer(np.zeros(len(joints)), index), expected, rtol=1e-12)
        assert np.abs(expected).max() > 0.1
    assert check(work).status == "ok"


def test_a_refused_robot_has_a_row(small) -> None:
    assert row("iris_simple", small).cells() == (
        "iris_simple",
        "no: no joint is independent: every joint is fixed, nothing moves",
        *[NONE] * (len(HEADER) - 2),
    )


def outcome(status: str, *samples: float, key: str = "x_symbolic") -> Result:
    ratios = tuple(sample / 1000.0 for sample in samples)
    return Result(key, "x", "x", 1, False, None, status, None, None, 1, samples, ratios)


def test_a_wrong_answer_has_no_time() -> None:
    yardstick = outcome("ok", 1000.0, key=f"x_{YARDSTICK}")
    bad = Row("x", YES, 2, 2, NONE, False, (yardstick, outcome("wrong", 500.0), outcome("ok", 2500.0)))
    assert not bad.sound
    assert bad.cells() == ("x", YES, "2", "2", NONE, "1.00", "wrong", NONE, "2.50", "2.50")


def test_the_page_counts_what_loads() -> None:
    text = page([Row("a", YES), Row("b", "no: odd")])
    assert "loads 1 of the 2 URDF files" in text
    assert [cells[:2] for cells in table(text)] == [["a", YES], ["b", "no: odd"]]


def test_the_command_writes_the_page_and_says_what_is_wrong(monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.setattr(robots, "row", lambda name: Row(name, YES, 1, 1, NONE, False, (outcome("ok", 1.0),)))
    target = tmp_path / "robots.md"
    assert main(["--output", str(target), "--only", "solo12", "bolt"]) == 0
    assert [cells[0] for cells in table(target.read_text())] == ["solo12", "bolt"]
    monkeypatch.setattr(robots, "row", lambda name: Row(name, YES, 1, 1, NONE, False, (outcome("wrong", 1.0),)))
    assert main(["--only", "solo12"]) == 1
    printed = capsys.readouterr()
    assert printed.out.startswith("# Robots of example-robot-data\n")
    assert "x_symbolic: wrong" in printed.err


def test_an_unknown_robot_or_folder_is_bad_usage(tmp_path, capsys) -> None:
    for arguments in (["--only", "nobody"], ["--output", str(tmp_path / "no" / "file.md")]):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 2
    assert "error" in capsys.readouterr().err
