"""Synthetic mechanisms as URDF+ text, and oracles that share nothing with the room under test but the file."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from leg_dynamics.description import link_transforms, parse, read
from leg_dynamics.mechanism.closure import Closure
from leg_dynamics.mechanism.mechanism import Mechanism
from leg_dynamics.mechanism.tree import FrameMemory, Tree

# Files that others wrote, beside a checkout on some machines.
SHARED_MODELS = Path(__file__).resolve().parents[3] / "shared" / "models" / "urdf_plus"
ZERO = (0.0, 0.0, 0.0)


def words(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def origin(xyz: Sequence[float] = ZERO, rpy: Sequence[float] = ZERO) -> str:
    return f'<origin xyz="{words(xyz)}" rpy="{words(rpy)}"/>'


def rpy_of(rotation: np.ndarray) -> tuple[float, float, float]:
    return tuple(pin.rpy.matrixToRpy(rotation))


@dataclass
class Text:
    """A URDF+ file under construction."""

    name: str = "synthetic"
    seed: int = 0
    parts: list[str] = field(default_factory=list)
    links: list[str] = field(default_factory=list)

    def link(self, name: str, mass: float | None = None) -> Text:
        """A body with a random, physical inertia; `mass` 0 leaves it massless."""
        generator = np.random.default_rng([self.seed, len(self.links)])
        self.links.append(name)
        mass = float(generator.uniform(0.2, 1.0)) if mass is None else mass
        if mass == 0.0:
            self.parts.append(f'<link name="{name}"/>')
            return self
        points = generator.normal(scale=0.1, size=(8, 3))
        second = points.T @ points / 8.0
        tensor = mass * (np.trace(second) * np.eye(3) - second)
        ixx, ixy, ixz, iyy, iyz, izz = (repr(float(value)) for value in tensor[np.triu_indices(3)])
        self.parts.append(
            f'<link name="{name}"><inertial>{origin(generator.normal(scale=0.05, size=3))}<mass value="{mass!r}"/>'
            f'<inertia ixx="{ixx}" ixy="{ixy}" ixz="{ixz}" iyy="{iyy}" iyz="{iyz}" izz="{izz}"/></inertial></link>'
        )
        return self

    def point_mass(self, name: str, mass: float) -> Text:
        """A small ball: its weight acts at the link's origin."""
        self.links.append(name)
        self.parts.append(
            f'<link name="{name}"><inertial><mass value="{mass!r}"/>'
            '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>'
        )
        return self

    def joint(
        self,
        name: str,
        kind: str,
        parent: str,
        child: str,
        axis: Sequence[float] = (0.0, 0.0, 1.0),
        xyz: Sequence[float] = ZERO,
        rpy: Sequence[float] = ZERO,
        *,
        independent: bool | None = None,
        limit: tuple[float, float] = (-10.0, 10.0),
        damping: float = 0.0,
        friction: float = 0.0,
        extra: str = "",
        mass: float | None = None,
    ) -> Text:
        for link in (parent, child):
            if link not in self.links:
                self.link(link, mass if link == child else 0.0)
        flag = "" if independent is None else f' independent="{str(independent).lower()}"'
        bounds = f'lower="{limit[0]!r}" upper="{limit[1]!r}" '
        limits = f'<limit {bounds}effort="100" velocity="100"/>' if kind in ("revolute", "prismatic") else ""
        dynamics = f'<dynamics damping="{damping!r}" friction="{friction!r}"/>' if damping or friction else ""
        self.parts.append(
            f'<joint name="{name}" type="{kind}"{flag}><parent link="{parent}"/><child link="{child}"/>'
            f'{origin(xyz, rpy)}<axis xyz="{words(axis)}"/>{limits}{dynamics}{extra}</joint>'
        )
        return self

    def loop(
        self,
        name: str,
        kind: str,
        predecessor: tuple[str, Sequence[float], Sequence[float]],
        successor: tuple[str, Sequence[float], Sequence[float]],
        axis: Sequence[float] | None = (0.0, 0.0, 1.0),
    ) -> Text:
        ends = "".join(
            f'<{tag} link="{link}">{origin(xyz, rpy)}</{tag}>'
            for tag, (link, xyz, rpy) in (("predecessor", predecessor), ("successor", successor))
        )
        line = "" if axis is None else f'<axis xyz="{words(axis)}"/>'
        self.parts.append(f'<loop name="{name}" type="{kind}">{ends}{line}</loop>')
        return self

    def coupling(self, name: str, predecessor: str, successor: str, ratio: float) -> Text:
        self.parts.append(
            f'<coupling name="{name}"><predecessor link="{predecessor}"/><successor link="{successor}"/>'
            f'<ratio value="{ratio!r}"/></coupling>'
        )
        return self

    def motor(self, joint: str, reduction: float = 1.0, rotor_inertia: float = 0.0) -> Text:
        self.parts.append(
            f'<transmission name="drive_{joint}"><type>transmission_interface/SimpleTransmission</type>'
            f'<joint name="{joint}"/><actuator name="M_{joint}">'
            f"<mechanicalReduction>{reduction!r}</mechanicalReduction><rotorInertia>{rotor_inertia!r}</rotorInertia></actuator></transmission>"
        )
        return self

    def configuration(self, name: str, values: Mapping[str, float]) -> Text:
        joints = "".join(f'<joint name="{joint}" value="{float(value)!r}"/>' for joint, value in values.items())
        self.parts.append(f'<configuration name="{name}">{joints}</configuration>')
        return self

    @property
    def xml(self) -> str:
        return f'<robot name="{self.name}">' + "".join(self.parts) + "</robot>"


