"""A machine-code address as a genuine NumPy generalised ufunc, through NumPy's own C interface and ctypes."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

__all__ = ["array_interface", "make_gufunc"]

# Position of PyUFunc_FromFuncAndDataAndSignature in NumPy's table of functions, part of its stable C interface.
_FROM_FUNCTION_AND_SIGNATURE = 31
_DOUBLE = 12  # NPY_DOUBLE
_NO_IDENTITY = -1  # PyUFunc_None


def _interface(name: str) -> Any:
    """One of NumPy's tables of functions."""
    import importlib

    # NumPy 1 has the same module under its former name
    core = "numpy._core" if hasattr(np, "_core") else "numpy.core"
    capsule = getattr(importlib.import_module(f"{core}._multiarray_umath"), name)
    get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
    get_pointer.restype = ctypes.c_void_p
    get_pointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    return ctypes.cast(get_pointer(capsule, None), ctypes.POINTER(ctypes.c_void_p))


@functools.cache
def array_interface() -> Any:
    """NumPy's table of functions on arrays, addresses by place."""
    return _interface("_ARRAY_API")


@functools.cache
def _constructor() -> Any:
    table = _interface("_UFUNC_API")
    prototype = ctypes.PYFUNCTYPE(
        ctypes.py_object,
        ctypes.c_void_p,
        ctypes.c_void_p,
        ctypes.c_void_p,
        ctypes.c_int,
        ctypes.c_int,
        ctypes.c_int,
        ctypes.c_int,
        ctypes.c_void_p,
        ctypes.c_void_p,
        ctypes.c_int,
        ctypes.c_void_p,
    )
    return prototype(table[_FROM_FUNCTION_AND_SIGNATURE])


# NumPy keeps pointers to what a ufunc is made of, and a ufunc may outlive whoever made it.
_KEPT: list[Sequence[Any]] = []


def make_gufunc(
    address: int, data: int, inputs: int, outputs: int, signature: str, name: str, doc: str, keep: Sequence[Any]
) -> np.ufunc:
    """Return a gufunc on float64 arrays.

    Parameters
    ----------
    address : int
        Of a function (char **args, npy_intp *dimensions, npy_intp *strides, void *data).
    data : int
        Address that the function receives as its last argument.
    inputs, outputs : int
        Numbers of arguments.
    signature : str
        Core dimensions, for example ``(3),(3)->(3,3)``.
    name, doc : str
    keep : sequence
        Objects that must live as long as the gufunc: the code behind the addresses.
    """
    count = inputs + outputs
    functions = (ctypes.c_void_p * 1)(address)
    datas = (ctypes.c_void_p * 1)(data)
    types = ctypes.create_string_buffer(bytes([_DOUBLE] * count), count)
    texts = tuple(ctypes.create_string_buffer(text.encode()) for text in (name, doc, signature))
    _KEPT.append((functions, datas, types, texts, keep))
    return _constructor()(
        ctypes.addressof(functions),
        ctypes.addressof(datas),
        ctypes.addressof(types),
        1,
        inputs,
        outputs,
        _NO_IDENTITY,
        ctypes.addressof(texts[0]),
        ctypes.addressof(texts[1]),
        0,
        ctypes.addressof(texts[2]),
    )
