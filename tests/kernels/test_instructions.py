"""Every operation of a CasADi graph on every level of vector instructions, and the list of instructions itself."""

from __future__ import annotations

import itertools
import math

import casadi
import numpy as np
import pytest
from scipy import special

from leg_dynamics.errors import UnsupportedError
from leg_dynamics.kernels.instructions import _NAMES, instructions

LARGEST = 1.7976931348623157e308
# Quotients: NaN, infinities and zeros of both signs are made inside the graph, for inputs must be finite.
NUMERATORS = (0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, 2.0, 7.3, -3.5, 5e-324, 1e-160, LARGEST, -LARGEST)
QUOTIENTS = np.array([*((x, 1.0) for x in NUMERATORS), (0.0, 0.0), (1.0, 0.0), (-1.0, 0.0)])


def truth(function):
    return lambda *values: function(*values).astype(float)


def _remainder(x, y):
    try:
        return math.remainder(x, y)
    except ValueError:  # where Python raises, C answers NaN
        return math.nan


UNARY = {
    "neg": (lambda x: -x, np.negative),
    "inv": (lambda x: 1 / x, lambda x: 1.0 / x),
    "sq": (lambda x: x**2, np.square),
    "twice": (lambda x: 2 * x, lambda x: 2.0 * x),
    "sqrt": (casadi.sqrt, np.sqrt),
    "fabs": (casadi.fabs, np.fabs),
    "sign": (casadi.sign, lambda x: np.where(x == 0.0, x, np.sign(x))),
    "floor": (casadi.floor, np.floor),
    "ceil": (casadi.ceil, np.ceil),
    "not": (casadi.logic_not, truth(np.logical_not)),
    "sin": (casadi.sin, np.sin),
    "cos": (casadi.cos, np.cos),
    "tan": (casadi.tan, np.tan),
    "asin": (casadi.asin, np.arcsin),
    "acos": (casadi.acos, np.arccos),
    "atan": (casadi.atan, np.arctan),
    "sinh": (casadi.sinh, np.sinh),
    "cosh": (casadi.cosh, np.cosh),
    "tanh": (casadi.tanh, np.tanh),
    "asinh": (casadi.asinh, np.arcsinh),
    "acosh": (casadi.acosh, np.arccosh),
    "atanh": (casadi.atanh, np.arctanh),
    "exp": (casadi.exp, np.exp),
    "expm1": (casadi.expm1, np.expm1),
    "log": (casadi.log, np.log),
    "log1p": (casadi.log1p, np.log1p),
    "erf": (casadi.erf, special.erf),
    "constpow": (lambda x: x**2.5, lambda x: np.power(x, 2.5)),
}
BINARY = {
    "add": (lambda x, y: x + y, np.add),
    "sub": (lambda x, y: x - y, np.subtract),
    "mul": (lambda x, y: x * y, np.multiply),
    "div": (lambda x, y: x / y, np.divide),
    "copysign": (casadi.copysign, np.copysign),
    "fmin": (casadi.fmin, np.fmin),
    "fmax": (casadi.fmax, np.fmax),
    "atan2": (casadi.atan2, np.arctan2),
    "pow": (lambda x, y: x**y, np.power),
    "hypot": (casadi.hypot, np.hypot),
    "fmod": (casadi.fmod, np.fmod),
    "remainder": (casadi.remainder, lambda x, y: np.array([_remainder(*row) for row in zip(x, y, strict=True)])),
    "lt": (lambda x, y: x < y, truth(np.less)),
    "le": (lambda x, y: x <= y, truth(np.less_equal)),
    "eq": (lambda x, y: x == y, truth(np.equal)),
    "ne": (lambda x, y: x != y, truth(np.not_equal)),
    "and": (casadi.logic_and, truth(np.logical_and)),
    "or": (casadi.logic_or, truth(np.logical_or)),
    "if_else_zero": (lambda x, y: casadi.if_else(x, y, 0), lambda x, y: np.where(x != 0.0, y, 0.0)),
}
OPERATIONS = UNARY | BINARY
# What IEEE 754 fixes to the bit; elsewhere NumPy's own functions are a few ulp off.
EXACT = {"neg", "inv", "sq", "twice", "sqrt", "fabs", "sign", "floor", "ceil", "not", "add", "sub", "mul", "div"}
EXACT |= {"copysign", "fmin", "fmax", "fmod", "remainder", "lt", "le", "eq", "ne", "and", "or", "if_else_zero"}


def test_no_operation_is_left_out():
    assert set(OPERATIONS) | {"assign"} == set(_NAMES)


