"""One kernel for a pose of any design: its worst margin, condition number, det J and foot, numbers as inputs.

The margins are those of `leg_dynamics.analysis.workspace.constraints` with every number of a constraint a symbol, so
that thousands of designs share one piece of machine code.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.analysis.design.numbers import NumberMap
from leg_dynamics.analysis.dexterity import conditioning_program
from leg_dynamics.analysis.workspace.constraints import constraints_of, margin_formulas

if TYPE_CHECKING:
    from leg_dynamics.kernels import Kernel
    from leg_dynamics.leg import Leg

__all__ = ["OUTPUTS", "PoseKernels"]

OUTPUTS = ("worst", "condition", "volume", "x", "y", "z")
"""Of a pose: the smallest normalised margin, k, det J (m^3 per the coordinates' units), the foot (m, hip frame)."""

_SOURCES = ("analysis.design.graphs", "analysis.dexterity", "analysis.workspace.constraints", "description")
"""What the kernels come from, beside the leg's formulas."""

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
    wanted : list of str
        Names of the constraints.
    """

    def __init__(self, leg: Leg, numbers: NumberMap, scales: np.ndarray, ignore: tuple[str, ...]) -> None:
        from leg_dynamics.kernels import kernel
        from leg_dynamics.kernels.cache import key_of, source_fingerprint

        self.leg, self.numbers, self.scales = leg, numbers, scales
        self.wanted = [each.name for each in constraints_of(leg.description, ignore)]
        backend: Any = leg.backend
        sources = (source_fingerprint(f"leg_dynamics.{place}") for place in _SOURCES)
        self._made_from = made_from = key_of(
            backend.kernels.ingredients, repr((numbers.names, self.wanted, scales.tolist())), *sources
        )
        self.poses: Kernel = kernel("design_pose", key_of(made_from, "pose"), self._pose_program)
        self.feet: Mapping[str, Kernel] = {
            branch: kernel(
                "design_foot", key_of(made_from, "foot", branch), functools.partial(self._foot_program, branch)
            )
            for branch in leg.branches
        }

    @functools.cached_property
    def margins(self) -> Kernel:
        """(q (3,), numbers (K,)) -> margins of all constraints and what they are normalised by, (2 C,)."""
        from leg_dynamics.kernels import kernel
        from leg_dynamics.kernels.cache import key_of

        return kernel("design_margins", key_of(self._made_from, "margins"), self._margins_program)

    def _margins_program(self) -> Any:
        import casadi

        from leg_dynamics.kernels import Argument, Program

        backend: Any = self.leg.backend
        q, symbols = casadi.SX.sym("q", 3), casadi.SX.sym("numbers", len(self.numbers.names))
        vary, values = self._route_values(symbols)
        tree, _ = backend.kernels.program("tree_coordinates", vary).formula(q, values)
        margins, scales = self._margin_graphs(tree, symbols)
        outputs = casadi.vertcat(*(margins[name] for name in self.wanted), *(scales[name] for name in self.wanted))
        graph = casadi.Function("design_margins", [q, symbols], casadi.cse([outputs, casadi.SX(0, 1)]))
        arguments = (Argument("q", (3,)), Argument("numbers", (len(self.numbers.names),)))
        return Program("design_margins", arguments, (Argument("margins", (2 * len(self.wanted),)),), graph)

    def _margin_graphs(self, tree: Any, symbols: Any) -> Any:
        coordinates = {name: tree[k] for k, name in enumerate(self.leg.tree_joint_names)}
        known = dict(zip(self.numbers.names, (symbols[k] for k in range(symbols.numel())), strict=True))
        return margin_formulas(self.leg.description, known, coordinates)

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
        worst = casadi.SX(np.inf)
        margins, scales = self._margin_graphs(tree, symbols)
        for name in self.wanted:
            normalised = margins[name] / scales[name]
            worst = normalised if worst.is_constant() else casadi.fmin(worst, normalised)
        if worst.is_constant():  # nothing limits the leg; infinity would fail the row
            worst = casadi.SX(1.0)
        smallest, largest, determinant = casadi.vertsplit(
            conditioning_program().formula(jacobian, casadi.SX(casadi.DM(self.scales)))[0]
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
