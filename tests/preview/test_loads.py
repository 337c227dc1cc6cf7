"""The arrow of the foot force, the colours of the motors, and the loop over whole cycles, as commands."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from leg_dynamics import errors
from leg_dynamics.description import parse, read
from leg_dynamics.description.model import Description
from leg_dynamics.preview import in_root_frame, write_html
from leg_dynamics.preview.colours import diverging, hexadecimal
from leg_dynamics.preview.cycle import whole_cycles
from leg_dynamics.preview.scene import build_scene

ARROW = "/leg/foot force"


@pytest.fixture
def still_foot(motion: Any) -> dict[str, Any]:
    return {"times": motion.times, "joint_values": motion.joint_values, "foot_trace": motion.foot}


def tracks(commands: Any) -> dict[str, dict[str, list[Any]]]:
    """Of each animated node the values of each track."""
    return {
        animation["path"]: {
            track["name"].lstrip("."): [key["value"] for key in track["keys"]] for track in animation["clip"]["tracks"]
        }
        for command in commands
        if command["type"] == "set_animation"
        for animation in command["animations"]
    }


def material(commands: Any, path: str) -> np.ndarray:
    """Colour of a drawn shape, 0..255."""
    (command,) = [c for c in commands if c["type"] == "set_object" and c["path"] == path]
    value = command["object"]["materials"][0]["color"]
    return np.array([value >> 16, value >> 8 & 255, value & 255])


def arrow_commands(scene: Any) -> list[Any]:
    return [command for command in scene.commands if command["path"].startswith(ARROW)]


# The colour scale.


def lightness(rgb: np.ndarray) -> np.ndarray:
    """CIE L*, by its textbook formula."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    y = linear @ [0.2126, 0.7152, 0.0722]
    return np.where(y > 0.008856, 116.0 * np.cbrt(y) - 16.0, 903.3 * y)


def test_the_scale_is_blue_white_orange_and_darkens_evenly() -> None:
    negative, zero, positive = diverging([-1.0, 0.0, 1.0])
    assert negative[2] > 1.5 * negative[0]
    assert positive[0] > 2.0 * positive[2]
    assert np.ptp(zero) < 0.02
    assert zero.min() > 0.9
    for side in (np.linspace(0.0, 1.0, 21), -np.linspace(0.0, 1.0, 21)):
        steps = np.diff(lightness(diverging(side)))
        assert (steps < 0.0).all()
        assert steps.min() > 1.6 * steps.max()
    assert lightness(negative) == pytest.approx(float(lightness(positive)), abs=6.0)


def test_both_signs_differ_for_red_green_blind_eyes() -> None:
    # Viénot, Brettel & Mollon 1999: deuteranopes see no difference of red and green but that along this mixture.
    linear = diverging([-0.5, 0.5]) ** 2.2
    seen = np.stack([0.29 * linear[:, 0] + 0.71 * linear[:, 1], linear[:, 2]], axis=-1)
    assert np.linalg.norm(seen[0] - seen[1]) > 0.3


def test_beyond_the_scale_is_its_end() -> None:
    np.testing.assert_array_equal(diverging([-7.0, 3.0]), diverging([-1.0, 1.0]))
    assert hexadecimal([1.0, 0.0, 0.2]) == "#ff0033"


# The arrow.


def test_the_arrow_follows_the_force_and_vanishes_with_it(leg: Description, still_foot: dict[str, Any]) -> None:
    times = still_foot["times"]
    force = np.where(times[:, None] <= 1.0, [0.0, 0.0, 40.0], [0.0, 20.0, 0.0])
    force[times > 1.5] = 0.0
    scene = build_scene(leg, **still_foot, foot_force=force, fps=40.0)
    keys = tracks(scene.commands)
    visible = np.array(keys[ARROW]["visible"])
    np.testing.assert_array_equal(visible, times <= 1.5)
    np.testing.assert_allclose(keys[ARROW]["position"], still_foot["foot_trace"], atol=1e-12)
    newtons = float(re.search(r"\((.+) mm\) is (.+) N", scene.legend["force"]["scale"])[2])  # type: ignore[index]
    shaft = np.array(keys[f"{ARROW}/shaft"]["scale"])[:, 2]
    head = np.array(keys[f"{ARROW}/head"]["scale"])[:, 2]
    expected = np.linalg.norm(force, axis=1) * scene.cell / newtons
    np.testing.assert_allclose((shaft + head)[visible], expected[visible], rtol=1e-9)
    np.testing.assert_allclose(np.array(keys[f"{ARROW}/head"]["position"])[:, 2], shaft)
    x, y, z, w = np.array(keys[ARROW]["quaternion"]).T
    direction = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)
    unit = force[visible] / np.linalg.norm(force[visible], axis=1, keepdims=True)
    np.testing.assert_allclose(direction[visible], unit, atol=1e-9)
    # It keeps its direction while it is hidden.
    np.testing.assert_allclose(direction[~visible], np.tile([0.0, 1.0, 0.0], ((~visible).sum(), 1)), atol=1e-9)
    assert (scene.upper >= still_foot["foot_trace"][0] + [0.0, 0.0, expected[0]] - 1e-12).all()
    np.testing.assert_allclose(scene.legend["force"]["values"], np.linalg.norm(force, axis=1))


