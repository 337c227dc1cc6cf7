"""Random mechanisms by two routes never disagree, never crash, never hang and are never silently NaN.

500 of them, or as many as the environment variable LEG_DYNAMICS_FUZZ says; `python -m tests.fuzz --cases 20000` is the
long way, and `--first N` goes on with it.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import threading
from pathlib import Path
from types import ModuleType

import pytest


def _command() -> ModuleType:
    path = Path(__file__).with_name("__main__.py")
    spec = importlib.util.spec_from_file_location("random_mechanisms_command", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


fuzz = _command()


@pytest.mark.slow
def test_random_mechanisms_agree_or_are_refused_by_name():
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    cases = int(os.environ.get("LEG_DYNAMICS_FUZZ", "500"))
    summary = fuzz.run(cases, jobs=max(1, len(os.sched_getaffinity(0)) // workers))
    print(summary)
    assert not summary.failures, summary
    assert summary.cases == cases
    assert summary.compiled >= 0.15 * cases
    # A generator that makes little but refused files tests little.
    assert summary.built >= 0.8 * cases
    assert summary.computed >= 0.6 * summary.built, summary
    assert summary.agreed["torque"] >= 0.25 * summary.built, summary
    assert summary.left <= 0.2 * summary.built, summary


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        pytest.param("hang", "no answer within 20 s", marks=pytest.mark.slow),
        ("die", "the process died\nSIGABRT"),
        ("wrong", "bias: row 0 is"),
        pytest.param("nan", "bias: row 0 is", marks=pytest.mark.slow),
        pytest.param("stray", "ZeroDivisionError", marks=pytest.mark.slow),
    ],
)
def test_a_planted_fault_is_found(fault, message):
    summary = fuzz.Summary()
    fuzz.run_batch(1, 0, 1, "casadi", summary, threading.Lock(), limit=20.0 if fault == "hang" else 60.0, fault=fault)
    (failure,) = summary.failures
    assert message in failure
    assert "<robot" in failure
    assert "--first 50 --cases 1" in failure


@pytest.mark.slow
def test_a_case_can_be_repeated():
    whole, parts = fuzz.Summary(), fuzz.Summary()
    fuzz.run_batch(1, 0, 4, "casadi", whole, threading.Lock())
    fuzz.run_batch(1, 0, 3, "casadi", parts, threading.Lock())
    fuzz.run_batch(1, 3, 4, "casadi", parts, threading.Lock())
    assert not whole.failures
    assert whole.cases == parts.cases == 4
    assert whole.computed
    assert (whole.agreed, whole.refused, whole.worst) == (parts.agreed, parts.refused, parts.worst)
