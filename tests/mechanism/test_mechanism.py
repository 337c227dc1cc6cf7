from __future__ import annotations

import itertools
import math
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin
import pytest

from leg_dynamics.description import link_transforms, parse
from leg_dynamics.errors import (
    ActuationError,
    AssemblyError,
    DescriptionError,
    MissingFootError,
    NonFiniteError,
    SingularityError,
)
from leg_dynamics.mechanism.mechanism import Mechanism

KINDS = ("revolute", "continuous", "prismatic", "fixed", "planar", "spherical", "universal")
SYNTHETIC = ("four_bar", "slider_crank", "slider_guide", "gears", "open_chain", *KINDS)


def build(lab, name):
    """A mechanism with a foot, and a regular independent pose of it."""
    if name in KINDS:
        mechanism = lab.closed_mechanism(name, 0)
    else:
        text, foot = {
            "four_bar": (lambda: lab.FourBar().text(kind="continuous"), "coupler_link"),
            "slider_crank": (lab.slider_crank, "rod_link"),
            "slider_guide": (lambda: lab.slider_crank(loop="prismatic"), "piston"),
            "gears": (lab.gears, "foot"),
            "open_chain": (lab.open_chain, "foot"),
        }[name]
        mechanism = Mechanism(parse(text().xml), foot, "hip" if name == "open_chain" else None)
    seed = mechanism.seeds[0]
    unit = mechanism.closure.coordinate_unit[mechanism.independent]
    return mechanism, seed.y + 0.05 * unit * np.arange(1, mechanism.n + 1) / mechanism.n


def speeds(mechanism, seed):
    rng = np.random.default_rng(seed)
    unit = mechanism.closure.coordinate_unit[mechanism.independent]
    return rng.normal(size=mechanism.n) * unit, rng.normal(scale=3.0, size=mechanism.n) * unit


def derivative(function, h=1e-4):
    return (8 * (function(h) - function(-h)) - (function(2 * h) - function(-2 * h))) / (12 * h)


def second_derivative(function, h=2e-3):
    return (-function(2 * h) + 16 * function(h) - 30 * function(0) + 16 * function(-h) - function(-2 * h)) / (
        12 * h * h
    )


# -------------------------------------------------------------------------------------------------------- kinematics


@pytest.mark.parametrize("name", SYNTHETIC)
def test_g_and_drift_are_derivatives_of_closed_poses(lab, name):
    mechanism, y = build(lab, name)
    state = mechanism.close(y)
    v, _ = speeds(mechanism, 1)
    numeric = np.stack([derivative(lambda t, e=e: mechanism.close(y + t * e).q) for e in np.eye(mechanism.n)], axis=1)
    np.testing.assert_allclose(state.G, numeric, atol=1e-8 * (1 + np.abs(numeric).max()))
    g = mechanism.bias_acceleration(state, state.G @ v)
    expected = second_derivative(lambda t: mechanism.close(y + t * v).q)
    np.testing.assert_allclose(g, expected, atol=1e-6 * (1 + np.abs(expected).max()))


@pytest.mark.parametrize("name", SYNTHETIC)
def test_foot_position_velocity_and_acceleration(lab, name):
    mechanism, y = build(lab, name)
    state = mechanism.close(y)
    v, _ = speeds(mechanism, 2)
    transforms = link_transforms(mechanism.description, dict(zip(mechanism.tree.joint_names, state.q, strict=True)))
    in_hip = np.linalg.inv(transforms[mechanism.hip]) @ transforms[mechanism.foot]
    np.testing.assert_allclose(mechanism.foot_position(state), in_hip[:3, 3], atol=1e-12)

    def foot(t, direction=v):
        return mechanism.foot_position(mechanism.close(y + t * direction))

    J = mechanism.foot_jacobian(state)
    columns = [derivative(lambda t, e=e: foot(t, e)) for e in np.eye(mechanism.n)]
    scale = 1 + np.abs(J).max()
    np.testing.assert_allclose(J, np.stack(columns, axis=1), atol=1e-8 * scale)
    acceleration = mechanism.foot_bias_acceleration(state, v)
    np.testing.assert_allclose(acceleration, second_derivative(foot), atol=1e-6 * (1 + np.abs(acceleration).max()))
    rate = mechanism.foot_jacobian_derivative(state, v)
    numeric = derivative(lambda t: mechanism.foot_jacobian(mechanism.close(y + t * v)))
    np.testing.assert_allclose(rate, numeric, atol=1e-7 * (1 + np.abs(numeric).max()))
    np.testing.assert_allclose(rate @ v, acceleration, atol=1e-10 * (1 + np.abs(acceleration).max()))
    assert not mechanism.foot_jacobian_derivative(state, 0 * v).any()


