"""Inertia that turns with a joint itself, ``<dynamics armature="..">``, wherever a description is used."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse, read
from leg_dynamics.errors import DescriptionError, FormulaAssumptionError

ROUTES = ("pinocchio", "symbolic")
BODY = '<inertial><origin xyz="0.1 0.02 0"/><mass value="2"/><inertia ixx="0.02" iyy="0.03" izz="0.025"/></inertial>'


def joint(name, parent, x, *, kind="continuous", flag="false", dynamics=""):
    return (
        f'<joint name="{name}" type="{kind}" independent="{flag}"><parent link="{parent}"/><child link="{name}_link"/>'
        f'<origin xyz="{x} 0 0" rpy="0 0 0"/><axis xyz="0 0 1"/>{dynamics}</joint>'
    )


def four_bar(crank="", coupler="", rocker="", extra=""):
    """A crank of 0.1 m, a coupler of 0.3 m and a rocker of 0.25 m, whose pins are 0.3 m apart."""
    pin = 0.1 * np.exp(0.4j)
    reach = 0.3 - pin
    corner = math.acos((0.3**2 + abs(reach) ** 2 - 0.25**2) / (2 * 0.3 * abs(reach)))
    coupler_angle = float(np.angle(reach)) + corner
    rocker_angle = float(np.angle(pin + 0.3 * np.exp(1j * coupler_angle) - 0.3))
    links = "".join(f'<link name="{name}_link">{BODY}</link>' for name in ("crank", "coupler", "rocker"))
    return (
        f'<robot name="four_bar"><link name="base"/>{links}'
        + joint("crank", "base", 0, flag="true", dynamics=crank)
        + joint("coupler", "crank_link", 0.1, dynamics=coupler)
        + joint("rocker", "base", 0.3, dynamics=rocker)
        + '<loop name="pin" type="revolute"><predecessor link="coupler_link"><origin xyz="0.3 0 0"/></predecessor>'
        '<successor link="rocker_link"><origin xyz="0.25 0 0"/></successor><axis xyz="0 0 1"/></loop>'
        f'{extra}<configuration name="home"><joint name="crank" value="0.4"/>'
        f'<joint name="coupler" value="{coupler_angle - 0.4!r}"/><joint name="rocker" value="{rocker_angle!r}"/>'
        "</configuration></robot>"
    )


def felt(value):
    return f'<dynamics armature="{value!r}"/>'


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("name", ["crank", "coupler", "rocker"])
def test_an_armature_weighs_with_the_square_of_its_joints_speed(route, name):
    plain, heavy = ld.load(four_bar(), route), ld.load(four_bar(**{name: felt(0.3)}), route)
    for crank in (0.2, 0.9, 1.7):
        q, v, a = np.array([crank]), np.array([1.3]), np.array([-0.7])
        h = 1e-5
        turns = {s: float(plain.assemble(q + s * h)[name]) for s in (-2, -1, 0, 1, 2)}
        speed = (8 * (turns[1] - turns[-1]) - turns[2] + turns[-2]) / (12 * h)
        change = (16 * (turns[1] + turns[-1]) - turns[2] - turns[-2] - 30 * turns[0]) / (12 * h * h)
        added = heavy.mass_matrix(q) - plain.mass_matrix(q)
        np.testing.assert_allclose(added, [[0.3 * speed**2]], rtol=1e-8, atol=1e-10)
        force = heavy.generalized_force(q, v, a) - plain.generalized_force(q, v, a)
        expected = 0.3 * speed * (speed * a + change * v**2)
        np.testing.assert_allclose(force, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("route", ROUTES)
def test_armature_and_rotors_add_up(route):
    rotor = (
        '<transmission name="t"><joint name="crank"/><actuator name="m"><mechanicalReduction>-4</mechanicalReduction>'
        "<rotorInertia>0.01</rotorInertia></actuator></transmission>"
    )
    both = ld.load(four_bar(crank=felt(0.1), extra=rotor), route).mass_matrix(np.array([0.5]))
    plain = ld.load(four_bar(), route).mass_matrix(np.array([0.5]))
    np.testing.assert_allclose(both - plain, [[0.1 + 0.16]], rtol=1e-12)


def test_torque_is_differentiated_by_an_armature():
    leg = ld.load(four_bar(coupler=felt(0.1)), "symbolic")
    q, v, a = np.array([0.5]), np.array([1.5]), np.array([2.0])
    assert leg.numbers["coupler.armature"] == 0.1
    found = leg.torque_derivatives(q, v, a, parameters=("coupler.armature",)).parameters
    # The torque is linear in it.
    more = ld.load(four_bar(coupler=felt(1.1)), "symbolic").torque(q, v, a)
    np.testing.assert_allclose(np.ravel(found), more - leg.torque(q, v, a), rtol=1e-9)


@pytest.mark.parametrize("value", ["-0.1", "nan", "inf", "heavy"])
def test_an_impossible_armature_is_refused(value):
    with pytest.raises(DescriptionError, match="armature"):
        parse(four_bar(crank=f'<dynamics armature="{value}"/>'))


def test_a_joint_without_one_has_none():
    assert all(joint.armature == 0.0 for joint in read("quadruped_leg").joints)


def test_the_mujoco_model_carries_it():
    pytest.importorskip("mujoco", reason="the optional extra mujoco is not installed")
    from leg_dynamics.description.mjcf import mujoco_model

    model = mujoco_model(parse(four_bar(coupler=felt(0.25))))
    assert [model.joint(name).armature[0] for name in ("crank", "coupler", "rocker")] == [0.0, 0.25, 0.0]


def with_armature(text, name, value):
    """The text with an armature at one joint, whatever <dynamics> that joint has."""
    root = ElementTree.fromstring(text)
    joint = root.find(f"joint[@name='{name}']")
    dynamics = joint.find("dynamics")
    if dynamics is None:
        dynamics = ElementTree.SubElement(joint, "dynamics")
    dynamics.set("armature", repr(value))
    return ElementTree.tostring(root, encoding="unicode")


@pytest.mark.parametrize(
    ("name", "q"),
    [("omnileg", (0.1, -0.2, 0.3)), ("hexapod_leg", None), ("quadruped_leg", (0.1, 0.5, -0.9))],
)
def test_closed_formulas_take_the_armature_of_driven_joints(tmp_path, name, q):
    plain = ld.load(name)
    values = (0.01, 0.02, 0.03)
    text = read(name).urdf
    for driven, value in zip(plain.joint_names, values, strict=True):
        text = with_armature(text, driven, value)
    path = tmp_path / "leg.urdf"
    path.write_text(text, encoding="utf-8")
    heavy = ld.load(name, urdf=path)
    if q is None:
        home = read(name).home.values
        q = [home[joint] for joint in plain.joint_names]
    added = heavy.mass_matrix(np.array(q)) - plain.mass_matrix(np.array(q))
    np.testing.assert_allclose(added, np.diag(values), atol=1e-12)
    other = ld.load(name, urdf=path, route="pinocchio")
    np.testing.assert_allclose(other.mass_matrix(np.array(q)), heavy.mass_matrix(np.array(q)), atol=1e-9)


@pytest.mark.parametrize("name", ["omnileg", "hexapod_leg"])
def test_closed_formulas_refuse_the_armature_of_a_passive_joint(tmp_path, name):
    description = read(name)
    independent = ld.load(name).joint_names
    passive = next(each.name for each in description.moving_joints if each.name not in independent)
    path = tmp_path / "leg.urdf"
    path.write_text(with_armature(description.urdf, passive, 0.01), encoding="utf-8")
    with pytest.raises(FormulaAssumptionError, match=f"armature of joint '{passive}'"):
        ld.load(name, urdf=path)
