"""Walks computed: the hexapod against its audit and against its own file, toy robots against power and symmetry."""

from __future__ import annotations

import csv
import dataclasses
import json
import pickle

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.gait import (
    FILES,
    GAITS,
    Limb,
    PhaseTable,
    Robot,
    Sway,
    columns,
    plan,
    robot_from,
    study,
    summary,
    swing_order,
    write,
)
from leg_dynamics.description import link_transforms, parse, read
from leg_dynamics.errors import (
    AssemblyError,
    DescriptionError,
    JointLimitError,
    OutOfReachError,
    ShapeError,
    SupportError,
    TrajectoryError,
)

from .gait_robots import HEIGHT, Telescope, toy_robot


@pytest.fixture(scope="module")
def hexapod():
    return robot_from(read("hexapod"), ld.load("hexapod_leg"))


@pytest.fixture(scope="module")
def tripod(hexapod):
    return study(hexapod, plan(hexapod, "tripod", period=4.0, stride=0.4, clearance=0.1))


# The hexapod.


def test_legs_come_from_the_file(hexapod):
    assert hexapod.leg_names == (
        "front_right",
        "front_left",
        "middle_right",
        "middle_left",
        "rear_right",
        "rear_left",
    )
    mirrored = [limb.name for limb in hexapod.limbs if limb.mirror != (1.0, 1.0, 1.0)]
    assert mirrored == ["front_left", "middle_left", "rear_left"]
    assert hexapod.limbs[1].mirror == (1.0, -1.0, 1.0)
    assert np.allclose(hexapod.gravity, [0.0, 0.0, -9.81], atol=1e-12)
    assert np.allclose(hexapod.homes[1], [0.7, 0.3, -0.715], atol=1e-12)
    assert hexapod.limbs[1].joints["front_left_alpha1"] == ("alpha1", -1.0)
    assert hexapod.limbs[1].joints["front_left_beta1"] == ("beta1", 1.0)
    assert hexapod.limbs[1].joints["front_left_l3"] == ("l3", 1.0)


@pytest.mark.parametrize(
    ("period", "stride", "clearance", "speed", "stance_speed", "force"),
    [
        (4.0, 0.4, 0.10, (255, 172, 249), (54, 54, 53), (-456, 400)),
        (2.0, 0.3, 0.10, (436, 258, 425), (62, 82, 60), (-332, 301)),
        (2.0, 0.4, 0.10, (510, 345, 498), (108, 109, 106), (-457, 400)),
        (2.0, 0.8, 0.15, (1166, 753, 1139), (391, 218, 384), (-1049, 824)),
    ],
)
def test_the_audits_tripod_table(hexapod, period, stride, clearance, speed, stance_speed, force):
    """Section 5 of the audit of Rong 2012: duty 0.5, a C2 path, y = 0, 136 kg on three feet with equal forces."""
    legs = hexapod.centre_of_mass([_home(limb) for limb in hexapod.limbs])[0] - hexapod.trunk_mass
    audited = dataclasses.replace(hexapod, trunk_mass=136.0 - legs)
    walk = plan(audited, "tripod", period=period, stride=stride, clearance=clearance)
    result = study(audited, walk, load="equal", limits="ignore")
    assert result.force[..., 2].max() == pytest.approx(445.0, rel=1e-3)
    for motion in result.limbs:
        peaks = motion.peaks()
        # The audit prints whole millimetres a second and newtons.
        assert np.abs(peaks.speed) * 1e3 == pytest.approx(np.array(speed), abs=0.75)
        assert np.abs(peaks.stance_speed) * 1e3 == pytest.approx(np.array(stance_speed), abs=0.75)
        assert peaks.stance_effort[0][1] == pytest.approx(force[0], rel=0.005)
        assert peaks.stance_effort[1][1] == pytest.approx(force[1], rel=0.005)


def _home(limb):
    return limb.leg.inverse_kinematics(limb.to_leg(limb.home))[None]


def test_the_robots_own_file_puts_the_feet_on_their_targets(tripod):
    robot = tripod.robot
    transforms = link_transforms(robot.description, tripod.joint_values())
    for i, limb in enumerate(robot.limbs):
        foot = transforms[limb.prefix + "foot"][..., :3, 3]
        assert np.abs(foot - tripod.feet.position[:, i]).max() < 1e-12
    for loop in robot.description.loops:
        ends = [(transforms[end.link] @ end.origin.matrix())[..., :3, 3] for end in (loop.predecessor, loop.successor)]
        assert np.abs(ends[0] - ends[1]).max() < 1e-12


