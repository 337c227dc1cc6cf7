from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import leg_dynamics as ld
from leg_dynamics.description import link_transforms, parse, read
from leg_dynamics.description.lowering import single_coordinate
from leg_dynamics.errors import DescriptionError, SingularityError, UnsupportedError

BODY = (
    '<inertial><origin xyz="0.1 0.02 -0.03"/><mass value="2"/>'
    '<inertia ixx="0.02" iyy="0.03" izz="0.025" ixy="0.001"/></inertial>'
)
PLACED = '<origin xyz="0.3 -0.1 0.2" rpy="0.4 0.2 -0.7"/>'


def mechanism(kind, *, axis="0 0 1", attributes="", inside="", extra=""):
    return (
        f'<robot name="r"><link name="base"/><link name="body">{BODY}</link><link name="tip">{BODY}</link>'
        f'<joint name="root" type="{kind}" {attributes}><parent link="base"/><child link="body"/>{PLACED}'
        f'<axis xyz="{axis}"/>{inside}</joint>'
        '<joint name="hinge" type="continuous"><parent link="body"/><child link="tip"/><origin xyz="0 0.2 0"/>'
        f'<axis xyz="0 1 0"/></joint>{extra}</robot>'
    )


FLOATING = ("root_x", "root_y", "root_z", "root_yaw", "root_pitch", "root_roll")


@pytest.mark.parametrize("source", ["omnileg", "hexapod_leg"])
def test_a_mechanism_of_one_coordinate_joints_stays_the_same_object(source):
    description = read(source)
    assert single_coordinate(description) is description


def test_a_floating_joint_becomes_translations_then_yaw_pitch_roll():
    lowered = single_coordinate(parse(mechanism("floating")))
    assert tuple(joint.name for joint in lowered.moving_joints if joint.name != "hinge") == FLOATING
    assert not any(joint.independent_is_stated for joint in lowered.joints)
    values = dict(zip(FLOATING, (0.5, -0.3, 0.9, 1.1, -0.4, 2.3), strict=True))
    found = link_transforms(lowered, values)["body"]
    placed = parse(mechanism("floating")).joint("root").origin.matrix()
    moved = np.eye(4)
    moved[:3, :3] = Rotation.from_euler("ZYX", (1.1, -0.4, 2.3)).as_matrix()
    moved[:3, 3] = (0.5, -0.3, 0.9)
    np.testing.assert_allclose(found, placed @ moved, atol=1e-14)
    assert [link.inertial for link in lowered.links if link.name.startswith("root")] == [None] * 5


@pytest.mark.parametrize(
    ("axis", "first", "second"),
    [
        ("0 0 1", (1, 0, 0), (0, 1, 0)),
        ("0 0 -2", (1, 0, 0), (0, -1, 0)),
        ("1 0 0", (0, 1, 0), (0, 0, 1)),
        ("0 3 0", (0, 0, 1), (1, 0, 0)),
        ("1 1 0", (-np.sqrt(0.5), np.sqrt(0.5), 0), (0, 0, 1)),
        ("0.2 -0.3 0.9", None, None),
        ("1 1 1", None, None),
    ],
)
def test_a_planar_joint_becomes_two_slides_across_its_normal_and_a_hinge_about_it(axis, first, second):
    original = parse(mechanism("planar", axis=axis))
    lowered = single_coordinate(original)
    joints = [lowered.joint(name) for name in ("root_x", "root_y", "root_yaw")]
    assert [joint.type for joint in joints] == ["prismatic", "prismatic", "continuous"]
    axes = np.array([joint.axis for joint in joints])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(np.cross(axes[0], axes[1]), original.joint("root").axis, atol=1e-15)
    if first is not None:
        np.testing.assert_allclose(axes[:2], (first, second), atol=1e-15)
    found = link_transforms(lowered, {"root_x": 0.4, "root_y": -0.2, "root_yaw": 0.8})["body"]
    moved = np.eye(4)
    moved[:3, :3] = Rotation.from_rotvec(0.8 * axes[2]).as_matrix()
    moved[:3, 3] = 0.4 * axes[0] - 0.2 * axes[1]
    np.testing.assert_allclose(found, original.joint("root").origin.matrix() @ moved, atol=1e-14)


