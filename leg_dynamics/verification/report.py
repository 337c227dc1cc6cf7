"""The result of a cross-check: one row a quantity, with the worst disagreement and where it is."""

from __future__ import annotations

import json
import math
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
    detail : str
        Why there is no number at the worst state, or what limits the check; usually empty.
    """

    group: str
    quantity: str
    worst: float
    tolerance: float
    samples: int
    at: dict[str, float]
    measure: str = "relative to 1 + magnitude"
    detail: str = ""

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
    compared : int
        States that were compared: fewer than `samples` where many more drawn did not yield as many.
    left_out : int
        Further states, which no route can assemble.
    nearly_singular : int
        Further states, left out because they are so near a singular closure that rounding hides the digits compared.
    """

    leg: str
    routes: tuple[str, ...]
    samples: int
    seed: int
    checks: tuple[Check, ...]
    compared: int = 0
    left_out: int = 0
    nearly_singular: int = 0

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
        return max(self.checks, key=_badness)

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
                f"{c.group}: {c.quantity} is off by {c.worst:.3g}, tolerance {c.tolerance:g}, at {c.at}"
                + (f" ({c.detail})" if c.detail else "")
                for c in failing
            )
            counted = f"{len(failing)} of {len(self.checks)} checks failed"
            raise CrosscheckError(f"{self.leg}: {counted}: {listing}", checks=failing)

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON-ready values."""
        return {
            "leg": self.leg,
            "routes": list(self.routes),
            "samples": self.samples,
            "seed": self.seed,
            "compared": self.compared,
            "left_out": self.left_out,
            "nearly_singular": self.nearly_singular,
            "passed": self.passed,
            "checks": [asdict(check) | {"passed": check.passed} for check in self.checks],
        }

    def to_json(self) -> str:
        """The report as JSON text; a number that is NaN or infinite is written as null."""
        values = self.to_dict()
        for check in values["checks"]:
            check["worst"] = _finite_or_none(check["worst"])
            check["at"] = {name: _finite_or_none(value) for name, value in check["at"].items()}
        return json.dumps(values, indent=2, allow_nan=False, ensure_ascii=False)

    def __rich__(self) -> Any:
        from rich.markup import escape
        from rich.table import Table

        table = Table(title=escape(f"{self.leg}: cross-check of {' and '.join(self.routes)}, seed {self.seed}"))
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
        caption = ["errors relative to 1 + magnitude"]
        if self.compared < self.samples:
            caption.append(f"only {self.compared} of the {self.samples} states asked for were found")
        if self.left_out:
            caption.append(f"{self.left_out} more states cannot be assembled and were left out")
        if self.nearly_singular:
            caption.append(
                f"{self.nearly_singular} more states are nearly singular, where rounding hides the digits to compare, "
                "and were left out"
            )
        caption += [
            f"{c.quantity}: off by {c.worst:.1e} at " + ", ".join(f"{n} = {x:.6g}" for n, x in c.at.items())
            for c in self.checks
            if not c.passed
        ]
        caption += [f"{c.quantity}: {c.detail}" for c in self.checks if c.detail]
        table.caption = escape("\n".join(caption))
        return table


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _badness(check: Check) -> float:
    if math.isnan(check.worst):
        return math.inf
    if check.tolerance > 0.0:
        return check.worst / check.tolerance
    return 0.0 if check.passed else math.inf
