"""Importing the package is cheap and pulls in no heavy library; public names appear on first use."""

from __future__ import annotations

import subprocess
import sys

import pytest

import leg_dynamics

HEAVY = {"casadi", "llvmlite", "matplotlib", "meshcat", "pinocchio", "scipy", "xacro", "yourdfpy"}


def loaded_after(code: str) -> set[str]:
    """Top-level names of every module that a fresh interpreter has loaded after running `code`."""
    script = f"import sys\n{code}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], check=True, capture_output=True, text=True)
    return set(done.stdout.split())


def test_import_is_light():
    assert not HEAVY & loaded_after("import leg_dynamics")


@pytest.mark.parametrize("name", ["leg", "errors", "routes", "verification"])
def test_what_the_interface_needs_is_light_too(name):
    assert not HEAVY & loaded_after(f"import leg_dynamics.{name}")


def test_every_public_name_is_there_without_an_import_of_its_module():
    code = "import leg_dynamics\nfor name in leg_dynamics.__all__: getattr(leg_dynamics, name)"
    assert not HEAVY & loaded_after(code)


def test_a_numeric_leg_needs_no_symbolic_library():
    loaded = loaded_after("import leg_dynamics\nleg_dynamics.load('omnileg', route='pinocchio')")
    assert "pinocchio" in loaded
    assert not {"casadi", "matplotlib", "meshcat", "xacro"} & loaded


def test_public_names():
    assert set(leg_dynamics.__all__) <= set(dir(leg_dynamics))
    assert leg_dynamics.load is leg_dynamics.routes.load
    assert "omnileg" in leg_dynamics.available()
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = leg_dynamics.nonsense
