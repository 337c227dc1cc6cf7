"""Singular poses of any leg: which kind, how near, and where the first ones lie on a line.

For a leg of closed loops three matrices can lose rank (Gosselin and Angeles 1990; Zlatanov et al. 1995): the foot
Jacobian, the loop rows' columns of the joints that no actuator holds, and the loop rows themselves. All three come from
the interface and the mechanism's description, for every route alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.analysis.arguments import having, number, reals
from leg_dynamics.analysis.dexterity import column_scales, conditioning, home_length
from leg_dynamics.analysis.loop_rows import LoopRows, loop_rows
from leg_dynamics.errors import AssemblyError, NonFiniteError, ParameterError, RowError, ShapeError, SingularityError

if TYPE_CHECKING:
    from leg_dynamics.leg import Leg

__all__ = ["Singularity", "SingularityDistance", "singularity", "singularity_distance"]

SINGULAR = 1e-6
"""A singular value below this share of the largest counts as zero: the pose is singular."""

# Neighbours of home, rad or characteristic lengths, at which the foot's usual freedom is looked for.
_RANK_POSES, _SPREAD = 6, 0.1
_SHOWN = 0.05
"""Entries of a direction below that share of the largest are not named."""

_FALLEN = 0.05
"""Of a singular value at the start: what is left of it at a singularity of its kind, within the bisection's reach."""

_NEAR = 1e-2
"""A pose that a route without words for it refuses is near a singular one if a share is below this."""

_SCAN = 256
"""Steps in which a line is searched for the first singularity on it."""


