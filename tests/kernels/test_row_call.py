"""The built-in function of one row: the ufunc's numbers, or None, and never an object too many or too few."""

from __future__ import annotations

import gc
import sys
import threading

import casadi
import numpy as np
import pytest

from leg_dynamics.kernels import Argument, Solver, row_call
from leg_dynamics.kernels.row_call import has_row_call


@pytest.fixture(scope="module")
def product(lab):
    """(m, x) -> m x sqrt(x[0]), which fails where x[0] is negative."""

    def function(m, x):
        scale = casadi.sqrt(x[0])
        return casadi.vertcat(*(scale * (m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2]) for i in (0, 1)))

    return lab.compiled([(2, 3), (3,)], function, [(2,)], guards=lambda m, x: x[0], name="product")


@pytest.fixture(scope="module")
def outer(lab):
    """(x, y) -> x y^T."""

    def function(x, y):
        return casadi.vertcat(*(x[i] * y[j] for i in range(2) for j in range(3)))

    return lab.compiled([(2,), (3,)], function, [(2, 3)], name="outer")


@pytest.fixture
def row():
    generator = np.random.default_rng(1)
    return generator.normal(size=(2, 3)), np.abs(generator.normal(size=3))


def test_it_gives_the_numbers_of_the_ufunc(lab, level):
    kernel = lab.compiled([(3,), (3,)], lambda x, y: casadi.sin(x) * casadi.atan2(y, x), [(3,)])
    generator = np.random.default_rng(2)
    for x, y in generator.normal(scale=5.0, size=(50, 2, 3)):
        lab.assert_same_bits(kernel.row(x, y), kernel.ufunc(x, y))


def test_results_are_new_arrays_of_the_core_shape(lab, product, outer, row):
    found = product.row(*row)
    assert (type(found), found.shape, found.dtype) == (np.ndarray, (2,), np.float64)
    assert found.flags.owndata
    assert found.flags.writeable
    lab.assert_same_bits(found, product.ufunc(*row))
    assert product.row(*row) is not found
    x, y = np.array([1.0, -2.0]), np.array([3.0, 5.0, -0.0])
    lab.assert_same_bits(outer.row(x, y), np.outer(x, y))
    assert outer.row(x, y).strides == (24, 8)


def test_it_has_the_name_of_the_kernel(product):
    assert product.row.__name__ == "product"


def test_a_result_array_is_filled_and_returned(lab, outer):
    x, y = np.array([1.0, -2.0]), np.array([3.0, 5.0, 7.0])
    out = np.full((2, 3), np.nan)
    assert outer.row(x, y, out) is out
    lab.assert_same_bits(out, np.outer(x, y))


def test_a_result_array_may_be_an_input(lab):
    kernel = lab.compiled([(3,)], lambda x: casadi.vertcat(x[2], x[0], x[1]), [(3,)])
    x = np.array([1.0, 2.0, 3.0])
    assert kernel.row(x, x) is x
    np.testing.assert_array_equal(x, [3.0, 1.0, 2.0])


def test_a_failed_row_is_none_is_counted_and_leaves_the_result_array(product, row):
    m, x = row
    before = product.counter[0]
    out = np.array([7.0, 8.0])
    for bad in (x * [-1, 1, 1], x * np.nan, x * [1, np.inf, 1]):
        assert product.row(m, bad) is None
        assert product.row(m, bad, out) is None
    np.testing.assert_array_equal(out, [7.0, 8.0])
    assert product.counter[0] == before + 6
    assert product.row(m, x) is not None


def _read_only(array):
    array = array.copy()
    array.setflags(write=False)
    return array


class Special(np.ndarray):
    pass


def _unaligned(array):
    raw = np.zeros(array.nbytes + 1, dtype=np.uint8)[1:]
    result = raw.view(np.float64).reshape(array.shape)
    result[...] = array
    return result


