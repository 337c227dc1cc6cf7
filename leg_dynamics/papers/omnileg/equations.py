"""Equations (1)-(53) and Tables 1-2 of Xu et al. 2025, each judged by numbers.

Every formula is held against `facts` that share nothing with it: the mechanism of the URDF+ file assembled numerically,
and the numeric route's dynamics. An equation is confirmed if its printed form (`printed`) agrees. It is corrected if
the form of `closed_form.omnileg` agrees instead and the printed form's defect is known: with the one repair that the
verdict names, it agrees too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from leg_dynamics.papers.comparison import compare, flat
from leg_dynamics.papers.framework import Context, Figure, Verdict
from leg_dynamics.papers.judge import text, worst
from leg_dynamics.papers.omnileg import printed, reported
from leg_dynamics.papers.omnileg.facts import (
    FEW,
    FORCE_TOLERANCE,
    POSITION_TOLERANCE,
    RATE_TOLERANCE,
    TEST_POSE,
    Assembled,
    array,
    assembled,
    body_of,
    centre_of,
    com,
    formula,
    lagrange_torque,
    mass_matrix_of,
    motions,
    omega_of,
    states,
)
from leg_dynamics.verification.first_principles import gradient, slope

__all__ = ["VERDICTS"]

Array = np.ndarray


# ---------------------------------------------------------------------- verdicts


def _box(context: Context, what: str) -> str:
    return f"{what}, {len(states(context))} states of the box of joint limits"


def _angles(facts: Assembled) -> tuple[Array, Array, Array]:
    """Angles of the three branches in the assembled mechanism; what the loops close follows from the knee at rest."""
    alpha, beta, _ = facts.q.T
    c = facts.coordinates
    one = np.stack([beta, c["theta12"], c["theta13"], c["theta14"]], axis=-1)
    two = np.stack([alpha, c["theta22"], c["theta23"], -alpha], axis=-1)
    three = np.stack([c["theta31"], c["theta32"], c["theta33"], -c["theta31"]], axis=-1)
    return one, two, three


JOINTS = (
    ("beta", "theta12", "theta13", "theta14"),
    ("alpha", "theta22", "theta23", "loop_B2"),
    ("theta31", "theta32", "theta33", "loop_B3"),
)
"""Joints of the three branches in the file."""


def _knee_by_branch(context: Context, k: int, axes: Array | None = None, points: Array | None = None) -> Array:
    """Difference of the knee at the end of branch k to the assembled one, largest entry of the pose, (N,)."""
    facts = assembled(context)
    axes = printed.axes_of_branch(k) if axes is None else axes
    points = printed.points_of_branch(context.numbers, k) if points is None else points
    pose = printed.branch_pose(context.numbers, axes, points, _angles(facts)[k - 1])
    return np.abs(pose - facts.links["knee"]).max(axis=(-2, -1))


def _axes_in_file(context: Context, k: int) -> Array:
    """Axes of branch k in the straight leg of the file, (4, 3); a cut joint's axis has the first joint's sign."""
    axes = np.stack([assembled(context).axis(joint, np.zeros(3)) for joint in JOINTS[k - 1]])
    axes[3] *= np.sign(axes[3] @ axes[0])
    return axes


def _line_distance(context: Context, k: int, points: Array) -> Array:
    """Distances of points from the axes of branch k in the straight leg, m."""
    axes = _axes_in_file(context, k)
    there = np.stack([assembled(context).point(joint, np.zeros(3)) for joint in JOINTS[k - 1]])
    return np.linalg.norm(np.cross(points - there, axes), axis=-1)


def equation_1(context: Context) -> Verdict:
    """Axes of branch 1."""
    axes = printed.axes_of_branch_1()
    own = np.stack([array(context.formulas.joint_axis(1, i), ()) for i in (1, 2, 3, 4)])
    moved = _knee_by_branch(context, 1, axes=axes)
    return compare(
        "(1)",
        "Joint axes of thigh branch 1",
        _box(context, "axes against the file, and the knee at the end of branch 1 against the assembled mechanism"),
        "",
        [worst(axes - _axes_in_file(context, 1)), worst(moved)],
        [worst(own - _axes_in_file(context, 1)), worst(_knee_by_branch(context, 1, axes=own))],
        forms=("ω₁₁ = ω₁₄ = [0 1 0], ω₁₂ = ω₁₃ = [1 0 0]", ""),
    )


def equation_2(context: Context) -> Verdict:
    """Points of branch 1."""
    leg = context.numbers
    points = printed.points_of_branch_1(leg)
    own = np.stack([array(context.formulas.joint_point(leg, 1, i), ()) for i in (1, 2, 3, 4)])
    return compare(
        "(2)",
        "Points on the axes of branch 1",
        _box(context, "distance from the file's axes, and the knee at the end of branch 1"),
        "m",
        [worst(_line_distance(context, 1, points)), worst(_knee_by_branch(context, 1, points=points))],
        [worst(_line_distance(context, 1, own)), worst(_knee_by_branch(context, 1, points=own))],
        forms=("q₁₁ = q₁₂ = [0 L3 0], q₁₃ = q₁₄ = [0 L3 L1]", ""),
    )


def equation_3(context: Context) -> Verdict:
    """Zero pose of the knee."""
    M = printed.zero_pose(context.numbers)
    own = context.formulas.zero_pose(context.numbers)
    corrected = np.eye(4)
    corrected[:3] = np.column_stack([array(own.rotation, ()), array(own.position, ())])
    straight = assembled(context)._links(np.zeros(3))["knee"]
    return compare(
        "(3)",
        "Pose of the knee in the straight leg",
        _box(context, "pose against the straight leg of the file, and the knee at the end of branch 1"),
        "m",
        [worst(M - straight), worst(_knee_by_branch(context, 1))],
        [worst(corrected - straight)],
        forms=("M = [I₃ P; 0 1], P = [0 0 L1]", ""),
    )


def equation_4(context: Context) -> Verdict:
    """Product of exponentials."""
    facts = assembled(context)
    differences = [worst(_knee_by_branch(context, k)) for k in (1, 2, 3)]
    own = []
    for k, angles in enumerate(_angles(facts), 1):
        pose = context.formulas.branch_pose(context.numbers, k, tuple(angles.T))
        shape = facts.q.shape[:-1]
        own += [worst(array(pose.rotation, shape) - facts.rotation("knee"))]
        own += [worst(array(pose.position, shape) - facts.position("knee"))]
    return compare(
        "(4)",
        "Knee pose as a product of exponentials",
        _box(context, "knee pose at the end of each branch, from the assembled mechanism's joint angles"),
        "m",
        differences,
        own,
        note="The printed e^θ̂ is read as e^(ω̂θ), as the Rodrigues formula beside it says.",
        forms=("T₁ = Π exp(Ŝᵢθ₁ᵢ) M", ""),
    )


def _rod_by_branch_2(context: Context, rotation: Callable[[int], Array], theta22: Array) -> Array:
    """Knee at the end of branch 2 from alpha and theta22, (N, 3)."""
    alpha = states(context)[:, 0]
    angles = np.stack([alpha, theta22, -theta22, -alpha], axis=-1)
    leg = context.numbers
    axes, points = printed.axes_of_branch(2, rotation), printed.points_of_branch(leg, 2, rotation)
    return printed.branch_pose(leg, axes, points, angles)[..., :3, 3]


def equation_5(context: Context) -> Verdict:
    """Rotation to branch k."""
    facts = assembled(context)
    knee = facts.position("knee")
    _, theta22 = printed.passive_angles(facts.q).T
    by_label = _rod_by_branch_2(context, printed.branch_rotation_by_label, theta22)
    by_matrix = _rod_by_branch_2(context, printed.branch_rotation, facts.angle("theta22"))
    own = [array(context.formulas.branch_rotation(k), ()) for k in (1, 2, 3)]
    axis = facts.axis("alpha", np.zeros(3))
    label_axis, own_axis = printed.branch_rotation_by_label(2) @ printed.Y, own[1] @ printed.Y
    return compare(
        "(5)",
        "Rotation from branch 1 to branch k: the label",
        _box(context, "knee by branch 2 against the assembled mechanism"),
        "m",
        np.linalg.norm(by_label - knee, axis=-1),
        np.linalg.norm(by_matrix - knee, axis=-1),
        alike=(
            worst(label_axis - axis),
            [worst(own_axis - axis), *(worst(o - printed.branch_rotation(k)) for k, o in enumerate(own, 1))],
        ),
        note=f"A true rot(Z0, δ) puts A2 at −X with its axis along −X: at (30, 20, 40)° P_y = {by_label[0, 1]:+.4f} m "
        f"instead of "
        f"{knee[0, 1]:+.4f} m. The printed matrix is rot(Z0, −δ), which Table 1 and (11) need.",
        forms=("rot(Z0, δ)", "rot(Z0, −δ): the printed matrix"),
        repair=(
            "the label's matrix transposed is the printed one, and leads to the knee and to the axis of A2",
            [
                *(printed.branch_rotation_by_label(k).T - printed.branch_rotation(k) for k in (1, 2, 3)),
                _rod_by_branch_2(context, lambda k: printed.branch_rotation_by_label(k).T, facts.angle("theta22"))
                - knee,
                label_axis + axis,
            ],
        ),
        figures=[
            Figure("P_y by the label", by_label[0, 1], "m", "branch 2 at (30, 20, 40) deg"),
            Figure("P_y of the mechanism", knee[0, 1], "m", "at (30, 20, 40) deg"),
        ],
    )


def equation_6(context: Context) -> Verdict:
    """Axes of all branches."""
    f = context.formulas
    off, own, moved = [], [], []
    for k in (1, 2, 3):
        there = _axes_in_file(context, k)
        off.append(worst(printed.axes_of_branch(k) - there))
        own.append(worst(np.stack([array(f.joint_axis(k, i), ()) for i in (1, 2, 3, 4)]) - there))
        moved.append(worst(_knee_by_branch(context, k)))
    return compare(
        "(6)",
        "Joint axes of branch k",
        _box(context, "axes of all branches against the file, and the knee at the end of each"),
        "",
        [*off, *moved],
        own,
        note="With the matrix of (5), not its label.",
        forms=("ω_ki = ᵏR ω₁ᵢ", ""),
    )


def equation_7(context: Context) -> Verdict:
    """Points of all branches."""
    leg, f = context.numbers, context.formulas
    off, own, moved = [], [], []
    for k in (1, 2, 3):
        off.append(worst(_line_distance(context, k, printed.points_of_branch(leg, k))))
        own.append(
            worst(_line_distance(context, k, np.stack([array(f.joint_point(leg, k, i), ()) for i in (1, 2, 3, 4)])))
        )
        moved.append(worst(_knee_by_branch(context, k)))
    return compare(
        "(7)",
        "Points on the axes of branch k",
        _box(context, "distance from the file's axes, and the knee at the end of each branch"),
        "m",
        [*off, *moved],
        own,
        note="With the matrix of (5), not its label.",
        forms=("q_ki = ᵏR q₁ᵢ", ""),
    )


def equation_8(context: Context) -> Verdict:
    """The three branches meet."""
    facts = assembled(context)
    gap = printed.closure_gap(context.numbers, _angles(facts))
    own = formula(context, "closure_residual", facts.q)
    tilt = np.abs(facts.rotation("knee") - np.eye(3)).max()
    return compare(
        "(8)",
        "The three branches meet in one knee",
        _box(context, "difference of the three knee poses at numerically closed angles"),
        "m",
        gap,
        own,
        note=f"The loops close with a knee that does not rotate: its axes stay within {text(tilt)} of the hip's.",
        forms=("T₁ = T₂ = T₃", ""),
        figures=[Figure("rotation of the knee", tilt, "", _box(context, "largest entry of R − I"))],
    )


def equation_9(context: Context) -> Verdict:
    """Knee position."""
    facts = assembled(context)
    knee = facts.position("knee")
    wrong = printed.knee_position(context.numbers, facts.q)
    return compare(
        "(9)",
        "Knee position: x lacks sin β",
        _box(context, "knee against the assembled mechanism"),
        "m",
        wrong - knee,
        formula(context, "knee_position", facts.q) - knee,
        note=f"At (30, 20, 40)° it gives x = {wrong[0, 0]:.4f} m instead of {knee[0, 0]:.4f} m; (11) has the factor.",
        forms=("P_x = L1 cos(arctan(tan α cos β))", "P_x = L1 sin β cos(arctan(tan α cos β))"),
        repair=(
            "the printed x times sin β is the true one, y and z are right",
            wrong * printed.stack(np.sin(facts.q[:, 1]), 1.0, 1.0) - knee,
        ),
        figures=[
            Figure("x as printed", wrong[0, 0], "m", "at (30, 20, 40) deg"),
            Figure("x of the mechanism", knee[0, 0], "m", "at (30, 20, 40) deg"),
        ],
    )


def equation_10(context: Context) -> Verdict:
    """Shortening of the shank."""
    facts, leg = assembled(context), context.numbers
    shortening = leg.L5 + 2.0 * leg.L4 - (facts.position("foot") - facts.position("knee"))[:, 2]
    own = array(context.formulas.leg_length_change(leg, facts.q[:, 2]), facts.q.shape[:-1])
    return compare(
        "(10)",
        "Shortening of the shank",
        _box(context, "distance of foot and knee in the assembled mechanism"),
        "m",
        printed.leg_length_change(leg, facts.q) - shortening,
        own - shortening,
        note=f"Up to {text(shortening.max())} m at 85°.",
        forms=("ΔL2 = 2 L4 − 2 L4 cos γ", ""),
        figures=[Figure("largest shortening", shortening.max(), "m", _box(context, "foot to knee"))],
    )


def equation_11(context: Context) -> Verdict:
    """Foot position."""
    facts = assembled(context)
    foot = facts.position("foot")
    return compare(
        "(11)",
        "Foot position",
        _box(context, "foot of the assembled mechanism"),
        "m",
        printed.foot_position(context.numbers, facts.q) - foot,
        formula(context, "foot_position", facts.q) - foot,
        note="The text calls it a function of α and β; it depends on γ too.",
        forms=("P_F = [L1 sin β, −L1 cos β tan α, L1 cos β]/√(1 + cos²β tan²α) + [0, 0, 2 L4 cos γ + L5]", ""),
    )


def equation_12(context: Context) -> Verdict:
    """Passive angles of the U joints."""
    facts = assembled(context)
    there = np.stack([facts.angle("theta12"), facts.angle("theta22")], axis=-1)
    wrong = printed.passive_angles(facts.q)
    own = formula(context, "passive_angles", facts.q, leg=False)
    knee = facts.position("knee")
    gap = np.linalg.norm(_rod_by_branch_2(context, printed.branch_rotation, wrong[:, 1]) - knee, axis=-1)
    left = np.linalg.norm(_rod_by_branch_2(context, printed.branch_rotation, own[:, 1]) - knee, axis=-1)
    # The other reading: with a true rot(Z0, delta) branch 2 keeps the plus sign, and branch 1 has to change.
    label = _rod_by_branch_2(context, printed.branch_rotation_by_label, wrong[:, 1])
    other = []
    for sign in (1.0, -1.0):
        beta, theta12 = facts.q[:, 1], sign * wrong[:, 0]
        angles = np.stack([beta, theta12, -theta12, -beta], axis=-1)
        one = printed.branch_pose(
            context.numbers, printed.axes_of_branch(1), printed.points_of_branch(context.numbers, 1), angles
        )
        other.append(worst(np.linalg.norm(one[..., :3, 3] - label, axis=-1)))
    return compare(
        "(12)",
        "Passive angles of A1 and A2: sign of θ22",
        _box(context, "angles of the assembled mechanism"),
        "rad",
        wrong - there,
        own - there,
        note=f"Branch 2 then misses the knee by up to {text(gap.max())} m ({gap[0]:.4f} m at (30, 20, 40)°; corrected "
        f"{text(left.max())} m). "
        f"Reading (5) by its label moves the minus to θ12 (gap {text(other[0])} m with both plus signs, "
        f"{text(other[1])} m with that "
        "minus): both plus signs never hold.",
        forms=("θ22 = arctan(tan β cos α)", "θ22 = −arctan(tan β cos α)"),
        repair=("θ22 has the opposite sign, θ12 is right", wrong * [1.0, -1.0] - there),
        figures=[
            Figure("loop gap as printed", gap.max(), "m", _box(context, "knee by branch 2 to the knee")),
            Figure("loop gap at the test pose", gap[0], "m", "as printed, at (30, 20, 40) deg"),
            Figure("loop gap corrected", left.max(), "m", _box(context, "knee by branch 2 to the knee")),
            Figure("gap with (5) by its label", other[0], "m", _box(context, "branch 1 to branch 2, both signs plus")),
            Figure("gap with (5) by its label, θ12 negative", other[1], "m", _box(context, "branch 1 to branch 2")),
        ],
    )


def equation_13(context: Context) -> Verdict:
    """Inverse kinematics."""
    facts = assembled(context)
    foot, q = facts.position("foot"), facts.q
    wrong = printed.inverse_kinematics(context.numbers, foot)
    own = array(context.formulas.inverse_kinematics(context.numbers, tuple(foot.T)).q, q.shape[:-1])
    real = np.isfinite(wrong).all(axis=-1)
    # By (11), confirmed above: at γ = 90 deg the shank is singular, and no assembly leads beyond.
    reached = printed.foot_position(context.numbers, wrong)
    only_alpha = np.column_stack([wrong[:, 0], q[:, 1:]])
    by_alpha = np.linalg.norm(context.pinocchio.foot_position(only_alpha) - foot, axis=-1)
    miss = np.linalg.norm(reached - foot, axis=-1)
    back = np.full_like(foot, np.nan)
    good = np.isfinite(own).all(axis=-1)
    back[good] = context.pinocchio.foot_position(own[good], on_error="nan")
    gamma = np.degrees(np.abs(wrong[:, 2] - q[:, 2]))
    beta = worst(wrong[:, 1] - q[:, 1])
    # The printed bracket ends before "/(2 L4)", which then divides the root alone.
    leg = context.numbers
    height = np.cos(wrong[:, 2])
    root = np.sqrt(leg.L1**2 - foot[:, 0] ** 2 - foot[:, 1] ** 2)
    bracket = (height + root / (2.0 * leg.L4) - root) / (2.0 * leg.L4) - np.cos(q[:, 2])
    return compare(
        "(13)",
        "Inverse kinematics: sign of α, bracket of γ",
        _box(context, "foot position reached with the found angles"),
        "m",
        miss,
        back - foot,
        note=f"α comes out as {np.degrees(wrong[0, 0]):.1f}° for {np.degrees(q[0, 0]):.0f}° (up to "
        f"{text(by_alpha.max())} m), and the bracket as "
        f"printed makes γ {np.degrees(wrong[0, 2]):.1f}° for {np.degrees(q[0, 2]):.0f}°, median error "
        f"{np.median(gamma):.0f}°; it is real in "
        f"{100.0 * real.mean():.0f} % of the states, so nothing warns. β is right within {text(beta)} rad.",
        forms=(
            "α = arctan(P_y/√(L1² − P_x² − P_y²)), γ = arccos(P_z − L5 − √(…)/(2 L4))",
            "α = −arctan(P_y/√(…)), γ = arccos((P_z − L5 − √(…))/(2 L4))",
        ),
        repair=(
            "α has the opposite sign, β is right, and cos γ is right once 2 L4 divides the whole bracket",
            [wrong[:, 0] + q[:, 0], wrong[:, 1] - q[:, 1], bracket],
        ),
        figures=[
            Figure("foot error from the sign of α alone", by_alpha.max(), "m", _box(context, "foot position")),
            Figure("median error of γ", float(np.median(gamma)), "deg", _box(context, "bracket as printed")),
            Figure("γ as printed", float(np.degrees(wrong[0, 2])), "deg", "at (30, 20, 40) deg"),
            Figure("share of real results", float(real.mean()), "", _box(context, "printed form")),
            Figure("error of β", beta, "rad", _box(context, "printed form")),
        ],
    )


def _rates(
    context: Context,
    item: str,
    title: str,
    unit: str,
    there: Array,
    wrong: Array,
    own: Array,
    what: str,
    **options: Any,
) -> Verdict:
    """Verdict on influence coefficients."""
    of = _box(context, f"{what}, for unit rates, against differences of assembled poses")
    options.setdefault("tolerance", RATE_TOLERANCE)
    return compare(item, title, of, unit, wrong - there, own - there, **options)


def equation_14(context: Context) -> Verdict:
    """Jacobian of the foot."""
    facts = assembled(context)
    there = facts.velocity("foot")
    spin = worst(facts.omega("foot"))
    return _rates(
        context,
        "(14)",
        "Jacobian of the foot",
        "m/rad",
        there,
        printed.foot_jacobian(context.numbers, facts.q),
        formula(context, "foot_jacobian", facts.q),
        "foot velocity",
        note=f"The foot's angular velocity is {text(spin)} for unit rates: zero, as the text says.",
        forms=("v_F = J [α̇ β̇ γ̇]", ""),
        figures=[Figure("angular velocity of the foot", spin, "", _box(context, "for unit rates"))],
    )


def equation_15(context: Context) -> Verdict:
    """Cross A1."""
    facts = assembled(context)
    own = motions(context, "branch_motions", facts.q)["cross_A1"]
    return _rates(
        context,
        "(15)",
        "Angular velocity of the cross A1",
        "",
        facts.omega("cross_A1"),
        printed.omega_cross_A1(facts.q),
        omega_of(own, facts.q),
        "cross A1",
        forms=("ω = [0 β̇ 0]", ""),
    )


def equation_16(context: Context) -> Verdict:
    """Cross B1."""
    facts = assembled(context)
    own = motions(context, "branch_motions", facts.q)["cross_B1"]
    wrong = printed.omega_cross_B1(facts.q)
    relative = worst(gradient(lambda q: context.pinocchio.assemble(q)["theta14"], facts.q[:FEW]) + printed.Y)
    tensor = np.array(body_of(context, "cross_B1").inertia, dtype=float)
    energy = [0.5 * np.einsum("nik,ij,njk->nk", w, tensor, w) for w in (wrong, omega_of(own, facts.q))]
    same = worst(energy[0] - energy[1])
    return _rates(
        context,
        "(16)",
        "Angular velocity of the cross B1: sign",
        "",
        facts.omega("cross_B1"),
        wrong,
        omega_of(own, facts.q),
        "cross B1",
        note=f"−β̇ is θ̇14, the knee relative to the cross (to {text(relative)}). The kinetic energy is unchanged "
        f"(difference {text(same)} J), "
        "and (27) assumes +β̇.",
        forms=("ω = [0 −β̇ 0]", "ω = [0 β̇ 0]"),
        repair=("it is the true vector with the opposite sign", wrong + facts.omega("cross_B1")),
        figures=[Figure("kinetic energy changed by the sign", same, "J", _box(context, "cross B1 at unit rates"))],
    )


def equation_17(context: Context) -> Verdict:
    """Rod."""
    facts = assembled(context)
    own = motions(context, "branch_motions", facts.q)["rod_A1B1"]
    return _rates(
        context,
        "(17)",
        "Angular velocity of the rod A1B1",
        "",
        facts.omega("rod_A1B1"),
        printed.omega_rod(facts.q),
        omega_of(own, facts.q),
        "rod A1B1",
        forms=("ω = r₁₁ θ̇11 + r₁₂ θ̇12", ""),
    )


def equation_18(context: Context) -> Verdict:
    """Axes of A1."""
    facts = assembled(context)
    r_11, r_12 = printed.directions_of_A1(facts.q)
    there = np.stack([facts.axis("beta"), facts.axis("theta12")])
    rotation = array(motions(context, "branch_motions", facts.q)["cross_A1"].turning.rotation, facts.q.shape[:-1])
    own = np.stack([rotation @ printed.Y, rotation @ printed.X])
    return compare(
        "(18)",
        "Directions of the axes of A1",
        _box(context, "axes of the assembled mechanism"),
        "",
        np.stack([r_11, r_12]) - there,
        own - there,
        forms=("r₁₁ = rot(Y, θ11)[0 1 0], r₁₂ = rot(Y, θ11) rot(X, θ12)[1 0 0]", ""),
    )


def _rod(context: Context) -> tuple[Assembled, Array, Array, Array]:
    """Facts, the rod's centre of mass, and its position and velocity by the formulas."""
    facts = assembled(context)
    motion = motions(context, "branch_motions", facts.q)["rod_A1B1"]
    return facts, com(context, "rod_A1B1"), *centre_of(context, motion, "rod_A1B1", facts.q)


