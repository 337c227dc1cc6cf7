"""Masses and inertia of designs: learnt from some renderings, and the same as those of each design's own leg."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.design import Range, Stage, Study, gait_path, inertia, run
from leg_dynamics.analysis.design.inertia import InertiaMap, inertia_of, learn_inertia
from leg_dynamics.analysis.design.study import Evaluator, Plan
from leg_dynamics.routes import Recipe

from . import design_legs
from .test_design_runs import bits

pytestmark = pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")

OBJECTIVES = ("peak_force", "peak_speed", "peak_power", "mass")
HEXAPOD = (
    Range("a", 0.17, 0.23),
    Range("b", 0.05, 0.08),
    Range("rod_13_diameter", 0.025, 0.035),
    Range("density", 2700.0, 7850.0),
)
OMNILEG = (Range("L1", 0.14, 0.16), Range("knee_mass", 0.5, 0.9), Range("foot_mass", 0.1, 0.3))


def make(name, ranges, samples=1000, gait=(2.0, 0.1, 0.03), force=(0.0, 0.0, -100.0), **changes):
    leg = ld.load(name)
    path = gait_path(leg, *gait, support_force=force, samples=40)
    return Study(leg, (Stage(ranges, samples),), objectives=OBJECTIVES, path=path, **changes)


def peaks_of(leg, path):
    """The objectives by the interface of a leg alone."""
    motion = path.to_joint(leg)
    torque = leg.torque(motion.q, motion.v, motion.a, foot_force=motion.foot_force)
    order = [leg.joint_names.index(name) for name in leg.backend.actuator_joints]
    speed = motion.v[:, order]
    tree = leg.description
    moving = [link for link in tree.links if any(joint.type != "fixed" for joint in tree.path(link.name))]
    return {
        "peak_force": np.abs(torque).max(),
        "peak_speed": np.abs(speed).max(),
        "peak_power": np.abs(torque * speed).max(),
        "mass": math.fsum(link.inertial.mass for link in moving if link.inertial is not None),
    }


@pytest.mark.parametrize(
    ("name", "ranges", "gait"),
    [
        ("hexapod_leg", HEXAPOD, (2.0, 0.1, 0.03)),
        pytest.param("omnileg", OMNILEG, (2.0, 0.04, 0.01), marks=pytest.mark.slow),
    ],
)
def test_objectives_are_those_of_each_design(name, ranges, gait):
    study = make(name, ranges, gait=gait)
    evaluator = Evaluator(Plan.of(study))
    assert evaluator.plan.inertia is not None
    found = 0
    for row in evaluator.rows(0, {}, range(30)):
        if row.status != "ok" or math.isnan(row.values["peak_force"]):
            continue
        leg = study.leg.replace(**row.design)
        assert row.values == pytest.approx(peaks_of(leg, study.path), rel=1e-9)
        # a slow gait says little about tensors
        numbers = evaluator.plan.inertia(row.design).numbers
        assert numbers == pytest.approx({name: leg.numbers[name] for name in numbers}, rel=1e-9, abs=1e-15)
        found += 1
        if found == 4:
            break
    assert found == 4


def test_no_design_is_rendered(monkeypatch):
    evaluator = Evaluator(Plan.of(make("hexapod_leg", HEXAPOD[:2])))

    def render(*arguments):
        raise AssertionError("a design is rendered")

    monkeypatch.setattr(Recipe, "with_parameters", render)
    rows = evaluator.rows(0, {}, range(20))
    assert all(math.isfinite(row.values["mass"]) for row in rows)
    assert any(math.isfinite(row.values["peak_power"]) for row in rows)


def test_design_is_rendered_once_where_nothing_is_learnt(monkeypatch):
    plan = Plan.of(make("hexapod_leg", HEXAPOD[:2], samples=4))
    assert plan.inertia is None
    assert "more than 2 renderings" in plan.why_rendered
    assert plan.masses.startswith("each design rendered: ")
    evaluator, rendered = Evaluator(plan), []
    render = Recipe.with_parameters
    monkeypatch.setattr(Recipe, "with_parameters", lambda *given: rendered.append(given) or render(*given))
    rows = evaluator.rows(0, {}, range(4))
    assert any(math.isfinite(row.values["peak_power"]) for row in rows)
    assert len(rendered) == 4


def test_learnt_and_rendered_agree():
    study = make("hexapod_leg", HEXAPOD[1:3])
    plan = Plan.of(study)
    assert plan.inertia.checked == 5
    learnt = Evaluator(plan).rows(0, {}, range(3))
    rendered = Evaluator(dataclasses.replace(plan, inertia=None)).rows(0, {}, range(3))
    for one, other in zip(learnt, rendered, strict=True):
        assert one.values == pytest.approx(other.values, rel=1e-11, nan_ok=True)


@pytest.mark.parametrize("changes", [{"workers": 2}, {"chunk": 5}, {"resume": True}])
def test_rows_are_the_same_to_the_bit(changes, tmp_path):
    study = make("hexapod_leg", HEXAPOD[:2], samples=60, chunk=7)
    expected = bits(run(study))
    if "resume" in changes:

        def until_half(what, share):
            if share > 0.5:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            run(study, tmp_path, progress=until_half)
        inertia._LEARNT.clear()  # another process learns again
        assert bits(run(study, tmp_path, resume=True)) == expected
    elif "chunk" in changes:
        assert bits(run(dataclasses.replace(study, **changes))) == expected
    else:
        assert bits(run(study, **changes)) == expected


# The map itself, on a leg whose link has any mass and inertia.


def learn(folder, mass, length, ranges, designs=1000):
    leg = design_legs.weighed(folder, mass, length)
    return leg, learn_inertia(leg, ranges, (), designs, forces=True)


SIZE, WEIGHT = Range("size", 0.2, 0.6), Range("weight", 0.0, 3.0)


@pytest.mark.parametrize(
    ("mass", "length"),
    [
        ("p.weight.value", "p.size.value"),
        ("p.weight.value*p.size.value**2", "p.size.value**2"),
        ("p.weight.value*(1 + sin(p.size.value))", "cos(p.size.value)"),
    ],
)
def test_numbers_are_those_of_the_rendered_design(tmp_path, mass, length):
    leg, found = learn(tmp_path, mass, length, (SIZE, WEIGHT))
    assert isinstance(found, InertiaMap)
    generator = np.random.default_rng(3)
    for _ in range(3):
        design = {"size": generator.uniform(0.2, 0.6), "weight": generator.uniform(0.1, 3.0)}
        expected = inertia_of(leg, leg.replace(**design).description, forces=True)
        own = found(design)
        assert own.mass == pytest.approx(expected.mass, rel=1e-12)
        assert own.numbers == pytest.approx(expected.numbers, rel=1e-11, abs=1e-13)


def test_body_that_weighs_nothing_is_rendered(tmp_path):
    _, found = learn(tmp_path, "p.weight.value", "p.size.value", (SIZE, WEIGHT))
    assert found({"weight": 1e-6}) is None
    assert found({"weight": -1.0}) is None
    assert found({"weight": 1.0}).mass == pytest.approx(2.0)


@pytest.mark.parametrize(
    "mass",
    [
        "3 if p.size.value > 0.4 else p.weight.value",
        "max(p.size.value, 0.41)",
        "max(p.size.value, 0.52)",
        "max(0, 0.25 - p.size.value) + 1",
        "1/(p.size.value - 0.19)",
    ],
)
def test_what_is_no_polynomial_is_rendered(tmp_path, mass):
    _, found = learn(tmp_path, mass, "0.3", (SIZE,))
    assert isinstance(found, str)
    assert "'size'" in found or "of size" in found


def test_small_study_is_rendered(tmp_path):
    _, found = learn(tmp_path, "p.weight.value", "p.size.value", (SIZE, WEIGHT), designs=20)
    assert "more than 10 renderings" in found
