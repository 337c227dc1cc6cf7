"""Limits along a gait, passive joints included, and tilted bodies: against the poses of the robot's own file."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.gait import Limb, Robot, Tilt, columns, picture, plan, robot_from, study, summary, write
from leg_dynamics.description import link_transforms, read
from leg_dynamics.errors import DescriptionError, JointLimitError

from .gait_robots import toy_robot

TILT = Tilt(0.04, 0.06, cosine=np.zeros((1, 2)), sine=np.array([[0.02, 0.03]]))


@pytest.fixture(scope="module")
def hexapod():
    return robot_from(read("hexapod"), ld.load("hexapod_leg"))


@pytest.fixture(scope="module")
def tilted(hexapod):
    way = {"velocity": (0.06, 0.02), "turn": 0.05}
    return study(hexapod, plan(hexapod, "ripple", period=4.0, clearance=0.05, tilt=TILT, **way), samples=60)


def of(result, name):
    (found,) = (each for each in result.limits if each.name == name)
    return found


def test_every_limit_of_the_robots_file_is_there(hexapod, tilted):
    file = hexapod.description
    limited = sum(np.isfinite([j.limits.lower, j.limits.upper]).sum() for j in file.joints if j.is_single_coordinate)
    assert len(tilted.limits) == limited + len(file.cones) + len(file.telescopes) + len(file.clearances)
    for limb in hexapod.limbs:
        own = [each for each in tilted.limits if each.leg == limb.name]
        assert len(own) == len(tilted.limits) / 6
        assert all(limb.prefix in each.name for each in own)
    assert all(each.margin.shape == tilted.time.shape for each in tilted.limits)
    assert tilted.nearest_limits()[0].least_normalised == min(each.least / each.scale for each in tilted.limits)


def test_margins_are_those_of_the_robots_poses(hexapod, tilted):
    """Angles and distances from homogeneous transforms of the file's links, in NumPy."""
    values, file = tilted.joint_values(), hexapod.description
    transforms = link_transforms(file, values)
    for joint in file.joints:
        if joint.is_single_coordinate and joint.type != "fixed":
            q = values[joint.name]
            assert of(tilted, f"{joint.name} lower limit").margin == pytest.approx(q - joint.limits.lower, abs=1e-12)
            assert of(tilted, f"{joint.name} upper limit").margin == pytest.approx(joint.limits.upper - q, abs=1e-12)
    for cone in file.cones:
        a = transforms[cone.link][:, :3, :3] @ np.array(cone.axis)
        b = transforms[cone.other_link][:, :3, :3] @ np.array(cone.other_axis)
        angle = np.arccos((a * b).sum(axis=-1))
        assert of(tilted, f"cone {cone.name}").margin == pytest.approx(cone.upper - angle, abs=1e-7)
    for telescope in file.telescopes:
        left = telescope.sleeve + telescope.rod - telescope.overlap - values[telescope.joint]
        assert of(tilted, f"telescope {telescope.joint}").margin == pytest.approx(left, abs=1e-12)
    share = np.linspace(0.0, 1.0, 201)[:, None]
    for clearance in file.clearances:
        lines = []
        for end in (clearance.first, clearance.second):
            place = transforms[end.link][::12]
            points = (1.0 - share) * np.array(end.start) + share * np.array(end.end)
            lines.append(np.einsum("tij,pj->tpi", place[:, :3, :3], points) + place[:, None, :3, 3])
        apart = np.linalg.norm(lines[0][:, :, None] - lines[1][:, None], axis=-1).min(axis=(1, 2))
        radii = clearance.first.radius + clearance.second.radius + clearance.minimum
        found = of(tilted, f"clearance {clearance.name}").margin[::12]
        # Points 2.5 mm apart on either line never come nearer than the lines, and by some 1e-5 m at most less near.
        assert (apart - radii >= found - 1e-12).all()
        assert apart - radii == pytest.approx(found, abs=1e-4)


def test_mirrored_legs_count_their_own_limits(hexapod):
    result = study(hexapod, plan(hexapod, "tripod", period=4.0, velocity=(0.05, 0.05), clearance=0.05), samples=40)
    joint = "front_left_alpha1"
    q = result.joint_values()[joint]
    assert result.robot.limbs[1].joints[joint] == ("alpha1", -1.0)
    limits = result.robot.description.joint(joint).limits
    assert of(result, f"{joint} upper limit").margin == pytest.approx(limits.upper - q, abs=1e-12)
    assert of(result, f"{joint} lower limit").margin == pytest.approx(q - limits.lower, abs=1e-12)


