"""What two arrays that should be equal differ by, where the data say so exactly: sign, factor, exchange, lost term."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

__all__ = ["LEAST_STATES", "Entries", "agree", "diagnose", "orders"]

LEAST_STATES = 5
"""Fewer states fit anything."""
VANISHING = 1e-9
"""A number so small beside 1 says nothing of its sign or factor."""
NAMED_WITHIN = 1e-7
"""A fitted factor is a well-known one within this relative distance: the noise of a fit."""
LARGEST_PERMUTED = 4
"""Rows or columns of which every order is tried; of more, exchanges of two."""

_FACTORS: dict[float, str] = {
    2.0: "twice",
    0.5: "half",
    math.pi / 180.0: "pi/180 times (degrees for radians)",
    180.0 / math.pi: "180/pi times (radians for degrees)",
    1000.0: "1000 times (millimetres for metres)",
    0.001: "1/1000 times (metres for millimetres)",
}


@dataclass(frozen=True)
class Entries:
    """Names of the entries of one result.

    Attributes
    ----------
    form : str
        Name of an entry, with a place for each axis: ``"d foot {} / d {}"``.
    axes : tuple of tuple of str
        Names along each axis; none for a scalar.
    """

    form: str
    axes: tuple[tuple[str, ...], ...] = ()

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one result."""
        return tuple(len(names) for names in self.axes)

    def name(self, index: Sequence[int]) -> str:
        """Name of one entry."""
        return self.form.format(*(names[i] for names, i in zip(self.axes, index, strict=True)))

    def listed(self, chosen: np.ndarray, neutral: np.ndarray) -> str:
        """What some entries are together: everything, whole columns or rows, or their names.

        Parameters
        ----------
        chosen : array of bool
            The entries meant, of the result's shape.
        neutral : array of bool
            Entries that may belong to them as well as not, since what is said of them is true of these too.
        """
        if not self.axes:
            return "every value"
        if (chosen | neutral).all():
            return "every entry"
        if chosen.ndim == 2:
            for axis, word in ((1, "column"), (0, "row")):
                whole = np.flatnonzero((chosen | neutral).all(axis=1 - axis) & chosen.any(axis=1 - axis))
                if chosen.any(axis=1 - axis).sum() == len(whole):
                    names = ", ".join(self.axes[axis][i] for i in whole)
                    return f"every entry of {word}{'s' * (len(whole) > 1)} {names}"
        return ", ".join(self.name(index) for index in np.argwhere(chosen).tolist())


@dataclass
class _Pair:
    """Own and reference values (N, ...) with the scale that differences are relative to, (N,)."""

    own: np.ndarray
    reference: np.ndarray
    tolerance: float
    scale: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        over = tuple(range(1, self.own.ndim))
        largest = np.maximum(np.abs(self.own), np.abs(self.reference)).max(axis=over, initial=0.0)
        self.scale = (1.0 + largest).reshape(-1, *(1,) * len(over))

    def equal(self, other: np.ndarray) -> bool:
        """Whether own values are these throughout."""
        return bool((np.abs(self.own - other) <= self.tolerance * self.scale).all())

    def differing(self) -> np.ndarray:
        """Entries that differ from the reference in some state, (...) bool."""
        return np.asarray((np.abs(self.own - self.reference) > self.tolerance * self.scale).any(axis=0))

    def always_zero(self) -> np.ndarray:
        """Entries that are zero in own and reference values alike, (...) bool."""
        largest = np.maximum(np.abs(self.own), np.abs(self.reference)) / self.scale
        return np.asarray((largest <= VANISHING).all(axis=0))


def agree(own: np.ndarray, reference: np.ndarray, tolerance: float) -> bool:
    """Whether values (N, ...) agree in all states of which both have numbers, at least `LEAST_STATES` of them."""
    known = _known(own, reference)
    return int(known.sum()) >= LEAST_STATES and _Pair(own[known], reference[known], tolerance).equal(reference[known])


