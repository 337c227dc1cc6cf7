"""Random mechanisms as URDF+ text: what Hypothesis draws is their structure, a seed makes their numbers.

Loops are laid out open and closed at a random pose: the successor's loop frame is put where the pair needs it. Which
joints are independent is decided by the rank of all rows there, with the test's own kinematics.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace

import numpy as np
from hypothesis import strategies as st
from scipy.linalg import qr
from scipy.spatial.transform import Rotation
from symbolic_oracle import Oracle

LOOP_ROWS = {"revolute": 5, "continuous": 5, "prismatic": 5, "fixed": 6, "planar": 3, "spherical": 3, "universal": 4}
# In a plane: the pair's axis along the plane's normal or in the plane, and the rank of its rows.
IN_PLANE = {
    "revolute": ("normal", 2),
    "continuous": ("normal", 2),
    "spherical": ("normal", 2),
    "universal": ("normal", 2),
    "prismatic": ("inside", 2),
    "planar": ("inside", 2),
    "fixed": ("normal", 3),
}
RATIOS = (1.0, -1.0, 2.0, -0.5, 3.0, -2.5, 0.75)
# Slides of a decimetre count as turns of a radian.
SLIDE = 0.1
# Poses whose rows are worse conditioned are not home.
REGULAR = 0.03


@dataclass(frozen=True)
class Block:
    """A part of a mechanism: what it is, its pair, and counts that each kind reads its own way."""

    what: str
    kind: str = ""
    spare: int = 0
    sliders: int = 0
    before: int = 1
    after: int = 1
    elsewhere: bool = False


@dataclass(frozen=True)
class Plan:
    seed: int
    mount: str
    blocks: tuple[Block, ...]
    drive: str
    limits: str
    losses: bool
    bodies: str
    foot: str
    flags: str = "stated"
    any_pose: bool = False
    """Whether a singular pose, or a mechanism that cannot move, will do as well."""


def blocks() -> st.SearchStrategy[Block]:
    few = st.integers(0, 1)
    return st.one_of(
        st.sampled_from(sorted(LOOP_ROWS)).flatmap(loops),
        st.just(Block("parallelogram")),
        st.builds(Block, st.just("gear"), sliders=few, before=st.integers(0, 3), after=st.integers(1, 3)),
        st.builds(Block, st.just("mimic"), sliders=few, after=st.integers(1, 3)),
        st.builds(Block, st.just("chain"), sliders=few, after=st.integers(1, 2)),
        st.builds(Block, st.just("leaf"), sliders=few),
        st.just(Block("bridge")),
    )


def loops(kind: str) -> st.SearchStrategy[Block]:
    """A loop of one type, in a plane or in space."""
    counts = (st.integers(0, 1), st.integers(0, 2))
    return st.one_of(
        st.builds(Block, st.just(where), st.just(kind), *counts, elsewhere=st.booleans())
        for where in ("plane", "space")
    )


def plans(first: st.SearchStrategy[Block] | None = None, most: int = 3) -> st.SearchStrategy[Plan]:
    """Plans of one to `most` blocks, the first of a given kind."""
    others = st.lists(blocks(), max_size=most - 1)
    return st.builds(
        Plan,
        st.integers(0, 2**16),
        st.sampled_from(["plain", "turned", "hip"]),
        st.tuples(blocks() if first is None else first, others).map(lambda drawn: (drawn[0], *drawn[1])),
        st.sampled_from(["none", "independent", "dependent", "independent", "too few", "too many"]),
        st.sampled_from(["none", "wide", "narrow", "one-sided"]),
        st.booleans(),
        st.sampled_from(["solid", "solid", "points", "massless"]),
        st.sampled_from(["last", "random", "random", "root", "none"]),
    )


def wild_plans(most: int = 3) -> st.SearchStrategy[Plan]:
    """Plans of everything that files in the wild have: also flags, actuators and bodies that do not fit."""
    return st.builds(
        Plan,
        st.integers(0, 2**32 - 1),
        st.sampled_from(["plain", "turned", "hip"]),
        st.lists(blocks(), min_size=1, max_size=most).map(tuple),
        st.sampled_from(["none", "independent", "independent", "dependent", "too few", "too many", "all", "any"]),
        st.sampled_from(["none", "wide", "narrow", "one-sided"]),
        st.booleans(),
        st.sampled_from(["solid", "points", "massless", "mixed", "mixed"]),
        st.sampled_from(["last", "random", "root", "none"]),
        st.sampled_from(["stated", "stated", "stated", "written oddly", "missing", "dependent only", "wrong"]),
        st.sampled_from([False, False, False, False, False, True]),
    )


def words(values) -> str:
    return " ".join(repr(float(value)) for value in values)


def rpy_of(rotation: Rotation) -> tuple[float, float, float]:
    """Fixed-axis roll, pitch, yaw, also where roll and yaw are the same turn."""
    R = rotation.as_matrix()
    flat = math.hypot(R[0, 0], R[1, 0])
    if flat < 1e-9:
        return math.atan2(-R[1, 2], R[1, 1]), math.atan2(-R[2, 0], flat), 0.0
    return math.atan2(R[2, 1], R[2, 2]), math.atan2(-R[2, 0], flat), math.atan2(R[1, 0], R[0, 0])


@dataclass
class Part:
    name: str
    kind: str
    parent: str
    child: str
    axis: np.ndarray
    xyz: np.ndarray
    rpy: np.ndarray
    mimic: tuple[str, float, float] | None = None


@dataclass
class Pair:
    name: str
    kind: str
    predecessor: str
    successor: str
    rotation: Rotation
    at: np.ndarray
    axis: np.ndarray
    turn: Rotation
    shift: np.ndarray


@dataclass(frozen=True)
class Made:
    """A mechanism's text, its foot and hip, and the independent joints in the file's order."""

    text: str
    foot: str | None
    hip: str | None
    independent: tuple[str, ...]
    plan: Plan

    def oracle(self) -> Oracle:
        return Oracle(self.text, self.independent, foot=self.foot, hip=self.hip)


@dataclass
class Builder:
    """A mechanism in the making."""

    generator: np.random.Generator
    links: list[str] = field(default_factory=lambda: ["root"])
    joints: list[Part] = field(default_factory=list)
    pairs: list[Pair] = field(default_factory=list)
    couplings: list[tuple[str, str, float]] = field(default_factory=list)
    values: dict[str, float] = field(default_factory=dict)

    # ------------------------------------------------------------------ parts

    def pick(self, things):
        return things[int(self.generator.integers(len(things)))]

    def moving(self) -> list[Part]:
        return [joint for joint in self.joints if joint.kind != "fixed"]

    def joint(self, kind, parent, axis=None, xyz=None, rpy=None, value=None, mimic=None) -> str:
        """Add a joint with a new link and return the link."""
        generator = self.generator
        name = f"{'mount' if kind == 'fixed' else 'joint'}_{len(self.joints)}"
        child = f"link_{len(self.links)}"
        self.links.append(child)
        axis = generator.normal(size=3) if axis is None else np.asarray(axis, dtype=float)
        xyz = generator.normal(scale=0.15, size=3) if xyz is None else np.asarray(xyz, dtype=float)
        rpy = generator.uniform(-1.5, 1.5, 3) if rpy is None else np.asarray(rpy, dtype=float)
        self.joints.append(Part(name, kind, parent, child, axis / np.linalg.norm(axis), xyz, rpy, mimic))
        if kind != "fixed":
            usual = float(generator.uniform(-0.8, 0.8)) * (SLIDE if kind == "prismatic" else 1.0)
            self.values[name] = usual if value is None else value
        return child

    def kind_of(self, number: int, sliders: int) -> str:
        """The joints of a branch: so many slide, the others turn, with limits or without."""
        return "prismatic" if number < sliders else self.pick(["revolute", "revolute", "continuous"])

    def branch(self, parent: str, kinds: list[str]) -> str:
        for kind in kinds:
            parent = self.joint(kind, parent)
        return parent

    def flat_branch(self, parent: str, kinds: list[str]) -> str:
        """Joints that move in their parent's x-y plane."""
        for kind in kinds:
            angle = self.generator.uniform(-math.pi, math.pi)
            sign = self.pick([1.0, 1.0, -1.0])
            axis = (math.cos(angle), math.sin(angle), 0.0) if kind == "prismatic" else (0.0, 0.0, sign)
            xyz = self.generator.normal(scale=0.2, size=3)
            parent = self.joint(kind, parent, axis, xyz, (0.0, 0.0, self.generator.uniform(-2.0, 2.0)))
        return parent

    def split(self, block: Block, rank: int) -> tuple[list[str], list[str]]:
        """Kinds of the joints of two branches, as many as a loop of that rank needs and some to spare."""
        kinds = [self.kind_of(number, block.sliders) for number in range(rank + 1 + block.spare)]
        self.generator.shuffle(kinds)
        cut = int(self.generator.integers(1, len(kinds) + 1))
        return kinds[:cut], kinds[cut:]

    def pair(self, kind: str, predecessor: str, successor: str, direction: np.ndarray) -> None:
        """A loop joint whose axis lies along a direction in the predecessor link's frame."""
        a, b, c = self.generator.uniform(-1.0, 1.0, 3)
        turn = Rotation.random(random_state=int(self.generator.integers(2**31)))
        axis = turn.inv().apply(direction)
        along, none, zero = Rotation.from_rotvec, Rotation.identity(), np.zeros(3)
        sideways = np.cross(axis, self.generator.normal(size=3))
        relative, shift = {
            "revolute": (along(a * axis), zero),
            "continuous": (along(a * axis), zero),
            "prismatic": (none, 0.2 * a * axis),
            "fixed": (none, zero),
            "planar": (along(a * axis), 0.2 * b * sideways),
            "spherical": (along([a, b, c]), zero),
            "universal": (along([a, 0, 0]) * along([0, b, 0]), zero),
        }[kind]
        at = self.generator.normal(scale=0.15, size=3)
        self.pairs.append(
            Pair(f"loop_{len(self.pairs)}", kind, predecessor, successor, turn, at, axis, relative, shift)
        )

    # ------------------------------------------------------------------ blocks

    def add(self, block: Block) -> None:
        getattr(self, f"add_{block.what}")(block)

    def add_chain(self, block: Block) -> None:
        self.branch(self.pick(self.links), [self.kind_of(number, block.sliders) for number in range(block.after)])

    def add_leaf(self, block: Block) -> None:
        """A free joint on any link, and a plate fixed to what it carries."""
        child = self.joint(self.kind_of(0, block.sliders), self.pick(self.links))
        self.joint("fixed", child)

    def add_space(self, block: Block) -> None:
        one, other = self.split(block, LOOP_ROWS[block.kind])
        start = self.pick(self.links)
        begin = self.pick(self.links) if block.elsewhere else start
        ends = self.branch(start, one), self.branch(begin, other)
        direction = self.generator.normal(size=3)
        self.pair(block.kind, *ends, direction / np.linalg.norm(direction))

    def add_plane(self, block: Block) -> None:
        where, rank = IN_PLANE[block.kind]
        one, other = self.split(block, rank)
        plane = self.joint("fixed", self.pick(self.links))
        ends = self.flat_branch(plane, one), self.flat_branch(plane, other)
        angle = self.generator.uniform(-math.pi, math.pi)
        inside = np.array([math.cos(angle), math.sin(angle), 0.0])
        self.pair(block.kind, *ends, np.array([0.0, 0.0, 1.0]) if where == "normal" else inside)
        pair = self.pairs[-1]
        normal = pair.rotation.inv().apply([0.0, 0.0, 1.0])
        turn = self.generator.uniform(-1.0, 1.0)
        if block.kind == "planar":
            pair.turn, pair.shift = Rotation.identity(), 0.2 * turn * np.cross(normal, pair.axis)
        elif block.kind == "spherical":
            pair.turn = Rotation.from_rotvec(turn * normal)
        elif block.kind == "universal":
            # The predecessor's x along the normal: the only turn that stays in the plane.
            spin = Rotation.from_euler("x", self.generator.uniform(-math.pi, math.pi))
            pair.rotation = Rotation.from_matrix([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]) * spin
            pair.turn = Rotation.from_euler("x", turn)

    def add_parallelogram(self, block: Block) -> None:
        plane = self.joint("fixed", self.pick(self.links))
        crank, base = self.generator.uniform(0.1, 0.3, 2)
        angle = float(self.generator.uniform(0.5, 1.2))
        flat = {"axis": (0.0, 0.0, 1.0), "rpy": (0.0, 0.0, 0.0)}
        first = self.joint("revolute", plane, xyz=(0.0, 0.0, 0.0), value=angle, **flat)
        coupler = self.joint("revolute", first, xyz=(crank, 0.0, 0.05), value=-angle, **flat)
        rocker = self.joint("continuous", plane, xyz=(base, 0.0, 0.0), value=angle, **flat)
        self.pair("revolute", coupler, rocker, np.array([0.0, 0.0, 1.0]))
        self.pairs[-1].at = np.array([base, 0.0, 0.02])

    def add_gear(self, block: Block) -> None:
        """A coupling over several joints: `before` on the predecessor's path, `after` on the successor's."""
        start = self.pick(self.links)
        kinds = [self.kind_of(number, block.sliders) for number in range(block.before + block.after)]
        self.generator.shuffle(kinds)
        predecessor, successor = self.branch(start, kinds[: block.before]), self.branch(start, kinds[block.before :])
        self.couplings.append((predecessor, successor, self.pick(RATIOS)))

    def add_mimic(self, block: Block) -> None:
        """A chain of followers: each mimics the one before, the first any joint."""
        if not self.moving():
            self.joint("revolute", "root")
        leader = self.pick(self.moving()).name
        for number in range(block.after):
            offset = self.pick([0.0, float(self.generator.uniform(-0.3, 0.3))])
            kind = self.kind_of(number, block.sliders)
            factor = self.pick((*RATIOS, 0.0)) * (SLIDE if kind == "prismatic" else 1.0)
            self.joint(kind, self.pick(self.links), mimic=(leader, factor, offset))
            leader = self.joints[-1].name

    def add_bridge(self, block: Block) -> None:
        """A coupling between any two links that are there."""
        if len(self.moving()) < 2:
            self.branch("root", ["revolute", "continuous"])
        names = [joint.child for joint in self.moving()]
        first = self.pick(names)
        second = self.pick([name for name in names if name != first])
        self.couplings.append((first, second, self.pick(RATIOS)))

    # ------------------------------------------------------------------ the file

    def inertial(self, number: int, bodies: str) -> str:
        generator = self.generator
        if bodies == "mixed":
            bodies = self.pick(["solid", "solid", "points", "massless", "without mass", "nothing", "rod", "light"])
            number -= number % 6
        if bodies == "massless" and number % 3 == 0:
            return ""
        mass = generator.uniform(0.2, 1.0)
        points = generator.normal(scale=0.08, size=(8, 3)) * (bodies != "points" or number % 2)
        second = points.T @ points / 8.0
        if bodies == "rod":
            second = np.outer(points[0], points[0])
        tensor = mass * (np.trace(second) * np.eye(3) - second)
        if bodies == "nothing":
            tensor *= 0.0
        if bodies in ("without mass", "nothing"):
            mass = 0.0
        if bodies == "light":
            mass, tensor = 1e-9 * mass, 1e-9 * tensor
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        entries = " ".join(f'{key}="{float(x)!r}"' for key, x in zip(keys, tensor[np.triu_indices(3)], strict=True))
        pose = f'xyz="{words(generator.normal(scale=0.05, size=3))}" rpy="{words(generator.uniform(-3, 3, 3))}"'
        return f'<inertial><origin {pose}/><mass value="{float(mass)!r}"/><inertia {entries}/></inertial>'

    def limit(self, joint: Part, limits: str) -> str:
        if joint.kind not in ("revolute", "prismatic") or limits == "none":
            return ""
        unit = SLIDE if joint.kind == "prismatic" else 1.0
        room = {"wide": (3.1, 3.1), "narrow": (0.4, 0.4), "one-sided": (0.3, 1.5)}[limits]
        value = self.values[joint.name]
        lower, upper = value - room[0] * unit, value + room[1] * unit
        return f'<limit lower="{lower!r}" upper="{upper!r}" effort="100" velocity="100"/>'

    def flag(self, independent: bool, how: str) -> str:
        """A flag as a file has it: read without regard to case, or nothing to go by."""
        if how == "wrong":
            independent = bool(self.generator.random() < 0.5)
        word = str(independent).lower()
        return self.pick([word, word.upper(), word.title()]) if how == "written oddly" else word

    def joint_text(self, joint: Part, flags: dict[str, bool], plan: Plan, losses: dict[str, tuple]) -> str:
        flag = f' independent="{self.flag(flags[joint.name], plan.flags)}"' if joint.name in flags else ""
        if plan.flags == "missing" or (plan.flags == "dependent only" and "true" in flag):
            flag = ""
        inner = f'<parent link="{joint.parent}"/><child link="{joint.child}"/>'
        inner += f'<origin xyz="{words(joint.xyz)}" rpy="{words(joint.rpy)}"/>'
        if joint.kind != "fixed":
            inner += f'<axis xyz="{words(joint.axis)}"/>' + self.limit(joint, plan.limits)
        if joint.name in losses:
            damping, friction = losses[joint.name]
            inner += f'<dynamics damping="{damping!r}" friction="{friction!r}"/>'
        if joint.mimic is not None:
            leader, multiplier, offset = joint.mimic
            inner += f'<mimic joint="{leader}" multiplier="{multiplier!r}" offset="{offset!r}"/>'
        return f'<joint name="{joint.name}" type="{joint.kind}"{flag}>{inner}</joint>'

    def file(self, plan: Plan, flags, closing: str, drives: str, losses) -> str:
        generator = self.generator
        self.generator = np.random.default_rng([plan.seed, 1])
        bodies = "".join(
            f'<link name="{name}">{self.inertial(k, plan.bodies) if k else ""}</link>'
            for k, name in enumerate(self.links)
        )
        self.generator = generator
        joints = "".join(self.joint_text(joint, flags, plan, losses) for joint in self.joints)
        couplings = "".join(
            f'<coupling name="coupling_{k}"><predecessor link="{one}"/><successor link="{other}"/>'
            f'<ratio value="{ratio!r}"/></coupling>'
            for k, (one, other, ratio) in enumerate(self.couplings)
        )
        home = "".join(f'<joint name="{name}" value="{value!r}"/>' for name, value in self.values.items())
        pose = f'<configuration name="home">{home}</configuration>'
        return f'<robot name="random">{bodies}{joints}{closing}{couplings}{drives}{pose}</robot>'

    def settle(self, plan: Plan) -> None:
        """Move the pose to where couplings and mimics hold: the nearest one."""
        oracle = Oracle(self.file(plan, {}, "", "", {}), ())
        value, C = oracle.rows(oracle.home)
        if len(value):
            moved = oracle.home - np.linalg.lstsq(C, value, rcond=None)[0]
            self.values = dict(zip(oracle.names, moved.tolist(), strict=True))

    def closing(self, plan: Plan) -> str:
        """The loops' text: each successor's frame is put where its pair needs it."""
        oracle = Oracle(self.file(plan, {}, "", "", {}), ())
        frames = oracle.frames(oracle.home)
        text = ""
        for pair in self.pairs:
            one, other = frames[pair.predecessor], frames[pair.successor]
            turn = Rotation.from_matrix(one.rotation) * pair.rotation
            at = one.at(pair.at)[0] + turn.apply(pair.shift)
            there = other.rotation.T @ (at - other.origin)
            turned = Rotation.from_matrix(other.rotation.T) * turn * pair.turn
            ends = (
                ("predecessor", pair.predecessor, pair.at, pair.rotation),
                ("successor", pair.successor, there, turned),
            )
            inner = "".join(
                f'<{tag} link="{link}"><origin xyz="{words(xyz)}" rpy="{words(rpy_of(rotation))}"/></{tag}>'
                for tag, link, xyz, rotation in ends
            )
            if pair.kind not in ("spherical", "universal", "fixed"):
                inner += f'<axis xyz="{words(pair.axis)}"/>'
            text += f'<loop name="{pair.name}" type="{pair.kind}">{inner}</loop>'
        return text

    def dependent(self, oracle: Oracle) -> list[str] | None:
        """A well-conditioned choice of dependent joints; all that mimic are among them."""
        _, K = oracle.rows(oracle.home)
        names = oracle.names
        sliding = [oracle.by_name[name].kind == "prismatic" for name in names]
        K = K * np.where(sliding, SLIDE, 1.0)
        forced = [k for k, name in enumerate(names) if oracle.by_name[name].mimic is not None]
        free = [k for k in range(len(names)) if k not in forced]
        rank = len(names) - oracle.mobility
        if not len(K):
            return []
        # What is left of the others' columns beside the forced ones.
        basis = np.linalg.qr(K[:, forced])[0] if forced else np.zeros((len(K), 0))
        rest = K[:, free] - basis @ (basis.T @ K[:, free])
        _, _, order = qr(rest * self.generator.uniform(0.4, 1.0, len(free)), pivoting=True)
        chosen = [free[k] for k in order[: rank - len(forced)]]
        return [names[k] for k in (*forced, *chosen)]

    def drives(self, plan: Plan, oracle: Oracle) -> str:
        """Transmissions with gears and rotors, or none."""
        independent = list(oracle.independent)
        if plan.drive == "none":
            return ""
        driven = [independent[k] for k in self.generator.permutation(len(independent))]
        dependent = [oracle.names[k] for k in oracle.z]
        if plan.drive == "dependent" and dependent and driven:
            # Another joint in the place of one, if it moves when that one does.
            G = oracle.null(oracle.home)
            gains = np.abs(G[[oracle.index[name] for name in dependent], independent.index(driven[0])])
            if gains.max() > 0.2:
                driven[0] = dependent[int(gains.argmax())]
        elif plan.drive == "too few" and len(driven) > 1:
            driven = driven[1:]
        elif plan.drive == "too many" and dependent:
            driven.append(dependent[0])
        elif plan.drive == "all":
            driven = list(oracle.names)
        elif plan.drive == "any":
            driven = [name for name in oracle.names if self.generator.random() < 0.5]
        text = ""
        for name in driven:
            reduction, rotor = self.generator.uniform(1.0, 10.0), self.generator.uniform(0.0, 1e-3)
            text += (
                f'<transmission name="drive_{name}"><type>transmission_interface/SimpleTransmission</type>'
                f'<joint name="{name}"/><actuator name="motor_{name}">'
                f"<mechanicalReduction>{float(reduction)!r}</mechanicalReduction>"
                f"<rotorInertia>{float(rotor)!r}</rotorInertia></actuator></transmission>"
            )
        return text

    def losses(self, plan: Plan) -> dict[str, tuple[float, float]]:
        if not plan.losses:
            return {}
        chosen = self.moving()[::2]
        damping, friction = self.generator.uniform(0.0, 0.3, (2, len(chosen))).tolist()
        return {joint.name: (damping[k], friction[k] if k % 2 else 0.0) for k, joint in enumerate(chosen)}


