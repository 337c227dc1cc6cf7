"""Closure and mobility of the OmniLeg: loop rows and ranks with no joint cut, against what the paper states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from leg_dynamics.description import coupling_equations
from leg_dynamics.description.model import Description
from leg_dynamics.papers.comparison import claim
from leg_dynamics.papers.framework import Context, Figure, Verdict
from leg_dynamics.papers.judge import judge
from leg_dynamics.papers.omnileg.claims import box
from leg_dynamics.papers.omnileg.facts import Assembled, assembled

__all__ = [
    "GEARS",
    "SHAFT",
    "SHANK",
    "THIGH",
    "VERDICTS",
    "GroupMobility",
    "group_mobility",
    "joint_twists",
    "loop_matrix",
]

Array = np.ndarray

RANK_SHARE = 1e-9
"""Singular values below this share of the largest one count as zero; the gap there spans more than ten decades."""


def _path(description: Description, link: str) -> list[str]:
    return [joint.name for joint in description.path(link) if joint.is_single_coordinate]


def joint_twists(facts: Assembled) -> dict[str, Array]:
    """Unit twist (axis; point x axis) of every joint, tree and cut, in the hip frame, (N, 6); lengths in 0.1 m."""
    description = facts.leg.description
    ends: dict[str, tuple[str, Array, Any]] = {
        joint.name: (joint.child, np.eye(4), joint.axis) for joint in description.joints if joint.is_single_coordinate
    }
    for loop in description.loops:
        ends[loop.name] = (loop.predecessor.link, loop.predecessor.origin.matrix(), loop.axis)
    twists = {}
    for name, (link, origin, direction) in ends.items():
        pose = np.broadcast_to(facts.links[link], (len(facts.q), 4, 4)) @ origin
        axis = pose[:, :3, :3] @ np.asarray(direction)
        twists[name] = np.concatenate([axis, np.cross(pose[:, :3, 3] / 0.1, axis)], axis=-1)
    return twists


def loop_matrix(
    description: Description, loops: tuple[str, ...], twists: dict[str, Array]
) -> tuple[Array, tuple[str, ...]]:
    """Velocity constraints of closed loops with no joint cut.

    Around a loop the twists of all its joints add up to zero: six rows a loop, one column a joint, the cut joint among
    them. Gear pairs are one row each and bring no joint.

    Parameters
    ----------
    description : Description
    loops : tuple of str
        Names of loops and couplings.
    twists : dict
        From `joint_twists`.

    Returns
    -------
    (N, rows, joints) array, tuple of str
        The matrix and the joints behind its columns.
    """
    found = {loop.name: loop for loop in description.loops}
    gears = {equation.name: equation for equation in coupling_equations(description)}
    around: dict[str, dict[str, float]] = {}
    for name in loops:
        if name in gears:
            around[name] = dict(gears[name].coefficients)
            continue
        first, second = (
            _path(description, link) for link in (found[name].predecessor.link, found[name].successor.link)
        )
        signs = {joint: 1.0 for joint in first if joint not in second}
        signs |= {joint: -1.0 for joint in second if joint not in first}
        around[name] = signs | {name: 1.0}
    members = tuple(dict.fromkeys(joint for signs in around.values() for joint in signs))
    count = len(next(iter(twists.values())))
    rows = []
    for name, signs in around.items():
        block = np.zeros((count, 1 if name in gears else 6, len(members)))
        for joint, sign in signs.items():
            block[..., members.index(joint)] = sign if name in gears else sign * twists[joint]
        rows.append(block)
    return np.concatenate(rows, axis=1), members


@dataclass(frozen=True)
class GroupMobility:
    """Rows, joints and ranks of some loops.

    Attributes
    ----------
    rows, joints : int
    rank : int
        The same at every generic state asked for.
    rank_straight : int
        At states with gamma = 0.
    gap : float
        Smallest counted over largest uncounted singular value, the worst of all states.
    """

    rows: int
    joints: int
    rank: int
    rank_straight: int
    gap: float

    @property
    def gruebler(self) -> int:
        """Joints minus rows."""
        return self.joints - self.rows

    @property
    def mobility(self) -> int:
        """Joints minus rank."""
        return self.joints - self.rank

    @property
    def redundant(self) -> int:
        """Rows that follow from the others."""
        return self.rows - self.rank


THIGH = ("loop_B2", "loop_B3")
SHAFT = ("loop_B4",)
SHANK = ("loop_E2", "loop_E3")
GEARS = ("bevel_1", "bevel_2", "bevel_3")


STRAIGHT = 20
"""States with gamma = 0."""


def _ranks(K: Array) -> tuple[int, float]:
    """Largest rank over states, NaN-safe, and the worst gap at it."""
    sigma = np.linalg.svd(K, compute_uv=False)
    counted = (sigma > RANK_SHARE * sigma[:, :1]).sum(axis=1)
    rank = int(counted.max())
    if (counted != rank).any():
        return rank, 0.0
    below = sigma[:, rank].max() if rank < sigma.shape[1] else 0.0
    return rank, float(sigma[:, rank - 1].min() / max(below, np.finfo(float).tiny))


def group_mobility(context: Context, loops: tuple[str, ...]) -> GroupMobility:
    """Mobility of a group of loops at bent and at straight states."""

    def twists() -> tuple[dict[str, Array], dict[str, Array]]:
        every = assembled(context)
        bent = every.q[:, 2] > np.radians(2.0)
        at_zero = Assembled(context.pinocchio, every.q[bent][:STRAIGHT] * np.array([1.0, 1.0, 0.0]))
        return {name: twist[bent] for name, twist in joint_twists(every).items()}, joint_twists(at_zero)

    def compute() -> GroupMobility:
        bent, straight = context.once("claims: twists", twists)
        description = context.leg.description
        K, members = loop_matrix(description, loops, bent)
        rank, gap = _ranks(K)
        at_zero, _ = _ranks(loop_matrix(description, loops, straight)[0])
        return GroupMobility(K.shape[1], len(members), rank, at_zero, gap)

    return context.once(f"mobility of {', '.join(loops)}", compute)


def _mobility(context: Context, item: str, title: str, loops: tuple[str, ...], stated: int, note: str = "") -> Verdict:
    group = group_mobility(context, loops)
    of = box(context, "bent")
    agrees = float(group.mobility - stated)
    return claim(
        item,
        title,
        judge(agrees, 0.0),
        f"{group.joints} joints and {group.rows} loop rows of rank {group.rank}: {group.redundant} redundant, mobility "
        f"{group.mobility} where Grübler's "
        f"count gives {group.gruebler}. {note}".strip(),
        [
            Figure("joints", group.joints, "", "no joint cut"),
            Figure("loop rows", group.rows, "", "six a loop, one a gear pair"),
            Figure("rank", group.rank, "", of),
            Figure("redundant rows", group.redundant, "", of),
            Figure("Grübler's count", group.gruebler, "", "joints minus rows"),
            Figure("mobility", group.mobility, "", of),
            Figure("mobility at γ = 0", group.joints - group.rank_straight, "", f"{STRAIGHT} states"),
            Figure("rank gap", group.gap, "", "smallest counted over largest uncounted singular value"),
        ],
    )


def mobility_thigh(context: Context) -> Verdict:
    """Two degrees of freedom of the thigh."""
    return _mobility(
        context,
        "two degrees of freedom of the thigh",
        "Three parallel U-rod-U chains form a thigh of two degrees of freedom",
        THIGH,
        2,
    )


def mobility_shaft(context: Context) -> Verdict:
    """The Cardan shaft adds one."""
    thigh, both = group_mobility(context, THIGH), group_mobility(context, THIGH + SHAFT)
    return _mobility(
        context,
        "the Cardan shaft passes one motion through the thigh",
        "Thigh with the Cardan shaft",
        THIGH + SHAFT,
        3,
        f"The shaft brings {both.rows - thigh.rows} rows of rank {both.rank - thigh.rank}; the redundant one is axial, "
        f"a spline would free it.",
    )


def mobility_shank(context: Context) -> Verdict:
    """One degree of freedom of the shank."""
    shank = group_mobility(context, SHANK)
    return _mobility(
        context,
        "one degree of freedom of the shank",
        "Three C-D-E chains form a shank of one degree of freedom",
        SHANK,
        1,
        f"At γ = 0 the rank falls to {shank.rank_straight}, and each chain may fold either way: only the gears settle "
        f"it.",
    )


def mobility_leg(context: Context) -> Verdict:
    """Three degrees of freedom of the leg."""
    whole = group_mobility(context, THIGH + SHAFT + SHANK + GEARS)
    free = group_mobility(context, THIGH + SHAFT + SHANK)
    report = context.pinocchio.mobility_report(samples=20, seed=context.seed)
    return _mobility(
        context,
        "three degrees of freedom of the leg",
        "The whole leg with its bevel gears has three degrees of freedom",
        THIGH + SHAFT + SHANK + GEARS,
        3,
        f"The numeric route finds the same mobility {report.mobility} and {report.redundant} redundant rows in its cut "
        f"tree. Without the gears the "
        f"mobility is {free.mobility}, and {free.joints - free.rank_straight} at γ = 0; with them it stays "
        f"{whole.joints - whole.rank_straight}.",
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (mobility_thigh, mobility_shaft, mobility_shank, mobility_leg)
"""One function a claim, in the paper's order."""
