from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from leg_dynamics.description import link_transforms, parse
from leg_dynamics.errors import DescriptionError, UnsupportedError
from leg_dynamics.mechanism import tree as tree_module
from leg_dynamics.mechanism.mechanism import Mechanism
from leg_dynamics.mechanism.tree import UNLIMITED, FrameMemory, Tree, create_data, tree_urdf


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


def test_a_joints_armature_adds_to_its_rotor(lab):
    text = lab.open_chain().motor("knee", reduction=-6.0, rotor_inertia=2e-4)
    xml = text.xml.replace('<joint name="knee" ', '<joint  name="knee" ', 1)
    head, tail = xml.split('<joint  name="knee" ', 1)
    xml = f'{head}<joint name="knee" {tail.replace("</joint>", """<dynamics armature="0.3"/></joint>""", 1)}'
    tree = Tree.from_description(parse(xml))
    armature = dict(zip(tree.joint_names, tree.model.armature, strict=True))
    assert armature == pytest.approx({"yaw": 0.0, "knee": 0.3 + 36 * 2e-4, "strut": 0.0})


FULL = '<inertial><mass value="2"/><inertia ixx="0.02" iyy="0.03" izz="0.025"/></inertial>'
POINT = '<inertial><origin xyz="0 0.1 0"/><mass value="2"/><inertia ixx="0" iyy="0" izz="0"/></inertial>'


@pytest.mark.parametrize(
    ("first", "second", "armature", "expected"),
    [
        (FULL, FULL, 0.0, True),
        ("", FULL, 0.0, False),
        ("", FULL, 0.1, True),
        (FULL, "", 0.1, False),
        (POINT, FULL, 0.0, False),
        (FULL, POINT, 0.0, False),
    ],
)
def test_massless_links_may_make_the_mass_matrix_singular(first, second, armature, expected):
    text = (
        f'<robot name="r"><link name="base"/><link name="one">{first}</link><link name="two">{second}</link>'
        '<joint name="a" type="continuous"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>'
        f'<dynamics armature="{armature}"/></joint>'
        '<joint name="b" type="continuous"><parent link="one"/><child link="two"/><axis xyz="0 1 0"/></joint></robot>'
    )
    assert Tree.from_description(parse(text)).has_inertia_everywhere() == expected


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_of_several_coordinates_are_refused(lab, kind):
    text = lab.Text().joint("free", kind, "base", "body")
    with pytest.raises(UnsupportedError, match="'free' is " + kind):
        Tree.from_description(parse(text.xml))


def test_a_tree_that_pinocchio_reads_differently_is_refused(lab, monkeypatch):
    description = parse(lab.open_chain().xml)
    other = tree_urdf(parse(lab.FourBar().text().xml))
    monkeypatch.setattr(tree_module, "tree_urdf", lambda _: other)
    with pytest.raises(DescriptionError, match="other joints"):
        Tree.from_description(description)
    monkeypatch.setattr(tree_module, "tree_urdf", lambda _: "<robot")
    with pytest.raises(DescriptionError, match="pinocchio cannot read"):
        Tree.from_description(description)


LENIENT = """<robot name="lenient" version="1.1">
<link name="base"/>
<link name="arm"><visual><geometry><box size="1 1 1"/></geometry></visual>
 <inertial><mass value="1"/><inertia ixx="1" iyy="2" izz="2.5"/></inertial></link>
<link name="slide"/><link name="wheel"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><dynamics/></joint>
<joint name="push" type="prismatic"><parent link="arm"/><child link="slide"/><axis/><limit lower="-1" upper="2"/>
</joint>
<joint name="spin" type="continuous"><parent link="arm"/><child link="wheel"/><axis xyz="0 0 1"/><limit effort="3"/>
 <dynamics friction="0.5"/></joint>
</robot>"""


def test_what_urdf_may_leave_out_is_filled_in_for_pinocchio():
    description = parse(LENIENT)
    model = Tree.from_description(description).model
    index = {name: model.joints[model.getJointId(name)].idx_q for name in ("turn", "push")}
    assert model.lowerPositionLimit[index["turn"]] == -UNLIMITED
    assert model.upperPositionLimit[index["turn"]] == UNLIMITED
    assert (model.lowerPositionLimit[index["push"]], model.upperPositionLimit[index["push"]]) == (-1.0, 2.0)
    root = ElementTree.fromstring(tree_urdf(description))
    spin = root.find("joint[@name='spin']")
    assert [float(spin.find("limit").get(name)) for name in ("effort", "velocity")] == [3.0, UNLIMITED]
    assert [float(spin.find("dynamics").get(name)) for name in ("damping", "friction")] == [0.0, 0.5]
    np.testing.assert_array_equal(model.inertias[model.getJointId("turn")].inertia, np.diag([1.0, 2.0, 2.5]))


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
@pytest.mark.parametrize("axis", ["0 1e160 0", "0 1e308 0", "1e200 1e200 0", "1e-8 0 1e-8", "-3e-9 4e-9 0"])
def test_an_axis_of_any_length_moves_as_the_unit_vector_does(axis, kind):
    text = (
        LENIENT.replace('type="continuous"', f'type="{kind}"').replace("0 0 1", axis).replace('<limit effort="3"/>', "")
    )
    description = parse(text)
    model = Tree.from_description(description).model
    index = model.getJointId("spin")
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    moving = pin.getJointJacobian(model, data, index, pin.LOCAL)[:, model.joints[index].idx_v]
    unit = description.joint("spin").axis
    np.testing.assert_allclose(moving[:3] if kind == "prismatic" else moving[3:], unit, rtol=0.0, atol=1e-15)


