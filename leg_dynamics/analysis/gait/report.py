"""A gait study as numbers to read: a summary, a table of the cycle, files."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from leg_dynamics.analysis.gait.limits import LimitMargin
from leg_dynamics.analysis.gait.study import GaitStudy, LimbMotion

__all__ = ["FILES", "columns", "limits_of", "summary", "write"]

FILES = (
    "summary.json",
    "cycle.csv",
    "report.html",
    "feet.png",
    "speeds.png",
    "efforts.png",
    "stability.png",
    "limits.png",
)
"""What `write` makes in a folder."""

_LOADS = {
    "balanced": "least foot forces that push only and balance weight and body acceleration at the centre of mass",
    "equal": "equal vertical forces on the standing feet; moments are not balanced",
    "none": "no foot forces: legs carry themselves only",
}


def summary(study: GaitStudy) -> dict[str, Any]:
    """What the study found, as plain numbers, texts, lists and mappings.

    Units are in the names or beside the numbers; coordinates and efforts have the signs of the robot's file.
    """
    walk = study.walk
    return {
        "robot": study.robot.name,
        "gait": walk.table.name,
        "phases": dict(zip(study.robot.leg_names, walk.table.phases, strict=True)),
        "duty": walk.table.duty,
        "period [s]": walk.period,
        "stride [m]": walk.stride,
        "velocity [m/s]": [walk.twist.forward, walk.twist.sideward],
        "turn [rad/s]": walk.twist.turn,
        "clearance [m]": walk.clearance,
        "path_law": walk.law,
        "body_height [m]": float(-walk.homes[:, 2].mean()),
        "body_tilt [rad]": _tilt(study),
        "samples": int(study.time.size),
        "mass [kg]": study.mass,
        "centre_of_mass": "trunk and every moving link of the legs where it is",
        "stability_margin [m]": _range(study.margin, study.time),
        "load": _LOADS[study.load],
        "friction": study.friction,
        "residual [N]": float(study.residual.max()),
        "largest_foot_force [N]": float(np.linalg.norm(study.force, axis=-1).max()),
        "limits_hold": all(each.holds for each in study.limits),
        "nearest_limit": None if not study.limits else _limit(study.nearest_limits()[0], study.time),
        "legs": [_leg(motion) | {"limits": limits_of(study, motion.limb.name)} for motion in study.limbs],
        "limits_between_legs": [_limit(each, study.time) for each in study.nearest_limits() if " + " in each.leg],
    }


def _tilt(study: GaitStudy) -> dict[str, list[float]]:
    """Least and greatest roll and pitch."""
    tilt = study.walk.tilt
    if tilt is None:
        return {"roll": [0.0, 0.0], "pitch": [0.0, 0.0]}
    angles = tilt.value(study.time / study.walk.period, study.walk.period)
    ends = np.stack([angles.min(axis=0), angles.max(axis=0)], axis=1)
    return dict(zip(("roll", "pitch"), ends.tolist(), strict=True))


def limits_of(study: GaitStudy, leg: str) -> list[dict[str, Any]]:
    """What limits one leg, from the nearest to the farthest: name, kind, least margin with its unit and time."""
    return [_limit(each, study.time) for each in study.nearest_limits() if each.leg == leg]


def _limit(each: LimitMargin, time: np.ndarray) -> dict[str, Any]:
    return {
        "limit": each.name,
        "leg": each.leg,
        "kind": each.kind,
        "holds_where": each.meaning,
        "margin": each.least,
        "unit": each.unit,
        "at [s]": float(time[each.row]),
        "normalised": each.least_normalised,
        "holds": each.holds,
    }


def _range(values: np.ndarray, time: np.ndarray) -> dict[str, float | None]:
    least = int(values.argmin())
    ends = {"least": float(values[least]), "at [s]": float(time[least]), "greatest": float(values.max())}
    return {key: value if math.isfinite(value) else None for key, value in ends.items()}


def _leg(motion: LimbMotion) -> dict[str, Any]:
    limb, peaks, limits = motion.limb, motion.peaks(), motion.limb.leg.limits
    signs, (units, effort_units) = limb.signs, _units(limb)
    same = len(limb.actuator_names) == len(signs)
    drives = []
    for k, name in enumerate(limb.joint_names):
        speed_limit = float(getattr(limits, "velocity", np.full(len(signs), np.inf))[k])
        drives.append(
            {
                "joint": name,
                "unit": units[k],
                "position_margin": float(motion.position_margin[k]),
                "speed": float(signs[k] * peaks.speed[k]),
                "stance_speed": float(signs[k] * peaks.stance_speed[k]),
                "speed_within_limit": bool(abs(peaks.speed[k]) <= speed_limit),
            }
        )
    efforts = []
    for k, name in enumerate(limb.actuator_names):
        sign = signs[k] if same else 1.0
        ends = sorted(sign * end[k] for end in peaks.stance_effort)
        limit = float(getattr(limits, "effort", np.full(len(signs), np.inf))[k]) if same else math.inf
        efforts.append(
            {
                "actuator": name,
                "unit": effort_units[k],
                "effort": float(sign * peaks.effort[k]),
                "stance_effort": [float(end) for end in ends],
                "effort_within_limit": bool(abs(peaks.effort[k]) <= limit),
                "power [W]": float(peaks.power[k]),
            }
        )
    return {"name": limb.name, "joints": drives, "actuators": efforts}


def _units(limb: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    units = getattr(limb.leg, "units", None)
    if units is None:
        return ("",) * len(limb.joint_names), ("",) * len(limb.actuator_names)
    return tuple(units.joints), tuple(units.actuators)


def columns(study: GaitStudy) -> dict[str, np.ndarray]:
    """The whole cycle, one array (T,) a column, by its name with its unit in ASCII.

    Feet and forces are in the body frame; coordinates and efforts have the signs of the robot's file. The limit margin
    of a leg is the least normalised one of its limits.
    """
    table: dict[str, np.ndarray] = {"t [s]": study.time, "margin [m]": study.margin}
    for k, axis in enumerate("xyz"):
        table[f"com_{axis} [m]"] = study.com[:, k]
    if study.walk.tilt is not None:
        angles = study.walk.tilt.value(study.time / study.walk.period, study.walk.period)
        table |= {"roll [rad]": angles[:, 0], "pitch [rad]": angles[:, 1]}
    for i, motion in enumerate(study.limbs):
        limb, name = motion.limb, motion.limb.name
        table[f"{name}_stance"] = motion.stance.astype(float)
        for k, axis in enumerate("xyz"):
            table[f"{name}_foot_{axis} [m]"] = study.feet.position[:, i, k]
        units, effort_units = _units(limb)
        for symbol, values, suffix in (("", motion.trajectory.q, ""), ("v_", motion.trajectory.v, "/s")):
            for k, joint in enumerate(limb.joint_names):
                table[f"{symbol}{joint} [{units[k]}{suffix}]"] = limb.signs[k] * values[:, k]
        for k, axis in enumerate("xyz"):
            table[f"{name}_force_{axis} [N]"] = study.force[:, i, k]
        signs = limb.signs if motion.effort.shape[1] == len(limb.signs) else np.ones(motion.effort.shape[1])
        for k, actuator in enumerate(limb.actuator_names):
            table[f"tau_{actuator} [{effort_units[k].replace('·', '*')}]"] = signs[k] * motion.effort[:, k]
        own = [each.margin / each.scale for each in study.limits if name in each.leg.split(" + ")]
        if own:
            table[f"{name}_limit_margin [1]"] = np.min(own, axis=0)
    return table


def write(study: GaitStudy, folder: str | Path) -> tuple[Path, ...]:
    """Write summary, table and plots (see `FILES`) into a folder, which is made where it does not exist.

    Returns
    -------
    tuple of Path
    """
    from leg_dynamics.analysis.gait.figures import gait_figures
    from leg_dynamics.analysis.gait.page import render_page

    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    head, table, page = (place / name for name in FILES[:3])
    head.write_text(json.dumps(_plain(summary(study)), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    data = columns(study)
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(data)
        # Adding zero turns -0 into 0.
        writer.writerows(map("{:.12g}".format, row) for row in np.stack(list(data.values()), axis=1) + 0.0)
    figures = gait_figures(study)
    page.write_text(render_page(study, figures), encoding="utf-8", newline="\n")
    written = [head, table, page]
    for name, figure in figures.items():
        path = place / f"{name}.png"
        figure.savefig(path)
        written.append(path)
    return tuple(written)


def _plain(value: Any) -> Any:
    """NaN becomes null, which JSON knows."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
