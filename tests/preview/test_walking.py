"""The ground under a walking robot: it passes as the body moves, and a loop of the motion does not show."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from leg_dynamics import cli
from leg_dynamics.errors import NonFiniteError, ShapeError
from leg_dynamics.preview import Walking, write_html
from leg_dynamics.preview.scene import build_scene

T = 41


def walking(forward=0.5, turn=0.0):
    time = np.linspace(0.0, 1.0, T)
    stance = np.ones((T, 4), dtype=bool)
    stance[: T // 2, 3] = False
    stance[T // 2 :, 0] = False
    feet = np.broadcast_to(
        [[0.2, 0.2, -0.4], [0.2, -0.2, -0.4], [-0.2, 0.2, -0.4], [-0.2, -0.2, -0.4]], (T, 4, 3)
    ).copy()
    feet[..., 0] -= forward * time[:, None]
    position = np.column_stack([forward * time, 0.0 * time])
    return time, Walking.of(position, turn * time, feet, stance, np.zeros((T, 2)))


def keys(scene, path, name):
    animations = next(command for command in scene.commands if command["type"] == "set_animation")["animations"]
    track = next(each["clip"] for each in animations if each["path"] == path)["tracks"]
    return np.array([key["value"] for key in next(t for t in track if t["name"] == f".{name}")["keys"]])


def still(leg, time):
    return {"hip": 0.3 * np.sin(2 * np.pi * time), "knee": 0.0 * time}


def test_grid_lines_pass_below_and_a_loop_moves_them_by_whole_cells(leg):
    time, walk = walking()
    scene = build_scene(leg, time, still(leg, time), walking=walk)
    assert (0.5 / scene.cell) == pytest.approx(round(0.5 / scene.cell))
    first, last = (np.sort([keys(scene, path, "position")[k, 0] for path in _lines(scene, "x")]) for k in (0, -1))
    assert np.allclose(first, last)
    steps = np.diff(keys(scene, "/leg/ground/grid/x3", "position")[:, 0])
    slid = steps[np.abs(steps) < scene.cell]
    assert np.allclose(slid, -0.5 / (len(steps)))
    # A line is out of sight where it comes back on the other side.
    scale = keys(scene, "/leg/ground/grid/x0", "scale")[:, 1]
    jump = np.flatnonzero(np.abs(np.diff(keys(scene, "/leg/ground/grid/x0", "position")[:, 0])) > scene.cell)
    assert (scale[jump] < 1e-3).all()
    assert (scale[jump + 1] < 1e-3).all()


def _lines(scene, axis):
    paths = [command["path"] for command in scene.commands if command["type"] == "set_object"]
    return [path for path in paths if path.startswith(f"/leg/ground/grid/{axis}")]


def test_support_polygons_stay_where_the_feet_are(leg):
    time, walk = walking(turn=0.0)
    scene = build_scene(leg, time, still(leg, time), walking=walk)
    for number, shown in ((0, slice(0, 15)), (1, slice(16, 30))):
        path = f"/leg/ground/support/{number}"
        scale, position = keys(scene, path, "scale"), keys(scene, path, "position")
        assert (scale[shown] == 1.0).all()
        assert scale[:, 0].min() < 1e-3
        assert np.allclose(np.diff(position[:, 0]), -0.5 / 30, atol=1e-9)
        # The corners' middle, on the ground: three of the four feet stand.
        assert np.allclose(position[:, 1], (0.2 / 3) * (1 if number == 0 else -1))


def test_a_turning_robot_has_no_grid_and_turns_its_polygons(leg):
    time, walk = walking(turn=0.4)
    scene = build_scene(leg, time, still(leg, time), walking=walk)
    assert np.isnan(scene.cell)
    assert not _lines(scene, "x")
    quaternion = keys(scene, "/leg/ground/support/0", "quaternion")
    yaw = 2.0 * np.arctan2(quaternion[:, 2], quaternion[:, 3])
    assert np.ptp(yaw) == pytest.approx(0.4)


def test_the_page_is_complete_and_says_no_grid_where_there_is_none(leg, tmp_path):
    for turn in (0.0, 0.4):
        time, walk = walking(turn=turn)
        page = write_html(leg, time, still(leg, time), tmp_path / "walk.html", walking=walk, title="walk")
        text = page.read_text(encoding="utf-8")
        caption = text[text.index('<div id="caption">') :][:400]
        assert ("grid" in caption) == (turn == 0.0)
        assert "nan" not in caption


def test_a_body_at_rest_keeps_its_grid(leg):
    time, walk = walking(forward=0.0)
    scene = build_scene(leg, time, still(leg, time), walking=walk)
    assert scene.cell > 0.0
    assert _lines(scene, "x")
    assert _lines(scene, "y")


@pytest.mark.parametrize("field", range(5))
def test_arrays_must_fit(field):
    _, walk = walking()
    arrays = [walk.position, walk.yaw, walk.feet, walk.stance, walk.centre]
    arrays[field] = arrays[field][:-1]
    with pytest.raises(ShapeError):
        Walking.of(*arrays)


def test_numbers_must_be_finite_and_as_many_as_times(leg):
    time, walk = walking()
    with pytest.raises(NonFiniteError) as caught:
        Walking.of(walk.position, np.where(time > 0.9, np.nan, 0.0), walk.feet, walk.stance, walk.centre)
    assert caught.value.rows.tolist() == list(range(37, 41))
    with pytest.raises(ShapeError, match="41 samples"):
        build_scene(leg, time[:5], {name: q[:5] for name, q in still(leg, time).items()}, walking=walk)


@pytest.mark.parametrize("name", ["ring", "snake", "quadruped"])
def test_robots_of_modules_stand_in_their_home_pose(name, tmp_path, monkeypatch):
    written = {}
    monkeypatch.setattr(
        "leg_dynamics.preview.write_html", lambda *args, **options: written.update(args=args, **options)
    )
    page = tmp_path / "page.html"
    assert CliRunner().invoke(cli.app, ["preview", name, "--html", str(page)]).exit_code == 0
    description, _, values, _ = written["args"]
    assert written["title"] == f"{name}, home pose"
    for joint, value in description.home.values.items():
        assert values[joint] == pytest.approx([value])
    # On the ground, with every shape of the ten modules.
    scene = build_scene(description, [0.0], values)
    drawn = [command for command in scene.commands if command["type"] == "set_object"]
    assert len(drawn) >= sum(len(link.visuals) for link in description.links) > 100
