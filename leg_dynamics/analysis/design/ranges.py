"""What a study varies: ranges of named parameters, and limits on what comes out; both read from short texts."""

from __future__ import annotations

import difflib
import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from leg_dynamics.errors import ParameterError, StudyError

__all__ = ["Filter", "Range", "check_names", "sampled", "swept"]

_COMPARISONS: dict[str, Callable[[Any, Any], Any]] = {
    ">=": operator.ge,
    "<=": operator.le,
    ">": operator.gt,
    "<": operator.lt,
}
_FILTER = re.compile(r"\s*([A-Za-z_]\w*)\s*(>=|<=|>|<)\s*(\S+)\s*")
_MOST_STEPS = 100_000


@dataclass(frozen=True)
class Range:
    """An interval of one parameter, in the unit that `Leg.parameters` states.

    Parameters
    ----------
    name : str
    lower, upper : float
        Finite, lower < upper.
    steps : int or None
        Values of a sweep, at least 2; None for random sampling.
    """

    name: str
    lower: float
    upper: float
    steps: int | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lower) and math.isfinite(self.upper) and self.lower < self.upper):
            raise ParameterError(
                f"the range of {self.name!r} is {self.lower:g} to {self.upper:g}: give two finite numbers, the smaller "
                "one first",
                name=self.name,
            )
        if self.steps is not None and not 2 <= self.steps <= _MOST_STEPS:
            raise ParameterError(
                f"a sweep of {self.name!r} in {self.steps} steps: give at least 2 and at most {_MOST_STEPS}",
                name=self.name,
            )

    @staticmethod
    def parse(text: str) -> Range:
        """Read ``NAME=LOWER:UPPER`` or, for a sweep, ``NAME=LOWER:UPPER:STEPS``."""
        name, equals, rest = text.partition("=")
        parts = rest.split(":")
        try:
            lower, upper = float(parts[0]), float(parts[1])
            steps = int(parts[2]) if len(parts) == 3 else None
        except (ValueError, IndexError):
            equals = ""
        if not (equals and name.strip() and len(parts) in (2, 3)):
            raise ParameterError(f"{text!r} is no range: write NAME=LOWER:UPPER, or NAME=LOWER:UPPER:STEPS for a sweep")
        return Range(name.strip(), lower, upper, steps)

    def values(self) -> np.ndarray:
        """The values of a sweep, evenly spaced, both ends among them."""
        assert self.steps is not None
        return np.linspace(self.lower, self.upper, self.steps)

    def __str__(self) -> str:
        steps = "" if self.steps is None else f":{self.steps}"
        return f"{self.name}={self.lower:.12g}:{self.upper:.12g}{steps}"


@dataclass(frozen=True)
class Filter:
    """A limit on an objective or a parameter: ``L>=1.0``; a value that is NaN does not pass."""

    name: str
    comparison: str
    value: float

    def __post_init__(self) -> None:
        if self.comparison not in _COMPARISONS or not math.isfinite(self.value):
            raise StudyError(
                f"the filter {self} is not usable: compare with a finite number by one of {', '.join(_COMPARISONS)}"
            )

    @staticmethod
    def parse(text: str) -> Filter:
        """Read ``NAME>=VALUE``, with one of >=, <=, > and <."""
        found = _FILTER.fullmatch(text)
        try:
            if found is not None:
                return Filter(found[1], found[2], float(found[3]))
        except ValueError:
            pass
        raise StudyError(f"{text!r} is no filter: write NAME>=VALUE, with one of {', '.join(_COMPARISONS)}")

    def passes(self, values: Any) -> Any:
        """Whether a value, or each of an array, is inside."""
        return _COMPARISONS[self.comparison](values, self.value)

    def __str__(self) -> str:
        return f"{self.name}{self.comparison}{self.value:.12g}"


def sampled(ranges: Iterable[Range], seed: int, stage: int, index: int) -> dict[str, float]:
    """Draw one design uniformly, from a random stream of its own.

    The stream depends on seed, stage and index only, so that no division of the work changes a design.
    """
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(stage, index))))
    return {each.name: float(generator.uniform(each.lower, each.upper)) for each in ranges}


def swept(each: Range) -> list[dict[str, float]]:
    """Return the designs of a sweep."""
    return [{each.name: float(value)} for value in each.values()]


def check_names(what: str, names: Iterable[str], known: Iterable[str] | Mapping[str, Any], leg: str) -> None:
    """Refuse, by a `ParameterError`, a name that is not among the known ones, or one given twice."""
    seen: set[str] = set()
    listed = list(known)
    for name in names:
        if name not in listed:
            near = difflib.get_close_matches(name, listed, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ParameterError(
                f"{leg!r} has no {what} {name!r}{hint} (it has {', '.join(listed[:30]) or 'none'})", name=name
            )
        if name in seen:
            raise ParameterError(f"{what} {name!r} is given twice", name=name)
        seen.add(name)
