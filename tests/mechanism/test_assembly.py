from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse
from leg_dynamics.errors import AssemblyError, DescriptionError, LegDynamicsWarning, SingularityError
from leg_dynamics.mechanism.assembly import find_closed_poses
from leg_dynamics.mechanism.mechanism import CONTINUATION_STEP, FARTHEST, Mechanism

from ..five_bar import five_bar


def values(mechanism, state):
    return dict(zip(mechanism.tree.joint_names, state.q, strict=True))


def cold(mechanism, y):
    """The pose as a mechanism that has closed nothing yet finds it."""
    mechanism.forget(every_pose=True)
    return mechanism.close(np.atleast_1d(np.asarray(y, dtype=float)))


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
@pytest.mark.parametrize("mode", [1.0, -1.0])
def test_both_modes_of_a_four_bar_all_the_way_round(lab, mode, kind):
    linkage = lab.FourBar()
    mechanism = Mechanism(parse(linkage.text(0.6, mode, kind=kind).xml))
    for theta in np.linspace(-3.1, 3.1, 60):
        for state in (mechanism.close(np.array([theta])), cold(mechanism, theta)):
            got = values(mechanism, state)
            coupler, rocker = linkage.angles(theta, mode)
            assert math.cos(got["rocker"] - rocker) == pytest.approx(1.0, abs=1e-14)
            assert math.remainder(got["rocker"] - rocker, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)
            assert math.remainder(got["coupler"] - coupler, 2 * math.pi) == pytest.approx(0.0, abs=1e-12)
            assert state.residual <= 1e-13


def toggling(lab):
    """A four-bar whose crank cannot pass the pose where coupler and rocker are stretched."""
    linkage = lab.FourBar(ground=0.4, crank=0.3, coupler=0.25, rocker=0.2)
    reach = math.acos((0.3**2 + 0.4**2 - 0.45**2) / (2 * 0.3 * 0.4))
    return linkage, reach


