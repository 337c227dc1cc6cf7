"""Inverse kinematics of the pinocchio route: no whole turns, and no other branch than the one asked for."""

from __future__ import annotations

import math

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse
from leg_dynamics.errors import BranchError, JointLimitError, OutOfReachError, RowFailures
from leg_dynamics.mechanism.route import PinocchioRoute, _crosses_singularity

from ..three_rpr import three_rpr

LIMIT = math.radians(70.0)
BACK_POINT = [0.075, 0.0, 0.0]
"""Only a hip that is turned away from the foot reaches it."""


@pytest.fixture(scope="module")
def leg():
    return ld.load("quadruped_leg", route="pinocchio")


@pytest.fixture(scope="module")
def formulas():
    return ld.load("quadruped_leg")


def serial_leg(lab, home=None, **limits):
    """A hip about z, and a pitch and a knee about -y, links of 0.1, 0.3 and 0.2 m along x."""
    text = lab.Text("serial")
    text.joint("hip_joint", "revolute", "base", "hip_link", limit=limits.get("hip", (-3.0, 3.0)))
    text.joint("pitch", "revolute", "hip_link", "thigh", (0, -1, 0), (0.1, 0, 0), limit=limits.get("pitch", (-2, 2)))
    text.joint("knee", "revolute", "thigh", "shank", (0, -1, 0), (0.3, 0, 0), limit=limits.get("knee", (-2.5, 2.5)))
    text.joint("toe", "fixed", "shank", "foot", xyz=(0.2, 0, 0))
    for name, values in (home or {}).items():
        text.configuration(name, dict(zip(("hip_joint", "pitch", "knee"), values, strict=True)))
    return ld.load(text.xml, foot="foot", route="pinocchio")


# -------------------------------------------------------------------------------------------------- the quadruped's leg


def test_the_branch_is_the_formulas_first_one(leg, formulas):
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (600, 3)) * math.radians(69.0)
    p = formulas.foot_position(q)
    found = leg.inverse_kinematics(p, limits="ignore")
    assert (found[:, 2] < 0.0).all()
    np.testing.assert_allclose(found, formulas.inverse_kinematics(p, limits="ignore"), rtol=0, atol=1e-7)
    inside, expected = (each.inverse_kinematics(p, on_error="nan") for each in (leg, formulas))
    np.testing.assert_allclose(inside, expected, rtol=0, atol=1e-7)
    # Feet of a knee bent the other way: the branch has some of them outside the limits.
    assert 50 < np.isnan(inside).any(axis=1).sum() < 300


def test_feet_far_outside_the_limits_are_found_in_the_branch(leg, formulas):
    q = np.random.default_rng(1).uniform([-3.1, -3.1, -3.1], [3.1, 3.1, -0.01], (60, 3))
    p = formulas.foot_position(q)
    found, expected = (each.inverse_kinematics(p, limits="ignore", on_error="nan") for each in (leg, formulas))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


def test_whole_turns_are_taken_off(leg):
    q = [0.696, 1.1465, -0.0005]
    np.testing.assert_allclose(leg.inverse_kinematics(leg.foot_position(q)), q, rtol=0, atol=1e-7)


def test_the_knee_does_not_switch(leg, formulas):
    p = [0.09106576, -0.01538875, 0.182187]
    for each in (leg, formulas):
        with pytest.raises(JointLimitError, match=r"theta2 = 2\.25568 rad is outside"):
            each.inverse_kinematics(p)
    found = leg.inverse_kinematics(p, limits="ignore")
    np.testing.assert_allclose(found, formulas.inverse_kinematics(p, limits="ignore"), rtol=0, atol=1e-8)


@pytest.mark.parametrize("limits", ["ignore", "error"])
def test_a_point_of_another_branch_only_is_a_branch_error(leg, formulas, limits):
    with pytest.raises(BranchError):
        formulas.inverse_kinematics(BACK_POINT, limits=limits)
    with pytest.raises(BranchError, match=r"another branch does, outside the joint limits, at theta1 = ") as caught:
        leg.inverse_kinematics(BACK_POINT, limits=limits)
    error = caught.value
    # The formulas' branch ends 0.065 m before it: the links' difference.
    assert error.margin[0] == pytest.approx(-0.065, abs=1e-3)
    assert (error.branch, error.holding) == ("home", ())
    np.testing.assert_allclose(leg.foot_position(error.solution), BACK_POINT, atol=1e-9)


def test_on_either_side_of_the_straight_knee(leg):
    bent = np.array([0.3, 0.4, -1e-3])
    for knee in (-1e-3, 1e-3):
        p = leg.foot_position([0.3, 0.4, knee])
        found = leg.inverse_kinematics(p)
        assert found[2] == pytest.approx(-1e-3, abs=1e-7)
        np.testing.assert_allclose(leg.foot_position(found), p, atol=1e-9)
    np.testing.assert_allclose(leg.inverse_kinematics(leg.foot_position(bent)), bent, atol=1e-7)


