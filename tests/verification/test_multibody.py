from __future__ import annotations

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.errors import AssemblyError, ShapeError, UnsupportedError
from leg_dynamics.verification.multibody import Multibody, Solver

pytest.importorskip("mujoco", reason="the optional extra mujoco is not installed")

AMPLITUDE, RATE = np.array([0.5, -0.4, 0.6]), 2.0


def swing(t):
    return AMPLITUDE * np.sin(RATE * t), AMPLITUDE * RATE * np.cos(RATE * t), -AMPLITUDE * RATE**2 * np.sin(RATE * t)


@pytest.fixture(scope="module")
def leg():
    return ld.load(
        "omnileg", route="pinocchio", parameters={"M1_rotor_inertia": 1e-4, "M1_gear_ratio": 6, "beta_damping": 0.2}
    )


def closed(leg, q):
    return {name: float(value) for name, value in leg.assemble(q).items()}


def drive(leg, solver, duration=0.1, force=None):
    return Multibody(leg.description, solver=solver).drive(
        swing, closed(leg, swing(-0.02)[0]), duration, force, lead=0.02
    )


def theory(leg, run, force=None):
    q, v, a = (np.array(x) for x in zip(*map(swing, run.time), strict=True))
    forces = None if force is None else np.array([force(t) for t in run.time])
    return q, leg.generalized_force(q, v, a, foot_force=forces)


def test_terms_give_the_torques_and_mass_matrix_of_the_numeric_route(leg):
    bodies = Multibody(leg.description)
    rng = np.random.default_rng(3)
    for _ in range(20):
        q = rng.uniform(np.radians([-60, -60, -20]), np.radians([60, 60, 80]))
        v, a, force = rng.normal(scale=2.0, size=3), rng.normal(scale=5.0, size=3), rng.normal(scale=20.0, size=3)
        found = bodies.inverse_dynamics(closed(leg, q), v, a, force)
        np.testing.assert_allclose(found.force, leg.generalized_force(q, v, a, foot_force=force), atol=1e-10)
        np.testing.assert_allclose(found.mass_matrix, leg.mass_matrix(q), atol=1e-13)
        assert found.opening < 1e-12
        # Two points a hinge loop are six rows of which five count; gears add what is left.
        assert found.rank == 19
        np.testing.assert_allclose(bodies.foot_position(), leg.foot_position(q), atol=1e-13)


def test_open_loops_are_refused(leg):
    tree = closed(leg, np.array([0.2, 0.1, 0.5]))
    with pytest.raises(AssemblyError, match="open by"):
        Multibody(leg.description).set_state(tree | {"theta12": tree["theta12"] + 1e-3})


def test_driven_motors_are_where_they_should_be_and_the_torques_agree(leg):
    def force(t):
        return np.array([3.0, -20.0, 20.0])

    run = drive(leg, Solver(5e-4, 1e-3, compliance=1e-4), force=force)
    q, torque = theory(leg, run, force)
    assert len(run.time) == 201
    np.testing.assert_allclose(run.q, q, atol=1e-12)
    np.testing.assert_allclose(run.foot, leg.foot_position(q), atol=1e-6)
    np.testing.assert_allclose(run.force, torque, atol=2e-4 * np.abs(torque).max())
    v, a = (np.array([swing(t)[i] for t in run.time[1:-1]]) for i in (1, 2))
    np.testing.assert_allclose(run.foot_velocity, leg.foot_velocity(q[1:-1], v), atol=1e-5)
    np.testing.assert_allclose(run.foot_acceleration, leg.foot_acceleration(q[1:-1], v, a), atol=1e-3)
    assert run.opening < 1e-5


def test_a_smaller_step_and_harder_loops_bring_the_simulation_closer(leg):
    def error(solver):
        run = drive(leg, solver)
        return np.linalg.norm(run.foot - leg.foot_position(theory(leg, run)[0]), axis=1).max()

    soft, hard = error(Solver(1e-3, 2e-3, impedance=0.95)), error(Solver(1e-3, 2e-3, compliance=1e-4))
    fine = error(Solver(5e-4, 1e-3, compliance=1e-4))
    assert soft > 10.0 * hard
    # Second order in the step.
    assert 3.0 < hard / fine < 5.0


def test_friction_is_refused():
    rough = ld.load("omnileg", parameters={"gamma_friction": 0.1})
    with pytest.raises(UnsupportedError, match="Coulomb friction at gamma"):
        Multibody(rough.description)


def test_a_run_without_steps_is_refused(leg):
    with pytest.raises(ShapeError, match="shorter than two time steps"):
        drive(leg, Solver(1e-3), duration=1e-3)
