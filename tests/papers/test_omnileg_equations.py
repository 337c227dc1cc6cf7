"""Verdicts on the equations of the OmniLeg paper: complete, computed, and able to change."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.omnileg import equations, facts, printed

CORRECTED = {
    "(5)", "(9)", "(12)", "(13)", "(16)", "(26)", "(27)", "(29)", "(34)", "(38)", "(39)", "(40)", "(44)",
    "(45)", "(46)", "(47)", "(48)", "(49)", "(50)", "Table 1", "Table 2",
}  # fmt: skip


@functools.cache
def legs() -> tuple[Context, facts.Assembled]:
    context = Context("omnileg", samples=400)
    return context, facts.assembled(context)


def fresh() -> Context:
    """A context with nothing in it but the legs and the assembled mechanism, which no formula enters."""
    known, assembled = legs()
    context = Context("omnileg", samples=400, shared={"equations: assembled": assembled})
    context.__dict__.update(leg=known.leg, pinocchio=known.pinocchio)
    return context


@pytest.fixture(scope="module")
def verdicts():
    context = fresh()
    return {verdict.item: verdict for verdict in (function(context) for function in equations.VERDICTS)}


def figure(verdict, name):
    return next(f.value for f in verdict.figures if f.name == name)


# ---------------------------------------------------------------------- the whole list


def test_every_equation_and_table_has_a_verdict_in_order(verdicts):
    assert list(verdicts) == [f"({n})" for n in range(1, 54)] + ["Table 1", "Table 2"]
    assert {v.kind for v in verdicts.values()} == {"equation", "table"}


def test_every_verdict_has_figures_and_says_something(verdicts):
    for verdict in verdicts.values():
        assert verdict.figures, verdict.item
        assert verdict.finding.endswith("."), verdict.item
        assert "nan" not in verdict.finding.lower(), verdict.item
        assert verdict.title, verdict.item
        assert verdict.printed, verdict.item
        missing = [f.name for f in verdict.figures if not math.isfinite(f.value)]
        assert missing == (["printed form, worst difference"] if verdict.item in ("(47)", "(48)") else []), verdict.item


def test_the_corrected_set(verdicts):
    assert {item for item, v in verdicts.items() if v.status is Status.CORRECTED} == CORRECTED
    assert {v.status for item, v in verdicts.items() if item not in CORRECTED} == {Status.CONFIRMED}


@pytest.mark.parametrize("item", sorted(CORRECTED - {"(47)", "(48)"}))
def test_corrected_items_really_differ_and_show_both_forms(verdicts, item):
    verdict = verdicts[item]
    off = figure(verdict, "printed form, worst difference")
    assert off > 1e-3
    assert figure(verdict, "corrected form, worst difference") < 1e-9 * max(1.0, off)
    assert figure(verdict, "printed form, left after the one repair") < 1e-9 * max(1.0, off)
    assert "The defect: " in verdict.finding
    assert verdict.corrected
    assert verdict.corrected != verdict.printed


def test_a_second_run_gives_the_same(verdicts):
    context = fresh()
    for function in (equations.equation_9, equations.equation_29, equations.table_2):
        again = function(context)
        assert again.to_dict() == verdicts[again.item].to_dict()


# ---------------------------------------------------------------------- numbers known otherwise


def test_numbers_at_the_test_pose(verdicts):
    a, b = math.radians(30.0), math.radians(20.0)
    root = math.sqrt(1.0 + math.tan(a) ** 2 + math.tan(b) ** 2)
    true_x, true_y = 0.15 * math.tan(b) / root, -0.15 * math.tan(a) / root
    assert figure(verdicts["(9)"], "x of the mechanism") == pytest.approx(true_x, abs=1e-12)
    assert figure(verdicts["(9)"], "x as printed") == pytest.approx(true_x / math.sin(b), abs=1e-12)
    assert figure(verdicts["(5)"], "P_y of the mechanism") == pytest.approx(true_y, abs=1e-12)
    assert figure(verdicts["(5)"], "P_y by the label") == pytest.approx(-true_y, abs=1e-12)
    # The wrong sign of theta22 mirrors x alone.
    assert figure(verdicts["(12)"], "loop gap at the test pose") == pytest.approx(2.0 * true_x, abs=1e-12)
    z = 0.15 / root + 0.19 * math.cos(math.radians(40.0))
    bracket = math.degrees(math.acos(z - 0.15 / root / 0.19))
    assert figure(verdicts["(13)"], "γ as printed") == pytest.approx(bracket, abs=1e-9)
    assert bracket == pytest.approx(112.5, abs=0.05)


def test_both_plus_signs_of_12_never_hold(verdicts):
    gaps = {f.name: f.value for f in verdicts["(12)"].figures}
    assert gaps["loop gap as printed"] > 0.1
    assert gaps["gap with (5) by its label"] > 0.1
    assert gaps["gap with (5) by its label, θ12 negative"] < 1e-12


def test_numbers_of_the_shaft_and_the_shank(verdicts):
    columns = {f.name: f.value for f in verdicts["(26)"].figures}
    assert [columns[f"true α̇ column, {x}"] for x in "xyz"] == pytest.approx([0.548, -0.653, 0.0], abs=5e-4)
    assert [columns[f"true β̇ column, {x}"] for x in "xyz"] == pytest.approx([-0.653, 0.778, 0.0], abs=5e-4)
    assert figure(verdicts["(37)"], "least φ/γ") == pytest.approx(-2.0, abs=1e-9)
    assert figure(verdicts["(37)"], "greatest φ/γ") == pytest.approx(-2.0, abs=1e-9)
    # By Table 1 the lower link would turn with 2 γ' instead of -γ'.
    assert figure(verdicts["(37)"], "with φ = γ of Table 1") == pytest.approx(3.0, abs=1e-9)
    for item, size in (("(36)", 0.5 * 0.095), ("(41)", math.sqrt(2.0)), ("(43)", 0.5 * 0.095)):
        assert 0.5 * size < figure(verdicts[item], "with r_γ = [0 0 1] of (29)") < 2.0 * size
    # One U joint turns between cos and 1 / cos of its bend.
    spin = [figure(verdicts["(29)"], f"{which} spin for a unit γ̇") for which in ("least", "greatest")]
    bend = math.acos(1.0 / math.sqrt(1.0 + 2.0 * math.tan(math.radians(65.0)) ** 2))
    assert math.cos(bend) < spin[0] < 0.5
    assert 2.0 < spin[1] < 1.0 / math.cos(bend)
    assert figure(verdicts["(16)"], "kinetic energy changed by the sign") < 1e-18
    # 1 mm beside the axis, turned by at most half a turn.
    assert 1e-3 < figure(verdicts["(31)"], "error with a centre of mass 1 mm off the axis") < 2e-3
    at_40 = {f.name: f.value for f in verdicts["(40)"].figures}
    # Centre of the lower link at L4 (sin, cos) + L4/2 (-sin, cos), differentiated by hand; then each wrong reading.
    s, c = 0.095 * math.sin(math.radians(40.0)), 0.095 * math.cos(math.radians(40.0))
    for name, y, z in (
        ("true", -0.5 * c, -1.5 * s),
        ("(38) in both columns", 1.5 * c, 0.5 * s),
        ("(39) in both columns", 0.5 * c, -0.5 * s),
    ):
        found = [at_40[f"{name}, {axis} at γ = 40 deg"] for axis in "xyz"]
        assert found == pytest.approx([0.0, y, z], abs=1e-10)
    # A link that stays vertical instead of turning by gamma: a chord.
    assert figure(verdicts["(39)"], "E1 off at γ = 40 deg") == pytest.approx(
        0.19 * math.sin(math.radians(20.0)), abs=1e-12
    )
    assert figure(verdicts["(38)"], "printed form, worst difference") == pytest.approx(0.095, abs=1e-12)


def test_numbers_of_the_dynamics(verdicts):
    true, flipped = (figure(verdicts["(44)"], f"gravity torque on α, {kind}") for kind in ("true", "printed"))
    assert true == pytest.approx(-flipped, abs=1e-9)
    assert abs(true) == pytest.approx(0.84, abs=0.005)
    assert figure(verdicts["(49)"], "printed form, worst difference") == pytest.approx(40.0, rel=1e-9)
    assert figure(verdicts["(50)"], "peak torque on β") == pytest.approx(2.28, abs=0.005)
    assert figure(verdicts["(50)"], "peak torque on β, printed sign") == pytest.approx(0.823, abs=0.001)
    assert figure(verdicts["(47)"], "straight states without an inverse") == 10
    lever = 0.19 * math.sin(math.radians(1.0))
    assert figure(verdicts["(47)"], "force error of 1 mN·m at γ = 1 deg") == pytest.approx(1e-3 / lever, rel=1e-9)
    slow, fast = (
        figure(verdicts["(44)"], f"torque error of constant tensors{more}") for more in ("", ", ten times as fast")
    )
    assert slow == pytest.approx(0.0733, abs=5e-4)  # mN·m
    assert fast == pytest.approx(100.0 * slow, rel=1e-6)
    assert figure(verdicts["(48)"], "force asked for at γ = 1e-12 rad") > 1e5


def test_numbers_of_the_motions_and_tables(verdicts):
    assert figure(verdicts["(51)"], "z0, lowest") == pytest.approx(0.3391, abs=1e-4)
    assert figure(verdicts["(51)"], "z0, highest") == pytest.approx(0.4618, abs=1e-4)
    assert figure(verdicts["(51)"], "jump of the jerk of X") == pytest.approx(0.768, abs=1e-9)
    assert figure(verdicts["(51)"], "span of the acceleration of Z") == pytest.approx(0.0864, abs=1e-12)
    assert figure(verdicts["(53)"], "peak speed along Y") == pytest.approx(0.1875, abs=1e-12)
    assert figure(verdicts["(53)"], "peak speed along Z") == pytest.approx(0.05 * 192.0 / (25.0 * math.sqrt(5.0)))
    assert figure(verdicts["(53)"], "speed and acceleration at lift-off and touch-down") < 1e-11
    assert [figure(verdicts["Table 1"], f"hinges {letter}_i") for letter in "CDE"] == [3, 3, 3]
    span = 0.15 * (1.0 - 1.0 / math.sqrt(1.0 + 2.0 / 3.0)) + 0.19 * (1.0 - math.cos(math.radians(25.0)))
    assert figure(verdicts["(52)"], "span of the foot, z") == pytest.approx(span, abs=1e-9)
    assert figure(verdicts["Table 2"], "α that (51) needs") == pytest.approx(
        -math.degrees(math.asin(0.1 / 0.15)), abs=1e-9
    )
    assert figure(verdicts["Table 2"], "least L2") == pytest.approx(0.19 * math.cos(math.radians(85.0)), abs=1e-12)


# ---------------------------------------------------------------------- verdicts change with the numbers


def components(function):
    """A printed function of arrays in the closed form's convention of component tuples."""
    return lambda leg, q: tuple(np.moveaxis(function(leg, np.stack(np.broadcast_arrays(*q), axis=-1)), -1, 0))


