"""Threads, the way from a program to a kernel, and what serves where nothing can be compiled."""

from __future__ import annotations

import copy
import os
import pickle
import sys
import textwrap
import threading
import tracemalloc

import casadi
import numpy as np
import pytest

from leg_dynamics.errors import ShapeError
from leg_dynamics.kernels import compile_program, kernel
from leg_dynamics.kernels.cache import FOLDER_VARIABLE, key_of

kernel_module = sys.modules["leg_dynamics.kernels.kernel"]


def wave(x, y):
    angle = casadi.atan2(casadi.sin(x[0]) + y, casadi.cos(x[1]))
    return [casadi.vertcat(angle, casadi.sqrt(x[0]), angle * x[1]), angle - y]


@pytest.fixture
def waves(lab):
    return lab.compiled([(2,), ()], wave, [(3,), ()], name="waves")


def inputs(shape, failing=True):
    generator = np.random.default_rng(0)
    x = generator.uniform(0.1, 3.0, (*shape, 2))
    if failing:
        x.reshape(-1, 2)[::5, 0] = -1.0
    return x, generator.normal(size=shape)


@pytest.mark.parametrize("threads", [1, 2, 3, 7, 100, None])
@pytest.mark.parametrize("shape", [(1,), (5,), (1000,), (100_003,), (2, 40_000), (3, 1, 700), (0,), (0, 5)], ids=str)
def test_results_do_not_depend_on_threads(lab, waves, shape, threads):
    x, y = inputs(shape)
    expected = waves.ufunc(x, y)
    before = waves.counter[0]
    found = waves(x, y, threads=threads)
    out = np.zeros((*shape, 3)), np.zeros(shape)
    assert waves(x, y, out=out, threads=threads)[0] is out[0]
    for result, place, reference in zip(found, out, expected, strict=True):
        lab.assert_same_bits(result, reference)
        lab.assert_same_bits(place, reference)
    assert waves.counter[0] - before == 2 * int(np.isnan(expected[1]).sum())


@pytest.mark.parametrize("threads", [2, 5])
def test_broadcast_inputs_under_threads(lab, waves, threads):
    x, y = inputs((6, 50))
    for first, second in (
        (x, y[0]),
        (x, y[:, :1]),
        (x[0], y),
        (x[:1], y),
        (x[0, 0], y),
        (x, 0.5),
        (x[:, :1], y[:1]),
        (np.broadcast_to(x[0, 0], (6, 50, 2)), y[3:4]),
    ):
        for result, expected in zip(waves(first, second, threads=threads), waves.ufunc(first, second), strict=True):
            lab.assert_same_bits(result, expected)


@pytest.mark.parametrize("shape", [(64,), (2, 64), (64, 2), (1, 64), (1, 64, 1)], ids=str)
def test_threads_share_the_rows_along_the_longest_axis(monkeypatch, waves, shape):
    pieces = []
    original = waves.ufunc
    together = threading.Barrier(4)

    def recorded(*arrays, out):
        together.wait(60.0)
        pieces.append((threading.get_ident(), out[1].shape))
        return original(*arrays, out=out)

    monkeypatch.setattr(waves, "ufunc", recorded)
    waves(*inputs(shape), threads=4)
    longest = shape.index(64)
    assert [piece[longest] for _, piece in pieces] == [16] * 4
    assert len({thread for thread, _ in pieces}) == 4


def test_large_batches_are_cut_into_more_pieces_than_threads(monkeypatch, waves):
    pieces = []
    original = waves.ufunc

    def recorded(*arrays, out):
        pieces.append(len(out[1]))
        return original(*arrays, out=out)

    monkeypatch.setattr(waves, "ufunc", recorded)
    waves(*inputs((100_000,)), threads=2)
    assert len(pieces) == 6
    assert sum(pieces) == 100_000
    assert max(pieces) - min(pieces) <= 1


