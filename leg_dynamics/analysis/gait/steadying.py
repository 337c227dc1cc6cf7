"""Body motions that steady a walk: the sway with the greatest least margin, and a bound that no motion can exceed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.gait.robot import Robot
from leg_dynamics.analysis.gait.stability import project, support_margin
from leg_dynamics.analysis.gait.study import instants, leg_poses
from leg_dynamics.analysis.gait.walk import Sway, Walk
from leg_dynamics.errors import TrajectoryError

__all__ = ["margin_bound", "steadying_sway"]

Array = NDArray[np.float64]

MAX_HARMONICS = 12

_PROBE = 1e-4
"""m; shift of the body by which the derivative of the centre of mass is taken."""

_CONVERGED = 1e-7
"""m; of the least margin from one linear programme to the next."""

_ROUNDS = 12

_SHORTER = 1e-3
"""Margin that is given up for a sway shorter by 1: of equal margins the smallest sway counts."""

_CREEP = 0.01
"""Share of the walk's speed that the body keeps at the samples, so that it does not go back between them."""

_BESIDE = 1e-8
"""Share of the period between a switch of the gait and the supports on both sides of it."""


def margin_bound(walk: Walk) -> float:
    """What the least static margin of a walk cannot exceed, wherever the centre of mass goes, m.

    Where one foot touches down and another lifts off at once, the centre of mass has to be within the feet that stand
    before and within those that stand after: at each switch, the greatest margin that any place has to both supports;
    the least of these. A creeping gait with duty factor 3/4 has none where the next leg is diagonally across: both
    supports share the diagonal only.

    Parameters
    ----------
    walk : Walk
        Its sway and tilt do not matter.

    Returns
    -------
    float
        m; 0 where only two feet stand, or one, and minus infinity where none does.
    """
    from scipy.optimize import linprog

    level, least = replace(walk, sway=None, tilt=None), np.inf
    for switch in walk.table.switches():
        feet = level.feet([switch * walk.period]).position[0, :, :2]
        rows, limits = [], []
        for standing in walk.table.in_stance(np.mod([switch - _BESIDE, switch + _BESIDE], 1.0)):
            sides = _sides(feet[standing])
            if sides is None:
                # On the edge between two feet at best.
                least = min(least, 0.0 if standing.any() else -np.inf)
                continue
            rows += [[*normal, 1.0] for normal in sides[:, :2]]
            limits += list(-sides[:, 2])
        if rows:
            free = [(None, None)] * 3
            least = min(least, -float(linprog([0.0, 0.0, -1.0], rows, limits, bounds=free, method="highs").fun))
    return float(least) + 0.0


def steadying_sway(
    robot: Robot,
    walk: Walk,
    ahead: float,
    left: float = 0.0,
    *,
    harmonics: int = 4,
    backwards: bool = False,
    samples: int = 120,
    branch: str | None = None,
) -> Sway:
    """The sway that makes the least static stability margin of a walk as great as it can be.

    The margin is the least distance of the projected centre of mass to the edges of the standing feet, and each
    distance is linear in the sway's coefficients but for the legs, whose masses stay behind with the feet. So it is a
    sequence of linear programmes, each with the centre of mass and its derivative at the sway found before. Of equal
    margins the smaller sway is taken.

    Parameters
    ----------
    robot : Robot
    walk : Walk
        A sway that it has already is left out.
    ahead, left : float
        Greatest shift of the body either way along both axes, m. With ``left = 0`` it moves straight ahead, at a
        speed that changes.
    harmonics : int
        Of the period.
    backwards : bool
        Whether the body may move backwards at times; a walk on the spot has no such direction.
    samples : int
        Even steps of a period at which the margin counts; the switches of the gait come on top.
    branch : str, optional
        Of the legs' inverse kinematics.

    Returns
    -------
    Sway

    Raises
    ------
    TrajectoryError
        A number is not usable, or fewer than three feet stand at some time.
    OutOfReachError
        A foot is out of reach with the sway; with `leg` and `time`.
    """
    from scipy.optimize import linprog

    bounds = [arguments.tolerance(f"sway {what}", bound) for what, bound in (("ahead", ahead), ("to the left", left))]
    K = arguments.whole("the number of harmonics", harmonics, 1, MAX_HARMONICS)
    time, stance = instants(walk, arguments.whole("the number of samples", samples, 4 * K, 10_000))
    level = replace(walk, sway=None, tilt=None)
    feet = level.feet(time).position
    supports = [_sides(feet[i, on, :2]) for i, on in enumerate(stance)]
    few = [i for i, sides in enumerate(supports) if sides is None]
    if few:
        raise TrajectoryError(
            f"a sway cannot steady a robot on fewer than three feet: {int(stance[few[0]].sum())} of {robot.name!r} "
            f"stand at t = {time[few[0]]:g} s; raise the duty factor above {walk.table.duty:g}, or leave the sway out"
        )
    centre = _Centre(robot, walk, time, stance, feet, branch)
    waves, rates = _waves(walk.cycles(time), K, walk.period)
    ahead_shift, left_shift = np.split(np.eye(4 * K), 2)
    # Rows of the programme: coefficients of the shift (ahead: cosines, sines; left: the same), then margin and peaks.
    shift = np.stack([waves @ ahead_shift, waves @ left_shift], axis=1)
    fixed, fixed_limits = _fixed_rows(
        walk, shift, np.stack([rates @ ahead_shift, rates @ left_shift], axis=1), backwards
    )
    aim = np.concatenate([np.zeros(4 * K), [-1.0, _SHORTER, _SHORTER]])
    # A sum of K waves is nowhere greater than at the samples over this cosine (Ehlich & Zeller 1964).
    between = float(np.cos(np.pi * K / samples))
    ranges = [(None, None)] * (4 * K + 1) + [(0.0, between * bound) for bound in bounds]
    moved, found, best = np.zeros((time.size, 2)), np.zeros(4 * K), (-np.inf, np.zeros(4 * K))
    for _ in range(_ROUNDS):
        place, slope = centre.linearised(moved)
        margin = float(support_margin(feet[..., :2], stance, place + moved).min())
        if margin > best[0]:
            improved, best = margin - best[0], (margin, found)
        else:
            improved = 0.0
        if improved < _CONVERGED:
            break
        # place + moved at the new shift s: place + slope (s - moved) + s.
        grows = np.eye(2) + slope
        offset = place - np.einsum("tij,tj->ti", slope, moved)
        rows, limits = [], []
        for sides, point, gain, own in zip(supports, offset, grows, shift, strict=True):
            assert sides is not None
            normals = sides[:, :2]
            rows.append(np.hstack([normals @ gain @ own, np.ones((len(sides), 1)), np.zeros((len(sides), 2))]))
            limits.append(-sides[:, 2] - normals @ point)
        solved = linprog(
            aim,
            np.vstack([*rows, fixed]),
            np.concatenate([*limits, fixed_limits]),
            bounds=ranges,
            method="highs",
        )
        if not solved.success:
            raise TrajectoryError(
                f"there is no sway within {ahead:g} m ahead and {left:g} m to the left: {solved.message}"
            )
        found = solved.x[: 4 * K]
        moved = shift @ found
    across = best[1].reshape(2, 2, K)
    cosine, sine = (np.column_stack([across[0, part], across[1, part], np.zeros(K)]) + 0.0 for part in (0, 1))
    return Sway(cosine, sine)


