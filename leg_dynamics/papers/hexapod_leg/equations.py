"""Equations (1)-(33) and Table 1 of Rong et al. 2012, each judged by numbers.

Every formula is held against `facts` that share nothing with it: the mechanism of the URDF+ file assembled numerically
and differences of its poses. An equation is confirmed if its printed form (`printed`) agrees. It is corrected if the
form of `closed_form.hexapod_leg` agrees instead and the printed form's defect is known: with the one repair that the
verdict names, it agrees too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from leg_dynamics.analysis.dexterity import conditioning
from leg_dynamics.papers.comparison import compare, flat
from leg_dynamics.papers.framework import Context, Figure, Verdict
from leg_dynamics.papers.hexapod_leg import printed, reported, study
from leg_dynamics.papers.hexapod_leg.facts import (
    RATE_TOLERANCE,
    Facts,
    facts_of,
    formula,
    formula_of_foot,
    preliminary,
    states,
    workspace_of,
)
from leg_dynamics.papers.hexapod_leg.trends import NAMES
from leg_dynamics.papers.judge import text, worst

__all__ = ["VERDICTS"]

Array = np.ndarray

ANGLE_TOLERANCE = 1e-7
"""rad; an arccosine near 1 keeps half of the digits."""


def _over(context: Context, what: str) -> str:
    return f"{what}, {len(states(context))} poses inside the limits of the final design"


def _each(vector: Array) -> Array:
    """A vector (N, 3) beside rates (N, 3, 3)."""
    return vector[:, None]


# ---------------------------------------------------------------------- position


def equation_1(context: Context) -> Verdict:
    """Rotation of the platform."""
    facts = facts_of(context)
    alpha, beta = facts.angle("alpha1"), facts.angle("beta1")
    return compare(
        "(1)",
        "Rotation of the platform by α about x, then β about p₁",
        _over(context, "rotation by the assembled joint angles"),
        "",
        printed.rotation(alpha, beta) - facts.platform,
        formula(context, "platform_rotation", alpha, beta, leg=False) - facts.platform,
        forms=("R = Rot(x, α) Rot(p₁, β) = [u p w]", ""),
    )


def equation_2(context: Context) -> Verdict:
    """Loop of strut 1."""
    facts = facts_of(context)
    return compare(
        "(2)",
        "Strut 1 ends in the foot B1",
        _over(context, "foot of the assembled mechanism"),
        "m",
        printed.foot_by_strut_1(facts.length(1), facts.w(1)) - facts.foot,
        formula(context, "foot_position", facts.q) - facts.foot,
        forms=("𝐥₁ = l₁ w₁", ""),
    )


def equation_3(context: Context) -> Verdict:
    """Loop of strut 2."""
    facts = facts_of(context)
    there = facts.e * facts.w(1)
    return compare(
        "(3)",
        "Loop A1-B0-B2-A2",
        _over(context, "B0 of the assembled mechanism"),
        "m",
        printed.hinge_by_strut_2(facts.hip(2), facts.length(2), facts.w(2), facts.b) - there,
        formula(context, "closure_residual", facts.q)[:, 3:6],
        note="b points towards A2, which the paper draws and does not print.",
        forms=("e w₁ = a₂ + l₂ w₂ − b", ""),
    )


def equation_4(context: Context) -> Verdict:
    """Loop of strut 3."""
    facts = facts_of(context)
    return compare(
        "(4)",
        "Loop A1-B1-B3-A3",
        _over(context, "foot of the assembled mechanism"),
        "m",
        printed.foot_by_strut_3(facts.hip(3), facts.length(3), facts.w(3), facts.c) - facts.foot,
        formula(context, "closure_residual", facts.q)[:, 6:],
        forms=("𝐥₁ = a₃ + l₃ w₃ − c", ""),
    )


def equation_5(context: Context) -> Verdict:
    """Length of strut 1."""
    facts = facts_of(context)
    return compare(
        "(5)",
        "Length of strut 1",
        _over(context, "length in the assembled mechanism"),
        "m",
        printed.length_1(facts.foot) - facts.length(1),
        formula(context, "strut_length_1", facts.foot, leg=False) - facts.length(1),
        forms=("l₁ = √(x² + y² + z²)", ""),
    )


def equation_6(context: Context) -> Verdict:
    """Length of strut 2."""
    facts = facts_of(context)
    return compare(
        "(6)",
        "Length of strut 2",
        _over(context, "length in the assembled mechanism"),
        "m",
        printed.length_2(facts.e, facts.w(1), facts.b, facts.hip(2)) - facts.length(2),
        formula(context, "strut_length_2", facts.foot) - facts.length(2),
        note="The bold e is a slip of type, it is a length; and l₂ w₂ has to stand alone in (3) before the norm is "
        "taken.",
        forms=("l₂ = ‖e w₁ + b − a₂‖, with a bold e", ""),
    )


def equation_7(context: Context) -> Verdict:
    """Length of strut 3."""
    facts = facts_of(context)
    return compare(
        "(7)",
        "Length of strut 3",
        _over(context, "length in the assembled mechanism"),
        "m",
        printed.length_3(facts.foot, facts.c, facts.hip(3)) - facts.length(3),
        formula(context, "strut_length_3", facts.foot) - facts.length(3),
        note="Here, too, l₃ w₃ has to stand alone first.",
        forms=("l₃ = ‖𝐥₁ + c − a₃‖", ""),
    )


def equation_8(context: Context) -> Verdict:
    """Direction of strut 1."""
    facts = facts_of(context)
    return compare(
        "(8)",
        "Direction of strut 1",
        _over(context, "axis of the assembled sleeve 1"),
        "",
        printed.direction(facts.foot, facts.length(1)) - facts.w(1),
        formula(context, "platform_direction", facts.foot, leg=False) - facts.w(1),
        forms=("w = w₁ = 𝐥₁ / l₁", ""),
    )


def equation_9(context: Context) -> Verdict:
    """The swapped angles."""
    facts = facts_of(context)
    alpha, beta = facts.angle("alpha1"), facts.angle("beta1")
    wrong = printed.angles(facts.w(1))
    own = formula(context, "platform_angles", facts.foot, leg=False)
    reached = workspace_of(context, context.leg).poses.foot
    length = np.linalg.norm(reached, axis=1)
    there = printed.foot_by_strut_1(length, printed.rotation(*printed.angles(reached / length[:, None]))[..., 2])
    missed = np.linalg.norm(there - reached, axis=1)
    return compare(
        "(9)",
        "Angles of strut 1 from its direction",
        _over(context, "angles of the assembled joints"),
        "rad",
        np.stack(wrong, axis=-1) - np.stack([alpha, beta], axis=-1),
        own - np.stack([alpha, beta], axis=-1),
        note=f"With the printed angles (1) and (2) put B1 up to {missed.max():.3f} m from where it is.",
        forms=("α = arcsin w_x,  β = arctan(−w_y / w_z)", "β = arcsin w_x,  α = atan2(−w_y, w_z)"),
        repair=(
            "the two names are exchanged",
            np.stack(wrong[::-1], axis=-1) - np.stack([alpha, beta], axis=-1),
        ),
        figures=[
            Figure("foot missed, worst", missed.max(), "m", f"{len(reached)} samples of the final design's workspace"),
            Figure("foot missed, mean", missed.mean(), "m", "the same samples"),
        ],
    )


# ---------------------------------------------------------------------- velocity


def _velocity(context: Context, item: str, title: str, difference: Array, rows: slice, form: str) -> Verdict:
    facts = facts_of(context)
    own = np.stack(
        [formula(context, "velocity_residual", facts.q, np.array(facts.rates[:, k]))[:, rows] for k in range(3)], axis=1
    )
    return compare(
        item,
        title,
        _over(context, "for unit rates of the struts, against differences of assembled poses"),
        "",
        difference,
        own,
        tolerance=RATE_TOLERANCE,
        forms=(form, ""),
    )


def equation_10(context: Context) -> Verdict:
    """Derivative of (2)."""
    f = facts_of(context)
    there = printed.velocity_by_strut_1(f.rates[..., 0], _each(f.w(1)), _each(f.length(1)), f.omega(1))
    return _velocity(
        context,
        "(10)",
        "Velocity of B1 along strut 1",
        there - f.v1,
        slice(0, 3),
        "v₁ = l̇₁ w₁ + l₁ ω₁ × w₁",
    )


def equation_11(context: Context) -> Verdict:
    """Derivative of (3)."""
    f = facts_of(context)
    there = printed.velocity_by_strut_2(
        f.rates[..., 1], _each(f.w(2)), _each(f.length(2)), f.omega(2), f.omega(1), _each(f.b)
    )
    return _velocity(
        context,
        "(11)",
        "Velocity of B0 along strut 2",
        there - f.e * np.cross(f.omega(1), _each(f.w(1))),
        slice(3, 6),
        "e ω₁ × w₁ = l̇₂ w₂ + l₂ ω₂ × w₂ − ω₁ × b",
    )


def equation_12(context: Context) -> Verdict:
    """Derivative of (4)."""
    f = facts_of(context)
    there = printed.velocity_by_strut_3(
        f.rates[..., 2], _each(f.w(3)), _each(f.length(3)), f.omega(3), f.omega(1), _each(f.c)
    )
    return _velocity(
        context,
        "(12)",
        "Velocity of B1 along strut 3",
        there - f.v1,
        slice(6, 9),
        "v₁ = l̇₃ w₃ + l₃ ω₃ × w₃ − ω₁ × c",
    )


def _of_twist(context: Context, item: str, title: str, printed_rate: Array, row: int, form: str) -> Verdict:
    facts = facts_of(context)
    own = formula_of_foot(context, "extension_rates_of_twist", facts.v1, facts.omega(1))[..., row]
    return compare(
        item,
        title,
        _over(context, "rate for unit rates of the struts, with v₁ and ω₁ from differences of assembled poses"),
        "",
        printed_rate - facts.rates[..., row],
        own - facts.rates[..., row],
        tolerance=RATE_TOLERANCE,
        forms=(form, ""),
    )


def equation_13(context: Context) -> Verdict:
    """Rate of strut 1."""
    f = facts_of(context)
    return _of_twist(context, "(13)", "Rate of strut 1", printed.rate_1(_each(f.w(1)), f.v1), 0, "l̇₁ = w₁ᵀ v₁")


def equation_14(context: Context) -> Verdict:
    """Rate of strut 2."""
    f = facts_of(context)
    return _of_twist(
        context,
        "(14)",
        "Rate of strut 2 from the angular velocity",
        printed.rate_2(f.e, _each(f.w(1)), _each(f.w(2)), _each(f.b), f.omega(1)),
        1,
        "e (w₁ × w₂)ᵀ ω₁ = l̇₂ − (b × w₂)ᵀ ω₁",
    )


def equation_15(context: Context) -> Verdict:
    """Rate of strut 3."""
    f = facts_of(context)
    return _of_twist(
        context,
        "(15)",
        "Rate of strut 3 from both velocities",
        printed.rate_3(_each(f.w(3)), _each(f.c), f.v1, f.omega(1)),
        2,
        "w₃ᵀ v₁ = l̇₃ − (c × w₃)ᵀ ω₁",
    )


def _twist_matrix(f: Facts) -> Array:
    return printed.twist_jacobian(f.e, f.w(1), f.w(2), f.w(3), f.b, f.c)


def equation_16(context: Context) -> Verdict:
    """Matrix of (13)-(15)."""
    f = facts_of(context)
    moved = np.concatenate([f.v1, f.omega(1)], axis=-1)
    own = formula(context, "twist_jacobian", f.foot)
    return compare(
        "(16)",
        "The struts' rates by the six velocities of the platform",
        _over(context, "3 × 6 matrix times the velocities for unit rates"),
        "",
        np.einsum("nij,nkj->nki", _twist_matrix(f), moved) - f.rates,
        np.einsum("nij,nkj->nki", own, moved) - f.rates,
        tolerance=RATE_TOLERANCE,
        forms=("l̇ = [w₁ᵀ 0; 0 e(w₁×w₂)ᵀ + (b×w₂)ᵀ; w₃ᵀ (c×w₃)ᵀ] [v₁; ω₁]", ""),
    )


def equation_17(context: Context) -> Verdict:
    """Short form of (16)."""
    f = facts_of(context)
    own = formula_of_foot(context, "extension_rates_of_twist", f.v1, f.omega(1))
    return compare(
        "(17)",
        "Short form of (16)",
        _over(context, "rates for unit rates"),
        "",
        printed.rates_of_twist(_each(_twist_matrix(f)), f.v1, f.omega(1)) - f.rates,
        own - f.rates,
        tolerance=RATE_TOLERANCE,
        note="[v₁ ω₁]ᵀ is meant as one column of six, not as two columns.",
        forms=("l̇ = J [v₁ ω₁]ᵀ, J ∈ R³ˣ⁶", ""),
    )


def equation_18(context: Context) -> Verdict:
    """Triple product."""
    f = facts_of(context)
    there = np.cross(_each(f.w(1)), f.v1)
    own = formula_of_foot(context, "platform_angular_velocity", f.v1)
    across = own - printed.times(printed.dot(own, _each(f.w(1))), _each(f.w(1)))
    return compare(
        "(18)",
        "What v₁ says of the angular velocity",
        _over(context, "for unit rates"),
        "",
        printed.swing(_each(f.length(1)), _each(f.w(1)), f.omega(1)) - there,
        printed.times(_each(f.length(1)), across) - there,
        tolerance=RATE_TOLERANCE,
        forms=("w₁ × v₁ = l₁ [ω₁ − (w₁ᵀ ω₁) w₁]", ""),
    )


def _spin(f: Facts) -> Array:
    """w1 · omega1 of the assembled mechanism for unit rates, (N, 3) rad/m."""
    return printed.dot(_each(f.w(1)), f.omega(1))


def equation_19(context: Context) -> Verdict:
    """The spin that is not zero."""
    f = facts_of(context)
    omega = f.omega(1)
    wrong = printed.angular_velocity(_each(f.length(1)), _each(f.w(1)), f.v1)
    own = formula_of_foot(context, "platform_angular_velocity", f.v1)
    spin = _spin(f)
    # The proximal axis is x and p is across it: omega1 = alpha' x + beta' p.
    by_alpha = omega[..., 0] * np.sin(f.angle("beta1"))[:, None]
    return compare(
        "(19)",
        "Angular velocity of strut 1",
        _over(context, "for unit rates of the struts, against differences of assembled poses"),
        "rad/m",
        wrong - omega,
        own - omega,
        tolerance=RATE_TOLERANCE,
        note=f"w₁ᵀ ω₁ = α̇ sin β (to {text(worst(by_alpha - spin))}), not 0: a U joint blocks the rotation about x × "
        "p, "
        "not the one about the strut.",
        forms=(
            "w₁ᵀ ω₁ = 0, ω₁ = (w₁ × v₁)/l₁",
            "w₁ᵀ ω₁ = α̇ sin β, ω₁ = (w₁ × v₁)/l₁ − (tan β / l₁)(pᵀ v₁) w₁",
        ),
        repair=("the spin (w₁ᵀ ω₁) w₁ is left out", wrong + printed.times(spin, _each(f.w(1))) - omega),
        figures=[
            Figure("largest spin", worst(spin), "rad/m", _over(context, "for unit rates of the struts")),
            Figure("largest angular velocity", np.linalg.norm(omega, axis=-1).max(), "rad/m", "the same motions"),
        ],
    )


def _of_velocity(
    context: Context,
    item: str,
    title: str,
    printed_rate: Array,
    row: int,
    forms: tuple[str, str],
    repair: tuple[str, Array | None] = ("", None),
    note: str = "",
    figures: tuple[Figure, ...] = (),
) -> Verdict:
    f = facts_of(context)
    there = f.rates[..., row]
    own = formula_of_foot(context, "extension_rates", f.v1)[..., row]
    explained = None if repair[1] is None else printed_rate + repair[1] - there
    return compare(
        item,
        title,
        _over(context, "rate for unit rates of the struts, with v₁ from differences of assembled poses"),
        "",
        printed_rate - there,
        own - there,
        tolerance=RATE_TOLERANCE,
        forms=forms,
        repair=(repair[0], explained),
        note=note,
        figures=figures,
    )


def equation_20(context: Context) -> Verdict:
    """Strut 2 by v1."""
    f = facts_of(context)
    along = worst(printed.dot(f.w(2), f.platform[..., 1]))
    return _of_velocity(
        context,
        "(20)",
        "Rate of strut 2 by v₁",
        printed.rate_2_of_velocity(f.e, _each(f.length(1)), _each(f.w(1)), _each(f.w(2)), _each(f.b), f.v1),
        1,
        ("(e/l₁)(w₁×w₂)ᵀ(w₁×v₁) = l̇₂ − (1/l₁)(b×w₂)ᵀ(w₁×v₁)", ""),
        note=f"The slip of (19) does not show here: strut 2 stays across p (to {text(along)}), so a spin about w₁ does "
        "not change its length.",
    )


def _spin_term(f: Facts) -> Array:
    """What the spin of strut 1 adds to the rate of strut 3, (N, 3)."""
    return printed.dot(_each(np.cross(f.c, f.w(3))), printed.times(_spin(f), _each(f.w(1))))


SPIN_DEFECT = "the spin of strut 1 that (19) leaves out turns c and with it B3"


def equation_21(context: Context) -> Verdict:
    """Strut 3 by v1."""
    f = facts_of(context)
    return _of_velocity(
        context,
        "(21)",
        "Rate of strut 3 by v₁",
        printed.rate_3_of_velocity(_each(f.length(1)), _each(f.w(1)), _each(f.w(3)), _each(f.c), f.v1),
        2,
        (
            "w₃ᵀ v₁ = l̇₃ − (1/l₁)(c×w₃)ᵀ(w₁×v₁)",
            "l̇₃ = w₃ᵀ v₁ + (1/l₁)(c×w₃)ᵀ(w₁×v₁) + (c tan β / l₁)(w₃ᵀ u) pᵀ v₁",
        ),
        (SPIN_DEFECT, _spin_term(f)),
    )


def _dropped_row(f: Facts) -> Array:
    """The row that (22) drops from (20), (N, 3)."""
    return printed.times(f.e / f.length(1), f.w(2) - printed.times(printed.dot(f.w(1), f.w(2)), f.w(1)))


def equation_22(context: Context) -> Verdict:
    """Strut 2 by v1, simplified."""
    f = facts_of(context)
    return _of_velocity(
        context,
        "(22)",
        "Rate of strut 2 by v₁, simplified",
        printed.simplified_rate_2(_each(f.length(1)), _each(f.w(1)), _each(f.w(2)), _each(f.b), f.v1),
        1,
        ("l̇₂ = −(1/l₁)(w₂ᵀw₁) bᵀ v₁", "l̇₂ = {−(1/l₁)(w₂ᵀw₁) bᵀ + (e/l₁)[w₂ − (w₁ᵀw₂) w₁]ᵀ} v₁"),
        (
            "the left side of (20), the term with e, is dropped",
            printed.dot(_each(_dropped_row(f)), f.v1),
        ),
        note="As printed, strut 2 of a leg with b = 0 would never move.",
    )


def equation_23(context: Context) -> Verdict:
    """Strut 3 by v1, simplified."""
    f = facts_of(context)
    return _of_velocity(
        context,
        "(23)",
        "Rate of strut 3 by v₁, simplified",
        printed.simplified_rate_3(_each(f.length(1)), _each(f.w(1)), _each(f.w(3)), _each(f.c), f.v1),
        2,
        (
            "l̇₃ = w₃ᵀ v₁ − (1/l₁)(w₃ᵀw₁) cᵀ v₁",
            "l̇₃ = w₃ᵀ v₁ − (1/l₁)(w₃ᵀw₁) cᵀ v₁ + (c tan β / l₁)(w₃ᵀ u) pᵀ v₁",
        ),
        (SPIN_DEFECT, _spin_term(f)),
    )


def equation_24(context: Context) -> Verdict:
    """Velocity Jacobian."""
    f = facts_of(context)
    there = f.inverse_jacobian
    wrong = printed.jacobian(f.length(1), f.w(1), f.w(2), f.w(3), f.b, f.c)
    mended = np.array(wrong)
    mended[:, 1] += _dropped_row(f)
    # The spin by v1 instead of by the struts' rates: the same motions, so another basis.
    mended[:, 2] += np.einsum("nk,nkj->nj", _spin_term(f), there)
    everywhere = study.printed_jacobian(context.numbers, workspace_of(context, context.leg).poses.foot)
    exact = study.exact_jacobian(context, context.numbers, workspace_of(context, context.leg).poses.foot)
    off = np.abs(everywhere - exact).max(axis=0)
    return compare(
        "(24)",
        "Jacobian of the struts' rates by v₁",
        _over(context, "entries, against the inverse of differences of assembled poses"),
        "",
        wrong - there,
        formula(context, "inverse_jacobian", f.foot) - there,
        # The inverse multiplies the error of the differences by its entries, which are below 1.5.
        tolerance=10.0 * RATE_TOLERANCE,
        note=f"In the initial pose ∂l₂/∂x is {wrong[0, 1, 0]:.4f} printed and {there[0, 1, 0]:.4f} true. Over the "
        f"workspace row 2 is off by up to {off[1].max():.3f}, row 3 by {text(off[2].max())}.",
        forms=(
            "J_v = [w₁ᵀ; −(1/l₁)(w₂ᵀw₁) bᵀ; w₃ᵀ − (1/l₁)(w₃ᵀw₁) cᵀ]",
            "row 2 + (e/l₁)[w₂ − (w₁ᵀw₂) w₁]ᵀ, row 3 + (c tan β / l₁)(w₃ᵀ u) pᵀ",
        ),
        repair=("row 2 lacks the term of e that (20) has, row 3 the spin that (19) lacks", mended - there),
        figures=[
            Figure("∂l₂/∂x as printed", wrong[0, 1, 0], "", "initial pose of the final design"),
            Figure("∂l₂/∂x of the mechanism", there[0, 1, 0], "", "initial pose of the final design"),
            Figure("row 2, largest error of an entry", off[1].max(), "", "samples of the final design's workspace"),
            Figure("row 3, largest error of an entry", off[2].max(), "", "samples of the final design's workspace"),
            Figure("row 1, largest error of an entry", off[0].max(), "", "samples of the final design's workspace"),
        ],
    )


def equation_25(context: Context) -> Verdict:
    """Short form of (24)."""
    f = facts_of(context)
    exact = formula(context, "inverse_jacobian", f.foot)
    own = formula_of_foot(context, "extension_rates", f.v1)
    return compare(
        "(25)",
        "The struts' rates are a 3 × 3 matrix times v₁",
        _over(context, "rates for unit rates, with the corrected matrix of (24)"),
        "",
        printed.rates(_each(exact), f.v1) - f.rates,
        own - f.rates,
        tolerance=RATE_TOLERANCE,
        note="The relation holds; the matrix that (24) prints for it does not.",
        forms=("l̇ = J_v v₁, J_v ∈ R³ˣ³", ""),
    )


# ---------------------------------------------------------------------- workspace and dexterity


def equation_26(context: Context) -> Verdict:
    """Limits of the lengths."""
    lower, upper = context.limits
    q = 0.25 + 0.75 * context.rng(20).random((2000, 3))
    there = ((q >= lower) & (q <= upper)).all(axis=1)
    shared = printed.lengths_allowed(q, lower[0], upper[0])
    own_pairs = printed.lengths_allowed(q, lower, upper)
    margins = np.stack(
        [np.asarray(each) for each in context.formulas.strut_margins(tuple(q.T), tuple(lower), tuple(upper))]
    )
    first, second = reported.FINAL, reported.PRELIMINARY
    spread = max(
        max(given[f"l{i}_{end}"] for i in (1, 2, 3)) - min(given[f"l{i}_{end}"] for i in (1, 2, 3))
        for given in (first, second)
        for end in ("min", "max")
    )
    return compare(
        "(26)",
        "Limits of the struts' lengths",
        f"share of {len(q)} random lengths between 0.25 and 1 m that the file's limits judge otherwise",
        "",
        float(np.mean(shared != there)),
        float(np.mean((margins.min(axis=0) >= 0.0) != there)),
        tolerance=0.0,
        note=f"The limits printed later differ between the struts by up to {1e3 * spread:.0f} mm.",
        forms=("l_min ≤ l_i ≤ l_max", "l_i,min ≤ l_i ≤ l_i,max"),
        repair=("one pair of limits for all struts, here that of struts 1 and 3", float(np.mean(own_pairs != there))),
        figures=[Figure("spread of the limits", spread, "m", "sections 4.1 and 6.1, as printed")],
    )


def _cone(context: Context, facts: Facts) -> tuple[Array, Array, Array]:
    """Axis of the ball's seat on the platform and of strut 3, and the angle between them, in the file's mechanism."""
    (cone,) = context.leg.description.cones
    seat = facts.mechanism.rotation(cone.other_link) @ np.asarray(cone.other_axis, dtype=float)
    seat = seat / np.linalg.norm(seat, axis=-1, keepdims=True)
    strut = facts.mechanism.rotation(cone.link) @ np.asarray(cone.axis, dtype=float)
    angle = np.arctan2(np.linalg.norm(np.cross(seat, strut), axis=-1), printed.dot(seat, strut))
    return seat, strut, angle


def equation_27(context: Context) -> Verdict:
    """Angle of the ball."""
    facts = facts_of(context)
    seat, strut, angle = _cone(context, facts)
    vector = printed.times(facts.length(3), strut)
    h = context.leg.parameters["h"].value
    normal = facts.platform[..., 2]
    at_home = np.degrees(printed.ball_angle(normal[:1], strut[:1]))[0]
    early = preliminary(context)
    a, c, h_early = (early.parameters[n].value for n in ("a", "c", "h"))
    other = np.degrees(np.arctan2(a - c, h_early))
    poses = workspace_of(context, context.leg).poses
    used = np.degrees(formula(context, "ball_angle", poses.q, h))
    only_unit = printed.ball_angle(normal, strut)
    turned = angle > 1e-3  # in the initial pose rounding may take the cosine beyond 1
    return compare(
        "(27)",
        "Angle of the ball joint",
        _over(context, "against the angle between the seat and strut 3 in the assembled mechanism"),
        "rad",
        printed.ball_angle(normal, vector) - angle,
        formula(context, "ball_angle", facts.q, h) - angle,
        tolerance=ANGLE_TOLERANCE,
        note=f"Divided by ‖𝐥₃‖ but measured from the platform's normal, the initial angle is {at_home:.2f}° "
        "(preliminary "
        f"design {other:.2f}°), not 0. Measured from strut 3's own initial direction it stays below "
        f"{used.max():.1f}° in the workspace: 35° never binds.",
        forms=("η_b = arccos(q₃ · 𝐥₃)", "η_b = arccos(q₃ · 𝐥₃ / ‖𝐥₃‖), q₃ along strut 3 in the initial pose"),
        repair=(
            "𝐥₃ has to be a unit vector, and q₃ tilted so that the initial angle is 0 as the sentence before asks",
            printed.ball_angle(seat[turned], strut[turned]) - angle[turned],
        ),
        figures=[
            Figure("initial angle from the platform's normal", at_home, "deg", "final design"),
            Figure("initial angle from the platform's normal, preliminary", other, "deg", "atan((a − c)/h)"),
            Figure("largest angle used", used.max(), "deg", f"{len(poses)} samples of the workspace"),
            Figure("printed with the normal, unit vector only, worst", worst(only_unit - angle), "rad", "same poses"),
        ],
    )


def equation_28(context: Context) -> Verdict:
    """Limits of the U joints."""
    names = [f"{name}{i}" for i in (1, 2, 3) for name in ("alpha", "beta")]
    limits = [context.leg.description.joint(name).limits for name in names]
    angle = np.radians(180.0) * (context.rng(21).random((2000, len(names))) - 0.5)
    there = np.stack([(angle[:, k] >= x.lower) & (angle[:, k] <= x.upper) for k, x in enumerate(limits)], axis=-1)
    upper = np.array([x.upper for x in limits])
    facts = facts_of(context)
    given = np.stack([facts.angle(name) for name in names], axis=-1)
    own = formula(context, "universal_margins", facts.q, float(upper[0]))
    true = np.minimum(given - [x.lower for x in limits], upper - given)
    return compare(
        "(28)",
        "Limits of the U joints' angles",
        f"share of {angle.size} random angles within ±90° that the file's limits judge otherwise",
        "",
        float(np.mean(printed.angle_allowed(angle, upper) != there)),
        # Margins in rad: the file's rounding of 60 deg.
        float(np.where(np.abs(own - true) <= ANGLE_TOLERANCE, 0.0, np.abs(own - true)).max()),
        tolerance=0.0,
        forms=("α_i ≤ α_max, β_i ≤ β_max", "|α_i| ≤ α_max, |β_i| ≤ β_max"),
        repair=(
            "without the absolute value half of the range has no limit",
            float(np.mean(printed.angle_allowed(np.abs(angle), upper) != there)),
        ),
    )


LIMITS = ("l1_min", "l2_min", "l3_min", "l1_max", "l2_max", "l3_max")


def _depends(changes: Mapping[str, float], noise: float) -> tuple[str, ...]:
    return tuple(name for name, change in changes.items() if change > noise)


def _names(used: tuple[str, ...]) -> str:
    ranges = {"universal_range": "the U joints' range", "ball_range": "the ball's range"}
    return ", ".join((NAMES | ranges)[name] for name in used)


def _missing(used: tuple[str, ...], listed: tuple[str, ...]) -> list[str]:
    """Parameters used that a list leaves out; ``l_min`` and ``l_max`` there stand for those of every strut."""
    covered = set(listed) | {name for name in LIMITS if f"l_{name[3:]}" in listed}
    return [name for name in used if name not in covered]


def equation_29(context: Context) -> Verdict:
    """Arguments of L and Z."""
    changes = study.step_sensitivity(context)
    used = _depends(changes, study.LENGTH_NOISE)
    missing = _missing(used, printed.STEP_ARGUMENTS)
    whole = tuple(dict.fromkeys((*printed.STEP_ARGUMENTS[:-1], "l_min")))
    read_as_min = (*printed.STEP_ARGUMENTS[:-2], "l_min", "l_max")
    return compare(
        "(29)",
        "What the indices L and Z depend on",
        "parameters that L or Z depends on and that the list leaves out",
        "",
        float(len(missing)),
        float(len(_missing(used, whole))),
        tolerance=0.0,
        note=f"L or Z changes with {_names(used)}; with none of the others (the ball's range among them). η_β is "
        "meant as η_b.",
        forms=("S_L,H = f(a, b, c, e, η_β max, α_max, β_max, l_i max, l_i max)", "... η_b max, ..., l_i min, l_i max)"),
        repair=("l_i max stands twice and l_i min not at all", float(len(_missing(used, read_as_min)))),
        figures=[
            Figure(f"change with {name}", change, "m", "L or Z, of the preliminary design; one parameter moved")
            for name, change in changes.items()
        ],
    )


def equation_30(context: Context) -> Verdict:
    """Condition number."""
    f = facts_of(context)
    k = printed.condition_number(f.inverse_jacobian)
    there = conditioning(f.mechanism.velocity("foot")).condition
    own = np.asarray(
        context.formulas.condition_number(
            tuple(tuple(row) for row in np.moveaxis(formula(context, "inverse_jacobian", f.foot), 0, -1))
        )
    )
    return compare(
        "(30)",
        "Condition number of the Jacobian",
        _over(context, "relative difference to that of the inverse matrix, which has the same"),
        "",
        k / there - 1.0,
        own / there - 1.0,
        tolerance=1e-6,
        forms=("k = σ_max / σ_min", ""),
    )


def _weighted(context: Context) -> tuple[Array, Array]:
    """Condition numbers and volumes of samples over the angles and the length of strut 1, final design."""
    return study.condition_numbers(context, study.design_of(context.leg))


def equation_31(context: Context) -> Verdict:
    """Mean of the condition number."""
    found = workspace_of(context, context.leg)
    k, dS = _weighted(context)
    mean = printed.mean(k, dS)
    own, _ = context.formulas.mean_condition_number(k, dS)
    noise = found.mean.half_width + study.measure(context, study.design_of(context.leg)).mean.half_width
    return compare(
        "(31)",
        "Mean condition number over the workspace",
        f"samples over α, β and l₁ against samples over l₁, l₂ and l₃ of the workspace ({found.sampled} of them)",
        "",
        mean - found.mean.value,
        own - found.mean.value,
        tolerance=noise,
        note=f"Both sets of samples give {mean:.3f} and {found.mean.value:.3f} for the final design; the difference is "
        f"within their 99 % intervals, {noise:.3f} together.",
        forms=("k̄ = ∫_S k dS / S", ""),
        figures=[Figure("mean condition number", mean, "", "final design")],
    )


def equation_32(context: Context) -> Verdict:
    """Deviation of the condition number."""
    found = workspace_of(context, context.leg)
    k, dS = _weighted(context)
    in_m, in_mm = printed.deviation(k, dS), printed.deviation(k, 1e9 * dS)
    _, own = context.formulas.mean_condition_number(k, dS)
    _, own_mm = context.formulas.mean_condition_number(k, 1e9 * dS)
    size = float(np.sum(dS))
    there = found.deviation.value
    noise = found.deviation.half_width + study.measure(context, study.design_of(context.leg)).deviation.half_width
    return compare(
        "(32)",
        "Deviation of the condition number over the workspace",
        "against the deviation of the workspace's own samples, and the same with lengths in mm",
        "",
        [in_m - there, in_mm - there],
        [own - there, own_mm - there],
        tolerance=noise,
        note=f"As printed it has the dimension of 1/√S: {in_m:.2f} with lengths in m, {in_mm:.2g} in mm, for a "
        f"deviation of {own:.2f}.",
        forms=("k̃ = √(∫_S (k − k̄)² dS) / S", "k̃ = √(∫_S (k − k̄)² dS / S)"),
        repair=(
            "S belongs under the root; times √S the printed value is the deviation in either unit",
            [in_m * np.sqrt(size) - there, in_mm * np.sqrt(1e9 * size) - there],
        ),
        figures=[
            Figure("printed, lengths in m", in_m, "m^-1.5", "final design"),
            Figure("printed, lengths in mm", in_mm, "mm^-1.5", "final design"),
            Figure("deviation", own, "", "final design"),
        ],
    )


def equation_33(context: Context) -> Verdict:
    """Arguments of the indices of dexterity."""
    changes = study.dexterity_sensitivity(context)
    noise = study.sensitivity_noise(context)
    used = tuple(name for name in _depends(changes, noise) if name in LIMITS)
    listed = [name for name in printed.DEXTERITY_ARGUMENTS if name in ("l_min", "l_max")]
    per_strut = ("l_min", "l_max")
    return compare(
        "(33)",
        "What the indices of dexterity depend on",
        "limits of lengths that k̄ or k̃ depends on, beyond the two that the list names",
        "",
        float(max(0, len(used) - len(listed))),
        float(len(_missing(used, per_strut))),
        tolerance=0.0,
        note=f"k̄ or k̃ changes with {_names(used)}, each by itself. η_β is meant as η_b.",
        forms=("K = g(a, b, c, e, η_β max, α_max, β_max, l_min, l_max)", "..., l_i min, l_i max), one pair a strut"),
        repair=(
            "the index of l_min and l_max is left out; with it the list has every limit",
            float(len(_missing(used, tuple(listed)))),
        ),
        figures=[
            Figure(f"change with {name}", change, "", "k̄ or k̃, relative; one parameter of the preliminary design moved")
            for name, change in changes.items()
        ],
    )


# ---------------------------------------------------------------------- table


def table_1(context: Context) -> Verdict:
    """Table 1 against section 6.1 and the file."""
    values = {name: each.value for name, each in context.leg.parameters.items()}
    early = {name: each.value for name, each in preliminary(context).parameters.items()}
    against_text = [reported.TABLE_1[name] - reported.FINAL[name] for name in reported.TABLE_1]
    against_file = [reported.TABLE_1[name] - values[name] for name in reported.TABLE_1]
    tubes = [
        given[k] - values[f"{name}_{what}"]
        for name, given in reported.TUBES.items()
        for k, what in enumerate(("length", "diameter", "wall"))
    ]
    sets = [reported.FINAL[name] - values[name] for name in reported.FINAL]
    sets += [reported.PRELIMINARY[name] - early[name] for name in reported.PRELIMINARY if name in early]
    room = {
        1: reported.TUBES["sleeve_13"][0] + reported.TUBES["rod_13"][0] - reported.FINAL["l1_max"],
        2: reported.TUBES["sleeve_2"][0] + reported.TUBES["rod_2"][0] - reported.FINAL["l2_max"],
    }
    bore = {n: reported.TUBES[f"sleeve_{n}"][1] - 2.0 * reported.TUBES[f"sleeve_{n}"][2] for n in ("13", "2")}
    play = min(bore[n] - reported.TUBES[f"rod_{n}"][1] for n in bore)
    mass = float(sum(np.asarray(body.mass, dtype=float) for body in context.numbers.bodies))
    return compare(
        "Table 1",
        "Lengths of the leg and its tubes",
        "table against section 6.1, and both against the parameters of the leg's file",
        "m",
        flat([against_text, against_file, tubes]),
        flat([sets]),
        kind="table",
        tolerance=1e-12,
        note=f"The table agrees with the text. The rods fit into the sleeves with {1e3 * play:.0f} mm to spare; at "
        "full "
        f"length they overlap by {1e3 * room[1]:.0f} mm (struts 1 and 3) and {1e3 * room[2]:.0f} mm (strut 2). It "
        f"gives neither material nor drives: in steel the moving parts weigh {mass:.1f} kg, pins and link bars "
        "assumed.",
        figures=[
            Figure("overlap at full length, struts 1 and 3", room[1], "m", "sleeve + rod − l_max, as printed"),
            Figure("overlap at full length, strut 2", room[2], "m", "sleeve + rod − l_max, as printed"),
            Figure("play of a rod in its sleeve", play, "m", "bore less the rod's diameter"),
            Figure("mass of the moving parts", mass, "kg", "steel, crosses and link bars assumed"),
        ],
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (
    equation_1,
    equation_2,
    equation_3,
    equation_4,
    equation_5,
    equation_6,
    equation_7,
    equation_8,
    equation_9,
    equation_10,
    equation_11,
    equation_12,
    equation_13,
    equation_14,
    equation_15,
    equation_16,
    equation_17,
    equation_18,
    equation_19,
    equation_20,
    equation_21,
    equation_22,
    equation_23,
    equation_24,
    equation_25,
    equation_26,
    equation_27,
    equation_28,
    equation_29,
    equation_30,
    equation_31,
    equation_32,
    equation_33,
    table_1,
)
"""One function an item, in the paper's order."""
