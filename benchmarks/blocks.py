"""What is timed: the blocks of a run and their cases, in the order of the report."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

from benchmarks import mechanisms, peers
from benchmarks.cases import YARDSTICK, Block, Case, Settings, Work, Workload, cold, load_symbolic
from benchmarks.mechanisms import GRBDA, Subject

SINGLE, FORWARD, METHODS, BATCH, THREADS, MODELS, CHAINS = (
    "single",
    "forward",
    "methods",
    "batch",
    "threads",
    "models",
    "chains",
)
ROUTES = ("closed_form", "symbolic", "pinocchio")


def _yardstick(prefix: str = "") -> Case:
    return Case(prefix + YARDSTICK, "pin.rnea of the open tree: the yardstick", peers.rnea)


def single(settings: Settings) -> tuple[Case, ...]:
    """Inverse dynamics, one call from Python."""
    return (
        _yardstick(),
        Case(
            "limit_by_row",
            "THE LIMIT: hand-written C, one call a row inside C",
            peers.limit_by_row,
            rows=settings.states,
            peer=True,
        ),
        Case("kernel_fixed", "closed_form: the gufunc alone", peers.kernel_alone),
        Case("closed_form_fixed", "closed_form: leg.torque, q fixed", lambda w: w.at_states(w.closed_form.torque)),
        Case(
            "closed_form_trajectory",
            "closed_form: leg.torque along the trajectory",
            lambda w: w.along(w.closed_form.torque),
        ),
        Case("symbolic_fixed", "symbolic: leg.torque, q fixed", peers.symbolic_fixed),
        Case(
            "symbolic_trajectory",
            "symbolic: leg.torque along the trajectory",
            lambda w: w.along(w.symbolic.torque),
        ),
        Case(
            "mechanism_closed",
            "Mechanism, closed tree q given: loop rows, factors, G, g, rnea",
            peers.mechanism_closed,
        ),
        Case(
            "mechanism_trajectory",
            "Mechanism along the trajectory: closure from the last pose, and torque",
            peers.mechanism_trajectory,
        ),
        Case(
            "pinocchio_fixed",
            "pinocchio: leg.torque, q fixed: reuses the closed pose",
            lambda w: Work(
                w.pinocchio().torque,
                list(zip(*w.states, strict=True)),
                w.torques("states", other=False),
                period=1,
            ),
        ),
        Case(
            "pinocchio_trajectory",
            "pinocchio: leg.torque along the trajectory",
            lambda w: w.along(w.pinocchio().torque, other=False),
        ),
        Case("well_used", "pinocchio well used: closed-form passive joints + one rnea", peers.well_used, peer=True),
        Case("plain_formulas", "the plain formulas on Python floats", peers.plain_formulas, peer=True),
        Case("naive_closed", "naive pinocchio + NumPy pinv, closed tree q given", peers.naive_closed, peer=True),
        Case(
            "naive_trajectory",
            "naive pinocchio + NumPy pinv, Newton along the trajectory",
            peers.naive_trajectory,
            peer=True,
        ),
        Case("mujoco_raw", "MuJoCo mj_inverse as it is, closed motion given", peers.mujoco_raw, peer=True),
        Case(
            "mujoco_projected",
            "MuJoCo mj_inverse projected, closed q and drift given",
            peers.mujoco_projected,
            peer=True,
        ),
        Case("toolbox", "toolbox-parallel-robots: quadratic programme", peers.toolbox, peer=True),
    )


def forward() -> tuple[Case, ...]:
    """Forward dynamics, one call from Python."""
    return (
        _yardstick("forward_"),
        Case(
            "closed_form_acceleration",
            "closed_form: leg.acceleration",
            lambda w: w.forward(w.closed_form.acceleration, w.states[0]),
        ),
        Case(
            "symbolic_acceleration",
            "symbolic: leg.acceleration, q fixed",
            lambda w: w.forward(w.symbolic.acceleration, w.states[0]),
        ),
        Case(
            "pinocchio_acceleration",
            "pinocchio: leg.acceleration, q fixed: reuses the closed pose",
            lambda w: w.forward(w.pinocchio().acceleration, w.states[0], other=False),
        ),
        Case("projected", "Mechanism, closed tree q given: projected", peers.projected),
        *(
            Case(
                algorithm,
                f"pin.{algorithm}, closed state given; couplings by multipliers",
                peers.constrained(algorithm),
                peer=True,
            )
            for algorithm in ("constraintDynamics", "lcaba")
        ),
    )


def _leg(workload: Workload, route: str) -> Any:
    return workload.pinocchio() if route == "pinocchio" else getattr(workload, route)


def _other(workload: Workload, route: str) -> Any:
    """Who answers for a route: the closed form for pinocchio, pinocchio for the others."""
    return workload.closed_form if route == "pinocchio" else workload.reference


def _method(route: str, method: str, *inputs: str) -> Callable[[Workload], Work]:
    def prepare(workload: Workload) -> Work:
        count = workload.settings.method_states
        q, v, a = workload.states
        known = {"q": q, "v": v, "a": a, "foot_force": workload.forces}
        columns = [known[name][:count] for name in inputs]
        function = getattr(_leg(workload, route), method)
        expected = getattr(_other(workload, route), method)(*columns)
        flat = [np.ravel(row) for row in expected]
        return Work(
            function, list(zip(*columns, strict=True)), flat, period=1, answer=lambda result, _: np.ravel(result)
        )

    return prepare


def _inverse_kinematics(route: str) -> Callable[[Workload], Work]:
    def prepare(workload: Workload) -> Work:
        # Near a straight leg q follows from p with half the digits: the answer is the point that q leads back to.
        other = _other(workload, route)
        q = workload.states[0]
        q = q[q[:, -1] > 0.1][: workload.settings.method_states]
        points = other.foot_position(q)
        leg = _leg(workload, route)

        def back(result: Any, index: int) -> np.ndarray:
            return other.foot_position(result)

        return Work(
            lambda p: leg.inverse_kinematics(p, limits="ignore"), [(p,) for p in points], points, period=1, answer=back
        )

    return prepare


_METHODS = (
    ("torque with foot force", "torque", ("q", "v", "a", "foot_force")),
    ("foot_position", "foot_position", ("q",)),
    ("jacobian", "jacobian", ("q",)),
    ("mass_matrix", "mass_matrix", ("q",)),
)


def methods() -> tuple[Case, ...]:
    """The other methods, one call from Python; pinocchio's reuse the closed pose."""
    cases = [_yardstick("methods_")]
    for route in ROUTES:
        cases += [
            Case(f"{route}_{name.replace(' ', '_')}", f"{route}: {name}", _method(route, method, *inputs))
            for name, method, inputs in _METHODS
        ]
        cases.append(Case(f"{route}_inverse_kinematics", f"{route}: inverse_kinematics", _inverse_kinematics(route)))
    return tuple(cases)


