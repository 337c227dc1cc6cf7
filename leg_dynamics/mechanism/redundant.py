"""Poses of the foot, position and orientation: rank of the geometric Jacobian, inverse kinematics of redundant legs.

The geometric Jacobian J (6, n) gives the foot's velocity and angular velocity in the hip frame, (v, ω) = J yd. To make
its rows and columns comparable, lengths are counted in a characteristic length L: singular values are those of
diag(1/L, 1) J diag(L or 1), where prismatic coordinates are counted in L too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from scipy.linalg import blas
from scipy.optimize import nnls

from leg_dynamics.errors import (
    AssemblyError,
    JointLimitError,
    OutOfReachError,
    ParameterError,
    RowError,
    RowFailures,
    ShapeError,
    SingularityError,
)
from leg_dynamics.mechanism.reach import is_beyond, longest_reach, reach_text

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = ["PoseSearch", "PoseSolution", "RankReport", "bounded_least_squares", "home_length", "rank_report"]

# Singular values below this share of the largest count as zero.
RANK_SHARE = 1e-6
# Errors of the foot, shares of the characteristic length and rad: a descent goes on to the first and needs the second.
TARGET = 4e-15
ACCEPTED = 1e-10
# Excess of a joint over its limit, rad or shares of the mechanism's length, that rounding and closing the loops leave.
LIMIT_TOLERANCE = 1e-9
ITERATIONS = 80
# Steps in a row that may fail before a descent counts as stuck.
REJECTIONS = 12
LARGEST_STEP = 0.5
# Damping is a multiple of the squared error: where that vanishes the method is Newton's, at singular poses too.
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 0.1, 1e-8, 1e8
DAMPING_FLOOR = 1e-15
# How far a descent is moved once where its error has no slope, as at a straight leg that should bend.
NUDGE = 0.05
# A descent that gains less than that share of its error in so many steps is stuck.
SLOW_SHARE, SLOW_STEPS = 0.01, 12
POSTURE_ITERATIONS = 60
POSTURE_STEP = 1e-8
POSTURE_HALVINGS = 8
LEAST_CURVATURE = 0.2
DIFFERENCE = 1e-6
# Below that share a direction of the foot counts as lost while the posture is improved.
POSTURE_RANK = 1e-5
# Descents towards a target that the links are too short for.
FAR_STARTS = 3
# Farther targets, in characteristic lengths, are looked for at this distance.
FARTHEST = 1e6
AXES = ("v_x", "v_y", "v_z", "ω_x", "ω_y", "ω_z")


@dataclass(frozen=True)
class RankReport:
    """What the foot and the joints can do at one pose, to first order.

    Attributes
    ----------
    q : (n,) array
        The pose: independent coordinates, rad or m.
    rank, position_rank, rotation_rank : int
        Of the geometric Jacobian, its three rows of velocity, and its three rows of angular velocity.
    full_rank : int
        min(6, n): what `rank` is at a regular pose of most legs.
    singular_values : (min(6, n),) array
        Falling, dimensionless: velocities over `characteristic_length`, prismatic coordinates too.
    tolerance : float
        Singular values below this share of the largest count as zero.
    gap : tuple of float
        Smallest counted and largest uncounted singular value as shares of the largest: far apart where the rank is
        beyond doubt. The second is 0 where all are counted.
    lost_directions : (6 - rank, 6) array
        Orthonormal rows (v/L, ω), hip frame: the foot moves in none of them. The same numbers are wrenches (f L, m)
        that load no joint. Along the frame's axes as far as the lost space allows it.
    self_motions : (n - rank, n) array
        Rows are velocities of the independent coordinates, rad/s or m/s, that leave the foot at rest; orthonormal
        with prismatic coordinates over `characteristic_length`.
    characteristic_length : float
        L, m.
    joint_names : tuple of str
    """

    q: np.ndarray
    rank: int
    position_rank: int
    rotation_rank: int
    full_rank: int
    singular_values: np.ndarray
    tolerance: float
    gap: tuple[float, float]
    lost_directions: np.ndarray
    self_motions: np.ndarray
    characteristic_length: float
    joint_names: tuple[str, ...]

    @property
    def deficient(self) -> bool:
        """Whether the rank is lower than at a regular pose."""
        return self.rank < self.full_rank

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON-ready values."""
        values = asdict(self)
        return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}

    def __str__(self) -> str:
        sigma = ", ".join(f"{value:.4g}" for value in self.singular_values)
        lines = [
            f"rank {self.rank} of {self.full_rank} (position {self.position_rank}, rotation {self.rotation_rank})",
            f"singular values {sigma} (dimensionless, lengths over {self.characteristic_length:.6g} m)",
        ]
        lines += [f"lost: {_combination(row, AXES)}" for row in self.lost_directions]
        lines += [f"self-motion: {_combination(row, self.joint_names)}" for row in self.self_motions]
        return "\n".join(lines)


