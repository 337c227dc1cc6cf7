"""Claims of Xu et al. 2025 in words and in percentages, each judged by numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from leg_dynamics.description import coupling_equations
from leg_dynamics.description.model import Description
from leg_dynamics.papers.framework import Context, Figure, Status, Verdict
from leg_dynamics.papers.omnileg import printed
from leg_dynamics.papers.omnileg.equations import (
    FORCE_TOLERANCE,
    POSITION_TOLERANCE,
    RATE_TOLERANCE,
    Assembled,
    array,
    assembled,
    formula,
    judge,
    lagrange_torque,
    mass_matrix_of,
    motions,
    omega_of,
    states,
    text,
    worst,
)
from leg_dynamics.papers.omnileg.scenarios import REPORTED

__all__ = ["VERDICTS", "GroupMobility", "group_mobility", "joint_twists", "loop_matrix"]

Array = np.ndarray

RANK_SHARE = 1e-9
"""Singular values below this share of the largest one count as zero; the gap there spans more than ten decades."""

LEAST_SHARE = 0.01
"""A neglect is called small while it stays below this share of what it is neglected beside."""

ROOM = 1e-9
"""rad; how far beyond a limit still counts as at it."""


def _claim(
    item: str,
    title: str,
    status: Status,
    finding: str,
    figures: Iterable[Figure] = (),
    forms: tuple[str, str] = ("", ""),
) -> Verdict:
    return Verdict(f"claim: {item}", "claim", title, status, finding, tuple(figures), *forms)


def _of(context: Context, what: str = "") -> str:
    return f"{what + ', ' if what else ''}{len(states(context))} states of the box of joint limits"


# ---------------------------------------------------------------------- what Fig. 3 shows


def _inside(context: Context, p: Array, lower: Array, upper: Array) -> Array:
    """Whether foot positions can be reached within limits."""
    q = context.leg.inverse_kinematics(p, limits="ignore", on_error="nan")
    with np.errstate(invalid="ignore"):
        return np.asarray(((q >= lower - ROOM) & (q <= upper + ROOM)).all(axis=-1))


def _turned(p: Array, degrees: float, mirrored: bool) -> Array:
    """Foot positions after Y -> -Y, where asked for, and a rotation about Z."""
    turn = printed.rot(printed.Z, np.radians(degrees))
    return (p * np.array([1.0, -1.0 if mirrored else 1.0, 1.0])) @ turn.T


def _leaving(context: Context, p: Array, lower: Array, upper: Array, step: int = 15) -> dict[tuple[int, bool], float]:
    """Share of the workspace that each rotation and reflection about Z moves out of it."""
    return {
        (angle, mirrored): float(1.0 - _inside(context, _turned(p, angle, mirrored), lower, upper).mean())
        for mirrored in (False, True)
        for angle in range(0, 360, step)
    }


def symmetry(context: Context) -> Verdict:
    """Symmetry of the foot's workspace."""
    lower, upper = context.limits
    p = context.leg.foot_position(context.q[:500])
    leaving = _leaving(context, p, lower, upper)
    exact = [turn for turn, share in leaving.items() if share == 0.0]
    square = max(leaving[angle, mirrored] for mirrored in (False, True) for angle in (0, 90, 180, 270))
    rotations = [angle for angle, mirrored in exact if not mirrored]
    at_45 = leaving[45, False]
    # The printed, unsigned ranges.
    low, high = np.radians(printed.RANGES).T
    q = low + context.rng(301).random((500, 3)) * (high - low)
    printed_exact = [
        t for t, share in _leaving(context, context.leg.foot_position(q), low, high).items() if share == 0.0
    ]
    # Inside a cone of tilt every direction is alike.
    tilt = min(upper[:2])
    azimuth = np.radians(np.arange(0.0, 360.0, 5.0))
    rim = context.numbers.L1 * np.stack(
        [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), 0.0 * azimuth], axis=-1
    )
    rim[:, 2] = context.numbers.L1 * np.cos(tilt) + 2.0 * context.numbers.L4 * np.cos(0.5) + context.numbers.L5
    cone = float(_inside(context, rim, lower, upper).mean())
    mass = context.leg.mass_matrix(context.q[:100])
    swapped = context.leg.mass_matrix(context.q[:100][:, [1, 0, 2]])
    dynamic = worst((mass[:, 0, 0] - swapped[:, 1, 1]) / mass[:, 0, 0])
    every = max(leaving.values())
    return _claim(
        "complete symmetry of the foot's workspace",
        "Fig. 3: the region of motion of the foot is completely symmetric",
        judge(every, square, 0.0),
        f"Of {len(leaving)} rotations and reflections about Z, {len(exact)} map the workspace onto itself: the turns "
        f"by "
        f"{', '.join(f'{a}°' for a in rotations)} and {len(exact) - len(rotations)} reflections (a square's symmetry). "
        f"A turn by 45° takes {100.0 * at_45:.1f} % of it "
        f"outside. Within a tilt of {np.degrees(tilt):.0f}° all directions are alike ({100.0 * cone:.0f} % of that rim "
        f"is reached). Table 2's unsigned "
        f"ranges would leave {len(printed_exact)}.",
        [
            Figure(
                "symmetries of the workspace",
                len(exact),
                "",
                f"of {len(leaving)} rotations and reflections every 15 deg",
            ),
            Figure("outside after 45 deg", at_45, "", "share of 500 foot positions inside the limits"),
            Figure("outside, worst", every, "", "share of 500 foot positions, over those rotations and reflections"),
            Figure("rim of the cone reached", cone, "", "72 directions at the limit of tilt"),
            Figure("symmetries with unsigned ranges", len(printed_exact), "", "α, β in 0 to 65 deg"),
            Figure(
                "inertia of M2 beside M1 with α and β exchanged",
                dynamic,
                "",
                "largest relative difference, assumed masses",
            ),
        ],
        (
            "symmetric under every rotation about Z",
            "symmetric under the 8 elements of D4; under all rotations inside a cone",
        ),
    )


