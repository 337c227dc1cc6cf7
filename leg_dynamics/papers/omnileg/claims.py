"""Claims of Xu et al. 2025 in words, each judged by numbers; percentages, mobility and the shaft have own rooms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from leg_dynamics.papers.comparison import claim
from leg_dynamics.papers.framework import Context, Figure, Status, Verdict
from leg_dynamics.papers.judge import judge, text, worst
from leg_dynamics.papers.omnileg import printed
from leg_dynamics.papers.omnileg.facts import (
    POSITION_TOLERANCE,
    RATE_TOLERANCE,
    Assembled,
    assembled,
    body_of,
    com,
    formula,
    motions,
    omega_of,
    states,
)
from leg_dynamics.papers.omnileg.reported import MOTOR_COLUMNS, MOTORS, REPORTED
from leg_dynamics.papers.omnileg.scenarios import inferred_load

__all__ = ["VERDICTS", "box"]

Array = np.ndarray

ROOM = 1e-9
"""rad; how far beyond a limit still counts as at it."""

IDLE = 1e-3
"""N·m; the paper draws torques to some N·m, where this is no thicker than a line."""


def box(context: Context, what: str = "") -> str:
    """Over which states a number was taken."""
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
    # States of its own: a handful of them would miss the corners, and with them the lack of symmetry.
    p = context.leg.foot_position(lower + context.rng(300).random((500, 3)) * (upper - lower))
    of = f"share of {len(p)} foot positions"
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
    return claim(
        "complete symmetry of the foot's workspace",
        "Fig. 3: the region of motion of the foot is completely symmetric",
        # The defect is the word "completely": the turns and reflections of a square, and any turn inside a cone, hold.
        judge(every, 0.0, corrected=square, explained=[square, len(exact) - 8, 1.0 - cone]),
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
            Figure("outside after 45 deg", at_45, "", f"{of} inside the limits"),
            Figure("outside, worst", every, "", f"{of}, over those rotations and reflections"),
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
    return claim(
        "motors fixed in the hip",
        "Fig. 3: all motors are fixed to the hip plate, which lowers the inertia",
        judge(moving, RATE_TOLERANCE),
        f"The {len(motors)} motors have no velocity for any unit rate (to {text(moving)}). At the knee, their assumed "
        f"{hub:g} kg beside {total:.3g} kg of "
        f"moving parts would raise the inertia at α by up to {100.0 * gain:.0f} %.",
        [
            Figure("velocity of the motors", moving, "m/rad or 1", box(context, "for unit rates")),
            Figure("motors", len(motors), "", "the file"),
            Figure("inertia added by motors at the knee", gain, "", box(context, "share of M_αα, assumed masses")),
        ],
    )


def no_rotation(context: Context) -> Verdict:
    """The foot does not rotate."""
    facts = assembled(context)
    tilt = {link: worst(facts.rotation(link) - np.eye(3)) for link in ("knee", "foot")}
    spin = {link: worst(facts.omega(link)) for link in ("knee", "foot")}
    error = max(*tilt.values(), *spin.values())
    return claim(
        "the foot does not rotate",
        "Fig. 3: no rotation of the foot accompanies its motion; nor of the knee",
        judge(error, RATE_TOLERANCE),
        f"Assembled from its hinges alone, the mechanism keeps the foot's axes within {text(tilt['foot'])} of the "
        f"hip's and its angular velocity below "
        f"{text(spin['foot'])} for unit rates; the knee likewise ({text(tilt['knee'])}, {text(spin['knee'])}).",
        [
            *(
                Figure(f"rotation of the {link}", tilt[link], "", box(context, "largest entry of R − I"))
                for link in tilt
            ),
            *(
                Figure(f"angular velocity of the {link}", spin[link], "", box(context, "for unit rates"))
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
    radius = {name: float(context.leg.parameters[f"{name}_radius"].value) for name in ("rod_outer", "cardan_shaft")}
    radii = dict.fromkeys((1, 2, 3), radius["rod_outer"]) | {4: radius["cardan_shaft"]}
    clear = {(i, j): distance - radii[i] - radii[j] for (i, j), distance in gap.items()}
    least, free = min(gap.values()), min(clear.values())
    return claim(
        "the thigh carries and drives",
        "Fig. 3: the thigh bears the load and houses the drive of the shank",
        judge(min(free, 0.0), 0.0),
        f"Rods and Cardan shaft stay parallel inside the thigh; their axes come no closer than {1e3 * least:.1f} mm. "
        f"With the file's radii, {1e3 * radii[1]:g} mm for a rod and {1e3 * radii[4]:g} mm for the shaft (assumed), "
        f"at least {1e3 * free:.1f} mm stay free between them.",
        [
            Figure("least distance of two axes", least, "m", box(context, "rods and Cardan shaft")),
            Figure("least gap between two of them", free, "m", box(context, "with the file's radii, assumed")),
        ],
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
    # Both together: the first half of the printed step, where the foot is lifted. A lift is less z: z points down.
    path = printed.path_53(np.linspace(0.0, 0.5, 26) * printed.GAIT["T"], **printed.GAIT)
    p = np.column_stack([path[:, 0], path[:, 1], 0.42 - path[:, 2]])
    facts = Assembled(context.pinocchio, context.leg.inverse_kinematics(p))
    knee, foot = facts.position("knee")[:, 2], facts.position("foot")[:, 2]
    from_thigh, whole = float(knee[0] - knee[-1]), float(foot[0] - foot[-1])
    from_shank = whole - from_thigh
    shares = [from_thigh, from_shank, by_shank - height]
    return claim(
        "two ways to lift the foot",
        "Fig. 3: the foot is lifted by thigh and shank together, or by the shank alone",
        # Sideways motion, the height reached, and whether each part lifts at all.
        judge([straight_up, whole - height, *(min(share, 0.0) for share in shares)], POSITION_TOLERANCE),
        f"The shank alone lifts it by up to {1e3 * by_shank:.0f} mm straight up (sideways {text(straight_up)} m). In "
        f"the step (53) from Y = 0, z0 = 0.42 m, the lift of {1e3 * whole:.1f} mm is {1e3 * from_thigh:.1f} mm of the "
        f"knee, so of the thigh, and {1e3 * from_shank:.1f} mm of the shank. The thigh alone lifts it by up to "
        f"{1e3 * by_thigh:.0f} mm, but {1e3 * aside:.0f} mm aside.",
        [
            Figure("lift by the shank", by_shank, "m", "γ over its range, thigh vertical"),
            Figure("sideways motion meanwhile", straight_up, "m", "γ over its range"),
            Figure("lift by the thigh", by_thigh, "m", "α from 0 to its limit"),
            Figure("lift of a step by the thigh", from_thigh, "m", "height of the knee, (53) from Y = 0, z0 = 0.42 m"),
            Figure("lift of a step by the shank", from_shank, "m", "foot relative to the knee, the same step"),
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
    return claim(
        "turning about X0 and Y0 replaces turning about Z0",
        "The thigh's two fixed axes point the leg in every direction",
        judge(error, POSITION_TOLERANCE),
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
    return claim(
        "thigh and shank move independently",
        "The kinematics of thigh and shank can be modelled one by one",
        judge(max(mixed, sideways), RATE_TOLERANCE),
        f"γ does not move the knee, and α, β do not change the shank (to {text(max(mixed, sideways))} m/rad). The "
        f"dynamics are coupled: "
        f"|M_iγ|/√(M_ii M_γγ) reaches {coupled:.2f}.",
        [
            Figure("coupling of the velocities", max(mixed, sideways), "m/rad", box(context, "for unit rates")),
            Figure("coupling of the inertia", coupled, "", box(context, "assumed masses")),
        ],
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
    return claim(
        "output shaft and gears turn as fast as the input",
        "Input shaft, output shaft and bevel gears have the same speed",
        judge(error, RATE_TOLERANCE),
        f"With parallel plates and yokes in phase the output equals the input at every α and β, moving or not (angle "
        f"to {text(angle)} rad, rates to "
        f"{text(speed)}); the driven gears have its speed (to {text(max(gears))}). γ at the gears carries no error.",
        [
            Figure("output angle minus input angle", angle, "rad", box(context)),
            Figure("output rate minus input rate", speed, "", box(context, "for unit rates")),
            Figure("speed of the driven gears minus 1", max(gears), "", box(context, "for a unit γ̇")),
        ],
    )


def gears_same_vector(context: Context) -> Verdict:
    """The same angular velocity."""
    facts = assembled(context)
    vector = worst(facts.omega("driven_gear_2") - facts.omega("input_shaft"))
    psi = float(context.numbers.psi[1])
    right = worst(facts.omega("driven_gear_2")[..., 2] - np.array([np.cos(psi), np.sin(psi), 0.0]))
    return claim(
        "the bevel gears have the angular velocity of the input",
        "Below (25): input, output and all bevel gears share one angular velocity",
        judge(
            vector,
            RATE_TOLERANCE,
            corrected=right,
            # The defect: one speed, but about the gear's own axis instead of Z0.
            explained=[right, worst(np.linalg.norm(facts.omega("driven_gear_2")[..., 2], axis=-1) - 1.0)],
        ),
        f"As vectors they differ by up to {text(vector)} for a unit γ̇: the driven gears turn about X_Ci (off by "
        f"{text(right)}), only the speed is "
        "shared.",
        [Figure("driven gear minus input shaft", vector, "", box(context, "angular velocity for unit rates"))],
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
    return claim(
        "the shaft turns at a varying rate",
        "The shaft A4B4 does not turn as uniformly as the input shaft",
        judge(error, 1e-3),
        f"Shaft over input by bend: {'; '.join(parts)}. The limits are cos θ and 1/cos θ (to {text(error)}).",
        figures,
    )


# ---------------------------------------------------------------------- bodies


def light_parts(context: Context) -> Verdict:
    """Share of the mass."""
    masses = {body.name: float(body.mass) for body in context.numbers.bodies}
    light = sum(masses[name] for name in ("shaft_A4B4", "cross_A4", "cross_B4"))
    share = light / sum(masses.values())
    return claim(
        "shaft and crosses are a small share of the mass",
        "The shaft A4B4 and its crosses weigh little beside the leg",
        Status.NOT_REPRODUCIBLE,
        f"The paper states no mass. With the assumed ones it is {100.0 * share:.1f} % of {sum(masses.values()):.2f} "
        f"kg.",
        [Figure("share of the moving mass", share, "", "assumed masses")],
    )


def isotropy_of_the_ring(context: Context) -> Verdict:
    """Three chains in a ring."""
    facts = assembled(context)
    knee = facts.position("knee")
    axes = np.stack([facts.axis(f"gamma_C{i}")[:, :2] for i in (1, 2, 3)])
    links = [f"link_{pair}" for i in (1, 2, 3) for pair in (f"C{i}D{i}", f"D{i}E{i}")]
    masses = np.array([float(body_of(context, link).mass) for link in links])
    centres = np.stack([(facts.position(link, com(context, link)) - knee)[:, :2] for link in links])

    def uneven(tensors: Array) -> float:
        """Largest difference of the two principal values, over their mean; zero where all directions are alike."""
        values = np.linalg.eigvalsh(tensors)
        return worst((values[:, 1] - values[:, 0]) / values.mean(axis=1))

    hinges = uneven(np.einsum("kni,knj->nij", axes, axes))
    pair = uneven(np.einsum("kni,knj->nij", axes[:2], axes[:2]))
    mass = uneven(np.einsum("k,kni,knj->nij", masses, centres, centres))
    middle = worst(np.einsum("k,kni->ni", masses, centres) / masses.sum())
    return claim(
        "a ring of three shank chains is alike in all directions",
        "Section 1: with three chains in a ring the shank behaves alike in all directions",
        judge([hinges, mass, middle], POSITION_TOLERANCE),
        f"The hinge axes and the links' masses have equal second moments in every direction across Z (to "
        f"{text(max(hinges, mass))} of the mean), and their centre stays on the axis (to {text(middle)} m), at every "
        f"pose. Two of the three chains alone would have hinge moments that differ by {pair:.2g} of the mean.",
        [
            Figure("second moment of the hinge axes, unevenness", hinges, "", box(context)),
            Figure("second moment of the links' masses, unevenness", mass, "", box(context)),
            Figure("links' centre beside the axis", middle, "m", box(context)),
            Figure("unevenness of two chains", pair, "", box(context, "hinge axes of chains 1 and 2")),
        ],
    )


def centres_in_line(context: Context) -> Verdict:
    """O0, O0', O0F at the start."""
    facts = Assembled(context.pinocchio, np.zeros((1, 3)))
    aside = [facts.position(link)[0, :2] for link in ("hip", "knee", "foot")]
    return claim(
        "O0, O0' and O0F are in line at the start",
        "Section 2: in the initial state O0, O0′ and O0F lie on one line",
        judge(aside, POSITION_TOLERANCE),
        f"In the straight leg of the file hip, knee and foot lie on Z0 (to {text(worst(aside))} m).",
        [Figure("distance from Z0", worst(aside), "m", "knee and foot, α = β = γ = 0")],
    )


