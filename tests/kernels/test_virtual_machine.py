"""What serves where LLVM is missing answers as the compiled kernels do."""

from __future__ import annotations

import threading

import casadi
import numpy as np
import pytest

from leg_dynamics.kernels.virtual_machine import VirtualMachine


def function(m, x):
    y = casadi.vertcat(m[0] * x[0] + m[1] * x[1], m[2] * x[0] + m[3] * x[1])
    return [y, casadi.sqrt(y[0]) / x[1]]


@pytest.fixture
def program(lab):
    return lab.program([(2, 2), (2,)], function, [(2,), ()], guards=lambda m, x: 1 - m[0])


@pytest.fixture
def compiled(lab):
    return lab.compiled([(2, 2), (2,)], function, [(2,), ()], guards=lambda m, x: 1 - m[0])


@pytest.fixture
def counter():
    return memoryview(bytearray(8)).cast("q")


@pytest.fixture
def slow(program, counter):
    return VirtualMachine(program, counter)


def rows(leading):
    generator = np.random.default_rng(0)
    m, x = generator.uniform(-0.5, 1.5, (*leading, 2, 2)), generator.uniform(0.1, 1.0, (*leading, 2))
    if x.size > 20:
        x.reshape(-1, 2)[[1, 4]] = [[np.nan, 1.0], [1.0, 0.0]]
        m.reshape(-1, 4)[2] = np.inf
    return m, x


@pytest.mark.parametrize("leading", [(), (1,), (50,), (4, 5), (3, 1, 7), (0,), (2, 0)], ids=str)
def test_same_results_shapes_and_count(lab, slow, compiled, counter, leading):
    m, x = rows(leading)
    before = compiled.counter[0]
    found, expected = slow(m, x), compiled(m, x, threads=1)
    assert counter[0] == compiled.counter[0] - before
    for value, reference in zip(found, expected, strict=True):
        assert type(value) is type(reference)
        assert np.shape(value) == np.shape(reference)
        np.testing.assert_allclose(value, reference, rtol=1e-15)


def test_broadcasting(lab, slow, compiled):
    m, x = rows((5, 1))[0], rows((4,))[1]
    for value, reference in zip(slow(m, x), compiled(m, x, threads=1), strict=True):
        lab.assert_same_bits(value, reference)
    with pytest.raises(ValueError, match="broadcast"):
        slow(rows((5,))[0], rows((4,))[1])


@pytest.mark.parametrize("shapes", [((2, 2), (3,)), ((2,), (2,)), ((3, 2), (2,)), ((2, 2), ())], ids=str)
def test_wrong_shapes_are_refused(slow, shapes):
    with pytest.raises(ValueError, match=r"example: x[01] has shape"):
        slow(*map(np.ones, shapes))


def test_other_numbers_are_cast_and_what_is_not_a_double_is_refused(slow):
    expected = slow(np.ones((3, 2, 2)), np.ones((3, 2)))
    for kind in (bool, np.int8, np.uint64, np.float32):
        np.testing.assert_array_equal(slow(np.ones((3, 2, 2), kind), np.ones((3, 2), kind))[0], expected[0])
    for bad in (np.ones(2, complex), np.array(["1", "2"]), np.array([None, 1]), np.ones(2, np.longdouble)):
        with pytest.raises(TypeError, match="does not convert to float64 safely"):
            slow(np.ones((2, 2)), bad)


def test_out_receives_the_results(lab, slow):
    m, x = rows((30,))
    expected = slow(m, x)
    out = np.zeros((30, 2)), np.zeros(60)[::2]
    for found in (slow(m, x, out=out), slow(m, x, *out)):
        for value, place, reference in zip(found, out, expected, strict=True):
            assert value is place
            lab.assert_same_bits(place, reference)
    first, second = slow(m, x, out=(None, out[1]))
    assert second is out[1]
    lab.assert_same_bits(first, expected[0])
    with pytest.raises(ValueError, match="broadcast"):
        slow(m, x, out=(np.zeros((29, 2)), np.zeros(30)))


def test_out_may_be_an_input(lab):
    program = lab.program([(2,)], lambda x: casadi.vertcat(x[1], x[0]), [(2,)])
    slow = VirtualMachine(program, memoryview(bytearray(8)).cast("q"))
    x = np.arange(10.0).reshape(5, 2)
    expected = x[:, ::-1].copy()
    assert slow(x, out=x) is x
    lab.assert_same_bits(x, expected)


def test_batches_longer_than_a_block(lab, slow, compiled):
    m, x = rows((9001,))
    for value, reference in zip(slow(m, x), compiled(m, x, threads=1), strict=True):
        lab.assert_same_bits(value, reference)


def test_no_floating_point_error_whatever_the_rows_hold(slow):
    with np.errstate(all="raise"):
        slow(np.full((3, 2, 2), 1e308), np.array([[1e308, 0.0], [np.nan, np.inf], [5e-324, -1e300]]))


def test_the_count_is_exact_under_threads(slow, counter):
    m, x = rows((200,))
    slow(m, x)
    once = counter[0]
    assert once > 0
    callers = [threading.Thread(target=lambda: [slow(m, x) for _ in range(10)]) for _ in range(4)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    assert counter[0] == once * 41


@pytest.mark.parametrize("out", [np.zeros(30, dtype=int), [0.0] * 30], ids=["integers", "list"])
def test_outputs_of_another_kind_are_refused_by_both(lab, out):
    program = lab.program([()], lambda x: 2 * x)
    compiled = lab.compiled([()], lambda x: 2 * x)
    slow = VirtualMachine(program, memoryview(np.zeros(1, dtype=np.int64)))
    x = np.linspace(0.0, 1.0, 30)
    for function_of_x in (slow, compiled):
        with pytest.raises(TypeError):
            function_of_x(x, out=out)
    assert not np.any(out)


def test_outputs_of_lower_precision_are_cast_by_both(lab):
    program = lab.program([()], lambda x: 2 * x)
    slow = VirtualMachine(program, memoryview(np.zeros(1, dtype=np.int64)))
    x, out = np.linspace(0.0, 1.0, 30), np.zeros(30, dtype=np.float32)
    np.testing.assert_array_equal(slow(x, out=out), (2 * x).astype(np.float32))
    np.testing.assert_array_equal(lab.compiled([()], lambda x: 2 * x)(x, out=out), (2 * x).astype(np.float32))
