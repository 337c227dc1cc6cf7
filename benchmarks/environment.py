"""What a figure depends on: machine, versions, thread settings, commit, date. No host name, no path."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import native

PACKAGES = ("leg-dynamics", "numpy", "pin", "scipy", "casadi", "llvmlite", "mujoco", "toolbox-parallel-robots")
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
QUIET_LOAD = 1.5


def cpu_model() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def load_average() -> float | None:
    """Mean number of running processes over the last minute, None where the system does not say."""
    try:
        return round(os.getloadavg()[0], 2)
    except (AttributeError, OSError):
        return None


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _git(*arguments: str) -> str | None:
    root = Path(__file__).parents[1]
    try:
        done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=True, timeout=20)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def commit() -> dict[str, Any] | None:
    """Commit of the checkout and whether anything but the results differs from it; None outside of one."""
    name = _git("rev-parse", "--short=12", "HEAD")
    if not name:
        return None
    changes = _git("status", "--porcelain", "--", ".", ":(exclude)benchmarks/results")
    return {"name": name, "dirty": bool(changes)}


def blas() -> str | None:
    """Library that NumPy was built with, name and version."""
    try:
        library = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
        return f"{library['name']} {library['version']}"
    except (KeyError, TypeError):
        return None


def vectors() -> str | None:
    """Level of vector instructions that kernels are compiled for; None where they are not compiled."""
    try:
        from leg_dynamics.kernels.target import host_target

        return host_target().level
    except Exception:
        return None


def environment() -> dict[str, Any]:
    """Everything above, ready for JSON."""
    return {
        "date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        "cpu": cpu_model(),
        "cores": cores(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "versions": {package: _version(package) for package in PACKAGES},
        "blas": blas(),
        "vectors": vectors(),
        "compiler": native.compiler_version(),
        "threads": {name: os.environ.get(name) for name in THREAD_VARIABLES},
        "load_before": load_average(),
        "commit": commit(),
    }
