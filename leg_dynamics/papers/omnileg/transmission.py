"""What neglecting the Cardan shaft's ripple and coupling, and the drives PL_i, costs in torque.

Torques are in the paper's order M1, M2, M3: (beta, alpha, gamma); shares are of each motor's exact peak with Fig. 11's
force. The motion is (52), 0-2 s, run 1 to 10 times as fast on the same path. There inertia forces, and so what their
neglect costs, grow with the square of the speed; they are computed at the printed speed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.papers.framework import Check, Context, Figure, Plot, Section, Verdict
from leg_dynamics.papers.judge import judge, worst
from leg_dynamics.papers.omnileg import printed
from leg_dynamics.papers.omnileg.facts import assembled, com, lagrange_torque, mass_matrix_of
from leg_dynamics.papers.omnileg.reported import (
    MOTOR_COLUMNS,
    MOTOR_LABELS,
    MOTORS,
    errors,
    foot_force,
    shares,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

__all__ = [
    "CHECKS",
    "DRIVE_INERTIA",
    "MODELS",
    "SMALL",
    "SPEEDS",
    "VERDICTS",
    "Study",
    "plots",
    "sections",
    "simplified_mass_matrix",
    "study",
]

MODELS = {
    "paper": "(26)-(31), centre of the shaft by (30)",
    "crossed": "(26)-(31), centre of the shaft by ω × c",
    "none": "no rotary inertia of shaft and crosses",
    "drives": "no drives PL_1, PL_2 (1 g·m² each assumed)",
}
"""What each neglects. (30) keeps the spin out of the centre's velocity; ω of (29) crossed with it would not."""

SPEEDS = tuple(range(1, 11))

DRIVE_INERTIA = 1e-3
"""kg·m²; assumed for PL_1 and PL_2 at their joints. The paper gives none, and the shipped leg has zero."""

SMALL = 1.0
"""Percent of the peak torque; the paper calls its relative errors "within 1 %" (section 4)."""

ALIKE = 3.0
"""A cause explains a residual if it comes within this factor of it, masses being assumed."""

SAMPLES = 2001


@dataclass(frozen=True, eq=False)
class Study:
    """Torque errors of the transmission models along (52), columns M1, M2, M3.

    Attributes
    ----------
    error : mapping of str to ndarray, shape (10, 3)
        Largest difference to the exact torque by model, a row a speed of `SPEEDS`, N·m.
    peak : ndarray, shape (10, 3)
        Largest exact torque with Fig. 11's force, N·m.
    curves : mapping of str to ndarray, shape (T, 3)
        Difference to the exact torque over `time` at the printed speed, N·m.
    time : ndarray, shape (T,)
        s.
    acceleration : ndarray, shape (3,)
        Largest angular acceleration of the motors' joints at the printed speed, rad/s².
    """

    error: Mapping[str, np.ndarray]
    peak: np.ndarray
    curves: Mapping[str, np.ndarray]
    time: np.ndarray
    acceleration: np.ndarray

    def share(self, model: str) -> np.ndarray:
        """Errors in percent of the exact peak torque with Fig. 11's force, shape (10, 3)."""
        share: np.ndarray = 100.0 * self.error[model] / self.peak
        return share

    def speed_of(self, error: np.ndarray, model: str = "paper") -> np.ndarray:
        """How many times faster (52) would have to run for `error`, shape (3,)."""
        speed: np.ndarray = np.sqrt(error / self.error[model][0])
        return speed


def study(context: Context) -> Study:
    """The cost of each neglect against speed, computed once a context."""
    return context.once("transmission study", lambda: _study(context))


State = tuple[np.ndarray, np.ndarray, np.ndarray]


def _motion(speed: float = 1.0, samples: int = SAMPLES) -> tuple[np.ndarray, State]:
    from leg_dynamics.analysis.trajectories import omnileg_eq52

    motion = omnileg_eq52(2.0, (samples - 1) / 2.0)
    return motion.time, (motion.q, speed * motion.v, speed**2 * motion.a)


def _torque(context: Context, transmission: str, state: State) -> np.ndarray:
    numbers: Any = replace(context.numbers, transmission=transmission)
    columns = (tuple(np.ascontiguousarray(values.T)) for values in state)
    torque = np.array(np.broadcast_arrays(*context.formulas.inverse_dynamics(numbers, *columns, numbers.gravity)))
    ordered: np.ndarray = torque[MOTOR_COLUMNS].T
    return ordered


