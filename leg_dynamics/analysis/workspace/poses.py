"""Constraints, condition number and foot of many poses at once: what everything else in this folder asks for."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.analysis.dexterity import actuator_jacobian, column_scales, conditioning, conditioning_kernel
from leg_dynamics.analysis.workspace.constraints import Constraint, constraint_kernels, constraints_of
from leg_dynamics.errors import NonFiniteError, RowFailures, ShapeError, UnsupportedError, WorkspaceError

if TYPE_CHECKING:
    from leg_dynamics.leg import Leg

__all__ = ["ASSEMBLY", "FREE", "NAMES", "SINGULAR", "PoseEvaluator", "Poses", "margins"]

ASSEMBLY, SINGULAR, FREE = -1, -2, -3
"""Instead of a constraint's index: the loops cannot be closed; det J has the other sign; nothing limits the leg."""

NAMES = {ASSEMBLY: "assembly", SINGULAR: "singularity", FREE: "none"}
"""What is said of these."""

_BLOCK = 4096
"""Rows at a time: what the kernels hand to each other stays in the processor's cache."""


@dataclass(frozen=True)
class Poses:
    """N poses and what limits them; rows whose loops cannot be closed are NaN.

    Attributes
    ----------
    q : (N, n) array
        Independent coordinates, rad or m.
    foot : (N, 3) array
        m, hip frame.
    normalised, margin : (N,) array
        Of the active constraint, the one with the smallest normalised margin: that margin, and the margin in the
        constraint's own unit, rad or m. Negative where the pose breaks it.
    active : (N,) array of int
        Index of the active constraint, or `ASSEMBLY`, `SINGULAR`, `FREE`.
    condition, smallest : (N,) array
        Condition number and smallest singular value of the Jacobian by the actuators.
    volume : (N,) array
        det J by the independent coordinates, with its sign, for three of them; else sqrt(det(J^T J)).
    """

    q: np.ndarray
    foot: np.ndarray
    normalised: np.ndarray
    margin: np.ndarray
    active: np.ndarray
    condition: np.ndarray
    smallest: np.ndarray
    volume: np.ndarray

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: Any) -> Poses:
        return Poses(*(getattr(self, each.name)[rows] for each in fields(self)))

    @staticmethod
    def joined(parts: list[Poses]) -> Poses:
        """All rows of several."""
        return Poses(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Poses)))

    @staticmethod
    def where(first: np.ndarray, one: Poses, other: Poses) -> Poses:
        """Rows of `one` where `first` (N,) says so, else of `other`."""

        def chosen(name: str) -> np.ndarray:
            a, b = getattr(one, name), getattr(other, name)
            return np.where(first[:, None] if a.ndim == 2 else first, a, b)

        return Poses(*(chosen(each.name) for each in fields(Poses)))

    @property
    def feasible(self) -> np.ndarray:
        """Whether every constraint holds, (N,) bool; False where the loops cannot be closed."""
        return self.normalised >= 0.0


