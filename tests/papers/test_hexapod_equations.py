"""Verdicts on the equations of the hexapod leg's paper: complete, computed, and able to change."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.hexapod_leg import equations, facts, printed, study

CORRECTED = {"(9)", "(19)", "(21)", "(22)", "(23)", "(24)", "(26)", "(27)", "(28)", "(29)", "(32)", "(33)"}

FUNCTION = {
    "(1)": "rotation",
    "(2)": "foot_by_strut_1",
    "(3)": "hinge_by_strut_2",
    "(4)": "foot_by_strut_3",
    "(5)": "length_1",
    "(6)": "length_2",
    "(7)": "length_3",
    "(8)": "direction",
    "(9)": "angles",
    "(10)": "velocity_by_strut_1",
    "(11)": "velocity_by_strut_2",
    "(12)": "velocity_by_strut_3",
    "(13)": "rate_1",
    "(14)": "rate_2",
    "(15)": "rate_3",
    "(16)": "twist_jacobian",
    "(17)": "rates_of_twist",
    "(18)": "swing",
    "(19)": "angular_velocity",
    "(20)": "rate_2_of_velocity",
    "(21)": "rate_3_of_velocity",
    "(22)": "simplified_rate_2",
    "(23)": "simplified_rate_3",
    "(24)": "jacobian",
    "(25)": "rates",
    "(26)": "lengths_allowed",
    "(27)": "ball_angle",
    "(28)": "angle_allowed",
    "(30)": "condition_number",
    "(31)": "mean",
    "(32)": "deviation",
}
VERDICT = {f"({n})": getattr(equations, f"equation_{n}") for n in range(1, 34)} | {"Table 1": equations.table_1}
CLOSED_FORM = {
    "(9)": "platform_angles",
    "(19)": "platform_angular_velocity",
    "(21)": "extension_rates",
    "(22)": "extension_rates",
    "(23)": "extension_rates",
    "(24)": "inverse_jacobian",
    "(27)": "ball_angle",
}


@functools.cache
def known():
    context = Context("hexapod_leg")
    facts.facts_of(context)
    facts.workspace_of(context, context.leg)
    facts.preliminary_workspace(context)
    return context


KEPT = ("hexapod: states", "hexapod: facts", "hexapod: preliminary leg", "hexapod: workspace of")


def fresh():
    """A context that knows the assembled mechanism and the workspace of the analysis room, and no formula's result."""
    old = known()
    context = Context("hexapod_leg", shared={k: v for k, v in old.shared.items() if k.startswith(KEPT)})
    context.__dict__.update(leg=old.leg, pinocchio=old.pinocchio, numbers=old.numbers)
    return context


@pytest.fixture(scope="module")
def verdicts():
    context = fresh()
    return {verdict.item: verdict for verdict in (function(context) for function in equations.VERDICTS)}


def figure(verdict, name):
    return next(f.value for f in verdict.figures if f.name == name)


def distorted(value, factor=1.07):
    """What a formula returns, changed."""
    if isinstance(value, tuple):
        return tuple(distorted(part, factor) for part in value)
    if np.asarray(value).dtype == bool:
        return ~np.asarray(value)
    return factor * value + 0.01


# ---------------------------------------------------------------------- the whole list


def test_every_equation_and_the_table_have_a_verdict_in_order(verdicts):
    assert list(verdicts) == [f"({n})" for n in range(1, 34)] + ["Table 1"]
    assert {verdict.kind for verdict in verdicts.values()} == {"equation", "table"}


def test_every_verdict_has_figures_and_says_something(verdicts):
    for verdict in verdicts.values():
        assert verdict.figures, verdict.item
        assert verdict.finding.endswith("."), verdict.item
        assert "nan" not in verdict.finding.lower(), verdict.item
        assert all(math.isfinite(f.value) for f in verdict.figures), verdict.item
        assert verdict.printed or verdict.kind == "table", verdict.item


