from __future__ import annotations

import base64
import html.parser
import json
import re
from pathlib import Path
from typing import Any

import pytest
import umsgpack

from leg_dynamics import errors
from leg_dynamics.description.model import Description
from leg_dynamics.preview import page as page_module
from leg_dynamics.preview import write_html
from leg_dynamics.preview.scene import build_scene, load_meshcat


class Reader(html.parser.HTMLParser):
    """Elements with their attributes, and the text of those that have an id."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, str] = {}
        self.feed(text)
        self.texts = {key: value.strip() for key, value in self.texts.items()}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        tag, attributes = self.elements[-1] if self.elements else ("", {})
        key = attributes.get("id") or tag
        self.texts[key] = self.texts.get(key, "") + data


@pytest.fixture(scope="module")
def page(leg: Description, motion: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "leg.html"
    return write_html(leg, *motion.arguments(), path, foot_trace=motion.foot, title="Swing <b>& stance</b>")


def test_the_path_comes_back(page: Path) -> None:
    assert page.name == "leg.html"
    assert page.is_file()


def test_the_page_refers_to_nothing_outside_itself(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    elements = Reader(text).elements
    references = [
        value for _, attributes in elements for name, value in attributes.items() if name in ("src", "href", "action")
    ]
    assert references == ["data:,"]
    assert not re.search(r"url\(\s*['\"]?(?!data:)[a-z/]", text.split("<script", 1)[0])
    (policy,) = [a["content"] for _, a in elements if a.get("http-equiv") == "Content-Security-Policy"]
    assert policy is not None
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules.pop("default-src") == "'none'"
    assert set(" ".join(rules.values()).split()) == {"'unsafe-inline'", "data:", "blob:"}
    assert str(page.parent) not in text


def test_the_page_is_small(page: Path) -> None:
    assert 500_000 < page.stat().st_size < 2_000_000


def test_the_page_holds_the_scene(page: Path, leg: Description, motion: Any) -> None:
    data = json.loads(Reader(page.read_text(encoding="utf-8")).texts["scene"])
    expected = build_scene(leg, *motion.arguments(), foot_trace=motion.foot)
    assert (data["start"], data["duration"], data["animated"]) == (0.0, 2.0, True)
    assert [base64.b64decode(command) for command in data["commands"]] == list(expected.packed())
    kinds = {umsgpack.unpackb(base64.b64decode(command))["type"] for command in data["commands"]}
    assert kinds == {"set_object", "set_transform", "set_property", "set_animation"}


def test_the_caption_says_what_is_shown(page: Path) -> None:
    reader = Reader(page.read_text(encoding="utf-8"))
    assert reader.texts["title"] == reader.texts["h1"] == "Swing <b>& stance</b>"
    assert not any(tag == "b" for tag, _ in reader.elements)
    assert "planar_leg · 2 s · grid 50 mm" in reader.texts["p"]


def test_a_still_page_without_title(leg: Description, tmp_path: Path) -> None:
    reader = Reader(write_html(leg, [3.0], {"hip": [0.2]}, tmp_path / "still.html").read_text(encoding="utf-8"))
    assert reader.texts["h1"] == "planar_leg"
    assert reader.texts["p"].startswith("grid ")
    assert json.loads(reader.texts["scene"])["animated"] is False


def test_a_title_that_looks_like_a_placeholder_is_text(leg: Description, tmp_path: Path) -> None:
    page = write_html(leg, [0.0], {}, tmp_path / "still.html", title="@viewer@ </title><script>")
    assert Reader(page.read_text(encoding="utf-8")).texts["title"] == "@viewer@ </title><script>"


def test_the_page_carries_the_copyright_notices(page: Path) -> None:
    notices = Reader(page.read_text(encoding="utf-8")).texts["licences"]
    for holder in ("Robin Deits", "three.js authors", "msgpack-lite"):
        assert holder in notices


def test_inlined_text_cannot_end_its_element() -> None:
    assert "</script" not in page_module._inline("a = '</script>'")
    assert "<!--" not in page_module._inline("<!-- x")


def test_a_missing_folder_is_a_named_error(leg: Description, tmp_path: Path) -> None:
    with pytest.raises(errors.PreviewError, match="existing folder") as caught:
        write_html(leg, [0.0], {}, tmp_path / "nowhere" / "leg.html")
    assert caught.value.evidence["path"] == tmp_path / "nowhere" / "leg.html"


def test_a_viewer_without_its_bundle_is_a_named_error(
    leg: Description, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(load_meshcat(), "viewer_assets_path", lambda: str(tmp_path))
    with pytest.raises(errors.PreviewError, match="reinstall meshcat"):
        write_html(leg, [0.0], {}, tmp_path / "leg.html")
    assert not (tmp_path / "leg.html").exists()


def test_bad_input_writes_nothing(leg: Description, tmp_path: Path) -> None:
    with pytest.raises(errors.ShapeError):
        write_html(leg, [0.0, 1.0], {"hip": [0.0]}, tmp_path / "leg.html")
    assert not (tmp_path / "leg.html").exists()
