"""A study as one self-contained HTML page: numbers, drawings and styles inside, nothing from a network."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from leg_dynamics.analysis.design.figures import caption, study_figures
from leg_dynamics.analysis.design.result import StageResult, StudyResult
from leg_dynamics.analysis.pages import drawing, html_page, table

__all__ = ["render_page"]


def render_page(result: StudyResult) -> str:
    """Return the page as HTML text.

    Parameters
    ----------
    result : StudyResult

    Returns
    -------
    str
    """
    study = result.study
    filters = ", ".join(str(each) for each in study.filters) or "none"
    body = [
        f"<h1>Design study of {escape(study.leg.name)}</h1>",
        f'<p class="soft">Seed {study.seed}; filters: {escape(filters)}; constraints left out: '
        f"{escape(', '.join(study.ignore) or 'none')}. {escape(result.to_dict()['resolution'])}.</p>",
    ]
    for stage in result.stages:
        body += _stage(stage)
    chosen = result.chosen_parameters()
    if chosen is not None:
        rows = [(name, f"{value:.6g}", study.leg.parameters[name].unit) for name, value in chosen.items()]
        body += ["<h2>Chosen design</h2>", *table(("parameter", "value", "unit"), rows)]
    for name, figure in study_figures(result).items():
        body += drawing(figure, caption(name))
    meanings = [(each.name, each.unit, each.meaning) for each in study.objectives]
    body += ["<h2>Objectives</h2>", *table(("name", "unit", "meaning"), meanings)]
    return html_page(f"Design study of {study.leg.name}", body)


def _stage(stage: StageResult) -> Iterable[str]:
    facts = stage.to_dict()
    kind = "Sweeps" if facts["kind"] == "sweep" else f"Stage {stage.number + 1}"
    yield f"<h2>{kind}: {escape(', '.join(facts['ranges']))}</h2>"
    failed = ", ".join(f"{name} {count}" for name, count in facts["reasons"].items())
    yield (
        f'<p class="soft">{facts["designs"]:,} designs, {facts["accepted"]:,} accepted, {facts["failed"]:,} failed'
        f"{escape(f' ({failed})' if failed else '')}. {escape(facts['why_none'])}</p>"
    )
    percentiles = facts["accepted_percentiles"]
    rows = [
        (
            name,
            "" if name not in facts["medians"] else f"{facts['medians'][name]:.5g}",
            *(f"{value:.5g}" for value in percentiles.get(name, {}).values()),
            *([""] * (3 if name not in percentiles else 0)),
        )
        for name in {**facts["medians"], **percentiles}
    ]
    yield from table(("", "median of valid", "accepted p10", "p50", "p90"), rows)
