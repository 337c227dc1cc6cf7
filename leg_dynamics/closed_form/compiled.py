"""A leg's formulas as kernels: each is traced on symbols, as it stands, and compiled when first asked for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from leg_dynamics.closed_form.numbers import named_numbers, with_numbers
from leg_dynamics.errors import ParameterError
from leg_dynamics.kernels import Argument, Kernel, Program, kernel
from leg_dynamics.kernels.cache import key_of

if TYPE_CHECKING:
    import casadi

__all__ = ["FORMULAS", "Formula", "FormulaKernels", "complete", "in_tree_order"]


class Formula(NamedTuple):
    """What a kernel computes: its inputs by name, and the function (module, leg, components ...) of nested tuples."""

    inputs: tuple[str, ...]
    function: Callable[..., Any]
    effort: str = ""
    """``output`` or the input that is in the order of the actuators, not of the coordinates."""


def _reduced(module: ModuleType, name: str) -> Callable[..., Any]:
    """The formula with inertia reduced to composite parameters, where the leg has one."""
    composite = getattr(module, f"composite_{name}", None)
    if composite is None:
        return getattr(module, name)
    return lambda leg, *components: composite(leg, module.composite_parameters(leg), *components)


def _loaded(module: ModuleType, leg: Any, q: Any, v: Any, a: Any, force: Any, gravity: Any) -> Any:
    if hasattr(module, "composite_inverse_dynamics"):
        return module.composite_inverse_dynamics(leg, module.composite_parameters(leg), q, v, a, gravity, force)
    free = module.inverse_dynamics(leg, q, v, a, gravity)
    return tuple(x + y for x, y in zip(free, module.foot_force_torque(leg, q, force), strict=True))


def _unloaded(module: ModuleType, leg: Any, q: Any, v: Any, a: Any) -> Any:
    return _reduced(module, "inverse_dynamics")(leg, q, v, a, leg.gravity)


def _accelerated(module: ModuleType, leg: Any, q: Any, v: Any, force_of_joints: Any, force: Any, gravity: Any) -> Any:
    if hasattr(module, "composite_forward_dynamics"):
        parameters = module.composite_parameters(leg)
        return module.composite_forward_dynamics(leg, parameters, q, v, force_of_joints, gravity, force)
    push = module.foot_force_torque(leg, q, force)
    free = tuple(x - y for x, y in zip(force_of_joints, push, strict=True))
    return module.forward_dynamics(leg, q, v, free, gravity)


def in_tree_order(module: ModuleType, leg: Any, q: Any) -> Any:
    """Tree coordinates as a tuple, in the order of ``TREE_JOINT_NAMES``."""
    coordinates = module.tree_coordinates(leg, q)
    return tuple(coordinates[name] for name in module.TREE_JOINT_NAMES)


def _plain(name: str, *inputs: str, reduced: bool = False, effort: str = "") -> Formula:
    def function(module: ModuleType, leg: Any, *components: Any) -> Any:
        formula = _reduced(module, name) if reduced else getattr(module, name)
        return formula(leg, *components)

    return Formula(inputs, function, effort)


FORMULAS: dict[str, Formula] = {
    "tree_coordinates": Formula(("q",), in_tree_order),
    "foot_position": _plain("foot_position", "q"),
    "foot_jacobian": _plain("foot_jacobian", "q"),
    "foot_jacobian_derivative": _plain("foot_jacobian_derivative", "q", "v"),
    "foot_bias_acceleration": _plain("foot_bias_acceleration", "q", "v"),
    "mass_matrix": _plain("mass_matrix", "q", reduced=True),
    "bias": _plain("bias", "q", "v", "gravity", reduced=True),
    "potential_energy": _plain("potential_energy", "q", "gravity", reduced=True),
    "generalized_force": Formula(("q", "v", "a", "foot_force", "gravity"), _loaded),
    "torque": Formula(("q", "v", "a"), _unloaded, effort="output"),
    "loaded_torque": Formula(("q", "v", "a", "foot_force", "gravity"), _loaded, effort="output"),
    "regressor": _plain("regressor", "q", "v", "a", "gravity", effort="output"),
    "acceleration": Formula(("q", "v", "tau", "foot_force", "gravity"), _accelerated, effort="tau"),
}
"""Kernels by name; ``torque`` has the file's gravity and no force on the foot."""


DERIVATIVES: dict[str, tuple[str, tuple[str, ...]]] = {
    "torque_derivatives": ("loaded_torque", ("q", "v", "a")),
    "acceleration_derivatives": ("acceleration", ("q", "v", "tau")),
}
"""Kernels of derivatives: the formula and its inputs that they are taken by, their columns side by side."""


