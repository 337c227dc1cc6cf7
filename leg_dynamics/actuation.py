"""What actuators can do about a motion: verdicts, and efforts where they are not unique or not enough.

Symbols: A (m, n), rates of the actuated joints per independent velocity; Q (n,), the generalised force that a motion
needs; A^T tau = Q, the balance of work. With as many actuators as motions and a regular A the efforts tau are unique.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from leg_dynamics.errors import EffortLimitError, ParameterError, RowFailures, ShapeError, SingularityError

__all__ = ["Actuation", "Feasibility", "IdleTorque", "Policy", "actuation_of", "feasibility"]

# Below that share of the largest singular value of A, rows of unit length, a motion is not held.
HELD = 1e-9
# Relative accuracy that the quadratic program is solved to, before the active bounds are known and the rest is exact.
QP_ACCURACY = 1e-9
# An effort that far beyond its bound, relative to it, is at the bound.
BOUND_TOLERANCE = 1e-9


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
        1 - |value| / limit: negative beyond it, 1 where there is no limit.
    curve_margin : (..., m) array
        1 - |effort| / stall effort - |speed| / no-load speed while the actuator drives, 1 - |effort| / stall effort
        while it brakes; 1 where the file states no such line.
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
        """For each actuator its least margin of each kind and the flat index of the sample that has it, JSON-ready."""
        rows = []
        for k, name in enumerate(self.actuators):
            entry: dict[str, Any] = {"actuator": name}
            for kind in ("effort", "speed", "curve"):
                values = np.asarray(getattr(self, f"{kind}_margin"))[..., k].ravel()
                sample = int(np.argmin(np.where(np.isnan(values), -np.inf, values))) if values.size else 0
                entry[f"{kind}_margin"] = float(values[sample]) if values.size else 1.0
                entry[f"{kind}_sample"] = sample
            entry["feasible"] = bool(self.ok[..., k].all())
            rows.append(entry)
        return rows

    def __str__(self) -> str:
        parts = []
        for row in self.worst():
            kind = min(("effort", "speed", "curve"), key=lambda kind: row[f"{kind}_margin"])
            what = "torque-speed line" if kind == "curve" else f"{kind} limit"
            verb = "within" if row["feasible"] else "BEYOND"
            parts.append(f"{row['actuator']}: {verb} its {what}, least margin {row[f'{kind}_margin']:+.1%}")
        return "; ".join(parts)


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
        # A limit of zero is no limit but a value of zero.
        load = _share(np.abs(effort), stall)
        driving = effort * speed > 0.0
        curve = 1.0 - load - np.where(driving, _share(np.abs(speed), free), 0.0)
        margins = [1.0 - _share(np.abs(x), limit) for x, limit in ((effort, limits.effort), (speed, limits.velocity))]
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
        Bounds of the efforts, infinite where there are none.
    """

    weights: np.ndarray
    preload: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @property
    def is_bounded(self) -> bool:
        """Whether any bound is finite."""
        return bool(np.isfinite(self.lower).any() or np.isfinite(self.upper).any())

    @classmethod
    def of(
        cls,
        m: int,
        effort_limits: np.ndarray,
        weights: Any = None,
        bounds: Any = None,
        preload: np.ndarray | None = None,
    ) -> Policy:
        """Checked choices.

        Parameters
        ----------
        m : int
            Actuators.
        effort_limits : (m,) array
            The file's, infinite where it gives none.
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
            if not np.isfinite(effort_limits).any():
                raise ParameterError(
                    "bounds=True: no actuated joint has an effort limit in the file; state <limit effort=..>, or give "
                    "bounds as numbers",
                    parameter="bounds",
                )
            lower, upper = -effort_limits, effort_limits
        elif isinstance(bounds, tuple) and len(bounds) == 2 and not (m == 2 and np.ndim(bounds[0]) == 0):
            lower, upper = (_vector(f"bounds[{k}]", each, m) for k, each in enumerate(bounds))
        else:
            upper = _vector("bounds", bounds, m)
            lower = -upper
        if np.isnan(lower).any() or np.isnan(upper).any() or (lower > upper).any():
            raise ParameterError(
                f"bounds must have lower <= upper, got {lower.tolist()} and {upper.tolist()}", parameter="bounds"
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
            Receives rows in which a motion that is held elsewhere is not, and those that need more than the bounds.
        """
        count, m, n = A.shape
        held = np.array([k for k, name in enumerate(names) if name not in verdict.idle], dtype=np.intp)
        tau, residual = np.full((count, m), np.nan), np.full((count, n), np.nan)
        finite = np.isfinite(A).all(axis=(1, 2)) & np.isfinite(Q).all(axis=1)
        root = np.sqrt(self.weights)
        preload = np.broadcast_to(self.preload, (count, m))
        for row in np.flatnonzero(finite):
            B = A[row][:, held].T
            left, sigma, right = np.linalg.svd(B / root, full_matrices=False)
            if len(held) and not (len(sigma) == len(held) and sigma[-1] > HELD * max(sigma[0], 1e-300)):
                failures.add(row, _lost(left, sigma, [names[k] for k in held]))
                continue
            missing = Q[row, held] - B @ preload[row]
            effort = preload[row] + right.T @ ((left.T @ missing) / sigma) / root
            if self.is_bounded and not self._within(effort):
                bounded = self._bounded(B, Q[row, held], preload[row])
                if bounded is None:
                    failures.add(row, self._too_much(B, Q[row, held], effort))
                    continue
                effort = bounded
            tau[row] = effort
            residual[row] = 0.0
            idle = np.setdiff1d(np.arange(n), held)
            residual[row, idle] = Q[row, idle] - A[row][:, idle].T @ effort
        return tau, residual

    def _within(self, effort: np.ndarray) -> bool:
        slack = BOUND_TOLERANCE * (1.0 + np.abs(effort))
        return bool(((effort >= self.lower - slack) & (effort <= self.upper + slack)).all())

    def _bounded(self, B: np.ndarray, Q: np.ndarray, preload: np.ndarray) -> np.ndarray | None:
        """The bounded optimum by a quadratic program, exact once its active bounds are known; None without one."""
        from proxsuite import proxqp

        m = len(self.weights)
        scale = max(1.0, float(np.abs(Q).max(initial=0.0)))
        bound = 1e20  # proxqp's infinity
        result = proxqp.dense.solve(
            np.diag(self.weights / self.weights.max()),
            -self.weights / self.weights.max() * preload / scale,
            B,
            Q / scale,
            np.eye(m),
            np.clip(self.lower / scale, -bound, bound),
            np.clip(self.upper / scale, -bound, bound),
            eps_abs=QP_ACCURACY,
            eps_rel=0.0,
        )
        if result.info.status != proxqp.PROXQP_SOLVED:
            return None
        effort: np.ndarray = np.asarray(result.x) * scale
        near = 1e-6 * (scale + np.abs(effort))
        fixed = (effort - self.lower < near) | (self.upper - effort < near)
        at = np.clip(effort, self.lower, self.upper)
        # With the active bounds known, the rest is a least-squares problem.
        free = ~fixed
        if free.any():
            root = np.sqrt(self.weights[free])
            C = B[:, free] / root
            missing = Q - B[:, fixed] @ at[fixed] - B[:, free] @ preload[free]
            exact = preload[free] + np.linalg.lstsq(C, missing, rcond=HELD)[0] / root
            if np.abs(exact - effort[free]).max(initial=0.0) <= 1e-5 * (scale + np.abs(effort).max()):
                at[free] = exact
        return at if np.abs(B @ at - Q).max(initial=0.0) <= 1e-7 * scale else None

    def _too_much(self, B: np.ndarray, Q: np.ndarray, effort: np.ndarray) -> EffortLimitError:
        """How many times the bounds would be needed, by a linear program."""
        from scipy.optimize import linprog

        m = len(effort)
        rows, right = [], []
        for k in range(m):
            for sign, limit in ((1.0, self.upper[k]), (-1.0, -self.lower[k])):
                if np.isfinite(limit):
                    row = np.zeros(m + 1)
                    row[k], row[m] = sign, -limit
                    rows.append(row)
                    right.append(0.0)
        solution = linprog(
            np.append(np.zeros(m), 1.0),
            A_ub=np.array(rows),
            b_ub=np.array(right),
            A_eq=np.hstack([B, np.zeros((len(B), 1))]),
            b_eq=Q,
            bounds=[(None, None)] * m + [(0.0, None)],
        )
        times = float(solution.x[-1]) if solution.success else np.inf
        need = (
            f"{times:.4g} times the bounds are needed" if np.isfinite(times) else "no multiple of the bounds is enough"
        )
        return EffortLimitError(
            f"no efforts within the bounds {self.lower.tolist()} to {self.upper.tolist()} produce the motion: {need} "
            f"(without bounds the efforts would be {effort.round(6).tolist()}): slow the motion down, lower the load, "
            "or use stronger actuators",
            margin=1.0 - times,
            needed=times,
        )


def _lost(left: np.ndarray, sigma: np.ndarray, names: Sequence[str]) -> SingularityError:
    direction = np.linalg.svd(left.T)[2][-1] if left.shape[1] < len(names) else left[:, -1]
    direction = direction / direction[np.argmax(np.abs(direction))]
    shown = ", ".join(f"{name} {x:.3g}" for name, x in zip(names, direction, strict=True) if abs(x) > 0.05)
    least = float(sigma[-1]) if len(sigma) == len(names) else 0.0
    return SingularityError(
        f"the actuators do not hold the motion ({shown}) there, a parallel singularity: smallest singular value "
        f"{least:.3g} of {sigma[0] if len(sigma) else 0.0:.3g}; move away from this pose, or use generalized_force, "
        "which is always unique",
        margin=least,
        kind="parallel",
        direction=dict(zip(names, direction.tolist(), strict=True)),
    )


def _vector(name: str, value: Any, m: int) -> np.ndarray:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != (m,):
        raise ShapeError(f"{name} must be {m} numbers, one an actuator, got {value!r}", argument=name)
    return array
