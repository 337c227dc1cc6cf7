"""The viewer commands that a scene is made of, as meshcat's own `commands` classes lower them."""

from __future__ import annotations

import functools
import uuid
import warnings
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np

__all__ = ["Y_TO_Z", "Colour", "clip", "load_meshcat", "set_object", "set_property", "set_transform", "viewer_path"]

Colour = tuple[float, float, float, float]

Y_TO_Z = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""three.js cylinders stand along y, URDF's along z."""


def set_object(path: str, geometry: Any, rgba: Colour, line: bool = False) -> dict[str, Any]:
    """Draw a meshcat geometry at a viewer path: a solid, or pairs of points joined by lines."""
    meshcat = load_meshcat()
    red, green, blue, opacity = (min(max(channel, 0.0), 1.0) for channel in rgba)
    colour = (round(255 * red) << 16) + (round(255 * green) << 8) + round(255 * blue)
    shown, painted = (
        (meshcat.geometry.LineSegments, meshcat.geometry.LineBasicMaterial)
        if line
        else (meshcat.geometry.Mesh, meshcat.geometry.MeshPhongMaterial)
    )
    material = painted(color=colour, opacity=opacity)
    drawn = shown(geometry, material)
    # meshcat draws its identifiers from the clock and the network card: two equal scenes would differ.
    for kind, element in (("geometry", geometry), ("material", material), ("object", drawn)):
        element.uuid = str(uuid.uuid5(uuid.NAMESPACE_URL, f"{kind}:{path}"))
    return meshcat.commands.SetObject(drawn, path=viewer_path(path)).lower()


def viewer_path(path: str) -> Any:
    """meshcat's form of a viewer path such as ``/leg/links/foot``."""
    return load_meshcat().path.Path(tuple(path.strip("/").split("/")))


def set_transform(path: str, matrix: np.ndarray) -> dict[str, Any]:
    """Place a viewer node in its parent by a homogeneous transform, shape (4, 4)."""
    return load_meshcat().commands.SetTransform(matrix, viewer_path(path)).lower()


def set_property(path: str, name: str, value: Any) -> dict[str, Any]:
    """Set a property of a viewer node, by the name that three.js gives it."""
    # meshcat's SetProperty spells property names in lower case, which castShadow is not.
    return {"type": "set_property", "path": path, "property": name, "value": value}


def clip(rate: float, **tracks: tuple[str, Sequence[Any]]) -> Any:
    """Keyframes of one viewer node, one a frame: of each property its three.js track type and its values."""
    animation = load_meshcat().animation
    return animation.AnimationClip(
        {
            name: animation.AnimationTrack(name.replace("__", "."), kind, list(range(len(values))), list(values))
            for name, (kind, values) in tracks.items()
        },
        fps=rate,
    )


@functools.cache
def load_meshcat() -> ModuleType:
    """The meshcat package, without the deprecation warning that its import of pyzmq raises."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import meshcat
    return meshcat
