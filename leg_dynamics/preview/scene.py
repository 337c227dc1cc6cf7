"""What a preview shows: a mechanism's shapes moving along joint trajectories, as commands for a meshcat viewer.

The commands are built without any viewer or server, so that the page writer and the live view draw the same scene.
The scene is moved to the origin and scaled to unit radius under the path ``/leg``: a hand and a walking excavator then
share one camera, one set of lights and one shadow map, and the mouse turns the view about the middle of the mechanism.
"""

from __future__ import annotations

import itertools
import math
import uuid
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leg_dynamics.description.model import Description, Visual
from leg_dynamics.errors import (
    LegDynamicsWarning,
    MissingFootError,
    NonFiniteError,
    ParameterError,
    ShapeError,
    TrajectoryError,
)
from leg_dynamics.preview.arrow import ARROW_COLOUR, Arrow
from leg_dynamics.preview.cloud import Cloud
from leg_dynamics.preview.colours import diverging, hexadecimal
from leg_dynamics.preview.commands import (
    Y_TO_Z,
    Colour,
    clip,
    load_meshcat,
    set_object,
    set_property,
    set_transform,
    viewer_path,
)
from leg_dynamics.preview.cycle import whole_cycles
from leg_dynamics.preview.motors import Motor, check_motors, effort_ranges, legend_group
from leg_dynamics.preview.walking import Walking

__all__ = ["MAXIMUM_FRAMES", "Scene", "build_scene", "check_motion", "load_meshcat"]

MAXIMUM_FRAMES = 1200
"""Above this many animation frames the frame rate is lowered, with a warning, to keep pages a few megabytes small."""

_PALETTE: tuple[Colour, ...] = (
    (0.36, 0.47, 0.60, 1.0),
    (0.72, 0.74, 0.77, 1.0),
    (0.85, 0.58, 0.28, 1.0),
    (0.42, 0.60, 0.50, 1.0),
    (0.55, 0.48, 0.62, 1.0),
    (0.78, 0.69, 0.50, 1.0),
)
_BONE: Colour = (0.62, 0.66, 0.71, 1.0)
_JOINT: Colour = (0.87, 0.45, 0.13, 1.0)
_TRACE: Colour = (0.86, 0.10, 0.34, 1.0)
_PALE = (0.66, 0.92)
"""Greys of what was black and what was white, where only the motors are in colour."""
_GROUND: Colour = (0.80, 0.82, 0.84, 1.0)
_GRID: Colour = (0.60, 0.63, 0.67, 1.0)

_FIELD_OF_VIEW = math.radians(28.0)
_VIEW_DIRECTION = (1.0, -0.85, 0.42)
_FILLED = 0.90
_TUBE_SIDES = 8
_GROUND_RADIUS = 1.3
_CELLS_ACROSS = 16


@dataclass(frozen=True, slots=True)
class Scene:
    """A recorded motion, ready for a meshcat viewer.

    Attributes
    ----------
    commands : tuple of mapping
        What meshcat's own `commands` classes lower to, in drawing order.
    start, duration : float
        Time of the first sample and time span of the motion, s; the animation itself runs from 0 to `duration`.
    frames : int
        Number of animation frames, 1 for a still.
    lower, upper : numpy.ndarray
        Corners of the box about everything that is drawn, over the whole motion, in the root frame, shape (3,), m.
    cell : float
        Side of a cell of the ground grid, m; of a walking robot along x, and NaN where it turns and has none.
    cyclic : bool
        Whether the animation repeats a motion that ends as it starts, so that nothing jumps.
    legend : mapping
        What the page's legend says about forces and efforts; empty where none is shown. It also travels in the
        commands, as the `userData` of ``/leg``.
    note : str
        What the colours of a cloud mean.
    """

    commands: tuple[Mapping[str, Any], ...]
    start: float
    duration: float
    frames: int
    lower: np.ndarray
    upper: np.ndarray
    cell: float
    cyclic: bool = False
    legend: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""

    def packed(self) -> tuple[bytes, ...]:
        """Each command as the message that a meshcat viewer decodes."""
        import umsgpack

        return tuple(umsgpack.packb(command, force_float_precision="single") for command in self.commands)