class FormulaKernels:
    """The compiled formulas of one leg.

    Parameters
    ----------
    module : module
        The leg's formulas.
    leg : object
        Its numbers.
    actuated : tuple of int
        The coordinate that each actuator drives.
    ingredients : str
        Digest of everything that `module` and `leg` come from.
    """

    def __init__(self, module: ModuleType, leg: Any, actuated: tuple[int, ...], ingredients: str) -> None:
        self.module = module
        self.leg = leg
        self.actuated = actuated
        self.ingredients = ingredients
        self._kernels: dict[tuple[str, ...], Kernel] = {}
        self._lock = threading.Lock()

    def get(self, name: str, vary: Sequence[str] = (), branch: str | None = None) -> Kernel:
        """Return a kernel.

        Parameters
        ----------
        name : str
            One of `FORMULAS` or `DERIVATIVES`, or ``inverse_kinematics``.
        vary : sequence of str
            Names of numbers (see `named_numbers`) that become a last input ``parameters`` instead of constants; for
            derivatives, the numbers that further columns are taken by, at their values.
        branch : str, optional
            Of the inverse kinematics.
        """
        key = (name, branch or "", *vary)
        found = self._kernels.get(key)
        if found is None:
            made = kernel(name, key_of(self.ingredients, *key), lambda: self.program(name, vary, branch))
            with self._lock:
                found = self._kernels.setdefault(key, made)
        return found

    def program(self, name: str, vary: Sequence[str] = (), branch: str | None = None) -> Program:
        """Trace a formula; arguments as for `get`.

        Raises
        ------
        ParameterError
            There is no formula `name`, or `vary` has an unknown name.
        """
        if name == "inverse_kinematics":
            return self._inverse_kinematics(branch, vary)
        if name in DERIVATIVES:
            return self._derivatives(name, vary)
        formula = FORMULAS.get(name)
        if formula is None or not self._is_there(name):
            known = sorted(known for known in FORMULAS if self._is_there(known))
            listing = ", ".join([*known, *sorted(DERIVATIVES), "inverse_kinematics"])
            raise ParameterError(f"there is no formula {name!r} of this leg: choose one of {listing}", parameter=name)

        def traced(leg: Any, symbols: Sequence[Any]) -> tuple[Any, list[Any]]:
            values = [
                self._by_coordinate(symbol) if label == formula.effort else symbol
                for label, symbol in zip(formula.inputs, symbols, strict=True)
            ]
            result = formula.function(self.module, leg, *values)
            if formula.effort == "output":
                result = tuple(result[coordinate] for coordinate in self.actuated)
            return result, self._margins(leg, symbols[0])

        return self._trace(name, formula.inputs, traced, vary)

    def _is_there(self, name: str) -> bool:
        """Whether the leg's module has the formula; only the regressor may be missing."""
        return name != "regressor" or hasattr(self.module, name)

    def _by_coordinate(self, efforts: Sequence[Any]) -> tuple[Any, ...]:
        return tuple(efforts[self.actuated.index(coordinate)] for coordinate in range(len(efforts)))

    def _margins(self, leg: Any, q: Any) -> list[Any]:
        if not hasattr(self.module, "singularity_margins"):
            return []
        return [margin - self.module.SINGULARITY_LIMIT for margin in self.module.singularity_margins(leg, q)]

    def _inverse_kinematics(self, branch: str | None, vary: Sequence[str]) -> Program:
        chosen = self.module.BRANCHES[0] if branch is None else branch

        def traced(leg: Any, symbols: Sequence[Any]) -> tuple[Any, list[Any]]:
            found = self.module.inverse_kinematics(leg, symbols[0], chosen)
            return found.q, [found.margin]

        return self._trace("inverse_kinematics", ("p",), traced, vary)

    def _derivatives(self, name: str, vary: Sequence[str]) -> Program:
        """Columns of the formula's Jacobian by its arguments and by some of the leg's numbers."""
        import casadi

        from leg_dynamics.kernels import differentiated

        formula, arguments = DERIVATIVES[name]
        plain = self.program(formula, vary)
        by = [*arguments, "parameters"] if vary else list(arguments)
        known = self.numbers()
        fixed = {"parameters": [known[number] for number in vary]} if vary else {}
        return differentiated(plain, name, by, {label: casadi.DM(values) for label, values in fixed.items()})

    def _trace(
        self,
        name: str,
        inputs: Sequence[str],
        traced: Callable[[Any, Sequence[Any]], tuple[Any, list[Any]]],
        vary: Sequence[str],
    ) -> Program:
        import casadi

        count = len(self.module.JOINT_NAMES)
        sizes = {"p": 3, "foot_force": 3, "gravity": 3}
        arguments = [Argument(label, (sizes.get(label, count),)) for label in inputs]
        symbols = [casadi.SX.sym(argument.name, argument.size) for argument in arguments]
        leg = self.leg
        if vary:
            arguments.append(Argument("parameters", (len(vary),)))
            symbols.append(casadi.SX.sym("parameters", len(vary)))
            leg = with_numbers(complete(self.module, leg), dict(zip(vary, _components(symbols[-1]), strict=True)))
        nested, guards = traced(leg, [_components(symbol) for symbol in symbols[: len(inputs)]])
        shape = _shape(nested)
        outputs = casadi.vertcat(*_flat(nested)) if shape else casadi.SX(nested)
        graphs = casadi.cse([outputs, casadi.vertcat(*guards) if guards else casadi.SX(0, 1)])
        return Program(name, tuple(arguments), (Argument(name, shape),), casadi.Function(name, symbols, graphs))

    def numbers(self) -> dict[str, float]:
        """Names and values that `vary` can choose from."""
        return dict(named_numbers(complete(self.module, self.leg)))


def complete(module: ModuleType, leg: Any) -> Any:
    """The leg with numbers written out that are left out where they are zero."""
    return module.with_every_number(leg) if hasattr(module, "with_every_number") else leg


def _components(symbol: casadi.SX) -> tuple[Any, ...]:
    return tuple(symbol[i] for i in range(symbol.numel()))


def _shape(nested: Any) -> tuple[int, ...]:
    return (len(nested), *_shape(nested[0])) if isinstance(nested, tuple) else ()


def _flat(nested: Any) -> list[Any]:
    return [leaf for part in nested for leaf in _flat(part)] if isinstance(nested, tuple) else [nested]
