from __future__ import annotations

import itertools
import subprocess
import sys
import warnings
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import umsgpack

from leg_dynamics import errors
from leg_dynamics.description.model import Description, Geometry, Joint, Link, Loop, LoopEnd, Pose, Visual
from leg_dynamics.preview import scene as scene_module
from leg_dynamics.preview.scene import build_scene, check_motion


def describe(links: list[Link], joints: list[Joint], loops: tuple[Loop, ...] = ()) -> Description:
    return Description("sketch", tuple(links), tuple(joints), loops, (), (), (), "", parameters=MappingProxyType({}))


def drawn(commands: Any) -> dict[str, dict[str, Any]]:
    """Of each drawn node: the one geometry, the one material and the object's kind."""
    found = {}
    for command in commands:
        if command["type"] == "set_object" and "geometries" in command["object"]:
            (geometry,), (material,) = command["object"]["geometries"], command["object"]["materials"]
            kind = command["object"]["object"]["type"]
            found[command["path"]] = {"geometry": geometry, "material": material, "kind": kind}
    return found


def on_links(commands: Any) -> dict[str, dict[str, Any]]:
    return {path: value for path, value in drawn(commands).items() if path.startswith("/leg/links/")}


def vertices(geometry: dict[str, Any]) -> np.ndarray:
    data = geometry["data"]["attributes"]["position"]["array"].data
    return np.frombuffer(data, dtype=np.float32).reshape(-1, 3)


def test_keyframes_are_the_link_poses_of_the_planar_leg(leg: Description, motion: Any, rig: SimpleNamespace) -> None:
    scene = build_scene(leg, *motion.arguments(), fps=40.0)
    assert (scene.start, scene.duration, scene.frames) == (0.0, 2.0, 81)
    clips = rig.clips(scene.commands)
    assert set(clips) == {"/leg/links/thigh", "/leg/links/shank", "/leg/links/foot"}
    hip, knee = motion.joint_values["hip"], motion.joint_values["knee"]
    np.testing.assert_allclose(clips["/leg/links/foot"]["position"], motion.foot, atol=1e-12)
    knee_position = rig.THIGH * np.stack([-np.sin(hip), 0 * hip, -np.cos(hip)], axis=-1)
    np.testing.assert_allclose(clips["/leg/links/shank"]["position"], knee_position, atol=1e-12)
    for link, angle in (("thigh", hip), ("shank", hip + knee)):
        expected = np.stack([0 * angle, np.sin(angle / 2), 0 * angle, np.cos(angle / 2)], axis=-1)
        cosine = np.abs(np.sum(clips[f"/leg/links/{link}"]["quaternion"] * expected, axis=-1))
        np.testing.assert_allclose(cosine, 1.0, atol=1e-12)
    for clip in clips.values():
        assert clip["rate"] == pytest.approx(40.0)
        assert clip["frames"].tolist() == list(range(81))


def test_a_still_link_has_a_pose_and_no_keyframes(leg: Description, motion: Any, rig: SimpleNamespace) -> None:
    scene = build_scene(leg, motion.times, {"knee": motion.joint_values["knee"]})
    assert set(rig.clips(scene.commands)) == {"/leg/links/shank", "/leg/links/foot"}
    np.testing.assert_allclose(rig.matrix(scene.commands, "/leg/links/thigh"), np.eye(4), atol=1e-15)


def test_uneven_samples_are_interpolated_on_even_frames(leg: Description, rig: SimpleNamespace) -> None:
    times, hip = np.array([1.0, 1.2, 3.0]), np.array([0.0, 1.0, 0.1])
    scene = build_scene(leg, times, {"hip": hip}, fps=10.0)
    assert (scene.start, scene.duration, scene.frames) == (1.0, 2.0, 21)
    position = rig.clips(scene.commands)["/leg/links/foot"]["position"]
    at = 1.0 + 0.1 * np.arange(21)
    angle = np.where(at < 1.2, 5.0 * (at - 1.0), 1.0 - 0.5 * (at - 1.2))
    np.testing.assert_allclose(position, rig.foot(angle, 0 * angle), atol=1e-12)


