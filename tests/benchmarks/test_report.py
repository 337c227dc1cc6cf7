"""A whole run with next to no repetitions: the form of the report, and every real case through the gate."""

from __future__ import annotations

import json
import platform
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import __main__ as command
from benchmarks.cases import FORWARD, FULL, QUICK, SINGLE, YARDSTICK, Case, Work, all_cases, available_legs
from benchmarks.environment import environment
from benchmarks.report import SCHEMA
from benchmarks.suite import run

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def report(tiny):
    return run("omnileg", tiny)


def constant(key, value, expected=0.0, **more):
    work = Work(lambda: np.array([value]), [()], [np.array([expected])], period=1)
    return Case(key, SINGLE, f"the case {key}", lambda workload: work, **more)


def test_every_case_is_in_every_rendering(report, tiny):
    cases = all_cases(tiny)
    assert [result.key for result in report.results] == [case.key for case in cases]
    assert len({case.key for case in cases}) == len(cases)
    markdown, values = report.to_markdown(), json.loads(report.to_json())
    assert [result["key"] for result in values["results"]] == [case.key for case in cases]
    assert all(case.title in markdown for case in cases)


def test_the_project_s_own_cases_are_right(report):
    assert report.sound, report.failures()
    for result in report.results:
        if not result.peer or result.key.startswith("naive"):
            assert result.status == "ok", result.reason
            assert len(result.samples) == 3


def test_a_peer_without_time_says_why(report):
    for result in report.results:
        assert (result.status == "ok") == bool(result.samples)
        assert (result.status == "ok") == (result.reason is None)
        if result.status != "ok":
            assert result.title in "\n".join(report.failures())


def test_ratios_are_taken_within_a_repetition(report):
    (yardstick,) = (r for r in report.results if r.key == YARDSTICK)
    assert yardstick.ratio == (1.0, 1.0, 1.0, 1.0)
    for result in report.results:
        if result.samples:
            np.testing.assert_allclose(np.array(result.ratios) * yardstick.samples * result.rows, result.samples)


def test_json_schema(report):
    values = json.loads(report.to_json())
    assert set(values) == {"schema", "leg", "yardstick", "settings", "environment", "sound", "results"}
    assert (values["schema"], values["leg"], values["yardstick"]) == (SCHEMA, "omnileg", YARDSTICK)
    texts, numbers = {"key", "group", "title", "status"}, {"rows", "calls"}
    optional = {"goal", "error", "reason", "ns_per_row", "ratio", "goal_met"}
    spread = {"minimum", "lower_quartile", "median", "upper_quartile"}
    for result in values["results"]:
        assert set(result) == texts | numbers | optional | {"peer", "samples", "ratios"}
        assert all(isinstance(result[name], str) for name in texts)
        assert all(isinstance(result[name], int) for name in numbers)
        assert result["status"] in ("ok", "wrong", "cannot run")
        assert len(result["samples"]) == len(result["ratios"])
        if result["status"] == "ok":
            for name in ("ns_per_row", "ratio"):
                assert set(result[name]) == spread
                ordered = list(result[name].values())
                assert ordered == sorted(ordered)
    facts = values["environment"]
    assert {"date", "cpu", "cores", "python", "versions", "threads", "commit", "blas", "load_before"} <= set(facts)
    assert {"numpy", "pin", "scipy"} <= set(facts["versions"])
    assert {"OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"} <= set(facts["threads"])
    assert facts["commit"] is None or set(facts["commit"]) == {"name", "dirty"}


def test_no_host_and_no_path_in_the_output(report):
    for text in (report.to_json(), report.to_markdown()):
        assert str(ROOT) not in text
        assert str(Path.home()) + "/" not in text
        assert len(platform.node()) < 4 or platform.node() not in text


