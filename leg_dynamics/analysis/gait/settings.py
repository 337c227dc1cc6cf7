"""How a robot walks where nobody says otherwise, and why: gait, times, lengths and body motion by the robot's legs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.gait.phases import GAITS, PhaseTable, phase_table, swing_order
from leg_dynamics.analysis.gait.posture import splayed_homes
from leg_dynamics.analysis.gait.robot import Limb, Robot
from leg_dynamics.analysis.gait.steadying import margin_bound, steadying_sway
from leg_dynamics.analysis.gait.study import Choice, plan
from leg_dynamics.analysis.gait.walk import Sway, Tilt, Walk
from leg_dynamics.description.places import face_of_foot, module_of_joint
from leg_dynamics.errors import TrajectoryError

__all__ = ["Settings", "WalkPlan", "plan_walk", "settings_for"]

AS_ASKED = "as asked for"


@dataclass(frozen=True)
class Settings:
    """Parameters of a walk; None leaves one to the gait or to the robot's home pose.

    Attributes
    ----------
    gait : str or tuple of str
        A name of `GAITS`, or the legs in the order in which they swing.
    group : int
        Of a swing order, see `swing_order`.
    period : float
        s.
    duty : float or None
    stride : float or None
        m; see `plan`. None where `velocity` is given.
    velocity : tuple of two floats or None
        m/s.
    turn : float
        rad/s.
    clearance : float
        m.
    law : str
    splay, reach, body_height : float or None
        rad, m, m; see `splayed_homes`.
    sway : tuple of two floats
        Greatest shift of the body ahead and to the left, m, of the sway that steadies the walk; zeros for none.
    harmonics : int
        Of the sway.
    tilt : Tilt or None
    """

    gait: str | tuple[str, ...] = "tripod"
    group: int = 1
    period: float = 4.0
    duty: float | None = None
    stride: float | None = 0.2
    velocity: tuple[float, float] | None = None
    turn: float = 0.0
    clearance: float = 0.1
    law: str = "polynomial"
    splay: float | None = None
    reach: float | None = None
    body_height: float | None = None
    sway: tuple[float, float] = (0.0, 0.0)
    harmonics: int = 4
    tilt: Tilt | None = None

    def changed(self, **options: Any) -> Settings:
        """With all options that are not None; stride and velocity replace each other."""
        given = {name: value for name, value in options.items() if value is not None}
        if "stride" in given and "velocity" in given:
            raise TrajectoryError("give either the stride or the velocity of a walk; the duty factor links both")
        if "stride" in given:
            given["velocity"] = None
        elif "velocity" in given:
            given["stride"] = None
        return replace(self, **given)


@dataclass(frozen=True, eq=False)
class WalkPlan:
    """A walk, where its parameters come from, and walks to compare it with."""

    walk: Walk
    choices: tuple[Choice, ...] = ()
    alternatives: Mapping[str, Walk] = field(default_factory=dict)


def settings_for(robot: Robot) -> Settings:
    """What the robot walks with by default: the creeping gait of Chen 2021 on four legs of two modules, else a tripod.

    What the robot or its file is called does not matter.
    """
    order = _creeping_order(robot)
    return Settings() if order is None else replace(_MODULAR_QUADRUPED, gait=order)


def plan_walk(robot: Robot, **options: Any) -> WalkPlan:
    """Plan a walk by `settings_for` the robot, with some of them changed.

    Parameters
    ----------
    robot : Robot
    **options
        Fields of `Settings`; None for the robot's own.

    Returns
    -------
    WalkPlan

    Raises
    ------
    TrajectoryError, ShapeError, NonFiniteError
        A number is not usable, or the gait does not fit the robot.
    OutOfReachError
        A foot is out of reach with a sway.
    """
    own = settings_for(robot)
    settings = own.changed(**options)
    table = _table(robot, settings)
    sway_bounds = arguments.vector("sway", settings.sway, 2, "m ahead and to the left").tolist()
    even = _walk(robot, settings, table)
    if not any(sway_bounds):
        return WalkPlan(even, _choices(robot, own, settings, even))

    def steadied(ahead: float, left: float) -> Walk:
        sway = steadying_sway(robot, even, ahead, left, harmonics=settings.harmonics)
        return replace(even, sway=sway)

    ahead, left = sway_bounds
    alternatives = {"even motion of the body": even}
    way = _way(even)
    if ahead and left and way is not None:
        words, axis = way
        along = (ahead, 0.0) if axis == 0 else (0.0, left)
        name = f"{words}, at a speed that changes (sway {along[0]:g},{along[1]:g} m)"
        alternatives[name] = steadied(*along)
    if _creeping_order(robot) is not None and not isinstance(settings.gait, str):
        alternatives |= _without_pauses(robot, settings, settings.gait)
    return WalkPlan(steadied(ahead, left), _choices(robot, own, settings, even), alternatives)


def _way(walk: Walk) -> tuple[str, int] | None:
    """How the body goes, in words, and along which of its axes, 0 ahead and 1 to the left; None where along neither."""
    forward, sideward, turn = walk.twist
    if bool(forward) == bool(sideward):
        return None
    axis, positive = (0, forward > 0.0) if forward else (1, sideward > 0.0)
    words = ("ahead", "back") if axis == 0 else ("to the left", "to the right")
    return f"{'along its arc' if turn else 'straight'} {words[0 if positive else 1]}", axis


def _table(robot: Robot, settings: Settings) -> PhaseTable:
    if not isinstance(settings.gait, str):
        return swing_order(settings.gait, robot, settings.duty, group=settings.group)
    if settings.gait not in GAITS:
        raise TrajectoryError(
            f"gait must be {', '.join(GAITS)}, or the legs in the order in which they swing "
            f"({','.join(robot.leg_names)}), not {settings.gait!r}"
        )
    return phase_table(settings.gait, robot, settings.duty)


def _walk(robot: Robot, settings: Settings, table: PhaseTable, sway: Sway | None = None) -> Walk:
    return plan(
        robot,
        table,
        period=settings.period,
        stride=settings.stride,
        velocity=settings.velocity,
        turn=settings.turn,
        clearance=settings.clearance,
        law=settings.law,
        homes=splayed_homes(robot, settings.splay, settings.reach, settings.body_height),
        sway=sway,
        tilt=settings.tilt,
    )


# The modular quadruped of Chen & Dong 2021.

_ORDER = ((-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
"""Legs III, I, IV, II: rear left, front left, rear right, front right; signs of the hips' x and y."""