def diagnose(
    own: np.ndarray,
    reference: np.ndarray,
    entries: Entries,
    tolerance: float,
    *,
    terms: Iterable[Mapping[str, np.ndarray]] = (),
    factors: Mapping[float, str] | None = None,
) -> str:
    """Say what own values differ from the reference by, where one statement holds in every state.

    Parameters
    ----------
    own, reference : (N, ...) array
        Values in N states; those with NaN are left out.
    entries : Entries
    tolerance : float
        Relative to 1 + magnitude.
    terms : iterable of mapping of str to (N, ...) array
        Parts of the reference which own values may lack, count twice or with the wrong sign: coarse ones, then finer
        ones for what they do not explain.
    factors : mapping of float to str, optional
        Names of further factors.

    Returns
    -------
    str
        Empty where no statement is exact.
    """
    known = _known(own, reference)
    if int(known.sum()) < LEAST_STATES:
        return ""
    pair = _Pair(own[known], reference[known], tolerance)
    differing = pair.differing()
    if not differing.any():
        return ""
    names = _FACTORS | dict(factors or {})
    if (factor := _factor(pair, (...,))) is not None:
        return f"{entries.listed(differing, ~differing)} {_said(factor, names)}"
    for sentence, other in _exchanges(pair.reference, entries):
        if pair.equal(other):
            return sentence
    parts = [{name: values[known] for name, values in group.items()} for group in terms]
    return _by_entry(pair, entries, differing, parts, names)


def _known(own: np.ndarray, reference: np.ndarray) -> np.ndarray:
    finite = np.isfinite(own) & np.isfinite(reference)
    return np.asarray(finite.reshape(len(own), -1).all(axis=1))


def _exchanges(reference: np.ndarray, entries: Entries) -> Iterator[tuple[str, np.ndarray]]:
    """Sentences, each with what the reference is with rows, columns or entries exchanged."""
    shape = entries.shape
    if len(shape) == 2 and shape[0] == shape[1]:
        yield "the matrix is transposed", reference.swapaxes(1, 2)
    for axis, names in reversed(list(enumerate(entries.axes))):
        word = ("rows", "columns")[axis] if len(shape) == 2 else "entries"
        for order in orders(len(names)):
            moved = [names[i] for i, j in enumerate(order) if i != j]
            what = "are exchanged" if len(moved) == 2 else "are in another order"
            yield f"the {word} {', '.join(moved)} {what}", reference.take(order, axis=axis + 1)


def orders(count: int) -> Iterable[tuple[int, ...]]:
    """Every other order of a few places, those that move the fewest first; of many, the exchanges of two."""
    straight = tuple(range(count))
    if count <= LARGEST_PERMUTED:
        others = [order for order in itertools.permutations(straight) if order != straight]
        return sorted(others, key=lambda order: sum(i != j for i, j in enumerate(order)))
    swapped = []
    for i, j in itertools.combinations(straight, 2):
        order = list(straight)
        order[i], order[j] = j, i
        swapped.append(tuple(order))
    return swapped


def _factor(pair: _Pair, index: tuple[Any, ...]) -> float | None:
    """Factor of own values to the reference at some entries, where it is one number."""
    entry: Any = (slice(None), *index)
    own, reference = (values[entry] / np.broadcast_to(pair.scale, values.shape)[entry] for values in _both(pair))
    telling = np.abs(reference).reshape(len(reference), -1).max(axis=1, initial=0.0) > VANISHING
    if int(telling.sum()) < LEAST_STATES:
        return None
    factor = float((own * reference).sum() / (reference**2).sum())
    return factor if (np.abs(own - factor * reference) <= pair.tolerance).all() else None


def _both(pair: _Pair) -> tuple[np.ndarray, np.ndarray]:
    return pair.own, pair.reference


def _near(value: float, other: float) -> bool:
    return abs(value - other) <= NAMED_WITHIN * abs(other)


