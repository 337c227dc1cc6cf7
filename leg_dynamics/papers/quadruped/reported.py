"""What Chen & Dong 2021 prints of its own numbers and names, sections 1 and 3; typed here only. Lengths in m."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = [
    "BODY",
    "BODY_GENDERS",
    "FACES",
    "LEGS",
    "LEG_MODULES",
    "MODULES",
    "ORDER",
    "SIZE",
    "STEP_OF_IV",
    "SWING",
    "TURN",
    "USUAL_GENDERS",
]

SIZE = (0.15, 0.11, 0.11)
"""Section 1.1: a module."""

SWING = 70.0
"""deg; section 1.1: either way, upper and lower swing."""

TURN = 360.0
"""deg; section 1.1: the rotation in the middle."""

FACES = ("U", "L")
"""Section 1.1: a connection face on the upper and one on the lower swing's arm, and no other."""

USUAL_GENDERS: Mapping[str, str] = MappingProxyType({"U": "active", "L": "passive"})
"""Section 1.1: of the modules in general."""

BODY_GENDERS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "m06": MappingProxyType({"U": "active", "L": "active"}),
        "m03": MappingProxyType({"U": "passive", "L": "passive"}),
    }
)
"""Section 1.2: of the body's modules 6 and 3."""

MODULES, BODY, LEG_MODULES, LEGS = 10, 2, 2, 4
"""Section 1.2: modules of the robot, of its body and of each leg; and its legs."""

ORDER = ("III", "I", "IV", "II")
"""Section 1.2: the legs step in this order."""

STEP_OF_IV = (10.0, 15.0)
"""s; section 3: leg IV makes its step then."""
