"""Kinds of singularities, loop rows against differences, and the distance along a line."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.loop_rows import loop_rows
from leg_dynamics.analysis.singularities import singularity, singularity_distance
from leg_dynamics.errors import AssemblyError, NonFiniteError, ParameterError, ShapeError, SingularityError

from ..three_rpr import three_rpr
from . import workspace_legs as legs


@pytest.mark.parametrize("name", ["omnileg", "hexapod_leg"])
def test_loop_rows_hold_along_every_motion(name):
    leg = ld.load(name)
    q = np.add([leg.description.home.values[joint] for joint in leg.joint_names], (0.01, 0.02, 0.03))
    rows = loop_rows(leg.description, leg.assemble(q), 0.4)
    unit = np.array([0.4 if leg.description.joint(joint).type == "prismatic" else 1.0 for joint in rows.joints])
    h = 1e-6
    for direction in np.eye(3):
        ahead, behind = leg.assemble(q + h * direction), leg.assemble(q - h * direction)
        rates = np.array([(ahead[joint] - behind[joint]) / (2 * h) for joint in rows.joints]) / unit
        np.testing.assert_allclose(rows.matrix @ rates, 0.0, atol=1e-8)
    assert np.linalg.matrix_rank(rows.matrix, tol=1e-9) == len(rows.joints) - 3


def test_redundant_rows_are_those_of_the_mobility_report():
    leg = ld.load("hexapod_leg", route="pinocchio")
    q = [leg.description.home.values[joint] for joint in leg.joint_names]
    rows = loop_rows(leg.description, leg.assemble(q), 0.7)
    report = leg.mobility_report(samples=3)
    rank = np.linalg.matrix_rank(rows.matrix, tol=1e-9)
    assert len(rows.matrix) - rank == report.redundant
    assert len(rows.joints) - rank == report.mobility == 3


def test_a_straight_omnileg_is_serially_singular():
    leg = ld.load("omnileg")
    bent, straight = (singularity(leg, [0.1, 0.2, gamma]) for gamma in (0.5, 0.0))
    assert bent.kinds == ()
    assert min(bent.serial, bent.parallel, bent.constraint) > 1e-3
    assert straight.kinds == ("serial",)
    assert straight.serial == pytest.approx(0.0, abs=1e-12)
    assert (bent.sign, straight.sign) == (-1, 0)


def test_a_four_bar_at_its_dead_point():
    """Driven at the crank, with coupler and rocker in line: the actuator no longer holds the mechanism."""
    ground, crank, coupler, rocker = 0.5, 0.2, 0.3, 0.25

    # the crank angle at which coupler and rocker are stretched
    angle = math.acos((ground**2 + crank**2 - (coupler + rocker) ** 2) / (2.0 * ground * crank))
    mechanism = f"""<robot name="four_bar"><link name="base"/>
      {"".join(legs.link(name) for name in ("a", "b", "foot"))}
      <joint name="crank" type="continuous" independent="true"><parent link="base"/><child link="a"/>
        <axis xyz="0 0 1"/></joint>
      <joint name="rod" type="continuous" independent="false"><parent link="a"/><child link="foot"/>
        <origin xyz="{crank} 0 0"/><axis xyz="0 0 1"/></joint>
      <joint name="rocker" type="continuous" independent="false"><parent link="base"/><child link="b"/>
        <origin xyz="{ground} 0 0"/><axis xyz="0 0 1"/></joint>
      <loop name="pin" type="revolute"><predecessor link="foot"><origin xyz="{coupler} 0 0"/></predecessor>
        <successor link="b"><origin xyz="{rocker} 0 0"/></successor><axis xyz="0 0 1"/></loop></robot>"""
    from leg_dynamics.description import parse

    end = np.array([ground, 0.0]) - crank * np.array([math.cos(angle), math.sin(angle)])
    along = math.atan2(end[1], end[0])
    tree = {"crank": angle, "rod": along - angle, "rocker": along + math.pi}
    rows = loop_rows(parse(mechanism), tree, 0.5)
    passive = [k for k, name in enumerate(rows.joints) if name != "crank"]
    sigma = np.linalg.svd(rows.matrix[:, passive], compute_uv=False)
    assert sigma[1] < 1e-12 < sigma[0]  # parallel
    sigma = np.linalg.svd(rows.matrix, compute_uv=False)
    assert sigma[1] > 1e-3  # but no constraint singularity


def test_a_serial_leg_has_only_serial_ones():
    leg = legs.load(legs.articulated((-1.0, 1.0), (-1.0, 1.0), (-2.0, 2.0), home=-0.5))
    found = singularity(leg, [0.2, 0.3, -0.7])
    assert (found.parallel, found.constraint, found.kinds) == (1.0, 1.0, ())
    assert singularity(leg, [0.2, 0.3, 0.0]).kinds == ("serial",)


def test_distance_along_a_line():
    leg = legs.load(legs.articulated((-1.0, 1.0), (-1.0, 1.0), (-2.0, 2.0), home=-0.5))
    found = singularity_distance(leg, [0.2, 0.0, -0.7], [0.0, 0.0, 1.0], reach=2.0)
    assert found.ahead == pytest.approx(0.7, abs=1e-9)
    assert found.kind_ahead == "serial"
    assert (found.behind, found.kind_behind, found.margin) == (-math.inf, "none", found.ahead)
    turned = singularity_distance(leg, [0.2, 0.0, -0.7], [0.0, 0.0, -2.0], reach=0.5)
    assert turned.behind == pytest.approx(-0.35, abs=1e-9)
    assert (turned.ahead, turned.kind_ahead) == (math.inf, "none")
    assert turned.margin == turned.behind


def test_where_an_assembly_mode_of_the_hexapod_leg_ends():
    leg = ld.load("hexapod_leg")
    home = [leg.description.home.values[joint] for joint in leg.joint_names]
    found = singularity_distance(leg, home, [0.0, 1.0, 0.0])
    a, b, e = (leg.parameters[name].value for name in "abe")
    # strut 1 is level: the two axes of its U joint and it are in one plane (audit: cos(beta) = 0)
    assert home[1] + found.ahead == pytest.approx(math.sqrt(a**2 + b**2 + e**2 + 2.0 * a * e), abs=1e-5)
    assert found.kind_ahead == "parallel"


def test_errors():
    leg = ld.load("hexapod_leg")
    home = [leg.description.home.values[joint] for joint in leg.joint_names]
    with pytest.raises((AssemblyError, SingularityError)):
        singularity(leg, [0.9, 0.01, 0.53])
    with pytest.raises(ShapeError):
        singularity(leg, [home, home])
    with pytest.raises(NonFiniteError):
        singularity(leg, [math.nan, 0.4, 0.7])
    with pytest.raises(SingularityError):
        singularity_distance(ld.load("omnileg"), [0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    with pytest.raises(ParameterError):
        singularity_distance(leg, home, [0.0, 0.0, 0.0])
    with pytest.raises(ParameterError):
        singularity_distance(leg, home, [1.0, 0.0, 0.0], reach=-1.0)
    with pytest.raises(ShapeError):
        singularity_distance(leg, home[:2], [1.0, 0.0, 0.0])
    with pytest.raises(NonFiniteError):
        singularity_distance(leg, home, [math.inf, 0.0, 0.0])


@pytest.mark.parametrize("other", [None, "omnileg", 5, object()])
def test_what_is_no_leg_is_refused(other):
    with pytest.raises(ShapeError, match="no leg"):
        singularity(other, [0.0, 0.0, 0.0])
    with pytest.raises(ShapeError, match="no leg"):
        singularity_distance(other, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0])


@pytest.mark.parametrize("length", [["1"], {"m": 1}, b"1", "1", object()])
def test_a_length_that_is_no_number_is_refused(length):
    with pytest.raises(ShapeError, match="characteristic_length"):
        singularity(ld.load("omnileg"), [0.1, 0.2, 0.3], characteristic_length=length)


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_a_leg_in_a_plane_is_regular_with_three_coordinates(route):
    """Its foot moves in a plane only: the third direction is none that a pose has lost."""
    leg = ld.load(three_rpr((0.872, 3.103)), route=route, foot="platform")
    found = ld.singularity(leg, leg.home)
    assert found.kinds == ()
    assert found.serial > 0.1


def test_a_home_without_a_foot_jacobian_is_no_obstacle(tmp_path):
    """Nearly singular, so that the Jacobian is refused there."""
    text = (Path(__file__).parents[2] / "examples" / "my_leg.urdf").read_text(encoding="utf-8")
    gap = 1e-5
    values = {"theta1": 0.6, "theta2": 0.6 - gap, "knee": -gap, "crank_pin": gap}
    home = "".join(f'<joint name="{name}" value="{value!r}"/>' for name, value in values.items())
    start = text.index("<configuration")
    text = text[:start] + f'<configuration name="home">{home}</configuration></robot>'
    text = re.sub(r'upper="-0\.5"', 'upper="1"', text)
    leg = ld.load(text, route="pinocchio")
    assert np.isnan(leg.jacobian(leg.home, on_error="nan")).all()
    assert ld.singularity(leg, [0.6, -0.9]).kinds == ()
