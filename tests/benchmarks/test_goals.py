"""Goals are met and missed by the right share, and a goal without a measurement says why."""

from __future__ import annotations

import pytest

from benchmarks.cases import Settings
from benchmarks.goals import Goal, all_goals, judge, outcomes
from benchmarks.report import Figure, Report, Result

SETTINGS = Settings(batch_rows=(1, 10_000))


def result(key, samples, *, rows=1, ratios=(), limit_ratios=(), status="ok", reason=None, block="batch_10000"):
    return Result(
        key, block, key, rows, False, None, status, 0.0, reason, 1, tuple(samples), tuple(ratios), tuple(limit_ratios)
    )


def report(*results, figures=()):
    return Report("omnileg", SETTINGS, {}, (), tuple(results), tuple(figures))


def outcome(found, metric):
    (only,) = (o for o in outcomes(found) if o.metric == metric)
    return only


@pytest.mark.parametrize(
    ("relation", "samples", "verdict", "margin", "words"),
    [
        ("<=", (1.0, 2.0, 3.0), "met", 0.5, "met, 50% to spare"),
        ("<=", (4.0,), "met", 0.0, "met, 0% to spare"),
        ("<=", (5.0,), "missed", -0.25, "MISSED by 25%"),
        (">=", (5.0,), "met", 0.25, "met, 25% to spare"),
        (">=", (1.0, 3.0, 100.0), "missed", -0.25, "MISSED by 25%"),
    ],
)
def test_met_and_missed(relation, samples, verdict, margin, words):
    judged = judge(Goal("metric", relation, 4.0, "s", lambda _: samples), report())
    assert (judged.verdict, judged.margin, judged.words) == (verdict, pytest.approx(margin), words)
    assert judged.quartiles[0] <= judged.measured <= judged.quartiles[1]


def test_ratio_to_the_yardstick():
    found = outcome(report(result("closed_form_fixed", (1.0,), ratios=(0.2, 0.3, 0.5))), "leg.torque, one call")
    assert (found.measured, found.verdict) == (0.3, "met")
    assert found.margin == pytest.approx(0.25)


def test_ratio_to_the_limit_and_to_numpy():
    found = report(
        result("closed_form_batch_10000", (1e4, 2e4), rows=10_000, limit_ratios=(2.0, 2.0)),
        result("vectorised_batch_10000", (3e5, 6e5), rows=10_000),
    )
    limit, numpy = (o for o in outcomes(found) if o.metric == "leg.torque, N = 10,000")
    assert (limit.measured, limit.verdict) == (2.0, "missed")
    assert limit.margin == pytest.approx(-0.25)
    # Pair by pair: both rounds are 30 times faster, although medians of the whole are not needed for it.
    assert (numpy.measured, numpy.verdict) == (pytest.approx(30.0), "met")


def test_cases_of_different_blocks_meet_by_the_yardstick():
    found = report(
        result("naive_trajectory", (1.0,), ratios=(100.0,), block="single"),
        result("symbolic_batch_10000", (1e7,), rows=10_000, ratios=(0.4,)),
    )
    assert outcome(found, "symbolic route, N = 10,000").measured == pytest.approx(250.0)
    assert outcome(found, "symbolic route, N = 10,000, closure included").measured == pytest.approx(1.0)


def test_figures():
    figures = (
        Figure("import", "", "ms", (10.0, 20.0, 30.0), None),
        Figure("compile_cold_symbolic", "", "ms", (), "gone"),
    )
    found = report(figures=figures)
    assert outcome(found, "import leg_dynamics beyond NumPy").words == "met, 50% to spare"
    assert outcome(found, "symbolic: compile cold").words == "not measured: gone"


def test_what_is_wrong_meets_no_goal():
    wrong = result("closed_form_fixed", (1.0,), ratios=(0.1,), status="wrong", reason="differs by 1e-3")
    assert outcome(report(wrong), "leg.torque, one call").words == "not measured: wrong: differs by 1e-3"
    assert outcome(report(), "leg.torque, one call").words == "not measured: not part of this run"


def test_the_issue_s_table_is_complete():
    goals = [(goal.relation, goal.target, goal.unit) for goal in all_goals(report())]
    for wanted in [
        ("<=", 0.4, "× pin.rnea"),
        ("<=", 1.6, "× the limit"),
        (">=", 20.0, "× as fast as NumPy vectorised"),
        (">=", 1.6, "× as fast as one"),
        ("<=", 1.2, "µs a row"),
        (">=", 200.0, "× as fast as naive pinocchio"),
        ("<=", 1.5, "× pin.rnea"),
        ("<=", 0.25, "µs a row"),
        ("<=", 0.5, "µs a row"),
        ("<=", 0.15, "µs a row"),
        ("<=", 3.0, "µs"),
        ("<=", 4000.0, "ms"),
        ("<=", 20.0, "ms"),
        ("<=", 40.0, "ms"),
        ("<=", 500.0, "ms"),
        ("<=", 120.0, "bytes a row"),
    ]:
        assert wanted in goals


@pytest.mark.parametrize(("limit", "words"), [(55.0, "met, 25% to spare"), (99.0, "no second core was free")])
def test_two_threads_count_where_the_machine_has_a_second_core(limit, words):
    found = report(
        result("limit_threads_1", (100.0,) * 3, block="threads"),
        result("limit_threads_2", (limit,) * 3, block="threads"),
        result("closed_form_threads_1", (200.0,) * 3, block="threads"),
        result("closed_form_threads_2", (100.0,) * 3, block="threads"),
    )
    assert words in outcome(found, "two threads, N = 1,000,000").words
