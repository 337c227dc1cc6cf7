"""Random mechanisms by two routes, in child processes: `python -m tests.fuzz --cases 20000`.

Each mechanism is drawn by Hypothesis from tests/symbolic/mechanisms.py, loaded by the routes pinocchio and symbolic,
and evaluated at random states near its home. They must agree to 1e-8, relative to 1 + magnitude, or refuse by name; a
death of the interpreter, a minute without an answer, a NaN without an error and an exception of another library are
failures, printed with the mechanism's text.

Case N is mechanism N % 50 of batch N // 50, the same on every run of the same sources (Hypothesis draws constants from
them): `--first N` goes on where an interrupted run stopped (its last line says where), `--first N --cases 1` repeats
one, and `--plan "Plan(...)"`, as a failure prints it, repeats it whatever has changed. Every fifth batch, of small
mechanisms, runs on LLVM's machine code, the others on CasADi's virtual machine, which needs no compilation.
As a test: `pytest -m slow tests/fuzz`, 500 cases, or as many as the environment variable LEG_DYNAMICS_FUZZ says.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import selectors
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
BATCH = 50
COMPILED = 5
# Of one case, and of a start of the interpreter with its plans; s, without what other work took from it.
LIMIT = 60.0


@dataclass
class Summary:
    """Counts over all cases, and what failed."""

    cases: int = 0
    unbuilt: int = 0
    computed: int = 0
    compiled: int = 0
    left: int = 0
    magnified: int = 0
    worst: float = 0.0
    slowest: tuple[float, int] = (0.0, -1)
    agreed: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    alone: Counter[str] = field(default_factory=Counter)
    first: dict[str, int] = field(default_factory=dict)
    """A case for each way of being refused."""
    failures: list[str] = field(default_factory=list)

    @property
    def built(self) -> int:
        """Cases that are a mechanism at all."""
        return self.cases - self.unbuilt

    def add(self, number: int, engine: str, done: dict[str, Any]) -> None:
        """Count one case."""
        self.cases += 1
        if not done["built"]:
            self.unbuilt += 1
            return
        self.computed += done["computed"]
        self.compiled += engine == "llvm"
        self.left += done["left"]
        self.magnified += done["magnified"] > 0
        self.worst = max(self.worst, done["worst"])
        self.slowest = max(self.slowest, (done["seconds"], number))
        self.agreed.update(done["agreed"])
        self.refused.update(done["refused"])
        self.alone.update(set(done["alone"]))
        for what in (*done["refused"], *done["alone"]):
            self.first[what] = min(number, self.first.get(what, number))

    def __str__(self) -> str:
        share = self.computed / max(self.built - len(self.failures), 1)
        lines = [
            f"{self.cases} cases: {self.unbuilt} without a mechanism, {self.computed} computed ({share:.0%} of the "
            f"others), {len(self.failures)} failed; {self.compiled} by LLVM, {self.left} left to the numeric route in "
            f"part, {self.magnified} with an almost singular mass matrix; worst disagreement {self.worst:.2g}, slowest "
            f"case {self.slowest[1]} with {self.slowest[0]:.1f} s"
        ]
        for title, counter in (("agreed", self.agreed), ("refused", self.refused), ("by one alone", self.alone)):
            for what, count in counter.most_common():
                example = f" (case {self.first[what]})" if what in self.first else ""
                lines.append(f"  {title:12} {count:6}  {what}{example}")
        return "\n".join(lines + self.failures)


class Child:
    """A worker process and its lines, each awaited for so long and no longer."""

    def __init__(self, batch: int, first: int, count: int, engine: str, fault: str = "") -> None:
        command = [sys.executable, "-m", "tests.fuzz.worker", str(batch), str(first), str(count), engine]
        self.errors = tempfile.TemporaryFile("w+")  # noqa: SIM115
        self.process = subprocess.Popen(
            command + ([fault] if fault else []),
            stdout=subprocess.PIPE,
            stderr=self.errors,
            cwd=ROOT,
            env=os.environ | {"LEG_DYNAMICS_CACHE": "", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        assert self.process.stdout is not None
        self.rest = b""
        self.selector = selectors.DefaultSelector()
        self.selector.register(self.process.stdout, selectors.EVENT_READ)

    def _clock(self) -> float:
        """Time without the child's waiting for a processor that others use, s."""
        try:
            waited = int(Path(f"/proc/{self.process.pid}/schedstat").read_text().split()[1])
        except (OSError, IndexError, ValueError):
            waited = 0
        return time.monotonic() - 1e-9 * waited

    def line(self, limit: float) -> dict[str, Any] | None:
        """The next line; None where the process has ended. Raises TimeoutError."""
        assert self.process.stdout is not None
        end = self._clock() + limit
        while b"\n" not in self.rest:
            if not self.selector.select(max(end - self._clock(), 0.1)):
                if self._clock() < end:
                    continue
                raise TimeoutError
            data = os.read(self.process.stdout.fileno(), 1 << 16)
            if not data:
                return None
            self.rest += data
        line, self.rest = self.rest.split(b"\n", 1)
        found: dict[str, Any] = json.loads(line)
        return found

    def end(self) -> str:
        """Stop the process; how it ended, and the last of what it said."""
        self.process.kill()
        code = self.process.wait()
        self.errors.seek(0)
        said = self.errors.read()[-4000:]
        self.errors.close()
        self.selector.close()
        assert self.process.stdout is not None
        self.process.stdout.close()
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return f"{name}\n{said}"