def _combination(row: np.ndarray, names: Sequence[str]) -> str:
    """A vector as a sum of named components, the negligible ones left out."""
    terms = [(value, name) for value, name in zip(row, names, strict=True) if abs(value) > 1e-6 * np.abs(row).max()]
    return " ".join(f"{value:+.4g} {name}" for value, name in terms)


def home_length(mechanism: Mechanism) -> float:
    """Distance from the hip's origin to the foot in the home pose, m; a length of the mechanism where that is zero."""
    distance = float(np.linalg.norm(mechanism.foot_position(mechanism.seeds[0])))
    return distance if distance > 1e-6 * mechanism.closure.length else float(mechanism.closure.length)


def _positive(name: str, value: Any) -> float:
    number = value if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool) else -1.0
    if not 0.0 < number < np.inf:
        raise ParameterError(f"{name} must be a positive, finite number, got {value!r}")
    return float(number)


def _unit(mechanism: Mechanism, length: float) -> np.ndarray:
    """What one unit of each independent coordinate is: `length` m, or 1 rad; (n,)."""
    kinds = [mechanism.description.joint(name).unit for name in mechanism.joint_names]
    return np.array([length if kind == "m" else 1.0 for kind in kinds])


def _aligned(basis: np.ndarray) -> np.ndarray:
    """Orthonormal rows of the space that `basis` (k, m), orthonormal rows, spans: along the axes where it allows it."""
    projector = basis.T @ basis
    rows: list[np.ndarray] = []
    for _ in range(len(basis)):
        norms = np.linalg.norm(projector, axis=1)
        # The first among equals, whatever rounding says.
        axis = int(np.flatnonzero(norms > norms.max() - 1e-9)[0])
        row = projector[axis] / norms[axis]
        rows.append(row)
        projector = projector - np.outer(projector @ row, row)
        projector = 0.5 * (projector + projector.T)
    return np.array(rows).reshape(len(basis), basis.shape[1])


def rank_report(
    mechanism: Mechanism,
    y: np.ndarray,
    J: np.ndarray,
    characteristic_length: float | None = None,
    tolerance: float = RANK_SHARE,
) -> RankReport:
    """Rank, lost directions and self-motions of a geometric Jacobian.

    Parameters
    ----------
    mechanism : Mechanism
    y : (n,) array
        The pose.
    J : (6, n) array
        Its geometric Jacobian.
    characteristic_length : float, optional
        m; `home_length` where None.
    tolerance : float
        Share of the largest singular value below which one counts as zero.

    Raises
    ------
    ParameterError
        The length is not positive, or the tolerance is not between 0 and 1.
    """
    length = home_length(mechanism)
    if characteristic_length is not None:
        length = _positive("characteristic_length", characteristic_length)
    tolerance = _positive("tolerance", tolerance)
    if tolerance >= 1.0:
        raise ParameterError(f"tolerance is a share of the largest singular value, below 1; got {tolerance!r}")
    unit = _unit(mechanism, length)
    scaled = J * unit
    scaled[:3] /= length
    left, sigma, right = np.linalg.svd(scaled)
    largest = float(sigma.max(initial=0.0))

    def rank_of(values: np.ndarray) -> int:
        return int(np.count_nonzero(values > tolerance * largest))

    rank = rank_of(sigma)
    parts = [rank_of(np.linalg.svd(rows, compute_uv=False)) for rows in (scaled[:3], scaled[3:])]
    counted = float(sigma[rank - 1] / largest) if rank else 0.0
    below = float(sigma[rank] / largest) if 0 < rank < len(sigma) else 0.0
    return RankReport(
        q=y.copy(),
        rank=rank,
        position_rank=parts[0],
        rotation_rank=parts[1],
        full_rank=min(J.shape),
        singular_values=sigma,
        tolerance=tolerance,
        gap=(counted, below),
        lost_directions=_aligned(left.T[rank:]),
        self_motions=_aligned(right[rank:]) * unit,
        characteristic_length=length,
        joint_names=mechanism.joint_names,
    )


