"""The trap test of this leg: a formula traced by CasADi, run on arrays and run on floats must be the same formula."""

from __future__ import annotations

import dataclasses
import inspect

import casadi
import numpy as np
import pytest

from leg_dynamics.closed_form import quadruped_leg as quadruped

COUNT = 1000
SIZES = {"pose": 16}
SCALARS = ("angle_1", "angle_2", "t", "z", "length", "face", "foot")
NOT_A_FORMULA_OF_A_LEG = {"from_urdf", "body_motions", "composite_parameters", "base_parameters", "with_every_number"}
NOT_A_FORMULA_OF_A_LEG |= {"standard_transform"}
FORMULAS = sorted(
    name
    for name in quadruped.__all__
    if inspect.isfunction(getattr(quadruped, name)) and name not in NOT_A_FORMULA_OF_A_LEG
)
BRANCHED = {"inverse_kinematics": quadruped.BRANCHES, "inverse_kinematics_in_body": quadruped.BRANCHES}
SIGNED = {"theta1": (1.0, -1.0), "theta2": (1.0, -1.0)}
CASES = [(name, choice) for name in FORMULAS for choice in (BRANCHED | SIGNED).get(name, (None,))]


def names_of(function):
    parameters = inspect.signature(function).parameters
    return tuple(name for name in parameters if name not in ("leg", "parameters", "branch", "hip", "knee"))


def call(name, choice, leg, arguments):
    function = getattr(quadruped, name)
    wanted = inspect.signature(function).parameters
    leading = (leg,) if "leg" in wanted else ()
    if "parameters" in wanted:
        leading = (leg, quadruped.composite_parameters(leg))
    found = function(*leading, *arguments, *(() if choice is None else (choice,)))
    return (*found, found.margin, found.singular_margin) if name in BRANCHED else found


def flat(nested):
    if isinstance(nested, dict):
        nested = tuple(nested.values())
    return [leaf for part in nested for leaf in flat(part)] if isinstance(nested, tuple) else [nested]


@pytest.fixture(scope="module")
def leg(quadruped_lab):
    return quadruped_lab.random_leg()


def drawn(name, leg, rng):
    if name in ("p", "t", "z"):  # within the reach
        q = rng.uniform((-np.pi, -0.4, 0.2), (np.pi, 0.4, 0.6), (COUNT, 3)).T
        if name == "p":
            far = quadruped.foot_position(leg, tuple(q))
            near = rng.uniform(-0.3, 0.3, (3, COUNT))
            return np.where(np.arange(COUNT) % 2 == 0, far, near)
        return (0.5 * (leg.l2 + leg.l3) + 0.1 * abs(leg.l2 - leg.l3) * rng.uniform(-1, 1, (1, COUNT))) / np.sqrt(2.0)
    if name == "mount":
        return rng.normal(scale=0.01, size=(3, COUNT))
    size = 1 if name in SCALARS else SIZES.get(name, 3)
    return rng.normal(size=(size, COUNT))


@pytest.mark.parametrize(("name", "choice"), CASES)
def test_traced_graph_arrays_and_floats_agree(leg, name, choice):
    rng = np.random.default_rng(sum(map(ord, name)))
    wanted = names_of(getattr(quadruped, name))
    values = [drawn(argument, leg, rng) for argument in wanted]
    symbols = [casadi.SX.sym(f"x{k}", len(value)) for k, value in enumerate(values)]

    def shaped(arrays):
        found = []
        for argument, components in zip(wanted, arrays, strict=True):
            parts = tuple(components[i] for i in range(len(values[len(found)])))
            if argument == "pose":
                found.append((parts[:4], parts[4:8], parts[8:12], parts[12:]))
            else:
                found.append(parts[0] if argument in SCALARS else parts)
        return found

    outputs = flat(call(name, choice, leg, shaped(symbols)))
    graph = casadi.Function("graph", symbols, [casadi.vertcat(*outputs)])
    constants = [
        graph.instruction_constant(i)
        for i in range(graph.n_instructions())
        if graph.instruction_id(i) == casadi.OP_CONST
    ]
    assert np.isfinite(constants).all()

    on_arrays = np.array([np.broadcast_to(leaf, COUNT) for leaf in flat(call(name, choice, leg, shaped(values)))])
    traced = graph.map(COUNT)(*values).full()
    assert np.isfinite(traced).all(axis=0).sum() > 50
    scale = 1.0 + np.nanmax(np.abs(on_arrays))
    np.testing.assert_allclose(on_arrays, traced, atol=1e-13 * scale, rtol=1e-10)
    for row in range(0, COUNT, 200):
        single = flat(call(name, choice, leg, shaped([value[:, row].tolist() for value in values])))
        np.testing.assert_allclose(single, traced[:, row], atol=1e-13 * scale, rtol=1e-10)


def test_parameters_may_be_symbols_too(leg):
    lengths = {name: casadi.SX.sym(name) for name in ("l1", "l2", "l3")}
    mass = casadi.SX.sym("m")
    bodies = tuple(b._replace(mass=mass) if b.name == "link_3" else b for b in leg.bodies)
    open_leg = dataclasses.replace(leg, bodies=bodies, **lengths)
    symbols = [tuple(casadi.SX.sym(f"{n}{i}") for i in range(3)) for n in "qvag"]
    torques = quadruped.composite_inverse_dynamics(open_leg, quadruped.composite_parameters(open_leg), *symbols)
    inputs = [casadi.vertcat(*s) for s in symbols] + [*lengths.values(), mass]
    traced = casadi.Function("torques", inputs, [casadi.vertcat(*torques)])
    state = ((0.7, -0.45, 1.68), (0.3, -0.2, 0.1), (3.0, 1.0, -4.0), (0.5, 0.2, -9.81))
    changed = dataclasses.replace(
        leg, bodies=tuple(b._replace(mass=2.5) if b.name == "link_3" else b for b in leg.bodies), l2=0.3
    )
    expected = quadruped.inverse_dynamics(changed, *state)
    np.testing.assert_allclose(traced(*state, leg.l1, 0.3, leg.l3, 2.5).full().ravel(), expected, rtol=1e-12)


def test_every_formula_is_traced():
    functions = {name for name in quadruped.__all__ if inspect.isfunction(getattr(quadruped, name))}
    assert set(FORMULAS) | NOT_A_FORMULA_OF_A_LEG == functions
    assert len(FORMULAS) > 35
