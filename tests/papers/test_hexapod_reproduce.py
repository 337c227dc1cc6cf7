"""The whole reproduction of the hexapod leg's paper."""

from __future__ import annotations

import functools
import json

import pytest

from leg_dynamics import papers
from leg_dynamics.errors import ParameterError
from leg_dynamics.papers import hexapod_leg
from leg_dynamics.papers.framework import Status


@functools.cache
def first_report():
    told = []
    return hexapod_leg.reproduce(lambda what, share: told.append(share)), told


def test_the_paper_is_found():
    assert "hexapod_leg" in papers.names()
    assert papers.find("hexapod_leg") is hexapod_leg


@pytest.mark.parametrize("options", [{"samples": 0}, {"samples": 1.5}, {"seed": -1}, {"seed": "a"}])
def test_unusable_options_are_named_errors(options):
    with pytest.raises(ParameterError, match=f"{next(iter(options))} must be a whole number, at least"):
        hexapod_leg.reproduce(**options)


@pytest.mark.slow
def test_two_runs_give_the_same_page_and_all_is_there(tmp_path):
    report, told = first_report()
    assert report.passed, [check for check in report.checks if not check.passed]
    assert told == sorted(told)
    items = [verdict.item for verdict in report.verdicts]
    assert [item for item in items if item.startswith("(")] == [f"({n})" for n in range(1, 34)]
    assert {"Table 1"} | {f"Fig. {n}" for n in range(1, 11)} <= set(items)
    known = set(items)
    for plot in report.plots:
        assert set(plot.items) <= known, plot.name
    placed = [name for section in report.sections for name in section.plots]
    assert sorted(placed) == sorted(plot.name for plot in report.plots)
    for verdict in report.verdicts:
        if verdict.status is Status.CORRECTED:
            assert verdict.printed, verdict.item
            assert verdict.corrected, verdict.item
    again = hexapod_leg.reproduce()
    assert again.to_json() == report.to_json()
    pages = [each.write(tmp_path / name)[0].read_text(encoding="utf-8") for each, name in ((report, "1"), (again, "2"))]
    assert pages[0] == pages[1]
    assert "null" not in report.to_json()
    json.loads(report.to_json())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_statuses_do_not_depend_on_the_seed(seed):
    first, other = first_report()[0], hexapod_leg.reproduce(seed=seed)
    assert other.passed
    assert {v.item: v.status for v in other.verdicts} == {v.item: v.status for v in first.verdicts}


@pytest.mark.slow
def test_the_page(tmp_path):
    report, _ = first_report()
    page, *_ = report.write(tmp_path / "one")
    text = page.read_text(encoding="utf-8")
    assert text.count("<tr id=") == len(report.verdicts)
    assert text.count("<img") == len(report.plots)
    assert "http" not in text.split("<main>")[1].split("<footer>")[0].replace("http://www.w3.org", "")
