"""Which links are motors, what they exert, and the colours that say so."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.description.model import Description, Joint
from leg_dynamics.errors import NonFiniteError, ParameterError, ShapeError
from leg_dynamics.preview.colours import diverging, hexadecimal

__all__ = ["Motor", "check_motors", "effort_ranges", "legend_group"]

_STOPS = 33


@dataclass(frozen=True, slots=True)
class Motor:
    """An actuator as a preview shows it.

    Attributes
    ----------
    actuator : str
        Its name.
    link : str
        The link that carries its colour.
    unit : str
        ``N·m``, or ``N`` on a slide.
    lower, limit : float
        Least and greatest effort, infinite where none is known.
    efforts : numpy.ndarray, shape (T,)
        Its effort over time.
    """

    actuator: str
    link: str
    unit: str
    lower: float
    limit: float
    efforts: np.ndarray

    def at(self, times: np.ndarray, known: np.ndarray) -> Motor:
        """The same motor with its efforts interpolated from the `known` times."""
        return replace(self, efforts=np.interp(times, known, self.efforts))


def check_motors(
    description: Description,
    samples: int,
    efforts: Mapping[str, ArrayLike],
    actuator_links: Mapping[str, str] | None,
    effort_limits: Mapping[str, float] | None,
) -> tuple[Motor, ...]:
    """The motors with their efforts, or a named error.

    Parameters
    ----------
    description : Description
        The mechanism.
    samples : int
        T.
    efforts : mapping of str to array_like, shape (T,)
        Effort of each actuator, N·m or N.
    actuator_links : mapping of str to str, optional
        The link to colour, or the joint whose child link to colour, where it is not the usual one: the link
        ``motor_<actuator>``, else the child link of the actuated joint.
    effort_limits : mapping of str to float, optional
        Largest effort of an actuator, both ways, where its joint's limits are not meant, N·m or N.

    Returns
    -------
    tuple of Motor

    Raises
    ------
    DescriptionError
        An actuator, joint or link is not in the file.
    ShapeError, NonFiniteError
        An effort is not a finite number a sample.
    ParameterError
        A link is to be coloured by two actuators, a limit is not positive, or an option names an unknown actuator.
    """
    links, limits = dict(actuator_links or {}), dict(effort_limits or {})
    for option, mapping in (("actuator_links", links), ("effort_limits", limits)):
        for name in mapping:
            if name not in efforts:
                raise ParameterError(
                    f"{option} names {name!r}, of which no effort is given; the actuators are {', '.join(efforts)}"
                )
    motors: dict[str, Motor] = {}
    for actuator, values in efforts.items():
        checked = _efforts(actuator, values, samples)
        link, joint = _link_and_joint(description, actuator, links.get(actuator))
        lower, limit = _range(joint)
        if actuator in limits:
            limit = limits[actuator]
            if not limit > 0.0:
                raise ParameterError(f"effort_limits[{actuator!r}] is {limit!r}, but a limit must be positive")
            lower = -limit
        if link in motors:
            raise ParameterError(
                f"link {link!r} cannot show the efforts of both {motors[link].actuator!r} and {actuator!r}; "
                "name another link in actuator_links"
            )
        unit = "N" if joint is not None and joint.type == "prismatic" else "N\N{MIDDLE DOT}m"
        motors[link] = Motor(actuator, link, unit, float(lower), float(limit), checked)
    return tuple(motors.values())


def _range(joint: Joint | None) -> tuple[float, float]:
    """Least and greatest effort of a joint; 0 both ways stands for limits that are not known."""
    if joint is None or joint.limits.effort_lower == joint.limits.effort == 0.0:
        return -math.inf, math.inf
    return joint.limits.effort_lower, joint.limits.effort


def _efforts(actuator: str, values: ArrayLike, samples: int) -> np.ndarray:
    try:
        checked = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"efforts[{actuator!r}] is not an array of numbers ({error}); give floats") from None
    if checked.shape != (samples,):
        raise ShapeError(
            f"efforts[{actuator!r}] has shape {checked.shape}, but there are {samples} times; give shape ({samples},)"
        )
    rows = np.flatnonzero(~np.isfinite(checked))
    if rows.size:
        raise NonFiniteError(
            f"efforts[{actuator!r}] holds NaN or infinity in {rows.size} of {samples} samples, first in sample "
            f"{rows[0]}; drop these samples or repair what computed them",
            rows=rows,
        )
    return checked


def _link_and_joint(description: Description, actuator: str, named: str | None) -> tuple[str, Joint | None]:
    """The link to colour, and the joint that the actuator drives."""
    driven = next((each.joint for each in description.transmissions if each.actuator == actuator), None)
    if named is not None and description.has_link(named):
        return named, None if driven is None else description.joint(driven)
    if named is not None:
        joint = description.joint(named)
        return joint.child, joint if driven is None else description.joint(driven)
    joint = description.joint(actuator if driven is None else driven)
    own = f"motor_{actuator}"
    return (own if description.has_link(own) else joint.child), joint


def effort_ranges(motors: tuple[Motor, ...]) -> dict[str, float]:
    """Of each unit the effort at the ends of its colour scale: the next round number above the largest."""
    largest: dict[str, float] = {}
    for motor in motors:
        largest[motor.unit] = max(largest.get(motor.unit, 0.0), float(np.abs(motor.efforts).max()))
    return {unit: _round_up(value) for unit, value in largest.items()}


def _round_up(value: float) -> float:
    if value < 1e-12:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(value))
    return next(s * decade for s in (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0) if s * decade >= value * (1 - 1e-9))


def legend_group(unit: str, end: float, motors: tuple[Motor, ...]) -> dict[str, Any]:
    """What a page needs to write the legend of the motors of one unit."""
    decimals = max(0, 2 - math.floor(math.log10(0.99 * end)))
    return {
        "title": f"motor {'force' if unit == 'N' else 'torque'}, {unit}",
        "end": end,
        "decimals": decimals,
        "stops": [hexadecimal(colour) for colour in diverging(np.linspace(-1.0, 1.0, _STOPS))],
        "motors": [
            {
                "name": motor.actuator,
                "lower": motor.lower if math.isfinite(motor.lower) else None,
                "limit": motor.limit if math.isfinite(motor.limit) else None,
                "values": motor.efforts.tolist(),
            }
            for motor in motors
        ],
    }
