"""Couplings, mimics and relations as linear forms."""

from __future__ import annotations

import pytest

from leg_dynamics.description import parse, read
from leg_dynamics.errors import DescriptionError, ParameterError
from leg_dynamics.symbolic.coordinates import Form, Relation, reduce_coordinates
from leg_dynamics.symbolic.numbers import Numbers, parameter_names


def test_couplings_and_mimics_are_eliminated(lab):
    coordinates = reduce_coordinates(parse(lab.gears()))
    assert coordinates.names == ("driver",)
    assert coordinates.forms["driven"] == Form(((0, -2.5),))
    assert coordinates.forms["rack"] == Form(((0, 0.05),), 0.03)


def test_omnileg_has_sixteen_unknowns_after_its_couplings():
    coordinates = reduce_coordinates(read("omnileg"))
    assert coordinates.unknowns == 16
    assert coordinates.forms["gamma_C2"] == coordinates.forms["gamma_output"]


def test_relations_remove_unknowns():
    relations = [Relation("theta13", (("theta12", -1.0),)), Relation("theta14", (("beta", -1.0),), 0.25)]
    coordinates = reduce_coordinates(read("omnileg"), relations)
    assert coordinates.unknowns == 14
    assert coordinates.forms["theta14"] == Form(((1, -1.0),), 0.25)


def test_couplings_between_independent_joints_are_refused(lab):
    text = lab.gears().replace('independent="false"', 'independent="true"')
    with pytest.raises(DescriptionError, match="mesh"):
        reduce_coordinates(parse(text))


def test_parameters_have_names(lab):
    description = parse(lab.crank_rocker())
    names = parameter_names(description)
    assert {"crank_link.mass", "rocker_link.com.z", "coupler.origin.x", "pin.successor.y", "foot.ixy"} <= set(names)
    numbers = Numbers.of(description).with_symbols(["crank_link.mass"])
    assert numbers.nominal.tolist() == [description.link("crank_link").inertial.mass]
    with pytest.raises(ParameterError):
        Numbers.of(description).with_symbols(["nothing.mass"])


def test_couplings_that_leave_an_independent_joint_no_motion(lab):
    again = '<coupling name="again"><predecessor link="driver_link"/><successor link="driven_link"/>'
    text = lab.gears().replace("<configuration", f'{again}<ratio value="3"/></coupling><configuration', 1)
    with pytest.raises(DescriptionError, match="'again' and the other couplings hold the independent joint driver"):
        reduce_coordinates(parse(text))
