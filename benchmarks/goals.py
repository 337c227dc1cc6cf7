"""The goals of the project as data, and how a report meets them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from benchmarks.report import Report, Result

Samples = tuple[float, ...]
LEAST_ROWS = 10_000
CONTROL = 1.3
"""Least gain of the limit by two threads that shows a free second core."""


class NotMeasuredError(Exception):
    """The report lacks what a goal is about; the message says what."""


@dataclass(frozen=True)
class Goal:
    """One line of the goals table.

    Attributes
    ----------
    metric : str
    relation : str
        ``<=`` or ``>=``.
    target : float
    unit : str
    measure : callable
        Report -> samples; raises `NotMeasuredError`.
    limited_by : str
        What a time that misses the goal is made of.
    """

    metric: str
    relation: str
    target: float
    unit: str
    measure: Callable[[Report], Samples]
    limited_by: str = ""


@dataclass(frozen=True)
class Outcome:
    """A goal held against a report; `margin` is the share to spare, negative where the goal is missed."""

    metric: str
    relation: str
    target: float
    unit: str
    measured: float | None
    quartiles: tuple[float, float] | None
    verdict: str
    margin: float | None
    reason: str | None

    @property
    def words(self) -> str:
        """The verdict in words."""
        if self.margin is None:
            return f"not measured: {self.reason}"
        if self.verdict == "met":
            return f"met, {self.margin:.0%} to spare"
        because = f"; limited by {self.reason}" if self.reason else ""
        return f"MISSED by {-self.margin:.0%}{because}"


def judge(goal: Goal, report: Report) -> Outcome:
    """Hold one goal against a report, by the median."""
    start = (goal.metric, goal.relation, goal.target, goal.unit)
    try:
        samples = goal.measure(report)
    except NotMeasuredError as absent:
        return Outcome(*start, None, None, "not measured", None, str(absent))
    low, median, high = (float(x) for x in np.percentile(samples, (25, 50, 75)))
    over = median / goal.target - 1.0
    margin = (0.0 - over) if goal.relation == "<=" else over
    if margin >= 0.0:
        return Outcome(*start, median, (low, high), "met", margin, None)
    return Outcome(*start, median, (low, high), "missed", margin, goal.limited_by or None)


def _result(report: Report, key: str) -> Result:
    found = report.find(key)
    if found is None:
        raise NotMeasuredError("not part of this run")
    if not found.samples or found.status != "ok":
        raise NotMeasuredError(f"{found.status}: {found.reason}")
    return found


def _ratio(key: str) -> Callable[[Report], Samples]:
    def measure(report: Report) -> Samples:
        found = _result(report, key)
        if not found.ratios:
            raise NotMeasuredError("the yardstick has no time")
        return found.ratios

    return measure


def _to_limit(key: str) -> Callable[[Report], Samples]:
    def measure(report: Report) -> Samples:
        found = _result(report, key)
        if not found.limit_ratios:
            limit = next((r for r in report.results if r.block == found.block and r.contender == "limit"), None)
            raise NotMeasuredError(f"the limit has no time: {limit.reason if limit else 'not part of this run'}")
        return found.limit_ratios

    return measure


def _times(slower: str, faster: str) -> Callable[[Report], Samples]:
    """How many times faster, pair by pair within a round."""

    def measure(report: Report) -> Samples:
        one, other = _result(report, slower), _result(report, faster)
        return tuple((x / one.rows) / (y / other.rows) for x, y in zip(one.samples, other.samples, strict=True))

    return measure


def _two_threads(report: Report) -> Samples:
    """Gain of two threads, where the limit shows that the machine has a second core to give."""
    gain = _times("closed_form_threads_1", "closed_form_threads_2")(report)
    try:
        control = float(np.median(_times("limit_threads_1", "limit_threads_2")(report)))
    except NotMeasuredError:
        return gain
    if control < CONTROL:
        raise NotMeasuredError(
            f"the limit itself gains {control:.2f} ×, so no second core was free (leg.torque: {np.median(gain):.2f} ×)"
        )
    return gain


def _times_by_yardstick(slower: str, faster: str) -> Callable[[Report], Samples]:
    """How many times faster, of cases that were timed in different blocks: by their ratios to the yardstick."""

    def measure(report: Report) -> Samples:
        one, other = _ratio(slower)(report), _ratio(faster)(report)
        return tuple(float(np.median(one)) / x for x in other)

    return measure


def _microseconds(key: str) -> Callable[[Report], Samples]:
    def measure(report: Report) -> Samples:
        found = _result(report, key)
        return tuple(sample / found.rows / 1000.0 for sample in found.samples)

    return measure


def _figure(key: str) -> Callable[[Report], Samples]:
    def measure(report: Report) -> Samples:
        found = next((figure for figure in report.figures if figure.key == key), None)
        if found is None:
            raise NotMeasuredError("not part of this run")
        if not found.samples:
            raise NotMeasuredError(str(found.reason))
        return found.samples

    return measure


_CALL = "the interpreter's own call and the array that it returns"
_ROWS = "the checks of each row and the turning of rows into vectors, which both cost the limit nothing"
_THREADS = "what the second core and the memory have to give beside other work of the machine"
_WALK = "the Newton steps of the walk from home; this time is in microseconds, and depends on the machine's speed"
_COMPILER = "LLVM's work on one long function, and CasADi's on its graph"
_IMPORTS = "Python's import of the modules that look for the kernel, not by its object code"
_NUMERIC = "the interpreter's work between the library calls of one closed pose"


def _vectors(report: Report, rows: int) -> str:
    """What the limit gains over NumPy in the same rounds."""
    level = report.environment.get("vectors", "unknown")
    try:
        limit = float(np.median(_times(f"vectorised_batch_{rows}", f"limit_batch_{rows}")(report)))
    except NotMeasuredError:
        return f"the machine's vectors ({level})"
    return f"the machine's vectors ({level}): the limit itself is {limit:.1f} × as fast as NumPy"


def all_goals(report: Report) -> tuple[Goal, ...]:
    """Every goal, for the batch sizes that the report has."""
    large = [rows for rows in report.settings.batch_rows if rows >= LEAST_ROWS]
    goals = [
        Goal("leg.torque, one call", "<=", 1 / 2.5, "× pin.rnea", _ratio("closed_form_fixed"), _CALL),
    ]
    for rows in large:
        key = f"closed_form_batch_{rows}"
        goals.append(Goal(f"leg.torque, N = {rows:,}", "<=", 1.6, "× the limit", _to_limit(key), _ROWS))
    for rows in large:
        key = f"closed_form_batch_{rows}"
        fast = _times(f"vectorised_batch_{rows}", key)
        unit, limited_by = "× as fast as NumPy vectorised", _vectors(report, rows)
        goals.append(Goal(f"leg.torque, N = {rows:,}", ">=", 20.0, unit, fast, limited_by))
    count = report.settings.thread_rows
    goals.append(Goal(f"two threads, N = {count:,}", ">=", 1.6, "× as fast as one", _two_threads, _THREADS))
    if large:
        symbolic = f"symbolic_batch_{large[0]}"
        naive = _times_by_yardstick("naive_trajectory", symbolic)
        goals += [
            Goal(f"symbolic route, N = {large[0]:,}, closure included", "<=", 1.2, "µs a row", _microseconds(symbolic)),
            Goal(f"symbolic route, N = {large[0]:,}", ">=", 200.0, "× as fast as naive pinocchio", naive),
        ]
    metric = "symbolic route, one call along the trajectory, closure included"
    goals.append(Goal(metric, "<=", 1.5, "× pin.rnea", _ratio("symbolic_trajectory"), _CALL))
    for name, target in (("four_bar", 0.25), ("six_bar", 0.5), ("mini_cheetah_leg", 0.15)):
        key = f"{name}_symbolic_batch"
        goals.append(Goal(f"symbolic route, {name}, batch", "<=", target, "µs a row", _microseconds(key), _WALK))
    for name in ("four_bar", "six_bar", "mini_cheetah_leg"):
        key = f"{name}_symbolic"
        goals.append(Goal(f"symbolic route, {name}, one call along a path", "<=", 3.0, "µs", _microseconds(key), _WALK))
    for route in ("closed_form", "symbolic"):
        cached = _figure(f"compile_cached_{route}")
        goals += [
            Goal(f"{route}: compile cold", "<=", 4000.0, "ms", _figure(f"compile_cold_{route}"), _COMPILER),
            Goal(f"{route}: compiled before, from cache", "<=", 20.0, "ms", cached, _IMPORTS),
        ]
    goals.append(Goal("import leg_dynamics beyond NumPy", "<=", 40.0, "ms", _figure("import")))
    goals.append(Goal("from leg_dynamics import load, beyond NumPy", "<=", 40.0, "ms", _figure("import_load")))
    for route in ("closed_form", "symbolic"):
        metric = f"{route}: fresh process to first torque, caches warm"
        goals.append(Goal(metric, "<=", 500.0, "ms", _figure(f"first_warm_{route}")))
    for route in ("closed_form", "symbolic"):
        key = f"memory_{route}"
        goals.append(Goal(f"{route}: memory beyond inputs and outputs", "<=", 120.0, "bytes a row", _figure(key)))
    # Goals of the pinocchio route, older than the others.
    goals += [
        Goal("Mechanism, closed tree q given", "<=", 16.0, "× pin.rnea", _ratio("mechanism_closed"), _NUMERIC),
        Goal("Mechanism along the trajectory", "<=", 35.0, "× pin.rnea", _ratio("mechanism_trajectory"), _NUMERIC),
    ]
    return tuple(goals)


def outcomes(report: Report) -> tuple[Outcome, ...]:
    """Every goal held against the report."""
    return tuple(judge(goal, report) for goal in all_goals(report))