def flipped_passive_angles(q):
    return tuple(np.moveaxis(printed.passive_angles(np.stack(np.broadcast_arrays(*q), axis=-1)), -1, 0))


def printed_inverse_kinematics(leg, p, branch="gamma_positive"):
    from leg_dynamics.closed_form.omnileg import InverseKinematics

    alpha, beta, _ = printed.inverse_kinematics(leg, np.stack(p, axis=-1)).T
    # The bracket of gamma mended, so that the shank stays on this side of its singularity.
    gamma = np.arccos(np.clip((p[2] - leg.L5 - np.sqrt(leg.L1**2 - p[0] ** 2 - p[1] ** 2)) / (2.0 * leg.L4), -1.0, 1.0))
    return InverseKinematics((alpha, beta, gamma), 0.0, 0.0, 0.0)


def printed_foot_force_torque(leg, q, force):
    J = printed.foot_jacobian(leg, np.stack(q, axis=-1))
    return tuple(printed.torque_with_external(J, np.stack(np.broadcast_arrays(*force), axis=-1)).T)


@pytest.mark.parametrize(
    ("number", "name", "replacement"),
    [
        (9, "knee_position", components(printed.knee_position)),
        (12, "passive_angles", flipped_passive_angles),
        (13, "inverse_kinematics", printed_inverse_kinematics),
        (50, "foot_force_torque", printed_foot_force_torque),
        (49, "foot_force_torque", printed_foot_force_torque),
        (44, "gravity_torque", lambda leg, q, g: (0.0 * q[0], 0.0 * q[0], 0.0 * q[0])),
    ],
)
def test_the_printed_form_in_the_closed_form_room_is_noticed(monkeypatch, number, name, replacement):
    context = fresh()
    judged = getattr(equations, f"equation_{number}")
    assert judged(context).status is Status.CORRECTED
    monkeypatch.setattr(context.formulas, name, replacement)
    assert judged(context).status is Status.NOT_REPRODUCIBLE


