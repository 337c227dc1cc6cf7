"""The leg simulated by a multibody program, MuJoCo, beside the theory; the paper did the same with its own.

As there, the motors' motion is prescribed, and the foot's position and the motors' torques are measured. Columns of
torques are in the paper's order M1, M2, M3: (beta, alpha, gamma). MuJoCo is the optional extra ``mujoco``; without it
the verdicts say so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.description.mjcf import has_mujoco
from leg_dynamics.papers.framework import Check, Context, Figure, Plot, Section, Status, Verdict
from leg_dynamics.verification.multibody import Multibody, Solver

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from leg_dynamics.analysis.trajectories import Trajectory

__all__ = ["CHECKS", "LEAD", "SOLVER", "VERDICTS", "Comparison", "compare", "plots", "scenario", "sections", "settings"]

MOTORS = ("M1", "M2", "M3")
COLUMNS = [1, 0, 2]
"""Of (alpha, beta, gamma), in the order of the motors."""

SOLVER = Solver(timestep=1e-3, time_constant=2e-3, compliance=1e-4)
"""Where softness and time step cost about the same; see `settings`."""
LEAD = 0.02
"""s of settling before time 0: ten time constants of the loops."""
STATES = 100
"""Closed states in which the terms are compared without any simulation."""

SOLVERS = (
    ("MuJoCo's own impedance, loops as quick as the step allows", Solver(1e-3, 2e-3, impedance=0.95)),
    ("hardest impedance that MuJoCo takes", Solver(1e-3, 2e-3)),
    ("the same, integrator implicitfast", Solver(1e-3, 2e-3, integrator="implicitfast")),
    ("the same, loops slower", Solver(1e-3, 2e-2)),
    ("the same, loops and step quicker", Solver(2e-4, 4e-4)),
    ("less compliance", Solver(1e-3, 2e-3, compliance=1e-2)),
    ("still less: used here", SOLVER),
    ("so little that rounding shows", Solver(1e-3, 2e-3, compliance=1e-6)),
    ("as used here, loops and step quicker", Solver(2e-4, 4e-4, compliance=1e-4)),
)

REPORTED = {
    "(51)": (42.5, 74.0, 1.5),
    "(52)": (45.0, 63.0, 2.89),
}
"""The paper's largest errors between theory and its program: um, um/s, mm/s² (section 4)."""
REPORTED_TORQUE = np.array([2.1, 1.5, 5.2])
"""mN·m, Fig. 11, M1, M2, M3."""
FORCE = (0.0, -20.0, 20.0)


@dataclass(frozen=True, eq=False)
class Comparison:
    """One run of the multibody program beside the theory, at the T times of its steps.

    Attributes
    ----------
    time : ndarray, shape (T,)
        s.
    foot, foot_theory : ndarray, shape (T, 3)
        m, in the hip frame.
    torque, torque_theory : ndarray, shape (T, 3)
        N·m, M1, M2, M3.
    velocity_error : float
        Largest difference of the foot's velocity, m/s.
    acceleration_error : float
        Largest difference of the foot's acceleration, m/s².
    opening : float
        Largest gap of a loop constraint, m or rad.
    solver : Solver
    """

    time: np.ndarray
    foot: np.ndarray
    foot_theory: np.ndarray
    torque: np.ndarray
    torque_theory: np.ndarray
    velocity_error: float
    acceleration_error: float
    opening: float
    solver: Solver

    @property
    def position_error(self) -> float:
        """Largest distance between simulated and theoretical foot, m."""
        return float(np.linalg.norm(self.foot - self.foot_theory, axis=1).max())

    @property
    def torque_error(self) -> np.ndarray:
        """Largest torque difference of each motor, N·m, shape (3,)."""
        error: np.ndarray = np.abs(self.torque - self.torque_theory).max(axis=0)
        return error

    @property
    def torque_share(self) -> np.ndarray:
        """`torque_error` in percent of each motor's peak torque, shape (3,)."""
        share: np.ndarray = 100.0 * self.torque_error / np.abs(self.torque_theory).max(axis=0)
        return share


