"""Mobility: what a count of joints promises (Gruebler) against what the rank of the loop rows gives."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.errors import AssemblyError, DescriptionError, LegDynamicsError, ShapeError, SingularityError

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import ClosedState, Mechanism

__all__ = [
    "MobilityReport",
    "PoseRank",
    "check_independent",
    "is_clear",
    "mobility_report",
    "pose_rank",
    "project",
    "wrong_independent",
]

# A rank is taken where the loops are closed to this residual: an open pose has the rank of a stiffer mechanism.
CLOSED = 1e-12
# A file's rounded configuration is brought to the nearest closed pose when its residual is below this.
NEARLY_CLOSED = 1e-2
PROJECTION_ITERATIONS = 60
PROJECTION_RANK = 1e-6
# Neighbouring poses at which flags and generic ranks are tried, rad or shares of the mechanism's length.
PROBE_STEPS = (0.05, 0.01, 0.002)
NEIGHBOUR = 0.2
NEIGHBOURS = 6
NEIGHBOUR_DRAWS = 3
# A row that counts by less than this share at generic poses counts only because the file's numbers are rounded.
ROUNDED_SHARE = 1e-4
# And one below this may do so: worth a hint where the count is wrong.
SUSPECT_SHARE = 3e-3
ROUNDED_ADVICE = (
    "the file's numbers are rounded (an angle of 1.57 is off by 8e-04): write them with all digits, or use loop types "
    "with fewer rows"
)


@dataclass(frozen=True)
class PoseRank:
    """Rank of K at one closed pose, columns per `Closure.coordinate_unit`.

    `gap` is (smallest counted, largest uncounted singular value) relative to the largest: far apart when the
    rank is beyond doubt. `dependent_rank` is the rank of the dependent joints' columns.
    """

    pose: str
    residual: float
    rank: int
    redundant: int
    mobility: int
    dependent_rank: int
    gap: tuple[float, float]


@dataclass(frozen=True)
class MobilityReport:
    """Gruebler's count beside the numeric mobility at named and random closed poses.

    Attributes
    ----------
    joints, rows, independent, actuators : int
    gruebler : int
        joints - rows: the mobility if all rows were independent.
    poses : tuple of PoseRank
        Named configurations first, then random poses.
    mobility, redundant : int
        At generic (random) poses; where there is none, at the first pose.
    """

    name: str
    joints: int
    rows: int
    independent: int
    actuators: int
    gruebler: int
    mobility: int
    redundant: int
    poses: tuple[PoseRank, ...]

    @property
    def special_poses(self) -> tuple[PoseRank, ...]:
        """Poses whose mobility differs from the generic one."""
        return tuple(pose for pose in self.poses if pose.mobility != self.mobility)

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON-ready values."""
        return asdict(self)

    def __rich__(self) -> Any:
        from rich.table import Table

        table = Table(title=f"{self.name}: {self.joints} tree joints, {self.rows} loop and coupling rows")
        for column in ("pose", "rank", "redundant rows", "mobility", "rank gap"):
            table.add_column(column)
        for pose in self.poses[:8]:
            style = "yellow" if pose.mobility != self.mobility else None
            counted, uncounted = pose.gap
            gap = f"{counted:.1e} | {uncounted:.1e}"
            table.add_row(pose.pose, str(pose.rank), str(pose.redundant), str(pose.mobility), gap, style=style)
        table.caption = (
            f"Gruebler {self.gruebler}, true mobility {self.mobility} with {self.independent} independent joints and "
            f"{self.actuators} actuators; {self.redundant} redundant rows; {len(self.poses)} poses"
        )
        return table


def pose_rank(mechanism: Mechanism, q: np.ndarray, pose: str) -> PoseRank:
    """Rank of the loop rows at tree coordinates q (nv,), which should be closed; `pose` is its name in the report."""
    rows = mechanism.evaluate(q)
    K = rows.jacobian * mechanism.closure.coordinate_unit
    sigma = np.linalg.svd(K, compute_uv=False) if K.size else np.zeros(0)
    # K is dimensionless: a lone small row is no row.
    largest = float(sigma.max(initial=1.0))
    rank = int(np.count_nonzero(sigma > mechanism.rank_share * largest))
    dependent = K[:, mechanism.dependent]
    least = mechanism.rank_share * largest
    below = float(sigma[rank] / largest) if rank < len(sigma) else 0.0
    return PoseRank(
        pose=pose,
        residual=float(np.linalg.norm(rows.residual)),
        rank=rank,
        redundant=mechanism.closure.rows - rank,
        mobility=mechanism.nv - rank,
        dependent_rank=int(np.linalg.matrix_rank(dependent, tol=least)) if dependent.size else 0,
        gap=(float(sigma[rank - 1] / largest) if rank else 0.0, below),
    )


