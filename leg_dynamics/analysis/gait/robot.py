"""A robot as its gait sees it: a trunk on N legs, each a leg with its place and its mirror image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.description.model import Description
from leg_dynamics.errors import DescriptionError, ShapeError, TrajectoryError

__all__ = ["GaitLeg", "Limb", "Robot"]

GRAVITY = 9.81
"""m/s²."""

_ORTHOGONAL = 1e-9


class GaitLeg(Protocol):
    """What a gait needs of a leg: every `leg_dynamics.leg.Leg` with a foot and three coordinates has it."""

    @property
    def joint_names(self) -> Sequence[str]:
        """The n independent coordinates."""
        ...

    @property
    def limits(self) -> Any:
        """With `lower`, `upper`, `velocity`, `effort` and, where it is not -effort, `effort_lower`, each (n,)."""
        ...

    def foot_position(self, q: Any) -> Any:
        """Foot position in the hip frame, (..., 3)."""
        ...

    def inverse_kinematics(self, p: Any, branch: str | None = None, limits: Any = "error") -> Any:
        """Coordinates that put the foot there, (..., n)."""
        ...

    def jacobian(self, q: Any) -> Any:
        """Foot Jacobian, (..., 3, n)."""
        ...

    def jacobian_derivative(self, q: Any, v: Any) -> Any:
        """Its time derivative, (..., 3, n)."""
        ...

    def torque(self, q: Any, v: Any, a: Any, foot_force: Any = None, gravity: Any = None) -> Any:
        """Actuator efforts, (..., m)."""
        ...


@dataclass(frozen=True, eq=False)
class Limb:
    """One leg of a robot.

    A point p of the leg's model, in its hip frame, is ``hip[:3, :3] @ (mirror * p) + hip[:3, 3]`` in the body frame.
    Lengths of vectors, and so power, are the same on both sides; coordinates of the model and of the robot's file
    differ by a sign where a mirrored joint turns the other way.

    Parameters
    ----------
    name : str
    leg : GaitLeg
        Model of the leg.
    hip : array_like, shape (4, 4)
        Pose of the hip frame in the body frame, m.
    home : array_like, shape (3,)
        The foot's neutral position in the body frame, m: where it stands in the middle of its stance.
    mirror : tuple of three signs
        (1, 1, 1), or -1 for the axis of the hip frame that is turned around.
    joints : mapping of str to (str, float)
        To each joint of the robot's file the joint of the leg's file and the sign between both coordinates; empty for
        a limb without a file.
    prefix : str
        Stands before the leg's names in the robot's file.
    """

    name: str
    leg: Any
    hip: NDArray[np.float64]
    home: NDArray[np.float64]
    mirror: tuple[float, float, float] = (1.0, 1.0, 1.0)
    joints: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    prefix: str = ""

    def __post_init__(self) -> None:
        arguments.text("the name of a limb", self.name)
        needed = ("joint_names", "limits", "foot_position", "inverse_kinematics", "jacobian", "jacobian_derivative")
        arguments.having("leg", self.leg, (*needed, "torque"), "load one with leg_dynamics.load")
        hip = arguments.reals("hip pose", self.hip)
        if hip.shape != (4, 4) or not np.allclose(hip[3], (0.0, 0.0, 0.0, 1.0)):
            raise ShapeError(f"the hip pose of {self.name!r} must be a homogeneous transform, shape (4, 4)")
        R = hip[:3, :3]
        if not (np.isfinite(hip).all() and np.abs(R.T @ R - np.eye(3)).max() < _ORTHOGONAL and np.linalg.det(R) > 0.0):
            raise ShapeError(f"the hip pose of {self.name!r} has no rotation matrix; mirror images go into `mirror`")
        mirror = arguments.vector("mirror", self.mirror, 3)
        if not (np.abs(mirror) == 1.0).all() or (mirror < 0.0).sum() > 1:
            raise ShapeError(f"mirror holds three signs, at most one of them -1, but is {mirror.tolist()}")
        home = arguments.vector("home", self.home, 3, "m")
        for array in (hip, home):
            array.setflags(write=False)
        object.__setattr__(self, "hip", hip)
        object.__setattr__(self, "home", home)
        object.__setattr__(self, "mirror", tuple(mirror.tolist()))
        object.__setattr__(self, "joints", MappingProxyType(dict(self.joints)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Limb, (self.name, self.leg, self.hip, self.home, self.mirror, dict(self.joints), self.prefix)

    def __repr__(self) -> str:
        x, y, z = self.hip[:3, 3]
        image = "" if min(self.mirror) > 0.0 else f", mirrored in {'xyz'[int(np.argmin(self.mirror))]}"
        return f"<Limb {self.name!r}: {getattr(self.leg, 'name', 'leg')} at ({x:g}, {y:g}, {z:g}){image}>"

    @property
    def axes(self) -> NDArray[np.float64]:
        """Orthogonal matrix from vectors of the model's hip frame to those of the body, mirror included, (3, 3)."""
        return self.hip[:3, :3] * np.array(self.mirror)

    def to_leg(self, point: ArrayLike) -> NDArray[np.float64]:
        """A point of the body frame in the model's hip frame, m, shape (..., 3)."""
        return self.vector_to_leg(np.asarray(point, dtype=float) - self.hip[:3, 3])

    def vector_to_leg(self, vector: ArrayLike) -> NDArray[np.float64]:
        """A velocity, acceleration, force or gravity of the body frame in the model's hip frame, shape (..., 3)."""
        return np.asarray(vector, dtype=float) @ self.axes

    def to_body(self, point: ArrayLike) -> NDArray[np.float64]:
        """A point of the model's hip frame in the body frame, m, shape (..., 3)."""
        return self.vector_to_body(point) + self.hip[:3, 3]

    def vector_to_body(self, vector: ArrayLike) -> NDArray[np.float64]:
        """A vector of the model's hip frame in the body frame, shape (..., 3)."""
        return np.asarray(vector, dtype=float) @ self.axes.T

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The leg's independent coordinates by their names in the robot's file; without one, after the limb's name."""
        return tuple(map(self._named, self.leg.joint_names))

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """The leg's actuators, likewise."""
        return tuple(map(self._named, getattr(self.leg, "actuator_names", self.leg.joint_names)))

    def _named(self, own: str) -> str:
        """A name of the leg's file in the robot's."""
        if self.prefix:
            return self.prefix + own
        return next((joint for joint, (model, _) in self.joints.items() if model == own), f"{self.name}_{own}")

    @property
    def signs(self) -> NDArray[np.float64]:
        """Coordinate of the robot's file over coordinate of the model, for the independent coordinates, (n,)."""
        by_name = dict(self.joints.values())
        return np.array([by_name.get(name, 1.0) for name in self.leg.joint_names])

    def assemble(self, q: ArrayLike) -> dict[str, NDArray[np.float64]]:
        """Coordinates of this limb's joints in the robot's file for coordinates q (..., n) of the model."""
        values = self.leg.assemble(q)
        return {joint: sign * values[own] for joint, (own, sign) in self.joints.items()}

    def moving_mass(self, q: ArrayLike) -> tuple[float, NDArray[np.float64]]:
        """Mass of the leg's moving links, kg, and their first moment in the body frame, kg m, (..., 3).

        Zero for a leg without a file.
        """
        q = np.asarray(q, dtype=float)
        mechanism: Description | None = getattr(self.leg, "description", None)
        if mechanism is None:
            return 0.0, np.zeros((*q.shape[:-1], 3))
        from leg_dynamics.description import link_transforms

        transforms = link_transforms(mechanism, self.leg.assemble(q))
        hip = transforms[hip_link(mechanism)]
        into_hip = np.linalg.inv(hip)
        total, moment = 0.0, np.zeros((*q.shape[:-1], 3))
        for name in moving_links(mechanism, hip_link(mechanism)):
            inertial = mechanism.link(name).inertial
            if inertial is not None:
                place = into_hip @ transforms[name]
                centre = place[..., :3, :3] @ np.array(inertial.origin.xyz) + place[..., :3, 3]
                total += inertial.mass
                moment = moment + inertial.mass * self.to_body(centre)
        return total, moment


