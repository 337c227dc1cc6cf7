"""Order and bookkeeping of the interleaved run, on a clock of its own: nothing here depends on speed."""

from __future__ import annotations

import gc

import pytest

from benchmarks.cases import Work
from benchmarks.timing import LEAD_IN, Runner, interleave


def ticking(clock, cost, seen, count=5, period=5):
    def function(number):
        clock.now += cost
        seen.append(number)
        return number

    return Runner(Work(function, [(i,) for i in range(count)], list(range(count)), period=period))


def test_walks_through_the_arguments_and_wraps_around(clock):
    seen = []
    runner = ticking(clock, 10, seen)
    elapsed, result, index = runner.once(4)
    assert elapsed == 4 * 10
    assert (result, index) == ((LEAD_IN + 3) % 5,) * 2
    runner.once(4)
    assert seen == [i % 5 for i in range(2 * (4 + LEAD_IN))]


def test_fixed_case_repeats_its_first_argument(clock):
    seen = []
    ticking(clock, 10, seen, period=1).once(7)
    assert set(seen) == {0}


@pytest.mark.parametrize("cost", [1, 130, 10_000, 2_000_000])
def test_calibration_reaches_the_minimum_without_excess(clock, cost):
    runner = ticking(clock, cost, [])
    runner.calibrate(1_000_000)
    assert runner.loops * cost >= 1_000_000
    assert runner.loops * cost <= max(1_300_000, 2 * cost)


def test_garbage_collection_is_off_while_timing_and_restored(clock):
    states = []
    work = Work(lambda: states.append(gc.isenabled()), [()], [None], period=1)
    for enabled in (True, False):
        (gc.enable if enabled else gc.disable)()
        try:
            Runner(work).once(1)
            assert gc.isenabled() is enabled
        finally:
            gc.enable()
    assert states == [False, False]


def test_garbage_collection_is_restored_after_an_error(clock):
    with pytest.raises(ZeroDivisionError):
        Runner(Work(lambda: 1 // 0, [()], [0], period=1)).once(1)
    assert gc.isenabled()


def test_every_repetition_visits_every_case_in_another_order(clock):
    order = []
    runners = {}
    for name in "abc":
        runner = ticking(clock, 100, [])
        runner.once = lambda loops, name=name, once=runner.once: (order.append(name), once(loops))[1]
        runners[name] = runner
    interleave(runners, 1, 3, lambda *_: True, None, lambda: None)
    assert "".join(order[-9:]) == "abcbcacab"
    assert all(len(runner.samples) == 3 for runner in runners.values())


def test_a_case_that_goes_wrong_is_dropped(clock):
    runners = {name: ticking(clock, 100, []) for name in ("good", "lost", "broken")}
    runners["late"] = Runner(Work(lambda: 1 // 0, [()], [0], period=1))
    calls = iter(range(100))

    def function(number):
        clock.now += 100
        if next(calls) > 4:
            raise ArithmeticError("lost the pose")
        return number

    runners["broken"] = Runner(Work(function, [(0,)], [0], period=1))
    heard = {}
    interleave(
        runners,
        1,
        9,
        lambda key, result, index: key != "lost",
        lambda key, problem: heard.update({key: problem}),
        lambda: None,
    )
    assert set(runners) == {"good"}
    assert {key: type(problem) for key, problem in heard.items()} == {
        "late": ZeroDivisionError,
        "broken": ArithmeticError,
    }
