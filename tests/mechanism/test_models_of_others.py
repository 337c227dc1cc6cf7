"""Files that others wrote, held against MuJoCo's tree and constraint rows that are written down here.

Nothing but the file is shared with the room under test. MuJoCo gives the open tree's mass matrix, bias force and body
Jacobians; the loops' rows are differences of vectors fixed on the two links, redundant ones included.
"""

from __future__ import annotations

import functools
import warnings
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

import leg_dynamics as ld
from leg_dynamics.errors import LegDynamicsWarning

mujoco = pytest.importorskip("mujoco", reason="the optional extra mujoco is not installed")

MODELS = Path(__file__).resolve().parents[3] / "shared" / "models"
FILES = (
    "toolbox_yaml/5bar_linkage/robot.urdf",
    "toolbox_yaml/5bar_linkage_iso3d/robot.urdf",
    "toolbox_yaml/cassie_like/robot.urdf",
    "toolbox_yaml/digit_like/robot.urdf",
    "toolbox_yaml/robot_delta/robot.urdf",
    "urdf_plus/four_bar.urdf",
    "urdf_plus/mini_cheetah_leg.urdf",
    "urdf_plus/parallel_chain_explicit_d5_l6.urdf",
    "urdf_plus/parallel_chain_implicit_d5_l5.urdf",
    "urdf_plus/revolute_rotor_chain.urdf",
    "urdf_plus/six_bar.urdf",
)
STEP = 0.05
"""rad, the largest step of an independent coordinate from the seed of the assembly mode."""
CLOSED = 1e-10
"""m or rad."""
TOLERANCE = 1e-8
RANK_SHARE = 1e-9
FOLLOWING_STEPS = 5
NEWTON_STEPS = 8
HINGES = ("revolute", "continuous")
# Directions of the loop frame that the two links share, the frame's own axes 0, 1, 2 or the loop's axis.
SHARED_DIRECTIONS = {"fixed": (0, 1, 2), "spherical": (), "revolute": ("axis",), "continuous": ("axis",)}


def numbers(element, attribute, default):
    """The numbers in an attribute; those of `default` where the element or its attribute is not there."""
    text = default if element is None else element.get(attribute, default)
    return np.array([float(word) for word in text.split()])


def written(values):
    return " ".join(map(repr, values.tolist()))


def placement(element):
    """The attributes of a MuJoCo frame from an element's ``<origin>``: MuJoCo reads fixed-axis angles itself."""
    origin = element.find("origin")
    return {
        "pos": written(numbers(origin, "xyz", "0 0 0")),
        "euler": written(numbers(origin, "rpy", "0 0 0")),
    }


def crossed_by(d):
    """The matrix of w -> w x d."""
    return np.array([[0.0, d[2], -d[1]], [-d[2], 0.0, d[0]], [d[1], -d[0], 0.0]])


def rotation_about(axis, angle):
    quaternion, rotation = np.empty(4), np.empty(9)
    mujoco.mju_axisAngle2Quat(quaternion, np.eye(3)[axis], angle)
    mujoco.mju_quat2Mat(rotation, quaternion)
    return rotation.reshape(3, 3)


