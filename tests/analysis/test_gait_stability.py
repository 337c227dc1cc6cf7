"""The stability margin against a convex hull of SciPy and against brute force along the edges."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from leg_dynamics.analysis.gait import project, support_margin
from leg_dynamics.errors import ShapeError

RNG = np.random.default_rng(3)


def brute_force(feet, point, steps=20001):
    """Distance to densely sampled hull edges, signed by the hull's half-planes."""
    hull = ConvexHull(feet)
    corners = feet[hull.vertices]
    share = np.linspace(0.0, 1.0, steps)[:, None]
    edges = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    border = np.concatenate([a + share * (b - a) for a, b in edges])
    inside = (hull.equations[:, :2] @ point + hull.equations[:, 2]).max() < 0.0
    distance = np.linalg.norm(border - point, axis=1).min()
    return distance if inside else -distance


@pytest.mark.parametrize("count", [3, 4, 6, 8])
def test_margins_of_random_feet(count):
    feet, points = RNG.normal(size=(12, count, 2)), RNG.normal(size=(12, 2)) * 0.7
    margins = support_margin(feet, np.ones((12, count), dtype=bool), points)
    expected = [brute_force(f, p) for f, p in zip(feet, points, strict=True)]
    assert np.abs(margins - expected).max() < 1e-3
    # Exact to rounding where the nearest edge is known: inside, the hull's planes say it.
    for margin, f, p in zip(margins, feet, points, strict=True):
        equations = ConvexHull(f).equations
        if margin > 0.0:
            assert margin == pytest.approx(-(equations[:, :2] @ p + equations[:, 2]).max(), abs=1e-13)


def test_only_standing_feet_count():
    feet = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [5.0, 5.0]])
    square = [True, True, True, True, False]
    assert support_margin(feet, square, [0.0, 0.0]) == pytest.approx(1.0)
    assert support_margin(feet, [True, True, True, False, False], [0.0, 0.0]) == pytest.approx(0.0)
    assert support_margin(feet, square, [0.9, 0.0]) == pytest.approx(0.1)
    assert support_margin(feet, square, [2.0, 2.0]) == pytest.approx(-np.sqrt(2.0))
    assert support_margin(feet, square, [3.0, 0.0]) == pytest.approx(-2.0)


def test_fewer_than_three_feet_never_have_a_positive_margin():
    feet = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]])
    none, one, two, line = ([False] * 3, [True, False, False], [True, True, False], [True] * 3)
    assert support_margin(feet, none, [0.0, 0.0]) == -np.inf
    assert support_margin(feet, one, [3.0, 4.0]) == pytest.approx(-5.0)
    assert support_margin(feet, two, [1.0, 0.5]) == pytest.approx(-0.5)
    assert support_margin(feet, two, [3.0, 0.0]) == pytest.approx(-1.0)
    assert support_margin(feet, two, [1.0, 0.0]) == 0.0
    assert support_margin(feet, line, [3.0, 0.3]) == pytest.approx(-0.3)
    assert support_margin(feet, line, [3.0, 0.0]) == 0.0
    assert support_margin(np.zeros((3, 2)), line, [1.0, 0.0]) == pytest.approx(-1.0)
    assert support_margin(np.zeros((0, 2)), np.zeros(0, dtype=bool), [1.0, 0.0]) == -np.inf


def test_feet_in_line_with_others_change_nothing():
    square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    more = np.concatenate([square, [[0.0, 1.0], [0.3, 0.2], [1.0, 1.0]]])
    for point in RNG.normal(size=(20, 2)):
        assert support_margin(more, [True] * 7, point) == pytest.approx(support_margin(square, [True] * 4, point))


def test_margins_do_not_depend_on_frame_and_order():
    feet, stance, point = RNG.normal(size=(30, 6, 2)), RNG.random((30, 6)) < 0.7, RNG.normal(size=(30, 2)) * 0.4
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s], [s, c]])
    order = RNG.permutation(6)
    moved = support_margin(feet[:, order] @ R.T + 3.0, stance[:, order], point @ R.T + 3.0)
    assert np.allclose(moved, support_margin(feet, stance, point), atol=1e-12)


def test_projection_runs_along_gravity():
    assert np.allclose(project([0.1, 0.2, 0.5], [0.0, 0.0, -9.81], -0.5), [0.1, 0.2])
    assert np.allclose(project([0.0, 0.0, 0.5], [1.0, 0.0, -2.0], -0.5), [0.5, 0.0])


def test_shapes_are_checked():
    with pytest.raises(ShapeError):
        support_margin(np.zeros((4, 3)), [True] * 4, [0.0, 0.0])
