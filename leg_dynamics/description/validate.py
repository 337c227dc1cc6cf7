"""The checks that need the whole file: the tree, mimics, couplings, actuators, and physically possible inertia."""

from __future__ import annotations

import math

import numpy as np

from leg_dynamics.description.model import Coupling, Description, Joint, Link, Loop, Telescope
from leg_dynamics.description.topology import coupling_equation, coupling_paths, joints_depth_first
from leg_dynamics.description.xml_reader import Document, nearest

__all__ = ["validate"]

_INERTIA_TOLERANCE = 1e-9  # relative to the largest principal moment: the rounding of a printed tensor
_NAMED = 5  # further links that one warning names
_MOST_COEFFICIENTS = 300_000
# Loops and couplings beyond two a joint bind what is bound already; some may, in a file with few joints.
_MOST_A_JOINT = 2
_FEW = 50
_LIMIT_TOLERANCE = 1e-9  # rad or m, as `leg_dynamics.leg` has it: the rounding of a printed angle


def validate(description: Description, document: Document) -> None:
    """Check what a single element cannot show; its references are known to exist.

    Parameters
    ----------
    description : Description
        What the elements say.
    document : Document
        File name and source, for errors.

    Raises
    ------
    DescriptionError
        For the first problem found, with file and line.

    Warns
    -----
    LegDynamicsWarning
        For links whose inertia no rigid body can have, for telescopes that contradict their joints' limits, and
        for every named configuration that is outside the limits of joints.
    """
    check_tree(description, document)
    check_mimics(description, document)
    check_loops(description, document)
    check_couplings(description, document)
    check_transmissions(description, document)
    warn_about_inertia(description, document)
    warn_about_telescopes(description, document)
    warn_about_configurations(description, document)


def check_tree(description: Description, document: Document) -> None:
    """Every link has one parent joint, except the one root from which all are reached."""
    parent_joint: dict[str, Joint] = {}
    for joint in description.joints:
        if joint.parent == joint.child:
            raise document.error(f"joint {joint.name!r} joins link {joint.child!r} to itself", joint.line)
        if (other := parent_joint.get(joint.child)) is not None:
            raise document.error(
                f"link {joint.child!r} has two parents: it is the child of joint {other.name!r} (line {other.line}) "
                f"and of joint {joint.name!r}; close a loop with <loop>",
                joint.line,
            )
        parent_joint[joint.child] = joint
    check_no_cycle(description.links, parent_joint, document)
    roots = [link for link in description.links if link.name not in parent_joint]
    if len(roots) > 1:
        names = ", ".join(repr(link.name) for link in roots[:5]) + (", ..." if len(roots) > 5 else "")
        raise document.error(
            f"the tree is disconnected: {len(roots)} links have no parent joint ({names}), one must be the root",
            roots[1].line,
        )


def check_no_cycle(links: tuple[Link, ...], parent_joint: dict[str, Joint], document: Document) -> None:
    """No link is its own ancestor."""
    reaches_root: set[str] = set()
    for link in links:
        name = link.name
        trail: dict[str, Joint] = {}
        while name in parent_joint and name not in reaches_root:
            if name in trail:
                cycle = list(trail)[list(trail).index(name) :]
                shown = " <- ".join(map(repr, [*cycle[:6], *(["..."] if len(cycle) > 6 else []), name]))
                raise document.error(f"parents form a cycle: {shown}; close a loop with <loop>", trail[name].line)
            trail[name] = parent_joint[name]
            name = trail[name].parent
        reaches_root.update(trail)


def check_mimics(description: Description, document: Document) -> None:
    """A mimicked joint exists, has one coordinate, and does not lead back to the joint itself."""
    joints = {joint.name: joint for joint in description.joints}
    settled: set[str] = set()
    for joint in description.joints:
        trail: dict[str, None] = {}
        current = joint
        while current.mimic is not None and current.name not in settled:
            if current.name in trail:
                shown = [*map(repr, list(trail)[:6]), *(["..."] if len(trail) > 6 else []), repr(current.name)]
                raise document.error(f"mimic joints form a cycle: {' -> '.join(shown)}", joint.line)
            trail[current.name] = None
            check_mimic(current, current.mimic.joint, joints, document)
            current = joints[current.mimic.joint]
        settled.update(trail)


