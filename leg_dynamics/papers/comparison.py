"""Verdicts from differences: an equation against an independent fact, and a claim in words."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from leg_dynamics.papers.framework import Figure, Status, Verdict
from leg_dynamics.papers.judge import judge, text, worst

__all__ = ["EXACT", "claim", "compare", "flat"]

Array = np.ndarray

EXACT = 1e-10
"""m, rad: both sides are exact, a numeric closure stops at about 1e-13."""


def compare(
    item: str,
    title: str,
    of: str,
    unit: str,
    printed_difference: Any,
    corrected_difference: Any,
    *,
    tolerance: float = EXACT,
    kind: str = "equation",
    note: str = "",
    forms: tuple[str, str] = ("", ""),
    repair: tuple[str, Any] = ("", None),
    figures: Iterable[Figure] = (),
    alike: tuple[Any, Any] = ((), ()),
) -> Verdict:
    """Verdict from the differences of both forms to an independent fact.

    `repair` names the defect: the one change that makes the printed form right, and what then is left of the
    difference. `alike` are further differences of both forms, of another unit, that count for the status but are not
    quoted.
    """
    every = [
        np.append(np.ravel(main), np.ravel(more))
        for main, more in zip((printed_difference, corrected_difference), alike, strict=True)
    ]
    explained = None if repair[1] is None else flat(repair[1])
    status = judge(every[0], tolerance, corrected=every[1], explained=explained)
    off, left = worst(printed_difference), worst(corrected_difference)
    size = f" {unit}" if unit else ""
    off_text = "without bound" if np.isnan(off) else f"by up to {text(off)}{size}"
    sentence = {
        Status.CONFIRMED: f"Holds within {text(off)}{size}.",
        Status.CORRECTED: f"As printed it is off {off_text}; the corrected form is within {text(left)}{size}.",
        Status.NOT_REPRODUCIBLE: f"The printed form is off {off_text}, the corrected one by {text(left)}{size}.",
        Status.OUT_OF_REACH: "",
    }[status]
    found = [Figure("printed form, worst difference", off, unit, of)]
    if status is not Status.CONFIRMED:
        found.append(Figure("corrected form, worst difference", left, unit, of))
        if explained is not None:
            sentence += f" The defect: {repair[0]} (to {text(worst(explained))})."
            found.append(Figure("printed form, left after the one repair", worst(explained), "", repair[0]))
    confirmed = status is Status.CONFIRMED
    return Verdict(
        item,
        kind,
        title,
        status,
        f"{sentence} {note}".strip(),
        (*found, *figures),
        forms[0],
        "" if confirmed else forms[1],
    )


def flat(differences: Any) -> Array:
    """One array of differences that may have different shapes."""
    if isinstance(differences, list):
        return np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in differences])
    return np.ravel(np.asarray(differences, dtype=float))


def claim(
    item: str,
    title: str,
    status: Status,
    finding: str,
    figures: Iterable[Figure] = (),
    forms: tuple[str, str] = ("", ""),
) -> Verdict:
    """A verdict on a claim."""
    return Verdict(f"claim: {item}", "claim", title, status, finding, tuple(figures), *forms)