def equation_19(context: Context) -> Verdict:
    """Centre of the rod from A1."""
    facts, centre, position, _ = _rod(context)
    A1 = np.array([0.0, context.numbers.L3, 0.0])
    there = facts.position("rod_A1B1", centre) - A1
    return compare(
        "(19)",
        "Centre of mass of the rod from A1",
        _box(context, "rod of the assembled mechanism"),
        "m",
        printed.rod_centre_from_A1(facts.q, centre) - there,
        position - A1 - there,
        forms=("P = rot(Y, θ11) rot(X, θ12) P_ic", ""),
    )


def equation_20(context: Context) -> Verdict:
    """Velocity of the rod's centre."""
    facts, centre, _, velocity = _rod(context)
    return _rates(
        context,
        "(20)",
        "Velocity of the rod's centre of mass from A1",
        "m/rad",
        facts.velocity("rod_A1B1", centre),
        printed.rod_velocity_from_A1(facts.q, centre),
        velocity,
        "rod A1B1",
        forms=("v = ω × P", ""),
    )


def equation_21(context: Context) -> Verdict:
    """Angular velocity of the rod in O0."""
    facts = assembled(context)
    own = motions(context, "branch_motions", facts.q)["rod_A1B1"]
    return _rates(
        context,
        "(21)",
        "Angular velocity of the rod in O0",
        "",
        facts.omega("rod_A1B1"),
        printed.omega_rod(facts.q),
        omega_of(own, facts.q),
        "rod A1B1",
        note="The frames at A1 and O0 are parallel at every pose, being fixed in the hip.",
        forms=("the same as from A1", ""),
    )


