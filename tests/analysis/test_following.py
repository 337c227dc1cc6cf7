"""Along a trajectory: one assembly mode, and where, when and why it ends."""

from __future__ import annotations

import math
import types
import warnings

import numpy as np
import pytest
from scipy.optimize import brentq

import leg_dynamics as ld
from leg_dynamics.analysis import trajectories as tr
from leg_dynamics.errors import (
    ActuationError,
    AssemblyError,
    EffortLimitError,
    LegDynamicsWarning,
    NonFiniteError,
    ShapeError,
    SingularityError,
)

from ..five_bar import TOGGLE, five_bar
from ..four_bar import COUPLER, CRANK, GROUND, HOME, ROCKER, four_bar, passive
from ..four_bar import TOGGLE as TOGGLE_CRANK
from ..three_rpr import struts, three_rpr


def line(start, end, duration=1.0, count=101, force=None):
    """A straight motion at constant speed."""
    time = np.linspace(0.0, duration, count)
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    q = start + time[:, None] / duration * (end - start)
    v = np.broadcast_to((end - start) / duration, q.shape)
    return tr.Trajectory(time, q, v, np.zeros_like(q), force, "line")


INSIDE = line([1.9, 1.1], [2.2, 0.9])


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_efforts_are_those_of_the_samples(route):
    leg = ld.load(five_bar(effort=5.0), route=route)
    found = tr.torque_along(leg, INSIDE)
    np.testing.assert_allclose(found.torque, leg.torque(INSIDE.q, INSIDE.v, INSIDE.a), atol=1e-12)
    assert not found.residual.any()
    assert set(found.coordinates) == {"ma", "ka", "mb", "kb"}
    np.testing.assert_allclose(found.coordinates["ka"], leg.assemble(INSIDE.q)["ka"], atol=1e-12)
    flags = found.flags()
    for k, flag in enumerate(flags):
        row = int(np.argmax(np.abs(found.torque[:, k])))
        assert flag["effort_time"] == INSIDE.time[row]
        assert flag["effort_margin"] == pytest.approx(1.0 - abs(found.torque[row, k]) / 5.0)
        assert flag["feasible"] == (flag["effort_margin"] >= 0.0)


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_a_motion_through_the_toggle_point_stops_there(route):
    leg = ld.load(five_bar(), route=route)
    motion = line([math.pi - 1.2, 1.2], [math.pi - 0.5, 0.5], duration=2.0)
    with pytest.raises(
        (AssemblyError, SingularityError),
        match=r"at t = [\d.]+ s of line, before the sample at [\d.]+ s: .*parallel singularity",
    ) as caught:
        tr.torque_along(leg, motion)
    error = caught.value
    toggle_time = 2.0 * (1.2 - TOGGLE) / 0.7
    assert error.time == pytest.approx(toggle_time, abs=1e-4)
    # The first sample that is not reached.
    assert 0.0 <= error.sample_time - toggle_time <= 0.02 + 1e-9
    assert error.kind == "parallel"
    assert {name for name, x in error.direction.items() if abs(x) > 1e-3} == {"ka", "kb"}
    assert error.pose["mb"] == pytest.approx(TOGGLE, abs=1e-4)
    assert motion.time[error.all_rows.min()] == error.sample_time
    assert error.tree_pose["ma"] == error.pose["ma"]
    # Both distal links in line: their angles from the horizontal, about -y, differ by half a turn.
    across = error.tree_pose["ma"] + error.tree_pose["ka"] - error.tree_pose["mb"] - error.tree_pose["kb"]
    assert math.cos(across) == pytest.approx(-1.0, abs=1e-4)


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
@pytest.mark.parametrize("count", [2, 7, 40, 101])
def test_the_time_is_that_of_the_pose(route, count):
    """Two motors on one side of a five-bar lose a motion where the other side's crank and link are in line."""
    leg = ld.load(five_bar(("mb", "kb")), route=route)
    arm = stretched_arm(1.2)
    motion = line([arm - 0.2, 1.2], [arm + 0.1, 1.2], count=count)
    with pytest.raises(SingularityError, match="do not hold every motion") as caught:
        tr.torque_along(leg, motion)
    error = caught.value
    assert error.kind == "parallel"
    assert error.time == pytest.approx(2.0 / 3.0, abs=1e-4)
    assert error.pose["ma"] == pytest.approx(arm, abs=1e-5)
    assert math.sin(error.tree_pose["ka"]) == pytest.approx(0.0, abs=1e-4)
    assert error.sample_time == motion.time[error.all_rows.min()]


