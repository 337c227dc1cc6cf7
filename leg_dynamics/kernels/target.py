"""The machine that kernels are compiled for: its vector width and its name, found at run time."""

from __future__ import annotations

import functools
import os
import platform
from typing import NamedTuple

from leg_dynamics.errors import UnsupportedError

__all__ = ["LEVELS", "LEVEL_VARIABLE", "Target", "host_target"]

LEVEL_VARIABLE = "LEG_DYNAMICS_SIMD"
"""Environment variable that forces a lower level of vector instructions, one of `LEVELS`."""


class Target(NamedTuple):
    """What code is generated for.

    Attributes
    ----------
    level : str
        ``avx512``, ``avx2``, ``sse2`` or ``neon``.
    triple, cpu : str
        As LLVM names them.
    width : int
        Doubles in a vector.
    fused : bool
        Whether there is a fused multiply-add.
    features : str
        What the processor has and lacks beyond its name, as LLVM writes it: a virtual machine may hide instructions.
    """

    level: str
    triple: str
    cpu: str
    width: int
    fused: bool
    features: str = ""

    @property
    def is_x86(self) -> bool:
        """Whether the machine has the x86 floating-point control register."""
        return self.triple.startswith(("x86_64", "i686", "amd64"))


_X86_CPU = {"avx512": "x86-64-v4", "avx2": "x86-64-v3", "sse2": "x86-64"}
_WIDTH = {"avx512": 8, "avx2": 4, "sse2": 2, "neon": 2}
LEVELS = tuple(_WIDTH)
"""Levels of vector instructions, widest first."""


def target_for(level: str, triple: str) -> Target:
    """Return the plainest machine of that level."""
    cpu = _X86_CPU.get(level, "generic")
    return Target(level, triple, cpu, _WIDTH[level], level != "sse2")


@functools.cache
def _host() -> Target:
    import llvmlite.binding as llvm

    triple = llvm.get_default_triple()
    if platform.machine().lower() in ("aarch64", "arm64"):
        return Target("neon", triple, llvm.get_host_cpu_name(), _WIDTH["neon"], True)
    if platform.machine().lower() not in ("x86_64", "amd64"):
        raise UnsupportedError(
            f"kernels are not compiled for {platform.machine()}: use x86-64 or aarch64, or uninstall llvmlite to use "
            "the slower virtual machine"
        )
    features = llvm.get_host_cpu_features()
    for level, needed in (
        ("avx512", ("avx512f", "avx512dq", "avx512vl", "avx512bw", "fma")),
        ("avx2", ("avx2", "fma")),
    ):
        if all(features.get(feature) for feature in needed):
            return Target(level, triple, llvm.get_host_cpu_name(), _WIDTH[level], True, features.flatten())
    return target_for("sse2", triple)


def host_target() -> Target:
    """Return the machine this runs on, or the lower level that the environment asks for.

    Raises
    ------
    UnsupportedError
        The processor is of another family, or `LEVEL_VARIABLE` names no level that it has.
    """
    host = _host()
    level = os.environ.get(LEVEL_VARIABLE) or host.level
    if level == host.level:
        return host
    if level not in LEVELS or LEVELS.index(level) < LEVELS.index(host.level) or level == "neon" or not host.is_x86:
        raise UnsupportedError(
            f"{LEVEL_VARIABLE}={level!r} is not a level of vector instructions of this machine: leave it unset, or use "
            f"one of {', '.join(LEVELS[LEVELS.index(host.level) : -1]) if host.is_x86 else host.level}"
        )
    return target_for(level, host.triple)
