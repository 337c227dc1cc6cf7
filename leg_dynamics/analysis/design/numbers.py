"""How a leg's numbers depend on its design parameters: learnt from a few renderings, then cheap.

Rendering and reading a xacro source takes some 0.2 s, too long for thousands of designs. But the numbers that the
kinematics and its constraints need are, as a rule, affine in the parameters: lengths and limits stand in the file as
they are, or as sums, or in other units. A `NumberMap` finds the coefficients from renderings at the ends of the ranges
and is used only if renderings at random designs in between confirm it to 1e-13; else every design is rendered.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.analysis.dexterity import home_coordinates
from leg_dynamics.analysis.workspace.constraints import limit_numbers
from leg_dynamics.errors import LegDynamicsError, LegDynamicsWarning

if TYPE_CHECKING:
    from leg_dynamics.analysis.design.ranges import Range
    from leg_dynamics.description.model import Description
    from leg_dynamics.leg import Leg

__all__ = ["NumberMap", "build", "kinematic_numbers", "learn", "read"]

_AGREE = 1e-13
"""Relative to 1 + magnitude: rounding of a sum of some ten products."""

_CHECKS = 3
_TRIES = 8


def read(leg: Leg, parameters: Mapping[str, float]) -> Description:
    """Render and read the leg's source with some parameters changed."""
    recipe: Any = leg.recipe
    with _without_warnings():
        return leg.description if not parameters else recipe.with_parameters(dict(parameters)).description


def build(leg: Leg, parameters: Mapping[str, float]) -> Leg:
    """Make the leg with some parameters changed; every impossible value has its error here."""
    with _without_warnings():
        return leg.replace(**parameters)


@contextlib.contextmanager
def _without_warnings() -> Iterator[None]:
    """What is odd in one of thousands of designs is no news; the chosen one is made again in the open."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        yield


def _structure(description: Description) -> tuple[Any, ...]:
    """What a map cannot move: joints' types, axes and rotations, and which links constraints are about."""
    joints = tuple(
        (j.name, j.type, j.parent, j.child, j.axis, np.round(j.origin.rotation(), 13).tobytes())
        for j in description.joints
    )
    cones = tuple((c.name, c.link, c.other_link) for c in description.cones)
    clearances = tuple((c.name, c.first.link, c.second.link) for c in description.clearances)
    return joints, cones, clearances, tuple(t.joint for t in description.telescopes), description.transmissions


@dataclass(frozen=True)
class NumberMap:
    """Numbers of a leg as affine functions of design parameters.

    Attributes
    ----------
    parameters : tuple of str
    base : (P,) array
        Their values in the leg that the study starts from.
    names : tuple of str
        Numbers of the constraints (`limit_numbers`), of the route (``route NAME``), and ``home.x`` ... of the foot's
        home position, m.
    values : (K,) array
        At the base.
    slopes : (K, P) array
    checked : int
        Renderings at random designs that agreed.
    """

    parameters: tuple[str, ...]
    base: np.ndarray
    names: tuple[str, ...]
    values: np.ndarray
    slopes: np.ndarray
    checked: int

    def __call__(self, design: Mapping[str, float]) -> np.ndarray:
        """Numbers of a design that gives values for some of the parameters, (K,)."""
        shift = np.array([design.get(name, base) - base for name, base in zip(self.parameters, self.base, strict=True)])
        # Column by column: the sum of a matrix product depends on how many columns there are.
        result = self.values.copy()
        for k in range(len(shift)):
            if shift[k] != 0.0:
                result += self.slopes[:, k] * shift[k]
        return result

    def moving(self) -> tuple[str, ...]:
        """Names of the numbers that some parameter moves."""
        return tuple(name for name, row in zip(self.names, self.slopes, strict=True) if row.any())


def kinematic_numbers(leg: Leg) -> tuple[str, ...]:
    """Names of the route's numbers that foot, Jacobian or tree coordinates depend on."""
    import casadi

    backend: Any = leg.backend
    names = tuple(backend.numbers_of(leg.description))
    depends = np.zeros(len(names), dtype=bool)
    for formula in ("tree_coordinates", "foot_jacobian"):
        graph = backend.kernels.program(formula, names).formula
        q, values = casadi.SX.sym("q", graph.numel_in(0)), casadi.SX.sym("values", len(names))
        depends |= np.array(casadi.which_depends(casadi.vertcat(*graph(q, values)), values, 1, False))
    return tuple(name for name, used in zip(names, depends, strict=True) if used)


@dataclass(frozen=True)
class _Described:
    """What `home_coordinates` looks at."""

    joint_names: tuple[str, ...]
    description: Description


