"""Each identity fails for the error it is there for, and says so by name."""

from __future__ import annotations

import numpy as np
import pytest

from leg_dynamics.description import parse
from leg_dynamics.errors import OutOfReachError
from leg_dynamics.routes import load
from leg_dynamics.verification.first_principles import against_first_principles, gradient, loop_residual, slope
from leg_dynamics.verification.states import domain, sample_states

ALL = {
    "loops and couplings close",
    "foot position against the tree",
    "J against differences",
    "Jdot against differences",
    "foot acceleration = J a + Jdot v",
    "foot position of inverse kinematics",
    "mass matrix symmetric",
    "mass matrix positive",
    "gravity against potential",
    "Coriolis force = C v",
    "Mdot - 2C skew",
    "generalized force = M a + h - J'F",
    "acceleration of torque",
    "power balance",
    "foot force of torque",
}


def failing(leg, states):
    checks = against_first_principles(leg, states)
    assert {each.quantity for each in checks} == ALL
    return {each.quantity for each in checks if not each.passed}


def test_differences_are_of_fourth_order():
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 3))

    def function(q):
        return np.stack([np.sin(q[..., 0]) * q[..., 1] ** 3, np.exp(q[..., 2])], axis=-1)

    exact = np.zeros((5, 2, 3))
    exact[:, 0, 0] = np.cos(q[:, 0]) * q[:, 1] ** 3
    exact[:, 0, 1] = 3.0 * np.sin(q[:, 0]) * q[:, 1] ** 2
    exact[:, 1, 2] = np.exp(q[:, 2])
    np.testing.assert_allclose(gradient(function, q), exact, atol=1e-10)
    direction = np.random.default_rng(1).normal(size=(5, 3))
    np.testing.assert_allclose(slope(function, q, direction), np.einsum("nij,nj->ni", exact, direction), atol=1e-10)


@pytest.mark.parametrize("route", ["closed", "numeric"])
def test_a_right_route_passes(route, request, states):
    leg = request.getfixturevalue(route)
    checks = against_first_principles(leg, states)
    assert [each.quantity for each in checks if not each.passed] == []
    assert {each.group for each in checks} == {f"{leg.route}: first principles"}


def test_the_sign_of_one_passive_angle(closed, plant, states):
    column = closed.tree_joint_names.index("theta22")

    def flip(result, *_):
        signs = np.ones(result.shape[-1])
        signs[column] = -1.0
        return result * signs

    # The foot does not hang on this chain: only the loop sees it.
    assert failing(plant(closed, tree_coordinates=flip), states) == {"loops and couplings close"}


def test_a_coupling_that_slips(closed, plant, states):
    column = closed.tree_joint_names.index("gamma_C2")
    shift = 1e-8 * np.eye(len(closed.tree_joint_names))[column]
    wrong = plant(closed, tree_coordinates=lambda result, *_: result + shift)
    assert "loops and couplings close" in failing(wrong, states)


def test_an_independent_coordinate_that_is_not_kept(closed, plant, states):
    column = closed.tree_joint_names.index("epsilon_E1")
    assert column >= 0
    wrong = plant(closed, tree_coordinates=lambda result, *_: result * (1.0 + 1e-8))
    assert "loops and couplings close" in failing(wrong, states)


def swapped(result, *_):
    return result[..., [1, 0, 2]]


def scaled(factor):
    return lambda result, *_: result * factor