def is_clear(mechanism: Mechanism, rank: PoseRank) -> bool:
    """Whether a rank tells anything: beside a singular pose, rows that only rounding makes count by more than usual."""
    return not mechanism.gap or rank.gap[0] >= SUSPECT_SHARE


def project(mechanism: Mechanism, q: np.ndarray, *, exactly: bool = False) -> np.ndarray | None:
    """A closed pose near q (nv,) by minimum-norm Newton over all joints, independent ones too; None where it fails.

    Needs no independent joints: this is how the mobility of a wrongly flagged file is found. Closed to the last digit,
    or, unless `exactly`, to `Mechanism.gap`.
    """
    if not exactly and mechanism.gap:
        from leg_dynamics.mechanism.rounded import settle

        settled = settle(mechanism, q, mechanism.rank_share)
        return settled[0] if settled is not None and settled[1] <= mechanism.tolerance else None
    unit = mechanism.closure.coordinate_unit
    for _ in range(PROJECTION_ITERATIONS):
        rows = mechanism.evaluate(q)
        if np.abs(rows.residual).max(initial=0.0) <= CLOSED:
            return q
        step, *_ = np.linalg.lstsq(rows.jacobian * unit, -rows.residual, rcond=PROJECTION_RANK)
        largest = float(np.abs(step).max())
        if not largest < np.inf:
            return None
        q = q + unit * step * min(1.0, 0.5 / largest if largest > 0.0 else 1.0)
    return None


def _neighbours(mechanism: Mechanism, q: np.ndarray, seed: int = 0, count: int = NEIGHBOURS) -> list[PoseRank]:
    """Ranks at up to `count` closed poses around q: generic ones, where a special pose has more mobility."""
    generator = np.random.default_rng(seed)
    ranks: list[PoseRank] = []
    for _ in range(NEIGHBOUR_DRAWS * count):
        moved = q + NEIGHBOUR * mechanism.closure.coordinate_unit * generator.standard_normal(mechanism.nv)
        closed = project(mechanism, moved)
        if closed is not None:
            rank = pose_rank(mechanism, closed, f"near home {len(ranks) + 1}")
            ranks += [rank] if is_clear(mechanism, rank) else []
        if len(ranks) == count:
            break
    return ranks


def _flags_error(mechanism: Mechanism, rank: PoseRank) -> DescriptionError:
    flagged, mobility = mechanism.n, rank.mobility
    if flagged < mobility:
        fault = (
            f"{mobility - flagged} motions would be left undetermined: mark more joints independent, or add the "
            "missing loops"
        )
    elif flagged > mobility:
        fault = f'{flagged - mobility} of them cannot move freely: mark passive joints independent="false"'
    else:
        fault = "but these joints do not determine the others: mark other joints independent"
    if 0.0 < rank.gap[0] < SUSPECT_SHARE:
        fault = (
            f"but one of the rows counts by {rank.gap[0]:.3g} of the largest only, so that the mobility is greater if "
            f"{ROUNDED_ADVICE}"
        )
    return DescriptionError(
        f"{flagged} joints are independent ({', '.join(mechanism.joint_names)}) and the mechanism's mobility is "
        f"{mobility} ({mechanism.nv} tree joints, loop rows of rank {rank.rank}); {fault}",
        file=mechanism.description.file,
        mobility=mobility,
        independent=flagged,
    )


def check_independent(mechanism: Mechanism, state: ClosedState) -> None:
    """Check at a closed, regular pose that the independent joints number the mobility.

    A pose with regular dependent columns has at most n motions. It has fewer where the flags are too many; and where
    the pose is a special one, neighbouring values of the independent joints cannot be closed.

    Raises
    ------
    DescriptionError
        Carries the true `mobility` and the number flagged, `independent`.
    """
    if mechanism.closure.rows == 0:
        return
    rank = pose_rank(mechanism, state.q, "seed")
    if rank.mobility != mechanism.n:
        raise _flags_error(mechanism, rank)
    if rank.redundant == 0 or _is_free(mechanism, state):
        return
    generic = min(_neighbours(mechanism, state.q), key=lambda neighbour: neighbour.mobility, default=rank)
    if generic.mobility != mechanism.n:
        raise _flags_error(mechanism, generic)


