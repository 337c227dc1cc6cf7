"""Along a trajectory: one assembly mode, and where, when and why it ends."""

from __future__ import annotations

import math
import types

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis import trajectories as tr
from leg_dynamics.errors import ActuationError, AssemblyError, EffortLimitError, SingularityError

from ..five_bar import TOGGLE, five_bar


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
        (AssemblyError, SingularityError), match=r"at t = [\d.]+ s of line: .*parallel singularity"
    ) as caught:
        tr.torque_along(leg, motion)
    error = caught.value
    toggle_time = 2.0 * (1.2 - TOGGLE) / 0.7
    # The first sample that is not reached.
    assert 0.0 <= error.time - toggle_time <= 0.02 + 1e-9
    assert error.kind == "parallel"
    assert {name for name, x in error.direction.items() if abs(x) > 1e-3} == {"ka", "kb"}
    assert error.pose["mb"] == pytest.approx(TOGGLE, abs=1e-4)
    assert motion.time[error.all_rows.min()] == error.time


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
    assert caught.value.time == 0.0


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
