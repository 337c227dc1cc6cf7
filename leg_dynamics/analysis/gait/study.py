"""One cycle of a walk computed: joint motion, centre of mass, stability, foot forces, actuator efforts, peaks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.gait.forces import share_load
from leg_dynamics.analysis.gait.limits import LimitMargin, limit_margins, most_broken
from leg_dynamics.analysis.gait.phases import PhaseTable, phase_table
from leg_dynamics.analysis.gait.robot import Limb, Robot
from leg_dynamics.analysis.gait.stability import project, support_margin
from leg_dynamics.analysis.gait.walk import BodyMotion, FootMotion, Sway, Tilt, Twist, Walk
from leg_dynamics.analysis.trajectories import FootPath, Trajectory
from leg_dynamics.description.places import face_of_foot, foot_words, joint_words, module_of_joint
from leg_dynamics.errors import AssemblyError, JointLimitError, RowError, SupportError, TrajectoryError

__all__ = ["LOADS", "Choice", "GaitStudy", "LimbMotion", "Peaks", "instants", "plan", "static_margin", "study"]

LOADS = ("balanced", "equal", "none")
"""How the standing feet carry the robot: `share_load`; each the same vertical force; or not at all."""

MAX_SAMPLES = 100_000

EDGE = 1e-7
"""Share of the period between the two samples at a touch-down or lift-off: forces and supports jump there."""

_SAME_FOOT = 1e-6
"""m; by how much the foot of a pose may miss the target that it was computed for."""

_FLIP = 0.5
"""Of a step between samples: rates at both ends foretell it to a far smaller share, unless the pose jumps."""


class Peaks(NamedTuple):
    """Largest magnitudes over the cycle, each (n,) or (m,), with the sign that they have there."""

    speed: NDArray[np.float64]
    """m/s or rad/s."""
    stance_speed: NDArray[np.float64]
    """The same on the ground."""
    effort: NDArray[np.float64]
    """N or N·m."""
    stance_effort: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Least and greatest effort on the ground."""
    power: NDArray[np.float64]
    """Greatest mechanical power delivered, W; NaN where an actuator is not on a coordinate of its own."""


class Choice(NamedTuple):
    """One parameter of a walk and where it comes from."""

    parameter: str
    value: str
    """With its unit."""
    reason: str


@dataclass(frozen=True, eq=False)
class LimbMotion:
    """What one leg does, at T instants, in the coordinates of the leg's model.

    Attributes
    ----------
    limb : Limb
    stance : (T,) array of bool
    trajectory : Trajectory
        q, v, a (T, n), and in `foot_force` the ground's force in the model's hip frame.
    effort : (T, m) array
        N or N·m.
    """

    limb: Limb
    stance: NDArray[np.bool_]
    trajectory: Trajectory
    effort: NDArray[np.float64]

    @property
    def position_margin(self) -> NDArray[np.float64]:
        """Distance of each coordinate to its nearer limit over the cycle, (n,), negative outside."""
        q, limits = self.trajectory.q, self.limb.leg.limits
        return np.asarray(np.minimum(q - limits.lower, limits.upper - q).min(axis=0))

    def peaks(self) -> Peaks:
        """Largest speeds, efforts and powers."""
        v, f = self.trajectory.v, self.effort
        power = f * v if f.shape == v.shape else np.full_like(f, np.nan)
        on = self.stance
        none = np.full(f.shape[1], np.nan)
        ends = (f[on].min(axis=0), f[on].max(axis=0)) if on.any() else (none, none)
        stance_speed = _largest(v[on]) if on.any() else np.full(v.shape[1], np.nan)
        return Peaks(_largest(v), stance_speed, _largest(f), ends, power.max(axis=0))


