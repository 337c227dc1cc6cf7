"""The interface on both routes: golden values, shapes, refused input, errors with their rows, immutability, threads."""

from __future__ import annotations

import copy
import math
import pickle
import re
import threading

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import shipped_urdf
from leg_dynamics.errors import (
    ActuationError,
    AssemblyError,
    JointLimitError,
    MissingFootError,
    NonFiniteError,
    OutOfReachError,
    ParameterError,
    RouteError,
    ShapeError,
    SingularityError,
    UnsupportedError,
)
from leg_dynamics.leg import Leg, checked

L1, L4, L5 = 0.15, 0.095, 0.16
Q = np.radians([30.0, 20.0, 40.0])
V = np.array([0.5, -1.0, 2.0])
A = np.array([3.0, -2.0, 5.0])
FORCE = np.array([5.0, -20.0, 30.0])
TILTED = np.array([2.0, -3.0, 8.5])
FOLDED = np.radians([0.0, 0.0, 120.0])
"""Beyond the folded pose (gamma = 90 deg), where the shank's chains lose their direction: no way there from home."""

METHODS = {
    "assemble": "q",
    "foot_position": "q",
    "inverse_kinematics": "p",
    "jacobian": "q",
    "jacobian_derivative": "qv",
    "foot_velocity": "qv",
    "foot_acceleration": "qva",
    "mass_matrix": "q",
    "bias": "qv",
    "gravity_torque": "q",
    "kinetic_energy": "qv",
    "potential_energy": "q",
    "torque": "qva",
    "generalized_force": "qva",
    "acceleration": "qvt",
    "foot_force": "qvat",
}
FOOT_METHODS = [
    "foot_position",
    "inverse_kinematics",
    "jacobian",
    "jacobian_derivative",
    "foot_velocity",
    "foot_acceleration",
    "foot_force",
]


def compact_foot(q):
    """The audit's closed formula of P_F."""
    ta, tb = np.tan(q[..., 0]), np.tan(q[..., 1])
    length = L1 / np.sqrt(1.0 + ta**2 + tb**2)
    return np.stack([tb * length, -ta * length, length + 2.0 * L4 * np.cos(q[..., 2]) + L5], axis=-1)


def compact_determinant(q):
    ta, tb = np.tan(q[..., 0]), np.tan(q[..., 1])
    secants = (1.0 + ta**2) * (1.0 + tb**2)
    return -2.0 * L4 * np.sin(q[..., 2]) * L1**2 * secants / (1.0 + ta**2 + tb**2) ** 2


def box(count, gamma=(1.0, 85.0), seed=0):
    """Random coordinates in the joint limits."""
    lower, upper = np.radians([[-65.0, -65.0, gamma[0]], [65.0, 65.0, gamma[1]]])
    return np.random.default_rng(seed).uniform(lower, upper, (count, 3))


def arguments(leg, method):
    """One valid sample for each argument of a method."""
    values = {"q": Q, "v": V, "a": A, "t": np.array([1.0, -2.0, 0.5]), "p": compact_foot(Q)}
    return [values[letter] for letter in METHODS[method]]


@pytest.fixture(scope="module", params=["closed_form", "pinocchio", "symbolic"])
def leg(request):
    return ld.load("omnileg", request.param)


# ---------------------------------------------------------------------- golden values


def test_foot_position_by_the_compact_formula(leg):
    np.testing.assert_allclose(leg.foot_position(Q), compact_foot(Q), rtol=0, atol=1e-12)
    q = box(50, gamma=(-45.0, 85.0))
    np.testing.assert_allclose(leg.foot_position(q), compact_foot(q), rtol=0, atol=1e-12)
    np.testing.assert_allclose(leg.foot_position([0.0, 0.0, 0.0]), [0.0, 0.0, 0.5], rtol=0, atol=1e-12)


def test_determinant_of_the_jacobian(leg):
    q = np.vstack([box(50, gamma=(-45.0, 85.0)), np.zeros(3)])
    np.testing.assert_allclose(np.linalg.det(leg.jacobian(q)), compact_determinant(q), rtol=0, atol=1e-14)
    assert abs(compact_determinant(Q)) > 1e-3


def test_inverse_kinematics_undoes_foot_position(leg):
    q = box(80)
    q[:4] = np.radians([[65.0, 65.0, 1.0], [-65.0, 65.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 85.0]])
    np.testing.assert_allclose(leg.inverse_kinematics(leg.foot_position(q)), q, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("t", "force", "expected"),
    [
        (0.0, (0.0, -20.0, 20.0), (-3.0, -0.000002, 0.0)),
        (1.0, (0.0, -20.0, 20.0), (-0.781006, 2.275804, 1.634104)),
        (1.5, None, (0.823331, 0.823327, 0.264922)),
        (1.0, (0.0, 20.0, -20.0), (2.328380, -0.728440, -1.169886)),
    ],
    ids=["start", "pushed", "free", "paper-sign"],
)
def test_golden_torques_of_the_audit(leg, t, force, expected):
    # Eq. (52): amplitudes 30, 30, 25 deg at pi/3 rad/s.
    amplitude, w = np.radians([30.0, 30.0, 25.0]), math.pi / 3.0
    q, v = amplitude * math.sin(w * t), amplitude * w * math.cos(w * t)
    np.testing.assert_allclose(leg.torque(q, v, -(w**2) * q, force), expected, rtol=0, atol=1e-5)


def test_velocity_and_acceleration_by_differences(leg):
    h = 1e-4
    ahead, behind = (compact_foot(Q + s * h * V + 0.5 * h**2 * A) for s in (1.0, -1.0))
    np.testing.assert_allclose(leg.foot_velocity(Q, V), (ahead - behind) / (2.0 * h), atol=1e-6)
    np.testing.assert_allclose(
        leg.foot_acceleration(Q, V, A), (ahead - 2.0 * compact_foot(Q) + behind) / h**2, atol=1e-5
    )


