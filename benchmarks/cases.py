"""What a case is, and the workload it is prepared from; `blocks` lists the cases.

A new peer is a function that takes a `Workload` and returns a `Work`, plus a line in `blocks`.
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

YARDSTICK = "pin_rnea"


class NotAvailableError(Exception):
    """A contender is not there on this machine; the message is the reason."""


def _as_is(result: Any, index: int) -> Any:
    return result


@dataclass(frozen=True)
class Work:
    """A case made ready: `function(*arguments[i])` is checked for every i and timed over the first `period` of them.

    `answer` turns a result into what `expected[i]` says, shape (m,) or (rows, m); it is not timed. `note` is what a
    reader must know to judge the time.
    """

    function: Callable[..., Any]
    arguments: Sequence[tuple[Any, ...]]
    expected: np.ndarray | Sequence[np.ndarray]
    period: int
    answer: Callable[[Any, int], Any] = _as_is
    note: str | None = None


@dataclass(frozen=True)
class Case:
    """One line of the report.

    `peer` marks what is shown for comparison and may fail without failing the run. `contender` names the curve that a
    batch case belongs to.
    """

    key: str
    title: str
    prepare: Callable[[Any], Work]
    rows: int = 1
    peer: bool = False
    contender: str | None = None


@dataclass(frozen=True)
class Block:
    """Cases that are timed in turns with each other and with the yardstick.

    Attributes
    ----------
    key, title : str
    subject : callable
        Makes what the cases are prepared from, `prepare(subject)`.
    cases : tuple of Case
        The first one is the yardstick where its key ends in `YARDSTICK`.
    limit : str or None
        Key of the case that is the hardware's limit for the others.
    per_row : bool
        Whether times are given in ns a row, not in µs a call.
    share : float
        Share of the settings' repetitions.
    chart : str
        Figure that the block is drawn in.
    """

    key: str
    title: str
    subject: Callable[[], Any]
    cases: tuple[Case, ...]
    limit: str | None = None
    per_row: bool = False
    share: float = 1.0
    chart: str = ""


@dataclass(frozen=True)
class Settings:
    """How much is measured.

    Attributes
    ----------
    repetitions : int
        Rounds; each visits every case of a block once.
    minimum_ns : int
        Least length of one measurement.
    rate : float
        Samples a second of the trajectory.
    states, method_states : int
        Random states that torques and other methods are checked at.
    batch_rows : tuple of int
    row_limit, slow_limit : int
        Largest batches of what goes row by row in C++ and in NumPy.
    loops : tuple of int
        Four-bar loops of the generated chains.
    thread_rows : int
        Rows of the comparison of one and two threads, and of the memory a row.
    processes : int
        Fresh processes for each figure of a cold start.
    seed : int
    """

    repetitions: int = 25
    minimum_ns: int = 5_000_000
    rate: float = 1000.0
    states: int = 1000
    method_states: int = 256
    batch_rows: tuple[int, ...] = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)
    row_limit: int = 1_000
    slow_limit: int = 100
    loops: tuple[int, ...] = (1, 2, 4, 8, 16)
    thread_rows: int = 1_000_000
    processes: int = 5
    seed: int = 0


FULL = Settings()
QUICK = Settings(
    repetitions=5,
    minimum_ns=2_000_000,
    method_states=32,
    rate=250.0,
    batch_rows=(1, 100, 10_000, 100_000),
    loops=(1, 2),
    thread_rows=300_000,
    processes=1,
)


def available_legs() -> tuple[str, ...]:
    """Shipped legs that have two independent routes and a named motion."""
    return tuple(name for name in ld.available() if has_closed_form(name) and named(name))


def load_symbolic(source: str, **options: Any) -> ld.Leg:
    """Load by the symbolic route.

    Raises
    ------
    NotAvailableError
        The route is missing, or does not serve this file.
    """
    try:
        return ld.load(source, route="symbolic", **options)
    except Exception as problem:
        raise NotAvailableError(f"route symbolic: {type(problem).__name__}: {problem}") from problem


def closure_of(leg: ld.Leg) -> str:
    """How a leg closes its loops, in words: they are different amounts of work."""
    if leg.route != "symbolic":
        return "the numeric route"
    model = leg.backend.model  # type: ignore[attr-defined]
    if not model.nz:
        return "no loop left to close"
    if not model.iterates:
        return "explicit formulas"
    if model.walks:
        return "Newton's method along a walk from the home pose"
    return "Newton's method from the last pose or home"


def cold(leg: ld.Leg) -> Callable[..., Any]:
    """`Leg.torque` that closes the loops of every pose anew, where they are closed numerically."""
    backend: Any = leg.backend

    def torque(*arguments: Any) -> Any:
        numeric = backend if leg.route == "pinocchio" else vars(backend).get("fallback")
        if numeric is not None:
            numeric.mechanism.forget(every_pose=True)
        return leg.torque(*arguments)

    return torque


class Workload:
    """A leg by its routes, the states that it is measured at, and the answers of one route for the others."""

    def __init__(self, leg: str, settings: Settings) -> None:
        self.name = leg
        self.settings = settings
        self._known: dict[tuple[str, str, bool], np.ndarray] = {}
        self._batches: dict[int, tuple[tuple[np.ndarray, ...], np.ndarray]] = {}

    @cached_property
    def closed_form(self) -> ld.Leg:
        return ld.load(self.name, route="closed_form", threads=1)

    @cached_property
    def symbolic(self) -> ld.Leg:
        return load_symbolic(self.name, threads=1)

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
    def forces(self) -> np.ndarray:
        """Foot forces at `states`, N."""
        return np.random.default_rng(self.settings.seed + 1).uniform(-50.0, 50.0, (len(self.states[0]), 3))

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
        """Torques at `states` or along `trajectory` by the closed form, or, with `other`, by the pinocchio route."""
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

    @cached_property
    def tree_motion(self) -> list[tuple[np.ndarray, ...]]:
        """For each of `states` the closed tree motion by the numeric route: q, G, g (drift), qd, qdd."""
        mechanism = self.mechanism()
        motion = []
        for q, v, a in zip(*self.states, strict=True):
            state = mechanism.close(q)
            qd = state.G @ v
            drift = mechanism.bias_acceleration(state, qd)
            motion.append((state.q, state.G, drift, qd, state.G @ a + drift))
        return motion

    # ------------------------------------------------------------------ works

    def at_states(self, function: Callable[..., Any], *columns: Any, **more: Any) -> Work:
        """Timed at the first state, checked at all of them against the pinocchio route."""
        arguments = list(zip(*(columns or self.states), strict=True))
        return Work(function, arguments, self.torques("states", other=True), period=1, **more)

    def along(self, function: Callable[..., Any], other: bool = True) -> Work:
        """Timed and checked along the whole motion, each call a new q."""
        arguments = list(zip(*self.trajectory, strict=True))
        return Work(function, arguments, self.torques("trajectory", other), period=len(arguments))

    def forward(self, function: Callable[..., Any], poses: Any, other: bool = True) -> Work:
        """`function(pose, v, torque)`, an acceleration, with one of `poses` for each of the first states."""
        count = self.settings.method_states
        columns = poses, self.states[1], self.torques("states", other=False)
        arguments = list(zip(*(column[:count] for column in columns), strict=True))
        return Work(function, arguments, self.accelerations(other)[:count], period=1)

    def rows(self, count: int) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """q, v, a of a batch, `states` repeated or cut to that length, and their torques by the pinocchio route."""
        if count not in self._batches:
            index = np.arange(count) % len(self.states[0])
            torque = self.torques("states", other=True)
            self._batches[count] = tuple(column[index] for column in self.states), torque[index]
        return self._batches[count]

    def batch(self, function: Callable[..., Any], rows: int, **more: Any) -> Work:
        """One call on `rows` rows that have nothing in common with their neighbours."""
        arguments, expected = self.rows(rows)
        return Work(function, [arguments], [expected], period=1, **more)

    def forget(self, rows: int) -> None:
        """Give the memory of a batch back."""
        self._batches.pop(rows, None)
