"""One HTML file that plays a motion anywhere: viewer, shapes and keyframes inside, nothing fetched."""

from __future__ import annotations

import base64
import html
import json
import math
import re
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

from numpy.typing import ArrayLike

from leg_dynamics.description.model import Description
from leg_dynamics.errors import PreviewError
from leg_dynamics.preview.cloud import Cloud
from leg_dynamics.preview.commands import load_meshcat
from leg_dynamics.preview.scene import Scene, build_scene
from leg_dynamics.preview.walking import Walking

__all__ = ["write_html"]


def write_html(
    description: Description,
    times: ArrayLike,
    joint_values: Mapping[str, ArrayLike],
    path: str | Path,
    *,
    foot_trace: ArrayLike | None = None,
    foot_force: ArrayLike | None = None,
    efforts: Mapping[str, ArrayLike] | None = None,
    actuator_links: Mapping[str, str] | None = None,
    effort_limits: Mapping[str, float] | None = None,
    cloud: Cloud | None = None,
    walking: Walking | None = None,
    title: str | None = None,
    fps: float = 30.0,
    loop: bool = True,
) -> Path:
    """Write a self-contained page that plays a motion.

    The page opens from disk in any browser with WebGL and asks the network for nothing. Drag to turn, scroll to zoom,
    space to pause. ``page.html#t=1.5`` opens it as a still at 1.5 s.

    Parameters
    ----------
    description : Description
        The mechanism.
    times : array_like, shape (T,)
        Increasing times, s; T = 1 gives a still.
    joint_values : mapping of str to array_like, shape (T,)
        Coordinate of each tree joint, rad or m (`leg.assemble` gives them); a joint that is left out stays at zero.
    path : str or Path
        The file to write; its folder must exist.
    foot_trace : array_like, shape (T, 3), optional
        Foot positions in the root frame, m: drawn as a coloured line.
    foot_force, efforts, actuator_links, effort_limits
        Forces to show, as for `leg_dynamics.preview.scene.build_scene`; a legend gives their scales and values.
    cloud : Cloud, optional
        Points to show beside the mechanism, such as its workspace.
    walking : Walking, optional
        How a robot moves over the ground: the ground passes below it.
    title : str, optional
        Heading; the mechanism's name by default.
    fps : float
        Animation frames a second.
    loop : bool
        Whether the motion starts again at its end; a periodic one then ends with its last whole cycle.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    DescriptionError, ShapeError, NonFiniteError, TrajectoryError, ParameterError, MissingFootError
        As `leg_dynamics.preview.scene.build_scene`.
    PreviewError
        The file cannot be written, or the installed meshcat lacks its viewer.
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
        walking=walking,
        fps=fps,
        loop=loop,
    )
    page = _page(scene, description.name, description.name if title is None else title)
    path = Path(path)
    try:
        path.write_text(page, encoding="utf-8", newline="\n")
    except OSError as error:
        raise PreviewError(
            f"cannot write the preview to {path}: {error.strerror}; name a file in an existing folder", path=path
        ) from error
    return path


def _page(scene: Scene, name: str, title: str) -> str:
    data = {
        "start": scene.start,
        "duration": scene.duration,
        "animated": any(command["type"] == "set_animation" for command in scene.commands),
        "commands": [base64.b64encode(message).decode("ascii") for message in scene.packed()],
    }
    facts = [name] if name != title else []
    if scene.duration > 0.0:
        facts.append(f"{scene.duration:.4g} s")
    if math.isfinite(scene.cell):
        facts.append(f"grid {1000.0 * scene.cell:.4g} mm")
    if scene.cyclic:
        facts.append("loops in whole cycles")
    if scene.note:
        facts.append(scene.note)
    parts = {
        "title": html.escape(title),
        "facts": html.escape(" \N{MIDDLE DOT} ".join(facts)),
        "scene": json.dumps(data),
        "legend": _inline(_asset("legend.js")),
        "viewer": _inline(_viewer_file("main.min.js")),
        "licences": _inline(_licences()),
    }
    return re.sub(r"@(title|facts|scene|legend|viewer|licences)@", lambda match: parts[match[1]], _asset("page.html"))


def _asset(name: str) -> str:
    return resources.files("leg_dynamics.preview").joinpath(name).read_text(encoding="utf-8")


def _inline(text: str) -> str:
    """Text that cannot end the script element that holds it."""
    return text.replace("</script", "<\\/script").replace("<!--", "<\\!--")


def _viewer_file(name: str) -> str:
    file = Path(load_meshcat().viewer_assets_path()) / "dist" / name
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise PreviewError(
            f"meshcat's viewer file {file} cannot be read: {error.strerror}; reinstall meshcat", path=file
        ) from error


def _licences() -> str:
    """Copyright notices of meshcat and of what its viewer bundles, which travel with every copy."""
    own = (Path("..") / "LICENSE").as_posix()
    bundled = json.loads(_viewer_file("main.min.js.THIRD_PARTY_LICENSES.json"))
    texts = [f"meshcat\n{_viewer_file(own)}"]
    texts += [f"{package['name']} {package['version']}\n{package['licenseText']}" for package in bundled]
    return "\n".join(texts)
