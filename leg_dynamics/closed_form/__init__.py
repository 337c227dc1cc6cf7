"""Closed-form formulas of the legs that have them: one module a leg, found by its name.

A module dropped beside this file is a leg as soon as it has `from_urdf(description)` and the formulas that
`leg_dynamics.closed_form.route` lists. Importing this package imports none of them.
"""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
from types import ModuleType

__all__ = ["find", "names"]


def find(name: str) -> ModuleType | None:
    """Formulas of the leg called `name`, or None where no module here has that name and a `from_urdf`.

    Parameters
    ----------
    name : str
        Name of a leg, for example ``"omnileg"``.

    Returns
    -------
    module or None
    """
    if not name.isidentifier() or name.startswith("_"):
        return None
    qualified = f"{__name__}.{name}"
    if importlib.util.find_spec(qualified) is None:
        return None
    module = importlib.import_module(qualified)
    return module if hasattr(module, "from_urdf") else None


def names() -> tuple[str, ...]:
    """Names of the legs that have closed-form formulas, sorted."""
    modules = (module.name for module in pkgutil.iter_modules(__path__))
    return tuple(sorted(name for name in modules if find(name) is not None))
