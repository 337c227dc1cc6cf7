"""The hexapod leg's base parameters: forces are linear in them, and no parameter is superfluous."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET

import casadi
import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.closed_form import algebra
from leg_dynamics.closed_form import hexapod_leg as hexapod
from leg_dynamics.closed_form.hexapod_leg import BASE_PARAMETER_NAMES, BASE_PARAMETER_UNITS
from leg_dynamics.routes import with_text
from leg_dynamics.verification.perturbation import with_random_inertia

COUNT = 150
NAMES = BASE_PARAMETER_NAMES["exact"]
ABOUT_X = {"moment_alpha_y", "moment_alpha_z", "moment_alpha3_y", "moment_alpha3_z"}
BY_GRAVITY_ALONE = ABOUT_X | {f"moment_{i}_{axis}" for i in (1, 2, 3) for axis in "xz"}
NO_TENSOR = ((0.0, 0.0, 0.0),) * 3


def random_leg(seed, side, mode):
    """Every body with its own mass, off-centre COM and full tensor, and every joint with losses."""
    rng = np.random.default_rng(seed)
    bodies = []
    for name in hexapod.BODY_NAMES:
        factor = rng.normal(scale=0.1, size=(3, 3))
        tensor = np.trace(factor @ factor.T) * np.eye(3) - factor @ factor.T
        com = tuple(rng.uniform(-0.3, 0.3, 3).tolist())
        bodies.append(hexapod.Body(name, rng.uniform(0.3, 4.0), com, tuple(map(tuple, tensor.tolist()))))
    losses = tuple(hexapod.Dissipation(name, *rng.uniform(0.5, 3.0, 2)) for name in hexapod.TREE_JOINT_NAMES)
    a, b, c, e = rng.uniform([0.2, 0.04, 0.04, 0.35], [0.3, 0.1, 0.1, 0.45]).tolist()
    return hexapod.HexapodLeg(
        a=a,
        b=b,
        c=c,
        e=e,
        side=side,
        bodies=tuple(bodies),
        drive_mass=tuple(rng.uniform(0.5, 3.0, 3).tolist()),
        dissipation=losses,
        assembly_mode=mode,
    )


def states_of(leg, count=COUNT):
    """Return q, v, a, gravity, each a tuple of arrays, of feet all around the hip and away from singular ones."""
    rng = np.random.default_rng(8)
    feet = rng.normal(size=(3, 20 * count))
    feet *= rng.uniform(0.3, 1.5, 20 * count) / np.linalg.norm(feet, axis=0)
    found = hexapod.inverse_kinematics(leg, tuple(feet), leg.assembly_mode)
    margins = np.array(hexapod.singularity_margins(leg, found.q)).min(axis=0)
    q = np.array(found.q)[:, (found.margin > 0.0) & (margins > 0.05)][:, :count]
    assert q.shape == (3, count)
    return (tuple(q), *(tuple(rng.normal(scale=s, size=(3, count))) for s in (1.0, 3.0, 6.0)))


def array(nested, count=COUNT):
    if isinstance(nested, tuple):
        return np.array([array(part, count) for part in nested])
    return np.broadcast_to(nested, count)


def coefficients(leg, states):
    """Regressor of all states, rows (state, force)."""
    count = len(states[0][0])
    return array(hexapod.regressor(leg, *states), count).transpose(2, 0, 1).reshape(3 * count, -1)


def forces(leg, states):
    """Forces without losses, by the nine bodies."""
    lossless = dataclasses.replace(leg, dissipation=())
    return array(hexapod.inverse_dynamics(lossless, *states), len(states[0][0])).T.ravel()


def rank(columns):
    """Rank, with gaps that leave no choice of threshold; states count alike, however close to singular ones."""
    by_state = columns.reshape(-1, 3, columns.shape[1])
    columns = (by_state / np.abs(by_state).max(axis=(1, 2), keepdims=True)).reshape(columns.shape)
    sizes = np.linalg.norm(columns, axis=0) / np.linalg.norm(columns, axis=0).max()
    assert not ((sizes > 1e-12) & (sizes < 1e-4)).any()
    present = sizes > 1e-4
    values = np.linalg.svd(columns[:, present] / sizes[present], compute_uv=False)
    values /= values[0]
    assert not ((values > 1e-11) & (values < 1e-7)).any()
    return int((values > 1e-7).sum())


@pytest.fixture(scope="module", params=zip((1.0, -1.0, -1.0, 1.0), hexapod.ASSEMBLY_MODES, strict=True), ids=str)
def leg(request):
    side, mode = request.param
    return random_leg(11 + hexapod.ASSEMBLY_MODES.index(mode), side, mode)


def test_regressor_times_base_parameters_is_the_force(leg):
    states = states_of(leg)
    pi = np.array(hexapod.base_parameters(leg))
    assert pi.shape == (39,)
    assert (pi != 0.0).all()
    expected = forces(leg, states).reshape(COUNT, 3)
    found = (coefficients(leg, states) @ pi).reshape(COUNT, 3)
    error = np.abs(found - expected).max(axis=1) / np.abs(expected).max(axis=1)
    assert error.max() < 1e-12
    # Of the leg only lengths, side and assembly mode count.
    other = dataclasses.replace(leg, bodies=(), drive_mass=(9.0, 9.0, 9.0), dissipation=())
    np.testing.assert_array_equal(coefficients(other, states), coefficients(leg, states))


def test_base_parameters_are_as_few_as_can_be(leg):
    """Body by body, a force is linear in mass, first and second moments: ten points on each body span them."""
    states = states_of(leg)
    base = coefficients(leg, states)
    assert base.shape == (3 * COUNT, 39)
    assert rank(base) == 39
    rng = np.random.default_rng(10)
    columns = []
    for name in hexapod.BODY_NAMES:
        for _ in range(10):
            point = hexapod.Body(name, 1.0, tuple(rng.uniform(-0.5, 0.5, 3).tolist()), NO_TENSOR)
            alone = dataclasses.replace(leg, bodies=(point,), drive_mass=(0.0, 0.0, 0.0))
            columns.append(forces(alone, states))
    drives = (np.array(states[2]).T[:, :, None] * np.eye(3)).reshape(3 * COUNT, 3)
    full = np.column_stack([*columns, drives])
    assert full.shape[1] == 93
    assert rank(full) == 39
    assert rank(np.column_stack([full, base])) == 39


# The independent oracle: changes of one number of one link in a file that the numeric route reads.


def changed(text, link, number):
    """The text with all ten inertial numbers of a link known, and one of them, mass, first or second moment, greater.

    Tensors are about the link's origin.
    """
    robot = ET.fromstring(text)
    values = np.array([2.0, 0.1, -0.06, 0.14, 0.9, 0.8, 0.7, 0.05, -0.04, 0.06])
    if number is not None:
        values[number] += (0.6, *[0.15] * 9)[number]
    mass, first = values[0], values[1:4]
    com = first / mass
    xx, yy, zz, xy, xz, yz = values[4:]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    tensor -= mass * (com @ com * np.eye(3) - np.outer(com, com))
    inertial = next(each for each in robot.iter("link") if each.get("name") == link).find("inertial")
    for child in list(inertial):
        inertial.remove(child)
    ET.SubElement(inertial, "origin", xyz=" ".join(map(repr, com.tolist())), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(float(mass)))
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(inertial, "inertia", {key: repr(float(tensor[index])) for key, index in entries.items()})
    return ET.tostring(robot, encoding="unicode")


def with_drive(text, joint, mass):
    robot = ET.fromstring(text)
    transmission = next(t for t in robot.iter("transmission") if t.find("joint").get("name") == joint)
    transmission.find("actuator/mechanicalReduction").text = "2"
    transmission.find("actuator/rotorInertia").text = repr(0.25 * mass)
    return ET.tostring(robot, encoding="unicode")


def states_below(leg, count):
    """States whose struts point down, within 50 deg."""
    rng = np.random.default_rng(21)
    alpha, beta, l1 = rng.uniform([-0.9, -0.9, 0.45], [0.9, 0.9, 1.1], (count, 3)).T
    feet = (l1 * np.sin(beta), -l1 * np.sin(alpha) * np.cos(beta), l1 * np.cos(alpha) * np.cos(beta))
    q = hexapod.inverse_kinematics(leg, feet).q
    assert min(map(np.min, hexapod.singularity_margins(leg, q))) > 0.05
    return (q, *(tuple(rng.normal(scale=s, size=(3, count))) for s in (1.0, 3.0, 6.0)))


@pytest.fixture(scope="module")
def numeric():
    """A left leg of other lengths than the shipped one, by the numeric route."""
    return ld.load("hexapod_leg", "pinocchio", parameters={"side": -1, "a": 0.23, "b": 0.09, "c": 0.07, "e": 0.41})


def test_rank_is_that_of_differences_of_the_numeric_route(numeric):
    count = 45
    numbers = hexapod.from_urdf(numeric.description)
    states = states_below(numbers, count)

    def numeric_forces(text):
        rows = [np.array(part).T for part in states]
        return with_text(numeric, text).torque(*rows[:3], gravity=rows[3]).ravel()

    text = numeric.description.urdf
    columns = []
    for link in hexapod.BODY_NAMES:
        before = numeric_forces(changed(text, link, None))
        columns += [numeric_forces(changed(text, link, number)) - before for number in range(10)]
    before = numeric_forces(text)
    columns += [numeric_forces(with_drive(text, joint, 3.0)) - before for joint in hexapod.JOINT_NAMES]
    full, base = np.column_stack(columns), coefficients(numbers, states)
    assert full.shape == (3 * count, 93)
    assert rank(full) == rank(base) == rank(np.column_stack([full, base])) == 39 == len(NAMES)


@pytest.mark.parametrize("seed", [1, 2])
def test_regressor_gives_the_numeric_routes_forces_of_random_bodies(numeric, seed):
    text = with_drive(with_random_inertia(numeric.description, seed, radius=0.1), "l2", 1.7)
    other = with_text(numeric, text)
    numbers = hexapod.from_urdf(other.description)
    states = states_below(numbers, 60)
    rows = [np.array(part).T for part in states]
    expected = other.torque(*rows[:3], gravity=rows[3])
    found = (coefficients(numbers, states) @ np.array(hexapod.base_parameters(numbers))).reshape(60, 3)
    assert (np.abs(found - expected).max(axis=1) / np.abs(expected).max(axis=1)).max() < 1e-12


# Gravity and geometry that hide parameters, as the docstring of the regressor says


@pytest.mark.parametrize(
    ("gravity", "absent"),
    [
        ((0.0, 0.0, 9.81), set()),
        ((0.0, 9.81, 0.0), set()),
        ((9.81, 0.0, 0.0), ABOUT_X),
        ((0.0, 0.0, 0.0), BY_GRAVITY_ALONE),
    ],
)
def test_columns_that_vanish_in_one_direction_of_gravity(leg, gravity, absent):
    q, v, a, _ = states_of(leg)
    found = coefficients(leg, (q, v, a, tuple(np.full(COUNT, g) for g in gravity)))
    assert {name for name, column in zip(NAMES, found.T, strict=True) if (column == 0.0).all()} == absent
    assert rank(found) == 39 - len(absent)


def test_strut_2_turns_half_as_fast_where_its_hinge_is_as_far_as_its_u_joint():
    leg = dataclasses.replace(random_leg(3, 1.0, hexapod.ASSEMBLY_MODES[0]), a=0.2, b=0.12, e=0.16)
    states = states_of(leg)
    found = coefficients(leg, states)
    first, second = (found[:, NAMES.index(name)] for name in ("inertia_1", "inertia_2"))
    np.testing.assert_allclose(second, 0.25 * first, atol=1e-12 * np.abs(first).max())
    assert rank(found) == 38


# Each parameter is what its docstring says


def documented_lagrangians(leg, q, v, g):
    """K - U of each parameter alone, as `BaseParameters` states them, from the loops' angles and their derivatives."""
    tree = hexapod.tree_coordinates(leg, tuple(casadi.vertsplit(q)))

    def rate(value):
        return casadi.jtimes(value, q, v)

    def rotation(matrix, angle):
        return casadi.vertcat(*(casadi.horzcat(*row) for row in matrix(casadi.sin(angle), casadi.cos(angle))))

    found = {}
    for i, about in ((1, "alpha"), (2, None), (3, "alpha3")):
        alpha, beta, length = (tree[f"{name}{i}"] for name in ("alpha", "beta", "l"))
        sine, cosine = casadi.sin(beta), casadi.cos(beta)
        va, vb, vl = map(rate, (alpha, beta, length))
        cross = rotation(algebra.rotation_x, alpha)
        _, y, z = casadi.horzsplit(cross)
        u, _, w = casadi.horzsplit(casadi.mtimes(cross, rotation(algebra.rotation_y, beta)))
        if about is not None:
            found |= {f"inertia_{about}": va**2 / 2, f"moment_{about}_y": casadi.dot(g, y)}
            found |= {f"moment_{about}_z": casadi.dot(g, z)}
        found |= {
            f"difference_{i}": (va * cosine) ** 2 / 2,
            f"inertia_{i}": vb**2 / 2,
            f"product_{i}_xy": va * vb * cosine,
            f"product_{i}_xz": va**2 * sine * cosine,
            f"product_{i}_yz": va * vb * sine,
            f"moment_{i}_x": casadi.dot(g, u),
            f"moment_{i}_z": casadi.dot(g, w),
            f"rod_moment_{i}_x": -(va**2 * length * sine * cosine + vb * vl),
            f"rod_moment_{i}_y": va * rate(length * cosine),
            f"rod_moment_{i}_z": length * ((va * cosine) ** 2 + vb**2),
            f"rod_mass_{i}": casadi.sumsqr(rate(length * w)) / 2 + casadi.dot(g, w) * length,
            f"drive_mass_{i}": vl**2 / 2,
        }
    superfluous = {"rod_moment_2_y", "rod_mass_2", "rod_mass_3"}
    assert set(found) == set(NAMES) | superfluous
    return casadi.vertcat(*(found[name] for name in NAMES))