@dataclass(frozen=True)
class Singularity:
    """How far one pose is from each kind of singularity.

    Attributes
    ----------
    kinds : tuple of str
        Those that the pose is in: ``serial`` (the foot Jacobian by the independent coordinates loses rank: the foot
        cannot move in some direction), ``parallel`` (with the actuators locked the closed loops can still move: the
        loop rows' columns of all joints that are not actuated lose rank), ``constraint`` (the loop rows themselves have
        a smaller rank than at most poses: the mechanism gains a motion). A pose so near to a singular one that the
        leg's methods refuse it counts as that; there it may also be ``coordinates`` (the closed loops are regular, but
        the independent coordinates do not determine the others). Empty at a regular pose.
    serial, parallel, constraint : float
        Smallest singular value that must not vanish, as a share of the largest of its matrix; 1 where there is nothing
        that could lose rank (no foot, no loops). NaN for `serial` where the loops' singularity leaves no Jacobian.
    sign : int
        Of det J (three coordinates; else +1): it changes at a serial or a parallel singularity.
    characteristic_length : float
        m; what makes rows and columns of both matrices comparable.
    directions : mapping of str to mapping of str to float
        For each kind what its smallest singular value belongs to, the largest entry 1: ``serial`` the direction x, y, z
        in the hip frame that the foot moves in least; ``parallel`` the rates of the tree's joints that the locked
        actuators resist least; ``constraint`` those that the mechanism gains, ``coordinates`` those that the
        independent coordinates leave open. In rad and characteristic lengths.
    """

    kinds: tuple[str, ...]
    serial: float
    parallel: float
    constraint: float
    sign: int
    characteristic_length: float
    directions: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON-ready values; a NaN as None."""
        values = {name: getattr(self, name) for name in ("serial", "parallel", "constraint")}
        return {
            "kinds": list(self.kinds),
            **{name: value if math.isfinite(value) else None for name, value in values.items()},
            "sign": self.sign,
            "characteristic_length": self.characteristic_length,
            "directions": {kind: dict(direction) for kind, direction in self.directions.items()},
        }

    def __str__(self) -> str:
        if not self.kinds:
            return f"regular: serial {self.serial:.3g}, parallel {self.parallel:.3g}, constraint {self.constraint:.3g}"
        meanings = {
            "serial": "the foot cannot move along",
            "parallel": "with the actuators locked can still move",
            "constraint": "the mechanism gains the motion",
            "coordinates": "the independent coordinates leave open the motion",
        }
        parts = []
        for kind in self.kinds:
            moving = ", ".join(f"{name} {x:+.3g}" for name, x in self.directions[kind].items() if abs(x) >= _SHOWN)
            parts.append(f"{kind} singularity: {meanings[kind]} ({moving})")
        return "; ".join(parts)


@dataclass(frozen=True)
class SingularityDistance:
    """Where the first singularities lie on a line of independent coordinates through a pose.

    Attributes
    ----------
    ahead, behind : float
        Distance along the direction, positive, and against it, negative, in units of the direction vector; infinite
        where none was found within the search.
    kind_ahead, kind_behind : str
        ``serial``, ``parallel`` or ``constraint``, as for `Singularity`, ``assembly`` (the loops cannot be closed
        beyond, and none of the three is near) or ``none``.
    searched : float
        How far was looked, both ways.
    """

    ahead: float
    behind: float
    kind_ahead: str
    kind_behind: str
    searched: float

    @property
    def margin(self) -> float:
        """The nearer of the two, with its sign."""
        return self.ahead if self.ahead <= -self.behind else self.behind


def singularity(leg: Leg, q: ArrayLike, *, characteristic_length: float | None = None) -> Singularity:
    """Which singularities a pose is in, and how far from each kind it is.

    Parameters
    ----------
    leg : Leg
    q : (n,) array_like
        Independent coordinates, rad or m.
    characteristic_length : float, optional
        m; by default the distance from the hip to the foot in the home pose.

    Returns
    -------
    Singularity

    Raises
    ------
    AssemblyError, SingularityError
        The loops do not close there. (Of a leg by formulas also: its formulas do not hold there.)
    ShapeError, NonFiniteError
        `q` is not one finite sample; `leg` is no leg.
    """
    having("leg", leg, ("foot", "jacobian", "assemble", "description"), "give what leg_dynamics.load returns")
    has_foot = leg.foot is not None
    if has_foot:
        column_scales(leg, characteristic_length)
        length = home_length(leg) if characteristic_length is None else float(characteristic_length)
    else:
        length = 1.0 if characteristic_length is None else _positive(characteristic_length)
    tree, refused = _assembled(leg, q)
    directions: dict[str, Mapping[str, float]] = {}
    serial, sign = 1.0, 1
    if has_foot:
        J = leg.jacobian(q, on_error="nan")
        if np.isfinite(J).all():
            turning = np.array([unit == "rad" for unit in leg.units.joints])
            scale = np.where(turning, 1.0 / length, 1.0)
            left, sigma, _ = np.linalg.svd(J * scale)
            usual, rank = _usual_foot_motion(leg, scale, sigma)
            # With one coordinate nothing else tells what is small: home does.
            serial = _share(sigma, rank, usual if len(sigma) == 1 else 0.0)
            directions["serial"] = _direction(("x", "y", "z"), left[:, rank - 1])
            sign = int(np.sign(np.linalg.det(J))) if J.shape == (3, 3) else 1
        else:
            serial, sign = math.nan, 0
    rows = loop_rows(leg.description, tree, length)
    parallel = constraint = 1.0
    if rows.matrix.size:
        idle = len(leg.joint_names) - leg.actuation.rank
        free = [k for k, name in enumerate(rows.joints) if name not in leg.backend.actuator_joints]
        everything = list(range(len(rows.joints)))
        constraint, directions["constraint"] = _weakest(rows, everything, len(everything) - len(leg.joint_names))
        parallel, directions["parallel"] = _weakest(rows, free, len(free) - idle)
    values = {"serial": serial, "parallel": parallel, "constraint": constraint}
    kinds = [kind for kind, value in values.items() if value < SINGULAR]
    if rows.matrix.size and not {"parallel", "constraint"} & set(kinds):
        kinds += _refused_kinds(_refusal(leg, q) if refused is None else refused, values, directions)
    return Singularity(tuple(kinds), serial, parallel, constraint, sign, length, directions)


def _usual_foot_motion(leg: Leg, scale: np.ndarray, sigma: np.ndarray) -> tuple[float, int]:
    """Largest singular value of the foot Jacobian at home, 0 where it has none, and its rank at most poses.

    A leg that moves in a plane has rank 2, however many its coordinates are. `sigma` are the values at the pose asked
    for, which counts as well.
    """
    home = leg.home
    generator = np.random.default_rng(0)
    unit = np.array([1.0 if unit == "rad" else 1.0 / s for unit, s in zip(leg.units.joints, scale, strict=True)])
    around = _SPREAD * unit * generator.uniform(-1.0, 1.0, (_RANK_POSES, len(home)))
    found = leg.jacobian(home + np.vstack([np.zeros(len(home)), around]), on_error="nan") * scale
    finite = np.isfinite(found).all(axis=(1, 2))
    values = np.linalg.svd(found[finite], compute_uv=False)
    ranks = [int(np.count_nonzero(each > SINGULAR * each.max(initial=0.0))) for each in (*values, sigma)]
    return float(values[0].max()) if finite[0] else 0.0, max(1, *ranks)


def _positive(length: float) -> float:
    length = number("characteristic_length", length)
    if not (math.isfinite(length) and length > 0.0):
        raise ParameterError(f"characteristic_length = {length!r} is not a positive number of metres")
    return length


def _assembled(leg: Leg, q: ArrayLike) -> tuple[Mapping[str, np.ndarray], RowError | None]:
    """Closed tree coordinates at one sample, also where the closure is singular and the route can tell them.

    With the error where the leg refuses the pose.
    """
    try:
        tree = leg.assemble(q)
    except (AssemblyError, SingularityError) as error:
        backend: Any = getattr(leg.backend, "fallback", None) or leg.backend
        if not hasattr(backend, "singular_pose") or np.shape(q) != (len(leg.joint_names),):
            raise
        values = backend.singular_pose(np.asarray(q, dtype=float))
        return dict(zip(backend.tree_joint_names, values, strict=True)), error
    if any(np.ndim(value) for value in tree.values()):
        raise ShapeError("singularity takes one sample, shape (n,)")
    return tree, None


def _refusal(leg: Leg, q: ArrayLike) -> RowError | None:
    """Why the leg's methods refuse a pose at rest; None where they do not."""
    rest = np.zeros(len(leg.joint_names))
    try:
        leg.mass_matrix(q)
        if leg.foot is not None:
            leg.jacobian(q)
        if len(leg.actuator_names) == leg.actuation.rank == len(rest):
            leg.torque(q, rest, rest)
    except (AssemblyError, SingularityError) as error:
        return error
    return None


