"""Foot targets: what stands stays, what swings is smooth, and the rates are those of the positions."""

from __future__ import annotations

import numpy as np
import pytest

from leg_dynamics.analysis.gait import LAWS, PhaseTable, Sway, Tilt, Twist, Walk, plan
from leg_dynamics.analysis.gait.laws import law
from leg_dynamics.errors import LegDynamicsError, NonFiniteError, ShapeError, TrajectoryError

from .gait_robots import HEIGHT, toy_robot

RNG = np.random.default_rng(7)
TWISTS = [Twist(0.2), Twist(0.1, -0.07), Twist(0.15, 0.05, 0.4), Twist(0.0, 0.0, -0.7), Twist(0.1, 0.0, 1e-9)]
SWAY = Sway(RNG.normal(size=(2, 3)) * 0.01, RNG.normal(size=(2, 3)) * 0.01)
TILT = Tilt(0.1, -0.2, RNG.normal(size=(2, 2)) * 0.05, RNG.normal(size=(2, 2)) * 0.05)


def walk(twist, sway=None, name="polynomial", table=None, tilt=None):
    table = table or PhaseTable((0.0, 0.3, 0.55, 0.9), 0.7)
    homes = np.array([[0.4, 0.3, -0.5], [0.4, -0.3, -0.5], [-0.4, 0.3, -0.5], [-0.4, -0.3, -0.45]])
    return Walk(table, homes, 1.7, twist, 0.08, name, sway, tilt)


@pytest.mark.parametrize("twist", TWISTS)
@pytest.mark.parametrize(("sway", "tilt"), [(None, None), (SWAY, None), (None, Tilt(0.2, 0.1)), (SWAY, TILT)])
def test_standing_feet_are_fixed_in_the_world(twist, sway, tilt):
    motion = walk(twist, sway, tilt=tilt)
    time = np.linspace(0.0, 3.0 * motion.period, 2001)
    world, standing = motion.in_world(time, motion.feet(time).position), motion.in_stance(time)
    for leg in range(4):
        runs = np.split(np.arange(time.size), np.flatnonzero(np.diff(standing[:, leg].astype(int))) + 1)
        stances = [run for run in runs if standing[run[0], leg]]
        assert len(stances) >= 3
        for run in stances:
            assert np.abs(world[run, leg] - world[run[0], leg]).max() < 1e-14


@pytest.mark.parametrize("twist", TWISTS)
@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("tilt", [None, TILT])
def test_rates_are_derivatives(twist, name, tilt):
    motion, h = walk(twist, SWAY, name, tilt=tilt), 1e-5
    time = RNG.uniform(0.0, 5.0, 400)
    feet, before, after = motion.feet(time), motion.feet(time - h), motion.feet(time + h)
    # A step across a touch-down sees the jerk jump.
    assert np.abs((after.position - before.position) / (2 * h) - feet.velocity).max() < 1e-6
    assert np.abs((after.velocity - before.velocity) / (2 * h) - feet.acceleration).max() < 1e-2
    assert np.median(np.abs((after.velocity - before.velocity) / (2 * h) - feet.acceleration)) < 1e-8


@pytest.mark.parametrize("name", LAWS)
def test_acceleration_is_continuous_over_touch_down_and_lift_off(name):
    motion = walk(Twist(0.15, 0.05, 0.4), SWAY, name)
    switches = motion.table.switches() * motion.period
    before, after = motion.feet(switches - 1e-9), motion.feet(switches + 1e-9)
    for one, other in zip(before, after, strict=True):
        assert np.abs(one - other).max() < 1e-5


@pytest.mark.parametrize("twist", TWISTS)
def test_the_cycle_repeats_in_the_body_frame(twist):
    motion, time = walk(twist, SWAY), RNG.uniform(0.0, 1.7, 50)
    for one, other in zip(motion.feet(time), motion.feet(time + 2 * 1.7), strict=True):
        assert np.abs(one - other).max() < 1e-11


@pytest.mark.parametrize("name", LAWS)
def test_laws_run_from_the_ground_over_the_apex_to_the_ground(name):
    ends = law(name, np.array([0.0, 0.5, 1.0]))
    assert np.allclose(ends.along[0], [0.0, 0.5, 1.0], atol=1e-13)
    assert np.allclose(ends.lift[0], [0.0, 1.0, 0.0], atol=1e-13)
    for profile in ends:
        assert np.abs(profile[1:, [0, 2]]).max() < 1e-12
    u = np.linspace(0.0, 1.0, 1001)
    assert law(name, u).lift[0].max() <= 1.0 + 1e-12
    assert (np.diff(law(name, u).along[0]) >= -1e-15).all()


def test_the_body_is_where_the_integral_of_its_twist_puts_it():
    from scipy.integrate import solve_ivp

    twist = Twist(0.15, 0.05, 0.4)

    def rate(_, state):
        c, s = np.cos(state[2]), np.sin(state[2])
        return [c * 0.15 - s * 0.05, s * 0.15 + c * 0.05, 0.4]

    end = solve_ivp(rate, (0.0, 3.0), [0.0, 0.0, 0.0], rtol=1e-11, atol=1e-12).y[:, -1]
    body = walk(twist).body(np.array([3.0]))
    assert np.abs([*body.position[0, :2], body.yaw[0]] - end).max() < 1e-9


