"""What the samples of a motion tell of the way between them.

Between two samples the motion is taken for the polynomial of degree five through their coordinates, rates and
accelerations. How far the motion may be from it, the polynomial through their neighbours as well tells: both miss the
motion by little where the samples are dense, and differ by about the first one's error where they are not. How far the
samples themselves may be off, with few digits or differences for rates, tells the polynomial through those beside them:
what it misses them by hardly depends on how far these are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.errors import AssemblyError, SingularityError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from scipy.interpolate import KroghInterpolator

    from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = ["SampledMotion", "Way", "lead"]

# Share of the rates by which coordinates and rates, or rates and accelerations, of neighbouring samples may miss each
# other and still tell one motion between them.
FITTING = 0.2
# rad or lengths of the mechanism: what rates that do not fit may miss the way by and still tell where it leads.
LOOSE = 0.02
# Share of the rates whose change in an interval is none.
STEADY = 1e-3
# Rounding of the coordinates.
ROUNDING = 1e-11
# Of accelerations that follow from coordinates and rates alone: what is not known of them.
UNKNOWN = 0.05
# Error of the polynomial, as a share of what accelerations make of it, however well the neighbours agree.
QUINTIC = 0.02
# What the neighbours tell of the error is off itself where it is large.
UNSURE = 3.0
# What the neighbours miss a sample by, times this, it may be off. Of exact samples it is 4 to the power of the levels
# less at half the distance, of wrong ones about as much.
NOISY, FALLING, FEWEST = 2.0, 3.0, 8
# Where two polynomials through the same samples are held against each other, shares of the interval.
PLACES = np.array([0.25, 0.5, 0.75])
# Halvings of an interval that cannot be followed straight.
HALVINGS = 3


@dataclass(frozen=True)
class Way:
    """The motion from one sample to the next.

    Attributes
    ----------
    start, span : float
        Time of the first sample and to the second, s.
    v, a : (2, n) array
        Rates and accelerations at both ends.
    coefficients : (6, n) array
        Of the coordinates, by powers of the share of the interval.
    blur : float
        What accelerations make of the coordinates: how far a motion with the same ends may be, rad or lengths of the
        mechanism.
    error : float
        By how much the motion may be off the polynomial half way, in the same unit.
    noise : float
        By how much the samples themselves may be off, in the same unit.
    guessed : bool
        Whether the accelerations were not those of the samples.
    """

    start: float
    span: float
    v: np.ndarray
    a: np.ndarray
    coefficients: np.ndarray
    blur: float
    error: float
    noise: float
    guessed: bool

    def share(self, time: float) -> float:
        """Share of the interval at a time, s."""
        return (time - self.start) / self.span

    def error_at(self, share: float) -> float:
        """By how much the motion may be off the polynomial; at both ends, whose rates are known as well, by noise."""
        return max(self.error * (4.0 * share * (1.0 - share)) ** 2, self.noise)

    def coordinates(self, share: float) -> np.ndarray:
        """Independent coordinates (n,)."""
        y: np.ndarray = share ** np.arange(6.0) @ self.coefficients
        return y

    def rates(self, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Independent rates and accelerations (n,) each."""
        powers = np.arange(6.0)
        v = (powers[1:] * share ** powers[:-1]) @ self.coefficients[1:] / self.span
        a = (powers[2:] * powers[1:-1] * share ** powers[:-2]) @ self.coefficients[2:] / self.span**2
        return v, a