def equation_22(context: Context) -> Verdict:
    """Centre of the rod from O0."""
    facts, centre, position, _ = _rod(context)
    there = facts.position("rod_A1B1", centre)
    return compare(
        "(22)",
        "Centre of mass of the rod from O0",
        _box(context, "rod of the assembled mechanism"),
        "m",
        printed.rod_centre(context.numbers, facts.q, centre) - there,
        position - there,
        forms=("P + [0 L3 0]", ""),
    )


def equation_23(context: Context) -> Verdict:
    """Velocity of the rod's centre in O0."""
    facts, centre, _, velocity = _rod(context)
    return _rates(
        context,
        "(23)",
        "Velocity of the rod's centre of mass in O0",
        "m/rad",
        facts.velocity("rod_A1B1", centre),
        printed.rod_velocity_from_A1(facts.q, centre),
        velocity,
        "rod A1B1",
        forms=("the same as from A1", ""),
    )


def equation_24(context: Context) -> Verdict:
    """Input shaft."""
    facts = assembled(context)
    own = motions(context, "transmission_motions", facts.q)["input_shaft"]
    output = worst(facts.omega("output_shaft") - facts.omega("input_shaft"))
    driven = facts.omega("driven_gear_1")
    different = worst(driven - facts.omega("input_shaft"))
    speed = worst(np.linalg.norm(driven[..., 2], axis=-1) - 1.0)
    return _rates(
        context,
        "(24)",
        "Angular velocity of the input shaft",
        "",
        facts.omega("input_shaft"),
        printed.omega_input_shaft(facts.q),
        omega_of(own, facts.q),
        "input shaft",
        note=f"The output shaft turns with it (to {text(output)}). The text gives the bevel gears the same angular "
        f"velocity: the driven ones have "
        f"its magnitude (to {text(speed)}) about X_Ci, a vector different by {text(different)}.",
        forms=("ω = [0 0 γ̇]", ""),
        figures=[
            Figure("output shaft minus input shaft", output, "", _box(context, "angular velocity for unit rates")),
            Figure("driven gear minus input shaft", different, "", _box(context, "angular velocity for unit rates")),
        ],
    )


def equation_25(context: Context) -> Verdict:
    """Velocity of the input shaft."""
    facts = assembled(context)
    motion = motions(context, "transmission_motions", facts.q)["input_shaft"]
    _, own = centre_of(context, motion, "input_shaft", facts.q)
    return _rates(
        context,
        "(25)",
        "Velocity of the input shaft",
        "m/rad",
        facts.velocity("input_shaft", com(context, "input_shaft")),
        printed.velocity_input_shaft(facts.q),
        own,
        "input shaft's centre of mass",
        forms=("v = 0", ""),
    )


def _column_figures(context: Context, there: Array) -> list[Figure]:
    """The true columns of a cross at the pose of the audit, (30, 30, 40) deg."""
    return [
        Figure(f"true {name} column, {axis}", there[row, k], "", "at (30, 30, 40) deg, for a unit rate")
        for k, name in enumerate(("α̇", "β̇"))
        for row, axis in enumerate("xyz")
    ]


def _straight_columns(context: Context, link: str) -> Array:
    """True angular velocity of a link in the straight leg, for unit rates, (3, 3)."""
    straight = context.once("equations: straight", lambda: Assembled(context.pinocchio, np.zeros((1, 3))))
    return straight.omega(link)[0]


def _cross_at_bend(context: Context) -> Array:
    q = np.radians([[30.0, 30.0, 40.0]])
    return context.once("equations: bend", lambda: Assembled(context.pinocchio, q)).omega("cross_A4")[0]


def _vector(value: Array) -> str:
    # Adding zero turns -0 into 0.
    return "[" + ", ".join(f"{x:.3f}" for x in np.round(value, 3) + 0.0) + "]"


def equation_26(context: Context) -> Verdict:
    """Cross A4."""
    facts = assembled(context)
    own = motions(context, "transmission_motions", facts.q)["cross_A4"]
    bend = _cross_at_bend(context)
    return _rates(
        context,
        "(26)",
        "Angular velocity of the cross A4",
        "",
        facts.omega("cross_A4"),
        printed.omega_cross_A4(facts.q),
        omega_of(own, facts.q),
        "cross A4",
        note=f"At (30, 30, 40)° a unit α̇ turns it with {_vector(bend[:, 0])} (printed 0) and a unit β̇ with "
        f"{_vector(bend[:, 1])} (printed "
        "[0, 1, 0]): kinematically no small neglect.",
        forms=("ω = [0 β̇ γ̇]", "ω = γ̇ Z0 + ȧ Rz(γ) Y, with a(α, β, γ) of the U joint A4"),
        repair=(
            "what is printed is the true motion of the straight leg, α = β = γ = 0, kept at every pose",
            printed.omega_cross_A4(facts.q) - _straight_columns(context, "cross_A4"),
        ),
        figures=_column_figures(context, bend),
    )


def equation_27(context: Context) -> Verdict:
    """Cross B4."""
    facts = assembled(context)
    own = motions(context, "transmission_motions", facts.q)["cross_B4"]
    wrong, as_sum = printed.omega_cross_B4(facts.q), printed.omega_cross_B4_as_sum(facts.q)
    contradiction = worst(wrong - as_sum)
    straight = _straight_columns(context, "cross_B4")
    same = worst(facts.omega("cross_B4") - facts.omega("cross_A4"))
    return _rates(
        context,
        "(27)",
        "Angular velocity of the cross B4",
        "",
        facts.omega("cross_B4"),
        printed.omega_cross_B4(facts.q),
        omega_of(own, facts.q),
        "cross B4",
        note=f"Its own first form, (16) plus γ̇, differs from its second by {text(contradiction)}. The true cross "
        f"turns exactly as A4 (to "
        f"{text(same)}).",
        forms=("ω = ω_CSB1 + [0 0 γ̇] = [0 β̇ γ̇]", "ω = ω of the cross A4"),
        repair=(
            "what is printed last is the true motion of the straight leg, kept at every pose; the sum before it is the "
            "same once (16) has its sign",
            [wrong - straight, as_sum - straight - 2.0 * printed.omega_cross_B1(facts.q)],
        ),
        figures=[
            Figure("its two forms apart", contradiction, "", _box(context, "for unit rates")),
            Figure("cross B4 minus cross A4", same, "", _box(context, "angular velocity for unit rates")),
        ],
    )