CONTENDERS: dict[str, str] = {
    "limit": "THE LIMIT: hand-written C with vectors",
    "kernel": "closed_form: the gufunc alone, out given",
    "closed_form": "closed_form: leg.torque",
    "closed_form_out": "closed_form: leg.torque, out given",
    "generated": "CasADi's generated C, scalar",
    "symbolic": "symbolic: leg.torque, closure included",
    "vectorised": "NumPy vectorised closed form",
    "well_used": "pinocchio well used, Python loop",
    "mujoco": "MuJoCo projected, Python loop",
    "naive": "naive pinocchio + pinv, closed q given, Python loop",
    "pinocchio": "pinocchio: leg.torque, random rows",
}


def batch(settings: Settings, rows: int) -> tuple[Case, ...]:
    """Inverse dynamics of many rows in one call from Python."""
    makers: dict[str, tuple[Callable[[Workload], Work], int]] = {
        "limit": (partial(peers.limit_rows, rows=rows), rows),
        "kernel": (partial(peers.kernel_rows, rows=rows), rows),
        "closed_form": (lambda w: w.batch(w.closed_form.torque, rows), rows),
        "closed_form_out": (partial(peers.torque_into_rows, rows=rows), rows),
        "generated": (partial(peers.generated_rows, rows=rows), rows),
        "symbolic": (partial(peers.symbolic_rows, rows=rows), rows),
        "vectorised": (partial(peers.vectorised_rows, rows=rows), rows),
        "well_used": (partial(peers.well_used_rows, rows=rows), settings.row_limit),
        "mujoco": (partial(peers.mujoco_rows, rows=rows), settings.slow_limit),
        "naive": (partial(peers.naive_rows, rows=rows), settings.slow_limit),
        "pinocchio": (lambda w: _pinocchio_rows(w, rows), settings.slow_limit),
    }
    own = ("kernel", "closed_form", "closed_form_out", "symbolic", "pinocchio")
    return (
        _yardstick(f"batch_{rows}_"),
        *(
            Case(f"{name}_batch_{rows}", CONTENDERS[name], make, rows=rows, peer=name not in own, contender=name)
            for name, (make, largest) in makers.items()
            if rows <= largest
        ),
    )


