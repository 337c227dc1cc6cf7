"""A free swing: what total energy gains or loses on the way is an inconsistency of the dynamics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leg_dynamics.errors import RowError
from leg_dynamics.leg import Leg

__all__ = ["Swing", "energy_drift", "free_swing"]

SECONDS = 5.0
TOLERANCE = 1e-12
"""Relative and absolute tolerance of the integrator, whose share of the energy drift stays near 1e-10; at 1e-13
rounding triples the evaluations and gains nothing."""


@dataclass(frozen=True)
class Swing:
    """A motion at the integrator's steps: `time` (k,) s, `q` and `v` (k, n); `stopped` says why it ended early."""

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    stopped: str = ""

    @property
    def seconds(self) -> float:
        """How long the motion lasts."""
        return float(self.time[-1])

    def until(self, seconds: float) -> Swing:
        """The part up to a time, at least the start."""
        rows = self.time <= max(seconds, 0.0)
        return Swing(self.time[rows], self.q[rows], self.v[rows], self.stopped)

    def thinned(self, count: int) -> Swing:
        """About `count` of the steps, evenly chosen, first and last among them."""
        rows = np.unique(np.linspace(0, len(self.time) - 1, count).round().astype(np.intp))
        return Swing(self.time[rows], self.q[rows], self.v[rows], self.stopped)


def _friction(leg: Leg, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The part of the actuator efforts that changes sign with the velocity."""
    still = np.zeros_like(q)
    return 0.5 * (leg.torque(q, v, still) - leg.torque(q, -v, still))


def free_swing(leg: Leg, q0: np.ndarray, v0: np.ndarray, seconds: float = SECONDS) -> Swing:
    """Motion without actuator efforts, by LSODA's Adams methods.

    Where joints have damping or friction and there is one actuator a coordinate, the actuators
    compensate it, so that energy is conserved all the same.

    Parameters
    ----------
    leg : Leg
    q0, v0 : (n,) array
        Start, rad or m, and rate.
    seconds : float

    Returns
    -------
    Swing
        Shorter than `seconds` where the motion runs into a pose that the leg cannot take.
    """
    from scipy.integrate import LSODA

    n = len(leg.joint_names)
    idle = np.zeros(len(leg.actuator_names))
    damped = [joint for joint in leg.description.joints if joint.damping or joint.friction]
    compensated = bool(damped) and len(leg.actuator_names) == n

    def field(_: float, state: np.ndarray) -> np.ndarray:
        q, v = state[:n], state[n:]
        tau = _friction(leg, q, v) if compensated else idle
        return np.concatenate([v, leg.acceleration(q, v, tau)])

    time, states = [0.0], [np.concatenate([q0, v0])]
    stopped = ""
    try:
        solver = LSODA(field, 0.0, states[0], seconds, rtol=TOLERANCE, atol=TOLERANCE)
        while solver.status == "running":
            stopped = solver.step() or ""
            if solver.status != "failed":
                time.append(solver.t)
                states.append(solver.y.copy())
    except RowError as error:
        stopped = error.message
    motion = np.array(states)
    return Swing(np.array(time), motion[:, :n], motion[:, n:], stopped)


def energy_drift(leg: Leg, swing: Swing) -> np.ndarray:
    """Change of total energy since the start, relative to the largest kinetic energy, (k,); NaN for no motion."""
    kinetic = leg.kinetic_energy(swing.q, swing.v, on_error="nan")
    total = kinetic + leg.potential_energy(swing.q, on_error="nan")
    largest = float(kinetic.max())
    moved = len(total) > 1 and largest > 0.0
    return np.abs(total - total[0]) / largest if moved else np.full(len(total), np.nan)
