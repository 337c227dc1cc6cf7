"""Legs of a robot: their names and feet, and the part of the robot that each of them is."""

from __future__ import annotations

import itertools
import pickle

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import link_transforms, parse, read
from leg_dynamics.description.legs import LegPart, leg_part, legs_of, part_of
from leg_dynamics.description.robot_data import PREFIX
from leg_dynamics.errors import DescriptionError

pytestmark = pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
BODY = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def link(name: str) -> str:
    return f'<link name="{name}">{BODY}</link>\n'


def joint(name: str, parent: str, child: str, kind: str = "revolute", inner: str = "") -> str:
    axis = "" if kind in ("fixed", "floating") else '<axis xyz="0 1 0"/>'
    limit = '<limit lower="-2" upper="2" effort="9" velocity="8"/>' if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 -0.5"/>{axis}{limit}{inner}</joint>\n'
    )


def chain(parent: str, *names: str, kinds: str = "") -> str:
    """Links one below the other, joint NAME above link NAME; `kinds` has an f where the joint is fixed."""
    text = ""
    for name, kind in itertools.zip_longest(names, kinds, fillvalue="r"):
        text += link(name) + joint(name, parent, name, "fixed" if kind == "f" else "revolute")
        parent = name
    return text


def robot(*parts: str, name: str = "walker") -> str:
    return f'<?xml version="1.0" encoding="latin-1"?>\n<robot name="{name}">\n{link("base")}{"".join(parts)}</robot>\n'


def legs(*parts: str) -> dict[str, LegPart]:
    return dict(legs_of(parse(robot(*parts))))


def feet(*parts: str) -> dict[str, str | None]:
    return {name: leg.foot for name, leg in legs(*parts).items()}


# ------------------------------------------------------------------ names


@pytest.mark.parametrize(
    ("first", "second", "names"),
    [
        (("FL_HAA", "FL_KFE"), ("FR_HAA", "FR_KFE"), ["FL", "FR"]),
        (("front_right_a", "front_right_b"), ("rear_right_a", "rear_right_b"), ["front", "rear"]),
        (("front_right_a", "front_right_b"), ("rear_left_a", "rear_left_b"), ["front_right", "rear_left"]),
        (("leg_left_1_joint", "leg_left_2_joint"), ("leg_right_1_joint", "leg_right_2_joint"), ["left", "right"]),
        (("LHipYaw", "LKneePitch"), ("RHipYaw", "RKneePitch"), ["L", "R"]),
        (("hip_yaw_1", "knee_pitch_1"), ("hip_yaw_2", "knee_pitch_2"), ["1", "2"]),
        (("hip_left_joint", "knee_left_joint"), ("hip_right_joint", "knee_right_joint"), ["left", "right"]),
        (("j2s6s200_a", "j2s6s200_b"), ("arm_a", "arm_b"), ["j2s6s200", "arm"]),
        (("I_theta1", "I_theta2"), ("II_theta1", "II_theta2"), ["I", "II"]),
        (("rotor_0_joint",), ("rotor_1_joint",), ["0", "1"]),
        (("head_yaw",), ("arm_yaw", "arm_roll"), ["head", "arm"]),
    ],
)
def test_names_are_what_tells_the_legs_apart(first, second, names) -> None:
    assert list(legs(chain("base", *first), chain("base", *second))) == names


def test_without_anything_in_common_the_foot_link_gives_the_name() -> None:
    assert list(legs(chain("base", "hip", "shin", "paw_foot"), chain("base", "a_x", "a_y"))) == ["paw_foot", "a"]


def test_where_neither_name_nor_foot_is_clear_the_first_link_gives_the_name() -> None:
    torso = chain("base", "waist", "chest") + chain("chest", "left_hand") + chain("chest", "right_hand")
    found = legs(torso, chain("base", "left_hip", "left_foot"), chain("base", "right_hip", "right_foot"))
    assert list(found) == ["waist", "left", "right"]
    assert (found["waist"].foot, found["waist"].candidates) == (None, ("left_hand", "right_hand"))


