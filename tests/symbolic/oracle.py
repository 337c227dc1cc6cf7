"""A second derivation that shares nothing with the package but the file: NumPy, an XML reader, complex steps.

The spanning tree is walked body by body, loops are closed by Newton's method on redundant rows in all tree joints,
couplings and mimics are rows beside them. The mass matrix is the sum of J^T M J over the bodies on the null space of
the rows. The bias is d/dt(dL/dv) - dL/dy of the reduced Lagrangian, differentiated by a complex step through the closed
loops, so that no formula for accelerations or Coriolis terms is written down anywhere.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
from scipy.linalg import null_space, qr

STEP = 1e-30
STANDARD_GRAVITY = 9.81
# A pair is closed if no row is farther off than this, m or rad.
CLOSED = 1e-12
# A joint that moves farther in one stage has jumped, rad or m.
LONGEST = 0.5
# Below this share of the largest singular value a row says nothing new.
RANK = 1e-8


class NotClosedError(Exception):
    """The loops could not be closed on the straight way from home."""


def rotation_of(rpy: Sequence[float]) -> np.ndarray:
    """Fixed-axis roll, pitch, yaw, rad."""

    def about(axis: int, angle: float) -> np.ndarray:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = math.cos(angle)
        turn[j, i] = math.sin(angle)
        turn[i, j] = -math.sin(angle)
        return turn

    roll, pitch, yaw = rpy
    return about(2, yaw) @ about(1, pitch) @ about(0, roll)


def skew(v: np.ndarray) -> np.ndarray:
    x, y, z = v
    return np.array([[0.0 * x, -z, y], [z, 0.0 * x, -x], [-y, x, 0.0 * x]])


def rodrigues(axis: np.ndarray, angle) -> np.ndarray:
    """Rotation about a unit axis; analytic in a complex angle."""
    cross = skew(axis)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)


def numbers(text: str | None, default: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    return np.array(default if text is None else [float(word) for word in text.split()])


def pose_of(element) -> tuple[np.ndarray, np.ndarray]:
    """(rotation, translation) of an <origin> in an element; identity where there is none."""
    origin = None if element is None else element.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    return rotation_of(numbers(origin.get("rpy"))), numbers(origin.get("xyz"))


def unit_axis(element) -> np.ndarray:
    found = element.find("axis")
    axis = numbers(None if found is None else found.get("xyz"), (1.0, 0.0, 0.0))
    return axis / np.linalg.norm(axis)


@dataclass
class Joint:
    name: str
    kind: str
    parent: str
    child: str
    rotation: np.ndarray
    translation: np.ndarray
    axis: np.ndarray
    damping: float = 0.0
    friction: float = 0.0
    mimic: tuple[str, float, float] | None = None
    rotor: float = 0.0
    stated: bool | None = None


@dataclass
class Body:
    mass: float
    com: np.ndarray
    inertia: np.ndarray
    """About the centre of mass, link axes."""


@dataclass
class Pair:
    kind: str
    links: tuple[str, str]
    poses: tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    axis: np.ndarray


@dataclass
class Frame:
    """A link's pose in the root, and by tree joint its angular and linear velocity (3, nq)."""

    rotation: np.ndarray
    origin: np.ndarray
    angular: np.ndarray
    linear: np.ndarray

    def at(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A point given in the link's frame: position, and velocity by tree joint."""
        arm = self.rotation @ point
        return self.origin + arm, self.linear - skew(arm) @ self.angular

    def along(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A direction given in the link's frame, and how it turns by tree joint."""
        turned = self.rotation @ direction
        return turned, -skew(turned) @ self.angular


@dataclass
class Rows:
    """Values that vanish, and their derivatives by tree joint, collected one by one."""

    values: list = field(default_factory=list)
    derivatives: list = field(default_factory=list)

    def dot(self, one, other, constant: float = 0.0) -> None:
        """A row: the scalar product of two vectors, each (value, derivative), less a constant."""
        self.values.append(one[0] @ other[0] - constant)
        self.derivatives.append(one[0] @ other[1] + other[0] @ one[1])

    def vector(self, value, derivative) -> None:
        self.values.extend(value)
        self.derivatives.extend(derivative)

    def cross(self, one, other) -> None:
        """Three rows: the cross product of two vectors."""
        self.vector(np.cross(one[0], other[0]), skew(one[0]) @ other[1] - skew(other[0]) @ one[1])


class Oracle:
    """One mechanism.

    Parameters
    ----------
    text : str
        URDF+.
    independent : sequence of str
        Names of the independent joints, in the order of y.
    home : mapping of str to float
        A closed pose in the tree joints (Newton's method corrects its rounding).
    foot, hip : str or None
        Links.
    """

    def __init__(
        self,
        text: str,
        independent: Sequence[str] | None = None,
        home: Mapping[str, float] | None = None,
        foot: str | None = None,
        hip: str | None = None,
    ) -> None:
        root = ElementTree.fromstring(text)
        self.foot, self.hip = foot, hip
        self._read_bodies(root)
        self._read_joints(root)
        self._read_constraints(root)
        self.names = [joint.name for joint in self.joints if joint.kind != "fixed"]
        self.index = {name: k for k, name in enumerate(self.names)}
        self.by_name = {joint.name: joint for joint in self.joints}
        if independent is None:
            independent = [joint.name for joint in self.declared if joint.name in self.index and joint.stated]
        self.independent = list(independent)
        self.y = [self.index[name] for name in self.independent]
        self.z = [k for k in range(len(self.names)) if k not in self.y]
        if home is None:
            home = self.configurations[0] if self.configurations else {}
        self.home = np.array([home.get(name, 0.0) for name in self.names])

    # ------------------------------------------------------------------ the file

    def _read_bodies(self, root) -> None:
        self.bodies: dict[str, Body] = {}
        for link in root.findall("link"):
            inertial = link.find("inertial")
            if inertial is None:
                continue
            turn, com = pose_of(inertial)
            entries = inertial.find("inertia").attrib
            values = {key: float(entries.get(key, 0.0)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
            tensor = np.array(
                [
                    [values["ixx"], values["ixy"], values["ixz"]],
                    [values["ixy"], values["iyy"], values["iyz"]],
                    [values["ixz"], values["iyz"], values["izz"]],
                ]
            )
            self.bodies[link.get("name")] = Body(float(inertial.find("mass").get("value")), com, turn @ tensor @ turn.T)

    def _read_joints(self, root) -> None:
        self.declared: list[Joint] = []
        for element in root.findall("joint"):
            mimic, dynamics = element.find("mimic"), element.find("dynamics")
            losses = {} if dynamics is None else dynamics.attrib
            flag = element.get("independent")
            self.declared.append(
                Joint(
                    element.get("name"),
                    element.get("type"),
                    element.find("parent").get("link"),
                    element.find("child").get("link"),
                    *pose_of(element),
                    unit_axis(element),
                    float(losses.get("damping", 0.0)),
                    float(losses.get("friction", 0.0)),
                    None
                    if mimic is None
                    else (
                        mimic.get("joint"),
                        float(mimic.get("multiplier", 1.0)),
                        float(mimic.get("offset", 0.0)),
                    ),
                    stated=mimic is None and (flag is None or flag.lower() == "true"),
                )
            )
        children = {joint.child for joint in self.declared}
        (self.root,) = {link.get("name") for link in root.findall("link")} - children
        # Parents first.
        self.joints: list[Joint] = []
        placed, waiting = {self.root}, list(self.declared)
        while waiting:
            ready = [joint for joint in waiting if joint.parent in placed]
            placed |= {joint.child for joint in ready}
            self.joints += ready
            waiting = [joint for joint in waiting if joint.child not in placed]
        self.actuated: list[str] = []
        for element in root.findall("transmission"):
            name = element.find("joint").get("name")
            actuator = element.find("actuator")
            self.actuated.append(name)
            if actuator is None:
                continue
            reduction = float(actuator.findtext("mechanicalReduction", "1"))
            inertia = float(actuator.findtext("rotorInertia", "0"))
            next(joint for joint in self.joints if joint.name == name).rotor = reduction**2 * inertia

    def _read_constraints(self, root) -> None:
        self.pairs = []
        for element in root.findall("loop"):
            ends = [element.find(tag) for tag in ("predecessor", "successor")]
            self.pairs.append(
                Pair(
                    element.get("type"),
                    (ends[0].get("link"), ends[1].get("link")),
                    (pose_of(ends[0]), pose_of(ends[1])),
                    unit_axis(element),
                )
            )
        self.couplings = [
            (
                element.find("predecessor").get("link"),
                element.find("successor").get("link"),
                float(element.find("ratio").get("value")),
            )
            for element in root.findall("coupling")
        ]
        self.configurations = [
            {each.get("name"): float(each.get("value")) for each in element.findall("joint")}
            for element in root.findall("configuration")
        ]

    # ------------------------------------------------------------------ tree kinematics

    def frames(self, q: np.ndarray) -> dict[str, Frame]:
        """Every link's frame in the root link's axes; analytic in complex q."""
        size = len(self.names)
        kind = np.asarray(q).dtype
        zero = np.zeros((3, size), dtype=kind)
        found = {self.root: Frame(np.eye(3), np.zeros(3), zero, zero)}
        for joint in self.joints:
            parent = found[joint.parent]
            rotation = parent.rotation @ joint.rotation
            origin, linear = parent.at(joint.translation)
            angular = parent.angular
            if joint.kind != "fixed":
                k = self.index[joint.name]
                axis = rotation @ joint.axis
                angular, linear = angular.copy(), linear.copy()
                if joint.kind == "prismatic":
                    # What turns below carries the slid point along.
                    linear = linear - skew(axis * q[k]) @ parent.angular
                    origin = origin + axis * q[k]
                    linear[:, k] += axis
                else:
                    rotation = rotation @ rodrigues(joint.axis, q[k])
                    angular[:, k] += axis
            found[joint.child] = Frame(rotation, origin, angular, linear)
        return found

    def path(self, link: str) -> list[Joint]:
        parents = {joint.child: joint for joint in self.joints}
        chain = []
        while link in parents:
            chain.append(parents[link])
            link = parents[link].parent
        return chain[::-1]

    # ------------------------------------------------------------------ constraints

    def rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What vanishes on a closed pose, (r,), and its derivatives by tree joint, (r, nq)."""
        frames = self.frames(q)
        rows = Rows()
        for pair in self.pairs:
            self._pair(rows, pair, frames)
        for predecessor, successor, ratio in self.couplings:
            before, after = self.path(predecessor), self.path(successor)
            shared = {joint.name for joint in before} & {joint.name for joint in after}
            coefficients = np.zeros(len(self.names))
            for chain, factor in ((after, 1.0), (before, -ratio)):
                for joint in chain:
                    if joint.name in self.index and joint.name not in shared:
                        coefficients[self.index[joint.name]] += factor
            rows.vector([coefficients @ q], [coefficients])
        for joint in self.joints:
            if joint.mimic is not None:
                leader, multiplier, offset = joint.mimic
                coefficients = np.zeros(len(self.names))
                coefficients[self.index[joint.name]] += 1.0
                coefficients[self.index[leader]] -= multiplier
                rows.vector([coefficients @ q - offset], [coefficients])
        size = len(self.names)
        return np.array(rows.values), np.array(rows.derivatives).reshape(len(rows.values), size)

    @staticmethod
    def _pair(rows: Rows, pair: Pair, frames: Mapping[str, Frame]) -> None:
        first, second = (frames[link] for link in pair.links)
        (turn, at), (other_turn, other_at) = pair.poses
        start, end = first.at(at), second.at(other_at)
        gap = end[0] - start[0], end[1] - start[1]
        axis, other_axis = first.along(turn @ pair.axis), second.along(other_turn @ pair.axis)
        if pair.kind in ("revolute", "continuous", "spherical", "universal", "fixed"):
            rows.vector(*gap)
        if pair.kind in ("revolute", "continuous", "planar"):
            rows.cross(axis, other_axis)
        if pair.kind == "planar":
            rows.dot(gap, axis)
        if pair.kind == "prismatic":
            rows.cross(axis, gap)
        if pair.kind in ("prismatic", "fixed"):
            for i in range(3):
                j = (i + 1) % 3
                mine = [first.along(turn[:, k]) for k in (i, j)]
                theirs = [second.along(other_turn[:, k]) for k in (i, j)]
                one, other = Rows(), Rows()
                one.dot(mine[0], theirs[1])
                other.dot(mine[1], theirs[0])
                rows.vector([one.values[0] - other.values[0]], [one.derivatives[0] - other.derivatives[0]])
        if pair.kind == "universal":
            rows.dot(first.along(turn[:, 0]), second.along(other_turn[:, 1]))

    def opposed(self, q: np.ndarray) -> bool:
        """Whether a pair that has one axis is closed the wrong way round."""
        frames = self.frames(q)
        for pair in self.pairs:
            turns = [frames[link].rotation @ pose[0] for link, pose in zip(pair.links, pair.poses, strict=True)]
            if pair.kind in ("revolute", "continuous", "planar"):
                if (turns[0] @ pair.axis) @ (turns[1] @ pair.axis) < 0.0:
                    return True
            elif pair.kind in ("prismatic", "fixed") and np.trace(turns[0].T @ turns[1]) < 0.0:
                return True
        return False

    @property
    def mobility(self) -> int:
        """Degrees of freedom at home, by the rank of all rows."""
        _, K = self.rows(self.home)
        sigma = np.linalg.svd(K, compute_uv=False) if K.size else np.zeros(0)
        return len(self.names) - int((sigma > RANK * sigma.max(initial=1.0)).sum())

    def conditioning(self, q: np.ndarray) -> float:
        """Smallest over largest singular value of the rows in the dependent joints; 1 without any."""
        if not self.z:
            return 1.0
        sigma = np.linalg.svd(self.rows(q)[1][:, self.z], compute_uv=False)
        return float(sigma[len(self.z) - 1] / sigma[0]) if len(sigma) >= len(self.z) else 0.0

    def close(self, y: np.ndarray, stages: int = 12, smallest: float = 1e-3) -> np.ndarray:
        """Tree joints at real y, followed straight from home; every pose on the way must be regular.

        Raises
        ------
        NotClosedError
            The way cannot be followed, or comes near a singular pose.
        """
        q = self._newton(self.home)
        begin = q[self.y].copy()
        chosen = self._independent_rows(q) if self.z else np.zeros(0, dtype=int)
        side = self._side(q, chosen)
        for stage in range(1, stages + 1):
            before = q
            q = q.copy()
            q[self.y] = begin + stage / stages * (np.asarray(y) - begin)
            q = self._newton(q)
            if np.abs(q - before).max(initial=0.0) > LONGEST or self._side(q, chosen) != side:
                raise NotClosedError(f"another assembly mode at stage {stage}")
            if self.conditioning(q) < smallest:
                raise NotClosedError(f"nearly singular at stage {stage}")
        return q

    def _side(self, q: np.ndarray, chosen: np.ndarray) -> float:
        """Sign of the determinant of some rows in the dependent joints: it changes where assembly modes meet."""
        return float(np.linalg.slogdet(self.rows(q)[1][np.ix_(chosen, self.z)])[0]) if self.z else 1.0

    def _newton(self, q: np.ndarray) -> np.ndarray:
        q = q.copy()
        for _ in range(12):
            value, K = self.rows(q)
            if not self.z or not len(value):
                break
            step = np.linalg.lstsq(K[:, self.z], value, rcond=None)[0]
            q[self.z] -= step
            if np.abs(step).max() < 1e-15:
                break
        value, _ = self.rows(q)
        if np.abs(value).max(initial=0.0) > CLOSED or self.opposed(q):
            raise NotClosedError(f"open by {np.abs(value).max()}")
        return q

    # ------------------------------------------------------------------ the reduced motion

    def _independent_rows(self, q: np.ndarray) -> np.ndarray:
        """Rows that say all, for a regular pose."""
        _, K = self.rows(q)
        _, _, order = qr(K[:, self.z].T, pivoting=True)
        return order[: len(self.z)]

    def _moved(self, q: np.ndarray, direction: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """The closed pose a complex step along y away from the closed pose q."""
        moved = q.astype(complex)
        moved[self.y] += 1j * STEP * direction
        for _ in range(3 if self.z else 0):
            value, K = self.rows(moved)
            moved[self.z] -= np.linalg.solve(K[np.ix_(chosen, self.z)], value[chosen])
        return moved

    def null(self, q: np.ndarray, chosen: np.ndarray | None = None) -> np.ndarray:
        """G (nq, n): tree rates of unit independent rates, from the null space of the rows.

        With the chosen independent rows by elimination instead, which is analytic in complex q.
        """
        size, n = len(self.names), len(self.y)
        _, K = self.rows(q)
        if chosen is None:
            basis = null_space(K, rcond=RANK) if len(K) else np.eye(size)
            return basis @ np.linalg.inv(basis[self.y])
        G = np.zeros((size, n), dtype=K.dtype)
        G[self.y] = np.eye(n)
        if self.z:
            G[self.z] = -np.linalg.solve(K[np.ix_(chosen, self.z)], K[np.ix_(chosen, self.y)])
        return G

    def tree_mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Sum of J^T M J over the bodies, and the rotors, in the tree joints."""
        size = len(self.names)
        total = np.zeros((size, size), dtype=np.asarray(q).dtype)
        frames = self.frames(q)
        for link, body in self.bodies.items():
            frame = frames[link]
            _, linear = frame.at(body.com)
            tensor = frame.rotation @ body.inertia @ frame.rotation.T
            total = total + body.mass * linear.T @ linear + frame.angular.T @ tensor @ frame.angular
        for joint in self.joints:
            if joint.rotor:
                total[self.index[joint.name], self.index[joint.name]] += joint.rotor
        return total

    def hip_frame(self) -> Frame:
        frames = self.frames(self.home)
        return frames[self.hip or self.root]

    @property
    def gravity(self) -> np.ndarray:
        """The file's, in the hip frame."""
        return self.hip_frame().rotation.T @ np.array([0.0, 0.0, -STANDARD_GRAVITY])

    def potential(self, q: np.ndarray, gravity: np.ndarray):
        """Energy of the moving bodies, zero at the hip's origin, J."""
        frames, hip = self.frames(q), self.hip_frame()
        down = hip.rotation @ gravity
        moving = [link for link in self.bodies if any(joint.name in self.index for joint in self.path(link))]
        return -sum(self.bodies[k].mass * down @ (frames[k].at(self.bodies[k].com)[0] - hip.origin) for k in moving)

    def foot_position(self, q: np.ndarray) -> np.ndarray:
        hip = self.hip_frame()
        return hip.rotation.T @ (self.frames(q)[self.foot].origin - hip.origin)

    def foot_jacobian(self, q: np.ndarray) -> np.ndarray:
        return self.hip_frame().rotation.T @ self.frames(q)[self.foot].linear @ self.null(q)

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        G = self.null(q)
        return G.T @ self.tree_mass_matrix(q) @ G

    def bias(self, q: np.ndarray, v: np.ndarray, gravity: np.ndarray | None = None) -> np.ndarray:
        """d/dt(dL/dv) - dL/dy at zero acceleration, and the losses in the joints."""
        gravity = self.gravity if gravity is None else gravity
        chosen = self._independent_rows(q) if self.z else np.zeros(0, dtype=int)
        n = len(self.y)
        M_rates, V_rates = [], []
        for k in range(n):
            moved = self._moved(q, np.eye(n)[k], chosen)
            G = self.null(moved, chosen)
            M_rates.append((G.T @ self.tree_mass_matrix(moved) @ G).imag / STEP)
            V_rates.append(np.imag(self.potential(moved, gravity)) / STEP)
        by_y = np.array(M_rates)
        force = np.einsum("k,kij,j->i", v, by_y, v) - 0.5 * np.einsum("i,kij,j->k", v, by_y, v) + np.array(V_rates)
        G = self.null(q)
        rates = G @ v
        for joint in self.joints:
            if joint.kind != "fixed":
                k = self.index[joint.name]
                force = force + G[k] * (joint.damping * rates[k] + joint.friction * np.sign(rates[k]))
        return force

    def generalized_force(self, q, v, a, foot_force=None, gravity=None) -> np.ndarray:
        force = self.mass_matrix(q) @ a + self.bias(q, v, gravity)
        return force if foot_force is None else force - self.foot_jacobian(q).T @ foot_force

    def transfer(self, q: np.ndarray) -> np.ndarray:
        """Rates of the actuated joints by independent rate, (m, n)."""
        actuated = self.actuated or self.independent
        return self.null(q)[[self.index[name] for name in actuated]]

    def torque(self, q, v, a, foot_force=None, gravity=None) -> np.ndarray:
        return np.linalg.solve(self.transfer(q).T, self.generalized_force(q, v, a, foot_force, gravity))

    def acceleration(self, q, v, tau, foot_force=None, gravity=None) -> np.ndarray:
        zero = np.zeros(len(self.y))
        force = self.generalized_force(q, v, zero, foot_force, gravity)
        return np.linalg.solve(self.mass_matrix(q), self.transfer(q).T @ tau - force)