_COORDINATES = 3

_MODULAR_QUADRUPED = Settings(
    gait=("III", "I", "IV", "II"),
    group=2,
    period=20.0,
    duty=0.8,
    stride=None,
    velocity=(0.003, 0.0),
    clearance=0.015,
    splay=0.35,
    reach=0.125,
    body_height=0.195,
    sway=(0.02, 0.02),
)


def _creeping_order(robot: Robot) -> tuple[str, ...] | None:
    """The legs in the paper's order; None of a robot that has not one leg of two modules at each of four corners."""
    if len(robot) != len(_ORDER) or not all(_is_of_two_modules(limb) for limb in robot.limbs):
        return None
    places = np.array([limb.hip[:2, 3] for limb in robot.limbs])
    corners = [tuple(signs) for signs in np.sign(places - places.mean(axis=0)).tolist()]
    if sorted(corners) != sorted(_ORDER):
        return None
    return tuple(robot.leg_names[corners.index(corner)] for corner in _ORDER)


def _is_of_two_modules(limb: Limb) -> bool:
    """Whether three joints drive the leg, two of its first module and one of its last, which has the foot."""
    description = getattr(limb.leg, "description", None)
    if description is None:
        return False
    modules = [module_of_joint(description, name) for name in limb.leg.joint_names]
    foot = face_of_foot(description, getattr(limb.leg, "foot", None))
    return (
        foot is not None
        and len(modules) == _COORDINATES
        and None not in modules
        and modules[0] == modules[1] != modules[2] == foot.module
    )


def _without_pauses(robot: Robot, settings: Settings, order: tuple[str, ...]) -> dict[str, Walk]:
    """The walk as the paper's times have it: each leg lifts off as the one before touches down."""
    table = swing_order(order, robot)
    return {f"duty factor {table.duty:g}, no pauses, even motion": _walk(robot, replace(settings, duty=None), table)}