def _numbers(leg: Leg, description: Description, kinematic: tuple[str, ...]) -> dict[str, float] | None:
    """All numbers of one description that the kinematics needs; None where it has another structure."""
    if _structure(description) != _structure(leg.description):
        return None
    backend: Any = leg.backend
    own = backend.numbers_of(description)
    found = limit_numbers(description) | {f"route {name}": own[name] for name in kinematic}
    q = home_coordinates(_Described(leg.joint_names, description))  # type: ignore[arg-type]
    foot = backend.kernel("foot_position", kinematic).ufunc(q, np.array([own[name] for name in kinematic]))
    return found | {f"home.{axis}": float(value) for axis, value in zip("xyz", foot, strict=True)}


def learn(leg: Leg, ranges: Sequence[Range], seed: int = 0) -> NumberMap | str:
    """Find how the numbers depend on the parameters.

    Parameters
    ----------
    leg : Leg
        By a route whose formulas take numbers as inputs.
    ranges : sequence of Range
        Parameters and where they will be; an end at which the leg cannot be made is left out.
    seed : int
        Of the designs that check the map.

    Returns
    -------
    NumberMap or str
        The text says why there is no map, and each design must be rendered.
    """
    key = (leg.recipe, tuple(ranges), seed)
    if key not in _LEARNT:
        if len(_LEARNT) > _MOST_LEARNT:
            _LEARNT.clear()
        _LEARNT[key] = _learn(leg, ranges, seed)
    return _LEARNT[key]


_LEARNT: dict[Any, NumberMap | str] = {}
"""Of this process, which renders a source only once; recipes compare by content."""
_MOST_LEARNT = 64


def _learn(leg: Leg, ranges: Sequence[Range], seed: int) -> NumberMap | str:
    backend: Any = leg.backend
    if not (hasattr(backend, "kernels") and hasattr(backend, "numbers_of") and hasattr(backend.kernels, "program")):
        return f"route {leg.route!r} has no formulas that take numbers as inputs"
    kinematic = kinematic_numbers(leg)
    if not kinematic:
        return "no number of the formulas moves the foot"
    at_base = _numbers(leg, leg.description, kinematic)
    assert at_base is not None
    names = tuple(at_base)
    values = np.array([at_base[name] for name in names])

    def at(design: Mapping[str, float]) -> np.ndarray | str | None:
        try:
            found = _numbers(leg, read(leg, design), kinematic)
        except LegDynamicsError:
            return None  # no leg there, which says nothing about the others
        if found is None or tuple(found) != names:
            return f"{', '.join(design)} changes what joints and constraints there are"
        return np.array([found[name] for name in names])

    slopes = np.zeros((len(names), len(ranges)))
    base = np.array([leg.parameters[each.name].value for each in ranges])
    usable: list[tuple[float, float]] = []
    for k, each in enumerate(ranges):
        points: list[tuple[float, np.ndarray]] = []
        for share in (0.0, 1.0, 0.5, 0.25, 0.75):
            value = each.lower + share * (each.upper - each.lower)
            found = at({each.name: value})
            if isinstance(found, str):
                return found
            if found is not None:
                points.append((value, found))
            if len(points) == 2:
                break
        if len(points) < 2:
            return f"the leg cannot be made at most values of {each.name!r} between {each.lower:g} and {each.upper:g}"
        (one, low), (other, high) = points
        slopes[:, k] = (high - low) / (other - one)
        usable.append((min(one, other), max(one, other)))
    slopes[np.abs(slopes) * np.array([high - low for low, high in usable]) < _AGREE] = 0.0
    draft = NumberMap(tuple(each.name for each in ranges), base, names, values, slopes, 0)
    generator, checked = np.random.default_rng(seed), 0
    wrong = np.zeros(len(names), dtype=bool)
    for _ in range(_TRIES):
        design = {each.name: float(generator.uniform(*span)) for each, span in zip(ranges, usable, strict=True)}
        found = at(design)
        if isinstance(found, str):
            return found
        if found is None:
            continue
        wrong |= np.abs(found - draft(design)) > _AGREE * (1.0 + np.abs(found))
        checked += 1
        if checked == _CHECKS:
            break
    if checked == 0:
        return "the leg could be made at no random design, so that nothing checks how its numbers depend on them"
    bad = [name for name, is_wrong in zip(names, wrong, strict=True) if is_wrong]
    if bad:
        return f"{bad[0]} is no affine function of {', '.join(draft.parameters)}"
    return replace(draft, checked=checked)
