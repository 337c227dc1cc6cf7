"""What is driven where a file names few motors or none: floating bases, legs without motors, models without motors."""

from __future__ import annotations

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import actuated_joints, parse, read
from leg_dynamics.errors import ActuationError, DescriptionError, LegDynamicsWarning, ParameterError, UnsupportedError

BODY = '<inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.02" izz="0.015"/></inertial>'
LIMIT = '<limit lower="-2" upper="2" effort="5" velocity="5"/>'
MOTOR = '<transmission name="t_{0}"><joint name="{0}"/><actuator name="M_{0}"/></transmission>'
GEOM = '<geom type="sphere" size=".1"/>'


def robot(*, root="floating", rest="", attributes="", flags=""):
    """Two legs of two hinges each on a trunk that a joint of some type carries."""
    text = f'<robot name="r" {attributes}><link name="world"/><link name="trunk">{BODY}</link>'
    text += f'<joint name="root" type="{root}"><parent link="world"/><child link="trunk"/></joint>'
    for side in ("L", "R"):
        above = "trunk"
        for part in ("hip", "foot"):
            name = f"{side}_{part}"
            text += f'<link name="{name}">{BODY}</link><joint name="{name}_joint" type="revolute" {flags}>'
            text += f'<parent link="{above}"/><child link="{name}"/><axis xyz="0 1 0"/>{LIMIT}</joint>'
            above = name
    return f"{text}{rest}</robot>"


HINGES = ("L_hip_joint", "L_foot_joint", "R_hip_joint", "R_foot_joint")


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
@pytest.mark.parametrize(("root", "count"), [("floating", 6), ("planar", 3)])
def test_no_motor_drives_the_coordinates_of_a_base(route, root, count):
    leg = ld.load(robot(root=root), route)
    assert leg.actuator_names == HINGES
    assert leg.actuation.kind == "under-actuated"
    assert leg.actuation.idle == leg.joint_names[:count]
    assert actuated_joints(parse(robot(root=root))) == HINGES
    q = np.full(count + 4, 0.1)
    tau, residual = leg.torque(q, q, q, allow_idle=True)
    assert tau.shape == (4,)
    np.testing.assert_allclose(np.concatenate([residual[:count], tau]), leg.generalized_force(q, q, q), atol=1e-12)


def test_a_leg_without_motors_of_a_robot_with_motors_is_not_driven():
    motors = MOTOR.format("L_hip_joint") + MOTOR.format("L_foot_joint")
    whole = ld.load(robot(rest=motors))
    assert whole.leg("L").actuator_names == ("M_L_hip_joint", "M_L_foot_joint")
    passive = whole.leg("R")
    assert passive.actuator_names == ()
    assert passive.actuation.idle == passive.joint_names == ("R_hip_joint", "R_foot_joint")
    # Nor by a transmission to a fixed joint, which drives nothing.
    welded = '<link name="sole"/><joint name="sole" type="fixed"><parent link="R_foot"/><child link="sole"/></joint>'
    with pytest.warns(LegDynamicsWarning, match="joints that are fixed"):
        passive = ld.load(robot(rest=f"{motors}{welded}{MOTOR.format('sole')}")).leg("R")
    assert passive.actuator_names == ()
    # Where the robot names no motor at all, neither does its leg.
    assert ld.load(robot()).leg("R").actuator_names == ("R_hip_joint", "R_foot_joint")
    stated = ld.load(robot(attributes='driven="independent"', rest=motors)).leg("R")
    assert stated.actuator_names == ()
    assert ld.load(robot(attributes='driven="none"')).leg("R").actuator_names == ()


@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_a_leg_of_a_robot_whose_arm_alone_has_motors():
    try:
        whole = ld.load("example-robot-data:anymal-kinova")
    except ld.errors.LegNotFoundError:
        pytest.skip("example-robot-data is not installed")
    assert whole.leg("LF").actuator_names == ()


def test_an_mjcf_motor_on_one_leg_only():
    pytest.importorskip("mujoco")
    legs = "".join(
        f'<body name="{side}_hip" pos="0 {y} 0"><joint name="{side}_hip_joint"/>{GEOM}<body name="{side}_foot" '
        f'pos=".1 0 0"><joint name="{side}_knee_joint" axis="0 1 0"/>{GEOM}</body></body>'
        for side, y in (("L", 0.1), ("R", -0.1))
    )
    trunk = f'<body name="trunk"><freejoint name="root"/>{GEOM}{legs}</body>'
    model = f"<mujoco><worldbody>{trunk}</worldbody>{{}}</mujoco>"
    whole = ld.load(model.format('<actuator><motor name="m" joint="L_hip_joint"/></actuator>'))
    assert whole.actuator_names == whole.leg("L").actuator_names == ("m",)
    assert whole.leg("R").actuator_names == ()
    # Without actuators the file does not say what is driven; a free joint is not.
    assert ld.load(model.format("")).actuator_names == ("L_hip_joint", "L_knee_joint", "R_hip_joint", "R_knee_joint")
    assert ld.load(model.format("<actuator/>")).leg("R").actuator_names == ("R_hip_joint", "R_knee_joint")


