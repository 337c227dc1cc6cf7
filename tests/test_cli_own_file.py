"""`leg-dynamics info` and `torque` on a file of one's own: verdicts, modes, idle motions, limits, exit codes."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import leg_dynamics as ld
from leg_dynamics import cli

from .five_bar import TOGGLE, five_bar
from .test_inspection import gantries


@pytest.fixture(autouse=True)
def _wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")


def run(*arguments):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


@pytest.fixture
def written(tmp_path):
    def write(**options):
        path = tmp_path / "five_bar.urdf"
        path.write_text(five_bar(**options), encoding="utf-8")
        return path

    return write


def motion_file(path, start, end, duration=1.0, count=51):
    """A straight motion as a table."""
    time = np.linspace(0.0, duration, count)
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    q = start + time[:, None] / duration * (end - start)
    columns = [time[:, None], q, np.broadcast_to((end - start) / duration, q.shape), np.zeros_like(q)]
    header = ["t [s]"] + [f"{symbol}_{name}" for symbol in "qva" for name in ("ma", "mb")]
    np.savetxt(path, np.hstack(columns), delimiter=",", header=",".join(header), comments="", fmt="%.17g")
    return path


def strict(text):
    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def test_info_shows_loops_modes_actuation_and_findings(written):
    done = run("info", written(motors=("mb",), foot=True))
    assert done.exit_code == 0
    for words in ("Loops and couplings", "Assembly modes at home: 2 found", "no actuator holds ma", "[under-actuated]"):
        assert words in done.stdout
    assert "0 errors, 1 warning" in done.stdout
    facts = strict(run("info", written(motors=("mb",), foot=True), "--json").stdout)
    assert facts["passed"] is True
    assert facts["actuation"]["idle"] == ["ma"]
    assert [mode["configurations"] for mode in facts["assembly_modes"]] == [["home"], []]
    assert facts["mobility"]["mobility"] == 2


def test_info_on_a_file_with_errors_exits_1(tmp_path):
    path = tmp_path / "broken.urdf"
    path.write_text(five_bar().replace('<parent link="a1"/>', '<parent link="nobody"/>').replace("<joint", "\n<joint"))
    done = run("info", path)
    assert done.exit_code == 1
    assert "nobody" in done.stdout
    assert "1 error" in done.stdout
    facts = strict(run("info", path, "--json").stdout)
    assert facts["passed"] is False
    assert facts["findings"][0]["line"] == 3
    path.write_text(five_bar().replace('xyz="-0.1 0 0"', 'xyz="-5 0 0"'))
    done = run("info", path, "--json")
    assert (done.exit_code, strict(done.stdout)["passed"]) == (1, False)


def test_info_of_what_is_not_there_is_json_all_the_same(tmp_path):
    for source, code in ((tmp_path / "none.urdf", "leg-not-found"), (tmp_path, "leg-not-found")):
        done = run("info", source, "--json")
        facts = strict(done.stdout)
        assert (done.exit_code, facts["passed"], facts["source"]) == (2, False, str(source))
        assert [(each["severity"], each["code"]) for each in facts["findings"]] == [("error", code)]
        assert facts["findings"][0]["text"] in done.stderr.replace("\n", "")
        assert run("info", source).stdout == ""
    for options, code in ((("--foot", "nowhere"), "missing-foot"), (("--set", "nothing=1"), "parameter")):
        done = run("info", "omnileg", *options, "--json")
        assert (done.exit_code, strict(done.stdout)["findings"][0]["code"]) == (2, code)


def test_info_says_how_many_more_there_are(tmp_path):
    path = tmp_path / "gantries.urdf"
    path.write_text(gantries(9), encoding="utf-8")
    done = run("info", path)
    assert done.stdout.count("[redundant-loop-rows] gantries.urdf:") == 6
    assert "[redundant-loop-rows] and 3 more, which --json lists" in done.stdout
    found = [each["code"] for each in strict(run("info", path, "--json").stdout)["findings"]]
    assert found.count("redundant-loop-rows") == 9


def test_torque_flags_what_the_actuators_cannot_do(written, tmp_path):
    table = motion_file(tmp_path / "motion.csv", [1.9, 1.1], [2.2, 0.9])
    leg = ld.load(five_bar(effort=1.0))
    with np.errstate(all="ignore"):
        rows = np.genfromtxt(table, delimiter=",", skip_header=1)
    tau = leg.torque(rows[:, 1:3], rows[:, 3:5], rows[:, 5:7])
    worst = int(np.argmax(np.abs(tau[:, 0])))
    result = strict(run("torque", written(effort=1.0), "--trajectory", table, "--json").stdout)
    limits = result["actuators"][0]["limits"]
    assert limits["effort_margin"] == pytest.approx(1.0 - abs(tau[worst, 0]))
    assert limits["effort_time"] == rows[worst, 0]
    assert result["feasible"] == bool((np.abs(tau) <= 1.0).all())
    assert not result["feasible"]
    assert "BEYOND effort by" in run("torque", written(effort=1.0), "--trajectory", table).stdout
    assert "left" in run("torque", written(effort=1e3), "--trajectory", table).stdout


@pytest.mark.parametrize(("lower", "upper"), [(-0.5, 40.0), (-40.0, 0.5), (0.0, 40.0), (-40.0, 0.0)])
def test_torque_and_info_know_both_ends_of_the_efforts(written, tmp_path, lower, upper):
    table = motion_file(tmp_path / "motion.csv", [1.9, 1.1], [2.2, 0.9])
    with np.errstate(all="ignore"):
        rows = np.genfromtxt(table, delimiter=",", skip_header=1)
    path = written(effort=upper, effort_lower=lower)
    tau = ld.load(path).torque(rows[:, 1:3], rows[:, 3:5], rows[:, 5:7])
    done, result = (run("torque", path, "--trajectory", table, *more) for more in ((), ("--json",)))
    result = strict(result.stdout)
    broken = (tau < lower) | (tau > upper)
    assert broken.any()
    assert not broken.all()
    for k, row in enumerate(result["actuators"]):
        limits = row["limits"]
        assert limits["feasible"] == (not broken[:, k].any())
        line = next(line for line in done.stdout.splitlines() if line.split()[:1] == [row["name"]])
        if limits["feasible"]:
            assert "left" in line
        elif 0.0 in (lower, upper):
            assert f"BEYOND effort, whose limit is 0, at {limits['effort_time']:.3f} s" in line
        else:
            assert f"BEYOND effort by {-limits['effort_margin']:.1%} at" in line
    told = strict(run("info", path, "--json").stdout)["joints"]
    assert [(row["effort_lower"], row["effort"]) for row in told] == [(lower, upper)] * 2
    assert f"{lower:g} ... {upper:g}" in run("info", path).stdout
    assert "..." not in "".join(
        line for line in run("info", written(effort=3.0)).stdout.splitlines() if line.split()[:2] == ["ma", "rad"]
    )


def test_torque_bounded_keeps_to_both_ends(written, tmp_path):
    table = motion_file(tmp_path / "motion.csv", [1.9, 1.1], [2.0, 1.0])
    motors, output = ("ma", "mb", "ka"), tmp_path / "out.csv"

    def efforts(path, *more):
        assert run("torque", path, "--trajectory", table, "--output", output, *more).exit_code == 0
        return np.genfromtxt(output, delimiter=",", skip_header=1)[:, 7:10]

    wish = efforts(written(motors=motors))
    lower, upper = 1.5 * wish.min(), 0.9 * wish.max()
    assert -lower > 2.0 * upper > 0.0
    path = written(motors=motors, effort=upper, effort_lower=lower)
    tau = efforts(path, "--bounded")
    assert (tau >= lower * (1.0 + 1e-9)).all()
    assert (tau <= upper * (1.0 + 1e-9)).all()
    assert strict(run("torque", path, "--trajectory", table, "--bounded", "--json").stdout)["feasible"]
    assert not strict(run("torque", path, "--trajectory", table, "--json").stdout)["feasible"]


def test_torque_of_idle_and_redundant_mechanisms(written, tmp_path):
    table = motion_file(tmp_path / "motion.csv", [1.9, 1.1], [2.2, 0.9])
    done = run("torque", written(motors=("mb",)), "--trajectory", table)
    assert done.exit_code == 2
    assert "no actuator holds ma" in done.stderr
    result = strict(run("torque", written(motors=("mb",)), "--trajectory", table, "--allow-idle", "--json").stdout)
    assert list(result["unbalanced"]) == ["ma"]
    assert result["unbalanced"]["ma"] > 0.0
    assert "left unbalanced" in run("torque", written(motors=("mb",)), "--trajectory", table, "--allow-idle").stdout
    done = run("torque", written(motors=("ma", "mb", "ka"), effort=0.1), "--trajectory", table, "--bounded")
    assert done.exit_code == 2
    assert "times the bounds are needed" in done.stderr
    assert "at t = " in done.stderr


def test_torque_in_another_mode_and_through_the_toggle_point(written, tmp_path):
    inside = motion_file(tmp_path / "inside.csv", [1.9, 1.1], [2.0, 1.0])
    path = written()
    name = ld.load(path).assembly_modes()[1].name
    own, other = (
        strict(run("torque", path, "--trajectory", inside, "--json", *options).stdout)
        for options in ((), ("--mode", name))
    )
    assert own["actuators"][0]["peak"] != pytest.approx(other["actuators"][0]["peak"], rel=1e-3)
    through = motion_file(tmp_path / "through.csv", [math.pi - 1.2, 1.2], [math.pi - 0.5, 0.5], duration=2.0)
    done = run("torque", path, "--trajectory", through)
    assert done.exit_code == 2
    assert "parallel singularity" in done.stderr
    time = float(done.stderr.split("at t = ")[1].split(" s")[0])
    assert 0.0 <= time - 2.0 * (1.2 - TOGGLE) / 0.7 <= 0.04 + 1e-9
    assert run("torque", path, "--trajectory", inside, "--mode", "home").exit_code == 0
    done = run("torque", path, "--trajectory", inside, "--mode", "mode_7")
    assert done.exit_code == 2
    assert f"{name};" in done.stderr
    assert "(home)" in done.stderr


def test_info_at_80_columns_shows_whole_names_and_what_is_in_use(written, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    path = written(foot=True)
    text = path.read_text()
    long = {name: f"front_left_upper_parallel_linkage_{name}_of_the_driven_side" for name in ("ma", "mb", "ka", "kb")}
    for name, longer in long.items():
        text = text.replace(f'"{name}"', f'"{longer}"')
    path.write_text(text)
    done = run("info", path)
    assert done.exit_code == 0
    assert "…" not in done.stdout
    lines = done.stdout.splitlines()
    title = next(number for number, line in enumerate(lines) if line.startswith("Assembly modes"))
    rows = [line for line in lines[title:] if line.lstrip().startswith("mode_")]
    assert rows[0].rstrip().endswith("in use")
    # Folded, not cut: the pieces below each other give the name.
    coordinates = next(number for number, line in enumerate(lines) if line.startswith("Independent coordinates"))
    ends = [line.split()[0] for line in lines[coordinates:title] if line.split()]
    assert all(any(name in "".join(ends[i : i + 6]) for i in range(len(ends))) for name in (long["ma"], long["mb"]))


def test_info_and_torque_of_a_file_in_which_nothing_is_driven(written, tmp_path):
    path = written(motors=())
    path.write_text(path.read_text().replace('name="five_bar"', 'name="five_bar" driven="none"'))
    done = run("info", path)
    assert done.exit_code == 0
    assert "under-actuated: no actuator holds ma, mb (2 motions, 0 actuators)" in done.stdout
    assert "no-transmissions" not in done.stdout
    table = motion_file(tmp_path / "motion.csv", [1.9, 1.1], [2.2, 0.9])
    done = run("torque", path, "--trajectory", table)
    assert done.exit_code == 2
    assert "no actuator holds ma, mb" in done.stderr
    result = strict(run("torque", path, "--trajectory", table, "--allow-idle", "--json").stdout)
    assert result["actuators"] == []
    assert set(result["unbalanced"]) == {"ma", "mb"}
