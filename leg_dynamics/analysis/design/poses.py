"""Poses of any design of a leg: by one kernel for all designs, or by each design's own leg where that cannot be."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from leg_dynamics.analysis.design.graphs import PoseKernels
from leg_dynamics.analysis.design.numbers import NumberMap, build, read
from leg_dynamics.analysis.dexterity import column_scales, home_coordinates
from leg_dynamics.analysis.workspace import FootEvaluator, PoseEvaluator, Poses
from leg_dynamics.analysis.workspace.poses import ASSEMBLY, NAMES, SINGULAR
from leg_dynamics.analysis.workspace.sampling import choose_sign
from leg_dynamics.description.parameters import Bound, parameter_bounds
from leg_dynamics.errors import LegDynamicsError, WorkspaceError

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description
    from leg_dynamics.leg import Leg

__all__ = ["Designs", "Family", "OnePose", "Singles", "sign_of"]


class OnePose(Protocol):
    """Poses of one design.

    Attributes
    ----------
    lower, upper : (n,) array
        Box of the independent coordinates to sample, rad or m.
    home : (3,) array
        Foot in the home configuration, m, hip frame.
    """

    lower: np.ndarray
    upper: np.ndarray
    home: np.ndarray

    def poses(self, q: np.ndarray) -> np.ndarray:
        """`leg_dynamics.analysis.design.graphs.OUTPUTS` of poses q (N, n), shape (N, 6); NaN rows do not close."""
        ...

    def feet(self, p: np.ndarray) -> np.ndarray:
        """The same of foot positions p (N, 3), with the coordinates beside them, (N, 6 + n), of the best branch."""
        ...

    def active_at(self, p: np.ndarray) -> tuple[str, float]:
        """Constraint that a foot position (3,) which is not feasible breaks by most: its name and margin, rad or m."""
        ...

    def leg(self) -> Leg:
        """The design as a leg of its own; made when first asked for."""
        ...

    def description(self) -> Description:
        """The design's file as it is read; rendered when first asked for."""
        ...


class Designs(Protocol):
    """Where poses of designs come from."""

    def at(self, design: Mapping[str, float]) -> OnePose:
        """Poses of a design, given by some parameters' values; a `LegDynamicsError` where there is no such leg."""
        ...


def sign_of(leg: Leg, ignore: Sequence[str]) -> float:
    """Sign of det J of the poses that count, 0 where both do: that of the leg which the study starts from."""
    return choose_sign(PoseEvaluator(leg, ignore=ignore), home_coordinates(leg))


class Family:
    """All designs by one set of kernels.

    Parameters
    ----------
    leg : Leg
    numbers : NumberMap
    ignore : sequence of str
        Names or kinds of constraints to leave out.
    characteristic_length : float, optional
        m; that of the first design for all, so that their condition numbers compare.
    """

    def __init__(
        self, leg: Leg, numbers: NumberMap, ignore: Sequence[str], characteristic_length: float | None = None
    ) -> None:
        self.base, self.numbers = leg, numbers
        scales, _, _ = column_scales(leg, characteristic_length)
        actuators = leg.backend.actuator_joints
        order = [actuators.index(name) for name in leg.joint_names]
        self.kernels = PoseKernels(leg, numbers, scales[order], tuple(ignore))
        self.rows = {name: k for k, name in enumerate(numbers.names)}
        varied = set(numbers.parameters)
        # What the parameters file says is possible; the numbers of the kinematics do not show all of it.
        self.bounds = tuple(bound for bound in _bounds(leg) if bound.names & varied)
        self.branches = self._own_branches()

    def _own_branches(self) -> tuple[str, ...]:
        """Branches of the inverse kinematics that lead into the leg's assembly mode somewhere."""
        one = _OfFamily(self, {})
        box = one.lower + (one.upper - one.lower) * np.random.default_rng(0).random((4096, len(one.lower)))
        found = one.poses(box)
        feet = found[np.isfinite(found[:, 0]), 3:6]
        kept = []
        for branch in self.base.branches:
            worst = self.kernels.feet[branch].ufunc(feet, one.numbers)[:, 0]
            if (np.isfinite(worst) & (worst != -1.0)).any():
                kept.append(branch)
        return tuple(kept) or self.base.branches

    def at(self, design: Mapping[str, float]) -> OnePose:
        """See `Designs`."""
        one = _OfFamily(self, design)
        if self._is_doubtful(design, one.numbers):
            # What cannot be says so here, by the error that anybody who makes this leg gets.
            one.leg()
        return one

    def _is_doubtful(self, design: Mapping[str, float], numbers: np.ndarray) -> bool:
        """Whether a design may be impossible, so that it must be rendered to know."""
        parameters = self.base.parameters
        values = {**{name: each.value for name, each in parameters.items()}, **design}
        if not all(bound.holds(values) for bound in self.bounds):
            return True
        if any(value * parameters[name].value <= 0.0 < abs(parameters[name].value) for name, value in design.items()):
            return True
        for name, k in self.rows.items():
            if name.endswith(".lower") and (top := self.rows.get(f"{name.removesuffix('.lower')}.upper")) is not None:
                if not numbers[k] < numbers[top]:
                    return True
            elif name.startswith("route ") and numbers[k] * self.numbers.values[k] <= 0.0 < abs(self.numbers.values[k]):
                return True
            elif name.startswith(("cone", "telescope", "clearance")) and name.endswith(
                ("upper", "sleeve", "rod", "overlap", "minimum", "radius")
            ):
                if numbers[k] < 0.0 or (name.startswith("cone") and not 0.0 < numbers[k] <= np.pi):
                    return True
                if name.endswith(".rod"):
                    stem = name.removesuffix("rod")
                    if numbers[k] + numbers[self.rows[f"{stem}sleeve"]] <= numbers[self.rows[f"{stem}overlap"]]:
                        return True
        return False