def test_a_mechanism_without_foot_says_which_method_needs_one(lab):
    mechanism = Mechanism(parse(lab.FourBar().text().xml))
    state = mechanism.seeds[0]
    one = np.ones(1)
    for call in (
        lambda: mechanism.foot_position(state),
        lambda: mechanism.foot_jacobian(state),
        lambda: mechanism.foot_bias_acceleration(state, one),
        lambda: mechanism.generalized_force(state, one, one, np.ones(3)),
        lambda: mechanism.loop_forces(state, one, one, np.ones(3)),
    ):
        with pytest.raises(MissingFootError, match="load it with foot="):
            call()
    assert np.isfinite(mechanism.generalized_force(state, one, one)).all()


def test_hip_and_foot_must_exist_and_the_hip_must_stand_still(lab):
    description = parse(lab.FourBar().text().xml)
    with pytest.raises(DescriptionError, match="no link 'toe'"):
        Mechanism(description, foot="toe")
    with pytest.raises(DescriptionError, match="'crank_link' moves relative to the root"):
        Mechanism(description, hip="crank_link")


# ---------------------------------------------------------------------------------------------------------- dynamics


@pytest.mark.parametrize("name", SYNTHETIC)
def test_torque_by_virtual_work_is_the_one_that_the_full_kkt_system_needs(lab, name):
    mechanism, y = build(lab, name)
    state = mechanism.close(y)
    for seed in range(3):
        v, a = speeds(mechanism, seed)
        gravity = np.random.default_rng(seed).normal(size=3) * 9.81
        force = np.random.default_rng(seed).normal(size=3) * 20.0
        tau = mechanism.generalized_force(state, v, a, force, gravity)
        effort = np.zeros(mechanism.nv)
        effort[mechanism.independent] = tau
        mechanism.place(state)
        effort += mechanism.tree_foot_jacobian().T @ (mechanism.hip_rotation @ force)
        qdd = lab.kkt_acceleration(mechanism, state, v, effort, gravity)
        scale = 1 + np.abs(qdd).max()
        np.testing.assert_allclose(qdd[mechanism.independent], a, atol=1e-9 * scale)
        tree = state.G @ a + mechanism.bias_acceleration(state, state.G @ v)
        np.testing.assert_allclose(qdd, tree, atol=1e-9 * scale)
        forward = mechanism.acceleration(state, v, tau, force, gravity)
        np.testing.assert_allclose(forward, a, atol=1e-9 * scale)


@pytest.mark.parametrize("seed", [None, 0, 1])
def test_the_omnileg_against_the_kkt_system_with_shipped_and_random_inertias(
    lab, omnileg_description, omnileg_box, seed
):
    from leg_dynamics.verification.perturbation import with_random_inertia

    description = omnileg_description if seed is None else parse(with_random_inertia(omnileg_description, seed))
    mechanism = Mechanism(description, "foot", "hip")
    rng = np.random.default_rng(5)
    states = [np.zeros(3), *rng.uniform(*omnileg_box, (15, 3))]
    for y in states:
        v, a = rng.normal(scale=3, size=3), rng.normal(scale=20, size=3)
        state = mechanism.close(y)
        effort = np.zeros(mechanism.nv)
        effort[mechanism.independent] = mechanism.generalized_force(state, v, a)
        qdd = lab.kkt_acceleration(mechanism, state, v, effort)
        np.testing.assert_allclose(qdd[mechanism.independent], a, atol=1e-9 * (1 + np.abs(qdd).max()))


@pytest.mark.parametrize("name", SYNTHETIC)
def test_mass_matrix_is_symmetric_positive_and_gives_the_kinetic_energy(lab, name):
    mechanism, y = build(lab, name)
    state = mechanism.close(y)
    M = mechanism.mass_matrix(state)
    np.testing.assert_array_equal(M, M.T)
    assert (np.linalg.eigvalsh(M) > 0).all()
    v, a = speeds(mechanism, 4)
    model, data = mechanism.tree.model, mechanism.tree.model.createData()
    energy = pin.computeKineticEnergy(model, data, mechanism.tree.to_configuration(state.q), state.G @ v)
    assert 0.5 * v @ M @ v == pytest.approx(energy, rel=1e-12)
    inverse_dynamics = mechanism.generalized_force(state, v, a)
    np.testing.assert_allclose(
        M @ a + mechanism.bias(state, v), inverse_dynamics, atol=1e-10 * (1 + abs(inverse_dynamics).max())
    )


