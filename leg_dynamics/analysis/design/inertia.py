"""How a leg's masses and inertia depend on its design parameters: learnt from some renderings, then cheap.

Masses of tubes and bars are products of densities, lengths and squared diameters. So the mass of a body, its moment
m c and its inertia about the origin of its frame are polynomials of the parameters, where the centre of mass c and the
inertia about it are quotients. An `InertiaMap` interpolates the polynomials with one rendering a term: a term is looked
for only where all lower ones were found, so that parameters which do not act together cost nothing together. Other
smooth functions, such as those of an angle, are met to rounding by a few more terms. The map is used only if renderings
at random designs confirm it; else every design is rendered.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from leg_dynamics.analysis.design.numbers import read
from leg_dynamics.errors import LegDynamicsError

if TYPE_CHECKING:
    from leg_dynamics.analysis.design.ranges import Range
    from leg_dynamics.description.model import Description
    from leg_dynamics.leg import Leg

__all__ = ["Inertia", "InertiaMap", "inertia_of", "learn_inertia"]

_TERM = 1e-13
"""Relative to a body's mass and extent: what is smaller than this is the rounding of a rendering, not a term."""
_AGREE = 1e-12
"""The same, between the map and renderings that it was not made from."""
_CHECKS = 5
"""Random designs, one in every fifth of each range: what sets in somewhere is seen if it fills a fifth."""
_TRIES = 20
_MOST = 400
"""Renderings, beyond which no study is worth them."""
_MOST_NODES = 16
_GRID = 65
"""Places in a range that its nodes are chosen from."""
_LEAST_MASS = 1e-3
"""Of a body's greatest mass: the centre of mass of a lighter one would be known less well, so that it is rendered."""
_NOTHING = 1e-12
"""Of a number that belongs to no body: below this it is the rounding of zero."""

_AXES = "xyz"
_ENTRIES = tuple((i, j) for i in range(3) for j in range(i, 3))


class Inertia(NamedTuple):
    """What a design's effort depends on, beside the numbers of its kinematics.

    Attributes
    ----------
    numbers : dict of str to float
        Of the route, see `leg_dynamics.leg.Leg.numbers`; empty where only the mass is asked for.
    mass : float
        Of everything that moves with the leg's joints, kg.
    """

    numbers: dict[str, float]
    mass: float


def _moving(description: Description) -> list[str]:
    """Links that move with the leg's joints."""
    return [
        link.name for link in description.links if any(joint.type != "fixed" for joint in description.path(link.name))
    ]


def inertia_of(leg: Leg, description: Description, *, forces: bool) -> Inertia:
    """Read a rendered design.

    Parameters
    ----------
    leg : Leg
        By whose route the numbers are named.
    description : Description
        Of the design.
    forces : bool
        Whether the route's numbers are asked for too.
    """
    masses = _masses(description)
    backend: Any = leg.backend
    numbers = backend.numbers_of(description) if forces else {}
    return Inertia(dict(numbers), math.fsum(masses[name] for name in _moving(description)))


def _masses(description: Description) -> dict[str, float]:
    return {link.name: 0.0 if link.inertial is None else link.inertial.mass for link in description.links}


# A body's numbers and its polynomial ones.


def _bodies(names: Iterable[str]) -> tuple[str, ...]:
    """Bodies of which mass, centre of mass and inertia are all among the names."""
    known = set(names)
    stems = [name.removesuffix(".mass") for name in names if name.endswith(".mass")]
    return tuple(stem for stem in stems if {*_centre(stem), *_tensor(stem)} <= known)


def _centre(body: str) -> tuple[str, ...]:
    return tuple(f"{body}.com.{axis}" for axis in _AXES)


def _tensor(body: str) -> tuple[str, ...]:
    return tuple(f"{body}.i{_AXES[i]}{_AXES[j]}" for i, j in _ENTRIES)


def _shift(numbers: dict[str, float], body: str, mass: float, c: Sequence[float], sign: float) -> None:
    """Add or subtract, from a body's tensor, that of its mass in the centre of mass about the frame's origin."""
    square = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    for name, (i, j) in zip(_tensor(body), _ENTRIES, strict=True):
        numbers[name] += sign * mass * ((square if i == j else 0.0) - c[i] * c[j])


def _to_moments(numbers: Mapping[str, float], bodies: Iterable[str]) -> dict[str, float]:
    """Replace centres of mass by m c and tensors by those about the frame's origin."""
    found = dict(numbers)
    for body in bodies:
        mass, c = found[f"{body}.mass"], [found[name] for name in _centre(body)]
        _shift(found, body, mass, c, 1.0)
        found.update(zip(_centre(body), (mass * each for each in c), strict=True))
    return found


