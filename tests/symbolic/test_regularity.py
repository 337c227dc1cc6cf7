"""Singular poses of the closure: what crosses one is the fallback's, and nothing else is answered wrongly."""

from __future__ import annotations

import re

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse, read
from leg_dynamics.errors import AssemblyError, RowFailures, SingularityError
from leg_dynamics.mechanism.route import PinocchioRoute
from leg_dynamics.symbolic import model as models
from leg_dynamics.symbolic.regularity import determinant
from leg_dynamics.symbolic.route import SymbolicRoute

# From here on a pose is too near to a singular one for two solutions to agree to 1e-9.
AGREE = 1e-9


def test_determinants_of_sparse_matrices():
    generator = np.random.default_rng(0)
    for size in (1, 2, 3, 5, 8, 12):
        A = generator.standard_normal((size, size)) * (generator.random((size, size)) < 0.6) + np.eye(size)
        rows = [{j: float(A[i, j]) for j in range(size) if A[i, j]} for i in range(size)]
        assert determinant(rows) == pytest.approx(np.linalg.det(A), rel=1e-9, abs=1e-12)
    assert determinant([{0: 1.0, 1: 2.0}, {0: 2.0, 1: 4.0}]) == 0.0
    assert determinant([{0: 1.0}, {}]) == 0.0


def test_legs_without_singular_poses_in_their_limits_walk_nowhere(lab):
    model = models.build_model(read("omnileg"), "foot", "hip")
    assert not model.walks
    # The limits with some room, and both sides of the straight leg.
    limits = ld.load("omnileg", route="pinocchio").limits
    assert (model.regularity.lower < limits.lower).all()
    assert (model.regularity.upper > limits.upper).all()
    assert model.regularity.lower[2] == pytest.approx(-model.regularity.upper[2])
    # A crank that goes round and round meets none.
    model = models.build_model(parse(lab.crank_rocker()), "foot")
    assert not model.walks


def test_rows_outside_the_room_are_left_to_the_fallback(lab):
    description = read("omnileg")
    route = SymbolicRoute(description, "foot", "hip", lab.evaluate.evaluator)
    q = np.array([[0.1, 0.2, 0.3], [1.6, 0.2, 0.3], [0.1, 0.2, -1.4]])
    found = route.kernel_rows("tree_coordinates", q)
    assert np.isfinite(found[[0, 2]]).all()
    assert np.isnan(found[1]).all()


@pytest.fixture(scope="module", params=["four_bar", "six_bar", "parallel_chain_implicit_d5_l5", "hexapod_leg"])
def both(request, lab):
    """The routes of a mechanism whose joint limits hold singular poses or poses out of reach."""
    source = request.param
    if source != "hexapod_leg":
        path = lab.SHARED_MODELS / f"{source}.urdf"
        if not path.exists():
            pytest.skip(f"{path} is not on this machine")
        source = str(path)
    description = lab.quiet(read, source)
    numeric = PinocchioRoute(description, None, None)
    seed = lab.quiet(lambda: numeric.mechanism.seeds)[0].q.tolist()
    names = numeric.tree_joint_names
    symbolic = SymbolicRoute(description, None, None, seed=lambda: dict(zip(names, seed, strict=True)))
    return symbolic, numeric


def rows_of(symbolic, numeric, count, seed):
    lower, upper = numeric.mechanism.search_box()
    independent = numeric.mechanism.independent
    generator = np.random.default_rng(seed)
    q = generator.uniform(lower[independent], upper[independent], (count, len(independent)))
    # Neighbours follow each other: the numeric closure starts from the row before.
    cells = np.floor((q - q.min(axis=0)) / np.maximum(np.ptp(q, axis=0) / count ** (1.0 / q.shape[1]), 1e-9))
    q = q[np.lexsort([q[:, -1], *cells.T[:-1]])]
    found = symbolic.kernel_rows("tree_coordinates", q)
    order = [numeric.tree_joint_names.index(name) for name in symbolic.tree_joint_names]
    return q, found, order