def motors_in_the_hip(context: Context) -> Verdict:
    """Motors fixed to the hip."""
    facts = assembled(context)
    motors = [link.name for link in context.leg.description.links if link.name.startswith("motor_")]
    moving = max(max(worst(facts.velocity(m)), worst(facts.omega(m))) for m in motors)
    description = context.leg.description
    masses = {link.name: link.inertial.mass for link in description.links if link.inertial is not None}
    hub = sum(masses[m] for m in motors)
    total = sum(float(body.mass) for body in context.numbers.bodies)
    # The same motors at the knee would move with it.
    knee = facts.velocity("knee")
    added = hub * np.einsum("nij,nij->nj", knee, knee)
    gain = float((added[:, 0] / context.leg.mass_matrix(facts.q)[:, 0, 0]).max())
    return _claim(
        "motors fixed in the hip",
        "Fig. 3: all motors are fixed to the hip plate, which lowers the inertia",
        judge(moving, moving, RATE_TOLERANCE),
        f"The {len(motors)} motors have no velocity for any unit rate (to {text(moving)}). At the knee, their assumed "
        f"{hub:g} kg beside {total:.3g} kg of "
        f"moving parts would raise the inertia at α by up to {100.0 * gain:.0f} %.",
        [
            Figure("velocity of the motors", moving, "m/rad or 1", _of(context, "for unit rates")),
            Figure("motors", len(motors), "", "the file"),
            Figure("inertia added by motors at the knee", gain, "", _of(context, "share of M_αα, assumed masses")),
        ],
    )


def no_rotation(context: Context) -> Verdict:
    """The foot does not rotate."""
    facts = assembled(context)
    tilt = {link: worst(facts.rotation(link) - np.eye(3)) for link in ("knee", "foot")}
    spin = {link: worst(facts.omega(link)) for link in ("knee", "foot")}
    error = max(*tilt.values(), *spin.values())
    return _claim(
        "the foot does not rotate",
        "Fig. 3: no rotation of the foot accompanies its motion; nor of the knee",
        judge(error, error, RATE_TOLERANCE),
        f"Assembled from its hinges alone, the mechanism keeps the foot's axes within {text(tilt['foot'])} of the "
        f"hip's and its angular velocity below "
        f"{text(spin['foot'])} for unit rates; the knee likewise ({text(tilt['knee'])}, {text(spin['knee'])}).",
        [
            *(
                Figure(f"rotation of the {link}", tilt[link], "", _of(context, "largest entry of R − I"))
                for link in tilt
            ),
            *(
                Figure(f"angular velocity of the {link}", spin[link], "", _of(context, "for unit rates"))
                for link in spin
            ),
        ],
    )


def bearing_and_driving(context: Context) -> Verdict:
    """The Cardan shaft inside the thigh."""
    facts = assembled(context)
    ends = {k: (facts.position(f"cross_A{k}"), facts.position(f"cross_B{k}")) for k in (1, 2, 3, 4)}
    gap = {}
    names = ((4, 1), (4, 2), (4, 3), (1, 2), (1, 3), (2, 3))
    for i, j in names:
        (a, b), (c, _) = ends[i], ends[j]
        along = (b - a) / np.linalg.norm(b - a, axis=-1, keepdims=True)
        gap[i, j] = float(np.linalg.norm(np.cross(c - a, along), axis=-1).min())
    # Least over the whole box: the limits of one angle, the other zero.
    _, upper = context.limits
    corner = Assembled(context.pinocchio, np.array([[upper[0], 0.0, 0.5], [0.0, upper[1], 0.5]]))
    for k in (1, 2, 3):
        a, b = corner.position("cross_A4"), corner.position("cross_B4")
        along = (b - a) / np.linalg.norm(b - a, axis=-1, keepdims=True)
        gap[4, k] = min(
            gap[4, k], float(np.linalg.norm(np.cross(corner.position(f"cross_A{k}") - a, along), axis=-1).min())
        )
    least = min(gap.values())
    thickest = 0.5 * least
    return _claim(
        "the thigh carries and drives",
        "Fig. 3: the thigh bears the load and houses the drive of the shank",
        Status.CONFIRMED if least > 0.0 else Status.NOT_REPRODUCIBLE,
        f"Rods and Cardan shaft stay parallel inside the thigh; their axes come no closer than {1e3 * least:.1f} mm, "
        f"which leaves room for radii of "
        f"{1e3 * thickest:.1f} mm each.",
        [Figure("least distance of two axes", least, "m", _of(context, "rods and Cardan shaft"))],
    )


def two_ways_to_lift(context: Context) -> Verdict:
    """Lifting by the shank alone, or by thigh and shank."""
    lower, upper = context.limits
    height = printed.GAIT["H"]
    gamma = np.linspace(lower[2], upper[2], 50)
    alone = context.leg.foot_position(np.column_stack([0.0 * gamma, 0.0 * gamma, gamma]))
    straight_up = worst(alone[:, :2])
    by_shank = float(np.ptp(alone[:, 2]))
    tilt = np.linspace(0.0, upper[0], 50)
    thigh = context.leg.foot_position(np.column_stack([tilt, 0.0 * tilt, np.full_like(tilt, 0.7)]))
    by_thigh, aside = float(np.ptp(thigh[:, 2])), float(np.ptp(thigh[:, 1]))
    # Both together: the lift of (53), while the foot goes forward.
    t = np.linspace(0.0, 1.0, 51)
    d = printed.path_53(t, **printed.GAIT)
    p = np.column_stack([d[:, 0], d[:, 1] - 0.05, 0.42 - d[:, 2]])
    q = context.leg.inverse_kinematics(p)
    moved = np.degrees(np.ptp(q, axis=0))
    both = bool(by_shank >= height and moved[0] > 1.0 and moved[2] > 1.0)
    return _claim(
        "two ways to lift the foot",
        "Fig. 3: the foot is lifted by thigh and shank together, or by the shank alone",
        Status.CONFIRMED if both else Status.NOT_REPRODUCIBLE,
        f"The shank alone lifts it by up to {1e3 * by_shank:.0f} mm straight up (sideways {text(straight_up)} m). The "
        f"thigh alone lifts it by "
        f"{1e3 * by_thigh:.0f} mm but {1e3 * aside:.0f} mm aside; the step (53) of {1e3 * height:.0f} mm uses both "
        f"({moved[0]:.0f}° of α, {moved[2]:.0f}° of γ).",
        [
            Figure("lift by the shank", by_shank, "m", "γ over its range, thigh vertical"),
            Figure("sideways motion meanwhile", straight_up, "m", "γ over its range"),
            Figure("lift by the thigh", by_thigh, "m", "α from 0 to its limit"),
            Figure("turn of α in a step", moved[0], "deg", "(53) with z0 = 0.42 m, centred"),
            Figure("turn of γ in a step", moved[2], "deg", "(53) with z0 = 0.42 m, centred"),
        ],
    )


