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
from leg_dynamics.analysis.gait.steadying import margin_bound
from leg_dynamics.analysis.gait.study import GaitStudy, LimbMotion
from leg_dynamics.analysis.gait.tracks import Tracks, tracks

__all__ = ["FILES", "columns", "limits_of", "summary", "write"]

FILES = (
    "summary.json",
    "cycle.csv",
    "report.html",
    "stills.png",
    "body.png",
    "steps.png",
    "foot_speeds.png",
    "feet.png",
    "speeds.png",
    "efforts.png",
    "stability.png",
    "limits.png",
)
"""What `write` makes in a folder; stills of a robot with a file only."""

_LOADS = {
    "balanced": "least foot forces that push only and balance weight and body acceleration at the centre of mass",
    "equal": "equal vertical forces on the standing feet; moments are not balanced",
    "none": "no foot forces: legs carry themselves only",
}


def summary(study: GaitStudy) -> dict[str, Any]:
    """What the study found, as plain numbers, texts, lists and mappings.

    Units are in the names or beside the numbers; coordinates and efforts have the signs of the robot's file.
    """
    walk, seen = study.walk, tracks(study)
    legs = [_leg(motion) for motion in study.limbs]
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
        "sway [m]": _sway(study),
        "choices": [each._asdict() for each in study.choices],
        "samples": int(study.time.size),
        "mass [kg]": study.mass,
        "centre_of_mass": "trunk and every moving link of the legs where it is",
        "stability_margin [m]": _range(study.margin, study.time),
        "margin_bound [m]": _finite(margin_bound(walk)),
        "alternatives": [{"walk": name, "least_margin [m]": _finite(margin)} for name, margin in study.alternatives],
        "load": _LOADS[study.load],
        "friction": study.friction,
        "residual [N]": float(study.residual.max()),
        "largest_foot_force [N]": float(np.linalg.norm(study.force, axis=-1).max()),
        "limits_hold": all(each.holds for each in study.limits),
        **_drives(legs),
        "nearest_limit": None if not study.limits else _limit(study.nearest_limits()[0], study.time),
        "body": _body(study, seen),
        "legs": [
            leg | _steps(study, seen, i) | {"limits": limits_of(study, leg["name"])} for i, leg in enumerate(legs)
        ],
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


def _sway(study: GaitStudy) -> dict[str, list[float]]:
    """Least and greatest shift of the body."""
    sway = study.walk.sway
    if sway is None:
        return {"ahead": [0.0, 0.0], "left": [0.0, 0.0], "up": [0.0, 0.0]}
    shift = sway.value(study.time / study.walk.period, study.walk.period)
    ends = np.stack([shift.min(axis=0), shift.max(axis=0)], axis=1)
    return dict(zip(("ahead", "left", "up"), ends.tolist(), strict=True))


def _body(study: GaitStudy, seen: Tracks) -> dict[str, Any]:
    """Way of the body's origin and of the centre of mass in a cycle, in the world."""
    return {
        "way [m]": (seen.body[-1] - seen.body[0]).tolist(),
        "range [m]": np.ptp(seen.body, axis=0).tolist(),
        "centre_of_mass_range [m]": np.ptp(seen.com, axis=0).tolist(),
        "speed [m/s]": _range(np.linalg.norm(seen.body_velocity, axis=1), study.time),
    }


def _steps(study: GaitStudy, seen: Tracks, leg: int) -> dict[str, Any]:
    """When a leg lifts off and touches down, how far it steps and how fast its foot moves and turns."""
    walk, period = study.walk, study.walk.period
    touch = walk.table.phases[leg]
    ends = [float(np.mod(share, 1.0) * period) for share in (touch + walk.table.duty, touch)]
    rate = float(seen.foot_turn_rate[:, leg].max())
    return {
        "lifts_off [s]": ends[0],
        "touches_down [s]": ends[1] if ends[1] > 0.0 else period,
        "step [m]": float(np.linalg.norm(seen.feet[-1, leg] - seen.feet[0, leg])),
        "foot_speed [m/s]": float(seen.foot_speed[:, leg].max()),
        "foot_turn_rate [rad/s]": _finite(rate),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


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
    return {key: _finite(value) for key, value in ends.items()}


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
                "speed_limit": _finite(speed_limit),
                "speed_within_limit": bool(abs(peaks.speed[k]) <= speed_limit),
            }
        )
    efforts = []
    for k, name in enumerate(limb.actuator_names):
        sign = signs[k] if same else 1.0
        ends = sorted(sign * end[k] for end in peaks.stance_effort)
        upper = float(getattr(limits, "effort", np.full(len(signs), np.inf))[k]) if same else math.inf
        lower = float(limits.effort_lower[k]) if same and hasattr(limits, "effort_lower") else -upper
        # In the signs of the robot's file, where a mirrored leg's joint may turn the other way than its model's.
        least, most = sorted((sign * lower + 0.0, sign * upper + 0.0))  # no negative zero
        values = sign * motion.effort[:, k] + 0.0
        low, high = float(values.min()), float(values.max())
        efforts.append(
            {
                "actuator": name,
                "unit": effort_units[k],
                "effort": float(sign * peaks.effort[k]),
                "stance_effort": [float(end) for end in ends],
                "effort_range": [low, high],
                "effort_lower_limit": _finite(least),
                "effort_limit": _finite(most),
                "effort_within_limit": bool(least <= low and high <= most),
                "power [W]": float(peaks.power[k]),
            }
        )
    return {"name": limb.name, "joints": drives, "actuators": efforts}