# ---------------------------------------------------------------------------------------------- planar mechanisms


@dataclass(frozen=True)
class FourBar:
    """Lengths of a planar four-bar linkage and its closed form, by circle intersection."""

    ground: float = 0.4
    crank: float = 0.15
    coupler: float = 0.4
    rocker: float = 0.3

    def angles(self, theta: float, mode: float) -> tuple[float, float]:
        """(coupler relative to crank, rocker) for one crank angle; `mode` +1 or -1 names the side."""
        pin_at = self.crank * np.array([math.cos(theta), math.sin(theta)])
        base = np.array([self.ground, 0.0])
        reach = base - pin_at
        distance = float(np.hypot(*reach))
        along = (self.coupler**2 - self.rocker**2 + distance**2) / (2.0 * distance)
        height = math.sqrt(self.coupler**2 - along**2)
        u = reach / distance
        meeting = pin_at + along * u + mode * height * np.array([-u[1], u[0]])
        coupler = math.atan2(*(meeting - pin_at)[::-1])
        rocker = math.atan2(*(meeting - base)[::-1])
        return math.remainder(coupler - theta, 2.0 * math.pi), rocker

    def text(self, theta: float = 0.6, mode: float = 1.0, *, home: bool = True, scale: float = 1.0, **options) -> Text:
        """The linkage in a tilted plane; `options` go to the crank joint."""
        kind = options.pop("kind", "revolute")
        flags = options.pop("flags", (True, False, False))
        decimals = options.pop("decimals", 17)
        text = Text("four_bar", seed=3).link("base", 0.0).link("world", 0.0)
        text.joint("mount", "fixed", "world", "base", xyz=(1.0, -2.0, 0.5), rpy=(0.3, -0.5, 0.2))
        text.joint("crank", kind, "base", "crank_link", independent=flags[0], **options)
        text.joint("coupler", kind, "crank_link", "coupler_link", xyz=(self.crank * scale, 0, 0), independent=flags[1])
        text.joint("rocker", kind, "base", "rocker_link", xyz=(self.ground * scale, 0, 0), independent=flags[2])
        text.loop(
            "pin",
            "revolute",
            ("coupler_link", (self.coupler * scale, 0, 0), ZERO),
            ("rocker_link", (self.rocker * scale, 0, 0), ZERO),
        )
        if home:
            coupler, rocker = self.angles(theta, mode)
            values = {"crank": theta, "coupler": coupler, "rocker": rocker}
            text.configuration("home", {name: round(value, decimals) for name, value in values.items()})
        return text


