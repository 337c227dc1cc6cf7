"""Charts of a report as inline SVG; nothing of matplotlib's global state is touched."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import matplotlib
from matplotlib.figure import Figure as Canvas

from benchmarks.cases import YARDSTICK

if TYPE_CHECKING:
    from benchmarks.report import Report, Result

# Okabe and Ito's palette; the project's own curves are blue, the limit is black.
OWN, LIMIT, WRONG, PEER = "#0072B2", "#000000", "#b8b8b8", "#8a6d3b"
COLOURS = {
    "limit": "#000000",
    "kernel": "#56B4E9",
    "closed_form": "#0072B2",
    "closed_form_out": "#0072B2",
    "symbolic": "#009E73",
    "generated": "#666666",
    "vectorised": "#E69F00",
    "well_used": "#CC79A7",
    "mujoco": "#D55E00",
    "naive": "#8B1A1A",
    "pinocchio": "#9467bd",
}
DASHES = {"limit": "-", "closed_form_out": ":", "kernel": "--", "generated": "-."}


def charts(report: Report) -> dict[str, str]:
    """Every chart that the report has data for, by name, as an <svg> element."""
    drawn = {
        "single": _single,
        "batch": lambda r: _batch(r, "ns a row", lambda x: x.per_row),
        "limit": lambda r: _batch(r, "times the limit", lambda x: x.limit_ratio),
        "chains": _chains,
    }
    found = {}
    style = {"svg.fonttype": "none", "font.family": "sans-serif", "font.size": 10, "axes.spines.top": False}
    style |= {"axes.spines.right": False, "axes.grid": True, "grid.color": "#e4e4e4", "axes.axisbelow": True}
    with matplotlib.rc_context(style):
        for name, draw in drawn.items():
            with matplotlib.rc_context({"svg.hashsalt": name}):
                canvas = draw(report)
                if canvas is not None:
                    found[name] = _svg(canvas)
    return found


def _svg(canvas: Canvas) -> str:
    """The element alone: without a document type it fits into a page, without metadata nothing points outside."""
    stream = io.StringIO()
    canvas.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]


def _single(report: Report) -> Canvas | None:
    mine = [result for result in report.ranked("single") if result.per_row is not None]
    if not mine:
        return None
    canvas = Canvas(figsize=(10, 0.36 * len(mine) + 1.1), layout="constrained")
    axes = canvas.subplots()
    for place, result in enumerate(reversed(mine)):
        low, mid, high = (x / 1e3 for x in result.per_row[1:])  # type: ignore[index]
        wrong = result.status != "ok"
        colour = WRONG if wrong else LIMIT if result.key.startswith("limit") else PEER if result.peer else OWN
        if result.key.endswith(YARDSTICK):
            colour = "#555555"
        axes.barh(place, mid, color=colour, hatch="//" if wrong else None, edgecolor="white")
        axes.plot([low, high], [place, place], color="black", linewidth=1)
        label = f"  {mid:.3g} µs" + (" WRONG" if wrong else "")
        axes.text(max(mid, high), place, label, va="center", color="#888888" if wrong else "black", fontsize=9)
    axes.set_yticks(range(len(mine)), [result.title for result in reversed(mine)], fontsize=9)
    axes.set_xscale("log")
    axes.set_xlabel("µs a call, median (line: quartiles)")
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.18)
    return canvas


def _batch(report: Report, label: str, value: Callable[[Result], Any]) -> Canvas | None:
    mine = [r for r in report.results if r.block.startswith("batch_") and r.contender and r.status == "ok" and value(r)]
    if not mine:
        return None
    canvas = Canvas(figsize=(10, 5.4), layout="constrained")
    axes = canvas.subplots()
    for name in dict.fromkeys(result.contender for result in mine):
        own = sorted((result for result in mine if result.contender == name), key=lambda result: result.rows)
        rows = [result.rows for result in own]
        spreads = [value(result) for result in own]
        colour = COLOURS.get(str(name), "#777777")
        style = DASHES.get(str(name), "-")
        axes.plot(rows, [s[2] for s in spreads], style, marker="o", markersize=4, color=colour, label=own[0].title)
        axes.fill_between(rows, [s[1] for s in spreads], [s[3] for s in spreads], color=colour, alpha=0.15, linewidth=0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("rows N in one call")
    axes.set_ylabel(f"{label}, median (band: quartiles)")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    return canvas


def _chains(report: Report) -> Canvas | None:
    mine = [(int(r.block.split("_")[1]), r) for r in report.results if r.block.startswith("chains_")]
    mine = [(loops, r) for loops, r in mine if r.status == "ok" and r.per_row is not None]
    if not mine:
        return None
    canvas = Canvas(figsize=(10, 4.2), layout="constrained")
    axes = canvas.subplots()
    colours = {"symbolic": "#009E73", "symbolic_batch": "#0072B2", "pinocchio": "#D55E00", None: "#555555"}
    for contender in dict.fromkeys(result.contender for _, result in mine):
        own = sorted((loops, result) for loops, result in mine if result.contender == contender)
        title = own[0][1].title
        spreads = [[x / 1e3 for x in result.per_row or ()] for _, result in own]
        count = [loops for loops, _ in own]
        axes.plot(count, [s[2] for s in spreads], marker="o", color=colours.get(contender), label=title)
        axes.fill_between(
            count,
            [s[1] for s in spreads],
            [s[3] for s in spreads],
            color=colours.get(contender),
            alpha=0.15,
            linewidth=0,
        )
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xticks(sorted({loops for loops, _ in mine}), [str(x) for x in sorted({loops for loops, _ in mine})])
    axes.set_xlabel("four-bar loops (three bodies each)")
    axes.set_ylabel("µs, median (band: quartiles)")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=9)
    return canvas