@dataclass(frozen=True, slots=True)
class _Motion:
    times: np.ndarray
    joint_values: dict[str, np.ndarray]
    foot_trace: np.ndarray | None
    foot_force: np.ndarray | None = None
    motors: tuple[Motor, ...] = ()
    walking: Walking | None = None

    def at(self, times: np.ndarray) -> _Motion:
        """The motion interpolated linearly at other times."""

        def columns(values: np.ndarray | None) -> np.ndarray | None:
            if values is None:
                return None
            return np.stack([np.interp(times, self.times, values[:, axis]) for axis in range(3)], axis=-1)

        return _Motion(
            times,
            {name: np.interp(times, self.times, q) for name, q in self.joint_values.items()},
            columns(self.foot_trace),
            columns(self.foot_force),
            tuple(motor.at(times, self.times) for motor in self.motors),
            None if self.walking is None else self.walking.at(times, self.times),
        )


@dataclass(frozen=True, slots=True)
class _Shape:
    """A primitive and its pose in its link; `size` as in `Geometry`."""

    kind: str
    size: tuple[float, ...]
    pose: np.ndarray
    rgba: Colour

    def bounds(self, link: np.ndarray) -> np.ndarray:
        """Corners (2, 3) of the root frame's box about the shape in all poses (frames, 4, 4) of its link."""
        pose = link @ self.pose
        if self.kind == "box":
            half = np.abs(pose[:, :3, :3]) @ (np.array(self.size) / 2.0)
        elif self.kind == "cylinder":
            radius, length = self.size
            axis = np.minimum(np.abs(pose[:, :3, 2]), 1.0)
            half = axis * length / 2.0 + radius * np.sqrt(1.0 - axis**2)
        else:
            half = np.full(3, self.size[0])
        return np.stack([(pose[:, :3, 3] - half).min(axis=0), (pose[:, :3, 3] + half).max(axis=0)])


def check_motion(
    description: Description,
    times: ArrayLike,
    joint_values: Mapping[str, ArrayLike],
    foot_trace: ArrayLike | None = None,
) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray | None]:
    """The inputs of a preview as arrays, or a named error.

    Parameters
    ----------
    description : Description
        The mechanism.
    times : array_like, shape (T,)
        Increasing times, s.
    joint_values : mapping of str to array_like, shape (T,)
        Coordinate of each tree joint, rad or m.
    foot_trace : array_like, shape (T, 3), optional
        Foot positions in the root frame, m.

    Returns
    -------
    times, joint_values, foot_trace
        The same as float arrays; `foot_trace` stays None where none was given.

    Raises
    ------
    DescriptionError
        There is no joint of that name.
    ShapeError
        An array is not numeric or its length is not T.
    NonFiniteError
        An array holds NaN or infinity.
    TrajectoryError
        The times do not increase.
    """
    checked_times = _numbers("times", times)
    if checked_times.ndim != 1 or checked_times.size == 0:
        raise ShapeError(f"times has shape {checked_times.shape}; give one time a sample, shape (T,) with T >= 1")
    _require_finite("times", checked_times)
    stalled = np.flatnonzero(np.diff(checked_times) <= 0.0)
    if stalled.size:
        k = int(stalled[0])
        raise TrajectoryError(
            f"times must increase, but sample {k + 1} at {checked_times[k + 1]:g} s follows sample {k} at "
            f"{checked_times[k]:g} s; sort the samples and drop repeated ones",
            rows=stalled + 1,
        )
    samples = checked_times.size
    checked_values: dict[str, np.ndarray] = {}
    for name, values in joint_values.items():
        description.joint(name)
        checked_values[name] = _numbers(f"joint_values[{name!r}]", values)
        if checked_values[name].shape != (samples,):
            raise ShapeError(
                f"joint_values[{name!r}] has shape {checked_values[name].shape}, but there are {samples} times; "
                f"give shape ({samples},)"
            )
        _require_finite(f"joint_values[{name!r}]", checked_values[name])
    return checked_times, checked_values, _vectors("foot_trace", foot_trace, samples)


