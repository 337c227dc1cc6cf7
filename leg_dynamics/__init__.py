"""Rigid-body dynamics of closed-loop robot legs, from a mechanism file to motor torques.

>>> import leg_dynamics as ld
>>> leg = ld.load("omnileg")
>>> leg.foot_position([0.0, 0.0, 0.0]).round(6).tolist()
[0.0, 0.0, 0.5]
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from leg_dynamics.analysis.singularities import singularity
    from leg_dynamics.leg import Leg
    from leg_dynamics.routes import available, load
    from leg_dynamics.verification.crosscheck import crosscheck

__all__ = ["Leg", "__version__", "available", "crosscheck", "load", "singularity"]

__version__ = "0.1.0"

_HOMES = {
    "Leg": "leg_dynamics.leg",
    "available": "leg_dynamics.routes",
    "crosscheck": "leg_dynamics.verification",
    "load": "leg_dynamics.routes",
    "singularity": "leg_dynamics.analysis.singularities",
}


def __getattr__(name: str) -> Any:
    """Import public names on first use, so that `import leg_dynamics` stays light."""
    import importlib

    if name == "errors":
        return importlib.import_module("leg_dynamics.errors")
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, "errors"})
