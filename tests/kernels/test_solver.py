"""Newton's method with continuation inside a kernel."""

from __future__ import annotations

import math

import casadi
import numpy as np
import pytest
from scipy import optimize

from leg_dynamics.kernels import Solver
from leg_dynamics.kernels.virtual_machine import VirtualMachine


def symbols(*sizes):
    return [casadi.SX.sym(f"v{number}", size) for number, size in enumerate(sizes)]


def kepler_solver(weight=0.3, length=2.0, **options):
    """z + weight sin z = s y from z = 0; one stage for every `length` of y; y = 13 asks for NaN stages."""
    y, s, z = symbols(1, 1, 1)
    error = z + weight * casadi.sin(z) - s * y
    stages = casadi.if_else(y == 13, casadi.sqrt(y - 14), casadi.fabs(y) / length)
    return Solver(
        1,
        casadi.Function("start", [y], [0 * y]),
        casadi.Function("stages", [y], [stages]),
        casadi.Function("step", [y, s, z], [error / (1 + weight * casadi.cos(z)), casadi.fabs(error)]),
        **{"tolerance": 1e-9, **options},
    )


def kepler_root(y, weight=0.3):
    return optimize.brentq(lambda z: z + weight * math.sin(z) - y, -1e3, 1e3, xtol=1e-15, rtol=1e-15)


BARS = (2.0, 0.98, 1.55, 1.5)
"""Ground, crank, coupler and rocker."""


def four_bar_error(crank, z):
    ground, a, b, c = BARS
    return (
        a * casadi.cos(crank) + b * casadi.cos(z[0]) - ground - c * casadi.cos(z[1]),
        a * casadi.sin(crank) + b * casadi.sin(z[0]) - c * casadi.sin(z[1]),
    )


FOUR_BAR_SEED = optimize.fsolve(lambda z: [float(e) for e in four_bar_error(0.3, z)], [1.0, 2.0], xtol=1e-12)


def four_bar_solver(step_length=0.4):
    """Coupler and rocker of a crank angle, followed from 0.3 rad."""
    q, s, z = symbols(1, 1, 2)
    error = casadi.vertcat(*four_bar_error(0.3 + s * (q - 0.3), z))
    jacobian = casadi.jacobian(error, z)
    determinant = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
    step = casadi.vertcat(
        (jacobian[1, 1] * error[0] - jacobian[0, 1] * error[1]) / determinant,
        (jacobian[0, 0] * error[1] - jacobian[1, 0] * error[0]) / determinant,
    )
    return Solver(
        2,
        casadi.Function("start", [q], [casadi.SX(FOUR_BAR_SEED)]),
        casadi.Function("stages", [q], [casadi.fabs(q - 0.3) / step_length]),
        casadi.Function("step", [q, s, z], [step, casadi.norm_1(error)]),
        tolerance=1e-9,
    )


@pytest.fixture
def kepler(lab):
    return lambda **options: lab.program([()], lambda y, z: z, solver=kepler_solver(**options))


@pytest.fixture
def solved(lab):
    return lambda **options: lab.compiled([()], lambda y, z: z, solver=kepler_solver(**options))


@pytest.fixture
def four_bar(lab):
    return lambda **options: lab.program([()], lambda q, z: [z, casadi.sin(q) + z[1]], [(2,), ()], **options)


def virtual_machine(program):
    return VirtualMachine(program, memoryview(bytearray(8)).cast("q"))


def test_one_unknown(level, solved):
    y = np.linspace(-40.0, 40.0, 101)
    kernel = solved()
    np.testing.assert_allclose(kernel(y, threads=1), [kepler_root(value) for value in y], rtol=1e-14, atol=1e-14)
    assert kernel.counter[0] == 0


def test_two_unknowns_follow_one_assembly_mode_round_the_circle(lab, level, four_bar):
    q = np.linspace(0.3, 0.3 + 4 * math.pi, 201)
    kernel = lab.compiled([()], lambda q, z: [z, casadi.sin(q) + z[1]], [(2,), ()], solver=four_bar_solver())
    z, derived = kernel(q, threads=1)
    expected = [FOUR_BAR_SEED]
    for value in q[1:]:
        expected.append(
            optimize.fsolve(lambda z, q=value: [float(e) for e in four_bar_error(q, z)], expected[-1], xtol=1e-12)
        )
    np.testing.assert_allclose(z, expected, rtol=1e-11)
    np.testing.assert_allclose(derived, np.sin(q) + np.array(expected)[:, 1], rtol=1e-11)
    assert kernel.counter[0] == 0