def test_legs_of_one_name_take_another() -> None:
    parts = [chain("base", f"left_{limb}_a", f"left_{limb}_b") for limb in ("hip", "shoulder")]
    assert list(legs(*parts)) == ["hip", "shoulder"]
    arm, leg = chain("base", "left_shoulder", "left_hand"), chain("base", "left_hip", "left_foot")
    assert list(legs(arm, leg)) == ["left_hand", "left_foot"]
    # The first link of a nameless leg is called like another leg.
    odd = chain("base", "FL", "x") + chain("x", "p") + chain("x", "q")
    assert list(legs(chain("base", "FL_a", "FL_b"), chain("base", "FR_a", "FR_b"), odd)) == ["FL", "FR", "leg_3"]


# ------------------------------------------------------------------ feet


def test_the_foot_is_the_deepest_link_of_a_foot_like_name() -> None:
    deep = chain("base", "FL_ankle", "FL_shin", "FL_tip")
    assert feet(deep, chain("base", "FR_a", "FR_FOOT", "FR_b")) == {"FL": "FL_ankle", "FR": "FR_FOOT"}
    assert feet(chain("base", "l_ankle", "l_sole"), chain("base", "r_a", "r_toe")) == {"l": "l_sole", "r": "r_toe"}


def test_without_such_a_name_it_is_the_deepest_leaf() -> None:
    split = chain("base", "FL_a", "FL_b") + chain("FL_a", "FL_c", "FL_d")
    assert feet(split, chain("base", "FR_a")) == {"FL": "FL_d", "FR": "FR_a"}


def test_a_sensor_on_the_foot_is_not_the_foot() -> None:
    left, right = chain("base", "l_a", "l_foot", "l_foot_imu"), chain("base", "r_a", "r_foot_camera")
    assert feet(left, right) == {"l": "l_foot", "r": "r_foot_camera"}


@pytest.mark.parametrize(
    ("one", "other", "foot"),
    [
        ("l_foot_frame", "l_foot", "l_foot"),
        ("l_sole", "l_foot", "l_foot"),
        ("l_big_toe", "l_toe", "l_toe"),
        ("l_ankle_1", "l_contact_1", "l_contact_1"),
        ("l_foot_a", "l_foot_b", None),
    ],
)
def test_which_of_two_equally_deep_links_is_the_foot(one: str, other: str, foot: str | None) -> None:
    for names in ((one, other), (other, one)):
        left = chain("base", "l_a") + "".join(chain("l_a", name, kinds="f") for name in names)
        found = legs(left, chain("base", "r_a", "r_foot"))["l"]
        assert (found.foot, found.candidates) == (foot, names if foot is None else (foot,))


def test_two_equally_good_feet_are_an_error_until_one_is_given() -> None:
    walker = parse(robot(chain("base", "l_a", "l_b") + chain("l_a", "l_c"), chain("base", "r_a", "r_b")))
    with pytest.raises(DescriptionError, match=r"leg 'l' of 'walker' has 2 .* feet: l_b, l_c; name one") as caught:
        leg_part(walker, "l")
    assert caught.value.candidates == ("l_b", "l_c")
    assert part_of(walker, "l", foot="l_c").foot == "l_c"
    assert part_of(walker, "l_c") == part_of(walker, "l", foot="l_c")
    assert leg_part(walker, "l_c") == leg_part(walker, "l", foot="l_b")


# ------------------------------------------------------------------ asking for one


@pytest.fixture
def walker():
    return parse(
        robot(chain("base", "FL_a", "FL_FOOT"), chain("base", "FR_a", "FR_FOOT"), chain("base", "box", kinds="f"))
    )


def test_a_leg_is_found_by_name_by_any_case_and_by_link(walker) -> None:
    assert part_of(walker, "FL") == part_of(walker, "fl") == part_of(walker, "FL_FOOT") == legs_of(walker)["FL"]
    assert part_of(walker, "FL_a").foot == "FL_a"
    assert part_of(walker, "FL_a", foot="FL_FOOT").foot == "FL_FOOT"


