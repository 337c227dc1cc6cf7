"""Papers, judged: every equation, table, figure and claim with a verdict that is computed when it is asked for.

One package a paper, each with ``reproduce(progress=None) -> PaperReport``. Forms that are wrong as printed
live only here.
"""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType

from leg_dynamics.errors import UnsupportedError

__all__ = ["find", "names"]


def names() -> tuple[str, ...]:
    """Names of the papers that can be reproduced, sorted."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(__path__) if module.ispkg))


def find(name: str) -> ModuleType:
    """Return the package of a paper.

    Parameters
    ----------
    name : str
        Name of the leg that the paper is about, for example ``"omnileg"``.

    Returns
    -------
    module
        With ``reproduce(progress=None, **options)``.

    Raises
    ------
    UnsupportedError
        No paper has this name; the text lists those there are.
    """
    if name not in names():
        raise UnsupportedError(f"no paper about {name!r} is reproduced here; known: {', '.join(names())}")
    return importlib.import_module(f"{__name__}.{name}")
