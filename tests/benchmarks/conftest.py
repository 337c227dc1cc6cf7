from __future__ import annotations

import pytest

from benchmarks import timing
from benchmarks.cases import Settings


@pytest.fixture(scope="session")
def tiny():
    """Settings under which a run says nothing about speed and everything about form."""
    return Settings(
        repetitions=3,
        minimum_ns=50_000,
        rate=50.0,
        states=24,
        method_states=8,
        batch_rows=(1, 7, 10_000),
        row_limit=7,
        slow_limit=7,
        loops=(1, 2),
        thread_rows=100,
        processes=1,
    )


@pytest.fixture
def clock(monkeypatch):
    """A clock that only the timed functions move: `clock.now += ns`."""

    class Clock:
        now = 0

        def __call__(self):
            return self.now

    clock = Clock()
    monkeypatch.setattr(timing, "perf_counter_ns", clock)
    return clock
