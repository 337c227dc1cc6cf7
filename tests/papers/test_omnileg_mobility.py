"""Closure and mobility of the OmniLeg, counted and ranked."""

from __future__ import annotations

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.omnileg import facts, mobility


@pytest.fixture(scope="module")
def context():
    return Context("omnileg", samples=500)


@pytest.fixture(scope="module")
def verdicts(context):
    return {
        verdict.item.removeprefix("claim: "): verdict
        for verdict in (function(context) for function in mobility.VERDICTS)
    }


def figure(verdict, name):
    return next(f.value for f in verdict.figures if f.name == name)


@pytest.mark.parametrize(
    ("loops", "rows", "joints", "rank", "straight"),
    [
        (mobility.THIGH, 12, 12, 10, 10),
        (mobility.THIGH + mobility.SHAFT, 18, 18, 15, 15),
        (mobility.SHANK, 12, 9, 8, 6),
        (mobility.THIGH + mobility.SHAFT + mobility.SHANK, 30, 27, 23, 21),
        (mobility.THIGH + mobility.SHAFT + mobility.SHANK + mobility.GEARS, 33, 27, 24, 24),
    ],
)
def test_rows_joints_and_ranks(context, loops, rows, joints, rank, straight):
    group = mobility.group_mobility(context, loops)
    assert (group.rows, group.joints, group.rank, group.rank_straight) == (rows, joints, rank, straight)
    assert group.gruebler == joints - rows
    assert group.mobility == joints - rank
    assert group.redundant == rows - rank
    assert group.gap > 1e5


def test_loop_matrix_is_tangent_to_the_closed_mechanism(context):
    """Rates of the assembled tree's joints, the cut joints from the loops themselves, satisfy every row."""
    mechanism = facts.Assembled(context.pinocchio, context.q[:4])
    loops = mobility.THIGH + mobility.SHAFT + mobility.SHANK + mobility.GEARS
    K, members = mobility.loop_matrix(context.leg.description, loops, mobility.joint_twists(mechanism))
    step = 1e-6
    rates = np.zeros((4, len(members), 3))
    for k, unit in enumerate(np.eye(3)):
        ahead, behind = (context.pinocchio.assemble(mechanism.q + sign * step * unit) for sign in (1.0, -1.0))
        for joint in ahead:
            rates[:, members.index(joint), k] = (ahead[joint] - behind[joint]) / (2.0 * step)
    cut = [members.index(name) for name in members if name.startswith("loop_")]
    rest = -K @ rates
    for row in range(4):
        closing, *_ = np.linalg.lstsq(K[row][:, cut], rest[row], rcond=None)
        assert K[row][:, cut] @ closing == pytest.approx(rest[row], abs=1e-8)


def test_mobility_is_confirmed_by_count_and_by_the_numeric_route(context, verdicts):
    whole = verdicts["three degrees of freedom of the leg"]
    assert whole.status is Status.CONFIRMED
    assert figure(whole, "Grübler's count") == -6
    assert figure(whole, "redundant rows") == context.pinocchio.mobility_report(samples=5).redundant
    assert mobility._mobility(context, "x", "x", mobility.SHANK, 2).status is Status.NOT_REPRODUCIBLE