def omnidirectional(context: Context) -> Verdict:
    """Turning about Z0 without turning the foot."""
    azimuth = np.radians(np.arange(0.0, 360.0, 10.0))
    tilt = np.radians(40.0)
    alpha = np.arctan(-np.tan(tilt) * np.sin(azimuth))
    beta = np.arctan(np.tan(tilt) * np.cos(azimuth))
    facts = Assembled(context.pinocchio, np.column_stack([alpha, beta, np.full_like(alpha, 0.8)]))
    foot = facts.position("foot")
    radius = np.linalg.norm(foot[:, :2], axis=-1)
    ring = worst(radius - context.numbers.L1 * np.sin(tilt))
    round_about = worst(np.angle(np.exp(1j * (np.arctan2(foot[:, 1], foot[:, 0]) - azimuth))))
    still = worst(facts.rotation("foot") - np.eye(3))
    error = max(ring, round_about, still)
    return _claim(
        "turning about X0 and Y0 replaces turning about Z0",
        "The thigh's two fixed axes point the leg in every direction",
        judge(error, error, POSITION_TOLERANCE),
        f"With tan α = −tan δ sin ψ and tan β = tan δ cos ψ the foot goes round a circle (δ = 40°, radius to "
        f"{text(ring)} m, direction to "
        f"{text(round_about)} rad) without turning ({text(still)}).",
        [
            Figure("error of the circle", ring, "m", "36 directions"),
            Figure("rotation of the foot", still, "", "36 directions"),
        ],
    )


def independent_motions(context: Context) -> Verdict:
    """Thigh and shank move independently."""
    facts = assembled(context)
    mixed = max(
        worst(facts.velocity("knee")[..., 2]), worst((facts.velocity("foot") - facts.velocity("knee"))[..., :2])
    )
    sideways = worst(facts.velocity("foot")[:, :2, 2])
    M = context.leg.mass_matrix(facts.q)
    coupled = float(np.abs(M[:, :2, 2] / np.sqrt(M[:, [0, 1], [0, 1]] * M[:, 2:, 2])).max())
    return _claim(
        "thigh and shank move independently",
        "The kinematics of thigh and shank can be modelled one by one",
        judge(max(mixed, sideways), max(mixed, sideways), RATE_TOLERANCE),
        f"γ does not move the knee, and α, β do not change the shank (to {text(max(mixed, sideways))} m/rad). The "
        f"dynamics are coupled: "
        f"|M_iγ|/√(M_ii M_γγ) reaches {coupled:.2f}.",
        [
            Figure("coupling of the velocities", max(mixed, sideways), "m/rad", _of(context, "for unit rates")),
            Figure("coupling of the inertia", coupled, "", _of(context, "assumed masses")),
        ],
    )


# ---------------------------------------------------------------------- closure and mobility


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
    of = _of(context, "bent")
    agrees = float(group.mobility - stated)
    return _claim(
        item,
        title,
        judge(agrees, agrees, 0.0),
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


# ---------------------------------------------------------------------- Cardan shaft


def _ripple(alpha: float, beta: float, context: Context) -> tuple[float, float, float, float, float]:
    """Bend (rad), least and greatest shaft/input, lead (rad), greatest out/in with yokes a quarter turn off."""
    gamma = np.linspace(0.0, np.pi, 361)
    q = np.column_stack([np.full_like(gamma, alpha), np.full_like(gamma, beta), gamma])
    own = omega_of(motions(context, "transmission_motions", q)["shaft_A4B4"], q)[..., 2]
    r = formula(context, "knee_position", q) / context.numbers.L1
    ratio = np.einsum("ni,ni->n", own, r)
    # Angle of the shaft beside that of the input: the integral of the ratio.
    step = gamma[1] - gamma[0]
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (ratio[1:] + ratio[:-1]) * step)])
    apart = turned - gamma
    lead = 0.5 * float(apart.max() - apart.min())
    bend = float(np.arccos(np.clip(r[0, 2], -1.0, 1.0)))
    return bend, float(ratio.min()), float(ratio.max()), lead, float(ratio.max() ** 2)


CARDAN_POSES = ((10.0, 0.0), (30.0, 0.0), (30.0, 30.0), (65.0, 0.0), (65.0, 65.0))


def cardan_output(context: Context) -> Verdict:
    """The output shaft turns as the input."""
    facts = assembled(context)
    speed = worst(facts.omega("output_shaft") - facts.omega("input_shaft"))
    angle = worst(facts.angle("gamma_output") - facts.q[:, 2])
    gears = [worst(np.linalg.norm(facts.omega(f"driven_gear_{i}")[..., 2], axis=-1) - 1.0) for i in (1, 2, 3)]
    error = max(speed, *gears)
    return _claim(
        "output shaft and gears turn as fast as the input",
        "Input shaft, output shaft and bevel gears have the same speed",
        judge(error, error, RATE_TOLERANCE),
        f"With parallel plates and yokes in phase the output equals the input at every α and β, moving or not (angle "
        f"to {text(angle)} rad, rates to "
        f"{text(speed)}); the driven gears have its speed (to {text(max(gears))}). γ at the gears carries no error.",
        [
            Figure("output angle minus input angle", angle, "rad", _of(context)),
            Figure("output rate minus input rate", speed, "", _of(context, "for unit rates")),
            Figure("speed of the driven gears minus 1", max(gears), "", _of(context, "for a unit γ̇")),
        ],
    )