@pytest.mark.parametrize(("loop", "repetitions"), [(True, np.inf), (False, 1)])
def test_the_animation_plays_at_once_and_repeats_when_asked(
    leg: Description, motion: Any, loop: bool, repetitions: float
) -> None:
    scene = build_scene(leg, *motion.arguments(), loop=loop)
    (animation,) = [command for command in scene.commands if command["type"] == "set_animation"]
    assert animation["options"] == {"play": True, "repetitions": repetitions}


@pytest.mark.parametrize("count", [1, 5])
def test_nothing_is_animated_where_nothing_moves(leg: Description, count: int, rig: SimpleNamespace) -> None:
    scene = build_scene(leg, np.arange(count, dtype=float), {"hip": np.full(count, 0.3)})
    assert rig.clips(scene.commands) == {}
    expected = rig.foot(np.array(0.3), np.array(0.0))
    np.testing.assert_allclose(rig.matrix(scene.commands, "/leg/links/foot")[:3, 3], expected, atol=1e-12)


def test_a_long_motion_keeps_its_length_with_fewer_frames(leg: Description) -> None:
    times = np.array([0.0, 1000.0])
    with pytest.warns(errors.LegDynamicsWarning, match=r"30001 frames; the preview keeps 1200, that is 1.2 a second"):
        scene = build_scene(leg, times, {"hip": times / 1000.0})
    assert (scene.frames, scene.duration) == (scene_module.MAXIMUM_FRAMES, 1000.0)


def test_every_visual_keeps_its_colour(leg: Description, motion: Any, rig: SimpleNamespace) -> None:
    shapes = on_links(build_scene(leg, *motion.arguments()).commands)
    for link, (red, green, blue) in rig.COLOURS.items():
        value = shapes[f"/leg/links/{link}/0"]["material"]["color"]
        assert abs((value >> 16) - red) <= 1
        assert abs((value >> 8 & 255) - green) <= 1
        assert abs((value & 255) - blue) <= 1
        assert shapes[f"/leg/links/{link}/0"]["material"]["transparent"] is False


def test_glass_is_transparent_and_unpainted_links_differ() -> None:
    ball = Geometry("sphere", (0.1,))
    links = [
        Link("base", visuals=(Visual(Pose(), ball, (1.0, 1.0, 1.0, 0.25)),)),
        Link("left", visuals=(Visual(Pose(), ball),)),
        Link("right", visuals=(Visual(Pose(), ball),)),
    ]
    joints = [Joint("l", "revolute", "base", "left"), Joint("r", "revolute", "base", "right")]
    shapes = on_links(build_scene(describe(links, joints), [0.0], {}).commands)
    glass = shapes["/leg/links/base/0"]["material"]
    assert (glass["color"], glass["transparent"], glass["opacity"]) == (0xFFFFFF, True, 0.25)
    assert shapes["/leg/links/left/0"]["material"]["color"] != shapes["/leg/links/right/0"]["material"]["color"]


def test_shapes_have_the_size_and_the_axis_of_the_file(rig: SimpleNamespace) -> None:
    origin = Pose((0.1, -0.2, 0.3), (0.4, -0.5, 0.6))
    visuals = (
        Visual(origin, Geometry("cylinder", (0.05, 0.8))),
        Visual(origin, Geometry("box", (0.1, 0.2, 0.3))),
        Visual(origin, Geometry("sphere", (0.07,))),
    )
    commands = build_scene(describe([Link("rod", visuals=visuals)], []), [0.0], {}).commands
    cylinder, box, sphere = (on_links(commands)[f"/leg/links/rod/{k}"]["geometry"] for k in range(3))
    assert (cylinder["radiusTop"], cylinder["radiusBottom"], cylinder["height"]) == (0.05, 0.05, 0.8)
    assert (box["width"], box["height"], box["depth"]) == (0.1, 0.2, 0.3)
    assert sphere["radius"] == 0.07
    # URDF cylinders stand along z, three.js cylinders along y.
    end = rig.matrix(commands, "/leg/links/rod/0") @ [0.0, 0.4, 0.0, 1.0]
    np.testing.assert_allclose(end, origin.matrix() @ [0.0, 0.0, 0.4, 1.0], atol=1e-15)
    for k in (1, 2):
        np.testing.assert_allclose(rig.matrix(commands, f"/leg/links/rod/{k}"), origin.matrix(), atol=1e-15)


