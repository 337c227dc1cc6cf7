"""The result of a run, as JSON, as Markdown and as tables in the terminal, all from the same rows."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.cases import GROUPS, YARDSTICK, Settings
from benchmarks.environment import QUIET_LOAD
from benchmarks.gate import TOLERANCE

SCHEMA = "leg_dynamics benchmarks 1"

Spread = tuple[float, float, float, float]


def spread(samples: tuple[float, ...]) -> Spread:
    """Minimum, lower quartile, median, upper quartile."""
    return tuple(float(x) for x in np.percentile(samples, (0, 25, 50, 75)))


@dataclass(frozen=True)
class Result:
    """One case: `samples` are ns a call, `ratios` ns a row over the yardstick of the same repetition.

    `calls` is the number of calls in one measurement; without a right answer there are no samples.
    """

    key: str
    group: str
    title: str
    rows: int
    peer: bool
    goal: float | None
    status: str
    error: float | None
    reason: str | None
    calls: int
    samples: tuple[float, ...]
    ratios: tuple[float, ...]

    @property
    def per_row(self) -> Spread | None:
        """ns a row."""
        return spread(tuple(sample / self.rows for sample in self.samples)) if self.samples else None

    @property
    def ratio(self) -> Spread | None:
        return spread(self.ratios) if self.ratios else None

    @property
    def goal_met(self) -> bool | None:
        """None where there is no goal or nothing was measured."""
        return None if self.goal is None or self.ratio is None else self.ratio[2] <= self.goal

    def to_dict(self) -> dict[str, Any]:
        names = ("minimum", "lower_quartile", "median", "upper_quartile")
        return asdict(self) | {
            "samples": list(self.samples),
            "ratios": list(self.ratios),
            "ns_per_row": None if self.per_row is None else dict(zip(names, self.per_row, strict=True)),
            "ratio": None if self.ratio is None else dict(zip(names, self.ratio, strict=True)),
            "goal_met": self.goal_met,
        }


def _digits(value: float) -> str:
    """Three significant digits without an exponent."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def _range(values: Spread | None, scale: float = 1.0) -> str:
    return "" if values is None else f"{_digits(values[1] / scale)} – {_digits(values[3] / scale)}"