def _refused_kinds(
    error: RowError | None, values: Mapping[str, float], directions: dict[str, Mapping[str, float]]
) -> list[str]:
    """The kinds of singular poses that a refused pose is near to, as its route says or else the nearest one."""
    if error is None:
        return []
    kind = getattr(error, "kind", None)
    if kind is None:
        kind = min(("parallel", "constraint"), key=lambda name: values[name])
        return [kind] if values[kind] < _NEAR else []
    directions.setdefault(kind, error.evidence["direction"])
    if kind not in values:
        return [kind]
    # Rows that lose rank take their columns along.
    return [name for name in ("parallel", "constraint") if name == kind or values[name] < values[kind]]


def _weakest(rows: LoopRows, columns: list[int], rank: int) -> tuple[float, Mapping[str, float]]:
    """Share of the singular value that must not vanish for some columns to have that rank, and its motion."""
    if rank < 1:
        return 1.0, {}
    _, sigma, right = np.linalg.svd(rows.matrix[:, columns])
    return _share(sigma, rank), _direction([rows.joints[k] for k in columns], right[rank - 1])


def _direction(names: Sequence[str], vector: np.ndarray) -> Mapping[str, float]:
    largest = vector[np.argmax(np.abs(vector))]
    return dict(zip(names, (vector / largest if largest else vector).tolist(), strict=True))


