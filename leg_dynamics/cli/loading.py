"""Legs, robots, trajectories and foot forces, as the options name them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from leg_dynamics.cli.options import read_numbers, read_parameters
from leg_dynamics.cli.output import error_console
from leg_dynamics.errors import DescriptionError, FormulaAssumptionError, JointLimitError, RouteError, TrajectoryError

if TYPE_CHECKING:
    from leg_dynamics.analysis.gait import Robot
    from leg_dynamics.analysis.trajectories import Trajectory
    from leg_dynamics.leg import Leg

MAX_FORCE = 1e30
"""N; the largest component of a force on the foot: a preview draws in single precision."""
FULL_RATE = 1000.0
"""Samples a second of a named trajectory."""


def load_leg(
    name: str,
    route: str | None = None,
    set_: Sequence[str] | None = None,
    foot: str | None = None,
    urdf: Path | None = None,
    transmission: str = "exact",
    mode: str | None = None,
) -> Leg:
    """Load a leg as its options say."""
    import leg_dynamics

    options = load_options(set_, foot, urdf, transmission) | {"mode": mode}
    with error_console().status("loading"):
        return leg_dynamics.load(name, route, **options)


def load_quick(name: str, route: str | None, set_: Sequence[str] | None, foot: str | None, urdf: Path | None) -> Leg:
    """Load a leg for many thousand poses: compiled, where the caller names no route."""
    from leg_dynamics.routes import sibling

    model = load_leg(name, route, set_, foot, urdf)
    return sibling(model, "symbolic") if route is None and model.route == "pinocchio" else model


def load_options(
    set_: Sequence[str] | None, foot: str | None, urdf: Path | None, transmission: str = "exact"
) -> dict[str, Any]:
    """The arguments of `load` that the options give."""
    return {
        "parameters": read_parameters(set_),
        "foot": foot,
        "urdf": None if urdf is None else str(urdf),
        "transmission": transmission,
    }


def load_robot(name: str, legs: Sequence[str] | None, route: str | None, set_: Sequence[str] | None) -> Robot:
    """Read a robot and the legs that it walks on: the named ones, or shipped ones that fit, one model or several."""
    import leg_dynamics
    from leg_dynamics import description
    from leg_dynamics.analysis.gait import robot_from
    from leg_dynamics.analysis.gait.reading import leg_prefixes, moving_hip
    from leg_dynamics.analysis.gait.robot import hip_link

    mechanism = description.read(name, parameters=read_parameters(set_))

    def own(candidate: str) -> list[str]:
        """The parameters that the leg has as well: a robot's body has some of its own."""
        known = description.read(candidate).parameters
        return [text for text in set_ or () if text.partition("=")[0].strip() in known]

    if legs:
        return robot_from(mechanism, [load_leg(leg, route, own(leg)) for leg in legs])
    reason = ""
    partly: list[Leg] = []
    refused: dict[str, str] = {}
    for candidate in leg_dynamics.available():
        usual = description.read(candidate)
        if not usual.has_link("foot"):
            continue
        try:
            model = load_leg(candidate, route, own(candidate))
        except (DescriptionError, FormulaAssumptionError, RouteError) as error:
            # Only a leg that the robot could have is missed.
            for prefix in leg_prefixes(mechanism, [usual]):
                refused[candidate] = str(error)
                if moving := moving_hip(mechanism, prefix + hip_link(usual)):
                    reason = reason or f": the hip of {prefix!r} hangs on the moving joint {moving!r}"
            continue
        try:
            return robot_from(mechanism, model)
        except DescriptionError as error:
            # Some of the robot's legs may be this one, and some another.
            if "prefixes" in error.evidence:
                partly.append(model)
                reason = reason or f": {error.message.removeprefix(f'{mechanism.file}: ')}"
    if len(partly) > 1:
        try:
            return robot_from(mechanism, partly)
        except DescriptionError as error:
            reason = f": {error.message.removeprefix(f'{mechanism.file}: ')}"
    if refused:
        values = f" with {', '.join(set_)}" if set_ else ""
        reasons = "; ".join(f"{candidate}: {why}" for candidate, why in refused.items())
        raise DescriptionError(
            f"the legs of {mechanism.name!r} cannot be compared with the shipped ones that their links are named "
            f"after, for these do not load{values} ({reasons}){reason.replace(':', '; besides,', 1)}; choose values "
            "that these legs take too, or name another leg with --leg",
            file=mechanism.file,
            refused=refused,
        )
    raise DescriptionError(
        f"{mechanism.name!r} has no legs that are a shipped one or its mirror image{reason}; give a robot, such as "
        "hexapod or quadruped, and name its leg with --leg",
        file=mechanism.file,
    )