def test_forward_dynamics_undoes_inverse_dynamics(leg):
    tau = leg.torque(Q, V, A, FORCE, TILTED)
    np.testing.assert_allclose(leg.acceleration(Q, V, tau, FORCE, TILTED), A, atol=1e-10)


def test_torque_is_mass_times_acceleration_plus_bias_minus_foot_force(leg):
    expected = leg.mass_matrix(Q) @ A + leg.bias(Q, V, TILTED) - leg.jacobian(Q).T @ FORCE
    np.testing.assert_allclose(leg.generalized_force(Q, V, A, FORCE, TILTED), expected, atol=1e-10)
    np.testing.assert_allclose(leg.torque(Q, V, A, FORCE, TILTED), expected, atol=1e-10)


def test_gravity_is_the_hip_frame_vector(leg):
    np.testing.assert_allclose(leg.gravity, [0.0, 0.0, np.linalg.norm(leg.gravity)], atol=1e-12)
    np.testing.assert_allclose(leg.gravity_torque(Q, leg.gravity), leg.gravity_torque(Q), atol=1e-12)
    np.testing.assert_allclose(leg.gravity_torque(Q, [0.0, 0.0, 0.0]), 0.0, atol=1e-14)
    energy = leg.potential_energy(Q, TILTED) - leg.potential_energy(np.zeros(3), TILTED)
    assert energy != pytest.approx(leg.potential_energy(Q) - leg.potential_energy(np.zeros(3)))


def test_energies(leg):
    assert leg.kinetic_energy(Q, V) == pytest.approx(0.5 * V @ leg.mass_matrix(Q) @ V, rel=1e-12)
    # The straight leg hangs lowest.
    assert leg.potential_energy(np.zeros(3)) < leg.potential_energy(Q)


def test_torque_at_the_straight_leg_works(leg):
    q = np.array([0.2, -0.1, 0.0])
    assert np.isfinite(leg.torque(q, V, A, FORCE)).all()
    assert np.isfinite(leg.acceleration(q, V, [0.1, 0.2, 0.3])).all()
    np.testing.assert_allclose(leg.jacobian(q)[:, 2], 0.0, atol=1e-14)


# ---------------------------------------------------------------------- foot force


def test_foot_force_undoes_torque(leg):
    q = box(20)
    v, a = np.tile(V, (20, 1)), np.tile(A, (20, 1))
    force = np.random.default_rng(1).uniform(-50.0, 50.0, (20, 3))
    tau = leg.torque(q, v, a, force, TILTED)
    np.testing.assert_allclose(leg.foot_force(q, v, a, tau, TILTED), force, atol=1e-9)
    np.testing.assert_allclose(leg.foot_force(q[0], v[0], a[0], tau[0], gravity=TILTED), force[0], atol=1e-9)


def test_foot_force_of_a_standing_leg(leg):
    """Statics written out: J^T F = gravity torque - tau."""
    tau = np.array([1.0, -2.0, 3.0])
    expected = np.linalg.solve(leg.jacobian(Q).T, leg.gravity_torque(Q) - tau)
    zero = np.zeros(3)
    np.testing.assert_allclose(leg.foot_force(Q, zero, zero, tau), expected, atol=1e-10)


def test_foot_force_at_the_straight_leg_is_refused(leg):
    zero = np.zeros(3)
    with pytest.raises(SingularityError, match="gamma = 0") as caught:
        leg.foot_force([0.2, -0.1, 0.0], zero, zero, zero)
    assert caught.value.rows.tolist() == [0]
    assert caught.value.margin == pytest.approx([0.0], abs=1e-12)


def test_foot_force_margin_is_the_smallest_singular_value(leg):
    q = np.array([[0.2, -0.1, 0.5], [0.2, -0.1, 1e-8], [0.2, -0.1, -1e-9], [0.2, -0.1, 1e-3]])
    zero = np.zeros(3)
    smallest = np.linalg.svd(leg.jacobian(q), compute_uv=False)[:, 2]
    with pytest.raises(SingularityError) as caught:
        leg.foot_force(q, zero, zero, zero)
    assert caught.value.rows.tolist() == [1, 2]
    np.testing.assert_allclose(caught.value.margin, smallest[1:3], rtol=1e-6, atol=1e-15)
    found = leg.foot_force(q, zero, zero, zero, on_error="nan")
    assert np.isnan(found).any(axis=1).tolist() == [False, True, True, False]


GEARED = """<robot name="geared">
  <link name="hip"/>
  <link name="yoke">{body}</link><link name="thigh">{body}</link><link name="shank">{body}</link>
  <link name="rotor">{body}</link><link name="foot">{body}</link>
  <joint name="yaw" type="revolute"><parent link="hip"/><child link="yoke"/><axis xyz="1 0 0"/>{limit}</joint>
  <joint name="pitch" type="revolute"><parent link="yoke"/><child link="thigh"/><axis xyz="0 1 0"/>{limit}</joint>
  <joint name="knee" type="revolute"><parent link="thigh"/><child link="shank"/>
    <origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>{limit}</joint>
  <joint name="motor" type="revolute" independent="false"><parent link="thigh"/><child link="rotor"/>
    <axis xyz="0 1 0"/>{limit}</joint>
  <joint name="ankle" type="fixed"><parent link="shank"/><child link="foot"/><origin xyz="0 0 0.2"/></joint>
  <coupling name="belt"><predecessor link="shank"/><successor link="rotor"/><ratio value="2"/></coupling>
  {transmissions}
</robot>"""
BODY = """<inertial><origin xyz="0.01 0.02 0.05"/><mass value="0.5"/>
  <inertia ixx="2e-3" ixy="0" ixz="0" iyy="2e-3" iyz="0" izz="2e-3"/></inertial>"""
