"""Whether a motion touches a singular pose between two samples and comes back.

Where it does, two modes meet, and the samples on either side do not show it: the independent coordinates turn back, and
the passive ones go on into the other mode or turn back too. In this mode their rates then jump, by more than their
accelerations account for. A motion that is only sampled coarsely, or turns back just before the singular pose, shows
the same; so the motion is refined between the samples, by the polynomial through their coordinates, rates and
accelerations, until the rates follow from the accelerations or the distance to a singular pose is below what the
samples tell: of a pose that the polynomial passes, its error; of one where it turns back, the difference that the
accelerations make to it.

A motion that comes to rest at the singular pose and goes back the way it came has no such jump. It is seen in how near
the samples are to being singular: where that falls on one side of an interval and rises on the other fast enough to
vanish between, the nearest pose of the polynomial is looked for.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.errors import AssemblyError, LegDynamicsWarning, RowError, SingularityError
from leg_dynamics.mechanism.assembly import SAME_POSE, pose_difference
from leg_dynamics.mechanism.between import SampledMotion, Way, lead
from leg_dynamics.mechanism.singular import Singular

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = ["check_touching"]

# What the accelerations leave of the rates' change, as a share of the rates.
EXPLAINED = 0.02
# Shorter ways, rad or lengths of the mechanism, are below what tells two poses apart.
SMALLEST_WAY = 1e-6
# Singular values change by no more than about that much in a unit of the coordinates.
FALLING = 2.0
# Of what an interval moves towards a singular pose before it turns back: nearer than that it may reach it.
TURNING, PLACES = 0.05, np.linspace(0.0, 1.0, 9)
# rad or lengths: from farther off the kind of a singular pose is not looked for at the pose itself.
FARTHEST_FOLD = 0.5
# Nearness that falls by its last step times this would be gone.
VANISHING = 4.0
# Of the interval, where the nearest pose is looked for.
RESOLUTION, EVALUATIONS = 1e-7, 60
# Halvings of an interval before nearness counts, and at all.
COARSE, DEEPEST = 2, 24


@dataclass(frozen=True)
class _Point:
    """A pose of the motion: passive and independent rates and accelerations (nv,) without units."""

    time: float
    state: ClosedState
    rates: np.ndarray
    accelerations: np.ndarray


@dataclass(frozen=True)
class _Fold:
    """The loops' residual along the weakest passive motion x: normal . y + sigma x + bend x^2 / 2.

    Where it vanishes for one x only, the pose is singular. `weakest` (nv,) in rad and m, the rest without units.
    """

    sigma: float
    bend: float
    normal: np.ndarray
    weakest: np.ndarray


def check_touching(mechanism: Mechanism, states: list[ClosedState], motion: SampledMotion) -> None:
    """Check that a motion does not touch a singular pose of the closure between its samples.

    Intervals whose coordinates and rates do not fit each other are passed over, with a warning unless the rates are
    zero, as in a list of poses, or no singular pose is near.

    Parameters
    ----------
    mechanism : Mechanism
    states : list of ClosedState
        Of the samples, or of the first of them, each continued from the one before.
    motion : SampledMotion

    Raises
    ------
    SingularityError
        With `time`, s, `pose`, `kind`, `direction` and `margin` of the pose nearest to the singular one.
    """
    if mechanism.is_open or not mechanism.dependent.size or len(states) < 2:
        return
    sigma = np.array([mechanism.singular_values(state)[-1] for state in states])

    def point(row: int) -> _Point:
        return _point(mechanism, float(motion.time[row]), states[row], motion.v[row], motion.a[row])

    unclear: list[_Interval] = []
    after = point(0)
    for row in range(1, len(states)):
        before, after = after, point(row)
        interval = _Interval(mechanism, motion, row, before, after)
        interval.check()
        if _may_vanish(sigma, row):
            interval.check_nearest()
        if interval.is_unclear():
            unclear.append(interval)
    if unclear:
        first = unclear[0]
        more = f" and in {len(unclear) - 1} more of its {len(motion) - 1} intervals" if len(unclear) > 1 else ""
        warnings.warn(
            f"between its samples at {first.before.time:.6g} and {first.after.time:.6g} s{more} the motion's rates do "
            "not fit its coordinates: whether it touches a singular pose there is not known; sample it more finely, or "
            "give the rates of its coordinates",
            LegDynamicsWarning,
            stacklevel=6,
        )


def _may_vanish(sigma: np.ndarray, row: int) -> bool:
    """Whether what is positive at all samples, and zero at singular poses, may be zero between two of them."""
    left, right = sigma[row - 1], sigma[row]
    falls = sigma[row - 2] - left if row > 1 else np.inf
    rises = sigma[row + 1] - right if row + 1 < len(sigma) else np.inf
    if not (falls > 0.0 and rises > 0.0):
        return False
    return bool(left <= VANISHING * falls and right <= VANISHING * rises and min(falls, rises) < np.inf)


def _point(mechanism: Mechanism, time: float, state: ClosedState, v: np.ndarray, a: np.ndarray) -> _Point:
    unit = mechanism.closure.coordinate_unit
    qd = state.G @ v
    qdd = state.G @ a + mechanism.bias_acceleration(state, qd)
    return _Point(time, state, qd / unit, qdd / unit)


def _unexplained(left: _Point, right: _Point) -> float:
    """Change of the rates that the accelerations at both ends do not account for."""
    span = right.time - left.time
    change = right.rates - left.rates - 0.5 * span * (left.accelerations + right.accelerations)
    return float(np.linalg.norm(change))


class _Interval:
    """The motion between two neighbouring samples, `row` the later one."""

    def __init__(self, mechanism: Mechanism, motion: SampledMotion, row: int, before: _Point, after: _Point) -> None:
        self.mechanism, self.motion, self.row, self.before, self.after = mechanism, motion, row, before, after
        self.span = after.time - before.time
        self.rates = max(float(np.linalg.norm(before.rates)), float(np.linalg.norm(after.rates)))
        self.nearest: tuple[float, float, ClosedState] | None = None

    @cached_property
    def way(self) -> Way | None:
        """What the samples tell, if they fit each other."""
        return self.motion.way(self.row)

    def check(self) -> None:
        """Raise where the motion touches a singular pose here."""
        if self.rates * self.span < SMALLEST_WAY:
            return
        if _unexplained(self.before, self.after) <= EXPLAINED * self.rates or self.way is None:
            return
        if self.way.guessed:
            self.before, self.after = (
                _point(self.mechanism, point.time, point.state, v, a)
                for point, v, a in zip((self.before, self.after), self.way.v, self.way.a, strict=True)
            )
        self._search(self.way, self.before, self.after, 0)

    def is_unclear(self) -> bool:
        """Whether the samples do not tell the way between them, and a singular pose may be on it."""
        if self.rates * self.span < SMALLEST_WAY or _unexplained(self.before, self.after) <= EXPLAINED * self.rates:
            return False
        if self.way is not None:
            return False
        nearness = min(float(self.mechanism.singular_values(each.state)[-1]) for each in (self.before, self.after))
        moved = (self.after.state.q - self.before.state.q) / self.mechanism.closure.coordinate_unit
        return nearness <= FALLING * max(float(np.linalg.norm(moved)), self.rates * self.span)

    def check_nearest(self) -> None:
        """Raise where the nearest pose to a singular one that the polynomial comes to is not told from it."""
        way = self.way
        if way is None or self.rates * self.span < SMALLEST_WAY:
            return
        from scipy.optimize import minimize_scalar

        known = {0.0: self.before.state, 1.0: self.after.state}

        def nearness(share: float) -> float:
            start = min(known, key=lambda each: abs(each - share))
            known[share] = state = lead(self.mechanism, way, known[start], start, share)
            sigma = float(self.mechanism.singular_values(state)[-1])
            self._note(self.before.time + share * self.span, state, sigma)
            return sigma

        try:
            options = {"xatol": RESOLUTION, "maxiter": EVALUATIONS}
            minimize_scalar(nearness, bounds=(0.0, 1.0), method="bounded", options=options)
        except (AssemblyError, SingularityError) as error:
            raise self._met(error, self.before, self.after) from None
        assert self.nearest is not None
        _, time, state = self.nearest
        if self._touches(way, way.share(time), state):
            raise self._touched()

    def _touches(self, way: Way, share: float, state: ClosedState) -> bool:
        """Whether a pose of the way is no farther from a singular one than the motion may be off the polynomial.

        Nor, where the motion turns back there, than a small share of the way to it: of samples with few digits, or of
        rates that are differences of the samples, a motion that passes the singular pose looks as if it turned back
        just before.
        """
        fold = self._fold(state)
        # Near a cusp, or where the loops lose rank altogether, bend or normal vanish too: then what is of higher order
        # counts, as if they were as large as the root of sigma.
        least = fold.sigma**0.5
        size = float(np.linalg.norm(fold.normal))
        distance = fold.sigma**2 / (2.0 * max(abs(fold.bend), least) * max(size, least))
        towards = way.v / self.motion.unit @ fold.normal
        turned = 0.0
        if towards[0] * towards[1] < 0.0:
            poses = np.array([way.coordinates(each) for each in PLACES]) / self.motion.unit
            turned = float(np.ptp(poses @ fold.normal)) / size
        return distance <= max(way.error_at(share), TURNING * turned)

    def _fold(self, state: ClosedState) -> _Fold:
        mechanism = self.mechanism
        rows, values, motions = np.linalg.svd(state.dependent_jacobian, full_matrices=False)
        weakest = np.zeros(mechanism.nv)
        weakest[mechanism.dependent] = motions[-1] * mechanism.closure.coordinate_unit[mechanism.dependent]
        # The drift is minus the second derivative.
        bend = -float(rows[:, -1] @ mechanism.closure_drift(state, weakest))
        columns = state.rows.jacobian[:, mechanism.independent] * self.motion.unit
        return _Fold(float(values[-1]), bend, rows[:, -1] @ columns, weakest)

    def _at(self, way: Way, time: float, start: ClosedState) -> _Point:
        share = way.share(time)
        state = self.mechanism.follow(start, way.coordinates(share))
        return _point(self.mechanism, time, state, *way.rates(share))

    def _search(self, way: Way, left: _Point, right: _Point, depth: int) -> None:
        """Refine from `left` to `right` until the rates follow from the accelerations."""
        if _unexplained(left, right) <= EXPLAINED * self.rates:
            return
        touched = self._turns_back(way, left, right) and depth >= COARSE
        if depth == DEEPEST:
            raise self._touched()
        time = 0.5 * (left.time + right.time)
        try:
            middle = self._at(way, time, left.state)
            arrived = self.mechanism.follow(middle.state, right.state.y)
        except (AssemblyError, SingularityError) as error:
            raise self._met(error, left, right) from None
        touches = self._touches(way, way.share(time), middle.state)
        if touches or pose_difference(self.mechanism, arrived, right.state) > SAME_POSE:
            self._note(time, middle.state, float(self.mechanism.singular_values(middle.state)[-1]))
            raise self._touched()
        self._search(way, left, middle, depth + 1)
        self._search(way, middle, right, depth + 1)
        if touched:
            raise self._touched()

    def _turns_back(self, way: Way, left: _Point, right: _Point) -> bool:
        """Whether the motion reverses towards a singular pose that is nearer than what the samples tell."""
        span = right.time - left.time
        rates, smallest, nearness = [], np.inf, np.inf
        weakest: np.ndarray | None = None
        for point in (left, right):
            state = point.state
            rows, values, motions = np.linalg.svd(state.dependent_jacobian, full_matrices=False)
            sigma = float(values[-1])
            self._note(point.time, state, sigma)
            weakest = motions[-1] if weakest is None or weakest @ motions[-1] > 0.0 else -motions[-1]
            rate = float(weakest @ point.rates[self.mechanism.dependent])
            rates.append(rate)
            # Along the weakest motion x the way of y to the singular pose is sigma x / 2, sigma falling like x.
            normal = np.linalg.norm(
                rows[:, -1] @ (state.rows.jacobian[:, self.mechanism.independent] * self.motion.unit)
            )
            distance = 0.5 * sigma * abs(rate) * span / float(normal) if normal > 0.0 else np.inf
            smallest, nearness = min(smallest, sigma), min(nearness, distance)
        reverses = rates[0] * rates[1] < 0.0 and 2.0 * _unexplained(left, right) >= abs(rates[1] - rates[0])
        return bool(reverses and smallest <= FALLING * self.rates * span and nearness <= way.blur)

    def _note(self, time: float, state: ClosedState, sigma: float) -> None:
        """Keep the pose nearest to a singular one."""
        if self.nearest is None or sigma < self.nearest[0]:
            self.nearest = sigma, time, state

    def _touched(self) -> SingularityError:
        """The error of a motion that comes nearer to a singular pose than its samples tell."""
        assert self.nearest is not None
        sigma, time, state = self.nearest
        fold = self._fold(state)
        singular = self.mechanism.singular(state)
        if fold.sigma < FARTHEST_FOLD * abs(fold.bend):
            # The kind is that of the singular pose itself, not of one some way off.
            there = self.mechanism.place_of(state.q - fold.sigma / fold.bend * fold.weakest)
            if self.mechanism.singular_values(there)[-1] < sigma:
                singular = self.mechanism.singular(there)
        return self._error(sigma, time, state.q, str(singular), singular.kind, singular.direction)

    def _met(self, error: RowError, left: _Point, right: _Point) -> RowError:
        """The error of a motion that cannot be followed between two poses; it carries the last one reached."""
        q, kind = getattr(error, "tree_coordinates", None), getattr(error, "kind", None)
        if q is None or kind is None:
            return error
        mechanism = self.mechanism
        columns = mechanism.evaluate(q).jacobian[:, mechanism.dependent]
        sigma = np.linalg.svd(columns * mechanism.closure.coordinate_unit[mechanism.dependent], compute_uv=False)
        along = right.state.y - left.state.y
        length = float(along @ along)
        share = float((q[mechanism.independent] - left.state.y) @ along) / length if length > 0.0 else 0.5
        time = left.time + min(max(share, 0.0), 1.0) * (right.time - left.time)
        direction = error.evidence["direction"]
        return self._error(float(sigma[-1]), time, q, str(Singular(kind, direction)), kind, direction)

    def _error(
        self, sigma: float, time: float, q: np.ndarray, what: str, kind: str, direction: dict[str, float]
    ) -> SingularityError:
        mechanism = self.mechanism
        y = q[mechanism.independent]
        unsure = (
            ", the less since its accelerations do not follow from its rates"
            if self.way is not None and self.way.guessed
            else ""
        )
        return SingularityError(
            f"between its samples at {self.before.time:.6g} and {self.after.time:.6g} s the motion touches a singular "
            f"pose of the closure, where assembly modes meet, near {mechanism.pose_text(y)}: smallest singular value "
            f"{sigma:.3g}, {what}; the samples do not tell in which mode the mechanism goes on{unsure}: keep away from "
            "this pose, end the motion before it, or sample it more finely if it does not come that near",
            rows=self.row,
            margin=sigma,
            time=time,
            kind=kind,
            direction=direction,
            pose=mechanism.pose(y),
            tree_coordinates=q.copy(),
        )
