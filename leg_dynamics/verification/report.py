"""The result of a cross-check: one row a quantity, with the worst disagreement and where it is."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from leg_dynamics.errors import CrosscheckError

__all__ = ["Check", "CrosscheckReport"]


@dataclass(frozen=True)
class Check:
    """One quantity compared over many states.

    Attributes
    ----------
    group : str
        What the quantity is held against.
    quantity : str
    worst : float
        Largest error, relative to 1 + magnitude unless `measure` says otherwise.
    tolerance : float
    samples : int
    at : dict of str to float
        Independent coordinates of the worst state, rad or m.
    measure : str
    """

    group: str
    quantity: str
    worst: float
    tolerance: float
    samples: int
    at: dict[str, float]
    measure: str = "relative to 1 + magnitude"

    @property
    def passed(self) -> bool:
        """Whether the worst error is within the tolerance; NaN is not."""
        return self.worst <= self.tolerance


@dataclass(frozen=True)
class CrosscheckReport:
    """All checks of one leg.

    Attributes
    ----------
    leg : str
    routes : tuple of str
    samples, seed : int
    checks : tuple of Check
    """

    leg: str
    routes: tuple[str, ...]
    samples: int
    seed: int
    checks: tuple[Check, ...]

    @property
    def rows(self) -> tuple[Check, ...]:
        """The checks, in order."""
        return self.checks

    @property
    def passed(self) -> bool:
        """Whether there are checks and every one passed."""
        return bool(self.checks) and all(check.passed for check in self.checks)

    @property
    def worst(self) -> Check:
        """The check closest to its tolerance, or furthest beyond it."""
        return max(self.checks, key=lambda check: _badness(check))

    def raise_if_failed(self) -> None:
        """Raise when a check failed.

        Raises
        ------
        CrosscheckError
            Names each failing quantity, its error, its tolerance and the state.
        """
        failing = [check for check in self.checks if not check.passed]
        if failing:
            listing = "; ".join(
                f"{c.group}: {c.quantity} differs by {c.worst:.3g}, tolerance {c.tolerance:g}, at {c.at}" for c in failing
            )
            raise CrosscheckError(f"{self.leg}: {len(failing)} of {len(self.checks)} checks failed: {listing}", checks=failing)

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON-ready values."""
        return {
            "leg": self.leg,
            "routes": list(self.routes),
            "samples": self.samples,
            "seed": self.seed,
            "passed": self.passed,
            "checks": [asdict(check) | {"passed": check.passed} for check in self.checks],
        }

    def to_json(self) -> str:
        """The report as JSON text; a NaN error is written as null."""
        values = self.to_dict()
        for check in values["checks"]:
            if check["worst"] != check["worst"]:
                check["worst"] = None
        return json.dumps(values, indent=2, allow_nan=False)

    def __rich__(self) -> Any:
        from rich.table import Table

        table = Table(title=f"{self.leg}: cross-check of {' and '.join(self.routes)}, seed {self.seed}")
        table.add_column("against")
        table.add_column("quantity")
        for column in ("worst", "tolerance", "samples"):
            table.add_column(column, justify="right")
        table.add_column("verdict")
        group = None
        for check in self.checks:
            verdict = "[green]agrees[/green]" if check.passed else "[red]DISAGREES[/red]"
            shown = check.group if check.group != group else ""
            group = check.group
            table.add_row(
                shown, check.quantity, f"{check.worst:.1e}", f"{check.tolerance:.0e}", str(check.samples), verdict
            )
        table.caption = "errors relative to 1 + magnitude" + ("" if self.passed else "; worst states are in the JSON report")
        return table


def _badness(check: Check) -> float:
    if check.worst != check.worst:
        return float("inf")
    return check.worst / check.tolerance if check.tolerance > 0.0 else (0.0 if check.passed else float("inf"))
