"""Peak actuator forces, speeds and power of one design along a path of the foot, for example a gait."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.analysis.design.inertia import Inertia
from leg_dynamics.analysis.design.poses import Family, OnePose

if TYPE_CHECKING:
    from leg_dynamics.analysis.trajectories import FootPath
    from leg_dynamics.leg import Leg

__all__ = ["MOTION", "gait_path", "motion_indices"]

MOTION = ("peak_force", "peak_speed", "peak_power")


def gait_path(
    leg: Leg,
    period: float,
    stride: float,
    clearance: float,
    *,
    support_force: tuple[float, float, float] | None = None,
    samples: int = 200,
) -> FootPath:
    """One cycle of a foot about the leg's home position: half swing, half stance at constant speed, along x.

    Parameters
    ----------
    leg : Leg
        The leg that the study starts from; all designs follow the same path.
    period : float
        s.
    stride, clearance : float
        m; length of the step, height of the swing.
    support_force : tuple of 3 floats, optional
        Force of the ground on the foot in stance, N, hip frame.
    samples : int
        Of the cycle.
    """
    from leg_dynamics.analysis.dexterity import home_coordinates
    from leg_dynamics.analysis.trajectories import FootPath, gait_cycle

    home = leg.foot_position(home_coordinates(leg))
    step = np.array([stride, 0.0, 0.0])
    down = 1.0 if leg.gravity[2] >= 0.0 else -1.0
    lift = np.array([0.0, 0.0, -down * clearance])
    cycle = gait_cycle(home - step / 2.0, step, lift, period / 2.0, period / 2.0, stance="uniform")
    time = np.linspace(0.0, cycle.duration, samples, endpoint=False)
    force = None if support_force is None else cycle.support_force(time, support_force)
    curve = cycle.curve
    position, velocity, acceleration = (curve.value(time, order) for order in range(3))
    return FootPath(time, position, velocity, acceleration, foot_force=force, name="gait")


def motion_indices(
    designs: Any, one: OnePose, path: FootPath, sign: float, inertia: Callable[[], Inertia] | None
) -> dict[str, float]:
    """Peaks over all actuators and samples.

    Parameters
    ----------
    designs : Designs
        Where `one` is from.
    one : OnePose
        With three coordinates.
    path : FootPath
    sign : float
        Of det J.
    inertia : callable or None
        Gives the design's masses, which forces and power need; called only if the path is in the workspace. None
        where neither is asked for.

    Returns
    -------
    dict of str to float
        ``peak_speed`` (m/s or rad/s) and, with `inertia`, ``peak_force`` (N or N·m) and ``peak_power`` (W, of one
        actuator); NaN where the path leaves the workspace.
    """
    names = ("peak_speed",) if inertia is None else MOTION
    rows = one.feet(np.ascontiguousarray(path.position))
    good = (rows[:, 0] >= 0.0) & ((rows[:, 2] * sign > 0.0) if sign else True)
    if not good.all():
        return dict.fromkeys(names, math.nan)
    q = rows[:, 6:]
    leg: Leg = designs.base if isinstance(designs, Family) else one.leg()
    backend: Any = leg.backend
    if isinstance(designs, Family):
        kinematic = tuple(name.removeprefix("route ") for name in designs.numbers.names if name.startswith("route "))
        known = dict(zip(designs.numbers.names, one.numbers.tolist(), strict=True))  # type: ignore[attr-defined]
        values = np.array([known[f"route {name}"] for name in kinematic])
        J = backend.kernel("foot_jacobian", kinematic).ufunc(q, values)
    else:
        J = leg.jacobian(q)
    v = np.linalg.solve(J, path.velocity[..., None])[..., 0]
    order = [leg.joint_names.index(name) for name in backend.actuator_joints]
    speed = v[:, order]
    found = {"peak_speed": float(np.abs(speed).max())}
    if inertia is None:
        return found
    force = np.zeros(3) if path.foot_force is None else path.foot_force
    if isinstance(designs, Family):
        own = inertia().numbers | dict(zip(kinematic, values.tolist(), strict=True))
        every = tuple(own)
        dJ = backend.kernel("foot_jacobian_derivative", kinematic).ufunc(q, v, values)
        a = _acceleration(J, dJ, v, path.acceleration)
        effort = backend.kernel("loaded_torque", every).ufunc(q, v, a, force, leg.gravity, np.array(list(own.values())))
    else:
        a = _acceleration(J, leg.jacobian_derivative(q, v), v, path.acceleration)
        effort = leg.torque(q, v, a, np.broadcast_to(force, path.position.shape))
    return found | {
        "peak_force": float(np.abs(effort).max()),
        "peak_power": float(np.abs(effort * speed).max()),
    }


def _acceleration(J: np.ndarray, dJ: np.ndarray, v: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    missing = acceleration - np.einsum("nij,nj->ni", dJ, v)
    return np.linalg.solve(J, missing[..., None])[..., 0]
