"""Row-by-row computations compiled to vector machine code and called as NumPy generalised ufuncs.

This package knows nothing of legs: a `Program` is a CasADi graph with named inputs and outputs.
"""

from __future__ import annotations

from leg_dynamics.kernels.kernel import Kernel, compile_program, kernel, llvm_is_available
from leg_dynamics.kernels.program import Argument, Program, Solver, differentiated, with_held

__all__ = [
    "Argument",
    "Kernel",
    "Program",
    "Solver",
    "compile_program",
    "differentiated",
    "kernel",
    "llvm_is_available",
    "with_held",
]