class Tree:
    """MuJoCo's model of a file's tree, and the rows of its loops and couplings.

    Parameters
    ----------
    text : str
        URDF or URDF+.
    sidecar : dict, optional
        What the YAML file beside a plain URDF file says.
    """

    def __init__(self, text, sidecar=None):
        self.root = ElementTree.fromstring(text)
        self.joints = {joint.get("name"): joint for joint in self.root.findall("joint")}
        assert not self.root.findall("joint/mimic"), "no row is written for a mimicking joint"
        self.parent_joint = {joint.find("child").get("link"): joint for joint in self.joints.values()}
        self.loops = (
            [self._loop(loop) for loop in self.root.findall("loop")]
            if sidecar is None
            else [
                (self._frame(one), self._frame(other), SHARED_DIRECTIONS["fixed" if kind == "6d" else "spherical"])
                for (one, other), kind in zip(sidecar["closed_loop"], sidecar["type"], strict=True)
            ]
        )
        self.model = mujoco.MjModel.from_xml_string(self._xml())
        self._set_inertias()
        self.data = mujoco.MjData(self.model)
        self.names = [self.model.joint(i).name for i in range(self.model.njnt)]
        self.couplings = np.array([self._coupling(each) for each in self.root.findall("coupling")])
        self.couplings = self.couplings.reshape(-1, self.model.nv)
        dynamics = [self.joints[name].find("dynamics") for name in self.names]
        self.damping = np.array([numbers(each, "damping", "0")[0] for each in dynamics])
        self.friction = np.array([numbers(each, "friction", "0")[0] for each in dynamics])

    # ------------------------------------------------------------------------------------------ reading the file

    @staticmethod
    def _loop(loop):
        ends = [(end.get("link"), placement(end)) for end in (loop.find("predecessor"), loop.find("successor"))]
        axis = numbers(loop.find("axis"), "xyz", "1 0 0")
        shared = [
            axis / np.linalg.norm(axis) if each == "axis" else each for each in SHARED_DIRECTIONS[loop.get("type")]
        ]
        return *ends, shared

    def _frame(self, name):
        """A loop end of the YAML file: a link, or a joint that stands for its child."""
        return self.joints[name].find("child").get("link") if name in self.joints else name, {}

    def _path(self, link):
        names = []
        while link in self.parent_joint:
            names.append(self.parent_joint[link].get("name"))
            link = self.parent_joint[link].find("parent").get("link")
        return set(names)

    def _coupling(self, coupling):
        one, other = (self._path(coupling.find(end).get("link")) for end in ("predecessor", "successor"))
        ratio = float(coupling.find("ratio").get("value"))
        return [float(name in other - one) - ratio * (name in one - other) for name in self.names]

    def _xml(self):
        top = ElementTree.Element("mujoco")
        # Upper-case letters turn about fixed axes, as URDF's roll, pitch and yaw.
        ElementTree.SubElement(top, "compiler", angle="radian", eulerseq="XYZ")
        ElementTree.SubElement(top, "option", gravity="0 0 -9.81")
        bodies = {}
        children = {}
        for joint in self.joints.values():
            children.setdefault(joint.find("parent").get("link"), []).append(joint)
        (base,) = {link.get("name") for link in self.root.findall("link")} - set(self.parent_joint)
        bodies[base] = self._body(ElementTree.SubElement(top, "worldbody"), base, {})
        pending = [base]
        while pending:
            parent = pending.pop()
            for joint in children.get(parent, []):
                child = joint.find("child").get("link")
                bodies[child] = self._body(bodies[parent], child, placement(joint))
                pending.append(child)
                if joint.get("type") == "fixed":
                    continue
                kind = "hinge" if joint.get("type") in HINGES else {"prismatic": "slide"}[joint.get("type")]
                axis = written(numbers(joint.find("axis"), "xyz", "1 0 0"))
                ElementTree.SubElement(
                    bodies[child],
                    "joint",
                    name=joint.get("name"),
                    type=kind,
                    axis=axis,
                    armature=repr(self._rotor(joint.get("name"))),
                )
        for number, (*ends, _) in enumerate(self.loops):
            for side, (link, frame) in enumerate(ends):
                ElementTree.SubElement(bodies[link], "site", name=f"{number}.{side}", **frame)
        return ElementTree.tostring(top, encoding="unicode")

    @staticmethod
    def _body(parent, name, frame):
        body = ElementTree.SubElement(parent, "body", name=name, **frame)
        # A stand-in without symmetry, so that the compiler finds no shortcut: `_set_inertias` puts in the file's.
        ElementTree.SubElement(body, "inertial", pos="0.1 0.2 0.3", euler="0.1 0.2 0.3", mass="1", diaginertia="3 4 5")
        return body

    def _rotor(self, joint):
        """Inertia of the motors' rotors on the joint side, kg·m²."""
        inertia = 0.0
        for transmission in self.root.findall("transmission"):
            if transmission.find("joint").get("name") == joint:
                ratio, rotor = (transmission.find(f".//{tag}") for tag in ("mechanicalReduction", "rotorInertia"))
                if rotor is not None:
                    inertia += float(rotor.text) * (1.0 if ratio is None else float(ratio.text)) ** 2
        return inertia

    def _set_inertias(self):
        """Write the file's inertias into the compiled model.

        The compiler refuses massless moving bodies and inertias that break the triangle inequality, which these files
        have; the dynamics are linear in both and take them as they are.
        """
        model = self.model
        for link in self.root.findall("link"):
            body = model.body(link.get("name"))
            inertial = link.find("inertial")
            if inertial is None:
                body.mass[:], body.inertia[:] = 0.0, 0.0
                continue
            tensor = np.zeros((3, 3))
            for row, column in zip(*np.triu_indices(3), strict=True):
                value = float(inertial.find("inertia").get(f"i{'xyz'[row]}{'xyz'[column]}", "0"))
                tensor[row, column] = tensor[column, row] = value
            roll, pitch, yaw = numbers(inertial.find("origin"), "rpy", "0 0 0")
            rotation = rotation_about(2, yaw) @ rotation_about(1, pitch) @ rotation_about(0, roll)
            moments, axes = np.linalg.eigh(rotation @ tensor @ rotation.T)
            axes[:, 2] *= np.linalg.det(axes)
            body.mass[:] = float(inertial.find("mass").get("value"))
            body.ipos[:] = numbers(inertial.find("origin"), "xyz", "0 0 0")
            body.inertia[:] = moments
            mujoco.mju_mat2Quat(body.iquat, axes.ravel())
        # Only where MuJoCo puts its reference points depends on these sums.
        model.body_subtreemass[:] = model.body_mass
        for body in range(model.nbody - 1, 0, -1):
            model.body_subtreemass[model.body_parentid[body]] += model.body_subtreemass[body]

    # -------------------------------------------------------------------------------------------- loops and couplings

    def move(self, q, qd=None):
        self.data.qpos[:] = q
        self.data.qvel[:] = 0.0 if qd is None else qd
        mujoco.mj_forward(self.model, self.data)

    def _point(self, jacobian, site):
        """Linear and angular Jacobian of a point that a body carries, or their rates, (3, nv) each."""
        linear, angular = np.zeros((2, 3, self.model.nv))
        jacobian(self.model, self.data, linear, angular, site.xpos, int(self.model.site_bodyid[site.id]))
        return linear, angular

    def _side(self, site, shared, with_rate):
        linear, angular = self._point(mujoco.mj_jac, site)
        # A shared direction is one of the frame's own axes, or a vector in the frame.
        vectors = [np.eye(3)[each] if isinstance(each, int) else each for each in shared]
        directions = [site.xmat.reshape(3, 3) @ vector for vector in vectors]
        value = np.concatenate([site.xpos, *directions])
        K = np.concatenate([linear, *(crossed_by(d) @ angular for d in directions)])
        if not with_rate:
            return value, K, None
        qd = self.data.qvel
        linear_rate, angular_rate = (rate @ qd for rate in self._point(mujoco.mj_jacDot, site))
        w = angular @ qd
        turned = (crossed_by(d) @ angular_rate + np.cross(w, np.cross(w, d)) for d in directions)
        return value, K, np.concatenate([linear_rate, *turned])

    def rows(self, with_rate=False):
        """Residual in m or rad, Jacobian K, and dK/dt qd if asked for, where the model stands.

        A point p of both links gives p2 - p1, a direction d that they share d2 - d1. With w the angular velocity,
        dd/dt = w x d and d(w x d)/dt = dw/dt x d + w x (w x d).
        """
        residual, K, rate = [self.couplings @ self.data.qpos], [self.couplings], [np.zeros(len(self.couplings))]
        for number, (*_, shared) in enumerate(self.loops):
            first, second = (self._side(self.data.site(f"{number}.{side}"), shared, with_rate) for side in (0, 1))
            residual.append(second[0] - first[0])
            K.append(second[1] - first[1])
            if with_rate:
                rate.append(second[2] - first[2])
        return np.concatenate(residual), np.concatenate(K), np.concatenate(rate) if with_rate else None

    def mass_matrix(self):
        columns = np.empty((self.model.nv, self.model.nv))
        for column, unit in zip(columns, np.eye(self.model.nv), strict=True):
            mujoco.mj_mulM(self.model, self.data, column, unit)
        return columns

    def _split(self, independent):
        chosen = np.array([self.names.index(name) for name in independent])
        return chosen, np.setdiff1d(np.arange(self.model.nv), chosen)

    @staticmethod
    def _solve(K, right):
        found, _, rank, _ = np.linalg.lstsq(K, right, rcond=RANK_SHARE)
        assert rank == K.shape[1], "the independent coordinates do not determine the others"
        return found

    def follow(self, start, y, independent):
        """Tree coordinates at y on the assembly mode of the closed pose `start`: Newton in small steps from there."""
        chosen, others = self._split(independent)
        q = start.copy()
        for share in np.linspace(0.0, 1.0, FOLLOWING_STEPS + 1)[1:]:
            q[chosen] = start[chosen] + share * (y - start[chosen])
            for _ in range(NEWTON_STEPS if len(others) else 0):
                self.move(q)
                residual, K, _ = self.rows()
                step = self._solve(K[:, others], -residual)
                q[others] += step
                if np.abs(step).max() < 1e-12:
                    break
            else:
                assert not len(others), "the loops did not close"
        return q

    def generalized_force(self, q, v, a, independent):
        """G^T (M qdd + h + losses) with qd = G v and qdd = G a + g, G and g by least squares from all rows."""
        chosen, others = self._split(independent)
        self.move(q)
        _, K, _ = self.rows()
        G = np.zeros((self.model.nv, len(chosen)))
        G[chosen] = np.eye(len(chosen))
        if len(others):
            G[others] = self._solve(K[:, others], -K[:, chosen])
        qd = G @ v
        self.move(q, qd)
        _, K, rate = self.rows(with_rate=True)
        qdd = G @ a
        if len(others):
            qdd[others] -= self._solve(K[:, others], rate)
        # There are more rows than unknowns: what least squares leaves over must be rounding.
        np.testing.assert_allclose(K @ G, 0.0, atol=1e-10 * np.abs(G).max())
        np.testing.assert_allclose(K @ qdd + rate, 0.0, atol=1e-10 * max(1.0, np.abs(qdd).max()))
        load = self.mass_matrix() @ qdd + self.data.qfrc_bias + self.damping * qd + self.friction * np.sign(qd)
        return G.T @ load


