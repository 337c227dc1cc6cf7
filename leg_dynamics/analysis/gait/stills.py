"""Stills of a walking robot, drawn from the shapes of its file without a browser: Chen 2021, Fig. 5."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis.gait.picture import picture
from leg_dynamics.analysis.gait.study import GaitStudy
from leg_dynamics.description import link_transforms
from leg_dynamics.description.model import Description, Geometry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_stills", "still_rows"]

Array = NDArray[np.float64]

_MOST = 6
_SIDES = 14
_GREY = (0.62, 0.66, 0.71, 1.0)
_TOWARDS: Array = np.array([0.62, -0.60, 0.50])
"""Of the camera, seen from the robot: in front of it, on its right, above."""
_LIGHT: Array = np.array([0.30, -0.35, 0.89])
_AMBIENT = 0.55
_SUPPORT = (0.16, 0.50, 0.73, 0.30)


def still_rows(study: GaitStudy) -> list[int]:
    """Samples to draw, in the order of time: the middles of the swings if they are few, else evenly spaced ones."""
    table, cycles = study.walk.table, study.time / study.walk.period
    middles: Array = np.unique(np.round(np.mod(np.array(table.phases) - 0.5 * (1.0 - table.duty), 1.0), 9))
    if len(middles) > _MOST:
        middles = np.arange(_MOST) / _MOST
    return sorted({int(np.abs(cycles - middle).argmin()) for middle in middles})


def draw_stills(study: GaitStudy, figure: Figure, title: str = "") -> Figure:
    """Draw the stills into an empty figure.

    Raises
    ------
    DescriptionError
        The robot has no file.
    """
    from matplotlib.collections import PolyCollection

    scene, rows = picture(study), still_rows(study)
    right, up = _screen()
    towards = np.cross(right, up)
    transforms = link_transforms(scene.description, {name: values[rows] for name, values in scene.values.items()})
    shapes = [_faces(scene.description, transforms, k) for k in range(len(rows))]
    ground = float(scene.feet[..., 2].min())
    columns = 2 if len(rows) in (2, 4) else min(3, len(rows))
    axes = np.atleast_1d(figure.subplots(-(-len(rows) // columns), columns, sharex=True, sharey=True)).ravel()
    for axis, row, faces in zip(axes, rows, shapes, strict=False):
        standing = [name for name, on in zip(study.robot.leg_names, study.stance[row], strict=True) if on]
        feet = scene.feet[row][study.stance[row]].copy()
        feet[:, 2] = ground
        centre = np.array([*scene.centre[row], ground])
        if len(feet) > 2:
            angle = np.arctan2(*(feet - feet.mean(axis=0)).T[1::-1])
            corners = feet[np.argsort(angle)]
            axis.add_collection(PolyCollection([_on_screen(corners, right, up)], facecolors=[_SUPPORT], zorder=1))
        seen = sorted(faces, key=lambda face: float((face[0] @ towards).mean()))
        polygons = [_on_screen(corners, right, up) for corners, _ in seen]
        colours = [colour for _, colour in seen]
        # As pixels also in a vector file: thousands of faces.
        shown = PolyCollection(polygons, facecolors=colours, edgecolors=colours, linewidths=0.3, zorder=2)
        shown.set_rasterized(True)
        axis.add_collection(shown)
        axis.plot(*_on_screen(centre[None], right, up).T, marker="o", color="k", markersize=4, zorder=3)
        swinging = [name for name in study.robot.leg_names if name not in standing]
        words = f"{', '.join(swinging)} in the air" if swinging else "all feet on the ground"
        axis.set_title(f"{study.time[row]:.3g} s: {words}", loc="left", fontsize="medium")
        axis.set_aspect("equal")
        axis.autoscale_view()
    for axis in axes:
        axis.set_axis_off()
    figure.suptitle(title)
    return figure


def _screen() -> tuple[Array, Array]:
    towards = _TOWARDS / np.linalg.norm(_TOWARDS)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return right, np.cross(towards, right)


def _on_screen(points: Array, right: Array, up: Array) -> Array:
    return np.stack([points @ right, points @ up], axis=-1)


def _faces(
    description: Description, transforms: dict[str, Array], sample: int
) -> list[tuple[Array, tuple[float, float, float]]]:
    """Corners and shaded colour of every face that looks at the camera."""
    right, up = _screen()
    towards, light = np.cross(right, up), _LIGHT / np.linalg.norm(_LIGHT)
    found = []
    for link in description.links:
        place = transforms[link.name]
        place = place[sample] if place.ndim == 3 else place
        for visual in link.visuals:
            pose = place @ visual.origin.matrix()
            colour = np.array((visual.rgba or _GREY)[:3])
            for corners, normal in _with_normals(visual.geometry):
                across = pose[:3, :3] @ normal
                if across @ towards > 0.0:
                    shade = _AMBIENT + (1.0 - _AMBIENT) * max(float(across @ light), 0.0)
                    red, green, blue = (colour * shade).tolist()
                    found.append((corners @ pose[:3, :3].T + pose[:3, 3], (red, green, blue)))
    return found


@functools.lru_cache(maxsize=256)
def _with_normals(geometry: Geometry) -> tuple[tuple[Array, Array], ...]:
    """The faces of a shape, and the direction that each looks to."""
    found = []
    for corners in _polygons(geometry):
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
        found.append((corners, normal / np.linalg.norm(normal)))
    return tuple(found)


def _polygons(geometry: Geometry) -> Iterator[Array]:
    """Faces of a primitive, counter-clockwise from outside; a mesh file has none."""
    if geometry.kind == "box":
        half = 0.5 * np.array(geometry.size)
        for axis in range(3):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            for side in (1.0, -1.0):
                corners = np.zeros((4, 3))
                corners[:, axis] = side
                corners[:, a] = np.array([-1.0, 1.0, 1.0, -1.0]) * side
                corners[:, b] = [-1.0, -1.0, 1.0, 1.0]
                yield corners * half
    elif geometry.kind == "cylinder":
        radius, length = geometry.size
        yield from _turned([(0.0, 0.5 * length), (radius, 0.5 * length), (radius, -0.5 * length), (0.0, -0.5 * length)])
    elif geometry.kind == "sphere":
        angles = np.linspace(0.0, np.pi, _SIDES // 2 + 1)
        radius = geometry.size[0]
        yield from _turned([(radius * np.sin(a), radius * np.cos(a)) for a in angles])


def _turned(profile: Sequence[tuple[float, float]]) -> Iterator[Array]:
    """Faces of the body that a profile of (radius, z) makes about z, from its upper end to its lower one."""
    turn = 2.0 * np.pi * np.arange(_SIDES + 1) / _SIDES
    rings = [np.stack([r * np.cos(turn), r * np.sin(turn), np.full(turn.size, z)], axis=-1) for r, z in profile]
    pairs = zip(itertools.pairwise(rings), itertools.pairwise(profile), strict=True)
    for (above, below), (top, bottom) in pairs:
        if top[1] == bottom[1]:
            # A flat end is one face.
            yield below[:-1] if top[0] < bottom[0] else above[:-1][::-1]
            continue
        for k in range(_SIDES):
            corners = [above[k], below[k], below[k + 1], above[k + 1]]
            apart = [
                corner for n, corner in enumerate(corners) if np.abs(corner - corners[n - 1]).max() > 1e-12 or n == 0
            ]
            yield np.array(apart)