def test_a_mass_that_pinocchio_cannot_add_up_is_refused():
    with pytest.raises(UnsupportedError, match=r"'turn' carries 1e-17 kg.*least is 2.22e-16"):
        Tree.from_description(parse(LENIENT.replace('mass value="1"', 'mass value="1e-17"')))


def test_what_this_route_cannot_compute_is_said_with_file_and_line(lab):
    with pytest.raises(UnsupportedError) as caught:
        Tree.from_description(parse(LENIENT.replace('mass value="1"', 'mass value="1e-17"'), file="light.urdf"))
    assert (caught.value.file, caught.value.line) == ("light.urdf", 6)
    assert str(caught.value).startswith("light.urdf:6: joint 'turn' carries 1e-17 kg")
    long = "".join(
        f'<link name="l{n + 1}"/><joint name="j{n}" type="fixed"><parent link="l{n}"/><child link="l{n + 1}"/>'
        "</joint>\n"
        for n in range(1200)
    )
    with pytest.raises(UnsupportedError, match="1200 joints in a chain") as caught:
        Tree.from_description(parse(f'<robot name="long"><link name="l0"/>\n{long}</robot>', file="long.urdf"))
    assert (caught.value.file, caught.value.line) == ("long.urdf", 1002)
    many = long.replace("fixed", "continuous")
    with pytest.raises(UnsupportedError, match="1200 tree joints are too many") as caught:
        Tree.from_description(parse(f'<robot name="many"><link name="l0"/>\n{many}</robot>', file="many.urdf"))
    assert (caught.value.file, caught.value.line) == ("many.urdf", 408)


def test_the_completed_text_is_the_same_tree(omnileg_description):
    completed = pin.buildModelFromXML(tree_urdf(omnileg_description))
    given = pin.buildModelFromXML(omnileg_description.urdf)
    assert list(completed.names) == list(given.names)
    for one, other in zip(completed.inertias, given.inertias, strict=True):
        assert one == other
    for one, other in zip(completed.jointPlacements, given.jointPlacements, strict=True):
        assert one == other


BLANKS = """<robot name="blanks">
<link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0.2 -0.3" rpy="0.3 -0.2 0.1"/><mass value="0.8"/>
 <inertia ixx="0.003" ixy="0.0002" ixz="-0.0001" iyy="0.0031" iyz="0.0003" izz="0.0029"/></inertial></link>
<link name="tip"><inertial><origin xyz="0 0 0.4"/><mass value="0.5"/>
 <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.0015"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0.05 0.2" rpy="0 0.1 0"/>
 <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="5" velocity="6"/></joint>
<joint name="weld" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0.3 0 0" rpy="0 0 0.5"/></joint>
</robot>"""


@pytest.mark.parametrize("blank", [" ", "&#9;", "\t", "&#10;", "&#13;", "\n"])
@pytest.mark.parametrize("where", ["before", "after", "between"])
def test_white_space_in_a_number_changes_nothing(blank, where):
    def spaced(found):
        value = found[2]
        value = {"before": blank + value, "after": value + blank, "between": value.replace(" ", f" {blank}")}[where]
        return f'{found[1]}="{value}"'

    numbers = r"\b(xyz|rpy|value|i[xyz][xyz]|lower|upper|effort|velocity)=\"([^\"]*)\""
    expected, found = (Tree.from_description(parse(t)).model for t in (BLANKS, re.sub(numbers, spaced, BLANKS)))
    # Of the file, by hand: the arm and the tip that is welded to it.
    assert found.inertias[1].mass == pytest.approx(1.3, abs=1e-15)
    assert found.inertias[1].inertia.trace() > 0.0145
    assert list(found.inertias) == list(expected.inertias)
    assert list(found.jointPlacements) == list(expected.jointPlacements)
    np.testing.assert_array_equal(found.upperPositionLimit, expected.upperPositionLimit)


def test_working_memory_is_refused_where_it_would_not_fit(lab, monkeypatch):
    model = Tree.from_description(parse(lab.open_chain().xml)).model
    assert create_data(model).J.shape == (6, 3)
    with monkeypatch.context() as patch:
        patch.setattr(tree_module, "MOST_DATA_BYTES", tree_module.DATA_BYTES * 27 - 1)
        with pytest.raises(UnsupportedError, match="3 tree joints are too many"):
            create_data(model)

    class Exhausted:
        nv = 3

        def createData(self):
            raise MemoryError

    with pytest.raises(UnsupportedError, match="3 tree joints are too many"):
        create_data(Exhausted())


def test_a_chain_of_three_thousand_joints_is_a_named_error(lab):
    text = lab.Text("chain").link("l0", 0.0)
    for number in range(3000):
        text.joint(f"j{number}", "revolute", f"l{number}", f"l{number + 1}")
    with pytest.raises(UnsupportedError, match=r"3000 tree joints are too many.*fix joints"):
        Mechanism(parse(text.xml))
