"""Plain URDF with loops and motors in a YAML file beside it."""

from __future__ import annotations

import os
import re

import pytest

from leg_dynamics.description import read, render, shipped_xacro
from leg_dynamics.description.toolbox import is_toolbox, sidecar_behind, sidecar_of
from leg_dynamics.errors import DescriptionError, LegDynamicsWarning, LegNotFoundError, ParameterError

BODY = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
LIMITS = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'


def joint(name, parent, child, xyz="0 0 0", kind="revolute"):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="0 0 1"/>{LIMITS}</joint>\n'
    )


URDF = (
    '<robot name="five_bar">\n'
    + "\n".join(f'<link name="{name}">{BODY}</link>' for name in ("base", "a", "b", "c", "d", "tip_b", "tip_d"))
    + joint("mot_left", "base", "a")
    + joint("free_left", "a", "b", "1 0 0")
    + joint("mot_right", "base", "c", "1 0 0")
    + joint("free_right", "c", "d", "1 0 0")
    + joint("end_b", "b", "tip_b", "1 0 0", "fixed")
    + joint("end_d", "d", "tip_d", "1 0 0", "fixed")
    + "</robot>\n"
)
SIDECAR = "closed_loop: [[end_b, tip_d]]\ntype: ['3d']\nname_mot: [mot_right, mot_left]\n"


@pytest.fixture
def pair(tmp_path):
    def write(sidecar=SIDECAR, urdf=URDF, name="robot.yaml"):
        (tmp_path / "robot.urdf").write_text(urdf)
        (tmp_path / name).write_text(sidecar)
        return tmp_path / "robot.urdf"

    return write


def test_either_file_gives_the_loops_and_motors(pair):
    urdf = pair()
    described = read(urdf)
    (loop,) = described.loops
    assert (loop.type, loop.predecessor.link, loop.successor.link) == ("spherical", "tip_b", "tip_d")
    assert [each.joint for each in described.transmissions] == ["mot_right", "mot_left"]
    assert read(urdf.with_suffix(".yaml")) == described


def test_limits_of_efforts_each_way_stay(pair):
    described = read(pair(urdf=URDF.replace('effort="1"', 'effort="2" effort_lower="-1"')))
    limits = described.joint("mot_left").limits
    assert (limits.effort_lower, limits.effort) == (-1.0, 2.0)


@pytest.mark.parametrize(("kind", "expected"), [("'3D'", "spherical"), ("6d", "fixed"), ("'6D'", "fixed")])
def test_types_of_loops(pair, kind, expected):
    assert read(pair(SIDECAR.replace("'3d'", kind))).loops[0].type == expected


def test_a_loop_without_a_type_compares_whole_frames(pair):
    assert read(pair("closed_loop: [[end_b, tip_d]]\n")).loops[0].type == "fixed"


def test_motors_by_a_part_of_their_names(pair):
    described = read(pair("closed_loop: [[end_b, end_d]]\nname_mot: mot\n"))
    assert [each.joint for each in described.transmissions] == ["mot_left", "mot_right"]


@pytest.mark.parametrize(("kind", "axes"), [("SPHERICAL", "xyz"), ("UJOINT_xy", "xy"), ("CARDAN", "xy"), ("FIXED", "")])
def test_joints_that_the_urdf_only_stands_in_for(pair, kind, axes):
    described = read(pair(SIDECAR + f"joint_name: [free_left]\njoint_type: [{kind}]\n"))
    names = [f"free_left_{axis}" for axis in axes] or ["free_left"]
    chain = [each for each in described.path("b") if each.name.startswith("free_left")]
    assert [each.name for each in chain] == names
    assert chain[0].origin.xyz == (1.0, 0.0, 0.0)
    assert all(each.origin.xyz == (0.0, 0.0, 0.0) for each in chain[1:])
    vectors = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    assert [each.axis for each in chain if each.type != "fixed"] == [vectors[axis] for axis in axes]
    assert chain[0].parent == "a"
    assert chain[-1].child == "b"