@pytest.mark.parametrize("newtons", [1e-3, 0.7, 28.3, 999.0, 4e5])
def test_the_longest_arrow_is_well_seen(leg: Description, still_foot: dict[str, Any], newtons: float) -> None:
    force = np.zeros_like(still_foot["foot_trace"])
    force[:, 0] = newtons
    scene = build_scene(leg, **still_foot, foot_force=force)
    keys = tracks(scene.commands)
    length = keys[f"{ARROW}/shaft"]["scale"][0][2] + keys[f"{ARROW}/head"]["scale"][0][2]
    radius = np.linalg.norm(scene.upper - scene.lower) / 2.0
    assert 0.25 < length / radius < 0.9


def test_no_force_no_arrow(leg: Description, still_foot: dict[str, Any]) -> None:
    without = build_scene(leg, **still_foot)
    assert arrow_commands(without) == []
    assert without.legend == {}
    assert not any(command.get("property") == "userData" for command in without.commands)
    zero = build_scene(leg, **still_foot, foot_force=np.zeros_like(still_foot["foot_trace"]))
    assert arrow_commands(zero) == []
    assert not any(path.startswith(ARROW) for path in tracks(zero.commands))
    assert set(zero.legend["force"]["values"]) == {0.0}


def test_a_still_has_a_still_arrow(leg: Description, rig: SimpleNamespace) -> None:
    scene = build_scene(leg, [0.0], {}, foot_trace=[[0.1, 0.2, 0.3]], foot_force=[[0.0, -3.0, 0.0]])
    pose = rig.matrix(scene.commands, ARROW)
    np.testing.assert_allclose(pose[:3, 2], [0.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 3], [0.1, 0.2, 0.3])
    assert tracks(scene.commands) == {}


def test_the_hip_s_force_is_turned_into_the_root_frame(leg: Description) -> None:
    omnileg = read("omnileg")
    # z down in the hip frame, z up in the root frame.
    np.testing.assert_allclose(in_root_frame(omnileg, [[1.0, 2.0, 3.0]]), [[1.0, -2.0, -3.0]], atol=1e-12)
    np.testing.assert_array_equal(in_root_frame(leg, [1.0, 2.0, 3.0]), [1.0, 2.0, 3.0])
    turned = in_root_frame(leg, np.tile([0.0, 0.0, 1.0], (2, 1)), "thigh", {"hip": [0.0, np.pi / 2.0]})
    np.testing.assert_allclose(turned, [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], atol=1e-12)
    with pytest.raises(errors.DescriptionError, match="no link 'hop'"):
        in_root_frame(leg, [1.0, 2.0, 3.0], "hop")
    with pytest.raises(errors.ShapeError, match=r"shape \(2,\)"):
        in_root_frame(leg, [1.0, 2.0])


# The motors.


def test_motors_change_their_colour_and_the_rest_has_none(leg: Description, motion: Any) -> None:
    hip = np.linspace(-2.0, 1.0, motion.times.size)
    scene = build_scene(leg, *motion.arguments(), efforts={"hip": hip, "knee": np.full_like(hip, 0.5)}, fps=40.0)
    keys = tracks(scene.commands)
    colours = np.array(keys["/leg/links/thigh/0/<object>"]["material.color"])
    np.testing.assert_allclose(colours, diverging(hip / 2.0))
    # A constant effort needs no keyframes.
    assert "/leg/links/shank/0/<object>" not in keys
    np.testing.assert_allclose(material(scene.commands, "/leg/links/shank/0"), 255 * diverging(0.25), atol=0.51)
    np.testing.assert_allclose(material(scene.commands, "/leg/links/thigh/0"), 255 * diverging(-1.0), atol=0.51)
    for link in ("base", "foot"):
        assert np.ptp(material(scene.commands, f"/leg/links/{link}/0")) <= 6
    (group,) = scene.legend["efforts"]
    assert (group["title"], group["end"], group["decimals"]) == ("motor torque, N·m", 2.0, 2)
    assert [(motor["name"], motor["limit"]) for motor in group["motors"]] == [("hip", 10.0), ("knee", 10.0)]
    np.testing.assert_allclose(group["motors"][0]["values"], hip)
    assert (group["stops"][0], group["stops"][-1]) == tuple(hexadecimal(diverging(end)) for end in (-1.0, 1.0))