def test_names_that_differ_by_case_alone_must_be_exact() -> None:
    both = parse(robot(chain("base", "a_x", "a_y"), chain("base", "b_x", "b_y")))
    assert part_of(both, "A").name == "a"
    # "fl" is one leg by its joints, and "FL" another by its foot.
    odd = parse(robot(chain("base", "fl_x", "fl_y"), chain("base", "k", "FL"), chain("base", "g_x", "g_y")))
    assert list(legs_of(odd)) == ["fl", "FL", "g"]
    assert (part_of(odd, "fl").foot, part_of(odd, "FL").foot) == ("fl_y", "FL")
    with pytest.raises(DescriptionError, match="neither a leg nor"):
        part_of(odd, "Fl")


@pytest.mark.parametrize(
    ("name", "foot", "message"),
    [
        ("FX", None, r"'FX' of 'walker' is neither a leg nor a link of one; did you mean .* \(its legs: FL, FR\)"),
        ("box", None, "'box' of 'walker' is a link of its trunk"),
        ("base", "FL_FOOT", "'base' of 'walker' is a link of its trunk"),
        ("FL", "FR_FOOT", r"'FR_FOOT' is no link of the leg 'FL' of 'walker'.* \(its links: FL_a, FL_FOOT\)"),
        ("FL", "nothing", "'nothing' is no link of the leg 'FL'"),
        ("FL", "box", "'box' is no link of the leg 'FL'"),
    ],
)
def test_what_is_not_there_is_an_error_that_lists_what_is(walker, name, foot, message) -> None:
    for function in (part_of, leg_part):
        with pytest.raises(DescriptionError, match=message):
            function(walker, name, foot)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([], "hangs nothing that moves"),
        ([chain("base", "a", kinds="f")], "hangs nothing that moves"),
        ([chain("base", "a_foot", "b_foot")], "hangs one group of joints"),
        ([chain("base", "a", "b"), chain("base", "c", "d")], "2 groups of joints hang on its trunk 'base', but"),
    ],
)
def test_what_has_no_several_legs(parts, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        legs(*parts)


# ------------------------------------------------------------------ groups and trunk


LOOP = '<loop name="l" type="revolute"><predecessor link="{}"/><successor link="{}"/><axis xyz="0 1 0"/></loop>\n'
COUPLING = '<coupling name="c"><predecessor link="{}"/><successor link="{}"/><ratio value="2"/></coupling>\n'


@pytest.mark.parametrize(
    "tie",
    [
        LOOP.format("FL_b", "FR_b"),
        COUPLING.format("FL_a", "FR_b"),
        joint("m", "FR_b", "FR_c", inner='<mimic joint="FL_b"/>'),
    ],
    ids=["loop", "coupling", "mimic"],
)
def test_what_joins_subtrees_makes_one_group_of_them(tie: str) -> None:
    parts = [chain("base", f"{name}_a", f"{name}_b") for name in ("FL", "FR", "RL")] + [link("FR_c")]
    tail = "" if "FR_c" in tie else joint("m", "FR_b", "FR_c")
    apart = legs(*parts, tail) if tail else None
    if apart is not None:
        assert list(apart) == ["FL", "FR", "RL"]
    joined = legs(*parts, tail, tie)
    assert [leg.joint_names for leg in joined.values()] == [("FL_a", "FL_b", "FR_a", "FR_b", "m"), ("RL_a", "RL_b")]


def test_a_leg_keeps_limits_of_efforts_each_way() -> None:
    text = robot(*(chain("base", f"{name}_a", f"{name}_b") for name in ("FL", "FR")))
    whole = parse(text.replace('effort="9"', 'effort="9" effort_lower="-3"'))
    limits = leg_part(whole, "FL").joint("FL_a").limits
    assert (limits.effort_lower, limits.effort) == (-3.0, 9.0)


def test_ties_of_the_trunk_and_within_a_leg_join_nothing() -> None:
    parts = [chain("base", f"{name}_a", f"{name}_b") for name in ("FL", "FR")] + [chain("base", "box", kinds="f")]
    ties = LOOP.format("box", "FL_b") + COUPLING.format("FR_a", "FR_b")
    assert list(legs(*parts, ties)) == ["FL", "FR"]


def test_a_chain_of_ties_makes_one_group() -> None:
    parts = [chain("base", f"{name}_a") for name in "pqrs"]
    ties = LOOP.format("s_a", "p_a") + LOOP.replace('"l"', '"k"').format("q_a", "s_a")
    assert [leg.joint_names for leg in legs(*parts, ties, chain("base", "foot")).values()] == [
        ("p_a", "q_a", "s_a"),
        ("r_a",),
        ("foot",),
    ]


def test_the_link_that_a_leg_hangs_on() -> None:
    trunk = chain("base", "body", "left", kinds="ff") + chain("body", "right", kinds="f")
    one, other = chain("left", "l_a", "l_foot"), chain("right", "r_a", "r_foot")
    assert [leg.root for leg in legs(trunk, one, other).values()] == ["left", "right"]
    joined = legs(trunk, one, other, LOOP.format("l_a", "r_a"), chain("base", "b_x", "b_foot"))
    assert [leg.root for leg in joined.values()] == ["body", "base"]
    above = legs(trunk, one, chain("body", "r_a", "r_foot"), LOOP.format("l_a", "r_a"), chain("base", "b_x", "b_foot"))
    assert [leg.root for leg in above.values()] == ["body", "base"]


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_below_a_floating_joint_the_trunk_is_its_child(kind: str) -> None:
    pose = '<configuration name="home"><joint name="FL_a" value="0.5"/><joint name="FR_a" value="1"/></configuration>'
    text = robot(
        chain("base", "odom", kinds="f"),
        link("trunk"),
        joint("free", "odom", "trunk", kind),
        chain("trunk", "shell", kinds="f"),
        chain("shell", "FL_a", "FL_foot"),
        chain("trunk", "FR_a", "FR_foot"),
        pose,
    )
    free = parse(text)
    assert [(leg.name, leg.root) for leg in legs_of(free).values()] == [("FL", "shell"), ("FR", "trunk")]
    part = leg_part(free, "FL")
    assert part.root == "trunk"
    assert [each.name for each in part.links] == ["trunk", "shell", "FL_a", "FL_foot"]
    assert dict(part.home.values) == {"FL_a": 0.5}
    with pytest.raises(DescriptionError, match="neither a leg nor a link of one"):
        part_of(free, "odom")


def test_beside_a_floating_joint_the_root_stays_the_trunk() -> None:
    found = legs(link("buoy"), joint("free", "base", "buoy", "floating"), chain("base", "FL_a", "FL_foot"))
    assert [leg.root for leg in found.values()] == ["base", "base"]


def test_a_rail_is_no_floating_base() -> None:
    rail = link("cart") + joint("rail", "base", "cart", "prismatic")
    with pytest.raises(DescriptionError, match="one group of joints"):
        legs(rail, chain("cart", "FL_a", "FL_foot"), chain("cart", "FR_a", "FR_foot"))


# ------------------------------------------------------------------ the part


RICH = robot(
    '<material name="steel"><color rgba="0.5 0.5 0.5 1"/></material>\n',
    chain("base", "FL_a", "FL_b", "FL_foot"),
    chain("base", "FL_c"),
    LOOP.replace('"l"', '"FL_loop"').format("FL_b", "FL_c"),
    chain("base", "FR_a", "FR_b", "FR_foot"),
    '<transmission name="FL_drive"><joint name="FL_a"/><actuator name="M1"><mechanicalReduction>\n9\n'
    "</mechanicalReduction><rotorInertia>1e-4</rotorInertia></actuator></transmission>\n",
    '<transmission name="FR_drive"><joint name="FR_a"/><actuator name="M2"/></transmission>\n',
    COUPLING.replace('"c"', '"FR_gear"').format("FR_a", "FR_foot"),
    '<cone name="FL_cone" link="FL_b"><axis xyz="0 0 1"/><other link="base"><axis xyz="0 0 1"/></other>'
    '<limit upper="1"/></cone>\n',
    '<clearance name="between" minimum="0"><segment link="FL_b" from="0 0 0" to="0 0 1" radius="0.1"/>'
    '<segment link="FR_b" from="0 0 0" to="0 0 1" radius="0.1"/></clearance>\n',
    '<configuration name="home"><joint name="FR_a" value="0.25"/><joint name="FL_a" value="0.5"/></configuration>\n'
    '<configuration name="right"><joint name="FR_b" value="1"/></configuration>\n'
    '<!-- <link name="ghost"> and > signs --><gazebo reference="FL_a"><x a="/>"/></gazebo>\n',
    name="ri&amp;ch",
)


def test_a_part_has_what_is_the_legs_and_the_trunks() -> None:
    rich = parse(RICH)
    left, right = leg_part(rich, "FL"), leg_part(rich, "FR")
    assert [part.name for part in (left, right)] == ["ri&ch_FL", "ri&ch_FR"]
    assert [each.name for each in left.links] == ["base", "FL_a", "FL_b", "FL_foot", "FL_c"]
    assert [each.name for each in right.links] == ["base", "FR_a", "FR_b", "FR_foot"]
    assert [[each.name for each in part.loops] for part in (left, right)] == [["FL_loop"], []]
    assert [[each.name for each in part.couplings] for part in (left, right)] == [[], ["FR_gear"]]
    assert [[each.name for each in part.cones] for part in (left, right)] == [["FL_cone"], []]
    assert left.clearances == right.clearances == ()
    (drive,) = left.transmissions
    assert drive == rich.transmissions[0]
    assert [dict(each.values) for each in left.configurations] == [{"FL_a": 0.5}]
    assert [dict(each.values) for each in right.configurations] == [{"FR_a": 0.25}, {"FR_b": 1.0}]


def test_whatever_stays_is_the_same_on_the_same_line() -> None:
    rich = parse(RICH)
    for name in legs_of(rich):
        part = leg_part(rich, name)
        assert set(part.links) <= set(rich.links)
        assert set(part.joints) <= set(rich.joints)
        assert part.urdf.count("\n") == rich.urdf.count("\n")
        assert part.file == rich.file
        assert parse(part.urdf) == part == pickle.loads(pickle.dumps(part))


@pytest.mark.parametrize("old", [("<robot name=", "<robot\n  version='1' name  =  "), ('"walker"', "'walker'")])
def test_the_name_is_found_in_any_root_element(walker, old) -> None:
    assert walker.urdf.count(old[0]) == 1
    assert leg_part(parse("\ufeff" + walker.urdf.replace(*old)), "FL").name == "walker_FL"


def test_a_differential_stays_with_its_leg_only() -> None:
    def drive(name, *joints):
        ends = "".join(f'<actuator name="{name}{each}"/><joint name="{each}"/>' for each in joints)
        return f'<transmission name="{name}">{ends}</transmission>'

    parts = [chain("base", f"{name}_a", f"{name}_b", f"{name}_c") for name in ("FL", "FR")]
    drives = drive("one", "FL_a", "FL_b") + drive("both", "FL_c", "FR_c") + drive("last", "FR_a") + drive("end", "FR_b")
    driven = [
        [each.joint for each in leg_part(parse(robot(*parts, drives)), name).transmissions] for name in ("FL", "FR")
    ]
    # A drive that two legs share is neither's alone: each joint of it is without an actuator in the part.
    assert driven == [["FL_a", "FL_b"], ["FR_a", "FR_b"]]


# ------------------------------------------------------------------ robots


@pytest.mark.parametrize("name", ["omnileg", "hexapod_leg", "quadruped_leg", "ring", "snake"])
def test_a_leg_a_ring_and_a_snake_have_no_legs(name: str) -> None:
    with pytest.raises(DescriptionError, match=r"'\w+' has no (several )?legs: .* with foot=$"):
        legs_of(read(name))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hexapod", {f"{a}_{b}": f"{a}_{b}_foot" for a in ("front", "middle", "rear") for b in ("right", "left")}),
        ("quadruped", {each: f"{each}_foot" for each in ("I", "II", "III", "IV")}),
        ("solo12", {each: f"{each}_FOOT" for each in ("FL", "FR", "HL", "HR")}),
        ("anymal", {each: f"{each}_FOOT" for each in ("LF", "RF", "LH", "RH")}),
        ("hyq", {each: f"{each}_foot" for each in ("lf", "rf", "lh", "rh")}),
        ("talos", {"torso_1_link": None, "left": "left_sole_link", "right": "right_sole_link"}),
        ("icub", {"l": "l_sole", "r": "r_sole", "torso_1": None}),
        ("romeo", {"L": "l_sole", "R": "r_sole", "torso": None}),
        ("g1", {"left": "left_ankle_roll_link", "right": "right_ankle_roll_link", "waist_yaw_link": None}),
        ("human", {"left": "left_foot", "right": "right_foot", "middle_abdomen_virtual": None}),
    ],
)
def test_the_legs_of_known_robots(name: str, expected: dict[str, str | None]) -> None:
    description = read(name if name in ld.available() else PREFIX + name)
    found = legs_of(description)
    assert {leg.name: leg.foot for leg in found.values()} == expected
    moving = [joint.name for joint in description.moving_joints]
    assert sorted(name for leg in found.values() for name in leg.joint_names) == sorted(moving)


