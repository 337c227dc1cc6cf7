"""Tree coordinates as linear forms of fewer ones: couplings, mimics and relations between joints, eliminated exactly.

u = (y, z) holds the independent coordinates y and the unknowns z. Every tree joint's coordinate is a form
sum(c_k u_k) + constant; its rate and acceleration are the same sums of u's derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from leg_dynamics.description.model import Description, Equation
from leg_dynamics.description.topology import coupling_equations, independent_joints
from leg_dynamics.errors import DescriptionError
from leg_dynamics.symbolic.scalars import Scalar, add, mul

__all__ = ["Coordinates", "Form", "Relation", "reduce_coordinates"]

# Coefficients that cancel leave rounding of ratios, not structure.
CANCELLED = 1e-14


@dataclass(frozen=True)
class Form:
    """sum(coefficient * u_k) + constant, rad or m; `terms` sorted by k and without zeros."""

    terms: tuple[tuple[int, float], ...]
    constant: float = 0.0

    def __add__(self, other: Form) -> Form:
        sums = dict(self.terms)
        for k, coefficient in other.terms:
            sums[k] = sums.get(k, 0.0) + coefficient
        return Form(_tidy(sums), self.constant + other.constant)

    def scaled(self, factor: float) -> Form:
        """Factor times the form."""
        return Form(tuple((k, factor * c) for k, c in self.terms), factor * self.constant)

    @property
    def linear(self) -> Form:
        """The form without its constant."""
        return Form(self.terms)

    def of(self, u: Sequence[Scalar]) -> Scalar:
        """Value at coordinates u."""
        return add(self.rate(u), self.constant)

    def rate(self, derivatives: Sequence[Scalar]) -> Scalar:
        """The same sum, without the constant, of u's time derivatives."""
        result: Scalar = 0.0
        for k, coefficient in self.terms:
            result = add(result, mul(coefficient, derivatives[k]))
        return result


def _tidy(sums: Mapping[int, float]) -> tuple[tuple[int, float], ...]:
    return tuple(sorted((k, c) for k, c in sums.items() if abs(c) > CANCELLED))


@dataclass(frozen=True)
class Relation:
    """A joint's coordinate as a combination of others: joint = sum(coefficient * other) + constant."""

    joint: str
    coefficients: tuple[tuple[str, float], ...]
    constant: float = 0.0


@dataclass(frozen=True)
class Coordinates:
    """Which joints' coordinates u holds, and every tree joint as a form of them.

    Attributes
    ----------
    names : tuple of str
        The joints behind u: the n independent ones first.
    n : int
    forms : mapping of str to Form
        By tree joint.
    """

    names: tuple[str, ...]
    n: int
    forms: Mapping[str, Form]

    @property
    def unknowns(self) -> int:
        """Number of unknowns z."""
        return len(self.names) - self.n


def reduce_coordinates(description: Description, relations: Sequence[Relation] = ()) -> Coordinates:
    """Eliminate couplings, mimics and further relations.

    Parameters
    ----------
    description : Description
    relations : sequence of Relation
        Relations between dependent joints that the closed loops imply.

    Raises
    ------
    DescriptionError
        No joint is independent, or couplings tie independent joints to each other.
    """
    independent = independent_joints(description)
    if not independent:
        advice = "mark at least one independent" if description.moving_joints else "every joint is fixed, nothing moves"
        raise DescriptionError(f"no joint is independent: {advice}", file=description.file)
    order = [joint.name for joint in description.moving_joints]
    depth = {name: i for i, name in enumerate(order)}
    equations = list(coupling_equations(description))
    for relation in relations:
        coefficients = {name: -c for name, c in relation.coefficients}
        coefficients[relation.joint] = coefficients.get(relation.joint, 0.0) + 1.0
        equations.append(Equation(f"relation of {relation.joint}", coefficients, relation.constant))
    solved: dict[str, tuple[dict[str, float], float]] = {}
    for equation in equations:
        sums, constant = _substituted(dict(equation.coefficients), -equation.constant, solved)
        if not sums:
            if abs(constant) > 1e-9:
                raise DescriptionError(
                    f"coupling {equation.name!r} contradicts the others by {constant:.3g}", file=description.file
                )
            continue
        candidates = [name for name in sums if name not in independent]
        if not candidates:
            tied = ", ".join(sums)
            says = f"ties the independent joints {tied} to each other: mark one of them"
            if len(sums) == 1:
                says = f"and the other couplings hold the independent joint {tied} still: mark it"
            raise DescriptionError(f'coupling {equation.name!r} {says} independent="false"', file=description.file)

        def preference(name: str, sums: dict[str, float] = sums) -> tuple[bool, int]:
            whole = all(abs(c / sums[name] - round(c / sums[name])) < CANCELLED for c in sums.values())
            return whole, depth[name]

        pivot = max(candidates, key=preference)
        factor = -1.0 / sums.pop(pivot)
        solution = ({name: factor * c for name, c in sums.items()}, factor * constant)
        for name, (old, level) in list(solved.items()):
            if pivot in old:
                solved[name] = _substituted(old, level, {pivot: solution})
        solved[pivot] = solution
    unknowns = [name for name in order if name not in independent and name not in solved]
    names = (*independent, *unknowns)
    index = {name: k for k, name in enumerate(names)}
    forms = {}
    for name in order:
        if name in solved:
            sums, constant = solved[name]
            forms[name] = Form(_tidy({index[other]: c for other, c in sums.items()}), constant + 0.0)
        else:
            forms[name] = Form(((index[name], 1.0),))
    return Coordinates(names, len(independent), forms)


def _substituted(
    sums: Mapping[str, float], constant: float, solved: Mapping[str, tuple[dict[str, float], float]]
) -> tuple[dict[str, float], float]:
    result: dict[str, float] = {}
    for name, coefficient in sums.items():
        parts, level = solved.get(name, ({name: 1.0}, 0.0))
        constant += coefficient * level
        for other, c in parts.items():
            result[other] = result.get(other, 0.0) + coefficient * c
    return {name: c for name, c in result.items() if abs(c) > CANCELLED}, constant
