"""The model that pinocchio read is compared with the numbers of the description, body by body."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from leg_dynamics.description import parse
from leg_dynamics.errors import DescriptionError
from leg_dynamics.mechanism.tree import tree_urdf
from leg_dynamics.mechanism.tree_check import check_tree

TREE = """<robot name="two">
<link name="base"><inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
<link name="mount"/>
<link name="arm"><inertial><origin xyz="0.1 0.2 -0.3" rpy="0.3 -0.2 0.1"/><mass value="0.8"/>
 <inertia ixx="0.003" ixy="0.0002" ixz="-0.0001" iyy="0.0031" iyz="0.0003" izz="0.0029"/></inertial></link>
<link name="tip"><inertial><origin xyz="0 0 0.4"/><mass value="0.5"/>
 <inertia ixx="0.001" iyy="0.002" izz="0.0015"/></inertial></link>
<joint name="bolt" type="fixed"><parent link="base"/><child link="mount"/><origin xyz="1 0 0" rpy="1 2 3"/></joint>
<joint name="turn" type="revolute"><parent link="mount"/><child link="arm"/><origin xyz="0 0.05 0.2" rpy="0 0.1 0"/>
 <axis xyz="0 1 0"/></joint>
<joint name="weld" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0.3 0 0" rpy="0 0 0.5"/></joint>
</robot>"""


def of(text):
    description = parse(text)
    return pin.buildModelFromXML(tree_urdf(description)), description


def test_what_the_description_says_is_accepted():
    check_tree(*of(TREE))


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('mass value="0.5"', 'mass value="0.5000001"', "mass"),
        ('mass value="0.5"', 'mass value="0"', "mass"),
        ('xyz="0 0 0.4"', 'xyz="0 0 0.4000001"', "first moment"),
        ('iyy="0.0031"', 'iyy="0.0031001"', "inertia"),
        ('rpy="0.3 -0.2 0.1"', 'rpy="0.3 -0.2 0.1001"', "inertia"),
        ('xyz="0.3 0 0"', 'xyz="0.3001 0 0"', "first moment"),
        ('xyz="0 0.05 0.2"', 'xyz="0 0.05 0.2000001"', "places it 9.02e-08 m"),
        ('rpy="1 2 3"', 'rpy="1 2 3.0001"', "entries of the rotation"),
    ],
)
def test_any_other_number_is_an_error_with_file_and_line(old, new, word):
    model, _ = of(TREE)
    assert old in TREE
    with pytest.raises(DescriptionError, match=f"'turn' otherwise.*{word}") as caught:
        check_tree(model, parse(TREE.replace(old, new), file="two.urdf"))
    assert (caught.value.file, caught.value.line, caught.value.joint) == ("two.urdf", 9, "turn")


def test_not_a_number_is_no_agreement():
    model, description = of(TREE)
    model.jointPlacements[1].translation[:] = np.nan
    with pytest.raises(DescriptionError, match="'turn' otherwise"):
        check_tree(model, description)


def test_lengths_and_masses_of_any_size_agree_with_themselves():
    for length, mass in (("1e100", "1"), ("1e-300", "1e100"), ("1e100", "1e-10"), ("1e5", "1e-3")):
        text = TREE.replace("0.3 0 0", f"{length} 0 {length}").replace('value="0.5"', f'value="{mass}"')
        check_tree(*of(text))
