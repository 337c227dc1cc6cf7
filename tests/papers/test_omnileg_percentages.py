"""Percentages of the OmniLeg paper against one fixed set of full values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.omnileg import percentages


@pytest.fixture(scope="module")
def context():
    return Context("omnileg", samples=500)


@pytest.fixture(scope="module")
def verdicts(context):
    return {
        verdict.item.removeprefix("claim: "): verdict
        for verdict in (function(context) for function in percentages.VERDICTS)
    }


def figure(verdict, name):
    return next(f.value for f in verdict.figures if f.name == name)


@pytest.mark.parametrize(
    ("item", "status"),
    [
        ("inverse kinematics simulation, position error", Status.CONFIRMED),
        ("inverse kinematics simulation, velocity error", Status.CONFIRMED),
        ("inverse kinematics simulation, acceleration error", Status.CONFIRMED),
        ("forward kinematics simulation, position error", Status.NOT_REPRODUCIBLE),
        ("forward kinematics simulation, velocity error", Status.CONFIRMED),
        ("forward kinematics simulation, acceleration error", Status.NOT_REPRODUCIBLE),
        ("torque error of M1", Status.NOT_REPRODUCIBLE),
        ("torque error of M2", Status.NOT_REPRODUCIBLE),
        ("torque error of M3", Status.NOT_REPRODUCIBLE),
        ("torque errors stay within 1 %", Status.NOT_REPRODUCIBLE),
        ("inverse kinematics experiment, X error", Status.CONFIRMED),
        ("inverse kinematics experiment, Y error", Status.CORRECTED),
        ("inverse kinematics experiment, Z error", Status.CONFIRMED),
        ("forward kinematics experiment, X error", Status.CORRECTED),
        ("forward kinematics experiment, Y error", Status.CORRECTED),
        ("forward kinematics experiment, Z error", Status.NOT_REPRODUCIBLE),
        ("amplitude of γ in (52)", Status.NOT_REPRODUCIBLE),
    ],
)
def test_status(verdicts, item, status):
    assert verdicts[item].status is status


def test_every_percentage_states_how_likely_a_hit_is(verdicts):
    shares = [verdict for verdict in verdicts.values() if "share consistent" in verdict.title]
    assert len(shares) == 15
    for verdict in shares:
        window = [figure(verdict, f"{which} full value implied") for which in ("least", "greatest")]
        count, hit = figure(verdict, "candidates"), figure(verdict, "chance of a hit")
        assert figure(verdict, "width of the window") == pytest.approx(100.0 * (window[1] / window[0] - 1.0))
        assert hit == pytest.approx(1.0 - (1.0 - math.log10(window[1] / window[0])) ** count)
        assert f"{count:.0f} different candidates" in verdict.finding
        assert all(math.isfinite(f.value) for f in verdict.figures)


def test_candidates_are_the_same_seven_for_every_vector():
    t = np.linspace(0.0, 1.0, 5)
    values = np.stack([3.0 * t, -4.0 * t, 0.0 * t + 1.0], axis=-1)
    found = percentages.candidates(values)
    assert found == {
        **{"span in X": 3.0, "span in Y": 4.0, "span in Z": 0.0},
        **{"peak in X": 3.0, "peak in Y": 4.0, "peak in Z": 1.0},
        "peak of the norm": pytest.approx(math.sqrt(26.0)),
    }
    assert list(percentages.candidates(values, "Y", " there")) == [
        "span in Y there",
        "peak in Y there",
        "peak of the norm there",
    ]


def test_chance_of_a_hit():
    assert percentages.chance((1.0, 10.0), 1) == 1.0
    assert percentages.chance((1.0, math.sqrt(10.0)), 2) == pytest.approx(0.75)
    assert percentages._distinct({"a": 1.0, "b": 1.005, "c": 2.0}) == 2


def test_percentages_by_hand(verdicts):
    y = verdicts["inverse kinematics experiment, Y error"]
    assert figure(y, "percentage by the span in Y") == pytest.approx(0.9)
    assert y.corrected == "0.9 % of the span in Y"
    z = verdicts["forward kinematics experiment, Z error"]
    thigh = 150.0 * (1.0 - 1.0 / math.sqrt(5.0 / 3.0))
    for degrees, name in ((25.0, "span in Z"), (45.0, "span in Z with 45°")):
        span = thigh + 190.0 * (1.0 - math.cos(math.radians(degrees)))
        assert figure(z, f"percentage by the {name}") == pytest.approx(170.0 / span, rel=1e-4)
    velocity = verdicts["inverse kinematics simulation, velocity error"]
    for name, full in (("peak in X", 75.0), ("peak in Y", 37.5), ("span in Z", 68.69), ("peak of the norm", 85.1)):
        assert figure(velocity, f"percentage by the {name}") == pytest.approx(7.4 / full, rel=5e-4)
    # 86.4 mm/s²: from -48 to 38.4.
    acceleration = verdicts["inverse kinematics simulation, acceleration error"]
    assert figure(acceleration, "percentage by the span in Z") == pytest.approx(150.0 / 86.4, rel=1e-4)
    assert "the span in Z fits" in acceleration.finding


def test_shares_of_a_rounded_peak(verdicts):
    for axis, share in (("X", "3"), ("Y", "2.71")):
        verdict = verdicts[f"forward kinematics experiment, {axis} error"]
        assert f"the peak in {axis} rounded from 67.1 mm to 0.07 m ({share} %) does" in verdict.finding
    assert verdicts["forward kinematics experiment, X error"].corrected == "3.1 % of the peak in X"


def test_torque_peaks_behind_the_shares(verdicts):
    for motor, error, right, flipped in (("M1", 2.1, 2.2758, 0.8233), ("M2", 1.5, 3.0, 3.0), ("M3", 5.2, 1.6341, 1.17)):
        verdict = verdicts[f"torque error of {motor}"]
        for name, peak in (("with the force on the foot", right), ("by the printed sign", flipped)):
            share = figure(verdict, f"percentage by the peak {name}")
            assert share == pytest.approx(0.1 * error / peak, rel=3e-4)
        printed_over_peak = figure(verdicts["torque errors stay within 1 %"], f"printed error over the peak, {motor}")
        assert printed_over_peak == pytest.approx(0.1 * error / right, rel=3e-4)
    assert "M1" in verdicts["torque error of M1"].title
    assert "masses behind it are assumed" in verdicts["torque error of M1"].finding


def test_the_amplitude_that_would_fit(verdicts):
    verdict = verdicts["amplitude of γ in (52)"]
    assert figure(verdict, "span of Z at 25 deg") == pytest.approx(51.6, abs=0.05)
    assert figure(verdict, "span of Z at 45 deg") == pytest.approx(89.46, abs=0.01)
    assert figure(verdict, "least amplitude that fits") == pytest.approx(42.9, abs=0.15)
    assert figure(verdict, "greatest amplitude that fits") == pytest.approx(47.1, abs=0.15)


@pytest.mark.parametrize(
    ("full", "repair", "assumed", "status", "words"),
    [
        ({"span": 50.0}, None, "", Status.CONFIRMED, "the span fits"),
        ({"span": 50.0}, None, "masses", Status.NOT_REPRODUCIBLE, "the span fits, but masses"),
        ({"span": 100.0}, ("span", 50.0, "half of it"), "", Status.CORRECTED, "nothing computed fits; half of it does"),
        ({"span": 100.0}, ("span", 70.0, "less of it"), "", Status.NOT_REPRODUCIBLE, "nothing computed fits"),
        ({"span": 100.0}, None, "", Status.NOT_REPRODUCIBLE, "nothing computed fits"),
        ({"span": 100.0, "span with 45°": 50.0}, None, "", Status.NOT_REPRODUCIBLE, "only the span with 45° fits"),
        ({"span with 45°": 50.0, "peak": 49.0}, None, "", Status.CONFIRMED, "the peak fits"),
    ],
)
def test_a_share_is_judged_by_what_it_is_of(full, repair, assumed, status, words):
    verdict = percentages.share_verdict("x", "Fig. 15", "Y", full, repair=repair, assumed=assumed)
    assert verdict.status is status
    assert words in verdict.finding
    assert bool(verdict.corrected) == (status is Status.CORRECTED)
