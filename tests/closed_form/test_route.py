from __future__ import annotations

import math
import re
import subprocess
import sys

import numpy as np
import pytest

from leg_dynamics.closed_form import omnileg
from leg_dynamics.closed_form.route import ClosedFormRoute
from leg_dynamics.description import parse, read, shipped_urdf
from leg_dynamics.errors import FormulaAssumptionError, OutOfReachError, RouteError, RowFailures, SingularityError

GRAVITY = np.array([1.0, -2.0, 9.0])
RIGHT_ANGLE = math.pi / 2


@pytest.fixture(scope="module")
def route():
    return ClosedFormRoute("omnileg", read("omnileg"))


METHODS = {
    "tree_coordinates": "q",
    "foot_position": "q",
    "foot_jacobian": "q",
    "foot_jacobian_derivative": "qv",
    "foot_bias_acceleration": "qv",
    "mass_matrix": "q",
    "bias": "qvg",
    "potential_energy": "qg",
    "generalized_force": "qvafg",
    "torque": "qvafg",
    "acceleration": "qvafg",
}
SHAPES = {
    "tree_coordinates": (22,),
    "foot_jacobian": (3, 3),
    "foot_jacobian_derivative": (3, 3),
    "mass_matrix": (3, 3),
    "potential_energy": (),
}


def arguments(method, states):
    q, v, a = states
    pool = {"q": q, "v": v, "a": a, "f": v[:, ::-1] * 10.0, "g": np.broadcast_to(GRAVITY, q.shape)}
    return [pool[letter] for letter in METHODS[method]]


def run(route, method, arrays):
    failures = RowFailures()
    result = getattr(route, method)(*arrays, failures)
    assert not failures
    return result


@pytest.mark.parametrize("method", METHODS)
def test_a_sample_and_a_batch_agree(route, states, method):
    arrays = arguments(method, states)
    batch = run(route, method, arrays)
    assert batch.dtype == np.float64
    assert batch.shape == (40, *SHAPES.get(method, (3,)))
    for row in (0, 17, 39):
        single = run(route, method, [array[row] for array in arrays])
        assert single.shape == batch.shape[1:]
        np.testing.assert_allclose(single, batch[row], rtol=1e-9, atol=1e-12)


def test_a_batch_longer_than_a_block_keeps_its_order(route):
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (9001, 3))
    result = run(route, "foot_position", [q])
    for row in (0, 4095, 4096, 8192, 9000):
        np.testing.assert_allclose(
            result[row], omnileg.foot_position(route.numbers, tuple(q[row].tolist())), atol=1e-15
        )


def test_an_empty_batch_is_empty(route):
    assert run(route, "mass_matrix", [np.empty((0, 3))]).shape == (0, 3, 3)
    assert run(route, "tree_coordinates", [np.empty((0, 3))]).shape == (0, 22)
    assert route.inverse_kinematics(np.empty((0, 3)), "gamma_positive", RowFailures()).shape == (0, 3)


def test_gravity_none_is_the_files(route, states):
    q, v, _ = states
    given = run(route, "bias", [q, v, np.broadcast_to([0.0, 0.0, 9.81], q.shape)])
    np.testing.assert_array_equal(run(route, "bias", [q, v, None]), given)
    np.testing.assert_array_equal(run(route, "bias", [q[0], v[0], None]).shape, (3,))


def test_forces_on_the_foot_enter_with_the_environments_sign(route):
    q, zero = np.array([0.3, -0.2, 0.8]), np.zeros(3)
    pushed = run(route, "torque", [q, zero, zero, np.array([0.0, 0.0, -50.0]), zero])
    np.testing.assert_allclose(pushed, 50.0 * np.array(omnileg.foot_jacobian(route.numbers, tuple(q.tolist())))[2])
    assert pushed[2] < 0.0


def test_acceleration_undoes_torque_with_a_foot_force(route, states):
    q, v, a = states
    force = v * 5.0
    torque = run(route, "torque", [q, v, a, force, GRAVITY + 0.0 * q])
    np.testing.assert_allclose(run(route, "acceleration", [q, v, torque, force, GRAVITY + 0.0 * q]), a, atol=1e-9)