def stretched_arm(mb):
    """Crank angle of the left side where its knee is straight and the pin is at 0.25 m from the right knee."""
    knee = np.array([0.1 + 0.2 * math.cos(mb), -0.2 * math.sin(mb)])
    way = knee - np.array([-0.1, 0.0])
    distance = float(np.hypot(*way))
    corner = math.acos((0.45**2 + distance**2 - 0.25**2) / (2.0 * 0.45 * distance))
    return math.atan2(-way[1], way[0]) + corner


def test_a_motion_that_comes_back_does_not_hide_the_toggle_point():
    """Out through the toggle point and back again: each end is fine alone, the way between is not."""
    leg = ld.load(five_bar())
    out, back = line([1.9, 1.2], [2.6, 0.5]), line([2.6, 0.5], [1.9, 1.2])
    motion = tr.Trajectory(
        np.concatenate([out.time, 1.01 + back.time]),
        *(np.concatenate([getattr(out, k), getattr(back, k)]) for k in "qva"),
    )
    leg.torque(motion.q[[0, -1]], motion.v[[0, -1]], motion.a[[0, -1]])
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        tr.assemble_along(leg, motion)
    assert caught.value.time < 1.0


def test_a_leg_that_would_be_mirrored_is_refused():
    """A route whose own assembly differs from the continued one is not believed."""
    leg = ld.load(five_bar())
    other = ld.load(five_bar(), mode=leg.assembly_modes()[1].name)
    mixed = types.SimpleNamespace(
        assemble=other.assemble, backend=leg.backend, description=leg.description, joint_names=leg.joint_names
    )
    with pytest.raises(AssemblyError, match=r"at t = 0 s the motion has arrived in another assembly mode") as caught:
        tr.assemble_along(mixed, INSIDE)
    error = caught.value
    assert error.time == error.sample_time == 0.0
    assert error.kind is None
    assert set(error.difference) == {"ka", "kb"}
    home, mirrored = leg.assemble(INSIDE.q[0]), other.assemble(INSIDE.q[0])
    for name, difference in error.difference.items():
        assert difference == pytest.approx(float(mirrored[name] - home[name]), abs=1e-9)
    assert error.nearest["kind"] in ("parallel", "coordinates", "constraint")
    assert error.nearest["time"] == 0.0
    assert error.nearest["margin"] > 0.01
    assert "passes no singular pose" in str(error)


def turning_back(gap, count, shift=0.0, accelerate=True):
    """A crank that comes within `gap` rad of a four-bar's toggle point between two samples and turns back."""
    time = np.linspace(0.0, 1.0, count)
    phase, swing = math.pi * time + shift / count, TOGGLE_CRANK - gap - HOME
    q, v = HOME + swing * np.sin(phase), swing * math.pi * np.cos(phase)
    a = -swing * math.pi**2 * np.sin(phase) * accelerate
    return tr.Trajectory(time, q[:, None], v[:, None], a[:, None])


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
@pytest.mark.parametrize("accelerate", [True, False])
@pytest.mark.parametrize("count", [10, 50, 200])
def test_a_singular_pose_touched_between_two_samples_is_seen(route, accelerate, count):
    leg = ld.load(four_bar(), route=route)
    motion = turning_back(0.0, count, accelerate=accelerate)
    # No sample is near it, and the leg has torques at all of them.
    near = np.abs(motion.time - 0.5) < 0.51 / (count - 1)
    assert np.isfinite(leg.torque(motion.q[~near], motion.v[~near], motion.a[~near])).all()
    with pytest.raises(SingularityError, match=r"between its samples at .* touches a singular pose") as caught:
        tr.assemble_along(leg, motion)
    error = caught.value
    assert error.kind == "parallel"
    assert error.time == pytest.approx(0.5, abs=2e-3)
    assert motion.time[error.rows[0] - 1] <= error.time <= error.sample_time == motion.time[error.rows[0]]
    assert error.pose["a"] == pytest.approx(TOGGLE_CRANK, abs=1e-4)
    assert error.tree_pose["a"] == error.pose["a"]
    # Coupler and rocker in line: b alone turns against c.
    assert error.direction["c"] / error.direction["b"] == pytest.approx(-COUPLER / ROCKER, abs=1e-2)
    assert abs(float(error.margin[0])) < 1e-2


