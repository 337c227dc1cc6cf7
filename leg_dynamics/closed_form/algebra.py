"""Small algebra for formulas that run on floats, NumPy arrays and CasADi symbols alike.

A scalar is a Python float, a NumPy array (one entry a sample) or a CasADi symbol. A vector is a tuple of scalars, a
matrix is a tuple of rows. Elementary functions choose their library by the type of their arguments, never by their
value, so that the same formula computes one sample, a batch, or an expression graph. Outside its domain a function is
NaN on all three; formulas return the margin to the domain's edge as a value beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

import numpy as np

__all__ = [
    "IDENTITY",
    "ZERO",
    "Matrix",
    "Scalar",
    "Vector",
    "acos",
    "add",
    "asin",
    "atan2",
    "cos",
    "cross",
    "determinant",
    "dot",
    "fabs",
    "fmax",
    "fmin",
    "matmul",
    "matvec",
    "negate",
    "rotate_tensor",
    "rotation_x",
    "rotation_y",
    "rotation_z",
    "scale",
    "sign",
    "sin",
    "skew",
    "solve",
    "solve_symmetric",
    "sqrt",
    "subtract",
    "total",
    "transpose",
    "where",
    "where_domain",
]

Scalar: TypeAlias = Any
"""A float, a NumPy array, or a CasADi symbol."""
Vector: TypeAlias = tuple[Scalar, ...]
"""Components of a vector."""
Matrix: TypeAlias = tuple[Vector, ...]
"""Rows of a matrix."""

ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _is_casadi(value: Any) -> bool:
    return type(value).__module__.partition(".")[0] == "casadi"


def _sign_of_float(x: float) -> float:
    return math.copysign(1.0, x) if x else x


_ON_FLOATS: dict[str, Callable[..., float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "sqrt": math.sqrt,
    "asin": math.asin,
    "acos": math.acos,
    "atan2": math.atan2,
    "fabs": math.fabs,
    "sign": _sign_of_float,
    "fmin": min,
    "fmax": max,
}
_ON_ARRAYS: dict[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "sqrt": np.sqrt,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan2": np.arctan2,
    "fabs": np.abs,
    "sign": np.sign,
    "fmin": np.minimum,
    "fmax": np.maximum,
}


def _apply(name: str, *values: Scalar) -> Scalar:
    on_arrays = False
    for value in values:
        if isinstance(value, np.ndarray):
            on_arrays = True
        elif type(value) is not float and _is_casadi(value):
            import casadi

            return getattr(casadi, name)(*values)
    if on_arrays:
        with np.errstate(invalid="ignore"):
            return _ON_ARRAYS[name](*values)
    try:
        return _ON_FLOATS[name](*values)
    except ValueError:
        return math.nan


def sin(x: Scalar) -> Scalar:
    """Sine of an angle in rad."""
    return _apply("sin", x)


def cos(x: Scalar) -> Scalar:
    """Cosine of an angle in rad."""
    return _apply("cos", x)


def sqrt(x: Scalar) -> Scalar:
    """Square root; NaN for a negative argument."""
    return _apply("sqrt", x)


def asin(x: Scalar) -> Scalar:
    """Inverse sine in rad; NaN outside [-1, 1]."""
    return _apply("asin", x)


def acos(x: Scalar) -> Scalar:
    """Inverse cosine in rad; NaN outside [-1, 1]."""
    return _apply("acos", x)


def atan2(y: Scalar, x: Scalar) -> Scalar:
    """Angle of the point (x, y) in rad, in (-pi, pi]."""
    return _apply("atan2", y, x)


def fabs(x: Scalar) -> Scalar:
    """Absolute value."""
    return _apply("fabs", x)


def sign(x: Scalar) -> Scalar:
    """-1, 0 or 1."""
    return _apply("sign", x)


def fmin(x: Scalar, y: Scalar) -> Scalar:
    """Return the smaller of two numbers, neither of them NaN."""
    return _apply("fmin", x, y)


def fmax(x: Scalar, y: Scalar) -> Scalar:
    """Return the larger of two numbers, neither of them NaN."""
    return _apply("fmax", x, y)


def where(condition: Scalar, if_true: Scalar, if_false: Scalar) -> Scalar:
    """Choose between two values, sample by sample."""
    if any(_is_casadi(value) for value in (condition, if_true, if_false)):
        import casadi

        return casadi.if_else(condition, if_true, if_false)
    if isinstance(condition, np.ndarray):
        return np.where(condition, if_true, if_false)
    return if_true if condition else if_false


def where_domain(x: Scalar, tolerance: float) -> Scalar:
    """Argument of an inverse sine or cosine, where an excess over 1 up to `tolerance` is taken for rounding.

    Inside the tolerance the argument counts as -1 or 1; beyond it, it is passed on unchanged, so that the inverse
    function answers NaN.
    """
    return where(fabs(x) <= 1.0 + tolerance, fmin(fmax(x, -1.0), 1.0), x)


def add(a: Vector, b: Vector) -> Vector:
    """Sum of two vectors."""
    if len(a) == len(b) == 3:  # written out: most vectors have three components, and loops cost a sample half its time
        return a[0] + b[0], a[1] + b[1], a[2] + b[2]
    return tuple(x + y for x, y in zip(a, b, strict=True))


def subtract(a: Vector, b: Vector) -> Vector:
    """Difference of two vectors."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def negate(a: Vector) -> Vector:
    """Opposite of a vector."""
    return tuple(-x for x in a)


