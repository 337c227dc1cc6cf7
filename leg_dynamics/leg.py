"""The interface of a leg: shapes, units and validation, written once for every route.

A route computes on checked arrays; a `Leg` checks what callers pass, broadcasts it, and turns failing rows into one
named error or, on request, into NaN rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, overload

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.actuation import Actuation, Feasibility, IdleTorque, Policy, actuation_of, feasibility
from leg_dynamics.errors import (
    ActuationError,
    JointLimitError,
    LegDynamicsError,
    MissingFootError,
    NonFiniteError,
    ParameterError,
    RouteError,
    RowError,
    RowFailures,
    ShapeError,
    SingularityError,
    UnsupportedError,
)

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description, Joint, Parameter
    from leg_dynamics.description.turns import WholeTurns

__all__ = [
    "AccelerationDerivatives",
    "Leg",
    "Limits",
    "OnError",
    "Quick",
    "QuickRoute",
    "Recipe",
    "Route",
    "TorqueDerivatives",
    "Units",
]

OnError = Literal["raise", "nan"]

# IK may return a joint at its limit, off by the rounding of its inverse.
LIMIT_TOLERANCE = 1e-9

# A foot that is so near (relative to 1 m) is where it was asked for.
_SAME_PLACE = 1e-6

# Arguments that may be None: no force, the file's gravity.
OPTIONAL = ("foot_force", "gravity")

# Below this reciprocal condition number, J^-T turns the rounding of the efforts into more than 1e-10 of the force.
LEAST_RECIPROCAL_CONDITION = 1e-6


@dataclass(frozen=True)
class Limits:
    """Limits of some joints, each of shape (n,): rad or m, rad/s or m/s, N·m or N; infinite where there is none.

    Efforts are from `effort_lower`, at most 0, to `effort`; -effort where the file limits them alike both ways.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    effort_lower: np.ndarray

    @classmethod
    def of(cls, joints: Sequence[Joint]) -> Limits:
        """What a file says of these joints."""
        fields = ("lower", "upper", "velocity", "effort", "effort_lower")
        arrays = {field: np.array([getattr(joint.limits, field) for joint in joints], dtype=float) for field in fields}
        for array in arrays.values():
            array.setflags(write=False)
        return cls(**arrays)


@dataclass(frozen=True)
class Units:
    """Unit of each independent coordinate (``rad``, ``m``) and of each actuator's effort (``N·m``, ``N``)."""

    joints: tuple[str, ...]
    actuators: tuple[str, ...]


class TorqueDerivatives(NamedTuple):
    """Actuator efforts differentiated by the motion, (..., m, n) each, and by parameters, (..., m, k)."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    parameters: np.ndarray


class AccelerationDerivatives(NamedTuple):
    """Accelerations differentiated by q and v, (..., n, n), tau, (..., n, m), and parameters, (..., n, k)."""

    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    parameters: np.ndarray


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

    def home_coordinates(self) -> np.ndarray:
        """Independent coordinates of a closed, regular pose of the assembly mode, (n,)."""
        ...

    def actuator_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Rates of the actuated joints per independent velocity, (..., m, n)."""
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


class Quick(NamedTuple):
    """A kernel that can be called on float64 arrays without any check before.

    Its functions take arrays that broadcast and raise ValueError where a last axis does not fit.
    """

    single: Callable[..., np.ndarray]
    """For small arrays; takes ``out`` by name."""
    batch: Callable[..., np.ndarray]
    """For large arrays, on several threads; takes ``out`` by name."""
    counter: memoryview
    """``counter[0]`` grows with every row that fails, in all threads; such rows are NaN."""
    row: Callable[..., np.ndarray | None] | None = None
    """For one sample: takes the arrays and optionally one for the result; None where it needs the careful way."""


class QuickRoute(Route, Protocol):
    """A route whose methods are kernels."""

    def quick(self, name: str) -> Quick | None:
        """Kernel of the method `name`, or of ``loaded_torque`` (torque with force and gravity), where there is one."""
        ...


class Recipe(Protocol):
    """What a leg is made of: enough to make it, or a changed copy, again. The composition root has one."""

    @property
    def transmission(self) -> str:
        """Model of the drive train."""
        ...

    def build(self) -> Leg:
        """Make the leg."""
        ...

    def with_parameters(self, parameters: Mapping[str, float]) -> Recipe:
        """Return the recipe with some design parameters changed."""
        ...

    def of_part(self, name: str, foot: str | None) -> Recipe:
        """Return the recipe for one leg of a robot."""
        ...

    def read(self) -> Description:
        """What the source says, before anything was done to it."""
        ...

    def number_derivatives(self, parameters: tuple[str, ...], route: Any) -> tuple[tuple[str, ...], np.ndarray]:
        """Names of k numbers of the route, and the derivative of each by each parameter, (k, parameters)."""
        ...


def checked(name: str, value: ArrayLike, size: int) -> np.ndarray:
    """A float64 array whose last axis has `size` entries.

    Parameters
    ----------
    name : str
        The argument's name, for the error.
    value : array_like
        Integers or real numbers; anything that would have to be guessed at (text, truth values, complex numbers, dates,
        objects, masked entries) is refused.
    size : int

    Raises
    ------
    ShapeError
        The value is not made of real numbers, or its last axis differs.
    """
    array = value
    if type(array) is not np.ndarray:
        if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
            raise ShapeError(f"{name} has masked entries: fill them or leave those rows out", argument=name)
        try:
            array = np.asarray(value)
        except (TypeError, ValueError, OverflowError) as error:
            raise ShapeError(f"{name} must be numbers in a regular array: {error}", argument=name) from None
    if array.dtype != np.float64:
        if array.dtype.kind not in "iuf":
            found = f"{type(value).__name__} of Python objects" if array.dtype.kind == "O" else str(array.dtype)
            raise ShapeError(
                f"{name} must be real numbers, got {found}: convert it to float first", argument=name, dtype=array.dtype
            )
        array = array.astype(np.float64)
    if array.ndim == 0 or array.shape[-1] != size:
        raise ShapeError(
            f"{name} has shape {array.shape}, expected ({size},) or (..., {size}): the last axis holds one sample",
            argument=name,
            shape=array.shape,
            expected=size,
        )
    return array


# |R^T R - 1| of a matrix that counts as a rotation.
_ORTHONORMAL = 1e-9


