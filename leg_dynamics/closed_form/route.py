"""The closed-form route: the interface's array methods over a leg's formulas.

Any module of this package serves that has ``JOINT_NAMES``, ``TREE_JOINT_NAMES``, ``BRANCHES``, a
``from_urdf(description)`` whose result has ``gravity``, and the formulas

    tree_coordinates(leg, q) -> dict        foot_position(leg, q)           foot_jacobian(leg, q)
    foot_jacobian_derivative(leg, q, v)     foot_bias_acceleration(leg, q, v)
    foot_force_torque(leg, q, force)        mass_matrix(leg, q)             potential_energy(leg, q, gravity)
    inverse_dynamics(leg, q, v, a, gravity) bias(leg, q, v, gravity)        forward_dynamics(leg, q, v, f, gravity)
    inverse_kinematics(leg, p, branch)      with `q`, `margin` (m, negative outside the reach) and, where a foot within
                                            reach can have no unique angles, `singular_margin` (m, negative there)

and, where it has models to choose between, ``OPTIONS`` (a mapping of names to allowed values, which `from_urdf` takes
as keywords); where it has singular configurations, ``singularity_margins(leg, q)`` (values that vanish there) with
``SINGULARITY_LIMIT``; where not all coordinates close the loops, ``assembly_ranges(leg, q)`` (least and greatest value
of each coordinate, the others as they are); where branches belong to assembly modes of their own,
``in_branch(leg, branch)`` (the leg in that mode) and ``BRANCH_ENDS`` (what ends a branch, in words, by the name of a
margin in the result of `inverse_kinematics`); where its inertia reduces to fewer base parameters,
``composite_parameters(leg)`` and the dynamic formulas above as ``composite_inverse_dynamics(leg, parameters, q, v, a,
gravity, force)`` and so on, which kernels then use (``force`` acts on the foot; ``composite_forward_dynamics`` takes it
too), and
``BASE_PARAMETER_NAMES``, ``BASE_PARAMETER_UNITS``, ``base_parameters(leg)``, ``regressor(leg, q, v, a, gravity)``;
where numbers are left out when they are zero, ``with_every_number(leg)``.

The methods run the formulas as kernels (see `compiled`); `ClosedFormRoute.plain` evaluates the same formulas on floats
and arrays, which says why a row failed.
"""

from __future__ import annotations

import functools
import importlib.metadata
import pickle
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics import closed_form
from leg_dynamics.closed_form.compiled import FormulaKernels, complete, in_tree_order
from leg_dynamics.closed_form.numbers import named_numbers
from leg_dynamics.description.topology import actuated_joints
from leg_dynamics.errors import (
    AssemblyError,
    BranchError,
    FormulaAssumptionError,
    OutOfReachError,
    RouteError,
    RowError,
    RowFailures,
    SingularityError,
    UnsupportedError,
)
from leg_dynamics.kernels import Kernel, cache

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description
    from leg_dynamics.leg import Quick

__all__ = ["ClosedFormRoute"]

_BLOCK = 4096
"""Rows evaluated at a time: temporaries stay in the cache and the memory of a large batch stays bounded."""

_NO_FORCE = np.zeros(3)
_NO_FORCE.setflags(write=False)


def _shape(nested: Any) -> tuple[int, ...]:
    return (len(nested), *_shape(nested[0])) if isinstance(nested, tuple) else ()


def _fill(out: np.ndarray, nested: Any) -> None:
    if isinstance(nested, tuple):
        for index, part in enumerate(nested):
            _fill(out[:, index], part)
    else:
        out[...] = nested


def _checked_module(formulas: str, options: dict[str, str]) -> ModuleType:
    module = closed_form.find(formulas)
    if module is None:
        raise RouteError(f"there are no formulas of a leg called {formulas!r}; use route='pinocchio'")
    offered = getattr(module, "OPTIONS", {})
    for option, value in options.items():
        if value not in offered.get(option, ()):
            choices = f"choose one of {', '.join(offered[option])}" if option in offered else "leave it out"
            raise RouteError(f"the formulas of {formulas!r} have no {option} {value!r}: {choices}")
    return module


