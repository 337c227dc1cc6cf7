"""Mobility: what a count of joints promises (Gruebler) against what the rank of the loop rows gives."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.errors import AssemblyError, SingularityError

if TYPE_CHECKING:
    from leg_dynamics.mechanism.mechanism import Mechanism

__all__ = ["MobilityReport", "PoseRank", "mobility_report", "pose_rank"]

# Singular values below this share of the largest count as zero.
RANK_SHARE = 1e-9


@dataclass(frozen=True)
class PoseRank:
    """Rank of K at one closed pose.

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
    """Rank of the loop rows at tree coordinates q (nv,)."""
    rows = mechanism._evaluate(q)
    K = rows.jacobian
    sigma = np.linalg.svd(K, compute_uv=False) if K.size else np.zeros(0)
    largest = float(sigma.max(initial=1.0))
    rank = int(np.count_nonzero(sigma > RANK_SHARE * largest))
    dependent = K[:, mechanism.dependent]
    below = float(sigma[rank] / largest) if rank < len(sigma) else 0.0
    return PoseRank(
        pose=pose,
        residual=float(np.abs(rows.residual).max(initial=0.0)),
        rank=rank,
        redundant=mechanism.closure.rows - rank,
        mobility=mechanism.nv - rank,
        dependent_rank=int(np.linalg.matrix_rank(dependent, tol=RANK_SHARE * largest)) if dependent.size else 0,
        gap=(float(sigma[rank - 1] / largest) if rank else 0.0, below),
    )


def mobility_report(mechanism: Mechanism, samples: int = 20, seed: int = 0) -> MobilityReport:
    """Ranks at the file's configurations and at random closed poses inside the joint limits.

    Raises
    ------
    AssemblyError
        No pose can be closed at all.
    """
    from leg_dynamics.mechanism.assembly import configuration_coordinates

    poses = []
    for configuration in mechanism.description.configurations:
        q = configuration_coordinates(mechanism, dict(configuration.values))
        rank = pose_rank(mechanism, q, configuration.name)
        if rank.residual < 1e-6:
            poses.append(rank)
    generator = np.random.default_rng(seed)
    lower = np.maximum(mechanism.lower[mechanism.independent], -np.pi)
    upper = np.minimum(mechanism.upper[mechanism.independent], np.pi)
    random_poses = []
    failure: AssemblyError | SingularityError | None = None
    for _ in range(samples):
        try:
            state = mechanism.close(generator.uniform(lower, upper))
        except (AssemblyError, SingularityError) as error:
            failure = error
            continue
        random_poses.append(pose_rank(mechanism, state.q, f"random {len(random_poses) + 1}"))
    if not poses and not random_poses:
        raise failure if failure is not None else AssemblyError("no pose was asked for: samples must be at least 1")
    generic = random_poses or poses
    mobility = min(pose.mobility for pose in generic)
    return MobilityReport(
        name=mechanism.description.name,
        joints=mechanism.nv,
        rows=mechanism.closure.rows,
        independent=mechanism.n,
        actuators=len(mechanism.actuated),
        gruebler=mechanism.nv - mechanism.closure.rows,
        mobility=mobility,
        redundant=min(pose.redundant for pose in generic),
        poses=(*poses, *random_poses),
    )
