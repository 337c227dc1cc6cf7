"""load, replace, sibling, with_text: which file, which route, and what is refused."""

from __future__ import annotations

import os
import pickle
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import read, render, shipped_urdf, shipped_xacro
from leg_dynamics.errors import (
    AssemblyError,
    DescriptionError,
    FormulaAssumptionError,
    LegNotFoundError,
    MissingFootError,
    ParameterError,
    RouteError,
    UnsafeXmlError,
)
from leg_dynamics.routes import ROUTES, has_closed_form, routes_of, sibling, with_text

Q = np.radians([30.0, 20.0, 40.0])

TWO_LINKS = """<robot name="pendulum">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def leg():
    return ld.load("omnileg")


@pytest.fixture(scope="module")
def text():
    return shipped_urdf("omnileg").read_text(encoding="utf-8")


def foot_formula(q, L1=0.15, L4=0.095, L5=0.16):
    ta, tb = np.tan(q[0]), np.tan(q[1])
    length = L1 / np.sqrt(1.0 + ta**2 + tb**2)
    return np.array([tb * length, -ta * length, length + 2.0 * L4 * np.cos(q[2]) + L5])


# Names and paths.


def test_available():
    assert "omnileg" in ld.available()
    assert has_closed_form("omnileg")
    assert not has_closed_form("four_bar")
    assert not has_closed_form("../omnileg")


@pytest.mark.parametrize("route", [None, *ROUTES])
def test_a_shipped_name(route):
    leg = ld.load("omnileg", route)
    assert leg.route == (route or "closed_form")
    np.testing.assert_allclose(leg.foot_position(Q), foot_formula(Q), atol=1e-12)


@pytest.mark.parametrize("kind", [str, Path, os.fsdecode])
def test_a_path_has_no_formulas(kind):
    leg = ld.load(kind(shipped_urdf("omnileg")))
    assert leg.route == "pinocchio"
    assert routes_of(leg) == ("pinocchio", "symbolic")
    np.testing.assert_allclose(leg.foot_position(Q), foot_formula(Q), atol=1e-12)
    with pytest.raises(RouteError, match="no closed-form formulas"):
        ld.load(kind(shipped_urdf("omnileg")), route="closed_form")


def test_a_relative_path(tmp_path, monkeypatch, text):
    (tmp_path / "mine.urdf").write_text(text)
    monkeypatch.chdir(tmp_path)
    leg = ld.load("mine.urdf")
    monkeypatch.chdir("/")
    again = pickle.loads(pickle.dumps(leg))
    np.testing.assert_array_equal(again.foot_position(Q), leg.foot_position(Q))


def test_xml_text(text):
    leg = ld.load("\n" + TWO_LINKS)
    assert (leg.name, leg.joint_names, leg.foot) == ("pendulum", ("turn",), None)
    assert ld.load(text, foot="knee").foot == "knee"


def test_a_xacro_file():
    path = shipped_xacro("omnileg")
    leg = ld.load(path, parameters={"L1": 0.2})
    assert leg.route == "pinocchio"
    np.testing.assert_allclose(leg.foot_position(Q), foot_formula(Q, L1=0.2), atol=1e-12)


@pytest.mark.parametrize("name", ["omnlieg", "omni_leg", "OmniLeg"])
def test_an_unknown_name_names_the_nearest(name):
    with pytest.raises(LegNotFoundError, match="did you mean 'omnileg'"):
        ld.load(name)


@pytest.mark.parametrize("source", ["", "no such thing", "nowhere/leg.urdf", Path("omnileg")])
def test_neither_name_nor_file(source):
    with pytest.raises(LegNotFoundError):
        ld.load(source)


def test_a_folder(tmp_path):
    with pytest.raises(LegNotFoundError, match="folder"):
        ld.load(tmp_path)


@pytest.mark.parametrize("source", [None, 3, 0.5, ["omnileg"], b"omnileg", object()])
def test_not_a_source(source):
    with pytest.raises(LegNotFoundError, match="name, a path or XML text"):
        ld.load(source)


def test_a_wrong_file_says_where(tmp_path):
    path = tmp_path / "bad.urdf"
    path.write_text("<robot name='x'>\n<link name='a'/>\n<link name='a'/>\n</robot>")
    with pytest.raises(DescriptionError) as caught:
        ld.load(path)
    assert (caught.value.file, caught.value.line) == (str(path), 3)
    with pytest.raises(UnsafeXmlError):
        ld.load("<!DOCTYPE robot><robot name='x'/>")


@pytest.mark.parametrize("route", ["casadi", "Pinocchio", "", 3])
def test_a_wrong_route(route):
    with pytest.raises(RouteError, match="closed_form, pinocchio"):
        ld.load("omnileg", route)


# urdf=


def changed(text, tag, name, child, attribute, value):
    """The mechanism text with one attribute changed."""
    robot = ET.fromstring(text)
    (element,) = (each for each in robot.findall(tag) if each.get("name") == name)
    element.find(child).set(attribute, value)
    return ET.tostring(robot, encoding="unicode")


@pytest.mark.parametrize("kind", [str, Path])
def test_formulas_on_another_file(tmp_path, kind):
    path = tmp_path / "mine.urdf"
    path.write_text(render("omnileg", {"L1": 0.18, "L4": 0.1}))
    leg = ld.load("omnileg", urdf=kind(path))
    assert leg.route == "closed_form"
    np.testing.assert_allclose(leg.foot_position(Q), foot_formula(Q, L1=0.18, L4=0.1), atol=1e-12)
    numeric = ld.load("omnileg", "pinocchio", urdf=kind(path))
    np.testing.assert_allclose(leg.torque(Q, Q, Q), numeric.torque(Q, Q, Q), atol=1e-10)
    assert routes_of(numeric) == ROUTES


def test_formulas_on_a_file_that_breaks_an_assumption(tmp_path, text):
    path = tmp_path / "skew.urdf"
    path.write_text(changed(text, "joint", "theta13", "origin", "xyz", "0 0 0.16"))
    with pytest.raises(FormulaAssumptionError):
        ld.load("omnileg", urdf=path)


def test_urdf_goes_with_a_shipped_name(text):
    with pytest.raises(RouteError, match="urdf="):
        ld.load(TWO_LINKS, urdf=text)
    with pytest.raises(LegNotFoundError):
        ld.load("omnileg", urdf="missing.urdf")


# foot=


def test_foot_is_a_link():
    leg = ld.load("omnileg", "pinocchio", foot="knee")
    assert leg.foot == "knee"
    np.testing.assert_allclose(leg.foot_position(Q)[2], foot_formula(Q, L4=0.0, L5=0.0)[2], atol=1e-12)
    with pytest.raises(MissingFootError, match="no link 'toe'") as caught:
        ld.load("omnileg", "pinocchio", foot="toe")
    assert "knee" in str(caught.value)


def test_formulas_know_one_foot():
    assert ld.load("omnileg", foot="foot").route == "closed_form"
    with pytest.raises(RouteError, match="one foot"):
        ld.load("omnileg", foot="knee")
    assert routes_of(ld.load("omnileg", "pinocchio", foot="knee")) == ("pinocchio", "symbolic")


# Parameters.


def test_parameters_are_named(leg):
    assert leg.parameters["L1"].value == 0.15
    assert leg.parameters["L1"].unit == "m"
    with pytest.raises(TypeError):
        leg.parameters["L1"] = 3
    assert dict(ld.load(TWO_LINKS).parameters) == {}


@pytest.mark.parametrize("route", ROUTES)
def test_replace_changes_a_copy(route):
    leg = ld.load("omnileg", route)
    longer = leg.replace(L1=0.2)
    np.testing.assert_allclose(longer.foot_position(Q), foot_formula(Q, L1=0.2), atol=1e-12)
    np.testing.assert_allclose(leg.foot_position(Q), foot_formula(Q), atol=1e-12)
    assert (longer.route, longer.parameters["L1"].value, leg.parameters["L1"].value) == (route, 0.2, 0.15)


def test_a_second_replace_keeps_the_first(leg):
    twice = leg.replace(L1=0.2).replace(L4=0.1)
    assert (twice.parameters["L1"].value, twice.parameters["L4"].value) == (0.2, 0.1)
    np.testing.assert_allclose(twice.foot_position(Q), foot_formula(Q, L1=0.2, L4=0.1), atol=1e-12)
    back = twice.replace(L1=0.15, L4=0.095)
    np.testing.assert_allclose(back.torque(Q, Q, Q), leg.torque(Q, Q, Q), atol=1e-12)


def test_replace_keeps_the_parameters_of_load(leg):
    loaded = ld.load("omnileg", parameters={"L1": 0.2})
    np.testing.assert_allclose(loaded.replace(L5=0.2).foot_position(Q), foot_formula(Q, L1=0.2, L5=0.2), atol=1e-12)
    assert leg.replace() is leg


def test_replace_survives_pickling_and_keeps_the_foot():
    leg = ld.load("omnileg", "pinocchio", foot="knee").replace(L1=0.2)
    again = pickle.loads(pickle.dumps(leg)).replace(L5=0.1)
    assert (again.foot, again.parameters["L1"].value) == ("knee", 0.2)


def test_replace_a_mass():
    leg = ld.load("omnileg", "pinocchio")
    names = [name for name in leg.parameters if "foot" in name and "mass" in name]
    assert names, list(leg.parameters)
    heavier = leg.replace(**{names[0]: leg.parameters[names[0]].value + 1.0})
    change = heavier.gravity_torque(Q) - leg.gravity_torque(Q)
    # The weight of one more kilogram at the foot, carried by J^T.
    np.testing.assert_allclose(change, -leg.jacobian(Q).T @ [0.0, 0.0, 9.80665], rtol=1e-3)


@pytest.mark.parametrize(("name", "near"), [("L11", "L1"), ("l1", "L1"), ("gama_upper", "gamma_upper")])
def test_an_unknown_parameter_names_the_nearest(leg, name, near):
    with pytest.raises(ParameterError, match=f"did you mean .*'{near}'"):
        leg.replace(**{name: 0.2})
    with pytest.raises(ParameterError, match=f"did you mean .*'{near}'"):
        ld.load("omnileg", parameters={name: 0.2})


@pytest.mark.parametrize("value", [np.nan, np.inf, "0.2", None, [0.2], 1j])
def test_a_parameter_is_a_finite_number(leg, value):
    with pytest.raises(ParameterError, match="L1"):
        leg.replace(L1=value)


@pytest.mark.parametrize("source", [TWO_LINKS, "file"])
def test_a_plain_urdf_has_no_parameters(source):
    source = str(shipped_urdf("omnileg")) if source == "file" else source
    with pytest.raises(ParameterError, match="plain URDF"):
        ld.load(source).replace(L1=0.2)
    with pytest.raises(ParameterError):
        ld.load(source, parameters={"L1": 0.2})


def test_lengths_that_break_the_formulas_are_refused(leg):
    with pytest.raises((DescriptionError, FormulaAssumptionError, ParameterError)):
        leg.replace(L1=-0.1)


# sibling, with_text


def test_sibling_is_the_same_file_by_another_route():
    leg = ld.load("omnileg", "pinocchio", parameters={"L1": 0.2})
    other = sibling(leg, "closed_form")
    assert (leg.route, other.route) == ("pinocchio", "closed_form")
    np.testing.assert_allclose(other.torque(Q, Q, Q), leg.torque(Q, Q, Q), atol=1e-10)
    assert sibling(other, "pinocchio").parameters["L1"].value == 0.2
    with pytest.raises(RouteError, match="does not exist"):
        sibling(leg, "nonsense")
    with pytest.raises(RouteError, match="no closed-form"):
        sibling(ld.load(TWO_LINKS), "closed_form")


def test_with_text_keeps_route_and_formulas(leg):
    other = with_text(leg, render("omnileg", {"L4": 0.1}))
    assert other.route == "closed_form"
    np.testing.assert_allclose(other.foot_position(Q), foot_formula(Q, L4=0.1), atol=1e-12)
    with pytest.raises(ParameterError):
        other.replace(L1=0.2)
    with pytest.raises(DescriptionError):
        with_text(leg, "<robot/>")


def test_the_transmission_model_is_chosen_at_loading_and_survives_replace_and_pickle():
    q, v, a = np.radians([20.0, -15.0, 30.0]), np.array([3.0, -2.0, 4.0]), np.array([10.0, 20.0, -30.0])
    exact, paper = ld.load("omnileg"), ld.load("omnileg", transmission="paper")
    difference = np.abs(exact.torque(q, v, a) - paper.torque(q, v, a)).max()
    assert 1e-9 < difference < 0.05
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(paper)).torque(q, v, a), paper.torque(q, v, a))
    np.testing.assert_allclose(paper.replace(L1=0.15).torque(q, v, a), paper.torque(q, v, a), atol=1e-14)


@pytest.mark.parametrize("options", [{"transmission": "belt"}, {"transmission": "paper", "route": "pinocchio"}])
def test_a_transmission_model_that_does_not_exist_here_is_refused(options):
    with pytest.raises(RouteError):
        ld.load("omnileg", **options)


@pytest.mark.parametrize("foot", [["foot"], {"foot": 1}, 5, b"foot"])
def test_a_foot_that_is_no_name_is_refused(foot):
    with pytest.raises(MissingFootError, match="foot is the name of a link"):
        ld.load("omnileg", foot=foot)


@pytest.mark.parametrize("parameters", [[1], "abc", 0, [("L1", 0.2)]])
def test_parameters_that_are_no_mapping_are_refused(parameters):
    for function in (ld.load, read, render):
        with pytest.raises(ParameterError, match="parameters are a mapping"):
            function("omnileg", parameters=parameters)


def test_a_file_whose_loops_do_not_close_is_named(tmp_path):
    path = tmp_path / "open.urdf"
    loop = (
        '<loop name="far" type="spherical"><predecessor link="base"><origin xyz="9 9 9"/></predecessor>'
        '<successor link="arm"/></loop></robot>'
    )
    path.write_text(TWO_LINKS.replace("</robot>", loop))
    for route in ("pinocchio", "symbolic"):
        leg = ld.load(path, route=route)
        with pytest.raises(AssemblyError, match=rf"^{re.escape(str(path))}: no regular closed pose") as caught:
            leg.torque([0.1], [0.0], [0.0])
        assert caught.value.file == str(path)
        assert pickle.loads(pickle.dumps(caught.value)).file == str(path)