def test_the_corrected_set(verdicts):
    assert {item for item, verdict in verdicts.items() if verdict.status is Status.CORRECTED} == CORRECTED
    assert {v.status for item, v in verdicts.items() if item not in CORRECTED} == {Status.CONFIRMED}


@pytest.mark.parametrize("item", sorted(CORRECTED))
def test_corrected_items_really_differ_and_show_both_forms(verdicts, item):
    verdict = verdicts[item]
    assert figure(verdict, "printed form, worst difference") > 1e-3
    left = figure(verdict, "printed form, left after the one repair")
    assert left < 1e-6 if item != "(32)" else left < 0.02
    assert "The defect: " in verdict.finding
    assert verdict.corrected
    assert verdict.corrected != verdict.printed


def test_a_second_run_gives_the_same(verdicts):
    context = fresh()
    for function in (equations.equation_9, equations.equation_24, equations.equation_29, equations.equation_32):
        again = function(context)
        assert again.to_dict() == verdicts[again.item].to_dict()


# ---------------------------------------------------------------------- numbers known otherwise


def test_numbers_of_the_jacobian(verdicts):
    # In the initial pose strut 2 leans by beta_2: w2 = (sin, 0, cos), so the row is -(b/l1) cos beta_2 and, with the
    # dropped term, + (e/l1) sin beta_2.
    h, a, b, e = 0.715, 0.2, 0.07, 0.45
    lean = math.atan2(b - a, e)
    as_printed = -b / h * math.cos(lean)
    true = as_printed + e / h * math.sin(lean)
    assert figure(verdicts["(24)"], "∂l₂/∂x as printed") == pytest.approx(as_printed, abs=1e-9)
    assert figure(verdicts["(24)"], "∂l₂/∂x of the mechanism") == pytest.approx(true, abs=1e-9)
    assert (as_printed, true) == pytest.approx((-0.0941, -0.2687), abs=5e-5)
    assert figure(verdicts["(24)"], "row 1, largest error of an entry") < 1e-12
    assert 0.2 < figure(verdicts["(24)"], "row 2, largest error of an entry") < 0.3
    assert 0.01 < figure(verdicts["(24)"], "row 3, largest error of an entry") < 0.02


def test_jacobian_at_the_audits_point():
    context = fresh()
    J = study.exact_jacobian(context, context.numbers, np.array([[0.25, 0.2, 0.65]]))[0]
    expected = [[0.3450, 0.2760, 0.8971], [-0.2587, 0.0280, 0.0909], [0.3653, 0.0060, 0.9479]]
    np.testing.assert_allclose(J, expected, atol=5e-5)


def test_numbers_of_the_ball(verdicts):
    assert figure(verdicts["(27)"], "initial angle from the platform's normal") == pytest.approx(
        math.degrees(math.atan2(0.15, 0.715)), abs=1e-6
    )
    assert figure(verdicts["(27)"], "initial angle from the platform's normal, preliminary") == pytest.approx(
        math.degrees(math.atan2(0.15, 0.7)), abs=1e-6
    )
    assert figure(verdicts["(27)"], "largest angle used") < 20.0


def test_dimension_of_the_deviation(verdicts):
    in_m, in_mm = (figure(verdicts["(32)"], f"printed, lengths in {unit}") for unit in ("m", "mm"))
    assert in_m / in_mm == pytest.approx(10.0**4.5, rel=1e-9)
    assert in_m == pytest.approx(3.5, abs=0.05)
    assert figure(verdicts["(32)"], "deviation") == pytest.approx(2.24, rel=0.01)


def test_numbers_of_table_1(verdicts):
    assert figure(verdicts["Table 1"], "overlap at full length, strut 2") == pytest.approx(0.02)
    assert figure(verdicts["Table 1"], "overlap at full length, struts 1 and 3") == pytest.approx(0.1)


