"""The workspace of a leg as one result: what was computed, how well it is known, and its files."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from leg_dynamics.analysis.dexterity import Dexterity
from leg_dynamics.analysis.workspace.constraints import Constraint
from leg_dynamics.analysis.workspace.foot import Slice
from leg_dynamics.analysis.workspace.poses import Poses
from leg_dynamics.analysis.workspace.sampling import CONFIDENCE, Estimate, Level
from leg_dynamics.analysis.workspace.step import Step

__all__ = ["Injectivity", "Workspace"]

SETTLED = 0.1
"""Half width, as a share of the value, above which an interval says nothing."""


@dataclass(frozen=True)
class Injectivity:
    """Evidence that one foot position has one feasible pose, which the volume as an integral of |det J| rests on.

    Attributes
    ----------
    checked : int
        Samples whose foot position was solved for again, over all branches of the inverse kinematics.
    several : float
        Share of them with more than one feasible pose.
    cartesian : Estimate or None
        m^3: the volume by foot positions in a box and inverse kinematics, which counts each position once.
    samples : int
        Foot positions taken for it.
    other_sign : float
        m^3: volume of feasible poses with the other sign of det J, beyond a singularity. They are not counted.
    """

    checked: int
    several: float
    cartesian: Estimate | None
    samples: int
    other_sign: float


@dataclass(frozen=True)
class Workspace:
    """The reachable set of a leg's foot, in the hip frame, m.

    Attributes
    ----------
    leg, route : str
    joint_names, joint_units : tuple of str
    parameters : mapping of str to float
        Design parameters that the leg was made with.
    constraints : tuple of Constraint
    ignored : tuple of str
        Names or kinds of constraints that were left out.
    poses : Poses
        The feasible samples; `active` counts in `constraints`.
    weights : (N,) array
        Volume that each stands for, m^n (n coordinates); they add up to `volume`.
    volume : Estimate
        m^3, m^2 for two coordinates, m for one.
    mean, deviation : Estimate
        Condition number: Rong 2012 (31), and (32) corrected.
    dexterity : Dexterity
    lower, upper : (3,) array
        Corners of the bounding box, m.
    best : Poses
        The pose with the least condition number.
    border : Poses
        Feasible poses at the boundary.
    border_active : (M,) array of int
        Constraint that is broken just beyond each.
    step : Step or None
        None where the leg has no inverse kinematics, or its home position is not feasible: `step_reason` says why.
    step_reason : str
    slices : tuple of Slice
    injectivity : Injectivity
    levels : tuple of Level
    tolerance : float
    converged : bool
    sampled, evaluated : int
        Samples of the volume; poses evaluated for everything.
    seconds : float
        Spent on the samples of the volume.
    seed : int
    down : float
        +1 where the hip frame's z points down, -1 where it points up.
    """

    leg: str
    route: str
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    parameters: dict[str, float]
    constraints: tuple[Constraint, ...]
    ignored: tuple[str, ...]
    names: dict[int, str]
    poses: Poses
    weights: np.ndarray
    volume: Estimate
    mean: Estimate
    deviation: Estimate
    dexterity: Dexterity
    lower: np.ndarray
    upper: np.ndarray
    best: Poses
    border: Poses
    border_active: np.ndarray
    step: Step | None
    step_reason: str
    slices: tuple[Slice, ...]
    injectivity: Injectivity
    levels: tuple[Level, ...]
    tolerance: float
    converged: bool
    sampled: int
    evaluated: int
    seconds: float
    seed: int
    down: float

    @property
    def unit(self) -> str:
        """Unit of the volume."""
        return {1: "m", 2: "m²"}.get(len(self.joint_names), "m³")

    @property
    def deviation_is_settled(self) -> bool:
        """Whether the interval of the deviation (32) says anything.

        Where a singular pose is inside, k grows as 1 / distance and the integral of its square with the number of
        samples: there is no value.
        """
        return bool(self.deviation.half_width <= SETTLED * self.deviation.value)

    @property
    def justification(self) -> str:
        """Why the resolution is what it is, in one sentence."""
        last = self.levels[-1]
        width, change = last.half_width / last.volume, last.change / last.volume
        verdict = "within" if self.converged else "NOT within"
        return (
            f"{self.sampled:,} samples of 16 independently scrambled Sobol sequences: their spread puts V within "
            f"± {100 * width:.2g} % ({100 * CONFIDENCE:g} % confidence) and the last doubling moved it by "
            f"{100 * change:.2g} %, {verdict} the {100 * self.tolerance:g} % asked for"
        )

    def active_shares(self) -> dict[str, float]:
        """Share of the volume in which each constraint is the nearest, by name, largest first."""
        shares = np.bincount(np.maximum(self.poses.active, 0), self.weights, max(len(self.constraints), 1))
        total = shares.sum()
        order = np.argsort(-shares, kind="stable")
        return {self.names[int(k)]: float(shares[k] / total) for k in order if shares[k] > 0.0 and self.constraints}

    def border_shares(self) -> dict[str, int]:
        """Boundary points that each constraint ends, by name, most first."""
        index, count = np.unique(self.border_active, return_counts=True)
        order = np.argsort(-count, kind="stable")
        return {self.names[int(index[k])]: int(count[k]) for k in order}

    def to_dict(self) -> dict[str, Any]:
        """The summary as JSON-ready values: everything but the samples, the boundary and the slices."""
        best = {name: float(value) for name, value in zip(self.joint_names, self.best.q[0], strict=True)}
        return {
            "leg": self.leg,
            "route": self.route,
            "frame": "hip",
            "parameters": self.parameters,
            "constraints": [asdict(each) for each in self.constraints],
            "ignored": list(self.ignored),
            "volume": self.volume.to_dict() | {"unit": self.unit, "confidence": CONFIDENCE},
            "box": {"lower": self.lower.tolist(), "upper": self.upper.tolist(), "unit": "m"},
            "condition_number": self.dexterity.to_dict()
            | {
                "mean_half_width": self.mean.half_width,
                "deviation_half_width": self.deviation.half_width if self.deviation_is_settled else None,
                "deviation_is_settled": self.deviation_is_settled,
                "definition": "of the foot Jacobian by the actuators; mean: integral of k dV / V; deviation: root of "
                "the integral of (k - mean)^2 dV / V",
                "best_pose": best,
                "best_foot": self.best.foot[0].tolist(),
            },
            "step": None if self.step is None else self.step.to_dict(),
            "step_reason": self.step_reason,
            "active_constraints": self.active_shares(),
            "boundary": {"points": len(self.border), "ended_by": self.border_shares()},
            "injectivity": asdict(self.injectivity),
            "convergence": [asdict(level) for level in self.levels],
            "resolution": self.justification,
            "tolerance": self.tolerance,
            "converged": self.converged,
            "samples": self.sampled,
            "feasible_samples": len(self.poses),
            "poses_evaluated": self.evaluated,
            "poses_a_second": self.sampled / self.seconds if self.seconds > 0.0 else None,
            "seed": self.seed,
        }

    def columns(self, poses: Poses, active: np.ndarray) -> dict[str, np.ndarray]:
        """Poses as named columns, units in the names."""
        units = np.array([self._unit_of(k) for k in range(-3, len(self.constraints))])
        names = np.array([self.names.get(k, "") for k in range(-3, len(self.constraints))])
        table = {
            f"{name} [{unit}]": poses.q[:, k]
            for k, (name, unit) in enumerate(zip(self.joint_names, self.joint_units, strict=True))
        }
        table |= {f"{axis} [m]": poses.foot[:, k] for k, axis in enumerate("xyz")}
        return table | {
            "condition": poses.condition,
            f"sigma_min [{self.dexterity.unit}]": poses.smallest,
            "constraint": names[active + 3],
            "margin": poses.margin,
            "margin_unit": units[active + 3],
            "normalised_margin": poses.normalised,
        }

    def _unit_of(self, index: int) -> str:
        return self.constraints[index].unit if index >= 0 else ""

    def write(self, folder: str | Path, figures: bool = True) -> tuple[Path, ...]:
        """Write summary.json, samples.csv, boundary.csv (also .parquet where pyarrow is installed) and the plots.

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
        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        summary = place / "summary.json"
        summary.write_text(json.dumps(plain(self.to_dict()), indent=2, allow_nan=False) + "\n", encoding="utf-8")
        written = [summary]
        samples = self.columns(self.poses, self.poses.active)
        samples[f"weight [{self.unit.replace('³', '^3').replace('²', '^2')}]"] = self.weights
        for name, table in (("samples", samples), ("boundary", self.columns(self.border, self.border_active))):
            written += _write_table(place / name, table)
        if figures:
            from leg_dynamics.analysis.workspace.figures import workspace_figures

            for name, figure in workspace_figures(self).items():
                path = place / f"{name}.png"
                figure.savefig(path)
                written.append(path)
        return tuple(written)


def _texts(column: np.ndarray) -> Iterable[str]:
    # ten digits: the samples are no more exact than that, and the file is half as large
    return column.tolist() if column.dtype.kind == "U" else map("{:.10g}".format, column.tolist())


def _write_table(stem: Path, table: dict[str, np.ndarray]) -> Iterator[Path]:
    path = stem.with_suffix(".csv")
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(table)
        writer.writerows(zip(*map(_texts, table.values()), strict=True))
    yield path
    try:
        import pyarrow  # type: ignore[import-not-found,import-untyped,unused-ignore]
        from pyarrow import parquet  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        return
    path = stem.with_suffix(".parquet")
    parquet.write_table(pyarrow.table(table), path)
    yield path


def plain(value: Any) -> Any:
    """Only what JSON knows: NaN and infinity become None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


Progress = Callable[[str, float], None]