def _mounted(builder: Builder, mount: str) -> str | None:
    """The root's mounting, with the name of the hip link if there is one."""
    if mount == "plain":
        return None
    builder.joint("fixed", "root")
    if mount == "turned":
        return None
    builder.joints[-1].child = "hip"
    builder.links[-1] = "hip"
    return "hip"


def build(plan: Plan, trials: int = 20) -> Made | None:
    """The plan's mechanism; None where no regular one is found or nothing can move."""
    for trial in range(trials):
        builder = Builder(np.random.default_rng([plan.seed, trial, 2]))
        hip = _mounted(builder, plan.mount)
        for block in plan.blocks:
            builder.add(block)
        builder.settle(plan)
        closing = builder.closing(plan)
        oracle = Oracle(builder.file(plan, {}, closing, "", {}), ())
        if oracle.mobility == 0 and not plan.any_pose:
            continue
        dependent = builder.dependent(oracle)
        flags = {joint.name: joint.name not in dependent for joint in builder.moving()}
        independent = tuple(name for name, flag in flags.items() if flag)
        oracle = Oracle(builder.file(plan, flags, closing, "", {}), independent)
        regular = len(independent) == oracle.mobility and oracle.conditioning(oracle.home) >= REGULAR
        if not (regular or plan.any_pose):
            continue
        foot = {
            "last": builder.links[-1],
            "random": builder.pick(builder.links),
            "root": "root",
            "none": None,
        }[plan.foot]
        # Gains exist at regular poses only.
        drive = plan.drive if regular or plan.drive != "dependent" else "independent"
        drives = builder.drives(replace(plan, drive=drive), oracle)
        text = builder.file(plan, flags, closing, drives, builder.losses(plan))
        return Made(text, foot, hip, independent, plan)
    return None


def with_free_leaf(made: Made, kind: str) -> str:
    """The same mechanism with a floating or planar joint at its end."""
    leaf = (
        f'<link name="free"/><joint name="free_joint" type="{kind}"><parent link="root"/><child link="free"/>'
        '<origin xyz="0 0 0"/><axis xyz="0 0 1"/></joint>'
    )
    return re.sub("</robot>$", f"{leaf}</robot>", made.text)
