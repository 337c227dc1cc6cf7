"""The leg simulated by a multibody program, MuJoCo, beside the theory; the paper did the same with its own.

As there, the motors' motion is prescribed, and the foot's position and the motors' torques are measured. Columns of
torques are in the paper's order M1, M2, M3: (beta, alpha, gamma). These runs test this project, not the paper: they are
checks, with a tolerance of their own, and no verdicts. MuJoCo is the optional extra ``mujoco``; without it they are
not run, and say so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.description.mjcf import has_mujoco
from leg_dynamics.papers.framework import Check, Context, Plot, Section
from leg_dynamics.papers.omnileg.reported import (
    FORCE_ENDS,
    MOTOR_COLUMNS,
    MOTOR_LABELS,
    REPORTED,
    errors,
    foot_force,
    shares,
)
from leg_dynamics.verification.multibody import Multibody, Solver

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from leg_dynamics.analysis.trajectories import Trajectory

__all__ = [
    "CHECKS",
    "LEAD",
    "SOLVER",
    "Comparison",
    "available",
    "compare",
    "finer",
    "plots",
    "scenario",
    "sections",
    "settings",
]

SOLVER = Solver(timestep=1e-3, time_constant=2e-3, compliance=1e-4)
"""Where softness and time step cost about the same; see `settings`."""
LEAD = 0.02
"""s of settling before time 0: ten time constants of the loops."""
STATES = 100
"""Closed states in which the terms are compared without any simulation."""

FOOT_TOLERANCE = 1e-6
"""m; a fortieth of what the paper reports, and some sixteen times what the softness of the loops costs here."""
TORQUE_TOLERANCE = 1e-4
"""N·m; a fifteenth of the least that the paper reports."""

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

PLACES = {"(51)": "Fig. 9", "(52)": "Fig. 10", "Fig. 11": "Fig. 11"}
"""Where the paper reports on each simulated motion."""


def available() -> bool:
    """Whether MuJoCo can be used: a package that is found may still fail to load, for want of a system library."""
    if not has_mujoco():
        return False
    try:
        import mujoco  # noqa: F401
    except Exception:  # whatever a broken installation raises, nothing can be simulated with it
        return False
    return True


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
    full : tuple of float
        Full values in the theory: largest span of a coordinate, m; peaks of velocity and acceleration, m/s, m/s².
    opening : float
        Largest gap of a loop constraint, m or rad.
    solver : Solver
    """

    time: np.ndarray
    foot: np.ndarray
    foot_theory: np.ndarray
    torque: np.ndarray
    torque_theory: np.ndarray
    full: tuple[float, float, float]
    opening: float
    solver: Solver

    @property
    def position_error(self) -> float:
        """Largest distance between simulated and theoretical foot, m."""
        return float(np.linalg.norm(self.foot - self.foot_theory, axis=1).max())

    @property
    def velocity_error(self) -> float:
        """Largest difference of the foot's velocity, m/s.

        The simulation gives positions, its rates are their central differences; so are those of the theory here, or the
        formula of the differences would be measured instead of the simulation.
        """
        change = self.foot - self.foot_theory
        rate = (change[2:] - change[:-2]) / (2.0 * self.solver.timestep)
        return float(np.linalg.norm(rate, axis=1).max())

    @property
    def acceleration_error(self) -> float:
        """Largest difference of the foot's acceleration, m/s²; both by second differences."""
        change = self.foot - self.foot_theory
        second = (change[2:] - 2.0 * change[1:-1] + change[:-2]) / self.solver.timestep**2
        return float(np.linalg.norm(second, axis=1).max())

    @property
    def foot_shares(self) -> tuple[float, float, float]:
        """The three errors of the foot in percent of `full`."""
        found = (self.position_error, self.velocity_error, self.acceleration_error)
        position, velocity, acceleration = (
            100.0 * error / value for error, value in zip(found, self.full, strict=True)
        )
        return position, velocity, acceleration

    @property
    def torque_error(self) -> np.ndarray:
        """Largest torque difference of each motor, N·m, shape (3,)."""
        error: np.ndarray = np.abs(self.torque - self.torque_theory).max(axis=0)
        return error

    @property
    def torque_error_time(self) -> np.ndarray:
        """When that happens, s, shape (3,)."""
        when: np.ndarray = self.time[np.abs(self.torque - self.torque_theory).argmax(axis=0)]
        return when

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
    return motion.with_foot_force(foot_force(motion.time))


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
    theory = leg.foot_position(motion.q)
    rates = leg.foot_velocity(motion.q, motion.v), leg.foot_acceleration(motion.q, motion.v, motion.a)
    peaks = [float(np.linalg.norm(values, axis=1).max()) for values in rates]
    return Comparison(
        run.time,
        run.foot,
        theory,
        run.force[:, MOTOR_COLUMNS],
        leg.generalized_force(motion.q, motion.v, motion.a, foot_force=motion.foot_force)[:, MOTOR_COLUMNS],
        (float(np.ptp(theory, axis=0).max()), peaks[0], peaks[1]),
        run.opening,
        solver,
    )


