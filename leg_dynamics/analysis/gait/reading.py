"""`robot_from`: find the legs in a robot's file and prove that each is the leg of the model, or its mirror image."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis.gait.robot import Limb, Robot, hip_link, moving_links
from leg_dynamics.description.model import Description, Joint, LoopEnd, Pose
from leg_dynamics.errors import DescriptionError

__all__ = ["leg_prefixes", "moving_hip", "robot_from"]

TOLERANCE = 1e-9
"""m, kg, kg m², 1: files are written to fifteen digits."""

_MIRRORS = ((1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, 1.0, -1.0))


def robot_from(description: Description, leg: Any) -> Robot:
    """Read a robot for gaits from its file.

    A leg of the robot is a set of links that carry the names of the model's links after a common prefix, such as
    ``front_left_hip`` to ``front_left_foot``; the prefix names the leg, and the file's order is the legs' order. Every
    joint, mass and loop of it is compared with the model and with its three mirror images in the planes of the hip
    frame, so that a robot never walks on legs other than its own.

    Parameters
    ----------
    description : Description
        The robot's file; its root is the body.
    leg : Leg or sequence of Leg
        The model of the legs; several where legs differ, the first that fits counts.

    Returns
    -------
    Robot
        The trunk is all that does not move with a leg, moving parts that are no leg in their home pose; feet at home
        stand where the configuration ``home`` has them.

    Raises
    ------
    DescriptionError
        There is no leg, a leg's hip moves, legs share links, or a leg is neither the model nor its mirror image; the
        message says where the nearest one differs.
    """
    models = list(leg) if isinstance(leg, Sequence) else [leg]
    limbs: list[Limb] = []
    reasons: dict[str, str] = {}
    for prefix in leg_prefixes(description, [_file(model) for model in models]):
        try:
            limbs.append(_limb(description, prefix, models))
        except DescriptionError as error:
            reasons[prefix] = error.message.removeprefix(f"{description.file}: ")
    if reasons:
        more = f" (and {len(reasons) - 1} more legs do not fit)" if len(reasons) > 1 else ""
        raise DescriptionError(next(iter(reasons.values())) + more, file=description.file, prefixes=tuple(reasons))
    if not limbs:
        names = " or ".join(repr(getattr(model, "name", "leg")) for model in models)
        raise DescriptionError(
            f"{description.name!r} has no leg like {names}: no link is named PREFIX{hip_link(_file(models[0]))} with "
            "all the other links of the leg under the same prefix; name the leg that it is made of",
            file=description.file,
        )
    mass, com = _trunk(description, limbs)
    gravity = limbs[0].vector_to_body(limbs[0].leg.gravity)
    return Robot(description.name, tuple(limbs), mass, com, gravity + 0.0, description)


def _file(model: Any) -> Description:
    mechanism = getattr(model, "description", None)
    if not isinstance(mechanism, Description):
        raise DescriptionError(
            f"{type(model).__name__} has no file to compare with; build the Robot from Limbs instead"
        )
    return mechanism


def leg_prefixes(description: Description, legs: Sequence[Description]) -> list[str]:
    """What stands before the names of each leg's links in a robot's file, in its order; `legs` are the legs' files."""
    found = []
    for link in description.links:
        for mechanism in legs:
            hip = hip_link(mechanism)
            if not link.name.endswith(hip):
                continue
            prefix = link.name[: len(link.name) - len(hip)]
            if prefix not in found and all(
                description.has_link(prefix + name) for name in moving_links(mechanism, hip)
            ):
                found.append(prefix)
    return found


def moving_hip(description: Description, hip: str) -> str | None:
    """The first joint that moves between the body and a hip; None where the hip is fixed, as a gait needs it."""
    return next((joint.name for joint in description.path(hip) if joint.type != "fixed"), None)


def _limb(description: Description, prefix: str, models: Sequence[Any]) -> Limb:
    from leg_dynamics.description import link_transforms

    nearest: list[tuple[float, str]] = []
    for model, mirror in itertools.product(models, _MIRRORS):
        mechanism = _file(model)
        hip = hip_link(mechanism)
        if not all(description.has_link(prefix + name) for name in moving_links(mechanism, hip)):
            continue
        signs: dict[str, tuple[str, float]] = {}
        worst = max(_differences(description, mechanism, prefix, np.array(mirror), signs), default=(0.0, ""))
        if worst[0] > TOLERANCE:
            nearest.append(worst)
            continue
        if moving := moving_hip(description, prefix + hip):
            raise DescriptionError(f"the hip of {prefix!r} hangs on the moving joint {moving!r}", file=description.file)
        pose = link_transforms(description, {})[prefix + hip]
        limb = Limb(prefix.strip("_-./: ") or "leg", model, pose, np.zeros(3), mirror, signs, prefix)
        home = limb.to_body(model.foot_position(_home(description, limb)))
        return Limb(limb.name, model, pose, home, mirror, signs, prefix)
    size, where = min(nearest)
    names = " nor ".join(repr(getattr(model, "name", "the leg")) for model in models)
    raise DescriptionError(
        f"the leg {prefix!r} of {description.name!r} is neither {names} nor a mirror "
        f"image of it: {where} differs by {size:.3g}; load the leg with the robot's parameters",
        file=description.file,
        margin=-size,
    )


