"""The symbolic route against an oracle that shares no code with the package, on fixed files; and the oracle itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import read
from leg_dynamics.leg import Leg
from leg_dynamics.routes import Recipe
from leg_dynamics.symbolic.route import SymbolicRoute

TOLERANCE = 1e-9


def legs_and_oracle(lab, source, foot=None):
    """The interpreted leg and the oracle at the same home pose."""
    description = lab.quiet(read, str(source))
    foot = foot or ("foot" if description.has_link("foot") else description.links[-1].name)
    hip = "hip" if description.has_link("hip") else None
    home = None if description.home is None else dict(description.home.values)

    def seed():
        route = lab.quiet(ld.load, str(source), route="pinocchio").backend
        found = lab.quiet(lambda: route.mechanism.seeds)[0].q
        return dict(zip(route.tree_joint_names, found.tolist(), strict=True))

    route = lab.quiet(SymbolicRoute, description, foot, hip, lab.evaluate.evaluator, seed=seed)
    leg = lab.quiet(Leg, route, description, foot, Recipe(description, "symbolic", None, foot))
    oracle = lab.oracle.Oracle(description.urdf, leg.joint_names, seed() if home is None else home, foot, hip)
    return leg, oracle


def compare(lab, leg, oracle, spread, count=4):
    generator = np.random.default_rng(11)
    n, m = len(leg.joint_names), len(leg.actuator_names)
    home = oracle._newton(oracle.home)[oracle.y]
    closed = []
    while len(closed) < count:
        y = home + spread * generator.uniform(-1.0, 1.0, n)
        try:
            closed.append((y, oracle.close(y, stages=20, smallest=1e-2)))
        except lab.oracle.NotClosedError:
            continue
    y, q = (np.array(each) for each in zip(*closed, strict=True))
    v, a, tau = (generator.uniform(-3.0, 3.0, (count, size)) for size in (n, n, m))
    force, gravity = generator.uniform(-9.0, 9.0, (2, count, 3))
    pairs = {
        "mass_matrix": (y,),
        "bias": (y, v, gravity),
        "potential_energy": (y, gravity),
        "foot_position": (y,),
        "jacobian": (y,),
        "generalized_force": (y, v, a, force, gravity),
        "torque": (y, v, a, force, gravity),
        "acceleration": (y, v, tau, force, gravity),
    }
    tree = lab.quiet(leg.assemble, y)
    angles = np.stack([tree[name] for name in oracle.names], axis=-1)
    # Whole turns between two starts of a search are no disagreement.
    assert np.abs(np.exp(1j * angles) - np.exp(1j * q)).max() < TOLERANCE
    for method, arguments in pairs.items():
        name = {"jacobian": "foot_jacobian", "potential_energy": "potential"}.get(method, method)
        found = lab.quiet(getattr(leg, method), *arguments)
        for row in range(count):
            wanted = getattr(oracle, name)(q[row], *(each[row] for each in arguments[1:]))
            assert np.abs(found[row] - wanted).max() < TOLERANCE * (1.0 + np.abs(wanted).max()), method


@pytest.mark.parametrize("name", ["four_bar", "six_bar", "mini_cheetah_leg", "revolute_rotor_chain"])
def test_files_of_others(lab, name):
    path = lab.SHARED_MODELS / f"{name}.urdf"
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    compare(lab, *legs_and_oracle(lab, path), 0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["parallel_chain_explicit_d5_l6", "parallel_chain_implicit_d5_l5"])
def test_longer_files_of_others(lab, name):
    path = lab.SHARED_MODELS / f"{name}.urdf"
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    compare(lab, *legs_and_oracle(lab, path), 0.2)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "spread"), [("omnileg", 0.5), ("hexapod_leg", 0.03), ("quadruped_leg", 0.3)])
def test_shipped_legs(lab, name, spread):
    compare(lab, *legs_and_oracle(lab, name), spread)


# ---------------------------------------------------------------------------------------------- the oracle itself


def test_its_rows_by_complex_steps(lab):
    """The rows' derivatives, which are written out, against the rows alone."""
    blocks = [lab.mechanisms.Block("space", kind) for kind in lab.mechanisms.LOOP_ROWS]
    blocks += [lab.mechanisms.Block("gear", before=2, after=2), lab.mechanisms.Block("mimic", after=2)]
    for block in blocks:
        plan = lab.mechanisms.Plan(3, "hip", (block,), "none", "none", False, "solid", "last")
        oracle = lab.mechanisms.build(plan).oracle()
        generator = np.random.default_rng(0)
        q = oracle.home + generator.uniform(-0.5, 0.5, len(oracle.names))
        value, K = oracle.rows(q)
        by_step = [oracle.rows(q + 1j * 1e-30 * e)[0].imag / 1e-30 for e in np.eye(len(q))]
        assert np.abs(K - np.array(by_step).T).max() < 1e-14
        assert np.abs(value).max() > 1e-3
        assert np.abs(oracle.rows(oracle.home)[0]).max() < 1e-14


def test_its_two_null_spaces(lab):
    plan = lab.mechanisms.Plan(
        2, "plain", (lab.mechanisms.Block("space", "universal", 1),), "none", "none", False, "solid", "last"
    )
    oracle = lab.mechanisms.build(plan).oracle()
    G = oracle.null(oracle.home)
    assert np.abs(G - oracle.null(oracle.home, oracle._independent_rows(oracle.home))).max() < 1e-12
    assert np.abs(oracle.rows(oracle.home)[1] @ G).max() < 1e-13
    # And one more: the closed poses beside it.
    h = 1e-5
    for k in range(len(oracle.y)):
        step = h * np.eye(len(oracle.y))[k]
        y = oracle.home[oracle.y]
        sides = [oracle._newton(oracle.close(y + sign * step)) for sign in (1.0, -1.0)]
        assert np.abs((sides[0] - sides[1]) / (2.0 * h) - G[:, k]).max() < 1e-8


def test_it_knows_a_double_pendulum(lab):
    """Point masses at the ends of two bars, by the textbook's formulas."""
    one, other, first, second = 0.7, 0.4, 0.5, 0.3
    ball = '<inertial><origin xyz="{} 0 0"/><mass value="{}"/><inertia ixx="0" iyy="0" izz="0"/></inertial>'
    text = (
        '<robot name="p"><link name="base"/>'
        f'<link name="upper">{ball.format(first, one)}</link><link name="lower">{ball.format(second, other)}</link>'
        '<joint name="s" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 -1 0"/></joint>'
        '<joint name="e" type="continuous"><parent link="upper"/><child link="lower"/>'
        f'<origin xyz="{first} 0 0"/><axis xyz="0 -1 0"/></joint></robot>'
    )
    oracle = lab.oracle.Oracle(text)
    q, v = np.array([0.4, 0.9]), np.array([1.3, -0.7])
    c, s, g = math.cos(q[1]), math.sin(q[1]), 9.81
    M12 = other * (second**2 + first * second * c)
    M = [[one * first**2 + other * (first**2 + 2 * first * second * c + second**2), M12], [M12, other * second**2]]
    assert np.allclose(oracle.mass_matrix(q), M, atol=1e-14)
    w = other * first * second * s
    weight = [(one + other) * g * first * math.cos(q[0]), other * g * second * math.cos(q.sum())]
    bias = [-w * (2 * v[0] * v[1] + v[1] ** 2) + sum(weight), w * v[0] ** 2 + weight[1]]
    assert np.allclose(oracle.bias(q, v), bias, atol=1e-13)
