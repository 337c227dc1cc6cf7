"""The result of a cross-check: one row a quantity, with the worst disagreement and where it is."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from leg_dynamics.errors import CrosscheckError

__all__ = ["Check", "CrosscheckReport", "OwnCheck", "OwnFormulasReport"]


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
            for name in {"worst", "own", "reference", "share"} & check.keys():
                check[name] = _finite_or_none(check[name])
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


@dataclass(frozen=True)
class OwnCheck(Check):
    """One result of own formulas held against the reference, or against other results of theirs.

    Attributes
    ----------
    method : str
        Method of the interface.
    equation : str
        What the formulas' author calls it, such as ``(12)``; often empty.
    component : str
        Entry that is furthest off in the worst state, by names: ``d foot z / d theta2``.
    own, reference : float
        Its two values; NaN where there is none.
    share : float
        Part of the states that disagree, 0 to 1.
    diagnosis : tuple of str
        What the data say of the error, each statement true in every state.
    follows_from : str
        Method whose error explains this one; empty where the error is here.
    """

    method: str = ""
    equation: str = ""
    component: str = ""
    own: float = math.nan
    reference: float = math.nan
    share: float = 0.0
    diagnosis: tuple[str, ...] = ()
    follows_from: str = ""

    @property
    def label(self) -> str:
        """Method and equation."""
        return f"{self.method} {self.equation}".rstrip()

    @property
    def findings(self) -> tuple[str, ...]:
        """Which entry is off, where, by how much, at how many of the states, and why; none where all agree."""
        if self.passed:
            return ()
        parts = []
        if not math.isnan(self.worst):
            entry = f"{self.component} is " if self.component else ""
            parts.append(f"{entry}{self.own:.8g}, {self.expected} {self.reference:.8g}, at {_place(self.at)}")
            if self.samples > 1:
                parts.append(f"{_percent(self.share)} of the states disagree")
        return tuple(text for text in (*parts, self.detail, *self.diagnosis) if text)

    @property
    def expected(self) -> str:
        """What the reference value is called."""
        return "from the others" if self.group == OWN_GROUP else "the reference has"


OWN_GROUP = "own formulas among themselves"


@dataclass(frozen=True)
class OwnFormulasReport(CrosscheckReport):
    """All checks of somebody's own formulas against a leg.

    Attributes
    ----------
    not_given : tuple of str
        Methods of the interface that the formulas do not have.
    not_compared : mapping of str to str
        Methods that they have and the reference has not, with the reason.
    notes : tuple of str
        What was read in one of several possible ways.
    """

    not_given: tuple[str, ...] = ()
    not_compared: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def causes(self) -> tuple[OwnCheck, ...]:
        """Failing checks that no other failing one explains: where to look first."""
        failing = (check for check in self.checks if isinstance(check, OwnCheck) and not check.passed)
        return tuple(check for check in failing if not check.follows_from)

    def raise_if_failed(self) -> None:
        """Raise when a check failed.

        Raises
        ------
        CrosscheckError
            Names each failing equation, its entry, its two values, the state and the diagnosis.
        """
        failing = [check for check in self.checks if not check.passed]
        if failing:
            listing = "; ".join(
                f"{check.label}: {check.quantity}: {', '.join(check.findings)}" for check in self.causes
            )
            counted = f"{len(failing)} of {len(self.checks)} checks failed"
            rest = len(failing) - len(self.causes)
            followed = f"; {rest} more follow from these" if rest else ""
            raise CrosscheckError(f"{self.leg}: {counted}: {listing}{followed}", checks=failing)

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON-ready values."""
        return super().to_dict() | {
            "not_given": list(self.not_given),
            "not_compared": dict(self.not_compared),
            "notes": list(self.notes),
        }

    def __rich__(self) -> Any:
        from rich.console import Group
        from rich.markup import escape
        from rich.table import Table
        from rich.text import Text

        table = Table(title=escape(f"{self.leg}, seed {self.seed}"))
        table.add_column("method", no_wrap=True)
        table.add_column("equation")
        table.add_column("quantity")
        table.add_column("worst", justify="right", no_wrap=True)
        table.add_column("off at", justify="right", no_wrap=True)
        table.add_column("verdict")
        group = None
        for check in self.checks:
            if not isinstance(check, OwnCheck):
                continue
            if group is not None and check.group != group:
                table.add_section()
            group = check.group
            verdict = "[green]agrees[/green]" if check.passed else "[red]DISAGREES[/red]"
            if check.follows_from:
                verdict = f"[yellow]follows from {escape(check.follows_from)}[/yellow]"
            names = escape(check.method), escape(check.equation), escape(check.quantity)
            table.add_row(*names, f"{check.worst:.1e}", _percent(check.share), verdict)
        tolerances = " or ".join(f"{tolerance:g}" for tolerance in sorted({check.tolerance for check in self.checks}))
        table.caption = f"errors relative to 1 + magnitude, tolerance {tolerances}; {self.compared} states"
        lines = []
        for cause in self.causes:
            lines.append(f"{cause.label}: {cause.quantity}")
            lines += [f"  {finding}" for finding in cause.findings]
        lines += [f"{name}: not compared: {reason}" for name, reason in self.not_compared.items()]
        lines += self.notes
        if self.not_given:
            lines.append(f"not given: {', '.join(self.not_given)}")
        if self.compared < self.samples:
            lines.append(f"only {self.compared} of the {self.samples} states asked for were found")
        left_out = self.left_out + self.nearly_singular
        if left_out:
            lines.append(f"{left_out} more states cannot be assembled or are nearly singular and were left out")
        return Group(table, *(Text(line) for line in lines))


def _place(at: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in at.items())


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _badness(check: Check) -> float:
    if math.isnan(check.worst):
        return math.inf
    if check.tolerance > 0.0:
        return check.worst / check.tolerance
    return 0.0 if check.passed else math.inf