def test_a_motor_s_own_link_comes_first() -> None:
    omnileg = read("omnileg")
    efforts = {"M2": [0.0, 1.0], "M1": [0.0, -2.0], "M3": [0.0, 0.1]}
    scene = build_scene(omnileg, [0.0, 1.0], {}, efforts=efforts)
    painted = {path.split("/")[3] for path, track in tracks(scene.commands).items() if "material.color" in track}
    assert painted == {"motor_M1", "motor_M2", "motor_M3"}
    named = build_scene(omnileg, [0.0, 1.0], {}, efforts=efforts, actuator_links={"M1": "foot", "M2": "alpha"})
    painted = {path.split("/")[3] for path, track in tracks(named.commands).items() if "material.color" in track}
    assert painted == {"foot", "cross_A2", "motor_M3"}


def test_a_slide_has_its_own_scale_in_newtons(leg: Description) -> None:
    slide = parse(leg.urdf.replace('name="knee" type="revolute"', 'name="knee" type="prismatic"'))
    efforts = {"hip": [0.0, 0.71], "knee": [0.0, 130.0]}
    scene = build_scene(slide, [0.0, 1.0], {}, efforts=efforts, effort_limits={"knee": 100.0})
    torque, force = scene.legend["efforts"]
    assert (torque["title"], torque["end"]) == ("motor torque, N·m", pytest.approx(0.8))
    assert (force["title"], force["end"], force["decimals"]) == ("motor force, N", pytest.approx(150.0), 0)
    assert force["motors"][0]["limit"] == 100.0


@pytest.mark.parametrize(
    ("efforts", "ends"),
    [
        ('effort="10" effort_lower="-4"', (-4.0, 10.0)),
        ('effort="0" effort_lower="-4"', (-4.0, 0.0)),
        ('effort="10" effort_lower="0"', (0.0, 10.0)),
        ('effort_lower="-4"', (-4.0, None)),
        ('effort="0"', (None, None)),
    ],
)
def test_a_motor_has_both_ends_of_its_joint_s_efforts(leg: Description, efforts: str, ends: Any) -> None:
    uneven = parse(leg.urdf.replace('effort="10"', efforts))
    scene = build_scene(
        uneven, [0.0, 1.0], {}, efforts={"hip": [-3.0, 1.0], "knee": [0.0, 1.0]}, effort_limits={"knee": 6}
    )
    (group,) = scene.legend["efforts"]
    assert [(motor["lower"], motor["limit"]) for motor in group["motors"]] == [ends, (-6.0, 6.0)]
    # By the larger magnitude of the efforts themselves.
    assert group["end"] == 3.0


def test_no_effort_at_all_has_a_scale_too(leg: Description) -> None:
    scene = build_scene(leg, [0.0], {}, efforts={"hip": [0.0]}, effort_limits={"hip": np.inf})
    (group,) = scene.legend["efforts"]
    assert (group["end"], group["motors"][0]["limit"]) == (1.0, None)


def test_a_motor_without_a_shape_is_told(leg: Description) -> None:
    bare = parse(re.sub(r'(<link name="foot">.*?)<visual>.*?</visual>', r"\1", leg.urdf, flags=re.DOTALL))
    with pytest.warns(errors.LegDynamicsWarning, match="nothing is drawn on the links of hip"):
        build_scene(bare, [0.0, 1.0], {}, efforts={"hip": [0.0, 1.0]}, actuator_links={"hip": "foot"})


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"foot_force": np.zeros((2, 3))}, errors.MissingFootError, "give both"),
        ({"foot_force": np.zeros((3, 3)), "foot_trace": np.zeros((2, 3))}, errors.ShapeError, r"give shape \(2, 3\)"),
        (
            {"foot_force": [[0.0] * 3, [np.nan] * 3], "foot_trace": np.zeros((2, 3))},
            errors.NonFiniteError,
            "foot_force holds NaN",
        ),
        ({"efforts": {"hop": [0.0, 1.0]}}, errors.DescriptionError, "no joint 'hop'"),
        ({"efforts": {"hip": [0.0]}}, errors.ShapeError, r"efforts\['hip'\] has shape \(1,\)"),
        ({"efforts": {"hip": [{}, {}]}}, errors.ShapeError, "not an array of numbers"),
        ({"efforts": {"hip": [0.0, np.inf]}}, errors.NonFiniteError, "first in sample 1"),
        ({"actuator_links": {"knee": "shank"}}, errors.ParameterError, "of which no effort is given"),
        ({"actuator_links": {"hip": "hop"}}, errors.DescriptionError, "no joint 'hop'"),
        ({"effort_limits": {"hip": 0.0}}, errors.ParameterError, "must be positive"),
        ({"effort_limits": {"hip": np.nan}}, errors.ParameterError, "must be positive"),
        (
            {"efforts": {"hip": [0.0, 1.0], "knee": [0.0, 1.0]}, "actuator_links": {"hip": "shank"}},
            errors.ParameterError,
            "both 'hip' and 'knee'",
        ),
    ],
)
def test_bad_loads_get_a_named_error(
    leg: Description, changes: dict[str, Any], error: type[Exception], message: str
) -> None:
    good: dict[str, Any] = {"times": [0.0, 1.0], "joint_values": {}, "efforts": {"hip": [0.0, 1.0]}}
    build_scene(leg, **good)
    with pytest.raises(error, match=message):
        build_scene(leg, **{**good, **changes})


