"""Self-contained HTML pages of the analyses: styles and drawings inside, nothing from a network."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["drawing", "html_page", "table", "tiles"]

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


def html_page(title: str, body: Iterable[str]) -> str:
    """The whole page as HTML text.

    Parameters
    ----------
    title : str
        Escaped here.
    body : iterable of str
        HTML, which must be escaped already.

    Returns
    -------
    str
    """
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    return "\n".join(
        [
            '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>",
            *body,
            "</body></html>\n",
        ]
    )


def tiles(facts: Iterable[tuple[str, str]]) -> list[str]:
    """Values in large type, each with what it is below."""
    cells = (f"<div class='tile'><b>{escape(value)}</b><small>{escape(what)}</small></div>" for value, what in facts)
    return ['<div class="tiles">', *cells, "</div>"]


def drawing(figure: Figure, caption: str) -> list[str]:
    """A figure as inline SVG image with its caption."""
    picture = io.BytesIO()
    figure.savefig(picture, format="svg", metadata={"Date": None})
    data, words = base64.b64encode(picture.getvalue()).decode("ascii"), escape(caption)
    image = f'<figure><img alt="{words}" src="data:image/svg+xml;base64,{data}">'
    return [f"{image}<figcaption>{words}</figcaption></figure>"]


def table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """A table that scrolls where it is too wide; cells are texts and are escaped."""
    cells = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    lines = [f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows]
    return [f'<div class="scroll"><table><thead><tr>{cells}</tr></thead><tbody>', *lines, "</tbody></table></div>"]
