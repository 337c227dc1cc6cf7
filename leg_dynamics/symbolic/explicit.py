"""Unknowns that need no iteration: each found from one or two rows in which it stands alone.

Many loops come apart into steps with a single unknown: a row A cos + B sin + C = 0 (two solutions, told apart by the
sign of the row's derivative, which is the assembly mode), two rows linear in cosine and sine, a displacement that
enters linearly or by its square. Where a loop has two unknowns in a plane or a rod between two joints, the squared
length of the rod is such a row: it does not contain the rod's own angles.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi
import numpy as np

from leg_dynamics.symbolic.closure import Row
from leg_dynamics.symbolic.coordinates import Form
from leg_dynamics.symbolic.motion import Motion, Orientation, Position
from leg_dynamics.symbolic.scalars import (
    ZERO,
    Scalar,
    Vector,
    add,
    add_vectors,
    dot,
    is_zero,
    mul,
    neg,
    sub,
    sub_vectors,
)

__all__ = ["Explicit", "Step", "find_explicit"]

# A derivative this small relative to its row, in nearly all samples, is no way to solve for the unknown.
SMALLEST_QUALITY = 1e-2
ACCEPTED_SHARE = 0.2
LEFT_ASIDE = 0.02
EXACT = 1e-9
# The guards: relative size of a derivative, and how far cosine and sine may be off the circle.
SMALLEST_DERIVATIVE = 1e-7
CIRCLE = 1e-9


@dataclass(frozen=True)
class _Relation:
    """A scalar condition on u: one component of a vector, or (`component` None) squared length = `squared`."""

    vector: Position
    component: int | None
    scale: float
    squared: float = 0.0


@dataclass(frozen=True)
class Step:
    """How one unknown is found.

    Attributes
    ----------
    unknown : int
        Its index in u.
    form : Form
        The angle solved for, in which the unknown's coefficient is 1; for displacements, the unknown itself.
    relations : tuple of one or two conditions
    turns : bool
        Angle or displacement.
    sign : float
        Of the derivative (or of the pair's determinant) at the seed.
    size : float
        Its typical size.
    near : tuple of float
        Coefficients of u and a constant: the angle is the one nearest to that sum, which counts whole turns.
    """

    unknown: int
    form: Form
    relations: tuple[_Relation, ...]
    turns: bool
    sign: float
    size: float
    near: tuple[float, ...]


@dataclass(frozen=True)
class Explicit:
    """Steps in the order in which they can be taken, one an unknown."""

    n: int
    steps: tuple[Step, ...]

    def solve(self, y: Sequence[Scalar]) -> tuple[Motion, list[Scalar]]:
        """The closed pose at y and its guards, at least 0 where it exists and is regular."""
        u: list[Scalar] = [*y, *([float("nan")] * len(self.steps))]
        known: dict[Form, tuple[Scalar, Scalar]] = {}
        guards: list[Scalar] = []
        for step in self.steps:
            # A motion remembers what it computed from unknowns: each step begins with a new one.
            motion = Motion(u, sincos=dict(known))
            if step.turns:
                self._solve_angle(step, motion, guards, known)
            else:
                self._solve_length(step, motion, guards)
        return Motion(u, sincos=known), guards

    @staticmethod
    def _solve_angle(
        step: Step, motion: Motion, guards: list[Scalar], known: dict[Form, tuple[Scalar, Scalar]]
    ) -> None:
        parts = [_angle_parts(relation, step.form, motion) for relation in step.relations]
        if len(parts) == 2:
            (A, B, C), (D, E, F) = parts
            determinant = sub(mul(A, E), mul(B, D))
            inverse = 1.0 / determinant
            cosine = mul(sub(mul(B, F), mul(C, E)), inverse)
            sine = mul(sub(mul(C, D), mul(A, F)), inverse)
            guards.append(step.sign * determinant - SMALLEST_DERIVATIVE * step.size)
            guards.append(CIRCLE - casadi.fabs(cosine * cosine + sine * sine - 1.0))
        else:
            ((A, B, C),) = parts
            square = add(mul(A, A), mul(B, B))
            inside = sub(square, mul(C, C))
            derivative = mul(step.sign, casadi.sqrt(inside))
            inverse = 1.0 / square
            cosine = mul(sub(mul(B, derivative), mul(A, C)), inverse)
            sine = mul(neg(add(mul(A, derivative), mul(B, C))), inverse)
            guards.append(inside - (SMALLEST_DERIVATIVE * step.size) ** 2)
        known[step.form] = (sine, cosine)
        k = step.unknown
        rest = step.form + Form(((k, -1.0),))
        if rest.terms:
            s0, c0 = motion.sincos(rest)
            difference = (sub(mul(sine, c0), mul(cosine, s0)), add(mul(cosine, c0), mul(sine, s0)))
            known[Form(((k, 1.0),))] = difference
        motion.u[k] = sub(_near(step, motion, sine, cosine), rest.of(motion.u))  # type: ignore[index]

    @staticmethod
    def _solve_length(step: Step, motion: Motion, guards: list[Scalar]) -> None:
        relation, k = step.relations[0], step.unknown
        if relation.component is not None:
            slope, level = _length_parts(relation, k, motion)
            motion.u[k] = neg(level / slope)  # type: ignore[index]
            guards.append(step.sign * slope - SMALLEST_DERIVATIVE * step.size)
            return
        along, squared, level = _squared_length_parts(relation, k, motion)
        inside = sub(mul(along, along), mul(squared, level))
        guards.append(inside - (SMALLEST_DERIVATIVE * step.size) ** 2)
        motion.u[k] = sub(mul(step.sign, casadi.sqrt(inside)), along) / squared  # type: ignore[index]


def _near(step: Step, motion: Motion, s: Scalar, c: Scalar) -> Scalar:
    """The angle of (s, c) that is nearest to the step's linear guess."""
    guess: Scalar = step.near[-1]
    for k, coefficient in enumerate(step.near[:-1]):
        guess = add(guess, mul(coefficient, motion.u[k]))
    if isinstance(guess, float):
        s0, c0 = float(np.sin(guess)), float(np.cos(guess))
    else:
        s0, c0 = casadi.sin(guess), casadi.cos(guess)
    return add(guess, casadi.atan2(sub(mul(s, c0), mul(c, s0)), add(mul(c, c0), mul(s, s0))))


# ---------------------------------------------------------------------------------------------- parts of a condition


def _factors(node: Orientation) -> Iterator[Form]:
    word: Orientation | None = node
    while word is not None:
        if word.axis is not None:
            assert word.form is not None
            yield word.form
        word = word.parent


def _coefficient(form: Form, k: int) -> float:
    return dict(form.terms).get(k, 0.0)


def _split(position: Position, k: int) -> tuple[Position, Position]:
    """Terms without and with u_k."""
    apart = Position(position.size)
    moved = Position(position.size)
    for (node, sliding), vector in position.terms.items():
        depends = sliding == k or any(_coefficient(form, k) for form in _factors(node))
        (moved if depends else apart).terms[node, sliding] = vector
    return apart, moved


def _angle_vectors(position: Position, form: Form, motion: Motion) -> tuple[Vector, Vector, Vector]:
    """(a, b, c) with position = a cos + b sin + c of the angle `form`."""
    k = next(k for k, _ in form.terms if k not in _known(motion))
    apart, moved = _split(position, k)

    def at(sine: float, cosine: float) -> Vector:
        known = {each: value for each, value in motion.known_sincos.items() if not _coefficient(each, k)}
        known[form] = (sine, cosine)
        return Motion(motion.u, sincos=known).position(moved)

    level = at(0.0, 0.0)
    a, b = sub_vectors(at(0.0, 1.0), level), sub_vectors(at(1.0, 0.0), level)
    return a, b, add_vectors(motion.position(apart), level)


def _known(motion: Motion) -> set[int]:
    return {k for k, value in enumerate(motion.u) if not (isinstance(value, float) and math.isnan(value))}


def _angle_parts(relation: _Relation, form: Form, motion: Motion) -> tuple[Scalar, Scalar, Scalar]:
    """(A, B, C) of A cos + B sin + C = 0."""
    a, b, c = _angle_vectors(relation.vector, form, motion)
    if relation.component is not None:
        i = relation.component
        return mul(relation.scale, a[i]), mul(relation.scale, b[i]), mul(relation.scale, c[i])
    # |a cos + b sin|² is constant: a and b are at right angles and of one length.
    factor = relation.scale
    level = sub(add(dot(c, c), dot(a, a)), relation.squared)
    return mul(2.0 * factor, dot(a, c)), mul(2.0 * factor, dot(b, c)), mul(factor, level)


def _length_vectors(position: Position, k: int, motion: Motion) -> tuple[Vector, Vector]:
    """(e, c) with position = e u_k + c."""
    apart, moved = _split(position, k)
    slope: Vector = ZERO
    for (node, _), vector in moved.terms.items():
        slope = add_vectors(slope, motion.arm(node, vector))
    return slope, motion.position(apart)


def _length_parts(relation: _Relation, k: int, motion: Motion) -> tuple[Scalar, Scalar]:
    slope, level = _length_vectors(relation.vector, k, motion)
    assert relation.component is not None
    i = relation.component
    return mul(relation.scale, slope[i]), mul(relation.scale, level[i])


def _squared_length_parts(relation: _Relation, k: int, motion: Motion) -> tuple[Scalar, Scalar, Scalar]:
    """(e . c, e . e, c . c - squared), scaled."""
    slope, level = _length_vectors(relation.vector, k, motion)
    rest = sub(dot(level, level), relation.squared)
    parts = (dot(slope, level), dot(slope, slope), rest)
    return tuple(mul(relation.scale, part) for part in parts)


# ---------------------------------------------------------------------------------------------------------- the search


def _dependence(relations: Sequence[_Relation], n: int, samples: np.ndarray) -> list[set[int]]:
    """Unknowns that each condition depends on, by structure."""
    motion = Motion([samples[:, i] for i in range(samples.shape[1])])
    partials: dict[int, dict[int, Vector]] = {}
    result = []
    for relation in relations:
        key = id(relation.vector)
        if key not in partials:
            partials[key] = motion.partials(relation.vector)
        i = relation.component
        result.append({k for k, column in partials[key].items() if k >= n and (i is None or not is_zero(column[i]))})
    return result


def _rods(rows: Sequence[Row]) -> list[_Relation]:
    """Squared lengths: each vector without its term in one orientation, which is the only one that turns with it."""
    relations = []
    seen: set[int] = set()
    for row in rows:
        if id(row.vector) in seen or ":gap" not in row.name:
            continue
        seen.add(id(row.vector))
        terms = row.vector.terms
        for (node, sliding), vector in terms.items():
            if node.axis is None or sliding is not None or not all(isinstance(x, float) for x in vector):
                continue
            rest = Position(row.vector.size)
            rest.terms.update({key: value for key, value in terms.items() if key != (node, sliding)})
            relations.append(_Relation(rest, None, row.scale**2, float(dot(vector, vector))))
    return relations


def _target(position: Position, k: int) -> Form | None:
    """The angle that stands for u_k in a vector; None where it enters in more than one way."""
    forms: set[Form] = set()
    sliding = False
    for node, slide in position.terms:
        own = [form for form in _factors(node) if _coefficient(form, k)]
        if len(own) > 1:
            return None
        sliding = sliding or slide == k
        forms.update(form if _coefficient(form, k) > 0.0 else form.scaled(-1.0) for form in own)
    if sliding:
        return None if forms else Form(((k, 1.0),))
    if any(_coefficient(form, k) != 1.0 for form in forms):
        return None
    return forms.pop() if len(forms) == 1 else Form(((k, 1.0),))


@dataclass(frozen=True)
class _Option:
    price: float
    quality: float
    step: Step


def _judge(values: np.ndarray, sizes: np.ndarray) -> tuple[float, float, float]:
    """Worst share of its row in the seed's sign, that sign, and the typical size."""
    sign = float(np.sign(values[0]))
    share = np.sort(sign * values / np.where(sizes > 0.0, sizes, 1.0))
    return float(share[int(LEFT_ASIDE * len(share))]), sign, float(np.median(sizes))


def _options(k: int, usable: Sequence[_Relation], motion: Motion, samples: np.ndarray) -> list[_Option]:
    """Ways to find u_k from conditions in which it is the only unknown, with sampled qualities."""
    options: list[_Option] = []
    linear: dict[Form, list[tuple[_Relation, np.ndarray, np.ndarray]]] = {}
    angle = samples[:, k]
    near = (0.0,) * (samples.shape[1] + 1)
    for relation in usable:
        form = _target(relation.vector, k)
        if form is None:
            continue
        turns = not any(slide == k for _, slide in relation.vector.terms)
        price = float(relation.vector.cost)
        if not turns:
            if relation.component is not None:
                slope = np.broadcast_to(np.asarray(_length_parts(relation, k, motion)[0]), angle.shape)
                quality, sign, size = _judge(slope, np.full(angle.shape, relation.scale))
            else:
                along, squared, _ = _squared_length_parts(relation, k, motion)
                values = np.broadcast_to(np.asarray(along + squared * angle), angle.shape)
                quality, sign, size = _judge(values, np.full(angle.shape, relation.scale**0.5))
                price += 8.0
            options.append(_Option(price, quality, Step(k, form, (relation,), False, sign, size, near)))
            continue
        A, B, C = (
            np.broadcast_to(np.asarray(x, dtype=float), angle.shape) for x in _angle_parts(relation, form, motion)
        )
        total = form.of([samples[:, i] for i in range(samples.shape[1])])
        if not np.abs(A * np.cos(total) + B * np.sin(total) + C).max() < EXACT:
            continue
        size_of = np.hypot(A, B)
        quality, sign, size = _judge(B * np.cos(total) - A * np.sin(total), size_of)
        options.append(_Option(price + 8.0, quality, Step(k, form, (relation,), True, sign, size, near)))
        if relation.component is not None:
            linear.setdefault(form, []).append((relation, A, B))
    for form, rows in linear.items():
        for (one, A, B), (other, D, E) in itertools.combinations(rows, 2):
            sizes = np.hypot(A, B) * np.hypot(D, E)
            quality, sign, size = _judge(A * E - B * D, sizes)
            shared = 0.0 if one.vector is other.vector else other.vector.cost
            step = Step(k, form, (one, other), True, sign, size, near)
            options.append(_Option(one.vector.cost + shared, quality, step))
    return options


def find_explicit(rows: Sequence[Row], n: int, samples: np.ndarray) -> Explicit | None:
    """Steps that find all unknowns one by one; None where some need iteration.

    Parameters
    ----------
    rows : sequence of Row
        Candidates.
    n : int
        Number of independent coordinates.
    samples : (S, nu) array
        Closed states of the assembly mode, the seed first.
    """
    size = samples.shape[1]
    relations = [_Relation(row.vector, row.component, row.scale) for row in rows]
    relations += _rods(rows)
    depends = _dependence(relations, n, samples[:2])
    known: set[int] = set()
    steps: list[Step] = []
    while len(known) < size - n:
        best: _Option | None = None
        for k in range(n, size):
            if k in known:
                continue
            u = [samples[:, i] if i < n or i in known else float("nan") for i in range(size)]
            motion = Motion(u)
            usable = [r for r, found in zip(relations, depends, strict=True) if k in found and found <= known | {k}]
            options = _options(k, usable, motion, samples)
            top = max((option.quality for option in options), default=0.0)
            for option in options:
                if option.quality < max(SMALLEST_QUALITY, ACCEPTED_SHARE * top):
                    continue
                if best is None or option.price < best.price:
                    best = option
        if best is None:
            return None
        step = best.step
        if step.turns:
            near = _guess(samples, n, step.form, step.unknown)
            step = Step(step.unknown, step.form, step.relations, True, step.sign, step.size, near)
        steps.append(step)
        known.add(step.unknown)
    return Explicit(n, tuple(steps))


def _guess(samples: np.ndarray, n: int, form: Form, k: int) -> tuple[float, ...]:
    """Coefficients of u and a constant whose sum stays within half a turn of the form on all samples.

    Tried are a constant angle, a constant unknown, and fits to y; where none will do the best is taken, and the unknown
    may come out whole turns away.
    """
    size = samples.shape[1]
    angle = np.asarray(form.of([samples[:, i] for i in range(size)]))
    basis = np.column_stack([samples[:, :n], np.ones(len(samples))])
    fit, *_ = np.linalg.lstsq(basis, angle, rcond=None)
    rest = np.zeros(size)
    for other, coefficient in form.terms:
        rest[other] = 0.0 if other == k else coefficient
    candidates = [
        np.zeros(size),
        rest,
        np.r_[np.round(fit[:-1]), np.zeros(size - n)],
        np.r_[fit[:-1], np.zeros(size - n)],
    ]
    best: tuple[float, ...] = ()
    least = np.inf
    for coefficients in candidates:
        left = angle - samples @ coefficients
        middle = float(0.5 * (left.min() + left.max()))
        reach = float(np.abs(left - middle).max())
        if reach < min(least, 0.9 * np.pi):
            return (*(float(x) for x in coefficients), middle)
        if reach < least:
            least, best = reach, (*(float(x) for x in coefficients), middle)
    return best
