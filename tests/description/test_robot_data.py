"""Robots of example-robot-data: found by name, with the poses of their SRDF files, and without needless refusals."""

from __future__ import annotations

import importlib.metadata
import re
import warnings
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse, read, robot_data
from leg_dynamics.description.robot_data import PREFIX, robot_data_file, robot_data_names, with_group_states
from leg_dynamics.errors import DescriptionError, LegDynamicsWarning, LegNotFoundError, ParameterError

pytestmark = pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
# What is no mechanism, and the sentence that says why.
REFUSED = {
    "alex_psyonic_hands": "'Left_index_q2' mimics an unknown joint 'index_q1'",
    "ur_description/ur3": "the file has no <link>",
}
# Bodies without a joint: read, but there is nothing to compute.
RIGID = ("iris_simple", "quadrotor_base")
HEAVY = 4  # warnings a file


def urdf_files() -> list[Path]:
    """The URDF files of the distribution, straight from its own list."""
    distribution = importlib.metadata.distribution("example-robot-data")
    files = distribution.files or []
    return [Path(str(distribution.locate_file(file))).resolve() for file in files if file.name.endswith(".urdf")]


def test_every_file_has_one_name_that_finds_it() -> None:
    names = robot_data_names()
    found = [robot_data_file(name) for name in names]
    assert sorted(found) == sorted(urdf_files())
    assert len(set(names)) == len(names) > 60
    assert [robot_data_file(name.upper()) for name in names] == found


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("talos", "talos_data/robots/talos_reduced.urdf"),
        ("Talos_Full", "talos_data/robots/talos_full_v2.urdf"),
        ("anymal", "anymal_b_simple_description/robots/anymal.urdf"),
        ("anymal_c", "anymal_c_simple_description/urdf/anymal.urdf"),
        ("hyq", "hyq_description/robots/hyq_no_sensors.urdf"),
        ("ur3", "ur_description/urdf/ur3_robot.urdf"),
        ("ur5", "ur_description/urdf/ur5_robot.urdf"),
        ("solo8", "solo_description/robots/solo.urdf"),
        ("PANDA", "panda_description/urdf/panda.urdf"),
        ("tiago", "tiago_description/robots/tiago.urdf"),
        ("ur_description/UR3", "ur_description/urdf/ur3.urdf"),
        ("example-robot-data:solo12", "solo_description/robots/solo12.urdf"),
    ],
)
def test_short_names_and_full_names(name: str, path: str) -> None:
    assert robot_data_file(name).as_posix().endswith(f"/example-robot-data/robots/{path}")


def test_every_alias_finds_a_file_that_another_name_finds_too() -> None:
    files = set(urdf_files())
    assert {robot_data_file(alias) for alias in robot_data._ALIASES} <= files


def test_an_unknown_name_says_what_is_near_and_how_to_list_all() -> None:
    with pytest.raises(LegNotFoundError, match=r"no robot 'solo13'.*'solo12'.*robot_data_names\(\)") as caught:
        read(f"{PREFIX}solo13")
    assert caught.value.known == robot_data_names()
    with pytest.raises(LegNotFoundError, match="no robot ''"):
        robot_data_file("")
    with pytest.raises(LegNotFoundError, match="no robot 'no/folder'"):
        robot_data_file("no/folder")


@pytest.fixture
def pretended(monkeypatch, tmp_path):
    """Other files than those of the distribution; what was found of it is forgotten before and after."""
    caches = (robot_data._robots, robot_data._by_name, robot_data.robot_data_names)

    def pretend(**files: str) -> dict[str, Path]:
        paths = {}
        for inner, text in files.items():
            path = tmp_path / inner
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
            paths[inner] = path.resolve()
        monkeypatch.setattr(robot_data, "_installed", lambda: paths)
        for cache in caches:
            cache.cache_clear()
        return paths

    yield pretend
    monkeypatch.undo()
    for cache in caches:
        cache.cache_clear()


ARM = """<robot name="arm">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <joint name="one" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="two" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
  <joint name="three" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
    <mimic joint="four" multiplier="2" offset="0.5"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
  <joint name="four" type="revolute"><parent link="c"/><child link="d"/><axis xyz="0 0 1"/>
    <mimic joint="one" multiplier="-1" offset="0.25"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
</robot>
<!-- after </robot -->
"""


def srdf(*states: tuple[str, str]) -> str:
    inner = "".join(f'<group_state name="{name}" group="all">{joints}</group_state>' for name, joints in states)
    return f'<robot name="arm"><group name="all"/>{inner}<disable_collisions link1="a" link2="b"/></robot>'


