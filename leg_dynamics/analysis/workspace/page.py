"""A workspace as one self-contained HTML page: numbers, drawings and styles inside, nothing from a network."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from leg_dynamics.analysis.pages import drawing, html_page, table, tiles
from leg_dynamics.analysis.workspace.figures import CAPTIONS, workspace_figures
from leg_dynamics.analysis.workspace.result import Workspace

__all__ = ["render_page"]


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
        *tiles(_facts(result)),
        *_step(result),
    ]
    for name, figure in workspace_figures(result).items():
        body += drawing(figure, CAPTIONS[name])
    shares, ends = result.active_shares(), result.border_shares()
    rows = [
        (c.name, c.meaning, f"{100 * shares.get(c.name, 0.0):.1f} %", str(ends.get(c.name, 0)))
        for c in result.constraints
    ]
    body += ["<h2>Constraints</h2>", *table(("constraint", "holds where", "nearest in", "boundary points"), rows)]
    levels = [
        (f"{level.samples:,}", f"{level.volume:.6g}", f"{level.half_width:.2g}", f"{level.change:.2g}")
        for level in result.levels
    ]
    body += ["<h2>Convergence</h2>", *table(("samples", f"V [{result.unit}]", "half width", "change"), levels)]
    if result.parameters:
        values = [(name, f"{value:.6g}") for name, value in result.parameters.items()]
        body += ["<h2>Parameters</h2>", *table(("name", "value"), values)]
    return html_page(f"Workspace of {result.leg}", body)


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
    if result.deviation_is_settled:
        yield f"{result.deviation.value:.4g}", f"its deviation (32, corrected), ± {result.deviation.half_width:.2g}"
    else:
        most = float(result.poses.condition.max())
        yield f"{result.deviation.value:.4g}", f"its deviation, not settled: up to {most:.3g} in these samples"
    yield f"{result.dexterity.smallest:.4g}", "least condition number"
    yield f"{result.dexterity.smallest_singular_value:.3g} {unit}", "smallest singular value of the samples"


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
    rows_of = table(("size", "m", "limited by"), [(name, f"{value:.4f}", by) for name, value, by in rows])
    note = [f"<p>{escape(step.note)}.</p>"] if step.note else []
    return ["<h2>Step length and height</h2>", *rows_of, *note, f'<p class="soft">{escape(step.definition)}.</p>']
