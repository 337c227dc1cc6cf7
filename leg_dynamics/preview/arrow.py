"""The arrow of the force on the foot: its length follows the force, and it vanishes with it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.description.model import Description
from leg_dynamics.errors import ShapeError
from leg_dynamics.preview.commands import Y_TO_Z, Colour, clip, load_meshcat, set_object, set_property, set_transform

__all__ = ["ARROW_COLOUR", "Arrow", "in_root_frame"]

ARROW_COLOUR: Colour = (0.0, 0.42, 0.26, 1.0)

_NODE = "/leg/foot force"
_GHOST_OPACITY = 0.35
_LONGEST = 0.75
"""Of the scene's radius."""
_ZERO = 1e-9
"""Of the largest force: less than this is none."""


def in_root_frame(
    description: Description,
    vectors: ArrayLike,
    frame: str | None = None,
    joint_values: Mapping[str, ArrayLike] | None = None,
) -> np.ndarray:
    """Turn vectors, such as a leg's `foot_force`, from a link's axes into the root frame's.

    Parameters
    ----------
    description : Description
        The mechanism.
    vectors : array_like, shape (..., 3)
        Components along the axes of `frame`.
    frame : str, optional
        A link; ``hip`` where there is one, else the root itself, which is where a leg's foot force lives.
    joint_values : mapping of str to array_like, shape (...,), optional
        Tree joint coordinates, rad or m, where `frame` is a link that moves.

    Returns
    -------
    numpy.ndarray, shape (..., 3)

    Raises
    ------
    ShapeError
        The vectors have no three components.
    DescriptionError
        There is no link `frame`.
    """
    from leg_dynamics.description import link_transforms

    vectors = np.asarray(vectors, dtype=float)
    if vectors.shape[-1:] != (3,):
        raise ShapeError(f"vectors has shape {vectors.shape}; give three components each, shape (..., 3)")
    if frame is None:
        frame = "hip" if description.has_link("hip") else description.root
    description.link(frame)
    rotation = np.asarray(link_transforms(description, joint_values or {})[frame])[..., :3, :3]
    return np.einsum("...ij,...j->...i", rotation, vectors)