@pytest.mark.parametrize("name", SYNTHETIC)
def test_power_of_the_torque_is_the_rate_of_energy(lab, name):
    mechanism, y = build(lab, name)
    v, a = speeds(mechanism, 6)
    gravity = np.array([1.0, -2.0, 9.0])

    def energy(t):
        state, rate = mechanism.close(y + t * v + 0.5 * t * t * a), v + t * a
        kinetic = 0.5 * rate @ mechanism.mass_matrix(state) @ rate
        return kinetic + float(mechanism.potential_energy(state, gravity))

    tau = mechanism.generalized_force(mechanism.close(y), v, a, None, gravity)
    assert tau @ v == pytest.approx(derivative(energy), rel=1e-6, abs=1e-7)


def test_potential_energy_counts_the_moving_bodies_from_the_hips_origin(lab):
    """A heavy root adds nothing: it does not move, and its height is anyone's choice."""
    text = lab.Text().link("base", 7.0).link("hip", 0.0)
    text.joint("mount", "fixed", "base", "hip", xyz=(0.0, 0.0, 2.0))
    xml = text.joint("turn", "revolute", "hip", "arm", (1, 0, 0), xyz=(0, 0, -0.5), mass=3.0).xml
    mechanism = Mechanism(parse(xml), hip="hip")
    state = mechanism.close(np.array([0.0]))
    arm = mechanism.description.link("arm").inertial
    assert mechanism.potential_energy(state) == pytest.approx(3.0 * 9.81 * (arm.origin.xyz[2] - 0.5), rel=1e-12)


def test_gravity_is_a_vector_of_the_hip_frame(lab):
    mechanism = Mechanism(parse(lab.open_chain().xml), "foot", "hip")
    R = mechanism.hip_rotation
    np.testing.assert_allclose(R @ mechanism.gravity, [0, 0, -9.81], atol=1e-14)
    state, zero = mechanism.close(np.array([0.3, 0.5, 0.1])), np.zeros(3)
    np.testing.assert_allclose(mechanism.bias(state, zero, mechanism.gravity), mechanism.bias(state, zero), atol=1e-13)
    tilted = np.array([1.0, 2.0, 3.0])
    step = [
        derivative(lambda t, e=e: mechanism.potential_energy(mechanism.close(state.y + t * e), tilted))
        for e in np.eye(3)
    ]
    np.testing.assert_allclose(mechanism.bias(state, zero, tilted), step, atol=1e-8)
    # a call with another gravity leaves nothing behind
    np.testing.assert_allclose(mechanism.bias(state, zero), mechanism.bias(state, zero, mechanism.gravity), atol=1e-13)
    assert not mechanism.bias(state, zero, zero).any()


def test_the_omnileg_hangs_in_a_hip_frame_whose_z_points_down(omnileg):
    np.testing.assert_allclose(omnileg.gravity, [0, 0, 9.81], atol=1e-14)
    straight = omnileg.foot_position(omnileg.close(np.zeros(3)))
    np.testing.assert_allclose(straight, [0, 0, 0.5], atol=1e-14)


def test_a_force_on_the_foot_that_carries_it_unloads_the_motors(lab):
    """Static equilibrium: only the foot is heavy, the ground carries exactly its weight, no torque remains."""
    text = lab.Text().joint("a", "revolute", "base", "thigh", (0, 1, 0), mass=0.0)
    text.joint("b", "revolute", "thigh", "shank", (0, 1, 0), (0.3, 0, 0), mass=0.0)
    text.joint("c", "revolute", "shank", "ankle", (0, 1, 0), (0.3, 0, 0), mass=0.0)
    text.point_mass("foot", 2.0).joint("sole", "fixed", "ankle", "foot", xyz=(0.0, 0.0, -0.1))
    mechanism = Mechanism(parse(text.xml), foot="foot")
    state, zero = mechanism.close(np.array([0.4, 0.8, -0.3])), np.zeros(3)
    weight = 2.0 * 9.81
    assert np.abs(mechanism.generalized_force(state, zero, zero)).max() > 1.0
    carried = mechanism.generalized_force(state, zero, zero, np.array([0, 0, weight]))
    np.testing.assert_allclose(carried, 0.0, atol=1e-12)
    np.testing.assert_allclose(mechanism.acceleration(state, zero, zero, np.array([0, 0, weight])), 0.0, atol=1e-9)


