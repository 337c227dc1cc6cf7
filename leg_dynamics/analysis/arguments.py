"""What callers hand in, checked once for all of this room: numbers, arrays, choices and kinds of objects.

Text, None, complex numbers and truth values (in a list of numbers, NumPy has made numbers of them before) are no real
numbers here, although NumPy would turn most of them into one.
"""

from __future__ import annotations

import decimal
import math
import numbers
from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.errors import NonFiniteError, ShapeError, TrajectoryError

__all__ = ["choice", "having", "kind", "number", "positive", "real", "reals", "text", "tolerance", "vector", "whole"]


def number(what: str, value: Any) -> float:
    """Return one real number as a float, NaN and infinity among them; anything else is a `ShapeError`."""
    if isinstance(value, np.ndarray) and value.shape == ():
        value = value[()]
    if not _is_real(value):
        _refuse(what, value, "one real number")
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def real(what: str, value: Any) -> float:
    """Return one finite number as a float.

    Parameters
    ----------
    what : str
        How messages call it.
    value
        Anything; numbers of Python and NumPy are taken.

    Raises
    ------
    ShapeError
        It is not one real number.
    NonFiniteError
        It is NaN or infinite.
    """
    found = number(what, value)
    if not math.isfinite(found):
        raise NonFiniteError(f"{what} = {found} is not finite; give a finite number")
    return found


def positive(what: str, value: Any, of: str = "") -> float:
    """Return one positive finite number as a float; others are a `TrajectoryError`."""
    found = number(what, value)
    if not (math.isfinite(found) and found > 0.0):
        counted = f"number of {of}" if of else "number"
        raise TrajectoryError(f"the {what} must be a positive {counted}, but is {found:g}")
    return found


def tolerance(what: str, value: Any) -> float:
    """Return one finite number that is not negative as a float; others are a `TrajectoryError`."""
    found = number(what, value)
    if not (math.isfinite(found) and found >= 0.0):
        raise TrajectoryError(f"the {what} is {found:g}; give zero or a positive number")
    return found


def whole(what: str, value: Any, least: int, most: int) -> int:
    """Return a whole number from `least` to `most`; others are a `TrajectoryError`."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise TrajectoryError(f"{what} must be a whole number, at least {least}, not {value!r}")
    if not least <= value <= most:
        shown = str(value) if abs(int(value)) < 10**15 else "a number beyond all counting"
        raise TrajectoryError(f"{what} must be at least {least} and at most {most}, not {shown}")
    return int(value)


def reals(what: str, values: ArrayLike | Sequence[ArrayLike]) -> NDArray[np.float64]:
    """Return an array of real numbers, NaN and infinity among them, as a new array of floats.

    Raises
    ------
    ShapeError
        It is ragged, or an entry is not a real number.
    """
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{what} must be an array of real numbers: {error}") from None
    if array.dtype.kind == "O":
        # Mixed lists, fractions, decimals, and integers beyond 64 bits.
        for entry in array.flat:
            if not _is_real(entry):
                _refuse(what, entry)
        try:
            return array.astype(np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise ShapeError(f"{what} must be an array of real numbers: {error}") from None
    if array.dtype.kind not in "iuf" and array.size:
        _refuse(what, array.flat[0])
    return np.array(array, dtype=np.float64)


def vector(what: str, values: ArrayLike, size: int, unit: str = "") -> NDArray[np.float64]:
    """Return finite numbers of shape (size,); others are a `ShapeError` or a `NonFiniteError`."""
    array = reals(what, values)
    if array.shape != (size,):
        words = {2: "two", 3: "three"}
        raise ShapeError(
            f"{what} has shape {array.shape}; give {words.get(size, size)} components{f', {unit}' if unit else ''}"
        )
    if not np.isfinite(array).all():
        raise NonFiniteError(f"{what} = {array.tolist()} is not finite; give finite numbers")
    return array


def choice(what: str, value: Any, known: Sequence[str]) -> str:
    """Return one of the known words; others are a `TrajectoryError`."""
    if not isinstance(value, str) or value not in known:
        listed = " or ".join(f'"{word}"' for word in known)
        raise TrajectoryError(f"{what} must be {listed}, not {value!r}")
    return value


def text(what: str, value: Any) -> str:
    """Return a text; anything else is a `ShapeError`."""
    if not isinstance(value, str):
        raise ShapeError(f"{what} is a text, not {type(value).__name__} {value!r}")
    return value


def kind(what: str, value: Any, *kinds: type, hint: str = "") -> None:
    """Refuse, by a `ShapeError`, what is not an instance of one of the kinds."""
    if not isinstance(value, kinds):
        *most, last = (each.__name__ for each in kinds)
        listed = f"{', '.join(most)} or {last}" if most else last
        raise ShapeError(f"{what} is a {listed}, not {type(value).__name__}{f'; {hint}' if hint else ''}")


def having(what: str, value: Any, attributes: Sequence[str], hint: str) -> None:
    """Refuse, by a `ShapeError`, an object that lacks one of the attributes."""
    missing = [name for name in attributes if not hasattr(value, name)]
    if missing:
        raise ShapeError(f"{type(value).__name__} is no {what}: it has no {', '.join(missing)}; {hint}")


def _is_real(value: Any) -> bool:
    return isinstance(value, numbers.Real | decimal.Decimal) and not isinstance(value, bool | np.bool_)


def _refuse(what: str, value: Any, needed: str = "real numbers only") -> NoReturn:
    raise ShapeError(f"{what}: {needed}, not {type(value).__name__} {str(value)[:80]!r}")