@dataclass(frozen=True, slots=True)
class Arrow:
    """The force on the foot over the frames of a scene.

    Attributes
    ----------
    tails, forces : numpy.ndarray, shape (frames, 3)
        Foot positions, m, and forces, N, in the root frame.
    newtons_per_cell : float
        Force that is drawn as long as a cell of the ground grid.
    cell : float
        Side of a cell of the ground grid, m.
    radius : float
        Of the scene, m: sets the arrow's thickness.
    """

    tails: np.ndarray
    forces: np.ndarray
    newtons_per_cell: float
    cell: float
    radius: float

    @classmethod
    def of(cls, tails: np.ndarray, forces: np.ndarray, cell: float, radius: float) -> Arrow:
        """An arrow whose longest length is well seen in a scene of this radius, at a round scale."""
        largest = float(np.linalg.norm(forces, axis=-1).max())
        needed = largest * cell / (_LONGEST * radius)
        if needed <= 0.0:
            return cls(tails, forces, 1.0, cell, radius)
        decade = 10.0 ** math.floor(math.log10(needed))
        rounded = next(
            step * decade for step in (1.0, 1.5, 2.0, 3.0, 5.0, 10.0) if step * decade >= needed * (1.0 - 1e-9)
        )
        return cls(tails, forces, rounded, cell, radius)

    @property
    def magnitudes(self) -> np.ndarray:
        """N, shape (frames,)."""
        return np.linalg.norm(self.forces, axis=-1)

    @property
    def tips(self) -> np.ndarray:
        """Ends of the arrow in the root frame, m, shape (frames, 3)."""
        return self.tails + self.forces * self.cell / self.newtons_per_cell

    def commands(self) -> Iterator[dict[str, Any]]:
        """The arrow of the first frame; nothing where the force is always zero."""
        if not self._shown.any():
            return
        primitives = load_meshcat().geometry
        thickness = 0.020 * self.radius
        shaft, head = self._parts()
        rotation, position, visible = self._turns()[0], self.tails[0], bool(self._shown[0])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, position
        yield set_transform(_NODE, pose)
        # A pale second arrow shines through whatever stands before the first one.
        for node, opacity in (("solid", 1.0), ("ghost", _GHOST_OPACITY)):
            rgba = (*ARROW_COLOUR[:3], opacity)
            cylinder = primitives.Cylinder(height=1.0, radius=thickness)
            cone = primitives.Cylinder(height=1.0, radiusTop=0.0, radiusBottom=2.4 * thickness)
            half_up = Y_TO_Z.copy()
            half_up[2, 3] = 0.5
            for part, geometry in (("shaft", cylinder), ("head", cone)):
                path = f"{_NODE}/{part}/{node}"
                drawn = set_object(path, geometry, rgba)
                if node == "ghost":
                    drawn["object"]["materials"][0] |= {"depthTest": False, "depthWrite": False, "side": 0}
                    drawn["object"]["object"]["renderOrder"] = 1
                yield drawn
                yield set_transform(path, half_up)
        yield set_transform(f"{_NODE}/shaft", np.diag([1.0, 1.0, shaft[0], 1.0]))
        scale = np.diag([head[0, 1], head[0, 1], head[0, 2], 1.0])
        scale[2, 3] = head[0, 0]
        yield set_transform(f"{_NODE}/head", scale)
        yield set_property(_NODE, "visible", visible)

    def clips(self, rate: float) -> dict[str, Any]:
        """Keyframes of the arrow's nodes, by viewer path."""
        from scipy.spatial.transform import Rotation

        if len(self.tails) == 1 or not self._shown.any():
            return {}
        shaft, head = self._parts()
        ones = np.ones_like(shaft)
        quaternions = Rotation.from_matrix(self._turns()).as_quat()
        return {
            _NODE: clip(
                rate,
                position=("vector3", self.tails.tolist()),
                quaternion=("quaternion", quaternions.tolist()),
                visible=("bool", self._shown.tolist()),
            ),
            f"{_NODE}/shaft": clip(rate, scale=("vector3", np.stack([ones, ones, shaft], axis=-1).tolist())),
            f"{_NODE}/head": clip(
                rate,
                position=("vector3", np.stack([0.0 * shaft, 0.0 * shaft, head[:, 0]], axis=-1).tolist()),
                scale=("vector3", head[:, [1, 1, 2]].tolist()),
            ),
        }

    @property
    def _shown(self) -> np.ndarray:
        return self.magnitudes > _ZERO * self.magnitudes.max()

    def _parts(self) -> tuple[np.ndarray, np.ndarray]:
        """Length of the shaft, shape (frames,); start, width (as a share) and length of the head, (frames, 3)."""
        full = 0.13 * self.radius
        # Never quite zero: a flat shape has no normals.
        length = np.maximum(self.magnitudes * self.cell / self.newtons_per_cell, 1e-4 * self.radius)
        head = np.minimum(full, 0.6 * length)
        return length - head, np.stack([length - head, np.maximum(head / full, 0.05), head], axis=-1)

    def _turns(self) -> np.ndarray:
        """Rotations (frames, 3, 3) whose z is the force's direction; kept from its neighbour where there is none."""
        shown = np.flatnonzero(self._shown)
        nearest = shown[np.clip(np.searchsorted(shown, np.arange(len(self.forces)), side="right") - 1, 0, None)]
        z = self.forces[nearest] / self.magnitudes[nearest, None]
        turns = np.empty((len(z), 3, 3))
        x = np.eye(3)[np.argmin(np.abs(z[0]))]
        for k, direction in enumerate(z):
            x = x - (x @ direction) * direction
            if np.linalg.norm(x) < 1e-3:
                x = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
            x = x / np.linalg.norm(x)
            turns[k] = np.stack([x, np.cross(direction, x), direction], axis=-1)
        return turns