def gears_same_vector(context: Context) -> Verdict:
    """The same angular velocity."""
    facts = assembled(context)
    vector = worst(facts.omega("driven_gear_2") - facts.omega("input_shaft"))
    psi = float(context.numbers.psi[1])
    right = worst(facts.omega("driven_gear_2")[..., 2] - np.array([np.cos(psi), np.sin(psi), 0.0]))
    return _claim(
        "the bevel gears have the angular velocity of the input",
        "Below (25): input, output and all bevel gears share one angular velocity",
        judge(vector, right, RATE_TOLERANCE),
        f"As vectors they differ by up to {text(vector)} for a unit γ̇: the driven gears turn about X_Ci (off by "
        f"{text(right)}), only the speed is "
        "shared.",
        [Figure("driven gear minus input shaft", vector, "", _of(context, "angular velocity for unit rates"))],
        ("ω of all four bevel gears = [0 0 γ̇]", "driver: [0 0 γ̇]; driven: γ̇ X_Ci"),
    )


def shaft_ripple(context: Context) -> Verdict:
    """What the neglected ripple is."""
    figures = []
    parts = []
    error = 0.0
    for alpha, beta in CARDAN_POSES:
        bend, least, most, lead, off = _ripple(np.radians(alpha), np.radians(beta), context)
        error = max(error, abs(least - np.cos(bend)), abs(most - 1.0 / np.cos(bend)))
        at = f"α = {alpha:g}, β = {beta:g} deg"
        parts.append(f"{np.degrees(bend):.1f}°: {least:.3f} to {most:.3f}, {np.degrees(lead):.2g}° ahead or behind")
        figures += [
            Figure("bend", np.degrees(bend), "deg", at),
            Figure("least shaft/input", least, "", at),
            Figure("greatest shaft/input", most, "", at),
            Figure("lead or lag", np.degrees(lead), "deg", at),
            Figure("greatest output/input with yokes 90 deg off", off, "", at),
        ]
    return _claim(
        "the shaft turns at a varying rate",
        "The shaft A4B4 does not turn as uniformly as the input shaft",
        judge(error, error, 1e-3),
        f"Shaft over input by bend: {'; '.join(parts)}. The limits are cos θ and 1/cos θ (to {text(error)}).",
        figures,
    )


# ---------------------------------------------------------------------- the simplification (26)-(31)


def _simplified(context: Context, kind: str) -> Callable[[Array], Array]:
    """Mass matrix with the shaft and its crosses moving as (26)-(31) say ("paper"), or not turning at all ("none")."""

    def crosses(q: Array) -> tuple[Array, Array]:
        omega = printed.omega_cross_A4(q) if kind == "paper" else printed.columns(q)
        return printed.rot(printed.Y, q[..., 1]), omega

    def shaft(q: Array) -> tuple[Array, Array]:
        return printed.rod_rotation(q), printed.omega_shaft(q) if kind == "paper" else printed.columns(q)

    replaced = {"cross_A4": crosses, "cross_B4": crosses, "shaft_A4B4": shaft}
    return lambda q: mass_matrix_of(context, q, replaced=replaced)


def _along_52(rate: float, duration: float = 2.0) -> tuple[Array, Array, Array]:
    w = np.pi / 3.0
    t = np.linspace(0.0, duration, 21)
    q, amplitude = printed.motion_52(t), printed.motion_52(np.array(1.5))
    return q, rate * w * amplitude * np.cos(w * t)[:, None], -((rate * w) ** 2) * q


def _neglected(context: Context) -> dict[str, Array]:
    """Largest torque differences along (52) on (alpha, beta, gamma), mN·m."""

    def compute() -> dict[str, Array]:
        found = {}
        for rate in (1.0, 10.0):
            motion = _along_52(rate)
            exact = lagrange_torque(lambda q: mass_matrix_of(context, q), *motion)
            for kind in ("paper", "none"):
                other = lagrange_torque(_simplified(context, kind), *motion)
                found[f"{kind} {rate:g}"] = 1e3 * np.abs(other - exact).max(axis=0)
            found[f"inertial {rate:g}"] = 1e3 * np.abs(exact).max(axis=0)
        q, v, a = _along_52(1.0)
        found["whole"] = 1e3 * np.abs(context.leg.generalized_force(q, v, a)).max(axis=0)
        route = context.leg.generalized_force(q, v, a, gravity=np.zeros(3))
        found["route"] = 1e3 * np.abs(route - lagrange_torque(lambda q: mass_matrix_of(context, q), q, v, a)).max(
            axis=0
        )
        return found

    return context.once("claims: neglected", compute)


def simplification_kinematic(context: Context) -> Verdict:
    """Small or not, in velocities."""
    facts = assembled(context)
    share = {}
    for link, wrong in (
        ("cross_A4", printed.omega_cross_A4),
        ("cross_B4", printed.omega_cross_B4),
        ("shaft_A4B4", printed.omega_shaft),
    ):
        share[link] = worst(wrong(facts.q) - facts.omega(link))
    small = max(share.values())
    own = max(
        worst(omega_of(motions(context, "transmission_motions", facts.q)[link], facts.q) - facts.omega(link))
        for link in share
    )
    return _claim(
        "neglecting the shaft's ripple is small, as motion",
        "(26)-(31): neglecting ripple and coupling changes little, in angular velocity",
        judge(small, own, LEAST_SHARE),
        f"For unit rates the angular velocities are off by up to {share['cross_A4']:.2f} (crosses) and "
        f"{share['shaft_A4B4']:.2f} (shaft): as large as the rates "
        f"themselves. Exact ones cost nothing more (left: {text(own)}).",
        [
            Figure(f"{link}, (26)-(29) against the mechanism", value, "", _of(context, "for unit rates"))
            for link, value in share.items()
        ],
    )


