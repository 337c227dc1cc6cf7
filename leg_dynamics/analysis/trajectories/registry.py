"""Finds the named trajectories of a leg: one module of this package a leg."""

from __future__ import annotations

import importlib
import math
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.trajectories.feasibility import feasible_offset_windows
from leg_dynamics.analysis.trajectories.foot_path import FootPath
from leg_dynamics.analysis.trajectories.gait import GaitCycle
from leg_dynamics.analysis.trajectories.operations import repeat
from leg_dynamics.analysis.trajectories.polynomial import PiecewisePolynomial
from leg_dynamics.analysis.trajectories.trajectory import Trajectory, sample_times
from leg_dynamics.errors import JointLimitError, OutOfReachError, TrajectoryError

__all__ = ["FootTrajectory", "TrajectoryFactory", "follow", "named", "named_cycle"]

_PACKAGE = "leg_dynamics.analysis.trajectories"


class TrajectoryFactory(Protocol):
    """Samples a named motion; None for `duration` means the motion's own."""

    def __call__(self, duration: float | None = None, rate: float = 1000.0) -> Trajectory:
        """Sample the motion for `duration` s at `rate` samples a second."""
        ...


@dataclass(frozen=True)
class FootTrajectory:
    """A named motion that is a path of the foot; the leg's inverse kinematics makes a joint motion of it.

    Parameters
    ----------
    path : callable
        Makes the curve of the foot, m, hip frame, or a gait cycle, which is repeated for a longer duration.
    """

    path: Callable[[], PiecewisePolynomial | GaitCycle]

    def __call__(
        self, duration: float | None = None, rate: float = 1000.0, *, leg: Any = None, limits: str = "error"
    ) -> Trajectory:
        """Sample the motion of `leg` for `duration` s at `rate` samples a second.

        Raises
        ------
        TrajectoryError
            There is no leg: ``named(leg)`` brings it. Or the path is shorter than `duration`.
        OutOfReachError, JointLimitError, SingularityError
            The leg cannot follow the path; where moving it in z helps, the text names the window.
        """
        path = self.path()
        periodic = isinstance(path, GaitCycle)
        curve = path.curve if isinstance(path, GaitCycle) else path
        if leg is None:
            raise TrajectoryError(
                f"{curve.name!r} is a path of the foot, which only a leg turns into joint motion: "
                f"ask named(leg)[{curve.name!r}], with the leg instead of its name"
            )
        return follow(leg, curve, duration, rate, periodic=periodic, limits=limits)


def follow(
    leg: Any,
    curve: PiecewisePolynomial,
    duration: float | None = None,
    rate: float = 1000.0,
    *,
    periodic: bool = False,
    branch: str | None = None,
    limits: str = "error",
) -> Trajectory:
    """Joint motion along a curve of the foot; where it is infeasible, the error says how far to move it in z.

    Parameters
    ----------
    leg
        A leg with a foot and three independent coordinates.
    curve : PiecewisePolynomial
        m, hip frame.
    duration : float, optional
        s; the curve's own where not given. A shorter one cuts the motion.
    rate : float
        Samples a second.
    periodic : bool
        Whether the curve is one period, repeated for a longer duration.
    branch : str, optional
        Branch of the inverse kinematics; the leg's first where not given.
    limits : {"error", "ignore"}
        Whether coordinates outside the joint limits are refused.

    Returns
    -------
    Trajectory

    Raises
    ------
    OutOfReachError, JointLimitError
        As `FootPath.to_joint`; in addition `windows`, by how much the curve may move along z of the hip frame.
    SingularityError
        As `FootPath.to_joint`.
    TrajectoryError
        The curve is shorter than `duration` and not periodic.
    """
    arguments.kind("path", curve, PiecewisePolynomial, hint="quintic, minimum_jerk and gait_cycle(...).curve are some")
    path = sample_curve(curve, duration, rate, periodic=periodic)
    try:
        return path.to_joint(leg, branch, limits=limits)
    except (OutOfReachError, JointLimitError) as error:
        windows = feasible_offset_windows(leg, curve, branch=branch, limits=limits)
        evidence = dict(error.evidence) | {"windows": windows}
        raise type(error)(f"{error.message}; {_advice(windows, curve)}", **evidence) from error


def sample_curve(
    curve: PiecewisePolynomial, duration: float | None, rate: float, *, periodic: bool = False
) -> FootPath:
    """Sample a curve of the foot for `duration` s, repeated where it is periodic."""
    length = curve.duration if duration is None else arguments.positive("duration", duration, "seconds")
    times = curve.start_time + sample_times(length, rate)
    if times[-1] > curve.end_time + 1e-9 * curve.duration:
        if not periodic:
            raise TrajectoryError(
                f"{curve.name!r} lasts {curve.duration:g} s and does not repeat; {length:g} s are too many"
            )
        curve = repeat(curve, math.ceil(length / curve.duration - 1e-9))
    return curve.foot_path(times=times)


def _advice(windows: tuple[Any, ...], curve: PiecewisePolynomial) -> str:
    if not windows:
        return "no height in z makes the whole path feasible"
    z = float(curve.ends()[0][2])
    # Rounded inwards, so that the printed ends are feasible too.
    texts = [f"[{np.ceil((z + w.lower) * 1e4) / 1e4:.4f}, {np.floor((z + w.upper) * 1e4) / 1e4:.4f}]" for w in windows]
    return f"the path starts at z = {z:.6g} m, and starts from z in {' or '.join(texts)} m are feasible"


def named(leg: Any, *, limits: str = "error") -> Mapping[str, TrajectoryFactory]:
    """Return the named trajectories of a leg.

    Parameters
    ----------
    leg : str or leg
        Name of the mechanism, as its description states it; or the leg itself, which the motions that are paths of
        the foot need.
    limits : {"error", "ignore"}
        Whether joint limits stop the paths of the foot; motions in joint space are sampled either way.

    Returns
    -------
    mapping of str to TrajectoryFactory
        The first one is the leg's default; empty for a leg without any.

    Examples
    --------
    >>> sorted(named("omnileg"))
    ['eq51', 'eq52', 'eq52_45deg', 'eq53']
    """
    arguments.choice("limits", limits, ("error", "ignore"))
    factories = _factories(leg)
    if not isinstance(leg, str):
        for key, factory in factories.items():
            if isinstance(factory, FootTrajectory):
                factories[key] = partial(factory, leg=leg, limits=limits)
    return MappingProxyType(factories)


def named_cycle(leg: Any, trajectory: str) -> GaitCycle | None:
    """Return the gait cycle behind a named trajectory, whose `support_force` loads the foot in stance only.

    Parameters
    ----------
    leg : str or leg
        As for `named`.
    trajectory : str
        Name of a trajectory.

    Returns
    -------
    GaitCycle or None
        None where there is no such trajectory or it is no gait.
    """
    factory = _factories(leg).get(trajectory)
    path = factory.path() if isinstance(factory, FootTrajectory) else None
    return path if isinstance(path, GaitCycle) else None


def _factories(leg: Any) -> dict[str, Any]:
    """The leg's named trajectories as its module states them."""
    if not isinstance(leg, str):
        arguments.having("leg", leg, ("name",), "load one with leg_dynamics.load, or give its name")
    name = leg if isinstance(leg, str) else leg.name
    package = importlib.import_module(_PACKAGE)
    # Compared with the listing, so that a name from a foreign file never reaches the import system.
    if name not in {module.name for module in pkgutil.iter_modules(package.__path__)}:
        return {}
    return dict(getattr(importlib.import_module(f"{_PACKAGE}.{name}"), "TRAJECTORIES", {}))
