"""Load sharing: balance to rounding, feet that only push, friction, and least forces against a general solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from leg_dynamics.analysis.gait import share_load, support_margin
from leg_dynamics.errors import ShapeError, TrajectoryError

RNG = np.random.default_rng(11)
WEIGHT = np.array([0.0, 0.0, 1000.0])


def residuals(feet, centre, load, force):
    missing = force.sum(axis=1) - load
    turning = np.cross(feet - centre[:, None], force).sum(axis=1)
    return np.abs(missing).max(axis=1), np.abs(turning).max(axis=1)


def stands(count, samples):
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    feet = np.stack([np.cos(angle), np.sin(angle), np.full(count, -0.7)], axis=-1) * [0.8, 0.4, 1.0]
    feet = np.broadcast_to(feet, (samples, count, 3)) + RNG.normal(size=(samples, count, 3)) * [0.05, 0.05, 0.0]
    centre = RNG.normal(size=(samples, 3)) * [0.2, 0.1, 0.02]
    return feet, centre


@pytest.mark.parametrize("count", [3, 4, 6, 8])
@pytest.mark.parametrize("friction", [None, 0.6])
def test_balance_and_bounds(count, friction):
    feet, centre = stands(count, 200)
    load = WEIGHT + RNG.normal(size=(200, 3)) * [30.0, 30.0, 50.0] * (friction is not None)
    shared = share_load(feet, np.ones((200, count), dtype=bool), centre, load, friction=friction)
    good = shared.feasible
    assert good.mean() > 0.5
    force = shared.force[good]
    for residual in residuals(feet[good], centre[good], load[good], force):
        assert residual.max() < 1e-9 * 1000.0
    assert (shared.residual[good] < 1e-6).all()
    assert force[..., 2].min() > -1e-6
    if friction is not None:
        slip = np.linalg.norm(force[..., :2], axis=-1) - friction * force[..., 2]
        assert slip.max() < 1e-6
    assert np.isnan(shared.force[~good]).all()


@pytest.mark.parametrize("count", [3, 5])
def test_without_friction_limits_the_support_polygon_decides(count):
    feet, centre = stands(count, 300)
    load = np.broadcast_to(WEIGHT, (300, 3))
    stance = np.ones((300, count), dtype=bool)
    shared = share_load(feet, stance, centre, load)
    margin = support_margin(feet[..., :2], stance, centre[:, :2])
    clear = np.abs(margin) > 1e-6
    assert (shared.feasible == (margin > 0.0))[clear].all()
    assert not shared.feasible.all()


@pytest.mark.parametrize("friction", [None, 0.35])
def test_forces_are_the_least_ones(friction):
    feet, centre = stands(5, 12)
    # Near an edge, so that the bounds bind.
    centre[::2, 0] += 0.35
    load = WEIGHT + np.array([120.0, -60.0, 0.0]) * (friction is not None)
    load = np.broadcast_to(load, (12, 3))
    shared = share_load(feet, np.ones((12, 5), dtype=bool), centre, load, friction=friction)
    assert shared.feasible.sum() >= 5
    bounded = 0
    for k in np.flatnonzero(shared.feasible):
        found = shared.force[k] / 1000.0

        def balance(f, k=k):
            f = f.reshape(5, 3)
            return np.concatenate([f.sum(axis=0) - load[k] / 1000, np.cross(feet[k] - centre[k], f).sum(axis=0)])

        def push(f):
            f = f.reshape(5, 3)
            if friction is None:
                return f[:, 2]
            side = friction / np.sqrt(2.0) * f[:, 2]
            return np.concatenate([f[:, 2], *(side + s * f[:, axis] for s in (1, -1) for axis in (0, 1))])

        start = np.tile(load[k] / 5000.0, 5)
        best = minimize(
            lambda f: f @ f,
            start,
            jac=lambda f: 2.0 * f,
            method="SLSQP",
            constraints=[{"type": "eq", "fun": balance}, {"type": "ineq", "fun": push}],
            options={"maxiter": 400, "ftol": 1e-14},
        )
        assert best.success
        assert (found**2).sum() == pytest.approx(best.fun, rel=1e-6)
        assert np.abs(found.ravel() - best.x).max() < 1e-4
        bounded += push(found.ravel()).min() < 1e-9
    assert bounded


def test_infeasible_loads_are_infeasible_by_linear_programming_too():
    feet, centre = stands(4, 60)
    load = np.broadcast_to(WEIGHT + np.array([300.0, 0.0, 0.0]), (60, 3))
    shared = share_load(feet, np.ones((60, 4), dtype=bool), centre, load, friction=0.5)
    edge = 0.5 / np.sqrt(2.0)
    generators = np.array([[edge * sx, edge * sy, 1.0] for sx in (1, -1) for sy in (1, -1)])
    for k in range(60):
        columns = [np.concatenate([g, np.cross(foot - centre[k], g)]) for foot in feet[k] for g in generators]
        wanted = np.concatenate([load[k], np.zeros(3)]) / 1000.0
        answer = linprog(np.ones(16), A_eq=np.array(columns).T, b_eq=wanted)
        assert answer.success == shared.feasible[k]
    assert 0 < shared.feasible.sum() < 60


def test_a_symmetric_stand_shares_symmetrically():
    feet = np.array([[[0.7, 0.3, -0.7], [-0.7, 0.3, -0.7], [0.0, -0.3, -0.7]]])
    shared = share_load(feet, np.ones((1, 3), dtype=bool), np.zeros((1, 3)), WEIGHT[None])
    assert np.allclose(shared.force[0], [[0, 0, 250.0], [0, 0, 250.0], [0, 0, 500.0]], atol=1e-9)


def test_few_feet():
    below = np.array([[[0.1, 0.0, -0.7], [0.5, 0.0, -0.7], [0.0, 0.6, -0.7]]])
    centre = np.array([[0.1, 0.0, 0.0]])
    one = share_load(below, [[True, False, False]], centre, WEIGHT[None])
    assert one.feasible[0]
    assert np.allclose(one.force[0], [[0, 0, 1000.0], [0, 0, 0], [0, 0, 0]])
    assert not share_load(below, [[False, True, False]], centre, WEIGHT[None]).feasible[0]
    two = share_load(below, [[True, True, False]], np.array([[0.2, 0.0, 0.0]]), WEIGHT[None])
    assert np.allclose(two.force[0, :, 2], [750.0, 250.0, 0.0])
    none = share_load(below, [[False] * 3], centre, WEIGHT[None])
    assert not none.feasible[0]
    assert none.residual[0] == pytest.approx(1000.0)


def test_a_moment_is_balanced_too():
    feet, centre = stands(4, 30)
    moment = RNG.normal(size=(30, 3)) * 20.0
    shared = share_load(feet, np.ones((30, 4), dtype=bool), centre, np.tile(WEIGHT, (30, 1)), moment)
    good = shared.feasible
    turning = np.cross(feet - centre[:, None], shared.force).sum(axis=1)
    assert np.abs(turning - moment)[good].max() < 1e-9 * 1000.0


def test_bad_arguments_are_named():
    feet, centre = stands(4, 2)
    with pytest.raises(ShapeError):
        share_load(feet, np.ones((2, 3), dtype=bool), centre, np.tile(WEIGHT, (2, 1)))
    with pytest.raises(TrajectoryError, match="friction"):
        share_load(feet, np.ones((2, 4), dtype=bool), centre, np.tile(WEIGHT, (2, 1)), friction=-0.5)
