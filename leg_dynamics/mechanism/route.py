"""The pinocchio route: the interface's array methods over `Mechanism`, row by row with a warm start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from leg_dynamics.description.model import Description
from leg_dynamics.errors import AssemblyError, OutOfReachError, RowError, RowFailures, SingularityError
from leg_dynamics.mechanism.assembly import SAME_POSE, close_configuration, configuration_coordinates, pose_difference
from leg_dynamics.mechanism.mechanism import DOUBTFUL_INVERSE, ClosedState, LoopForces, Mechanism
from leg_dynamics.mechanism.mobility import MobilityReport, mobility_report
from leg_dynamics.mechanism.redundant import RANK_SHARE, PoseSearch, RankReport, rank_report

__all__ = ["PinocchioRoute"]

Row = Callable[..., np.ndarray]

# Shares of the mechanism's length.
REACH_TOLERANCE = 4e-12
REACH_ACCEPTED = 4e-9
REACH_ITERATIONS = 100
LARGEST_JOINT_STEP = 0.2
# Other starting poses where the descent from the configuration gets stuck.
RESTARTS = 6
# Steps in a row that may fail before a descent counts as stuck.
REJECTIONS = 12


class PinocchioRoute:
    """Numeric kinematics and dynamics of any description through pinocchio."""

    name = "pinocchio"

    def __init__(self, description: Description, foot: str | None, hip: str | None) -> None:
        self.mechanism = Mechanism(description, foot, hip)
        self.joint_names = self.mechanism.joint_names
        self.actuator_joints = self.mechanism.actuator_joints
        self.tree_joint_names = self.mechanism.tree.joint_names
        self.gravity = self.mechanism.gravity
        self.has_foot = foot is not None
        names = [configuration.name for configuration in description.configurations]
        self.branches: tuple[str, ...] = tuple(names) if names else ("home",)

    def _rows(
        self, function: Row, shape: tuple[int, ...], q: np.ndarray, others: tuple[Any, ...], failures: RowFailures
    ) -> np.ndarray:
        """Apply a method of `Mechanism` to the closed state of every row; failing rows stay NaN.

        Rows that overflow have results that are not finite. Rows fail where rounding hides the promised digits.
        """
        # An overflow shows in the result; the warning would not say which row.
        with np.errstate(over="ignore", invalid="ignore"):
            if q.ndim == 1:
                try:
                    return self._value(function, q, others)
                except RowError as error:
                    failures.add(0, error)
                    return np.full(shape, np.nan)
            result = np.full((len(q), *shape), np.nan)
            for row in range(len(q)):
                try:
                    result[row] = self._value(function, q[row], [None if o is None else o[row] for o in others])
                except RowError as error:
                    failures.add(row, error)
            return result

    def _value(self, function: Row, y: np.ndarray, others: Sequence[Any]) -> np.ndarray:
        mechanism = self.mechanism
        state = mechanism.close(y)
        value = function(state, *others)
        if state.inverse_norm > DOUBTFUL_INVERSE:
            mechanism.check_rounding(state, value, lambda moved: function(moved, *others))
        return value

    def tree_coordinates(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Closed tree coordinates, (..., nv)."""
        return self._rows(lambda state: self.mechanism.unwound(state.q), (self.mechanism.nv,), q, (), failures)

    def foot_position(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot position, (..., 3) m."""
        return self._rows(self.mechanism.foot_position, (3,), q, (), failures)

    def foot_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot Jacobian, (..., 3, n)."""
        return self._rows(self.mechanism.foot_jacobian, (3, self.mechanism.n), q, (), failures)

    def foot_jacobian_derivative(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Time derivative of the foot Jacobian, (..., 3, n)."""
        return self._rows(self.mechanism.foot_jacobian_derivative, (3, self.mechanism.n), q, (v,), failures)

    def foot_bias_acceleration(self, q: np.ndarray, v: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot acceleration at zero joint acceleration, (..., 3) m/s²."""
        return self._rows(self.mechanism.foot_bias_acceleration, (3,), q, (v,), failures)

    def mass_matrix(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Mass matrix, (..., n, n)."""
        return self._rows(self.mechanism.mass_matrix, (self.mechanism.n, self.mechanism.n), q, (), failures)

    def bias(self, q: np.ndarray, v: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Generalised force at zero acceleration, (..., n)."""
        return self._rows(self.mechanism.bias, (self.mechanism.n,), q, (v, gravity), failures)

    def potential_energy(self, q: np.ndarray, gravity: np.ndarray | None, failures: RowFailures) -> np.ndarray:
        """Potential energy of gravity, (...,) J."""
        return self._rows(self.mechanism.potential_energy, (), q, (gravity,), failures)

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
        method = self.mechanism.generalized_force
        return self._rows(method, (self.mechanism.n,), q, (v, a, foot_force, gravity), failures)

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
        mechanism = self.mechanism

        def effort(state: ClosedState, *arguments: Any) -> np.ndarray:
            return mechanism.actuator_effort(state, mechanism.generalized_force(state, *arguments))

        return self._rows(effort, (len(mechanism.actuated),), q, (v, a, foot_force, gravity), failures)

    def acceleration(
        self,
        q: np.ndarray,
        v: np.ndarray,
        tau: np.ndarray,
        foot_force: np.ndarray | None,
        gravity: np.ndarray | None,
        failures: RowFailures,
    ) -> np.ndarray:
        """Forward dynamics by projection, (..., n)."""
        method = self.mechanism.acceleration
        return self._rows(method, (self.mechanism.n,), q, (v, tau, foot_force, gravity), failures)

    def loop_forces(
        self,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        foot_force: np.ndarray | None = None,
        gravity: np.ndarray | None = None,
    ) -> LoopForces:
        """Minimum-norm forces in the cut loop joints of one sample."""
        mechanism = self.mechanism

        def wrenches(state: ClosedState) -> np.ndarray:
            forces = mechanism.loop_forces(state, v, a, foot_force, gravity)
            return np.array([*np.ravel(list(forces.wrenches.values())), *forces.couplings.values()])

        with np.errstate(over="ignore", invalid="ignore"):
            state = mechanism.close(q)
            if mechanism.doubtful(state):
                mechanism.check_rounding(state, wrenches(state), wrenches)
            return mechanism.loop_forces(state, v, a, foot_force, gravity)

    def mobility_report(self, samples: int = 20, seed: int = 0) -> MobilityReport:
        """Gruebler count against the rank of the loop rows."""
        return mobility_report(self.mechanism, samples, seed)

    def foot_rotation(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Foot orientation R_HF, (..., 3, 3)."""
        return self._rows(lambda state: self.mechanism.foot_motion(state)[1], (3, 3), q, (), failures)

    def geometric_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Velocity and angular velocity of the foot per independent velocity, (..., 6, n)."""
        return self._rows(lambda state: self.mechanism.foot_motion(state)[2], (6, self.mechanism.n), q, (), failures)

    def rank_report(
        self, q: np.ndarray, characteristic_length: float | None = None, tolerance: float = RANK_SHARE
    ) -> RankReport:
        """Rank of the geometric Jacobian of one sample."""
        with np.errstate(over="ignore", invalid="ignore"):
            J = self._value(lambda state: self.mechanism.foot_motion(state)[2], q, ())
        return rank_report(self.mechanism, q, J, characteristic_length, tolerance)

    def pose_inverse_kinematics(self, oriented: bool, limits: str, starts: int) -> PoseSearch:
        """Inverse kinematics of the foot's position, or of its pose."""
        return PoseSearch(self.mechanism, oriented, limits, starts)

    def smallest_singular_values(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Smallest singular value of the closure, dimensionless, (...,); infinite where no joint is dependent."""
        mechanism = self.mechanism

        def smallest(state: ClosedState) -> np.ndarray:
            return np.asarray(mechanism.singular_values(state).min(initial=np.inf))

        with np.errstate(invalid="ignore"):
            result = np.full(q.shape[:-1], np.nan)
            for row in np.ndindex(q.shape[:-1]):
                try:
                    result[row] = smallest(mechanism.close(q[row]))
                except RowError as error:
                    failures.add(int(np.ravel_multi_index(row, q.shape[:-1])) if row else 0, error)
        return result

    def rounding_errors(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Largest `Mechanism.rounding_error` of what this route computes at some states, (N,).

        Parameters
        ----------
        q, v, a : (N, n) array

        Returns
        -------
        (N,) array
            0 away from singular poses of the closure; NaN where the loops do not close.
        """
        return np.array([self._rounding_error(*row) for row in zip(q, v, a, strict=True)])

    def _rounding_error(self, y: np.ndarray, v: np.ndarray, a: np.ndarray) -> float:
        mechanism = self.mechanism
        try:
            state = mechanism.close(y)
        except RowError:
            return np.nan
        if not mechanism.doubtful(state):
            return 0.0
        idle = np.zeros(len(mechanism.actuated))
        functions: list[Callable[[ClosedState], np.ndarray]] = [
            lambda state: state.q,
            mechanism.mass_matrix,
            lambda state: mechanism.generalized_force(state, v, a),
            lambda state: mechanism.acceleration(state, v, idle),
        ]
        if self.has_foot:
            functions += [
                mechanism.foot_jacobian,
                lambda state: mechanism.foot_bias_acceleration(state, v),
                lambda state: mechanism.foot_jacobian_derivative(state, v),
            ]
        worst = 0.0
        for function in functions:
            try:
                error = mechanism.rounding_error(state, function(state), function)
            except RowError:
                # What does not exist there is no matter of rounding.
                continue
            worst = max(worst, error if error == error else np.inf)  # noqa: PLR0124
        return worst

    # ------------------------------------------------------------------ inverse kinematics

    def inverse_kinematics(self, p: np.ndarray, branch: str, failures: RowFailures) -> np.ndarray:
        """Joint coordinates of the solution that continues from the configuration `branch`, (..., n)."""
        if p.ndim == 1:
            try:
                return self._reach(p, branch)
            except RowError as error:
                failures.add(0, error)
                return np.full(self.mechanism.n, np.nan)
        result = np.full((len(p), self.mechanism.n), np.nan)
        for row in range(len(p)):
            try:
                result[row] = self._reach(p[row], branch)
            except RowError as error:
                failures.add(row, error)
        return result

    def _start(self, branch: str) -> ClosedState:
        """The closed pose of a configuration, provided that it lies in the assembly mode."""
        mechanism = self.mechanism
        for configuration in mechanism.description.configurations:
            if configuration.name != branch:
                continue
            q = configuration_coordinates(mechanism, dict(configuration.values))
            state = mechanism.close(q[mechanism.independent])
            meant = close_configuration(mechanism, configuration)
            if meant is not None and pose_difference(mechanism, state, meant) > SAME_POSE:
                raise AssemblyError(
                    f"configuration {branch!r} lies in another assembly mode than the file's first: make it the file's "
                    "home to use that mode",
                    residual=meant.residual,
                )
            return state
        return mechanism.seeds[0]

    def _reach(self, p: np.ndarray, branch: str) -> np.ndarray:
        """Descend from the configuration; where that gets stuck, from other poses inside the joint limits.

        A descent started elsewhere counts only where it ends inside the joint limits: outside, it may have left
        the branch.
        """
        mechanism = self.mechanism
        accepted = REACH_ACCEPTED * mechanism.closure.length
        start = self._start(branch)
        best, nearest = self._descend(p, start)
        if best <= accepted:
            return nearest
        from scipy.stats.qmc import Halton

        lower, upper = (bound[mechanism.independent] for bound in mechanism.search_box())
        for share in Halton(mechanism.n, scramble=False).random(RESTARTS):
            try:
                distance, y = self._descend(p, mechanism.close(lower + share * (upper - lower)))
            except (AssemblyError, SingularityError):
                continue
            if distance <= accepted and (y >= lower - accepted).all() and (y <= upper + accepted).all():
                return y
            if distance < best:
                best, nearest = distance, y
        raise OutOfReachError(
            f"no joint coordinates in branch {branch!r} put the foot at {p.tolist()} m: the nearest point found is "
            f"{best:.3g} m away; check the workspace or start from another configuration",
            margin=-best,
            nearest=nearest,
        )

    def _descend(self, p: np.ndarray, state: ClosedState) -> tuple[float, np.ndarray]:
        """Gauss-Newton with damping and step control on the foot position, staying in the assembly mode.

        Returns the distance that is left, m, and the independent coordinates there.
        """
        mechanism = self.mechanism
        length = mechanism.closure.length
        y = state.y.copy()
        J = mechanism.foot_jacobian(state)
        if np.linalg.matrix_rank(J, tol=1e-6 * max(1.0, float(np.abs(J).max()))) < min(J.shape):
            y = self._leave_singular(y)
            state = mechanism.close(y)
        error = p - mechanism.foot_position(state)
        damping, rejected = 1e-6, 0
        for _ in range(REACH_ITERATIONS):
            J = mechanism.foot_jacobian(state)
            distance = float(np.linalg.norm(error))
            if distance < REACH_TOLERANCE * length or rejected == REJECTIONS:
                break
            normal = J @ J.T + damping * float(np.trace(J @ J.T)) * np.eye(3)
            step = J.T @ np.linalg.solve(normal, error)
            largest = float(np.abs(step).max())
            if largest < 1e-14:
                break
            if largest > LARGEST_JOINT_STEP:
                step *= LARGEST_JOINT_STEP / largest
            try:
                candidate = mechanism.close(y + step)
            except (AssemblyError, SingularityError):
                damping, rejected = min(10.0 * damping, 1e3), rejected + 1
                continue
            new_error = p - mechanism.foot_position(candidate)
            if float(np.linalg.norm(new_error)) < distance:
                y, state, error, damping, rejected = y + step, candidate, new_error, max(0.1 * damping, 1e-15), 0
            elif distance < 0.1 * REACH_ACCEPTED * length and largest < 1e-8:
                break
            else:
                damping, rejected = min(10.0 * damping, 1e6), rejected + 1
        return float(np.linalg.norm(error)), y

    def _leave_singular(self, y: np.ndarray) -> np.ndarray:
        """A regular starting point near a singular configuration: towards the middle of the joint limits."""
        mechanism = self.mechanism
        lower = np.maximum(mechanism.lower[mechanism.independent], -1.0)
        upper = np.minimum(mechanism.upper[mechanism.independent], 1.0)
        return y + 0.3 * (0.5 * (lower + upper) - y) + 0.01
