"""Equations (1)-(11) and Table 1 of Chen & Dong 2021, each judged by numbers; (12) and (13) are in `inverse`.

Every formula is held against `facts` that share nothing with it: the foot by the modules of the URDF+ files. An
equation is confirmed if its printed form (`printed`) agrees. It is corrected if the form of
`closed_form.quadruped_leg` agrees instead and the printed form's defect is known: with the one repair that the verdict
names, it agrees too.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leg_dynamics.papers.comparison import compare
from leg_dynamics.papers.framework import Context, Figure, Verdict
from leg_dynamics.papers.judge import text, worst
from leg_dynamics.papers.quadruped import printed, reported
from leg_dynamics.papers.quadruped.facts import Facts, every, facts_of, formula, hip_in_body, mount_of_iv, wrapped

__all__ = ["VERDICTS", "over", "unseen_terms"]

Array = np.ndarray


def over(context: Context, what: str) -> str:
    """What is compared, and over which states."""
    counts = " and ".join(str(len(facts.q)) for facts in facts_of(context))
    return f"{what}, {counts} poses of two legs of other lengths, half of them inside ±70°"


# ---------------------------------------------------------------------- forward kinematics


def equation_1(context: Context) -> Verdict:
    """The hip in the body."""
    mount = mount_of_iv(context)
    hips = {leg: hip_in_body(context, leg) for leg in sorted(reported.ORDER)}
    own = np.array(context.formulas.transform_hip_to_body(tuple(mount)), dtype=float)
    turned = {leg: worst(printed.hip_to_body(hip[:3, 3]) - hip) for leg, hip in hips.items()}
    others = [leg for leg, off in turned.items() if off > 0.5]
    return compare(
        "(1)",
        "Hip of leg IV in the body",
        "pose of leg IV's hip in the robot's file of ten modules",
        "",
        printed.hip_to_body(mount) - hips["IV"],
        own - hips["IV"],
        note=f"It is written for leg IV. Legs {' and '.join(others)} on the other side point the other way and need a "
        "half-turn about z in it. a, b and c have no values in the paper; the file has "
        + ", ".join(f"{1e3 * value + 0.0:.4g}" for value in mount)
        + " mm.",
        forms=("A_c0 = Trans(a, b, c)", ""),
        figures=[
            Figure(f"leg {leg}, printed form against the file", off, "", "largest entry") for leg, off in turned.items()
        ],
    )


def equation_2(context: Context) -> Verdict:
    """Foot frame in the body."""
    return compare(
        "(2)",
        "Foot frame of leg IV in the body",
        over(context, "pose of the foot by the files' modules"),
        "",
        every(context, lambda f: printed.foot_to_body(f.lengths, f.q, f.mount) - f.pose),
        every(context, lambda f: formula(context, f, "transform_foot_to_body", f.q, tuple(f.mount)) - f.pose),
        forms=("A_c3 = A_c0 A_01 A_12 A_23", ""),
    )


def equation_3(context: Context) -> Verdict:
    """Foot in the body."""
    return compare(
        "(3)",
        "Foot of leg IV in the body, with c_ij and s_ij as explained below it",
        over(context, "place of the foot by the files' modules"),
        "m",
        every(context, lambda f: printed.foot_in_body(f.lengths, f.q, f.mount) - f.p),
        every(context, lambda f: formula(context, f, "foot_position_in_body", f.q, tuple(f.mount)) - f.p),
        forms=("P = ((l₃c₂₃ + l₂c₂ + l₁)c₁ + a,  s₁(l₃c₂₃ + l₂c₂) + l₁s₁ + b,  l₃s₂₃ + l₂s₂ + c)", ""),
    )


def unseen_terms(facts: Facts, rows: slice) -> list[str]:
    """Terms of (3) whose sign may be wrong without being seen at these states; zero terms of the mount left out."""
    right = printed.foot_in_body(facts.lengths, facts.q[rows], facts.mount)
    found = []
    for k, term in enumerate(printed.TERMS):
        if term in "abc" and facts.mount["abc".index(term)] == 0.0:
            continue
        signs = np.where(np.arange(len(printed.TERMS)) == k, -1.0, 1.0)
        if worst(printed.foot_in_body(facts.lengths, facts.q[rows], facts.mount, signs) - right) < 1e-9:
            found.append(term)
    return found


def equation_4(context: Context) -> Verdict:
    """The foot at one pose."""
    symbolic = [
        np.array(context.formulas.foot_position_in_body(f.numbers, tuple(np.radians(printed.POSE_4)), tuple(f.mount)))
        for f in facts_of(context)
    ]
    there = [f.p[0] for f in facts_of(context)]
    return compare(
        "(4)",
        "Foot of leg IV at (0°, −30°, −60°)",
        "place of the foot by the files' modules, two legs of other lengths",
        "m",
        np.concatenate(
            [printed.foot_at_pose_4(f.lengths, f.mount) - p for f, p in zip(facts_of(context), there, strict=True)]
        ),
        np.concatenate([own - p for own, p in zip(symbolic, there, strict=True)]),
        forms=("P = (√3/2 l₂ + l₁ + a,  b,  −(l₃ + l₂/2) + c)", ""),
        figures=[
            Figure(f"P_{axis}", value, "m", "the shipped leg at this pose")
            for axis, value in zip("xyz", there[0], strict=True)
        ],
    )


# ---------------------------------------------------------------------- inverse kinematics


def equation_5(context: Context) -> Verdict:
    """The pose's columns."""

    def gram(f: Facts) -> Array:
        n, o, alpha, _ = printed.columns(f.pose)
        return np.concatenate(
            [np.einsum("ni,ni->n", u, v) - (u is v) for u in (n, o, alpha) for v in (n, o, alpha)]
            + [np.linalg.norm(np.cross(n, o) - alpha, axis=-1)]
        )

    off = every(context, gram)
    return compare(
        "(5)",
        "Pose of the foot as columns n, o, α and p",
        over(context, "n, o and α are a right-handed orthonormal triple in the pose by the files' modules"),
        "",
        off,
        off,
        note="A notation. A_e3 is A_c3 of (2), here and in (6) and (9), and α is not the twist of Table 1.",
        forms=("A_e3 = [n o α p]", ""),
    )