@pytest.mark.parametrize("flag", ["true", "False"])
@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_flags_and_limits_of_effort_and_speed_go_to_every_joint_of_the_chain(kind, flag):
    inside = '<limit lower="-1" upper="1" effort="7" effort_lower="-2" velocity="3"/>'
    lowered = single_coordinate(parse(mechanism(kind, attributes=f'independent="{flag}"', inside=inside)))
    chain = [joint for joint in lowered.joints if joint.name.startswith("root")]
    assert len(chain) == (6 if kind == "floating" else 3)
    for joint in chain:
        assert joint.independent == (flag == "true")
        assert joint.independent_is_stated
        assert (joint.limits.effort_lower, joint.limits.effort, joint.limits.velocity) == (-2.0, 7.0, 3.0)
        assert (joint.limits.lower, joint.limits.upper) == (-np.inf, np.inf)
    assert not lowered.joint("hinge").independent_is_stated


def test_bounds_alone_leave_no_limit_behind():
    text = mechanism("planar", inside='<limit lower="-1" upper="1"/>')
    assert "<limit" not in single_coordinate(parse(text)).urdf


def test_loops_transmissions_and_the_new_names_in_configurations_stay():
    extra = (
        '<loop name="ring" type="spherical"><predecessor link="base"/><successor link="tip"/></loop>'
        '<transmission name="t"><joint name="hinge"/><actuator name="m"/></transmission>'
        '<configuration name="home"><joint name="root_z" value="0.4"/><joint name="root_pitch" value="0.1"/>'
        '<joint name="hinge" value="2"/></configuration>'
    )
    original = parse(mechanism("floating", extra=extra))
    assert dict(original.home.values) == {"root_z": 0.4, "root_pitch": 0.1, "hinge": 2.0}
    lowered = single_coordinate(original)
    assert [loop.name for loop in lowered.loops] == ["ring"]
    assert [each.joint for each in lowered.transmissions] == ["hinge"]
    assert lowered.home.values == original.home.values
    assert pickle.loads(pickle.dumps(lowered)) == lowered
    assert single_coordinate(lowered) is lowered


@pytest.mark.parametrize(
    ("kind", "name", "message"),
    [
        ("floating", "root", "root_x, root_y, root_z, root_yaw, root_pitch, root_roll"),
        ("planar", "root", "root_x, root_y, root_yaw"),
        ("planar", "root_z", "unknown joint 'root_z'"),
        ("continuous", "root_x", "unknown joint 'root_x'"),
    ],
)
def test_a_configuration_names_coordinates_not_the_joint(kind, name, message):
    extra = f'<configuration name="home"><joint name="{name}" value="0.4"/></configuration>'
    with pytest.raises(DescriptionError, match=message):
        parse(mechanism(kind, extra=extra))


@pytest.mark.parametrize(
    "extra",
    [
        '<transmission name="t"><joint name="root"/><actuator name="m"/></transmission>',
        '<coupling name="c"><predecessor link="base"/><successor link="tip"/><ratio value="2"/></coupling>',
        '<configuration name="home"><joint name="root_x" value="1"/><joint name="root_x" value="2"/></configuration>',
    ],
    ids=["transmission", "coupling", "twice"],
)
def test_what_else_names_the_joint_is_refused_where_it_is_read(extra):
    with pytest.raises(DescriptionError):
        parse(mechanism("floating", extra=extra))


@pytest.mark.parametrize("loss", ["damping", "friction", "armature"])
def test_losses_do_not_say_which_coordinate_they_belong_to(loss):
    text = mechanism("floating", inside=f'<dynamics {loss}="0.1"/>')
    with pytest.raises(UnsupportedError, match=f"{loss} 0.1 of the floating joint 'root'"):
        single_coordinate(parse(text))
    assert single_coordinate(parse(text.replace("0.1", "0")))


@pytest.mark.parametrize(
    "extra",
    [
        '<link name="more"/><joint name="root_pitch" type="fixed"><parent link="tip"/><child link="more"/></joint>',
        '<link name="root_pitch_link"/><joint name="k" type="fixed"><parent link="tip"/><child link="root_pitch_link"/>'
        "</joint>",
    ],
    ids=["joint", "link"],
)
def test_names_that_are_taken_are_named(extra):
    with pytest.raises(DescriptionError, match="another joint 'root_pitch' or link 'root_pitch_link'"):
        single_coordinate(parse(mechanism("floating", extra=extra)))


