"""Facts of urdf/hexapod_leg.urdf, hexapod_leg_preliminary.urdf and hexapod.urdf, computed here from their XML alone."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from leg_dynamics import description
from leg_dynamics.description import read, render, shipped_urdf, shipped_xacro

A, B, C, E, H = 0.2, 0.07, 0.05, 0.45, 0.715
STRUTS = (1, 2, 3)
PLACES = [f"{place}_{side}_" for place in ("front", "middle", "rear") for side in ("right", "left")]
X, Y, Z = np.eye(3)


def vector(text: str) -> np.ndarray:
    return np.array([float(number) for number in text.split()])


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    skew = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


def origin(element: ET.Element) -> np.ndarray:
    pose, at = np.eye(4), element.find("origin")
    if at is not None:
        roll, pitch, yaw = vector(at.get("rpy"))
        pose[:3, :3] = rotation(Z, yaw) @ rotation(Y, pitch) @ rotation(X, roll)
        pose[:3, 3] = vector(at.get("xyz"))
    return pose


class Tree:
    """The parsed file; frames are (4, 4) matrices in the frame of `base`."""

    def __init__(self, text: str) -> None:
        self.root = ET.fromstring(text)
        self.links = {link.get("name"): link for link in self.root.findall("link")}
        self.joints = {joint.get("name"): joint for joint in self.root.findall("joint")}
        self.loops = {loop.get("name"): loop for loop in self.root.findall("loop")}
        self.moving = [name for name, joint in self.joints.items() if joint.get("type") != "fixed"]

    def ends(self, joint: str) -> tuple[str, str]:
        return tuple(self.joints[joint].find(tag).get("link") for tag in ("parent", "child"))

    def home(self) -> dict[str, float]:
        values = self.root.find("configuration[@name='home']").findall("joint")
        return {value.get("name"): float(value.get("value")) for value in values}

    def frames(self, values: dict[str, float]) -> dict[str, np.ndarray]:
        frames = {"base": np.eye(4)}
        for name, joint in self.joints.items():  # each joint stands after its parent's
            parent, child = self.ends(name)
            motion, value = np.eye(4), values.get(name, 0.0)
            if joint.get("type") == "revolute":
                motion[:3, :3] = rotation(vector(joint.find("axis").get("xyz")), value)
            elif joint.get("type") == "prismatic":
                motion[:3, 3] = value * vector(joint.find("axis").get("xyz"))
            frames[child] = frames[parent] @ origin(joint) @ motion
        return frames

    def gap(self, name: str, frames: dict[str, np.ndarray]) -> float:
        loop = self.loops[name]
        ends = [frames[end.get("link")] @ origin(end) for end in (loop.find("predecessor"), loop.find("successor"))]
        gap = np.linalg.norm(ends[0][:3, 3] - ends[1][:3, 3])
        if loop.get("type") == "revolute":
            axis = vector(loop.find("axis").get("xyz"))
            gap += np.linalg.norm(ends[0][:3, :3] @ axis - ends[1][:3, :3] @ axis)
        return gap

    def mass(self, link: str) -> float:
        block = self.links[link].find("inertial")
        return 0.0 if block is None else float(block.find("mass").get("value"))


@pytest.fixture(scope="module")
def leg() -> Tree:
    return Tree(shipped_urdf("hexapod_leg").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def robot() -> Tree:
    return Tree(shipped_urdf("hexapod").read_text(encoding="utf-8"))


def test_links_joints_and_loops_have_the_agreed_names(leg):
    bodies = {f"{kind}_{i}" for kind in ("cross", "sleeve", "rod") for i in STRUTS}
    assert set(leg.links) == bodies | {"base", "hip", "foot", "link_B0B2", "link_B1B3"}
    assert leg.moving == [f"{kind}{i}" for i in STRUTS for kind in ("alpha", "beta", "l")]
    independent = [name for name in leg.moving if leg.joints[name].get("independent") == "true"]
    assert independent == ["l1", "l2", "l3"]
    assert {leg.joints[name].get("type") for name in independent} == {"prismatic"}
    assert {name: loop.get("type") for name, loop in leg.loops.items()} == {
        "loop_B2": "revolute",
        "loop_B3": "spherical",
    }


def test_base_is_z_up_and_hip_is_z_down(leg):
    np.testing.assert_allclose(leg.frames({})["hip"], np.diag([1.0, -1.0, -1.0, 1.0]), atol=1e-15)


def test_the_slides_coordinate_is_the_struts_length(leg):
    hips = {1: (0.0, 0.0, 0.0), 2: (A, 0.0, 0.0), 3: (0.0, A, 0.0)}
    rng = np.random.default_rng(0)
    for _ in range(20):
        values = dict(zip(leg.moving, rng.uniform(-1.0, 1.0, 9), strict=True))
        frames = leg.frames(values)
        to_hip = np.linalg.inv(frames["hip"])
        for i in STRUTS:
            place = (to_hip @ frames[f"sleeve_{i}"])[:3, 3]
            end = (to_hip @ frames[f"rod_{i}"])[:3, 3]
            np.testing.assert_allclose(place, hips[i], atol=1e-15)
            alpha, beta, length = (values[f"{kind}{i}"] for kind in ("alpha", "beta", "l"))
            w = np.array([np.sin(beta), -np.sin(alpha) * np.cos(beta), np.cos(alpha) * np.cos(beta)])
            np.testing.assert_allclose(end - place, length * w, atol=1e-15)
        np.testing.assert_array_equal(frames["foot"], frames["rod_1"])


def test_home_closes_the_loops_of_leg_and_robot(leg, robot):
    frames = leg.frames(leg.home())
    assert max(leg.gap(name, frames) for name in leg.loops) < 1e-15
    home = leg.home()
    np.testing.assert_allclose([home[f"l{i}"] for i in STRUTS], (0.715, 0.4684, 0.7306), atol=5e-5)
    frames = robot.frames(robot.home())
    assert len(robot.loops) == 12
    assert max(robot.gap(name, frames) for name in robot.loops) < 1e-15


MASSES = {  # the audit's: sleeves 1 and 3, rods 1 and 3, sleeve 2, rod 2, whole leg with bars and without crosses
    7850: (3.699, 0.999, 2.294, 0.619, 12.60),
    2700: (1.272, 0.344, 0.789, 0.213, 4.34),
}


@pytest.mark.parametrize("density", MASSES)
def test_masses_come_from_the_tubes_of_table_1(density):
    tree = Tree(render("hexapod_leg", {"density": density, "cross_mass": 0}))
    sleeve, rod, sleeve_2, rod_2, whole = MASSES[density]
    for i, tubes in ((1, (sleeve, rod)), (2, (sleeve_2, rod_2)), (3, (sleeve, rod))):
        assert (tree.mass(f"sleeve_{i}"), tree.mass(f"rod_{i}")) == pytest.approx(tubes, abs=5e-4)
        assert tree.links[f"cross_{i}"].find("inertial") is None
    assert sum(map(tree.mass, tree.links)) - tree.mass("hip") == pytest.approx(whole, abs=5e-3)


def test_rods_end_and_sleeves_begin_at_their_joints(leg):
    for i, length in ((1, 0.5), (2, 0.31), (3, 0.5)):
        assert origin(leg.links[f"sleeve_{i}"].find("inertial"))[2, 3] == pytest.approx(length / 2)
        assert origin(leg.links[f"rod_{i}"].find("inertial"))[2, 3] == pytest.approx(-length / 2)
        inner, outer, mass = 0.0275, 0.0325, leg.mass(f"sleeve_{i}")
        inertia = leg.links[f"sleeve_{i}"].find("inertial/inertia")
        assert float(inertia.get("izz")) == pytest.approx(mass * (inner**2 + outer**2) / 2)
        across = mass * (3 * (inner**2 + outer**2) + length**2) / 12
        assert float(inertia.get("ixx")) == pytest.approx(across)


def test_limits_of_both_designs(leg):
    first = Tree(shipped_urdf("hexapod_leg_preliminary").read_text(encoding="utf-8"))
    expected = {"l1": ((0.53, 0.9), (0.5, 0.9)), "l2": ((0.33, 0.6), (0.35, 0.65)), "l3": ((0.53, 0.9), (0.5, 0.9))}
    for name, pair in expected.items():
        for tree, bounds in zip((leg, first), pair, strict=True):
            limit = tree.joints[name].find("limit")
            assert (float(limit.get("lower")), float(limit.get("upper"))) == bounds
    for name in set(leg.moving) - set(expected):
        limit = leg.joints[name].find("limit")
        assert np.degrees([float(limit.get("lower")), float(limit.get("upper"))]) == pytest.approx((-60, 60))
    assert vector(first.loops["loop_B2"].find("predecessor/origin").get("xyz")) == pytest.approx((0.08, 0, 0.45))
    assert first.home()["l1"] == 0.7


def test_the_ball_is_at_zero_in_the_initial_pose(leg):
    cone = leg.root.find("cone")
    frames = leg.frames(leg.home())
    ends = [(cone.get("link"), cone.find("axis")), (cone.find("other").get("link"), cone.find("other/axis"))]
    one, other = (frames[link][:3, :3] @ vector(axis.get("xyz")) for link, axis in ends)
    assert np.linalg.norm(np.cross(one, other)) < 1e-15
    assert one @ other > 0
    assert np.degrees(float(cone.find("limit").get("upper"))) == pytest.approx(35)


def test_telescopes_and_the_hardware_conflict_of_strut_2(leg):
    left = {}
    for element in leg.root.findall("telescope"):
        upper = float(leg.joints[element.get("joint")].find("limit").get("upper"))
        left[element.get("joint")] = float(element.get("sleeve")) + float(element.get("rod")) - upper
        assert element.get("overlap") == "0"
    assert left == pytest.approx({"l1": 0.1, "l2": 0.02, "l3": 0.1})


@pytest.mark.parametrize(("length", "gap"), [(0.53, -1.1e-3), (0.55, 3.4e-3)])
def test_sleeves_collide_where_the_audit_says(leg, length, gap):
    first, third = leg.root.findall("clearance/segment")
    assert (first.get("link"), third.get("link")) == ("sleeve_1", "sleeve_3")
    frames = leg.frames({"l1": length, "alpha3": np.arctan2(A - C, length)})
    ends = []
    for segment in (first, third):
        ends.append([(frames[segment.get("link")] @ [*vector(segment.get(key)), 1.0])[:3] for key in ("from", "to")])
    grid = np.linspace(0.0, 1.0, 2001)[:, None]
    one, other = ((1 - grid) * start + grid * end for start, end in ends)
    # Nearest are the far end of sleeve 3 and the line of sleeve 1.
    distance = np.linalg.norm(one - other[-1], axis=1).min()
    radii = sum(float(segment.get("radius")) for segment in (first, third))
    assert distance - radii == pytest.approx(gap, abs=1.5e-4)


def test_parameters_are_the_same_for_both_designs():
    final, first = (read(name).parameters for name in ("hexapod_leg", "hexapod_leg_preliminary"))
    assert list(final) == list(first)
    assert {name: p.unit for name, p in final.items()} == {name: p.unit for name, p in first.items()}
    changed = {name for name in final if final[name].value != first[name].value}
    assert changed == {"b", "h", "l1_min", "l2_min", "l2_max", "l3_min", "sleeve_2_length", "rod_2_length"}


def test_the_robot_is_six_times_the_leg(leg, robot):
    assert len(robot.moving) == 54
    for prefix in PLACES:
        side = 1.0 if "right" in prefix else -1.0
        mirror = np.diag([1.0, side, 1.0])
        for name in leg.links:
            if name != "base":
                assert robot.mass(prefix + name) == leg.mass(name)
        for name, joint in leg.joints.items():
            if name == "base_to_hip":
                continue
            mine, theirs = origin(joint), origin(robot.joints[prefix + name])
            np.testing.assert_array_equal(theirs[:3, 3], mirror @ mine[:3, 3])
            np.testing.assert_array_equal(theirs[:3, :3], mine[:3, :3])
        for name, loop in leg.loops.items():
            for end in ("predecessor", "successor"):
                mine, theirs = origin(loop.find(end)), origin(robot.loops[prefix + name].find(end))
                np.testing.assert_array_equal(theirs[:3, 3], mirror @ mine[:3, 3])


def test_legs_stand_in_mirrored_pairs_with_strut_3_outside(robot):
    frames = robot.frames(robot.home())
    for place in ("front", "middle", "rear"):
        right, left = (frames[f"{place}_{side}_hip"][:3, 3] for side in ("right", "left"))
        np.testing.assert_allclose(right * (1, -1, 1), left)
        assert right[1] < 0
        foot = frames[f"{place}_right_foot"][:3, 3]
        np.testing.assert_allclose(foot - right, (0, 0, -H), atol=1e-15)
        for side, outwards in (("right", -1), ("left", 1)):
            hip, third = (frames[f"{place}_{side}_{name}"][:3, 3] for name in ("hip", "sleeve_3"))
            np.testing.assert_allclose(third - hip, (0, outwards * A, 0), atol=1e-15)
            second = frames[f"{place}_{side}_sleeve_2"][:3, 3]
            np.testing.assert_allclose(second - hip, (A, 0, 0), atol=1e-15)
    spots = [frames[f"{prefix}foot"][:2, 3] for prefix in PLACES]
    assert min(np.linalg.norm(one - other) for one, other in itertools.combinations(spots, 2)) > 0.5


def test_the_robots_own_numbers_and_the_legs_can_be_set():
    tree = Tree(render("hexapod", {"body_mass": 80, "hip_width": 0.8, "density": 2700, "cross_mass": 0}))
    assert tree.mass("body") == 80
    assert tree.mass("front_left_sleeve_1") == pytest.approx(1.272, abs=5e-4)
    assert tree.frames({})["rear_left_hip"][1, 3] == pytest.approx(0.4)


def test_the_robots_parameters_are_those_of_both_files():
    robot, leg = read("hexapod").parameters, read("hexapod_leg").parameters
    own = {"body_mass", "body_length", "body_width", "body_height", "hip_spacing", "hip_width"}
    assert set(robot) - set(leg) == own
    assert {name: each for name, each in robot.items() if name not in own} == dict(leg)
    assert {name: robot[name].value for name in ("body_mass", "hip_width")} == {"body_mass": 60, "hip_width": 0.6}
    assert all(robot[name].source.startswith("assumed: ") for name in own)
    changed = read("hexapod", parameters={"hip_spacing": 0.75}).parameters
    assert changed["hip_spacing"].value == 0.75


def test_the_description_reads_every_loop_and_limit_of_the_workspace():
    robot = read("hexapod")
    assert (len(robot.moving_joints), len(robot.loops), len(robot.transmissions)) == (54, 12, 18)
    assert (len(robot.cones), len(robot.telescopes), len(robot.clearances)) == (6, 18, 6)
    assert robot.root == "base"
    assert shipped_xacro("hexapod").is_file()
    assert set(description.shipped_names()) >= {"hexapod", "hexapod_leg", "hexapod_leg_preliminary"}


@pytest.mark.parametrize(("name", "count"), [("hexapod_leg", 9), ("hexapod_leg_preliminary", 9), ("hexapod", 54)])
def test_other_readers_load_an_open_tree(name, count):
    import pinocchio
    import yourdfpy

    mujoco = pytest.importorskip("mujoco")
    text = shipped_urdf(name).read_text(encoding="utf-8")
    tree = Tree(text)
    mass = sum(map(tree.mass, tree.links))
    model = pinocchio.buildModelFromXML(text, pinocchio.JointModelFreeFlyer())
    assert model.nv == 6 + count
    assert sum(inertia.mass for inertia in model.inertias) == pytest.approx(mass)
    robot = yourdfpy.URDF.load(str(shipped_urdf(name)), load_meshes=False, build_scene_graph=False)
    assert len(robot.robot.joints) == len(tree.joints)
    assert mujoco.MjModel.from_xml_string(text).nv == count