def _said(factor: float, names: Mapping[float, str]) -> str:
    if abs(factor) <= NAMED_WITHIN:
        return "is zero"
    if _near(factor, -1.0):
        return "is the negative of the reference: a sign error"
    for known, text in names.items():
        for sign, word in ((1.0, ""), (-1.0, "minus ")):
            if _near(factor, sign * known):
                return f"is {word}{text} the reference"
    return f"is {factor:.8g} times the reference"


def _by_entry(
    pair: _Pair,
    entries: Entries,
    differing: np.ndarray,
    terms: Sequence[Mapping[str, np.ndarray]],
    names: Mapping[float, str],
) -> str:
    """What each differing entry differs by, entries that differ by the same together."""
    found: dict[_Statement, np.ndarray] = {}
    for index in map(tuple, np.argwhere(differing)):
        statement = _of_entry(pair, index, terms, names)
        found.setdefault(statement, np.zeros_like(differing))[index] = True
    if {statement.text for statement in found} == {""}:
        return ""
    zero, none = pair.always_zero(), np.zeros_like(differing)
    sentences = []
    for (text, of_zero), chosen in found.items():
        where = entries.listed(chosen, zero if of_zero and chosen.ndim == 2 else none)
        if where == "every value" and not text.startswith("is "):
            sentences.append(text)
        else:
            several = int(chosen.sum()) > 1 and not where.startswith("every")
            verb = f" are {text[3:]}" if several else f" {text}"
            sentences.append(where + (verb if text.startswith("is ") else f": {text or 'no simple relation'}"))
    return "; ".join(sentences)


class _Statement(NamedTuple):
    """What is said of an entry, and whether it is true of an entry that is always zero as well: a factor is."""

    text: str
    of_zero: bool = False


def _of_entry(
    pair: _Pair, index: tuple[int, ...], terms: Sequence[Mapping[str, np.ndarray]], names: Mapping[float, str]
) -> _Statement:
    factor = _factor(pair, index)
    known = (0.0, -1.0, *names, *(-name for name in names))
    if factor is not None and any(abs(factor - other) <= NAMED_WITHIN * max(abs(other), 1.0) for other in known):
        return _Statement(_said(factor, names), True)
    entry: Any = (slice(None), *index)
    difference, scale = (pair.own - pair.reference)[entry], pair.scale.reshape(-1)
    offset = float(np.mean(difference))
    if (np.abs(difference - offset) <= pair.tolerance * scale).all():
        return _Statement(f"is off by the constant {offset:.8g}")
    if factor is not None:
        return _Statement(_said(factor, names), True)
    for group in terms:
        text = _of_terms(
            difference / scale, {name: part[entry] / scale for name, part in group.items()}, pair.tolerance
        )
        if text:
            return _Statement(text)
    return _Statement("")


def _of_terms(difference: np.ndarray, terms: Mapping[str, np.ndarray], tolerance: float) -> str:
    """Which terms, each (N,), a difference (N,) is made of."""
    parts = {name: part for name, part in terms.items() if np.abs(part).max(initial=0.0) > VANISHING}
    if not parts or len(difference) < LEAST_STATES * len(parts):
        return ""
    columns = np.stack(list(parts.values()), axis=-1)
    width = np.abs(columns).max(axis=0)
    weights, *_ = np.linalg.lstsq(columns / width, difference, rcond=None)
    if not (np.abs((columns / width) @ weights - difference) <= tolerance).all():
        return ""
    shares = dict(zip(parts, weights / width, strict=True))
    return ", ".join(_missing(name, share) for name, share in shares.items() if abs(share) > NAMED_WITHIN)


def _missing(name: str, share: float) -> str:
    """What a difference of `share` times a term means."""
    if _near(share, -1.0):
        return f"without {name}"
    if _near(share, -2.0):
        return f"wrong sign of {name}"
    if _near(share, 1.0):
        return f"twice {name}"
    return f"{1.0 + share:.8g} times {name}"