@dataclass(frozen=True, eq=False)
class GaitStudy:
    """A walk over T instants of one period, both ends included; N legs.

    Attributes
    ----------
    robot : Robot
    walk : Walk
    time : (T,) array
        s; evenly spaced, and two at each touch-down and lift-off, `EDGE` of a period apart, with the feet before and
        after it: what jumps there is seen from both sides.
    stance : (T, N) array of bool
    feet : FootMotion
        In the body frame, (T, N, 3) each.
    body : BodyMotion
        In the world, and how body axes stand against level ones.
    limbs : tuple of LimbMotion
    mass : float
        Of the whole robot, kg.
    com : (T, 3) array
        Centre of mass in the body frame, m: trunk and every moving link of the legs where it is at that instant.
    margin : (T,) array
        Static stability margin, m, see `support_margin`.
    force : (T, N, 3) array
        Of the ground on the feet, N, body frame.
    residual : (T,) array
        What the forces leave unbalanced, N, see `LoadSharing`; of equal forces it is the moment.
    load : str
        One of `LOADS`.
    friction : float or None
    limits : tuple of LimitMargin
        Margins of all that limits the legs' poses: joints driven and passive, cones, telescopes, clearances.
    choices : tuple of Choice
        Why the walk is as it is, where whoever planned it says so.
    alternatives : tuple of (str, float)
        Least static stability margins of other walks, m, for comparison; NaN where a foot would be out of reach.
    """

    robot: Robot
    walk: Walk
    time: NDArray[np.float64]
    stance: NDArray[np.bool_]
    feet: FootMotion
    body: BodyMotion
    limbs: tuple[LimbMotion, ...]
    mass: float
    com: NDArray[np.float64]
    margin: NDArray[np.float64]
    force: NDArray[np.float64]
    residual: NDArray[np.float64]
    load: str
    friction: float | None
    limits: tuple[LimitMargin, ...] = ()
    choices: tuple[Choice, ...] = ()
    alternatives: tuple[tuple[str, float], ...] = ()

    def __repr__(self) -> str:
        return (
            f"<GaitStudy of {self.robot.name!r}: {self.walk.table.name}, {self.walk.period:g} s, "
            f"margin {self.margin.min():.4g} to {self.margin.max():.4g} m>"
        )

    @property
    def level_force(self) -> NDArray[np.float64]:
        """`force` in level axes, N, (T, N, 3): the third component is the vertical one, also of a tilted body."""
        return self.body.level(self.force)

    def nearest_limits(self) -> tuple[LimitMargin, ...]:
        """`limits` from the nearest to the farthest, by the least normalised margin over the cycle."""
        return tuple(sorted(self.limits, key=lambda each: each.least_normalised))

    def joint_values(self) -> dict[str, NDArray[np.float64]]:
        """Coordinates of the robot's file along the cycle, (T,) each, for its picture; loops closed."""
        values: dict[str, NDArray[np.float64]] = {}
        for motion in self.limbs:
            values |= motion.limb.assemble(motion.trajectory.q)
        return values

    def efforts(self) -> dict[str, NDArray[np.float64]]:
        """Effort of each actuator along the cycle, (T,), by its name in the robot's file and with its sign there."""
        found: dict[str, NDArray[np.float64]] = {}
        for motion in self.limbs:
            signs = motion.limb.signs if motion.effort.shape[1] == len(motion.limb.signs) else np.ones(1)
            found |= dict(zip(motion.limb.actuator_names, (motion.effort * signs).T, strict=True))
        return found


def plan(
    robot: Robot,
    gait: str | PhaseTable | Mapping[str, float] | Sequence[float] = "tripod",
    *,
    period: float,
    stride: float | None = None,
    velocity: tuple[float, float] | None = None,
    turn: float = 0.0,
    clearance: float = 0.1,
    duty: float | None = None,
    law: str = "polynomial",
    body_height: float | None = None,
    homes: Any = None,
    sway: Sway | None = None,
    tilt: Tilt | tuple[float, float] | None = None,
) -> Walk:
    """Plan a walk for a robot.

    Parameters
    ----------
    robot : Robot
    gait, duty
        As for `phase_table`.
    period : float
        s.
    stride : float, optional
        How far a foot goes back below the body during one stance, m; with `velocity` absent, straight ahead at
        stride / (duty * period).
    velocity : tuple of two floats, optional
        m/s ahead and to the left, in place of `stride`.
    turn : float
        rad/s to the left.
    clearance : float
        m.
    law : str
        Path law of the swing.
    body_height : float, optional
        Height of the body's origin above the ground, m; by default the feet's home.
    homes : array_like, shape (N, 3), optional
        Neutral positions of the feet in the body frame, m; by default the robot's.
    sway : Sway, optional
    tilt : Tilt or tuple of two floats, optional
        Roll and pitch of the body, rad: fixed where two numbers, or by a law.

    Returns
    -------
    Walk

    Raises
    ------
    TrajectoryError, ShapeError, NonFiniteError
        A number is not usable, both or neither of stride and velocity are given, or feet stand at different heights.
    """
    arguments.kind("robot", robot, Robot, hint="robot_from reads one")
    table = phase_table(gait, robot, duty)
    length = arguments.positive("period", period, "seconds")
    if (stride is None) == (velocity is None):
        raise TrajectoryError("give either the stride or the velocity of a walk; with the duty factor one is the other")
    if velocity is None:
        twist = Twist(arguments.real("stride", stride) / (table.duty * length), 0.0, arguments.real("turn rate", turn))
    else:
        forward, sideward = arguments.vector("velocity", velocity, 2, "m/s ahead and to the left")
        twist = Twist(float(forward), float(sideward), arguments.real("turn rate", turn))
    neutral = arguments.reals("homes", robot.homes if homes is None else homes)
    if body_height is not None:
        neutral[:, 2] = -arguments.positive("body height", body_height, "metres")
    if tilt is not None and not isinstance(tilt, Tilt):
        roll, pitch = arguments.vector("tilt", tilt, 2, "rad of roll and pitch")
        tilt = Tilt(float(roll), float(pitch))
    return Walk(table, neutral, length, twist, clearance, law, sway, tilt)


