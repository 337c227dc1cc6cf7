"""A walk: where every foot is in the body frame at any time, with exact rates, from gait, stride and body velocity.

A carrier moves over the ground with a constant twist: forward and sideward velocity in its own axes, and a turn rate.
The body is the carrier, or sways and tilts against it. A foot stands still in the world during its stance and is
planned in the world during its swing, from one footprint to the next; the body frame sees both through the carrier's
motion. So feet do not slip, by construction, on straight lines, circles and on the spot.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leg_dynamics.analysis import arguments
from leg_dynamics.analysis.gait.laws import LAWS, law
from leg_dynamics.analysis.gait.phases import PhaseTable
from leg_dynamics.errors import NonFiniteError, ShapeError, TrajectoryError

__all__ = ["BodyMotion", "FootMotion", "Sway", "Tilt", "Twist", "Walk"]


class Twist(NamedTuple):
    """Planar velocity of the body in its own axes: m/s ahead, m/s to the left, rad/s to the left."""

    forward: float
    sideward: float = 0.0
    turn: float = 0.0

    def displacement(self, time: ArrayLike) -> NDArray[np.float64]:
        """Where the carrier is after some time, in its axes at the beginning, m, (..., 2); exact, also for no turn."""
        time = np.asarray(time, dtype=float)
        half = 0.5 * self.turn * time
        # The chord of the arc, which points half the turn to the side.
        chord = time * np.sinc(half / np.pi)
        c, s = np.cos(half), np.sin(half)
        x, y = self.forward, self.sideward
        return chord[..., None] * np.stack([c * x - s * y, s * x + c * y], axis=-1)

    def turned(self, time: ArrayLike) -> NDArray[np.float64]:
        """Rotation from the carrier's axes after some time to those at the beginning, (..., 2, 2)."""
        angle = self.turn * np.asarray(time, dtype=float)
        c, s = np.cos(angle), np.sin(angle)
        return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