# Whole cycles.


def wave(times: np.ndarray) -> np.ndarray:
    return np.sin(np.pi * times) + 0.3 * np.sin(2.0 * np.pi * times)


@pytest.mark.parametrize(
    ("end", "expected"), [(2.0, 2.0), (6.0, 6.0), (5.0, 4.0), (2.5, 2.0), (1.2, None), (7.98, 6.0)]
)
def test_a_periodic_motion_ends_with_a_whole_cycle(end: float, expected: float | None) -> None:
    times = 3.0 + np.arange(round(100 * end) + 1) / 100.0
    last = whole_cycles(times, {"hip": wave(times - 3.0), "knee": 0.0 * times})
    assert (None if last is None else times[last] - 3.0) == (expected if expected is None else pytest.approx(expected))


def test_a_dwell_is_no_cycle() -> None:
    times = np.linspace(0.0, 4.0, 401)
    dwell = np.where(times < 1.0, 0.0, np.sin(np.pi * times / 2.0 - np.pi / 2.0))
    assert whole_cycles(times, {"hip": dwell}) is None
    # A lift, a dwell, and half a lift; or half a dwell, a lift and a dwell, which closes by itself.
    for start, expected in ((0, 2.0), (150, 2.5)):
        lifts = np.maximum(np.sin(np.pi * times[start : start + 251]), 0.0) ** 3
        last = whole_cycles(times[:251], {"hip": lifts})
        assert times[last or 0] == pytest.approx(expected, abs=0.02)
    assert whole_cycles(times, {"hip": 0.0 * times}) is None
    assert whole_cycles(times, {}) is None


def test_a_return_on_another_way_is_no_cycle() -> None:
    times = np.linspace(0.0, 3.0, 301)
    assert whole_cycles(times, {"hip": np.sin(np.pi * times) * np.where(times < 2.0, 1.0, 0.5)}) is None


def test_the_loop_leaves_the_rest_of_a_cycle_out_and_says_so(leg: Description) -> None:
    times = np.linspace(0.0, 5.0, 501)
    arguments: Any = (leg, times, {"hip": wave(times)})
    with pytest.warns(errors.LegDynamicsWarning, match=r"stops 1 s into a cycle; .* whole cycles, 4 s"):
        looped = build_scene(*arguments, loop=True)
    assert (looped.duration, looped.cyclic) == (pytest.approx(4.0), True)
    position = tracks(looped.commands)["/leg/links/foot"]["position"]
    np.testing.assert_allclose(position[0], position[-1], atol=1e-6)
    once = build_scene(*arguments, loop=False)
    assert (once.duration, once.cyclic) == (5.0, False)


# The page.


def test_the_page_says_that_it_loops_and_stays_small(leg: Description, tmp_path: Path) -> None:
    times = np.linspace(0.0, 50.0, 2501)
    hip = wave(times)
    path = write_html(
        leg,
        times,
        {"hip": hip, "knee": 0.5 * hip},
        tmp_path / "leg.html",
        foot_trace=np.stack([hip, hip, hip], axis=-1),
        foot_force=np.stack([hip, hip, hip], axis=-1),
        efforts={"hip": hip, "knee": hip},
        fps=20.0,
    )
    text = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 5_000_000
    assert "50 s · grid" in text
    assert "loops in whole cycles" in text
    assert "show_legend(viewer)" in text
    once = write_html(leg, times[:101], {"hip": hip[:101]}, tmp_path / "once.html", loop=False)
    assert "loops in" not in once.read_text(encoding="utf-8")
    assert json.loads(json.dumps(build_scene(leg, [0.0], {}, efforts={"hip": [1.0]}).legend))