def crosses_at_rest(context: Context) -> Verdict:
    """Centres of the crosses A1 and B1."""
    facts = assembled(context)
    hip = worst(facts.velocity("cross_A1", com(context, "cross_A1")))
    knee = worst(facts.velocity("cross_B1", com(context, "cross_B1")) - facts.velocity("knee"))
    return claim(
        "the crosses' centres do not move",
        "Below (15) and (16): the centre of the cross A1 is at rest, that of B1 at rest relative to the knee",
        judge([hip, knee], RATE_TOLERANCE),
        f"For unit rates A1 moves by {text(hip)} m/rad, B1 relative to the knee by {text(knee)} m/rad.",
        [
            Figure("velocity of A1", hip, "m/rad", box(context, "for unit rates")),
            Figure("velocity of B1 relative to the knee", knee, "m/rad", box(context, "for unit rates")),
        ],
    )


def gears_at_rest(context: Context) -> Verdict:
    """Shafts and gears at the knee."""
    facts = assembled(context)
    knee = facts.velocity("knee")
    parts = ("output_shaft", "driven_gear_1", "driven_gear_2", "driven_gear_3")
    moving = {part: worst(facts.velocity(part, com(context, part)) - knee) for part in parts}
    off = {}
    for part in parts:
        spin = facts.omega(part)[..., 2]
        centre = facts.position(part, com(context, part)) - facts.position(part)
        off[part] = worst(np.cross(spin, centre))
    return claim(
        "shafts and gears at the knee do not move against it",
        "Below (25): the centres of U_E-G_J2 and of the gears lie on their axes, so they rest relative to the knee",
        judge([*moving.values(), *off.values()], RATE_TOLERANCE),
        f"Output shaft with its gear and all driven gears: centres on the axes (to {text(max(off.values()))} m), "
        f"velocity relative to the knee below {text(max(moving.values()))} m/rad for unit rates. That the centres lie "
        "on the axes is assumed in the file, as in the paper.",
        [Figure(f"velocity of {part} relative to the knee", moving[part], "m/rad", box(context)) for part in parts],
    )


