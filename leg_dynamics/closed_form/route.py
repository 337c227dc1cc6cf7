"""The closed-form route: the interface's array methods over a leg's formulas.

Any module of this package serves that has ``JOINT_NAMES``, ``TREE_JOINT_NAMES``, ``BRANCHES``, a
``from_urdf(description)`` whose result has ``gravity``, and the formulas

    tree_coordinates(leg, q) -> dict        foot_position(leg, q)           foot_jacobian(leg, q)
    foot_jacobian_derivative(leg, q, v)     foot_bias_acceleration(leg, q, v)
    foot_force_torque(leg, q, force)        mass_matrix(leg, q)             potential_energy(leg, q, gravity)
    inverse_dynamics(leg, q, v, a, gravity) bias(leg, q, v, gravity)        forward_dynamics(leg, q, v, f, gravity)
    inverse_kinematics(leg, p, branch)      with `q` and `margin` (m, negative outside the reach)

and, where it has models to choose between, ``OPTIONS`` (a mapping of names to allowed values, which `from_urdf` takes
as keywords); where it has singular configurations, ``singularity_margins(leg, q)`` (values that vanish there) with
``SINGULARITY_LIMIT``.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics import closed_form
from leg_dynamics.description.topology import actuated_joints
from leg_dynamics.errors import FormulaAssumptionError, OutOfReachError, RouteError, RowFailures, SingularityError

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description

__all__ = ["ClosedFormRoute"]

_BLOCK = 4096
"""Rows evaluated at a time: temporaries stay in the cache and the memory of a large batch stays bounded."""


def _shape(nested: Any) -> tuple[int, ...]:
    return (len(nested), *_shape(nested[0])) if isinstance(nested, tuple) else ()


def _fill(out: np.ndarray, nested: Any) -> None:
    if isinstance(nested, tuple):
        for index, part in enumerate(nested):
            _fill(out[:, index], part)
    else:
        out[...] = nested


class ClosedFormRoute:
    """Formulas of one leg with one file's numbers: immutable, safe to use from several threads.

    Arguments of the methods are finite float64 arrays, a sample (n,) or a batch (N, n), already broadcast against each
    other. A sample is evaluated on Python floats, a batch on arrays of components. Rows that cannot be computed are
    reported to `failures` and left NaN; `gravity` None is the file's.

    Parameters
    ----------
    formulas : str
        Name of a leg that `leg_dynamics.closed_form.find` knows.
    description : Description
        Where geometry, masses and inertias come from.
    **options
        Models that the formulas offer, for example ``transmission="paper"``; see the leg's ``OPTIONS``.

    Raises
    ------
    RouteError
        No formulas have that name, or they have no such option or value.
    FormulaAssumptionError
        The file breaks an assumption of the formulas.
    """

    name = "closed_form"
    has_foot = True

    def __init__(self, formulas: str, description: Description, **options: str) -> None:
        module = closed_form.find(formulas)
        if module is None:
            raise RouteError(f"there are no formulas of a leg called {formulas!r}; use route='pinocchio'")
        self.module: ModuleType = module
        offered = getattr(module, "OPTIONS", {})
        for option, value in options.items():
            if value not in offered.get(option, ()):
                choices = f"choose one of {', '.join(offered[option])}" if option in offered else "leave it out"
                raise RouteError(f"the formulas of {formulas!r} have no {option} {value!r}: {choices}")
        self.options = options
        self.numbers = module.from_urdf(description, **options)
        self.joint_names: tuple[str, ...] = tuple(module.JOINT_NAMES)
        self.tree_joint_names: tuple[str, ...] = tuple(module.TREE_JOINT_NAMES)
        self.branches: tuple[str, ...] = tuple(module.BRANCHES)
        self.gravity = np.array(self.numbers.gravity, dtype=np.float64)
        self.gravity.setflags(write=False)
        self.actuator_joints = actuated_joints(description)
        if sorted(self.actuator_joints) != sorted(self.joint_names):
            raise FormulaAssumptionError(
                f"{description.file}: the actuated joints are {', '.join(self.actuator_joints)}, but the formulas of "
                f"{formulas!r} need one actuator on each of {', '.join(self.joint_names)}; change the transmissions, "
                "or use route='pinocchio'",
                element="transmissions",
                found=self.actuator_joints,
                expected=self.joint_names,
                tolerance=None,
            )
        self._actuated = np.array([self.joint_names.index(name) for name in self.actuator_joints])

    def _apply(self, formula: Callable[..., Any], arguments: tuple[np.ndarray, ...]) -> np.ndarray:
        if arguments[0].ndim == 1:
            try:
                components = (tuple(argument.tolist()) for argument in arguments)
                return np.array(formula(self.numbers, *components), dtype=np.float64)
            except (ZeroDivisionError, OverflowError):
                return self._batch(formula, tuple(argument[None] for argument in arguments))[0]
        return self._batch(formula, arguments)

    def _batch(self, formula: Callable[..., Any], arguments: tuple[np.ndarray, ...]) -> np.ndarray:
        count = len(arguments[0])
        columns = [argument.T for argument in arguments]
        result: np.ndarray | None = None
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for start in range(0, max(count, 1), _BLOCK):
                rows = slice(start, min(start + _BLOCK, count))
                nested = formula(self.numbers, *(tuple(np.array(c[rows]) for c in column) for column in columns))
                if result is None:
                    result = np.empty((count, *_shape(nested)))
                _fill(result[rows], nested)
        assert result is not None
        return result

    def _evaluate(self, formula: Callable[..., Any], failures: RowFailures, *arguments: np.ndarray) -> np.ndarray:
        """Evaluate a formula whose first argument is q; rows at singular configurations fail.

        What overflows at a regular configuration is left as it is: the interface reports it.
        """
        result = self._apply(formula, arguments)
        if not hasattr(self.module, "singularity_margins"):
            return result
        margins = np.atleast_2d(self._apply(self.module.singularity_margins, arguments[:1])).min(axis=-1)
        rows = ~(margins >= self.module.SINGULARITY_LIMIT)
        if not rows.any():
            return result
        failing = np.flatnonzero(rows)
        first = np.atleast_2d(arguments[0])[failing[0]]
        pose = ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.joint_names, first, strict=True))
        failures.add(
            failing,
            SingularityError(
                f"the passive joints lose their direction at {pose} (singularity margin {margins[failing[0]]:.3g}): "
                "ask for a configuration further away from it",
                rows=failing,
                margin=margins[failing],
            ),
        )
        result[failing if arguments[0].ndim > 1 else ...] = np.nan
        return result

    def _gravity(self, gravity: np.ndarray | None, q: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.gravity, (*q.shape[:-1], 3)) if gravity is None else gravity

    def _with_foot_force(self, force: np.ndarray, q: np.ndarray, foot_force: np.ndarray | None) -> np.ndarray:
        """Add -J^T foot_force to the generalized force of a free foot."""
        return force if foot_force is None else force + self._apply(self.module.foot_force_torque, (q, foot_force))

    def tree_coordinates(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Tree joint coordinates that close every loop, (..., n_tree)."""
        names = self.tree_joint_names

        def in_order(numbers: Any, components: tuple[Any, ...]) -> tuple[Any, ...]:
            coordinates = self.module.tree_coordinates(numbers, components)
            return tuple(coordinates[name] for name in names)

        return self._evaluate(in_order, failures, q)

    def foot_position(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot position, (..., 3) m."""
        return self._evaluate(self.module.foot_position, failures, q)

    def foot_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot Jacobian, (..., 3, n)."""
        return self._evaluate(self.module.foot_jacobian, failures, q)

    def foot_jacobian_derivative(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Time derivative of the foot Jacobian, (..., 3, n)."""
        return self._evaluate(self.module.foot_jacobian_derivative, failures, q, v)

    def foot_bias_acceleration(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot acceleration at zero joint acceleration, (..., 3) m/s²."""
        return self._evaluate(self.module.foot_bias_acceleration, failures, q, v)

    def mass_matrix(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Mass matrix with the rotors, (..., n, n)."""
        return self._evaluate(self.module.mass_matrix, failures, q)

    def bias(self, q: np.ndarray, v: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Generalised force at zero acceleration, damping and friction included, (..., n)."""
        return self._evaluate(self.module.bias, failures, q, v, self._gravity(gravity, q))

    def potential_energy(self, q: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Potential energy of gravity, (...,) J."""
        return self._evaluate(self.module.potential_energy, failures, q, self._gravity(gravity, q))

    def generalized_force(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        foot_force: np.ndarray | None,
        gravity: np.ndarray | None,
        failures: RowFailures,
    ) -> np.ndarray:
        """Inverse dynamics at the independent coordinates, (..., n)."""
        force = self._evaluate(self.module.inverse_dynamics, failures, q, v, a, self._gravity(gravity, q))
        return self._with_foot_force(force, q, foot_force)

    def torque(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        foot_force: np.ndarray | None,
        gravity: np.ndarray | None,
        failures: RowFailures,
    ) -> np.ndarray:
        """Inverse dynamics at the actuators, (..., n) in their order."""
        return self.generalized_force(q, v, a, foot_force, gravity, failures)[..., self._actuated]

    def acceleration(
        self,
        q: np.ndarray,
        v: np.ndarray,
        tau: np.ndarray,
        foot_force: np.ndarray | None,
        gravity: np.ndarray | None,
        failures: RowFailures,
    ) -> np.ndarray:
        """Forward dynamics, (..., n)."""
        force = self._generalized(tau)
        if foot_force is not None:
            force = force - self._apply(self.module.foot_force_torque, (q, foot_force))
        return self._evaluate(self.module.forward_dynamics, failures, q, v, force, self._gravity(gravity, q))

    def _generalized(self, tau: np.ndarray) -> np.ndarray:
        force = np.empty_like(tau)
        force[..., self._actuated] = tau
        return force

    def inverse_kinematics(self, p: np.ndarray, branch: str, failures: RowFailures) -> np.ndarray:
        """Coordinates of one branch, (..., n), limits not considered; rows out of reach fail with their margin in m."""

        def solution(numbers: Any, components: tuple[Any, ...]) -> tuple[Any, ...]:
            found = self.module.inverse_kinematics(numbers, components, branch)
            return (*found.q, found.margin)

        rows = np.atleast_2d(self._apply(solution, (p,)))
        q, margin = rows[:, :-1], rows[:, -1]
        failing = np.flatnonzero(~(margin >= 0.0))
        if failing.size:
            point = ", ".join(f"{value:.6g}" for value in np.atleast_2d(p)[failing[0]])
            failures.add(
                failing,
                OutOfReachError(
                    f"the foot cannot reach ({point}) m: {-margin[failing[0]]:.3g} m are missing; move the point "
                    "inside the workspace",
                    rows=failing,
                    margin=margin[failing],
                ),
            )
            q[failing] = np.nan
        return q.reshape(*p.shape[:-1], len(self.joint_names))
