"""Which module an assembled mechanism's joint belongs to, and on which face a foot is: by the names of its links.

Links carry their module's name whether a description was read from the assembly or from its rendered URDF+ file.
"""

from __future__ import annotations

from typing import TypeVar

from leg_dynamics.description.model import Description
from leg_dynamics.description.modules import BODIES, FACES, Face
from leg_dynamics.errors import AssemblyError, JointLimitError, OutOfReachError, RowError, SingularityError

__all__ = ["face_of_foot", "foot_words", "joint_words", "module_of_joint", "with_place"]

_OfPoses = (OutOfReachError, JointLimitError, SingularityError, AssemblyError)
_Error = TypeVar("_Error", bound=RowError)


def module_of_joint(description: Description, joint: str) -> str | None:
    """The module that has the joint between two of its bodies; None where there is none."""
    known = {each.name: each for each in description.joints}
    if joint not in known:
        return None
    parent, child = known[joint].parent, known[joint].child
    for body in BODIES:
        module = child.removesuffix(f"_{body}")
        if module != child and parent in _bodies(module) and _is_module(description, module):
            return module
    return None


def face_of_foot(description: Description, foot: str | None) -> Face | None:
    """The face that a foot is, or is fixed on; None where it is on none."""
    if foot is None or not description.has_link(foot):
        return None
    above = [joint.parent for joint in description.path(foot)[-1:] if joint.type == "fixed"]
    for link in (foot, *above):
        for letter in FACES:
            module = link.removesuffix(f"_face_{letter}")
            if module != link and _is_module(description, module):
                return Face(module, letter)
    return None


def _bodies(module: str) -> tuple[str, ...]:
    return tuple(f"{module}_{body}" for body in BODIES)


def _is_module(description: Description, module: str) -> bool:
    links = (*_bodies(module), *(Face(module, letter).link for letter in FACES))
    return all(map(description.has_link, links))


def joint_words(joint: str, module: str | None) -> str:
    """What an error's sentence ends with where it is about a joint of a module."""
    return "" if module is None else f" ({joint} is a joint of module {module!r})"


def foot_words(face: Face | None) -> str:
    """What an error's sentence ends with where it is about a foot on a face of a module."""
    return "" if face is None else f" (the foot is on face {face.face} of module {face.module!r})"


def with_place(description: Description, foot: str | None, error: _Error) -> _Error:
    """An error about a pose, with the module of its joint, or else the module and face of the foot.

    Parameters
    ----------
    description : Description
    foot : str or None
        Link.
    error : RowError
        With `joint` where it is about one.

    Returns
    -------
    RowError
        The same error where it is not about a pose, names a module already, or the mechanism is not assembled from
        modules.
    """
    if not isinstance(error, _OfPoses) or "module" in error.evidence:
        return error
    joint = error.evidence.get("joint")
    if joint is not None:
        module = module_of_joint(description, joint)
        words, place = joint_words(joint, module), {"module": module, "face": None}
    else:
        face = face_of_foot(description, foot)
        words, place = foot_words(face), {} if face is None else {"module": face.module, "face": face.face}
    if not words:
        return error
    return type(error)(error.message + words, **dict(error.evidence) | place)