@pytest.mark.parametrize("accelerate", [True, False])
@pytest.mark.parametrize(("gap", "counts"), [(1e-1, (6, 10)), (1e-2, (6, 20)), (1e-3, (20, 50)), (1e-5, (200, 1000))])
def test_a_motion_that_turns_back_before_the_singular_pose_is_none_that_touches_it(gap, counts, accelerate):
    leg = ld.load(four_bar())
    for count in counts:
        for shift in (0.0, 0.3, 0.7):
            motion = turning_back(gap, count, shift, accelerate)
            found = tr.assemble_along(leg, motion)
            b, c = passive(motion.q[:, 0])
            np.testing.assert_allclose(found["b"], b, atol=1e-7 / gap**0.5)
            np.testing.assert_allclose(found["c"], c, atol=1e-7 / gap**0.5)


@pytest.mark.parametrize("count", [5, 10, 20, 100])
def test_coarse_and_rough_motions_of_a_five_bar_raise_no_alarm(count):
    """Far from the toggle by plane geometry at 2,000 poses between the samples, the farther the less these tell."""
    leg, draw = ld.load(five_bar()), np.random.default_rng(count)
    dense, tried = np.linspace(0.0, 1.0, 2001), 0
    time = np.linspace(0.0, 1.0, count)
    while tried < 6:
        middle, size = leg.home + draw.uniform(-0.2, 0.2, 2), draw.uniform(0.0, 0.6, 2)
        speed, phase = draw.uniform(1.0, 12.0, 2), draw.uniform(0.0, 6.0, 2)
        ma, mb = (middle + size * np.sin(speed * dense[:, None] + phase)).T
        apart = np.hypot(0.2 + 0.2 * (np.cos(mb) - np.cos(ma)), 0.2 * (np.sin(mb) - np.sin(ma)))
        if apart.max() > 0.5 - (0.05 if count < 10 else 1e-3) or apart.min() < 1e-2:
            continue
        tried += 1
        angle = speed * time[:, None] + phase
        q, v, a = middle + size * np.sin(angle), size * speed * np.cos(angle), -size * speed**2 * np.sin(angle)
        for rates in ((v, a), (np.gradient(q, time, axis=0), 0.0 * a), (0.0 * v, 0.0 * a)):
            with warnings.catch_warnings():
                if count < 20:
                    warnings.filterwarnings("ignore", "between its samples at", LegDynamicsWarning)
                tr.assemble_along(leg, tr.Trajectory(time, q, *rates))


def test_rates_that_do_not_fit_are_told_where_a_singular_pose_may_be_near():
    leg = ld.load(five_bar())
    time = np.linspace(0.0, 1.0, 6)
    q = leg.home + np.stack([0.2 * np.sin(6.0 * time), 0.2 * np.cos(6.0 * time)], axis=1)
    rough, still = tr.Trajectory(time, q, -3.0 * q, 0.0 * q), tr.Trajectory(time, q, 0.0 * q, 0.0 * q)
    with pytest.warns(
        LegDynamicsWarning, match=r"samples at 0 and 0.2 s and in 4 more of its 5 intervals .* do not fit"
    ):
        tr.assemble_along(leg, rough)
    tr.assemble_along(leg, still)
    # Between neighbours that are nearer to each other than to a singular pose nothing is in doubt.
    near = leg.home + 0.05 * (q - leg.home)
    tr.assemble_along(leg, tr.Trajectory(time, near, 0.5 * (near - leg.home), 0.0 * near))


