"""The linter of closed-loop files: each finding where it belongs, and nowhere else."""

from __future__ import annotations

import json
import math
import pickle
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.errors import DescriptionError, LegNotFoundError, MissingFootError, ParameterError
from leg_dynamics.inspection import inspect

from .five_bar import TOGGLE, five_bar

MODELS = Path(__file__).resolve().parents[2] / "shared" / "models"


def codes(report, severity=None):
    return {each.code for each in report.findings if severity in (None, each.severity)}


def finding(report, code):
    return next(each for each in report.findings if each.code == code)


@pytest.mark.parametrize("name", ["omnileg", "hexapod_leg", "quadruped_leg"])
def test_the_shipped_legs_have_neither_errors_nor_warnings(name):
    report = inspect(name, samples=5)
    assert report.passed
    assert codes(report, "error") | codes(report, "warning") == set()
    assert report.actuation.kind == "exact"
    assert report.modes[0].configurations[0] == "home"


def test_counts_and_ranks_of_the_omnileg():
    report = inspect("omnileg", samples=5)
    assert (report.mobility.gruebler, report.mobility.mobility, report.mobility.redundant) == (-6, 3, 9)
    rows = {each.loop: each for each in report.loops}
    assert sum(each.rows for each in report.loops) == 28
    # No row of a loop that shares all its rows can be called the redundant one: the counts of each are taken alone.
    assert rows["loop_B4"].redundant == 0 or rows["loop_B4"].with_
    assert finding(report, "overconstrained").severity == "note"
    assert report.condition.share > 1e-3
    assert json.loads(json.dumps(report.to_dict(), allow_nan=False))["passed"] is True


@pytest.mark.filterwarnings("error")
def test_a_planar_five_bar_has_three_redundant_rows_and_a_simpler_loop():
    report = inspect(five_bar(foot=True))
    (loop,) = report.loops
    assert (loop.rows, loop.needed, loop.redundant, loop.with_, loop.simpler) == (5, 2, 3, (), "spherical")
    note = finding(report, "redundant-loop-rows")
    assert 'type="spherical"> without its <axis>' in note.fix
    # The fix leaves the same mechanism.
    simpler = five_bar(foot=True).replace('name="pin" type="revolute"', 'name="pin" type="spherical"')
    after = inspect(simpler.replace('</successor><axis xyz="0 1 0"/></loop>', "</successor></loop>"))
    assert after.mobility.mobility == report.mobility.mobility == 2
    assert after.loops[0].redundant == 1
    q, v = np.array([1.9, 1.1]), np.array([0.3, 0.2])
    np.testing.assert_allclose(after.leg.torque(q, v, v), report.leg.torque(q, v, v), atol=1e-9)


def test_two_loops_that_say_the_same_are_named_together():
    twice = five_bar()
    start, end = twice.index("<loop"), twice.index("</loop>") + len("</loop>")
    text = twice[:end] + twice[start:end].replace('name="pin"', 'name="again"') + twice[end:]
    report = inspect(text)
    by_name = {each.loop: each for each in report.loops}
    assert by_name["pin"].with_ == ("again",)
    assert by_name["pin"].needed == by_name["again"].needed == 0
    first, second = (each for each in report.findings if each.code == "redundant-loop-rows")
    assert first.fix.startswith('delete <loop name="pin">')
    assert "only one of again, pin" in second.fix
    for name in ("pin", "again"):
        after = inspect(re.sub(f'<loop name="{name}".*?</loop>', "", text))
        assert after.mobility.mobility == report.mobility.mobility == 2
        assert not [each for each in after.findings if "all redundant" in each.text]


def gantries(count):
    """Pairs of parallel slides, each joined by a rigid loop of which one row is needed."""
    body = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>'
    slides = "".join(
        f'<link name="{side}{k}">{body}</link><joint name="j{side}{k}" type="prismatic"><parent link="base"/>'
        f'<child link="{side}{k}"/><origin xyz="{x} {k} 0"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for k in range(count)
        for side, x in (("a", 0), ("b", 1))
    )
    loops = "".join(
        f'<loop name="beam{k}" type="fixed"><predecessor link="a{k}"><origin xyz="1 0 0"/></predecessor>'
        f'<successor link="b{k}"/></loop>'
        for k in range(count)
    )
    return f'<robot name="r"><link name="base"/>{slides}{loops}</robot>'