# ---------------------------------------------------------------------------------------------------------- the models


@functools.cache
def loaded(file):
    """The leg of a file, and the tree read from the same file."""
    path = MODELS / file
    if not path.is_file():
        pytest.skip(f"{path} is not on this machine")
    sidecar = path.with_suffix(".yaml")
    return leg_of(path), Tree(path.read_text(), yaml.safe_load(sidecar.read_text()) if sidecar.is_file() else None)


def leg_of(source):
    with warnings.catch_warnings():
        # They do without flags, closed configurations or physical inertias, and the project says what it makes of that.
        warnings.simplefilter("ignore", LegDynamicsWarning)
        leg = ld.load(source, route="pinocchio")
        # Finding the assembly mode warns as well.
        assert leg.backend.mechanism.seeds
    return leg


def states(leg, count, seed):
    """The seed of the assembly mode (n,), and coordinates around it, rates and accelerations, (count, n) each."""
    rng = np.random.default_rng(seed)
    home = leg.backend.mechanism.seeds[0].y
    return home, home + rng.uniform(-STEP, STEP, (count, len(home))), *rng.normal(size=(2, count, len(home)))


def compare(leg, tree, count, seed=0):
    home, y, v, a = states(leg, count, seed)
    assembled, start = leg.assemble(y), leg.assemble(home)
    force = leg.generalized_force(y, v, a)
    assert set(assembled) == set(tree.names)
    start = np.array([start[name] for name in tree.names])
    for row in range(count):
        q = np.array([assembled[name][row] for name in tree.names])
        tree.move(q)
        residual, _, _ = tree.rows()
        assert np.abs(residual).max(initial=0.0) < CLOSED
        np.testing.assert_allclose(q, tree.follow(start, y[row], leg.joint_names), rtol=0.0, atol=1e-9)
        found = tree.generalized_force(q, v[row], a[row], leg.joint_names)
        # Some of these mechanisms weigh grams: 1 N·m or 1 N would be no measure for them.
        scale = min(1.0, np.abs(found).max())
        np.testing.assert_allclose(force[row], found, rtol=TOLERANCE, atol=TOLERANCE * scale)


