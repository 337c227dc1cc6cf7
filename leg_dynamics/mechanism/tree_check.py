"""Whether pinocchio's tree is the description's: joint placements, masses and inertias, computed from the numbers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from leg_dynamics.description.model import Description, Inertial, Joint
from leg_dynamics.description.topology import joints_depth_first
from leg_dynamics.errors import DescriptionError

__all__ = ["check_tree"]

# Of the sum of magnitudes: a thousand fixed joints in a row round to a hundredth of it.
TOLERANCE = 1e-10


@dataclass
class _Carried:
    """What a moving joint carries, links on fixed joints included: moments about the joint's own origin.

    Mass (kg), its first moment (kg·m) and the inertia (kg·m²); `sizes` are the sums of their magnitudes, which rounding
    is relative to.
    """

    mass: float = 0.0
    moment: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    sizes: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def add(self, body: Inertial, transform: np.ndarray, scale: float) -> None:
        """Add a link that lies so in the joint's frame, at the end of joints as long as `scale` together, m."""
        rotation = transform[:3, :3] @ body.origin.rotation()
        centre = transform[:3, :3] @ np.array(body.origin.xyz) + transform[:3, 3]
        own = rotation @ body.tensor() @ rotation.T
        self.mass += body.mass
        self.moment += body.mass * centre
        self.inertia += own + _about_origin(body.mass, centre)
        reach = scale + float(np.abs(body.origin.xyz).sum())
        self.sizes += (body.mass, body.mass * reach, np.abs(own).sum() + body.mass * reach**2)


def _about_origin(mass: float, centre: np.ndarray) -> np.ndarray:
    """Inertia of a point mass about the origin, shape (3, 3)."""
    inertia: np.ndarray = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return inertia


def check_tree(model: pin.Model, description: Description) -> None:
    """Compare a model that pinocchio read with the description it was written from.

    Parameters
    ----------
    model : pinocchio.Model
        With the description's moving joints, by name.
    description : Description

    Raises
    ------
    DescriptionError
        A joint's placement, or the mass, centre or inertia that it carries, is another one; with file and line.
    """
    carried: dict[str, _Carried] = {}
    # Of each link: the moving joint that carries it, its pose in that joint's frame, and the lengths that add up to it.
    places: dict[str, tuple[str | None, np.ndarray, float]] = {description.root: (None, np.eye(4), 0.0)}
    for joint in joints_depth_first(description):
        carrier, transform, scale = places[joint.parent]
        transform = transform @ joint.origin.matrix()
        scale += float(np.abs(joint.origin.xyz).sum())
        if joint.type != "fixed":
            _check_placement(model, joint, transform, scale, description.file)
            carrier, transform, scale = joint.name, np.eye(4), 0.0
            carried[carrier] = _Carried()
        places[joint.child] = carrier, transform, scale
        body = description.link(joint.child).inertial
        if carrier is not None and body is not None:
            carried[carrier].add(body, transform, scale)
    for name, own in carried.items():
        _check_carried(model.inertias[model.getJointId(name)], own, description.joint(name), description.file)


def _check_placement(model: pin.Model, joint: Joint, expected: np.ndarray, scale: float, file: str) -> None:
    found = model.jointPlacements[model.getJointId(joint.name)]
    turned = np.abs(found.rotation - expected[:3, :3]).max()
    moved = np.abs(found.translation - expected[:3, 3]).max()
    # Not `>`: NaN is no agreement.
    if not (turned <= TOLERANCE and moved <= TOLERANCE * scale):
        raise _other(joint, f"places it {moved:.3g} m and {turned:.3g} (entries of the rotation) from", file)


def _check_carried(found: pin.Inertia, expected: _Carried, joint: Joint, file: str) -> None:
    mass, centre = found.mass, found.lever
    about_origin = found.inertia + _about_origin(mass, centre)
    pairs = (
        ("mass", "kg", mass, expected.mass),
        ("first moment of mass", "kg·m", mass * centre, expected.moment),
        ("inertia", "kg·m²", about_origin, expected.inertia),
    )
    for (what, unit, one, other), size in zip(pairs, expected.sizes, strict=True):
        error = np.abs(one - other).max()
        if not error <= TOLERANCE * size:
            raise _other(joint, f"gives it a {what} that differs by {error:.3g} {unit} from", file)


def _other(joint: Joint, problem: str, file: str) -> DescriptionError:
    return DescriptionError(
        f"pinocchio reads joint {joint.name!r} otherwise than the file says: it {problem} the file's; use "
        "route='symbolic', which does not read through pinocchio, and report this",
        file=file,
        line=joint.line,
        joint=joint.name,
    )
