"""What limits a pose of any leg, as named signed margins: its joints' limits, cones, telescopes and clearances.

The margins are functions of the closed tree coordinates. They are traced once, on symbols, and compiled: a pose costs
some ten nanoseconds.
"""

from __future__ import annotations

import difflib
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from leg_dynamics.errors import ParameterError, UnsupportedError

if TYPE_CHECKING:
    import casadi

    from leg_dynamics.description.model import Clearance, Cone, Description, Joint
    from leg_dynamics.kernels import Kernel

__all__ = [
    "Constraint",
    "ConstraintKernels",
    "MarginFormulas",
    "constraint_kernels",
    "constraints_of",
    "limit_numbers",
    "margin_formulas",
]

_SOURCES = ("analysis.workspace.constraints", "description")
"""What the kernels come from, beside the mechanism."""

KINDS = ("joint", "cone", "telescope", "clearance")

_SIDES = ("first", "second")
"""Of a clearance."""

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
    scales = _scales(description, limit_numbers(description))
    found: list[Constraint] = []

    def add(name: str, kind: str, unit: str, meaning: str, line: int | None) -> None:
        found.append(Constraint(name, kind, unit, float(scales[name]), meaning, line))

    for joint in _limited(description):
        limits = joint.limits
        for side, bound, sign in (("lower", limits.lower, ">="), ("upper", limits.upper, "<=")):
            if math.isfinite(bound):
                meaning = f"{joint.name} {sign} {bound:.6g} {joint.unit}"
                add(f"{joint.name} {side} limit", "joint", joint.unit, meaning, joint.line)
    for cone in description.cones:
        meaning = f"angle between an axis of {cone.link} and one of {cone.other_link} <= {cone.upper:.6g} rad"
        add(f"cone {cone.name}", "cone", "rad", meaning, cone.line)
    for telescope in description.telescopes:
        meaning = f"{telescope.sleeve:.6g} + {telescope.rod:.6g} m - {telescope.joint} >= {telescope.overlap:.6g} m"
        add(f"telescope {telescope.joint}", "telescope", "m", meaning, telescope.line)
    for clearance in description.clearances:
        meaning = f"capsules on {clearance.first.link} and {clearance.second.link} >= {clearance.minimum:.6g} m apart"
        add(f"clearance {clearance.name}", "clearance", "m", meaning, clearance.line)
    return found


def limit_numbers(description: Description) -> dict[str, float]:
    """Every number that the constraints are made of, by name, SI units.

    Limits of joints with one coordinate, places of all joints, cones with their axes at the length that the file gives
    them (only the direction counts, but the unit vector would be no affine function of a component), telescopes and
    clearances.
    """
    found: dict[str, float] = {}
    for joint in description.joints:
        if joint.is_single_coordinate:
            for side in ("lower", "upper"):
                bound = getattr(joint.limits, side)
                if math.isfinite(bound):
                    found[f"{joint.name}.{side}"] = bound
        found |= _components(f"{joint.name}.origin", joint.origin.xyz)
    if description.cones:
        axes = _cone_axes(description)
        for cone in description.cones:
            found[f"cone {cone.name}.upper"] = cone.upper
            for side, axis in zip(("axis", "other"), axes[cone.name], strict=True):
                found |= _components(f"cone {cone.name}.{side}", axis)
    for telescope in description.telescopes:
        for part in ("sleeve", "rod", "overlap"):
            found[f"telescope {telescope.joint}.{part}"] = getattr(telescope, part)
    for clearance in description.clearances:
        name = f"clearance {clearance.name}"
        found[f"{name}.minimum"] = clearance.minimum
        for side in _SIDES:
            segment = getattr(clearance, side)
            found[f"{name}.{side}.radius"] = segment.radius
            found |= _components(f"{name}.{side}.start", segment.start)
            found |= _components(f"{name}.{side}.end", segment.end)
    return found


def _components(name: str, values: Sequence[float]) -> dict[str, float]:
    return {f"{name}.{axis}": float(value) for axis, value in zip("xyz", values, strict=True)}


def _cone_axes(description: Description) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    # The text was validated when it was read: no entities, every element in place.
    found = {}
    for node in ET.fromstring(description.urdf).iter("cone"):
        texts = [axis.attrib["xyz"] for axis in node.iter("axis")]
        one, other = (tuple(float(part) for part in text.split()) for text in texts)
        found[node.attrib["name"]] = (one, other)
    return found


