"""Verdicts on figures and claims of the hexapod leg's paper, against the audit and against tampering."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.hexapod_leg import (
    brute_force,
    claims,
    facts,
    figures,
    gait,
    printed,
    reported,
    screws,
    second,
    study,
    trends,
)

# The independent audit: volume (m³), L, Z_f, Z_b (m), kbar and ktilde by the exact and by the printed Jacobian.
AUDIT = {
    "hexapod_leg_preliminary": (0.440, (1.010, 0.283, 0.430), (9.18, 2.33), (14.09, 2.54), (9.16, 2.27)),
    "hexapod_leg": (0.413, (1.050, 0.312, 0.354), (9.18, 2.24), (16.30, 2.70), (9.15, 2.17)),
}
LEAST = {"hexapod_leg_preliminary": (5.09, 8.9), "hexapod_leg": (5.37, 10.9)}


@functools.cache
def known():
    context = Context("hexapod_leg")
    verdicts = {
        verdict.item: verdict
        for module in (figures, screws, claims, trends)
        for verdict in (function(context) for function in module.VERDICTS)
    }
    return context, verdicts


@pytest.fixture(scope="module")
def verdicts():
    return known()[1]


KEPT = (
    "hexapod: states",
    "hexapod: facts",
    "hexapod: preliminary leg",
    "hexapod: workspace of",
    "hexapod: robot again",
    "hexapod: walk again",
    "hexapod: means by force",
)


def fresh():
    old = known()[0]
    context = Context("hexapod_leg", shared={k: v for k, v in old.shared.items() if k.startswith(KEPT)})
    context.__dict__.update(leg=old.leg, pinocchio=old.pinocchio, numbers=old.numbers)
    return context


def figure(verdict, name):
    return next(f.value for f in verdict.figures if f.name == name)


# ---------------------------------------------------------------------- the audit's table


@pytest.mark.parametrize("name", AUDIT)
def test_both_designs_against_the_audit(name):
    context = known()[0]
    volume, lengths, exact, as_printed, spinless = AUDIT[name]
    leg = ld.load(name)
    design = study.design_of(leg)
    room = facts.workspace_of(context, leg)
    assert room.volume.value == pytest.approx(volume, rel=0.01)
    assert (room.step.length, room.step.front, room.step.back) == pytest.approx(lengths, abs=0.005)
    assert (room.mean.value, room.deviation.value) == pytest.approx(exact, rel=0.01)
    for which, expected in (("exact", exact), ("printed", as_printed), ("without spin", spinless)):
        found = study.measure(context, design, which)
        assert found.volume.value == pytest.approx(volume, rel=0.01)
        assert (found.mean.value, found.deviation.value) == pytest.approx(expected, rel=0.01)
    assert tuple(float(each) for each in study.steps(context, design)) == pytest.approx(lengths, abs=0.005)
    for which, least in zip(("exact", "printed"), LEAST[name], strict=True):
        assert study.measure(context, design, which).smallest == pytest.approx(least, rel=0.02)


def test_checks_hold():
    context = known()[0]
    assert [check(context).state for check in study.CHECKS] == ["holds"] * 3


def test_second_calculations_agree():
    context = known()[0]
    assert [check(context).state for check in second.CHECKS] == ["holds"] * len(second.CHECKS)


def test_second_calculations_notice_what_is_wrong(monkeypatch):
    """A tenth of a millimetre in a speed, two in a length, one per cent in k: each check fails."""
    context = known()[0]
    own = Context("hexapod_leg", seed=context.seed, samples=context.samples, shared=dict(context.shared))
    for check in second.CHECKS:
        assert check(own).passed
    del own.shared["hexapod: difference of the gaits"]
    period, stride, lift = gait.ASSUMED[0]
    cycle = gait.walk(own, period, stride, lift)
    own.shared[f"hexapod: walk {period} {stride} {lift}"] = replace(cycle, rates=cycle.rates + 1e-4)
    assert not second.gaits_agree(own).passed
    drawn = study.monte_carlo(own)
    length = drawn.steps.length + np.where(np.arange(len(drawn.values)) == 7, 2e-3, 0.0)
    moved = drawn._replace(steps=drawn.steps._replace(length=length), mean=1.02 * drawn.mean)
    own.shared["hexapod: Monte Carlo"] = moved
    del own.shared["hexapod: chords by force"]
    monkeypatch.setattr(second, "CHORDS", 20)
    assert not second.steps_of_designs_agree(own).passed
    assert not second.dexterity_of_designs_agree(own).passed
    assert not second.chords_agree(own).passed
    means = {value: mean._replace(value=1.04 * mean.value) for value, mean in second.brute_means(own).items()}
    own.shared["hexapod: means by force"] = means
    assert not second.means_agree(own).passed


def test_brute_force_has_the_lengths_and_limits_of_the_leg():
    """Against the leg's file by the numeric route: lengths by inverse kinematics, limits by their margins."""
    from leg_dynamics.analysis.workspace import margins

    leg = ld.load("hexapod_leg", route="pinocchio")
    design = study.design_of(leg)
    p = np.random.default_rng(3).uniform([-0.6, -0.6, 0.3], [0.6, 0.6, 0.9], (200, 3))
    lengths, feasible = brute_force.lengths_and_feasible(design, p)
    q = ld.load("hexapod_leg").inverse_kinematics(p, limits="ignore")
    np.testing.assert_allclose(lengths, q, atol=1e-12)
    named = {name: value for name, value in margins(leg, q).items() if not name.startswith(facts.BEYOND_THE_PAPER)}
    assert np.array_equal(feasible, np.min(list(named.values()), axis=0) >= 0.0)
    assert 40 < feasible.sum() < 160
    x = brute_force.chord(design)
    assert x == pytest.approx(float(study.steps(known()[0], design).length), abs=2.0 * brute_force.MARCH)


