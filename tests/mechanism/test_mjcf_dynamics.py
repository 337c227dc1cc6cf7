"""MJCF models computed by the routes, against MuJoCo itself on the same file."""

from __future__ import annotations

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import read
from leg_dynamics.errors import LegDynamicsWarning

mujoco = pytest.importorskip("mujoco", reason="the optional extra mujoco is not installed")

ROUTES = ("pinocchio", "symbolic")
# Steps below the smallest number that rounding of a real part could reach: the derivative is exact.
STEP = 1e-30

CHAIN = """<mujoco model="chain"><compiler angle="radian"/><worldbody>
 <geom type="plane" size="1 1 .1"/>
 <body name="stand" pos=".1 -.2 .4" euler=".2 -.1 .5"><geom type="box" size=".1 .1 .1"/>
  <body name="slider" pos=".1 .2 .5" euler=".3 .2 -.5">
   <joint name="s" type="slide" axis="1 2 0" ref=".2" damping="2" armature=".3"/>
   <geom type="box" size=".05 .1 .2" pos=".1 .02 0"/>
   <body name="triple" pos=".3 0 0" euler=".5 0 .2">
    <joint name="h1" pos=".05 .02 -.1" axis="0 1 .3" ref=".4" range="-2 2" damping=".1"/>
    <joint name="h2" pos="-.1 0 .03" axis="1 0 0"/>
    <joint type="slide" pos="3 2 1" axis="0 0 1"/>
    <joint name="h4" pos="0 .2 0" axis="1 1 1" ref="-.7"/>
    <geom type="cylinder" size=".05 .2" pos=".1 .1 0" euler=".1 .2 .3"/>
    <site name="tip" pos=".1 .2 .3" euler="1 0 0"/>
    <body pos="0 .2 0" euler="0 .3 0"><joint name="h5" axis="0 0 1" armature=".05"/>
     <geom type="ellipsoid" size=".1 .15 .05" pos=".2 0 0"/>
     <body name="welded" pos="0 .1 .2" euler=".3 0 1">
      <inertial mass=".7" pos=".1 0 .2" fullinertia=".02 .03 .025 .001 -.002 .003"/></body>
    </body>
   </body>
  </body>
 </body></worldbody>
 <actuator><motor joint="h1" gear="5" forcerange="-2 2"/><position name="pp" joint="h5" kp="3" gear="3"/></actuator>
</mujoco>"""

BALL = """<mujoco model="ball"><compiler angle="radian"/><worldbody>
 <body name="upper" pos=".1 .2 .5" euler=".3 .2 -.5"><joint name="h" pos="0 .1 0" axis="0 1 .2"/>
  <geom type="box" size=".05 .1 .2" pos=".1 .02 0"/>
  <body name="lower" pos=".3 0 .1" euler=".5 0 .2"><joint name="b" type="ball" pos=".03 -.02 .1"/>
   <geom type="box" size=".1 .05 .15" pos=".1 .1 0"/><site name="tip" pos=".1 .2 .3" euler="1 0 0"/>
   <body name="last" pos="0 .2 0"><joint name="k" axis="1 0 0"/><geom type="box" size=".05 .1 .07" pos=".2 0 0"/></body>
  </body>
 </body></worldbody></mujoco>"""

FREE = """<mujoco model="free"><compiler angle="radian"/><worldbody>
 <body name="trunk" pos=".1 .2 .5" euler=".3 .2 -.5"><freejoint name="f"/>
  <geom type="box" size=".15 .1 .07" pos=".02 .01 .03"/>
  <body name="leg" pos=".3 0 .1" euler=".5 0 .2"><joint name="k" pos="0 .1 0" axis="1 0 0"/>
   <geom type="box" size=".1 .05 .15" pos=".1 .1 0"/><site name="tip" pos=".1 .2 .3"/></body>
 </body></worldbody></mujoco>"""


