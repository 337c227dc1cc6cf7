"""The project's own promises: one version, every requirement pinned, data only in the wheel, a light import."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import leg_dynamics

ROOT = Path(__file__).parents[1]
PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
# Newer Pythons read TOML themselves, the oldest one that counts does not.
REQUIREMENT = re.compile(r'^    "(?P<name>[A-Za-z][\w.-]*)(?P<bounds>[<>=!~][^"]*)",$', re.MULTILINE)


def normalised(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def test_one_version():
    (version,) = re.findall(r'^version = "(.+)"$', PROJECT, re.MULTILINE)
    assert leg_dynamics.__version__ == version
    assert f"version: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## {version} " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_every_requirement_is_pinned():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[\w.-]+==[\w.!+-]+( ; .+)?", pin) for pin in pins)
    pinned = {normalised(pin.split("==")[0]) for pin in pins}
    required = {normalised(match["name"]) for match in REQUIREMENT.finditer(PROJECT)}
    assert len(required) > 15
    assert required <= pinned


def test_source_folders_do_not_shadow_packages():
    for folder in ("xacro", "urdf"):
        assert not list((ROOT / folder).rglob("__init__.py"))
    import xacro

    assert hasattr(xacro, "process_file")


def test_import_is_light():
    code = (
        "import sys, leg_dynamics, leg_dynamics.cli\n"
        "heavy = {'pinocchio', 'casadi', 'yourdfpy', 'xacro', 'scipy', 'matplotlib', 'meshcat'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_no_layer_contract_forgets_a_room():
    # import-linter checks the imports themselves; this says that nobody took a room off its list.
    layers = re.search(r"^layers = \[(.*?)^\]", PROJECT, re.MULTILINE | re.DOTALL)[1]
    rooms = {
        path.stem
        for path in (ROOT / "leg_dynamics").iterdir()
        if path.suffix == ".py" or (path / "__init__.py").exists()
    }
    assert rooms - {"__init__"} <= set(re.findall(r"\w+", layers))
    assert re.search(r"^exhaustive = true$", PROJECT, re.MULTILINE)


@pytest.mark.slow
def test_wheel_carries_the_legs(tmp_path):
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path), str(ROOT)]
    subprocess.run(command, check=True)
    (wheel,) = tmp_path.glob("leg_dynamics-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        archive.extractall(tmp_path / "unpacked")
    for name in ("xacro/omnileg.urdf.xacro", "xacro/omnileg_parameters.yaml", "urdf/omnileg.urdf"):
        assert f"leg_dynamics/_data/{name}" in names
    assert "leg_dynamics/py.typed" in names
    assert {name.split("/")[0].split("-")[0] for name in names} == {"leg_dynamics"}
    # The unpacked wheel finds its own files, not the checkout's.
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from leg_dynamics import description as d\n"
        "assert d.shipped_urdf('omnileg').is_relative_to(sys.argv[1])\n"
        "assert d.render('omnileg') == d.shipped_urdf('omnileg').read_text(encoding='utf-8')\n"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "unpacked")], check=True, cwd=tmp_path)
