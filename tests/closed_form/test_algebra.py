from __future__ import annotations

import math

import casadi
import numpy as np
import pytest

from leg_dynamics.closed_form import algebra

UNARY = {
    "sin": (math.sin, (-2.0, 3.0)),
    "cos": (math.cos, (-2.0, 3.0)),
    "sqrt": (math.sqrt, (0.0, 9.0)),
    "asin": (math.asin, (-1.0, 1.0)),
    "acos": (math.acos, (-1.0, 1.0)),
    "fabs": (abs, (-2.0, 2.0)),
    "sign": (lambda x: (x > 0) - (x < 0), (-2.0, 2.0)),
}
BINARY = {"atan2": math.atan2, "fmin": min, "fmax": max}


@pytest.mark.parametrize("name", UNARY)
def test_unary_functions_agree_on_floats_arrays_and_symbols(name):
    expected, (low, high) = UNARY[name]
    values = np.append(np.linspace(low, high, 11), 0.0)
    function = getattr(algebra, name)
    x = casadi.SX.sym("x")
    traced = casadi.Function("f", [x], [function(x)])
    for value in values.tolist():
        assert isinstance(function(value), float)
        assert function(value) == pytest.approx(expected(value), abs=1e-15)
        assert float(traced(value)) == pytest.approx(expected(value), abs=1e-15)
    np.testing.assert_allclose(function(values), [expected(v) for v in values.tolist()], atol=1e-15)


@pytest.mark.parametrize("name", BINARY)
def test_binary_functions_agree_and_mix_arrays_with_floats(name):
    function, expected = getattr(algebra, name), BINARY[name]
    x = casadi.SX.sym("x")
    values = np.array([-1.5, 0.2, 2.5])
    np.testing.assert_allclose(function(values, 0.7), [expected(v, 0.7) for v in values.tolist()], rtol=1e-15)
    np.testing.assert_allclose(function(0.7, values), [expected(0.7, v) for v in values.tolist()], rtol=1e-15)
    for value in values.tolist():
        assert function(value, 0.7) == expected(value, 0.7)
        assert float(casadi.Function("f", [x], [function(0.7, x)])(value)) == pytest.approx(expected(0.7, value))


@pytest.mark.parametrize(("name", "value"), [("sqrt", -1e-9), ("asin", 1.1), ("acos", -1.1)])
def test_outside_its_domain_a_function_is_nan_without_a_warning(name, value):
    function = getattr(algebra, name)
    x = casadi.SX.sym("x")
    assert math.isnan(function(value))
    assert np.isnan(function(np.array([value]))[0])
    assert np.isnan(float(casadi.Function("f", [x], [function(x)])(value)))


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.3, 0.3),
        (1.0, 1.0),
        (1.0 + 5e-13, 1.0),
        (-1.0 - 5e-13, -1.0),
        (1.0 + 2e-12, 1.0 + 2e-12),
        (-1.0 - 2e-12, -1.0 - 2e-12),
    ],
)
def test_where_domain_forgives_rounding_and_nothing_else(value, expected):
    x = casadi.SX.sym("x")
    assert algebra.where_domain(value, 1e-12) == expected
    assert algebra.where_domain(np.array([value]), 1e-12)[0] == expected
    assert float(casadi.Function("f", [x], [algebra.where_domain(x, 1e-12)])(value)) == expected


def test_vectors_and_matrices_agree_with_numpy():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 3))
    m, n = rng.normal(size=(2, 3, 3))
    ta, tb = tuple(a.tolist()), tuple(b.tolist())
    tm, tn = (tuple(map(tuple, x.tolist())) for x in (m, n))
    np.testing.assert_allclose(algebra.cross(ta, tb), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose(algebra.dot(ta, tb), a @ b, atol=1e-15)
    np.testing.assert_allclose(algebra.matvec(algebra.skew(ta), tb), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose(algebra.matmul(tm, tn), m @ n, atol=1e-14)
    np.testing.assert_allclose(algebra.transpose(tm), m.T, atol=0)
    np.testing.assert_allclose(algebra.rotate_tensor(tm, tn), m @ n @ m.T, atol=1e-14)
    np.testing.assert_allclose(algebra.determinant(tm), np.linalg.det(m), atol=1e-14)
    np.testing.assert_allclose(algebra.solve(tm, tb), np.linalg.solve(m, b), rtol=1e-12)
    np.testing.assert_allclose(algebra.total((ta, tb, ta)), 2 * a + b, atol=1e-15)
    np.testing.assert_allclose(algebra.subtract(ta, tb), a - b, atol=0)
    np.testing.assert_allclose(algebra.negate(ta), -a, atol=0)
    spd = m @ m.T + 0.1 * np.eye(3)
    symmetric = tuple(map(tuple, spd.tolist()))
    np.testing.assert_allclose(algebra.solve_symmetric(symmetric, tb), np.linalg.solve(spd, b), rtol=1e-12)


@pytest.mark.parametrize(
    ("rotation", "axis"), [(algebra.rotation_x, 0), (algebra.rotation_y, 1), (algebra.rotation_z, 2)]
)
def test_rotations_turn_right_handed_about_their_axis(rotation, axis):
    angle = 0.4
    matrix = np.array(rotation(math.sin(angle), math.cos(angle)))
    turned = matrix @ np.eye(3)[(axis + 1) % 3]
    np.testing.assert_allclose(matrix @ np.eye(3)[axis], np.eye(3)[axis], atol=0)
    np.testing.assert_allclose(turned[(axis + 2) % 3], math.sin(angle))
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-15)


def test_vectors_need_not_have_three_components():
    long, other = (1.0, 2.0, 3.0, 4.0), (0.5, -1.0, 2.0, 1.0)
    assert algebra.dot(long, other) == 8.5
    assert algebra.add(long, other) == (1.5, 1.0, 5.0, 5.0)
    assert algebra.scale(2.0, long) == (2.0, 4.0, 6.0, 8.0)
    assert algebra.matvec((long, other), long) == (30.0, 8.5)
    with pytest.raises(ValueError, match="zip"):
        algebra.add(long, (1.0, 2.0, 3.0))