@pytest.mark.parametrize("motor", ['<motor name="m" tendon="t"/>', '<motor name="m" site="s"/>'])
def test_an_mjcf_model_whose_actuators_are_on_no_joint_is_not_driven(motor):
    pytest.importorskip("mujoco")
    body = f'<body name="b"><joint name="h"/>{GEOM}<site name="s"/></body>'
    tendon = '<tendon><fixed name="t"><joint joint="h" coef="1"/></fixed></tendon>'
    with pytest.warns(LegDynamicsWarning, match="left out"):
        leg = ld.load(f"<mujoco><worldbody>{body}</worldbody>{tendon}<actuator>{motor}</actuator></mujoco>")
    assert leg.actuator_names == ()
    assert leg.actuation.idle == ("h",)


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_a_mechanism_without_actuators_works(route):
    leg = ld.load(robot(root="fixed", attributes='driven="none"'), route)
    other = ld.load(robot(root="fixed"), route)
    assert str(leg.actuation) == f"under-actuated: no actuator holds {', '.join(HINGES)} (4 motions, 0 actuators)"
    q, v, a = np.random.default_rng(1).uniform(-1, 1, (3, 2, 4))
    with pytest.raises(ActuationError, match=", ".join(HINGES)):
        leg.torque(q, v, a)
    for rows in (slice(None), 0, slice(0, 0)):
        tau, residual = leg.torque(q[rows], v[rows], a[rows], allow_idle=True)
        assert tau.shape == (*q[rows].shape[:-1], 0)
        np.testing.assert_allclose(residual, other.torque(q[rows], v[rows], a[rows]), atol=1e-12)
    assert leg.actuator_jacobian(q).shape == (2, 0, 4)
    feasible = leg.feasible(q, v, a, allow_idle=True)
    assert feasible
    assert feasible.margin.shape == (2, 0)


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_a_mechanism_without_actuators_moves_freely(route):
    leg = ld.load(robot(root="fixed", attributes='driven="none"'), route)
    other = ld.load(robot(root="fixed"), "pinocchio")
    q, v = np.random.default_rng(1).uniform(-1, 1, (2, 2, 4))
    for rows in (slice(None), 0):
        free = leg.acceleration(q[rows], v[rows], np.zeros((*q[rows].shape[:-1], 0)))
        np.testing.assert_allclose(free, other.acceleration(q[rows], v[rows], np.zeros(q[rows].shape)), atol=1e-12)
    assert np.abs(free).max() > 1.0


def test_a_joint_that_no_motor_drives_says_so():
    assert actuated_joints(parse(robot(flags='driven="False"'))) == ()
    assert actuated_joints(parse(robot(root="fixed", flags='driven="true"'))) == HINGES


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"attributes": 'driven="some"'}, "unsupported driven 'some'.*independent, none"),
        ({"attributes": 'driven="none"', "rest": MOTOR.format("L_hip_joint")}, 'driven="none" and has a transmission'),
        ({"flags": 'driven="perhaps"'}, "driven of <joint> 'L_hip_joint' must be true or false"),
        ({"flags": 'driven="false"', "rest": MOTOR.format("L_hip_joint")}, 'which states driven="false"'),
    ],
)
def test_contradictions_are_errors_of_the_file(options, message):
    with pytest.raises(DescriptionError, match=message) as caught:
        parse(robot(**options))
    assert caught.value.line == 1


def test_a_floating_joint_that_is_called_driven():
    text = robot().replace('name="root"', 'name="root" driven="true"')
    with pytest.warns(LegDynamicsWarning, match='is floating, which no motor drives: driven="true" is ignored'):
        assert actuated_joints(parse(text)) == HINGES


@pytest.mark.parametrize("name", [None, 3, ["L"]])
def test_a_leg_is_asked_for_by_name(name):
    whole = ld.load(robot())
    with pytest.raises(ParameterError, match=r"by its name, a text, not by .*its legs: L, R"):
        whole.leg(name)
    with pytest.raises(ParameterError, match="a foot of 'r' is asked for by its name"):
        whole.leg("L", 3)


def test_a_mesh_that_is_not_there(tmp_path):
    pytest.importorskip("mujoco")
    asset = '<compiler meshdir="parts"/><asset><mesh name="m" file="lost.stl"/></asset>'
    text = f'<mujoco>{asset}<worldbody><body name="b"><joint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    path = tmp_path / "mine.xml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        read(path)
    assert f"looked for at {tmp_path / 'parts' / 'lost.stl'}: put the file there" in str(caught.value)
    with pytest.raises(DescriptionError, match=r"no folder to look for 'parts/lost\.stl' in: save it beside its files"):
        read(text)


def test_an_mjcf_weld_within_one_body_is_an_error_of_the_file():
    pytest.importorskip("mujoco")
    body = f'<body name="b"><joint name="h"/>{GEOM}<body name="c" pos=".1 0 0">{GEOM}</body></body>'
    weld = '<equality><weld name="w" body1="b" body2="c"/></equality>'
    with pytest.raises((DescriptionError, UnsupportedError), match="loop 'w' joins 'b' and 'c', which are one rigid"):
        read(f"<mujoco><worldbody>{body}</worldbody>{weld}</mujoco>")
