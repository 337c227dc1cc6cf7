"""A motion in the browser, served by a meshcat server on this machine."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import IO

from numpy.typing import ArrayLike

from leg_dynamics.description.model import Description
from leg_dynamics.errors import PreviewError
from leg_dynamics.preview.cloud import Cloud
from leg_dynamics.preview.scene import Scene, build_scene

__all__ = ["LiveView", "show_live"]

_SERVER = "leg_dynamics.preview.server"
_START_TIMEOUT = 30.0
_REPLY_TIMEOUT = 10.0
_STOP_TIMEOUT = 5.0


class LiveView:
    """A running meshcat server and the motion that it shows; use it in a `with` block or call `close`.

    Parameters
    ----------
    scene : Scene
        What to show.

    Attributes
    ----------
    url : str
        Address to open in a browser on this machine.

    Raises
    ------
    PreviewError
        The server does not start or does not answer.
    """

    url: str

    def __init__(self, scene: Scene) -> None:
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed by close()
        self._process = subprocess.Popen(
            [sys.executable, "-u", "-m", _SERVER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            env=_environment(),
        )
        try:
            zmq_url = self._announced("zmq_url")
            self.url = self._announced("web_url")
            self._send(zmq_url, scene)
        except BaseException:
            self.close()
            raise

    def __repr__(self) -> str:
        return f"<LiveView {self.url} {'open' if self.is_open else 'closed'}>"

    def __enter__(self) -> LiveView:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    @property
    def is_open(self) -> bool:
        """Whether the server still runs."""
        return self._process.poll() is None

    def wait(self) -> None:
        """Serve until interrupted from the keyboard (Ctrl-C), then close."""
        with contextlib.suppress(KeyboardInterrupt):
            self._process.wait()
        self.close()

    def close(self) -> None:
        """End the server process; harmless when it has ended."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(_STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()
        self._log.close()

    def _announced(self, name: str) -> str:
        """The address that the server prints under this name."""
        stdout: IO[bytes] | None = self._process.stdout
        assert stdout is not None
        deadline = threading.Timer(_START_TIMEOUT, self._process.kill)
        deadline.start()
        try:
            line = stdout.readline().decode("utf-8", "replace").strip()
        finally:
            deadline.cancel()
        key, _, address = line.partition("=")
        if key != name:
            self._log.seek(0)
            reason = self._log.read().decode("utf-8", "replace").strip().splitlines()[-1:] or ["it printed nothing"]
            raise PreviewError(
                f"the meshcat server did not start within {_START_TIMEOUT:g} s ({reason[0]}); write an HTML page "
                "instead, which needs no server",
                reason=reason[0],
            )
        return address

    @staticmethod
    def _send(zmq_url: str, scene: Scene) -> None:
        import zmq

        with zmq.Context() as context, context.socket(zmq.REQ) as socket:
            socket.setsockopt(zmq.LINGER, 0)
            socket.setsockopt(zmq.SNDTIMEO, int(1000 * _REPLY_TIMEOUT))
            socket.setsockopt(zmq.RCVTIMEO, int(1000 * _REPLY_TIMEOUT))
            socket.connect(zmq_url)
            for command, message in zip(scene.commands, scene.packed(), strict=True):
                # The server tells a new browser everything in the order of its own tree: at the root, the animation
                # would come before the materials that it colours.
                path = "animation" if command["type"] == "set_animation" else command["path"]
                try:
                    socket.send_multipart([command["type"].encode(), path.encode(), message])
                    reply = socket.recv()
                except zmq.Again:
                    reply = f"no reply within {_REPLY_TIMEOUT:g} s".encode()
                if reply != b"ok":
                    raise PreviewError(
                        f"the meshcat server refused to draw {command['path']!r} ({reply.decode()}); write an HTML "
                        "page instead, which needs no server",
                        reason=reply.decode(),
                    )


def _environment() -> dict[str, str]:
    """This process's environment, in which the server finds the same package."""
    root = str(Path(__file__).resolve().parents[2])
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))}


def show_live(
    description: Description,
    times: ArrayLike,
    joint_values: Mapping[str, ArrayLike],
    *,
    foot_trace: ArrayLike | None = None,
    foot_force: ArrayLike | None = None,
    efforts: Mapping[str, ArrayLike] | None = None,
    actuator_links: Mapping[str, str] | None = None,
    effort_limits: Mapping[str, float] | None = None,
    cloud: Cloud | None = None,
    fps: float = 30.0,
    open_browser: bool = False,
    loop: bool = False,
) -> LiveView:
    """Serve a motion to browsers on this machine.

    Each browser that opens the address plays the motion from its start.

    Parameters
    ----------
    description : Description
        The mechanism.
    times : array_like, shape (T,)
        Increasing times, s; T = 1 gives a still.
    joint_values : mapping of str to array_like, shape (T,)
        Coordinate of each tree joint, rad or m; a joint that is left out stays at zero.
    foot_trace : array_like, shape (T, 3), optional
        Foot positions in the root frame, m: drawn as a coloured line.
    foot_force, efforts, actuator_links, effort_limits
        Forces to show, as for `leg_dynamics.preview.scene.build_scene`.
    cloud : Cloud, optional
        Points to show beside the mechanism, such as its workspace.
    fps : float
        Animation frames a second.
    open_browser : bool
        Whether to open the default browser.
    loop : bool
        Whether the motion starts again at its end; a periodic one then ends with its last whole cycle.

    Returns
    -------
    LiveView
        Holds the address in `url`; close it to end the server.

    Raises
    ------
    DescriptionError, ShapeError, NonFiniteError, TrajectoryError, ParameterError, MissingFootError
        As `leg_dynamics.preview.scene.build_scene`.
    PreviewError
        The server does not start or does not answer.
    """
    scene = build_scene(
        description,
        times,
        joint_values,
        foot_trace=foot_trace,
        foot_force=foot_force,
        efforts=efforts,
        actuator_links=actuator_links,
        effort_limits=effort_limits,
        cloud=cloud,
        fps=fps,
        loop=loop,
    )
    view = LiveView(scene)
    if open_browser:
        webbrowser.open(view.url)
    return view
