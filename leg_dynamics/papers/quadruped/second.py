"""Second calculations of the walk: by the robot's file of ten modules, by convex hulls, and by random sways."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.description import link_transforms
from leg_dynamics.papers.framework import Check, Context
from leg_dynamics.papers.judge import worst
from leg_dynamics.papers.quadruped import reported
from leg_dynamics.papers.quadruped.facts import robot_file
from leg_dynamics.papers.quadruped.stability import round_the_body, swayed
from leg_dynamics.papers.quadruped.walking import (
    DUTY,
    SWAY_BOUND,
    SWAYED_DUTY,
    best_sway,
    margins_of,
    robot_of,
    sampled_bounds,
    walk_of,
)

if TYPE_CHECKING:
    from leg_dynamics.analysis.gait import GaitStudy

__all__ = ["CHECKS", "file_centre", "hull_margin"]

Array = np.ndarray

TRIALS = 200
"""Random sways."""


def _poses(context: Context, result: GaitStudy) -> dict[str, Array]:
    """Links of the robot's file along the walk, in the body."""
    found: dict[str, Array] = context.once(
        "quadruped: links of the walk", lambda: link_transforms(robot_file(context), result.joint_values())
    )
    return found


def file_centre(context: Context, result: GaitStudy) -> Array:
    """Centre of mass of all links of the robot's file in the body, (T, 3) m."""
    links = _poses(context, result)
    mass, moment = 0.0, np.zeros((len(result.time), 3))
    for link in robot_file(context).links:
        if link.inertial is not None:
            pose = links[link.name]
            mass += link.inertial.mass
            moment = moment + link.inertial.mass * (
                pose[..., :3, :3] @ np.array(link.inertial.origin.xyz) + pose[..., :3, 3]
            )
    return moment / mass


def hull_margin(feet: Array, point: Array) -> float:
    """Distance of a point to the edges of the convex hull of feet (N, 2), negative outside, m."""
    from scipy.spatial import ConvexHull

    normals = ConvexHull(feet).equations
    return -float((normals[:, :2] @ point + normals[:, 2]).max())


def feet_stand(context: Context) -> Check:
    """Standing feet of the robot's file do not move."""
    result = swayed(context)
    links, off = _poses(context, result), 0.0
    for k, limb in enumerate(robot_of(context).limbs):
        place = np.broadcast_to(links[f"{limb.name}_foot"], (len(result.time), 4, 4))[:, :3, 3] + result.body.position
        standing = result.stance[:, k]
        for stand in np.split(np.flatnonzero(standing), np.flatnonzero(np.diff(np.flatnonzero(standing)) > 1) + 1):
            off = max(off, worst(place[stand] - place[stand[0]]))
    return Check(
        "standing feet do not slip",
        off,
        1e-9,
        "m",
        f"feet of the robot's file of ten modules in the world, walk with sway, {len(result.time)} instants",
    )


def centre_agrees(context: Context) -> Check:
    """The centre of mass two ways."""
    result = swayed(context)
    return Check(
        "centre of mass, two ways",
        worst(file_centre(context, result) - result.com),
        1e-9,
        "m",
        f"gait engine's legs and trunk against all links of the robot's file, {len(result.time)} instants",
    )


def margin_agrees(context: Context) -> Check:
    """The stability margin two ways."""
    result = swayed(context)
    centre = file_centre(context, result)
    hulls = [
        hull_margin(feet[standing][:, :2], point[:2])
        for feet, standing, point in zip(result.feet.position, result.stance, centre, strict=True)
    ]
    return Check(
        "static stability margin, two ways",
        worst(np.array(hulls) - result.margin),
        1e-9,
        "m",
        f"gait engine against convex hulls, walk with sway, {len(hulls)} instants",
    )


def sway_is_best(context: Context) -> Check:
    """No random sway does better, and the programme's margin is the walk's."""
    from leg_dynamics.analysis.gait import Sway

    excess = 0.0
    rng = context.rng(40)
    for order, duty in ((reported.ORDER, SWAYED_DUTY), (round_the_body(context).numbering.order, DUTY)):
        plain = walk_of(context, order, duty=duty)
        best, sway = best_sway(plain, (SWAY_BOUND, SWAY_BOUND))
        most, least = sampled_bounds(plain, (SWAY_BOUND, SWAY_BOUND))
        reached = float(margins_of(walk_of(context, order, duty=duty, sway=sway))[1].min())
        excess = max(excess, abs(reached - best))
        for trial in range(TRIALS):
            # Around the best one as well as anywhere.
            change = rng.normal(size=(2, *np.shape(sway.cosine))) * [1.0, 1.0, 0.0] * 10.0 ** -(2.0 + trial % 4)
            near = trial % 2
            tried = Sway(near * sway.cosine + change[0], near * sway.sine + change[1])
            walk = walk_of(context, order, duty=duty, sway=tried)
            cycles = np.linspace(0.0, 1.0, 401)
            ahead = walk.twist.forward + tried.value(cycles, walk.period, 1)[:, 0].min()
            if np.abs(tried.value(cycles, walk.period)).max() <= min(most) and ahead >= least:
                excess = max(excess, float(margins_of(walk)[1].min()) - best)
    return Check(
        "the sway is the best one",
        excess,
        1e-9,
        "m",
        f"margin of the linear programme against the walk's own, and against {2 * TRIALS} random sways that keep its "
        "bounds",
    )


CHECKS: tuple[Callable[[Context], Check], ...] = (feet_stand, centre_agrees, margin_agrees, sway_is_best)
"""What must hold."""
