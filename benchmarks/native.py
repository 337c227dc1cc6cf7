"""C kernels compiled when they are measured: the limit, and what CasADi's code generator makes of the same formula."""

from __future__ import annotations

import ctypes
import itertools
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import leg_dynamics as ld
from benchmarks.cases import NotAvailableError

SOURCE = Path(__file__).parent / "native" / "limit.c"
FLAGS = ("-O3", "-march=native", "-std=gnu11", "-shared", "-fPIC")

# The composite parameters that the limit knows, with the factor that it wants them with.
_ALONE = {
    "inertia_alpha": "INERTIA_ALPHA",
    "inertia_beta": "INERTIA_BETA",
    "inertia_gamma": "INERTIA_GAMMA",
    "transverse": "TRANSVERSE",
    "spin_1": "SPIN_1",
    "spin_2": "SPIN_2",
    "shank_cos_cos": "SHANK",
    "cardan_a": "CARDAN_A",
    "cardan_c": "CARDAN_C",
    "cardan_spin": "CARDAN_SPIN",
}
_KNOWN = {*_ALONE, "shank_cos_z", "moment_r", "fixed_x", "fixed_y", "fixed_z"}


@cache
def compiler() -> str:
    """Command of the C compiler.

    Raises
    ------
    NotAvailableError
        There is no GCC: the kernel uses its vector extensions.
    """
    for name in (os.environ.get("CC"), "gcc", "cc"):
        command = shutil.which(name) if name else None
        if command is None:
            continue
        told = subprocess.run([command, "--version"], capture_output=True, text=True, check=False).stdout
        if "Free Software Foundation" in told:
            return command
    raise NotAvailableError("no GCC was found; the C kernels need one")


@cache
def compiler_version() -> str | None:
    """Of the C compiler; None where there is none."""
    try:
        told = subprocess.run([compiler(), "-dumpfullversion"], capture_output=True, text=True, check=False)
    except NotAvailableError:
        return None
    return f"gcc {told.stdout.strip()}"