def reversed_cross_B1(function):
    def motions(leg, q, v):
        found = function(leg, q, v)
        motion = found["cross_B1"]
        columns = tuple(tuple(-x for x in column) for column in motion.turning.columns)
        return found | {"cross_B1": motion._replace(turning=motion.turning._replace(columns=columns))}

    return motions


def test_a_flipped_angular_velocity_is_noticed(monkeypatch):
    context = fresh()
    monkeypatch.setattr(context.formulas, "branch_motions", reversed_cross_B1(context.formulas.branch_motions))
    assert equations.equation_16(context).status is Status.NOT_REPRODUCIBLE
    assert equations.equation_15(context).status is Status.CONFIRMED


@pytest.mark.parametrize(
    ("number", "name", "right"),
    [
        (
            9,
            "knee_position",
            lambda leg, q: printed.foot_position(leg, q) - [0, 0, 0.16] - np.cos(q[:, 2:]) * [0, 0, 0.19],
        ),
        (16, "omega_cross_B1", printed.omega_cross_A1),
        (34, "omega_C1D1", lambda q, r=printed.X: printed.columns(q, gamma=printed.X)),
        (49, "force_with_external", lambda F, F_f: F - F_f),
    ],
)
def test_a_right_printed_form_would_be_confirmed(monkeypatch, number, name, right):
    context = fresh()
    monkeypatch.setattr(printed, name, right)
    assert getattr(equations, f"equation_{number}")(context).status is Status.CONFIRMED