def test_on_either_side_of_the_reach(leg):
    p, outwards = leg.foot_position([0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    inside = p - 1e-6 * outwards
    np.testing.assert_allclose(leg.foot_position(leg.inverse_kinematics(inside)), inside, atol=1e-9)
    with pytest.raises(OutOfReachError, match="nearest point found") as caught:
        leg.inverse_kinematics(p + 1e-6 * outwards)
    assert not isinstance(caught.value, BranchError)
    assert caught.value.margin[0] == pytest.approx(-1e-6, rel=0.01)


def test_on_either_side_of_a_limit(leg):
    for excess, inside in ((-1e-6, True), (1e-6, False)):
        p = leg.foot_position([0.1, LIMIT + excess, -0.6])
        if inside:
            assert leg.inverse_kinematics(p)[1] == pytest.approx(LIMIT + excess, abs=1e-8)
        else:
            with pytest.raises(JointLimitError, match="theta2"):
                leg.inverse_kinematics(p)


def test_the_symbolic_route_says_the_same(leg):
    symbolic = ld.load("quadruped_leg", route="symbolic")
    p = leg.foot_position([0.696, 1.1465, -0.0005])
    np.testing.assert_array_equal(symbolic.inverse_kinematics(p), leg.inverse_kinematics(p))
    with pytest.raises(BranchError):
        symbolic.inverse_kinematics(BACK_POINT)


# ------------------------------------------------------------------------------------------------------ any other leg


def test_the_branch_of_every_configuration_is_its_own_side(lab):
    leg = serial_leg(lab, {"home": (0.0, -0.5, -1.0), "other_knee": (0.0, 0.5, 1.0)})
    q = np.array([[0.4, -0.3, -0.9], [-0.7, 0.2, -1.5]])
    p = leg.foot_position(q)
    np.testing.assert_allclose(leg.inverse_kinematics(p), q, atol=1e-8)
    other = leg.inverse_kinematics(p, "other_knee", limits="ignore")
    assert (other[:, 2] > 0.0).all()
    np.testing.assert_allclose(other[:, 2], -q[:, 2], atol=1e-8)


def test_a_branch_that_holds_the_point_is_named(lab):
    leg = serial_leg(lab, {"home": (0.0, -0.5, -1.0), "back": (0.0, 2.6, 0.3)}, pitch=(-3.0, 3.0))
    p = np.array([0.07, 0.0, 0.0])  # nearer to the pitch axis than 0.3 - 0.2 m in front, not behind
    with pytest.raises(BranchError, match="choose branch 'back'") as caught:
        leg.inverse_kinematics(p)
    assert caught.value.holding == ("back",)
    found = leg.inverse_kinematics(p, "back", limits="ignore")
    np.testing.assert_allclose(leg.foot_position(found), p, atol=1e-9)


def test_a_singular_home_stands_for_the_side_of_the_middle_of_the_limits(lab):
    for knee, sign in (((-2.5, 0.1), -1.0), ((-0.1, 2.5), 1.0)):
        leg = serial_leg(lab, {"home": (0.0, 0.0, 0.0)}, knee=knee)
        q = np.array([0.4, 0.2, sign * 0.9])
        p = leg.foot_position([q, [-0.5, -0.3, -sign * 0.05]])
        found = leg.inverse_kinematics(p)
        np.testing.assert_allclose(found[0], q, atol=1e-8)
        assert found[1, 2] == pytest.approx(sign * 0.05, abs=1e-7)


def test_turns_that_the_limits_ask_for_are_kept(lab):
    leg = serial_leg(lab, {"home": (6.0, -0.5, -1.0)}, hip=(4.0, 8.0))
    q = np.array([[5.5, -0.4, -0.8], [7.5, -0.4, -0.8]])
    np.testing.assert_allclose(leg.inverse_kinematics(leg.foot_position(q)), q, atol=1e-8)
    outside = leg.foot_position([2.5, -0.4, -0.8])
    assert leg.inverse_kinematics(outside, limits="ignore")[0] == pytest.approx(2.5, abs=1e-8)
    with pytest.raises(JointLimitError, match=r"hip_joint = 2\.5 rad"):
        leg.inverse_kinematics(outside)


def test_turns_in_a_coupling_stay(lab):
    text = lab.Text("geared")
    text.joint("driver", "continuous", "base", "driver_link").joint(
        "toe", "fixed", "driver_link", "foot", xyz=(1, 0, 0)
    )
    for coupled in (False, True):
        if coupled:
            text.joint("driven", "continuous", "base", "driven_link", xyz=(0, 0, 0.1), independent=False)
            text.coupling("mesh", "driver_link", "driven_link", 0.5)
        text.parts = [part for part in text.parts if not part.startswith("<configuration")]
        text.configuration("home", {"driver": 7.0, "driven": 3.5} if coupled else {"driver": 7.0})
        route = PinocchioRoute(parse(text.xml), "foot", None)
        found = route.inverse_kinematics(np.array([math.cos(7.2), math.sin(7.2), 0.0]), "home", RowFailures())
        assert found == pytest.approx([7.2 if coupled else 7.2 - 2.0 * math.pi], abs=1e-8)


def test_two_singularities_at_once_are_two():
    before = np.diag([1.0, 1.0, 2.0])
    assert not _crosses_singularity(before, np.diag([0.5, 2.0, 0.1]))
    assert _crosses_singularity(before, np.diag([1.0, 1.0, -0.1]))
    # The determinant keeps its sign.
    assert _crosses_singularity(before, np.diag([1.0, -0.1, -0.1]))


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_a_leg_in_a_plane_with_three_coordinates(route):
    """Of them one is free: the home pose, and its neighbours, are regular."""
    leg = ld.load(three_rpr((0.872, 3.103)), route=route, foot="platform")
    p = leg.foot_position(leg.home)
    np.testing.assert_allclose(leg.inverse_kinematics(p), leg.home, atol=1e-9)
    beside = p + np.array([0.004, -0.005, 0.0])
    np.testing.assert_allclose(leg.foot_position(leg.inverse_kinematics(beside)), beside, atol=1e-9)
    with pytest.raises(OutOfReachError, match=r"0\.01 m away"):
        leg.inverse_kinematics(p + np.array([0.0, 0.0, 0.01]))
