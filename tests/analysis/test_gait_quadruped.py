"""The creeping gait of the modular quadruped (Chen & Dong 2021): rhythm, limits, stability with and without sway."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import warnings

import coal
import numpy as np
import pinocchio as pin
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.gait import (
    FILES,
    LimbMotion,
    Settings,
    Sway,
    Tilt,
    columns,
    margin_bound,
    phase_table,
    plan,
    plan_walk,
    robot_from,
    settings_for,
    share_load,
    splayed_homes,
    static_margin,
    steadying_sway,
    study,
    summary,
    support_margin,
    swing_order,
    tracks,
    write,
)
from leg_dynamics.analysis.gait.page import render_page
from leg_dynamics.analysis.gait.stills import _polygons, still_rows
from leg_dynamics.description import link_transforms, read, shipped_urdf
from leg_dynamics.description.model import Geometry
from leg_dynamics.errors import JointLimitError, OutOfReachError, TrajectoryError

from .gait_robots import toy_robot

ORDER = ("III", "I", "IV", "II")
RNG = np.random.default_rng(11)


@pytest.fixture(scope="module")
def robot():
    return robot_from(read("quadruped"), [ld.load("quadruped_leg"), ld.load("quadruped_leg_reversed")])


@pytest.fixture(scope="module")
def planned(robot):
    return plan_walk(robot)


@pytest.fixture(scope="module")
def creep(robot, planned):
    return study(robot, planned.walk, samples=200, choices=planned.choices, alternatives=planned.alternatives)


def walk_in_order(robot, order=ORDER, duty=0.75, **options):
    return plan_walk(robot, gait=order, duty=duty, sway=(0.0, 0.0), **options).walk


# The robot and the walk.


def test_front_legs_are_the_reversed_ones(robot):
    assert robot.leg_names == ("I", "II", "III", "IV")
    assert [limb.leg.name for limb in robot.limbs] == ["quadruped_leg_reversed"] * 2 + ["quadruped_leg"] * 2
    assert all(min(limb.mirror) > 0.0 for limb in robot.limbs)


def test_legs_step_in_the_papers_order_and_leg_four_within_10_to_15_seconds(creep):
    facts = summary(creep)
    times = {leg["name"]: (leg["lifts_off [s]"], leg["touches_down [s]"]) for leg in facts["legs"]}
    assert sorted(times, key=lambda leg: times[leg][0]) == list(ORDER)
    assert times["IV"] == pytest.approx((10.0, 14.0))
    assert facts["period [s]"] == 20.0
    assert (creep.stance.sum(axis=1) >= 3).all()
    moving = tracks(creep).foot_speed[:, 3] > 0.0
    assert creep.time[moving].min() >= 10.0
    assert creep.time[moving].max() <= 15.0


def test_without_pauses_leg_four_swings_from_10_to_15_seconds(robot):
    walk = walk_in_order(robot)
    ends = np.mod(np.array([walk.table.phases[3] + 0.75, walk.table.phases[3]]), 1.0) * 20.0
    assert ends == pytest.approx([10.0, 15.0])


def test_all_joints_keep_to_70_degrees(creep):
    values = creep.joint_values()
    assert len(values) == 12
    assert max(np.abs(q).max() for q in values.values()) < np.radians(70.0) - 0.1
    assert all(each.holds for each in creep.limits)
    assert len(creep.limits) == 24


def test_neighbouring_legs_do_not_touch_and_would_without_splay(robot, creep):
    assert leg_distance(creep) > 0.01
    straight = study(robot, plan_walk(robot, splay=0.0, sway=(0.0, 0.0)).walk, samples=40, load="none")
    assert leg_distance(straight) <= 1e-6


def leg_distance(result):
    """Least distance of the collision shapes of neighbouring legs, m, by the collision library."""
    path = str(shipped_urdf("quadruped"))
    model = pin.buildModelFromUrdf(path)
    shapes = pin.buildGeomFromUrdf(model, path, pin.GeometryType.COLLISION)
    legs = {name: [] for name in result.robot.leg_names}
    for number, shape in enumerate(shapes.geometryObjects):
        name = shape.name.split("_")[0]
        if name in legs:
            legs[name].append(number)
    for one, other in (("I", "III"), ("II", "IV")):
        for first in legs[one]:
            for second in legs[other]:
                shapes.addCollisionPair(pin.CollisionPair(first, second))
    data, found, values = model.createData(), shapes.createData(), result.joint_values()
    least = np.inf
    for k in range(0, result.time.size, 5):
        pin.computeDistances(model, data, shapes, found, configuration(model, values, k))
        least = min(least, *(each.min_distance for each in found.distanceResults))
    return least


def configuration(model, values, k):
    q = pin.neutral(model)
    for name, column in values.items():
        q[model.joints[model.getJointId(name)].idx_q] = column[k]
    return q


def test_feet_arch_over_the_ground_straight_ahead(creep):
    """Figs. 6 and 7 of the paper: an arch in the plane of ahead and up, and a body that gets ahead only."""
    seen = tracks(creep)
    foot = seen.feet[:, 3]
    assert np.ptp(foot[:, 1]) < 1e-12
    assert foot[-1, 0] - foot[0, 0] == pytest.approx(0.06)
    assert (np.diff(foot[:, 0]) > -1e-12).all()
    height = foot[:, 2] - foot[0, 2]
    assert height.max() == pytest.approx(0.015, abs=1e-6)
    top = int(height.argmax())
    assert (np.diff(height[: top + 1]) > -1e-12).all()
    assert (np.diff(height[top:]) < 1e-12).all()
    assert seen.body[-1] - seen.body[0] == pytest.approx([0.06, 0.0, 0.0], abs=1e-12)


# Stability.


def test_margin_and_centre_of_mass_by_pinocchio(creep):
    # Of a fixed base pinocchio would leave out the trunk's mass.
    model = pin.buildModelFromUrdf(str(shipped_urdf("quadruped")), pin.JointModelFreeFlyer())
    data, values = model.createData(), creep.joint_values()
    for k in range(0, creep.time.size, 7):
        q = configuration(model, values, k)
        com = pin.centerOfMass(model, data, q)[:2]
        pin.framesForwardKinematics(model, data, q)
        feet = np.array([data.oMf[model.getFrameId(f"{leg}_foot")].translation for leg in creep.robot.leg_names])
        standing = feet[creep.stance[k], :2]
        middle = standing.mean(axis=0)
        corners = standing[np.argsort(np.arctan2(*(standing - middle).T[::-1]))]
        edges = np.roll(corners, -1, axis=0) - corners
        inwards = np.stack([-edges[:, 1], edges[:, 0]], axis=-1) / np.linalg.norm(edges, axis=1)[:, None]
        assert creep.margin[k] == pytest.approx(float(((com - corners) * inwards).sum(axis=1).min()), abs=1e-9)


def test_the_sway_makes_the_margin_several_times_as_large(robot, creep):
    assert creep.margin.min() > 0.008
    even, straight, without = dict(creep.alternatives).values()
    assert 0.0 < even < 0.002
    assert even < straight < creep.margin.min()
    # Steps of 5 s without pauses have exactly nothing to spare.
    assert without == pytest.approx(0.0, abs=1e-8)
    still = study(robot, dataclasses.replace(creep.walk, sway=None), samples=200, load="none")
    assert still.margin.min() == pytest.approx(even, abs=1e-9)


def test_at_three_quarters_no_motion_of_the_body_helps_and_round_the_body_it_does(robot):
    creeping = walk_in_order(robot)
    assert margin_bound(creeping) == pytest.approx(0.0, abs=1e-9)
    sway = steadying_sway(robot, creeping, 0.015, 0.015)
    _, margin = static_margin(robot, dataclasses.replace(creeping, sway=sway))
    assert -1e-6 < margin.min() <= 1e-9
    around = walk_in_order(robot, ("III", "I", "II", "IV"))
    assert margin_bound(around) > 0.03
    _, before = static_margin(robot, around)
    _, after = static_margin(
        robot, dataclasses.replace(around, sway=steadying_sway(robot, around, 0.02, 0.02, harmonics=2))
    )
    assert before.min() < -0.005
    assert after.min() > before.min() + 0.005


@pytest.mark.parametrize(("order", "duty"), [(ORDER, 0.75), (("III", "I", "II", "IV"), 0.75), (ORDER, 0.8)])
def test_the_bound_is_the_best_place_at_the_worst_switch(robot, order, duty):
    walk = walk_in_order(robot, order, duty)
    grid = np.stack(np.meshgrid(np.linspace(-0.2, 0.2, 161), np.linspace(-0.2, 0.2, 161)), axis=-1).reshape(-1, 2)
    worst = np.inf
    for switch in walk.table.switches():
        feet = walk.feet(switch * walk.period).position[..., :2]
        sides = walk.table.in_stance(np.mod([switch - 1e-6, switch + 1e-6], 1.0))
        shape = (len(grid), 4)
        both = [support_margin(np.broadcast_to(feet, (*shape, 2)), np.broadcast_to(on, shape), grid) for on in sides]
        worst = min(worst, float(np.min(both, axis=0).max()))
    bound = margin_bound(walk)
    assert worst <= bound + 1e-9
    assert worst > bound - 0.003


def test_two_feet_have_no_margin_and_none_less():
    robot = toy_robot(4)
    assert margin_bound(plan(robot, "tripod", period=1.0, stride=0.1)) == 0.0
    assert margin_bound(plan(robot, (0.0, 0.0, 0.0, 0.0), duty=0.5, period=1.0, stride=0.1)) == -np.inf


# The sway that steadies.


def test_the_sway_keeps_its_bounds_and_the_body_never_goes_back(robot, planned):
    time = np.linspace(0.0, 20.0, 4001)
    shift = planned.walk.sway.value(time / 20.0, 20.0)
    assert np.abs(shift[:, :2]).max() <= 0.02
    assert (shift[:, 2] == 0.0).all()
    assert planned.walk.body_velocity(time)[:, 0].min() >= 0.0
    (straight,) = (walk for name, walk in planned.alternatives.items() if "straight ahead" in name)
    assert (straight.sway.value(time / 20.0, 20.0)[:, 1] == 0.0).all()
    assert straight.body_velocity(time)[:, 0].min() >= 0.0
    free = steadying_sway(robot, planned.alternatives["even motion of the body"], 0.02, 0.0, backwards=True)
    assert dataclasses.replace(straight, sway=free).body_velocity(time)[:, 0].min() < 0.0


def test_no_other_sway_nearby_is_better(robot, planned):
    bound, samples = 0.012, 120
    even = planned.alternatives["even motion of the body"]
    sway = steadying_sway(robot, even, bound, bound, harmonics=3, backwards=True, samples=samples)

    def least(sway):
        return static_margin(robot, dataclasses.replace(even, sway=sway), samples=samples)[1].min()

    best, time, lower = least(sway), np.linspace(0.0, 1.0, 1001), []
    for size in np.repeat([1e-4, 3e-4, 1e-3, 3e-3], 8):
        change = RNG.normal(size=(2, *sway.cosine.shape)) * size * [1.0, 1.0, 0.0]
        other = Sway(sway.cosine + change[0], sway.sine + change[1])
        # Within the bounds, which hold along each axis.
        within = np.minimum(1.0, bound / np.abs(other.value(time, 20.0)[:, :2]).max(axis=0))
        scale = np.append(within, 1.0)
        lower.append(best - least(Sway(other.cosine * scale, other.sine * scale)))
    # Bounds between the samples leave the optimum that little.
    assert min(lower) > -5e-5
    assert max(lower) > 1e-3


def test_a_sway_of_a_tilted_turning_walk(robot):
    walk = plan_walk(robot, turn=0.005, tilt=Tilt(0.02, 0.01), sway=(0.0, 0.0)).walk
    sway = steadying_sway(robot, walk, 0.015, 0.015)
    swaying = dataclasses.replace(walk, sway=sway)
    assert static_margin(robot, swaying)[1].min() > static_margin(robot, walk)[1].min() + 0.004
    time = np.linspace(0.0, 20.0, 2001)
    ahead = swaying.twist.turned(time)[:, :, 0]
    assert (ahead * swaying.body_velocity(time)[:, :2]).sum(axis=1).min() > 0.0


def test_what_a_sway_cannot_do_is_said(robot):
    walk = walk_in_order(robot, duty=0.8)
    with pytest.raises(OutOfReachError, match="make the sway smaller") as caught:
        steadying_sway(robot, walk, 0.2, 0.2)
    assert caught.value.evidence["leg"] in robot.leg_names
    assert 0.0 <= caught.value.evidence["time"] <= 20.0
    with pytest.raises(TrajectoryError, match="fewer than three feet"):
        steadying_sway(robot, plan_walk(robot, gait="tripod", duty=0.5, sway=(0.0, 0.0)).walk, 0.01, 0.01)
    for change in ({"ahead": -0.01}, {"left": np.nan}, {"harmonics": 0}, {"harmonics": 99}, {"samples": 3}):
        with pytest.raises(TrajectoryError):
            steadying_sway(robot, walk, **({"ahead": 0.01} | change))


# Rhythm and posture.


def test_pairs_pause_where_the_next_leg_is_across(robot):
    table = swing_order(ORDER, robot, 0.8, group=2)
    lifts = {leg: (phase + 0.8) % 1.0 for leg, phase in zip(robot.leg_names, table.phases, strict=True)}
    assert [lifts[leg] % 1.0 for leg in ORDER] == pytest.approx([0.0, 0.2, 0.5, 0.7])
    # The same rhythm as the wave of that duty, at another time.
    apart = np.mod(np.array(table.phases) - phase_table("wave", robot, 0.8).phases, 1.0)
    assert np.ptp(np.exp(2j * np.pi * apart)) < 1e-12
    assert swing_order(ORDER, robot, 0.75, group=2) == swing_order(ORDER, robot)
    assert swing_order(ORDER, robot, 0.8, group=1) == swing_order(ORDER, robot, 0.8)
    for group in (0, 3, 5, 1.5):
        with pytest.raises(TrajectoryError):
            swing_order(ORDER, robot, 0.8, group=group)


def test_feet_of_splayed_legs(robot):
    homes = splayed_homes(robot, 0.35, 0.125, 0.195)
    arms = homes - [limb.hip[:3, 3] for limb in robot.limbs]
    assert np.allclose(np.hypot(arms[:, 0], arms[:, 1]), 0.125)
    assert np.allclose(homes[:, 2], -0.195)
    # I and II in front, I and III on the left.
    assert np.allclose(np.arctan2(arms[:, 0], np.abs(arms[:, 1])), [0.35, 0.35, -0.35, -0.35])
    assert (np.sign(arms[:, 1]) == [1, -1, 1, -1]).all()
    assert np.array_equal(splayed_homes(robot), robot.homes)
    # The home pose is splayed by 20 deg.
    assert np.allclose(splayed_homes(robot, np.radians(20.0)), robot.homes)
    assert np.allclose(splayed_homes(robot, reach=0.1)[:, 2], robot.homes[:, 2])
    six = toy_robot(6)
    middle = splayed_homes(six, 0.3, 0.1)[2:4, 0]
    assert np.allclose(middle, six.homes[2:4, 0])
    for change in ((2.0,), (0.1, -1.0), (0.1, 0.1, 0.0), (np.nan,)):
        with pytest.raises((TrajectoryError, ValueError)):
            splayed_homes(robot, *change)
    with pytest.raises(TrajectoryError, match="below its hip"):
        splayed_homes(six, reach=0.1)


def test_settings_are_the_robots_own_and_changed_ones_are_marked(robot, planned):
    assert settings_for(robot).gait == ORDER
    hexapod = robot_from(read("hexapod"), ld.load("hexapod_leg"))
    assert settings_for(hexapod) == Settings()
    theirs = plan_walk(hexapod)
    assert theirs.choices == ()
    usual = plan(hexapod, "tripod", period=4.0, stride=0.2)
    assert theirs.walk.table == usual.table
    assert np.array_equal(theirs.walk.homes, usual.homes)
    assert theirs.walk.twist == usual.twist
    assert all(each.reason != "as asked for" for each in planned.choices)
    changed = {each.parameter: each for each in plan_walk(robot, stride=0.03, sway=(0.01, 0.0)).choices}
    assert changed["stride"].reason == changed["greatest sway ahead, left"].reason == "as asked for"
    assert "velocity ahead, left" not in changed
    assert "section 1.2" in changed["gait"].reason
    with pytest.raises(TrajectoryError, match="either the stride or the velocity"):
        plan_walk(robot, stride=0.03, velocity=(0.01, 0.0))
    with pytest.raises(TrajectoryError, match="III,IV"):
        plan_walk(robot, gait="gallop")


def test_the_walk_goes_by_the_legs_not_by_names(robot):
    named = dict(zip(robot.leg_names, ("front_left", "front_right", "rear_left", "rear_right"), strict=True))
    limbs = [dataclasses.replace(limb, name=named[limb.name]) for limb in robot.limbs[::-1]]
    other = dataclasses.replace(robot, name="other", limbs=tuple(limbs))
    assert settings_for(other) == dataclasses.replace(
        settings_for(robot), gait=("rear_left", "front_left", "rear_right", "front_right")
    )
    assert plan_walk(other, sway=(0.0, 0.0)).choices != ()
    # Neither with three legs, nor with legs of another kind, nor with two legs at one corner.
    assert settings_for(dataclasses.replace(robot, limbs=robot.limbs[:3])) == Settings()
    assert settings_for(dataclasses.replace(toy_robot(4), name="quadruped")) == Settings()
    moved = dataclasses.replace(robot.limbs[1], hip=robot.limbs[0].hip)
    assert settings_for(dataclasses.replace(robot, limbs=(robot.limbs[0], moved, *robot.limbs[2:]))) == Settings()


@pytest.mark.parametrize(
    ("velocity", "turn", "words"),
    [
        ((0.003, 0.0), 0.0, "straight ahead, at a speed that changes (sway 0.01,0 m)"),
        ((-0.003, 0.0), 0.0, "straight back, at a speed that changes (sway 0.01,0 m)"),
        ((0.0, 0.002), 0.0, "straight to the left, at a speed that changes (sway 0,0.005 m)"),
        ((0.0, -0.002), 0.0, "straight to the right, at a speed that changes (sway 0,0.005 m)"),
        ((0.003, 0.0), 0.005, "along its arc ahead, at a speed that changes (sway 0.01,0 m)"),
        ((0.002, 0.002), 0.0, None),
        ((0.0, 0.0), 0.01, None),
    ],
)
def test_a_changing_speed_is_along_the_way(robot, velocity, turn, words):
    walks = plan_walk(robot, velocity=velocity, turn=turn, sway=(0.01, 0.005), harmonics=2).alternatives
    names = [name for name in walks if "at a speed that changes" in name]
    assert names == ([] if words is None else [words])
    if words is not None:
        sway = walks[words].sway
        across = 1 if velocity[0] else 0
        assert (sway.cosine[:, [across, 2]] == 0.0).all()
        assert (sway.sine[:, [across, 2]] == 0.0).all()


def test_errors_of_a_walk_name_module_and_face(robot):
    even = plan_walk(robot, sway=(0.0, 0.0)).walk
    far = dataclasses.replace(even, homes=even.homes * [1.0, 1.5, 1.0])
    with pytest.raises(OutOfReachError, match=r"the foot is on face U of module 'I_m01'\)$") as caught:
        study(robot, far, samples=40)
    assert (caught.value.leg, caught.value.module, caught.value.face) == ("I", "I_m01", "U")
    with pytest.raises(OutOfReachError, match=r"the foot is on face U of module 'I_m01'\)$") as caught:
        static_margin(robot, far, samples=40)
    assert (caught.value.module, caught.value.face) == ("I_m01", "U")
    high = plan_walk(robot, sway=(0.0, 0.0), clearance=0.04).walk
    with pytest.raises(JointLimitError, match=r"_theta3 is a joint of module '\w+_m01'\)$") as caught:
        study(robot, high, samples=40)
    assert caught.value.module == f"{caught.value.leg}_m01"
    assert caught.value.face is None


# Motion and efforts.


def test_efforts_are_those_of_the_whole_floating_robot(creep):
    """Joint torques of the free robot under its base's acceleration and the feet's forces, by pinocchio."""
    model = pin.buildModelFromUrdf(str(shipped_urdf("quadruped")), pin.JointModelFreeFlyer())
    data, values, efforts = model.createData(), creep.joint_values(), creep.efforts()
    rates = [
        {name: motion.limb.signs[k] * getattr(motion.trajectory, what)[:, k] for motion in creep.limbs
         for k, name in enumerate(motion.limb.joint_names)}
        for what in ("v", "a")
    ]  # fmt: skip
    peak = 0.0
    for k in range(0, creep.time.size, 6):
        q = configuration(model, values, k)
        v, a = np.zeros(model.nv), np.zeros(model.nv)
        a[:3] = creep.body.acceleration[k]
        for vector, rate in zip((v, a), rates, strict=True):
            for name, column in rate.items():
                vector[model.joints[model.getJointId(name)].idx_v] = column[k]
        tau = pin.rnea(model, data, q, v, a)
        for leg, force in zip(creep.robot.leg_names, creep.force[k], strict=True):
            frame = model.getFrameId(f"{leg}_foot")
            J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
            tau -= J[:3].T @ force
        for name in rates[0]:
            expected = tau[model.joints[model.getJointId(name)].idx_v]
            assert efforts[f"{name}_motor"][k] == pytest.approx(expected, abs=1e-9)
            peak = max(peak, abs(expected))
    assert 2.0 < peak < 10.0


def walks_to_track(robot):
    hexapod = robot_from(read("hexapod"), ld.load("hexapod_leg"))
    sway = Sway(np.array([[0.01, 0.005, 0.002]]), np.array([[-0.004, 0.01, 0.0]]))
    tilt = Tilt(0.02, -0.01, np.array([[0.01, 0.0]]), np.array([[0.0, 0.02]]))
    return (
        (robot, plan_walk(robot).walk),
        (hexapod, plan_walk(hexapod, turn=0.1, clearance=0.05, tilt=tilt).walk),
        (hexapod, dataclasses.replace(plan_walk(hexapod, turn=-0.1, velocity=(0.05, 0.02)).walk, sway=sway)),
    )


@pytest.mark.parametrize("which", range(3))
def test_velocities_and_spins_are_derivatives(robot, which):
    machine, walk = walks_to_track(robot)[which]
    result = study(machine, walk, samples=24, load="none", limits="ignore")
    seen, h = tracks(result), 1e-4
    # Away from the switches, where accelerations are continuous and no more.
    time = result.time

    def place(moments):
        feet = walk.feet(moments).position
        values = {}
        for i, limb in enumerate(machine.limbs):
            q = limb.leg.inverse_kinematics(limb.to_leg(feet[:, i]), limits="ignore")
            values |= limb.assemble(q)
        links = link_transforms(machine.description, values)
        turned = np.zeros((moments.size, 3, 3))
        turned[:, 2, 2] = 1.0
        turned[:, :2, :2] = walk.twist.turned(moments)
        axes = turned @ walk.body(moments).rotation
        frames = np.stack([axes @ links[f"{limb.prefix}foot"][:, :3, :3] for limb in machine.limbs], axis=1)
        return walk.in_world(moments, feet), frames, walk.body(moments).position

    (feet_0, axes_0, body_0), (feet_1, axes_1, body_1) = place(time - h), place(time + h)
    assert np.abs((feet_1 - feet_0) / (2 * h) - seen.foot_velocity).max() < 1e-6
    assert np.abs((body_1 - body_0) / (2 * h) - seen.body_velocity).max() < 1e-6
    assert np.abs(seen.foot_velocity[result.stance]).max() < 1e-15
    turn = np.einsum("tnij,tnkj->tnik", axes_1, axes_0)
    spin = np.stack(
        [turn[..., 2, 1] - turn[..., 1, 2], turn[..., 0, 2] - turn[..., 2, 0], turn[..., 1, 0] - turn[..., 0, 1]],
        axis=-1,
    ) / (4 * h)
    assert np.abs(spin).max() > 0.05
    assert np.abs(spin - seen.foot_spin).max() < 1e-5


def test_the_foot_turns_as_the_paper_has_it(creep):
    """Leg IV: theta1 about the vertical, theta2 and theta3 about one level axis, so their rates add up."""
    seen, motion = tracks(creep), creep.limbs[3]
    assert isinstance(motion, LimbMotion)
    v = motion.trajectory.v
    assert np.allclose(seen.foot_turn_rate[:, 3], np.hypot(v[:, 0], v[:, 1] + v[:, 2]), atol=1e-9)


# Reports.


def test_everything_is_written(creep, tmp_path):
    written = write(creep, tmp_path / "walk")
    assert tuple(path.name for path in written) == FILES
    facts = json.loads((tmp_path / "walk" / "summary.json").read_text(encoding="utf-8"))
    assert facts["limits_hold"] is True
    assert facts["stability_margin [m]"]["least"] == pytest.approx(creep.margin.min())
    assert [each["walk"] for each in facts["alternatives"]] == [name for name, _ in creep.alternatives]
    assert facts["legs"][3]["foot_speed [m/s]"] == pytest.approx(tracks(creep).foot_speed[:, 3].max())
    assert facts["sway [m]"]["left"][1] > 0.01
    with (tmp_path / "walk" / "cycle.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    seen, k = tracks(creep), 60
    for name, value in (
        ("margin [m]", creep.margin[k]),
        ("body_world_x [m]", seen.body[k, 0]),
        ("com_world_y [m]", seen.com[k, 1]),
        ("IV_foot_world_z [m]", seen.feet[k, 3, 2]),
        ("IV_foot_speed [m/s]", seen.foot_speed[k, 3]),
        ("IV_foot_turn_rate [rad/s]", seen.foot_turn_rate[k, 3]),
        ("tau_IV_theta2_motor [N*m]", creep.efforts()["IV_theta2_motor"][k]),
        ("IV_force_z [N]", creep.force[k, 3, 2]),
    ):
        assert float(rows[k][name]) == pytest.approx(value, rel=1e-10, abs=1e-12)
    page = (tmp_path / "walk" / "report.html").read_text(encoding="utf-8")
    assert "Why it walks like this" in page
    assert "even motion of the body" in page
    assert page.count("<img") == len(FILES) - 3


def test_a_robot_without_a_file_has_neither_stills_nor_spins():
    result = study(toy_robot(4), plan(toy_robot(4), "wave", period=4.0, stride=0.1), load="equal")
    assert np.isnan(tracks(result).foot_spin).all()
    assert not any("turn_rate" in name for name in columns(result))
    assert summary(result)["legs"][0]["foot_turn_rate [rad/s]"] is None
    page = render_page(result)
    assert "The robot at the middle" not in page
    assert "Speeds of the feet" in page


def test_stills_show_every_swing(creep):
    rows = still_rows(creep)
    assert creep.time[rows] == pytest.approx([2.0, 6.0, 12.0, 16.0], abs=0.06)
    assert [creep.robot.leg_names[int(np.flatnonzero(~creep.stance[row])[0])] for row in rows] == list(ORDER)


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (Geometry("box", (0.2, 0.3, 0.5)), 0.03),
        (Geometry("cylinder", (0.1, 0.4)), np.pi * 0.01 * 0.4),
        (Geometry("sphere", (0.3,)), 4.0 / 3.0 * np.pi * 0.027),
    ],
)
def test_faces_look_outwards_and_close_their_body(shape, volume):
    total, areas = 0.0, np.zeros(3)
    for corners in _polygons(shape):
        for one, other in itertools.pairwise(corners[1:]):
            area = 0.5 * np.cross(one - corners[0], other - corners[0])
            areas += area
            total += float(corners[0] @ area) / 3.0
    assert np.abs(areas).max() < 1e-12
    # A prism of 14 sides has 0.97 of its cylinder, and its ball is cut flatter still.
    assert 0.88 * volume < total <= volume * (1.0 + 1e-12)
    assert not list(_polygons(Geometry("mesh", (1.0, 1.0, 1.0), "part.stl")))


def test_a_centre_of_mass_on_the_edge_is_decided_without_warnings():
    feet = np.array([[0.1, 0.2, -0.2], [0.1, -0.2, -0.2], [-0.1, 0.0, -0.2]])
    for off in (0.0, 1e-9, 1e-8, 1e-7, -1e-9, 1e-5):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            shared = share_load(feet[None], np.ones((1, 3), bool), [[0.1 + off, 0.0, 0.0]], [[0.0, 0.0, 100.0]])
        if abs(off) > 1e-6:
            assert not shared.feasible[0]
        if off < 0.0:
            assert shared.feasible[0]


def test_coal_measures_distances():
    """The library that says whether legs touch, on two boxes."""
    box, apart = coal.Box(0.1, 0.1, 0.1), coal.Transform3s(np.eye(3), np.array([0.15, 0.0, 0.0]))
    found = coal.distance(box, coal.Transform3s(), box, apart, coal.DistanceRequest(), coal.DistanceResult())
    assert found == pytest.approx(0.05)