def test_each_column_follows_from_the_energies_that_the_parameter_documents(leg):
    q, v, a, g = (casadi.SX.sym(name, 3) for name in "qvag")
    lagrangians = documented_lagrangians(leg, q, v, g)
    columns = []
    for lagrangian in casadi.vertsplit(lagrangians):
        momentum = casadi.gradient(lagrangian, v)
        change = casadi.jtimes(momentum, q, v) + casadi.jtimes(momentum, v, a)
        columns.append(change - casadi.gradient(lagrangian, q))
    traced = casadi.Function("documented", [q, v, a, g], [casadi.horzcat(*columns)])
    states = states_of(leg)
    expected = traced.map(COUNT)(*(np.array(part) for part in states)).full()
    expected = expected.reshape(3, COUNT, 39).transpose(1, 0, 2).reshape(3 * COUNT, 39)
    found = coefficients(leg, states)
    assert (np.abs(found - expected).max(axis=0) < 1e-11 * np.abs(expected).max(axis=0)).all()


def test_names_and_units():
    assert len(NAMES) == 39
    assert set(BASE_PARAMETER_UNITS) == set(NAMES)
    units = {unit: sum(each == unit for each in BASE_PARAMETER_UNITS.values()) for unit in ("kg", "kg·m", "kg·m²")}
    assert units == {"kg": 4, "kg·m": 18, "kg·m²": 17}


