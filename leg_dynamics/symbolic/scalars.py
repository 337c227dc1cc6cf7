"""Vectors of three scalars that are floats, NumPy arrays or CasADi symbols; what is zero or one never becomes code.

Structural zeros and ones are Python floats. A product with a float 0 is the float 0, so sparsity survives any chain of
operations on either kind of number, and the same text serves sampled states (arrays) and graphs (symbols).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

__all__ = [
    "IDENTITY",
    "ZERO",
    "Matrix",
    "Scalar",
    "Vector",
    "add",
    "add_vectors",
    "align_z",
    "atan2",
    "axis_rotation",
    "clean",
    "clean_matrix",
    "cos",
    "cross",
    "dot",
    "is_zero",
    "matmul",
    "matvec",
    "mul",
    "neg",
    "scale",
    "sin",
    "sqrt",
    "sub",
    "sub_vectors",
    "total",
    "transpose",
    "transposed_matvec",
]

Scalar = Any
"""A float, a NumPy array or a scalar SX."""
Vector = tuple[Scalar, Scalar, Scalar]
Matrix = tuple[Vector, Vector, Vector]
"""Three rows."""

ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

# Rounding of sines of written angles: pi to sixteen digits leaves 1.2e-16.
ROUNDING = 1e-15


def is_zero(x: Scalar) -> bool:
    """Whether a scalar is the number 0 by structure, not by value."""
    return isinstance(x, float) and x == 0.0


def add(a: Scalar, b: Scalar) -> Scalar:
    """a + b."""
    if is_zero(a):
        return b
    if is_zero(b):
        return a
    return a + b


def neg(a: Scalar) -> Scalar:
    """-a."""
    return 0.0 if is_zero(a) else -a


def sub(a: Scalar, b: Scalar) -> Scalar:
    """a - b."""
    if is_zero(b):
        return a
    return -b if is_zero(a) else a - b


def mul(a: Scalar, b: Scalar) -> Scalar:
    """a * b; float factors 0, 1 and -1 cost nothing."""
    if isinstance(b, float):
        a, b = b, a
    if isinstance(a, float):
        if a == 0.0:
            return 0.0
        if a == 1.0:
            return b
        if a == -1.0:
            return neg(b)
        if is_zero(b):
            return 0.0
    return a * b


def total(terms: Iterable[Scalar]) -> Scalar:
    """Sum, from the left."""
    result: Scalar = 0.0
    for term in terms:
        result = add(result, term)
    return result


def sin(x: Scalar) -> Scalar:
    """sin x, rad."""
    if isinstance(x, float):
        return math.sin(x)
    return np.sin(x) if isinstance(x, np.ndarray) else x.sin()


def cos(x: Scalar) -> Scalar:
    """cos x, rad."""
    if isinstance(x, float):
        return math.cos(x)
    return np.cos(x) if isinstance(x, np.ndarray) else x.cos()


def sqrt(x: Scalar) -> Scalar:
    """Square root."""
    if isinstance(x, float):
        return math.sqrt(x)
    return np.sqrt(x) if isinstance(x, np.ndarray) else x.sqrt()


def atan2(y: Scalar, x: Scalar) -> Scalar:
    """Angle of the point (x, y), rad."""
    if isinstance(y, float) and isinstance(x, float):
        return math.atan2(y, x)
    if isinstance(y, np.ndarray) or isinstance(x, np.ndarray):
        return np.arctan2(y, x)
    import casadi

    return casadi.atan2(y, x)


def clean(x: Scalar, size: float = 1.0) -> Scalar:
    """A float without the rounding of numbers of that size; other scalars as they are."""
    if isinstance(x, float):
        if abs(x) < ROUNDING * size:
            return 0.0
        return float(x)
    return x


def clean_matrix(matrix: Any) -> Matrix:
    """A constant rotation, its entries near 0 and 1 made exact; symbols stay as they are."""

    def entry(x: Scalar) -> Scalar:
        if not isinstance(x, (float, int, np.floating)):
            return x
        x = float(x)
        for exact in (0.0, 1.0, -1.0):
            if abs(x - exact) < ROUNDING:
                return exact
        return x

    rows = [tuple(entry(x) for x in row) for row in matrix]
    return (rows[0], rows[1], rows[2])


def dot(a: Vector, b: Vector) -> Scalar:
    """Scalar product."""
    return add(add(mul(a[0], b[0]), mul(a[1], b[1])), mul(a[2], b[2]))


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (
        sub(mul(a[1], b[2]), mul(a[2], b[1])),
        sub(mul(a[2], b[0]), mul(a[0], b[2])),
        sub(mul(a[0], b[1]), mul(a[1], b[0])),
    )


def add_vectors(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2]))


def sub_vectors(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return (sub(a[0], b[0]), sub(a[1], b[1]), sub(a[2], b[2]))


def scale(factor: Scalar, a: Vector) -> Vector:
    """Factor times a vector."""
    return (mul(factor, a[0]), mul(factor, a[1]), mul(factor, a[2]))


def transpose(m: Matrix) -> Matrix:
    """Columns as rows."""
    return ((m[0][0], m[1][0], m[2][0]), (m[0][1], m[1][1], m[2][1]), (m[0][2], m[1][2], m[2][2]))


def matvec(m: Matrix, a: Vector) -> Vector:
    """Matrix times vector."""
    return (dot(m[0], a), dot(m[1], a), dot(m[2], a))


def transposed_matvec(m: Matrix, a: Vector) -> Vector:
    """Transposed matrix times vector."""
    return matvec(transpose(m), a)


def matmul(a: Matrix, b: Matrix) -> Matrix:
    """Matrix product."""
    columns = transpose(b)
    rows = [tuple(dot(row, column) for column in columns) for row in a]
    return (rows[0], rows[1], rows[2])


def align_z(axis: Sequence[float]) -> Matrix:
    """A constant rotation whose third column is the unit vector `axis`; coordinate axes are mapped to each other."""
    smallest = min(range(3), key=lambda i: abs(axis[i]))
    z = (float(axis[0]), float(axis[1]), float(axis[2]))
    helper = tuple(1.0 if i == smallest else 0.0 for i in range(3))
    x = cross((helper[0], helper[1], helper[2]), z)
    size = math.sqrt(dot(x, x))
    x = (x[0] / size, x[1] / size, x[2] / size)
    return clean_matrix(transpose((x, cross(z, x), z)))


def axis_rotation(axis: int, angle: float) -> Matrix:
    """Constant rotation about coordinate axis 0, 1 or 2."""
    c, s = math.cos(angle), math.sin(angle)
    b, d = (axis + 1) % 3, (axis + 2) % 3
    rows = np.eye(3)
    rows[b, b], rows[d, d], rows[b, d], rows[d, b] = c, c, -s, s
    return clean_matrix(rows)


def is_identity(m: Sequence[Sequence[float]]) -> bool:
    """Whether a cleaned constant rotation turns nothing."""
    return tuple(tuple(row) for row in m) == IDENTITY