def _vectors(name: str, values: ArrayLike | None, samples: int) -> np.ndarray | None:
    if values is None:
        return None
    checked = _numbers(name, values)
    if checked.shape != (samples, 3):
        raise ShapeError(f"{name} has shape {checked.shape}, but there are {samples} times; give shape ({samples}, 3)")
    _require_finite(name, checked)
    return checked


def _check_force(foot_force: ArrayLike | None, foot_trace: np.ndarray | None, samples: int) -> np.ndarray | None:
    checked = _vectors("foot_force", foot_force, samples)
    if checked is not None and foot_trace is None:
        raise MissingFootError("foot_force is drawn at the foot, but foot_trace does not say where that is; give both")
    return checked


def _check_walking(walking: Walking | None, samples: int) -> Walking | None:
    if walking is not None and walking.yaw.size != samples:
        raise ShapeError(f"the walk has {walking.yaw.size} samples, but there are {samples} times")
    return walking


def build_scene(
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
    walking: Walking | None = None,
    fps: float = 30.0,
    loop: bool = True,
) -> Scene:
    """Draw a mechanism along a motion.

    Joint coordinates are interpolated linearly onto the animation frames. Shapes are the file's boxes, cylinders and
    spheres in their colours. A link whose shape is a mesh file shows its piece of the joint skeleton instead, with a
    warning; a file without any drawable shape shows its whole skeleton. Where efforts are given, the motors alone are
    in colour, over time: blue for negative, nearly white for zero, orange for positive.

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
    foot_force : array_like, shape (T, 3), optional
        Force that the environment applies to the foot, N, in the root frame (`in_root_frame` turns it there): an
        arrow that starts at the foot, of which `foot_trace` says where it is.
    efforts : mapping of str to array_like, shape (T,), optional
        Effort of each actuator, N·m or N, by its name in the file's transmissions (else the joint's name).
    actuator_links : mapping of str to str, optional
        Link to colour, or joint whose child link to colour, for an actuator where it is neither the link
        ``motor_<actuator>`` nor, without such a link, the child link of the actuated joint.
    effort_limits : mapping of str to float, optional
        Largest effort of an actuator, both ways, N·m or N; the limits of its joint where not given.
    cloud : Cloud, optional
        Points to show beside the mechanism, such as its workspace.
    walking : Walking, optional
        How the robot moves over the ground, at the same times: the ground passes below it.
    fps : float
        Animation frames a second.
    loop : bool
        Whether the animation starts again at its end. A periodic motion is then shown up to the end of its last
        whole cycle, so that nothing jumps.

    Returns
    -------
    Scene

    Raises
    ------
    DescriptionError, ShapeError, NonFiniteError, TrajectoryError
        As `check_motion` and `leg_dynamics.preview.motors.check_motors`.
    MissingFootError
        There is a `foot_force` and no `foot_trace`.
    ParameterError
        `fps` is not a positive number; or as `leg_dynamics.preview.motors.check_motors`.

    Warns
    -----
    LegDynamicsWarning
        Mesh files are not drawn; the frame rate was lowered to keep within `MAXIMUM_FRAMES`; the last part of a
        cycle was left out; or a motor has no shape to colour.
    """
    from leg_dynamics.description import link_transforms

    motion = _Motion(*check_motion(description, times, joint_values, foot_trace))
    motion = replace(
        motion,
        foot_force=_check_force(foot_force, motion.foot_trace, motion.times.size),
        motors=check_motors(description, motion.times.size, efforts or {}, actuator_links, effort_limits),
        walking=_check_walking(walking, motion.times.size),
    )
    last = whole_cycles(motion.times, motion.joint_values)
    motion = _at_frames(motion, fps, last if loop else None)
    frames = motion.times.size
    transforms = {
        link: np.broadcast_to(np.asarray(transform, dtype=float), (frames, 4, 4))
        for link, transform in link_transforms(description, motion.joint_values).items()
    }
    shapes = _shapes(description, motion.joint_values, transforms)
    ranges = effort_ranges(motion.motors)
    _paint(shapes, motion.motors, ranges)
    points = [shape.bounds(transforms[link]) for link, drawn in shapes.items() for shape in drawn]
    if motion.foot_trace is not None:
        points.append(motion.foot_trace)
    if cloud is not None:
        points.append(cloud.points)
    if motion.walking is not None:
        points.append(motion.walking.feet.reshape(-1, 3))
    lower, upper, radius = _box(points)
    cell = _round_length(2.0 * _GROUND_RADIUS * radius / _CELLS_ACROSS)
    arrow = None
    if motion.foot_trace is not None and motion.foot_force is not None:
        arrow = Arrow.of(motion.foot_trace, motion.foot_force, cell, radius)
        lower, upper, radius = _box([*points, arrow.tips])

    start, duration = float(motion.times[0]), float(motion.times[-1] - motion.times[0])
    rate = (frames - 1) / duration if frames > 1 else fps
    legend = _legend(motion.motors, ranges, arrow, rate)
    clips = _link_clips(shapes, transforms, rate) | _colour_clips(shapes, motion.motors, ranges, rate)
    if arrow is not None:
        clips |= arrow.clips(rate)
    ground: list[dict[str, Any]] = []
    if motion.walking is not None:
        floor, spread = _floor(lower, upper), _GROUND_RADIUS * radius
        ground, passing = motion.walking.draw(floor, spread, cell, radius, rate)
        clips |= passing
    commands = itertools.chain(
        _surroundings(lower, upper, radius, None if motion.walking is not None else cell),
        ground,
        _links(shapes, transforms),
        _traces(motion, radius),
        () if arrow is None else arrow.commands(),
        () if cloud is None else cloud.commands(),
        [set_property("/leg", "userData", {"legend": legend})] if legend else (),
        _animation(clips, loop),
    )
    if motion.walking is not None:
        cell = math.nan if motion.walking.turns else motion.walking.cells(cell)[0]
    cyclic, note = loop and last is not None, "" if cloud is None else cloud.note
    return Scene(tuple(commands), start, duration, frames, lower, upper, cell, cyclic, legend, note)


