"""Motions of the OmniLeg in Xu et al. 2025."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.trajectories.gait import GaitCycle, gait_cycle, lift_profile
from leg_dynamics.analysis.trajectories.operations import concatenate
from leg_dynamics.analysis.trajectories.polynomial import PiecewisePolynomial, quintic
from leg_dynamics.analysis.trajectories.registry import FootTrajectory, follow
from leg_dynamics.analysis.trajectories.trajectory import Trajectory, sample_times
from leg_dynamics.errors import TrajectoryError

__all__ = [
    "TRAJECTORIES",
    "omnileg_eq51",
    "omnileg_eq51_path",
    "omnileg_eq52",
    "omnileg_eq53",
    "omnileg_eq53_cycle",
]

Z0 = 0.42
"""m; the paper gives no height. With this one (51) and (53) stay clear of every limit and of the straight leg."""


def omnileg_eq51_path(z0: float = Z0, *, z_sign: str = "up", duration: float = 5.0) -> PiecewisePolynomial:
    """Path of the foot in Xu et al. 2025 eq. (51): P = (X, Y, z0 - Z).

    X goes 0.1 m forth and back, Y goes 0.1 m and stays there, Z rises by 0.05 m and falls. The jerk of X jumps
    from +0.384 to -0.384 m/s³ in the middle.

    Parameters
    ----------
    z0 : float
        Height at which Z = 0, m, in the hip frame (z down); not in the paper. `feasible_offset_windows` of the path
        with z0 = 0 gives the feasible ones.
    z_sign : {"up", "literal"}
        ``up``: the foot is lifted, P_z = z0 - Z. ``literal``: Z is the coordinate, P_z = z0 + Z, which lowers it.
    duration : float
        s; T of the paper, which does not define it: its numbers fit 5 s only. Another one stretches the time.

    Returns
    -------
    PiecewisePolynomial
        m; two pieces that join with continuous acceleration.
    """
    T = arguments.positive("duration", duration, "seconds")
    height = _sign(z_sign) * 0.05
    z0 = arguments.real("z0", z0)
    half = T / 2.0
    x_forth, x_back = quintic([0.0], [0.1], half), quintic([0.1], [0.0], half)
    y = quintic([0.0], [0.1], T).coefficients[:, 0, 0]
    z = height * lift_profile(T)
    z[-1] += z0
    pieces = []
    for x, shift in ((x_forth, 0.0), (x_back, half)):
        columns = [x.coefficients[:, 0, 0], _shifted(y, shift), _shifted(z, shift)]
        coefficients = np.stack([np.pad(column, (7 - column.size, 0)) for column in columns], axis=-1)
        pieces.append(PiecewisePolynomial([shift, shift + half], coefficients[:, None, :]))  # type: ignore[arg-type]
    return concatenate(*pieces, continuity="acceleration", name="eq51")  # (51)


def omnileg_eq51(
    leg: Any,
    duration: float | None = None,
    rate: float = 1000.0,
    *,
    z0: float = Z0,
    z_sign: str = "up",
    branch: str | None = None,
    limits: str = "error",
) -> Trajectory:
    """Joint motion of a leg along `omnileg_eq51_path`.

    Parameters
    ----------
    leg
        The OmniLeg, or any leg with a foot and three independent coordinates.
    duration : float, optional
        s, at most 5; the whole path where not given.
    rate : float
        Samples a second.
    z0, z_sign
        As for `omnileg_eq51_path`.
    branch : str, optional
        Branch of the inverse kinematics; the leg's first where not given.
    limits : {"error", "ignore"}
        Whether coordinates outside the joint limits are refused.

    Returns
    -------
    Trajectory
        With exact rates and accelerations.

    Raises
    ------
    OutOfReachError, JointLimitError
        z0 is outside its feasible window, which the text gives.
    SingularityError
        The path straightens the leg (gamma = 0); with the time.
    """
    return follow(leg, omnileg_eq51_path(z0, z_sign=z_sign), duration, rate, branch=branch, limits=limits)


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
    amplitude = np.array([math.pi / 6.0, math.pi / 6.0, arguments.real("gamma_amplitude", gamma_amplitude)])
    sine, cosine = np.sin(omega * time)[:, None], np.cos(omega * time)[:, None]
    return Trajectory(
        time=time,
        q=amplitude * sine,  # (52)
        v=amplitude * omega * cosine,
        a=0.0 - amplitude * omega**2 * sine,  # no -0 in tables
        name=name,
    )


def omnileg_eq53_cycle(
    z0: float = Z0,
    *,
    step: float = 0.1,
    height: float = 0.05,
    lateral_step: float = 0.0,
    half_cycle: float = 1.0,
    start: tuple[float, float] = (0.0, 0.0),
    z_sign: str = "up",
) -> GaitCycle:
    """Gait of Xu et al. 2025 eq. (53), as a closed cycle: the swing, then the stance with H = 0 going back.

    Parameters
    ----------
    z0 : float
        Height of the ground, m, in the hip frame (z down); not in the paper.
    step, height, lateral_step : float
        L along Y, H, and L_h along X, m.
    half_cycle : float
        T: duration of the swing, and of the stance, s.
    start : tuple of float
        X and Y at lift-off, m; (0, -L / 2) centres the step under the hip.
    z_sign : {"up", "literal"}
        As for `omnileg_eq51_path`.

    Returns
    -------
    GaitCycle
        m; acceleration continuous, the foot at rest at lift-off and touch-down.
    """
    x, y = arguments.vector("start", start, 2, "m")
    ground, along, up, across = (
        arguments.real(what, value)
        for what, value in (("z0", z0), ("step", step), ("height", height), ("lateral_step", lateral_step))
    )
    T = arguments.positive("half_cycle", half_cycle, "seconds")
    return gait_cycle((x, y, ground), (across, along, 0.0), (0.0, 0.0, _sign(z_sign) * up), T, name="eq53")  # (53)


def omnileg_eq53(
    leg: Any,
    duration: float | None = None,
    rate: float = 1000.0,
    *,
    cycle: GaitCycle | None = None,
    branch: str | None = None,
    limits: str = "error",
) -> Trajectory:
    """Joint motion of a leg along the gait (53), repeated for longer durations.

    Parameters
    ----------
    leg
        The OmniLeg, or any leg with a foot and three independent coordinates.
    duration : float, optional
        s; one cycle (2 s as printed) where not given. The paper walks three cycles.
    rate : float
        Samples a second.
    cycle : GaitCycle, optional
        From `omnileg_eq53_cycle`; the printed parameters where not given.
    branch : str, optional
        Branch of the inverse kinematics; the leg's first where not given.
    limits : {"error", "ignore"}
        Whether coordinates outside the joint limits are refused.

    Returns
    -------
    Trajectory
        No force on the foot; ``cycle.support_force(motion.time, force)`` gives that of the stance.

    Raises
    ------
    OutOfReachError, JointLimitError, SingularityError
        As for `omnileg_eq51`.
    """
    cycle = omnileg_eq53_cycle() if cycle is None else cycle
    arguments.kind("cycle", cycle, GaitCycle, hint="omnileg_eq53_cycle makes one")
    return follow(leg, cycle.curve, duration, rate, periodic=True, branch=branch, limits=limits)


def _sign(z_sign: str) -> float:
    if not isinstance(z_sign, str) or z_sign not in ("up", "literal"):
        raise TrajectoryError(f"z_sign is 'up' (P_z = z0 - Z) or 'literal' (P_z = z0 + Z), not {z_sign!r}")
    return -1.0 if z_sign == "up" else 1.0


def _shifted(coefficients: np.ndarray, shift: float) -> np.ndarray:
    """Coefficients of p(t + shift), highest power first."""
    return np.poly1d(np.poly1d(coefficients)(np.poly1d([1.0, shift]))).coeffs


TRAJECTORIES = {
    "eq52": omnileg_eq52,
    "eq52_45deg": partial(omnileg_eq52, gamma_amplitude=math.radians(45.0), name="eq52_45deg"),
    "eq51": FootTrajectory(omnileg_eq51_path),
    "eq53": FootTrajectory(omnileg_eq53_cycle),
}