def equation_28(context: Context) -> Verdict:
    """Velocity of the cross A4."""
    facts = assembled(context)
    motion = motions(context, "transmission_motions", facts.q)["cross_A4"]
    _, own = centre_of(context, motion, "cross_A4", facts.q)
    return _rates(
        context,
        "(28)",
        "Velocity of the cross A4",
        "m/rad",
        facts.velocity("cross_A4", com(context, "cross_A4")),
        printed.velocity_cross_A4(facts.q),
        own,
        "cross A4's centre",
        forms=("v = 0", ""),
    )


def equation_29(context: Context) -> Verdict:
    """Shaft."""
    facts = assembled(context)
    own = motions(context, "transmission_motions", facts.q)["shaft_A4B4"]
    there = facts.omega("shaft_A4B4")
    rod = facts.rotation("rod_A1B1")[..., 2]
    across = worst(np.cross(there[..., 2], rod))
    wrong = printed.omega_shaft(facts.q)
    tilting = np.cross((wrong - there)[..., :2], rod[..., None], axis=1)
    spin = np.einsum("ni,ni->n", there[..., 2], rod)
    return _rates(
        context,
        "(29)",
        "Angular velocity of the shaft A4B4",
        "",
        there,
        wrong,
        omega_of(own, facts.q),
        "shaft A4B4",
        note=f"A unit γ̇ turns it about the rod (component across {text(across)}), not about Z0, and with a rate "
        f"between {text(spin.min())} and "
        f"{text(spin.max())}.",
        forms=("ω = ω_A1B1 + [0 0 1] γ̇", "ω = ω_CSA4 + ḃ e: U joint A4 with both its angles"),
        repair=(
            "the γ̇ column is Z0, the true one lies along the rod; α̇ and β̇ columns are right across the rod",
            [wrong[..., 2] - printed.Z, np.cross(there[..., 2], rod), tilting],
        ),
        figures=[
            Figure("least spin for a unit γ̇", spin.min(), "", _box(context, "shaft about its own axis")),
            Figure("greatest spin for a unit γ̇", spin.max(), "", _box(context, "shaft about its own axis")),
        ],
    )


def equation_30(context: Context) -> Verdict:
    """Velocity of the shaft's centre."""
    facts, _, _, _ = _rod(context)
    motion = motions(context, "transmission_motions", facts.q)["shaft_A4B4"]
    _, own = centre_of(context, motion, "shaft_A4B4", facts.q)
    centre = com(context, "shaft_A4B4")
    return _rates(
        context,
        "(30)",
        "Velocity of the shaft's centre of mass",
        "m/rad",
        facts.velocity("shaft_A4B4", centre),
        printed.velocity_shaft(facts.q, centre),
        own,
        "shaft's centre of mass",
        note="Exact, not an approximation: shaft and rods stay parallel and their centres of mass lie equally far "
        "along.",
        forms=("v_A4B4 = v_A1B1", ""),
    )


def equation_31(context: Context) -> Verdict:
    """Centre of the shaft."""
    facts = assembled(context)
    motion = motions(context, "transmission_motions", facts.q)["shaft_A4B4"]
    own, _ = centre_of(context, motion, "shaft_A4B4", facts.q)
    centre = com(context, "shaft_A4B4")
    there = facts.position("shaft_A4B4", centre)
    off_axis = centre + np.array([1e-3, 0.0, 0.0])
    error = worst(printed.shaft_centre(facts.q, off_axis) - facts.position("shaft_A4B4", off_axis))
    return compare(
        "(31)",
        "Centre of mass of the shaft",
        _box(context, "shaft of the assembled mechanism"),
        "m",
        printed.shaft_centre(facts.q, centre) - there,
        own - there,
        note=f"It needs A4 = O0 and a centre of mass on the axis: 1 mm beside it, the error reaches "
        f"{text(1e3 * error)} mm.",
        forms=("P = R_B1 P_ic", ""),
        figures=[Figure("error with a centre of mass 1 mm off the axis", error, "m", _box(context, "shaft"))],
    )


def equation_32(context: Context) -> Verdict:
    """Velocity of the knee."""
    facts = assembled(context)
    there = facts.velocity("knee")
    rule = printed.derivative(
        lambda q: np.stack(context.formulas.knee_position(context.numbers, tuple(q.T)), axis=-1), facts.q
    )
    shape = facts.q.shape[:-1]
    own = np.swapaxes(array(motions(context, "branch_motions", facts.q)["cross_B1"].columns, shape), -1, -2)
    literal = worst(printed.knee_jacobian(context.numbers, facts.q) - there)
    return _rates(
        context,
        "(32)",
        "Velocity of the knee, the derivative of (9)",
        "m/rad",
        there,
        rule,
        own,
        "knee",
        note=f"With (9) as corrected; (9) as printed would make it wrong by up to {text(literal)} m/rad.",
        forms=("v_O0' = J [α̇ β̇ γ̇]", ""),
        figures=[Figure("with (9) as printed", literal, "m/rad", _box(context, "knee velocity for unit rates"))],
    )


def equation_33(context: Context) -> Verdict:
    """Centre of the knee assembly."""
    facts = assembled(context)
    centre = com(context, "knee")
    there = facts.position("knee", centre)
    own = formula(context, "knee_position", facts.q)
    return compare(
        "(33)",
        "Centre of mass of the knee assembly",
        _box(context, "knee of the assembled mechanism"),
        "m",
        printed.knee_centre(facts.position("knee"), centre) - there,
        printed.knee_centre(own, centre) - there,
        note="The frame of the result and of O0' is O0; the superscripts say O0', which only parallel axes excuse.",
        forms=("P_Abc = P_Abc + P_O0'", ""),
    )


class _Chain:
    """One of the three shank chains in the frame at its C: what the facts and the formulas say."""

    def __init__(self, context: Context, number: int) -> None:
        self.context = context
        self.facts = assembled(context)
        self.q = self.facts.q
        self.upper, self.lower = f"link_C{number}D{number}", f"link_D{number}E{number}"
        self.hinge = f"phi_D{number}"
        self.rotation = printed.rot(printed.Z, float(context.numbers.psi[number - 1]))
        self.C = self.facts.position(self.upper) - self.facts.position("knee")
        self.D = (self.facts.position(self.lower) - self.facts.position(self.upper)) @ self.rotation
        self.motions = motions(context, "shank_motions", self.q)

    def com(self, link: str) -> Array:
        """Centre of mass of a link in its own frame, m."""
        return com(self.context, link)

    def omega(self, link: str) -> tuple[Array, Array]:
        """Angular velocity from C, fact and formula."""
        own = omega_of(self.motions[link], self.q)
        return self.rotation.T @ self.facts.omega(link), self.rotation.T @ own

    def centre(self, link: str) -> tuple[Array, Array]:
        """Centre of mass from C, fact and formula."""
        own, _ = centre_of(self.context, self.motions[link], link, self.q)
        own_origin = array(self.motions[self.upper].origin, self.q.shape[:-1])
        fact = self.facts.position(link, self.com(link)) - self.facts.position(self.upper)
        return fact @ self.rotation, (own - own_origin) @ self.rotation

    def velocity(self, link: str) -> tuple[Array, Array]:
        """Velocity of the centre of mass relative to C, fact and formula."""
        _, own = centre_of(self.context, self.motions[link], link, self.q)
        own_origin = np.swapaxes(array(self.motions[self.upper].columns, self.q.shape[:-1]), -1, -2)
        fact = self.facts.velocity(link, self.com(link)) - self.facts.velocity(self.upper)
        return self.rotation.T @ fact, self.rotation.T @ (own - own_origin)

    @property
    def phi_ratio(self) -> Array:
        """phi / gamma in the assembled mechanism, where gamma is not too close to zero to divide by."""
        bent = self.q[:, 2] > np.radians(0.1)
        return self.facts.angle(self.hinge)[bent] / self.q[bent, 2]


def _chains(context: Context) -> tuple[_Chain, ...]:
    return context.once("equations: chains", lambda: tuple(_Chain(context, number) for number in (1, 2, 3)))


def _over_chains(context: Context, function: Callable[[_Chain], Any]) -> Array:
    """What a function gives for each chain, (3, ...)."""
    return np.stack([np.asarray(function(chain)) for chain in _chains(context)])


def _fact_and_formula(context: Context, function: Callable[[_Chain], tuple[Array, Array]]) -> tuple[Array, Array]:
    """Facts and formulas of all chains, each (3, ...)."""
    facts, formulas = zip(*map(function, _chains(context)), strict=True)
    return np.stack(facts), np.stack(formulas)


def equation_34(context: Context) -> Verdict:
    """Angular velocity of C1D1."""
    there, own = _fact_and_formula(context, lambda chain: chain.omega(chain.upper))
    q = states(context)
    along = printed.omega_C1D1(q, printed.X) - there
    return _rates(
        context,
        "(34)",
        "Angular velocity of the link C1D1: which r_γ",
        "",
        there,
        printed.omega_C1D1(q),
        own,
        "links C_iD_i, each from C_i",
        note="r_γ is defined once, as [0 0 1] in (29); here it has to be X_C1. (36), (37), (41) and (43) are judged "
        "with that.",
        forms=("ω = r_γ γ̇, r_γ = [0 0 1] by (29)", "ω = X_C1 γ̇"),
        repair=(
            "the printed γ̇ column is Z0, and with r_γ = X_C1 the equation is right",
            [printed.omega_C1D1(q)[..., 2] - printed.Z, along],
        ),
    )


def equation_35(context: Context) -> Verdict:
    """Centre of C1D1."""
    there, own = _fact_and_formula(context, lambda chain: chain.centre(chain.upper))
    return compare(
        "(35)",
        "Centre of mass of the link C1D1 from C1",
        _box(context, "links C_iD_i of the assembled mechanism, each from C_i"),
        "m",
        _over_chains(context, lambda chain: printed.C1D1_centre(chain.q, chain.com(chain.upper))) - there,
        own - there,
        forms=("P = rot(X, γ) P_ic", ""),
    )


def _with_r_gamma_of_29(context: Context, difference: Array, unit: str) -> Figure:
    return Figure("with r_γ = [0 0 1] of (29)", worst(difference), unit, _box(context, "worst difference"))


