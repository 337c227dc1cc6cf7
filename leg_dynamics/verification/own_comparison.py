"""Own formulas against a leg's file: what disagrees, where, by how much, and what is the cause of what."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from leg_dynamics.errors import LegDynamicsError, ParameterError
from leg_dynamics.verification.comparison import ROUTE_TOLERANCE, Progress, on_one_sheet, relative
from leg_dynamics.verification.diagnosis import LEAST_STATES, Entries, agree, diagnose, orders
from leg_dynamics.verification.first_principles import DIFFERENCE_TOLERANCE, gradient, loop_residual, slope
from leg_dynamics.verification.own_formulas import (
    METHODS,
    QUANTITIES,
    Inputs,
    Observed,
    OwnFormulas,
    Quantity,
    Raised,
    Values,
    side_of_all,
)
from leg_dynamics.verification.report import OWN_GROUP, Check, OwnCheck, OwnFormulasReport
from leg_dynamics.verification.states import ROOM_SHARE, States, smallest_singular_values, with_room

__all__ = ["hold"]

DIFFERENCE_SAMPLES = 50
DIAGNOSED_SAMPLES = 50
"""States, and as many failing ones, at which the reference is asked for its terms, and own formulas at other angles."""
CLOSED = 1e-9
"""Loop residual, m or rad, of joint angles that close the loops."""
EFFORT = 10.0
"""N·m or N, of the efforts that forward dynamics is compared at."""

OBSERVED = 3
"""States at which the methods that a method calls are looked for."""
TRIED = 12
"""States at which other orders of the joints' names are tried first."""

_FORCE_TERM = "the foot force's term"
_EXCHANGED = "agrees when the coordinates"
_VARIANTS = {"": "", "foot_force": " with foot force", "gravity": ", tilted"}

Key = tuple[str, str]


@dataclass(frozen=True)
class _Case:
    """One method, with or without loads, by the own formulas and by the reference."""

    key: Key
    inputs: Inputs
    own: np.ndarray
    reference: np.ndarray
    complaint: str


@dataclass(frozen=True)
class _Relation:
    """What own results `upstream` say of the own result `target`: both sides at coordinates q (k, n)."""

    target: Key
    upstream: tuple[Key, ...]
    statement: str
    left: np.ndarray
    right: np.ndarray
    q: np.ndarray
    entries: Entries
    tolerance: float

    @property
    def negated(self) -> str:
        return re.sub(r"^(is|has)\b", r"\1 not", self.statement)


def hold(
    formulas: OwnFormulas,
    states: States,
    samples: int,
    seed: int,
    counts: tuple[int, int],
    tolerance: float | None,
    tell: Progress,
) -> OwnFormulasReport:
    """Hold own formulas against the leg they belong to.

    Parameters
    ----------
    formulas : OwnFormulas
    states : States
        Where; all can be assembled.
    samples, seed : int
        As asked for, for the report.
    counts : (int, int)
        States that were left out since they cannot be assembled, or are nearly singular.
    tolerance : float, optional
        Relative to 1 + magnitude.
    tell : callable

    Returns
    -------
    OwnFormulasReport

    Raises
    ------
    ParameterError
        The tolerance is not a positive number.
    """
    return _Comparison(formulas, states, _checked_tolerance(tolerance), tell).report(samples, seed, counts)


def _checked_tolerance(tolerance: Any) -> float:
    if tolerance is None:
        return ROUTE_TOLERANCE
    number = isinstance(tolerance, (int, float, np.number)) and not isinstance(tolerance, bool)
    if not (number and 0.0 < tolerance < 1.0):
        raise ParameterError(
            f"tolerance must be a number between 0 and 1, relative to 1 + magnitude, got {tolerance!r}",
            parameter="tolerance",
        )
    return float(tolerance)