def _is_free(mechanism: Mechanism, state: ClosedState) -> bool:
    """Whether neighbouring independent coordinates can be closed."""
    unit = mechanism.closure.coordinate_unit[mechanism.independent]
    direction = np.random.default_rng(0).uniform(0.5, 1.0, mechanism.n) * unit
    for step in PROBE_STEPS:
        if all(mechanism.advance(state, state.y + sign * step * direction) is not None for sign in (1.0, -1.0)):
            return True
    return False


def wrong_independent(mechanism: Mechanism, start: np.ndarray) -> DescriptionError | None:
    """The error to raise where no pose is regular although the loops can be closed near `start` (nv,); else None."""
    closed = project(mechanism, start)
    ranks = _neighbours(mechanism, start if closed is None else closed)
    if not ranks:
        return None
    generic = min(ranks, key=lambda rank: rank.mobility)
    if generic.mobility == mechanism.n and generic.dependent_rank == len(mechanism.dependent):
        return None
    return _flags_error(mechanism, generic)


def _whole_number(name: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 0:
        raise ShapeError(f"{name} must be a whole number, at least 0, got {value!r}", argument=name)
    return int(value)


def mobility_report(mechanism: Mechanism, samples: int = 20, seed: int = 0) -> MobilityReport:
    """Ranks at the file's configurations and at random closed poses inside the joint limits.

    Wrong `independent` flags do not keep it from answering: the random poses are then neighbours of the named ones.

    Parameters
    ----------
    mechanism : Mechanism
    samples : int
        Number of random poses, at least 0.
    seed : int
        At least 0.

    Raises
    ------
    ShapeError
        `samples` or `seed` is not such a number.
    AssemblyError
        No pose can be closed at all.
    """
    from leg_dynamics.mechanism.assembly import configuration_coordinates

    samples, seed = _whole_number("samples", samples), _whole_number("seed", seed)
    poses = []
    for configuration in mechanism.description.configurations:
        q: np.ndarray | None = configuration_coordinates(mechanism, dict(configuration.values))
        assert q is not None
        if np.abs(mechanism.evaluate(q).residual).max(initial=0.0) > NEARLY_CLOSED:
            continue
        q = project(mechanism, q)
        if q is not None:
            poses.append(pose_rank(mechanism, q, configuration.name))
    generator = np.random.default_rng(seed)
    lower, upper = (bound[mechanism.independent] for bound in mechanism.search_box())
    random_poses: list[PoseRank] = []
    failure: LegDynamicsError | None = None
    home = mechanism.description.home
    start = configuration_coordinates(mechanism, dict(home.values) if home is not None else {})
    attempts = 0
    if samples > 0:
        try:
            start, attempts = mechanism.seeds[0].q, samples
        except (AssemblyError, DescriptionError) as error:
            failure = error
    for _ in range(attempts):
        try:
            state = mechanism.close(generator.uniform(lower, upper))
        except (AssemblyError, SingularityError) as error:
            failure = error
            continue
        rank = pose_rank(mechanism, state.q, f"random {len(random_poses) + 1}")
        random_poses += [rank] if is_clear(mechanism, rank) else []
    # Coordinates drawn alone seldom close where loops leave idle motions: then all joints move, from home.
    if len(random_poses) < samples:
        random_poses += _neighbours(mechanism, start, seed, samples - len(random_poses))
    generic = random_poses or poses
    if not generic:
        raise (
            failure
            if failure is not None
            else AssemblyError(
                f"no closed pose of {mechanism.description.name!r} was found: add a <configuration> that closes the "
                "loops, and ask for at least one sample"
            )
        )
    return MobilityReport(
        name=mechanism.description.name,
        joints=mechanism.nv,
        rows=mechanism.closure.rows,
        independent=mechanism.n,
        actuators=len(mechanism.actuated),
        gruebler=mechanism.nv - mechanism.closure.rows,
        mobility=min(pose.mobility for pose in generic),
        redundant=min(pose.redundant for pose in generic),
        poses=(*poses, *random_poses),
    )