PARALLELOGRAM = FourBar(0.5, 0.2, 0.5, 0.2)


def parallelogram(theta: float = 0.8, copies: int = 1) -> Text:
    """Parallelogram linkages side by side on one crank: each turns its dependent columns singular at the flat pose."""
    text = Text("parallelogram", seed=5).link("base", 0.0)
    text.joint("crank", "revolute", "base", "crank_link", independent=True)
    values = {"crank": theta}
    for i in range(copies):
        for name, parent, x in ((f"coupler{i}", "crank_link", 0.2), (f"rocker{i}", "base", 0.5)):
            child = name.replace(str(i), f"_link{i}")
            text.joint(name, "revolute", parent, child, xyz=(x, 0, 0.1 * i), independent=False)
        text.loop(
            f"pin{i}", "revolute", (f"coupler_link{i}", (0.5, 0, 0), ZERO), (f"rocker_link{i}", (0.2, 0, 0), ZERO)
        )
        values |= {f"coupler{i}": -theta, f"rocker{i}": theta}
    return text.configuration("home", values)


def slider_crank(theta: float = 0.7, crank: float = 0.1, rod: float = 0.3, loop: str = "revolute") -> Text:
    """A slider-crank with the slider in the tree (loop `revolute`) or as the loop itself (`prismatic`)."""
    text = Text("slider_crank", seed=7).link("base", 0.0)
    text.joint("crank", "revolute", "base", "crank_link", independent=True)
    text.joint("rod", "revolute", "crank_link", "rod_link", xyz=(crank, 0, 0), independent=False)
    incline = -math.asin(crank / rod * math.sin(theta))
    reach = crank * math.cos(theta) + rod * math.cos(incline)
    values = {"crank": theta, "rod": incline - theta}
    if loop == "prismatic":
        text.joint("wrist", "revolute", "rod_link", "piston", xyz=(rod, 0, 0), independent=False)
        text.loop("guide", "prismatic", ("base", (0.2, 0, 0), ZERO), ("piston", ZERO, ZERO), (1, 0, 0))
        return text.configuration("home", values | {"wrist": -incline})
    text.joint("slide", "prismatic", "base", "piston", (1, 0, 0), xyz=(0.2, 0, 0), independent=False)
    text.loop("wrist", "revolute", ("rod_link", (rod, 0, 0), ZERO), ("piston", ZERO, ZERO))
    return text.configuration("home", values | {"slide": reach - 0.2})


def slider_reach(theta: float, crank: float = 0.1, rod: float = 0.3) -> float:
    return crank * math.cos(theta) + math.sqrt(rod**2 - (crank * math.sin(theta)) ** 2)


def gears() -> Text:
    """A gear pair (ratio -2.5), a rack that mimics with an offset, and a foot on the driven gear."""
    text = Text("gears", seed=11).link("base", 0.0)
    text.joint("driver", "continuous", "base", "driver_link", independent=True)
    text.joint("driven", "revolute", "base", "driven_link", (0, 1, 0), (0.3, 0, 0), independent=False)
    text.joint(
        "rack",
        "prismatic",
        "driven_link",
        "foot",
        (1, 0, 0),
        (0.1, 0, 0.2),
        extra='<mimic joint="driver" multiplier="0.05" offset="0.03"/>',
    )
    text.coupling("mesh", "driver_link", "driven_link", -2.5)
    return text.configuration("home", {"driver": 0.4, "driven": -1.0, "rack": 0.05})


def open_chain(**options) -> Text:
    """A hip turned against the root, then continuous, revolute and prismatic joints to a foot."""
    text = Text("open_chain", seed=13).link("base", 0.0).link("hip", 0.0)
    text.joint("mount", "fixed", "base", "hip", xyz=(0.1, 0.2, 0.3), rpy=(math.pi, 0.2, 0.0))
    text.joint("yaw", "continuous", "hip", "yaw_link", (0.6, 0.0, 0.8), (0.05, 0, 0), (0.1, 0.2, 0.3), **options)
    text.joint("knee", "revolute", "yaw_link", "knee_link", (0, 1, 0), (0, 0.1, 0.3), **options)
    return text.joint("strut", "prismatic", "knee_link", "foot", (0, 0, 1), (0, 0, 0.2), **options)


