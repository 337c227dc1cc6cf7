"""Kernels behave as NumPy's own generalised ufuncs do."""

from __future__ import annotations

import gc

import casadi
import numpy as np
import pytest


@pytest.fixture(scope="module")
def affine(lab):
    """(m, x, b) -> m x + b, |m x + b|^2."""

    def function(m, x, b):
        y = casadi.vertcat(*(m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2] for i in range(2))) + b
        return [y, casadi.sumsqr(y)]

    return lab.compiled([(2, 3), (3,), ()], function, [(2,), ()], name="affine")


def reference(m, x, b):
    y = np.einsum("...ij,...j->...i", m, x) + np.asarray(b)[..., None]
    return y, (y**2).sum(axis=-1)


def assert_affine(found, *inputs):
    for value, expected in zip(found, reference(*map(np.asarray, inputs)), strict=True):
        assert value.shape == expected.shape
        assert value.dtype == np.float64
        np.testing.assert_allclose(value, expected, rtol=1e-13, atol=1e-13)


@pytest.fixture
def generator():
    return np.random.default_rng(0)


def test_it_is_a_ufunc_with_a_signature_and_a_text(affine):
    assert isinstance(affine.ufunc, np.ufunc)
    assert affine.ufunc.signature == affine.signature == "(2,3),(3),()->(2),()"
    assert (affine.ufunc.nin, affine.ufunc.nout, affine.ufunc.types) == (3, 2, ["ddd->dd"])
    assert affine.ufunc.__name__ == "affine"
    assert "x0, x1, x2 -> y0, y1" in affine.ufunc.__doc__
    assert repr(affine) == "<Kernel affine (2,3),(3),()->(2),() by llvm>"


@pytest.mark.parametrize(
    "leading",
    [
        ((), (), ()),
        ((7,), (7,), (7,)),
        ((5, 1), (1, 4), (4,)),
        ((), (6,), ()),
        ((3, 1, 2), (4, 1), ()),
        ((1,), (9,), (1,)),
        ((0,), (0,), (0,)),
        ((0, 3), (3,), ()),
        ((2, 0), (2, 1), (1,)),
    ],
    ids=str,
)
@pytest.mark.parametrize("threads", [1, 2, None])
def test_leading_dimensions_broadcast(affine, generator, leading, threads):
    inputs = [generator.normal(size=outer + core) for outer, core in zip(leading, ((2, 3), (3,), ()), strict=True)]
    assert_affine(affine(*inputs, threads=threads), *inputs)


def test_a_single_row_gives_numbers(affine, lab, generator):
    _, norm = affine(generator.normal(size=(2, 3)), generator.normal(size=3), 1.0)
    assert type(norm) is np.float64
    assert type(lab.compiled([()], lambda x: 2 * x)(3)) is np.float64


def test_strides_of_zero_and_below(affine, generator):
    m = np.broadcast_to(generator.normal(size=(2, 3)), (11, 2, 3))
    x = np.broadcast_to(generator.normal(size=(11, 1)), (11, 3))
    b = generator.normal(size=22)[::-2]
    assert_affine(affine(m, x, b), m, x, b)
    assert_affine(affine(m[::-1, ::-1, ::-1], x[::-1], b[::-1]), m[::-1, ::-1, ::-1], x[::-1], b[::-1])


def test_transposed_core_dimensions(affine, generator):
    m = generator.normal(size=(3, 2, 10)).T
    x = generator.normal(size=(3, 10)).T
    assert_affine(affine(m, x, 0.5), m, x, 0.5)


@pytest.mark.parametrize("kind", ["?", "i1", "u8", "i8", "f2", "f4", ">f8"])
def test_other_numbers_are_cast(affine, generator, kind):
    m = generator.integers(0, 2, (5, 2, 3)).astype(kind)
    x = generator.integers(0, 2, (5, 3)).astype(kind)
    assert_affine(affine(m, x, np.ones(5, kind)), m.astype(float), x.astype(float), np.ones(5))
    assert_affine(affine(m.tolist(), x.tolist(), [1] * 5), m.astype(float), x.astype(float), np.ones(5))


@pytest.mark.parametrize(
    "bad", [1j, "1.0", object(), np.longdouble(1)], ids=["complex", "text", "object", "longdouble"]
)
@pytest.mark.parametrize("threads", [1, 2])
def test_what_is_not_a_double_is_refused(lab, bad, threads):
    kernel = lab.compiled([()], lambda x: 2 * x)
    with pytest.raises(TypeError):
        kernel(np.array([bad] * 4), threads=threads)


@pytest.mark.parametrize(
    "shapes",
    [
        ((2, 3), (4,), ()),
        ((3, 2), (3,), ()),
        ((3,), (3,), ()),
        ((2, 3), (), ()),
        ((5, 2, 3), (4, 3), ()),
        ((5, 2, 3), (5, 3), (4,)),
        ((2, 1), (3,), ()),
    ],
    ids=str,
)
@pytest.mark.parametrize("threads", [1, 2, None])
def test_wrong_shapes_are_refused(affine, shapes, threads):
    with pytest.raises(ValueError, match=r"mismatch|enough dimensions|broadcast"):
        affine(*map(np.ones, shapes), threads=threads)


