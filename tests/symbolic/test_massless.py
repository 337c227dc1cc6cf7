"""Forward dynamics where a motion carries no mass: refused, also where its pivot is a zero that no pose changes."""

from __future__ import annotations

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.errors import SingularityError

SLIDES = """<robot name="slides"><link name="base"/>
  <link name="carriage"><inertial><mass value="2"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
  <link name="tip"><inertial><mass value="{mass}"/><inertia ixx="0" iyy="0" izz="0"/></inertial></link>
  <joint name="first" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/></joint>
  <joint name="second" type="{kind}"><parent link="carriage"/><child link="tip"/><axis xyz="0 1 0"/></joint>
</robot>"""


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
@pytest.mark.parametrize("motors", [1, 2])
def test_a_motion_without_mass_has_no_acceleration(route, kind, motors):
    mass = 0.0 if kind == "prismatic" else 1.0
    text = SLIDES.format(mass=mass, kind=kind)
    if motors == 1:
        # Nothing at all acts on the other one: zero by zero is no acceleration either.
        drive = '<transmission name="t"><joint name="first"/><actuator name="m"/></transmission></robot>'
        text = text.replace("</robot>", drive)
    leg = ld.load(text, route=route)
    np.testing.assert_allclose(leg.mass_matrix([0.1, 0.2]), np.diag([2.0 + mass, 0.0]), atol=1e-15)
    with pytest.raises(SingularityError, match="carries no mass"):
        leg.acceleration([0.1, 0.2], [0.0, 0.0], [1.0, 0.0][:motors])
    assert np.isnan(leg.acceleration(np.zeros((3, 2)), np.zeros(2), np.zeros(motors), on_error="nan")).all()


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_a_light_motion_has_one(route):
    leg = ld.load(SLIDES.format(mass=1e-9, kind="prismatic"), route=route)
    found = leg.acceleration([0.1, 0.2], [0.0, 0.0], [1.0, 1e-9], gravity=[0.0, 0.0, 0.0])
    np.testing.assert_allclose(found, [0.5, 1.0], rtol=1e-8)


CRANK = """<robot name="light_beside_heavy"><link name="base"/>
  <link name="a">{heavy}</link><link name="b">{light}</link><link name="c">{light}</link>
  <joint name="crank" type="continuous" independent="true">
    <parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
  <joint name="coupler" type="continuous" independent="false">
    <parent link="a"/><child link="b"/><origin xyz="0.2 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="rocker" type="continuous" independent="false">
    <parent link="base"/><child link="c"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="hand" type="revolute" independent="true">
    <parent link="b"/><child link="d"/><origin xyz="0.1 0.1 0"/><axis xyz="0 0 1"/></joint>
  <link name="d">{light}</link>
  <loop name="pin" type="revolute">
    <predecessor link="b"><origin xyz="0.5 0 0"/></predecessor>
    <successor link="c"><origin xyz="0.2 0 0"/></successor><axis xyz="0 0 1"/></loop>
  <configuration name="home">
    <joint name="crank" value="0.9"/><joint name="coupler" value="-0.9"/><joint name="rocker" value="0.9"/>
  </configuration></robot>"""


def body(mass):
    moments = " ".join(f'{key}="{0.01 * mass!r}"' for key in ("ixx", "iyy", "izz"))
    return f'<inertial><origin xyz="0.07 0.02 0"/><mass value="{mass!r}"/><inertia {moments}/></inertial>'


@pytest.mark.parametrize("share", [1.0, 1e-6, 1e-9, 1e-12])
def test_merged_inertia_keeps_what_is_light(share):
    text = CRANK.format(heavy=body(3.0), light=body(3.0 * share))
    numeric, symbolic = (ld.load(text, route=route) for route in ("pinocchio", "symbolic"))
    q = np.random.default_rng(4).uniform([0.5, -1.0], [1.3, 1.0], (20, 2))
    # Entry by entry, relative to the light motion's own mass.
    expected = numeric.mass_matrix(q)
    own = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    difference = np.abs(symbolic.mass_matrix(q) - expected) / (own[:, :, None] * own[:, None, :])
    assert difference.max() < 1e-11