def bounded_least_squares(E: np.ndarray, f: np.ndarray, C: np.ndarray, b: np.ndarray) -> np.ndarray | None:
    """The x of smallest |E x - f| with C x >= b, by an active set; None where rounding defeats it.

    With E = Q R it is a problem of least distance in z = R x - Q^T f, which goes over to non-negative least squares for
    the multipliers (Lawson and Hanson, Solving Least Squares Problems, 1974, chapter 23, algorithms LSI and LDP).

    Parameters
    ----------
    E : (m, n) array
        Of full column rank.
    f : (m,) array
    C : (k, n) array
    b : (k,) array
        Not positive: x = 0 is allowed.

    Returns
    -------
    (n,) array or None
        Outside the bounds by rounding at most.
    """
    Q, R = np.linalg.qr(E)
    centre = Q.T @ f
    # dtrsm keeps to unthreaded code: waking BLAS threads costs a hundred times the arithmetic at this size.
    x = blas.dtrsm(1.0, R, centre[:, None]).ravel()
    violated = C @ x < b
    if not violated.any():
        return x
    rows = blas.dtrsm(1.0, R, C.T, trans_a=1).T
    distance = b - rows @ centre
    norms = np.linalg.norm(rows, axis=1)
    used = norms > 0.0
    rows, distance = rows[used] / norms[used, None], distance[used] / norms[used]
    matrix = np.vstack([rows.T, distance])
    target = np.zeros(len(matrix))
    target[-1] = 1.0
    try:
        multipliers, _ = nnls(matrix, target)
    except RuntimeError:  # no convergence
        return None
    left = target - matrix @ multipliers
    if not left[-1] > 0.0:
        return None
    x = blas.dtrsm(1.0, R, (centre - left[:-1] / left[-1])[:, None]).ravel()
    return x if np.isfinite(x).all() else None


@dataclass(frozen=True)
class PoseSolution:
    """Joint coordinates for poses of the foot, and how good they are; one sample or a batch (...).

    Rows that failed (``on_error="nan"``) are NaN, with rank -1 and no active limit.

    Attributes
    ----------
    q : (..., n) array
        Independent coordinates, rad or m.
    position_error : (...,) array
        Distance of the foot from where it was asked for, m.
    rotation_error : (...,) array
        Angle between its orientation and the one that was asked for, rad; 0 where none was.
    rank : (...,) array of int
        Of the task's Jacobian: its three rows of velocity, with an orientation all six.
    redundancy : (...,) array of int
        Motions of the joints that leave the task alone, n - rank; -1 in failed rows.
    singular_values : (..., k) array
        Of the task's Jacobian, falling, dimensionless: see `characteristic_length`.
    active_limits : (..., number of tree joints) array of int
        -1 where a joint of the spanning tree stands at or below its lower limit, 1 at or above its upper one, else 0.
    posture_cost : (...,) array
        Half the sum of squares of (q - posture) / (half the joint's range), which the self-motion has made least.
    starts : (...,) array of int
        Starting poses that were tried.
    characteristic_length : float
        Length that velocities and prismatic coordinates were divided by, m.
    joint_names, tree_joint_names : tuple of str
        Of `q` and of `active_limits`.
    """

    q: np.ndarray
    position_error: np.ndarray
    rotation_error: np.ndarray
    rank: np.ndarray
    redundancy: np.ndarray
    singular_values: np.ndarray
    active_limits: np.ndarray
    posture_cost: np.ndarray
    starts: np.ndarray
    characteristic_length: float
    joint_names: tuple[str, ...]
    tree_joint_names: tuple[str, ...]

    def joints_at_limits(self) -> dict[str, str]:
        """Joints that stand at a limit, ``lower`` or ``upper``, of one sample.

        Raises
        ------
        ShapeError
            The solution is a batch.
        """
        if self.active_limits.ndim != 1:
            raise ShapeError("joints_at_limits is for one sample: read active_limits, whose columns are tree joints")
        sides = {-1: "lower", 1: "upper"}
        return {n: sides[int(s)] for n, s in zip(self.tree_joint_names, self.active_limits, strict=True) if s}


@dataclass(frozen=True)
class _Task:
    """Where the foot should be, hip frame; no matter how turned where `rotation` is None."""

    position: np.ndarray
    rotation: np.ndarray | None


@dataclass(slots=True)
class _Point:
    """A pose on the way: `error` (k,) of the task, dimensionless, and its derivative `J` (k, n) per `unit`.

    `excess` (j,) and its derivative `excess_rows` are those of passive joints beyond their limits; `C` and `room` say
    that the others keep their limits to first order, C x >= room.
    """

    state: ClosedState
    error: np.ndarray
    J: np.ndarray
    excess: np.ndarray
    excess_rows: np.ndarray
    C: np.ndarray
    room: np.ndarray

    @property
    def merit(self) -> float:
        return float(self.error @ self.error + self.excess @ self.excess)


