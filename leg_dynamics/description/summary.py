"""A description in a screenful of text."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable

from leg_dynamics.description.model import Description
from leg_dynamics.description.topology import split_independent

__all__ = ["summarize"]

_LABEL_WIDTH = 16
_SHOWN_PARAMETERS = 12


def summarize(description: Description) -> str:
    """A description's size, coordinates, actuators, loops, couplings and named poses.

    Parameters
    ----------
    description : Description
        Any mechanism.

    Returns
    -------
    str
        Several lines, at most 120 characters wide, without a newline at the end.
    """
    independent, demoted = split_independent(description)
    kinds = Counter(joint.type for joint in description.joints)
    mass = sum(link.inertial.mass for link in description.links if link.inertial is not None)
    rows = {
        "file": description.file if description.source is None else f"{description.file} of {description.source}",
        "links": f"{len(description.links)}, root {description.root}, total mass {mass:.6g} kg",
        "joints": _joined([f"{count} {kind}" for kind, count in kinds.most_common()]),
        "independent": _joined(independent) + (f" (couplings decided on {_joined(demoted)})" if demoted else ""),
        "actuated": _joined(
            f"{each.joint} by {each.actuator}" + (f", reduction {each.reduction:g}" if each.reduction != 1.0 else "")
            for each in description.transmissions
        ),
        "mimics": _joined(
            f"{joint.name} = {joint.mimic.multiplier:g} {joint.mimic.joint} + {joint.mimic.offset:g}"
            for joint in description.joints
            if joint.mimic is not None
        ),
        "loops": _joined(
            f"{loop.name} ({loop.type}, {loop.predecessor.link} - {loop.successor.link})" for loop in description.loops
        ),
        "couplings": _joined(
            f"{each.name} ({each.successor} = {each.ratio:g} {each.predecessor})" for each in description.couplings
        ),
        "constraints": _joined(
            [
                *(f"cone {each.name} ({each.link} - {each.other_link})" for each in description.cones),
                *(f"telescope {each.joint}" for each in description.telescopes),
                *(f"clearance {each.name} ({each.first.link} - {each.second.link})" for each in description.clearances),
            ]
        ),
        "configurations": _joined(each.name for each in description.configurations),
        "parameters": _parameters(description),
    }
    lines = [f"{description.name}: {len(description.links)} links, {len(description.loops)} loops"]
    for label, text in rows.items():
        if text:
            indent = " " * (_LABEL_WIDTH + 2)
            first = f"  {label:<{_LABEL_WIDTH}}"
            lines.extend(textwrap.wrap(text, 118, initial_indent=first, subsequent_indent=indent))
    return "\n".join(lines)


def _parameters(description: Description) -> str:
    parameters = tuple(description.parameters.values())
    units = ("" if each.unit == "1" else f" {each.unit}" for each in parameters)
    shown = [f"{each.name} = {each.value:g}{unit}" for each, unit in zip(parameters, units, strict=True)]
    more = [f"and {len(shown) - _SHOWN_PARAMETERS} more"] if len(shown) > _SHOWN_PARAMETERS else []
    return _joined(shown[:_SHOWN_PARAMETERS] + more)


def _joined(items: Iterable[str]) -> str:
    return "; ".join(item.strip() for item in items)