def test_every_shared_file_is_listed():
    if not MODELS.is_dir():
        pytest.skip(f"{MODELS} is not on this machine")
    assert sorted(path.relative_to(MODELS).as_posix() for path in MODELS.rglob("*.urdf")) == sorted(FILES)


@pytest.mark.parametrize("file", FILES)
def test_generalized_force(file):
    compare(*loaded(file), 5)


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES)
def test_generalized_force_in_many_states(file):
    compare(*loaded(file), 100, seed=1)


@pytest.mark.parametrize(
    "file",
    [
        "toolbox_yaml/cassie_like/robot.urdf",
        "urdf_plus/four_bar.urdf",
        "urdf_plus/mini_cheetah_leg.urdf",
        "urdf_plus/six_bar.urdf",
    ],
)
def test_losses_and_rotors(file):
    """None of the files has any: each joint gets its own damping, friction and geared rotor."""
    root = ElementTree.fromstring(loaded(file)[0].description.urdf)
    for transmission in root.findall("transmission"):
        root.remove(transmission)
    moving = [joint for joint in root.findall("joint") if joint.get("type") != "fixed"]
    for number, joint in enumerate(moving, 1):
        assert joint.find("dynamics") is None
        ElementTree.SubElement(joint, "dynamics", damping=f"{0.3 + 0.05 * number}", friction=f"{0.2 + 0.03 * number}")
        transmission = ElementTree.SubElement(root, "transmission", name=f"drive_{number}")
        ElementTree.SubElement(transmission, "joint", name=joint.get("name"))
        actuator = ElementTree.SubElement(transmission, "actuator", name=f"motor_{number}")
        ElementTree.SubElement(actuator, "mechanicalReduction").text = f"{4 + number}"
        ElementTree.SubElement(actuator, "rotorInertia").text = f"{1e-3 * number}"
    text = ElementTree.tostring(root, encoding="unicode")
    tree = Tree(text)
    assert tree.damping.all()
    assert tree.friction.all()
    assert tree.model.dof_armature.all()
    compare(leg_of(text), tree, 5)


@pytest.mark.parametrize("file", FILES)
def test_rows_by_differences(file):
    """The oracle's own: K is the residual's derivative, open loops included, and dK/dt qd that of K qd."""
    _, tree = loaded(file)
    rng = np.random.default_rng(2)
    q, qd = rng.uniform(-0.5, 0.5, (2, tree.model.nv))
    small = 1e-5
    tree.move(q, qd)
    _, K, rate = tree.rows(with_rate=True)
    for column, unit in zip(K.T, np.eye(tree.model.nv), strict=True):
        tree.move(q + small * unit)
        after = tree.rows()[0]
        tree.move(q - small * unit)
        np.testing.assert_allclose((after - tree.rows()[0]) / (2.0 * small), column, atol=1e-8)
    tree.move(q + small * qd)
    after = tree.rows()[1]
    tree.move(q - small * qd)
    np.testing.assert_allclose((after - tree.rows()[1]) @ qd / (2.0 * small), rate, atol=1e-8)
