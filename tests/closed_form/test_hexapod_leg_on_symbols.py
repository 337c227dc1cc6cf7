"""The trap test of this leg: a formula traced by CasADi, run on arrays and run on floats must be the same formula."""

from __future__ import annotations

import dataclasses
import inspect

import casadi
import numpy as np
import pytest

from leg_dynamics.closed_form import hexapod_leg as hexapod
from leg_dynamics.description import read

COUNT = 1000
SCALARS = ("alpha", "beta", "h", "limit")
NOT_A_FORMULA_OF_A_LEG = {
    *("from_urdf", "mean_condition_number", "hip_points", "body_motions"),
    *("composite_parameters", "base_parameters", "in_branch"),
}
FORMULAS = sorted(
    name
    for name in hexapod.__all__
    if inspect.isfunction(getattr(hexapod, name)) and name not in NOT_A_FORMULA_OF_A_LEG
)


def names_of(function):
    parameters = inspect.signature(function).parameters
    return tuple(name for name in parameters if name not in ("leg", "parameters", "branch"))


def call(name, leg, arguments):
    function = getattr(hexapod, name)
    wanted = inspect.signature(function).parameters
    leading = (leg,) if "leg" in wanted else ()
    if "parameters" in wanted:
        leading = (leg, hexapod.composite_parameters(leg))
    found = function(*leading, *arguments)
    return (*found, found.margin) if name == "inverse_kinematics" else found


def flat(nested):
    if isinstance(nested, dict):
        nested = tuple(nested.values())
    return [leaf for part in nested for leaf in flat(part)] if isinstance(nested, tuple) else [nested]


@pytest.fixture(scope="module")
def leg():
    leg = hexapod.from_urdf(read("hexapod_leg"))
    rng = np.random.default_rng(6)
    bodies = []
    for body in leg.bodies:
        factor = rng.normal(scale=0.1, size=(3, 3))
        tensor = np.trace(factor @ factor.T) * np.eye(3) - factor @ factor.T
        com = tuple(rng.uniform(-0.2, 0.2, 3).tolist())
        bodies.append(body._replace(com=com, inertia=tuple(map(tuple, tensor.tolist()))))
    losses = (hexapod.Dissipation("l2", 3.0, 4.0), hexapod.Dissipation("beta3", 0.2, 0.3))
    return dataclasses.replace(leg, bodies=tuple(bodies), dissipation=losses, side=-1.0, drive_mass=(1.0, 2.0, 3.0))


def drawn(name, leg, rng):
    if name in ("q", "p"):
        alpha, beta, l1 = rng.uniform([-1.0, -1.0, 0.5], [1.0, 1.0, 0.9], (COUNT, 3)).T
        p = (l1 * np.sin(beta), -l1 * np.sin(alpha) * np.cos(beta), l1 * np.cos(alpha) * np.cos(beta))
        return np.stack(p if name == "p" else hexapod.inverse_kinematics(leg, p).q)
    return rng.normal(scale=0.5, size=(1 if name in SCALARS else 3, COUNT))


def matrix_arguments(name):
    return name in ("singular_values", "condition_number")


@pytest.mark.parametrize("name", FORMULAS)
def test_traced_graph_arrays_and_floats_agree(leg, name):
    rng = np.random.default_rng(sum(map(ord, name)))
    wanted = names_of(getattr(hexapod, name))
    if matrix_arguments(name):
        values = [rng.normal(size=(9, COUNT))]
    else:
        values = [drawn(argument, leg, rng) for argument in wanted]
    symbols = [casadi.SX.sym(f"x{k}", len(value)) for k, value in enumerate(values)]

    def shaped(arrays):
        found = []
        for argument, components in zip(wanted, arrays, strict=True):
            parts = tuple(components[i] for i in range(len(values[len(found)])))
            if matrix_arguments(name):
                found.append((parts[:3], parts[3:6], parts[6:]))
            else:
                found.append(parts[0] if argument in SCALARS else parts)
        return found

    outputs = flat(call(name, leg, shaped(symbols)))
    graph = casadi.Function("graph", symbols, [casadi.vertcat(*outputs)])
    constants = [
        graph.instruction_constant(i)
        for i in range(graph.n_instructions())
        if graph.instruction_id(i) == casadi.OP_CONST
    ]
    assert np.isfinite(constants).all()

    on_arrays = np.array([np.broadcast_to(leaf, COUNT) for leaf in flat(call(name, leg, shaped(values)))])
    traced = graph.map(COUNT)(*values).full()
    scale = 1.0 + np.abs(on_arrays).max()
    np.testing.assert_allclose(on_arrays, traced, atol=1e-13 * scale, rtol=1e-10)
    for row in range(0, COUNT, 200):
        single = flat(call(name, leg, shaped([value[:, row].tolist() for value in values])))
        np.testing.assert_allclose(single, traced[:, row], atol=1e-13 * scale, rtol=1e-10)


def test_parameters_may_be_symbols_too(leg):
    lengths = {name: casadi.SX.sym(name) for name in ("a", "b", "c", "e", "side")}
    mass = casadi.SX.sym("m")
    bodies = tuple(b._replace(mass=mass) if b.name == "rod_1" else b for b in leg.bodies)
    open_leg = dataclasses.replace(leg, bodies=bodies, **lengths)
    symbols = [tuple(casadi.SX.sym(f"{n}{i}") for i in range(3)) for n in "qvag"]
    forces = hexapod.composite_inverse_dynamics(open_leg, hexapod.composite_parameters(open_leg), *symbols)
    inputs = [casadi.vertcat(*s) for s in symbols] + [*lengths.values(), mass]
    traced = casadi.Function("forces", inputs, [casadi.vertcat(*forces)])
    state = ((0.7, 0.45, 0.68), (0.3, -0.2, 0.1), (3.0, 1.0, -4.0), (0.5, 0.2, 9.81))
    numbers = [getattr(leg, name) for name in lengths]
    changed = dataclasses.replace(
        leg, bodies=tuple(b._replace(mass=2.5) if b.name == "rod_1" else b for b in leg.bodies)
    )
    expected = hexapod.inverse_dynamics(changed, *state)
    np.testing.assert_allclose(traced(*state, *numbers, 2.5).full().ravel(), expected, rtol=1e-12)


def test_every_formula_is_traced():
    functions = {name for name in hexapod.__all__ if inspect.isfunction(getattr(hexapod, name))}
    assert set(FORMULAS) | NOT_A_FORMULA_OF_A_LEG == functions
    assert len(FORMULAS) > 40
