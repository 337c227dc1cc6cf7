"""Targets that nothing reaches: refused without a search where the links are too short, and one search a call else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.trajectories.feasibility import _Margin
from leg_dynamics.errors import OutOfReachError
from leg_dynamics.mechanism.reach import from_hip, is_beyond, longest_reach, reach_text
from leg_dynamics.mechanism.redundant import PoseSearch
from leg_dynamics.mechanism.route import PinocchioRoute

MY_LEG = Path(__file__).parents[2] / "examples" / "my_leg.urdf"


def serial_leg(lab, slide=None):
    """Links of 0.1, 0.3 and 0.2 m along x between joints about z, -y, -y, the first one 0.05 m above the root."""
    text = lab.Text("serial")
    text.joint("hip_joint", "revolute", "base", "hip_link", xyz=(0, 0, 0.05), limit=(-3, 3))
    text.joint("pitch", "revolute", "hip_link", "thigh", (0, -1, 0), (0.1, 0, 0), limit=(-2, 2))
    text.joint("knee", slide or "revolute", "thigh", "shank", (0, -1, 0), (0.3, 0, 0), limit=(-2.5, 2.5))
    text.joint("toe", "fixed", "shank", "foot", xyz=(0.12, 0, 0.16))
    return ld.load(text.xml, foot="foot", route="pinocchio")


def test_the_links_laid_out_straight(lab):
    mechanism = serial_leg(lab).backend.mechanism
    assert longest_reach(mechanism) == pytest.approx(0.05 + 0.1 + 0.3 + 0.2, abs=1e-15)
    assert longest_reach(serial_leg(lab, "prismatic").backend.mechanism) == np.inf
    # Thigh and shank of the file; crank and coupler are not on the way to the foot.
    assert longest_reach(ld.load(MY_LEG).backend.mechanism) == pytest.approx(0.22 + 0.24, abs=1e-15)


@pytest.mark.parametrize("name", ["omnileg", "quadruped_leg"])
def test_no_pose_is_beyond_it(name):
    leg = ld.load(name, route="pinocchio")
    q = leg.home + np.random.default_rng(0).uniform(-2.0, 2.0, (200, len(leg.joint_names)))
    feet = leg.foot_position(q, on_error="nan")
    feet = feet[np.isfinite(feet).all(axis=1)]
    assert len(feet) > 10
    assert not is_beyond(feet, longest_reach(leg.backend.mechanism)).any()


def test_distances_and_words():
    assert from_hip(np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]])).tolist() == [5.0, 0.0]
    assert is_beyond(np.array([0.0, 1e200, 1e200]), 0.5)
    assert not is_beyond(np.array([0.0, 1e200, 1e200]), np.inf)
    assert not is_beyond(np.array([0.0, 0.3, 0.4]), 0.5)
    assert reach_text(np.array([300.0, 0.0, 400.0]), 0.5).endswith("0.5 m together; is the point in millimetres?")
    assert reach_text(np.array([0.3, 0.0, 0.5]), 0.5).endswith("0.5 m together")


@pytest.fixture
def descents(monkeypatch):
    """Targets of the descents made since."""
    made = []
    original = PinocchioRoute._descend

    def counted(self, p, *others):
        made.append(p)
        return original(self, p, *others)

    monkeypatch.setattr(PinocchioRoute, "_descend", counted)
    return made


@pytest.mark.parametrize("on_error", ["raise", "nan"])
def test_a_path_in_millimetres_takes_one_descent(descents, on_error):
    leg = ld.load(MY_LEG, route="pinocchio")
    p = 1000.0 * leg.foot_position(np.linspace([0.1, -0.8], [0.5, -1.0], 101))
    if on_error == "nan":
        assert np.isnan(leg.inverse_kinematics(p, on_error="nan")).all()
    else:
        text = r"101 of 101 rows failed; first row 0: .* in millimetres\?"
        with pytest.raises(OutOfReachError, match=text) as caught:
            leg.inverse_kinematics(p)
        error = caught.value
        assert error.rows.tolist() == list(range(101))
        np.testing.assert_allclose(error.margin, -np.linalg.norm(p, axis=1), atol=0.5)
        away = np.linalg.norm(leg.foot_position(error.nearest) - p[0])
        assert error.margin[0] == pytest.approx(-away)
        assert (error.margin >= -np.linalg.norm(p, axis=1) - 0.46).all()
    assert len(descents) == 1


@pytest.mark.parametrize("oriented", [False, True])
def test_poses_beyond_the_links_take_few_descents(monkeypatch, oriented):
    leg = ld.load("quadruped_leg", route="pinocchio")
    made = []
    original = PoseSearch._descend
    monkeypatch.setattr(PoseSearch, "_descend", lambda self, *given: made.append(0) or original(self, *given))
    p = np.array([[300.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    rotation = np.eye(3) if oriented else None
    with pytest.raises(OutOfReachError, match=r"2 of 2 rows failed; .* length of 0\.29 m together") as caught:
        leg.pose_inverse_kinematics(p, rotation)
    assert len(made) <= 6
    assert caught.value.margin == pytest.approx([-299.71, -0.21], abs=1e-2 if oriented else 1e-6)


def test_the_margins_of_a_window_are_those_of_each_point():
    class Sideways:
        @staticmethod
        def value(times):
            return np.stack([0.0 * times, 0.005 * times, -0.4 + 0.0 * times], axis=-1)

    leg = ld.load(MY_LEG, route="pinocchio")
    margins, joints = _Margin(leg, Sideways, np.zeros(3), leg.branches[0], "ignore").rows(
        0.0, np.array([1.0, 2.0, 3.0])
    )
    np.testing.assert_allclose(margins, [-0.005, -0.01, -0.015], rtol=1e-5)
    assert joints.tolist() == [-1, -1, -1]