@pytest.mark.parametrize("twist", TWISTS)
@pytest.mark.parametrize("tilt", [None, Tilt(0.3, -0.2), TILT])
def test_the_body_accelerates_as_its_points_in_the_world_do(twist, tilt):
    motion, h, point = walk(twist, SWAY, tilt=tilt), 1e-4, np.array([0.3, -0.2, 0.1])
    time = np.linspace(0.1, 1.5, 20)
    p = [motion.in_world(t, np.broadcast_to(point, (20, 1, 3)))[:, 0] for t in (time - h, time, time + h)]
    world = (p[0] - 2 * p[1] + p[2]) / h**2
    body = motion.body(time)
    level = body.level(body.acceleration_at(point))
    plane = np.einsum("tij,tj->ti", twist.turned(time), level[:, :2])
    assert np.abs(np.column_stack([plane, level[:, 2]]) - world).max() < 1e-5


def test_a_tilt_turns_by_pitch_then_roll():
    from scipy.spatial.transform import Rotation

    body = walk(Twist(0.1), tilt=TILT).body(np.linspace(0.0, 1.7, 7))
    roll, pitch = TILT.value(np.linspace(0.0, 1.0, 7), 1.7).T
    expected = Rotation.from_euler("ZYX", np.column_stack([0.0 * roll, pitch, roll])).as_matrix()
    assert np.abs(body.rotation - expected).max() < 1e-15
    assert np.abs(body.in_body(body.level(np.eye(7, 3))) - np.eye(7, 3)).max() < 1e-15
    # A positive pitch lowers the head, a positive roll the right side.
    for tilt, low in ((Tilt(pitch=0.1), [1.0, 0.0, 0.0]), (Tilt(roll=0.1), [0.0, -1.0, 0.0])):
        still = walk(Twist(0.1), tilt=tilt).body(np.zeros(1))
        assert still.level(np.array([low]))[0, 2] == pytest.approx(-np.sin(0.1))


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"roll": 1.6}, TrajectoryError),
        ({"pitch": -1.0, "sine": [[0.0, 0.6]]}, TrajectoryError),
        ({"roll": float("nan")}, NonFiniteError),
        ({"cosine": np.zeros((1, 3)), "sine": np.zeros((1, 3))}, ShapeError),
        ({"cosine": np.zeros((2, 2))}, ShapeError),
        ({"sine": [[0.0, np.inf]]}, NonFiniteError),
    ],
)
def test_bad_tilts_are_named(change, error):
    with pytest.raises(error):
        Tilt(**change)


def test_stride_and_velocity_are_two_views_of_one_walk():
    robot = toy_robot(6)
    by_stride = plan(robot, "tripod", period=2.0, stride=0.3)
    by_velocity = plan(robot, "tripod", period=2.0, velocity=(0.3, 0.0))
    assert by_stride.twist == by_velocity.twist
    assert by_velocity.stride == pytest.approx(0.3)
    x = by_stride.feet(np.linspace(0.0, 2.0, 401)).position[..., 0] - robot.homes[:, 0]
    standing = by_stride.in_stance(np.linspace(0.0, 2.0, 401))
    assert np.where(standing, x, 0.0).max() == pytest.approx(0.15)
    assert np.where(standing, x, 0.0).min() == pytest.approx(-0.15)


def test_turning_on_the_spot_moves_feet_on_circles():
    motion = plan(toy_robot(6), "tripod", period=2.0, velocity=(0.0, 0.0), turn=0.5)
    time = np.linspace(0.0, 2.0, 200)
    position, standing = motion.feet(time).position, motion.in_stance(time)
    radius = np.linalg.norm(position[..., :2], axis=-1)
    assert np.abs(radius - np.linalg.norm(motion.homes[:, :2], axis=-1))[standing].max() < 1e-14
    assert (position[..., 2][~standing] > -HEIGHT).all()


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"period": 0.0}, TrajectoryError),
        ({"period": float("nan")}, TrajectoryError),
        ({"stride": None}, TrajectoryError),
        ({"velocity": (0.1, 0.0)}, TrajectoryError),
        ({"stride": float("nan")}, NonFiniteError),
        ({"stride": None, "velocity": (0.1, float("inf"))}, NonFiniteError),
        ({"stride": "far"}, ShapeError),
        ({"turn": float("nan")}, NonFiniteError),
        ({"clearance": -0.1}, TrajectoryError),
        ({"clearance": float("nan")}, TrajectoryError),
        ({"duty": 0.0}, TrajectoryError),
        ({"duty": 1.0}, TrajectoryError),
        ({"duty": float("nan")}, NonFiniteError),
        ({"law": "spline"}, TrajectoryError),
        ({"body_height": -0.3}, TrajectoryError),
        ({"homes": np.zeros((5, 3))}, ShapeError),
        ({"homes": np.full((6, 3), np.nan)}, NonFiniteError),
        ({"sway": 0.1}, ShapeError),
    ],
)
def test_bad_numbers_are_named(change, error):
    arguments = {"period": 2.0, "stride": 0.3} | change
    with pytest.raises(error) as caught:
        plan(toy_robot(6), "tripod", **arguments)
    assert isinstance(caught.value, LegDynamicsError)


def test_times_must_be_finite():
    with pytest.raises(NonFiniteError):
        walk(Twist(0.1)).feet([0.0, np.nan])


@pytest.mark.parametrize(
    ("cosine", "sine"), [(np.zeros(3), np.zeros(3)), (np.zeros((1, 3)), np.zeros((2, 3))), (np.zeros((1, 2)),) * 2]
)
def test_a_sway_is_made_of_vectors(cosine, sine):
    with pytest.raises(ShapeError):
        Sway(cosine, sine)
