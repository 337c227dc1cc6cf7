"""The error family: every failure that a caller can act on, with its evidence attached.

Each class is a `LegDynamicsError` and also the builtin exception that a caller would expect. The message is a
sentence with the value, the limit, the margin and the next thing to try; the same facts are attributes, so that
a program need not parse the sentence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

__all__ = [
    "ActuationError",
    "AssemblyError",
    "BranchError",
    "CrosscheckError",
    "DescriptionError",
    "EffortLimitError",
    "FormulaAssumptionError",
    "JointLimitError",
    "LegDynamicsError",
    "LegDynamicsWarning",
    "LegNotFoundError",
    "MissingFootError",
    "NonFiniteError",
    "OutOfReachError",
    "OutputError",
    "ParameterError",
    "PreviewError",
    "RenderError",
    "RouteError",
    "RowError",
    "RowFailures",
    "ShapeError",
    "SingularityError",
    "StudyError",
    "SupportError",
    "TrajectoryError",
    "UnsafeXmlError",
    "UnsupportedError",
    "WorkspaceError",
]


class LegDynamicsWarning(UserWarning):
    """Something in the input is odd but has one safe reading, which the text states."""


class LegDynamicsError(Exception):
    """Base class of every error that this package raises on purpose.

    Parameters
    ----------
    message : str
        One sentence: the value, the limit, the margin, what to try next.
    **evidence
        The facts behind the sentence; each becomes an attribute and an entry of `evidence`.
    """

    def __init__(self, message: str, **evidence: Any) -> None:
        super().__init__(message)
        self.message = message
        self.evidence: Mapping[str, Any] = evidence
        for name, value in evidence.items():
            setattr(self, name, value)

    def __str__(self) -> str:
        return self.message

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), self.message, dict(self.evidence))


def _rebuild(kind: type[LegDynamicsError], message: str, evidence: dict[str, Any]) -> LegDynamicsError:
    return kind(message, **evidence)


class DescriptionError(LegDynamicsError, ValueError):
    """A mechanism file says something that cannot be true, or leaves out something that must be said.

    Attributes
    ----------
    file : str
        Path of the file, or ``<string>``.
    line : int or None
        Line of the offending element, counted from 1.
    """

    file: str
    line: int | None

    def __init__(self, message: str, *, file: str = "<string>", line: int | None = None, **evidence: Any) -> None:
        place = file if line is None else f"{file}:{line}"
        text = message if message.startswith(f"{place}: ") else f"{place}: {message}"
        super().__init__(text, file=file, line=line, **evidence)


class UnsafeXmlError(DescriptionError):
    """The file carries a document type, an entity, or a nesting depth or size that no mechanism needs."""


class RenderError(DescriptionError):
    """xacro could not turn its source into a mechanism file."""


class ParameterError(LegDynamicsError, KeyError):
    """A named parameter does not exist, or its value is not usable."""


class LegNotFoundError(LegDynamicsError, FileNotFoundError):
    """The name is neither a shipped leg nor a readable file."""


class OutputError(LegDynamicsError, OSError):
    """A result could not be written to the file it was asked into."""


class RouteError(LegDynamicsError, ValueError):
    """The route does not exist, or this leg does not have it."""


class FormulaAssumptionError(LegDynamicsError, ValueError):
    """A file breaks an assumption of a leg's closed-form formulas."""


class UnsupportedError(LegDynamicsError, NotImplementedError):
    """The request is well-formed but this route cannot serve it."""


class MissingFootError(LegDynamicsError, ValueError):
    """A foot method was called on a mechanism whose foot frame is not named."""


class ActuationError(LegDynamicsError, ValueError):
    """The actuators do not determine the requested torques."""

    @classmethod
    def of_counts(cls, name: str, independent: Sequence[str], actuated: Sequence[str]) -> ActuationError:
        """The error of a mechanism with more or fewer actuated joints than independent ones, by their names."""
        motions, actuators = len(independent), len(actuated)
        kind = "redundantly actuated" if actuators > motions else "under-actuated"
        free = [joint for joint in independent if joint not in actuated]
        motors = [joint for joint in actuated if joint not in independent]
        which = ""
        if actuators < motions:
            which = f"; no actuator is on {', '.join(free)}"
        elif motors:
            which = f"; {', '.join(motors)} move with the independent joints and are driven as well"
        return cls(
            f"{name} has {motions} independent motions and {actuators} actuators: it is {kind} and the efforts are not "
            f"unique; use generalized_force, which always is{which}",
            motions=motions,
            actuators=actuators,
        )

    @classmethod
    def of_idle(cls, name: str, verdict: Any, actuated: Sequence[str]) -> ActuationError:
        """The error of a mechanism that moves although all actuators are locked, by the names of its idle motions."""
        return cls(
            f"{name} is under-actuated: no actuator holds {', '.join(verdict.idle)} ({verdict.motions} motions, "
            f"{verdict.actuators} actuators on {', '.join(actuated) or 'no joint'}), so that no efforts produce an "
            "arbitrary motion; pass allow_idle=True for efforts and the residual, use generalized_force, which is "
            "always unique, or add actuators",
            idle=tuple(verdict.idle),
            motions=verdict.motions,
            actuators=verdict.actuators,
        )


class ShapeError(LegDynamicsError, ValueError):
    """An array has the wrong shape or type."""


class TrajectoryError(LegDynamicsError, ValueError):
    """A trajectory, or the file that holds it, is not usable."""