@pytest.mark.parametrize(
    ("number", "name", "wrong"),
    [
        (1, "axes_of_branch_1", lambda: np.array([printed.Y, printed.X, printed.X, printed.X])),
        (10, "leg_length_change", lambda leg, q: 2.0 * leg.L4 - leg.L4 * np.cos(q[..., 2])),
        (11, "foot_position", lambda leg, q: 1.01 * np.stack([q[..., 0], q[..., 1], q[..., 2]], axis=-1)),
        (15, "omega_cross_A1", printed.omega_cross_B1),
        (20, "rod_velocity_from_A1", lambda q, c: printed.columns(q)),
        (51, "path_51", lambda t, T: 0.01 * printed.stack(t, t, t)),
        (16, "omega_cross_B1", lambda q: printed.columns(q, beta=printed.X)),
    ],
)
def test_a_wrong_printed_form_would_not_be_confirmed(monkeypatch, number, name, wrong):
    context = fresh()
    monkeypatch.setattr(printed, name, wrong)
    assert getattr(equations, f"equation_{number}")(context).status is Status.NOT_REPRODUCIBLE


def nothing_like(function):
    """The same shapes, all zero."""
    return lambda *arguments, **options: 0.0 * function(*arguments, **options)


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (5, "branch_rotation_by_label"),
        (9, "knee_position"),
        (12, "passive_angles"),
        (13, "inverse_kinematics"),
        (16, "omega_cross_B1"),
        (26, "omega_cross_A4"),
        (27, "omega_cross_B4"),
        (27, "omega_cross_B4_as_sum"),
        (29, "omega_shaft"),
        (34, "omega_C1D1"),
        (37, "omega_D1E1"),
        (38, "D1E1_centre"),
        (39, "D1E1_lever"),
        (40, "D1E1_velocity"),
        (44, "potential_energy"),
        (45, "lagrange"),
        (46, "equation_of_motion"),
        (47, "foot_output_force"),
        (48, "foot_output_force"),
        (49, "force_with_external"),
        (50, "torque_with_external"),
    ],
)
def test_a_printed_form_that_is_merely_wrong_is_not_corrected(monkeypatch, number, name):
    """The verdict knows what is wrong with the printed form, so any other wrong form is not it."""
    context = fresh()
    monkeypatch.setattr(printed, name, nothing_like(getattr(printed, name)))
    assert getattr(equations, f"equation_{number}")(context).status is Status.NOT_REPRODUCIBLE


