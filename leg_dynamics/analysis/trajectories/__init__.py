"""Motions of a leg: by formula, by name, from a CSV file, or composed from others.

Three kinds of objects, all immutable: a `PiecewisePolynomial` is a curve with exact derivatives of every order, in
joint space or of the foot; sampled, it becomes a `Trajectory` (joint space) or a `FootPath` (of the foot, in the hip
frame), and ``FootPath.to_joint(leg)`` turns the second into the first.

A leg's named trajectories live in the module of this package that carries the leg's name, in a mapping
``TRAJECTORIES`` from name to factory; a new leg is a new module.
"""

from __future__ import annotations

from leg_dynamics.analysis.trajectories.csv_file import from_csv
from leg_dynamics.analysis.trajectories.feasibility import OffsetWindow, feasible_offset_windows
from leg_dynamics.analysis.trajectories.following import TorqueAlong, along, assemble_along, torque_along
from leg_dynamics.analysis.trajectories.foot_path import FootPath
from leg_dynamics.analysis.trajectories.gait import GaitCycle, gait_cycle
from leg_dynamics.analysis.trajectories.omnileg import (
    omnileg_eq51,
    omnileg_eq51_path,
    omnileg_eq52,
    omnileg_eq53,
    omnileg_eq53_cycle,
)
from leg_dynamics.analysis.trajectories.operations import (
    Seam,
    blend,
    check_periodic,
    concatenate,
    connect,
    jerk_jumps,
    repeat,
    resample,
    seam,
    time_scale,
)
from leg_dynamics.analysis.trajectories.polynomial import (
    DerivativeJump,
    PiecewisePolynomial,
    minimum_jerk,
    quintic,
)
from leg_dynamics.analysis.trajectories.registry import FootTrajectory, TrajectoryFactory, follow, named, named_cycle
from leg_dynamics.analysis.trajectories.trajectory import Trajectory, force_during, sample_times

__all__ = [
    "DerivativeJump",
    "FootPath",
    "FootTrajectory",
    "GaitCycle",
    "OffsetWindow",
    "PiecewisePolynomial",
    "Seam",
    "TorqueAlong",
    "Trajectory",
    "TrajectoryFactory",
    "along",
    "assemble_along",
    "blend",
    "check_periodic",
    "concatenate",
    "connect",
    "feasible_offset_windows",
    "follow",
    "force_during",
    "from_csv",
    "gait_cycle",
    "jerk_jumps",
    "minimum_jerk",
    "named",
    "named_cycle",
    "omnileg_eq51",
    "omnileg_eq51_path",
    "omnileg_eq52",
    "omnileg_eq53",
    "omnileg_eq53_cycle",
    "quintic",
    "repeat",
    "resample",
    "sample_times",
    "seam",
    "time_scale",
    "torque_along",
]
