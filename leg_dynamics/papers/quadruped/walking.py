"""The creeping gait III-I-IV-II on the toolkit's gait engine: what the paper gives of it, and what is assumed.

Given: the order, and that leg IV steps from 10 to 15 s. If the k-th of four legs lifts off at k T / 4, leg IV, the
third, does so at T / 2: T = 20 s, and a step of 5 s leaves a duty factor of 3/4. Assumed, for the paper gives none of
it: stride, clearance, path law, neutral pose, masses, which leg is where, and how the body moves.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from leg_dynamics.papers.framework import Context
from leg_dynamics.papers.quadruped import reported
from leg_dynamics.papers.quadruped.facts import TO_PAPER, robot_file

if TYPE_CHECKING:
    from leg_dynamics.analysis.gait import GaitStudy, Robot, Sway, Walk

__all__ = [
    "ADVANCE",
    "CLEARANCE",
    "DUTY",
    "EDGE",
    "HARMONICS",
    "NEUTRAL",
    "PERIOD",
    "SWAYED_DUTY",
    "SWAY_BOUND",
    "FootCurves",
    "Numbering",
    "best_sway",
    "cap",
    "foot_curves",
    "homes",
    "margins_of",
    "numberings",
    "places_of",
    "robot_of",
    "sampled_bounds",
    "studied",
    "swaying",
    "walk_of",
]

Array = np.ndarray

PERIOD = len(reported.ORDER) * reported.STEP_OF_IV[0] / reported.ORDER.index("IV")
"""s; inferred."""

DUTY = 1.0 - (reported.STEP_OF_IV[1] - reported.STEP_OF_IV[0]) / PERIOD
"""Inferred."""

ADVANCE = 0.06
"""m a cycle; assumed. A foot steps as far, and goes back below the body by the duty factor of it."""

CLEARANCE = 0.015
"""m; assumed: a quarter of the step, so that the foot's speed has one peak (above 5/16 of the step it has two)."""

NEUTRAL = (20.0, -45.0, -45.0)
"""deg; assumed: splay (front legs ahead, rear ones back), theta2 and theta3 in the middle of the stance."""

SWAYED_DUTY = 0.8
"""Assumed for the gait with sway: all feet stand for a twentieth of the cycle between two steps."""

SWAY_BOUND = 0.03
"""m, each way; assumed: leaves the legs room, see `figures`."""

HARMONICS = 2
"""Of the sway."""

EDGE = 1e-7
"""Share of the period by which samples stay off a switch of the gait, on both sides."""

SAMPLES = 200


def robot_of(context: Context) -> Robot:
    """The robot of ten modules on its own legs: those at module 6 are the reversed ones."""

    def read_robot() -> Robot:
        import leg_dynamics
        from leg_dynamics.analysis.gait import robot_from

        return robot_from(robot_file(context), [context.leg, leg_dynamics.load("quadruped_leg_reversed")])

    robot: Robot = context.once("quadruped: robot", read_robot)
    return robot


def places_of(context: Context) -> dict[str, str]:
    """Where the file has each leg: front or rear, left or right."""
    robot = robot_of(context)
    return {
        limb.name: f"{'front' if limb.hip[0, 3] > 0.0 else 'rear'} {'left' if limb.hip[1, 3] > 0.0 else 'right'}"
        for limb in robot.limbs
    }


def homes(context: Context, neutral: tuple[float, float, float] = NEUTRAL) -> Array:
    """Feet in the middle of their stance in the body frame, (4, 3) m, for splay, theta2 and theta3 in deg."""
    places = []
    for limb in robot_of(context).limbs:
        # Front legs splay ahead, rear ones back; the hip's y looks ahead on the right, back on the left.
        ahead = np.sign(limb.hip[0, 3]) * np.sign(limb.hip[:3, :3][0, 1])
        angles = np.radians([ahead * neutral[0], neutral[1], neutral[2]])
        places.append(limb.to_body(limb.leg.foot_position(angles)))
    return np.array(places)