def test_the_spread_covers_a_finer_estimate():
    context = known()[0]
    design = study.design_of(context.leg)
    few, many = study.measure(context, design, count=1 << 9), study.measure(context, design, count=1 << 14)
    assert many.mean.half_width < few.mean.half_width
    assert abs(few.mean.value - many.mean.value) < few.mean.half_width + many.mean.half_width
    assert abs(few.volume.value - many.volume.value) < few.volume.half_width + many.volume.half_width


def test_gait_against_the_audit():
    context = known()[0]
    peaks = {(4.0, 0.4): (255, 172, 249), (2.0, 0.3): (436, 258, 425), (2.0, 0.8): (1166, 753, 1139)}
    stance = {(4.0, 0.4): (54, 54, 53), (2.0, 0.3): (62, 82, 60), (2.0, 0.8): (391, 218, 384)}
    for period, stride, lift in gait.ASSUMED:
        if (period, stride) in peaks:
            walk = gait.walk(context, period, stride, lift)
            np.testing.assert_allclose(1e3 * np.abs(walk.rates).max(axis=0), peaks[period, stride], atol=1.0)
            on_ground = np.abs(walk.rates[walk.stance])
            np.testing.assert_allclose(1e3 * on_ground.max(axis=0), stance[period, stride], atol=1.0)


def test_rates_of_the_gait_are_those_of_the_lengths():
    walk = gait.walk(known()[0], *gait.ASSUMED[0])
    slope = np.gradient(walk.q, walk.time, axis=0)
    np.testing.assert_allclose(walk.rates[2:-2], slope[2:-2], atol=2e-4)


# ---------------------------------------------------------------------- the list


def test_every_figure_has_a_verdict(verdicts):
    assert [item for item in verdicts if item.startswith("Fig.")] == [f"Fig. {n}" for n in range(1, 11)]
    for verdict in verdicts.values():
        assert verdict.finding.endswith("."), verdict.item
        assert "nan" not in verdict.finding.lower(), verdict.item
        assert all(math.isfinite(f.value) for f in verdict.figures), verdict.item


def test_statuses(verdicts):
    def of(status):
        return {item.removeprefix("claim: ") for item, verdict in verdicts.items() if verdict.status is status}

    assert of(Status.CORRECTED) == {
        "Fig. 3",
        "strut 1 cannot turn about its own axis",
        "chain UPS lies in one plane with chain UP",
        "sideways swing by strut 3 alone, fully decoupled",
        "lengths, U joints and ball limit the workspace",
        "wording of the design problem",
        "L and Z rise with b and flatten",
        "k̄ and k̃ fall with a, ever faster",
        "k̄ and k̃ rise with b, little, and flatten",
    }
    assert of(Status.OUT_OF_REACH) == {"Fig. 7", "Fig. 8", "great load, large workspace, agile"}
    assert of(Status.NOT_REPRODUCIBLE) == {
        "Fig. 2",
        "Fig. 4",
        "Fig. 5",
        "Fig. 6",
        "Fig. 9",
        "Fig. 10",
        "a, b, l2min and l2max matter most for L and Z",
        "k̄ = 4.3 and k̃ = 4.7 are middle values",
        "designs that meet all four conditions",
        "the chosen parameters perform well",
        "the struts do not interfere",
        "the struts' speeds are reasonable and change smoothly",
        "k̄ and k̃ fall slowly with the stroke of strut 2",
    }