def test_continuation_finds_what_newton_alone_does_not(lab, level):
    y = np.linspace(-9.0, 9.0, 60)
    expected = [kepler_root(value, 0.97) for value in y]
    alone, followed = (
        lab.compiled([()], lambda y, z: z, solver=kepler_solver(0.97, length))(y) for length in (1e9, 0.05)
    )
    np.testing.assert_allclose(followed, expected, rtol=1e-12)
    assert np.isnan(alone).any()


def mixed_rows():
    """Rows of 1 to 25 stages, and rows that fail in several ways."""
    y = np.random.default_rng(0).uniform(-50.0, 50.0, 67)
    y[[3, 17, 18, 40, 66]] = [13.0, np.nan, np.inf, 13.0, -np.inf]
    return y


def test_every_row_is_on_its_own(lab, level, width, solved):
    """Neither the number of stages nor the failures of other rows change a bit."""
    kernel = solved()
    y = mixed_rows()
    alone = np.array([kernel(value) for value in y])
    assert np.flatnonzero(np.isnan(alone)).tolist() == [3, 17, 18, 40, 66]
    lab.assert_same_bits(kernel(y, threads=1), alone)
    lab.assert_same_bits(kernel(y, threads=3), alone)
    for seed in range(20):
        order = np.random.default_rng(seed).permutation(len(y))
        lab.assert_same_bits(kernel(y[order], threads=1), alone[order])
    for count in range(1, 2 * width + 2):
        lab.assert_same_bits(kernel(y[:count], threads=1), alone[:count])


def test_rows_that_do_not_converge_fail_and_are_counted(level, solved):
    kernel = solved(iterations=2)
    y = np.array([0.0, 1e-3, 40.0, 0.5, -40.0, 1e-4])
    found = kernel(y, threads=1)
    assert np.isnan(found).tolist() == [False, False, True, True, True, False]
    assert kernel.counter[0] == 3
    np.testing.assert_allclose(found[[1, 5]], y[[1, 5]] / 1.3, rtol=1e-6)


def test_nan_stages_fail_the_row(level, solved):
    kernel = solved()
    assert np.isnan(kernel(np.array([13.0, 12.0, 13.0, 1.0]), threads=1)).tolist() == [True, False, True, False]
    assert kernel.counter[0] == 2


def test_stages_are_limited_on_both_sides(lab, level):
    """What the last stage solves is what was asked for, however many stages are wanted."""
    y, s, z = symbols(1, 1, 1)
    # the unknown counts the stages: each adds s + 1, whatever happened before
    stage = casadi.Function("step", [y, s, z], [-(s + 1) / 2, casadi.SX(0)])
    start = casadi.Function("start", [y], [0 * y])

    def visited(wanted, **options):
        stages = casadi.Function("stages", [y], [casadi.SX(y)])
        solver = Solver(1, start, stages, stage, 1.0, **options)
        return lab.compiled([()], lambda y, z: z, solver=solver)(np.array(wanted), threads=1)

    def sums(numbers):
        return [sum(0.5 * (1 + k / n) for k in range(1, n + 1)) for n in numbers]

    counts = [1, 1, 1, 1, 2, 2, 3, 7, 64, 64, 64, 64, 1]
    wanted = [0.0, -5.0, 0.5, 1.0, 1.0001, 2.0, 2.5, 7.0, 64.0, 64.5, 1e9, 1e308, -1e308]
    np.testing.assert_allclose(visited(wanted), sums(counts), rtol=1e-13)
    np.testing.assert_allclose(visited(wanted, most_stages=3), sums(np.clip(counts, 1, 3)), rtol=1e-13)


def test_after_the_tolerance_is_met_one_more_step_is_made(lab, level):
    y, s, z = symbols(1, 1, 1)
    solver = Solver(
        1,
        casadi.Function("start", [y], [y]),
        casadi.Function("stages", [y], [casadi.SX(1)]),
        casadi.Function("step", [y, s, z], [z / 2, casadi.fabs(z)]),
        tolerance=1.0,
        iterations=4,
    )
    kernel = lab.compiled([()], lambda y, z: z, solver=solver)
    # halved until at most 1, then once more; 4 looks at most
    np.testing.assert_array_equal(kernel(np.array([1.0, 2.0, 8.0, 8.01, 0.5])), [0.5, 0.5, 0.5, np.nan, 0.25])


