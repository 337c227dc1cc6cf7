"""Indices of many designs at once, as section 4 defines them: workspace, L, Z, and dexterity by both Jacobians.

Poses are sampled over the angles and the length of strut 1, dV = l1² cos(beta) d alpha d beta d l1, by several
independently scrambled Sobol sequences whose spread is the uncertainty. Lengths and angles are those of the corrected
formulas on arrays; nothing is shared with the workspace of `analysis`, which samples the lengths of all struts and
reads the constraints from the file. The two are held against each other (`CHECKS`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from leg_dynamics.papers.framework import Check, Context
from leg_dynamics.papers.hexapod_leg import printed, reported
from leg_dynamics.papers.hexapod_leg.facts import preliminary, workspace_of
from leg_dynamics.papers.mechanism import array

if TYPE_CHECKING:
    from leg_dynamics.leg import Leg

__all__ = [
    "CHECKS",
    "LENGTH_NOISE",
    "Design",
    "Indices",
    "MonteCarlo",
    "Steps",
    "Sweep",
    "condition_numbers",
    "design_of",
    "dexterity_sensitivity",
    "exact_jacobian",
    "measure",
    "median_interval",
    "monte_carlo",
    "poses_at",
    "printed_jacobian",
    "sensitivity_noise",
    "step_sensitivity",
    "steps",
    "sweep",
    "vectors",
]

Array = np.ndarray

REPLICATES = 8
SAMPLES = 1 << 12
"""Of each replicate."""

FEW = 1 << 9
"""Of each replicate, for each of many designs."""

LENGTH_NOISE = 2e-5
"""m; ends of L and Z are interpolated between poses a tenth of a millimetre apart."""

STEP_POINTS = 361
SWING_POINTS = 241
DIVISIONS = 33

DESIGNS = 6000
"""Of the Monte Carlo method here."""


@dataclass(frozen=True)
class Design:
    """Parameters of one leg, or of several: numbers, or arrays that broadcast. m and rad."""

    a: Any
    b: Any
    c: Any
    e: Any
    l1_min: Any
    l1_max: Any
    l2_min: Any
    l2_max: Any
    l3_min: Any
    l3_max: Any
    universal_range: Any
    ball_range: Any

    @property
    def h(self) -> Any:
        """Height of the initial pose: the middle of the range of strut 1."""
        return 0.5 * (self.l1_min + self.l1_max)

    @property
    def limits(self) -> tuple[tuple[Any, Any], ...]:
        """Least and greatest length of each strut."""
        return (self.l1_min, self.l1_max), (self.l2_min, self.l2_max), (self.l3_min, self.l3_max)


def design_of(leg: Leg) -> Design:
    """The parameters that a leg's file was made with."""
    values = {each.name: leg.parameters[each.name].value for each in fields(Design)}
    return Design(**values | {name: math.radians(values[name]) for name in ("universal_range", "ball_range")})


class Poses(NamedTuple):
    """Constraints at foot positions: margins of the struts' lengths (m) and of the passive angles (rad)."""

    lengths: tuple[Array, Array, Array]
    angles: Array

    def feasible(self) -> Array:
        """Whether all hold."""
        first, second, third = self.lengths
        return (first >= 0.0) & (second >= 0.0) & (third >= 0.0) & (self.angles >= 0.0)

    def swing_margin(self) -> Array:
        """The smallest margin but that of strut 1; m and rad mixed, for its sign and zero only."""
        return np.minimum(np.minimum(self.lengths[1], self.lengths[2]), self.angles)


def _leg(context: Context, design: Design) -> Any:
    return replace(context.numbers, a=design.a, b=design.b, c=design.c, e=design.e)