def _home(description: Description, limb: Limb) -> list[float]:
    """The model's coordinates in the robot's home pose, else in its own."""
    mechanism = _file(limb.leg)
    own = {} if mechanism.home is None else mechanism.home.values
    robot = {} if description.home is None else description.home.values
    signs = {joint: (name, sign) for name, (joint, sign) in limb.joints.items()}
    values = []
    for joint in limb.leg.joint_names:
        name, sign = signs[joint]
        values.append(sign * robot[name] if name in robot else own.get(joint, 0.0))
    return values


def _differences(
    description: Description,
    mechanism: Description,
    prefix: str,
    S: NDArray[np.float64],
    signs: dict[str, tuple[str, float]],
) -> Iterator[tuple[float, str]]:
    """How far each number of the robot's leg is from the model's mirror image, and what it is; fills in the signs."""
    links = set(moving_links(mechanism, hip_link(mechanism)))
    parents = {joint.child: joint for joint in description.joints}
    for joint in mechanism.joints:
        if joint.child not in links:
            continue
        other = parents[prefix + joint.child]
        if (other.parent, other.type) != (prefix + joint.parent, joint.type):
            yield np.inf, f"the joint above {prefix + joint.child}"
            continue
        yield _pose_difference(other.origin, joint.origin, S), f"the origin of {other.name}"
        if joint.type != "fixed":
            yield _axis_difference(other, joint, S, signs), f"the axis of {other.name}"
            for field in ("damping", "friction"):
                yield abs(getattr(other, field) - getattr(joint, field)), f"the {field} of {other.name}"
    for name in links:
        yield _inertia_difference(description, mechanism, prefix, name, S), f"the inertia of {prefix + name}"
    loops = {loop.name: loop for loop in description.loops}
    for loop in mechanism.loops:
        twin = loops.get(prefix + loop.name)
        if twin is None or twin.type != loop.type:
            yield np.inf, f"the loop {prefix + loop.name}"
            continue
        for mine, own in ((twin.predecessor, loop.predecessor), (twin.successor, loop.successor)):
            yield _end_difference(mine, own, prefix, S), f"the loop {twin.name}"
        if loop.axis is not None and twin.axis is not None:
            a, b = np.array(twin.axis), S * np.array(loop.axis)
            yield min(np.abs(a - b).max(), np.abs(a + b).max()), f"the axis of {twin.name}"


def _pose_difference(pose: Pose, model: Pose, S: NDArray[np.float64]) -> float:
    shift = np.abs(np.array(pose.xyz) - S * np.array(model.xyz)).max()
    turn = np.abs(pose.rotation() - S[:, None] * model.rotation() * S).max()
    return float(max(shift, turn))


def _end_difference(end: LoopEnd, model: LoopEnd, prefix: str, S: NDArray[np.float64]) -> float:
    return _pose_difference(end.origin, model.origin, S) if end.link == prefix + model.link else np.inf


def _axis_difference(joint: Joint, model: Joint, S: NDArray[np.float64], signs: dict[str, tuple[str, float]]) -> float:
    # A mirror turns a rotation about a into the opposite one about the image of a.
    image = S * np.array(model.axis) * (1.0 if model.type == "prismatic" else np.prod(S))
    sign = 1.0 if np.dot(joint.axis, image) > 0.0 else -1.0
    signs[joint.name] = (model.name, sign)
    return float(np.abs(np.array(joint.axis) - sign * image).max())


def _inertia_difference(
    description: Description, mechanism: Description, prefix: str, name: str, S: NDArray[np.float64]
) -> float:
    mine, own = description.link(prefix + name).inertial, mechanism.link(name).inertial
    if mine is None or own is None:
        return 0.0 if mine is own else max(each.mass for each in (mine, own) if each is not None)
    tensors = [each.origin.rotation() @ each.tensor() @ each.origin.rotation().T for each in (mine, own)]
    parts = (
        abs(mine.mass - own.mass),
        np.abs(np.array(mine.origin.xyz) - S * np.array(own.origin.xyz)).max() if own.mass else 0.0,
        np.abs(tensors[0] - S[:, None] * tensors[1] * S).max(),
    )
    return float(max(parts))


def _trunk(description: Description, limbs: Sequence[Limb]) -> tuple[float, NDArray[np.float64]]:
    """Mass and centre of mass of all links that do not move with a leg."""
    from leg_dynamics.description import link_transforms

    taken: set[str] = set()
    for limb in limbs:
        mechanism = _file(limb.leg)
        own = {limb.prefix + name for name in moving_links(mechanism, hip_link(mechanism))}
        if taken & own:
            raise DescriptionError(f"two legs share the links {', '.join(sorted(taken & own))}", file=description.file)
        taken |= own
    home: Mapping[str, float] = {} if description.home is None else description.home.values
    transforms = link_transforms(description, dict(home))
    mass, moment = 0.0, np.zeros(3)
    for link in description.links:
        if link.inertial is not None and link.name not in taken:
            place = transforms[link.name]
            mass += link.inertial.mass
            moment += link.inertial.mass * (place[:3, :3] @ np.array(link.inertial.origin.xyz) + place[:3, 3])
    return mass, moment / mass if mass else moment
