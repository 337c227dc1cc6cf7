"""Volumes, boundaries and step sizes against legs whose workspace has a formula, and the errors."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.dexterity import home_coordinates
from leg_dynamics.analysis.workspace import PoseEvaluator, reachable_set, workspace
from leg_dynamics.analysis.workspace.page import render_page
from leg_dynamics.analysis.workspace.sampling import choose_sign
from leg_dynamics.errors import LegDynamicsWarning, MissingFootError, ParameterError, UnsupportedError, WorkspaceError

from . import workspace_legs as legs


@pytest.fixture(scope="module")
def sector():
    """A polar leg in a cone: a spherical sector about x."""
    text = legs.polar(legs.cone(0.6), azimuth=(-1.2, 1.2), elevation=(-1.2, 1.2), radius=(0.5, 1.0))
    return legs.load(text)


def sector_volume(half_angle=0.6, low=0.5, high=1.0):
    return 2.0 * math.pi * (1.0 - math.cos(half_angle)) * (high**3 - low**3) / 3.0


def within(estimate, true):
    return abs(estimate.value - true) <= max(estimate.half_width, 1e-12 * true)


def test_a_box_is_exact():
    found = workspace(legs.load(legs.cartesian(x=(-0.5, 1.0), y=(0.0, 1.0), z=(-1.0, -0.5))))
    assert found.volume.value == pytest.approx(0.75, rel=1e-12)
    assert found.unit == "m³"
    np.testing.assert_allclose(found.lower, [-0.5, 0.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(found.upper, [1.0, 1.0, -0.5], atol=1e-9)
    assert found.mean.value == pytest.approx(1.0)
    assert found.deviation.value == pytest.approx(0.0, abs=1e-7)
    assert (found.dexterity.unit, found.dexterity.characteristic_length) == ("m/m", None)
    assert set(found.border_shares()) == {f"{axis} {side} limit" for axis in "xyz" for side in ("lower", "upper")}
    assert found.injectivity.several == 0.0
    assert within(found.injectivity.cartesian, 0.75)


def test_an_obstacle_is_cut_out():
    found = workspace(legs.load(legs.cartesian(legs.ball(0.8))), tolerance=0.005)
    true = 8.0 - 4.0 / 3.0 * math.pi * 0.8**3
    assert within(found.volume, true)
    assert within(found.injectivity.cartesian, true)
    assert found.volume.half_width <= 0.005 * found.volume.value
    on_ball = found.border_active == [c.name for c in found.constraints].index("clearance ball")
    np.testing.assert_allclose(np.linalg.norm(found.border.foot[on_ball], axis=1), 0.8, atol=1e-9)
    on_faces = np.abs(found.border.foot[~on_ball]).max(axis=1)
    np.testing.assert_allclose(on_faces, 1.0, atol=1e-9)
    # no home position inside the obstacle: said, not invented
    assert found.step is None
    assert "clearance ball" in found.step_reason


def test_a_cone_makes_a_spherical_sector(sector):
    found = workspace(sector, tolerance=0.004)
    assert within(found.volume, sector_volume())
    assert within(found.injectivity.cartesian, sector_volume())
    sine = math.sin(0.6)
    np.testing.assert_allclose(found.lower, [0.5 * math.cos(0.6), -sine, -sine], atol=1e-6)
    np.testing.assert_allclose(found.upper, [1.0, sine, sine], atol=1e-6)
    assert set(found.border_shares()) == {"cone tip", "radius lower limit", "radius upper limit"}
    np.testing.assert_allclose(found.weights.sum(), found.volume.value, rtol=1e-12)


def test_step_sizes_of_a_box():
    leg = legs.load(legs.cartesian(x=(-0.5, 0.7), y=(-1.0, 1.0), z=(-1.0, 0.4)))
    step = workspace(leg, tolerance=0.02).step
    assert step.length == pytest.approx(1.2, abs=1e-6)
    assert (step.start_limit, step.end_limit) == ("x lower limit", "x upper limit")
    assert (step.longest, step.extent) == pytest.approx((1.2, 1.2), abs=1e-6)
    # z points up here: the foot lifts towards the greatest z
    assert (step.front, step.back) == pytest.approx((0.4, 0.4), abs=1e-6)
    assert "y = home" in step.definition


def test_two_coordinates_have_an_area():
    leg = legs.load(legs.planar())
    found = workspace(leg)
    area = 2.0 * 0.4 * 0.3 * (math.cos(0.3) - math.cos(2.5))
    assert within(found.volume, area)
    assert found.unit == "m²"
    assert found.step is None
    assert found.slices == ()


def test_only_one_side_of_a_singularity_counts():
    """A straight elbow separates two sets of poses that reach nearly the same points."""
    yaw, shoulder, elbow = (-0.5, 0.5), (-0.3, 0.4), (-1.2, 0.9)
    leg = legs.load(legs.articulated(yaw, shoulder, elbow, home=-0.5))

    def volume(low, high):
        nodes, weights = np.polynomial.legendre.leggauss(60)
        one, w1 = shoulder[0] + (shoulder[1] - shoulder[0]) * (nodes + 1) / 2, weights * (shoulder[1] - shoulder[0]) / 2
        two, w2 = low + (high - low) * (nodes + 1) / 2, weights * (high - low) / 2
        radius = 0.4 * np.cos(one)[:, None] + 0.3 * np.cos(one[:, None] + two[None, :])
        return (yaw[1] - yaw[0]) * w1 @ (0.4 * 0.3 * np.abs(np.sin(two))[None, :] * radius) @ w2

    found = workspace(leg, tolerance=0.01)
    assert within(found.volume, volume(elbow[0], 0.0))
    assert found.injectivity.other_sign == pytest.approx(volume(0.0, elbow[1]), rel=0.02)
    assert "singularity" in found.border_shares()
    assert (found.poses.q[:, 2] < 0.0).all()
    straight = found.border_active == -2
    np.testing.assert_allclose(found.border.q[straight, 2], 0.0, atol=1e-9)
    assert found.injectivity.several == 0.0
    assert within(found.injectivity.cartesian, found.volume.value)


def test_a_slide_through_the_axis_is_counted_on_both_sides():
    leg = legs.load(legs.polar(azimuth=(-0.5, 0.5), elevation=(-0.5, 0.5), radius=(-0.5, 1.0)))
    found = workspace(leg, tolerance=0.01)
    # det J = r^2 cos e keeps its sign at r = 0; points on both sides of it differ
    assert within(found.volume, legs.polar_volume((-0.5, 0.5), (-0.5, 0.5), (-0.5, 1.0)))


def test_whole_turns_are_counted_once():
    text = legs.polar(elevation=(-0.4, 0.4)).replace(
        '<axis xyz="0 0 1"/><limit lower="-1.0" upper="1.0" effort="1" velocity="1"/>', '<axis xyz="0 0 1"/>'
    )
    found = workspace(legs.load(text.replace('name="azimuth" type="revolute"', 'name="azimuth" type="continuous"')))
    assert within(found.volume, legs.polar_volume((-math.pi, math.pi), (-0.4, 0.4), (0.5, 1.0)))
    assert not any("azimuth" in name for name in found.border_shares())


def test_omnileg_against_quadrature():
    """alpha and beta move the knee on a cap of radius L1; gamma lifts the foot straight up below it (Xu 2025 (11))."""
    leg = ld.load("omnileg")
    low, high = leg.limits.lower, leg.limits.upper
    nodes, weights = np.polynomial.legendre.leggauss(40)

    def scaled(k):
        return low[k] + (high[k] - low[k]) * (nodes + 1.0) / 2.0, weights * (high[k] - low[k]) / 2.0

    (alpha, wa), (beta, wb) = scaled(0), scaled(1)
    a, b = np.meshgrid(alpha, beta, indexing="ij")

    def foot(a, b, gamma):
        return leg.foot_position(np.stack([a, b, np.full_like(a, gamma)], axis=-1))

    lift = foot(a, b, low[2]) - foot(a, b, high[2])
    np.testing.assert_allclose(lift[..., :2], 0.0, atol=1e-15)
    np.testing.assert_allclose(lift[..., 2], lift[0, 0, 2], atol=1e-15)
    h = 1e-5
    by_a = (foot(a + h, b, 0.5) - foot(a - h, b, 0.5)) / (2 * h)
    by_b = (foot(a, b + h, 0.5) - foot(a, b - h, 0.5)) / (2 * h)
    shadow = wa @ np.abs(by_a[..., 0] * by_b[..., 1] - by_a[..., 1] * by_b[..., 0]) @ wb
    true = shadow * abs(lift[0, 0, 2])
    found = workspace(leg, tolerance=0.001)
    assert within(found.volume, true)
    assert within(found.injectivity.cartesian, true)
    # gamma = 0 is a singularity at a limit: det J vanishes there
    assert found.dexterity.smallest == pytest.approx(1.0, abs=1e-3)
    assert 0.0 < found.dexterity.inverse_mean < 1.0


def test_the_stated_error_is_honest(sector):
    obstacle = legs.load(legs.cartesian(legs.ball(0.8)))
    cases = [(sector, sector_volume()), (obstacle, 8.0 - 4.0 / 3.0 * math.pi * 0.8**3)]
    misses = trials = 0
    for leg, true in cases:
        evaluate = PoseEvaluator(leg)
        evaluate.sign = choose_sign(evaluate, home_coordinates(leg))
        for seed in range(60):
            found = reachable_set(evaluate, tolerance=(0.03, 0.01)[seed % 2], seed=seed)
            misses += not within(found.volume, true)
            trials += 1
    assert misses <= 0.05 * trials


def test_the_same_seed_gives_the_same_result(sector):
    one, two = (workspace(sector, tolerance=0.02, seed=3) for _ in range(2))
    assert json.dumps(one.to_dict() | {"poses_a_second": 0}) == json.dumps(two.to_dict() | {"poses_a_second": 0})
    np.testing.assert_array_equal(one.poses.q, two.poses.q)


def test_the_numeric_route_agrees(sector):
    numeric = ld.load(sector.description.urdf, route="pinocchio", foot="foot")
    with pytest.warns(LegDynamicsWarning, match="allow more samples"):
        found = reachable_set(PoseEvaluator(numeric), tolerance=0.001, most_samples=2048)
    compiled = reachable_set(PoseEvaluator(sector), tolerance=0.5, most_samples=2048)
    assert within(found.volume, sector_volume())
    assert found.volume.value == pytest.approx(compiled.volume.value, rel=1e-12)
    assert (found.converged, compiled.converged) == (False, True)


def test_an_empty_workspace_says_what_is_in_the_way():
    with pytest.raises(WorkspaceError, match=r"misses 'clearance ball' .* by 0\.\d+ m") as caught:
        workspace(legs.load(legs.cartesian(legs.ball(1.9))))
    assert caught.value.constraint == "clearance ball"
    assert -0.3 < caught.value.margin < 0.0  # the corners are sqrt(3) = 1.73 away


def test_infinite_and_flat_workspaces_are_named():
    unlimited = legs.cartesian().replace('<limit lower="-1.0" upper="1.0" effort="1" velocity="1"/>', "", 1)
    with pytest.raises(WorkspaceError, match="'x' slides without limits"):
        workspace(legs.load(unlimited))
    with pytest.raises(WorkspaceError, match="'y' is locked"):
        workspace(legs.load(legs.cartesian(y=(0.5, 0.5))))


def test_legs_that_have_no_workspace():
    with pytest.raises(MissingFootError):
        workspace(ld.load(legs.cartesian().replace('"foot"', '"tip"'), route="pinocchio"))
    four = legs.cartesian(legs.link("toe"), legs.joint("w", "prismatic", "foot", "toe", "1 0 0", -1.0, 1.0))
    with pytest.raises(UnsupportedError, match="4 independent"):
        workspace(ld.load(four, route="pinocchio", foot="toe"))


@pytest.mark.parametrize(
    "bad",
    [
        {"tolerance": 0.0},
        {"tolerance": math.nan},
        {"tolerance": "0.1"},
        {"tolerance": True},
        {"seed": -1},
        {"seed": 0.5},
        {"height": math.inf},
        {"most_samples": 3},
        {"most_samples": 1e6},
        {"ignore": ("clearence",)},
        {"characteristic_length": 0.0},
    ],
    ids=str,
)
def test_bad_arguments_are_named(sector, bad):
    with pytest.raises(ParameterError):
        workspace(sector, **bad)


def test_files_and_page(tmp_path, sector):
    found = workspace(sector, tolerance=0.03)
    written = found.write(tmp_path)
    assert {path.name for path in written} >= {
        *("summary.json", "samples.csv", "boundary.csv", "slices.png", "cloud.png", "constraints.png"),
        "convergence.png",
    }
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["volume"]["value"] == found.volume.value
    assert len(summary["convergence"]) == len(found.levels)
    lines = (tmp_path / "samples.csv").read_text().splitlines()
    assert len(lines) == len(found.poses) + 1
    header, first = (line.split(",") for line in lines[:2])
    row = dict(zip(header, first, strict=True))
    assert float(row["radius [m]"]) == pytest.approx(found.poses.q[0, 2], rel=1e-9)
    assert row["constraint"] == found.names[int(found.poses.active[0])]
    assert row["margin_unit"] in ("rad", "m")
    page = render_page(dataclasses.replace(found, leg="<b>sector</b>"))
    assert "<b>sector" not in page
    assert "http" not in page.split("</style>")[1].replace("http-equiv", "")[:2000]
    assert page.count("data:image/svg+xml") == 4


def test_a_deviation_without_a_value_has_no_interval():
    """Straight arms are inside: the integral of the squared condition number does not converge there."""
    settled = workspace(ld.load("hexapod_leg"), tolerance=0.005)
    growing = workspace(ld.load("quadruped_leg"), tolerance=0.05)
    assert settled.deviation_is_settled
    assert settled.to_dict()["condition_number"]["deviation_half_width"] == settled.deviation.half_width
    assert not growing.deviation_is_settled
    assert growing.to_dict()["condition_number"]["deviation_half_width"] is None
    assert not growing.to_dict()["condition_number"]["deviation_is_settled"]