def poses_at(context: Context, design: Design, p: tuple[Any, Any, Any]) -> Poses:
    """Margins of the constraints (26), (27) and (28) with the foot at p, components that broadcast."""
    f, leg = context.formulas, _leg(context, design)
    alpha, beta = f.platform_angles(p)
    _, pv, w = zip(*f.platform_rotation(alpha, beta), strict=True)
    first, second, third = f.strut_vectors(leg, p)
    lengths = [np.sqrt(sum(x * x for x in vector)) for vector in (first, second, third)]
    margins = tuple(
        np.minimum(length - least, most - length) for length, (least, most) in zip(lengths, design.limits, strict=True)
    )
    # Strut 2 turns by alpha as well: across it are only u and w.
    beta_2 = np.arcsin(second[0] / lengths[1])
    alpha_3, beta_3 = np.arctan2(-third[1], third[2]), np.arcsin(third[0] / lengths[2])
    turned = functools.reduce(np.maximum, [np.abs(angle) for angle in (alpha, beta, beta_2, alpha_3, beta_3)])
    offset, h = float(leg.side) * (design.c - design.a), design.h
    seat = [(offset * pv[k] + h * w[k]) / np.sqrt(offset * offset + h * h) for k in range(3)]
    cosine = sum(seat[k] * third[k] for k in range(3)) / lengths[2]
    ball = design.ball_range - np.arccos(np.clip(cosine, -1.0, 1.0))
    return Poses(margins, np.minimum(design.universal_range - turned, ball))


def exact_jacobian(context: Context, leg: Any, p: Array) -> Array:
    """The corrected matrix of (24) at foot positions (N, 3), as (N, 3, 3)."""
    return array(context.formulas.inverse_jacobian(leg, tuple(p.T)), (len(p),))


def vectors(leg: Any, p: Array) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """l1, w1, w2, w3, b, c and R of one leg with its foot at p (N, 3): what (24) is made of."""
    l1 = np.linalg.norm(p, axis=-1)
    w1 = p / l1[:, None]
    alpha, beta = np.arctan2(-w1[:, 1], w1[:, 2]), np.arcsin(w1[:, 0])
    zero = np.zeros_like(alpha)
    pv = np.stack([zero, np.cos(alpha), np.sin(alpha)], axis=-1)
    u = np.stack([np.cos(beta), np.sin(alpha) * np.sin(beta), -np.cos(alpha) * np.sin(beta)], axis=-1)
    R = np.stack([u, pv, w1], axis=-1)
    a, side = float(leg.a), float(leg.side)
    b, c = float(leg.b) * u, side * float(leg.c) * pv
    second = float(leg.e) * w1 + b - np.array([a, 0.0, 0.0])
    third = p + c - np.array([0.0, side * a, 0.0])
    w2, w3 = (x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (second, third))
    return l1, w1, w2, w3, b, c, R


def printed_jacobian(leg: Any, p: Array) -> Array:
    """The matrix that (24) prints, at foot positions (N, 3), as (N, 3, 3)."""
    l1, w1, w2, w3, b, c, _ = vectors(leg, p)
    return printed.jacobian(l1, w1, w2, w3, b, c)


def spinless_jacobian(leg: Any, p: Array) -> Array:
    """(24) with the term of e put back, and without the spin: what follows from (20) and (21)."""
    l1, w1, w2, w3, b, c, _ = vectors(leg, p)
    J = np.array(printed.jacobian(l1, w1, w2, w3, b, c))
    J[:, 1] += printed.times(float(leg.e) / l1, w2 - printed.times(printed.dot(w1, w2), w1))
    return J


def condition_of(context: Context, J: Array) -> Array:
    """Condition numbers of matrices (N, 3, 3)."""
    rows = tuple(tuple(row) for row in np.moveaxis(J, 0, -1))
    k: Array = np.asarray(context.formulas.condition_number(rows))
    return k


# ---------------------------------------------------------------------- volume and dexterity of one design


class Estimate(NamedTuple):
    """A mean of independent estimates, and the half width of its 99 % interval."""

    value: float
    half_width: float


class Indices(NamedTuple):
    """Volume (m³) and condition numbers of one design by one Jacobian."""

    volume: Estimate
    mean: Estimate
    deviation: Estimate
    smallest: float


def _estimate(values: Array) -> Estimate:
    from scipy.stats import t

    factor = float(t.ppf(0.995, len(values) - 1)) / math.sqrt(len(values))
    return Estimate(float(values.mean()), factor * float(values.std(ddof=1)))


def _unit_points(context: Context, replicate: int, count: int) -> Array:
    from scipy.stats import qmc

    generator = np.random.default_rng([context.seed, 100 + replicate])
    points: Array = qmc.Sobol(3, scramble=True, seed=generator).random(count)
    return points


class _Cloud(NamedTuple):
    p: Array
    """Feasible foot positions (N, 3) m of all replicates."""
    volume: Array
    """That each stands for among the samples of its replicate, (N,) m³."""
    replicate: Array
    """(N,)."""


