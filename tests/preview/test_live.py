from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
import urllib.error
import urllib.parse
import urllib.request
import webbrowser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import umsgpack

from leg_dynamics import errors
from leg_dynamics.description.model import Description
from leg_dynamics.preview import LiveView, live, show_live
from leg_dynamics.preview.scene import Scene, build_scene


def port_of(url: str) -> int:
    port = urllib.parse.urlsplit(url).port
    assert port is not None
    return port


def answers(host: str, port: int) -> bool:
    with contextlib.suppress(OSError), socket.create_connection((host, port), timeout=5):
        return True
    return False


def wait_until_silent(port: int, seconds: float = 15.0) -> None:
    deadline = time.monotonic() + seconds
    while answers("127.0.0.1", port):
        assert time.monotonic() < deadline, "the server is still there"
        time.sleep(0.05)


def test_a_live_view_serves_this_machine_only_and_ends(leg: Description, motion: Any) -> None:
    with show_live(leg, *motion.arguments(), foot_trace=motion.foot) as view:
        assert view.url.startswith("http://127.0.0.1:")
        assert view.is_open
        assert repr(view) == f"<LiveView {view.url} open>"
        with urllib.request.urlopen(view.url, timeout=10) as answer:
            assert answer.status == 200
            assert b"MeshCat" in answer.read()
        port = port_of(view.url)
        if sys.platform == "linux":
            # All of 127/8 is this machine: a server on every interface would answer here too.
            assert not answers("127.0.0.2", port)
        started = time.monotonic()
    assert time.monotonic() - started < 6.0
    assert not view.is_open
    assert view._process.returncode == 0
    assert repr(view) == f"<LiveView {view.url} closed>"
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(view.url, timeout=5)
    view.close()


@pytest.mark.parametrize(("loop", "repetitions"), [(False, 1), (True, np.inf)])
def test_a_browser_that_comes_later_gets_the_whole_scene(
    leg: Description, motion: Any, loop: bool, repetitions: float
) -> None:
    from tornado.websocket import websocket_connect

    expected = build_scene(leg, *motion.arguments(), loop=loop).packed()

    async def listen(url: str) -> list[bytes]:
        connection = await websocket_connect(url, max_message_size=2**26)
        messages = [await asyncio.wait_for(connection.read_message(), 10.0) for _ in expected]
        connection.close()
        return messages

    with show_live(leg, *motion.arguments(), loop=loop) as view:
        received = asyncio.run(listen(f"ws://127.0.0.1:{port_of(view.url)}/"))
    assert sorted(received) == sorted(expected)
    (animation,) = [m for m in map(umsgpack.unpackb, received) if m["type"] == "set_animation"]
    assert animation["options"]["repetitions"] == repetitions


def test_two_views_have_two_addresses(leg: Description) -> None:
    with show_live(leg, [0.0], {}) as first, show_live(leg, [0.0], {}) as second:
        assert first.url != second.url
        assert first.is_open
        assert second.is_open


def test_the_browser_opens_when_asked(leg: Description, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    with show_live(leg, [0.0], {}, open_browser=True) as view:
        assert opened == [view.url]
    with show_live(leg, [0.0], {}):
        assert len(opened) == 1


def test_an_error_inside_the_block_ends_the_server(leg: Description) -> None:
    view = show_live(leg, [0.0], {})
    with pytest.raises(ZeroDivisionError), view:
        raise ZeroDivisionError
    assert not view.is_open


def test_waiting_ends_with_the_keyboard(leg: Description, monkeypatch: pytest.MonkeyPatch) -> None:
    view = show_live(leg, [0.0], {})
    wait = view._process.wait

    def interrupted(timeout: float | None = None) -> int:
        if timeout is None:
            raise KeyboardInterrupt
        return wait(timeout)

    monkeypatch.setattr(view._process, "wait", interrupted)
    view.wait()
    assert not view.is_open


@pytest.mark.skipif(os.name != "posix", reason="stops a process with a POSIX signal")
def test_a_server_that_hangs_is_ended_by_force(leg: Description, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_STOP_TIMEOUT", 0.3)
    view = show_live(leg, [0.0], {})
    os.kill(view._process.pid, signal.SIGSTOP)
    view.close()
    assert view._process.returncode == -signal.SIGKILL


@pytest.mark.skipif(os.name != "posix", reason="ends a process with a POSIX signal")
def test_the_server_does_not_outlive_a_killed_parent(leg: Description, tmp_path: Path) -> None:
    code = """
        import sys, time
        from leg_dynamics.description import parse
        from leg_dynamics.preview import show_live
        view = show_live(parse(sys.stdin.read()), [0.0], {})
        print(view.url, flush=True)
        time.sleep(60)
    """
    parent = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert parent.stdin is not None
    assert parent.stdout is not None
    with parent:
        parent.stdin.write(leg.urdf)
        parent.stdin.close()
        port = port_of(parent.stdout.readline().strip())
        assert answers("127.0.0.1", port)
        parent.kill()
    wait_until_silent(port)


def test_a_server_that_does_not_start_is_a_named_error(leg: Description, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_SERVER", "leg_dynamics.preview.no_such_module")
    with pytest.raises(errors.PreviewError, match=r"did not start .*no_such_module.*; write an HTML page"):
        show_live(leg, [0.0], {})


def test_a_server_that_says_nothing_is_a_named_error(leg: Description, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_SERVER", "json.tool")
    monkeypatch.setattr(live, "_START_TIMEOUT", 1.0)
    with pytest.raises(errors.PreviewError, match=r"did not start within 1 s \(it printed nothing\)"):
        show_live(leg, [0.0], {})


def test_a_refused_command_is_a_named_error_and_ends_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []

    class Recorded(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            started.append(self)

    monkeypatch.setattr(live.subprocess, "Popen", Recorded)
    odd = Scene(({"type": "dance", "path": "/leg"},), 0.0, 0.0, 1, np.zeros(3), np.ones(3), 0.1)
    with pytest.raises(errors.PreviewError, match="refused to draw '/leg'"):
        LiveView(odd)
    assert started[0].returncode == 0


def test_a_server_that_does_not_answer_is_a_named_error(leg: Description, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_REPLY_TIMEOUT", 0.2)
    with socket.socket() as deaf:
        deaf.bind(("127.0.0.1", 0))
        deaf.listen()
        with pytest.raises(errors.PreviewError, match=r"no reply within 0.2 s"):
            LiveView._send(f"tcp://127.0.0.1:{deaf.getsockname()[1]}", build_scene(leg, [0.0], {}))


def test_bad_input_starts_no_server(leg: Description, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live.subprocess, "Popen", lambda *_, **__: pytest.fail("a server was started"))
    with pytest.raises(errors.ShapeError):
        show_live(leg, [0.0, 1.0], {"hip": [0.0]})


def test_the_same_package_is_found_from_any_folder(
    leg: Description, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", "elsewhere")
    root, *rest = live._environment()["PYTHONPATH"].split(os.pathsep)
    assert (Path(root) / "leg_dynamics" / "preview" / "server.py").is_file()
    assert rest == ["elsewhere"]
    monkeypatch.delenv("PYTHONPATH")
    assert live._environment()["PYTHONPATH"] == root
