"""The pinocchio route: the interface's array methods over `Mechanism`, row by row with a warm start."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from leg_dynamics.description.model import Description
from leg_dynamics.errors import AssemblyError, BranchError, OutOfReachError, RowError, RowFailures, SingularityError
from leg_dynamics.mechanism.assembly import SAME_POSE, close_configuration, configuration_coordinates, pose_difference
from leg_dynamics.mechanism.between import SampledMotion, lead
from leg_dynamics.mechanism.mechanism import DOUBTFUL_INVERSE, ClosedState, LoopForces, Mechanism
from leg_dynamics.mechanism.mobility import MobilityReport, mobility_report
from leg_dynamics.mechanism.modes import AssemblyMode, find_modes
from leg_dynamics.mechanism.reach import from_hip, is_beyond, longest_reach, reach_text
from leg_dynamics.mechanism.redundant import RANK_SHARE, PoseSearch, RankReport, rank_report
from leg_dynamics.mechanism.touching import check_touching

__all__ = ["PinocchioRoute"]

Row = Callable[..., np.ndarray]

# Shares of the mechanism's length.
REACH_TOLERANCE = 4e-12
REACH_ACCEPTED = 4e-9
REACH_ITERATIONS = 100
LARGEST_JOINT_STEP = 0.2
# Other starting poses where the descent from the configuration gets stuck.
RESTARTS = 6
# Neighbours of home at which the foot Jacobian's usual rank is looked for.
RANK_POSES = 6
THOROUGH_RESTARTS = 24
# Steps in a row that may fail before a descent counts as stuck.
REJECTIONS = 12
# Ways from a branch's configuration on which other starting poses are looked for, inside the joint limits and anywhere.
WAYS = 64


class _Ways(NamedTuple):
    """Poses on numbered ways through a branch: coordinates (k, n), feet (k, 3), and which are inside the limits."""

    number: np.ndarray
    y: np.ndarray
    feet: np.ndarray
    inside: np.ndarray


class PinocchioRoute:
    """Numeric kinematics and dynamics of any description through pinocchio."""

    name = "pinocchio"

    def __init__(self, description: Description, foot: str | None, hip: str | None, *, remembers: bool = True) -> None:
        self.mechanism = Mechanism(description, foot, hip, remembers=remembers)
        self.joint_names = self.mechanism.joint_names
        self.actuator_joints = self.mechanism.actuator_joints
        self.tree_joint_names = self.mechanism.tree.joint_names
        self.gravity = self.mechanism.gravity
        self.has_foot = foot is not None
        names = [configuration.name for configuration in description.configurations]
        self.branches: tuple[str, ...] = tuple(names) if names else ("home",)
        self._known_ways: dict[tuple[str, bool], _Ways] = {}

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

    @property
    def loop_gap(self) -> float:
        """What rounding leaves of the loops' residual, rad or m."""
        return self.mechanism.gap * max(1.0, self.mechanism.closure.length)

    def home_coordinates(self) -> np.ndarray:
        """Independent coordinates of the pose that defines the assembly mode, (n,); zeros of an open chain."""
        mechanism = self.mechanism
        return mechanism.seeds[0].y.copy()

    def follow(self, q: np.ndarray, motion: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None) -> np.ndarray:
        """Tree coordinates (N, nv) along a path of independent ones (N, n), each continued from the row before.

        Parameters
        ----------
        q : (N, n) array
        motion : tuple of time (N,), s, v and a (N, n), optional
            Where the straight way from a row to the next leaves the reach, the one that they tell is taken; and no
            singular pose may be touched between, see `leg_dynamics.mechanism.touching`.

        Raises
        ------
        AssemblyError, SingularityError
            The mode ends or is singular on the way, or the actuators lose a motion that they hold elsewhere; `rows`
            names the first row that is not reached. The second with `time` where a singular pose is touched between.
        """
        mechanism = self.mechanism
        mechanism.forget()
        sampled = None
        if motion is not None:
            time, v, a = motion
            sampled = SampledMotion(time, q, v, a, mechanism.closure.coordinate_unit[mechanism.independent])
        states: list[ClosedState] = []
        for row, y in enumerate(q):
            try:
                if not states or mechanism.is_open:
                    states.append(mechanism.close(y))
                else:
                    states.append(self._next(states[-1], y, row, sampled))
                    self._check_held(*states[-2:])
            except RowError as error:
                if sampled is not None:
                    # What was followed so far may have lost the mode already.
                    check_touching(mechanism, states[:row], sampled)
                failures = RowFailures()
                failures.add(row, error)
                raise failures.combined(len(q)) from None
        if sampled is not None:
            check_touching(mechanism, states, sampled)
        return np.array([state.q for state in states]).reshape(len(q), mechanism.nv)

    def _next(self, state: ClosedState, y: np.ndarray, row: int, motion: SampledMotion | None) -> ClosedState:
        """The pose at y (n,), straight from the one before, or the way that the motion tells."""
        try:
            return self.mechanism.follow(state, y)
        except (AssemblyError, SingularityError):
            way = motion.way(row) if motion is not None else None
            if way is None:
                raise
            try:
                return self.mechanism.follow(lead(self.mechanism, way, state, 0.0, 1.0), y)
            except (AssemblyError, SingularityError):
                pass
            raise

    def _check_held(self, before: ClosedState, after: ClosedState) -> None:
        """As `Mechanism.check_held`; the error carries `tree_coordinates` too."""
        mechanism = self.mechanism
        try:
            mechanism.check_held(before, after)
        except SingularityError as error:
            pose = np.array([error.evidence["pose"][name] for name in self.joint_names])
            reached = mechanism.follow(before, pose).q
            raise SingularityError(error.message, **{**error.evidence, "tree_coordinates": reached}) from None

    def led(self, found: np.ndarray) -> AbstractContextManager[None]:
        """While inside, the poses at the coordinates of those that `follow` found are those, whatever leads there."""
        return self.mechanism.led(found)

    def nearest_singular(self, found: np.ndarray) -> tuple[int, float, str, dict[str, float]]:
        """Of closed tree coordinates (N, nv) the ones nearest to a singular pose: row, singular value, kind, direction.

        The singular value is the smallest of the dependent columns of the loop rows, dimensionless.
        """
        mechanism = self.mechanism
        states = [mechanism.state_of(q) for q in found]
        values = [float(mechanism.singular_values(state)[-1]) for state in states]
        row = int(np.argmin(values))
        singular = mechanism.singular(states[row])
        return row, values[row], singular.kind, singular.direction

    def apart(self, q: np.ndarray) -> np.ndarray:
        """Tree coordinates (N, nv) of independent ones (N, n), each reached from a seed; rows that fail are NaN."""
        mechanism = self.mechanism
        found = np.full((len(q), mechanism.nv), np.nan)
        with mechanism.led(found[:0]):
            for row, y in enumerate(q):
                mechanism.forget()
                try:
                    found[row] = mechanism.close(y).q
                except RowError:
                    continue
        return found

    def singular_pose(self, q: np.ndarray) -> np.ndarray:
        """Tree coordinates (nv,) that close the loops at a pose (n,), also where the closure is singular."""
        return self.mechanism.at_any_cost(q).q

    def assembly_modes(self, q: np.ndarray | None, attempts: int, seed: int) -> tuple[AssemblyMode, ...]:
        """Closed poses at the same independent coordinates."""
        return find_modes(self.mechanism, q, attempts, seed)

    def actuator_jacobian(self, q: np.ndarray, failures: RowFailures) -> np.ndarray:
        """Rates of the actuated joints per independent velocity, (..., m, n)."""
        mechanism = self.mechanism
        shape = (len(mechanism.actuated), mechanism.n)
        return self._rows(lambda state: state.G[mechanism.actuated], shape, q, (), failures)

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
        targets = np.atleast_2d(p)
        result = np.full((len(targets), self.mechanism.n), np.nan)
        far = is_beyond(targets, self._longest_reach)
        if far.any():
            rows = np.flatnonzero(far)
            failures.add(rows, self._too_far(targets[rows], branch))
        for row in np.flatnonzero(~far):
            try:
                result[row] = self._reach(targets[row], branch)
            except RowError as error:
                failures.add(row, error)
        return result.reshape(*p.shape[:-1], self.mechanism.n)

    @cached_property
    def _longest_reach(self) -> float:
        return longest_reach(self.mechanism)

    def _too_far(self, p: np.ndarray, branch: str) -> OutOfReachError:
        """The error for points (k, 3) that the links are too short for."""
        missing = from_hip(p) - self._longest_reach
        try:
            missing[0], state = self._descend(p[0], self._regular(self._start(branch)))
            nearest, found = state.y, f", the nearest point found is {missing[0]:.3g} m away"
        except (AssemblyError, SingularityError):
            nearest, found = np.zeros(0), ""
        return OutOfReachError(
            f"no joint coordinates in branch {branch!r} put the foot at {p[0].tolist()} m{found}: "
            f"{reach_text(p[0], self._longest_reach)}; check the workspace",
            rows=np.arange(len(p)),
            margin=-missing,
            nearest=nearest,
        )

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
        """Descend from the configuration; where that gets stuck, from other poses of the branch.

        A branch is what continues from its configuration without a singular foot Jacobian on the way: every descent,
        and the way to every start, stays on that side. Where the configuration itself is singular, the branch is that
        of the pose beside it, towards the middle of the joint limits. Jacobians whose rank is always below the number
        of joints, and more than three joints, have no sides: all poses of the assembly mode are one branch.

        Most branches reach a point once. Where one does it several times, a solution inside the joint limits is
        preferred, then the configuration's.

        Raises
        ------
        BranchError
            Only another branch reaches the point.
        OutOfReachError
            Nothing was found that reaches it.
        """
        distance, y = self._search(p, branch, RESTARTS)
        if self._accepts(distance):
            return y
        elsewhere, holding = self._elsewhere(p, branch)
        if elsewhere is not None:
            # Before the branch is said to end, it gets a longer search: beside folds, most descents get stuck.
            distance, y = self._search(p, branch, THOROUGH_RESTARTS)
            if self._accepts(distance):
                return y
            raise self._other_branch(p, branch, distance, y, elsewhere, holding)
        raise OutOfReachError(
            f"no joint coordinates in branch {branch!r} put the foot at {p.tolist()} m: the nearest point found is "
            f"{distance:.3g} m away; check the workspace or start from another configuration",
            margin=-distance,
            nearest=y,
        )

    def _accepts(self, distance: float) -> bool:
        return distance <= REACH_ACCEPTED * self.mechanism.closure.length

    def _search(self, p: np.ndarray, branch: str, restarts: int, any_side: bool = False) -> tuple[float, np.ndarray]:
        """Distance to p that the best of several descents leaves, m, and the independent coordinates there."""
        best, nearest, outside = np.inf, np.zeros(0), None
        for start in self._starts(branch, p, restarts, any_side):
            try:
                distance, state = self._descend(p, self.mechanism.close(start), any_side)
            except (AssemblyError, SingularityError):
                continue
            if not self._accepts(distance):
                if outside is None and distance < best:
                    best, nearest = distance, state.y
                continue
            y = self._without_turns(state)
            if self._inside_limits(y):
                return distance, y
            if outside is None:
                best, nearest, outside = distance, y, y
            elif self.mechanism.distance(y - outside) < SAME_POSE:
                # Descents from two sides that end at the same place leave little hope for another one.
                break
        return best, nearest

    def _elsewhere(self, p: np.ndarray, branch: str) -> tuple[np.ndarray | None, tuple[str, ...]]:
        """Independent coordinates that put the foot at p in another branch, and the names of those that hold it."""
        found = {}
        for other in self.branches:
            if other != branch:
                try:
                    distance, y = self._search(p, other, RESTARTS)
                except (AssemblyError, SingularityError):
                    continue  # a configuration in another assembly mode
                if self._accepts(distance):
                    found[other] = y
        if found:
            return next(iter(found.values())), tuple(found)
        distance, y = self._search(p, branch, RESTARTS, any_side=True)
        return (y if self._accepts(distance) else None), ()

    def _other_branch(
        self, p: np.ndarray, branch: str, missing: float, nearest: np.ndarray, y: np.ndarray, holding: tuple[str, ...]
    ) -> BranchError:
        """The error for a point that `branch` misses, and that the coordinates y (n,) of another branch reach."""
        outside = "" if self._inside_limits(y) else ", outside the joint limits,"
        advice = (
            f"choose branch {' or '.join(map(repr, holding))}"
            if holding
            else "add a <configuration> on that side to the file and choose it as the branch"
        )
        return BranchError(
            f"branch {branch!r} was not found to reach {p.tolist()} m, its nearest point is {missing:.3g} m away; "
            f"another branch does{outside} at {self.mechanism.pose_text(y)}, beyond a singular pose of the foot "
            f"Jacobian: {advice}, or choose another foot position",
            margin=-missing,
            nearest=nearest,
            branch=branch,
            holding=holding,
            solution=y,
        )

    def _inside_limits(self, y: np.ndarray) -> bool:
        mechanism, slack = self.mechanism, REACH_ACCEPTED * self.mechanism.closure.length
        independent = mechanism.independent
        return bool(
            (y >= mechanism.lower[independent] - slack).all() and (y <= mechanism.upper[independent] + slack).all()
        )

    def _without_turns(self, state: ClosedState) -> np.ndarray:
        """Independent coordinates of the same pose with as few whole turns as the joint limits allow.

        Angles in couplings stay: there a turn counts. Others go to [-pi, pi], or where that is outside the limits and
        other turns are inside, to the one of them that is nearest.
        """
        mechanism = self.mechanism
        y, full = state.y.copy(), 2.0 * np.pi
        bounds = (bound[mechanism.independent] for bound in (mechanism.lower, mechanism.upper))
        for place, (name, lower, upper) in enumerate(zip(self.joint_names, *bounds, strict=True)):
            if mechanism.description.joint(name).unit == "rad":
                if mechanism.closure.coupling_matrix[:, mechanism.independent[place]].any():
                    continue
                angle = y[place] - full * np.round(y[place] / full)
                few, many = np.ceil((lower - angle) / full - 1e-9), np.floor((upper - angle) / full + 1e-9)
                y[place] = angle + full * min(max(0.0, few), many) if few <= many else angle
        if (y == state.y).all():
            return state.y
        try:
            if pose_difference(mechanism, mechanism.close(y), state) < SAME_POSE:
                return y
        except (AssemblyError, SingularityError):
            pass
        return state.y

    def _starts(self, branch: str, p: np.ndarray, restarts: int, any_side: bool) -> Iterator[np.ndarray]:
        """Coordinates in a branch, or in any, to descend from: its configuration, and then poses with the foot near p.

        Half of them are inside the joint limits.
        """
        yield self._regular(self._start(branch)).y
        ways = self._ways(branch, any_side)
        order = np.argsort(np.linalg.norm(ways.feet - p, axis=1))
        for inside in (True, False):
            used: set[int] = set()
            for pose in order:
                way = int(ways.number[pose])
                # One pose of each way: neighbours would end at the same place.
                if ways.inside[pose] == inside and way not in used:
                    used.add(way)
                    yield ways.y[pose]
                    if len(used) == restarts // 2:
                        break

    def _ways(self, branch: str, any_side: bool) -> _Ways:
        """Poses of a branch on straight ways from its configuration, each as far as the branch goes.

        They lead all over the joint limits, and as many all over a turn of every angle.
        """
        key = (branch, any_side)
        if key in self._known_ways:
            return self._known_ways[key]
        from scipy.stats.qmc import Halton

        mechanism = self.mechanism
        home = self._regular(self._start(branch))
        home_J = mechanism.foot_jacobian(home)
        sided = not any_side and self._has_sides(home_J)
        lower, upper = (bound[mechanism.independent] for bound in mechanism.search_box())
        shares = Halton(mechanism.n, scramble=False).random(WAYS)
        ends = [*(lower + shares * (upper - lower))]
        is_angle = np.array([mechanism.description.joint(name).unit == "rad" for name in self.joint_names])
        lower, upper = np.where(is_angle, -np.pi, lower), np.where(is_angle, np.pi, upper)
        ends += [*(lower + shares * (upper - lower))]
        found: list[tuple[int, np.ndarray, np.ndarray]] = []
        for number, end in enumerate(ends):
            count = int(np.ceil(mechanism.distance(end - home.y) / LARGEST_JOINT_STEP)) or 1
            J, state = home_J, home
            for step in range(1, count + 1):
                reached = mechanism.neighbour(state, home.y + step / count * (end - home.y))
                if reached is None:
                    break
                state = reached
                before, J = J, mechanism.foot_jacobian(state)
                if sided and _crosses_singularity(before, J):
                    break
                if not self._is_singular(J):
                    found.append((number, state.y, mechanism.foot_position(state)))
        self._known_ways[key] = ways = _Ways(
            np.array([number for number, _, _ in found], dtype=np.intp),
            np.array([y for _, y, _ in found]).reshape(-1, mechanism.n),
            np.array([foot for _, _, foot in found]).reshape(-1, 3),
            np.array([self._inside_limits(y) for _, y, _ in found], dtype=bool),
        )
        return ways

    def _has_sides(self, J: np.ndarray) -> bool:
        """Whether singular poses part a leg with such a foot Jacobian, (3, n), into branches."""
        return J.shape[1] <= self._usual_rank and not self._is_singular(J)

    @cached_property
    def _usual_rank(self) -> int:
        """Rank of the foot Jacobian at most poses: 2 of a leg that moves in a plane, whatever its coordinates."""
        mechanism = self.mechanism
        home = mechanism.seeds[0]
        generator = np.random.default_rng(0)
        unit = mechanism.closure.coordinate_unit[mechanism.independent]
        ranks = [_rank(mechanism.foot_jacobian(home))]
        for _ in range(RANK_POSES):
            beside = mechanism.neighbour(home, home.y + 0.1 * unit * generator.uniform(-1.0, 1.0, mechanism.n))
            if beside is not None:
                ranks.append(_rank(mechanism.foot_jacobian(beside)))
        return max(ranks)

    def _is_singular(self, J: np.ndarray) -> bool:
        return _rank(J) < self._usual_rank

    def _regular(self, state: ClosedState) -> ClosedState:
        """The pose, or where its foot Jacobian is singular, one beside it."""
        if not self._is_singular(self.mechanism.foot_jacobian(state)):
            return state
        return self.mechanism.close(self._leave_singular(state.y))

    def _descend(self, p: np.ndarray, state: ClosedState, any_side: bool = False) -> tuple[float, ClosedState]:
        """Gauss-Newton with damping and step control on the foot position, staying in the assembly mode.

        Parameters
        ----------
        p : (3,) array
            m.
        state : ClosedState
            Where to start, not singular where the leg has regular poses.
        any_side : bool
            Whether the way may lead through singular poses of the foot Jacobian, to other branches.

        Returns
        -------
        float
            The distance that is left, m.
        ClosedState
            The pose there.
        """
        mechanism = self.mechanism
        length = mechanism.closure.length
        error = p - mechanism.foot_position(state)
        J = mechanism.foot_jacobian(state)
        sided = not any_side and self._has_sides(J)
        damping, rejected = 1e-6, 0
        for _ in range(REACH_ITERATIONS):
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
            candidate = mechanism.neighbour(state, state.y + step)
            if candidate is None:
                damping, rejected = min(10.0 * damping, 1e3), rejected + 1
                continue
            new_error = p - mechanism.foot_position(candidate)
            if float(np.linalg.norm(new_error)) < distance:
                new_J = mechanism.foot_jacobian(candidate)
                if sided and _crosses_singularity(J, new_J):
                    damping, rejected = min(10.0 * damping, 1e6), rejected + 1
                    continue
                state, J, error, damping, rejected = candidate, new_J, new_error, max(0.1 * damping, 1e-15), 0
            elif distance < 0.1 * REACH_ACCEPTED * length and largest < 1e-8:
                break
            else:
                damping, rejected = min(10.0 * damping, 1e6), rejected + 1
        return float(np.linalg.norm(error)), state

    def _leave_singular(self, y: np.ndarray) -> np.ndarray:
        """A regular starting point near a singular configuration: towards the middle of the joint limits."""
        mechanism = self.mechanism
        lower = np.maximum(mechanism.lower[mechanism.independent], -1.0)
        upper = np.minimum(mechanism.upper[mechanism.independent], 1.0)
        return y + 0.3 * (0.5 * (lower + upper) - y) + 0.01


def _rank(J: np.ndarray) -> int:
    return int(np.linalg.matrix_rank(J, tol=1e-6 * max(1.0, float(np.abs(J).max()))))


def _crosses_singularity(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether the foot Jacobian, (3, n), may have been singular between two neighbouring poses.

    The determinant's sign would miss two crossings at once (knee and hip of a quadruped's leg); the eigenvalues of
    before^-1 after count each, see `Mechanism.advance`.
    """
    ratio = np.linalg.lstsq(before, after, rcond=None)[0]
    return bool((np.linalg.eigvals(ratio).real <= 0.0).any())