def build(files: Mapping[str, str], main: str, *flags: str) -> ctypes.CDLL:
    """Compile and load.

    Parameters
    ----------
    files : mapping of name to text
        Written into a temporary folder.
    main : str
        The one that is compiled.
    *flags : str

    Raises
    ------
    NotAvailableError
        There is no compiler, or it refuses.
    """
    command = compiler()
    with tempfile.TemporaryDirectory(prefix="leg_dynamics-bench-", ignore_cleanup_errors=True) as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        done = subprocess.run(
            [command, *FLAGS, *flags, main, "-o", "kernel.so", "-lm"],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise NotAvailableError(f"GCC refuses {main}: {done.stderr.strip().splitlines()[0][:160]}")
        return ctypes.CDLL(str(Path(folder) / "kernel.so"))


def limit_numbers(leg: ld.Leg) -> dict[str, float]:
    """Constants of the limit.

    Raises
    ------
    NotAvailableError
        The leg has inertia, gravity or dissipation that the limit leaves out.
    """
    if leg.name != "omnileg":
        raise NotAvailableError(f"the hand-written kernel is the OmniLeg's, not that of {leg.name}")
    numbers, module = leg.backend.numbers, leg.backend.module  # type: ignore[attr-defined]
    parameters = module.composite_parameters(numbers)._asdict()
    beyond = [name for name, value in parameters.items() if name not in _KNOWN and value != 0.0]
    gx, gy, gz = (float(x) for x in leg.gravity)
    if beyond or gx or gy or numbers.dissipation or numbers.transmission != "exact":
        what = ", ".join(beyond) or "gravity beside z, dissipation or another transmission"
        raise NotAvailableError(f"the hand-written kernel leaves out {what}, which this file has")
    return {name: float(parameters[source]) for source, name in _ALONE.items()} | {
        "KNEE_LIFT": float(numbers.L1 * parameters["shank_cos_z"]),
        "SHANK_WEIGHT": float(parameters["shank_cos_z"]) * gz,
        "LOAD": float(parameters["moment_r"]) * gz,
    }


class NativeTorque:
    """A compiled `torque(n, q, v, a, out)` on contiguous float64 rows; nothing is checked, `out` is made if absent.

    Attributes
    ----------
    lanes : int
        Doubles in its vectors.
    """

    def __init__(self, library: ctypes.CDLL, symbol: str = "torque") -> None:
        self._library = library
        self._function = getattr(library, symbol)
        self._function.argtypes = [ctypes.c_int64] + [ctypes.c_void_p] * 4
        self._function.restype = None
        self.lanes = int(library.lanes()) if hasattr(library, "lanes") else 1

    def __call__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        if out is None:
            out = np.empty(q.shape)
        # ctypes lets the interpreter go while C runs.
        self._function(q.size // 3, q.ctypes.data, v.ctypes.data, a.ctypes.data, out.ctypes.data)
        return out

    def threaded(self, threads: int) -> Callable[..., np.ndarray]:
        """The same on several threads, rows in equal parts."""
        pool = ThreadPoolExecutor(threads - 1)

        def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray, out: np.ndarray) -> np.ndarray:
            bounds = [len(q) * part // threads for part in range(threads + 1)]
            parts = [slice(*pair) for pair in itertools.pairwise(bounds)]
            others = [pool.submit(self, q[rows], v[rows], a[rows], out[rows]) for rows in parts[1:]]
            self(q[parts[0]], v[parts[0]], a[parts[0]], out[parts[0]])
            for other in others:
                other.result()
            return out

        return torque


@cache
def _limit_library(numbers: tuple[tuple[str, float], ...]) -> ctypes.CDLL:
    header = "".join(f"#define {name} ({value.hex()})\n" for name, value in numbers)
    # Scheduling before register allocation interleaves the unrolled blocks: 4.6 in place of 6.2 ns a row where tried.
    return build({"numbers.h": header, "limit.c": SOURCE.read_text(encoding="utf-8")}, "limit.c", "-fschedule-insns")


def limit(leg: ld.Leg, symbol: str = "torque") -> NativeTorque:
    """Return the hand-written kernel; raises `NotAvailableError` as `limit_numbers` and `build` do."""
    return NativeTorque(_limit_library(tuple(limit_numbers(leg).items())), symbol)


_ROW_BY_ROW = """
#include "graph.c"
#include <stdint.h>
#include <stdlib.h>
void torque(int64_t n, const double *q, const double *v, const double *a, double *out) {
    casadi_int sizes[4];
    graph_work(sizes, sizes + 1, sizes + 2, sizes + 3);
    const double **arg = malloc((sizes[0] + 3) * sizeof *arg);
    double **res = malloc((sizes[1] + 2) * sizeof *res), *w = malloc((sizes[3] + 1) * sizeof *w);
    casadi_int *iw = malloc((sizes[2] + 1) * sizeof *iw);
    for (int64_t i = 0; i < n; i++) {
        arg[0] = q + 3 * i, arg[1] = v + 3 * i, arg[2] = a + 3 * i;
        res[0] = out + 3 * i, res[1] = 0;
        graph(arg, res, iw, w, 0);
    }
    free(arg), free(res), free(w), free(iw);
}
"""


def generated(leg: ld.Leg) -> NativeTorque:
    """Return CasADi's C code for the closed form's graph, in a plain loop over the rows; raises `NotAvailableError`."""
    return NativeTorque(_generated(leg))


_GENERATED: dict[str, ctypes.CDLL] = {}


def _generated(leg: ld.Leg) -> ctypes.CDLL:
    if leg.name not in _GENERATED:
        import casadi

        formula: Any = leg.backend.kernels.program("torque").formula  # type: ignore[attr-defined]
        inputs = formula.sx_in()
        graph = casadi.Function("graph", inputs, formula(*inputs))
        generator = casadi.CodeGenerator("graph.c")
        generator.add(graph)
        _GENERATED[leg.name] = build({"graph.c": generator.dump(), "rows.c": _ROW_BY_ROW}, "rows.c")
    return _GENERATED[leg.name]