def test_two_files_of_one_name_need_their_folder(pretended) -> None:
    pretended(**{"left/urdf/arm.urdf": ARM, "right/arm.urdf": ARM, "right/leg.urdf": ARM})
    assert robot_data_names() == ("left/arm", "leg", "right/arm")
    with pytest.raises(LegNotFoundError, match=r"2 robots.*'example-robot-data:left/arm' or .*:right/arm'") as caught:
        robot_data_file("Arm")
    assert caught.value.known == ("left/arm", "right/arm")
    assert robot_data_file("RIGHT/arm").parent.name == "right"


def test_without_the_distribution_the_error_says_how_to_get_it(pretended) -> None:
    pretended()
    assert robot_data_names() == ()
    with pytest.raises(LegNotFoundError, match="pip install example-robot-data"):
        read(f"{PREFIX}solo12")


def test_a_distribution_that_is_not_there_has_no_files(monkeypatch) -> None:
    def missing(name: str) -> None:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", missing)
    assert robot_data._installed.__wrapped__() == {}


def test_group_states_are_configurations(pretended) -> None:
    joints = '<joint name="root" value="0 0 1 0 0 0 1"/><joint name="two" value="-4"/><joint name="one" value="0.5"/>'
    paths = pretended(
        **{
            "arm/urdf/arm.urdf": ARM,
            "arm/srdf/arm.srdf": srdf(
                ("tucked", '<joint name="two" value="1"/>'),
                ("floating", '<joint name="root" value="0 0 1 0 0 0 1"/><joint name="elsewhere" value="1"/>'),
                ("reference", '<joint name="one" value="0.125"/>'),
                ("standing", joints),
            ),
            "arm/srdf/other.srdf": srdf(("wrong", '<joint name="one" value="1"/>')),
        }
    )
    arm = read(paths["arm/urdf/arm.urdf"])
    assert [each.name for each in arm.configurations] == ["standing", "tucked", "reference"]
    assert arm.home is arm.configurations[0]
    # four = 0.25 - one, three = 0.5 + 2 four; a joint that nothing is said of is left out.
    assert dict(arm.home.values) == {"one": 0.5, "two": -4.0, "three": 0.0, "four": -0.25}
    assert dict(arm.configurations[1].values) == {"two": 1.0}
    assert dict(arm.configurations[2].values) == {"one": 0.125, "three": 0.75, "four": 0.125}
    assert read(f"{PREFIX}ARM") == arm
    # Nothing before the end moves to another line.
    assert [joint.line for joint in arm.joints] == [joint.line for joint in parse(ARM).joints]


@pytest.mark.parametrize(
    ("files", "poses"),
    [
        ({"arm/srdf/else.srdf": srdf(("home", '<joint name="one" value="1"/>'))}, ["home"]),
        ({"arm/else.srdf": srdf(("home", '<joint name="one" value="1"/>')), "arm/more.srdf": srdf()}, []),
        ({"leg/srdf/arm.srdf": srdf(("home", '<joint name="one" value="1"/>'))}, []),
        ({}, []),
    ],
    ids=["the only one", "one of two", "another robot's", "none"],
)
def test_which_file_belongs_to_a_robot(pretended, files, poses) -> None:
    paths = pretended(**{"arm/urdf/arm.urdf": ARM}, **files)
    assert [each.name for each in read(paths["arm/urdf/arm.urdf"]).configurations] == poses