@pytest.mark.parametrize("rate", [10.0, 100.0])
def test_the_legs_own_motions_raise_no_alarm(rate):
    leg = ld.load("omnileg", route="pinocchio")
    for make in tr.named(leg).values():
        motion = make(2.0, rate)
        tr.assemble_along(leg, motion)
        still = tr.Trajectory(motion.time, motion.q[:1].repeat(len(motion), axis=0), *(0.0 * motion.q,) * 2)
        tr.assemble_along(leg, still)


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
@pytest.mark.parametrize(("start", "end"), [(-1.2, 1.2), (1.2, -1.2)])
def test_passive_angles_are_continuous(route, start, end):
    """The coupler turns by more than half a turn against the crank, once by way of the home pose's far side."""
    leg = ld.load(four_bar(), route=route)
    motion = line([start], [end], count=500)
    found = tr.assemble_along(leg, motion)
    at_home = passive(HOME)
    for name, angle, home in zip("bc", passive(motion.q[:, 0]), at_home, strict=True):
        # The first sample's turn is that of `Leg.assemble`: within half a turn of home.
        turn = 2.0 * math.pi * np.round((home - angle[0]) / (2.0 * math.pi))
        np.testing.assert_allclose(found[name], np.unwrap(angle) + turn, atol=1e-8)
        assert np.abs(np.diff(found[name])).max() < 0.02


def test_formulas_alone_are_continuous_too():
    """A route that cannot continue a pose: jumps of more than half a turn are taken out."""
    leg, motion = ld.load(four_bar()), line([1.2], [-1.2], count=100)
    route = types.SimpleNamespace()
    alone = types.SimpleNamespace(
        assemble=leg.assemble, backend=route, description=leg.description, joint_names=leg.joint_names
    )
    assert np.abs(np.diff(leg.assemble(motion.q)["b"])).max() > 6.0
    assert np.abs(np.diff(tr.assemble_along(alone, motion)["b"])).max() < 0.1


def test_a_leg_by_formulas_goes_along_too():
    leg = ld.load("omnileg")
    motion = tr.omnileg_eq52(0.5, 100.0)
    found = tr.torque_along(leg, motion)
    np.testing.assert_array_equal(found.torque, leg.torque(motion.q, motion.v, motion.a))
    assert bool(found.feasibility)


def test_idle_motions_along_a_trajectory():
    leg = ld.load(five_bar(("mb",)))
    with pytest.raises(ActuationError, match="no actuator holds ma"):
        tr.torque_along(leg, INSIDE)
    found = tr.torque_along(leg, INSIDE, allow_idle=True)
    force = leg.generalized_force(INSIDE.q, INSIDE.v, INSIDE.a)
    np.testing.assert_allclose(found.residual[:, 0], force[:, 0], atol=1e-12)
    assert not found.residual[:, 1].any()


def test_bounds_that_are_not_enough_say_when():
    leg = ld.load(five_bar(("ma", "mb", "ka")))
    efforts = np.abs(tr.torque_along(leg, INSIDE).torque).max(axis=1)
    limit = 0.5 * (efforts.min() + efforts.max())
    with pytest.raises(EffortLimitError, match=r"at t = [\d.]+ s of line") as caught:
        tr.torque_along(leg, INSIDE, bounds=np.full(3, 0.3 * limit))
    assert caught.value.time == INSIDE.time[caught.value.all_rows.min()]