LIMIT = '<limit lower="-2" upper="2" effort="10" velocity="10"/>'


def four_bar():
    """Crank, coupler and rocker of 0.2 m on a ground of 0.3 m: the crank stops at acos(-1/4) = 104 deg."""
    tip, pivot = 0.2 * np.exp(1j), 0.3
    half = 0.5 * (pivot - tip)
    pin = tip + half + 1j * half / abs(half) * math.sqrt(0.04 - abs(half) ** 2)
    rocking, joining = float(np.angle(pin - pivot)), float(np.angle(pin - tip)) - 1.0
    return f"""<robot name='four_bar'>
  <link name='ground'/>
  <link name='crank'>{BODY}</link><link name='coupler'>{BODY}</link><link name='rocker'>{BODY}</link>
  <joint name='turning' type='revolute'><parent link='ground'/><child link='crank'/>
    <axis xyz='0 0 1'/>{LIMIT}</joint>
  <joint name='joining' type='revolute' independent='false'><parent link='crank'/><child link='coupler'/>
    <origin xyz='0.2 0 0'/><axis xyz='0 0 1'/>{LIMIT}</joint>
  <joint name='rocking' type='revolute' independent='false'><parent link='ground'/><child link='rocker'/>
    <origin xyz='0.3 0 0'/><axis xyz='0 0 1'/>{LIMIT}</joint>
  <loop name='pin' type='revolute'><predecessor link='coupler'><origin xyz='0.2 0 0'/></predecessor>
    <successor link='rocker'><origin xyz='0.2 0 0'/></successor><axis xyz='0 0 1'/></loop>
  <configuration name='home'><joint name='turning' value='1.0'/><joint name='joining' value='{joining!r}'/>
    <joint name='rocking' value='{rocking!r}'/></configuration>
</robot>"""


FOUR_BAR = four_bar()
SLIDER = f"""<robot name='slider'><link name='rail'/><link name='block'>{BODY}</link>
  <joint name='sliding' type='prismatic'><parent link='rail'/><child link='block'/><axis xyz='1 0 0'/>{LIMIT}</joint>
</robot>"""


def geared(*actuated):
    transmissions = "".join(
        f'<transmission name="t_{name}"><type>transmission_interface/SimpleTransmission</type><joint name="{name}"/>'
        f'<actuator name="M_{name}"><mechanicalReduction>1</mechanicalReduction></actuator></transmission>'
        for name in actuated
    )
    return ld.load(GEARED.format(body=BODY, limit=LIMIT, transmissions=transmissions))


def test_foot_force_where_a_motor_drives_through_a_belt():
    leg = geared("motor", "yaw", "pitch")
    assert leg.actuator_names == ("M_motor", "M_yaw", "M_pitch")
    q, v, a = np.array([0.1, 0.3, 0.8]), V, A
    general = leg.generalized_force(q, v, a, FORCE)
    tau = leg.torque(q, v, a, FORCE)
    # The motor turns twice as fast as the knee, so it needs half its moment.
    np.testing.assert_allclose(tau, [0.5 * general[2], general[0], general[1]], atol=1e-10)
    np.testing.assert_allclose(leg.foot_force(q, v, a, tau), FORCE, atol=1e-9)
    with pytest.raises(SingularityError):
        leg.foot_force([0.1, 0.3, 0.0], v, a, tau)


def test_foot_force_with_other_than_three_actuators_or_coordinates():
    leg = geared("yaw", "pitch")
    with pytest.raises(ActuationError, match="3 coordinates and 2 actuators"):
        leg.foot_force(Q, V, A, [1.0, 2.0])
    with pytest.raises(ActuationError):
        leg.torque(Q, V, A)
    assert leg.generalized_force(Q, V, A).shape == (3,)
    single = ld.load(FOUR_BAR, foot="coupler")
    with pytest.raises(UnsupportedError, match="1 coordinates"):
        single.foot_force([1.0], [0.0], [0.0], [0.0])


# ---------------------------------------------------------------------- what the leg is


