"""What callers get wrong, on legs closed by formulas, by Newton's method from any pose, and by a walk."""

from __future__ import annotations

import copy
import pickle
import re
import threading

import numpy as np
import pytest
from scipy.optimize import least_squares

import leg_dynamics as ld
from leg_dynamics.errors import (
    AssemblyError,
    NonFiniteError,
    RowError,
    ShapeError,
    SingularityError,
)

# One sample alone starts from the last pose, in a batch from home: they agree to the closure's tolerance.
AGREE = 1e-10
HOW = ("explicit", "restarts", "walks")


class Case:
    """A leg, closed states of it and a pose that it cannot have."""

    def __init__(self, lab, text: str, spread: float, rows: int = 19) -> None:
        self.text = text
        self.leg = ld.load(text, route="symbolic")
        model = self.leg.backend.model
        self.how = "walks" if model.walks else "restarts" if model.restarts else "explicit"
        self.n, self.m = len(self.leg.joint_names), len(self.leg.actuator_names)
        self.home = model.seed[: self.n]
        self.unreachable = out_of_reach(lab.oracle.Oracle(text, self.leg.joint_names))
        generator = np.random.default_rng(5)
        self.q = self.home + spread * model.unit[: self.n] * generator.uniform(-1.0, 1.0, (rows, self.n))
        self.v, self.a = generator.uniform(-2.0, 2.0, (2, rows, self.n))
        self.force, self.gravity = generator.uniform(-9.0, 9.0, (2, rows, 3))

    @property
    def arguments(self) -> dict[str, np.ndarray]:
        return {"q": self.q, "v": self.v, "a": self.a, "foot_force": self.force, "gravity": self.gravity}

    def fresh(self):
        """The same leg without anything compiled or remembered in it."""
        return ld.load(self.text, route="symbolic")


def out_of_reach(oracle) -> np.ndarray:
    """Independent coordinates at which no start of the other joints comes near to closing the loops."""
    generator = np.random.default_rng(8)

    def gap(z: np.ndarray, y: np.ndarray) -> np.ndarray:
        q = oracle.home.copy()
        q[oracle.y], q[oracle.z] = y, z
        return oracle.rows(q)[0]

    for _ in range(40):
        y = oracle.home[oracle.y] + generator.uniform(-3.0, 3.0, len(oracle.y))
        starts = oracle.home[oracle.z] + generator.uniform(-3.0, 3.0, (8, len(oracle.z)))
        if min(least_squares(gap, z, args=(y,)).cost for z in starts) > 1e-4:
            return y
    raise AssertionError("this mechanism reaches everything")


@pytest.fixture(scope="module")
def cases(lab):
    make, block = lab.mechanisms.Plan, lab.mechanisms.Block
    rocker = make(1, "turned", (block("plane", "spherical"),), "none", "narrow", True, "solid", "last")
    five_bar = make(4, "turned", (block("plane", "revolute", 1),), "none", "wide", True, "solid", "last")
    ball = make(1, "turned", (block("space", "spherical"),), "none", "narrow", True, "solid", "last")
    made = [lab.mechanisms.build(plan) for plan in (rocker, ball, five_bar)]
    texts = [re.sub(f'"{each.foot}"', '"foot"', each.text) for each in made]
    return {
        "explicit": Case(lab, texts[0], 0.2),
        "restarts": Case(lab, texts[1], 0.2),
        "walks": Case(lab, texts[2], 0.1),
    }


@pytest.fixture(params=HOW)
def case(request, cases):
    return cases[request.param]


def close(found, wanted, tolerance=AGREE):
    found, wanted = np.asarray(found), np.asarray(wanted)
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max(initial=0.0) <= tolerance * (1.0 + np.abs(wanted).max(initial=0.0))


def test_the_cases_are_what_they_are_named(cases):
    assert {name: case.how for name, case in cases.items()} == {name: name for name in HOW}


# ---------------------------------------------------------------------------------------------- values


