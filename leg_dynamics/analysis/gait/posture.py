"""Where the feet stand in the middle of their stance: legs splayed by an angle, at a reach and a height."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.gait.robot import Robot
from leg_dynamics.errors import TrajectoryError

__all__ = ["splayed_homes"]

_IN_THE_MIDDLE = 1e-6
"""Share of the hips' extent within which a hip counts as in the middle: its leg is not splayed."""


def splayed_homes(
    robot: Robot, splay: float | None = None, reach: float | None = None, height: float | None = None
) -> NDArray[np.float64]:
    """Neutral feet of splayed legs.

    A foot is at a horizontal distance from its hip, turned by the splay from straight sideways: ahead in front of the
    hips' middle, backwards behind it, and not for a leg in the middle.

    Parameters
    ----------
    robot : Robot
    splay : float, optional
        rad, less than a right angle; negative brings the feet together. By default each leg's direction at home.
    reach : float, optional
        Horizontal distance of the feet from their hips, m; by default each leg's at home.
    height : float, optional
        Of the body's origin above the ground, m; by default each foot's at home.

    Returns
    -------
    numpy.ndarray, shape (N, 3)
        In the body frame, m.

    Raises
    ------
    TrajectoryError, ShapeError
        A number is not usable, or a hip is on neither side.
    """
    homes = robot.homes
    hips = np.array([limb.hip[:3, 3] for limb in robot.limbs])
    if splay is not None or reach is not None:
        arm = homes[:, :2] - hips[:, :2]
        length = np.hypot(*arm.T) if reach is None else np.full(len(homes), arguments.tolerance("reach", reach))
        if splay is None:
            at_home = np.hypot(*arm.T)
            if (at_home == 0.0).any():
                name = robot.leg_names[int(at_home.argmin())]
                raise TrajectoryError(f"the foot of {name!r} is below its hip at home: give the splay with the reach")
            direction = arm / at_home[:, None]
        else:
            direction = _directions(robot, hips, arguments.real("splay", splay))
        homes[:, :2] = hips[:, :2] + length[:, None] * direction
    if height is not None:
        homes[:, 2] = -arguments.positive("body height", height, "metres")
    return homes


def _directions(robot: Robot, hips: NDArray[np.float64], splay: float) -> NDArray[np.float64]:
    if abs(splay) >= 0.5 * np.pi:
        raise TrajectoryError(f"the splay is {splay:g} rad; give less than a right angle either way")
    off = hips[:, :2] - hips[:, :2].mean(axis=0)
    slack = _IN_THE_MIDDLE * np.abs(off).max()
    where = np.where(np.abs(off) > slack, np.sign(off), 0.0)
    if (where[:, 1] == 0.0).any():
        name = robot.leg_names[int(np.abs(off[:, 1]).argmin())]
        raise TrajectoryError(f"the hip of {name!r} is on neither side, so that a splay has no direction; give homes")
    angle = splay * np.abs(where[:, 0])
    return np.stack([where[:, 0] * np.sin(angle), where[:, 1] * np.cos(angle)], axis=-1)