# ---------------------------------------------------------------------- verdicts can change


@pytest.mark.parametrize("item", sorted(FUNCTION, key=lambda item: int(item.strip("()"))))
def test_another_printed_form_is_neither_confirmed_nor_corrected(monkeypatch, item):
    right = getattr(printed, FUNCTION[item])
    monkeypatch.setattr(printed, FUNCTION[item], lambda *arguments: distorted(right(*arguments)))
    assert VERDICT[item](fresh()).status is Status.NOT_REPRODUCIBLE


@pytest.mark.parametrize("item", sorted((CORRECTED - {"(29)", "(33)", "(26)", "(28)"}) | {"(14)", "(16)", "(31)"}))
def test_a_printed_form_of_zeros_is_not_corrected(monkeypatch, item):
    right = getattr(printed, FUNCTION[item])
    monkeypatch.setattr(printed, FUNCTION[item], lambda *arguments: distorted(right(*arguments), 0.0))
    assert VERDICT[item](fresh()).status is Status.NOT_REPRODUCIBLE


@pytest.mark.parametrize("item", sorted(CLOSED_FORM))
def test_a_wrong_corrected_form_is_no_correction(monkeypatch, item):
    context = fresh()
    right = getattr(context.formulas, CLOSED_FORM[item])
    monkeypatch.setattr(context.formulas, CLOSED_FORM[item], lambda *arguments: distorted(right(*arguments)))
    assert VERDICT[item](context).status is Status.NOT_REPRODUCIBLE


def test_right_forms_in_print_would_be_confirmed(monkeypatch):
    right = printed.angles
    monkeypatch.setattr(printed, "angles", lambda w: right(w)[::-1])
    assert equations.equation_9(fresh()).status is Status.CONFIRMED
    monkeypatch.setattr(printed, "deviation", lambda k, dS: float(np.sqrt(np.sum((k - 9.18) ** 2 * dS) / np.sum(dS))))
    assert equations.equation_32(fresh()).status is Status.CONFIRMED
    monkeypatch.setattr(printed, "angle_allowed", lambda angle, limit: np.abs(angle) <= limit)
    assert equations.equation_28(fresh()).status is Status.CONFIRMED
    whole = ("a", "b", "c", "e", "ball_range", "universal_range", "l_min", "l_max")
    monkeypatch.setattr(printed, "STEP_ARGUMENTS", whole)
    assert equations.equation_29(fresh()).status is Status.CONFIRMED


def test_a_list_without_a_length_is_not_corrected(monkeypatch):
    monkeypatch.setattr(printed, "STEP_ARGUMENTS", tuple(n for n in printed.STEP_ARGUMENTS if n != "a"))
    assert equations.equation_29(fresh()).status is Status.NOT_REPRODUCIBLE


class Stretched:
    """The mechanism with its foot off and its passive angles stretched."""

    def __init__(self, mechanism):
        self._mechanism = mechanism

    def __getattr__(self, name):
        return getattr(self._mechanism, name)

    def position(self, link, point=(0.0, 0.0, 0.0)):
        p = np.array(self._mechanism.position(link, point))
        return p + np.array([0.01, 0.0, 0.0]) if link == "foot" else p

    def velocity(self, link, point=(0.0, 0.0, 0.0)):
        return 1.1 * self._mechanism.velocity(link, point)

    def angle(self, joint):
        return 1.1 * self._mechanism.angle(joint) + 0.01


@pytest.mark.parametrize(
    "item", ["(1)", "(2)", "(4)", "(5)", "(7)", "(9)", "(10)", "(13)", "(15)", "(19)", "(22)", "(24)"]
)
def test_another_mechanism_changes_the_verdict(item):
    context = fresh()
    context.shared["hexapod: facts"] = facts.Facts(Stretched(facts.facts_of(context).mechanism))
    assert VERDICT[item](context).status is Status.NOT_REPRODUCIBLE