def equation_6(context: Context) -> Verdict:
    """First product of inverses."""
    return compare(
        "(6)",
        "A_01 and A_c0 brought to the left",
        over(context, "both sides, with the pose by the files' modules on the left"),
        "",
        every(
            context,
            lambda f: (
                printed.product_by_inverses(f.lengths, f.pose, f.q[:, 0], f.mount)
                - printed.product_12_23(f.lengths, f.q)
            ),
        ),
        every(
            context,
            lambda f: (
                formula(context, f, "foot_from_link_1", f.pose, f.q[:, 0], tuple(f.mount))
                - printed.product_12_23(f.lengths, f.q)
            ),
        ),
        forms=("A_01⁻¹ A_c0⁻¹ A_c3 = A_12 A_23", ""),
    )


def equation_7(context: Context) -> Verdict:
    """The entries of (6)."""

    def difference(f: Facts, length: float) -> Array:
        """What is printed of the left side, less the right side; (N, 4, 4) with NaN for f13."""
        left, _ = printed.foot_from_link_1(f.pose, f.q[:, 0], f.mount, length)
        return np.asarray(left - printed.product_12_23(f.lengths, f.q))

    def as_printed(f: Facts) -> Array:
        entries = difference(f, f.lengths.l1)
        given = entries[:, np.isfinite(entries).all(axis=0)]
        return np.concatenate([np.ravel(given), first(f)])

    def repaired(f: Facts) -> Array:
        left, _ = printed.foot_from_link_1(f.pose, f.q[:, 0], f.mount, f.lengths.l1)
        alpha = printed.columns(f.pose)[2]
        left[:, 0, 2] = alpha[:, 0] * np.cos(f.q[:, 0]) + alpha[:, 1] * np.sin(f.q[:, 0])
        return left - printed.product_12_23(f.lengths, f.q)

    def first(f: Facts) -> Array:
        return printed.foot_from_link_1(f.pose, f.q[:, 0], f.mount, 0.0)[1].f33_first - 1.0

    second = facts_of(context)[1]
    readings = {name: worst(difference(second, length)[:, 0, 3]) for name, length in second.lengths._asdict().items()}
    return compare(
        "(7)",
        "Entries of (6)",
        over(context, "left side from the pose by the files' modules, right side as printed"),
        "",
        every(context, as_printed),
        every(
            context,
            lambda f: (
                formula(context, f, "foot_from_link_1", f.pose, f.q[:, 0], tuple(f.mount))
                - printed.product_12_23(f.lengths, f.q)
            ),
        ),
        note="f13 is not printed at all and not counted. l is not explained: read as l₁ the entry holds (to "
        f"{text(readings['l1'])} "
        f"m), read as l₂ it is off by {1e3 * readings['l2']:.0f} mm and as l₃ by {1e3 * readings['l3']:.0f} mm. f33 is "
        f"printed twice: the first is a copy of f31 and off by up to {text(worst(every(context, first)))}.",
        forms=(
            "…− l;  f13 absent;  f33 = n_x s₁ − n_y c₁;  f33 = α_x s₁ − α_y c₁",
            "…− l₁;  f13 = α_x c₁ + α_y s₁;  f33 = α_x s₁ − α_y c₁",
        ),
        repair=("l is l₁, f13 is left out, and the first f33 does not belong there", every(context, repaired)),
        figures=[
            Figure(f"entry (1, 4) with l read as {name}", off, "m", "second leg, whose lengths all differ")
            for name, off in readings.items()
        ]
        + [Figure("first f33", worst(every(context, first)), "", "against the 1 on the right")],
    )


