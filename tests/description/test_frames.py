"""Tree forward kinematics against explicit products of elementary transforms."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays, mutually_broadcastable_shapes

from leg_dynamics.description import link_transforms, parse, read
from leg_dynamics.description.frames import axis_rotation
from leg_dynamics.errors import DescriptionError, NonFiniteError, ShapeError, UnsupportedError

MODELS = Path(__file__).parents[2].parent / "shared" / "models"
ARM = parse("""<robot name="arm"><link name="tool"/><link name="base"/><link name="upper"/>
<link name="slider"/><link name="fork"/>
<joint name="weld" type="fixed"><parent link="slider"/><child link="tool"/><origin xyz="0 0 0.1" rpy="0.3 0 0"/></joint>
<joint name="slide" type="prismatic"><parent link="upper"/><child link="slider"/><axis xyz="0 1 1"/>
<origin xyz="1 0 0" rpy="0 0.7 0"/></joint>
<joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="1 2 2"/>
<origin xyz="0 0 2" rpy="0.1 0.2 0.3"/></joint>
<joint name="spin" type="continuous"><parent link="base"/><child link="fork"/><axis xyz="0 0 -1"/></joint>
</robot>""")


def translation(*xyz: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = xyz
    return matrix


def rotation(axis: str, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    matrix = np.eye(4)
    matrix[:3, :3] = {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]
    return matrix


def exponential(axis: np.ndarray, angle: float) -> np.ndarray:
    """The rotation as a power series of its generator: independent of Rodrigues' formula."""
    x, y, z = axis * angle
    generator = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    term, total = np.eye(3), np.eye(3)
    for n in range(1, 60):
        term = term @ generator / n
        total = total + term
    matrix = np.eye(4)
    matrix[:3, :3] = total
    return matrix


angles = st.floats(-3, 3)


@given(angles, st.floats(-2, 2), angles)
@settings(deadline=None)
def test_transforms_are_explicit_products(turn: float, slide: float, spin: float) -> None:
    got = link_transforms(ARM, {"turn": turn, "slide": slide, "spin": spin})
    upper = (translation(0, 0, 2) @ rotation("z", 0.3) @ rotation("y", 0.2) @ rotation("x", 0.1)) @ exponential(
        np.array([1, 2, 2]) / 3, turn
    )
    slider = upper @ translation(1, 0, 0) @ rotation("y", 0.7) @ translation(0, slide / 2**0.5, slide / 2**0.5)
    expected = {
        "base": np.eye(4),
        "upper": upper,
        "slider": slider,
        "tool": slider @ translation(0, 0, 0.1) @ rotation("x", 0.3),
        "fork": rotation("z", -spin),
    }
    assert set(got) == set(expected)
    for name, matrix in expected.items():
        np.testing.assert_allclose(got[name], matrix, atol=1e-13, err_msg=name)


@given(mutually_broadcastable_shapes(num_shapes=2, max_dims=3, max_side=3), st.data())
@settings(deadline=None, max_examples=50)
def test_batches_broadcast_and_agree_with_single_samples(shapes: object, data: st.DataObject) -> None:
    first, second = shapes.input_shapes  # type: ignore[attr-defined]
    turn = data.draw(arrays(float, first, elements=angles))
    slide = data.draw(arrays(float, second, elements=angles))
    batch = np.broadcast_shapes(first, second)
    got = link_transforms(ARM, {"turn": turn, "slide": slide})
    full_turn, full_slide = np.broadcast_arrays(turn, slide)
    for name, matrices in got.items():
        assert matrices.shape == (*batch, 4, 4), name
        assert matrices.flags.writeable
        for index in np.ndindex(*batch):
            single = link_transforms(ARM, {"turn": full_turn[index], "slide": full_slide[index]})[name]
            np.testing.assert_allclose(matrices[index], single, atol=1e-15)


@given(arrays(float, 3, elements=st.floats(-1, 1)).filter(lambda a: np.linalg.norm(a) > 1e-3), st.floats(-1e6, 1e6))
def test_rotations_are_orthogonal_and_keep_their_axis(axis: np.ndarray, angle: float) -> None:
    x, y, z = (axis / np.linalg.norm(axis)).tolist()
    R = axis_rotation((x, y, z), angle)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=2e-15)
    assert math.isclose(np.linalg.det(R), 1.0, rel_tol=1e-14)
    np.testing.assert_allclose(R @ (x, y, z), (x, y, z), atol=1e-15)


def test_missing_coordinates_are_zero() -> None:
    everything_zero = link_transforms(ARM, dict.fromkeys(("turn", "slide", "spin"), 0))
    for name, matrix in link_transforms(ARM, {}).items():
        np.testing.assert_array_equal(matrix, everything_zero[name])


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ({"trun": 1.0}, DescriptionError, "no joint 'trun'"),
        ({"weld": 1.0}, DescriptionError, "'weld' is fixed"),
        ({"turn": math.nan}, NonFiniteError, "'turn' is NaN or infinite in 1 entries"),
        ({"turn": np.zeros(3), "slide": np.zeros(2)}, ShapeError, r"turn \(3,\), slide \(2,\)"),
        ({"turn": "1"}, ShapeError, "real numbers"),
        ({"turn": 1j}, ShapeError, "real numbers"),
        ({"turn": [[1.0], [1.0, 2.0]]}, ShapeError, "differ in length"),
    ],
)
def test_bad_values(values: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        link_transforms(ARM, values)  # type: ignore[arg-type]


def test_the_rows_with_nan_are_named() -> None:
    with pytest.raises(NonFiniteError) as caught:
        link_transforms(ARM, {"turn": [0.0, math.inf, 0.0, math.nan]})
    assert caught.value.rows.tolist() == [1, 3]


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_of_several_coordinates(kind: str) -> None:
    text = f"""<robot name="r"><link name="a"/><link name="b"/>
    <joint name="free" type="{kind}"><parent link="a"/><child link="b"/></joint></robot>"""
    with pytest.raises(UnsupportedError, match=f"'free' is {kind}"):
        link_transforms(parse(text), {})


def test_a_four_bar_closes_where_geometry_says() -> None:
    path = MODELS / "urdf_plus" / "four_bar.urdf"
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    bar = read(path)
    # A parallelogram: crank and rocker of 0.5 m stay parallel, the coupler of 1 m stays parallel to the ground.
    angle = np.linspace(-1.0, 1.0, 5)
    frames = link_transforms(bar, {"joint1": angle, "joint2": -angle, "joint3": angle})
    (loop,) = bar.loops
    ends = [frames[end.link] @ end.origin.matrix() for end in (loop.predecessor, loop.successor)]
    np.testing.assert_allclose(ends[0][..., :3, 3], ends[1][..., :3, 3], atol=1e-15)