def _box(points: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, float]:
    """Corners of the box about all points, and half its diagonal."""
    every_point = np.concatenate(points)
    lower, upper = every_point.min(axis=0), every_point.max(axis=0)
    return lower, upper, float(np.linalg.norm(upper - lower)) / 2.0 or 0.1


def _paint(shapes: dict[str, list[_Shape]], motors: tuple[Motor, ...], ranges: Mapping[str, float]) -> None:
    """Give the motors the colours of their first efforts, and take the other links' colours away."""
    if not motors:
        return
    colours = {motor.link: diverging(motor.efforts[0] / ranges[motor.unit]) for motor in motors}
    for link, drawn in shapes.items():
        if link in colours:
            shapes[link] = [replace(shape, rgba=(*colours[link], shape.rgba[3])) for shape in drawn]
        else:
            shapes[link] = [replace(shape, rgba=_pale(shape.rgba)) for shape in drawn]
    bare = [motor.actuator for motor in motors if not shapes[motor.link]]
    if bare:
        warnings.warn(
            f"nothing is drawn on the links of {_abridged(bare)}, so that only the legend shows these efforts; name "
            "other links in actuator_links",
            LegDynamicsWarning,
            stacklevel=4,
        )


def _pale(rgba: Colour) -> Colour:
    """A light grey that keeps something of a colour's brightness."""
    brightness = 0.30 * rgba[0] + 0.59 * rgba[1] + 0.11 * rgba[2]
    grey = _PALE[0] + (_PALE[1] - _PALE[0]) * brightness
    return (grey, grey, grey * 1.02, rgba[3])


