from __future__ import annotations

import numpy as np
import pytest

from leg_dynamics.description import link_transforms, mjcf, parse, read
from leg_dynamics.errors import DescriptionError, UnsupportedError

INERTIAL = """<inertial><origin xyz="0.1 0.02 -0.03" rpy="0.3 -0.2 0.5"/><mass value="{mass}"/>
 <inertia ixx="0.02" ixy="0.001" ixz="-0.002" iyy="0.03" iyz="0.0015" izz="0.025"/></inertial>"""


def link(name, mass=1.0):
    return f'<link name="{name}">{INERTIAL.format(mass=mass) if mass else ""}</link>'


def joint(name, parent, child, kind="revolute", axis="0 0 1", extra=""):
    limit = '<limit lower="-3" upper="3" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.5 0 0.1" rpy="0.1 0.2 -0.4"/><axis xyz="{axis}"/>{limit}{extra}</joint>'
    )


def chain(*extra, last="continuous", tip_mass=1.0):
    return (
        '<robot name="chain">'
        + link("base")
        + link("one")
        + link("two", 2.0)
        + link("three", tip_mass)
        + link("flag", 0.0)
        + joint("a", "base", "one", extra='<dynamics damping="0.3" friction="0.2"/>')
        + joint("b", "one", "two", "prismatic", "0 1 0")
        + joint("c", "two", "three", last, "1 0 0")
        + joint("d", "three", "flag", "fixed")
        + "".join(extra)
        + "</robot>"
    )


def loop(kind, axis='<axis xyz="0 0 1"/>'):
    return (
        f'<loop name="ring" type="{kind}">'
        '<predecessor link="base"><origin xyz="0.2 0.1 0" rpy="0.5 0 0"/></predecessor>'
        f'<successor link="three"><origin xyz="0.3 0 0" rpy="0 0.4 0"/></successor>{axis}</loop>'
    )


def test_has_mujoco_says_whether_it_is_installed(monkeypatch):
    monkeypatch.setattr(mjcf.importlib.util, "find_spec", lambda name: None)
    assert not mjcf.has_mujoco()
    with pytest.raises(UnsupportedError, match=r"leg-dynamics\[mujoco\]"):
        mjcf.mujoco_spec(read("omnileg"))


mujoco = pytest.importorskip("mujoco", reason="the optional extra mujoco is not installed")


def test_every_link_stands_where_the_tree_puts_it():
    description = parse(chain())
    values = {"a": 0.7, "b": -0.2, "c": 1.1}
    model = mjcf.mujoco_model(description)
    data = mujoco.MjData(model)
    data.qpos[:] = [values[model.joint(i).name] for i in range(model.njnt)]
    mujoco.mj_forward(model, data)
    for name, expected in link_transforms(description, values).items():
        np.testing.assert_allclose(data.body(name).xpos, expected[:3, 3], atol=1e-14)
        np.testing.assert_allclose(data.body(name).xmat.reshape(3, 3), expected[:3, :3], atol=1e-14)


def test_masses_losses_rotors_and_gravity_come_along():
    rotor = (
        '<transmission name="t"><type>x</type><joint name="b"/><actuator name="m"><mechanicalReduction>-5'
        "</mechanicalReduction><rotorInertia>0.002</rotorInertia></actuator></transmission>"
    )
    description = parse(chain(rotor))
    model = mjcf.mujoco_model(description)
    assert model.body("two").mass[0] == 2.0
    assert model.body("flag").mass[0] == 0.0
    np.testing.assert_allclose(model.opt.gravity, (0.0, 0.0, -9.81))
    assert np.ravel(model.joint("a").damping)[0] == 0.3
    assert model.joint("a").frictionloss[0] == 0.2
    assert model.joint("b").armature[0] == pytest.approx(0.05, rel=1e-15)
    assert model.joint("c").armature[0] == 0.0
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.body("one").iquat)
    rotation = rotation.reshape(3, 3)
    inertial = description.link("one").inertial
    turn = inertial.origin.rotation()
    expected = turn @ inertial.tensor() @ turn.T
    np.testing.assert_allclose(rotation @ np.diag(model.body("one").inertia) @ rotation.T, expected, atol=1e-15)


