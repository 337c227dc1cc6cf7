"""The page and the live view as a browser shows them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from leg_dynamics import errors
from leg_dynamics.description import parse
from leg_dynamics.description.model import Description
from leg_dynamics.preview import show_live, still, write_html, write_still
from leg_dynamics.preview.colours import diverging
from leg_dynamics.preview.scene import build_scene

EARLY, LATE = 0.25, 1.75


@pytest.fixture(scope="module")
def page(leg: Description, motion: Any, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("browser") / "leg #1.html"
    return write_html(leg, *motion.arguments(), path, foot_trace=motion.foot, title="Swing").as_uri()


def masks(picture: np.ndarray) -> dict[str, np.ndarray]:
    """Where each of the four colours of the leg, and its trace, are seen."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    return {
        "base": (np.ptp(picture, axis=-1) < 40) & (picture.max(axis=-1) < 110),
        "thigh": (blue > 1.5 * green) & (blue > 2.0 * red),
        "shank": (red > 1.25 * green) & (green > 2.0 * blue),
        "foot": (green > 1.4 * red) & (green > 1.4 * blue) & (blue > 0.3 * green),
        "trace": (red > 2.5 * green) & (red > 1.5 * blue) & (blue > 1.2 * green),
    }


def centre(mask: np.ndarray) -> np.ndarray:
    """Centre of a mask in screen coordinates: right and up, ±1 at the window's edges."""
    row, column = np.argwhere(mask).mean(axis=0)
    height, width = mask.shape
    return np.array([2.0 * column / width - 1.0, 1.0 - 2.0 * row / height])


def foot_on_screen(leg: Description, motion: Any, rig: SimpleNamespace, time: float) -> np.ndarray:
    scene = build_scene(leg, *motion.arguments(), foot_trace=motion.foot)
    foot = [np.interp(time, motion.times, motion.foot[:, axis]) for axis in range(3)]
    return rig.Camera.of(scene.commands).project(np.array(foot))


