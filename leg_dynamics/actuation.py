"""What actuators can do about a motion: verdicts, and efforts where they are not unique or not enough.

Symbols: A (m, n), rates of the actuated joints per independent velocity; Q (n,), the generalised force that a motion
needs; A^T tau = Q, the balance of work. With as many actuators as motions and a regular A the efforts tau are unique.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from leg_dynamics.errors import (
    EffortLimitError,
    NonFiniteError,
    ParameterError,
    RowError,
    RowFailures,
    ShapeError,
    SingularityError,
)

__all__ = ["Actuation", "Feasibility", "IdleTorque", "Policy", "actuation_of", "feasibility"]

# Below that share of the largest singular value of A, rows of unit length, a motion is not held.
HELD = 1e-9
# At or below that share of max(1, the largest singular value), a pose has lost a motion: rounding is 1e-16 over it, and
# efforts are promised to 1e-9.
LOST = 1e-7
# Relative accuracy that the quadratic program is solved to, before the active bounds are known and the rest is exact.
QP_ACCURACY = 1e-9
# Steps before the quadratic program is left to the active-set method, and what it takes for infinite.
QP_STEPS, QP_INFINITY = 20, 1e20
# An effort that far beyond its bound, relative to it, is at the bound.
BOUND_TOLERANCE = 1e-9
# Relative rounding of a few dozen operations.
ROUNDING = 1e-14
# Entries below that share of the largest are what rounding leaves of zero.
DUST = 1e-14
# A unit push at an effort that moves it by less leaves it as good as fixed.
INDEPENDENT = 1e-10
# What efforts may leave unbalanced where all motions are held, relative to 1 + the largest generalised force.
BALANCED = 1e-8
# Stands for all margins below it where they have to be finite: at a limit of 0 any load has one of minus infinity.
LEAST_MARGIN = -1e9


class IdleTorque(NamedTuple):
    """Actuator efforts (..., m), and what they leave unbalanced at the independent coordinates (..., n), N·m or N.

    The residual is the force that something else would have to exert on the idle coordinates for the motion to be as
    asked; it is zero at all others. The motion really happens only where it is zero.
    """

    torque: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True)
class Actuation:
    """How a mechanism's actuators relate to its motions at most of its poses.

    Attributes
    ----------
    kind : str
        ``exact``: efforts are unique. ``redundant``: more actuators than motions, which can work against each other.
        ``under-actuated``: some motions are idle, no actuator holds them. ``idle and redundant``: both.
    motions, actuators : int
        n and m.
    rank : int
        Motions that actuators hold.
    preload : int
        Dimension of the efforts that do no work: actuators - rank.
    idle : tuple of str
        Independent coordinates that no actuator holds, as many as motions - rank. Where others could be named as well,
        those without an actuator of their own are.
    redundant : tuple of str
        Actuators that take part in the preload.
    """

    kind: Literal["exact", "redundant", "under-actuated", "idle and redundant"]
    motions: int
    actuators: int
    rank: int
    preload: int
    idle: tuple[str, ...]
    redundant: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The verdict as JSON-ready values."""
        return asdict(self) | {"idle": list(self.idle), "redundant": list(self.redundant)}

    def __str__(self) -> str:
        counted = f"{_counted(self.motions, 'motion')}, {_counted(self.actuators, 'actuator')}"
        if self.kind == "exact":
            return f"exactly actuated ({counted}): efforts are unique"
        parts = []
        if self.redundant:
            parts.append(
                f"redundantly actuated: {', '.join(self.redundant)} can work against each other in "
                f"{_counted(self.preload, 'way')}"
            )
        elif self.preload:
            parts.append(f"{_counted(self.preload, 'actuator')} more than the motions need")
        if self.idle:
            parts.append(f"under-actuated: no actuator holds {', '.join(self.idle)}")
        return f"{'; '.join(parts)} ({counted})"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


