"""Transmission models of the OmniLeg, held against a literal Lagrangian that is written down here once more."""

from __future__ import annotations

import dataclasses
import math
import re

import casadi
import numpy as np
import pytest

from leg_dynamics.closed_form import omnileg
from leg_dynamics.closed_form.route import ClosedFormRoute
from leg_dynamics.description import parse, read, render, shipped_urdf, shipped_xacro
from leg_dynamics.errors import LegDynamicsError, RouteError

GRAVITY = (0.0, 0.0, 9.81)
TILTED = (2.0, -3.0, 8.5)
SHAFT_PARTS = ("cross_A4", "shaft_A4B4", "cross_B4")


def model(leg, transmission):
    return dataclasses.replace(leg, transmission=transmission)


def samples(states):
    return [tuple(map(tuple, sample)) for sample in zip(*(array.tolist() for array in states), strict=True)]


def motion_52(speed=1.0, count=3001):
    """(52) over its whole period, run `speed` times as fast."""
    amplitude, w = np.array([math.pi / 6, math.pi / 6, math.radians(25.0)]), math.pi / 3
    t = np.linspace(0.0, 6.0, count)
    s, c = np.sin(w * t), np.cos(w * t)
    factors = (amplitude, speed * w * amplitude, -((speed * w) ** 2) * amplitude)
    q, v, a = (tuple(x * f for x in factor) for factor, f in zip(factors, (s, c, s), strict=True))
    return q, v, a, tuple(np.full_like(t, g) for g in GRAVITY)


def torques(leg, states):
    return np.array(np.broadcast_arrays(*omnileg.inverse_dynamics(leg, *states)))


def column(vector):
    return casadi.vertcat(*vector)


def cross_and_rod(q):
    """Rotations Ry(beta) of the cross A1 and Ry(beta) Rx(theta12) of the rod A1B1, from (12)."""
    alpha, beta, _ = q
    theta = casadi.atan(casadi.tan(alpha) * casadi.cos(beta))
    (sb, cb), (st, ct) = ((casadi.sin(x), casadi.cos(x)) for x in (beta, theta))
    ry = casadi.vertcat(casadi.horzcat(cb, 0, sb), casadi.horzcat(0, 1, 0), casadi.horzcat(-sb, 0, cb))
    rx = casadi.vertcat(casadi.horzcat(1, 0, 0), casadi.horzcat(0, ct, -st), casadi.horzcat(0, st, ct))
    return ry, ry @ rx


def spin_of(rotation, state, rate):
    spin = casadi.jtimes(rotation, state, rate) @ rotation.T
    return casadi.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])


def literal_paper(leg, symbols, carried=False):
    """Lagrange's equation on the leg of the model ``none`` with (26)-(31) written out as printed.

    With `carried`, the centre of mass of the shaft moves with omega of (29) x r, against (30).
    """
    q, v, a, g = symbols
    state, rate, acceleration = column(q), column(v), column(a)
    others = dataclasses.replace(
        leg,
        bodies=tuple(
            b._replace(mass=0.0, inertia=((0.0,) * 3,) * 3) if b.name in SHAFT_PARTS else b for b in leg.bodies
        ),
    )
    lagrangian = omnileg.lagrangian(others, q, v, g)
    knee = column(omnileg.knee_position(leg, q))
    cross, rod = cross_and_rod(q)
    z = casadi.vertcat(0, 0, 1)
    for name, rotation, origin in (
        ("cross_A4", cross, 0 * knee),
        ("cross_B4", cross, knee),
        ("shaft_A4B4", rod, 0 * knee),
    ):
        body = next(b for b in leg.bodies if b.name == name)
        tensor = casadi.DM(np.array(body.inertia))
        w = spin_of(rotation, state, rate) + z * v[2]
        arm = rotation @ casadi.DM(body.com)
        centre = origin + arm
        speed = casadi.jtimes(centre, state, rate)
        if carried:
            speed += casadi.cross(z * v[2], arm)
        local = rotation.T @ w
        lagrangian += 0.5 * body.mass * casadi.dot(speed, speed) + 0.5 * casadi.dot(local, tensor @ local)
        lagrangian += body.mass * casadi.dot(column(g), centre)
    momentum = casadi.gradient(lagrangian, rate)
    torque = casadi.jtimes(momentum, state, rate) + casadi.jtimes(momentum, rate, acceleration)
    torque -= casadi.gradient(lagrangian, state)
    return casadi.Function("paper", [*q, *v, *a, *g], [torque, lagrangian])