def test_damping_and_friction_do_their_work_on_every_joint(lab):
    plain = Mechanism(parse(lab.FourBar().text().xml))
    xml = lab.FourBar().text(damping=0.3, friction=0.2).xml
    xml = xml.replace(
        '<parent link="base"/><child link="rocker_link"/>', '<dynamics damping="0.7" friction="0.4"/>\\g<0>'
    )
    xml = xml.replace("\\g<0>", '<parent link="base"/><child link="rocker_link"/>')
    rough = Mechanism(parse(xml))
    state = rough.close(np.array([0.9]))
    rocker = rough.tree.joint_names.index("rocker")
    a = np.array([2.0])
    for v in (np.array([1.5]), np.array([-0.5])):
        qd = state.G @ v
        lost = 0.3 * v[0] ** 2 + 0.2 * abs(v[0]) + 0.7 * qd[rocker] ** 2 + 0.4 * abs(qd[rocker])
        more = rough.generalized_force(state, v, a) - plain.generalized_force(plain.close(state.y), v, a)
        assert more @ v == pytest.approx(lost, rel=1e-12)
        np.testing.assert_allclose(rough.acceleration(state, v, rough.generalized_force(state, v, a)), a, rtol=1e-10)
    still = rough.generalized_force(state, np.zeros(1), a) - plain.generalized_force(
        plain.close(state.y), np.zeros(1), a
    )
    np.testing.assert_allclose(still, 0.0, atol=1e-13)


def test_a_joint_that_rests_up_to_rounding_has_no_coulomb_friction(lab):
    """A differential: c follows 0.1 a + 0.1 b and rests where a and b turn against each other, but for rounding."""
    text = lab.Text().joint("a", "revolute", "base", "one", independent=True)
    text.joint("b", "revolute", "one", "two", independent=True)
    text.joint("c", "revolute", "base", "three", independent=False, friction=5.0).coupling("gears", "two", "three", 0.1)
    mechanism = Mechanism(parse(text.xml))
    state = mechanism.close(np.array([0.1, 0.2]))
    c = mechanism.tree.joint_names.index("c")
    assert state.G[c] == pytest.approx([0.1, 0.1])
    for v, expected in (([0.3, -0.3], 0.0), ([0.3, -0.3 + 1e-16], 0.0), ([0.3, -0.3 + 1e-9], 5.0), ([0.0, 0.0], 0.0)):
        assert mechanism.joint_friction(state, np.array(v), state.G @ np.array(v))[c] == expected
    assert mechanism.joint_friction(state, np.array([-1.0, 0.0]), state.G @ np.array([-1.0, 0.0]))[c] == -5.0


def test_rotor_inertia_acts_through_the_reduction(lab):
    text = lab.FourBar().text().motor("crank", reduction=6.0, rotor_inertia=2e-3)
    plain, geared = Mechanism(parse(lab.FourBar().text().xml)), Mechanism(parse(text.xml))
    y, v, a = np.array([0.9]), np.array([1.0]), np.array([5.0])
    extra = geared.generalized_force(geared.close(y), v, a) - plain.generalized_force(plain.close(y), v, a)
    np.testing.assert_allclose(extra, 36 * 2e-3 * a, rtol=1e-9)
    np.testing.assert_allclose(
        geared.mass_matrix(geared.close(y)) - plain.mass_matrix(plain.close(y)), 36 * 2e-3, rtol=1e-9
    )
    # on a passive joint it is reflected by that joint's own ratio
    text = lab.FourBar().text().motor("rocker", 6.0, 2e-3)
    geared = Mechanism(parse(text.xml))
    state = geared.close(y)
    rocker = geared.tree.joint_names.index("rocker")
    more = geared.mass_matrix(state) - plain.mass_matrix(plain.close(y))
    np.testing.assert_allclose(more, 36 * 2e-3 * state.G[[rocker]] ** 2, rtol=1e-9)


@pytest.mark.parametrize("name", ["open_chain"])
def test_an_open_chain_is_pinocchio_itself(lab, name):
    mechanism, y = build(lab, name)
    state, (v, a) = mechanism.close(y), speeds(mechanism, 1)
    np.testing.assert_array_equal(state.G, np.eye(3))
    np.testing.assert_array_equal(state.q, y)
    model, data = mechanism.tree.model, mechanism.tree.model.createData()
    q = mechanism.tree.to_configuration(y)
    np.testing.assert_allclose(mechanism.generalized_force(state, v, a), pin.rnea(model, data, q, v, a), atol=1e-13)
    np.testing.assert_allclose(mechanism.acceleration(state, v, a), pin.aba(model, data, q, v, a), rtol=1e-12)


