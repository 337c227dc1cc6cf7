"""Random mechanisms: the symbolic route, the pinocchio route and an independent derivation agree, or fail by name."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

import leg_dynamics as ld
from leg_dynamics.description import parse
from leg_dynamics.errors import (
    ActuationError,
    DescriptionError,
    LegDynamicsError,
    LegDynamicsWarning,
    SingularityError,
    UnsupportedError,
)
from leg_dynamics.leg import Leg
from leg_dynamics.routes import Recipe
from leg_dynamics.symbolic.route import SymbolicRoute

TOLERANCE = 1e-9
ROWS = 4
# From home, rad or m; and the share of the largest singular value that a pose away from singular ones has left.
SPREAD = {"prismatic": 0.05, "turning": 0.25}
REGULAR = 0.02
LOOP_TYPES = ("revolute", "continuous", "prismatic", "fixed", "planar", "spherical", "universal")

# The same examples in every run: a new failure is the code's, not the day's.
STEADY = {
    "derandomize": True,
    "database": None,
    "deadline": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.large_base_example],
}


def interpreted(lab, made) -> Leg:
    """The leg by the symbolic route without a compiler, and without a fallback that would hide its refusals."""
    description = parse(made.text)
    route = SymbolicRoute(description, made.foot, made.hip, lab.evaluate.evaluator)
    return Leg(route, description, made.foot, Recipe(description, "symbolic", None, made.foot))


def closed_states(lab, oracle, generator, count=ROWS):
    """Independent coordinates near home and the closed poses there, away from singular ones."""
    spread = [
        SPREAD["prismatic" if oracle.by_name[name].kind == "prismatic" else "turning"] for name in oracle.independent
    ]
    ys, poses = [], []
    for _ in range(5 * count):
        y = oracle.home[oracle.y] + np.array(spread) * generator.uniform(-1.0, 1.0, len(spread))
        try:
            poses.append(oracle.close(y, smallest=REGULAR))
        except lab.oracle.NotClosedError:
            continue
        ys.append(y)
        if len(ys) == count:
            break
    return np.array(ys), poses


def arguments_of(oracle, made, generator, y):
    count, n = y.shape
    actuators = len(oracle.actuated or oracle.independent)
    v, a = generator.uniform(-2.0, 2.0, (count, n)), generator.uniform(-5.0, 5.0, (count, n))
    tau = generator.uniform(-3.0, 3.0, (count, actuators))
    force = generator.uniform(-10.0, 10.0, (count, 3)) if made.foot else None
    gravity = generator.uniform(-10.0, 10.0, (count, 3))
    arguments = {
        "assemble": (y,),
        "mass_matrix": (y,),
        "bias": (y, v, gravity),
        "potential_energy": (y, gravity),
        "generalized_force": (y, v, a, force, gravity),
        "torque": (y, v, a, force, gravity),
        "acceleration": (y, v, tau, force, gravity),
    }
    return arguments | ({"foot_position": (y,), "jacobian": (y,)} if made.foot else {})


def outcome(leg, method, arguments, names):
    """A method's result, or the named error it raises."""
    try:
        result = getattr(leg, method)(*arguments)
    except LegDynamicsError as error:
        return error
    return np.stack([result[name] for name in names], axis=-1) if method == "assemble" else result


def expected(oracle, method, poses, arguments):
    """The independent derivation; None where it has no unique answer either."""
    if method == "assemble":
        return np.array(poses)
    if method == "torque" and len(oracle.actuated or oracle.independent) != len(oracle.independent):
        transfers = [oracle.transfer(q) for q in poses]
        if max(np.linalg.matrix_rank(A, tol=1e-9) for A in transfers) < len(oracle.independent):
            return None
        # Of more actuators than motions, the efforts of smallest norm that do the same work.
        forces = expected(oracle, "generalized_force", poses, arguments)
        return np.array([np.linalg.pinv(A.T) @ Q for A, Q in zip(transfers, forces, strict=True)])
    name = {"jacobian": "foot_jacobian", "potential_energy": "potential"}.get(method, method)
    rows = []
    for row, q in enumerate(poses):
        further = [None if each is None else each[row] for each in arguments[1:]]
        if method == "acceleration" and np.linalg.cond(oracle.mass_matrix(q)) > 1e12:
            return None
        rows.append(getattr(oracle, name)(q, *further))
    return np.array(rows)


