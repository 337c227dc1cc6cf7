"""Claims of Rong et al. 2012 in words, judged by numbers; mobility and the sentences on Figs 3 and 5 have own rooms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from leg_dynamics.papers.comparison import EXACT, claim
from leg_dynamics.papers.framework import Context, Figure, Status, Verdict
from leg_dynamics.papers.hexapod_leg import printed, reported, second, study
from leg_dynamics.papers.hexapod_leg.facts import (
    RATE_TOLERANCE,
    Facts,
    facts_of,
    preliminary,
    preliminary_workspace,
    workspace_of,
)
from leg_dynamics.papers.hexapod_leg.gait import ASSUMED, walk
from leg_dynamics.papers.hexapod_leg.trends import NAMES
from leg_dynamics.papers.judge import judge, text, worst

__all__ = ["VERDICTS", "clearance", "length_derivatives", "out_of_plane"]

Array = np.ndarray


def _poses(context: Context) -> str:
    return f"{len(facts_of(context).q)} poses of the assembled mechanism"


# ---------------------------------------------------------------------- section 2: layout


def layout(context: Context) -> Verdict:
    """How the U joints stand."""
    facts = facts_of(context)
    m = facts.mechanism
    first, second = facts.hip(2)[0], facts.hip(3)[0]
    axes = [m.axis(f"alpha{i}") for i in (1, 2, 3)]
    hinge = m.axis("loop_B2")
    differences = [
        np.linalg.norm(first) - np.linalg.norm(second),
        first @ second,
        worst(np.cross(axes[0], axes[1])),
        worst(np.cross(first, axes[0])),
        worst(np.cross(axes[0], axes[2])),
        worst(np.cross(hinge, facts.platform[..., 1])),
    ]
    return claim(
        "how the U joints stand",
        "Section 2: their centres make a right isosceles triangle, the proximal axes of A1 and A2 are one line and "
        "that "
        "of A3 is parallel, the hinge B2 is across the plane of its loop",
        judge(differences, EXACT),
        f"The mechanism closes with all of this, and p is the hinge's axis (to {text(worst(differences))}).",
        [Figure("largest deviation", worst(differences), "", _poses(context))],
    )


def coplanar_upr(context: Context) -> Verdict:
    """Chain UPR stays in the plane of chain UP."""
    facts = facts_of(context)
    off = printed.dot(facts.w(2), facts.platform[..., 1])
    return claim(
        "chain UPR lies in one plane with chain UP",
        "Section 2: chain UPR is coplanar with the main chain UP",
        judge(off, EXACT),
        f"Strut 2 stays across p, to {text(worst(off))}.",
        [Figure("strut 2 out of the plane, sine", worst(off), "", _poses(context))],
    )


def out_of_plane(context: Context) -> Array:
    """Angle of strut 3 out of the plane of strut 1 and A3 over the workspace, rad."""
    p = workspace_of(context, context.leg).poses.foot
    _, w1, _, w3, *_ = study.vectors(context.numbers, p)
    normal = np.cross(np.array([0.0, 1.0, 0.0]), w1)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    angle: Array = np.abs(np.arcsin(printed.dot(normal, w3)))
    return angle


def coplanar_ups(context: Context) -> Verdict:
    """Chain UPS leaves the plane of chain UP."""
    facts = facts_of(context)
    b3 = facts.foot + facts.c
    volume = np.einsum("ni,ni->n", np.cross(facts.foot, facts.hip(3)), b3)
    a, c = float(context.numbers.a), float(context.numbers.c)
    alpha, beta = facts.angle("alpha1"), facts.angle("beta1")
    by_angles = a * c * facts.length(1) * np.sin(alpha) * np.sin(beta)
    weights = workspace_of(context, context.leg).weights
    angle = np.degrees(out_of_plane(context))
    mean = float(weights @ angle / weights.sum())
    flat = np.abs(np.sin(alpha) * np.sin(beta)) < EXACT
    return claim(
        "chain UPS lies in one plane with chain UP",
        "Section 2: chain UPS is coplanar with the main chain UP",
        judge(
            volume,
            EXACT,
            corrected=volume[flat],
            explained=volume - by_angles,
        ),
        f"Only where α = 0 or β = 0: A1, B1, A3 and B3 span a volume of a c l₁ sin α sin β / 6. Strut 3 leans out of "
        f"the plane by {mean:.2f}° on average over the workspace, {angle.max():.1f}° at most.",
        [
            Figure("volume of A1 B1 A3 B3, largest", worst(volume) / 6.0, "m³", _poses(context)),
            Figure("angle out of the plane, mean", mean, "deg", "over the workspace of the final design, by volume"),
            Figure("angle out of the plane, largest", angle.max(), "deg", "over the workspace of the final design"),
        ],
        ("always", "where sin α sin β = 0"),
    )


# ---------------------------------------------------------------------- section 2: decoupling


def length_derivatives(facts: Facts) -> Array:
    """Derivatives of l1, l2, l3 by alpha, beta and l1, (N, 3, 3), from differences of assembled poses."""
    omega, p = facts.omega(1), facts.platform[..., 1]
    # omega1 = alpha' x + beta' p with p across x.
    rates = np.stack([omega[..., 0], np.einsum("nki,ni->nk", omega, p), facts.rates[..., 0]], axis=1)
    return np.linalg.inv(rates)


def swing_ahead(context: Context) -> Verdict:
    """Strut 2 and beta."""
    facts = facts_of(context)
    D = length_derivatives(facts)
    others = D[:, 1, [0, 2]]
    return claim(
        "fore and aft swing by strut 2 alone",
        "Section 2: the swing fore and aft is made by chain UPR alone",
        judge(others, RATE_TOLERANCE),
        f"l₂ depends on β alone: ∂l₂/∂α and ∂l₂/∂l₁ vanish (to {text(worst(others))}), |∂l₂/∂β| is at least "
        f"{1e3 * np.abs(D[:, 1, 1]).min():.0f} mm/rad.",
        [
            Figure("∂l₂/∂α and ∂l₂/∂l₁, largest", worst(others), "m/rad, 1", _poses(context)),
            Figure("|∂l₂/∂β|, least", np.abs(D[:, 1, 1]).min(), "m/rad", _poses(context)),
        ],
    )


def coupling_ratio(context: Context) -> Array:
    """|∂l3/∂β| over |∂l3/∂α| over the workspace."""
    l1, *_, R = study.vectors(context.numbers, workspace_of(context, context.leg).poses.foot)
    c = float(context.numbers.side * context.numbers.c)
    cos_alpha, sin_alpha, sin_beta, cos_beta = R[:, 1, 1], R[:, 2, 1], R[:, 0, 2], R[:, 0, 0]
    ratio: Array = np.abs(l1 * sin_alpha * sin_beta / (l1 * cos_alpha * cos_beta + c * sin_alpha))
    return ratio


def swing_sideways(context: Context) -> Verdict:
    """Strut 3 and alpha."""
    facts = facts_of(context)
    D = length_derivatives(facts)
    alpha, beta = facts.angle("alpha1"), facts.angle("beta1")
    a, side = float(context.numbers.a), float(context.numbers.side)
    by_beta = -side * a * facts.length(1) * np.sin(alpha) * np.sin(beta) / facts.length(3)
    weights = workspace_of(context, context.leg).weights
    ratio = coupling_ratio(context)
    mean = float(weights @ ratio / weights.sum())
    straight = np.abs(np.sin(alpha) * np.sin(beta)) < EXACT
    return claim(
        "sideways swing by strut 3 alone, fully decoupled",
        "Section 2: the swing sideways is made by chain UPS alone, so that the rotations are decoupled",
        judge(D[:, 2, 1], RATE_TOLERANCE, corrected=D[straight, 2, 1], explained=D[:, 2, 1] - by_beta),
        f"l₃ depends on β and l₁ as well: ∂l₃/∂β = −a l₁ sin α sin β / l₃ vanishes only in the planes α = 0 and β = 0. "
        f"Beside ∂l₃/∂α it is {mean:.2f} on average over the workspace and up to {ratio.max():.1f}. Half of the "
        f"decoupling is there: strut 2 makes β alone.",
        [
            Figure("|∂l₃/∂β| over |∂l₃/∂α|, mean", mean, "", "workspace of the final design, by volume"),
            Figure("|∂l₃/∂β| over |∂l₃/∂α|, largest", ratio.max(), "", "workspace of the final design"),
            Figure("|∂l₃/∂β|, largest", worst(D[:, 2, 1]), "m/rad", _poses(context)),
            Figure("|∂l₃/∂l₁|, largest", worst(D[:, 2, 2]), "", _poses(context)),
        ],
        ("∂l₃/∂β = 0", "∂l₃/∂β = −a l₁ sin α sin β / l₃"),
    )


def any_direction(context: Context) -> Verdict:
    """Any swing from the two."""
    facts = facts_of(context)
    w = facts.w(1)
    spin = np.stack([np.cross(np.array([1.0, 0.0, 0.0]), w), np.cross(facts.platform[..., 1], w)], axis=1)
    sigma = np.linalg.svd(spin, compute_uv=False)[:, 1]
    least = float(np.cos(facts.angle("beta1")).min())
    return claim(
        "swings in any direction from the two rotations",
        "Section 2: the leg swings in any direction by a linear combination of the two rotations",
        judge(float((sigma <= EXACT).sum()), 0.0),
        f"Swings by α and β span the sphere everywhere inside ±60°: the smaller singular value is cos β, at least "
        f"{sigma.min():.2f} here. At β = ±90° one direction is lost.",
        [
            Figure("smaller singular value, least", sigma.min(), "", _poses(context)),
            Figure("cos β, least", least, "", _poses(context)),
        ],
    )


# ---------------------------------------------------------------------- sections 4 and 5


def initial_pose(context: Context) -> Verdict:
    """h in the middle of its range."""
    given = reported.PRELIMINARY
    middle = 0.5 * (given["l1_min"] + given["l1_max"])
    chosen = 0.5 * (reported.FINAL["l1_min"] + reported.FINAL["l1_max"])
    return claim(
        "the initial pose is in the middle of its range",
        "Section 4: the initial pose has the platform level and its distance h in the middle of its range",
        judge(given["h"] - middle, EXACT),
        f"h = {1e3 * given['h']:.0f} mm is the middle of the range of strut 1 for the preliminary design. The final "
        "one "
        f"has no h in print; the middle is {1e3 * chosen:.0f} mm, which is used here.",
        [
            Figure("middle, preliminary design", middle, "m", "(l₁min + l₁max)/2 as printed"),
            Figure("middle, final design", chosen, "m", "(l₁min + l₁max)/2 as printed"),
        ],
    )


def what_limits(context: Context) -> Verdict:
    """Lengths, interference and joint angles limit the workspace."""
    shares = {leg.name: workspace_of(context, leg).active_shares() for leg in (preliminary(context), context.leg)}
    kinds = {"lengths": 0.0, "U joints": 0.0, "ball": 0.0}
    for name, share in shares[context.leg.name].items():
        kind = "ball" if "ball" in name else "lengths" if name.startswith("l") else "U joints"
        kinds[kind] += share
    edge = workspace_of(context, context.leg).border_shares()
    total = sum(edge.values())
    ball = sum(count for name, count in edge.items() if "ball" in name)
    design = study.design_of(context.leg)
    free = replace(design, ball_range=np.pi)
    gained = study.measure(context, free).volume.value - study.measure(context, design).volume.value
    binding = {**kinds, "ball": kinds["ball"] + ball}
    return claim(
        "lengths, U joints and ball limit the workspace",
        "Section 4.1: lengths, interference and the angles of U joints and ball decide the workspace together",
        judge(
            float(sum(share == 0.0 for share in binding.values())),
            0.0,
            corrected=gained,
            explained=float(sum(binding[name] == 0.0 for name in ("lengths", "U joints"))),
        ),
        f"The lengths are the nearest limit in {100 * kinds['lengths']:.0f} % of the final workspace, the U joints in "
        f"{100 * kinds['U joints']:.0f} %, the ball's 35° in {100 * kinds['ball']:.0f} %; it ends the workspace at "
        f"{ball} "
        f"of {total} points of the boundary, and without it the volume grows by {gained:.3g} m³. Interference has a "
        "verdict of its own.",
        [
            Figure("share nearest to a limit of length", kinds["lengths"], "", "by volume, final design"),
            Figure("share nearest to a U joint's limit", kinds["U joints"], "", "by volume, final design"),
            Figure("share nearest to the ball's limit", kinds["ball"], "", "by volume, final design"),
            Figure("boundary points that the ball ends", ball, "", f"of {total}, final design"),
            Figure("volume gained without the ball's limit", gained, "m³", "the same samples with and without"),
        ],
        ("lengths, U joints and ball", "lengths and U joints; the ball's limit never binds"),
    )


PRIMARY = tuple(reported.PRIMARY_RANGES)


def secondary_parameters(context: Context) -> Verdict:
    """Which parameters matter for L and Z."""
    changes = study.step_sensitivity(context)
    lengths = {name: change for name, change in changes.items() if not name.endswith("range")}
    felt = {name: change for name, change in lengths.items() if name in PRIMARY and change > study.LENGTH_NOISE}
    least = min(felt, key=lambda name: felt[name])
    rest = {name: change for name, change in lengths.items() if name not in PRIMARY}
    stronger = [name for name, change in rest.items() if change > felt[least]]
    first = [name for name, change in felt.items() if change > max(rest.values())]
    ahead = " or ".join(NAMES[name] for name in stronger) or "none of the rest"
    all_of_them = ", ".join(f"{NAMES[name]} {1e3 * change:.0f}" for name, change in lengths.items())
    return claim(
        "a, b, l2min and l2max matter most for L and Z",
        "Section 4.2: because the rotations are decoupled, a, b, l₂min and l₂max matter most, the rest is secondary",
        judge(float(len(stronger)), 0.0),
        f"10 mm more or less of {ahead} moves L or Z by more than 10 mm of {NAMES[least]} ({all_of_them} mm); only "
        f"{' and '.join(NAMES[name] for name in first) or 'none'} of the four is ahead of all the rest.",
        [
            Figure(f"change with {name}", change, "m", "L, Z_f or Z_b, preliminary design, 10 mm or 5° either way")
            for name, change in changes.items()
        ],
    )


def least_condition(context: Context) -> dict[str, float]:
    """Least condition number in the workspace of both designs."""
    return {leg.name: workspace_of(context, leg).dexterity.smallest for leg in (preliminary(context), context.leg)}


def dexterity_in_reach(context: Context) -> Verdict:
    """kbar = 4.3."""
    target = reported.ACCEPTED["kbar"]
    least = least_condition(context)
    drawn = study.monte_carlo(context)
    lowest = float(np.nanmin(drawn.mean))
    plain = study.measure(context, study.design_of(context.leg), "printed")
    first = preliminary_workspace(context)
    return claim(
        "k̄ = 4.3 and k̃ = 4.7 are middle values",
        "Section 6.1: k̄ = 4.3 and k̃ = 4.7 are middle values of the indices of dexterity",
        judge(max(0.0, lowest - target), 0.0),
        f"Out of reach: k itself is nowhere below {min(least.values()):.2f} in the workspace of the preliminary design "
        f"and {max(least.values()):.2f} of the final one, so no mean over them can be {target:g}. The least k̄ among "
        f"{int(drawn.counted.sum())} designs of the paper's box is {lowest:.2f}. (24) as printed is worse: k̄ = "
        f"{plain.mean.value:.2f} for the final design.",
        [
            Figure("least k, preliminary design", least[first.leg], "", "exact Jacobian"),
            Figure("least k, final design", least[context.leg.name], "", "exact Jacobian"),
            Figure("least k̄ of the Monte Carlo designs", lowest, "", f"{int(drawn.counted.sum())} designs"),
            Figure("k̄ of the final design, printed Jacobian", plain.mean.value, "", "workspace of the final design"),
        ],
    )


def middle_lengths(context: Context) -> Verdict:
    """Medians of L and Z."""
    drawn = study.monte_carlo(context)
    walks = drawn.steps.length > 0.0
    # A design whose initial pose is out of reach makes no step: it counts with L = Z = 0.
    length, front, back = (study.median_interval(each) for each in drawn.steps)
    able = [study.median_interval(each[walks])[0] for each in drawn.steps]
    rounding = 0.025
    off = [length[0] - reported.ACCEPTED["L"], back[0] - reported.ACCEPTED["Z"]]
    forced = second.brute_medians(context)

    def three(found: tuple[float, float, float]) -> str:
        return f"{1e3 * found[0]:.0f} mm (95 %: {1e3 * found[1]:.0f} to {1e3 * found[2]:.0f})"

    return claim(
        "L = 1000 mm and Z = 350 mm are middle values",
        "Section 6.1: Z = 350 mm and L = 1000 mm are middle values of the indices of the workspace",
        judge(off, rounding),
        f"Medians of {len(walks)} random designs of the paper's box: L {three(length)}, Z behind {three(back)}, Z "
        f"ahead {three(front)}. In {100 * (1.0 - walks.mean()):.1f} % the initial pose is not feasible, and they count "
        f"with 0; without them the medians are {1e3 * able[0]:.0f}, {1e3 * able[2]:.0f} and {1e3 * able[1]:.0f} mm. "
        f"Marching along the line by plain vectors gives {1e3 * forced.every:.0f} and {1e3 * forced.able:.0f} mm for L "
        f"of the first {forced.designs} designs, against {1e3 * forced.own_every:.0f} and "
        f"{1e3 * forced.own_able:.0f} mm by the formulas: both ways to count are computed right, and the way moves the "
        f"median by {1e3 * (able[0] - length[0]):.0f} mm, as the drawing of the designs does by "
        f"{1e3 * (length[2] - length[1]):.0f} mm. Both of the paper's numbers are multiples of 50 mm; half of that is "
        "the tolerance. That its middle values are medians is a guess.",
        [
            Figure("median of L", length[0], "m", f"{len(walks)} designs"),
            Figure("median of L, feasible initial pose", able[0], "m", f"{int(walks.sum())} designs"),
            Figure("median of L by force", forced.every, "m", f"{forced.designs} designs, marched along"),
            Figure(
                "median of L by force, feasible initial pose", forced.able, "m", f"{forced.designs} designs and fewer"
            ),
            Figure("initial pose not feasible", 1.0 - walks.mean(), "", "share of the designs"),
            Figure("median of Z behind", back[0], "m", f"{len(walks)} designs"),
            Figure("median of Z ahead", front[0], "m", f"{len(walks)} designs"),
            Figure("median of k̄", study.median_interval(drawn.mean[drawn.counted])[0], "", "exact Jacobian"),
            Figure("median of k̃", study.median_interval(drawn.deviation[drawn.counted])[0], "", "exact Jacobian"),
        ],
    )


def wording_of_section_6(context: Context) -> Verdict:
    """L and H, =, the missing l1max."""

    def slips(indices: tuple[str, ...], relations: tuple[str, ...], secondary: tuple[str, ...]) -> int:
        lengths = [each.name for each in fields(study.Design) if not each.name.endswith("range")]
        named = {*PRIMARY, *secondary}
        return (
            len(set(indices) - {"L", "Z"})
            + sum(relation == "=" for relation in relations)
            + sum(name not in named for name in lengths)
        )

    given = reported.SECTION_6
    off = slips(given["workspace indices"], given["relations"], given["secondary"])
    mended = slips(
        tuple("Z" if name == "H" else name for name in given["workspace indices"]),
        tuple("<=" if relation == "=" else relation for relation in given["relations"]),
        (*given["secondary"], "l1_max"),
    )
    return claim(
        "wording of the design problem",
        "Section 6.1: the indices L and H, the condition k̃ = 4.7, the list of secondary parameters",
        judge(float(off), 0.0, corrected=float(mended), explained=float(mended)),
        f"{off} slips: H is the Z of section 4.2, k̃ must be at most 4.7 as k̄ is at most 4.3, and l₁max is in neither "
        "list though it gets a value.",
        [Figure("slips", off, "", "names, relations and parameters as printed")],
        ("L and H; k̃ = 4.7; c, e, l₁min, l₃min, l₃max", "L and Z; k̃ ≤ 4.7; c, e, l₁min, l₁max, l₃min, l₃max"),
    )


def accepted_designs(context: Context) -> Verdict:
    """Designs that meet all four conditions."""
    drawn = study.monte_carlo(context)
    accept = reported.ACCEPTED
    far = drawn.far_enough
    with np.errstate(invalid="ignore"):
        all_four = far & (drawn.mean <= accept["kbar"]) & (drawn.deviation <= accept["ktilde"])
    count, total = int(all_four.sum()), len(all_four)
    bound = 1.0 - 0.05 ** (1.0 / total)
    return claim(
        "designs that meet all four conditions",
        "Section 6.1: sampled designs with L ≥ 1000 mm, Z ≥ 350 mm, k̄ ≤ 4.3 and k̃ ≤ 4.7 show how to choose",
        judge(0.0 if count else 1.0, 0.0),
        f"{count} of {total} designs meet them, so at most {100 * bound:.2f} % do (95 %). {100 * far.mean():.0f} % "
        "meet "
        f"those on L and Z (taken behind); k̄ ≤ {accept['kbar']:g} leaves none.",
        [
            Figure("designs", total, "", "random, uniform in the paper's box"),
            Figure("meet L and Z", far.mean(), "", "share, Z behind"),
            Figure("meet all four", count, "", "exact Jacobian"),
            Figure("upper bound of their share", bound, "", "95 %"),
        ],
    )


def chosen_design(context: Context) -> Verdict:
    """Final against preliminary."""
    first, last = preliminary_workspace(context), workspace_of(context, context.leg)
    one, other = first.step, last.step
    assert one is not None
    assert other is not None
    accept = reported.ACCEPTED
    missed = [
        max(0.0, accept["L"] - other.length),
        max(0.0, accept["Z"] - other.back),
        max(0.0, last.mean.value - accept["kbar"]),
        max(0.0, last.deviation.value - accept["ktilde"]),
    ]

    def change(new: float, old: float) -> str:
        return f"{100.0 * (new / old - 1.0):+.0f} %"

    return claim(
        "the chosen parameters perform well",
        "Section 6.1: the parameters chosen meet the conditions on L, Z, k̄ and k̃",
        judge(missed, 0.0),
        f"L = {1e3 * other.length:.0f} mm and Z behind = {1e3 * other.back:.0f} mm do ({1e3 * other.front:.0f} mm "
        f"ahead), k̃ = {last.deviation.value:.2f} does, k̄ = {last.mean.value:.2f} does not. Against the preliminary "
        f"design: volume {change(last.volume.value, first.volume.value)}, L {change(other.length, one.length)}, Z_b "
        f"{change(other.back, one.back)}, Z_f {change(other.front, one.front)}, k̄ "
        f"{change(last.mean.value, first.mean.value)}.",
        [
            Figure(f"{what}, {which} design", value, unit, found.justification.split(":", maxsplit=1)[0])
            for which, found, step in (("preliminary", first, one), ("final", last, other))
            for what, value, unit in (
                ("volume", found.volume.value, "m³"),
                ("L", step.length, "m"),
                ("Z ahead", step.front, "m"),
                ("Z behind", step.back, "m"),
                ("k̄", found.mean.value, ""),
                ("k̃", found.deviation.value, ""),
                ("least k", found.dexterity.smallest, ""),
            )
        ],
    )


# ---------------------------------------------------------------------- hardware that Table 1 makes possible or not


def clearance(context: Context, q: Array) -> Array:
    """Gap between the sleeves of struts 1 and 3 at states (N, 3), m; negative where they overlap."""
    from leg_dynamics.analysis.workspace import margins

    (name,) = (each.name for each in context.leg.description.clearances)
    found: Array = margins(context.leg, q)[f"clearance {name}"]
    return found


def sleeves(context: Context) -> Verdict:
    """Sleeves 1 and 3 collide."""
    f, leg = context.formulas, context.numbers
    least, other = reported.FINAL["l1_min"], reported.FINAL["l1_min"] + 0.02
    z = np.array([least, other])
    q = np.stack([np.asarray(each) + 0.0 * z for each in f.inverse_kinematics(leg, (0.0 * z, 0.0 * z, z)).q], axis=-1)
    at = clearance(context, q)
    found = workspace_of(context, context.leg)
    gaps = clearance(context, found.poses.q)
    share = float(found.weights @ (gaps < 0.0) / found.weights.sum())
    return claim(
        "the struts do not interfere",
        "Sections 4.1 and 6.1: interference of the struts is a constraint, and the final design takes it into account",
        judge(max(0.0, -float(gaps.min())), 0.0),
        f"With the tubes of Table 1 starting at the U joints, sleeves 1 and 3 overlap by {-1e3 * at[0]:.1f} mm at l₁ = "
        f"{1e3 * least:.0f} mm straight down, by up to {-1e3 * gaps.min():.1f} mm in {100 * share:.2g} % of the "
        f"workspace; at {1e3 * other:.0f} mm they are {1e3 * at[1]:.1f} mm apart. Where the tubes start is not "
        "printed.",
        [
            Figure("gap straight down at l₁min", at[0], "m", "axes' distance less the two radii"),
            Figure("gap straight down 20 mm above l₁min", at[1], "m", "axes' distance less the two radii"),
            Figure("least gap", gaps.min(), "m", f"{len(gaps)} samples of the workspace"),
            Figure("share of the workspace with an overlap", share, "", "by volume"),
        ],
    )


def strut_2_reaches(context: Context) -> Verdict:
    """310 + 310 against 600."""
    tubes = reported.TUBES
    reach = tubes["sleeve_2"][0] + tubes["rod_2"][0]
    room = reach - reported.FINAL["l2_max"]
    early = reach - reported.PRELIMINARY["l2_max"]
    retracted = reported.FINAL["l2_min"] - max(tubes["sleeve_2"][0], tubes["rod_2"][0])
    main = tubes["sleeve_13"][0] + tubes["rod_13"][0] - reported.FINAL["l1_max"]
    return claim(
        "the tubes of strut 2 fit its range",
        "Table 1 and section 6.1: sleeve and rod of strut 2, 310 mm each, for 330 to 600 mm",
        judge([min(room, 0.0), min(retracted, 0.0)], 0.0),
        f"They do, but at full length only {1e3 * room:.0f} mm of the rod are left in the sleeve, "
        f"{1e3 * main:.0f} mm in struts 1 and 3; pulled in, {1e3 * retracted:.0f} mm are left. The preliminary "
        "design's "
        f"650 mm would have been {-1e3 * early:.0f} mm out of their reach.",
        [
            Figure("overlap at full length", room, "m", "sleeve + rod − l₂max"),
            Figure("room when pulled in", retracted, "m", "l₂min less the longer tube"),
            Figure("overlap for the preliminary design", early, "m", "the same tubes"),
            Figure("overlap of struts 1 and 3", main, "m", "sleeve + rod − l₁max"),
        ],
    )


def drive_speeds(context: Context) -> Verdict:
    """Speeds of the struts in a gait."""
    walks = [walk(context, *each) for each in ASSUMED]
    peaks = [1e3 * np.abs(each.rates).max(axis=0) for each in walks]
    again = second.gait_difference(context)
    return claim(
        "the struts' speeds are reasonable and change smoothly",
        "Section 6.2: the speeds of the drives stay in a reasonable range and change smoothly",
        # The curves depend on period, stride, clearance and path, none of which is given.
        Status.NOT_REPRODUCIBLE,
        "No period, stride, clearance, path, or limit of speed is given. With assumed ones "
        + "; ".join(
            f"{each.period:g} s, {1e3 * each.stride:.0f} mm, {1e3 * each.clearance:.0f} mm: up to "
            f"{peak[0]:.0f}, {peak[1]:.0f}, {peak[2]:.0f} mm/s"
            for each, peak in zip(walks, peaks, strict=True)
        )
        + f". The six legs of the robot's file, by the numeric route, give the same within {again.speed:.0e} m/s and "
        f"{again.force:.0e} N.",
        [
            Figure(
                f"peak speed of strut {k + 1} at {each.speed:g} m/s", 1e-3 * peak[k], "m/s", "assumed gait, see Fig. 10"
            )
            for each, peak in zip(walks, peaks, strict=True)
            for k in range(3)
        ],
    )


def virtues(context: Context) -> Verdict:
    """Carries more, moves better."""
    return claim(
        "great load, large workspace, agile",
        "Sections 1 and 7: the leg carries great loads, has a large workspace and moves with agility",
        Status.OUT_OF_REACH,
        "There is neither a load, a drive, nor another leg to compare with; the prototype is virtual.",
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (
    virtues,
    layout,
    coplanar_upr,
    coplanar_ups,
    swing_ahead,
    swing_sideways,
    any_direction,
    initial_pose,
    what_limits,
    secondary_parameters,
    middle_lengths,
    dexterity_in_reach,
    wording_of_section_6,
    accepted_designs,
    chosen_design,
    strut_2_reaches,
    sleeves,
    drive_speeds,
)
"""One function a claim, in the paper's order."""