@pytest.mark.parametrize("mode", [1.0, -1.0])
@pytest.mark.parametrize("gap", [1e-2, 1e-4, 3e-6])
def test_close_to_a_dead_centre_the_mode_is_kept(lab, mode, gap):
    linkage, reach = toggling(lab)
    mechanism = Mechanism(parse(linkage.text(0.9, mode).xml))
    theta = reach - gap
    got = values(mechanism, cold(mechanism, theta))
    coupler, rocker = linkage.angles(theta, mode)
    assert math.remainder(got["rocker"] - rocker, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert math.remainder(got["coupler"] - coupler, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("beyond", [1e-3, 0.1, 1.0])
def test_a_pose_out_of_reach_is_an_assembly_error_with_its_evidence(lab, beyond):
    linkage, reach = toggling(lab)
    mechanism = Mechanism(parse(linkage.text(0.9).xml))
    theta = reach + beyond
    with pytest.raises(AssemblyError, match=r"crank = .*followed to .*residual cannot be made smaller") as caught:
        cold(mechanism, theta)
    error = caught.value
    assert error.reached == pytest.approx([reach], abs=1e-5)
    assert error.reached < reach
    span = math.sqrt(0.3**2 + 0.4**2 - 2 * 0.3 * 0.4 * math.cos(theta)) - 0.45
    # the pin is missed by the whole gap at the best pose, relative to the mechanism's length
    assert error.residual == pytest.approx(span / mechanism.closure.length, rel=1e-3)
    assert error.margin[0] < 0.0
    # and the leg still works
    assert cold(mechanism, reach - 0.1).residual < 1e-12


def test_an_antiparallel_way_out_of_reach_does_not_break_the_warm_start(lab):
    linkage, reach = toggling(lab)
    mechanism = Mechanism(parse(linkage.text(0.9).xml))
    before = mechanism.close(np.array([reach - 0.05])).q.copy()
    with pytest.raises(AssemblyError):
        mechanism.close(np.array([reach + 0.05]))
    np.testing.assert_allclose(mechanism.close(np.array([reach - 0.05])).q, before, atol=1e-14)


@pytest.mark.parametrize("copies", [1, 2, 3])
@pytest.mark.parametrize("target", [-0.8, -1e-3, 0.0])
def test_no_branch_is_taken_through_a_flat_parallelogram(lab, copies, target):
    """At the flat pose the linkage may go on as a parallelogram or fold; an even number of sign changes counts too."""
    mechanism = Mechanism(parse(lab.parallelogram(0.8, copies).xml))
    with pytest.raises((SingularityError, AssemblyError)) as caught:
        cold(mechanism, target)
    if target != 0.0:
        assert isinstance(caught.value, SingularityError)
        assert "assembly modes meet" in str(caught.value)
        assert 0.0 < caught.value.margin[0] < 1e-2
    assert 0.0 < caught.value.reached[0] < 1e-2


@pytest.mark.parametrize("copies", [1, 2])
def test_no_branch_is_taken_by_small_warm_steps_either(lab, copies):
    mechanism = Mechanism(parse(lab.parallelogram(0.2, copies).xml))
    mechanism.close(np.array([0.2]))
    failed_at = None
    for theta in np.arange(0.2, -0.3, -0.013):
        try:
            state = mechanism.close(np.array([theta]))
        except (SingularityError, AssemblyError):
            failed_at = theta
            break
        got = values(mechanism, state)
        assert got["rocker0"] == pytest.approx(theta, abs=1e-12)
    assert failed_at is not None
    assert failed_at < 0.0


def test_up_to_the_flat_pose_the_parallelogram_stays_one(lab):
    mechanism = Mechanism(parse(lab.parallelogram(0.8, 2).xml))
    for theta in (1e-3, 1e-5, math.pi - 1e-4):
        got = values(mechanism, cold(mechanism, theta))
        for i in (0, 1):
            assert got[f"rocker{i}"] == pytest.approx(theta, abs=1e-9)


@pytest.mark.parametrize("loop", ["revolute", "prismatic"])
def test_slider_crank_follows_its_closed_form(lab, loop):
    mechanism = Mechanism(parse(lab.slider_crank(loop=loop).xml))
    for theta in np.linspace(-6.0, 6.0, 41):
        state = cold(mechanism, theta)
        got = values(mechanism, state)
        if loop == "revolute":
            assert got["slide"] + 0.2 == pytest.approx(lab.slider_reach(theta), abs=1e-13)
        assert math.sin(got["rod"] + got["crank"]) == pytest.approx(-math.sin(theta) / 3.0, abs=1e-12)


@pytest.mark.parametrize("kind", ["spherical", "universal", "planar", "fixed", "revolute", "continuous", "prismatic"])
def test_warm_start_equals_cold_start_on_random_loops(lab, kind):
    mechanism = lab.closed_mechanism(kind, 1)
    home = mechanism.seeds[0].y
    rng = np.random.default_rng(2)
    compared = 0
    for _ in range(6):
        direction = rng.normal(size=mechanism.n) * mechanism.closure.coordinate_unit[mechanism.independent]
        mechanism._workspace.last = mechanism.seeds[0]
        for step in np.linspace(0, 0.4, 9)[1:]:
            y = home + step * direction / np.linalg.norm(direction)
            try:
                warm = mechanism.close(y)
            except (AssemblyError, SingularityError):
                break
            np.testing.assert_allclose(cold(mechanism, y).q, warm.q, atol=1e-10)
            compared += 1
    assert compared >= 20


def test_rounded_configurations_are_corrected(lab):
    linkage = lab.FourBar()
    exact = Mechanism(parse(linkage.text(0.6).xml))
    rounded = Mechanism(parse(linkage.text(0.6, decimals=2).xml))
    assert rounded.seeds[0].residual < 1e-12
    np.testing.assert_allclose(rounded.close(np.array([0.9])).q, exact.close(np.array([0.9])).q, atol=1e-12)


def test_without_a_configuration_a_closed_zero_pose_serves(lab):
    text = lab.slider_crank()
    text.parts = [part for part in text.parts if "<configuration" not in part]
    mechanism = Mechanism(parse(text.xml.replace('xyz="0.2 0.0 0.0"', 'xyz="0.4 0.0 0.0"')))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(mechanism.seeds[0].q, 0.0, atol=1e-12)


def test_without_a_configuration_the_nearest_pose_is_chosen_the_same_way_each_time(lab):
    linkage = lab.FourBar()
    xml = linkage.text(home=False).xml
    seeds = []
    for _ in range(2):
        with pytest.warns(LegDynamicsWarning, match=r"gives no configuration; .*other assembly modes.*mode_"):
            seeds.append(Mechanism(parse(xml)).seeds)
    assert len(seeds[0]) == 1
    np.testing.assert_array_equal(seeds[0][0].q, seeds[1][0].q)
    assert seeds[0][0].residual < 1e-12


@pytest.mark.parametrize(
    ("hinge", "loop", "what"),
    [
        (1.57, 1.57, "one of the rows counts by"),
        (1.5708, 1.57, "smallest residual found is [0-9.]+, in pin; "),
        (math.pi / 2, math.pi / 2, None),
    ],
)
def test_rounded_angles_are_named_as_the_reason(hinge, loop, what):
    """A planar linkage in space whose hinges are parallel but for the rounding of a right angle."""
    turned = f'<origin xyz="0.2 0 0" rpy="{-hinge} 0 0"/><axis xyz="0 0 1"/>'
    text = five_bar().replace('<origin xyz="0.2 0 0"/><axis xyz="0 1 0"/>', turned, 1)
    text = text.replace(
        '<predecessor link="a2"><origin xyz="0.25 0 0"/>',
        f'<predecessor link="a2"><origin xyz="0.25 0 0" rpy="{loop} 0 0"/>',
    )
    mechanism = Mechanism(parse(text))
    if what is None:
        assert mechanism.seeds[0].residual < 1e-12
        return
    with pytest.raises((AssemblyError, DescriptionError), match=f"{what}.*rounded.*fewer rows"):
        _ = mechanism.seeds
    with pytest.raises((AssemblyError, DescriptionError), match=r"rounded.*fewer rows"):
        ld.load(text).home  # noqa: B018


def test_an_open_home_starts_a_multi_start_with_a_warning(lab):
    text = lab.FourBar().text(home=False).configuration("home", {"crank": 0.6, "coupler": 0.2, "rocker": 0.2})
    mechanism = Mechanism(parse(text.xml))
    with pytest.warns(LegDynamicsWarning, match="open or singular configuration 'home'"):
        assert mechanism.seeds[0].residual < 1e-12


def test_a_singular_home_with_a_regular_second_configuration_uses_that_one(lab):
    text = lab.parallelogram(0.0).configuration("bent", {"crank": 0.5, "coupler0": -0.5, "rocker0": 0.5})
    mechanism = Mechanism(parse(text.xml))
    with pytest.warns(LegDynamicsWarning, match="'home' is open or singular"):
        seeds = mechanism.seeds
    assert [seed.y[0] for seed in seeds] == [0.5]


def test_further_configurations_of_the_same_mode_are_further_seeds(lab):
    linkage = lab.FourBar()
    text = linkage.text(0.6, 1.0)
    for name, theta, mode in (("high", 2.5, 1.0), ("flipped", 1.0, -1.0)):
        coupler, rocker = linkage.angles(theta, mode)
        text.configuration(name, {"crank": theta, "coupler": coupler, "rocker": rocker})
    seeds = Mechanism(parse(text.xml)).seeds
    assert [round(seed.y[0], 6) for seed in seeds] == [0.6, 2.5]


def test_a_pose_behind_the_first_seeds_obstacle_is_found_from_another_seed(lab):
    linkage, reach = toggling(lab)
    mechanism = Mechanism(parse(linkage.text(0.9).xml))
    assert reach < 2.0
    poses = find_closed_poses(mechanism, mechanism.seeds[0].q)
    assert len(poses) >= 2
    for pose in poses:
        assert pose.residual < 1e-10
        assert pose.smallest_pivot > 1e-3
    distances = [np.linalg.norm(pose.q - mechanism.seeds[0].q) for pose in poses]
    assert distances == sorted(distances)


def test_an_impossible_linkage_says_so(lab):
    xml = lab.FourBar(ground=2.0, crank=0.1, coupler=0.3, rocker=0.2).text(home=False).xml
    with pytest.raises(AssemblyError, match=r"no regular closed pose of 'four_bar'.*add a <configuration>"):
        Mechanism(parse(xml)).close(np.array([0.1]))


def test_absurdly_far_coordinates_are_refused_at_once(lab):
    mechanism = Mechanism(parse(lab.FourBar().text().xml))
    with pytest.raises(AssemblyError, match="take whole turns off"):
        mechanism.close(np.array([FARTHEST + 10.0]))
    with pytest.raises(AssemblyError, match="take whole turns off"):
        cold(mechanism, np.nan)


def test_couplings_alone_are_closed_in_one_step_however_far(lab):
    mechanism = Mechanism(parse(lab.gears().xml))
    got = values(mechanism, cold(mechanism, 2000.0))
    assert got["driven"] == pytest.approx(-5000.0)
    assert got["rack"] == pytest.approx(0.05 * 2000.0 + 0.03)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_size_does_not_matter(lab, scale):
    """Millimetres or a kilometre: the same poses, the same verdicts."""
    linkage, reach = toggling(lab)
    text = linkage.text(0.9, scale=scale)
    mechanism = Mechanism(parse(text.xml))
    for theta in (0.5, reach - 1e-3):
        _, rocker = linkage.angles(theta, 1.0)
        got = values(mechanism, cold(mechanism, theta))
        assert math.remainder(got["rocker"] - rocker, 2 * math.pi) == pytest.approx(0.0, abs=1e-8)
    with pytest.raises(AssemblyError):
        cold(mechanism, reach + 1e-3)


def test_the_omnileg_finds_the_papers_branch_from_cold(lab, omnileg, omnileg_box):
    rng = np.random.default_rng(3)
    worst = 0.0
    for y in rng.uniform(*omnileg_box, (300, 3)):
        got, expected = values(omnileg, cold(omnileg, y)), lab.omnileg_tree(y)
        worst = max(worst, *(abs(got[name] - expected[name]) for name in expected))
    assert set(expected) == set(got)
    assert worst < 1e-11


@pytest.mark.slow
def test_the_omnileg_finds_the_papers_branch_2000_times(lab, omnileg, omnileg_box):
    rng = np.random.default_rng(4)
    for y in rng.uniform(*omnileg_box, (2000, 3)):
        got, expected = values(omnileg, omnileg.close(y)), lab.omnileg_tree(y)
        assert max(abs(got[name] - expected[name]) for name in expected) < 1e-11, y


def test_a_pose_followed_from_a_seed_is_followed_once(lab, monkeypatch):
    mechanism = lab.closed_mechanism("universal", 1)
    seed = mechanism.seeds[0]
    far = seed.y + 1.2 * CONTINUATION_STEP * mechanism.closure.coordinate_unit[mechanism.independent]
    first = mechanism.close(far)
    mechanism.forget()
    with monkeypatch.context() as patch:
        patch.setattr(mechanism, "follow", None)
        again = mechanism.close(far)
    assert again is not first
    np.testing.assert_allclose(again.q, first.q, atol=1e-14)
    np.testing.assert_allclose(again.G, first.G, atol=1e-12)
    # Whoever changes a result changes no memory.
    again.q[:] = np.nan
    mechanism.forget()
    np.testing.assert_array_equal(mechanism.close(far).q, first.q)
    mechanism.forget(every_pose=True)
    monkeypatch.setattr(mechanism, "follow", None)
    with pytest.raises(TypeError):
        mechanism.close(far)


def test_a_pose_of_another_mode_is_followed_anew(lab):
    linkage, theta = lab.FourBar(), np.array([1.1])
    mechanism, crossed = (Mechanism(parse(linkage.text(0.6, mode).xml)) for mode in (1.0, -1.0))
    before = mechanism.close(theta).q
    there = crossed.close(theta).q
    assert not np.allclose(before, there, atol=0.1)
    mechanism.adopt_seeds(crossed.seeds)
    mechanism.forget()
    np.testing.assert_allclose(mechanism.close(theta).q, there, atol=1e-12)


def test_only_so_many_poses_are_kept(lab, monkeypatch):
    monkeypatch.setattr("leg_dynamics.mechanism.mechanism.KNOWN_POSES", 3)
    mechanism = lab.closed_mechanism("universal", 1)
    unit = mechanism.closure.coordinate_unit[mechanism.independent]
    ways = [mechanism.seeds[0].y + share * unit for share in (0.31, 0.32, 0.33, 0.34)]
    for y in ways:
        mechanism.forget()
        mechanism.close(y)
    assert [y.tobytes() in mechanism._workspace.followed for y in ways] == [False, True, True, True]