def test_exact_is_the_default_and_the_name_changes_no_bit(golden_leg, random_leg, states):
    for leg in (golden_leg, random_leg):
        assert leg.transmission == "exact"
        for q, v, a in samples(states):
            named = model(leg, "exact")
            assert omnileg.inverse_dynamics(named, q, v, a, TILTED) == omnileg.inverse_dynamics(leg, q, v, a, TILTED)
            assert omnileg.mass_matrix(named, q) == omnileg.mass_matrix(leg, q)


def test_exact_torque_is_what_it_was_before_there_were_models():
    leg = omnileg.from_urdf(read("omnileg"))
    q, v, a = (0.45, -0.3, 0.6), (1.0, -2.0, 0.5), (3.0, 0.25, -4.0)
    before = (0.9753680897873582, -0.4579954690721898, 0.3637778412988739)
    np.testing.assert_allclose(omnileg.inverse_dynamics(leg, q, v, a, GRAVITY), before, rtol=2e-15)


def test_kinematics_are_exact_in_every_model(golden_leg):
    q, v = (0.5, -0.3, 0.8), (1.0, 2.0, -0.5)
    for name in omnileg.TRANSMISSIONS:
        leg = model(golden_leg, name)
        assert omnileg.tree_coordinates(leg, q) == omnileg.tree_coordinates(golden_leg, q)
        assert omnileg.foot_velocity(leg, q, v) == omnileg.foot_velocity(golden_leg, q, v)


def test_paper_torque_is_the_literal_lagrange_equation_with_the_printed_velocities(
    golden_leg, random_leg, states, symbols
):
    for leg in (golden_leg, random_leg):
        bare = dataclasses.replace(leg, rotor_inertia=(0.0, 0.0, 0.0))
        oracle = literal_paper(bare, symbols)
        paper = model(bare, "paper")
        for q, v, a in samples(states):
            torque, lagrangian = (np.array(value).ravel() for value in oracle(*q, *v, *a, *TILTED))
            found = omnileg.inverse_dynamics(paper, q, v, a, TILTED)
            np.testing.assert_allclose(found, torque, rtol=0, atol=1e-11 * (1.0 + np.abs(torque).max()))
            assert omnileg.lagrangian(paper, q, v, TILTED) == pytest.approx(lagrangian[0], rel=1e-11)


def test_printed_angular_velocities(golden_leg):
    q, v = tuple(np.radians([30.0, 30.0, 40.0]).tolist()), (0.7, -1.1, 1.9)
    printed = omnileg.transmission_angular_velocities(model(golden_leg, "paper"), q, v)
    rod = omnileg.branch_motions(golden_leg, q, v)["rod_A1B1"].turning.velocity
    np.testing.assert_allclose(printed["cross_A4"], (0.0, v[1], v[2]), atol=1e-15)
    np.testing.assert_allclose(printed["cross_B4"], (0.0, v[1], v[2]), atol=1e-15)
    np.testing.assert_allclose(printed["shaft_A4B4"], np.add(rod, (0.0, 0.0, v[2])), atol=1e-15)
    columns = [omnileg.transmission_angular_velocities(golden_leg, q, tuple(e))["cross_A4"] for e in np.eye(3)]
    expected = [(0.548, -0.653, 0.0), (-0.653, 0.778, 0.0), (0.520, -0.620, 1.0)]
    np.testing.assert_allclose(columns, expected, atol=6e-4)


def test_no_orientation_has_the_printed_angular_velocities(golden_leg):
    """A rotation's columns obey dw_i/dq_j - dw_j/dq_i = w_j x w_i; the printed ones do not, the true ones do."""
    q, h = np.array([0.5, -0.4, 0.7]), 1e-5

    def columns(leg, q):
        rates = [omnileg.transmission_angular_velocities(leg, tuple(q), tuple(e))["shaft_A4B4"] for e in np.eye(3)]
        return np.array(rates)

    def worst(name):
        leg = model(golden_leg, name)
        w = columns(leg, q)
        slope = np.array([(columns(leg, q + h * e) - columns(leg, q - h * e)) / (2 * h) for e in np.eye(3)])  # [j, i]
        twist = np.swapaxes(slope, 0, 1) - slope - np.cross(w[None], w[:, None])
        return np.abs(twist).max()

    assert worst("exact") < 1e-9
    assert worst("none") < 1e-9
    assert worst("paper") > 0.5