def test_numbers_of_the_claims(verdicts):
    plane = verdicts["claim: chain UPS lies in one plane with chain UP"]
    assert figure(plane, "angle out of the plane, mean") == pytest.approx(0.8, abs=0.1)
    assert 3.5 < figure(plane, "angle out of the plane, largest") < 4.5
    swing = verdicts["claim: sideways swing by strut 3 alone, fully decoupled"]
    assert figure(swing, "|∂l₃/∂β| over |∂l₃/∂α|, mean") == pytest.approx(0.25, abs=0.02)
    assert figure(swing, "|∂l₃/∂β| over |∂l₃/∂α|, largest") == pytest.approx(2.2, abs=0.1)
    sleeves = verdicts["claim: the struts do not interfere"]
    # Axes of struts 1 and 3 straight down: the nearer end is that of sleeve 3, 0.5 m along it.
    lean = math.atan2(0.15, 0.53)
    gap = 0.2 - 0.5 * math.sin(lean) - 0.065
    assert figure(sleeves, "gap straight down at l₁min") == pytest.approx(-1.1e-3, abs=1e-4)
    assert figure(sleeves, "gap straight down at l₁min") == pytest.approx(gap, abs=1e-3)
    assert figure(sleeves, "gap straight down 20 mm above l₁min") == pytest.approx(3.4e-3, abs=1e-4)
    reach = verdicts["claim: the tubes of strut 2 fit its range"]
    assert figure(reach, "overlap at full length") == pytest.approx(0.02)
    assert figure(verdicts["Fig. 3"], "directions that hold, Z behind") == 7
    assert max(f.value for f in verdicts["Fig. 1"].figures if "b away" in f.name) == 5


def test_mobility_and_constraints(verdicts):
    mobility = verdicts["claim: two rotations and one translation"]
    names = ("joint freedoms", "loop rows", "rank of the loop rows", "Grübler's count", "mobility")
    assert [figure(mobility, name) for name in names] == [13, 12, 10, 1, 3]
    constraints = verdicts["claim: constraints are two forces and one couple"]
    names = ("rank of chain UP", "rank of chain UPR", "rank of chain UPS", "forces", "couples")
    assert [figure(constraints, name) for name in names] == [3, 4, 6, 2, 1]


def test_trends_against_the_audit():
    context = known()[0]
    a, b = (study.sweep(context, name) for name in "ab")
    assert (a.steps.length[0], a.steps.length[-1]) == pytest.approx((1.125, 0.765), abs=0.005)
    assert (b.steps.length[0], b.steps.length[-1]) == pytest.approx((1.089, 0.952), abs=0.005)
    assert (b.steps.back[0], b.steps.back[-1]) == pytest.approx((0.376, 0.450), abs=0.005)
    exact, other = trends.curves(a, "exact"), trends.curves(a, "printed")
    assert (exact.mean[0], exact.mean[-1]) == pytest.approx((19.4, 4.76), rel=0.01)
    assert (other.mean[0], other.mean.min(), other.mean[-1]) == pytest.approx((18.97, 14.09, 15.25), rel=0.01)
    assert trends.curves(b, "printed").mean[0] == pytest.approx(57.0, rel=0.02)


# ---------------------------------------------------------------------- helpers


def test_words_for_curves():
    x = np.linspace(0.0, 1.0, 11)
    assert trends.rises(x, 0.01)
    assert not trends.rises(-x, 0.01)
    assert trends.falls(-x, 0.01)
    assert not trends.falls(np.abs(x - 0.6), 0.01)
    assert not trends.rises(0.001 * x, 0.01)
    assert trends.flat(0.001 * x, 0.01)
    assert trends.accelerates(x**2)
    assert not trends.accelerates(np.sqrt(x))
    assert trends.flattens(np.minimum(x, 0.4), 0.01)
    assert not trends.flattens(x**2, 0.01)
    assert not trends.flattens(1.0 - x, 0.01)
    assert not trends.flattens(0.5 - np.abs(x - 0.5), 0.01)
    assert trends.small(10.0 + 0.5 * x)
    assert not trends.small(1.0 + x)


def test_first_zero_of_margins():
    along = np.linspace(0.0, 1.0, 101)
    ends = np.array([[0.333], [2.0], [-1.0], [1.0], [0.0]])
    np.testing.assert_allclose(study._first_zero(lambda x: ends - x, along), [0.333, 1.0, 0.0, 1.0, 0.0], atol=1e-12)