def walk_of(
    context: Context,
    order: tuple[str, ...] = reported.ORDER,
    *,
    duty: float = DUTY,
    advance: float = ADVANCE,
    clearance: float = CLEARANCE,
    neutral: tuple[float, float, float] = NEUTRAL,
    sway: Sway | None = None,
) -> Walk:
    """A creeping walk straight ahead; the order names places by the file's legs there."""
    from leg_dynamics.analysis.gait import plan, swing_order

    robot = robot_of(context)
    return plan(
        robot,
        swing_order(order, robot, duty),
        period=PERIOD,
        velocity=(advance / PERIOD, 0.0),
        clearance=clearance,
        homes=homes(context, neutral),
        sway=sway,
    )


def studied(context: Context, walk: Walk, *, load: str = "equal", limits: str = "error") -> GaitStudy:
    """One cycle of a walk with all that the engine computes."""
    from leg_dynamics.analysis.gait import study

    return study(robot_of(context), walk, samples=SAMPLES, load=load, limits=limits)


# ---------------------------------------------------------------------- stability by the feet alone


def instants(walk: Walk) -> tuple[Array, Array]:
    """Times of a cycle with both sides of every switch, and which feet stand, (T,) s and (T, 4)."""
    switches = walk.table.switches()
    both = np.concatenate([np.linspace(0.0, 1.0, SAMPLES, endpoint=False), switches - EDGE, switches + EDGE])
    # A little late, so that no sample is on a switch.
    cycles = np.sort(np.mod(both + 0.1 * EDGE, 1.0))
    time = cycles * walk.period
    return time, walk.in_stance(time)


def margins_of(walk: Walk) -> tuple[Array, Array]:
    """Static stability margin over a cycle with the centre of mass in the middle of the body, (T,) s and m."""
    from leg_dynamics.analysis.gait import support_margin

    time, stance = instants(walk)
    feet = walk.feet(time).position
    return time, support_margin(feet[..., :2], stance, np.zeros((len(time), 2)))


class Numbering(NamedTuple):
    """A way to number the legs, as the order in which places swing."""

    order: tuple[str, ...]
    """The file's legs at the places where legs III, I, IV and II would be."""
    places: tuple[str, ...]
    ways: int
    """Numberings of the legs that give this order of places or a rotation of it."""
    round_the_body: bool
    """Whether each leg swings after a neighbour, never after the one diagonally across."""


def numberings(context: Context) -> tuple[Numbering, ...]:
    """The cyclic orders that the 24 numberings of four legs make."""
    places = places_of(context)
    found: dict[tuple[str, ...], int] = {}
    for order in itertools.permutations(reported.ORDER):
        start = order.index(reported.ORDER[0])
        turned = order[start:] + order[:start]
        found[turned] = found.get(turned, 0) + 1
    names = {leg: set(place.split()) for leg, place in places.items()}
    return tuple(
        Numbering(
            order,
            tuple(places[leg] for leg in order),
            count,
            all(names[one] & names[other] for one, other in zip(order, order[1:] + order[:1], strict=True)),
        )
        for order, count in found.items()
    )


# ---------------------------------------------------------------------- sway


def sampled_bounds(walk: Walk, bound: tuple[float, float]) -> tuple[tuple[float, float], float]:
    """What a sway has to keep at `instants`, so that it is within `bound` and the body never goes back between them.

    Returns
    -------
    tuple of two floats
        Greatest sway ahead and to the left, m.
    float
        Least speed ahead, m/s.
    """
    # A sum of K waves is nowhere greater than at even samples over this cosine (Ehlich & Zeller 1964).
    between = float(np.cos(np.pi * HARMONICS / SAMPLES))
    # Between samples h apart a curve is at most h^2/8 of its greatest second derivative below their chord, and the
    # derivative of a sum of K waves is at most K w times the sum itself (Bernstein): of a sway within S, the second
    # derivative of the rate is at most (K w)^3 S. No sway at all keeps the whole speed, so more is never asked for.
    fastest = 2.0 * np.pi * HARMONICS / walk.period
    least = min((walk.period / SAMPLES) ** 2 / 8.0 * fastest**3 * bound[0], walk.twist.forward)
    return (between * bound[0], between * bound[1]), least