def _scales(description: Description, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """`Constraint.scale` by name, of numbers or of symbols for them."""
    found: dict[str, Any] = {}
    for joint in _limited(description):
        for side in ("lower", "upper"):
            if f"{joint.name}.{side}" in numbers:
                found[f"{joint.name} {side} limit"] = _half_range(joint.name, numbers)
    for cone in description.cones:
        found[f"cone {cone.name}"] = numbers[f"cone {cone.name}.upper"]
    for telescope in description.telescopes:
        found[f"telescope {telescope.joint}"] = _half_range(telescope.joint, numbers)
    for clearance in description.clearances:
        name = f"clearance {clearance.name}"
        # Capsules without radius are measured by their lengths.
        lengths = 0.0
        for side in _SIDES:
            squares = 0.0
            for axis in "xyz":
                squares += (numbers[f"{name}.{side}.end.{axis}"] - numbers[f"{name}.{side}.start.{axis}"]) ** 2
            lengths += squares**0.5
        found[name] = _first_positive(_gap(name, numbers), lengths, 1.0)
    return found


def _half_range(joint: str, numbers: Mapping[str, Any]) -> Any:
    low, high = numbers.get(f"{joint}.lower"), numbers.get(f"{joint}.upper")
    return 1.0 if low is None or high is None else _first_positive((high - low) / 2.0, 1.0)


def _gap(name: str, numbers: Mapping[str, Any]) -> Any:
    """Least distance of the axes of two capsules."""
    return numbers[f"{name}.first.radius"] + numbers[f"{name}.second.radius"] + numbers[f"{name}.minimum"]


def _first_positive(value: Any, *others: Any) -> Any:
    if not others:
        return value
    rest = _first_positive(*others)
    if isinstance(value, float | int):
        return value if value > 0.0 else rest
    import casadi

    return casadi.if_else(value > 0.0, value, rest)


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
        coordinates = {joint: tree[k] for k, joint in enumerate(names)}
        margins, scales = margin_formulas(description, limit_numbers(description), coordinates)
        result = casadi.vertcat(*build([margins[each] for each in wanted], [scales[each] for each in wanted]))
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


class MarginFormulas(NamedTuple):
    """Of every constraint, by the name that `constraints_of` gives it: its margin, and what to normalise that by."""

    margins: dict[str, Any]
    scales: dict[str, Any]


def margin_formulas(
    description: Description, numbers: Mapping[str, Any], coordinates: Mapping[str, Any]
) -> MarginFormulas:
    """Margins as formulas: of one mechanism, or of every one with the same joints and constraints.

    Parameters
    ----------
    description : Description
        Which joints, links and constraints there are, and how joints are turned; its numbers are not used.
    numbers : mapping of str to float or casadi.SX
        As `limit_numbers` names them; symbols where the formulas shall hold for other numbers too.
    coordinates : mapping of str to casadi.SX
        Tree coordinates by joint.

    Returns
    -------
    MarginFormulas

    Raises
    ------
    UnsupportedError
        A constraint needs a joint that the coordinates leave out, or one with several coordinates.
    """
    margins: dict[str, Any] = {}
    for joint in _limited(description):
        if joint.name not in coordinates:
            raise UnsupportedError(
                f"{joint.name!r} has limits, but this route does not compute its coordinate: load the leg by another "
                "route",
                joint=joint.name,
            )
        value = coordinates[joint.name]
        low, high = (numbers.get(f"{joint.name}.{side}") for side in ("lower", "upper"))
        if low is not None:
            margins[f"{joint.name} lower limit"] = value - low
        if high is not None:
            margins[f"{joint.name} upper limit"] = high - value
    places = _Places(description, numbers, coordinates)
    for cone in description.cones:
        margins[f"cone {cone.name}"] = _cone_margin(cone, numbers, places)
    for telescope in description.telescopes:
        name = f"telescope {telescope.joint}"
        length = numbers[f"{name}.sleeve"] + numbers[f"{name}.rod"] - numbers[f"{name}.overlap"]
        margins[name] = length - coordinates[telescope.joint]
    for clearance in description.clearances:
        margins[f"clearance {clearance.name}"] = _clearance_margin(clearance, numbers, places)
    return MarginFormulas(margins, _scales(description, numbers))


def _limited(description: Description) -> list[Joint]:
    return [
        joint
        for joint in description.joints
        if joint.is_single_coordinate and (math.isfinite(joint.limits.lower) or math.isfinite(joint.limits.upper))
    ]


def _vector(numbers: Mapping[str, Any], name: str) -> Any:
    import casadi

    return casadi.vertcat(*(numbers[f"{name}.{axis}"] for axis in "xyz"))


def _cone_margin(cone: Cone, numbers: Mapping[str, Any], places: _Places) -> Any:
    import casadi

    name = f"cone {cone.name}"
    (one, _), (other, _) = places.of(cone.link, cone.other_link)
    a, b = one @ _vector(numbers, f"{name}.axis"), other @ _vector(numbers, f"{name}.other")
    # atan2, because an arccosine loses half of the digits where the axes are nearly parallel
    return numbers[f"{name}.upper"] - casadi.atan2(_norm(casadi.cross(a, b)), casadi.dot(a, b))


def _clearance_margin(clearance: Clearance, numbers: Mapping[str, Any], places: _Places) -> Any:
    name = f"clearance {clearance.name}"
    ends = []
    poses = places.of(clearance.first.link, clearance.second.link)
    for side, (rotation, origin) in zip(_SIDES, poses, strict=True):
        ends += [rotation @ _vector(numbers, f"{name}.{side}.{end}") + origin for end in ("start", "end")]
    return _segment_distance(*ends) - _gap(name, numbers)


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


class _Places:
    """Poses of links on symbols."""

    def __init__(self, description: Description, numbers: Mapping[str, Any], coordinates: Mapping[str, Any]) -> None:
        self.description, self.numbers, self.coordinates = description, numbers, coordinates

    def of(self, first: str, second: str) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """Rotation and origin of two links in the frame of their nearest common ancestor."""
        paths = [self.description.path(link) for link in (first, second)]
        shared = 0
        for one, other in zip(*paths, strict=False):
            if one.name != other.name:
                break
            shared += 1
        one, other = (self._along(path[shared:]) for path in paths)
        return one, other

    def _along(self, path: Sequence[Joint]) -> tuple[Any, Any]:
        import casadi

        rotation, origin = casadi.SX.eye(3), casadi.SX.zeros(3)
        for joint in path:
            fixed = _chopped(joint.origin.rotation())
            origin = origin + rotation @ _vector(self.numbers, f"{joint.name}.origin")
            if joint.type == "fixed":
                rotation = rotation @ casadi.DM(fixed)
                continue
            if not joint.is_single_coordinate or joint.name not in self.coordinates:
                raise UnsupportedError(
                    f"joint {joint.name!r} is {joint.type}: constraints need joints of one coordinate"
                )
            value, axis = self.coordinates[joint.name], np.array(joint.axis)
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