def _with_unit_rows(A: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(A, axis=-1, keepdims=True)
    return A / np.where(length > 0.0, length, 1.0)


def actuation_of(
    A: np.ndarray, joint_names: Sequence[str], actuated_joints: Sequence[str], actuator_names: Sequence[str]
) -> Actuation:
    """The verdict from samples of A.

    Parameters
    ----------
    A : (S, m, n) array
        At some poses; rows that are not finite are left out.
    joint_names : sequence of str
        The n independent coordinates.
    actuated_joints, actuator_names : sequence of str
        The m driven joints and what drives them.
    """
    m, n = len(actuated_joints), len(joint_names)
    A = A[np.isfinite(A).all(axis=(1, 2))]
    ranks = [_rank(sample) for sample in A] or [0]
    best = int(np.argmax(ranks))
    rank = ranks[best]
    idle: tuple[str, ...] = ()
    redundant: tuple[str, ...] = ()
    if len(A) and rank < n:
        sample = _with_unit_rows(A[best])
        own = [k for k, name in enumerate(joint_names) if name in actuated_joints]
        others = [k for k in range(n) if k not in own]
        held = _independent_columns(sample, own, others, rank)
        idle = tuple(name for k, name in enumerate(joint_names) if k not in held)
    elif not len(A):
        idle = tuple(joint_names)
    if len(A) and m > rank:
        # Efforts without work are the null space of A^T; an actuator takes part where its row of it is not zero.
        null = np.linalg.svd(_with_unit_rows(A[best]).T)[2][rank:].T
        redundant = tuple(name for name, row in zip(actuator_names, null, strict=True) if np.linalg.norm(row) > 1e-6)
    kind: Any = {(False, False): "exact", (True, False): "redundant", (False, True): "under-actuated"}.get(
        (m > rank, rank < n), "idle and redundant"
    )
    return Actuation(kind, n, m, rank, m - rank, idle, redundant)


def _rank(A: np.ndarray) -> int:
    if not A.size:
        return 0
    return int(np.linalg.matrix_rank(_with_unit_rows(A), tol=HELD))


def _independent_columns(A: np.ndarray, first: list[int], then: list[int], rank: int) -> list[int]:
    """`rank` columns that span all, out of the first as far as those are independent of each other."""
    # Not at the top: most legs never ask, and it takes as long to import as all the rest.
    import scipy.linalg

    chosen: list[int] = []
    rest = A.copy()
    for group in (first, then):
        if not group or len(chosen) == rank:
            continue
        _, triangle, order = scipy.linalg.qr(rest[:, group], mode="economic", pivoting=True)
        count = min(int(np.count_nonzero(np.abs(np.diagonal(triangle)) > HELD)), rank - len(chosen))
        taken = [group[k] for k in order[:count]]
        chosen += taken
        basis, _ = np.linalg.qr(rest[:, taken])
        rest = rest - basis @ (basis.T @ rest)
    return chosen


@dataclass(frozen=True)
class Feasibility:
    """Efforts and speeds of the actuated joints against what their actuators can do.

    Attributes
    ----------
    actuators : tuple of str
        Names of the m actuators.
    effort, speed : (..., m) array
        N·m or N; rad/s or m/s, on the joint side.
    effort_margin, speed_margin : (..., m) array
        1 - value / limit of the side that the value is on: negative beyond it, 1 where there is no limit, -inf for any
        value at a limit of 0.
    curve_margin : (..., m) array
        1 - max(u + |speed| / no-load speed, |u|), where u is the effort over the stall effort, positive along the speed
        and negative against it; 1 where the file states no such line. The motor at full voltage is the line
        u = 1 - |speed| / no-load speed in both quadrants, and its current is never above that at stall: up to the
        no-load speed, braking is bounded by the stall effort alone; beyond it the motor can hold no effort of zero, it
        brakes at least by what the line says; from twice the no-load speed on it can do nothing.
    """

    actuators: tuple[str, ...]
    effort: np.ndarray
    speed: np.ndarray
    effort_margin: np.ndarray
    speed_margin: np.ndarray
    curve_margin: np.ndarray

    @property
    def margin(self) -> np.ndarray:
        """The least of the three, (..., m); NaN in rows that could not be computed."""
        least: np.ndarray = np.minimum(np.minimum(self.effort_margin, self.speed_margin), self.curve_margin)
        return least

    @property
    def ok(self) -> np.ndarray:
        """Whether each actuator can do each sample, (..., m); NaN is not."""
        inside: np.ndarray = self.margin >= 0.0
        return inside

    def __bool__(self) -> bool:
        return bool(self.ok.all())

    def worst(self) -> list[dict[str, Any]]:
        """For each actuator its least margin of each kind and the flat index of the sample that has it, JSON-ready.

        Margins are finite, -1e9 stands for all below it; None is one that could not be computed.
        """
        rows = []
        for k, name in enumerate(self.actuators):
            entry: dict[str, Any] = {"actuator": name}
            for kind in _LIMITS:
                margin, sample = self._least(kind, k)
                entry[f"{kind}_margin"] = None if np.isnan(margin) else max(margin, LEAST_MARGIN)
                entry[f"{kind}_sample"] = sample
            entry["feasible"] = bool(self.ok[..., k].all())
            rows.append(entry)
        return rows

    def _least(self, kind: str, k: int) -> tuple[float, int]:
        """Least margin of an actuator, NaN before all others, and the flat index of its sample."""
        values = np.asarray(getattr(self, f"{kind}_margin"))[..., k].ravel()
        # argmin takes the first NaN where there is one.
        sample = int(np.argmin(values)) if values.size else 0
        return (float(values[sample]) if values.size else 1.0), sample

    def __str__(self) -> str:
        return "; ".join(f"{name}: {self._said(k)}" for k, name in enumerate(self.actuators))

    def _said(self, k: int) -> str:
        least = {what: self._least(kind, k) for kind, what in _LIMITS.items()}
        for margin, sample in least.values():
            if np.isnan(margin):
                return f"sample {sample} could not be computed"
        what = min(least, key=lambda what: least[what][0])
        margin, _ = least[what]
        if margin == -np.inf:
            return f"BEYOND its {what}, which is 0"
        return f"{'within' if margin >= 0.0 else 'BEYOND'} its {what}, least margin {margin:+.1%}"


_LIMITS = {"effort": "effort limit", "speed": "speed limit", "curve": "torque-speed line"}


def feasibility(
    effort: np.ndarray,
    speed: np.ndarray,
    limits: Any,
    lines: Sequence[tuple[float, float]],
    names: Sequence[str],
) -> Feasibility:
    """Margins of efforts and speeds.

    Parameters
    ----------
    effort, speed : (..., m) array
        At the actuated joints.
    limits : leg_dynamics.leg.Limits
        Of the actuated joints.
    lines : sequence of (float, float)
        Stall effort and no-load speed of each, at the joint; infinite where not stated.
    names : sequence of str
    """
    stall, free = (
        (np.array(values, dtype=float) for values in zip(*lines, strict=True)) if lines else (np.zeros(0),) * 2
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        load = effort / stall
        along = np.where(speed < 0.0, -load, load) + np.abs(speed) / free
        curve = 1.0 - np.maximum(along, np.abs(load))
        nearer = np.where(effort < 0.0, np.abs(limits.effort_lower), limits.effort)
        margins = [1.0 - _share(np.abs(x), limit) for x, limit in ((effort, nearer), (speed, limits.velocity))]
    return Feasibility(tuple(names), effort, speed, margins[0], margins[1], curve)


def _share(value: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """value / limit; 0 for nothing against a limit of nothing."""
    share: np.ndarray = np.where((value == 0.0) & (limit == 0.0), 0.0, value / limit)
    return share


class Policy(NamedTuple):
    """How efforts are chosen where the motion leaves a choice: the least sum of weight * (effort - preload)².

    Attributes
    ----------
    weights : (m,) array
        Positive.
    preload : (N, m) or (m,) array
        Efforts to be near to, N·m or N: what of them does no work is kept.
    lower, upper : (m,) array
        Bounds of the efforts, infinite where there are none. An effort is beyond one, by 1e-9 of it at most, only where
        the bounds leave no efforts that balance the work.
    """

    weights: np.ndarray
    preload: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(
        cls,
        m: int,
        effort_limits: tuple[np.ndarray, np.ndarray],
        weights: Any = None,
        bounds: Any = None,
        preload: np.ndarray | None = None,
    ) -> Policy:
        """Checked choices.

        Parameters
        ----------
        m : int
            Actuators.
        effort_limits : pair of (m,) array
            The file's lower and upper ones, infinite where it gives none.
        weights : (m,) array_like, optional
            1 where None.
        bounds : bool, (m,) array_like or pair of (m,) array_like, optional
            True: the file's effort limits; one array: the same both ways; two: lower and upper.
        preload : (..., m) array, optional

        Raises
        ------
        ShapeError, ParameterError
            A value is not usable.
        """
        w = np.ones(m) if weights is None else _vector("weights", weights, m)
        if not (np.isfinite(w).all() and (w > 0.0).all()):
            raise ParameterError(f"weights must be positive and finite, got {w.tolist()}", parameter="weights")
        if bounds is None or bounds is False:
            lower, upper = np.full(m, -np.inf), np.full(m, np.inf)
        elif bounds is True:
            lower, upper = effort_limits
            if not (np.isfinite(lower) | np.isfinite(upper)).any():
                raise ParameterError(
                    "bounds=True: no actuated joint has an effort limit in the file; state <limit effort=..>, or give "
                    "bounds as numbers",
                    parameter="bounds",
                )
        elif isinstance(bounds, tuple) and len(bounds) == 2 and not (m == 2 and np.ndim(bounds[0]) == 0):
            lower, upper = (_vector(f"bounds[{k}]", each, m) for k, each in enumerate(bounds))
        else:
            upper = _vector("bounds", bounds, m)
            lower = -upper
        if np.isnan(lower).any() or np.isnan(upper).any() or (lower > upper).any():
            raise ParameterError(
                f"bounds must have lower <= upper, got {lower.tolist()} and {upper.tolist()}", parameter="bounds"
            )
        if (lower == np.inf).any() or (upper == -np.inf).any():
            raise ParameterError(
                f"bounds must leave finite efforts, got lower {lower.tolist()} and upper {upper.tolist()}: no bound is "
                "lower -inf and upper inf",
                parameter="bounds",
            )
        p = np.zeros(m) if preload is None else preload
        if not np.isfinite(p).all():
            raise ParameterError(f"preload must be finite, got {p.tolist()}", parameter="preload")
        return cls(w, p, lower, upper)

    def efforts(
        self, A: np.ndarray, Q: np.ndarray, verdict: Actuation, names: Sequence[str], failures: RowFailures
    ) -> tuple[np.ndarray, np.ndarray]:
        """Efforts (N, m) for generalised forces Q (N, n), and what they leave unbalanced (N, n).

        Rows that are not finite stay NaN.

        Parameters
        ----------
        A : (N, m, n) array
        Q : (N, n) array
        verdict : Actuation
            Its idle coordinates are those that may stay unbalanced.
        names : sequence of str
            The n coordinates.
        failures : RowFailures
            Receives rows in which a motion that is held elsewhere is not, those that need more than the bounds, and
            those whose efforts are so large that their last digits do not balance the work.
        """
        count, m, n = A.shape
        held = np.array([k for k, name in enumerate(names) if name not in verdict.idle], dtype=np.intp)
        tau, residual = np.full((count, m), np.nan), np.full((count, n), np.nan)
        finite = np.isfinite(A).all(axis=(1, 2)) & np.isfinite(Q).all(axis=1)
        preload = np.broadcast_to(self.preload, (count, m))
        for row in np.flatnonzero(finite):
            B = A[row][:, held].T
            # Weights say who shares the load, not what can be held: they have no part in this.
            left, sigma, _ = np.linalg.svd(B, full_matrices=False)
            if len(held) and not (len(sigma) == len(held) and sigma[-1] > LOST * max(1.0, sigma[0])):
                failures.add(row, _lost(left, sigma, [names[k] for k in held]))
                continue
            # What overflows leaves no balance, and is refused for that.
            with np.errstate(over="ignore", invalid="ignore"):
                chosen = self._shared(B, Q[row, held], preload[row])
                if isinstance(chosen, np.ndarray) and (lost := _unbalanced(B, Q[row, held], chosen, preload[row])):
                    chosen = lost
            if isinstance(chosen, RowError):
                failures.add(row, chosen)
                continue
            tau[row] = chosen
            residual[row] = 0.0
            idle = np.setdiff1d(np.arange(n), held)
            residual[row, idle] = Q[row, idle] - A[row][:, idle].T @ chosen
        return tau, residual

    def _shared(self, B: np.ndarray, Q: np.ndarray, preload: np.ndarray) -> np.ndarray | RowError:
        """The optimum for one sample, or why there is none.

        Groups of actuators that share no motion are solved apart, so that the rounding of strong ones does not disturb
        weak ones.
        """
        # What rounding leaves between groups goes over to the right side, known after a first round.
        groups, rest = _groups(B)
        efforts = np.zeros(len(preload))
        for _ in range(2 if rest.any() else 1):
            missing: list[_Infeasible] = []
            for rows, columns in groups:
                share = _Share(
                    B[np.ix_(rows, columns)],
                    Q[rows] - rest[rows] @ efforts,
                    *(x[columns] for x in (self.weights, preload, self.lower, self.upper)),
                )
                found = share.optimum()
                if isinstance(found, _Infeasible):
                    missing.append(found)
                    efforts[columns] = found.free
                elif found is None:
                    return _unsettled()
                else:
                    efforts[columns] = found
        return self._too_much(missing, efforts) if missing else efforts

    def _too_much(self, missing: Sequence[_Infeasible], efforts: np.ndarray) -> EffortLimitError:
        """How much wider the bounds would have to be."""
        contain_zero = bool((self.lower <= 0.0).all() and (self.upper >= 0.0).all())
        excess = max(each.excess(contain_zero) for each in missing)
        # It is proved that the bounds are not enough, so a factor that rounds to 1 lies above it.
        needed = max(1.0 + excess, float(np.nextafter(1.0, 2.0)))
        if contain_zero:
            finite = np.isfinite(needed)
            need = f"{needed:.10g} times the bounds are needed" if finite else "no multiple of the bounds is enough"
        elif np.isfinite(needed):
            need = f"each has to move outwards by {needed - 1.0:.4g} times the larger magnitude of its two bounds"
        else:
            need = "moving them outwards by any multiple of the larger magnitude of each two is not enough"
        return EffortLimitError(
            f"no efforts within the bounds {self.lower.tolist()} to {self.upper.tolist()} produce the motion: {need} "
            f"(an optimum without bounds would have {[float(f'{x:.6g}') for x in efforts]}): slow the motion down, "
            "lower the load, or use stronger actuators",
            margin=1.0 - needed,
            needed=needed,
        )


def _groups(B: np.ndarray) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """Rows and columns that belong together, and what of B belongs to no group: entries of rounding's size."""
    joined = np.abs(B) > DUST * np.abs(B).max(initial=0.0)
    if joined.all() and B.size:
        return [(np.arange(len(B)), np.arange(B.shape[1]))], np.zeros_like(B)
    left = set(range(B.shape[1]))
    groups = []
    rest = B.copy()
    while left:
        columns = np.zeros(B.shape[1], dtype=bool)
        columns[min(left)] = True
        count = 0
        while count != (count := int(columns.sum())):
            rows = joined[:, columns].any(axis=1)
            columns |= joined[rows].any(axis=0)
        group = np.flatnonzero(rows), np.flatnonzero(columns)
        rest[np.ix_(*group)] = 0.0
        groups.append(group)
        left -= set(group[1].tolist())
    return groups, rest


class _Infeasible(NamedTuple):
    """A proof that the bounds are not enough for one group of actuators.

    ``coefficient`` (m,) times the efforts is the same for all efforts that balance the work, and `violation` less than
    the bounds allow.
    """

    share: _Share
    free: np.ndarray
    coefficient: np.ndarray
    violation: float

    def excess(self, contain_zero: bool) -> float:
        """The least by which the bounds must grow: as a multiple of themselves, or of each pair's larger magnitude."""
        share, toward = self.share, self.coefficient
        part = toward != 0.0
        binding = np.where(toward > 0.0, share.lower, share.upper)
        unit = np.abs(binding) if contain_zero else share.magnitude
        span = float(np.abs(toward[part]) @ unit[part])
        if span == 0.0:
            return np.inf
        proved = self.violation / span
        return max(proved, share.widening(contain_zero, proved))


@dataclass(frozen=True)
class _Share:
    """The least sum of weight * (effort - preload)² with B effort = Q and lower <= effort <= upper.

    B (n, m) has full row rank, unless it has no row.
    """

    B: np.ndarray
    Q: np.ndarray
    weights: np.ndarray
    preload: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @property
    def magnitude(self) -> np.ndarray:
        """The larger of the finite bounds' magnitudes, (m,); 0 without any."""
        sides = [np.where(np.isfinite(side), np.abs(side), 0.0) for side in (self.lower, self.upper)]
        largest: np.ndarray = np.maximum(*sides)
        return largest

    def optimum(self) -> np.ndarray | _Infeasible | None:
        """The efforts, or a proof that there are none; None if rounding kept the search from an end."""
        if not len(self.B):
            return np.clip(self.preload, self.lower, self.upper)
        found = self._searched()
        return self._inside(found) if isinstance(found, np.ndarray) else found

    def _inside(self, effort: np.ndarray) -> np.ndarray:
        """The efforts without what BOUND_TOLERANCE let them be beyond their bounds, as far as the balance allows it."""
        clipped = np.clip(effort, self.lower, self.upper)
        moved = clipped != effort
        if not moved.any():
            return effort
        # Those that are not at a bound take over what the others lose.
        loose = ~moved
        if loose.any():
            clipped[loose] += np.linalg.lstsq(self.B[:, loose], self.Q - self.B @ clipped, rcond=None)[0]
            clipped = np.clip(clipped, self.lower, self.upper)
        terms = np.abs(self.Q) + np.abs(self.B) @ np.abs(clipped)
        balanced = (np.abs(self.Q - self.B @ clipped) <= ROUNDING * terms).all()
        return clipped if balanced else effort

    def _searched(self) -> np.ndarray | _Infeasible | None:
        """`optimum`, whose efforts may be beyond a bound by BOUND_TOLERANCE."""
        none = np.zeros(len(self.weights))
        free = self._with_fixed(none)
        if not self._violation(free, none).any():
            return free.effort
        if self.B.shape[1] > len(self.B):
            found = self._by_interior(free)
            if found is not None:
                return found
        return self._by_active_set(free)

    def _with_fixed(self, side: np.ndarray) -> _Fixed:
        """The optimum with some efforts at a bound, lower where `side` is 1, upper where it is -1; others unbounded."""
        loose = side == 0.0
        effort = np.where(side > 0.0, self.lower, np.where(side < 0.0, self.upper, self.preload))
        B, root = self.B[:, loose], np.sqrt(self.weights[loose])
        left, sigma, right = np.linalg.svd(B)
        count = len(sigma)
        inverse = (right[:count].T / sigma) @ left.T
        null = right[count:].T
        triangle = _Triangle(null, root)
        effort[loose] += inverse @ (self.Q - self.B @ effort)
        if null.shape[1] and np.ptp(root):
            effort[loose] += null @ triangle.least_squares(self.preload[loose] - effort[loose])
        # The balance of work to the last digit: what is left is known more accurately than the efforts are.
        for _ in range(2):
            effort[loose] += inverse @ (self.Q - self.B @ effort)
        return _Fixed(effort, loose, inverse, null, triangle)

    def _violation(self, at: _Fixed, side: np.ndarray) -> np.ndarray:
        """By how much each effort is beyond its bounds, negative above the upper; 0 within rounding and if fixed."""
        effort = at.effort
        rounding = np.zeros(len(effort))
        terms = np.abs(self.Q) + np.abs(self.B) @ np.abs(effort)
        rounding[at.loose] = ROUNDING * (np.abs(at.inverse) @ terms + np.abs(effort[at.loose]))
        below, above = self.lower - effort, effort - self.upper
        with np.errstate(invalid="ignore"):
            below = np.where(below > rounding + BOUND_TOLERANCE * np.abs(self.lower), below, 0.0)
            above = np.where(above > rounding + BOUND_TOLERANCE * np.abs(self.upper), above, 0.0)
        beyond: np.ndarray = np.where(side == 0.0, below - above, 0.0)
        return beyond

    def _by_interior(self, free: _Fixed) -> np.ndarray | None:
        """By a quadratic program, exact once its active bounds are known; None where those do not prove optimal.

        Unknown is only the part of the efforts that does no work, counted from the optimum without bounds in units of
        the largest violation.
        """
        from proxsuite import proxqp

        m = len(self.weights)
        scale = float(np.abs(self._violation(free, np.zeros(m))).max())
        weights = self.weights / self.weights.max()
        lower, upper = (self.lower - free.effort) / scale, (self.upper - free.effort) / scale
        result = proxqp.dense.solve(
            free.null.T @ (weights[:, None] * free.null),
            np.zeros(free.null.shape[1]),
            None,
            None,
            free.null,
            np.clip(lower, -QP_INFINITY, QP_INFINITY),
            np.clip(upper, -QP_INFINITY, QP_INFINITY),
            eps_abs=QP_ACCURACY,
            eps_rel=0.0,
            max_iter=QP_STEPS,
        )
        if result.info.status != proxqp.PROXQP_SOLVED:
            return None
        moved = free.null @ np.asarray(result.x)
        near = 1e-6 * (1.0 + np.abs(moved))
        at_lower, at_upper = moved - lower < near, upper - moved < near
        side = np.where(at_lower, 1.0, np.where(at_upper, -1.0, 0.0))
        active = side != 0.0
        if active.sum() > free.null.shape[1]:
            return None
        if active.any() and np.linalg.svd(free.null[active], compute_uv=False)[-1] < INDEPENDENT:
            return None
        fixed = self._with_fixed(side)
        if self._violation(fixed, side).any():
            return None
        # Without work to do, the gradient is balanced by the bounds alone, each of which only pushes inwards.
        pull = self.weights * (fixed.effort - self.preload)
        push = np.linalg.lstsq(free.null[active].T, free.null.T @ pull, rcond=None)[0]
        return fixed.effort if (push * side[active] >= -ROUNDING * np.abs(pull).max()).all() else None

    def _by_active_set(self, free: _Fixed) -> np.ndarray | _Infeasible | None:
        """By the dual method of Goldfarb and Idnani (1983): one violated bound after the other becomes active.

        It begins at the optimum without bounds. A bound that the active ones contradict proves that there is no
        solution.
        """
        m = len(self.weights)
        side, push = np.zeros(m), np.zeros(m)
        at = free
        for _ in range(20 * (m + 5)):
            beyond = self._violation(at, side)
            if not beyond.any():
                return at.effort
            # In the units of the sum that is least: how far that bound alone would push it.
            k = int(np.argmax(np.abs(beyond) * np.sqrt(self.weights)))
            sign, violation, pushed = float(np.sign(beyond[k])), float(abs(beyond[k])), 0.0
            for _ in range(m + 1):
                step, gain, change = self._step(at, side, k, sign)
                falls = (side != 0.0) & (change < -ROUNDING * max(1.0, float(np.abs(change).max())))
                until = np.where(falls, push / np.where(falls, -change, 1.0), np.inf)
                drop = int(np.argmin(until))
                full = violation / gain if gain > 0.0 else np.inf
                length = min(full, float(until[drop]))
                if not np.isfinite(length):
                    toward = side * np.maximum(change, 0.0)
                    toward[k] = sign
                    return _Infeasible(self, free.effort, toward, violation)
                push = np.where(side != 0.0, np.maximum(push + length * change, 0.0), 0.0)
                pushed += length
                if full <= until[drop]:
                    side[k], push[k] = sign, pushed
                    at = self._with_fixed(side)
                    break
                violation -= length * gain
                effort = at.effort + length * step
                side[drop] = push[drop] = 0.0
                at = self._with_fixed(side)._replace(effort=effort)
            else:
                return None
        return None

    def _step(self, at: _Fixed, side: np.ndarray, k: int, sign: float) -> tuple[np.ndarray, float, np.ndarray]:
        """How a unit push at effort k moves the efforts, effort k, and the pushes at the bounds that are active."""
        loose = at.loose
        position = int(np.count_nonzero(loose[:k]))
        push = np.zeros(int(loose.sum()))
        push[position] = sign
        row = at.null[position] if at.null.shape[1] else np.zeros(0)
        step, gain = np.zeros(len(side)), 0.0
        if np.linalg.norm(row) > INDEPENDENT:
            step[loose] = at.null @ at.triangle.solve_twice(sign * row)
            gain = float(sign * step[k])
        price = at.inverse.T @ (self.weights[loose] * step[loose] - push)
        return step, gain, np.where(side != 0.0, -side * (self.B.T @ price), 0.0)

    def widening(self, contain_zero: bool, proved: float) -> float:
        """The least growth of the bounds by a linear program; `proved` where that fails.

        Efforts are counted in units of what their bounds allow, and rows by their largest entry.
        """
        from scipy.optimize import linprog

        m = len(self.weights)
        growing = self.magnitude
        unit = np.where(growing > 0.0, growing, growing.max(initial=0.0)) * (1.0 + proved)
        unit = np.where(unit > 0.0, unit, 1.0)
        B = self.B * unit
        row = np.abs(B).max(axis=1)
        rows, right = [], []
        for k in range(m):
            for sign, limit in ((1.0, self.upper[k]), (-1.0, -self.lower[k])):
                if np.isfinite(limit):
                    constraint = np.zeros(m + 1)
                    # The last unknown is the growth, in units of 1 + proved.
                    constraint[k] = sign
                    constraint[m] = -(limit if contain_zero else growing[k]) * (1.0 + proved) / unit[k]
                    rows.append(constraint)
                    right.append(limit / unit[k])
        solution = linprog(
            np.append(np.zeros(m), 1.0),
            A_ub=np.array(rows),
            b_ub=np.array(right),
            A_eq=np.hstack([B / row[:, None], np.zeros((len(B), 1))]),
            b_eq=self.Q / row,
            bounds=[(None, None)] * m + [(0.0, None)],
        )
        if solution.status == 2:  # infeasible however far they grow
            return np.inf
        return float(solution.x[-1]) * (1.0 + proved) if solution.success else proved


class _Fixed(NamedTuple):
    """The optimum with some efforts fixed.

    Attributes
    ----------
    effort : (m,) array
    loose : (m,) bool array
        Those that are not fixed.
    inverse, null : (loose, n), (loose, p) array
        Pseudoinverse and null space of their columns of B.
    triangle : _Triangle
        Of the null space, weighted.
    """

    effort: np.ndarray
    loose: np.ndarray
    inverse: np.ndarray
    null: np.ndarray
    triangle: _Triangle


class _Triangle:
    """QR decomposition of root * null, whose rows may differ by many orders of magnitude.

    With the large rows first and the columns pivoted it is accurate row by row (Cox and Higham 1998).
    """

    def __init__(self, null: np.ndarray, root: np.ndarray) -> None:
        self._null, self._root = null, root
        self._parts: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None = None

    def _decomposed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        if self._parts is None:
            import scipy.linalg

            weighted = self._root[:, None] * self._null
            rows = np.argsort(-np.abs(weighted).max(axis=1))
            orthogonal, triangle, columns = scipy.linalg.qr(weighted[rows], mode="economic", pivoting=True)
            self._parts = rows, orthogonal, triangle, columns
        return self._parts

    def least_squares(self, value: np.ndarray) -> np.ndarray:
        """The z with the least |root * (null z - value)|."""
        rows, orthogonal, triangle, columns = self._decomposed()
        z = np.empty(len(columns))
        z[columns] = np.linalg.solve(triangle, orthogonal.T @ (self._root * value)[rows])
        return z

    def solve_twice(self, value: np.ndarray) -> np.ndarray:
        """The z with null^T root² null z = value."""
        _, _, triangle, columns = self._decomposed()
        z = np.empty(len(columns))
        z[columns] = np.linalg.solve(triangle, np.linalg.solve(triangle.T, value[columns]))
        return z


def _unbalanced(B: np.ndarray, Q: np.ndarray, efforts: np.ndarray, preload: np.ndarray) -> NonFiniteError | None:
    """The error for efforts (m,) of which rounding, or an overflow, leaves too little that balances Q (n,)."""
    # B itself is known to its last digits, which large efforts make count.
    known_to = 4.0 * np.finfo(float).eps * (np.abs(B) @ np.abs(efforts))
    left = float((np.abs(B @ efforts - Q) + known_to).max(initial=0.0))
    size = 1.0 + float(np.abs(Q).max(initial=0.0))
    limit = BALANCED * size
    if left <= limit:
        return None
    advice = "bring the weights nearer to each other, or use generalized_force, which is always unique"
    if np.abs(preload).max(initial=0.0) > size:
        usable = 0.1 * limit / (np.finfo(float).eps * float(np.abs(B).sum(axis=1).max(initial=1.0)))
        advice = f"the preload {preload.tolist()} is too large for the motion's part to show in its digits: keep it "
        advice += f"below {usable:.1g}"
    return NonFiniteError(
        f"the efforts chosen leave {left:.3g} of the generalised force unbalanced, the limit is {limit:.3g}; {advice}",
        margin=limit - left,
        argument="preload",
    )


def _unsettled() -> SingularityError:
    return SingularityError(
        "the choice of efforts within the bounds did not settle: the bounds leave almost nothing to choose there; "
        "widen or narrow one of them by a little, bring the weights nearer to each other, or lower the preload"
    )


def _lost(left: np.ndarray, sigma: np.ndarray, names: Sequence[str]) -> SingularityError:
    direction = np.linalg.svd(left.T)[2][-1] if left.shape[1] < len(names) else left[:, -1]
    direction = direction / direction[np.argmax(np.abs(direction))]
    shown = ", ".join(f"{name} {x:.3g}" for name, x in zip(names, direction, strict=True) if abs(x) > 0.05)
    least = float(sigma[-1]) if len(sigma) == len(names) else 0.0
    largest = float(sigma[0]) if len(sigma) else 0.0
    return SingularityError(
        f"the actuators do not hold the motion ({shown}) there, a parallel singularity: smallest singular value "
        f"{least:.3g} of {largest:.3g}, the limit is {LOST * max(1.0, largest):.3g}; move away from this pose, or use "
        "generalized_force, which is always unique",
        margin=least,
        kind="parallel",
        direction=dict(zip(names, direction.tolist(), strict=True)),
    )


def _vector(name: str, value: Any, m: int) -> np.ndarray:
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    # Of dates, texts and truth values NumPy would make numbers.
    if array.shape != (m,) or array.dtype.kind not in "iuf":
        raise ShapeError(f"{name} must be {m} numbers, one an actuator, got {value!r}", argument=name)
    return array.astype(float)
