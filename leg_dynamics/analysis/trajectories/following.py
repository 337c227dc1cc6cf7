"""A leg along a trajectory: one assembly mode from start to end, and where and why it stops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.actuation import Feasibility
from leg_dynamics.description.turns import TURN, WholeTurns
from leg_dynamics.errors import AssemblyError, NonFiniteError, RowError
from leg_dynamics.leg import checked

if TYPE_CHECKING:
    from leg_dynamics.analysis.trajectories.trajectory import Trajectory
    from leg_dynamics.leg import Leg

__all__ = ["TorqueAlong", "along", "assemble_along", "limit_flags", "located", "torque_along"]

# Routes close the loops to rounding; two poses of one mode differ by less, whole turns aside.
_SAME_POSE = 1e-6
# A pose that is off the straight way by a larger share of it was met elsewhere.
_SAME_WAY = 1e-6
# rad/s and m/s, rad/s² and m/s²; the squares of larger ones overflow.
_FASTEST = 1e75


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


@contextmanager
def along(leg: Leg, motion: Trajectory) -> Iterator[Mapping[str, NDArray[np.float64]]]:
    """Follow a trajectory; while inside, the leg's poses at its samples are those that it leads to.

    A leg's own poses are those that the straight way from home leads to. A motion may lead further in the same
    assembly mode: inside, the methods of `leg` compute its samples too, in this thread.

    Parameters
    ----------
    leg : Leg
    motion : Trajectory
        Its rates and accelerations tell whether it touches a singular pose between two samples. Where they do not fit
        the coordinates, as in a list of poses at rest, it is checked at its samples only.

    Yields
    ------
    mapping of str to (N,) array
        Every moving joint, as `assemble_along` returns it.

    Raises
    ------
    AssemblyError, SingularityError
        See `assemble_along`.
    ShapeError, NonFiniteError
        The trajectory is not one of this leg; its rates are too large to compute with.
    """
    checked("motion.q", motion.q, len(leg.joint_names))
    rates = np.hstack([motion.v, motion.a])
    fast = np.flatnonzero(~(np.abs(rates).max(axis=1, initial=0.0) <= _FASTEST))
    if fast.size:
        value = float(np.abs(rates[fast[0]]).max())
        raise NonFiniteError(
            f"the rates or accelerations at t = {motion.time[fast[0]]:.6g} s of {motion.name} reach {value:.3g}, too "
            f"large to be followed, the limit is {_FASTEST:g}: check their units",
            rows=fast,
        )
    route = _continuing(leg)
    continued, known = None, nullcontext()
    if hasattr(route, "follow"):
        try:
            found = route.follow(motion.q, (motion.time, motion.v, motion.a))
        except RowError as error:
            raise located(error, leg, motion) from error
        continued, known = _by_joint(route, found), route.led(found)
        # Samples that only the motion leads to contradict nothing.
        alone = route.apart(motion.q)
        _compare(leg, motion, _by_joint(route, np.where(np.isnan(alone), found, alone)), continued)
    with known:
        try:
            assembled = leg.assemble(motion.q)
        except RowError as error:
            raise located(error, leg, motion) from error
        if continued is not None:
            _compare(leg, motion, assembled, continued)
        yield MappingProxyType(_continuous(leg, assembled, continued))


def assemble_along(leg: Leg, motion: Trajectory) -> Mapping[str, NDArray[np.float64]]:
    """Tree coordinates along a trajectory, each continued from the sample before in the same assembly mode.

    Passive angles are continuous: they start in the turn that `Leg.assemble` gives and go on from there, so that
    whole turns add up.

    Parameters
    ----------
    leg : Leg
    motion : Trajectory
        See `along`.

    Returns
    -------
    mapping of str to (N,) array
        Every moving joint, rad or m.

    Raises
    ------
    AssemblyError, SingularityError
        The mode ends or is singular on the way, or the leg's own assembly of a sample is another mode than the one that
        leads to it. See `located` for what it carries; where it is known, also `kind` (``parallel``, ``constraint``,
        ``coordinates``) and `direction` (rates of the free motion by joint); `margin` as elsewhere. Of two modes that
        differ, `difference` says by how much in which joints, and `nearest` which pose on the way is the nearest to a
        singular one (``time``, ``pose``, ``kind``, ``direction``, ``margin``).
    """
    with along(leg, motion) as coordinates:
        return coordinates


def _continuing(leg: Leg) -> Any:
    """The route that continues a pose, or the leg's own."""
    route: Any = leg.backend
    return getattr(route, "fallback", None) or route


def _by_joint(route: Any, found: np.ndarray) -> Mapping[str, np.ndarray]:
    return dict(zip(route.tree_joint_names, found.T, strict=True))


