"""What verdicts on the modular quadruped are computed from: mechanisms of the shipped files, and the formulas.

The two share nothing. Facts are poses by plain forward kinematics of the files' modules; formulas are those of
`closed_form.quadruped_leg`, as corrected. As l1 and l2 are equal in the shipped leg, a second one of other lengths
stands beside it: a formula that takes one for the other is found out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.description import link_transforms, read
from leg_dynamics.papers.framework import Context
from leg_dynamics.papers.mechanism import array
from leg_dynamics.papers.quadruped.printed import POSE_4, Lengths

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description
    from leg_dynamics.leg import Leg

__all__ = [
    "OTHER",
    "STATES",
    "TO_PAPER",
    "Facts",
    "counted_poses",
    "every",
    "facts_of",
    "foot_poses",
    "formula",
    "hip_in_body",
    "mount_of_iv",
    "robot_file",
    "wrapped",
]

Array = np.ndarray

STATES = 400
"""Random states of each leg inside the limits, and as many over the full circle."""

OTHER = {"f": 0.03, "s": 0.09, "foot_radius": 0.02}
"""m; the second leg: the audit's other proposal, all lengths different."""

OTHER_MOUNT = (0.105, -0.055, 0.013)
"""m; of the second leg, with a c that is not zero."""

KEPT_OFF = 0.02
"""|sin(theta3)| that states keep, and the foot's distance from the hip axis over the reach: arcsines and arctangents
lose their digits nearer to the singularities."""

BENT = 1e-3
"""rad; |theta3| that counted poses keep: angles of a straight leg are only as good as the square root of its foot."""

TO_PAPER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""From the file's body axes (x ahead, y left) to the paper's (y_c ahead, x_c right)."""


def wrapped(angle: Array) -> Array:
    """Angles in [-pi, pi], rad."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def robot_file(context: Context) -> Description:
    """The robot of ten modules."""
    description: Description = context.once("quadruped: file", lambda: read("quadruped"))
    return description


def hip_in_body(context: Context, leg: str) -> Array:
    """Pose of a leg's O_0 in the paper's body frame by the robot's file, (4, 4)."""
    pose = np.array(link_transforms(robot_file(context), {})[f"{leg}_hip"])
    pose[:3] = TO_PAPER @ pose[:3]
    return pose


def mount_of_iv(context: Context) -> Array:
    """Place (a, b, c) of leg IV's O_0, m."""
    return hip_in_body(context, "IV")[:3, 3]


def foot_poses(leg: Leg, q: Array) -> Array:
    """Pose of the foot frame in the hip frame, by the leg's file, (N, 4, 4)."""
    links = link_transforms(leg.description, leg.assemble(q))
    poses: Array = np.linalg.inv(links["hip"]) @ links["foot"]
    return poses


@dataclass(frozen=True)
class Facts:
    """One leg at states q (N, 3): its foot by the file, in the paper's body frame."""

    leg: Leg
    numbers: Any
    """The leg as the formulas take it."""
    q: Array
    mount: Array

    @cached_property
    def lengths(self) -> Lengths:
        """l1, l2, l3 of Table 1 by the parameters of the file, m."""
        f, s, foot = (self.leg.parameters[name].value for name in ("f", "s", "foot_radius"))
        return Lengths(s, 2.0 * f, s + f + foot)

    @cached_property
    def pose(self) -> Array:
        """A_c3, (N, 4, 4)."""
        pose = np.array(foot_poses(self.leg, self.q))
        pose[:, :3, 3] += self.mount
        return pose

    @property
    def p(self) -> Array:
        """The foot in the body frame, (N, 3) m."""
        return self.pose[:, :3, 3]

    @property
    def from_hip(self) -> Array:
        """The foot in the hip frame, (N, 3) m."""
        return self.p - self.mount

    @cached_property
    def in_plane(self) -> tuple[Array, Array]:
        """T and p_z - c: the foot from the pitch axis, outwards and upwards in the leg's plane, (N,) m each."""
        x, y, z = self.from_hip.T
        return x * np.cos(self.q[:, 0]) + y * np.sin(self.q[:, 0]) - self.lengths.l1, z

    @property
    def hip_sign(self) -> Array:
        """1 where the leg reaches to the foot, -1 where it reaches over its own hip axis, (N,)."""
        return np.sign(self.in_plane[0] + self.lengths.l1)

    @cached_property
    def inside(self) -> Array:
        """Which states are inside the limits of the swings, (N,)."""
        limits = self.leg.limits
        return np.asarray(((self.q >= limits.lower) & (self.q <= limits.upper)).all(axis=1))


