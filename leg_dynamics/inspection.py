"""What is right and wrong about a mechanism file: counts and ranks, loops, links, limits, actuation, assembly modes.

The linter of closed-loop files. Everything is computed from the file; what cannot be is an error among the findings.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from leg_dynamics.errors import (
    DescriptionError,
    LegDynamicsError,
    LegDynamicsWarning,
    LegNotFoundError,
    MissingFootError,
    ParameterError,
)

if TYPE_CHECKING:
    from leg_dynamics.actuation import Actuation
    from leg_dynamics.description.fixes import Fixes
    from leg_dynamics.description.model import Description
    from leg_dynamics.leg import Leg
    from leg_dynamics.mechanism.mechanism import Mechanism
    from leg_dynamics.mechanism.mobility import MobilityReport
    from leg_dynamics.mechanism.modes import AssemblyMode

__all__ = ["Condition", "Finding", "Inspection", "LoopRedundancy", "inspect", "refused"]

_SEVERITIES = ("error", "warning", "note")
_PLACE = re.compile(r"^(?P<file>.*?):(?P<line>\d+): (?P<text>.*)$", re.DOTALL)
_HOPELESS = 1e-2
"""A home pose whose smallest singular value is below that share of the largest is a bad place to start from."""
_SHOWN = 6
_SMALLEST_MASS = 1e-6


@dataclass(frozen=True)
class Finding:
    """One thing that a reader of the file should know.

    Attributes
    ----------
    severity : str
        ``error``: no torque can be trusted, or none computed; ``warning``: one safe reading was taken, or some calls
        will fail; ``note``: good to know.
    code : str
        What kind of finding it is, for programs.
    text : str
        A sentence.
    fix : str
        What to do or to write into the file; empty where nothing need be done.
    file : str
    line : int or None
    """

    severity: str
    code: str
    text: str
    fix: str = ""
    file: str = ""
    line: int | None = None


@dataclass(frozen=True)
class LoopRedundancy:
    """Rows of one loop or coupling: `rows` in all, of which `needed` cannot be left out while all the others stay.

    `redundant` = rows - needed of them say what others say as well; `with_` names the loops that say it. Where no row
    is needed, the loop may be deleted. `simpler` is a loop type that would leave the same motion with fewer rows; empty
    where there is none, or where the whole loop may go.
    """

    loop: str
    type: str
    rows: int
    needed: int
    redundant: int
    with_: tuple[str, ...]
    simpler: str = ""


@dataclass(frozen=True)
class Condition:
    """Singular values of the closure at the home pose, dimensionless: how far it is from where modes meet."""

    smallest: float
    largest: float
    pose: Mapping[str, float]

    @property
    def share(self) -> float:
        """Smallest over largest."""
        return self.smallest / self.largest if self.largest > 0.0 else math.inf


@dataclass(frozen=True)
class Inspection:
    """Everything that was found out about a file.

    Attributes
    ----------
    source : str
    name : str
    description : Description or None
        None where the file could not be read.
    leg : Leg or None
        By route pinocchio; None where it could not be loaded.
    mobility : MobilityReport or None
    loops : tuple of LoopRedundancy
        At a generic closed pose.
    actuation : Actuation or None
    modes : tuple of AssemblyMode
    condition : Condition or None
    legs : mapping of str to (str or None)
        Of a robot with several: names and feet.
    findings : tuple of Finding
        Errors first.
    """

    source: str
    name: str
    description: Description | None
    leg: Leg | None
    mobility: MobilityReport | None
    loops: tuple[LoopRedundancy, ...]
    actuation: Actuation | None
    modes: tuple[AssemblyMode, ...]
    condition: Condition | None
    legs: Mapping[str, str | None]
    findings: tuple[Finding, ...]

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings that make torques impossible or doubtful."""
        return tuple(each for each in self.findings if each.severity == "error")

    @property
    def passed(self) -> bool:
        """Whether there is no error."""
        return not self.errors

    def to_dict(self) -> dict[str, Any]:
        """Everything as JSON-ready values."""
        condition = self.condition
        return {
            "source": self.source,
            "name": self.name,
            "passed": self.passed,
            "mobility": None if self.mobility is None else self.mobility.to_dict(),
            "loop_redundancy": [asdict(each) for each in self.loops],
            "actuation": None if self.actuation is None else self.actuation.to_dict(),
            "assembly_modes": [mode.to_dict() for mode in self.modes],
            "closure_condition": None
            if condition is None
            else {"smallest": condition.smallest, "largest": condition.largest, "pose": dict(condition.pose)},
            "legs": dict(self.legs),
            "findings": [asdict(each) for each in self.findings],
        }