def test_first_zero_beside_a_kink():
    def margin(x):
        return np.minimum(1.0 + 0.0 * x, 200.0 * (0.33371 - x))[None]

    found = study._first_zero(margin, np.linspace(0.0, 1.0, 41))
    np.testing.assert_allclose(found, 0.33371, atol=1e-12)


def test_median_interval_covers():
    rng = np.random.default_rng(3)
    inside = 0
    for _ in range(300):
        _, low, high = study.median_interval(rng.normal(size=101))
        inside += low <= 0.0 <= high
    assert inside > 270


def test_reciprocal_wrenches_do_no_work():
    rng = np.random.default_rng(4)
    twists = rng.normal(size=(5, 3, 6))
    wrenches = screws.reciprocal(twists, 3)
    assert wrenches.shape == (5, 3, 6)
    assert np.abs(screws.power(wrenches, twists)).max() < 1e-12
    assert screws.rank_of(twists) == 3
    mixed = twists.copy()
    mixed[0, 2] = mixed[0, 1]
    assert screws.rank_of(mixed) == -1


def test_poses_of_the_study_are_those_of_the_file():
    """Feasibility by the study's margins and by the constraints in the file."""
    from leg_dynamics.analysis.workspace import margins

    context = known()[0]
    leg, design = context.leg, study.design_of(context.leg)
    rng = np.random.default_rng(6)
    p = rng.uniform([-0.8, -0.8, 0.2], [0.8, 0.8, 0.95], (3000, 3))
    here = study.poses_at(context, design, tuple(p.T))
    q = leg.inverse_kinematics(p, limits="ignore", on_error="nan")
    closed = np.isfinite(q).all(axis=1)
    there = margins(leg, q[closed])
    kept = [v for name, v in there.items() if not name.startswith(("telescope", "clearance"))]
    np.testing.assert_array_equal(here.feasible()[closed], np.min(kept, axis=0) >= 0.0)
    assert 100 < here.feasible().sum() < 2900


# ---------------------------------------------------------------------- verdicts can change


def test_a_leg_whose_strut_3_is_free_of_beta(monkeypatch):
    context = fresh()
    D = claims.length_derivatives(facts.facts_of(context))
    changed = D.copy()
    changed[:, 2, 1] = 0.0
    monkeypatch.setattr(claims, "length_derivatives", lambda _: changed)
    assert claims.swing_sideways(context).status is Status.CONFIRMED
    changed[:, 2, 1] = 0.1
    changed[:, 1, 0] = 0.1
    assert claims.swing_sideways(context).status is Status.NOT_REPRODUCIBLE
    assert claims.swing_ahead(context).status is Status.NOT_REPRODUCIBLE


def test_thresholds_that_can_be_met(monkeypatch):
    context = fresh()
    monkeypatch.setattr(reported, "ACCEPTED", {"Z": 0.35, "L": 1.0, "kbar": 9.5, "ktilde": 4.7})
    assert claims.dexterity_in_reach(context).status is Status.CONFIRMED
    assert claims.accepted_designs(context).status is Status.CONFIRMED
    assert claims.chosen_design(context).status is Status.CONFIRMED
    assert figures.figure_6(context).status is Status.CONFIRMED


def test_other_middle_values(monkeypatch):
    context = fresh()
    monkeypatch.setattr(reported, "ACCEPTED", dict(reported.ACCEPTED) | {"L": 1.3})
    assert claims.middle_lengths(context).status is Status.NOT_REPRODUCIBLE


def test_shorter_tubes_and_longer_struts(monkeypatch):
    context = fresh()
    monkeypatch.setattr(reported, "TUBES", dict(reported.TUBES) | {"rod_2": (0.25, 0.03, 0.003)})
    assert claims.strut_2_reaches(context).status is Status.NOT_REPRODUCIBLE
    monkeypatch.setattr(claims, "clearance", lambda context, q: np.full(len(q), 0.01))
    assert claims.sleeves(context).status is Status.CONFIRMED
    monkeypatch.setattr(reported, "PRELIMINARY", dict(reported.PRELIMINARY) | {"h": 0.71})
    assert claims.initial_pose(context).status is Status.NOT_REPRODUCIBLE


def test_another_slip_of_wording_is_not_corrected(monkeypatch):
    changed = dict(reported.SECTION_6) | {"secondary": ("c", "l1_min", "l3_min", "l3_max")}
    monkeypatch.setattr(reported, "SECTION_6", changed)
    assert claims.wording_of_section_6(fresh()).status is Status.NOT_REPRODUCIBLE


