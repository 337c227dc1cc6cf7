from __future__ import annotations

import math

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.omnileg import scenarios


@pytest.fixture(scope="module")
def context():
    return Context("omnileg", samples=200)


@pytest.fixture(scope="module")
def verdicts(context):
    return {verdict.item: verdict for verdict in (function(context) for function in scenarios.VERDICTS)}


def _figures(verdict):
    return {(figure.name, figure.of): figure.value for figure in verdict.figures}


def _value(verdict, name):
    (value,) = (figure.value for figure in verdict.figures if figure.name == name)
    return value


@pytest.mark.parametrize(
    ("time", "degrees"),
    [
        (1.25, (-4.1976, 19.5196, 58.9975)),
        (2.5, (-26.5651, 45.0, 54.6235)),
        (5.0, (-41.8103, 0.0, 38.7411)),
    ],
)
def test_inverse_kinematics_along_51(context, time, degrees):
    motion = scenarios.ik_run(context).motion
    row = np.argmin(np.abs(motion.time - time))
    assert motion.time[row] == pytest.approx(time, abs=1e-12)
    np.testing.assert_allclose(np.degrees(motion.q[row]), degrees, atol=1e-4)


def test_foot_at_one_second_of_52(context):
    run = scenarios.fk_run(context)
    assert run.time[200] == 1.0
    np.testing.assert_allclose(run.position[200], (0.060188, -0.060188, 0.460106), atol=1e-6)


@pytest.mark.parametrize(("time", "torque"), [(0.0, (3.0, 0.0, 0.0)), (1.0, (1.5547, -1.5021, -1.4020))])
def test_torque_of_the_foot_force(context, time, torque):
    np.testing.assert_allclose(scenarios.foot_force_torque(context, time), torque, atol=1e-4)


def test_height_windows_of_51(context):
    (up,) = scenarios.height_windows(context)
    (literal,) = scenarios.height_windows(context, "literal")
    np.testing.assert_allclose([up.lower, up.upper], (0.3391, 0.4618), atol=5e-5)
    np.testing.assert_allclose([literal.lower, literal.upper], (0.3266, 0.3971), atol=5e-5)
    assert scenarios.Z0 in up
    assert scenarios.Z0 not in literal
    assert 0.5 not in up


def test_force_acts_in_the_first_second_only_and_with_either_sign(context):
    ours, printed, bare = (scenarios.fig11(context, sign) for sign in ("environment", "printed", "none"))
    acting = ours.time <= 1.0
    np.testing.assert_array_equal(ours.torque[~acting], printed.torque[~acting])
    np.testing.assert_allclose(0.5 * (ours.torque + printed.torque), bare.torque, atol=1e-13)
    change = (ours.torque - bare.torque)[[0, 400]]
    expected = [[0.0, -3.0, 0.0], [1.5021, -1.5547, 1.4020]]  # minus J^T F, in the order M1, M2, M3
    np.testing.assert_allclose(change, expected, atol=1e-4)


def test_gait_loads_the_stance_only(context):
    loaded, bare = scenarios.gait_run(context), scenarios.gait_run(context, load=0.0)
    swing = ~scenarios.gait().in_stance(loaded.time)
    np.testing.assert_array_equal(loaded.torque[swing], bare.torque[swing])
    # The leg carries a body: M3 must push down, against gamma.
    assert np.all(loaded.torque[~swing][:, 2] < bare.torque[~swing][:, 2])
    assert np.abs(loaded.torque[:, 0]).max() < 1e-4


def test_step_starts_where_it_is_told_to(context):
    printed, centred = (scenarios.gait_run(context, start) for start in scenarios.STEP_STARTS)
    np.testing.assert_allclose([printed.position[:, 1].min(), printed.position[:, 1].max()], (0.0, 0.1), atol=1e-12)
    np.testing.assert_allclose([centred.position[:, 1].min(), centred.position[:, 1].max()], (-0.05, 0.05), atol=1e-12)
    np.testing.assert_allclose([p.position[:, 2].min() for p in (printed, centred)], scenarios.Z0 - 0.05, atol=1e-12)


def test_inferred_load_reproduces_the_peaks_it_was_inferred_from(context):
    inference = scenarios.inferred_load(context, 0.05)
    assert inference.load == pytest.approx(44.4, abs=0.05)
    assert inference.height == pytest.approx(0.474, abs=5e-4)
    y = np.linspace(-0.05, 0.05, 101)
    q = context.leg.inverse_kinematics(np.stack([0.0 * y, y, np.full_like(y, inference.height)], axis=-1))
    force = (0.0, 0.0, -inference.load)
    carried = np.einsum("tij,i->tj", context.leg.jacobian(q), -np.array(force))
    np.testing.assert_allclose(np.abs(carried).max(axis=0)[[0, 2]], (0.14 / 0.063, 0.37 / 0.087), rtol=1e-9)