def test_environment_reports_threads_and_does_not_set_them(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert environment()["threads"] == {
        "OPENBLAS_NUM_THREADS": "3",
        "OMP_NUM_THREADS": None,
        "MKL_NUM_THREADS": environment()["threads"]["MKL_NUM_THREADS"],
    }


def test_wrong_and_impossible_cases_are_shown_and_not_timed(tiny):
    def absent(workload):
        raise ImportError("no module named 'peer'")

    cases = [
        constant(YARDSTICK, 0.0),
        constant("wrong", 1e-6, peer=True, goal=5.0),
        constant("poisoned", np.nan, peer=True),
        Case("absent", FORWARD, "the case absent", absent, peer=True),
    ]
    report = run("omnileg", tiny, cases)
    assert [(r.status, bool(r.samples)) for r in report.results] == [
        ("ok", True),
        ("wrong", False),
        ("wrong", False),
        ("cannot run", False),
    ]
    assert report.sound
    assert [r.key for r in report.ranked(SINGLE)] == [YARDSTICK, "wrong", "poisoned"]
    markdown = report.to_markdown()
    assert "| – | the case wrong | WRONG |" in markdown
    assert "1e-06" in markdown
    assert "the case absent: CANNOT RUN: ImportError: no module named 'peer'" in markdown
    assert "not measured" in report.goals()[0]
    json.loads(report.to_json())
    assert not run("omnileg", tiny, [replace(case, peer=False) for case in cases]).sound


def test_a_case_that_goes_wrong_while_timed_is_wrong(tiny):
    calls = []

    def drifting():
        calls.append(None)
        return np.array([1e-7 * (len(calls) > 1)])

    def breaking():
        calls.append(None)
        return np.array([0.0 if len(calls) == 1 else 1 // 0])

    work = Work(drifting, [()], [np.zeros(1)], period=1)
    drift = Case("drifting", SINGLE, "the case drifting", lambda workload: work)
    report = run("omnileg", tiny, [constant(YARDSTICK, 0.0), drift])
    assert (report.results[1].status, report.results[1].samples) == ("wrong", ())
    assert "while it was timed" in report.results[1].reason

    calls.clear()
    broken = Case("breaking", SINGLE, "the case breaking", lambda workload: replace(work, function=breaking))
    report = run("omnileg", tiny, [constant(YARDSTICK, 0.0), broken])
    assert (report.results[1].status, report.results[1].samples) == ("cannot run", ())
    assert "ZeroDivisionError" in report.results[1].reason


def test_without_a_yardstick_there_are_times_and_no_ratios(tiny):
    report = run("omnileg", tiny, [constant(YARDSTICK, 1.0), constant("alone", 0.0, goal=1.0)])
    alone = report.results[1]
    assert alone.samples
    assert alone.ratios == ()
    assert alone.goal_met is None
    assert not report.sound


@pytest.mark.parametrize(("goal", "verdict"), [(1e9, "met, "), (1e-9, "MISSED by ")])
def test_goals_are_judged_by_the_median_ratio(tiny, goal, verdict):
    report = run("omnileg", tiny, [constant(YARDSTICK, 0.0), constant("aimed", 0.0, goal=goal)])
    (line,) = report.goals()
    assert verdict in line
    assert report.results[1].goal_met is (goal > 1)
    assert report.sound


def test_issue_goals_are_set_on_the_mechanism():
    goals = {case.key: case.goal for case in all_cases(FULL) if case.goal is not None}
    assert goals == {"mechanism_closed": 16.0, "mechanism_trajectory": 35.0}


def test_batch_sizes():
    def rows(settings, prefix):
        return [case.rows for case in all_cases(settings) if case.key == f"{prefix}_batch_{case.rows}"]

    assert rows(FULL, "closed_form") == [1, 100, 10_000]
    assert rows(QUICK, "closed_form") == [1, 100, 1_000]
    assert rows(FULL, "pinocchio") == [1, 100, 2_000]


def test_command_writes_what_it_is_asked_for(monkeypatch, tmp_path, capsys, tiny):
    def few(leg, settings, progress):
        assert settings is QUICK
        return run(leg, tiny, [constant(YARDSTICK, 0.0)], progress)

    monkeypatch.setattr(command, "run", few)
    files = tmp_path / "out.json", tmp_path / "out.md"
    assert command.main(["--quick", "--json", str(files[0]), "--markdown", str(files[1])]) == 0
    assert json.loads(files[0].read_text(encoding="utf-8"))["sound"] is True
    assert files[1].read_text(encoding="utf-8").startswith("# omnileg")
    assert "the case pin_rnea" in capsys.readouterr().out


def test_command_fails_when_the_project_is_wrong(monkeypatch, tiny):
    monkeypatch.setattr(
        command, "run", lambda leg, settings, progress: run(leg, tiny, [constant(YARDSTICK, 1.0)], progress)
    )
    assert command.main([]) == 1


@pytest.mark.parametrize("arguments", [["--leg", "nobody"], ["--json", "no/such/folder/out.json"], ["--markdown", "."]])
def test_command_refuses_bad_usage_before_measuring(monkeypatch, arguments):
    monkeypatch.setattr(command, "run", lambda *_, **__: pytest.fail("measured"))
    with pytest.raises(SystemExit) as refusal:
        command.main(arguments)
    assert refusal.value.code == 2


def test_available_legs():
    assert "omnileg" in available_legs()
