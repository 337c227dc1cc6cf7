"""Geometric and inertial facts of urdf/omnileg.urdf, computed here from its XML with NumPy alone.

The closed joint values are the ones that the audited paper gives for each chain; the bodies are the ones that its
golden torques were computed with.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from leg_dynamics.description import render, shipped_xacro

FILE = Path(__file__).resolve().parents[1] / "urdf" / "omnileg.urdf"
L1, L3, L4, L5, R_C = 0.15, 0.075, 0.095, 0.16, 0.05
PSI = np.radians([0.0, 120.0, 240.0])
X, Y, Z = np.eye(3)
DOWN = {"home": (0.0, 0.0, 0.0), "bent": (0.0, 0.0, np.radians(40.0))}


# The reader: XML to matrices


class Tree:
    """The parsed file; frames are (4, 4) matrices in the hip frame."""

    def __init__(self, text: str) -> None:
        self.root = ET.fromstring(text)
        self.links = {link.get("name"): link for link in self.root.findall("link")}
        self.joints = {joint.get("name"): joint for joint in self.root.findall("joint")}
        self.loops = {loop.get("name"): loop for loop in self.root.findall("loop")}
        self.moving = [name for name, joint in self.joints.items() if joint.get("type") != "fixed"]

    def ends(self, joint: str) -> tuple[str, str]:
        element = self.joints[joint]
        return element.find("parent").get("link"), element.find("child").get("link")

    def frames(self, values: dict[str, float]) -> dict[str, np.ndarray]:
        frames = {"hip": np.eye(4)}
        waiting = [name for name in self.joints if name != "base_to_hip"]
        while waiting:
            ready = [name for name in waiting if self.ends(name)[0] in frames]
            assert ready, f"not reached from the hip: {waiting}"
            for name in ready:
                parent, child = self.ends(name)
                assert child not in frames, f"{child} has two parents"
                motion = np.eye(4)
                if name in self.moving:
                    motion[:3, :3] = rotation(vector(self.joints[name].find("axis").get("xyz")), values.get(name, 0.0))
                frames[child] = frames[parent] @ origin(self.joints[name]) @ motion
            waiting = [name for name in waiting if name not in ready]
        return frames

    def loop_gap(self, name: str, frames: dict[str, np.ndarray]) -> tuple[float, float]:
        """Distance of the two ends (m), and sine of the angle between the two ends' hinge axes."""
        loop = self.loops[name]
        ends = [loop.find("predecessor"), loop.find("successor")]
        poses = [frames[end.get("link")] @ origin(end) for end in ends]
        axis = vector(loop.find("axis").get("xyz"))
        one, other = (pose[:3, :3] @ axis for pose in poses)
        assert one @ other > 0, f"{name}: the two ends are turned round"
        return np.linalg.norm(poses[0][:3, 3] - poses[1][:3, 3]), np.linalg.norm(np.cross(one, other))


def vector(text: str) -> np.ndarray:
    return np.array([float(number) for number in text.split()])


