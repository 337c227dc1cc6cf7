from __future__ import annotations

import dataclasses
import math

import casadi
import numpy as np
import pytest

from leg_dynamics.closed_form import omnileg

GRAVITY = (0.0, 0.0, 9.81)
TILTED = (2.0, -3.0, 8.5)
LOSSES = (
    omnileg.Dissipation("alpha", 0.02, 0.03),
    omnileg.Dissipation("theta22", 0.01, 0.0),
    omnileg.Dissipation("cardan_A4_x", 0.0, 0.02),
    omnileg.Dissipation("phi_D3", 0.004, 0.005),
)


def scenario_52(t):
    amplitude, w = np.array([math.pi / 6, math.pi / 6, math.radians(25.0)]), math.pi / 3
    s, c = math.sin(w * t), math.cos(w * t)
    return tuple(tuple(x.tolist()) for x in (amplitude * s, amplitude * w * c, -amplitude * w * w * s))


def samples(states):
    return [tuple(map(tuple, sample)) for sample in zip(*(array.tolist() for array in states), strict=True)]


@pytest.mark.parametrize(
    ("t", "force", "expected"),
    [
        (0.0, (0.0, -20.0, 20.0), (-3.0, -0.000002, 0.0)),
        (1.0, (0.0, -20.0, 20.0), (-0.781006, 2.275804, 1.634104)),
        (1.5, (0.0, 0.0, 0.0), (0.823331, 0.823327, 0.264922)),
        (1.0, (0.0, 20.0, -20.0), (2.328380, -0.728440, -1.169886)),
    ],
    ids=["start", "pushed", "free", "paper-sign"],
)
def test_golden_torques_of_the_audit(golden_leg, t, force, expected):
    q, v, a = scenario_52(t)
    free = omnileg.inverse_dynamics(golden_leg, q, v, a, GRAVITY)
    torque = np.add(free, omnileg.foot_force_torque(golden_leg, q, force))
    np.testing.assert_allclose(torque, expected, atol=3e-6, rtol=0)


def literal_lagrange(leg, symbols):
    """(45) as it stands, by automatic differentiation of L built from positions and rotations alone."""
    q, v, a, g = symbols
    state, rate, acceleration = (casadi.vertcat(*values) for values in (q, v, a))
    motions = omnileg.body_motions(leg, q, (0.0, 0.0, 0.0))
    energy = 0.0
    for body in leg.bodies:
        turning = motions[body.name].turning
        rotation = casadi.vertcat(*(casadi.horzcat(*row) for row in turning.rotation))
        centre = casadi.vertcat(*motions[body.name].origin) + casadi.mtimes(rotation, casadi.DM(body.com))
        speed = casadi.jtimes(centre, state, rate)
        spin = casadi.mtimes(rotation.T, casadi.jtimes(rotation, state, rate))
        w = casadi.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
        energy += 0.5 * body.mass * casadi.dot(speed, speed)
        energy += 0.5 * casadi.dot(w, casadi.mtimes(casadi.DM(np.array(body.inertia)), w))
        energy += body.mass * casadi.dot(casadi.vertcat(*g), centre)
    for inertia, v_i in zip(leg.rotor_inertia, v, strict=True):
        energy += 0.5 * inertia * v_i**2
    momentum = casadi.gradient(energy, rate)
    torque = casadi.jtimes(momentum, state, rate) + casadi.jtimes(momentum, rate, acceleration)
    torque -= casadi.gradient(energy, state)
    return casadi.Function("lagrange", [*q, *v, *a, *g], [torque, energy])


def test_inverse_dynamics_is_the_literal_lagrange_equation(golden_leg, random_leg, states, symbols):
    for leg in (golden_leg, random_leg):
        lagrange = literal_lagrange(leg, symbols)
        for q, v, a in samples(states):
            torque, energy = (np.array(value).ravel() for value in lagrange(*q, *v, *a, *TILTED))
            found = omnileg.inverse_dynamics(leg, q, v, a, TILTED)
            np.testing.assert_allclose(found, torque, rtol=0, atol=1e-11 * (1.0 + np.abs(torque).max()))
            assert omnileg.lagrangian(leg, q, v, TILTED) == pytest.approx(energy[0], rel=1e-11)


