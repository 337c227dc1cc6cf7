from __future__ import annotations

import dataclasses
import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest

from leg_dynamics.closed_form import omnileg

L1, L4 = 0.15, 0.095
GRAVITY = (0.0, 0.0, 9.81)


def diagonal(*entries):
    return tuple(tuple(entries[i] if i == j else 0.0 for j in range(3)) for i in range(3))


def cylinder(mass, length, outer, inner=0.0):
    across = mass * (3.0 * (outer**2 + inner**2) + length**2) / 12.0
    return diagonal(across, across, mass * (outer**2 + inner**2) / 2.0)


def box(mass, x, y, z):
    return diagonal(mass * (y * y + z * z) / 12.0, mass * (x * x + z * z) / 12.0, mass * (x * x + y * y) / 12.0)


def golden_body(name):
    """The bodies that section 5 of the audit states its golden torques for."""
    bevel = cylinder(0.030, 0.012, 0.012, 0.004)
    for start, body in {
        "cross": (0.025, (0.0, 0.0, 0.0), diagonal(1.2e-6, 2.25e-6, 2.25e-6)),
        "rod": (0.070, (0.0, 0.0, L1 / 2), cylinder(0.070, L1, 0.008, 0.006)),
        "driven_gear": (0.030, (0.012, 0.0, 0.0), diagonal(bevel[2][2], bevel[0][0], bevel[0][0])),
        "link": (0.040, (0.0, 0.0, L4 / 2), box(0.040, 0.006, 0.018, L4)),
        "shaft_A4B4": (0.059, (0.0, 0.0, L1 / 2), cylinder(0.059, L1, 0.004)),
        "input_shaft": (0.025, (0.0, 0.0, -0.02), cylinder(0.025, 0.04, 0.005)),
        "output_shaft": (0.105, (0.0, 0.0, 0.08), cylinder(0.105, 0.15, 0.006)),
        "knee": (0.70, (0.0, 0.0, 0.07), cylinder(0.70, 0.14, 0.10)),
        "foot": (0.22, (0.0, 0.0, 0.0), cylinder(0.22, 0.010, 0.06)),
    }.items():
        if name.startswith(start):
            return omnileg.Body(name, *body)
    raise AssertionError(name)


@pytest.fixture(scope="session")
def golden_leg():
    return omnileg.OmniLeg(
        L1=L1,
        L3=0.075,
        L4=L4,
        L5=0.16,
        R_C=0.05,
        psi=(0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0),
        bodies=tuple(golden_body(name) for name in omnileg.BODY_NAMES),
    )


@pytest.fixture(scope="session")
def random_leg(golden_leg):
    """Every body with its own mass, off-centre COM and full tensor; odd lengths and directions; rotors."""
    rng = np.random.default_rng(20250418)
    bodies = []
    for name in omnileg.BODY_NAMES:
        factor = rng.normal(scale=0.02, size=(3, 3))
        second_moment = factor @ factor.T
        tensor = 0.3 * (np.trace(second_moment) * np.eye(3) - second_moment)
        com = rng.uniform(-0.05, 0.05, 3).tolist()
        bodies.append(omnileg.Body(name, rng.uniform(0.02, 0.8), tuple(com), tuple(map(tuple, tensor.tolist()))))
    return dataclasses.replace(
        golden_leg,
        L1=0.17,
        L3=0.06,
        L4=0.11,
        L5=0.13,
        R_C=0.07,
        psi=(0.3, 2.2, -1.9),
        bodies=tuple(bodies),
        rotor_inertia=(1.1e-3, 2.3e-3, 0.7e-3),
    )


@pytest.fixture(scope="session")
def states():
    """40 random states in the box +-65, +-65, -45..85 deg: q, v, a, each (40, 3)."""
    rng = np.random.default_rng(7)
    lower, upper = np.radians([-65.0, -65.0, -45.0]), np.radians([65.0, 65.0, 85.0])
    return rng.uniform(lower, upper, (40, 3)), rng.normal(scale=3.0, size=(40, 3)), rng.normal(scale=9.0, size=(40, 3))


@pytest.fixture(scope="session")
def symbols():
    """CasADi symbols q, v, a, gravity as tuples of scalars."""
    casadi = pytest.importorskip("casadi")
    return tuple(tuple(casadi.SX.sym(f"{name}{i}") for i in range(3)) for name in ("q", "v", "a", "g"))


@pytest.fixture(scope="session")
def quadruped_lab():
    """Builders of quadruped legs."""
    spec = importlib.util.spec_from_file_location("quadruped_lab", Path(__file__).with_name("quadruped_lab.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
