"""Mobility and constraints of the leg as ranks of screw systems, from the joint axes of the assembled mechanism.

A twist is (angular velocity; velocity of the point at A1), a wrench (force; moment about A1); they are reciprocal where
their power vanishes. Lengths are in m, which the sizes of this leg make comparable with 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from leg_dynamics.papers.comparison import claim
from leg_dynamics.papers.framework import Context, Figure, Verdict
from leg_dynamics.papers.hexapod_leg.facts import RATE_TOLERANCE, Facts, facts_of
from leg_dynamics.papers.judge import judge, text, worst

__all__ = ["VERDICTS", "Screws", "chain_twists", "rank_of", "reciprocal", "screws_of"]

Array = np.ndarray

RANK_SHARE = 1e-9
"""Singular values below this share of the largest one count as zero."""


def rank_of(systems: Array) -> int:
    """Rank of screw systems (N, k, 6) if it is the same in all poses; -1 if it is not."""
    sigma = np.linalg.svd(systems, compute_uv=False)
    ranks = (sigma > RANK_SHARE * sigma[:, :1]).sum(axis=1)
    return int(ranks[0]) if (ranks == ranks[0]).all() else -1


def reciprocal(twists: Array, rank: int) -> Array:
    """Wrenches that do no work on twists (N, k, 6) of a known rank: an orthonormal basis, (N, 6 - rank, 6)."""
    _, _, basis = np.linalg.svd(twists)
    swapped = basis[:, rank:]
    # Power = force · velocity + moment · angular velocity.
    return np.concatenate([swapped[..., 3:], swapped[..., :3]], axis=-1)


def power(wrenches: Array, twists: Array) -> Array:
    """Power of each wrench (N, j, 6) on each twist (N, k, 6)."""
    found: Array = np.einsum("nji,nki->njk", wrenches, np.concatenate([twists[..., 3:], twists[..., :3]], axis=-1))
    return found


def _turning(axis: Array, point: Array) -> Array:
    return np.concatenate([axis, np.cross(point, axis)], axis=-1)


def _sliding(axis: Array) -> Array:
    return np.concatenate([np.zeros_like(axis), axis], axis=-1)


def chain_twists(facts: Facts) -> dict[str, Array]:
    """Unit twists of the joints of the chains UP, UPR and UPS, each (N, joints, 6)."""
    m = facts.mechanism
    origin = m.position("cross_1")

    def universal_and_slide(i: int) -> list[Array]:
        centre = m.position(f"cross_{i}") - origin
        return [
            _turning(m.axis(f"alpha{i}"), centre),
            _turning(m.axis(f"beta{i}"), centre),
            _sliding(m.axis(f"l{i}")),
        ]

    hinge, ball = m.position("rod_2") - origin, m.position("rod_3") - origin
    around_ball = [_turning(np.broadcast_to(axis, ball.shape), ball) for axis in np.eye(3)]
    chains = {
        "UP": universal_and_slide(1),
        "UPR": [*universal_and_slide(2), _turning(m.axis("loop_B2"), hinge)],
        "UPS": [*universal_and_slide(3), *around_ball],
    }
    return {name: np.stack(np.broadcast_arrays(*twists), axis=1) for name, twists in chains.items()}


class Screws(NamedTuple):
    """Ranks and what they were found with."""

    chains: dict[str, Array]
    ranks: dict[str, int]
    loop_rows: int
    loop_rank: int
    joints: int
    platform: Array
    """Twists of the platform for unit rates of the struts, (N, 3, 6), from differences of poses."""
    platform_rank: int
    rotations: int
    """Rank of the angular velocities."""
    wrenches: Array
    """Constraints of the platform, (N, k, 6): reciprocal to the chain UP."""
    forces: int
    """Rank of their forces; the rest are couples."""
    couple: Array
    """Unit moment of the couple, (N, 3)."""

    @property
    def translations(self) -> int:
        """Independent motions without rotation."""
        return self.platform_rank - self.rotations

    @property
    def mobility(self) -> int:
        """Joint freedoms less independent loop rows."""
        return self.joints - self.loop_rank

    @property
    def gruebler(self) -> int:
        """Joint freedoms less loop rows."""
        return self.joints - self.loop_rows


def screws_of(context: Context) -> Screws:
    """All screw systems at `states`."""

    def compute() -> Screws:
        facts = facts_of(context)
        chains = chain_twists(facts)
        ranks = {name: rank_of(twists) for name, twists in chains.items()}
        up, upr, ups = chains["UP"], chains["UPR"], chains["UPS"]
        sleeve = up[:, :2]
        count = len(up)
        # Sleeve 1 by its U joint and by chain UPR; the platform by chain UP and by chain UPS.
        one = np.concatenate([sleeve, np.zeros((count, 1, 6)), -upr, np.zeros_like(ups)], axis=1)
        other = np.concatenate([up, np.zeros_like(upr), -ups], axis=1)
        rows = np.concatenate([np.swapaxes(one, 1, 2), np.swapaxes(other, 1, 2)], axis=1)
        platform = np.concatenate([facts.omega(1), facts.v1 + np.cross(facts.omega(1), -facts.foot[:, None])], axis=-1)
        wrenches = reciprocal(up, ranks["UP"])
        forces = rank_of(wrenches[..., :3])
        # The couple is the combination without force.
        left = np.linalg.svd(np.swapaxes(wrenches[..., :3], 1, 2))[2][:, -1]
        couple = np.einsum("nj,nji->ni", left, wrenches[..., 3:])
        couple = couple / np.linalg.norm(couple, axis=-1, keepdims=True)
        return Screws(
            chains,
            ranks,
            rows.shape[1],
            rank_of(rows),
            rows.shape[2],
            platform,
            rank_of(platform),
            rank_of(platform[..., :3]),
            wrenches,
            forces,
            couple,
        )

    found: Screws = context.once("hexapod: screws", compute)
    return found


def _of(context: Context) -> str:
    return f"{len(facts_of(context).q)} poses of the assembled mechanism"


def mobility(context: Context) -> Verdict:
    """Three degrees of freedom: two rotations and one translation."""
    s = screws_of(context)
    report = context.pinocchio.mobility_report(samples=20, seed=context.seed)
    return claim(
        "two rotations and one translation",
        "Section 2: screw theory gives the leg three degrees of freedom, two rotations and one translation",
        judge(
            [s.mobility - 3, report.mobility - 3, s.platform_rank - 3, s.rotations - 2, s.translations - 1],
            0.0,
        ),
        f"{s.joints} joint freedoms, {s.loop_rows} loop rows of rank {s.loop_rank}: mobility {s.mobility}, where "
        f"Grübler's count gives {s.gruebler}. The platform's twists have rank {s.platform_rank}, their angular parts "
        f"{s.rotations}. The numeric route counts {report.redundant} redundant rows and mobility {report.mobility} "
        "too.",
        [
            Figure("joint freedoms", s.joints, "", "no joint cut"),
            Figure("loop rows", s.loop_rows, "", "two loops"),
            Figure("rank of the loop rows", s.loop_rank, "", _of(context)),
            Figure("Grübler's count", s.gruebler, "", "joint freedoms less loop rows"),
            Figure("mobility", s.mobility, "", _of(context)),
            Figure("rank of the platform's twists", s.platform_rank, "", "from differences of poses"),
            Figure("rank of its angular velocities", s.rotations, "", "from differences of poses"),
        ],
    )


def constraints(context: Context) -> Verdict:
    """Two forces and one couple."""
    s, facts = screws_of(context), facts_of(context)
    couples = len(s.wrenches[0]) - s.forces
    work = worst(power(s.wrenches, s.platform))
    p = facts.platform[..., 1]
    normal = np.cross(np.array([1.0, 0.0, 0.0]), p)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    off = worst(np.linalg.norm(np.cross(normal, s.couple), axis=-1))
    through = np.stack(
        [np.concatenate([axis, np.zeros_like(axis)], axis=-1) for axis in (p, facts.platform[..., 0])], 1
    )
    lazy = worst(power(through, s.chains["UP"]))
    tilt = np.degrees(np.arccos(np.clip(np.abs(np.einsum("ni,ni->n", s.couple, facts.w(1))), 0.0, 1.0)))
    return claim(
        "constraints are two forces and one couple",
        "Section 2: the constraints of the mechanism are two forces and one couple",
        judge([s.forces - 2, couples - 1, s.ranks["UPS"] - 6, work, off, lazy], RATE_TOLERANCE),
        f"Wrenches reciprocal to chain UP: {s.forces} forces, through A1 and across strut 1, and {couples} couple "
        "about "
        f"x × p; chain UPS has rank {s.ranks['UPS']} and adds none. They do no work on the platform's motions (to "
        f"{text(work)}). The couple leans up to {tilt.max():.0f}° from strut 1, which contradicts (19).",
        [
            Figure("rank of chain UP", s.ranks["UP"], "", _of(context)),
            Figure("rank of chain UPR", s.ranks["UPR"], "", _of(context)),
            Figure("rank of chain UPS", s.ranks["UPS"], "", _of(context)),
            Figure("forces", s.forces, "", "rank of the reciprocal wrenches' forces"),
            Figure("couples", couples, "", "reciprocal wrenches without a force"),
            Figure("largest power on the platform", work, "W", "unit wrenches, motions for unit rates of the struts"),
            Figure("couple away from x × p", off, "", "sine of the angle"),
            Figure("couple away from strut 1, largest", tilt.max(), "deg", _of(context)),
        ],
    )


def strut_1_cannot_spin(context: Context) -> Verdict:
    """The sentence before (19)."""
    facts = facts_of(context)
    omega, p = facts.omega(1), facts.platform[..., 1]
    spin = np.einsum("nki,ni->nk", omega, facts.w(1))
    normal = np.cross(np.array([1.0, 0.0, 0.0]), p)
    blocked = np.einsum("nki,ni->nk", omega, normal)
    by_alpha = omega[..., 0] * np.sin(facts.angle("beta1"))[:, None]
    return claim(
        "strut 1 cannot turn about its own axis",
        "Section 3.3: the rotation of chain UP about its axis is constrained",
        judge(spin, RATE_TOLERANCE, corrected=blocked, explained=spin - by_alpha),
        f"It turns about its axis with up to {text(worst(spin))} rad a metre of strut, α̇ sin β. What the U joint "
        "blocks "
        f"is the rotation about x × p (to {text(worst(blocked))}). The two axes are one only where β = 0.",
        [
            Figure("spin about strut 1", worst(spin), "rad/m", _of(context)),
            Figure("rotation about x × p", worst(blocked), "rad/m", _of(context)),
        ],
        ("w₁ᵀ ω₁ = 0", "(x × p)ᵀ ω₁ = 0"),
    )


def unit_vectors(context: Context) -> Verdict:
    """w_i · (omega_i x w_i) = 0, b · w1 = c · w1 = 0."""
    facts = facts_of(context)
    products = [np.einsum("ni,nki->nk", facts.w(i), np.cross(facts.omega(i), facts.w(i)[:, None])) for i in (1, 2, 3)]
    across = [np.einsum("ni,ni->n", vector, facts.w(1)) for vector in (facts.b, facts.c)]
    return claim(
        "geometric relations of the velocity analysis",
        "Section 3.3: wᵢ(ωᵢ × wᵢ) = 0, bᵀw₁ = 0, cᵀw₁ = 0",
        judge([worst(products[0]), worst(products[1]), worst(products[2]), *map(worst, across)], 1e-9),
        f"All hold, to {text(max(map(worst, (*products, *across))))}; the product before the bracket is a scalar one.",
        [
            Figure("wᵢ·(ωᵢ × wᵢ), largest", max(map(worst, products)), "rad/m", _of(context)),
            Figure("bᵀw₁ and cᵀw₁, largest", max(map(worst, across)), "m", _of(context)),
        ],
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (mobility, constraints, strut_1_cannot_spin, unit_vectors)
"""One function a claim."""