def test_what_the_leg_is(leg):
    assert leg.joint_names == ("alpha", "beta", "gamma")
    assert leg.actuator_names == ("M2", "M1", "M3")
    assert leg.units.joints == ("rad", "rad", "rad")
    assert leg.units.actuators == ("N·m", "N·m", "N·m")
    assert (leg.name, leg.foot) == ("omnileg", "foot")
    assert leg.route in repr(leg)
    assert leg.backend.name == leg.route
    assert set(leg.joint_names) < set(leg.tree_joint_names)
    assert leg.branches
    assert leg.description.name == "omnileg"
    np.testing.assert_allclose(np.degrees(leg.limits.lower), [-65.0, -65.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(np.degrees(leg.limits.upper), [65.0, 65.0, 85.0], atol=1e-9)
    assert (leg.limits.effort > 0.0).all()
    assert (leg.limits.velocity > 0.0).all()


def test_a_prismatic_coordinate_is_in_metres():
    leg = ld.load(SLIDER)
    assert (leg.units.joints, leg.units.actuators) == (("m",), ("N",))
    np.testing.assert_allclose(leg.torque([0.1], [0.0], [2.0]), [1.0], atol=1e-12)


@pytest.mark.parametrize("name", ["route", "limits", "gravity", "_n", "anything"])
def test_a_leg_cannot_be_changed(leg, name):
    with pytest.raises(AttributeError):
        setattr(leg, name, 1)
    with pytest.raises(AttributeError):
        delattr(leg, name)
    assert not hasattr(leg, "__dict__")


def test_limits_and_gravity_cannot_be_changed(leg):
    for array in (leg.limits.lower, leg.limits.upper, leg.limits.effort, leg.limits.velocity, leg.gravity):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(AttributeError):
        leg.limits.lower = np.zeros(3)
    with pytest.raises(AttributeError):
        leg.units.joints = ()


@pytest.mark.parametrize("clone", [lambda leg: pickle.loads(pickle.dumps(leg)), copy.copy, copy.deepcopy])
def test_a_clone_computes_the_same(leg, clone):
    other = clone(leg)
    assert isinstance(other, Leg)
    assert (other.route, other.foot, other.joint_names) == (leg.route, leg.foot, leg.joint_names)
    np.testing.assert_allclose(other.torque(Q, V, A, FORCE), leg.torque(Q, V, A, FORCE), rtol=0, atol=1e-12)


def test_several_threads_get_what_one_gets(leg):
    q = box(60, gamma=(-45.0, 85.0))
    expected = leg.torque(q, V, A, FORCE)
    parts = [np.arange(start, 60, 4) for start in range(4)]
    found, problems = np.full_like(expected, np.nan), []

    def work(rows):
        try:
            for row in rows:
                # Gravity is per call: one thread's must not leak into another's.
                leg.gravity_torque(q[row], TILTED * (1.0 + row))
                found[row] = leg.torque(q[row], V, A, FORCE)
                leg.foot_position(q[rows])
        except Exception as error:
            problems.append(error)

    threads = [threading.Thread(target=work, args=(rows,)) for rows in parts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not problems
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


# ---------------------------------------------------------------------- shapes


def shape_of(result):
    return next(iter(result.values())).shape if isinstance(result, dict) else result.shape


@pytest.mark.parametrize("method", METHODS)
def test_one_sample_a_batch_and_more_dimensions_agree(leg, method):
    sample = arguments(leg, method)
    call = getattr(leg, method)
    single = call(*sample)
    tail = shape_of(single)
    for leading in [(1,), (3,), (2, 3)]:
        batch = call(*(np.broadcast_to(argument, (*leading, 3)) for argument in sample))
        assert shape_of(batch) == leading + tail
        if isinstance(single, dict):
            batch, expected = np.stack([*batch.values()], -1), np.stack([*single.values()], -1)
        else:
            expected = single
        np.testing.assert_allclose(batch, np.broadcast_to(expected, batch.shape), rtol=0, atol=1e-10)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("leading", [(0,), (2, 0)])
def test_an_empty_batch(leg, method, leading):
    result = getattr(leg, method)(*(np.zeros((*leading, 3)) for _ in METHODS[method]))
    single = getattr(leg, method)(*arguments(leg, method))
    assert shape_of(result) == leading + shape_of(single)


def test_leading_dimensions_broadcast(leg):
    q, v, a = box(4), np.array([[0.5, -1.0, 2.0]]), A
    expected = np.stack([leg.torque(row, v[0], a) for row in q])
    np.testing.assert_allclose(leg.torque(q, v, a), expected, rtol=0, atol=1e-10)
    grid = leg.torque(q[:, None], np.stack([V, -V]), a, gravity=TILTED)
    assert grid.shape == (4, 2, 3)
    np.testing.assert_allclose(grid[3, 1], leg.torque(q[3], -V, a, gravity=TILTED), rtol=0, atol=1e-10)
    many = leg.gravity_torque(Q, np.stack([TILTED, leg.gravity]))
    np.testing.assert_allclose(many[1], leg.gravity_torque(Q), rtol=0, atol=1e-12)


def test_leading_dimensions_that_do_not_broadcast(leg):
    with pytest.raises(ShapeError, match=r"q \(2, 3\), v \(4, 3\)"):
        leg.bias(np.zeros((2, 3)), np.zeros((4, 3)))


def awkward_copies(q):
    wide = np.zeros((len(q), 6))
    wide[:, ::2] = q
    frozen = q.copy()
    frozen.setflags(write=False)
    return {
        "list": q.tolist(),
        "tuple": tuple(map(tuple, q.tolist())),
        "strided": wide[:, ::2],
        "backwards": q[::-1, ::-1].copy()[::-1, ::-1],
        "fortran": np.asfortranarray(q),
        "read-only": frozen,
        "big-endian": q.astype(">f8"),
        "no mask": np.ma.array(q),
    }


@pytest.mark.parametrize("kind", awkward_copies(np.zeros((1, 3))))
def test_any_memory_layout(leg, kind):
    q = box(3)
    given = awkward_copies(q)[kind]
    before = np.array(given)
    np.testing.assert_allclose(leg.torque(given, V, A), leg.torque(q, V, A), rtol=0, atol=1e-12)
    np.testing.assert_allclose(leg.mass_matrix(given[1]), leg.mass_matrix(q[1]), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(np.array(given), before)


@pytest.mark.parametrize("dtype", [np.int8, np.uint16, np.int64, np.float16, np.float32, np.longdouble])
def test_other_real_numbers(leg, dtype):
    q = np.array([0, 0, 1], dtype=dtype)
    np.testing.assert_allclose(leg.foot_position(q), compact_foot(np.array([0.0, 0.0, 1.0])), atol=1e-12)
    np.testing.assert_allclose(leg.foot_position([0, 0, 1]), leg.foot_position(q), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "value",
    [
        np.array([1j, 0, 0]),
        [1 + 0j, 0.0, 0.0],
        [True, False, True],
        np.array([True, False, True]),
        "abc",
        ["0.1", "0.2", "0.3"],
        [b"0.1", b"0.2", b"0.3"],
        np.array([0.1, 0.2, 0.3], dtype=object),
        [None, 0.0, 0.0],
        None,
        [object()] * 3,
        {"alpha": 0.1},
        np.zeros(3, dtype="datetime64[s]"),
        np.zeros(3, dtype="timedelta64[s]"),
        [[0.1, 0.2], [0.3]],
        [10**400, 0, 0],
        np.ma.array([0.1, 0.2, 0.3], mask=[False, True, False]),
    ],
    ids=lambda value: type(value).__name__,
)
@pytest.mark.parametrize("on_error", ["raise", "nan"])
def test_what_is_not_real_numbers_is_refused(leg, value, on_error):
    for call in (
        lambda: leg.mass_matrix(value, on_error=on_error),
        lambda: leg.gravity_torque(value, on_error=on_error),
        lambda: leg.torque(Q, value, A, on_error=on_error),
        lambda: leg.inverse_kinematics(value, on_error=on_error),
    ):
        with pytest.raises(ShapeError):
            call()


@pytest.mark.parametrize("shape", [(), (0,), (1,), (2,), (4,), (3, 2), (3, 1), (2, 3, 4)])
@pytest.mark.parametrize("method", METHODS)
def test_a_wrong_last_axis(leg, method, shape):
    good = arguments(leg, method)
    for place in range(len(good)):
        given = [np.zeros(shape) if i == place else argument for i, argument in enumerate(good)]
        with pytest.raises(ShapeError, match="last axis") as caught:
            getattr(leg, method)(*given)
        assert caught.value.shape == shape
        assert caught.value.expected == 3


@pytest.mark.parametrize("name", ["foot_force", "gravity"])
def test_optional_arguments_are_checked_too(leg, name):
    for value in (9.81, [1.0, 2.0], "down", [1j, 0.0, 0.0]):
        with pytest.raises(ShapeError, match=name):
            leg.torque(Q, V, A, **{name: value})
    np.testing.assert_array_equal(leg.torque(Q, V, A, **{name: None}), leg.torque(Q, V, A))


def test_checked_copies_only_what_it_must():
    q = np.zeros((2, 3))
    assert checked("q", q, 3) is q
    assert checked("q", np.float32(q), 3).dtype == np.float64


# ---------------------------------------------------------------------- out=


@pytest.mark.parametrize("count", [None, 3])
def test_out_receives_the_result(leg, count):
    q = Q if count is None else box(count)
    out = np.full(q.shape, np.nan)
    assert leg.torque(q, V, A, out=out) is out
    np.testing.assert_array_equal(out, leg.torque(q, V, A))
    wide = np.zeros((*q.shape[:-1], 6))
    leg.torque(q, V, A, out=wide[..., ::2])
    np.testing.assert_array_equal(wide[..., ::2], out)
    assert not wide[..., 1::2].any()


def test_out_may_be_an_argument(leg):
    q = box(3)
    expected = leg.torque(q, V, A)
    leg.torque(q, V, A, out=q)
    np.testing.assert_array_equal(q, expected)


@pytest.mark.parametrize("route", ["closed_form", "symbolic"])
def test_out_over_an_argument_does_not_hide_which_one_is_wrong(route):
    leg = ld.load("omnileg", route)
    good = np.array([0.3, 0.2, 0.4])
    leg.torque(good, good, good)
    for q, v in ((good.copy(), np.array([0.1, np.nan, 0.2])), (np.tile(good, (5, 1)), np.full((5, 3), np.nan))):
        with pytest.raises(NonFiniteError, match=r"v = \["):
            leg.torque(q, v, v, out=q)


def test_out_over_an_argument_of_rows_that_take_the_fallback():
    """A pose far out is left to the numeric route, which must find its arguments as they were given."""
    leg = ld.load("omnileg", "symbolic")
    memory = np.array([[0.3, 0.2, 0.4], [1.52501462, 1.53970395, 0.07662781], [0.0, 0.0, 0.0]])
    zero = np.zeros((2, 3))
    expected = leg.torque(memory[:2], zero, zero)
    np.testing.assert_array_equal(leg.torque(memory[:2].copy(), zero, zero), expected)
    leg.torque(memory[:-1], zero, zero, out=memory[1:])
    np.testing.assert_array_equal(memory[1:], expected)


def test_out_that_does_not_fit(leg):
    frozen = np.zeros(3)
    frozen.setflags(write=False)
    for out in (np.zeros(4), np.zeros((1, 3)), np.zeros(3, dtype=np.float32), np.zeros(3, int), [0.0] * 3, 0.0, frozen):
        with pytest.raises(ShapeError, match="out must be"):
            leg.torque(Q, V, A, out=out)
    with pytest.raises(ShapeError, match="out must be"):
        leg.torque(box(2), V, A, out=np.zeros(3))


def test_out_is_untouched_by_an_error_and_filled_with_nan_on_request(leg):
    q = np.stack([Q, [np.nan, 0.0, 0.0]])
    out = np.ones((2, 3))
    with pytest.raises(NonFiniteError):
        leg.torque(q, V, A, out=out)
    assert (out == 1.0).all()
    leg.torque(q, V, A, out=out, on_error="nan")
    np.testing.assert_allclose(out[0], leg.torque(Q, V, A), rtol=0, atol=1e-12)
    assert np.isnan(out[1]).all()


# ---------------------------------------------------------------------- rows that fail


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("method", METHODS)
def test_a_sample_that_is_not_finite(leg, method, bad):
    good = arguments(leg, method)
    single = getattr(leg, method)(*good)
    for place in range(len(good)):
        given = [np.where([False, True, False], bad, x) if i == place else x for i, x in enumerate(good)]
        with pytest.raises(NonFiniteError, match="not finite") as caught:
            getattr(leg, method)(*given)
        assert caught.value.rows.tolist() == [0]
        found = getattr(leg, method)(*given, on_error="nan")
        assert shape_of(found) == shape_of(single)
        values = list(found.values()) if isinstance(found, dict) else [found]
        assert all(np.isnan(value).all() for value in values)


def test_rows_are_flat_indices(leg):
    q = np.tile(Q, (2, 3, 1))
    q[0, 1, 0] = np.nan
    v = np.zeros((2, 3, 3))
    v[1, 2, 2] = np.inf
    v[0, 1, 1] = np.nan
    with pytest.raises(NonFiniteError) as caught:
        leg.torque(q, v, A)
    assert caught.value.rows.tolist() == [1, 5]
    assert "2 of 6 rows failed; first row 1: q = [nan" in str(caught.value)
    found = leg.torque(q, v, A, on_error="nan")
    assert found.shape == (2, 3, 3)
    assert np.isnan(found).any(axis=-1).ravel().tolist() == [False, True, False, False, False, True]
    np.testing.assert_allclose(found[1, 0], leg.torque(Q, v[1, 0], A), rtol=0, atol=1e-10)


def test_a_broadcast_argument_that_is_not_finite_fails_every_row(leg):
    with pytest.raises(NonFiniteError) as caught:
        leg.torque(box(3), V, A, gravity=[0.0, np.nan, 0.0])
    assert caught.value.rows.tolist() == [0, 1, 2]
    assert caught.value.argument == "gravity"


@pytest.mark.parametrize("value", ["ignore", None, "", 0])
def test_on_error_is_one_of_two_words(leg, value):
    with pytest.raises(ShapeError, match="on_error"):
        leg.mass_matrix(Q, on_error=value)


def test_out_of_reach(leg):
    far = np.array([0.0, 0.0, 0.6])
    with pytest.raises(OutOfReachError) as caught:
        leg.inverse_kinematics(far)
    # The straight leg ends at 0.5 m.
    assert caught.value.margin == pytest.approx([-0.1], abs=1e-6)
    p = np.stack([compact_foot(Q), far, compact_foot(Q), far])
    with pytest.raises(OutOfReachError, match="2 of 4 rows failed; first row 1") as caught:
        leg.inverse_kinematics(p)
    assert caught.value.rows.tolist() == [1, 3]
    found = leg.inverse_kinematics(p.reshape(2, 2, 3), on_error="nan")
    np.testing.assert_allclose(found[:, 0], [Q, Q], atol=1e-9)
    assert np.isnan(found[:, 1]).all()


def test_an_arccos_argument_outside_its_domain(leg):
    """(13): cos(gamma) = (z - L5 - thigh) / 2 L4 leaves [-1, 1] above the hip too."""
    near = compact_foot(np.zeros(3)) - [0.0, 0.0, 4.0 * L4 + 0.02]
    with pytest.raises(OutOfReachError) as caught:
        leg.inverse_kinematics(near, limits="ignore")
    assert caught.value.margin[0] < 0.0
    sideways = np.array([L1 + 0.01, 0.0, 0.3])
    with pytest.raises(OutOfReachError):
        leg.inverse_kinematics(sideways, limits="ignore")


def test_the_margin_of_the_arccos_argument_is_a_length():
    leg = ld.load("omnileg")
    with pytest.raises(OutOfReachError) as caught:
        leg.inverse_kinematics([0.0, 0.0, 0.5 + 1e-3])
    assert caught.value.margin == pytest.approx([-1e-3], rel=1e-6)


def test_joint_limits(leg):
    q = np.stack([Q, np.radians([70.0, 0.0, 30.0]), np.radians([0.0, -66.0, 30.0])])
    p = compact_foot(q)
    with pytest.raises(JointLimitError, match=r"alpha = 1\.22") as caught:
        leg.inverse_kinematics(p[1])
    np.testing.assert_allclose(caught.value.margin, -np.radians([5.0]), atol=1e-6)
    assert caught.value.joint == "alpha"
    with pytest.raises(JointLimitError) as caught:
        leg.inverse_kinematics(p)
    assert caught.value.rows.tolist() == [1, 2]
    np.testing.assert_allclose(caught.value.margin, -np.radians([5.0, 1.0]), atol=1e-6)
    found = leg.inverse_kinematics(p, on_error="nan")
    assert np.isnan(found).any(axis=1).tolist() == [False, True, True]
    np.testing.assert_allclose(leg.inverse_kinematics(p, limits="ignore"), q, atol=1e-8)
    # Nothing else enforces them.
    assert np.isfinite(leg.torque(q, V, A)).all()


@pytest.mark.parametrize("route", ["closed_form", "pinocchio", "symbolic"])
def test_limits_of_passive_joints(route):
    """70 degrees to the side: the struts reach, the universal joints (60 degrees) do not."""
    leg = ld.load("hexapod_leg", route)
    angle = np.radians(70.0)
    p = np.array([0.0, -0.7 * np.sin(angle), 0.7 * np.cos(angle)])
    q = leg.inverse_kinematics(p, limits="ignore")
    assert (q > leg.limits.lower).all()
    assert (q < leg.limits.upper).all()
    with pytest.raises(JointLimitError, match=r"alpha3 = 1\.24\d+ rad is outside \[-1\.0472, 1\.0472\]") as caught:
        leg.inverse_kinematics(p)
    assert caught.value.margin == pytest.approx(np.pi / 3 - abs(leg.assemble(q)["alpha3"]), abs=1e-6)
    rows = leg.inverse_kinematics([p, [0.25, 0.2, 0.65]], on_error="nan")
    assert np.isnan(rows[0]).all()
    assert np.isfinite(rows[1]).all()


def test_two_kinds_of_failure_in_one_batch(leg):
    p = np.stack([compact_foot(np.radians([70.0, 0.0, 30.0])), [0.0, 0.0, 0.6]])
    with pytest.raises(JointLimitError, match="2 of 2 rows failed") as caught:
        leg.inverse_kinematics(p)
    assert caught.value.rows.tolist() == [0]
    assert caught.value.all_rows.tolist() == [0, 1]


def test_inverse_kinematics_options(leg):
    p = compact_foot(Q)
    for branch in (None, leg.branches[0]):
        np.testing.assert_allclose(leg.inverse_kinematics(p, branch=branch), Q, atol=1e-9)
    with pytest.raises(RouteError, match=leg.branches[0]):
        leg.inverse_kinematics(p, branch="sideways")
    with pytest.raises(RouteError, match="limits"):
        leg.inverse_kinematics(p, limits="clip")


def test_the_other_sign_of_gamma_is_a_branch():
    leg = ld.load("omnileg")
    mirrored = Q * [1.0, 1.0, -1.0]
    found = [leg.inverse_kinematics(compact_foot(Q), branch, limits="ignore") for branch in leg.branches]
    assert any(np.allclose(q, mirrored, atol=1e-9) for q in found)
    for q in found:
        np.testing.assert_allclose(leg.foot_position(q), compact_foot(Q), atol=1e-12)


def test_a_pose_that_cannot_be_assembled_has_its_evidence():
    leg = ld.load(FOUR_BAR, foot="coupler")
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        leg.assemble([3.1])
    assert caught.value.rows.tolist() == [0]
    assert caught.value.residual.shape == (1,)
    q = np.array([[0.9], [3.1], [1.0], [3.0]])
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        leg.torque(q, q, q)
    assert caught.value.all_rows.tolist() == [1, 3]
    found = leg.assemble(q, on_error="nan")
    assert np.isnan(found["rocking"]).tolist() == [False, True, False, True]
    assert np.isfinite(leg.foot_velocity(q, q, on_error="nan")).all(axis=1).tolist() == [True, False, True, False]


def test_the_numeric_route_refuses_what_lies_behind_a_singular_pose():
    leg = ld.load("omnileg", "pinocchio")
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        leg.torque(FOLDED, V, A)
    assert caught.value.margin.shape == (1,)
    found = leg.torque(np.stack([FOLDED, Q]), V, A, on_error="nan")
    np.testing.assert_allclose(found[1], leg.torque(Q, V, A), atol=1e-10)
    assert np.isnan(found[0]).all()


# ---------------------------------------------------------------------- no foot, no such method


@pytest.fixture(scope="module")
def footless():
    return ld.load(FOUR_BAR)


@pytest.mark.parametrize("method", FOOT_METHODS)
def test_a_missing_foot_comes_before_everything_else(footless, method):
    arguments = ["nonsense"] * len(METHODS[method])
    with pytest.raises(MissingFootError, match="foot='LINK'"):
        getattr(footless, method)(*arguments, on_error="nonsense")
    assert footless.foot is None


@pytest.mark.parametrize("method", ["torque", "generalized_force", "acceleration"])
def test_a_foot_force_needs_a_foot(footless, method):
    with pytest.raises(MissingFootError):
        getattr(footless, method)("nonsense", 1, 2, foot_force=[0.0, 0.0, 1.0])
    assert getattr(footless, method)([1.0], [0.5], [0.5]).shape == (1,)


def test_everything_else_works_without_a_foot(footless):
    q, v = np.array([[0.8], [1.0], [1.2]]), np.ones((3, 1))
    a = footless.acceleration(q, v, footless.torque(q, v, 2.0 * v))
    np.testing.assert_allclose(a, 2.0 * v, atol=1e-9)
    assert footless.kinetic_energy(q, v).shape == (3,)


def test_kernels_take_numbers_as_arrays():
    leg = ld.load("omnileg")
    kernel = leg.kernel("torque", vary=("L1", "foot.mass"))
    q, v, a = box(7), V, A
    nominal = np.array([leg.numbers["L1"], leg.numbers["foot.mass"]])
    np.testing.assert_allclose(kernel(q, v, a, nominal), leg.torque(q, v, a), rtol=1e-13, atol=1e-14)
    changed = kernel(q[:, None], v, a, nominal * [[1.0, 1.0], [1.1, 1.0], [1.0, 2.0]])
    assert changed.shape == (7, 3, 3)
    assert np.abs(changed[:, 1:] - changed[:, :1]).max(axis=(0, 2)).min() > 1e-3
    with pytest.raises(ParameterError, match=r"no formula 'torqe'.*choose one of acceleration, bias"):
        leg.kernel("torqe")
    with pytest.raises(ParameterError, match="'L99'"):
        leg.kernel("torque", vary=("L99",))
    with pytest.raises(UnsupportedError, match="has no kernel: load the leg by route closed_form"):
        ld.load("omnileg", "pinocchio").kernel("torque")


def test_what_only_the_numeric_route_offers():
    closed, numeric = ld.load("omnileg"), ld.load("omnileg", "pinocchio")
    for call in (closed.mobility_report, lambda: closed.loop_forces(Q, V, A)):
        with pytest.raises(UnsupportedError, match="by route pinocchio"):
            call()
    report = numeric.mobility_report(samples=3)
    assert (report.mobility, report.redundant) == (3, 9)
    forces = numeric.loop_forces(Q, V, A, FORCE, TILTED)
    assert not forces.unique
    with pytest.raises(ShapeError, match="one sample"):
        numeric.loop_forces(box(2), V, A)
    with pytest.raises(NonFiniteError):
        numeric.loop_forces(Q, V, [np.nan, 0.0, 0.0])


@pytest.mark.parametrize("route", ["closed_form", "pinocchio"])
def test_a_result_too_large_for_a_float_is_named_not_nan(route):
    leg = ld.load("omnileg", route=route)
    q = np.tile(np.radians([10.0, 20.0, 30.0]), (3, 1))
    v = np.array([[1.0, 1.0, 1.0], [1e200, 1e200, 1e200], [2.0, 2.0, 2.0]])
    for call in (lambda **k: leg.torque(q, v, v, **k), lambda **k: leg.kinetic_energy(q, v, **k)):
        with pytest.raises(NonFiniteError, match="too large for a float") as caught:
            call()
        assert caught.value.rows.tolist() == [1]
        marked = call(on_error="nan").reshape(3, -1)
        assert np.isnan(marked[1]).all()
        assert np.isfinite(marked[[0, 2]]).all()


def test_passive_joints_that_rest_have_no_coulomb_friction_by_either_route():
    text = shipped_urdf("omnileg").read_text(encoding="utf-8")
    passive = re.compile(r'(<joint [^>]*name="(?:theta|cardan|gamma_|phi|epsilon)[^>]*type="revolute">)')
    rubbing, count = passive.subn(r'\1<dynamics damping="0.02" friction="0.1"/>', text)
    assert count == 19
    formulas, numeric = (ld.load("omnileg", urdf=rubbing, route=route) for route in ("closed_form", "pinocchio"))
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (60, 3))
    sa, ca, sb, cb = np.sin(q[:, 0]), np.cos(q[:, 0]), np.sin(q[:, 1]), np.cos(q[:, 1])
    theta12_rests = np.stack([sa * ca * sb, cb, 0.0 * sa], axis=1)
    for v in (*np.eye(3), np.zeros(3), theta12_rests):
        motion = np.broadcast_to(v, q.shape)
        ours, theirs = (leg.torque(q, motion, np.zeros(3)) for leg in (formulas, numeric))
        np.testing.assert_allclose(ours, theirs, atol=1e-11)
    still, alone = (formulas.torque(q, v, np.zeros(3)) for v in (np.zeros(3), [1.0, 0.0, 0.0]))
    assert np.abs(alone - still).max() > 0.1


def test_foot_force_where_the_actuators_are_listed_in_another_order_than_the_joints():
    text = shipped_urdf("omnileg").read_text(encoding="utf-8")
    transmissions = re.findall(r"<transmission .*?</transmission>", text, re.DOTALL)
    others = text.replace(transmissions[0], "").replace("</robot>", f"{transmissions[0]}</robot>")
    legs = [geared("knee", "yaw", "pitch")]
    legs += [ld.load("omnileg", urdf=others, route=route) for route in ("closed_form", "pinocchio")]
    for leg in legs:
        tau = leg.torque(Q, V, A, FORCE)
        general = leg.generalized_force(Q, V, A, FORCE)
        order = [2, 0, 1] if leg is legs[0] else [1, 2, 0]
        np.testing.assert_allclose(tau, general[order], atol=1e-12)
        np.testing.assert_allclose(leg.foot_force(Q, V, A, tau), FORCE, atol=1e-9)
        batch = leg.foot_force(*(np.tile(row, (2, 1)) for row in (Q, V, A, tau)))
        np.testing.assert_allclose(batch, [FORCE, FORCE], atol=1e-9)


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_joint_limits_leave_room_for_rounding_only(joint, side):
    leg = ld.load("omnileg")
    limit = (leg.limits.upper if side > 0.0 else leg.limits.lower)[joint]

    def outside_by(excess):
        q = Q.copy()
        q[joint] = limit + side * excess
        return compact_foot(q)

    for excess in (1e-6, 1e-8):
        with pytest.raises(JointLimitError) as caught:
            leg.inverse_kinematics(outside_by(excess))
        np.testing.assert_allclose(caught.value.margin, [-excess], rtol=1e-4)
        assert caught.value.joint == leg.joint_names[joint]
    found = leg.inverse_kinematics(outside_by(1e-11))
    assert side * (found[joint] - limit) == pytest.approx(1e-11, rel=1e-2)  # accepted, not clipped


@pytest.mark.parametrize("end", [1.0, -1.0], ids=["stretched", "folded"])
def test_the_arccos_argument_leaves_room_for_rounding_only(end):
    leg = ld.load("omnileg")

    def beyond_by(excess):
        return [0.0, 0.0, L1 + L5 + end * 2.0 * L4 * (1.0 + excess)]

    found = leg.inverse_kinematics(beyond_by(5e-13), limits="ignore")
    np.testing.assert_allclose(found, [0.0, 0.0, 0.0 if end > 0.0 else math.pi], rtol=0, atol=1e-15)
    for excess in (2e-11, 4e-12):
        with pytest.raises(OutOfReachError) as caught:
            leg.inverse_kinematics(beyond_by(excess), limits="ignore")
        np.testing.assert_allclose(caught.value.margin, [-2.0 * L4 * excess], rtol=1e-3)


@pytest.mark.parametrize("which", ["rods", "shaft"])
def test_the_least_usable_singularity_margin_is_a_millionth(which):
    """D = e² where alpha = 90 deg and beta = 90 deg - e; cos²(b) = e² where alpha = 90 deg - e and beta = gamma = 0."""
    leg = ld.load("omnileg")

    def pose(margin):
        e = math.sqrt(margin)
        right = math.pi / 2.0
        return [right, right - e, math.pi / 4.0] if which == "rods" else [right - e, 0.0, 0.0]

    assert np.isfinite(leg.jacobian(pose(1.1e-6))).all()
    for margin in (0.9e-6, 2e-9):
        with pytest.raises(SingularityError) as caught:
            leg.jacobian(pose(margin))
        np.testing.assert_allclose(caught.value.margin, [margin], rtol=1e-5)
    rows = np.isnan(leg.jacobian([pose(1.1e-6), pose(0.9e-6)], on_error="nan")).all(axis=(1, 2))
    assert rows.tolist() == [False, True]