def _crossing(context: Context, state: State) -> np.ndarray:
    """What it adds to the torques to move the shaft's centre with omega of (29) instead of by (30), N·m."""
    centre = com(context, "shaft_A4B4")
    mass = next(float(body.mass) for body in context.numbers.bodies if body.name == "shaft_A4B4")

    def added(q: np.ndarray) -> np.ndarray:
        by_30 = printed.velocity_shaft(q, centre)
        crossed = np.cross(printed.omega_shaft(q), printed.shaft_centre(q, centre)[..., None], axis=-2)
        energies: list[np.ndarray] = [np.swapaxes(v, -1, -2) @ v for v in (crossed, by_30)]
        return mass * (energies[0] - energies[1])

    return lagrange_torque(added, *state)[:, MOTOR_COLUMNS]


def _drives(context: Context, state: State) -> np.ndarray:
    """What the leg's torques lack without the drives, by its own parameters: minus I a on M1 and M2, N·m."""
    heavier = context.leg.replace(PL_1_inertia=DRIVE_INERTIA, PL_2_inertia=DRIVE_INERTIA)
    difference: np.ndarray = context.leg.generalized_force(*state) - heavier.generalized_force(*state)
    return difference[:, MOTOR_COLUMNS]


def _study(context: Context) -> Study:
    time, state = _motion()
    exact = _torque(context, "exact", state)
    curves = {name: _torque(context, name, state) - exact for name in ("paper", "none")}
    curves["crossed"] = curves["paper"] + _crossing(context, state)
    curves["drives"] = _drives(context, state)
    # A force on the foot asks for -J^T F, whatever the transmission model and the speed.
    load = np.einsum("tij,ti->tj", context.leg.jacobian(state[0]), foot_force(time))[:, MOTOR_COLUMNS]
    held = context.leg.gravity_torque(state[0])[:, MOTOR_COLUMNS]
    squares = np.array(SPEEDS, dtype=float) ** 2
    return Study(
        {name: squares[:, None] * np.abs(curves[name]).max(axis=0) for name in MODELS},
        np.array([np.abs(held + square * (exact - held) - load).max(axis=0) for square in squares]),
        {name: curves[name] for name in MODELS},
        time,
        np.abs(state[2]).max(axis=0)[MOTOR_COLUMNS],
    )


