"""A paper's verdicts as terminal tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from leg_dynamics.papers.framework import Status

if TYPE_CHECKING:
    from leg_dynamics.papers.framework import PaperReport

__all__ = ["report_table"]

STYLES = {
    Status.CONFIRMED: "green",
    Status.CORRECTED: "yellow",
    Status.NOT_REPRODUCIBLE: "magenta",
    Status.OUT_OF_REACH: "dim",
}

STATES = {"holds": ("holds", "green"), "fails": ("FAILS", "bold red"), "not run": ("not run", "dim")}
"""Of checks: word and style."""


def report_table(report: PaperReport) -> Any:
    """Verdicts, then checks, then the summary count, as one renderable of rich."""
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    verdicts = Table(title=Text(report.title), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    verdicts.add_column("item", max_width=26)
    verdicts.add_column("verdict", max_width=18)
    verdicts.add_column("finding", overflow="fold")
    kind = None
    for verdict in report.verdicts:
        if kind not in (None, verdict.kind):
            verdicts.add_section()
        kind = verdict.kind
        verdicts.add_row(
            Text(verdict.item),
            Text(verdict.status.value, STYLES[verdict.status]),
            Text(verdict.finding or verdict.title),
        )
    parts: list[Any] = [verdicts]
    if report.checks:
        checks = Table(title="What must hold", title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
        checks.add_column("check")
        checks.add_column("error", justify="right")
        checks.add_column("tolerance", justify="right")
        checks.add_column("")
        for check in report.checks:
            checks.add_row(
                Text(check.name),
                Text("–" if check.value is None else f"{check.value:.1e} {check.unit}".rstrip()),
                Text(f"{check.tolerance:.0e}"),
                Text(*STATES[check.state]),
            )
        parts.append(checks)
    parts.append(Text(summary(report)))
    return Group(*parts)


def summary(report: PaperReport) -> str:
    """One line with the counts."""
    counted = ", ".join(f"{count} {status.value}" for status, count in report.counts().items() if count)
    return f"{len(report.verdicts)} items: {counted or 'none'}; checks: {report.held()}"