def study(
    robot: Robot,
    walk: Walk,
    *,
    samples: int = 400,
    load: str = "balanced",
    friction: float | None = None,
    branch: str | None = None,
    limits: str = "error",
    choices: Sequence[Choice] = (),
    alternatives: Mapping[str, Walk] | None = None,
) -> GaitStudy:
    """Compute one cycle of a walk.

    Joint rates and accelerations follow from exact foot targets. The load is the robot's weight and the inertia of its
    mass at the centre of mass, moving as the body does; what legs add by moving against the body, and angular momentum,
    are left out of the feet's load. A leg's own dynamics are complete but for its rotation with a turning or tilting
    body: gravity less the acceleration of its hip acts on it.

    Parameters
    ----------
    robot : Robot
    walk : Walk
        From `plan`.
    samples : int
        Even steps of a period; the switches of the gait come on top.
    load : {"balanced", "equal", "none"}
        How the standing feet carry the robot, see `LOADS`.
    friction : float, optional
        As for `share_load`; only with balanced loads.
    branch : str, optional
        Branch of the legs' inverse kinematics.
    limits : {"error", "ignore"}
        Whether poses outside a limit are refused: of a driven or a passive joint, a ball joint's cone, a telescope, or
        the clearance between two links. The margins of all are in `GaitStudy.limits` in any case.
    choices : sequence of Choice, optional
        Where the walk's parameters come from, for reports.
    alternatives : mapping of str to Walk, optional
        Walks whose least stability margin is computed for comparison.

    Returns
    -------
    GaitStudy

    Raises
    ------
    OutOfReachError, JointLimitError, SingularityError
        A foot is out of reach, a pose breaks a limit, or is singular; with `leg`, `time` (s), `margin`, and the `joint`
        or the `limit` by name.
    AssemblyError
        A leg changes its assembly mode on the way, or its branch is another mode than its dynamics know.
    SupportError
        The feet cannot carry the robot; `margin` is that of the zero-moment point, m, and `time` the first instant.
    """
    count = arguments.whole("the number of samples", samples, 4, MAX_SAMPLES)
    arguments.choice("load", load, LOADS)
    arguments.choice("limits", limits, ("error", "ignore"))
    if len(walk.table) != len(robot):
        raise TrajectoryError(f"the walk has {len(walk.table)} legs, but {robot.name!r} has {len(robot)}")
    if friction is not None and load != "balanced":
        raise TrajectoryError(f"a friction coefficient goes with balanced loads, not with {load!r} ones")
    time, stance = instants(walk, count)
    feet, body = walk.feet(time), walk.body(time)
    motions = [
        _follow(limb, time, FootMotion(*(values[:, i] for values in feet)), branch, limits)
        for i, limb in enumerate(robot.limbs)
    ]
    margins = limit_margins(robot, [motion.q for motion in motions])
    if limits == "error":
        _check_margins(robot, margins, time)
    mass, com = robot.centre_of_mass([motion.q for motion in motions])
    # The ground is level; the body need not be.
    level, centre, gravity = body.level(feet.position), body.level(com), body.in_body(_rows(robot.gravity, time))
    ground, margin = _support(robot, level, stance, centre)
    pull = body.level(gravity - body.acceleration_at(com))
    force, residual = _loads(robot, time, level, stance, centre, mass * pull, ground, load, friction)
    force = body.in_body(force)
    limbs = tuple(
        _loaded(limb, motion, stance[:, i], force[:, i], gravity - body.acceleration_at(limb.hip[:3, 3]))
        for i, (limb, motion) in enumerate(zip(robot.limbs, motions, strict=True))
    )
    others = tuple((name, _least_margin(robot, other, count, branch)) for name, other in (alternatives or {}).items())
    return GaitStudy(
        robot,
        walk,
        time,
        stance,
        feet,
        body,
        limbs,
        mass,
        com,
        margin,
        force,
        residual,
        load,
        friction,
        margins,
        tuple(choices),
        others,
    )