def test_the_centre_of_mass_is_that_of_all_links_of_the_file(tripod):
    transforms = link_transforms(tripod.robot.description, tripod.joint_values())
    mass, moment = 0.0, 0.0
    for link in tripod.robot.description.links:
        if link.inertial is not None:
            place = transforms[link.name] @ np.array([*link.inertial.origin.xyz, 1.0])
            mass, moment = mass + link.inertial.mass, moment + link.inertial.mass * place[:, :3]
    assert tripod.mass == pytest.approx(mass, rel=1e-12)
    assert np.abs(tripod.com - moment / mass).max() < 1e-12


def test_mirrored_legs_are_the_legs_of_the_mirrored_file(hexapod):
    walk = plan(hexapod, "ripple", period=4.0, velocity=(0.04, 0.02), turn=0.1, clearance=0.06)
    result = study(hexapod, walk)
    left = ld.load("hexapod_leg", parameters={"side": -1})
    turn = np.diag([1.0, -1.0, -1.0])
    for i in (1, 3, 5):
        motion, limb = result.limbs[i], hexapod.limbs[i]
        foot = (result.feet.position[:, i] - limb.hip[:3, 3]) @ turn
        q = left.inverse_kinematics(foot)
        assert np.abs(q - motion.trajectory.q).max() < 1e-12
        pull = (hexapod.gravity - result.body.acceleration_at(limb.hip[:3, 3])) @ turn
        v, a = motion.trajectory.v, motion.trajectory.a
        effort = left.torque(q, v, a, foot_force=result.force[:, i] @ turn, gravity=pull)
        assert np.abs(effort - motion.effort).max() < 1e-9 * np.abs(effort).max()


@pytest.mark.parametrize("gait", GAITS)
@pytest.mark.parametrize("way", [{"stride": 0.2}, {"velocity": (0.0, 0.0), "turn": 0.15}])
def test_forces_balance_the_whole_robot(hexapod, gait, way):
    result = study(hexapod, plan(hexapod, gait, period=4.0, clearance=0.05, **way))
    load = result.mass * (result.body.acceleration_at(result.com) - hexapod.gravity)
    assert np.abs(result.force.sum(axis=1) - load).max() < 1e-9
    arms = result.feet.position - result.com[:, None]
    assert np.abs(np.cross(arms, result.force).sum(axis=1)).max() < 1e-9
    assert result.force[..., 2].min() > -1e-9
    assert (result.force[~result.stance] == 0.0).all()
    assert result.margin.min() > 0.0
    assert result.residual.max() < 1e-9


def test_both_tripods_do_the_same_half_a_period_apart(tripod):
    half = tripod.time + 2.0
    for one, other in ((0, 1), (2, 3), (4, 5)):
        a, b = tripod.limbs[one], tripod.limbs[other]
        for values, twin in ((a.trajectory.v, b.trajectory.v), (a.effort, b.effort)):
            # Mirrored legs, mirrored loads; samples at the switches have two sides.
            k = np.flatnonzero((tripod.time > 0.01) & (tripod.time < 1.98))
            later = np.stack([np.interp(half[k], tripod.time, column) for column in twin.T], axis=-1)
            assert np.abs(values[k] - later).max() < 1e-3 * np.abs(values).max()


def test_samples_see_both_sides_of_a_switch(tripod):
    standing = tripod.stance.sum(axis=1)
    assert (standing == 3).all()
    step = np.diff(tripod.time)
    assert (step > 0.0).all()
    assert np.count_nonzero(step < 1e-6) == 1
    assert (tripod.time[0], tripod.time[-1]) == (0.0, 4.0)


def test_a_long_stride_tips_the_hexapod_over(hexapod):
    walk = plan(hexapod, "tripod", period=2.0, stride=0.8, clearance=0.15)
    with pytest.raises(SupportError, match="outside their support polygon") as caught:
        study(hexapod, walk, limits="ignore")
    assert caught.value.margin.max() <= 0.0
    assert 0.5 < caught.value.time < 1.0
    kinematic = study(hexapod, walk, limits="ignore", load="none")
    assert kinematic.margin.min() == pytest.approx(caught.value.margin.min(), abs=1e-6)
    assert (kinematic.force == 0.0).all()


def test_a_friction_that_cannot_hold_is_named():
    robot = toy_robot(6)
    sway = Sway(np.zeros((1, 3)), np.array([[0.15, 0.0, 0.0]]))
    walk = plan(robot, "wave", period=0.8, stride=0.05, sway=sway)
    with pytest.raises(SupportError, match=r"friction of 0\.05"):
        study(robot, walk, friction=0.05)