def equation_8(context: Context) -> Verdict:
    """The hip's angle."""

    def printed_off(f: Facts) -> Array:
        return wrapped(printed.theta_1(f.p, f.mount) - f.q[:, 0])

    def corrected_off(f: Facts) -> Array:
        return wrapped(formula(context, f, "theta1", f.from_hip, f.hip_sign, leg=False) - f.q[:, 0])

    def quadrant_mended(f: Facts) -> Array:
        lost = np.where(np.cos(f.q[:, 0]) < 0.0, np.pi, 0.0)
        return wrapped(printed.theta_1(f.p, f.mount) + lost - f.q[:, 0])

    off = every(context, printed_off)
    inside = np.concatenate([f.inside for f in facts_of(context)])
    over_axis = np.concatenate([f.hip_sign < 0.0 for f in facts_of(context)])
    wrong = np.abs(off) > 1e-6
    return compare(
        "(8)",
        "θ₁ from the foot",
        over(context, "angle that the foot was placed with"),
        "rad",
        off,
        every(context, corrected_off),
        note=f"Inside ±70° it is wrong in {int((wrong & inside).sum())} of {int(inside.sum())} poses, outside in "
        f"{int((wrong & ~inside).sum())} of {int((~inside).sum())}: the arctangent knows no quadrant. Every foot has "
        f"a second θ₁, half a turn on, for a leg that reaches over its own hip axis ({int(over_axis.sum())} poses).",
        forms=("θ₁ = arctan((p_y − b)/(p_x − a))", "θ₁ = atan2(p_y − b, p_x − a), or that + π"),
        repair=("half a turn is lost where cos θ₁ < 0", every(context, quadrant_mended)),
        figures=[
            Figure("wrong inside ±70°", (wrong & inside).sum(), "", f"of {int(inside.sum())} poses"),
            Figure("wrong outside ±70°", (wrong & ~inside).sum(), "", f"of {int((~inside).sum())} poses"),
            Figure("feet over the hip axis", over_axis.sum(), "", "poses that need the second θ₁"),
        ],
    )