def _cloud(context: Context, design: Design, count: int) -> _Cloud:
    unit = context.once(
        f"hexapod: {count} points",
        lambda: np.concatenate([_unit_points(context, k, count) for k in range(REPLICATES)]),
    )
    f = context.formulas
    limit, low, high = design.universal_range, design.l1_min, design.l1_max
    alpha, beta = ((2.0 * unit[:, k] - 1.0) * limit for k in (0, 1))
    l1 = low + unit[:, 2] * (high - low)
    w = array(f.platform_rotation(alpha, beta), (len(unit),))[..., 2]
    p = l1[:, None] * w
    inside = poses_at(context, design, tuple(p.T)).feasible()
    volume = l1**2 * np.cos(beta) * (2.0 * limit) ** 2 * (high - low) / count
    return _Cloud(p[inside], volume[inside], np.repeat(np.arange(REPLICATES), count)[inside])


JACOBIANS: Mapping[str, Callable[[Context, Any, Array], Array]] = {
    "exact": exact_jacobian,
    "without spin": lambda context, leg, p: spinless_jacobian(leg, p),
    "printed": lambda context, leg, p: printed_jacobian(leg, p),
}


def condition_numbers(
    context: Context, design: Design, which: str = "exact", count: int = SAMPLES
) -> tuple[Array, Array]:
    """Condition numbers of the feasible samples, and the volume (m³) that each stands for."""
    cloud = context.once(f"hexapod: cloud {design} {count}", lambda: _cloud(context, design, count))
    k = condition_of(context, JACOBIANS[which](context, _leg(context, design), cloud.p))
    return k, cloud.volume / REPLICATES


def measure(context: Context, design: Design, which: str = "exact", count: int = SAMPLES) -> Indices:
    """Volume, mean condition number, its deviation and its least value, by one of `JACOBIANS`."""

    def compute() -> Indices:
        k, weight = condition_numbers(context, design, which, count)
        owner = context.once(f"hexapod: cloud {design} {count}", lambda: _cloud(context, design, count)).replicate
        sums = np.stack(
            [np.bincount(owner, REPLICATES * weight * power, REPLICATES) for power in (1.0, k, k * k)], axis=-1
        )
        if not np.all(sums[:, 0] > 0.0):
            nothing = Estimate(math.nan, math.nan)
            return Indices(Estimate(float(sums[:, 0].mean()), math.nan), nothing, nothing, math.nan)
        means = sums[:, 1] / sums[:, 0]
        spreads = np.sqrt(np.maximum(sums[:, 2] / sums[:, 0] - means**2, 0.0))
        volume, mean, deviation = _estimate(sums[:, 0]), _estimate(means), _estimate(spreads)
        total = sums.sum(axis=0)
        whole = total[1] / total[0]
        return Indices(
            volume,
            Estimate(float(whole), mean.half_width),
            Estimate(math.sqrt(max(total[2] / total[0] - whole**2, 0.0)), deviation.half_width),
            float(k.min()),
        )

    result: Indices = context.once(f"hexapod: {which} indices of {design} {count}", compute)
    return result


# ---------------------------------------------------------------------- L and Z


class Steps(NamedTuple):
    """Step length L and heights Z ahead and behind, m; 0 where the initial pose itself is not feasible."""

    length: Array
    front: Array
    back: Array


def _interpolated(margin: Array, along: Array) -> Array:
    """Where margins (..., M) first turn negative along (..., M), interpolated; the end where they never do."""
    along = np.broadcast_to(along, margin.shape)
    k = _first_negative(margin)
    inner = np.clip(k, 1, margin.shape[-1] - 1)

    def taken(values: Array, index: Array) -> Array:
        found: Array = np.take_along_axis(values, index[..., None], -1)[..., 0]
        return found

    before, after = taken(margin, inner - 1), taken(margin, inner)
    share = np.where(before > after, before / np.where(before > after, before - after, 1.0), 0.0)
    start = taken(along, inner - 1)
    found = start + np.clip(share, 0.0, 1.0) * (taken(along, inner) - start)
    return np.where(k == 0, along[..., 0], np.where(k == margin.shape[-1], along[..., -1], found))


def _first_negative(margin: Array) -> Array:
    """Index of the first negative margin (..., M); M where there is none."""
    negative = margin < 0.0
    return np.where(negative.any(axis=-1), negative.argmax(axis=-1), margin.shape[-1])