def scale(factor: Scalar, a: Vector) -> Vector:
    """Vector times a scalar."""
    if len(a) == 3:
        return factor * a[0], factor * a[1], factor * a[2]
    return tuple(factor * x for x in a)


def total(vectors: Iterable[Vector]) -> Vector:
    """Sum of several vectors."""
    first, *others = vectors
    for other in others:
        first = add(first, other)
    return first


def dot(a: Vector, b: Vector) -> Scalar:
    """Scalar product."""
    if len(a) == len(b) == 3:
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    result = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        result = result + x * y
    return result


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product a x b of two vectors of three components."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def skew(a: Vector) -> Matrix:
    """Matrix of the map b -> a x b."""
    return (0.0, -a[2], a[1]), (a[2], 0.0, -a[0]), (-a[1], a[0], 0.0)


def transpose(a: Matrix) -> Matrix:
    """Transpose; it also turns a tuple of columns into a matrix."""
    return tuple(zip(*a, strict=True))


def matvec(a: Matrix, b: Vector) -> Vector:
    """Matrix times vector."""
    return tuple([dot(row, b) for row in a])


def matmul(a: Matrix, b: Matrix) -> Matrix:
    """Matrix product."""
    columns = transpose(b)
    return tuple([matvec(columns, row) for row in a])


def rotate_tensor(rotation: Matrix, tensor: Matrix) -> Matrix:
    """R I R^T: a tensor given in a body's frame, expressed in the frame that `rotation` leads to."""
    return matmul(matmul(rotation, tensor), transpose(rotation))


def rotation_x(sine: Scalar, cosine: Scalar) -> Matrix:
    """Rotation about x by the angle of that sine and cosine."""
    return (1.0, 0.0, 0.0), (0.0, cosine, -sine), (0.0, sine, cosine)


def rotation_y(sine: Scalar, cosine: Scalar) -> Matrix:
    """Rotation about y by the angle of that sine and cosine."""
    return (cosine, 0.0, sine), (0.0, 1.0, 0.0), (-sine, 0.0, cosine)


def rotation_z(sine: Scalar, cosine: Scalar) -> Matrix:
    """Rotation about z by the angle of that sine and cosine."""
    return (cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)


def determinant(a: Matrix) -> Scalar:
    """Determinant of a 3 x 3 matrix."""
    return dot(a[0], cross(a[1], a[2]))


def solve(a: Matrix, b: Vector) -> Vector:
    """Solution x of a x = b for a 3 x 3 matrix, by cofactors; meaningless where the determinant vanishes."""
    columns = transpose(a)
    cofactors = (cross(columns[1], columns[2]), cross(columns[2], columns[0]), cross(columns[0], columns[1]))
    inverse_determinant = 1.0 / dot(columns[0], cofactors[0])
    return tuple(dot(cofactor, b) * inverse_determinant for cofactor in cofactors)


def solve_symmetric(a: Matrix, b: Vector) -> Vector:
    """Solution x of a x = b for a symmetric positive definite 3 x 3 matrix, as L D L^T written out."""
    d0 = a[0][0]
    l10, l20 = a[0][1] / d0, a[0][2] / d0
    d1 = a[1][1] - l10 * a[0][1]
    u21 = a[1][2] - l20 * a[0][1]
    l21 = u21 / d1
    d2 = a[2][2] - l20 * a[0][2] - l21 * u21
    y0 = b[0]
    y1 = b[1] - l10 * y0
    y2 = b[2] - l20 * y0 - l21 * y1
    x2 = y2 / d2
    x1 = y1 / d1 - l21 * x2
    return y0 / d0 - l10 * x1 - l20 * x2, x1, x2