def _states(context: Context, lengths: Lengths) -> Array:
    lower, upper = context.limits
    share = context.rng(20).random((2, 2 * STATES, 3))
    drawn = np.concatenate([lower + share[0] * (upper - lower), np.pi * (2.0 * share[1] - 1.0)])
    bent = np.abs(np.sin(drawn[:, 2])) > KEPT_OFF
    l1, l2, l3 = lengths
    radius = l1 + l2 * np.cos(drawn[:, 1]) + l3 * np.cos(drawn[:, 1] + drawn[:, 2])
    good = bent & (np.abs(radius) > KEPT_OFF * sum(lengths))
    first, second = np.split(np.flatnonzero(good), [int(good[: 2 * STATES].sum())])
    return np.concatenate([np.radians([POSE_4]), drawn[first[:STATES]], drawn[second[:STATES]]])


def facts_of(context: Context) -> tuple[Facts, Facts]:
    """The shipped leg and the second one, at the pose of (4) and at random states inside and outside the limits."""

    def compute() -> tuple[Facts, Facts]:
        from leg_dynamics.routes import sibling

        found = []
        other = context.leg.replace(**OTHER)
        for leg, mount in ((context.leg, mount_of_iv(context)), (other, np.array(OTHER_MOUNT))):
            numbers = context.formulas.from_urdf(leg.description)
            bare = Facts(sibling(leg, "pinocchio"), numbers, np.zeros((0, 3)), mount)
            found.append(Facts(bare.leg, numbers, _states(context, bare.lengths), mount))
        return found[0], found[1]

    facts: tuple[Facts, Facts] = context.once("quadruped: facts", compute)
    return facts


def every(context: Context, difference: Any) -> Array:
    """One array of what `difference` gives for each leg's facts."""
    return np.concatenate([np.ravel(np.asarray(difference(facts), dtype=float)) for facts in facts_of(context)])


def counted_poses(context: Context) -> Facts:
    """The shipped leg at the context's number of random poses inside the limits; printed inverses are counted here."""

    def compute() -> Facts:
        first = facts_of(context)[0]
        lower, upper = context.limits
        q = lower + context.rng(21).random((2 * context.samples + 10, 3)) * (upper - lower)
        q = q[np.abs(q[:, 2]) > BENT][: context.samples]
        return Facts(first.leg, first.numbers, q, first.mount)

    facts: Facts = context.once("quadruped: counted poses", compute)
    return facts


def formula(context: Context, facts: Facts, name: str, *arguments: Any, leg: bool = True) -> Array:
    """A formula of `closed_form.quadruped_leg` at rows of vectors or matrices, as an array; with the leg or without."""
    function = getattr(context.formulas, name)
    first = (facts.numbers,) if leg else ()
    return array(function(*first, *(_components(each) for each in arguments)), (len(facts.q),))


def _components(value: Any) -> Any:
    """Rows of vectors (N, 3) or matrices (N, 4, 4) as the nested tuples that formulas take; anything else as it is."""
    if isinstance(value, np.ndarray) and value.ndim == 3:
        return tuple(tuple(row) for row in np.moveaxis(value, 0, -1))
    if isinstance(value, np.ndarray) and value.ndim == 2:
        return tuple(np.moveaxis(value, -1, 0))
    return value
