"""Rows in and out of vectors, failing rows, and the count of them, on every level of vector instructions."""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import itertools
import math
import re
import threading

import casadi
import numpy as np
import pytest

from leg_dynamics.kernels import assembly as assembly_module
from leg_dynamics.kernels.assembly import _MOST_INTERLEAVED, assembly, block_rows
from leg_dynamics.kernels.machine_code import compile_object, load_object
from leg_dynamics.kernels.target import host_target, target_for

# Up to nine components are turned by shuffles, more through a buffer.
SHAPES = [(), (1,), (2,), (3,), (9,), (10,), (13,), (3, 3), (4, 3), (1, 3), (2, 1, 2)]


def layouts(array, core):
    """The same numbers in memory in other ways."""
    axes = array.ndim - core
    yield array
    yield np.repeat(array, 3, axis=0)[::3]
    yield array[::-1].copy()[::-1]
    yield np.asfortranarray(array)
    wide = np.full((*array.shape, 2), np.nan)
    wide[..., 0] = array
    yield wide[..., 0]
    if core > 1:
        yield np.ascontiguousarray(np.moveaxis(array, -1, axes)).swapaxes(-1, axes).reshape(array.shape)
        yield np.moveaxis(np.ascontiguousarray(np.moveaxis(array, -1, axes)), axes, -1)
    packed = np.zeros(array.shape, dtype=[("pad", "i1"), ("x", "f8")])
    packed["x"] = array
    yield packed["x"]


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_every_number_of_rows_in_every_layout(lab, level, width, shape):
    kernel = lab.compiled([shape, ()], lambda x, y: [x * y, casadi.sumsqr(x) - y], [shape, ()])
    generator = np.random.default_rng(0)
    for count in range(2 * width + 2):
        x, y = generator.normal(size=(count, *shape)), generator.normal(size=count)
        products = x * y.reshape(count, *(1,) * len(shape))
        for form in layouts(x, len(shape)):
            np.testing.assert_array_equal(form, x)
            found, sums = kernel(form, y, threads=1)
            lab.assert_same_bits(found, products)
            np.testing.assert_allclose(sums, (x**2).sum(axis=tuple(range(1, x.ndim))) - y, rtol=0, atol=1e-13)
    assert kernel.counter[0] == 0


@pytest.mark.parametrize("shape", [(), (3,), (13,), (3, 3)], ids=str)
def test_results_go_where_out_says_and_nowhere_else(lab, level, width, shape):
    kernel = lab.compiled([shape], lambda x: 2 * x, [shape])
    for count in range(2 * width + 2):
        x = np.random.default_rng(count).normal(size=(count, *shape))
        for step, reverse, ending in itertools.product((1, 2), (False, True), ((), (2,))):
            memory = np.full((step * count + 16, *shape, *ending), 7.0)
            place = memory[8 : 8 + step * count : step]
            place = place[::-1] if reverse else place
            place = place[..., 1] if ending else place
            assert kernel(x, out=place, threads=1) is place
            lab.assert_same_bits(place, 2 * x)
            place[...] = 7.0
            assert np.all(memory == 7.0)


def test_a_row_is_the_same_alone_and_at_any_place_of_a_batch(lab, level, width):
    def function(x):
        angle = casadi.atan2(casadi.sin(x[0]), casadi.tan(x[1]))
        return casadi.vertcat(angle, casadi.asin(x[2]) * casadi.exp(x[0]), casadi.sqrt(casadi.fabs(x[1])), angle / x[2])

    kernel = lab.compiled([(3,)], function, [(4,)])
    rows = np.random.default_rng(1).uniform(-0.99, 0.99, (2 * width + 1, 3))
    alone = np.array([kernel(row) for row in rows])
    for count in range(1, len(rows) + 1):
        lab.assert_same_bits(kernel(rows[:count], threads=1), alone[:count])
        lab.assert_same_bits(kernel(rows[-count:], threads=1), alone[-count:])
    order = np.random.default_rng(2).permutation(len(rows))
    lab.assert_same_bits(kernel(rows[order], threads=1), alone[order])
    lab.assert_same_bits(kernel(rows[::-1], threads=1), alone[::-1])


