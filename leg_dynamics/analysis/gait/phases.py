"""Which foot is on the ground when: phase tables of gaits for any number of legs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.gait.robot import Robot
from leg_dynamics.errors import TrajectoryError

__all__ = ["GAITS", "PhaseTable", "phase_table", "swing_order"]

GAITS = ("tripod", "wave", "ripple")
"""Names that `phase_table` knows."""

SLACK = 1e-9
"""Share of a period: the moments of touch-down and lift-off count as stance, also where times round."""


@dataclass(frozen=True)
class PhaseTable:
    """A gait's rhythm.

    Parameters
    ----------
    phases : sequence of N floats
        Leg i touches down at time ``phases[i]`` of each period, as a share of the period (McGhee's relative phase);
        taken modulo 1.
    duty : float
        Share of the period that each foot is on the ground, 0 < duty < 1.
    name : str

    Raises
    ------
    TrajectoryError, NonFiniteError, ShapeError
        The numbers are not usable.
    """

    phases: tuple[float, ...]
    duty: float
    name: str = "gait"

    def __post_init__(self) -> None:
        arguments.text("the name of a gait", self.name)
        phases = arguments.reals("phases", self.phases)
        if phases.ndim != 1 or not phases.size:
            raise TrajectoryError(f"phases have shape {phases.shape}; give one a leg, shape (N,)")
        phases = np.array([arguments.real(f"phase of leg {i}", phase) for i, phase in enumerate(phases)])
        # Exactly 1 is 0; a tiny negative number rounds to 1 under the modulo.
        wrapped = np.mod(phases, 1.0)
        object.__setattr__(self, "phases", tuple(np.where(wrapped == 1.0, 0.0, wrapped).tolist()))
        duty = arguments.real("duty factor", self.duty)
        if not 0.0 < duty < 1.0:
            raise TrajectoryError(
                f"the duty factor is {duty:g}; it is the share of the period on the ground: more than 0, less than 1"
            )
        object.__setattr__(self, "duty", duty)

    def __len__(self) -> int:
        return len(self.phases)

    def leg_phase(self, cycles: ArrayLike) -> NDArray[np.float64]:
        """Share of the period since each leg's touch-down.

        Parameters
        ----------
        cycles : array_like, shape (...)
            Time over period.

        Returns
        -------
        numpy.ndarray, shape (..., N)
            In [0, 1): stance up to the duty factor, then swing.
        """
        u = np.mod(np.asarray(cycles, dtype=float)[..., None] - np.array(self.phases), 1.0)
        return np.where(u == 1.0, 0.0, u)

    def in_stance(self, cycles: ArrayLike) -> NDArray[np.bool_]:
        """Whether each foot is on the ground, (..., N); touch-down and lift-off count."""
        u = self.leg_phase(cycles)
        return (u <= self.duty + SLACK) | (u >= 1.0 - SLACK)

    def switches(self) -> NDArray[np.float64]:
        """Moments in [0, 1) at which a foot touches down or lifts off, increasing."""
        touch = np.array(self.phases)
        moments = np.sort(np.mod(np.concatenate([touch, touch + self.duty]), 1.0))
        keep = np.append(np.diff(moments) > SLACK, True)
        return moments[keep]


def phase_table(
    gait: str | PhaseTable | Mapping[str, float] | Sequence[float], robot: Robot, duty: float | None = None
) -> PhaseTable:
    """Return the phase table of a gait for a robot.

    With n legs a side, counted from the front, m = 0 to n - 1, and the other side half a period later (Song & Waldron,
    Machines That Walk, 1989, wave gaits):

    ========  ================  ====================================  =============================
    gait      duty by default   phase of leg m of the left side       legs in the air, by default
    ========  ================  ====================================  =============================
    tripod    1/2               m/2                                   every second one, in turns
    ripple    1 - 1/n           -m/n                                  one a side at any time
    wave      1 - 1/N           m duty                                one at any time
    ========  ================  ====================================  =============================

    Swings run from the rear to the front; tripod is the trot on four legs, and alternating tetrapods on eight.

    Parameters
    ----------
    gait : str, PhaseTable, mapping or sequence
        ``tripod``, ``wave``, ``ripple``; or phases by the legs' names, or in the legs' order.
    robot : Robot
    duty : float, optional
        In place of the gait's own. Phases of a table of your own need it.

    Raises
    ------
    TrajectoryError
        The gait is unknown, the table does not fit the legs, or the feet are not in two rows.
    """
    if isinstance(gait, PhaseTable):
        table = gait if duty is None else PhaseTable(gait.phases, duty, gait.name)
    elif isinstance(gait, str):
        table = _named(arguments.choice("gait", gait, GAITS), robot, duty)
    else:
        if duty is None:
            raise TrajectoryError("a phase table of your own needs a duty factor; give duty")
        table = PhaseTable(_in_order(gait, robot), duty, "own phases")
    if len(table) != len(robot):
        raise TrajectoryError(
            f"the gait {table.name!r} has {len(table)} phases, but {robot.name!r} has {len(robot)} legs"
        )
    return table


def swing_order(
    order: Sequence[str], robot: Robot, duty: float | None = None, name: str = "", *, group: int = 1
) -> PhaseTable:
    """A creeping gait: the legs swing one after another, each in its share of the period.

    Parameters
    ----------
    order : sequence of str
        Every leg once; the k-th lifts off at k / N of the period. Chen 2021 has ``("III", "I", "IV", "II")``.
    robot : Robot
    duty : float, optional
        1 - 1/N by default, so that the next leg lifts as one touches down; more leaves pauses with all feet down.
    name : str
    group : int
        As many legs swing without a pause between them, and a longer pause follows: in pairs, for the order above, it
        comes where the next leg is the one diagonally across. N must be a multiple.

    Raises
    ------
    TrajectoryError
        A leg is missing, unknown or named twice, or N is not a multiple of `group`.
    """
    if isinstance(order, str) or sorted(order) != sorted(robot.leg_names):
        raise TrajectoryError(f"the swing order must name every leg once: {', '.join(robot.leg_names)}")
    count = len(robot)
    share = 1.0 - 1.0 / count if duty is None else duty
    size = arguments.whole("the number of legs in a group", group, 1, count)
    if count % size:
        raise TrajectoryError(f"{count} legs do not make groups of {size}; give a divisor of {count}")
    # PhaseTable refuses a duty that is not a number in (0, 1).
    table = PhaseTable((0.0,) * count, share)
    lifts = {leg: (k - k % size) / count + (k % size) * (1.0 - table.duty) for k, leg in enumerate(order)}
    phases = tuple(lifts[leg] + 1.0 - table.duty for leg in robot.leg_names)
    return PhaseTable(phases, table.duty, name or "-".join(order))


def _in_order(table: Any, robot: Robot) -> tuple[float, ...]:
    if not isinstance(table, Mapping):
        return tuple(arguments.reals("phases", table).tolist())
    if set(table) != set(robot.leg_names):
        raise TrajectoryError(
            f"the phase table names {', '.join(map(str, table))}, but the legs are {', '.join(robot.leg_names)}"
        )
    return tuple(arguments.real(f"phase of {name}", table[name]) for name in robot.leg_names)


def _named(gait: str, robot: Robot, duty: float | None) -> PhaseTable:
    rank, left, rows = _rows(robot)
    natural = {"tripod": 0.5, "ripple": 1.0 - 1.0 / rows, "wave": 1.0 - 1.0 / len(robot)}[gait]
    if natural <= 0.0 and duty is None:
        raise TrajectoryError(f"{robot.name!r} has too few legs for a {gait} gait of its own; give a duty factor")
    share = natural if duty is None else arguments.real("duty factor", duty)
    step = {"tripod": 0.5, "ripple": -1.0 / rows, "wave": share}[gait]
    return PhaseTable(tuple((rank * step + np.where(left, 0.0, 0.5)).tolist()), share, gait)


def _rows(robot: Robot) -> tuple[NDArray[np.float64], NDArray[np.bool_], int]:
    """Of each leg its number from the front on its side and whether that is the left one; and the legs a side."""
    feet = robot.homes
    y = feet[:, 1] - feet[:, 1].mean()
    if np.abs(y).min() <= 1e-6 * max(float(np.abs(feet[:, :2]).max()), 1e-9):
        middle = robot.leg_names[int(np.abs(y).argmin())]
        raise TrajectoryError(
            f"the leg {middle!r} of {robot.name!r} is on neither side, so that a gait by name has no place for it; "
            "give a phase table"
        )
    left = y > 0.0
    rank = np.zeros(len(feet))
    for side in (left, ~left):
        legs = np.flatnonzero(side)
        rank[legs[np.argsort(-feet[legs, 0], kind="stable")]] = np.arange(legs.size)
    return rank, left, math.ceil(max(left.sum(), (~left).sum()))
