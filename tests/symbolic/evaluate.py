"""Programs on CasADi's virtual machine with a plain Newton loop: what a compiled kernel does, row by row."""

from __future__ import annotations

import casadi
import numpy as np


def evaluator(program):
    """A function with a gufunc's semantics: leading dimensions broadcast, rows that are not valid are NaN."""

    def call(*arrays):
        arrays = [np.asarray(array, dtype=float) for array in arrays]
        lead = np.broadcast_shapes(
            *(array.shape[: array.ndim - len(arg.shape)] for array, arg in zip(arrays, program.inputs, strict=True))
        )
        count = int(np.prod(lead, dtype=int))
        columns = [
            np.broadcast_to(array, (*lead, *arg.shape)).reshape(count, arg.size).T
            for array, arg in zip(arrays, program.inputs, strict=True)
        ]
        results = _evaluate(program, columns, count) if count else [np.zeros((arg.size, 0)) for arg in program.outputs]
        shaped = [result.T.reshape((*lead, *arg.shape)) for result, arg in zip(results, program.outputs, strict=True)]
        return shaped[0] if len(shaped) == 1 else tuple(shaped)

    return call


def run(function: casadi.Function, columns):
    with np.errstate(all="ignore"):
        results = function.call([casadi.DM(np.ascontiguousarray(c)) for c in columns])
    return [np.array(result) for result in results]


def mapped(function: casadi.Function, columns):
    count = columns[0].shape[1]
    return run(function.map(count), columns)


def _evaluate(program, columns, count):
    valid = np.all([np.isfinite(column).all(axis=0) for column in columns], axis=0)
    arguments = list(columns)
    if program.solver is not None:
        z, converged = newton(program.solver, columns, count)
        valid &= converged
        arguments.append(z)
    *outputs, guards = mapped(program.formula, arguments)
    if guards.size:
        valid &= (guards >= 0.0).all(axis=0)
    for output in outputs:
        valid &= np.isfinite(output).all(axis=0)
    for output in outputs:
        output[:, ~valid] = np.nan
    return outputs


def newton(solver, columns, count):
    """Continuation as `Solver` describes it: unknowns (nz, N) and whether each row converged."""
    (z,) = mapped(solver.start, columns)
    (wanted,) = mapped(solver.stages, columns)
    stages = np.clip(np.ceil(np.nan_to_num(wanted[0], nan=1.0)), 1, solver.most_stages)
    converged = np.ones(count, dtype=bool)
    for stage in range(1, int(stages.max()) + 1):
        s = np.minimum(stage / stages, 1.0)[None]
        again = np.zeros(count, dtype=bool)
        moving = (stage <= stages) & np.isfinite(wanted[0])
        for _ in range(solver.iterations):
            step, residual = mapped(solver.step, [*columns, s, z])
            small = residual[0] <= solver.tolerance
            z = np.where(moving & ~again, z - step, z)
            again |= moving & small
            if (again | ~moving).all():
                break
        converged &= again | ~moving
    return z, converged & np.isfinite(wanted[0])