def there_and_back(share, count, offset, accelerations=True):
    """A platform on struts that goes to `share` of the way to a singular pose, rests, and goes back, in 1 s."""
    start, direction = np.array([0.872, 3.103]), np.array([0.3, -1.0])

    def way(s):
        return struts(start + s * direction)

    def determinant(s):
        step, pose = 1e-6, start + s * direction
        columns = [struts(pose + step * axis)[1:] - struts(pose - step * axis)[1:] for axis in np.eye(2)]
        return np.linalg.det(np.array(columns) / (2.0 * step))

    grid = np.linspace(0.0, 2.0, 400)
    signs = np.array([determinant(s) for s in grid])
    first = int(np.flatnonzero(signs * signs[0] < 0.0)[0])
    singular = brentq(determinant, grid[first - 1], grid[first], xtol=1e-15)
    times = (np.arange(count) + offset) / count
    step = 2e-3
    nodes = step * np.arange(-4.0, 5.0)
    motion = np.array([[way(share * singular * math.sin(math.pi * t)) for t in time + nodes] for time in times])
    # Eighth-order central differences.
    rates = np.array([3.0, -32.0, 168.0, -672.0, 0.0, 672.0, -168.0, 32.0, -3.0]) / (840.0 * step)
    bends = np.array([-9.0, 128.0, -1008.0, 8064.0, -14350.0, 8064.0, -1008.0, 128.0, -9.0]) / (5040.0 * step**2)
    v, a = (np.einsum("k,tkn->tn", weights, motion) for weights in (rates, bends))
    leg = ld.load(three_rpr(start), route="pinocchio", foot="platform")
    return leg, tr.Trajectory(times, motion[:, 4], v, a if accelerations else np.zeros_like(a))


@pytest.mark.parametrize("count", [8, 12, 20, 50, 200])
@pytest.mark.parametrize("offset", [0.2, 0.5, 0.7])
def test_a_singular_pose_touched_at_rest_between_two_samples_is_found(count, offset):
    leg, motion = there_and_back(1.0, count, offset)
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        tr.assemble_along(leg, motion)
    assert caught.value.time == pytest.approx(0.5, abs=1.5 / count)
    assert caught.value.kind == "parallel"


@pytest.mark.parametrize("count", [20, 50, 200])
@pytest.mark.parametrize(("share", "accelerations"), [(0.97, True), (0.9, True), (0.9, False)])
def test_a_rest_near_a_singular_pose_raises_no_alarm(count, share, accelerations):
    leg, motion = there_and_back(share, count, 0.4, accelerations)
    found = tr.assemble_along(leg, motion)
    start, direction = np.array([0.872, 3.103]), np.array([0.3, -1.0])
    for row, lengths in enumerate(motion.q):
        pose = found["turn0"][row], found["turn0"][row] + found["tilt"][row]
        np.testing.assert_allclose(struts(pose), lengths, atol=1e-9)
        # On the straight way of the platform, not in the other mode with struts of the same lengths.
        way = (pose - start + math.pi) % (2.0 * math.pi) - math.pi
        assert abs(way[0] * direction[1] - way[1] * direction[0]) < 1e-6


@pytest.mark.parametrize("count", [8, 12, 20, 50, 200])
@pytest.mark.parametrize("share", [1.03, 1.1, 1.2])
def test_a_motion_into_the_other_mode_and_back_is_stopped_at_the_border(count, share):
    """Where the platform is in the other mode its struts have the lengths of poses in this one."""
    leg, motion = there_and_back(share, count, 0.5)
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        tr.assemble_along(leg, motion)
    border = math.asin(1.0 / share) / math.pi
    assert min(abs(caught.value.time - border), abs(caught.value.time - 1.0 + border)) < 2.0 / count
    assert caught.value.kind == "parallel"


