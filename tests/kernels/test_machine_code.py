from __future__ import annotations

import ctypes
import re

import casadi
import llvmlite.binding as llvm
import numpy as np
import pytest

from leg_dynamics.kernels import Solver
from leg_dynamics.kernels.assembly import assembly
from leg_dynamics.kernels.machine_code import ENTRY, compile_object, load_object
from leg_dynamics.kernels.target import host_target, target_for

ELF = b"\x7fELF"
MACHINES = {"x86_64": 62, "aarch64": 183}


@pytest.fixture(scope="module")
def everything(lab):
    """A program with a solver, guards, wide arguments, and every way of computing a function."""
    x, y, s, z = (casadi.SX.sym(name, size) for name, size in (("x", 10), ("y", 4), ("s", 1), ("z", 2)))
    slope = casadi.vertcat(1 + 0.3 * casadi.cos(z[0]), 1)
    error = casadi.vertcat(z[0] + 0.3 * casadi.sin(z[0]) - s * x[0], z[1] - casadi.atan2(z[0], x[1]))
    solver = Solver(
        2,
        casadi.Function("start", [x, y], [casadi.SX(2, 1)]),
        casadi.Function("stages", [x, y], [1 + casadi.fabs(x[0])]),
        casadi.Function("step", [x, y, s, z], [error / slope, casadi.norm_inf(error)]),
        1e-10,
    )

    def function(x, y, z):
        library = casadi.exp(x[2]) + casadi.hypot(y[0], y[1]) + casadi.floor(y[2])
        return [
            casadi.vertcat(z, casadi.asin(x[3]) + casadi.tan(x[4]), casadi.if_else(y[0] > y[1], library, y[3])),
            casadi.sqrt(x[5] ** 2 + 1),
        ]

    return lab.program([(10,), (2, 2)], function, [(4,), ()], guards=lambda x, y, z: 2 - x[0], solver=solver)


@pytest.mark.parametrize("level", ["avx512", "avx2", "sse2"])
def test_every_level_of_x86_assembles_on_any_machine(everything, level):
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = target_for(level, "x86_64-unknown-linux-gnu")
    code = compile_object(assembly(everything, target), target)
    assert code.startswith(ELF)
    assert int.from_bytes(code[18:20], "little") == MACHINES["x86_64"]


@pytest.mark.parametrize("triple", ["aarch64-unknown-linux-gnu", "arm64-apple-macosx14.0.0"])
def test_arm_assembles(everything, triple):
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = target_for("neon", triple)
    text = assembly(everything, target)
    module = llvm.parse_assembly(text)
    module.triple = triple
    module.verify()
    assert "x86" not in text
    try:
        llvm.Target.from_triple(triple)
    except RuntimeError as error:
        pytest.skip(f"this llvmlite has no such backend: {error}")
    code = compile_object(text, target)
    if "linux" in triple:
        assert code.startswith(ELF)
        assert int.from_bytes(code[18:20], "little") == MACHINES["aarch64"]
    else:
        assert code.startswith(b"\xcf\xfa\xed\xfe")
    assert ENTRY.encode() in code


@pytest.mark.parametrize(
    ("level", "register"), [("avx512", "zmm"), ("avx2", "ymm"), ("sse2", "xmm"), ("neon", r"v\d+\.2d")]
)
def test_the_code_uses_the_registers_of_its_level(lab, level, register):
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = target_for(level, "aarch64-unknown-linux-gnu" if level == "neon" else "x86_64-unknown-linux-gnu")
    try:
        machine = llvm.Target.from_triple(target.triple).create_target_machine(cpu=target.cpu, opt=2)
    except RuntimeError as error:
        pytest.skip(f"this llvmlite has no such backend: {error}")
    text = assembly(lab.program([(3,)], lambda x: casadi.sin(x) * x + x / 3, [(3,)]), target)
    module = llvm.parse_assembly(text)
    module.triple = target.triple
    code = machine.emit_assembly(module)
    assert re.search(register, code)
    if level == "sse2":
        assert not re.search(r"\b[yz]mm\d|\bv(add|mul|fmadd)\w*pd", code)
    if level == "avx2":
        assert "zmm" not in code


def test_code_uses_no_instruction_that_the_machine_hides(lab):
    """What a virtual machine hides of its processor is known by features, not by the processor's name."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = target_for("avx2", "x86_64-unknown-linux-gnu")
    text = assembly(lab.program([()], casadi.cos), target)
    assert b"\0fma\0" not in compile_object(text, target)
    # without the instruction, the C library's function is called
    assert b"\0fma\0" in compile_object(text, target._replace(features="-fma"))


def test_products_and_sums_of_a_graph_are_rounded_one_by_one(lab):
    """A fused multiply-add belongs to the polynomials only."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    program = lab.program([(3,)], lambda x: x[0] * x[1] + x[2])
    for level, triple in (("avx512", "x86_64-unknown-linux-gnu"), ("neon", "aarch64-unknown-linux-gnu")):
        target = target_for(level, triple)
        try:
            machine = llvm.Target.from_triple(triple).create_target_machine(cpu=target.cpu, opt=2)
        except RuntimeError:
            continue
        module = llvm.parse_assembly(assembly(program, target))
        module.triple = triple
        assert not re.search(r"fn?madd|fmla|fmls|fn?msub", machine.emit_assembly(module))


def test_object_code_runs_in_any_number_of_copies(lab):
    target = host_target()
    code = compile_object(assembly(lab.program([()], lambda x: 3 * x), target), target)
    first, second = load_object(code, target), load_object(code, target)
    assert first.address != second.address
    x, y = np.arange(5.0), np.zeros(5)
    addresses = (ctypes.c_void_p * 2)(x.ctypes.data, y.ctypes.data)
    counter = ctypes.c_int64(0)
    for loaded in (first, second):
        y[:] = 0.0
        call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(loaded.address)
        call(addresses, (ctypes.c_ssize_t * 1)(5), (ctypes.c_ssize_t * 2)(8, 8), ctypes.byref(counter))
        assert y.tolist() == [0.0, 3.0, 6.0, 9.0, 12.0]
    assert counter.value == 0


def test_text_that_is_no_assembly_is_refused():
    with pytest.raises(RuntimeError, match="parsing error"):
        compile_object("define void @kernel( {", host_target())