def equation_9(context: Context) -> Verdict:
    """Second product of inverses."""

    def right(f: Facts) -> Array:
        third = printed.table_rows(f.lengths)[2]
        return printed.link_by_table(f.q[:, 2], third, proximal=False)

    return compare(
        "(9)",
        "A_12 brought to the left, with T and the f(b)",
        over(context, "left side from the pose by the files' modules, A_23 on the right"),
        "",
        every(
            context,
            lambda f: printed.foot_from_link_2(f.lengths, f.pose, f.q[:, 0], f.q[:, 1], f.mount) - right(f),
        ),
        every(
            context,
            lambda f: formula(context, f, "foot_from_link_2", f.pose, f.q[:, 0], f.q[:, 1], tuple(f.mount)) - right(f),
        ),
        forms=("A_12⁻¹ A_01⁻¹ A_c0⁻¹ A_c3 = A_23", ""),
    )


def _component(context: Context, item: str, title: str, row: int, form: str) -> Verdict:
    function = (np.cos, np.sin)[row]

    def there(f: Facts) -> Array:
        return np.asarray(f.lengths.l3 * function(f.q[:, 2]))

    def left(f: Facts) -> Array:
        t, z = f.in_plane
        sides = (printed.along_link_2(f.lengths, t, z, f.q[:, 1]), printed.across_link_2(t, z, f.q[:, 1]))
        return sides[row] - there(f)

    def own(f: Facts) -> Array:
        return formula(context, f, "knee_components", *f.in_plane, f.q[:, 1])[:, row] - there(f)

    return compare(
        item,
        title,
        over(context, "left side from the place of the foot by the files' modules"),
        "m",
        every(context, left),
        every(context, own),
        forms=(form, ""),
    )


def equation_10(context: Context) -> Verdict:
    """Foot from the knee, along link 2."""
    return _component(context, "(10)", "Foot from the knee, along link 2", 0, "s₂(p_z − c) + c₂T − l₂ = l₃c₃")


def equation_11(context: Context) -> Verdict:
    """Foot from the knee, across link 2."""
    return _component(context, "(11)", "Foot from the knee, across link 2", 1, "c₂(p_z − c) − s₂T = l₃s₃")


# ---------------------------------------------------------------------- table


def table_1(context: Context) -> Verdict:
    """Which Denavit-Hartenberg frames the table means."""

    def off(f: Facts, proximal: bool) -> Array:
        return printed.foot_by_table(f.lengths, f.q, f.mount, proximal=proximal)[:, :3, 3] - f.p

    first = facts_of(context)[0]
    pose = np.radians([printed.POSE_4])
    both = [
        1e3 * printed.foot_by_table(first.lengths, pose, first.mount, proximal=proximal)[0, :3, 3]
        for proximal in (True, False)
    ]
    read, meant = (", ".join(f"{value:.1f}" for value in place) for place in both)
    standard = every(context, lambda f: off(f, False))
    return compare(
        "Table 1",
        "Denavit-Hartenberg parameters of leg IV",
        over(context, "foot by the table against the foot by the files' modules"),
        "m",
        every(context, lambda f: off(f, True)),
        every(context, lambda f: formula(context, f, "foot_position", f.q) - f.from_hip),
        kind="table",
        note="Headed a_(i−1) and α_(i−1), the columns are those of proximal (modified) frames; (2) and (4) follow from "
        f"them as distal (standard) a_i and α_i. At the pose of (4) the first reading has the foot at ({read}) mm, the "
        f"second at ({meant}) mm.",
        forms=("a_(i−1), α_(i−1)", "a_i, α_i: A = Rot(z, θ_i) Trans(x, a_i) Rot(x, α_i)"),
        repair=("the columns are a_i and α_i", standard),
        figures=[
            Figure(f"{axis} at the pose of (4), {reading}", 1e-3 * value, "m", "the shipped leg")
            for reading, place in zip(("proximal frames", "distal frames"), both, strict=True)
            for axis, value in zip("xyz", place, strict=True)
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
    table_1,
)
"""One function an item, in the paper's order."""
