"""Composite parameters: the reduced equations are the body-by-body ones, and no parameter is superfluous."""

from __future__ import annotations

import dataclasses
import math

import casadi
import numpy as np
import pytest

from leg_dynamics.closed_form import algebra, omnileg
from leg_dynamics.closed_form.omnileg import BASE_PARAMETER_NAMES, BASE_PARAMETER_UNITS, TRANSMISSIONS
from leg_dynamics.description import read

CARDAN_PARTS = ("cross_A4", "shaft_A4B4", "cross_B4")
AT_SHIPPED = {
    *("inertia_alpha", "inertia_beta", "inertia_gamma", "transverse", "spin_1", "spin_2"),
    *("moment_r", "shank_cos_cos", "shank_cos_z"),
}
"""What the shipped leg's symmetric bodies leave, without the Cardan shaft's rotary inertia."""


@pytest.fixture(scope="module")
def shipped_leg():
    return omnileg.from_urdf(read("omnileg"))


@pytest.fixture(scope="module")
def wide_states():
    """300 states up to +-100 deg, some at gamma = 0, away from singular ones: q, v, a, gravity as tuples of arrays."""
    rng = np.random.default_rng(46)
    q = rng.uniform(-math.radians(100.0), math.radians(100.0), (600, 3))
    q[:20, 2] = 0.0
    q[20:30, :2] = 0.0
    sa, sb = np.sin(q[:, :2].T)
    d = 1.0 - (sa * sb) ** 2
    y = -(np.cos(q[:, 2]) * sa * np.cos(q[:, 1]) + np.sin(q[:, 2]) * sb * np.cos(q[:, 0]))
    q = q[(d > 0.05) & (1.0 - y * y / d > 0.05)][:300]
    assert len(q) == 300
    assert (np.abs(q[:, :2]) > math.radians(90.0)).any(axis=1).sum() > 20
    draws = q, *(rng.normal(scale=scale, size=q.shape) for scale in (3.0, 9.0, 6.0))
    return tuple(tuple(np.ascontiguousarray(draw.T)) for draw in draws)


def stacked(nested, count):
    """Array of scalars and rows whose constant entries are floats."""
    if isinstance(nested, tuple):
        return np.array([stacked(part, count) for part in nested])
    return np.broadcast_to(nested, count)


def assert_same(found, expected, count):
    """Equal to 1e-12 of the greatest component of each sample."""
    found, expected = stacked(found, count), stacked(expected, count)
    assert found.shape == expected.shape
    components = tuple(range(expected.ndim - 1))
    error, size = np.abs(found - expected).max(axis=components), np.abs(expected).max(axis=components)
    assert (error <= 1e-12 * size).all(), (error / size).max()


def coefficients(leg, states):
    """Regressor of all states, rows (state, torque)."""
    count = len(states[0][0])
    return stacked(omnileg.regressor(leg, *states), count).transpose(2, 0, 1).reshape(3 * count, -1)


def torques(leg, states):
    count = len(states[0][0])
    return stacked(omnileg.inverse_dynamics(leg, *states), count).T.ravel()


def rank(columns):
    columns = columns[:, np.abs(columns).max(axis=0) > 1e-10 * np.abs(columns).max()]
    values = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)
    found = int((values > 1e-8 * values[0]).sum())
    assert found == len(values) or values[found] < 1e-11 * values[0]  # a gap, not a choice of threshold
    return found