def test_findings_of_one_kind_are_all_there():
    report = inspect(gantries(9), samples=3)
    found = [each for each in report.to_dict()["findings"] if each["code"] == "redundant-loop-rows"]
    assert [re.search("beam.", each["text"])[0] for each in found] == [f"beam{k}" for k in range(9)]


def test_a_coupling_that_others_imply_can_be_deleted():
    body = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>'
    hinges = "".join(
        f'<link name="l{k}">{body}</link><joint name="j{k}" type="continuous"><parent link="base"/>'
        f'<child link="l{k}"/><axis xyz="0 0 1"/></joint>'
        for k in range(3)
    )
    gears = [
        f'<coupling name="g{a}{b}"><predecessor link="l{a}"/><successor link="l{b}"/><ratio value="{r}"/></coupling>'
        for a, b, r in ((0, 1, 2.0), (1, 2, 3.0), (0, 2, 6.0))
    ]
    report = inspect(f'<robot name="r"><link name="base"/>{hinges}{"".join(gears)}</robot>', samples=3)
    fixes = [each.fix for each in report.findings if each.code == "redundant-loop-rows"]
    assert [fix.partition(":")[0] for fix in fixes] == [f'delete <coupling name="g{n}">' for n in ("01", "12", "02")]
    for k in range(3):
        left = "".join(gears[:k] + gears[k + 1 :])
        after = inspect(f'<robot name="r"><link name="base"/>{hinges}{left}</robot>', samples=3)
        assert after.mobility.mobility == report.mobility.mobility == 1


def test_flags_that_nobody_stated_are_not_called_stated():
    text = five_bar().replace('independent="false"', "", 1)
    note = next(each for each in inspect(text).findings if "do not fit" in each.text)
    assert "stated as independent, ma, mb, with ka, independent for want of a flag, do not fit" in note.text


def test_a_missing_pose_comes_with_one_to_copy():
    report = inspect(five_bar(home=False))
    note = finding(report, "no-home")
    assert note.severity == "warning"
    mended = inspect(five_bar(home=False).replace("</robot>", note.fix + "</robot>"))
    assert "no-home" not in codes(mended)
    assert mended.modes[0].configurations == ("home",)
    for name, value in report.modes[0].coordinates.items():
        assert mended.modes[0].coordinates[name] == pytest.approx(value, abs=1e-9)


def test_wrong_flags_come_with_the_right_ones():
    report = inspect(five_bar().replace('independent="false"', 'independent="true"', 1))
    note = next(each for each in report.findings if "do not fit" in each.text)
    assert (note.severity, note.code) == ("warning", "reading")
    assert note.fix.startswith('state independent="true" for ')
    assert report.mobility.mobility == len(report.leg.joint_names) == 2


def test_actuation_verdicts_name_joints():
    under = inspect(five_bar(("mb",)))
    assert "no actuator holds ma" in finding(under, "under-actuated").text
    assert under.actuation.idle == ("ma",)
    assert "M_ka" in finding(inspect(five_bar(("ma", "mb", "ka"))), "redundantly-actuated").text
    none = inspect(five_bar(()))
    fix = finding(none, "no-transmissions").fix
    assert inspect(five_bar(()).replace("</robot>", fix + "</robot>")).leg.actuator_names == ("motor_ma", "motor_mb")


def serial(joints, motors="", attributes=""):
    """A chain of hinges; in 3d, so that each moves for itself."""
    body = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>'
    return (
        f'<robot name="r" {attributes}><link name="l0"/>'
        + "".join(
            f'<link name="l{k}">{body}</link><joint name="j&amp;{k}" type="revolute"><parent link="l{k - 1}"/>'
            f'<child link="l{k}"/><origin xyz="0.1 0 0"/><axis xyz="{k % 2} 1 0"/>'
            '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
            for k in range(1, joints + 1)
        )
        + motors
        + "</robot>"
    )


