"""Exact derivatives, base parameters and the quick way through the interface, by the routes that are compiled."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.errors import AssemblyError, NonFiniteError, ParameterError, ShapeError, UnsupportedError
from leg_dynamics.verification.perturbation import with_random_inertia

GRAVITY = np.array([1.5, -2.0, 9.0])
PARAMETERS = ("L1", "knee_mass", "alpha_damping")


@pytest.fixture(scope="module", params=["closed_form", "symbolic"])
def leg(request):
    return ld.load("omnileg", request.param)


@pytest.fixture(scope="module")
def state():
    generator = np.random.default_rng(11)
    q = generator.uniform([-1.0, -1.0, -0.4], [1.0, 1.0, 1.4], (6, 3))
    q[0, 2] = 0.0
    v, a = generator.normal(size=(2, 6, 3)) * 3.0
    return q, v, a, generator.normal(size=(6, 3)) * 20.0


def difference(function, arguments, number, step=1e-6):
    """Central difference of a function by each component of one argument, columns last."""
    columns = []
    for unit in np.eye(arguments[number].shape[-1]):
        up, down = list(arguments), list(arguments)
        up[number], down[number] = up[number] + step * unit, down[number] - step * unit
        columns.append((function(*up) - function(*down)) / (2.0 * step))
    return np.stack(columns, axis=-1)


def close(found, expected, tolerance):
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * (1.0 + np.abs(expected).max()))


def test_torque_derivatives_are_those_of_differences(leg, state):
    q, v, a, force = state
    found = leg.torque_derivatives(q, v, a, force, GRAVITY)

    def torque(*motion):
        return leg.torque(*motion, force, GRAVITY)

    for number, derivative in enumerate((found.q, found.v, found.a)):
        close(derivative, difference(torque, [q, v, a], number), 1e-6)
    close(found.a, leg.mass_matrix(q), 1e-12)
    assert found.parameters.shape == (6, 3, 0)


def test_acceleration_derivatives_are_those_of_differences(leg, state):
    q, v, tau, force = state
    found = leg.acceleration_derivatives(q, v, tau, force, GRAVITY)

    def acceleration(*motion):
        return leg.acceleration(*motion, force, GRAVITY)

    for number, derivative in enumerate((found.q, found.v, found.tau)):
        close(derivative, difference(acceleration, [q, v, tau], number), 1e-6)
    close(found.tau, np.linalg.inv(leg.mass_matrix(q)), 1e-10)


def test_both_routes_give_the_same_derivatives(state):
    q, v, a, force = state
    text = with_random_inertia(ld.load("omnileg").description, seed=4)
    legs = [ld.load("omnileg", route, urdf=text) for route in ("closed_form", "symbolic")]
    for method in ("torque_derivatives", "acceleration_derivatives"):
        one, other = (getattr(each, method)(q, v, a, force, GRAVITY) for each in legs)
        for x, y in zip(one, other, strict=True):
            np.testing.assert_allclose(x, y, rtol=0, atol=1e-9 * (1.0 + np.abs(y).max(initial=0.0)))


def test_design_parameters_by_both_routes(state):
    q, v, a, force = state
    closed, symbolic = ld.load("omnileg"), ld.load("omnileg", "symbolic")
    for method in ("torque_derivatives", "acceleration_derivatives"):
        one = getattr(closed, method)(q, v, a, force, parameters=PARAMETERS).parameters
        other = getattr(symbolic, method)(q, v, a, force, parameters=PARAMETERS).parameters
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * (1.0 + np.abs(one).max()))
        assert one.shape == (6, 3, len(PARAMETERS))


@pytest.mark.parametrize(
    ("name", "step"), [("L1", 1e-6), ("L4", 1e-6), ("knee_mass", 1e-3), ("M3_rotor_inertia", 1e-3)]
)
def test_a_design_parameter_moves_all_that_its_source_computes(state, name, step):
    q, v, a, force = state
    leg = ld.load("omnileg")
    value = leg.parameters[name].value
    found = leg.torque_derivatives(q, v, a, force, parameters=[name]).parameters[..., 0]
    # where the parameter ends, one-sided: torque is linear in what it adds there
    down = value - step if value else value
    torques = [leg.replace(**{name: x}).torque(q, v, a, force) for x in (value + step, down)]
    expected = (torques[0] - torques[1]) / (value + step - down)
    close(found, expected, 1e-6)
    assert np.abs(expected).max() > 1e-3


def test_numbers_of_the_mechanism(leg, state):
    q, v, a, force = state
    assert leg.numbers["knee.mass"] == leg.parameters["knee_mass"].value
    by_number = leg.torque_derivatives(q, v, a, force, parameters=["knee.mass", "knee.com.z"]).parameters
    by_parameter = leg.torque_derivatives(q, v, a, force, parameters=["knee_mass"]).parameters
    # the knee's inertia follows its mass, but the knee never turns
    close(by_number[..., :1], by_parameter, 1e-9)
    assert not by_number[..., 1].any()


@pytest.mark.parametrize("parameters", [["L9"], ["knee.mas"], "L1", [3], ["nonsense", "L1"]])
def test_unknown_parameters(leg, state, parameters):
    q, v, a, _ = state
    with pytest.raises(ParameterError, match=r"L9|knee|'L1'|3|nonsense"):
        leg.torque_derivatives(q, v, a, parameters=parameters)


def test_bad_arguments_of_derivatives(leg, state):
    q, v, a, _ = state
    with pytest.raises(ShapeError):
        leg.torque_derivatives(q[:, :2], v, a)
    q = q.copy()
    q[2, 1] = np.nan
    with pytest.raises(NonFiniteError) as caught:
        leg.torque_derivatives(q, v, a)
    assert caught.value.rows.tolist() == [2]
    found = leg.torque_derivatives(q, v, a, on_error="nan")
    assert np.isnan(found.q[2]).all()
    assert np.isfinite(np.delete(found.q, 2, axis=0)).all()


def test_the_numeric_route_has_no_derivatives(state):
    q, v, a, _ = state
    leg = ld.load("omnileg", "pinocchio")
    with pytest.raises(UnsupportedError, match="torque_derivatives"):
        leg.torque_derivatives(q, v, a)
    with pytest.raises(UnsupportedError, match="regressor"):
        leg.regressor(q, v, a)


@pytest.mark.parametrize("transmission", ["exact", "paper", "none"])
def test_torque_is_the_regressor_times_the_base_parameters(state, transmission):
    q, v, a, _ = state
    leg = ld.load("omnileg", transmission=transmission)
    values = np.array([parameter.value for parameter in leg.base_parameters.values()])
    for gravity in (None, GRAVITY):
        Y = leg.regressor(q, v, a, gravity)
        assert Y.shape == (6, 3, len(values))
        close(Y @ values, leg.torque(q, v, a, gravity=gravity), 1e-13)
    generator = np.random.default_rng(1)
    many = generator.uniform(-0.9, 0.9, (3, 200, 3))
    stacked = leg.regressor(*many, generator.normal(size=(200, 3))).reshape(600, -1)
    scaled = stacked / np.linalg.norm(stacked, axis=0)
    assert np.linalg.matrix_rank(scaled, tol=1e-9) == len(values)
    assert {parameter.unit for parameter in leg.base_parameters.values()} == {"kg·m", "kg·m²"}


# The quick way: kernels called without the interface's checks.


def test_the_quick_way_is_the_careful_way(leg, state):
    q, v, a, force = state
    leg.torque(q, v, a)
    np.testing.assert_array_equal(leg.torque(q, v, a), leg.torque(q.tolist(), v.tolist(), a.tolist()))
    np.testing.assert_array_equal(leg.torque(q[1], v[1], a[1]), leg.torque(q, v, a)[1])
    loaded = leg.torque(q, v, a, force, GRAVITY)
    np.testing.assert_array_equal(loaded, leg.torque(q, v, a, force.tolist(), GRAVITY))
    close(leg.torque(q, v, a, np.zeros(3), leg.gravity), leg.torque(q, v, a), 1e-13)


@pytest.mark.parametrize("method", ["torque", "mass_matrix", "jacobian", "foot_position", "acceleration", "bias"])
def test_the_quick_way_notices_what_is_wrong(leg, state, method):
    arguments = {"torque": 3, "acceleration": 3, "bias": 2}.get(method, 1)
    good = [each.copy() for each in state[:arguments]]
    call = getattr(leg, method)
    call(*good)
    call(*good)
    bad = [each.copy() for each in good]
    bad[-1][4, 0] = np.inf
    with pytest.raises(NonFiniteError) as caught:
        call(*bad)
    assert caught.value.rows.tolist() == [4]
    with pytest.raises(ShapeError):
        call(*(each[:, :2] for each in good))
    with pytest.raises(ShapeError):
        call(*(each.astype(complex) for each in good))


def test_a_failing_row_of_another_thread_is_not_mine(leg, state):
    q, v, a, _ = state
    expected = leg.torque(q, v, a)
    bad = v.copy()
    bad[0] = np.nan
    stop = threading.Event()

    def spoil():
        while not stop.is_set():
            leg.torque(q, bad, a, on_error="nan")

    spoiler = threading.Thread(target=spoil)
    spoiler.start()
    try:
        for _ in range(300):
            np.testing.assert_array_equal(leg.torque(q, v, a), expected)
            with pytest.raises(NonFiniteError):
                leg.torque(q, bad, a)
    finally:
        stop.set()
        spoiler.join()


@pytest.mark.parametrize("threads", [0, -1, 1.5, "2", True])
def test_threads_is_a_whole_number(threads):
    with pytest.raises(ParameterError, match="threads"):
        ld.load("omnileg", threads=threads)


@pytest.mark.parametrize("route", ["closed_form", "symbolic"])
def test_threads_do_not_change_a_bit(route):
    generator = np.random.default_rng(0)
    q, v, a = generator.uniform(-0.8, 0.8, (3, 100_001, 3))
    one, two = (ld.load("omnileg", route, threads=threads).torque(q, v, a) for threads in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_threads_may_be_a_numpy_integer():
    assert ld.load("omnileg", threads=np.int64(2)).torque([0.1] * 3, [0.0] * 3, [0.0] * 3).shape == (3,)


@pytest.mark.parametrize("parameters", [None, 5, "L1"])
def test_parameters_is_a_sequence_of_names(parameters):
    leg = ld.load("omnileg")
    with pytest.raises(ParameterError, match="parameters is a sequence of names, got"):
        leg.torque_derivatives([0.1] * 3, [0.0] * 3, [0.0] * 3, parameters=parameters)


def test_rows_without_derivatives_say_that_values_exist():
    leg = ld.load("omnileg", "symbolic")
    q, zero = np.array([1.52501462, 1.53970395, 0.07662781]), np.zeros(3)
    assert np.isfinite(leg.torque(q, zero, zero)).all()
    with pytest.raises(AssemblyError, match="the values may exist by route='pinocchio'"):
        leg.torque_derivatives(q, zero, zero)