def simplified_mass_matrix(context: Context) -> Callable[[np.ndarray], np.ndarray]:
    """Mass matrix with the shaft and its crosses turning as (26), (27) and (29) say as printed."""

    def crosses(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return printed.rot(printed.Y, q[..., 1]), printed.omega_cross_A4(q)

    def shaft(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return printed.rod_rotation(q), printed.omega_shaft(q)

    replaced = {"cross_A4": crosses, "cross_B4": crosses, "shaft_A4B4": shaft}
    return lambda q: mass_matrix_of(context, q, replaced=replaced)


def _three(name: str, values: np.ndarray, unit: str, of: str) -> tuple[Figure, ...]:
    return tuple(Figure(f"{name}, {motor}", value, unit, of) for motor, value in zip(MOTORS, values, strict=True))


def _listed(values: np.ndarray, unit: str = "", digits: int = 2) -> str:
    return f"{', '.join(f'{value:.{digits}g}' for value in values)} {unit}".rstrip()


def _turning_errors(context: Context) -> dict[str, float]:
    """Largest error of (26), (27) and (29) in angular velocity, for unit rates."""
    facts = assembled(context)
    forms = (
        ("cross_A4", printed.omega_cross_A4),
        ("cross_B4", printed.omega_cross_B4),
        ("shaft_A4B4", printed.omega_shaft),
    )
    return {link: worst(form(facts.q) - facts.omega(link)) for link, form in forms}


def neglect_is_small(context: Context) -> Verdict:
    """The shaft's ripple and coupling have little effect on the dynamics."""
    found = study(context)
    models = ("paper", "crossed")
    largest = max(float(found.share(model)[0].max()) for model in models)
    as_motion = _turning_errors(context)
    slow, fast = ({model: _listed(1e3 * found.error[model][row], "mN·m") for model in models} for row in (0, -1))
    return Verdict(
        "claim: neglected shaft ripple has little effect",
        "claim",
        "Section 3: neglecting the Cardan shaft's uneven speed and coupling has little effect on the dynamics",
        judge(largest, SMALL),
        f"Along (52) the torques of (26)-(31) differ from the exact ones by {slow['paper']} (M1, M2, M3), or by "
        f"{slow['crossed']} if the shaft's centre moves with ω of (29) instead of by (30): at most {largest:.2g} % of "
        f"the peaks of Fig. 11, so shaft and crosses could be {SMALL / largest:.0f} times heavier than assumed. "
        f"Ten times as fast it is {fast['paper']}, or {fast['crossed']}. "
        f"As motion the neglect is not small: angular velocities are off by up to "
        f"{max(as_motion['cross_A4'], as_motion['cross_B4']):.2g} (crosses) and {as_motion['shaft_A4B4']:.2g} (shaft) "
        f"for unit rates. Leaving out the rotary inertia of shaft and crosses altogether costs less, "
        f"{_listed(1e3 * found.error['none'][0], 'mN·m')}: the fixed axis of (29) puts the shaft's transverse inertia "
        "into γ̇.",
        (
            *(
                figure
                for model in (*models, "none")
                for figure in _three(
                    f"error, {MODELS[model]}", 1e3 * found.error[model][0], "mN·m", "(52), 0-2 s, assumed masses"
                )
            ),
            *_three("share of the peak, (26)-(31)", found.share("paper")[0], "%", "of the exact peak of Fig. 11"),
            *_three("share of the peak, ω × c", found.share("crossed")[0], "%", "of the exact peak of Fig. 11"),
            *_three("share at ten times the speed", found.share("paper")[-1], "%", "(26)-(31), of that motion's peak"),
            *(
                Figure(f"angular velocity of {link}", value, "", "error of (26), (27), (29) for unit rates")
                for link, value in as_motion.items()
            ),
        ),
    )


def cause_of_the_residual(context: Context) -> Verdict:
    """The residual torques of Fig. 11 come from the neglected transmission."""
    found = study(context)
    reported = 1e-3 * errors("Fig. 11")
    ratio = {model: reported / found.error[model][0] for model in ("paper", "crossed")}
    speed = found.speed_of(reported)
    inertia = reported[:2] / found.acceleration[:2]
    both = f"{ratio['crossed'][2]:.0f} to {ratio['paper'][2]:.0f} times"
    nearest = np.minimum(ratio["paper"], ratio["crossed"])
    return Verdict(
        "claim: cause of Fig. 11's residual torques",
        "claim",
        "Section 4: 2.1, 1.5 and 5.2 mN·m come from the neglected uneven speed and the drives PL_1, PL_2",
        judge(np.log(nearest), float(np.log(ALIKE))),
        f"The neglected motion of the shaft makes {_listed(1e3 * found.error['paper'][0], 'mN·m')} (M1, M2, M3), the "
        f"reported residuals are {_listed(ratio['paper'], 'times', 3)} that; with the shaft's centre moving with ω of "
        f"(29), {_listed(1e3 * found.error['crossed'][0], 'mN·m')} and {_listed(ratio['crossed'], 'times', 3)}. On M3 "
        f"they are {both} what the neglect makes; (52) would have to run {_listed(speed, 'times', 3)} as fast. M1 and "
        f"M2 could be drives PL_i of {1e3 * inertia[0]:.3g} and {1e3 * inertia[1]:.3g} g·m² at the joint, which the "
        "paper does not state; M3, with the largest figure, has no such drive.",
        (
            *_three("reported over computed", ratio["paper"], "", "Fig. 11's residual over the error, centre by (30)"),
            *_three("reported over computed, ω × c", ratio["crossed"], "", "the same, centre by ω of (29)"),
            *_three("speed that would explain it", speed, "", "multiple of the speed of (52), centre by (30)"),
            *(
                Figure(f"inertia of PL_{i + 1} that would explain it", x, "kg·m²", "residual over peak acceleration")
                for i, x in enumerate(inertia)
            ),
        ),
    )


def two_derivations_of_the_neglect(context: Context) -> Check:
    """The study's torques of (26)-(31) against Lagrange's equations on the printed forms."""
    _, state = _motion(samples=21)
    gravity = context.leg.gravity_torque(state[0])[:, MOTOR_COLUMNS]
    lagrange = lagrange_torque(simplified_mass_matrix(context), *state)[:, MOTOR_COLUMNS]
    worst_difference = worst(_torque(context, "paper", state) - gravity - lagrange)
    return Check("torques of (26)-(31), two derivations", worst_difference, 1e-8, "N·m", "21 samples of (52), 0-2 s")


def torques_are_quadratic_in_speed(context: Context) -> Check:
    """What the study's columns for higher speeds rest on."""
    (_, slow), (_, fast) = (_motion(speed, 21) for speed in (1.0, 10.0))
    held = context.leg.gravity_torque(slow[0])[:, MOTOR_COLUMNS]
    found = [_torque(context, name, fast) - held for name in ("exact", "paper", "none")]
    expected = [100.0 * (_torque(context, name, slow) - held) for name in ("exact", "paper", "none")]
    return Check(
        "inertia forces are quadratic in speed",
        worst(np.array(found) - expected) / worst(expected),
        1e-9,
        "",
        "of the peak; (52) ten times as fast against a hundred times the forces, as for any rigid mechanism",
    )


VERDICTS = (neglect_is_small, cause_of_the_residual)
CHECKS = (two_derivations_of_the_neglect, torques_are_quadratic_in_speed)


def plots(context: Context) -> tuple[Plot, ...]:
    """Errors against speed, and over time at the printed speed."""
    items = ("claim: neglected shaft ripple has little effect", "claim: cause of Fig. 11's residual torques")
    return (
        Plot(
            "transmission_speed",
            "Cost of neglecting the Cardan shaft's motion and the drives",
            "Largest torque error along (52) against how fast it runs, by what is neglected; crosses at speed 1 mark "
            "the residuals that the paper reports for Fig. 11. Assumed masses; 1 g·m² assumed for each drive.",
            lambda: _speed_figure(study(context)),
            items,
        ),
        Plot(
            "transmission_time",
            "Torque errors of the transmission models along (52)",
            "Difference to the exact torque at the printed speed; each panel has its own scale. M3 has no drive PL.",
            lambda: _time_figure(study(context)),
            items[:1],
        ),
    )


def sections(context: Context) -> tuple[Section, ...]:
    """The study as a table."""
    found = study(context)
    rows = tuple(
        (f"{speed}", motor, *(f"{1e3 * found.error[m][row, k]:.3g}, {found.share(m)[row, k]:.2g} %" for m in MODELS),
         f"{found.peak[row, k]:.3g}")
        for row, speed in enumerate(SPEEDS)
        if speed in (1, 2, 5, 10)
        for k, motor in enumerate(MOTOR_LABELS)
    )  # fmt: skip
    inertia = 1e-3 * errors("Fig. 11")[:2] / found.acceleration[:2]
    paragraphs = (
        "Input and output shaft turn alike at every pose; what (26)-(31) neglect is the uneven speed of the Cardan "
        "shaft and its crosses in between, and their coupling to M1 and M2. The kinematics of the leg stay exact in "
        "every model; only inertia forces differ. Two readings of the shaft's centre are shown: by (30) the spin moves "
        "no mass; crossing ω of (29) with the centre instead moves it sideways with γ̇.",
        "The drives PL_1 and PL_2 enter by the law ΔM = (I_PL + (i_M i_PL)² I_rotor) times the joint's acceleration: "
        "the drive's own inertia at the joint, and the rotor's by the square of the whole ratio; all of it can be set "
        "as parameters of the leg (PL_1_inertia, PL_1_ratio, M1_rotor_inertia, ...), which ships with zero because the "
        f"paper gives none. The column assumes {1e3 * DRIVE_INERTIA:g} g·m² for each drive. For the reported residuals "
        f"PL_1 would need {1e3 * inertia[0]:.3g} and PL_2 {1e3 * inertia[1]:.3g} g·m²: with a rotor alone behind a "
        f"ratio i, that over i². M3 has no such drive.",
        f"The paper gives its differences as {_listed(errors('Fig. 11'), 'mN·m')} and "
        f"{_listed(shares('Fig. 11'), '%')} (M1, M2, M3).",
    )
    header = ("speed", "motor", *(f"{text}, mN·m" for text in MODELS.values()), "exact peak, N·m")
    return (
        Section(
            "transmission",
            "What neglecting the transmission costs",
            paragraphs,
            header,
            rows,
            ("transmission_speed", "transmission_time"),
            "Largest error along (52), 0-2 s, and its share of the exact peak; speed as a multiple of the printed one; "
            "peaks with the force of Fig. 11.",
        ),
    )


def _speed_figure(found: Study) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(10.5, 5.6)
    axis = figure.subplots()
    reported = errors("Fig. 11")
    for k, motor in enumerate(MOTOR_LABELS):
        for name, style in zip(MODELS, figures.STYLES, strict=True):
            if not found.error[name][0, k]:
                continue  # M3 has no drive PL, and zero has no place on a logarithmic axis
            axis.plot(
                SPEEDS,
                1e3 * found.error[name][:, k],
                color=figures.COLOURS[k],
                linestyle=style,
                marker=("o", "s", "^")[k],
                markersize=4,
                linewidth=1.6,
                label=f"{motor}: {MODELS[name]}",
            )
        axis.plot(1.0, reported[k], color=figures.COLOURS[k], marker="x", markersize=9, markeredgewidth=2, ls="none")
        axis.annotate(
            f"reported {motor}",
            (1.0, reported[k]),
            xytext=(8, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
        )
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xticks(SPEEDS, [str(speed) for speed in SPEEDS])
    axis.minorticks_off()
    figures.dress(axis, xlabel="speed of (52), multiples of the printed one", ylabel="largest torque error [mN·m]")
    axis.margins(x=0.03)
    axis.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8.5)
    return figure


def _time_figure(found: Study) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(9.0, 8.6)
    axes = figure.subplots(len(MODELS), 1, sharex=True)
    for axis, (name, title) in zip(axes, MODELS.items(), strict=True):
        figures.panel(axis, found.time, 1e3 * found.curves[name], MOTOR_LABELS, ylabel="error [mN·m]", title=title)
    figure.align_ylabels(axes)
    axes[-1].set_xlabel("time [s]")
    figures.legend_below(figure, axes[0])
    return figure