@pytest.mark.parametrize("threads", [1, 2, None])
def test_wrong_numbers_of_arguments_are_refused(affine, threads):
    with pytest.raises(TypeError, match="argument"):
        affine(np.ones((2, 3)), np.ones(3), threads=threads)
    with pytest.raises(TypeError, match="argument"):
        affine(*[np.ones(3)] * 6, threads=threads)


@pytest.mark.parametrize("threads", [1, 2, None])
def test_out_receives_the_results(affine, generator, threads):
    m, x, b = generator.normal(size=(8, 2, 3)), generator.normal(size=(8, 3)), generator.normal(size=8)
    out = np.empty((8, 2)), np.empty(8)
    found = affine(m, x, b, out=out, threads=threads)
    assert found[0] is out[0]
    assert found[1] is out[1]
    assert_affine(out, m, x, b)
    # one of them, another layout, another type, a subclass
    second = np.empty(8, np.float32)
    first, found = affine(m, x, b, out=(None, second), threads=threads)
    assert found is second
    np.testing.assert_allclose(second, reference(m, x, b)[1], rtol=1e-6)
    transposed = np.empty((2, 8)).T
    found = affine(m, x, b, out=(transposed, None), threads=threads)
    assert found[0] is transposed
    np.testing.assert_array_equal(transposed, first)


@pytest.mark.parametrize("threads", [1, 2, None])
def test_wrong_out_is_refused(affine, lab, threads):
    inputs = np.ones((8, 2, 3)), np.ones((8, 3)), np.ones(8)
    with pytest.raises(ValueError, match=r"mismatch|broadcast"):
        affine(*inputs, out=(np.empty((8, 3)), np.empty(8)), threads=threads)
    with pytest.raises(ValueError, match=r"mismatch|broadcast"):
        affine(*inputs, out=(np.empty((7, 2)), np.empty(7)), threads=threads)
    with pytest.raises((TypeError, ValueError)):
        affine(*inputs, out=(np.empty((8, 2)),), threads=threads)
    with pytest.raises(TypeError):
        affine(*inputs, out=(np.empty((8, 2), int), np.empty(8)), threads=threads)
    fixed = np.empty((8, 3))
    fixed.flags.writeable = False
    with pytest.raises(ValueError, match="read-only"):
        lab.compiled([(3,)], lambda x: 2 * x, [(3,)])(np.ones((8, 3)), out=fixed, threads=threads)


OVERLAPS = {
    "same": lambda a: (a[:-1], a[:-1]),
    "one on": lambda a: (a[:-1], a[1:]),
    "one back": lambda a: (a[1:], a[:-1]),
    "reversed": lambda a: (a[::-1], a),
    "first row": lambda a: (a[:1], a),
    "last row": lambda a: (a[-1], a),
    "half a row on": lambda a: (a.reshape(-1)[1:-2].reshape(-1, 3), a[:-1]),
    "transposed": lambda a: (a[:3].T, a[:3]),
}


@pytest.mark.parametrize("overlap", OVERLAPS.values(), ids=OVERLAPS)
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_out_may_overlap_the_inputs(lab, overlap, threads):
    kernel = lab.compiled([(3,)], lambda x: casadi.vertcat(x[1] + 1, x[2] * 2, x[0] - 3), [(3,)])
    for count in (4, 9, 33, 20_000):
        memory = np.random.default_rng(count).normal(size=(count, 3))
        expected = kernel(overlap(memory)[0].copy(), threads=1)
        source, place = overlap(memory)
        kernel(source, out=place, threads=threads)
        np.testing.assert_array_equal(place, np.broadcast_to(expected, place.shape))


def test_axes_keywords_of_numpy_work(affine, generator):
    m, x = generator.normal(size=(2, 3, 5)), generator.normal(size=(3, 5))
    found = affine.ufunc(m, x, 1.0, axes=[(0, 1), (0,), (), (0,), ()])
    expected = reference(np.moveaxis(m, -1, 0), x.T, 1.0)
    np.testing.assert_allclose(found[0], expected[0].T)
    np.testing.assert_allclose(found[1], expected[1])


def test_a_gufunc_outlives_its_kernel(lab):
    ufunc = lab.compiled([()], lambda x: casadi.sin(x) + 12.25, name="outlives").ufunc
    gc.collect()
    assert ufunc(np.zeros(3)).tolist() == [12.25] * 3


def test_unaligned_memory(affine, generator):
    m, b = generator.normal(size=(9, 2, 3)), generator.normal(size=9)
    buffer = np.zeros(9 * 3 * 8 + 1, dtype=np.uint8)
    x = buffer[1:].view(np.float64).reshape(9, 3)
    x[...] = generator.normal(size=(9, 3))
    assert not x.flags.aligned
    assert_affine(affine(m, x, b), m, x, b)


def test_kernels_do_not_disturb_each_other(lab):
    first = lab.compiled([()], lambda x: x + 1, name="first")
    second = lab.compiled([()], lambda x: x + 2, name="second")
    assert (first(1.0), second(1.0), first(1.0)) == (2.0, 3.0, 2.0)
    first(np.array([np.nan, 1.0]))
    assert (first.counter[0], second.counter[0]) == (1, 0)