def third_universal_joint(context: Context) -> Verdict:
    """The joint U_E."""
    bend = np.radians([1.0, 5.0, 10.0])
    ripple = 1.0 / np.cos(bend) - 1.0
    listed = ", ".join(f"{100.0 * r:.2g} % at {np.degrees(b):g}°" for r, b in zip(ripple, bend, strict=True))
    return claim(
        "the third universal joint U_E and its cross turn with the shafts",
        "Below (24): the cross CS_UE turns as fast as the shafts B4-U_E and U_E-G_J2",
        Status.NOT_REPRODUCIBLE,
        "The paper gives no bend at U_E, and no equation models the joint. Without a bend the claim is trivial, and "
        f"the joint superfluous; with one, the rates on both sides differ by up to {listed}. The file has one straight "
        "output shaft.",
        [
            Figure(f"ripple at a bend of {np.degrees(b):g} deg", r, "", "1 / cos − 1")
            for r, b in zip(ripple, bend, strict=True)
        ],
    )


def rigid_and_uniform(context: Context) -> Verdict:
    """Assumptions on the bodies."""
    leg = context.numbers
    middles = {f"rod_A{k}B{k}": 0.5 * float(leg.L1) for k in (1, 2, 3)}
    off = max(worst(com(context, name) - [0.0, 0.0, middle]) for name, middle in middles.items())
    return claim(
        "bodies are rigid and uniform, rods balanced in their middle",
        "Section 3: rigid bodies of uniform density; the rods' centres of mass are their geometric centres",
        Status.OUT_OF_REACH,
        f"Assumptions about the prototype. The file makes the same ones: its rods' centres lie in their middle (to "
        f"{text(off)} m).",
        [Figure("rods' centres beside their middle", off, "m", "three rods of the file")],
    )