def scenario(context: Context, name: str, timestep: float, duration: float | None = None) -> Trajectory:
    """One of the paper's simulated motions: ``(51)``, ``(52)`` or ``Fig. 11``, sampled at the time steps.

    Parameters
    ----------
    context : Context
    name : str
    timestep : float
        s.
    duration : float, optional
        s; as in the paper where not given.
    """
    from leg_dynamics.analysis.trajectories import omnileg_eq51, omnileg_eq52

    rate = 1.0 / timestep
    if name == "(51)":
        return omnileg_eq51(context.leg, 5.0 if duration is None else duration, rate)
    if name == "(52)":
        return omnileg_eq52(6.0 if duration is None else duration, rate)
    motion = omnileg_eq52(2.0 if duration is None else duration, rate)
    return motion.with_foot_force(np.where(motion.time <= 1.0, 1.0, 0.0)[:, None] * FORCE)


def compare(context: Context, motion: Trajectory, solver: Solver = SOLVER) -> Comparison:
    """Drive the simulated motors along a motion sampled at the solver's time steps, and hold it against the theory.

    Parameters
    ----------
    context : Context
    motion : Trajectory
    solver : Solver

    Returns
    -------
    Comparison

    Raises
    ------
    UnsupportedError
        MuJoCo is not installed.
    """
    leg, step = context.leg, solver.timestep
    last = len(motion) - 1

    def at(time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        # Before the first and after the last sample the motion goes on with constant acceleration.
        node = min(max(round(time / step), 0), last)
        rest = time - node * step
        q, v, a = motion.q[node], motion.v[node], motion.a[node]
        if 0 <= round(time / step) <= last:
            return q, v, a
        return q + rest * v + 0.5 * rest * rest * a, v + rest * a, a

    def force(time: float) -> np.ndarray | None:
        return None if motion.foot_force is None else motion.foot_force[min(max(round(time / step), 0), last)]

    tree = {name: float(value) for name, value in leg.assemble(at(-LEAD)[0]).items()}
    run = Multibody(leg.description, solver=solver).drive(at, tree, last * step, force, lead=LEAD)
    inner = slice(1, -1)
    velocity = run.foot_velocity - leg.foot_velocity(motion.q[inner], motion.v[inner])
    acceleration = run.foot_acceleration - leg.foot_acceleration(motion.q[inner], motion.v[inner], motion.a[inner])
    return Comparison(
        run.time,
        run.foot,
        leg.foot_position(motion.q),
        run.force[:, COLUMNS],
        leg.generalized_force(motion.q, motion.v, motion.a, foot_force=motion.foot_force)[:, COLUMNS],
        float(np.linalg.norm(velocity, axis=1).max()),
        float(np.linalg.norm(acceleration, axis=1).max()),
        run.opening,
        solver,
    )


def _run(context: Context, name: str) -> Comparison:
    return context.once(f"multibody {name}", lambda: compare(context, scenario(context, name, SOLVER.timestep)))


def settings(context: Context) -> tuple[tuple[str, Comparison], ...]:
    """Fig. 11 around the end of its force, 0.9 s to 1.1 s of it, with each of several solver settings."""
    return context.once("multibody settings", lambda: _settings(context))


def _settings(context: Context) -> tuple[tuple[str, Comparison], ...]:
    from leg_dynamics.analysis.trajectories import Trajectory

    found = []
    for text, solver in SOLVERS:
        whole = scenario(context, "Fig. 11", solver.timestep)
        part = (whole.time > 0.9 - 1e-9) & (whole.time < 1.1 + 1e-9)
        assert whole.foot_force is not None
        motion = Trajectory(
            whole.time[part] - whole.time[part][0], whole.q[part], whole.v[part], whole.a[part], whole.foot_force[part]
        )
        found.append((text, compare(context, motion, solver)))
    return tuple(found)


def _missing(item: str, title: str) -> Verdict:
    return Verdict(
        item,
        "claim",
        title,
        Status.OUT_OF_REACH,
        "The multibody run was left out: the optional extra is missing; install leg-dynamics[mujoco].",
    )


def _kinematics(context: Context, name: str, item: str, title: str) -> Verdict:
    if not has_mujoco():
        return _missing(item, title)
    found, (position, velocity, acceleration) = _run(context, name), REPORTED[name]
    errors = 1e6 * found.position_error, 1e6 * found.velocity_error, 1e3 * found.acceleration_error
    agrees = errors[0] <= position and errors[1] <= velocity and errors[2] <= acceleration
    motion = f"{name}, {found.time[-1]:g} s"
    return Verdict(
        item,
        "claim",
        title,
        Status.CONFIRMED if agrees else Status.CORRECTED,
        f"The simulated foot stays within {errors[0]:.2g} µm, {errors[1]:.2g} µm/s and {errors[2]:.2g} mm/s² of the "
        f"theory; the paper reports {position:g} µm, {velocity:g} µm/s and {acceleration:g} mm/s² with its program. "
        "With a smaller time step ours shrink: they belong to the solver, not to the model.",
        (
            Figure("position", errors[0], "µm", f"largest distance of simulated and theoretical foot, {motion}"),
            Figure("velocity", errors[1], "µm/s", f"largest difference, {motion}"),
            Figure("acceleration", errors[2], "mm/s²", f"largest difference, {motion}"),
            Figure("opening of the loops", 1e6 * found.opening, "µm or µrad", f"largest constraint residual, {motion}"),
        ),
    )


def inverse_kinematics_by_simulation(context: Context) -> Verdict:
    """Foot along (51)."""
    return _kinematics(
        context, "(51)", "claim: multibody check along (51)", "Inverse kinematics agree with a multibody program"
    )


def forward_kinematics_by_simulation(context: Context) -> Verdict:
    """Foot along (52)."""
    return _kinematics(
        context, "(52)", "claim: multibody check along (52)", "Forward kinematics agree with a multibody program"
    )


def torques_by_simulation(context: Context) -> Verdict:
    """Torques of Fig. 11."""
    item, title = "claim: multibody check of Fig. 11", "Torques agree with a multibody program"
    if not has_mujoco():
        return _missing(item, title)
    found = _run(context, "Fig. 11")
    error, share = 1e3 * found.torque_error, found.torque_share
    agrees = bool((error <= REPORTED_TORQUE).all())
    texts = ["/".join(f"{value:.2g}" for value in values) for values in (error, REPORTED_TORQUE, share)]
    return Verdict(
        item,
        "claim",
        title,
        Status.CONFIRMED if agrees else Status.CORRECTED,
        f"With the exact transmission the simulated torques differ by {texts[0]} mN·m (M1/M2/M3, {texts[2]} % of each "
        f"peak), where the paper reports {texts[1]} mN·m; the foot stays within {1e6 * found.position_error:.2g} µm.",
        (
            *(
                Figure(f"torque error, {motor}", value, "mN·m", "largest difference of simulation and theory, Fig. 11")
                for motor, value in zip(MOTORS, error, strict=True)
            ),
            *(
                Figure(f"share of the peak, {motor}", value, "%", "the same over the motor's peak torque")
                for motor, value in zip(MOTORS, share, strict=True)
            ),
            Figure("position", 1e6 * found.position_error, "µm", "largest distance of the foot, Fig. 11"),
        ),
    )


def terms_agree(context: Context) -> Check:
    """Torques from MuJoCo's mass matrix, bias and constraint Jacobian in closed states, without simulation."""
    name, of = "torques from a multibody program's terms", f"{STATES} random closed states with a force on the foot"
    if not has_mujoco():
        return Check(f"{name} (left out: the extra mujoco is missing)", 0.0, 1e-9, "N·m", of)
    leg, bodies = context.leg, Multibody(context.leg.description)
    q, v, a = context.q[:STATES], context.v[:STATES], context.a[:STATES]
    forces = context.rng(31).uniform(-30.0, 30.0, (len(q), 3))
    theory = leg.generalized_force(q, v, a, foot_force=forces)
    worst = 0.0
    for row in range(len(q)):
        tree = {name: float(value) for name, value in leg.assemble(q[row]).items()}
        found = bodies.inverse_dynamics(tree, v[row], a[row], forces[row])
        worst = max(worst, float(np.abs(found.force - theory[row]).max()))
    return Check(name, worst, 1e-9, "N·m", of)


def simulated_torques_agree(context: Context) -> Check:
    """The simulation of Fig. 11 against the theory."""
    if not has_mujoco():
        return Check("simulated torques (left out: the extra mujoco is missing)", 0.0, 1e-4, "N·m", "Fig. 11")
    return Check("simulated torques", _run(context, "Fig. 11").torque_error.max(), 1e-4, "N·m", "Fig. 11")


VERDICTS = (inverse_kinematics_by_simulation, forward_kinematics_by_simulation, torques_by_simulation)
CHECKS = (terms_agree, simulated_torques_agree)


def plots(context: Context) -> tuple[Plot, ...]:
    """Overlays of simulation and theory; none without MuJoCo."""
    if not has_mujoco():
        return ()
    overlays = (
        ("(51)", "multibody_eq51", "claim: multibody check along (51)"),
        ("(52)", "multibody_eq52", "claim: multibody check along (52)"),
    )
    foot = tuple(
        Plot(
            file,
            f"Foot along {name}, simulated and in theory",
            "Lines: theory; circles: MuJoCo with prescribed motors. Below: distance between the two. Z is given "
            "from its first value.",
            lambda name=name: _foot_figure(_run(context, name)),  # type: ignore[misc]
            (item,),
        )
        for name, file, item in overlays
    )
    torque = Plot(
        "multibody_fig11",
        "Torques of Fig. 11, simulated and in theory",
        "Lines: theory with the exact transmission; circles: MuJoCo with prescribed motors. Below: the difference; the "
        "peak at 1 s is the loops' answer to the end of the force. Assumed masses.",
        lambda: _torque_figure(_run(context, "Fig. 11")),
        ("claim: multibody check of Fig. 11",),
    )
    return (*foot, torque)


def sections(context: Context) -> tuple[Section, ...]:
    """How the simulation was set up, and what limits it."""
    if not has_mujoco():
        text = "MuJoCo is not installed, so nothing was simulated: install leg-dynamics[mujoco] and run again."
        return (Section("multibody", "The multibody run", (text,)),)
    solver = SOLVER
    rows = tuple(
        (
            text,
            f"{1e3 * found.solver.timestep:g}",
            f"{1e3 * found.solver.time_constant:g}",
            f"{found.solver.impedance:g}",
            f"{found.solver.compliance:g}",
            f"{1e6 * found.position_error:.2g}",
            "/".join(f"{value:.2g}" for value in 1e3 * found.torque_error),
        )
        for text, found in settings(context)
    )
    paragraphs = (
        "The model is built from the same URDF+ file: 22 hinges, each cut hinge as two coincident points, each gear "
        "pair as a joint equality. The motors' angles are prescribed: in each time step their torques are those that "
        "put them where the motion has them one step later; all else follows from MuJoCo's forces. Newton's solver, "
        f"integrator {solver.integrator}, step {1e3 * solver.timestep:g} ms, solref ({solver.time_constant:g} s, "
        f"{solver.damping_ratio:g}), impedance {solver.impedance:g}, compliance {solver.compliance:g} of MuJoCo's "
        "estimate.",
        "Two things limit it. MuJoCo's loops are soft: a loop that carries a force opens by force times (1 - d) / d "
        "times the inverse inertia over the stiffness, and the stiffness cannot exceed what the time step can follow. "
        "What is left then falls with the square of the step. The motors follow to rounding in every case.",
    )
    header = ("loops", "step, ms", "time constant, ms", "impedance", "compliance", "foot, µm", "torque M1/M2/M3, mN·m")
    return (
        Section(
            "multibody",
            "The multibody run",
            paragraphs,
            header,
            rows,
            ("multibody_eq51", "multibody_eq52", "multibody_fig11"),
            "Largest differences to the theory while the force of Fig. 11 ends, 0.9 s to 1.1 s.",
        ),
    )


def _circles(count: int) -> slice:
    return slice(None, None, max(1, count // 30))


def _foot_figure(found: Comparison) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(9.0, 5.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    start = found.foot_theory[0] * (0.0, 0.0, 1.0)
    figures.panel(upper, found.time, 1e3 * (found.foot_theory - start), ("X", "Y", "Z"), ylabel="position [mm]")
    every = _circles(len(found.time))
    for k in range(3):
        values = 1e3 * (found.foot - start)[every, k]
        upper.plot(
            found.time[every], values, "o", markersize=5, markerfacecolor="none", color=figures.COLOURS[k], label=None
        )
    distance = 1e6 * np.linalg.norm(found.foot - found.foot_theory, axis=1)
    lower.plot(found.time, distance, color="0.25", linewidth=1.4)
    figures.dress(lower, ylabel="distance [µm]", xlabel="time [s]")
    lower.set_ylim(bottom=0.0)
    figures.legend_below(figure, upper)
    return figure


def _torque_figure(found: Comparison) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(9.0, 5.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    figures.panel(upper, found.time, found.torque_theory, MOTORS, ylabel="torque [N·m]")
    every = _circles(len(found.time))
    for k in range(3):
        upper.plot(
            found.time[every],
            found.torque[every, k],
            "o",
            markersize=5,
            markerfacecolor="none",
            color=figures.COLOURS[k],
        )
    figures.panel(
        lower, found.time, 1e3 * (found.torque - found.torque_theory), MOTORS, ylabel="difference [mN·m]", width=1.1
    )
    lower.set_xlabel("time [s]")
    figures.shade(upper, 0.0, 1.0, "force on foot")
    figures.legend_below(figure, upper)
    return figure
