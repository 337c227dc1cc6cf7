from __future__ import annotations

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import render, shipped_urdf
from leg_dynamics.errors import (
    AssemblyError,
    FormulaAssumptionError,
    LegNotFoundError,
    ParameterError,
    ShapeError,
    SingularityError,
)
from leg_dynamics.verification.crosscheck import crosscheck, crosscheck_legs
from leg_dynamics.verification.states import domain, sample_states

MODULE = importlib.import_module("leg_dynamics.verification.crosscheck")
EVERY = ("closed_form", "pinocchio", "symbolic")


@pytest.fixture
def short_swing(monkeypatch):
    monkeypatch.setattr(MODULE, "SECONDS", 0.05)


def quantities(report, group=""):
    return [check.quantity for check in report.checks if group in check.group]


def failing(report):
    return {(check.group, check.quantity) for check in report.checks if not check.passed}


def test_the_omnileg():
    """The main promise, at 500 states with the shipped and with random inertias."""
    told = []
    report = crosscheck("omnileg", samples=500, seed=1, progress=lambda what, share: told.append((what, share)))
    report.raise_if_failed()
    assert report.passed
    assert (report.leg, report.routes, report.samples, report.seed, report.left_out) == ("omnileg", EVERY, 500, 1, 0)
    for group in ("closed_form against pinocchio", "closed_form against pinocchio, random inertias"):
        checks = [check for check in report.checks if check.group == group]
        assert len(checks) >= 7
        assert {check.samples for check in checks} == {500}
        assert max(check.worst for check in checks) < 1e-10
    assert "joint angles that close the loops" in quantities(report)
    for route in EVERY:
        assert "energy of a 5 s free swing" in quantities(report, f"{route}: first principles")
    assert report.worst.worst <= report.worst.tolerance
    json.loads(report.to_json())
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)


@pytest.mark.slow
def test_the_omnileg_at_ten_thousand_states():
    crosscheck("omnileg", samples=10_000, seed=2).raise_if_failed()


def test_the_seed_makes_the_report(pendulum):
    first, again, other = (crosscheck(pendulum(), samples=40, seed=seed).to_dict() for seed in (4, 4, 5))
    assert [check["at"] for check in first["checks"]] == [check["at"] for check in again["checks"]]
    assert [check["at"] for check in first["checks"]] != [check["at"] for check in other["checks"]]


@pytest.mark.parametrize("samples", [1, 9])
def test_few_samples(short_swing, samples):
    report = crosscheck("omnileg", samples=samples)
    assert report.passed
    assert report.checks[0].samples == samples


@pytest.mark.parametrize("samples", [0, -1, 1.5, "10", None, True])
def test_samples_is_a_positive_whole_number(samples):
    with pytest.raises(ShapeError, match="samples"):
        crosscheck("omnileg", samples=samples)


# What can be checked.


@pytest.mark.parametrize("route", EVERY)
def test_a_loaded_leg_is_held_against_its_sibling(short_swing, route):
    leg = ld.load("omnileg", route, parameters={"L1": 0.2})
    report = crosscheck(leg, samples=5)
    assert report.passed
    assert report.routes == EVERY
    with pytest.raises(ParameterError, match="foot"):
        crosscheck(leg, foot="foot")