def random_motions(context: Context) -> Verdict:
    """Motions that validate the model."""
    t = np.linspace(0.0, 6.0, 121)
    q = printed.motion_52(t)
    sigma = np.linalg.svd(q, compute_uv=False)
    rank = int((sigma > 1e-9 * sigma[0]).sum())
    foot = context.leg.foot_position(q)
    plane = worst(foot[:, 0] + foot[:, 1])
    exchanged = context.leg.foot_position(q[:, [1, 0, 2]])
    unseen = worst(exchanged - foot)
    elsewhere = worst(context.leg.foot_position(context.q[:, [1, 0, 2]]) - context.leg.foot_position(context.q))
    return claim(
        "randomly given motions validate the model",
        "Conclusions: the model was validated with motions and forces given at random",
        judge(3 - rank, 0.0),
        f"(52) moves all motors in proportion: its states span {rank} of 3 dimensions, and the foot stays in the plane "
        f"X = −Y (to {text(plane)} m). A model with M1 and M2 exchanged gives the same path (to {text(unseen)} m), "
        f"although it is off by up to {text(elsewhere)} m elsewhere.",
        [
            Figure("dimensions of the states of (52)", rank, "", "121 samples, 0 to 6 s"),
            Figure("distance from the plane X = −Y", plane, "m", "foot along (52)"),
            Figure("difference with M1 and M2 exchanged", unseen, "m", "foot along (52)"),
            Figure("the same at random states", elsewhere, "m", f"{len(context.q)} states inside the limits"),
        ],
    )