def _run(context: Context, name: str) -> Comparison:
    return context.once(f"multibody {name}", lambda: compare(context, scenario(context, name, SOLVER.timestep)))


def finer(context: Context, name: str) -> Comparison:
    """The same motion with half the time step, and loops twice as quick."""
    solver = replace(SOLVER, timestep=0.5 * SOLVER.timestep, time_constant=0.5 * SOLVER.time_constant)
    return context.once(
        f"multibody {name}, half the step", lambda: compare(context, scenario(context, name, solver.timestep), solver)
    )


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


def terms_agree(context: Context) -> Check:
    """Torques from MuJoCo's mass matrix, bias and constraint Jacobian in closed states, without simulation."""
    count = min(STATES, len(context.q))
    name, of = "torques from a multibody program's terms", f"{count} random closed states with a force on the foot"
    if not available():
        return Check(name, None, 1e-9, "N·m", f"{of}; {NEEDED}")
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


NEEDED = "needs the extra mujoco"


def _foot_check(context: Context, name: str) -> Check:
    title, of = f"simulated foot along {name}", "largest distance of simulated and theoretical foot"
    if not available():
        return Check(title, None, FOOT_TOLERANCE, "m", f"{of}; {NEEDED}")
    return Check(title, _run(context, name).position_error, FOOT_TOLERANCE, "m", of)


def simulated_foot_along_51(context: Context) -> Check:
    """The simulation of (51) against the theory."""
    return _foot_check(context, "(51)")


def simulated_foot_along_52(context: Context) -> Check:
    """The simulation of (52) against the theory."""
    return _foot_check(context, "(52)")


def simulated_torques_agree(context: Context) -> Check:
    """The simulation of Fig. 11 against the theory."""
    title, of = "simulated torques", "Fig. 11, largest difference of simulated and theoretical torque"
    if not available():
        return Check(title, None, TORQUE_TOLERANCE, "N·m", f"{of}; {NEEDED}")
    return Check(title, _run(context, "Fig. 11").torque_error.max(), TORQUE_TOLERANCE, "N·m", of)


CHECKS = (terms_agree, simulated_foot_along_51, simulated_foot_along_52, simulated_torques_agree)


def plots(context: Context) -> tuple[Plot, ...]:
    """Overlays of simulation and theory; none without MuJoCo."""
    if not available():
        return ()
    overlays = (("(51)", "multibody_eq51"), ("(52)", "multibody_eq52"))
    foot = tuple(
        Plot(
            file,
            f"Foot along {name}, simulated and in theory",
            "Lines: theory; circles: MuJoCo with prescribed motors. Below: distance between the two. z is given "
            "from its first value.",
            lambda name=name: _foot_figure(_run(context, name)),  # type: ignore[misc]
            (PLACES[name], name),
        )
        for name, file in overlays
    )
    found = _run(context, "Fig. 11")
    when = ", ".join(
        f"{label} at {time:.2f} s" for label, time in zip(MOTOR_LABELS, found.torque_error_time, strict=True)
    )
    torque = Plot(
        "multibody_fig11",
        "Torques of Fig. 11, simulated and in theory",
        "Lines: theory with the exact transmission; circles: MuJoCo with prescribed motors. Below: the difference, "
        f"largest for {when}; where the force ends, at {FORCE_ENDS:g} s, the loops answer. Assumed masses.",
        lambda: _torque_figure(_run(context, "Fig. 11")),
        ("Fig. 11",),
    )
    return (*foot, torque)


def sections(context: Context) -> tuple[Section, ...]:
    """How the simulation was set up, what it gave beside the paper's own, and what limits it."""
    if not available():
        text = "MuJoCo cannot be used here, so nothing was simulated: install leg-dynamics[mujoco] and run again."
        return (Section("multibody", "The multibody run", (text,)),)
    return (_results(context), _limits(context))


QUANTITIES = (("position", "µm", 1e6), ("velocity", "µm/s", 1e6), ("acceleration", "mm/s²", 1e3))