def test_parameters_stay_the_robots() -> None:
    hexapod = read("hexapod")
    assert leg_part(hexapod, "rear_left").parameters == hexapod.parameters


def same_as_the_whole(name: str, leg: str) -> None:
    """Foot, Jacobian, bias and gravity torque of a part against the whole robot's with the other legs elsewhere."""
    source = name if name in ld.available() else PREFIX + name
    description = read(source)
    part = part_of(description, leg)
    whole = ld.load(source, route="pinocchio", foot=part.foot)
    alone = ld.load(leg_part(description, leg).urdf, route="pinocchio", foot=part.foot)
    columns = [whole.joint_names.index(joint) for joint in alone.joint_names]
    others = [i for i in range(len(whole.joint_names)) if i not in columns]
    home = {} if description.home is None else description.home.values
    generator = np.random.default_rng(0)
    q = np.array([home.get(joint, 0.0) for joint in whole.joint_names])
    q += generator.uniform(-0.02, 0.02, len(q))
    v = generator.standard_normal(len(q))
    np.testing.assert_allclose(alone.foot_position(q[columns]), whole.foot_position(q), atol=1e-12)
    J = whole.jacobian(q)
    np.testing.assert_allclose(alone.jacobian(q[columns]), J[:, columns], atol=1e-11)
    np.testing.assert_allclose(J[:, others], 0.0, atol=1e-11)
    gravity = whole.gravity_torque(q)[columns]
    np.testing.assert_allclose(alone.gravity_torque(q[columns]), gravity, rtol=1e-10, atol=1e-10)
    assert np.abs(gravity).max() > 1e-3
    np.testing.assert_allclose(alone.bias(q[columns], v[columns]), whole.bias(q, v)[columns], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("name", "leg"), [("hexapod", "middle_left"), ("quadruped", "III"), ("solo12", "HR")])
