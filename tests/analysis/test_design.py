"""Design studies: what is varied and demanded, the indices of a design, and the choice among many."""

from __future__ import annotations

import dataclasses
import math
import warnings

import numpy as np
import pytest
import yaml

import leg_dynamics as ld
from leg_dynamics.analysis.design import Filter, Objective, Range, Stage, StageResult, Study, gait_path, run
from leg_dynamics.analysis.design.indices import Sampler, step_indices
from leg_dynamics.analysis.design.numbers import learn
from leg_dynamics.analysis.design.poses import Family, Singles
from leg_dynamics.analysis.design.study import Evaluator, Plan, Row
from leg_dynamics.analysis.workspace import PoseEvaluator, workspace
from leg_dynamics.analysis.workspace.constraints import limit_numbers
from leg_dynamics.errors import (
    LegDynamicsError,
    LegDynamicsWarning,
    ParameterError,
    StudyError,
    UnsupportedError,
    WorkspaceError,
)

from . import design_legs

AUDIT_LIMITS = ("clearance", "telescope")
PRIMARY = (Range("a", 0.1, 0.35), Range("b", 0.02, 0.15), Range("l2_min", 0.1, 0.4), Range("l2_max", 0.45, 0.8))


@pytest.fixture(scope="module")
def hexapod():
    return ld.load("hexapod_leg_preliminary")


@pytest.fixture(scope="module")
def evaluator(hexapod):
    """Indices of any design of the primary parameters, by one set of kernels."""
    names = ("V", "kbar", "ktilde", "k_min", "L", "Z", "Z_b", "Z_f")
    study = Study(hexapod, (Stage(PRIMARY, 10),), objectives=names, ignore=AUDIT_LIMITS, tolerance=0.06)
    return Evaluator(Plan.of(study))


# Ranges and filters.


@pytest.mark.parametrize(
    ("text", "found"),
    [("a=0.1:0.35", ("a", 0.1, 0.35, None)), (" l2_max=-1:1e3:7", ("l2_max", -1.0, 1000.0, 7))],
)
def test_range(text, found):
    assert dataclasses.astuple(Range.parse(text)) == found
    assert Range.parse(str(Range.parse(text))) == Range.parse(text)


@pytest.mark.parametrize("text", ["", "a", "a=1", "=1:2", "a=2:1", "a=1:1", "a=nan:1", "a=0:inf", "a=0:1:1", "a=0:1:x"])
def test_bad_range(text):
    with pytest.raises(ParameterError):
        Range.parse(text)


def test_filter():
    each = Filter.parse("L >= 1.0")
    assert (each.name, each.comparison, each.value) == ("L", ">=", 1.0)
    assert each.passes(np.array([0.9, 1.0, 1.1, np.nan])).tolist() == [False, True, True, False]
    assert not Filter.parse("kbar<9").passes(9.0)
    for text in ("L", "L=1", "L>=", "L>=x", "1>=L", "L>=nan"):
        with pytest.raises(StudyError):
            Filter.parse(text)


def test_designs_have_their_own_streams():
    stage = Stage(PRIMARY, 100)
    every = stage.designs(3, 0, range(100))
    assert every[37:41] == stage.designs(3, 0, range(37, 41))
    assert len({tuple(design.values()) for design in every}) == 100
    assert every[0] != stage.designs(4, 0, range(1))[0]
    assert every[0] != stage.designs(3, 1, range(1))[0]
    for each in PRIMARY:
        values = np.array([design[each.name] for design in every])
        assert each.lower < values.min() < values.max() < each.upper
        assert abs(values.mean() - (each.lower + each.upper) / 2.0) < 4.0 * (each.upper - each.lower) / math.sqrt(
            1200.0
        )


def test_sweep_designs():
    stage = Stage((Range("a", 0.1, 0.3, 3), Range("b", 0.0, 1.0, 2)))
    assert stage.designs(0, 0, range(5)) == [{"a": 0.1}, {"a": 0.2}, {"a": 0.3}, {"b": 0.0}, {"b": 1.0}]


