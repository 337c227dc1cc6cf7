from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from leg_dynamics.closed_form import quadruped_leg as quadruped
from leg_dynamics.description import parse
from leg_dynamics.routes import sibling, with_text
from leg_dynamics.verification.perturbation import with_random_inertia

COUNT = 400
WEIGHTS = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}


@pytest.fixture(scope="module")
def leg(quadruped_lab):
    return quadruped_lab.random_leg()


@pytest.fixture(scope="module")
def states():
    """q, v, a, gravity, force: five tuples of three arrays of 400, angles in all directions."""
    rng = np.random.default_rng(8)
    return tuple(tuple(rng.normal(scale=s, size=(3, COUNT))) for s in (2.0, 3.0, 9.0, 6.0, 40.0))


@pytest.fixture(scope="module")
def array(quadruped_lab):
    return lambda nested: quadruped_lab.array(nested, COUNT)


def assert_same(found, expected, tolerance):
    assert (np.abs(found - expected) / (1.0 + np.abs(expected).max(axis=0))).max() < tolerance


def test_base_parameters_equal_body_by_body(leg, states, array):
    q, v, a, gravity, force = states
    parameters = quadruped.composite_parameters(leg)
    push = array(quadruped.foot_force_torque(leg, q, force))
    expected = array(quadruped.inverse_dynamics(leg, q, v, a, gravity)) + push
    assert_same(array(quadruped.composite_inverse_dynamics(leg, parameters, q, v, a, gravity, force)), expected, 1e-13)
    for name, inputs in {
        "bias": (q, v, gravity),
        "mass_matrix": (q,),
        "gravity_torque": (q, gravity),
        "potential_energy": (q, gravity),
    }.items():
        expected = array(getattr(quadruped, name)(leg, *inputs))
        found = array(getattr(quadruped, f"composite_{name}")(leg, parameters, *inputs))
        assert np.abs(found - expected).max() < 1e-13 * (1 + np.abs(expected).max()), name
    given = array(quadruped.forward_dynamics(leg, q, v, tuple(array(force) - push), gravity))
    found = array(quadruped.composite_forward_dynamics(leg, parameters, q, v, force, gravity, force))
    assert_same(found, given, 1e-11)


def test_foot_force_torque_is_the_transposed_jacobian(leg, states, array):
    q, v, a, gravity, force = states
    J = array(quadruped.foot_jacobian(leg, q))
    push = array(quadruped.foot_force_torque(leg, q, force))
    np.testing.assert_allclose(push, -np.einsum("ijk,ik->jk", J, np.array(force)), atol=1e-12)
    free = quadruped.inverse_dynamics(leg, q, v, a, gravity)
    loaded = tuple(x + y for x, y in zip(free, push, strict=True))
    found, determinant = quadruped.foot_force(leg, q, v, a, loaded, gravity)
    np.testing.assert_allclose(determinant, quadruped.foot_jacobian_determinant(leg, q))
    error = np.abs(array(found) - array(force)).max(axis=0)
    assert (error * np.abs(determinant)).max() < 1e-14


def test_mass_matrix_and_bias_are_the_parts_of_inverse_dynamics(leg, states, array):
    q, v, a, gravity, _ = states
    M = array(quadruped.mass_matrix(leg, q))
    np.testing.assert_allclose(M, np.swapaxes(M, 0, 1), rtol=1e-14)
    assert (np.linalg.eigvalsh(np.moveaxis(M, -1, 0)) > 0).all()
    whole = array(quadruped.inverse_dynamics(leg, q, v, a, gravity))
    parts = np.einsum("ijk,jk->ik", M, np.array(a)) + array(quadruped.bias(leg, q, v, gravity))
    assert_same(whole, parts, 1e-13)
    energy = 0.5 * np.einsum("ik,ijk,jk->k", np.array(v), M, np.array(v))
    np.testing.assert_allclose(quadruped.kinetic_energy(leg, q, v), energy, rtol=1e-12)
    again = array(quadruped.forward_dynamics(leg, q, v, tuple(whole), gravity))
    assert_same(again, np.array(a), 1e-11)


def test_equations_are_those_of_lagrange(leg, states, array):
    """d/dt dL/dv - dL/dq by differences, losses left out."""
    leg = dataclasses.replace(leg, dissipation=())
    q, v, a, gravity, _ = (np.array(part) for part in states)
    h = 1e-3

    def momentum(t):
        at, rate = tuple(q + v * t + 0.5 * a * t * t), tuple(v + a * t)
        return np.einsum("ijk,jk->ik", array(quadruped.mass_matrix(leg, at)), np.array(rate))

    expected = sum(w * momentum(k * h / 5) for k, w in WEIGHTS.items()) / (h / 5)
    for i in range(3):
        unit = np.eye(3)[i][:, None]
        values = {k: quadruped.lagrangian(leg, tuple(q + k * h * unit), tuple(v), tuple(gravity)) for k in WEIGHTS}
        expected[i] -= sum(w * values[k] for k, w in WEIGHTS.items()) / h
    found = array(quadruped.inverse_dynamics(leg, tuple(q), tuple(v), tuple(a), tuple(gravity)))
    assert_same(found, expected, 1e-8)