def _legend(motors: tuple[Motor, ...], ranges: Mapping[str, float], arrow: Arrow | None, rate: float) -> dict[str, Any]:
    legend: dict[str, Any] = {}
    if motors:
        legend["efforts"] = [
            legend_group(unit, end, tuple(motor for motor in motors if motor.unit == unit))
            for unit, end in ranges.items()
        ]
    if arrow is not None:
        legend["force"] = {
            "colour": hexadecimal(ARROW_COLOUR[:3]),
            "values": arrow.magnitudes.tolist(),
            "scale": f"one grid square ({1000.0 * arrow.cell:.4g} mm) is {arrow.newtons_per_cell:g} N",
        }
    return legend | {"rate": rate} if legend else {}


def _numbers(name: str, values: ArrayLike) -> np.ndarray:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name} is not an array of numbers ({error}); give floats") from None


def _require_finite(name: str, values: np.ndarray) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        rows = np.flatnonzero(bad.reshape(values.shape[0], -1).any(axis=1))
        raise NonFiniteError(
            f"{name} holds NaN or infinity in {rows.size} of {values.shape[0]} samples, first in sample {rows[0]}; "
            "drop these samples or repair what computed them",
            rows=rows,
        )


def _at_frames(motion: _Motion, fps: float, last: int | None) -> _Motion:
    """The motion at the animation's frames, up to the sample `last` where one is given."""
    if not (math.isfinite(fps) and fps > 0.0):
        raise ParameterError(f"fps is {fps!r}, but must be a positive number of frames a second; 30 is usual")
    times = motion.times
    if times.size == 1:
        return motion
    end = times[-1 if last is None else last]
    if end < times[-1]:
        warnings.warn(
            f"the motion repeats itself and stops {times[-1] - end:.4g} s into a cycle; the loop shows the whole "
            f"cycles, {end - times[0]:.4g} s, and leaves the rest out (loop=False shows all)",
            LegDynamicsWarning,
            stacklevel=4,
        )
    duration = float(end - times[0])
    frames = max(2, round(duration * fps) + 1)
    if frames > MAXIMUM_FRAMES:
        warnings.warn(
            f"{duration:g} s at {fps:g} frames a second are {frames} frames; the preview keeps {MAXIMUM_FRAMES}, that "
            f"is {(MAXIMUM_FRAMES - 1) / duration:.3g} a second; give a shorter trajectory for a smoother picture",
            LegDynamicsWarning,
            stacklevel=4,
        )
        frames = MAXIMUM_FRAMES
    return motion.at(np.linspace(times[0], end, frames))


def _shapes(
    description: Description, joint_values: Mapping[str, np.ndarray], transforms: Mapping[str, np.ndarray]
) -> dict[str, list[_Shape]]:
    """Drawable shapes of each link; the skeleton where the file has none."""
    shapes: dict[str, list[_Shape]] = {}
    meshes: list[str] = []
    for index, link in enumerate(description.links):
        primitives = [visual for visual in link.visuals if visual.geometry.kind != "mesh"]
        shapes[link.name] = [_primitive(visual, _PALETTE[index % len(_PALETTE)]) for visual in primitives]
        if len(primitives) < len(link.visuals):
            meshes.append(link.name)
    skeleton = meshes
    if not any(shapes.values()):
        skeleton = [link.name for link in description.links]
    if meshes:
        warnings.warn(
            f"{description.name}: {len(meshes)} links have mesh files ({_abridged(meshes)}); the preview draws boxes, "
            "cylinders and spheres only and shows the joint skeleton of these links instead",
            LegDynamicsWarning,
            stacklevel=4,
        )
    if skeleton:
        origins = np.concatenate([transform[:, :3, 3] for transform in transforms.values()])
        radius = 0.012 * float(np.ptp(origins, axis=0).max()) or 0.01
        for name in skeleton:
            shapes[name] += _bones(description, name, joint_values, radius)
    return shapes


