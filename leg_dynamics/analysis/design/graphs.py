"""One kernel for a pose of any design: its worst margin, condition number, det J and foot, numbers as inputs.

The margins are those of `leg_dynamics.analysis.workspace.constraints` with every number of a constraint a symbol, so
that thousands of designs share one piece of machine code; tests hold the two against each other.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.analysis.design.numbers import NumberMap
from leg_dynamics.analysis.dexterity import _conditioning_program
from leg_dynamics.analysis.workspace.constraints import _segment_distance, constraints_of

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description, Joint
    from leg_dynamics.kernels import Kernel
    from leg_dynamics.leg import Leg

__all__ = ["OUTPUTS", "PoseKernels"]

OUTPUTS = ("worst", "condition", "volume", "x", "y", "z")
"""Of a pose: the smallest normalised margin, k, det J (m^3 per the coordinates' units), the foot (m, hip frame)."""

_ROUNDING = 1e-15
_SAME_PLACE = 1e-6
"""m; a branch of the inverse kinematics whose foot is elsewhere belongs to another assembly mode."""


class PoseKernels:
    """Kernels of one leg and its designs.

    Parameters
    ----------
    leg : Leg
    numbers : NumberMap
        The kernels' input ``numbers`` is what it returns, (K,).
    scales : (3,) array
        Factors of the Jacobian's columns, in the order of the coordinates.
    ignore : tuple of str
        Names or kinds of constraints to leave out.

    Attributes
    ----------
    poses : Kernel
        (q (3,), numbers (K,)) -> `OUTPUTS`.
    feet : mapping of str to Kernel
        By branch of the inverse kinematics: (foot (3,), numbers (K,)) -> `OUTPUTS` and the coordinates (3,) beside
        them.
    """

    def __init__(self, leg: Leg, numbers: NumberMap, scales: np.ndarray, ignore: tuple[str, ...]) -> None:
        from leg_dynamics.kernels import kernel
        from leg_dynamics.kernels.cache import key_of, source_fingerprint

        self.leg, self.numbers, self.scales = leg, numbers, scales
        self.wanted = [each.name for each in constraints_of(leg.description, ignore)]
        backend: Any = leg.backend
        rooms = (source_fingerprint(f"leg_dynamics.{room}") for room in ("analysis", "description"))
        made_from = key_of(backend.kernels.ingredients, repr((numbers.names, self.wanted, scales.tolist())), *rooms)
        self.poses: Kernel = kernel("design_pose", key_of(made_from, "pose"), self._pose_program)
        self.feet: Mapping[str, Kernel] = {
            branch: kernel(
                "design_foot", key_of(made_from, "foot", branch), functools.partial(self._foot_program, branch)
            )
            for branch in leg.branches
        }

    def _route_values(self, symbols: Any) -> tuple[tuple[str, ...], Any]:
        import casadi

        rows = [k for k, name in enumerate(self.numbers.names) if name.startswith("route ")]
        vary = tuple(self.numbers.names[k].removeprefix("route ") for k in rows)
        return vary, casadi.vertcat(*(symbols[k] for k in rows))

    def _pose_graph(self, q: Any, symbols: Any) -> tuple[Any, Any]:
        """Outputs and guards on symbols."""
        import casadi

        backend: Any = self.leg.backend
        vary, values = self._route_values(symbols)

        def formula(name: str) -> tuple[Any, Any]:
            return backend.kernels.program(name, vary).formula(q, values)

        (tree, guards), (foot, _), (jacobian, _) = map(formula, ("tree_coordinates", "foot_position", "foot_jacobian"))
        coordinates = {name: tree[k] for k, name in enumerate(self.leg.tree_joint_names)}
        known = dict(zip(self.numbers.names, (symbols[k] for k in range(symbols.numel())), strict=True))
        worst = casadi.SX(np.inf)
        for name, (margin, scale) in _margins(self.leg.description, known, coordinates).items():
            if name in self.wanted:
                worst = margin / scale if worst.is_constant() else casadi.fmin(worst, margin / scale)
        if worst.is_constant():  # nothing limits the leg; infinity would fail the row
            worst = casadi.SX(1.0)
        smallest, largest, determinant = casadi.vertsplit(
            _conditioning_program().formula(jacobian, casadi.SX(casadi.DM(self.scales)))[0]
        )
        return casadi.vertcat(worst, largest / smallest, determinant, foot), guards

    def _pose_program(self) -> Any:
        import casadi

        from leg_dynamics.kernels import Argument, Program

        q, symbols = casadi.SX.sym("q", 3), casadi.SX.sym("numbers", len(self.numbers.names))
        graph = casadi.Function("design_pose", [q, symbols], casadi.cse(list(self._pose_graph(q, symbols))))
        arguments = (Argument("q", (3,)), Argument("numbers", (len(self.numbers.names),)))
        return Program("design_pose", arguments, (Argument("pose", (len(OUTPUTS),)),), graph)

    def _foot_program(self, branch: str) -> Any:
        import casadi

        from leg_dynamics.kernels import Argument, Program

        backend: Any = self.leg.backend
        p, symbols = casadi.SX.sym("p", 3), casadi.SX.sym("numbers", len(self.numbers.names))
        vary, values = self._route_values(symbols)
        q, reach = backend.kernels.program("inverse_kinematics", vary, branch).formula(p, values)
        outputs, guards = self._pose_graph(q, symbols)
        away = casadi.mmax(casadi.fabs(outputs[3:6] - p))
        outputs = casadi.vertcat(outputs, q)
        outputs[0] = casadi.if_else(away < _SAME_PLACE, outputs[0], -1.0)
        graph = casadi.Function("design_foot", [p, symbols], casadi.cse([outputs, casadi.vertcat(reach, guards)]))
        arguments = (Argument("p", (3,)), Argument("numbers", (len(self.numbers.names),)))
        return Program("design_foot", arguments, (Argument("pose", (len(OUTPUTS) + 3,)),), graph)


def _margins(
    description: Description, known: Mapping[str, Any], coordinates: Mapping[str, Any]
) -> dict[str, tuple[Any, Any]]:
    """Margin and scale of every constraint, by the name that `constraints_of` gives it."""
    import casadi

    found: dict[str, tuple[Any, Any]] = {}
    for joint in description.joints:
        low, high = known.get(f"{joint.name}.lower"), known.get(f"{joint.name}.upper")
        if joint.name not in coordinates or (low is None and high is None):
            continue
        scale = _range(low, high)
        if low is not None:
            found[f"{joint.name} lower limit"] = (coordinates[joint.name] - low, scale)
        if high is not None:
            found[f"{joint.name} upper limit"] = (high - coordinates[joint.name], scale)
    place = _Places(description, known, coordinates)
    for cone in description.cones:
        name = f"cone {cone.name}"
        first, second = place.of(cone.link, cone.other_link)
        a, b = first[0] @ _vector(known, f"{name}.axis"), second[0] @ _vector(known, f"{name}.other")
        angle = casadi.atan2(casadi.sqrt(casadi.sumsqr(casadi.cross(a, b))), casadi.dot(a, b))
        found[name] = (known[f"{name}.upper"] - angle, known[f"{name}.upper"])
    for telescope in description.telescopes:
        name = f"telescope {telescope.joint}"
        length = known[f"{name}.sleeve"] + known[f"{name}.rod"] - known[f"{name}.overlap"]
        limits = (known.get(f"{telescope.joint}.{side}") for side in ("lower", "upper"))
        found[name] = (length - coordinates[telescope.joint], _range(*limits))
    for clearance in description.clearances:
        name = f"clearance {clearance.name}"
        poses = place.of(clearance.first.link, clearance.second.link)
        ends = []
        for side, (rotation, origin) in zip(("first", "second"), poses, strict=True):
            ends += [rotation @ _vector(known, f"{name}.{side}.{end}") + origin for end in ("start", "end")]
        apart = known[f"{name}.first.radius"] + known[f"{name}.second.radius"] + known[f"{name}.minimum"]
        # Without radii the scale is arbitrary; a metre does, since only the sign of the worst margin counts here.
        found[name] = (_segment_distance(*ends) - apart, casadi.if_else(apart > 0.0, apart, 1.0))
    return found


def _range(low: Any, high: Any) -> Any:
    return 1.0 if low is None or high is None else (high - low) / 2.0


def _vector(known: Mapping[str, Any], name: str) -> Any:
    import casadi

    return casadi.vertcat(*(known[f"{name}.{axis}"] for axis in "xyz"))


class _Places:
    """Poses of links on symbols."""

    def __init__(self, description: Description, known: Mapping[str, Any], coordinates: Mapping[str, Any]) -> None:
        self.description, self.known, self.coordinates = description, known, coordinates

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
            origin = origin + rotation @ _vector(self.known, f"{joint.name}.origin")
            rotation = rotation @ _constant(joint.origin.rotation())
            if joint.type == "fixed":
                continue
            value, axis = self.coordinates[joint.name], np.array(joint.axis)
            if joint.type == "prismatic":
                origin = origin + rotation @ casadi.DM(axis) * value
                continue
            x, y, z = axis
            along, cross = np.outer(axis, axis), np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            still, turning, turned = map(_constant, (along, cross, np.eye(3) - along))
            rotation = rotation @ (still + casadi.sin(value) * turning + casadi.cos(value) * turned)
        return rotation, origin


def _constant(matrix: np.ndarray) -> Any:
    import casadi

    return casadi.sparsify(casadi.DM(np.where(np.abs(matrix) < _ROUNDING, 0.0, matrix)))