class _Centre:
    """The projected centre of mass against the body's origin, in level axes, for shifts of the body."""

    def __init__(
        self,
        robot: Robot,
        walk: Walk,
        time: Array,
        stance: NDArray[np.bool_],
        feet: Array,
        branch: str | None,
    ) -> None:
        self.robot, self.time, self.feet, self.branch = robot, time, feet, branch
        self.body = replace(walk, sway=None).body(time)
        self.ground = np.where(stance, feet[..., 2], 0.0).sum(axis=1) / stance.sum(axis=1)

    def at(self, shift: Array) -> Array:
        """For shifts (T, 2) m: (T, 2) m."""
        level = self.feet.copy()
        level[..., :2] -= shift[:, None, :]
        q = leg_poses(self.robot, self.time, self.body.in_body(level), self.branch, ", or make the sway smaller")
        _, com = self.robot.centre_of_mass(q)
        return project(self.body.level(com), self.robot.gravity, self.ground)

    def linearised(self, shift: Array) -> tuple[Array, Array]:
        """The same, and its derivative by the shift, (T, 2, 2)."""
        steps = _PROBE * np.eye(2)
        slopes = [(self.at(shift + step) - self.at(shift - step)) / (2.0 * _PROBE) for step in steps]
        return self.at(shift), np.stack(slopes, axis=-1)


def _waves(cycles: Array, count: int, period: float) -> tuple[Array, Array]:
    """Cosines and sines, and their rates, (T, 2 K) each."""
    k = 2.0 * np.pi * np.arange(1, count + 1)
    c, s = np.cos(cycles[:, None] * k), np.sin(cycles[:, None] * k)
    return np.hstack([c, s]), np.hstack([-k * s, k * c]) / period


def _fixed_rows(walk: Walk, shift: Array, rate: Array, backwards: bool) -> tuple[Array, Array]:
    """What does not depend on the centre of mass: peaks of the shift, and no way back."""
    zero = np.zeros((len(shift), 1))
    rows = [
        np.hstack([sign * shift[:, axis], zero, *(-1.0 + zero if k == axis else zero for k in range(2))])
        for axis in range(2)
        for sign in (1.0, -1.0)
    ]
    limits = [np.zeros(len(shift))] * 4
    x, y, w = walk.twist
    speed = float(np.hypot(x, y))
    if speed > 0.0 and not backwards:
        u = np.array([x, y]) / speed
        # The body's velocity in the carrier's axes: its own, the shift's rate, and the shift turned with the carrier.
        turned = w * np.stack([-shift[:, 1], shift[:, 0]], axis=1)
        rows.append(np.hstack([-np.einsum("i,tij->tj", u, rate + turned), zero, zero, zero]))
        limits.append(np.full(len(shift), (1.0 - _CREEP) * speed))
    return np.vstack(rows), np.concatenate(limits)


def _sides(points: Array) -> Array | None:
    """Sides of the hull of points (N, 2): outward normal n and offset d, n p + d <= 0 inside; None where flat."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 3:
        return None
    try:
        return np.asarray(ConvexHull(points).equations)
    except QhullError:
        return None