def test_a_part_computes_what_the_whole_does(name: str, leg: str) -> None:
    same_as_the_whole(name, leg)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexapod", "quadruped", "solo12", "anymal", "hyq", "talos", "icub", "romeo", "go1"])
def test_every_part_of_a_robot_computes_what_the_whole_does(name: str) -> None:
    description = read(name if name in ld.available() else PREFIX + name)
    for leg in legs_of(description).values():
        if leg.foot is not None:
            same_as_the_whole(name, leg.name)


def test_the_jacobian_of_a_part_is_the_slope_of_the_robots_foot() -> None:
    """Finite differences of the tree's own kinematics, which knows nothing of parts."""
    talos = read(f"{PREFIX}talos")
    leg = ld.load(leg_part(talos, "left").urdf, route="pinocchio", foot="left_sole_link")
    q = np.array([talos.home.values[joint] for joint in leg.joint_names])
    h = 1e-6

    def foot(values):
        pose = dict(talos.home.values) | dict(zip(leg.joint_names, values, strict=True))
        return link_transforms(talos, pose)["left_sole_link"][:3, 3]

    slopes = [(foot(q + step) - foot(q - step)) / (2.0 * h) for step in h * np.eye(len(q))]
    np.testing.assert_allclose(leg.jacobian(q), np.transpose(slopes), atol=1e-8)
