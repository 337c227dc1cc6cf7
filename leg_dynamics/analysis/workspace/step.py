"""Step length L and step height Z of a leg, after Rong 2012, whose text leaves their definitions open.

In the plane through the home position of the foot that holds the direction of walking x and the vertical z:

- L is the length of the feasible chord at the home height h that holds the home position. Side by side: the longest
  feasible chord at any height, and the x-extent of the whole workspace.
- Z_f and Z_b are how far the foot lifts at its extreme swing: h minus the least feasible z ahead of home (+x) and
  behind it (-x). (Where z points up, the greatest feasible z minus h.)

All ends are found by bisection on the feasibility of the poses that inverse kinematics gives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from leg_dynamics.analysis.workspace.boundary import bisected
from leg_dynamics.analysis.workspace.foot import FootEvaluator
from leg_dynamics.errors import WorkspaceError

__all__ = ["DEFINITION", "Step", "home_inside", "no_step", "step_sizes", "with_home"]

_NO_LENGTH = 1e-6
"""Of the workspace's x-extent: a chord that is shorter is none."""

_EDGE = 1e-14
"""Of the way to the middle of the workspace: some tens of roundings. A chord there is still none."""

_HALVINGS = 28
"""Of a scan's step, which is some millimetres: the ends are exact to less than a nanometre."""

DEFINITION = (
    "L: feasible chord along x through the home position, in the plane y = home, z = home height h; Z_f, Z_b: lift at "
    "the extreme swing, h minus the least feasible z in that y plane ahead (+x) and behind (-x) of home"
)


@dataclass(frozen=True)
class Step:
    """Step length and height, m, with the definition that they follow.

    Attributes
    ----------
    home : tuple of float
        Home position of the foot, hip frame, m; its z is h.
    length : float
        L.
    start, end : float
        x of the chord's ends, m.
    start_limit, end_limit : str
        The constraint that ends the chord on either side.
    longest, longest_height : float
        The longest feasible chord and its z.
    extent : float
        x-extent of the whole workspace.
    front, back : float
        Z_f and Z_b.
    front_at, back_at : tuple of float
        Foot positions (x, z) of the extreme swings.
    front_limit, back_limit : str
        The constraint that is active there.
    definition : str
    """

    home: tuple[float, float, float]
    length: float
    start: float
    end: float
    start_limit: str
    end_limit: str
    longest: float
    longest_height: float
    extent: float
    front: float
    back: float
    front_at: tuple[float, float]
    back_at: tuple[float, float]
    front_limit: str
    back_limit: str
    definition: str = DEFINITION

    @property
    def note(self) -> str:
        """Why L is zero although the home position is feasible; empty where it is not."""
        if self.length > _NO_LENGTH * self.extent:
            return ""
        ends = " and ".join(dict.fromkeys((self.start_limit, self.end_limit)))
        place = ", ".join(f"{round(value, 6) + 0.0:g}" for value in self.home)
        return (
            f"L is 0 because the home position ({place}) m is on the edge of the workspace, which ends there "
            f"along x by {ends}; take another height, or another home configuration"
        )

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON-ready values."""
        return asdict(self) | {"note": self.note}


def no_step(home: np.ndarray, constraint: str, margin: float) -> WorkspaceError:
    """Error of a leg whose home position (3,) is not feasible: it has neither L nor Z_f nor Z_b.

    Parameters
    ----------
    home : (3,) array
        m.
    constraint : str
        What is broken there.
    margin : float
        Of it, in its own unit; infinite or NaN where it has none.
    """
    by = f", margin {margin:.4g}" if math.isfinite(margin) else ""
    return WorkspaceError(
        f"the home position {(np.round(home, 6) + 0.0).tolist()} m is not feasible ({constraint!r}{by}), so no step "
        "starts there: choose another home configuration, or another height",
        margin=margin,
        constraint=constraint,
    )


def with_home(lower: np.ndarray, upper: np.ndarray, home: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a box that holds the home position too: a feasible one may be at the end of the workspace."""
    return np.minimum(lower, home), np.maximum(upper, home)