def easier_model(context: Context) -> Verdict:
    """Several methods against one."""
    return claim(
        "several methods together make the modelling easier",
        "Abstract and conclusions: screws and geometry combined are easier than one method for the whole leg",
        Status.NOT_REPRODUCIBLE,
        "The paper gives no measure of difficulty and no model by one method to compare with.",
    )


def start_of_52(context: Context) -> Verdict:
    """Not at rest at either end."""
    from leg_dynamics.analysis.trajectories import omnileg_eq52

    m = omnileg_eq52(6.0, 100.0)
    rates = np.degrees(np.abs(m.v[[0, -1]]))
    speed = np.linalg.norm(context.leg.foot_velocity(m.q[[0, -1]], m.v[[0, -1]]), axis=1)
    # The straight thigh moves like a pendulum of length L1 about both axes at once.
    expected = np.sqrt(2.0) * float(context.numbers.L1) * np.pi**2 / 18.0
    return claim(
        "(52) neither starts nor ends at rest",
        "The errors of the forward kinematics' experiment are put down to the speed at start and end",
        judge(speed - expected, POSITION_TOLERANCE),
        f"α and β begin and end with {rates[0, 0]:.1f}°/s and γ with {rates[0, 2]:.1f}°/s; the foot then moves at "
        f"{1e3 * speed[0]:.0f} mm/s, √2 L1 π²/18 s⁻¹. Whether this causes the errors only the hardware can tell.",
        [
            Figure("rate of α at the start", rates[0, 0], "deg/s", "(52)"),
            Figure("speed of the foot at the start", speed[0], "m/s", "(52)"),
            Figure("speed of the foot at the end", speed[1], "m/s", "(52)"),
        ],
    )