@pytest.mark.parametrize("name", ["q", "v", "a", "foot_force", "gravity"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_number_that_is_not_finite(case, name, value):
    good = case.leg.torque(**case.arguments)
    arguments = case.arguments
    arguments[name] = arguments[name].copy()
    arguments[name][3, -1] = value
    with pytest.raises(NonFiniteError, match=name) as caught:
        case.leg.torque(**arguments)
    assert caught.value.rows.tolist() == [3]
    left = case.leg.torque(**arguments, on_error="nan")
    assert np.isnan(left[3]).all()
    close(np.delete(left, 3, axis=0), np.delete(good, 3, axis=0), 1e-13)
    with pytest.raises(NonFiniteError, match=name):
        case.leg.torque(**{key: array[3] for key, array in arguments.items()})
    assert np.isnan(case.leg.torque(**{key: array[3] for key, array in arguments.items()}, on_error="nan")).all()
    # What a thread remembers of its last pose is none of that.
    close(case.leg.torque(**{key: array[4] for key, array in case.arguments.items()}), good[4])


@pytest.mark.parametrize(
    "value",
    [
        "0.1",
        None,
        True,
        1.0,
        1j,
        b"1",
        {},
        [[0.1], [0.1, 0.2]],
        [None],
        ["0.1"],
        [np.datetime64("2024-01-01")],
        np.array([object()]),
        np.array([0.1], dtype=object),
        np.array([0.1 + 0j]),
        np.array([True]),
        np.array(["0.1"]),
        np.array([(1.0,)], dtype=[("x", float)]),
        lambda: 0.1,
    ],
    ids=lambda value: type(value).__name__ + str(getattr(value, "dtype", "")),
)
@pytest.mark.parametrize("on_error", ["raise", "nan"])
def test_what_is_no_array_of_numbers(cases, value, on_error):
    case = cases["explicit"]
    good = np.full(case.n, 0.1)
    for name in ("q", "v", "a"):
        arguments = {"q": good, "v": good, "a": good} | {name: value}
        with pytest.raises(ShapeError, match=rf"^{name} "):
            case.leg.torque(**arguments, on_error=on_error)
    for method in ("foot_position", "jacobian", "mass_matrix", "assemble", "gravity_torque"):
        with pytest.raises(ShapeError, match=r"^q "):
            getattr(case.leg, method)(value, on_error=on_error)


def test_wrong_shapes(case):
    leg, n = case.leg, case.n
    q = case.q
    for shape in ((n + 1,), (3, n + 1), (0,), (3, 0), (n, 0), (), (2, 3, n + 2)):
        for position in range(3):
            arguments = [q[0], q[0], q[0]]
            arguments[position] = np.zeros(shape)
            with pytest.raises(ShapeError, match="last axis holds one sample"):
                leg.torque(*arguments)
    for shape in ((2,), (4,), (3, 1), (1,), ()):
        for name in ("foot_force", "gravity"):
            with pytest.raises(ShapeError, match=name):
                leg.torque(q[0], q[0], q[0], **{name: np.zeros(shape)})
    with pytest.raises(ShapeError, match="broadcast"):
        leg.torque(q[:3], q[:4], q[:1])
    with pytest.raises(ShapeError, match="broadcast"):
        leg.bias(q[:3], q[:3], np.zeros((2, 3)))


@pytest.mark.parametrize("leading", [(0,), (2, 0), (0, 3), (1, 0, 2)])
def test_empty_batches(case, leading):
    n, m = case.n, case.m
    q = np.zeros((*leading, n))
    one = case.q[0]
    leg = case.leg
    for v in (q, one, np.zeros((1, n))):
        assert leg.torque(q, v, q).shape == (*leading, m)
        assert leg.torque(q, v, one, np.zeros(3), np.zeros((*leading, 3))).shape == (*leading, m)
        assert leg.torque(one, v, q, on_error="nan").shape == (*leading, m)
    assert leg.foot_position(q).shape == (*leading, 3)
    assert leg.jacobian(q).shape == (*leading, 3, n)
    assert leg.mass_matrix(q).shape == (*leading, n, n)
    assert {found.shape for found in leg.assemble(q).values()} == {leading}
    out = np.zeros((*leading, m))
    assert leg.torque(q, q, q, out=out) is out


# ---------------------------------------------------------------------------------------------- memory


def laid_out(array: np.ndarray) -> dict[str, np.ndarray]:
    """The same numbers in other places and orders of the memory."""
    rows, width = array.shape
    wide = np.full((2 * rows, 3 * width), np.nan)
    wide[::2, ::3] = array
    backwards = array[::-1, ::-1].copy()[::-1, ::-1]
    packed = np.zeros(rows, dtype=np.dtype([("mark", "i1"), ("x", "f8", (width,))]))
    packed["x"] = array
    frozen = array.copy()
    frozen.setflags(write=False)
    return {
        "fortran": np.asfortranarray(array),
        "holes": wide[::2, ::3],
        "reversed": backwards,
        "unaligned": packed["x"],
        "big endian": array.astype(">f8"),
        "read-only": frozen,
        "subclass": array.view(np.recarray),
        "list": array.tolist(),
        "longdouble": array.astype(np.longdouble),
        "masked, nothing hidden": np.ma.masked_array(array),
    }


def test_layouts_in_memory(case):
    wanted = case.leg.torque(**case.arguments)
    laid = {name: laid_out(array) for name, array in case.arguments.items()}
    for layout in laid["q"]:
        found = case.leg.torque(**{name: each[layout] for name, each in laid.items()})
        assert type(found) is np.ndarray
        close(found, wanted, 1e-13)
        single = {name: each[layout][2] for name, each in laid.items()}
        close(case.leg.torque(**single), wanted[2])


def test_broadcast_strides(case):
    q = np.broadcast_to(case.q[2], (7, case.n))
    assert q.strides[0] == 0
    one = case.leg.torque(case.q[2:3], case.v[2:3], case.a[2:3])
    close(case.leg.torque(q, case.v[2], case.a[2:3]), np.repeat(one, 7, axis=0), 1e-13)
    grid = case.leg.torque(case.q[:4, None], case.v[:3], case.a[0])
    for i in range(4):
        for j in range(3):
            close(grid[i, j], case.leg.torque(case.q[i], case.v[j], case.a[0]))
    # A window that slides over one line of memory.
    line = np.ascontiguousarray(np.resize(case.home, case.n + 4))
    windows = np.lib.stride_tricks.sliding_window_view(line, case.n)
    wanted = case.leg.torque(windows.copy(), windows.copy(), windows.copy(), on_error="nan")
    found = case.leg.torque(windows, windows, windows, on_error="nan")
    assert np.array_equal(found, wanted, equal_nan=True)


@pytest.mark.parametrize("kind", ["f4", "f2", "i8", "i1", "u2"])
def test_other_kinds_of_numbers(case, kind):
    number = np.dtype(kind)
    if number.kind == "f":
        arguments = {name: array.astype(number) for name, array in case.arguments.items()}
    else:
        # Whole numbers are far apart: only rates and loads of them.
        arguments = {name: np.abs(array).astype(number) for name, array in case.arguments.items()}
        arguments["q"] = case.q
    wanted = case.leg.torque(**{name: array.astype(float) for name, array in arguments.items()})
    found = case.leg.torque(**arguments)
    assert found.dtype == np.float64
    close(found, wanted, 1e-13)


def test_out_may_share_memory_with_the_arguments(case):
    wanted = case.leg.torque(case.q, case.v, case.a)
    assert wanted.shape == case.a.shape
    for name in ("q", "v", "a"):
        arguments = {"q": case.q.copy(), "v": case.v.copy(), "a": case.a.copy()}
        out = arguments[name]
        assert case.leg.torque(**arguments, out=out) is out
        assert np.array_equal(out, wanted)
        arguments = {"q": case.q.copy(), "v": case.v.copy(), "a": case.a.copy()}
        out = arguments[name][::-1]
        case.leg.torque(**arguments, out=out)
        assert np.array_equal(out, wanted)
        memory = np.concatenate([case.a[:1], arguments[name]])
        memory[1:] = {"q": case.q, "v": case.v, "a": case.a}[name]
        arguments = {"q": case.q, "v": case.v, "a": case.a} | {name: memory[1:]}
        case.leg.torque(**arguments, out=memory[:-1])
        assert np.array_equal(memory[:-1], wanted)
        sample = case.q[1].copy(), case.v[1].copy(), case.a[1].copy()
        single = case.leg.torque(*sample)
        place = sample["qva".index(name)]
        close(case.leg.torque(*sample, out=place), single)


def test_out_that_does_not_fit(case):
    rows = len(case.q)
    frozen = np.zeros((rows, case.m))
    frozen.setflags(write=False)
    shapes = [(rows - 1, case.m), (rows, case.m + 1), (rows * case.m,), (1, rows, case.m)]
    for out in (*map(np.zeros, shapes), np.zeros((rows, case.m), "f4"), frozen, [[0.0]], "out", 1.0):
        with pytest.raises(ShapeError, match=r"^out must"):
            case.leg.torque(case.q, case.v, case.a, out=out)
    wide = np.full((rows, 2 * case.m), 7.0)
    case.leg.torque(case.q, case.v, case.a, out=wide[:, ::2])
    close(wide[:, ::2], case.leg.torque(case.q, case.v, case.a), 1e-13)
    assert (wide[:, 1::2] == 7.0).all()


# ---------------------------------------------------------------------------------------------- poses


@pytest.mark.parametrize("method", ["assemble", "foot_position", "jacobian", "mass_matrix", "torque", "acceleration"])
def test_a_pose_out_of_reach_fails_its_row_only(case, method):
    q = case.q.copy()
    further = [q[:, : case.m], q[:, : case.m]] if method in ("torque", "acceleration") else []
    good = getattr(case.leg, method)(q, *further)
    q[5] = case.unreachable
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        getattr(case.leg, method)(q, *further)
    assert caught.value.rows.tolist() == caught.value.all_rows.tolist() == [5]
    assert re.search(r"row 5\b", str(caught.value)), str(caught.value)
    left = getattr(case.leg, method)(q, *further, on_error="nan")
    if method == "assemble":
        good, left = (np.stack(list(each.values()), axis=-1) for each in (good, left))
    assert np.isnan(left[5]).all()
    close(np.delete(left, 5, axis=0), np.delete(good, 5, axis=0), 1e-13)


def test_single_samples_around_one_out_of_reach(case):
    wanted = case.leg.torque(case.q, case.v, case.a)
    for row in range(4):
        with pytest.raises((AssemblyError, SingularityError)) as caught:
            case.leg.torque(case.unreachable, case.v[0], case.a[0])
        assert caught.value.rows.tolist() == [0]
        close(case.leg.torque(case.q[row], case.v[row], case.a[row]), wanted[row])
        assert np.isnan(case.leg.torque(case.unreachable, case.v[0], case.a[0], on_error="nan")).all()


def test_several_reasons_in_one_batch(case):
    q, v = case.q.reshape(1, -1, case.n).copy(), case.v.reshape(1, -1, case.n).copy()
    q[0, 2, 0], v[0, 4, -1] = np.nan, np.inf
    q[0, 7] = case.unreachable
    with pytest.raises(NonFiniteError) as caught:
        case.leg.bias(q, v)
    assert caught.value.all_rows.tolist() == [2, 4]
    left = case.leg.bias(q, v, on_error="nan")
    assert np.flatnonzero(np.isnan(left).any(axis=-1)).tolist() == [2, 4, 7]
    assert np.flatnonzero(np.isnan(left).all(axis=-1)).tolist() == [2, 4, 7]


def test_every_row_out_of_reach(case):
    q = np.repeat(case.unreachable[None], 4, axis=0)
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        case.leg.torque(q, q, q)
    assert caught.value.rows.tolist() == [0, 1, 2, 3]
    assert np.isnan(case.leg.torque(q, q, q, on_error="nan")).all()


@pytest.mark.parametrize("angle", [1e3, 1e6, -1e9, 1e15, 1e100, 1e300])
def test_huge_coordinates_are_refused_or_right(case, angle):
    q = case.home + angle
    foot = case.leg.foot_position(q, on_error="nan")
    if np.isnan(foot).all():
        with pytest.raises(RowError) as caught:
            case.leg.foot_position(q)
        assert caught.value.rows.tolist() == [0]
        return
    assert abs(angle) < 1e9
    close(foot, case.leg.foot_position(case.home + np.remainder(angle, 2.0 * np.pi)), abs(angle) * 1e-14)


def test_huge_angles_of_joints_that_go_round(lab):
    leg = ld.load(lab.gears(), route="symbolic")
    oracle = lab.oracle.Oracle(lab.gears(), leg.joint_names, foot="foot")
    # Products with the ratios are exact, so that all that is huge are sines' and cosines' arguments.
    for angle in (1e3, -1e5, 1e6, 2.0**30, -(2.0**40)):
        q = oracle._newton(oracle.home) * 0.0
        q[oracle.index["driver"]] = angle
        q[oracle.index["driven"]] = -2.5 * angle
        q[oracle.index["rack"]] = 0.05 * angle + 0.03
        y, one = np.array([angle]), np.array([1.0])
        assert leg.assemble(y) == {name: q[k] for k, name in enumerate(oracle.names)}
        close(leg.jacobian(y), oracle.foot_jacobian(q), 1e-12)
        close(leg.torque(y, one, one), oracle.generalized_force(q, one, one), 1e-12)


def test_huge_rates_overflow_by_name(case):
    v = np.full(case.n, 1e200)
    with pytest.raises(NonFiniteError, match="too large"):
        case.leg.torque(case.q[0], v, v)
    rows = np.repeat(case.v[:1], 3, axis=0)
    rows[1] = 1e200
    left = case.leg.torque(case.q[:3], rows, rows, on_error="nan")
    assert np.isnan(left).all(axis=1).tolist() == [False, True, False]


# ---------------------------------------------------------------------------------------------- copies and threads


def test_pickled_and_copied_legs(case):
    wanted = case.leg.torque(case.q, case.v, case.a)
    case.leg.torque(case.q[3], case.v[3], case.a[3])
    for clone in (pickle.loads(pickle.dumps(case.leg)), copy.copy(case.leg), copy.deepcopy(case.leg)):
        assert clone.route == "symbolic"
        assert clone.joint_names == case.leg.joint_names
        # Its first call takes the careful way, whose kernel has the loads as inputs.
        close(clone.torque(case.q, case.v, case.a), wanted, 1e-12)
        with pytest.raises((AssemblyError, SingularityError)):
            clone.torque(case.unreachable, case.v[0], case.a[0])


def test_an_error_crosses_processes(case):
    q = case.q.copy()
    q[5] = case.unreachable
    with pytest.raises(RowError) as caught:
        case.leg.torque(q, q, q)
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is type(caught.value)
    assert str(again) == str(caught.value)
    assert again.rows.tolist() == [5]


def test_threads_that_mix_good_poses_bad_ones_and_batches(case):
    wanted = case.leg.torque(case.q, case.v, case.a)
    # Nobody has made a kernel of it before: all threads ask for the first one.
    leg = case.fresh()
    start = threading.Barrier(6)
    wrong: list[str] = []

    def work(number: int) -> None:
        generator = np.random.default_rng(number)
        start.wait()
        try:
            for turn in range(40):
                row = int(generator.integers(len(case.q)))
                what = (number + turn) % 4
                if what == 0:
                    found = leg.torque(case.q, case.v, case.a)
                    error = np.abs(found - wanted).max()
                elif what == 1:
                    found = leg.torque(case.unreachable, case.v[0], case.a[0], on_error="nan")
                    error = 0.0 if np.isnan(found).all() else np.inf
                else:
                    found = leg.torque(case.q[row], case.v[row], case.a[row])
                    error = np.abs(found - wanted[row]).max()
                if not error <= AGREE * (1.0 + np.abs(wanted).max()):
                    wrong.append(f"thread {number}, turn {turn}: {error}")
        except Exception as error:
            wrong.append(f"thread {number}: {error!r}")

    threads = [threading.Thread(target=work, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_large_batches_on_two_threads_with_one_bad_row(case):
    count = 40_000
    rows = np.resize(np.arange(len(case.q)), count)
    leg = ld.load(case.text, route="symbolic", threads=2)
    wanted = case.leg.torque(case.q, case.v, case.a)[rows]
    q, v, a = case.q[rows], case.v[rows], case.a[rows]
    out = a.copy()[::-1]
    leg.torque(q, v, out[::-1], out=out)
    close(out, wanted, 1e-13)
    q[31_234] = case.unreachable
    with pytest.raises((AssemblyError, SingularityError), match=r"row 31234\b") as caught:
        leg.torque(q, v, a)
    assert caught.value.rows.tolist() == [31_234]
    left = leg.torque(q, v, a, on_error="nan")
    assert np.flatnonzero(np.isnan(left).any(axis=1)).tolist() == [31_234]
    close(np.delete(left, 31_234, axis=0), np.delete(wanted, 31_234, axis=0), 1e-13)


# ---------------------------------------------------------------------------------------------- derivatives


def test_derivatives_of_bad_rows(cases):
    case = cases["explicit"]
    leg, q = case.leg, case.q[:4].copy()
    good = leg.torque_derivatives(q, q, q)
    q[1, 0] = np.nan
    q[2] = case.unreachable
    with pytest.raises(NonFiniteError):
        leg.torque_derivatives(q, q, q)
    left = leg.torque_derivatives(q, q, q, on_error="nan")
    for found, wanted in zip(left[:3], good[:3], strict=True):
        assert np.isnan(found[1:3]).all()
        close(found[[0, 3]], wanted[[0, 3]], 1e-13)
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        leg.torque_derivatives(q[2:], q[3:], q[3:])
    assert caught.value.rows.tolist() == [0]
    assert leg.torque_derivatives(q[:0], q[:0], q[:0]).q.shape == (0, case.m, case.n)