@pytest.mark.parametrize(
    ("kind", "axis", "constraints", "rows", "rank"),
    [
        ("revolute", '<axis xyz="0 0.6 0.8"/>', 2, 6, 5),
        ("continuous", '<axis xyz="1 0 0"/>', 2, 6, 5),
        ("spherical", "", 1, 3, 3),
        ("fixed", "", 1, 6, 6),
    ],
)
def test_loops_constrain_as_many_directions_as_their_joint(kind, axis, constraints, rows, rank):
    # A free link shows the constraint's own rank, and the closed pair turns about the axis only.
    text = (
        '<robot name="ball"><link name="base"/>'
        + link("x")
        + link("y")
        + link("z")
        + link("u")
        + link("v")
        + link("three")
        + joint("jx", "base", "x", "prismatic", "1 0 0")
        + joint("jy", "x", "y", "prismatic", "0 1 0")
        + joint("jz", "y", "z", "prismatic", "0 0 1")
        + joint("ju", "z", "u", "continuous", "1 0 0")
        + joint("jv", "u", "v", "continuous", "0 1 0")
        + joint("jw", "v", "three", "continuous", "0 0 1")
        + loop(kind, axis)
        + "</robot>"
    )
    model = mjcf.mujoco_model(parse(text))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert (model.neq, data.nefc) == (constraints, rows)
    jacobian = data.efc_J.reshape(rows, model.nv)
    assert np.linalg.matrix_rank(jacobian, 1e-9) == rank


@pytest.mark.parametrize("kind", ["planar", "prismatic"])
def test_a_loop_without_counterpart_is_refused(kind):
    with pytest.raises(UnsupportedError, match=f"'ring' is {kind}"):
        mjcf.mujoco_model(parse(chain(loop(kind))))


def test_a_joint_without_counterpart_is_refused():
    with pytest.raises(UnsupportedError, match="'c' is floating"):
        mjcf.mujoco_model(parse(chain(last="floating")))


def test_a_moving_link_without_mass_is_refused_with_mujocos_reason():
    with pytest.raises(DescriptionError, match=r"MuJoCo refuses the model: .*mass"):
        mjcf.mujoco_model(parse(chain(tip_mass=0.0)))


def residual(text, values):
    model = mjcf.mujoco_model(parse(text))
    data = mujoco.MjData(model)
    data.qpos[:] = [values[model.joint(i).name] for i in range(model.njnt)]
    mujoco.mj_forward(model, data)
    return model, np.abs(data.efc_pos).max()


def test_a_mimic_becomes_a_joint_equality():
    # Friction is a constraint too, so the chain is written without it.
    text = (
        chain()
        .replace('friction="0.2"', "")
        .replace(
            '<axis xyz="1 0 0"/></joint>', '<axis xyz="1 0 0"/><mimic joint="a" multiplier="-2" offset="0.3"/></joint>'
        )
    )
    model, closed = residual(text, {"a": 0.4, "b": 0.1, "c": -0.5})
    assert model.neq == 1
    assert closed < 1e-15
    assert residual(text, {"a": 0.4, "b": 0.1, "c": -0.4})[1] == pytest.approx(0.1)


def test_a_coupling_over_three_joints_becomes_a_tendon():
    side = (
        link("other")
        + joint("e", "base", "other", "continuous")
        + '<coupling name="belt"><predecessor link="other"/><successor link="three"/><ratio value="1.5"/></coupling>'
    )
    text = chain(side, last="continuous").replace('friction="0.2"', "")
    values = {"a": 0.4, "b": 0.1, "c": 0.25, "e": 0.5}
    model, closed = residual(text, values)
    assert (model.neq, model.ntendon) == (1, 1)
    assert closed < 1e-15
    assert residual(text, values | {"e": 0.7})[1] == pytest.approx(0.3)


def test_the_omnileg_has_five_hinge_loops_and_three_gear_pairs():
    model = mjcf.mujoco_model(read("omnileg"))
    assert (model.nv, model.neq) == (22, 13)
