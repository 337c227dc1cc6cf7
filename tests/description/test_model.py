"""The values themselves: frozen, picklable, comparable by content, printable."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from leg_dynamics.description import Configuration, Equation, Parameter, Pose, parse
from leg_dynamics.errors import DescriptionError

TEXT = """<robot name="arm"><link name="base"/><link name="upper"/><link name="tool"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/></joint>
<joint name="weld" type="fixed"><parent link="upper"/><child link="tool"/></joint>
<transmission name="t"><joint name="shoulder"/>
<actuator name="M1"><mechanicalReduction>6</mechanicalReduction></actuator>
</transmission>
<configuration name="up"><joint name="shoulder" value="1"/></configuration><configuration name="home"/></robot>"""


def test_a_description_survives_pickling_and_copying() -> None:
    arm = dataclasses.replace(parse(TEXT), parameters={"L1": Parameter("L1", 0.1, "m", "Table 2")})
    assert arm.link("upper").name == "upper"  # fills the cached look-ups
    for other in (pickle.loads(pickle.dumps(arm)), copy.deepcopy(arm), copy.copy(arm)):
        assert other == arm
        assert hash(other) == hash(arm)
        assert other.parameters == arm.parameters
        assert [c.values for c in other.configurations] == [c.values for c in arm.configurations]
        assert other.joint("shoulder") == arm.joint("shoulder")
        with pytest.raises(TypeError):
            other.parameters["L1"] = 1  # type: ignore[index]
    assert len(pickle.dumps(arm)) < 2 * len(pickle.dumps(parse(TEXT)))


def test_nothing_can_be_changed() -> None:
    arm = parse(TEXT)
    with pytest.raises(dataclasses.FrozenInstanceError):
        arm.name = "other"  # type: ignore[misc]
    with pytest.raises(TypeError):
        arm.home.values["shoulder"] = 1.0  # type: ignore[index, union-attr]
    values = {"a": 1.0}
    configuration, equation = Configuration("c", values), Equation("e", values)
    values["a"] = 2.0
    assert configuration.values["a"] == equation.coefficients["a"] == 1.0
    for each in (configuration, equation):
        assert pickle.loads(pickle.dumps(each)) == each
        assert len({each, copy.deepcopy(each)}) == 1


def test_equality_goes_by_content() -> None:
    assert parse(TEXT, file="one") == parse(TEXT, file="two")
    assert parse(TEXT) != parse(TEXT.replace("arm", "leg"))
    assert parse(TEXT) != TEXT


def test_look_ups() -> None:
    arm = parse(TEXT, file="arm.urdf")
    assert arm.has_link("tool")
    assert not arm.has_link("shoulder")
    assert [joint.name for joint in arm.path("tool")] == ["shoulder", "weld"]
    assert arm.path("base") == ()
    assert [joint.name for joint in arm.moving_joints] == ["shoulder"]
    assert arm.home is not None
    assert arm.home.name == "home"
    assert parse(TEXT.replace('"home"', '"down"')).home.name == "up"  # type: ignore[union-attr]
    assert parse('<robot name="r"><link name="l"/></robot>').home is None
    for look_up in (arm.link, arm.joint, arm.path):
        with pytest.raises(DescriptionError, match=r"arm\.urdf: there is no .* 'nothing'"):
            look_up("nothing")


def test_printing() -> None:
    arm = parse(TEXT, file="arm.urdf")
    assert repr(arm) == "<Description 'arm': 3 links, 2 joints, 0 loops, 0 couplings>"
    text = str(arm)
    for piece in ("arm.urdf", "root base", "1 revolute; 1 fixed", "shoulder by M1, reduction 6", "up; home"):
        assert piece in text
    assert "loops  " not in text
    assert max(map(len, text.splitlines())) <= 120


angles = st.floats(-10, 10)


@given(angles, angles, angles)
def test_roll_pitch_yaw_is_the_product_of_three_rotations(roll: float, pitch: float, yaw: float) -> None:
    def about(axis: int, angle: float) -> np.ndarray:
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        matrix = np.eye(3)
        matrix[[i, j], [i, j]] = math.cos(angle)
        matrix[i, j], matrix[j, i] = -math.sin(angle), math.sin(angle)
        return matrix

    rotation = Pose(rpy=(roll, pitch, yaw)).rotation()
    np.testing.assert_allclose(rotation, about(2, yaw) @ about(1, pitch) @ about(0, roll), atol=1e-15)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=2e-15)
    matrix = Pose((1.0, 2.0, 3.0), (roll, pitch, yaw)).matrix()
    np.testing.assert_array_equal(matrix[:3, 3], [1, 2, 3])
    np.testing.assert_array_equal(matrix[3], [0, 0, 0, 1])
    np.testing.assert_array_equal(matrix[:3, :3], rotation)


def test_a_long_list_of_parameters_is_cut_short() -> None:
    many = {f"p{n}": Parameter(f"p{n}", n / 8, "1" if n else "m", "assumed") for n in range(15)}
    text = " ".join(str(dataclasses.replace(parse(TEXT), parameters=many)).split())
    assert "p0 = 0 m; p1 = 0.125;" in text
    assert text.endswith("p11 = 1.375; and 3 more")