# Floats, symbols, kernels


def test_floats_arrays_and_symbols_agree(leg):
    states = states_of(leg)
    symbols = [casadi.SX.sym(name, 3) for name in "qvag"]
    outputs = hexapod.regressor(leg, *(tuple(casadi.vertsplit(symbol)) for symbol in symbols))
    traced = casadi.Function("regressor", symbols, [casadi.vertcat(*(casadi.horzcat(*row) for row in outputs))])
    on_arrays = array(hexapod.regressor(leg, *states))
    size = np.abs(on_arrays).max(axis=(0, 1))
    for k in range(0, COUNT, 20):
        sample = [tuple(float(part[k]) for part in vector) for vector in states]
        on_floats = np.array(hexapod.regressor(leg, *sample))
        assert np.abs(on_floats - on_arrays[..., k]).max() < 1e-13 * size[k]
        assert np.abs(traced(*sample).full() - on_arrays[..., k]).max() < 1e-13 * size[k]


def test_parameters_may_be_symbols():
    leg = random_leg(4, -1.0, hexapod.ASSEMBLY_MODES[0])
    mass, b, drive = casadi.SX.sym("mass"), casadi.SX.sym("b"), casadi.SX.sym("drive")
    bodies = tuple(body._replace(mass=mass) if body.name == "rod_2" else body for body in leg.bodies)
    opened = dataclasses.replace(leg, bodies=bodies, b=b, drive_mass=(1.0, 2.0, drive))
    traced = casadi.Function("base", [mass, b, drive], [casadi.vertcat(*hexapod.base_parameters(opened))])
    bodies = tuple(body._replace(mass=0.8) if body.name == "rod_2" else body for body in leg.bodies)
    expected = hexapod.base_parameters(dataclasses.replace(leg, bodies=bodies, b=0.05, drive_mass=(1.0, 2.0, 0.4)))
    np.testing.assert_allclose(traced(0.8, 0.05, 0.4).full().ravel(), expected, rtol=1e-13)


