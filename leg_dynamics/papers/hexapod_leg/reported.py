"""What Rong et al. 2012 prints of its own numbers, sections 4 to 6 and Table 1; typed here only. Lengths in m."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = [
    "ACCEPTED",
    "FINAL",
    "PRELIMINARY",
    "PRIMARY_RANGES",
    "SECONDARY",
    "SECTION_6",
    "TABLE_1",
    "TUBES",
]

PRELIMINARY: Mapping[str, float] = MappingProxyType(
    {
        "a": 0.2,
        "b": 0.08,
        "c": 0.05,
        "e": 0.45,
        "l1_min": 0.5,
        "l1_max": 0.9,
        "l2_min": 0.35,
        "l2_max": 0.65,
        "l3_min": 0.5,
        "l3_max": 0.9,
        "h": 0.7,
        "ball_range": 35.0,
        "universal_range": 60.0,
    }
)
"""Section 4.1: the parameters that Figs 2 to 5 start from; angles in deg."""

FINAL: Mapping[str, float] = MappingProxyType(
    {
        "a": 0.2,
        "b": 0.07,
        "c": 0.05,
        "e": 0.45,
        "l1_min": 0.53,
        "l1_max": 0.9,
        "l2_min": 0.33,
        "l2_max": 0.6,
        "l3_min": 0.53,
        "l3_max": 0.9,
    }
)
"""Section 6.1: the parameters chosen; h and the angles' limits are not said again."""

TABLE_1: Mapping[str, float] = MappingProxyType({"a": 0.2, "b": 0.07, "c": 0.05, "e": 0.45})

TUBES: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        "sleeve_13": (0.5, 0.065, 0.005),
        "rod_13": (0.5, 0.03, 0.003),
        "sleeve_2": (0.31, 0.065, 0.005),
        "rod_2": (0.31, 0.03, 0.003),
    }
)
"""Table 1: length, diameter and wall of the tubes."""

PRIMARY_RANGES: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"a": (0.1, 0.35), "b": (0.02, 0.15), "l2_min": (0.1, 0.4), "l2_max": (0.45, 0.8)}
)
"""Section 6.1: the box that the Monte Carlo method draws from."""

SECONDARY = ("c", "e", "l1_min", "l3_min", "l3_max")
"""Section 6.1: the secondary parameters as listed."""

ACCEPTED: Mapping[str, float] = MappingProxyType({"Z": 0.35, "L": 1.0, "kbar": 4.3, "ktilde": 4.7})
"""Section 6.1: middle values of the indices, which are also the thresholds of acceptance."""

SECTION_6: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"workspace indices": ("L", "H"), "relations": (">=", ">=", "<=", "="), "secondary": SECONDARY}
)
"""Section 6.1 as worded: names of the indices, and the relations of Z, L, kbar and ktilde to their thresholds."""