def test_balance_of_moments_with_the_printed_velocities_does_not_keep_their_energy(golden_leg):
    """Newton-Euler and Lagrange part ways: only a true angular velocity makes I w' + w x I w the rate of momentum."""
    q, v, a = (np.array(x) for x in ((0.5, -0.4, 0.7), (3.0, 2.0, -4.0), (1.0, 2.0, 3.0)))
    body = next(b for b in golden_leg.bodies if b.name == "shaft_A4B4")
    h = 1e-5

    def missing_share(name):
        leg = model(golden_leg, name)

        def spin(q, v):
            return np.array(omnileg.transmission_angular_velocities(leg, tuple(q), tuple(v))["shaft_A4B4"])

        def tensor(q):
            rotation = np.array(omnileg.transmission_motions(leg, tuple(q), tuple(v))["shaft_A4B4"].turning.rotation)
            return rotation @ np.array(body.inertia) @ rotation.T

        def at(t):
            return q + v * t + 0.5 * a * t * t, v + a * t

        def energy(t):
            w = spin(*at(t))
            return 0.5 * w @ tensor(at(t)[0]) @ w

        w, w_rate = spin(q, v), (spin(*at(h)) - spin(*at(-h))) / (2 * h)
        growth = (energy(h) - energy(-h)) / (2 * h)
        power = w @ (tensor(q) @ w_rate + np.cross(w, tensor(q) @ w))
        return abs(power - growth) / abs(growth)

    assert missing_share("exact") < 1e-8
    assert missing_share("paper") > 0.05


@pytest.mark.parametrize("name", omnileg.TRANSMISSIONS)
def test_mass_matrix_is_symmetric_positive_and_makes_up_energy_and_torque(random_leg, states, name):
    leg = model(random_leg, name)
    for q, v, a in samples(states):
        mass = np.array(omnileg.mass_matrix(leg, q))
        np.testing.assert_array_equal(mass, mass.T)
        assert np.linalg.eigvalsh(mass)[0] > 0.0
        assert omnileg.kinetic_energy(leg, q, v) == pytest.approx(0.5 * np.array(v) @ mass @ v, rel=1e-12)
        torque = omnileg.inverse_dynamics(leg, q, v, a, TILTED)
        scale = 1.0 + np.abs(torque).max()
        np.testing.assert_allclose(mass @ a + omnileg.bias(leg, q, v, TILTED), torque, atol=1e-12 * scale, rtol=0)
        np.testing.assert_allclose(omnileg.forward_dynamics(leg, q, v, torque, TILTED), a, atol=1e-9)
        still = omnileg.bias(leg, q, (0.0, 0.0, 0.0), TILTED)
        np.testing.assert_allclose(omnileg.gravity_torque(leg, q, TILTED), still, atol=1e-13)


@pytest.mark.parametrize("name", omnileg.TRANSMISSIONS)
def test_every_model_keeps_its_own_energy(random_leg, states, symbols, name):
    """Lagrange's equation of a Lagrangian without time does so, whether its velocities exist or not."""
    leg = model(random_leg, name)
    q, v, a, _ = symbols
    energy = omnileg.kinetic_energy(leg, q, v) + omnileg.potential_energy(leg, q, TILTED)
    state, rate = column(q), column(v)
    growth = casadi.jtimes(energy, state, rate) + casadi.jtimes(energy, rate, column(a))
    oracle = casadi.Function("growth", [*q, *v, *a], [growth])
    for sample in samples(states):
        power = np.dot(omnileg.inverse_dynamics(leg, *sample, TILTED), sample[1])
        assert power == pytest.approx(float(oracle(*sample[0], *sample[1], *sample[2])), rel=1e-11, abs=1e-11)


def differences(leg, other, speed=1.0):
    states = motion_52(speed)
    return np.abs(torques(other, states) - torques(leg, states)).max(axis=1)


def test_none_differs_by_the_figures_of_the_audit(golden_leg):
    worst = differences(golden_leg, model(golden_leg, "none"))
    assert (np.abs(worst * 1e3 - (0.04, 0.04, 0.002)) < (0.006, 0.006, 0.0007)).all()


def test_paper_differs_by_a_quarter_of_the_figures_of_the_audit_which_let_the_spin_carry_the_mass(golden_leg, symbols):
    """(30) gives the centre of mass the rod's velocity; omega of (29) x r would quadruple the effect."""
    states = motion_52(count=601)
    exact = torques(golden_leg, states)
    carried = literal_paper(golden_leg, symbols, carried=True).map(601)
    torque = np.array(carried(*(x[None] for group in states for x in group))[0])
    np.testing.assert_allclose(np.abs(torque - exact).max(axis=1) * 1e3, (0.22, 0.22, 0.08), atol=0.01)
    worst = differences(golden_leg, model(golden_leg, "paper"))
    np.testing.assert_allclose(worst * 1e3, (0.056, 0.058, 0.021), atol=6e-4)
    assert (worst > differences(golden_leg, model(golden_leg, "none"))).all()


@pytest.mark.parametrize("name", ["paper", "none"])
def test_the_difference_grows_with_the_square_of_the_speed(golden_leg, name):
    slow, fast = (differences(golden_leg, model(golden_leg, name), speed) for speed in (1.0, 10.0))
    np.testing.assert_allclose(fast, 100.0 * slow, rtol=1e-6)