def inspect(
    source: str | os.PathLike[str],
    *,
    foot: str | None = None,
    parameters: Mapping[str, float] | None = None,
    samples: int = 20,
    seed: int = 0,
) -> Inspection:
    """Look at a mechanism file from every side.

    Parameters
    ----------
    source, foot, parameters
        As for `leg_dynamics.load`.
    samples, seed : int
        Random closed poses at which ranks are taken, and their seed.

    Returns
    -------
    Inspection
        Also of a file that cannot be read or used: its errors are findings.

    Raises
    ------
    LegNotFoundError
        There is no such file or name.
    ParameterError, MissingFootError
        A parameter or the foot does not exist.
    """
    notes = _Notes()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = _inspected(source, foot, parameters, samples, seed, notes)
    notes.add_warnings(each.message for each in caught if isinstance(each.message, LegDynamicsWarning))
    for each in caught:
        if not isinstance(each.message, LegDynamicsWarning):
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
    return Inspection(**found, findings=notes.sorted())


def refused(source: str | os.PathLike[str], error: LegDynamicsError) -> Inspection:
    """The report of a source that `inspect` or `leg_dynamics.load` refuses: its one finding is the error."""
    notes = _Notes()
    notes.add_error(error)
    return Inspection(**_nothing(os.fspath(source)), findings=notes.sorted())


def _nothing(shown: str) -> dict[str, Any]:
    """What is known of a source before it is read."""
    return {
        "source": shown,
        "name": shown,
        "description": None,
        "leg": None,
        "mobility": None,
        "loops": (),
        "actuation": None,
        "modes": (),
        "condition": None,
        "legs": {},
    }


class _Notes:
    """Findings as they come."""

    def __init__(self) -> None:
        self._found: list[Finding] = []
        self.flags = ""

    def add(self, severity: str, code: str, text: str, fix: str = "", file: str = "", line: int | None = None) -> None:
        self._found.append(Finding(severity, code, text, fix, file, line))

    def add_error(self, error: LegDynamicsError) -> None:
        code = re.sub(r"(?<!^)(?=[A-Z])", "-", type(error).__name__.removesuffix("Error")).lower()
        file, line = getattr(error, "file", ""), getattr(error, "line", None)
        text = str(error).removeprefix(f"{file}:{line}: " if line is not None else f"{file}: ")
        self.add("error", code, text, "", file, line)

    def add_warnings(self, messages: Iterable[Any]) -> None:
        for text in dict.fromkeys(map(str, messages)):
            place = _PLACE.match(text)
            if place is None:
                file, _, rest = text.partition(": ")
                fix = self.flags if "as independent" in rest else ""
                self.add("warning", "reading", rest or text, fix, file if rest else "")
            else:
                self.add("warning", "reading", place["text"], "", place["file"], int(place["line"]))

    def sorted(self) -> tuple[Finding, ...]:
        return tuple(sorted(self._found, key=lambda each: _SEVERITIES.index(each.severity)))


def _inspected(
    source: Any,
    foot: str | None,
    parameters: Mapping[str, float] | None,
    samples: int,
    seed: int,
    notes: _Notes,
) -> dict[str, Any]:
    from leg_dynamics.description import read
    from leg_dynamics.description.fixes import fixes_of
    from leg_dynamics.routes import load, source_of

    shown = os.fspath(source) if not str(source).lstrip("\ufeff \n").startswith("<") else "<string>"
    found = _nothing(str(shown))
    try:
        # What `load` reads: a relative path would name the file differently in the same warnings.
        origin = source_of(source)
        description = read(origin, parameters=parameters)
        found["description"], found["name"] = description, description.name
        fixes = fixes_of(description)
        _look_at_links(description, fixes, notes)
        _look_at_limits(description, fixes, notes)
        _look_at_loops(description, fixes, notes)
        leg = load(origin, route="pinocchio", foot=foot, parameters=parameters)
    except (LegNotFoundError, ParameterError, MissingFootError):
        raise
    except LegDynamicsError as error:
        notes.add_error(error)
        return found
    found["leg"] = leg
    notes.flags = fixes.flags(leg.joint_names)
    found["description"] = leg.description
    found["legs"] = _legs(description, leg, notes)
    mechanism: Mechanism = leg.backend.mechanism  # type: ignore[attr-defined]
    try:
        found["mobility"] = leg.mobility_report(samples, seed)
        home = mechanism.seeds[0]
    except LegDynamicsError as error:
        notes.add_error(error)
        return found
    _look_at_mobility(found["mobility"], notes)
    found["loops"] = _redundancy(mechanism, seed)
    _look_at_redundancy(found["loops"], description, fixes, notes)
    sigma = mechanism.singular_values(home)
    if sigma.size:
        found["condition"] = condition = Condition(float(sigma[-1]), float(sigma[0]), mechanism.pose(home.y))
        if condition.share < _HOPELESS:
            notes.add(
                "warning",
                "nearly-singular-home",
                f"the home pose is nearly singular: smallest singular value of the closure {sigma[-1]:.3g} of "
                f"{sigma[0]:.3g}; it is near {mechanism.singular(home)}",
                fixes.other_home,
            )
    try:
        found["modes"] = leg.assembly_modes()
        found["actuation"] = leg.actuation
    except LegDynamicsError as error:
        notes.add_error(error)
    _look_at_home(leg, home.q, fixes, notes)
    if found["actuation"] is not None:
        _look_at_actuation(leg, found["actuation"], fixes, notes)
    _look_at_mass(leg, mechanism, home, notes)
    return found