@pytest.mark.parametrize("name", ["hexapod_leg", "hexapod_leg_preliminary"])
def test_the_interface_offers_the_regressor(name):
    leg = ld.load(name)
    numbers = leg.backend.numbers
    parameters = leg.base_parameters
    assert tuple(parameters) == NAMES
    assert {key: parameter.unit for key, parameter in parameters.items()} == dict(BASE_PARAMETER_UNITS)
    pi = np.array([parameter.value for parameter in parameters.values()])
    np.testing.assert_array_equal(pi, hexapod.base_parameters(numbers))
    states = states_of(numbers)
    q, v, a, gravity = (np.array(part).T for part in states)
    Y = leg.regressor(q, v, a, gravity)
    assert Y.shape == (COUNT, 3, 39)
    stacked = coefficients(numbers, states)
    assert (np.abs(Y.reshape(-1, 39) - stacked).max(axis=0) < 1e-12 * np.abs(stacked).max(axis=0)).all()
    np.testing.assert_array_equal(leg.regressor(q[7], v[7], a[7], gravity[7]), Y[7])
    for given in (gravity, None):
        torque = leg.torque(q, v, a, gravity=given)
        error = np.abs(leg.regressor(q, v, a, given) @ pi - torque).max(axis=1)
        assert (error / np.abs(torque).max(axis=1)).max() < 1e-12
    with pytest.raises(ld.errors.AssemblyError):
        leg.regressor((0.7, 3.0, 0.7), v[0], a[0])
