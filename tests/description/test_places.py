"""Modules and faces by the names of links, and errors that name them."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import read, shipped_urdf, shipped_xacro
from leg_dynamics.description.modules import Face, read_assembly
from leg_dynamics.description.places import face_of_foot, module_of_joint
from leg_dynamics.errors import JointLimitError, NonFiniteError, OutOfReachError, SingularityError

ASSEMBLIES = ("quadruped", "quadruped_leg", "quadruped_leg_reversed", "ring", "snake")


@pytest.mark.parametrize("rendered", [False, True])
@pytest.mark.parametrize("name", ASSEMBLIES)
def test_joints_and_feet_are_where_the_assembly_has_them(name, rendered):
    assembly = read_assembly(shipped_xacro(name))
    description = read(shipped_urdf(name)) if rendered else read(name)
    joints = {joint.name: joint.module for joint in assembly.joints}
    assert {joint: module_of_joint(description, joint) for joint in joints} == joints
    feet = {foot: face_of_foot(description, foot) for foot in assembly.feet}
    assert feet == dict(assembly.feet)
    others = [joint.name for joint in description.joints if joint.name not in joints]
    assert {module_of_joint(description, joint) for joint in others} <= {None}
    assert face_of_foot(description, "base") is face_of_foot(description, None) is None
    assert face_of_foot(description, "no_such_link") is module_of_joint(description, "no_such_joint") is None


def test_a_face_can_be_the_foot():
    assert face_of_foot(read("snake"), "m01_face_U") == Face("m01", "U")


def test_other_legs_have_no_modules():
    for name in ("hexapod_leg", "omnileg"):
        description = read(name)
        assert {module_of_joint(description, joint.name) for joint in description.joints} == {None}
        assert face_of_foot(description, "foot") is None


@pytest.mark.parametrize("route", ["closed_form", "pinocchio", "symbolic"])
def test_inverse_kinematics_names_module_and_face(route):
    leg = ld.load("quadruped_leg", route=route)
    bent = leg.foot_position(np.radians([0.0, -20.0, -75.0]))
    with pytest.raises(JointLimitError, match=r"theta3 = .* \(theta3 is a joint of module 'm01'\)$") as caught:
        leg.inverse_kinematics(bent)
    assert (caught.value.joint, caught.value.module, caught.value.face) == ("theta3", "m01", None)
    assert caught.value.margin == pytest.approx(np.radians(-5.0), abs=1e-6)
    swung = leg.foot_position(np.radians([75.0, -20.0, -45.0]))
    with pytest.raises(JointLimitError) as caught:
        leg.inverse_kinematics(np.array([leg.foot_position(leg.limits.lower * 0.5), swung]))
    assert (caught.value.joint, caught.value.module) == ("theta1", "m02")
    assert caught.value.rows.tolist() == [1]
    with pytest.raises(OutOfReachError, match=r"\(the foot is on face L of module 'm01'\)$") as caught:
        leg.inverse_kinematics([1.0, 0.0, 0.0])
    assert (caught.value.module, caught.value.face) == ("m01", "L")
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.module, str(again)) == ("m01", str(caught.value))
    with pytest.raises(NonFiniteError) as finite:
        leg.inverse_kinematics([np.nan, 0.0, 0.0])
    assert "module" not in str(finite.value)


def test_a_singular_foot_is_on_a_face():
    leg = ld.load("quadruped_leg_reversed")
    with pytest.raises(SingularityError, match=r"\(the foot is on face U of module 'm01'\)$"):
        leg.inverse_kinematics([0.0, 0.0, -0.2])


def test_other_legs_say_what_they_said():
    leg = ld.load("hexapod_leg")
    with pytest.raises(JointLimitError, match=r"limits='ignore'$") as caught:
        leg.inverse_kinematics([5.0, 1.0, 0.5])
    assert "module" not in str(caught.value)
    assert not hasattr(caught.value, "module")
