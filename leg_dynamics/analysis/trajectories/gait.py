"""The foot's cycle of a gait: a swing through the air and a stance that takes the foot back."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.trajectories.operations import check_periodic, concatenate
from leg_dynamics.analysis.trajectories.polynomial import PiecewisePolynomial, quintic
from leg_dynamics.errors import NonFiniteError, ShapeError

__all__ = ["GaitCycle", "gait_cycle", "lift_profile"]


@dataclass(frozen=True, eq=False)
class GaitCycle:
    """A closed cycle of the foot: swing, then stance.

    Parameters
    ----------
    swing, stance : PiecewisePolynomial
        Curves of the foot, m, hip frame; the stance starts where the swing ends and ends where it starts, in
        position and velocity.
    name : str
        Name of the whole cycle.

    Raises
    ------
    TrajectoryError
        The cycle does not close; with the jump.
    """

    swing: PiecewisePolynomial
    stance: PiecewisePolynomial
    name: str = "gait"
    curve: PiecewisePolynomial = field(init=False, repr=False)
    """The whole cycle."""

    def __post_init__(self) -> None:
        for what, part in (("the swing", self.swing), ("the stance", self.stance)):
            arguments.kind(what, part, PiecewisePolynomial, hint="gait_cycle and quintic make one")
        curve = concatenate(self.swing, self.stance, name=self.name)
        if curve.dimension != 3:
            raise ShapeError(f"a gait cycle moves the foot in three coordinates, not {curve.dimension}")
        check_periodic(curve, continuity="velocity")
        object.__setattr__(self, "curve", curve)

    @property
    def duration(self) -> float:
        """Of the cycle, s."""
        return self.curve.duration

    @property
    def duty_factor(self) -> float:
        """Share of the cycle in stance."""
        return self.stance.duration / self.duration

    def in_stance(self, time: ArrayLike) -> NDArray[np.bool_]:
        """Whether the foot is on the ground, at any time of the repeated cycle.

        Parameters
        ----------
        time : array_like, shape (...)
            s; the first swing starts at the swing's own first time. The moments of touch-down and lift-off count
            as stance, also where the times round.

        Returns
        -------
        numpy.ndarray of bool, shape (...)
        """
        time = arguments.reals("time", time)
        if not np.isfinite(time).all():
            raise NonFiniteError("a time is NaN or infinite; give finite times in seconds")
        slack = 1e-9 * self.duration
        phase = np.mod(time - self.swing.start_time, self.duration)
        return (phase >= self.swing.duration - slack) | (phase <= slack)

    def support_force(self, time: ArrayLike, force: ArrayLike) -> NDArray[np.float64]:
        """A constant force of the ground on the foot in stance, zero in swing.

        Parameters
        ----------
        time : array_like, shape (...)
            s.
        force : array_like, shape (3,)
            N, hip frame, applied by the ground to the foot (with z down: negative z carries the body).

        Returns
        -------
        numpy.ndarray, shape (..., 3)
            For `foot_force` of a `FootPath` or `Trajectory`.
        """
        vector = arguments.vector("force", force, 3, "N")
        return np.where(self.in_stance(time)[..., None], vector, 0.0)


def gait_cycle(
    start: ArrayLike,
    step: ArrayLike,
    lift: ArrayLike,
    swing_duration: float,
    stance_duration: float | None = None,
    *,
    stance: str = "minimum_jerk",
    name: str = "gait",
) -> GaitCycle:
    """Compose a gait cycle of the foot.

    The swing goes from `start` to `start + step` and adds `lift` times a bump that is 1 in the middle and has zero
    rate and acceleration at both ends; the stance goes straight back.

    Parameters
    ----------
    start, step, lift : array_like, shape (3,)
        m, hip frame.
    swing_duration, stance_duration : float
        s, positive; the stance takes as long as the swing where not given.
    stance : {"minimum_jerk", "uniform"}
        The stance starts and ends at rest, or moves at constant velocity (the body does too), which the swing
        then meets at both ends. The acceleration is continuous in both.
    name : str
        Name of the cycle.

    Returns
    -------
    GaitCycle
    """
    p, d, up = (
        arguments.vector(what, value, 3, "m") for what, value in (("start", start), ("step", step), ("lift", lift))
    )
    swing_time = arguments.positive("swing duration", swing_duration, "seconds")
    stance_time = (
        swing_time if stance_duration is None else arguments.positive("stance duration", stance_duration, "seconds")
    )
    arguments.choice("stance", stance, ("minimum_jerk", "uniform"))
    rate = -d / stance_time if stance == "uniform" else np.zeros(3)
    forth = quintic(p, p + d, swing_time, start_velocity=rate, end_velocity=rate)
    back = quintic(p + d, p, stance_time, start_velocity=rate, end_velocity=rate, name="stance")
    coefficients = np.pad(forth.coefficients, ((1, 0), (0, 0), (0, 0)))
    coefficients += lift_profile(swing_time)[:, None, None] * up
    return GaitCycle(PiecewisePolynomial(forth.breaks, coefficients, "swing"), back, name)


def lift_profile(duration: float) -> NDArray[np.float64]:
    """Coefficients of 64 u³ (1 - u)³ with u = t / duration, highest power first, shape (7,)."""
    return np.array([-64.0, 192.0, -192.0, 64.0, 0.0, 0.0, 0.0]) / duration ** np.arange(6.0, -1.0, -1.0)
