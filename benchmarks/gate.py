"""The accuracy gate: an answer that differs from an independent one is not worth timing."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.cases import Work

TOLERANCE = 1e-9

FOLDERS = re.compile(r"(?<![\w.])([A-Za-z]:)?([\\/][\w.+@~ -]+)*[\\/](?=[\w.-]+\.\w+)")


@dataclass(frozen=True)
class Verdict:
    """`status` is "ok", "wrong" or "cannot run"; `error` the worst relative error where there is one."""

    status: str
    error: float | None = None
    reason: str | None = None


def relative_error(answer: Any, expected: np.ndarray) -> float:
    """Largest |difference| of a row relative to 1 + the row's magnitude; infinite for NaN or another shape."""
    answer = np.asarray(answer, dtype=float)
    if answer.shape != expected.shape:
        return float("inf")
    difference = np.atleast_2d(np.abs(answer - expected)).max(axis=-1)
    error = float((difference / (1.0 + np.atleast_2d(np.abs(expected)).max(axis=-1))).max())
    return error if np.isfinite(error) else float("inf")


def explain(error: BaseException) -> str:
    """One line about an exception, without a binding's listing of signatures and without this machine's folders."""
    lines = str(error).strip().splitlines()
    text = FOLDERS.sub("", " ".join(line.strip() for line in lines[:3]))
    return f"{type(error).__name__}: {text}"[:240] if lines else type(error).__name__


def judge(error: float, where: str) -> Verdict:
    """Verdict on one worst error."""
    if error <= TOLERANCE:
        return Verdict("ok", error)
    if not np.isfinite(error):
        return Verdict("wrong", None, f"no finite answer of the right shape {where}")
    return Verdict("wrong", error, f"differs by {error:.1e} {where}, tolerance {TOLERANCE:.0e}")


def check(work: Work) -> Verdict:
    """Run every argument once, in order, and hold each answer against the reference."""
    worst, at = -1.0, 0
    for index, arguments in enumerate(work.arguments):
        try:
            error = relative_error(work.answer(work.function(*arguments), index), work.expected[index])
        except Exception as problem:
            return Verdict("cannot run", None, f"{explain(problem)} (state {index})")
        if error > worst:
            worst, at = error, index
    return judge(worst, f"at state {at} of {len(work.arguments)}")
