from __future__ import annotations

import json
import re

import numpy as np
import pytest
from rich.console import Console

from leg_dynamics.description import parse
from leg_dynamics.errors import AssemblyError, DescriptionError, ShapeError, SingularityError
from leg_dynamics.mechanism.mechanism import Mechanism
from leg_dynamics.mechanism.mobility import mobility_report, pose_rank, project


def without_gears(description, *, independent=()):
    """The OmniLeg with its bevel couplings taken out; joints named in `independent` become independent as well."""
    xml = re.sub(r"<coupling.*?</coupling>", "", description.urdf, flags=re.DOTALL)
    for joint in independent:
        xml, count = re.subn(rf'(<joint[^>]*name="{joint}"[^>]*independent=")false', r"\1true", xml)
        if count == 0:
            xml, count = re.subn(rf'(<joint[^>]*independent=")false("[^>]*name="{joint}")', r"\1true\2", xml)
        assert count == 1
    return parse(xml)


def test_the_omnileg_has_mobility_3_and_9_redundant_rows_everywhere(omnileg, omnileg_box):
    rng = np.random.default_rng(0)
    poses = [np.zeros(3), np.array([0.5, -0.3, 0.0]), *np.radians([[65, 65, 85], [-65, 65, 0], [65, -65, -45]])]
    near_zero = [np.array([0.4, 0.2, g]) for g in (1e-3, 1e-6, 1e-9)]
    for y in [*poses, *near_zero, *rng.uniform(*omnileg_box, (40, 3))]:
        rank = pose_rank(omnileg, omnileg.close(y).q, "any")
        assert (rank.rank, rank.redundant, rank.mobility, rank.dependent_rank) == (19, 9, 3, 19)
        counted, uncounted = rank.gap
        assert counted > 1e-3
        assert uncounted < 1e-12


def test_the_omnilegs_report(omnileg):
    report = mobility_report(omnileg, samples=5)
    assert (report.joints, report.rows, report.gruebler) == (22, 28, -6)
    assert (report.mobility, report.redundant, report.independent, report.actuators) == (3, 9, 3, 3)
    assert [pose.pose for pose in report.poses] == ["home", "bent", *(f"random {i}" for i in range(1, 6))]
    assert report.special_poses == ()
    assert json.loads(json.dumps(report.to_dict()))["mobility"] == 3
    console = Console(width=140, record=True)
    console.print(report)
    shown = console.export_text()
    assert "Gruebler -6, true mobility 3" in " ".join(shown.split())
    assert mobility_report(omnileg, samples=5) == report


def test_without_gears_the_straight_pose_has_mobility_6(omnileg_description):
    mechanism = Mechanism(without_gears(omnileg_description), "foot", "hip")
    report = mobility_report(mechanism, samples=6)
    by_name = {pose.pose: pose for pose in report.poses}
    assert by_name["home"].mobility == 6
    assert by_name["bent"].mobility == 4
    assert report.mobility == 4
    assert [pose.pose for pose in report.special_poses] == ["home"]
    assert report.gruebler == -3


def test_without_gears_three_flags_are_too_few_and_no_number_comes_out(omnileg_description):
    mechanism = Mechanism(without_gears(omnileg_description), "foot", "hip")
    for y in (np.zeros(3), np.array([0.0, 0.0, 0.7])):
        with pytest.raises(
            DescriptionError, match=r"3 joints are independent .*mobility is 4 .*mark more joints"
        ) as caught:
            mechanism.close(y)
        assert (caught.value.mobility, caught.value.independent) == (4, 3)


