"""Calls among methods, as they happen."""

from __future__ import annotations

import sys

import pytest

from leg_dynamics.verification.calls import names_that_failed, observed


class Formulas:
    constant = 5

    def inner(self, x):
        if x < 0:
            raise ValueError("negative")
        return 2 * x

    def outer(self, x):
        return self.inner(x) + 1

    def unused(self, x):
        return self.inner(x) if x > 100 else 0

    def wrong(self, x):
        return 1 + self.constant(x)

    def no_argument(self):
        return 0

    def wrongly(self, x):
        return 1 + self.no_argument(x) + self.inner(x)


def methods(own, *names):
    return {getattr(type(own), name).__code__: name for name in names}


def watched(call, own=None):
    told = []
    codes = methods(own or Formulas(), "inner", "outer", "unused")
    try:
        result = observed(call, codes, lambda name, value: told.append((name, value)))
    except ValueError as error:
        result = error
    return result, told


def test_calls_are_told_from_the_inside_out():
    own = Formulas()
    assert watched(lambda: own.outer(3)) == (7, [("inner", 6), ("outer", 7)])
    assert watched(lambda: own.unused(3)) == (0, [("unused", 0)])
    error, told = watched(lambda: own.outer(-1))
    assert str(error) == "negative"
    assert told == [("inner", None), ("outer", None)]


def test_a_profiler_that_was_there_comes_back():
    seen = []

    def profiler(frame, event, value):
        seen.append(event)

    sys.setprofile(profiler)
    try:
        assert watched(lambda: Formulas().outer(3))[0] == 7
        assert sys.getprofile() is profiler
    finally:
        sys.setprofile(None)


def test_names_of_the_expression_that_failed():
    own = Formulas()
    for name, expected in (("wrong", {"constant"}), ("wrongly", {"no_argument"})):
        with pytest.raises(TypeError) as caught:
            getattr(own, name)(1)
        names = names_that_failed(caught.value.__traceback__)
        assert expected <= names
        if sys.version_info >= (3, 11):
            assert "inner" not in names
    assert names_that_failed(None) == frozenset()


def test_the_line_where_positions_are_not_known(monkeypatch):
    monkeypatch.setattr("leg_dynamics.verification.calls._span", lambda instruction: None)
    with pytest.raises(TypeError) as caught:
        Formulas().wrong(1)
    assert "constant" in names_that_failed(caught.value.__traceback__)
    assert "inner" not in names_that_failed(caught.value.__traceback__)