@dataclass(frozen=True)
class Report:
    """All results of one leg on one machine."""

    leg: str
    settings: Settings
    environment: dict[str, Any]
    results: tuple[Result, ...]

    @property
    def sound(self) -> bool:
        """Whether every case of the project itself ran and was right; peers may fail."""
        return all(result.status == "ok" for result in self.results if not result.peer)

    def to_dict(self) -> dict[str, Any]:
        return {
            "schema": SCHEMA,
            "leg": self.leg,
            "yardstick": YARDSTICK,
            "settings": asdict(self.settings) | {"batch_rows": list(self.settings.batch_rows)},
            "environment": self.environment,
            "sound": self.sound,
            "results": [result.to_dict() for result in self.results],
        }

    def to_json(self) -> str:
        return json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False) + "\n"

    # ------------------------------------------------------------------ what all renderings share

    def ranked(self, group: str) -> list[Result]:
        """A group's results, fastest row first; what has no time comes last."""
        mine = [result for result in self.results if result.group == group]
        return sorted(mine, key=lambda result: (result.per_row is None, result.per_row[2] if result.per_row else 0.0))

    def _table(self, group: str) -> tuple[list[str], list[list[str]]]:
        unit, scale = ("ns a row", 1.0) if group == GROUPS[2] else ("µs", 1000.0)
        header = ["", "case", f"median, {unit}", "quartiles", "minimum", "× rnea", "quartiles", "error"]
        lines = []
        for rank, result in enumerate(self.ranked(group), start=1):
            error = "" if result.error is None else f"{result.error:.0e}"
            times, ratio = result.per_row, result.ratio
            if times is None:
                lines.append(["–", result.title, result.status.upper(), "", "", "", "", error])
                continue
            lines.append(
                [
                    str(rank),
                    result.title,
                    _digits(times[2] / scale),
                    _range(times, scale),
                    _digits(times[0] / scale),
                    "" if ratio is None else _digits(ratio[2]),
                    _range(ratio),
                    error,
                ]
            )
        return header, lines

    def failures(self) -> list[str]:
        """A line about each case that has no time."""
        return [f"{r.title}: {r.status.upper()}: {r.reason}" for r in self.results if r.status != "ok"]

    def goals(self) -> list[str]:
        """A line about each goal, with the measured ratio and the verdict; then the naive way for comparison."""
        lines = []
        for result in self.results:
            if result.goal is None:
                continue
            start = f"{result.title}: goal at most {result.goal:g} × rnea"
            if result.ratio is None:
                lines.append(f"{start}, not measured")
                continue
            share = result.ratio[2] / result.goal
            verdict = f"met, {1 - share:.0%} to spare" if result.goal_met else f"MISSED by {share - 1:.0%}"
            lines.append(f"{start}, measured {_digits(result.ratio[2])} ({_range(result.ratio)}): {verdict}")
        lines += [
            f"for comparison, {result.title}: {_digits(result.ratio[2])} × rnea"
            for result in self.results
            if result.key.startswith("naive") and result.ratio is not None
        ]
        return lines

    def notes(self) -> list[str]:
        """How to read the tables."""
        settings = self.settings
        return [
            "Every answer is first held against another route at the same states: the closed form, and for the closed "
            "form itself the pinocchio route; `error` is the worst one, relative to 1 + magnitude. Above "
            f"{TOLERANCE:.0e} a case is WRONG, not timed and not ranked.",
            f"One process; {settings.repetitions} repetitions, each of which visits every case for about "
            f"{settings.minimum_ns / 1e6:g} ms or more without garbage collection. The ratio to the yardstick is taken "
            "within a repetition, then its median.",
            f"The trajectory is the leg's own at {settings.rate:g} samples a second, there and back without a jump; "
            "each call has a new q and starts from the last.",
            "The batch of the closed form is the NumPy vectorised closed form: there is no other. Batch rows are the "
            "trajectory's; the pinocchio route goes row by row and is measured on at most "
            f"{settings.row_limit:,} rows.",
            "`leg.torque` validates its arguments; the Mechanism lines are without that. The naive case shares no code "
            "with them: pinocchio's constraint Jacobian on point pairs, numpy.linalg.pinv, plain Newton.",
            "pinocchio's constraintDynamics and lcaba know no gear couplings: those are imposed by multipliers, at one "
            "more solution for each and one for the result.",
        ]

    def surroundings(self) -> list[tuple[str, str]]:
        """Machine, versions, settings."""
        e = self.environment
        versions = ", ".join(f"{name} {version}" for name, version in e["versions"].items() if version)
        threads = ", ".join(f"{name} {value or 'not set'}" for name, value in e["threads"].items())
        commit = e["commit"]
        tree = "not in git" if commit is None else commit["name"] + (" with changes" if commit["dirty"] else "")
        loads = [load for load in (e["load_before"], e.get("load_after")) if load is not None]
        load = " before, ".join(str(load) for load in loads) + (" after" if len(loads) == 2 else "")
        if e["load_before"] is not None and e["load_before"] > QUIET_LOAD:
            load += " (NOT QUIET: other work was running; trust ratios only)"
        return [
            ("date", e["date"]),
            ("processor", f"{e['cpu']}, {e['cores']} cores, {e['system']}"),
            ("versions", f"{e['python']}, {versions}"),
            ("BLAS threads", f"{e['blas'] or 'unknown library'}; {threads}"),
            ("load average", load or "unknown"),
            ("commit", tree),
        ]

    # ------------------------------------------------------------------ renderings

    def to_markdown(self) -> str:
        lines = [f"# {self.leg}: what a torque costs from Python", ""]
        lines += ["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in self.surroundings())]
        lines += ["", "## Goals", "", *(f"- {line}" for line in self.goals())]
        for group in self._groups():
            header, rows = self._table(group)
            lines += ["", f"## {group[0].upper()}{group[1:]}", "", _row(header), "|--:|:--" + "|--:" * 6 + "|"]
            lines += [_row(cells) for cells in rows]
        if self.failures():
            lines += ["", "## Not timed", "", *(f"- {line}" for line in self.failures())]
        lines += ["", "## How it was measured", "", *(f"- {line}" for line in self.notes()), ""]
        return "\n".join(lines)

    def _groups(self) -> list[str]:
        return [group for group in GROUPS if any(result.group == group for result in self.results)]

    def __rich__(self) -> Any:
        from rich.console import Group
        from rich.markup import escape
        from rich.table import Table

        facts = Table(show_header=False, box=None, title=f"{self.leg}: what a torque costs from Python")
        for name, value in self.surroundings():
            facts.add_row(name, escape(value))
        parts: list[Any] = [facts]
        for group in self._groups():
            header, rows = self._table(group)
            table = Table(title=group)
            for number, name in enumerate(header):
                table.add_column(name, justify="left" if number == 1 else "right")
            for cells in rows:
                style = None if cells[0] != "–" else "red"
                table.add_row(*(escape(cell) for cell in cells), style=style)
            parts.append(table)
        parts += [f"[red]{escape(line)}[/red]" for line in self.failures()]
        for line in self.goals():
            style = "red" if "MISSED" in line or "not measured" in line else "green" if "met" in line else "dim"
            parts.append(f"[{style}]{escape(line)}[/{style}]")
        return Group(*parts)


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
