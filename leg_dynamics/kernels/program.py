"""What a kernel computes for one row of numbers: a CasADi graph, its guards, and a Newton solver before it.

A `Program` knows nothing of legs. Its graphs are SX functions of column vectors; arrays of more than one dimension are
passed flattened, row by row.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import casadi

__all__ = ["Argument", "Program", "Solver", "signature_of"]


@dataclass(frozen=True)
class Argument:
    """An input or output of one row: its name and its core shape, () for a number."""

    name: str
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Numbers in it."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class Solver:
    """Newton's method with continuation, run inside the kernel for the unknowns z that the formula then takes.

    The path parameter s goes from 0 (where `start` is the solution) to 1 in as many equal stages as `stages` asks for.
    At each stage z <- z - step is repeated until the residual is at most `tolerance`, once more after that, and at
    most `iterations` times. Every row decides for itself: its result does not depend on the rows beside it. A row that
    does not converge at s = 1 fails.

    Attributes
    ----------
    size : int
        Number of unknowns.
    start : casadi.Function
        (inputs...) -> z0, the unknowns at s = 0.
    stages : casadi.Function
        (inputs...) -> number of stages wanted, rounded up and limited to 1 ... `most_stages`; NaN fails the row.
    step : casadi.Function
        (inputs..., s, z) -> (Newton step, residual), the residual a single number that is never negative.
    tolerance : float
    iterations, most_stages : int
    """

    size: int
    start: casadi.Function
    stages: casadi.Function
    step: casadi.Function
    tolerance: float
    iterations: int = 12
    most_stages: int = 64


@dataclass(frozen=True)
class Program:
    """A row's computation.

    A row is valid where all its inputs are finite, the solver converged, every guard is at least 0 and every output is
    finite. All outputs of a row that is not valid are NaN, and the kernel counts it.

    Attributes
    ----------
    name : str
        For profiles and cache files.
    inputs, outputs : tuple of Argument
    formula : casadi.Function
        SX function: one column vector an input (then z, with a solver) -> one column vector an output, in row-major
        order, then one column vector of guards (which may be empty).
    solver : Solver or None
    """

    name: str
    inputs: tuple[Argument, ...]
    outputs: tuple[Argument, ...]
    formula: casadi.Function
    solver: Solver | None = None

    def __post_init__(self) -> None:
        unknowns = 0 if self.solver is None else self.solver.size
        sizes = [argument.size for argument in self.inputs]
        wanted = [*sizes, unknowns] if self.solver else sizes
        _check(self.formula, wanted, [argument.size for argument in self.outputs], guards=True)
        if self.solver is not None:
            _check(self.solver.start, sizes, [unknowns])
            _check(self.solver.stages, sizes, [1])
            _check(self.solver.step, [*sizes, 1, unknowns], [unknowns, 1])

    @property
    def signature(self) -> str:
        """NumPy's generalised-ufunc signature, all core dimensions fixed: ``(3),(3)->(3,3)``."""
        return signature_of(self.inputs, self.outputs)


def signature_of(inputs: Iterable[Argument], outputs: Iterable[Argument]) -> str:
    """NumPy's generalised-ufunc signature of arguments, all core dimensions fixed."""
    sides = (
        ",".join("(" + ",".join(map(str, argument.shape)) + ")" for argument in side) for side in (inputs, outputs)
    )
    return "->".join(sides)


def _check(function: casadi.Function, inputs: list[int], outputs: list[int], *, guards: bool = False) -> None:
    found_inputs = [function.numel_in(i) for i in range(function.n_in())]
    found_outputs = [function.numel_out(i) for i in range(function.n_out())]
    if found_inputs != inputs or (found_outputs[:-1] if guards else found_outputs) != outputs:
        raise ValueError(
            f"{function.name()} maps {found_inputs} numbers to {found_outputs}, expected {inputs} to {outputs}"
            + (" and guards" if guards else "")
        )