# How numbers depend on parameters.


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_numbers_are_those_of_the_rendered_design(hexapod):
    every = (
        *PRIMARY,
        Range("c", 0.02, 0.15),
        Range("e", 0.35, 0.55),
        Range("h", 0.65, 0.75),
        Range("l1_min", 0.4, 0.6),
    )
    found = learn(hexapod, every)
    assert not isinstance(found, str)
    generator = np.random.default_rng(5)
    for _ in range(2):
        design = {each.name: float(generator.uniform(each.lower, each.upper)) for each in every}
        leg = hexapod.replace(**design)
        expected = limit_numbers(leg.description)
        expected |= {f"route {name}": value for name, value in leg.numbers.items()}
        values = dict(zip(found.names, found(design), strict=True))
        home = [values.pop(f"home.{axis}") for axis in "xyz"]
        assert home == pytest.approx([0.0, 0.0, design["h"]], abs=1e-12)
        assert {name: expected[name] for name in values} == pytest.approx(values, rel=1e-12, abs=1e-12)


@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_poses_are_those_of_the_rendered_design(hexapod):
    numbers = learn(hexapod, PRIMARY)
    family = Family(hexapod, numbers, ())
    generator = np.random.default_rng(2)
    for _ in range(2):
        design = {each.name: float(generator.uniform(each.lower, each.upper)) for each in PRIMARY}
        evaluate = PoseEvaluator(hexapod.replace(**design))
        lower, upper, _ = evaluate.box()
        q = lower + (upper - lower) * generator.random((3000, 3))
        expected, found = evaluate(q), family.at(design).poses(q)
        closed = np.isfinite(expected.normalised)
        assert 500 < closed.sum() < 3000
        assert np.array_equal(closed, np.isfinite(found[:, 0]))
        assert found[closed, 0] == pytest.approx(expected.normalised[closed], abs=1e-12)
        assert found[closed, 1] == pytest.approx(expected.condition[closed], rel=1e-7)
        assert found[closed, 3:6] == pytest.approx(expected.foot[closed], abs=1e-12)
        inside = expected.feasible
        feet = family.at(design).feet(expected.foot[inside])
        assert feet[:, 6:] == pytest.approx(q[inside], abs=1e-9)
        assert feet[:, 0] == pytest.approx(found[inside, 0], abs=1e-8)


# Indices, against the audit of Rong 2012 (section 3), the workspace and formulas.


@pytest.mark.parametrize("design", [{}, {"b": 0.15}])
def test_indices_are_those_of_the_workspace(hexapod, evaluator, design):
    row = evaluator.row(0, design)
    found = workspace(hexapod.replace(**design), ignore=AUDIT_LIMITS, tolerance=0.004)
    assert row.status == "ok"
    assert row.values["V"] == pytest.approx(found.volume.value, rel=0.01)
    assert row.values["kbar"] == pytest.approx(found.mean.value, rel=0.01)
    assert row.values["ktilde"] == pytest.approx(found.deviation.value, rel=0.04)
    assert row.values["k_min"] == pytest.approx(found.dexterity.smallest, rel=0.01)
    assert row.values["L"] == pytest.approx(found.step.length, abs=1e-6)
    assert row.values["Z_b"] == row.values["Z"] == pytest.approx(found.step.back, abs=1e-5)
    assert row.values["Z_f"] == pytest.approx(found.step.front, abs=1e-5)


