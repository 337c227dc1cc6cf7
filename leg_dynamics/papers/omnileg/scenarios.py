"""The motions of the paper: what its simulations and experiments should show, computed; and a verdict on each figure.

Actuator columns here are in the paper's order M1, M2, M3, that is (beta, alpha, gamma). A foot force is the one that
the environment applies to the foot, unless "as printed" is said. A figure is confirmed by what it shows, computed by
the numeric route or held against what is printed: within `EXACT`, since both sides are exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.analysis.trajectories import (
    GaitCycle,
    OffsetWindow,
    Trajectory,
    feasible_offset_windows,
    omnileg_eq51,
    omnileg_eq51_path,
    omnileg_eq52,
    omnileg_eq53,
    omnileg_eq53_cycle,
)
from leg_dynamics.papers.framework import Check, Context, Figure, Plot, Section, Status, Verdict
from leg_dynamics.papers.judge import judge
from leg_dynamics.papers.omnileg.percentages import candidates
from leg_dynamics.papers.omnileg.printed import path_51
from leg_dynamics.papers.omnileg.reported import (
    FORCE,
    FORCE_ENDS,
    MOTOR_COLUMNS,
    MOTOR_LABELS,
    MOTORS,
    REPORTED,
)
from leg_dynamics.verification.first_principles import loop_residual

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from leg_dynamics.leg import Leg

__all__ = [
    "CHECKS",
    "SUPPORT_LOAD",
    "VERDICTS",
    "Z0",
    "LoadInference",
    "Run",
    "fig11",
    "fk_run",
    "gait_run",
    "height_windows",
    "ik_run",
    "inferred_load",
    "plots",
    "run",
    "sections",
]

AXES = ("X", "Y", "Z")

Z0 = 0.42
"""m; assumed: the paper gives no height for (51) and (53)."""

SUPPORT_LOAD = 20.0
"""N; assumed: the paper gives no load for the stance. The only foot load that it prints has 20 N along Z (Fig. 11)."""

EXACT = 1e-10
"""m, rad, N·m."""

RATE = 200.0
"""Samples a second."""

STEP_STARTS = (0.0, -0.05)
"""m; Y at lift-off: as printed, and with the step centred under the hip."""


# Computed motions.


@dataclass(frozen=True, eq=False)
class Run:
    """A motion and everything that follows from it, T samples.

    Attributes
    ----------
    motion : Trajectory
        Coordinates (alpha, beta, gamma), rad.
    position, velocity, acceleration : numpy.ndarray, shape (T, 3)
        Of the foot in the hip frame, m.
    torque : numpy.ndarray, shape (T, 3)
        M1, M2, M3, N·m.
    """

    motion: Trajectory
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray

    @property
    def time(self) -> np.ndarray:
        """s."""
        return self.motion.time


def run(leg: Leg, motion: Trajectory) -> Run:
    """Compute the foot's motion and the torques along `motion`, by whichever route `leg` takes."""
    q, v, a = motion.q, motion.v, motion.a
    torque = leg.torque(q, v, a, foot_force=motion.foot_force)
    order = [leg.actuator_names.index(name) for name in MOTORS]
    return Run(motion, leg.foot_position(q), leg.foot_velocity(q, v), leg.foot_acceleration(q, v, a), torque[:, order])


def height_windows(context: Context, z_sign: str = "up") -> tuple[OffsetWindow, ...]:
    """Heights z0, m, for which the leg can follow (51) within its limits.

    Parameters
    ----------
    context : Context
    z_sign : {"up", "literal"}
        Whether Z lifts the foot (P_z = z0 - Z), or is the coordinate itself (P_z = z0 + Z).
    """
    return context.once(
        f"height windows {z_sign}", lambda: feasible_offset_windows(context.leg, omnileg_eq51_path(0.0, z_sign=z_sign))
    )


def ik_run(context: Context, route: str = "closed_form") -> Run:
    """Inverse kinematics along (51) with z0 = `Z0`, then the foot and the torques of that motion by `route`."""

    def compute() -> Run:
        return run(_by(context, route), omnileg_eq51(context.leg, rate=RATE, z0=Z0))

    return context.once(f"(51) {route}", compute)


def fk_run(context: Context, gamma_degrees: float = 25.0, route: str = "closed_form") -> Run:
    """Forward kinematics along one period of (52), with the gamma amplitude in degrees."""

    def compute() -> Run:
        motion = omnileg_eq52(6.0, RATE, gamma_amplitude=math.radians(gamma_degrees))
        return run(_by(context, route), motion)

    return context.once(f"(52) {gamma_degrees:g} {route}", compute)


def fig11(context: Context, sign: str = "environment", gamma_degrees: float = 25.0, route: str = "closed_form") -> Run:
    """Torques of Fig. 11: (52) for 2 s, with `FORCE` in the first second.

    Parameters
    ----------
    context : Context
    sign : {"environment", "printed", "none"}
        Whether the environment applies the force to the foot, or (49)-(50) are taken as printed, which makes it the
        force that the foot exerts; or there is no force.
    gamma_degrees : float
        Amplitude of gamma, degrees.
    route : str
    """
    factor = {"environment": 1.0, "printed": -1.0, "none": 0.0}[sign]

    def compute() -> Run:
        motion = omnileg_eq52(2.0, 2.0 * RATE, gamma_amplitude=math.radians(gamma_degrees))
        return run(_by(context, route), motion.with_foot_force(factor * np.array(FORCE), 0.0, FORCE_ENDS))

    return context.once(f"Fig. 11 {sign} {gamma_degrees:g} {route}", compute)


def gait(start_y: float = 0.0, z0: float = Z0) -> GaitCycle:
    """One cycle of (53), swing then stance, starting at Y = `start_y` (m)."""
    return omnileg_eq53_cycle(z0, start=(0.0, start_y))


def gait_run(
    context: Context, start_y: float = 0.0, load: float = SUPPORT_LOAD, z0: float = Z0, route: str = "closed_form"
) -> Run:
    """Three cycles of (53) with a support load in stance.

    Parameters
    ----------
    context : Context
    start_y : float
        Y at lift-off, m.
    load : float
        N; upwards on the foot, in stance.
    z0 : float
        Height of the ground, m.
    route : str
    """

    def compute() -> Run:
        cycle = gait(start_y, z0)
        motion = omnileg_eq53(context.leg, 6.0, RATE, cycle=cycle)
        # z points down: the ground pushes towards negative z.
        force = cycle.support_force(motion.time, (0.0, 0.0, -load))
        return run(_by(context, route), motion.with_foot_force(force))

    return context.once(f"(53) {start_y:g} {load:g} {z0:g} {route}", compute)


@dataclass(frozen=True)
class LoadInference:
    """What the errors and shares of Fig. 19 imply for a massless leg that carries a load slowly.

    Attributes
    ----------
    half_step : float
        Largest |Y|, m.
    load : float
        N.
    sine : float
        Of the largest gamma; above 1 no height fits.
    height : float
        m; NaN where none fits.
    """

    half_step: float
    load: float
    sine: float
    height: float