@pytest.mark.parametrize("transmission", TRANSMISSIONS)
@pytest.mark.parametrize("which", ["random_leg", "golden_leg", "shipped_leg"])
def test_reduced_equations_are_the_body_by_body_equations(request, which, transmission, wide_states):
    losses = (omnileg.Dissipation("beta", 0.02, 0.03), omnileg.Dissipation("cardan_A4_x", 0.01, 0.02))
    leg = dataclasses.replace(request.getfixturevalue(which), transmission=transmission, dissipation=losses)
    parameters = omnileg.composite_parameters(leg)
    q, v, a, g = wide_states
    for name, arguments in {
        "inverse_dynamics": (q, v, a, g),
        "bias": (q, v, g),
        "mass_matrix": (q,),
        "gravity_torque": (q, g),
        "potential_energy": (q, g),
        "forward_dynamics": (q, v, a, g),
    }.items():
        found = getattr(omnileg, f"composite_{name}")(leg, parameters, *arguments)
        assert_same(found, getattr(omnileg, name)(leg, *arguments), 300)
    at_rest = omnileg.composite_mass_matrix(leg, parameters, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(at_rest, omnileg.mass_matrix(leg, (0.0, 0.0, 0.0)), rtol=0, atol=1e-14)


def test_foot_force_enters_as_foot_force_torque_does(random_leg, wide_states):
    q, v, a, g = wide_states
    force = tuple(np.random.default_rng(50).normal(scale=20.0, size=(3, 300)))
    parameters = omnileg.composite_parameters(random_leg)
    pushed = omnileg.composite_inverse_dynamics(random_leg, parameters, q, v, a, g, force)
    expected = omnileg.add(
        omnileg.inverse_dynamics(random_leg, q, v, a, g), omnileg.foot_force_torque(random_leg, q, force)
    )
    assert_same(pushed, expected, 300)
    free = omnileg.subtract(a, omnileg.foot_force_torque(random_leg, q, force))
    found = omnileg.composite_forward_dynamics(random_leg, parameters, q, v, a, g, force)
    assert_same(found, omnileg.forward_dynamics(random_leg, q, v, free, g), 300)


@pytest.mark.parametrize("transmission", TRANSMISSIONS)
def test_base_parameters_are_as_few_as_can_be(random_leg, transmission, wide_states):
    """Body by body, a torque is linear in mass, first and second moments: ten points on each body span them."""
    leg = dataclasses.replace(random_leg, transmission=transmission)
    names = BASE_PARAMETER_NAMES[transmission]
    base = coefficients(leg, wide_states)
    assert base.shape == (900, len(names))
    assert rank(base) == len(names) == (40 if transmission == "paper" else 44)

    rng = np.random.default_rng(10)
    none = ((0.0, 0.0, 0.0),) * 3
    columns = []
    for name in omnileg.BODY_NAMES:
        bodies = [omnileg.Body(name, 1.0, tuple(rng.uniform(-0.5, 0.5, 3).tolist()), none) for _ in range(10)]
        if (
            transmission == "paper" and name in CARDAN_PARTS
        ):  # its gamma' sees the tensor about the centre of mass alone
            factors = rng.normal(size=(6, 3, 3))
            tensors = [tuple(map(tuple, (factor @ factor.T).tolist())) for factor in factors]
            bodies += [omnileg.Body(name, 0.0, (0.0, 0.0, 0.0), tensor) for tensor in tensors]
        for body in bodies:
            alone = dataclasses.replace(leg, bodies=(body,), rotor_inertia=(0.0, 0.0, 0.0))
            columns.append(torques(alone, wide_states))
    rotors = np.array(wide_states[2]).T[:, :, None] * np.eye(3)
    full = np.column_stack([*columns, rotors.reshape(900, 3)])
    assert full.shape[1] == (271 if transmission == "paper" else 253)
    assert rank(full) == len(names)
    assert rank(np.column_stack([full, base])) == len(names)


@pytest.mark.parametrize("transmission", TRANSMISSIONS)
def test_regressor_times_base_parameters_is_the_torque(random_leg, transmission, wide_states):
    leg = dataclasses.replace(random_leg, transmission=transmission)
    pi = np.array(omnileg.base_parameters(leg))
    assert np.all(pi != 0.0)
    expected = torques(leg, wide_states)
    found = coefficients(leg, wide_states) @ pi
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    # Of the leg itself only the length L1 counts.
    other = dataclasses.replace(leg, bodies=(), rotor_inertia=(9.0, 9.0, 9.0), L3=1.0, L4=2.0, L5=3.0, R_C=4.0)
    np.testing.assert_array_equal(coefficients(other, wide_states), coefficients(leg, wide_states))


def documented_lagrangians(transmission, L1, q, v, g):
    """K - U of each parameter alone, as `CompositeParameters` states them, from rotations and their derivatives."""
    alpha, beta, gamma = casadi.vertsplit(q)
    va, vb, vg = casadi.vertsplit(v)
    theta = omnileg.passive_angles((alpha, beta, gamma))[0]
    a, b = omnileg.cardan_angles((alpha, beta, gamma))
    sin, cos = casadi.sin, casadi.cos

    def rotation(axis, angle):
        matrices = (algebra.rotation_x, algebra.rotation_y, algebra.rotation_z)
        return casadi.vertcat(*(casadi.horzcat(*row) for row in matrices["xyz".index(axis)](sin(angle), cos(angle))))

    def rate(value):
        return casadi.jtimes(value, q, v)

    def spin(matrix):
        hat = casadi.mtimes(matrix.T, casadi.reshape(rate(casadi.vec(matrix)), 3, 3))
        return hat[2, 1], hat[0, 2], hat[1, 0]

    def axes(matrix):
        return casadi.horzsplit(matrix)

    x, y, r = axes(casadi.mtimes(rotation("y", beta), rotation("x", theta)))
    z_1 = axes(rotation("y", beta))[2]
    _, y_2, z_2 = axes(rotation("x", alpha))
    x_2, W = casadi.cross(y_2, r), casadi.dot(r, z_2)
    x_in, y_in, _ = axes(rotation("z", gamma))
    R_cross = casadi.mtimes(rotation("z", gamma), rotation("y", a))
    R_shaft = casadi.mtimes(R_cross, rotation("x", b))
    w_c, w_s = spin(R_cross), spin(R_shaft)
    x_4, _, z_4 = axes(R_cross)
    y_4 = axes(R_shaft)[1]
    w_1 = spin(casadi.horzcat(x, y, r))
    e = (x[2], y[2], r[2])
    dr, dt = rate(r), rate(theta)
    dc, ds = rate(cos(gamma)), rate(sin(gamma))
    shank = {
        f"shank_{name}_{'xyz'[i]}": L1 * dr[i] * rate(function) + g[i] * function
        for name, function in (("cos", cos(gamma)), ("sin", sin(gamma)))
        for i in range(3)
    }
    pairs = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    both = {
        "inertia_alpha": va**2 / 2,
        "inertia_beta": vb**2 / 2,
        "inertia_gamma": vg**2 / 2,
        "transverse": casadi.sumsqr(dr) / 2,
        "spin_1": (r[1] * vb) ** 2 / 2,
        "spin_2": (r[0] * va) ** 2 / 2,
        "rods_1_xy": vb * dt * cos(theta),
        "rods_1_xz": -vb * dt * sin(theta),
        "rods_1_yz": -(vb**2) * sin(theta) * cos(theta),
        "crosses_1_carried": vb**2 * cos(theta),
        "rods_2_xy": va * dr[0],
        "rods_2_xz": va**2 * r[0] * W,
        "rods_2_yz": -va * rate(W),
        "crosses_2_carried": va**2 * W,
        "moment_r": casadi.dot(g, r),
        "moment_1_x": casadi.dot(g, x),
        "moment_1_y": casadi.dot(g, y),
        "moment_1_z": casadi.dot(g, z_1),
        "moment_2_x": casadi.dot(g, x_2),
        "moment_2_y": casadi.dot(g, y_2),
        "moment_2_z": casadi.dot(g, z_2),
        "shank_cos_cos": dc**2 / 2,
        "shank_cos_sin": dc * ds,
        "input_x": casadi.dot(g, x_in),
        "input_y": casadi.dot(g, y_in),
        **shank,
    }
    cardan = {
        "cardan_a": rate(a) ** 2 / 2,
        "cardan_c": (vg * cos(a)) ** 2 / 2,
        "cardan_spin": w_s[2] ** 2 / 2,
        **{f"cardan_cross_{pair}": w_c[i] * w_c[j] for pair, (i, j) in pairs.items()},
        **{f"cardan_shaft_{pair}": w_s[i] * w_s[j] for pair, (i, j) in pairs.items()},
        "cardan_cross_carried": casadi.dot(dr, rate(z_4)),
        "cardan_moment_x": casadi.dot(g, x_4),
        "cardan_moment_y": casadi.dot(g, y_4),
        "cardan_moment_z": casadi.dot(g, z_4),
    }
    paper = {
        "paper_shaft_x": -vg * dt * sin(beta),
        "paper_shaft_y": vg * vb * sin(theta) * r[2] + (vg * sin(theta) * cos(beta)) ** 2 / 2,
        "paper_beta": (vg * sin(beta)) ** 2 / 2,
        "paper_cross_xy": -vg * vb * sin(beta),
        "paper_cross_xz": -(vg**2) * sin(beta) * cos(beta),
        "paper_cross_yz": vg * vb * cos(beta),
        **{
            f"paper_shaft_{pair}": vg * (e[i] * w_1[j] + e[j] * w_1[i]) + vg**2 * e[i] * e[j]
            for pair, (i, j) in pairs.items()
        },
    }
    return both | (paper if transmission == "paper" else cardan)


@pytest.mark.parametrize("transmission", ["exact", "paper"])
def test_each_parameter_acts_as_documented(random_leg, transmission, states):
    leg = dataclasses.replace(random_leg, transmission=transmission)
    q, v, a, g = (casadi.SX.sym(name, 3) for name in "qvag")
    lagrangians = documented_lagrangians(transmission, leg.L1, q, v, g)
    names = BASE_PARAMETER_NAMES[transmission]
    assert set(lagrangians) == set(names)
    columns = []
    for name in names:
        momentum = casadi.gradient(lagrangians[name], v)
        force = casadi.jtimes(momentum, q, v) + casadi.jtimes(momentum, v, a) - casadi.gradient(lagrangians[name], q)
        columns.append(force)
    oracle = casadi.Function("oracle", [q, v, a, g], [casadi.horzcat(*columns)])
    gravity = (2.0, -3.0, 8.5)
    for sample in zip(*(array[:10].tolist() for array in states), strict=True):
        expected = oracle(*sample, gravity).full()
        found = np.array(omnileg.regressor(leg, *map(tuple, sample), gravity))
        scale = 1.0 + np.abs(expected).max(axis=0)
        np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=1e-12)


