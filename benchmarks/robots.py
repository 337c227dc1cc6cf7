"""`python -m benchmarks.robots`: every robot of example-robot-data by the two routes that serve any mechanism.

A robot's table row says whether it loads, or why not, and what a torque costs by each route, in units of one `pin.rnea`
of the same tree, timed in turns with it. Answers go through the accuracy gate first, as everywhere here.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

import leg_dynamics as ld
from benchmarks import environment
from benchmarks.__main__ import STANDARD_OUTPUT, _Parser, _writable_or_output
from benchmarks.cases import YARDSTICK, Block, Case, Settings, Work
from benchmarks.gate import FOLDERS
from benchmarks.mechanisms import Subject, symbolic_note
from benchmarks.report import Result, digits
from benchmarks.suite import measure
from leg_dynamics.description import read
from leg_dynamics.description.legs import legs_of
from leg_dynamics.description.robot_data import PREFIX, robot_data_names
from leg_dynamics.errors import ActuationError, DescriptionError, LegDynamicsError, LegDynamicsWarning, SingularityError

ROUTES = ("pinocchio", "symbolic")
SETTINGS = Settings(repetitions=9, minimum_ns=1_000_000, states=16)
HEADER = (
    "robot",
    "loads",
    "degrees of freedom",
    "actuators",
    "feet",
    "`pin.rnea`, µs",
    "pinocchio, × rnea",
    "µs",
    "symbolic, × rnea",
    "µs",
)
TEXT_COLUMNS = (0, 1, 4)
YES = "yes"
GENERALIZED = " ¹"
NONE = "–"


class RobotSubject(Subject):
    """A robot by both routes, around its home pose, or zero where the file has none."""

    def __init__(self, name: str, settings: Settings = SETTINGS) -> None:
        super().__init__(lambda: read(PREFIX + name).urdf, settings)
        self.name = name

    @cached_property
    def pinocchio(self) -> ld.Leg:
        return ld.load(PREFIX + self.name, route="pinocchio")

    @cached_property
    def symbolic(self) -> ld.Leg:
        return ld.load(PREFIX + self.name, route="symbolic", threads=1)

    @cached_property
    def home(self) -> np.ndarray:
        home = self.pinocchio.description.home
        values = {} if home is None else home.values
        return np.array([values.get(joint, 0.0) for joint in self.pinocchio.joint_names])

    @cached_property
    def method(self) -> str:
        """``torque`` where the actuators determine it, else ``generalized_force``, which always is unique."""
        try:
            self.pinocchio.torque(self.home, np.zeros_like(self.home), np.zeros_like(self.home))
        except (ActuationError, SingularityError):
            return "generalized_force"
        return "torque"

    def expected(self, where: str) -> np.ndarray:
        key = f"_expected_{where}"
        if not hasattr(self, key):
            setattr(self, key, getattr(self.pinocchio, self.method)(*getattr(self, where)))
        return getattr(self, key)

    def rnea(self) -> Work:
        """`pin.rnea` of the same tree; its answer gets the joints' friction, which it leaves out, and the actuators."""
        import pinocchio as pin

        mechanism = self.pinocchio.backend.mechanism  # type: ignore[attr-defined]
        model = mechanism.tree.model.copy()
        data = model.createData()
        arguments, maps = [], []
        for q, v, a in zip(*self.states, strict=True):
            state = mechanism.close(q)
            qd = state.G @ v
            qdd = state.G @ a + mechanism.bias_acceleration(state, qd)
            arguments.append((model, data, mechanism.tree.to_configuration(state.q), qd, qdd))
            maps.append((state, mechanism.joint_friction(state, v, qd)))

        def answer(result: Any, index: int) -> np.ndarray:
            state, friction = maps[index]
            generalized = state.G.T @ (result + friction)
            return mechanism.actuator_effort(state, generalized) if self.method == "torque" else generalized

        return Work(pin.rnea, arguments, self.expected("states"), period=1, answer=answer)

    def along(self, leg: ld.Leg) -> Work:
        """One call a state, each near the one before."""
        arguments = list(zip(*self.path, strict=True))
        call = getattr(leg, self.method)
        return Work(call, arguments, self.expected("path"), period=len(arguments), note=symbolic_note(leg))


