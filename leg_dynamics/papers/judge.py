"""How a status follows from numbers: no verdict states its status by hand, unless the paper leaves something out."""

from __future__ import annotations

from typing import Any

import numpy as np

from leg_dynamics.papers.framework import Status

__all__ = ["judge", "text", "within", "worst"]


def judge(difference: Any, tolerance: float, *, corrected: Any = None, explained: Any = None) -> Status:
    """Status of an item from its worst differences to an independent fact; NaN counts as a disagreement.

    A form that merely differs is not yet understood, and any nonsense differs. It is corrected only where another
    form agrees and where the defect is named: the printed form with that one repair agrees as well.

    Parameters
    ----------
    difference : float or array_like
        Absolute differences of the item as printed.
    tolerance : float
        Of all three.
    corrected : float or array_like, optional
        Absolute differences of the corrected form.
    explained : float or array_like, optional
        What is left of the printed form's differences after the one repair that the verdict names.

    Returns
    -------
    Status
        Confirmed where the printed form agrees; corrected where the corrected form does and the defect explains the
        printed one; else not reproducible.
    """
    if within(difference, tolerance):
        return Status.CONFIRMED
    mended = corrected is not None and explained is not None
    if mended and within(corrected, tolerance) and within(explained, tolerance):
        return Status.CORRECTED
    return Status.NOT_REPRODUCIBLE


def within(difference: Any, tolerance: float) -> bool:
    """Whether all absolute values are within the tolerance; NaN is not, and nothing at all is no evidence either."""
    values = np.abs(np.asarray(difference, dtype=float))
    return values.size > 0 and bool((values <= tolerance).all())


def worst(difference: Any) -> float:
    """Largest absolute value, NaN where there is one."""
    return float(np.abs(np.asarray(difference, dtype=float)).max())


def text(value: float) -> str:
    """A number for a sentence: three digits."""
    return f"{value:.3g}"
