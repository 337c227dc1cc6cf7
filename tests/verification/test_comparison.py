from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from leg_dynamics.errors import AssemblyError
from leg_dynamics.routes import load, with_text
from leg_dynamics.verification.comparison import check, compare, relative

KINEMATIC = {"foot position", "foot Jacobian", "Jacobian derivative", "foot acceleration"}
DYNAMIC = {
    "mass matrix",
    "bias force",
    "gravity torque, tilted",
    "potential energy",
    "acceleration",
    "torque",
    "torque with foot force, tilted",
}


def failing(checks):
    return {each.quantity for each in checks if not each.passed}


def test_relative_is_to_one_plus_magnitude_and_keeps_nan():
    first = np.array([[0.0, 100.0], [1.0, np.nan], [np.inf, 0.0]])
    second = np.array([[0.5, 101.0], [1.0, 1.0], [np.inf, 0.0]])
    errors = relative(first, second, 1)
    assert errors[0] == pytest.approx(1.0 / 102.0)
    assert np.isnan(errors[1:]).all()
    np.testing.assert_allclose(relative(np.array([1.0, 2.0]), np.array([1.0, 3.0]), 0), [0.0, 0.25])
    assert relative(np.zeros((4, 0)), np.zeros((4, 0)), 1).tolist() == [0.0] * 4


def test_check_takes_the_worst_row_and_nan_before_all(closed):
    q = np.arange(12.0).reshape(4, 3)
    worst = check("g", "q", np.array([0.0, 3.0, 2.0, 1.0]), 1.0, closed, q)
    assert (worst.worst, worst.at, worst.samples) == (3.0, {"alpha": 3.0, "beta": 4.0, "gamma": 5.0}, 4)
    lost = check("g", "q", np.array([0.0, np.inf, np.nan, 1.0]), 1.0, closed, q)
    assert not lost.passed
    assert lost.at["alpha"] == 3.0
    assert check("g", "q", np.array([0.0, 9.0, np.nan]), 1.0, closed, q).at["alpha"] == 6.0


def test_two_routes_agree(closed, numeric, states):
    told = []
    checks = compare(closed, numeric, states, "group", lambda what, share: told.append((what, share)))
    assert {each.quantity for each in checks} == KINEMATIC | DYNAMIC
    assert not failing(checks)
    assert max(each.worst for each in checks) < 1e-10
    assert {each.group for each in checks} == {"group"}
    assert {each.samples for each in checks} == {len(states)}
    shares = [share for _, share in told]
    assert len(told) == len(checks)
    assert shares == sorted(shares)
    assert {each.quantity for each in compare(closed, closed, states.first(3), "g", kinematics=False)} == DYNAMIC


@pytest.mark.parametrize("link", ["cross_B1", "shaft_A4B4", "driven_gear_3", "link_D2E2"])
def test_a_wrong_mass_of_one_body_in_one_route(closed, numeric, states, link):
    robot = ET.fromstring(closed.description.urdf)
    (body,) = (each for each in robot.findall("link") if each.get("name") == link)
    mass = body.find("inertial/mass")
    mass.set("value", repr(1.01 * float(mass.get("value"))))
    wrong = with_text(numeric, ET.tostring(robot, encoding="unicode"))
    assert failing(compare(closed, wrong, states, "g")) == DYNAMIC


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        ("foot_position", {"foot position"}),
        ("foot_jacobian", {"foot Jacobian", "foot acceleration"}),
        ("foot_jacobian_derivative", {"Jacobian derivative"}),
        ("foot_bias_acceleration", {"foot acceleration"}),
        ("mass_matrix", {"mass matrix"}),
        ("bias", {"bias force", "gravity torque, tilted"}),
        ("potential_energy", {"potential energy"}),
        ("torque", {"torque", "torque with foot force, tilted"}),
        ("acceleration", {"acceleration"}),
    ],
)
def test_a_perturbed_method_fails_where_it_is_used(closed, plant, states, method, expected):
    wrong = plant(closed, **{method: lambda result, *_: result * (1.0 + 1e-7) + 1e-8})
    assert failing(compare(closed, wrong, states, "g")) == expected


def test_an_error_that_hides_behind_zero_velocity_or_upright_gravity(closed, plant, states):
    """Ignored arguments: gravity, foot force, velocity."""

    def without_gravity(result, q, v, a, foot_force, gravity, failures):
        return closed.backend.torque(q, v, a, foot_force, None, failures)

    def without_force(result, q, v, a, foot_force, gravity, failures):
        return closed.backend.torque(q, v, a, None, gravity, failures)

    for fault in (without_gravity, without_force):
        assert failing(compare(closed, plant(closed, torque=fault), states, "g")) == {"torque with foot force, tilted"}


def test_swapped_actuators(closed, plant, states):
    wrong = plant(closed, torque=lambda result, *_: result[..., [1, 0, 2]])
    assert failing(compare(closed, wrong, states, "g")) == {"torque", "torque with foot force, tilted"}


@pytest.mark.parametrize("order", [0, 1])
def test_a_nan_of_one_route_fails_at_its_state(closed, plant, states, order):
    def hole(result, q, failures):
        result = np.array(result)
        result[q[..., 0] == states.q[17, 0]] = np.nan
        return result

    legs = [closed, plant(closed, mass_matrix=hole)]
    (lost,) = (each for each in compare(*legs[:: 1 - 2 * order], states, "g") if not each.passed)
    assert lost.quantity == "mass matrix"
    assert np.isnan(lost.worst)
    assert list(lost.at.values()) == states.q[17].tolist()
    assert lost.detail.startswith("closed_form: NonFiniteError: the result at q = ")


def test_rows_that_one_route_refuses_fail_with_its_reason(closed, plant, states):
    def refuse(result, q, failures):
        failures.add(np.flatnonzero(np.atleast_2d(q)[:, 2] > 1.4), AssemblyError("bent too far", margin=-1.0))
        return np.where((q[..., 2] > 1.4)[..., None], np.nan, result)

    (lost,) = (each for each in compare(closed, plant(closed, foot_position=refuse), states, "g") if not each.passed)
    assert lost.quantity == "foot position"
    assert lost.at["gamma"] > 1.4
    assert lost.detail == "closed_form: AssemblyError: bent too far"


def test_a_row_that_fails_in_the_batch_only(closed, plant, states):
    def batch_only(result, q, failures):
        return result * np.nan if len(q) > 1 else result

    (lost,) = (each for each in compare(closed, plant(closed, mass_matrix=batch_only), states, "g") if not each.passed)
    assert lost.detail == "a row fails in the batch and not alone"


def test_legs_without_foot_or_with_other_actuators(pendulum, numeric, states):
    leg = load(pendulum())
    two = type(states)(states.q[:, :2], states.v[:, :2], states.a[:, :2], states.foot_force, states.gravity)
    names = {each.quantity for each in compare(leg, leg, two, "g")}
    assert names == DYNAMIC
    text = pendulum().replace(
        "</robot>",
        '<transmission name="t"><type>transmission_interface/SimpleTransmission</type><joint name="first"/>'
        '<actuator name="M"><mechanicalReduction>1</mechanicalReduction></actuator></transmission></robot>',
    )
    under = load(text)
    assert under.actuator_names == ("M",)
    names = {each.quantity for each in compare(under, under, two, "g")}
    assert names == DYNAMIC - {"torque", "torque with foot force, tilted"} | {"generalized force, tilted"}
