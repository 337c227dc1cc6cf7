"""What only a fresh process can say: import, first torque, compilation, peak memory."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from time import perf_counter
from typing import Any

from benchmarks.cases import Settings
from benchmarks.gate import explain
from benchmarks.report import Figure

TIMEOUT = 300

_NUMPY = "import numpy\nprint(json.dumps(0), flush=True)\n"

_IMPORT = """
from time import perf_counter
import numpy
start = perf_counter()
import leg_dynamics
print(json.dumps((perf_counter() - start) * 1e3))
"""

# The package imports its parts when they are asked for: the bare import says little.
_IMPORT_LOAD = _IMPORT.replace("import leg_dynamics", "from leg_dynamics import load")

_FIRST = """
import numpy as np
import leg_dynamics as ld
leg = ld.load({leg!r}, route={route!r})
x = np.full(len(leg.joint_names), 0.3)
leg.torque(x, x, x)
print(json.dumps("yourdfpy" in sys.modules), flush=True)
"""

# llvmlite's own import is paid once a process, and is part of the time to the first torque.
_COMPILE = """
from time import perf_counter
import numpy as np
import leg_dynamics as ld
import llvmlite.binding
leg = ld.load({leg!r}, route={route!r})
x = np.full(len(leg.joint_names), 0.3)
start = perf_counter()
leg.torque(x, x, x)
first = perf_counter() - start
start = perf_counter()
leg.torque(x, x, x)
print(json.dumps((first - (perf_counter() - start)) * 1e3))
"""

_MEMORY = """
import numpy as np
import leg_dynamics as ld

def resident(field):
    for line in open("/proc/self/status"):
        if line.startswith(field):
            return int(line.split()[1]) * 1024

leg = ld.load({leg!r}, route={route!r}, threads=1)
generator = np.random.default_rng(0)
low, high = leg.limits.lower, leg.limits.upper
shape = ({rows}, len(low))
q = generator.uniform(low + 0.1 * (high - low), high, shape)
v, a = generator.uniform(-5, 5, shape), generator.uniform(-50, 50, shape)
out = np.full(({rows}, len(leg.actuator_names)), 1.0)  # touched: its pages are not to be counted
leg.torque(q[:2], v[:2], a[:2], out=out[:2])
with open("/proc/self/clear_refs", "w") as file:
    file.write("5")
before = resident("VmRSS")
leg.torque(q, v, a, out=out)
print(json.dumps((resident("VmHWM") - before) / {rows}))
"""


class ProcessError(Exception):
    """A fresh process failed; the message is its last line."""


def _run(code: str, cache: str | None) -> tuple[Any, float]:
    """What the code prints, and the milliseconds from the start of the process to there."""
    # An inherited thread setting stays; the cache is the user's own where none is given.
    variables = dict(os.environ) if cache is None else os.environ | {"LEG_DYNAMICS_CACHE": cache}
    # An installed package has its bytecode beside it; a switch of this machine must not make each process compile it.
    variables.pop("PYTHONDONTWRITEBYTECODE", None)
    start = perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", "import json, sys\n" + code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=variables,
    )
    with process:
        assert process.stdout is not None
        assert process.stderr is not None
        line = process.stdout.readline()
        elapsed = (perf_counter() - start) * 1e3
        errors = process.stderr.read()
        process.wait(TIMEOUT)
    if process.returncode or not line:
        raise ProcessError(errors.strip().splitlines()[-1] if errors.strip() else f"exit code {process.returncode}")
    return json.loads(line), elapsed


def _warm(code: str, cache: str) -> float:
    """Milliseconds to the first torque; an error where the slow reader was imported although nothing was new."""
    imported, elapsed = _run(code, cache)
    if imported:
        raise ProcessError("yourdfpy was imported although the caches were warm")
    return elapsed


def _figure(key: str, title: str, unit: str, sample: Callable[[], float], count: int) -> Figure:
    samples: list[float] = []
    try:
        for _ in range(count):
            samples.append(float(sample()))
    except Exception as problem:
        reason = str(problem) if isinstance(problem, ProcessError) else explain(problem)
        return Figure(key, title, unit, (), reason[:240])
    return Figure(key, title, unit, tuple(samples), None)


def figures(leg: str, settings: Settings) -> tuple[Figure, ...]:
    """Measure in fresh processes, one after the other, with a cache folder of their own."""
    with tempfile.TemporaryDirectory(prefix="leg_dynamics-bench-") as folder:
        return tuple(_all(leg, settings, folder))


def _all(leg: str, settings: Settings, folder: str) -> list[Figure]:
    count = settings.processes
    other = _FIRST.format(leg=leg, route="pinocchio")
    return [
        _figure("python", "Python and NumPy alone, process to import", "ms", lambda: _run(_NUMPY, None)[1], count),
        _figure("import", "import leg_dynamics, beyond NumPy", "ms", lambda: _run(_IMPORT, None)[0], count),
        _figure(
            "import_load",
            "from leg_dynamics import load, beyond NumPy",
            "ms",
            lambda: _run(_IMPORT_LOAD, None)[0],
            count,
        ),
        *_of_route(leg, "closed_form", settings, folder),
        *_of_route(leg, "symbolic", settings, folder),
        _figure(
            "first_warm_pinocchio",
            "pinocchio: fresh process to first torque",
            "ms",
            lambda: _run(other, None)[1],
            count,
        ),
    ]


def _of_route(leg: str, route: str, settings: Settings, folder: str) -> list[Figure]:
    count = settings.processes
    texts = {"leg": leg, "route": route, "rows": settings.thread_rows}
    first, compiled, memory = (text.format(**texts) for text in (_FIRST, _COMPILE, _MEMORY))
    fresh = (os.path.join(folder, f"{route}-{number}") for number in itertools.count())
    # Bytecode is written once at installation, or by whoever is first.
    with contextlib.suppress(ProcessError):
        _run(first, next(fresh))
    warm = next(fresh)
    # The first process to use a folder fills it for those that follow.
    return [
        _figure(
            f"first_cold_{route}",
            f"{route}: fresh process to first torque, caches cold",
            "ms",
            lambda: _run(first, warm)[1],
            1,
        ),
        _figure(
            f"first_warm_{route}",
            f"{route}: fresh process to first torque, caches warm",
            "ms",
            lambda: _warm(first, warm),
            count,
        ),
        _figure(
            f"compile_cold_{route}",
            f"{route}: first torque of a loaded leg, llvmlite imported, caches cold",
            "ms",
            lambda: _run(compiled, next(fresh))[0],
            count,
        ),
        _figure(
            f"compile_cached_{route}",
            f"{route}: first torque of a loaded leg, llvmlite imported, from the cache",
            "ms",
            lambda: _run(compiled, warm)[0],
            count,
        ),
        _figure(
            f"memory_{route}",
            f"{route}: peak memory beyond inputs and outputs, N = {settings.thread_rows:,}",
            "bytes a row",
            lambda: _run(memory, warm)[0],
            1,
        ),
    ]
