"""Cones, telescopes and clearances: what is kept, and the error with file and line for what cannot be true."""

from __future__ import annotations

import copy
import math
import pickle
import warnings

import pytest

from leg_dynamics.description import parse, read, render
from leg_dynamics.errors import DescriptionError, LegDynamicsWarning
from leg_dynamics.verification.perturbation import with_random_inertia

TEXT = """<robot name="strut">
  <link name="base"/>
  <link name="sleeve"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <link name="rod"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <joint name="swing" type="revolute"><parent link="base"/><child link="sleeve"/></joint>
  <joint name="slide" type="prismatic"><parent link="sleeve"/><child link="rod"/></joint>
  <cone name="ball" link="rod">
    <axis xyz="0 0 2"/>
    <other link="base"><axis xyz="3 4 0"/></other>
    <limit upper="0.6109"/>
  </cone>
  <telescope joint="slide" sleeve="0.31" rod="0.30" overlap="0.02"/>
  <clearance name="gap" minimum="0.001">
    <segment link="sleeve" from="0 0 0" to="0 0 0.5" radius="0.03"/>
    <segment link="base" from="0.1 0 0" to="0.1 0.2 0"/>
  </clearance>
</robot>
"""


def changed(old: str, new: str) -> str:
    assert TEXT.count(old) == 1, old
    return TEXT.replace(old, new)


def check(strut) -> None:
    (cone,) = strut.cones
    assert (cone.name, cone.link, cone.other_link, cone.upper) == ("ball", "rod", "base", 0.6109)
    assert cone.axis == (0.0, 0.0, 1.0)
    assert cone.other_axis == pytest.approx((0.6, 0.8, 0.0), abs=1e-16)
    (telescope,) = strut.telescopes
    assert (telescope.joint, telescope.sleeve, telescope.rod, telescope.overlap) == ("slide", 0.31, 0.30, 0.02)
    (clearance,) = strut.clearances
    assert (clearance.name, clearance.minimum) == ("gap", 0.001)
    assert (clearance.first.link, clearance.first.end, clearance.first.radius) == ("sleeve", (0.0, 0.0, 0.5), 0.03)
    assert (clearance.second.link, clearance.second.start, clearance.second.radius) == ("base", (0.1, 0.0, 0.0), 0.0)


def test_everything_is_kept() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        strut = parse(TEXT)
    check(strut)
    assert (strut.cones[0].line, strut.telescopes[0].line, strut.clearances[0].line) == (7, 12, 13)
    assert "cone ball (rod - base)" in str(strut)
    assert "telescope slide" in str(strut)


def test_copies_keep_them() -> None:
    strut = parse(TEXT)
    for other in (pickle.loads(pickle.dumps(strut)), copy.deepcopy(strut)):
        check(other)
    check(parse(with_random_inertia(strut, seed=3)))


def test_xacro_keeps_them(tmp_path) -> None:
    source = tmp_path / "strut.urdf.xacro"
    source.write_text(
        changed('overlap="0.02"', 'overlap="${0.01 * 2}"').replace(
            '<robot name="strut">', '<robot name="strut" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        )
    )
    check(parse(render(source)))
    check(read(source))


def test_a_file_without_them_has_none() -> None:
    arm = parse('<robot name="a"><link name="b"/></robot>')
    assert (arm.cones, arm.telescopes, arm.clearances) == ((), (), ())


BROKEN = {
    "unknown cone link": ('name="ball" link="rod"', 'name="ball" link="rot"', "unknown link 'rot'.*'rod'", 7),
    "unknown other link": ('<other link="base">', '<other link="bas">', "unknown link 'bas'", 9),
    "same link": ('<other link="base">', '<other link="rod">', "both axes on link 'rod'", 9),
    "zero axis": ('xyz="0 0 2"', 'xyz="0 0 0"', "'ball' has a zero axis", 8),
    "no axis": ('<axis xyz="0 0 2"/>', "", "'ball' has no <axis>", 7),
    "no direction": ('<axis xyz="0 0 2"/>', "<axis/>", "<axis> has no xyz", 8),
    "no other": ('<other link="base"><axis xyz="3 4 0"/></other>', "", "no <other>", 7),
    "no limit": ('<limit upper="0.6109"/>', "", "no <limit>", 7),
    "no upper": ('<limit upper="0.6109"/>', "<limit/>", "has no upper", 10),
    "degrees": ('upper="0.6109"', 'upper="35"', "35 rad.*0 ... pi", 10),
    "zero angle": ('upper="0.6109"', 'upper="0"', "0 rad", 10),
    "nan angle": ('upper="0.6109"', 'upper="nan"', "finite", 10),
    "cone without name": ('<cone name="ball" link="rod">', '<cone link="rod">', "<cone> has no name", 7),
    "unknown joint": ('joint="slide"', 'joint="slid"', "unknown joint 'slid'.*'slide'", 12),
    "turning joint": ('joint="slide"', 'joint="swing"', "'swing'.*is revolute", 12),
    "no rod": ('rod="0.30" ', "", "has no rod", 12),
    "negative sleeve": ('sleeve="0.31"', 'sleeve="-0.31"', "sleeve.*-0.31", 12),
    "infinite overlap": ('overlap="0.02"', 'overlap="inf"', "finite", 12),
    "impossible overlap": ('overlap="0.02"', 'overlap="0.7"', "never overlap by 0.7 m", 12),
    "negative radius": ('radius="0.03"', 'radius="-1"', "radius.*-1", 14),
    "no end": ('to="0 0 0.5" ', "", "<segment> has no to", 14),
    "two numbers": ('to="0 0 0.5"', 'to="0 0"', "3 numbers, got 2", 14),
    "nan end": ('to="0 0 0.5"', 'to="0 0 nan"', "finite", 14),
    "unknown segment link": ('<segment link="sleeve"', '<segment link="sleev"', "unknown link 'sleev'", 14),
    "one segment": ('<segment link="base" from="0.1 0 0" to="0.1 0.2 0"/>', "", "1 <segment> elements", 13),
    "same segment link": ('<segment link="base"', '<segment link="sleeve"', "both segments on link 'sleeve'", 13),
    "negative minimum": ('minimum="0.001"', 'minimum="-0.001"', "minimum.*-0.001", 13),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_cannot_be_true_is_refused(case: str) -> None:
    old, new, message, line = BROKEN[case]
    with pytest.raises(DescriptionError, match=message) as caught:
        parse(changed(old, new), file="strut.urdf")
    assert (caught.value.file, caught.value.line) == ("strut.urdf", line)


def test_names_are_unique() -> None:
    twice = TEXT.replace("</robot>", TEXT[TEXT.index("  <cone") : TEXT.index("  <telescope")] + "</robot>")
    with pytest.raises(DescriptionError, match=r"duplicate <cone> name 'ball'.*line 7"):
        parse(twice)
    line = '<telescope joint="slide" sleeve="1" rod="1" overlap="0"/>'
    with pytest.raises(DescriptionError, match=r"second <telescope>.*line 12"):
        parse(TEXT.replace("</robot>", f"{line}</robot>"))


def test_a_misspelt_tag_is_not_lost_in_silence() -> None:
    with pytest.warns(LegDynamicsWarning, match="'clearance'"):
        parse(TEXT.replace("<clearance", "<clearence").replace("</clearance", "</clearence"))


def test_the_right_angle_is_the_edge() -> None:
    assert parse(changed('upper="0.6109"', f'upper="{math.pi!r}"')).cones[0].upper == math.pi
