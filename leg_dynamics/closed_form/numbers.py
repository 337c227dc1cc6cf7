"""A leg's numbers by name: what a formula's graph can keep open instead of baking it in."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from leg_dynamics.errors import ParameterError

__all__ = ["named_numbers", "with_numbers"]

_AXES = "xyz"


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _names_in(name: str, value: Any) -> dict[str, Any]:
    """Numbers of one field: itself, a tuple's entries counted from 1, or the parts of named tuples by their names."""
    if _is_number(value):
        return {name: value}
    if not isinstance(value, tuple):
        return {}
    if value and all(hasattr(part, "_fields") for part in value):
        found: dict[str, Any] = {}
        for part in value:
            label, *others = part._fields
            for other in others:
                found |= _parts(f"{getattr(part, label)}.{other}", getattr(part, other))
        return found
    return {f"{name}_{index}": entry for index, entry in enumerate(value, 1) if _is_number(entry)}


def _parts(name: str, value: Any) -> dict[str, Any]:
    """A number, a vector as NAME.x ..., or the six entries of a symmetric tensor as BODY.ixx ..."""
    if _is_number(value):
        return {name: value}
    if isinstance(value[0], tuple):
        body = name.rpartition(".")[0]
        return {f"{body}.i{_AXES[i]}{_AXES[j]}": value[i][j] for i in range(3) for j in range(i, 3)}
    return {f"{name}.{axis}": entry for axis, entry in zip(_AXES, value, strict=True)}


def named_numbers(leg: Any) -> Mapping[str, float]:
    """Every number of a leg's dataclass by name, in order of its fields.

    ``L1`` for a number, ``psi_1`` ... for the entries of a tuple, and for bodies ``knee.mass``, ``knee.com.x``,
    ``knee.ixx`` in the body's frame, about the centre of mass, SI units.
    """
    found: dict[str, float] = {}
    for field in fields(leg):
        found |= _names_in(field.name, getattr(leg, field.name))
    return found


def _replaced(name: str, value: Any, changes: Mapping[str, Any]) -> Any:
    if _is_number(value):
        return changes.get(name, value)
    if not isinstance(value, tuple):
        return value
    if value and all(hasattr(part, "_fields") for part in value):
        return tuple(_replaced_part(part, changes) for part in value)
    return tuple(changes.get(f"{name}_{index}", entry) for index, entry in enumerate(value, 1))


def _replaced_part(part: Any, changes: Mapping[str, Any]) -> Any:
    label = getattr(part, part._fields[0])
    values = {}
    for field in part._fields[1:]:
        value = getattr(part, field)
        if _is_number(value):
            values[field] = changes.get(f"{label}.{field}", value)
        elif isinstance(value[0], tuple):
            values[field] = tuple(
                tuple(changes.get(f"{label}.i{_AXES[min(i, j)]}{_AXES[max(i, j)]}", value[i][j]) for j in range(3))
                for i in range(3)
            )
        else:
            values[field] = tuple(
                changes.get(f"{label}.{field}.{axis}", entry) for axis, entry in zip(_AXES, value, strict=True)
            )
    return part._replace(**values)


def with_numbers(leg: Any, changes: Mapping[str, Any]) -> Any:
    """Return the leg with some of its `named_numbers` replaced, by numbers or by symbols.

    Raises
    ------
    ParameterError
        There is no number of that name.
    """
    known = named_numbers(leg)
    for name in changes:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ParameterError(
                f"the formulas have no number {name!r}{hint} (they have {', '.join(list(known)[:8])}, ... "
                f"{len(known)} in all)",
                parameter=name,
            )
    return replace(
        leg, **{field.name: _replaced(field.name, getattr(leg, field.name), changes) for field in fields(leg)}
    )