def test_all_transmissions_that_are_missing_come_to_paste():
    report = inspect(serial(9))
    fix = finding(report, "no-transmissions").fix
    mended = inspect(serial(9, fix))
    assert mended.actuation.kind == "exact"
    assert mended.leg.actuator_names == tuple(f"motor_j&{k}" for k in range(1, 10))
    nothing = inspect(serial(9, attributes='driven="none"'))
    assert "no-transmissions" not in codes(nothing)
    assert nothing.actuation.idle == nothing.leg.joint_names


def test_what_is_missing_in_mjcf_comes_as_mjcf(tmp_path):
    pytest.importorskip("mujoco")
    joints = "".join(
        f'<body name="b{k}" pos=".1 0 0"><joint name="h{k}"/><geom type="sphere" size=".1"/>' for k in "pq"
    )
    model = f"<mujoco><worldbody>{joints}</body></body></worldbody>{{}}</mujoco>"
    report = inspect(model.format(""))
    fix = finding(report, "no-transmissions").fix
    assert fix.startswith("<actuator><motor ")
    mended = inspect(model.format(fix))
    assert mended.leg.actuator_names == ("motor_hp", "motor_hq")
    assert "no-transmissions" not in codes(mended)
    for each in (*report.findings, *mended.findings):
        assert not re.search("<transmission|<limit|<configuration|<loop|velocity=", each.fix), each
    assert "2 driven joints without effort limits: hp, hq" in finding(mended, "no-effort-limits").text


