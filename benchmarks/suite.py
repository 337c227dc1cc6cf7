"""One run: prepare each case, pass it through the gate, time what has an answer, block by block in one process."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from benchmarks import environment, gate, processes
from benchmarks.blocks import all_blocks
from benchmarks.cases import FULL, YARDSTICK, Block, Case, Settings, Work
from benchmarks.report import Figure, Report, Result
from benchmarks.timing import Runner, interleave
from leg_dynamics.errors import LegDynamicsWarning

Progress = Callable[[str, float], None]


def _silent(what: str, share: float) -> None:
    pass


def admit(case: Case, subject: Any) -> tuple[gate.Verdict, Work | None]:
    """Prepare a case and check its answers."""
    try:
        work = case.prepare(subject)
    except Exception as problem:
        return gate.refused(problem), None
    return gate.check(work), work


def rounds(block: Block, settings: Settings) -> int:
    """Rounds of a block, three at least: fewer have no spread."""
    return max(3, round(block.share * settings.repetitions))


def measure(block: Block, settings: Settings, step: Callable[[str], None] = lambda what: None) -> list[Result]:
    """Check and time one block."""
    subject = block.subject()
    verdicts: dict[str, gate.Verdict] = {}
    notes: dict[str, str | None] = {}
    runners: dict[str, Runner] = {}
    for case in block.cases:
        verdict, work = admit(case, subject)
        verdicts[case.key] = verdict
        notes[case.key] = None if work is None else work.note
        # A wrong answer is timed too, for the reader to see what it would have won.
        if work is not None and (verdict.status == "ok" or verdict.error is not None):
            runners[case.key] = Runner(work)
        step(f"checking {case.key}")

    def still_right(key: str, result: Any, index: int) -> bool:
        """A case with a memory may lose its way while it is timed."""
        if verdicts[key].status == "wrong":
            return True
        work = runners[key].work
        error = gate.relative_error(work.answer(result, index), work.expected[index])
        verdict = gate.judge(error, f"at state {index} while it was timed")
        if verdict.status != "ok":
            verdicts[key] = verdict
        return verdict.status == "ok"

    def broke(key: str, problem: Exception) -> None:
        verdicts[key] = gate.Verdict("cannot run", None, f"{gate.explain(problem)} (while it was timed)")

    repetitions = rounds(block, settings)
    interleave(
        runners, settings.minimum_ns, repetitions, still_right, broke, lambda: step(f"timing {block.title.lower()}")
    )
    first = block.cases[0].key
    yardstick = runners[first].samples if first.endswith(YARDSTICK) and _right(first, verdicts, runners) else None
    limit = runners[block.limit].samples if block.limit and _right(block.limit, verdicts, runners) else None
    rows = {case.key: case.rows for case in block.cases}
    results = []
    for case in block.cases:
        verdict, runner = verdicts[case.key], runners.get(case.key)
        samples = tuple(runner.samples) if runner is not None else ()
        own = [sample / case.rows for sample in samples]
        results.append(
            Result(
                key=case.key,
                block=block.key,
                title=case.title,
                rows=case.rows,
                peer=case.peer,
                contender=case.contender,
                status=verdict.status,
                error=verdict.error,
                reason=verdict.reason,
                note=notes.get(case.key),
                calls=runner.loops if samples and runner is not None else 0,
                samples=samples,
                ratios=tuple(x / one for x, one in zip(own, yardstick, strict=True)) if own and yardstick else (),
                limit_ratios=tuple(x / (one / rows[block.limit]) for x, one in zip(own, limit, strict=True))
                if own and limit and block.limit
                else (),
            )
        )
    return results


def _right(key: str, verdicts: dict[str, gate.Verdict], runners: dict[str, Runner]) -> bool:
    return key in runners and verdicts[key].status == "ok"


@contextmanager
def _quiet() -> Iterator[None]:
    """What foreign files make the project warn about is no news here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        yield


def run(
    leg: str,
    settings: Settings = FULL,
    blocks: Sequence[Block] | None = None,
    progress: Progress = _silent,
    *,
    fresh: bool = True,
) -> Report:
    """Measure a leg.

    Parameters
    ----------
    leg : str
        One of `available_legs`.
    settings : Settings
    blocks : sequence of Block, optional
        All of them where None. Without a correct yardstick there are times but no ratios.
    progress : callable, optional
        Called with what is being done and the share that is done.
    fresh : bool
        Whether to measure in fresh processes too: cold start, compilation, memory.
    """
    blocks = all_blocks(leg, settings) if blocks is None else blocks
    surroundings = environment.environment()
    total = sum(len(b.cases) * (1 + rounds(b, settings)) for b in blocks) + 1
    done = 0

    def step(what: str) -> None:
        nonlocal done
        done += 1
        progress(what, min(1.0, done / total))

    results: list[Result] = []
    figures: tuple[Figure, ...] = ()
    with _quiet():
        if fresh:
            progress("fresh processes", 0.0)
            figures = processes.figures(leg, settings)
        for block in blocks:
            results += measure(block, settings, step)
            forget = getattr(block.subject(), "forget", None)
            if forget is not None:
                for rows in {case.rows for case in block.cases}:
                    forget(rows)
    surroundings["load_after"] = environment.load_average()
    return Report(
        leg,
        settings,
        surroundings,
        tuple((b.key, b.title, b.per_row, b.chart) for b in blocks),
        tuple(results),
        figures,
    )
