"""A `Program` on CasADi's virtual machine: what serves where LLVM is missing, slower by one to two orders."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import casadi

    from leg_dynamics.kernels.program import Program, Solver

__all__ = ["VirtualMachine"]

_BLOCK = 4096


class VirtualMachine:
    """Evaluates a program with the semantics of the compiled gufunc: broadcasting, `out`, NaN rows, the count.

    Parameters
    ----------
    program : Program
    counter : memoryview
        One integer, to which the number of failing rows is added.
    """

    def __init__(self, program: Program, counter: memoryview) -> None:
        self.program = program
        self.nin = len(program.inputs)
        self.nout = len(program.outputs)
        self.signature = program.signature
        self._counter = counter
        self._lock = threading.Lock()

    def __call__(self, *arrays: Any, out: Any = None) -> Any:
        """Evaluate; positional arguments after the inputs are outputs, as for a ufunc."""
        if len(arrays) > self.nin:
            arrays, out = arrays[: self.nin], arrays[self.nin :]
        inputs = [_numbers(array) for array in arrays]
        leading = []
        for array, argument in zip(inputs, self.program.inputs, strict=True):
            core = array.ndim - len(argument.shape)
            if core < 0 or array.shape[core:] != argument.shape:
                raise ValueError(f"{self.program.name}: {argument.name} has shape {array.shape}, core {argument.shape}")
            leading.append(array.shape[:core])
        shape = np.broadcast_shapes(*leading)
        count = int(np.prod(shape))
        flat = [
            np.broadcast_to(array, shape + argument.shape).reshape(count, argument.size)
            for array, argument in zip(inputs, self.program.inputs, strict=True)
        ]
        results = [np.empty((count, argument.size)) for argument in self.program.outputs]
        with np.errstate(all="ignore"):
            for first in range(0, count, _BLOCK):
                rows = slice(first, min(first + _BLOCK, count))
                self._block([part[rows].T for part in flat], [result[rows] for result in results])
        shaped = [r.reshape(shape + argument.shape) for r, argument in zip(results, self.program.outputs, strict=True)]
        if out is not None:
            given = out if isinstance(out, tuple) else (out,)
            for number, (target, result) in enumerate(zip(given, shaped, strict=True)):
                if target is not None:
                    if not isinstance(target, np.ndarray):
                        raise TypeError(f"return arrays must be of ArrayType, got {type(target).__name__}")
                    np.copyto(target, result, casting="same_kind")
                    shaped[number] = target
        else:
            shaped = [result[()] for result in shaped]
        return shaped[0] if len(shaped) == 1 else tuple(shaped)

    def _block(self, inputs: list[np.ndarray], outputs: list[np.ndarray]) -> None:
        valid = np.all([np.isfinite(part).all(axis=0) for part in inputs], axis=0)
        if self.program.solver is not None:
            unknowns, converged = _solve(self.program.solver, inputs)
            inputs = [*inputs, unknowns]
            valid = valid & converged
        *values, guards = _call(self.program.formula, inputs)
        valid = valid & (guards >= 0.0).all(axis=0)
        for value in values:
            valid = valid & np.isfinite(value).all(axis=0)
        for output, value in zip(outputs, values, strict=True):
            output[:] = np.where(valid, value, np.nan).T
        failed = int(np.count_nonzero(~valid))
        if failed:
            with self._lock:
                self._counter[0] += failed


def _numbers(given: Any) -> np.ndarray:
    array = np.asarray(given)
    if not np.can_cast(array.dtype, np.float64):
        raise TypeError(f"an array of type {array.dtype} does not convert to float64 safely")
    return array.astype(np.float64, copy=False)


def _call(function: casadi.Function, columns: list[np.ndarray]) -> list[np.ndarray]:
    count = columns[0].shape[1]
    results: Any = function.map(count)(*columns)
    listed = results if isinstance(results, (tuple, list)) else [results]
    return [np.asarray(result.full()).reshape(-1, count) for result in listed]


def _solve(solver: Solver, inputs: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method with continuation, row by row as the compiled kernel does it."""
    (unknowns,) = _call(solver.start, inputs)
    (wanted,) = _call(solver.stages, inputs)
    wanted = wanted[0]
    stages = np.clip(np.ceil(wanted), 1.0, float(solver.most_stages))
    finished = np.isnan(wanted)
    reached = np.zeros_like(finished)
    k = 0.0
    while not finished.all():
        k += 1.0
        last = k >= stages
        s = np.where(last, 1.0, k / stages)
        done = finished.copy()
        arrived = np.zeros_like(done)
        for _ in range(solver.iterations):
            step, residual = _call(solver.step, [*inputs, s[None], unknowns])
            active = ~done
            close = residual[0] <= solver.tolerance
            unknowns = np.where(active, unknowns - step, unknowns)
            arrived |= active & close
            done |= close | np.isnan(residual[0])
            if done.all():
                break
        ready = arrived & last
        reached |= ready
        finished |= ready | ~arrived
    return unknowns, reached & np.isfinite(unknowns).all(axis=0)
