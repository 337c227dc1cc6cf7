"""Motions of a leg: by formula, by name, or from a CSV file.

A leg's named trajectories live in the module of this package that carries the leg's name, in a mapping
``TRAJECTORIES`` from name to factory; a new leg is a new module.
"""

from __future__ import annotations

from leg_dynamics.analysis.trajectories.csv_file import from_csv
from leg_dynamics.analysis.trajectories.omnileg import omnileg_eq52
from leg_dynamics.analysis.trajectories.registry import TrajectoryFactory, named
from leg_dynamics.analysis.trajectories.trajectory import Trajectory, force_during, sample_times

__all__ = [
    "Trajectory",
    "TrajectoryFactory",
    "force_during",
    "from_csv",
    "named",
    "omnileg_eq52",
    "sample_times",
]
