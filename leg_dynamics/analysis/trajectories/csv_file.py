"""Reads a motion from a CSV file: joint coordinates or a path of the foot."""

from __future__ import annotations

import csv
import math
import os
import re
import stat
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.trajectories.trajectory import Trajectory
from leg_dynamics.errors import LegDynamicsWarning, RowError, TrajectoryError

__all__ = ["from_csv"]

MIN_SAMPLES = 6
"""A quintic spline needs six samples; fewer would make its accelerations an invention."""

MAX_BYTES = 200_000_000
"""A larger file is hardly a motion, and would fill the memory."""

MAX_TIME = 1e12
"""s; the largest magnitude of a time."""

MIN_STEP = 1e-12
"""s; the smallest time from one sample to the next."""

MAX_COORDINATE = 1e9
"""rad or m; the sine of a larger angle has hardly a digit left."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_NON_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)
_RESULT = re.compile(r"(v|a|tau|foot|foot_force)_.+")
_HEADER = re.compile(r"(?P<name>[^\[\]]*?)\s*(\[(?P<unit>[^\[\]]*)\])?")


class _Leg(Protocol):
    """What reading a file needs of a leg."""

    @property
    def joint_names(self) -> Sequence[str]: ...

    @property
    def units(self) -> Any: ...

    @property
    def limits(self) -> Any: ...

    def inverse_kinematics(self, p: Any, *, limits: Any = "error") -> Any: ...


def from_csv(path: str | Path, leg: _Leg, *, limits: str = "error") -> Trajectory:
    """Read a motion from a CSV file.

    The first line names the columns. Either ``t`` and the leg's independent coordinates (by their joint names or
    ``q1`` to ``qn``), or ``t, x, y, z``: a path of the foot in the hip frame, in metres, which is solved by the leg's
    inverse kinematics. Times are seconds and strictly increasing, not necessarily even; angles are radians only.
    A name may carry its unit, as in ``alpha [rad]``. Columns may stand in any order, separated by commas, semicolons
    or tabs; decimals have a point. Text is UTF-8, with or without a byte order mark, with any line ending.

    The table that ``leg-dynamics torque --output`` writes can be read too: its coordinates (``q_`` and the joint name)
    count, its other columns are passed over with a `LegDynamicsWarning`.

    Rates and accelerations are those of the quintic spline through the coordinates (not-a-knot ends).

    Parameters
    ----------
    path : str or Path
        The file.
    leg
        The leg that moves.
    limits : {"error", "ignore"}
        Whether coordinates outside the joint limits are refused.

    Returns
    -------
    Trajectory
        Named after the file.

    Raises
    ------
    TrajectoryError
        The file cannot be read or does not say a motion; the text starts with file and line.
    OutOfReachError, JointLimitError
        A foot position cannot be reached, or a coordinate leaves its limits; the text starts with file and line.
    """
    arguments.choice("limits", limits, ("error", "ignore"))
    arguments.having("leg", leg, ("joint_names", "units", "limits"), "load one with leg_dynamics.load")
    arguments.kind("the path of a CSV file", path, str, os.PathLike)
    path = Path(path)
    cells, lines = _read_cells(path)
    names = list(leg.joint_names)
    kind, order = _match_header(path, lines[0], cells[0], names, list(leg.units.joints))
    table = _numeric_rows(path, cells, lines, order)
    _check_range(path, lines, [cells[0][column] for column in order], table)
    time = table[:, 0]
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if late.size:
        row = int(late[0]) + 1
        _refuse(
            path,
            lines[row + 1],
            f"time must increase, but {time[row]:.17g} s follows {time[row - 1]:.17g} s; sort the rows",
        )
    close = np.flatnonzero(np.diff(time) < MIN_STEP)
    if close.size:
        row = int(close[0]) + 1
        _refuse(
            path,
            lines[row + 1],
            f"the step of {time[row] - time[row - 1]:.3g} s from the row before is shorter than {MIN_STEP:g} s; "
            "times are in seconds",
        )
    if len(table) < MIN_SAMPLES:
        _refuse(
            path,
            lines[-1],
            f"{len(table)} rows are too few: the quintic spline that gives rates and accelerations needs {MIN_SAMPLES}",
        )
    try:
        if kind == "foot":
            q = np.asarray(leg.inverse_kinematics(table[:, 1:], limits=limits), dtype=float)
        else:
            q = table[:, 1:]
        v, a = _spline_derivatives(path, time, q)
        trajectory = Trajectory(time, q, v, a, name=path.stem)
        if limits == "error":
            trajectory.check_limits(leg.limits, names, list(leg.units.joints))
    except RowError as error:
        line = lines[int(error.rows[0]) + 1]
        evidence = dict(error.evidence) | {"file": str(path), "line": line}
        raise type(error)(f"{path}:{line}: {error.message}", **evidence) from error
    return trajectory


def _refuse(path: Path, line: int | None, reason: str) -> NoReturn:
    place = f"{path}" if line is None else f"{path}:{line}"
    raise TrajectoryError(f"{place}: {reason}", file=str(path), line=line)


def _read_cells(path: Path) -> tuple[list[list[str]], list[int]]:
    """Cells of each row that is not blank, and its line; the header is the first."""
    try:
        status = path.stat()
        # A pipe or a device may never end, and opening it may wait for ever; a folder says so itself.
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            _refuse(path, None, "this is not a regular file; save the table into one")
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1) if status.st_size <= MAX_BYTES else None
        if content is None or len(content) > MAX_BYTES:
            _refuse(path, None, f"the file is larger than {MAX_BYTES / 1e6:g} MB; split it or thin out the samples")
        text = content.decode("utf-8-sig")
    except OSError as error:
        _refuse(path, None, f"the file cannot be read: {error.strerror or error}")
    except UnicodeDecodeError as error:
        bad_line = error.object[: error.start].count(b"\n") + 1
        _refuse(path, bad_line, "this is not UTF-8 text; save the table as CSV in UTF-8")
    if "\0" in text:
        _refuse(path, text[: text.index("\0")].count("\n") + 1, "a NUL byte; save the table as CSV in UTF-8")
    # Not str.splitlines: it also splits at characters that no spreadsheet means as a line end.
    physical = [(number, line) for number, line in enumerate(re.split(r"\r\n|\n|\r", text), start=1) if line.strip()]
    if not physical:
        _refuse(path, 1, "the file is empty; the first line names the columns, for example t,q1,q2,q3")
    delimiter = max(",;\t", key=physical[0][1].count)
    cells = []
    for number, line in physical:
        try:
            row = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
        except csv.Error as error:
            _refuse(path, number, f"this is not a CSV row: {error}")
        cells.append([cell.strip() for cell in row])
    if all(_NUMBER.fullmatch(cell) or _NON_FINITE.fullmatch(cell) for cell in cells[0]):
        line_number = physical[0][0]
        _refuse(path, line_number, "the header is missing; the first line names the columns, for example t,q1,q2,q3")
    return cells, [number for number, _ in physical]


def _numeric_rows(path: Path, cells: list[list[str]], lines: list[int], order: list[int]) -> NDArray[np.float64]:
    header = cells[0]
    if len(cells) == 1:
        _refuse(path, lines[0], f"there is a header but no row under it; at least {MIN_SAMPLES} are needed")
    rows = []
    for line, row in zip(lines[1:], cells[1:], strict=True):
        if len(row) != len(header):
            _refuse(path, line, f"{len(row)} values under {len(header)} column names")
        rows.append([_number(path, line, header[column], row[column]) for column in order])
    return np.array(rows, dtype=float)


def _check_range(path: Path, lines: list[int], columns: list[str], table: NDArray[np.float64]) -> None:
    """Refuse magnitudes whose differences or derivatives could overflow."""
    limits = np.array([MAX_TIME] + [MAX_COORDINATE] * (len(columns) - 1))
    wild = np.argwhere(np.abs(table) > limits)
    if wild.size:
        row, k = wild[0]
        _refuse(
            path,
            lines[int(row) + 1],
            f"{columns[k]} = {table[row, k]:g} is out of range: its magnitude may be {limits[k]:g} at most",
        )


def _number(path: Path, line: int, column: str, cell: str) -> float:
    if _NON_FINITE.fullmatch(cell):
        _refuse(path, line, f"{column} is {cell}; every value must be finite")
    if not _NUMBER.fullmatch(cell):
        what = f"{cell!r} is not a number" if cell else "the value is missing"
        hint = "; write decimals with a point" if re.fullmatch(r"[+-]?\d+,\d+", cell) else ""
        _refuse(path, line, f"{column}: {what}{hint}")
    value = float(cell)
    if not math.isfinite(value):
        _refuse(path, line, f"{column} = {cell} is too large for a floating-point number")
    return value


def _match_header(
    path: Path, line: int, header: list[str], joint_names: list[str], units: list[str]
) -> tuple[str, list[int]]:
    """Whether the columns are ``joint`` or ``foot``, and the column indices in the order t, then coordinates."""
    n = len(joint_names)
    aliases = {"t": 0, "time": 0}
    aliases.update({f"q{i + 1}": i + 1 for i in range(n)})
    aliases.update({name: i + 1 for i, name in enumerate(joint_names)})
    foot = {"t": 0, "time": 0, "x": 1, "y": 2, "z": 3}
    own = {f"q_{name}": i + 1 for i, name in enumerate(joint_names)}
    matches = [_HEADER.fullmatch(cell) for cell in header]
    names = [cell if match is None else match["name"] for cell, match in zip(header, matches, strict=True)]
    stated = [None if match is None else match["unit"] for match in matches]
    expected = (
        f"the columns must be t and {', '.join(f'q{i + 1}' for i in range(n))} "
        f"(or {', '.join(joint_names)}), or t, x, y, z"
    )
    passed_over: set[str] = set()
    if all(name in names for name in own):
        # The program's own table of results.
        aliases = {"t": 0, "time": 0} | own
        passed_over = {name for name in names if name not in aliases and _RESULT.fullmatch(name)}
    else:
        # A joint that is itself called q_... keeps its name.
        aliases = own | aliases
    if all(name in aliases or name in passed_over for name in names):
        kind, table, column_units = "joint", aliases, ["s", *units]
    elif all(name in foot for name in names):
        kind, table, column_units = "foot", foot, ["s", "m", "m", "m"]
    else:
        unknown = next((name for name in names if name not in aliases and name not in foot), None)
        reason = "joint and foot columns are mixed" if unknown is None else f"unknown column {unknown!r}"
        _refuse(path, line, f"{reason}; {expected}")
    indices = [None if name in passed_over else table[name] for name in names]
    for position, index in enumerate(indices):
        if index is None:
            continue
        if index in indices[:position]:
            _refuse(path, line, f"column {names[position]!r} is given twice; {expected}")
        unit = stated[position]
        if unit is not None and unit.strip() != column_units[index]:
            _refuse(
                path,
                line,
                f"{names[position]!r} is in {unit.strip()!r}, but only {column_units[index]} is read; convert it",
            )
    missing = [i for i in range(len(column_units)) if i not in indices]
    if missing:
        wanted = ["t", *(joint_names if kind == "joint" else "xyz")]
        _refuse(path, line, f"column {wanted[missing[0]]!r} is missing; {expected}")
    if passed_over:
        shown = ", ".join(name for name in names if name in passed_over)
        warnings.warn(
            f"{path}:{line}: only times and coordinates are read, not {shown}; rates come from the coordinates, "
            "and a force on the foot must be given anew",
            LegDynamicsWarning,
            stacklevel=3,
        )
    return kind, [indices.index(i) for i in range(len(column_units))]


def _spline_derivatives(
    path: Path, time: NDArray[np.float64], q: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    from scipy.interpolate import make_interp_spline

    # Shifted and scaled to steps of about one, so that the spline's powers of time keep their digits.
    scale = (time[-1] - time[0]) / (time.size - 1)
    s = (time - time[0]) / scale
    try:
        spline = make_interp_spline(s, q, k=5, axis=0)
        v, a = spline(s, nu=1) / scale, spline(s, nu=2) / scale**2
    except (ValueError, np.linalg.LinAlgError) as error:
        _refuse(path, None, f"no smooth curve goes through these times ({error}); space the samples more evenly")
    # Interpolation is exact in theory; a large residual means times too uneven for a trustworthy derivative.
    residual = float(np.abs(spline(s) - q).max())
    if not residual <= 1e-8 * (1.0 + float(np.abs(q).max())):
        _refuse(path, None, f"the spline misses the samples by {residual:.2g}; space the times more evenly")
    return v, a