# ------------------------------------------------------------------------------------ any loop, closed at a random pose

LOOP_ROWS = {"revolute": 5, "continuous": 5, "prismatic": 5, "fixed": 6, "planar": 3, "spherical": 3, "universal": 4}
SLIDING_MOTION = {
    "revolute": lambda a, b, c: pin.SE3(pin.utils.rotate("z", a), np.zeros(3)),
    "continuous": lambda a, b, c: pin.SE3(pin.utils.rotate("z", a), np.zeros(3)),
    "prismatic": lambda a, b, c: pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2 * a])),
    "fixed": lambda a, b, c: pin.SE3.Identity(),
    "planar": lambda a, b, c: pin.SE3(pin.utils.rotate("z", a), np.array([0.2 * b, 0.2 * c, 0.0])),
    "spherical": lambda a, b, c: pin.SE3(pin.rpy.rpyToMatrix(a, b, c), np.zeros(3)),
    # turns about the predecessor's x, then about the successor's y
    "universal": lambda a, b, c: pin.SE3(pin.utils.rotate("x", a) @ pin.utils.rotate("y", b), np.zeros(3)),
}


def random_loop(kind: str, seed: int, flags: Mapping[str, bool] | None = None) -> str:
    """Two random branches of four joints, some continuous or prismatic, joined by a loop that a random pose closes."""
    generator = np.random.default_rng([seed, LOOP_ROWS[kind], len(kind)])
    text = Text(f"random_{kind}", seed=seed).link("base", 0.0)
    values = {}
    for branch in "ab":
        parent = "base"
        for number in range(4):
            name = f"{branch}{number}"
            joint_kind = ("revolute", "continuous", "revolute", "prismatic")[generator.integers(4)]
            axis = generator.normal(size=3)
            text.joint(
                name,
                joint_kind,
                parent,
                f"link_{name}",
                axis / np.linalg.norm(axis),
                generator.normal(scale=0.2, size=3),
                generator.uniform(-1, 1, 3),
                independent=None if flags is None else flags[name],
            )
            parent = f"link_{name}"
            values[name] = float(generator.uniform(-0.8, 0.8)) * (0.2 if joint_kind == "prismatic" else 1.0)
    transforms = link_transforms(parse(text.xml), values)
    axis = generator.normal(size=3)
    axis /= np.linalg.norm(axis)
    predecessor = pin.SE3(pin.rpy.rpyToMatrix(*generator.uniform(-1, 1, 3)), generator.normal(scale=0.1, size=3))
    align = pin.SE3.Identity()
    if kind not in ("spherical", "universal", "fixed"):
        align = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).toRotationMatrix(), np.zeros(3))
    moved = align * SLIDING_MOTION[kind](*generator.uniform(-1.0, 1.0, 3)) * align.inverse()
    world = pin.SE3(transforms["link_a3"]) * predecessor * moved
    successor = pin.SE3(transforms["link_b3"]).inverse() * world
    text.loop(
        "closing",
        kind,
        ("link_a3", predecessor.translation, rpy_of(predecessor.rotation)),
        ("link_b3", successor.translation, rpy_of(successor.rotation)),
        axis if kind not in ("spherical", "universal", "fixed") else None,
    )
    return text.configuration("home", values).xml


def closed_mechanism(kind: str, seed: int) -> Mechanism:
    """`random_loop` with the best-conditioned choice of independent joints."""
    from scipy.linalg import qr

    bench = Bench(random_loop(kind, seed))
    _, _, order = qr(bench.rows(bench.home).jacobian, pivoting=True)
    flags = dict.fromkeys(bench.tree.joint_names, True)
    for index in order[: LOOP_ROWS[kind]]:
        flags[bench.tree.joint_names[index]] = False
    return Mechanism(parse(random_loop(kind, seed, flags)), foot="link_b3")


