from __future__ import annotations

import dataclasses
import pickle
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from leg_dynamics import closed_form
from leg_dynamics.closed_form import omnileg
from leg_dynamics.description import link_transforms, parse, read, shipped_urdf
from leg_dynamics.description.model import Pose
from leg_dynamics.errors import FormulaAssumptionError


@pytest.fixture(scope="module")
def text():
    return shipped_urdf("omnileg").read_text()


@pytest.fixture(scope="module")
def description():
    return read("omnileg")


@pytest.fixture(scope="module")
def leg(description):
    return omnileg.from_urdf(description)


@pytest.fixture
def robot(text):
    return ElementTree.fromstring(text)


def load(robot, **options):
    return omnileg.from_urdf(parse(ElementTree.tostring(robot, encoding="unicode"), file="mine.urdf"), **options)


def named(robot, tag, name):
    return robot.find(f"{tag}[@name='{name}']")


def numbers(leg):
    bodies = [(b.mass, *b.com, *np.ravel(b.inertia)) for b in leg.bodies]
    return np.concatenate([np.ravel(bodies), (leg.L1, leg.L3, leg.L4, leg.L5, leg.R_C), leg.psi])


def test_the_shipped_file_gives_table_2_and_the_audits_bodies_exactly(leg, golden_leg):
    assert (leg.L1, leg.L3, leg.L4, leg.L5, leg.R_C) == (0.15, 0.075, 0.095, 0.16, 0.05)
    for function in (np.cos, np.sin):
        np.testing.assert_allclose(function(leg.psi), function(golden_leg.psi), atol=1e-15)
    assert leg.gravity == (0.0, 0.0, 9.81)
    assert leg.rotor_inertia == (0.0, 0.0, 0.0)
    assert leg.dissipation == ()
    for found, expected in zip(leg.bodies, golden_leg.bodies, strict=True):
        assert found.name == expected.name
        assert found.mass == pytest.approx(expected.mass, rel=1e-15)
        np.testing.assert_allclose(found.com, expected.com, atol=1e-15)
        np.testing.assert_allclose(found.inertia, expected.inertia, atol=1e-18, rtol=1e-14)


def test_the_leg_survives_pickling_and_cannot_be_changed(leg):
    assert pickle.loads(pickle.dumps(leg)) == leg
    assert leg.parameters["L4"] == 0.095
    with pytest.raises(dataclasses.FrozenInstanceError):
        leg.L1 = 0.2
    with pytest.raises(TypeError):
        leg.parameters["L1"] = 0.2


def test_body_frames_coincide_with_tree_kinematics_of_the_file(description, leg, states):
    """The file's own tree, moved by `tree_coordinates`, puts every link where the formulas put it, loops closed."""
    q = states[0]
    columns = tuple(q.T)
    transforms = link_transforms(description, omnileg.tree_coordinates(leg, columns))
    to_hip = np.linalg.inv(transforms["hip"])
    motions = omnileg.body_motions(leg, columns, (0.0, 0.0, 0.0))
    assert len(motions) == 25
    for name, motion in motions.items():
        pose = to_hip @ transforms[name]
        for i in range(3):
            np.testing.assert_allclose(pose[..., i, 3], motion.origin[i], atol=2e-15)
            for j in range(3):
                np.testing.assert_allclose(pose[..., i, j], motion.turning.rotation[i][j], atol=2e-15)
    for i, found in enumerate(omnileg.foot_position(leg, columns)):
        np.testing.assert_allclose((to_hip @ transforms["foot"])[..., i, 3], found, atol=2e-15)
    for loop in description.loops:
        ends = [transforms[e.link] @ e.origin.matrix() for e in (loop.predecessor, loop.successor)]
        np.testing.assert_allclose(ends[0][..., :3, 3], ends[1][..., :3, 3], atol=2e-15)
        axes = [end[..., :3, :3] @ loop.axis for end in ends]
        np.testing.assert_allclose(*axes, atol=2e-15)


def write_pose(element, matrix):
    pitch = -np.arcsin(matrix[2, 0])
    roll, yaw = np.arctan2(matrix[2, 1], matrix[2, 2]), np.arctan2(matrix[1, 0], matrix[0, 0])
    element.set("xyz", " ".join(repr(float(x)) for x in matrix[:3, 3]))
    element.set("rpy", " ".join(repr(float(x)) for x in (roll, pitch, yaw)))


def read_pose(element):
    values = [tuple(map(float, element.get(key, "0 0 0").split())) for key in ("xyz", "rpy")]
    return Pose(*values).matrix()


