from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status, find_verdict
from leg_dynamics.papers.omnileg import facts, printed, transmission


@pytest.fixture(scope="module")
def context():
    return Context("omnileg")


def test_errors_at_the_printed_speed(context):
    found = transmission.study(context)
    np.testing.assert_allclose(1e3 * found.error["paper"][0], (0.0578, 0.0559, 0.0209), atol=1e-4)
    # The audit's reading: omega of (29) moves the shaft's centre too.
    np.testing.assert_allclose(1e3 * found.error["crossed"][0], (0.224, 0.223, 0.084), atol=1e-3)
    np.testing.assert_allclose(1e3 * found.error["none"][0], (0.0449, 0.0426, 0.0023), atol=1e-4)
    np.testing.assert_allclose(found.error["paper"][-1], 100.0 * found.error["paper"][0], rtol=1e-6)
    # The audit's torques of Fig. 11: M1 at the end of the force, M2 at the start.
    np.testing.assert_allclose(found.peak[0], (2.2758, 3.0, 1.6341), atol=1e-4)
    np.testing.assert_allclose(found.share("paper"), 100.0 * found.error["paper"] / found.peak, rtol=1e-15)
    np.testing.assert_allclose(found.speed_of(4.0 * found.error["none"][0], "none"), 2.0, rtol=1e-14)


def test_curves_are_those_of_the_printed_speed(context):
    found = transmission.study(context)
    assert set(found.curves) == set(transmission.MODELS)
    for name, curve in found.curves.items():
        assert curve.shape == (found.time.size, 3)
        np.testing.assert_allclose(np.abs(curve).max(axis=0), found.error[name][0], rtol=1e-15)


def test_verdicts(context):
    verdicts = [function(context) for function in transmission.VERDICTS]
    assert [verdict.status for verdict in verdicts] == [Status.CONFIRMED, Status.NOT_REPRODUCIBLE]
    cause = find_verdict(verdicts, "claim: cause of Fig. 11's residual torques")
    assert "On M3 they are 62 to 249 times" in cause.finding

    def numbers(start):
        return [figure.value for figure in cause.figures if figure.name.startswith(start)]

    np.testing.assert_allclose(numbers("reported over computed, M"), (36.3, 26.8, 249.0), rtol=5e-3)
    np.testing.assert_allclose(numbers("reported over computed, ω"), (9.37, 6.72, 61.6), rtol=5e-3)
    drives = numbers("inertia of PL")
    np.testing.assert_allclose(drives, np.array([2.1e-3, 1.5e-3]) / (np.pi / 6 * (np.pi / 3) ** 2), rtol=1e-4)


def test_a_cause_of_the_right_size_would_be_confirmed(context):
    found = transmission.study(context)
    reported = 1e-3 * np.array([2.1, 1.5, 5.2])
    enough = {name: np.tile(0.5 * reported, (10, 1)) for name in found.error}
    wrong = Context("omnileg", shared={"transmission study": dataclasses.replace(found, error=enough)})
    assert transmission.cause_of_the_residual(wrong).status is Status.CONFIRMED
    too_much = {name: 10.0 * values for name, values in enough.items()}
    wrong = Context("omnileg", shared={"transmission study": dataclasses.replace(found, error=too_much)})
    assert transmission.cause_of_the_residual(wrong).status is Status.NOT_REPRODUCIBLE


def test_neglected_drives_cost_their_inertia_times_the_acceleration(context):
    found = transmission.study(context)
    w = np.pi / 3.0
    law = 1e-3 * np.pi / 6.0 * w**2 * np.abs(np.sin(w * found.time)).max()
    np.testing.assert_allclose(found.error["drives"][0], (law, law, 0.0), atol=1e-15)
    np.testing.assert_allclose(found.error["drives"][-1], 100.0 * found.error["drives"][0], rtol=1e-12)
    # The square of the ratio, by the leg's own parameters.
    state = ([0.1, 0.2, 0.3], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0])
    geared = context.leg.replace(PL_1_ratio=3.0, M1_rotor_inertia=1e-4)
    added = geared.generalized_force(*state) - context.leg.generalized_force(*state)
    np.testing.assert_allclose(added, (0.0, 9e-4, 0.0), atol=1e-14)


def test_reading_of_the_shafts_centre_against_the_whole_mass_matrix(context):
    """`_crossing` adds a few terms; here the whole leg is put together with them."""
    _, state = transmission._motion(samples=6)
    by_30 = transmission.simplified_mass_matrix(context)
    centre = facts.com(context, "shaft_A4B4")

    def crossed(q):
        v = np.cross(printed.omega_shaft(q), (printed.rod_rotation(q) @ centre)[..., None], axis=-2)
        kept = printed.rod_velocity_from_A1(q, centre)
        return by_30(q) + 0.059 * (np.swapaxes(v, -1, -2) @ v - np.swapaxes(kept, -1, -2) @ kept)

    difference = facts.lagrange_torque(crossed, *state) - facts.lagrange_torque(by_30, *state)
    np.testing.assert_allclose(transmission._crossing(context, state), difference[:, [1, 0, 2]], atol=1e-9)


def test_exact_turning_costs_nothing_as_motion(context, monkeypatch):
    mechanism = facts.assembled(context)
    before = transmission._turning_errors(context)
    assert min(before.values()) > 1.5
    for link, name in (("cross_A4", "omega_cross_A4"), ("cross_B4", "omega_cross_B4"), ("shaft_A4B4", "omega_shaft")):
        monkeypatch.setattr(printed, name, lambda q, link=link: mechanism.omega(link))
    assert max(transmission._turning_errors(context).values()) == 0.0


def test_a_heavy_shaft_makes_the_neglect_matter(context):
    heavy = Context("omnileg")
    bodies = tuple(
        body._replace(inertia=tuple(tuple(1e4 * x for x in row) for row in body.inertia))
        if body.name == "shaft_A4B4"
        else body
        for body in context.numbers.bodies
    )
    heavy.__dict__["numbers"] = dataclasses.replace(context.numbers, bodies=bodies)
    assert transmission.neglect_is_small(heavy).status is Status.NOT_REPRODUCIBLE


@pytest.mark.parametrize("function", transmission.CHECKS, ids=lambda function: function.__name__)
def test_checks_hold(context, function):
    check = function(context)
    assert check.passed
    assert check.value > 0.0


def test_a_model_that_is_not_the_printed_one_fails_the_check(context, monkeypatch):
    right = printed.omega_shaft
    monkeypatch.setattr(printed, "omega_shaft", lambda q: 1.1 * right(q))
    assert not transmission.two_derivations_of_the_neglect(context).passed


def test_table_and_plots(context):
    (section,) = transmission.sections(context)
    assert [row[:2] for row in section.rows[:3]] == [("1", "M1 (β)"), ("1", "M2 (α)"), ("1", "M3 (γ)")]
    assert any("3.66" in paragraph and "2.61" in paragraph for paragraph in section.paragraphs)
    for plot in transmission.plots(context):
        assert plot.name in section.plots
        assert plot.png(60).startswith(b"\x89PNG")