def rotation(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis / np.linalg.norm(axis)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + 2 * np.sin(angle / 2) ** 2 * skew @ skew


def origin(element: ET.Element) -> np.ndarray:
    pose = np.eye(4)
    at = element.find("origin")
    if at is not None:
        roll, pitch, yaw = vector(at.get("rpy", "0 0 0"))
        pose[:3, :3] = rotation(Z, yaw) @ rotation(Y, pitch) @ rotation(X, roll)
        pose[:3, 3] = vector(at.get("xyz", "0 0 0"))
    return pose


def inertial(link: ET.Element) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, COM and inertia about the COM, in the link's axes."""
    block = link.find("inertial")
    pose = origin(block)
    xx, xy, xz, yy, yz, zz = (float(block.find("inertia").get(k)) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return float(block.find("mass").get("value")), pose[:3, 3], pose[:3, :3] @ tensor @ pose[:3, :3].T


def closed_values(alpha: float, beta: float, gamma: float) -> dict[str, float]:
    """Tree coordinates that close every loop, chain by chain."""
    theta12 = np.arctan(np.tan(alpha) * np.cos(beta))
    theta22 = -np.arctan(np.tan(beta) * np.cos(alpha))
    rod = np.array([np.tan(beta), -np.tan(alpha), 1.0]) / np.sqrt(1 + np.tan(alpha) ** 2 + np.tan(beta) ** 2)
    rod = rotation(Z, -gamma) @ rod
    a, b = np.arctan2(rod[0], rod[2]), np.arcsin(-rod[1])
    values = {"alpha": alpha, "beta": beta, "gamma": gamma}
    values |= {"theta12": theta12, "theta13": -theta12, "theta14": -beta}
    values |= {"theta22": theta22, "theta23": -theta22}
    values |= {"theta31": -beta, "theta32": -theta12, "theta33": theta12}
    values |= {"cardan_A4_y": a, "cardan_A4_x": b, "gamma_output": gamma, "cardan_B4_y": a, "epsilon_E1": gamma}
    for i in (1, 2, 3):
        values |= {f"gamma_C{i}": gamma, f"phi_D{i}": -2 * gamma}
    return values


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    poses = np.random.default_rng(seed).uniform(np.radians([-65, -65, -45]), np.radians([65, 65, 85]), (count, 3))
    corners = np.radians([[65, 65, 85], [-65, 65, 0], [65, -65, -45], [0, 0, 0], [30, 20, 40]])
    return np.vstack([poses, corners])


@pytest.fixture(scope="module")
def tree() -> Tree:
    return Tree(FILE.read_text(encoding="utf-8"))


# Names and topology

JOINTS = {  # name: parent, child, axis in hip's axes and a point on it, in the zero pose
    "alpha": ("hip", "cross_A2", X, (L3, 0, 0)),
    "beta": ("hip", "cross_A1", Y, (0, L3, 0)),
    "gamma": ("hip", "input_shaft", Z, (0, 0, 0)),
    "theta12": ("cross_A1", "rod_A1B1", X, (0, L3, 0)),
    "theta13": ("rod_A1B1", "cross_B1", X, (0, L3, L1)),
    "theta14": ("cross_B1", "knee", Y, (0, L3, L1)),
    "theta22": ("cross_A2", "rod_A2B2", -Y, (L3, 0, 0)),
    "theta23": ("rod_A2B2", "cross_B2", -Y, (L3, 0, L1)),
    "theta31": ("hip", "cross_A3", -Y, (0, -L3, 0)),
    "theta32": ("cross_A3", "rod_A3B3", -X, (0, -L3, 0)),
    "theta33": ("rod_A3B3", "cross_B3", -X, (0, -L3, L1)),
    "cardan_A4_y": ("input_shaft", "cross_A4", Y, (0, 0, 0)),
    "cardan_A4_x": ("cross_A4", "shaft_A4B4", X, (0, 0, 0)),
    "gamma_output": ("knee", "output_shaft", Z, (0, 0, L1)),
    "cardan_B4_y": ("output_shaft", "cross_B4", Y, (0, 0, L1)),
}
LINK_ORIGINS = {
    **{
        f"{body}_A{k}{end}": place
        for k, place in ((1, (0, L3, 0)), (2, (L3, 0, 0)), (3, (0, -L3, 0)))
        for body, end in (("cross", ""), ("rod", f"B{k}"))
    },
    **{f"cross_B{k}": place for k, place in ((1, (0, L3, L1)), (2, (L3, 0, L1)), (3, (0, -L3, L1)))},
    **dict.fromkeys(("input_shaft", "cross_A4", "shaft_A4B4"), (0, 0, 0)),
    **dict.fromkeys(("knee", "output_shaft", "cross_B4"), (0, 0, L1)),
    "foot": (0, 0, L1 + L5 + 2 * L4),
}
for _i, _psi in enumerate(PSI, start=1):
    _radial = np.array([np.cos(_psi), np.sin(_psi), 0.0])
    _C, _D, _E = (R_C * _radial + (0, 0, L1 + L5 + n * L4) for n in range(3))
    JOINTS[f"gamma_C{_i}"] = ("knee", f"link_C{_i}D{_i}", _radial, _C)
    JOINTS[f"phi_D{_i}"] = (f"link_C{_i}D{_i}", f"link_D{_i}E{_i}", _radial, _D)
    LINK_ORIGINS |= {f"link_C{_i}D{_i}": _C, f"driven_gear_{_i}": _C, f"link_D{_i}E{_i}": _D}
    if _i == 1:
        JOINTS["epsilon_E1"] = ("link_D1E1", "foot", _radial, _E)


def test_links_and_joints_have_the_agreed_names(tree):
    assert set(tree.links) == {*LINK_ORIGINS, "base", "hip", "motor_M1", "motor_M2", "motor_M3"}
    assert len(LINK_ORIGINS) == 25
    assert set(tree.moving) == set(JOINTS)
    assert len(tree.moving) == 22
    fixed = {tree.ends(name) for name in tree.joints if name not in tree.moving}
    assert fixed == {
        ("base", "hip"),
        *(("hip", f"motor_M{i}") for i in (1, 2, 3)),
        *((f"link_C{i}D{i}", f"driven_gear_{i}") for i in (1, 2, 3)),
    }


def test_independent_joints_come_first_and_in_order(tree):
    assert tree.moving[:3] == ["alpha", "beta", "gamma"]
    flags = {name: tree.joints[name].get("independent") for name in tree.moving}
    assert [name for name, flag in flags.items() if flag == "true"] == ["alpha", "beta", "gamma"]
    assert set(flags.values()) == {"true", "false"}
    assert {tree.joints[name].get("type") for name in tree.moving} == {"revolute"}


def test_base_is_z_up_and_hip_is_z_down(tree):
    mount = tree.joints["base_to_hip"]
    assert tree.ends("base_to_hip") == ("base", "hip")
    assert mount.find("origin").get("rpy").split() == ["3.141592653589793", "0", "0"]
    assert np.array_equal(origin(mount)[:3, 3], np.zeros(3))


@pytest.mark.parametrize("name", JOINTS)
def test_joint_axis_in_the_zero_pose(tree, name):
    parent, child, axis, point = JOINTS[name]
    assert tree.ends(name) == (parent, child)
    frame = tree.frames({})[child]
    np.testing.assert_allclose(frame[:3, :3] @ vector(tree.joints[name].find("axis").get("xyz")), axis, atol=1e-15)
    np.testing.assert_allclose(np.cross(frame[:3, 3] - point, axis), 0, atol=1e-16)  # the axis passes through the point


def test_link_frames_in_the_zero_pose(tree):
    frames = tree.frames({})
    for name, place in LINK_ORIGINS.items():
        np.testing.assert_allclose(frames[name][:3, 3], place, atol=1e-15, err_msg=name)
        shank = name.startswith(("link_", "driven_gear_"))
        expected = rotation(Z, PSI[int(name[-1]) - 1]) if shank else np.eye(3)
        np.testing.assert_allclose(frames[name][:3, :3], expected, atol=1e-15, err_msg=name)


# Closure


def test_every_loop_is_there(tree):
    found = {
        name: (loop.get("type"), loop.find("predecessor").get("link"), loop.find("successor").get("link"))
        for name, loop in tree.loops.items()
    }
    assert found == {
        "loop_B2": ("revolute", "knee", "cross_B2"),
        "loop_B3": ("revolute", "knee", "cross_B3"),
        "loop_B4": ("revolute", "shaft_A4B4", "cross_B4"),
        "loop_E2": ("revolute", "link_D2E2", "foot"),
        "loop_E3": ("revolute", "link_D3E3", "foot"),
    }


def test_loop_frames_coincide_in_the_zero_pose(tree):
    frames = tree.frames({})
    for loop in tree.loops.values():
        one, other = (
            frames[end.get("link")] @ origin(end) for end in (loop.find("predecessor"), loop.find("successor"))
        )
        np.testing.assert_allclose(one, other, atol=1e-15)


def test_loop_axes_are_the_hinges_of_the_mechanism(tree):
    frames = tree.frames({})
    expected = {"loop_B2": X, "loop_B3": Y, "loop_B4": X}
    expected |= {f"loop_E{i}": rotation(Z, PSI[i - 1]) @ X for i in (2, 3)}
    for name, loop in tree.loops.items():
        end = loop.find("predecessor")
        axis = (frames[end.get("link")] @ origin(end))[:3, :3] @ vector(loop.find("axis").get("xyz"))
        np.testing.assert_allclose(axis, expected[name], atol=1e-15)


@pytest.mark.parametrize("pose", random_poses(40), ids=lambda pose: "{:.0f},{:.0f},{:.0f}".format(*np.degrees(pose)))
def test_every_loop_closes_at_the_closed_values(tree, pose):
    frames = tree.frames(closed_values(*pose))
    for name in tree.loops:
        assert max(tree.loop_gap(name, frames)) < 2e-15, name


def test_the_printed_sign_of_theta22_leaves_the_loop_open(tree):
    values = closed_values(*np.radians([30.0, 20.0, 40.0]))
    values |= {"theta22": -values["theta22"], "theta23": -values["theta23"]}
    gap, _ = tree.loop_gap("loop_B2", tree.frames(values))
    assert gap == pytest.approx(0.0902, abs=5e-5)


def test_a_wrong_shank_angle_opens_the_foot_loops(tree):
    values = closed_values(0.1, 0.2, 0.5) | {"phi_D2": -0.9}
    gap, tilt = tree.loop_gap("loop_E2", tree.frames(values))
    assert gap == pytest.approx(2 * L4 * np.sin(0.05), abs=1e-12)
    assert tilt < 1e-15  # turning about the hinge axis keeps it parallel


@pytest.mark.parametrize("pose", random_poses(10, seed=1))
def test_knee_and_foot_only_translate(tree, pose):
    alpha, beta, gamma = pose
    frames = tree.frames(closed_values(*pose))
    thigh = L1 * np.array([np.tan(beta), -np.tan(alpha), 1]) / np.sqrt(1 + np.tan(alpha) ** 2 + np.tan(beta) ** 2)
    for link, place in (("knee", thigh), ("foot", thigh + (2 * L4 * np.cos(gamma) + L5) * Z)):
        np.testing.assert_allclose(frames[link][:3, :3], np.eye(3), atol=2e-15)
        np.testing.assert_allclose(frames[link][:3, 3], place, atol=1e-15)


@pytest.mark.parametrize("pose", random_poses(10, seed=2))
def test_output_shaft_turns_as_the_input_shaft(tree, pose):
    frames = tree.frames(closed_values(*pose))
    np.testing.assert_allclose(frames["output_shaft"][:3, :3], frames["input_shaft"][:3, :3], atol=2e-15)


def test_couplings_hold_at_the_closed_values(tree):
    couplings = tree.root.findall("coupling")
    assert [coupling.get("name") for coupling in couplings] == ["bevel_1", "bevel_2", "bevel_3"]
    parent_joint = {tree.ends(name)[1]: name for name in tree.joints}
    values = closed_values(0.4, -0.3, 0.7)

    def turn_on_knee(link: str) -> float:
        total = 0.0
        while link != "knee":
            total += values.get(parent_joint[link], 0.0)
            link = tree.ends(parent_joint[link])[0]
        return total

    for i, coupling in enumerate(couplings, start=1):
        ends = coupling.find("predecessor").get("link"), coupling.find("successor").get("link")
        assert ends == ("output_shaft", f"driven_gear_{i}")
        ratio = float(coupling.find("ratio").get("value"))
        assert ratio == 1.0
        assert turn_on_knee(ends[1]) == ratio * turn_on_knee(ends[0]) == 0.7


@pytest.mark.parametrize("i", [1, 2, 3])
def test_drawn_bevel_gears_roll_on_each_other(tree, i):
    """Where the driver's and a driven gear's drawn cones touch, both move alike for +gamma."""
    home, turned = (tree.frames(closed_values(0, 0, gamma)) for gamma in (0.0, 1e-6))
    cones = {}
    for name in ("output_shaft", f"driven_gear_{i}"):
        discs = [v for v in tree.links[name].findall("visual") if v.find("geometry/cylinder") is not None]
        discs = [disc for disc in discs if disc.find("material").get("name") == "brass"]
        widest = max(discs, key=lambda disc: float(disc.find("geometry/cylinder").get("radius")))
        cones[name] = home[name] @ origin(widest), float(widest.find("geometry/cylinder").get("radius"))
    (driver, radius), (driven, other_radius) = cones.values()
    radial = rotation(Z, PSI[i - 1]) @ X
    contact = driver[:3, 3] + radius * radial
    assert radius == other_radius
    np.testing.assert_allclose(contact, driven[:3, 3] - radius * Z, atol=1e-12)
    moved = [turned[name] @ np.linalg.inv(home[name]) @ [*contact, 1.0] for name in cones]
    assert np.linalg.norm(moved[0][:3] - contact) == pytest.approx(1e-6 * radius, rel=1e-6)
    np.testing.assert_allclose(moved[0], moved[1], atol=1e-12)


def test_configurations_name_every_joint_and_close(tree):
    found = {
        element.get("name"): {joint.get("name"): float(joint.get("value")) for joint in element}
        for element in tree.root.findall("configuration")
    }
    assert list(found) == ["home", "bent"]
    for name, values in found.items():
        assert values == pytest.approx(closed_values(*DOWN[name]), abs=1e-16)
        frames = tree.frames(values)
        assert max(max(tree.loop_gap(loop, frames)) for loop in tree.loops) < 1e-15


@pytest.mark.parametrize(
    "changes",
    [{"psi_1": 33.0, "psi_2": 100.0, "psi_3": -75.0}, {"L1": 0.2, "L3": 0.06, "L4": 0.11, "L5": 0.13, "R_C": 0.04}],
    ids=["azimuths", "lengths"],
)
def test_changed_geometry_still_closes(changes):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        changed = Tree(render(shipped_xacro("omnileg"), changes))
    for pose in random_poses(4, seed=3):
        frames = changed.frames(closed_values(*pose))
        assert max(max(changed.loop_gap(name, frames)) for name in changed.loops) < 2e-15
        np.testing.assert_allclose(frames["foot"][:3, :3], np.eye(3), atol=2e-15)
        height = changes.get("L5", L5) + 2 * changes.get("L4", L4) * np.cos(pose[2])
        np.testing.assert_allclose(frames["foot"][:3, 3] - frames["knee"][:3, 3], (0, 0, height), atol=1e-15)
    c2 = changed.frames({})["link_C2D2"]
    assert np.arctan2(c2[1, 0], c2[0, 0]) == pytest.approx(np.radians(changes.get("psi_2", 120.0)), abs=1e-15)
    assert np.hypot(c2[0, 3], c2[1, 3]) == pytest.approx(changes.get("R_C", R_C), abs=1e-15)


# Bodies


def box(mass, x, y, z):
    return mass / 12 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])