@pytest.mark.parametrize("number", [34, 36, 37, 41, 42, 43, 40, 39, 38, 35])
def test_each_of_the_three_chains_counts(number):
    context = fresh()
    judged = getattr(equations, f"equation_{number}")
    before = judged(context).status
    assert before in (Status.CONFIRMED, Status.CORRECTED)
    for chain in range(3):
        tampered = fresh()
        chains = equations._chains(tampered)
        turn = printed.rot(printed.Z, 0.1)
        chains[chain].rotation = chains[chain].rotation @ turn
        chains[chain].C = chains[chain].C + 1e-3
        chains[chain].D = chains[chain].D + 1e-3
        assert judged(tampered).status is Status.NOT_REPRODUCIBLE, chain


@pytest.mark.parametrize(
    ("number", "name", "size"),
    [(10, "leg_length_change", 1e-7), (20, "rod_velocity_from_A1", 1e-6), (11, "foot_position", 1e-8)],
)
def test_small_errors_of_kinematics_are_noticed(monkeypatch, number, name, size):
    context, right = fresh(), getattr(printed, name)
    monkeypatch.setattr(printed, name, lambda *arguments: (1.0 + size) * right(*arguments))
    assert getattr(equations, f"equation_{number}")(context).status is not Status.CONFIRMED


def test_small_errors_of_forces_are_noticed(monkeypatch):
    context = fresh()
    for size, status in ((0.0, Status.CONFIRMED), (1e-5, Status.NOT_REPRODUCIBLE)):
        monkeypatch.setattr(printed, "equation_of_motion", lambda M_a, V, G, L, size=size: M_a + V + (1.0 + size) * G)
        assert equations.equation_46(context).status is status


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("TABLE_2", "L3", 0.085),
        ("TABLE_2", "L5", 0.161),
        ("L2_RANGE", None, (0.027, 0.19)),
        ("RANGES", None, ((0.0, 65.0), (0.0, 60.0), (0.0, 85.0))),
    ],
)
def test_a_misprinted_table_2_is_noticed(monkeypatch, table, key, value):
    if key is None:
        monkeypatch.setattr(printed, table, value)
    else:
        monkeypatch.setitem(getattr(printed, table), key, value)
    assert equations.table_2(fresh()).status is Status.NOT_REPRODUCIBLE


def stretched(name, factors):
    right = getattr(printed, name)
    return lambda t, *arguments, **options: right(t, *arguments, **options) * np.array(factors)


@pytest.mark.parametrize(
    ("number", "name", "factors"),
    [
        (51, "path_51", (1.0, 1.1, 1.0)),
        (51, "path_51", (1.0, 1.0, 1.1)),
        (51, "path_51", (1.1, 1.0, 1.0)),
        (52, "motion_52", (1.0, 0.99, 1.0)),
        (52, "motion_52", (1.0, 1.0, 1.8)),
        (53, "path_53", (1.0, 1.1, 1.0)),
        (53, "path_53", (1.0, 1.0, 0.9)),
    ],
)
def test_a_motion_is_held_against_facts_and_not_against_a_copy(monkeypatch, number, name, factors):
    monkeypatch.setattr(printed, name, stretched(name, factors))
    assert getattr(equations, f"equation_{number}")(fresh()).status is not Status.CONFIRMED