def _bound_without_pauses(robot: Robot, settings: Settings) -> float:
    order = _creeping_order(robot)
    assert order is not None
    return max(margin_bound(walk) for walk in _without_pauses(robot, settings, order).values())


_REASONS: Mapping[str, Callable[[Robot, Settings], str]] = {
    "gait": lambda robot, settings: "order of the legs: Chen 2021, section 1.2",
    "group": lambda robot, settings: (
        "chosen: after two legs of a side the next one is diagonally across, and pauses are needed there only"
    ),
    "period": lambda robot, settings: "inferred: leg IV, third of four, lifts off at 10 s (Chen 2021, section 3)",
    "duty": lambda robot, settings: (
        "chosen: steps of 4 s, leg IV from 10 to 14 s within the 10 to 15 s of section 3. Steps of 5 s mean 0.75 and "
        "no pauses, and then no motion of the body has a margin above "
        f"{1e3 * _bound_without_pauses(robot, settings):.3g} mm"
    ),
    "velocity": lambda robot, settings: "chosen: steps of 60 mm, for the paper gives no stride",
    "clearance": lambda robot, settings: (
        "chosen: a quarter of the step; the paper gives none, and a higher one brings theta3 to its limit"
    ),
    "splay": lambda robot, settings: (
        "chosen: 20 deg, front legs ahead and rear ones back, for neighbours 110 mm wide touch at theta1 = 0"
    ),
    "reach": lambda robot, settings: (
        "chosen with the height: shanks almost upright, so that stride and sway change theta3 little"
    ),
    "body_height": lambda robot, settings: (
        "chosen: between -70 deg of theta3 and the straight leg, foot and pitch axis are 180 to 215 mm apart"
    ),
    "sway": lambda robot, settings: (
        "chosen: the body leaves its even motion by up to that to keep the centre of mass over the feet; greatest "
        "least margin, never backwards"
    ),
    "harmonics": lambda robot, settings: "chosen: quick enough to cross the diagonals within the pauses, and smooth",
}

_WORDS = {
    "gait": ("gait", ""),
    "group": ("legs that swing without a pause", ""),
    "period": ("period", "s"),
    "duty": ("duty factor", ""),
    "stride": ("stride", "m"),
    "velocity": ("velocity ahead, left", "m/s"),
    "turn": ("turn rate", "rad/s"),
    "clearance": ("clearance", "m"),
    "law": ("path law", ""),
    "splay": ("splay", "rad"),
    "reach": ("reach", "m"),
    "body_height": ("body height", "m"),
    "sway": ("greatest sway ahead, left", "m"),
    "harmonics": ("harmonics of the sway", ""),
    "tilt": ("tilt", "rad"),
}


def _choices(robot: Robot, own: Settings, settings: Settings, even: Walk) -> tuple[Choice, ...]:
    """Where each parameter comes from; only of a robot whose settings have reasons."""
    if _creeping_order(robot) is None:
        return ()
    rows = []
    for each in fields(Settings):
        value, usual = getattr(settings, each.name), getattr(own, each.name)
        if value is None or (value == usual and each.name not in _REASONS):
            continue
        text, unit = _WORDS[each.name]
        if (each.name == "harmonics" and not any(settings.sway)) or (
            each.name == "group" and isinstance(settings.gait, str)
        ):
            continue
        shown = f"{_shown(value)} {unit}".rstrip()
        rows.append(Choice(text, shown, _REASONS[each.name](robot, settings) if value == usual else AS_ASKED))
    return tuple(rows)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        texts = [each if isinstance(each, str) else f"{each:g}" for each in value]
        return ("-" if all(isinstance(each, str) for each in value) else ", ").join(texts)
    if isinstance(value, Tilt):
        return f"roll {value.roll:g}, pitch {value.pitch:g}" + (
            ", swinging" if value.cosine.any() or value.sine.any() else ""
        )
    return f"{value:g}" if isinstance(value, float) and math.isfinite(value) else str(value)