def turn_frame(robot, link, rpy):
    """Describe the same mechanism with another orientation of one link's frame."""
    turn = Pose((0.0, 0.0, 0.0), rpy).matrix()
    back = turn.T
    for joint in robot.findall("joint"):
        origin = joint.find("origin")
        if joint.find("child").get("link") == link:
            write_pose(origin, read_pose(origin) @ turn)
            axis = np.array(list(map(float, joint.find("axis").get("xyz").split())))
            joint.find("axis").set("xyz", " ".join(repr(float(x)) for x in back[:3, :3] @ axis))
        elif joint.find("parent").get("link") == link:
            write_pose(origin, back @ read_pose(origin))
    for end in robot.findall("loop/predecessor") + robot.findall("loop/successor"):
        if end.get("link") == link:
            write_pose(end.find("origin"), back @ read_pose(end.find("origin")))
    for origin in named(robot, "link", link).findall("*/origin"):
        write_pose(origin, back @ read_pose(origin))


def test_other_frame_conventions_give_the_same_numbers(robot, leg):
    for link in ("cross_A2", "rod_A1B1", "cross_B3", "knee", "shaft_A4B4", "link_C2D2", "link_D3E3", "foot"):
        turn_frame(robot, link, (0.4, -0.7, 1.1))
    np.testing.assert_allclose(numbers(load(robot)), numbers(leg), atol=1e-15)


def test_a_joint_origin_may_slide_along_its_axis(robot, leg):
    named(robot, "joint", "theta13").find("origin").set("xyz", "0.02 0 0.15")
    named(robot, "joint", "theta14").find("origin").set("xyz", "-0.02 -0.075 0")
    body = named(robot, "link", "cross_B1")
    for origin in body.findall("*/origin"):
        moved = read_pose(origin)
        moved[0, 3] -= 0.02
        write_pose(origin, moved)
    np.testing.assert_allclose(numbers(load(robot)), numbers(leg), atol=1e-15)


def test_links_fixed_to_a_body_are_merged_into_it(robot, leg):
    payload = ElementTree.fromstring(
        "<root><link name='pad'><inertial><origin xyz='0 0.1 0'/><mass value='0.11'/><inertia ixx='1e-4' iyy='2e-4' "
        "izz='2.5e-4' ixy='1e-5' ixz='0' iyz='0'/></inertial></link><link name='bolt'><inertial><mass value='0.07'/>"
        "<inertia ixx='0' iyy='0' izz='0' ixy='0' ixz='0' iyz='0'/></inertial></link>"
        "<joint name='pad_mount' type='fixed'><parent link='foot'/><child link='pad'/>"
        "<origin xyz='0.03 0 0.02' rpy='0.3 -0.5 1.1'/></joint>"
        "<joint name='bolt_mount' type='fixed'><parent link='pad'/><child link='bolt'/><origin xyz='0 0 0.05'/></joint>"
        "</root>"
    )
    robot.extend(list(payload))
    old = {b.name: b for b in leg.bodies}["foot"]
    new = {b.name: b for b in load(robot).bodies}["foot"]
    turn, mount = Pose((0.0, 0.0, 0.0), (0.3, -0.5, 1.1)).rotation(), np.array([0.03, 0.0, 0.02])
    pad = np.array([[1e-4, 1e-5, 0], [1e-5, 2e-4, 0], [0, 0, 2.5e-4]])
    parts = [
        (old.mass, np.array(old.com), np.array(old.inertia)),
        (0.11, mount + turn @ [0.0, 0.1, 0.0], turn @ pad @ turn.T),
        (0.07, mount + turn @ [0.0, 0.0, 0.05], np.zeros((3, 3))),
    ]
    mass = sum(m for m, _, _ in parts)
    com = sum(m * c for m, c, _ in parts) / mass
    about_origin = sum(i + m * (c @ c * np.eye(3) - np.outer(c, c)) for m, c, i in parts)
    assert new.mass == pytest.approx(mass, rel=1e-15)
    np.testing.assert_allclose(new.com, com, atol=1e-16)
    about_com = about_origin - mass * (com @ com * np.eye(3) - np.outer(com, com))
    np.testing.assert_allclose(new.inertia, about_com, atol=1e-17)


def test_a_link_without_inertia_is_massless(robot):
    gear = named(robot, "link", "driven_gear_2")
    gear.remove(gear.find("inertial"))
    body = {b.name: b for b in load(robot).bodies}["driven_gear_2"]
    assert body == omnileg.Body("driven_gear_2", 0.0, (0.0, 0.0, 0.0), ((0.0,) * 3,) * 3)


def test_rotor_inertia_counts_with_the_square_of_the_reduction(text):
    changed = re.sub(r"<mechanicalReduction>1<", "<mechanicalReduction>9<", text, count=1)
    changed = re.sub(r"<rotorInertia>0<", "<rotorInertia>1e-5<", changed, count=1)
    np.testing.assert_allclose(omnileg.from_urdf(parse(changed)).rotor_inertia, (81e-5, 0.0, 0.0), rtol=1e-15)


