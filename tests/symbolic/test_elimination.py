"""Static pivots and the written-out elimination against dense solutions."""

from __future__ import annotations

import numpy as np
import pytest

from leg_dynamics.errors import SingularityError
from leg_dynamics.symbolic.elimination import Factor, choose_pivots


def test_factor_against_dense_solutions():
    generator = np.random.default_rng(0)
    A = generator.standard_normal((6, 6)) + 4.0 * np.eye(6)
    A[generator.random((6, 6)) < 0.4] = 0.0
    A[np.arange(6), np.arange(6)] += 3.0
    b = generator.standard_normal(6)
    factor = Factor([{j: float(A[i, j]) for j in range(6) if A[i, j]} for i in range(6)])
    assert np.allclose(factor.solve(b.tolist()), np.linalg.solve(A, b), atol=1e-12)
    assert np.allclose(factor.solve_transposed(b.tolist()), np.linalg.solve(A.T, b), atol=1e-12)


def test_redundant_rows_and_rows_that_lose_their_pivot_are_left_out():
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    K = np.zeros((200, 4, 2))
    K[:, 0] = np.column_stack([np.cos(angle), np.sin(angle)])
    K[:, 1] = np.column_stack([-np.sin(angle), np.cos(angle)])
    K[:, 2] = [1.0, 0.0]
    K[:, 3] = [0.5, 1.0]
    pivots = choose_pivots(K, [1.0] * 4, [0] * 4)
    assert set(pivots.rows) == {2, 3}
    assert pivots.valid == 1.0
    assert pivots.rows[0] == 2
    assert pivots.pattern.tolist() == [[True, False], [True, True]]


def test_a_singular_seed_is_named():
    K = np.ones((50, 3, 2))
    with pytest.raises(SingularityError):
        choose_pivots(K, [1.0] * 3, [0] * 3)