class _Comparison:
    def __init__(self, formulas: OwnFormulas, states: States, tolerance: float, tell: Progress) -> None:
        self.formulas, self.leg, self.tolerance, self.tell = formulas, formulas.reference, tolerance, tell
        self.states = states
        count, m = len(states), len(self.leg.actuator_names)
        gravity = np.broadcast_to(formulas.gravity, (count, 3))
        tau = EFFORT * np.sin(np.arange(count * m, dtype=float)).reshape(count, m)
        self.inputs = Inputs(states.q, states.v, states.a, tau, gravity)
        self.cases: dict[Key, _Case] = {}
        self.not_compared: dict[str, str] = {}
        self.raised: dict[Key, tuple[Raised, ...]] = {}
        self.bad: dict[Key, np.ndarray] = {}
        self.statements: dict[Key, str] = {}
        self.called: dict[str, str] = {}
        self._known_calls: dict[str, frozenset[str]] = {}

    def report(self, samples: int, seed: int, counts: tuple[int, int]) -> OwnFormulasReport:
        formulas = self.formulas
        checks = self._against_the_file()
        self.tell("own formulas among themselves", 0.7)
        checks = self._with_names_exchanged(checks) or self._explained(checks)
        checks = [*self._not_callable(), *checks]
        return OwnFormulasReport(
            f"{formulas.name} against {self.leg.name} by {self.leg.route}",
            ("own formulas", self.leg.route),
            samples,
            seed,
            tuple[Check, ...](checks),
            len(self.states),
            *counts,
            tuple(name for name in METHODS if name not in formulas.methods and name not in self.called),
            self.not_compared,
            tuple(formulas.notes),
        )

    def _against_the_file(self) -> list[OwnCheck]:
        checks: list[OwnCheck] = []
        given = [name for name in METHODS if name in self.formulas.methods]
        for number, name in enumerate(given):
            self.tell(name, 0.7 * number / len(given))
            if name == "assemble":
                checks += self._assemble()
            elif name == "inverse_kinematics":
                checks += self._inverse_kinematics()
            else:
                checks += self._compared(QUANTITIES[name])
        return checks

    def _not_callable(self) -> Iterator[OwnCheck]:
        """Failing rows of what another method calls and is no method; a note of each that none calls."""
        nowhere = dict.fromkeys(self.leg.joint_names, np.nan)
        for name, kind in self.formulas.not_callable.items():
            if name not in self.called:
                if kind != "NoneType":
                    self.formulas.notes.append(f"{name} is no method but {kind}, and was left out")
                continue
            yield OwnCheck(
                "against the file",
                QUANTITIES[name].title,
                np.nan,
                self.tolerance,
                len(self.states),
                nowhere,
                detail=f"is no method but {kind}, and {self.called[name]} calls it",
                method=name,
                equation=self.formulas.equations.get(name, ""),
                share=1.0,
            )

    # ------------------------------------------------------------------ one method

    def _reference(self, name: str, inputs: Inputs) -> np.ndarray:
        quantity = QUANTITIES[name]
        options: dict[str, Any] = {option: getattr(inputs, option) for option in quantity.options}
        arguments = (getattr(inputs, argument) for argument in quantity.arguments)
        return np.asarray(getattr(self.leg, name)(*arguments, **options, on_error="nan"))

    def _compared(self, quantity: Quantity) -> Iterator[OwnCheck]:
        name, accepted = quantity.method, self.formulas.methods[quantity.method].options
        variants = {"": self.inputs}
        if "foot_force" in accepted and self.leg.foot is not None:
            variants["foot_force"] = replace(self.inputs, foot_force=self.states.foot_force)
        if "gravity" in accepted:
            variants["gravity"] = replace(self.inputs, gravity=self.states.gravity)
        for variant, every in variants.items():
            inputs = every
            try:
                reference = self._reference(name, inputs)
            except LegDynamicsError as error:
                self.not_compared[name] = str(error)
                own = self.formulas.values(name, inputs, with_gravity=variant == "gravity")
                if variant and self._not_taken(name, variant, own):
                    continue
                self.raised[name, variant] = own.raised
                self.cases[name, variant] = _Case((name, variant), inputs, own.array, own.array, own.complaint)
                if own.complaint:
                    yield self._check(self.cases[name, variant], quantity.title + _VARIANTS[variant])
                continue
            known = np.flatnonzero(np.isfinite(reference).reshape(len(reference), -1).all(axis=1))
            if len(known) == 0:
                self.not_compared[name] = "the reference has no number at any of the states"
                continue
            inputs = every.take(known)
            own = self.formulas.values(name, inputs, with_gravity=variant == "gravity")
            if variant and self._not_taken(name, variant, own):
                continue
            self.raised[name, variant] = own.raised
            case = _Case((name, variant), inputs, own.array, reference[known], own.complaint)
            self.cases[case.key] = case
            check = self._check(case, quantity.title + _VARIANTS[variant])
            yield check if check.passed else replace(check, diagnosis=tuple(self._diagnoses(quantity, case)))

    def _not_taken(self, name: str, option: str, own: Values) -> bool:
        """Note that a method which takes any name hands an option on to something that does not take it."""
        if not self.formulas.methods[name].any_name or not own.raised:
            return False
        if any(each.kind != "TypeError" or f"keyword argument '{option}'" not in each.text for each in own.raised):
            return False
        said = option.replace("_", " ")
        self.formulas.notes.append(
            f"{said} was not compared in {name}: called with {option}, it raised TypeError: {own.raised[0].text}"
        )
        return True

    def _check(self, case: _Case, title: str) -> OwnCheck:
        entries = self.formulas.entries(case.key[0])
        self.bad[case.key] = ~(relative(case.own, case.reference, case.own.ndim - 1) <= self.tolerance)
        detail = case.complaint
        group = "against the file"
        return self._made(
            group, case.key[0], title, case.own, case.reference, case.inputs.q, entries, self.tolerance, detail
        )

    def _made(
        self,
        group: str,
        name: str,
        title: str,
        own: np.ndarray,
        reference: np.ndarray,
        q: np.ndarray,
        entries: Entries,
        tolerance: float,
        detail: str = "",
    ) -> OwnCheck:
        errors = relative(own, reference, own.ndim - 1)
        row = int(np.argmax(np.where(np.isnan(errors), np.inf, errors)))
        component, values = "", (np.nan, np.nan)
        if not np.isnan(errors[row]):
            index = np.unravel_index(int(np.argmax(np.abs(own[row] - reference[row]))), own.shape[1:])
            component = entries.name([int(i) for i in index])
            values = float(own[row][index]), float(reference[row][index])
        at = {joint: float(x) for joint, x in zip(self.leg.joint_names, q[row], strict=True)}
        return OwnCheck(
            group,
            title,
            float(errors[row]),
            tolerance,
            len(errors),
            at,
            detail=detail,
            method=name,
            equation=self.formulas.equations.get(name, ""),
            component=component,
            own=values[0],
            reference=values[1],
            share=float((~(errors <= tolerance)).mean()),
        )

    # ------------------------------------------------------------------ what is wrong with it

    def _diagnoses(self, quantity: Quantity, case: _Case) -> Iterator[str]:
        name, variant = case.key
        entries = self.formulas.entries(name)
        if agree(case.own, case.reference, self.tolerance):  # then all that is wrong is where there is no number
            yield "agrees wherever there are numbers"
            return
        magnitude = float(np.linalg.norm(self.formulas.gravity))
        factors = {}
        if "gravity" in quantity.options and magnitude > 0.0:
            factors = {1.0 / magnitude: "1/g times (g is missing)", magnitude: "g times"}
        text = diagnose(case.own, case.reference, entries, self.tolerance, factors=factors)
        few = self._some_of(case)
        if not text or "no simple relation" in text:
            closer = self._misread_angles(few) if name == "foot_position" else ""
            if not closer:
                terms = self._terms(few)
                closer = diagnose(few.own, few.reference, entries, self.tolerance, terms=terms, factors=factors)
            text = closer or text
        if text:
            self.statements[case.key] = text
            yield text
        if f"wrong sign of {_FORCE_TERM}" in text:
            by = " by 2 J^T foot_force" if name in ("torque", "generalized_force") else ""
            yield f"own values differ{by}: foot_force is what the environment applies to the foot"
        symmetric = 0.5 * (case.own + case.own.swapaxes(1, 2)) if name == "mass_matrix" else None
        if symmetric is not None and agree(symmetric, case.reference, self.tolerance):  # on rows of numbers
            yield "the symmetric part agrees: the own matrix is not symmetric"
        base = self.cases.get((name, ""))
        if variant and base is not None and len(base.own) == len(case.own):
            if agree(case.own, base.own, self.tolerance):
                yield f"the argument {variant} changes nothing"
            elif agree(base.own, base.reference, self.tolerance):
                yield {"foot_force": "agrees without foot force", "gravity": "agrees with the file's gravity"}[variant]
        if not text:
            yield from self._agreements(quantity, few)
            errors = relative(case.own, case.reference, case.own.ndim - 1)
            if np.isfinite(errors).all():
                region = side_of_all(np.flatnonzero(errors > self.tolerance), case.inputs.q, self.leg.joint_names)
                if region:
                    yield f"disagrees at{region.removeprefix(', all')}, and nowhere else"
                yield from self._agreeing_entries(case, entries)

    def _some_of(self, case: _Case) -> _Case:
        """Some states from everywhere, and some of those that fail."""
        errors = relative(case.own, case.reference, case.own.ndim - 1)
        chosen = []
        for rows in (np.arange(len(errors)), np.flatnonzero(errors > self.tolerance)):
            spread = np.linspace(0, max(0, len(rows) - 1), min(len(rows), DIAGNOSED_SAMPLES)).round().astype(np.intp)
            chosen.append(rows[spread])
        rows = np.unique(np.concatenate(chosen))
        return replace(case, inputs=case.inputs.take(rows), own=case.own[rows], reference=case.reference[rows])

    def _agreeing_entries(self, case: _Case, entries: Entries) -> Iterator[str]:
        scale = 1.0 + np.maximum(np.abs(case.own), np.abs(case.reference)).reshape(len(case.own), -1).max(axis=1)
        off = np.abs(case.own - case.reference) > self.tolerance * scale.reshape(-1, *(1,) * (case.own.ndim - 1))
        differing = off.any(axis=0)
        if case.own.ndim > 1 and not differing.all():
            yield f"only {entries.listed(differing, np.zeros_like(differing))} off, the other entries agree"

    def _agreements(self, quantity: Quantity, case: _Case) -> Iterator[str]:
        """In which special states own values agree."""
        reductions = {
            "v": "agrees at v = 0: the velocity terms are wrong",
            "a": "agrees at a = 0: the inertia term is wrong",
            "gravity": "agrees without gravity: the gravity term is wrong",
        }
        if quantity.method in ("jacobian_derivative", "foot_velocity", "kinetic_energy"):  # zero at v = 0
            return
        for argument, sentence in reductions.items():
            is_gravity = argument == "gravity"
            if is_gravity:
                usable = "gravity" in self.formulas.methods[quantity.method].options and len(quantity.arguments) > 1
            else:
                usable = argument in quantity.arguments
            if usable:
                inputs = case.inputs.without(argument)
                own = self.formulas.values(quantity.method, inputs, with_gravity=is_gravity or case.key[1] == "gravity")
                if agree(own.array, self._reference(quantity.method, inputs), self.tolerance):
                    yield sentence

    def _terms(self, case: _Case) -> Iterator[dict[str, np.ndarray]]:
        """Parts of the reference that formulas may lack or have with the wrong sign, coarse ones first."""
        name, inputs = case.key[0], case.inputs

        def value(*without: str) -> np.ndarray:
            return self._reference(name, inputs.without(*without))

        if name == "foot_acceleration":
            yield {"J a": value() - value("a"), "Jdot v": value("a")}
            return
        if name not in ("bias", "generalized_force", "torque", "acceleration"):
            return
        drive = {"bias": (), "acceleration": ("tau",)}.get(name, ("a",))
        still = value("v", *drive, "foot_force")
        unloaded = value(*drive, "foot_force")
        gravity = {"the gravity term": still - value("v", *drive, "foot_force", "gravity")}
        driven = {}
        if drive:
            term = "the inertia term M a" if drive == ("a",) else "the actuators' term"
            driven[term] = value("foot_force") - unloaded
        if inputs.foot_force is not None:
            driven[_FORCE_TERM] = value() - value("foot_force")
        yield gravity | {"the velocity terms": unloaded - still} | driven
        squares = np.zeros_like(still)
        for joint in range(inputs.v.shape[1]):
            alone = np.zeros_like(inputs.v)
            alone[:, joint] = inputs.v[:, joint]
            squares += self._reference(name, replace(inputs, v=alone).without(*drive, "foot_force")) - still
        products = unloaded - still - squares
        split = {"the terms of one speed (squares)": squares, "the terms of two speeds (products)": products}
        yield gravity | split | driven

    def _misread_angles(self, case: _Case) -> str:
        """With which other meaning of the joint coordinates the own foot position is right."""
        q = case.inputs.q
        joints = self.leg.joint_names
        turning = np.array([unit == "rad" for unit in self.leg.units.joints])
        meanings = [
            ("true if the angles were in degrees", np.where(turning, np.degrees(q), q)),
            ("true if the angles were converted to degrees once more", np.where(turning, np.radians(q), q)),
        ]
        for i, joint in enumerate(joints):
            other = q.copy()
            other[:, i] = -q[:, i]
            meanings.append((f"true if {joint} counted in the opposite direction", other))
        for i, j in itertools.permutations(np.flatnonzero(turning).tolist(), 2):
            for sign, word in ((-1.0, "+"), (1.0, "-")):
                other = q.copy()
                other[:, i] = q[:, i] + sign * q[:, j]
                sentence = f"true if {joints[i]} were {joints[i]} {word} {joints[j]}: absolute and relative angle"
                meanings.append((sentence, other))
        for order in orders(len(joints)):
            moved = ", ".join(joint for joint, place in zip(joints, order, strict=True) if joint != joints[place])
            what = "are exchanged" if sum(i != j for i, j in enumerate(order)) == 2 else "are in another order"
            meanings.append((f"{_EXCHANGED} {moved} {what}", q[:, list(order)]))
        for sentence, other in meanings:
            if agree(self._own("foot_position", case.inputs.at(other)), case.reference, self.tolerance):
                return sentence
        return ""

    # ------------------------------------------------------------------ the two that are not compared entry by entry

    def _assemble(self) -> Iterator[OwnCheck]:
        q, leg = self.inputs.q, self.leg
        result, names = self.formulas.coordinates(q)
        self.raised["assemble", ""] = result.raised
        expected = leg.assemble(q, on_error="nan")
        whole = np.stack([expected[name] for name in leg.tree_joint_names], axis=-1)
        own = raw = whole.copy()
        columns = [leg.tree_joint_names.index(name) for name in names]
        if names:
            own[:, columns] = result.array
            raw = own.copy()
        else:
            own[:] = np.nan
        reference, own = on_one_sheet(leg, whole, own)
        shown = columns if names else list(range(len(leg.tree_joint_names)))
        own, reference = own[:, shown], reference[:, shown]
        entries = Entries("{}", (tuple(leg.tree_joint_names[i] for i in shown),))
        key = ("assemble", "")
        self.cases[key] = _Case(key, self.inputs, own, reference, result.complaint)
        self.bad[key] = ~(relative(own, reference, 1) <= self.tolerance)
        title, partly = self._compared_joints(names)
        detail = "; ".join(text for text in (result.complaint, partly) if text)
        check = self._made("against the file", "assemble", title, own, reference, q, entries, self.tolerance, detail)
        if not check.passed:
            # First as they are: moved by whole turns they are no multiples any more.
            text = diagnose(raw[:, shown], reference, entries, self.tolerance)
            diagnosis = [text or diagnose(own, reference, entries, self.tolerance)]
            mixed = self._other_coordinates(shown, own, reference) if names else ""
            if mixed:  # the pose of other coordinates, of which nothing else can be said
                diagnosis = [mixed]
            elif names == leg.tree_joint_names and np.isfinite(own).all():
                residual = loop_residual(leg.description, dict(zip(names, own.T, strict=True)))
                if residual.max() <= CLOSED:
                    diagnosis = ["these close the loops too: another assembly mode than the file's configuration"]
            check = replace(check, diagnosis=tuple(text for text in diagnosis if text))
        yield check

    def _compared_joints(self, names: Sequence[str]) -> tuple[str, str]:
        """What the coordinates of some joints are called, and what is said of those that are missing."""
        leg, whole = self.leg, QUANTITIES["assemble"].title
        missing = [name for name in leg.tree_joint_names if name not in names]
        if not names or not missing:
            return whole, ""
        text = f"compared: {', '.join(names)}; not given: {', '.join(missing)}"
        if set(names) <= set(leg.joint_names) < set(leg.tree_joint_names):
            title = f"independent coordinates alone: {', '.join(names)}"
            text += ", so that nothing shows how the loops close"
        else:
            title = f"{whole}: {', '.join(names)}"
        self.formulas.notes.append(f"assemble: {text}")
        return title, text

    def _other_coordinates(self, shown: Sequence[int], own: np.ndarray, reference: np.ndarray) -> str:
        """How the independent coordinates of `assemble` differ from those that it was called with."""
        leg = self.leg
        names = [leg.tree_joint_names[place] for place in shown]
        columns = [column for column, name in enumerate(names) if name in leg.joint_names]
        given, asked = own[:, columns], reference[:, columns]
        with np.errstate(invalid="ignore"):
            off = np.abs(given - asked) > self.tolerance * (1.0 + np.maximum(np.abs(given), np.abs(asked)))
        if not off.any():
            return ""
        row, column = np.argwhere(off)[0]
        independent = tuple(names[place] for place in columns)
        text = diagnose(given, asked, Entries("{}", (independent,)), self.tolerance)
        order = ", ".join(leg.joint_names[place] for place in self.formulas.order)
        parts = [
            f"other independent coordinates than it was called with: {independent[column]} = "
            f"{given[row, column]:.6g} where {asked[row, column]:.6g} was given",
            text,
            f"it was called with q = ({order})",
        ]
        if any(agree(given, asked[:, list(other)], self.tolerance) for other in orders(len(columns))):
            parts.append("joint_names and the order in which it takes q do not fit together")
        return "; ".join(part for part in parts if part)

    def _inverse_kinematics(self) -> Iterator[OwnCheck]:
        leg, q = self.leg, self.inputs.q
        inside = np.flatnonzero(((q >= leg.limits.lower) & (q <= leg.limits.upper)).all(axis=1))
        name = "inverse_kinematics"
        if len(inside) == 0:
            self.not_compared[name] = "no state is inside the joint limits"
            return
        inputs = self.inputs.take(inside)
        inputs = replace(inputs, p=leg.foot_position(inputs.q, on_error="nan"))
        assert inputs.p is not None
        own = self.formulas.values(name, inputs)
        self.raised[name, ""] = own.raised
        reached = leg.foot_position(own.array, on_error="nan")
        entries = Entries("foot {} reached", (self.formulas.size("foot"),))
        lost = np.isnan(reached).any(axis=1) & np.isfinite(own.array).all(axis=1)
        detail = own.complaint
        if lost.any():
            more = f"the leg cannot be assembled at the joint coordinates found, at {lost.sum()} of {len(lost)} states"
            detail = "; ".join(text for text in (detail, more) if text)
        self.cases[name, ""] = _Case((name, ""), inputs, own.array, inputs.q, own.complaint)
        self.bad[name, ""] = ~(relative(reached, inputs.p, 1) <= self.tolerance)
        title = QUANTITIES[name].title
        check = self._made(
            "against the file", name, title, reached, inputs.p, inputs.q, entries, self.tolerance, detail
        )
        if not check.passed:
            turned = own.array - 2.0 * np.pi * np.round((own.array - inputs.q) / (2.0 * np.pi)) * np.array(
                [unit == "rad" for unit in leg.units.joints]
            )
            text = diagnose(turned, inputs.q, Entries("{}", (leg.joint_names,)), self.tolerance)
            check = replace(check, diagnosis=(f"of the joint coordinates, {text}",) if text else ())
        yield check

    # ------------------------------------------------------------------ own results against each other

    def _with_names_exchanged(self, checks: list[OwnCheck]) -> list[OwnCheck] | None:
        """The checks where another order of the joints' names mends some that fail and harms none; None otherwise.

        What it mends is one error. The others are as they are with that order.
        """
        failing = [check for check in checks if not check.passed]
        joints, formulas = self.leg.joint_names, self.formulas
        for other in orders(len(joints)) if failing else ():
            named = [joints[formulas.order[place]] for place in other]
            if not self._mended(formulas.with_joint_names(named), map(_key, failing)):
                continue
            renamed = _Comparison(formulas.with_joint_names(named), self.states, self.tolerance, lambda *_: None)
            again = renamed._against_the_file()
            if [check.quantity for check in again] != [check.quantity for check in checks]:
                continue
            pairs = list(zip(checks, again, strict=True))
            mended = [check for check, other in pairs if other.passed and not check.passed]
            harmed = any(check.passed and not other.passed for check, other in pairs)
            several = len({check.method for check in mended}) > 1 or len(mended) == len(failing)
            if mended and several and not harmed:
                return self._one_cause(checks, mended, renamed, again, named)
        return None

    def _mended(self, formulas: OwnFormulas, keys: Iterable[Key]) -> bool:
        """Whether formulas that are read in another way are right in one of some results, at a few states."""
        for key in keys:
            case = self.cases.get(key)
            if case is None or len(case.own) - int(_lost(case.own).sum()) < LEAST_STATES:
                continue
            known = np.flatnonzero(~_lost(case.own))[:TRIED]
            inputs, reference = case.inputs.take(known), case.reference[known]
            if key[0] == "assemble":
                own = formulas.coordinates(inputs.q)[0].array
            else:
                own = formulas.values(key[0], inputs, with_gravity=key[1] == "gravity").array
            if own.shape == reference.shape and agree(own, reference, self.tolerance):
                return True
        return False

    def _one_cause(
        self,
        checks: Sequence[OwnCheck],
        mended: Sequence[OwnCheck],
        renamed: _Comparison,
        again: list[OwnCheck],
        names: Sequence[str],
    ) -> list[OwnCheck]:
        """The checks, of which those that other names mend have one cause."""
        joints, formulas = self.leg.joint_names, self.formulas
        moved = [joint for joint, name in zip((joints[i] for i in formulas.order), names, strict=True) if joint != name]
        moved.sort(key=joints.index)
        what = "are exchanged" if len(moved) == 2 else "are in another order"
        said = f"joint_names = ({', '.join(names)}) says so"
        first = mended[0]
        alone = all(check.method == first.method for check in mended)
        which = "agrees" if alone else "agrees, as does all that is said to follow from it,"
        diagnosis = [text for text in first.diagnosis if not text.startswith(_EXCHANGED)]
        if not (alone and "joint_names" in str(diagnosis)):
            diagnosis.append(f"{which} when the coordinates {', '.join(moved)} {what}: {said}")
        rest = iter(renamed._explained(again))
        result = []
        for check in checks:
            other = next(rest)
            if check is first:
                result.append(replace(check, diagnosis=tuple(diagnosis)))
            elif check in mended:
                result.append(replace(check, diagnosis=(f"agrees where {said}",), follows_from=first.method))
            else:
                result.append(other)
        self.called |= renamed.called
        return result + list(rest)

    def _explained(self, checks: list[OwnCheck]) -> list[OwnCheck]:
        """The checks with what follows from what, and those of own results among themselves that this rests on."""
        failing = {_key(check) for check in checks if not check.passed}
        doubtful = failing | {key for key in self.cases if key[0] in self.not_compared}
        roots: dict[Key, str] = {}
        rows: list[OwnCheck] = []
        explained = []
        relations = list(self._relations(doubtful)) if doubtful else []
        held: dict[int, bool] = {}
        for number, relation in enumerate(relations):
            row = self._made(
                OWN_GROUP,
                relation.target[0],
                relation.statement,
                relation.left,
                relation.right,
                relation.q,
                relation.entries,
                relation.tolerance,
            )
            held[number] = row.passed
            rows.append(row)
        for check in checks:
            key = _key(check)
            if key not in failing:
                explained.append(check)
                continue
            mine = [number for number, relation in enumerate(relations) if relation.target == key]
            texts, root = [], ""
            broken = [number for number in mine if not held[number]]
            upstream = dict.fromkeys(k for n in mine for k in relations[n].upstream if k in failing)
            sources = [k for k in upstream if not self._uses(k[0], key[0])]
            used = [
                relation.target
                for number, relation in enumerate(relations)
                if held[number] and key in relation.upstream and relation.target in failing
                if self._uses(key[0], relation.target[0])
            ]
            if said := self._as_without_loads(key, failing):
                root = roots.get((key[0], ""), "") or key[0]
                texts.append(f"{said} {_title((key[0], ''))}")
            elif excuse := self._excused(key, failing, roots):
                other, said = excuse
                root = roots.get((other, ""), "") or other
                texts.append(said)
            elif broken:
                relation = relations[broken[0]]
                wrong = [_title(k) for k in relation.upstream if k in failing]
                sound = [_title(k) for k in relation.upstream if k not in failing]
                said = f"the {_title(key)} {relation.negated}"
                if wrong:
                    texts.append(f"{said}, an error here beside that in {' and '.join(wrong)}")
                else:
                    agree_ = "agrees" if len(sound) == 1 else "agree"
                    texts.append(f"{said}, although {' and '.join(sound)} {agree_}: the error is here")
            elif used and not self._lost_more(key, used):
                root = used[0][0]
                texts.append(f"as follows from the own {_title(used[0])}, which it calls and which disagrees")
            elif sources:
                first = sources[0]
                named = " and ".join(_title(k) for k in sources)
                if self._lost_more(key, sources):
                    texts.append(f"gives no numbers where the own {named} does, an error here beside that one")
                else:
                    root = roots.get(first, "") or first[0]
                    texts.append(f"as follows from the own {named}, which disagrees")
            roots[key] = root
            explained.append(replace(check, diagnosis=(*check.diagnosis, *texts), follows_from=root))
        # A method may follow from one that comes after it, and that one from another.
        explained = [replace(check, follows_from=_origin(check.follows_from, roots)) for check in explained]
        for number, row in enumerate(rows):
            if not row.passed:
                keys = (relations[number].target, *relations[number].upstream)
                blamed = next((key for key in keys if key in failing), None)
                cause = "" if blamed is None else _origin(roots[blamed] or blamed[0], roots)
                rows[number] = replace(row, follows_from=cause)
        return explained + rows

    def _uses(self, method: str, other: str) -> bool:
        """Whether a method computes with another one, and not that one with it."""
        return other in self._calls(method) and method not in self._calls(other)

    def _calls(self, method: str) -> frozenset[str]:
        """The other methods that a method calls at some states."""
        if method not in self._known_calls:
            called: set[str] = set()
            for (name, variant), case in self.cases.items():
                if name == method:
                    some = case.inputs.take(np.arange(len(case.inputs.q))[:OBSERVED])
                    for call in self.formulas.observed(name, some, with_gravity=variant == "gravity"):
                        called |= call.called
            self._known_calls[method] = frozenset(called)
        return self._known_calls[method]

    def _excused(self, key: Key, failing: set[Key], roots: Mapping[Key, str]) -> tuple[str, str] | None:
        """A method that gives this one nothing of use wherever this one is wrong, and a sentence.

        None where there is none, or more to it.
        """
        name, variant = key
        useless = {other for other, raised in self.raised.items() if raised and other in failing}
        # Methods that call each other are not each other's excuse.
        mutual = {name} | {other for (other, _), root in roots.items() if root == name}
        others = {other for other, _ in useless} - mutual
        if not (others or self.formulas.not_callable) or name not in self.formulas.methods:
            return None
        raising = {other for (other, _), raised in self.raised.items() if any(each.kind for each in raised)}
        found: list[tuple[str, str]] = []
        inputs = self.cases[key].inputs.take(np.flatnonzero(self.bad[key]))
        for call in self.formulas.observed(name, inputs, with_gravity=variant == "gravity"):
            excuse = self._excuse(key, call, others, raising, roots)
            if excuse is None:
                return None
            found.append(excuse)
        if not found:
            return None
        other, said = found[0]
        if other in self.formulas.not_callable:
            self.called.setdefault(other, name)
        return other, said

    def _excuse(
        self, key: Key, call: Observed, others: set[str], raising: set[str], roots: Mapping[Key, str]
    ) -> tuple[str, str] | None:
        """Why one call could not do better: a method that it called, and a sentence."""
        for other, may_have_raised in call.useless:
            # What a method makes of an exception is its own: below.
            if other in others and not (may_have_raised and other in raising):
                return other, f"calls the own {other}, which returns nothing of use there"
        if call.raised is None:
            return None
        for other in (*self.formulas.not_callable, *sorted(others)):
            if other in call.names and (other in self.formulas.not_callable or self._cannot_be_called(other)):
                return other, f"calls the own {other}, which cannot be called so"
        source = self._source(key, call.raised, roots)
        if source is None:
            return None
        if source[0] == key[0]:
            return key[0], f"raises the same as {_title((key[0], ''))}"
        return source[0], f"raised by the own {source[0]}, which it calls"

    def _cannot_be_called(self, name: str) -> bool:
        case = self.cases.get((name, ""))
        return case is not None and case.complaint.startswith("cannot be called")

    def _source(self, key: Key, raised: Raised, roots: Mapping[Key, str]) -> Key | None:
        """The own result whose method, called by this one, raises the same exception by itself."""
        for code in raised.codes:
            method = self.formulas.codes.get(code)
            for other, theirs in self.raised.items():
                if other[0] != method or other == key or (method == key[0] and other[1]):
                    continue
                # Methods that call each other are not each other's excuse.
                if roots.get(other) == key[0] and method != key[0]:
                    continue
                if any((each.kind, each.text) == (raised.kind, raised.text) for each in theirs):
                    return other
            if method == key[0]:
                return None
        return None

    def _lost_more(self, key: Key, others: Sequence[Key]) -> bool:
        """Whether a result has no numbers at states where all of some others have."""
        lost = _lost(self.cases[key].own)
        for other in others:
            theirs = _lost(self.cases[other].own)
            if len(theirs) != len(lost):  # not at the same states
                return False
            lost = lost & ~theirs
        return bool(lost.any())

    def _as_without_loads(self, key: Key, failing: set[Key]) -> str:
        """How a result with loads is wrong in the way in which it is without them; empty where it is not."""
        base = (key[0], "")
        if not key[1] or base not in failing or len(self.cases[base].own) != len(self.cases[key].own):
            return ""
        loaded, unloaded = self.cases[key], self.cases[base]
        if self._lost_more(key, [base]):
            return ""
        if agree(loaded.own - loaded.reference, unloaded.own - unloaded.reference, 10.0 * self.tolerance):
            return "differs by the same as"
        statement = self.statements.get(key, "")
        if statement and statement == self.statements.get(base) and "no simple relation" not in statement:
            return "is wrong in the same way as"
        raised = {(each.kind, each.text) for each in self.raised.get(key, ())}
        same = raised and raised <= {(each.kind, each.text) for each in self.raised.get(base, ())}
        if not same or (self.bad[key] & ~_lost(loaded.own)).any():
            return ""
        return "raises the same as" if any(kind for kind, _ in raised) else "is as useless as"

    def _relations(self, doubtful: set[Key]) -> Iterator[_Relation]:
        """What own results demand of each other; those whose members all agree with the reference say nothing new."""

        def members(target: Key, *upstream: str | Key) -> tuple[Key, ...] | None:
            keys = (target, *((key, "") if isinstance(key, str) else key for key in upstream))
            whole = all(key in self.cases for key in keys)
            return keys if whole and any(key in doubtful for key in keys) else None

        def relation(
            keys: tuple[Key, ...],
            statement: str,
            left: np.ndarray,
            right: np.ndarray,
            inputs: Inputs,
            tolerance: float,
        ) -> Iterator[_Relation]:
            finite = np.isfinite(left) & np.isfinite(right)
            known = np.flatnonzero(finite.reshape(len(left), -1).all(axis=1))
            if len(known):
                entries = self.formulas.entries(keys[0][0])
                yield _Relation(
                    keys[0], keys[1:], statement, left[known], right[known], inputs.q[known], entries, tolerance
                )

        few = self._with_room()
        rough = max(DIFFERENCE_TOLERANCE, 10.0 * self.tolerance)
        fine = 10.0 * self.tolerance
        own, every = self._own, self.inputs
        yield from self._kinematic_relations(members, relation, few, rough, fine)

        if keys := members(("kinetic_energy", ""), "mass_matrix"):
            right = 0.5 * np.einsum("...i,...ij,...j->...", every.v, own("mass_matrix", every), every.v)
            yield from relation(keys, "is v^T M v / 2", own("kinetic_energy", every), right, every, fine)
        if keys := members(("gravity_torque", ""), "potential_energy"):
            right = gradient(self._function("potential_energy"), few.q)
            statement = "is the derivative of the potential energy"
            yield from relation(keys, statement, own("gravity_torque", few), right, few, rough)
        if keys := members(("bias", ""), "gravity_torque"):
            left = own("bias", every.without("v"))
            yield from relation(keys, "is the gravity torque at v = 0", left, own("gravity_torque", every), every, fine)
        if keys := members(("bias", ""), "mass_matrix"):
            dM = gradient(self._function("mass_matrix"), few.q)
            right = np.einsum("...ijk,...j,...k->...i", dM, few.v, few.v)
            right -= 0.5 * np.einsum("...jki,...j,...k->...i", dM, few.v, few.v)
            # Friction is odd in v.
            left = 0.5 * (own("bias", few) + own("bias", replace(few, v=-few.v))) - own("bias", few.without("v"))
            statement = "has the velocity terms that the derivatives of M give"
            yield from relation(keys, statement, left, right, few, rough)
        yield from self._force_relations(members, relation, fine)

    def _kinematic_relations(
        self, members: Any, relation: Any, few: Inputs, rough: float, fine: float
    ) -> Iterator[_Relation]:
        own, every = self._own, self.inputs
        if keys := members(("inverse_kinematics", ""), "foot_position"):
            case = self.cases["inverse_kinematics", ""]
            assert case.inputs.p is not None
            found = np.where(np.isnan(case.own), 0.0, case.own)
            left = self.formulas.values("foot_position", case.inputs.at(found)).array
            left[np.isnan(case.own).any(axis=1)] = np.nan
            places = (keys[1], *keys[1:])
            statement = "is inverse to the own position"
            for each in relation(places, statement, left, case.inputs.p, case.inputs, fine):
                yield replace(each, target=keys[0])
        if keys := members(("jacobian", ""), "foot_position"):
            right = gradient(self._function("foot_position"), few.q)
            yield from relation(keys, "is the derivative of the own position", own("jacobian", few), right, few, rough)
        if keys := members(("jacobian_derivative", ""), "jacobian"):
            right = slope(self._function("jacobian"), few.q, few.v)
            left = own("jacobian_derivative", few)
            yield from relation(keys, "is the derivative of the own Jacobian along v", left, right, few, rough)
        if keys := members(("foot_velocity", ""), "jacobian"):
            right = _product(own("jacobian", every), every.v)
            yield from relation(keys, "is J v", own("foot_velocity", every), right, every, fine)
        if keys := members(("foot_acceleration", ""), "jacobian", "jacobian_derivative"):
            right = _product(own("jacobian", every), every.a) + _product(own("jacobian_derivative", every), every.v)
            yield from relation(keys, "is J a + Jdot v", own("foot_acceleration", every), right, every, fine)

    def _force_relations(self, members: Any, relation: Any, fine: float) -> Iterator[_Relation]:
        own, every = self._own, self.inputs
        tilted = replace(every, gravity=self.states.gravity)

        def hung(name: str) -> np.ndarray:
            return self.formulas.values(name, tilted, with_gravity=True).array

        driven = self.leg.backend.actuator_joints
        joints = self.leg.joint_names
        at_joints = [joints.index(name) for name in driven] if set(driven) == set(joints) else None
        pushed = replace(every, foot_force=self.states.foot_force)
        # Each of the two may be computed from the other.
        first, second = "generalized_force", "torque"
        if {first, second} <= self.formulas.methods.keys() and self._uses(first, second):
            first, second = second, first

        def as_second(values: np.ndarray) -> np.ndarray:
            moved = np.empty_like(values)
            if second == "torque":
                moved[:] = values[:, at_joints]
            else:
                moved[:, at_joints] = values
            return moved

        title = QUANTITIES[first].title
        for name in (first, second):
            if name == "torque" and at_joints is None:
                continue
            order = at_joints if name == "torque" and at_joints is not None else list(range(len(joints)))
            general = name == second and at_joints is not None
            if general and (keys := members((name, ""), first)):
                right = as_second(own(first, every))
                yield from relation(keys, f"is the {title}", own(name, every), right, every, fine)
            elif keys := members((name, ""), "mass_matrix", "bias"):
                right = (_product(own("mass_matrix", every), every.a) + own("bias", every))[:, order]
                yield from relation(keys, "is M a + h", own(name, every), right, every, fine)
            elif keys := members((name, ""), "bias"):
                left, right = own(name, every.without("a")), own("bias", every)[:, order]
                yield from relation(keys, "is the bias force at a = 0", left, right, every, fine)
            # Of a torque that is computed from the generalized force, errors of the loads are there.
            if general and (keys := members((name, "gravity"), (first, "gravity"))):
                right = as_second(hung(first))
                yield from relation(keys, f"is the tilted {title}", hung(name), right, tilted, fine)
            if general and (keys := members((name, "foot_force"), (first, "foot_force"))):
                right = as_second(own(first, pushed))
                statement = f"is the {title} with foot force"
                yield from relation(keys, statement, own(name, pushed), right, pushed, fine)
            elif keys := members((name, "foot_force"), (name, ""), "jacobian"):
                change = -np.einsum("...ji,...j->...i", own("jacobian", every), self.states.foot_force)
                right = own(name, every) + change[:, order]
                statement = "is that without it, less J^T foot_force"
                yield from relation(keys, statement, own(name, pushed), right, every, fine)
        if keys := members(("acceleration", "foot_force"), ("acceleration", ""), "mass_matrix", "jacobian"):
            change = own("acceleration", pushed) - own("acceleration", every)
            right = np.einsum("...ji,...j->...i", own("jacobian", every), self.states.foot_force)
            left = _product(own("mass_matrix", every), change)
            yield from relation(keys, "has M^-1 J^T foot_force more than without it", left, right, every, fine)
        if at_joints is None:
            return
        if keys := members(("acceleration", ""), "mass_matrix", "bias"):
            efforts = np.empty_like(every.q)
            efforts[:, at_joints] = every.tau
            left = _product(own("mass_matrix", every), own("acceleration", every)) + own("bias", every)
            yield from relation(keys, "is M^-1 (torque - h)", left, efforts, every, fine)

    def _own(self, name: str, inputs: Inputs) -> np.ndarray:
        return self.formulas.values(name, inputs).array

    def _function(self, name: str) -> Callable[[np.ndarray], np.ndarray]:
        """Own values of a function of q, of shape (..., n), at rest."""

        def values(points: np.ndarray) -> np.ndarray:
            result = self._own(name, self.inputs.at(points.reshape(-1, points.shape[-1])))
            return result.reshape(*points.shape[:-1], *result.shape[1:])

        return values

    def _with_room(self) -> Inputs:
        """Some states around which differences mean something."""
        spread = np.unique(np.linspace(0, len(self.states) - 1, DIFFERENCE_SAMPLES).round().astype(np.intp))
        chosen = with_room(self.leg, self.states.take(spread))
        values = smallest_singular_values(self.leg, chosen.q) if len(chosen) else None
        if values is not None and np.isfinite(values).any():
            chosen = chosen.take(np.flatnonzero(values > ROOM_SHARE * np.nanmedian(values)))
        count = len(chosen)
        gravity = np.broadcast_to(self.formulas.gravity, (count, 3))
        return Inputs(chosen.q, chosen.v, chosen.a, np.zeros((count, self.inputs.tau.shape[1])), gravity)


def _key(check: OwnCheck) -> Key:
    """The result that a check against the file is of."""
    variants = (variant for variant in _VARIANTS if check.quantity == _title((check.method, variant)))
    return check.method, next(variants, "")


def _origin(method: str, roots: Mapping[Key, str]) -> str:
    """The method that one follows from in the end."""
    passed = set[str]()
    while method and method not in passed and (further := roots.get((method, ""), "")):
        passed.add(method)
        method = further
    return method


def _title(key: Key) -> str:
    return QUANTITIES[key[0]].title + _VARIANTS[key[1]]


def _lost(values: np.ndarray) -> np.ndarray:
    """Rows that are not all numbers."""
    return np.asarray(~np.isfinite(values).reshape(len(values), -1).all(axis=1))


def _product(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.einsum("...ij,...j->...i", matrix, vector)
