"""The symbolic route: the interface's array methods over the Programs of one mechanism."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from leg_dynamics.description.topology import actuated_joints
from leg_dynamics.errors import AssemblyError, RowError, RowFailures, SingularityError, UnsupportedError
from leg_dynamics.symbolic.coordinates import reduce_coordinates
from leg_dynamics.symbolic.numbers import Numbers, is_inertial, number_values
from leg_dynamics.symbolic.tree import build_tree, characteristic_length

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description
    from leg_dynamics.kernels.program import Program
    from leg_dynamics.leg import Quick, Route
    from leg_dynamics.symbolic.graphs import Graphs
    from leg_dynamics.symbolic.model import Model

__all__ = ["Kernel", "SymbolicRoute"]

Kernel = Callable[..., Any]
"""A compiled Program: arrays in, leading dimensions broadcast; one array, or one an output; rows not valid are NaN."""

# Methods whose result may fail to exist although the loops are closed.
MAY_BE_SINGULAR = ("acceleration", "torque")

# Formulas of a mass matrix grow with the square of the joints.
MOST_JOINTS = 1000
# Torque in the file's gravity with a free foot: the inner loop of a controller has the fewest inputs.
FREE_TORQUE = "free_torque"
# Methods that `quick` offers; their arguments are the program's inputs.
QUICK = (
    "foot_position",
    "foot_jacobian",
    "foot_jacobian_derivative",
    "mass_matrix",
    "bias",
    "generalized_force",
    "acceleration",
)


class _Last(threading.local):
    """One thread's last closed pose: y and z, by the parameters of the model that it belongs to."""

    def __init__(self) -> None:
        self.poses: dict[tuple[str, ...], tuple[np.ndarray, np.ndarray]] = {}


class _Compiled(NamedTuple):
    """A method's kernel for batches and for single samples, and whether it solves for unknowns."""

    batch: Kernel
    single: Kernel
    solves: bool
    counter: Any = None
    """Of failed rows, where the kernel counts them."""
    row: Any = None
    """For a sample of plain arrays, see `leg_dynamics.kernels.Kernel`."""


