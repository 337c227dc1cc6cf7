"""What Xu et al. 2025 report of their own simulations and experiments, as printed in section 4; typed here only."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

__all__ = [
    "FORCE",
    "FORCE_ENDS",
    "MOTORS",
    "MOTOR_COLUMNS",
    "MOTOR_LABELS",
    "REPORTED",
    "Reported",
    "errors",
    "foot_force",
    "shares",
]

MOTORS = ("M1", "M2", "M3")
"""The order in which the paper lists torques; here in every list of three torques."""

MOTOR_LABELS = ("M1 (β)", "M2 (α)", "M3 (γ)")
"""In legends and tables."""

MOTOR_COLUMNS = [1, 0, 2]
"""Of (alpha, beta, gamma), in the order of `MOTORS`: M1 drives beta, M2 alpha, M3 gamma."""

FORCE = (0.0, -20.0, 20.0)
"""N; "applied to the foot" in the dynamic simulation, during its first second."""

FORCE_ENDS = 1.0
"""s."""


@dataclass(frozen=True)
class Reported:
    """A largest error as the paper states it, with the share that it gives beside it.

    Attributes
    ----------
    place, quantity : str
    error, percent : str
        Decimals as printed, so that their rounding is known; `percent` may be empty.
    unit : str
    """

    place: str
    quantity: str
    error: str
    percent: str
    unit: str

    @property
    def reference(self) -> tuple[float, float] | None:
        """Range of the full value that error and share imply, given how both are rounded; in `unit`."""
        if not self.percent:
            return None
        error, share = Decimal(self.error), Decimal(self.percent)
        e, s = _half_digit(self.error), _half_digit(self.percent)
        return float((error - e) / (share + s) * 100), float((error + e) / (share - s) * 100)

    @property
    def implied(self) -> float:
        """The full value that error and share imply, in `unit`; NaN where no share is given."""
        return float(Decimal(self.error) / Decimal(self.percent) * 100) if self.percent else math.nan


def _half_digit(text: str) -> Decimal:
    return Decimal(1).scaleb(int(Decimal(text).as_tuple().exponent)) / 2


REPORTED = {
    (r.place, r.quantity): r
    for r in (
        Reported("Fig. 9", "position", "42.5", "0.04", "µm"),
        Reported("Fig. 9", "velocity", "74", "0.09", "µm/s"),
        Reported("Fig. 9", "acceleration", "1.5", "1.8", "mm/s²"),
        Reported("Fig. 10", "position", "45", "0.05", "µm"),
        Reported("Fig. 10", "velocity", "63", "0.08", "µm/s"),
        Reported("Fig. 10", "acceleration", "2.89", "1.9", "mm/s²"),
        Reported("Fig. 11", "M1", "2.1", "0.1", "mN·m"),
        Reported("Fig. 11", "M2", "1.5", "0.6", "mN·m"),
        Reported("Fig. 11", "M3", "5.2", "0.2", "mN·m"),
        Reported("Fig. 15", "X", "1.4", "1.4", "mm"),
        Reported("Fig. 15", "Y", "0.9", "1.8", "mm"),
        Reported("Fig. 15", "Z", "1.0", "2", "mm"),
        Reported("Fig. 17", "X", "2.1", "3.0", "mm"),
        Reported("Fig. 17", "Y", "1.9", "2.7", "mm"),
        Reported("Fig. 17", "Z", "1.7", "1.9", "mm"),
        Reported("Fig. 19", "M1", "0.1", "", "N·m"),
        Reported("Fig. 19", "M2", "0.14", "6.3", "N·m"),
        Reported("Fig. 19", "M3", "0.37", "8.7", "N·m"),
    )
}
"""By place and quantity, as printed."""


def _all_of(place: str) -> list[Reported]:
    return [reported for (where, _), reported in REPORTED.items() if where == place]


def errors(place: str) -> np.ndarray:
    """The errors reported in one place, in its own units and in the order printed."""
    return np.array([float(reported.error) for reported in _all_of(place)])


def shares(place: str) -> np.ndarray:
    """The shares reported in one place, percent; NaN where none is given."""
    return np.array([float(reported.percent or "nan") for reported in _all_of(place)])


def foot_force(time: np.ndarray, sign: float = 1.0) -> np.ndarray:
    """The force of Fig. 11 at times (T,), s: shape (T, 3), N, times `sign`."""
    acts = np.where(np.asarray(time) <= FORCE_ENDS, sign, 0.0)
    force: np.ndarray = acts[:, None] * np.array(FORCE)
    return force
