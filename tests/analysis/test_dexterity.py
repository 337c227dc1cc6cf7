"""Condition numbers against LAPACK and formulas; their statistics; the errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.dexterity import actuator_jacobian, column_scales, conditioning, dexterity
from leg_dynamics.errors import NonFiniteError, ParameterError, ShapeError, WorkspaceError

from . import workspace_legs as legs


def test_the_compiled_singular_values_are_lapacks():
    generator = np.random.default_rng(1)
    J = generator.normal(size=(5000, 3, 3)) * 10.0 ** generator.uniform(-4, 2, (5000, 1, 1))
    J[:1000, :, 0] *= 10.0 ** generator.uniform(-7, 0, (1000, 1))
    J[1000:1100] = np.linalg.qr(J[1000:1100])[0]  # three equal singular values
    J[1100:1200, :, 1] = J[1100:1200, :, 0]  # singular
    found, sigma = conditioning(J), np.linalg.svd(J, compute_uv=False)
    np.testing.assert_allclose(found.largest, sigma[:, 0], rtol=1e-7)
    regular = sigma[:, 2] > 1e-10 * sigma[:, 0]
    np.testing.assert_allclose(found.smallest[regular], sigma[regular, 2], rtol=1e-6)
    assert (found.condition[~regular] > 1e9).all()
    np.testing.assert_allclose(found.volume / sigma[:, 0] ** 3, np.linalg.det(J) / sigma[:, 0] ** 3, atol=1e-14)
    np.testing.assert_allclose(found.condition[1000:1100], 1.0, atol=1e-7)


@pytest.mark.parametrize("columns", [1, 2, 4])
def test_other_numbers_of_columns(columns):
    J = np.random.default_rng(2).normal(size=(20, 3, columns))
    J[3, 0, 0] = math.nan
    found = conditioning(J)
    sigma = np.linalg.svd(np.delete(J, 3, axis=0), compute_uv=False)
    np.testing.assert_allclose(np.delete(found.condition, 3), sigma[:, 0] / sigma[:, -1])
    assert math.isnan(found.condition[3])
    assert found.condition.shape == (20,)


def test_a_nan_row_leaves_the_others_alone():
    J = np.random.default_rng(3).normal(size=(4, 3, 3))
    J[1, 2, 2] = math.nan
    found = conditioning(J)
    np.testing.assert_array_equal(np.isnan(found.condition), [False, True, False, False])


def test_the_audits_jacobian():
    leg = ld.load("hexapod_leg")
    q = leg.inverse_kinematics([0.25, 0.2, 0.65])
    np.testing.assert_allclose(q, [0.72457, 0.39877, 0.68439], atol=5e-6)
    printed = [[0.3450, 0.2760, 0.8971], [-0.2587, 0.0280, 0.0909], [0.3653, 0.0060, 0.9479]]
    np.testing.assert_allclose(np.linalg.inv(actuator_jacobian(leg, q)), printed, atol=6e-5)
    # dx/dl and dl/dx have one condition number
    assert conditioning(actuator_jacobian(leg, q)).condition == pytest.approx(np.linalg.cond(printed), rel=1e-3)


def test_units():
    assert column_scales(ld.load("omnileg"))[1:] == ("m/rad", None)
    assert column_scales(ld.load("hexapod_leg"))[1:] == ("m/m", None)
    polar = legs.load(legs.polar().replace("</robot>", '<configuration name="home"/></robot>'))
    scales, unit, length = column_scales(polar, 0.5)
    np.testing.assert_array_equal(scales, [2.0, 2.0, 1.0])
    assert (unit, length) == ("1", 0.5)
    # at radius r = characteristic length, elevation 0 the three directions are alike
    assert dexterity(polar, [[0.3, 0.0, 0.5]], characteristic_length=0.5).mean == pytest.approx(1.0, abs=1e-7)
    assert dexterity(polar, [[0.3, 0.0, 1.0]], characteristic_length=0.5).mean == pytest.approx(2.0, abs=1e-7)


def test_a_motor_on_a_passive_joint():
    """Four-bar: the efforts say how the foot moves by the driven joint, which is not the independent one."""
    text = f"""<robot name="four_bar">
      <link name="base"/>{"".join(legs.link(name) for name in ("a", "b", "foot"))}
      <joint name="crank" type="continuous" independent="true"><parent link="base"/><child link="a"/>
        <axis xyz="0 1 0"/></joint>
      <joint name="rocker" type="continuous" independent="false"><parent link="base"/><child link="b"/>
        <origin xyz="0.5 0 0"/><axis xyz="0 1 0"/></joint>
      <joint name="rod" type="continuous" independent="false"><parent link="a"/><child link="foot"/>
        <origin xyz="0 0 0.2"/><axis xyz="0 1 0"/></joint>
      <loop name="pin" type="revolute"><predecessor link="foot"><origin xyz="0.5 0 0.1"/></predecessor>
        <successor link="b"><origin xyz="0 0 0.3"/></successor><axis xyz="0 1 0"/></loop>
      <transmission name="drive"><joint name="rocker"/><actuator name="M"/></transmission>
      <configuration name="home"><joint name="crank" value="0"/><joint name="rocker" value="0"/>
        <joint name="rod" value="0"/></configuration>
    </robot>"""
    leg = ld.load(text, route="pinocchio", foot="foot")
    q, h = np.array([0.25]), 1e-6
    found = actuator_jacobian(leg, q)
    step = leg.assemble(q + h)["rocker"] - leg.assemble(q - h)["rocker"]
    moved = leg.foot_position(q + h) - leg.foot_position(q - h)
    np.testing.assert_allclose(found[:, 0], moved / step, rtol=1e-5, atol=1e-8)


def test_weighted_statistics():
    polar = legs.load(legs.polar())
    q = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 1.0], [0.2, 0.0, 2.0]])
    found = dexterity(polar, q, [1.0, 2.0, 1.0], characteristic_length=1.0)
    k = np.array([2.0, 1.0, 2.0])
    assert found.mean == pytest.approx(1.5, abs=1e-6)
    assert found.deviation == pytest.approx(math.sqrt(np.average((k - 1.5) ** 2, weights=[1, 2, 1])), abs=1e-6)
    assert found.inverse_mean == pytest.approx(0.75, abs=1e-6)
    assert (found.smallest, found.largest) == pytest.approx((1.0, 2.0), abs=1e-6)
    assert found.to_dict()["characteristic_length"] == 1.0


def test_errors():
    polar = legs.load(legs.polar())
    with pytest.raises(WorkspaceError, match="no pose"):
        dexterity(polar, np.zeros((0, 3)))
    with pytest.raises(NonFiniteError, match="first row 1"):
        dexterity(polar, [[0.0, 0.0, 0.5]] * 2, [1.0, -1.0])
    with pytest.raises(ShapeError):
        dexterity(polar, [[0.0, 0.0, 0.5]] * 2, [1.0])
    with pytest.raises(ShapeError):
        conditioning(np.eye(2))
    for bad in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ParameterError):
            column_scales(polar, bad)