class PoseEvaluator:
    """Evaluates poses of one leg.

    Parameters
    ----------
    leg : Leg
        With a foot and at most three independent coordinates.
    characteristic_length : float, optional
        m; see `leg_dynamics.analysis.dexterity.column_scales`.
    ignore : iterable of str
        Names or kinds of constraints to leave out.

    Attributes
    ----------
    constraints : tuple of Constraint
    unit : str
        Of singular values.
    characteristic_length : float or None
    count : int
        Poses evaluated so far.
    sign : float
        The sign of det J of the poses that count, once `choose_sign` was called; 0 where both do.

    Raises
    ------
    MissingFootError
        The leg has no foot.
    UnsupportedError
        It has more than three independent coordinates: a foot position then has infinitely many poses.
    """

    def __init__(self, leg: Leg, *, characteristic_length: float | None = None, ignore: Iterable[str] = ()) -> None:
        leg.jacobian(np.zeros((0, len(leg.joint_names))))  # has the foot looked for
        if len(leg.joint_names) > 3:
            raise UnsupportedError(
                f"{leg.name!r} has {len(leg.joint_names)} independent coordinates: the workspace of a foot needs at "
                "most three; lock the others",
                coordinates=len(leg.joint_names),
            )
        self.leg = leg
        self.constraints: tuple[Constraint, ...] = constraints_of(leg.description, ignore)
        self.scales, self.unit, self.characteristic_length = column_scales(leg, characteristic_length)
        self.sign = 0.0
        self.count = 0
        self._kernels = (
            constraint_kernels(leg.description, leg.tree_joint_names, self.constraints) if self.constraints else None
        )
        self._direct = set(leg.backend.actuator_joints) == set(leg.joint_names)
        # The routes' own methods explain each failing row; here a row that fails is just not in the workspace.
        self._tree, self._foot, self._jacobian = (
            self._quiet(name) for name in ("tree_coordinates", "foot_position", "foot_jacobian")
        )
        order = [leg.backend.actuator_joints.index(name) for name in leg.joint_names] if self._direct else []
        self._column_scales = self.scales[order] if self._direct else self.scales
        if self._direct and len(leg.joint_names) == 3:
            conditioning_kernel()

    def _quiet(self, name: str) -> Callable[[np.ndarray], np.ndarray]:
        """A method of the route for batches, whose rows that cannot be computed are NaN without a word."""
        route: Any = self.leg.backend
        if hasattr(route, "kernel"):
            return route.kernel(name).ufunc
        if hasattr(route, "kernel_rows"):
            return functools.partial(route.kernel_rows, name)
        method = getattr(route, name)

        def run(q: np.ndarray) -> np.ndarray:
            return method(q, RowFailures())

        return run

    def name_of(self, index: int) -> str:
        """Name of the constraint with that index, of `Poses.active`."""
        return NAMES[int(index)] if index < 0 else self.constraints[int(index)].name

    @property
    def names(self) -> dict[int, str]:
        """Every index that `Poses.active` may hold, with its name."""
        return dict(enumerate(each.name for each in self.constraints)) | NAMES

    @property
    def is_compiled(self) -> bool:
        """Whether the leg's route computes batches in machine code."""
        return self.leg.route != "pinocchio"

    def __call__(self, q: np.ndarray) -> Poses:
        """Evaluate poses q (N, n), which must be finite."""
        self.count += len(q)
        blocks = [q[start : start + _BLOCK] for start in range(0, max(len(q), 1), _BLOCK)]
        workers = min(_processors(), len(blocks)) if self.is_compiled else 1
        if workers > 1:
            with ThreadPoolExecutor(workers) as pool:
                return Poses.joined(list(pool.map(self._block, blocks)))
        return Poses.joined([self._block(block) for block in blocks])

    def _block(self, q: np.ndarray) -> Poses:
        with np.errstate(all="ignore"):
            tree, foot, J = self._tree(q), self._foot(q), self._jacobian(q)
            lost = ~np.isfinite(tree.sum(axis=-1) + foot.sum(axis=-1) + J.sum(axis=(-1, -2)))
            if self._kernels is None:
                normalised, margin = np.full((2, len(q)), math.inf)
                active = np.full(len(q), FREE)
            else:
                normalised, margin, index = self._kernels.worst.ufunc(tree).T
                active = np.where(np.isnan(index), ASSEMBLY, index).astype(np.intp)
            if self._direct:
                values = conditioning(J, self._column_scales)
                volume = values.volume
            else:
                values = conditioning(actuator_jacobian(self.leg, q), self.scales)
                volume = conditioning(J).volume
            arrays = [normalised, margin, values.condition, values.smallest, volume]
            if lost.any():
                arrays = [np.where(lost, np.nan, array) for array in arrays]
                active = np.where(lost, ASSEMBLY, active)
        normalised, margin, condition, smallest, volume = arrays
        if self.sign:
            other = (volume * self.sign <= 0.0) & (normalised >= 0.0)
            if other.any():
                # det J has no scale of its own: what counts is that the pose is not one of these
                normalised, margin = (np.where(other, -np.inf, array) for array in (normalised, margin))
                active = np.where(other, SINGULAR, active)
        return Poses(q, foot, normalised, margin, active, condition, smallest, volume)

    def foot_and_jacobian(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Foot positions (N, 3), m, and their Jacobians by the independent coordinates (N, 3, n)."""
        return self._foot(q), self._jacobian(q)

    def all_margins(self, q: np.ndarray) -> np.ndarray:
        """Margin of every constraint, each in its own unit, (N, K)."""
        if self._kernels is None:
            return np.zeros((len(q), 0))
        return np.asarray(self._kernels.margins.ufunc(self._tree(q)))

    def box(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lower and upper ends of the independent coordinates to sample, and which of them are whole turns.

        Raises
        ------
        WorkspaceError
            A sliding coordinate has no limits, or lower and upper coincide.
        """
        lower, upper = self.leg.limits.lower.copy(), self.leg.limits.upper.copy()
        turn = np.zeros(len(lower), dtype=bool)
        for k, (name, unit) in enumerate(zip(self.leg.joint_names, self.leg.units.joints, strict=True)):
            if unit == "rad" and not upper[k] - lower[k] < 2.0 * math.pi - 1e-9:
                turn[k] = True
                lower[k] = lower[k] if math.isfinite(lower[k]) else -math.pi
                upper[k] = lower[k] + 2.0 * math.pi
            elif not math.isfinite(upper[k] - lower[k]):
                raise WorkspaceError(
                    f"joint {name!r} slides without limits: its workspace is infinite; give it a lower and an upper "
                    "limit in the file",
                    joint=name,
                )
            elif not upper[k] > lower[k]:
                raise WorkspaceError(
                    f"joint {name!r} is locked at {lower[k]:.6g} {unit}: the workspace has no volume; widen its limits",
                    joint=name,
                )
        return lower, upper, turn


def margins(leg: Leg, q: ArrayLike) -> dict[str, np.ndarray]:
    """Signed margin of every constraint of a leg.

    Parameters
    ----------
    leg : Leg
    q : (..., n) array_like
        Independent coordinates, rad or m.

    Returns
    -------
    dict of str to (...,) array
        By constraint name, rad or m (`constraints_of` says which); negative where the pose breaks it, NaN where the
        loops cannot be closed.

    Raises
    ------
    ShapeError, NonFiniteError
        `q` is not usable.
    """
    poses = np.asarray(q, dtype=float)
    if poses.ndim == 0 or poses.shape[-1] != len(leg.joint_names):
        raise ShapeError(f"q has shape {poses.shape}, expected (..., {len(leg.joint_names)})", shape=poses.shape)
    bad = np.flatnonzero(~np.isfinite(poses.reshape(-1, poses.shape[-1])).all(axis=1))
    if bad.size:
        raise NonFiniteError(f"q is not finite in {bad.size} rows, first row {bad[0]}: leave them out", rows=bad)
    found = constraints_of(leg.description)
    if not found:
        return {}
    tree = leg.assemble(poses, on_error="nan")
    stacked = np.stack([tree[name] for name in leg.tree_joint_names], axis=-1)
    values = constraint_kernels(leg.description, leg.tree_joint_names, found).margins.ufunc(stacked)
    return {each.name: values[..., k] for k, each in enumerate(found)}


def _processors() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1