def _from_moments(numbers: Mapping[str, float], bodies: Iterable[str]) -> dict[str, float]:
    """Invert `_to_moments`."""
    found = dict(numbers)
    for body in bodies:
        mass = found[f"{body}.mass"]
        c = [found[name] / mass for name in _centre(body)]
        found.update(zip(_centre(body), c, strict=True))
        _shift(found, body, mass, c, -1.0)
    return found


# Interpolation.


@dataclass(frozen=True)
class InertiaMap:
    """Masses and inertia of a leg as polynomials of design parameters.

    Attributes
    ----------
    parameters : tuple of str
    base : (P,) array
        Their values in the leg that the study starts from.
    names : tuple of str
        Quantities: ``link NAME`` for the mass of every link, kg, then the route's numbers without those of the
        kinematics, bodies by their moments.
    bodies : tuple of str
        Whose numbers are moments.
    moving : tuple of str
        Links whose mass counts.
    scales : (K,) array
        What errors of the quantities are relative to.
    reference : (K,) array
        The quantities at the first node.
    nodes : tuple of tuples of float
        Of each parameter.
    terms : tuple of tuples of int
        Powers of each parameter's Newton polynomial, lower ones first.
    factors : (terms, K) array
    rendered : int
        Renderings that the map is made from.
    checked : int
        Renderings at random designs that agreed.
    """

    parameters: tuple[str, ...]
    base: np.ndarray
    names: tuple[str, ...]
    bodies: tuple[str, ...]
    moving: tuple[str, ...]
    scales: np.ndarray
    reference: np.ndarray
    nodes: tuple[tuple[float, ...], ...]
    terms: tuple[tuple[int, ...], ...]
    factors: np.ndarray
    rendered: int
    checked: int

    def __call__(self, design: Mapping[str, float]) -> Inertia | None:
        """Of a design that gives values for some of the parameters; None where it must be rendered to know."""
        x = [design.get(name, base) for name, base in zip(self.parameters, self.base.tolist(), strict=True)]
        values = _value(self.nodes, self.terms, self.factors, x)
        masses, others = self._kinds
        if not (values[masses] >= _LEAST_MASS * self.scales[masses]).all():
            return None
        # A drive or a friction below zero is an error, which the file's reader has the words for.
        if (values[others] * self.reference[others] < 0.0).any():
            return None
        known = dict(zip(self.names, values.tolist(), strict=True))
        mass = math.fsum(known.pop(f"link {name}") for name in self.moving)
        numbers = {name: value for name, value in known.items() if not name.startswith("link ")}
        return Inertia(_from_moments(numbers, self.bodies), mass)

    @functools.cached_property
    def _kinds(self) -> tuple[np.ndarray, np.ndarray]:
        """Which quantities are masses, and which belong to no body, (K,) bool."""
        weighed = {f"{body}.mass" for body in self.bodies}
        moments = {name for body in self.bodies for name in (*_centre(body), *_tensor(body))}
        masses = np.array([name in weighed or name.startswith("link ") for name in self.names])
        return masses, np.array([name not in moments for name in self.names]) & ~masses


def _value(
    nodes: Sequence[Sequence[float]], terms: Sequence[tuple[int, ...]], factors: Any, x: Sequence[float]
) -> np.ndarray:
    """Sum of the terms at one design."""
    powers = []
    for own, value in zip(nodes, x, strict=True):
        column = [1.0]
        for k in range(1, len(own)):
            product = 1.0
            for j in range(k):
                product *= (value - own[j]) / (own[k] - own[j])
            column.append(product)
        powers.append(column)
    # Term by term: the sum of a matrix product may depend on the machine's threads.
    result = np.array(factors[0])
    for term, factor in zip(terms[1:], factors[1:], strict=True):
        weight = 1.0
        for k, power in enumerate(term):
            if power:
                weight *= powers[k][power]
        result += weight * factor
    return result


class _NoMapError(Exception):
    """Why there is no map."""


