"""Facts of the modular quadruped's files: urdf/quadruped*.urdf, ring.urdf and snake.urdf."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.gait import robot_from
from leg_dynamics.cli import main
from leg_dynamics.description import (
    Description,
    independent_joints,
    link_transforms,
    read,
    render,
    shipped_urdf,
    shipped_xacro,
)

F, S, FOOT, WIDTH = 0.0375, 0.075, 0.0275, 0.11
LENGTHS = (S, 2 * F, S + F + FOOT)
A, B = 0.1125, 0.055
LEGS = ("I", "II", "III", "IV")
# Behind: III and IV; on the left: I and III. In the paper's O_c, x to the right and y ahead.
HIPS = {"I": (-A, B, 0.0), "II": (A, B, 0.0), "III": (-A, -B, 0.0), "IV": (A, -B, 0.0)}
FROM_PAPER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A vector of O_c in the base, whose x is ahead and whose y is on the left."""


def dh(theta: float, a: float, alpha: float) -> np.ndarray:
    """Standard D-H transform of Table 1 (its header says a_{i-1}; equation (2) holds with a_i), d = 0."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, 0], [0, 0, 0, 1.0]])


def foot_frame(theta: np.ndarray, place: tuple[float, float, float], lengths=LENGTHS) -> np.ndarray:
    """A_c3, written out as in equation (2)."""
    l1, l2, l3 = lengths
    (c1, c2, c23), (s1, s2, s23) = (f([theta[0], theta[1], theta[1] + theta[2]]) for f in (np.cos, np.sin))
    reach = l3 * c23 + l2 * c2
    a, b, c = place
    return np.array(
        [
            [c1 * c23, -c1 * s23, s1, (reach + l1) * c1 + a],
            [s1 * c23, -s1 * s23, -c1, s1 * reach + l1 * s1 + b],
            [s23, c23, 0, l3 * s23 + l2 * s2 + c],
            [0, 0, 0, 1],
        ]
    )


def mass(mechanism: Description) -> float:
    return sum(link.inertial.mass for link in mechanism.links if link.inertial is not None)


@pytest.fixture(scope="module")
def robot() -> Description:
    return read("quadruped")


@pytest.fixture(scope="module")
def free_robot() -> Description:
    return read("quadruped", parameters={"frozen": 0})


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    return np.random.default_rng(5).uniform(-np.radians(70), np.radians(70), (400, 3))


def test_equation_2_is_the_product_of_table_1(poses):
    for theta in poses[:20]:
        place = np.eye(4)
        place[:3, 3] = (A, -B, 0.02)
        product = (
            place @ dh(theta[0], LENGTHS[0], np.pi / 2) @ dh(theta[1], LENGTHS[1], 0) @ dh(theta[2], LENGTHS[2], 0)
        )
        np.testing.assert_allclose(foot_frame(theta, (A, -B, 0.02)), product, atol=1e-15)


@pytest.mark.parametrize("name", ["quadruped_leg", "quadruped_leg_reversed"])
@pytest.mark.parametrize("sizes", [{}, {"f": 0.055, "s": 0.04, "foot_radius": 0.02}, {"f": 0.03, "s": 0.09}])
def test_the_legs_are_the_arm_of_equation_2(name, sizes, poses):
    leg = ld.load(name, route="pinocchio", parameters=sizes)
    assert leg.joint_names == ("theta1", "theta2", "theta3")
    assert leg.actuator_names == ("theta1_motor", "theta2_motor", "theta3_motor")
    f, s, foot = sizes.get("f", F), sizes.get("s", S), sizes.get("foot_radius", FOOT)
    lengths = (s, 2 * f, s + f + foot)
    places = [foot_frame(theta, (0.0, 0.0, 0.0), lengths) for theta in poses]
    np.testing.assert_allclose(leg.foot_position(poses), [place[:3, 3] for place in places], rtol=0, atol=1e-12)
    values = dict(zip(leg.joint_names, poses.T, strict=True))
    frames = link_transforms(leg.description, values)
    np.testing.assert_allclose(np.linalg.inv(frames["hip"]) @ frames["foot"], places, rtol=0, atol=1e-12)


def test_pinocchio_alone_agrees_with_equation_2(poses):
    import pinocchio

    model = pinocchio.buildModelFromXML(shipped_urdf("quadruped_leg").read_text(encoding="utf-8"))
    data = model.createData()
    order = [model.joints[model.getJointId(f"theta{i}")].idx_q for i in (1, 2, 3)]
    for theta in poses:
        q = np.zeros(3)
        q[order] = theta
        pinocchio.framesForwardKinematics(model, data, q)
        hip, foot = (data.oMf[model.getFrameId(name, pinocchio.FrameType.BODY)] for name in ("hip", "foot"))
        found = (hip.inverse() * foot).homogeneous
        np.testing.assert_allclose(found, foot_frame(theta, (0.0, 0.0, 0.0)), rtol=0, atol=1e-12)


def test_the_pose_of_equation_4():
    l1, l2, l3 = LENGTHS
    leg = ld.load("quadruped_leg", route="pinocchio")
    home = [leg.description.home.values[name] for name in leg.joint_names]
    np.testing.assert_allclose(np.degrees(home), (0, -30, -60))
    expected = np.array([np.sqrt(3) / 2 * l2 + l1, 0.0, -(l3 + l2 / 2)])
    np.testing.assert_allclose(leg.foot_position(home), expected, rtol=0, atol=1e-15)
    # The audit's foot of leg IV, mm.
    np.testing.assert_allclose(1e3 * (expected + np.array([A, -B, 0.0])), (252.5, -55.0, -177.5), atol=0.05)


def test_the_base_of_a_leg_has_x_ahead_and_the_leg_on_the_right():
    frames = link_transforms(read("quadruped_leg"), {})
    np.testing.assert_allclose(frames["hip"][:3, :3], FROM_PAPER, atol=1e-15)
    np.testing.assert_allclose(frames["hip"][:3, 3], (0.0, -F, 0.0), atol=1e-15)


def test_the_reversed_leg_moves_and_weighs_like_the_other(poses):
    leg, other = (ld.load(name, route="pinocchio") for name in ("quadruped_leg", "quadruped_leg_reversed"))
    v, a = poses[::-1], 3.0 * np.roll(poses, 7, axis=0)
    np.testing.assert_allclose(leg.torque(poses, v, a), other.torque(poses, v, a), rtol=0, atol=1e-13)


def test_frozen_joints_of_a_leg_are_the_papers():
    leg = read("quadruped_leg")
    for name, angle in (("m02_middle", -np.pi / 2), ("m01_middle", 0.0), ("m01_lower", 0.0)):
        assert leg.joint(name).type == "fixed"
        assert leg.joint(name).origin.rpy[0] == pytest.approx(angle)
    free = ld.load("quadruped_leg", route="pinocchio", parameters={"frozen": 0})
    assert free.joint_names == ("theta1", "m02_middle", "theta2", "theta3", "m01_middle", "m01_lower")
    q = [free.description.home.values[name] for name in free.joint_names]
    expected = ld.load("quadruped_leg", route="pinocchio").foot_position(np.radians([0, -30, -60]))
    np.testing.assert_allclose(free.foot_position(q), expected, atol=1e-15)


# ------------------------------------------------------------------ the robot


def test_names_of_the_robots_joints(robot, free_robot):
    thetas = {f"{leg}_theta{i}" for leg in LEGS for i in (1, 2, 3)}
    assert {joint.name for joint in robot.moving_joints} == thetas
    assert list(independent_joints(robot)) == [joint.name for joint in robot.moving_joints]
    frozen = {joint.name for joint in free_robot.moving_joints} - thetas
    assert len(frozen) == 18
    assert {f"m0{i}_{kind}" for i in (3, 6) for kind in ("lower", "middle", "upper")} < frozen
    assert all(robot.joint(name).type == "fixed" for name in frozen)
    assert [joint.name for joint in free_robot.joints] == [joint.name for joint in robot.joints]


def test_frozen_or_free_the_robot_stands_the_same(robot, free_robot):
    one, other = (link_transforms(each, dict(each.home.values)) for each in (robot, free_robot))
    assert one.keys() == other.keys()
    for name, pose in one.items():
        np.testing.assert_allclose(pose, other[name], atol=1e-14)


@pytest.mark.parametrize("thawed", [("m03_middle",), ("IV_m01_lower", "I_m01_upper", "II_m02_middle")])
def test_any_set_can_be_frozen(thawed):
    mechanism = read("quadruped", parameters={f"freeze_{name}": 0 for name in thawed} | {"freeze_I_theta2": 1})
    assert len(mechanism.moving_joints) == 12 + len(thawed) - 1
    assert all(mechanism.joint(name).type in ("revolute", "continuous") for name in thawed)
    assert mechanism.joint("I_theta2").type == "fixed"
    home = np.degrees(mechanism.joint("I_theta2").origin.rpy[2])
    assert home == pytest.approx(-40)


def test_hips_are_where_equation_1_puts_them(robot):
    frames = link_transforms(robot, dict(robot.home.values))
    for leg, place in HIPS.items():
        hip = frames[f"{leg}_hip"]
        np.testing.assert_allclose(hip[:3, 3], FROM_PAPER @ place, atol=1e-15)
        outwards = FROM_PAPER @ (np.sign(place[0]), 0.0, 0.0)
        np.testing.assert_allclose(hip[:3, 0], outwards, atol=1e-15)
        np.testing.assert_allclose(hip[:3, 2], (0.0, 0.0, 1.0), atol=1e-15)


def test_leg_IV_of_the_robot_is_equation_3(robot, poses):
    names = [f"IV_theta{i}" for i in (1, 2, 3)]
    frames = link_transforms(robot, dict(zip(names, poses.T, strict=True)))
    expected = [FROM_PAPER @ foot_frame(theta, HIPS["IV"])[:3, 3] for theta in poses]
    np.testing.assert_allclose(frames["IV_foot"][:, :3, 3], expected, rtol=0, atol=1e-12)


def test_feet_stand_level_and_splayed(robot):
    frames = link_transforms(robot, dict(robot.home.values))
    feet = {leg: frames[f"{leg}_foot"][:3, 3] for leg in LEGS}
    assert {round(foot[2], 12) for foot in feet.values()} == {round(feet["I"][2], 12)}
    for leg, foot in feet.items():
        hip = frames[f"{leg}_hip"][:3, 3]
        assert abs(foot[0]) > abs(hip[0])
        assert abs(foot[1]) > abs(hip[1])
        assert np.sign(foot[0]) == np.sign(hip[0])


def test_masses(robot):
    assert mass(robot) == pytest.approx(12.2)
    assert mass(read("quadruped_leg")) == pytest.approx(2.45)
    assert mass(read("ring")) == mass(read("snake")) == pytest.approx(12.0)
    assert mass(read("quadruped", parameters={"module_mass": 1.5})) == pytest.approx(15.2)


def test_the_gait_finds_four_legs(robot):
    models = [ld.load(name, route="pinocchio") for name in ("quadruped_leg", "quadruped_leg_reversed")]
    walker = robot_from(robot, models)
    assert walker.leg_names == LEGS
    assert walker.trunk_mass == pytest.approx(3.6)  # two modules, and the fixed bracket at each hip
    np.testing.assert_allclose(walker.trunk_com, 0.0, atol=1e-15)
    for limb in walker.limbs:
        assert limb.mirror == (1.0, 1.0, 1.0)
        reversed_leg = limb.leg.description.name == "quadruped_leg_reversed"
        assert reversed_leg == (limb.name in ("I", "II"))
        assert limb.joint_names == tuple(f"{limb.name}_theta{i}" for i in (1, 2, 3))


def test_bonds_join_active_to_passive_faces_of_the_right_modules(robot):
    """Body 3 passive, body 6 active (section 1.2), so that legs at 6 are held by their passive side."""
    parent = {joint.child: joint.parent for joint in robot.joints}
    for leg, face, bracket in (
        ("I", "m06_face_U", "lower"),
        ("II", "m06_face_L", "lower"),
        ("III", "m03_face_L", "upper"),
        ("IV", "m03_face_U", "upper"),
    ):
        assert parent[f"{leg}_m02_{bracket}_bracket"] == f"{leg}_hip"
        assert parent[f"{leg}_hip"] == face
    assert parent["m06_lower_half"] == "m03_face_S"


@pytest.mark.parametrize(("given", "count"), [({}, 12), ({"frozen": 0}, 30)])
def test_other_readers_load_the_free_robot(tmp_path, given, count):
    import pinocchio
    import yourdfpy

    mujoco = pytest.importorskip("mujoco")
    text = render("quadruped", given)
    model = pinocchio.buildModelFromXML(text, pinocchio.JointModelFreeFlyer())
    assert model.nv == 6 + count
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(12.2)

    # With the free base as a joint of the file, for readers that add none.
    text = render("quadruped", given | {"floating_joint": 1})
    path = tmp_path / "quadruped.urdf"
    path.write_text(text, encoding="utf-8")
    assert pinocchio.buildModelFromXML(text).nv == 6 + count
    model = mujoco.MjModel.from_xml_string(text)
    assert model.nv == 6 + count
    assert model.body_mass.sum() == pytest.approx(12.2)
    assert yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=False).num_dofs == 6 + count


@pytest.mark.parametrize(
    ("name", "count"), [("quadruped_leg", 3), ("quadruped_leg_reversed", 3), ("ring", 30), ("snake", 30)]
)
def test_other_readers_load_an_open_tree(name, count):
    import pinocchio
    import yourdfpy

    mujoco = pytest.importorskip("mujoco")
    text = shipped_urdf(name).read_text(encoding="utf-8")
    assert pinocchio.buildModelFromXML(text).nv == count
    assert mujoco.MjModel.from_xml_string(text).nv == count
    robot = yourdfpy.URDF.load(str(shipped_urdf(name)), load_meshes=False, build_scene_graph=False)
    assert robot.num_dofs == count


# ------------------------------------------------------------------ ring and snake


def test_the_ring_closes_at_home_inside_its_limits():
    ring = read("ring")
    values = dict(ring.home.values)
    frames = link_transforms(ring, values)
    (loop,) = ring.loops
    one, other = (frames[end.link] @ end.origin.matrix() for end in (loop.predecessor, loop.successor))
    np.testing.assert_allclose(one, other, atol=1e-13)
    for joint in ring.moving_joints:
        assert joint.limits.lower <= values[joint.name] <= joint.limits.upper
    axes = [frames[f"m{i:02d}_{body}"][:3, 3] for i in range(1, 11) for body in ("lower_half", "upper_half")]
    sides = np.linalg.norm(np.diff([*axes, axes[0]], axis=0), axis=1)
    np.testing.assert_allclose(sides, 0.075, atol=1e-13)


def test_mobility_of_the_ring_by_the_command(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["leg-dynamics", "info", "ring", "--json"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert not stop.value.code
    mobility = json.loads(capsys.readouterr().out)["mobility"]
    # 30 joints less the six rows of one closed chain; Gruebler's count is right, as no row is redundant.
    assert (mobility["joints"], mobility["rows"], mobility["mobility"], mobility["gruebler"]) == (30, 6, 24, 24)
    assert (mobility["redundant"], mobility["independent"], mobility["actuators"]) == (0, 24, 30)
    assert mobility["poses"][0]["pose"] == "home"
    assert max(pose["residual"] for pose in mobility["poses"]) < 1e-10


def test_the_ring_moves_and_stays_closed():
    ring = ld.load("ring")
    home = np.array([ring.description.home.values[name] for name in ring.joint_names])
    generator = np.random.default_rng(2)
    for _ in range(5):
        values = ring.assemble(home + 0.1 * generator.standard_normal(24))
        frames = link_transforms(ring.description, values)
        (loop,) = ring.description.loops
        one, other = (frames[end.link] @ end.origin.matrix() for end in (loop.predecessor, loop.successor))
        np.testing.assert_allclose(one, other, atol=1e-10)


def test_lengths_of_the_ring_may_change():
    ring = read("ring", parameters={"f": 0.03, "s": 0.09})
    frames = link_transforms(ring, dict(ring.home.values))
    np.testing.assert_allclose(frames["m10_face_U"][:3, 3], frames["m01_face_L"][:3, 3], atol=1e-13)


def test_the_snake_is_a_chain_inside_its_limits():
    snake = read("snake")
    assert len(snake.moving_joints) == 30
    assert not snake.loops
    for joint in snake.moving_joints:
        assert joint.limits.lower <= snake.home.values[joint.name] <= joint.limits.upper
    straight = link_transforms(snake, {})
    np.testing.assert_allclose(
        straight["m10_face_U"][:3, 3] - straight["m01_face_L"][:3, 3], (1.5, 0.0, 0.0), atol=1e-14
    )


@pytest.mark.parametrize(
    ("arguments", "name", "parameters"),
    [
        (("quadruped", "--set", "module_mass=1.5"), "quadruped", {"module_mass": 1.5}),
        ((str(shipped_xacro("ring")),), "ring", {}),
    ],
)
def test_the_command_renders_an_assembly(tmp_path, monkeypatch, arguments, name, parameters):
    target = tmp_path / "out.urdf"
    monkeypatch.setattr("sys.argv", ["leg-dynamics", "render", *arguments, "--output", str(target)])
    with pytest.raises(SystemExit) as stop:
        main()
    assert not stop.value.code
    assert target.read_text(encoding="utf-8") == render(name, parameters)
    assert ET.parse(target).getroot().get("name") == name
