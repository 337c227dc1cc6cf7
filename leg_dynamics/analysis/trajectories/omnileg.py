"""Motions of the OmniLeg in Xu et al. 2025."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from leg_dynamics.analysis.trajectories.trajectory import Trajectory, sample_times

__all__ = ["TRAJECTORIES", "omnileg_eq52"]


def omnileg_eq52(
    duration: float | None = None,
    rate: float = 1000.0,
    *,
    gamma_amplitude: float = math.radians(25.0),
    name: str = "eq52",
) -> Trajectory:
    """Sample Xu et al. 2025 eq. (52): all three motors follow sin(pi t / 3); derivatives are exact.

    Alpha and beta have the amplitude 30 deg, gamma has 25 deg as printed (one reported error of the paper fits
    45 deg better). The motion starts with a non-zero speed, and gamma is negative, outside the leg's limits, for
    3 s < t < 6 s.

    Parameters
    ----------
    duration : float, optional
        s; 2 as in the paper's dynamics where not given, 6 is one period.
    rate : float
        Samples a second.
    gamma_amplitude : float
        rad.
    name : str
        Name of the trajectory.

    Returns
    -------
    Trajectory
        Coordinates (alpha, beta, gamma), rad; no force on the foot.
    """
    time = sample_times(2.0 if duration is None else duration, rate)
    omega = math.pi / 3.0
    amplitude = np.array([math.pi / 6.0, math.pi / 6.0, gamma_amplitude])
    sine, cosine = np.sin(omega * time)[:, None], np.cos(omega * time)[:, None]
    return Trajectory(
        time=time,
        q=amplitude * sine,  # (52)
        v=amplitude * omega * cosine,
        a=0.0 - amplitude * omega**2 * sine,  # no -0 in tables
        name=name,
    )


TRAJECTORIES = {
    "eq52": omnileg_eq52,
    "eq52_gamma45": partial(omnileg_eq52, gamma_amplitude=math.radians(45.0), name="eq52_gamma45"),
}