def test_warnings_of_a_relative_path_come_once(tmp_path, monkeypatch):
    (tmp_path / "mine.urdf").write_text(serial(1).replace('ixx="0.01"', 'ixx="0.1"'), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    found = [each for each in inspect("mine.urdf").findings if each.code == "reading"]
    assert [(each.line, "triangle inequality" in each.text) for each in found] == [(1, True)]


def test_links_and_limits():
    text = five_bar(foot=True).replace('<mass value="1"/>', '<mass value="0"/>', 1)
    assert "a1" in finding(inspect(text), "inertia-without-mass").text
    inertia = (
        '<inertial><origin xyz="0.1 0 0.01"/><mass value="1"/><inertia ixx="0.001" iyy="0.01" izz="0.01"/></inertial>'
    )
    report = inspect(five_bar(foot=True).replace(inertia, "", 1))
    assert "1 moving link has no mass: a1" in finding(report, "massless-links").text
    bad = inspect(five_bar(foot=True).replace('iyy="0.01" izz="0.01"', 'iyy="0.1" izz="0.01"', 1))
    assert any("triangle inequality" in each.text and each.line is not None for each in bad.findings)
    free = inspect(five_bar(foot=True).replace(' effort="20.0" velocity="10"', ""))
    assert "2 driven joints without effort or velocity limits: ma, mb" in finding(free, "no-effort-limits").text
    circular = inspect(five_bar().replace('lower="-4" upper="4" ', "", 1))
    assert "1 joint without position limits: ma" in finding(circular, "no-position-limits").text


def test_a_motion_without_mass():
    inertia = (
        '<inertial><origin xyz="0.1 0 0.01"/><mass value="1"/><inertia ixx="0.001" iyy="0.01" izz="0.01"/></inertial>'
    )
    report = inspect(five_bar().replace(inertia, ""))
    note = finding(report, "motion-without-mass")
    assert "ma" in note.text
    assert "mb" in note.text


def test_loops_that_bind_nothing_and_links_that_look_like_loops():
    welded = five_bar(foot=True).replace('<successor link="b2">', '<successor link="foot">')
    report = inspect(welded)
    assert not report.passed
    error = finding(report, "description")
    assert (error.severity, error.line) == ("error", 1)
    assert "binds nothing; name the two links" in error.text
    with pytest.raises(DescriptionError, match="'pin' joins 'a2' and 'foot', which are one rigid body"):
        ld.load(welded)
    open_chain = (
        '<robot name="r"><link name="base"/><link name="closedloop1_A"/><joint name="j" type="revolute">'
        '<parent link="base"/><child link="closedloop1_A"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
        "</robot>"
    )
    assert "closedloop1_A" in finding(inspect(open_chain), "unbound-loops").text


@pytest.mark.parametrize(("offset", "near"), [(1e-5, True), (0.2, False)])
def test_a_nearly_singular_home(offset, near):
    crank = TOGGLE + offset
    knee = math.pi - crank - math.acos((0.1 + 0.2 * math.cos(crank)) / 0.25)
    values = {"ma": math.pi - crank, "mb": crank, "ka": -knee, "kb": knee}
    home = "".join(f'<joint name="{name}" value="{value!r}"/>' for name, value in values.items())
    text = five_bar(home=False).replace("</robot>", f'<configuration name="home">{home}</configuration></robot>')
    report = inspect(text)
    assert report.condition.pose["mb"] == pytest.approx(crank)
    assert ("nearly-singular-home" in codes(report)) == near
    if near:
        assert "parallel singularity" in finding(report, "nearly-singular-home").text


@pytest.mark.parametrize(
    ("change", "text", "line"),
    [
        (('<parent link="a1"/>', '<parent link="nobody"/>'), "nobody", 1),
        (("</robot>", ""), "truncated", 1),
        (('xyz="-0.1 0 0"', 'xyz="-5 0 0"'), "no regular closed pose", None),
    ],
)
def test_files_that_cannot_be_used_are_errors_not_exceptions(change, text, line):
    report = inspect(five_bar().replace(*change))
    assert not report.passed
    assert any(re.search(text, each.text) for each in report.errors)
    if line is not None:
        assert report.errors[0].line == line
        assert report.leg is None
    json.dumps(report.to_dict(), allow_nan=False)


def test_what_is_not_there_is_an_exception():
    with pytest.raises(LegNotFoundError):
        inspect("no_such_file.urdf")
    with pytest.raises(MissingFootError):
        inspect(five_bar(), foot="nothing")
    with pytest.raises(ParameterError):
        inspect("omnileg", parameters={"nothing": 1.0})


def test_feet_are_proposed():
    report = inspect(five_bar())
    assert "foot='a2'" in finding(report, "no-foot").fix
    assert "no-foot" not in codes(inspect(five_bar(), foot="a2"))
    robot = inspect("hexapod", samples=2)
    assert len(robot.legs) == 6
    assert '.leg("' in finding(robot, "no-foot").fix


@pytest.mark.skipif(not MODELS.is_dir(), reason="the models of others are not there")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "mobility", "motors", "idle"),
    [
        ("5bar_linkage", 3, 2, 1),
        ("5bar_linkage_iso3d", 2, 2, 0),
        ("cassie_like", 7, 5, 2),
        ("robot_delta", 5, 2, 3),
        ("digit_like", 9, 6, 3),
    ],
)
def test_models_of_others(name, mobility, motors, idle):
    report = inspect(MODELS / "toolbox_yaml" / name / "robot.urdf", samples=3)
    assert report.passed
    assert report.mobility.mobility == mobility
    assert (report.actuation.actuators, len(report.actuation.idle)) == (motors, idle)
    if idle:
        assert all(joint in finding(report, "under-actuated").text for joint in report.actuation.idle)


def test_other_warnings_pass_through(monkeypatch):
    import leg_dynamics.inspection as module

    def noisy(*_):
        warnings.warn("something else", UserWarning, stacklevel=1)

    monkeypatch.setattr(module, "_look_at_links", noisy)
    with pytest.warns(UserWarning, match="something else"):
        inspect(five_bar())


def test_findings_can_be_sent_elsewhere():
    report = inspect(five_bar())
    assert pickle.loads(pickle.dumps(report.findings)) == report.findings
    assert isinstance(report.leg, ld.Leg)
