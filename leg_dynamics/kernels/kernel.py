"""Programs as callables on arrays, compiled once and kept in the cache."""

from __future__ import annotations

import collections
import ctypes
import functools
import json
import math
import operator
import os
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.errors import LegDynamicsWarning, ShapeError
from leg_dynamics.kernels import cache
from leg_dynamics.kernels.program import Argument, Program, signature_of

if TYPE_CHECKING:
    from leg_dynamics.kernels.target import Target

__all__ = ["Kernel", "compile_program", "kernel", "llvm_is_available"]

# Below that many rows a second thread costs more than it saves.
_LEAST_ROWS_A_THREAD = 32768

# More only wait for each other.
_MOST_THREADS = 256

# What one of several threads computes before it looks for more.
_ROWS_A_PIECE = 16384


class Kernel:
    """A row's computation as a NumPy generalised ufunc.

    Rows that cannot be computed are NaN in all outputs and add to `counter`; nothing is raised or warned about.

    Attributes
    ----------
    name : str
    inputs, outputs : tuple of Argument
    signature : str
        Core dimensions.
    ufunc : numpy.ufunc or callable
        ``ufunc(*arrays, out=None)`` on one thread.
    row : builtin function or None
        ``row(*arrays[, out])`` of one row, faster: None where the kernel has none, see
        `leg_dynamics.kernels.row_call.row_assembly`.
    counter : memoryview
        ``counter[0]`` is the number of rows that have failed so far, in all threads.
    backend : str
        ``llvm`` or ``casadi``.
    """

    __slots__ = ("_data", "backend", "counter", "inputs", "name", "outputs", "row", "signature", "ufunc")

    def __init__(
        self,
        name: str,
        inputs: tuple[Argument, ...],
        outputs: tuple[Argument, ...],
        make: Callable[[ctypes.c_int64, memoryview], tuple[Any, Any]],
        backend: str,
    ) -> None:
        self._data = ctypes.c_int64(0)
        self.counter = memoryview(self._data).cast("B").cast("q")
        self.name = name
        self.inputs = inputs
        self.outputs = outputs
        self.backend = backend
        self.ufunc, self.row = make(self._data, self.counter)
        self.signature = signature_of(inputs, outputs)

    def __repr__(self) -> str:
        return f"<Kernel {self.name} {self.signature} by {self.backend}>"

    def __reduce__(self) -> Any:
        raise TypeError(f"{self!r} is machine code of this process: neither pickle nor copy it, make it again")

    def __call__(self, *arrays: Any, out: Any = None, threads: int | None = None) -> Any:
        """Evaluate on arrays whose leading dimensions broadcast.

        Parameters
        ----------
        *arrays : array_like
            One an input, its last axes the core shape.
        out : array or tuple of arrays, optional
            Receives the results.
        threads : int, optional
            Threads for large batches; default: one for every 32,768 rows, at most one a processor. A row's result does
            not depend on it.

        Returns
        -------
        array or tuple of arrays
        """
        if threads is not None:
            threads = _whole_number(threads)
        if threads != 1:
            divided = self._divided(arrays, out, threads)
            if divided is not None:
                return divided
        # a ufunc of several outputs refuses out=None
        return self.ufunc(*arrays) if out is None else self.ufunc(*arrays, out=out)

    def _divided(self, arrays: tuple[Any, ...], out: Any, threads: int | None) -> Any:
        """Evaluate on several threads; None where one does as well, or where NumPy has something to say."""
        cores = [len(argument.shape) for argument in self.inputs]
        given = [np.asarray(array) for array in arrays]
        if len(given) != len(cores) or any(array.ndim < core for array, core in zip(given, cores, strict=True)):
            return None
        shape = np.broadcast_shapes(
            *(array.shape[: array.ndim - core] for array, core in zip(given, cores, strict=True))
        )
        longest = max(shape, default=0)
        parts = min(longest, _MOST_THREADS, threads or min(_processors(), math.prod(shape) // _LEAST_ROWS_A_THREAD))
        if parts <= 1:
            return None
        shapes = [shape + argument.shape for argument in self.outputs]
        if out is None:
            results = tuple(np.empty(size) for size in shapes)
        else:
            results = out if isinstance(out, tuple) else (out,)
            if len(results) != len(shapes) or not all(map(_is_plain, results, shapes)):
                return None
            # a thread must not write what another has yet to read
            given = [
                array.copy() if any(np.may_share_memory(array, result) for result in results) else array
                for array in given
            ]
        _in_threads(self.ufunc, given, results, cores, shape, parts)
        return results[0] if len(results) == 1 else results


def _is_plain(array: Any, shape: tuple[int, ...]) -> bool:
    return isinstance(array, np.ndarray) and array.shape == shape and array.dtype == np.float64


def _whole_number(threads: Any) -> int:
    try:
        number = operator.index(threads)
    except TypeError:
        number = 0
    if number < 1:
        raise ShapeError(f"threads must be a positive whole number, got {threads!r}")
    return number


def _processors() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def _in_threads(
    ufunc: Any,
    arrays: list[np.ndarray],
    results: tuple[np.ndarray, ...],
    cores: list[int],
    shape: tuple[int, ...],
    threads: int,
) -> None:
    """Split the longest axis; NumPy releases the interpreter inside the loop.

    The pieces are more than the threads, each of which takes the next one when it is free: halves would last as long as
    the slower of two processors takes.
    """
    from concurrent.futures import ThreadPoolExecutor

    longest = max(shape)
    split = shape.index(longest)
    pieces = min(longest, max(threads, math.prod(shape) // _ROWS_A_PIECE))
    waiting = collections.deque(range(pieces))

    def piece(array: np.ndarray, core: int, rows: slice) -> np.ndarray:
        axis = array.ndim - core - len(shape) + split
        follows = axis >= 0 and array.shape[axis] == longest
        return array[(slice(None),) * axis + (rows,)] if follows else array

    def run() -> None:
        while waiting:
            try:
                part = waiting.popleft()
            except IndexError:  # another thread took the last one
                return
            rows = slice(longest * part // pieces, longest * (part + 1) // pieces)
            ufunc(
                *(piece(array, core, rows) for array, core in zip(arrays, cores, strict=True)),
                out=tuple(result[(slice(None),) * split + (rows,)] for result in results),
            )

    with ThreadPoolExecutor(threads - 1) as pool:
        others = [pool.submit(run) for _ in range(threads - 1)]
        run()
        for other in others:
            other.result()


@functools.cache
def llvm_is_available() -> bool:
    """Whether kernels can be compiled; a `LegDynamicsWarning`, once, where they cannot."""
    try:
        import llvmlite.binding  # noqa: F401
    except (ImportError, OSError) as error:
        warnings.warn(
            f"llvmlite cannot be imported ({error}): kernels run on CasADi's virtual machine, with the same results "
            "but 10 to 100 times slower; install llvmlite",
            LegDynamicsWarning,
            stacklevel=2,
        )
        return False
    return True


@functools.cache
def _versions() -> str:
    return " ".join(f"{name} {cache.package_version(name)}" for name in ("llvmlite", "casadi"))


def compile_program(program: Program) -> Kernel:
    """Return the kernel of a program, from the cache where it was compiled before.

    Parameters
    ----------
    program : Program

    Raises
    ------
    UnsupportedError
        The graph has an operation that kernels do not know, or the machine is of an unknown family.
    """
    if not llvm_is_available():
        return _on_virtual_machine(program)
    from leg_dynamics.kernels.assembly import assembly
    from leg_dynamics.kernels.target import host_target

    target = host_target()
    text = assembly(program, target)
    return _compiled(cache.key_of(_common_key(target), _header(program), text), target, lambda: (program, text))


def kernel(name: str, ingredients: str, build: Callable[[], Program]) -> Kernel:
    """Return a kernel by what it is made from, without making its program again where the cache has it.

    Parameters
    ----------
    name : str
        Of the program.
    ingredients : str
        Digest of everything that `build` depends on (see `leg_dynamics.kernels.cache.key_of`): files, options and the
        source of the code that runs, but not this package's.
    build : callable
        Makes the program; called only where the cache has no kernel.
    """
    if not llvm_is_available():
        return _on_virtual_machine(build())
    from leg_dynamics.kernels.target import host_target

    target = host_target()

    def assembled() -> tuple[Program, str]:
        from leg_dynamics.kernels.assembly import assembly

        program = build()
        return program, assembly(program, target)

    return _compiled(cache.key_of(_common_key(target), name, ingredients), target, assembled)


def _common_key(target: Target) -> str:
    return cache.key_of(_versions(), repr(target), cache.source_fingerprint("leg_dynamics.kernels"))


def _on_virtual_machine(program: Program) -> Kernel:
    from leg_dynamics.kernels.virtual_machine import VirtualMachine

    return Kernel(
        program.name,
        program.inputs,
        program.outputs,
        lambda data, counter: (VirtualMachine(program, counter), None),
        "casadi",
    )


def _header(program: Program) -> bytes:
    sides = [[(argument.name, argument.shape) for argument in side] for side in (program.inputs, program.outputs)]
    return json.dumps({"name": program.name, "sides": sides}).encode()


def _compiled(key: str, target: Target, assembled: Callable[[], tuple[Program, str]]) -> Kernel:
    from leg_dynamics.kernels.machine_code import compile_object, load_object

    stored = cache.read(key)
    if stored is None:
        program, text = assembled()
        code = compile_object(text, target)
        header = _header(program)
        cache.write(key, len(header).to_bytes(4, "little") + header + code)
    else:
        size = 4 + int.from_bytes(stored[:4], "little")
        header, code = stored[4:size], stored[size:]
    described = json.loads(header)
    inputs, outputs = (tuple(Argument(name, tuple(shape)) for name, shape in side) for side in described["sides"])
    loaded = load_object(code, target)
    return _around(described["name"], inputs, outputs, loaded)


def _around(name: str, inputs: tuple[Argument, ...], outputs: tuple[Argument, ...], loaded: Any) -> Kernel:
    from leg_dynamics.kernels.gufunc import make_gufunc
    from leg_dynamics.kernels.row_call import ROW_ENTRY, has_row_call, make_row_call

    def make(data: ctypes.c_int64, counter: memoryview) -> tuple[np.ufunc, Any]:
        doc = f"{', '.join(a.name for a in inputs)} -> {', '.join(a.name for a in outputs)}; rows that fail are NaN."
        ufunc = make_gufunc(
            loaded.address,
            ctypes.addressof(data),
            len(inputs),
            len(outputs),
            signature_of(inputs, outputs),
            name,
            doc,
            (loaded, data),
        )
        row = None
        if has_row_call(inputs, outputs):
            row = make_row_call(loaded.address_of(ROW_ENTRY), ctypes.addressof(data), name, (loaded, data))
        return ufunc, row

    return Kernel(name, inputs, outputs, make, "llvm")
