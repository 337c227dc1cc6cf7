"""Random graphs on random rows, against CasADi's own evaluation."""

from __future__ import annotations

import casadi
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from leg_dynamics.kernels import compile_program
from leg_dynamics.kernels.target import LEVEL_VARIABLE, LEVELS, host_target
from leg_dynamics.kernels.virtual_machine import VirtualMachine

# IEEE 754 fixes these to the bit.
ARITHMETIC = {
    "add": (2, lambda x, y: x + y),
    "sub": (2, lambda x, y: x - y),
    "mul": (2, lambda x, y: x * y),
    "div": (2, lambda x, y: x / y),
    "neg": (1, lambda x: -x),
    "sq": (1, lambda x: x**2),
    "sqrt": (1, casadi.sqrt),
    "fabs": (1, casadi.fabs),
    "twice": (1, lambda x: 2 * x),
    "inverse": (1, lambda x: 1 / x),
    "floor": (1, casadi.floor),
    "less": (2, lambda x, y: x < y),
    "if": (2, lambda x, y: casadi.if_else(x > y, x, y * 2)),
    "sign": (1, casadi.sign),
}
# Continuous, and of moderate slope: an error of a few ulp stays one.
SMOOTH = {
    "sin": (1, casadi.sin),
    "cos": (1, casadi.cos),
    "atan": (1, casadi.atan),
    "atan2": (2, lambda y, x: casadi.atan2(y, casadi.fabs(x) + 1)),
    "asin": (1, lambda x: casadi.asin(x / (1 + casadi.fabs(x) * 1.5))),
    "acos": (1, lambda x: casadi.acos(x / (1 + casadi.fabs(x) * 1.5))),
    "sqrt": (1, lambda x: casadi.sqrt(1 + casadi.fabs(x))),
    "add": (2, lambda x, y: (x + y) / 2),
    "sub": (2, lambda x, y: (x - y) / 2),
    "mul": (2, lambda x, y: casadi.sin(x) * casadi.cos(y)),
    "tanh": (1, casadi.tanh),
    "neg": (1, lambda x: -x),
}
INPUTS = 3

numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)
ordinary = st.floats(-100.0, 100.0)


def steps(operations):
    """A list of (operation, operands), the operands counted back from the latest value."""
    back = st.integers(0, 30)
    return st.lists(st.tuples(st.sampled_from(sorted(operations)), back, back), min_size=1, max_size=25)


def traced(operations, chosen):
    def function(x):
        values = [x[k] for k in range(INPUTS)]
        for name, *back in chosen:
            count, operation = operations[name]
            values.append(operation(*(values[-1 - back[k] % len(values)] for k in range(count))))
        return [casadi.vertcat(*values[-2:]), values[-1]]

    return function


def levels():
    host = host_target()
    return LEVELS[LEVELS.index(host.level) : -1] if host.is_x86 else [host.level]


def both(lab, operations, chosen, rows, level):
    program = lab.program([(INPUTS,)], traced(operations, chosen), [(2,), ()])
    counter = memoryview(bytearray(8)).cast("q")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(LEVEL_VARIABLE, level)
        kernel = compile_program(program)
    fast, slow = kernel(rows, threads=1), VirtualMachine(program, counter)(rows)
    return fast, slow, kernel.counter[0], counter[0]


matrices = st.lists(st.tuples(*[numbers] * INPUTS), min_size=1, max_size=20)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(chosen=steps(ARITHMETIC), rows=matrices, level=st.sampled_from(sorted(levels())))
def test_arithmetic_is_the_same_to_the_bit(lab, chosen, rows, level):
    fast, slow, *counts = both(lab, ARITHMETIC, chosen, np.array(rows), level)
    assert counts[0] == counts[1]
    for found, expected in zip(fast, slow, strict=True):
        lab.assert_same_bits(found, expected)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    chosen=steps(SMOOTH),
    rows=st.lists(st.tuples(*[ordinary] * INPUTS), min_size=1, max_size=20),
    level=st.sampled_from(sorted(levels())),
)
def test_elementary_functions_are_the_same_within_rounding(lab, chosen, rows, level):
    fast, slow, *counts = both(lab, SMOOTH, chosen, np.array(rows), level)
    assert counts == [0, 0]
    for found, expected in zip(fast, slow, strict=True):
        # every operation has a slope of at most about one, so that errors add up at most; a sine of 100 rad is off by
        # what the error of its argument makes of it
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * max(1.0, np.abs(rows).max()))