def _ingredients(formulas: str, description: Description, options: dict[str, str]) -> str:
    """Digest of all that a leg's numbers and graphs come from."""
    sources = (cache.source_fingerprint(f"leg_dynamics.{room}") for room in ("closed_form", "description"))
    readers = (f"{name} {importlib.metadata.version(name)}" for name in ("numpy", "yourdfpy"))
    chosen = (f"{name}={value}" for name, value in sorted(options.items()))
    return cache.key_of(formulas, description.urdf, *sources, *readers, *chosen)


def _numbers(module: ModuleType, description: Description, options: dict[str, str], ingredients: str) -> Any:
    """The leg's numbers; a file that has passed every check once is not read and checked again."""
    key = cache.key_of("numbers", ingredients)
    stored = cache.read(key)
    if stored is not None:
        return pickle.loads(stored)
    numbers = module.from_urdf(description, **options)
    cache.write(key, pickle.dumps(numbers))
    return numbers


class ClosedFormRoute:
    """Formulas of one leg with one file's numbers: immutable, safe to use from several threads.

    Arguments of the methods are finite float64 arrays, a sample (n,) or a batch (N, n), already broadcast against each
    other. Rows that cannot be computed are reported to `failures` and left NaN; `gravity` None is the file's.

    Parameters
    ----------
    formulas : str
        Name of a leg that `leg_dynamics.closed_form.find` knows.
    description : Description
        Where geometry, masses and inertias come from.
    threads : int, optional
        Threads for large batches; default: as many as pay.
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

    def __init__(self, formulas: str, description: Description, threads: int | None = None, **options: str) -> None:
        self.module = module = _checked_module(formulas, options)
        self.options = options
        self.threads = threads
        self.formulas = formulas
        ingredients = _ingredients(formulas, description, options)
        self.numbers = _numbers(module, description, options, ingredients)
        self.joint_names: tuple[str, ...] = tuple(module.JOINT_NAMES)
        self.tree_joint_names: tuple[str, ...] = tuple(module.TREE_JOINT_NAMES)
        self.branches: tuple[str, ...] = tuple(module.BRANCHES)
        self.gravity = np.array(self.numbers.gravity, dtype=np.float64)
        self.gravity.setflags(write=False)
        self._home = {} if description.home is None else dict(description.home.values)
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
        actuated = tuple(self.joint_names.index(name) for name in self.actuator_joints)
        self.kernels = FormulaKernels(module, self.numbers, actuated, ingredients)

    # ------------------------------------------------------------------ evaluation

    def kernel(self, name: str, vary: Sequence[str] = ()) -> Kernel:
        """Return the compiled formula `name` (see `leg_dynamics.closed_form.compiled.FORMULAS`)."""
        return self.kernels.get(name, vary)

    def quick(self, name: str) -> Quick:
        """Return the kernel of a method for arrays that need no checking, see `leg_dynamics.leg.QuickRoute`."""
        from leg_dynamics.leg import Quick

        kernel = self.kernels.get(name)
        return Quick(kernel.ufunc, functools.partial(kernel, threads=self.threads), kernel.counter, kernel.row)

    def plain(self, formula: Callable[..., Any], *arguments: np.ndarray) -> np.ndarray:
        """Evaluate a formula (leg, components ...) as it stands: a sample on floats, a batch on arrays.

        Parameters
        ----------
        formula : callable
            A function of the leg's module.
        *arguments : (n,) or (N, n) arrays
        """
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

    def _run(
        self, name: str, failures: RowFailures, q: np.ndarray, *others: np.ndarray, vary: Sequence[str] = ()
    ) -> np.ndarray:
        """Evaluate a kernel whose first argument is q; rows at singular configurations fail.

        What overflows at a regular configuration is left NaN: the interface reports it.
        """
        kernel = self.kernels.get(name, vary)
        before = kernel.counter[0]
        result: np.ndarray = kernel(q, *others, threads=1 if q.ndim == 1 else self.threads)
        if kernel.counter[0] != before and hasattr(self.module, "singularity_margins"):
            self._report_singular(q, result, failures)
        return result

    def _report_singular(self, q: np.ndarray, result: np.ndarray, failures: RowFailures) -> None:
        states = np.atleast_2d(q)
        suspects = np.flatnonzero(np.isnan(result.reshape(len(states), -1)).any(axis=1))
        if hasattr(self.module, "assembly_ranges"):
            suspects = self._report_open(states, suspects, failures)
        margins = self.plain(self.module.singularity_margins, states[suspects]).min(axis=-1)
        singular = ~(margins >= self.module.SINGULARITY_LIMIT)
        if not singular.any():
            return
        failing, margins = suspects[singular], margins[singular]
        failures.add(
            failing,
            SingularityError(
                f"the passive joints lose their direction at {self._shown(states[failing[0]])} (singularity margin "
                f"{margins[0]:.3g}): ask for a configuration further away from it",
                rows=failing,
                margin=margins,
            ),
        )

    def _report_open(self, states: np.ndarray, suspects: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Report rows whose loops cannot be closed; return the others."""
        ranges = self.plain(self.module.assembly_ranges, states[suspects])
        values = states[suspects]
        # NaN where another coordinate leaves no range at all; that one is reported.
        inside = np.fmin(values - ranges[..., 0], ranges[..., 1] - values)
        margins = np.nanmin(inside, axis=-1, initial=np.inf)
        is_open = margins < 0.0
        if not is_open.any():
            return suspects
        failing, margins = suspects[is_open], margins[is_open]
        first = int(np.flatnonzero(is_open)[0])
        k = int(np.nanargmin(inside[first]))
        low, high = ranges[first, k]
        failures.add(
            failing,
            AssemblyError(
                f"the loops cannot be closed at {self._shown(values[first])}: with the other coordinates "
                f"{self.joint_names[k]} must lie in [{low:.6g}, {high:.6g}] and is {-margins[0]:.3g} outside; ask for "
                "coordinates inside",
                rows=failing,
                margin=margins,
                residual=-margins,
                coordinate=self.joint_names[k],
                value=float(values[first, k]),
                limit=float(low if values[first, k] < low else high),
            ),
        )
        return suspects[~is_open]

    def _shown(self, state: np.ndarray) -> str:
        return ", ".join(f"{name} = {x:.6g}" for name, x in zip(self.joint_names, state, strict=True))

    # ------------------------------------------------------------------ the interface

    def tree_coordinates(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Tree joint coordinates that close every loop, (..., n_tree)."""
        return self._run("tree_coordinates", failures, q)

    def home_coordinates(self) -> np.ndarray:
        """Coordinates of the file's home pose, (n,); joints that it does not name are at zero."""
        return np.array([self._home.get(name, 0.0) for name in self.joint_names])

    def actuator_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Rates of the actuated joints per independent velocity, (..., m, n): each actuator drives one coordinate."""
        selection = np.array([[float(name == own) for own in self.joint_names] for name in self.actuator_joints])
        return np.broadcast_to(selection, (*q.shape[:-1], *selection.shape)).copy()

    def foot_position(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot position, (..., 3) m."""
        return self._run("foot_position", failures, q)

    def foot_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot Jacobian, (..., 3, n)."""
        return self._run("foot_jacobian", failures, q)

    def foot_jacobian_derivative(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Time derivative of the foot Jacobian, (..., 3, n)."""
        return self._run("foot_jacobian_derivative", failures, q, v)

    def foot_bias_acceleration(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot acceleration at zero joint acceleration, (..., 3) m/s²."""
        return self._run("foot_bias_acceleration", failures, q, v)

    def mass_matrix(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Mass matrix with the rotors, (..., n, n)."""
        return self._run("mass_matrix", failures, q)

    def bias(self, q: np.ndarray, v: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Generalised force at zero acceleration, damping and friction included, (..., n)."""
        return self._run("bias", failures, q, v, self.gravity if gravity is None else gravity)

    def potential_energy(self, q: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Potential energy of gravity, (...,) J."""
        return self._run("potential_energy", failures, q, self.gravity if gravity is None else gravity)

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
        return self._run("generalized_force", failures, q, v, a, *self._loads(foot_force, gravity))

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
        if foot_force is None and gravity is None:
            return self._run("torque", failures, q, v, a)
        return self._run("loaded_torque", failures, q, v, a, *self._loads(foot_force, gravity))

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
        return self._run("acceleration", failures, q, v, tau, *self._loads(foot_force, gravity))

    def torque_derivatives(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        foot_force: np.ndarray | None,
        gravity: np.ndarray | None,
        numbers: tuple[str, ...],
        failures: RowFailures,
    ) -> np.ndarray:
        """Efforts differentiated by q, v, a and by some of `numbers_of`, columns side by side, (..., m, 3 n + k)."""
        return self._run("torque_derivatives", failures, q, v, a, *self._loads(foot_force, gravity), vary=numbers)

    def acceleration_derivatives(
        self,
        q: np.ndarray,
        v: np.ndarray,
        tau: np.ndarray,
        foot_force: np.ndarray | None,
        gravity: np.ndarray | None,
        numbers: tuple[str, ...],
        failures: RowFailures,
    ) -> np.ndarray:
        """Accelerations differentiated by q, v, tau and by some of `numbers_of`, (..., n, 2 n + m + k)."""
        arguments = (q, v, tau, *self._loads(foot_force, gravity))
        return self._run("acceleration_derivatives", failures, *arguments, vary=numbers)

    def numbers_of(self, description: Description) -> dict[str, float]:
        """Names and values of the numbers that the formulas take from a description."""
        ingredients = _ingredients(self.formulas, description, self.options)
        numbers = _numbers(self.module, description, self.options, ingredients)
        return dict(named_numbers(complete(self.module, numbers)))

    @property
    def base_parameters(self) -> dict[str, tuple[float, str]]:
        """Values and units of the base parameters by name; empty where the leg has no reduction to them."""
        if not hasattr(self.module, "regressor"):
            return {}
        names, units = self._base_names()
        values = self.module.base_parameters(self.numbers)
        return {name: (float(value), units[name]) for name, value in zip(names, values, strict=True)}

    def _base_names(self) -> tuple[tuple[str, ...], Mapping[str, str]]:
        model = self.options.get("transmission", "exact")
        return self.module.BASE_PARAMETER_NAMES[model], self.module.BASE_PARAMETER_UNITS

    def regressor(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray, gravity: np.ndarray | None, failures: RowFailures
    ) -> np.ndarray:
        """Matrix Y of efforts = Y base_parameters, losses and foot force aside, (..., m, k).

        Raises
        ------
        UnsupportedError
            The leg has no reduction to base parameters.
        """
        if not hasattr(self.module, "regressor"):
            raise UnsupportedError(f"the formulas {self.module.__name__!r} have no regressor", route=self.name)
        return self._run("regressor", failures, q, v, a, self.gravity if gravity is None else gravity)

    def _loads(self, foot_force: np.ndarray | None, gravity: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        return _NO_FORCE if foot_force is None else foot_force, self.gravity if gravity is None else gravity

    def inverse_kinematics(self, p: np.ndarray, branch: str, failures: RowFailures) -> np.ndarray:
        """Coordinates of one branch, (..., n), limits not considered; rows out of reach fail with their margin in m."""
        kernel = self.kernels.get("inverse_kinematics", branch=branch)
        before = kernel.counter[0]
        q: np.ndarray = kernel(p, threads=1 if p.ndim == 1 else self.threads)
        if kernel.counter[0] != before:
            self._report_out_of_reach(p, branch, q, failures)
        return q

    def tree_coordinates_in_branch(self, q: np.ndarray, branch: str) -> np.ndarray:
        """Tree joint coordinates (N, n_tree) of what `inverse_kinematics` gives for a branch, in its assembly mode.

        NaN where the lengths do not close in that mode, and for a leg whose branches have no modes of their own.
        """
        in_branch = getattr(self.module, "in_branch", None)
        if in_branch is None:
            return np.full((len(q), len(self.tree_joint_names)), np.nan)
        return self.plain(lambda leg, own: in_tree_order(self.module, in_branch(leg, branch), own), q)

    def _report_out_of_reach(self, p: np.ndarray, branch: str, q: np.ndarray, failures: RowFailures) -> None:
        points = np.atleast_2d(p)
        failing = np.flatnonzero(np.isnan(np.atleast_2d(q)).any(axis=1))
        points = points[failing]
        margin, singular = np.minimum(self._branch_margins(points, branch), 0.0).T
        others = [name for name in self.branches if name != branch]
        held = np.array([(self._branch_margins(points, name) >= 0.0).all(axis=1) for name in others])
        held = held.reshape(len(others), len(points)).T & (singular == 0.0)[:, None]
        is_held = held.any(axis=1)
        if is_held.any():
            self._report_branch_end(points, branch, failing, margin, held, failures)
        kinds: tuple[tuple[type[RowError], np.ndarray, np.ndarray, str], ...] = (
            (
                OutOfReachError,
                np.flatnonzero((singular == 0.0) & ~is_held),
                margin,
                "the foot cannot reach ({point}) m: {missing:.3g} m are missing; move the point inside the workspace",
            ),
            (
                SingularityError,
                np.flatnonzero(singular < 0.0),
                singular,
                "the joint angles at ({point}) m are not unique: the foot lies on an axis that a joint turns it about, "
                "or {missing:.3g} m too close to it; move the point away from that axis",
            ),
        )
        for kind, chosen, missing, sentence in kinds:
            if chosen.size:
                first = chosen[0]
                message = sentence.format(point=_shown_point(points[first]), missing=-missing[first])
                failures.add(failing[chosen], kind(message, rows=failing[chosen], margin=missing[chosen]))

    def _branch_margins(self, points: np.ndarray, branch: str) -> np.ndarray:
        """Margin of a branch at points (N, 3), and its singular margin, m, (N, 2)."""

        def margins(numbers: Any, components: tuple[Any, ...]) -> Any:
            found = self.module.inverse_kinematics(numbers, components, branch)
            return found.margin, getattr(found, "singular_margin", 0.0)

        return self.plain(margins, points)

    def _report_branch_end(
        self,
        points: np.ndarray,
        branch: str,
        failing: np.ndarray,
        margin: np.ndarray,
        held: np.ndarray,
        failures: RowFailures,
    ) -> None:
        """Report points (N, 3), rows `failing`, that branches other than this one hold (N, B - 1)."""
        chosen = np.flatnonzero(held.any(axis=1))
        first = chosen[0]
        ends = getattr(self.module, "BRANCH_ENDS", {})

        def parts(numbers: Any, components: tuple[Any, ...]) -> Any:
            found = self.module.inverse_kinematics(numbers, components, branch)
            return tuple(getattr(found, name) for name in ends)

        reasons = [
            text.format(missing=-value)
            for text, value in zip(ends.values(), self.plain(parts, points[first]) if ends else (), strict=True)
            if value < 0.0
        ] or [f"it is {-margin[first]:.3g} m beyond its end"]
        others = [name for name in self.branches if name != branch]
        holding = tuple(name for name, holds in zip(others, held[first], strict=True) if holds)
        which = "that branch" if len(holding) == 1 else "one of them"
        failures.add(
            failing[chosen],
            BranchError(
                f"branch {branch!r} of the inverse kinematics ends before ({_shown_point(points[first])}) m: there "
                f"{' and '.join(reasons)}; the point is held by {' and '.join(map(repr, holding))}: choose {which}, "
                f"or keep the foot where {branch!r} reaches",
                rows=failing[chosen],
                margin=margin[chosen],
                branch=branch,
                holding=holding,
            ),
        )


def _shown_point(point: np.ndarray) -> str:
    # Adding zero turns -0 into 0.
    return ", ".join(f"{value + 0.0:.6g}" for value in point)
