"""Whether a motion touches a singular pose between two samples and comes back.

Where it does, two modes meet, and the samples on either side do not show it: the independent coordinates turn back, and
the passive ones go on into the other mode or turn back too. In this mode their rates then jump, by more than their
accelerations account for. A motion that is only sampled coarsely, or turns back just before the singular pose, shows
the same; so the motion is refined between the samples, by the polynomial through their coordinates, rates and
accelerations, until the rates follow from the accelerations or the distance to the singular pose is below what the
samples tell: the difference that the accelerations make to the polynomial.

A motion that comes to rest at the singular pose and goes back the way it came has no such jump. It is seen in how near
the samples are to being singular: where that falls on one side of an interval and rises on the other fast enough to
vanish between, the nearest pose of the polynomial is looked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.errors import AssemblyError, RowError, SingularityError
from leg_dynamics.mechanism.assembly import SAME_POSE, pose_difference
from leg_dynamics.mechanism.singular import Singular

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = ["check_touching"]

# What the accelerations leave of the rates' change, as a share of the rates.
EXPLAINED = 0.02
# Share of the rates by which coordinates and rates, or rates and accelerations, of neighbouring samples may miss each
# other and still tell one motion between them.
FITTING = 0.2
# Shorter ways, rad or lengths of the mechanism, are below what tells two poses apart.
SMALLEST_WAY = 1e-6
# Rounding of the coordinates.
ROUNDING = 1e-11
# Of accelerations that follow from coordinates and rates alone: what is not known of them.
UNKNOWN = 0.05
# Singular values change by no more than about that much in a unit of the coordinates.
FALLING = 2.0
# Error of the polynomial through coordinates, rates and accelerations, as a share of what accelerations make of it, of
# samples with at least four to a turn of the motion's fastest part.
QUINTIC = 0.02
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


def check_touching(
    mechanism: Mechanism, found: np.ndarray, time: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> None:
    """Check that a motion does not touch a singular pose of the closure between its samples.

    Intervals whose coordinates and rates do not fit each other are passed over. Accelerations that do not fit, such as
    the zeros of a motion that is only to be checked, are replaced by those of the cubic polynomial.

    Parameters
    ----------
    mechanism : Mechanism
    found : (N, nv) array
        Closed tree coordinates of the samples, each continued from the one before.
    time : (N,) array
        s.
    q, v, a : (N, n) array
        The motion.

    Raises
    ------
    SingularityError
        With `time`, s, `pose`, `kind`, `direction` and `margin` of the pose nearest to the singular one.
    """
    if mechanism.is_open or not mechanism.dependent.size or len(time) < 2:
        return
    states = [mechanism.state_of(coordinates) for coordinates in found]
    pivots = np.array([state.smallest_pivot for state in states])
    after = _point(mechanism, float(time[0]), states[0], v[0], a[0])
    for row in range(1, len(time)):
        before, after = after, _point(mechanism, float(time[row]), states[row], v[row], a[row])
        pieces = slice(row - 1, row + 1)
        interval = _Interval(mechanism, row, before, after, q[pieces], v[pieces], a[pieces])
        interval.check()
        if _may_vanish(pivots, row):
            interval.check_nearest()


def _may_vanish(pivots: np.ndarray, row: int) -> bool:
    """Whether what is positive at all samples, and zero at singular poses, may be zero between two of them."""
    left, right = pivots[row - 1], pivots[row]
    falls = pivots[row - 2] - left if row > 1 else np.inf
    rises = pivots[row + 1] - right if row + 1 < len(pivots) else np.inf
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
    """The motion between two neighbouring samples, `row` the later one; q, v, a (2, n)."""

    def __init__(
        self,
        mechanism: Mechanism,
        row: int,
        before: _Point,
        after: _Point,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
    ) -> None:
        self.mechanism, self.row, self.before, self.after = mechanism, row, before, after
        self.q, self.v, self.a = q, v, a
        self.span = after.time - before.time
        self.rates = max(float(np.linalg.norm(before.rates)), float(np.linalg.norm(after.rates)))
        self.unit = mechanism.closure.coordinate_unit[mechanism.independent]
        self.nearest: tuple[float, float, ClosedState] | None = None
        self.guessed = False

    def check(self) -> None:
        """Raise where the motion touches a singular pose here."""
        if self.rates * self.span < SMALLEST_WAY:
            return
        if _unexplained(self.before, self.after) <= EXPLAINED * self.rates or not self._fits():
            return
        self._prepare()
        self._search(self.before, self.after, 0)

    def check_nearest(self) -> None:
        """Raise where the nearest pose to a singular one that the polynomial comes to is not told from it."""
        if self.span * float(np.linalg.norm(self.v / self.unit)) < SMALLEST_WAY or not self._fits():
            return
        from scipy.optimize import minimize_scalar

        self._prepare()
        known = {0.0: self.before.state, 1.0: self.after.state}

        def nearness(share: float) -> float:
            start = min(known, key=lambda each: abs(each - share))
            known[share] = state = self._reached(known[start], start, share)
            sigma = float(self.mechanism.singular_values(state)[-1])
            self._note(self.before.time + share * self.span, state, sigma)
            return sigma

        try:
            options = {"xatol": RESOLUTION, "maxiter": EVALUATIONS}
            minimize_scalar(nearness, bounds=(0.0, 1.0), method="bounded", options=options)
        except (AssemblyError, SingularityError) as error:
            raise self._met(error, self.before, self.after) from None
        assert self.nearest is not None
        # The singular value falls like the root of the way of y that is left.
        if 0.5 * self.nearest[0] ** 2 <= self.error:
            raise self._touched()

    def _reached(self, state: ClosedState, start: float, share: float, halvings: int = 3) -> ClosedState:
        """The pose at a share of the interval from another one's, along the polynomial where no straight way leads."""
        try:
            return self.mechanism.follow(state, self._coordinates(share))
        except (AssemblyError, SingularityError):
            if halvings == 0:
                raise
        middle = 0.5 * (start + share)
        return self._reached(self._reached(state, start, middle, halvings - 1), middle, share, halvings - 1)

    def _coordinates(self, share: float) -> np.ndarray:
        y: np.ndarray = share ** np.arange(6.0) @ self.coefficients
        return y

    def _fits(self) -> bool:
        """Whether coordinates and rates belong to one motion; accelerations that do not are replaced."""
        h, (q0, q1), (v0, v1) = self.span, self.q / self.unit, self.v / self.unit
        speed = max(float(np.linalg.norm(v0)), float(np.linalg.norm(v1)))
        if np.linalg.norm(q1 - q0 - 0.5 * h * (v0 + v1)) > FITTING * speed * h:
            return False
        chord = 6.0 * (q1 - q0) / h
        own = np.stack([chord - 4.0 * v0 - 2.0 * v1, -chord + 2.0 * v0 + 4.0 * v1]) / h
        a0, a1 = self.a / self.unit
        if np.linalg.norm(v1 - v0 - 0.5 * h * (a0 + a1)) > FITTING * speed:
            self.a, self.guessed = own * self.unit, True
            self.before, self.after = (
                _point(self.mechanism, point.time, point.state, v, a)
                for point, v, a in zip((self.before, self.after), self.v, self.a, strict=True)
            )
            apart, share = UNKNOWN * np.abs(own).sum(axis=0), 1.0
        else:
            apart, share = np.abs(self.a / self.unit - own).sum(axis=0), QUINTIC
        rounding = ROUNDING * (1.0 + float(np.abs(self.q / self.unit).max()))
        difference = h**2 / 64.0 * float(np.linalg.norm(apart))
        self.blur, self.error = difference + rounding, share * difference + rounding
        return True

    def _prepare(self) -> None:
        """The quintic polynomial through both ends."""
        h, (q0, q1), (v0, v1), (a0, a1) = self.span, self.q, self.v, self.a
        way = q1 - q0 - h * v0 - 0.5 * h**2 * a0
        speed = h * (v1 - v0 - h * a0)
        force = h**2 * (a1 - a0)
        self.coefficients = np.stack(
            [
                q0,
                h * v0,
                0.5 * h**2 * a0,
                10.0 * way - 4.0 * speed + 0.5 * force,
                -15.0 * way + 7.0 * speed - force,
                6.0 * way - 3.0 * speed + 0.5 * force,
            ]
        )

    def _at(self, time: float, start: ClosedState) -> _Point:
        share, powers = (time - self.before.time) / self.span, np.arange(6.0)
        y = self._coordinates(share)
        v = (powers[1:] * share ** powers[:-1]) @ self.coefficients[1:] / self.span
        a = (powers[2:] * powers[1:-1] * share ** powers[:-2]) @ self.coefficients[2:] / self.span**2
        return _point(self.mechanism, time, self.mechanism.follow(start, y), v, a)

    def _search(self, left: _Point, right: _Point, depth: int) -> None:
        """Refine from `left` to `right` until the rates follow from the accelerations."""
        if _unexplained(left, right) <= EXPLAINED * self.rates:
            return
        touched = self._turns_back(left, right) and depth >= COARSE
        if depth == DEEPEST:
            raise self._touched()
        time = 0.5 * (left.time + right.time)
        try:
            middle = self._at(time, left.state)
            arrived = self.mechanism.follow(middle.state, right.state.y)
        except (AssemblyError, SingularityError) as error:
            raise self._met(error, left, right) from None
        if pose_difference(self.mechanism, arrived, right.state) > SAME_POSE:
            raise self._touched()
        self._search(left, middle, depth + 1)
        self._search(middle, right, depth + 1)
        if touched:
            raise self._touched()

    def _turns_back(self, left: _Point, right: _Point) -> bool:
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
            normal = np.linalg.norm(rows[:, -1] @ (state.rows.jacobian[:, self.mechanism.independent] * self.unit))
            way = 0.5 * sigma * abs(rate) * span / float(normal) if normal > 0.0 else np.inf
            smallest, nearness = min(smallest, sigma), min(nearness, way)
        reverses = rates[0] * rates[1] < 0.0 and 2.0 * _unexplained(left, right) >= abs(rates[1] - rates[0])
        return bool(reverses and smallest <= FALLING * self.rates * span and nearness <= self.blur)

    def _note(self, time: float, state: ClosedState, sigma: float) -> None:
        """Keep the pose nearest to a singular one."""
        if self.nearest is None or sigma < self.nearest[0]:
            self.nearest = sigma, time, state

    def _touched(self) -> SingularityError:
        """The error of a motion that comes nearer to a singular pose than its samples tell."""
        assert self.nearest is not None
        sigma, time, state = self.nearest
        singular = self.mechanism.singular(state)
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
        unsure = ", the less since its accelerations do not follow from its rates" if self.guessed else ""
        return SingularityError(
            f"between its samples at {self.before.time:.6g} and {self.after.time:.6g} s the motion touches a singular "
            f"pose of the closure, where assembly modes meet, near {mechanism.pose_text(y)}: smallest singular value "
            f"{sigma:.3g}, {what}; the samples do not tell in which mode the mechanism goes on{unsure}: keep away from "
            "this pose, or end the motion before it",
            rows=self.row,
            margin=sigma,
            time=time,
            kind=kind,
            direction=direction,
            pose=mechanism.pose(y),
            tree_coordinates=q.copy(),
        )