def best_sway(walk: Walk, bound: tuple[float, float], com: Array | None = None) -> tuple[float, Sway]:
    """The sway ahead and sideways that makes the least stability margin of a walk as great as it can be.

    A linear programme: the margin is the least distance of the centre of mass to the edges of the standing feet, and
    each distance is linear in the sway's coefficients. The body never moves back. Of equal margins the smaller sway is
    taken. The margin counts at `instants`; sway and speed keep their bounds between them too.

    Parameters
    ----------
    walk : Walk
        Without a sway.
    bound : tuple of two floats
        Greatest sway ahead and to the left, m.
    com : numpy.ndarray, optional
        Centre of mass in the body at `instants`, (T, 2) m; its middle by default.

    Returns
    -------
    float
        The margin, m.
    Sway
    """
    from scipy.optimize import linprog

    from leg_dynamics.analysis.gait import Sway

    time, stance = instants(walk)
    feet = walk.feet(time).position[..., :2]
    centre = np.zeros((len(time), 2)) if com is None else com
    k = 2.0 * np.pi * np.arange(1, HARMONICS + 1)
    angle = (time / walk.period)[:, None] * k
    waves = np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
    rates = np.concatenate([-np.sin(angle), np.cos(angle)], axis=1) * np.tile(k, 2) / walk.period
    none, one = np.zeros_like(waves), np.ones((len(time), 1))
    # Unknown: coefficients ahead and to the left, the margin, and the greatest sway along both.
    rows, limits = [], []
    for i, standing in enumerate(stance):
        for point, normal in _edges(feet[i][standing]):
            rows.append(np.concatenate([-normal[0] * waves[i], -normal[1] * waves[i], [1.0, 0.0, 0.0]]))
            limits.append(float(normal @ (centre[i] - point)))
    for side in (1.0, -1.0):
        rows += list(np.hstack([side * waves, none, 0.0 * one, -one, 0.0 * one]))
        rows += list(np.hstack([none, side * waves, 0.0 * one, 0.0 * one, -one]))
        limits += [0.0] * 2 * len(time)
    most, least = sampled_bounds(walk, bound)
    rows += list(np.hstack([-rates, none, np.tile(0.0 * one, 3)]))
    limits += [walk.twist.forward - least] * len(time)
    unknowns = 4 * HARMONICS + 3
    aim = np.zeros(unknowns)
    aim[-3:] = -1.0, 1e-3, 1e-3
    bounds = [(None, None)] * (unknowns - 2) + [(0.0, each) for each in most]
    solved = linprog(aim, np.array(rows), limits, bounds=bounds, method="highs")
    ahead, left = solved.x[: 2 * HARMONICS], solved.x[2 * HARMONICS : 4 * HARMONICS]
    still = np.zeros(HARMONICS)
    cosine, sine = (np.stack([ahead[part], left[part], still], axis=-1) for part in _halves())
    return float(solved.x[-3]), Sway(cosine, sine)


def cap(walk: Walk, sideways: float) -> float:
    """What the least margin of a walk cannot exceed, however the body moves on its way ahead, m.

    Where one foot touches down and the next lifts off at once, the centre of mass has to be inside the feet that stand
    before and after, at one and the same place: the most that any place gives there, and the least of that over the
    switches.

    Parameters
    ----------
    walk : Walk
        Without a sway.
    sideways : float
        How far the centre of mass may leave the line straight ahead, m; may be infinite.
    """
    from scipy.optimize import linprog

    least = np.inf
    for switch in walk.table.switches():
        # Feet are continuous there, only which of them stand is not.
        feet = walk.feet(np.array([switch * walk.period])).position[0, :, :2]
        rows, limits = [], []
        for standing in walk.table.in_stance(np.mod(np.array([switch - EDGE, switch + EDGE]), 1.0)):
            for point, normal in _edges(feet[standing]):
                rows.append([-normal[0], -normal[1], 1.0])
                limits.append(-float(normal @ point))
        bounds = [(None, None), (-sideways, sideways), (None, None)]
        least = min(least, -float(linprog([0.0, 0.0, -1.0], rows, limits, bounds=bounds, method="highs").fun))
    return least + 0.0


def _halves() -> tuple[slice, slice]:
    return slice(0, HARMONICS), slice(HARMONICS, 2 * HARMONICS)


