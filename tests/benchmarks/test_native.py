"""The C kernels give the route's torques: a limit that computes something else would be no limit."""

from __future__ import annotations

import numpy as np
import pytest

import leg_dynamics as ld
from benchmarks import native
from benchmarks.cases import NotAvailableError
from benchmarks.gate import relative_error

try:
    native.compiler()
except NotAvailableError as absent:
    REASON = str(absent)
else:
    REASON = ""
needs_compiler = pytest.mark.skipif(bool(REASON), reason=REASON)


@pytest.fixture(scope="module")
def leg():
    return ld.load("omnileg", route="closed_form", threads=1)


def states(leg, count, seed=0):
    generator = np.random.default_rng(seed)
    lower, upper = leg.limits.lower, leg.limits.upper
    q = generator.uniform(lower, upper, (count, 3))
    # A leg that is nearly straight, and quite.
    q[: count // 4, 2] = 10.0 ** generator.uniform(-12.0, -1.0, count // 4)
    q[:1] = 0.0
    return q, generator.uniform(-5.0, 5.0, q.shape), generator.uniform(-50.0, 50.0, q.shape)


@needs_compiler
@pytest.mark.parametrize("symbol", ["torque", "torque_by_row"])
def test_the_limit_is_the_route_to_1e_12(leg, symbol):
    q, v, a = states(leg, 5000)
    assert relative_error(native.limit(leg, symbol)(q, v, a), leg.torque(q, v, a)) <= 1e-12


@needs_compiler
def test_the_generated_code_is_the_route_to_1e_12(leg):
    q, v, a = states(leg, 2000)
    assert relative_error(native.generated(leg)(q, v, a), leg.torque(q, v, a)) <= 1e-12


@needs_compiler
def test_every_length_of_a_tail(leg):
    kernel = native.limit(leg)
    q, v, a = states(leg, 40)
    whole = kernel(q, v, a)
    for count in range(1, 40):
        out = np.full((count + 1, 3), 7.0)
        kernel(q[:count], v[:count], a[:count], out)
        # A tail is a full vector with rows to spare: the same operations, and nothing beyond the end is written.
        np.testing.assert_allclose(out[:count], whole[:count], rtol=1e-13, atol=1e-15)
        assert (out[count] == 7.0).all()


@needs_compiler
def test_all_turns_of_the_angles(leg):
    kernel = native.limit(leg)
    q, v, a = states(leg, 500)
    turns = 2.0 * np.pi * np.random.default_rng(1).integers(-1000, 1000, q.shape)
    # The angle itself is rounded: 1e4 rad have 2e-12 of it.
    assert relative_error(kernel(q + turns, v, a), leg.torque(q + turns, v, a)) <= 1e-12


@needs_compiler
def test_two_threads_give_the_same(leg):
    kernel = native.limit(leg)
    q, v, a = states(leg, 1001)
    out = np.empty_like(q)
    assert relative_error(kernel.threaded(2)(q, v, a, out), kernel(q, v, a)) <= 1e-13


def test_a_leg_with_other_parameters_has_no_limit(leg):
    class Numbers:
        dissipation = ()
        transmission = "exact"
        L1 = 0.15

    class Module:
        @staticmethod
        def composite_parameters(numbers):
            parameters = leg.backend.module.composite_parameters(leg.backend.numbers)
            return parameters._replace(rods_1_xy=1e-9)

    class Backend:
        numbers, module = Numbers, Module

    class Other:
        name = "omnileg"
        gravity = leg.gravity
        backend = Backend

    with pytest.raises(NotAvailableError, match="rods_1_xy"):
        native.limit_numbers(Other)
    Other.name = "mantis"
    with pytest.raises(NotAvailableError, match="mantis"):
        native.limit_numbers(Other)


def test_without_a_compiler_the_reason_is_named(monkeypatch):
    monkeypatch.setattr(native.shutil, "which", lambda name: None)
    native.compiler.cache_clear()
    try:
        with pytest.raises(NotAvailableError, match="GCC"):
            native.compiler()
        native.compiler_version.cache_clear()
        assert native.compiler_version() is None
    finally:
        native.compiler.cache_clear()
        native.compiler_version.cache_clear()


@needs_compiler
def test_what_the_compiler_refuses_is_not_available():
    with pytest.raises(NotAvailableError, match="refuses"):
        native.build({"bad.c": "int main( {"}, "bad.c")
