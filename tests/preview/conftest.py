"""A two-link leg whose kinematics fit on a line of trigonometry, and a headless browser to look at it."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from leg_dynamics.description import parse
from leg_dynamics.description.model import Description
from leg_dynamics.preview.still import CHROMIUM_NAMES, chromium_flags, find_chromium

THIGH, SHANK, FOOT_RADIUS = 0.2, 0.25, 0.03
COLOURS = {"base": (77, 77, 89), "thigh": (26, 102, 204), "shank": (230, 153, 26), "foot": (26, 153, 77)}


def _link(name: str, geometry: str, rgba: str, xyz: str = "0 0 0") -> str:
    return f"""
  <link name="{name}">
    <inertial>
      <origin xyz="{xyz}"/><mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>
    </inertial>
    <visual>
      <origin xyz="{xyz}"/><geometry>{geometry}</geometry>
      <material name="{name}_paint"><color rgba="{rgba}"/></material>
    </visual>
  </link>"""


LEG = f"""<robot name="planar_leg">
{_link("base", '<box size="0.2 0.16 0.03"/>', "0.3 0.3 0.35 1")}
{_link("thigh", f'<cylinder radius="0.02" length="{THIGH}"/>', "0.1 0.4 0.8 1", f"0 0 {-THIGH / 2}")}
{_link("shank", f'<box size="0.02 0.03 {SHANK}"/>', "0.9 0.6 0.1 1", f"0 0 {-SHANK / 2}")}
{_link("foot", f'<sphere radius="{FOOT_RADIUS}"/>', "0.1 0.6 0.3 1")}
  <joint name="hip" type="revolute">
    <parent link="base"/><child link="thigh"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="10"/>
  </joint>
  <joint name="knee" type="revolute">
    <parent link="thigh"/><child link="shank"/><origin xyz="0 0 {-THIGH}"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="10"/>
  </joint>
  <joint name="ankle" type="fixed"><parent link="shank"/><child link="foot"/><origin xyz="0 0 {-SHANK}"/></joint>
</robot>"""


@dataclass(frozen=True)
class Motion:
    times: np.ndarray
    joint_values: dict[str, np.ndarray]
    foot: np.ndarray

    def arguments(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        return self.times, self.joint_values


def planar_foot(hip: np.ndarray, knee: np.ndarray) -> np.ndarray:
    """Foot position of a leg that swings about +y: x = -l sin, z = -l cos."""
    x = -THIGH * np.sin(hip) - SHANK * np.sin(hip + knee)
    z = -THIGH * np.cos(hip) - SHANK * np.cos(hip + knee)
    return np.stack([x, np.zeros_like(x), z], axis=-1)


@pytest.fixture(scope="session")
def leg() -> Description:
    return parse(LEG)


@pytest.fixture(scope="session")
def motion() -> Motion:
    times = np.linspace(0.0, 2.0, 81)
    hip = -0.5 + 0.9 * times / 2.0
    knee = 0.5 * np.sin(np.pi * times / 2.0)
    return Motion(times, {"hip": hip, "knee": knee}, planar_foot(hip, knee))


@pytest.fixture(scope="session")
def rig() -> SimpleNamespace:
    """Facts about the test leg and readers of a scene's commands."""
    return SimpleNamespace(
        THIGH=THIGH,
        SHANK=SHANK,
        FOOT_RADIUS=FOOT_RADIUS,
        COLOURS=COLOURS,
        foot=planar_foot,
        commands_at=commands_at,
        matrix=matrix,
        clips=clips,
        Camera=Camera,
    )


def commands_at(commands: Any, kind: str, path: str) -> list[dict[str, Any]]:
    return [command for command in commands if command["type"] == kind and command["path"] == path]


def matrix(commands: Any, path: str) -> np.ndarray:
    """Homogeneous transform of a viewer node."""
    (command,) = commands_at(commands, "set_transform", path)
    return np.reshape(command["matrix"], (4, 4)).T


def clips(commands: Any) -> dict[str, dict[str, Any]]:
    """Of each animated node: its `rate` and the `position` and `quaternion` keyframes as arrays, and their `frames`."""
    found = {}
    for command in commands:
        if command["type"] == "set_animation":
            for animation in command["animations"]:
                clip: dict[str, Any] = {"rate": animation["clip"]["fps"]}
                for track in animation["clip"]["tracks"]:
                    clip[track["name"].lstrip(".")] = np.array([key["value"] for key in track["keys"]])
                    clip["frames"] = np.array([key["time"] for key in track["keys"]])
                found[animation["path"]] = clip
    return found