@dataclasses.dataclass(frozen=True)
class FootLoad:
    """The force on the foot that the options ask for: always, in a window, or in the stance of a gait."""

    force: tuple[float, ...] | None
    window: tuple[float, ...] | None
    in_stance: bool

    @classmethod
    def read(cls, foot_force: str | None, force_window: str | None, support_force: str | None) -> FootLoad:
        """Read the options' texts; refuse what does not go together or is out of range."""
        if support_force is not None and (foot_force is not None or force_window is not None):
            raise typer.BadParameter(
                "the gait says when it acts; it goes with neither --foot-force nor --force-window",
                param_hint="--support-force",
            )
        option, text = ("--foot-force", foot_force) if support_force is None else ("--support-force", support_force)
        force = None if text is None else read_numbers(option, text, 3)
        window = None if force_window is None else read_numbers("--force-window", force_window, 2)
        if force is None:
            if window is not None:
                raise typer.BadParameter("--force-window needs --foot-force")
        elif max(map(abs, force)) > MAX_FORCE:
            raise typer.BadParameter(
                f"{text!r} is out of range: no component may exceed {MAX_FORCE:g} N", param_hint=option
            )
        return cls(force, window, support_force is not None)

    def on(self, motion: Trajectory, leg: Leg, choice: str | None) -> Trajectory:
        """Return the motion with this force; `choice` is the trajectory that the options name."""
        if self.force is None:
            return motion
        if not self.in_stance:
            return motion.with_foot_force(self.force, *(self.window or (None, None)))
        from leg_dynamics.analysis.trajectories import named, named_cycle

        names = list(named(leg.description.name))
        cycle = named_cycle(leg.description.name, choice or next(iter(names), ""))
        if cycle is None:
            gaits = [name for name in names if named_cycle(leg.description.name, name) is not None]
            raise TrajectoryError(
                f"{motion.name!r} is no gait with a stance for --support-force to act in (gaits of "
                f"{leg.description.name!r}: {', '.join(gaits) or 'none'}); use --foot-force, with --force-window"
            )
        return motion.with_foot_force(cycle.support_force(motion.time, self.force))


def choose_trajectory(
    leg: Leg, choice: str | None, duration: float | None, rate: float | None, ignore_limits: bool
) -> Trajectory:
    """The named trajectory or that of a file, or the leg's first one."""
    from leg_dynamics.analysis.trajectories import from_csv, named

    names = named(leg, limits="ignore" if ignore_limits else "error")
    known = f"named ones of {leg.description.name!r}: {', '.join(names) or 'none'}"
    if choice is None:
        if not names:
            raise TrajectoryError(f"no trajectory is given; pass --trajectory FILE.csv ({known})")
        choice = next(iter(names))
    if choice in names:
        motion = names[choice](duration, FULL_RATE if rate is None else rate)
        if not ignore_limits:
            motion.check_limits_of(leg)
        return motion
    # pathlib reads an empty text as the current folder, which exists.
    if not (choice and (choice.lower().endswith(".csv") or Path(choice).exists())):
        raise TrajectoryError(f"there is neither a trajectory nor a file {choice!r} ({known})")
    if duration is not None or rate is not None:
        raise typer.BadParameter("--duration and --rate go with a named trajectory; a file brings its own times")
    from leg_dynamics.description.places import with_place

    try:
        return from_csv(choice, leg, limits="ignore" if ignore_limits else "error")
    except JointLimitError as error:
        raise with_place(leg.description, None, error) from None


def is_named(leg: Leg, choice: str | None) -> bool:
    """Whether the choice is a named trajectory of the leg, or absent; otherwise it is a file."""
    from leg_dynamics.analysis.trajectories import named

    return choice is None or choice in named(leg.description.name)