def equation_36(context: Context) -> Verdict:
    """Velocity of C1D1's centre."""
    there, own = _fact_and_formula(context, lambda chain: chain.velocity(chain.upper))

    def as_printed(r_gamma: Array) -> Array:
        return _over_chains(context, lambda c: printed.C1D1_velocity(c.q, c.com(c.upper), r_gamma))

    return _rates(
        context,
        "(36)",
        "Velocity of C1D1's centre of mass from C1",
        "m/rad",
        there,
        as_printed(printed.X),
        own,
        "links C_iD_i, each from C_i",
        note="With r_γ along X_C1, see (34).",
        forms=("v = ω × P", ""),
        figures=[_with_r_gamma_of_29(context, as_printed(printed.R_GAMMA_OF_29) - there, "m/rad")],
    )


def equation_37(context: Context) -> Verdict:
    """Angular velocity of D1E1."""
    there, own = _fact_and_formula(context, lambda chain: chain.omega(chain.lower))
    ratio = _over_chains(context, lambda chain: chain.phi_ratio)
    q = states(context)
    by_table = printed.omega_D1E1(q, printed.PHI_OF_TABLE_1) - there
    return _rates(
        context,
        "(37)",
        "Angular velocity of the link D1E1: φ is not given",
        "",
        there,
        printed.omega_D1E1(q, float(ratio.mean())),
        own,
        "links D_iE_i, each from C_i",
        note=f"φ is not given; with r_γ = r_φ = X_C1 and the φ of the assembled mechanism, whose φ/γ lies between "
        f"{ratio.min():.6f} and {ratio.max():.6f}, the equation is right. Table 1 calls γ the turn of D_i too, which "
        f"would be off by {text(worst(by_table))}.",
        forms=("ω = r_γ γ̇ + r_φ φ̇", ""),
        figures=[
            Figure("least φ/γ", ratio.min(), "", _box(context, "assembled mechanism, γ above 0.1 deg")),
            Figure("greatest φ/γ", ratio.max(), "", _box(context, "assembled mechanism, γ above 0.1 deg")),
            Figure("with φ = γ of Table 1", worst(by_table), "", _box(context, "worst difference")),
        ],
    )


def equation_38(context: Context) -> Verdict:
    """Centre of D1E1."""
    there, own = _fact_and_formula(context, lambda chain: chain.centre(chain.lower))
    # Only here the lever is the mechanism's own: what is judged is the symbol, not (39).
    lever = there - _over_chains(context, lambda chain: chain.D)
    whole = printed.D1E1_centre(context.numbers, states(context), lever) - there
    return compare(
        "(38)",
        "Centre of mass of the link D1E1 from C1: one symbol, two vectors",
        _box(context, "position of (38) as its symbol is defined by (39), against the assembled mechanism"),
        "m",
        np.linalg.norm(lever - there, axis=-1),
        own - there,
        forms=("P_D1E1c = R P_OD1 + P_D1E1c", "P_D1E1c = R P_OD1 + p, p = the vector of (39)"),
        repair=("the sum as printed is right once its second term has a name of its own", whole),
        figures=[Figure("sum with separate symbols", worst(whole), "m", _box(context, "centre of mass of D_iE_i"))],
    )


def equation_39(context: Context) -> Verdict:
    """Lever of D1E1."""
    leg, q = context.numbers, states(context)
    end = np.array([0.0, 0.0, leg.L4])
    there = _over_chains(context, lambda chain: chain.centre(chain.lower)[0] - chain.D)
    wrong = _over_chains(context, lambda chain: printed.D1E1_lever(chain.q, chain.com(chain.lower)))

    def formula_lever(chain: _Chain) -> Array:
        origins = [array(chain.motions[link].origin, q.shape[:-1]) for link in (chain.lower, chain.upper)]
        return chain.centre(chain.lower)[1] - (origins[0] - origins[1]) @ chain.rotation

    def end_of_lower(chain: _Chain) -> Array:
        return (chain.facts.position(chain.lower, end) - chain.facts.position(chain.lower)) @ chain.rotation

    miss = np.linalg.norm(printed.D1E1_lever(q, end) - _over_chains(context, end_of_lower), axis=-1)
    back = printed.rot(printed.X, -q[:, 2])
    return compare(
        "(39)",
        "Centre of mass of D1E1 from D1: E1 relative to which frame",
        _box(context, "lever in the assembled mechanism, three chains"),
        "m",
        wrong - there,
        _over_chains(context, formula_lever) - there,
        note=f"With E1's rotation relative to C1 the link stays vertical; E1 is off by {1e3 * miss[0, 0]:.1f} mm at "
        f"γ = 40° and up to {text(1e3 * miss.max())} mm.",
        forms=("P = R(D1 in C1) R(E1 in C1) P_ic", "P = R(D1 in C1) R(E1 in D1) P_ic = rot(X, −γ) P_ic"),
        repair=(
            "taking the printed vector back by R(D1 in C1) once, which makes E1's rotation relative to D1, is right",
            np.einsum("nij,knj->kni", back, wrong) - there,
        ),
        figures=[
            Figure("E1 off at γ = 40 deg", miss[0, 0], "m", "literal reading"),
            Figure("E1 off, worst", miss.max(), "m", _box(context, "literal reading")),
        ],
    )


def equation_40(context: Context) -> Verdict:
    """Velocity of D1E1's centre."""
    there, own = (part[..., 2] for part in _fact_and_formula(context, lambda chain: chain.velocity(chain.lower)))
    position = _over_chains(context, lambda chain: chain.centre(chain.lower)[0])
    D = _over_chains(context, lambda chain: chain.D)
    ratio = float(_over_chains(context, lambda chain: chain.phi_ratio).mean())
    twice_38, twice_39 = (printed.D1E1_velocity(vector, ratio) for vector in (position, position - D))
    across = np.cross(printed.X, D)
    return _rates(
        context,
        "(40)",
        "Velocity of D1E1's centre of mass: one symbol, two vectors",
        "m/rad",
        there,
        twice_38,
        own,
        "links D_iE_i, each from C_i",
        note=f"At γ = 40° the true velocity is {_vector(there[0, 0])} m/rad; (38) in both columns gives "
        f"{_vector(twice_38[0, 0])}, (39) in both {_vector(twice_39[0, 0])}.",
        forms=("v = [r_γ × P, r_φ × P][γ̇ φ̇]", "v = [r_γ × P of (38), r_φ × P of (39)][γ̇ φ̇]"),
        repair=(
            "with (38) in column 1 and (39) in column 2 it is right",
            [twice_38 - ratio * across - there, twice_39 + across - there],
        ),
        figures=[
            *(
                Figure(f"{name}, {axis} at γ = 40 deg", value, "m/rad", "for a unit γ̇, chain 1")
                for name, vector in (
                    ("true", there),
                    ("(38) in both columns", twice_38),
                    ("(39) in both columns", twice_39),
                )
                for axis, value in zip("xyz", vector[0, 0], strict=True)
            ),
        ],
    )


def equation_41(context: Context) -> Verdict:
    """Angular velocity of C1D1 in O0."""
    there = _over_chains(context, lambda chain: chain.facts.omega(chain.upper))

    def as_printed(r_gamma: Array) -> Array:
        return _over_chains(context, lambda c: printed.omega_in_hip(c.rotation, printed.omega_C1D1(c.q, r_gamma)))

    return _rates(
        context,
        "(41)",
        "Angular velocity of C1D1 in O0",
        "",
        there,
        as_printed(printed.X),
        _over_chains(context, lambda chain: omega_of(chain.motions[chain.upper], chain.q)),
        "links C_iD_i",
        note="With r_γ along X_C1, see (34); for all three chains, whose R differ.",
        forms=("ω = R ω", ""),
        figures=[_with_r_gamma_of_29(context, as_printed(printed.R_GAMMA_OF_29) - there, "")],
    )


def equation_42(context: Context) -> Verdict:
    """Centre of C1D1 in O0."""

    def as_printed(chain: _Chain) -> Array:
        local = printed.C1D1_centre(chain.q, chain.com(chain.upper))
        return printed.position_in_hip(chain.facts.position("knee"), chain.C, chain.rotation, local)

    def own(chain: _Chain) -> Array:
        return centre_of(context, chain.motions[chain.upper], chain.upper, chain.q)[0]

    there = _over_chains(context, lambda chain: chain.facts.position(chain.upper, chain.com(chain.upper)))
    height = worst(_over_chains(context, lambda chain: chain.C[:, 2]) - context.numbers.L5)
    return compare(
        "(42)",
        "Centre of mass of C1D1 in O0",
        _box(context, "links C_iD_i of the assembled mechanism"),
        "m",
        _over_chains(context, as_printed) - there,
        _over_chains(context, own) - there,
        note=f"P_OC1 has to contain L5 (its z differs from L5 by {text(height)} m); the paper gives no value for it.",
        forms=("P = P_O0' + P_OC1 + R P", ""),
    )


def equation_43(context: Context) -> Verdict:
    """Velocity of C1D1's centre in O0."""

    def as_printed(r_gamma: Array) -> Array:
        def velocity(chain: _Chain) -> Array:
            local = printed.C1D1_velocity(chain.q, chain.com(chain.upper), r_gamma)
            return printed.velocity_in_hip(chain.facts.velocity("knee"), chain.rotation, local)

        return _over_chains(context, velocity)

    def own(chain: _Chain) -> Array:
        return centre_of(context, chain.motions[chain.upper], chain.upper, chain.q)[1]

    there = _over_chains(context, lambda chain: chain.facts.velocity(chain.upper, chain.com(chain.upper)))
    return _rates(
        context,
        "(43)",
        "Velocity of C1D1's centre of mass in O0",
        "m/rad",
        there,
        as_printed(printed.X),
        _over_chains(context, own),
        "links C_iD_i",
        note="With r_γ along X_C1, see (34); for all three chains, whose R differ.",
        forms=("v = v_O0' + R v", ""),
        figures=[_with_r_gamma_of_29(context, as_printed(printed.R_GAMMA_OF_29) - there, "m/rad")],
    )


# ---------------------------------------------------------------------- dynamics


def _few(context: Context) -> tuple[Array, Array, Array]:
    """Test pose and random states that are not close to the straight leg, with rates and accelerations."""
    q = context.q[context.q[:, 2] > np.radians(5.0)][:FEW]
    q = np.concatenate([TEST_POSE[None], q])
    return q, context.v[: len(q)], context.a[: len(q)]


def _motion_52(rate: float = 1.0, count: int = 41) -> tuple[Array, Array, Array]:
    """States along (52), 0 to 6 s, `rate` times as fast."""
    w = np.pi / 3.0
    t = np.linspace(0.0, 6.0, count)
    q = printed.motion_52(t)
    amplitude = printed.motion_52(np.array(1.5))
    return q, rate * w * amplitude * np.cos(w * t)[:, None], -((rate * w) ** 2) * q


