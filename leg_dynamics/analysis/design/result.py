"""What came out of a study: its tables, the accepted designs and the chosen one, and their files."""

from __future__ import annotations

import csv
import json
import math
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.analysis.design.study import Plan, Row, Study
from leg_dynamics.analysis.workspace.result import plain

if TYPE_CHECKING:
    from leg_dynamics.leg import Leg

__all__ = ["StageResult", "StudyResult"]

PERCENTILES = (10, 50, 90)
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d.]*(e[-+]?\d+)?")


@dataclass(frozen=True)
class StageResult:
    """One stage's table.

    Attributes
    ----------
    study : Study
    number : int
        Counted from 0.
    base : dict of str to float
        What earlier stages chose.
    rows : tuple of Row
    chosen : Row or None
        None of a sweep, or where nothing is accepted.
    """

    study: Study
    number: int
    base: dict[str, float]
    rows: tuple[Row, ...]
    chosen: Row | None

    @staticmethod
    def of(study: Study, number: int, base: dict[str, float], rows: list[Row]) -> StageResult:
        """Choose a design among the rows."""
        draft = StageResult(study, number, dict(base), tuple(rows), None)
        return StageResult(study, number, dict(base), tuple(rows), draft._choose())

    def _choose(self) -> Row | None:
        accepted = [row for row in self.rows if row.accepted]
        if self.study.stages[self.number].is_sweep or not accepted:
            return None
        rule, _, target = self.study.choose.partition(":")
        if rule == "median":
            ranges = self.study.stages[self.number].ranges
            shares = np.array(
                [[(row.design[r.name] - r.lower) / (r.upper - r.lower) for r in ranges] for row in accepted]
            )
            distance = ((shares - np.median(shares, axis=0)) ** 2).sum(axis=1)
            return accepted[int(np.argmin(distance))]
        values = np.array([row.values[target] for row in accepted])
        if np.isnan(values).all():
            return None
        return accepted[int(np.nanargmin(values) if rule == "min" else np.nanargmax(values))]

    def column(self, name: str, *, accepted: bool = False) -> np.ndarray:
        """A parameter or an objective of all rows, or of the accepted ones; NaN where it does not exist."""
        rows = [row for row in self.rows if row.accepted or not accepted]
        default = self.base.get(name, math.nan)
        if name not in self.base and name in self.study.leg.parameters:
            default = self.study.leg.parameters[name].value
        return np.array([row.values[name] if name in row.values else row.design.get(name, default) for row in rows])

    def medians(self) -> dict[str, float]:
        """Median of every objective over the designs that did not fail and have it."""
        found, valid = {}, np.array([row.status == "ok" for row in self.rows])
        for each in self.study.objectives:
            values = self.column(each.name)
            values = values[np.isfinite(values) & valid]
            found[each.name] = float(np.median(values)) if values.size else math.nan
        return found

    def percentiles(self) -> dict[str, dict[str, float]]:
        """p10, p50 and p90 of every varied parameter and objective over the accepted rows; empty without any."""
        found: dict[str, dict[str, float]] = {}
        names = [r.name for r in self.study.stages[self.number].ranges] + [o.name for o in self.study.objectives]
        for name in names:
            values = self.column(name, accepted=True)
            values = values[np.isfinite(values)]
            if values.size:
                numbers = np.percentile(values, PERCENTILES)
                found[name] = {f"p{p}": float(v) for p, v in zip(PERCENTILES, numbers, strict=True)}
        return found

    def reasons(self) -> dict[str, int]:
        """How many rows failed for each class of error."""
        return dict(Counter(row.reason.partition(":")[0] for row in self.rows if row.status != "ok"))

    def commonest_reason(self) -> str:
        """Reason of a failed design, of those that fail most often alike but for numbers; empty without any."""
        alike: dict[str, list[str]] = {}
        for row in self.rows:
            if row.status != "ok":
                alike.setdefault(_NUMBER.sub("", row.reason), []).append(row.reason)
        if not alike:
            return ""
        most = max(alike.values(), key=len)
        return f"{most[0]} ({len(most)} of {len(self.rows)} designs)"

    def why_none(self) -> str:
        """Which filters the designs fail, and the best value of each."""
        parts = []
        for each in self.study.filters:
            values = self.column(each.name)
            values = values[np.isfinite(values)]
            if values.size:
                best = values.max() if each.comparison.startswith(">") else values.min()
                share = float(np.mean(each.passes(values)))
                parts.append(f"{each} holds in {100 * share:.3g} % of the designs, the best has {best:.6g}")
        failed = sum(row.status != "ok" for row in self.rows)
        if failed:
            parts.append(
                f"{failed} of {len(self.rows)} designs are impossible or have no workspace or step, most often "
                f"{self.commonest_reason()}"
            )
        return "; ".join(parts) or "no row is valid"

    def to_dict(self) -> dict[str, Any]:
        """The summary as JSON-ready values."""
        stage = self.study.stages[self.number]
        chosen = self.chosen
        return {
            "kind": "sweep" if stage.is_sweep else "monte_carlo",
            "ranges": [str(each) for each in stage.ranges],
            "base": self.base,
            "designs": len(self.rows),
            "failed": sum(row.status != "ok" for row in self.rows),
            "reasons": self.reasons(),
            "commonest_reason": self.commonest_reason(),
            "accepted": sum(row.accepted for row in self.rows),
            "medians": self.medians(),
            "accepted_percentiles": self.percentiles(),
            "chosen": None if chosen is None else {"index": chosen.index, **chosen.design, **chosen.values},
            "why_none": self.why_none() if not any(row.accepted for row in self.rows) else "",
        }


