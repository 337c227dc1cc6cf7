"""The same cases for pytest-benchmark: `pytest benchmarks --benchmark-only`. `make test` does not collect them.

A case must pass the accuracy gate before it is timed; a peer that does not, or is not there, is skipped and says why.
"""

from __future__ import annotations

import pytest

from benchmarks.blocks import all_blocks
from benchmarks.cases import QUICK, YARDSTICK
from benchmarks.suite import admit

pytestmark = pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
BLOCKS = {block.key: block for block in all_blocks("omnileg", QUICK)}


def _cases():
    for block in BLOCKS.values():
        for case in block.cases:
            # One yardstick a subject is enough here: nothing is interleaved.
            if not case.key.endswith(YARDSTICK) or block.key == "single" or block.key.startswith(("models", "chains")):
                yield pytest.param(block.key, case, id=case.key)


@pytest.mark.parametrize(("block", "case"), list(_cases()))
def test_time(benchmark, block, case):
    verdict, work = admit(case, BLOCKS[block].subject())
    if verdict.status != "ok" and (case.peer or verdict.status == "not available"):
        pytest.skip(f"{verdict.status}: {verdict.reason}")
    assert verdict.status == "ok", verdict.reason
    benchmark.group = block
    benchmark.extra_info.update(title=case.title, rows=case.rows, error=verdict.error)
    turn = iter(range(10**12))

    def once():
        return work.function(*work.arguments[next(turn) % work.period])

    # A fixed argument spares the counter.
    if work.period == 1:
        benchmark(work.function, *work.arguments[0])
    else:
        benchmark(once)