def home_inside(
    feasible: Callable[[np.ndarray], bool], home: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray | None:
    """The home position (3,), or a neighbour at the distance of rounding where home is on the workspace's edge.

    On the edge itself, such as a leg that is straight at home, the last digit would decide.

    Parameters
    ----------
    feasible : callable
        Of a position (3,).
    home : (3,) array
    lower, upper : (3,) array
        Corners of the workspace's box; the neighbour lies towards its middle.

    Returns
    -------
    (3,) array or None
        None where neither is feasible.
    """
    middle = 0.5 * (lower + upper)
    return next((point for point in (home, home + _EDGE * (middle - home)) if feasible(point)), None)


def step_sizes(foot: FootEvaluator, home: np.ndarray, lower: np.ndarray, upper: np.ndarray, down: float) -> Step:
    """Step length and height.

    Parameters
    ----------
    foot : FootEvaluator
        With an inverse kinematics.
    home : (3,) array
        Home position of the foot, m.
    lower, upper : (3,) array
        Corners of the workspace's box, m.
    down : float
        +1 where the hip frame's z points down, -1 where it points up.

    Raises
    ------
    WorkspaceError
        The home position is not feasible.
    """
    start = home_inside(lambda point: bool(foot(point[None]).feasible[0]), home, lower, upper)
    if start is None:
        at_home = foot(home[None])
        raise no_step(home, foot.evaluate.name_of(at_home.active[0]), float(at_home.margin[0]))
    plane = _Plane(foot, start, *with_home(lower, upper, home), down)
    (first, end), (start_limit, end_limit) = plane.chord_through_home()
    longest, height = plane.longest_chord()
    (front, front_at, front_limit), (back, back_at, back_limit) = plane.lift(1.0), plane.lift(-1.0)
    return Step(
        home=(float(home[0]), float(home[1]), float(home[2])),
        length=end - first,
        start=first,
        end=end,
        start_limit=start_limit,
        end_limit=end_limit,
        longest=max(longest, end - first),
        longest_height=height if longest > end - first else float(home[2]),
        extent=float(upper[0] - lower[0]),
        front=front,
        back=back,
        front_at=front_at,
        back_at=back_at,
        front_limit=front_limit,
        back_limit=back_limit,
    )


class _Plane:
    """The x-z plane through the home position, scanned with a resolution that suits the route."""

    def __init__(
        self, foot: FootEvaluator, home: np.ndarray, lower: np.ndarray, upper: np.ndarray, down: float
    ) -> None:
        self.foot, self.home, self.down = foot, home, down
        pad = 0.02 * (upper - lower)
        self.lower, self.upper = lower - pad, upper + pad
        self.fine = (601, 121) if foot.is_quick else (61, 13)

    def points(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        x, z = np.broadcast_arrays(x, z)
        return np.stack([x, np.full(x.shape, self.home[1]), z], axis=-1).reshape(-1, 3)

    def feasible(self, x: np.ndarray, z: np.ndarray) -> np.ndarray:
        shape = np.broadcast_shapes(x.shape, z.shape)
        return self.foot(self.points(x, z)).feasible.reshape(shape)

    def ends(self, good: np.ndarray, bad: np.ndarray) -> tuple[np.ndarray, list[str], list[str]]:
        """Feasible ends between points (N, 3), the constraint active there and the one broken beyond."""
        poses, beyond = bisected(self.foot, good, bad, _HALVINGS)
        inside = [self.foot.evaluate.name_of(index) for index in poses.active]
        # Beyond the reach no constraint says what ended it: the one that is active just before does.
        names = [
            self.foot.evaluate.name_of(index) if index != -1 else f"reach ({name})"
            for index, name in zip(beyond, inside, strict=True)
        ]
        return poses.foot, inside, names

    def chord_through_home(self) -> tuple[tuple[float, float], tuple[str, str]]:
        x0, h = self.home[0], np.array(self.home[2])
        grid = np.linspace(self.lower[0], self.upper[0], self.fine[0])
        ends, names = [], []
        for side in (grid[grid < x0][::-1], grid[grid > x0]):
            line = np.concatenate([[x0], side])
            outside = np.flatnonzero(~self.feasible(line, h))
            if outside.size == 0:  # cannot be: the box's margin is not feasible
                ends.append(float(line[-1]))
                names.append("none")
                continue
            k = int(outside[0])
            point, _, name = self.ends(self.points(line[[k - 1]], h), self.points(line[[k]], h))
            ends.append(float(point[0, 0]))
            names.append(name[0])
        return (ends[0], ends[1]), (names[0], names[1])

    def chords(self, heights: np.ndarray) -> np.ndarray:
        """Length of the longest feasible chord at each height z (N,)."""
        x = np.linspace(self.lower[0], self.upper[0], self.fine[0])
        inside = self.feasible(x[None, :], heights[:, None])
        lengths, runs = np.zeros(len(heights)), []
        for row, flags in enumerate(inside):
            edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
            if edges.size:
                spans = edges.reshape(-1, 2)
                first, last = spans[int(np.argmax(spans[:, 1] - spans[:, 0]))]
                if first > 0 and last < len(x):
                    runs.append((row, first, last))
        if not runs:
            return lengths
        rows, first, last = np.array(runs).T
        z = heights[rows]
        good = np.concatenate([self.points(x[first], z), self.points(x[last - 1], z)])
        bad = np.concatenate([self.points(x[first - 1], z), self.points(x[last], z)])
        ends = bisected(self.foot, good, bad, _HALVINGS)[0].foot[:, 0]
        lengths[rows] = ends[len(rows) :] - ends[: len(rows)]
        return lengths

    def longest_chord(self) -> tuple[float, float]:
        low, high = float(self.lower[2]), float(self.upper[2])
        best, at = 0.0, float(self.home[2])
        for zoom in range(5 if self.foot.is_quick else 2):
            heights = np.linspace(low, high, self.fine[1] if zoom == 0 else 17)
            lengths = self.chords(heights)
            k = int(np.argmax(lengths))
            if lengths[k] > best:
                best, at = float(lengths[k]), float(heights[k])
            step = (high - low) / (len(heights) - 1)
            low, high = at - step, at + step
        return best, at

    def lift(self, side: float) -> tuple[float, tuple[float, float], str]:
        """Lift at the extreme swing on one side of home, where that is, and the constraint active there."""
        x0 = float(self.home[0])
        low, high = sorted((x0, float(self.upper[0] if side > 0.0 else self.lower[0])))
        top, bottom = (self.lower[2], self.upper[2]) if self.down > 0.0 else (self.upper[2], self.lower[2])
        # Home's own height too: a workspace may be thinner than the lines are apart.
        z = np.sort(np.append(np.linspace(top, bottom, self.fine[0] // 2), self.home[2]))[:: int(self.down)]
        best, at, limit = -math.inf, (math.nan, math.nan), "none"
        for zoom in range(6 if self.foot.is_quick else 4):
            x = np.linspace(low, high, self.fine[1] if zoom == 0 else 25)
            inside = self.feasible(x[:, None], z[None, :])
            columns = np.flatnonzero(inside.any(axis=1) & ~inside[:, 0])
            if columns.size:
                first = inside[columns].argmax(axis=1)
                found, active, _ = self.ends(self.points(x[columns], z[first]), self.points(x[columns], z[first - 1]))
                lifts = self.down * (self.home[2] - found[:, 2])
                k = int(np.argmax(lifts))
                if lifts[k] > best:
                    best, at, limit = float(lifts[k]), (float(found[k, 0]), float(found[k, 2])), active[k]
            if not math.isfinite(best):
                break
            step = (high - low) / (len(x) - 1)
            low, high = (max(low, at[0] - step), min(high, at[0] + step))
        return best, at, limit
