from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.closed_form import hexapod_leg as hexapod

P, V1, A1, FORCE = (0.1, -0.08, 0.7), (0.3, 0.1, -0.2), (1.0, -0.5, 0.7), (20.0, -10.0, -400.0)
GOLDEN = {  # the audit's, crosses massless
    "steel": ({}, (546.4898, 243.2143, -179.5212)),
    "aluminium": ({"density": 2700}, (576.6023, 264.0475, -197.5334)),
    "steel without link bars": ({"link_bars": 0}, (548.6536, 245.3244, -180.6279)),
}
DYNAMICS = ("bias", "mass_matrix", "gravity_torque", "potential_energy")


@pytest.fixture(scope="module")
def random_leg():
    """Every body with its own mass, off-centre COM and full tensor, on the left side, with drives and losses."""
    rng = np.random.default_rng(5)
    bodies = []
    for name in hexapod.BODY_NAMES:
        factor = rng.normal(scale=0.1, size=(3, 3))
        second_moment = factor @ factor.T
        tensor = np.trace(second_moment) * np.eye(3) - second_moment
        com = tuple(rng.uniform(-0.3, 0.3, 3).tolist())
        bodies.append(hexapod.Body(name, rng.uniform(0.3, 4.0), com, tuple(map(tuple, tensor.tolist()))))
    losses = [hexapod.Dissipation(name, *rng.uniform(0.5, 3.0, 2)) for name in ("l1", "beta1", "alpha3", "l3")]
    return hexapod.HexapodLeg(
        a=0.23,
        b=0.06,
        c=0.07,
        e=0.41,
        side=-1.0,
        bodies=tuple(bodies),
        drive_mass=(1.5, 0.7, 2.0),
        dissipation=tuple(losses),
    )


@pytest.fixture(scope="module")
def states(random_leg):
    """q, v, a, gravity, force: five tuples of three arrays of 60."""
    rng = np.random.default_rng(8)
    alpha, beta, l1 = rng.uniform([-0.9, -0.9, 0.5], [0.9, 0.9, 0.9], (60, 3)).T
    p = (l1 * np.sin(beta), -l1 * np.sin(alpha) * np.cos(beta), l1 * np.cos(alpha) * np.cos(beta))
    q = hexapod.inverse_kinematics(random_leg, p).q
    return (q, *(tuple(rng.normal(scale=s, size=(3, 60))) for s in (0.5, 3.0, 6.0, 200.0)))


def array(nested):
    return np.array([array(part) for part in nested]) if isinstance(nested, tuple) else np.broadcast_to(nested, 60)


@pytest.mark.parametrize("route", ["closed_form", "pinocchio"])
@pytest.mark.parametrize("case", GOLDEN)
def test_golden_forces(route, case):
    overrides, expected = GOLDEN[case]
    leg = ld.load("hexapod_leg", route, parameters={"cross_mass": 0, **overrides})
    q = leg.inverse_kinematics(P)
    J = leg.jacobian(q)
    v = np.linalg.solve(J, V1)
    np.testing.assert_allclose(v, (-0.165819, -0.090694, -0.184406), atol=5e-7)
    a = np.linalg.solve(J, A1 - leg.jacobian_derivative(q, v) @ v)
    np.testing.assert_allclose(leg.torque(q, v, a, foot_force=FORCE), expected, atol=1e-3)


def test_strut_by_strut_equals_body_by_body(random_leg, states):
    q, v, a, gravity, force = states
    parameters = hexapod.composite_parameters(random_leg)
    push = array(hexapod.foot_force_torque(random_leg, q, force))
    expected = array(hexapod.inverse_dynamics(random_leg, q, v, a, gravity)) + push
    found = array(hexapod.composite_inverse_dynamics(random_leg, parameters, q, v, a, gravity, force))
    assert (np.abs(found - expected) / (1 + np.abs(expected).max(axis=0))).max() < 1e-12
    arguments = {"bias": (q, v, gravity), "mass_matrix": (q,)}
    for name in DYNAMICS:
        inputs = arguments.get(name, (q, gravity))
        expected = array(getattr(hexapod, name)(random_leg, *inputs))
        found = array(getattr(hexapod, f"composite_{name}")(random_leg, parameters, *inputs))
        assert np.abs(found - expected).max() < 1e-12 * (1 + np.abs(expected).max()), name
    given = array(hexapod.forward_dynamics(random_leg, q, v, tuple(array(force) - push), gravity))
    found = array(hexapod.composite_forward_dynamics(random_leg, parameters, q, v, force, gravity, force))
    np.testing.assert_allclose(found, given, rtol=1e-9, atol=1e-9 * np.abs(given).max())


def test_mass_matrix_and_bias_are_the_parts_of_inverse_dynamics(random_leg, states):
    q, v, a, gravity, _ = states
    M = array(hexapod.mass_matrix(random_leg, q))
    np.testing.assert_allclose(M, np.swapaxes(M, 0, 1), rtol=1e-14)
    assert (np.linalg.eigvalsh(np.moveaxis(M, -1, 0)) > 0).all()
    whole = array(hexapod.inverse_dynamics(random_leg, q, v, a, gravity))
    parts = np.einsum("ijk,jk->ik", M, np.array(a)) + array(hexapod.bias(random_leg, q, v, gravity))
    np.testing.assert_allclose(whole, parts, atol=1e-11 * np.abs(whole).max())
    energy = 0.5 * np.einsum("ik,ijk,jk->k", np.array(v), M, np.array(v))
    np.testing.assert_allclose(hexapod.kinetic_energy(random_leg, q, v), energy, rtol=1e-12)
    again = array(hexapod.forward_dynamics(random_leg, q, v, tuple(whole), gravity))
    np.testing.assert_allclose(again, np.array(a), atol=1e-9)


