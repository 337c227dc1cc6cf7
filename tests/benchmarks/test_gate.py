"""The gate lets right answers through and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.cases import NotAvailableError, Work
from benchmarks.gate import BLOCK, TOLERANCE, check, explain, judge, refused, relative_error

EXPECTED = np.array([[1.0, -2.0, 3.0], [0.0, 0.0, 1e-3]])
ROWS = [(row,) for row in EXPECTED]


def work(function, arguments=ROWS, expected=EXPECTED, **more):
    return Work(function, arguments, expected, period=1, **more)


def test_right_answers_pass():
    verdict = check(work(lambda row: row))
    assert (verdict.status, verdict.error, verdict.reason) == ("ok", 0.0, None)


@pytest.mark.parametrize(("factor", "status"), [(0.9, "ok"), (1.1, "wrong")])
def test_both_sides_of_the_tolerance(factor, status):
    offset = np.array([0.0, factor * TOLERANCE * 4.0, 0.0])  # 1 + magnitude of the first row is 4
    verdict = check(work(lambda row: row + offset * (row[0] == 1.0)))
    assert verdict.status == status
    assert verdict.error == pytest.approx(factor * TOLERANCE, rel=1e-6)


def test_the_worst_state_is_named():
    verdict = check(work(lambda row: row + (row[0] == 0.0)))
    assert verdict.status == "wrong"
    assert "at state 1 of 2" in verdict.reason


@pytest.mark.parametrize("answer", [np.full(3, np.nan), np.full(3, np.inf), np.zeros(2), np.zeros((1, 3)), 0.0])
def test_what_is_no_answer_is_wrong(answer):
    verdict = check(work(lambda row: answer))
    assert (verdict.status, verdict.error) == ("wrong", None)


def test_one_bad_row_of_a_batch_is_enough():
    wrong = EXPECTED.copy()
    wrong[1, 2] += 1e-6
    assert check(work(lambda: EXPECTED, [()], [EXPECTED])).status == "ok"
    assert check(work(lambda: wrong, [()], [EXPECTED])).status == "wrong"


def test_answers_are_translated_before_they_are_judged():
    assert check(work(lambda row: 2.0 * row, answer=lambda result, index: result / 2.0)).status == "ok"


def test_an_exception_is_a_reason():
    def fail(row):
        raise KeyError("no such frame")

    verdict = check(work(fail))
    assert verdict.status == "cannot run"
    assert "KeyError" in verdict.reason
    assert "no such frame" in verdict.reason


def test_error_is_relative_to_one_plus_magnitude():
    assert relative_error([99.0 + 1e-3], np.array([99.0])) == pytest.approx(1e-5)
    assert judge(0.0, "").status == "ok"


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("cannot import name 'x' (/some/where else/room/file.py)", "cannot import name 'x' (file.py)"),
        (r"C:\Users\me\file.py is gone", "file.py is gone"),
        ("3 N/m at 1/2 rad", "3 N/m at 1/2 rad"),
    ],
)
def test_reasons_carry_no_folders(text, kept):
    assert explain(ValueError(text)) == f"ValueError: {kept}"


def test_reasons_are_one_short_line():
    assert "\n" not in explain(TypeError("first\nsecond\nthird\nfourth\n" * 100))
    assert len(explain(TypeError("long " * 1000))) <= 240
    assert explain(TypeError()) == "TypeError"


def test_what_is_not_there_is_not_available():
    def absent(row):
        raise NotAvailableError("no GCC was found")

    assert check(work(absent)).status == "not available"
    assert refused(NotAvailableError("no GCC was found")).reason == "no GCC was found"
    assert refused(ModuleNotFoundError("No module named 'peer'")).status == "not available"
    assert refused(ValueError("singular")).status == "cannot run"


@pytest.mark.parametrize("row", [0, BLOCK - 1, BLOCK, BLOCK + 1])
def test_a_large_batch_is_looked_at_to_the_last_row(row):
    expected = np.ones((BLOCK + 2, 3))
    answer = expected.copy()
    answer[row, 1] += 1e-3
    assert relative_error(answer, expected) == pytest.approx(5e-4)
    answer[row, 1] = np.nan
    assert relative_error(answer, expected) == float("inf")