def equation_44(context: Context) -> Verdict:
    """Energies."""
    q, v, _ = _few(context)
    there = context.pinocchio.mass_matrix(q)
    literal = mass_matrix_of(context, q, constant_tensors=True)
    kinetic = [0.5 * np.einsum("ni,nij,nj->n", v, M - there, v) for M in (literal, formula(context, "mass_matrix", q))]
    held = context.pinocchio.gravity_torque(q)

    def potential(q: Array) -> Array:
        everything = motions(context, "body_motions", q)
        bodies = [(float(b.mass), centre_of(context, everything[b.name], b.name, q)[0]) for b in context.numbers.bodies]
        return printed.potential_energy(bodies)

    wrong = gradient(potential, q)
    rotated = mass_matrix_of(context, q) - there
    gravity = tuple(float(g) for g in context.numbers.gravity)
    own = formula(context, "gravity_torque", q, gravity)
    at = np.radians([[30.0, 30.0, 40.0]])
    G_true, G_literal = context.pinocchio.gravity_torque(at)[0, 0], gradient(potential, at)[0, 0]
    inertial = []
    for rate in (1.0, 10.0):
        motion = _motion_52(rate)
        exact = lagrange_torque(lambda q: mass_matrix_of(context, q), *motion)
        constant = lagrange_torque(lambda q: mass_matrix_of(context, q, constant_tensors=True), *motion)
        inertial.append(1e3 * worst(constant - exact))
    return compare(
        "(44)",
        "Energies: sign of the height, frame of the tensor",
        f"gravity torque against the numeric route, {len(q)} states",
        "N·m",
        wrong - held,
        own - held,
        alike=(worst(kinetic[0]), worst(kinetic[1])),
        tolerance=FORCE_TOLERANCE,
        note=f"Z0 points down, so m g P_z flips gravity: G_α(30°, 30°) is {G_literal:+.3f} instead of {G_true:+.3f} "
        f"N·m. A tensor kept constant in O0 "
        f"changes the torques by up to {inertial[0]:.2g} mN·m along (52), 0 to 6 s, {inertial[1]:.2g} mN·m ten "
        "times as fast.",
        forms=("K = ½ωᵀIω + ½mvᵀv, P = m g P_z", "K = ½ωᵀ(R I Rᵀ)ω + ½mvᵀv, P = −m g P_z (Z0 down)"),
        repair=(
            "gravity has the opposite sign, and the kinetic energy is right once each tensor turns with its body",
            [wrong + held, 0.5 * np.einsum("ni,nij,nj->n", v, rotated, v)],
        ),
        figures=[
            Figure(
                "kinetic energy, constant tensors",
                worst(kinetic[0]),
                "J",
                f"difference at rates within 1 rad/s, {len(q)} states",
            ),
            Figure("gravity torque on α, printed", G_literal, "N·m", "at (30, 30, 40) deg, assumed masses"),
            Figure("gravity torque on α, true", G_true, "N·m", "at (30, 30, 40) deg, assumed masses"),
            Figure("torque error of constant tensors", inertial[0], "mN·m", "(52), 0 to 6 s, assumed masses"),
            Figure(
                "torque error of constant tensors, ten times as fast",
                inertial[1],
                "mN·m",
                "path of (52), assumed masses",
            ),
        ],
    )


def _dynamics(context: Context) -> dict[str, Array]:
    """Facts and terms of the equation of motion at a few states."""

    def compute() -> dict[str, Array]:
        q, v, a = _few(context)
        leg = context.leg
        return {
            "q": q,
            "v": v,
            "a": a,
            "tau": context.pinocchio.generalized_force(q, v, a),
            "M_a": np.einsum("nij,nj->ni", leg.mass_matrix(q), a),
            "M_rate_v": np.einsum("nij,nj->ni", slope(leg.mass_matrix, q, v), v),
            "G": leg.gravity_torque(q),
            "V": leg.bias(q, v) - leg.gravity_torque(q),
        }

    return context.once("equations: dynamics", compute)


def _inverse_dynamics(context: Context, facts: dict[str, Array]) -> Array:
    gravity = tuple(float(g) for g in context.numbers.gravity)
    return formula(context, "inverse_dynamics", facts["q"], facts["v"], facts["a"], gravity)


def equation_45(context: Context) -> Verdict:
    """Lagrange's equation."""
    facts = _dynamics(context)
    wrong = printed.lagrange(facts["M_a"], facts["M_rate_v"], -facts["G"])
    dropped = 0.5 * np.einsum("ni,nijk,nj->nk", facts["v"], gradient(context.leg.mass_matrix, facts["q"]), facts["v"])
    return compare(
        "(45)",
        "Lagrange's equation: L without its velocities",
        f"torque against the numeric route, {len(facts['q'])} states with rates within 1 rad/s",
        "N·m",
        wrong - facts["tau"],
        _inverse_dynamics(context, facts) - facts["tau"],
        tolerance=FORCE_TOLERANCE,
        note="The second term as printed, ∂L(η)/∂η, drops ∂K/∂η, a part of the velocity forces.",
        forms=("τ = d/dt ∂L(η, η̇)/∂η̇ − ∂L(η)/∂η", "τ = d/dt ∂L(η, η̇)/∂η̇ − ∂L(η, η̇)/∂η"),
        repair=("printed minus true is ∂K/∂η = ½ η̇ᵀ (∂M/∂η) η̇", wrong - facts["tau"] - dropped),
    )


def equation_46(context: Context) -> Verdict:
    """Matrix form."""
    facts = _dynamics(context)
    wrong = printed.equation_of_motion(facts["M_a"], facts["V"], facts["G"], -facts["G"])
    clean = worst(facts["M_a"] + facts["V"] + facts["G"] - facts["tau"])
    return compare(
        "(46)",
        "Equation of motion: a trailing ∂L/∂η",
        f"torque against the numeric route, {len(facts['q'])} states with rates within 1 rad/s, numbers in SI units",
        "N·m",
        wrong - facts["tau"],
        _inverse_dynamics(context, facts) - facts["tau"],
        tolerance=FORCE_TOLERANCE,
        note=f"Its last product is a torque squared. Without ∂L/∂η, M η̈ + V + G agrees to {text(clean)} N·m.",
        forms=("τ = M η̈ + V + G ∂L(η)/∂η", "τ = M η̈ + V + G"),
        repair=(
            "printed minus true is G∘∂L/∂η − G with ∂L/∂η = −G",
            wrong - facts["tau"] - (-facts["G"] * facts["G"] - facts["G"]),
        ),
    )


def _straight(context: Context) -> Array:
    """States with a straight shank: along (52) at t = 0, 3 and 6 s, and in the face of the box, (n, 3)."""
    q = np.concatenate([printed.motion_52(np.array([0.0])), context.grid(3)[::3]])
    return q


def equation_47(context: Context) -> Verdict:
    """Force from torque."""
    q, _, _ = _few(context)
    straight = _straight(context)
    everywhere = np.concatenate([q, straight])
    F = context.rng(47).uniform(-20.0, 20.0, everywhere.shape)
    still = np.zeros_like(everywhere)
    tau = context.pinocchio.generalized_force(everywhere, still, still, foot_force=-F, gravity=np.zeros(3))
    J = printed.foot_jacobian(context.numbers, everywhere)
    back = printed.foot_output_force(J, tau)
    bent = worst(back[: len(q)] - F[: len(q)])
    none = int(np.isnan(back).any(axis=-1).sum())
    own = formula(context, "foot_force_torque", everywhere, -F)
    near = np.array([[0.0, 0.0, np.radians(1.0)]])
    gain = 1e-3 / float(np.linalg.svd(printed.foot_jacobian(context.numbers, near)[0], compute_uv=False)[-1])
    return compare(
        "(47)",
        "Foot force from motor torques: no inverse at γ = 0",
        f"force recovered from exact torques, {len(q)} bent and {len(straight)} straight states",
        "N",
        back - F,
        own - tau,
        tolerance=FORCE_TOLERANCE,
        note=f"Right for γ > 5° (to {text(bent)} N), but Jᵀ has no inverse in {none} of {len(straight)} states with γ "
        f"= 0, the initial state among them; "
        f"at γ = 1° a torque error of 1 mN·m already means {text(gain)} N. τ = JᵀF needs no inverse.",
        forms=("F = (Jᵀ)⁻¹ τ", "τ = Jᵀ F"),
        repair=(
            "it is right for γ above 5°, and at γ = 0 the γ̇ column of J vanishes, by which it divides",
            [back[: len(q)] - F[: len(q)], J[len(q) :, :, 2]],
        ),
        figures=[
            Figure("bent states, worst difference", bent, "N", f"γ above 5 deg, {len(q)} states"),
            Figure("straight states without an inverse", none, "", f"of {len(straight)} states with γ = 0"),
            Figure("force error of 1 mN·m at γ = 1 deg", gain, "N", "α = β = 0"),
        ],
    )


def equation_48(context: Context) -> Verdict:
    """Equation of motion as a force."""
    facts = _dynamics(context)
    q, v, a = (x[[0]] for x in _motion_52())
    all_q = np.concatenate([facts["q"], q])
    tau = np.concatenate([facts["tau"], context.pinocchio.generalized_force(q, v, a)])
    force = printed.foot_output_force(printed.foot_jacobian(context.numbers, all_q), tau)
    # With the foot force that really takes these torques, the numeric route needs no torque.
    rates, accelerations = np.concatenate([facts["v"], v]), np.concatenate([facts["a"], a])
    exists = np.isfinite(force).all(axis=-1)
    printed_left = np.full_like(force, np.nan)
    printed_left[exists] = context.pinocchio.generalized_force(
        all_q[exists], rates[exists], accelerations[exists], foot_force=force[exists]
    )
    left = printed_left[: len(facts["q"])]
    gravity = tuple(float(g) for g in context.numbers.gravity)
    own = formula(context, "inverse_dynamics", all_q, rates, accelerations, gravity)
    near = q + np.array([0.0, 0.0, 1e-12])
    demand = printed.foot_output_force(
        printed.foot_jacobian(context.numbers, near), context.pinocchio.generalized_force(near, v, a)
    )
    asked = worst(demand)
    return compare(
        "(48)",
        "Equation of motion as a foot force: no inverse at γ = 0",
        f"torque left when that force acts, numeric route, {len(facts['q'])} bent states and the start of (52)",
        "N·m",
        printed_left,
        own - tau,
        tolerance=FORCE_TOLERANCE,
        note=f"Right where the shank is bent (to {text(worst(left))} N·m). (52) starts and passes t = 3 and 6 s at γ = "
        f"0, where there is no such force; at "
        f"γ = 10⁻¹² rad it would be {text(asked)} N. τ = M η̈ + V + G is regular there.",
        forms=("F = (Jᵀ)⁻¹ (M η̈ + V + G)", "τ = M η̈ + V + G − Jᵀ F_on_foot, without an inverse"),
        repair=(
            "it is right for γ above 5°, and at γ = 0 the γ̇ column of J vanishes, by which it divides",
            [left, printed.foot_jacobian(context.numbers, q)[:, :, 2]],
        ),
        figures=[
            Figure("bent states, torque left", worst(left), "N·m", f"γ above 5 deg, {len(facts['q'])} states"),
            Figure("force asked for at γ = 1e-12 rad", asked, "N", "(52) at t = 0, assumed masses"),
        ],
    )