def _share(sigma: np.ndarray, rank: int, usual: float = 0.0) -> float:
    """The singular value that must not vanish for that rank, as a share of the largest, or of a usual one."""
    if rank < 1:
        return 1.0
    largest = max(float(sigma[0]), usual) if len(sigma) >= rank else 0.0
    return float(sigma[rank - 1]) / largest if largest > 0.0 else 0.0


def singularity_distance(leg: Leg, q: ArrayLike, direction: ArrayLike, *, reach: float = 1.0) -> SingularityDistance:
    """How far a pose can move along a line of independent coordinates before it meets a singularity.

    The line is scanned for a change of the sign of det J or a pose that does not close, and the first one is narrowed
    down by bisection; a double root between two scanned poses is not seen.

    Parameters
    ----------
    leg : Leg
        With three coordinates.
    q : (3,) array_like
        A regular pose.
    direction : (3,) array_like
        rad or m a unit of distance.
    reach : float
        How far to look both ways, in units of `direction`.

    Returns
    -------
    SingularityDistance

    Raises
    ------
    SingularityError
        The pose itself is singular, or does not close.
    ShapeError, NonFiniteError, ParameterError
        An argument is not usable.
    """
    having("leg", leg, ("joint_names", "jacobian"), "give what leg_dynamics.load returns")
    start, along = reals("q", q), reals("direction", direction)
    if start.shape != (3,) or along.shape != (3,) or len(leg.joint_names) != 3:
        raise ShapeError(f"q and direction need shape (3,), got {start.shape} and {along.shape}, on a leg with three")
    if not (np.isfinite(start).all() and np.isfinite(along).all()):
        raise NonFiniteError("q or direction is not finite")
    if not (along.any() and math.isfinite(reach) and reach > 0.0):
        raise ParameterError(f"direction {along.tolist()} and reach {reach!r} must not be zero, reach positive")
    home = conditioning(leg.jacobian(start, on_error="nan"))
    if not home.smallest > SINGULAR * home.largest:
        raise SingularityError(
            "the pose itself is singular or does not close: start from a regular one", margin=float(home.smallest)
        )
    sign = math.copysign(1.0, float(home.volume))

    def regular(distance: np.ndarray) -> np.ndarray:
        values = np.asarray(leg.jacobian(start + distance[:, None] * along, on_error="nan"))
        volume = conditioning(values).volume
        return volume * sign > 0.0

    ends = []
    for side in (1.0, -1.0):
        steps = side * np.linspace(0.0, reach, _SCAN + 1)
        inside = regular(steps)
        first = np.flatnonzero(~inside)
        if first.size == 0:
            ends.append((side * math.inf, "none"))
            continue
        low, high = steps[first[0] - 1], steps[first[0]]
        for _ in range(60):
            middle = 0.5 * (low + high)
            if regular(np.array([middle]))[0]:
                low = middle
            else:
                high = middle
        kind = _kind_at(leg, start, start + low * along)
        ends.append((low, kind))
    return SingularityDistance(float(ends[0][0]), float(ends[1][0]), ends[0][1], ends[1][1], reach)


def _kind_at(leg: Leg, start: np.ndarray, end: np.ndarray) -> str:
    """Which singularity lies just beyond a pose: the kind whose measure has fallen most since the start."""
    try:
        first, last = (singularity(leg, pose) for pose in (start, end))
    except RowError:
        return "assembly"
    fallen = {kind: getattr(last, kind) / getattr(first, kind) for kind in ("serial", "parallel", "constraint")}
    kind = min(fallen, key=lambda name: fallen[name])
    return kind if fallen[kind] < _FALLEN else "assembly"
