"""A report as one HTML file that needs nothing else."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from benchmarks.plots import charts

if TYPE_CHECKING:
    from benchmarks.report import Report, Section

_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.45 system-ui, "Segoe UI", Roboto, sans-serif; color: #1d2430; background: #fff;
  max-width: 1240px; margin: 0 auto; padding: 1.5rem 1.5rem 4rem; }
h1 { font-size: 1.6rem; margin: 0 0 .8rem; }
h2 { font-size: 1.2rem; margin: 2.4rem 0 .6rem; padding-top: .6rem; border-top: 1px solid #dde2ea; }
nav { margin: 1rem 0; display: flex; flex-wrap: wrap; gap: .3rem 1.1rem; font-size: .92rem; }
a { color: #0060a0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .87rem; margin: .4rem 0; }
th, td { padding: .25rem .55rem; border-bottom: 1px solid #edf0f4; text-align: right;
  font-variant-numeric: tabular-nums; white-space: nowrap; }
th { background: #f5f7fa; font-weight: 600; vertical-align: bottom; white-space: normal; }
.text { text-align: left; white-space: normal; min-width: min(13rem, 30vw); }
.facts th { text-align: left; background: none; white-space: nowrap; }
.facts td { text-align: left; white-space: normal; }
td small { display: block; font-weight: 400; font-size: .82em; color: #667085; }
tr.own td { font-weight: 600; }
tr.wrong td { color: #9a9a9a; text-decoration: line-through; }
tr.wrong td.text, tr.wrong td:last-child { text-decoration: none; }
tr.absent td { color: #8a8f98; }
tr.good td:last-child { color: #14713a; font-weight: 600; }
tr.bad td:last-child { color: #b3261e; font-weight: 600; }
.summary { display: flex; flex-wrap: wrap; gap: .8rem; margin: 1rem 0; }
.summary div { border: 1px solid #dde2ea; border-radius: 8px; padding: .6rem 1rem; min-width: 9rem; }
.summary b { display: block; font-size: 1.35rem; }
ul { padding-left: 1.2rem; font-size: .92rem; }
svg { max-width: 100%; height: auto; display: block; margin: .6rem 0; }
"""


def render(report: Report) -> str:
    """Return the page."""
    sections = report.sections()
    drawn = charts(report)
    links = "".join(f'<a href="#{section.key}">{escape(section.title)}</a>' for section in sections)
    facts = "".join(f"<tr><th>{escape(n)}</th><td>{escape(v)}</td></tr>" for n, v in report.surroundings())
    body = "".join(_section(section, drawn) for section in sections)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(report.title)}</title><style>{_STYLE}</style></head><body>"
        f"<h1>{escape(report.title)}</h1>"
        f'<div class="wide"><table class="facts">{facts}</table></div>{_summary(report)}'
        f"<nav>{links}</nav>{body}</body></html>\n"
    )


def _summary(report: Report) -> str:
    """The few numbers that most readers come for."""
    boxes = []

    def box(number: str, words: str) -> None:
        boxes.append(f"<div><b>{escape(number)}</b>{escape(words)}</div>")

    one = report.find("closed_form_fixed")
    if one is not None and one.status == "ok" and one.per_row is not None:
        box(f"{one.per_row[2] / 1e3:.2f} µs", "leg.torque, one call")
        if one.ratio is not None:
            box(f"{one.ratio[2]:.2f} ×", "of one pin.rnea of the open tree")
    large = [rows for rows in report.settings.batch_rows if rows >= 10_000]
    for rows in large[:1]:
        many = report.find(f"closed_form_batch_{rows}")
        if many is not None and many.status == "ok" and many.per_row is not None:
            box(f"{many.per_row[2]:.1f} ns", f"a row, N = {rows:,}, one thread")
            if many.limit_ratio is not None:
                box(f"{many.limit_ratio[2]:.2f} ×", "the hand-written limit, same N")
    outcomes = report.outcomes()
    met = sum(outcome.verdict == "met" for outcome in outcomes)
    judged = sum(outcome.verdict != "not measured" for outcome in outcomes)
    box(f"{met} of {judged}", "measured goals met")
    return f'<div class="summary">{"".join(boxes)}</div>'


def _section(section: Section, drawn: dict[str, str]) -> str:
    parts = [f'<h2 id="{section.key}">{escape(section.title)}</h2>']
    parts += [drawn[name] for name in section.charts if name in drawn]
    if section.header:

        def cell(tag: str, number: int, text: str) -> str:
            kind = ' class="text"' if number in section.text_columns else ""
            head, bracket, rest = escape(text).partition(" (")
            # The spread goes under its median: a wide table then fits.
            small = f"<small>({rest}</small>" if bracket and tag == "td" and not kind else bracket + rest
            return f"<{tag}{kind}>{head}{small}</{tag}>"

        head = "".join(cell("th", i, text) for i, text in enumerate(section.header))
        rows = "".join(
            f'<tr class="{line.tone}">{"".join(cell("td", i, text) for i, text in enumerate(line.cells))}</tr>'
            for line in section.lines
        )
        parts.append(f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>')
    if section.remarks:
        parts.append("<ul>" + "".join(f"<li>{escape(remark)}</li>" for remark in section.remarks) + "</ul>")
    return "".join(parts)
