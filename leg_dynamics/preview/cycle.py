"""Whole cycles of a periodic motion, so that it plays over and over without a jump."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

__all__ = ["whole_cycles"]

TOLERANCE = 2e-3
"""Of a joint's range of motion: a smaller gap is not seen."""

KINK = 0.25
"""Of a joint's highest speed: a smaller change of speed is not seen either."""


def whole_cycles(times: np.ndarray, joint_values: Mapping[str, np.ndarray]) -> int | None:
    """Where to end a motion so that it can start again.

    Parameters
    ----------
    times : numpy.ndarray, shape (T,)
        s, increasing.
    joint_values : mapping of str to numpy.ndarray, shape (T,)
        Tree joint coordinates, rad or m.

    Returns
    -------
    int or None
        The last sample of the last whole cycle: T - 1 where the motion ends as it starts, in place and speed, less
        where it repeats itself and stops within a cycle, None where it does neither.
    """
    values = np.stack([*joint_values.values(), np.zeros_like(times)], axis=-1)
    spans = np.ptp(values, axis=0)
    moving = spans > 1e-12
    values = (values[:, moving] - values[0, moving]) / spans[moving]
    if not moving.any():
        return None
    gap = np.abs(values).max(axis=1)
    if gap[-1] <= TOLERANCE and _runs_on(times, values):
        return int(times.size) - 1
    near = gap <= TOLERANCE
    edges = np.diff(near.astype(int), append=0)
    for start in np.flatnonzero(edges == 1) + 1:
        run = slice(start, start + int(np.argmax(edges[start:] == -1)) + 1)
        # The exact return within a run of near ones; where the motion dwells there, its beginning and its end.
        exact = start + np.flatnonzero(gap[run] <= gap[run].min() + 1e-7)
        for first in (exact[0], exact[-1]):
            if first < times.size - 1 and _repeats(times, values, int(first)):
                period = times[first] - times[0]
                cycles = int((times[-1] - times[0]) / period * (1.0 + 1e-9))
                return int(np.argmin(np.abs(times - times[0] - cycles * period)))
    return None


def _runs_on(times: np.ndarray, values: np.ndarray) -> bool:
    """Whether a motion that ends where it starts also ends as fast as it starts."""
    if times.size < 3:
        return True
    speed = np.gradient(values, times, axis=0, edge_order=2)
    return bool((np.abs(speed[-1] - speed[0]) <= KINK * np.abs(speed).max(axis=0)).all())


def _repeats(times: np.ndarray, values: np.ndarray, first: int) -> bool:
    """Whether everything from the sample `first` on is what came a period before."""
    later = slice(first, None)
    before = [np.interp(times[later] - times[first] + times[0], times, column) for column in values.T]
    return bool(np.abs(np.stack(before, axis=-1) - values[later]).max() <= TOLERANCE)
