"""Two runs side by side, by their ratios to the yardstick: the machine's own speed cancels, but for its moods.

Peers and the limit are not this project's code: how far they moved between the runs is how far a ratio moves by itself.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

Spread = tuple[float, float, float]


class ComparisonError(ValueError):
    """The earlier file is not a report of this kind."""


@dataclass(frozen=True)
class Change:
    """One case in both runs; not `judged` where a run has too few rounds.

    It is `beyond` where the spreads do not meet and the factor is larger than what nine of ten `control` cases moved.
    """

    key: str
    title: str
    block: str
    unit: str
    before: Spread
    after: Spread
    judged: bool = True
    control: bool = False
    drift: float = 1.0

    @property
    def factor(self) -> float:
        """Cost after over cost before."""
        return self.after[1] / self.before[1]

    @property
    def beyond(self) -> bool:
        apart = self.after[0] > self.before[2] or self.after[2] < self.before[0]
        return self.judged and not self.control and apart and self.moved > self.drift

    @property
    def moved(self) -> float:
        """The factor, or its inverse where that is larger."""
        return max(self.factor, 1.0 / self.factor)

    @property
    def words(self) -> str:
        if not self.judged:
            return "too few rounds"
        if self.control:
            return "control"
        if not self.beyond:
            return "within the spread" if self.moved > self.drift else "within the controls' drift"
        return f"{self.factor - 1.0:.0%} slower" if self.factor > 1.0 else f"{1.0 - self.factor:.0%} faster"

    def to_dict(self) -> dict[str, Any]:
        return {
            "key": self.key,
            "title": self.title,
            "block": self.block,
            "unit": self.unit,
            "before": list(self.before),
            "after": list(self.after),
            "factor": self.factor,
            "judged": self.judged,
            "control": self.control,
            "drift": self.drift,
            "beyond": self.beyond,
        }


FEWEST, FEW = 3, 8
"""Rounds below which nothing is judged, and below which quartiles say too little and the whole range is taken."""

CONTROLS = 5
"""Control cases below which they say nothing."""


def _drift(changes: tuple[Change, ...]) -> float:
    """Factor that nine of ten controls stay within."""
    moved = [change.moved for change in changes if change.control and change.judged]
    return float(np.quantile(moved, 0.9)) if len(moved) >= CONTROLS else 1.0


def _spread(samples: Any) -> Spread:
    if not all(isinstance(sample, int | float) and 0.0 < sample <= sys.float_info.max for sample in samples):
        raise ValueError("a ratio is a finite positive number")
    outer = (25, 50, 75) if len(samples) >= FEW else (0, 50, 100)
    low, median, high = np.percentile(samples, outer)
    return float(low), float(median), float(high)


def _ratios(report: Mapping[str, Any]) -> dict[str, tuple[dict[str, Any], Spread]]:
    if not isinstance(report["results"], (list, tuple)):
        raise TypeError(f"results is a list, got {type(report['results']).__name__}")
    return {
        result["key"]: (result, _spread(result["ratios"]))
        for result in report["results"]
        if result["status"] == "ok" and result["ratios"] and not result["key"].endswith(report["yardstick"])
    }


def compare(after: Mapping[str, Any], before: Any, schema: str) -> tuple[Change, ...]:
    """Compare two reports.

    Parameters
    ----------
    after, before : mapping
        As `Report.to_dict` gives them; cases that one of them lacks are left out.
    schema : str
        The kind of report that can be compared.

    Raises
    ------
    ComparisonError
        `before` is something else, or of another leg.
    """
    if not isinstance(before, Mapping) or before.get("schema") != schema:
        found = before.get("schema") if isinstance(before, Mapping) else type(before).__name__
        raise ComparisonError(f"not a report of the kind {schema!r}: {found!r}; make it with leg-dynamics bench --json")
    if before.get("leg") != after["leg"]:
        raise ComparisonError(f"a report of {before.get('leg')!r}, not of {after['leg']!r}")
    try:
        old, new = _ratios(before), _ratios(after)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as problem:
        raise ComparisonError(f"a damaged report: {type(problem).__name__} {problem}") from problem
    changes = tuple(
        Change(
            key,
            result["title"],
            result["block"],
            "× pin.rnea",
            old[key][1],
            spread,
            min(len(result["ratios"]), len(old[key][0]["ratios"])) >= FEWEST,
            bool(result.get("peer", False)),
        )
        for key, (result, spread) in new.items()
        if key in old
    )
    drift = _drift(changes)
    return tuple(replace(change, drift=drift) for change in changes)