@dataclass(frozen=True, eq=False)
class Robot:
    """A trunk with N legs.

    The body frame is the root frame of the robot's file: x ahead, y to the left, z up (REP 103).

    Parameters
    ----------
    name : str
    limbs : sequence of Limb
        In the file's order; the axis of legs of every array.
    trunk_mass : float
        kg; everything that does not move with a leg.
    trunk_com : array_like, shape (3,)
        Its centre of mass in the body frame, m.
    gravity : array_like, shape (3,)
        In the level body frame, m/s².
    description : Description, optional
        The robot's file, for its picture.
    """

    name: str
    limbs: tuple[Limb, ...]
    trunk_mass: float = 0.0
    trunk_com: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    gravity: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, -GRAVITY]))
    description: Description | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "limbs", tuple(self.limbs))
        if not self.limbs:
            raise TrajectoryError(f"the robot {self.name!r} has no leg to walk on")
        for limb in self.limbs:
            arguments.kind("a limb", limb, Limb)
        names = [limb.name for limb in self.limbs]
        if len(set(names)) < len(names):
            raise TrajectoryError(f"two legs of {self.name!r} have the same name: {', '.join(names)}")
        object.__setattr__(self, "trunk_mass", arguments.tolerance("mass of the trunk", self.trunk_mass))
        for what in ("trunk_com", "gravity"):
            array = arguments.vector(what, getattr(self, what), 3)
            array.setflags(write=False)
            object.__setattr__(self, what, array)

    def __reduce__(self) -> tuple[Any, ...]:
        values = (self.name, self.limbs, self.trunk_mass, self.trunk_com, self.gravity, self.description)
        return Robot, values

    def __repr__(self) -> str:
        return f"<Robot {self.name!r}: {len(self)} legs ({', '.join(self.leg_names)}), trunk {self.trunk_mass:g} kg>"

    def __len__(self) -> int:
        return len(self.limbs)

    @property
    def leg_names(self) -> tuple[str, ...]:
        """Names of the legs, in order."""
        return tuple(limb.name for limb in self.limbs)

    @property
    def homes(self) -> NDArray[np.float64]:
        """Neutral foot positions in the body frame, m, (N, 3)."""
        return np.array([limb.home for limb in self.limbs])

    def limb(self, name: str) -> Limb:
        """The leg of that name; TrajectoryError where there is none."""
        for limb in self.limbs:
            if limb.name == name:
                return limb
        raise TrajectoryError(f"{self.name!r} has no leg {name!r}; its legs are {', '.join(self.leg_names)}")

    def centre_of_mass(self, q: Sequence[ArrayLike]) -> tuple[float, NDArray[np.float64]]:
        """Mass, kg, and centre of mass in the body frame, m, (T, 3), with every moving link where it is.

        Parameters
        ----------
        q : sequence of N array_like, shape (T, n)
            Coordinates of the legs' models.

        Raises
        ------
        DescriptionError
            The robot has no mass.
        """
        total, moment = self.trunk_mass, self.trunk_mass * self.trunk_com
        for limb, values in zip(self.limbs, q, strict=True):
            mass, first = limb.moving_mass(values)
            total, moment = total + mass, moment + first
        if total <= 0.0:
            raise DescriptionError(f"{self.name!r} has no mass: give its trunk or its legs one")
        samples = np.asarray(q[0]).shape[:-1]
        return total, np.broadcast_to(moment / total, (*samples, 3)).copy()


def hip_link(mechanism: Description) -> str:
    """The link whose frame a leg's foot is measured in."""
    return "hip" if mechanism.has_link("hip") else mechanism.root


def moving_links(mechanism: Description, hip: str) -> list[str]:
    """Links that move against the hip, in file order."""
    moving = []
    for link in mechanism.links:
        path = mechanism.path(link.name)
        below = [joint.parent for joint in path].index(hip) if any(joint.parent == hip for joint in path) else None
        if below is not None and any(joint.type != "fixed" for joint in path[below:]):
            moving.append(link.name)
    return moving
