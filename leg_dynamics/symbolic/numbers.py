"""The numbers of a description that may be symbols: lengths, angles, ratios, masses, centres of mass, inertia.

Directions are part of the structure: which products vanish is decided by them. So an angle that is a symbol is a turn
of its own between two bodies, by a coordinate that never moves; and a ratio that is a symbol adds to the joint's
coordinate what its change adds. Both are `Extra` coordinates beside u.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.description.model import Description, Pose
from leg_dynamics.description.topology import coupling_equations, coupling_paths
from leg_dynamics.errors import ParameterError
from leg_dynamics.symbolic.coordinates import Coordinates, Form
from leg_dynamics.symbolic.scalars import Scalar

if TYPE_CHECKING:
    import casadi

__all__ = ["Extra", "Extras", "Numbers", "is_inertial", "number_values", "parameter_names", "with_varied_ratios"]

INERTIA_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
ANGLES = ("roll", "pitch", "yaw")
REDUNDANT = 1e-9
ON_JOINTS = (".damping", ".friction", ".armature", ".reduction", ".rotor_inertia")


def number_values(description: Description) -> dict[str, float]:
    """Every number that the dynamics depend on by its parameter name, see `parameter_names`; links, then joints."""
    values: dict[str, float] = {}
    for link in description.links:
        if link.inertial is None:
            continue
        values[f"{link.name}.mass"] = link.inertial.mass
        values |= _vector(f"{link.name}.com", link.inertial.origin.xyz)
        for entry in INERTIA_ENTRIES:
            values[f"{link.name}.{entry}"] = getattr(link.inertial, entry)
        values |= _angles(f"{link.name}.inertial", link.inertial.origin)
    for joint in description.joints:
        values |= _vector(f"{joint.name}.origin", joint.origin.xyz) | _angles(f"{joint.name}.origin", joint.origin)
        if joint.type == "fixed":
            continue
        values |= _vector(f"{joint.name}.axis", joint.axis)
        values |= {f"{joint.name}.damping": joint.damping, f"{joint.name}.friction": joint.friction}
        values[f"{joint.name}.armature"] = joint.armature
        if joint.mimic is not None:
            values |= {f"{joint.name}.multiplier": joint.mimic.multiplier, f"{joint.name}.offset": joint.mimic.offset}
    for each in description.transmissions:
        values |= {f"{each.name}.reduction": each.reduction, f"{each.name}.rotor_inertia": each.rotor_inertia}
    for loop in description.loops:
        for role, end in (("predecessor", loop.predecessor), ("successor", loop.successor)):
            values |= _vector(f"{loop.name}.{role}", end.origin.xyz) | _angles(f"{loop.name}.{role}", end.origin)
        if loop.axis is not None:
            values |= _vector(f"{loop.name}.axis", loop.axis)
    values |= {f"{coupling.name}.ratio": coupling.ratio for coupling in description.couplings}
    return {name: float(value) for name, value in values.items()}


def _vector(name: str, vector: Iterable[float]) -> dict[str, float]:
    return {f"{name}.{axis}": value for axis, value in zip("xyz", vector, strict=True)}


def _angles(name: str, pose: Pose) -> dict[str, float]:
    return {f"{name}.{angle}": value for angle, value in zip(ANGLES, pose.rpy, strict=True)}


def is_inertial(description: Description, name: str) -> bool:
    """Whether a number leaves the geometry alone: mass, centre of mass, inertia, friction, transmission."""
    if name.endswith(ON_JOINTS):
        return True
    links = {link.name for link in description.links}
    others = {joint.name for joint in description.joints} | {loop.name for loop in description.loops}
    owners = {name[:i] for i, letter in enumerate(name) if letter == "."}
    return bool(owners & links) and not owners & others


def parameter_names(description: Description) -> tuple[str, ...]:
    """Names of all numbers that can be parameters.

    ``LINK.mass`` (kg), ``LINK.com.x`` (m, link frame), ``LINK.ixx`` ... (kg·m², about the centre of mass in the
    inertial frame's axes), ``LINK.inertial.roll`` (rad); ``JOINT.origin.x`` (m, parent link's frame) and
    ``JOINT.origin.roll`` (rad), ``JOINT.axis.x`` (only its direction counts), ``JOINT.damping``, ``JOINT.friction``,
    ``JOINT.armature`` (kg·m² or kg), ``JOINT.multiplier`` and ``JOINT.offset`` of a mimic; ``LOOP.predecessor.x`` and
    ``LOOP.successor.roll`` (that link's frame), ``LOOP.axis.x``; ``COUPLING.ratio``; and on the motor's side
    ``TRANSMISSION.reduction`` and
    ``TRANSMISSION.rotor_inertia`` (kg·m²).
    """
    return tuple(number_values(description))


@dataclass(frozen=True)
class Extra:
    """A coordinate beside u that depends on parameters: `value` + sum(slope u_k); 0 for the numbers of the file."""

    value: Scalar
    slopes: Mapping[int, Scalar]


class Extras:
    """The extra coordinates of one model; the first has index `start` = the number of u's coordinates."""

    def __init__(self, start: int) -> None:
        self.start = start
        self.found: list[Extra] = []

    def add(self, value: Scalar, slopes: Mapping[int, Scalar] | None = None) -> int:
        """Add a coordinate and return its index."""
        self.found.append(Extra(value, slopes or {}))
        return self.start + len(self.found) - 1


@dataclass(frozen=True)
class Numbers:
    """A description's numbers by parameter name; floats, or symbols for those that are to be varied.

    Attributes
    ----------
    values : mapping of str to float or SX
    symbols : tuple of SX
        The parameters, in the order asked for.
    nominal : (p,) array
        Their values in the file.
    names : tuple of str
        Their names.
    extras : Extras
        Coordinates that they add.
    """

    values: Mapping[str, Scalar]
    symbols: tuple[casadi.SX, ...] = ()
    nominal: np.ndarray = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()
    extras: Extras = field(default_factory=lambda: Extras(0))

    @classmethod
    def of(cls, description: Description) -> Numbers:
        """All numbers as the file gives them."""
        return cls(number_values(description))

    def with_symbols(self, names: Iterable[str], coordinates: int = 0) -> Numbers:
        """Return the same numbers with some of them as symbols, for a model of so many `coordinates` u.

        Raises
        ------
        ParameterError
            There is no such number.
        """
        import casadi

        values = dict(self.values)
        names = tuple(names)
        symbols, nominal = [], []
        self.check(names)
        for name in names:
            nominal.append(values[name])
            values[name] = casadi.SX.sym(name)
            symbols.append(values[name])
        return replace(
            self,
            values=values,
            symbols=tuple(symbols),
            nominal=np.array(nominal),
            names=names,
            extras=Extras(coordinates),
        )

    def check(self, names: Iterable[str]) -> None:
        """Refuse names that are none of the numbers.

        Raises
        ------
        ParameterError
            There is no such number.
        """
        for name in names:
            if name not in self.values:
                raise ParameterError(
                    f"the mechanism has no number {name!r} to differentiate by: see leg.numbers", parameter=name
                )

    def vector(self, name: str) -> tuple[Scalar, Scalar, Scalar]:
        """The three numbers NAME.x, NAME.y, NAME.z."""
        x, y, z = (self.values[f"{name}.{axis}"] for axis in "xyz")
        return x, y, z

    def angles(self, name: str) -> tuple[Scalar, Scalar, Scalar]:
        """The three numbers NAME.roll, NAME.pitch, NAME.yaw."""
        roll, pitch, yaw = (self.values[f"{name}.{angle}"] for angle in ANGLES)
        return roll, pitch, yaw

    def turn(self, angle: Scalar) -> Form:
        """An angle as a form: a constant, or an extra coordinate that is its change, and its value in the file."""
        if isinstance(angle, float):
            return Form((), angle)
        nominal = self.at_file(angle)
        return Form(((self.extras.add(angle - nominal), 1.0),), nominal)

    def at_file(self, expression: Scalar) -> float:
        """Value of an expression of the parameters for the file's numbers."""
        import casadi

        symbols = casadi.vertcat(*self.symbols)
        return float(casadi.Function("at_file", [symbols], [expression])(self.nominal))


def with_varied_ratios(description: Description, coordinates: Coordinates, numbers: Numbers) -> Coordinates:
    """Coordinates whose forms follow ratios, multipliers and offsets that are symbols.

    The equations C x = c of couplings and mimics give dx = C_s^-1 (dc - dC x) for the eliminated joints: their forms
    get an extra coordinate each, exact to first order in the parameters.

    Raises
    ------
    ParameterError
        A coupling says what others say already: it cannot be varied alone.
    """
    equations = coupling_equations(description)
    free = set(coordinates.names)
    solved = [name for name in coordinates.forms if name not in free]
    matrix = np.array([[equation.coefficients.get(name, 0.0) for name in solved] for equation in equations])
    mimics = {joint.name: joint.mimic for joint in description.joints if joint.mimic is not None}
    couplings = {coupling.name: coupling for coupling in description.couplings}
    rows = {equation.name: row for row, equation in enumerate(equations)}
    rows |= {name: len(couplings) + k for k, name in enumerate(mimics)}
    size = len(coordinates.names)
    values: dict[str, Scalar] = {}
    slopes: dict[str, dict[int, Scalar]] = {}
    for name, symbol, nominal in zip(numbers.names, numbers.symbols, numbers.nominal.tolist(), strict=True):
        owner, _, field_name = name.rpartition(".")
        # The right-hand side's change: a constant, and slopes by tree joint.
        constant, by_joint = 0.0, dict.fromkeys(coordinates.forms, 0.0)
        if field_name == "ratio" and owner in couplings:
            row = list(couplings).index(owner)
            for joint in coupling_paths(description, couplings[owner])[0]:
                if joint.is_single_coordinate:
                    by_joint[joint.name] += 1.0
        elif field_name == "multiplier" and owner in mimics:
            row = rows[owner]
            by_joint[mimics[owner].joint] += 1.0
        elif field_name == "offset" and owner in mimics:
            row, constant = rows[owner], 1.0
        else:
            continue
        change = np.zeros(size + 1)
        change[size] = constant
        for joint_name, factor in by_joint.items():
            for k, coefficient in coordinates.forms[joint_name].terms:
                change[k] += factor * coefficient
            change[size] += factor * coordinates.forms[joint_name].constant
        right = np.zeros((len(equations), size + 1))
        right[row] = change
        found, *_ = np.linalg.lstsq(matrix, right, rcond=None)
        if np.abs(matrix @ found - right).max(initial=0.0) > REDUNDANT * max(1.0, float(np.abs(right).max())):
            raise ParameterError(
                f"{owner!r} says what other couplings say already: {name!r} cannot be varied alone", parameter=name
            )
        for joint_name, change in zip(solved, found, strict=True):
            if not change.any():
                continue
            values[joint_name] = values.get(joint_name, 0.0) + (symbol - nominal) * float(change[size])
            into = slopes.setdefault(joint_name, {})
            for k in np.flatnonzero(change[:size]).tolist():
                into[k] = into.get(k, 0.0) + (symbol - nominal) * float(change[k])
    forms = dict(coordinates.forms)
    for joint_name, value in values.items():
        k = numbers.extras.add(value, slopes[joint_name])
        forms[joint_name] = forms[joint_name] + Form(((k, 1.0),))
    return replace(coordinates, forms=forms)