def test_the_box_about_the_motion_is_tight(leg: Description, motion: Any, rig: SimpleNamespace) -> None:
    scene = build_scene(leg, *motion.arguments(), fps=40.0)
    lowest = motion.foot[:, 2].min() - rig.FOOT_RADIUS
    farthest = motion.foot[:, 0] + rig.FOOT_RADIUS
    np.testing.assert_allclose(scene.lower, [motion.foot[:, 0].min() - rig.FOOT_RADIUS, -0.08, lowest], atol=1e-12)
    np.testing.assert_allclose(scene.upper, [farthest.max(), 0.08, 0.015], atol=1e-12)


def test_a_foot_trace_widens_the_box(leg: Description) -> None:
    trace = [[0.0, 0.0, -0.4], [0.0, 3.0, -0.4]]
    scene = build_scene(leg, [0.0, 1.0], {}, foot_trace=trace)
    assert scene.upper[1] == pytest.approx(3.0)


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere"])
def test_the_box_about_a_tilted_shape_touches_it(kind: str) -> None:
    size = {"box": (0.1, 0.2, 0.5), "cylinder": (0.1, 0.5), "sphere": (0.1,)}[kind]
    origin = Pose((0.3, -0.1, 0.2), (0.5, -0.9, 0.7))
    scene = build_scene(describe([Link("part", visuals=(Visual(origin, Geometry(kind, size)),))], []), [0.0], {})
    turn, lift = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 721), np.linspace(-np.pi / 2.0, np.pi / 2.0, 361))
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1).reshape(-1, 2)
    surface = {
        "box": np.array(list(itertools.product(*([-s / 2.0, s / 2.0] for s in size)))),
        "cylinder": np.concatenate([np.c_[0.1 * circle, np.full(len(circle), z)] for z in (-0.25, 0.25)]),
        "sphere": 0.1 * np.c_[circle * np.cos(lift).reshape(-1, 1), np.sin(lift).ravel()],
    }[kind]
    points = surface @ origin.rotation().T + origin.xyz
    np.testing.assert_allclose(scene.lower, points.min(axis=0), atol=1e-5)
    np.testing.assert_allclose(scene.upper, points.max(axis=0), atol=1e-5)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 300.0])
def test_the_camera_frames_the_whole_motion_at_any_size(scale: float, rig: SimpleNamespace) -> None:
    visual = Visual(Pose((0.5 * scale, 0.0, 1.0 * scale)), Geometry("box", (0.2 * scale, 0.3 * scale, 2.0 * scale)))
    joint = Joint("turn", "revolute", "base", "arm", axis=(0.0, 1.0, 0.0))
    description = describe([Link("base"), Link("arm", visuals=(visual,))], [joint])
    scene = build_scene(description, [0.0, 1.0], {"turn": [0.0, 1.5]})
    camera = rig.Camera.of(scene.commands)
    corners = np.array(list(itertools.product(*zip(scene.lower, scene.upper, strict=True))))
    seen = np.abs(camera.project(corners)).max()
    assert seen == pytest.approx(0.9, abs=1e-9)
    middle = camera.project((scene.lower + scene.upper) / 2.0)
    np.testing.assert_allclose(middle, 0.0, atol=1e-9)
    up = camera.project((scene.lower + scene.upper) / 2.0 + [0.0, 0.0, 0.1 * scale])
    assert up[1] > 0.0
    assert up[0] == pytest.approx(0.0, abs=1e-9)