def tube(mass, length, outer, inner=0.0):
    across = mass * (3 * (outer**2 + inner**2) + length**2) / 12
    return np.diag([across, across, mass * (outer**2 + inner**2) / 2])


ABOUT_X = [2, 0, 1]  # reads diag(x, y, z) of a body along z as diag of the same body along x
BODIES = {
    "cross": (0.025, (0, 0, 0), np.diag([1.2, 2.25, 2.25]) * 1e-6),
    "rod": (0.070, (0, 0, L1 / 2), tube(0.070, L1, 0.008, 0.006)),
    "driven_gear": (0.030, (0.012, 0, 0), tube(0.030, 0.012, 0.012, 0.004)[np.ix_(ABOUT_X, ABOUT_X)]),
    "link": (0.040, (0, 0, L4 / 2), box(0.040, 0.006, 0.018, L4)),
    "shaft": (0.059, (0, 0, L1 / 2), tube(0.059, L1, 0.004)),
    "input_shaft": (0.025, (0, 0, -0.02), tube(0.025, 0.04, 0.005)),
    "output_shaft": (0.105, (0, 0, 0.08), tube(0.105, 0.15, 0.006)),
    "knee": (0.70, (0, 0, 0.07), tube(0.70, 0.14, 0.10)),
    "foot": (0.22, (0, 0, 0), tube(0.22, 0.010, 0.06)),
}


