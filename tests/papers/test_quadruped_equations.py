"""Verdicts on equations, Table 1 and the inverse kinematics of the modular quadruped's paper, and tampering."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.quadruped import equations, facts, inverse, printed

POSE_4 = np.radians([0.0, -30.0, -60.0])


@functools.cache
def known():
    context = Context("quadruped_leg", samples=4000)
    functions = (*equations.VERDICTS, *inverse.VERDICTS)
    return context, {verdict.item: verdict for verdict in (function(context) for function in functions)}


@pytest.fixture(scope="module")
def verdicts():
    return known()[1]


@pytest.fixture
def context():
    return known()[0]


def figure(verdict, name):
    return next(f.value for f in verdict.figures if f.name == name)


# ---------------------------------------------------------------------- the audit


def test_statuses(verdicts):
    corrected = {item for item, verdict in verdicts.items() if verdict.status is Status.CORRECTED}
    assert corrected == {
        "(7)",
        "(8)",
        "(12)",
        "(13)",
        "Table 1",
        "claim: the inverse kinematics gives θ₁, θ₂ and θ₃",
    }
    rest = {verdict.status for item, verdict in verdicts.items() if item not in corrected}
    assert rest == {Status.CONFIRMED}
    assert [item for item in verdicts if item.startswith("(")] == [f"({n})" for n in range(1, 14)]
    for verdict in verdicts.values():
        assert verdict.finding.endswith("."), verdict.item
        assert "nan" not in verdict.finding.lower(), verdict.item
        assert all(math.isfinite(f.value) for f in verdict.figures), verdict.item


def test_the_pose_of_4(verdicts):
    four = verdicts["(4)"]
    place = [figure(four, f"P_{axis}") for axis in "xyz"]
    np.testing.assert_allclose(place, [0.2525, -0.055, -0.1775], atol=5e-5)
    table = verdicts["Table 1"]
    proximal = [figure(table, f"{axis} at the pose of (4), proximal frames") for axis in "xyz"]
    np.testing.assert_allclose(proximal, [0.3837, -0.055, -0.070], atol=5e-5)
    distal = [figure(table, f"{axis} at the pose of (4), distal frames") for axis in "xyz"]
    np.testing.assert_allclose(distal, place, atol=1e-12)


def test_equation_12_fails_everywhere(verdicts):
    twelve = verdicts["(12)"]
    assert figure(twelve, "no value as printed") == 4000
    assert figure(twelve, "right, corrected") == 4000
    assert figure(twelve, "right as printed, full circle") == 0
    assert figure(twelve, "right with the factor 2 and the printed sign, θ₃ < 0") == 0
    assert figure(twelve, "least l₃/l₂ for a value inside ±70°") == pytest.approx(4.99, abs=0.005)
    assert all(f.value == 0 for f in twelve.figures if f.name.startswith("values as printed"))


def test_the_threshold_ratio_is_where_values_begin():
    swing = np.radians(70.0)
    for ratio, some in ((inverse.threshold_ratio(swing) - 1e-6, False), (inverse.threshold_ratio(swing) + 1e-6, True)):
        lengths = printed.Lengths(0.1, 0.1, 0.1 * ratio)
        knee = np.linspace(-swing, swing, 2001)
        t, z = lengths.l2 + lengths.l3 * np.cos(knee), lengths.l3 * np.sin(knee)
        keep = np.abs(z) > 1e-9
        assert np.isfinite(printed.theta_2(lengths, t[keep], z[keep])).any() == some


def test_variants_of_12_by_knee_and_height(context):
    f = facts.counted_poses(context)
    knee_in, below = f.q[:, 2] < 0.0, f.in_plane[1] < 0.0
    expected = {
        "as printed": np.zeros(len(f.q), dtype=bool),
        "2 l₂": ~knee_in & ~below,
        "2 l₂ and −arcsin": knee_in & below,
        "2 l₂ and atan2": ~knee_in,
        "corrected": np.ones(len(f.q), dtype=bool),
    }
    for name, wanted in expected.items():
        np.testing.assert_array_equal(inverse.right(context, f, name)[1], wanted, err_msg=name)


def test_the_audits_wrong_angle_of_the_repaired_sign():
    """Factor restored, sign and arctangent as printed: 70.2 deg at the pose of (4), and the foot 290 mm off."""
    lengths = printed.Lengths(0.075, 0.075, 0.14)
    t, z = lengths.l2 * math.cos(POSE_4[1]), lengths.l2 * math.sin(POSE_4[1]) - lengths.l3
    angle = printed.theta_2(lengths, np.array(t), np.array(z), 2.0)
    assert np.degrees(angle) == pytest.approx(70.2, abs=0.05)
    q = np.array([0.0, float(angle), float(printed.theta_3(lengths, np.array(t), np.array(z), angle))])
    there = printed.foot_in_body(lengths, q, np.zeros(3))
    assert np.linalg.norm(there - [lengths.l1 + t, 0.0, z]) == pytest.approx(0.290, abs=1e-3)


def test_numbers_of_8_and_13(verdicts):
    eight, thirteen = verdicts["(8)"], verdicts["(13)"]
    assert figure(eight, "wrong inside ±70°") == 0
    assert figure(eight, "wrong outside ±70°") > 300
    assert figure(thirteen, "wrong with |θ₃| ≤ 90°") == 0
    assert figure(thirteen, "wrong with |θ₃| > 90°") > 300


def test_inverse_kinematics_on_all_branches(verdicts, context):
    claim = verdicts["claim: the inverse kinematics gives θ₁, θ₂ and θ₃"]
    assert figure(claim, "feet right as printed") == 0
    assert figure(claim, "angles, corrected, worst difference") < 1e-10
    found = inverse.branches_of(context)
    assert found.missed < 1e-12
    assert [check(context).state for check in inverse.CHECKS] == ["holds"]
    for branch, q in found.q.items():
        reached = found.reached[branch]
        assert reached.any(), branch
        assert (np.sign(q[reached][:, 2]) == (-1.0 if branch.endswith("negative") else 1.0)).all()


def test_facts_are_two_legs_of_other_lengths(context):
    first, second = facts.facts_of(context)
    assert len(set(second.lengths)) == 3
    assert second.mount[2] != 0.0
    np.testing.assert_allclose(first.q[0], POSE_4)
    assert first.inside[1 : facts.STATES + 1].all()
    assert not first.inside.all()
    for f in (first, second):
        own = (float(f.numbers.l1), float(f.numbers.l2), float(f.numbers.l3))
        np.testing.assert_allclose(f.lengths, own, atol=1e-15)


# ---------------------------------------------------------------------- verdicts can change


def test_a_wrong_forward_formula_is_not_confirmed(context, monkeypatch):
    right = printed.foot_in_body

    def wrong(lengths, q, mount, signs=printed.PLUS):
        return right(lengths, q, mount, (1.0, 1.0, 1.0, 1.0, -1.0, *signs[5:]))

    monkeypatch.setattr(printed, "foot_in_body", wrong)
    assert equations.equation_3(context).status is Status.NOT_REPRODUCIBLE


def test_a_right_12_would_be_confirmed(context, monkeypatch):
    monkeypatch.setitem(inverse.VARIANTS, "as printed", inverse.VARIANTS["corrected"])
    assert inverse.equation_12(context).status is Status.CONFIRMED


def test_another_defect_of_12_is_not_corrected(context, monkeypatch):
    right = printed.theta_2
    monkeypatch.setattr(printed, "theta_2", lambda lengths, *rest: right(lengths._replace(l3=1.1 * lengths.l3), *rest))
    assert inverse.equation_12(context).status is Status.NOT_REPRODUCIBLE


def test_a_right_13_would_be_confirmed(context, monkeypatch):
    def whole(lengths, t, z, theta2):
        along = printed.along_link_2(lengths, t, z, theta2)
        return np.arctan2(printed.across_link_2(t, z, theta2), along)

    monkeypatch.setattr(printed, "theta_3", whole)
    assert inverse.equation_13(context).status is Status.CONFIRMED


def test_a_table_for_other_frames_is_not_corrected(context, monkeypatch):
    right = printed.table_rows

    def mirrored(lengths):
        (a, alpha, d), *rest = right(lengths)
        return ((a, -alpha, d), *rest)

    monkeypatch.setattr(printed, "table_rows", mirrored)
    assert equations.table_1(context).status is Status.NOT_REPRODUCIBLE


def test_7_with_another_length_is_not_corrected(context, monkeypatch):
    right = printed.foot_from_link_1
    monkeypatch.setattr(
        printed, "foot_from_link_1", lambda pose, theta1, mount, length: right(pose, theta1, mount, 1.01 * length)
    )
    assert equations.equation_7(context).status is Status.NOT_REPRODUCIBLE


def test_signs_that_4_cannot_see(context):
    second = facts.facts_of(context)[1]
    assert equations.unseen_terms(second, slice(0, 1)) == ["l₃ c₂₃ c₁", "s₁ l₃ c₂₃", "s₁ l₂ c₂", "l₁ s₁"]
    assert equations.unseen_terms(second, slice(None)) == []
