"""The result of a run: as JSON, and as sections that Markdown, the terminal and the HTML page render alike."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks import comparison, goals
from benchmarks.cases import YARDSTICK, Settings
from benchmarks.environment import QUIET_LOAD
from benchmarks.gate import TOLERANCE
from benchmarks.mechanisms import GRBDA

SCHEMA = "leg_dynamics benchmarks 2"

Spread = tuple[float, float, float, float]


def spread(samples: Sequence[float]) -> Spread:
    """Minimum, lower quartile, median, upper quartile."""
    return tuple(float(x) for x in np.percentile(samples, (0, 25, 50, 75)))


@dataclass(frozen=True)
class Result:
    """One case.

    `samples` are ns a call; `ratios` ns a row over the yardstick of the same round, `limit_ratios` over the limit. A
    wrong case may have times, which rank nowhere.
    """

    key: str
    block: str
    title: str
    rows: int
    peer: bool
    contender: str | None
    status: str
    error: float | None
    reason: str | None
    calls: int
    samples: tuple[float, ...]
    ratios: tuple[float, ...]
    limit_ratios: tuple[float, ...] = ()
    note: str | None = None

    @property
    def per_row(self) -> Spread | None:
        """ns a row."""
        return spread([sample / self.rows for sample in self.samples]) if self.samples else None

    @property
    def ratio(self) -> Spread | None:
        return spread(self.ratios) if self.ratios else None

    @property
    def limit_ratio(self) -> Spread | None:
        return spread(self.limit_ratios) if self.limit_ratios else None

    def to_dict(self) -> dict[str, Any]:
        return asdict(self) | {
            "samples": list(self.samples),
            "ratios": list(self.ratios),
            "limit_ratios": list(self.limit_ratios),
            "ns_per_row": _named(self.per_row),
            "ratio": _named(self.ratio),
            "limit_ratio": _named(self.limit_ratio),
        }


@dataclass(frozen=True)
class Figure:
    """A number of its own kind, for example of a fresh process: `samples` in `unit`, or the reason for none."""

    key: str
    title: str
    unit: str
    samples: tuple[float, ...]
    reason: str | None

    def to_dict(self) -> dict[str, Any]:
        return asdict(self) | {"samples": list(self.samples)}


def _named(values: Spread | None) -> dict[str, float] | None:
    names = ("minimum", "lower_quartile", "median", "upper_quartile")
    return None if values is None else dict(zip(names, values, strict=True))


def digits(value: float) -> str:
    """Three significant digits without an exponent."""
    size = abs(value)
    if size >= 100:
        return f"{value:,.0f}"
    if size >= 10:
        return f"{value:.1f}"
    if size >= 1 or value == 0:
        return f"{value:.2f}"
    return f"{value:.3f}" if size >= 0.1 else f"{value:.{2 - math.floor(math.log10(size))}f}"


def _range(values: Spread | None, scale: float = 1.0) -> str:
    return "" if values is None else f"{digits(values[1] / scale)} – {digits(values[3] / scale)}"


def _median(values: Spread | None, scale: float = 1.0) -> str:
    return "" if values is None else digits(values[2] / scale)


@dataclass(frozen=True)
class Line:
    """One row of a table; `tone` is "", "own", "wrong" (greyed), "absent", "good" or "bad"."""

    cells: tuple[str, ...]
    tone: str = ""


@dataclass(frozen=True)
class Section:
    """A heading, a table (text columns to the left), remarks, and the names of the charts that belong to it."""

    key: str
    title: str
    header: tuple[str, ...] = ()
    lines: tuple[Line, ...] = ()
    remarks: tuple[str, ...] = ()
    charts: tuple[str, ...] = ()
    text_columns: tuple[int, ...] = (0,)


@dataclass(frozen=True)
class Report:
    """All results of one leg on one machine; `blocks` are (key, title, per_row, chart)."""

    leg: str
    settings: Settings
    environment: dict[str, Any]
    blocks: tuple[tuple[str, str, bool, str], ...]
    results: tuple[Result, ...]
    figures: tuple[Figure, ...] = ()
    changes: tuple[comparison.Change, ...] | None = None
    compared_with: dict[str, Any] = field(default_factory=dict)

    @property
    def sound(self) -> bool:
        """Whether every case of the project itself that is available ran and was right; peers may fail."""
        return all(result.status in ("ok", "not available") for result in self.results if not result.peer)

    @property
    def title(self) -> str:
        return f"{self.leg}: what a torque costs from Python"

    def find(self, key: str) -> Result | None:
        return next((result for result in self.results if result.key == key), None)

    def of(self, block: str) -> list[Result]:
        return [result for result in self.results if result.block == block]

    def outcomes(self) -> tuple[goals.Outcome, ...]:
        return goals.outcomes(self)

    def against(self, earlier: Any) -> Report:
        """Return the report with a comparison.

        Parameters
        ----------
        earlier : mapping
            An earlier report's JSON; raises `comparison.ComparisonError` where it is something else.
        """
        changes = comparison.compare(self.to_dict(), earlier, SCHEMA)
        return replace(self, changes=changes, compared_with=dict(earlier.get("environment", {})))

    # ------------------------------------------------------------------ JSON

    def to_dict(self) -> dict[str, Any]:
        settings = {name: list(x) if isinstance(x, tuple) else x for name, x in asdict(self.settings).items()}
        return {
            "schema": SCHEMA,
            "leg": self.leg,
            "yardstick": YARDSTICK,
            "settings": settings,
            "environment": self.environment,
            "sound": self.sound,
            "blocks": [{"key": key, "title": title, "per_row": per_row} for key, title, per_row, _ in self.blocks],
            "results": [result.to_dict() for result in self.results],
            "figures": [figure.to_dict() for figure in self.figures],
            "goals": [asdict(outcome) for outcome in self.outcomes()],
            "references": {
                "grbda": {
                    "remark": "measured elsewhere on this kind of machine",
                    "us_a_call": {name: {"shipped": a, "generated": b} for name, (a, b) in GRBDA.items()},
                }
            },
            "comparison": None if self.changes is None else [change.to_dict() for change in self.changes],
        }

    def to_json(self) -> str:
        return json.dumps(self.to_dict(), indent=2, allow_nan=False, ensure_ascii=False) + "\n"

    # ------------------------------------------------------------------ sections

    def sections(self) -> list[Section]:
        """Everything that is shown, in order; the goals come last."""
        found = [
            self._ranking("single", "Inverse dynamics, one call", charts=("single",)),
            self._batches(),
            self._ranking("threads"),
            self._ranking("forward"),
            self._methods(),
            self._models(),
            self._chains(),
            self._fresh(),
            self._not_ranked(),
            self._comparison(),
            Section("method", "How it was measured", remarks=tuple(self.notes())),
            self._goals(),
        ]
        return [section for section in found if section is not None]

    def ranked(self, block: str) -> list[Result]:
        """A block's results, fastest row first; what is wrong or has no time comes last."""
        return sorted(
            self.of(block), key=lambda r: (r.status != "ok", r.per_row is None, r.per_row[2] if r.per_row else 0.0)
        )

    def _ranking(self, block: str, title: str | None = None, charts: tuple[str, ...] = ()) -> Section | None:
        mine = self.ranked(block)
        if not mine:
            return None
        known, per_row = next((name, per_row) for key, name, per_row, _ in self.blocks if key == block)
        limited = any(result.limit_ratios for result in mine)
        unit, scale = ("ns a row", 1.0) if per_row else ("µs", 1000.0)
        header = ("", "case", f"median, {unit}", "quartiles", "× rnea", "quartiles")
        header += ("× limit", "error") if limited else ("error",)
        lines, rank = [], 0
        for result in mine:
            ok = result.status == "ok"
            rank += ok
            error = "" if result.error is None else f"{result.error:.0e}"
            times, ratio, limit = result.per_row, result.ratio, result.limit_ratio
            shown = _median(times, scale) if ok else f"{result.status.upper()} {_median(times, scale)}".strip()
            cells = (str(rank) if ok else "–", result.title, shown, _range(times, scale), _median(ratio), _range(ratio))
            cells += (_median(limit), error) if limited else (error,)
            lines.append(Line(cells, _tone(result)))
        remarks = self._control() if block == "threads" else ()
        return Section(block, title or known, header, tuple(lines), remarks, charts, text_columns=(1,))

    def _control(self) -> tuple[str, ...]:
        """What the machine itself gives to two threads: without it a gain of ours, or none, says nothing."""
        one, two = self.find("limit_threads_1"), self.find("limit_threads_2")
        if one is None or two is None or not one.samples or not two.samples:
            return ()
        gain = float(np.median([x / y for x, y in zip(one.samples, two.samples, strict=True)]))
        said = f"Control: two threads make the limit itself {gain:.2f} times as fast."
        if gain < goals.CONTROL:
            said += " The machine had no second core, or no more memory bandwidth, to give; the goal cannot be judged."
        return (said,)

    def _batches(self) -> Section | None:
        mine = [result for result in self.results if result.block.startswith("batch_") and result.contender]
        if not mine:
            return None
        sizes = sorted({result.rows for result in mine})
        names = list(dict.fromkeys(result.contender for result in mine))
        lines = []
        for name in names:
            own = {result.rows: result for result in mine if result.contender == name}
            title = next(iter(own.values())).title
            cells = [title]
            for rows in sizes:
                result = own.get(rows)
                if result is None:
                    cells.append("")
                elif result.status != "ok":
                    cells.append(result.status.upper())
                else:
                    cells.append(f"{_median(result.per_row)} ({_range(result.per_row)})")
            largest = own[max(own)]
            place = "" if max(own) == sizes[-1] else f" (N = {max(own):,})"
            cells += [f"{cell}{place}" if cell else "" for cell in map(_median, (largest.limit_ratio, largest.ratio))]
            errors = [result.error for result in own.values() if result.error is not None]
            cells.append(f"{max(errors):.0e}" if errors else "")
            lines.append(Line(tuple(cells), _tone(largest)))
        header = ("ns a row: median (quartiles)", *(f"N = {rows:,}" for rows in sizes))
        header += ("× limit, largest N", "× rnea, largest N", "error")
        remarks = (
            "What goes row by row in Python is measured on small batches only; its ratios are at its own largest N.",
            "A batch of one is the same row every time: a route that starts from its last pose has nothing to close.",
        )
        return Section("batch", "Inverse dynamics, batches", header, tuple(lines), remarks, ("batch", "limit"))

    def _methods(self) -> Section | None:
        mine = [result for result in self.of("methods") if not result.key.endswith(YARDSTICK)]
        if not mine:
            return None
        routes = list(dict.fromkeys(result.title.split(": ")[0] for result in mine))
        names = list(dict.fromkeys(result.title.split(": ")[1] for result in mine))
        lines = []
        for name in names:
            cells = [name]
            for route in routes:
                result = next(r for r in mine if r.title == f"{route}: {name}")
                ok = result.status == "ok"
                times = f"{_median(result.per_row, 1e3)} ({_range(result.per_row, 1e3)})"
                cells.append(times if ok else result.status.upper())
            lines.append(Line(tuple(cells)))
        header = ("µs a call: median (quartiles)", *routes)
        return Section("methods", "Other methods, one call", header, tuple(lines))

    def _models(self) -> Section | None:
        lines = []
        for name in (*GRBDA, "platform"):
            mine = self.of(f"models_{name}")
            if not mine:
                continue
            for result in mine:
                ok = result.status == "ok"
                times = _median(result.per_row, 1e3) if ok else result.status.upper()
                error = "" if result.error is None else f"{result.error:.0e}"
                what = f"{result.title} ({result.note})" if result.note and result.rows > 1 else result.title
                cells = (name, what, times, _range(result.per_row, 1e3), _median(result.ratio), error)
                lines.append(Line(cells, _tone(result)))
            if name not in GRBDA:
                continue
            shipped, generated = GRBDA[name]
            said = "GRBDA (C++), positions given; measured elsewhere on this kind of machine"
            lines.append(Line((name, f"{said}: as shipped", digits(shipped), "", "", ""), "absent"))
            lines.append(Line((name, f"{said}: its generated C", digits(generated), "", "", ""), "absent"))
        if not lines:
            return None
        header = ("file", "case", "µs", "quartiles", "× rnea", "error")
        remarks = (
            "The four-bar and six-bar files name no configuration, and zero is singular or open there: a home pose is "
            "added to their text.",
            "The four-bar file is a parallelogram. The chain of one loop below is a four-bar of four lengths.",
            "The platform is generated here: a planar 3-RRR.",
            self._closure_remark(),
        )
        title = "Other mechanisms"
        return Section("models", title, header, tuple(lines), remarks, text_columns=(0, 1))

    def _closure_remark(self) -> str:
        """How the symbolic route closed the loops of everything that was measured."""
        ways: dict[str, list[str]] = {}
        for result in self.results:
            if result.note and result.status == "ok" and result.rows > 1:
                own = result.block.startswith("batch_")
                name = self.leg if own else result.key.removesuffix("_symbolic_batch").replace("_", " ")
                if name not in ways.setdefault(result.note, []):
                    ways[result.note].append(name)
        said = "; ".join(f"{note}: {', '.join(names)}" for note, names in ways.items())
        return (
            f"Symbolic route, {said or 'not measured'}. Explicit formulas iterate nothing; a walk begins at the home "
            "pose in every call, so that a pose near the last one gains nothing. The naive way closes by Newton's "
            "method from the last pose, and GRBDA leaves the closure to its caller."
        )

    def _chains(self) -> Section | None:
        mine = [(int(r.block.split("_")[1]), r) for r in self.results if r.block.startswith("chains_")]
        if not mine:
            return None
        counts = sorted({loops for loops, _ in mine})
        lines = []
        for title in dict.fromkeys(result.title for _, result in mine):
            own = {loops: result for loops, result in mine if result.title == title}
            cells = [title]
            for loops in counts:
                result = own[loops]
                cells.append(
                    f"{_median(result.per_row, 1e3)} ({_median(result.ratio)} × rnea)"
                    if result.status == "ok"
                    else result.status.upper()
                )
            lines.append(Line(tuple(cells), _tone(own[counts[0]])))
        header = ("µs, median", *(f"{loops} loop{'s' * (loops > 1)}, {3 * loops} bodies" for loops in counts))
        remark = "Generated planar chains of four-bar linkages, each carried by the coupler of the one before."
        remarks = (remark, self._closure_remark())
        return Section("chains", "Scaling with bodies and loops", header, tuple(lines), remarks, ("chains",))

    def _fresh(self) -> Section | None:
        if not self.figures:
            return None
        lines = []
        for figure in self.figures:
            if not figure.samples:
                lines.append(Line((figure.title, "NOT AVAILABLE", "", figure.unit), "absent"))
                continue
            values = spread(figure.samples)
            lines.append(Line((figure.title, _median(values), _range(values), figure.unit)))
        header = ("figure", "median", "quartiles", "unit")
        return Section("fresh", "Fresh processes: cold start, compilation, memory", header, tuple(lines))

    def failures(self) -> list[str]:
        """A line about each case that is not ranked."""
        lines = [f"{r.title}: {r.status.upper()}: {r.reason}" for r in self.results if r.status != "ok"]
        lines += [f"{f.title}: NOT AVAILABLE: {f.reason}" for f in self.figures if not f.samples]
        # The same contender fails for the same reason in every batch and chain.
        counts: dict[str, int] = {}
        for line in lines:
            counts[line] = counts.get(line, 0) + 1
        return [line if count == 1 else f"{line} ({count} times)" for line, count in counts.items()]

    def _not_ranked(self) -> Section | None:
        failures = self.failures()
        return Section("failures", "Not ranked", remarks=tuple(failures)) if failures else None

    def _comparison(self) -> Section | None:
        if self.changes is None:
            return None
        titles = {key: title for key, title, _, _ in self.blocks}
        lines = [
            Line(
                (
                    titles.get(change.block, change.block),
                    change.title,
                    f"{digits(change.before[1])} ({digits(change.before[0])} – {digits(change.before[2])})",
                    f"{digits(change.after[1])} ({digits(change.after[0])} – {digits(change.after[2])})",
                    f"{change.factor:.2f}",
                    change.words,
                ),
                ("bad" if change.factor > 1.0 else "good") if change.beyond else "",
            )
            for change in self.changes
        ]
        then = self.compared_with
        commit = (then.get("commit") or {}).get("name", "unknown commit")
        flagged = sum(change.beyond for change in self.changes)
        controls = sum(change.control for change in self.changes)
        drift = self.changes[0].drift if self.changes else 1.0
        remarks = [
            f"Earlier run: {then.get('date', 'unknown date')}, {then.get('cpu', 'unknown processor')}, {commit}.",
            f"{flagged} of {len(lines) - controls} ratios changed: their quartile ranges (with fewer than "
            f"{comparison.FEW} rounds their whole ranges) do not meet, and they moved by more than nine of ten of the "
            f"{controls} controls, which are not this project's code: {drift:.2f} ×.",
        ]
        if then.get("cpu") != self.environment.get("cpu"):
            remarks.append("The processors differ: ratios between kinds of work need not carry over.")
        header = ("block", "case", "× rnea before", "× rnea now", "factor", "verdict")
        title = "Compared with an earlier run"
        return Section("comparison", title, header, tuple(lines), tuple(remarks), text_columns=(0, 1))

    def _goals(self) -> Section:
        lines = []
        for outcome in self.outcomes():
            sign = "≤" if outcome.relation == "<=" else "≥"
            measured = "" if outcome.measured is None else digits(outcome.measured)
            quartiles = "" if outcome.quartiles is None else " – ".join(digits(x) for x in outcome.quartiles)
            tone = {"met": "good", "missed": "bad"}.get(outcome.verdict, "absent")
            goal = f"{sign} {digits(outcome.target)} {outcome.unit}"
            lines.append(Line((outcome.metric, goal, measured, quartiles, outcome.words), tone))
        met = sum(outcome.verdict == "met" for outcome in self.outcomes())
        missed = sum(outcome.verdict == "missed" for outcome in self.outcomes())
        absent = len(lines) - met - missed
        remark = f"{met} met, {missed} missed, {absent} not measured. A goal is no test: it is to be beaten."
        header = ("metric", "goal", "measured", "quartiles", "verdict")
        return Section("goals", "Goals", header, tuple(lines), (remark,), text_columns=(0, 1, 4))

    def notes(self) -> list[str]:
        """How to read the tables."""
        settings = self.settings
        return [
            f"Accuracy comes before time: every torque is held against the pinocchio route at {settings.states:,} "
            "random states, corners of the joint limits and nearly straight legs (gamma → 0) among them, and parts of "
            f"the pinocchio route against the closed form; other methods at {settings.method_states} of them. `error` "
            f"is the worst one, relative to 1 + magnitude. Above {TOLERANCE:.0e} a case is WRONG: its time is greyed "
            "and ranks nowhere.",
            f"One process, interleaved: up to {settings.repetitions} rounds a block, each visits every case of the "
            f"block in turn for {settings.minimum_ns / 1e6:g} ms or more (calls are repeated as often as that takes), "
            "garbage collection off, after a warm-up. Medians and quartiles over the rounds.",
            "A ratio is taken pair by pair within a round, to one pin.rnea of the open tree and to the limit, and then "
            "its median. Read ratios, not microseconds.",
            "The limit is C written by hand for the shipped leg's closed form with the widest vectors of the machine, "
            "compiled when it is measured; it validates nothing, and its output array is given. A call of it from "
            "Python goes through ctypes, which costs more than the C itself for less than about 1,000 rows. CasADi's "
            "generated C is what code generation alone gives.",
            f"The trajectory is the leg's own at {settings.rate:g} samples a second, there and back without a jump; "
            "each call has a new q and starts from the last. Rows of batches are random states.",
            "`leg.torque` validates its arguments. The naive case shares no code with the project: pinocchio's "
            "constraint Jacobian on point pairs, numpy.linalg.pinv, plain Newton. MuJoCo's loops are soft, so that "
            "mj_inverse as it is takes part of the motors' torque for constraint force.",
            "pinocchio's constraintDynamics and lcaba know no gear couplings: those are imposed by multipliers, at one "
            "more solution for each and one for the result.",
            "Fresh processes have a cache folder of their own, and Python's bytecode is written before. `Caches cold` "
            "also reads and checks the file anew.",
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
        compiler = e.get("compiler") or "no GCC: no limit"
        return [
            ("date", e["date"]),
            ("processor", f"{e['cpu']}, {e['cores']} cores, {e['system']}, vectors {e.get('vectors') or 'unknown'}"),
            ("versions", f"{e['python']}, {versions}, {compiler}"),
            ("BLAS threads", f"{e['blas'] or 'unknown library'}; {threads}"),
            ("load average", load or "unknown"),
            ("commit", tree),
        ]

    # ------------------------------------------------------------------ renderings

    def to_markdown(self) -> str:
        lines = [f"# {self.title}", ""]
        lines += ["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in self.surroundings())]
        for section in self.sections():
            lines += ["", f"## {section.title}", ""]
            if section.header:
                rule = ["---" if i in section.text_columns else "--:" for i in range(len(section.header))]
                lines += [_row(section.header), f"|{'|'.join(rule)}|"]
                lines += [_row(_struck(line)) for line in section.lines]
                lines += [""] if section.remarks else []
            lines += [f"- {remark}" for remark in section.remarks]
        return "\n".join([*lines, ""])

    def to_html(self) -> str:
        from benchmarks.page import render

        return render(self)

    def __rich__(self) -> Any:
        from rich.console import Group
        from rich.markup import escape
        from rich.table import Table

        facts = Table(show_header=False, box=None, title=self.title)
        for name, value in self.surroundings():
            facts.add_row(name, escape(value))
        parts: list[Any] = [facts]
        styles = {"wrong": "bright_black", "absent": "bright_black", "good": "green", "bad": "red", "own": "bold"}
        for section in self.sections():
            if section.header:
                table = Table(title=section.title)
                for number, name in enumerate(section.header):
                    table.add_column(name, justify="left" if number in section.text_columns else "right")
                for line in section.lines:
                    table.add_row(*(escape(cell) for cell in line.cells), style=styles.get(line.tone))
                parts.append(table)
            else:
                parts.append(f"[bold]{escape(section.title)}[/bold]")
            parts += [escape(f"- {remark}") for remark in section.remarks]
        return Group(*parts)


def _tone(result: Result) -> str:
    if result.status == "wrong":
        return "wrong"
    if result.status != "ok":
        return "absent"
    return "" if result.peer or result.key.endswith(YARDSTICK) else "own"


def _struck(line: Line) -> tuple[str, ...]:
    """Markdown knows no grey: the times of a wrong case are struck through."""
    if line.tone != "wrong":
        return line.cells
    last = len(line.cells) - 1
    return tuple(f"~~{cell}~~" if cell and 2 < i < last else cell for i, cell in enumerate(line.cells))


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