def test_a_motion_with_another_clock_is_noticed(monkeypatch):
    right = printed.motion_52
    monkeypatch.setattr(printed, "motion_52", lambda t, *more: right(1.01 * t, *more))
    assert equations.equation_52(fresh()).status is not Status.CONFIRMED


# ---------------------------------------------------------------------- what verdicts stand on


def test_printed_exponential_is_the_matrix_exponential():
    from scipy.linalg import expm

    omega, point = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.075, 0.15])
    v = np.cross(point, omega)
    S = np.zeros((4, 4))
    S[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    S[:3, 3] = v
    assert printed.exponential(omega, point, np.array(0.7)) == pytest.approx(expm(0.7 * S), abs=1e-14)


def test_complex_step_derivative():
    q = np.array([0.3, -0.4, 0.5])
    found = printed.derivative(lambda q: np.stack([np.sin(q[..., 0]) * q[..., 1], q[..., 2] ** 2], axis=-1), q)
    assert found == pytest.approx(np.array([[-0.4 * math.cos(0.3), math.sin(0.3), 0.0], [0.0, 0.0, 1.0]]), abs=1e-15)


def test_foot_output_force_with_and_without_an_inverse():
    J = np.stack([np.diag([1.0, 2.0, 4.0]), np.diag([1.0, 1.0, 0.0])])
    F = printed.foot_output_force(J, np.ones((2, 3)))
    assert F[0] == pytest.approx([1.0, 0.5, 0.25])
    assert np.isnan(F[1]).all()


def test_lagrange_torque_of_a_known_mass_matrix():
    def mass_matrix(q):
        M = np.zeros((*q.shape[:-1], 3, 3))
        M[..., 0, 0], M[..., 1, 1], M[..., 2, 2] = 1.0 + q[..., 1] ** 2, 2.0, 3.0
        return M

    q, v, a = np.array([[0.2, 0.5, 0.1]]), np.array([[1.5, -0.7, 0.3]]), np.array([[0.4, 0.6, -0.2]])
    torque = facts.lagrange_torque(mass_matrix, q, v, a)[0]
    expected = [1.25 * 0.4 + 2.0 * 0.5 * -0.7 * 1.5, 2.0 * 0.6 - 0.5 * 1.5**2, 3.0 * -0.2]
    assert torque == pytest.approx(expected, abs=1e-9)


def test_mass_matrix_from_bodies_and_literal_tensors():
    context = fresh()
    q = context.q[:5]
    exact = facts.mass_matrix_of(context, q)
    assert exact == pytest.approx(context.pinocchio.mass_matrix(q), abs=1e-13)
    assert np.abs(facts.mass_matrix_of(context, q, constant_tensors=True) - exact).max() > 1e-7
    straight = np.zeros((1, 3))
    literal = facts.mass_matrix_of(context, straight, constant_tensors=True)
    assert literal == pytest.approx(facts.mass_matrix_of(context, straight), abs=1e-16)


def test_assembled_poses_and_rates():
    context = fresh()
    mechanism = facts.Assembled(context.pinocchio, np.array([[0.0, 0.0, 0.6]]))
    assert mechanism.position("foot")[0] == pytest.approx([0.0, 0.0, 0.31 + 0.19 * math.cos(0.6)], abs=1e-12)
    assert mechanism.velocity("foot")[0] == pytest.approx(
        np.array([[0.0, 0.15, 0.0], [-0.15, 0.0, 0.0], [0.0, 0.0, -0.19 * math.sin(0.6)]]), abs=1e-10
    )
    assert mechanism.omega("input_shaft")[0] == pytest.approx(np.diag([0.0, 0.0, 1.0]), abs=1e-10)
    assert mechanism.omega("hip")[0] == pytest.approx(np.zeros((3, 3)), abs=1e-12)
    assert mechanism.point("loop_B2", np.zeros(3)) == pytest.approx([0.075, 0.0, 0.15], abs=1e-12)
    assert mechanism.axis("loop_B2") == pytest.approx(np.array([[1.0, 0.0, 0.0]]), abs=1e-12)
