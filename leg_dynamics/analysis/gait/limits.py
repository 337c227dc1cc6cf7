"""What limits the legs' poses along a gait, passive joints included: signed margins by limit, leg and time.

Where the robot has a file, the limits are those that it states: a clearance between two legs counts as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis.gait.robot import Limb, Robot
from leg_dynamics.analysis.workspace import margins as leg_margins
from leg_dynamics.analysis.workspace.constraints import Constraint, constraint_kernels, constraints_of
from leg_dynamics.description.model import Description

__all__ = ["LimitMargin", "limit_margins", "most_broken"]


@dataclass(frozen=True, eq=False)
class LimitMargin:
    """Margin of one limit over the cycle.

    Attributes
    ----------
    name : str
        In the robot's file, for example ``front_left_beta1 lower limit``, ``cone rear_right_ball_3``.
    leg : str
        The leg that it limits; two, with a plus sign between them, of a clearance between legs.
    kind : str
        ``joint``, ``cone``, ``telescope`` or ``clearance``.
    unit : str
        Of the margin: ``rad`` or ``m``.
    meaning : str
        The inequality in words.
    scale : float
        Normalised margin = margin / scale, see `leg_dynamics.analysis.workspace.constraints.Constraint`.
    margin : (T,) array
        Negative where the pose breaks the limit.
    """

    name: str
    leg: str
    kind: str
    unit: str
    meaning: str
    scale: float
    margin: NDArray[np.float64]

    @property
    def row(self) -> int:
        """Index of the time with the least margin."""
        return int(self.margin.argmin())

    @property
    def least(self) -> float:
        """Least margin, in `unit`."""
        return float(self.margin[self.row])

    @property
    def least_normalised(self) -> float:
        """Least normalised margin: limits of different kinds compare."""
        return self.least / self.scale

    @property
    def holds(self) -> bool:
        """Whether the margin is never negative, nor NaN."""
        return bool((self.margin >= 0.0).all())


def most_broken(margins: Iterable[LimitMargin]) -> LimitMargin | None:
    """The limit that is broken by most, by the normalised margin; None where all hold."""
    broken = [each for each in margins if not each.holds]
    return min(broken, key=lambda each: each.least_normalised, default=None)


def limit_margins(robot: Robot, q: Sequence[NDArray[np.float64]]) -> tuple[LimitMargin, ...]:
    """Margins of every limit of a robot's legs.

    Parameters
    ----------
    robot : Robot
        With a file, its own limits count; else those of each leg's file; else the leg's joint limits.
    q : sequence of N arrays (T, n)
        Coordinates of the legs' models.

    Returns
    -------
    tuple of LimitMargin
        In the file's order, or leg by leg.
    """
    if robot.description is not None and all(limb.joints for limb in robot.limbs):
        return tuple(_of_robot(robot, robot.description, q))
    return tuple(each for limb, values in zip(robot.limbs, q, strict=True) for each in _of_limb(limb, values))


def _of_robot(robot: Robot, description: Description, q: Sequence[NDArray[np.float64]]) -> Iterator[LimitMargin]:
    values: dict[str, NDArray[np.float64]] = {}
    for limb, coordinates in zip(robot.limbs, q, strict=True):
        values |= limb.assemble(coordinates)
    # Parts that are no leg rest in the home pose, and their limits are not the gait's.
    home = {} if description.home is None else description.home.values
    names = [joint.name for joint in description.joints if joint.is_single_coordinate]
    stacked = np.stack([np.broadcast_to(values.get(n, home.get(n, 0.0)), len(q[0])) for n in names], axis=-1)
    wanted = [(each, legs) for each in constraints_of(description) if (legs := _legs(robot, description, each))]
    if not wanted:
        return
    kernels = constraint_kernels(description, names, [each for each, _ in wanted])
    for (each, legs), margin in zip(wanted, np.asarray(kernels.margins.ufunc(stacked)).T, strict=True):
        yield LimitMargin(each.name, " + ".join(legs), each.kind, each.unit, each.meaning, each.scale, margin)


def _legs(robot: Robot, description: Description, constraint: Constraint) -> list[str]:
    """Legs whose joints move what a constraint is about."""
    moving: set[str] = set()
    for link in _links(description, constraint):
        moving |= {joint.name for joint in description.path(link)}
    return [limb.name for limb in robot.limbs if moving & set(limb.joints)]


def _links(description: Description, constraint: Constraint) -> list[str]:
    kind, _, name = constraint.name.partition(" ")
    if constraint.kind == "cone":
        return next([each.link, each.other_link] for each in description.cones if each.name == name)
    if constraint.kind == "clearance":
        return next([each.first.link, each.second.link] for each in description.clearances if each.name == name)
    joint = name if constraint.kind == "telescope" else kind
    return [description.joint(joint).child]


def _of_limb(limb: Limb, q: NDArray[np.float64]) -> Iterator[LimitMargin]:
    description: Description | None = getattr(limb.leg, "description", None)
    if description is not None:
        found = leg_margins(limb.leg, q)
        for each in constraints_of(description):
            name = f"{limb.name} {each.name}"
            yield LimitMargin(name, limb.name, each.kind, each.unit, each.meaning, each.scale, found[each.name])
        return
    limits: Any = limb.leg.limits
    for k, joint in enumerate(limb.joint_names):
        low, high = float(limits.lower[k]), float(limits.upper[k])
        half = (high - low) / 2.0
        scale = half if math.isfinite(half) and half > 0.0 else 1.0
        unit = limb.leg.units.joints[k] if hasattr(limb.leg, "units") else ""
        for side, sign, bound, margin in (("lower", ">=", low, q[:, k] - low), ("upper", "<=", high, high - q[:, k])):
            if math.isfinite(bound):
                meaning = f"{joint} {sign} {bound:.6g} {unit}".rstrip()
                yield LimitMargin(f"{joint} {side} limit", limb.name, "joint", unit, meaning, scale, margin)