def check_mimic(joint: Joint, mimicked: str, joints: dict[str, Joint], document: Document) -> None:
    """One mimic: both joints have one coordinate, and are two."""
    if mimicked not in joints:
        hint = nearest(mimicked, joints)
        raise document.error(f"joint {joint.name!r} mimics an unknown joint {mimicked!r}{hint}", joint.line)
    if mimicked == joint.name:
        raise document.error(f"joint {joint.name!r} mimics itself", joint.line)
    for each in (joint, joints[mimicked]):
        if not each.is_single_coordinate:
            raise document.error(
                f"joint {joint.name!r} mimics {mimicked!r}, but {each.name!r} is {each.type}: "
                "it does not have one coordinate",
                joint.line,
            )


def check_loops(description: Description, document: Document) -> None:
    """The two ends of a loop are on links that can move against each other."""
    if not description.loops:
        return
    check_count(description, "loops", description.loops, document)
    body = {description.root: description.root}
    for joint in joints_depth_first(description):
        body[joint.child] = body[joint.parent] if joint.type == "fixed" else joint.child
    for loop in description.loops:
        first, second = loop.predecessor.link, loop.successor.link
        if body[first] == body[second]:
            raise document.error(
                f"loop {loop.name!r} joins {first!r} and {second!r}, which are one rigid body, as only fixed joints "
                "lie between them: it binds nothing; name the two links that meet in the loop joint, or delete the "
                "loop",
                loop.line,
            )


def check_count(
    description: Description, what: str, found: tuple[Loop, ...] | tuple[Coupling, ...], document: Document
) -> None:
    """There are not so many loops or couplings that nearly all of them could bind nothing."""
    joints = len(description.moving_joints)
    most = _MOST_A_JOINT * joints + _FEW
    if len(found) > most:
        raise document.error(
            f"{len(found)} {what} on {joints} moving joints, the most is {most}, {_MOST_A_JOINT} a joint and {_FEW}: "
            "the rest can bind nothing that is not bound; delete repeated ones",
            found[most].line,
        )


def check_couplings(description: Description, document: Document) -> None:
    """A coupling relates at least one coordinate, and only joints with one coordinate lie on its paths."""
    check_count(description, "couplings", description.couplings, document)
    related = 0
    for coupling in description.couplings:
        if coupling.predecessor == coupling.successor:
            raise document.error(
                f"coupling {coupling.name!r} couples link {coupling.successor!r} to itself", coupling.line
            )
        coefficients = coupling_equation(description, coupling).coefficients
        if not coefficients:
            raise document.error(
                f"coupling {coupling.name!r} couples nothing: only fixed joints lie between "
                f"{coupling.predecessor!r} and {coupling.successor!r}",
                coupling.line,
            )
        related += len(coefficients)
        if related > _MOST_COEFFICIENTS:
            raise document.error(
                f"couplings up to {coupling.name!r} run over more than {_MOST_COEFFICIENTS} joints, counted once for "
                "each coupling: couple links that are near to each other in the tree",
                coupling.line,
            )
        if not all(any(joint.name in coefficients for joint in path) for path in coupling_paths(description, coupling)):
            shown = [*list(coefficients)[:10], *(["..."] if len(coefficients) > 10 else [])]
            document.warn(
                f"coupling {coupling.name!r} has moving joints on one side only, so that it holds the sum of "
                f"{', '.join(shown)} at zero",
                coupling.line,
            )


def check_transmissions(description: Description, document: Document) -> None:
    """No joint is driven twice or against its flag, no actuator drives twice, and a rotor at its joint is finite."""
    by_joint: dict[str, str] = {}
    by_actuator: dict[str, str] = {}
    for each in description.transmissions:
        for kind, name, owners in (("joint", each.joint, by_joint), ("actuator", each.actuator, by_actuator)):
            if name in owners:
                raise document.error(
                    f"{kind} {name!r} has two transmissions, {owners[name]!r} and {each.name!r}", each.line
                )
            owners[name] = each.name
        if not description.joint(each.joint).driven:
            raise document.error(
                f'transmission {each.name!r} drives joint {each.joint!r}, which states driven="false": delete one of '
                "the two",
                each.line,
            )
        # The bare square too: the routes take it before they know the rotor's inertia. A power would raise.
        square = each.reduction * each.reduction
        if not (math.isfinite(square) and math.isfinite(square * each.rotor_inertia)):
            raise document.error(
                f"the rotor of transmission {each.name!r} felt at its joint, mechanicalReduction {each.reduction:g} "
                f"squared times rotorInertia {each.rotor_inertia:g} kg·m², is too large for a floating-point number: "
                "check the gear ratio (motor turns a joint turn) and the inertia",
                each.line,
            )


