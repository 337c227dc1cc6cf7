"""Running a study: in this process, in several local ones, or on a Dask cluster; the rows are the same to the bit."""

from __future__ import annotations

import contextlib
import os
import pickle
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from leg_dynamics.analysis.design.result import StageResult, StudyResult
from leg_dynamics.analysis.design.store import Folder
from leg_dynamics.analysis.design.study import Evaluator, Plan, Row, Study
from leg_dynamics.errors import LegDynamicsError, StudyError

__all__ = ["run"]

Progress = Callable[[str, float], None]
PATIENCE = 10.0
"""s, for a Dask scheduler to answer."""

_RETRIES = 5
"""Of a chunk whose Dask worker dies, beyond which the chunk itself is to blame."""


def run(
    study: Study,
    folder: str | Path | None = None,
    *,
    resume: bool = False,
    workers: int | None = 1,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> StudyResult:
    """Run a study, or finish one that was interrupted.

    Parameters
    ----------
    study : Study
    folder : str or Path, optional
        Keeps every finished chunk; without one nothing is kept.
    resume : bool
        Go on with the study in `folder`, which must have the same inputs; start it where there is none.
    workers : int or None
        Processes; None for one a processor. With more than one, a script needs the usual
        ``if __name__ == "__main__":``, since each process imports it.
    scheduler : str, optional
        Address of a running Dask scheduler, such as ``tcp://127.0.0.1:8786``, instead of local processes. Who can
        reach a scheduler can run code in its workers: use one in a network that you trust.
    progress : callable, optional
        Called with a text and a share from 0 to 1.

    Returns
    -------
    StudyResult
        The same, to the bit, for any number of workers, any scheduler and any number of interruptions, on machines of
        one kind.

    Raises
    ------
    StudyError
        The folder holds another study, no design of a stage that others follow is accepted, or the workers fail.
    """
    say = progress or (lambda what, share: None)
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise StudyError(f"workers = {workers!r} must be a whole number, at least 1")
    store = None if folder is None else Folder(Path(folder), study)
    with contextlib.ExitStack() as stack:
        if store is not None:
            stack.enter_context(store.opened(resume))
        plan = Plan.of(study, say)
        if store is not None:
            store.describe(plan)
        compute = stack.enter_context(_executor(plan, workers, scheduler))
        chosen: dict[str, float] = {}
        done: list[StageResult] = []
        total, before = sum(len(stage) for stage in study.stages), 0
        for number, stage in enumerate(study.stages):
            rows = _stage_rows(study, store, number, chosen, compute, say, before, total)
            before += len(stage)
            done.append(StageResult.of(study, number, chosen, rows))
            if not stage.is_sweep:
                pick = done[-1].chosen
                if pick is None and number + 1 < len(study.stages):
                    raise StudyError(
                        f"no design of stage {number + 1} is accepted, so the next stage has nothing to start from: "
                        f"{done[-1].why_none()}"
                    )
                chosen = dict(pick.design) if pick is not None else chosen
        say("done", 1.0)
        return StudyResult(study, plan, tuple(done))


def _stage_rows(
    study: Study,
    store: Folder | None,
    number: int,
    chosen: dict[str, float],
    compute: _Compute,
    say: Progress,
    before: int,
    total: int,
) -> list[Row]:
    chunks = study.chunks(number)
    found: dict[int, list[Row]] = {}
    if store is not None:
        for k in range(len(chunks)):
            rows = store.read(number, k, chosen)
            if rows is not None:
                found[k] = rows
    count = sum(len(rows) for rows in found.values())
    label = f"stage {number + 1} of {len(study.stages)}" if len(study.stages) > 1 else "designs"
    say(label, (before + count) / total)
    missing = [k for k in range(len(chunks)) if k not in found]
    for k, rows in compute(number, chosen, {k: chunks[k] for k in missing}):
        if store is not None:
            store.write(number, k, chosen, rows)
        found[k] = rows
        count += len(rows)
        say(label, (before + count) / total)
    return [row for k in range(len(chunks)) for row in found[k]]


_Compute = Callable[[int, dict[str, float], Mapping[int, range]], Iterator[tuple[int, list[Row]]]]
"""(stage, what earlier stages chose, chunks by number) -> finished chunks in any order."""


@contextlib.contextmanager
def _executor(plan: Plan, workers: int | None, scheduler: str | None) -> Iterator[_Compute]:
    if scheduler is not None:
        with _on_dask(plan, scheduler) as compute:
            yield compute
        return
    count = workers or _processors()
    if count == 1:
        evaluator = Evaluator(plan)

        def here(number: int, chosen: dict[str, float], chunks: Mapping[int, range]) -> Iterator[tuple[int, list[Row]]]:
            for k, rows in chunks.items():
                yield k, evaluator.rows(number, chosen, rows)

        yield here
        return
    with _in_processes(plan, count) as compute:
        yield compute


# Local processes.

_EVALUATORS: dict[str, Evaluator] = {}
"""Of this process, by the study's digest: a worker makes its kernels ready once."""


def _evaluator(digest: str, payload: bytes) -> Evaluator:
    if digest not in _EVALUATORS:
        _EVALUATORS.clear()
        _EVALUATORS[digest] = Evaluator(pickle.loads(payload))
    return _EVALUATORS[digest]


def _compute_chunk(digest: str, payload: bytes, number: int, chosen: dict[str, float], rows: range) -> list[Row]:
    return _evaluator(digest, payload).rows(number, chosen, rows)


def _compute_in_worker(number: int, chosen: dict[str, float], rows: range) -> list[Row]:
    (evaluator,) = _EVALUATORS.values()
    return evaluator.rows(number, chosen, rows)


def _start_worker(digest: str, payload: bytes) -> None:
    _end_with_parent()
    _evaluator(digest, payload)


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever: have it end too."""
    import multiprocessing
    from multiprocessing.connection import wait

    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def _in_processes(plan: Plan, count: int) -> Iterator[_Compute]:
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from concurrent.futures.process import BrokenProcessPool

    # Forking a process with threads, which kernels and progress bars start, can deadlock.
    context = multiprocessing.get_context("spawn")
    arguments = (plan.study.digest(), pickle.dumps(plan))
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_start_worker, initargs=arguments)

    def compute(number: int, chosen: dict[str, float], chunks: Mapping[int, range]) -> Iterator[tuple[int, list[Row]]]:
        try:
            futures = {pool.submit(_compute_in_worker, number, chosen, rows): k for k, rows in chunks.items()}
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenProcessPool:
            raise StudyError(
                'a worker process ended: a script with workers > 1 needs `if __name__ == "__main__":`; else the '
                "machine may be out of memory; finished chunks are kept, resume with fewer workers"
            ) from None

    try:
        yield compute
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _processors() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


# A Dask cluster.


@contextlib.contextmanager
def _on_dask(plan: Plan, scheduler: str) -> Iterator[_Compute]:
    try:
        from distributed import Client, as_completed  # type: ignore[import-not-found,import-untyped,unused-ignore]
    except ImportError:
        raise StudyError(
            "a Dask scheduler needs the package distributed: pip install 'leg-dynamics[dask]', or leave the scheduler "
            "out"
        ) from None
    # A client that does not understand its address is half made, and complains once more when it is thrown away.
    if not re.fullmatch(r"([a-z]+://)?[^\s/:]+:\d+", scheduler):
        raise StudyError(f"a Dask scheduler's address is like tcp://127.0.0.1:8786, got {scheduler!r}")
    digest, payload = plan.study.digest(), pickle.dumps(plan)
    try:
        client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise StudyError(
            f"no Dask scheduler answers at {scheduler!r} ({' '.join(str(error).split())[:200]}): start one, or leave "
            "the scheduler out"
        ) from None

    def compute(number: int, chosen: dict[str, float], chunks: Mapping[int, range]) -> Iterator[tuple[int, list[Row]]]:
        futures: dict[Any, int] = {}
        # The payload travels with each task: data on one worker would be lost with it.
        for k, rows in chunks.items():
            future = client.submit(
                _compute_chunk, digest, payload, number, chosen, rows, pure=False, retries=_RETRIES, key=None
            )
            futures[future] = k
        with client.as_current():
            finished = as_completed(list(futures))
        try:
            for future in finished:
                try:
                    rows = future.result()
                except LegDynamicsError:
                    raise
                except Exception as error:
                    raise StudyError(
                        f"a chunk fails on the cluster: {type(error).__name__}: {' '.join(str(error).split())[:300]}; "
                        "its workers need this package in the same version"
                    ) from error
                yield futures[future], rows
                future.release()
        finally:
            with contextlib.suppress(Exception):  # the cluster may be gone
                client.cancel(list(futures))

    try:
        yield compute
    finally:
        client.close()
