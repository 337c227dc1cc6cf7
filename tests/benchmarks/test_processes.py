"""Figures of fresh processes: what a process says, and what becomes of one that fails."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest

from benchmarks import processes


def test_a_process_that_fails_is_a_reason():
    figure = processes._figure("k", "t", "ms", lambda: processes._run("raise ValueError('no such leg')", None)[0], 2)
    assert figure.samples == ()
    assert figure.reason == "ValueError: no such leg"


def test_a_process_gives_a_number_and_its_time():
    value, elapsed = processes._run("print(json.dumps(4.5))", None)
    assert value == 4.5
    assert elapsed > 0.0


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.slow
def test_every_figure_of_the_closed_form(tiny):
    found = {figure.key: figure for figure in processes.figures("omnileg", replace(tiny, thread_rows=50_000))}
    for key in ("python", "import", "import_load", "first_warm_pinocchio"):
        assert found[key].samples, found[key].reason
    for key in ("first_cold", "first_warm", "compile_cold", "compile_cached", "memory"):
        assert found[f"{key}_closed_form"].samples, found[f"{key}_closed_form"].reason
    assert found["compile_cached_closed_form"].samples[0] < found["compile_cold_closed_form"].samples[0]
    assert 0.0 <= found["memory_closed_form"].samples[0] < 5000.0