def test_the_ground_lies_just_below_the_lowest_point(leg: Description, motion: Any, rig: SimpleNamespace) -> None:
    scene = build_scene(leg, *motion.arguments())
    plate = drawn(scene.commands)["/leg/ground/plate"]["geometry"]
    top = rig.matrix(scene.commands, "/leg/ground/plate") @ [0.0, plate["height"] / 2.0, 0.0, 1.0]
    gap = scene.lower[2] - top[2]
    assert 0.0 < gap < 0.005
    grid = drawn(scene.commands)["/leg/ground/grid"]
    assert grid["kind"] == "LineSegments"
    lines = vertices(grid["geometry"])
    assert np.hypot(lines[:, 0], lines[:, 1]).max() <= plate["radiusTop"] * (1.0 + 1e-6)
    np.testing.assert_allclose(np.diff(np.unique(np.round(lines[::4, 0] / scene.cell, 4))), 1.0)


@pytest.mark.parametrize(
    ("length", "rounded"), [(0.05, 0.05), (0.0499, 0.02), (0.013, 0.01), (1.0, 1.0), (9.99, 5.0), (0.001, 0.001)]
)
def test_grid_cells_are_round(length: float, rounded: float) -> None:
    assert scene_module._round_length(length) == pytest.approx(rounded, rel=1e-12)


def skeleton_leg(visuals: tuple[Visual, ...] = ()) -> Description:
    links = [Link("base"), Link("thigh", visuals=visuals), Link("foot")]
    joints = [
        Joint("hip", "revolute", "base", "thigh", Pose((0.1, 0.0, 0.0)), (0.0, 1.0, 0.0)),
        Joint("knee", "revolute", "thigh", "foot", Pose((0.0, 0.3, -0.4)), (0.0, 1.0, 0.0)),
    ]
    loop = Loop("close", "revolute", LoopEnd("base"), LoopEnd("foot", Pose((0.0, 0.0, -0.2))), (0.0, 1.0, 0.0))
    return describe(links, joints, (loop,))


def bars(commands: Any, rig: SimpleNamespace) -> dict[str, np.ndarray]:
    """Both ends of every bar, in its link's frame."""
    ends = {}
    for path, shape in on_links(commands).items():
        if shape["geometry"]["type"] == "CylinderGeometry":
            half = shape["geometry"]["height"] / 2.0
            ends[path] = (rig.matrix(commands, path) @ np.array([[0, -half, 0, 1], [0, half, 0, 1]]).T).T[:, :3]
    return ends


def test_a_file_without_shapes_shows_its_skeleton(rig: SimpleNamespace) -> None:
    commands = build_scene(skeleton_leg(), [0.0], {}).commands
    shapes = on_links(commands)
    balls = [path for path, shape in shapes.items() if shape["geometry"]["type"] == "SphereGeometry"]
    assert balls == ["/leg/links/base/0", "/leg/links/thigh/0", "/leg/links/foot/0"]
    found = bars(commands, rig)
    expected = {"base": (0.1, 0.0, 0.0), "thigh": (0.0, 0.3, -0.4), "foot": (0.0, 0.0, -0.2)}
    assert set(found) == {f"/leg/links/{link}/1" for link in expected}
    for link, end in expected.items():
        np.testing.assert_allclose(found[f"/leg/links/{link}/1"], [[0.0, 0.0, 0.0], end], atol=1e-12)


def test_a_mesh_shows_its_piece_of_the_skeleton_and_says_so(rig: SimpleNamespace) -> None:
    mesh = Visual(Pose(), Geometry("mesh", (1.0, 1.0, 1.0), "package://robot/thigh.stl"))
    box = Visual(Pose(), Geometry("box", (0.1, 0.1, 0.1)))
    description = skeleton_leg((mesh, box))
    with pytest.warns(errors.LegDynamicsWarning, match=r"sketch: 1 links have mesh files \(thigh\)"):
        commands = build_scene(description, [0.0], {}).commands
    kinds = {path: shape["geometry"]["type"] for path, shape in on_links(commands).items()}
    assert kinds == {
        "/leg/links/thigh/0": "BoxGeometry",
        "/leg/links/thigh/1": "SphereGeometry",
        "/leg/links/thigh/2": "CylinderGeometry",
    }


def test_a_file_of_meshes_only_shows_its_whole_skeleton(rig: SimpleNamespace) -> None:
    mesh = Visual(Pose(), Geometry("mesh", (1.0, 1.0, 1.0), "thigh.stl"))
    with pytest.warns(errors.LegDynamicsWarning, match="mesh files"):
        commands = build_scene(skeleton_leg((mesh,)), [0.0], {}).commands
    assert set(bars(commands, rig)) == {f"/leg/links/{link}/1" for link in ("base", "thigh", "foot")}