class SampledMotion:
    """Coordinates, rates and accelerations at rising times.

    Parameters
    ----------
    time : (N,) array
        s.
    q, v, a : (N, n) array
    unit : (n,) array
        What a coordinate counts as one in.
    """

    def __init__(self, time: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, unit: np.ndarray) -> None:
        self.time, self.v, self.a, self.unit = time, v, a, unit
        self._levels = q / unit, v / unit, a / unit

    def __len__(self) -> int:
        return len(self.time)

    def way(self, row: int) -> Way | None:
        """From the sample before to `row`; None where coordinates and rates do not belong to one motion at all.

        Accelerations that do not belong to it, such as the zeros of a motion that is only to be checked, are replaced
        by those that follow from coordinates and rates.
        """
        pair = slice(row - 1, row + 1)
        h = float(self.time[row] - self.time[row - 1])
        q, v, a = (level[pair] for level in self._levels)
        speed, slope = (float(np.linalg.norm(each, axis=1).max()) for each in (v, a))
        accelerated = all(self._is_accelerated(at) for at in range(max(row - 1, 1), min(row + 2, len(self))))
        # About where a motion turns back its rates are small at both ends.
        size = max(speed, 0.5 * h * slope) if accelerated else speed
        loose = 0.0
        if not (self._fits(row, 0, size) or (accelerated and self._misfit(row, 0, bent=True) <= FITTING * size)):
            accelerated, loose = False, h * self._misfit(row, 0)
            if speed == 0.0 or loose > LOOSE:
                return None
        chord = 6.0 * (q[1] - q[0]) / h
        own = np.stack([chord - 4.0 * v[0] - 2.0 * v[1], -chord + 2.0 * v[0] + 4.0 * v[1]]) / h
        if accelerated:
            apart, share, levels = np.abs(a - own).sum(axis=0), QUINTIC, 3
        else:
            a, apart, share, levels = own, UNKNOWN * np.abs(own).sum(axis=0), 1.0, 2
        coefficients = _quintic(h, q, v, a)
        blur = h**2 / 64.0 * float(np.linalg.norm(apart))
        told = self._error(row, levels, coefficients)
        rounding = ROUNDING * (1.0 + float(np.abs(q).max()))
        return Way(
            float(self.time[row - 1]),
            h,
            self.v[pair],
            a * self.unit,
            coefficients * self.unit,
            blur + rounding,
            max(share * blur, UNSURE * told, loose) + rounding,
            NOISY * self._noise(row, levels) + rounding,
            not accelerated,
        )

    def _is_accelerated(self, row: int) -> bool:
        """Whether the accelerations from the sample before to `row` are those of the rates."""
        pair = slice(row - 1, row + 1)
        speed, slope = (float(np.linalg.norm(level[pair], axis=1).max()) for level in self._levels[1:])
        # Of their own size, or zeros would fit a motion that is nearly straight.
        return self._fits(row, 1, max(STEADY * speed / float(self.time[row] - self.time[row - 1]), slope))

    def _misfit(self, row: int, level: int, bent: bool = False) -> float:
        """By how much the mean of a level's rates misses its change, in rates; `bent`: by their own rates too."""
        x, rates = (each[row - 1 : row + 1] for each in self._levels[level : level + 2])
        h = self.time[row] - self.time[row - 1]
        mean = 0.5 * (rates[0] + rates[1])
        if bent:
            slopes = self._levels[level + 2]
            mean = mean - h / 12.0 * (slopes[row] - slopes[row - 1])
        return float(np.linalg.norm((x[1] - x[0]) / h - mean))

    def _fits(self, row: int, level: int, size: float) -> bool:
        """Whether the next level is the rate of this one: as a mean of the interval, or at both its ends."""
        if self._misfit(row, level) <= FITTING * size:
            return True
        if not 1 < row < len(self) - 1:
            return False
        return all(self._misfit_at(at, level) <= FITTING * size for at in (row - 1, row))

    def _misfit_at(self, row: int, level: int) -> float:
        """By how much rates at a sample miss what the samples beside it tell of them."""
        from scipy.interpolate import KroghInterpolator

        x, rates = self._levels[level : level + 2]
        at = np.array([row - 1, row - 1, row, row + 1, row + 1])
        values = np.stack([x[row - 1], rates[row - 1], x[row], x[row + 1], rates[row + 1]])
        curve = KroghInterpolator(self.time[at] - self.time[row], values)
        return float(np.linalg.norm(curve.derivative(0.0, 1) - rates[row]))

    def _noise(self, row: int, levels: int) -> float:
        """By how much the samples before `row` and at it are wrong, or rates in step with each other; 0 of few samples.

        That is how far they are from the polynomials through those beside them, if it does not fall as fast with the
        distance of these as it does where samples are only far apart.
        """
        if len(self) < FEWEST:
            return 0.0
        rows = np.clip([row - 1, row], 2, len(self) - 3)
        near, far = (max(self._missed(at, reach, levels) for at in rows) for reach in (1, 2))
        return near if far <= FALLING**levels * near else 0.0

    def _missed(self, row: int, reach: int, levels: int) -> float:
        """Distance of a sample to the polynomial through those `reach` rows before and after."""
        first, last = row - reach, row + reach
        h = self.time[last] - self.time[first]
        share = (self.time[row] - self.time[first]) / h
        return float(np.linalg.norm(self._through([first, last], levels, first, h)(share) - self._levels[0][row]))

    def _through(self, rows: Sequence[int], levels: int, start: int, h: float) -> KroghInterpolator:
        """The polynomial through so many levels of some samples, by time from one of them in units of h, s."""
        from scipy.interpolate import KroghInterpolator

        values = np.stack([self._levels[level][at] * h**level for at in rows for level in range(levels)])
        return KroghInterpolator(np.repeat((self.time[rows] - self.time[start]) / h, levels), values)

    def _error(self, row: int, levels: int, coefficients: np.ndarray) -> float:
        """Distance to the polynomial through the neighbours too; 0 without any."""
        rows = list(range(max(row - 2, 0), min(row + 2, len(self))))
        if len(rows) == 2:
            return 0.0
        curve = self._through(rows, levels, row - 1, self.time[row] - self.time[row - 1])
        difference = curve(PLACES) - PLACES[:, None] ** np.arange(6.0) @ coefficients
        return float(np.linalg.norm(difference, axis=1).max())


def _quintic(h: float, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Coefficients (6, n) of the polynomial through both ends, (2, n) each."""
    way = q[1] - q[0] - h * v[0] - 0.5 * h**2 * a[0]
    speed = h * (v[1] - v[0] - h * a[0])
    force = h**2 * (a[1] - a[0])
    return np.stack(
        [
            q[0],
            h * v[0],
            0.5 * h**2 * a[0],
            10.0 * way - 4.0 * speed + 0.5 * force,
            -15.0 * way + 7.0 * speed - force,
            6.0 * way - 3.0 * speed + 0.5 * force,
        ]
    )


def lead(
    mechanism: Mechanism, way: Way, state: ClosedState, start: float, share: float, halvings: int = HALVINGS
) -> ClosedState:
    """The pose at a share of an interval from the one at another, along the polynomial where no straight way leads.

    Parameters
    ----------
    mechanism : Mechanism
    way : Way
    state : ClosedState
        The pose at `start`.
    start, share : float
        Shares of the interval, from 0 to 1.
    halvings : int
        How often what cannot be followed straight is halved.

    Raises
    ------
    AssemblyError, SingularityError
        Of `Mechanism.follow`.
    """
    try:
        return mechanism.follow(state, way.coordinates(share))
    except (AssemblyError, SingularityError):
        if halvings == 0:
            raise
    middle = 0.5 * (start + share)
    state = lead(mechanism, way, state, start, middle, halvings - 1)
    return lead(mechanism, way, state, middle, share, halvings - 1)
