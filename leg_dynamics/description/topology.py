"""What the tree implies: parent-first order, linear coupling equations, independent and actuated joints."""

from __future__ import annotations

import warnings

from leg_dynamics.description.model import Coupling, Description, Equation, Joint
from leg_dynamics.errors import DescriptionError, LegDynamicsWarning

__all__ = [
    "actuated_joints",
    "coupling_equation",
    "coupling_equations",
    "coupling_paths",
    "independent_joints",
    "joints_depth_first",
    "split_independent",
]


def joints_depth_first(description: Description) -> tuple[Joint, ...]:
    """All joints, each after its parents and before its next sibling's branch; siblings in file order.

    Parameters
    ----------
    description : Description
        Any mechanism.

    Returns
    -------
    tuple of Joint
        Every joint once, depth first.
    """
    children: dict[str, list[Joint]] = {}
    for joint in description.joints:
        children.setdefault(joint.parent, []).append(joint)
    ordered: list[Joint] = []
    pending = children.get(description.root, [])[::-1]
    while pending:
        joint = pending.pop()
        ordered.append(joint)
        pending.extend(reversed(children.get(joint.child, [])))
    return tuple(ordered)


def coupling_paths(description: Description, coupling: Coupling) -> tuple[tuple[Joint, ...], tuple[Joint, ...]]:
    """The joints from the nearest common ancestor to a coupling's predecessor and to its successor.

    Parameters
    ----------
    description : Description
        The mechanism.
    coupling : Coupling
        One of its couplings.

    Returns
    -------
    tuple of two tuples of Joint
        Predecessor path and successor path, ancestor first; fixed joints included.
    """
    predecessor, successor = description.path(coupling.predecessor), description.path(coupling.successor)
    shared = 0
    for one, other in zip(predecessor, successor, strict=False):
        if one.name != other.name:
            break
        shared += 1
    return predecessor[shared:], successor[shared:]


def coupling_equation(description: Description, coupling: Coupling) -> Equation:
    """A coupling as sum(successor path) - ratio * sum(predecessor path) = 0; see `coupling_equations`."""
    predecessor_path, successor_path = coupling_paths(description, coupling)
    coefficients: dict[str, float] = {}
    for path, factor in ((successor_path, 1.0), (predecessor_path, -coupling.ratio)):
        for joint in path:
            if joint.is_single_coordinate:
                coefficients[joint.name] = factor
            elif joint.type != "fixed":
                raise DescriptionError(
                    f"coupling {coupling.name!r} runs over the {joint.type} joint {joint.name!r}: "
                    "only joints with one coordinate can be coupled",
                    file=description.file,
                    line=coupling.line,
                )
    return Equation(coupling.name, coefficients)


def coupling_equations(description: Description) -> tuple[Equation, ...]:
    """Couplings and mimics as linear equations in the tree coordinates: the sum of coefficient * q = constant.

    A coupling says: the coordinates summed along the successor's path from the nearest common ancestor are `ratio`
    times those along the predecessor's. A mimic says: q_j - multiplier * q_i = offset.

    Parameters
    ----------
    description : Description
        The mechanism.

    Returns
    -------
    tuple of Equation
        The couplings in file order, under their names, then the mimics in file order, named by the mimicking joint.

    Raises
    ------
    DescriptionError
        Where a floating or planar joint lies on a coupling's path.
    """
    couplings = [coupling_equation(description, coupling) for coupling in description.couplings]
    mimics = [
        Equation(joint.name, {joint.name: 1.0, joint.mimic.joint: -joint.mimic.multiplier}, joint.mimic.offset)
        for joint in description.joints
        if joint.mimic is not None
    ]
    return (*couplings, *mimics)


def split_independent(description: Description) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """As `independent_joints` but without a warning: the independent joints, and those that couplings took out.

    Parameters
    ----------
    description : Description
        The mechanism.

    Returns
    -------
    tuple of two tuples of str
        Independent joints in file order; joints made dependent because no flag is stated.
    """
    independent = [joint.name for joint in description.joints if joint.independent]
    if any(joint.independent_is_stated for joint in description.joints):
        return tuple(independent), ()
    demoted: list[str] = []
    for coupling in description.couplings:
        predecessor_path, successor_path = coupling_paths(description, coupling)
        # The successor's own joint is the last moving one on its path: the link itself may be fixed to another.
        for joint in (*reversed(successor_path), *reversed(predecessor_path)):
            if joint.name in independent:
                independent.remove(joint.name)
                demoted.append(joint.name)
                break
    return tuple(independent), tuple(demoted)


def independent_joints(description: Description) -> tuple[str, ...]:
    """Names of the independent joints, in file order.

    They are the moving joints flagged ``independent`` (the default), without mimicking joints, which always depend on
    another. Where a file has couplings and states no flag at all, each coupling's successor joint becomes dependent
    first.

    Parameters
    ----------
    description : Description
        The mechanism.

    Returns
    -------
    tuple of str
        Joint names.

    Warns
    -----
    LegDynamicsWarning
        Where couplings had to decide.
    """
    independent, demoted = split_independent(description)
    if demoted:
        warnings.warn(
            f"{description.file}: no joint states an independent flag, so the couplings' successor joints "
            f'{", ".join(demoted)} are taken as dependent; state independent="false" there to confirm',
            LegDynamicsWarning,
            stacklevel=2,
        )
    return independent


def actuated_joints(description: Description) -> tuple[str, ...]:
    """Names of the actuated joints: those of the transmissions in file order, else the independent joints.

    Of the independent joints those are left out that state ``driven="false"`` and those that stand for a floating or
    planar joint, which no motor drives; all are where the file states ``<robot driven="none">``.

    Parameters
    ----------
    description : Description
        The mechanism.

    Returns
    -------
    tuple of str
        Joint names; empty where nothing is driven.

    Warns
    -----
    LegDynamicsWarning
        As `independent_joints`, where there are no transmissions.
    """
    if description.transmissions:
        return tuple(transmission.joint for transmission in description.transmissions)
    if description.driven == "none":
        return ()
    return tuple(name for name in independent_joints(description) if description.joint(name).driven)