def test_load_options(short_swing, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(MODULE, "load", lambda *a, **k: seen.append(ld.load(*a, **k)) or seen[-1])
    assert crosscheck("omnileg", samples=5, parameters={"L1": 0.2}).routes == EVERY
    path = tmp_path / "mine.urdf"
    path.write_text(render("omnileg", {"L1": 0.18}))
    report = crosscheck("omnileg", samples=5, urdf=path)
    assert report.passed
    assert report.routes == EVERY
    heights = [leg.foot_position(np.zeros(3))[2] for leg in seen]
    np.testing.assert_allclose(heights, [0.55, 0.53], atol=1e-12)
    assert crosscheck("omnileg", samples=5, foot="knee", route="pinocchio").routes == ("pinocchio", "symbolic")


@pytest.mark.parametrize("kind", [str, Path])
def test_a_path_has_no_formulas(short_swing, kind):
    report = crosscheck(kind(shipped_urdf("omnileg")), samples=5)
    assert report.passed
    assert report.routes == ("pinocchio", "symbolic")
    assert report.leg == str(shipped_urdf("omnileg"))
    assert not any("closed_form" in check.group for check in report.checks)


def test_what_cannot_be_loaded(tmp_path):
    with pytest.raises(LegNotFoundError):
        crosscheck("omnlieg")
    path = tmp_path / "skew.urdf"
    path.write_text(shipped_urdf("omnileg").read_text().replace('"0 0 0.15"', '"0 0 0.16"', 1))
    with pytest.raises(FormulaAssumptionError):
        crosscheck("omnileg", urdf=path)


def test_a_foreign_mechanism_without_foot(pendulum):
    report = crosscheck(pendulum(0.02, 0.01), samples=40)
    assert report.passed
    assert report.leg == "pendulum"
    assert "energy of a 5 s free swing" in quantities(report)


def test_states_that_cannot_be_assembled_are_left_out_and_counted(four_bar):
    report = crosscheck(four_bar, samples=200)
    report.raise_if_failed()
    # The box is +-2 rad, the crank goes to +-acos(-1/4).
    assert 4 <= report.left_out <= 40
    assert report.compared == 200
    assert {check.samples for check in report.checks if "against" in check.group} == {200}
    swing = next(check for check in report.checks if check.quantity.startswith("energy of a"))
    assert swing.quantity.startswith("energy of a 1.")
    assert "ended early" in swing.detail
    assert json.loads(report.to_json())["left_out"] == report.left_out


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_states_next_to_a_singular_closure_are_left_out_and_counted(short_swing, rhombus, seed):
    report = crosscheck(rhombus(), samples=100, seed=seed)
    report.raise_if_failed()
    # Some 15 % are within 0.1 rad of zero, half of them, as the box's other side, in another mode.
    assert report.left_out > 10
    assert 1 <= report.nearly_singular <= 20
    assert json.loads(report.to_json())["nearly_singular"] == report.nearly_singular
    assert f"{report.nearly_singular} more states are nearly singular" in table_text(report)
    check = report.checks[-1]
    assert check.quantity == "left out as nearly singular"
    assert 0.0 < check.worst <= report.nearly_singular / (100 + report.nearly_singular)
    assert abs(check.at["turning"]) < 0.1
    compared = [check.samples for check in report.checks if check.group == "pinocchio against symbolic"]
    assert set(compared) == {100}


@pytest.mark.filterwarnings("ignore:.*beyond its upper limit")
def test_too_many_nearly_singular_states_are_a_failure(short_swing, rhombus):
    report = crosscheck(rhombus(1e-3, 0.07), samples=60)
    assert not report.passed
    assert {quantity for _, quantity in failing(report)} == {"left out as nearly singular"}
    assert 0.25 < report.checks[-1].worst < 1.0


@pytest.mark.filterwarnings("ignore:.*beyond its upper limit")
def test_no_state_but_nearly_singular_ones(rhombus):
    with pytest.raises(SingularityError, match=r"all \d+ of 200 states.*nearly singular"):
        crosscheck(rhombus(1e-6, 1e-3), samples=10)


def test_without_the_rule_these_states_would_disagree(short_swing, rhombus, monkeypatch):
    monkeypatch.setattr(MODULE, "nearly_singular", lambda leg, states: np.zeros(len(states), dtype=bool))
    assert any("pinocchio" in group for group, _ in failing(crosscheck(rhombus(), samples=100)))


def test_the_swing_starts_away_from_singular_poses(rhombus):
    leg = ld.load(rhombus(-2.0, 2.0))
    states = sample_states(domain(leg), 60, 0)
    usable = np.isfinite(leg.mass_matrix(states.q, on_error="nan")[:, 0, 0])
    states = states.take(np.flatnonzero(usable))
    regularity = MODULE._regularity([leg], states)
    np.testing.assert_allclose(np.median(regularity(states.q)), 1.0)
    # The aim is at 0.8 rad, in this mode; seen from the other mode it is beyond the singular pose.
    start, speed = MODULE._swing_start(leg, states, regularity)
    assert (start[0], speed[0]) == (pytest.approx(0.8), 1.0)
    start, speed = MODULE._swing_start(leg, states, lambda q: np.where(q[:, 0] < 1.0, 0.01, regularity(q)))
    assert start in states.q
    assert regularity(start[None])[0] >= 1.0
    assert (start[0] > 1.0, speed[0]) == (True, 1.0)


def test_a_leg_that_can_be_assembled_nowhere(four_bar, plant):
    def refuse(result, q, failures):
        failures.add(np.arange(len(np.atleast_2d(q))), AssemblyError("torn", margin=-1.0))
        return result * np.nan

    with pytest.raises(AssemblyError, match=r"no route can assemble 'four_bar' at any of 200 states.*torn") as caught:
        crosscheck_legs([plant(ld.load(four_bar), tree_coordinates=refuse)], "four_bar", 10, 0)
    assert caught.value.rows.tolist() == list(range(200))


@pytest.mark.filterwarnings("ignore:.*beyond its lower limit")
def test_a_mechanism_without_room_for_differences(four_bar):
    limit = 'lower="-2" upper="2"'
    narrow = four_bar.replace(limit, 'lower="1.80" upper="1.82"', 1)
    with pytest.raises(AssemblyError, match="no state with room"):
        crosscheck(narrow, samples=10)


# What it notices.

# The formulas twice, once with an error: what a check sees does not depend on which route is wrong.
AGAINST = "closed_form against closed_form"
RANDOM = f"{AGAINST}, random inertias"


def test_an_error_in_one_route_is_named_with_its_state(short_swing, closed, plant):
    column = closed.tree_joint_names.index("theta22")

    def flip(result, *_):
        signs = np.ones(result.shape[-1])
        signs[column] = -1.0
        return result * signs

    report = crosscheck_legs([plant(closed, tree_coordinates=flip), closed], "x", 30, 0)
    assert not report.passed
    assert failing(report) == {
        (AGAINST, "joint angles that close the loops"),
        ("closed_form: first principles", "loops and couplings close"),
    }
    worst = report.checks[0]
    assert worst.worst > 0.1
    # theta22 is the angle that beta turns.
    assert abs(worst.at["beta"]) > 0.5
    assert "DISAGREES" in str(table_text(report))
    assert json.loads(report.to_json())["passed"] is False


def table_text(report):
    from rich.console import Console

    console = Console(width=160, force_terminal=False)
    with console.capture() as capture:
        console.print(report)
    return capture.get()


def test_a_whole_turn_of_a_passive_angle_is_noticed(short_swing, monkeypatch):
    """Routes must give the same turn: tables and limits of passive joints take it at its word."""
    assemble = ld.Leg.assemble

    def wound(self, q, **options):
        turn = 2.0 * np.pi if self.route == "pinocchio" else 0.0
        return {name: angle + turn * (name == "phi_D1") for name, angle in assemble(self, q, **options).items()}

    monkeypatch.setattr(ld.Leg, "assemble", wound)
    report = ld.crosscheck("omnileg", samples=3)
    assert {("closed_form against pinocchio", "joint angles that close the loops")} <= failing(report)
    assert ("closed_form against symbolic", "joint angles that close the loops") not in failing(report)


def test_swapped_actuators_are_noticed(short_swing, closed, plant):
    wrong = plant(closed, torque=lambda result, *_: result[..., [1, 0, 2]])
    names = failing(crosscheck_legs([wrong, closed], "x", 30, 0))
    for group in (AGAINST, RANDOM):
        assert {(group, "torque"), (group, "torque with foot force, tilted")} <= names
    assert ("closed_form: first principles", "power balance") in names


def test_an_error_that_only_random_inertias_show(short_swing, closed, plant):
    """An error that the shipped bodies are too light to show."""
    shipped = closed.mass_matrix(np.zeros(3))

    def only_others(result, q, *_):
        other = np.abs(result).max() > 4.0 * np.abs(shipped).max()
        return result * (1.0 + 1e-6 * other)

    report = crosscheck_legs([plant(closed, mass_matrix=only_others), closed], "x", 20, 0)
    assert failing(report) == {(RANDOM, "mass matrix")}


def test_nan_of_one_route_is_a_failure_not_an_exception(short_swing, closed, plant):
    def refuse(result, q, failures):
        rows = np.flatnonzero(np.atleast_2d(q)[:, 2] > 1.2)
        failures.add(rows, AssemblyError("bent too far", rows=rows, margin=-1.0)) if rows.size else None
        return np.where((q[..., 2] > 1.2)[..., None], np.nan, result)

    report = crosscheck_legs([plant(closed, tree_coordinates=refuse), closed], "x", 30, 0)
    check = report.checks[0]
    assert np.isnan(check.worst)
    assert check.at["gamma"] > 1.2
    assert check.detail == "closed_form: AssemblyError: bent too far"
    assert report.left_out == 0
    assert report.worst is check
    assert json.loads(report.to_json())["checks"][0]["worst"] is None
    assert "bent too far" in table_text(report)


def test_an_acceleration_that_is_wrong_on_the_swing_only(short_swing, closed, plant):
    def slower(result, q, v, tau, *_):
        return result * (1.0 + 1e-6 * (np.abs(tau).max() == 0.0))

    names = failing(crosscheck_legs([plant(closed, acceleration=slower), closed], "x", 20, 0))
    assert names == {("closed_form: first principles", "acceleration along the swing")}


def test_energy_that_one_route_loses(short_swing, closed, plant):
    wrong = plant(closed, potential_energy=lambda result, q, *_: result + 1e-4 * q[..., 0])
    assert ("closed_form: first principles", "energy of a 0.05 s free swing") in failing(
        crosscheck_legs([wrong, closed], "x", 20, 0)
    )