def _fig_11_force_side(context: Context) -> tuple[Array, Array]:
    """Peak torques of Fig. 11, (52) from 0 to 2 s with the force during the first second: on the foot, and opposite."""
    w = np.pi / 3.0
    t = np.linspace(0.0, 2.0, 201)
    q = printed.motion_52(t)
    v = w * printed.motion_52(np.array(1.5)) * np.cos(w * t)[:, None]
    leg = context.leg
    F_f = reported.foot_force(t)
    peaks = [np.abs(leg.generalized_force(q, v, -(w**2) * q, foot_force=s * F_f)).max(axis=0) for s in (1.0, -1.0)]
    return peaks[0], peaks[1]


def _external(context: Context) -> tuple[dict[str, Array], Array, Array, Array]:
    facts = _dynamics(context)
    F_f = np.broadcast_to(np.array(reported.FORCE), facts["q"].shape)
    tau = context.pinocchio.generalized_force(facts["q"], facts["v"], facts["a"], foot_force=F_f)
    return facts, F_f, tau, printed.foot_jacobian(context.numbers, facts["q"])


def equation_49(context: Context) -> Verdict:
    """External force."""
    facts, F_f, tau, J = _external(context)
    F = printed.foot_output_force(J, facts["tau"])
    there = printed.foot_output_force(J, tau)
    push = formula(context, "foot_force_torque", facts["q"], np.array(F_f))
    own = printed.foot_output_force(J, facts["tau"] + push)
    return compare(
        "(49)",
        "Foot force with an external force: sign",
        f"force that corresponds to the torque of the numeric route with F_f on the foot, {len(F)} bent states",
        "N",
        printed.force_with_external(F, F_f) - there,
        own - there,
        tolerance=1e3 * FORCE_TOLERANCE,
        note="A force applied to the foot relieves the motors: it is subtracted. The printed sum holds for the force "
        "that the foot exerts.",
        forms=("F_ff = F + F_f", "F_ff = F − F_f, F_f applied to the foot"),
        repair=(
            "printed minus true is 2 F_f: the opposite sign",
            printed.force_with_external(F, F_f) - there - 2.0 * F_f,
        ),
    )


def equation_50(context: Context) -> Verdict:
    """Torque with external force."""
    facts, F_f, tau, J = _external(context)
    wrong = facts["tau"] + printed.torque_with_external(J, F_f)
    own = _inverse_dynamics(context, facts) + formula(context, "foot_force_torque", facts["q"], np.array(F_f))
    right, flipped = _fig_11_force_side(context)
    return compare(
        "(50)",
        "Torque with an external force: sign",
        f"torque of the numeric route with F_f on the foot, {len(tau)} bent states",
        "N·m",
        wrong - tau,
        own - tau,
        tolerance=FORCE_TOLERANCE,
        note=f"With F_f = [0, −20, 20] N on the foot, the peak of |τ_β| in Fig. 11 is {right[1]:.2f} N·m; by the "
        f"printed sign "
        f"{flipped[1]:.2f} N·m.",
        forms=("τ_ff = Jᵀ(F + F_f) = M η̈ + V + G + Jᵀ F_f", "τ_ff = M η̈ + V + G − Jᵀ F_f"),
        repair=("printed minus true is 2 JᵀF_f: the opposite sign", wrong - tau - 2.0 * (facts["tau"] - tau)),
        figures=[
            *(
                Figure(f"peak torque on {n}", right[i], "N·m", "Fig. 11, force on the foot, assumed masses")
                for i, n in enumerate("αβγ")
            ),
            *(
                Figure(f"peak torque on {n}, printed sign", flipped[i], "N·m", "Fig. 11, assumed masses")
                for i, n in enumerate("αβγ")
            ),
        ],
    )


# ---------------------------------------------------------------------- motions


def _window(context: Context, sign: float) -> tuple[float, float]:
    """Heights z0 at which the leg can follow (51) with P_z = z0 + sign Z, inside the limits."""
    t = np.linspace(0.0, 5.0, 501)
    d = printed.path_51(t, 5.0)
    low, high = context.limits
    leg = context.numbers
    root = np.sqrt(leg.L1**2 - d[:, 0] ** 2 - d[:, 1] ** 2)
    base = sign * d[:, 2] - leg.L5 - root
    # 2 L4 cos(gamma) = z0 + base has to lie between its values at both limits of gamma.
    return float((2.0 * leg.L4 * np.cos(high[2]) - base).max()), float((2.0 * leg.L4 * np.cos(low[2]) - base).min())


def _follow_51(context: Context, z0: float, sign: float = -1.0) -> Array:
    t = np.linspace(0.0, 5.0, 501)
    d = printed.path_51(t, 5.0)
    p = np.column_stack([d[:, 0], d[:, 1], z0 + sign * d[:, 2]])
    return context.leg.inverse_kinematics(p, limits="ignore")


def _pieces(curve: Callable[[Array], Array], start: float, end: float, degree: int) -> tuple[list[Any], float]:
    """The polynomials of a printed curve (T, 3) between two times, and how far the curve is from any such polynomial.

    Derivatives and extremes of what is printed then need no second transcription of it.
    """
    t = np.linspace(start, end, 3 * degree + 1)
    values = curve(t)
    fitted = [np.polynomial.Polynomial.fit(t, column, degree) for column in values.T]
    return fitted, worst(np.stack([one(t) for one in fitted], axis=-1) - values)


def _extremes(piece: Any, order: int, start: float, end: float) -> tuple[float, float]:
    """Least and greatest value of a derivative of a polynomial between two times."""
    rate = piece.deriv(order) if order else piece
    at = np.real(rate.deriv().roots()) if rate.degree() > 1 else np.zeros(0)
    values = rate(np.concatenate([[start, end], at[(at > start) & (at < end)]]))
    return float(values.min()), float(values.max())


QUINTIC_SPEED, QUINTIC_ACCELERATION = 15.0 / 8.0, 10.0 / np.sqrt(3.0)
"""Peaks of a rest-to-rest quintic over distance 1 in time 1."""

LIFT_SPEED, LIFT_FALLING, LIFT_RISING = 64.0 * 3.0 / (25.0 * np.sqrt(5.0)), 24.0, 19.2
"""Peaks of 64 s³(1 − s)³: its speed at (1 ± 1/√5)/2, its acceleration at 1/2 and at (1 ± √(3/5))/2."""


def equation_51(context: Context) -> Verdict:
    """Path of the inverse kinematics."""
    from leg_dynamics.analysis.trajectories import omnileg_eq51_path

    T, half = 5.0, 2.5

    def curve(t: Array) -> Array:
        return printed.path_51(t, T)

    forth, odd_forth = _pieces(curve, 0.0, half, 6)
    back, odd_back = _pieces(curve, np.nextafter(half, T), T, 6)
    whole, _ = _pieces(lambda t: curve(t)[:, 1:], 0.0, T, 6)
    at = {t: curve(np.array([t]))[0] for t in (0.0, half, T)}
    ends = [at[0.0], at[half][[0, 2]] - [0.1, 0.05], at[T] - [0.0, 0.1, 0.0]]
    # Every coordinate rests where its stroke begins and ends.
    rates = [piece.deriv()(0.0) for piece in forth] + [piece.deriv()(T) for piece in back]
    rates += [forth[0].deriv()(half), back[0].deriv()(half), whole[1].deriv()(half)]
    accelerations = [p.deriv(2)(0.0) for p in forth] + [p.deriv(2)(T) for p in back]
    y, z = whole
    peaks = [
        _extremes(forth[0], 1, 0.0, half)[1] - QUINTIC_SPEED * 0.1 / half,
        _extremes(forth[0], 2, 0.0, half)[1] - QUINTIC_ACCELERATION * 0.1 / half**2,
        _extremes(y, 1, 0.0, T)[1] - QUINTIC_SPEED * 0.1 / T,
        _extremes(y, 2, 0.0, T)[1] - QUINTIC_ACCELERATION * 0.1 / T**2,
        _extremes(z, 0, 0.0, T)[1] - 0.05,
        _extremes(z, 1, 0.0, T)[1] - LIFT_SPEED * 0.05 / T,
        _extremes(z, 2, 0.0, T)[0] + LIFT_FALLING * 0.05 / T**2,
        _extremes(z, 2, 0.0, T)[1] - LIFT_RISING * 0.05 / T**2,
    ]
    path = omnileg_eq51_path(0.0, z_sign="literal")
    t = np.linspace(0.0, T, 501)
    before = printed.path_51(np.array(half), T)[0]
    gaps = [printed.path_51(np.nextafter(half, 3.0), value)[0] - before for value in (T, printed.GAIT["T"])]
    jump = back[0].deriv(3)(half) - forth[0].deriv(3)(half)
    up, literal = _window(context, -1.0), _window(context, 1.0)
    return compare(
        "(51)",
        "Foot path of the inverse kinematics",
        "ends, rest at the ends, spans and peaks in closed form (strokes of 0.1, 0.1 and 0.05 m), T = 5 s",
        "m, m/s, m/s²",
        flat([*ends, rates, accelerations, peaks, odd_forth, odd_back]),
        worst(path.value(t) - curve(t)),
        tolerance=POSITION_TOLERANCE,
        note=f"T is not given: X joins at 2.5 s with T = {T:g} s (gap {text(gaps[0])} m; with the T of (53), "
        f"{text(gaps[1])} m). Nor is the height z0: the leg follows the path with the foot lifted for z0 from "
        f"{up[0]:.4f} to {up[1]:.4f} m, with Z taken literally along Z0 (down) for {literal[0]:.4f} to "
        f"{literal[1]:.4f} m; the straight leg's 0.5 m is outside. Y ends at {at[T][1]:.3g} m, it does not return.",
        forms=("X, Y, Z of t and T", ""),
        figures=[
            Figure("z0, lowest", up[0], "m", "path inside the limits, foot lifted"),
            Figure("z0, highest", up[1], "m", "path inside the limits, foot lifted"),
            Figure("gap of X at 2.5 s", gaps[0], "m", f"T = {T:g} s"),
            Figure("jump of the jerk of X", abs(jump), "m/s³", "at 2.5 s"),
            *(
                Figure(f"span of the acceleration of {axis}", np.ptp(_extremes(piece, 2, 0.0, T)), "m/s²", "0 to 5 s")
                for axis, piece in (("Y", y), ("Z", z))
            ),
        ],
    )


