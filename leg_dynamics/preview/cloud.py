"""Points in space coloured by a number, such as a workspace by its condition number, as commands for a viewer."""

from __future__ import annotations

import math
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.errors import NonFiniteError, ShapeError
from leg_dynamics.preview.commands import load_meshcat, set_property, viewer_path

__all__ = ["MAXIMUM_POINTS", "Cloud"]

MAXIMUM_POINTS = 20_000
"""More are thinned out evenly: they would hide each other, and a page would grow by megabytes."""

_SIZE = 0.02
"""Of a point, in the scene of unit radius."""


@dataclass(frozen=True, slots=True)
class Cloud:
    """A point cloud.

    Attributes
    ----------
    points : (N, 3) array
        m, root frame.
    values : (N,) array
        Positive numbers, coloured on a logarithmic scale from `low` (yellow) to `high` (violet).
    label : str
        What they are.
    low, high : float
        Ends of the scale: the least value, and that which a fiftieth exceeds.
    highest : float
        The greatest value, infinity included: what exceeds `high` has its colour.
    """

    points: np.ndarray
    values: np.ndarray
    label: str
    low: float
    high: float
    highest: float

    @classmethod
    def of(cls, points: ArrayLike, values: ArrayLike, label: str = "") -> Cloud:
        """Check points (N, 3) in the root frame, m, and positive values (N,), infinity allowed; N at least 1.

        Raises
        ------
        ShapeError
            The shapes do not fit each other.
        NonFiniteError
            A point is not finite, or a value is NaN or not positive.
        """
        place, number = np.asarray(points, dtype=float), np.asarray(values, dtype=float)
        if place.ndim != 2 or place.shape[1:] != (3,) or number.shape != place.shape[:1] or not len(place):
            raise ShapeError(f"a cloud needs points (N, 3) and values (N,), got {place.shape} and {number.shape}")
        bad = np.flatnonzero(~np.isfinite(place).all(axis=1) | ~(number > 0.0))
        if bad.size:
            raise NonFiniteError(
                f"{bad.size} of {len(place)} points of the cloud are not finite or have no positive value, first in "
                f"row {bad[0]}: leave them out",
                rows=bad,
            )
        every, highest = math.ceil(len(place) / MAXIMUM_POINTS), float(number.max())
        place, number = place[::every], number[::every]
        finite = number[np.isfinite(number)]
        low, high = (1.0, 1.0) if finite.size == 0 else (float(finite.min()), float(np.quantile(finite, 0.98)))
        return cls(place, number, label, low, max(high, low), highest)

    @property
    def note(self) -> str:
        """What the colours mean, in a few words."""
        low, high, highest = (f"{value:.3g}" for value in (self.low, self.high, self.highest))
        beyond = "" if highest == high else f" and more, up to {'infinity' if math.isinf(self.highest) else highest}"
        return f"{self.label} {low} (yellow) to {high}{beyond} (violet)".strip()

    def colours(self) -> np.ndarray:
        """Red, green, blue in 0..1, (N, 3)."""
        from matplotlib import colormaps

        with np.errstate(divide="ignore"):
            share = np.log(np.minimum(self.values, self.high) / self.low) / max(math.log(self.high / self.low), 1e-12)
        return np.asarray(colormaps["viridis_r"](share))[:, :3]

    def commands(self) -> Iterator[dict[str, Any]]:
        """The cloud in the scene's frame ``/leg``."""
        meshcat = load_meshcat()
        geometry = meshcat.geometry.PointsGeometry(
            self.points.T.astype(np.float32), self.colours().T.astype(np.float32)
        )
        material = meshcat.geometry.PointsMaterial(size=_SIZE)
        drawn = meshcat.geometry.Points(geometry, material)
        for kind, element in (("geometry", geometry), ("material", material), ("object", drawn)):
            element.uuid = str(uuid.uuid5(uuid.NAMESPACE_URL, f"{kind}:cloud"))
        yield meshcat.commands.SetObject(drawn, path=viewer_path("/leg/cloud")).lower()
        yield set_property("/leg/cloud/<object>", "castShadow", False)
