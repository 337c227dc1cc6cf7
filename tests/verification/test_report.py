from __future__ import annotations

import json
import math
import pickle

import pytest
from rich.console import Console

from leg_dynamics.errors import CrosscheckError
from leg_dynamics.verification import Check, CrosscheckReport

AT = {"alpha": 0.25, "beta": -0.5}


def check(worst, tolerance=1e-9, quantity="torque", detail=""):
    return Check("first against second", quantity, worst, tolerance, 7, AT, detail=detail)


def report(*checks, left_out=0):
    return CrosscheckReport("some [leg]", ("first", "second"), 7, 3, checks, 7, left_out)


def shown(value):
    console = Console(width=140, record=True, file=None, quiet=False, force_terminal=False)
    with console.capture() as capture:
        console.print(value)
    return capture.get()


@pytest.mark.parametrize(
    ("worst", "tolerance", "passed"),
    [
        (0.0, 1e-9, True),
        (1e-9, 1e-9, True),
        (1.1e-9, 1e-9, False),
        (0.0, 0.0, True),
        (math.inf, 0.0, False),
        (math.nan, 1e-9, False),
        (math.inf, 1e-9, False),
    ],
)
def test_a_check_passes_within_its_tolerance(worst, tolerance, passed):
    assert check(worst, tolerance).passed is passed
    assert report(check(0.0), check(worst, tolerance)).passed is passed


def test_a_report_without_checks_has_not_passed():
    assert not report().passed


@pytest.mark.parametrize(
    "bad", [check(math.nan, quantity="bad"), check(math.inf, quantity="bad"), check(math.inf, 0.0, quantity="bad")]
)
def test_the_worst_check_is_the_one_without_a_number(bad):
    assert report(check(1.0), bad, check(2.0)).worst.quantity == "bad"


def test_the_worst_check_is_relative_to_its_tolerance():
    assert report(check(1e-7, 1e-6), check(5e-10, 1e-9, "closest"), check(0.0, 0.0)).worst.quantity == "closest"


def test_rows_are_the_checks():
    one = report(check(1.0), check(2.0))
    assert one.rows == one.checks


@pytest.mark.parametrize("worst", [1e-12, math.nan, math.inf, -math.inf])
def test_json_is_valid_whatever_the_number(worst):
    strange = Check("g", "q", worst, 1e-9, 1, {"alpha": math.nan, "beta": 1.0}, detail="γ = 0")

    def refuse(name):
        raise AssertionError(name)

    data = json.loads(report(check(1e-12), strange, left_out=2).to_json(), parse_constant=refuse)
    assert data["checks"][1]["worst"] == (worst if math.isfinite(worst) else None)
    assert data["checks"][1]["at"] == {"alpha": None, "beta": 1.0}
    assert data["checks"][1]["passed"] is (worst <= 1e-9)
    assert data["checks"][1]["detail"] == "γ = 0"
    assert data["passed"] is (worst <= 1e-9)
    assert (data["leg"], data["routes"], data["left_out"]) == ("some [leg]", ["first", "second"], 2)
    assert (data["samples"], data["seed"]) == (7, 3)


def test_raise_if_failed_names_quantity_error_state_and_reason():
    report(check(0.0)).raise_if_failed()
    failing = report(check(0.0, quantity="fine"), check(2e-3, quantity="mass", detail="a row is singular"))
    with pytest.raises(CrosscheckError) as caught:
        failing.raise_if_failed()
    for words in ("1 of 2", "mass", "0.002", "1e-09", "'alpha': 0.25", "a row is singular"):
        assert words in str(caught.value)
    assert "fine" not in str(caught.value)
    assert pickle.loads(pickle.dumps(caught.value)).checks == [failing.checks[1]]


def test_the_table():
    text = shown(report(check(1e-12, quantity="mass matrix"), check(1e-10, quantity="torque")))
    for words in ("some [leg]", "first and second", "seed 3", "mass matrix", "1.0e-12", "agrees"):
        assert words in text
    assert text.count("first against second") == 1
    assert "DISAGREES" not in text
    assert "alpha" not in text


def test_states_left_out_are_told_apart():
    one = CrosscheckReport("leg", ("first", "second"), 9, 3, (check(0.0),), 4, 2, 3)
    text = shown(one)
    assert "only 4 of the 9 states asked for were found" in text
    assert "2 more states cannot be assembled" in text
    assert "3 more states are nearly singular" in text
    assert one.to_dict()["compared"] == 4
    assert (one.to_dict()["left_out"], one.to_dict()["nearly_singular"]) == (2, 3)
    assert "singular" not in shown(report(check(0.0), left_out=2))


def test_the_table_of_a_failure():
    text = shown(report(check(math.nan, quantity="torque", detail="[red] pose lost"), left_out=5))
    for words in ("DISAGREES", "nan", "alpha = 0.25, beta = -0.5", "[red] pose lost", "5 more states"):
        assert words in text