CASES = {
    "foot shifted": (
        {"foot_position": lambda p, *_: p + 1e-7},
        {"foot position against the tree", "foot position of inverse kinematics"},
    ),
    "foot scaled": (
        {"foot_position": scaled(1.0 + 1e-5)},
        {
            "foot position against the tree",
            "foot position of inverse kinematics",
            "J against differences",
            "power balance",
        },
    ),
    "J perturbed": (
        {"foot_jacobian": scaled(1.0 + 1e-5)},
        {
            "J against differences",
            "Jdot against differences",
            "generalized force = M a + h - J'F",
            "foot force of torque",
        },
    ),
    "Jdot perturbed": (
        {"foot_jacobian_derivative": scaled(1.0 + 1e-5)},
        {"Jdot against differences", "foot acceleration = J a + Jdot v"},
    ),
    "foot bias acceleration dropped": (
        {"foot_bias_acceleration": scaled(0.0)},
        {"foot acceleration = J a + Jdot v"},
    ),
    "inverse kinematics off": (
        {"inverse_kinematics": lambda q, *_: q + 1e-7},
        {"foot position of inverse kinematics"},
    ),
    "mass matrix perturbed": (
        {"mass_matrix": scaled(1.0 + 1e-5)},
        {"Mdot - 2C skew", "generalized force = M a + h - J'F", "power balance"},
    ),
    "mass matrix skewed": (
        {"mass_matrix": lambda M, *_: M + 3e-11 * np.triu(np.ones((3, 3)), 1)},
        {"mass matrix symmetric"},
    ),
    "mass matrix with an extra constant": (
        {"mass_matrix": lambda M, *_: M + 1e-3 * np.eye(3)},
        {"generalized force = M a + h - J'F", "power balance"},
    ),
    "potential perturbed": (
        {"potential_energy": scaled(1.0 + 1e-4)},
        {"gravity against potential", "power balance"},
    ),
    "torque in another order": (
        {"torque": swapped},
        {"acceleration of torque", "power balance", "foot force of torque"},
    ),
    "acceleration perturbed": ({"acceleration": scaled(1.0 + 1e-7)}, {"acceleration of torque"}),
}


@pytest.mark.parametrize("case", CASES)
def test_a_planted_error_fails_the_checks_that_see_it(closed, plant, states, case):
    faults, expected = CASES[case]
    assert failing(plant(closed, **faults), states) == expected


def test_a_negative_mass_matrix_is_not_positive(closed, plant, states):
    wrong = plant(closed, mass_matrix=scaled(-1.0))
    assert "mass matrix positive" in failing(wrong, states)
    singular = plant(closed, mass_matrix=lambda M, *_: M * np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0]))
    assert "mass matrix positive" in failing(singular, states)


def consistently(closed, change):
    """The same error in every method that returns generalized forces, so that only first principles can see it."""

    def bias(result, q, v, gravity, failures):
        return result + change(q, v)

    def force(result, q, v, a, foot_force, gravity, failures):
        return result + change(q, v)

    def acceleration(result, q, v, tau, foot_force, gravity, failures):
        return closed.backend.acceleration(q, v, tau - change(q, v), foot_force, gravity, failures)

    return {"bias": bias, "generalized_force": force, "torque": force, "acceleration": acceleration}


def test_a_gyroscopic_force_is_seen_by_skewness_alone(closed, plant, states):
    """Coriolis terms without power: v^T c = 0, so that energy, power and every inverse agree."""

    def change(q, v):
        return 1e-3 * np.stack([v[..., 1] * v[..., 2], -v[..., 0] * v[..., 2], 0.0 * v[..., 0]], axis=-1)

    assert failing(plant(closed, **consistently(closed, change)), states) == {"Mdot - 2C skew"}


def test_a_force_that_is_not_quadratic(closed, plant, states):
    wrong = plant(closed, **consistently(closed, lambda q, v: 1e-3 * v**4))
    assert "Coriolis force = C v" in failing(wrong, states)


def test_a_force_that_is_not_conservative(closed, plant, states):
    wrong = plant(closed, **consistently(closed, lambda q, v: 1e-3 * q[..., [1, 2, 0]]))
    assert failing(wrong, states) == {"gravity against potential", "power balance"}


def test_friction_may_take_power_but_not_give_it(closed, plant, states):
    assert failing(plant(closed, **consistently(closed, lambda q, v: 0.1 * v + 0.2 * np.sign(v))), states) == set()
    assert failing(plant(closed, **consistently(closed, lambda q, v: -0.1 * v)), states) == {"power balance"}


def test_a_foot_force_of_the_wrong_sign(closed, plant, states):
    def flipped(name):
        def fault(result, q, v, a, foot_force, gravity, failures):
            turned = None if foot_force is None else -foot_force
            return getattr(closed.backend, name)(q, v, a, turned, gravity, failures)

        return fault

    wrong = plant(closed, torque=flipped("torque"), generalized_force=flipped("generalized_force"))
    assert failing(wrong, states) == {
        "acceleration of torque",
        "power balance",
        "foot force of torque",
        "generalized force = M a + h - J'F",
    }


def test_nan_anywhere_fails_by_name(closed, plant, states):
    def hole(result, *_):
        result = np.array(result)
        result[3] = np.nan
        return result

    for method, quantity in {
        "mass_matrix": "mass matrix positive",
        "foot_jacobian": "J against differences",
        "tree_coordinates": "loops and couplings close",
        "torque": "acceleration of torque",
    }.items():
        checks = against_first_principles(plant(closed, **{method: hole}), states)
        (lost,) = (each for each in checks if each.quantity == quantity)
        assert not lost.passed
        assert list(lost.at.values()) == states.q[3].tolist()


