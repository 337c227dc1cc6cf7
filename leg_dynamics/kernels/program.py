"""What a kernel computes for one row of numbers: a CasADi graph, its guards, and a Newton solver before it.

A `Program` knows nothing of legs. Its graphs are SX functions of column vectors; arrays of more than one dimension are
passed flattened, row by row.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import casadi

__all__ = ["Argument", "Program", "Solver", "differentiated", "signature_of", "with_held"]


class Argument(NamedTuple):
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
        if not self.inputs or not self.outputs or not all(a.size for a in (*self.inputs, *self.outputs)):
            raise ValueError(f"{self.name}: a row needs inputs and outputs, each of at least one number")
        unknowns = 0 if self.solver is None else self.solver.size
        sizes = [argument.size for argument in self.inputs]
        wanted = [*sizes, unknowns] if self.solver else sizes
        _check(self.formula, wanted, [argument.size for argument in self.outputs], guards=True)
        if self.solver is not None:
            if self.solver.iterations < 1 or self.solver.most_stages < 1:
                raise ValueError(f"{self.name}: the solver needs at least one iteration and one stage")
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


def with_held(program: Program, name: str, values: Mapping[str, Sequence[float]]) -> Program:
    """Return the program with some inputs held at constant values, which are then no inputs any more.

    Parameters
    ----------
    program : Program
    name : str
        Of the new program.
    values : mapping of str to sequence of float
        Numbers of each held input, flattened.
    """
    import casadi

    kept = tuple(argument for argument in program.inputs if argument.name not in values)
    symbols = {argument.name: casadi.SX.sym(argument.name, argument.size) for argument in kept}
    symbols |= {label: casadi.SX(casadi.DM(list(numbers))) for label, numbers in values.items()}
    given = [symbols[argument.name] for argument in program.inputs]
    own = [symbols[argument.name] for argument in kept]

    def held(function: casadi.Function, *more: casadi.SX) -> casadi.Function:
        results: Any = function(*given, *more)
        listed = list(results) if isinstance(results, (tuple, list)) else [results]
        return casadi.Function(function.name(), [*own, *more], casadi.cse(listed))

    solver = program.solver
    if solver is None:
        return replace(program, name=name, inputs=kept, formula=held(program.formula))
    z, s = casadi.SX.sym("z", solver.size), casadi.SX.sym("s")
    solver = replace(solver, start=held(solver.start), stages=held(solver.stages), step=held(solver.step, s, z))
    return replace(program, name=name, inputs=kept, formula=held(program.formula, z), solver=solver)


def differentiated(
    program: Program, name: str, by: Sequence[str], fixed: Mapping[str, casadi.DM] | None = None
) -> Program:
    """Return the program of a program's derivatives, exact, by automatic differentiation of its graph.

    Parameters
    ----------
    program : Program
        With one output of core shape (m,) and without a solver.
    name : str
        Of the new program and its output.
    by : sequence of str
        Inputs of shape (k,); the output is (m, sum of k), their Jacobians side by side.
    fixed : mapping of str to casadi.DM, optional
        Values at which some inputs are then held: they are no longer inputs.

    Raises
    ------
    ValueError
        The program has a solver, or several outputs.
    """
    import casadi

    if program.solver is not None or len(program.outputs) != 1:
        raise ValueError(f"{program.name} has a solver or several outputs: differentiate its formula instead")
    held = dict(fixed or {})
    symbols = {argument.name: casadi.SX.sym(argument.name, argument.size) for argument in program.inputs}
    output, guards = program.formula(*symbols.values())
    jacobian = casadi.horzcat(*(casadi.jacobian(output, symbols[label]) for label in by))
    columns = jacobian.numel() // max(output.numel(), 1)
    # row-major, as NumPy counts
    flat = casadi.reshape(jacobian.T, -1, 1)
    if held:
        flat, guards = casadi.substitute(
            [flat, guards], [symbols[label] for label in held], [casadi.SX(value) for value in held.values()]
        )
    inputs = tuple(argument for argument in program.inputs if argument.name not in held)
    graph = casadi.Function(name, [symbols[argument.name] for argument in inputs], casadi.cse([flat, guards]))
    return Program(name, inputs, (Argument(name, (output.numel(), columns)),), graph)


def _check(function: casadi.Function, inputs: list[int], outputs: list[int], *, guards: bool = False) -> None:
    found_inputs = [function.numel_in(i) for i in range(function.n_in())]
    found_outputs = [function.numel_out(i) for i in range(function.n_out())]
    columns = [function.sparsity_in(i) for i in range(function.n_in())]
    if not all(column.is_dense() for column in columns):
        raise ValueError(f"{function.name()} has an input with structural zeros: make it dense")
    columns += [function.sparsity_out(i) for i in range(function.n_out())]
    if not all(column.size2() == 1 or column.numel() == 0 for column in columns):
        raise ValueError(f"{function.name()} has matrices or rows: flatten each to one column vector, row by row")
    if found_inputs != inputs or (found_outputs[:-1] if guards else found_outputs) != outputs:
        raise ValueError(
            f"{function.name()} maps {found_inputs} numbers to {found_outputs}, expected {inputs} to {outputs}"
            + (" and guards" if guards else "")
        )