def test_the_articulated_body_path_and_the_projection_agree(lab, monkeypatch):
    mechanism, y = build(lab, "open_chain")
    v, tau = speeds(mechanism, 1)
    force, gravity = np.array([1.0, 2.0, 3.0]), np.array([0.5, -1.0, 4.0])
    direct = mechanism.acceleration(mechanism.close(y), v, tau, force, gravity)
    calls = []
    monkeypatch.setattr(pin, "aba", lambda *args: calls.append(args))
    damped = Mechanism(parse(lab.open_chain(damping=1e-12).xml), "foot", "hip")
    projected = damped.acceleration(damped.close(y), v, tau, force, gravity)
    assert not calls
    np.testing.assert_allclose(direct, projected, rtol=1e-9)


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_a_motion_without_mass_is_a_singularity_error(lab, damping):
    text = lab.Text().joint("a", "revolute", "base", "arm", mass=0.0 if not damping else None, damping=damping)
    text.joint("b", "revolute", "arm", "tip", (1, 0, 0), mass=0.0)
    mechanism = Mechanism(parse(text.xml))
    with pytest.raises(SingularityError, match="carries no mass"):
        mechanism.acceleration(mechanism.close(np.zeros(2)), np.zeros(2), np.ones(2))
    assert np.isfinite(mechanism.generalized_force(mechanism.close(np.zeros(2)), np.ones(2), np.ones(2))).all()


def test_two_motions_that_share_one_mass_are_a_singularity_error(lab):
    """Each entry of the diagonal is positive, the matrix is singular all the same."""
    text = lab.Text().joint("a", "revolute", "base", "arm", mass=0.0, damping=0.1)
    mechanism = Mechanism(parse(text.joint("b", "revolute", "arm", "tip").xml))
    with pytest.raises(SingularityError, match="smallest pivot"):
        mechanism.acceleration(mechanism.close(np.zeros(2)), np.zeros(2), np.ones(2))


# --------------------------------------------------------------------------------------------------------- actuators


def test_actuators_on_other_joints_do_the_same_work(lab):
    mechanism = Mechanism(parse(lab.FourBar().text().motor("rocker").xml))
    assert not mechanism.directly_actuated
    state, v, a = mechanism.close(np.array([0.9])), np.array([1.2]), np.array([-3.0])
    generalized = mechanism.generalized_force(state, v, a)
    effort = mechanism.actuator_effort(state, generalized)
    rocker = mechanism.tree.joint_names.index("rocker")
    assert effort[0] * state.G[rocker, 0] == pytest.approx(generalized[0], rel=1e-13)
    np.testing.assert_allclose(mechanism.acceleration(state, v, effort), a, rtol=1e-10)
    tree_effort = np.zeros(3)
    tree_effort[rocker] = effort[0]
    qdd = lab.kkt_acceleration(mechanism, state, v, tree_effort)
    assert qdd[mechanism.independent] == pytest.approx(a, rel=1e-9)


def test_actuators_in_another_order_are_told_apart(lab):
    xml = lab.open_chain().motor("strut").motor("yaw").motor("knee").xml
    mechanism = Mechanism(parse(xml), "foot", "hip")
    generalized = np.array([1.0, 2.0, 3.0])
    order = [mechanism.joint_names.index(name) for name in ("strut", "yaw", "knee")]
    np.testing.assert_allclose(mechanism.actuator_effort(mechanism.close(np.zeros(3)), generalized), generalized[order])


@pytest.mark.parametrize(
    ("motors", "kind", "which"),
    [
        ((), "under-actuated", "no actuator is on turn"),
        (("crank", "rocker"), "redundantly actuated", "rocker move with the independent joints"),
    ],
)
def test_too_few_or_too_many_actuators_have_no_unique_effort(lab, motors, kind, which):
    text = lab.FourBar().text()
    if not motors:
        # two motions, one motor
        text.joint("turn", "revolute", "base", "arm", independent=True).motor("crank")
    for joint in motors:
        text.motor(joint)
    mechanism = Mechanism(parse(text.xml))
    with pytest.raises(ActuationError, match=f"{kind} and the efforts are not unique; use generalized_force.*{which}"):
        mechanism.actuator_effort(mechanism.seeds[0], np.ones(mechanism.n))


def test_actuators_that_lose_a_motion_are_a_singularity_error(lab):
    """The slide of a slider-crank cannot hold the crank at its dead centre."""
    mechanism = Mechanism(parse(lab.slider_crank().motor("slide").xml))
    with pytest.raises(SingularityError, match="actuators do not hold every motion at crank = 0"):
        mechanism.actuator_effort(mechanism.close(np.array([0.0])), np.ones(1))
    assert np.isfinite(mechanism.actuator_effort(mechanism.close(np.array([0.01])), np.ones(1))).all()


# ------------------------------------------------------------------------------------------------------- loop forces