class WorkspaceError(LegDynamicsError, ValueError):
    """A leg has no workspace to speak of, or a point that should be in it is not; `margin` says by how much."""


class StudyError(LegDynamicsError, ValueError):
    """A design study cannot be run, resumed or read as asked."""


class PreviewError(LegDynamicsError, RuntimeError):
    """A preview could not be written, served or photographed."""


class CrosscheckError(LegDynamicsError, AssertionError):
    """Independent derivations disagree by more than the stated tolerance."""


class RowError(LegDynamicsError):
    """Some rows of a batch failed.

    Attributes
    ----------
    rows : numpy.ndarray
        Flat indices of the rows that failed for this reason, sorted, shape (k,); ``[0]`` for a single sample.
    margin : numpy.ndarray
        By how much each of them misses the limit, shape (k,): negative means outside; NaN where there is no measure.
    residual : numpy.ndarray
        Smallest loop residual reached in each of them, shape (k,), where the reason is a loop that does not close.
    all_rows : numpy.ndarray
        Flat indices of every row of the call that failed, also those that failed for another reason.
    """

    rows: np.ndarray
    margin: np.ndarray
    all_rows: np.ndarray

    def __init__(
        self, message: str, *, rows: Any = (0,), margin: Any = np.nan, all_rows: Any = None, **evidence: Any
    ) -> None:
        rows = np.atleast_1d(np.asarray(rows, dtype=np.intp))
        all_rows = rows if all_rows is None else np.atleast_1d(np.asarray(all_rows, dtype=np.intp))
        measured = {"margin": margin}
        if "residual" in evidence:
            measured["residual"] = evidence.pop("residual")
        for name, value in measured.items():
            measured[name] = np.broadcast_to(np.asarray(value, dtype=float), rows.shape).copy()
        super().__init__(message, rows=rows, **measured, all_rows=all_rows, **evidence)


class NonFiniteError(RowError, ValueError):
    """An input holds NaN or infinity, or a result is too large for a float."""


class EffortLimitError(RowError, ValueError):
    """No efforts within their bounds produce the motion; `margin` is 1 minus how many times the bounds are `needed`.

    Where some bounds exclude zero, `needed` is 1 plus the share of its larger magnitude by which each has to move out.
    """

    needed: float


class OutOfReachError(RowError, ValueError):
    """No joint angles put the foot there; `margin` is the missing distance in metres, negative."""


class BranchError(OutOfReachError):
    """The chosen branch of the inverse kinematics ends before the point, and another one holds it.

    `margin` is how far the point is beyond the branch's end, m, negative; `holding` names the branches that hold the
    first of the points, and is empty where the one that does has no name.
    """

    branch: str
    holding: tuple[str, ...]


class JointLimitError(RowError, ValueError):
    """A solution exists but leaves the joint limits; `margin` is the excess, negative, in rad or m."""


class AssemblyError(RowError, ValueError):
    """The loops could not be closed at these coordinates in the chosen assembly mode.

    `margin` is the tolerance minus `residual`.
    """

    residual: np.ndarray


class SingularityError(RowError, ArithmeticError):
    """An inverse was asked for where none exists; `margin` is the smallest singular value."""


class SupportError(RowError, ValueError):
    """The feet on the ground cannot carry the robot; `margin` is that of the zero-moment point, m."""


class RowFailures:
    """Collects the failing rows of one call while a route works through a batch.

    A route adds what it cannot compute and leaves NaN in those rows; the interface then raises one error with all
    rows, or, on request, returns the NaN.
    """

    def __init__(self) -> None:
        self._failures: list[tuple[np.ndarray, RowError]] = []

    def __bool__(self) -> bool:
        return bool(self._failures)

    def add(self, rows: Any, error: RowError) -> None:
        """Record that `rows` (flat indices) failed for the reason `error`, whose margins are in the same order."""
        self._failures.append((np.atleast_1d(np.asarray(rows, dtype=np.intp)), error))

    @property
    def rows(self) -> np.ndarray:
        """Sorted flat indices of all failing rows, shape (k,)."""
        return np.unique(np.concatenate([rows for rows, _ in self._failures] or [np.zeros(0, dtype=np.intp)]))

    def combined(self, count: int | None) -> RowError:
        """One error for the call: the first failing row's class and sentence, all rows of that class, their margins.

        Parameters
        ----------
        count : int or None
            Rows in the batch; None for a single sample. One row needs no row number in the message.
        """
        first_rows, first = min(self._failures, key=lambda failure: int(failure[0].min()))
        kind = type(first)
        same = [(rows, error) for rows, error in self._failures if type(error) is kind]
        rows, position = np.unique(np.concatenate([rows for rows, _ in same]), return_index=True)
        measured = {}
        for name in ("margin", "residual"):
            if hasattr(first, name):
                values = [np.broadcast_to(getattr(error, name, np.nan), rows.shape) for rows, error in same]
                measured[name] = np.concatenate(values)[position]
        every = self.rows
        message = first.message
        if count is not None and count > 1:
            others = {type(error).__name__ for _, error in self._failures} - {kind.__name__}
            reasons = (
                f" ({len(rows)} with {kind.__name__}, the rest with {', '.join(sorted(others))})" if others else ""
            )
            message = f"{len(every)} of {count} rows failed{reasons}; first row {int(first_rows.min())}: {message}"
        evidence = {k: v for k, v in first.evidence.items() if k not in ("rows", "margin", "residual", "all_rows")}
        return kind(message, rows=rows, all_rows=every, **measured, **evidence)
