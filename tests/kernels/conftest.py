"""Small programs, and every level of vector instructions that this machine has."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import casadi
import numpy as np
import pytest

from leg_dynamics.kernels import Argument, Kernel, Program, Solver, compile_program
from leg_dynamics.kernels.cache import FOLDER_VARIABLE
from leg_dynamics.kernels.target import LEVEL_VARIABLE, LEVELS, host_target


def program(
    sizes: Sequence[tuple[int, ...]],
    function: Callable[..., Any],
    results: Sequence[tuple[int, ...]] = ((),),
    *,
    guards: Callable[..., Any] | None = None,
    solver: Solver | None = None,
    name: str = "example",
) -> Program:
    """A program of column vectors: `function` and `guards` map symbols to symbols, after a solver also its unknowns."""
    inputs = tuple(Argument(f"x{number}", shape) for number, shape in enumerate(sizes))
    outputs = tuple(Argument(f"y{number}", shape) for number, shape in enumerate(results))
    symbols = [casadi.SX.sym(argument.name, argument.size) for argument in inputs]
    if solver is not None:
        symbols.append(casadi.SX.sym("z", solver.size))
    found = function(*symbols)
    values = list(found) if isinstance(found, (tuple, list)) else [found]
    guard = casadi.SX(0, 1) if guards is None else casadi.vertcat(guards(*symbols))
    return Program(name, inputs, outputs, casadi.Function(name, symbols, [*values, guard]), solver)


def compiled(*arguments: Any, **options: Any) -> Kernel:
    """A `program`, compiled."""
    return compile_program(program(*arguments, **options))


def bits(array: Any) -> np.ndarray:
    """What tells -0.0 from 0.0 and makes NaN equal to itself."""
    return np.ascontiguousarray(array, dtype=np.float64).view(np.int64)


def assert_same_bits(found: Any, expected: Any) -> None:
    assert np.shape(found) == np.shape(expected)
    np.testing.assert_array_equal(bits(found), bits(expected))


def python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run code in a fresh interpreter."""
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env={**os.environ, **environment},
        text=True,
        capture_output=True,
        timeout=120,
    )


@pytest.fixture(scope="session")
def lab() -> SimpleNamespace:
    return SimpleNamespace(
        program=program, compiled=compiled, bits=bits, assert_same_bits=assert_same_bits, python=python
    )


@pytest.fixture(scope="session", autouse=True)
def _shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One cache for all tests of a session, and never the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(tmp_path_factory.mktemp("kernel_cache")))
        patch.delenv(LEVEL_VARIABLE, raising=False)
        yield


@pytest.fixture(params=[level for level in LEVELS if level != "neon"])
def level(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Each level of vector instructions in turn."""
    host = host_target()
    if not host.is_x86 or LEVELS.index(request.param) < LEVELS.index(host.level):
        pytest.skip(f"this machine has no {request.param}")
    monkeypatch.setenv(LEVEL_VARIABLE, request.param)
    return request.param


@pytest.fixture
def width(level: str) -> int:
    """Rows in the largest block."""
    return host_target().width * (2 if level == "avx2" else 1)