@pytest.mark.parametrize(
    ("design", "audit"),
    [
        ({"a": 0.1}, {"L": 1.125, "Z_b": 0.450, "kbar": 19.4, "ktilde": 5.6}),
        ({"a": 0.35}, {"L": 0.765, "Z_b": 0.252, "kbar": 4.76, "ktilde": 0.90}),
        ({"b": 0.02}, {"L": 1.089, "Z_b": 0.376}),
        ({"b": 0.15}, {"L": 0.952, "Z_b": 0.450, "kbar": 9.05}),
        ({"l2_min": 0.1}, {"Z_f": 0.450}),
        ({"l2_min": 0.4}, {"L": 0.786, "Z_f": 0.227}),
        ({"l2_max": 0.48}, {"L": 0.517, "Z_b": 0.201}),
        ({"l2_max": 0.8}, {"L": 1.010, "Z_b": 0.430, "kbar": 9.18}),
    ],
)
def test_ends_of_figures_3_and_5(evaluator, design, audit):
    values = evaluator.row(0, design).values
    for name, expected in audit.items():
        close = {"rel": 0.01} if name.startswith("k") else {"abs": 0.003}
        assert values[name] == pytest.approx(expected, **close), name


def test_planar_leg_has_formulas(tmp_path):
    leg = design_legs.planar(tmp_path)
    ranges = (Range("l1", 0.3, 0.5, 2), Range("bent", 0.2, 0.8, 2))
    result = run(Study(leg, (Stage(ranges),), tolerance=0.01))
    assert result.plan.numbers is None
    assert "coordinates" in result.plan.why_single
    assert result.plan.resolution.reached
    for row in result.stages[0].rows:
        numbers = {"l1": 0.4, "l2": 0.3, "bent": 0.3, **row.design}
        area, mean, deviation = design_legs.planar_indices(**numbers)
        assert row.values["V"] == pytest.approx(area, rel=0.01)
        assert row.values["kbar"] == pytest.approx(mean, rel=0.01)
        assert row.values["ktilde"] == pytest.approx(deviation, rel=0.02)
    assert result.study.columns == {"l1": "m", "bent": "rad", "V": "m²", "kbar": "1", "ktilde": "1"}


def test_box_has_formulas(tmp_path):
    leg = design_legs.cartesian(tmp_path)
    study = Study(leg, (Stage((Range("wide", 0.3, 0.6, 2),)),), objectives=("V", "kbar", "L", "Z_b", "Z_f"))
    for row in run(study).stages[0].rows:
        wide = row.design["wide"]
        expected = {"V": 3.0 * wide * 2.0 * 0.9, "kbar": 1.0, "L": 3.0 * wide, "Z_b": 0.4, "Z_f": 0.4}
        assert row.values == pytest.approx(expected, rel=1e-6)


STEP = ("L", "Z", "Z_b", "Z_f")


@pytest.mark.parametrize(
    "home",
    [
        {"a": 0.35, "b": 0.02, "l2_max": 0.5579},
        {"a": 0.35, "b": 0.02, "l2_max": 0.5581},
        {"a": 0.1, "b": 0.02, "l2_min": 0.1, "l2_max": 0.45},
        {"a": 0.35, "b": 0.15, "l2_min": 0.4, "l2_max": 0.8},
    ],
)
@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_design_and_workspace_say_the_same_of_home(hexapod, evaluator, home):
    """At home strut 2 of the first two designs is 0.55803 m long: 0.1 mm on either side of its limit."""
    row = evaluator.row(0, home)
    found = workspace(hexapod.replace(**home), ignore=AUDIT_LIMITS, tolerance=0.05)
    assert row.values["V"] == pytest.approx(found.volume.value, rel=0.05)
    if found.step is None:
        assert row.status == "failed"
        assert row.reason == f"WorkspaceError: {found.step_reason}"
        assert "'l2 upper limit'" in row.reason
        assert all(math.isnan(row.values[name]) for name in STEP)
        assert not row.accepted
    else:
        assert row.status == "ok"
        expected = (found.step.length, found.step.back, found.step.back, found.step.front)
        assert [row.values[name] for name in STEP] == pytest.approx(expected, abs=1e-5)
    assert (found.step is None) == (home.get("l2_max") in (0.5579, 0.45))


