from __future__ import annotations

import json
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from leg_dynamics import cli, papers
from leg_dynamics.errors import ParameterError
from leg_dynamics.papers import omnileg
from leg_dynamics.papers.framework import Check, Context, PaperReport, Plot, Status, Verdict, reproduce
from leg_dynamics.papers.omnileg import scenarios


def _invoke(*arguments):
    result = CliRunner().invoke(cli.app, ["reproduce", *(str(argument) for argument in arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def _drawing():
    from leg_dynamics.papers import figures

    figure = figures.drawing(2.0, 2.0)
    figure.subplots().plot([0.0, 1.0])
    return figure


def _small_paper(error):
    report = PaperReport(
        "small",
        "A citation",
        "A small paper",
        (
            Verdict(
                "(1)", "equation", "a sum", Status.CORRECTED, "Off by 1.", printed="1 + 1 = 3", corrected="1 + 1 = 2"
            ),
        ),
        plots=(Plot("line", "A line", "Straight", _drawing),),
        checks=(Check("adds up", error, 1e-9),),
    )
    return SimpleNamespace(reproduce=lambda progress: progress("equation 1", 0.5) or report)


@pytest.fixture
def small(monkeypatch):
    def offer(error=0.0):
        monkeypatch.setattr(papers, "find", lambda name: _small_paper(error))

    offer()
    return offer


def test_corrected_equations_are_no_failure(small):
    result = _invoke("small")
    assert result.exit_code == 0
    assert "1 corrected" in result.stdout
    assert "Off by 1." in result.stdout


def test_json_is_pure_and_names_the_files(small, tmp_path):
    result = _invoke("small", "--json", "--output", tmp_path / "out")
    values = json.loads(result.stdout)
    assert values["counts"]["corrected"] == 1
    assert values["files"] == [str(tmp_path / "out" / name) for name in ("index.html", "report.json", "plots/line.png")]
    assert json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8")) == {
        key: value for key, value in values.items() if key != "files"
    }
    assert json.loads(_invoke("small", "--json").stdout)["files"] == []


def test_written_files_are_told(small, tmp_path):
    result = _invoke("small", "--output", tmp_path)
    assert f"wrote {tmp_path / 'index.html'}" in result.stdout
    assert (tmp_path / "index.html").stat().st_size > 1000


@pytest.mark.parametrize("error", [1.0, float("nan")])
def test_a_failing_check_exits_with_one(small, error):
    small(error)
    result = _invoke("small", "--json")
    assert result.exit_code == 1
    assert "adds up" in result.stderr
    assert json.loads(result.stdout)["passed"] is False


def test_unknown_paper_is_one_line():
    result = _invoke("nobody")
    assert result.exit_code == 2
    assert "known:" in result.stderr
    assert "omnileg" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_output_must_be_a_folder(small, tmp_path):
    (tmp_path / "taken").write_text("")
    result = _invoke("small", "--output", tmp_path / "taken")
    assert result.exit_code == 2
    assert "is a file" in result.stderr


def test_two_runs_give_the_same_numbers():
    first, second = (
        reproduce(Context("omnileg", samples=50), (scenarios,), paper="p", title="t").to_json() for _ in range(2)
    )
    assert first == second


@pytest.mark.parametrize(
    "options", [{"samples": 0}, {"samples": -1}, {"samples": 1.5}, {"samples": 1}, {"seed": -1}, {"seed": "a"}]
)
def test_unusable_options_are_named_errors(options):
    with pytest.raises(ParameterError, match=f"{next(iter(options))} must be a whole number, at least"):
        omnileg.reproduce(**options)


@pytest.mark.slow
def test_the_whole_paper(tmp_path):
    told = []
    report = omnileg.reproduce(lambda what, share: told.append(share), samples=300)
    assert report.passed, [check for check in report.checks if not check.passed]
    items = [verdict.item for verdict in report.verdicts]
    assert [item for item in items if item.startswith("(")] == [f"({n})" for n in range(1, 54)]
    assert {"Table 1", "Table 2"} | {f"Fig. {n}" for n in range(1, 20)} <= set(items)
    assert any(verdict.kind == "claim" for verdict in report.verdicts)
    # This project's own checks are no items of the paper.
    assert not any("multibody" in item for item in items)
    equations = [verdict for verdict in report.verdicts if verdict.kind == "equation"]
    assert all(verdict.figures for verdict in equations)
    corrected = {verdict.item for verdict in equations if verdict.status is Status.CORRECTED}
    wrong = (5, 9, 12, 13, 16, 26, 27, 38, 39, 44, 46, 49, 50)
    assert {f"({n})" for n in wrong} <= corrected
    for verdict in equations:
        if verdict.status is Status.CORRECTED:
            assert verdict.printed, verdict.item
            assert verdict.corrected, verdict.item
    assert told == sorted(told)
    again = omnileg.reproduce(samples=300)
    assert again.to_json() == report.to_json()
    page, *_ = report.write(tmp_path)
    text = page.read_text(encoding="utf-8")
    assert text.count("<tr id=") == len(report.verdicts)
    assert text.count("<img") == len(report.plots)