class Oracle:
    """MuJoCo's own numbers for a state."""

    def __init__(self, text):
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)

    def at(self, qpos, qvel=0.0):
        self.data.qpos[:], self.data.qvel[:] = qpos, qvel
        mujoco.mj_forward(self.model, self.data)

    def mass(self):
        full = np.zeros((self.model.nv, self.model.nv))
        if hasattr(self.data, "qM"):
            mujoco.mj_fullM(self.model, full, self.data.qM)
        else:
            mujoco.mj_fullM(self.model, self.data, full)
        return full

    def bias(self):
        """Coriolis, gravity and damping, without Coulomb friction, which is a constraint."""
        return self.data.qfrc_bias - self.data.qfrc_passive

    def place(self, name):
        """Position and rotation of a body or a site."""
        if mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name) >= 0:
            return self.data.body(name).xpos, self.data.body(name).xmat.reshape(3, 3)
        return self.data.site(name).xpos, self.data.site(name).xmat.reshape(3, 3)


def rotation(axis, angle):
    a, b = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3, dtype=np.asarray(angle).dtype)
    matrix[a, a] = matrix[b, b] = np.cos(angle)
    matrix[b, a] = np.sin(angle)
    matrix[a, b] = -matrix[b, a]
    return matrix


def local_rates(axes, angles):
    """Columns w with angular velocity in the child's axes = sum of w times angle rates, of a chain of three turns."""
    first, second, third = (rotation(axis, angle) for axis, angle in zip(axes, angles, strict=True))
    unit = np.eye(3)
    columns = [(second @ third).T @ unit[axes[0]], third.T @ unit[axes[1]], unit[axes[2]]]
    del first
    return np.array(columns).T


def quaternion(axes, angles):
    matrix = np.eye(3)
    for axis, angle in zip(axes, angles, strict=True):
        matrix = matrix @ rotation(axis, angle)
    found = np.empty(4)
    mujoco.mju_mat2Quat(found, matrix.ravel())
    return found


