"""A gait study as one self-contained HTML page: numbers, limits, drawings; nothing from a network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import TYPE_CHECKING, Any

from leg_dynamics.analysis.gait.figures import CAPTIONS, gait_figures
from leg_dynamics.analysis.gait.report import summary
from leg_dynamics.analysis.gait.study import GaitStudy
from leg_dynamics.analysis.pages import drawing, html_page, table, tiles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["render_page"]

_NEAREST = 6
"""Limits of each leg that are listed: the nearest."""


def render_page(study: GaitStudy, figures: Mapping[str, Figure] | None = None) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    study : GaitStudy
    figures : mapping of str to Figure, optional
        From `leg_dynamics.analysis.gait.figures.gait_figures`, where they are drawn already.

    Returns
    -------
    str
    """
    facts = summary(study)
    title = f"{facts['gait']} gait of {facts['robot']}"
    body = [
        f"<h1>{escape(title[:1].upper() + title[1:])}</h1>",
        f'<p class="soft">Period {facts["period [s]"]:g} s, duty factor {facts["duty"]:.4g}, path law '
        f"{escape(facts['path_law'])}; foot forces: {escape(facts['load'])}.</p>",
        *tiles(_facts(facts)),
        *_chosen(facts),
        *_compared(facts),
        "<h2>Limits</h2>",
        f'<p class="soft">Signed margins over the cycle, the {_NEAREST} nearest of each leg, in the order of margin '
        "over half range; passive joints, ball joints, telescopes and clearances included.</p>",
        *table(("leg", "limit", "holds where", "least margin", "over half range", "at"), _limits(facts)),
    ]
    for name, figure in (gait_figures(study) if figures is None else figures).items():
        body += drawing(figure, CAPTIONS[name])
    return html_page(title, body)


def _chosen(facts: Mapping[str, Any]) -> Iterable[str]:
    if not facts["choices"]:
        return
    yield "<h2>Why it walks like this</h2>"
    yield from table(("parameter", "value", "why"), (each.values() for each in facts["choices"]))


def _compared(facts: Mapping[str, Any]) -> Iterable[str]:
    """How the body's motion changes the stability."""
    bound = facts["margin_bound [m]"]
    if bound is None and not facts["alternatives"]:
        return
    yield "<h2>Stability and the motion of the body</h2>"
    if bound is not None:
        yield (
            f'<p class="soft">With these feet, steps and times no motion of the body has a least margin above '
            f"{1e3 * bound:.1f} mm: where one foot touches down and another lifts off, the centre of mass has to be "
            "over the feet that stand before and over those that stand after.</p>"
        )
    if facts["alternatives"]:
        ends = ", ".join(
            f"{name} {1e3 * low:.0f} … {1e3 * high:.0f} mm"
            for name, (low, high) in facts["sway [m]"].items()
            if high > low
        )
        rows = [(each["walk"], _margin(each["least_margin [m]"])) for each in facts["alternatives"]]
        rows.append((f"this walk; sway {ends}", _margin(facts["stability_margin [m]"]["least"])))
        yield from table(("body motion", "least static stability margin"), rows)


def _margin(value: float | None) -> str:
    return "a foot is out of reach" if value is None else f"{round(1e3 * value, 2) + 0.0:.2f} mm"


def _facts(facts: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    forward, left = facts["velocity [m/s]"]
    yield f"{forward:.3g} m/s", f"ahead; {left:.3g} m/s left, {facts['turn [rad/s]']:.3g} rad/s"
    yield f"{facts['stride [m]']:.4g} m", f"stride; clearance {facts['clearance [m]']:.4g} m"
    margin = facts["stability_margin [m]"]
    least = "none" if margin["least"] is None else f"{margin['least']:.4f} m"
    yield least, f"least static stability margin, at {margin['at [s]']:.4g} s"
    roll, pitch = (" … ".join(f"{end:.3g}" for end in facts["body_tilt [rad]"][name]) for name in ("roll", "pitch"))
    yield f"{facts['body_height [m]']:.4g} m", f"body height; roll {roll} rad, pitch {pitch} rad"
    nearest = facts["nearest_limit"]
    if nearest is not None:
        yield f"{nearest['margin']:.4g} {nearest['unit']}", f"to the nearest limit, {nearest['limit']}"
    yield f"{facts['largest_foot_force [N]']:.0f} N", f"largest foot force; mass {facts['mass [kg]']:.4g} kg"


def _limits(facts: Mapping[str, Any]) -> Iterable[tuple[str, ...]]:
    rows = [row for leg in facts["legs"] for row in leg["limits"][:_NEAREST]]
    for row in [*facts["limits_between_legs"], *rows]:
        broken = "" if row["holds"] else " BROKEN"
        margin, share = f"{row['margin']:.4g} {row['unit']}{broken}", f"{row['normalised']:.3f}"
        yield row["leg"], row["limit"], row["holds_where"], margin, share, f"{row['at [s]']:.4g} s"