def swings(over, count, shape="cos", lowest=2.1):
    """A four-bar whose rocker swings `over` rad past its dead point with the crank, at `count` times of 1 s.

    Exact coordinates, rates and accelerations of the crank, and the passive angles b and c of the whole motion.
    """
    t = np.linspace(0.0, 1.0, count)
    share, rate, bend = {
        "cos": ((1 - np.cos(np.pi * t)) / 2, np.pi * np.sin(np.pi * t) / 2, np.pi**2 * np.cos(np.pi * t) / 2),
        "quintic": (10 * t**3 - 15 * t**4 + 6 * t**5, 30 * t**2 * (1 - t) ** 2, 60 * t * (1 - t) * (1 - 2 * t)),
        "sin2": (np.sin(np.pi * t) ** 2, np.pi * np.sin(2 * np.pi * t), 2 * np.pi**2 * np.cos(2 * np.pi * t)),
    }[shape]
    # Coupler and rocker in line, by the triangle of ground, crank and both.
    reach = COUPLER + ROCKER
    dead = math.pi - math.acos((GROUND**2 + reach**2 - CRANK**2) / (2.0 * GROUND * reach))
    way = dead + over - lowest
    c, v, a = lowest + way * share, way * rate, way * bend

    def crank(c):
        """Its angle where the coupler spans it and the rocker's pin, with two derivatives by c, closed form."""
        pin = np.array([GROUND + ROCKER * np.cos(c), ROCKER * np.sin(c)])
        square = (pin**2).sum(axis=0)
        distance = np.sqrt(square)
        cosine = (CRANK**2 + square - COUPLER**2) / (2.0 * CRANK * distance)
        # d(square)/dc and its derivative; then those of the pin's direction and of the corner.
        ds, dds = -2.0 * GROUND * ROCKER * np.sin(c), -2.0 * GROUND * ROCKER * np.cos(c)
        f = (CRANK**2 - COUPLER**2) / (2.0 * CRANK)
        dcos = (1.0 / (2.0 * CRANK) - f / square) * ds / (2.0 * distance)
        ddcos = (1.0 / (2.0 * CRANK) - f / square) * (
            dds / (2.0 * distance) - ds**2 / (4.0 * distance**3)
        ) + f * ds**2 / (2.0 * square**2 * distance)
        sine = np.sqrt(1.0 - cosine**2)
        corner, dcorner = np.arccos(cosine), -dcos / sine
        ddcorner = -ddcos / sine - cosine * dcos**2 / sine**3
        turn = (ROCKER**2 + GROUND * ROCKER * np.cos(c)) / square
        dturn = -GROUND * ROCKER * np.sin(c) / square - turn * ds / square
        return np.arctan2(pin[1], pin[0]) + corner, turn + dcorner, dturn + ddcorner

    angle, slope, curve = crank(c)
    tip = CRANK * np.array([np.cos(angle), np.sin(angle)])
    b = np.arctan2(ROCKER * np.sin(c) - tip[1], GROUND + ROCKER * np.cos(c) - tip[0]) - angle
    return tr.Trajectory(t, angle[:, None], (slope * v)[:, None], (slope * a + curve * v**2)[:, None]), b, c


def test_the_swinging_rocker_of_these_tests_has_its_own_derivatives():
    motion, b, c = swings(-0.3, 2001)
    inner = slice(1, -1)
    np.testing.assert_allclose(np.gradient(motion.q[:, 0], motion.time)[inner], motion.v[inner, 0], atol=1e-5)
    np.testing.assert_allclose(np.gradient(motion.v[:, 0], motion.time)[inner], motion.a[inner, 0], atol=1e-4)
    found = tr.assemble_along(ld.load(four_bar()), motion)
    for name, angle in (("b", b), ("c", c)):
        assert np.abs(np.remainder(found[name] - angle + math.pi, 2.0 * math.pi) - math.pi).max() < 1e-9


def by_differences(motion):
    v = np.gradient(motion.q, motion.time, axis=0)
    return tr.Trajectory(motion.time, motion.q, v, np.gradient(v, motion.time, axis=0))


INEXACT = {
    "exact": lambda motion: motion,
    "6 decimals": lambda motion: tr.Trajectory(
        motion.time, *(np.round(each, 6) for each in (motion.q, motion.v, motion.a))
    ),
    "single precision": lambda motion: tr.Trajectory(
        motion.time, *(each.astype(np.float32).astype(float) for each in (motion.q, motion.v, motion.a))
    ),
    "differences": by_differences,
    "noise": lambda motion: tr.Trajectory(
        motion.time,
        motion.q,
        *(each * (1.0 + 1e-5 * np.random.default_rng(7).standard_normal(each.shape)) for each in (motion.v, motion.a)),
    ),
}