@pytest.mark.parametrize("name", LINK_ORIGINS)
def test_body(tree, name):
    kind = name if name in BODIES else name.rpartition("_")[0]
    mass, com, tensor = inertial(tree.links[name])
    assert mass == BODIES[kind][0]
    np.testing.assert_array_equal(com, BODIES[kind][1])
    np.testing.assert_allclose(tensor, BODIES[kind][2], rtol=1e-14, atol=0)


def test_moving_mass(tree):
    assert sum(inertial(tree.links[name])[0] for name in LINK_ORIGINS) == pytest.approx(1.849, rel=1e-14)


def test_hip_with_motors_weighs_as_assumed(tree):
    names = ("hip", "motor_M1", "motor_M2", "motor_M3")
    assert sum(inertial(tree.links[name])[0] for name in names) == pytest.approx(2.7, rel=1e-14)


def test_every_inertia_is_physical(tree):
    for name, link in tree.links.items():
        if name != "base":
            mass, _, tensor = inertial(link)
            small, middle, large = np.linalg.eigvalsh(tensor)
            assert mass > 0
            assert 0 < small <= middle <= large < small + middle, name


# Limits and actuators


@pytest.mark.parametrize(("name", "lower", "upper"), [("alpha", -65, 65), ("beta", -65, 65), ("gamma", 0, 85)])
def test_driven_joint_limits(tree, name, lower, upper):
    limit = tree.joints[name].find("limit")
    assert [float(limit.get(key)) for key in ("lower", "upper")] == [np.radians(lower), np.radians(upper)]
    assert [float(limit.get(key)) for key in ("effort", "velocity")] == [12.0, 20.0]
    assert tree.joints[name].find("dynamics").attrib == {"damping": "0", "friction": "0"}