@pytest.mark.parametrize(
    ("limit", "value", "name", "kind"),
    [
        ("universal_range", 20.0, "_beta", "joint"),
        ("ball_range", 1.0, "cone front_right_ball_3", "cone"),
        ("clearance_min", 0.03, "clearance front_right_sleeves_1_3", "clearance"),
        ("overlap_min", 0.17, "telescope front_right_l2", "telescope"),
    ],
)
def test_a_broken_limit_is_named_with_leg_time_and_margin(limit, value, name, kind):
    robot = robot_from(read("hexapod", parameters={limit: value}), ld.load("hexapod_leg", parameters={limit: value}))
    walk = plan(robot, "tripod", period=4.0, stride=0.3, clearance=0.1)
    with pytest.raises(JointLimitError, match="breaks its limit") as caught:
        study(robot, walk, samples=40)
    error = caught.value
    assert name in error.limit
    assert error.kind == kind
    assert error.leg in error.limit
    result = study(robot, walk, samples=40, limits="ignore")
    broken = of(result, error.limit)
    assert error.margin.min() == broken.least < 0.0
    assert error.time == result.time[broken.row]
    assert np.array_equal(error.rows, np.flatnonzero(broken.margin < 0.0))
    assert broken.least_normalised == result.nearest_limits()[0].least_normalised
    facts = summary(result)
    assert facts["limits_hold"] is False
    assert facts["nearest_limit"]["limit"] == error.limit
    assert facts["nearest_limit"]["margin"] == broken.least
    assert facts["nearest_limit"]["at [s]"] == error.time


def test_without_a_file_of_the_robot_the_legs_limits_count(hexapod):
    limbs = [Limb(each.name, each.leg, each.hip, each.home, each.mirror) for each in hexapod.limbs]
    bare = Robot("bare", limbs, 60.0)
    walk = plan(hexapod, "tripod", period=4.0, stride=0.2)
    one, other = (study(robot, walk, samples=40, load="none") for robot in (hexapod, bare))
    assert len(one.limits) == len(other.limits)
    for each in other.limits:
        assert each.leg in hexapod.leg_names
    assert sorted(each.least for each in one.limits) == pytest.approx(sorted(each.least for each in other.limits))
    toy = toy_robot(4)
    result = study(toy, plan(toy, "wave", period=2.0, stride=0.1), load="none")
    assert [each.name for each in result.limits[:2]] == ["L0_alpha lower limit", "L0_alpha upper limit"]
    assert of(result, "R1_r upper limit").margin == pytest.approx(1.0 - result.limbs[3].trajectory.q[:, 2])


# Tilted bodies.


def test_feet_of_a_tilted_body_stand_on_level_ground(hexapod, tilted):
    transforms = link_transforms(hexapod.description, tilted.joint_values())
    for i, limb in enumerate(hexapod.limbs):
        foot = transforms[f"{limb.prefix}foot"][..., :3, 3]
        assert np.abs(foot - tilted.feet.position[:, i]).max() < 1e-12
        height = tilted.body.level(foot)[tilted.stance[:, i], 2]
        assert height == pytest.approx(np.full(height.size, -0.715), abs=1e-12)


def test_forces_of_a_tilted_body_balance_weight_and_acceleration(tilted):
    body, gravity = tilted.body, tilted.body.in_body(np.broadcast_to([0.0, 0.0, -9.81], (tilted.time.size, 3)))
    load = tilted.mass * (body.acceleration_at(tilted.com) - gravity)
    assert np.abs(tilted.force.sum(axis=1) - load).max() < 1e-8
    arms = tilted.feet.position - tilted.com[:, None]
    assert np.abs(np.cross(arms, tilted.force).sum(axis=1)).max() < 1e-8
    assert tilted.level_force[..., 2].min() > -1e-8
    assert np.abs(tilted.level_force.sum(axis=1)[:, 2] / tilted.mass - 9.81).max() < 0.5


