"""Windows of feasible offsets, against legs whose windows are known in closed form."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.trajectories import (
    PiecewisePolynomial,
    feasible_offset_windows,
    omnileg_eq51_path,
    omnileg_eq53_cycle,
    quintic,
)
from leg_dynamics.errors import AssemblyError, NonFiniteError, RowError, ShapeError, TrajectoryError

from .toy_legs import Polar

ALONG_X = quintic([0.5, 0.0, 0.0], [1.0, 0.0, 0.0], 1.0)


@pytest.fixture(scope="module")
def omnileg():
    return ld.load("omnileg")


def test_window_of_a_limited_radius_is_closed_form():
    (window,) = feasible_offset_windows(Polar(), ALONG_X)
    # |(1, 0, s)| <= 2; the elevation limit of 1.5 rad at x = 0.5 would only bind beyond.
    assert window.upper == pytest.approx(math.sqrt(3.0), abs=1e-10)
    assert window.lower == pytest.approx(-math.sqrt(3.0), abs=1e-10)
    assert window.lower_reason == window.upper_reason == "radius"
    assert window.upper_time == pytest.approx(1.0)
    assert 1.7 in window
    assert 1.8 not in window


def test_the_end_itself_is_feasible_and_beyond_is_not():
    leg = Polar()
    (window,) = feasible_offset_windows(leg, ALONG_X, direction=(0.0, 0.6, 0.8))
    for end, outward in ((window.lower, -1.0), (window.upper, 1.0)):
        leg.inverse_kinematics(ALONG_X.translated(end * np.array([0.0, 0.6, 0.8])).value([0.0, 1.0]))
        with pytest.raises(ld.errors.JointLimitError):
            leg.inverse_kinematics(
                ALONG_X.translated((end + outward * 1e-9) * np.array([0.0, 0.6, 0.8])).value([0.0, 1.0])
            )


@pytest.mark.parametrize(
    ("curve", "least"),
    [
        (omnileg_eq51_path(0.0), 0.33906622462490),
        (omnileg_eq53_cycle(0.0).curve, 0.36946818089029),
        (omnileg_eq53_cycle(0.0, start=(0.0, -0.05)).curve, 0.3765595),
    ],
)
def test_both_ends_are_feasible_at_every_time_of_a_fine_grid(omnileg, curve, least):
    (window,) = feasible_offset_windows(omnileg, curve)
    assert window.lower >= least - 1e-13
    assert window.lower == pytest.approx(least, abs=1e-7)
    path = curve.value(np.linspace(curve.start_time, curve.end_time, 400001))
    for end, outward in ((window.lower, -1.0), (window.upper, 1.0)):
        omnileg.inverse_kinematics(path + np.array([0.0, 0.0, end]))
        with pytest.raises(RowError):
            omnileg.inverse_kinematics(path + np.array([0.0, 0.0, end + outward * 1e-9]))


def bump(height):
    """A path at x = 1 whose y rises to `height` at t = 0.525, which no even grid of few samples meets."""
    a = height / 0.525**2
    return PiecewisePolynomial([0.0, 1.0], [[[0.0, -a, 0.0]], [[0.0, 2.0 * 0.525 * a, 0.0]], [[1.0, 0.0, 0.0]]])


@pytest.mark.parametrize(("scan", "samples"), [(33, 33), (33, 9), (201, 2)])
def test_a_critical_time_between_samples_is_found(scan, samples):
    (window,) = feasible_offset_windows(Polar(), bump(0.6), scan=scan, samples=samples)
    assert window.upper == pytest.approx(math.sqrt(4.0 - 1.0 - 0.6**2), abs=1e-8 if samples > 2 else 1e-5)
    assert window.lower == pytest.approx(-window.upper, abs=1e-12)
    assert window.upper_time == pytest.approx(0.525, abs=1e-2)


def test_a_window_between_samples_only_is_none():
    # At both ends of the path everything is fine, in its middle nothing is.
    assert feasible_offset_windows(Polar(), bump(2.5), samples=2) == ()


def test_a_leg_that_cannot_be_assembled_is_infeasible_there():
    class Breaking(Polar):
        def inverse_kinematics(self, p, branch=None, limits="error", *, on_error="raise"):
            q = super().inverse_kinematics(p, branch, limits, on_error=on_error)
            rows = np.flatnonzero(np.asarray(p)[:, 2] > 0.7)
            if rows.size and on_error == "raise":
                raise AssemblyError("the loops do not close", rows=rows)
            q[rows] = np.nan
            return q

    (window,) = feasible_offset_windows(Breaking(), ALONG_X)
    assert window.upper == pytest.approx(0.7, abs=1e-10)
    assert window.upper_reason == "reach"


def test_without_any_pose_the_search_range_is_asked_for():
    leg = Polar()
    leg.foot_position = lambda q, on_error: np.full((len(q), 3), np.nan)
    with pytest.raises(TrajectoryError, match="give the search range"):
        feasible_offset_windows(leg, ALONG_X)
    assert len(feasible_offset_windows(leg, ALONG_X, search=(-2.0, 2.0))) == 1


def test_a_hole_makes_two_windows_and_reach_is_named():
    leg = Polar()
    leg.forbidden = (0.3, 1.2)
    point = quintic([0.5, 0.0, 0.0], [0.5, 0.0, 0.0], 1.0)
    low, high = feasible_offset_windows(leg, point)
    assert (low.upper_reason, high.lower_reason) == ("reach", "reach")
    assert high.lower == pytest.approx(math.sqrt(1.2**2 - 0.25), abs=1e-10)
    assert low.upper == pytest.approx(-high.lower, abs=1e-10)
    assert (low.lower_reason, high.upper_reason) == ("radius", "radius")


def test_limits_can_be_ignored_and_the_search_bounded():
    leg = Polar()
    (window,) = feasible_offset_windows(leg, ALONG_X, limits="ignore", search=(-5.0, 4.0))
    assert (window.lower, window.upper) == (-5.0, 4.0)
    assert window.lower_reason == window.upper_reason == "search"
    leg.forbidden = (2.5, 9.0)
    (window,) = feasible_offset_windows(leg, ALONG_X, limits="ignore", search=(0.0, 4.0))
    assert window.upper == pytest.approx(math.sqrt(2.5**2 - 1.0), abs=1e-10)
    assert window.upper_reason == "reach"


def test_unbounded_joints_still_have_a_search_range():
    leg = Polar()
    leg.limits = SimpleNamespace(lower=np.array([-np.inf, -np.inf, 0.0]), upper=np.array([np.inf, np.inf, 2.0]))
    (window,) = feasible_offset_windows(leg, ALONG_X)
    assert window.upper == pytest.approx(math.sqrt(3.0), abs=1e-10)


def test_no_feasible_offset_is_an_empty_answer():
    assert feasible_offset_windows(Polar(), ALONG_X.translated([5.0, 0.0, 0.0])) == ()


def test_omnileg_windows_of_the_two_readings_of_eq51(omnileg):
    (up,) = feasible_offset_windows(omnileg, omnileg_eq51_path(0.0))
    np.testing.assert_allclose([up.lower, up.upper], [0.3391, 0.4618], atol=5e-5)
    # The straight leg at X = 0, Y = 0.1: both ends' causes are exact facts.
    assert up.upper == pytest.approx(0.35 + math.sqrt(0.15**2 - 0.1**2), abs=1e-10)
    assert (up.lower_reason, up.upper_reason, up.upper_time) == ("gamma", "reach", 5.0)
    (literal,) = feasible_offset_windows(omnileg, omnileg_eq51_path(0.0, z_sign="literal"))
    np.testing.assert_allclose([literal.lower, literal.upper], [0.3266, 0.3971], atol=5e-5)
    # gamma = 85 deg straight down.
    assert literal.lower == pytest.approx(0.31 + 0.19 * math.cos(math.radians(85.0)), abs=1e-10)


def test_omnileg_windows_of_the_gait(omnileg):
    (printed,) = feasible_offset_windows(omnileg, omnileg_eq53_cycle(0.0).curve)
    (centred,) = feasible_offset_windows(omnileg, omnileg_eq53_cycle(0.0, start=(0.0, -0.05)).curve)
    assert printed.upper == pytest.approx(0.4618, abs=5e-5)
    assert centred.upper == pytest.approx(0.4914, abs=5e-5)
    # The middle of the swing, folded to 85 deg under the hip.
    assert centred.lower == pytest.approx(0.31 + 0.19 * math.cos(math.radians(85.0)) + 0.05, abs=1e-9)


@pytest.mark.slow
def test_the_other_route_finds_the_same_window(omnileg):
    leg = ld.load("omnileg", route="pinocchio")
    (window,) = feasible_offset_windows(leg, omnileg_eq51_path(0.0), search=(0.337, 0.342), scan=2, samples=5)
    (expected,) = feasible_offset_windows(omnileg, omnileg_eq51_path(0.0))
    assert window.lower == pytest.approx(expected.lower, abs=1e-7)
    assert (window.lower_reason, window.upper, window.upper_reason) == ("gamma", 0.342, "search")


@pytest.mark.parametrize(
    ("more", "error", "text"),
    [
        ({"direction": (0.0, 1.0)}, ShapeError, "direction has shape .* three components"),
        ({"direction": (0.0, 0.0, math.nan)}, NonFiniteError, "direction"),
        ({"direction": (0.0, 0.0, 0.0)}, TrajectoryError, "is zero"),
        ({"limits": "perhaps"}, TrajectoryError, "limits must be"),
        ({"scan": 1}, TrajectoryError, "scan must be at least 2"),
        ({"search": (1.0, 0.0)}, TrajectoryError, "lower to a higher"),
    ],
)
def test_bad_searches_are_named(more, error, text):
    with pytest.raises(error, match=text):
        feasible_offset_windows(Polar(), ALONG_X, **more)
    with pytest.raises(ShapeError, match="three coordinates"):
        feasible_offset_windows(Polar(), quintic([0.0], [1.0], 1.0))
