"""A paper's verdicts as one self-contained HTML page: styles, drawings and script inside, nothing from a network."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from leg_dynamics.papers.framework import Figure, Status

if TYPE_CHECKING:
    from leg_dynamics.papers.framework import PaperReport, Section, Verdict

__all__ = ["render_page"]

_CLASSES = {
    Status.CONFIRMED: ("confirmed", "✓"),
    Status.CORRECTED: ("corrected", "✎"),
    Status.NOT_REPRODUCIBLE: ("open", "?"),
    Status.OUT_OF_REACH: ("away", "–"),
}
_MEANINGS = {
    Status.CONFIRMED: "holds as printed, with the numbers beside it",
    Status.CORRECTED: "wrong or ambiguous as printed; both forms were computed, the difference is stated",
    Status.NOT_REPRODUCIBLE: "the paper leaves something out that the result depends on",
    Status.OUT_OF_REACH: "needs hardware, or is not about this leg",
}
_SHORT = {Status.NOT_REPRODUCIBLE: "not reproducible", Status.OUT_OF_REACH: "out of reach"}
_PLURALS = {"equation": "Equations", "table": "Tables", "figure": "Figures", "claim": "Claims"}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_STYLE = """
:root { color-scheme: light dark; --paper: #fbfaf7; --card: #ffffff; --ink: #22262b; --soft: #5c6570; --line: #dedbd3;
  --link: #1f5f99; --confirmed: #2b7a4b; --corrected: #b4560a; --open: #7450a3; --away: #69727c; --code: #f3f1ec; }
@media (prefers-color-scheme: dark) { :root { --paper: #16191d; --card: #1e2227; --ink: #e4e6e8; --soft: #a2abb5;
  --line: #363c44; --link: #85b9ea; --confirmed: #6fc792; --corrected: #efa25c; --open: #bda0e8; --away: #a2abb5;
  --code: #262b31; } }
* { box-sizing: border-box; }
html { scroll-behavior: smooth; scroll-padding-top: 4rem; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 16px/1.55 system-ui, -apple-system, "Segoe UI",
  "Noto Sans", "DejaVu Sans", sans-serif; }
main, header, footer { max-width: 68rem; margin: 0 auto; padding: 0 1.25rem; }
header { padding-top: 2.5rem; }
h1 { font-size: 2rem; line-height: 1.2; margin: 0 0 .5rem; letter-spacing: -.01em; }
h2 { font-size: 1.4rem; margin: 3rem 0 .75rem; padding-top: .75rem; border-top: 1px solid var(--line); }
h3 { font-size: 1.05rem; margin: 2rem 0 .5rem; }
p { margin: .5rem 0; max-width: 52rem; }
a { color: var(--link); text-decoration-thickness: 1px; text-underline-offset: 2px; }
.soft, .note, figcaption { color: var(--soft); }
.note, figcaption { font-size: .9rem; }
nav { position: sticky; top: 0; z-index: 2; background: var(--paper); border-bottom: 1px solid var(--line); }
nav div { max-width: 68rem; margin: 0 auto; padding: .5rem 1.25rem; display: flex; flex-wrap: wrap; gap: .25rem 1.1rem;
  font-size: .92rem; }
nav a { text-decoration: none; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(13rem, 1fr)); gap: .8rem;
  margin: 1.25rem 0 1rem; }
.tile { background: var(--card); border: 1px solid var(--line); border-left: 5px solid var(--c); border-radius: 8px;
  padding: .7rem .9rem; }
.tile b { display: block; font-size: 1.9rem; line-height: 1.15; color: var(--c); font-variant-numeric: tabular-nums; }
.tile span { font-weight: 600; }
.tile small { display: block; color: var(--soft); line-height: 1.35; }
.bar { display: flex; height: .6rem; border-radius: 5px; overflow: hidden; gap: 2px; }
.bar i { background: var(--c); flex: var(--n) 0 0; }
.confirmed { --c: var(--confirmed); } .corrected { --c: var(--corrected); }
.open { --c: var(--open); } .away { --c: var(--away); }
.badge { display: inline-block; color: var(--c); border: 1.5px solid var(--c); border-radius: 1rem;
  padding: .05rem .6rem; font-size: .82rem; font-weight: 600; line-height: 1.35; }
.chips { display: flex; flex-wrap: wrap; gap: .3rem; margin: .3rem 0 .9rem; }
.chips a { color: var(--c); border: 1.5px solid var(--c); border-radius: 6px; padding: .05rem .45rem; font-size: .85rem;
  text-decoration: none; font-variant-numeric: tabular-nums; max-width: 22rem; }
.chips a:hover { background: var(--c); color: var(--paper); }
.scroll { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; width: 100%; font-size: .93rem; }
th { text-align: left; font-weight: 600; color: var(--soft); border-bottom: 2px solid var(--line); }
th, td { padding: .45rem .7rem .45rem 0; vertical-align: top; }
td { border-bottom: 1px solid var(--line); }
.numbers { font-variant-numeric: tabular-nums; }
.numbers td { overflow-wrap: break-word; }
.verdicts > tbody > tr > td:first-child { width: 9rem; font-weight: 600; }
.verdicts > tbody > tr > td:last-child { width: 10.5rem; text-align: right; padding-right: 0; }
tr[hidden] { display: none !important; }
.verdicts > tbody > tr:target { background: color-mix(in srgb, var(--link) 12%, transparent); }
.verdicts > tbody > tr > td:first-child { padding-left: .4rem; }
.title { font-weight: 600; }
.forms { display: grid; grid-template-columns: max-content 1fr; gap: .15rem .8rem; margin: .5rem 0;
  background: var(--code); border-radius: 6px; padding: .5rem .75rem; overflow-x: auto; }
.forms dt { color: var(--soft); font-size: .85rem; } .forms dd { margin: 0; white-space: pre-wrap;
  font-family: "STIX Two Math", "Cambria Math", "DejaVu Serif", Georgia, serif; }
details { margin-top: .4rem; } summary { cursor: pointer; color: var(--link); font-size: .88rem; }
details table { font-size: .85rem; margin-top: .3rem; }
figure { margin: 1.4rem 0; background: #ffffff; border: 1px solid var(--line); border-radius: 8px; overflow: hidden; }
figure .scroll { margin: 0; }
figure img { display: block; width: 100%; height: auto; padding: .6rem; background: #ffffff; }
figcaption { background: var(--card); padding: .6rem .9rem .7rem; border-top: 1px solid var(--line); }
figcaption b { color: var(--ink); }
.filter { display: flex; flex-wrap: wrap; gap: .4rem; margin: .6rem 0; }
.filter button { font: inherit; font-size: .88rem; color: var(--ink); background: var(--card); cursor: pointer;
  border: 1px solid var(--line); border-radius: 6px; padding: .2rem .7rem; }
.filter button[aria-pressed=true] { border-color: var(--link); box-shadow: inset 0 0 0 1px var(--link); }
.fails { color: #c62f2f; font-weight: 700; }
footer { margin-top: 3rem; padding-top: 1rem; padding-bottom: 3rem; border-top: 1px solid var(--line);
  font-size: .9rem; }
@media (max-width: 44rem) { table, tbody { display: block; } thead { display: none; }
  .verdicts > tbody > tr, .numbers tr { display: block; padding: .6rem 0; border-bottom: 1px solid var(--line); }
  .numbers tr { padding: .35rem 0; }
  .verdicts > tbody > tr > td, .numbers td { display: block; width: auto !important; border: 0;
    text-align: left !important; padding: .1rem 0; }
  .numbers td:first-child { font-weight: 600; } .numbers td:empty { display: none; }
  .numbers td[data-label]:not(:first-child)::before { content: attr(data-label) ": "; color: var(--soft); }
  .forms { grid-template-columns: 1fr; }
  figure img { width: 46rem; max-width: none; } nav { position: static; } }
@media print { nav, .filter { display: none; } figure, tr { break-inside: avoid; } }
"""

_SCRIPT = """
for (const button of document.querySelectorAll('.filter button')) button.addEventListener('click', () => {
  for (const other of document.querySelectorAll('.filter button')) other.setAttribute('aria-pressed', other === button);
  const wanted = button.dataset.status;
  for (const row of document.querySelectorAll('tr[data-status]'))
    row.hidden = wanted !== '' && row.dataset.status !== wanted;
});
const all = document.querySelector('.filter button[data-status=""]');
addEventListener('hashchange', () => {
  const row = document.getElementById(location.hash.slice(1));
  if (row && row.hidden) { all.click(); row.scrollIntoView(); }
});
"""


def render_page(report: PaperReport, pictures: Mapping[str, str]) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    report : PaperReport
    pictures : mapping of str to str
        SVG text of each plot, by its name.

    Returns
    -------
    str
    """
    placed = {name for section in report.sections for name in section.plots}
    loose = [plot.name for plot in report.plots if plot.name not in placed]
    links = [("summary", "Summary"), ("verdicts", "Verdicts")]
    links += [(section.name, section.title) for section in report.sections]
    body = [
        f"<header><h1>{escape(report.title)}</h1>",
        f'<p class="soft">{escape(report.paper)}</p></header>',
        '<nav aria-label="Parts"><div>',
        *(f'<a href="#{escape(name)}">{escape(title)}</a>' for name, title in links),
        "</div></nav><main>",
        *_summary(report),
        *_verdicts(report),
        *(part for section in report.sections for part in _section(report, section, pictures)),
    ]
    if loose:
        body += ['<h2 id="plots">Plots</h2>', *(_picture(report, name, pictures) for name in loose)]
    versions = ", ".join(f"{escape(name)} {escape(version)}" for name, version in report.versions.items())
    body += [
        "</main>",
        f"<footer><p>Every number on this page was computed when it was made, from {report.samples} random states with "
        f"seed {report.seed} where it says random states; the same versions give the same numbers. What the paper "
        f"prints is quoted as such. Made with {versions}.</p></footer>",
        f"<script>{_SCRIPT}</script>",
    ]
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
    return "\n".join(
        [
            '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(report.title)}</title><style>{_STYLE}</style></head><body>",
            *body,
            "</body></html>\n",
        ]
    )


def _summary(report: PaperReport) -> list[str]:
    counts = report.counts()
    parts = ['<section id="summary"><div class="tiles">']
    for status, count in counts.items():
        name, sign = _CLASSES[status]
        parts.append(
            f'<div class="tile {name}"><b>{count}</b><span>{sign} {escape(status.value)}</span>'
            f"<small>{escape(_MEANINGS[status])}</small></div>"
        )
    parts.append("</div><div class='bar' aria-hidden='true'>")
    parts += [f'<i class="{_CLASSES[s][0]}" style="--n:{count}"></i>' for s, count in counts.items() if count]
    parts.append(f"</div><p>{len(report.verdicts)} items were judged. Each chip leads to its verdict.</p>")
    for kind in report.counts_by_kind():
        parts.append(f'<h3>{_PLURALS[kind]}</h3><div class="chips">')
        for verdict in report.verdicts:
            if verdict.kind == kind:
                name, sign = _CLASSES[verdict.status]
                label = escape(_label(verdict))
                parts.append(
                    f'<a class="{name}" href="#{verdict.anchor}" title="{escape(verdict.status.value)}">'
                    f"{sign} {label}</a>"
                )
        parts.append("</div>")
    if report.checks:
        parts.append("<h3>What must hold, or nothing here counts</h3>")
        parts.append(
            f"<p>Checks of this project, not of the paper, and not counted above: {escape(report.held())}.</p>"
        )
        parts.append('<div class="scroll"><table class="numbers"><thead><tr><th>Check</th><th>Error</th>')
        parts.append("<th>Tolerance</th><th></th><th>Over</th></tr></thead><tbody>")
        for check in report.checks:
            state = '<span class="fails">fails</span>' if check.state == "fails" else check.state
            error = "–" if check.value is None else f"{_number(check.value, 2)} {escape(check.unit)}"
            parts.append(
                f'<tr><td>{escape(check.name)}</td><td data-label="error">{error}</td>'
                f'<td data-label="tolerance">{_number(check.tolerance, 2)}</td><td>{state}</td>'
                f"<td>{escape(check.of)}</td></tr>"
            )
        parts.append("</tbody></table></div>")
    return [*parts, "</section>"]


def _verdicts(report: PaperReport) -> list[str]:
    parts = ['<h2 id="verdicts">Verdicts</h2><div class="filter" role="group" aria-label="Show">']
    parts.append('<button type="button" data-status="" aria-pressed="true">all</button>')
    for status, count in report.counts().items():
        if count:
            name, sign = _CLASSES[status]
            parts.append(
                f'<button type="button" data-status="{name}" aria-pressed="false">{sign} {escape(status.value)} '
                f"({count})</button>"
            )
    parts.append("</div>")
    anchors = {verdict.item: verdict.anchor for verdict in report.verdicts}
    for kind in report.counts_by_kind():
        parts.append(f'<h3>{_PLURALS[kind]}</h3><table class="verdicts"><thead><tr><th>Item</th><th>Finding</th>')
        parts.append("<th></th></tr></thead><tbody>")
        for verdict in report.verdicts:
            if verdict.kind == kind:
                parts += _verdict(report, verdict, anchors)
        parts.append("</tbody></table>")
    return parts


def _verdict(report: PaperReport, verdict: Verdict, anchors: Mapping[str, str]) -> list[str]:
    name, sign = _CLASSES[verdict.status]
    parts = [
        f'<tr id="{verdict.anchor}" data-status="{name}"><td>{escape(_label(verdict))}</td>',
        f'<td><div class="title">{escape(verdict.title)}</div>{_linked(verdict.finding, anchors, verdict.item)}',
    ]
    if verdict.printed or verdict.corrected:
        parts.append('<dl class="forms">')
        for label, form in (("printed", verdict.printed), ("corrected", verdict.corrected)):
            if form:
                parts.append(f"<dt>{label}</dt><dd>{escape(form)}</dd>")
        parts.append("</dl>")
    plots = [plot for plot in report.plots if verdict.item in plot.items]
    if plots:
        shown = ", ".join(f'<a href="#plot-{escape(plot.name)}">{escape(plot.title)}</a>' for plot in plots)
        parts.append(f'<div class="note">Drawn: {shown}</div>')
    if verdict.figures:
        count = len(verdict.figures)
        parts.append(f"<details><summary>{count} computed number{'s' if count > 1 else ''}</summary>")
        parts.append('<div class="scroll"><table class="numbers"><tbody>')
        parts += [_figure_row(figure) for figure in verdict.figures]
        parts.append("</tbody></table></div></details>")
    badge = escape(_SHORT.get(verdict.status, verdict.status.value))
    full = escape(verdict.status.value)
    parts.append(f'</td><td><span class="badge {name}" title="{full}">{sign} {badge}</span></td></tr>')
    return parts


def _label(verdict: Verdict) -> str:
    """The item's name where its kind is said already."""
    return verdict.item.removeprefix("claim: ")


def _figure_row(figure: Figure) -> str:
    return (
        f"<tr><td>{escape(figure.name)}</td><td>{_number(figure.value)} {escape(figure.unit)}</td>"
        f"<td>{escape(figure.of)}</td></tr>"
    )


def _section(report: PaperReport, section: Section, pictures: Mapping[str, str]) -> list[str]:
    anchors = {verdict.item: verdict.anchor for verdict in report.verdicts}
    parts = [f'<section><h2 id="{escape(section.name)}">{escape(section.title)}</h2>']
    parts += [f"<p>{_linked(paragraph, anchors)}</p>" for paragraph in section.paragraphs]
    if section.rows:
        cells = "".join(f"<th>{escape(cell)}</th>" for cell in section.header)
        parts.append(f'<div class="scroll"><table class="numbers"><thead><tr>{cells}</tr></thead><tbody>')
        parts += [_row(section.header, row) for row in section.rows]
        parts.append("</tbody></table></div>")
    if section.note:
        parts.append(f'<p class="note">{escape(section.note)}</p>')
    return [*parts, *(_picture(report, name, pictures) for name in section.plots), "</section>"]


def _row(header: Sequence[str], cells: Sequence[str]) -> str:
    """A row whose cells know their heading: on a narrow screen they stand below each other without the head."""
    labelled = zip(header, cells, strict=True)
    return f"<tr>{''.join(f'<td{_labelled(name)}>{_text(cell)}</td>' for name, cell in labelled)}</tr>"


def _labelled(name: str) -> str:
    return f' data-label="{escape(name)}"' if name else ""


def _picture(report: PaperReport, name: str, pictures: Mapping[str, str]) -> str:
    plot = next(plot for plot in report.plots if plot.name == name)
    data = base64.b64encode(pictures[name].encode("utf-8")).decode("ascii")
    return (
        f'<figure id="plot-{escape(name)}"><div class="scroll" tabindex="0"><img '
        f'alt="{escape(f"{plot.title}. {plot.caption}")}" src="data:image/svg+xml;base64,{data}"></div>'
        f"<figcaption><b>{escape(plot.title)}.</b> {escape(plot.caption)}</figcaption></figure>"
    )


def _linked(text: str, anchors: Mapping[str, str], own: str = "") -> str:
    """Escaped text in which the other items, such as (13) or Fig. 5, lead to their verdicts."""

    def link(match: re.Match[str]) -> str:
        item = match.group(0)
        return f'<a href="#{anchors[item]}">{item}</a>' if item in anchors and item != own else item

    return re.sub(r"\(\d+\)|(?:Fig\.|Table) \d+", link, _text(text))


def _text(text: str) -> str:
    """Escaped text with powers of ten written out: 2.5e-05 becomes 2.5 × 10⁻⁵."""

    def power(match: re.Match[str]) -> str:
        return f"{match[1]} × 10{str(int(match[2])).translate(_SUPERSCRIPTS)}"

    return re.sub(r"\b(\d+(?:\.\d+)?)e([+-]\d+)\b", power, escape(text))


def _number(value: float, digits: int = 6) -> str:
    if not math.isfinite(value):
        return "–"
    return _text(f"{value + 0.0:.{digits}g}")