def test_equations_are_those_of_lagrange(random_leg, states):
    """d/dt dL/dv - dL/dq by differences, losses left out."""
    leg = dataclasses.replace(random_leg, dissipation=())
    q, v, a, gravity, _ = (np.array(part) for part in states)
    h = 1e-4
    weights = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}

    def momentum(t):
        at, rate = tuple(q + v * t + 0.5 * a * t * t), tuple(v + a * t)
        return np.einsum("ijk,jk->ik", array(hexapod.mass_matrix(leg, at)), np.array(rate))

    expected = sum(w * momentum(k * h) for k, w in weights.items()) / h
    for i in range(3):
        unit = np.eye(3)[i][:, None]
        lagrangians = {k: hexapod.lagrangian(leg, tuple(q + k * h * unit), tuple(v), tuple(gravity)) for k in weights}
        expected[i] -= sum(w * lagrangians[k] for k, w in weights.items()) / h
    found = array(hexapod.inverse_dynamics(leg, tuple(q), tuple(v), tuple(a), tuple(gravity)))
    assert (np.abs(found - expected) / (1 + np.abs(found).max(axis=0))).max() < 1e-7


def test_power_balance(random_leg, states):
    """Power of the struts and of the foot force, less losses, is the rate of total energy."""
    q, v, a, gravity, force = (np.array(part) for part in states)
    leg, parameters = random_leg, hexapod.composite_parameters(random_leg)
    efforts = array(hexapod.composite_inverse_dynamics(leg, parameters, *map(tuple, (q, v, a, gravity, force))))
    power = (efforts * v).sum(axis=0)
    power += (array(hexapod.foot_velocity(leg, tuple(q), tuple(v))) * force).sum(axis=0)
    power -= (array(hexapod.dissipation_torque(leg, tuple(q), tuple(v))) * v).sum(axis=0)
    h = 1e-4
    weights = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}

    def energy(t):
        at, rate = tuple(q + v * t + 0.5 * a * t * t), tuple(v + a * t)
        return hexapod.kinetic_energy(leg, at, rate) + hexapod.potential_energy(leg, at, tuple(gravity))

    change = sum(w * energy(k * h) for k, w in weights.items()) / h
    np.testing.assert_allclose(power, change, atol=1e-7 * np.abs(power).max())


def test_foot_force_comes_back_from_the_struts(random_leg, states):
    q, v, a, gravity, force = states
    push = hexapod.foot_force_torque(random_leg, q, force)
    free = hexapod.inverse_dynamics(random_leg, q, v, a, gravity)
    loaded = tuple(x + y for x, y in zip(free, push, strict=True))
    found, determinant = hexapod.foot_force(random_leg, q, v, a, loaded, gravity)
    np.testing.assert_allclose(found, force, atol=1e-8)
    assert (np.abs(determinant) > 0).all()


def test_losses_act_along_their_own_joints(random_leg, states):
    q, v, *_ = states
    joints = {name: array(first) for name, first in hexapod.tree_coefficients(random_leg, q).items()}
    expected = np.zeros((3, 60))
    for joint, damping, friction in random_leg.dissipation:
        rate = (joints[joint] * np.array(v)).sum(axis=0)
        expected += (damping * rate + friction * np.sign(rate)) * joints[joint]
    np.testing.assert_allclose(hexapod.dissipation_torque(random_leg, q, v), expected, atol=1e-10)
    assert hexapod.dissipation_torque(dataclasses.replace(random_leg, dissipation=()), q, v) == (0.0, 0.0, 0.0)
    still = hexapod.dissipation_torque(random_leg, (0.715, 0.468, 0.73), (0.0, 0.0, 0.0))
    assert still == (0.0, 0.0, 0.0)


def test_other_assembly_modes_have_consistent_dynamics_too(random_leg, states):
    q, v, a, gravity, force = states
    for mode in hexapod.ASSEMBLY_MODES[1:]:
        leg = dataclasses.replace(random_leg, assembly_mode=mode)
        parameters = hexapod.composite_parameters(leg)
        usable = np.array(hexapod.singularity_margins(leg, q)).min(axis=0) > 1e-2
        expected = array(hexapod.inverse_dynamics(leg, q, v, a, gravity))
        expected = expected + array(hexapod.foot_force_torque(leg, q, force))
        found = array(hexapod.composite_inverse_dynamics(leg, parameters, q, v, a, gravity, force))
        error = np.abs(found - expected) / (1 + np.abs(expected).max(axis=0))
        assert usable.sum() > 10
        assert error[:, usable].max() < 1e-11


def test_margins_vanish_or_turn_negative_where_the_passive_joints_do(random_leg):
    leg = random_leg
    for foot in ((0.0, 0.0, 0.715), (0.3, 0.0, 0.6)):
        assert min(hexapod.singularity_margins(leg, hexapod.inverse_kinematics(leg, foot).q)) > 0.1, foot
    reach = np.hypot(leg.b, leg.e)
    assert hexapod.assembly_margins(leg, (0.7, leg.a + reach, 0.7))[0] == pytest.approx(0.0, abs=1e-12)
    assert hexapod.assembly_margins(leg, (0.7, leg.a + 1.1 * reach, 0.7))[0] < -0.1
    assert min(hexapod.singularity_margins(leg, (0.55, 0.4, 0.95))) < 0
    assert min(hexapod.singularity_margins(leg, (0.7, -0.45, 0.7))) < 0