def warn_about_inertia(description: Description, document: Document) -> None:
    """Warn once of the inertia tensors that no rigid body can have: the first one's numbers, and the others' names.

    Principal moments I1 <= I2 <= I3 of a body are positive and fulfil the triangle inequality I3 <= I1 + I2. A tensor
    of zeros is accepted: a point mass, or the massless links of foreign files.
    """
    bodies = [(link, link.inertial) for link in description.links if link.inertial is not None]
    if not bodies:
        return
    tensors = np.array([inertial.tensor() for _, inertial in bodies])
    # Scaled so that eigenvalues of huge or tiny tensors neither overflow nor vanish.
    scales = np.abs(tensors).max(axis=(1, 2))
    suspects = np.flatnonzero(scales > 0.0)
    moments = np.linalg.eigvalsh(tensors[suspects] / scales[suspects, None, None])
    wrong: list[tuple[Link, str]] = []
    for index, (smallest, middle, largest) in zip(suspects, moments, strict=True):
        scale = scales[index]
        shown = f"principal moments {', '.join(f'{m * scale:.6g}' for m in (smallest, middle, largest))} kg·m²"
        if smallest <= _INERTIA_TOLERANCE * abs(largest):
            problem = f"is not positive definite: {shown}, the smallest must be positive"
        elif largest > (smallest + middle) * (1.0 + _INERTIA_TOLERANCE):
            excess = (largest - smallest - middle) * scale
            problem = (
                f"breaks the triangle inequality: {shown}, the largest exceeds the sum of the others by {excess:.3g}"
            )
        else:
            continue
        wrong.append((bodies[index][0], problem))
    if wrong:
        (link, problem), *more = wrong
        names = ", ".join(repr(other.name) for other, _ in more[:_NAMED]) + (", ..." if len(more) > _NAMED else "")
        others = f"; {len(more)} more links have such an inertia: {names}" if more else ""
        document.warn(f"inertia of link {link.name!r} {problem}{others}", link.line)


def warn_about_telescopes(description: Description, document: Document) -> None:
    """Warn once of telescopes whose joints' limits say what cannot be.

    Tubes that come apart before the upper limit, or that overlap enough nowhere between the limits. A limit that is
    merely less strict than the overlap is no contradiction.
    """
    wrong: list[tuple[float, Telescope]] = []
    for telescope in description.telescopes:
        limits, tubes = description.joint(telescope.joint).limits, telescope.sleeve + telescope.rod
        if limits.lower - (tubes - telescope.overlap) > _LIMIT_TOLERANCE:
            wrong.append((math.inf, telescope))
        elif math.isfinite(limits.upper) and limits.upper - tubes > _LIMIT_TOLERANCE:
            wrong.append((limits.upper - tubes, telescope))
    if not wrong:
        return
    excess, each = max(wrong, key=lambda found: found[0])
    limits, tubes = description.joint(each.joint).limits, each.sleeve + each.rod
    problem = (
        f"come apart at {tubes:.6g} m, {excess:.3g} m before its upper limit {limits.upper:g} m"
        if math.isfinite(excess)
        else f"overlap by {each.overlap:g} m only below {tubes - each.overlap:.6g} m, before its lower limit "
        f"{limits.lower:g} m"
    )
    more = len(wrong) - 1
    others = "" if more == 0 else f" (as do those of {more} more telescope{'s' * (more > 1)})"
    document.warn(
        f"the tubes of joint {each.joint!r}, sleeve {each.sleeve:g} m and rod {each.rod:g} m, {problem}{others}: give "
        "longer tubes, or change the limits",
        each.line,
    )


def warn_about_configurations(description: Description, document: Document) -> None:
    """Warn of every named configuration that is outside the limits of joints, by the joint that is furthest outside."""
    joints = {joint.name: joint for joint in description.joints}
    for each in description.configurations:
        outside: list[tuple[float, Joint, float]] = []
        for name, value in each.values.items():
            if name not in joints:  # one of a joint of several coordinates, which have no bounds
                continue
            limits = joints[name].limits
            excess = max(limits.lower - value, value - limits.upper)
            if excess > _LIMIT_TOLERANCE:
                outside.append((excess, joints[name], value))
        if not outside:
            continue
        excess, joint, value = max(outside, key=lambda found: found[0])
        side, bound = ("lower", joint.limits.lower) if value < joint.limits.lower else ("upper", joint.limits.upper)
        others = f" ({len(outside) - 1} more outside theirs)" if len(outside) > 1 else ""
        unit = joint.unit
        document.warn(
            f"configuration {each.name!r} has joint {joint.name!r} at {value:.6g} {unit}, {excess:.3g} {unit} beyond "
            f"its {side} limit {bound:.6g} {unit}{others}: change the configuration or the limits",
            each.line,
        )