def equation_52(context: Context) -> Verdict:
    """Motor angles of the forward kinematics."""
    t = np.linspace(0.0, 6.0, 121)
    q = printed.motion_52(t)
    # A sine of one frequency is known by its start, its rate there and its equation of motion.
    omega, amplitude = np.pi / 3.0, np.radians([30.0, 30.0, 25.0])
    rate = np.imag(printed.motion_52(t + 1j * printed.COMPLEX_STEP)) / printed.COMPLEX_STEP
    orbit = (q / amplitude) ** 2 + (rate / (omega * amplitude)) ** 2 - 1.0
    middle = printed.motion_52(np.array(1.5)) - amplitude
    start = rate[0] - omega * amplitude
    foot = context.pinocchio.foot_position(q)
    span = np.ptp(foot, axis=0)
    # At 30 deg both tangents are 1/sqrt(3): the thigh's direction is (1, -1, sqrt(3)) / sqrt(5).
    leg = context.numbers
    tilt = np.sqrt(1.0 / 5.0)
    shank = 2.0 * leg.L4 * (1.0 - np.cos(amplitude[2]))
    spans = span - [2.0 * leg.L1 * tilt, 2.0 * leg.L1 * tilt, leg.L1 * (1.0 - np.sqrt(3.0) * tilt) + shank]
    low, high = context.limits
    beyond = np.degrees(max(0.0, worst(np.maximum(low - q, 0.0)), worst(np.maximum(q - high, 0.0))))
    return compare(
        "(52)",
        "Motor angles of the forward kinematics",
        "start, rate, amplitude and frequency, spans of the assembled mechanism's foot in closed form, 0 to 6 s",
        "rad, rad/s, m",
        flat([orbit, middle, start, q[0], spans, printed.foot_position(leg, q) - foot]),
        worst(formula(context, "foot_position", q) - foot),
        note=f"It leaves the limits of Table 2 by {beyond:.0f}° (γ < 0 after 3 s), starts with "
        f"{np.degrees(rate[0, 0]):.1f}°/s, and moves the foot by "
        f"{1e3 * span[0]:.1f}, {1e3 * span[1]:.1f} and {1e3 * span[2]:.1f} mm.",
        forms=("α = β = π/6 sin(πt/3), γ = 25π/180 sin(πt/3)", ""),
        figures=[
            Figure("beyond the limits", beyond, "deg", "γ, 3 s < t < 6 s"),
            *(Figure(f"span of the foot, {axis}", span[i], "m", "0 to 6 s") for i, axis in enumerate("xyz")),
        ],
    )


def equation_53(context: Context) -> Verdict:
    """Gait."""
    from leg_dynamics.analysis.trajectories import omnileg_eq53_cycle

    gait = printed.GAIT
    L, H, T = gait["L"], gait["H"], gait["T"]

    def curve(t: Array) -> Array:
        return printed.path_53(t, **gait)

    (x, y, z), odd = _pieces(curve, 0.0, T, 6)
    at = {t: curve(np.array([t]))[0] for t in (0.0, 0.5 * T, T)}
    ends = [at[0.0], at[0.5 * T] - [0.0, 0.5 * L, H], at[T] - [gait["L_h"], L, 0.0]]
    rest = [piece.deriv(order)(t) for piece in (x, y, z) for order in (1, 2) for t in (0.0, T)]
    speeds = [_extremes(piece, 1, 0.0, T)[1] for piece in (y, z)]
    peaks = [
        speeds[0] - QUINTIC_SPEED * L / T,
        _extremes(y, 2, 0.0, T)[1] - QUINTIC_ACCELERATION * L / T**2,
        speeds[1] - LIFT_SPEED * H / T,
        _extremes(z, 2, 0.0, T)[0] + LIFT_FALLING * H / T**2,
    ]
    t = np.linspace(0.0, T, 101)
    own = omnileg_eq53_cycle(0.0, z_sign="literal").curve.value(t)
    return compare(
        "(53)",
        "Foot path of the gait",
        "ends, middle, rest at both ends and peaks in closed form, one step",
        "m, m/s, m/s²",
        flat([*ends, rest, peaks, odd]),
        worst(own - curve(t)),
        note=f"The step rests at both ends (speed and acceleration below {text(worst(rest))}) and reaches "
        f"{speeds[0]:.4f} m/s along Y and {speeds[1]:.4f} m/s along Z. The height z0, and whether Z is up, are not "
        "given.",
        forms=("X, Y: 6s⁵ − 15s⁴ + 10s³; Z: 64 s³(1 − s)³, s = t/T", ""),
        figures=[
            Figure("speed and acceleration at lift-off and touch-down", worst(rest), "m/s, m/s²", "both ends"),
            Figure("peak speed along Y", speeds[0], "m/s", "one step"),
            Figure("peak speed along Z", speeds[1], "m/s", "one step"),
        ],
    )


# ---------------------------------------------------------------------- tables


def _hinges(context: Context, letter: str) -> int:
    """Hinges of the file at points C_i, D_i or E_i, tree and cut."""
    prefixes = {"C": ("gamma_C",), "D": ("phi_D",), "E": ("epsilon_E", "loop_E")}[letter]
    description = context.leg.description
    names = [joint.name for joint in description.joints] + [loop.name for loop in description.loops]
    return sum(name.startswith(prefixes) for name in names)


def table_1(context: Context) -> Verdict:
    """Names and symbols."""
    facts, leg = assembled(context), context.numbers
    spin = facts.omega("cross_A1")[..., 1]
    about_X, about_Y = worst(spin - printed.X), worst(spin - printed.Y)
    B1 = facts.position("cross_B1")
    from_O0, from_knee = (
        worst(np.linalg.norm(B1, axis=-1) - leg.L3),
        worst(np.linalg.norm(B1 - facts.position("knee"), axis=-1) - leg.L3),
    )
    hinges = {letter: _hinges(context, letter) for letter in "CDE"}
    turn = worst(facts.angle("phi_D1") - facts.q[:, 2])
    right = worst(facts.angle("phi_D1") + 2.0 * facts.q[:, 2])
    mended = [about_Y, from_knee, *(count - 3 for count in hinges.values())]
    return compare(
        "Table 1",
        "Names and symbols: four entries",
        _box(context, "turn of D1 against the assembled mechanism"),
        "rad",
        turn,
        right,
        alike=([about_X, from_O0, *(count - 2 for count in hinges.values())], mended),
        kind="table",
        tolerance=RATE_TOLERANCE,
        note=f"β turns A1 about Y0 (off by {text(about_Y)}), not X0 ({text(about_X)}); B_i is L3 from O0' (off by "
        f"{text(from_knee)} m), not from O0 (up to {text(from_O0)} m); there are {hinges['C']} hinges C_i, "
        f"{hinges['D']} D_i and {hinges['E']} E_i, not 2 each; D_i turns by −2γ, not γ (off by up to {text(turn)} "
        "rad).",
        forms=(
            "A1 about X0: β; B_i to O0: L3; C_i, D_i, E_i, i = 1, 2; D_i: γ",
            "A1 about Y0; B_i to O0'; i = 1, 2, 3; D_i: −2γ",
        ),
        repair=("the four entries so replaced are right, each by itself", [right, *mended]),
        figures=[
            Figure("B1 to O0 minus L3", from_O0, "m", _box(context, "largest")),
            Figure("turn of D1 minus γ", turn, "rad", _box(context, "largest")),
            *(Figure(f"hinges {letter}_i", count, "", "the file") for letter, count in hinges.items()),
        ],
    )


def table_2(context: Context) -> Verdict:
    """Dimensions and limits."""
    leg, table = context.numbers, printed.TABLE_2
    gamma = np.radians(printed.RANGES[2])
    L2 = np.sort(2.0 * leg.L4 * np.cos(gamma))
    L2_printed = np.array(printed.L2_RANGE)
    lengths = worst([leg.L1 - table["L1"], leg.L3 - table["L3"], leg.L4 - table["L4"], leg.L5 - table["L5"]])
    # The range of L2 is rounded to mm.
    rounding = np.maximum(np.abs(L2_printed - L2) - 5e-4, 0.0)
    # The table's own numbers, whatever their sign: lengths, and the upper ends of the ranges.
    data = [lengths, *rounding, *(np.radians(printed.RANGES)[:, 1] - context.limits[1])]
    lowest, highest = _window(context, -1.0)
    heights = np.linspace(lowest, highest, 9)[1:-1]
    low_printed, high_printed = np.radians(printed.RANGES).T
    low, high = context.limits
    excess, own, unsigned = [], [], []
    for z0 in heights:
        q = _follow_51(context, z0)
        excess.append(np.degrees(np.maximum(low_printed - q, q - high_printed).max()))
        own.append(np.degrees(max(0.0, np.maximum(low - q, q - high).max())))
        unsigned.append(np.degrees(max(0.0, np.maximum(low_printed - np.abs(q), np.abs(q) - high_printed).max())))
    straight = leg.L1 + 2.0 * leg.L4 + leg.L5
    needed = float(np.degrees(_follow_51(context, 0.5 * (lowest + highest))[:, 0].min()))
    return compare(
        "Table 2",
        "Dimensions and ranges: α and β are signed",
        "angles that (51) needs beyond the limits, least over its feasible heights",
        "deg",
        min(excess),
        max(own),
        alike=(data, data),
        kind="table",
        tolerance=1e-6,
        note=f"0 to 65° would forbid the paper's own path (51), which needs α = {needed:.2f}° at every height. The "
        f"lengths are those of the file (to {text(lengths)} m); L2 = 2 L4 cos γ spans {L2[0]:.4f} to {L2[1]:.4f} m "
        f"(printed {L2_printed[0]:g} to {L2_printed[1]:g}, rounded), and the straight leg is {straight:g} m.",
        forms=("0° ≤ α, β ≤ 65°", "−65° ≤ α, β ≤ 65°"),
        repair=("the magnitudes of all angles that (51) needs lie inside the printed ranges", unsigned),
        figures=[
            Figure("α that (51) needs", needed, "deg", "least angle on the path"),
            Figure("least L2", L2[0], "m", "γ = 85 deg"),
            Figure("greatest L2", L2[1], "m", "γ = 0"),
            Figure("L2 printed minus computed", worst(L2_printed - L2), "m", "rounding of the table"),
            Figure("length of the straight leg", straight, "m", "L1 + 2 L4 + L5"),
        ],
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (
    *(globals()[f"equation_{number}"] for number in range(1, 54)),
    table_1,
    table_2,
)
"""One function an equation, in the paper's order, then the tables."""