def test_without_gears_a_leg_is_not_folded_through_the_straight_pose(omnileg_description):
    """Each shank chain may fold either way at gamma = 0: two singular values pass through zero at once."""
    description = without_gears(omnileg_description, independent=("gamma_C1",))
    mechanism = Mechanism(description, "foot", "hip")
    with pytest.warns(UserWarning, match="'home' is open or singular"):
        seed = mechanism.seeds[0]
    assert mechanism.n == 4
    shank = mechanism.joint_names.index("gamma_C1")
    bent = seed.y.copy()
    bent[shank] = 0.02
    state = mechanism.close(bent)
    got = dict(zip(mechanism.tree.joint_names, state.q, strict=True))
    assert [got[f"phi_D{i}"] for i in (1, 2, 3)] == pytest.approx([-0.04] * 3, abs=1e-10)
    for target in (0.0, -0.02, -0.5):
        beyond = bent.copy()
        beyond[shank] = target
        for forget in (False, True):
            if forget:
                mechanism.forget(every_pose=True)
            with pytest.raises(SingularityError, match="singular"):
                mechanism.close(beyond)


# --------------------------------------------------------------------------------------------- flags against mobility


@pytest.mark.parametrize("theta", [0.6, 0.9])
def test_too_many_independent_joints_are_an_error_even_at_the_closed_home(lab, theta):
    """At the file's own pose all rows are zero: least squares would return a torque that means nothing."""
    for flags, flagged in (((True, True, True), 3), ((True, True, False), 2), ((True, False, True), 2)):
        mechanism = Mechanism(parse(lab.FourBar().text(0.6, flags=flags).xml))
        y = np.array([lab.FourBar().angles(0.6, 1.0)[0] if n == "coupler" else theta for n in mechanism.joint_names])
        for attempt in (mechanism.seeds[0].y if mechanism._seeds else y, y):
            with pytest.raises(
                DescriptionError, match=f"{flagged} joints are independent .*mobility is 1 .*cannot move"
            ) as caught:
                mechanism.close(attempt)
            assert (caught.value.mobility, caught.value.independent) == (1, flagged)


def test_too_many_independent_joints_where_the_pose_is_a_special_one(omnileg_description):
    """At gamma = 0 without gears the rank itself allows 6 motions; nearby there are 4."""
    description = without_gears(omnileg_description, independent=("gamma_C1", "gamma_C2", "gamma_C3"))
    mechanism = Mechanism(description, "foot", "hip")
    with pytest.raises(DescriptionError, match=r"6 joints are independent .*mobility is 4 "):
        mechanism.close(np.zeros(6))


def test_too_few_independent_joints_are_an_error(lab):
    """A five-bar with one flag: enough rows, but the plane repeats them."""
    text = lab.Text().joint("a", "revolute", "base", "one", independent=True)
    text.joint("b", "revolute", "one", "two", xyz=(0.2, 0, 0), independent=False)
    text.joint("c", "revolute", "two", "three", xyz=(0.2, 0, 0), independent=False)
    text.joint("d", "revolute", "base", "four", xyz=(0.4, 0, 0), independent=False)
    text.loop("pin", "revolute", ("three", (0.2, 0, 0), lab.ZERO), ("four", (0.2, 0, 0), lab.ZERO))
    mechanism = Mechanism(parse(text.xml))
    with pytest.raises(DescriptionError, match=r"1 joints are independent \(a\) .*mobility is 2 .*1 motions") as caught:
        mechanism.close(np.array([0.5]))
    assert (caught.value.mobility, caught.value.independent) == (2, 1)


def test_too_few_rows_are_an_error_at_once(lab):
    text = lab.Text().joint("a", "revolute", "base", "one", independent=True)
    for name, parent, child in (
        ("b", "one", "two"),
        ("c", "two", "three"),
        ("d", "three", "four"),
        ("e", "four", "five"),
    ):
        text.joint(name, "revolute", parent, child, (1, 0, 0), (0.2, 0, 0), independent=False)
    text.loop("ball", "spherical", ("five", lab.ZERO, lab.ZERO), ("base", (0.3, 0, 0), lab.ZERO), None)
    with pytest.raises(
        DescriptionError, match=r"4 dependent joints but only 3 loop and coupling rows: .* at least 2 free motions"
    ):
        Mechanism(parse(text.xml))


def test_the_right_number_of_the_wrong_joints_is_an_error(lab):
    """A wheel beside a four-bar: flagged are crank and rocker, the wheel is left over."""
    text = lab.FourBar().text(flags=(True, False, True))
    text.joint("wheel", "revolute", "base", "wheel_link", independent=False)
    mechanism = Mechanism(parse(text.xml))
    with pytest.raises(DescriptionError, match=r"2 joints are independent .*mobility is 2 .*mark other joints"):
        mechanism.close(mechanism.search_box()[0][mechanism.independent] * 0.0 + 0.6)