def test_limits_reach_and_modes_are_named_with_leg_joint_time_and_margin(hexapod):
    with pytest.raises(JointLimitError, match="front_right_l1") as limit:
        study(hexapod, plan(hexapod, "tripod", period=4.0, stride=0.4, clearance=0.45))
    assert limit.value.leg == "front_right"
    assert limit.value.joint == "front_right_l1"
    assert limit.value.margin[0] < 0.0
    assert 2.0 > limit.value.time > 0.0
    with pytest.raises(OutOfReachError, match=r"leg 'L0' at t = ") as reach:
        study(toy_robot(4), plan(toy_robot(4), "wave", period=4.0, stride=4.5), load="none", limits="ignore")
    assert reach.value.leg == "L0"
    assert reach.value.margin.max() < 0.0
    assert reach.value.time == pytest.approx(4.0 * (reach.value.rows[0] / 400), abs=0.02)
    with pytest.raises(AssemblyError, match="changes its assembly mode") as flip:
        study(
            toy_robot(4, Telescope(flip_at=0.05)), plan(toy_robot(4), "wave", period=4.0, stride=0.2), limits="ignore"
        )
    assert flip.value.leg == "L0"
    with pytest.raises(AssemblyError, match="choose another branch") as mode:
        study(hexapod, plan(hexapod, "tripod", period=4.0, stride=0.2), branch="B2_up_B3_down", limits="ignore")
    assert mode.value.leg == "front_right"


@pytest.mark.parametrize(
    "change",
    [{"samples": 2}, {"samples": 10.5}, {"load": "heavy"}, {"limits": "maybe"}, {"load": "equal", "friction": 0.5}],
)
def test_bad_options_are_named(change):
    robot = toy_robot(4)
    with pytest.raises(TrajectoryError):
        study(robot, plan(robot, "wave", period=2.0, stride=0.1), **change)


def test_a_walk_fits_its_robot_only(hexapod):
    with pytest.raises(TrajectoryError, match="4 legs"):
        study(hexapod, plan(toy_robot(4), "wave", period=2.0, stride=0.1))


# Toy robots.


@pytest.mark.parametrize("count", [4, 6, 8])
@pytest.mark.parametrize("gait", ["wave", "ripple"])
def test_actuators_deliver_the_power_of_the_feet(count, gait):
    robot = toy_robot(count)
    way = {"velocity": (0.1, 0.03), "turn": 0.2}
    load = "equal" if count == 4 else "balanced"
    result = study(robot, plan(robot, gait, period=2.0, **way), load=load)
    for i, motion in enumerate(result.limbs):
        actuators = (motion.effort * motion.trajectory.v).sum(axis=1)
        feet = -(result.force[:, i] * result.feet.velocity[:, i]).sum(axis=1)
        assert np.abs(actuators - feet).max() < 1e-10
        assert (
            np.abs(
                motion.limb.leg.foot_position(motion.trajectory.q) - motion.limb.to_leg(result.feet.position[:, i])
            ).max()
            < 1e-12
        )


def test_eight_legs_on_alternating_tetrapods_stand_on_four():
    robot = toy_robot(8)
    result = study(robot, plan(robot, "tripod", period=2.0, stride=0.1))
    assert (result.stance.sum(axis=1) == 4).all()
    assert result.margin.min() > 0.1
    assert result.com == pytest.approx(0.0)


def test_a_symmetric_tripod_shares_its_load_symmetrically():
    robot = toy_robot(6)
    result = study(robot, plan(robot, "tripod", period=2.0, velocity=(0.0, 0.0)))
    for k in range(result.time.size):
        standing = result.stance[k]
        middle = standing & np.array(["1" in name for name in robot.leg_names])
        weight = 9.81 * 20.0
        assert np.allclose(result.force[k, middle, 2], weight / 2)
        assert np.allclose(result.force[k, standing & ~middle, 2], weight / 4)


def test_a_trot_has_no_static_equilibrium():
    robot = toy_robot(4, trunk_com=(0.05, 0.0, 0.0))
    walk = plan(robot, "tripod", period=1.0, stride=0.1)
    with pytest.raises(SupportError) as caught:
        study(robot, walk)
    assert caught.value.rows.size > 0
    equal = study(robot, walk, load="equal")
    assert equal.residual.max() > 1.0
    with pytest.raises(SupportError, match="no foot"):
        study(robot, dataclasses.replace(walk, table=PhaseTable((0.0,) * 4, 0.4)), load="equal")