def test_dependent_joint_limits_never_bind(tree):
    limits = {name: tree.joints[name].find("limit") for name in tree.moving[3:]}
    for pose in random_poses(200, seed=4):
        for name, value in closed_values(*pose).items():
            if name in limits:
                assert float(limits[name].get("lower")) < value < float(limits[name].get("upper")), name
    assert all(float(limit.get("effort")) > 0 and float(limit.get("velocity")) > 20 for limit in limits.values())


def test_transmissions(tree):
    found = [
        (
            element.find("type").text,
            element.find("joint").get("name"),
            element.find("actuator").get("name"),
            float(element.find("actuator/mechanicalReduction").text),
            float(element.find("actuator/rotorInertia").text),
        )
        for element in tree.root.findall("transmission")
    ]
    simple = "transmission_interface/SimpleTransmission"
    assert found == [(simple, "alpha", "M2", 1, 0), (simple, "beta", "M1", 1, 0), (simple, "gamma", "M3", 1, 0)]


def test_actuator_parameters_reach_their_own_actuator():
    changes = {"M1_rotor_inertia": 1e-4, "M2_rotor_inertia": 2e-4, "M3_rotor_inertia": 3e-4}
    changes |= {"M1_gear_ratio": 5, "M2_gear_ratio": 6, "M3_gear_ratio": 7, "beta_damping": 0.25, "gamma_friction": 0.5}
    changed = Tree(render(shipped_xacro("omnileg"), changes))
    actuators = {element.get("name"): element for element in changed.root.iterfind("transmission/actuator")}
    for i, motor in enumerate(("M1", "M2", "M3"), start=1):
        assert float(actuators[motor].find("rotorInertia").text) == pytest.approx(i * 1e-4)
        assert float(actuators[motor].find("mechanicalReduction").text) == 4 + i
    assert float(changed.joints["beta"].find("dynamics").get("damping")) == 0.25
    assert float(changed.joints["gamma"].find("dynamics").get("friction")) == 0.5
    assert float(changed.joints["alpha"].find("dynamics").get("friction")) == 0.0