def static_margin(
    robot: Robot, walk: Walk, *, samples: int = 400, branch: str | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Static stability margin over a cycle, as `GaitStudy.margin`, without forces and efforts; limits do not count.

    Parameters
    ----------
    robot, walk, samples, branch
        As for `study`.

    Returns
    -------
    time, margin : numpy.ndarray, shape (T,)
        s and m.

    Raises
    ------
    OutOfReachError, SingularityError
        A foot is out of reach or a pose singular; with `leg` and `time` (s).
    """
    count = arguments.whole("the number of samples", samples, 4, MAX_SAMPLES)
    if len(walk.table) != len(robot):
        raise TrajectoryError(f"the walk has {len(walk.table)} legs, but {robot.name!r} has {len(robot)}")
    time, stance = instants(walk, count)
    feet, body = walk.feet(time).position, walk.body(time)
    _, com = robot.centre_of_mass(leg_poses(robot, time, feet, branch))
    return time, _support(robot, body.level(feet), stance, body.level(com))[1]


def leg_poses(
    robot: Robot, time: NDArray[np.float64], feet: NDArray[np.float64], branch: str | None, hint: str = ""
) -> list[NDArray[np.float64]]:
    """Coordinates of each leg, (T, n), for feet (T, N, 3) in the body frame; errors name leg and time."""
    poses = []
    for i, limb in enumerate(robot.limbs):
        try:
            poses.append(np.asarray(limb.leg.inverse_kinematics(limb.to_leg(feet[:, i]), branch, limits="ignore")))
        except RowError as error:
            when = float(time[int(error.rows.min())])
            own, words, place = _foot_place(limb)
            evidence = dict(error.evidence) | {"leg": limb.name, "time": when} | place
            what = error.message.removesuffix(own)
            raise type(error)(f"leg {limb.name!r} at t = {when:g} s: {what}{hint}{words}", **evidence) from error
    return poses


def _foot_place(limb: Limb) -> tuple[str, str, dict[str, str]]:
    """On which module's face a foot is, in a robot of modules: as errors of the leg end, as the robot's do, evidence.

    The robot's file has the names of the leg's file with the limb's prefix.
    """
    description = getattr(limb.leg, "description", None)
    own = None if description is None else face_of_foot(description, getattr(limb.leg, "foot", None))
    if own is None:
        return "", "", {}
    face = own._replace(module=limb.prefix + own.module)
    return foot_words(own), foot_words(face), {"module": face.module, "face": face.face}


def _joint_place(limb: Limb, joint: int) -> tuple[str, dict[str, str | None]]:
    """Of which module a joint is, likewise, by its number among the leg's coordinates."""
    description = getattr(limb.leg, "description", None)
    own = None if description is None else module_of_joint(description, limb.leg.joint_names[joint])
    if own is None:
        return "", {}
    module = limb.prefix + own
    return joint_words(limb.joint_names[joint], module), {"module": module, "face": None}


def _support(
    robot: Robot, feet: NDArray[np.float64], stance: NDArray[np.bool_], centre: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Height of the ground and static margin, (T,), for feet (T, N, 3) and centre of mass (T, 3) in level axes."""
    ground = np.where(stance, feet[..., 2], 0.0).sum(axis=1) / np.maximum(stance.sum(axis=1), 1)
    return ground, support_margin(feet[..., :2], stance, project(centre, robot.gravity, ground))


def _least_margin(robot: Robot, walk: Walk, samples: int, branch: str | None) -> float:
    try:
        return float(static_margin(robot, walk, samples=samples, branch=branch)[1].min())
    except RowError:
        return float("nan")


def _rows(vector: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.broadcast_to(vector, (time.size, 3))


def _check_margins(robot: Robot, margins: Sequence[LimitMargin], time: NDArray[np.float64]) -> None:
    worst = most_broken(margins)
    if worst is None:
        return
    words, place = "", {}
    if worst.kind == "joint" and robot.description is not None:
        joint = worst.name.partition(" ")[0]
        module = module_of_joint(robot.description, joint)
        words, place = joint_words(joint, module), {} if module is None else {"module": module, "face": None}
    rows = np.flatnonzero(~(worst.margin >= 0.0))
    k, others = worst.row, sum(not each.holds for each in margins) - 1
    more = f" ({others} more limits are broken too)" if others else ""
    raise JointLimitError(
        f"leg {worst.leg!r} breaks its limit {worst.name!r} ({worst.meaning}) at {rows.size} of {time.size} instants, "
        f"by {-worst.margin[k]:.4g} {worst.unit} at t = {time[k]:g} s{more}; shorten the stride, lower the clearance, "
        f"change the height or tilt of the body, or have limits ignored to see all margins{words}",
        rows=rows,
        margin=worst.margin[rows],
        leg=worst.leg,
        limit=worst.name,
        kind=worst.kind,
        time=float(time[k]),
        **place,
    )


def instants(walk: Walk, count: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Sample times with both sides of every switch, and which feet stand then, (T, N)."""
    switches = walk.table.switches()
    even = np.linspace(0.0, 1.0, count + 1)
    apart = np.abs(even[:, None] - np.concatenate([switches, switches + 1.0])).min(axis=1)
    inner = switches[(switches > 10.0 * EDGE) & (switches < 1.0 - 10.0 * EDGE)]
    kept = even[(apart > 10.0 * EDGE) | (even == 0.0) | (even == 1.0)]
    cycles = np.sort(np.concatenate([kept, inner - EDGE, inner]))
    # Each sample stands for what follows it, the last one for what comes before it.
    seen = cycles + np.where(cycles < 1.0, 0.5, -0.5) * EDGE
    return cycles * walk.period, walk.table.in_stance(seen)


def _follow(limb: Limb, time: NDArray[np.float64], foot: FootMotion, branch: str | None, limits: str) -> Trajectory:
    """The leg's joint motion along its foot's path, checked for jumps."""
    path = FootPath(
        time,
        limb.to_leg(foot.position),
        limb.vector_to_leg(foot.velocity),
        limb.vector_to_leg(foot.acceleration),
        name=limb.name,
    )
    try:
        motion = path.to_joint(limb.leg, branch, limits="ignore")
    except RowError as error:
        own, words, place = _foot_place(limb)
        evidence = dict(error.evidence) | {"leg": limb.name, "time": float(time[int(error.rows.min())])} | place
        # The path carries the leg's name, but a reader may not know what a foot path is.
        what = error.message.removeprefix("foot path ").removesuffix(own)
        raise type(error)(f"leg {what}{words}", **evidence) from error
    _check_mode(limb, path, motion)
    if limits == "error":
        _check_limits(limb, motion)
    return motion


def _check_mode(limb: Limb, path: FootPath, motion: Trajectory) -> None:
    time, q, v, a = motion.time, motion.q, motion.v, motion.a
    _, words, place = _foot_place(limb)
    missed = np.linalg.norm(np.asarray(limb.leg.foot_position(q)) - path.position, axis=-1)
    rows = np.flatnonzero(~(missed <= _SAME_FOOT))
    if rows.size:
        k = int(rows[0])
        raise AssemblyError(
            f"leg {limb.name!r} at t = {time[k]:g} s: the pose that the inverse kinematics gives is in another "
            f"assembly mode than the leg's own: its foot would be {missed[k]:.3g} m away; choose another branch{words}",
            rows=rows,
            margin=_SAME_FOOT - missed[rows],
            residual=missed[rows],
            leg=limb.name,
            time=float(time[k]),
            **place,
        )
    sense = np.sign(np.linalg.det(np.asarray(limb.leg.jacobian(q))))
    h = np.diff(time)[:, None]
    # The corrected trapezoidal rule: what the rates say that the step is.
    foretold = 0.5 * h * (v[1:] + v[:-1]) - h**2 * np.diff(a, axis=0) / 12.0
    jump = np.abs(np.diff(q, axis=0) - foretold).max(axis=1)
    allowed = _FLIP * np.abs(h * np.abs(v).max(axis=0)).max(axis=1) + 1e-6
    rows = np.flatnonzero((np.diff(sense) != 0.0) | (jump > allowed)) + 1
    if rows.size:
        k = int(rows[0])
        raise AssemblyError(
            f"leg {limb.name!r} changes its assembly mode between t = {time[k - 1]:g} s and {time[k]:g} s: the joints "
            f"jump by {jump[k - 1]:.3g}, against {allowed[k - 1]:.3g} that their rates allow; keep the foot away from "
            f"the singular pose between both modes, choose another branch, or take more samples{words}",
            rows=rows,
            margin=(allowed - jump)[rows - 1],
            leg=limb.name,
            time=float(time[k]),
            **place,
        )


def _check_limits(limb: Limb, motion: Trajectory) -> None:
    try:
        motion.check_limits(limb.leg.limits, limb.joint_names, _units(limb))
    except JointLimitError as error:
        row = int(error.rows[0])
        q, limits = motion.q[row], limb.leg.limits
        joint = int(np.minimum(q - np.asarray(limits.lower), np.asarray(limits.upper) - q).argmin())
        words, place = _joint_place(limb, joint)
        evidence = dict(error.evidence) | {
            "leg": limb.name,
            "joint": limb.joint_names[joint],
            "time": float(motion.time[row]),
            **place,
        }
        raise JointLimitError(f"leg {error.message.removeprefix('trajectory ')}{words}", **evidence) from None


def _units(limb: Limb) -> tuple[str, ...]:
    units = getattr(limb.leg, "units", None)
    return tuple(units.joints) if units is not None else ("",) * len(limb.leg.joint_names)


def _loads(
    robot: Robot,
    time: NDArray[np.float64],
    feet: NDArray[np.float64],
    stance: NDArray[np.bool_],
    com: NDArray[np.float64],
    pull: NDArray[np.float64],
    ground: NDArray[np.float64],
    load: str,
    friction: float | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Forces of the ground in level axes, (T, N, 3), and what they leave unbalanced, (T,)."""
    force = np.zeros(feet.shape)
    if load == "none":
        return force, np.linalg.norm(pull, axis=1)
    if load == "balanced":
        shared = share_load(feet, stance, com, -pull, friction=friction)
        rows = np.flatnonzero(~shared.feasible)
        if rows.size:
            k = int(rows[0])
            point = project(com, pull, ground)
            margin = support_margin(feet[..., :2], stance, point)
            moved = np.abs(pull[k, :2]).max() > 1e-9 * abs(pull[k, 2])
            why = "their forces do not balance" if friction is None else f"friction of {friction:g} does not hold it"
            if not stance[k].any():
                why = "no foot stands"
            elif margin[k] <= 0.0:
                what = "zero-moment point" if moved else "centre of mass"
                why = f"the {what} is {-margin[k]:.4g} m outside their support polygon"
            raise SupportError(
                f"the {int(stance[k].sum())} standing feet of {robot.name!r} cannot carry it at {rows.size} of "
                f"{time.size} instants, first at t = {time[k]:g} s: {why}; raise the duty factor, sway the body, or "
                "share the load equally, which ignores moments",
                rows=rows,
                margin=margin[rows],
                time=float(time[k]),
            )
        return shared.force, shared.residual
    standing = stance.sum(axis=1)
    rows = np.flatnonzero(standing == 0)
    if rows.size:
        raise SupportError(
            f"no foot of {robot.name!r} stands at t = {time[rows[0]]:g} s; raise the duty factor",
            rows=rows,
            margin=-np.inf,
            time=float(time[rows[0]]),
        )
    force[..., 2] = np.where(stance, -pull[:, 2:] / standing[:, None], 0.0)
    arms = feet - com[:, None, :]
    missing = np.cross(arms, force).sum(axis=1) / np.linalg.norm(arms, axis=-1).max(axis=1)[:, None]
    return force, np.linalg.norm(np.concatenate([force.sum(axis=1) + pull, missing], axis=1), axis=1)


def _loaded(
    limb: Limb,
    motion: Trajectory,
    stance: NDArray[np.bool_],
    force: NDArray[np.float64],
    pull: NDArray[np.float64],
) -> LimbMotion:
    """The leg's efforts under its foot's force, with gravity less the acceleration of its hip."""
    on_foot = limb.vector_to_leg(force)
    effort = limb.leg.torque(
        motion.q, motion.v, motion.a, foot_force=on_foot, gravity=limb.vector_to_leg(np.broadcast_to(pull, force.shape))
    )
    return LimbMotion(limb, stance, replace(motion, foot_force=on_foot), np.asarray(effort))


def _largest(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each column the entry of largest magnitude, with its sign."""
    return np.asarray(values[np.abs(values).argmax(axis=0), np.arange(values.shape[1])])