def balance_of(mechanism, state, v, a, forces, foot_force=None, gravity=None):
    """What is left of rnea = S^T tau + J_F^T F + loop wrenches on both sides, wrenches applied body by body."""
    model = mechanism.tree.model.copy()
    model.gravity.linear = mechanism.hip_rotation @ (mechanism.gravity if gravity is None else gravity)
    data = model.createData()
    q = mechanism.tree.to_configuration(state.q)
    qd = state.G @ v
    qdd = state.G @ a + mechanism.bias_acceleration(state, qd)
    left = pin.rnea(model, data, q, qd, qdd)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    for loop, (predecessor, successor) in zip(mechanism.closure.loops, mechanism.closure.ends, strict=True):
        force, moment = forces.wrenches[loop.name]
        placement = data.oMf[predecessor]
        world = placement.act(pin.Force(force, moment))
        for frame, sign in ((predecessor, -1.0), (successor, 1.0)):
            jacobian = pin.getJointJacobian(model, data, model.frames[frame].parentJoint, pin.WORLD)
            left = left - sign * jacobian.T @ world.vector
    equations = mechanism.closure.coupling_matrix
    left = left - equations.T @ np.array([forces.couplings[name] for name in mechanism.closure.coupling_names])
    if foot_force is not None:
        jacobian = pin.getFrameJacobian(model, data, mechanism.foot_frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        left = left - jacobian.T @ (mechanism.hip_rotation @ foot_force)
    generalized = mechanism.generalized_force(state, v, a, foot_force, gravity)
    left[mechanism.actuated] -= mechanism.actuator_effort(state, generalized)
    return left


@pytest.mark.parametrize("name", SYNTHETIC)
def test_loop_forces_balance_the_tree(lab, name):
    mechanism, y = build(lab, name)
    state, (v, a) = mechanism.close(y), speeds(mechanism, 3)
    force, gravity = np.array([3.0, -5.0, 8.0]), np.array([1.0, 0.0, -9.0])
    forces = mechanism.loop_forces(state, v, a, force, gravity)
    left = balance_of(mechanism, state, v, a, forces, force, gravity)
    np.testing.assert_allclose(left, 0.0, atol=1e-9 * (1 + np.abs(forces.imbalance)))
    assert forces.imbalance < 1e-9
    assert forces.unique == (name not in ("four_bar", "slider_crank", "slider_guide"))


def test_loop_forces_of_the_omnileg_balance_and_are_declared_not_unique(omnileg):
    state = omnileg.close(np.radians([30.0, 20.0, 40.0]))
    v, a, force = np.array([1.0, -2.0, 0.5]), np.array([3.0, 4.0, -5.0]), np.array([0.0, -20.0, 20.0])
    forces = omnileg.loop_forces(state, v, a, force)
    assert forces.redundant_rows == 9
    assert not forces.unique
    np.testing.assert_allclose(balance_of(omnileg, state, v, a, forces, force), 0.0, atol=1e-10)


def test_loop_force_of_a_hand_computed_planar_frame(lab):
    """A massless strut props a horizontal beam with a weight at its end: the strut carries a pure axial force."""
    text = lab.Text().joint("beam", "revolute", "base", "beam_link", (0, 1, 0), mass=0.0, independent=True)
    text.joint("strut", "revolute", "base", "strut_link", (0, 1, 0), (0, 0, -0.3), mass=0.0, independent=False)
    text.joint("sleeve", "prismatic", "strut_link", "sleeve_link", (1, 0, 0), mass=0.0, independent=False)
    text.point_mass("load", 4.0).joint("end", "fixed", "beam_link", "load", xyz=(0.8, 0, 0))
    text.loop("pin", "revolute", ("sleeve_link", lab.ZERO, lab.ZERO), ("beam_link", (0.4, 0, 0), lab.ZERO), (0, 1, 0))
    incline = -math.atan2(0.3, 0.4)
    text.configuration("home", {"beam": 0.0, "strut": incline, "sleeve": 0.5}).motor("sleeve")
    mechanism = Mechanism(parse(text.xml))
    state, zero = mechanism.seeds[0], np.zeros(1)
    effort = mechanism.actuator_effort(state, mechanism.generalized_force(state, zero, zero))
    # moments about the beam's hinge: F sin(incline) 0.4 = 4 g 0.8
    thrust = 4.0 * 9.81 * 0.8 / (0.4 * 0.6)
    assert effort[0] == pytest.approx(thrust, rel=1e-10)
    forces = mechanism.loop_forces(state, zero, zero)
    force, moment = forces.wrenches["pin"]
    predecessor, _ = mechanism.closure.ends[0]
    mechanism.place(state)
    world = mechanism._workspace.data.oMf[predecessor].rotation @ force
    np.testing.assert_allclose(world, thrust * np.array([0.8, 0.0, 0.6]), atol=1e-9)
    np.testing.assert_allclose(moment, 0.0, atol=1e-9)


def test_coupling_multipliers_of_a_gear_pair(lab):
    """The driven gear's load divided by nothing: the mesh carries it, the driver feels the ratio."""
    text = lab.Text().joint("driver", "revolute", "base", "small", independent=True)
    text.joint("driven", "revolute", "base", "large", (1, 0, 0), (0.3, 0, 0), independent=False)
    mechanism = Mechanism(parse(text.coupling("mesh", "small", "large", 0.25).xml))
    state = mechanism.close(np.array([0.4]))
    zero, a = np.zeros(1), np.array([2.0])
    forces = mechanism.loop_forces(state, zero, a, None, np.zeros(3))
    model, data = mechanism.tree.model, mechanism.tree.model.createData()
    driven = mechanism.tree.joint_names.index("driven")
    load = pin.crba(model, data, state.q)[driven, driven] * 0.25 * 2.0
    assert forces.couplings == {"mesh": pytest.approx(load, rel=1e-12)}
    assert forces.unique


def test_loop_forces_need_unique_efforts(lab):
    mechanism = Mechanism(parse(lab.FourBar().text().motor("crank").motor("rocker").xml))
    with pytest.raises(ActuationError):
        mechanism.loop_forces(mechanism.seeds[0], np.zeros(1), np.zeros(1))


# -------------------------------------------------------------------------------------------- threads, pickles, files


def test_threads_give_bitwise_what_one_thread_gives(omnileg_description, omnileg_box):
    rng = np.random.default_rng(8)
    batches = rng.uniform(*omnileg_box, (4, 60, 3))

    def work(mechanism, batch):
        return np.array([mechanism.generalized_force(mechanism.close(y), y + 1.0, 2.0 * y) for y in batch])

    alone = []
    for batch in batches:
        alone.append(work(Mechanism(omnileg_description, "foot", "hip"), batch))
    shared = Mechanism(omnileg_description, "foot", "hip")
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda batch: work(shared, batch), batches))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_same_pose_is_not_closed_twice(omnileg):
    y = np.array([0.1, 0.2, 0.3])
    assert omnileg.close(y) is omnileg.close(y.copy())
    assert omnileg.close(y + 1e-3) is not omnileg.close(y)