def test_one_design_by_itself_says_the_same(tmp_path):
    """A box of slides: home at x = 0 is inside as long as the box reaches there."""
    leg = design_legs.cartesian(tmp_path)
    designs = Singles(leg, ())
    inside, outside = designs.at({"high": 0.001}), designs.at({"high": -0.001})
    for one in (inside, outside):
        one.poses(one.lower + (one.upper - one.lower) * Sampler(3, 256, 0).points)
    box = np.array([[-0.5, -1.0, -0.5], [1.0, 1.0, 0.001]])
    assert step_indices(inside, box, 0.0, -1.0)["L"] == pytest.approx(1.5, rel=1e-6)
    with pytest.raises(WorkspaceError, match=r"'z upper limit', margin -0\.001"):
        step_indices(outside, box, 0.0, -1.0)


def test_designs_without_a_step_count_nowhere(hexapod):
    ranges = (Range("l2_max", 0.40, 0.53),)
    result = run(Study(hexapod, (Stage(ranges, 12),), objectives=("V", "L"), tolerance=0.1))
    (stage,) = result.stages
    without = [row for row in stage.rows if math.isnan(row.values["L"])]
    assert 0 < len(without) < 12
    assert all(row.design["l2_max"] < 0.46573 and row.values["V"] > 0.0 for row in without)
    assert all((row.status, row.accepted) == ("failed", False) for row in without)
    assert sum(row.accepted for row in stage.rows) == 12 - len(without)
    with_one = [row for row in stage.rows if row.status == "ok"]
    for name in ("V", "L"):
        assert stage.medians()[name] == np.median([row.values[name] for row in with_one])
    assert f"({len(without)} of 12 designs)" in stage.commonest_reason()
    assert stage.to_dict()["reasons"] == {"WorkspaceError": len(without)}


def test_a_parameter_that_moves_no_pose_can_be_impossible(hexapod):
    """A rod of 56 mm does not fit a bore of 55 mm, which the numbers of the kinematics do not show."""
    study = Study(hexapod, (Stage((Range("rod_2_diameter", 0.054, 0.056, 3),)),), objectives=("V",), tolerance=0.2)
    result = run(study)
    assert result.plan.numbers is not None
    assert [row.status for row in result.stages[0].rows] == ["ok", "ok", "failed"]
    assert "sleeve_2_diameter - 2*sleeve_2_wall = 0.055 m" in result.stages[0].rows[2].reason


def test_reasons_are_alike_but_for_their_numbers(hexapod):
    study = Study(hexapod, (Stage((Range("a", 0.1, 0.3),), 5),), objectives=("V",))
    texts = ["A: l1 = 1e-3 m is bad", "A: l2 = 0.2 m is bad", "A: l2 = -3 m is bad", "B: l1 = 2 m is bad"]
    rows = [Row(k, {"a": 0.2}, "failed", text, {"V": math.nan}, False) for k, text in enumerate(texts)]
    stage = StageResult.of(study, 0, {}, [*rows, Row(4, {"a": 0.2}, "ok", "", {"V": 1.0}, True)])
    assert stage.commonest_reason() == "A: l2 = 0.2 m is bad (2 of 5 designs)"
    assert StageResult.of(study, 0, {}, [stage.rows[4]]).commonest_reason() == ""


# Forces over a gait, mass, and functions of one's own.


def test_motion_and_mass_are_those_of_the_leg(hexapod):
    path = gait_path(hexapod, 2.0, 0.3, 0.1, support_force=(0.0, 0.0, -445.0), samples=40)
    names = ("peak_force", "peak_speed", "peak_power", "mass")
    study = Study(hexapod, (Stage((Range("a", 0.15, 0.25), Range("b", 0.05, 0.1)), 2),), objectives=names, path=path)
    rows = run(study).stages[0].rows
    leg = hexapod.replace(**rows[1].design)
    motion = path.to_joint(leg)
    torque = leg.torque(motion.q, motion.v, motion.a, foot_force=motion.foot_force)
    values = rows[1].values
    assert values["peak_force"] == pytest.approx(np.abs(torque).max(), rel=1e-9)
    assert values["peak_speed"] == pytest.approx(np.abs(motion.v).max(), rel=1e-9)
    assert values["peak_power"] == pytest.approx(np.abs(torque * motion.v).max(), rel=1e-9)
    moving = [
        each.inertial.mass for each in leg.description.links if each.inertial and each.name not in ("base", "hip")
    ]
    assert values["mass"] == pytest.approx(sum(moving))
    assert rows[0].values["mass"] != rows[1].values["mass"]


