"""What the paper reports, typed a second time from its text."""

from __future__ import annotations

import math

import numpy as np
import pytest

from leg_dynamics.papers.omnileg import reported

# Section 4 of the paper, sentence by sentence: inverse kinematics, forward kinematics, torques, experiments, gait.
SENTENCES = """
Fig. 9: position 42.5 µm 0.04 %, velocity 74 µm/s 0.09 %, acceleration 1.5 mm/s² 1.8 %
Fig. 10: position 45 µm 0.05 %, velocity 63 µm/s 0.08 %, acceleration 2.89 mm/s² 1.9 %
Fig. 11: M1 2.1 mN·m 0.1 %, M2 1.5 mN·m 0.6 %, M3 5.2 mN·m 0.2 %
Fig. 15: X 1.4 mm 1.4 %, Y 0.9 mm 1.8 %, Z 1.0 mm 2 %
Fig. 17: X 2.1 mm 3.0 %, Y 1.9 mm 2.7 %, Z 1.7 mm 1.9 %
Fig. 19: M1 0.1 N·m, M2 0.14 N·m 6.3 %, M3 0.37 N·m 8.7 %
"""


def typed():
    found = []
    for line in SENTENCES.strip().splitlines():
        place, _, items = line.partition(": ")
        for item in items.split(", "):
            quantity, error, unit, *rest = item.split()
            found.append((place, quantity, error, rest[0] if rest else "", unit))
    return found


def test_every_reported_number_is_the_printed_one():
    table = [(r.place, r.quantity, r.error, r.percent, r.unit) for r in reported.REPORTED.values()]
    assert table == typed()
    assert list(reported.REPORTED) == [(place, quantity) for place, quantity, *_ in typed()]


def test_lists_of_one_place_are_in_the_papers_order():
    np.testing.assert_array_equal(reported.errors("Fig. 11"), [2.1, 1.5, 5.2])
    np.testing.assert_array_equal(reported.shares("Fig. 11"), [0.1, 0.6, 0.2])
    np.testing.assert_array_equal(reported.shares("Fig. 19"), [math.nan, 6.3, 8.7])
    assert reported.MOTORS == ("M1", "M2", "M3")
    assert [("α", "β", "γ")[k] for k in reported.MOTOR_COLUMNS] == [label[-2] for label in reported.MOTOR_LABELS]


def test_force_of_figure_11():
    force = reported.foot_force(np.array([0.0, 1.0, 1.0 + 1e-9, 2.0]))
    np.testing.assert_array_equal(force, [[0.0, -20.0, 20.0]] * 2 + [[0.0, 0.0, 0.0]] * 2)
    np.testing.assert_array_equal(reported.foot_force(np.array([0.5]), -1.0), [[0.0, 20.0, -20.0]])


@pytest.mark.parametrize(
    ("place", "quantity", "implied", "low", "high"),
    [
        ("Fig. 9", "position", 106250.0, 42.45 / 0.045 * 100, 42.55 / 0.035 * 100),
        ("Fig. 15", "Z", 50.0, 0.95 / 2.5 * 100, 1.05 / 1.5 * 100),
        ("Fig. 17", "Z", 89.4737, 1.65 / 1.95 * 100, 1.75 / 1.85 * 100),
    ],
)
def test_reported_shares_imply_a_range(place, quantity, implied, low, high):
    found = reported.REPORTED[place, quantity]
    assert found.implied == pytest.approx(implied, rel=1e-5)
    assert found.reference == pytest.approx((low, high))
    assert low < implied < high


def test_a_report_without_share_implies_nothing():
    found = reported.REPORTED["Fig. 19", "M1"]
    assert found.reference is None
    assert math.isnan(found.implied)