def test_a_creep_needs_sway_and_sway_helps():
    """Uniform motion at duty 0.75 has no margin to spare; a shift of the body away from the swinging leg makes some."""
    robot = toy_robot(4)
    table = swing_order(("L1", "L0", "R1", "R0"), robot)
    still = study(robot, plan(robot, table, period=8.0, stride=0.1), load="none")
    assert still.margin.min() == pytest.approx(0.0, abs=1e-3)
    # Left legs swing in the first half of the period.
    sway = Sway(np.zeros((1, 3)), np.array([[0.0, -0.06, 0.0]]))
    swaying = study(robot, plan(robot, table, period=8.0, stride=0.1, sway=sway), load="none")
    assert swaying.margin[np.abs(np.sin(2 * np.pi * swaying.time / 8.0)) > 0.9].min() > 0.03


def test_hip_acceleration_reaches_the_leg():
    class Heavy(Telescope):
        def torque(self, q, v, a, foot_force=None, gravity=None):
            return np.broadcast_to(gravity, q.shape)

    robot = toy_robot(6, Heavy())
    walk = plan(robot, "tripod", period=2.0, velocity=(0.1, 0.0), turn=0.5)
    result = study(robot, walk)
    limb = robot.limbs[0]
    x, y = limb.hip[:2, 3]
    # Centripetal, in the body: w x v, and -w^2 r.
    expected = robot.gravity - np.array([-0.25 * x, 0.5 * 0.1 - 0.25 * y, 0.0])
    assert np.allclose(limb.vector_to_body(result.limbs[0].effort), expected, atol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_efforts_are_held_against_the_limit_of_their_side(sign):
    leg = Telescope()
    robot = toy_robot(6, leg)
    limbs = [dataclasses.replace(limb, joints={f"{limb.name}_r": ("r", sign)}) for limb in robot.limbs]
    robot = dataclasses.replace(robot, limbs=tuple(limbs))
    result = study(robot, plan(robot, "tripod", period=4.0, velocity=(0.1, 0.0)))
    strut = np.concatenate([motion.effort[:, 2] for motion in result.limbs])
    assert strut.min() == 0.0 < strut.max()  # struts push only

    def judged(lower, upper):
        leg.limits.effort_lower, leg.limits.effort = np.array([-1e4, -1e4, lower]), np.array([1e4, 1e4, upper])
        facts = summary(result)
        rows = [each["actuators"][2] for each in facts["legs"]]
        ends = sorted((sign * lower, sign * upper))
        assert all([row["effort_lower_limit"], row["effort_limit"]] == ends for row in rows)
        assert facts["drives_suffice"] == all(row["effort_within_limit"] for row in rows)
        return facts["drives_suffice"], facts["verdict"]

    most = strut.max()
    assert judged(0.0, 1.01 * most)[0]
    assert judged(-most, 1.01 * most)[0]
    enough, said = judged(-2.0 * most, 0.5 * most)
    assert (enough, f"with {sign * most:.4g}  where {0.5 * sign * most:.4g}  are allowed" in said) == (False, True)
    enough, said = judged(-2.0 * most, 0.0)
    assert (enough, f"with {sign * most:.4g}  where 0  are allowed" in said) == (False, True)


# Reading and reporting.


def _toy_file(spacing=0.0, mass=1.0):
    parts = ""
    for prefix, side, x in (("a_", 1, 0.0), ("b_", -1, spacing)):
        parts += f"""
  <link name="{prefix}hip"/>
  <link name="{prefix}shin"><inertial><origin xyz="0 {0.02 * side} 0.1"/><mass value="{mass if side < 0 else 1.0}"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="{prefix}foot"/>
  <joint name="{prefix}mount" type="fixed"><parent link="base"/><child link="{prefix}hip"/>
    <origin xyz="{x} 0 0"/></joint>
  <joint name="{prefix}swing" type="revolute"><parent link="{prefix}hip"/><child link="{prefix}shin"/>
    <axis xyz="1 0 0"/><origin xyz="0 {0.1 * side} 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="{prefix}tip" type="fixed"><parent link="{prefix}shin"/><child link="{prefix}foot"/>
    <origin xyz="0 0 1"/></joint>"""
    return f'<robot name="pair"><link name="base"/>{parts}</robot>'


def _toy_leg():
    text = _toy_file()
    keep = text.replace("a_", "")
    start, end = keep.index('<link name="b_hip"/>'), keep.index("</robot>")
    return ld.load(keep[:start] + keep[end:], route="pinocchio")


def test_any_prefix_is_a_leg_and_the_mirror_is_found():
    robot = robot_from(parse(_toy_file(0.5)), _toy_leg())
    assert robot.leg_names == ("a", "b")
    assert [limb.mirror for limb in robot.limbs] == [(1.0, 1.0, 1.0), (1.0, -1.0, 1.0)]
    assert robot.limbs[1].joints == {"b_swing": ("swing", -1.0)}
    assert robot.limbs[1].signs == pytest.approx([-1.0])
    assert np.allclose(robot.limbs[1].home, [0.5, -0.1, 1.0])
    assert robot.trunk_mass == 0.0
    total, com = robot.centre_of_mass([np.zeros((3, 1))] * 2)
    assert total == 2.0
    assert np.allclose(com, [[0.25, 0.0, 0.1]] * 3)


def test_what_is_no_image_of_the_leg_is_refused(hexapod):
    with pytest.raises(DescriptionError, match=r"the inertia of b_shin differs by 0\.5"):
        robot_from(parse(_toy_file(mass=1.5)), _toy_leg())
    with pytest.raises(DescriptionError, match="no leg like"):
        robot_from(parse(_toy_file()), ld.load("omnileg"))
    with pytest.raises(DescriptionError, match="front_right"):
        robot_from(read("hexapod"), ld.load("hexapod_leg_preliminary"))
    fits = robot_from(read("hexapod"), [ld.load("hexapod_leg_preliminary"), ld.load("hexapod_leg")])
    assert fits.leg_names == hexapod.leg_names


@pytest.mark.parametrize(
    "change",
    [
        {"hip": np.diag([1.0, 1.0, -1.0, 1.0])},
        {"hip": np.eye(3)},
        {"hip": np.full((4, 4), np.nan)},
        {"mirror": (1.0, -1.0, -1.0)},
        {"mirror": (1.0, 0.5, 1.0)},
        {"home": (0.0, 0.0)},
        {"leg": object()},
    ],
)
def test_limbs_are_checked(change):
    arguments = {"name": "leg", "leg": Telescope(), "hip": np.eye(4), "home": (0.0, 0.0, -HEIGHT)} | change
    with pytest.raises(ShapeError):
        Limb(**arguments)


def test_robots_are_checked_and_found_by_name():
    robot = toy_robot(4)
    assert robot.limb("R1") is robot.limbs[3]
    with pytest.raises(TrajectoryError, match="no leg 'X'"):
        robot.limb("X")
    with pytest.raises(TrajectoryError, match="same name"):
        Robot("twins", (robot.limbs[0], robot.limbs[0]), 1.0)
    with pytest.raises(TrajectoryError, match="no leg to walk on"):
        Robot("stone", (), 1.0)
    with pytest.raises(DescriptionError, match="no mass"):
        toy_robot(4, mass=0.0).centre_of_mass([np.zeros((1, 3))] * 4)


def test_a_robot_survives_pickling(hexapod):
    copy = pickle.loads(pickle.dumps(hexapod))
    assert copy.leg_names == hexapod.leg_names
    assert np.array_equal(copy.homes, hexapod.homes)


def test_the_cycle_is_written(tripod, tmp_path):
    written = write(tripod, tmp_path / "new")
    assert tuple(path.name for path in written) == FILES
    facts = json.loads((tmp_path / "new" / "summary.json").read_text(encoding="utf-8"))
    assert facts["robot"] == "hexapod"
    assert facts["stability_margin [m]"]["least"] == pytest.approx(tripod.margin.min())
    assert facts["legs"][0]["joints"][0]["joint"] == "front_right_l1"
    with (tmp_path / "new" / "cycle.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == tripod.time.size
    assert float(rows[10]["front_left_l2 [m]"]) == pytest.approx(tripod.limbs[1].trajectory.q[10, 1], rel=1e-10)
    assert float(rows[10]["tau_front_left_drive_2 [N]"]) == pytest.approx(tripod.limbs[1].effort[10, 1], rel=1e-10)
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written[3:])


def test_toy_studies_are_reported_too():
    robot = toy_robot(4)
    walk = plan(robot, PhaseTable((0.0, 0.0, 0.5, 0.5), 0.4), period=1.0, stride=0.1)
    result = study(robot, walk, load="none")
    facts = summary(result)
    # With no foot on the ground there is no margin, which JSON cannot say by a number.
    assert facts["stability_margin [m]"]["least"] is None
    assert len(columns(result)["t [s]"]) == result.time.size
    assert set(result.efforts()) == {f"{leg}_{name}" for leg in robot.leg_names for name in ("alpha", "beta", "r")}