def test_a_file_elsewhere_has_no_poses_but_its_own(tmp_path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    (tmp_path / "arm.srdf").write_text(srdf(("home", '<joint name="one" value="1"/>')))
    assert read(path).configurations == ()


def test_a_file_with_poses_of_its_own_keeps_them(pretended) -> None:
    own = '<configuration name="own"><joint name="one" value="0.1"/></configuration></robot>\n<!--'
    text = ARM.replace("</robot>\n<!--", own)
    paths = pretended(**{"arm/arm.urdf": text, "arm/arm.srdf": srdf(("home", '<joint name="one" value="1"/>'))})
    assert with_group_states(paths["arm/arm.urdf"], text) == text
    assert [each.name for each in read(f"{PREFIX}arm").configurations] == ["own"]


@pytest.mark.parametrize("value", ["nan", "one", "inf"])
def test_a_coordinate_that_is_no_number_is_an_error_of_the_srdf_file(pretended, value: str) -> None:
    pretended(**{"arm/arm.urdf": ARM, "arm/arm.srdf": srdf(("home", f'<joint name="one" value="{value}"/>'))})
    with pytest.raises(DescriptionError, match=r"arm\.srdf:1: value of <joint>"):
        read(f"{PREFIX}arm")


def test_a_pose_outside_the_limits_is_still_warned_about(pretended) -> None:
    pretended(**{"arm/arm.urdf": ARM, "arm/arm.srdf": srdf(("home", '<joint name="one" value="1.5"/>'))})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read(f"{PREFIX}arm")
    (warning,) = caught
    assert "'home' has joint 'one' at 1.5 rad, 0.5 rad beyond its upper limit" in str(warning.message)


def test_a_robot_has_no_parameters() -> None:
    with pytest.raises(ParameterError, match="the plain file"):
        read(f"{PREFIX}solo12", parameters={"a": 1.0})


# ------------------------------------------------------------------ the robots themselves


@pytest.mark.parametrize("name", robot_data_names())
def test_every_robot_is_read_or_says_why_not(name: str) -> None:
    path = robot_data_file(name)
    if name in REFUSED:
        for source in (path, PREFIX + name):
            with pytest.raises(DescriptionError, match=re.escape(REFUSED[name])):
                read(source)
        return
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = read(PREFIX + name)
    assert len(caught) < HEAVY, [str(each.message) for each in caught]
    assert all(issubclass(each.category, LegDynamicsWarning) for each in caught)
    assert robot == read(path)
    assert len(robot.links) == len(ElementTree.parse(path).getroot().findall("link"))


@pytest.mark.parametrize(
    ("name", "home"),
    [
        ("solo12", "standing"),
        ("talos", "half_sitting"),
        ("romeo", "half_sitting"),
        ("hyq", "standing"),
        ("panda", "default"),
        ("ur5", None),
    ],
)
def test_the_home_pose_of_a_robot_is_the_srdf_files(name: str, home: str | None) -> None:
    robot = read(PREFIX + name)
    assert (robot.home and robot.home.name) == home


def test_the_poses_are_those_that_pinocchio_reads() -> None:
    import pinocchio as pin

    for name in ("solo12", "hyq", "talos", "icub"):
        path = robot_data_file(name)
        model = pin.buildModelFromUrdf(str(path))
        (folder,) = (each for each in path.parents if each.parent.name == "robots")
        (file,) = folder.glob("srdf/*.srdf")
        pin.loadReferenceConfigurations(model, str(file))
        robot = read(PREFIX + name)
        assert {each.name for each in robot.configurations} == {entry.key() for entry in model.referenceConfigurations}
        for pose in robot.configurations:
            expected = model.referenceConfigurations[pose.name]
            for joint, value in pose.values.items():
                assert value == expected[model.joints[model.getJointId(joint)].idx_q]


@pytest.mark.parametrize("name", RIGID)
@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_a_body_without_joints_has_nothing_to_compute(name: str, route: str) -> None:
    with pytest.raises(DescriptionError, match="every joint is fixed, nothing moves"):
        ld.load(PREFIX + name, route=route)


@pytest.mark.parametrize("name", ["solo12", "z1", "panda", "talos_arm"])
def test_both_routes_agree_with_a_bare_rnea(name: str) -> None:
    """Mimics, a differential wrist, and motors of absent joints change nothing that `pin.rnea` can be asked for."""
    import pinocchio as pin

    leg = ld.load(PREFIX + name, route="pinocchio")
    q, v, a = np.random.default_rng(0).uniform(-0.5, 0.5, (3, len(leg.joint_names)))
    symbolic = ld.load(PREFIX + name, route="symbolic").generalized_force(q, v, a)
    np.testing.assert_allclose(leg.generalized_force(q, v, a), symbolic, rtol=1e-10, atol=1e-10)
    model = pin.buildModelFromUrdf(str(robot_data_file(name)))
    data = model.createData()
    # The tree's joints over the independent ones: a mimicking joint is a joint of its own there.
    G = np.zeros((model.nv, len(q)))
    offset, damping, friction = np.zeros((3, model.nv))
    for joint in leg.description.moving_joints:
        index = model.joints[model.getJointId(joint.name)].idx_v
        source, factor = (joint.mimic.joint, joint.mimic.multiplier) if joint.mimic else (joint.name, 1.0)
        G[index, leg.joint_names.index(source)] = factor
        offset[index] = joint.mimic.offset if joint.mimic else 0.0
        damping[index], friction[index] = joint.damping, joint.friction
    tau = pin.rnea(model, data, G @ q + offset, G @ v, G @ a) + damping * (G @ v) + friction * np.sign(G @ v)
    np.testing.assert_allclose(leg.generalized_force(q, v, a), G.T @ tau, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in robot_data_names() if name not in (*REFUSED, *RIGID)])
def test_every_robot_loads_by_both_routes_and_they_agree(name: str) -> None:
    legs = [ld.load(PREFIX + name, route=route) for route in ("pinocchio", "symbolic")]
    q, v, a = np.random.default_rng(1).uniform(-0.3, 0.3, (3, len(legs[0].joint_names)))
    one, other = (leg.generalized_force(q, v, a) for leg in legs)
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    assert np.abs(one).max() > 0.0
