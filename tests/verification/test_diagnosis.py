"""Statements that hold exactly are made, and no other: on arrays whose relation is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from leg_dynamics.verification.diagnosis import LEAST_STATES, Entries, agree, diagnose

TOLERANCE = 1e-9
MATRIX = Entries("J[{}, {}]", (("x", "y", "z"), ("a", "b", "c")))
VECTOR = Entries("{}", (("a", "b", "c"),))
SCALAR = Entries("")


def numbers(*shape, seed=1, count=40):
    return np.random.default_rng(seed).normal(size=(count, *shape))


def said(own, reference, entries=MATRIX, **options):
    return diagnose(own, reference, entries, TOLERANCE, **options)


def changed(array, index, value):
    result = array.copy()
    result[(slice(None), *index)] = value
    return result


def test_equal_arrays_have_no_diagnosis():
    reference = numbers(3, 3)
    assert said(reference, reference) == ""
    assert said(reference * (1.0 + 1e-12), reference) == ""


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (-1.0, "every entry is the negative of the reference: a sign error"),
        (2.0, "every entry is twice the reference"),
        (0.5, "every entry is half the reference"),
        (-2.0, "every entry is minus twice the reference"),
        (math.pi / 180.0, "every entry is pi/180 times (degrees for radians) the reference"),
        (180.0 / math.pi, "every entry is 180/pi times (radians for degrees) the reference"),
        (0.001, "every entry is 1/1000 times (metres for millimetres) the reference"),
        (0.0, "every entry is zero"),
        (1.25, "every entry is 1.25 times the reference"),
        (3.0, "every entry is thrice the reference"),
    ],
)
def test_one_factor(factor, text):
    reference = numbers(3, 3)
    assert said(factor * reference, reference, factors={3.0: "thrice"}) == text


def test_a_factor_only_nearly_constant_is_none():
    reference = numbers(3)
    own = -reference
    assert "sign error" in said(own, reference, VECTOR)
    own[7, 1] += 1e-6
    assert said(own, reference, VECTOR).startswith("a, c are the negative")
    assert said(own, reference, VECTOR).endswith("b: no simple relation")


@pytest.mark.parametrize(
    ("index", "text"),
    [
        ((slice(None), 1), "every entry of column b is the negative of the reference: a sign error"),
        ((2,), "every entry of row z is the negative of the reference: a sign error"),
        ((2, 0), "J[z, a] is the negative of the reference: a sign error"),
        ((slice(None), [0, 2]), "every entry of columns a, c is the negative of the reference: a sign error"),
        (([0, 1], [0, 1]), "J[x, a], J[y, b] are the negative of the reference: a sign error"),
    ],
)
def test_where_it_is(index, text):
    reference = numbers(3, 3)
    own = changed(reference, index, -reference[(slice(None), *index)])
    assert said(own, reference) == text


def test_a_column_with_an_entry_that_is_always_zero_is_whole():
    reference = changed(numbers(3, 3), (1, 1), 0.0)
    own = changed(reference, (slice(None), 1), -reference[:, :, 1])
    assert said(own, reference) == "every entry of column b is the negative of the reference: a sign error"


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        ([(0, 0)], "J[x, a] is off by the constant 0.02"),
        ([(0, 0), (1, 1), (2, 2)], "J[x, a], J[y, b], J[z, c] are off by the constant 0.02"),
        ([(0, 0), (1, 0), (2, 0)], "every entry of column a is off by the constant 0.02"),
    ],
)
def test_an_offset_is_not_said_of_entries_that_are_always_zero(entries, text):
    # Zero is no multiple less for a sign error, but it is off by no constant.
    diagonal = numbers(3, 3) * np.eye(3)
    own = diagonal.copy()
    for row, column in entries:
        own[:, row, column] += 0.02
    assert said(own, diagonal) == text
    assert said(changed(diagonal, (0, 0), -diagonal[:, 0, 0]), diagonal) == (
        "every entry of column a is the negative of the reference: a sign error"
    )
    bent = changed(diagonal, (0, 0), diagonal[:, 0, 0] + numbers(seed=5))
    bent[:, 1, 1] *= 2.0
    assert said(bent, diagonal) == "J[x, a]: no simple relation; every entry of column b is twice the reference"


def test_different_errors_in_different_entries():
    reference = numbers(3)
    own = reference * [-1.0, 1.0, 2.0]
    assert said(own, reference, VECTOR) == "a is the negative of the reference: a sign error; c is twice the reference"


def test_transposed_and_exchanged():
    reference = numbers(3, 3)
    assert said(reference.swapaxes(1, 2), reference) == "the matrix is transposed"
    assert said(reference[:, [0, 2, 1]], reference) == "the rows y, z are exchanged"
    assert said(reference[:, :, [1, 0, 2]], reference) == "the columns a, b are exchanged"
    assert said(reference[:, :, [1, 2, 0]], reference) == "the columns a, b, c are in another order"
    assert said(numbers(3)[:, [2, 1, 0]], numbers(3), VECTOR) == "the entries a, c are exchanged"
    names = tuple("abcdef")
    many = numbers(6)
    assert said(many[:, [0, 4, 2, 3, 1, 5]], many, Entries("{}", (names,))) == "the entries b, e are exchanged"
    assert said(many[:, [1, 2, 3, 4, 5, 0]], many, Entries("{}", (names,))) == ""


def test_offset():
    reference = numbers(3)
    assert said(np.add(reference, [0.0, 0.25, 0.0]), reference, VECTOR) == "b is off by the constant 0.25"
    assert said(numbers() + 2.0, numbers(), SCALAR) == "every value is off by the constant 2"
    # Of a constant both an offset and a factor are true: the offset is the plainer one, unless the factor has a name.
    constant = np.full((40, 3), 0.5)
    assert said(np.add(constant, [0.25, 0.0, 0.0]), constant, VECTOR) == "a is off by the constant 0.25"
    assert said(constant * [-1.0, 1.0, 1.0], constant, VECTOR) == "a is the negative of the reference: a sign error"


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (-1.0, "every entry: without the first term"),
        (-2.0, "every entry: wrong sign of the first term"),
        (1.0, "every entry: twice the first term"),
        (-0.5, "every entry: 0.5 times the first term"),
    ],
)
def test_terms(share, text):
    terms = {"the first term": numbers(3, seed=2), "the second term": numbers(3, seed=3)}
    reference = terms["the first term"] + terms["the second term"]
    assert said(reference + share * terms["the first term"], reference, VECTOR, terms=[terms]) == text
    own = reference + share * terms["the first term"] + 1e-6 * numbers(3, seed=4)
    assert said(own, reference, VECTOR, terms=[terms]) == ""


def test_finer_terms_where_coarse_ones_do_not_explain():
    first, second = numbers(3, seed=2), numbers(3, seed=3)
    coarse, fine = {"both": first + second}, {"one": first, "other": second}
    reference = first + second + numbers(3, seed=4)
    assert said(reference - first - second, reference, VECTOR, terms=[coarse, fine]) == "every entry: without both"
    assert said(reference - first, reference, VECTOR, terms=[coarse, fine]) == "every entry: without one"


def test_few_states_and_nan_rows():
    reference = numbers(3)
    few = slice(0, LEAST_STATES - 1)
    assert said(-reference[few], reference[few], VECTOR) == ""
    enough = slice(0, LEAST_STATES)
    assert "sign error" in said(-reference[enough], reference[enough], VECTOR)
    own = -reference
    own[::2] = np.nan
    assert "sign error" in said(own, reference, VECTOR)
    own[LEAST_STATES - 1 :] = np.nan
    assert said(own, reference, VECTOR) == ""


def test_agree():
    reference = numbers(3)
    assert agree(reference, reference, TOLERANCE)
    assert agree(reference + 1e-10, reference, TOLERANCE)
    assert not agree(reference + 1e-8, reference, TOLERANCE)
    assert not agree(reference[: LEAST_STATES - 1], reference[: LEAST_STATES - 1], TOLERANCE)