@dataclass(frozen=True)
class Row:
    """One robot of the table; `results` are the yardstick's and the routes', none where it does not load."""

    name: str
    loads: str
    freedoms: int | None = None
    actuators: int | None = None
    feet: str = NONE
    generalized: bool = False
    results: tuple[Result, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether what loads also computes, and rightly."""
        return all(result.status == "ok" for result in self.results)

    def cells(self) -> tuple[str, ...]:
        """As `HEADER` has them."""
        freedoms, actuators = (NONE if n is None else str(n) for n in (self.freedoms, self.actuators))
        times: list[str] = []
        for result in self.results or (None,) * (1 + len(ROUTES)):
            yardstick = result is None or result.key.endswith(YARDSTICK)
            times += _times(result)[yardstick:]
        if not self.results:
            times = [NONE] * (1 + 2 * len(ROUTES))
        return self.name, self.loads, freedoms, actuators + GENERALIZED * self.generalized, self.feet, *times


def _times(result: Result | None) -> tuple[str, str]:
    """Medians: ratio to the yardstick, and µs a call."""
    if result is None or result.per_row is None:
        return NONE, NONE
    if result.status != "ok":
        return result.status, NONE
    return (NONE if result.ratio is None else digits(result.ratio[2])), digits(result.per_row[2] / 1000.0)


def reason(problem: LegDynamicsError) -> str:
    """Why a robot does not load: the first sentence of the error, without folders."""
    text = problem.message
    file = getattr(problem, "file", None)
    if file is not None:
        line = getattr(problem, "line", None)
        text = text.removeprefix(f"{file}: " if line is None else f"{file}:{line}: ")
    sentence = FOLDERS.sub("", text).split("; ")[0].split(". ")[0].replace("|", "\\|")
    # Markdown would take an element for one of its own.
    return re.sub(r"<[^<>]*>", lambda element: f"`{element[0]}`", sentence)


def feet(description: Any) -> str:
    """The feet of a robot's legs, by name; of a leg that has no clear one, how many links it could be."""
    try:
        legs = legs_of(description)
    except DescriptionError:
        return NONE
    return ", ".join(leg.foot or f"one of {len(leg.candidates)} of {leg.name}" for leg in legs.values())


def block_of(subject: RobotSubject) -> Block:
    """The yardstick and the two routes, to be timed in turns."""
    name = subject.name
    cases = (
        Case(f"{name}_{YARDSTICK}", "pin.rnea of the tree", lambda robot: robot.rnea()),
        *(Case(f"{name}_{route}", f"route {route}", _along(route)) for route in ROUTES),
    )
    return Block(name, name, lambda: subject, cases)


def _along(route: str) -> Callable[[RobotSubject], Work]:
    return lambda robot: robot.along(getattr(robot, route))


def row(name: str, settings: Settings = SETTINGS) -> Row:
    """Load a robot by both routes, hold them against each other, and time them."""
    subject = RobotSubject(name, settings)
    with warnings.catch_warnings():
        # What these files make the project warn about is no news here.
        warnings.simplefilter("ignore", LegDynamicsWarning)
        try:
            legs = [getattr(subject, route) for route in ROUTES]
        except LegDynamicsError as problem:
            return Row(name, f"no: {reason(problem)}")
        leg = legs[0]
        return Row(
            name,
            YES,
            len(leg.joint_names),
            len(leg.actuator_names),
            feet(leg.description),
            subject.method != "torque",
            tuple(measure(block_of(subject), settings)),
        )


def page(rows: Sequence[Row]) -> str:
    """The table as Markdown."""
    rule = ["---" if i in TEXT_COLUMNS else "--:" for i in range(len(HEADER))]
    loaded = [each for each in rows if each.loads == YES]
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("example-robot-data", "pin"))
    return "\n".join(
        [
            "# Robots of example-robot-data",
            "",
            f'`leg_dynamics.load("{PREFIX}NAME")` loads {len(loaded)} of the {len(rows)} URDF files of {versions}. '
            "Written by `python -m benchmarks.robots --output docs/robots.md`.",
            "",
            "A time is one call of `leg.torque` from Python along a motion around the robot's home pose, each call a "
            "new state. Before it is timed, every answer of both routes and of `pin.rnea` is held against the others. "
            "Times are medians, and × rnea is over one `pin.rnea` of the same tree timed in turns with it; read the "
            "ratios, the microseconds depend on the machine "
            f"({environment.cpu_model()}, {environment.cores()} cores). Feet are the links that "
            "`leg_dynamics.description.legs.legs_of` finds on the groups of joints that hang on the "
            "trunk, arms and heads among them; – is a robot without several legs.",
            "",
            _line(HEADER),
            f"|{'|'.join(rule)}|",
            *(_line(each.cells()) for each in rows),
            "",
            "¹ The file drives fewer or more joints than move, so that there is no unique torque: the time is that of "
            "`leg.generalized_force`.",
            "",
        ]
    )


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def main(arguments: list[str] | None = None, program: str = "python -m benchmarks.robots") -> int:
    """Run from the command line; 1 where a robot loads and a route is wrong or cannot run."""
    parser = _Parser(prog=program, description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--output",
        type=_writable_or_output,
        default=STANDARD_OUTPUT,
        metavar="FILE",
        help="Markdown file (%(default)s)",
    )
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=robot_data_names(), help="some of the robots")
    options = parser.parse_args(arguments)
    names = options.only or robot_data_names()
    columns = (TextColumn("{task.description:<50}"), BarColumn(), TimeElapsedColumn())
    rows = []
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("loading", total=len(names))
        for name in names:
            bar.update(task, description=name[:50])
            rows.append(row(name))
            bar.advance(task)
    text = page(rows)
    if options.output == STANDARD_OUTPUT:
        sys.stdout.write(text)
    else:
        options.output.write_text(text, encoding="utf-8")
    wrong = [result for each in rows for result in each.results if result.status != "ok"]
    for result in wrong:
        sys.stderr.write(f"{result.key}: {result.status}: {result.reason}\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
