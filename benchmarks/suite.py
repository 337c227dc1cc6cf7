"""One run: prepare each case, pass it through the gate, time what passed, all in one process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from benchmarks import environment, gate
from benchmarks.cases import FULL, YARDSTICK, Case, Settings, Work, Workload, all_cases
from benchmarks.report import Report, Result
from benchmarks.timing import Runner, interleave

Progress = Callable[[str, int, int], None]


def _silent(what: str, done: int, total: int) -> None:
    pass


def admit(case: Case, workload: Workload) -> tuple[gate.Verdict, Work | None]:
    """Prepare a case and check its answers."""
    try:
        work = case.prepare(workload)
    except Exception as problem:
        return gate.Verdict("cannot run", None, gate.explain(problem)), None
    return gate.check(work), work


def run(
    leg: str,
    settings: Settings = FULL,
    cases: Sequence[Case] | None = None,
    progress: Progress = _silent,
) -> Report:
    """Measure a leg.

    Parameters
    ----------
    leg : str
        One of `available_legs`.
    settings : Settings
    cases : sequence of Case, optional
        All of them where None. Without a correct yardstick there are times but no ratios.
    progress : callable, optional
        Called with (what is being done, steps done, steps in all).
    """
    cases = all_cases(settings) if cases is None else cases
    surroundings = environment.environment()
    total = len(cases) * (1 + settings.repetitions)
    done = 0

    def step(what: str) -> None:
        nonlocal done
        done += 1
        progress(what, done, total)

    workload = Workload(leg, settings)
    verdicts: dict[str, gate.Verdict] = {}
    runners: dict[str, Runner] = {}
    for case in cases:
        verdict, work = admit(case, workload)
        verdicts[case.key] = verdict
        if verdict.status == "ok" and work is not None:
            runners[case.key] = Runner(work)
        step(f"checking {case.key}")

    def still_right(key: str, result: Any, index: int) -> bool:
        """A case with a memory may lose its way while it is timed."""
        work = runners[key].work
        error = gate.relative_error(work.answer(result, index), work.expected[index])
        verdict = gate.judge(error, f"at state {index} while it was timed")
        if verdict.status != "ok":
            verdicts[key] = verdict
        return verdict.status == "ok"

    def broke(key: str, problem: Exception) -> None:
        verdicts[key] = gate.Verdict("cannot run", None, f"{gate.explain(problem)} (while it was timed)")

    interleave(runners, settings, still_right, broke, lambda: step("timing"))
    surroundings["load_after"] = environment.load_average()
    yardstick = runners[YARDSTICK].samples if YARDSTICK in runners else None
    results = []
    for case in cases:
        verdict = verdicts[case.key]
        runner = runners.get(case.key)
        samples = tuple(runner.samples) if runner is not None else ()
        ratios = ()
        if samples and yardstick:
            ratios = tuple(own / case.rows / one for own, one in zip(samples, yardstick, strict=True))
        results.append(
            Result(
                key=case.key,
                group=case.group,
                title=case.title,
                rows=case.rows,
                peer=case.peer,
                goal=case.goal,
                status=verdict.status,
                error=verdict.error,
                reason=verdict.reason,
                calls=runner.loops if samples and runner is not None else 0,
                samples=samples,
                ratios=ratios,
            )
        )
    return Report(leg, settings, surroundings, tuple(results))