def test_none_is_the_exact_model_of_a_leg_with_point_masses_in_the_shaft(random_leg, states):
    points = tuple(
        body._replace(inertia=((0.0,) * 3,) * 3) if body.name in SHAFT_PARTS else body for body in random_leg.bodies
    )
    bare = dataclasses.replace(random_leg, bodies=points)
    for q, v, a in samples(states):
        assert omnileg.inverse_dynamics(model(random_leg, "none"), q, v, a, TILTED) == omnileg.inverse_dynamics(
            bare, q, v, a, TILTED
        )


@pytest.mark.parametrize("name", ["paper", "none"])
def test_models_run_on_arrays_and_symbols(random_leg, states, symbols, name):
    leg = model(random_leg, name)
    q, v, a, g = symbols
    graph = casadi.Function("tau", [*q, *v, *a, *g], [column(omnileg.inverse_dynamics(leg, q, v, a, g))])
    batch = [tuple(array.T) for array in states]
    columns = torques(leg, (*batch, TILTED)).T
    for sample, row in zip(samples(states), columns, strict=True):
        np.testing.assert_allclose(np.array(graph(*sum(sample, ()), *TILTED)).ravel(), row, rtol=1e-12, atol=1e-12)


def test_unknown_models_are_refused(golden_leg):
    with pytest.raises(RouteError, match="exact, paper, none"):
        model(golden_leg, "cardan")
    description = read("omnileg")
    with pytest.raises(RouteError, match="exact, paper, none"):
        omnileg.from_urdf(description, transmission="cardan")
    with pytest.raises(RouteError, match="no transmission 'cardan': choose one of exact, paper, none"):
        ClosedFormRoute("omnileg", description, transmission="cardan")
    with pytest.raises(RouteError, match="no colour 'red': leave it out"):
        ClosedFormRoute("omnileg", description, colour="red")


def test_route_computes_with_the_model_it_is_asked_for():
    description = read("omnileg")
    q, v, a = np.array([0.4, -0.3, 0.8]), np.array([2.0, -1.0, 3.0]), np.array([10.0, 5.0, -8.0])
    results = {}
    for name in omnileg.TRANSMISSIONS:
        route = ClosedFormRoute("omnileg", description, transmission=name)
        failures: list[object] = []
        results[name] = route.torque(q, v, a, None, None, failures)
        expected = omnileg.inverse_dynamics(
            omnileg.from_urdf(description, transmission=name), *(tuple(x.tolist()) for x in (q, v, a)), GRAVITY
        )
        np.testing.assert_allclose(results[name], expected, rtol=1e-14)
        assert failures == []
    np.testing.assert_array_equal(
        ClosedFormRoute("omnileg", description).torque(q, v, a, None, None, []), results["exact"]
    )
    assert np.abs(results["paper"] - results["exact"]).max() > 1e-5
    assert np.abs(results["none"] - results["exact"]).max() > 1e-5


def test_drives_to_the_u_joints_count_on_the_joint_side():
    changes = {
        "PL_1_ratio": 2.0,
        "PL_1_inertia": 1e-3,
        "PL_2_inertia": 3e-3,
        "M1_gear_ratio": 6,
        "M1_rotor_inertia": 1e-5,
    }
    leg = omnileg.from_urdf(read("omnileg", parameters=changes))
    np.testing.assert_allclose(leg.rotor_inertia, (3e-3, 1e-3 + 144e-5, 0.0), rtol=1e-14)
    plain = omnileg.from_urdf(read("omnileg"))
    assert plain.rotor_inertia == (0.0, 0.0, 0.0)
    q, v, a = (0.3, 0.2, 0.7), (1.0, -2.0, 0.5), (5.0, -7.0, 2.0)
    extra = np.subtract(*(omnileg.inverse_dynamics(each, q, v, a, GRAVITY) for each in (leg, plain)))
    np.testing.assert_allclose(extra, np.multiply(leg.rotor_inertia, a), atol=1e-15)


def test_drives_leave_the_shipped_file_as_it_is_at_their_defaults():
    text = render(str(shipped_xacro("omnileg")))
    assert text == shipped_urdf("omnileg").read_text(encoding="utf-8")
    assert len(re.findall("<rotorInertia>0</rotorInertia>", text)) == 3
    assert parse(text).transmissions == read("omnileg").transmissions


def test_a_drive_without_a_ratio_is_refused():
    with pytest.raises(LegDynamicsError):
        read("omnileg", parameters={"PL_1_ratio": 0.0, "PL_1_inertia": 1e-3})
