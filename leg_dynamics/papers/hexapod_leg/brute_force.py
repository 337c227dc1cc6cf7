"""Indices once more, by force: vectors from the paper's drawing, marching, random feet, differences of lengths.

No formula of `closed_form`, no sampling of `study` and nothing of `analysis` is used: each strut is a vector between
two points, an angle is that of a vector, the Jacobian is a difference of lengths, the volume a share of a box.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from leg_dynamics.papers.hexapod_leg.study import Design

__all__ = ["Mean", "chord", "lengths_and_feasible", "mean_condition"]

Array = np.ndarray

DIFFERENCE = 1e-6
"""m."""

MARCH = 5e-4
"""m; a chord is known to two of them."""


class Mean(NamedTuple):
    """A mean over random feet, and the half width of its 99 % interval."""

    value: float
    half_width: float


def lengths_and_feasible(design: Design, p: Array) -> tuple[Array, Array]:
    """Lengths of the struts (..., 3), m, with the foot at p (..., 3), and whether all constraints of section 4 hold.

    Of a right leg, whose A3 is at +y.
    """
    ex, ey = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    first = np.asarray(p, dtype=float)
    along = first / np.linalg.norm(first, axis=-1, keepdims=True)
    # The first U joint: its second axis is across the strut and across x.
    across = np.cross(along, ex)
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    ahead = np.cross(across, along)
    second = design.e * along + design.b * ahead - design.a * ex
    third = first + design.c * across - design.a * ey
    struts = np.stack([first, second, third], axis=-2)
    lengths = np.linalg.norm(struts, axis=-1)
    good = np.ones(lengths.shape[:-1], dtype=bool)
    for k, (low, high) in enumerate(design.limits):
        good &= (lengths[..., k] >= low) & (lengths[..., k] <= high)
    # U joints: the turn about x, then the lean towards x out of the plane across it.
    x, y, z = np.moveaxis(struts, -1, 0)
    turn, lean = np.arctan2(-y, z), np.arctan2(x, np.hypot(y, z))
    down = np.cross(ex, across)  # strut 2 leans in the plane of x and this, at the turn of strut 1
    turn[..., 1], lean[..., 1] = turn[..., 0], np.arctan2(x[..., 1], (second * down).sum(axis=-1))
    good &= (np.abs(turn) <= design.universal_range).all(axis=-1) & (np.abs(lean) <= design.universal_range).all(
        axis=-1
    )
    # The ball: where strut 3 points as seen from the platform, against the initial pose.
    seat = (design.c - design.a) * across + design.h * along
    tilt = np.arctan2(np.linalg.norm(np.cross(seat, third), axis=-1), (seat * third).sum(axis=-1))
    return lengths, good & (tilt <= design.ball_range)


def chord(design: Design) -> float:
    """Feasible feet on the line through the initial pose along x, m, by marching; 0 where that pose is not feasible."""
    x = np.arange(0.0, design.l1_max + MARCH, MARCH)
    length = 0.0
    for side in (1.0, -1.0):
        feet = np.stack([side * x, 0.0 * x, 0.0 * x + design.h], axis=-1)
        good = lengths_and_feasible(design, feet)[1]
        if not good[0]:
            return 0.0
        length += float(x[int(np.argmin(good)) - 1]) if not good.all() else float(x[-1])
    return length


def mean_condition(design: Design, generator: np.random.Generator, feet: int) -> tuple[float, Mean]:
    """Volume, m³, and mean condition number over feet drawn uniformly from the box around all of them."""
    reach = design.l1_max
    box = 4.0 * reach**3
    p = generator.random((feet, 3)) * [2.0 * reach, 2.0 * reach, reach] - [reach, reach, 0.0]
    p = p[np.linalg.norm(p, axis=-1) > 0.5 * design.l1_min]
    p = p[lengths_and_feasible(design, p)[1]]
    if len(p) < 2:
        return box * len(p) / feet, Mean(math.nan, math.nan)
    steps = DIFFERENCE * np.eye(3)
    columns = [
        (lengths_and_feasible(design, p + step)[0] - lengths_and_feasible(design, p - step)[0]) / (2.0 * DIFFERENCE)
        for step in steps
    ]
    sigma = np.linalg.svd(np.stack(columns, axis=-1), compute_uv=False)
    k = sigma[:, 0] / sigma[:, -1]
    return box * len(p) / feet, Mean(float(k.mean()), 2.576 * float(k.std(ddof=1)) / math.sqrt(len(k)))