class Bench:
    """Tree and closure of a text, without a mechanism: rows at any pose."""

    def __init__(self, xml: str) -> None:
        self.description = parse(xml)
        self.tree = Tree.from_description(self.description)
        self.closure = Closure(self.description, self.tree)
        self.model = self.tree.model
        self.data = self.model.createData()
        self.memory = FrameMemory(self.model, self.data)
        home = self.description.home
        self.home = np.array([home.values.get(name, 0.0) if home else 0.0 for name in self.tree.joint_names])

    def rows(self, q: np.ndarray):
        pin.computeJointJacobians(self.model, self.data, self.tree.to_configuration(q))
        pin.updateFramePlacements(self.model, self.data)
        return self.closure.evaluate(q, self.memory.rows(), self.data.J)

    def drift(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        rows = self.rows(q)
        pin.computeJointJacobiansTimeVariation(self.model, self.data, self.tree.to_configuration(q), qd)
        return self.closure.drift(rows, qd, self.data.J, self.data.dJ)


# --------------------------------------------------------------------------------------------------------- oracles


def kkt_acceleration(mechanism: Mechanism, state, v, tree_effort: np.ndarray, gravity=None) -> np.ndarray:
    """Tree accelerations from the full system [M K^T; K 0], least squares: no G anywhere."""
    model = mechanism.tree.model.copy()
    world = mechanism.hip_rotation @ (mechanism.gravity if gravity is None else gravity)
    model.gravity.linear = world
    data = model.createData()
    configuration = mechanism.tree.to_configuration(state.q)
    qd = state.G @ v
    mass = pin.crba(model, data, configuration)
    mass = np.triu(mass) + np.triu(mass, 1).T
    bias = pin.rnea(model, data, configuration, qd, np.zeros(mechanism.nv))
    pin.computeJointJacobiansTimeVariation(model, data, configuration, qd)
    rows = mechanism.evaluate(state.q)
    k = mechanism.closure.drift(rows, qd, data.J, data.dJ)
    K, r = rows.jacobian, mechanism.closure.rows
    system = np.block([[mass, K.T], [K, np.zeros((r, r))]])
    solution, *_ = np.linalg.lstsq(system, np.concatenate([tree_effort - bias, k]), rcond=1e-11)
    return solution[: mechanism.nv]


def omnileg_tree(q: np.ndarray) -> dict[str, float]:
    """Closed passive coordinates of the OmniLeg, from the geometry of its universal joints."""
    alpha, beta, gamma = q
    theta12 = math.atan(math.tan(alpha) * math.cos(beta))
    theta22 = -math.atan(math.tan(beta) * math.cos(alpha))
    rod = np.array([math.tan(beta), -math.tan(alpha), 1.0])
    rod /= np.linalg.norm(rod)
    c, s = math.cos(gamma), math.sin(gamma)
    seen = np.array([c * rod[0] + s * rod[1], -s * rod[0] + c * rod[1], rod[2]])
    a, b = math.atan2(seen[0], seen[2]), math.asin(-seen[1])
    values = {"alpha": alpha, "beta": beta, "gamma": gamma}
    values |= {"theta12": theta12, "theta13": -theta12, "theta14": -beta, "theta22": theta22, "theta23": -theta22}
    values |= {"theta31": -beta, "theta32": -theta12, "theta33": theta12}
    values |= {"cardan_A4_y": a, "cardan_A4_x": b, "gamma_output": gamma, "cardan_B4_y": a, "epsilon_E1": gamma}
    for i in (1, 2, 3):
        values |= {f"gamma_C{i}": gamma, f"phi_D{i}": -2.0 * gamma}
    return values


@pytest.fixture(scope="session")
def lab():
    """This file's builders and oracles."""
    return sys.modules[__name__]


@pytest.fixture(scope="session")
def omnileg_description():
    return read("omnileg")


@pytest.fixture
def omnileg(omnileg_description):
    return Mechanism(omnileg_description, foot="foot", hip="hip")


@pytest.fixture(scope="session")
def omnileg_box():
    return np.radians([-65.0, -65.0, -45.0]), np.radians([65.0, 65.0, 85.0])
