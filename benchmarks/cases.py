"""What is timed: one `Case` a line of the report, each with its arguments and an independent answer to them.

A new peer is a function that takes a `Workload` and returns a `Work`, plus a line in `all_cases`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import leg_dynamics as ld
from leg_dynamics.analysis.trajectories import named
from leg_dynamics.routes import has_closed_form
from leg_dynamics.verification.states import sample_states

SINGLE = "inverse dynamics, one call"
FORWARD = "forward dynamics, one call"
BATCH = "inverse dynamics, batch"
GROUPS = (SINGLE, FORWARD, BATCH)
YARDSTICK = "pin_rnea"


def _as_is(result: Any, index: int) -> Any:
    return result


@dataclass(frozen=True)
class Work:
    """A case made ready: `function(*arguments[i])` is checked for every i and timed over the first `period` of them.

    `answer` turns a result into what `expected[i]` says, shape (m,) or (rows, m); it is not timed.
    """

    function: Callable[..., Any]
    arguments: Sequence[tuple[Any, ...]]
    expected: np.ndarray | Sequence[np.ndarray]
    period: int
    answer: Callable[[Any, int], Any] = _as_is


@dataclass(frozen=True)
class Case:
    """One line of the report.

    `peer` marks what is shown for comparison and may fail without failing the run; `goal` is the largest ratio to the
    yardstick that the project allows itself.
    """

    key: str
    group: str
    title: str
    prepare: Callable[[Workload], Work]
    rows: int = 1
    peer: bool = False
    goal: float | None = None


@dataclass(frozen=True)
class Settings:
    """How much is measured."""

    repetitions: int = 25
    minimum_ns: int = 20_000_000
    rate: float = 1000.0
    states: int = 64
    batch_rows: tuple[int, ...] = (1, 100, 10_000)
    row_limit: int = 2_000
    seed: int = 0


FULL = Settings()
QUICK = Settings(repetitions=7, batch_rows=(1, 100, 1_000))


def available_legs() -> tuple[str, ...]:
    """Shipped legs that have two independent routes and a named motion."""
    return tuple(name for name in ld.available() if has_closed_form(name) and named(name))


class Workload:
    """A leg by its two routes, the states that it is measured at, and the answers of the one for the other."""

    def __init__(self, leg: str, settings: Settings) -> None:
        self.name = leg
        self.settings = settings
        self._known: dict[tuple[str, str, bool], np.ndarray] = {}

    @cached_property
    def closed_form(self) -> ld.Leg:
        return ld.load(self.name, route="closed_form")

    def pinocchio(self) -> ld.Leg:
        """A leg of the numeric route whose warm start nobody else disturbs."""
        return ld.load(self.name, route="pinocchio")

    def mechanism(self) -> Any:
        return self.pinocchio().backend.mechanism  # type: ignore[attr-defined]

    @cached_property
    def reference(self) -> ld.Leg:
        return self.pinocchio()

    @cached_property
    def states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, v, a: a general state first, then corners of the joint limits, near-zero and random states."""
        lower, upper = self.closed_form.limits.lower, self.closed_form.limits.upper
        sampled = sample_states((lower, upper), self.settings.states, self.settings.seed)
        wave = np.sin(1.0 + np.arange(3 * len(lower))).reshape(3, -1)
        first = (lower + (0.5 + 0.25 * wave[0]) * (upper - lower), 3.0 * wave[1], 20.0 * wave[2])
        return tuple(np.vstack([x, rest]) for x, rest in zip(first, (sampled.q, sampled.v, sampled.a), strict=True))

    @cached_property
    def trajectory(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, v, a of the leg's own motion there and, reversed in time, back: it can be repeated without a jump."""
        default = next(iter(named(self.name).values()))
        motion = default(None, self.settings.rate)
        back = slice(-2, 0, -1)
        return (
            np.vstack([motion.q, motion.q[back]]),
            np.vstack([motion.v, -motion.v[back]]),
            np.vstack([motion.a, motion.a[back]]),
        )

    def torques(self, where: str, other: bool) -> np.ndarray:
        """Torques at `states` or along `trajectory` by the closed form, or by the other route for the closed form."""
        return self._answers("torque", where, other)

    def accelerations(self, other: bool) -> np.ndarray:
        """Answers of the forward dynamics at `states` under the closed form's torques, in the same way."""
        return self._answers("acceleration", "states", other)

    def _answers(self, method: str, where: str, other: bool) -> np.ndarray:
        key = (method, where, other)
        if key not in self._known:
            q, v, third = getattr(self, where)
            if method == "acceleration":
                third = self.torques(where, other=False)
            self._known[key] = getattr(self.reference if other else self.closed_form, method)(q, v, third)
        return self._known[key]

    @cached_property
    def tree_coordinates(self) -> list[np.ndarray]:
        """Closed tree coordinates at `states`, in pinocchio's order, by the closed form."""
        joints = self.closed_form.assemble(self.states[0])
        names = self.reference.backend.tree_joint_names
        return list(np.ascontiguousarray(np.stack([joints[name] for name in names], axis=-1)))

    def at_states(self, function: Callable[..., Any], *columns: Any, other: bool = False) -> Work:
        """Timed at the first state, checked at all of them."""
        arguments = list(zip(*(columns or self.states), strict=True))
        return Work(function, arguments, self.torques("states", other), period=1)

    def along(self, function: Callable[..., Any], other: bool = False) -> Work:
        """Timed and checked along the whole motion, each call a new q."""
        arguments = list(zip(*self.trajectory, strict=True))
        return Work(function, arguments, self.torques("trajectory", other), period=len(arguments))

    def forward(self, function: Callable[..., Any], poses: Any, other: bool = False) -> Work:
        """`function(pose, v, torque)`, an acceleration, with one of `poses` for each state."""
        arguments = list(zip(poses, self.states[1], self.torques("states", other=False), strict=True))
        return Work(function, arguments, self.accelerations(other), period=1)

    def batch(self, leg: ld.Leg, rows: int, other: bool = False) -> Work:
        """One call on `rows` rows: the motion, repeated or cut to that length."""
        index = np.arange(rows) % len(self.trajectory[0])
        arguments = tuple(column[index] for column in self.trajectory)
        return Work(leg.torque, [arguments], [self.torques("trajectory", other)[index]], period=1)

    def random_batch(self, leg: ld.Leg) -> Work:
        """One call on the rows of `states`: neighbours have nothing in common."""
        return Work(leg.torque, [self.states], [self.torques("states", other=False)], period=1)


# ---------------------------------------------------------------------- one call


def rnea(workload: Workload) -> Work:
    """The yardstick; its answer is checked after projection onto the closed motion."""
    import pinocchio as pin

    mechanism = workload.mechanism()
    model = mechanism.tree.model.copy()
    data = model.createData()
    arguments, projections = [], []
    for q, v, a in zip(*workload.states, strict=True):
        state = mechanism.close(q)
        qd = state.G @ v
        arguments.append((model, data, state.q, qd, state.G @ a + mechanism.bias_acceleration(state, qd)))
        projections.append(state.G)
    return Work(
        pin.rnea,
        arguments,
        workload.torques("states", other=False),
        period=1,
        answer=lambda result, index: projections[index].T @ result,
    )


def mechanism_closed(workload: Workload) -> Work:
    mechanism = workload.mechanism()

    def torque(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        # The three steps of `Mechanism.close` without the search for q.
        state = mechanism.state_of(q)
        return mechanism.actuator_effort(state, mechanism.generalized_force(state, v, a))

    return workload.at_states(torque, workload.tree_coordinates, *workload.states[1:])


def mechanism_trajectory(workload: Workload) -> Work:
    mechanism = workload.mechanism()

    def torque(y: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        state = mechanism.close(y)
        return mechanism.actuator_effort(state, mechanism.generalized_force(state, v, a))

    return workload.along(torque)


def naive_closed(workload: Workload) -> Work:
    from benchmarks.naive import Naive

    return workload.at_states(
        Naive(workload.closed_form.description).torque, workload.tree_coordinates, *workload.states[1:]
    )


def naive_trajectory(workload: Workload) -> Work:
    from benchmarks.naive import Naive

    return workload.along(Naive(workload.closed_form.description).torque_with_newton)


# ---------------------------------------------------------------------- forward dynamics


def projected(workload: Workload) -> Work:
    mechanism = workload.mechanism()

    def acceleration(q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        state = mechanism.state_of(q)
        return mechanism.acceleration(state, v, tau)

    return workload.forward(acceleration, workload.tree_coordinates)


def constrained(algorithm: str) -> Callable[[Workload], Work]:
    """Pinocchio's own constrained dynamics on closed states: q and qd are given, nothing is factorised for it."""

    def prepare(workload: Workload) -> Work:
        from leg_dynamics.mechanism.constrained import ConstrainedDynamics

        mechanism = workload.mechanism()
        dynamics = ConstrainedDynamics(mechanism)
        closed = [mechanism.close(q) for q in workload.states[0]]

        def acceleration(state: Any, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
            return dynamics.acceleration(state, v, tau, algorithm=algorithm)

        return workload.forward(acceleration, closed)

    return prepare


# ---------------------------------------------------------------------- the list


def all_cases(settings: Settings) -> tuple[Case, ...]:
    """Every case, the yardstick first."""
    single = [
        Case(YARDSTICK, SINGLE, "pin.rnea of the open tree: the yardstick", rnea),
        Case(
            "closed_form_fixed",
            SINGLE,
            "closed_form: leg.torque, q fixed",
            lambda w: w.at_states(w.closed_form.torque, other=True),
        ),
        Case(
            "closed_form_trajectory",
            SINGLE,
            "closed_form: leg.torque along the trajectory",
            lambda w: w.along(w.closed_form.torque, other=True),
        ),
        Case(
            "mechanism_closed",
            SINGLE,
            "Mechanism, closed tree q given: loop rows, factors, G, g, rnea",
            mechanism_closed,
            goal=16.0,
        ),
        Case(
            "mechanism_trajectory",
            SINGLE,
            "Mechanism along the trajectory: warm closure and torque",
            mechanism_trajectory,
            goal=35.0,
        ),
        Case(
            "pinocchio_fixed",
            SINGLE,
            "pinocchio: leg.torque, q fixed: reuses the closed pose",
            lambda w: w.at_states(w.pinocchio().torque),
        ),
        Case(
            "pinocchio_trajectory",
            SINGLE,
            "pinocchio: leg.torque along the trajectory",
            lambda w: w.along(w.pinocchio().torque),
        ),
        Case("naive_closed", SINGLE, "naive pinocchio + NumPy pinv, closed tree q given", naive_closed, peer=True),
        Case(
            "naive_trajectory",
            SINGLE,
            "naive pinocchio + NumPy pinv, Newton along the trajectory",
            naive_trajectory,
            peer=True,
        ),
    ]
    forward = [
        Case(
            "closed_form_acceleration",
            FORWARD,
            "closed_form: leg.acceleration",
            lambda w: w.forward(w.closed_form.acceleration, w.states[0], other=True),
        ),
        Case(
            "pinocchio_acceleration",
            FORWARD,
            "pinocchio: leg.acceleration, q fixed: reuses the closed pose",
            lambda w: w.forward(w.pinocchio().acceleration, w.states[0]),
        ),
        Case("projected", FORWARD, "Mechanism, closed tree q given: projected", projected),
        *(
            Case(
                algorithm,
                FORWARD,
                f"pin.{algorithm}, closed state given; couplings by multipliers",
                constrained(algorithm),
                peer=True,
            )
            for algorithm in ("constraintDynamics", "lcaba")
        ),
    ]
    batch = [
        Case(
            f"closed_form_batch_{rows}",
            BATCH,
            f"closed_form (NumPy vectorised), N = {rows:,}",
            lambda w, rows=rows: w.batch(w.closed_form, rows, other=True),
            rows=rows,
        )
        for rows in settings.batch_rows
    ]
    batch += [
        Case(
            f"pinocchio_batch_{rows}",
            BATCH,
            f"pinocchio, N = {rows:,}, "
            + ("neighbouring rows" if rows > 1 else "always the same one: reuses its pose"),
            lambda w, rows=rows: w.batch(w.pinocchio(), rows),
            rows=rows,
        )
        for rows in dict.fromkeys(min(rows, settings.row_limit) for rows in settings.batch_rows)
    ]
    random_rows = settings.states + 1
    batch.append(
        Case(
            "pinocchio_batch_random",
            BATCH,
            f"pinocchio, N = {random_rows:,}, rows at random: no warm start",
            lambda w: w.random_batch(w.pinocchio()),
            rows=random_rows,
        )
    )
    return (*single, *forward, *batch)
