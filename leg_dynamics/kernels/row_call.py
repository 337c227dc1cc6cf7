"""One row at a time from Python: a kernel as a built-in function, without what a gufunc does before its loop.

A gufunc spends about half a microsecond on types, dimensions and iterators. Where every argument is a plain float64
array of the right shape, which the function here checks itself, none of that is needed.
"""

from __future__ import annotations

import ctypes
import functools
import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from leg_dynamics.kernels.gufunc import array_interface
from leg_dynamics.kernels.program import Argument

__all__ = ["ROW_ENTRY", "has_row_call", "make_row_call", "row_assembly"]

ROW_ENTRY = "row_call"
"""Name of the function, exported beside the kernel's own."""

# Where the interpreter and NumPy keep an array's fields; `_layout_holds` compares them with an array.
_TYPE, _DATA, _NDIM, _SHAPE, _DTYPE, _FLAGS = 8, 16, 24, 32, 56, 64

_CONTIGUOUS_ALIGNED = 0x101  # NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED
_WRITEABLE = 0x400

_FROM_DESCRIPTOR = 94  # place of PyArray_NewFromDescr in NumPy's table of functions
_FAST_CALL = 0x80  # METH_FASTCALL

# Largest result that is kept on the stack until the row is known to be good.
_MOST_NUMBERS = 512


def has_row_call(inputs: Sequence[Argument], outputs: Sequence[Argument]) -> bool:
    """Whether a kernel of these arguments has such a function: one result, and no argument is a bare number."""
    arguments = (*inputs, *outputs)
    return (
        len(outputs) == 1
        and bool(inputs)
        and all(argument.shape and argument.size for argument in arguments)
        and outputs[0].size <= _MOST_NUMBERS
    )


def row_assembly(kernel: str, inputs: Sequence[Argument], outputs: Sequence[Argument]) -> str:
    """LLVM assembly of the built-in function of a kernel that `has_row_call`.

    It takes the kernel's arrays, and optionally one more that receives the result, and returns the result; None where
    an argument is not a float64 array of the core shape, contiguous and aligned, or where the row failed. A result
    array is written only when the row has not failed.

    Parameters
    ----------
    kernel : str
        Name of the kernel's function in the same module.
    inputs, outputs : sequence of Argument

    Returns
    -------
    str
        Definition of `ROW_ENTRY` (self, objects, number), where ``self`` is an array of addresses, see `_Addresses`.
    """
    return _Writer(inputs, outputs).function(kernel)


class _Addresses(NamedTuple):
    """What the function cannot know when it is compiled, in an array that is its ``self``."""

    array_type: Any
    float64: Any
    none: Any
    retain: Any
    """Py_IncRef, which knows of objects that are not counted."""
    allocate: Any
    """PyArray_NewFromDescr."""
    failures: Any
    """The counter."""