def test_a_slide_of_the_skeleton_reaches_back_to_its_parent(rig: SimpleNamespace) -> None:
    joint = Joint("strut", "prismatic", "base", "rod", Pose((0.0, 0.0, 0.1)), (0.0, 0.0, 1.0))
    description = describe([Link("base"), Link("rod")], [joint])
    commands = build_scene(description, [0.0, 1.0, 2.0], {"strut": [-0.2, -0.5, -0.3]}).commands
    np.testing.assert_allclose(bars(commands, rig)["/leg/links/rod/1"], [[0, 0, 0], [0, 0, 0.5]], atol=1e-12)
    resting = bars(build_scene(description, [0.0], {}).commands, rig)
    assert set(resting) == {"/leg/links/base/1"}


def test_a_lone_link_without_shape_is_a_ball() -> None:
    shapes = on_links(build_scene(describe([Link("base")], []), [0.0], {}).commands)
    assert [shape["geometry"]["type"] for shape in shapes.values()] == ["SphereGeometry"]


def test_a_shape_without_extent_is_survived() -> None:
    nothing = Visual(Pose(), Geometry("box", (0.0, 0.0, 0.0)))
    scene = build_scene(describe([Link("base", visuals=(nothing,))], []), [0.0], {})
    assert np.isfinite([value for c in scene.commands if c["type"] == "set_transform" for value in c["matrix"]]).all()


def test_a_slash_in_a_link_name_opens_no_other_node() -> None:
    ball = (Visual(Pose(), Geometry("sphere", (0.1,))),)
    links = [Link("leg/thigh", visuals=ball), Link("leg/foot", visuals=ball)]
    commands = build_scene(describe(links, [Joint("j", "revolute", "leg/thigh", "leg/foot")]), [0.0], {}).commands
    assert [path.count("/") for path in on_links(commands)] == [4, 4]


def test_the_trace_is_a_tube_about_the_path(leg: Description, motion: Any) -> None:
    turn = np.pi * motion.times
    path = np.stack([0.1 * np.cos(turn), 0.05 * np.sin(turn), 0.02 * turn], axis=-1)
    scene = build_scene(leg, *motion.arguments(), foot_trace=path, fps=40.0)
    geometry = drawn(scene.commands)["/leg/foot trace"]["geometry"]
    tube = vertices(geometry).reshape(81, -1, 3)
    np.testing.assert_allclose(tube.mean(axis=1), path, atol=1e-6)
    thickness = np.linalg.norm(tube - path[:, None], axis=2)
    assert np.ptp(thickness) < 1e-6
    assert 0.0005 < thickness.mean() < 0.005
    triangles = np.frombuffer(geometry["data"]["index"]["array"].data, dtype=np.uint32).reshape(-1, 3)
    assert len(triangles) == 80 * 2 * tube.shape[1]
    assert triangles.max() == 81 * tube.shape[1] - 1
    # Seen from outside, the corners of every triangle run anticlockwise, so that it is lit.
    a, b, c = (tube.reshape(-1, 3)[triangles[:, k]] for k in range(3))
    middle = np.repeat((path[1:] + path[:-1]) / 2.0, 2 * tube.shape[1], axis=0)
    outward = np.sum(np.cross(b - a, c - a) * ((a + b + c) / 3.0 - middle), axis=1)
    assert (outward > 0.0).all()


def test_a_resting_foot_leaves_no_trace(leg: Description, motion: Any) -> None:
    scene = build_scene(leg, *motion.arguments(), foot_trace=np.zeros((81, 3)))
    assert "/leg/foot trace" not in drawn(scene.commands)