def test_a_fixed_tilt_is_another_pose_of_the_same_walk(hexapod):
    """The stability margin of a robot pitched about its own origin, from rotated points."""
    upright, pitched = (
        study(hexapod, plan(hexapod, "tripod", period=4.0, stride=0.2, clearance=0.05, tilt=tilt), samples=40)
        for tilt in (None, (0.0, 0.1))
    )
    assert pitched.body.level(pitched.feet.position) == pytest.approx(upright.feet.position, abs=1e-12)
    c, s = np.cos(0.1), np.sin(0.1)
    ahead = c * pitched.com[:, 0] + s * pitched.com[:, 2]
    assert pitched.body.level(pitched.com)[:, 0] == pytest.approx(ahead, abs=1e-14)
    # Nothing turns: the legs' efforts are those of each leg under gravity and force of the tilted hip frame.
    motion, limb = pitched.limbs[2], hexapod.limbs[2]
    gravity = limb.vector_to_leg(9.81 * np.array([s, 0.0, -c]))
    on_foot = limb.vector_to_leg(pitched.force[:, 2])
    q, v, a = motion.trajectory.q, motion.trajectory.v, motion.trajectory.a
    effort = limb.leg.torque(q, v, a, foot_force=on_foot, gravity=gravity)
    assert effort == pytest.approx(motion.effort, abs=1e-9)


def test_work_of_a_tilting_body():
    """Power of the drives of massless legs is what the feet take up, while the body rolls and pitches."""
    robot = toy_robot(6)
    tilt = Tilt(cosine=np.array([[0.05, 0.0]]), sine=np.array([[0.0, 0.08]]))
    result = study(robot, plan(robot, "wave", period=2.0, velocity=(0.05, 0.0), turn=0.1, tilt=tilt))
    for i, motion in enumerate(result.limbs):
        drives = (motion.effort * motion.trajectory.v).sum(axis=1)
        feet = -(result.force[:, i] * result.feet.velocity[:, i]).sum(axis=1)
        assert np.abs(drives - feet).max() < 1e-10


def test_the_picture_of_a_tilted_walk(hexapod, tilted):
    upright = study(hexapod, plan(hexapod, "tripod", period=4.0, stride=0.2), samples=40)
    assert picture(upright).description is hexapod.description
    scene = picture(tilted)
    assert scene.description.root != hexapod.description.root
    transforms = link_transforms(scene.description, scene.values)
    for i, limb in enumerate(hexapod.limbs):
        assert np.abs(transforms[f"{limb.prefix}foot"][..., :3, 3] - scene.feet[:, i]).max() < 1e-12
        assert np.ptp(scene.feet[tilted.stance[:, i], i, 2]) < 1e-12
    toy = toy_robot(4)
    bare = study(toy, plan(toy, "wave", period=2.0, stride=0.1), load="none")
    with pytest.raises(DescriptionError, match="nothing to show"):
        picture(bare)


# Reports.


def test_limits_are_reported(tilted, tmp_path):
    facts = summary(tilted)
    assert facts["limits_hold"] is True
    assert facts["limits_between_legs"] == []
    assert facts["body_tilt [rad]"]["roll"] == pytest.approx([0.02, 0.06], abs=1e-4)
    leg = facts["legs"][1]
    assert leg["name"] == "front_left"
    shares = [row["normalised"] for row in leg["limits"]]
    assert shares == sorted(shares)
    assert {row["kind"] for row in leg["limits"]} == {"joint", "cone", "telescope", "clearance"}
    write(tilted, tmp_path)
    assert (
        json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["nearest_limit"] == facts["nearest_limit"]
    )
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert facts["nearest_limit"]["limit"] in page
    assert "<script" not in page
    assert (tmp_path / "limits.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "cycle.csv").open(encoding="utf-8", newline="") as file:
        row = list(csv.DictReader(file))[7]
    own = [each.margin[7] / each.scale for each in tilted.limits if each.leg == "front_left"]
    assert float(row["front_left_limit_margin [1]"]) == pytest.approx(min(own), rel=1e-10)
    assert float(row["pitch [rad]"]) == pytest.approx(0.06 + 0.03 * np.sin(np.pi * tilted.time[7] / 2.0), rel=1e-9)
    assert "roll [rad]" in columns(tilted)