def _primitive(visual: Visual, colour: Colour) -> _Shape:
    return _Shape(visual.geometry.kind, visual.geometry.size, visual.origin.matrix(), visual.rgba or colour)


def _abridged(names: list[str], shown: int = 3) -> str:
    return ", ".join(names[:shown]) + (", ..." if len(names) > shown else "")


def _bones(
    description: Description, link: str, joint_values: Mapping[str, np.ndarray], radius: float
) -> Iterator[_Shape]:
    """A ball at the link's own joint and bars to the joints and loop ends that it carries."""
    ball = np.eye(4)
    yield _Shape("sphere", (2.0 * radius,), ball, _JOINT)
    ends = [joint.origin.xyz for joint in description.joints if joint.parent == link]
    for loop in description.loops:
        ends += [end.origin.xyz for end in (loop.predecessor, loop.successor) if end.link == link]
    path = description.path(link)
    if path and path[-1].type == "prismatic":
        # The slide leaves a gap that belongs to no link: the moving link carries a bar back along it.
        q = joint_values.get(path[-1].name, np.zeros(1))
        reach = q[np.argmax(np.abs(q))]
        ends.append(tuple(-reach * component for component in path[-1].axis))
    for end in dict.fromkeys(ends):
        length = math.hypot(*end)
        if length > radius:
            yield _Shape("cylinder", (radius, length), _along(np.array(end)), _BONE)


def _along(end: np.ndarray) -> np.ndarray:
    """Pose of a cylinder that reaches from the origin to `end`."""
    z = end / np.linalg.norm(end)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = end / 2.0
    return pose


def _round_length(length: float) -> float:
    """The 1, 2 or 5 times a power of ten next below a length."""
    decade = 10.0 ** math.floor(math.log10(length))
    return next(step * decade for step in (5.0, 2.0, 1.0) if step * decade <= length * (1.0 + 1e-9))


