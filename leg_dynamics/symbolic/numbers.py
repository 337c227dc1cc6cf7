"""The numbers of a description that may be symbols: lengths, masses, centres of mass, inertia.

Directions of axes and frames stay numbers: which products vanish is decided by them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from leg_dynamics.description.model import Description, Pose
from leg_dynamics.errors import ParameterError
from leg_dynamics.symbolic.scalars import Scalar

if TYPE_CHECKING:
    import casadi

__all__ = ["Numbers", "is_inertial", "number_values", "parameter_names"]

INERTIA_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
ON_JOINTS = (".damping", ".friction", ".reduction", ".rotor_inertia")


def _values(description: Description) -> dict[str, float]:
    """Every number by its parameter name, in file order."""
    values: dict[str, float] = {}
    for link in description.links:
        if link.inertial is None:
            continue
        values[f"{link.name}.mass"] = link.inertial.mass
        for axis, value in zip("xyz", link.inertial.origin.xyz, strict=True):
            values[f"{link.name}.com.{axis}"] = value
        for entry in INERTIA_ENTRIES:
            values[f"{link.name}.{entry}"] = getattr(link.inertial, entry)
    for joint in description.joints:
        for axis, value in zip("xyz", joint.origin.xyz, strict=True):
            values[f"{joint.name}.origin.{axis}"] = value
        if joint.type != "fixed":
            values |= {f"{joint.name}.damping": joint.damping, f"{joint.name}.friction": joint.friction}
    for each in description.transmissions:
        values |= {f"{each.name}.reduction": each.reduction, f"{each.name}.rotor_inertia": each.rotor_inertia}
    for loop in description.loops:
        for role, end in (("predecessor", loop.predecessor), ("successor", loop.successor)):
            for axis, value in zip("xyz", end.origin.xyz, strict=True):
                values[f"{loop.name}.{role}.{axis}"] = value
    return {name: float(value) for name, value in values.items()}


def number_values(description: Description) -> dict[str, float]:
    """Every number that the dynamics depend on, by name: those that can be parameters, and the others.

    The others are directions (``JOINT.origin.roll``, ``JOINT.axis.x``, ...) and the ratios of couplings and mimics:
    `Numbers.with_symbols` refuses them.
    """
    values = _values(description)
    for link in description.links:
        if link.inertial is not None:
            values |= _angles(f"{link.name}.inertial", link.inertial.origin)
    for joint in description.joints:
        values |= _angles(f"{joint.name}.origin", joint.origin)
        if joint.type == "fixed":
            continue
        values |= {f"{joint.name}.axis.{axis}": x for axis, x in zip("xyz", joint.axis, strict=True)}
        if joint.mimic is not None:
            values |= {f"{joint.name}.multiplier": joint.mimic.multiplier, f"{joint.name}.offset": joint.mimic.offset}
    for loop in description.loops:
        values |= _angles(f"{loop.name}.predecessor", loop.predecessor.origin)
        values |= _angles(f"{loop.name}.successor", loop.successor.origin)
        values |= {f"{loop.name}.axis.{axis}": x for axis, x in zip("xyz", loop.axis or (), strict=False)}
    values |= {f"{coupling.name}.ratio": coupling.ratio for coupling in description.couplings}
    return {name: float(value) for name, value in values.items()}


def _angles(name: str, pose: Pose) -> dict[str, float]:
    return {f"{name}.{angle}": value for angle, value in zip(("roll", "pitch", "yaw"), pose.rpy, strict=True)}


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
    inertial frame's axes), ``JOINT.origin.x`` (m, parent link's frame), ``LOOP.predecessor.x`` and
    ``LOOP.successor.x`` (m, that link's frame), ``JOINT.damping``, ``JOINT.friction``, and on the motor's side
    ``TRANSMISSION.reduction`` and ``TRANSMISSION.rotor_inertia`` (kg·m²).
    """
    return tuple(_values(description))


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
    """

    values: Mapping[str, Scalar]
    symbols: tuple[casadi.SX, ...] = ()
    nominal: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, description: Description) -> Numbers:
        """All numbers as the file gives them."""
        return cls(_values(description))

    def with_symbols(self, names: Iterable[str]) -> Numbers:
        """Return the same numbers with some of them as symbols.

        Raises
        ------
        ParameterError
            There is no such number.
        """
        import casadi

        values = dict(self.values)
        symbols, nominal = [], []
        for name in names:
            if name not in values or not isinstance(values[name], float):
                raise ParameterError(
                    f"the mechanism cannot be differentiated by {name!r}: only by masses, centres of mass, inertias, "
                    "friction, transmissions and lengths of joint and loop origins; change the file and compare",
                    parameter=name,
                )
            nominal.append(values[name])
            values[name] = casadi.SX.sym(name)
            symbols.append(values[name])
        return replace(self, values=values, symbols=tuple(symbols), nominal=np.array(nominal))

    def vector(self, name: str) -> tuple[Scalar, Scalar, Scalar]:
        """The three numbers NAME.x, NAME.y, NAME.z."""
        x, y, z = (self.values[f"{name}.{axis}"] for axis in "xyz")
        return x, y, z
