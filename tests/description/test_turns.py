"""Which whole turn of a passive angle is meant."""

from __future__ import annotations

import math

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description.turns import WholeTurns

from ..four_bar import HOME, four_bar, passive

NAMES = ("a", "b", "c")
HOME_B, HOME_C = (float(angle) for angle in passive(HOME))
TURN = 2.0 * math.pi


def turns(limits=(-50.0, 50.0), home=(HOME, HOME_B, HOME_C)):
    return WholeTurns(ld.load(four_bar(limits)).description, NAMES, ("a",), np.array(home))


@pytest.mark.parametrize("wound", [-3, -1, 0, 1, 2])
def test_within_half_a_turn_of_home(wound):
    near = np.array([[4.0, HOME_B + 3.1, HOME_C - 3.1], [-7.0, HOME_B - 3.1, HOME_C]])
    found = turns()(near + TURN * wound * np.array([0.0, 1.0, 1.0]))
    np.testing.assert_allclose(found, near, atol=1e-13)


def test_a_turn_of_an_independent_joint_counts():
    np.testing.assert_array_equal(turns()(np.array([7.0, HOME_B, HOME_C])), [7.0, HOME_B, HOME_C])


def test_the_turn_inside_the_limits():
    within = turns((-2.5, 3.0))
    assert within(np.array([0.0, 2.4 - TURN, 0.0]))[1] == pytest.approx(2.4)
    assert within(np.array([0.0, 2.4, 0.0]))[1] == 2.4
    # Outside in every turn: the one at home.
    assert within(np.array([0.0, 3.2, 0.0]))[1] == pytest.approx(3.2 - TURN)
    # Inside in more than one turn: the one at home.
    assert turns((-7.0, 7.0))(np.array([0.0, 2.4, 0.0]))[1] == pytest.approx(2.4 - TURN)
    assert turns((-1.5, 20.0))(np.array([0.0, 3 * TURN - 3.0, 0.0]))[1] == pytest.approx(TURN - 3.0)


def test_a_home_pose_in_another_turn_is_the_files():
    wound = turns(home=(HOME, HOME_B + TURN, HOME_C - 2 * TURN))
    np.testing.assert_allclose(wound(np.array([HOME, HOME_B, HOME_C])), [HOME, HOME_B, HOME_C], atol=1e-13)
    np.testing.assert_allclose(
        turns(home=(np.nan,) * 3)(np.array([HOME, HOME_B - TURN, HOME_C])), [HOME, HOME_B, HOME_C], atol=1e-13
    )


def test_half_a_turn_is_one_turn_for_every_rounding():
    for sign in (1.0, -1.0):
        for rounding in (-1e-9, 0.0, 1e-9):
            angle = HOME_B + sign * math.pi + rounding
            assert turns()(np.array([0.0, angle, 0.0]))[1] == pytest.approx(HOME_B + math.pi, abs=2e-9)


def test_rows_without_a_pose_stay_nan():
    found = turns((-2.5, 3.0))(np.array([[np.nan] * 3, [HOME, HOME_B + TURN, HOME_C]]))
    assert np.isnan(found[0]).all()
    assert found[1, 1] == pytest.approx(HOME_B)
