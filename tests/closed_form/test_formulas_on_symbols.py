"""The trap test: a formula traced by CasADi, run on arrays and run on floats must be the same formula."""

from __future__ import annotations

import dataclasses
import inspect

import casadi
import numpy as np
import pytest

from leg_dynamics.closed_form import omnileg

COUNT = 1000
SIZES = {"q": 3, "v": 3, "a": 3, "p": 3, "force": 3, "torque": 3, "gravity": 3, "gamma": 1, "angles": 4}
ARGUMENTS = {
    "leg_length_change": ("gamma",),
    "foot_force": ("q", "v", "a", "torque", "gravity"),
    "foot_force_torque": ("q", "force"),
    "forward_dynamics": ("q", "v", "torque", "gravity"),
}
NOT_A_FORMULA_OF_A_LEG = {
    "branch_rotation",  # constants
    "joint_axis",
    "joint_point",
    "branch_screws",
    "zero_pose",
    "exponential",  # through branch_pose
    "product_of_exponentials",
    "centre_of_mass",  # through kinetic_energy and bias
    "from_urdf",
    "composite_parameters",  # through the formulas that use them
    "base_parameters",
    "with_every_number",
}
FORMULAS = sorted(
    name
    for name in omnileg.__all__
    if inspect.isfunction(getattr(omnileg, name)) and name not in NOT_A_FORMULA_OF_A_LEG
)


def names_of(function):
    parameters = inspect.signature(function).parameters
    return tuple(name for name in parameters if name not in ("leg", "parameters", "branch", "k"))


def call(name, leg, arguments):
    function = getattr(omnileg, name)
    wanted = inspect.signature(function).parameters
    leading = (leg,) if "leg" in wanted else ()
    if "parameters" in wanted:
        leading = (leg, omnileg.composite_parameters(leg))
    if name == "branch_pose":
        return function(leg, 2, *arguments)
    if name.startswith("inverse_kinematics"):
        found = function(leg, *arguments)
        return (*found, found.margin)
    return function(*leading, *arguments)


def flat(nested):
    if isinstance(nested, dict):
        nested = tuple(nested.values())
    return [leaf for part in nested for leaf in flat(part)] if isinstance(nested, tuple) else [nested]


def drawn(name, rng):
    lower, upper = np.radians([-65.0, -65.0, -45.0]), np.radians([65.0, 65.0, 85.0])
    if name == "q":
        return rng.uniform(lower, upper, (COUNT, 3))
    if name == "p":  # inside, outside horizontally, out of stretch
        return rng.uniform([-0.14, -0.14, 0.1], [0.14, 0.14, 0.6], (COUNT, 3))
    return rng.normal(scale=2.0, size=(COUNT, SIZES[name]))


@pytest.fixture(scope="module")
def lossy_leg(random_leg):
    losses = (omnileg.Dissipation("alpha", 0.02, 0.03), omnileg.Dissipation("cardan_B4_y", 0.01, 0.02))
    return dataclasses.replace(random_leg, dissipation=losses)


@pytest.mark.parametrize("name", FORMULAS)
def test_traced_graph_arrays_and_floats_agree(lossy_leg, name):
    rng = np.random.default_rng(sum(map(ord, name)))
    wanted = names_of(getattr(omnileg, name))
    values = [drawn(argument, rng) for argument in wanted]
    symbols = [tuple(casadi.SX.sym(f"{n}{i}") for i in range(SIZES[n])) for n in wanted]

    def shaped(components):
        return [c[0] if n == "gamma" else tuple(c) for n, c in zip(wanted, components, strict=True)]

    outputs = flat(call(name, lossy_leg, shaped(symbols)))
    graph = casadi.Function("graph", [casadi.vertcat(*s) for s in symbols], [casadi.vertcat(*outputs)])
    constants = [
        graph.instruction_constant(i)
        for i in range(graph.n_instructions())
        if graph.instruction_id(i) == casadi.OP_CONST
    ]
    assert np.isfinite(constants).all()

    arrays = flat(call(name, lossy_leg, shaped([value.T for value in values])))
    on_arrays = np.array([np.broadcast_to(leaf, COUNT) for leaf in arrays])
    traced = graph.map(COUNT)(*(value.T for value in values)).full()
    scale = 1.0 + np.nanmax(np.abs(on_arrays))
    np.testing.assert_allclose(on_arrays, traced, atol=1e-13 * scale, rtol=1e-11)
    for row in range(0, COUNT, 100):
        single = flat(call(name, lossy_leg, shaped([value[row].tolist() for value in values])))
        np.testing.assert_allclose(single, traced[:, row], atol=1e-13 * scale, rtol=1e-11)


def test_parameters_may_be_symbols_too(golden_leg, symbols):
    lengths = {name: casadi.SX.sym(name) for name in ("L1", "L3", "L4", "L5", "R_C")}
    mass = casadi.SX.sym("m")
    bodies = tuple(b._replace(mass=mass) if b.name == "knee" else b for b in golden_leg.bodies)
    leg = dataclasses.replace(golden_leg, bodies=bodies, **lengths)
    q, v, a, g = symbols
    torque = casadi.vertcat(*omnileg.inverse_dynamics(leg, q, v, a, g))
    inputs = [casadi.vertcat(*s) for s in symbols] + [*lengths.values(), mass]
    traced = casadi.Function("torque", inputs, [torque])
    state = ((0.4, 0.3, 0.7), (1.0, -2.0, 0.5), (3.0, 1.0, -4.0), (0.0, 0.0, 9.81))
    numbers = [getattr(golden_leg, name) for name in lengths]
    found = traced(*state, *numbers, 0.7).full().ravel()
    np.testing.assert_allclose(found, omnileg.inverse_dynamics(golden_leg, *state), rtol=1e-13)


def test_every_formula_is_traced():
    assert set(FORMULAS) | NOT_A_FORMULA_OF_A_LEG == {
        name for name in omnileg.__all__ if inspect.isfunction(getattr(omnileg, name))
    }
    assert len(FORMULAS) > 25