def test_a_numeric_route_of_another_mobility():
    context = fresh()
    true = context.pinocchio

    class Odd:
        def __getattr__(self, name):
            return getattr(true, name)

        def mobility_report(self, **options):
            report = true.mobility_report(**options)
            return SimpleNamespace(mobility=4, redundant=report.redundant)

    context.__dict__["pinocchio"] = Odd()
    assert screws.mobility(context).status is Status.NOT_REPRODUCIBLE


def test_another_mechanism_has_other_constraints():
    context = fresh()
    found = screws.screws_of(context)
    turned = np.roll(found.couple, 1, axis=1)
    context.shared["hexapod: screws"] = found._replace(couple=turned)
    assert screws.constraints(context).status is Status.NOT_REPRODUCIBLE
    context.shared["hexapod: screws"] = found._replace(rotations=3)
    assert screws.mobility(context).status is Status.NOT_REPRODUCIBLE


@pytest.mark.parametrize(
    ("function", "name"),
    [
        (trends.length_by_a, "a"),
        (trends.length_by_b, "b"),
        (trends.length_by_l2_min, "l2_min"),
        (trends.length_by_l2_max, "l2_max"),
        (figures.figure_3, "b"),
    ],
)
def test_reversed_curves_of_length(function, name):
    context = fresh()
    swept = study.sweep(context, name)
    backwards = study.Steps(*(each[::-1] for each in swept.steps))
    context.shared[f"hexapod: sweep of {name}"] = swept._replace(steps=backwards)
    assert function(context).status is Status.NOT_REPRODUCIBLE


@pytest.mark.parametrize(("function", "name"), [(trends.dexterity_by_a, "a"), (trends.dexterity_by_c, "c")])
def test_reversed_curves_of_dexterity(function, name):
    context = fresh()
    swept = study.sweep(context, name)
    context.shared[f"hexapod: sweep of {name}"] = swept._replace(exact=swept.exact[::-1])
    assert function(context).status is Status.NOT_REPRODUCIBLE


def test_curves_as_the_text_has_them_would_be_confirmed():
    context = fresh()
    swept = study.sweep(context, "b")
    rising = np.minimum(np.linspace(0.9, 1.2, len(swept.values)), 1.0)
    context.shared["hexapod: sweep of b"] = swept._replace(
        steps=study.Steps(rising, rising, rising), exact=swept.exact[::-1]
    )
    assert trends.length_by_b(context).status is Status.CONFIRMED
    assert figures.figure_3(context).status is Status.CONFIRMED


def test_a_ball_that_binds(monkeypatch):
    context = fresh()
    found = facts.workspace_of(context, context.leg)
    ball = next(k for k, name in found.names.items() if "ball" in name)
    poses = replace(found.poses, active=np.where(np.arange(len(found.poses)) % 2, ball, found.poses.active))
    context.shared[f"hexapod: workspace of {context.leg.name}"] = replace(found, poses=poses)
    assert claims.what_limits(context).status is Status.CONFIRMED


def test_printed_matrix_changes_what_is_said_of_it(monkeypatch):
    context = fresh()
    monkeypatch.setattr(printed, "jacobian", lambda l1, w1, w2, w3, b, c: np.broadcast_to(np.eye(3), (len(l1), 3, 3)))
    assert "printed 1.00, 0.00, 1.00" in figures.figure_4(context).finding


def test_monte_carlo_is_the_same_again_and_another_with_another_seed(monkeypatch):
    monkeypatch.setattr(study, "DESIGNS", 400)
    one, same = (study.monte_carlo(fresh()) for _ in range(2))
    np.testing.assert_array_equal(one.mean, same.mean)
    np.testing.assert_array_equal(one.steps.length, same.steps.length)
    other = fresh()
    other.seed = 1
    assert not np.array_equal(study.monte_carlo(other).values, one.values)


def test_monte_carlo_agrees_with_one_design_at_a_time():
    context = known()[0]
    drawn = study.monte_carlo(context)
    base = study.design_of(facts.preliminary(context))
    for row in (0, 7, 42):
        values = dict(zip(drawn.names, map(float, drawn.values[row]), strict=True))
        design = replace(base, **values)
        one = study.measure(context, design, count=1 << 10)
        assert drawn.mean[row] == pytest.approx(one.mean.value, rel=0.03)
        assert drawn.volume[row] == pytest.approx(one.volume.value, rel=0.1)
        alone = study.steps(context, design)
        assert drawn.steps.length[row] == pytest.approx(float(alone.length), abs=1e-12)