# What the file alone shows.


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_SHOWN]) + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")


def _look_at_links(description: Description, fixes: Fixes, notes: _Notes) -> None:
    moving = {joint.child for joint in description.moving_joints}
    welded: dict[str, list[str]] = {joint.parent: [] for joint in description.joints}
    for joint in description.joints:
        if joint.type == "fixed":
            welded[joint.parent].append(joint.child)

    def body(link: str) -> list[str]:
        """The link and what is welded to it below."""
        found, pending = [], [link]
        while pending:
            found.append(pending.pop())
            pending += welded.get(found[-1], [])
        return found

    massless: list[str] = []
    pointlike: list[str] = []
    hollow: list[str] = []
    for name in sorted(moving, key=[link.name for link in description.links].index):
        parts = [description.link(each) for each in body(name)]
        mass = math.fsum(part.inertial.mass for part in parts if part.inertial is not None)
        turns = any(part.inertial is not None and part.inertial.tensor().any() for part in parts)
        spread = sum(part.inertial is not None and part.inertial.mass > 0.0 for part in parts) > 1
        if mass == 0.0:
            (hollow if turns else massless).append(name)
        elif not turns and not spread:
            pointlike.append(name)
    massless = fixes.own_links(massless)
    if massless:
        notes.add(
            "note",
            "massless-links",
            f"{len(massless)} moving link{'s have' if len(massless) > 1 else ' has'} no mass: {_listed(massless)}; "
            "they are taken as they are, and a motion that moves nothing else has no acceleration",
            fixes.inertial,
        )
    if hollow:
        notes.add(
            "warning",
            "inertia-without-mass",
            f"{_listed(hollow)}: rotary inertia without mass, as of a rotor whose mass is counted elsewhere",
            fixes.rotor,
        )
    if pointlike:
        notes.add("note", "point-masses", f"{_listed(pointlike)}: mass without rotary inertia", "")


def _look_at_limits(description: Description, fixes: Fixes, notes: _Notes) -> None:
    driven = {transmission.joint for transmission in description.transmissions}
    for code, what, fix, lacking in (
        (
            "no-position-limits",
            "joint{} without position limits",
            fixes.position_limits,
            [
                joint.name
                for joint in description.moving_joints
                if joint.type in ("revolute", "prismatic") and not _bounded(joint.limits)
            ],
        ),
        (
            "no-effort-limits",
            f"driven joint{{}} without effort{' or velocity' if fixes.has_velocity_limits else ''} limits",
            fixes.effort_limits,
            [
                joint.name
                for joint in description.moving_joints
                if joint.name in driven and not _is_rated(joint.limits, velocity=fixes.has_velocity_limits)
            ],
        ),
    ):
        if lacking:
            text = f"{len(lacking)} {what.format('s' * (len(lacking) > 1))}: {_listed(lacking)}"
            notes.add("note", code, text, fix)


def _bounded(limits: Any) -> bool:
    return math.isfinite(limits.lower) and math.isfinite(limits.upper)


def _is_rated(limits: Any, velocity: bool) -> bool:
    """Whether the effort, and where the language has it the velocity, is limited."""
    return math.isfinite(limits.effort) and (not velocity or math.isfinite(limits.velocity))