class _Writer:
    def __init__(self, inputs: Sequence[Argument], outputs: Sequence[Argument]) -> None:
        self.inputs = inputs
        self.result = outputs[0]
        self.lines: list[str] = []
        self.stack: list[str] = []
        self.names = itertools.count()
        self.block = "entry"

    def emit(self, text: str) -> str:
        name = f"%n{next(self.names)}"
        self.lines.append(f"  {name} = {text}")
        return name

    def field(self, kind: str, base: str, offset: int) -> str:
        at = self.emit(f"getelementptr i8, ptr {base}, i64 {offset}")
        return self.emit(f"load {kind}, ptr {at}")

    def start_block(self, label: str) -> None:
        self.block = label
        self.lines.append(f"{label}:")

    def need(self, *conditions: str) -> None:
        """Go on where all conditions hold, else decline."""
        everything = functools.reduce(lambda x, y: self.emit(f"and i1 {x}, {y}"), conditions)
        following = f"b{next(self.names)}"
        self.lines.append(f"  br i1 {everything}, label %{following}, label %decline")
        self.start_block(following)

    def fits(self, place: int, argument: Argument, flags: int) -> tuple[str, str]:
        """Decline unless an object is such an array; its address and that of its numbers."""
        array = self.field("ptr", "%objects", 8 * place)
        self.need(self.emit(f"icmp eq ptr {self.field('ptr', array, _TYPE)}, {self.array_type}"))
        kept = self.emit(f"and i32 {self.field('i32', array, _FLAGS)}, {flags}")
        self.need(
            self.emit(f"icmp eq ptr {self.field('ptr', array, _DTYPE)}, {self.float}"),
            self.emit(f"icmp eq i32 {self.field('i32', array, _NDIM)}, {len(argument.shape)}"),
            self.emit(f"icmp eq i32 {kept}, {flags}"),
        )
        shape = self.field("ptr", array, _SHAPE)
        self.need(
            *(
                self.emit(f"icmp eq i64 {self.field('i64', shape, 8 * axis)}, {length}")
                for axis, length in enumerate(argument.shape)
            )
        )
        return array, self.field("ptr", array, _DATA)

    def array(self, kind: str, values: Sequence[str], name: str) -> str:
        """Values in an array on the stack."""
        self.stack.append(f"  %{name} = alloca [{len(values)} x {kind}], align 16")
        for place, value in enumerate(values):
            at = self.emit(f"getelementptr {kind}, ptr %{name}, i64 {place}")
            self.lines.append(f"  store {kind} {value}, ptr {at}")
        return f"%{name}"

    def function(self, kernel: str) -> str:
        inputs, result, lines = self.inputs, self.result, self.lines
        count = len(inputs)
        self.stack.append(f"  %numbers = alloca [{result.size} x double], align 16")
        table = self.field("ptr", "%self", _DATA)
        addresses = [self.field("ptr", table, 8 * place) for place in range(len(_Addresses._fields))]
        known = _Addresses(*addresses)
        self.array_type, self.float = known.array_type, known.float64
        given = self.emit(f"icmp eq i64 %number, {count + 1}")
        usual = self.emit(f"icmp eq i64 %number, {count}")
        self.need(self.emit(f"or i1 {given}, {usual}"))
        data = [self.fits(place, argument, _CONTIGUOUS_ALIGNED)[1] for place, argument in enumerate(inputs)]
        before = self.block
        lines.append(f"  br i1 {given}, label %look, label %compute")
        self.start_block("look")
        out, _ = self.fits(count, result, _CONTIGUOUS_ALIGNED | _WRITEABLE)
        looked = self.block
        lines.append("  br label %compute")
        self.start_block("compute")
        out = self.emit(f"phi ptr [ null, %{before} ], [ {out}, %{looked} ]")
        steps = [8 * argument.size for argument in (*inputs, result)]
        for argument in (*inputs, result):
            steps += [8 * math.prod(argument.shape[axis + 1 :]) for axis in range(len(argument.shape))]
        arguments = self.array("ptr", [*data, "%numbers"], "arguments")
        rows = self.array("i64", ["1"], "rows")
        strides = self.array("i64", list(map(str, steps)), "strides")
        earlier = self.emit(f"load i64, ptr {known.failures}")
        lines.append(f"  call void @{kernel}(ptr {arguments}, ptr {rows}, ptr {strides}, ptr {known.failures})")
        later = self.emit(f"load i64, ptr {known.failures}")
        self.need(self.emit(f"icmp eq i64 {earlier}, {later}"))
        lines.append(f"  br i1 {given}, label %keep, label %make")
        self.start_block("keep")
        lines += [f"  call void {known.retain}(ptr {out})", "  br label %write"]
        self.start_block("make")
        shape = self.array("i64", list(map(str, result.shape)), "shape")
        lines.append(f"  call void {known.retain}(ptr {known.float64})")  # the constructor takes this reference over
        made = self.emit(
            f"call ptr {known.allocate}(ptr {known.array_type}, ptr {known.float64}, i32 {len(result.shape)}, "
            f"ptr {shape}, ptr null, ptr null, i32 0, ptr null)"
        )
        lines.append(f"  br i1 {self.emit(f'icmp eq ptr {made}, null')}, label %fail, label %write")
        self.start_block("write")
        array = self.emit(f"phi ptr [ {out}, %keep ], [ {made}, %make ]")
        target = self.field("ptr", array, _DATA)
        for place in range(result.size):
            value = self.field("double", "%numbers", 8 * place)
            at = self.emit(f"getelementptr double, ptr {target}, i64 {place}")
            lines.append(f"  store double {value}, ptr {at}, align 8")
        lines += [f"  ret ptr {array}", "fail:", "  ret ptr null"]
        lines += ["decline:", f"  call void {known.retain}(ptr {known.none})", f"  ret ptr {known.none}"]
        body = "\n".join(["entry:", *self.stack, *lines])
        return f"define ptr @{ROW_ENTRY}(ptr %self, ptr %objects, i64 %number) #0 {{\n{body}\n}}\n"


@functools.cache
def _layout_holds() -> bool:
    """Whether an array's fields are where the function looks for them, in this interpreter and this NumPy."""
    if ctypes.sizeof(ctypes.c_void_p) != 8:
        return False
    array = np.zeros((3, 5))
    base = id(array)

    def field(kind: Any, offset: int) -> int:
        return int(kind.from_address(base + offset).value or 0)

    if field(ctypes.c_void_p, _TYPE) != id(np.ndarray):
        return False
    shape = field(ctypes.c_void_p, _SHAPE)
    return (
        field(ctypes.c_void_p, _DATA) == array.ctypes.data
        and field(ctypes.c_int, _NDIM) == array.ndim
        and field(ctypes.c_void_p, _DTYPE) == id(np.dtype(np.float64))
        and field(ctypes.c_int, _FLAGS) == array.flags.num
        and list((ctypes.c_int64 * 2).from_address(shape)) == [3, 5]
    )


class _Definition(ctypes.Structure):
    """PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


@functools.cache
def _new_function() -> Any:
    prototype = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    return prototype(("PyCFunction_NewEx", ctypes.pythonapi))


def _addresses(failures: int) -> np.ndarray:
    retain = ctypes.cast(ctypes.pythonapi.Py_IncRef, ctypes.c_void_p).value
    allocate = array_interface()[_FROM_DESCRIPTOR]
    known = _Addresses(id(np.ndarray), id(np.dtype(np.float64)), id(None), retain, allocate, failures)
    return np.array(known, dtype=np.uint64)


# The interpreter keeps a pointer to a function's definition, and a function may outlive whoever made it.
_KEPT: list[Any] = []


def make_row_call(address: int, data: int, name: str, keep: Sequence[Any]) -> Any:
    """Return the built-in function, or None where this interpreter or NumPy lays arrays out otherwise.

    Parameters
    ----------
    address : int
        Of the compiled `row_assembly`.
    data : int
        Address of the counter of failures.
    name : str
    keep : sequence
        Objects that must live as long as the function.
    """
    if not _layout_holds():
        return None
    definition = _Definition(name.encode(), address, _FAST_CALL, None)
    _KEPT.append((definition, keep))
    return _new_function()(ctypes.addressof(definition), _addresses(data), None)
