"""What verdicts on the hexapod leg are computed from: the mechanism assembled from its file, and formulas on arrays.

The two share nothing. Facts are poses by plain forward kinematics of the numerically assembled tree and differences of
poses; formulas are those of `closed_form.hexapod_leg`, as corrected.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.papers.comparison import EXACT
from leg_dynamics.papers.framework import Context
from leg_dynamics.papers.mechanism import Assembled, array

if TYPE_CHECKING:
    from leg_dynamics.analysis.workspace import Workspace
    from leg_dynamics.leg import Leg

__all__ = [
    "BEYOND_THE_PAPER",
    "POSITION_TOLERANCE",
    "PRELIMINARY_LEG",
    "RATE_TOLERANCE",
    "Facts",
    "facts_of",
    "formula",
    "formula_of_foot",
    "preliminary",
    "preliminary_workspace",
    "states",
    "tuples",
    "workspace_of",
]

Array = np.ndarray

POSITION_TOLERANCE = EXACT
RATE_TOLERANCE = 1e-8
"""1, rad/m: fourth-order differences of poses with a step of 1e-4 m."""

TEST_FOOT = (0.25, 0.2, 0.65)
"""m; well off the planes α = 0 and β = 0."""

STATES = 160
PRELIMINARY_LEG = "hexapod_leg_preliminary"
BEYOND_THE_PAPER = ("telescope", "clearance")
"""Kinds of constraints that section 4 names or implies and gives no number for: left out of its workspace."""


def states(context: Context) -> Array:
    """States of the verdicts, q (N, 3) m: the initial pose, a point off all planes, then random ones in the limits.

    The random ones are spread over the angles of strut 1, and those whose lengths leave their limits are dropped; they
    keep a millimetre from each limit, so that differences stay inside.
    """

    def compute() -> Array:
        f = context.formulas
        h = context.leg.parameters["h"].value
        lower, upper = context.limits
        share = context.rng(10).random((8 * STATES, 3))
        angle = np.radians(58.0) * (2.0 * share[:, :2] - 1.0)
        length = lower[0] + share[:, 2] * (upper[0] - lower[0])
        direction = array(f.platform_rotation(angle[:, 0], angle[:, 1]), (len(angle),))[..., 2]
        p = np.concatenate([[[0.0, 0.0, h], TEST_FOOT], length[:, None] * direction])
        q = array(f.inverse_kinematics(context.numbers, tuple(p.T)).q, (len(p),))
        inside = ((q > lower + 1e-3) & (q < upper - 1e-3)).all(axis=1)
        return q[inside][: STATES + 2]

    q: Array = context.once("hexapod: states", compute)
    return q


@dataclass(frozen=True)
class Facts:
    """The assembled mechanism in the paper's vectors, at states q (N, 3): poses of its links, and the file's lengths.

    Rates are for unit rates of the struts, one at a time: (N, 3, 3), the middle axis is the strut that moves.
    """

    mechanism: Assembled

    @property
    def q(self) -> Array:
        """Lengths of the struts, (N, 3) m."""
        return self.mechanism.q

    def length(self, i: int) -> Array:
        """Length of strut i, (N,) m."""
        return self.q[:, i - 1]

    def angle(self, joint: str) -> Array:
        """Angle of a passive joint, (N,) rad."""
        return self.mechanism.angle(joint)

    @cached_property
    def foot(self) -> Array:
        """B1, (N, 3) m."""
        return self.mechanism.position("foot")

    @cached_property
    def platform(self) -> Array:
        """R = [u p w] of the platform, (N, 3, 3)."""
        return self.mechanism.rotation("rod_1")

    def w(self, i: int) -> Array:
        """Direction of strut i, (N, 3)."""
        return self.mechanism.rotation(f"sleeve_{i}")[..., 2]

    def hip(self, i: int) -> Array:
        """Vector from A1 to A_i, (N, 3) m."""
        return self.mechanism.position(f"cross_{i}") - self.mechanism.position("cross_1")

    def parameter(self, name: str) -> float:
        """A parameter of the leg's file, m."""
        return float(self.mechanism.leg.parameters[name].value)

    @property
    def e(self) -> float:
        """A1 to B0, m."""
        return self.parameter("e")

    @cached_property
    def b(self) -> Array:
        """B0 to B2, (N, 3) m: across strut 1 in its plane with strut 2, towards A2."""
        return self.parameter("b") * self.platform[..., 0]

    @cached_property
    def c(self) -> Array:
        """B1 to B3, (N, 3) m: along p, towards A3."""
        return self.parameter("side") * self.parameter("c") * self.platform[..., 1]

    @cached_property
    def v1(self) -> Array:
        """Velocity of B1, (N, 3, 3)."""
        return np.swapaxes(self.mechanism.velocity("foot"), 1, 2)

    def omega(self, i: int) -> Array:
        """Angular velocity of strut i, (N, 3, 3) rad/m."""
        return np.swapaxes(self.mechanism.omega(f"sleeve_{i}"), 1, 2)

    @cached_property
    def rates(self) -> Array:
        """Rates of the struts, (N, 3, 3)."""
        return np.broadcast_to(np.eye(3), (len(self.q), 3, 3))

    @cached_property
    def inverse_jacobian(self) -> Array:
        """The struts' rates by the velocity of B1, (N, 3, 3): differences of poses, inverted."""
        return np.linalg.inv(self.mechanism.velocity("foot"))


def facts_of(context: Context) -> Facts:
    """The assembled mechanism at `states`."""
    facts: Facts = context.once("hexapod: facts", lambda: Facts(Assembled(context.pinocchio, states(context))))
    return facts


# The corrected formulas on arrays.


def tuples(values: Any) -> Any:
    """An array (N, 3) as the components that formulas take; anything else as it is."""
    return tuple(np.moveaxis(values, -1, 0)) if isinstance(values, np.ndarray) and values.ndim > 1 else values


def formula(context: Context, name: str, first: Array, *others: Any, leg: bool = True) -> Array:
    """A formula of `closed_form.hexapod_leg` at rows of vectors, as an array."""
    function = getattr(context.formulas, name)
    arguments = [tuples(value) for value in (first, *others)]
    shape = first.shape[:-1] if first.ndim > 1 else first.shape
    return array(function(context.numbers, *arguments) if leg else function(*arguments), shape)


def formula_of_foot(context: Context, name: str, *rates: Array) -> Array:
    """A formula of the foot position and of rates (N, 3, 3) whose middle axis counts motions: the same for each."""
    p = facts_of(context).foot
    return np.stack([formula(context, name, p, *(rate[:, k] for rate in rates)) for k in range(3)], axis=1)


# The workspace of both designs.


def preliminary(context: Context) -> Leg:
    """The leg of section 4.1."""
    import leg_dynamics

    leg: Leg = context.once("hexapod: preliminary leg", lambda: leg_dynamics.load(PRELIMINARY_LEG))
    return leg


def workspace_of(context: Context, leg: Leg) -> Workspace:
    """Workspace by the constraints that the paper gives numbers for."""
    from leg_dynamics.analysis.workspace import workspace

    result: Workspace = context.once(
        f"hexapod: workspace of {leg.name}", lambda: workspace(leg, ignore=BEYOND_THE_PAPER, seed=context.seed)
    )
    return result


def preliminary_workspace(context: Context) -> Workspace:
    """Workspace of the leg of section 4.1."""
    return workspace_of(context, preliminary(context))
