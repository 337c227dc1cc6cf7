"""Finds the named trajectories of a leg: one module of this package a leg."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol

from leg_dynamics.analysis.trajectories.trajectory import Trajectory

__all__ = ["TrajectoryFactory", "named"]

_PACKAGE = "leg_dynamics.analysis.trajectories"


class TrajectoryFactory(Protocol):
    """Samples a named motion; None for `duration` means the motion's own."""

    def __call__(self, duration: float | None = None, rate: float = 1000.0) -> Trajectory:
        """Sample the motion for `duration` s at `rate` samples a second."""
        ...


def named(leg_name: str) -> Mapping[str, TrajectoryFactory]:
    """Return the named trajectories of a leg.

    Parameters
    ----------
    leg_name : str
        Name of the mechanism, as its description states it.

    Returns
    -------
    mapping of str to TrajectoryFactory
        The first one is the leg's default; empty for a leg without any.

    Examples
    --------
    >>> sorted(named("omnileg"))
    ['eq52', 'eq52_gamma45']
    """
    package = importlib.import_module(_PACKAGE)
    # Compared with the listing, so that a name from a foreign file never reaches the import system.
    if leg_name not in {module.name for module in pkgutil.iter_modules(package.__path__)}:
        return MappingProxyType({})
    module = importlib.import_module(f"{_PACKAGE}.{leg_name}")
    return MappingProxyType(dict(getattr(module, "TRAJECTORIES", {})))