@pytest.fixture
def guarded(lab, level):
    """(x, y) -> x sqrt(y) and (x y, x / y, 1), valid while x <= 3 and the second guard is a number."""

    def guards(x, y):
        return casadi.vertcat(3 - x, casadi.sqrt(y[1]))

    def function(x, y):
        return [x * casadi.sqrt(y[0]), casadi.vertcat(x * y[0], x / y[0], 1)]

    return lab.compiled([(), (2,)], function, [(), (3,)], guards=guards)


BAD_ROWS = {
    "NaN": (math.nan, 1.0, 1.0),
    "infinity": (1.0, math.inf, 1.0),
    "negative infinity": (1.0, 1.0, -math.inf),
    "NaN that no output sees": (1.0, 1.0, math.nan),
    "negative guard": (np.nextafter(3.0, 4.0), 1.0, 1.0),
    "NaN guard": (1.0, 1.0, -1.0),
    "NaN in one output": (1.0, -1.0, 1.0),
    "division by zero": (1.0, 0.0, 1.0),
    "overflow": (-1.7e308, 1.7e308, 1.0),
    "signalling NaN": (np.array([0x7FF0000000000001], dtype=np.uint64).view(float)[0], 1.0, 1.0),
}


@pytest.mark.parametrize("bad", BAD_ROWS.values(), ids=BAD_ROWS)
def test_a_row_that_fails_is_nan_throughout_and_leaves_the_others_alone(lab, guarded, width, bad):
    for count in (1, 2, width, width + 1, 2 * width + 1):
        good = np.random.default_rng(count).uniform(0.1, 3.0, (count, 3))
        clean = guarded(good[:, 0], good[:, 1:], threads=1)
        for place in range(count):
            rows = good.copy()
            rows[place] = bad
            before = guarded.counter[0]
            results = guarded(rows[:, 0], rows[:, 1:], threads=1)
            assert guarded.counter[0] - before == 1
            for found, expected in zip(results, clean, strict=True):
                assert np.isnan(found[place]).all()
                others = np.arange(count) != place
                lab.assert_same_bits(found[others], expected[others])


def test_guards_at_zero_of_both_signs_hold(lab, level):
    kernel = lab.compiled([()], lambda x: x, guards=lambda x: x)
    found = kernel(np.array([0.0, -0.0, 5e-324, -5e-324]), threads=1)
    assert np.isnan(found).tolist() == [False, False, False, True]


def test_the_largest_numbers_are_finite(lab, level):
    kernel = lab.compiled([(2,)], lambda x: x, [(2,)])
    rows = np.array([[1.7976931348623157e308, -1.7976931348623157e308], [5e-324, -0.0]])
    lab.assert_same_bits(kernel(rows, threads=1), rows)


