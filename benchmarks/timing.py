"""Interleaved timing: every repetition visits every case, so that drift of the machine hits all alike."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter_ns
from typing import Any

from benchmarks.cases import Work

LEAD_IN = 3


@dataclass
class Runner:
    """One case in the interleaved run: `position` walks through the timed arguments and wraps around."""

    work: Work
    loops: int = 1
    position: int = 0
    samples: list[float] = field(default_factory=list)

    def _next(self, count: int) -> list[tuple[Any, ...]]:
        period, start = self.work.period, self.position
        self.position = (start + count) % period
        return [self.work.arguments[(start + i) % period] for i in range(count)]

    def once(self, loops: int) -> tuple[int, Any, int]:
        """Time `loops` calls; returns total ns, the last result and the index of its arguments."""
        function = self.work.function
        # Brings caches, branch predictors and warm starts back after the other cases.
        for arguments in self._next(LEAD_IN if loops > 1 else 0):
            function(*arguments)
        queue = self._next(loops)
        result = None
        collecting = gc.isenabled()
        gc.disable()
        try:
            start = perf_counter_ns()
            for arguments in queue:
                result = function(*arguments)
            elapsed = perf_counter_ns() - start
        finally:
            if collecting:
                gc.enable()
        return elapsed, result, (self.position - 1) % self.work.period

    def calibrate(self, minimum_ns: int) -> None:
        """Choose the number of calls of one measurement, with a fifth to spare."""
        loops = 1
        while True:
            elapsed, _, _ = self.once(loops)
            if elapsed >= minimum_ns:
                break
            loops = max(2 * loops, min(100 * loops, int(1.2 * loops * minimum_ns / max(elapsed, 1)) + 1))
        self.loops = max(1, min(loops, int(1.2 * loops * minimum_ns / elapsed) + 1))


def interleave(
    runners: dict[str, Runner],
    minimum_ns: int,
    repetitions: int,
    verify: Callable[[str, Any, int], bool],
    failed: Callable[[str, Exception], None],
    progress: Callable[[], None],
) -> None:
    """Fill `samples` (ns a call) of all runners and drop those that go wrong.

    `verify` sees the last result of each measurement and says whether it is right; `failed` hears of exceptions. Each
    repetition starts with another case, so that none always follows the same one.
    """
    for key, runner in list(runners.items()):
        try:
            runner.calibrate(minimum_ns)
        except Exception as problem:
            failed(key, problem)
            del runners[key]
    keys = list(runners)
    for repetition in range(repetitions):
        shift = repetition % max(len(keys), 1)
        for key in keys[shift:] + keys[:shift]:
            progress()
            if key not in runners:
                continue
            runner = runners[key]
            try:
                elapsed, result, index = runner.once(runner.loops)
            except Exception as problem:
                failed(key, problem)
                del runners[key]
                continue
            if verify(key, result, index):
                runner.samples.append(elapsed / runner.loops)
            else:
                del runners[key]
