"""A leg along a trajectory: one assembly mode from start to end, and where and why it stops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.actuation import Feasibility
from leg_dynamics.errors import AssemblyError, RowError

if TYPE_CHECKING:
    from leg_dynamics.analysis.trajectories.trajectory import Trajectory
    from leg_dynamics.leg import Leg

__all__ = ["TorqueAlong", "assemble_along", "limit_flags", "located", "torque_along"]

# Routes close the loops to rounding; two poses of one mode differ by less, whole turns aside.
_SAME_POSE = 1e-6


@dataclass(frozen=True)
class TorqueAlong:
    """Efforts along a trajectory, and what the actuators make of them.

    Attributes
    ----------
    time : (N,) array
        s.
    torque : (N, m) array
        N·m or N, in the order of the leg's actuators.
    residual : (N, n) array
        What no actuator balances, N·m or N; zero without idle motions.
    coordinates : mapping of str to (N,) array
        Every moving joint of the tree, rad or m.
    feasibility : Feasibility
        Margins to the limits of the actuators.
    """

    time: NDArray[np.float64]
    torque: NDArray[np.float64]
    residual: NDArray[np.float64]
    coordinates: Mapping[str, NDArray[np.float64]]
    feasibility: Feasibility

    def flags(self) -> list[dict[str, Any]]:
        """For each actuator its least margins with their times, and whether it can do the motion; JSON-ready."""
        return limit_flags(self.feasibility, self.time)


def limit_flags(feasibility: Feasibility, time: NDArray[np.float64]) -> list[dict[str, Any]]:
    """For each actuator its least margins with their times, s, and whether it can do the motion; JSON-ready."""
    rows = []
    for row in feasibility.worst():
        entry = {"actuator": row["actuator"], "feasible": row["feasible"]}
        for kind in ("effort", "speed", "curve"):
            entry[f"{kind}_margin"] = row[f"{kind}_margin"]
            entry[f"{kind}_time"] = float(time[row[f"{kind}_sample"]])
        rows.append(entry)
    return rows


def assemble_along(leg: Leg, motion: Trajectory) -> Mapping[str, NDArray[np.float64]]:
    """Tree coordinates along a trajectory, each continued from the sample before in the same assembly mode.

    Parameters
    ----------
    leg : Leg
    motion : Trajectory

    Returns
    -------
    mapping of str to (N,) array
        Every moving joint, rad or m.

    Raises
    ------
    AssemblyError, SingularityError
        The mode ends or is singular on the way, or the leg's own assembly of a sample is another mode than the one that
        leads to it. With `time`, s, and where the route knows them `pose` (coordinates by name), `kind` (``parallel``,
        ``constraint``, ``coordinates``) and `direction` (rates of the free motion by joint); `margin` as elsewhere.
    """
    route: Any = leg.backend
    if hasattr(route, "forget"):
        route.forget()
    try:
        assembled = leg.assemble(motion.q)
    except RowError as error:
        # What leads to the failing sample says more than the sample alone.
        _continued(leg, motion)
        raise located(error, leg, motion) from error
    continued = _continued(leg, motion)
    if continued is not None:
        _compare(leg, motion, assembled, continued)
    return MappingProxyType(assembled)


def _continued(leg: Leg, motion: Trajectory) -> Mapping[str, np.ndarray] | None:
    """Tree coordinates by continuation; None where the route's formulas know one mode only."""
    route: Any = leg.backend
    route = getattr(route, "fallback", None) or route
    if not hasattr(route, "follow"):
        return None
    try:
        found = route.follow(motion.q)
    except RowError as error:
        raise located(error, leg, motion) from error
    return dict(zip(route.tree_joint_names, found.T, strict=True))