def inferred_load(context: Context, half_step: float) -> LoadInference:
    """Infer load and height of Fig. 19 from the peaks that its errors and shares imply; an inference, not an input.

    A vertical load W on a massless leg at rest with X = 0 needs M2 = W |Y| and M3 = 2 L4 W sin(gamma).
    """
    peaks = {name: REPORTED["Fig. 19", name].implied for name in ("M2", "M3")}
    load = peaks["M2"] / half_step
    sine = peaks["M3"] / (2.0 * float(context.numbers.L4) * load)
    height = math.nan
    if sine <= 1.0:
        # Gamma is largest where the thigh is vertical.
        height = float(context.leg.foot_position([0.0, 0.0, math.asin(sine)])[2])
    return LoadInference(half_step, load, sine, height)


def foot_force_torque(context: Context, t: float) -> np.ndarray:
    """J^T F of Fig. 11 at time `t`, in the order (alpha, beta, gamma), N·m."""
    q = np.array([math.pi / 6.0, math.pi / 6.0, math.radians(25.0)]) * math.sin(math.pi * t / 3.0)
    torque: np.ndarray = np.asarray(context.leg.jacobian(q)).T @ np.array(FORCE)
    return torque


def _by(context: Context, route: str) -> Leg:
    return context.leg if route == "closed_form" else context.pinocchio


def _peak(values: np.ndarray) -> np.ndarray:
    return np.abs(values).max(axis=0)


def _norm_peak(values: np.ndarray) -> float:
    return float(np.linalg.norm(values, axis=1).max())


def _span(values: np.ndarray) -> np.ndarray:
    return np.ptp(values, axis=0)


def _error(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.abs(first - second).max())


def _coordinates(context: Context) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Tree coordinates by the numeric route's assembly, and the states, a share of `context.q`."""
    q = context.q[:200]
    return context.once("coordinates of the numeric route", lambda: dict(context.pinocchio.assemble(q))), q