class PoseSearch:
    """Inverse kinematics of the foot's position or pose for any number of independent coordinates.

    Each step is damped least squares (Nakamura and Hanafusa 1986; Wampler 1986) with the joint limits as constraints:
    a joint that meets its limit stays there while the others take over, and leaves it when that helps. The damping
    follows the squared error and the success of the last step, so that poses of lower rank need no other treatment.
    Where the task leaves self-motions, they bring the joints as near to a posture as the limits allow, the foot held
    at the target. A descent that gets stuck starts again from other poses, always the same ones.

    Parameters
    ----------
    mechanism : Mechanism
    oriented : bool
        Whether targets have an orientation.
    limits : {"error", "ignore"}
    starts : int
        Starting poses to try.
    """

    def __init__(self, mechanism: Mechanism, oriented: bool, limits: str = "error", starts: int = 40) -> None:
        if limits not in ("error", "ignore"):
            raise ParameterError(f"limits must be 'error' or 'ignore', got {limits!r}")
        if isinstance(starts, bool) or not isinstance(starts, (int, np.integer)) or starts < 1:
            raise ParameterError(f"starts must be a whole number, at least 1, got {starts!r}")
        self.mechanism = mechanism
        self.oriented = oriented
        self.limited = limits == "error"
        self.starts = int(starts)
        self.length = home_length(mechanism)
        self._longest_reach = longest_reach(mechanism)
        self.unit = _unit(mechanism, self.length)
        independent, dependent = mechanism.independent, mechanism.dependent
        self.lower, self.upper = mechanism.lower[independent], mechanism.upper[independent]
        self._passive = [j for j in dependent if np.isfinite([mechanism.lower[j], mechanism.upper[j]]).any()]
        tree_unit = mechanism.closure.coordinate_unit
        self._turns = np.array([mechanism.description.joint(name).unit == "rad" for name in mechanism.tree.joint_names])
        self._passive_unit = tree_unit[self._passive]
        box_lower, box_upper = (bound[independent] for bound in mechanism.search_box())
        self._box = box_lower, box_upper
        home = mechanism.seeds[0].y
        self.half_range = np.maximum(0.5 * (box_upper - box_lower), 1e-6 * self.unit)
        unlimited = np.isinf(self.lower) & np.isinf(self.upper)
        self.middle = np.where(unlimited, home, 0.5 * (box_lower + box_upper))
        self.home = home

    # ------------------------------------------------------------------ interface to a leg's arrays

    @property
    def width(self) -> int:
        """Numbers of a row of `columns`."""
        return self.mechanism.n + self._sigmas + self.mechanism.nv + 5

    @property
    def _sigmas(self) -> int:
        return min(6 if self.oriented else 3, self.mechanism.n)

    def columns(
        self,
        p: np.ndarray,
        rotation: np.ndarray | None,
        start: np.ndarray | None,
        posture: np.ndarray | None,
        failures: RowFailures,
    ) -> np.ndarray:
        """Solve every row; see `solution` for what the numbers are.

        Parameters
        ----------
        p : (..., 3) array
        rotation : (..., 9) array or None
            Row by row.
        start, posture : (..., n) array or None

        Returns
        -------
        (..., width) array
            NaN in failing rows.
        """
        arrays = [None if array is None else np.atleast_2d(array) for array in (p, rotation, start, posture)]
        targets = arrays[0]
        assert targets is not None
        result = np.full((len(targets), self.width), np.nan)
        far = is_beyond(targets, self._longest_reach)
        for row in (*np.flatnonzero(far).tolist(), *np.flatnonzero(~far).tolist()):
            position, matrix, first, wanted = (None if array is None else array[row] for array in arrays)
            assert position is not None
            try:
                result[row] = self._row(position, matrix, first, wanted)
            except RowError as error:
                failures.add(row, error)
        return result.reshape(*p.shape[:-1], self.width)

    def solution(self, columns: np.ndarray) -> PoseSolution:
        """Rows of `columns` by name."""
        n, nv = self.mechanism.n, self.mechanism.nv
        cuts = np.cumsum([n, self._sigmas, nv, 1, 1, 1, 1])
        q, sigma, active, *single = np.split(columns, cuts, axis=-1)
        place, turn, cost, rank, starts = (values[..., 0] for values in single)
        solved = np.isfinite(rank)
        whole = np.where(solved, rank, -1).astype(np.intp)
        return PoseSolution(
            q=q,
            position_error=place,
            rotation_error=turn,
            rank=whole,
            redundancy=np.where(solved, n - whole, -1),
            singular_values=sigma,
            active_limits=np.where(np.isfinite(active), active, 0.0).astype(np.int8),
            posture_cost=cost,
            starts=np.where(solved, starts, 0).astype(np.intp),
            characteristic_length=self.length,
            joint_names=self.mechanism.joint_names,
            tree_joint_names=tuple(self.mechanism.tree.joint_names),
        )

    def _row(
        self, p: np.ndarray, rotation: np.ndarray | None, start: np.ndarray | None, posture: np.ndarray | None
    ) -> np.ndarray:
        mechanism = self.mechanism
        matrix = None if rotation is None else _nearest_rotation(rotation.reshape(3, 3))
        first = self.home if start is None else start
        if self.limited and start is not None:
            self._check_start(start)
        wanted = self.middle if posture is None else posture
        state, tried = self._solve(_Task(p, matrix), first, wanted)
        position, turned, J = mechanism.foot_motion(state)
        task = J[: 6 if self.oriented else 3] * self.unit
        task[:3] /= self.length
        sigma = np.linalg.svd(task, compute_uv=False)
        angle = 0.0 if matrix is None else float(np.linalg.norm(pin.log3(matrix @ turned.T)))
        tolerance = LIMIT_TOLERANCE * mechanism.closure.coordinate_unit
        tree = self._nearest_turns(state.q)
        active = (tree >= mechanism.upper - tolerance).astype(float) - (tree <= mechanism.lower + tolerance)
        rank = np.count_nonzero(sigma > RANK_SHARE * sigma.max(initial=0.0))
        cost = self._cost(state.y, wanted)
        return np.array([*state.y, *sigma, *active, np.linalg.norm(p - position), angle, cost, rank, tried])

    def _check_start(self, start: np.ndarray) -> None:
        margin = np.minimum(start - self.lower, self.upper - start)
        worst = int((margin / self.unit).argmin())
        if margin[worst] < -LIMIT_TOLERANCE * self.unit[worst]:
            name = self.mechanism.joint_names[worst]
            raise JointLimitError(
                f"the start's {name} = {start[worst]:.6g} {self.mechanism.description.joint(name).unit} is outside "
                f"[{self.lower[worst]:.6g}, {self.upper[worst]:.6g}] by {-margin[worst]:.3g}: start inside the limits, "
                "or pass limits='ignore'",
                margin=float(margin[worst]),
                joint=name,
            )

    # ------------------------------------------------------------------ one target

    def _solve(self, task: _Task, first: np.ndarray, posture: np.ndarray) -> tuple[ClosedState, int]:
        """The solved pose, improved along its self-motions, and the number of starts that it took."""
        best: _Point | None = None
        tried = 0
        if is_beyond(task.position, self._longest_reach):
            return self._relaxed(task, first, best, posture, tried)
        for start in self._starting_poses(first):
            tried += 1
            point = self._descend(task, start, self.limited)
            if point is not None and (solved := self._finished(task, point, posture)) is not None:
                return solved, tried
            if point is not None and (best is None or point.merit < best.merit):
                best = point
        return self._relaxed(task, first, best, posture, tried)

    def _finished(self, task: _Task, point: _Point, posture: np.ndarray) -> ClosedState | None:
        """The solution that a descent's end becomes: posture improved, and confirmed; None where it is none."""
        if not self._is_solved(point):
            return None
        near = self._whole_turns_off(task, point, posture, self.limited)
        state = self._improve_posture(task, near, posture, self.limited)
        if not self.mechanism.closure.rows:
            return state
        # The assembly mode is the one that every other method of the leg finds from these coordinates alone.
        found = self._close(state.y)
        return found if found is not None and self._is_solved(self._point(task, found, self.limited)) else None

    def _starting_poses(self, first: np.ndarray) -> list[np.ndarray]:
        """The given pose, home, the middle of the limits, then poses spread evenly inside the limits."""
        from scipy.stats.qmc import Halton

        lower, upper = self._box
        named = [first] if np.array_equal(first, self.home) else [first, self.home]
        # Halton's first point is a corner.
        spread = Halton(self.mechanism.n, scramble=False).random(self.starts + 1)[1:]
        return [*named, self.middle, *(lower + spread * (upper - lower))][: self.starts]

    @staticmethod
    def _is_solved(point: _Point) -> bool:
        error = np.abs(point.error).max(initial=0.0)
        return bool(error <= ACCEPTED and point.excess.max(initial=0.0) <= LIMIT_TOLERANCE)

    def _nearest_turns(self, q: np.ndarray) -> np.ndarray:
        """Tree coordinates (nv,), passive angles within half a turn of the middle of their limits."""
        mechanism = self.mechanism
        middle = 0.5 * (mechanism.lower + mechanism.upper)
        passive = np.zeros(mechanism.nv, dtype=bool)
        passive[self._passive] = True
        turning = passive & self._turns & np.isfinite(middle)
        turned = np.where(turning, middle, 0.0)
        return np.where(turning, turned + (q - turned + np.pi) % (2.0 * np.pi) - np.pi, q)

    def _point(self, task: _Task, state: ClosedState, limited: bool) -> _Point:
        position, rotation, jacobian = self.mechanism.foot_motion(state)
        error, J = (task.position - position) / self.length, jacobian[:3] * (self.unit / self.length)
        if task.rotation is not None:
            # d log(R_target R^T) = -(inverse of the right Jacobian) ω.
            difference = task.rotation @ rotation.T
            error = np.concatenate([error, pin.log3(difference)])
            J = np.vstack([J, pin.Jlog3(difference) @ (jacobian[3:].reshape(3, -1) * self.unit)])
        none, no_rows = np.zeros(0), np.zeros((0, self.mechanism.n))
        if not limited:
            return _Point(state, error, J, none, no_rows, no_rows, none)
        identity = np.diag(self.unit)
        C, room = [identity, -identity], [self.lower - state.y, state.y - self.upper]
        excess, excess_rows = none, no_rows
        if self._passive:
            mechanism, unit = self.mechanism, self._passive_unit
            tree = self._nearest_turns(state.q)[self._passive]
            G = state.G[self._passive] * self.unit / unit[:, None]
            below = (mechanism.lower[self._passive] - tree) / unit
            above = (tree - mechanism.upper[self._passive]) / unit
            excess = np.concatenate([below[below > 0.0], above[above > 0.0]])
            excess_rows = np.vstack([G[below > 0.0], -G[above > 0.0]])
            C += [G[below <= 0.0], -G[above <= 0.0]]
            room += [below[below <= 0.0], above[above <= 0.0]]
        limits = np.concatenate(room)
        finite = np.isfinite(limits)
        return _Point(state, error, J, excess, excess_rows, np.vstack(C)[finite], np.minimum(limits[finite], 0.0))

    def _close(self, y: np.ndarray) -> ClosedState | None:
        try:
            return self.mechanism.close(y)
        except (AssemblyError, SingularityError):
            return None

    def _advance(self, state: ClosedState, y: np.ndarray) -> ClosedState | None:
        """A neighbouring pose in the same assembly mode; None, at little cost, where the step is too long for that."""
        return self.mechanism.advance(state, y) if self.mechanism.closure.rows else self._close(y)

    def _inside(self, y: np.ndarray, limited: bool) -> np.ndarray:
        return np.clip(y, self.lower, self.upper) if limited else y

    def _descend(self, task: _Task, start: np.ndarray, limited: bool) -> _Point | None:
        """Damped least squares within the joint limits; the best pose, or None where the start cannot be closed."""
        state = self._close(self._inside(start, limited))
        if state is None:
            return None
        reach, distance = FARTHEST * self.length, math.hypot(*task.position)
        if distance > reach:
            task = _Task(task.position * (reach / distance), task.rotation)
        point = self._point(task, state, limited)
        damping, rejected = FIRST_DAMPING, 0
        flat: _Point | None = None
        mark, slow = point.merit, 0
        for _ in range(ITERATIONS):
            merit = point.merit
            if merit <= TARGET**2 or rejected == REJECTIONS:
                break
            step, predicted = self._step(point, damping)
            if step is None or not predicted > 1e-6 * merit:
                if flat is not None or self._is_solved(point):
                    break
                flat = point
                pattern = NUDGE * self.unit * np.cos(1.0 + np.arange(self.mechanism.n))
                state = self._advance(point.state, self._inside(point.state.y + pattern, limited))
                if state is None:
                    break
                point = self._point(task, state, limited)
                mark, slow = point.merit, 0
                continue
            state = self._advance(point.state, self._inside(point.state.y + step * self.unit, limited))
            candidate = None if state is None else self._point(task, state, limited)
            gain = -1.0 if candidate is None else (merit - candidate.merit) / predicted
            if candidate is not None and gain > 1e-4:
                point, rejected = candidate, 0
                damping = max(0.1 * damping, LEAST_DAMPING) if gain > 0.7 else damping
                slow += 1
                if point.merit < (1.0 - SLOW_SHARE) * mark:
                    mark, slow = point.merit, 0
            elif self._is_solved(point):
                break  # only rounding is left
            else:
                rejected += 1
            if gain < 0.3:
                damping = min(5.0 * damping, MOST_DAMPING)
            if slow == SLOW_STEPS:
                break
        return point if flat is None or point.merit < flat.merit else flat

    @staticmethod
    def _step(point: _Point, damping: float) -> tuple[np.ndarray | None, float]:
        """A step x (n,), in units, and by how much it should make the merit smaller."""
        rows, error = point.J, point.error
        if len(point.excess):
            rows, error = np.vstack([rows, point.excess_rows]), np.concatenate([error, point.excess])
        merit = float(error @ error)
        strength = np.sqrt(max(damping * min(merit, 1.0), DAMPING_FLOOR))
        n = rows.shape[1]
        E = np.vstack([rows, strength * np.eye(n)])
        x = bounded_least_squares(E, np.concatenate([error, np.zeros(n)]), point.C, point.room)
        if x is None:
            return None, 0.0
        largest = float(np.abs(x).max())
        if largest > LARGEST_STEP:
            x *= LARGEST_STEP / largest
        left = error - rows @ x
        return x, merit - float(left @ left)

    # ------------------------------------------------------------------ self-motion

    def _cost(self, y: np.ndarray, posture: np.ndarray) -> float:
        away = (y - posture) / self.half_range
        return 0.5 * float(away @ away)

    def _whole_turns_off(self, task: _Task, point: _Point, posture: np.ndarray, limited: bool) -> _Point:
        """The same pose with each angle without limits within half a turn of the posture, where no loop forbids it."""
        mechanism = self.mechanism
        if mechanism.closure.rows:
            return point
        turning = self._turns[mechanism.independent]
        if limited:
            turning = turning & np.isinf(self.lower) & np.isinf(self.upper)
        y = point.state.y
        near = np.where(turning, posture + (y - posture + np.pi) % (2.0 * np.pi) - np.pi, y)
        if np.array_equal(near, y):
            return point
        moved = self._point(task, mechanism.close(near), limited)
        return moved if self._is_solved(moved) else point

    def _improve_posture(self, task: _Task, point: _Point, posture: np.ndarray, limited: bool) -> ClosedState:
        """Move along the self-motions towards the posture, the foot held at the target, limits kept.

        Sequential quadratic programming: a Newton step in the null space of the task's Jacobian under the limits, then
        a descent back to the target; the step is halved until the posture gets nearer.
        """
        cost = self._cost(point.state.y, posture)
        scale = self.half_range / self.unit
        for _ in range(POSTURE_ITERATIONS):
            _, sigma, right = np.linalg.svd(point.J * scale)
            rank = int(np.count_nonzero(sigma > POSTURE_RANK * sigma.max(initial=0.0)))
            null_space = right[rank:].T
            if null_space.shape[1] == 0:
                break
            away = (point.state.y - posture) / self.half_range
            slope = null_space.T @ away
            curvature, axes = np.linalg.eigh(self._posture_curvature(task, point, away, null_space, limited))
            root = np.sqrt(np.maximum(curvature, LEAST_CURVATURE))
            C = point.C @ (self.half_range[:, None] * null_space)
            z = bounded_least_squares(root[:, None] * axes.T, -(axes.T @ slope) / root, C, point.room)
            if z is None or float(np.abs(z).max()) < POSTURE_STEP:
                break
            step = null_space @ z
            share = min(1.0, LARGEST_STEP / float(np.abs(scale * step).max()))
            for _ in range(POSTURE_HALVINGS):
                candidate = self._descend(task, point.state.y + share * step * self.half_range, limited)
                if candidate is not None and self._is_solved(candidate):
                    better = self._cost(candidate.state.y, posture)
                    if better < cost + 1e-3 * share * float(slope @ z):
                        break
                share *= 0.5
            else:
                break
            point, cost = candidate, better
        return point.state

    def _posture_curvature(
        self, task: _Task, point: _Point, away: np.ndarray, null_space: np.ndarray, limited: bool
    ) -> np.ndarray:
        """Second derivative of the posture's cost along the self-motions, which are curved, (k, k).

        That of the Lagrangian, cost - multipliers . task; the task's part is a difference of its Jacobians. Where a
        neighbour cannot be closed, that of the cost alone.
        """
        y, scale = point.state.y, self.half_range / self.unit
        identity = np.eye(null_space.shape[1])
        free = (y > self.lower) & (y < self.upper) if limited else np.ones(len(y), dtype=bool)
        multipliers, *_ = np.linalg.lstsq((point.J * scale)[:, free].T, away[free], rcond=POSTURE_RANK)
        columns = []
        for direction in null_space.T:
            state = self._advance(point.state, y + DIFFERENCE * direction * self.half_range)
            if state is None:
                return identity
            moved = self._point(task, state, limited)
            columns.append(((moved.J - point.J) * scale).T @ multipliers / DIFFERENCE)
        bending = null_space.T @ np.column_stack(columns)
        return identity - 0.5 * (bending + bending.T)

    # ------------------------------------------------------------------ no solution at first

    def _relaxed(
        self, task: _Task, first: np.ndarray, best: _Point | None, posture: np.ndarray, tried: int
    ) -> tuple[ClosedState, int]:
        """Look without the limits: for a way to a solution inside them, else for the reason why there is none."""
        nearest = best
        outside: ClosedState | None = None
        least = np.inf
        poses = [] if best is None else [best.state.y]
        beyond = bool(is_beyond(task.position, self._longest_reach))
        # Without limits there is little to get stuck at: a quarter of the starts will do. Where none can reach the
        # target, a few tell the nearest pose.
        poses += self._starting_poses(first)[: FAR_STARTS if beyond else max(4, self.starts // 4)]
        for start in poses if self.limited or beyond else ():
            tried += 1
            point = self._descend(task, start, False)
            if point is None:
                continue
            if not self._is_solved(point):
                nearest = point if nearest is None or point.merit < nearest.merit else nearest
                continue
            state = self._improve_posture(task, self._whole_turns_off(task, point, self.middle, False), posture, False)
            inside = self._descend(task, state.y, True)
            if inside is not None and (solved := self._finished(task, inside, posture)) is not None:
                return solved, tried
            excess = float(self._excess(state).max())
            if excess < least:
                outside, least = state, excess
        turned = "" if task.rotation is None else " with that orientation"
        aim = f"put the foot at {task.position.tolist()} m{turned}"
        if outside is not None:
            raise self._limit_error(outside, f"joint coordinates that {aim} were found outside the limits only: ")
        if nearest is None:
            raise AssemblyError(
                f"none of {tried} starting poses can be closed: give a start, or a configuration of the mode that you "
                "mean"
            )
        position, rotation, _ = self.mechanism.foot_motion(nearest.state)
        distance = math.hypot(*(task.position - position))
        evidence: dict[str, Any] = {"margin": -distance, "nearest": nearest.state.y.copy()}
        angle = ""
        if task.rotation is not None:
            evidence["missing_angle"] = float(np.linalg.norm(pin.log3(task.rotation @ rotation.T)))
            angle = f" and {evidence['missing_angle']:.3g} rad"
        more = "; check the workspace, pass a start nearby, or more starts"
        raise OutOfReachError(
            f"no joint coordinates were found that {aim}: the nearest of {tried} descents, the joint limits left "
            f"aside, is {distance:.3g} m{angle} away"
            + (f": {reach_text(task.position, self._longest_reach)}; check the workspace" if beyond else more),
            **evidence,
        )

    def _excess(self, state: ClosedState) -> np.ndarray:
        """By how much each tree joint is beyond its limits, rad or shares of the mechanism's length, (nv,)."""
        mechanism = self.mechanism
        tree = self._nearest_turns(state.q)
        return np.maximum(mechanism.lower - tree, tree - mechanism.upper) / mechanism.closure.coordinate_unit

    def _limit_error(self, state: ClosedState, sentence: str) -> JointLimitError:
        mechanism = self.mechanism
        scaled = self._excess(state)
        worst = int(scaled.argmax())
        excess = float(scaled[worst] * mechanism.closure.coordinate_unit[worst])
        name, value = mechanism.tree.joint_names[worst], self._nearest_turns(state.q)[worst]
        return JointLimitError(
            f"{sentence}{name} = {value:.6g} {mechanism.description.joint(name).unit} is outside "
            f"[{mechanism.lower[worst]:.6g}, {mechanism.upper[worst]:.6g}] by {excess:.3g}, the least excess found; "
            "choose another target, pass more starts, or limits='ignore'",
            margin=-excess,
            joint=name,
            nearest=state.y.copy(),
        )


def _nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation matrix next to one that is orthonormal but for rounding: log needs it exact."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ right)
