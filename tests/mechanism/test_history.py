"""A pose does not depend on the calls before it, not even where small steps lead smoothly to another assembly mode.

The planar 3-RPR platform of Innocenti and Parenti-Castelli (1992, doi:10.1016/0094-114X(92)90028-E), in tenths of its
lengths: around a cusp it changes its assembly mode without a singular pose on the way. Its closed form is the oracle:
struts from a pose are distances.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.optimize import fsolve

import leg_dynamics as ld
from leg_dynamics.analysis.trajectories import Trajectory, torque_along
from leg_dynamics.errors import LegDynamicsError

from ..three_rpr import corners, struts, three_rpr

# Direction of the first strut and of the platform, rad, around the cusp; the first strut keeps its length.
_PAIRS = (
    "0.872 3.103 1.082 3.124 1.274 3.246 1.484 3.351 1.676 3.508 1.885 3.718 2.077 3.910 2.286 4.119 2.478 4.311 "
    "2.688 4.520 2.880 4.712 3.089 4.922 3.264 5.114 3.269 5.326"
)
WAY = np.array(_PAIRS.split(), dtype=float).reshape(-1, 2)
STEPS = 25
GRAVITY = (0.0, -9.81, 0.0)


def determinant(pose):
    """Of the other two struts' lengths by the pose."""
    step = 1e-6
    moved = [struts(pose + step * axis)[1:] - struts(pose - step * axis)[1:] for axis in np.eye(2)]
    return np.linalg.det(np.array(moved) / (2.0 * step))


@pytest.fixture(scope="module")
def way():
    """Poses from one to another of the same strut lengths, (N, 2), nowhere singular."""
    start, last = WAY[0], fsolve(lambda pose: (struts(pose) - struts(WAY[0]))[1:], WAY[-1], xtol=1e-13)
    assert np.abs(struts(last) - struts(start)).max() < 1e-12
    assert np.linalg.norm(corners(last) - corners(start)) > 1.0
    corner = [start, *WAY[1:-1], last]
    shares = np.linspace(0.0, 1.0, STEPS, endpoint=False)[:, None]
    poses = np.concatenate([*(a + shares * (b - a) for a, b in itertools.pairwise(corner)), [last]])
    signs = np.array([determinant(pose) for pose in poses])
    assert signs.min() > 0.3
    return poses


def place(leg, y):
    return leg.foot_position(y)[:2]


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
@pytest.mark.parametrize("how", ["one by one", "in a batch"])
def test_a_way_around_a_cusp_leaves_the_leg_in_its_mode(way, route, how):
    leg = ld.load(three_rpr(way[0]), route=route, foot="platform")
    y = np.array([struts(pose) for pose in way])
    idle = np.zeros(3)
    before = leg.torque(y[0], idle, idle, gravity=GRAVITY)
    if how == "in a batch":
        leg.torque(y, np.zeros_like(y), np.zeros_like(y), gravity=GRAVITY, on_error="nan")
    else:
        for each in y:
            leg.torque(each, idle, idle, gravity=GRAVITY, on_error="nan")
    np.testing.assert_allclose(leg.torque(y[0], idle, idle, gravity=GRAVITY), before, rtol=1e-9)
    np.testing.assert_allclose(place(leg, y[0]), corners(way[0])[0], atol=1e-9)


def test_rows_do_not_depend_on_their_neighbours(way):
    y = np.array([struts(pose) for pose in way])
    order = np.random.default_rng(0).permutation(len(y))
    fresh = ld.load(three_rpr(way[0]), route="pinocchio", foot="platform")
    mixed = ld.load(three_rpr(way[0]), route="pinocchio", foot="platform")
    along = fresh.foot_position(y, on_error="nan")
    other = np.empty_like(along)
    other[order] = mixed.foot_position(y[order], on_error="nan")
    reached, straight = ~np.isnan(along[:, 0]), ~np.isnan(other[:, 0])
    np.testing.assert_allclose(along[straight & reached], other[straight & reached], atol=1e-9)
    assert 0.2 < straight.mean() < 0.9
    # A neighbour leads a little beyond the edge of what straight ways reach.
    assert (reached != straight).mean() < 0.1
    # The first quarter of the way is the mode itself.
    quarter = len(y) // 4
    expected = np.array([corners(pose)[0] for pose in way[:quarter]])
    np.testing.assert_allclose(along[:quarter, :2], expected, atol=1e-9)


def test_a_trajectory_around_a_cusp_is_refused(way):
    leg = ld.load(three_rpr(way[0]), route="pinocchio", foot="platform")
    y = np.array([struts(pose) for pose in way])
    motion = Trajectory(np.linspace(0.0, 1.0, len(y)), y, np.zeros_like(y), np.zeros_like(y))
    with pytest.raises(LegDynamicsError, match=r"assembly mode was followed to|another assembly mode"):
        torque_along(leg, motion)