def _places(context: Context, links: tuple[str, ...]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Poses of links in the hip frame at those coordinates, and the states."""
    from leg_dynamics.description import link_transforms

    values, q = _coordinates(context)

    def compute() -> dict[str, np.ndarray]:
        poses = link_transforms(context.leg.description, values)
        return {name: np.linalg.solve(poses["hip"], pose) for name, pose in poses.items()}

    poses = context.once("poses of the numeric route", compute)
    return {name: poses[name] for name in links}, q


def _list(values: Any, digits: int = 4) -> str:
    # Adding zero turns -0 into 0.
    return ", ".join(f"{value + 0.0:.{digits}g}" for value in np.atleast_1d(values))


def _within(error: float) -> str:
    return f"to {error:.1e} m" if error else "exactly"


def _three(what: str, values: np.ndarray, unit: str, of: str, names: tuple[str, ...] = AXES) -> tuple[Figure, ...]:
    return tuple(Figure(f"{what} {name}", value, unit, of) for name, value in zip(names, values, strict=True))


def _window_text(window: OffsetWindow) -> str:
    """Rounded inwards, so that the printed ends are feasible too."""
    return f"[{math.ceil(window.lower * 1e4) / 1e4:.4f}, {math.floor(window.upper * 1e4) / 1e4:.4f}] m"


# Verdicts on the drawings of the mechanism.


def figure_1(context: Context) -> Verdict:
    """The human leg."""
    poses, q = _places(context, ("foot",))
    turn = _error(poses["foot"][:, :3, :3], np.eye(3))
    of = f"largest entry of R - 1 of the foot, assembled numerically at {len(q)} random states"
    holds = "holds" if turn <= EXACT else "does not hold"
    return Verdict(
        "Fig. 1",
        "figure",
        "The human leg and gait that suggested the mechanism",
        Status.OUT_OF_REACH,
        f"A drawing of people, not of this leg. The feature taken over from them, a foot that keeps its attitude, "
        f"{holds} for the model: its rotation differs from the identity by at most {turn:.1e}.",
        (Figure("foot rotation", turn, "", of),),
    )


MOBILITY = 3
"""Degrees of freedom that the text beside Fig. 2 gives the leg: two of the thigh, one of the shank."""


def figure_2(context: Context) -> Verdict:
    """The three-dimensional model."""
    report = context.once("mobility", lambda: context.pinocchio.mobility_report(samples=20, seed=context.seed))
    moving = len(context.leg.description.moving_joints)
    return Verdict(
        "Fig. 2",
        "figure",
        "The whole leg: a thigh with two degrees of freedom, a shank with one",
        judge([pose.mobility - MOBILITY for pose in report.poses] + [report.mobility - MOBILITY], 0.0),
        f"Built as drawn, with {moving} tree joints, {len(context.leg.description.loops)} loops and "
        f"{len(context.leg.description.couplings)} gear pairs, the leg has mobility {report.mobility} at "
        f"{len(report.poses)} poses, and {report.redundant} redundant closure rows; "
        f"counting joints and rows only would give {report.gruebler}.",
        (
            Figure("mobility", report.mobility, "", f"rank of the closure rows at {len(report.poses)} poses"),
            Figure("redundant rows", report.redundant, "", "closure rows minus their rank"),
            Figure("Grübler count", report.gruebler, "", "joints minus closure rows"),
        ),
    )


def figure_3(context: Context) -> Verdict:
    """Motions driven by two and by three motors."""
    lower, upper = context.limits
    q = context.q.copy()
    q[:, 0] = 0.0
    sideways = float(np.abs(context.leg.foot_position(q)[:, 1]).max())
    q = context.q
    mirrored = context.leg.foot_position(q * [-1.0, -1.0, 1.0])
    turned = context.leg.foot_position(q[:, [1, 0, 2]] * [-1.0, 1.0, 1.0])
    p = context.leg.foot_position(q)
    mirror = _error(mirrored, p * [-1.0, -1.0, 1.0])
    quarter = _error(turned, np.stack([-p[:, 1], p[:, 0], p[:, 2]], axis=-1))
    ends = context.leg.foot_position([[0.0, 0.0, lower[2]], [0.0, 0.0, upper[2]]])
    lift = float(ends[0, 2] - ends[1, 2])
    short = lift - 2.0 * float(context.numbers.L4) * float(np.cos(lower[2]) - np.cos(upper[2]))
    of = f"{len(q)} random states inside the limits"
    return Verdict(
        "Fig. 3",
        "figure",
        "Motions driven by M1 and M3, and by all three motors",
        judge([sideways, mirror, quarter, short, *ends[:, :2].ravel()], EXACT),
        f"With M1 and M3 alone the foot stays in the plane Y = 0 ({_within(sideways)}); the workspace maps onto itself "
        f"under a half turn ({_within(mirror)}) and a quarter turn ({_within(quarter)}) about Z; the shank alone lifts "
        f"the foot by {1e3 * lift:.1f} mm.",
        (
            Figure("sideways motion", sideways, "m", f"largest |Y| with alpha = 0, {of}"),
            Figure("half turn", mirror, "m", f"foot of (-alpha, -beta, gamma) against the turned foot, {of}"),
            Figure("quarter turn", quarter, "m", f"foot of (-beta, alpha, gamma) against the turned foot, {of}"),
            Figure("lift by the shank", lift, "m", "gamma from its lower to its upper limit, thigh vertical"),
        ),
    )


def figure_4(context: Context) -> Verdict:
    """Diagrams of the mechanism."""
    residual = context.formulas.closure_residual(context.numbers, tuple(context.q.T))
    thigh = float(max(np.abs(component).max() for component in residual))
    values, q = _coordinates(context)
    loops = float(loop_residual(context.leg.description, dict(values)).max())
    return Verdict(
        "Fig. 4",
        "figure",
        "Diagrams of the whole leg, the thigh, one thigh chain, the shank and one shank chain",
        judge([thigh, loops], EXACT),
        f"The three thigh chains as drawn meet in one knee plate (largest gap {thigh:.1e}, corrected signs), and all "
        f"loops and gear pairs of the leg close to {loops:.1e} when they are assembled numerically.",
        (
            Figure("thigh gap", thigh, "m, rad", f"chains 2 and 3 against chain 1, {len(context.q)} random states"),
            Figure("loop residual", loops, "m, rad", f"all loops, numeric assembly at {len(q)} random states"),
        ),
    )


def figure_5(context: Context) -> Verdict:
    """The construction behind the inverse kinematics."""
    p = context.leg.foot_position(context.q)
    found = context.leg.inverse_kinematics(p, limits="ignore", on_error="nan")
    back = _error(found, context.q)
    lower = context.q[:, 2].min()
    return Verdict(
        "Fig. 5",
        "figure",
        "The right-angled triangle and the isosceles one that solve the inverse kinematics",
        judge(back, EXACT),
        f"The construction holds (its formula is another matter, see (13)): inverse after forward kinematics returns "
        f"{len(p)} random states to {math.degrees(back):.1e} degrees.",
        (
            Figure(
                "round trip",
                back,
                "rad",
                f"{len(p)} random states inside the limits with gamma above {math.degrees(lower):.2f} degrees",
            ),
        ),
    )


def figure_6(context: Context) -> Verdict:
    """One thigh chain."""
    poses, q = _places(context, ("knee", "rod_A1B1"))
    knee = np.stack(np.broadcast_arrays(*context.formulas.knee_position(context.numbers, tuple(q.T))), axis=-1)
    error = _error(poses["knee"][:, :3, 3], knee)
    rod = _error(poses["rod_A1B1"][:, :3, 3], np.array([0.0, float(context.numbers.L3), 0.0]))
    end = poses["rod_A1B1"][:, :3, 3] + float(context.numbers.L1) * poses["rod_A1B1"][:, :3, 2]
    joined = _error(end, poses["knee"][:, :3, 3] + [0.0, float(context.numbers.L3), 0.0])
    return Verdict(
        "Fig. 6",
        "figure",
        "The chain O0-A1-B1-O0′ with its two universal joints",
        judge([error, rod, joined], EXACT),
        f"A1 lies L3 beside O0 (to {rod:.1e} m) and the rod of length L1 ends L3 beside O0′ (to {joined:.1e} m); the "
        f"knee that this chain gives is the numerically assembled one to {error:.1e} m.",
        (
            Figure("knee position", error, "m", f"formula against numeric assembly, {len(q)} random states"),
            Figure("rod's end beside the knee", joined, "m", f"numeric assembly, {len(q)} random states"),
        ),
    )


def figure_7(context: Context) -> Verdict:
    """The transmission inside the thigh."""
    values, q = _coordinates(context)
    output = _error(values["gamma_output"], q[:, 2])
    gears = max(_error(values[f"gamma_C{i}"], q[:, 2]) for i in (1, 2, 3))
    bend = float(np.degrees(np.hypot(values["cardan_A4_y"], values["cardan_A4_x"]).max()))
    return Verdict(
        "Fig. 7",
        "figure",
        "The double Cardan shaft and the bevel gears that drive the shank",
        judge([output, gears], EXACT),
        f"With both plates parallel and the yokes in phase, the output shaft turns exactly as much as the motor, and "
        f"in the same sense: they differ by at most {output:.1e} rad while the joints bend by up to {bend:.0f} "
        f"degrees. The bevel gears pass that on 1:1 (to {gears:.1e} rad).",
        (
            Figure("output against input", output, "rad", f"numeric assembly at {len(q)} random states"),
            Figure("driven gears against input", gears, "rad", "the same states"),
            Figure("largest bend", bend, "°", "root of the sum of squares of both cross angles, the same states"),
        ),
    )


def figure_8(context: Context) -> Verdict:
    """One shank chain."""
    values, q = _coordinates(context)
    knee = max(_error(values[f"phi_D{i}"], -2.0 * q[:, 2]) for i in (1, 2, 3))
    length = float(context.numbers.L4)
    poses, _ = _places(context, ("foot", "knee"))
    shortened = 2.0 * length + float(context.numbers.L5) - (poses["foot"] - poses["knee"])[:, 2, 3]
    slider = _error(shortened, 2.0 * length * (1.0 - np.cos(q[:, 2])))
    return Verdict(
        "Fig. 8",
        "figure",
        "The chain C1-D1-E1, equivalent to a crank and slider",
        judge([knee, slider], EXACT),
        f"The middle joint turns by -2γ, which the paper never states (to {knee:.1e} rad for all three chains), and "
        f"the shank shortens as (10) says, to {slider:.1e} m.",
        (
            Figure("middle joint + 2 gamma", knee, "rad", f"three chains, numeric assembly at {len(q)} random states"),
            Figure("shortening", slider, "m", "foot and knee of the numeric assembly against (10), the same states"),
        ),
    )


# Verdicts on the motions.


def _off_51(run: Run) -> float:
    """Largest distance of a run's foot from (51) as printed, lifted from z0, m."""
    path = path_51(run.time, 5.0) * [1.0, 1.0, -1.0] + [0.0, 0.0, Z0]
    return _error(run.position, path)


def figure_9(context: Context) -> Verdict:
    """Inverse kinematics along (51)."""
    here, other = ik_run(context), ik_run(context, "pinocchio")
    (window,) = height_windows(context)
    error, off = _error(here.position, other.position), max(_off_51(here), _off_51(other))
    straight = "outside" if 0.5 not in window else "inside"
    return Verdict(
        "Fig. 9",
        "figure",
        "The foot along (51): position, velocity, acceleration",
        judge([error, off], EXACT),
        f"The curves follow from (51) with T = 5 s: spans {_list(1e3 * _span(here.position))} mm, speeds up to "
        f"{_list(1e3 * _peak(here.velocity))} mm/s, accelerations up to {_list(1e3 * _peak(here.acceleration))} mm/s². "
        f"The height z0 is not given; feasible is z0 in {_window_text(window)}, and the straight leg (0.5 m) is "
        f"{straight}. Inverse, then forward kinematics by a second derivation lead back to the printed path within "
        f"{off:.1e} m, so 42.5 µm are not the model's.",
        (
            *_three("span", _span(here.position), "m", "foot along (51)"),
            *_three("peak speed", _peak(here.velocity), "m/s", "foot along (51)"),
            *_three("peak acceleration", _peak(here.acceleration), "m/s²", "foot along (51)"),
            Figure("lowest z0", window.lower, "m", f"feasible heights, ended by {window.lower_reason}"),
            Figure("highest z0", window.upper, "m", f"feasible heights, ended by {window.upper_reason}"),
            Figure(
                "position, closed form minus numeric", error, "m", f"{len(here.time)} samples of (51), z0 = {Z0:g} m"
            ),
            Figure("distance from (51) as printed", off, "m", "both derivations, the same samples"),
        ),
    )


def _amplitude_fits(context: Context, degrees: float) -> bool:
    """Whether the printed shares along (52) can be those of a motion with this amplitude of gamma.

    Position error of the simulation and Z error of the experiment: both are said to be shares of a full value, and both
    depend on it.
    """
    position = fk_run(context, degrees).position
    span = _span(position)
    held = [(REPORTED["Fig. 10", "position"], 1e6 * span), (REPORTED["Fig. 17", "Z"], 1e3 * span[2:])]
    return all(
        bool(((values >= reported.reference[0]) & (values <= reported.reference[1])).any())
        for reported, values in held
        if reported.reference is not None
    )


def figure_10(context: Context) -> Verdict:
    """Forward kinematics along (52)."""
    here, wide = fk_run(context), fk_run(context, 45.0)
    error = _error(here.position, fk_run(context, route="pinocchio").position)
    z, z_wide = 1e3 * _span(here.position)[2], 1e3 * _span(wide.position)[2]
    low, high = REPORTED["Fig. 10", "position"].reference or (math.nan, math.nan)
    outside = float(here.time[np.flatnonzero(here.motion.q[:, 2] < -1e-9)].size / (here.time.size - 1))
    settled = _amplitude_fits(context, 25.0)
    return Verdict(
        "Fig. 10",
        "figure",
        "The foot along (52): position, velocity, acceleration",
        judge([error, 0.0 if settled else 1.0], EXACT),
        f"(52) gives curves at any amplitude (two derivations agree to {error:.1e} m), but the paper does not settle "
        f"which one was run: 45 µm and 0.05 % imply a full value of {1e-3 * low:.0f} to {1e-3 * high:.0f} mm; Z spans "
        f"{z:.1f} mm at the printed 25°, {z_wide:.1f} mm at 45°. For {100 * outside:.0f} % of the period gamma is "
        "negative, outside Table 2.",
        (
            *_three("span", _span(here.position), "m", "foot along (52), 6 s, 25°"),
            *_three("span", _span(wide.position), "m", "foot along (52), 6 s, 45°"),
            Figure("implied full value, lower", 1e-6 * low, "m", "from the printed error and share, with rounding"),
            Figure("implied full value, upper", 1e-6 * high, "m", "from the printed error and share, with rounding"),
            Figure("position, closed form minus numeric", error, "m", f"{len(here.time)} samples of (52), 25°"),
        ),
    )


def figure_11(context: Context) -> Verdict:
    """Torques along (52) with a force on the foot."""
    ours, as_printed = fig11(context), fig11(context, "printed")
    truth, unloaded = (fig11(context, sign, route="pinocchio").torque for sign in ("environment", "none"))
    error = _error(ours.torque, truth)
    start, end = foot_force_torque(context, 0.0), foot_force_torque(context, 1.0)
    apart = _peak(ours.torque - as_printed.torque)
    inertial = _peak(_inertial(context))
    return Verdict(
        "Fig. 11",
        "figure",
        "Motor torques along (52) with (0, -20, 20) N in the first second",
        judge(
            as_printed.torque - truth,
            EXACT,
            corrected=ours.torque - truth,
            # Printed minus true is twice what the force asks of the motors: the sign, and nothing else.
            explained=as_printed.torque - truth - 2.0 * (unloaded - truth),
        ),
        f"Taken as printed, a force applied to the foot enters with the wrong sign: the torques differ by up to "
        f"{_list(apart)} N·m (M1, M2, M3). Peaks are {_list(_peak(ours.torque))} N·m corrected and "
        f"{_list(_peak(as_printed.torque))} N·m as printed, with assumed masses; exact is JᵀF = ({_list(start)}) N·m "
        f"at 0 s and ({_list(end, 5)}) N·m at 1 s for (α, β, γ). Inertia and velocity contribute at most "
        f"{1e3 * inertial.max():.0f} mN·m, so that the figure hardly tests them.",
        (
            *_three("peak", _peak(ours.torque), "N·m", "Fig. 11, force on the foot, assumed masses", MOTOR_LABELS),
            *_three(
                "peak as printed",
                _peak(as_printed.torque),
                "N·m",
                "Fig. 11, printed sign, assumed masses",
                MOTOR_LABELS,
            ),
            *_three("difference", apart, "N·m", "largest over Fig. 11, corrected minus printed", MOTOR_LABELS),
            *_three("JᵀF at 0 s", start, "N·m", "Fig. 11, no mass enters", ("α", "β", "γ")),
            *_three("JᵀF at 1 s", end, "N·m", "Fig. 11, no mass enters", ("α", "β", "γ")),
            *_three(
                "inertia and velocity", inertial, "N·m", "peak of M a + V along (52), 2 s, assumed masses", MOTOR_LABELS
            ),
            Figure("torque, closed form minus numeric", error, "N·m", f"{len(ours.time)} samples of Fig. 11"),
        ),
        printed="τ = M η̈ + V + G + Jᵀ F_f,  F_f applied to the foot",
        corrected="τ = M η̈ + V + G − Jᵀ F_f",
    )


def _inertial(context: Context) -> np.ndarray:
    motion = fig11(context, "none").motion
    torque = context.leg.torque(motion.q, motion.v, motion.a) - context.leg.gravity_torque(motion.q)
    return torque[:, [context.leg.actuator_names.index(name) for name in MOTORS]]


def figure_12(context: Context) -> Verdict:
    """The prototype."""
    return _hardware("Fig. 12", "The prototype on its stand")


def figure_13(context: Context) -> Verdict:
    """The motion capture system."""
    return _hardware("Fig. 13", "The optical motion capture system")


def figure_14(context: Context) -> Verdict:
    """Path of the inverse kinematics experiment."""
    here = ik_run(context)
    gap = here.position[-1] - here.position[0]
    off = _off_51(here)
    condition = float(np.linalg.cond(context.leg.jacobian(here.motion.q)).max())
    low, high = (np.round(np.degrees(x), 9) + 0.0 for x in (here.motion.q.min(axis=0), here.motion.q.max(axis=0)))
    return Verdict(
        "Fig. 14",
        "figure",
        "Path of the foot in the experiment along (51)",
        judge([off, *(gap - [0.0, 0.1, 0.0])], EXACT),
        f"The commanded path is drawn from (51) (to {off:.1e} m); the measured points are not here. It returns in X "
        f"and Z and ends {1e3 * gap[1]:.0f} mm away in Y. At z0 = {Z0:g} m it needs α in "
        f"[{low[0]:.1f}, {high[0]:.1f}]°, β "
        f"in [{low[1]:.1f}, {high[1]:.1f}]°, γ in [{low[2]:.1f}, {high[2]:.1f}]°: α is negative, which Table 2 "
        "forbids.",
        (
            *_three("end minus start", gap, "m", "foot along (51)"),
            *_three("least", low, "°", f"(51), z0 = {Z0:g} m", ("α", "β", "γ")),
            *_three("greatest", high, "°", f"(51), z0 = {Z0:g} m", ("α", "β", "γ")),
            Figure("condition number", condition, "", f"largest of the foot Jacobian along (51), z0 = {Z0:g} m"),
        ),
    )


def figure_15(context: Context) -> Verdict:
    """Experiment against theory along (51)."""
    runs = {"": ik_run(context)}
    return _experiment("Fig. 15", "Measured against computed foot motion along (51)", "(51)", runs)


def figure_16(context: Context) -> Verdict:
    """Path of the forward kinematics experiment."""
    here, wide = fk_run(context), fk_run(context, 45.0)
    plane = float(np.abs(here.position[:, 0] + here.position[:, 1]).max())
    half = here.position[: len(here.time) // 2 + 1]
    retraced = _error(half, half[::-1])
    speed = _norm_peak(here.velocity[:1])
    settled = _amplitude_fits(context, 25.0)
    return Verdict(
        "Fig. 16",
        "figure",
        "Path of the foot in the experiment along (52)",
        judge([plane, retraced, 0.0 if settled else 1.0], EXACT),
        f"The measured points are not here, and the amplitude of γ is open (see Fig. 10); both paths are drawn. They "
        f"lie in the plane X = -Y (to {plane:.1e} m), each half is traced forth and back (to {retraced:.1e} m), and "
        f"they start at {1e3 * speed:.1f} mm/s, which a motor at rest cannot follow.",
        (
            *_three("span", _span(here.position), "m", "foot along (52), 6 s, 25°"),
            *_three("span", _span(wide.position), "m", "foot along (52), 6 s, 45°"),
            Figure("distance from the plane X = -Y", plane, "m", "largest |X + Y| along (52)"),
            Figure("starting speed", speed, "m/s", "foot at t = 0 along (52), 25°"),
        ),
    )


def figure_17(context: Context) -> Verdict:
    """Experiment against theory along (52)."""
    runs = {f" at {degrees:g}°": fk_run(context, degrees) for degrees in (25.0, 45.0)}
    return _experiment("Fig. 17", "Measured against computed foot motion along (52)", "(52)", runs)


def figure_18(context: Context) -> Verdict:
    """The walking platform."""
    return _hardware("Fig. 18", "The platform that walks on one leg")


def figure_19(context: Context) -> Verdict:
    """Torques of the gait."""
    here = gait_run(context)
    unloaded = gait_run(context, load=0.0)
    stance = gait().in_stance(here.time)
    swing, support = _peak(here.torque[~stance]), _peak(here.torque[stance])
    m1 = float(_peak(here.torque)[0])
    per_newton = _peak(here.torque[stance] - unloaded.torque[stance]) / SUPPORT_LOAD
    centred, printed = inferred_load(context, 0.05), inferred_load(context, 0.1)
    fits = "no height fits" if printed.sine > 1.0 else f"the height would be {printed.height:.3f} m"
    return Verdict(
        "Fig. 19",
        "figure",
        "Motor torques of the gait (53), swing and stance, against measured ones",
        # No number here can settle it: the drawn curves depend on what is not given.
        Status.NOT_REPRODUCIBLE,
        f"Masses, load, height and friction are not given. What hardly needs them holds: M1 stays within {m1:.1e} N·m. "
        f"With assumed masses, z0 = {Z0:g} m and an assumed load of {SUPPORT_LOAD:g} N the peaks of M2 and M3 are "
        f"{_list(swing[1:])} N·m in swing and {_list(support[1:])} N·m in stance. Inference only: the printed errors "
        f"and shares imply {centred.load:.1f} N at {centred.height:.3f} m for a step centred under the hip; for Y from "
        f"0 to 0.1 m {fits} (sin γ = {printed.sine:.3f}).",
        (
            *_three("peak in swing", swing, "N·m", f"(53), z0 = {Z0:g} m, assumed masses", MOTOR_LABELS),
            *_three("peak in stance", support, "N·m", f"the same with {SUPPORT_LOAD:g} N, assumed", MOTOR_LABELS),
            *_three(
                "per newton", per_newton, "m", "largest torque in stance per newton of load; no mass", MOTOR_LABELS
            ),
            Figure("inferred load", centred.load, "N", "massless leg at rest, |Y| up to 0.05 m; inference only"),
            Figure("inferred height", centred.height, "m", "massless leg at rest, |Y| up to 0.05 m; inference only"),
            Figure("sin γ for Y to 0.1 m", printed.sine, "", "above 1 there is no such pose; inference only"),
        ),
    )


def _hardware(item: str, title: str) -> Verdict:
    return Verdict(
        item, "figure", title, Status.OUT_OF_REACH, "A photograph of hardware; there is nothing in it to compute."
    )


def _experiment(item: str, title: str, motion: str, runs: dict[str, Run]) -> Verdict:
    """Verdict on measured curves; `runs` by what sets them apart."""
    parts, figures = [], []
    for axis in AXES:
        reported = REPORTED[item, axis]
        low, high = reported.reference or (math.nan, math.nan)
        full = {
            name: 1e3 * value
            for of, run in runs.items()
            for name, value in candidates(run.position - run.position[0], axis, of).items()
        }
        hits = [name for name, value in full.items() if low <= value <= high]
        parts.append(
            f"{axis}: {reported.error} mm and {reported.percent} % imply {low:.1f} to {high:.1f} mm, fits "
            f"{f'the {hits[0]}' if hits else 'no candidate'}"
        )
        figures.append(
            Figure(f"implied full value {axis}", 1e-3 * reported.implied, "m", "printed error divided by its share")
        )
        figures += [
            Figure(f"{name}, {axis} error", 1e-3 * value, "m", f"foot along {motion}") for name, value in full.items()
        ]
    finding = (
        "Measured on hardware. Only the shares can be held against something computed; each has a verdict among the "
        f"claims. {'; '.join(parts)}."
    )
    return Verdict(item, "figure", title, Status.OUT_OF_REACH, finding, tuple(figures))


VERDICTS = (
    figure_1,
    figure_2,
    figure_3,
    figure_4,
    figure_5,
    figure_6,
    figure_7,
    figure_8,
    figure_9,
    figure_10,
    figure_11,
    figure_12,
    figure_13,
    figure_14,
    figure_15,
    figure_16,
    figure_17,
    figure_18,
    figure_19,
)


# What must hold.


def path_is_followed(context: Context) -> Check:
    """The foot by the numeric route against the path that the inverse kinematics was asked for."""
    other = ik_run(context, "pinocchio")
    path = omnileg_eq51_path(Z0).foot_path(times=other.time)
    error = max(
        _error(other.position, path.position),
        _error(other.velocity, path.velocity),
        _error(other.acceleration, path.acceleration),
    )
    return Check(
        "(51) is followed",
        error,
        1e-10,
        "m, m/s, m/s²",
        "foot by the numeric route along the closed form's motion, against (51)",
    )


def forward_kinematics_agree(context: Context) -> Check:
    """Both routes along (52)."""
    here, other = fk_run(context), fk_run(context, route="pinocchio")
    error = max(
        _error(here.position, other.position),
        _error(here.velocity, other.velocity),
        _error(here.acceleration, other.acceleration),
    )
    return Check(
        "(52) by two derivations", error, 1e-10, "m, m/s, m/s²", "position, velocity, acceleration of the foot"
    )


def torques_agree(context: Context) -> Check:
    """Both routes along Fig. 11 and the gait."""
    error = max(
        _error(fig11(context).torque, fig11(context, route="pinocchio").torque),
        _error(gait_run(context).torque, gait_run(context, route="pinocchio").torque),
    )
    return Check("torques by two derivations", error, 1e-10, "N·m", "Fig. 11 with its force, and three cycles of (53)")


def force_enters_linearly(context: Context) -> Check:
    """The foot force against virtual work with numerically differentiated positions."""
    bare, loaded = fig11(context, "none"), fig11(context)
    q = loaded.motion.q[:: len(loaded.time) // 20]
    force = loaded.motion.foot_force[:: len(loaded.time) // 20]  # type: ignore[index]
    step = 1e-6
    work = np.stack(
        [
            np.einsum(
                "ti,ti->t", context.pinocchio.foot_position(q + e) - context.pinocchio.foot_position(q - e), force
            )
            / (2.0 * step)
            for e in step * np.eye(3)
        ],
        axis=-1,
    )
    change = (loaded.torque - bare.torque)[:: len(loaded.time) // 20]
    return Check(
        "virtual work of the foot force",
        _error(change, -work[:, MOTOR_COLUMNS]),
        1e-7,
        "N·m",
        "Fig. 11: change of the torques against central differences of the numeric route's foot position",
    )


def gait_repeats(context: Context) -> Check:
    """The three cycles of the gait."""
    torque = gait_run(context).torque
    period = round(gait().duration * RATE)
    return Check("(53) repeats", _error(torque[period:], torque[:-period]), 1e-9, "N·m", "torques, one cycle later")


CHECKS = (path_is_followed, forward_kinematics_agree, torques_agree, force_enters_linearly, gait_repeats)


# Drawings.


def plots(context: Context) -> tuple[Plot, ...]:
    """The paper's Figs 9-11, 14, 16 and 19 in its layout, and what explains them."""
    return (
        Plot(
            "fig9",
            "Fig. 9: along (51)",
            f"The prescribed foot motion (left; Z lifts the foot, z0 = {Z0:g} m assumed) and the motor motion that "
            "inverse kinematics finds for it (right). z points down: a lifted foot has z < z0. The "
            "acceleration of X has a corner at 2.5 s.",
            lambda: _draw_fig9(ik_run(context)),
            ("Fig. 9", "(51)"),
        ),
        Plot(
            "fig10",
            "Fig. 10: along (52)",
            "The foot for the printed amplitude of γ (left) and for 45° (right), on the same scales. X and Y mirror "
            "each other. Shaded: γ is negative, outside Table 2.",
            lambda: _draw_fig10(fk_run(context), fk_run(context, 45.0)),
            ("Fig. 10", "(52)"),
        ),
        Plot(
            "fig11",
            "Fig. 11: torques with a force on the foot",
            "The closed form (a), the numeric route, which shares no formula with it (b), and their difference (c). "
            "Shaded: (0, -20, 20) N applied to the foot. Masses are assumed.",
            lambda: _draw_fig11(fig11(context), fig11(context, route="pinocchio")),
            ("Fig. 11",),
        ),
        Plot(
            "fig11_sign",
            "Fig. 11: the sign of the force",
            "The same motion with the force applied to the foot, and with (49)-(50) as printed. Dotted: no force. "
            "Without a force the two are the same, as in the second half.",
            lambda: _draw_sign(fig11(context), fig11(context, "printed"), fig11(context, "none")),
            ("Fig. 11", "(49)", "(50)"),
        ),
        Plot(
            "fig14",
            "Fig. 14: path of (51)",
            "The commanded path in space and in three projections; the dot is its start. Z points down.",
            lambda: _draw_paths([("(51)", ik_run(context).position)], "Path of the foot along (51)"),
            ("Fig. 14", "(51)"),
        ),
        Plot(
            "fig16",
            "Fig. 16: path of (52)",
            "The commanded path for both amplitudes of γ; the dot is the start, with the leg straight. Z points down.",
            lambda: _draw_paths(
                [("γ to 25° (printed)", fk_run(context).position), ("γ to 45°", fk_run(context, 45.0).position)],
                "Path of the foot along (52)",
            ),
            ("Fig. 16", "(52)"),
        ),
        Plot(
            "fig19_foot",
            "The gait (53)",
            "The foot over one cycle: swing, then stance (shaded) with H = 0, which takes the foot back.",
            lambda: _draw_gait_foot(gait_run(context)),
            ("(53)", "Fig. 19"),
        ),
        Plot(
            "fig19",
            "Fig. 19: torques of the gait (53)",
            f"Three cycles; the stance is shaded and carries an assumed {SUPPORT_LOAD:g} N. Solid: Y from 0 to 0.1 m, "
            f"as printed; dashed: the step centred under the hip. z0 = {Z0:g} m and all masses are assumed; nothing is "
            "fitted to the paper. M1 is drawn in µN·m: the paper calls it zero.",
            lambda: _draw_fig19(gait_run(context), gait_run(context, STEP_STARTS[1])),
            ("Fig. 19",),
        ),
    )


def _draw_fig9(here: Run) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(10.5, 7.8)
    axes = figure.subplots(3, 2, sharex=True)
    z0 = np.array([0.0, 0.0, here.position[0, 2]])
    foot = ((here.position - z0) * 1e3, here.velocity * 1e3, here.acceleration * 1e3)
    foot_units = ("position [mm]", "velocity [mm/s]", "acceleration [mm/s²]")
    order = [1, 0, 2]
    motors = [np.degrees(values[:, order]) for values in (here.motion.q, here.motion.v, here.motion.a)]
    motor_units = ("angle [°]", "rate [°/s]", "acceleration [°/s²]")
    for row in range(3):
        figures.panel(axes[row, 0], here.time, foot[row], ("X", "Y", "z − z(0)"), ylabel=foot_units[row])
        figures.panel(axes[row, 1], here.time, motors[row], MOTOR_LABELS, ylabel=motor_units[row])
    _columns(axes, ("(a) foot, prescribed", "(b) motors, by inverse kinematics"))
    figure.align_ylabels(axes)
    return figure


def _draw_fig10(here: Run, wide: Run) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(10.5, 7.8)
    axes = figure.subplots(3, 2, sharex=True, sharey="row")
    units = ("position [mm]", "velocity [mm/s]", "acceleration [mm/s²]")
    for column, item in enumerate((here, wide)):
        z0 = np.array([0.0, 0.0, item.position[0, 2]])
        for row, values in enumerate((item.position - z0, item.velocity, item.acceleration)):
            labels = ("X", "Y", "z − z(0)")
            axis = axes[row, column]
            figures.panel(axis, item.time, 1e3 * values, labels, ylabel="" if column else units[row])
            figures.shade(axis, 3.0, 6.0, "" if row else "γ < 0", above=True)
    _columns(axes, ("(a) γ to 25°, as printed", "(b) γ to 45°"))
    figure.align_ylabels(axes)
    return figure


def _draw_fig11(here: Run, other: Run) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(11.5, 4.3)
    first, second, third = figure.subplots(1, 3, sharex=True)
    figures.panel(first, here.time, here.torque, MOTOR_LABELS, ylabel="torque [N·m]", title="(a) closed form")
    figures.panel(second, other.time, other.torque, MOTOR_LABELS, title="(b) numeric route")
    figures.magnitude(
        third,
        here.time[::3],
        (here.torque - other.torque)[::3],
        MOTOR_LABELS,
        ylabel="|difference| [N·m]",
        title="(c) (a) minus (b)",
    )
    second.sharey(first)
    for axis in (first, second, third):
        figures.shade(axis, 0.0, 1.0, "force on foot")
        axis.margins(y=0.1)
        axis.set_xlabel("time [s]", fontsize=9.5)
    figures.legend_below(figure, first)
    return figure


def _draw_sign(ours: Run, printed: Run, bare: Run) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(11.5, 4.0)
    for k, axis in enumerate(figure.subplots(1, 3, sharex=True, sharey=True)):
        for item, label, colour, style in (
            (ours, "force applied to the foot (corrected)", figures.COLOURS[0], "-"),
            (printed, "as printed: force that the foot exerts", figures.COLOURS[1], "--"),
            (bare, "no force", "0.35", ":"),
        ):
            figures.panel(axis, item.time, item.torque[:, [k]], (label,), style=style, colours=(colour,))
        figures.dress(axis, title=MOTOR_LABELS[k], xlabel="time [s]", ylabel="" if k else "torque [N·m]")
        figures.shade(axis, 0.0, 1.0, "force acts")
        axis.margins(y=0.1)
        if k == 0:
            figures.legend_below(figure, axis)
    return figure


def _draw_paths(paths: list[tuple[str, np.ndarray]], title: str) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(10.5, 6.6, title=title)
    figures.path_views(figure, paths)
    return figure


def _draw_gait_foot(here: Run) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(11.5, 3.7)
    rows = here.time <= gait().duration + 1e-9
    z0 = np.array([0.0, 0.0, here.position[0, 2]])
    values = (1e3 * (here.position - z0), here.velocity, here.acceleration)
    units = ("position [mm]", "velocity [m/s]", "acceleration [m/s²]")
    axes = figure.subplots(1, 3, sharex=True)
    for axis, value, unit in zip(axes, values, units, strict=True):
        figures.panel(axis, here.time[rows], value[rows], ("X", "Y", "z − z(0)"), ylabel=unit, xlabel="time [s]")
        figures.shade(axis, gait().swing.duration, gait().duration, "stance")
    figures.legend_below(figure, axes[0])
    return figure


def _draw_fig19(printed: Run, centred: Run) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(10.5, 7.4)
    axes = figure.subplots(3, 1, sharex=True)
    cycle = gait()
    for k, axis in enumerate(axes):
        small = np.abs(printed.torque[:, k]).max() < 1e-3
        for item, label, style, colour in (
            (printed, "Y from 0 to 0.1 m (printed)", "-", figures.COLOURS[0]),
            (centred, "Y from −0.05 to 0.05 m", "--", figures.COLOURS[1]),
        ):
            # The very first sample still stands on the ground; its jump would only look like an axis.
            torque = (1e6 if small else 1.0) * item.torque[1:, [k]]
            figures.panel(axis, item.time[1:], torque, (label,), style=style, colours=(colour,))
        figures.dress(axis, ylabel=f"{MOTOR_LABELS[k]} [{'µN·m' if small else 'N·m'}]")
        for start in np.arange(cycle.swing.duration, printed.time[-1], cycle.duration):
            figures.shade(axis, start, start + cycle.stance.duration, "" if k else "stance", above=True)
    axes[-1].set_xlabel("time [s]", fontsize=9.5)
    figures.legend_below(figure, axes[0])
    figure.align_ylabels(axes)
    return figure


def _columns(axes: Any, titles: tuple[str, ...]) -> None:
    """Titles and legends of a grid of panels with one kind of lines a column."""
    for column, title in enumerate(titles):
        axes[0, column].set_title(title, fontsize=11, loc="left", fontweight="bold")
        axes[-1, column].set_xlabel("time [s]", fontsize=9.5)
        axes[-1, column].legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=3, frameon=False, fontsize=9.5, handlelength=2.6
        )


# Text and tables.


def sections(context: Context) -> tuple[Section, ...]:
    """What the paper simulated and measured, computed beside the numbers that it reports."""
    return (_section_51(context), _section_52(context), _section_fig11(context), _section_53(context))


def _rows(place: str, here: Run, other: Run) -> list[tuple[str, ...]]:
    """Position, velocity and acceleration of the foot by two derivations, beside what is reported."""
    return [
        _compare(place, quantity, 1e3 * first, 1e3 * second, unit)
        for quantity, first, second, unit in (
            ("position", here.position, other.position, "mm"),
            ("velocity", here.velocity, other.velocity, "mm/s"),
            ("acceleration", here.acceleration, other.acceleration, "mm/s²"),
        )
    ]


def _section_51(context: Context) -> Section:
    here, other = ik_run(context), ik_run(context, "pinocchio")
    rows = _rows("Fig. 9", here, other)
    windows = [
        f"{label}: {', '.join(_window_text(window) for window in height_windows(context, sign)) or 'none'}"
        for label, sign in (("Z lifts the foot (P_z = z0 − Z)", "up"), ("Z taken literally (P_z = z0 + Z)", "literal"))
    ]
    (window,) = height_windows(context)
    return Section(
        "inverse-kinematics",
        "Inverse kinematics along (51)",
        (
            "The paper gives no height z0 and no T. Its numbers fit T = 5 s only. Heights at which the whole path lies "
            f"within the limits: {'; '.join(windows)}. The lower end is set by {window.lower_reason} at "
            f"{window.lower_time:.2f} s, the upper one by {window.upper_reason} at {window.upper_time:.2f} s. The "
            f"straight pose, 0.5 m, is {'not ' if 0.5 not in window else ''}one of them; here z0 = {Z0:g} m.",
            "The last columns hold what the paper reports between theory and its multibody program, and the full value "
            "that error and share imply, with the rounding of both.",
        ),
        _COMPARE_HEADER,
        tuple(rows),
        ("fig9", "fig14"),
        "Position: span of each coordinate, norm of the displacement; velocity and acceleration: peaks. Fits: which of "
        "the seven candidates lie in the implied range. Closed form − numeric: largest difference "
        "of the two derivations.",
    )


def _section_52(context: Context) -> Section:
    rows = []
    for degrees in (25.0, 45.0):
        here, other = fk_run(context, degrees), fk_run(context, degrees, "pinocchio")
        rows += [(f"{row[0]}, γ to {degrees:g}°", *row[1:]) for row in _rows("Fig. 10", here, other)]
    position = fk_run(context).position
    t1 = round(RATE)
    return Section(
        "forward-kinematics",
        "Forward kinematics along (52)",
        (
            f"At 1 s the foot is at ({', '.join(f'{x:.6f}' for x in position[t1])}) m with the printed amplitude, 25°. "
            "The motion starts with a non-zero speed, and γ < 0 for half of it; the foot does not notice, because (11) "
            "is even in γ: inverse kinematics of this path returns |γ|.",
            "At 45° the span of Z is the full value that the experiment's 1.7 mm and 1.9 % imply (Fig. 17). That does "
            "not prove which amplitude was run; both are shown.",
        ),
        _COMPARE_HEADER,
        tuple(rows),
        ("fig10", "fig16"),
        "Position: span of each coordinate, norm of the displacement; velocity and acceleration: peaks. Fits: which of "
        "the seven candidates lie in the implied range. Closed form − numeric: largest difference "
        "of the two derivations.",
    )


def _section_fig11(context: Context) -> Section:
    rows = []
    for degrees in (25.0, 45.0):
        ours, printed = (fig11(context, sign, degrees) for sign in ("environment", "printed"))
        for k, name in enumerate(MOTORS):
            reported = REPORTED["Fig. 11", name]
            low, high = reported.reference or (math.nan, math.nan)
            rows.append(
                (
                    f"{MOTOR_LABELS[k]}, γ to {degrees:g}°",
                    f"{_peak(ours.torque)[k]:.3f} N·m",
                    f"{_peak(printed.torque)[k]:.3f} N·m",
                    f"{_error(ours.torque[:, k], printed.torque[:, k]):.3f} N·m",
                    f"{reported.error} {reported.unit}, {reported.percent} %",
                    f"{1e-3 * low:.2f} to {1e-3 * high:.2f} N·m",
                )
            )
    start, end = foot_force_torque(context, 0.0), foot_force_torque(context, 1.0)
    return Section(
        "dynamics",
        "Torques with a force on the foot, Fig. 11",
        (
            "A force that the environment applies to the foot lowers what the motors must give by JᵀF; (49)-(50) add "
            "it. JᵀF depends on lengths only: for (α, β, γ) it is "
            f"({', '.join(f'{x + 0.0:.4f}' for x in start)}) N·m at 0 s and ({', '.join(f'{x:.4f}' for x in end)}) N·m "
            "at 1 s. At 0 s the leg is straight, and M3 does not feel the force at all.",
            "Everything else depends on masses that the paper does not give; the shipped leg's are assumed and stated "
            "in its parameters, and none was chosen to match. The inertial share of these torques is at most "
            f"{1e3 * _peak(_inertial(context)).max():.0f} mN·m.",
        ),
        ("motor", "peak, corrected", "peak, as printed", "largest change", "paper: error, share", "implied full value"),
        tuple(rows),
        ("fig11", "fig11_sign"),
        "Implied full value: the error divided by its share, with the rounding of both.",
    )


def _section_53(context: Context) -> Section:
    rows = []
    for start in STEP_STARTS:
        here, bare = gait_run(context, start), gait_run(context, start, 0.0)
        stance = gait(start).in_stance(here.time)
        label = f"{start:g} to {start + 0.1:g} m"
        for k, motor in enumerate(MOTOR_LABELS):
            rows.append(
                (
                    f"{motor}, Y {label}",
                    f"{_peak(here.torque[~stance])[k]:.3f} N·m",
                    f"{_peak(bare.torque[stance])[k]:.3f} N·m",
                    f"{_peak(here.torque[stance])[k]:.3f} N·m",
                    f"{1e3 * _peak(here.torque[stance] - bare.torque[stance])[k] / SUPPORT_LOAD:.1f} mN·m",
                    _reported_gait(k),
                )
            )
    centred, printed = inferred_load(context, 0.05), inferred_load(context, 0.1)
    foot = gait_run(context)
    return Section(
        "gait",
        "The gait (53), swing and stance, Fig. 19",
        (
            f"The foot moves at up to {_peak(foot.velocity)[1]:.4f} m/s along Y and {_peak(foot.velocity)[2]:.3f} m/s "
            f"along Z. Assumed: z0 = {Z0:g} m, a stance that mirrors the swing with H = 0, and a vertical load of "
            f"{SUPPORT_LOAD:g} N during stance, because the only foot load that the paper prints has that size along "
            "Z. The torques are linear in the load: the table gives the change per newton.",
            "Inference, used nowhere: divided by their shares, the errors of M2 and M3 imply peaks of "
            f"{REPORTED['Fig. 19', 'M2'].implied:.2f} and {REPORTED['Fig. 19', 'M3'].implied:.2f} N·m. A massless leg "
            f"at rest, its step centred under the hip, has both with {centred.load:.1f} N at z0 = {centred.height:.3f} "
            f"m. With Y from 0 to 0.1 m the load would be {printed.load:.1f} N, but then sin γ = {printed.sine:.3f}"
            f"{', which no pose has' if printed.sine > 1.0 else ''}.",
        ),
        (
            "motor",
            "swing, peak",
            "stance, no load",
            f"stance, {SUPPORT_LOAD:g} N",
            "per newton",
            "paper: error, implied peak",
        ),
        tuple(rows),
        ("fig19", "fig19_foot"),
        "The torques jump where the load sets in and ends; there the paper saw its largest deviations.",
    )


def _reported_gait(k: int) -> str:
    reported = REPORTED["Fig. 19", MOTORS[k]]
    if not reported.percent:
        return f"{reported.error} {reported.unit}, –"
    return f"{reported.error} {reported.unit}, {reported.implied:.2f} {reported.unit}"


_COMPARE_HEADER = (
    "",
    "X, Y, Z",
    "peak of the norm",
    "closed form − numeric",
    "paper: error, share",
    "implied full value",
    "fits",
)


def _compare(place: str, quantity: str, values: np.ndarray, others: np.ndarray, unit: str) -> tuple[str, ...]:
    """A row of a quantity (T, 3) in mm, by the closed form and by the numeric route."""
    reported = REPORTED[place, quantity]
    scale = 1e-3 if reported.unit.startswith("µ") else 1.0
    low, high = (scale * x for x in reported.reference or (math.nan, math.nan))
    position = quantity == "position"
    shown = _span(values) if position else _peak(values)
    full = candidates(values - values[0] if position else values)
    fits = [name for name, value in full.items() if low <= value <= high]
    return (
        quantity,
        f"{', '.join(f'{value:.1f}' for value in shown)} {unit}",
        f"{full['peak of the norm']:.1f} {unit}",
        f"{1e-3 * _error(values, others):.0e} {unit.replace('mm', 'm')}",
        f"{reported.error} {reported.unit}, {reported.percent} %",
        f"{low:.0f} to {high:.0f} {unit}",
        ", ".join(fits) or "none",
    )