class Map:
    """From our coordinates to MuJoCo's: qpos, and the matrix from our rates to qvel."""

    def __init__(self, blocks):
        self.blocks = blocks

    def qpos(self, q):
        values, start = [], 0
        for kind in self.blocks:
            if kind == "one":
                values.append(q[start])
                start += 1
            elif kind == "ball":
                values.extend(quaternion((0, 1, 2), q[start : start + 3]))
                start += 3
            else:
                values.extend(q[start : start + 3])
                values.extend(quaternion((2, 1, 0), q[start + 3 : start + 6]))
                start += 6
        return np.array(values)

    def rates(self, q):
        matrix, start = np.eye(len(q), dtype=np.asarray(q).dtype), 0
        for kind in self.blocks:
            if kind == "ball":
                block = slice(start, start + 3)
                matrix[block, block] = local_rates((0, 1, 2), q[block])
            elif kind == "free":
                block = slice(start + 3, start + 6)
                matrix[block, block] = local_rates((2, 1, 0), q[block])
            start += {"one": 1, "ball": 3, "free": 6}[kind]
        return matrix

    def rates_change(self, q, v):
        """Time derivative of `rates`."""
        return np.imag(self.rates(q + 1j * STEP * v)) / STEP


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize(
    ("text", "blocks", "names", "feet"),
    [
        (CHAIN, ["one"] * 6, ("s", "h1", "h2", "triple_joint_3", "h4", "h5"), ("tip", "triple", "slider", "welded")),
        (BALL, ["one", "ball", "one"], ("h", "b_x", "b_y", "b_z", "k"), ("tip", "lower", "last")),
        (FREE, ["free", "one"], ("f_x", "f_y", "f_z", "f_yaw", "f_pitch", "f_roll", "k"), ("tip", "trunk")),
    ],
    ids=["chain", "ball", "free"],
)
def test_an_open_tree_moves_as_in_mujoco(route, text, blocks, names, feet):
    oracle, mapping = Oracle(text), Map(blocks)
    legs = {foot: ld.load(text, route, foot=foot) for foot in feet[: 1 if route == "symbolic" else None]}
    generator = np.random.default_rng(5)
    for _ in range(5):
        q, v, a = generator.uniform(-1.2, 1.2, (3, len(names)))
        T = mapping.rates(q)
        oracle.at(mapping.qpos(q), T @ v)
        M, h = oracle.mass(), oracle.bias()
        expected = T.T @ (M @ (T @ a + mapping.rates_change(q, v) @ v) + h)
        for foot, leg in legs.items():
            assert leg.joint_names == names
            np.testing.assert_allclose(leg.mass_matrix(q), T.T @ M @ T, atol=1e-9)
            np.testing.assert_allclose(
                leg.bias(q, v), T.T @ (h + M @ mapping.rates_change(q, v) @ v), rtol=1e-9, atol=1e-9
            )
            np.testing.assert_allclose(leg.generalized_force(q, v, a), expected, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(leg.foot_position(q), oracle.place(foot)[0], atol=1e-12)


def test_a_state_of_hinges_and_slides_is_carried_over_as_it_is():
    # The zero of every coordinate is MuJoCo's, whatever ref says.
    oracle, leg = Oracle(CHAIN), ld.load(CHAIN, foot="tip")
    home = read(CHAIN).home.values
    np.testing.assert_allclose([home[name] for name in leg.joint_names], oracle.model.qpos0, atol=0)
    assert oracle.model.qpos0[0] == 0.2


def test_coulomb_friction_is_that_of_the_joint():
    text = CHAIN.replace('damping=".1"', 'damping=".1" frictionloss=".25"')
    q, v = np.full(6, 0.3), np.full(6, -0.5)
    difference = ld.load(text).bias(q, v) - ld.load(CHAIN).bias(q, v)
    np.testing.assert_allclose(difference, (0, -0.25, 0, 0, 0, 0), atol=1e-12)


# ---------------------------------------------------------------------- closed loops

FIVE_BAR = """<mujoco model="five_bar"><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody>
 <body name="a1" pos="-.1 0 0"><joint name="left" axis="0 1 0" armature=".01"/>
  <geom type="capsule" size=".02" fromto="0 0 0 -.1 0 -.2"/>
  <body name="a2" pos="-.1 0 -.2"><joint name="left_knee" axis="0 1 0" damping=".05"/>
   <geom type="capsule" size=".02" fromto="0 0 0 .2 0 -.25"/>
   <site name="foot" pos=".2 0 -.25"/></body></body>
 <body name="b1" pos=".1 0 0"><joint name="right" axis="0 1 0" damping=".1"/>
  <geom type="capsule" size=".03" fromto="0 0 0 .1 0 -.2"/>
  <body name="b2" pos=".1 0 -.2"><joint name="right_knee" axis="0 1 0"/>
   <geom type="capsule" size=".02" fromto="0 0 0 -.2 0 -.25"/></body></body>
 </worldbody>
 <equality><connect name="foot_pin" body1="a2" body2="b2" anchor=".2 0 -.25"/></equality>
 <actuator><motor name="ml" joint="left"/><motor name="mr" joint="right" gear="4"/></actuator></mujoco>"""

# A crank, a coupler and a rocker whose last hinge is on a block that is welded to the ground.
FOUR_BAR = """<mujoco model="four_bar"><compiler angle="radian"/><worldbody>
 <body name="mount" pos="0 .1 .2" euler=".3 .2 .1">
  <body name="crank"><joint name="crank" axis="0 0 1"/><geom type="box" size=".06 .02 .02" pos=".05 0 0"/>
   <body name="coupler" pos=".1 0 0"><joint name="p" axis="0 0 1"/><geom type="box" size=".15 .02 .02" pos=".15 .05 0"/>
    <body name="rocker" pos=".3 .1 0"><joint name="r" axis="0 0 1" damping=".02"/>
     <geom type="box" size=".02 .1 .02" pos="0 -.1 0"/>
     <body name="block" pos=".02 -.2 0"><joint name="s" axis="0 0 1"/><geom type="box" size=".02 .02 .02"/></body>
    </body></body></body></body></worldbody>
 <equality><weld name="ground" body1="mount" body2="block"/></equality>
 <actuator><motor joint="crank"/></actuator></mujoco>"""

GEARS = """<mujoco model="gears"><compiler angle="radian"/><worldbody>
 <body name="arm"><joint name="arm" axis="0 1 0" ref=".1"/><geom type="box" size=".1 .02 .03" pos=".1 0 0"/>
  <body name="wheel" pos=".2 0 0"><joint name="wheel" axis="0 1 0" ref="-.3" armature=".02"/>
   <geom type="box" size=".1 .02 .03" pos=".1 0 .02"/>
   <body name="hand" pos=".2 0 0"><joint name="hand" type="slide" axis="1 0 .5"/>
    <geom type="box" size=".04 .02 .03" pos=".1 0 .02"/></body>
  </body></body></worldbody>
 <equality><joint name="gear" joint1="wheel" joint2="arm" polycoef=".25 -1.5 0 0 0"/>
  <joint name="rack" joint1="hand" joint2="wheel" polycoef="0 .2 0 0 0"/></equality></mujoco>"""


class Closure:
    """Loop rows of a MuJoCo model, their rates and drifts, from its point and angular Jacobians."""

    def __init__(self, oracle, gears=()):
        self.oracle, self.gears = oracle, gears

    def rows(self):
        """Residual, Jacobian and drift (the Jacobian's rate times qvel) at the state that the oracle is in."""
        model, data = self.oracle.model, self.oracle.data
        residual, jacobian, drift = [], [], []
        for number in range(model.neq):
            kind, parameters = model.eq_type[number], model.eq_data[number]
            if kind == mujoco.mjtEq.mjEQ_JOINT:
                one, other = model.eq_obj1id[number], model.eq_obj2id[number]
                row = np.zeros(model.nv)
                row[one], row[other] = 1.0, -parameters[1]
                offset = data.qpos - model.qpos0
                residual.append([row @ offset - parameters[0]])
                jacobian.append([row])
                drift.append([0.0])
                continue
            weld = kind == mujoco.mjtEq.mjEQ_WELD
            bodies = model.eq_obj1id[number], model.eq_obj2id[number]
            anchors = (parameters[3:6], parameters[:3]) if weld else (parameters[:3], parameters[3:6])
            points, J, J_rate = [], [], []
            for body, anchor in zip(bodies, anchors, strict=True):
                point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ anchor
                points.append(point)
                both = np.zeros((2, 3, model.nv)), np.zeros((2, 3, model.nv))
                mujoco.mj_jac(model, data, both[0][0], both[0][1], point, body)
                mujoco.mj_jacDot(model, data, both[1][0], both[1][1], point, body)
                J.append(both[0])
                J_rate.append(both[1])
            count = 2 if weld else 1
            error = [points[0] - points[1]]
            if weld:
                turned = np.empty(4)
                mujoco.mju_mulQuat(turned, data.xquat[bodies[0]], parameters[6:10])
                difference = np.empty(3)
                mujoco.mju_subQuat(difference, turned, data.xquat[bodies[1]])
                error.append(data.xmat[bodies[1]].reshape(3, 3) @ difference)
            residual += error
            jacobian += list(J[0][:count] - J[1][:count])
            drift += list((J_rate[0][:count] - J_rate[1][:count]) @ data.qvel)
        return np.concatenate(residual), np.concatenate(jacobian), np.concatenate(drift)

    def close(self, start, independent, y):
        """qpos that closes the loops at the independent coordinates, by Newton's method."""
        q = np.array(start, dtype=float)
        q[independent] = y
        dependent = [k for k in range(len(q)) if k not in independent]
        for _ in range(50):
            self.oracle.at(q)
            residual, K, _ = self.rows()
            q[dependent] -= np.linalg.lstsq(K[:, dependent], residual, rcond=1e-9)[0]
        assert np.abs(residual).max() < 1e-13
        return q

    def force(self, start, independent, y, v, a):
        """The force at y, closed: qd = G v, qdd = G a + g, tau = G^T (M qdd + h); and qpos."""
        q = self.close(start, independent, y)
        dependent = [k for k in range(len(q)) if k not in independent]
        self.oracle.at(q)
        K = self.rows()[1]
        G = np.zeros((len(q), len(independent)))
        G[independent] = np.eye(len(independent))
        G[dependent] = -np.linalg.lstsq(K[:, dependent], K[:, independent], rcond=1e-9)[0]
        self.oracle.at(q, G @ v)
        drift = np.zeros(len(q))
        drift[dependent] = -np.linalg.lstsq(K[:, dependent], self.rows()[2], rcond=1e-9)[0]
        return G.T @ (self.oracle.mass() @ (G @ a + drift) + self.oracle.bias()), q, G


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize(
    ("text", "independent", "home", "spread"),
    [
        (FIVE_BAR, ("left", "right"), (0.0, 0.0), 0.3),
        (FOUR_BAR, ("crank",), (0.0,), 0.6),
        (GEARS, ("arm",), (0.1,), 1.0),
    ],
    ids=["connect", "weld", "joint"],
)
@pytest.mark.filterwarnings("ignore:.*as independent")
def test_a_closed_loop_carries_the_same_forces_as_in_mujoco(route, text, independent, home, spread):
    oracle, leg = Oracle(text), ld.load(text, route)
    closure = Closure(oracle)
    assert leg.joint_names == independent
    numbers = [int(oracle.model.joint(name).id) for name in independent]
    generator = np.random.default_rng(11)
    for _ in range(6):
        y = np.array(home) + spread * generator.uniform(-1, 1, len(home))
        v, a = generator.uniform(-2, 2, (2, len(home)))
        expected, qpos, G = closure.force(oracle.model.qpos0, numbers, y, v, a)
        np.testing.assert_allclose(leg.generalized_force(y, v, a), expected, atol=1e-8)
        M = G.T @ oracle.mass() @ G
        np.testing.assert_allclose(leg.mass_matrix(y), M, atol=1e-9)
        tree = leg.assemble(y)
        for joint in range(oracle.model.njnt):
            name = oracle.model.joint(joint).name
            turn = float(tree[name]) - qpos[joint]
            # Angles of hinges are the same up to whole turns.
            assert abs(np.angle(np.exp(1j * turn))) < 1e-9


def test_the_closure_in_this_file_has_the_right_rates():
    oracle = Oracle(FOUR_BAR)
    closure = Closure(oracle)
    q = np.array([0.2, -0.1, 0.3, 0.15])
    v = np.array([0.5, -1.0, 0.7, 0.2])
    oracle.at(q, v)
    _, K, drift = closure.rows()
    h = 1e-6
    oracle.at(q + h * v, v)
    ahead, K_ahead, _ = closure.rows()
    oracle.at(q - h * v, v)
    behind, K_behind, _ = closure.rows()
    np.testing.assert_allclose((ahead - behind)[:3] / (2 * h), (K @ v)[:3], atol=1e-8)
    np.testing.assert_allclose((K_ahead - K_behind) @ v / (2 * h), drift, atol=1e-8)


@pytest.mark.parametrize("route", ROUTES)
def test_efforts_are_those_at_the_joint_whatever_the_gear(route):
    with pytest.warns(LegDynamicsWarning, match="left, right as independent"):
        leg = ld.load(FIVE_BAR, route)
    assert leg.actuator_names == ("ml", "mr")
    y, v, a = np.array([0.1, -0.2]), np.array([1.0, 0.5]), np.array([2.0, -1.0])
    np.testing.assert_allclose(leg.torque(y, v, a), leg.generalized_force(y, v, a), rtol=1e-12)