def test_names_and_units():
    assert set(BASE_PARAMETER_NAMES) == set(TRANSMISSIONS)
    assert set(BASE_PARAMETER_UNITS) == set(omnileg.CompositeParameters._fields)
    fixed = {"fixed_x", "fixed_y", "fixed_z"}
    assert set().union(*BASE_PARAMETER_NAMES.values()) == set(BASE_PARAMETER_UNITS) - fixed


def test_unit_of_a_parameter_is_how_it_scales(random_leg):
    """Lengths and centres of mass times 2, tensors about the centres of mass times 4."""

    def grown(body):
        tensor = tuple(tuple(4.0 * element for element in row) for row in body.inertia)
        return body._replace(com=tuple(2.0 * c for c in body.com), inertia=tensor)

    lengths = {name: 2.0 * getattr(random_leg, name) for name in ("L1", "L3", "L4", "L5", "R_C")}
    leg = dataclasses.replace(random_leg, rotor_inertia=(0.0, 0.0, 0.0))
    large = dataclasses.replace(leg, bodies=tuple(map(grown, leg.bodies)), **lengths)
    for transmission in TRANSMISSIONS:
        before, after = (
            omnileg.composite_parameters(dataclasses.replace(x, transmission=transmission)) for x in (leg, large)
        )
        for name, unit in BASE_PARAMETER_UNITS.items():
            power = {"kg·m": 2.0, "kg·m²": 4.0}[unit]
            assert getattr(after, name) == pytest.approx(power * getattr(before, name), rel=1e-11)