@pytest.mark.parametrize("change", INEXACT)
@pytest.mark.parametrize("shape", ["cos", "quintic", "sin2"])
@pytest.mark.parametrize("count", [20, 37, 100, 200])
@pytest.mark.parametrize("over", [0.05, 0.3])
def test_a_motion_past_a_dead_point_is_stopped_there_whatever_its_digits(change, shape, count, over):
    """The crank of the samples turns back at the dead point, or just before it where they are inexact."""
    motion = INEXACT[change](swings(over, count, shape)[0])
    with pytest.raises(SingularityError) as caught:
        tr.assemble_along(ld.load(four_bar()), motion)
    assert caught.value.kind == "parallel"
    assert caught.value.pose["a"] == pytest.approx(TOGGLE_CRANK, abs=0.02)


@pytest.mark.parametrize("change", INEXACT)
@pytest.mark.parametrize("shape", ["cos", "quintic", "sin2"])
@pytest.mark.parametrize("count", [37, 100, 200])
@pytest.mark.parametrize("over", [-0.2, -0.5])
def test_a_motion_before_a_dead_point_is_followed_whatever_its_digits(change, shape, count, over):
    exact, b, c = swings(over, count, shape)
    found = tr.assemble_along(ld.load(four_bar()), INEXACT[change](exact))
    for name, angle in (("b", b), ("c", c)):
        assert np.abs(np.remainder(found[name] - angle + math.pi, 2.0 * math.pi) - math.pi).max() < 1e-4


def test_the_first_loss_of_the_mode_is_the_one_that_is_named():
    """The crank touches the toggle angle at 0.3 s, and runs beyond it at 0.9 s."""
    t = np.linspace(0.0, 1.0, 200) ** 1.01
    a = TOGGLE_CRANK - 2.0 * (t - 0.3) ** 2 * (0.9 - t)
    v = -4.0 * (t - 0.3) * (0.9 - t) + 2.0 * (t - 0.3) ** 2
    acceleration = -4.0 * (0.9 - t) + 8.0 * (t - 0.3)
    motion = tr.Trajectory(t, a[:, None], v[:, None], acceleration[:, None])
    with pytest.raises(SingularityError) as caught:
        tr.assemble_along(ld.load(four_bar()), motion)
    assert caught.value.time == pytest.approx(0.3, abs=5e-3)


def test_a_motion_of_another_leg_is_named():
    wrong = tr.Trajectory(np.linspace(0.0, 1.0, 5), *(np.zeros((5, 3)),) * 3)
    for call in (tr.assemble_along, tr.torque_along):
        with pytest.raises(ShapeError, match=r"motion.q has shape \(5, 3\), expected"):
            call(ld.load(five_bar()), wrong)


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_rates_beyond_all_numbers_are_named(route):
    for factor in (1e80, 1e200):
        wild = tr.Trajectory(INSIDE.time, INSIDE.q, factor * INSIDE.v, INSIDE.a)
        with pytest.raises(NonFiniteError, match=r"accelerations at t = 0 s of .* too large to be followed") as caught:
            tr.assemble_along(ld.load(five_bar(), route=route), wild)
        assert caught.value.rows[0] == 0
    quick = tr.Trajectory(INSIDE.time, INSIDE.q, 1e70 * INSIDE.v, INSIDE.a)
    with pytest.warns(LegDynamicsWarning, match="do not fit its coordinates"):
        tr.assemble_along(ld.load(five_bar(), route=route), quick)


def detour(leg, count):
    """A five-bar's cranks on a parabola from home to a pose that no straight way from home leads to."""
    time = np.linspace(0.0, 1.0, count)[:, None]
    by, end = np.array([-0.4, -0.8]), np.array([3.7, -3.0])
    q = (1.0 - time) ** 2 * leg.home + 2.0 * time * (1.0 - time) * by + time**2 * end
    v = 2.0 * (1.0 - time) * (by - leg.home) + 2.0 * time * (end - by)
    return tr.Trajectory(time[:, 0], q, v, np.broadcast_to(2.0 * (end - 2.0 * by + leg.home), q.shape))