def test_the_counter_counts_rows_and_not_what_fills_up_the_last_block(lab, level, width):
    kernel = lab.compiled([()], casadi.sqrt)
    total = 0
    for count in range(2 * width + 2):
        for failing in {0, 1, count // 2, count}:
            rows = np.ones(count)
            rows[count - failing :] = -1.0
            kernel(rows, threads=1)
            total += min(failing, count)
            assert kernel.counter[0] == total
    kernel(-1.0)
    assert kernel.counter[0] == total + 1
    # one row, broadcast
    kernel(np.broadcast_to(-1.0, 3 * width), threads=1)
    assert kernel.counter[0] == total + 1 + 3 * width


def test_the_counter_is_exact_under_threads(lab, level):
    kernel = lab.compiled([()], casadi.sqrt)
    rows = np.ones(30_001)
    rows[::7] = -1.0
    failing = int((rows < 0).sum())
    callers = [threading.Thread(target=lambda: [kernel(rows, threads=2) for _ in range(20)]) for _ in range(4)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert kernel.counter[0] == 4 * 20 * failing


def hostile_rows():
    values = [0.0, -0.0, 1.0, -1.0, 2.0, 5e-324, 1e-310, 1e308, -1e308, 1e5, 1e6, 1e300, math.inf, -math.inf, math.nan]
    return np.array(list(itertools.product(values, values)))


def hostile(x, y):
    terms = [casadi.sqrt(x), casadi.asin(x), casadi.acos(y), x / y, x * y, casadi.exp(x), casadi.log(y), x**y]
    terms += [casadi.sin(x), casadi.tan(y), casadi.atan2(x, y), casadi.floor(x), casadi.if_else(x > y, x, y), x - y]
    return casadi.vertcat(*terms)


def test_no_floating_point_error_whatever_the_rows_hold(lab, level):
    kernel = lab.compiled([(), ()], hostile, [(14,)])
    rows = hostile_rows()
    with np.errstate(all="raise"):
        found = kernel(*rows.T, threads=1)
        for row in rows:
            kernel(*row)
    assert np.isnan(found).all(axis=1).sum() == kernel.counter[0] / 2


@pytest.mark.skipif(not host_target().is_x86, reason="other machines clear the flags")
def test_flags_of_earlier_operations_are_kept_and_none_are_added(lab, level):
    invalid, by_zero, overflow = 1, 4, 8
    library = ctypes.CDLL(ctypes.util.find_library("m"))
    program = lab.program([(), ()], hostile, [(14,)])
    target = host_target()
    loaded = load_object(compile_object(assembly(program, target), target), target)
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)(loaded.address)
    x, y = hostile_rows().T.copy()
    out = np.empty((len(x), 14))
    addresses = (ctypes.c_void_p * 3)(*(array.ctypes.data for array in (x, y, out)))
    dimensions = (ctypes.c_ssize_t * 2)(len(x), 14)
    strides = (ctypes.c_ssize_t * 4)(8, 8, 14 * 8, 8)
    failures = ctypes.c_int64(0)
    for earlier in (0, by_zero, invalid | overflow):
        library.feclearexcept(31)
        library.feraiseexcept(earlier)
        call(addresses, dimensions, strides, ctypes.byref(failures))
        assert library.fetestexcept(invalid | by_zero | overflow) == earlier
    library.feclearexcept(31)
    assert failures.value > 0


@pytest.mark.parametrize("name", ["avx512", "avx2", "sse2", "neon"])
def test_assembly_is_the_same_whenever_it_is_written(lab, name):
    target = target_for(name, "aarch64-unknown-linux-gnu" if name == "neon" else "x86_64-unknown-linux-gnu")
    first, second = (assembly(lab.program([(3,)], lambda x: casadi.sin(x) * x, [(3,)]), target) for _ in range(2))
    assert first == second
    assert ("llvm.fma" in first) == (name != "sse2")
    # no flag lets LLVM change a result
    assert not re.search(r"\bf(add|sub|mul|div|cmp|neg)\s+(fast|nnan|ninf|nsz|arcp|contract|afn|reassoc)\b", first)


@pytest.mark.parametrize(("level", "short", "long"), [("avx512", 8, 8), ("avx2", 8, 4), ("sse2", 2, 2), ("neon", 2, 2)])
def test_short_formulas_take_two_vectors_side_by_side(lab, level, short, long):
    def chain(length):
        return lab.program([()], lambda x: functools.reduce(lambda y, _: y * x + 1.0, range(length), x))

    target = target_for(level, "x86_64-unknown-linux-gnu")
    over = 1
    while chain(over).formula.n_instructions() <= _MOST_INTERLEAVED:
        over += 1
    assert block_rows(chain(over - 1), target) == short
    assert block_rows(chain(over), target) == long


def test_both_numbers_of_vectors_give_the_same_to_the_bit(lab, level, monkeypatch):
    rows = np.random.default_rng(0).uniform(-3.0, 3.0, (101, 3))

    def formula(x):
        return [casadi.sin(x) * casadi.sqrt(x[0] + 2.0), casadi.atan2(x[1], x[2]) / x[0]]

    wide = lab.compiled([(3,)], formula, [(3,), ()])(rows)
    monkeypatch.setattr(assembly_module, "_MOST_INTERLEAVED", 0)
    narrow = lab.compiled([(3,)], formula, [(3,), ()])(rows)
    for one, other in zip(wide, narrow, strict=True):
        np.testing.assert_array_equal(one, other)