@pytest.mark.parametrize(
    ("sidecar", "message", "line"),
    [
        ("closed_loop: [[end_x, end_d]]\n", "unknown joint or link 'end_x'", 1),
        ("closed_loop: [[end_b]]\n", "must be a list of 2", 1),
        ("closed_loop: [[end_b, end_d]]\ntype: [4d]\n", "must be 3d or 6d", 2),
        ("closed_loop: [[end_b, end_d]]\ntype: [3d, 3d]\n", "type has 2 entries for 1 closed loops", 2),
        ("closed_loop: []\nname_mot: [motor]\n", "unknown joint 'motor'", 2),
        ("closed_loop: []\nname_mot: [end_b]\n", "does not have one coordinate", 2),
        ("closed_loop: []\nname_mot: drive\n", "no moving joint has 'drive' in its name", 2),
        ("closed_loop: []\njoint_name: [free_left]\n", "joint_name has 1 entries and joint_type 0", 2),
        ("closed_loop: []\njoint_name: [free_left]\njoint_type: [BALL]\n", "must be one of SPHERICAL", 3),
        ("closed_loop: []\nname_mot: [free_left]\njoint_name: [free_left]\njoint_type: [FIXED]\n", "one coord", 2),
        ("closed_loop: []\nmotors: [mot_left]\n", "unknown key 'motors'", 2),
        ("closed_loop: []\nhome: {free_lift: 1}\n", "home gives an unknown joint 'free_lift'", 2),
        ("closed_loop: []\nhome: {end_b: 1}\n", "home gives an unknown joint 'end_b'", 2),
        ("closed_loop: []\nhome: {mot_left: fast}\n", "must be a number", 2),
        (
            "closed_loop: []\njoint_name: [free_left]\njoint_type: [CARDAN]\nhome: {free_left: 0}\n",
            "home gives an unknown joint 'free_left'",
            4,
        ),
        ("closed_loop: []\nindependent: [end_b]\n", "names an unknown joint 'end_b'", 2),
        ("closed_loop: []\nindependent: []\n", "independent names no joint", 2),
        ("closed_loop: [[end_b, end_d]\nname_mot: a\n", "malformed YAML", None),
        ("closed_loop: 3\n", "must be a list", 1),
    ],
)
def test_what_is_wrong_is_named_with_its_line(pair, sidecar, message, line):
    with pytest.raises(DescriptionError, match=re.escape(message)) as raised:
        read(pair(sidecar))
    assert str(raised.value.file).endswith("robot.yaml")
    assert line is None or raised.value.line == line


def test_home_and_flags_know_the_joints_of_chains(pair):
    pose = '<configuration name="start"><joint name="mot_left" value="0.1"/></configuration>'
    old = '<configuration name="home"><joint name="mot_left" value="2"/></configuration>'
    described = read(
        pair(
            SIDECAR
            + "joint_name: [free_left]\njoint_type: [UJOINT_xy]\n"
            + "home: {mot_left: 0.5, free_left_x: 0, free_left_y: -2.5}\nindependent: [mot_left, free_left_y]\n",
            URDF.replace("</robot>", f"{pose}{old}</robot>"),
        )
    )
    assert [each.name for each in described.configurations] == ["home", "start"]
    assert dict(described.home.values) == {"mot_left": 0.5, "free_left_x": 0.0, "free_left_y": -2.5}
    assert [each.name for each in described.joints if each.independent] == ["mot_left", "free_left_y"]
    assert all(each.independent_is_stated for each in described.moving_joints)


def test_a_pose_of_a_joint_that_is_replaced_is_refused_where_it_is_replaced(pair):
    pose = '<configuration name="start"><joint name="free_left" value="0.1"/></configuration>'
    sidecar = SIDECAR + "joint_name: [free_left]\njoint_type: [SPHERICAL]\n"
    with pytest.raises(DescriptionError, match=r"'start' .* gives joint 'free_left', .* as home in") as raised:
        read(pair(sidecar, URDF.replace("</robot>", f"{pose}</robot>")))
    assert (raised.value.line, str(raised.value.file).endswith("robot.yaml")) == (4, True)


def test_the_two_keys_of_our_own_do_not_make_a_sidecar(pair):
    with pytest.warns(LegDynamicsWarning, match="not used"):
        assert read(pair("home: {mot_left: 1}\nindependent: [mot_left]\n")).configurations == ()


def test_what_a_description_was_read_with(pair):
    urdf = pair()
    described = read(urdf)
    assert sidecar_behind(described) == urdf.with_suffix(".yaml")
    assert sidecar_behind(read(described.urdf)) is None
    alone = urdf.with_name("a with b.urdf")
    alone.write_text(described.urdf)
    assert sidecar_behind(read(alone)) is None


def test_a_wrong_tree_is_named_in_its_own_file(pair):
    with pytest.raises(DescriptionError, match="two parents") as raised:
        read(pair(urdf=URDF.replace('<child link="tip_d"/>', '<child link="tip_b"/>')))
    assert str(raised.value.file).endswith("robot.urdf")