def simplification_torque(context: Context) -> Verdict:
    """Small or not, in torques."""
    found = _neglected(context)
    share = float((found["paper 1"] / found["whole"]).max())
    checked = worst(found["route"]) * 1e-3
    listed = {name: "/".join(text(x) for x in values) for name, values in found.items()}
    return _claim(
        "neglecting the shaft's ripple is small, as torque",
        "(26)-(31): neglecting ripple and coupling changes little, in motor torque",
        judge(share if checked < FORCE_TOLERANCE else 1.0, 0.0, LEAST_SHARE),
        f"Along (52), 0 to 2 s, (26)-(31) change the torques on α/β/γ by {listed['paper 1']} mN·m, of "
        f"{listed['whole']} mN·m (assumed masses); ten times as fast by "
        f"{listed['paper 10']} mN·m. Leaving out the rotary inertia of shaft and crosses altogether changes "
        f"{listed['none 1']} mN·m: the "
        "fixed axis of (29) puts the shaft's transverse inertia into γ̇.",
        [
            *(
                Figure(f"paper's simplification, {n}", found["paper 1"][i], "mN·m", "(52), 0 to 2 s, assumed masses")
                for i, n in enumerate("αβγ")
            ),
            *(
                Figure(f"ten times as fast, {n}", found["paper 10"][i], "mN·m", "(52), assumed masses")
                for i, n in enumerate("αβγ")
            ),
            *(
                Figure(f"no rotary inertia, {n}", found["none 1"][i], "mN·m", "(52), 0 to 2 s, assumed masses")
                for i, n in enumerate("αβγ")
            ),
            Figure("share of the torque", share, "", "worst motor, (52), 0 to 2 s, assumed masses"),
        ],
    )


def cause_of_5_2(context: Context) -> Verdict:
    """Attribution of the error on M3."""
    found = _neglected(context)
    reported = float(REPORTED["Fig. 11", "M3"].error)
    ours = float(found["paper 1"][2])
    factor = reported / ours
    explained = 1.0 / 3.0 <= factor <= 3.0
    return _claim(
        "5.2 mN·m on M3 come from the neglected ripple",
        "Fig. 11: the errors are due to the neglected ripple and to the drives PL_i",
        Status.CONFIRMED if explained else Status.NOT_REPRODUCIBLE,
        f"The neglect of (26)-(31) gives {ours:.2g} mN·m on M3 with plausible masses, {factor:.0f} times less than the "
        f"reported {reported:g} mN·m: shaft and crosses "
        f"would have to be {factor:.0f} times heavier. PL_i, the other cause named, has no stated inertia.",
        [
            Figure("neglect on M3", ours, "mN·m", "(52), 0 to 2 s, assumed masses"),
            Figure("reported over computed", factor, "", "M3"),
        ],
    )


def light_parts(context: Context) -> Verdict:
    """Share of the mass."""
    masses = {body.name: float(body.mass) for body in context.numbers.bodies}
    light = sum(masses[name] for name in ("shaft_A4B4", "cross_A4", "cross_B4"))
    share = light / sum(masses.values())
    return _claim(
        "shaft and crosses are a small share of the mass",
        "The shaft A4B4 and its crosses weigh little beside the leg",
        Status.NOT_REPRODUCIBLE,
        f"The paper states no mass. With the assumed ones it is {100.0 * share:.1f} % of {sum(masses.values()):.2f} "
        f"kg.",
        [Figure("share of the moving mass", share, "", "assumed masses")],
    )


# ---------------------------------------------------------------------- percentages


OTHER_AMPLITUDE = "45°"
"""In the name of a full value that (52) has with this amplitude of gamma, and not with the printed one."""


def _size(value: float) -> str:
    """A full value for a sentence: three digits, without an exponent."""
    return text(value) if value < 1000.0 else f"{float(text(value)):.0f}"


def _percent(
    place: str,
    quantity: str,
    candidates: dict[str, float],
) -> tuple[tuple[float, float], dict[str, float], list[str]]:
    """Range of the full value that an error and its share imply, the share by each candidate, and those that fit."""
    reported = REPORTED[place, quantity]
    reference = reported.reference
    assert reference is not None
    shares = {name: 100.0 * float(reported.error) / value for name, value in candidates.items()}
    fitting = [name for name, value in candidates.items() if reference[0] <= value <= reference[1]]
    return reference, shares, sorted(fitting, key=lambda name: OTHER_AMPLITUDE in name)


def _share_verdict(
    context: Context,
    item: str,
    title: str,
    place: str,
    quantity: str,
    candidates: dict[str, float],
    *,
    corrected_by: str = "",
    note: str = "",
) -> Verdict:
    """Verdict on a percentage, by whether any computed full value gives it.

    Candidates come in the unit of the reported error. `corrected_by` names the one that the paper's other percentages
    in the same place use; where it does not fit, it corrects the percentage.
    """
    reported = REPORTED[place, quantity]
    (low, high), shares, fitting = _percent(place, quantity, candidates)
    as_printed = [name for name in fitting if OTHER_AMPLITUDE not in name]
    agrees = 0.0 if as_printed else 1.0
    status = judge(agrees, 0.0 if corrected_by else 1.0, 0.5)
    listed = ", ".join(
        f"{name} {_size(value)} {reported.unit} ({shares[name]:.2g} %)" for name, value in candidates.items()
    )
    implied = f"{_size(low)} to {_size(high)} {reported.unit}"
    opening = f"{reported.error} {reported.unit} at {reported.percent} % imply a full value of {implied}"
    answer = f"{'' if as_printed else 'only '}the {fitting[0]} fits" if fitting else "nothing computed fits"
    return _claim(
        item,
        title,
        status,
        f"{opening}: {answer}. Computed: {listed}. {note}".strip(),
        [
            Figure("least full value implied", low, reported.unit, "error and percentage as rounded"),
            Figure("greatest full value implied", high, reported.unit, "error and percentage as rounded"),
            *(
                Figure(f"percentage by the {name}", shares[name], "%", f"{reported.error} {reported.unit}")
                for name in candidates
            ),
        ],
        (
            f"{reported.percent} %",
            f"{shares[corrected_by]:.2g} % of the {corrected_by}" if status is Status.CORRECTED else "",
        ),
    )