def _look_at_loops(description: Description, fixes: Fixes, notes: _Notes) -> None:
    if not description.loops and not description.couplings:
        named = [
            link.name for link in description.links if re.search(r"closed?_?loop|loop_?(joint|end)", link.name, re.I)
        ]
        if named:
            notes.add(
                "warning",
                "unbound-loops",
                f"the file closes no loop, but links are named as if they did: {_listed(named)}",
                fixes.loops,
            )


def _legs(description: Description, leg: Leg, notes: _Notes) -> Mapping[str, str | None]:
    from leg_dynamics.description.legs import legs_of

    legs: Mapping[str, str | None] = {}
    with contextlib.suppress(DescriptionError):
        legs = {name: part.foot for name, part in legs_of(description).items()}
    if leg.foot is None:
        if legs:
            fix = "take one leg: " + _listed([f'.leg("{name}")' for name in legs])
        else:
            parents = {joint.parent for joint in description.joints}
            ends = [link.name for link in description.links if link.name not in parents]
            fix = "name one: " + _listed([f"foot={name!r}" for name in ends])
        notes.add("note", "no-foot", "no foot is named: foot positions, Jacobians and forces need one", fix)
    return legs


# What the closed mechanism shows.


def _look_at_mobility(report: MobilityReport, notes: _Notes) -> None:
    special = [pose for pose in report.special_poses if not pose.pose.startswith("random")]
    for pose in special:
        notes.add(
            "warning",
            "special-pose",
            f"configuration {pose.pose!r} is a singular pose: mobility {pose.mobility} there, {report.mobility} at "
            "generic poses",
            "start from another configuration",
        )
    if report.gruebler != report.mobility:
        redundant = f"{report.redundant} row{'s are' if report.redundant > 1 else ' is'} redundant"
        notes.add(
            "note",
            "overconstrained",
            f"Gruebler's count gives {report.gruebler} ({report.joints} joints - {report.rows} rows), the rank of the "
            f"rows {report.mobility}: {redundant}, so that loop forces are not unique; motor torques are not affected",
        )


def _generic_rows(mechanism: Mechanism, seed: int) -> np.ndarray:
    """Loop rows K at a closed pose beside home, columns dimensionless."""
    from leg_dynamics.mechanism.mobility import project

    generator = np.random.default_rng(seed)
    home, unit = mechanism.seeds[0], mechanism.closure.coordinate_unit
    for spread in (0.1, 0.03, 0.01, 0.0):
        closed = project(mechanism, home.q + spread * unit * generator.standard_normal(mechanism.nv))
        if closed is not None:
            return np.asarray(mechanism.evaluate(closed).jacobian * unit)
    return np.asarray(home.rows.jacobian * unit)


def _rank(K: np.ndarray, share: float) -> int:
    return int(np.linalg.matrix_rank(K, tol=max(1e-7, share))) if K.size else 0


def _redundancy(mechanism: Mechanism, seed: int) -> tuple[LoopRedundancy, ...]:
    closure = mechanism.closure
    if not closure.rows:
        return ()
    K = _generic_rows(mechanism, seed)
    owner = np.array(closure.row_owner)
    share = mechanism.rank_share
    whole = _rank(K, share)
    types = {loop.name: loop.type for loop in closure.loops}
    found = []
    left = np.linalg.svd(K.T)[2][whole:] if whole < len(K) else np.zeros((0, len(K)))
    for name in dict.fromkeys(closure.row_owner):
        mine = owner == name
        needed = whole - _rank(K[~mine], share)
        rows = int(mine.sum())
        redundant = rows - needed
        shares = {}
        if redundant:
            # Dependencies among the rows in which this loop takes part, and the loops that take part with it.
            _, sigma, mixed = np.linalg.svd(left[:, mine].T, full_matrices=True)
            taking = mixed[: int(np.count_nonzero(sigma > max(1e-6, share)))] @ left
            for other in dict.fromkeys(closure.row_owner):
                if other != name and taking.size and np.abs(taking[:, owner == other]).max() > max(1e-6, 10.0 * share):
                    shares[other] = True
        simpler = ""
        kind = types.get(name, "coupling")
        if needed and redundant and kind in ("revolute", "continuous", "fixed", "universal"):
            # A spherical pair has the first three rows of these.
            kept = np.flatnonzero(mine)[:3]
            if _rank(np.vstack([K[~mine], K[kept]]), share) == whole:
                simpler = "spherical"
        found.append(LoopRedundancy(name, kind, rows, needed, redundant, tuple(shares), simpler))
    return tuple(found)