def test_damping_and_friction_of_passive_joints_are_carried(robot):
    for name, damping, friction in (("theta23", "0.2", "0"), ("phi_D2", "0", "0.3")):
        joint = named(robot, "joint", name)
        dynamics = joint.find("dynamics")
        if dynamics is None:
            dynamics = ElementTree.SubElement(joint, "dynamics")
        dynamics.attrib.update(damping=damping, friction=friction)
    expected = (omnileg.Dissipation("theta23", 0.2, 0.0), omnileg.Dissipation("phi_D2", 0.0, 0.3))
    assert load(robot).dissipation == expected


def test_gravity_follows_the_attitude_of_the_hip(robot):
    mount = next(j for j in robot.findall("joint") if j.find("child").get("link") == "hip")
    mount.find("origin").set("rpy", "0 1.5707963267948966 0")
    np.testing.assert_allclose(load(robot).gravity, (9.81, 0.0, 0.0), atol=1e-14)


def test_lengths_may_differ_from_table_2():
    changed = omnileg.from_urdf(read("omnileg", parameters={"L1": 0.2, "L4": 0.1, "R_C": 0.06}))
    np.testing.assert_allclose((changed.L1, changed.L4, changed.R_C), (0.2, 0.1, 0.06), atol=1e-15)


def test_an_xml_declaration_is_no_obstacle(text, leg):
    declared = '<?xml version="1.0" encoding="ISO-8859-1"?>\n' + re.sub(r"^\s*<\?xml.*?\?>", "", text)
    assert omnileg.from_urdf(parse(declared)) == leg


def set_attribute(tag, name, path, key, value):
    def change(robot):
        named(robot, tag, name).find(path).set(key, value)

    return change


def set_ratio(robot):
    named(robot, "coupling", "bevel_2").find("ratio").set("value", "2")


def drop(tag, name):
    def change(robot):
        robot.remove(named(robot, tag, name))

    return change


def set_type(tag, name, kind):
    def change(robot):
        named(robot, tag, name).set("type", kind)

    return change


def add_arm(robot):
    robot.append(ElementTree.fromstring("<link name='arm'/>"))
    robot.append(
        ElementTree.fromstring(
            "<joint name='elbow' type='continuous' independent='false'><parent link='foot'/><child link='arm'/>"
            "<axis xyz='0 0 1'/></joint>"
        )
    )


def add_loop(robot):
    copy = ElementTree.fromstring(ElementTree.tostring(named(robot, "loop", "loop_B2")))
    copy.set("name", "again")
    robot.append(copy)


def add_coupling(robot):
    copy = ElementTree.fromstring(ElementTree.tostring(named(robot, "coupling", "bevel_1")))
    copy.set("name", "again")
    robot.append(copy)


def swap_independent(robot):
    named(robot, "joint", "gamma").set("independent", "false")
    named(robot, "joint", "gamma_output").set("independent", "true")


def make_mimic(robot):
    robot.remove(named(robot, "coupling", "bevel_1"))
    named(robot, "joint", "gamma_C1").append(ElementTree.fromstring("<mimic joint='gamma_output'/>"))


def move_transmission(robot):
    named(robot, "transmission", "gamma_transmission").find("joint").set("name", "gamma_output")


def freeze(robot):
    named(robot, "joint", "phi_D2").set("type", "fixed")
    for configuration in robot.findall("configuration"):
        robot.remove(configuration)


def make_spherical(robot):
    loop = named(robot, "loop", "loop_E3")
    loop.set("type", "spherical")
    loop.remove(loop.find("axis"))


def loosen_gear(robot):
    mount = named(robot, "joint", "driven_gear_1_mount")
    mount.find("parent").set("link", "knee")