class _OfFamily:
    """One design of a `Family`."""

    def __init__(self, family: Family, design: Mapping[str, float]) -> None:
        self.family, self.design = family, dict(design)
        self.numbers = family.numbers(design)
        rows = family.rows
        leg = family.base
        box: list[list[float]] = []
        for side, turn in (("lower", -np.pi), ("upper", np.pi)):
            box.append([])
            for name, unit in zip(leg.joint_names, leg.units.joints, strict=True):
                row = rows.get(f"{name}.{side}")
                if row is None and unit == "m":
                    raise WorkspaceError(f"joint {name!r} slides without limits: give it some", joint=name)
                box[-1].append(turn if row is None else float(self.numbers[row]))
        self.lower, self.upper = (np.array(values) for values in box)
        self.home = self.numbers[[rows[f"home.{axis}"] for axis in "xyz"]]

    def poses(self, q: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return self.family.kernels.poses.ufunc(q, self.numbers)

    def feet(self, p: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            found = [self.family.kernels.feet[branch].ufunc(p, self.numbers) for branch in self.family.branches]
        best = found[0]
        for other in found[1:]:
            better = np.nan_to_num(other[:, 0], nan=-np.inf) > np.nan_to_num(best[:, 0], nan=-np.inf)
            best = np.where(better[:, None], other, best)
        return best

    def active_at(self, p: np.ndarray) -> tuple[str, float]:
        q = self.feet(p[None])[0, 6:]
        if not np.isfinite(q).all():
            return NAMES[ASSEMBLY], np.nan
        margins, scales = self.family.kernels.margins.ufunc(q, self.numbers).reshape(2, -1)
        worst = int(np.argmin(margins / scales)) if margins.size else -1
        if worst < 0 or margins[worst] >= 0.0:
            return NAMES[SINGULAR], np.nan
        return self.family.kernels.wanted[worst], float(margins[worst])

    @functools.cached_property
    def _leg(self) -> Leg:
        return build(self.family.base, self.design)

    def leg(self) -> Leg:
        return self._leg

    @functools.cached_property
    def _description(self) -> Description:
        return self._leg.description if "_leg" in self.__dict__ else read(self.family.base, self.design)

    def description(self) -> Description:
        return self._description


class Singles:
    """Each design by its own leg: any route, any mechanism, and any way in which parameters act.

    Parameters
    ----------
    leg : Leg
    ignore : sequence of str
    characteristic_length : float, optional
    """

    def __init__(self, leg: Leg, ignore: Sequence[str], characteristic_length: float | None = None) -> None:
        self.base, self.ignore = leg, tuple(ignore)
        self.length = column_scales(leg, characteristic_length)[2]

    def at(self, design: Mapping[str, float]) -> OnePose:
        """See `Designs`."""
        leg = build(self.base, design)
        return _OfSingle(leg, PoseEvaluator(leg, characteristic_length=self.length, ignore=self.ignore))


class _OfSingle:
    """One design of `Singles`."""

    def __init__(self, leg: Leg, evaluate: PoseEvaluator) -> None:
        self._leg, self._evaluate = leg, evaluate
        self.lower, self.upper, _ = evaluate.box()
        self.home = leg.foot_position(home_coordinates(leg), on_error="nan")
        self._kept: list[Poses] = []

    def poses(self, q: np.ndarray) -> np.ndarray:
        found = self._evaluate(q)
        inside = np.flatnonzero(found.feasible)
        if inside.size and len(self._kept) < 1:
            self._kept.append(found[inside])
        return _columns(found)

    @functools.cached_property
    def _foot(self) -> FootEvaluator:
        if not self._kept:
            raise WorkspaceError("no pose is feasible: there is nowhere to look for others from")
        return FootEvaluator(self._evaluate, self._kept[0])

    def feet(self, p: np.ndarray) -> np.ndarray:
        found = self._foot(p)
        return np.concatenate([_columns(found), found.q], axis=1)

    def active_at(self, p: np.ndarray) -> tuple[str, float]:
        found = self._foot(p[None])
        margin = float(found.margin[0])
        if margin >= 0.0:  # the sign of det J is not the evaluator's
            return self._evaluate.name_of(SINGULAR), np.nan
        return self._evaluate.name_of(found.active[0]), margin

    def leg(self) -> Leg:
        return self._leg

    def description(self) -> Description:
        return self._leg.description


def _bounds(leg: Leg) -> tuple[Bound, ...]:
    """Bounds of the leg's parameters, from the source that it was read from."""
    from leg_dynamics.description.shipped import existing_file, shipped_xacro

    source = getattr(leg.recipe, "source", None)
    if source is None or not leg.parameters:
        return ()
    path = existing_file(source) or shipped_xacro(source)
    return parameter_bounds(path) if path.name.endswith(".xacro") else ()


def _columns(found: Poses) -> np.ndarray:
    worst = np.where(np.isposinf(found.normalised), 1.0, found.normalised)
    return np.column_stack([worst, found.condition, found.volume, found.foot])


def reason(error: LegDynamicsError) -> str:
    """An error as one line: its class and its sentence."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
