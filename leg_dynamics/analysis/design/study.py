"""A design study as one value: what is varied, computed and demanded; and its rows, one design at a time."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from leg_dynamics.analysis.design.indices import (
    DEXTERITY,
    STEP,
    Sampler,
    dexterity_indices,
    half_widths,
    step_indices,
)
from leg_dynamics.analysis.design.inertia import Inertia, InertiaMap, inertia_of, learn_inertia
from leg_dynamics.analysis.design.motion import MOTION, motion_indices
from leg_dynamics.analysis.design.numbers import NumberMap, learn
from leg_dynamics.analysis.design.objectives import DEFAULT, Objective, objectives_of
from leg_dynamics.analysis.design.poses import Designs, Family, OnePose, Singles, reason, sign_of
from leg_dynamics.analysis.design.ranges import Filter, Range, check_names, sampled, swept
from leg_dynamics.analysis.workspace.constraints import constraints_of
from leg_dynamics.errors import LegDynamicsError, LegDynamicsWarning, ParameterError, StudyError

if TYPE_CHECKING:
    from leg_dynamics.analysis.trajectories import FootPath
    from leg_dynamics.leg import Leg

__all__ = ["Evaluator", "Plan", "Resolution", "Row", "Stage", "Study"]

TOLERANCE = 0.03
"""Of V, kbar and ktilde, relative, where none is asked for: ktilde decides, V and kbar are known to a few per mille."""

_FIRST, _LAST, _LAST_SINGLE = 10, 17, 13
"""Powers of two: samples of a design, from and to."""

_FORCES = frozenset({"peak_force", "peak_power"})
"""Objectives that need all numbers of a design, not only those of its kinematics."""

_TRIES = 20
_PILOTS, _LEAST_PILOT = 4, 0.2
"""Designs that the resolution is chosen by, beside that which the study starts from, and the least share of its V."""


@dataclass(frozen=True)
class Stage:
    """A stage of a study: a Monte Carlo over some parameters, or sweeps of single ones.

    Parameters
    ----------
    ranges : sequence of Range
        All with steps (each parameter is swept while the others stay), or all without (all are drawn together).
    samples : int
        Designs of a Monte Carlo.
    """

    ranges: tuple[Range, ...]
    samples: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranges", tuple(self.ranges))
        if not self.ranges:
            raise StudyError("a stage varies no parameter: give at least one range")
        if len({each.steps is None for each in self.ranges}) > 1:
            raise StudyError("a stage either sweeps or samples: give all ranges a number of steps, or none")
        if not self.is_sweep and (
            isinstance(self.samples, bool) or not isinstance(self.samples, int) or not 1 <= self.samples <= 10_000_000
        ):
            raise StudyError(f"samples = {self.samples!r} must be a whole number from 1 to 10,000,000")

    @property
    def is_sweep(self) -> bool:
        """Whether single parameters are swept."""
        return self.ranges[0].steps is not None

    def __len__(self) -> int:
        return sum(each.steps or 0 for each in self.ranges) if self.is_sweep else self.samples

    def designs(self, seed: int, number: int, rows: range) -> list[dict[str, float]]:
        """Designs of some rows, without what earlier stages chose."""
        if not self.is_sweep:
            return [sampled(self.ranges, seed, number, index) for index in rows]
        every = [design for each in self.ranges for design in swept(each)]
        return [every[index] for index in rows]


@dataclass(frozen=True)
class Study:
    """Everything that a study's table depends on.

    Parameters
    ----------
    leg : Leg
        With named parameters, by any route; the design that the study starts from.
    stages : sequence of Stage
        The second stage starts from the design that was chosen after the first, and so on (Rong 2012 section 6.1).
    objectives : sequence of str or Objective, optional
        See `leg_dynamics.analysis.design.objectives.BUILT_IN`.
    filters : sequence of Filter or str
        What an accepted design fulfils.
    choose : str
        ``median``: the accepted design nearest to the medians of the accepted parameters, in units of their ranges;
        ``min:NAME`` or ``max:NAME``: the accepted one with the best objective.
    seed : int
    tolerance : float
        Relative, of V, kbar and ktilde at 99 % confidence; the samples of a design follow from it.
    ignore : sequence of str
        Names or kinds of constraints to leave out.
    path : FootPath, optional
        Of the foot, for ``peak_force``, ``peak_speed`` and ``peak_power``.
    chunk : int
        Designs between two checkpoints.
    characteristic_length : float, optional
        m; makes rad and m comparable in the condition number.

    Raises
    ------
    ParameterError
        A parameter, objective or constraint does not exist, or a range is not usable.
    StudyError
        Anything else is not usable.
    """

    leg: Leg
    stages: tuple[Stage, ...]
    objectives: tuple[Any, ...] = ()
    filters: tuple[Any, ...] = ()
    choose: str = "median"
    seed: int = 0
    tolerance: float = TOLERANCE
    ignore: tuple[str, ...] = ()
    path: FootPath | None = None
    chunk: int = 25
    characteristic_length: float | None = None

    def __post_init__(self) -> None:
        leg = self.leg
        if not leg.parameters:
            raise ParameterError(
                f"{leg.name!r} has no named parameters to vary: load the xacro source that its file comes from"
            )
        if not self.stages:
            raise StudyError("a study needs a stage: something to vary or to sweep")
        for stage in self.stages:
            check_names("parameter", [each.name for each in stage.ranges], leg.parameters, leg.name)
        if len(self.stages) > 1 and any(stage.is_sweep for stage in self.stages):
            raise StudyError("sweeps choose no design that another stage could start from: sweep in a study of its own")
        check_names(
            "parameter in two stages,", [r.name for s in self.stages for r in s.ranges], leg.parameters, leg.name
        )
        constraints_of(leg.description, self.ignore)
        wanted = tuple(self.objectives) or (DEFAULT if len(leg.joint_names) == 3 else DEFAULT[:3])
        filters = tuple(each if isinstance(each, Filter) else Filter.parse(each) for each in self.filters)
        given = [each if isinstance(each, str) else each.name for each in wanted]
        # A filter on what was not asked for asks for it.
        wanted += tuple(dict.fromkeys(f.name for f in filters if f.name not in (*given, *leg.parameters)))
        objectives = objectives_of(leg, wanted, self.path is not None)
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or not 0 <= self.seed < 2**63:
            raise StudyError(f"seed = {self.seed!r} must be a whole number, not negative")
        if not (isinstance(self.tolerance, float) and 0.0 < self.tolerance < 1.0):
            raise StudyError(f"tolerance = {self.tolerance!r} must be a number between 0 and 1")
        if isinstance(self.chunk, bool) or not isinstance(self.chunk, int) or self.chunk < 1:
            raise StudyError(f"chunk = {self.chunk!r} must be a whole number, at least 1")
        rule, _, target = self.choose.partition(":")
        if self.choose != "median" and not (rule in ("min", "max") and target in {o.name for o in objectives}):
            raise StudyError(
                f"choose = {self.choose!r}: write median, or min:NAME or max:NAME with one of the objectives "
                f"{', '.join(o.name for o in objectives)}"
            )
        for name, value in (("stages", tuple(self.stages)), ("objectives", objectives), ("filters", filters)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "ignore", tuple(self.ignore))

    @property
    def varied(self) -> tuple[Range, ...]:
        """Ranges of all stages."""
        return tuple(each for stage in self.stages for each in stage.ranges)

    @property
    def columns(self) -> dict[str, str]:
        """Units of the varied parameters and the objectives, by name."""
        parameters = {each.name: self.leg.parameters[each.name].unit for each in self.varied}
        return parameters | {each.name: each.unit for each in self.objectives}

    def inputs(self) -> dict[str, Any]:
        """Everything that the table depends on, as JSON-ready values; the digest of it names the study."""
        from leg_dynamics.kernels.cache import key_of, source_fingerprint

        leg = self.leg
        rooms = ("analysis", "closed_form", "description", "kernels", "mechanism", "symbolic")
        path = None
        if self.path is not None:
            arrays = (self.path.time, self.path.position, self.path.velocity, self.path.acceleration)
            force = b"" if self.path.foot_force is None else self.path.foot_force.tobytes()
            path = key_of(*(array.tobytes() for array in arrays), force)
        return {
            "leg": leg.name,
            "route": leg.route,
            "mechanism": hashlib.sha256(leg.description.urdf.encode()).hexdigest(),
            "parameters": {name: each.value for name, each in leg.parameters.items()},
            "stages": [
                {"ranges": [str(each) for each in stage.ranges], "samples": len(stage)} for stage in self.stages
            ],
            "objectives": [each.fingerprint() for each in self.objectives],
            "filters": [str(each) for each in self.filters],
            "choose": self.choose,
            "seed": self.seed,
            "tolerance": self.tolerance,
            "ignore": list(self.ignore),
            "path": path,
            "chunk": self.chunk,
            "characteristic_length": self.characteristic_length,
            "code": key_of(*(source_fingerprint(f"leg_dynamics.{room}") for room in rooms)),
        }

    def digest(self) -> str:
        """Of `inputs`."""
        return hashlib.sha256(json.dumps(self.inputs(), sort_keys=True).encode()).hexdigest()

    def chunks(self, number: int) -> list[range]:
        """Rows of a stage, as they are computed together."""
        count = len(self.stages[number])
        return [range(start, min(start + self.chunk, count)) for start in range(0, count, self.chunk)]


class Resolution(NamedTuple):
    """Samples of a design, and the relative half widths (99 %) of the indices that some pilot designs have there."""

    samples: int
    half_widths: dict[str, float]
    pilots: int
    tolerance: float

    @property
    def reached(self) -> bool:
        """Whether all half widths are within the tolerance."""
        return bool(self.half_widths) and all(value <= self.tolerance for value in self.half_widths.values())

    @property
    def justification(self) -> str:
        """Why there are so many, in one sentence."""
        if not self.half_widths:
            return f"{self.samples:,} poses a design: no design of the ranges could be made to choose a number by"
        widths = ", ".join(f"{name} ± {100 * value:.2g} %" for name, value in self.half_widths.items())
        verdict = "within" if self.reached else "NOT within"
        return (
            f"{self.samples:,} poses a design: the spread of 16 independently scrambled Sobol sequences over "
            f"{self.pilots} pilot designs gives {widths} (99 % confidence, the worst design), {verdict} the "
            f"{100 * self.tolerance:g} % asked for"
        )


@dataclass(frozen=True)
class Plan:
    """A study, and what was found out before its first row; the same again whenever it is made again.

    Attributes
    ----------
    study : Study
    numbers : NumberMap or None
        None where each design is rendered: `why_single` says why.
    why_single : str
    sign : float
        Of det J of the poses that count.
    resolution : Resolution
    inertia : InertiaMap or None
        None where no objective needs masses, or where each design that they are asked of is rendered: `why_rendered`
        says why.
    why_rendered : str
    """

    study: Study
    numbers: NumberMap | None
    why_single: str
    sign: float
    resolution: Resolution
    inertia: InertiaMap | None = None
    why_rendered: str = ""

    @staticmethod
    def of(study: Study, say: Callable[[str, float], None] | None = None) -> Plan:
        """Find out how parameters act and which resolution the tolerance needs."""
        say = say or (lambda what, share: None)
        say("how the parameters act", 0.0)
        numbers: NumberMap | str = "the leg has not three coordinates"
        if len(study.leg.joint_names) == 3:
            numbers = learn(study.leg, study.varied, study.seed)
        found, why = (None, numbers) if isinstance(numbers, str) else (numbers, "")
        sign = sign_of(study.leg, study.ignore)
        draft = Plan(study, found, why, sign, Resolution(0, {}, 0, study.tolerance))
        draft = draft._with_inertia(say)
        say("resolution", 0.0)
        if not any(each.name in (*DEXTERITY, *STEP) for each in study.objectives):
            return draft
        return replace(draft, resolution=_resolution(study, draft.designs(), sign, single=found is None))

    @property
    def masses(self) -> str:
        """Where the masses of designs come from, in words; empty where no objective needs them."""
        if self.inertia is None:
            return self.why_rendered and f"each design rendered: {self.why_rendered}"
        terms, rendered = len(self.inertia.terms), self.inertia.rendered
        return f"learnt from {rendered} renderings (terms: {terms}), {self.inertia.checked} more agree"

    def _with_inertia(self, say: Callable[[str, float], None]) -> Plan:
        study, numbers = self.study, self.numbers
        wanted = {each.name for each in study.objectives}
        if not wanted & {*_FORCES, "mass"}:
            return self
        if numbers is None:
            return replace(self, why_rendered=self.why_single)
        say("how the parameters act on masses", 0.0)
        kinematic = [name.removeprefix("route ") for name in numbers.names if name.startswith("route ")]
        designs = sum(len(stage) for stage in study.stages)
        found = learn_inertia(
            study.leg, study.varied, kinematic, designs, study.seed, forces=not wanted.isdisjoint(_FORCES)
        )
        return replace(self, why_rendered=found) if isinstance(found, str) else replace(self, inertia=found)

    def designs(self) -> Designs:
        """Where poses come from."""
        study = self.study
        if self.numbers is None:
            return Singles(study.leg, study.ignore, study.characteristic_length)
        return Family(study.leg, self.numbers, study.ignore, study.characteristic_length)


def _resolution(study: Study, designs: Designs, sign: float, *, single: bool) -> Resolution:
    """Double the samples until the worst of some pilot designs is known to the tolerance."""
    import warnings

    # Of a workspace that is tiny in its box few samples are feasible: such designs are not what a study is about.
    ones, made = [designs.at({})], 0
    least = _LEAST_PILOT * dexterity_indices(ones[0], Sampler(len(ones[0].lower), 4096, 0).points, sign)[0]["V"]
    for index in range(_TRIES):
        if len(ones) == 1 + (1 if single else _PILOTS):
            break
        # not among the study's own designs, whose stages count from 0
        design = sampled([replace(each, steps=None) for each in study.varied], study.seed, 1_000_000, index)
        try:
            one = designs.at(design)
        except LegDynamicsError:
            continue
        made += 1
        if dexterity_indices(one, Sampler(len(one.lower), 4096, 0).points, sign)[0]["V"] > least:
            ones.append(one)
    if made == 0:
        return Resolution(1 << _FIRST, {}, 0, study.tolerance)
    last = _LAST_SINGLE if single else _LAST
    # L and Z are found by bisection: the samples only bound where they are looked for.
    wanted = [each.name for each in study.objectives]
    names = [name for name in DEXTERITY[:3] if name in wanted] or [DEXTERITY[0]]
    for power in range(_FIRST, last + 1):
        widths = half_widths(ones, names, 1 << power, sign, study.seed)
        found = Resolution(1 << power, widths, len(ones), study.tolerance)
        if found.reached:
            return found
    warnings.warn(
        f"{found.justification}: ask for a larger tolerance, or mind these errors", LegDynamicsWarning, stacklevel=4
    )
    return found


@dataclass(frozen=True)
class Row:
    """One design's row.

    Attributes
    ----------
    index : int
    design : dict of str to float
        Every varied parameter, those that earlier stages chose among them.
    status : str
        ``ok``, or ``failed`` with a `reason`.
    reason : str
        Class and sentence of the error.
    values : dict of str to float
        Objectives; NaN where one does not exist, or was not computed because the design fails a filter already. A
        failed design may have some: without a feasible home position it has a workspace and no step.
    accepted : bool
    """

    index: int
    design: dict[str, float]
    status: str
    reason: str
    values: dict[str, float]
    accepted: bool


class Evaluator:
    """Computes rows of one study; every process has its own.

    Parameters
    ----------
    plan : Plan
    """

    def __init__(self, plan: Plan) -> None:
        self.plan, self.study = plan, plan.study
        self.designs = plan.designs()
        leg = self.study.leg
        self.down = 1.0 if leg.gravity[2] >= 0.0 else -1.0
        count = plan.resolution.samples
        self.points = Sampler(len(leg.joint_names), count, self.study.seed).points if count else None

    def rows(self, number: int, chosen: Mapping[str, float], rows: range) -> list[Row]:
        """Rows of a stage that starts from what earlier ones chose."""
        found = self.study.stages[number].designs(self.study.seed, number, rows)
        return [self.row(index, {**chosen, **design}) for index, design in zip(rows, found, strict=True)]

    def row(self, index: int, design: Mapping[str, float]) -> Row:
        """Compute one design; what is impossible is a row too."""
        values = dict.fromkeys((each.name for each in self.study.objectives), math.nan)
        try:
            problem = self._compute(design, values)
        except LegDynamicsError as error:
            return Row(index, dict(design), "failed", reason(error), values, False)
        if problem:
            return Row(index, dict(design), "failed", problem, values, False)
        return Row(index, dict(design), "ok", "", values, self._passes(design, values))

    def _passes(self, design: Mapping[str, float], values: Mapping[str, float], only: Sequence[str] = ()) -> bool:
        """Whether filters hold: all, or those on parameters and `only` some objectives."""
        parameters = self.study.leg.parameters
        for each in self.study.filters:
            if each.name in values:
                if (not only or each.name in only) and not each.passes(values[each.name]):
                    return False
            elif not each.passes(design.get(each.name, parameters[each.name].value)):
                return False
        return True

    def _compute(self, design: Mapping[str, float], values: dict[str, float]) -> str:
        """Fill in the objectives, cheap ones first; returns what is wrong with the design, if anything."""
        wanted = set(values)
        known: list[str] = ["(parameters)"]
        one = self.designs.at(design)
        if wanted & {*DEXTERITY, *STEP}:
            assert self.points is not None
            found, box = dexterity_indices(one, self.points, self.plan.sign)
            values.update({name: value for name, value in found.items() if name in wanted})
            if box is None:
                return f"WorkspaceError: none of {len(self.points)} samples is feasible: the workspace is empty"
            if wanted & set(STEP):
                found |= step_indices(one, box, self.plan.sign, self.down)
            values.update({name: value for name, value in found.items() if name in wanted})
            known += [name for name in found if name in wanted]
        if not self._passes(design, values, known):
            return ""
        path = self.study.path
        if path is not None and wanted & set(MOTION):
            inertia = self._inertia(design, one) if wanted & _FORCES else None
            moved = motion_indices(self.designs, one, path, self.plan.sign, inertia)
            values.update({name: value for name, value in moved.items() if name in wanted})
            known += [name for name in moved if name in wanted]
            if not self._passes(design, values, known):
                return ""
        if "mass" in wanted:
            values["mass"] = self._inertia(design, one)().mass
            known.append("mass")
        for each in self.study.objectives:
            if each.function is not None and self._passes(design, values, known):
                values[each.name] = _own(each, one.leg())
                known.append(each.name)
        return ""

    def _inertia(self, design: Mapping[str, float], one: OnePose) -> Callable[[], Inertia]:
        """Masses of a design when called for: by the map, else from its file, rendered once for all objectives."""

        def found() -> Inertia:
            learnt = None if self.plan.inertia is None else self.plan.inertia(design)
            if learnt is not None:
                return learnt
            # only the forces of a family take numbers; another design has a leg of its own
            forces = self.plan.numbers is not None and not _FORCES.isdisjoint(
                each.name for each in self.study.objectives
            )
            return inertia_of(self.study.leg, one.description(), forces=forces)

        return found


def _own(objective: Objective, leg: Leg) -> float:
    """Value of a caller's function; what it raises becomes the reason of this design's row."""
    assert objective.function is not None
    try:
        value = objective.function(leg)
    except LegDynamicsError:
        raise
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise StudyError(f"objective {objective.name!r} fails: {type(error).__name__}: {error}") from error
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        raise StudyError(f"objective {objective.name!r} returned {type(value).__name__}, not a number")
    return float(value)
