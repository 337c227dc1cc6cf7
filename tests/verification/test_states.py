from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from leg_dynamics.routes import load
from leg_dynamics.verification.states import (
    KNOWN_TO,
    SLIDE_SHARE,
    States,
    domain,
    nearly_singular,
    sample_states,
    smallest_singular_values,
    with_room,
)


def fake_leg(lower, upper, units=("rad", "rad", "m")):
    limits = SimpleNamespace(lower=np.array(lower), upper=np.array(upper))
    return SimpleNamespace(limits=limits, units=SimpleNamespace(joints=units))


def test_the_box_of_the_omnileg(closed, numeric):
    for leg in (closed, numeric):
        lower, upper = domain(leg)
        np.testing.assert_allclose(np.degrees(lower), [-65.0, -65.0, -45.0])
        np.testing.assert_allclose(np.degrees(upper), [65.0, 65.0, 85.0])


def test_the_box_is_finite_and_crosses_zero_for_angles_only():
    lower, upper = domain(fake_leg([-np.inf, -2.0, 0.0], [np.inf, 0.0, np.inf]))
    np.testing.assert_allclose(lower, [-np.pi, -2.0, 0.0])
    np.testing.assert_allclose(upper, [np.pi, np.pi / 4, 1.0])
    lower, upper = domain(fake_leg([0.0, 0.2, 0.1], [0.3, 0.5, 0.2]))
    np.testing.assert_allclose(lower, [-0.3, 0.2, 0.1])
    np.testing.assert_allclose(upper, [0.3, 0.5, 0.2])


BOX = np.array([-1.0, -2.0, -0.5]), np.array([1.0, 2.0, 1.5])


def test_samples_are_in_the_box_reproducible_and_cover_its_special_points():
    states = sample_states(BOX, 400, 1)
    again, other = sample_states(BOX, 400, 1), sample_states(BOX, 400, 2)
    for name in ("q", "v", "a", "foot_force", "gravity"):
        np.testing.assert_array_equal(getattr(states, name), getattr(again, name))
        assert (getattr(states, name) != getattr(other, name)).any()
    q = states.q
    assert len(states) == 400
    assert ((q >= BOX[0]) & (q <= BOX[1])).all()
    assert (q == 0.0).all(axis=1).sum() == 1
    assert ((q == BOX[0]) | (q == BOX[1])).all(axis=1).sum() == 8
    tiny = (np.abs(q) < 1e-3) & (q != 0.0)
    assert 0.03 < tiny.mean() < 0.15
    np.testing.assert_allclose(np.linalg.norm(states.gravity, axis=1), 9.81)
    assert len(np.unique(np.floor((q - BOX[0]) / (BOX[1] - BOX[0]) * 3.999), axis=0)) > 60


@pytest.mark.parametrize("samples", [1, 2, 5, 17])
def test_few_samples_are_not_all_corners(samples):
    states = sample_states(BOX, samples, 0)
    special = ((states.q == BOX[0]) | (states.q == BOX[1])).all(axis=1) | (states.q == 0.0).all(axis=1)
    assert len(states) == samples
    assert special.sum() == min(9, (samples + 1) // 2)


def test_a_box_without_zero_and_one_with_many_sides():
    states = sample_states((np.array([0.1]), np.array([0.2])), 10, 0)
    assert (states.q >= 0.1).all()
    assert len(sample_states((-np.ones(20), np.ones(20)), 30, 0)) == 30


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_a_path_visits_each_state_once_and_hops_little(n):
    box = -np.ones(n), np.ones(n)
    states = sample_states(box, 2000, 0)
    order = states.along_a_path()
    assert sorted(order.tolist()) == list(range(2000))
    hops = [np.abs(np.diff(q, axis=0)).max(axis=1).mean() for q in (states.q, states.q[order])]
    assert hops[1] < 0.75 * hops[0]
    if n == 3:
        assert hops[1] < 0.2


def test_take_and_first():
    states = sample_states(BOX, 6, 0)
    assert len(states.first(4)) == 4
    assert len(states.first(40)) == 6
    picked = states.take(np.array([4, 1]))
    for name in ("q", "v", "a", "foot_force", "gravity"):
        np.testing.assert_array_equal(getattr(picked, name), getattr(states, name)[[4, 1]])
    assert States(*(np.zeros((0, 3)),) * 5).along_a_path().tolist() == []


def test_room_around_a_state(four_bar):
    leg = load(four_bar)
    limit = np.arccos(-0.25)
    q = np.array([[1.0], [limit - 0.02], [limit - 0.06], [limit + 0.1]])
    states = States(q, q, q, np.zeros((4, 3)), np.zeros((4, 3)))
    np.testing.assert_array_equal(with_room(leg, states).q, q[[0, 2]])


def test_slides_are_slower_than_hinges():
    box = (np.array([-1.0, 0.5, -1.0]), np.array([1.0, 0.9, 1.0]))
    hinges, mixed = (sample_states(box, 300, 4, units) for units in ((), ("rad", "m", "rad")))
    np.testing.assert_array_equal(mixed.q, hinges.q)
    for found, plain in ((mixed.v, hinges.v), (mixed.a, hinges.a)):
        np.testing.assert_allclose(found, plain * (1.0, SLIDE_SHARE, 1.0))


def test_room_along_the_motion(four_bar):
    leg = load(four_bar)
    limit = np.arccos(-0.25)
    q = np.array([[1.0], [limit - 0.06]])
    for v in (0.0, 5.0, -5.0):
        states = States(q, np.full((2, 1), v), q, np.zeros((2, 3)), np.zeros((2, 3)))
        np.testing.assert_array_equal(with_room(leg, states).q, q)


def test_nearly_singular_states(rhombus, closed):
    leg = load(rhombus())
    q = np.array([[1.0], [0.5], [1e-2], [1e-6], [-0.5]])
    fast, slow = np.full_like(q, 5.0), np.full_like(q, 1e-3)
    a = np.full_like(q, 50.0)
    none = np.zeros((5, 3))
    assert nearly_singular(leg, States(q, fast, a, none, none)).tolist() == [False, False, True, True, False]
    assert nearly_singular(leg, States(q, slow, a, none, none)).tolist() == [False, False, False, True, False]
    errors = leg.backend.rounding_errors(q, fast, a)
    assert KNOWN_TO < errors[2] < 1e-3 * errors[3]
    sigma = smallest_singular_values(leg, q)
    assert np.isnan(sigma[4])
    assert (np.diff(sigma[:4]) < 0.0).all()
    # Formulas do not tell.
    states = sample_states(domain(closed), 5, 0)
    assert smallest_singular_values(closed, states.q) is None
    assert not nearly_singular(closed, states).any()