class FootMotion(NamedTuple):
    """Feet in the body frame, each (T, N, 3): m, m/s, m/s²."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]


class BodyMotion(NamedTuple):
    """The body in the world at T times.

    Level axes are those of the body's frame turned back by its roll and pitch: x ahead on the level, z up.
    """

    position: NDArray[np.float64]
    """Its origin, m, (T, 3); the carrier starts at (0, 0, 0), and feet at home are below it at their own heights."""
    yaw: NDArray[np.float64]
    """rad, (T,)."""
    acceleration: NDArray[np.float64]
    """Of its origin, in body axes, m/s², (T, 3)."""
    turn: float
    """Turn rate of the carrier, rad/s."""
    rotation: NDArray[np.float64]
    """From body axes to level axes, (T, 3, 3)."""
    spin: NDArray[np.float64]
    """Angular velocity, in body axes, rad/s, (T, 3)."""
    spin_rate: NDArray[np.float64]
    """Its derivative, in body axes, rad/s², (T, 3)."""

    def acceleration_at(self, point: ArrayLike) -> NDArray[np.float64]:
        """Acceleration of a point fixed in the body, in body axes, m/s², (T, 3)."""
        r = np.broadcast_to(np.asarray(point, dtype=float), self.position.shape)
        centripetal = np.cross(self.spin, np.cross(self.spin, r))
        return np.asarray(self.acceleration + np.cross(self.spin_rate, r) + centripetal)

    def level(self, vectors: ArrayLike) -> NDArray[np.float64]:
        """Vectors of the body frame, (T, ..., 3), in level axes."""
        return np.einsum("tij,t...j->t...i", self.rotation, np.asarray(vectors, dtype=float))

    def in_body(self, vectors: ArrayLike) -> NDArray[np.float64]:
        """Vectors in level axes, (T, ..., 3), in the body frame."""
        return np.einsum("tji,t...j->t...i", self.rotation, np.asarray(vectors, dtype=float))


@dataclass(frozen=True, eq=False)
class Sway:
    """A periodic shift of the body against its carrier: sum over k of cosine[k-1] cos(k w t) + sine[k-1] sin(k w t).

    Parameters
    ----------
    cosine, sine : array_like, shape (K, 3)
        m, in the carrier's axes; w = 2 pi over the gait's period.
    """

    cosine: NDArray[np.float64]
    sine: NDArray[np.float64]

    def __post_init__(self) -> None:
        _check_waves(self, "sway", 3)

    def value(self, cycles: ArrayLike, period: float, derivative: int = 0) -> NDArray[np.float64]:
        """The shift, or a derivative by time, (..., 3), at a time over the period."""
        return _waves(self.cosine, self.sine, cycles, period, derivative)


@dataclass(frozen=True, eq=False)
class Tilt:
    """Roll and pitch of the body against its level carrier: fixed, and a law with the gait's period on top.

    The body turns about its own origin: by the pitch about the carrier's y axis, then by the roll about its own x axis
    (REP 103). A positive pitch lowers its head, a positive roll its right side. Feet stay on level ground.

    Parameters
    ----------
    roll, pitch : float
        Fixed part, rad.
    cosine, sine : array_like, shape (K, 2), optional
        Roll and pitch, rad: sum over k of cosine[k-1] cos(k w t) + sine[k-1] sin(k w t); w = 2 pi over the period.

    Raises
    ------
    TrajectoryError
        The body could tilt to a right angle.
    """

    roll: float = 0.0
    pitch: float = 0.0
    cosine: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 2)))
    sine: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 2)))

    def __post_init__(self) -> None:
        for name in ("roll", "pitch"):
            object.__setattr__(self, name, arguments.real(name, getattr(self, name)))
        _check_waves(self, "tilt", 2)
        for name, most in zip(("roll", "pitch"), self._greatest(), strict=True):
            if not most < 0.5 * np.pi:
                raise TrajectoryError(
                    f"the {name} of the body may reach {most:.4g} rad, {most - 0.5 * np.pi:.4g} rad beyond a right "
                    "angle; tilt it less"
                )

    def _greatest(self) -> NDArray[np.float64]:
        """A bound of the magnitudes, (2,)."""
        return np.asarray(np.abs([self.roll, self.pitch]) + np.hypot(self.cosine, self.sine).sum(axis=0))

    def value(self, cycles: ArrayLike, period: float, derivative: int = 0) -> NDArray[np.float64]:
        """Roll and pitch, or a derivative by time, (..., 2), at a time over the period."""
        fixed = np.array([self.roll, self.pitch]) if derivative == 0 else np.zeros(2)
        return np.asarray(fixed + _waves(self.cosine, self.sine, cycles, period, derivative))

    def motion(self, cycles: ArrayLike, period: float) -> tuple[NDArray[np.float64], ...]:
        """Rotation from body axes to the carrier's, (T, 3, 3); angular velocity and its derivative, (T, 3)."""
        (roll, pitch), (p, q), (pp, qq) = (np.moveaxis(self.value(cycles, period, k), -1, 0) for k in range(3))
        sr, cr, sp, cp, zero = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch), np.zeros_like(roll)
        rows = ([cp, sp * sr, sp * cr], [zero, cr, -sr], [-sp, cp * sr, cp * cr])
        rotation = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
        spin = np.stack([p, q * cr, -q * sr], axis=-1)
        rate = np.stack([pp, qq * cr - p * q * sr, -qq * sr - p * q * cr], axis=-1)
        return rotation, spin, rate


def _check_waves(law: Sway | Tilt, what: str, count: int) -> None:
    for name in ("cosine", "sine"):
        array = arguments.reals(name, getattr(law, name))
        if array.ndim != 2 or array.shape[1] != count or array.shape != np.shape(law.cosine):
            raise ShapeError(f"{name} of a {what} has shape {array.shape}; cosine and sine are (K, {count}), alike")
        if not np.isfinite(array).all():
            raise NonFiniteError(f"{name} of a {what} holds NaN or infinity")
        array.setflags(write=False)
        object.__setattr__(law, name, array)


def _waves(
    cosine: NDArray[np.float64], sine: NDArray[np.float64], cycles: ArrayLike, period: float, derivative: int
) -> NDArray[np.float64]:
    k = np.arange(1, len(cosine) + 1)
    rate = (2.0 * np.pi * k / period) ** derivative
    # Each derivative advances both waves by a quarter of a turn.
    angle = 2.0 * np.pi * k * np.asarray(cycles, dtype=float)[..., None] + 0.5 * np.pi * derivative
    value: NDArray[np.float64] = (rate * np.cos(angle)) @ cosine + (rate * np.sin(angle)) @ sine
    return value


