"""What limits a pose of any leg, as named signed margins: its joints' limits, cones, telescopes and clearances.

The margins are functions of the closed tree coordinates. They are traced once, on symbols, and compiled: a pose costs
some ten nanoseconds.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from leg_dynamics.errors import ParameterError, UnsupportedError

if TYPE_CHECKING:
    import casadi

    from leg_dynamics.description.model import Clearance, Cone, Description, Joint, Segment
    from leg_dynamics.kernels import Kernel

__all__ = ["Constraint", "ConstraintKernels", "constraint_kernels", "constraints_of"]

_SOURCES = ("analysis.workspace.constraints", "description")
"""What the kernels come from, beside the mechanism."""

KINDS = ("joint", "cone", "telescope", "clearance")

_ROUNDING = 1e-15
"""Entries of a rotation matrix below this are the rounding of roll, pitch, yaw; as zeros they cost nothing."""


@dataclass(frozen=True)
class Constraint:
    """One inequality margin >= 0.

    Attributes
    ----------
    name : str
        For example ``l1 lower limit``, ``cone ball_3``.
    kind : str
        ``joint``, ``cone``, ``telescope`` or ``clearance``.
    unit : str
        Of the margin: ``rad`` or ``m``.
    scale : float
        Normalised margin = margin / scale: half a joint's range (1 rad or 1 m where it has one end only), a cone's
        half-angle, a telescope's joint's half range, a clearance's sum of radii.
    meaning : str
        The inequality in words.
    line : int or None
        Where the file states it.
    """

    name: str
    kind: str
    unit: str
    scale: float
    meaning: str
    line: int | None = None


class ConstraintKernels(NamedTuple):
    """Compiled margins: `margins` maps tree coordinates (nt,) to all K margins; `worst` to three numbers.

    The three are the smallest normalised margin, that constraint's margin in its own unit, and its index.
    """

    margins: Kernel
    worst: Kernel


def constraints_of(description: Description, ignore: Iterable[str] = ()) -> tuple[Constraint, ...]:
    """Every constraint of a mechanism, in the order of the margins.

    Parameters
    ----------
    description : Description
        Joint limits of all tree joints with one coordinate, independent and passive, then cones, telescopes and
        clearances (see `leg_dynamics.description.constraints`).
    ignore : iterable of str
        Names or kinds of constraints to leave out.

    Returns
    -------
    tuple of Constraint

    Raises
    ------
    ParameterError
        There is no constraint of that name or kind.
    """
    every, left_out = _every_constraint(description), tuple(ignore)
    known = [*KINDS, *(each.name for each in every)]
    for word in left_out:
        if word not in known:
            near = difflib.get_close_matches(str(word), known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ParameterError(
                f"{description.name!r} has no constraint {word!r} to ignore{hint} (kinds: {', '.join(KINDS)})",
                name=word,
            )
    return tuple(each for each in every if not {each.name, each.kind} & set(left_out))


def _every_constraint(description: Description) -> list[Constraint]:
    found: list[Constraint] = []
    for joint in _limited(description):
        scale, limits = _joint_scale(joint), joint.limits
        for side, bound, sign in (("lower", limits.lower, ">="), ("upper", limits.upper, "<=")):
            if math.isfinite(bound):
                meaning = f"{joint.name} {sign} {bound:.6g} {joint.unit}"
                found.append(Constraint(f"{joint.name} {side} limit", "joint", joint.unit, scale, meaning, joint.line))
    for cone in description.cones:
        meaning = f"angle between an axis of {cone.link} and one of {cone.other_link} <= {cone.upper:.6g} rad"
        found.append(Constraint(f"cone {cone.name}", "cone", "rad", cone.upper, meaning, cone.line))
    for telescope in description.telescopes:
        scale = _joint_scale(description.joint(telescope.joint))
        meaning = f"{telescope.sleeve:.6g} + {telescope.rod:.6g} m - {telescope.joint} >= {telescope.overlap:.6g} m"
        found.append(Constraint(f"telescope {telescope.joint}", "telescope", "m", scale, meaning, telescope.line))
    for clearance in description.clearances:
        meaning = f"capsules on {clearance.first.link} and {clearance.second.link} >= {clearance.minimum:.6g} m apart"
        scale = _clearance_scale(clearance)
        found.append(Constraint(f"clearance {clearance.name}", "clearance", "m", scale, meaning, clearance.line))
    return found


def constraint_kernels(
    description: Description, tree_joint_names: Sequence[str], constraints: Sequence[Constraint]
) -> ConstraintKernels:
    """Compile the margins of a mechanism, or fetch them from the cache.

    Parameters
    ----------
    description : Description
    tree_joint_names : sequence of str
        Order of the tree coordinates.
    constraints : sequence of Constraint
        At least one, of `constraints_of`.

    Raises
    ------
    UnsupportedError
        A constraint needs a joint that the coordinates leave out, or one with several coordinates.
    """
    from leg_dynamics.kernels import kernel
    from leg_dynamics.kernels.cache import key_of, source_fingerprint

    sources = (source_fingerprint(f"leg_dynamics.{place}") for place in _SOURCES)
    names = [each.name for each in constraints]
    made_from = key_of(description.urdf, repr((tuple(tree_joint_names), names)), *sources)
    kernels = []
    for name, build in (("constraint_margins", _all_margins), ("worst_constraint", _worst_margin)):
        builder = _builder(name, build, description, tree_joint_names, names)
        kernels.append(kernel(name, key_of(made_from, name), builder))
    return ConstraintKernels(*kernels)


def _builder(name: str, build: Any, description: Description, names: Sequence[str], wanted: Sequence[str]) -> Any:
    def program() -> Any:
        import casadi

        from leg_dynamics.kernels import Argument, Program

        tree = casadi.SX.sym("tree", len(names))
        margins = _margins(description, {joint: tree[k] for k, joint in enumerate(names)})
        found = dict(zip((each.name for each in constraints_of(description)), margins, strict=True))
        scales = {each.name: each.scale for each in constraints_of(description)}
        result = casadi.vertcat(*build([found[each] for each in wanted], [scales[each] for each in wanted]))
        graph = casadi.Function(name, [tree], casadi.cse([result, casadi.SX(0, 1)]))
        return Program(name, (Argument("tree", (len(names),)),), (Argument(name, (result.numel(),)),), graph)

    return program


def _all_margins(margins: list[Any], scales: list[float]) -> list[Any]:
    return margins


def _worst_margin(margins: list[Any], scales: list[float]) -> list[Any]:
    import casadi

    worst, raw, index = margins[0] / scales[0], margins[0], casadi.SX(0)
    for k in range(1, len(margins)):
        normalised = margins[k] / scales[k]
        smaller = normalised < worst
        raw = casadi.if_else(smaller, margins[k], raw)
        index = casadi.if_else(smaller, k, index)
        worst = casadi.fmin(worst, normalised)
    return [worst, raw, index]


def _margins(description: Description, coordinates: dict[str, Any]) -> list[Any]:
    """Margins on symbols, in the order of `constraints_of`."""
    margins: list[Any] = []
    for joint in _limited(description):
        if joint.name not in coordinates:
            raise UnsupportedError(
                f"{joint.name!r} has limits, but this route does not compute its coordinate: load the leg by another "
                "route",
                joint=joint.name,
            )
        value = coordinates[joint.name]
        if math.isfinite(joint.limits.lower):
            margins.append(value - joint.limits.lower)
        if math.isfinite(joint.limits.upper):
            margins.append(joint.limits.upper - value)
    margins += [_cone_margin(description, cone, coordinates) for cone in description.cones]
    for telescope in description.telescopes:
        margins.append(telescope.sleeve + telescope.rod - telescope.overlap - coordinates[telescope.joint])
    margins += [_clearance_margin(description, clearance, coordinates) for clearance in description.clearances]
    return margins


def _limited(description: Description) -> list[Joint]:
    return [
        joint
        for joint in description.joints
        if joint.is_single_coordinate and (math.isfinite(joint.limits.lower) or math.isfinite(joint.limits.upper))
    ]


def _joint_scale(joint: Joint) -> float:
    half = (joint.limits.upper - joint.limits.lower) / 2.0
    return half if math.isfinite(half) and half > 0.0 else 1.0


def _clearance_scale(clearance: Clearance) -> float:
    ends = (clearance.first, clearance.second)
    radii = sum(segment.radius for segment in ends) + clearance.minimum
    return radii or sum(math.dist(segment.start, segment.end) for segment in ends) or 1.0


def _cone_margin(description: Description, cone: Cone, coordinates: dict[str, Any]) -> Any:
    import casadi

    first, second = _relative_poses(description, cone.link, cone.other_link, coordinates)
    a, b = (pose[0] @ casadi.DM(axis) for pose, axis in ((first, cone.axis), (second, cone.other_axis)))
    # atan2, because an arccosine loses half of the digits where the axes are nearly parallel
    return cone.upper - casadi.atan2(_norm(casadi.cross(a, b)), casadi.dot(a, b))


def _clearance_margin(description: Description, clearance: Clearance, coordinates: dict[str, Any]) -> Any:
    import casadi

    one, other = clearance.first, clearance.second
    poses = _relative_poses(description, one.link, other.link, coordinates)

    def ends(segment: Segment, pose: Any) -> tuple[Any, Any]:
        rotation, origin = pose
        return tuple(rotation @ casadi.DM(point) + origin for point in (segment.start, segment.end))

    distance = _segment_distance(*ends(one, poses[0]), *ends(other, poses[1]))
    return distance - (one.radius + other.radius + clearance.minimum)


def _segment_distance(p0: Any, p1: Any, r0: Any, r1: Any) -> Any:
    """Distance of two segments without branches: the least of four end-to-segment distances and an inner one."""
    import casadi

    d, e, w = p1 - p0, r1 - r0, p0 - r0
    a, b, c = casadi.dot(d, d), casadi.dot(d, e), casadi.dot(e, e)
    f, g = casadi.dot(d, w), casadi.dot(e, w)
    tiny = 1e-300
    # The nearest points of the two lines, clamped: of any two points on the segments the distance is not less than
    # the segments', so that parallel lines, where these points are arbitrary, do no harm.
    determinant = casadi.fmax(a * c - b * b, tiny)
    s = _clamped((b * g - c * f) / determinant)
    t = _clamped((a * g - b * f) / determinant)
    squares = [casadi.sumsqr(w + s * d - t * e)]
    for point, origin, along, length in ((p0, r0, e, c), (p1, r0, e, c), (r0, p0, d, a), (r1, p0, d, a)):
        reach = _clamped(casadi.dot(point - origin, along) / casadi.fmax(length, tiny))
        squares.append(casadi.sumsqr(point - origin - reach * along))
    least = squares[0]
    for square in squares[1:]:
        least = casadi.fmin(least, square)
    return casadi.sqrt(least)


def _clamped(value: Any) -> Any:
    import casadi

    return casadi.fmin(casadi.fmax(value, 0.0), 1.0)


def _norm(vector: Any) -> Any:
    import casadi

    return casadi.sqrt(casadi.sumsqr(vector))


def _relative_poses(
    description: Description, first: str, second: str, coordinates: dict[str, Any]
) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """Rotation and origin of two links in the frame of their nearest common ancestor."""
    paths = [description.path(link) for link in (first, second)]
    shared = 0
    for one, other in zip(*paths, strict=False):
        if one.name != other.name:
            break
        shared += 1
    one, other = (_pose(path[shared:], coordinates) for path in paths)
    return one, other


def _pose(path: Sequence[Joint], coordinates: dict[str, Any]) -> tuple[Any, Any]:
    import casadi

    rotation, origin = casadi.SX.eye(3), casadi.SX.zeros(3)
    for joint in path:
        fixed = _chopped(joint.origin.rotation())
        origin = origin + rotation @ casadi.DM(joint.origin.xyz)
        if joint.type == "fixed":
            rotation = rotation @ casadi.DM(fixed)
            continue
        if not joint.is_single_coordinate or joint.name not in coordinates:
            raise UnsupportedError(f"joint {joint.name!r} is {joint.type}: constraints need joints of one coordinate")
        value, axis = coordinates[joint.name], np.array(joint.axis)
        if joint.type == "prismatic":
            rotation = rotation @ casadi.DM(fixed)
            origin = origin + rotation @ casadi.DM(axis) * value
        else:
            x, y, z = axis
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            along = np.outer(axis, axis)
            sine, cosine = casadi.sin(value), casadi.cos(value)
            parts = (_chopped(fixed @ part) for part in (along, cross, np.eye(3) - along))
            still, turning, turned = map(_sparse, parts)
            rotation = rotation @ (still + sine * turning + cosine * turned)
    return rotation, origin


def _chopped(matrix: np.ndarray) -> np.ndarray:
    return np.where(np.abs(matrix) < _ROUNDING, 0.0, matrix)


def _sparse(matrix: np.ndarray) -> casadi.DM:
    import casadi

    return casadi.sparsify(casadi.DM(matrix))