def test_stills_show_the_leg_where_it_is(
    browser: Any, page: str, leg: Description, motion: Any, rig: SimpleNamespace
) -> None:
    pictures = {}
    for time in (EARLY, LATE):
        browser.open_page(f"{page}#t={time}")
        assert browser.evaluate("viewer.animator.playing") is False
        assert browser.evaluate("document.querySelector('#player output').textContent") == f"{time:.2f} s"
        pictures[time] = browser.picture()
        seen = masks(pictures[time])
        for part, mask in seen.items():
            assert mask.sum() > 150, part
        np.testing.assert_allclose(centre(seen["foot"]), foot_on_screen(leg, motion, rig, time), atol=0.04)
        assert browser.complaints() == []
    travel = foot_on_screen(leg, motion, rig, LATE) - foot_on_screen(leg, motion, rig, EARLY)
    assert np.linalg.norm(travel) > 0.4
    changed = np.abs(pictures[LATE] - pictures[EARLY]).max(axis=-1) > 40
    assert changed.mean() > 0.02
    assert len(np.unique(pictures[EARLY].reshape(-1, 3) // 16, axis=0)) > 50


def test_the_same_time_gives_the_same_picture(browser: Any, page: str) -> None:
    pictures = []
    for _ in range(2):
        browser.open_page(f"{page}#t={EARLY}")
        pictures.append(browser.picture())
    assert (np.abs(pictures[0] - pictures[1]).max(axis=-1) > 8).mean() < 1e-3


def test_the_page_plays_over_and_over(browser: Any, leg: Description, tmp_path: Path) -> None:
    times = np.linspace(0.0, 1.0, 31)
    browser.open_page(write_html(leg, times, {"hip": times}, tmp_path / "short.html").as_uri())
    # Software drawing on a busy machine may show two pictures a second: count laps instead of waiting a fixed time.
    watch = """new Promise(done => {
        const seen = [viewer.animator.time], start = performance.now();
        let laps = 0;
        const look = () => {
            const time = viewer.animator.time;
            laps += time < seen[seen.length - 1];
            seen.push(time);
            if (laps === 2 || performance.now() - start > 60000) { done(seen); } else { requestAnimationFrame(look); }
        };
        look();
    })"""
    seen = np.array(browser.evaluate(watch))
    assert browser.evaluate("viewer.animator.playing") is True
    assert seen.min() >= 0.0
    assert seen.max() <= 1.0 + 1e-6
    assert np.count_nonzero(np.diff(seen) < 0.0) == 2
    # A picture or two a lap: some step forward is all that a slow machine shows.
    assert (np.diff(seen) > 0.0).any()


def test_nothing_is_fetched_and_nothing_can_be(browser: Any, page: str) -> None:
    browser.open_page(page)
    fetched = [url for url in browser.requested() if not url.startswith("data:")]
    assert fetched == [page]
    refusal = """new Promise(done => {
        addEventListener("securitypolicyviolation", event => done(event.effectiveDirective), {once: true});
        fetch("http://127.0.0.1:9/").catch(() => 0);
    })"""
    assert browser.evaluate(refusal) == "connect-src"


def test_the_player_answers_mouse_keyboard_and_address(browser: Any, page: str) -> None:
    browser.open_page(page)
    playing = "viewer.animator.playing"
    assert browser.evaluate(playing) is True
    browser.evaluate("document.querySelector('#player button').click()")
    assert browser.evaluate(playing) is False
    browser.evaluate("window.dispatchEvent(new KeyboardEvent('keydown', {key: ' '}))")
    assert browser.evaluate(playing) is True
    drag = """(() => {
        const slider = document.querySelector("#player input");
        slider.value = 1.25;
        slider.dispatchEvent(new Event("input"));
        return [slider.min, slider.max, viewer.animator.time, viewer.animator.playing];
    })()"""
    assert browser.evaluate(drag) == ["0", "2", 1.25, False]
    for address, time in (("#t=0.5", 0.5), ("#t=99", 2.0), ("#t=-1", 0.0)):
        browser.evaluate(f"location.hash = '{address}'")
        browser.wait_for(f"viewer.animator.time === {time} && !{playing}", 10.0)
    browser.evaluate("location.hash = '#t=soon'")
    browser.wait_for(playing, 10.0)


def test_the_clock_is_the_trajectory_s(browser: Any, leg: Description, tmp_path: Path) -> None:
    path = write_html(leg, [5.0, 6.0], {"hip": [0.0, 1.0]}, tmp_path / "late.html")
    browser.open_page(f"{path.as_uri()}#t=5.25")
    assert browser.evaluate("document.querySelector('#player output').textContent") == "5.25 s"
    assert browser.evaluate("viewer.animator.time") == pytest.approx(0.25)


def test_a_narrow_window_shows_the_whole_leg(browser: Any, page: str) -> None:
    browser.call("Emulation.setDeviceMetricsOverride", width=300, height=600, deviceScaleFactor=1, mobile=False)
    browser.open_page(f"{page}#t={LATE}")
    seen = masks(browser.picture())
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=browser.SIDE, height=browser.SIDE, deviceScaleFactor=1, mobile=False
    )
    for part in ("thigh", "foot", "trace"):
        columns = np.flatnonzero(seen[part].any(axis=0))
        assert columns.min() > 5
        assert columns.max() < 295


def test_a_still_page_has_no_player(browser: Any, leg: Description, tmp_path: Path) -> None:
    browser.open_page(write_html(leg, [0.0], {"hip": [0.3]}, tmp_path / "still.html").as_uri())
    assert browser.evaluate("document.getElementById('player').hidden") is True
    assert masks(browser.picture())["shank"].sum() > 150
    assert browser.complaints() == []


def test_a_browser_without_webgl_is_told_so(browser: Any, page: str) -> None:
    script = browser.call(
        "Page.addScriptToEvaluateOnNewDocument", source="HTMLCanvasElement.prototype.getContext = () => null;"
    )
    try:
        browser.open_page(page)
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script["identifier"])
    assert browser.evaluate("document.documentElement.dataset.ready") == "false"
    assert browser.evaluate("document.getElementById('failure').hidden") is False
    assert browser.evaluate("document.getElementById('player').hidden") is True


def test_the_live_view_plays_in_the_browser(browser: Any, leg: Description, motion: Any) -> None:
    with show_live(leg, *motion.arguments(), foot_trace=motion.foot, loop=True) as view:
        origin = view.url.removesuffix("static/")
        browser.open(view.url)
        browser.wait_for("typeof viewer === 'object' && viewer.animator && viewer.animator.time > 0.1")
        first = browser.picture()
        browser.evaluate("viewer.animator.pause(); viewer.animator.seek(1.9)")
        second = browser.picture()
        assert {url for url in browser.requested() if not url.startswith(("data:", origin))} == set()
        browser.open("about:blank")
    for part, mask in masks(second).items():
        assert mask.sum() > 150, part
    assert (np.abs(second - first).max(axis=-1) > 40).mean() > 0.005