def _path_51(context: Context) -> tuple[Array, Array, Array]:
    """Displacement, velocity and acceleration along (51), 501 samples; any height."""

    def compute() -> tuple[Array, Array, Array]:
        from leg_dynamics.analysis.trajectories import omnileg_eq51_path

        path, t = omnileg_eq51_path(0.0), np.linspace(0.0, 5.0, 501)
        return path.value(t), path.value(t, 1), path.value(t, 2)

    return context.once("claims: (51)", compute)


def _path_52(context: Context, degrees: float) -> tuple[Array, Array, Array]:
    """Foot position, velocity and acceleration along a period of (52)."""

    def compute() -> tuple[Array, Array, Array]:
        from leg_dynamics.analysis.trajectories import omnileg_eq52

        m = omnileg_eq52(6.0, 100.0, gamma_amplitude=np.radians(degrees))
        leg = context.leg
        return leg.foot_position(m.q), leg.foot_velocity(m.q, m.v), leg.foot_acceleration(m.q, m.v, m.a)

    return context.once(f"claims: (52) {degrees:g}", compute)


def _peaks(values: Array, factor: float) -> dict[str, float]:
    peak = factor * np.abs(values).max(axis=0)
    return {
        **{f"peak in {axis}": float(x) for axis, x in zip("XYZ", peak, strict=True)},
        "peak of the norm": factor * float(np.linalg.norm(values, axis=1).max()),
    }


def _spans(values: Array, factor: float, note: str = "") -> dict[str, float]:
    return {f"span in {axis}{note}": float(x) for axis, x in zip("XYZ", factor * np.ptp(values, axis=0), strict=True)}


def percent_ik_position(context: Context) -> Verdict:
    """42.5 µm, 0.04 %."""
    return _share_verdict(
        context,
        "inverse kinematics simulation, position error",
        "42.5 µm of the inverse kinematics' simulation as a share",
        "Fig. 9",
        "position",
        _spans(_path_51(context)[0], 1e6),
    )


def percent_ik_velocity(context: Context) -> Verdict:
    """74 µm/s, 0.09 %."""
    return _share_verdict(
        context,
        "inverse kinematics simulation, velocity error",
        "74 µm/s of the inverse kinematics' simulation as a share",
        "Fig. 9",
        "velocity",
        _peaks(_path_51(context)[1], 1e6),
    )


def percent_ik_acceleration(context: Context) -> Verdict:
    """1.5 mm/s², 1.8 %."""
    return _share_verdict(
        context,
        "inverse kinematics simulation, acceleration error",
        "1.5 mm/s² of the inverse kinematics' simulation as a share",
        "Fig. 9",
        "acceleration",
        _peaks(_path_51(context)[2], 1e3),
    )


def _both(function: Callable[[float], dict[str, float]]) -> dict[str, float]:
    """Candidates at the printed amplitude of 25 deg and at 45 deg."""
    printed_ones = function(25.0)
    return _changed(printed_ones | {f"{name} with {OTHER_AMPLITUDE}": value for name, value in function(45.0).items()})


def _changed(candidates: dict[str, float]) -> dict[str, float]:
    """Leave out what the other amplitude does not change by 1 %."""
    suffix = f" with {OTHER_AMPLITUDE}"

    def differs(name: str, value: float) -> bool:
        return not name.endswith(suffix) or abs(value / candidates[name.removesuffix(suffix)] - 1.0) > 0.01

    return {name: value for name, value in candidates.items() if differs(name, value)}


def percent_fk_position(context: Context) -> Verdict:
    """45 µm, 0.05 %."""
    return _share_verdict(
        context,
        "forward kinematics simulation, position error",
        "45 µm of the forward kinematics' simulation as a share",
        "Fig. 10",
        "position",
        _both(lambda degrees: _spans(_path_52(context, degrees)[0], 1e6)),
    )


def percent_fk_velocity(context: Context) -> Verdict:
    """63 µm/s, 0.08 %."""
    return _share_verdict(
        context,
        "forward kinematics simulation, velocity error",
        "63 µm/s of the forward kinematics' simulation as a share",
        "Fig. 10",
        "velocity",
        _both(lambda degrees: _peaks(_path_52(context, degrees)[1], 1e6)),
    )


def percent_fk_acceleration(context: Context) -> Verdict:
    """2.89 mm/s², 1.9 %."""
    return _share_verdict(
        context,
        "forward kinematics simulation, acceleration error",
        "2.89 mm/s² of the forward kinematics' simulation as a share",
        "Fig. 10",
        "acceleration",
        _both(lambda degrees: _peaks(_path_52(context, degrees)[2], 1e3)),
    )


def _torque_peaks(context: Context, motor: int) -> dict[str, float]:
    """Peak torques of one motor in Fig. 11, mN·m, with both signs of the force."""

    def compute() -> dict[str, Array]:
        from leg_dynamics.analysis.trajectories import omnileg_eq52

        found = {}
        for degrees, suffix in ((25.0, ""), (45.0, f" with {OTHER_AMPLITUDE}")):
            m = omnileg_eq52(2.0, 100.0, gamma_amplitude=np.radians(degrees))
            force = np.where(m.time[:, None] <= 1.0, printed.EXTERNAL_FORCE, 0.0)
            for name, sign in (("peak with the force on the foot", 1.0), ("peak by the printed sign", -1.0)):
                tau = context.leg.generalized_force(m.q, m.v, m.a, foot_force=sign * force)
                found[name + suffix] = 1e3 * np.abs(tau).max(axis=0)
        return found

    peaks = {name: float(values[motor]) for name, values in context.once("claims: Fig. 11", compute).items()}
    return _changed(peaks)