def _pinocchio_rows(workload: Workload, rows: int) -> Work:
    arguments, _ = workload.rows(rows)
    index = np.arange(rows) % len(workload.states[0])
    expected = workload.torques("states", other=False)[index]
    return Work(cold(workload.pinocchio()), [arguments], [expected], period=1)


def threads(rows: int) -> tuple[Case, ...]:
    """One thread and two."""

    def symbolic(workload: Workload, count: int) -> Work:
        leg = load_symbolic(workload.name, threads=count)
        return workload.batch(leg.torque, rows)

    cases = [_yardstick("threads_")]
    for count, word in ((1, "one thread"), (2, "two threads")):
        limit = peers.limit_rows if count == 1 else peers.limit_on_two_threads
        cases += [
            Case(f"limit_threads_{count}", f"THE LIMIT, {word}", partial(limit, rows=rows), rows=rows, peer=True),
            Case(
                f"closed_form_threads_{count}",
                f"closed_form: leg.torque, out given, {word}",
                partial(peers.torque_into_rows, rows=rows, threads=count),
                rows=rows,
            ),
            Case(
                f"symbolic_threads_{count}", f"symbolic: leg.torque, {word}", partial(symbolic, count=count), rows=rows
            ),
        ]
    return tuple(cases)


def _mechanism(key: str, rows: int) -> tuple[Case, ...]:
    return (
        Case(f"{key}_{YARDSTICK}", "pin.rnea of its open tree", lambda s: s.rnea()),
        Case(f"{key}_symbolic", "symbolic: one call along a path", lambda s: s.along(s.symbolic), contender="symbolic"),
        Case(
            f"{key}_symbolic_batch",
            f"symbolic: N = {rows:,}, closure included, a row",
            lambda s: s.batch(s.symbolic, rows),
            rows=rows,
            contender="symbolic_batch",
        ),
        Case(
            f"{key}_pinocchio",
            "pinocchio: one call along a path",
            lambda s: Work(
                s.pinocchio.torque,
                list(zip(*s.path, strict=True)),
                s.expected("path"),
                period=len(s.path[0]),
            ),
            contender="pinocchio",
        ),
    )


MODEL_ROWS = 10_000


def all_blocks(leg: str, settings: Settings) -> tuple[Block, ...]:
    """Every block of a run."""

    @cache
    def workload() -> Workload:
        return Workload(leg, settings)

    blocks = [
        Block(
            SINGLE,
            "Inverse dynamics, one call from Python",
            workload,
            single(settings),
            limit="limit_by_row",
            chart="single",
        ),
        Block(FORWARD, "Forward dynamics, one call from Python", workload, forward(), share=0.5),
        Block(METHODS, "Other methods, one call from Python", workload, methods(), share=0.5),
    ]
    for rows in settings.batch_rows:
        blocks.append(
            Block(
                f"{BATCH}_{rows}",
                f"Inverse dynamics, N = {rows:,}",
                workload,
                batch(settings, rows),
                limit=f"limit_batch_{rows}",
                per_row=True,
                share=1.0 if rows <= 10_000 else 0.5,
                chart="batch",
            )
        )
    count = settings.thread_rows
    blocks.append(
        Block(
            THREADS,
            f"Threads, N = {count:,}",
            workload,
            threads(count),
            limit="limit_threads_1",
            per_row=True,
            share=0.5,
        )
    )
    for name in GRBDA:
        blocks.append(
            Block(
                f"{MODELS}_{name}",
                f"Foreign file {name}",
                _subject(lambda name=name: mechanisms.foreign(name), settings),
                _mechanism(name, MODEL_ROWS),
                share=0.5,
            )
        )
    blocks.append(
        Block(
            f"{MODELS}_platform",
            "Planar 3-RRR platform, generated",
            _subject(mechanisms.platform, settings),
            _mechanism("platform", MODEL_ROWS),
            share=0.5,
        )
    )
    for loops in settings.loops:
        blocks.append(
            Block(
                f"{CHAINS}_{loops}",
                f"Chain of {loops} four-bar loop{'s' * (loops > 1)}: {3 * loops} bodies",
                _subject(lambda loops=loops: mechanisms.chain(loops), settings),
                _mechanism(f"chain_{loops}", MODEL_ROWS),
                share=0.5,
                chart="chains",
            )
        )
    return tuple(blocks)


def _subject(text: Callable[[], str], settings: Settings) -> Callable[[], Subject]:
    @cache
    def make() -> Subject:
        return Subject(text, settings)

    return make