def test_small_batches_stay_on_one_thread(monkeypatch, waves):
    called = []
    monkeypatch.setattr(kernel_module, "_in_threads", lambda *arguments: called.append(arguments[-1]))
    monkeypatch.setattr(kernel_module, "_processors", lambda: 4)
    for count, parts in ((1, None), (65_535, None), (65_536, 2), (140_000, 4)):
        called.clear()
        waves(*inputs((count,)))
        assert called == ([] if parts is None else [parts])
    called.clear()
    waves(*inputs((1, 70_000)))
    assert called == [2]


@pytest.mark.parametrize("threads", [0, -1, 1.5, 2.0, "2", float("nan"), float("inf"), [2]], ids=repr)
def test_a_number_of_threads_that_is_none_is_refused(waves, threads):
    with pytest.raises(ShapeError, match="threads must be a positive whole number, got"):
        waves(*inputs((10,)), threads=threads)


def test_numpy_integers_are_numbers_of_threads(lab, waves):
    x, y = inputs((10,))
    lab.assert_same_bits(waves(x, y, threads=np.int64(2))[0], waves(x, y, threads=1)[0])


def test_an_error_in_a_thread_reaches_the_caller(waves):
    x, y = inputs((64,))
    with pytest.raises(ValueError, match="mismatch"):
        waves(np.repeat(x, 2, axis=1), y, threads=4)


@pytest.mark.parametrize("threads", [1, 2])
def test_memory_beyond_inputs_and_outputs(waves, threads):
    rows = 1_000_000
    x, y = inputs((rows,), failing=False)
    out = np.empty((rows, 3)), np.empty(rows)
    waves(x, y, out=out, threads=threads)
    tracemalloc.start()
    waves(x, y, out=out, threads=threads)
    peak = tracemalloc.get_traced_memory()[1]
    waves(x, y, threads=threads)
    with_results = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100_000
    assert with_results < 100_000 + 4 * 8 * rows


def test_several_outputs_come_back_without_out(lab):
    """NumPy itself refuses ``out=None`` where there are several."""
    first, second = lab.compiled([()], lambda x: [x + 1, x + 2], [(), ()])(np.zeros(3))
    assert (first.tolist(), second.tolist()) == ([1.0] * 3, [2.0] * 3)


def test_a_kernel_cannot_be_pickled_or_copied(waves):
    for attempt in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(TypeError, match=r"waves.* is machine code of this process"):
            attempt(waves)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_loaded_kernel_works_after_a_fork(lab, tmp_path):
    code = f"""
    import os, sys
    sys.path.insert(0, {os.path.dirname(__file__)!r})
    import numpy as np
    from conftest import compiled
    kernel = compiled([()], lambda x: 2 * x)
    kernel(np.ones(3))
    child = os.fork()
    if child == 0:
        another = compiled([()], lambda x: 3 * x)
        good = kernel(np.ones(5)).tolist() == [2.0] * 5 and another(1.0) == 3.0 and kernel(np.nan) != kernel(np.nan)
        os._exit(0 if good and kernel.counter[0] == 2 else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert kernel.counter[0] == 0
    """
    result = lab.python(textwrap.dedent(code), **{FOLDER_VARIABLE: str(tmp_path)})
    assert result.returncode == 0, result.stderr