@pytest.mark.parametrize(
    ("transmission", "more"),
    [
        ("exact", {"cardan_a", "cardan_c", "cardan_spin"}),
        ("paper", {"paper_shaft_x", "paper_shaft_y", "paper_beta"}),
        ("none", set()),
    ],
)
def test_parameters_that_symmetry_cancels_are_exactly_zero(shipped_leg, golden_leg, transmission, more):
    for leg in (shipped_leg, golden_leg):
        parameters = omnileg.composite_parameters(dataclasses.replace(leg, transmission=transmission))
        present = {name for name in BASE_PARAMETER_NAMES[transmission] if getattr(parameters, name) != 0.0}
        assert present == AT_SHIPPED | more
        assert parameters.fixed_y == 0.0


def test_links_off_their_axes_cancel_around_the_circle(shipped_leg, random_leg):
    """Three equal chains at 0 and +-120 deg: what their first moments leave along X0 and Y0 is rounding."""

    def leaning(body):
        offset = (0.003, 0.007, 0.011) if body.name.startswith(("link", "driven")) else (0.0, 0.0, 0.0)
        return body._replace(com=tuple(c + o for c, o in zip(body.com, offset, strict=True)))

    leg = dataclasses.replace(shipped_leg, bodies=tuple(map(leaning, shipped_leg.bodies)))
    parameters = omnileg.composite_parameters(leg)
    assert [getattr(parameters, f"shank_{f}_{i}") for f in ("cos", "sin") for i in "xy"] == [0.0] * 4
    assert parameters.shank_sin_z == pytest.approx(3 * 0.007 * (0.03 + 0.04 - 0.04))
    # A small parameter is not rounding.
    light = [b._replace(com=(1e-9, *b.com[1:])) if b.name == "input_shaft" else b for b in leg.bodies]
    tiny = omnileg.composite_parameters(dataclasses.replace(leg, bodies=tuple(light)))
    assert tiny.input_x == pytest.approx(0.025e-9)