@pytest.mark.parametrize("where", ["start", "step", "residual"])
def test_a_nan_anywhere_fails_the_row_only(lab, level, where):
    y, s, z = symbols(1, 1, 2)
    nan = casadi.if_else(y < 0, casadi.sqrt(-1 - casadi.fabs(y)), 0)
    start = casadi.vertcat(y, nan if where == "start" else 0)
    step = casadi.vertcat(z[0] / 2, nan if where == "step" else 0)
    # CasADi's maximum of a number and a NaN is the number: a residual may not see what is wrong
    residual = casadi.fmax(casadi.fabs(z[0]), casadi.fabs(z[1])) + (nan if where == "residual" else 0)
    solver = Solver(
        2,
        casadi.Function("start", [y], [start]),
        casadi.Function("stages", [y], [casadi.SX(3)]),
        casadi.Function("step", [y, s, z], [step, residual]),
        tolerance=1e-3,
        iterations=50,
    )
    rows = np.array([1.0, -1.0, 2.0, -2.0, 3.0, 4.0, 5.0, 6.0, 7.0, -8.0, 9.0])
    program = lab.program([()], lambda y, z: 1 + y, solver=solver)
    kernel = lab.compiled([()], lambda y, z: 1 + y, solver=solver)
    for found in (kernel(rows, threads=1), virtual_machine(program)(rows)):
        np.testing.assert_array_equal(found, np.where(rows < 0, np.nan, 1 + rows))
    assert kernel.counter[0] == 3


def test_a_residual_of_zero_tolerance_and_an_infinite_one(lab, level):
    y, s, z = symbols(1, 1, 1)

    def kernel(residual, tolerance):
        solver = Solver(
            1,
            casadi.Function("start", [y], [0 * y]),
            casadi.Function("stages", [y], [casadi.SX(1)]),
            casadi.Function("step", [y, s, z], [z - y, residual]),
            tolerance=tolerance,
        )
        return lab.compiled([()], lambda y, z: z, solver=solver)

    assert kernel(casadi.fabs(z - y), 0.0)(np.array([3.0, 4.0])).tolist() == [3.0, 4.0]
    assert np.isnan(kernel(1 / (z - z), 1e300)(np.array([3.0, 4.0]))).all()


def test_guards_and_outputs_take_the_unknowns(lab, level):
    kernel = lab.compiled(
        [()], lambda y, z: [z, 1 / (z - z * (y > 5))], [(), ()], solver=kepler_solver(), guards=lambda y, z: 3 - z
    )
    found = kernel(np.array([1.0, 2.0, 6.0, 2.5, 4.0, 3.5]), threads=1)
    assert np.isnan(found[0]).tolist() == [False, False, True, False, True, True]
    assert np.isnan(found[1]).tolist() == [False, False, True, False, True, True]


def test_it_agrees_with_the_virtual_machine(lab, level, kepler, solved, four_bar):
    for options in ({}, {"iterations": 3}, {"most_stages": 4, "iterations": 4}, {"tolerance": 1e-3}):
        y = mixed_rows()
        program, kernel = kepler(**options), solved(**options)
        slow = virtual_machine(program)(y)
        np.testing.assert_allclose(kernel(y, threads=1), slow, rtol=1e-14)
    q = np.random.default_rng(1).uniform(-9.0, 9.0, 200)
    program = four_bar(solver=four_bar_solver())
    kernel = lab.compiled([()], lambda q, z: [z, casadi.sin(q) + z[1]], [(2,), ()], solver=four_bar_solver())
    for fast, slow in zip(kernel(q), virtual_machine(program)(q), strict=True):
        np.testing.assert_allclose(fast, slow, rtol=1e-12, atol=1e-13)


def test_many_unknowns_and_wide_inputs(lab, level, width):
    """A linear system whose solution is known: one step finds it, whatever the sizes."""
    size = 21
    matrix = np.random.default_rng(2).normal(size=(size, size)) + 6 * np.eye(size)
    inverse = np.linalg.inv(matrix)
    y, s, z = symbols(size, 1, size)
    error = casadi.DM(matrix) @ z - s * y
    solver = Solver(
        size,
        casadi.Function("start", [y], [y]),
        casadi.Function("stages", [y], [casadi.fabs(y[0]) * 3]),
        casadi.Function("step", [y, s, z], [casadi.DM(inverse) @ error, casadi.norm_1(error)]),
        tolerance=1e-8,
    )
    kernel = lab.compiled([(size,)], lambda y, z: [z, y - z], [(size,), (size,)], solver=solver)
    rows = np.random.default_rng(3).normal(size=(3 * width + 1, size))
    z, difference = kernel(rows, threads=1)
    np.testing.assert_allclose(z, rows @ inverse.T, rtol=1e-11, atol=1e-12)
    lab.assert_same_bits(difference, rows - z)
