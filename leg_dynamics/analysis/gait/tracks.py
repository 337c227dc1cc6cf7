"""Body and feet seen from the world: places, velocities, and how fast the foot's link turns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis.gait.robot import Limb, hip_link
from leg_dynamics.analysis.gait.study import GaitStudy
from leg_dynamics.analysis.trajectories import Trajectory
from leg_dynamics.description import link_transforms
from leg_dynamics.description.model import Description

__all__ = ["Tracks", "tracks"]

Array = NDArray[np.float64]

_STEP = 1e-5
"""Change of coordinates, rad or m, over which rates of passive joints are taken."""


class Tracks(NamedTuple):
    """Motion over the ground at T times, world axes; the carrier starts at the origin and looks along x."""

    body: Array
    """Origin of the body frame, m, (T, 3)."""
    body_velocity: Array
    """m/s, (T, 3)."""
    com: Array
    """Centre of mass, m, (T, 3)."""
    feet: Array
    """m, (T, N, 3)."""
    foot_velocity: Array
    """m/s, (T, N, 3)."""
    foot_spin: Array
    """Angular velocity of the link that bears the foot, rad/s, (T, N, 3); NaN for a leg without a file."""

    @property
    def foot_speed(self) -> Array:
        """m/s, (T, N)."""
        return np.asarray(np.linalg.norm(self.foot_velocity, axis=-1))

    @property
    def foot_turn_rate(self) -> Array:
        """Magnitude of `foot_spin`, rad/s, (T, N)."""
        return np.asarray(np.linalg.norm(self.foot_spin, axis=-1))


def tracks(study: GaitStudy) -> Tracks:
    """Body, centre of mass and feet of a study, seen from the world."""
    walk, time, body = study.walk, study.time, study.body
    spin = np.stack([_spin(motion.limb, motion.trajectory) for motion in study.limbs], axis=1)
    level = body.level(spin + body.spin[:, None, :])
    turned = walk.twist.turned(walk.cycles(time) * walk.period)
    plane = np.einsum("tij,tnj->tni", turned, level[..., :2])
    return Tracks(
        body.position,
        walk.body_velocity(time),
        walk.in_world(time, study.com[:, None, :])[:, 0],
        walk.in_world(time, study.feet.position),
        walk.foot_velocity(time),
        np.concatenate([plane, level[..., 2:]], axis=-1),
    )


def _spin(limb: Limb, motion: Trajectory) -> Array:
    """Angular velocity of the foot's link against the body, in body axes, rad/s, (T, 3)."""
    mechanism: Description | None = getattr(limb.leg, "description", None)
    foot: Any = getattr(limb.leg, "foot", None)
    q, v = motion.q, motion.v
    if mechanism is None or foot is None:
        return np.full((len(q), 3), np.nan)
    transforms = link_transforms(mechanism, limb.leg.assemble(q))
    h = _STEP / max(float(np.abs(v).max()), 1e-12)
    before, after = limb.leg.assemble(q - h * v), limb.leg.assemble(q + h * v)
    hip = hip_link(mechanism)
    found = np.zeros((len(q), 3))
    for joint in mechanism.path(foot):
        if joint.type in ("revolute", "continuous") and joint.name in after:
            rate = (after[joint.name] - before[joint.name]) / (2.0 * h)
            # The axis is the same before and behind the joint.
            found += (transforms[joint.child][..., :3, :3] @ np.array(joint.axis)) * rate[:, None]
    into_hip = np.swapaxes(np.broadcast_to(transforms[hip], (len(q), 4, 4))[:, :3, :3], -1, -2)
    in_hip = np.einsum("tij,tj->ti", into_hip, found)
    # A mirror image turns the other way round the image of the axis.
    return np.asarray(np.prod(limb.mirror) * limb.vector_to_body(in_hip))