def _drives(legs: list[dict[str, Any]]) -> dict[str, Any]:
    """Whether the drives can do the gait; and in one sentence, if not, how far from it they are."""
    rows = [row for leg in legs for row in (*leg["joints"], *leg["actuators"])]
    failing: list[str] = []
    for what, key, word in (("speed", "joint", "too fast"), ("effort", "actuator", "too strong")):
        beyond = [row for row in rows if key in row and not row[f"{what}_within_limit"]]
        if beyond:
            (_, _, value, limit), worst = max(((_excess(row, what), row) for row in beyond), key=lambda pair: pair[0])
            unit = worst["unit"] + ("/s" if what == "speed" else "")
            failing.append(
                f"{len(beyond)} {key}{'s are' if len(beyond) > 1 else ' is'} {word}, the worst is {worst[key]} with "
                f"{value:.4g} {unit} where {limit:.4g} {unit} are allowed"
            )
    remedy = "take a longer period, a shorter stride or a lower clearance, or stronger drives"
    sentence = f"the drives CANNOT do this gait: {'; '.join(failing)}; {remedy}" if failing else ""
    return {"drives_suffice": not failing, "verdict": sentence or "speeds and efforts are within the drives' limits"}


def _excess(row: Mapping[str, Any], what: str) -> tuple[float, float, float, float]:
    """Of the limit that a drive breaks most: value over limit, the value's magnitude, the value and the limit."""
    if what == "speed":
        ends = [(abs(row["speed"]), row["speed_limit"])]
    else:
        sides = zip(row["effort_range"], (row["effort_lower_limit"], row["effort_limit"]), (-1.0, 1.0), strict=True)
        ends = [(value, limit) for value, limit, side in sides if limit is not None and side * (value - limit) > 0.0]
    return max((value / limit if limit else math.inf, abs(value), value, limit) for value, limit in ends)


def _units(limb: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
    units = getattr(limb.leg, "units", None)
    if units is None:
        return ("",) * len(limb.joint_names), ("",) * len(limb.actuator_names)
    return tuple(units.joints), tuple(units.actuators)


def columns(study: GaitStudy) -> dict[str, np.ndarray]:
    """The whole cycle, one array (T,) a column, by its name with its unit in ASCII.

    Feet and forces are in the body frame, and what has `world` in its name, and speeds of feet, over the ground. A
    vector of the body frame is turned into the world by the body's roll, pitch and yaw, Rz(yaw) Ry(pitch) Rx(roll).
    Coordinates and efforts have the signs of the robot's file. The limit margin of a leg is the least normalised one of
    its limits.
    """
    table: dict[str, np.ndarray] = {"t [s]": study.time, "margin [m]": study.margin}
    seen = tracks(study)
    for k, axis in enumerate("xyz"):
        table[f"com_{axis} [m]"] = study.com[:, k]
    for what, place in (("body", seen.body), ("com", seen.com)):
        table |= {f"{what}_world_{axis} [m]": place[:, k] for k, axis in enumerate("xyz")}
    angles = np.zeros((study.time.size, 2))
    if study.walk.tilt is not None:
        angles = study.walk.tilt.value(study.time / study.walk.period, study.walk.period)
    # Always: without them nothing of the body frame can be turned into the world.
    table |= {"roll [rad]": angles[:, 0], "pitch [rad]": angles[:, 1], "yaw [rad]": study.body.yaw}
    for i, motion in enumerate(study.limbs):
        limb, name = motion.limb, motion.limb.name
        table[f"{name}_stance"] = motion.stance.astype(float)
        for k, axis in enumerate("xyz"):
            table[f"{name}_foot_{axis} [m]"] = study.feet.position[:, i, k]
        table |= {f"{name}_foot_world_{axis} [m]": seen.feet[:, i, k] for k, axis in enumerate("xyz")}
        table[f"{name}_foot_speed [m/s]"] = seen.foot_speed[:, i]
        if np.isfinite(seen.foot_spin[:, i]).all():
            table[f"{name}_foot_turn_rate [rad/s]"] = seen.foot_turn_rate[:, i]
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