def test_torques_come_in_the_order_of_the_actuators(states):
    text = shipped_urdf("omnileg").read_text()
    blocks = re.findall(r"<transmission .*?</transmission>", text, flags=re.DOTALL)
    shuffled = text
    for old, new in zip(blocks, (blocks[2], blocks[0], blocks[1]), strict=True):
        shuffled = shuffled.replace(old, f"@{blocks.index(new)}@")
    for index, block in enumerate(blocks):
        shuffled = shuffled.replace(f"@{index}@", block)
    route = ClosedFormRoute("omnileg", parse(shuffled))
    assert route.actuator_joints == ("gamma", "alpha", "beta")
    q, v, a = states
    torque = run(route, "torque", [q, v, a, None, None])
    generalized = run(route, "generalized_force", [q, v, a, None, None])
    np.testing.assert_array_equal(torque, generalized[:, [2, 0, 1]])
    np.testing.assert_allclose(run(route, "acceleration", [q, v, torque, None, None]), a, atol=1e-9)


@pytest.mark.parametrize("branch", omnileg.BRANCHES)
def test_inverse_kinematics_of_samples_and_batches(route, branch):
    q = np.array([[0.4, -0.6, 0.5], [-0.8, 0.0, 1.2], [0.0, 0.0, 0.02]])
    q[:, 2] *= 1.0 if branch == "gamma_positive" else -1.0
    p = run(route, "foot_position", [q])
    failures = RowFailures()
    np.testing.assert_allclose(route.inverse_kinematics(p, branch, failures), q, atol=1e-12)
    np.testing.assert_allclose(route.inverse_kinematics(p[1], branch, failures), q[1], atol=1e-12)
    assert not failures


def test_points_out_of_reach_fail_with_their_margin_in_metres(route):
    p = np.array([[0.0, 0.0, 0.45], [0.25, 0.0, 0.4], [0.0, 0.0, 0.6]])
    failures = RowFailures()
    q = route.inverse_kinematics(p, "gamma_positive", failures)
    np.testing.assert_array_equal(np.isnan(q).all(axis=1), [False, True, True])
    error = failures.combined(3)
    assert isinstance(error, OutOfReachError)
    np.testing.assert_array_equal(error.rows, [1, 2])
    # 0.1 m beyond the horizontal reach, where the shank of 0.19 m falls 0.05 m short of the height as well
    np.testing.assert_allclose(error.margin, [-math.hypot(0.1, 0.05), -0.1], atol=1e-15)
    single = RowFailures()
    assert np.isnan(route.inverse_kinematics(p[1], "gamma_positive", single)).all()
    assert isinstance(single.combined(None), OutOfReachError)


@pytest.mark.parametrize("pose", [(RIGHT_ANGLE, RIGHT_ANGLE, 0.3), (RIGHT_ANGLE, 0.0, 0.0)])
@pytest.mark.parametrize("method", ["foot_position", "mass_matrix", "tree_coordinates"])
def test_poses_where_the_passive_joints_lose_their_direction_fail(route, method, pose):
    q = np.array([[0.1, 0.2, 0.3], pose])
    failures = RowFailures()
    result = getattr(route, method)(q, failures)
    assert np.isfinite(result[0]).all()
    assert np.isnan(result[1]).all()
    error = failures.combined(2)
    assert isinstance(error, SingularityError)
    np.testing.assert_array_equal(error.rows, [1])
    assert abs(error.margin[0]) < omnileg.SINGULARITY_LIMIT
    failures = RowFailures()
    assert np.isnan(getattr(route, method)(q[1], failures)).all()
    assert isinstance(failures.combined(None), SingularityError)


def test_overflow_is_left_to_the_interface(route):
    failures = RowFailures()
    huge = np.full(3, 1e200)
    with np.errstate(over="ignore", invalid="ignore"):
        result = route.bias(np.array([0.1, 0.2, 0.3]), huge, None, failures)
    assert not np.isfinite(result).all()
    assert not failures


def test_torque_at_the_straight_leg_works(route):
    zero = np.zeros(3)
    assert np.isfinite(run(route, "torque", [zero, zero + 1.0, zero, np.array([0.0, -20.0, 20.0]), None])).all()


def test_unknown_formulas_are_refused():
    with pytest.raises(RouteError, match="no formulas of a leg called 'tripod'"):
        ClosedFormRoute("tripod", read("omnileg"))


def test_a_leg_without_its_three_motors_is_refused():
    text = shipped_urdf("omnileg").read_text()
    two = re.sub(r'<transmission name="gamma_transmission">.*?</transmission>', "", text, flags=re.DOTALL)
    with pytest.raises(FormulaAssumptionError, match="one actuator on each of alpha, beta, gamma"):
        ClosedFormRoute("omnileg", parse(two))


def test_the_room_imports_neither_pinocchio_nor_heavy_readers():
    code = (
        "import sys, leg_dynamics.closed_form, leg_dynamics.closed_form.omnileg, leg_dynamics.closed_form.route;"
        "print([m for m in ('pinocchio', 'casadi', 'yourdfpy', 'leg_dynamics.mechanism') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