def test_a_still_is_written_as_a_picture(
    chromium: str, page: str, leg: Description, motion: Any, rig: SimpleNamespace, tmp_path: Path
) -> None:
    from PIL import Image

    html = write_html(leg, *motion.arguments(), tmp_path / "leg.html", foot_trace=motion.foot)
    path = write_still(html, tmp_path / "leg.png", LATE, size=(500, 500))
    with Image.open(path) as image:
        assert image.size == (500, 500)
        picture = np.asarray(image.convert("RGB")).astype(int)
    np.testing.assert_allclose(centre(masks(picture)["foot"]), foot_on_screen(leg, motion, rig, LATE), atol=0.05)


def test_a_still_without_a_browser_is_a_named_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(still.shutil, "which", lambda name: None)
    with pytest.raises(errors.UnsupportedError, match="chromium, chromium-browser, google-chrome"):
        write_still(tmp_path / "leg.html", tmp_path / "leg.png", 0.0)


def test_a_still_of_no_page_is_a_named_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(still.shutil, "which", lambda name: "/bin/false")
    with pytest.raises(errors.PreviewError, match=r"there is no page .*nothing\.html"):
        write_still(tmp_path / "nothing.html", tmp_path / "leg.png", 0.0)


@pytest.mark.parametrize(
    ("script", "message"),
    [("echo no display >&2", "no display"), ("true", "no message"), ("/bin/sleep 20", "within 0.5 s")],
)
def test_a_browser_that_takes_no_picture_is_a_named_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, message: str
) -> None:
    page, browser = tmp_path / "leg.html", tmp_path / "browser"
    page.write_text("<p>")
    browser.write_text(f"#!/bin/sh\nexec {script}\n" if script.startswith("/bin") else f"#!/bin/sh\n{script}\n")
    browser.chmod(0o755)
    monkeypatch.setattr(still.shutil, "which", lambda name: str(browser))
    with pytest.raises(errors.PreviewError, match=message):
        write_still(page, tmp_path / "leg.png", 0.0, timeout=0.5)
    assert not (tmp_path / "leg.png").exists()


