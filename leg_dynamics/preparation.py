"""What is done to a mechanism before a route gets it: one leg taken out, joints of one coordinate, flags, mode."""

from __future__ import annotations

import functools
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from leg_dynamics.errors import DescriptionError, LegDynamicsWarning, ParameterError, UnsupportedError

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description

__all__ = ["Preparation", "mode_of"]


@dataclass(frozen=True)
class Preparation:
    """Changes to a description, the same for every reading of its source.

    Attributes
    ----------
    trusted : bool
        Whether the independent flags are known to fit: those of shipped files are.
    part : str or None
        The leg of a robot with several, as `leg_dynamics.description.legs.leg_part` takes it.
    foot : str or None
        That leg's foot link, where it was named.
    mode : tuple of (str, float)
        Joint coordinates of a closed pose that define the assembly mode; empty for the file's own.
    """

    trusted: bool = False
    part: str | None = None
    foot: str | None = None
    mode: tuple[tuple[str, float], ...] = ()

    def of(self, description: Description) -> Description:
        """The mechanism as routes take it.

        Raises
        ------
        DescriptionError
            The robot has no such leg, or the mechanism cannot move.
        UnsupportedError
            It has more joints than any route takes.

        Warns
        -----
        LegDynamicsWarning
            Independent joints had to be chosen.
        """
        from leg_dynamics.description.lowering import single_coordinate

        moving = len(description.moving_joints)
        if moving > _MOST_JOINTS:
            # No route takes so many: said at once, before anything is rewritten or imported.
            raise UnsupportedError(
                f"{moving} tree joints are too many, no route takes more than {_MOST_JOINTS}: fix joints that need not "
                "move, or model a part of the mechanism",
                joints=moving,
            )
        if self.part is not None:
            from leg_dynamics.description.legs import leg_part

            description = leg_part(description, self.part, self.foot)
        description = single_coordinate(description)
        if not self.trusted:
            description = _with_flags(description)
        if self.mode:
            from leg_dynamics.description.poses import with_home

            description = with_home(description, dict(self.mode))
        return description


_MOST_JOINTS = 1000
# Starts in the search for a mode by its name: of many modes the first hundred may miss some.
_ATTEMPTS = (100, 400, 1600)


@functools.lru_cache(maxsize=64)
def _chosen(description: Description) -> tuple[str, ...] | None:
    from leg_dynamics.mechanism.independence import independent_set

    return independent_set(description)


def _with_flags(description: Description) -> Description:
    """The mechanism with independent joints that fit its mobility, where its file states none or wrong ones."""
    from leg_dynamics.description.flags import states_flags, with_independent
    from leg_dynamics.description.topology import split_independent

    if not (description.loops or description.couplings):
        return description
    names = _chosen(description)
    if names is None:
        return description
    if not names:
        raise DescriptionError(
            "the loops leave no motion, the mechanism's mobility is 0: check the loops' types and axes (a hinge that "
            "is not parallel to the others locks a planar linkage)",
            file=description.file,
            mobility=0,
        )
    driven = {transmission.joint for transmission in description.transmissions}
    idle = [name for name in names if name not in driven]
    passive = f", of which {', '.join(idle)} passive" if driven and idle else ""
    if states_flags(description):
        independent, _ = split_independent(description)
        stated = [name for name in independent if description.joint(name).independent_is_stated]
        silent = [name for name in independent if name not in stated]
        others = f" with {', '.join(silent)}, independent for want of a flag," if silent else ""
        fault = f"the joints stated as independent, {', '.join(stated) or 'none'},{others} do not fit"
        advice = "correct the flags"
    else:
        fault, advice = "no joint states an independent flag", "state the flags to choose others"
    warnings.warn(
        f"{description.file}: {fault}, and the loops leave {len(names)} motion{'s' * (len(names) != 1)}: taking "
        f"{', '.join(names)} as independent{passive}; {advice}",
        LegDynamicsWarning,
        stacklevel=4,
    )
    return with_independent(description, names)


def mode_of(description: Description, mode: str | Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """Joint coordinates that define an assembly mode, by its name or by a pose near one of its poses.

    Parameters
    ----------
    description : Description
        As `Preparation.of` returns it.
    mode : str or mapping of str to float
        A name that `leg_dynamics.Leg.assembly_modes` lists or a configuration of the file, or joint coordinates, rad or
        m, of which a pose of the mode is not far; joints left out are as in the file's own mode.

    Raises
    ------
    AssemblyError
        There is no closed, regular pose there.
    ParameterError
        There is no such mode or joint, or a value is not a finite number.
    """
    from leg_dynamics.mechanism.mechanism import Mechanism
    from leg_dynamics.mechanism.modes import NAME_DIGITS, find_modes, mode_near

    mechanism = Mechanism(description)
    if isinstance(mode, Mapping):
        return mode_near(mechanism, mode)
    if not isinstance(mode, str):
        raise ParameterError(
            f"an assembly mode is a name or joint coordinates, got {type(mode).__name__} {mode!r}", parameter="mode"
        )
    for configuration in description.configurations:
        if configuration.name == mode:
            return mode_near(mechanism, configuration.values)
    with warnings.catch_warnings():
        # A mode is being chosen: that the file does not say which is no news.
        warnings.simplefilter("ignore", LegDynamicsWarning)
        # No search finds a name of another form: the first one is enough to list those that there are.
        is_name = re.fullmatch(rf"mode_[0-9a-f]{{{NAME_DIGITS}}}", mode)
        for attempts in _ATTEMPTS if is_name else _ATTEMPTS[:1]:
            found = find_modes(mechanism, attempts=attempts)
            for each in found:
                if each.name == mode:
                    return tuple(each.coordinates.items())
    named = (each.name + (f" ({', '.join(each.configurations)})" if each.configurations else "") for each in found)
    raise ParameterError(
        f"{description.name!r} has no assembly mode {mode!r}: those found at the home coordinates are "
        f"{', '.join(named)}; another one is chosen by a mapping of joint coordinates",
        parameter="mode",
    )
