"""From LLVM assembly to object code, and from object code to an address in this process."""

from __future__ import annotations

import functools
import threading
from typing import Any

from leg_dynamics.kernels.target import Target

__all__ = ["ENTRY", "LoadedCode", "compile_object", "load_object"]

ENTRY = "kernel"
"""Name of the function that a kernel's object code exports."""

# LLVM's own global state is not protected.
_LOCK = threading.Lock()


@functools.cache
def _initialised() -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm


def _target_machine(target: Target, *, jit: bool = True) -> Any:
    llvm = _initialised()
    return llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu,
        features=target.features,
        opt=2,
        reloc="default" if jit else "pic",
        codemodel="jitdefault" if jit else "small",
        jit=jit,
    )


def compile_object(text: str, target: Target) -> bytes:
    """Compile a module.

    Parameters
    ----------
    text : str
        LLVM assembly.
    target : Target

    Returns
    -------
    bytes
        Object code.
    """
    llvm = _initialised()
    with _LOCK:
        machine = _target_machine(target)
        module = llvm.parse_assembly(text)
        module.triple = target.triple
        module.data_layout = str(machine.target_data)
        module.verify()
        return bytes(machine.emit_object(module))


class LoadedCode:
    """Object code in memory; `address` is the kernel's entry, valid as long as this object lives."""

    def __init__(self, engine: Any) -> None:
        self._engine = engine
        self.address = self.address_of(ENTRY)

    def address_of(self, name: str) -> int:
        """Address of an exported function."""
        return int(self._engine.get_function_address(name))


def load_object(code: bytes, target: Target) -> LoadedCode:
    """Load object code that `compile_object` made for the same target."""
    llvm = _initialised()
    with _LOCK:
        empty = llvm.parse_assembly("")
        empty.triple = target.triple
        engine = llvm.create_mcjit_compiler(empty, _target_machine(target))
        engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(code))
        engine.finalize_object()
        return LoadedCode(engine)