def test_inverse_dynamics_agrees_with_central_differences_of_the_lagrangian(random_leg):
    q, v, a = (np.array(x) for x in ((0.5, -0.3, 0.8), (1.1, 0.7, -1.9), (3.0, -2.0, 4.0)))
    h = 1e-4

    def lagrangian(q, v):
        return omnileg.lagrangian(random_leg, tuple(q.tolist()), tuple(v.tolist()), TILTED)

    def gradient(function, x):
        return np.array([(function(x + h * e) - function(x - h * e)) / (2 * h) for e in np.eye(3)])

    def momentum(t):
        return gradient(lambda u: lagrangian(q + v * t + 0.5 * a * t * t, u), v + a * t)

    expected = (momentum(h) - momentum(-h)) / (2 * h) - gradient(lambda u: lagrangian(u, v), q)
    found = omnileg.inverse_dynamics(random_leg, *(tuple(x.tolist()) for x in (q, v, a)), TILTED)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_mass_matrix_bias_and_gravity_make_up_the_inverse_dynamics(random_leg, states):
    leg = dataclasses.replace(random_leg, dissipation=LOSSES)
    for q, v, a in samples(states):
        mass = np.array(omnileg.mass_matrix(leg, q))
        np.testing.assert_array_equal(mass, mass.T)
        assert np.linalg.eigvalsh(mass)[0] > 0.0
        torque = omnileg.inverse_dynamics(leg, q, v, a, TILTED)
        scale = 1.0 + np.abs(torque).max()
        np.testing.assert_allclose(mass @ a + omnileg.bias(leg, q, v, TILTED), torque, atol=1e-12 * scale, rtol=0)
        still = omnileg.bias(leg, q, (0.0, 0.0, 0.0), TILTED)
        np.testing.assert_allclose(omnileg.gravity_torque(leg, q, TILTED), still, atol=1e-13)
        energy = omnileg.kinetic_energy(leg, q, v)
        assert energy == pytest.approx(0.5 * np.array(v) @ mass @ v, rel=1e-12)


def test_mdot_minus_2c_is_skew_and_c_v_is_the_velocity_term(random_leg, states, symbols):
    q = symbols[0]
    state = casadi.vertcat(*q)
    mass = casadi.vertcat(*(casadi.horzcat(*row) for row in omnileg.mass_matrix(random_leg, q)))
    slopes = [casadi.jtimes(mass, state, casadi.DM(np.eye(3)[k])) for k in range(3)]
    oracle = casadi.Function("slopes", [*q], slopes)
    for row, rate, _ in samples(states):
        dm = np.array([np.array(slope) for slope in oracle(*row)])  # dm[k, i, j] = dM_ij / dq_k
        christoffel = 0.5 * (dm.transpose(1, 2, 0) + dm.transpose(1, 0, 2) - dm)  # [i, j, k] contracted with v_k
        coriolis = np.einsum("ijk,k->ij", christoffel, rate)
        velocity_term = omnileg.bias(random_leg, row, rate, (0.0, 0.0, 0.0))
        scale = 1.0 + np.abs(velocity_term).max()
        np.testing.assert_allclose(coriolis @ rate, velocity_term, atol=1e-12 * scale, rtol=0)
        rest = np.einsum("kij,k->ij", dm, rate) - 2.0 * coriolis
        np.testing.assert_allclose(rest, -rest.T, atol=1e-13 * (1.0 + np.abs(rest).max()))


def test_power_of_the_torques_is_the_rate_of_energy_plus_the_losses(random_leg, states, symbols):
    leg = dataclasses.replace(random_leg, dissipation=LOSSES)
    q, v, a, _ = symbols
    energy = omnileg.kinetic_energy(leg, q, v) + omnileg.potential_energy(leg, q, TILTED)
    state, rate = casadi.vertcat(*q), casadi.vertcat(*v)
    growth = casadi.jtimes(energy, state, rate) + casadi.jtimes(energy, rate, casadi.vertcat(*a))
    oracle = casadi.Function("growth", [*q, *v, *a], [growth])
    for sample in samples(states):
        row, speeds, _ = sample
        coefficients = omnileg.tree_coefficients(leg, row)
        rates = {name: np.dot(first, speeds) for name, first in coefficients.items()}
        losses = sum(d * rates[j] ** 2 + f * abs(rates[j]) for j, d, f in LOSSES)
        assert losses > 0.0
        power = np.dot(omnileg.inverse_dynamics(leg, *sample, TILTED), speeds)
        assert power == pytest.approx(float(oracle(*row, *speeds, *sample[2])) + losses, rel=1e-11, abs=1e-11)