def disagreement(one, other) -> float:
    count = len(other)
    size = 1.0 + np.abs(other).reshape(count, -1).max(axis=1)
    return float((np.abs(one - other).reshape(count, -1).max(axis=1) / size).max())


def check(lab, made, legs, methods=None) -> set[str]:
    """Compare routes and oracle at states of a mechanism; return the methods that all of them computed."""
    oracle = made.oracle()
    generator = np.random.default_rng([made.plan.seed, 3])
    y, poses = closed_states(lab, oracle, generator)
    assume(len(y) == ROWS)
    computed = set()
    for leg in legs:
        assert leg.joint_names == made.independent
    for method, arguments in arguments_of(oracle, made, generator, y).items():
        if methods is not None and method not in methods:
            continue
        results = [outcome(leg, method, arguments, oracle.names) for leg in legs]
        wanted = expected(oracle, method, poses, arguments)
        if wanted is None:
            error = ActuationError if method == "torque" else SingularityError
            for leg, result in zip(legs, results, strict=True):
                assert isinstance(result, error), (method, leg.route, result)
            continue
        for leg, result in zip(legs, results, strict=True):
            if isinstance(result, Exception):
                raise AssertionError(f"{method} by {leg.route}: {result!r}\n{made.text}")
            assert np.isfinite(result).all(), (method, leg.route)
            worst = disagreement(result, wanted)
            assert worst < TOLERANCE, (method, leg.route, worst, made.text)
        assert disagreement(*results) < TOLERANCE, (method, made.text)
        computed.add(method)
    return computed


def run(lab, plans, examples, make=interpreted, methods=None):
    """Check that many random mechanisms and count them; most must be compared with every method."""
    seen: list[set[str]] = []

    @settings(max_examples=examples, phases=[Phase.generate, Phase.shrink], **STEADY)
    @given(plans)
    def compare(plan):
        made = lab.mechanisms.build(plan)
        assume(made is not None)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            legs = make(lab, made), ld.load(made.text, route="pinocchio", foot=made.foot)
            seen.append(check(lab, made, legs, methods))

    compare()
    assert len(seen) >= 0.8 * examples
    whole = (
        {"assemble", "mass_matrix", "bias", "generalized_force", "acceleration"} if methods is None else set(methods)
    )
    assert sum(whole <= each for each in seen) >= 0.8 * len(seen)
    if methods is None:
        assert sum("torque" in each for each in seen) >= 0.6 * len(seen)


def test_a_few_random_mechanisms(lab):
    run(lab, lab.mechanisms.plans(most=2), 8)


@pytest.mark.slow
@pytest.mark.parametrize("kind", LOOP_TYPES)
def test_random_mechanisms_around_every_type_of_loop(lab, kind):
    run(lab, lab.mechanisms.plans(lab.mechanisms.loops(kind), most=3), 15)


@pytest.mark.slow
def test_random_mechanisms_of_all_sorts(lab):
    run(lab, lab.mechanisms.plans(most=4), 40)


def compiled(lab, made) -> Leg:
    return ld.load(made.text, route="symbolic", foot=made.foot)


@pytest.mark.slow
def test_compiled_kernels_of_random_mechanisms(lab, tmp_path, monkeypatch):
    monkeypatch.setenv("LEG_DYNAMICS_CACHE", str(tmp_path))
    run(lab, lab.mechanisms.plans(most=2), 12, compiled, ("assemble", "generalized_force", "acceleration"))


# ---------------------------------------------------------------------------------------------- files with mistakes