def percent_torque_m1(context: Context) -> Verdict:
    """2.1 mN·m, 0.1 %."""
    return _share_verdict(
        context,
        "torque error of M1",
        "2.1 mN·m on M1 as a share",
        "Fig. 11",
        "M1",
        _torque_peaks(context, 1),
        note="Masses are assumed.",
    )


def percent_torque_m2(context: Context) -> Verdict:
    """1.5 mN·m, 0.6 %."""
    return _share_verdict(
        context,
        "torque error of M2",
        "1.5 mN·m on M2 as a share",
        "Fig. 11",
        "M2",
        _torque_peaks(context, 0),
        note="JᵀF alone is 3 N·m at the start, whatever the masses: not relative to the peak, or a misprint of 0.06 %.",
    )


def percent_torque_m3(context: Context) -> Verdict:
    """5.2 mN·m, 0.2 %."""
    return _share_verdict(
        context,
        "torque error of M3",
        "5.2 mN·m on M3 as a share",
        "Fig. 11",
        "M3",
        _torque_peaks(context, 2),
        note="Masses are assumed.",
    )


def percent_experiment_ik(axis: int) -> Callable[[Context], Verdict]:
    """Verdict on a share of the inverse kinematics' experiment."""
    name = "XYZ"[axis]

    def verdict(context: Context) -> Verdict:
        spans = _spans(_path_51(context)[0], 1e3)
        key = f"span in {name}"
        return _share_verdict(
            context,
            f"inverse kinematics experiment, {name} error",
            f"Measured {name} error along (51) as a share of its span",
            "Fig. 15",
            name,
            {key: spans[key]},
            corrected_by=key,
        )

    return verdict


def percent_experiment_fk(axis: int) -> Callable[[Context], Verdict]:
    """Verdict on a share of the forward kinematics' experiment."""
    name = "XYZ"[axis]

    def verdict(context: Context) -> Verdict:
        candidates = {}
        for degrees in (25.0, 45.0):
            P = _path_52(context, degrees)[0]
            at = "" if degrees == 25.0 or name != "Z" else f" with {degrees:g}°"
            candidates[f"span in {name}{at}"] = 1e3 * float(np.ptp(P[:, axis]))
            if name != "Z":
                candidates[f"peak in {name}"] = 1e3 * float(np.abs(P[:, axis]).max())
        return _share_verdict(
            context,
            f"forward kinematics experiment, {name} error",
            f"Measured {name} error along (52) as a share",
            "Fig. 17",
            name,
            candidates,
        )

    return verdict


def amplitude_of_52(context: Context) -> Verdict:
    """25 or 45 degrees."""
    low, high = REPORTED["Fig. 17", "Z"].reference or (np.nan, np.nan)
    degrees = np.arange(20.0, 60.0, 0.1)
    P = context.leg.foot_position(_amplitudes(degrees))
    span = 1e3 * np.ptp(P[..., 2], axis=1)
    fits = degrees[(span >= low) & (span <= high)]
    at_25, at_45 = (float(np.interp(d, degrees, span)) for d in (25.0, 45.0))
    inside = fits.size > 0 and fits.min() <= 25.0 <= fits.max()
    return _claim(
        "amplitude of γ in (52)",
        "25° in (52) beside the error that the paper reports for it",
        Status.CONFIRMED if inside else Status.NOT_REPRODUCIBLE,
        f"1.7 mm at 1.9 % along Z imply a span of {low:.1f} to {high:.1f} mm. (52) as printed spans {at_25:.1f} mm; "
        f"amplitudes of {fits.min():.1f} to "
        f"{fits.max():.1f}° would fit, 45° gives {at_45:.1f} mm. The printed 25° stays the default, 45° is offered.",
        [
            Figure("span of Z at 25 deg", at_25, "mm", "(52), 0 to 6 s"),
            Figure("span of Z at 45 deg", at_45, "mm", "(52), 0 to 6 s"),
            Figure("least amplitude that fits", fits.min(), "deg", "1.7 mm and 1.9 % as rounded"),
            Figure("greatest amplitude that fits", fits.max(), "deg", "1.7 mm and 1.9 % as rounded"),
        ],
        ("25π/180", "45π/180 would fit"),
    )


def _amplitudes(degrees: Array) -> Array:
    """Angles of (52) over a quarter period, where every span is reached, for several amplitudes, (k, T, 3)."""
    t = np.linspace(0.0, 1.5, 61)
    return np.stack([printed.motion_52(t, np.radians(d)) for d in degrees])


def start_of_52(context: Context) -> Verdict:
    """Not at rest at either end."""
    from leg_dynamics.analysis.trajectories import omnileg_eq52

    m = omnileg_eq52(6.0, 100.0)
    rates = np.degrees(np.abs(m.v[[0, -1]]))
    speed = np.linalg.norm(context.leg.foot_velocity(m.q[[0, -1]], m.v[[0, -1]]), axis=1)
    moving = bool((speed > 1e-3).all())
    return _claim(
        "(52) neither starts nor ends at rest",
        "The errors of the forward kinematics' experiment are put down to the speed at start and end",
        Status.CONFIRMED if moving else Status.NOT_REPRODUCIBLE,
        f"α and β begin and end with {rates[0, 0]:.1f}°/s and γ with {rates[0, 2]:.1f}°/s; the foot then moves at "
        f"{1e3 * speed[0]:.0f} mm/s. Whether this causes the "
        "errors only the hardware can tell.",
        [
            Figure("rate of α at the start", rates[0, 0], "deg/s", "(52)"),
            Figure("speed of the foot at the start", speed[0], "m/s", "(52)"),
            Figure("speed of the foot at the end", speed[1], "m/s", "(52)"),
        ],
    )


