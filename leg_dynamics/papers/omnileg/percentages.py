"""The percentages of Xu et al. 2025: the full values that each can be a share of.

The paper divides each largest error by a full value that it never names. Every quantity is held against the same fixed
set of candidates: span and peak of each coordinate, and the peak of the norm. A share that fits one of them is
consistent, no more: the set is large and the windows are wide, so each verdict states how likely a hit is by chance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from leg_dynamics.papers.framework import Context, Figure, Status, Verdict
from leg_dynamics.papers.judge import judge, text
from leg_dynamics.papers.omnileg import printed
from leg_dynamics.papers.omnileg.reported import MOTOR_COLUMNS, MOTORS, REPORTED, errors, foot_force, shares

__all__ = ["VERDICTS", "candidates", "chance", "share_verdict"]

Array = np.ndarray

AMPLITUDES = (25.0, 45.0)
"""deg; of gamma in (52): the printed one, then the one that several shares fit better."""

OTHER_AMPLITUDE = f"{AMPLITUDES[1]:g}°"
"""In the name of a full value that (52) has with that amplitude, and not with the printed one."""

DISTINCT = 0.01
"""Candidates closer than this, as a share, count as one."""

FACTORS = {"µm": 1e6, "µm/s": 1e6, "mm": 1e3, "mm/s²": 1e3, "mN·m": 1e3}
"""Of SI units."""


def candidates(values: Array, axes: str = "XYZ", note: str = "") -> dict[str, float]:
    """The full values that an error of `values` (T, 3) could be a share of, by name.

    Parameters
    ----------
    values : (T, 3) array
    axes : str
        The coordinates that the error is about.
    note : str
        After each name.
    """
    columns = ["XYZ".index(axis) for axis in axes]
    full = {f"span in {axis}{note}": float(np.ptp(values[:, k])) for axis, k in zip(axes, columns, strict=True)}
    full |= {f"peak in {axis}{note}": float(np.abs(values[:, k]).max()) for axis, k in zip(axes, columns, strict=True)}
    return full | {f"peak of the norm{note}": float(np.linalg.norm(values, axis=1).max())}


def chance(window: tuple[float, float], count: int) -> float:
    """Chance that any of `count` full values falls into a window, each anywhere in a decade with even odds (log)."""
    return 1.0 - (1.0 - min(1.0, math.log10(window[1] / window[0]))) ** count


def _distinct(values: Mapping[str, float]) -> int:
    """How many of the values differ."""
    ordered = np.sort(list(values.values()))
    return 1 + int((ordered[1:] > (1.0 + DISTINCT) * ordered[:-1]).sum())


def _unlike_printed(full: dict[str, float]) -> dict[str, float]:
    """Leave out what the other amplitude does not change."""
    suffix = f" with {OTHER_AMPLITUDE}"

    def differs(name: str, value: float) -> bool:
        return not name.endswith(suffix) or abs(value / full[name.removesuffix(suffix)] - 1.0) > DISTINCT

    return {name: value for name, value in full.items() if differs(name, value)}


def _size(value: float) -> str:
    """A full value for a sentence: three digits, without an exponent."""
    return text(value) if value < 1000.0 else f"{float(text(value)):.0f}"


def share_verdict(
    item: str,
    place: str,
    quantity: str,
    full: Mapping[str, float],
    *,
    repair: tuple[str, float, str] | None = None,
    assumed: str = "",
    note: str = "",
) -> Verdict:
    """Verdict on a percentage, by whether a candidate gives it.

    Parameters
    ----------
    item : str
    place, quantity : str
        Key of `REPORTED`.
    full : mapping of str to float
        Candidates in the unit of the reported error.
    repair : tuple, optional
        Name of the candidate that the share should be of, the full value that it was taken of instead, and why. It
        corrects the share where that value explains it and no candidate does.
    assumed : str
        What the candidates depend on and the paper does not give; then no fit confirms anything.
    note : str
    """
    reported = REPORTED[place, quantity]
    reference = reported.reference
    assert reference is not None
    low, high = reference
    by = {name: 100.0 * float(reported.error) / value for name, value in full.items()}
    hits = [name for name, value in full.items() if low <= value <= high]
    as_printed = {name: value for name, value in full.items() if OTHER_AMPLITUDE not in name}
    fits = any(name in as_printed for name in hits) and not assumed
    explained = None if repair is None else (0.0 if low <= repair[1] <= high else 1.0)
    status = judge(0.0 if fits else 1.0, 0.5, corrected=None if repair is None else 0.0, explained=explained)
    count, hit = _distinct(as_printed), chance((low, high), _distinct(as_printed))
    first = sorted(hits, key=lambda name: name not in as_printed)
    answer = f"{'only ' if first[0] not in as_printed else ''}the {first[0]} fits" if first else "nothing computed fits"
    if repair is not None and status is Status.CORRECTED:
        answer += f"; {repair[2]} does"
    if assumed and first:
        answer += f", but {assumed}"
    listed = ", ".join(f"{name} {_size(value)} ({by[name]:.2g} %)" for name, value in full.items())
    width = 100.0 * (high / low - 1.0)
    of = f"{count} different candidates, each anywhere in a decade"
    return Verdict(
        f"claim: {item}",
        "claim",
        f"{place}: {reported.error} {reported.unit} ({quantity}), share consistent with a computed full value?",
        status,
        f"{reported.error} {reported.unit} at {reported.percent} % imply a full value of {_size(low)} to {_size(high)} "
        f"{reported.unit}: {answer}. {count} different candidates and a window {width:.0f} % wide make a hit by chance "
        f"{100.0 * hit:.0f} % likely. In {reported.unit}: {listed}. {note}".strip(),
        (
            Figure("least full value implied", low, reported.unit, "error and percentage as rounded"),
            Figure("greatest full value implied", high, reported.unit, "error and percentage as rounded"),
            Figure("width of the window", width, "%", "greatest over least, minus 1"),
            Figure("candidates", count, "", "that differ, with the printed amplitude"),
            Figure("chance of a hit", hit, "", of),
            *(Figure(f"percentage by the {name}", by[name], "%", f"{reported.error} {reported.unit}") for name in full),
        ),
        f"{reported.percent} %",
        f"{by[repair[0]]:.2g} % of the {repair[0]}" if repair is not None and status is Status.CORRECTED else "",
    )


def _path_51(context: Context) -> tuple[Array, Array, Array]:
    """Displacement, velocity and acceleration along (51), 501 samples; any height."""

    def compute() -> tuple[Array, Array, Array]:
        from leg_dynamics.analysis.trajectories import omnileg_eq51_path

        path, t = omnileg_eq51_path(0.0), np.linspace(0.0, 5.0, 501)
        return path.value(t), path.value(t, 1), path.value(t, 2)

    return context.once("percentages: (51)", compute)


def _path_52(context: Context, degrees: float) -> tuple[Array, Array, Array]:
    """Displacement, velocity and acceleration of the foot along a period of (52)."""

    def compute() -> tuple[Array, Array, Array]:
        from leg_dynamics.analysis.trajectories import omnileg_eq52

        m = omnileg_eq52(6.0, 100.0, gamma_amplitude=np.radians(degrees))
        leg = context.leg
        p = leg.foot_position(m.q)
        return p - p[0], leg.foot_velocity(m.q, m.v), leg.foot_acceleration(m.q, m.v, m.a)

    return context.once(f"percentages: (52) {degrees:g}", compute)


ORDERS = ("position", "velocity", "acceleration")


def _of_foot(context: Context, place: str, quantity: str) -> dict[str, float]:
    """Candidates of an error of the foot, in the unit of the reported error."""
    factor = FACTORS[REPORTED[place, quantity].unit]
    order = ORDERS.index(quantity) if quantity in ORDERS else 0
    axes = "XYZ" if quantity in ORDERS else quantity
    if place in ("Fig. 9", "Fig. 15"):
        return candidates(factor * _path_51(context)[order], axes)
    full = candidates(factor * _path_52(context, AMPLITUDES[0])[order], axes)
    return _unlike_printed(
        full | candidates(factor * _path_52(context, AMPLITUDES[1])[order], axes, f" with {OTHER_AMPLITUDE}")
    )


SIMULATED = {"Fig. 9": "inverse kinematics simulation", "Fig. 10": "forward kinematics simulation"}
MEASURED = {"Fig. 15": "inverse kinematics experiment", "Fig. 17": "forward kinematics experiment"}


def _of_simulation(place: str, quantity: str) -> Callable[[Context], Verdict]:
    def verdict(context: Context) -> Verdict:
        return share_verdict(
            f"{SIMULATED[place]}, {quantity} error", place, quantity, _of_foot(context, place, quantity)
        )

    verdict.__name__ = f"percentage of the {SIMULATED[place]}, {quantity}"
    return verdict


def _of_experiment(place: str, axis: str) -> Callable[[Context], Verdict]:
    def verdict(context: Context) -> Verdict:
        full = _of_foot(context, place, axis)
        repair = None
        if (place, axis) == ("Fig. 15", "Y"):
            # X and Z of the same experiment are shares of the span.
            base = f"span in {axis}"
            repair = (base, 0.5 * full[base], f"half the {base}, where X and Z are shares of the whole one,")
        elif (place, axis) in (("Fig. 17", "X"), ("Fig. 17", "Y")):
            base = f"peak in {axis}"
            rounded = float(f"{full[base]:.1g}")
            words = f"the {base} rounded from {full[base]:.1f} mm to {1e-3 * rounded:g} m"
            share = 100.0 * float(REPORTED[place, axis].error) / rounded
            repair = (base, rounded, f"{words} ({share:.3g} %)")
        return share_verdict(f"{MEASURED[place]}, {axis} error", place, axis, full, repair=repair)

    verdict.__name__ = f"percentage of the {MEASURED[place]}, {axis}"
    return verdict


def _torques(context: Context) -> dict[str, Array]:
    """Torques of Fig. 11 by what was assumed of the force and of (52), columns M1, M2, M3, N·m."""

    def compute() -> dict[str, Array]:
        from leg_dynamics.analysis.trajectories import omnileg_eq52

        found = {}
        for degrees in AMPLITUDES:
            suffix = "" if degrees == AMPLITUDES[0] else f" with {OTHER_AMPLITUDE}"
            m = omnileg_eq52(2.0, 100.0, gamma_amplitude=np.radians(degrees))
            for name, sign in (("with the force on the foot", 1.0), ("by the printed sign", -1.0)):
                tau = context.leg.generalized_force(m.q, m.v, m.a, foot_force=foot_force(m.time, sign))
                found[name + suffix] = tau[:, MOTOR_COLUMNS]
        return found

    return context.once("percentages: Fig. 11", compute)


def _of_torque(motor: str) -> Callable[[Context], Verdict]:
    def verdict(context: Context) -> Verdict:
        column, factor = MOTORS.index(motor), FACTORS["mN·m"]
        full: dict[str, float] = {}
        for name, torques in _torques(context).items():
            values = factor * torques[:, column]
            full |= {f"span {name}": float(np.ptp(values)), f"peak {name}": float(np.abs(values).max())}
        start = abs(float(_torques(context)["with the force on the foot"][0, column]))
        note = "The paper gives no masses."
        if motor == "M2":
            note = (
                f"JᵀF alone is {start:.3g} N·m at the start, whatever the masses: 0.6 % is not relative to the peak, "
                "or a misprint of 0.06 %."
            )
        return share_verdict(
            f"torque error of {motor}",
            "Fig. 11",
            motor,
            _unlike_printed(full),
            assumed="the masses behind it are assumed",
            note=note,
        )

    verdict.__name__ = f"percentage of the torque of {motor}"
    return verdict


def torques_within_one_percent(context: Context) -> Verdict:
    """Fig. 11's relative errors stay within 1 %."""
    own = shares("Fig. 11")
    peaks = 1e3 * np.abs(_torques(context)["with the force on the foot"]).max(axis=0)
    by_peak = 100.0 * errors("Fig. 11") / peaks
    return Verdict(
        "claim: torque errors stay within 1 %",
        "claim",
        "Fig. 11: the relative error of the torques is within 1 %, so the assumptions matter little",
        Status.NOT_REPRODUCIBLE,
        f"The shares printed, {', '.join(f'{x:g}' for x in own)} %, are below 1 %, and so are the printed errors over "
        f"the peaks computed here, {', '.join(f'{x:.2g}' for x in by_peak)} % (M1, M2, M3). But masses and full values "
        "are not given, and the foot force, which no assumption touches, makes up most of each peak.",
        tuple(
            Figure(f"printed error over the peak, {motor}", value, "%", "Fig. 11, assumed masses")
            for motor, value in zip(MOTORS, by_peak, strict=True)
        ),
    )