@dataclass(frozen=True)
class StudyResult:
    """A finished study.

    Attributes
    ----------
    study : Study
    plan : Plan
        How its rows were computed.
    stages : tuple of StageResult
    """

    study: Study
    plan: Plan
    stages: tuple[StageResult, ...]

    @property
    def chosen(self) -> Row | None:
        """The design that the last stage chose."""
        return self.stages[-1].chosen

    @property
    def any_possible(self) -> bool:
        """Whether some design of some stage did not fail."""
        return any(row.status == "ok" for stage in self.stages for row in stage.rows)

    def why_nothing(self) -> str:
        """One sentence on a study whose designs all failed; empty where some did not."""
        if self.any_possible:
            return ""
        first = self.stages[0]
        return (
            f"none of the {len(first.rows)} designs is possible, most often by {first.commonest_reason()}: vary other "
            "ranges, or change the leg that the study starts from"
        )

    def chosen_parameters(self) -> dict[str, float] | None:
        """What ``leg_dynamics.load(NAME, parameters=...)`` makes the chosen design of: its own changes, and the leg's.

        None where nothing was chosen.
        """
        if self.chosen is None:
            return None
        recipe: Any = self.study.leg.recipe
        return {**dict(recipe.overrides), **self.chosen.design}

    def chosen_leg(self) -> Leg | None:
        """The chosen design, rendered from its source and read like any leg."""
        return None if self.chosen is None else self.study.leg.replace(**self.chosen.design)

    def to_dict(self) -> dict[str, Any]:
        """The summary as JSON-ready values."""
        plan = self.plan
        return {
            "leg": self.study.leg.name,
            "digest": self.study.digest(),
            "inputs": self.study.inputs(),
            "units": self.study.columns,
            "objectives": {each.name: each.meaning for each in self.study.objectives},
            "evaluation": "one kernel for all designs" if plan.numbers is not None else f"single: {plan.why_single}",
            "masses": plan.masses,
            "samples_a_design": plan.resolution.samples,
            "half_widths": plan.resolution.half_widths,
            "resolution": plan.resolution.justification if plan.resolution.samples and self.any_possible else "",
            "stages": [stage.to_dict() for stage in self.stages],
            "chosen_parameters": self.chosen_parameters(),
        }

    def table(self) -> dict[str, list[Any]]:
        """All rows as columns, units in the names."""
        units = {name: "" if unit == "1" else f" [{unit}]" for name, unit in self.study.columns.items()}
        found: dict[str, list[Any]] = {"stage": [], "index": []}
        found |= {f"{name}{unit}": [] for name, unit in units.items()}
        found |= {"accepted": [], "status": [], "reason": []}
        for stage in self.stages:
            count = len(stage.rows)
            found["stage"] += [stage.number + 1] * count
            found["index"] += [row.index for row in stage.rows]
            for name, unit in units.items():
                found[f"{name}{unit}"] += stage.column(name).tolist()
            for key in ("accepted", "status", "reason"):
                found[key] += [getattr(row, key) for row in stage.rows]
        return found

    def write(self, folder: str | Path, figures: bool = True) -> tuple[Path, ...]:
        """Write the results into a folder.

        designs.csv (also .parquet where pyarrow is installed), summary.json, the plots, and of the chosen design
        chosen.yaml (its parameters) and chosen.urdf (the URDF+ that they render to).

        Parameters
        ----------
        folder : str or Path
            Made where it does not exist.
        figures : bool
            Whether to draw the plots as PNG.

        Returns
        -------
        tuple of Path
            The files written.
        """
        import yaml

        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        table = self.table()
        written = [place / "designs.csv"]
        with written[0].open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(table)
            writer.writerows(zip(*([_cell(value) for value in column] for column in table.values()), strict=True))
        written += _write_parquet(place / "designs.parquet", table)
        written.append(place / "summary.json")
        written[-1].write_text(json.dumps(plain(self.to_dict()), indent=2, allow_nan=False) + "\n", encoding="utf-8")
        leg, parameters = self.chosen_leg(), self.chosen_parameters()
        if leg is not None and parameters is not None:
            written += [place / "chosen.yaml", place / "chosen.urdf"]
            note = f"# Parameters of the chosen design of {leg.name}; the others are those of its source.\n"
            text = yaml.safe_dump({name: float(value) for name, value in parameters.items()}, sort_keys=False)
            written[-2].write_text(note + text, encoding="utf-8")
            written[-1].write_text(leg.description.urdf, encoding="utf-8", newline="\n")
        if figures:
            from leg_dynamics.analysis.design.figures import study_figures

            for name, figure in study_figures(self).items():
                path = place / f"{name}.png"
                figure.savefig(path)
                written.append(path)
        return tuple(written)


def _cell(value: Any) -> str:
    """Text that reads back to the same bits; nothing where there is no number."""
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(value)
    return str(value).lower() if isinstance(value, bool) else str(value)


def _write_parquet(path: Path, table: dict[str, list[Any]]) -> list[Path]:
    try:
        import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
        from pyarrow import parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        return []
    parquet.write_table(pyarrow.table(table), path)
    return [path]