BROKEN = {
    "axis": (set_attribute("joint", "theta22", "axis", "xyz", "0 1 0"), "axis of joint 'theta22'"),
    "rod length": (set_attribute("joint", "theta23", "origin", "xyz", "0 0 0.1501"), "centre of joint 'theta23'"),
    "chain 3 radius": (set_attribute("joint", "theta31", "origin", "xyz", "0 -0.08 0.01"), "centre of joint 'theta31'"),
    "cardan centre": (set_attribute("joint", "cardan_A4_y", "origin", "xyz", "0.001 0 0"), "joint 'cardan_A4_y'"),
    "input shaft": (set_attribute("joint", "gamma", "origin", "xyz", "0 0.001 0"), "centre of joint 'gamma'"),
    "shank length": (set_attribute("joint", "phi_D3", "origin", "xyz", "0 0 0.1"), "centre of joint 'phi_D3'"),
    "shank radius": (set_attribute("joint", "gamma_C1", "origin", "xyz", "0.06 0 0.16"), "radius of joint 'gamma_C2'"),
    "shank height": (
        set_attribute("joint", "gamma_C2", "origin", "xyz", "-0.02499999999999999 0.04330127018922194 0.17"),
        "centre of joint 'gamma_C2'",
    ),
    "tangential hinge": (
        set_attribute("joint", "gamma_C3", "origin", "rpy", "0 0 1.0"),
        "centre of joint 'gamma_C3'",
    ),
    "foot offset": (set_attribute("joint", "epsilon_E1", "origin", "xyz", "-0.04 0 0.095"), "origin of link 'foot'"),
    "no rod": (set_attribute("joint", "theta13", "origin", "xyz", "0 0 0"), "length L1"),
    "prismatic": (set_type("joint", "theta13", "prismatic"), "type of joint 'theta13'"),
    "fixed": (freeze, "joint 'phi_D2' is missing or fixed"),
    "extra joint": (add_arm, "joint 'elbow'"),
    "independent": (swap_independent, "independent joints"),
    "mimic": (make_mimic, "joint 'gamma_C1' is a mimic"),
    "transmission": (move_transmission, "transmission 'gamma_transmission'"),
    "loose gear": (loosen_gear, "link 'driven_gear_1'"),
    "no loop": (drop("loop", "loop_B4"), "loop between cross_B4 and shaft_A4B4"),
    "second loop": (add_loop, "loop 'again'"),
    "loop type": (make_spherical, "type of loop 'loop_E3'"),
    "loop axis": (set_attribute("loop", "loop_B3", "axis", "xyz", "1 0 0"), "loop 'loop_B3' at its predecessor"),
    "loop place": (
        set_attribute("loop", "loop_B2", "successor/origin", "xyz", "0 0.001 0"),
        "loop 'loop_B2' at its successor",
    ),
    "open loop": (set_attribute("loop", "loop_B2", "successor/origin", "xyz", "0.001 0 0"), "gap .* 'loop_B2'"),
    "turned loop": (
        set_attribute("loop", "loop_B2", "successor/origin", "rpy", "0 3.141592653589793 0"),
        "axis of loop 'loop_B2' in the zero pose is opposite",
    ),
    "no coupling": (drop("coupling", "bevel_3"), "coupling between 'output_shaft' and 'driven_gear_3'"),
    "second coupling": (add_coupling, "coupling 'again'"),
    "gear ratio": (set_ratio, "ratio of coupling 'bevel_2'"),
    "coupled to the motor": (
        set_attribute("coupling", "bevel_1", "predecessor", "link", "input_shaft"),
        "coupling 'bevel_1'",
    ),
}


@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
@pytest.mark.parametrize("case", BROKEN)
def test_a_file_that_breaks_an_assumption_is_refused_by_name(robot, case):
    change, message = BROKEN[case]
    change(robot)
    with pytest.raises(FormulaAssumptionError, match=message) as caught:
        load(robot)
    assert "mine.urdf" in str(caught.value)
    assert "pinocchio" in str(caught.value)
    assert caught.value.expected is not None


def test_the_tolerance_is_the_callers(robot):
    named(robot, "joint", "theta23").find("origin").set("xyz", "0 0 0.1500001")
    with pytest.raises(FormulaAssumptionError, match="theta23") as caught:
        load(robot)
    assert caught.value.tolerance == 1e-9
    assert load(robot, tolerance=1e-6).L1 == 0.15


@pytest.mark.parametrize("link", ["knee", "hip"])
def test_a_missing_link_is_named(text, link):
    renamed = re.sub(rf'(link|name)="{link}"', r'\1="other"', text)
    with pytest.raises(FormulaAssumptionError, match=f"link '{link}' is missing"):
        omnileg.from_urdf(parse(renamed))


def test_formulas_are_found_by_the_name_of_the_leg():
    assert closed_form.find("omnileg") is omnileg
    assert "omnileg" in closed_form.names()
    for name in ("algebra", "route", "_omnileg_file", "no_such_leg", "../omnileg", "omnileg.urdf", ""):
        assert closed_form.find(name) is None
    assert "route" not in closed_form.names()


@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_a_gear_pair_that_turns_backwards_is_refused(robot):
    ratio = named(robot, "coupling", "bevel_2").find("ratio")
    ratio.set("value", "1")
    assert load(robot).L1 == 0.15
    ratio.set("value", "-1")
    with pytest.raises(FormulaAssumptionError, match="ratio of coupling 'bevel_2'") as caught:
        load(robot)
    assert (caught.value.found, caught.value.expected) == (-1.0, 1.0)