def _look_at_redundancy(loops: Sequence[LoopRedundancy], description: Description, fixes: Fixes, notes: _Notes) -> None:
    lines = {loop.name: loop.line for loop in description.loops}
    lines |= {coupling.name: coupling.line for coupling in description.couplings}
    told = [each for each in loops if each.simpler or not each.needed]
    for each in told:
        if each.needed:
            fix = fixes.spherical(each.loop) + (", with the other loops as they are" if len(told) > 1 else "")
        else:
            fix = f"{fixes.deletion(each.loop)}: the others leave the same motion" + (
                f"; only one of {_listed((each.loop, *each.with_))}, then look again" if each.with_ else ""
            )
        kind = "coupling" if each.type == "coupling" else f"loop {each.loop!r} ({each.type})"
        notes.add(
            "note",
            "redundant-loop-rows",
            f"{f'coupling {each.loop!r}' if kind == 'coupling' else kind} has {each.rows} row{'s' * (each.rows != 1)}, "
            + ("all redundant" if not each.needed else f"{each.redundant} of them redundant")
            + (f" with {_listed(each.with_)}" if each.with_ else ""),
            fix,
            description.file,
            fixes.line(lines.get(each.loop)),
        )


def _look_at_home(leg: Leg, q: np.ndarray, fixes: Fixes, notes: _Notes) -> None:
    if not (fixes.description.loops or fixes.description.couplings):
        return
    from leg_dynamics.mechanism.assembly import close_configuration

    mechanism = leg.backend.mechanism  # type: ignore[attr-defined]
    home = leg.description.home
    if home is not None and close_configuration(mechanism, home) is not None:
        return
    what = "states no configuration" if home is None else f"has an open or singular configuration {home.name!r}"
    notes.add(
        "warning",
        "no-home",
        f"the file {what}: which assembly mode is meant was chosen from its geometry",
        fixes.home(dict(zip(leg.tree_joint_names, q.tolist(), strict=True))),
    )


def _look_at_actuation(leg: Leg, verdict: Actuation, fixes: Fixes, notes: _Notes) -> None:
    from leg_dynamics.description.topology import actuated_joints

    description = fixes.description
    if verdict.idle:
        joints = [name for name in verdict.idle if leg.description.joint(name).driven]
        fix = "allow_idle=True gives efforts and the residual; generalized_force is always unique" + (
            f"; or drive {', '.join(joints)}" if joints else ""
        )
        notes.add("warning", "under-actuated", str(verdict), fix)
    elif verdict.kind != "exact":
        fix = "efforts are those of smallest norm; torque takes weights, bounds and preload"
        notes.add("note", "redundantly-actuated", str(verdict), fix)
    if not description.transmissions and description.driven != "none":
        # All of them: a file with some transmissions has no others.
        names = actuated_joints(leg.description)
        text = "no joint is said to be driven: the independent ones are taken"
        if len(names) < len(leg.joint_names):
            text += ", but for " + _listed([name for name in leg.joint_names if name not in names])
        if names and not fixes.names_joints:
            text += "; a joint that has no name in the file has to get the one used here"
        notes.add("note", "no-transmissions", text, fixes.motors(names) if names else "")


def _look_at_mass(leg: Leg, mechanism: Mechanism, home: Any, notes: _Notes) -> None:
    M = mechanism.mass_matrix(home)
    scale = np.sqrt(np.abs(np.diagonal(M)))
    weightless = [name for name, s in zip(leg.joint_names, scale, strict=True) if s == 0.0]
    direction: dict[str, float] = {}
    if not weightless:
        values, vectors = np.linalg.eigh(M / np.outer(scale, scale))
        if values[0] < _SMALLEST_MASS:
            vector = vectors[:, 0] / np.abs(vectors[:, 0]).max()
            direction = {n: x for n, x in zip(leg.joint_names, vector.tolist(), strict=True) if abs(x) > 0.05}
        if values[0] < -1e-9:
            notes.add(
                "error",
                "negative-mass",
                f"the mass matrix is not positive definite at home: smallest eigenvalue {values[0]:.3g} of 1 along "
                + ", ".join(f"{n} {x:+.3g}" for n, x in direction.items()),
                "correct the links' inertia",
            )
            return
    if weightless or direction:
        what = _listed(weightless) if weightless else ", ".join(f"{n} {x:+.3g}" for n, x in direction.items())
        notes.add(
            "warning",
            "motion-without-mass",
            f"a motion carries no mass ({what}): torque works, forward dynamics (acceleration) does not",
            "give the links that it moves, or the rotors, their inertia",
        )