def _first_zero(margin: Callable[[Array], Array], along: Array) -> Array:
    """Where a margin, (M,) or (D, M) to (D, M), first turns negative along (M,); the end where it never does.

    The interval of the first change is divided again, because the least of several margins has kinks there.
    """
    coarse = margin(along)
    inner = np.clip(_first_negative(coarse), 1, len(along) - 1)
    low, high = along[inner - 1], along[inner]
    fine = low[..., None] + (high - low)[..., None] * np.linspace(0.0, 1.0, DIVISIONS)
    found = _interpolated(margin(fine), fine)
    # Rounding: the margin at the ends of the interval is that of the coarse points.
    return np.where(coarse[..., 0] < 0.0, along[0], np.where((coarse >= 0.0).all(axis=-1), along[-1], found))


def steps(context: Context, design: Design) -> Steps:
    """L and Z in the plane y = 0; parameters of several designs are arrays (D,).

    L is the length of the chord of feasible positions at z = h through the initial one. Z is h less the least z at the
    extreme swing ahead and behind: with strut 1 as short as its and strut 3's limits allow, which at alpha = 0 are
    l3² = l1² + (a - c)².
    """
    columns = replace(
        design,
        **{each.name: np.asarray(getattr(design, each.name), dtype=float).reshape(-1, 1) for each in fields(design)},
    )
    reach = np.linspace(0.0, 1.0, STEP_POINTS)
    ends, lifts = [], []
    h = columns.h
    short = np.sqrt(np.maximum(columns.l1_min**2, columns.l3_min**2 - (columns.a - columns.c) ** 2))
    swing = np.linspace(0.0, 0.5 * math.pi - 1e-6, SWING_POINTS)
    for side in (1.0, -1.0):

        def stepping(x: Array, side: float = side) -> Array:
            at = poses_at(context, columns, (side * x + 0.0 * h, 0.0 * x + 0.0 * h, h + 0.0 * x))
            return np.minimum(at.swing_margin(), at.lengths[0])

        def lifting(angle: Array, side: float = side) -> Array:
            foot = (side * short * np.sin(angle), 0.0 * short * angle, short * np.cos(angle))
            return poses_at(context, columns, foot).swing_margin()

        ends.append(_first_zero(stepping, reach))
        lifts.append(h[:, 0] - short[:, 0] * np.cos(_first_zero(lifting, swing)))
    home = poses_at(context, columns, (0.0 * h, 0.0 * h, h)).feasible()[:, 0]
    length, front, back = (np.where(home, each, 0.0) for each in (ends[0] + ends[1], *lifts))
    if np.ndim(design.a) == 0 and all(np.ndim(getattr(design, each.name)) == 0 for each in fields(design)):
        length, front, back = length[0], front[0], back[0]
    return Steps(length, front, back)


# ---------------------------------------------------------------------- one parameter at a time


class Sweep(NamedTuple):
    """One parameter moved, the others those of the preliminary design."""

    name: str
    values: Array
    """(M,) m."""
    steps: Steps
    exact: tuple[Indices, ...]
    printed: tuple[Indices, ...]


SWEEPS: Mapping[str, tuple[float, float]] = {
    "a": reported.PRIMARY_RANGES["a"],
    "b": reported.PRIMARY_RANGES["b"],
    "c": reported.PRIMARY_RANGES["b"],
    "l2_min": reported.PRIMARY_RANGES["l2_min"],
    "l2_max": reported.PRIMARY_RANGES["l2_max"],
}
"""The ranges of section 6.1; for c, of which none is given, that of b."""

POINTS = 13


def sweep(context: Context, name: str) -> Sweep:
    """L, Z and dexterity along one parameter."""

    def compute() -> Sweep:
        base = design_of(preliminary(context))
        values = np.linspace(*SWEEPS[name], POINTS)
        found = steps(context, replace(base, **{name: values}))
        # Where the initial pose is not feasible there is no step; the paper's curves start above.
        values = values[found.length > 0.0]
        found = steps(context, replace(base, **{name: values}))
        designs = [replace(base, **{name: float(value)}) for value in values]
        exact, as_printed = (
            tuple(measure(context, design, which, 2 * FEW) for design in designs) for which in ("exact", "printed")
        )
        return Sweep(name, values, found, exact, as_printed)

    result: Sweep = context.once(f"hexapod: sweep of {name}", compute)
    return result