def _continuous(
    leg: Leg, assembled: Mapping[str, NDArray[np.float64]], continued: Mapping[str, np.ndarray] | None
) -> dict[str, NDArray[np.float64]]:
    """The same poses with passive angles as they were continued, or without jumps of more than half a turn."""
    names = list(assembled)
    unknown = np.full(len(names), np.nan)
    free = {names[place] for place in WholeTurns(leg.description, names, leg.joint_names, unknown).places}
    result = dict(assembled)
    for name in free:
        own = assembled[name]
        way = np.unwrap(own) if continued is None else continued[name] - continued[name][0] + own[0]
        result[name] = own + TURN * np.round((way - own) / TURN)
    return result


def _compare(leg: Leg, motion: Trajectory, assembled: Mapping[str, Any], continued: Mapping[str, Any]) -> None:
    """Refuse a motion whose continuation is not what the leg makes of its samples, in a row or each alone."""
    turns = {joint.name: joint.unit == "rad" for joint in leg.description.joints}
    differences = {}
    for name, values in continued.items():
        difference = assembled[name] - values
        differences[name] = difference - TURN * np.round(difference / TURN) if turns[name] else difference
    largest = np.max([np.abs(values) for values in differences.values()], axis=0)
    wrong = np.flatnonzero(largest > _SAME_POSE)
    if not wrong.size:
        return
    row = int(wrong[0])
    at_row = {name: float(values[row]) for name, values in differences.items() if abs(values[row]) > _SAME_POSE}
    name = max(at_row, key=lambda joint: abs(at_row[joint]))
    by = ", ".join(f"{joint} {value:+.3g}" for joint, value in at_row.items())
    way = np.stack(list(continued.values()), axis=1)[: row + 1]
    nearest, sigma, kind, direction = _continuing(leg).nearest_singular(way)
    raise AssemblyError(
        f"at t = {motion.time[row]:.6g} s the motion has arrived in another assembly mode than the leg's own: "
        f"{name} is {continued[name][row]:.6g}, and {assembled[name][row]:.6g} in the mode of the home pose "
        f"({_pose(leg, motion, row)}); the two differ by {by}. The motion passes no singular pose on the way (the "
        f"smallest singular value of its samples is {sigma:.3g}, at {motion.time[nearest]:.6g} s), so that it leads "
        "around one: start from a configuration of the mode that you mean",
        rows=wrong,
        margin=_SAME_POSE - largest[wrong],
        residual=np.nan,
        time=float(motion.time[row]),
        sample_time=float(motion.time[row]),
        pose=_named(leg.joint_names, motion.q[row]),
        tree_pose={joint: float(values[row]) for joint, values in continued.items()},
        kind=None,
        direction=None,
        difference=at_row,
        nearest={
            "time": float(motion.time[nearest]),
            "pose": _named(leg.joint_names, motion.q[nearest]),
            "kind": kind,
            "direction": direction,
            "margin": sigma,
        },
    )


def _named(names: Sequence[str], values: Any) -> dict[str, float]:
    return dict(zip(names, np.asarray(values).tolist(), strict=True))


def _pose(leg: Leg, motion: Trajectory, row: int) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in zip(leg.joint_names, motion.q[row], strict=True))


def located(error: RowError, leg: Leg, motion: Trajectory, first: int = 0) -> RowError:
    """The same error with the place of its first row on the trajectory, in the text and as attributes.

    `time`, s, is that of `pose` (independent coordinates by name): where the pose lies between the sample before and
    the failing one, it is interpolated between their times, else it is that of the sample. `sample_time` is the failing
    sample's. `tree_pose` are all joints' coordinates at the pose, where they are known.

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
    evidence.setdefault("pose", _named(leg.joint_names, motion.q[row]))
    sample_time = float(motion.time[row])
    time = evidence.setdefault("time", _time_of(leg, motion, row, evidence["pose"]))
    evidence["sample_time"] = sample_time
    if "tree_coordinates" in evidence:
        evidence["tree_pose"] = _named(_continuing(leg).tree_joint_names, evidence["tree_coordinates"])
    when, sampled = f"t = {time:.6g} s", f"{sample_time:.6g} s"
    before = "" if when.endswith(f" {sampled}") else f", before the sample at {sampled}"
    message = f"at {when} of {motion.name}{before}: {error.message}"
    return type(error)(message, rows=first + error.rows, all_rows=first + error.all_rows, **evidence)


def _time_of(leg: Leg, motion: Trajectory, row: int, pose: Mapping[str, float]) -> float:
    """When a pose on the straight way from the sample before to `row` is passed; the sample's time where it is not."""
    time = float(motion.time[row])
    if row == 0:
        return time
    start, way = motion.q[row - 1], motion.q[row] - motion.q[row - 1]
    at = np.array([pose[name] for name in leg.joint_names]) - start
    length = float(way @ way)
    share = float(at @ way) / length if length > 0.0 else 1.0
    off = np.abs(at - share * way).max()
    if not (0.0 <= share < 1.0 and off <= _SAME_WAY * np.abs(way).max()):
        return time
    return float(motion.time[row - 1] + share * (motion.time[row] - motion.time[row - 1]))


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
    with along(leg, motion) as coordinates:
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