def test_power_balance(leg, states, array):
    """Power of the joints and of the foot force, less losses, is the rate of total energy."""
    q, v, a, gravity, force = (np.array(part) for part in states)
    parameters = quadruped.composite_parameters(leg)
    efforts = array(quadruped.composite_inverse_dynamics(leg, parameters, *map(tuple, (q, v, a, gravity, force))))
    power = (efforts * v).sum(axis=0)
    power += (array(quadruped.foot_velocity(leg, tuple(q), tuple(v))) * force).sum(axis=0)
    power -= (array(quadruped.dissipation_torque(leg, tuple(v))) * v).sum(axis=0)
    h = 2e-4

    def energy(t):
        at, rate = tuple(q + v * t + 0.5 * a * t * t), tuple(v + a * t)
        return quadruped.kinetic_energy(leg, at, rate) + quadruped.potential_energy(leg, at, tuple(gravity))

    change = sum(w * energy(k * h) for k, w in WEIGHTS.items()) / h
    np.testing.assert_allclose(power, change, atol=1e-8 * np.abs(power).max())


def test_losses_act_on_their_own_joints(leg, states, array):
    v = np.array(states[1])
    found = array(quadruped.dissipation_torque(leg, states[1]))
    (_, damping_3, friction_3), (_, damping_1, friction_1) = leg.dissipation
    np.testing.assert_allclose(found[0], damping_1 * v[0] + friction_1 * np.sign(v[0]), rtol=1e-14)
    np.testing.assert_array_equal(found[1], 0.0)
    np.testing.assert_allclose(found[2], damping_3 * v[2] + friction_3 * np.sign(v[2]), rtol=1e-14)
    assert quadruped.dissipation_torque(leg, (0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    assert quadruped.dissipation_torque(leg, (1e-20, 1.0, 0.0)) == (pytest.approx(0.0, abs=1e-19), 0.0, 0.0)
    complete = quadruped.with_every_number(leg)
    assert [each.joint for each in complete.dissipation] == list(quadruped.JOINT_NAMES)
    np.testing.assert_array_equal(array(quadruped.dissipation_torque(complete, states[1])), found)


# The base parameters


def rank(matrix):
    values = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=0), compute_uv=False)
    assert not ((values < 1e-6 * values[0]) & (values > 1e-11 * values[0])).any()
    return int((values > 1e-6 * values[0]).sum())


def test_base_parameters_are_as_few_as_can_be(leg, states, array):
    """Body by body, a torque is linear in mass, first and second moments: ten points on each body span them."""
    q, v, a, gravity, _ = states
    leg = dataclasses.replace(leg, dissipation=())
    names = quadruped.BASE_PARAMETER_NAMES["exact"]
    base = array(quadruped.regressor(leg, q, v, a, gravity)).transpose(2, 0, 1).reshape(3 * COUNT, -1)
    assert base.shape[1] == len(names) == 18
    assert rank(base) == 18

    rng = np.random.default_rng(10)
    none = ((0.0, 0.0, 0.0),) * 3
    columns = []
    for name in quadruped.BODY_NAMES:
        for _ in range(10):
            point = quadruped.Body(name, 1.0, tuple(rng.uniform(-0.5, 0.5, 3).tolist()), none)
            bodies = tuple(
                point if other == name else quadruped.Body(other, 0.0, (0.0, 0.0, 0.0), none)
                for other in quadruped.BODY_NAMES
            )
            alone = dataclasses.replace(leg, bodies=bodies, drive_inertia=(0.0, 0.0, 0.0))
            columns.append(array(quadruped.inverse_dynamics(alone, q, v, a, gravity)).T.ravel())
    drives = (np.array(a).T[:, :, None] * np.eye(3)).reshape(3 * COUNT, 3)
    full = np.column_stack([*columns, drives])
    assert full.shape[1] == 33
    assert rank(full) == 18
    assert rank(np.column_stack([full, base])) == 18


def test_regressor_times_base_parameters_is_the_torque(leg, states, array):
    q, v, a, gravity, _ = states
    pi = np.array(quadruped.base_parameters(leg))
    assert (pi != 0.0).all()
    Y = array(quadruped.regressor(leg, q, v, a, gravity))
    expected = array(quadruped.inverse_dynamics(dataclasses.replace(leg, dissipation=()), q, v, a, gravity))
    assert_same(np.einsum("ijk,j->ik", Y, pi), expected, 1e-13)
    units = {quadruped.BASE_PARAMETER_UNITS[name] for name in quadruped.BASE_PARAMETER_NAMES["exact"]}
    assert units == {"kg·m", "kg·m²"}


