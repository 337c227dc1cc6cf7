"""Malformed files: each is refused by name, with its line, in little time and memory, or is legal after all."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import leg_dynamics as ld
from leg_dynamics.errors import DescriptionError, LegDynamicsWarning

HERE = Path(__file__).parent
GROUP = 60


def _corpus() -> ModuleType:
    spec = importlib.util.spec_from_file_location("malformed_corpus", HERE / "malformed.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


corpus = _corpus()
NAMES = tuple(corpus.CASES)
GROUPS = [NAMES[first : first + GROUP] for first in range(0, len(NAMES), GROUP)]


def child(folder: Path, names: tuple[str, ...]) -> tuple[dict[str, dict[str, Any]], str]:
    done = subprocess.run(
        [sys.executable, HERE / "malformed.py", folder, *names],
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"LEG_DYNAMICS_CACHE": "", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(HERE.parents[1])},
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    ended = "" if done.returncode == 0 else f"exit code {done.returncode} in {lines[-1:]}: {done.stderr[-2000:]}"
    return {line["name"]: line for line in lines if "name" in line}, ended


def complaint(case: Any, found: dict[str, Any]) -> str | None:
    """What is wrong with the answer; None where nothing is."""
    if found.get("stray"):
        return "an exception that is none of the package's"
    if found["seconds"] > case.seconds:
        return f"more than {case.seconds} s"
    if case.error == "any":
        return None
    if found["error"] == corpus.LEGAL or case.error == corpus.LEGAL:
        return None if found["error"] == case.error else f"should be {case.error}"
    if case.error not in found["kinds"]:
        return f"should be {case.error}"
    if not re.search(case.match, found["message"], re.S):
        return f"should say {case.match}"
    if found["length"] > 12_000:
        return "a message longer than a page"
    if case.line == -1:
        return None if found["line"] is not None or case.load else "should have a line"
    return None if found["line"] == case.line else f"should be on line {case.line}"


@pytest.mark.parametrize("number", range(len(GROUPS)))
def test_malformed_files_are_refused_by_name(number: int, tmp_path: Path) -> None:
    names = GROUPS[number]
    if os.geteuid() == 0:
        names = tuple(name for name in names if name != "no permission")
    answers, ended = child(tmp_path, names)
    assert not ended
    assert list(answers) == list(names)
    wrong = {
        name: (reason, answers[name]) for name in names if (reason := complaint(corpus.CASES[name], answers[name]))
    }
    assert not wrong, "\n".join(f"{name}: {reason}: {str(found)[:600]}" for name, (reason, found) in wrong.items())


def test_no_mesh_is_ever_opened(tmp_path: Path) -> None:
    from leg_dynamics.preview.scene import build_scene

    opened: list[str] = []
    listening = True

    def listen(event: str, arguments: tuple[Any, ...]) -> None:
        if listening and event in ("open", "os.open", "socket.connect", "socket.getaddrinfo", "os.listdir"):
            opened.append(str(arguments[0]))

    secret = tmp_path / "passwd.stl"
    secret.write_text("solid secret")
    folder = tmp_path / "robot"
    folder.mkdir()
    names = (*corpus.MESHES, "../passwd.stl", secret.as_uri(), str(secret))
    shapes = "".join(corpus.MESH.format(name) for name in names)
    path = folder / "robot.urdf"
    path.write_text(corpus.swapped("</link>", f"{shapes}</link>"))
    # Imports what is imported at the first use.
    build_scene(ld.load(corpus.ARM).description, [0.0], {})
    sys.addaudithook(listen)
    try:
        for route in ("pinocchio", "symbolic"):
            with pytest.warns(LegDynamicsWarning, match="absolute paths"):
                leg = ld.load(path, route=route)
        for name in corpus.LOST_MESHES:
            with pytest.raises(DescriptionError, match=r"leaves its package|climbs"):
                ld.load(corpus.swapped("</link>", f"{corpus.MESH.format(name)}</link>"))
        with pytest.warns(LegDynamicsWarning, match="1 links have mesh files"):
            scene = build_scene(leg.description, [0.0], {"shoulder": [0.1], "elbow": [0.2]})
    finally:
        listening = False
    assert str(path) in opened
    for word in ("passwd", "zero", "127.0.0.1", ".stl"):
        assert not any(word in name for name in opened), opened
    assert b"secret" not in b"".join(scene.packed())