def test_right_flags_pass_at_special_and_ordinary_poses(lab):
    for text in (
        lab.FourBar().text(),
        lab.slider_crank(),
        lab.slider_crank(theta=0.0),
        lab.gears(),
        lab.parallelogram(0.8, 3),
    ):
        assert Mechanism(parse(text.xml)).seeds[0].residual < 1e-12
    for kind in lab.LOOP_ROWS:
        mechanism = lab.closed_mechanism(kind, 2)
        rank = pose_rank(mechanism, mechanism.seeds[0].q, "seed")
        assert (rank.mobility, rank.redundant) == (8 - lab.LOOP_ROWS[kind], 0)


def test_the_report_answers_for_wrong_flags_too(lab):
    report = mobility_report(Mechanism(parse(lab.FourBar().text(flags=(True, True, True)).xml)), samples=5)
    assert (report.mobility, report.independent, report.gruebler) == (1, 3, -2)


def test_a_report_without_any_closed_pose_is_an_error(lab):
    xml = lab.FourBar(ground=2.0, crank=0.1, coupler=0.3, rocker=0.2).text(home=False).xml
    for samples in (0, 3):
        with pytest.raises(AssemblyError, match="closed pose"):
            mobility_report(Mechanism(parse(xml)), samples=samples)


def test_an_open_chain_has_the_mobility_of_its_joints(lab):
    report = mobility_report(Mechanism(parse(lab.open_chain().xml)), samples=2)
    assert (report.mobility, report.gruebler, report.redundant, report.rows) == (3, 3, 0, 0)


def test_rounded_configurations_are_closed_before_their_rank_is_taken(lab):
    """At an open pose the redundant rows of a planar linkage are independent of the others."""
    report = mobility_report(Mechanism(parse(lab.FourBar().text(decimals=3).xml)), samples=1)
    home = report.poses[0]
    assert (home.pose, home.rank, home.mobility) == ("home", 2, 1)
    assert home.residual < 1e-11


def test_project_finds_a_closed_pose_without_flags(lab):
    mechanism = lab.closed_mechanism("universal", 0)
    start = mechanism.seeds[0].q + 0.05
    closed = project(mechanism, start)
    assert np.linalg.norm(mechanism.evaluate(closed).residual) < 1e-11
    assert np.abs(closed - start).max() < 0.2
    impossible = Mechanism(parse(lab.FourBar(ground=2.0, crank=0.1, coupler=0.3, rocker=0.2).text(home=False).xml))
    assert project(impossible, np.ones(3)) is None


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_ranks_do_not_depend_on_the_mechanisms_size(lab, scale):
    mechanism = Mechanism(parse(lab.FourBar().text(scale=scale).xml))
    rank = pose_rank(mechanism, mechanism.seeds[0].q, "home")
    assert (rank.rank, rank.mobility) == (2, 1)
    assert rank.gap[0] > 1e-2


@pytest.mark.parametrize("name", ["samples", "seed"])
@pytest.mark.parametrize("value", ["x", -1, 1.5, None, True])
def test_samples_and_seed_must_be_whole_numbers(lab, name, value):
    mechanism = Mechanism(parse(lab.open_chain().xml))
    with pytest.raises(ShapeError, match=f"{name} must be a whole number"):
        mobility_report(mechanism, **{name: value})
    assert mobility_report(mechanism, **{name: np.int64(1)}).mobility == 3


def test_a_single_joint_whose_loop_cannot_close_has_no_report(lab):
    text = lab.Text("stiff").joint("turn", "continuous", "base", "body")
    text.loop("weld", "fixed", ("base", lab.ZERO, lab.ZERO), ("body", (5, 0, 0), lab.ZERO), None)
    with pytest.raises(AssemblyError, match="no regular closed pose"):
        mobility_report(Mechanism(parse(text.xml)))