def steps_with_b_away(context: Context, name: str) -> Steps:
    """L and Z along one parameter for b pointing away from A2, wherever the initial pose is feasible."""
    values = np.linspace(*SWEEPS[name], POINTS)
    base = replace(design_of(preliminary(context)), b=-reported.PRELIMINARY["b"])
    found = steps(context, replace(base, **{name: -values if name == "b" else values}))
    feasible = found.length > 0.0
    return Steps(*(each[feasible] for each in found))


STEP = 0.01
"""m; by which one length is moved."""

TURN = math.radians(5.0)
"""rad; by which an angle's range is moved."""


def _moved(design: Design, names: Iterable[str]) -> dict[str, tuple[Design, Design]]:
    size = {name: TURN if name.endswith("range") else STEP for name in names}

    def moved(name: str, by: float) -> Design:
        return replace(design, **{name: getattr(design, name) + by})

    return {name: (moved(name, by), moved(name, -by)) for name, by in size.items()}


def step_sensitivity(context: Context) -> dict[str, float]:
    """Largest change of L, Z_f or Z_b with each parameter moved either way, m; h follows the range of strut 1."""

    def compute() -> dict[str, float]:
        base = design_of(preliminary(context))
        there = np.array(steps(context, base))
        return {
            name: float(max(np.abs(np.array(steps(context, each)) - there).max() for each in pair))
            for name, pair in _moved(base, [each.name for each in fields(Design)]).items()
        }

    found: dict[str, float] = context.once("hexapod: sensitivity of steps", compute)
    return found


def sensitivity_noise(context: Context) -> float:
    """What counts as a change of dexterity: twice the uncertainty of the preliminary design's, relative."""
    base = measure(context, design_of(preliminary(context)))
    return 2.0 * max(base.mean.half_width / base.mean.value, base.deviation.half_width / base.deviation.value)


def dexterity_sensitivity(context: Context) -> dict[str, float]:
    """Largest relative change of the mean or deviation of k with each limit of a length moved by 50 mm."""

    def compute() -> dict[str, float]:
        base = design_of(preliminary(context))
        there = measure(context, base)
        changes = {}
        for name in ("l1_min", "l2_min", "l3_min", "l1_max", "l2_max", "l3_max"):
            moved = [
                measure(context, replace(base, **{name: getattr(base, name) + by})) for by in (-5.0 * STEP, 5.0 * STEP)
            ]
            changes[name] = max(
                max(
                    abs(each.mean.value / there.mean.value - 1.0),
                    abs(each.deviation.value / there.deviation.value - 1.0),
                )
                for each in moved
            )
        return changes

    found: dict[str, float] = context.once("hexapod: sensitivity of dexterity", compute)
    return found


# ---------------------------------------------------------------------- Monte Carlo


class MonteCarlo(NamedTuple):
    """Random designs in the box of section 6.1; secondary parameters are those of section 4.1."""

    names: tuple[str, ...]
    values: Array
    """(D, 4) m."""
    steps: Steps
    volume: Array
    mean: Array
    deviation: Array

    @property
    def far_enough(self) -> Array:
        """Whether L and Z reach the paper's thresholds, Z behind."""
        return (self.steps.length >= reported.ACCEPTED["L"]) & (self.steps.back >= reported.ACCEPTED["Z"])

    @property
    def counted(self) -> Array:
        """Whether the design has a workspace from which a mean can be taken."""
        return np.isfinite(self.mean)


LEAST_POSES = 30
"""Feasible samples below which a design's mean condition number is not taken."""


