"""The interface of a leg: shapes, units and validation, written once for every route.

A route computes on checked arrays; a `Leg` checks what callers pass, broadcasts it, and turns failing rows into one
named error or, on request, into NaN rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.errors import (
    JointLimitError,
    MissingFootError,
    NonFiniteError,
    ParameterError,
    RowFailures,
    RouteError,
    ShapeError,
    UnsupportedError,
)

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description, Parameter

__all__ = ["Leg", "Limits", "OnError", "Route", "Units"]

OnError = Literal["raise", "nan"]

# IK may return a joint at its limit, off by the rounding of its inverse.
LIMIT_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Limits:
    """Limits of the independent coordinates, each of shape (n,): rad or m, rad/s or m/s, N·m or N."""

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


@dataclass(frozen=True)
class Units:
    """Unit of each independent coordinate (``rad``, ``m``) and of each actuator's effort (``N·m``, ``N``)."""

    joints: tuple[str, ...]
    actuators: tuple[str, ...]


class Route(Protocol):
    """What a route computes. Arrays are finite float64, a sample (n,) or a batch (N, n), already broadcast.

    A row that cannot be computed is reported to `failures` and left NaN. Foot quantities, forces and gravity are in
    the hip frame; `gravity` None means the file's.
    """

    name: str
    joint_names: tuple[str, ...]
    actuator_joints: tuple[str, ...]
    tree_joint_names: tuple[str, ...]
    branches: tuple[str, ...]
    gravity: np.ndarray
    has_foot: bool

    def tree_coordinates(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Closed tree coordinates, (..., n_tree)."""
        ...

    def foot_position(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot position, (..., 3)."""
        ...

    def inverse_kinematics(self, p: np.ndarray, branch: str, failures: RowFailures) -> np.ndarray:
        """Joint coordinates of one branch, (..., n), joint limits not considered."""
        ...

    def foot_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot Jacobian, (..., 3, n)."""
        ...

    def foot_jacobian_derivative(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Time derivative of the foot Jacobian, (..., 3, n)."""
        ...

    def foot_bias_acceleration(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot acceleration at zero joint acceleration, (..., 3)."""
        ...

    def mass_matrix(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Mass matrix at the independent coordinates, (..., n, n)."""
        ...

    def bias(self, q: np.ndarray, v: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Generalised force at zero acceleration, (..., n)."""
        ...

    def potential_energy(self, q: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Potential energy of gravity, zero for masses at the hip's origin, (...,)."""
        ...

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
        ...

    def torque(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        foot_force: np.ndarray | None,
        gravity: np.ndarray | None,
        failures: RowFailures,
    ) -> np.ndarray:
        """Inverse dynamics at the actuators, (..., m)."""
        ...

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
        ...


def checked(name: str, value: ArrayLike, size: int) -> np.ndarray:
    """A float64 array whose last axis has `size` entries.

    Raises
    ------
    ShapeError
        The value is not numeric or its last axis differs.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name} must be numbers, got {type(value).__name__}: {error}", argument=name) from None
    if array.ndim == 0 or array.shape[-1] != size:
        raise ShapeError(
            f"{name} has shape {array.shape}, expected ({size},) or (..., {size}): the last axis holds one sample",
            argument=name,
            shape=array.shape,
            expected=size,
        )
    return array


class Leg:
    """A closed-loop leg: kinematics and dynamics in its independent coordinates.

    Build one with `leg_dynamics.load`. Legs are immutable, picklable and safe to use from several threads. One
    sample has shape (n,), a batch (..., n); leading dimensions broadcast as in NumPy. SI units and radians.

    Every method that takes a state also takes ``on_error``: ``"raise"`` (default) raises one error that carries the
    failing ``rows`` (flat indices) and their ``margin``; ``"nan"`` returns NaN in those rows.
    """

    def __init__(
        self,
        route: Route,
        description: Description,
        foot: str | None,
        rebuild: tuple[Callable[..., Leg], tuple[Any, ...]],
    ) -> None:
        self._route = route
        self._description = description
        self._foot = foot
        self._rebuild = rebuild
        self._n = len(route.joint_names)
        self._m = len(route.actuator_joints)
        joints = [description.joint(name) for name in route.joint_names]
        fields = ("lower", "upper", "velocity", "effort")
        arrays = {field: np.array([getattr(joint.limits, field) for joint in joints]) for field in fields}
        for array in arrays.values():
            array.setflags(write=False)
        self._limits = Limits(**arrays)
        actuators = {t.joint: t.actuator for t in description.transmissions}
        self._actuator_names = tuple(actuators.get(name, name) for name in route.actuator_joints)
        efforts = tuple("N" if description.joint(name).unit == "m" else "N·m" for name in route.actuator_joints)
        self._units = Units(tuple(joint.unit for joint in joints), efforts)
        self._gravity = np.array(route.gravity, dtype=float)
        self._gravity.setflags(write=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return self._rebuild

    def __repr__(self) -> str:
        joints = ", ".join(self.joint_names)
        return f"<Leg {self.name!r} ({joints}) by route {self.route!r}, foot {self._foot!r}>"

    # ------------------------------------------------------------------ what the leg is

    @property
    def name(self) -> str:
        """Name of the mechanism, from its file."""
        return self._description.name

    @property
    def route(self) -> str:
        """Name of the route that computes: ``closed_form``, ``pinocchio`` or ``symbolic``."""
        return self._route.name

    @property
    def backend(self) -> Route:
        """The route object itself, for what only that route offers."""
        return self._route

    @property
    def description(self) -> Description:
        """The mechanism file's content."""
        return self._description

    @property
    def foot(self) -> str | None:
        """Name of the foot link, or None."""
        return self._foot

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The n independent coordinates, in order."""
        return self._route.joint_names

    @property
    def tree_joint_names(self) -> tuple[str, ...]:
        """Every moving joint of the spanning tree, in the route's order."""
        return self._route.tree_joint_names

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """The m actuators, in order."""
        return self._actuator_names

    @property
    def branches(self) -> tuple[str, ...]:
        """Branches of the inverse kinematics; the first is the default."""
        return self._route.branches

    @property
    def units(self) -> Units:
        """Units of the coordinates and efforts."""
        return self._units

    @property
    def limits(self) -> Limits:
        """Limits of the independent coordinates."""
        return self._limits

    @property
    def gravity(self) -> np.ndarray:
        """Default gravity in the hip frame, m/s², shape (3,)."""
        return self._gravity

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """Named design parameters: value, unit and source; empty for a plain mechanism file."""
        return self._description.parameters

    def replace(self, **parameters: float) -> Leg:
        """Return a copy of the leg with some parameters changed.

        Parameters
        ----------
        **parameters : float
            New values by name, in the unit that `parameters` states.

        Raises
        ------
        ParameterError
            A name is unknown, a value is not a finite number, or the leg's file has no parameters.
        """
        if not parameters:
            return self
        if self._description.source is None:
            raise ParameterError(
                f"{self.name!r} was read from plain URDF, which has no named parameters: edit the file, or load the xacro "
                "that generates it"
            )
        from leg_dynamics.routes import rebuild_with_parameters

        return rebuild_with_parameters(self._rebuild, parameters)

    # ------------------------------------------------------------------ shapes

    def _arguments(self, on_error: OnError, **named: tuple[ArrayLike | None, int]) -> _Call:
        arrays = {name: None if value is None else checked(name, value, size) for name, (value, size) in named.items()}
        return _Call(arrays, on_error)

    def _need_foot(self) -> None:
        if not self._route.has_foot:
            raise MissingFootError(f"the foot of {self.name!r} is not named: load it with foot='LINK'")

    # ------------------------------------------------------------------ kinematics

    def assemble(self, q: ArrayLike, *, on_error: OnError = "raise") -> dict[str, np.ndarray]:
        """Tree joint coordinates that close the loops.

        Parameters
        ----------
        q : (..., n) array_like
            Independent coordinates, rad or m.
        on_error : {"raise", "nan"}

        Returns
        -------
        dict of str to (...,) array
            Coordinate of every moving tree joint, rad or m.

        Raises
        ------
        AssemblyError, SingularityError
            The assembly mode has no such pose, or it cannot be followed there.
        """
        call = self._arguments(on_error, q=(q, self._n))
        result = call.run(self._route.tree_coordinates, (len(self.tree_joint_names),), "q")
        return {name: result[..., i] for i, name in enumerate(self.tree_joint_names)}

    def foot_position(self, q: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Foot position in the hip frame.

        Parameters
        ----------
        q : (..., n) array_like
            Independent coordinates, rad or m. Joint limits are not enforced.

        Returns
        -------
        (..., 3) array
            Metres.
        """
        self._need_foot()
        return self._arguments(on_error, q=(q, self._n)).run(self._route.foot_position, (3,), "q")

    def inverse_kinematics(
        self,
        p: ArrayLike,
        branch: str | None = None,
        limits: Literal["error", "ignore"] = "error",
        *,
        on_error: OnError = "raise",
    ) -> np.ndarray:
        """Independent coordinates that put the foot at p.

        Parameters
        ----------
        p : (..., 3) array_like
            Foot position in the hip frame, m.
        branch : str, optional
            One of `branches`; the first where None.
        limits : {"error", "ignore"}
            Whether a solution outside the joint limits is an error.

        Returns
        -------
        (..., n) array
            rad or m.

        Raises
        ------
        OutOfReachError
            No solution; `margin` is the missing distance, negative, in metres.
        JointLimitError
            The solution leaves the limits; `margin` is the excess, negative.
        RouteError
            The branch does not exist.
        """
        self._need_foot()
        if limits not in ("error", "ignore"):
            raise RouteError(f"limits must be 'error' or 'ignore', got {limits!r}")
        chosen = self.branches[0] if branch is None else branch
        if chosen not in self.branches:
            raise RouteError(f"branch {branch!r} does not exist: {self.name!r} has {', '.join(self.branches)}")
        call = self._arguments(on_error, p=(p, 3))

        def solve(p: np.ndarray, failures: RowFailures) -> np.ndarray:
            q = self._route.inverse_kinematics(p, chosen, failures)
            if limits == "error":
                self._check_limits(q, failures)
            return q

        return call.run(solve, (self._n,), "p")

    def _check_limits(self, q: np.ndarray, failures: RowFailures) -> None:
        rows = np.atleast_2d(q)
        margin = np.minimum(rows - self._limits.lower, self._limits.upper - rows)
        outside = np.flatnonzero((margin < -LIMIT_TOLERANCE).any(axis=1))
        if outside.size == 0:
            return
        worst = np.nanargmin(margin[outside[0]])
        name = self.joint_names[worst]
        value, lower, upper = rows[outside[0], worst], self._limits.lower[worst], self._limits.upper[worst]
        failures.add(
            outside,
            JointLimitError(
                f"{name} = {value:.6g} {self._units.joints[worst]} is outside [{lower:.6g}, {upper:.6g}] by "
                f"{-margin[outside[0], worst]:.3g}; choose another foot position or branch, or pass limits='ignore'",
                rows=outside,
                margin=np.nanmin(margin[outside], axis=1),
                joint=name,
            ),
        )
        rows[outside] = np.nan

    def jacobian(self, q: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Foot Jacobian J, foot velocity = J v.

        Parameters
        ----------
        q : (..., n) array_like

        Returns
        -------
        (..., 3, n) array
            m/rad or m/m, hip frame.
        """
        self._need_foot()
        return self._arguments(on_error, q=(q, self._n)).run(self._route.foot_jacobian, (3, self._n), "q")

    def jacobian_derivative(self, q: ArrayLike, v: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Time derivative of the foot Jacobian along the motion v.

        Parameters
        ----------
        q, v : (..., n) array_like

        Returns
        -------
        (..., 3, n) array
        """
        self._need_foot()
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n))
        return call.run(self._route.foot_jacobian_derivative, (3, self._n), "q", "v")

    def foot_velocity(self, q: ArrayLike, v: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Foot velocity J v in the hip frame, m/s, shape (..., 3)."""
        self._need_foot()
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n))

        def velocity(q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
            return np.einsum("...ij,...j->...i", self._route.foot_jacobian(q, failures), v)

        return call.run(velocity, (3,), "q", "v")

    def foot_acceleration(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, on_error: OnError = "raise"
    ) -> np.ndarray:
        """Foot acceleration J a + Jdot v in the hip frame, m/s², shape (..., 3)."""
        self._need_foot()
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n), a=(a, self._n))

        def acceleration(q: np.ndarray, v: np.ndarray, a: np.ndarray, failures: RowFailures) -> np.ndarray:
            linear = np.einsum("...ij,...j->...i", self._route.foot_jacobian(q, failures), a)
            return linear + self._route.foot_bias_acceleration(q, v, failures)

        return call.run(acceleration, (3,), "q", "v", "a")

    # ------------------------------------------------------------------ dynamics

    def mass_matrix(self, q: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Mass matrix M at the independent coordinates, shape (..., n, n); kg·m² (rad), kg (m)."""
        return self._arguments(on_error, q=(q, self._n)).run(self._route.mass_matrix, (self._n, self._n), "q")

    def bias(
        self, q: ArrayLike, v: ArrayLike, gravity: ArrayLike | None = None, *, on_error: OnError = "raise"
    ) -> np.ndarray:
        """Generalised force h at zero acceleration: Coriolis, centrifugal, gravity, joint friction.

        torque = M a + h - J^T foot_force.

        Parameters
        ----------
        q, v : (..., n) array_like
        gravity : (..., 3) array_like, optional
            Gravity vector in the hip frame, m/s²; the default is the file's upright pose.

        Returns
        -------
        (..., n) array
            N·m or N.
        """
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n), gravity=(gravity, 3))
        return call.run(self._route.bias, (self._n,), "q", "v", "gravity")

    def gravity_torque(
        self, q: ArrayLike, gravity: ArrayLike | None = None, *, on_error: OnError = "raise"
    ) -> np.ndarray:
        """Generalised force that holds the leg at rest against gravity, shape (..., n), N·m or N."""
        q = checked("q", q, self._n)
        return self.bias(q, np.zeros_like(q), gravity, on_error=on_error)

    def kinetic_energy(self, q: ArrayLike, v: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Kinetic energy, rotor inertia included, J, shape (...,)."""
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n))

        def energy(q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
            return 0.5 * np.einsum("...i,...ij,...j->...", v, self._route.mass_matrix(q, failures), v)

        return call.run(energy, (), "q", "v")

    def potential_energy(
        self, q: ArrayLike, gravity: ArrayLike | None = None, *, on_error: OnError = "raise"
    ) -> np.ndarray:
        """Potential energy of the moving bodies in gravity, zero at the hip's origin, J, shape (...,)."""
        call = self._arguments(on_error, q=(q, self._n), gravity=(gravity, 3))
        return call.run(self._route.potential_energy, (), "q", "gravity")

    def torque(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        out: np.ndarray | None = None,
        *,
        on_error: OnError = "raise",
    ) -> np.ndarray:
        """Inverse dynamics: actuator efforts for a motion.

        Parameters
        ----------
        q, v, a : (..., n) array_like
            Independent coordinates, rates and accelerations.
        foot_force : (..., 3) array_like, optional
            Force that the environment applies to the foot, N, hip frame. (Xu 2025 (49)-(50) count the force that the foot
            exerts: the opposite sign.)
        gravity : (..., 3) array_like, optional
            Gravity vector in the hip frame, m/s².
        out : (..., m) float64 array, optional
            Receives the result.

        Returns
        -------
        (..., m) array
            N·m or N, in the order of `actuator_names`. Joint limits are not enforced.

        Raises
        ------
        ShapeError, NonFiniteError
            The arguments are not usable.
        AssemblyError, SingularityError
            The loops cannot be closed there in this assembly mode.
        ActuationError
            The actuators do not determine the efforts.
        """
        if foot_force is not None:
            self._need_foot()
        call = self._arguments(
            on_error,
            q=(q, self._n),
            v=(v, self._n),
            a=(a, self._n),
            foot_force=(foot_force, 3),
            gravity=(gravity, 3),
        )
        return call.run(self._route.torque, (self._m,), "q", "v", "a", "foot_force", "gravity", out=out)

    def generalized_force(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        *,
        on_error: OnError = "raise",
    ) -> np.ndarray:
        """Inverse dynamics at the independent coordinates, always unique; arguments as in `torque`, shape (..., n)."""
        if foot_force is not None:
            self._need_foot()
        call = self._arguments(
            on_error,
            q=(q, self._n),
            v=(v, self._n),
            a=(a, self._n),
            foot_force=(foot_force, 3),
            gravity=(gravity, 3),
        )
        return call.run(self._route.generalized_force, (self._n,), "q", "v", "a", "foot_force", "gravity")

    def acceleration(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        *,
        on_error: OnError = "raise",
    ) -> np.ndarray:
        """Forward dynamics: accelerations of the independent coordinates under actuator efforts.

        Parameters
        ----------
        q, v : (..., n) array_like
        tau : (..., m) array_like
            Actuator efforts, N·m or N.
        foot_force, gravity : (..., 3) array_like, optional
            As in `torque`.

        Returns
        -------
        (..., n) array
            rad/s² or m/s².
        """
        if foot_force is not None:
            self._need_foot()
        call = self._arguments(
            on_error,
            q=(q, self._n),
            v=(v, self._n),
            tau=(tau, self._m),
            foot_force=(foot_force, 3),
            gravity=(gravity, 3),
        )
        return call.run(self._route.acceleration, (self._n,), "q", "v", "tau", "foot_force", "gravity")

    # ------------------------------------------------------------------ what only some routes offer

    def _only(self, method: str) -> Any:
        try:
            return getattr(self._route, method)
        except AttributeError:
            raise UnsupportedError(
                f"route {self.route!r} has no {method}: load the leg with route='pinocchio'", route=self.route
            ) from None

    def mobility_report(self, samples: int = 20, seed: int = 0) -> Any:
        """Gruebler count beside the numeric rank of the loop rows (pinocchio route).

        Returns
        -------
        MobilityReport
            With ``mobility``, ``redundant``, ``gruebler``, ``poses``, ``to_dict()``.
        """
        return self._only("mobility_report")(samples, seed)

    def loop_forces(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> Any:
        """Forces in the cut loop joints for one sample (pinocchio route).

        Minimum-norm; where the mechanism is overconstrained they are not unique, and the result says so.

        Returns
        -------
        LoopForces
            With ``wrenches``, ``couplings``, ``redundant_rows``, ``unique``.
        """
        method = self._only("loop_forces")
        call = self._arguments(
            "raise",
            q=(q, self._n),
            v=(v, self._n),
            a=(a, self._n),
            foot_force=(foot_force, 3),
            gravity=(gravity, 3),
        )
        if not call.single:
            raise ShapeError("loop_forces takes one sample, shape (n,)")
        if call.failures:
            raise call.failures.combined(None)
        return method(*call.arrays.values())


class _Call:
    """One call's arguments, broadcast and checked, and the handling of its failing rows."""

    def __init__(self, arrays: dict[str, np.ndarray | None], on_error: OnError) -> None:
        if on_error not in ("raise", "nan"):
            raise ShapeError(f"on_error must be 'raise' or 'nan', got {on_error!r}")
        self.on_error = on_error
        given = {name: array for name, array in arrays.items() if array is not None}
        shapes = {array.shape[:-1] for array in given.values()}
        if len(shapes) == 1:
            (self.leading,) = shapes
        else:
            try:
                self.leading = np.broadcast_shapes(*shapes)
            except ValueError:
                listing = ", ".join(f"{name} {array.shape}" for name, array in given.items())
                raise ShapeError(f"leading dimensions do not broadcast: {listing}") from None
        self.single = self.leading == ()
        self.count = 1 if self.single else int(np.prod(self.leading))
        self.arrays: dict[str, np.ndarray | None] = dict(arrays)
        for name, array in given.items():
            if not self.single:
                size = array.shape[-1]
                if array.shape[:-1] != self.leading:
                    array = np.broadcast_to(array, (*self.leading, size))
                array = array.reshape(self.count, size)
            self.arrays[name] = array
        self.failures = RowFailures()
        self._find_non_finite()

    def _find_non_finite(self) -> None:
        bad = np.zeros(self.count, dtype=bool)
        for name, array in self.arrays.items():
            if array is None or np.isfinite(array).all():
                continue
            rows = np.flatnonzero(~np.isfinite(np.atleast_2d(array)).all(axis=1))
            values = np.atleast_2d(array)[rows[0]]
            error = NonFiniteError(
                f"{name} = {values.tolist()} is not finite: remove the NaN or infinity, or pass on_error='nan'",
                rows=rows,
                argument=name,
            )
            self.failures.add(rows, error)
            bad[rows] = True
        self.good = None if not bad.any() else np.flatnonzero(~bad)

    def run(
        self,
        function: Callable[..., np.ndarray],
        shape: tuple[int, ...],
        *names: str,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Evaluate on the rows whose input is finite, then raise or fill."""
        full = (*self.leading, *shape)
        if out is not None and (not isinstance(out, np.ndarray) or out.shape != full or out.dtype != np.float64):
            given = f"{out.dtype} {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
            raise ShapeError(f"out must be a float64 array of shape {full}, got {given}")
        if self.failures and self.on_error == "raise":
            raise self.failures.combined(None if self.single else self.count)
        if self.good is None:
            result = np.asarray(function(*(self.arrays[name] for name in names), self.failures))
        else:
            result = np.full((self.count, *shape), np.nan)
            if self.good.size:
                arrays = [None if (a := self.arrays[n]) is None else np.atleast_2d(a)[self.good] for n in names]
                result[self.good] = function(*arrays, RowFailures())
        if self.failures and self.on_error == "raise":
            raise self.failures.combined(None if self.single else self.count)
        result = result.reshape(full)
        if out is None:
            return result
        out[...] = result
        return out