def run_batch(
    batch: int,
    first: int,
    count: int,
    engine: str,
    summary: Summary,
    lock: Any,
    *,
    limit: float = LIMIT,
    fault: str = "",
) -> None:
    """Work through mechanisms `first` to `count` of a batch; after a death or a hang with the next one."""
    while first < count:
        child = Child(batch, first, count, engine, fault)
        started: dict[str, Any] = {}
        problem = None
        try:
            while first < count:
                said = child.line(limit)
                if said is None:
                    problem = "the process died"
                    break
                if "start" in said:
                    started = said
                    continue
                number = BATCH * batch + said["done"]
                first = said["done"] + 1
                with lock:
                    if "failure" in said:
                        summary.cases += 1
                        summary.failures.append(_report(number, engine, started, said["failure"], said["trace"]))
                    else:
                        summary.add(number, engine, said)
                started = {}
        except TimeoutError:
            problem = f"no answer within {limit:g} s"
        ending = child.end()
        if problem is not None:
            first = started.get("start", first)
            with lock:
                summary.cases += 1
                summary.failures.append(_report(BATCH * batch + first, engine, started, problem, ending))
            first += 1


def _report(number: int, engine: str, started: dict[str, Any], problem: str, trace: str) -> str:
    return (
        f"\nFAILED case {number} on {engine}: {problem}\n{trace}\nrepeat it by: python -m tests.fuzz --first {number} "
        f"--cases 1\nfoot {started.get('foot')}, {started.get('plan')}\n{started.get('text')}"
    )


def run(cases: int, first: int = 0, jobs: int = 2, progress: bool = False) -> Summary:
    """Check `cases` mechanisms from number `first` on.

    Parameters
    ----------
    cases, first : int
    jobs : int
        Child processes at a time.
    progress : bool
        Print a line a batch, and failures when they are found.
    """
    summary, lock = Summary(), threading.Lock()
    last = first + cases
    finished: set[int] = set()
    told = 0

    def work(batch: int) -> None:
        low, high = max(first - BATCH * batch, 0), min(last - BATCH * batch, BATCH)
        engine = "llvm" if batch % COMPILED == 0 else "casadi"
        nonlocal told
        run_batch(batch, low, high, engine, summary, lock)
        with lock:
            finished.add(batch)
            if progress:
                # At once: a run of hours may be interrupted.
                print(*summary.failures[told:], sep="\n", end="", file=sys.stderr)
                told = len(summary.failures)
                whole = next(number for number in itertools.count(first // BATCH) if number not in finished)
                print(
                    f"{summary.cases} of {cases} cases, {summary.computed} computed, {len(summary.failures)} failed; "
                    f"all before --first {min(max(BATCH * whole, first), last)} are done",
                    file=sys.stderr,
                    flush=True,
                )

    with ThreadPoolExecutor(jobs) as pool:
        for _ in pool.map(work, range(first // BATCH, -(-last // BATCH))):
            pass
    return summary


def main() -> int:
    """The command line."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser("python -m tests.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=500, help="how many mechanisms")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="processes at a time")
    parser.add_argument("--plan", help="one mechanism, as a failure prints it, in this process")
    arguments = parser.parse_args()
    if arguments.plan:
        from tests.fuzz.check import check, mechanisms

        plan = eval(arguments.plan, {"Plan": mechanisms.Plan, "Block": mechanisms.Block})
        made = mechanisms.build(plan)
        print(made.text, check(made.text, made.foot, plan.seed), sep="\n")
        return 0
    summary = run(arguments.cases, arguments.first, arguments.jobs, progress=True)
    print(summary)
    return 1 if summary.failures else 0


if __name__ == "__main__":
    sys.exit(main())