def _compare(leg: Leg, motion: Trajectory, assembled: Mapping[str, Any], continued: Mapping[str, Any]) -> None:
    """Refuse a motion whose continuation is not what the leg makes of its samples, in a row or each alone."""
    route: Any = leg.backend
    route = getattr(route, "fallback", None) or route
    alone = dict(zip(route.tree_joint_names, route.apart(motion.q).T, strict=True))
    # A sample that only the motion leads to is no contradiction.
    alone = {name: np.where(np.isnan(values), continued[name], values) for name, values in alone.items()}
    for own in (assembled, alone):
        _compare_with(leg, motion, own, continued)


def _compare_with(leg: Leg, motion: Trajectory, assembled: Mapping[str, Any], continued: Mapping[str, Any]) -> None:
    turns = {joint.name: joint.unit == "rad" for joint in leg.description.joints}
    for name, values in continued.items():
        difference = np.abs(assembled[name] - values)
        if turns[name]:
            difference = np.abs(difference - 2.0 * np.pi * np.round(difference / (2.0 * np.pi)))
        wrong = np.flatnonzero(difference > _SAME_POSE)
        if wrong.size:
            row = int(wrong[0])
            raise AssemblyError(
                f"at t = {motion.time[row]:.6g} s the motion has arrived in another assembly mode than the leg's own: "
                f"{name} is {values[row]:.6g}, and {assembled[name][row]:.6g} in the mode of the home pose "
                f"({_pose(leg, motion, row)}): start from a configuration of the mode that you mean",
                rows=wrong,
                margin=_SAME_POSE - difference[wrong],
                residual=np.nan,
                time=float(motion.time[row]),
                pose=dict(zip(leg.joint_names, motion.q[row].tolist(), strict=True)),
            )


def _pose(leg: Leg, motion: Trajectory, row: int) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in zip(leg.joint_names, motion.q[row], strict=True))


def located(error: RowError, leg: Leg, motion: Trajectory, first: int = 0) -> RowError:
    """The same error with the time of its first row, s, in the text and as `time`.

    Parameters
    ----------
    error : RowError
        Of a call with samples of `motion`.
    leg : Leg
    motion : Trajectory
    first : int
        The sample that was the call's first row.
    """
    row = first + int(error.all_rows.min())
    evidence = {name: value for name, value in error.evidence.items() if name not in ("rows", "all_rows")}
    evidence["time"] = float(motion.time[row])
    evidence.setdefault("pose", dict(zip(leg.joint_names, motion.q[row].tolist(), strict=True)))
    message = f"at t = {motion.time[row]:.6g} s of {motion.name}: {error.message}"
    return type(error)(message, rows=first + error.rows, all_rows=first + error.all_rows, **evidence)


def torque_along(
    leg: Leg, motion: Trajectory, gravity: ArrayLike | None = None, *, allow_idle: bool = False, **policy: Any
) -> TorqueAlong:
    """Actuator efforts along a trajectory, in one assembly mode, with flags of what the actuators cannot do.

    Parameters
    ----------
    leg : Leg
    motion : Trajectory
        With its foot force, where it has one.
    gravity : (3,) or (N, 3) array_like, optional
        m/s², hip frame.
    allow_idle : bool
        As for `leg_dynamics.leg.Leg.torque`.
    **policy
        ``weights``, ``bounds``, ``preload`` of `leg_dynamics.leg.Leg.torque`.

    Returns
    -------
    TorqueAlong

    Raises
    ------
    AssemblyError, SingularityError
        See `assemble_along`.
    ActuationError, EffortLimitError
        See `leg_dynamics.leg.Leg.torque`; the latter with `time`.
    """
    coordinates = assemble_along(leg, motion)
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            if allow_idle:
                torque, residual = leg.torque(
                    motion.q, motion.v, motion.a, motion.foot_force, gravity, allow_idle=True, **policy
                )
            else:
                torque = leg.torque(motion.q, motion.v, motion.a, motion.foot_force, gravity, **policy)
                residual = np.zeros_like(motion.q)
            feasibility = leg.feasible(motion.q, motion.v, motion.a, torque=torque)
    except RowError as error:
        raise located(error, leg, motion) from error
    return TorqueAlong(motion.time, torque, residual, coordinates, feasibility)