def _without_force(function: Kernel) -> Kernel:
    """The kernel of a leg without a foot: the interface's zero force, last but one, is none of its inputs."""

    def free(*arrays: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        result: np.ndarray = function(*arrays[:-2], arrays[-1], **({} if out is None else {"out": out}))
        return result

    return free


class SymbolicRoute:
    """Any description's kinematics and dynamics by compiled graphs: immutable, safe to use from several threads.

    Graphs are made and compiled when a method is first called, and kept in the kernels' cache. Where loops need
    iteration, every sample is reached from the home pose. The one exception are mechanisms whose ways from home meet no
    singular pose: there a single sample starts from this thread's last closed pose if that is nearer, and may depend on
    it at the level of rounding.

    Parameters
    ----------
    description : Description
    foot, hip : str or None
        Link whose origin is the foot; link in whose frame foot quantities, forces and gravity are expressed.
    compile : callable, optional
        Turns a Program into a `Kernel`; by default `leg_dynamics.kernels`, with its cache.
    seed : callable that returns a mapping of str to float, optional
        Finds tree coordinates of a closed pose for files whose configurations define no assembly mode. It must depend
        on the description only.
    fallback : callable that returns a Route, optional
        Computes the rows that the kernels leave NaN, and names their errors. Called when first needed.
    threads : int, optional
        Threads for large batches; by default as many as pay.

    Raises
    ------
    DescriptionError, UnsupportedError
        The file cannot be modelled.
    """

    name = "symbolic"

    def __init__(
        self,
        description: Description,
        foot: str | None,
        hip: str | None,
        compile: Callable[[Program], Kernel] | None = None,
        *,
        seed: Callable[[], Mapping[str, float]] | None = None,
        fallback: Callable[[], Route] | None = None,
        threads: int | None = None,
    ) -> None:
        joints = len(description.moving_joints)
        if joints > MOST_JOINTS:
            raise UnsupportedError(
                f"{joints} tree joints are too many to be written out in formulas, the limit is {MOST_JOINTS}: fix "
                "joints that need not move, or model a part of the mechanism",
                joints=joints,
            )
        coordinates = reduce_coordinates(description)
        self._description = description
        self._foot, self._hip = foot, hip
        self._compile = compile
        self._seed = seed
        self._make_fallback = fallback
        self._threads = threads
        tree = build_tree(description, coordinates, Numbers.of(description), hip, characteristic_length(description))
        self.joint_names = coordinates.names[: coordinates.n]
        self.actuator_joints = actuated_joints(description)
        self.tree_joint_names = tuple(joint.name for joint in tree.joints)
        names = tuple(configuration.name for configuration in description.configurations)
        self.branches: tuple[str, ...] = names if names else ("home",)
        self.gravity = np.array(tree.gravity)
        self.gravity.setflags(write=False)
        self.has_foot = foot is not None
        self._lock = threading.RLock()
        self._models: dict[tuple[str, ...], Model] = {}
        self._kernels: dict[tuple[str, ...], _Compiled] = {}
        self._homes: dict[tuple[str, ...], tuple[tuple[np.ndarray, np.ndarray], np.ndarray]] = {}
        self._last = _Last()

    # ------------------------------------------------------------------ made when first needed

    @property
    def model(self) -> Model:
        """What is settled about the mechanism before any graph is made."""
        return self._model(())

    def _model(self, parameters: tuple[str, ...]) -> Model:
        """The model with some numbers as symbols."""
        with self._lock:
            if parameters not in self._models:
                from leg_dynamics.symbolic.model import build_model

                make = functools.partial(build_model, self._description, self._foot, self._hip, parameters=parameters)
                try:
                    model = make()
                except AssemblyError:
                    if self._seed is None:
                        raise
                    model = make(seed=self._seed())
                self._models[parameters] = model
            return self._models[parameters]

    def _graphs(self, parameters: tuple[str, ...]) -> Graphs:
        from leg_dynamics.symbolic.graphs import Graphs

        return Graphs(self._model(parameters))

    @cached_property
    def fallback(self) -> Route | None:
        """The route for rows that the kernels leave NaN."""
        with self._lock:
            return None if self._make_fallback is None else self._make_fallback()

    @cached_property
    def _ingredients(self) -> str:
        """Digest of everything that the graphs come from."""
        from leg_dynamics.kernels.cache import key_of, package_version, source_fingerprint

        # A home pose that the seed finds depends on the room that searches for it.
        rooms = ("symbolic", "description") if self._seed is None else ("symbolic", "description", "mechanism")
        sources = (source_fingerprint(f"leg_dynamics.{room}") for room in rooms)
        readers = (f"{name} {package_version(name)}" for name in ("numpy", "scipy", "casadi"))
        found = "" if self._seed is None else f"{self._seed.__module__} {self._seed.__qualname__}"
        return key_of(self._description.urdf, str(self._foot), str(self._hip), found, *sources, *readers)

    def _kernel(self, method: str, parameters: tuple[str, ...] = ()) -> _Compiled:
        key = (method, *parameters)
        found = self._kernels.get(key)
        if found is None:
            with self._lock:
                found = self._kernels.get(key)
                if found is None:
                    found = self._kernels[key] = self._made(method, parameters)
        return found

    def _made(self, method: str, parameters: tuple[str, ...]) -> _Compiled:
        def build() -> Program:
            program: Program = getattr(self._graphs(parameters), "torque" if method == FREE_TORQUE else method)()
            if method == FREE_TORQUE:
                from leg_dynamics.kernels import with_held

                loads = {"gravity": self.gravity.tolist()} | ({"foot_force": [0.0] * 3} if self.has_foot else {})
                program = with_held(program, method, loads)
            return program

        if self._compile is not None:
            program = build()
            kernel = self._compile(program)
            solves = any(argument.name == "z_start" for argument in program.inputs)
            return _Compiled(kernel, kernel, solves)
        from leg_dynamics.kernels import kernel as cached
        from leg_dynamics.kernels.cache import key_of

        compiled = cached(method, key_of(self._ingredients, method, *parameters), build)
        # Its bare ufunc spares a single sample the handling of options.
        batch = functools.partial(compiled, threads=self._threads)
        solves = any(argument.name == "z_start" for argument in compiled.inputs)
        return _Compiled(batch, compiled.ufunc, solves, compiled.counter, compiled.row)

    # ------------------------------------------------------------------ evaluation

    def quick(self, name: str) -> Quick | None:
        """Return the kernel of a method for arrays that need no checking, see `leg_dynamics.leg.QuickRoute`."""
        from leg_dynamics.leg import Quick

        method = {"torque": FREE_TORQUE, "loaded_torque": "torque"}.get(name, name)
        if self._compile is not None or (name == method and name not in QUICK):
            return None
        if name == "acceleration" and not self.actuator_joints:
            return None
        try:
            kernel = self._kernel(method)
        except RowError:  # no assembly mode is defined: every row is the fallback's
            return None
        single, batch, row = kernel.single, kernel.batch, kernel.row
        if kernel.solves:
            single, batch, row = self._started(single), self._started(batch), None
        if method in ("torque", "generalized_force", "acceleration") and not self.has_foot:
            single, batch, row = _without_force(single), _without_force(batch), None
        return Quick(single, batch, kernel.counter, row)

    def _started(self, function: Kernel) -> Kernel:
        """The kernel from the home pose, or for one sample from this thread's last pose, without the unknowns."""

        def solved(*arrays: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
            q = arrays[0]
            result: np.ndarray
            given = {} if out is None else {"out": (out, None)}
            result, z = function(*arrays, *self._start(q, ()), **given)
            if q.ndim == 1 and result.ndim == 1 and z[0] == z[0]:
                self._last.poses[()] = (q.copy(), z)
            return result

        return solved

    def _home(self, parameters: tuple[str, ...]) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """y and z of the home pose and the unit of y; kept in the cache, since they are all that a warm start needs."""
        found = self._homes.get(parameters)
        if found is None:
            from leg_dynamics.kernels import cache

            n = len(self.joint_names)
            key = cache.key_of("home", self._ingredients, *parameters)
            stored = None if self._compile is not None else cache.read(key)
            if stored is None:
                model = self._model(parameters)
                numbers = np.concatenate([model.unit[:n], model.seed])
                if self._compile is None:
                    cache.write(key, numbers.tobytes())
            else:
                numbers = np.frombuffer(stored)
            found = self._homes[parameters] = ((numbers[n : 2 * n], numbers[2 * n :]), numbers[:n])
        return found

    def _start(self, q: np.ndarray, parameters: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Where Newton starts: y and z of a closed pose."""
        home, unit = self._home(parameters)
        last = self._last.poses.get(parameters)
        if q.ndim > 1 or last is None:
            return home
        far = np.abs((q - last[0]) / unit).max() > np.abs((q - home[0]) / unit).max()
        return home if far else last

    def _call(self, method: str, arguments: tuple[np.ndarray, ...], parameters: tuple[str, ...] = ()) -> np.ndarray:
        """The method's result, without the unknowns."""
        kernel = self._kernel(method, parameters)
        q = arguments[0]
        function = kernel.single if q.ndim == 1 else kernel.batch
        if not kernel.solves:
            return function(*arguments)
        start = self._start(q, parameters)
        result, z = function(*arguments, *start)
        poses = self._last.poses
        if q.ndim == 1 and z[0] == z[0]:
            poses[parameters] = (q.copy(), z)
        elif q.ndim == 1 and parameters in poses and start[0] is poses[parameters][0]:
            # From the last pose the way may lead over a singular one: home decides.
            del poses[parameters]
            result, z = function(*arguments, *self._start(q, parameters))
        return result

    def kernel_rows(self, method: str, q: np.ndarray) -> np.ndarray:
        """A kinematic method of a batch (N, n) by its kernel alone; rows that it cannot compute are NaN.

        For sampling, where most rows may lie beyond the reach and the fallback would look at each of them.
        """
        try:
            return self._call(method, (q,))
        except RowError:  # no assembly mode is defined: every row is the fallback's
            return np.asarray(getattr(self, method)(q, RowFailures()))

    def _run(
        self,
        method: str,
        arguments: tuple[np.ndarray, ...],
        failures: RowFailures,
        retry: Callable[[Route, Callable[[np.ndarray | None], np.ndarray | None], RowFailures], np.ndarray],
        shape: tuple[int, ...],
    ) -> np.ndarray:
        """Evaluate a method; rows that the kernel leaves NaN go to the fallback, or fail."""
        q = arguments[0]
        try:
            result = self._call(method, arguments)
        except RowError as error:
            # No assembly mode is defined, or it is singular where it starts.
            if self._make_fallback is None:
                for row in range(1 if q.ndim == 1 else len(q)):
                    failures.add(row, error)
            result = np.full((*q.shape[:-1], *shape), np.nan)
        # All outputs of a row that is not valid are NaN: its first number tells.
        if q.ndim == 1:
            first = result.item(0)
            if first == first:  # noqa: PLR0124
                return np.asarray(result)
            count, bad = 1, np.ones(1, dtype=bool)
        else:
            count = len(q)
            bad = np.isnan(result.reshape(count, -1)[:, 0]) if count else np.zeros(0, dtype=bool)
            if not bad.any():
                return np.asarray(result)
        result = np.array(result, dtype=float)
        flat = result.reshape(count, *shape)
        for row in np.flatnonzero(bad).tolist():
            self._again(method, q, row, failures, retry, flat)
        return result

    def _again(
        self, method: str, q: np.ndarray, row: int, failures: RowFailures, retry: Callable[..., np.ndarray], flat: Any
    ) -> None:
        def pick(array: np.ndarray | None) -> np.ndarray | None:
            return None if array is None else array if array.ndim == 1 else array[row]

        fallback = self.fallback
        if fallback is not None:
            inner = RowFailures()
            flat[row] = retry(fallback, pick, inner)
            if inner:
                flat[row] = np.nan
                failures.add(row, inner.combined(None))
            return
        if failures and row in failures.rows:
            return
        self._name_failure(method, q if q.ndim == 1 else q[row], row, failures)

    def _name_failure(self, method: str, sample: np.ndarray, row: int, failures: RowFailures) -> None:
        """Report why a row failed; one whose result is too large is left to the interface."""
        if not np.isfinite(self._call("tree_coordinates", (sample,))).all():
            failures.add(row, self._not_closed(method, sample))
        elif (
            method.removeprefix("free_").split("_", maxsplit=1)[0] in MAY_BE_SINGULAR
            and np.isfinite(self._call("mass_matrix", (sample,))).all()
        ):
            failures.add(row, self._singular(method, sample))

    def _pose(self, y: np.ndarray) -> str:
        return ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.joint_names, y, strict=True))

    def _not_closed(self, method: str, y: np.ndarray) -> AssemblyError:
        advice = ", or use route='pinocchio', which says which"
        if method.endswith("_derivatives"):
            advice = "; the values may exist by route='pinocchio', and their differences serve instead of derivatives"
        return AssemblyError(
            f"the loops could not be closed at {self._pose(y)} in the assembly mode of the home pose, or are nearly "
            f"singular there: stay inside this mode's reach{advice}",
            residual=np.nan,
        )

    def _singular(self, method: str, y: np.ndarray) -> SingularityError:
        reason = (
            "a motion carries no mass"
            if method.startswith("acceleration")
            else "the actuators do not hold every motion"
        )
        method = method.removeprefix("free_")
        return SingularityError(f"{method} is not determined at {self._pose(y)}: {reason}; move away from this pose")

    def _gravity(self, gravity: np.ndarray | None) -> np.ndarray:
        return self.gravity if gravity is None else gravity

    def _tau(self, tau: np.ndarray) -> tuple[np.ndarray, ...]:
        """The efforts, which are no input of a mechanism without actuators."""
        return (tau,) if self.actuator_joints else ()

    def _force(self, foot_force: np.ndarray | None) -> tuple[np.ndarray, ...]:
        if not self.has_foot:
            return ()
        return (np.zeros(3) if foot_force is None else foot_force,)

    # ------------------------------------------------------------------ methods

    def tree_coordinates(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Closed tree coordinates, (..., n_tree)."""

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            found = route.tree_coordinates(pick(q), inner)
            order = [route.tree_joint_names.index(name) for name in self.tree_joint_names]
            return found[order]

        return self._run("tree_coordinates", (q,), failures, retry, (len(self.tree_joint_names),))

    @property
    def loop_gap(self) -> float:
        """What rounding leaves of the loops' residual, rad or m, by the fallback."""
        return float(getattr(self.fallback, "loop_gap", 0.0))

    def home_coordinates(self) -> np.ndarray:
        """Independent coordinates of the pose that defines the assembly mode, (n,)."""
        try:
            (y, _), _ = self._home(())
        except RowError:
            if self.fallback is None:
                raise
            return self.fallback.home_coordinates()
        return y.copy()

    def assembly_modes(self, q: np.ndarray | None, attempts: int, seed: int) -> Any:
        """Closed poses at the same independent coordinates, by the fallback.

        Raises
        ------
        UnsupportedError
            There is no fallback.
        """
        find = getattr(self.fallback, "assembly_modes", None)
        if find is None:
            raise UnsupportedError("this route does not look for assembly modes: use route='pinocchio'")
        return find(q, attempts, seed)

    def actuator_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Rates of the actuated joints per independent velocity, (..., m, n)."""

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.actuator_jacobian(pick(q), inner)

        shape = (len(self.actuator_joints), len(self.joint_names))
        return self._run("actuator_jacobian", (q,), failures, retry, shape)

    def foot_position(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot position, (..., 3) m."""

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.foot_position(pick(q), inner)

        return self._run("foot_position", (q,), failures, retry, (3,))

    def inverse_kinematics(self, p: np.ndarray, branch: str, failures: RowFailures) -> np.ndarray:
        """Joint coordinates of one branch, (..., n), by the fallback.

        Raises
        ------
        UnsupportedError
            There is no fallback.
        """
        if self.fallback is None:
            raise UnsupportedError("this route has no inverse kinematics of its own: use route='pinocchio'")
        return self.fallback.inverse_kinematics(p, branch, failures)

    def foot_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot Jacobian, (..., 3, n)."""

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.foot_jacobian(pick(q), inner)

        return self._run("foot_jacobian", (q,), failures, retry, (3, len(self.joint_names)))

    def foot_jacobian_derivative(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Time derivative of the foot Jacobian, (..., 3, n)."""

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.foot_jacobian_derivative(pick(q), pick(v), inner)

        return self._run("foot_jacobian_derivative", (q, v), failures, retry, (3, len(self.joint_names)))

    def foot_bias_acceleration(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot acceleration at zero joint acceleration, (..., 3) m/s²."""

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.foot_bias_acceleration(pick(q), pick(v), inner)

        return self._run("foot_bias_acceleration", (q, v), failures, retry, (3,))

    def mass_matrix(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Mass matrix, (..., n, n)."""

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.mass_matrix(pick(q), inner)

        n = len(self.joint_names)
        return self._run("mass_matrix", (q,), failures, retry, (n, n))

    def bias(self, q: np.ndarray, v: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Generalised force at zero acceleration, (..., n)."""

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.bias(pick(q), pick(v), pick(gravity), inner)

        return self._run("bias", (q, v, self._gravity(gravity)), failures, retry, (len(self.joint_names),))

    def potential_energy(self, q: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Potential energy of gravity, (...,) J."""

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.potential_energy(pick(q), pick(gravity), inner)

        return self._run("potential_energy", (q, self._gravity(gravity)), failures, retry, ())

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

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.generalized_force(pick(q), pick(v), pick(a), pick(foot_force), pick(gravity), inner)

        arguments = (q, v, a, *self._force(foot_force), self._gravity(gravity))
        return self._run("generalized_force", arguments, failures, retry, (len(self.joint_names),))

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

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.torque(pick(q), pick(v), pick(a), pick(foot_force), pick(gravity), inner)

        if foot_force is None and gravity is None:
            return self._run(FREE_TORQUE, (q, v, a), failures, retry, (len(self.actuator_joints),))
        arguments = (q, v, a, *self._force(foot_force), self._gravity(gravity))
        return self._run("torque", arguments, failures, retry, (len(self.actuator_joints),))

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

        def retry(route: Route, pick: Any, inner: RowFailures) -> np.ndarray:
            return route.acceleration(pick(q), pick(v), pick(tau), pick(foot_force), pick(gravity), inner)

        arguments = (q, v, *self._tau(tau), *self._force(foot_force), self._gravity(gravity))
        return self._run("acceleration", arguments, failures, retry, (len(self.joint_names),))

    # ------------------------------------------------------------------ derivatives

    def numbers_of(self, description: Description) -> dict[str, float]:
        """Names and values of the numbers that the graphs take from a description, see `numbers.parameter_names`."""
        return number_values(description)

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
        arguments = (q, v, a, *self._force(foot_force), self._gravity(gravity))
        width = 3 * len(self.joint_names)
        return self._differentiated("torque", arguments, numbers, (len(self.actuator_joints), width), failures)

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
        arguments = (q, v, *self._tau(tau), *self._force(foot_force), self._gravity(gravity))
        n = len(self.joint_names)
        shape = (n, 2 * n + len(self.actuator_joints))
        return self._differentiated("acceleration", arguments, numbers, shape, failures)

    def _differentiated(
        self,
        method: str,
        arguments: tuple[np.ndarray, ...],
        numbers: tuple[str, ...],
        shape: tuple[int, int],
        failures: RowFailures,
    ) -> np.ndarray:
        """Derivatives by the arguments, then by numbers; failing rows have no fallback.

        Raises
        ------
        ParameterError
            There is no such number, or it cannot be varied alone.
        """
        q = arguments[0]
        blocks = [self._rows(f"{method}_derivatives", arguments, (), shape, failures)]
        Numbers.of(self._description).check(numbers)
        # Numbers that leave the geometry alone keep the loops' short solution.
        inertial = tuple(name for name in numbers if is_inertial(self._description, name))
        geometric = tuple(name for name in numbers if name not in inertial)
        columns: dict[str, np.ndarray] = {}
        for group in (inertial, geometric):
            if group:
                size = (shape[0], len(group))
                block = self._rows(f"{method}_parameter_derivatives", arguments, group, size, failures)
                columns |= {name: block[..., k] for k, name in enumerate(group)}
        blocks += [columns[name][..., None] for name in numbers]
        result = np.concatenate(blocks, axis=-1)
        if failures:
            result.reshape(-1, *result.shape[-2:])[failures.rows if q.ndim > 1 else [0]] = np.nan
        return result

    def _rows(
        self,
        method: str,
        arguments: tuple[np.ndarray, ...],
        parameters: tuple[str, ...],
        shape: tuple[int, int],
        failures: RowFailures,
    ) -> np.ndarray:
        """Evaluate a method that has no fallback; rows whose loops do not close, or that are singular, fail."""
        q = arguments[0]
        count = 1 if q.ndim == 1 else len(q)
        try:
            result = self._call(method, arguments, parameters)
        except RowError as error:
            failures.add(np.arange(count), error)
            return np.full((*q.shape[:-1], *shape), np.nan)
        bad = np.isnan(result.reshape(count, *shape)[:, 0, 0])
        known = failures.rows.tolist() if bad.any() and failures else []
        for row in np.flatnonzero(bad).tolist():
            if row not in known:
                self._name_failure(method, q if q.ndim == 1 else q[row], row, failures)
        return result