def test_path_outside_the_workspace_has_no_peak(hexapod):
    path = gait_path(hexapod, 2.0, 3.0, 0.1)
    study = Study(hexapod, (Stage(PRIMARY[:1], 2),), objectives=("peak_speed",), path=path)
    assert all(math.isnan(row.values["peak_speed"]) for row in run(study).stages[0].rows)


def test_own_objective(hexapod):
    own = Objective("low", "m", "foot at home", design_legs.least_height)
    study = Study(hexapod, (Stage((Range("h", 0.6, 0.75),), 3),), objectives=(own,), filters=("low<=0.7",))
    stage = run(study).stages[0]
    for row in stage.rows:
        assert row.values["low"] == pytest.approx(row.design["h"], abs=1e-12)
        assert row.accepted == (row.design["h"] <= 0.7)


@pytest.mark.parametrize("function", [design_legs.divides_by_zero, design_legs.is_text])
def test_own_objective_that_fails_is_a_row(hexapod, function):
    study = Study(hexapod, (Stage(PRIMARY[:1], 1),), objectives=(Objective("own", "1", "", function),))
    (row,) = run(study).stages[0].rows
    assert row.status == "failed"
    assert row.reason.startswith("StudyError: objective 'own'")


def test_dear_objectives_wait_for_the_filters(hexapod):
    study = Study(
        hexapod,
        (Stage(PRIMARY, 12),),
        objectives=("L", "mass"),
        filters=("L>=1.0",),
        ignore=AUDIT_LIMITS,
        tolerance=0.1,
    )
    rows = run(study).stages[0].rows
    assert 0 < sum(row.accepted for row in rows) < 12
    assert all(row.accepted == math.isfinite(row.values["mass"]) for row in rows)


# Studies.


def test_impossible_designs_are_rows(hexapod):
    ranges = (Range("a", -0.02, 0.3, 2), Range("l2_min", 0.3, 0.8, 2))
    rows = run(Study(hexapod, (Stage(ranges),), objectives=("V",), tolerance=0.2)).stages[0].rows
    assert [row.status for row in rows] == ["failed", "ok", "ok", "failed"]
    for row in rows:
        if row.status == "failed":
            kind, _, text = row.reason.partition(": ")
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", LegDynamicsWarning)
                with pytest.raises(LegDynamicsError) as error:
                    hexapod.replace(**row.design)
            assert (kind, text) == (type(error.value).__name__, " ".join(str(error.value).split()))
            assert math.isnan(row.values["V"])
            assert not row.accepted


def test_empty_workspace_is_a_row(hexapod):
    (first, _) = run(Study(hexapod, (Stage((Range("l2_max", 0.3500001, 0.6, 2),)),), objectives=("V",))).stages[0].rows
    assert first.status == "failed" or first.values["V"] < 1e-4