def test_the_last_link_of_a_chain_is_the_joints_own_child():
    extra = (
        '<link name="root_roll_link"/><joint name="k" type="fixed"><parent link="tip"/><child link="root_roll_link"/>'
        "</joint>"
    )
    assert single_coordinate(parse(mechanism("floating", extra=extra))).joint("root_roll").child == "body"


def newton_euler(state, rates, changes):
    """Force at the coordinates of one free body, from momentum in world axes; complex steps differentiate exactly."""
    lowered = parse(mechanism("floating"))
    inertial, placed = lowered.link("body").inertial, lowered.joint("root").origin.matrix()

    def rotation(q):
        yaw, pitch, roll = q[3:]
        z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        y = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
        x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
        return placed[:3, :3] @ z @ y @ x

    def jacobian(q):
        # Velocity of the centre of mass, and angular velocity, both in world axes.
        h, columns = 1e-30, []
        for k in range(6):
            step = np.array(q, dtype=complex)
            step[k] += 1j * h
            turn = np.imag(rotation(step)) / h @ np.real(rotation(q)).T
            moved = placed[:3, :3] @ step[:3] + rotation(step) @ np.array(inertial.origin.xyz)
            columns.append([*np.imag(moved) / h, turn[2, 1], turn[0, 2], turn[1, 0]])
        return np.array(columns).T

    q, h = np.asarray(state), 1e-5
    J = jacobian(q)
    J_rate = (
        sum(
            w * (jacobian(q + k * h * rates) - jacobian(q - k * h * rates))
            for k, w in ((1, 0.75), (2, -0.15), (3, 1 / 60))
        )
        / h
    )
    acceleration = J @ changes + J_rate @ rates
    turn = np.real(rotation(q))
    tensor = turn @ inertial.tensor() @ turn.T
    omega = (J @ rates)[3:]
    force = inertial.mass * (acceleration[:3] + np.array([0, 0, 9.81]))
    moment = tensor @ acceleration[3:] + np.cross(omega, tensor @ omega)
    return J.T @ np.concatenate([force, moment])


ALONE = mechanism("floating").replace(f'<link name="tip">{BODY}</link>', "")
ALONE = ALONE[: ALONE.index('<joint name="hinge"')] + "</robot>"


def pushed(route):
    """The floating body alone, with an actuator on each coordinate of its chain."""
    return ld.load(single_coordinate(parse(ALONE)).urdf.replace(' driven="false"', ""), route)


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_at_a_right_pitch_forces_stay_right_and_accelerations_are_refused(route):
    leg = pushed(route)
    assert leg.joint_names == leg.actuator_names == FLOATING
    generator = np.random.default_rng(3)
    for pitch in (0.4, np.pi / 2, -np.pi / 2):
        q, v, a = generator.uniform(-1, 1, (3, 6))
        q[4] = pitch
        np.testing.assert_allclose(leg.generalized_force(q, v, a), newton_euler(q, v, a), atol=1e-8)
        if pitch == 0.4:
            tau = leg.generalized_force(q, v, a)
            np.testing.assert_allclose(leg.acceleration(q, v, tau), a, atol=1e-9)
        else:
            with pytest.raises(SingularityError, match="mass matrix is singular"):
                leg.acceleration(q, v, np.zeros(6))


@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_beside_a_right_pitch_accelerations_are_right_or_refused(route):
    leg = pushed(route)
    q, v, a = np.random.default_rng(4).uniform(-1, 1, (3, 6))
    answered = []
    for exponent in range(1, 17):
        q[4] = np.pi / 2 - 10.0**-exponent
        force = newton_euler(q, v, a)
        found = leg.acceleration(q, v, force, on_error="nan")
        answered.append(bool(np.isfinite(found).all()))
        if answered[-1]:
            np.testing.assert_allclose(found, a, atol=1e-8)
    assert answered[0]
    assert not answered[-1]
    assert answered == sorted(answered, reverse=True)


def test_no_warning_on_the_way():
    inside = '<limit effort="7" velocity="3"/>'
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        single_coordinate(parse(mechanism("planar", inside=inside)))
