"""Names, paths and text: what `read` makes of each, and where the shipped files are."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from leg_dynamics.description import Description, read, render, shipped, shipped_names, shipped_urdf, shipped_xacro
from leg_dynamics.errors import DescriptionError, LegNotFoundError, ParameterError, UnsafeXmlError

URDF = '<robot name="{}"><link name="a"/></robot>\n'
XACRO = """<robot name="{0}" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="parameters" default="{0}_parameters.yaml"/>
<xacro:property name="p" value="${{xacro.load_yaml('$(arg parameters)')}}"/>
<link name="a"><inertial><mass value="${{p.m.value}}"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link></robot>
"""


def populate(root: Path) -> None:
    (root / "urdf").mkdir(parents=True)
    (root / "xacro").mkdir()
    for name in ("twoleg", "oneleg"):
        (root / "xacro" / f"{name}.urdf.xacro").write_text(XACRO.format(name))
        (root / "xacro" / f"{name}_parameters.yaml").write_text("m: {value: 2.5, unit: kg, source: assumed}\n")
        (root / "urdf" / f"{name}.urdf").write_text(render(root / "xacro" / f"{name}.urdf.xacro"))
    (root / "urdf" / "plain.urdf").write_text(URDF.format("plain"))


@pytest.fixture(params=["checkout", "wheel"])
def installed(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    package = tmp_path / "site-packages" / "leg_dynamics"
    package.mkdir(parents=True)
    if request.param == "checkout":
        populate(package.parent)
    else:
        populate(package / "_data")
        (package.parent / "xacro").mkdir()  # site-packages/xacro is the renderer, not our data
        (package.parent / "urdf").mkdir()
        (package.parent / "urdf" / "foreign.urdf").write_text(URDF.format("foreign"))
    monkeypatch.setattr(shipped, "_PACKAGE", package)
    return tmp_path


def test_shipped_files_are_found_in_a_checkout_and_in_a_wheel(installed: Path) -> None:
    assert shipped_names() == ("oneleg", "plain", "twoleg")
    assert shipped_urdf("oneleg").read_text().endswith("</robot>\n")
    assert shipped_xacro("oneleg").name == "oneleg.urdf.xacro"
    for find in (shipped_urdf, shipped_xacro, read, render):
        with pytest.raises(
            LegNotFoundError, match=r"no shipped mechanism 'onleg'; did you mean 'oneleg'.*twoleg"
        ) as caught:
            find("onleg")
        assert isinstance(caught.value, FileNotFoundError)
        assert "oneleg" in caught.value.known  # type: ignore[attr-defined]
    with pytest.raises(LegNotFoundError):
        shipped_urdf("../urdf/oneleg")


def test_a_shipped_name_is_read_without_rendering(installed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("leg_dynamics.description.reading.render", lambda *_: pytest.fail("rendered"))
    leg = read("oneleg")
    assert (leg.name, leg.file, leg.source) == ("oneleg", str(shipped_urdf("oneleg")), None)
    assert leg.parameters["m"].value == 2.5
    assert read("plain").parameters == {}
    assert read("oneleg", parameters={}) == leg


def test_a_shipped_name_with_overrides_is_rendered(installed: Path) -> None:
    leg = read("oneleg", parameters={"m": 4})
    assert leg.link("a").inertial is not None
    assert leg.link("a").inertial.mass == 4.0  # type: ignore[union-attr]
    assert leg.parameters["m"].value == 4.0
    assert render("oneleg") == shipped_urdf("oneleg").read_text()
    with pytest.raises(LegNotFoundError, match="'plain'"):
        read("plain", parameters={"m": 4})


def test_a_shipped_name_wins_over_a_file_of_the_same_name(installed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(installed)
    Path("oneleg").write_text(URDF.format("impostor"))
    Path("stray").write_text(URDF.format("stray"))
    assert read("oneleg").name == "oneleg"
    assert read(Path("oneleg")).name == "impostor"
    assert read("stray").name == "stray"


def test_paths_and_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "mine.urdf"
    path.write_text("\ufeff" + URDF.format("mine"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for source in (path, str(path), "mine.urdf", "./mine.urdf", URDF.format("mine"), "\n " + URDF.format("mine")):
        description = read(source)
        assert isinstance(description, Description)
        assert description.name == "mine"
    assert read(path).file == str(path)
    assert read(URDF.format("mine")).file == "<string>"


@pytest.mark.parametrize(
    "source", ["something.urdf", "no/such", Path("nothing"), "x.urdf.xacro", "", "a\x00.urdf", "x" * 5000]
)
def test_what_is_not_there(source: str | Path) -> None:
    with pytest.raises(LegNotFoundError) as caught:
        read(source)
    assert len(str(caught.value)) < 1000


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(LegNotFoundError, match="it is a folder"):
        read(tmp_path)


def test_an_unreadable_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "mine.urdf"
    path.write_text(URDF.format("mine"))

    def refuse(_: Path, mode: str) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(DescriptionError, match=r"mine\.urdf: the file cannot be read: Permission denied"):
        read(path)


@pytest.mark.parametrize(
    ("data", "message", "line"),
    [
        (b"", "empty", None),
        (b'<robot name="x">\n<link name="\xe9"/></robot>', "not UTF-8: byte 0xe9 at offset 29", 2),
        ('<robot name="x">\n</robot>'.encode("utf-16"), "no <link>", 1),
        ('<robot name="x">\n</robot>'.encode("utf-16")[:-1], "not UTF-16", 2),
        (b'<robot name="x">\n', "truncated", 2),
        (b'<!DOCTYPE x [<!ENTITY y "z">]><robot name="&y;"/>', "DOCTYPE", 1),
    ],
)
def test_bad_files_are_named(tmp_path: Path, data: bytes, message: str, line: int | None) -> None:
    path = tmp_path / "bad.urdf"
    path.write_bytes(data)
    with pytest.raises(DescriptionError, match=message) as caught:
        read(path)
    assert (caught.value.file, caught.value.line) == (str(path), line)
    assert isinstance(caught.value, UnsafeXmlError) == (message == "DOCTYPE")


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large.urdf"
    text = URDF.format("large")
    path.write_text(f"<!--\n{'-' * 16_000_000}-->{text}")
    with pytest.raises(DescriptionError, match=r"large\.urdf:2: the file has 160\d+ bytes, the most is 16000000"):
        read(path)
    with pytest.raises(DescriptionError, match=r"the text has 160\d+ bytes, the most is 16000000"):
        read(f"{text[: -len('</robot>') - 1]}{' ' * 16_000_000}</robot>")


def test_only_xacro_has_parameters(tmp_path: Path) -> None:
    path = tmp_path / "mine.urdf"
    path.write_text(URDF.format("mine"))
    for source in (path, URDF.format("mine")):
        with pytest.raises(ParameterError, match=r"L1 cannot be set.*\.xacro"):
            read(source, parameters={"L1": 1.0})


def test_the_project_itself_ships_what_it_lists() -> None:
    root = Path(__file__).parents[2]
    assert set(shipped_names()) == {Path(name).stem for name in os.listdir(root / "urdf") if name.endswith(".urdf")}
    for name in shipped_names():
        assert shipped_urdf(name).is_file()


def test_the_same_file_in_two_places_is_the_same_mechanism(tmp_path: Path) -> None:
    path = tmp_path / "mine.urdf"
    path.write_text(URDF.format("mine"))
    other = Path(shutil.copy(path, tmp_path / "other.urdf"))
    assert read(path) == read(other)
    assert len({read(path), read(other), read(URDF.format("mine"))}) == 1


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"PL_1_ratio": 0}, "mechanicalReduction of .*'beta_transmission' is zero.* with PL_1_ratio = 0"),
        (
            {"PL_1_ratio": 1e300, "L1": 0.2},
            "'beta_transmission' felt at its joint.* with PL_1_ratio = 1e\\+300, L1 = 0.2",
        ),
        ({"M3_gear_ratio": 1e200}, "'gamma_transmission' felt at its joint.* with M3_gear_ratio = 1e\\+200"),
        ({"M1_rotor_inertia": 1e300, "M1_gear_ratio": 1e10}, "rotorInertia 1e\\+300 .*M1_gear_ratio = 10000000000"),
    ],
)
def test_what_parameters_make_impossible_names_them(parameters: dict[str, float], text: str) -> None:
    with pytest.raises(DescriptionError, match=text):
        read("omnileg", parameters=parameters)
