"""Two runs are held against each other by ratios, and only what leaves the spread is called a change."""

from __future__ import annotations

import pytest

from benchmarks.comparison import ComparisonError, compare


def run_of(ratios, **more):
    results = [
        {"key": key, "title": key, "block": "single", "status": "ok", "ratios": list(values)}
        for key, values in ratios.items()
    ]
    return {"schema": "s", "leg": "omnileg", "yardstick": "pin_rnea", "results": results} | more


def test_slower_faster_and_within_the_spread():
    before = run_of({"a": (1.0, 1.1, 1.2), "b": (1.0, 1.1, 1.2), "c": (1.0, 1.1, 1.2)})
    after = run_of({"a": (2.0, 2.2, 2.4), "b": (0.5, 0.55, 0.6), "c": (1.1, 1.15, 1.6)})
    slower, faster, same = compare(after, before, "s")
    assert (slower.beyond, slower.factor, slower.words) == (True, pytest.approx(2.0), "100% slower")
    assert (faster.beyond, faster.factor, faster.words) == (True, pytest.approx(0.5), "50% faster")
    assert (same.beyond, same.words) == (False, "within the spread")


def test_a_run_agrees_with_itself():
    run = run_of({"a": (1.0, 2.0, 3.0), "b": (5.0,)})
    assert [(change.factor, change.beyond) for change in compare(run, run, "s")] == [(1.0, False), (1.0, False)]


def test_two_rounds_are_too_few_to_judge():
    (change,) = compare(run_of({"a": (9.0, 9.1)}), run_of({"a": (1.0, 1.1, 1.2)}), "s")
    assert (change.judged, change.beyond, change.words) == (False, False, "too few rounds")


@pytest.mark.parametrize(("count", "beyond"), [(7, False), (9, True)])
def test_an_outlier_counts_where_there_are_few_rounds(count, beyond):
    before = run_of({"a": [1.0] * (count - 1) + [3.0]})
    (change,) = compare(run_of({"a": [2.0] * count}), before, "s")
    assert change.beyond is beyond


def with_controls(run, moved):
    """Peers of which each is `moved` times as slow."""
    run["results"] += [
        {"key": f"p{k}", "title": "p", "block": "b", "status": "ok", "peer": True, "ratios": [m * x for x in (1, 2, 3)]}
        for k, m in enumerate(moved)
    ]
    return run


@pytest.mark.parametrize(("factor", "beyond"), [(1.5, False), (1 / 1.5, False), (2.5, True), (0.4, True)])
def test_what_controls_move_by_is_no_change(factor, beyond):
    before = with_controls(run_of({"a": (1.0, 1.01, 1.02)}), [1.0] * 10)
    after = with_controls(run_of({"a": [factor * x for x in (1.0, 1.01, 1.02)]}), [1.0] * 7 + [0.5] * 3)
    (own, *controls) = compare(after, before, "s")
    assert own.drift == pytest.approx(2.0)
    assert own.beyond is beyond
    assert own.words.endswith(("slower", "faster") if beyond else "drift")
    assert [(change.beyond, change.words) for change in controls] == [(False, "control")] * 10


def test_a_few_controls_say_nothing():
    before = with_controls(run_of({"a": (1.0, 1.01, 1.02)}), [1.0] * 4)
    after = with_controls(run_of({"a": (1.5, 1.51, 1.52)}), [9.0] * 4)
    assert compare(after, before, "s")[0].beyond


def test_only_what_both_have_is_compared():
    before = run_of({"pin_rnea": (1.0,), "old": (1.0,), "both": (1.0,), "untimed": ()})
    before["results"].append({"key": "wrong", "title": "", "block": "", "status": "wrong", "ratios": [1.0]})
    after = run_of({"pin_rnea": (1.0,), "new": (1.0,), "both": (1.0,), "untimed": (1.0,), "wrong": (1.0,)})
    assert [change.key for change in compare(after, before, "s")] == ["both"]


@pytest.mark.parametrize(
    "before",
    [
        [],
        None,
        {},
        run_of({}, schema="other"),
        run_of({}, leg="another"),
        {"schema": "s", "leg": "omnileg"},
        {"schema": "s", "leg": "omnileg", "yardstick": "y", "results": [{"key": "a"}]},
        {"schema": "s", "leg": "omnileg", "yardstick": "y", "results": 5},
    ],
)
def test_other_files_are_refused(before):
    with pytest.raises(ComparisonError):
        compare(run_of({}), before, "s")


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), 10**400, "1", None])
def test_ratios_that_cannot_be_are_named(value):
    run = run_of({"a": (1.0, 1.1, 1.2)})
    with pytest.raises(ComparisonError, match="damaged report"):
        compare(run, run_of({"a": (1.0, value, 1.2)}), "s")


def test_results_that_are_no_list_are_named():
    run = run_of({"a": (1.0, 1.1, 1.2)})
    with pytest.raises(ComparisonError, match="results is a list, got dict"):
        compare(run, run | {"results": {}}, "s")
