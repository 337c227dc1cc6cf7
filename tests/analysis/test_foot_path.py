"""Foot paths: validation, and joint motions whose derivatives are exact."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.trajectories import FootPath, minimum_jerk, omnileg_eq51_path, quintic
from leg_dynamics.errors import (
    JointLimitError,
    NonFiniteError,
    OutOfReachError,
    ShapeError,
    SingularityError,
    TrajectoryError,
    UnsupportedError,
)

from .toy_legs import Polar

LEG = Polar()
CURVE = minimum_jerk([[0.5, 0.3, 0.2], [0.8, -0.4, 0.5], [0.3, 0.6, -0.1]], [0.0, 0.4, 1.0], name="tour")


@pytest.fixture(scope="module")
def omnileg():
    return ld.load("omnileg")


def check_derivatives(leg, curve, times, tolerance):
    h = 1e-5
    before, at, after = (curve.foot_path(times=times + step).to_joint(leg) for step in (-h, 0.0, h))
    np.testing.assert_allclose(leg.foot_position(at.q), curve.value(times), atol=1e-12)
    v, a = (after.q - before.q) / (2.0 * h), (after.v - before.v) / (2.0 * h)
    np.testing.assert_allclose(at.v, v, atol=tolerance * np.abs(v).max())
    np.testing.assert_allclose(at.a, a, atol=tolerance * np.abs(a).max())


def test_joint_rates_are_those_of_finite_differences_on_a_textbook_leg():
    check_derivatives(LEG, CURVE, np.linspace(0.05, 0.95, 23), 1e-7)


def test_joint_rates_are_those_of_finite_differences_on_the_omnileg(omnileg):
    check_derivatives(omnileg, omnileg_eq51_path(), np.linspace(0.05, 4.95, 50), 1e-7)


def test_foot_moves_as_the_path_says(omnileg):
    path = omnileg_eq51_path().foot_path(20.0)
    motion = path.to_joint(omnileg)
    np.testing.assert_allclose(omnileg.foot_position(motion.q), path.position, atol=1e-14)
    np.testing.assert_allclose(omnileg.foot_velocity(motion.q, motion.v), path.velocity, atol=1e-14)
    np.testing.assert_allclose(omnileg.foot_acceleration(motion.q, motion.v, motion.a), path.acceleration, atol=1e-13)


def test_the_other_branch_folds_the_other_way(omnileg):
    path = omnileg_eq51_path().foot_path(4.0)
    motion = path.to_joint(omnileg)
    other = path.to_joint(omnileg, "gamma_negative", limits="ignore")
    np.testing.assert_allclose(other.q, motion.q * [1.0, 1.0, -1.0], atol=1e-14)
    with pytest.raises(JointLimitError, match=r"at t = 0 s: .*gamma"):
        path.to_joint(omnileg, "gamma_negative")


def test_force_and_name_are_handed_on():
    path = CURVE.foot_path(10.0).with_foot_force([0.0, 0.0, -5.0])
    motion = path.to_joint(LEG)
    assert motion.name == "tour"
    np.testing.assert_array_equal(motion.foot_force, [[0.0, 0.0, -5.0]] * 11)
    assert "force on the foot" in repr(path)
    assert repr(CURVE.foot_path(10.0)) == "<FootPath 'tour': 11 samples, 0 to 1 s>"
    assert path.duration == 1.0


def test_singular_pose_names_time_and_margin():
    # Straight up through the pole of the polar leg, where the azimuth does not move the foot.
    path = quintic([0.0, 0.0, 0.5], [0.5, 0.0, 1.0], 1.0).foot_path(4.0)
    with pytest.raises(SingularityError, match=r"1 of 5 samples, first at t = 0 s") as caught:
        path.to_joint(LEG, limits="ignore")
    assert caught.value.time == 0.0
    assert caught.value.rows.tolist() == [0]
    assert caught.value.margin[0] < 1e-15


def test_the_straight_omnileg_is_singular(omnileg):
    # The end of this path has the leg straight down: gamma = 0.
    path = quintic([0.0, 0.0, 0.42], [0.0, 0.0, 0.5], 1.0).foot_path(10.0)
    with pytest.raises(SingularityError, match=r"1 of 11 samples, first at t = 1 s"):
        path.to_joint(omnileg)


def test_out_of_reach_and_limits_name_the_time(omnileg):
    path = quintic([0.0, 0.0, 0.42], [0.0, 0.0, 0.6], 1.0).foot_path(10.0)
    with pytest.raises(OutOfReachError, match=r"foot path 'quintic' at t = 0\.5 s: ") as caught:
        path.to_joint(omnileg)
    assert caught.value.time == 0.5
    assert caught.value.rows[0] == 5
    assert caught.value.margin[0] < 0.0
    low = quintic([0.0, 0.0, 0.42], [0.0, 0.0, 0.32], 1.0).foot_path(10.0)
    with pytest.raises(JointLimitError, match="at t = "):
        low.to_joint(omnileg)
    assert np.degrees(low.to_joint(omnileg, limits="ignore").q[-1, 2]) > 85.0


def test_other_numbers_of_coordinates_are_refused():
    leg = Polar()
    leg.joint_names = ("a", "b")
    with pytest.raises(UnsupportedError, match="this leg has 2"):
        CURVE.foot_path(10.0).to_joint(leg)


def test_paths_are_immutable_and_picklable():
    path = CURVE.foot_path(10.0).with_foot_force([1.0, 2.0, 3.0])
    copy = pickle.loads(pickle.dumps(path))
    for field in ("time", "position", "velocity", "acceleration", "foot_force"):
        np.testing.assert_array_equal(getattr(copy, field), getattr(path, field))
        assert not getattr(copy, field).flags.writeable
    with pytest.raises(AttributeError):
        path.name = "other"


def test_bad_paths_are_named():
    three = np.zeros((2, 3))
    with pytest.raises(ShapeError, match=r"position has shape \(2, 2\); 2 times need shape \(2, 3\)"):
        FootPath([0.0, 1.0], np.zeros((2, 2)), three, three)
    with pytest.raises(NonFiniteError, match="acceleration holds NaN"):
        FootPath([0.0, 1.0], three, three, three + np.nan)
    with pytest.raises(TrajectoryError, match="must increase"):
        FootPath([1.0, 1.0], three, three, three)