@pytest.mark.parametrize("name", OPERATIONS)
def test_operation(lab, level, name):
    count = 1 if name in UNARY else 2
    graph = OPERATIONS[name][0]

    def function(*parts):
        value = graph(*(parts[2 * i] / parts[2 * i + 1] for i in range(count)))
        number, finite = casadi.fabs(value) <= math.inf, casadi.fabs(value) <= LARGEST
        return [
            number,
            casadi.if_else(finite, value, 0),
            casadi.if_else(number, casadi.copysign(1, value), 0),
            finite,
        ]

    program = lab.program([()] * (2 * count), function, [()] * 4, name=name)
    assert name in {step.operation for step in instructions(program.formula).body}
    rows = np.array([np.concatenate(choice) for choice in itertools.product(QUOTIENTS, repeat=count)])
    kernel = lab.compiled([()] * (2 * count), function, [()] * 4, name=name)
    is_number, value, sign, is_finite = kernel(*rows.T, threads=1)
    assert kernel.counter[0] == 0
    with np.errstate(all="ignore"):
        reference = OPERATIONS[name][1](*(rows[:, 2 * i] / rows[:, 2 * i + 1] for i in range(count)))
    np.testing.assert_array_equal(is_number == 1.0, ~np.isnan(reference))
    np.testing.assert_array_equal(is_finite == 1.0, np.isfinite(reference))
    # C leaves open which of two zeros is the smaller
    signed = ~np.isnan(reference) & ~((reference == 0.0) & (name in ("fmin", "fmax")))
    np.testing.assert_array_equal(sign[signed], np.copysign(1.0, reference)[signed])
    wanted = np.where(np.isfinite(reference), reference, 0.0)
    np.testing.assert_allclose(value, wanted, rtol=0.0 if name in EXACT else 2e-15, atol=0.0)


def test_a_branch_that_is_not_taken_may_be_nan_or_infinite(lab, level):
    kernel = lab.compiled(
        [()],
        lambda x: [
            casadi.if_else(x > 0, casadi.sqrt(x), casadi.log(-x)),
            casadi.if_else(casadi.logic_and(x > -1, x < 1), casadi.asin(x), 1 / (casadi.fabs(x) - 1)),
        ],
        [(), ()],
    )
    x = np.array([4.0, -3.0, 0.25, -0.5, 7.0, -8.0, 0.9, 2.0, -1.5, 3.0, 0.1])
    with np.errstate(all="ignore"):
        first = np.where(x > 0, np.sqrt(x), np.log(-x))
        second = np.where(np.abs(x) < 1, np.arcsin(x), 1 / (np.abs(x) - 1))
    found = kernel(x, threads=1)
    np.testing.assert_allclose(found[0], first, rtol=1e-15)
    np.testing.assert_allclose(found[1], second, rtol=1e-15)
    assert kernel.counter[0] == 0


def test_a_nan_counts_as_true_and_unequal_to_itself(lab, level):
    def function(x):
        nan = x / x
        return [casadi.logic_or(nan, 0), casadi.logic_and(nan, 1), casadi.if_else(nan, 3, 4), casadi.if_else(x, 1, 2)]

    found = lab.compiled([()], function, [()] * 4)(np.zeros(3), threads=1)
    assert [column.tolist() for column in found] == [[1.0] * 3, [1.0] * 3, [3.0] * 3, [2.0] * 3]


def test_equal_instructions_are_merged_and_unused_ones_left_out():
    x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
    listing = instructions(casadi.Function("f", [x, y], [casadi.sin(x) * y + y * casadi.sin(x)]))
    assert [step.operation for step in listing.body if step.operation != "input"] == ["sin", "mul", "add"]
    assert listing.arithmetic == 3
    # differences and quotients are not commutative
    listing = instructions(casadi.Function("f", [x, y], [(x - y) * (y - x)]))
    assert [step.operation for step in listing.body].count("sub") == 2
    nothing = instructions(casadi.Function("f", [x, y], [y]))
    assert [step.operation for step in nothing.body] == ["input"]


def test_constants_are_results_of_every_row(lab, level, width):
    found = lab.compiled([()], lambda x: [casadi.SX(0.0), casadi.SX(-2.5)], [(), ()])(np.ones(width + 1), threads=1)
    assert [column.tolist() for column in found] == [[0.0] * (width + 1), [-2.5] * (width + 1)]


def test_structural_zeros_of_an_output_are_zero(lab, level):
    def function(x):
        sparse = casadi.SX(5, 1)
        sparse[1], sparse[4] = x[0], x[1] * 2
        return sparse

    found = lab.compiled([(2,)], function, [(5,)])(np.array([[3.0, 5.0], [1.0, 2.0]]), threads=1)
    np.testing.assert_array_equal(found, [[0, 3, 0, 0, 10], [0, 1, 0, 0, 4]])


def test_a_call_within_a_graph_is_refused_by_name():
    x = casadi.MX.sym("x")
    lookup = casadi.interpolant("table", "linear", [[0.0, 1.0, 2.0]], [0.0, 1.0, 4.0])
    with pytest.raises(UnsupportedError, match="'curve' is not made of scalar operations"):
        instructions(casadi.Function("curve", [x], [lookup(x)]))


def test_an_operation_without_a_name_here_is_refused():
    x = casadi.SX.sym("x")
    with pytest.raises(UnsupportedError, match=r"'shown' has an operation \(CasADi number \d+\)"):
        instructions(casadi.Function("shown", [x], [x.printme(casadi.SX(1))]))