def _foot_errors(found: Comparison) -> tuple[float, float, float]:
    return found.position_error, found.velocity_error, found.acceleration_error


def _results(context: Context) -> Section:
    rows, shrink = [], []
    for name in ("(51)", "(52)"):
        found, half = _run(context, name), finer(context, name)
        for k, (quantity, unit, factor) in enumerate(QUANTITIES):
            reported = REPORTED[PLACES[name], quantity]
            ours, less = factor * _foot_errors(found)[k], factor * _foot_errors(half)[k]
            shrink.append(less / ours)
            rows.append(
                (
                    f"foot along {name}, {quantity}",
                    f"{ours:.2g} {unit}",
                    f"{found.foot_shares[k]:.2g} %",
                    f"{less:.2g} {unit}",
                    f"{reported.error} {reported.unit}",
                    f"{reported.percent} %",
                )
            )
    found = _run(context, "Fig. 11")
    half_torque = finer(context, "Fig. 11").torque_error
    for k, motor in enumerate(MOTOR_LABELS):
        shrink.append(half_torque[k] / found.torque_error[k])
        rows.append(
            (
                f"torque of {motor}, Fig. 11",
                f"{1e3 * found.torque_error[k]:.2g} mN·m",
                f"{found.torque_share[k]:.2g} %",
                f"{1e3 * half_torque[k]:.2g} mN·m",
                f"{errors('Fig. 11')[k]:g} mN·m",
                f"{shares('Fig. 11')[k]:g} %",
            )
        )
    smaller = sum(ratio < 1.0 for ratio in shrink)
    ratios = f"{min(shrink):.2g} to {max(shrink):.2g}"
    if smaller == len(shrink):
        verdict = f"All {len(shrink)} errors shrink, to {ratios} of what they were: they belong to the solver."
    else:
        verdict = f"{smaller} of {len(shrink)} errors shrink; they become {ratios} of what they were."
    paragraphs = (
        "The paper checked its theory against a multibody program and reports largest errors with percentages; these "
        "are the same errors of this project's theory against MuJoCo. Full values here are the largest span of a "
        "coordinate for positions and the peak of the norm for rates, and each motor's peak for torques; the paper "
        "does not name its own. Velocities and accelerations are differences of positions at the time steps, on both "
        "sides. The paper's differences of torque hold its simplified shaft against its program's whole model; here "
        "both have the exact transmission.",
        f"Every run was repeated with half the time step and loops twice as quick. {verdict}",
    )
    header = ("", "error here", "share", "half the step", "paper: error", "paper: share")
    return Section(
        "multibody",
        "The multibody run",
        paragraphs,
        header,
        tuple(rows),
        ("multibody_eq51", "multibody_eq52", "multibody_fig11"),
        "Largest differences of simulation and theory over the whole motion.",
    )


def _limits(context: Context) -> Section:
    solver = SOLVER
    rows = tuple(
        (
            text,
            f"{1e3 * found.solver.timestep:g}",
            f"{1e3 * found.solver.time_constant:g}",
            f"{found.solver.impedance:g}",
            f"{found.solver.compliance:g}",
            f"{1e6 * found.position_error:.2g}",
            *(f"{value:.2g}" for value in 1e3 * found.torque_error),
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
    header = ("loops", "step, ms", "time constant, ms", "impedance", "compliance", "foot, µm")
    return Section(
        "multibody-limits",
        "What limits the multibody run",
        paragraphs,
        (*header, *(f"{motor}, mN·m" for motor in MOTOR_LABELS)),
        rows,
        (),
        "Largest differences to the theory while the force of Fig. 11 ends, 0.9 s to 1.1 s.",
    )


def _circles(count: int) -> slice:
    return slice(None, None, max(1, count // 30))


def _foot_figure(found: Comparison) -> Drawing:
    from leg_dynamics.papers import figures

    figure = figures.drawing(9.0, 5.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    start = found.foot_theory[0] * (0.0, 0.0, 1.0)
    figures.panel(upper, found.time, 1e3 * (found.foot_theory - start), ("X", "Y", "z − z(0)"), ylabel="position [mm]")
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
    figures.panel(upper, found.time, found.torque_theory, MOTOR_LABELS, ylabel="torque [N·m]")
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
        lower,
        found.time,
        1e3 * (found.torque - found.torque_theory),
        MOTOR_LABELS,
        ylabel="difference [mN·m]",
        width=1.1,
    )
    lower.set_xlabel("time [s]")
    figures.shade(upper, 0.0, FORCE_ENDS, "force on foot")
    figures.legend_below(figure, upper)
    return figure