@dataclass(frozen=True)
class Camera:
    """Where a scene's camera projects points of the root frame, computed from its commands alone."""

    placement: np.ndarray
    eye: np.ndarray
    field_of_view: float

    @classmethod
    def of(cls, commands: Any) -> Camera:
        node = "/Cameras/default/rotated"
        (lens,) = commands_at(commands, "set_object", node)
        (position,) = [
            c for c in commands_at(commands, "set_property", f"{node}/<object>") if c["property"] == "position"
        ]
        x, y, z = position["value"]
        return cls(matrix(commands, "/leg"), np.array([x, -z, y]), np.radians(lens["object"]["object"]["fov"]))

    def project(self, points: np.ndarray) -> np.ndarray:
        """Screen coordinates (..., 2): right and up, ±1 at the edges of a square window."""
        seen = points @ self.placement[:3, :3].T + self.placement[:3, 3] - self.eye
        forward = -self.eye / np.linalg.norm(self.eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        depth = seen @ forward
        plane = np.stack([seen @ right, seen @ np.cross(right, forward)], axis=-1)
        return plane / (depth * np.tan(self.field_of_view / 2.0))[..., None]


class Browser:
    """A headless Chromium driven through its debugging port."""

    SIDE = 600

    def __init__(self, executable: str, profile: Path) -> None:
        self.loop = asyncio.new_event_loop()
        self.events: list[dict[str, Any]] = []
        self.process = subprocess.Popen(
            [executable, *chromium_flags(profile), "--remote-debugging-port=0", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            self._connect(profile / "DevToolsActivePort")
        except BaseException:
            self.close()
            raise

    def _connect(self, port_file: Path) -> None:
        from tornado.websocket import websocket_connect

        deadline = time.monotonic() + 60.0
        while not (port_file.is_file() and port_file.read_text().count("\n")):
            assert self.process.poll() is None, "the browser ended at once"
            assert time.monotonic() < deadline, "the browser did not start in time"
            time.sleep(0.05)
        port = int(port_file.read_text().splitlines()[0])
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=30) as answer:
            target = next(page for page in json.load(answer) if page["type"] == "page")

        async def connect() -> Any:
            return await websocket_connect(target["webSocketDebuggerUrl"], max_message_size=2**28)

        self.socket = self.loop.run_until_complete(connect())
        self.count = 0
        for domain in ("Log", "Network", "Page", "Runtime"):
            self.call(f"{domain}.enable")
        self.call(
            "Emulation.setDeviceMetricsOverride", width=self.SIDE, height=self.SIDE, deviceScaleFactor=1, mobile=False
        )

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self.count += 1
        number = self.count

        async def exchange() -> dict[str, Any]:
            await self.socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
            while True:
                message = json.loads(await self.socket.read_message())
                if message.get("id") == number:
                    return message
                self.events.append(message)

        answer = self.loop.run_until_complete(asyncio.wait_for(exchange(), 90.0))
        assert "error" not in answer, answer
        return answer["result"]

    def evaluate(self, expression: str) -> Any:
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def open(self, url: str) -> None:
        self.call("Page.navigate", url="about:blank")
        self.events.clear()
        self.call("Page.navigate", url=url)

    def open_page(self, url: str) -> None:
        """Open one of our pages and wait for its first picture."""
        self.open(url)
        self.wait_for("document.documentElement?.dataset.ready !== undefined")

    def wait_for(self, condition: str, seconds: float = 60.0) -> None:
        deadline = time.monotonic() + seconds
        while not self.evaluate(condition):
            assert time.monotonic() < deadline, f"still not: {condition}"
            time.sleep(0.05)

    def picture(self) -> np.ndarray:
        """What the window shows, shape (height, width, 3), 0..255."""
        from PIL import Image

        # The next frame but one surely shows what was asked for before this call.
        self.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        with Image.open(io.BytesIO(data)) as image:
            return np.asarray(image.convert("RGB")).astype(int)

    def requested(self) -> list[str]:
        return [e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"]

    def complaints(self) -> list[dict[str, Any]]:
        kinds = ("Runtime.exceptionThrown", "Log.entryAdded")
        return [
            e
            for e in self.events
            if e["method"] in kinds
            or (e["method"] == "Runtime.consoleAPICalled" and e["params"]["type"] in ("error", "assert"))
        ]

    def close(self) -> None:
        async def hang_up() -> None:
            self.socket.close()
            await asyncio.sleep(0.1)

        if hasattr(self, "socket"):
            self.loop.run_until_complete(hang_up())
        self.process.terminate()
        try:
            self.process.wait(15)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.loop.close()


@pytest.fixture(scope="session")
def chromium() -> str:
    executable = find_chromium()
    if executable is None:
        pytest.skip(f"no browser: none of {', '.join(CHROMIUM_NAMES)} is installed")
    return executable


@pytest.fixture(scope="module")
def browser(chromium: str) -> Iterator[Browser]:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(chromium, Path(profile))
        yield browser
        browser.close()