def _checked_rotation(value: ArrayLike) -> np.ndarray:
    """Rotation matrices (..., 3, 3) as rows (..., 9); those that are not finite are left to the caller.

    Raises
    ------
    ShapeError
        The shape differs, or a matrix is no rotation.
    """
    array = checked("rotation", value, 3)
    if array.ndim < 2 or array.shape[-2] != 3:
        raise ShapeError(
            f"rotation has shape {array.shape}, expected (3, 3) or (..., 3, 3)", argument="rotation", shape=array.shape
        )
    matrices = array.reshape(-1, 3, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.abs(np.swapaxes(matrices, 1, 2) @ matrices - np.eye(3)).max(axis=(1, 2), initial=0.0)
        mirrored = np.linalg.det(matrices) < 0.0
    wrong = np.flatnonzero(np.isfinite(matrices).all(axis=(1, 2)) & ~((deviation <= _ORTHONORMAL) & ~mirrored))
    if wrong.size:
        first = int(wrong[0])
        what = (
            "it mirrors, its determinant is negative"
            if deviation[first] <= _ORTHONORMAL
            else f"R^T R differs from the identity by {deviation[first]:.3g}, the limit is {_ORTHONORMAL:g}"
        )
        raise ShapeError(
            f"rotation {first} of {len(matrices)} is no rotation matrix: {what}; make its columns orthonormal and "
            "right-handed",
            argument="rotation",
            deviation=float(deviation[first]),
        )
    return array.reshape(*array.shape[:-2], 9)


# Below that many numbers in q a call stays on one thread and needs no splitting.
_QUICK_SIZE = 32768
_FLOAT = np.dtype(np.float64)
_ARRAY = np.ndarray
# What not every route has; derivatives and numbers are the others.
_ROUTES_WITH = {
    "assembly_modes": "pinocchio or symbolic",
    "base_parameters": "closed_form",
    "foot_rotation": "pinocchio",
    "geometric_jacobian": "pinocchio",
    "kernel": "closed_form",
    "loop_forces": "pinocchio",
    "mobility_report": "pinocchio",
    "pose_inverse_kinematics": "pinocchio",
    "rank_report": "pinocchio",
    "regressor": "closed_form",
}

# Poses beside home, and how far, rad or m, at which it is decided which motions the actuators hold.
_VERDICT_POSES = 6
_VERDICT_SPREAD = 0.05

_NO_FORCE = np.zeros(3)
_NO_FORCE.setflags(write=False)


class Leg:
    """A closed-loop leg: kinematics and dynamics in its independent coordinates.

    Build one with `leg_dynamics.load`. Legs are immutable, picklable and safe to use from several threads. One
    sample has shape (n,), a batch (..., n); leading dimensions broadcast as in NumPy. SI units and radians.

    Every method that takes a state also takes ``on_error``: ``"raise"`` (default) raises one error that carries the
    failing ``rows`` (flat indices) and their ``margin``; ``"nan"`` returns NaN in those rows.
    """

    __slots__ = (
        "_actuation",
        "_actuator_limits",
        "_actuator_names",
        "_base_count",
        "_description",
        "_directly_actuated",
        "_foot",
        "_gravity",
        "_limits",
        "_m",
        "_n",
        "_quick",
        "_quick_torque",
        "_recipe",
        "_route",
        "_torque_row",
        "_turns",
        "_units",
    )

    _route: Route
    _description: Description
    _foot: str | None
    _recipe: Recipe
    _n: int
    _m: int
    _limits: Limits
    _actuation: Actuation | None
    _actuator_limits: Limits
    _actuator_names: tuple[str, ...]
    _directly_actuated: bool
    _units: Units
    _gravity: np.ndarray
    _base_count: int | None
    _quick: dict[str, Quick]
    _quick_torque: Quick | None
    _torque_row: Callable[..., np.ndarray | None] | None
    _turns: WholeTurns | None

    def __init__(self, route: Route, description: Description, foot: str | None, recipe: Recipe) -> None:
        joints = [description.joint(name) for name in route.joint_names]
        actuators = {t.joint: t.actuator for t in description.transmissions}
        efforts = tuple("N" if description.joint(name).unit == "m" else "N·m" for name in route.actuator_joints)
        gravity = np.array(route.gravity, dtype=float)
        gravity.setflags(write=False)
        values = {
            "_route": route,
            "_description": description,
            "_foot": foot,
            "_recipe": recipe,
            "_n": len(route.joint_names),
            "_m": len(route.actuator_joints),
            "_limits": Limits.of(joints),
            "_actuation": None,
            "_actuator_limits": Limits.of([description.joint(name) for name in route.actuator_joints]),
            "_directly_actuated": sorted(route.actuator_joints) == sorted(route.joint_names),
            "_actuator_names": tuple(actuators.get(name, name) for name in route.actuator_joints),
            "_units": Units(tuple(joint.unit for joint in joints), efforts),
            "_gravity": gravity,
            "_base_count": None,
            "_quick": {},
            "_quick_torque": None,
            "_torque_row": None,
            "_turns": None,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a Leg cannot be changed ({name}): load another one, or use replace()")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a Leg cannot be changed ({name})")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self._recipe).build, (self._recipe,)

    def __repr__(self) -> str:
        joints = ", ".join(self.joint_names)
        model = "" if self.transmission == "exact" else f", transmission {self.transmission!r}"
        return f"<Leg {self.name!r} ({joints}) by route {self.route!r}{model}, foot {self._foot!r}>"

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
    def transmission(self) -> str:
        """Model of the drive train: ``exact``, or a simplification that was asked for when the leg was loaded."""
        return self._recipe.transmission

    @property
    def backend(self) -> Route:
        """The route object itself, for what only that route offers."""
        return self._route

    @property
    def recipe(self) -> Recipe:
        """What the leg is made of, enough to make it again."""
        return self._recipe

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
    def home(self) -> np.ndarray:
        """Independent coordinates of the pose that defines the assembly mode, rad or m, shape (n,).

        That of the file's configuration ``home``, its rounded numbers closed; else the one that was found.

        Raises
        ------
        AssemblyError, SingularityError, DescriptionError
            The mechanism has no closed, regular pose.
        """
        return self._route.home_coordinates()

    @property
    def loop_gap(self) -> float:
        """How far rounding of the file's numbers keeps loops open that say a thing more than once, rad or m.

        0 where the loops close. The largest of some poses; elsewhere it may be several times as large. Poses are those
        of the smallest gap, and results are good to about that share.
        """
        return float(getattr(self._route, "loop_gap", 0.0))

    @property
    def actuator_limits(self) -> Limits:
        """Limits of the m actuated joints, in the order of `actuator_names`."""
        return self._actuator_limits

    @property
    def actuation(self) -> Actuation:
        """Whether the actuators determine their efforts, and which motions none of them holds.

        Raises
        ------
        AssemblyError, SingularityError, DescriptionError
            The mechanism has no closed pose to look at.
        """
        verdict = self._actuation
        if verdict is None:
            verdict = self._judged_actuation()
            object.__setattr__(self, "_actuation", verdict)
        return verdict

    def _judged_actuation(self) -> Actuation:
        route = self._route
        names = route.joint_names, route.actuator_joints, self._actuator_names
        if self._directly_actuated:
            return actuation_of(self._transfer(np.zeros((1, self._n)), RowFailures()), *names)
        home = self.home
        near = home + _VERDICT_SPREAD * np.random.default_rng(0).standard_normal((_VERDICT_POSES, self._n))
        samples = self._transfer(np.vstack([home, near]), RowFailures())
        return actuation_of(samples, *names)

    def _transfer(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Rates of the actuated joints per independent velocity, (..., m, n)."""
        if not self._directly_actuated and self._m:
            return self._route.actuator_jacobian(q, failures)
        selection = np.zeros((self._m, self._n))
        selection[np.arange(self._m), [self.joint_names.index(name) for name in self._route.actuator_joints]] = 1.0
        return np.broadcast_to(selection, (*q.shape[:-1], self._m, self._n)).copy()

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
        return self._recipe.with_parameters(parameters).build() if parameters else self

    @property
    def legs(self) -> Mapping[str, str | None]:
        """Names of a robot's legs, arms and heads, each with the link that is its foot (None: not clear); see `leg`."""
        from leg_dynamics.description.legs import legs_of

        return {name: part.foot for name, part in legs_of(self._recipe.read()).items()}

    def leg(self, name: str, foot: str | None = None) -> Leg:
        """One leg of a robot as a leg of its own, its trunk fixed.

        Parameters
        ----------
        name : str
            One of `legs`, or a link of the leg, which is then its foot.
        foot : str, optional
            Link whose origin is the foot.

        Returns
        -------
        Leg
            With the joints, loops and actuators that belong to it. Foot quantities are in the frame of the link ``hip``
            where the robot has one, else in the root's.

        Raises
        ------
        DescriptionError
            There is no such leg, or its foot is not clear.
        ParameterError
            The name or the foot is no text.
        """
        return self._recipe.of_part(name, foot).build()

    def assembly_modes(self, q: ArrayLike | None = None, *, attempts: int = 100, seed: int = 0) -> tuple[Any, ...]:
        """Closed poses at the same independent coordinates (routes pinocchio and symbolic).

        Found by multi-start from deterministic places: with many loops some may be missed, and more `attempts` find
        more. Two of them may be joined by a way around the singular poses. `leg_dynamics.load` takes their names as
        ``mode`` where they are those of the home pose.

        Parameters
        ----------
        q : (n,) array_like, optional
            Independent coordinates, rad or m; those of the home pose where None.
        attempts, seed : int
            Number of starting places, at least 1, and their seed.

        Returns
        -------
        tuple of AssemblyMode
            With ``name``, ``coordinates`` by joint, ``regularity``, ``configurations``; the one in use is the first.

        Raises
        ------
        AssemblyError, SingularityError
            The mode in use has no pose at q.
        """
        find = self._only("assembly_modes")
        for name, value, least in (("attempts", attempts, 1), ("seed", seed, 0)):
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
                raise ShapeError(f"{name} must be a whole number, at least {least}, got {value!r}", argument=name)
        if q is None:
            found: tuple[Any, ...] = find(None, int(attempts), int(seed))
            return found
        call = self._arguments("raise", q=(q, self._n))
        if not call.single:
            raise ShapeError("assembly_modes takes one sample, shape (n,)")
        if call.failures:
            raise call.failures.combined(None)
        found = find(call.arrays["q"], int(attempts), int(seed))
        return found

    # ------------------------------------------------------------------ shapes

    def _arguments(self, on_error: OnError, **named: tuple[ArrayLike | None, int]) -> _Call:
        arrays = {
            name: None if value is None and name in OPTIONAL else checked(name, value, size)  # type: ignore[arg-type]
            for name, (value, size) in named.items()
        }
        return _Call(arrays, on_error)

    def _quickly(self, name: str, *arrays: Any) -> np.ndarray | None:
        """Evaluate a kernel of the route at once; None where the arguments or a row need the careful way.

        The kernel itself checks shapes, and marks rows whose input or result is not finite.
        """
        quick = self._quick.get(name)
        if quick is None:
            return None
        if quick.row is not None and (row := quick.row(*arrays)) is not None:
            return row
        large = False
        for array in arrays:
            if type(array) is not _ARRAY or array.dtype is not _FLOAT:
                return None
            large |= array.size > _QUICK_SIZE
        before = quick.counter[0]
        try:
            result = (quick.batch if large else quick.single)(*arrays)
        except ValueError:  # shapes, which the careful way names
            return None
        return result if quick.counter[0] == before else None

    def _torque_into(self, out: Any, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray | None:
        """The quick way with a result array whose rows are those of all three arguments."""
        quick = self._quick_torque
        if quick is None or type(out) is not _ARRAY or out.dtype is not _FLOAT or not out.flags.writeable:
            return None
        leading = q.shape[:-1]
        if v.shape[:-1] != leading or a.shape[:-1] != leading or out.shape != (*leading, self._m):
            return None
        # A row that then needs the careful way must find its arguments as they were.
        if any(np.may_share_memory(out, array) for array in (q, v, a)):
            return None
        before = quick.counter[0]
        try:
            if q.size > _QUICK_SIZE:
                quick.batch(q, v, a, out=out)
            else:
                quick.single(q, v, a, out=out)
        except ValueError:
            return None
        return out if quick.counter[0] == before else None

    def _learn(self, name: str) -> None:
        """Remember the route's kernel for a method, made by the call that has just succeeded."""
        offered = getattr(self._route, "quick", None)
        quick = None if offered is None else offered(name)
        if quick is not None:
            self._quick[name] = quick
            if name == "torque":
                object.__setattr__(self, "_quick_torque", quick)
                object.__setattr__(self, "_torque_row", quick.row)

    def _run(self, call: _Call, name: str, shape: tuple[int, ...], *names: str, out: Any = None) -> np.ndarray:
        """Evaluate a method of the route on checked arguments."""
        result = call.run(getattr(self._route, name), shape, *names, out=out)
        if name not in self._quick:
            self._learn(name)
        return result

    def _loads(self, foot_force: ArrayLike | None, gravity: ArrayLike | None) -> tuple[ArrayLike, ArrayLike]:
        return _NO_FORCE if foot_force is None else foot_force, self._gravity if gravity is None else gravity

    def _need_foot(self) -> None:
        if not self._route.has_foot:
            raise MissingFootError(f"the foot of {self.name!r} is not named: load it with foot='LINK'")

    # ------------------------------------------------------------------ kinematics

    def assemble(self, q: ArrayLike, *, on_error: OnError = "raise") -> dict[str, np.ndarray]:
        """Tree joint coordinates that close the loops.

        Whole turns of a passive angle are no other pose: it is given within half a turn of the home pose, except where
        that is outside the joint's limits and another whole turn is inside. (`analysis.trajectories.assemble_along`
        gives angles that are continuous along a motion instead.) Angles in couplings stay as they are.

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
        result = self._whole_turns()(call.run(self._route.tree_coordinates, (len(self.tree_joint_names),), "q"))
        return {name: result[..., i] for i, name in enumerate(self.tree_joint_names)}

    def _whole_turns(self) -> WholeTurns:
        if self._turns is None:
            from leg_dynamics.description.turns import WholeTurns

            names, home = self.tree_joint_names, np.full(len(self.tree_joint_names), np.nan)
            # Without a home pose it is what the file states.
            with suppress(LegDynamicsError):
                home = self._route.tree_coordinates(self.home, RowFailures())
            object.__setattr__(self, "_turns", WholeTurns(self._description, names, self.joint_names, home))
        turns = self._turns
        assert turns is not None
        return turns

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
        if on_error == "raise" and (quick := self._quickly("foot_position", q)) is not None:
            return quick
        return self._run(self._arguments(on_error, q=(q, self._n)), "foot_position", (3,), "q")

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
            Whether a solution outside the joint limits is an error. The limits of passive joints count too, also in
            the assembly mode of a branch that is not the one which the leg's other methods follow.

        Returns
        -------
        (..., n) array
            rad or m.

        Raises
        ------
        OutOfReachError
            No solution; `margin` is the missing distance, negative, in metres.
        BranchError
            Another branch has a solution, this one has none.
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
                rows = np.atleast_2d(q)
                joints = [self._description.joint(name) for name in self.joint_names]
                self._check_limits(rows, rows, joints, failures)
                self._check_passive_limits(rows, np.atleast_2d(p), chosen, failures)
            return q

        try:
            return call.run(solve, (self._n,), "p")
        except RowError as error:
            raise self._with_place(error) from None

    def _with_place(self, error: RowError) -> RowError:
        """The error, which in a leg assembled from modules names the module of the joint, or that of the foot."""
        from leg_dynamics.description.places import with_place

        return with_place(self._description, self._foot, error)

    def _check_passive_limits(self, q: np.ndarray, p: np.ndarray, branch: str, failures: RowFailures) -> None:
        places = [
            (place, joint)
            for place, joint in enumerate(map(self._description.joint, self._route.tree_joint_names))
            if joint.name not in self.joint_names and np.isfinite([joint.limits.lower, joint.limits.upper]).any()
        ]
        known = np.flatnonzero(np.isfinite(q).all(axis=1))
        if not places or not known.size:
            return
        columns = [place for place, _ in places]
        values = np.full((len(q), len(places)), np.nan)
        # In the route's own mode. Where its foot is elsewhere, the branch belongs to another one.
        away = np.abs(self._route.foot_position(q[known], RowFailures()) - p[known]).max(axis=1)
        here = away < _SAME_PLACE * (1.0 + np.abs(p[known]).max(axis=1))
        known, elsewhere = known[here], known[~here]
        if known.size:
            values[known] = self._route.tree_coordinates(q[known], RowFailures())[:, columns]
        if elsewhere.size and (in_branch := getattr(self._route, "tree_coordinates_in_branch", None)) is not None:
            values[elsewhere] = in_branch(q[elsewhere], branch)[:, columns]
        for column, (_, joint) in enumerate(places):
            if joint.unit == "rad":  # whole turns are no other pose
                middle = (joint.limits.lower + joint.limits.upper) / 2
                if np.isfinite(middle):
                    values[:, column] = middle + (values[:, column] - middle + np.pi) % (2 * np.pi) - np.pi
        self._check_limits(q, values, [joint for _, joint in places], failures)

    @staticmethod
    def _check_limits(q: np.ndarray, values: np.ndarray, joints: Sequence[Joint], failures: RowFailures) -> None:
        """Report rows whose values leave the limits of their joints, and make them NaN in q."""
        limits = np.array([(joint.limits.lower, joint.limits.upper) for joint in joints]).T
        margin = np.minimum(values - limits[0], limits[1] - values)
        outside = np.flatnonzero((margin < -LIMIT_TOLERANCE).any(axis=1))
        if outside.size == 0:
            return
        worst = int(np.nanargmin(margin[outside[0]]))
        name, value, unit = joints[worst].name, values[outside[0], worst], joints[worst].unit
        failures.add(
            outside,
            JointLimitError(
                f"{name} = {value:.6g} {unit} is outside [{limits[0, worst]:.6g}, {limits[1, worst]:.6g}] "
                f"by {-margin[outside[0], worst]:.3g}; choose another foot position or branch, or pass limits='ignore'",
                rows=outside,
                margin=np.nanmin(margin[outside], axis=1),
                joint=name,
            ),
        )
        q[outside] = np.nan

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
        if on_error == "raise" and (quick := self._quickly("foot_jacobian", q)) is not None:
            return quick
        return self._run(self._arguments(on_error, q=(q, self._n)), "foot_jacobian", (3, self._n), "q")

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
        if on_error == "raise" and (quick := self._quickly("foot_jacobian_derivative", q, v)) is not None:
            return quick
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n))
        return self._run(call, "foot_jacobian_derivative", (3, self._n), "q", "v")

    def foot_velocity(self, q: ArrayLike, v: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Foot velocity J v in the hip frame, m/s, shape (..., 3)."""
        self._need_foot()
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n))

        def velocity(q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
            return np.einsum("...ij,...j->...i", self._route.foot_jacobian(q, failures), v)

        return call.run(velocity, (3,), "q", "v")

    def foot_acceleration(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
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
        if on_error == "raise" and (quick := self._quickly("mass_matrix", q)) is not None:
            return quick
        return self._run(self._arguments(on_error, q=(q, self._n)), "mass_matrix", (self._n, self._n), "q")

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
        if on_error == "raise":
            quick = self._quickly("bias", q, v, self._gravity if gravity is None else gravity)
            if quick is not None:
                return quick
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n), gravity=(gravity, 3))
        return self._run(call, "bias", (self._n,), "q", "v", "gravity")

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

    @overload
    def torque(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        out: np.ndarray | None = None,
        *,
        weights: ArrayLike | None = None,
        bounds: Any = None,
        preload: ArrayLike | None = None,
        allow_idle: Literal[False] = False,
        on_error: OnError = "raise",
    ) -> np.ndarray: ...

    @overload
    def torque(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        out: np.ndarray | None = None,
        *,
        weights: ArrayLike | None = None,
        bounds: Any = None,
        preload: ArrayLike | None = None,
        allow_idle: Literal[True],
        on_error: OnError = "raise",
    ) -> IdleTorque: ...

    def torque(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        out: np.ndarray | None = None,
        # Not behind the star: filling in the defaults of keywords takes longer, and this is called in control loops.
        weights: ArrayLike | None = None,
        bounds: Any = None,
        preload: ArrayLike | None = None,
        allow_idle: bool = False,
        *,
        on_error: OnError = "raise",
    ) -> np.ndarray | IdleTorque:
        """Inverse dynamics: actuator efforts for a motion.

        With one actuator a motion they are unique. Of more actuators the efforts with the least sum of
        ``weights * (effort - preload)**2`` are taken, by default those of smallest norm; within `bounds` where those
        are given. Motions that no actuator holds are an error that names them, unless `allow_idle`.

        Parameters
        ----------
        q, v, a : (..., n) array_like
            Independent coordinates, rates and accelerations.
        foot_force : (..., 3) array_like, optional
            Force that the environment applies to the foot, N, hip frame. (Xu 2025 (49)-(50) count the force that the
            foot exerts: the opposite sign.)
        gravity : (..., 3) array_like, optional
            Gravity vector in the hip frame, m/s².
        out : (..., m) float64 array, optional
            Receives the result; where an error is raised, its content is not defined.
        weights : (m,) array_like, optional
            Positive; 1 where None. Where efforts in N and in N·m mix, these say what a N·m is worth.
        bounds : bool, (m,) array_like or pair of (m,) array_like, optional
            True: the effort limits of the actuated joints, both ends; one array: the same both ways; two: lower and
            upper.
        preload : (..., m) array_like, optional
            Efforts to be near to, N·m or N; what of them does no work is kept.
        allow_idle : bool
            Whether motions that no actuator holds may stay unbalanced.

        Returns
        -------
        (..., m) array
            N·m or N, in the order of `actuator_names`. Joint limits are not enforced. With `allow_idle`, an
            `IdleTorque`: ``torque`` (..., m) and ``residual`` (..., n), which is zero but for the idle coordinates of
            `actuation`.

        Raises
        ------
        ShapeError, NonFiniteError
            The arguments are not usable.
        AssemblyError, SingularityError
            The loops cannot be closed there in this assembly mode.
        ActuationError
            No actuator holds some motion; the error names it.
        EffortLimitError
            No efforts within `bounds` are enough; `needed` says how many times the bounds would be.
        ParameterError
            `weights`, `bounds` or `preload` are not usable.
        """
        if weights is not None or bounds is not None or preload is not None or allow_idle:
            return self._shared_torque(
                q, v, a, foot_force, gravity, out, weights, bounds, preload, allow_idle, on_error
            )
        if foot_force is None and gravity is None:
            # Written out: this is the inner loop of a controller, and a function call costs a tenth of it.
            row = self._torque_row
            if row is not None and on_error == "raise":
                result = row(q, v, a) if out is None else row(q, v, a, out)
                if result is not None:
                    return result
            quick = self._quick_torque
            if (
                quick is not None
                and type(q) is type(v) is type(a) is _ARRAY
                and q.dtype is v.dtype is a.dtype is _FLOAT
                and on_error == "raise"
            ):
                if out is not None:
                    if self._torque_into(out, q, v, a) is not None:
                        return out
                else:
                    single, batch, counter, _ = quick
                    before = counter[0]
                    try:
                        result = single(q, v, a) if q.size < _QUICK_SIZE else batch(q, v, a)
                    except ValueError:  # shapes, which the careful way names
                        pass
                    else:
                        if counter[0] == before:
                            return result
        else:
            if foot_force is not None:
                self._need_foot()
            if out is None and on_error == "raise":
                loaded = self._quickly("loaded_torque", q, v, a, *self._loads(foot_force, gravity))
                if loaded is not None:
                    return loaded
        if not self._directly_actuated and self.actuation.kind != "exact":
            shared: np.ndarray = self._shared_torque(  # type: ignore[assignment]
                q, v, a, foot_force, gravity, out, None, None, None, False, on_error
            )
            return shared
        call = self._arguments(
            on_error,
            q=(q, self._n),
            v=(v, self._n),
            a=(a, self._n),
            foot_force=(foot_force, 3),
            gravity=(gravity, 3),
        )
        result = call.run(self._route.torque, (self._m,), "q", "v", "a", "foot_force", "gravity", out=out)
        name = "torque" if foot_force is None and gravity is None else "loaded_torque"
        if name not in self._quick:
            self._learn(name)
        return result

    def _shared_torque(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        foot_force: ArrayLike | None,
        gravity: ArrayLike | None,
        out: Any,
        weights: Any,
        bounds: Any,
        preload: ArrayLike | None,
        allow_idle: bool,
        on_error: OnError,
    ) -> np.ndarray | IdleTorque:
        """`torque` where the motion alone does not determine the efforts, or they are bounded."""
        if foot_force is not None:
            self._need_foot()
        if not isinstance(allow_idle, bool):
            raise ParameterError(f"allow_idle must be True or False, got {allow_idle!r}", parameter="allow_idle")
        verdict = self.actuation
        if verdict.idle and not allow_idle:
            raise ActuationError.of_idle(repr(self.name), verdict, self._route.actuator_joints)
        m, n = self._m, self._n
        wanted = None if preload is None else checked("preload", preload, m)
        limits = self._actuator_limits
        policy = Policy.of(m, (limits.effort_lower, limits.effort), weights, bounds, wanted)
        call = self._arguments(
            on_error,
            q=(q, n),
            v=(v, n),
            a=(a, n),
            foot_force=(foot_force, 3),
            gravity=(gravity, 3),
            preload=(policy.preload, m),
        )

        def shared(*arrays: Any) -> np.ndarray:
            q, v, a, foot_force, gravity, wanted, failures = arrays
            force = self._route.generalized_force(q, v, a, foot_force, gravity, failures)
            transfer = self._transfer(q, failures)
            rows = np.asarray(force).reshape(-1, n)
            # Not -1: without actuators an array has no numbers to count its rows by.
            chosen = policy._replace(preload=np.asarray(wanted).reshape(len(rows), m))
            samples = np.asarray(transfer).reshape(len(rows), m, n)
            parts = chosen.efforts(samples, rows, verdict, self.joint_names, failures)
            return np.hstack(parts).reshape(*np.asarray(force).shape[:-1], m + n)

        whole = call.run(shared, (m + n,), "q", "v", "a", "foot_force", "gravity", "preload")
        tau = whole[..., :m]
        if out is not None:
            call.check_out(out, tau.shape)
            out[...] = tau
            tau = out
        return IdleTorque(tau, whole[..., m:]) if allow_idle else tau.copy() if out is None else tau

    def actuator_jacobian(self, q: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Rates of the actuated joints per independent velocity: ``A @ v``, and ``A.T @ torque`` = generalised force.

        Parameters
        ----------
        q : (..., n) array_like
            Independent coordinates, rad or m.

        Returns
        -------
        (..., m, n) array
        """
        call = self._arguments(on_error, q=(q, self._n))
        return call.run(self._transfer, (self._m, self._n), "q")

    def feasible(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        *,
        torque: ArrayLike | None = None,
        on_error: OnError = "raise",
        **policy: Any,
    ) -> Feasibility:
        """Whether the actuators can do a motion: efforts, speeds, and both together.

        Limits are those of the file: ``effort``, ``effort_lower`` and ``velocity`` of the actuated joints, and the
        straight line from ``stallTorque`` to ``noLoadSpeed`` of a transmission's actuator where it states them.

        Parameters
        ----------
        q, v, a, foot_force, gravity
            As in `torque`.
        torque : (..., m) array_like, optional
            Efforts to judge; those of `torque` where None.
        **policy
            ``weights``, ``bounds``, ``preload`` of `torque`.

        Returns
        -------
        Feasibility
            ``bool()`` of it says whether all samples are feasible; ``.ok`` (..., m), ``.effort_margin``,
            ``.speed_margin``, ``.curve_margin`` (..., m) say where and by how much.
        """
        if torque is None:
            torque = self.torque(q, v, a, foot_force, gravity, on_error=on_error, **policy)
        elif policy:
            raise ParameterError(f"{', '.join(policy)}: choices of efforts, but torque is given", parameter="torque")
        if isinstance(torque, IdleTorque):
            torque = torque.torque
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n), torque=(torque, self._m))

        def rates(q: np.ndarray, v: np.ndarray, torque: np.ndarray, failures: RowFailures) -> np.ndarray:
            speeds = (self._transfer(q, failures) @ v[..., None])[..., 0]
            return np.concatenate([torque, speeds], axis=-1)

        whole = call.run(rates, (2 * self._m,), "q", "v", "torque")
        drives = {each.joint: each for each in self._description.transmissions}
        lines = [
            (math.inf, math.inf) if (drive := drives.get(name)) is None else drive.line_at_joint
            for name in self._route.actuator_joints
        ]
        return feasibility(
            whole[..., : self._m], whole[..., self._m :], self._actuator_limits, lines, self._actuator_names
        )

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
        if on_error == "raise":
            quick = self._quickly("generalized_force", q, v, a, *self._loads(foot_force, gravity))
            if quick is not None:
                return quick
        call = self._arguments(
            on_error,
            q=(q, self._n),
            v=(v, self._n),
            a=(a, self._n),
            foot_force=(foot_force, 3),
            gravity=(gravity, 3),
        )
        return self._run(call, "generalized_force", (self._n,), "q", "v", "a", "foot_force", "gravity")

    def foot_force(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        tau: ArrayLike,
        gravity: ArrayLike | None = None,
        *,
        on_error: OnError = "raise",
    ) -> np.ndarray:
        """Force of the environment on the foot that goes with a motion and measured actuator efforts.

        Solves J^T foot_force = M a + h - tau, Xu 2025 (47)-(48), who count the force that the foot exerts: the opposite
        sign. The inverse of `torque`: foot_force(q, v, a, torque(q, v, a, F)) = F.

        Parameters
        ----------
        q, v, a : (..., 3) array_like
            Independent coordinates, rates and accelerations.
        tau : (..., 3) array_like
            Actuator efforts, N·m or N, in the order of `actuator_names`.
        gravity : (..., 3) array_like, optional
            Gravity vector in the hip frame, m/s².

        Returns
        -------
        (..., 3) array
            N, hip frame.

        Raises
        ------
        SingularityError
            J^-T does not exist there (OmniLeg: gamma = 0); `margin` is the smallest singular value of the actuators' J.
        UnsupportedError
            The leg has not three coordinates.
        ActuationError
            The leg has not three actuators.
        """
        self._need_foot()
        if self._n != 3:
            raise UnsupportedError(
                f"{self.name!r} has {self._n} coordinates, but the three components of a foot force follow from three: "
                "use jacobian and generalized_force",
                coordinates=self._n,
            )
        if self._m != 3:
            raise ActuationError(
                f"{self.name!r} has 3 coordinates and {self._m} actuators: their efforts do not determine the foot "
                "force; use jacobian and generalized_force",
                motions=self._n,
                actuators=self._m,
            )
        call = self._arguments(on_error, q=(q, 3), v=(v, 3), a=(a, 3), tau=(tau, 3), gravity=(gravity, 3))
        return call.run(self._solve_foot_force, (3,), "q", "v", "a", "tau", "gravity")

    def _solve_foot_force(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        tau: np.ndarray,
        gravity: np.ndarray | None,
        failures: RowFailures,
    ) -> np.ndarray:
        missing = np.atleast_2d(self._route.torque(q, v, a, None, gravity, failures) - tau)
        transfer = self._effort_of_unit_forces(q, failures).reshape(-1, 3, 3)
        finite = np.isfinite(transfer).all(axis=(1, 2)) & np.isfinite(missing).all(axis=1)
        sigma = np.zeros((len(transfer), 3))
        sigma[finite] = np.linalg.svd(transfer[finite], compute_uv=False)
        solvable = finite & (sigma[:, 2] >= LEAST_RECIPROCAL_CONDITION * sigma[:, 0])
        failing = np.flatnonzero(finite & ~solvable)
        if failing.size:
            first, smallest = np.atleast_2d(q)[failing[0]], sigma[failing[0], 2]
            pose = ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.joint_names, first, strict=True))
            failures.add(
                failing,
                SingularityError(
                    f"the foot force does not follow from the efforts at {pose}: in one direction it needs none "
                    f"(smallest singular value of J {smallest:.3g}, largest {sigma[failing[0], 0]:.3g}); bend "
                    "the leg, or give a foot force and ask for torques",
                    rows=failing,
                    margin=sigma[failing, 2],
                ),
            )
        force = np.full(missing.shape, np.nan)
        force[solvable] = np.linalg.solve(transfer[solvable], missing[solvable][..., None])[..., 0]
        return force.reshape(q.shape)

    def _effort_of_unit_forces(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Efforts that the actuators are spared by each unit foot force, (..., 3 efforts, 3 forces)."""
        route = self._route
        if set(route.actuator_joints) == set(route.joint_names):
            actuated = [route.joint_names.index(name) for name in route.actuator_joints]
            return np.swapaxes(route.foot_jacobian(q, failures), -1, -2)[..., actuated, :]
        zero = np.zeros_like(q)
        units = [np.broadcast_to(unit, q.shape) for unit in np.eye(3)]
        return -np.stack([route.torque(q, zero, zero, unit, zero, failures) for unit in units], axis=-1)

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
        if on_error == "raise":
            quick = self._quickly("acceleration", q, v, tau, *self._loads(foot_force, gravity))
            if quick is not None:
                return quick
        call = self._arguments(
            on_error,
            q=(q, self._n),
            v=(v, self._n),
            tau=(tau, self._m),
            foot_force=(foot_force, 3),
            gravity=(gravity, 3),
        )
        return self._run(call, "acceleration", (self._n,), "q", "v", "tau", "foot_force", "gravity")

    # ------------------------------------------------------------------ derivatives and identification

    def torque_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        *,
        parameters: Sequence[str] = (),
        on_error: OnError = "raise",
    ) -> TorqueDerivatives:
        """Actuator efforts differentiated, exactly and along the closed loops (routes closed_form and symbolic).

        Parameters
        ----------
        q, v, a, foot_force, gravity
            As in `torque`.
        parameters : sequence of str, optional
            Design parameters (see `parameters`) or numbers of the mechanism (see `numbers`) to differentiate by as
            well. A design parameter moves every length, mass and inertia that the leg's source computes from it.

        Returns
        -------
        TorqueDerivatives
            ``q``, ``v``, ``a`` of shape (..., m, n) and ``parameters`` (..., m, len(parameters)).

        Raises
        ------
        ParameterError
            A name is unknown, or the mechanism does not depend on it smoothly.
        UnsupportedError
            The route has no derivatives.
        """
        if foot_force is not None:
            self._need_foot()
        rows = self._differentiated(
            "torque_derivatives", self._m, ("q", "v", "a"), (q, v, a), (foot_force, gravity), parameters, on_error
        )
        return TorqueDerivatives(*rows)

    def acceleration_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        foot_force: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        *,
        parameters: Sequence[str] = (),
        on_error: OnError = "raise",
    ) -> AccelerationDerivatives:
        """Forward dynamics differentiated, exactly and along the closed loops (routes closed_form and symbolic).

        Parameters
        ----------
        q, v, tau, foot_force, gravity
            As in `acceleration`.
        parameters : sequence of str, optional
            As in `torque_derivatives`.

        Returns
        -------
        AccelerationDerivatives
            ``q``, ``v`` of shape (..., n, n), ``tau`` (..., n, m) and ``parameters`` (..., n, len(parameters)).
        """
        if foot_force is not None:
            self._need_foot()
        names, arguments, loads = ("q", "v", "tau"), (q, v, tau), (foot_force, gravity)
        rows = self._differentiated("acceleration_derivatives", self._n, names, arguments, loads, parameters, on_error)
        return AccelerationDerivatives(*rows)

    def _differentiated(
        self,
        method: str,
        height: int,
        names: tuple[str, ...],
        arguments: tuple[ArrayLike, ...],
        loads: tuple[ArrayLike | None, ArrayLike | None],
        parameters: Sequence[str],
        on_error: OnError,
    ) -> list[np.ndarray]:
        function = self._only(method)
        if isinstance(parameters, str):
            raise ParameterError(
                f"parameters is a sequence of names, got the text {parameters!r}: write ({parameters!r},)"
            )
        if not isinstance(parameters, Iterable):
            raise ParameterError(f"parameters is a sequence of names, got {parameters!r}: leave it out for none")
        numbers, chain = self._recipe.number_derivatives(tuple(parameters), self._route)
        sizes = [self._m if name == "tau" else self._n for name in names]
        given = dict(zip(names, zip(arguments, sizes, strict=True), strict=True))
        call = self._arguments(on_error, **given, foot_force=(loads[0], 3), gravity=(loads[1], 3))

        def columns(*arrays: Any) -> np.ndarray:
            *values, failures = arrays
            return function(*values, numbers, failures)

        whole = call.run(columns, (height, sum(sizes) + len(numbers)), *names, "foot_force", "gravity")
        parts = np.split(whole, np.cumsum(sizes), axis=-1)
        return [*parts[:-1], parts[-1] @ chain]

    @property
    def numbers(self) -> Mapping[str, float]:
        """Lengths, masses and inertias that the route computes with, by name, SI units (closed_form and symbolic).

        ``knee.mass``, ``knee.com.z``, ``knee.ixx`` ... of every body; lengths have the names that the route gives them.
        """
        return dict(self._only("numbers_of")(self._description))

    @property
    def base_parameters(self) -> Mapping[str, Parameter]:
        """Fewest inertial parameters that the torques are linear in (route closed_form); see `regressor`."""
        from leg_dynamics.description.model import Parameter

        values = self._only("base_parameters")
        return {name: Parameter(name, value, unit, "the file's inertias") for name, (value, unit) in values.items()}

    def regressor(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        gravity: ArrayLike | None = None,
        *,
        on_error: OnError = "raise",
    ) -> np.ndarray:
        """Matrix Y of torque = Y pi, pi = `base_parameters`, for identification (route closed_form).

        Losses and a foot force are not part of Y pi: subtract theirs from measured torques.

        Parameters
        ----------
        q, v, a : (..., n) array_like
        gravity : (..., 3) array_like, optional
            Gravity vector in the hip frame, m/s².

        Returns
        -------
        (..., m, k) array
            Of full column rank k over random states in gravity of random directions. In one direction of gravity alone
            the columns of moments that it never turns are zero: those of ``input_x`` and ``input_y`` for the OmniLeg
            hanging straight.
        """
        function = self._only("regressor")
        call = self._arguments(on_error, q=(q, self._n), v=(v, self._n), a=(a, self._n), gravity=(gravity, 3))
        count = self._base_count
        if count is None:
            count = len(self._only("base_parameters"))
            object.__setattr__(self, "_base_count", count)
        return call.run(function, (self._m, count), "q", "v", "a", "gravity")

    # ------------------------------------------------------------------ what only some routes offer

    def kernel(self, name: str, vary: Sequence[str] = ()) -> Callable[..., np.ndarray]:
        """Compiled formula whose numbers can be arrays, for design sweeps (route closed_form).

        Parameters
        ----------
        name : str
            ``foot_position``, ``foot_jacobian``, ``mass_matrix``, ``bias``, ``torque``, ``loaded_torque``,
            ``acceleration``, ``inverse_kinematics`` ...; the error for another name lists them all.
        vary : sequence of str, optional
            Names out of `numbers`: they become a last input of shape (..., len(vary)) instead of constants. Changed
            geometry is not checked against anything but the domain of the formula.

        Returns
        -------
        leg_dynamics.kernels.Kernel
            ``kernel(*arrays, out=None, threads=None)``, its inputs named by ``inputs``; leading dimensions broadcast,
            and rows that cannot be computed are NaN.

        Raises
        ------
        ParameterError
            There is no formula of that name, or no such number.
        """
        if not isinstance(name, str):
            raise ParameterError(f"a formula's name is text, got {name!r}", parameter=name)
        made: Callable[..., np.ndarray] = self._only("kernel")(name, tuple(vary))
        return made

    def _only(self, method: str) -> Any:
        try:
            return getattr(self._route, method)
        except AttributeError:
            routes = _ROUTES_WITH.get(method, "closed_form or symbolic")
            raise UnsupportedError(
                f"route {self.route!r} has no {method}: load the leg by route {routes}", route=self.route
            ) from None

    def mobility_report(self, samples: int = 20, seed: int = 0) -> Any:
        """Gruebler count beside the numeric rank of the loop rows (pinocchio route).

        Returns
        -------
        MobilityReport
            With ``mobility``, ``redundant``, ``gruebler``, ``poses``, ``to_dict()``.
        """
        return self._only("mobility_report")(samples, seed)

    def foot_rotation(self, q: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Orientation of the foot link, R_HF: its axes, as columns, in the hip frame (pinocchio route).

        Parameters
        ----------
        q : (..., n) array_like
            Independent coordinates, rad or m.

        Returns
        -------
        (..., 3, 3) array
        """
        method = self._only("foot_rotation")
        self._need_foot()
        return self._arguments(on_error, q=(q, self._n)).run(method, (3, 3), "q")

    def geometric_jacobian(self, q: ArrayLike, *, on_error: OnError = "raise") -> np.ndarray:
        """Jacobian of the foot's velocity and angular velocity, (v, ω) = J yd, in the hip frame (pinocchio route).

        Parameters
        ----------
        q : (..., n) array_like
            Independent coordinates, rad or m.

        Returns
        -------
        (..., 6, n) array
            Rows 0-2 are those of `jacobian`, m/rad or m/m; rows 3-5 are rad/rad or rad/m.
        """
        method = self._only("geometric_jacobian")
        self._need_foot()
        return self._arguments(on_error, q=(q, self._n)).run(method, (6, self._n), "q")

    def rank_report(self, q: ArrayLike, characteristic_length: float | None = None, tolerance: float = 1e-6) -> Any:
        """Rank of the geometric Jacobian at one pose, and what foot and joints cannot or need not do (pinocchio route).

        Parameters
        ----------
        q : (n,) array_like
            Independent coordinates, rad or m.
        characteristic_length : float, optional
            m, makes rows and columns comparable; the distance from the hip to the foot in the home pose where None.
        tolerance : float
            Singular values below this share of the largest count as zero.

        Returns
        -------
        RankReport
            With ``rank``, ``deficient``, ``singular_values``, ``lost_directions``, ``self_motions``, ``to_dict()``;
            ``str()`` gives it in words.

        Raises
        ------
        ParameterError
            `characteristic_length` is not positive, or `tolerance` not between 0 and 1.
        AssemblyError, SingularityError
            The loops cannot be closed there, or so nearly singularly that the Jacobian means nothing.
        """
        method = self._only("rank_report")
        self._need_foot()
        call = self._arguments("raise", q=(q, self._n))
        if not call.single:
            raise ShapeError("rank_report takes one sample, shape (n,)")
        if call.failures:
            raise call.failures.combined(None)
        return method(call.arrays["q"], characteristic_length, tolerance)

    def pose_inverse_kinematics(
        self,
        p: ArrayLike,
        rotation: ArrayLike | None = None,
        *,
        start: ArrayLike | None = None,
        posture: ArrayLike | None = None,
        limits: Literal["error", "ignore"] = "error",
        starts: int = 40,
        on_error: OnError = "raise",
    ) -> Any:
        """Independent coordinates that put the foot at p, turned as asked, for any number of joints (pinocchio route).

        Damped least squares that keeps the joint limits on the way. Where joints are left over, they bring the leg as
        near to a posture as they can. The result depends on the arguments alone; a start nearby gives the solution
        nearby. To follow a path, pass the last solution as `start`, and as `posture` too.

        Parameters
        ----------
        p : (..., 3) array_like
            Foot position in the hip frame, m.
        rotation : (..., 3, 3) array_like, optional
            Foot orientation R_HF, as `foot_rotation` gives it; any where None. Orthonormal to 1e-9.
        start : (..., n) array_like, optional
            Where to start, inside the limits; the home pose where None.
        posture : (..., n) array_like, optional
            What the leg should be near to, each joint weighted by half its range; the middle of the limits where
            None, and the home pose for joints without limits.
        limits : {"error", "ignore"}
            Whether joints, passive ones too, must stay inside their limits.
        starts : int
            Starting poses to try before giving up. Each costs some milliseconds, more for a leg with loops.
        on_error : {"raise", "nan"}

        Returns
        -------
        PoseSolution
            With ``q`` (..., n), ``position_error``, ``rotation_error``, ``rank``, ``singular_values``,
            ``active_limits``, ``posture_cost``.

        Raises
        ------
        OutOfReachError
            No solution was found; `margin` is the missing distance, negative, in metres, `missing_angle` in rad
            (where an orientation was asked for), `nearest` the coordinates there.
        JointLimitError
            Solutions were found outside the limits only; `margin` is the least excess found, negative, in rad or m,
            `joint` the joint. Or the start is outside.
        ShapeError
            An argument has the wrong shape, or `rotation` is no rotation matrix.
        ParameterError
            `limits` or `starts` is not usable.
        """
        make = self._only("pose_inverse_kinematics")
        self._need_foot()
        search = make(rotation is not None, limits, starts)
        given = {"p": (p, 3), "start": (start, self._n), "posture": (posture, self._n)}
        if rotation is not None:
            given["rotation"] = (_checked_rotation(rotation), 9)
        given = {name: pair for name, pair in given.items() if pair[0] is not None}
        call = self._arguments(on_error, **given)

        def solve(*arrays: Any) -> np.ndarray:
            *values, failures = arrays
            named = dict(zip(given, values, strict=True))
            wanted = (named.get(name) for name in ("p", "rotation", "start", "posture"))
            columns: np.ndarray = search.columns(*wanted, failures)
            return columns

        try:
            return search.solution(call.run(solve, (search.width,), *given))
        except RowError as error:
            raise self._with_place(error) from None

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
        if not self.single:
            for name, array in given.items():
                size = array.shape[-1]
                whole = array if array.shape[:-1] == self.leading else np.broadcast_to(array, (*self.leading, size))
                self.arrays[name] = whole.reshape(self.count, size)
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

    def _find_overflow(self, result: np.ndarray) -> np.ndarray:
        """Report rows whose input is finite, that the route computed, and whose result is not finite."""
        finite = np.isfinite(result).reshape(self.count, -1).all(axis=1)
        known = self.failures.rows if self.failures else np.zeros(0, dtype=np.intp)
        rows = np.setdiff1d(np.flatnonzero(~finite), known)
        if rows.size == 0:
            return result
        given = {name: array for name, array in self.arrays.items() if array is not None}
        listing = ", ".join(f"{name} = {np.atleast_2d(array)[rows[0]].tolist()}" for name, array in given.items())
        self.failures.add(
            rows,
            NonFiniteError(
                f"the result at {listing} is too large for a float: check the units of the arguments",
                rows=rows,
                argument="result",
            ),
        )
        result = np.array(result, dtype=float)
        result.reshape(self.count, -1)[rows] = np.nan
        return result

    @staticmethod
    def check_out(out: Any, shape: tuple[int, ...]) -> None:
        """Refuse a result array of another shape or type."""
        given = type(out).__name__
        if isinstance(out, np.ndarray):
            if out.shape == shape and out.dtype == np.float64 and out.flags.writeable:
                return
            given = f"{'' if out.flags.writeable else 'read-only '}{out.dtype} {out.shape}"
        raise ShapeError(f"out must be a writeable float64 array of shape {shape}, got {given}")

    def run(
        self,
        function: Callable[..., np.ndarray],
        shape: tuple[int, ...],
        *names: str,
        out: np.ndarray | None = None,
    ) -> np.ndarray:
        """Evaluate on the rows whose input is finite, then raise or fill."""
        full = (*self.leading, *shape)
        if out is not None:
            self.check_out(out, full)
        if self.failures and self.on_error == "raise":
            raise self.failures.combined(None if self.single else self.count)
        with np.errstate(over="ignore", invalid="ignore"):
            if self.good is None:
                result = np.asarray(function(*(self.arrays[name] for name in names), self.failures))
            else:
                result = np.full((self.count, *shape), np.nan)
                if self.good.size:
                    arrays = [None if (a := self.arrays[n]) is None else np.atleast_2d(a)[self.good] for n in names]
                    result[self.good] = function(*arrays, RowFailures())
        if not np.isfinite(result).all():
            result = self._find_overflow(result)
        if self.failures and self.on_error == "raise":
            raise self.failures.combined(None if self.single else self.count)
        result = result.reshape(full)
        if out is None:
            return result
        out[...] = result
        return out
