"""A foot cycle for Figs 9 and 10, of which the paper gives nothing but the word tripod: everything here is assumed.

One leg, duty factor 1/2, the body at constant velocity, the foot's path in the plane y = 0 through the initial pose
with continuous acceleration. Of a tripod gait's two groups one is in stance while the other swings, so that one leg's
curves are those of all, half a period apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leg_dynamics.analysis.trajectories import gait_cycle
from leg_dynamics.papers.framework import Context

__all__ = ["ASSUMED", "SUPPORT", "Walk", "walk"]

Array = np.ndarray

ASSUMED = ((4.0, 0.4, 0.1), (2.0, 0.3, 0.1), (2.0, 0.4, 0.1), (2.0, 0.8, 0.15))
"""Assumed: period (s), stride (m) and clearance (m)."""

SUPPORT = 445.0
"""N; assumed: a third of a robot of 136 kg on each foot in stance."""

SAMPLES = 801


@dataclass(frozen=True)
class Walk:
    """One period of one leg: swing, then stance.

    Attributes
    ----------
    period, stride, clearance : float
        s, m, m.
    time : (T,) array
    foot, q, rates, force : (T, 3) array
        m, m, m/s, and forces of the struts, N.
    stance : (T,) array of bool
    """

    period: float
    stride: float
    clearance: float
    time: Array
    foot: Array
    q: Array
    rates: Array
    force: Array
    stance: Array

    @property
    def speed(self) -> float:
        """Of the body, m/s."""
        return 2.0 * self.stride / self.period


def walk(context: Context, period: float, stride: float, clearance: float) -> Walk:
    """Rates and forces of the struts over one period."""

    def compute() -> Walk:
        leg, h = context.leg, context.leg.parameters["h"].value
        cycle = gait_cycle(
            (-0.5 * stride, 0.0, h),
            (stride, 0.0, 0.0),
            (0.0, 0.0, -clearance),
            0.5 * period,
            stance="uniform",
        )
        time = np.linspace(0.0, period, SAMPLES)
        curve = cycle.curve
        p, v, a = (np.asarray(curve.value(time, derivative)) for derivative in (0, 1, 2))
        q = leg.inverse_kinematics(p, limits="ignore")
        J = leg.jacobian(q)
        rates = np.linalg.solve(J, v[..., None])[..., 0]
        drift = np.einsum("nij,nj->ni", leg.jacobian_derivative(q, rates), rates)
        accelerations = np.linalg.solve(J, (a - drift)[..., None])[..., 0]
        load = cycle.support_force(time, (0.0, 0.0, -SUPPORT))
        force = leg.torque(q, rates, accelerations, load)
        stance = np.asarray(cycle.in_stance(time))
        return Walk(period, stride, clearance, time, p, q, rates, force, stance)

    result: Walk = context.once(f"hexapod: walk {period} {stride} {clearance}", compute)
    return result
