"""Verdicts on claims and figures of the modular quadruped's paper, its walk, and tampering."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.quadruped import claims, figures, reported, second, stability, walking


@functools.cache
def known():
    context = Context("quadruped_leg")
    functions = (*figures.VERDICTS, *claims.VERDICTS, *stability.VERDICTS)
    return context, {verdict.item: verdict for verdict in (function(context) for function in functions)}


@pytest.fixture(scope="module")
def verdicts():
    return known()[1]


@pytest.fixture
def context():
    return known()[0]


def figure(verdict, name):
    return next(f.value for f in verdict.figures if f.name == name)


def test_statuses(verdicts):
    def of(status):
        return {item.removeprefix("claim: ") for item, verdict in verdicts.items() if verdict.status is status}

    assert of(Status.CORRECTED) == {
        "two connection faces a module",
        "the other legs are like leg IV",
        "with three joints at rest three are left",
        "the origin O_c is at (a, b, c)",
        "agreement at one pose shows that (3) is right",
        "the robot walks steadily",
    }
    assert of(Status.NOT_REPRODUCIBLE) == {*(f"Fig. {n}" for n in range(5, 10)), "the design is sound"}
    assert of(Status.OUT_OF_REACH) == {"Fig. 1", "Fig. 2", "latches, rubber feet, less energy, quick repair"}
    assert [item for item in verdicts if item.startswith("Fig.")] == [f"Fig. {n}" for n in range(1, 10)]
    for verdict in verdicts.values():
        assert verdict.finding.endswith("."), verdict.item
        assert "nan" not in verdict.finding.lower(), verdict.item
        assert all(math.isfinite(f.value) for f in verdict.figures), verdict.item


# ---------------------------------------------------------------------- modules


def test_faces_of_the_body(verdicts, context):
    assert claims.body_faces(context) == (6, 4, 2)
    faces = verdicts["claim: two connection faces a module"]
    assert [figure(faces, name) for name in ("faces needed", "faces by the paper", "third faces")] == [6, 4, 2]
    alike = verdicts["claim: the other legs are like leg IV"]
    assert figure(alike, "bonds of equal gender, all legs like IV") == 2
    assert figure(alike, "bonds of equal gender, legs turned round") == 0


def test_ranks_of_the_leg_with_six_joints(verdicts, context):
    six = verdicts["claim: six joints a leg are redundant"]
    names = ("joints to spare for the foot's place", "rank for the foot's pose, least")
    assert [figure(six, name) for name in names] == [3, 6]
    assert figure(six, "rank, straight") == 3
    assert figure(six, "rank, straight, middle of module 2 at 90°") == 4
    leg = claims.six_joint_leg(context)
    q = context.rng(50).uniform(-1.0, 1.0, (20, 6))
    hip = np.asarray(leg.jacobian(q))
    there = claims.foot_screws(leg, q)[:, :3]
    # In the base's axes and in the hip's: lengths agree.
    np.testing.assert_allclose(np.linalg.norm(there, axis=1), np.linalg.norm(hip, axis=1), atol=1e-12)


def test_joints_of_the_robot(verdicts):
    assert [figure(verdicts["Fig. 3"], name) for name in ("joints", "joints left")] == [30, 12]


def test_a_file_with_other_bonds_changes_the_verdict(context, monkeypatch):
    found = claims.assembly(context)
    modules = dict(found.modules)
    genders = dict(modules["m06"].genders) | {"U": "passive"}
    modules["m06"] = replace(modules["m06"], genders=MappingProxyType(genders))
    monkeypatch.setattr(claims, "assembly", lambda _: replace(found, modules=modules))
    assert claims.mixed_bonds(context).status is Status.NOT_REPRODUCIBLE
    fewer = dict(list(found.modules.items())[:-1])
    monkeypatch.setattr(claims, "assembly", lambda _: replace(found, modules=fewer))
    assert claims.ten_modules(context).status is Status.NOT_REPRODUCIBLE


def test_a_smaller_module_is_not_confirmed(context, monkeypatch):
    monkeypatch.setattr(reported, "SIZE", (0.15, 0.11, 0.1))
    assert claims.module_size(context).status is Status.NOT_REPRODUCIBLE
    monkeypatch.setattr(reported, "SWING", 80.0)
    assert claims.module_freedoms(context).status is Status.NOT_REPRODUCIBLE


def test_genders_that_fit_would_be_confirmed(context, monkeypatch):
    passive = {name: {"U": "passive", "L": "passive"} for name in reported.BODY_GENDERS}
    monkeypatch.setattr(reported, "BODY_GENDERS", passive)
    assert claims.legs_alike(context).status is Status.CONFIRMED


# ---------------------------------------------------------------------- the walk


def test_what_is_inferred():
    assert walking.PERIOD == 20.0
    assert walking.DUTY == 0.75


def test_margin_is_exactly_zero_at_best(context):
    caps = stability.caps_of(context)
    assert sum(each.numbering.ways for each in caps) == 24
    assert len(caps) == 6
    best = caps[0]
    assert best.numbering.order == reported.ORDER
    assert abs(best.uniform) < 1e-8
    assert abs(best.whole) < 1e-12
    assert all(each.uniform < -5e-3 for each in caps[1:])
    for each in caps:
        assert each.uniform <= each.straight + 1e-8 or not each.numbering.round_the_body
        assert each.straight <= each.free + 1e-12
        # Across the diagonal there is nothing to gain; round the body there is.
        assert (abs(each.free) < 1e-12) == (not each.numbering.round_the_body)
        assert each.straight <= 1e-12


def test_no_sway_helps_the_files_numbering(context):
    walk = walking.walk_of(context)
    margin, _ = walking.best_sway(walk, (0.1, 0.1))
    assert abs(margin) < 1e-7


def test_margins_with_longer_stance_against_the_audit(context):
    """Audit: 1.3, 2.7, 4.0 mm at duty 0.80, 0.85, 0.90 for feet 60 mm a cycle; its feet stand a little nearer."""
    margins = [1e3 * walking.margins_of(walking.walk_of(context, duty=duty))[1].min() for duty in (0.8, 0.85, 0.9)]
    np.testing.assert_allclose(margins, [1.3, 2.7, 4.0], rtol=0.1)


def test_sway_makes_the_margin_positive(verdicts, context):
    steady = verdicts["claim: the robot walks steadily"]
    even = figure(steady, "least margin, all masses, shorter steps")
    swayed = figure(steady, "least margin, all masses, shorter steps and sway")
    assert 0.0 < even < 1e-3
    assert swayed > 2e-3
    assert figure(steady, "least margin, all masses, round the body and sway") > 2e-3
    result = stability.swayed(context)
    assert all(limit.holds for limit in result.limits)
    # Between the samples too: 20 times as many, and not among them.
    cycles = np.linspace(0.0, 1.0, 4001) + 1.3e-4
    assert np.abs(result.walk.sway.value(cycles, walking.PERIOD)).max() <= walking.SWAY_BOUND
    assert result.walk.body_velocity(cycles * walking.PERIOD)[:, 0].min() >= 0.0
    assert result.load == "balanced"


@pytest.mark.parametrize("order", [reported.ORDER, ("III", "I", "II", "IV")])
@pytest.mark.parametrize("bound", [0.0, 0.005, 0.03, 0.1, 20.0])
def test_the_sway_keeps_its_bounds_between_the_samples(context, order, bound):
    walk = walking.walk_of(context, order, duty=walking.SWAYED_DUTY)
    _, sway = walking.best_sway(walk, (bound, bound))
    cycles = np.linspace(0.0, 1.0, 20001)
    assert np.abs(sway.value(cycles, walking.PERIOD)).max() <= bound
    assert walk.twist.forward + sway.value(cycles, walking.PERIOD, 1)[:, 0].min() >= -1e-15


def test_figures_and_the_page_agree_on_the_walk_with_sway(verdicts):
    straight = verdicts["Fig. 7"]
    assert figure(straight, "greatest |x| of the body with sway") <= walking.SWAY_BOUND
    assert figure(straight, "least speed ahead with sway") >= 0.0


def test_the_page_says_how_the_commands_walk_differs(context):
    (section,) = stability.sections(context)
    sentence = next(text for text in section.paragraphs if "leg-dynamics gait quadruped" in text)
    assert "optimises further" in sentence
    assert "2 harmonics, up to 30 mm" in sentence
    assert "4 harmonics up to 20 mm" in sentence


def test_checks_hold(context):
    assert [check(context).state for check in second.CHECKS] == ["holds"] * 4


def test_hull_margin():
    feet = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]])
    assert second.hull_margin(feet, np.array([1.0, 0.5])) == pytest.approx(0.5)
    assert second.hull_margin(feet, np.array([-1.0, 1.0])) == pytest.approx(-1.0)


def test_pose_of_4_breaks_the_limit(verdicts):
    design = verdicts["claim: the design is sound"]
    assert np.degrees(figure(design, "θ₃ of leg IV, least, pose of (4), splay 30°")) == pytest.approx(-88.0, abs=0.5)
    fits = [figure(design, f"θ₃ of leg IV, {end}, (−40°, −30°), splay 20°") for end in ("least", "greatest")]
    np.testing.assert_allclose(np.degrees(fits), [-67.0, -16.0], atol=0.5)
    assert abs(figure(design, "room between neighbouring legs")) < 1e-12


def test_a_steady_walk_would_be_confirmed(context, monkeypatch):
    caps = tuple(each._replace(straight=0.01) for each in stability.caps_of(context))
    monkeypatch.setattr(stability, "caps_of", lambda _: caps)
    assert stability.steady(context).status is Status.CONFIRMED


def test_another_time_of_the_step_is_not_confirmed(context, monkeypatch):
    monkeypatch.setattr(reported, "STEP_OF_IV", (11.0, 15.0))
    assert stability.rhythm(context).status is Status.NOT_REPRODUCIBLE


# ---------------------------------------------------------------------- what the text says of Figs 6 to 9


def test_leg_iv_moves_from_10_to_15_s(context):
    f = figures.curves(context)
    assert f.time[f.swings].min() > 10.0 - 1e-9
    assert f.time[f.swings].max() < 15.0 + 1e-9
    assert np.abs(f.velocity[~f.swings]).max() < 1e-12
    slope = np.gradient(f.position, f.time, axis=0)
    np.testing.assert_allclose(slope[2:-2], f.velocity[2:-2], atol=1e-6)
    np.testing.assert_allclose(np.gradient(f.q, f.time, axis=0)[2:-2], f.v[2:-2], atol=1e-5)
    np.testing.assert_allclose(f.body[-1] - f.body[0], [0.0, walking.ADVANCE, 0.0], atol=1e-12)


def test_speed_has_two_peaks_above_five_sixteenths(context):
    time = np.linspace(0.0, walking.PERIOD, 20001)
    for share, peaks in ((0.30, 1), (0.33, 2)):
        walk = walking.walk_of(context, clearance=share * walking.ADVANCE)
        assert figures.maxima(walking.foot_curves(context, walk, time).speed) == peaks


def test_a_jerky_foot_is_not_confirmed(context, monkeypatch):
    f = figures.curves(context)
    rough = f.velocity * np.where(np.sin(40.0 * f.time) > 0.0, 1.0, 0.5)[:, None]
    monkeypatch.setattr(figures, "curves", lambda _: replace(f, velocity=rough))
    assert figures.speed_once(context).status is Status.NOT_REPRODUCIBLE
    lame = replace(f, body=np.add(f.body, (0.01, 0.0, 0.0)))
    monkeypatch.setattr(figures, "curves", lambda _: lame)
    assert figures.straight_line(context).status is Status.NOT_REPRODUCIBLE
    flat = replace(f, position=f.position * [1.0, 1.0, 0.2])
    monkeypatch.setattr(figures, "curves", lambda _: flat)
    assert figures.arch(context).status is Status.NOT_REPRODUCIBLE


def test_maxima():
    x = np.linspace(0.0, 1.0, 101)
    assert figures.maxima(x) == 0
    assert figures.maxima(x * (1.0 - x)) == 1
    assert figures.maxima(np.sin(15.0 * x)) == 3