def test_choice_and_files(hexapod, tmp_path):
    study = Study(
        hexapod,
        (Stage(PRIMARY, 24), Stage((Range("c", 0.03, 0.1),), 8)),
        objectives=("L", "Z_b"),
        filters=("L>=1.0", "Z_b>=0.35", "l2_max<=0.78"),
        choose="max:L",
        tolerance=0.2,
        ignore=AUDIT_LIMITS,
        chunk=7,
    )
    result = run(study)
    first, second = result.stages
    accepted = [row for row in first.rows if row.accepted]
    assert 1 < len(accepted) < 24
    for row in first.rows:
        inside = row.values["L"] >= 1.0 and row.values["Z_b"] >= 0.35 and row.design["l2_max"] <= 0.78
        assert row.accepted == inside
    assert first.chosen.values["L"] == max(row.values["L"] for row in accepted)
    assert second.base == first.chosen.design
    assert all(first.chosen.design.items() <= row.design.items() for row in second.rows)
    median = dataclasses.replace(study, choose="median", stages=study.stages[:1])
    middle = StageResult.of(median, 0, {}, list(first.rows)).chosen
    assert middle.accepted
    assert middle != first.chosen

    files = {path.name: path for path in result.write(tmp_path / "out", figures=False)}
    assert {"designs.csv", "summary.json", "chosen.yaml", "chosen.urdf"} <= set(files)
    lines = files["designs.csv"].read_text(encoding="utf-8").splitlines()
    assert len(lines) == 33
    header = lines[0].split(",")
    assert header[:3] == ["stage", "index", "a [m]"]
    assert float(lines[1].split(",")[header.index("L [m]")]) == first.rows[0].values["L"]
    parameters = yaml.safe_load(files["chosen.yaml"].read_text(encoding="utf-8"))
    assert parameters == result.chosen_parameters()
    again = ld.load("hexapod_leg_preliminary", parameters=parameters)
    assert again.description.urdf == files["chosen.urdf"].read_text(encoding="utf-8")
    step = workspace(again, ignore=AUDIT_LIMITS, tolerance=0.05).step
    assert step.length == pytest.approx(result.chosen.values["L"], abs=1e-6)
    reread = ld.load("hexapod_leg_preliminary", urdf=files["chosen.urdf"])
    assert reread.numbers == again.numbers


@pytest.mark.slow
def test_figures_and_page(hexapod, tmp_path):
    from leg_dynamics.analysis.design.page import render_page

    stages = (Stage(PRIMARY[:2], 12), Stage(PRIMARY[3:], 8))
    result = run(Study(hexapod, stages, objectives=("L", "kbar"), filters=("L>=1",), tolerance=0.2))
    names = {path.name for path in result.write(tmp_path)}
    assert {f"{kind}_{stage}.png" for kind in ("histograms", "objectives") for stage in (1, 2)} <= names
    page = render_page(result)
    assert page.count("<figure>") == 4
    assert "://" not in page
    sweep = run(Study(hexapod, (Stage((Range("a", 0.1, 0.3, 4),)),), objectives=("L",), tolerance=0.2))
    assert "sweep_a.png" in {path.name for path in sweep.write(tmp_path)}


@pytest.mark.slow
def test_changed_leg_keeps_its_changes(hexapod):
    changed = hexapod.replace(c=0.06)
    result = run(Study(changed, (Stage(PRIMARY[:1], 3),), objectives=("V",), tolerance=0.1))
    assert result.chosen_parameters() == {"c": 0.06, **result.chosen.design}
    assert result.chosen_leg().parameters["c"].value == 0.06