def both(text, foot, hip, lab):
    """What each route by itself makes of a text: a leg, or the named error that refuses it."""
    found = []
    for route in ("symbolic", "pinocchio"):
        try:
            if route == "symbolic":
                description = parse(text)
                back = SymbolicRoute(description, foot, hip, lab.evaluate.evaluator)
                found.append(Leg(back, description, foot, Recipe(description, route, None, foot)))
            else:
                found.append(Recipe(parse(text), route, None, foot).build())
        except LegDynamicsError as error:
            found.append(error)
    return found


@settings(max_examples=6, **STEADY)
@given(seed=st.integers(0, 1000), kind=st.sampled_from(["floating", "planar"]))
def test_joints_with_several_coordinates_are_refused_by_both(lab, seed, kind):
    block = lab.mechanisms.Block("plane", "revolute")
    plan = lab.mechanisms.Plan(seed, "plain", (block,), "none", "none", False, "solid", "last")
    made = lab.mechanisms.build(plan)
    for found in both(lab.mechanisms.with_free_leaf(made, kind), made.foot, made.hip, lab):
        assert isinstance(found, UnsupportedError)
        assert "free_joint" in str(found)


def test_a_home_beside_a_singular_pose_misleads_no_merged_inertia(lab):
    """Steps of the usual size lead nowhere from there: what holds at one pose only was taken for a law."""
    blocks = (
        lab.mechanisms.Block("plane", "planar", spare=1, elsewhere=True),
        lab.mechanisms.Block("space", "fixed", spare=1, elsewhere=True),
    )
    plan = lab.mechanisms.Plan(12310, "turned", blocks, "too few", "wide", False, "points", "none", "wrong")
    made = lab.mechanisms.build(plan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        legs = [ld.load(made.text, route=route) for route in ("pinocchio", "symbolic")]
    generator, home, tried = np.random.default_rng(1), legs[0].home, 0
    for radius in (0.05, 0.3, 1.0):
        y = home + generator.uniform(-radius, radius, (40, len(home)))
        one, other = (leg.mass_matrix(y, on_error="nan") for leg in legs)
        closed = np.isfinite(one[:, 0, 0]) & np.isfinite(other[:, 0, 0])
        tried += np.count_nonzero(closed)
        size = np.abs(one[closed]).max(axis=(1, 2), keepdims=True)
        np.testing.assert_allclose(one[closed] / size, other[closed] / size, atol=1e-10)
    assert tried > 30


def wrongly_flagged(made, generator) -> str:
    """The mechanism with any joints called independent, whether that fits its mobility or not."""
    return re.sub(
        'independent="(true|false)"', lambda _: f'independent="{str(generator.random() < 0.4).lower()}"', made.text
    )


@settings(max_examples=12, phases=[Phase.generate], **STEADY)
@given(plans=st.data())
def test_wrong_independent_flags_never_give_a_wrong_pose(lab, plans):
    plan = plans.draw(lab.mechanisms.plans(most=1))
    made = lab.mechanisms.build(plan)
    assume(made is not None)
    generator = np.random.default_rng([plan.seed, 77])
    text = wrongly_flagged(made, generator)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        legs = both(text, made.foot, made.hip, lab)
        refused = [leg for leg in legs if isinstance(leg, Exception)]
        leg = legs[0]
        if refused:
            assert all(isinstance(error, DescriptionError) for error in refused)
            # One route may say at once what the other says when it is first used.
            for each in legs:
                if not isinstance(each, Exception):
                    with pytest.raises(LegDynamicsError):
                        each.assemble(np.zeros(len(each.joint_names)))
            return
        oracle = lab.oracle.Oracle(text, leg.joint_names)
        scale = np.array([0.1 if unit == "m" else 1.0 for unit in leg.units.joints])
        y = oracle.home[oracle.y] + 0.3 * scale * generator.uniform(-1.0, 1.0, (4, len(scale)))
        try:
            tree = leg.assemble(y, on_error="nan")
        except DescriptionError:
            with pytest.raises(DescriptionError):
                legs[1].assemble(y)
            return
    found = np.stack([tree[name] for name in oracle.names], axis=-1)
    for row, pose in enumerate(y):
        if np.isfinite(found[row]).all():
            assert np.abs(found[row] - oracle.close(pose, stages=30, smallest=1e-6)).max() < TOLERANCE