def _edges(feet: Array) -> list[tuple[Array, Array]]:
    """Edges of a convex polygon of feet (N, 2): a point of each, and its normal to the inside."""
    middle = feet.mean(axis=0)
    round_it = feet[np.argsort(np.arctan2(*(feet - middle).T[::-1]))]
    along = np.roll(round_it, -1, axis=0) - round_it
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1) / np.linalg.norm(along, axis=1)[:, None]
    return list(zip(round_it, normal, strict=True))


def swaying(context: Context, order: tuple[str, ...], duty: float, bound: tuple[float, float]) -> GaitStudy:
    """The walk with the best sway for the centre of mass that its moving legs leave."""

    def compute() -> GaitStudy:
        plain = walk_of(context, order, duty=duty)
        time, _ = instants(plain)
        com, sway = None, None
        # The legs' pose, and with it the centre of mass, depends on the sway a little.
        for _ in range(3):
            _, sway = best_sway(plain, bound, com)
            result = studied(context, walk_of(context, order, duty=duty, sway=sway), load="none", limits="ignore")
            com = np.stack([np.interp(time, result.time, values) for values in result.com[:, :2].T], axis=-1)
        load = "balanced" if result.margin.min() > 0.0 else "none"
        return studied(context, result.walk, load=load, limits="ignore")

    result: GaitStudy = context.once(f"quadruped: swaying {order} {duty} {bound}", compute)
    return result


# ---------------------------------------------------------------------- leg IV


@dataclass(frozen=True)
class FootCurves:
    """Leg IV's foot over a cycle, in the world along the paper's axes: x_c right, y_c ahead, z_c up.

    Attributes
    ----------
    walk : Walk
    time : (T,) array
        s.
    position, velocity : (T, 3) array
        m, m/s; y from where leg IV lifts off.
    body : (T, 3) array
        The body's origin, m.
    q, v : (T, 3) array
        rad, rad/s.
    spin : (T, 3) array
        Angular velocity of the foot's link in the hip's axes, rad/s.
    swings : (T,) array of bool
    """

    walk: Walk
    time: Array
    position: Array
    velocity: Array
    body: Array
    q: Array
    v: Array
    spin: Array
    swings: Array

    @property
    def speed(self) -> Array:
        """Of the foot, m/s."""
        return np.asarray(np.linalg.norm(self.velocity, axis=1))

    @property
    def turn_rate(self) -> Array:
        """Magnitude of the angular velocity, rad/s."""
        return np.asarray(np.linalg.norm(self.spin, axis=1))


def foot_curves(context: Context, walk: Walk, time: Array) -> FootCurves:
    """Leg IV along a walk straight ahead, at any times."""
    robot = robot_of(context)
    number = robot.leg_names.index("IV")
    limb, feet, body = robot.limbs[number], walk.feet(time), walk.body(time)
    rate = np.broadcast_to([walk.twist.forward, walk.twist.sideward, 0.0], body.position.shape)
    if walk.sway is not None:
        rate = rate + walk.sway.value(walk.cycles(time), walk.period, 1)
    place = walk.in_world(time, feet.position)[:, number]
    q = np.asarray(limb.leg.inverse_kinematics(limb.to_leg(feet.position[:, number]), limits="ignore"))
    v = np.linalg.solve(limb.leg.jacobian(q), limb.vector_to_leg(feet.velocity[:, number])[..., None])[..., 0]
    spin = context.formulas.foot_angular_velocity(context.numbers, tuple(q.T), tuple(v.T))
    lifts = np.array([walk.table.phases[number] + walk.table.duty]) * walk.period
    start = walk.in_world(np.mod(lifts, walk.period), walk.feet(np.mod(lifts, walk.period)).position)[0, number]
    return FootCurves(
        walk,
        time,
        (place - start * [1.0, 0.0, 1.0]) @ TO_PAPER.T,
        (feet.velocity[:, number] + rate) @ TO_PAPER.T,
        body.position @ TO_PAPER.T,
        q,
        v,
        np.stack([np.broadcast_to(each, len(time)) for each in spin], axis=-1),
        ~walk.in_stance(time)[:, number],
    )