def _floor(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Middle of the ground, on which the lowest point rests."""
    return np.array([*(lower + upper)[:2] / 2.0, lower[2]])


def _surroundings(lower: np.ndarray, upper: np.ndarray, radius: float, cell: float | None) -> Iterator[dict[str, Any]]:
    """Background, lights, camera and ground, with a grid that stands still where it has cells."""
    meshcat = load_meshcat()
    yield set_property("/Background", "top_color", [0.97, 0.98, 0.99])
    yield set_property("/Background", "bottom_color", [0.78, 0.82, 0.87])
    for name in ("/Grid", "/Axes"):
        yield set_property(name, "visible", False)
    yield set_property("/Lights/AmbientLight/<object>", "intensity", 0.50)
    yield set_property("/Lights/FillLight/<object>", "intensity", 0.18)
    yield set_property("/Lights/PointLightNegativeX/<object>", "intensity", 0.12)
    yield set_property("/Lights/PointLightPositiveX/<object>", "intensity", 0.20)
    spot = "/Lights/SpotLight/<object>"
    yield set_property("/Lights/SpotLight", "visible", True)
    for name, value in {
        "position": [1.6, -2.4, 4.2],
        "intensity": 0.50,
        "angle": 0.42,
        "penumbra": 0.9,
        "castShadow": True,
    }.items():
        yield set_property(spot, name, value)

    scaled = np.diag([1.0 / radius] * 3 + [1.0])
    scaled[:3, 3] = -(lower + upper) / (2.0 * radius)
    yield set_transform("/leg", scaled)

    camera = "/Cameras/default/rotated"
    lens = meshcat.geometry.PerspectiveCamera(fov=math.degrees(_FIELD_OF_VIEW), near=0.05, far=100.0)
    lens.uuid = str(uuid.uuid5(uuid.NAMESPACE_URL, "camera"))
    yield meshcat.commands.SetObject(lens, path=viewer_path(camera)).lower()
    x, y, z = _eye((upper - lower) / (2.0 * radius))
    yield set_property(f"{camera}/<object>", "position", [x, z, -y])

    floor = _floor(lower, upper)
    thickness, spread = 0.02 * radius, _GROUND_RADIUS * radius
    below = np.eye(4)
    # A hair below the lowest point, so that a foot plate that rests on it does not flicker.
    below[:3, 3] = floor - [0.0, 0.0, 0.004 * radius + thickness / 2.0]
    yield set_object("/leg/ground/plate", meshcat.geometry.Cylinder(thickness, spread), _GROUND)
    yield set_transform("/leg/ground/plate", below @ Y_TO_Z)
    on_top = np.eye(4)
    on_top[:3, 3] = floor - [0.0, 0.0, 0.002 * radius]
    if cell is not None:
        segments = []
        count = int(spread / cell)
        for offset in cell * np.arange(-count, count + 1):
            half = math.sqrt(spread**2 - offset**2)
            segments += [(offset, -half, 0.0), (offset, half, 0.0), (-half, offset, 0.0), (half, offset, 0.0)]
        lines = meshcat.geometry.PointsGeometry(np.array(segments, dtype=np.float32).T)
        yield set_object("/leg/ground/grid", lines, _GRID, line=True)
        yield set_transform("/leg/ground/grid", on_top)

    # The root frame's axes stand at the left edge of the ground, where they hide nothing.
    corner = on_top[:3, 3] - 0.8 * spread * _screen_axes()[0]
    for axis, name in enumerate("xyz"):
        sides = np.full(3, 0.014 * radius)
        sides[axis] = 0.25 * radius
        middle = np.eye(4)
        middle[:3, 3] = corner + 0.125 * radius * np.eye(3)[axis]
        arrow = meshcat.geometry.Box(sides.tolist())
        yield set_object(f"/leg/root frame/{name}", arrow, (*np.eye(3)[axis] * 0.85, 1.0))
        yield set_transform(f"/leg/root frame/{name}", middle)


def _screen_axes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors to the right, to the top and out of the screen, in the root frame."""
    towards = np.array(_VIEW_DIRECTION) / np.linalg.norm(_VIEW_DIRECTION)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return right, np.cross(towards, right), towards


def _eye(half: np.ndarray) -> np.ndarray:
    """Where the camera stands so that a box with these half sides about the origin fills the view."""
    right, top, towards = _screen_axes()
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half
    across = np.abs(corners @ np.stack([right, top], axis=1)).max(axis=1)
    return towards * np.max(corners @ towards + across / (_FILLED * math.tan(_FIELD_OF_VIEW / 2.0)))


def _node(link: str) -> str:
    """Viewer path of a link; a slash in its name would open another level."""
    return "/leg/links/" + link.replace("/", "\N{DIVISION SLASH}")


def _links(shapes: Mapping[str, Iterable[_Shape]], transforms: Mapping[str, np.ndarray]) -> Iterator[dict[str, Any]]:
    primitives = load_meshcat().geometry
    for link, drawn in shapes.items():
        for index, shape in enumerate(drawn):
            path, pose = f"{_node(link)}/{index}", shape.pose
            geometry: Any
            if shape.kind == "box":
                geometry = primitives.Box(list(shape.size))
            elif shape.kind == "cylinder":
                geometry = primitives.Cylinder(height=shape.size[1], radius=shape.size[0])
                pose = pose @ Y_TO_Z
            else:
                geometry = primitives.Sphere(shape.size[0])
            yield set_object(path, geometry, shape.rgba)
            yield set_transform(path, pose)
        if drawn:
            yield set_transform(_node(link), transforms[link][0])


def _traces(motion: _Motion, radius: float) -> Iterator[dict[str, Any]]:
    if motion.foot_trace is not None:
        yield from _trace(motion.foot_trace, radius, "/leg/foot trace")
    if motion.walking is not None:
        for number, positions in enumerate(np.moveaxis(motion.walking.feet, 1, 0)):
            yield from _trace(positions, radius, f"/leg/foot traces/{number}")


def _trace(positions: np.ndarray, radius: float, name: str) -> Iterator[dict[str, Any]]:
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    path = positions[np.concatenate([[True], steps > 1e-4 * radius])]
    if len(path) > 1:
        tube = load_meshcat().geometry.TriangularMeshGeometry(*_tube(path, 0.006 * radius))
        yield set_object(name, tube, _TRACE)


def _tube(path: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a tube about a path of distinct points; a WebGL line would be one pixel thin."""
    tangents = np.gradient(path, axis=0)
    lengths = np.linalg.norm(tangents, axis=1, keepdims=True)
    # At a reversal the central difference vanishes: the step that leads there gives the direction.
    back = np.diff(path, axis=0, prepend=path[:1] - (path[1:2] - path[:1]))
    tangents = np.where(lengths > 0.0, tangents, back)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    normal = np.eye(3)[np.argmin(np.abs(tangents[0]))]
    angles = np.linspace(0.0, 2.0 * math.pi, _TUBE_SIDES, endpoint=False)
    rings = []
    for point, tangent in zip(path, tangents, strict=True):
        normal = normal - (normal @ tangent) * tangent
        size = np.linalg.norm(normal)
        normal = normal / size if size > 1e-6 else _along(tangent)[:3, 0]
        ring = np.outer(np.cos(angles), normal) + np.outer(np.sin(angles), np.cross(tangent, normal))
        rings.append(point + radius * ring)
    here = np.arange(_TUBE_SIDES)
    there = (here + 1) % _TUBE_SIDES
    band = np.concatenate(
        [
            np.stack([here, there, here + _TUBE_SIDES], axis=1),
            np.stack([there, there + _TUBE_SIDES, here + _TUBE_SIDES], axis=1),
        ]
    )
    faces = np.concatenate([band + _TUBE_SIDES * k for k in range(len(path) - 1)])
    return np.concatenate(rings), faces


def _link_clips(
    shapes: Mapping[str, Iterable[_Shape]], transforms: Mapping[str, np.ndarray], rate: float
) -> dict[str, Any]:
    """Keyframes of the links that move, by viewer path."""
    from scipy.spatial.transform import Rotation

    clips = {}
    for link, transform in transforms.items():
        if not shapes[link] or np.allclose(transform, transform[0], rtol=0.0, atol=1e-12):
            continue
        quaternions = Rotation.from_matrix(transform[:, :3, :3]).as_quat()
        clips[_node(link)] = clip(
            rate,
            position=("vector3", transform[:, :3, 3].tolist()),
            quaternion=("quaternion", quaternions.tolist()),
        )
    return clips


def _colour_clips(
    shapes: Mapping[str, list[_Shape]], motors: tuple[Motor, ...], ranges: Mapping[str, float], rate: float
) -> dict[str, Any]:
    """Keyframes of the motors whose effort changes, by viewer path; a colour belongs to a shape's own material."""
    clips: dict[str, Any] = {}
    for motor in motors:
        colours = diverging(motor.efforts / ranges[motor.unit])
        if np.ptp(colours, axis=0).max() > 0.0:
            keys = clip(rate, material__color=("color", colours.tolist()))
            clips |= {f"{_node(motor.link)}/{index}/<object>": keys for index in range(len(shapes[motor.link]))}
    return clips


def _animation(clips: Mapping[str, Any], loop: bool) -> Iterator[dict[str, Any]]:
    """The animation; nothing where nothing changes."""
    if clips:
        meshcat = load_meshcat()
        animation = meshcat.animation.Animation({viewer_path(path): keys for path, keys in clips.items()})
        yield meshcat.commands.SetAnimation(animation, repetitions=math.inf if loop else 1).lower()