@pytest.mark.parametrize(
    "change",
    [
        lambda m, x: (),
        lambda m, x: (m,),
        lambda m, x: (m, x, np.zeros(2), np.zeros(2)),
        lambda m, x: (m.tolist(), x),
        lambda m, x: (m, x.tolist()),
        lambda m, x: (m, None),
        lambda m, x: (m, 1.0),
        lambda m, x: (m, x.astype(np.float32)),
        lambda m, x: (m, x.astype(">f8")),
        lambda m, x: (m, x.astype(np.int64)),
        lambda m, x: (m, x.astype(object)),
        lambda m, x: (m, x[None]),
        lambda m, x: (m, x[:2]),
        lambda m, x: (m, np.array(1.0)),
        lambda m, x: (m, x[::-1]),
        lambda m, x: (m, np.repeat(x, 2)[::2]),
        lambda m, x: (np.asfortranarray(m), x),
        lambda m, x: (m.T, x),
        lambda m, x: (m.ravel(), x),
        lambda m, x: (m, _unaligned(x)),
        lambda m, x: (m, x.view(Special)),
        lambda m, x: (m, np.ma.masked_array(x)),
        lambda m, x: (m, x, None),
        lambda m, x: (m, x, np.zeros(3)),
        lambda m, x: (m, x, np.zeros((1, 2))),
        lambda m, x: (m, x, np.zeros(2, dtype=np.float32)),
        lambda m, x: (m, x, np.zeros(4)[::2]),
        lambda m, x: (m, x, _read_only(np.zeros(2))),
        lambda m, x: (m, x, (np.zeros(2),)),
    ],
)
def test_other_arguments_are_declined_without_being_computed(product, row, change):
    before = product.counter[0]
    assert product.row(*change(*row)) is None
    assert product.counter[0] == before


def test_it_takes_no_keywords(product, row):
    with pytest.raises(TypeError):
        product.row(*row, out=np.zeros(2))


def test_read_only_inputs_will_do(product, row):
    assert product.row(*map(_read_only, row)) is not None


def test_references_are_neither_lost_nor_kept(product, row):
    m, x = row
    out = np.zeros(2)
    watched = (None, np.dtype(np.float64), np.ndarray, m, x, out)

    def counts():
        gc.collect()
        return [sys.getrefcount(thing) for thing in watched]

    before = counts()
    for _ in range(2000):
        product.row(m, x)
        product.row(m, x, out)
        product.row(m, -x)
        product.row(m)
    for earlier, later in zip(before, counts(), strict=True):
        assert abs(later - earlier) < 100


def test_it_outlives_its_kernel(lab):
    kernel = lab.compiled([(2,)], lambda x: 2 * x, [(2,)])
    function = kernel.row
    del kernel
    gc.collect()
    np.testing.assert_array_equal(function(np.array([1.0, 2.0])), [2.0, 4.0])


def test_threads_may_share_it(lab, product, row):
    expected = product.ufunc(*row)
    wrong = []

    def work():
        for _ in range(3000):
            found = product.row(*row)
            if found is not None and not np.array_equal(found, expected):
                wrong.append(found)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.parametrize(
    ("inputs", "outputs", "expected"),
    [
        ([(3,)], [(3,)], True),
        ([(3,), (2, 4)], [(2, 2)], True),
        ([(3,), ()], [(3,)], False),
        ([(3,)], [()], False),
        ([(3,)], [(3,), (3,)], False),
        ([(3,), (0,)], [(3,)], False),
        ([], [(3,)], False),
        ([(3,)], [(512,)], True),
        ([(3,)], [(27, 19)], False),
    ],
)
def test_which_kernels_have_one(inputs, outputs, expected):
    sides = [[Argument(f"x{k}", shape) for k, shape in enumerate(side)] for side in (inputs, outputs)]
    assert has_row_call(*sides) is expected


def test_a_kernel_of_several_results_has_none(lab):
    assert lab.compiled([(2,)], lambda x: [x, 2 * x], [(2,), (2,)]).row is None


def test_none_where_arrays_are_laid_out_otherwise(lab, monkeypatch):
    monkeypatch.setattr(row_call, "_DATA", 32)
    row_call._layout_holds.cache_clear()
    try:
        kernel = lab.compiled([(2,)], lambda x: 3 * x, [(2,)])
        assert kernel.row is None
        np.testing.assert_array_equal(kernel(np.array([1.0, 2.0])), [3.0, 6.0])
    finally:
        monkeypatch.undo()
        row_call._layout_holds.cache_clear()
    assert row_call._layout_holds()


def test_a_solver_before_the_formula(lab):
    """z^2 = x, by Newton from 1."""
    x, s, z = casadi.SX.sym("x", 2), casadi.SX.sym("s"), casadi.SX.sym("z", 2)
    target = 1 + s * (x - 1)
    residual = z**2 - target
    solver = Solver(
        2,
        casadi.Function("start", [x], [casadi.SX.ones(2)]),
        casadi.Function("stages", [x], [casadi.SX(4)]),
        casadi.Function("step", [x, s, z], [residual / (2 * z), casadi.norm_inf(residual)]),
        tolerance=1e-9,
    )
    kernel = lab.compiled([(2,)], lambda x, z: z, [(2,)], solver=solver)
    np.testing.assert_allclose(kernel.row(np.array([4.0, 9.0])), [2.0, 3.0], rtol=1e-12)
    assert kernel.row(np.array([-4.0, 9.0])) is None
