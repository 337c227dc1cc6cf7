"""What a study computes of every design: named functions of a leg, built in or the caller's own."""

from __future__ import annotations

import hashlib
import inspect
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from leg_dynamics.analysis.design.indices import DEXTERITY, STEP
from leg_dynamics.analysis.design.motion import MOTION
from leg_dynamics.errors import ParameterError, StudyError, UnsupportedError

if TYPE_CHECKING:
    from leg_dynamics.leg import Leg

__all__ = ["BUILT_IN", "Objective", "objectives_of"]


@dataclass(frozen=True)
class Objective:
    """A number that a design has.

    Parameters
    ----------
    name : str
    unit : str
    meaning : str
        In words, for tables and plots.
    function : callable, optional
        Leg -> float, for an objective of one's own; a module-level function, so that other processes find it. It gets
        a leg made for the design, which takes a second, and is called only for designs that pass the other filters.
    """

    name: str
    unit: str
    meaning: str
    function: Callable[[Leg], float] | None = None

    def fingerprint(self) -> str:
        """Name and, of a function of one's own, a digest of its source: another function is another study."""
        if self.function is None:
            return self.name
        try:
            text = inspect.getsource(self.function)
        except (OSError, TypeError):
            text = repr(self.function)
        place = f"{getattr(self.function, '__module__', '')}.{getattr(self.function, '__qualname__', '')}"
        return f"{self.name} {place} {hashlib.sha256(text.encode()).hexdigest()}"


BUILT_IN: dict[str, Objective] = {
    each.name: each
    for each in (
        Objective("V", "m³", "volume of the workspace"),
        Objective("kbar", "1", "mean condition number over the workspace, Rong 2012 (31)"),
        Objective("ktilde", "1", "deviation of the condition number over the workspace, (32) corrected"),
        Objective("k_min", "1", "least condition number among the samples"),
        Objective("L", "m", "step length: feasible chord along x through the home position"),
        Objective("Z", "m", "step height: Z_b, whose trends are those of the paper's figure 3"),
        Objective("Z_b", "m", "lift at the extreme swing behind home"),
        Objective("Z_f", "m", "lift at the extreme swing ahead of home"),
        Objective("peak_force", "N", "greatest effort of an actuator over the gait"),
        Objective("peak_speed", "m/s", "greatest speed of an actuator over the gait"),
        Objective("peak_power", "W", "greatest power of an actuator over the gait"),
        Objective("mass", "kg", "mass of the moving links"),
    )
}


def objectives_of(leg: Leg, wanted: Sequence[str | Objective], has_path: bool) -> tuple[Objective, ...]:
    """Look up and check what is asked for.

    Raises
    ------
    ParameterError
        There is no objective of that name, or two have it.
    UnsupportedError
        The leg has not the three coordinates that it needs.
    StudyError
        It needs a path of the foot and there is none, or a function cannot be found by other processes.
    """
    from dataclasses import replace

    from leg_dynamics.analysis.design.ranges import check_names

    names = [each if isinstance(each, str) else each.name for each in wanted]
    # An objective without a function is a built-in one, as a study holds it.
    wanted = [each if isinstance(each, str) or each.function is not None else each.name for each in wanted]
    check_names("objective", [each for each in wanted if isinstance(each, str)], BUILT_IN, leg.name)
    if len(set(names)) < len(names) or not names:
        raise ParameterError(f"the objectives {', '.join(names) or '(none)'} must be at least one, and all different")
    found: list[Objective] = []
    for each in wanted:
        objective = BUILT_IN[each] if isinstance(each, str) else each
        if not isinstance(each, str):
            _check_own(objective, leg)
        if objective.function is None:
            if len(leg.joint_names) != 3 and objective.name in (*STEP, *MOTION):
                raise UnsupportedError(
                    f"objective {objective.name!r} needs a leg with three coordinates; {leg.name!r} has "
                    f"{len(leg.joint_names)}: leave it out",
                    objective=objective.name,
                )
            if objective.name in MOTION and not has_path:
                raise StudyError(f"objective {objective.name!r} needs a path of the foot: give a gait")
            objective = replace(objective, unit=_unit(objective, leg))
        found.append(objective)
    return tuple(found)


def _check_own(objective: Objective, leg: Leg) -> None:
    if objective.function is None or objective.name in (*BUILT_IN, *leg.parameters):
        raise StudyError(
            f"objective {objective.name!r} of your own needs a function, and a name that no parameter and no built-in "
            "objective has"
        )
    try:
        pickle.dumps(objective.function)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise StudyError(
            f"objective {objective.name!r} cannot be handed to other processes ({error}): make its function one of a "
            "module, not a lambda or a local one"
        ) from None


def _unit(objective: Objective, leg: Leg) -> str:
    turning = set(leg.units.actuators) == {"N·m"}
    own: dict[str, Any] = {
        "V": {1: "m", 2: "m²"}.get(len(leg.joint_names), "m³"),
        "peak_force": "N·m" if turning else "N",
        "peak_speed": "rad/s" if turning else "m/s",
    }
    return str(own.get(objective.name, objective.unit))


DEFAULT = (*DEXTERITY[:3], "L", "Z_b", "Z_f")
"""For a leg with three coordinates; others have the first three."""
