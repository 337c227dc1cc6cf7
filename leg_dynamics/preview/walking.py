"""The ground under a walking robot: it passes below the body, which stays in the picture, so that the walk can loop."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.errors import NonFiniteError, ShapeError
from leg_dynamics.preview.commands import Y_TO_Z, Colour, clip, load_meshcat, set_object, set_transform

__all__ = ["Walking"]

_SUPPORT: Colour = (0.16, 0.50, 0.73, 0.45)
_LINE: Colour = (0.60, 0.63, 0.67, 1.0)
_CENTRE: Colour = (0.10, 0.10, 0.12, 1.0)

_HIDDEN = 1e-4
"""Scale of what is not shown: a scale of zero has no inverse, which the viewer needs."""

_STRAIGHT = 1e-6
"""rad of turn over the whole motion that still count as none."""


@dataclass(frozen=True, slots=True)
class Walking:
    """How a robot moves over level ground at T times, for its picture.

    The root frame stays where it is. The lines of the ground grid pass by, spaced so that a loop of the motion moves
    them by whole cells; where the robot turns there are none, and the polygons of the standing feet show how the
    ground moves.

    Attributes
    ----------
    position : (T, 2) array
        Of the root frame in the world, m.
    yaw : (T,) array
        Of the root frame, rad.
    feet : (T, N, 3) array
        In the root frame, m: their paths are drawn, and the polygon of those that stand.
    stance : (T, N) array of bool
        Which feet stand from this time until the next.
    centre : (T, 2) array
        Projected centre of mass in the root frame, m.
    """

    position: np.ndarray
    yaw: np.ndarray
    feet: np.ndarray
    stance: np.ndarray
    centre: np.ndarray

    @classmethod
    def of(cls, position: ArrayLike, yaw: ArrayLike, feet: ArrayLike, stance: ArrayLike, centre: ArrayLike) -> Walking:
        """Check the arrays, see the attributes.

        Raises
        ------
        ShapeError
            The shapes do not fit each other.
        NonFiniteError
            A number is NaN or infinite.
        """
        place, angle, middle = (np.asarray(values, dtype=float) for values in (position, yaw, centre))
        points, standing = np.asarray(feet, dtype=float), np.asarray(stance, dtype=bool)
        T = angle.size
        N = points.shape[1] if points.ndim == 3 else 0
        shapes = (place.shape, angle.shape, points.shape, standing.shape, middle.shape)
        if shapes != ((T, 2), (T,), (T, N, 3), (T, N), (T, 2)):
            raise ShapeError(
                "a walk needs position (T, 2), yaw (T,), feet (T, N, 3), stance (T, N) and centre (T, 2), not "
                + ", ".join(map(str, shapes))
            )
        bad = ~np.isfinite(np.column_stack([place, angle, points.reshape(T, -1), middle])).all(axis=1)
        if bad.any():
            rows = np.flatnonzero(bad)
            raise NonFiniteError(f"a walk holds NaN or infinity in {rows.size} of {T} samples", rows=rows)
        return cls(place, angle, points, standing, middle)

    def at(self, times: np.ndarray, known: np.ndarray) -> Walking:
        """The walk at other times than the `known` ones: interpolated, and stance as of the last known time."""

        def columns(values: np.ndarray) -> np.ndarray:
            flat = values.reshape(len(known), -1)
            new = np.stack([np.interp(times, known, column) for column in flat.T], axis=-1)
            return new.reshape(len(times), *values.shape[1:])

        last = np.clip(np.searchsorted(known, times + 1e-12, side="right") - 1, 0, len(known) - 1)
        position, yaw, feet, centre = map(columns, (self.position, self.yaw, self.feet, self.centre))
        return Walking(position, yaw, feet, self.stance[last], centre)

    @property
    def turns(self) -> bool:
        """Whether the robot turns."""
        return bool(np.ptp(self.yaw) > _STRAIGHT)

    def cells(self, cell: float) -> tuple[float, float]:
        """Spacing of the grid lines along x and y next to `cell` that a loop of the motion moves by whole cells, m."""
        way = np.abs(self._passed()[-1])
        return tuple(float(d / max(1, round(d / cell))) if d > 1e-3 * cell else cell for d in way)  # type: ignore[return-value]

    def _passed(self) -> np.ndarray:
        """Way of the root frame since the first time, in its own axes, m, (T, 2); for a straight walk."""
        c, s = math.cos(self.yaw[0]), math.sin(self.yaw[0])
        return np.asarray((self.position - self.position[0]) @ np.array([[c, -s], [s, c]]))

    def _ground(self) -> np.ndarray:
        """Pose of the world in the root frame, (T, 4, 4)."""
        pose = np.broadcast_to(np.eye(4), (self.yaw.size, 4, 4)).copy()
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        pose[:, :2, :2] = np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=-2)
        pose[:, :2, 3] = -np.einsum("tij,tj->ti", pose[:, :2, :2], self.position)
        return pose

    def draw(
        self, floor: np.ndarray, spread: float, cell: float, radius: float, rate: float
    ) -> tuple[list[dict[str, Any]], dict[str, Any]]:
        """Viewer commands in the frame ``/leg``, and keyframes by viewer path.

        Parameters
        ----------
        floor : (3,) array
            Middle of the ground, m.
        spread : float
            Radius of the ground, m.
        cell : float
            About how far grid lines are apart, m.
        radius : float
            Of the scene, m.
        rate : float
            Keyframes a second.
        """
        commands, clips = [], {}
        for path, made, keys in itertools.chain(
            () if self.turns else self._lines(floor, spread, cell, radius, rate),
            self._polygons(floor, radius, rate),
            self._centre(floor, radius, rate),
        ):
            commands += made
            if keys is not None:
                clips[path] = keys
        return commands, clips

    def _lines(
        self, floor: np.ndarray, spread: float, cell: float, radius: float, rate: float
    ) -> Iterator[tuple[str, list[dict[str, Any]], Any]]:
        """Each line of the grid: it moves across the round ground, as long as the ground is wide there."""
        passed = self._passed()
        for axis, step in enumerate(self.cells(cell)):
            other = 1 - axis
            count = math.ceil(2.0 * spread / step) + 1
            ends = np.zeros((2, 3), dtype=np.float32)
            ends[:, other] = (-1.0, 1.0)
            for k in range(count):
                # Lines leave at one rim and come back at the other, both times out of sight.
                across = np.mod(k * step - passed[:, axis] + 0.5 * count * step, count * step) - 0.5 * count * step
                half = np.sqrt(np.maximum(spread**2 - across**2, 0.0))
                place = np.broadcast_to(floor - [0.0, 0.0, 0.002 * radius], (across.size, 3)).copy()
                place[:, axis] += across
                scale = np.ones((across.size, 3))
                scale[:, other] = np.maximum(half, _HIDDEN)
                path = f"/leg/ground/grid/{'xy'[axis]}{k}"
                made = [set_object(path, load_meshcat().geometry.PointsGeometry(ends.T), _LINE, line=True)]
                yield path, [*made, set_transform(path, _placed(place[0], scale[0]))], _keys(rate, place, scale)

    def _polygons(
        self, floor: np.ndarray, radius: float, rate: float
    ) -> Iterator[tuple[str, list[dict[str, Any]], Any]]:
        """The support polygon of each run of times with the same standing feet; it stays where the feet are."""
        from scipy.spatial.transform import Rotation

        ground = self._ground()
        start = 0
        for number, (_, group) in enumerate(itertools.groupby(self.stance.tolist())):
            run = slice(start, start + len(list(group)))
            start = run.stop
            middle = (run.start + run.stop - 1) // 2
            corners = _hull(self.feet[middle][self.stance[middle]][:, :2])
            if len(corners) < 3:
                continue
            centre = np.array([*corners.mean(axis=0), floor[2] + 0.001 * radius])
            level = np.column_stack([corners - centre[:2], np.zeros(len(corners))])
            faces = np.array([[0, k, k + 1] for k in range(1, len(corners) - 1)])
            motion = ground @ np.linalg.inv(ground[middle])
            place = motion[:, :3, :3] @ centre + motion[:, :3, 3]
            # Between two frames the viewer interpolates: what is hidden shrinks where it is.
            shown = np.full((self.yaw.size, 3), _HIDDEN)
            shown[run] = 1.0
            path = f"/leg/ground/support/{number}"
            pose = motion[0] @ np.diag([*shown[0], 1.0])
            pose[:3, 3] = place[0]
            made = [
                set_object(path, load_meshcat().geometry.TriangularMeshGeometry(level, faces), _SUPPORT),
                set_transform(path, pose),
            ]
            quaternions = Rotation.from_matrix(motion[:, :3, :3]).as_quat() if self.turns else None
            yield path, made, _keys(rate, place, shown, quaternions)

    def _centre(self, floor: np.ndarray, radius: float, rate: float) -> Iterator[tuple[str, list[dict[str, Any]], Any]]:
        """A dot on the ground below the centre of mass."""
        path = "/leg/ground/centre of mass"
        dot = load_meshcat().geometry.Cylinder(0.004 * radius, 0.018 * radius)
        place = np.column_stack([self.centre, np.full(len(self.centre), floor[2] + 0.004 * radius)])
        made = [
            set_object(f"{path}/dot", dot, _CENTRE),
            set_transform(f"{path}/dot", Y_TO_Z),
            set_transform(path, _placed(place[0], np.ones(3))),
        ]
        yield path, made, _keys(rate, place)


def _keys(
    rate: float, place: np.ndarray, scale: np.ndarray | None = None, quaternions: np.ndarray | None = None
) -> Any:
    """Keyframes of a node; None where nothing changes."""
    tracks: dict[str, Any] = {"position": ("vector3", place.tolist())}
    if scale is not None:
        tracks["scale"] = ("vector3", scale.tolist())
    if quaternions is not None:
        tracks["quaternion"] = ("quaternion", quaternions.tolist())
    moving = any(np.ptp(values, axis=0).max() > 1e-12 for values in (place, scale, quaternions) if values is not None)
    return clip(rate, **tracks) if moving else None


def _placed(place: np.ndarray, scale: np.ndarray) -> np.ndarray:
    pose = np.diag([*scale, 1.0])
    pose[:3, 3] = place
    return pose


def _hull(points: np.ndarray) -> np.ndarray:
    """Corners of the convex hull, counter-clockwise (Andrew's monotone chain); fewer than three: it has no area."""
    ordered = sorted(map(tuple, points.tolist()))

    def chain(along: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
        corners: list[tuple[float, ...]] = []
        for point in along:
            while len(corners) > 1 and _turn(corners[-2], corners[-1], point) <= 0.0:
                corners.pop()
            corners.append(point)
        return corners[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1])).reshape(-1, 2)


def _turn(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