@dataclass(frozen=True, eq=False)
class Walk:
    """A steady walk on level ground.

    Parameters
    ----------
    table : PhaseTable
        The gait, for N legs.
    homes : array_like, shape (N, 3)
        Where each foot stands in the middle of its stance, in the carrier's frame, m.
    period : float
        s.
    twist : Twist
        Velocity of the carrier.
    clearance : float
        Height of the swing above the ground, m.
    law : {"polynomial", "cycloid", "minimum_jerk"}
        Path law of the swing, see `leg_dynamics.analysis.gait.laws.LAWS`.
    sway : Sway, optional
        Shift of the body.
    tilt : Tilt, optional
        Roll and pitch of the body.

    Raises
    ------
    TrajectoryError, ShapeError, NonFiniteError
        A number is not usable.
    """

    table: PhaseTable
    homes: NDArray[np.float64]
    period: float
    twist: Twist
    clearance: float = 0.1
    law: str = "polynomial"
    sway: Sway | None = None
    tilt: Tilt | None = None
    _step: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        arguments.kind("the phase table", self.table, PhaseTable, hint="phase_table makes one")
        homes = arguments.reals("home positions of the feet", self.homes)
        if homes.shape != (len(self.table), 3):
            raise ShapeError(f"homes have shape {homes.shape}; {len(self.table)} legs need ({len(self.table)}, 3)")
        if not np.isfinite(homes).all():
            raise NonFiniteError("a home position of a foot is NaN or infinite")
        homes.setflags(write=False)
        object.__setattr__(self, "homes", homes)
        object.__setattr__(self, "period", arguments.positive("period", self.period, "seconds"))
        object.__setattr__(self, "twist", Twist(*arguments.vector("twist", self.twist, 3).tolist()))
        object.__setattr__(self, "clearance", arguments.tolerance("clearance", self.clearance))
        arguments.choice("path law", self.law, LAWS)
        if self.sway is not None:
            arguments.kind("sway", self.sway, Sway)
        if self.tilt is not None:
            arguments.kind("tilt", self.tilt, Tilt)
        # From each footprint to the next, seen from the carrier in the middle of the stance.
        turned = self.twist.turned(self.period)
        step = homes[:, :2] @ turned.T + self.twist.displacement(self.period) - homes[:, :2]
        object.__setattr__(self, "_step", np.column_stack([step, np.zeros(len(homes))]))

    @property
    def stance_duration(self) -> float:
        """s."""
        return self.table.duty * self.period

    @property
    def swing_duration(self) -> float:
        """s."""
        return (1.0 - self.table.duty) * self.period

    @property
    def stride(self) -> float:
        """Path of the carrier over the ground during one stance, m: how far a foot goes back below the body."""
        return float(np.hypot(self.twist.forward, self.twist.sideward)) * self.stance_duration

    def cycles(self, time: ArrayLike) -> NDArray[np.float64]:
        """Time over period, for finite times (...), s."""
        time = arguments.reals("time", time)
        if not np.isfinite(time).all():
            raise NonFiniteError("a time is NaN or infinite; give finite times in seconds")
        return time / self.period

    def in_stance(self, time: ArrayLike) -> NDArray[np.bool_]:
        """Whether each foot is on the ground, (..., N)."""
        return self.table.in_stance(self.cycles(time))

    def feet(self, time: ArrayLike) -> FootMotion:
        """Foot targets in the body frame.

        Parameters
        ----------
        time : array_like, shape (T,)
            s, any.

        Returns
        -------
        FootMotion
            Analytic, velocity and acceleration exact; acceleration is continuous.
        """
        cycles = self.cycles(time)
        since, world = self._planned(cycles)
        return self._seen(cycles, since, world)

    def _planned(self, cycles: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
        """Time (..., N) since the middle of the last stance, s, and the feet's shift from home with two derivatives.

        Shifts (..., N, 3) are in the world, seen from the carrier as it was in the middle of that stance.
        """
        duty, swing = self.table.duty, self.swing_duration
        u = self.table.leg_phase(cycles)
        flown = np.clip((u - duty) / (1.0 - duty), 0.0, 1.0)
        profile = law(self.law, flown)
        lift = np.array([0.0, 0.0, self.clearance])
        world = [
            profile.along[k][..., None] * self._step / swing**k + profile.lift[k][..., None] * lift / swing**k
            for k in range(3)
        ]
        resting = u <= duty
        world[1][resting] = 0.0
        world[2][resting] = 0.0
        return (u - 0.5 * duty) * self.period, world

    def foot_velocity(self, time: ArrayLike) -> NDArray[np.float64]:
        """Velocities of the feet over the ground at times (T,), s: world axes, m/s, (T, N, 3); zero in the stance."""
        cycles = self.cycles(time)
        since, world = self._planned(cycles)
        turned = self.twist.turned((cycles * self.period)[..., None] - since)
        plane = np.einsum("...ij,...j->...i", turned, world[1][..., :2])
        return np.concatenate([plane, world[1][..., 2:]], axis=-1)

    def _seen(
        self, cycles: NDArray[np.float64], since: NDArray[np.float64], world: list[NDArray[np.float64]]
    ) -> FootMotion:
        """World motions relative to the homes as the body sees them, `since` s after the carrier was there."""
        x, y, w = self.twist
        back = np.swapaxes(self.twist.turned(since), -1, -2)
        place = self.homes + world[0]
        place[..., :2] -= self.twist.displacement(since)

        def rotated(vector: NDArray[np.float64]) -> NDArray[np.float64]:
            plane = np.einsum("...ij,...j->...i", back, vector[..., :2])
            return np.concatenate([plane, vector[..., 2:]], axis=-1)

        def crossed(vector: NDArray[np.float64]) -> NDArray[np.float64]:
            """The turn rate, upwards, cross a vector."""
            return w * np.stack([-vector[..., 1], vector[..., 0], 0.0 * vector[..., 2]], axis=-1)

        position, moved, accelerated = rotated(place), rotated(world[1]), rotated(world[2])
        velocity = moved - np.array([x, y, 0.0]) - crossed(position)
        acceleration = accelerated - crossed(moved) - crossed(velocity)
        level = FootMotion(position, velocity, acceleration)
        if self.sway is not None:
            shift = (self.sway.value(cycles, self.period, k)[..., None, :] for k in range(3))
            level = FootMotion(*(values - own for values, own in zip(level, shift, strict=True)))
        return level if self.tilt is None else self._tilted(cycles, level)

    def _tilted(self, cycles: NDArray[np.float64], level: FootMotion) -> FootMotion:
        """Motions in level axes as the tilted body sees them."""
        assert self.tilt is not None
        rotation, spin, rate = self.tilt.motion(cycles, self.period)
        position, moved, accelerated = (np.einsum("...ji,...nj->...ni", rotation, values) for values in level)
        spin, rate = spin[..., None, :], rate[..., None, :]
        velocity = moved - np.cross(spin, position)
        acceleration = accelerated - np.cross(rate, position) - np.cross(spin, moved + velocity)
        return FootMotion(position, velocity, acceleration)

    def body(self, time: ArrayLike) -> BodyMotion:
        """The body in the world at times (T,), s."""
        cycles = self.cycles(time)
        time = cycles * self.period
        x, y, w = self.twist
        shift, rate, second = np.zeros((3, *time.shape, 3))
        if self.sway is not None:
            shift, rate, second = (self.sway.value(cycles, self.period, k) for k in range(3))
        plane = self.twist.displacement(time) + np.einsum("...ij,...j->...i", self.twist.turned(time), shift[..., :2])
        position = np.concatenate([plane, shift[..., 2:]], axis=-1)
        # w x (v + w x s) + 2 w x s' + s''
        acceleration = second.copy()
        acceleration[..., 0] -= w * (y + 2.0 * rate[..., 1]) + w**2 * shift[..., 0]
        acceleration[..., 1] += w * (x + 2.0 * rate[..., 0]) - w**2 * shift[..., 1]
        turning = np.broadcast_to([0.0, 0.0, w], position.shape)
        level = BodyMotion(
            position,
            w * time,
            acceleration,
            w,
            np.broadcast_to(np.eye(3), (*time.shape, 3, 3)),
            turning,
            np.zeros_like(position),
        )
        if self.tilt is None:
            return level
        rotation, own, own_rate = self.tilt.motion(cycles, self.period)
        turning = np.einsum("...ji,...j->...i", rotation, turning)
        return level._replace(
            acceleration=np.einsum("...ji,...j->...i", rotation, acceleration),
            rotation=rotation,
            spin=turning + own,
            # What stands still in the carrier's axes turns backwards in the body's.
            spin_rate=own_rate - np.cross(own, turning),
        )

    def body_velocity(self, time: ArrayLike) -> NDArray[np.float64]:
        """Velocity of the body's origin over the ground at times (T,), s: world axes, m/s, (T, 3)."""
        cycles = self.cycles(time)
        x, y, w = self.twist
        own = np.broadcast_to([x, y, 0.0], (*cycles.shape, 3)).copy()
        if self.sway is not None:
            shift, rate = (self.sway.value(cycles, self.period, k) for k in range(2))
            own += rate + w * np.stack([-shift[..., 1], shift[..., 0], 0.0 * shift[..., 2]], axis=-1)
        plane = np.einsum("...ij,...j->...i", self.twist.turned(cycles * self.period), own[..., :2])
        return np.concatenate([plane, own[..., 2:]], axis=-1)

    def in_world(self, time: ArrayLike, points: ArrayLike) -> NDArray[np.float64]:
        """Points of the body frame, (T, N, 3), in the world, m."""
        body = self.body(time)
        points = body.level(points)
        turned = self.twist.turned(self.cycles(time) * self.period)
        plane = np.einsum("tij,tnj->tni", turned, points[..., :2])
        return np.concatenate([plane, points[..., 2:]], axis=-1) + body.position[:, None, :]