def pins(motion, found):
    """The pin (N, 2) m, by the left arm, and the gap to the right one."""
    ends = []
    for x, crank, knee in ((-0.1, "ma", "ka"), (0.1, "mb", "kb")):
        first, second = found[crank], found[crank] + found[knee]
        ends.append(
            [
                x + 0.2 * np.cos(first) + 0.25 * np.cos(second),
                -0.2 * np.sin(first) - 0.25 * np.sin(second),
            ]
        )
    left, right = np.array(ends)
    return left.T, np.abs(left - right).max()


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
@pytest.mark.parametrize("count", [2, 4, 6, 80])
def test_a_motion_leads_to_where_straight_ways_from_home_do_not(route, count):
    leg = ld.load(five_bar(foot=True), route=route)
    motion = detour(leg, count)
    state = motion.q, motion.v, motion.a
    with pytest.raises(AssemblyError):
        leg.torque(*state)
    found = tr.torque_along(leg, motion)
    pin, gap = pins(motion, found.coordinates)
    assert gap < 1e-9
    # The distal links' angle never passes through zero: one mode.
    turn = found.coordinates["ma"] + found.coordinates["ka"] - found.coordinates["mb"] - found.coordinates["kb"]
    assert (np.sign(np.sin(turn)) == np.sign(np.sin(turn[0]))).all()
    # As from a home at its end.
    ends = {name: math.remainder(angle[-1], 2.0 * math.pi) for name, angle in found.coordinates.items()}
    values = "".join(f'<joint name="{name}" value="{angle!r}"/>' for name, angle in ends.items())
    there = five_bar(foot=True, home=False).replace(
        "</robot>", f'<configuration name="home">{values}</configuration></robot>'
    )
    other, last = ld.load(there, route="pinocchio"), slice(-max(count // 4, 1), None)
    np.testing.assert_allclose(found.torque[last], other.torque(*(each[last] for each in state)), atol=1e-9)
    with tr.along(leg, motion) as coordinates:
        foot = leg.foot_position(motion.q)
        np.testing.assert_allclose(leg.torque(*state), found.torque, atol=1e-12)
        assert set(coordinates) == {"ma", "ka", "mb", "kb"}
    np.testing.assert_allclose(foot[:, [0, 2]], pin, atol=1e-9)
    # What a leg computes alone does not depend on what it was led through.
    with pytest.raises(AssemblyError):
        leg.torque(*(each[-1] for each in state))


def test_samples_may_be_so_far_apart_that_the_straight_way_between_leaves_the_reach():
    leg = ld.load(five_bar(), route="pinocchio")
    motion = detour(leg, 2)
    with pytest.raises(AssemblyError) as straight:
        leg.backend.follow(motion.q)
    assert len(leg.backend.follow(motion.q, (motion.time, motion.v, motion.a))) == 2
    # Rates that tell no way, and a way that leaves the reach as well.
    still = np.zeros_like(motion.v)
    for v, a in ((still, still), (-motion.v, -motion.a)):
        with pytest.raises(AssemblyError) as caught:
            leg.backend.follow(motion.q, (motion.time, v, a))
        assert str(caught.value) == str(straight.value)


def test_a_pose_that_a_motion_passes_twice_in_two_ways_is_none_that_it_leads_to():
    leg = ld.load(five_bar(), route="pinocchio")
    mechanism = leg.backend.mechanism
    state = mechanism.close(leg.home)
    other = state.q.copy()
    other[mechanism.dependent] += 0.5
    turned = state.q.copy()
    turned[mechanism.dependent] += 2.0 * math.pi
    with mechanism.led(np.array([other])):
        assert np.array_equal(mechanism.close(leg.home).q, other)
    for pair in ([state.q, other], [other, state.q]):
        with mechanism.led(np.array(pair)):
            np.testing.assert_allclose(mechanism.close(leg.home).q, state.q, atol=1e-12)
    with mechanism.led(np.array([turned, state.q])):
        np.testing.assert_allclose(mechanism.close(leg.home).q, turned, atol=1e-12)
    np.testing.assert_allclose(mechanism.close(leg.home).q, state.q, atol=1e-12)
