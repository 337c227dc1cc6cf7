from __future__ import annotations

import math

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.omnileg import scenarios

from .tampered import tamper


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
        ("Fig. 6", "rod's end beside the knee", 1e-13),
        ("Fig. 7", "output against input", 1e-12),
        ("Fig. 7", "driven gears against input", 1e-12),
        ("Fig. 8", "middle joint + 2 gamma", 1e-12),
        ("Fig. 8", "shortening", 1e-13),
        ("Fig. 9", "position, closed form minus numeric", 1e-12),
        ("Fig. 9", "distance from (51) as printed", 1e-12),
        ("Fig. 10", "position, closed form minus numeric", 1e-12),
        ("Fig. 11", "torque, closed form minus numeric", 1e-11),
    ],
)
def test_facts_behind_the_figures(verdicts, item, name, largest):
    assert 0.0 <= _value(verdicts[item], name) <= largest


def test_mobility_behind_figure_2(verdicts):
    verdict = verdicts["Fig. 2"]
    assert (_value(verdict, "mobility"), _value(verdict, "redundant rows")) == (3.0, 9.0)


def test_shares_of_the_experiments_are_held_against_the_fixed_candidates(verdicts):
    fig15, fig17 = verdicts["Fig. 15"].finding, verdicts["Fig. 17"].finding
    assert "1.4 % imply 93.1 to 107.4 mm, fits the span in X" in fig15
    assert "1.8 % imply 45.9 to 54.3 mm, fits no candidate" in fig15
    assert "1.9 % imply 84.6 to 94.6 mm, fits the span in Z at 45°" in fig17
    assert _value(verdicts["Fig. 17"], "span in Z at 45°, Z error") == pytest.approx(0.08946, abs=1e-5)


@pytest.mark.parametrize("item", [f"Fig. {n}" for n in (*range(2, 10), 14)])
def test_a_tampered_leg_confirms_no_figure(context, verdicts, item):
    assert verdicts[item].status is Status.CONFIRMED
    function = scenarios.VERDICTS[int(item.removeprefix("Fig. ")) - 1]
    assert function(tamper(context, Context)).status is Status.NOT_REPRODUCIBLE


@pytest.mark.parametrize("n", [1, 10, 15, 16, 17, 19])
def test_a_tampered_leg_changes_the_numbers_of_the_other_figures(context, verdicts, n):
    wrong = scenarios.VERDICTS[n - 1](tamper(context, Context))
    assert wrong.status is verdicts[f"Fig. {n}"].status
    assert wrong.status is not Status.CONFIRMED
    assert wrong.to_dict()["figures"] != verdicts[f"Fig. {n}"].to_dict()["figures"]
    if n == 1:
        assert "does not hold for the model" in wrong.finding


@pytest.mark.parametrize("route", ["leg", "pinocchio"])
def test_torques_that_disagree_are_no_correction_of_figure_11(context, route):
    wrong = tamper(context, Context, foot=0.0, angles=1.0)
    wrong.__dict__["pinocchio" if route == "leg" else "leg"] = getattr(
        context, "pinocchio" if route == "leg" else "leg"
    )
    assert scenarios.figure_11(wrong).status is Status.NOT_REPRODUCIBLE


def test_the_sense_in_which_the_output_shaft_turns_counts(context):
    values, _ = scenarios._coordinates(context)
    reversed_shaft = values | {"gamma_output": -values["gamma_output"]}
    wrong = Context("omnileg", samples=context.samples, shared={"coordinates of the numeric route": reversed_shaft})
    wrong.__dict__.update(leg=context.leg, pinocchio=context.pinocchio)
    assert scenarios.figure_7(wrong).status is Status.NOT_REPRODUCIBLE


def test_an_amplitude_that_fits_would_confirm_what_depends_on_it(context, monkeypatch):
    assert not scenarios._amplitude_fits(context, 25.0)
    assert scenarios._amplitude_fits(context, 45.0)
    monkeypatch.setattr(scenarios, "_amplitude_fits", lambda context, degrees: True)
    assert scenarios.figure_10(context).status is Status.CONFIRMED
    assert scenarios.figure_16(context).status is Status.CONFIRMED
    wrong = tamper(context, Context)
    assert scenarios.figure_16(wrong).status is Status.NOT_REPRODUCIBLE


def test_numbers_of_the_motions(context, verdicts):
    fig9, fig10, fig11 = (verdicts[f"Fig. {n}"] for n in (9, 10, 11))
    # Quintics: 15/8 of the mean speed, 10/√3 of distance over time squared; the lift as in the audit.
    assert [_value(fig9, f"peak speed {axis}") for axis in "XYZ"] == pytest.approx([0.075, 0.0375, 0.03435], abs=1e-5)
    accelerations = [_value(fig9, f"peak acceleration {axis}") for axis in "XYZ"]
    assert accelerations == pytest.approx([1.0 / (6.25 * math.sqrt(3.0)), 0.02309, 0.048], abs=1e-5)
    span = {figure.of: figure.value for figure in fig10.figures if figure.name == "span Z"}
    assert span["foot along (52), 6 s, 25°"] == pytest.approx(0.051612, abs=1e-6)
    assert span["foot along (52), 6 s, 45°"] == pytest.approx(0.089460, abs=1e-6)
    inertial = [_value(fig11, f"inertia and velocity {motor}") for motor in ("M1 (β)", "M2 (α)", "M3 (γ)")]
    assert max(inertial) == pytest.approx(0.0137, abs=5e-4)
    condition = np.linalg.cond(context.leg.jacobian(scenarios.ik_run(context).motion.q))
    assert _value(verdicts["Fig. 14"], "condition number") == pytest.approx(condition.max())


def test_bend_of_the_shaft(context, verdicts):
    values, q = scenarios._coordinates(context)
    bend = math.degrees(math.hypot(*(max(abs(values[f"cardan_A4_{axis}"])) for axis in "yx")))
    found = _value(verdicts["Fig. 7"], "largest bend")
    assert max(np.degrees(np.abs(values[f"cardan_A4_{axis}"])).max() for axis in "yx") <= found <= bend
    # Both cross angles together bend about as far as the rod leans.
    lean = np.degrees(np.arctan(np.hypot(np.tan(q[:, 0]), np.tan(q[:, 1]))))
    assert found == pytest.approx(lean.max(), rel=0.12)


def test_gait_lasts_as_printed_and_its_halves_are_told_apart(context, verdicts):
    cycle, verdict = scenarios.gait(), verdicts["Fig. 19"]
    assert (cycle.swing.duration, cycle.stance.duration) == (1.0, 1.0)
    run = scenarios.gait_run(context)
    swing = (run.time % 2.0 > 1e-9) & (run.time % 2.0 < 1.0 - 1e-9)
    inner = (run.time % 2.0 > 1.0 + 1e-9) & (run.time % 2.0 < 2.0 - 1e-9)
    for name, rows in (("peak in swing", swing), ("peak in stance", inner)):
        peak = np.abs(run.torque[rows, 2]).max()
        assert _value(verdict, f"{name} M3 (γ)") == pytest.approx(peak, rel=0.02)
    # A vertical newton on the foot asks for the lever arms of the foot, and for no mass.
    levers = np.abs(context.leg.jacobian(run.motion.q[inner])[:, 2, :]).max(axis=0)[[1, 0, 2]]
    found = [_value(verdict, f"per newton {motor}") for motor in ("M1 (β)", "M2 (α)", "M3 (γ)")]
    assert found == pytest.approx(levers, abs=1e-4)


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