@dataclass
class _Learner:
    leg: Leg
    parameters: tuple[str, ...]
    spans: list[tuple[float, float]]
    kinematic: frozenset[str]
    forces: bool
    most: int
    moving: tuple[str, ...]
    names: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()
    rendered: int = 0
    nodes: list[list[float]] = field(default_factory=list)

    def quantities(self, x: Sequence[float]) -> np.ndarray | None:
        """Render a design; None where there is no leg, or one with other links."""
        try:
            description = read(self.leg, dict(zip(self.parameters, x, strict=True)))
            numbers = inertia_of(self.leg, description, forces=self.forces).numbers
        except LegDynamicsError:
            return None
        numbers = {name: value for name, value in numbers.items() if name not in self.kinematic}
        masses = {f"link {name}": mass for name, mass in _masses(description).items()}
        names = (*masses, *numbers)
        if not self.names:
            # the centre of mass of what weighs nothing is a number like others
            self.bodies = tuple(body for body in _bodies(numbers) if numbers[f"{body}.mass"] > 0.0)
            self.names = names
        if names != self.names or tuple(_moving(description)) != self.moving:
            return None
        return np.array([*masses.values(), *_to_moments(numbers, self.bodies).values()])

    def within_budget(self, pending: int) -> None:
        if self.rendered + pending + _CHECKS > self.most:
            raise _NoMapError(
                f"learning how {', '.join(self.parameters)} act on masses and inertia takes more than {self.most} "
                f"renderings, the most that pay in a study of this size"
            )

    def next_node(self, k: int) -> list[float]:
        """Places for a parameter's next node, the best first: farthest from the others in the sense of Leja."""
        low, high = self.spans[k]
        grid = np.linspace(low, high, _GRID)
        distance = np.ones(_GRID)
        for node in self.nodes[k]:
            distance *= np.abs(grid - node) / (high - low)
        order = np.argsort(-distance, kind="stable")
        return [float(grid[j]) for j in order[:: _GRID // 8] if distance[j] > 0.0]

    def scales(self, found: np.ndarray) -> np.ndarray:
        """What errors are relative to, from samples (N, K): mass, mass times radius, mass times radius squared."""
        greatest = dict(zip(self.names, np.abs(found).max(axis=0).tolist(), strict=True))
        result = {name: value if value > _NOTHING else 1.0 for name, value in greatest.items()}
        for name in self.names:
            if name.startswith("link "):
                result[name] = greatest[name]
        for body in self.bodies:
            mass = greatest[f"{body}.mass"]
            radius = math.sqrt(max(greatest[name] for name in _tensor(body)) / mass)
            result[f"{body}.mass"] = mass
            # a point mass in its frame's origin has no radius, and the moments of none
            result |= dict.fromkeys(_centre(body), mass * radius or 1.0)
            result |= dict.fromkeys(_tensor(body), mass * radius**2 or 1.0)
        return np.array([result[name] for name in self.names])

    def learn(self, seed: int) -> tuple[Any, ...]:
        generator = np.random.default_rng(seed)

        # A random first node: at a distinguished one, such as a mass of zero, whole terms vanish.
        for _ in range(_TRIES):
            x = self.design(generator.uniform(0.3, 0.7, len(self.spans)))
            first = self.quantities(x)
            if first is not None:
                break
        else:
            raise _NoMapError(f"the leg could be made at none of {_TRIES} random designs")
        self.nodes = [[value] for value in x]
        self.rendered = 1
        count = len(self.parameters)
        terms, factors, samples = [(0,) * count], [first], [first]
        units = [tuple(int(j == k) for j in range(count)) for k in range(count)]
        pending = list(units)
        while pending:
            self.within_budget(len(pending))
            term = pending.pop(0)
            x, value = self._at(term)
            samples.append(value)
            excess = value - _value(self.nodes, terms, factors, x)
            small = np.abs(excess) <= _TERM * self.scales(np.array(samples))
            if small.all():
                if sum(term) == 1:
                    self._check_other_end(x, term.index(1), value, first)
                continue
            terms.append(term)
            factors.append(np.where(small, 0.0, excess))
            there = set(terms)
            for unit in units:
                other = tuple(a + b for a, b in zip(term, unit, strict=True))
                lower = (tuple(a - b for a, b in zip(other, each, strict=True)) for each in units)
                if all(min(each) < 0 or each in there for each in lower):
                    pending.append(other)
        scales = self.scales(np.array(samples))
        self._check(generator, terms, factors, scales)
        return terms, factors, scales

    def _at(self, term: tuple[int, ...]) -> tuple[list[float], np.ndarray]:
        """Render a term's node; a parameter's next node is wherever there is a leg."""
        new = [k for k, power in enumerate(term) if power == len(self.nodes[k])]
        if not new:
            x = [own[power] for own, power in zip(self.nodes, term, strict=True)]
            value = self.quantities(x)
            self.rendered += 1
            if value is None:
                raise _NoMapError(f"the leg cannot be made at some values of {', '.join(self.parameters)} together")
            return x, value
        (k,) = new
        if term[k] >= _MOST_NODES:
            raise _NoMapError(
                f"masses or inertia are no polynomial of {self.parameters[k]!r} of a degree below {term[k]}"
            )
        for place in self.next_node(k):
            x = [own[power] if j != k else place for j, (own, power) in enumerate(zip(self.nodes, term, strict=True))]
            value = self.quantities(x)
            self.rendered += 1
            if value is not None:
                self.nodes[k].append(place)
                return x, value
        raise _NoMapError(f"the leg cannot be made at most values of {self.parameters[k]!r}")

    def _check_other_end(self, x: Sequence[float], k: int, value: np.ndarray, first: np.ndarray) -> None:
        """Refuse a parameter that does nothing at one end of its range and something at the other."""
        low, high = self.spans[k]
        other = low if x[k] > self.nodes[k][0] else high
        found = self.quantities([other if j == k else each for j, each in enumerate(x)])
        self.rendered += 1
        if found is None:
            return
        wrong = np.abs(found - value) > _TERM * self.scales(np.array([first, value, found]))
        if wrong.any():
            raise self.not_smooth(wrong, [self.parameters[k]])

    def design(self, shares: np.ndarray) -> list[float]:
        """Values of the parameters from shares of their ranges."""
        return [float(a + share * (b - a)) for share, (a, b) in zip(shares, self.spans, strict=True)]

    def not_smooth(self, wrong: np.ndarray, parameters: Sequence[str]) -> _NoMapError:
        name = self.names[int(np.argmax(wrong))].removeprefix("link ")
        return _NoMapError(f"{name} is no smooth function of {', '.join(parameters)}")

    def _check(self, generator: np.random.Generator, terms: Any, factors: Any, scales: np.ndarray) -> None:
        count, checked = len(self.spans), 0
        parts = np.array([generator.permutation(_CHECKS) for _ in range(count)])
        for _ in range(_TRIES):
            x = self.design((parts[:, checked] + generator.random(count)) / _CHECKS)
            value = self.quantities(x)
            if value is None:
                continue
            wrong = np.abs(value - _value(self.nodes, terms, factors, x)) > _AGREE * scales
            if wrong.any():
                raise self.not_smooth(wrong, self.parameters)
            checked += 1
            if checked == _CHECKS:
                return
        raise _NoMapError(
            f"the leg could be made at {checked} of {_TRIES} random designs, too few to check its masses by"
        )


def learn_inertia(
    leg: Leg, ranges: Sequence[Range], kinematic: Iterable[str], designs: int, seed: int = 0, *, forces: bool
) -> InertiaMap | str:
    """Find how masses and inertia depend on the parameters.

    Parameters
    ----------
    leg : Leg
        By a route whose formulas take numbers as inputs.
    ranges : sequence of Range
        Parameters and where they will be; the value that the leg has now is always included.
    kinematic : iterable of str
        The route's numbers that are known otherwise.
    designs : int
        Of the study; at most half as many are rendered to learn from.
    seed : int
        Of the first node, and of the designs that check the map.
    forces : bool
        Whether the route's numbers are asked for, beside masses.

    Returns
    -------
    InertiaMap or str
        The text says why there is no map, and each design must be rendered.
    """
    key = (leg.recipe, tuple(ranges), frozenset(kinematic), min(designs // 2, _MOST), seed, forces)
    if key not in _LEARNT:
        if len(_LEARNT) > _MOST_LEARNT:
            _LEARNT.clear()
        _LEARNT[key] = _learn(leg, ranges, frozenset(kinematic), min(designs // 2, _MOST), seed, forces)
    return _LEARNT[key]


_LEARNT: dict[Any, InertiaMap | str] = {}
"""Of this process; recipes compare by content."""
_MOST_LEARNT = 64


def _learn(
    leg: Leg, ranges: Sequence[Range], kinematic: frozenset[str], most: int, seed: int, forces: bool
) -> InertiaMap | str:
    base = [leg.parameters[each.name].value for each in ranges]
    spans = [(min(each.lower, value), max(each.upper, value)) for each, value in zip(ranges, base, strict=True)]
    moving = tuple(_moving(leg.description))
    learner = _Learner(leg, tuple(each.name for each in ranges), spans, kinematic, forces, most, moving)
    try:
        learner.within_budget(1 + len(ranges))
        terms, factors, scales = learner.learn(seed)
    except _NoMapError as why:
        return str(why)
    return InertiaMap(
        learner.parameters,
        np.array(base),
        learner.names,
        learner.bodies,
        moving,
        scales,
        factors[0],
        tuple(tuple(own) for own in learner.nodes),
        tuple(terms),
        np.array(factors),
        learner.rendered,
        _CHECKS,
    )