def test_a_point_that_inverse_kinematics_refuses(closed, plant, states):
    def refuse(result, p, branch, failures):
        failures.add([2], OutOfReachError("gave up", margin=-1.0))
        result[2] = np.nan
        return result

    wrong = plant(closed, inverse_kinematics=refuse)
    assert failing(wrong, states) == {"foot position of inverse kinematics"}
    corners = states.take(np.flatnonzero((np.abs(states.q[:, 0]) > 1.1) & (np.abs(states.q[:, 1]) > 1.1)))
    assert len(corners) >= 4
    assert all(each.passed and "inverse" not in each.quantity for each in against_first_principles(wrong, corners))


def test_legs_without_foot_and_with_friction(pendulum):
    leg = load(pendulum(0.05, 0.02))
    checks = against_first_principles(leg, sample_states(domain(leg), 30, 0))
    assert all(each.passed for each in checks)
    assert {"power balance", "Mdot - 2C skew", "loops and couplings close"} <= {each.quantity for each in checks}
    assert not [each for each in checks if "foot" in each.quantity or each.quantity.startswith("J")]


# ---------------------------------------------------------------------- loops, one type at a time

ROLL = "0.1 0.2 0.3"
MOTIONS = {
    # What may move freely in the loop's frame (x is the axis), and what may not.
    "revolute": ([("roll", "1 0 0")], ["x", "y", "z", "pitch", "yaw"]),
    "continuous": ([("roll", "1 0 0")], ["x", "y", "z", "pitch", "yaw"]),
    "prismatic": ([("x", "1 0 0")], ["y", "z", "roll", "pitch", "yaw"]),
    "fixed": ([], ["x", "y", "z", "roll", "pitch", "yaw"]),
    "planar": ([("roll", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1")], ["x", "pitch", "yaw"]),
    "spherical": ([("roll", "1 0 0"), ("pitch", "0 1 0"), ("yaw", "0 0 1")], ["x", "y", "z"]),
    # Predecessor x and successor y stay at a right angle: turning about either keeps it.
    "universal": ([("roll", "1 0 0"), ("pitch", "0 1 0")], ["x", "y", "z", "yaw"]),
}
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1", "roll": "1 0 0", "pitch": "0 1 0", "yaw": "0 0 1"}


def loop_text(kind):
    """Two links that coincide at zero and move apart in six ways, and a loop between them."""
    names = list(AXES)
    links = "".join(f'<link name="l{i}"/>' for i in range(7))
    joints = "".join(
        f'<joint name="{name}" type="{"prismatic" if name in "xyz" else "revolute"}"><parent link="l{i}"/>'
        f'<child link="l{i + 1}"/><axis xyz="{AXES[name]}"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
        "</joint>"
        for i, name in enumerate(names)
    )
    axis = "" if kind in ("fixed", "spherical", "universal") else '<axis xyz="1 0 0"/>'
    loop = f'<loop name="loop" type="{kind}"><predecessor link="l0"/><successor link="l6"/>{axis}</loop>'
    return f'<robot name="loops">{links}{joints}{loop}</robot>'


@pytest.mark.parametrize("kind", MOTIONS)
def test_what_a_loop_allows_and_what_it_forbids(kind):
    description = parse(loop_text(kind))
    free, fixed = MOTIONS[kind]
    zero = {name: np.zeros(1) for name in AXES}
    assert loop_residual(description, zero).tolist() == [0.0]
    for name, _ in free:
        assert loop_residual(description, zero | {name: np.array([0.3])})[0] < 1e-15
    for name in fixed:
        assert loop_residual(description, zero | {name: np.array([0.01])})[0] > 5e-3
    assert {name for name, _ in free} | set(fixed) == set(AXES)
    lost = loop_residual(description, {name: np.array([0.0, np.nan]) for name in AXES})
    assert lost[0] == 0.0
    assert np.isnan(lost[1])


def test_couplings_count(closed):
    description = closed.description
    coordinates = {name: np.zeros(2) for name in closed.tree_joint_names}
    assert loop_residual(description, coordinates).max() < 1e-15
    name = next(name for name in coordinates if name == "gamma_output")
    coordinates[name] = np.array([0.0, 1e-3])
    assert loop_residual(description, coordinates)[1] >= 1e-3
