from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from leg_dynamics.description import link_transforms, parse
from leg_dynamics.errors import DescriptionError, UnsupportedError
from leg_dynamics.mechanism.tree import FrameMemory, Tree


@pytest.fixture
def tree(lab):
    return Tree.from_description(parse(lab.open_chain().xml))


def test_tree_coordinates_place_the_links_as_plain_numpy_does(lab, tree):
    description = parse(lab.open_chain().xml)
    q = dict(zip(tree.joint_names, (2.5, -0.7, 0.11), strict=True))
    expected = link_transforms(description, q)
    data = tree.model.createData()
    pin.framesForwardKinematics(tree.model, data, tree.to_configuration(np.array(list(q.values()))))
    for link, transform in expected.items():
        frame = tree.model.getFrameId(link, pin.FrameType.BODY)
        np.testing.assert_allclose(data.oMf[frame].homogeneous, transform, atol=1e-14)


def test_continuous_joints_are_stored_as_cosine_and_sine(tree):
    assert (tree.model.nq, tree.model.nv) == (4, 3)
    q = np.array([0.3, -0.4, 0.5])
    configuration = tree.to_configuration(q)
    index = tree.circle_index[0]
    assert configuration[index : index + 2] == pytest.approx([math.cos(q[tree.circle_coordinate[0]]), math.sin(0.3)])
    np.testing.assert_array_equal(configuration[tree.angle_index], q[tree.plain_coordinate])


def test_without_continuous_joints_the_coordinates_are_the_configuration(lab):
    tree = Tree.from_description(parse(lab.slider_crank().xml))
    q = np.array([0.1, 0.2, 0.3])
    assert tree.to_configuration(q) is q


def test_frame_memory_reads_pinocchios_frames_in_place(lab, omnileg_description):
    tree = Tree.from_description(omnileg_description)
    data = tree.model.createData()
    memory = FrameMemory(tree.model, data)
    assert memory._view is not None, "the layout changed: every evaluation now copies"
    rng = np.random.default_rng(0)
    for _ in range(3):
        pin.framesForwardKinematics(tree.model, data, rng.uniform(-1, 1, tree.model.nq))
        rows = memory.rows()
        for index, placement in enumerate(data.oMf):
            np.testing.assert_array_equal(rows[4 * index : 4 * index + 3], placement.rotation.T)
            np.testing.assert_array_equal(rows[4 * index + 3], placement.translation)
        with pytest.raises(ValueError, match="read-only"):
            rows[0, 0] = 1.0


def test_frame_memory_copies_the_same_rows_where_it_cannot_map(tree, monkeypatch):
    data = tree.model.createData()
    pin.framesForwardKinematics(tree.model, data, tree.to_configuration(np.array([1.0, 2.0, 0.3])))
    mapped = FrameMemory(tree.model, data).rows()
    monkeypatch.setattr(FrameMemory, "_map", lambda self: None)
    copied = FrameMemory(tree.model, data)
    assert copied._view is None
    np.testing.assert_array_equal(copied.rows(), mapped)


def test_the_universe_is_frame_zero_and_a_zero_vector(tree):
    """The closure takes the world origin's row where a row has no lever."""
    data = tree.model.createData()
    pin.framesForwardKinematics(tree.model, data, tree.to_configuration(np.array([1.0, 2.0, 0.3])))
    np.testing.assert_array_equal(FrameMemory(tree.model, data).rows()[3], np.zeros(3))


def test_support_names_the_joints_that_move_a_frame(lab):
    tree = Tree.from_description(parse(lab.FourBar().text().xml))
    frame = tree.add_frame("tip", "coupler_link", pin.SE3.Identity())
    moved = [name for name, moves in zip(tree.joint_names, tree.support(frame), strict=True) if moves]
    assert sorted(moved) == ["coupler", "crank"]
    assert not tree.support(tree.add_frame("fixed", "base", pin.SE3.Identity())).any()


def test_rotor_inertia_passes_the_reduction_squared_and_adds_up(lab):
    text = lab.open_chain().motor("knee", reduction=-6.0, rotor_inertia=2e-4).motor("strut", 10.0, 1e-4)
    tree = Tree.from_description(parse(text.xml))
    armature = dict(zip(tree.joint_names, tree.model.armature, strict=True))
    assert armature == pytest.approx({"yaw": 0.0, "knee": 36 * 2e-4, "strut": 100 * 1e-4})


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_of_several_coordinates_are_refused(lab, kind):
    text = lab.Text().joint("free", kind, "base", "body")
    with pytest.raises(UnsupportedError, match="'free' is " + kind):
        Tree.from_description(parse(text.xml))


def test_a_tree_that_pinocchio_reads_differently_is_refused(lab):
    import dataclasses

    description = parse(lab.open_chain().xml)
    other = dataclasses.replace(description, urdf=lab.FourBar().text().xml)
    with pytest.raises(DescriptionError, match="other joints"):
        Tree.from_description(other)
    with pytest.raises(DescriptionError, match="pinocchio cannot read"):
        Tree.from_description(dataclasses.replace(description, urdf="<robot"))