def m1_idle_in_gait(context: Context) -> Verdict:
    """M1 has no torque in Fig. 19."""
    from leg_dynamics.analysis.trajectories import omnileg_eq53

    m = omnileg_eq53(context.leg, 2.0, 100.0)
    tau = np.abs(context.pinocchio.generalized_force(m.q[::4], m.v[::4], m.a[::4])).max(axis=0)
    least = 1e-3
    return _claim(
        "M1 needs no torque in the gait",
        "Fig. 19: the computed torque of M1 is zero",
        judge(tau[1], tau[1], least),
        f"Along (53) |τ_β| stays below {1e3 * tau[1]:.2g} mN·m beside {tau[0]:.2f} and {tau[2]:.2f} N·m on α and γ "
        f"without load: M1 is β, M2 is α.",
        [
            Figure(f"peak torque on {n}", tau[i], "N·m", "(53) with z0 = 0.42 m, no load, assumed masses")
            for i, n in enumerate("αβγ")
        ],
    )


def implied_peaks_of_gait(context: Context) -> Verdict:
    """6.3 % and 8.7 %."""
    ranges = {name: REPORTED["Fig. 19", name].reference or (np.nan, np.nan) for name in ("M2", "M3")}
    middle = {name: REPORTED["Fig. 19", name].implied for name in ranges}
    # A load W on a massless leg: W |Y| on M2, 2 L4 W sin(gamma) on M3.
    load = middle["M2"] / 0.05
    sine = middle["M3"] / (2.0 * float(context.numbers.L4) * load)
    possible = sine <= 1.0
    gamma = float(np.arcsin(sine)) if possible else float("nan")
    height = float(context.leg.foot_position([0.0, 0.0, gamma])[2]) if possible else float("nan")
    return _claim(
        "torque errors of the gait",
        "Fig. 19: 0.14 N·m are 6.3 % on M2, 0.37 N·m are 8.7 % on M3",
        Status.OUT_OF_REACH,
        f"Measured. The peaks implied are {ranges['M2'][0]:.2f} to {ranges['M2'][1]:.2f} and {ranges['M3'][0]:.2f} to "
        f"{ranges['M3'][1]:.2f} N·m; a load of {load:.1f} N at a "
        f"height of {height:.3f} m with the step centred would need both. No mass here is fitted to it.",
        [
            Figure("peak of M2 implied", middle["M2"], "N·m", "0.14 N·m at 6.3 %"),
            Figure("peak of M3 implied", middle["M3"], "N·m", "0.37 N·m at 8.7 %"),
            Figure("load that needs both", load, "N", "massless leg at rest, |Y| up to 0.05 m"),
            Figure("height that needs both", height, "m", "massless leg at rest, |Y| up to 0.05 m"),
        ],
    )


def causes_of_measured_errors(context: Context) -> Verdict:
    """Machining, assembly, friction."""
    q = context.q[:200]
    leg, off = context.numbers, 1e-4
    foot = np.stack(context.formulas.foot_position(leg, tuple(q.T)), axis=-1)
    longer = replace(leg, L1=leg.L1 + off, L4=leg.L4 + off, L5=leg.L5 + off)
    moved = np.linalg.norm(np.stack(context.formulas.foot_position(longer, tuple(q.T)), axis=-1) - foot, axis=-1)
    return _claim(
        "measured errors come from machining, assembly and friction",
        "What the experiments' errors are put down to",
        Status.OUT_OF_REACH,
        f"It takes the prototype to tell. Lengths L1, L4 and L5 all {1e3 * off:g} mm too long move the foot by "
        f"{1e3 * moved.min():.2f} to "
        f"{1e3 * moved.max():.2f} mm, against measured errors of 0.9 to 2.1 mm.",
        [
            Figure(
                "foot moved by 0.1 mm in L1, L4 and L5",
                moved.max(),
                "m",
                "worst of 200 random states inside the limits",
            )
        ],
    )


def two_exact_models(context: Context) -> Verdict:
    """Simulation errors of exact models."""
    facts = assembled(context)
    foot = worst(facts.position("foot") - formula(context, "foot_position", facts.q))
    rate = worst(
        array(context.formulas.foot_jacobian(context.numbers, tuple(facts.q.T)), facts.q.shape[:-1])
        - facts.velocity("foot")
    )
    reported = 1e-6 * float(REPORTED["Fig. 9", "position"].error)
    return _claim(
        "42.5 µm show that the kinematics are right",
        "The deviation of the multibody simulation as proof of the kinematics",
        Status.CONFIRMED if reported <= foot else Status.NOT_REPRODUCIBLE,
        f"Formulas and assembled mechanism agree to {text(foot)} m and {text(rate)} m/rad: an exact pair leaves no "
        f"42.5 µm, {reported / foot:.0e} times more. They "
        "come from the simulation's own settings, which the paper does not give.",
        [
            Figure("foot position, two exact models", foot, "m", _of(context)),
            Figure("foot velocity, two exact models", rate, "m/rad", _of(context, "for unit rates")),
        ],
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (
    symmetry,
    motors_in_the_hip,
    no_rotation,
    bearing_and_driving,
    two_ways_to_lift,
    omnidirectional,
    independent_motions,
    mobility_thigh,
    mobility_shaft,
    mobility_shank,
    mobility_leg,
    cardan_output,
    gears_same_vector,
    shaft_ripple,
    simplification_kinematic,
    simplification_torque,
    light_parts,
    percent_ik_position,
    percent_ik_velocity,
    percent_ik_acceleration,
    two_exact_models,
    percent_fk_position,
    percent_fk_velocity,
    percent_fk_acceleration,
    percent_torque_m1,
    percent_torque_m2,
    percent_torque_m3,
    cause_of_5_2,
    *(percent_experiment_ik(axis) for axis in range(3)),
    *(percent_experiment_fk(axis) for axis in range(3)),
    amplitude_of_52,
    start_of_52,
    m1_idle_in_gait,
    implied_peaks_of_gait,
    causes_of_measured_errors,
)
"""One function a claim, in the paper's order."""