def test_pickles_are_the_description_and_give_the_same_numbers(lab, omnileg):
    copy = pickle.loads(pickle.dumps(omnileg))
    y, v, a = np.array([0.3, -0.4, 0.5]), np.ones(3), np.ones(3)
    np.testing.assert_array_equal(
        copy.generalized_force(copy.close(y), v, a), omnileg.generalized_force(omnileg.close(y), v, a)
    )
    assert (copy.foot, copy.hip) == ("foot", "hip")


def test_no_independent_joint_and_no_joint_at_all_are_named_errors(lab):
    with pytest.raises(DescriptionError, match="no joint is independent"):
        Mechanism(parse(lab.FourBar().text(flags=(False, False, False)).xml))
    with pytest.raises(DescriptionError, match="no joint is independent"):
        Mechanism(parse(lab.Text().link("base").xml))


@pytest.mark.parametrize("corner", list(itertools.product((-65.0, 65.0), (-65.0, 65.0), (-45.0, 0.0, 85.0))))
def test_the_omnilegs_corners_and_gamma_zero_are_regular(lab, omnileg, corner):
    y = np.radians(corner)
    omnileg.forget(every_pose=True)
    state = omnileg.close(y)
    expected = lab.omnileg_tree(y)
    got = dict(zip(omnileg.tree.joint_names, state.q, strict=True))
    assert max(abs(got[name] - expected[name]) for name in expected) < 1e-11
    assert np.isfinite(omnileg.generalized_force(state, np.ones(3), np.ones(3))).all()


def test_one_dependent_joint_can_be_singular_on_its_own(lab):
    """Ratios of pivots see nothing where there is one pivot."""
    text = lab.Text().joint("slide", "prismatic", "base", "body", (1, 0, 0), independent=True)
    text.joint("spin", "revolute", "base", "wheel", (0, 0, 1), independent=False)
    text.loop("rest", "planar", ("body", (0.1, 0, 0), lab.ZERO), ("wheel", lab.ZERO, lab.ZERO), (0, 0, 1))
    mechanism = Mechanism(parse(text.configuration("home", {}).xml))
    with pytest.raises((DescriptionError, SingularityError, AssemblyError)):
        mechanism.close(np.array([0.05]))


def test_completing_a_singular_pose_says_which_pose_and_how_singular(lab):
    mechanism = Mechanism(parse(lab.parallelogram(0.5).xml))
    flat = np.zeros(3)
    with pytest.raises(
        SingularityError, match=r"singular at crank = 0: smallest singular value .*choose other independent"
    ):
        mechanism.complete(mechanism._state(flat, mechanism.evaluate(flat)))