def instructions(outputs, inputs):
    """Arithmetic of a traced graph: all but constants, inputs and outputs; and its divisions and square roots."""
    graph = casadi.cse(casadi.vertcat(*outputs))
    function = casadi.Function("traced", [casadi.vertcat(*values) for values in inputs], [graph])
    kinds = [function.instruction_id(i) for i in range(function.n_instructions())]
    moves = (casadi.OP_CONST, casadi.OP_INPUT, casadi.OP_OUTPUT)
    return (
        sum(kind not in moves for kind in kinds),
        sum(kind in (casadi.OP_DIV, casadi.OP_INV) for kind in kinds),
        kinds.count(casadi.OP_SQRT),
    )


@pytest.mark.parametrize(
    ("transmission", "torque", "acceleration", "divisions"),
    [("exact", 185, 285, 2), ("paper", 160, 215, 1), ("none", 100, 160, 1)],
)
def test_zeros_of_the_shipped_leg_leave_little_arithmetic(
    shipped_leg, symbols, transmission, torque, acceleration, divisions
):
    leg = dataclasses.replace(shipped_leg, transmission=transmission)
    parameters = omnileg.composite_parameters(leg)
    q, v, a, g = symbols
    count, divided, roots = instructions(omnileg.composite_inverse_dynamics(leg, parameters, q, v, a, g), symbols)
    assert count <= torque
    assert (divided, roots) == (divisions, 1)
    count, divided, roots = instructions(omnileg.composite_forward_dynamics(leg, parameters, q, v, a, g), symbols)
    assert count <= acceleration
    assert (divided, roots) == (divisions + 1, 1)
    full, _, _ = instructions(omnileg.inverse_dynamics(leg, q, v, a, g), symbols)
    assert 8 * torque < full


