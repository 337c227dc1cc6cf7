"""A workspace as one self-contained HTML page: numbers, drawings and styles inside, nothing from a network."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from html import escape

from leg_dynamics.analysis.workspace.figures import CAPTIONS, workspace_figures
from leg_dynamics.analysis.workspace.result import Workspace

__all__ = ["render_page"]

_STYLE = """
:root { color-scheme: light dark; --paper: #fbfaf7; --card: #fff; --ink: #22262b; --soft: #5c6570; --line: #dedbd3; }
@media (prefers-color-scheme: dark) { :root { --paper: #16191d; --card: #1e2227; --ink: #e4e6e8; --soft: #a2abb5;
  --line: #363c44; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 66rem; padding: 2rem 1.25rem 3rem; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", "Noto Sans", "DejaVu Sans", sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.3rem; margin: 2.2rem 0 .6rem; padding-top: .7rem; border-top: 1px solid var(--line); }
.soft, figcaption { color: var(--soft); font-size: .93rem; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(11rem, 1fr)); gap: .8rem; margin: 1.2rem 0; }
.tile { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: .6rem .9rem; }
.tile b { display: block; font-size: 1.5rem; font-variant-numeric: tabular-nums; }
.tile small { color: var(--soft); display: block; line-height: 1.35; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .93rem; font-variant-numeric: tabular-nums; }
th { text-align: left; color: var(--soft); border-bottom: 2px solid var(--line); }
th, td { padding: .35rem .8rem .35rem 0; vertical-align: top; } td { border-bottom: 1px solid var(--line); }
figure { margin: 1.2rem 0; background: #fff; border: 1px solid var(--line); border-radius: 8px; overflow: hidden; }
figure img { display: block; width: 100%; height: auto; padding: .5rem; }
figcaption { background: var(--card); padding: .6rem .9rem; border-top: 1px solid var(--line); }
"""


def render_page(result: Workspace) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    result : Workspace

    Returns
    -------
    str
    """
    left_out = f"; left out: {', '.join(result.ignored)}" if result.ignored else ""
    body = [
        f"<h1>Workspace of {escape(result.leg)}</h1>",
        f'<p class="soft">Hip frame, route {escape(result.route)}, {len(result.constraints)} constraints'
        f"{escape(left_out)}. {escape(result.justification)}.</p>",
        '<div class="tiles">',
        *(
            f"<div class='tile'><b>{escape(value)}</b><small>{escape(what)}</small></div>"
            for value, what in _facts(result)
        ),
        "</div>",
        *_step(result),
    ]
    for name, figure in workspace_figures(result).items():
        picture = io.BytesIO()
        figure.savefig(picture, format="svg", metadata={"Date": None})
        data = base64.b64encode(picture.getvalue()).decode("ascii")
        body.append(
            f'<figure><img alt="{escape(CAPTIONS[name])}" src="data:image/svg+xml;base64,{data}">'
            f"<figcaption>{escape(CAPTIONS[name])}</figcaption></figure>"
        )
    shares, ends = result.active_shares(), result.border_shares()
    rows = [
        (c.name, c.meaning, f"{100 * shares.get(c.name, 0.0):.1f} %", str(ends.get(c.name, 0)))
        for c in result.constraints
    ]
    body += ["<h2>Constraints</h2>", *_table(("constraint", "holds where", "nearest in", "boundary points"), rows)]
    levels = [
        (f"{level.samples:,}", f"{level.volume:.6g}", f"{level.half_width:.2g}", f"{level.change:.2g}")
        for level in result.levels
    ]
    body += ["<h2>Convergence</h2>", *_table(("samples", f"V [{result.unit}]", "half width", "change"), levels)]
    if result.parameters:
        values = [(name, f"{value:.6g}") for name, value in result.parameters.items()]
        body += ["<h2>Parameters</h2>", *_table(("name", "value"), values)]
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    return "\n".join(
        [
            '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>Workspace of {escape(result.leg)}</title><style>{_STYLE}</style></head><body>",
            *body,
            "</body></html>\n",
        ]
    )


def _facts(result: Workspace) -> Iterable[tuple[str, str]]:
    yield f"{result.volume.value:.4g} {result.unit}", f"volume, ± {result.volume.half_width:.2g}"
    if result.injectivity.cartesian is not None:
        other = result.injectivity.cartesian
        yield f"{other.value:.4g} {result.unit}", f"volume by foot positions, ± {other.half_width:.2g}"
    for k, axis in enumerate("xyz"):
        yield f"{result.lower[k]:.3f} … {result.upper[k]:.3f}", f"{axis}, m"
    unit = result.dexterity.unit
    length = result.dexterity.characteristic_length
    scaled = "" if length is None else f", rad columns over {length:.4g} m"
    yield f"{result.mean.value:.4g}", f"mean condition number (31), ± {result.mean.half_width:.2g}{scaled}"
    yield f"{result.deviation.value:.4g}", f"its deviation (32, corrected), ± {result.deviation.half_width:.2g}"
    yield f"{result.dexterity.smallest:.4g}", "least condition number"
    yield f"{result.dexterity.smallest_singular_value:.3g} {unit}", "smallest singular value"


def _step(result: Workspace) -> Iterable[str]:
    step = result.step
    if step is None:
        return [f'<p class="soft">No step sizes: {escape(result.step_reason)}.</p>']
    rows = [
        ("L, chord through home", step.length, f"{step.start_limit} … {step.end_limit}"),
        ("longest chord", step.longest, f"at z = {step.longest_height:.4f} m"),
        ("x-extent of the workspace", step.extent, ""),
        ("Z_f", step.front, f"x = {step.front_at[0]:.4f} m, {step.front_limit}"),
        ("Z_b", step.back, f"x = {step.back_at[0]:.4f} m, {step.back_limit}"),
    ]
    table = _table(("size", "m", "limited by"), [(name, f"{value:.4f}", by) for name, value, by in rows])
    return ["<h2>Step length and height</h2>", *table, f'<p class="soft">{escape(step.definition)}.</p>']


def _table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    cells = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    lines = [f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows]
    return [f'<div class="scroll"><table><thead><tr>{cells}</tr></thead><tbody>', *lines, "</tbody></table></div>"]
