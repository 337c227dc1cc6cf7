"""The accuracy gate: an answer that differs from an independent one is not worth ranking."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.cases import NotAvailableError, Work

TOLERANCE = 1e-9
BLOCK = 65536

FOLDERS = re.compile(r"(?<![\w.])([A-Za-z]:)?([\\/][\w.+@~ -]+)*[\\/](?=[\w.-]+\.\w+)")


@dataclass(frozen=True)
class Verdict:
    """`status` is "ok", "wrong", "cannot run" or "not available"; `error` the worst relative error if there is one."""

    status: str
    error: float | None = None
    reason: str | None = None


def relative_error(answer: Any, expected: np.ndarray) -> float:
    """Largest |difference| of a row relative to 1 + the row's magnitude; infinite for NaN or another shape."""
    answer = np.asarray(answer, dtype=float)
    if answer.shape != expected.shape:
        return float("inf")
    rows, wanted = np.atleast_2d(answer), np.atleast_2d(expected)
    worst = 0.0
    # In parts: temporaries of a million rows would cost more than the case itself.
    for start in range(0, len(rows), BLOCK):
        part = wanted[start : start + BLOCK]
        difference = np.abs(rows[start : start + BLOCK] - part).max(axis=-1)
        error = float((difference / (1.0 + np.abs(part).max(axis=-1))).max())
        if not np.isfinite(error):
            return float("inf")
        worst = max(worst, error)
    return worst


def explain(error: BaseException) -> str:
    """One line about an exception, without a binding's listing of signatures and without this machine's folders."""
    lines = str(error).strip().splitlines()
    text = FOLDERS.sub("", " ".join(line.strip() for line in lines[:3]))
    if isinstance(error, NotAvailableError):
        return text[:240]
    return f"{type(error).__name__}: {text}"[:240] if lines else type(error).__name__


def judge(error: float, where: str) -> Verdict:
    """Verdict on one worst error."""
    if error <= TOLERANCE:
        return Verdict("ok", error)
    if not np.isfinite(error):
        return Verdict("wrong", None, f"no finite answer of the right shape {where}")
    return Verdict("wrong", error, f"differs by {error:.1e} {where}, tolerance {TOLERANCE:.0e}")


def refused(problem: Exception, where: str = "") -> Verdict:
    """Verdict on an exception: what is not installed is not available, all else cannot run."""
    absent = isinstance(problem, NotAvailableError | ImportError)
    return Verdict("not available" if absent else "cannot run", None, explain(problem) + where)


def check(work: Work) -> Verdict:
    """Run every argument once, in order, and hold each answer against the reference."""
    worst, at = -1.0, 0
    for index, arguments in enumerate(work.arguments):
        try:
            error = relative_error(work.answer(work.function(*arguments), index), work.expected[index])
        except Exception as problem:
            return refused(problem, f" (state {index})")
        if error > worst:
            worst, at = error, index
    return judge(worst, f"at state {at} of {len(work.arguments)}")