def check(symbolic, numeric, count, seed):
    """No row that the kernel answers may differ; rows that it leaves NaN are the numeric route's own."""
    q, found, order = rows_of(symbolic, numeric, count, seed)
    answered = np.flatnonzero(np.isfinite(found).all(axis=1))
    assert np.isnan(found).all(axis=1).sum() + len(answered) == count
    assert len(answered) > 0.2 * count
    failures = RowFailures()
    wanted = numeric.tree_coordinates(q[answered], failures)[:, order]
    assert not failures, failures.combined(len(answered))
    # The numeric route takes whole turns off angles, which are no other pose.
    difference = found[answered] - wanted
    angles = np.array([numeric.mechanism.description.joint(name).unit == "rad" for name in symbolic.tree_joint_names])
    difference -= 2.0 * np.pi * np.round(difference / (2.0 * np.pi)) * angles
    assert np.abs(difference).max() < AGREE
    left = np.setdiff1d(np.arange(count), answered)
    left = np.random.default_rng(seed).choice(left, min(50, len(left)), replace=False)
    # Nearly all of the others have no answer at all.
    failures = RowFailures()
    numeric.tree_coordinates(q[left], failures)
    assert len(failures.rows) >= 0.8 * len(left)


def test_what_the_kernel_answers_lies_on_a_regular_way_from_home(both):
    symbolic, numeric = both
    assert symbolic.model.walks
    check(symbolic, numeric, 300, 0)


def test_a_walk_ends_where_no_closed_pose_is_left(lab):
    # Home is close to a dead centre: beyond it Newton's iterates wander about until they fall into another mode.
    block = lab.mechanisms.Block("space", "fixed", 1, 1)
    plan = lab.mechanisms.Plan(5, "plain", (block,), "none", "narrow", False, "solid", "last")
    text = re.sub(' independent="[a-z]*"', ' independent="false"', lab.mechanisms.build(plan).text)
    independent = ("joint_0", "joint_3")
    for name in independent:
        text = re.sub(rf'(<joint name="{name}" type="[a-z]*" independent)="false"', r'\1="true"', text)
    route = SymbolicRoute(parse(text), None, None, lab.evaluate.evaluator)
    assert route.model.walks
    oracle = lab.oracle.Oracle(text, independent)
    beyond = np.array([[0.0335, 0.0059], [0.045, -0.0737], [0.4234, 0.4913], [-0.0891, 0.0499]])
    change = np.concatenate([beyond, np.random.default_rng(0).uniform(-0.02, 0.02, (6, 2))])
    q = oracle.home[oracle.y] + change
    found = route.kernel_rows("tree_coordinates", q)
    order = [oracle.index[name] for name in route.tree_joint_names]
    answered = 0
    for row, y in enumerate(q):
        try:
            wanted = oracle.close(y, stages=40, smallest=1e-6)
        except lab.oracle.NotClosedError:
            assert np.isnan(found[row]).all(), change[row]
            continue
        assert row >= len(beyond)
        if np.isfinite(found[row]).all():
            answered += 1
            assert np.abs(found[row] - wanted[order]).max() < AGREE
    assert answered >= 3


@pytest.mark.slow
def test_two_hundred_thousand_rows_without_a_wrong_branch(both):
    symbolic, numeric = both
    check(symbolic, numeric, 20_000 if symbolic.model.n > 3 else 200_000, 1)


@pytest.mark.filterwarnings("ignore:.*gives no configuration")
def test_the_way_over_a_singular_pose_is_refused_on_both_sides(lab):
    path = lab.SHARED_MODELS / "four_bar.urdf"
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    leg = lab.quiet(ld.load, str(path), route="symbolic")
    other = lab.quiet(ld.load, str(path), route="pinocchio")
    for y in (-0.137, 4.0, -4.0, -7.0, 12.0):
        for each in (leg, other):
            with pytest.raises((SingularityError, AssemblyError)):
                each.assemble([y])
    near, far = leg.assemble([0.05]), other.assemble([0.05])
    assert all(near[name] == pytest.approx(far[name], abs=AGREE) for name in near)


@pytest.mark.slow
def test_a_million_rows_of_the_omnileg_against_the_closed_form():
    legs = [ld.load("omnileg", route=route) for route in ("symbolic", "closed_form")]
    limits = legs[0].limits
    generator = np.random.default_rng(7)
    q = generator.uniform(limits.lower, limits.upper, (1_000_000, 3))
    found = legs[0]._route.kernel_rows("tree_coordinates", q)
    assert np.isfinite(found).all()
    wanted = legs[1].assemble(q)
    names = legs[0]._route.tree_joint_names
    assert max(np.abs(found[:, k] - wanted[name]).max() for k, name in enumerate(names)) < AGREE