def test_friction_is_odd_and_zero_at_rest(golden_leg):
    leg = dataclasses.replace(golden_leg, dissipation=LOSSES)
    q, v = (0.3, 0.2, 0.7), (1.0, -2.0, 0.5)
    assert omnileg.dissipation_torque(leg, q, (0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    ahead, back = (omnileg.dissipation_torque(leg, q, tuple(s * x for x in v)) for s in (1.0, -1.0))
    np.testing.assert_allclose(ahead, np.negative(back), rtol=1e-15)
    assert omnileg.dissipation_torque(golden_leg, q, v) == (0.0, 0.0, 0.0)


def test_rotor_inertia_adds_to_the_diagonal_of_the_mass_matrix(golden_leg):
    geared = dataclasses.replace(golden_leg, rotor_inertia=(1e-3, 2e-3, 3e-3))
    q = (0.4, -0.2, 0.9)
    difference = np.subtract(omnileg.mass_matrix(geared, q), omnileg.mass_matrix(golden_leg, q))
    np.testing.assert_allclose(difference, np.diag([1e-3, 2e-3, 3e-3]), atol=1e-17)


def test_forward_dynamics_undoes_inverse_dynamics(random_leg, states):
    leg = dataclasses.replace(random_leg, dissipation=LOSSES)
    for q, v, a in [*samples(states), ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))]:
        torque = omnileg.inverse_dynamics(leg, q, v, a, TILTED)
        found = omnileg.forward_dynamics(leg, q, v, torque, TILTED)
        np.testing.assert_allclose(found, a, atol=1e-9)


def test_energy_of_a_free_swing_of_five_seconds_is_kept(random_leg, symbols):
    integrate = pytest.importorskip("scipy.integrate")
    q, v, _, _ = symbols
    acceleration = omnileg.forward_dynamics(random_leg, q, v, (0.0, 0.0, 0.0), GRAVITY)
    total = omnileg.kinetic_energy(random_leg, q, v) + omnileg.potential_energy(random_leg, q, GRAVITY)
    flow = casadi.Function("flow", [casadi.vertcat(*q, *v)], [casadi.vertcat(*v, *acceleration)], {"cse": True})
    energy = casadi.Function("energy", [casadi.vertcat(*q, *v)], [total])
    swing = integrate.solve_ivp(
        lambda _, y: flow(y).full().ravel(),
        (0.0, 5.0),
        [0.5, -0.3, 0.6, 0.0, 0.0, 0.0],
        method="DOP853",
        rtol=1e-11,
        atol=1e-11,
    )
    assert swing.success
    assert 0.5 < np.ptp(swing.y[0]) < 2.4
    levels = np.array([float(energy(y)) for y in swing.y.T])
    assert np.abs(levels - levels[0]).max() < 1e-9 * abs(levels[0])


def test_foot_force_is_recovered_from_the_torques(random_leg, states):
    for q, v, a in samples(states):
        if abs(q[2]) < 0.05:
            continue
        force = (3.0, -20.0, 35.0)
        free = omnileg.inverse_dynamics(random_leg, q, v, a, TILTED)
        torque = tuple(np.add(free, omnileg.foot_force_torque(random_leg, q, force)).tolist())
        found, determinant = omnileg.foot_force(random_leg, q, v, a, torque, TILTED)
        np.testing.assert_allclose(found, force, rtol=1e-9)
        assert determinant == pytest.approx(omnileg.foot_jacobian_determinant(random_leg, q), rel=1e-10)


def test_virtual_work_of_a_foot_force(golden_leg):
    q, v, force = (0.3, 0.2, 0.7), (1.0, -2.0, 0.5), (3.0, -20.0, 35.0)
    power_of_the_ground = np.dot(force, omnileg.foot_velocity(golden_leg, q, v))
    assert np.dot(omnileg.foot_force_torque(golden_leg, q, force), v) == pytest.approx(-power_of_the_ground, rel=1e-14)


def test_torque_at_the_straight_leg_is_finite_and_needs_no_inverse(golden_leg):
    q, zero = (0.2, -0.1, 0.0), (0.0, 0.0, 0.0)
    assert omnileg.foot_force_torque(golden_leg, q, (0.0, 0.0, 100.0))[2] == 0.0
    assert all(map(math.isfinite, omnileg.inverse_dynamics(golden_leg, q, (1.0, 1.0, 1.0), zero, GRAVITY)))
    _, determinant = omnileg.foot_force(golden_leg, (0.2, -0.1, 1e-9), zero, zero, (1.0, 1.0, 1.0), GRAVITY)
    assert abs(determinant) < 1e-10


def test_torque_does_not_depend_on_the_radius_of_the_shank_circle(golden_leg):
    q, v, a = scenario_52(1.2)
    wide = dataclasses.replace(golden_leg, R_C=0.08)
    torques = [omnileg.inverse_dynamics(leg, q, v, a, GRAVITY) for leg in (golden_leg, wide)]
    np.testing.assert_allclose(*torques, atol=1e-15)