def amplitude_of_52(context: Context) -> Verdict:
    """25 or 45 degrees."""
    low, high = REPORTED["Fig. 17", "Z"].reference or (np.nan, np.nan)
    degrees = np.arange(20.0, 60.0, 0.1)
    t = np.linspace(0.0, 1.5, 61)  # a quarter period, where every span is reached
    P = context.leg.foot_position(np.stack([printed.motion_52(t, np.radians(d)) for d in degrees]))
    span = 1e3 * np.ptp(P[..., 2], axis=1)
    fits = degrees[(span >= low) & (span <= high)]
    at_25, at_45 = (float(np.interp(d, degrees, span)) for d in AMPLITUDES)
    inside = fits.size > 0 and fits.min() <= AMPLITUDES[0] <= fits.max()
    return Verdict(
        "claim: amplitude of γ in (52)",
        "claim",
        "25° in (52) beside the error that the paper reports for it",
        judge(0.0 if inside else 1.0, 0.5),
        f"1.7 mm at 1.9 % along Z imply a span of {low:.1f} to {high:.1f} mm. (52) as printed spans {at_25:.1f} mm; "
        f"amplitudes of {fits.min():.1f} to {fits.max():.1f}° would fit, 45° gives {at_45:.1f} mm. The printed 25° "
        "stays the default, 45° is offered.",
        (
            Figure("span of Z at 25 deg", at_25, "mm", "(52), 0 to 6 s"),
            Figure("span of Z at 45 deg", at_45, "mm", "(52), 0 to 6 s"),
            Figure("least amplitude that fits", fits.min(), "deg", "1.7 mm and 1.9 % as rounded"),
            Figure("greatest amplitude that fits", fits.max(), "deg", "1.7 mm and 1.9 % as rounded"),
        ),
        "25π/180",
        "",
    )


VERDICTS: tuple[Callable[[Context], Any], ...] = (
    *(_of_simulation(place, quantity) for place in SIMULATED for quantity in ORDERS),
    *(_of_torque(motor) for motor in MOTORS),
    torques_within_one_percent,
    *(_of_experiment(place, axis) for place in MEASURED for axis in "XYZ"),
    amplitude_of_52,
)
"""One function a percentage, in the paper's order."""
