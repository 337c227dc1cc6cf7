"""What verdicts on any leg rest on: its mechanism assembled from its file, and formulas' tuples made into arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from leg_dynamics.description import link_transforms
from leg_dynamics.leg import Leg
from leg_dynamics.verification.first_principles import gradient

__all__ = ["Assembled", "array"]

Array = np.ndarray


class Assembled:
    """The mechanism of a leg's file, assembled numerically at states q (N, 3), seen from the hip frame.

    Velocities are influence coefficients (N, 3, 3): the last axis is the independent coordinate.
    """

    def __init__(self, leg: Leg, q: Array) -> None:
        self.leg = leg
        self.q = q
        self.coordinates = leg.assemble(q)
        self.links = self._links(q)
        self.rates = {name: np.asarray(rate) for name, rate in self._rates(q).items()}

    def _links(self, q: Array) -> dict[str, Array]:
        links = link_transforms(self.leg.description, self.leg.assemble(q))
        to_hip = np.linalg.inv(links["hip"])
        return {name: to_hip @ pose for name, pose in links.items()}

    def _rates(self, q: Array) -> dict[str, Array]:
        names = list(self.links)

        def poses(q: Array) -> Array:
            links = self._links(q)
            shape = (*q.shape[:-1], 4, 4)
            return np.stack([np.broadcast_to(links[name], shape) for name in names], axis=-3)

        return dict(zip(names, np.moveaxis(gradient(poses, q), -4, 0), strict=True))

    def rotation(self, link: str) -> Array:
        """Rotation of a link, (N, 3, 3)."""
        return np.broadcast_to(self.links[link], (len(self.q), 4, 4))[:, :3, :3]

    def position(self, link: str, point: Any = (0.0, 0.0, 0.0)) -> Array:
        """Position of a point of a link, (N, 3) m."""
        pose = np.broadcast_to(self.links[link], (len(self.q), 4, 4))
        return pose[:, :3, :3] @ np.asarray(point, dtype=float) + pose[:, :3, 3]

    def velocity(self, link: str, point: Any = (0.0, 0.0, 0.0)) -> Array:
        """Velocity of a point of a link for unit rates, m/rad."""
        return np.einsum("nijk,j->nik", self.rates[link][:, :3], np.append(np.asarray(point, dtype=float), 1.0))

    def omega(self, link: str) -> Array:
        """Angular velocity of a link for unit rates."""
        spin = np.einsum("nijk,nlj->nilk", self.rates[link][:, :3, :3], self.rotation(link))
        return np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)

    def angle(self, joint: str) -> Array:
        """Coordinate of a tree joint, (N,) rad."""
        return self.coordinates[joint]

    def axis(self, joint: str, q: Array | None = None) -> Array:
        """Direction of a joint's axis, tree or loop, (N, 3); at states `q` instead where given."""
        description = self.leg.description
        links = self.links if q is None else self._links(q)
        for loop in description.loops:
            if loop.name == joint:
                direction = loop.predecessor.origin.matrix()[:3, :3] @ np.asarray(loop.axis)
                return links[loop.predecessor.link][..., :3, :3] @ direction
        found = description.joint(joint)
        return links[found.child][..., :3, :3] @ np.asarray(found.axis)

    def point(self, joint: str, q: Array) -> Array:
        """A point on a joint's axis, tree or loop, at states `q`, (N, 3)."""
        links = self._links(q)
        for loop in self.leg.description.loops:
            if loop.name == joint:
                pose = links[loop.predecessor.link] @ loop.predecessor.origin.matrix()
                return pose[..., :3, 3]
        return links[self.leg.description.joint(joint).child][..., :3, 3]


def array(value: Any, shape: tuple[int, ...]) -> Array:
    """Nested tuples of scalars as an array with the sample axes `shape` first."""
    if isinstance(value, tuple):
        return np.stack([array(part, shape) for part in value], axis=len(shape))
    return np.broadcast_to(np.asarray(value, dtype=float), shape)