def test_no_height_is_inferred_where_none_fits(context):
    inference = scenarios.inferred_load(context, 0.1)
    assert inference.sine > 1.0
    assert math.isnan(inference.height)


@pytest.mark.parametrize(
    ("place", "quantity", "implied", "low", "high"),
    [
        ("Fig. 9", "position", 106250.0, 42.45 / 0.045 * 100, 42.55 / 0.035 * 100),
        ("Fig. 15", "Z", 50.0, 0.95 / 2.5 * 100, 1.05 / 1.5 * 100),
        ("Fig. 17", "Z", 89.4737, 1.65 / 1.95 * 100, 1.75 / 1.85 * 100),
    ],
)
def test_reported_shares_imply_a_range(place, quantity, implied, low, high):
    reported = scenarios.REPORTED[place, quantity]
    assert reported.implied == pytest.approx(implied, rel=1e-5)
    assert reported.reference == pytest.approx((low, high))
    assert low < implied < high


def test_a_report_without_share_implies_nothing():
    reported = scenarios.REPORTED["Fig. 19", "M1"]
    assert reported.reference is None
    assert math.isnan(reported.implied)


def test_every_figure_of_the_paper_has_a_verdict(verdicts):
    assert list(verdicts) == [f"Fig. {n}" for n in range(1, 20)]
    assert all(verdict.kind == "figure" and verdict.finding for verdict in verdicts.values())
    for n in (12, 13, 15, 17, 18):
        assert verdicts[f"Fig. {n}"].status is Status.OUT_OF_REACH
    computed = set(range(1, 20)) - {12, 13, 18}
    assert all(verdicts[f"Fig. {n}"].figures for n in computed)


@pytest.mark.parametrize(
    ("item", "name", "largest"),
    [
        ("Fig. 1", "foot rotation", 1e-12),
        ("Fig. 3", "half turn", 1e-14),
        ("Fig. 3", "quarter turn", 1e-14),
        ("Fig. 4", "thigh gap", 1e-13),
        ("Fig. 4", "loop residual", 1e-12),
        ("Fig. 5", "round trip", 1e-11),
        ("Fig. 6", "knee position", 1e-13),
        ("Fig. 7", "output against input", 1e-12),
        ("Fig. 8", "middle joint + 2 gamma", 1e-12),
        ("Fig. 8", "shortening", 1e-13),
        ("Fig. 9", "position, two routes", 1e-12),
        ("Fig. 10", "position, two routes", 1e-12),
        ("Fig. 11", "torque, two routes", 1e-11),
    ],
)
def test_facts_behind_the_figures(verdicts, item, name, largest):
    assert 0.0 <= _value(verdicts[item], name) <= largest


def test_mobility_behind_figure_2(verdicts):
    verdict = verdicts["Fig. 2"]
    assert (_value(verdict, "mobility"), _value(verdict, "redundant rows")) == (3.0, 9.0)


def test_spans_settle_what_the_shares_mean(verdicts):
    fig15, fig17 = verdicts["Fig. 15"].finding, verdicts["Fig. 17"].finding
    assert "computed span 100.0 mm, fits the half span" in fig15  # Y: 0.9 mm and 1.8 %
    assert "51.6 mm at 25° or 89.5 mm at 45°, fits the span at 45°" in fig17
    assert "fits neither it nor its half" in fig17


def test_printed_sign_of_figure_11(verdicts):
    verdict = verdicts["Fig. 11"]
    assert verdict.status is Status.CORRECTED
    assert _value(verdict, "difference M2 (α)") == pytest.approx(6.0, abs=1e-9)
    assert verdict.printed
    assert verdict.corrected


@pytest.mark.parametrize("function", scenarios.CHECKS, ids=lambda function: function.__name__)
def test_checks_hold(context, function):
    check = function(context)
    assert check.passed, f"{check.name}: {check.value} > {check.tolerance}"
    # A check that compares a thing with itself would be exactly zero.
    assert check.value > 0.0


def test_sections_have_rows_and_name_plots_that_exist(context):
    names = {plot.name for plot in scenarios.plots(context)}
    sections = scenarios.sections(context)
    assert [section.name for section in sections] == ["inverse-kinematics", "forward-kinematics", "dynamics", "gait"]
    assert {name for section in sections for name in section.plots} == names
    assert all(section.rows and section.paragraphs for section in sections)


@pytest.mark.parametrize("name", ["fig9", "fig10", "fig11", "fig11_sign", "fig14", "fig16", "fig19_foot", "fig19"])
def test_plots_are_drawn_with_units(context, name):
    (plot,) = (plot for plot in scenarios.plots(context) if plot.name == name)
    drawing = plot.build()
    axes = [axis for part in (drawing, *drawing.subfigs) for axis in part.axes]
    assert all(axis.lines for axis in axes)
    labels = {axis.get_ylabel() for axis in axes} - {""}
    assert labels
    assert all("[" in label for label in labels)