@pytest.mark.parametrize(
    "path",
    [
        [[0, 0, 0], [0.1, 0, 0], [0, 0, 0], [0.1, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [0.1, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0.1, 0.1, 0.1]],
        [[0, 0, 0], [0.1, 0, 0]],
    ],
)
def test_a_trace_that_turns_back_or_pauses_has_no_hole(leg: Description, path: list[list[float]]) -> None:
    times = np.arange(len(path), dtype=float)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = build_scene(leg, times, {}, foot_trace=path, fps=1.0)
    tube = vertices(drawn(scene.commands)["/leg/foot trace"]["geometry"])
    assert np.isfinite(tube).all()


def test_equal_motions_give_equal_bytes(leg: Description, motion: Any) -> None:
    first, second = (build_scene(leg, *motion.arguments(), foot_trace=motion.foot).packed() for _ in range(2))
    assert first == second
    assert umsgpack.unpackb(first[0])["type"] == "set_property"


def test_each_drawn_thing_has_its_own_identifiers(leg: Description, motion: Any) -> None:
    shapes = drawn(build_scene(leg, *motion.arguments(), foot_trace=motion.foot).commands)
    identifiers = [shape[part]["uuid"] for shape in shapes.values() for part in ("geometry", "material")]
    assert len(set(identifiers)) == 2 * len(shapes)


NOT_A_NUMBER = [0.0, np.nan, 0.0]


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"times": []}, errors.ShapeError, r"times has shape \(0,\)"),
        ({"times": 1.0}, errors.ShapeError, r"times has shape \(\)"),
        ({"times": [[0.0, 1.0, 2.0]]}, errors.ShapeError, r"times has shape \(1, 3\)"),
        ({"times": ["a", "b", "c"]}, errors.ShapeError, "times is not an array of numbers"),
        ({"times": [0.0, np.inf, 2.0]}, errors.NonFiniteError, "times holds NaN or infinity in 1 of 3"),
        ({"times": [0.0, 1.0, 1.0]}, errors.TrajectoryError, "sample 2 at 1 s follows sample 1 at 1 s"),
        ({"times": [0.0, 2.0, 1.0]}, errors.TrajectoryError, "times must increase"),
        ({"joint_values": {"hip": [0.0, 1.0]}}, errors.ShapeError, r"'hip'\] has shape \(2,\), but there are 3"),
        ({"joint_values": {"hip": 0.0}}, errors.ShapeError, r"'hip'\] has shape \(\)"),
        ({"joint_values": {"hip": [None, None, None]}}, errors.NonFiniteError, "hip"),
        ({"joint_values": {"hip": [{}, {}, {}]}}, errors.ShapeError, "not an array of numbers"),
        ({"joint_values": {"hip": NOT_A_NUMBER}}, errors.NonFiniteError, "first in sample 1"),
        ({"joint_values": {"hop": [0.0, 0.0, 0.0]}}, errors.DescriptionError, "there is no joint 'hop'"),
        ({"foot_trace": [[0.0, 0.0, 0.0]]}, errors.ShapeError, r"foot_trace has shape \(1, 3\)"),
        ({"foot_trace": np.zeros((3, 2))}, errors.ShapeError, r"give shape \(3, 3\)"),
        ({"foot_trace": np.diag(NOT_A_NUMBER)}, errors.NonFiniteError, "foot_trace holds NaN"),
        ({"fps": 0.0}, errors.ParameterError, "fps is 0.0"),
        ({"fps": np.nan}, errors.ParameterError, "fps is nan"),
    ],
)
def test_bad_input_gets_a_named_error(
    leg: Description, changes: dict[str, Any], error: type[Exception], message: str
) -> None:
    good: dict[str, Any] = {"times": [0.0, 1.0, 2.0], "joint_values": {"hip": [0.0, 0.1, 0.2]}}
    build_scene(leg, **good)
    with pytest.raises(error, match=message):
        build_scene(leg, **{**good, **changes})


def test_the_failing_samples_are_named(leg: Description) -> None:
    with pytest.raises(errors.NonFiniteError) as caught:
        check_motion(leg, np.arange(4.0), {"knee": [0.0, np.nan, 0.0, -np.inf]})
    assert caught.value.rows.tolist() == [1, 3]


def test_importing_the_room_is_light() -> None:
    heavy = {"meshcat", "scipy", "tornado", "umsgpack", "zmq"}
    code = f"import sys, leg_dynamics.preview; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