def test_the_interface_offers_the_regressor(quadruped_lab):
    leg = quadruped_lab.load(text=quadruped_lab.leg_text(losses=False))
    rng = np.random.default_rng(3)
    q, v, a, gravity = rng.normal(size=(4, 50, 3))
    values = np.array([parameter.value for parameter in leg.base_parameters.values()])
    torque = leg.torque(q, v, a, gravity=gravity)
    np.testing.assert_allclose(leg.regressor(q, v, a, gravity) @ values, torque, atol=1e-12)
    derivatives = leg.torque_derivatives(q, v, a, parameters=("l2", "link_3.mass", "theta1.damping"))
    np.testing.assert_allclose(derivatives.parameters[..., 2], v * [1.0, 0.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(derivatives.a, leg.mass_matrix(q), atol=1e-12)
    backend = leg.backend
    h = 1e-4

    def torque_of(**changes):
        bodies = tuple(b._replace(mass=b.mass + changes.get(b.name, 0.0)) for b in backend.numbers.bodies)
        other = dataclasses.replace(backend.numbers, bodies=bodies, l2=backend.numbers.l2 + changes.get("l2", 0.0))
        nested = quadruped.inverse_dynamics(other, tuple(q.T), tuple(v.T), tuple(a.T), other.gravity)
        return np.array(nested).T

    for column, name in enumerate(("l2", "link_3")):
        numeric = (torque_of(**{name: h}) - torque_of(**{name: -h})) / (2 * h)
        np.testing.assert_allclose(derivatives.parameters[..., column], numeric, atol=1e-5)


# Against the other routes


def compare(one, other, count, seed, *, kinematics=True):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (count, 3))
    v, a, tau, force, gravity = (rng.normal(scale=s, size=(count, 3)) for s in (3.0, 20.0, 5.0, 40.0, 7.0))
    if kinematics:
        assert np.abs(one.foot_position(q) - other.foot_position(q)).max() < 1e-12
        for name, arguments in (("jacobian", (q,)), ("jacobian_derivative", (q, v)), ("foot_acceleration", (q, v, a))):
            assert np.abs(getattr(one, name)(*arguments) - getattr(other, name)(*arguments)).max() < 1e-12, name
    for name, arguments in {
        "torque": (q, v, a, force, gravity),
        "bias": (q, v, gravity),
        "mass_matrix": (q,),
        "acceleration": (q, v, tau, force, gravity),
        "potential_energy": (q, gravity),
    }.items():
        found, expected = getattr(one, name)(*arguments), getattr(other, name)(*arguments)
        assert (np.abs(found - expected) / (1.0 + np.abs(expected))).max() < 1e-9, name
    np.testing.assert_allclose(one.torque(q, v, a), other.torque(q, v, a), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
@pytest.mark.parametrize("losses", [False, True])
def test_routes_agree(quadruped_lab, route, losses):
    leg = quadruped_lab.load(text=quadruped_lab.leg_text(0.06, 0.11, 0.13, losses=losses))
    other = sibling(leg, route)
    compare(leg, other, 200, 1)
    text = with_random_inertia(leg.description, 4)
    compare(with_text(leg, text), with_text(other, text), 200, 2, kinematics=False)


@pytest.mark.slow
@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_routes_agree_at_ten_thousand_states(quadruped_lab, route):
    """The shipped lengths, and random inertias: 2,000 states each of five files."""
    leg = quadruped_lab.load()
    other = sibling(leg, route)
    compare(leg, other, 2000, 10)
    for seed in range(11, 15):
        text = with_random_inertia(leg.description, seed)
        compare(with_text(leg, text), with_text(other, text), 2000, seed)


def test_damped_chains_go_the_same_way_by_pinocchio(quadruped_lab):
    """An open chain needs no closing: any order of states gives the same results."""
    leg = quadruped_lab.load("pinocchio")
    rng = np.random.default_rng(5)
    q, v, a = rng.uniform(-3.0, 3.0, (3, 40, 3))
    whole = leg.torque(q, v, a, foot_force=[1.0, 2.0, 3.0])
    backwards = leg.torque(q[::-1], v[::-1], a[::-1], foot_force=[1.0, 2.0, 3.0])[::-1]
    np.testing.assert_array_equal(whole, backwards)
    np.testing.assert_allclose(leg.acceleration(q, v, whole, foot_force=[1.0, 2.0, 3.0]), a, atol=1e-9)
    assert parse(quadruped_lab.leg_text()).loops == ()