def measured_accelerations(context: Context) -> Verdict:
    """Measured accelerations fluctuate."""
    return claim(
        "measured accelerations fluctuate but follow the trend",
        "Figs 15 and 17: position and speed agree with theory, the measured acceleration fluctuates about it",
        Status.OUT_OF_REACH,
        "Measured with a motion capture system; the data are not published.",
    )


def _gait_torques(context: Context) -> Array:
    """Torques of M1, M2, M3 along (53) without load, by the numeric route, N·m."""
    from leg_dynamics.analysis.trajectories import omnileg_eq53

    m = omnileg_eq53(context.leg, 2.0, 100.0)
    tau: Array = context.pinocchio.generalized_force(m.q[::4], m.v[::4], m.a[::4])[:, MOTOR_COLUMNS]
    return tau


def m1_idle_in_gait(context: Context) -> Verdict:
    """M1 has no torque in Fig. 19."""
    peaks = np.abs(_gait_torques(context)).max(axis=0)
    return claim(
        "M1 needs no torque in the gait",
        "Fig. 19: the computed torque of M1 is zero",
        judge(peaks[0], IDLE),
        f"Along (53) M1 stays below {1e3 * peaks[0]:.2g} mN·m beside {peaks[1]:.2f} and {peaks[2]:.2f} N·m on M2 and "
        "M3 without load: M1 is β, M2 is α.",
        [
            Figure(f"peak torque on {n}", peak, "N·m", "(53) with z0 = 0.42 m, no load, assumed masses")
            for n, peak in zip(MOTORS, peaks, strict=True)
        ],
    )


def m1_error_in_gait(context: Context) -> Verdict:
    """0.1 N·m on M1."""
    reported = float(REPORTED["Fig. 19", "M1"].error)
    peak = float(np.abs(_gait_torques(context)[:, 0]).max())
    return claim(
        "0.1 N·m on M1 in the gait",
        "Fig. 19: the largest torque error of M1 is 0.1 N·m; no percentage, because theory asks for none",
        Status.OUT_OF_REACH,
        f"Measured. The computed torque is {1e3 * peak:.2g} mN·m, so {reported:g} N·m is all of what was measured: "
        "friction, or a motion or a load across the plane of the gait.",
        [Figure("computed peak of M1", peak, "N·m", "(53) with z0 = 0.42 m, no load, assumed masses")],
    )


def torque_errors_of_gait(context: Context) -> Verdict:
    """6.3 % and 8.7 %."""
    ranges = {name: REPORTED["Fig. 19", name].reference or (np.nan, np.nan) for name in ("M2", "M3")}
    inference = inferred_load(context, 0.05)
    return claim(
        "torque errors of the gait",
        "Fig. 19: 0.14 N·m are 6.3 % on M2, 0.37 N·m are 8.7 % on M3",
        Status.OUT_OF_REACH,
        f"Measured. The peaks implied are {ranges['M2'][0]:.2f} to {ranges['M2'][1]:.2f} and {ranges['M3'][0]:.2f} to "
        f"{ranges['M3'][1]:.2f} N·m; a load of {inference.load:.1f} N at a height of {inference.height:.3f} m with the "
        "step centred would need both. No mass here is fitted to it.",
        [
            *(
                Figure(f"peak of {name} implied", REPORTED["Fig. 19", name].implied, "N·m", "error over its share")
                for name in ("M2", "M3")
            ),
            Figure("load that needs both", inference.load, "N", "massless leg at rest, |Y| up to 0.05 m"),
            Figure("height that needs both", inference.height, "m", "massless leg at rest, |Y| up to 0.05 m"),
        ],
    )