@pytest.mark.parametrize("transmission", TRANSMISSIONS)
def test_parameters_masses_and_lengths_may_be_symbols(random_leg, symbols, transmission):
    leg = dataclasses.replace(random_leg, transmission=transmission)
    state = ((0.4, 0.3, 0.7), (1.0, -2.0, 0.5), (3.0, 1.0, -4.0), (1.0, 2.0, 9.81))
    expected = omnileg.inverse_dynamics(leg, *state)
    vectors = [casadi.vertcat(*values) for values in symbols]

    numbers = omnileg.composite_parameters(leg)
    fields = casadi.SX.sym("pi", len(numbers))
    parameters = omnileg.CompositeParameters(*casadi.vertsplit(fields))
    torque = casadi.vertcat(*omnileg.composite_inverse_dynamics(leg, parameters, *symbols))
    traced = casadi.Function("torque", [*vectors, fields], [torque])
    np.testing.assert_allclose(traced(*state, list(numbers)).full().ravel(), expected, rtol=1e-12)
    # Torques are linear in them, and do not depend on the fixed moments.
    assert not casadi.depends_on(casadi.jacobian(torque, fields), fields)
    assert not casadi.depends_on(torque, fields[-3:])

    lengths = {name: casadi.SX.sym(name) for name in ("L1", "L3", "L4", "L5", "R_C")}
    masses = [casadi.SX.sym(body.name) for body in leg.bodies]
    symbolic = dataclasses.replace(
        leg, bodies=tuple(b._replace(mass=m) for b, m in zip(leg.bodies, masses, strict=True)), **lengths
    )
    torque = casadi.vertcat(
        *omnileg.composite_inverse_dynamics(symbolic, omnileg.composite_parameters(symbolic), *symbols)
    )
    traced = casadi.Function("torque", [*vectors, *lengths.values(), *masses], [torque])
    values = [*(getattr(leg, name) for name in lengths), *(body.mass for body in leg.bodies)]
    np.testing.assert_allclose(traced(*state, *values).full().ravel(), expected, rtol=1e-12)


def test_parameters_of_many_legs_at_once(random_leg):
    """Arrays of lengths and masses: a design sweep."""
    L1 = np.array([0.12, 0.15, 0.19])
    knee = np.array([0.3, 0.5, 0.7])
    state = ((0.4, 0.3, 0.7), (1.0, -2.0, 0.5), (3.0, 1.0, -4.0), (1.0, 2.0, 9.81))

    def leg(length, mass):
        bodies = tuple(b._replace(mass=mass) if b.name == "knee" else b for b in random_leg.bodies)
        return dataclasses.replace(random_leg, L1=length, bodies=bodies)

    sweep = leg(L1, knee)
    found = stacked(omnileg.composite_inverse_dynamics(sweep, omnileg.composite_parameters(sweep), *state), 3)
    for i in range(3):
        expected = omnileg.inverse_dynamics(leg(float(L1[i]), float(knee[i])), *state)
        np.testing.assert_allclose(found[:, i], expected, rtol=1e-12)


def test_one_sample_on_floats_is_the_row_of_a_batch(shipped_leg, states):
    parameters = omnileg.composite_parameters(shipped_leg)
    q, v, a = (array[:5] for array in states)
    gravity = (0.0, 0.0, 9.81)
    batch = omnileg.composite_inverse_dynamics(shipped_leg, parameters, *(tuple(x.T) for x in (q, v, a)), gravity)
    for row in range(5):
        single = omnileg.composite_inverse_dynamics(
            shipped_leg, parameters, *(tuple(x[row].tolist()) for x in (q, v, a)), gravity
        )
        np.testing.assert_allclose(single, np.array(batch)[:, row], rtol=1e-12, atol=1e-14)