def test_only_a_file_of_this_kind_is_a_sidecar(pair, tmp_path):
    urdf = pair("gains: [1, 2]\n")
    assert not is_toolbox(urdf.with_suffix(".yaml"))
    with pytest.warns(LegDynamicsWarning, match=r"robot\.yaml:1: the file is not used: it has none of the keys"):
        assert sidecar_of(urdf) is None
    with pytest.warns(LegDynamicsWarning, match="not used"):
        assert read(urdf).loops == ()
    urdf.with_suffix(".yaml").unlink()
    assert sidecar_of(pair(name="robot.yml")) == tmp_path / "robot.yml"


def test_a_sidecar_without_its_urdf(tmp_path):
    (tmp_path / "lonely.yaml").write_text(SIDECAR)
    with pytest.raises(LegNotFoundError, match=r"lonely\.urdf"):
        read(tmp_path / "lonely.yaml")


def test_a_urdf_with_loops_of_its_own(pair):
    loop = '<loop name="l" type="spherical"><predecessor link="tip_b"/><successor link="tip_d"/></loop></robot>'
    urdf = pair(urdf=URDF.replace("</robot>", loop))
    with pytest.warns(LegDynamicsWarning, match=r"robot\.yaml beside the file is not used"):
        assert [each.name for each in read(urdf).loops] == ["l"]
    with pytest.raises(DescriptionError, match="of its own"):
        read(urdf.with_suffix(".yaml"))


def test_there_are_no_parameters_to_set(pair):
    with pytest.raises(ParameterError, match="plain file"):
        read(pair(), parameters={"a": 1.0})


@pytest.mark.parametrize("path", ["robot.urdf", "robot.yaml"])
@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be", "utf-8-sig"])
def test_a_sidecar_with_a_byte_order_mark_is_read(pair, tmp_path, encoding, path):
    pair()
    text = SIDECAR if encoding != "utf-16-be" else f"\ufeff{SIDECAR}"
    (tmp_path / "robot.yaml").write_bytes(text.encode(encoding))
    assert read(tmp_path / path).loops == read(pair()).loops != ()


DAMAGED = {
    "empty": b"",
    "a comment": b"# closed loops\n",
    "cut": SIDECAR[:8].encode(),
    "no UTF-8": b"# \xfc\n" + SIDECAR.encode(),
    "not YAML": b"{{{\n" + SIDECAR.replace("closed_loop", "loops").encode(),
    "a word": b"hello",
    "a list": b"[1, 2, 3]",
    "nested": ("robot:\n" + "".join(f"  {line}\n" for line in SIDECAR.splitlines())).encode(),
    "nested in braces": b"{robot: {name_mot: [a]}}",
    "behind a megabyte": b"#" * 1_100_000 + b"\n" + SIDECAR.encode(),
    "20 MB": b"#" * 20_000_000 + b"\n" + SIDECAR.encode(),
}


@pytest.mark.parametrize("path", ["robot.urdf", "robot.yaml"])
@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_sidecar_is_an_error_not_an_open_tree(pair, tmp_path, damage, path):
    pair()
    (tmp_path / "robot.yaml").write_bytes(DAMAGED[damage])
    with pytest.raises(DescriptionError) as raised:
        read(tmp_path / path)
    assert raised.value.file == str(tmp_path / "robot.yaml")
    assert raised.value.line is not None


@pytest.mark.parametrize("kind", ["folder", "pipe", "device", "link to nothing"])
def test_a_sidecar_that_is_no_file_is_an_error(pair, tmp_path, kind):
    urdf, place = pair(), tmp_path / "robot.yaml"
    place.unlink()
    make = {"folder": place.mkdir, "pipe": lambda: os.mkfifo(place)}
    make.get(kind, lambda: place.symlink_to("/dev/zero" if kind == "device" else "nowhere"))()
    with pytest.raises(DescriptionError, match="cannot be read") as raised:
        read(urdf)
    assert raised.value.file == str(place)


def test_an_assembly_beside_the_file_rendered_from_it_is_no_sidecar(tmp_path):
    source = shipped_xacro("ring")
    (tmp_path / "ring.yaml").write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "ring.urdf").write_text(render("ring"), encoding="utf-8")
    assert len(read(tmp_path / "ring.urdf").loops) == len(read("ring").loops) > 0
    assert len(read(tmp_path / "ring.yaml").loops) > 0


def test_keys_that_other_files_have_too_make_no_sidecar(pair):
    with pytest.warns(LegDynamicsWarning, match="not used"):
        assert read(pair("type: robot\ngains: {home: [1, 2]}\n")).loops == ()
    with pytest.raises(DescriptionError, match="type has 1 entries for 0 closed loops"):
        read(pair("type: ['3d']\n"))