def change_of_phase(context: Context) -> Verdict:
    """Deviations between swing and stance."""
    return claim(
        "deviations where swing and stance change",
        "Fig. 19: they come from the lag of the torque sensors and from the foot's oscillation on the ground",
        Status.OUT_OF_REACH,
        "It takes the prototype, its sensors and the ground to tell. The computed torques jump there with the load.",
    )


def causes_of_measured_errors(context: Context) -> Verdict:
    """Machining, assembly, friction."""
    q = context.q[:200]
    leg, off = context.numbers, 1e-4
    foot = np.stack(context.formulas.foot_position(leg, tuple(q.T)), axis=-1)
    longer = replace(leg, L1=leg.L1 + off, L4=leg.L4 + off, L5=leg.L5 + off)
    moved = np.linalg.norm(np.stack(context.formulas.foot_position(longer, tuple(q.T)), axis=-1) - foot, axis=-1)
    return claim(
        "measured errors come from machining, assembly and friction",
        "What the experiments' errors are put down to",
        Status.OUT_OF_REACH,
        f"It takes the prototype to tell. Lengths L1, L4 and L5 all {1e3 * off:g} mm too long move the foot by "
        f"{1e3 * moved.min():.2f} to {1e3 * moved.max():.2f} mm, against measured errors of 0.9 to 2.1 mm.",
        [
            Figure(
                "foot moved by 0.1 mm in L1, L4 and L5",
                moved.max(),
                "m",
                f"worst of {len(q)} random states inside the limits",
            )
        ],
    )


def kinematics_are_right(context: Context) -> Verdict:
    """What the simulation proves."""
    facts = assembled(context)
    foot = worst(printed.foot_position(context.numbers, facts.q) - facts.position("foot"))
    rate = worst(printed.foot_jacobian(context.numbers, facts.q) - facts.velocity("foot"))
    back = printed.inverse_kinematics(context.numbers, facts.position("foot"))
    miss = worst(printed.foot_position(context.numbers, back) - facts.position("foot"))
    reported = 1e-6 * float(REPORTED["Fig. 9", "position"].error)
    return claim(
        "the kinematic model is right",
        "Section 4: deviations of 42.5 and 45 µm prove that the kinematic model is right",
        judge([foot, rate], RATE_TOLERANCE),
        f"(11) and (14) agree with the assembled mechanism to {text(foot)} m and {text(rate)} m/rad. So the "
        f"{1e6 * reported:g} µm, {reported / foot:.0e} times more, are not the model's: they come from settings of the "
        f"simulation that the paper does not give. (13) as printed misses by up to {text(miss)} m, so it cannot be "
        "what was simulated.",
        [
            Figure("foot position, (11) against the mechanism", foot, "m", box(context)),
            Figure("foot velocity, (14) against the mechanism", rate, "m/rad", box(context, "for unit rates")),
            Figure("foot missed by (13) as printed", miss, "m", box(context)),
        ],
    )


VERDICTS: tuple[Callable[[Context], Verdict], ...] = (
    isotropy_of_the_ring,
    symmetry,
    motors_in_the_hip,
    no_rotation,
    bearing_and_driving,
    two_ways_to_lift,
    omnidirectional,
    independent_motions,
    centres_in_line,
    crosses_at_rest,
    cardan_output,
    gears_same_vector,
    gears_at_rest,
    third_universal_joint,
    shaft_ripple,
    light_parts,
    rigid_and_uniform,
    kinematics_are_right,
    start_of_52,
    measured_accelerations,
    m1_idle_in_gait,
    m1_error_in_gait,
    torque_errors_of_gait,
    change_of_phase,
    causes_of_measured_errors,
    random_motions,
    easier_model,
)
"""One function a claim, in the paper's order."""