# Drawing


def test_every_link_is_drawn_with_primitives_in_known_colours(tree):
    materials = {material.get("name") for material in tree.root.findall("material")}
    for name, link in tree.links.items():
        visuals = link.findall("visual")
        assert bool(visuals) == (name != "base"), name
        assert {visual.find("material").get("name") for visual in visuals} <= materials
        for shape in link.iterfind("*/geometry/*"):
            assert shape.tag in {"box", "cylinder", "sphere"}
            assert all((vector(size) > 0).all() for size in shape.attrib.values()), name


def test_collision_shapes(tree):
    solid = {name for name, link in tree.links.items() if link.find("collision") is not None}
    rods = {f"rod_A{k}B{k}" for k in (1, 2, 3)}
    assert solid == rods | {"knee", "foot"} | {
        f"link_{ends.format(i)}" for i in (1, 2, 3) for ends in ("C{0}D{0}", "D{0}E{0}")
    }
    for rod in rods:  # the axes come within 31.7 mm of the Cardan shaft
        assert all(2 * float(shape.get("radius")) <= 0.025 for shape in tree.links[rod].iterfind("*/geometry/cylinder"))


# Other readers


def test_pinocchio_reads_it_as_an_open_tree():
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(FILE.read_text(encoding="utf-8"))
    assert (model.nq, model.nv) == (22, 22)
    assert sum(inertia.mass for inertia in list(model.inertias)[1:]) == pytest.approx(1.849, rel=1e-14)


def test_yourdfpy_reads_it_without_complaint():
    yourdfpy = pytest.importorskip("yourdfpy")
    robot = yourdfpy.URDF.load(str(FILE))
    assert robot.validate()
    assert len(robot.link_map) == 30
    assert list(robot.actuated_joint_names[:3]) == ["alpha", "beta", "gamma"]
    assert robot.scene.extents[2] == pytest.approx(0.62, abs=0.05)