def test_parquet_is_the_table(hexapod, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow, of the extra parquet, is not installed")
    result = run(Study(hexapod, (Stage(PRIMARY[:1], 5),), objectives=("L",), tolerance=0.1))
    result.write(tmp_path, figures=False)
    assert parquet.read_table(tmp_path / "designs.parquet").to_pydict() == result.table()


def test_no_accepted_design(hexapod):
    stages = (Stage(PRIMARY[:1], 4), Stage(PRIMARY[1:2], 4))
    study = Study(hexapod, stages, objectives=("L",), filters=("L>=2",), tolerance=0.1)
    with pytest.raises(StudyError, match=r"L>=2 holds in 0 % of the designs, the best has 1\.\d+"):
        run(study)
    result = run(dataclasses.replace(study, stages=stages[:1]))
    assert result.chosen is None
    assert result.chosen_leg() is None
    assert "L>=2" in result.stages[0].to_dict()["why_none"]


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"stages": ()}, StudyError, "needs a stage"),
        ({"stages": (Stage((Range("aa", 0.1, 0.2),), 1),)}, ParameterError, "did you mean 'a'"),
        ({"stages": (Stage((Range("a", 0.1, 0.2), Range("a", 0.1, 0.3)), 1),)}, ParameterError, "twice"),
        ({"stages": (Stage(PRIMARY[:1], 1), Stage(PRIMARY[:1], 1))}, ParameterError, "twice"),
        ({"stages": (Stage((Range("a", 0.1, 0.2, 2),)), Stage(PRIMARY[1:], 1))}, StudyError, "sweep"),
        ({"objectives": ("kba",)}, ParameterError, "did you mean 'kbar'"),
        ({"objectives": ("L", "L")}, ParameterError, "twice|different"),
        ({"objectives": ("peak_force",)}, StudyError, "gait"),
        ({"objectives": (Objective("own", "1", "", lambda leg: 1.0),)}, StudyError, "lambda"),
        ({"objectives": (Objective("L", "1", "", design_legs.least_height),)}, StudyError, "name"),
        ({"filters": ("lenght>=1",)}, ParameterError, "lenght"),
        ({"ignore": ("cones",)}, ParameterError, "cone"),
        ({"choose": "best"}, StudyError, "median"),
        ({"choose": "min:kbar"}, StudyError, "min:kbar"),
        ({"seed": -1}, StudyError, "seed"),
        ({"tolerance": 0.0}, StudyError, "tolerance"),
        ({"chunk": 0}, StudyError, "chunk"),
    ],
)
def test_unusable_study(hexapod, changes, error, words):
    given = {"stages": (Stage(PRIMARY, 1),), "objectives": ("L",)} | changes
    with pytest.raises(error, match=words):
        Study(hexapod, **given)


def test_unusable_stage():
    with pytest.raises(StudyError, match="no parameter"):
        Stage(())
    with pytest.raises(StudyError, match="samples"):
        Stage(PRIMARY, 0)
    with pytest.raises(StudyError, match="either sweeps or samples"):
        Stage((PRIMARY[0], Range("b", 0.0, 1.0, 3)))


def test_leg_that_cannot_be_studied(hexapod, tmp_path):
    plain = ld.load(hexapod.description.urdf, route="pinocchio", foot="foot")
    with pytest.raises(ParameterError, match="no named parameters"):
        Study(plain, (Stage(PRIMARY, 1),))
    with pytest.raises(UnsupportedError, match="three coordinates"):
        Study(design_legs.planar(tmp_path), (Stage((Range("l1", 0.1, 0.2),), 1),), objectives=("L",))


@pytest.mark.slow
def test_resolution_that_is_out_of_reach_is_said(hexapod):
    study = Study(hexapod, (Stage(PRIMARY, 1),), objectives=("V",), tolerance=0.00001)
    with pytest.warns(LegDynamicsWarning, match="NOT within"):
        plan = Plan.of(study)
    assert plan.resolution.samples == 1 << 17


@pytest.mark.parametrize("length", [0.11, 0.14, 0.18, 0.2])
def test_a_home_on_the_edge_counts_for_design_and_workspace(length):
    """The OmniLeg is straight at home: the last digit of its reach decides nothing."""
    leg = ld.load("omnileg")
    study = Study(leg, (Stage((Range("L1", 0.1, 0.2),), 1),), objectives=("L", "Z_b"), tolerance=0.1)
    row = Evaluator(Plan.of(study)).row(0, {"L1": length})
    step = workspace(leg.replace(L1=length), tolerance=0.1).step
    assert row.status == "ok", row.reason
    assert row.values["L"] == pytest.approx(0.0, abs=1e-6)
    assert step.length == pytest.approx(0.0, abs=1e-6)
    assert row.values["Z_b"] == pytest.approx(step.back, rel=1e-4)