def _averages(context: Context, design: Design, unit: Array) -> tuple[Array, Array, Array]:
    """Volume, mean and deviation of k of designs (D, 1) over the same points of the unit cube (M, 3)."""
    f = context.formulas
    limit, low, high = design.universal_range, design.l1_min, design.l1_max
    alpha, beta = ((2.0 * unit[:, k] - 1.0) * limit for k in (0, 1))
    l1 = low + unit[:, 2] * (high - low)
    (_, _, x), (_, _, y), (_, _, z) = f.platform_rotation(alpha, beta)
    p = (l1 * x, l1 * y, l1 * z)
    inside = poses_at(context, design, tuple(each[None] for each in p)).feasible()
    rows, columns = np.nonzero(inside)
    volume = l1**2 * np.cos(beta) * (2.0 * limit) ** 2 * (high - low) / len(unit)
    one = replace(
        design,
        **{
            each.name: np.broadcast_to(getattr(design, each.name), (len(inside), 1))[rows, 0] for each in fields(design)
        },
    )
    J = f.inverse_jacobian(_leg(context, one), tuple(each[columns] for each in p))
    k = np.asarray(f.condition_number(J))
    sums = np.stack([np.bincount(rows, volume[columns] * power, len(inside)) for power in (1.0, k, k * k)], axis=-1)
    enough = np.bincount(rows, minlength=len(inside)) >= LEAST_POSES
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(enough, sums[:, 1] / sums[:, 0], np.nan)
        deviation = np.sqrt(np.where(enough, sums[:, 2] / sums[:, 0] - mean**2, np.nan))
    return sums[:, 0], mean, deviation


def monte_carlo(context: Context) -> MonteCarlo:
    """Indices of random designs."""

    def compute() -> MonteCarlo:
        names = tuple(reported.PRIMARY_RANGES)
        low, high = np.array([reported.PRIMARY_RANGES[name] for name in names]).T
        values = low + context.rng(40).random((DESIGNS, len(names))) * (high - low)
        base = design_of(preliminary(context))
        unit = _unit_points(context, 0, 2 * FEW)
        parts, lengths = [], []
        for start in range(0, DESIGNS, 100):
            rows = values[start : start + 100]
            some = replace(base, **{name: rows[:, k] for k, name in enumerate(names)})
            lengths.append(np.array(steps(context, some)))
            columns = replace(base, **{name: rows[:, k, None] for k, name in enumerate(names)})
            parts.append(np.array(_averages(context, columns, unit)))
        volume, mean, deviation = np.concatenate(parts, axis=1)
        return MonteCarlo(names, values, Steps(*np.concatenate(lengths, axis=1)), volume, mean, deviation)

    result: MonteCarlo = context.once("hexapod: Monte Carlo", compute)
    return result


def median_interval(values: Array) -> tuple[float, float, float]:
    """Median and its distribution-free 95 % interval, from the order of the values."""
    from scipy.stats import binom

    ordered = np.sort(values)
    low, high = (int(binom.ppf(share, len(ordered), 0.5)) for share in (0.025, 0.975))
    return float(np.median(ordered)), float(ordered[max(low - 1, 0)]), float(ordered[min(high, len(ordered) - 1)])


# ---------------------------------------------------------------------- what must hold


def _both(context: Context) -> Iterable[Leg]:
    return preliminary(context), context.leg


def volume_agrees(context: Context) -> Check:
    """Volume against the workspace of the analysis room."""
    worst = 0.0
    for leg in _both(context):
        here, there = measure(context, design_of(leg)).volume, workspace_of(context, leg).volume
        worst = max(worst, abs(here.value - there.value) / (here.half_width + there.half_width))
    return Check(
        "volume of the workspace, two ways",
        worst,
        1.0,
        "of the two 99 % intervals",
        "samples over α, β, l₁ with the paper's constraints against samples over l₁, l₂, l₃ with the file's; both "
        "designs",
    )


def dexterity_agrees(context: Context) -> Check:
    """Mean and deviation of k against the workspace of the analysis room."""
    worst = 0.0
    for leg in _both(context):
        here, there = measure(context, design_of(leg)), workspace_of(context, leg)
        for one, other in ((here.mean, there.mean), (here.deviation, there.deviation)):
            worst = max(worst, abs(one.value - other.value) / (one.half_width + other.half_width))
    return Check(
        "k̄ and k̃, two ways",
        worst,
        1.0,
        "of the two 99 % intervals",
        "the same samples; condition numbers twice as well",
    )


def steps_agree(context: Context) -> Check:
    """L and Z against the workspace of the analysis room."""
    worst = 0.0
    for leg in _both(context):
        here, there = steps(context, design_of(leg)), workspace_of(context, leg).step
        assert there is not None
        worst = max(worst, float(np.abs(np.array(here) - [there.length, there.front, there.back]).max()))
    return Check("L, Z_f and Z_b, two ways", worst, LENGTH_NOISE, "m", "interpolation against bisection; both designs")


CHECKS: tuple[Callable[[Context], Check], ...] = (volume_agrees, dexterity_agrees, steps_agree)