def test_a_state_of_closed_coordinates_is_the_closed_state_and_open_ones_are_refused(lab):
    mechanism, y = build(lab, "four_bar")
    closed = mechanism.close(y)
    given = mechanism.state_of(closed.q.copy())
    np.testing.assert_allclose(given.G, closed.G, atol=1e-12)
    open_pose = closed.q.copy()
    open_pose[mechanism.dependent[0]] += 1e-3
    with pytest.raises(AssemblyError, match="close them first") as caught:
        mechanism.state_of(open_pose)
    assert caught.value.residual > 1e-5


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic"])
def test_one_joint_is_a_pendulum_or_a_slide_computed_by_hand(lab, kind):
    text = lab.Text("one").link("base", 0.0).point_mass("body", 2.0)
    text.joint("turn", kind, "base", "body", (0, 1, 0)).joint("toe", "fixed", "body", "foot", xyz=(0.3, 0, 0.0), mass=0)
    mechanism = Mechanism(parse(text.xml), "foot")
    q, v, a = 0.4, np.array([0.7]), np.array([0.2])
    state = mechanism.close(np.array([q]))
    if kind == "prismatic":
        position, column, rate = (0.3, q, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)
    else:
        c, s = math.cos(q), math.sin(q)
        position, column, rate = (0.3 * c, 0.0, -0.3 * s), (-0.3 * s, 0.0, -0.3 * c), (-0.3 * c, 0.0, 0.3 * s)
    inertia = 2.0 if kind == "prismatic" else 1e-3
    np.testing.assert_allclose(mechanism.foot_position(state), position, atol=1e-15)
    np.testing.assert_allclose(mechanism.foot_jacobian(state), np.reshape(column, (3, 1)), atol=1e-15)
    expected = 0.7 * np.array(rate)
    np.testing.assert_allclose(mechanism.foot_jacobian_derivative(state, v), expected[:, None], atol=1e-15)
    np.testing.assert_allclose(mechanism.foot_bias_acceleration(state, v), 0.7 * expected, atol=1e-15)
    np.testing.assert_allclose(mechanism.mass_matrix(state), [[inertia]], rtol=1e-12)
    force = np.array([1.0, 2.0, 3.0])
    effort = mechanism.generalized_force(state, v, a, force)
    np.testing.assert_allclose(effort, inertia * a - np.dot(column, force), rtol=1e-12)
    np.testing.assert_allclose(mechanism.acceleration(state, v, effort, force), a, rtol=1e-9)
    assert mechanism.evaluate(np.array([q])).jacobian.shape == (0, 1)


def one_joint_with_a_loop(lab, kind, offset):
    text = lab.Text("ring").joint("turn", "continuous", "base", "body")
    axis = None if kind == "fixed" else (0, 0, 1)
    return Mechanism(
        parse(text.loop("ring", kind, ("base", lab.ZERO, lab.ZERO), ("body", (offset, 0, 0), lab.ZERO), axis).xml)
    )


def test_a_loop_without_dependent_joints_is_closed_where_its_residual_says_so(lab):
    state = one_joint_with_a_loop(lab, "revolute", 0.0).close(np.array([0.4]))
    assert (state.q, state.G) == (0.4, 1.0)
    mechanism = one_joint_with_a_loop(lab, "revolute", 0.0)
    v = np.array([0.5])
    np.testing.assert_array_equal(mechanism.bias_acceleration(state, v), [0.0])
    with pytest.raises(AssemblyError, match="no regular closed pose"):
        one_joint_with_a_loop(lab, "fixed", 5.0).close(np.array([0.0]))
    with pytest.raises(DescriptionError, match="mobility is 0"):
        one_joint_with_a_loop(lab, "fixed", 0.0).close(np.array([0.0]))


def test_overflow_is_not_called_a_motion_without_mass(lab):
    chain = Mechanism(parse(lab.open_chain().xml))
    near, far = np.full(3, 0.3), np.full(3, 1e160)
    with np.errstate(all="ignore"):
        assert not np.isfinite(chain.acceleration(chain.close(near), np.full(3, 1e200), np.zeros(3))).any()
        assert not np.isfinite(chain.acceleration(chain.close(far), np.zeros(3), np.zeros(3))).all()
        damped = Mechanism(parse(lab.open_chain(damping=0.1).xml))
        assert np.isnan(damped.acceleration(damped.close(far), np.zeros(3), np.zeros(3))).all()


def test_loop_forces_of_an_overflow_are_named(omnileg):
    state = omnileg.close(np.array([0.1, 0.2, 0.3]))
    with np.errstate(all="ignore"), pytest.raises(NonFiniteError, match=r"loop forces at alpha = 0\.1.*too large"):
        omnileg.loop_forces(state, np.full(3, 1e200), np.zeros(3))
    assert omnileg.loop_forces(state, np.full(3, 1e3), np.zeros(3)).imbalance < 1e-3