def test_many_threads_may_ask_for_kernels_at_once(lab, tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    programs = [lab.program([()], lambda x, n=n: casadi.sin(x) * n + n, name=f"n{n}") for n in range(3)]
    results, errors = [], []
    barrier = threading.Barrier(6)

    def ask(number):
        try:
            barrier.wait()
            results.append((number, compile_program(programs[number])(np.zeros(9)).tolist()))
        except Exception as error:
            errors.append(error)

    threads = [threading.Thread(target=ask, args=(k % 3,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors
    assert sorted(results) == sorted((k % 3, [float(k % 3)] * 9) for k in range(6))
    assert len(list(tmp_path.iterdir())) == 3


# ---------------------------------------------------------------------- from the cache


@pytest.fixture
def folder(tmp_path, monkeypatch):
    place = tmp_path / "cache"
    monkeypatch.setenv(FOLDER_VARIABLE, str(place))
    return place


def entries(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_kernel_is_built_once(lab, folder, level):
    built = []

    def build():
        built.append(True)
        return lab.program([(3,)], casadi.sin, [(3,)], name="sine")

    first = kernel("sine", key_of("recipe"), build)
    second = kernel("sine", key_of("recipe"), build)
    assert len(built) == 1
    assert len(entries(folder)) == 1
    assert (second.name, second.inputs, second.outputs) == (first.name, first.inputs, first.outputs)
    x = np.random.default_rng(0).normal(size=(5, 3))
    lab.assert_same_bits(first(x), second(x))
    # failures are counted by each for itself
    first(np.full((2, 3), np.nan))
    assert (first.counter[0], second.counter[0]) == (2, 0)


def test_the_key_has_everything_that_went_in(lab, folder, monkeypatch):
    def ask(name="name", recipe="recipe"):
        kernel(name, key_of(recipe), lambda: lab.program([()], lambda x: 2 * x, name=name))
        return len(entries(folder))

    assert [ask(), ask(), ask(name="other"), ask(recipe="other")] == [1, 1, 2, 3]
    monkeypatch.setattr(kernel_module.cache, "source_fingerprint", lambda package: "changed")
    assert [ask(), ask()] == [4, 4]
    monkeypatch.setattr(kernel_module, "_versions", lambda: "llvmlite 99")
    assert [ask(), ask()] == [5, 5]


def test_levels_do_not_share_entries(lab, folder, monkeypatch):
    from leg_dynamics.kernels.target import LEVEL_VARIABLE, LEVELS, host_target

    host = host_target()
    if not host.is_x86:
        pytest.skip("one level only")
    available = LEVELS[LEVELS.index(host.level) : -1]
    for number, level in enumerate(available, start=1):
        monkeypatch.setenv(LEVEL_VARIABLE, level)
        assert lab.compiled([()], lambda x: x + 1)(1.0) == 2.0
        assert len(entries(folder)) == number


def test_programs_that_differ_in_names_only_keep_their_names(lab, folder):
    one = lab.compiled([()], lambda x: x + 1, name="one")
    two = lab.compiled([()], lambda x: x + 1, name="two")
    assert (one.name, two.name) == ("one", "two")
    assert len(entries(folder)) == 2


DAMAGES = {
    "empty": lambda data: b"",
    "truncated": lambda data: data[: len(data) // 2],
    "header only": lambda data: data[:20],
    "magic only": lambda data: data[:15],
    "one bit": lambda data: data[:-100] + bytes([data[-100] ^ 1]) + data[-99:],
    "one bit of the digest": lambda data: data[:20] + bytes([data[20] ^ 1]) + data[21:],
    "longer": lambda data: data + b"\0",
    "zeros": lambda data: bytes(len(data)),
    "other format": lambda data: b"leg_dynamics 0" + data[14:],
    "text": lambda data: b"not a kernel",
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_entry_is_made_again(lab, folder, damage):
    program = lab.program([()], lambda x: casadi.cos(x) * 3)
    compile_program(program)
    (entry,) = folder.iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(damage(whole))
    assert compile_program(program)(np.zeros(2)).tolist() == [3.0, 3.0]
    assert entry.read_bytes() == whole
    assert entries(folder) == [entry.name]


def test_without_a_cache_kernels_are_compiled_each_time(lab, monkeypatch, tmp_path):
    monkeypatch.setenv(FOLDER_VARIABLE, "")
    monkeypatch.chdir(tmp_path)
    built = []

    def build():
        built.append(True)
        return lab.program([()], lambda x: x - 1)

    assert kernel("minus", "recipe", build)(3.0) == kernel("minus", "recipe", build)(3.0) == 2.0
    assert len(built) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("place", ["below a file", "proc", "a file", "an entry is a folder"])
def test_a_folder_that_cannot_be_written_is_no_error(lab, tmp_path, monkeypatch, place):
    file = tmp_path / "file"
    file.write_text("text")
    folder = {"below a file": file / "cache", "proc": "/proc/leg_dynamics", "a file": file}.get(place, tmp_path / "x")
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
    if place == "an entry is a folder":
        monkeypatch.setattr(kernel_module.cache, "key_of", lambda *parts: "ab" * 32)
        (tmp_path / "x" / ("ab" * 32)).mkdir(parents=True, mode=0o700)
        (tmp_path / "x").chmod(0o700)
    for _ in range(2):
        assert lab.compiled([()], lambda x: x + 7)(1.0) == 8.0
    assert file.read_text() == "text"


@pytest.mark.slow
def test_processes_that_compile_at_once_agree(lab, tmp_path):
    import subprocess

    folder = tmp_path / "cache"
    code = f"""
    import sys
    sys.path.insert(0, {os.path.dirname(__file__)!r})
    import casadi
    from conftest import compiled
    for n in (0, 1, int(sys.argv[1]) + 2):
        kernel = compiled([()], lambda x: casadi.sin(x) + n, name="shared")
        assert kernel(0.0) == n, kernel(0.0)
    """
    processes = [
        subprocess.Popen(
            [sys.executable, "-W", "error", "-c", textwrap.dedent(code), str(number)],
            env={**os.environ, FOLDER_VARIABLE: str(folder)},
            stderr=subprocess.PIPE,
            text=True,
        )
        for number in range(8)
    ]
    for process in processes:
        _, text = process.communicate(timeout=120)
        assert process.returncode == 0, text
    assert len(entries(folder)) == 10
    assert all(len(name) == 64 for name in entries(folder))


# ---------------------------------------------------------------------- without LLVM


def test_without_llvmlite_the_virtual_machine_serves_with_one_warning(lab, tmp_path):
    code = f"""
    import sys, warnings
    sys.modules["llvmlite"] = None
    sys.path.insert(0, {os.path.dirname(__file__)!r})
    import casadi, numpy as np
    from conftest import program
    from leg_dynamics.errors import LegDynamicsWarning
    from leg_dynamics.kernels import compile_program, kernel, llvm_is_available
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        both = program([(2,), ()], lambda x, y: [casadi.sin(x) * y, casadi.atan2(x[0], y)], [(2,), ()])
        first = compile_program(both)
        second = kernel("two", "recipe", lambda: program([()], casadi.sqrt))
        assert not llvm_is_available()
    assert [warning.category for warning in caught] == [LegDynamicsWarning], caught
    assert "llvmlite" in str(caught[0].message)
    assert first.backend == second.backend == "casadi"
    x, y = np.array([[0.3, 1.2], [2.0, np.nan], [5.0, 6.0]]), np.array([1.0, 2.0, 3.0])
    for threads in (1, 2, None):
        a, b = first(x, y, threads=threads)
        good = [0, 2]
        np.testing.assert_allclose(a[good], (np.sin(x) * y[:, None])[good], rtol=1e-15)
        np.testing.assert_allclose(b[good], np.arctan2(x[:, 0], y)[good], rtol=1e-15)
        assert np.isnan(a[1]).all() and np.isnan(b[1])
    assert first.counter[0] == 3
    assert np.isnan(second(np.array([4.0, -1.0]))).tolist() == [False, True]
    assert repr(second) == "<Kernel example ()->() by casadi>"
    """
    result = lab.python(textwrap.dedent(code), **{FOLDER_VARIABLE: str(tmp_path / "cache")})
    assert result.returncode == 0, result.stderr
    assert not (tmp_path / "cache").exists()


def test_importing_the_room_loads_neither_casadi_nor_llvm(lab):
    code = "import sys, leg_dynamics.kernels; print(sorted({'casadi', 'llvmlite', 'platformdirs'} & set(sys.modules)))"
    assert lab.python(code).stdout.strip() == "[]"


def test_a_kernel_from_the_cache_needs_no_casadi(lab, folder):
    kernel("plus", "recipe", lambda: lab.program([()], lambda x: x + 1))
    code = """
    import sys
    from leg_dynamics.kernels import kernel
    assert kernel("plus", "recipe", None)(1.0) == 2.0
    assert "casadi" not in sys.modules
    """
    result = lab.python(textwrap.dedent(code), **{FOLDER_VARIABLE: str(folder)})
    assert result.returncode == 0, result.stderr
