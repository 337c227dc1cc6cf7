"""A description as a MuJoCo model: tree, inertias, loops and couplings.

MuJoCo is the optional extra ``mujoco``. Its loader of URDF drops loops, couplings and rotor inertia without a word, so
the model is built here from the description. Equality constraints are soft by MuJoCo's nature; how soft is up to the
caller. Joint limits, shapes and contacts are left out: the model is for dynamics.
"""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.description.model import Description, Joint, Link, Loop, LoopEnd, Pose
from leg_dynamics.description.topology import coupling_equations, joints_depth_first
from leg_dynamics.errors import DescriptionError, UnsupportedError

if TYPE_CHECKING:
    import mujoco

__all__ = ["LOOP_TYPES", "has_mujoco", "mujoco_model", "mujoco_spec"]

STANDARD_GRAVITY = 9.81
LOOP_TYPES = ("revolute", "continuous", "spherical", "fixed")
"""Loop joints that MuJoCo's equality constraints can express."""


def has_mujoco() -> bool:
    """Whether the optional extra is installed."""
    return importlib.util.find_spec("mujoco") is not None


def mujoco_model(description: Description, *, hinge_length: float = 0.1) -> mujoco.MjModel:
    """Compile `mujoco_spec`.

    Parameters
    ----------
    description, hinge_length
        As for `mujoco_spec`.

    Returns
    -------
    mujoco.MjModel

    Raises
    ------
    UnsupportedError
        MuJoCo is not installed, or a joint or loop has no counterpart in it.
    DescriptionError
        MuJoCo refuses the model, for example a moving link without inertia.
    """
    spec = mujoco_spec(description, hinge_length=hinge_length)
    try:
        return spec.compile()
    except ValueError as error:
        raise DescriptionError(f"MuJoCo refuses the model: {error}", file=description.file) from error


def mujoco_spec(description: Description, *, hinge_length: float = 0.1) -> mujoco.MjSpec:
    """Write a description as a MuJoCo specification.

    Links become bodies, moving joints hinges and slides with the same names, positive directions and zeros; the root is
    fixed to the world, gravity is 9.81 m/s² against its z. A hinge loop becomes two coincident points on its axis,
    a ball loop one, a rigid loop a weld; each is named after the loop. Couplings and mimics become joint equalities,
    or a fixed tendon's where more than two joints meet. Rotors become armature on the joint side.

    Parameters
    ----------
    description : Description
        A mechanism of revolute, continuous, prismatic and fixed joints.
    hinge_length : float
        Distance between the two points of a hinge loop, m: the arm that resists tilting.

    Returns
    -------
    mujoco.MjSpec

    Raises
    ------
    UnsupportedError
        MuJoCo is not installed, or a joint or loop has no counterpart in it.
    """
    if not has_mujoco():
        raise UnsupportedError("MuJoCo is not installed: install the extra, leg-dynamics[mujoco]")
    import mujoco

    spec = mujoco.MjSpec()
    spec.modelname = description.name
    spec.option.gravity = (0.0, 0.0, -STANDARD_GRAVITY)
    root = spec.worldbody.add_body(name=description.root)
    _add_inertia(root, description.link(description.root))
    bodies = {description.root: root}
    for joint in joints_depth_first(description):
        body = bodies[joint.parent].add_body(name=joint.child, **_placement(joint.origin))
        _add_inertia(body, description.link(joint.child))
        if joint.type != "fixed":
            _add_joint(body, joint, _armature(description, joint.name))
        bodies[joint.child] = body
    for loop in description.loops:
        _add_loop(spec, bodies, loop, hinge_length)
    _add_equations(spec, description)
    return spec


def _placement(pose: Pose) -> dict[str, Any]:
    import mujoco

    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, pose.rotation().ravel())
    return {"pos": pose.xyz, "quat": quaternion}


def _add_inertia(body: Any, link: Link) -> None:
    if link.inertial is None:
        return
    rotation = link.inertial.origin.rotation()
    tensor = rotation @ link.inertial.tensor() @ rotation.T
    body.mass = link.inertial.mass
    body.ipos = link.inertial.origin.xyz
    body.fullinertia = (*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])
    body.explicitinertial = True


def _armature(description: Description, joint: str) -> float:
    rotors = (t.rotor_inertia * t.reduction**2 for t in description.transmissions if t.joint == joint)
    return sum(rotors, description.joint(joint).armature)


def _add_joint(body: Any, joint: Joint, armature: float) -> None:
    import mujoco

    kinds = {
        "revolute": mujoco.mjtJoint.mjJNT_HINGE,
        "continuous": mujoco.mjtJoint.mjJNT_HINGE,
        "prismatic": mujoco.mjtJoint.mjJNT_SLIDE,
    }
    if joint.type not in kinds:
        raise UnsupportedError(f"joint {joint.name!r} is {joint.type}: the MuJoCo model takes one coordinate a joint")
    added = body.add_joint(name=joint.name, type=kinds[joint.type], axis=joint.axis)
    added.armature = armature
    added.frictionloss = joint.friction
    # Newer releases take polynomial damping, the linear coefficient first.
    if np.ndim(added.damping):
        added.damping[0] = joint.damping
    else:
        added.damping = joint.damping


def _add_loop(spec: Any, bodies: dict[str, Any], loop: Loop, hinge_length: float) -> None:
    import mujoco

    if loop.type not in LOOP_TYPES:
        raise UnsupportedError(
            f"loop {loop.name!r} is {loop.type}: MuJoCo has equality constraints for {', '.join(LOOP_TYPES)} loops only"
        )
    kind = mujoco.mjtEq.mjEQ_WELD if loop.type == "fixed" else mujoco.mjtEq.mjEQ_CONNECT
    offsets = [np.zeros(3)]
    if loop.axis is not None and loop.type in ("revolute", "continuous"):
        offsets.append(hinge_length * np.asarray(loop.axis))
    for number, offset in enumerate(offsets, 1):
        name = f"{loop.name}.{number}"
        ends = [
            _add_site(bodies, end, f"{name}.{side}", offset)
            for side, end in (("predecessor", loop.predecessor), ("successor", loop.successor))
        ]
        added = spec.add_equality(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE)
        added.name1, added.name2 = ends


def _add_site(bodies: dict[str, Any], end: LoopEnd, name: str, offset: np.ndarray) -> str:
    placement = _placement(end.origin)
    placement["pos"] = np.asarray(end.origin.xyz) + end.origin.rotation() @ offset
    bodies[end.link].add_site(name=name, **placement)
    return name


def _add_equations(spec: Any, description: Description) -> None:
    import mujoco

    for equation in coupling_equations(description):
        terms = list(equation.coefficients.items())
        if len(terms) > 2:
            tendon = spec.add_tendon(name=equation.name)
            for joint, coefficient in terms:
                tendon.wrap_joint(joint, coefficient)
            added = spec.add_equality(
                name=equation.name, type=mujoco.mjtEq.mjEQ_TENDON, objtype=mujoco.mjtObj.mjOBJ_TENDON
            )
            added.name1 = equation.name
            added.data[:5] = (equation.constant, 0.0, 0.0, 0.0, 0.0)
            continue
        added = spec.add_equality(name=equation.name, type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
        added.name1, first = terms[0]
        slope = 0.0
        if len(terms) == 2:
            added.name2, second = terms[1]
            slope = -second / first
        added.data[:5] = (equation.constant / first, slope, 0.0, 0.0, 0.0)