@pytest.mark.parametrize(("user", "expected"), [(0, True), (1000, False)])
def test_only_root_leaves_the_sandbox(user: int, expected: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(still.os, "geteuid", lambda: user, raising=False)
    assert ("--no-sandbox" in still.chromium_flags("profile")) is expected


# Forces and efforts.


def arrow_pixels(browser: Any) -> int:
    """Pixels of the arrow's dark bluish green, which nothing else of a pale leg has but the legend and,
    here and there, an edge of the green axis."""
    browser.evaluate("document.getElementById('legend').hidden = true")
    red, green, blue = np.moveaxis(browser.picture(), -1, 0)
    browser.evaluate("document.getElementById('legend').hidden = false")
    return int(((green > 2.0 * red + 10) & (green > 1.2 * blue) & (blue > 0.4 * green)).sum())


@pytest.fixture(scope="module")
def loaded(motion: Any) -> dict[str, Any]:
    """A force during the first second; a hip torque from -2 to 2 N·m that passes its limit, and a steady knee."""
    force = np.where(motion.times[:, None] <= 1.0, [0.0, 10.0, 20.0], 0.0)
    efforts = {"hip": 2.0 * (motion.times - 1.0), "knee": np.full_like(motion.times, 0.5)}
    return {"foot_trace": motion.foot, "foot_force": force, "efforts": efforts, "effort_limits": {"hip": 1.2}}


def test_arrow_colours_and_legend_follow_the_clock(
    browser: Any, leg: Description, motion: Any, loaded: dict[str, Any], tmp_path: Path
) -> None:
    page = write_html(leg, *motion.arguments(), tmp_path / "loaded.html", **loaded).as_uri()
    outputs = "[...document.querySelectorAll('#legend output')].map(each => each.textContent)"
    colour = "viewer.scene_tree.find(['leg', 'links', 'thigh', '0', '<object>']).object.material.color.toArray()"
    over = "document.querySelectorAll('#legend .over').length"
    seen = {}
    for time in (EARLY, LATE):
        browser.open_page(f"{page}#t={time}")
        seen[time] = (arrow_pixels(browser), browser.picture())
        effort = 2.0 * (time - 1.0)
        np.testing.assert_allclose(browser.evaluate(colour), diverging(effort / 2.0), atol=1e-3)
        hip, knee, force = browser.evaluate(outputs)
        assert float(hip.replace("\N{MINUS SIGN}", "-")) == pytest.approx(effort)
        assert knee == "+0.50"
        assert float(force) == pytest.approx(np.sqrt(500.0) if time < 1.0 else 0.0, abs=0.05)
        assert browser.evaluate(over) == 1
        assert browser.complaints() == []
    assert seen[EARLY][0] > 100
    assert seen[LATE][0] < 10
    browser.evaluate("location.hash = '#t=1.1'")
    browser.wait_for(f"{over} === 0", 10.0)
    ticks = browser.evaluate("[...document.querySelectorAll('#legend .ticks span')].map(each => each.textContent)")
    assert ticks == ["\N{MINUS SIGN}2", "\N{MINUS SIGN}1", "0", "+1", "+2"]
    notes = browser.evaluate("[...document.querySelectorAll('#legend .note')].map(each => each.textContent)")
    assert notes[0] == "limits hip ±1.2, knee ±10"
    assert notes[1].startswith("one grid square (")
    # Blue for negative, orange for positive, in the picture as well.
    for time, sign in ((EARLY, -1.0), (LATE, 1.0)):
        red, blue = seen[time][1][..., 0].astype(float), seen[time][1][..., 2].astype(float)
        assert (sign * (red - blue) > 60).sum() > 300


def test_the_legend_marks_and_judges_each_end_of_uneven_limits(
    browser: Any, leg: Description, motion: Any, tmp_path: Path
) -> None:
    uneven = parse(leg.urdf.replace('effort="10"', 'effort="0" effort_lower="-1.2"'))
    efforts = {"hip": motion.times - 1.0, "knee": -1.5 * np.ones_like(motion.times)}
    page = write_html(uneven, *motion.arguments(), tmp_path / "uneven.html", efforts=efforts).as_uri()
    over = "[...document.querySelectorAll('#legend .row:not(.ticks-row)')].map(row => row.classList.contains('over'))"
    for time in (EARLY, LATE):
        browser.open_page(f"{page}#t={time}")
        assert browser.evaluate(over) == [time > 1.0, True]
        assert browser.complaints() == []
    marks = browser.evaluate("[...document.querySelectorAll('#legend .bar b')].map(each => each.style.left)")
    assert marks == ["10%", "50%"] * 2  # of a scale from -1.5 to 1.5 N·m
    notes = browser.evaluate("[...document.querySelectorAll('#legend .note')].map(each => each.textContent)")
    assert notes == ["limit \N{MINUS SIGN}1.2 to 0"]


def test_a_page_without_loads_has_no_legend(browser: Any, page: str) -> None:
    browser.open_page(f"{page}#t={EARLY}")
    assert browser.evaluate("document.getElementById('legend') === null") is True
    assert browser.evaluate("viewer.scene_tree.find(['leg']).children['foot force'] === undefined") is True


def test_a_motion_that_plays_once_stops(browser: Any, leg: Description, tmp_path: Path) -> None:
    path = write_html(leg, [0.0, 0.5], {"hip": [0.0, 1.0]}, tmp_path / "once.html", loop=False)
    browser.open_page(path.as_uri())
    browser.wait_for("viewer.animator.playing === false", 60.0)
    browser.wait_for("document.querySelector('#player button').textContent === '\\u25B6'", 10.0)


def test_the_live_view_has_colours_arrow_and_legend(
    browser: Any, leg: Description, motion: Any, loaded: dict[str, Any]
) -> None:
    with show_live(leg, *motion.arguments(), **loaded, loop=True) as view:
        browser.open(view.url)
        browser.wait_for("document.getElementById('legend') !== null && viewer.animator.duration > 0")
        browser.evaluate("viewer.animator.pause(); viewer.animator.seek(0.25); viewer.animator.display_progress(0.25)")
        early = arrow_pixels(browser)
        browser.evaluate("viewer.animator.seek(1.75); viewer.animator.display_progress(1.75)")
        late = arrow_pixels(browser)
        colour = "viewer.scene_tree.find(['leg', 'links', 'thigh', '0', '<object>']).object.material.color.toArray()"
        np.testing.assert_allclose(browser.evaluate(colour), diverging(0.75), atol=1e-3)
        assert browser.complaints() == []
        browser.open("about:blank")
    assert early > 100
    assert late < 10
