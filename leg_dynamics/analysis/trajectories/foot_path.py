"""A sampled path of the foot, and the joint motion that follows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.trajectories.trajectory import Trajectory, validate_motion
from leg_dynamics.errors import RowError, SingularityError, UnsupportedError

__all__ = ["FootLeg", "FootPath", "check_leg"]

LARGEST_CONDITION = 1e5
"""Of the foot Jacobian. Near a fold the coordinates err by eps * condition, and rates by eps * condition^2 of
themselves: about 2e-6 here."""


class FootLeg(Protocol):
    """What following a foot path needs of a leg."""

    @property
    def joint_names(self) -> Sequence[str]:
        """The n independent coordinates."""
        ...

    @property
    def limits(self) -> Any:
        """With `lower` and `upper`, each of shape (n,)."""
        ...

    def foot_position(self, q: Any, *, on_error: Any = "raise") -> Any:
        """Foot position in the hip frame, (..., 3)."""
        ...

    def inverse_kinematics(
        self, p: Any, branch: str | None = None, limits: Any = "error", *, on_error: Any = "raise"
    ) -> Any:
        """Coordinates that put the foot there, (..., n)."""
        ...

    def jacobian(self, q: Any) -> Any:
        """Foot Jacobian, (..., 3, n)."""
        ...

    def jacobian_derivative(self, q: Any, v: Any) -> Any:
        """Its time derivative, (..., 3, n)."""
        ...


def check_leg(leg: Any, *methods: str) -> None:
    """Refuse, by a ShapeError, what is not a leg that can do what is asked of it."""
    arguments.having("leg", leg, ("joint_names", "limits", *methods), "load one with leg_dynamics.load")


@dataclass(frozen=True, eq=False)
class FootPath:
    """A path of the foot in the hip frame, sampled at T times; the arrays are private, read-only copies.

    Parameters
    ----------
    time : array_like, shape (T,)
        s, finite and strictly increasing.
    position, velocity, acceleration : array_like, shape (T, 3)
        m, m/s, m/s².
    foot_force : array_like, shape (T, 3) or (3,), optional
        Force that the environment applies to the foot, N; handed on to the joint motion.
    name : str
        Shown in tables and plots.

    Raises
    ------
    ShapeError, NonFiniteError, TrajectoryError
        As for `Trajectory`.
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    foot_force: NDArray[np.float64] | None = None
    name: str = "foot path"

    def __post_init__(self) -> None:
        validate_motion(self, ("position", "velocity", "acceleration"), columns=3)

    def __reduce__(self) -> tuple[Any, ...]:
        return FootPath, (self.time, self.position, self.velocity, self.acceleration, self.foot_force, self.name)

    def __len__(self) -> int:
        return self.time.size

    def __repr__(self) -> str:
        force = "" if self.foot_force is None else ", with a force on the foot"
        return f"<FootPath {self.name!r}: {len(self)} samples, {self.time[0]:g} to {self.time[-1]:g} s{force}>"

    @property
    def duration(self) -> float:
        """Last time minus first time, s."""
        return float(self.time[-1] - self.time[0])

    def with_foot_force(self, force: ArrayLike) -> FootPath:
        """Return a copy with a force of the environment on the foot, N, shape (3,) or (T, 3)."""
        return replace(self, foot_force=arguments.reals("foot_force", force))

    def to_joint(self, leg: FootLeg, branch: str | None = None, *, limits: str = "error") -> Trajectory:
        """Joint motion that moves the foot along this path.

        Rates and accelerations are exact: v = J^-1 p' and a = J^-1 (p'' - Jdot v).

        Parameters
        ----------
        leg
            A leg with a foot and three independent coordinates.
        branch : str, optional
            Branch of the inverse kinematics; the leg's first where not given.
        limits : {"error", "ignore"}
            Whether coordinates outside the joint limits are refused.

        Returns
        -------
        Trajectory
            At the same times, with the same force and name.

        Raises
        ------
        OutOfReachError, JointLimitError
            A position cannot be reached, or not within the limits; `rows`, `margin`, and `time` of the first one, s.
        SingularityError
            The foot Jacobian cannot be inverted; `margin` is its smallest singular value, `time` as above.
        UnsupportedError
            The leg has not three independent coordinates, so that the path does not determine its motion.
        """
        check_leg(leg, "inverse_kinematics", "jacobian", "jacobian_derivative")
        arguments.choice("limits", limits, ("error", "ignore"))
        n = len(leg.joint_names)
        if n != 3:
            raise UnsupportedError(
                f"a foot path determines three joint motions, but this leg has {n} independent coordinates; "
                "give the motion in joint space"
            )
        try:
            q = np.asarray(leg.inverse_kinematics(self.position, branch, limits))
        except RowError as error:
            raise self._timed(error) from error
        J = np.asarray(leg.jacobian(q))
        singular_values = np.linalg.svd(J, compute_uv=False)
        smallest, largest = singular_values[:, -1], singular_values[:, 0]
        rows = np.flatnonzero(~(smallest * LARGEST_CONDITION > largest))
        if rows.size:
            row = int(rows[0])
            time = float(self.time[row])
            raise SingularityError(
                f"foot path {self.name!r} is in a singular pose at {rows.size} of {len(self)} samples, first at "
                f"t = {time:g} s: the foot Jacobian's smallest singular value is {smallest[row]:.3g} beside "
                f"{largest[row]:.3g}, and the limit of their ratio is {1.0 / LARGEST_CONDITION:g}; keep the path away "
                "from there, or give the motion in joint space",
                rows=rows,
                margin=smallest[rows],
                time=time,
            )
        v = np.linalg.solve(J, self.velocity[..., None])[..., 0]
        drift = np.einsum("tij,tj->ti", np.asarray(leg.jacobian_derivative(q, v)), v)
        a = np.linalg.solve(J, (self.acceleration - drift)[..., None])[..., 0]
        return Trajectory(self.time, q, v, a, self.foot_force, self.name)

    def _timed(self, error: RowError) -> RowError:
        time = float(self.time[int(error.rows.min())])
        evidence = dict(error.evidence) | {"time": time}
        return type(error)(f"foot path {self.name!r} at t = {time:g} s: {error.message}", **evidence)
