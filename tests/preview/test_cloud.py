"""Point clouds in a preview: colours, thinning, place in the scene, page, errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from leg_dynamics.description import read
from leg_dynamics.errors import NonFiniteError, ShapeError
from leg_dynamics.preview import Cloud, write_html
from leg_dynamics.preview.cloud import MAXIMUM_POINTS
from leg_dynamics.preview.scene import build_scene


def cloud(count: int = 50) -> Cloud:
    generator = np.random.default_rng(0)
    return Cloud.of(generator.normal(size=(count, 3)), generator.uniform(2.0, 20.0, count), "k")


def test_small_is_yellow_and_large_is_violet() -> None:
    colours = Cloud.of(np.eye(3), [1.0, 10.0, math.inf], "k").colours()
    assert colours[0][0] > 0.9
    assert colours[0][2] < 0.3
    assert colours[2][0] < 0.3
    assert colours[2][2] > 0.3
    np.testing.assert_array_equal(Cloud.of(np.eye(3), [3.0, 3.0, 3.0]).colours().std(axis=0), 0.0)


def test_the_scene_holds_it() -> None:
    leg, points = read("omnileg"), cloud()
    scene = build_scene(leg, [0.0], {}, cloud=points)
    (command,) = (c for c in scene.commands if c["type"] == "set_object" and "cloud" in str(c["path"]))
    (geometry,) = command["object"]["geometries"]
    assert geometry["data"]["attributes"]["position"]["itemSize"] == 3
    assert "color" in geometry["data"]["attributes"]
    assert (scene.lower <= points.points.min(axis=0)).all()
    assert (scene.upper >= points.points.max(axis=0)).all()
    assert scene.note.startswith("k 2.")
    assert scene.packed() == build_scene(leg, [0.0], {}, cloud=cloud()).packed()
    assert not any("cloud" in str(c.get("path")) for c in build_scene(leg, [0.0], {}).commands)


def test_the_note_says_that_the_scale_is_cut() -> None:
    values = np.linspace(2.0, 20.0, 100)
    assert Cloud.of(np.zeros((100, 3)), values, "k").note == "k 2 (yellow) to 19.6 and more, up to 20 (violet)"
    values[-1] = math.inf
    assert Cloud.of(np.zeros((100, 3)), values, "k").note == "k 2 (yellow) to 19.5 and more, up to infinity (violet)"
    assert Cloud.of(np.zeros((3, 3)), [2.0, 2.0, 2.0], "k").note == "k 2 (yellow) to 2 (violet)"
    # what is thinned out counts as well
    many = np.full(MAXIMUM_POINTS * 2, 3.0)
    many[1] = 50.0
    assert "up to 50" in Cloud.of(np.zeros((len(many), 3)), many).note


def test_the_page_says_what_the_colours_mean(tmp_path) -> None:
    page = write_html(read("omnileg"), [0.0], {}, tmp_path / "page.html", cloud=cloud()).read_text(encoding="utf-8")
    assert "(yellow) to" in page


def test_many_points_are_thinned() -> None:
    assert 0.5 * MAXIMUM_POINTS <= len(cloud(2 * MAXIMUM_POINTS + 1).points) <= MAXIMUM_POINTS


def test_errors() -> None:
    with pytest.raises(ShapeError):
        Cloud.of(np.eye(2), [1.0, 2.0])
    with pytest.raises(ShapeError):
        Cloud.of(np.eye(3), [1.0, 2.0])
    with pytest.raises(ShapeError):
        Cloud.of(np.zeros((0, 3)), [])
    for bad in (math.nan, -1.0, 0.0):
        with pytest.raises(NonFiniteError, match="row 1"):
            Cloud.of(np.eye(3), [1.0, bad, 2.0])
