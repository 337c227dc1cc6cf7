from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import link_transforms, mjcf_reader, read
from leg_dynamics.description.lowering import single_coordinate
from leg_dynamics.description.mjcf_reader import is_mjcf, mjcf_text
from leg_dynamics.description.xml_reader import Document
from leg_dynamics.errors import DescriptionError, LegDynamicsWarning, UnsafeXmlError, UnsupportedError

GEOM = '<geom type="box" size=".1 .05 .02" pos=".1 0 .03"/>'


def model(bodies, rest="", *, option=""):
    return f'<mujoco model="m"><compiler angle="radian"/>{option}<worldbody>{bodies}</worldbody>{rest}</mujoco>'


def body(name, inside="", *, joint=None, attributes='pos=".3 .1 -.2" euler=".4 -.2 .9"'):
    """A body with a hinge of the name JOINT, by default the body's own with a j before it."""
    named = f'name="{joint or f"j{name}"}"'
    return f'<body name="{name}" {attributes}><joint {named} axis=".6 0 .8"/>{GEOM}{inside}</body>'


PAIR = body("a", body("b", body("c")))


# ---------------------------------------------------------------------- what is MJCF


@pytest.mark.parametrize(
    "text",
    [
        "<mujoco/>",
        "\ufeff  <mujoco>",
        '<?xml version="1.0"?>\n<!-- <robot> --><!----> <mujoco\nmodel="x">',
        "<mujoco model='x'></mujoco>",
    ],
)
def test_the_root_element_tells(text):
    assert is_mjcf(text)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "<robot/>",
        "<mujocoinclude/>",
        "<!-- <mujoco>",
        "<!-- x --><robot><mujoco/></robot>",
        "<?xml <mujoco>",
        "mujoco",
    ],
)
def test_other_roots_are_none(text):
    assert not is_mjcf(text)


def test_a_hundred_thousand_comments_are_no_work():
    assert not is_mjcf("<!---->" * 100_000 + "<robot/>")


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setattr(mjcf_reader, "has_mujoco", lambda: False)
    with pytest.raises(UnsupportedError, match=r"pip install 'leg-dynamics\[mujoco\]'"):
        read(model(PAIR))


mujoco = pytest.importorskip("mujoco", reason="the optional extra mujoco is not installed")


class Oracle:
    def __init__(self, text):
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)

    def at(self, qpos):
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)

    def body(self, name):
        placed = np.eye(4)
        placed[:3, :3], placed[:3, 3] = self.data.body(name).xmat.reshape(3, 3), self.data.body(name).xpos
        return placed


# ---------------------------------------------------------------------- files and their faults


@pytest.mark.parametrize("suffix", [".xml", ".mjcf", ".urdf"])
def test_a_file_is_read_by_what_it_holds(tmp_path, suffix):
    path = tmp_path / f"leg{suffix}"
    path.write_text(model(PAIR), encoding="utf-8")
    description = read(path)
    assert description.name == "m"
    assert description.file == str(path)
    assert description.urdf.startswith("<robot")
    assert pickle.loads(pickle.dumps(description)) == description
    assert read(model(PAIR)).urdf == description.urdf


def test_an_xml_file_may_be_urdf_all_the_same(tmp_path):
    path = tmp_path / "leg.xml"
    path.write_text('<robot name="r"><link name="base"/></robot>', encoding="utf-8")
    assert read(path).name == "r"


def test_includes_are_found_beside_the_file(tmp_path):
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>{PAIR}</mujocoinclude>", encoding="utf-8")
    path = tmp_path / "leg.xml"
    path.write_text(model('<include file="part.xml"/>'), encoding="utf-8")
    assert [joint.name for joint in read(path).moving_joints] == ["ja", "jb", "jc"]


def test_mujocos_own_error_has_the_file_and_the_line(tmp_path):
    path = tmp_path / "leg.xml"
    path.write_text("<mujoco><worldbody>\n<body><joint typ='x'/></body></worldbody></mujoco>", encoding="utf-8")
    with pytest.raises(DescriptionError, match="unrecognized attribute: 'typ'") as caught:
        read(path)
    assert (caught.value.file, caught.value.line) == (str(path), 2)


def test_the_line_of_an_included_file_is_not_taken_for_the_files_own(tmp_path):
    (tmp_path / "part.xml").write_text("<mujocoinclude>\n\n<body typ='x'/></mujocoinclude>", encoding="utf-8")
    path = tmp_path / "leg.xml"
    path.write_text(model('<include file="part.xml"/>'), encoding="utf-8")
    with pytest.raises(DescriptionError, match="typ") as caught:
        read(path)
    assert caught.value.line is None


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("<mujoco><worldbody>" + "<body>" * 70 + "</body>" * 70 + "</worldbody></mujoco>", UnsafeXmlError),
        ('<mujoco><!DOCTYPE mujoco [<!ENTITY a "b">]></mujoco>', DescriptionError),
        ('<!DOCTYPE mujoco [<!ENTITY a "b">]><mujoco>&a;</mujoco>', UnsafeXmlError),
        ("<mujoco><worldbody>", DescriptionError),
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", DescriptionError),
        (model('<include file="nowhere.xml"/>'), DescriptionError),
        (model(PAIR, '<equality><weld body1="a" body2="nobody"/></equality>'), DescriptionError),
    ],
    ids=["deep", "inner doctype", "doctype", "truncated", "massless", "include", "unknown body"],
)
def test_faulty_and_unsafe_files_are_refused(text, kind):
    with pytest.raises(kind):
        read(text)


def test_mujoco_does_not_see_an_unsafe_text(monkeypatch):
    monkeypatch.setattr(mjcf_reader, "_compiled", lambda *args: pytest.fail("compiled"))
    with pytest.raises(UnsafeXmlError):
        mjcf_text("<!DOCTYPE mujoco><mujoco/>", Document())


def test_lines_are_the_files_own_or_none():
    bodies = '\n<body name="b"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1e308 1e308 1e308"/></body>'
    with pytest.raises(DescriptionError, match=r"<string>:2: diaginertia of <inertial> is 1e\+308, too large"):
        read(model(bodies))
    far = '<keyframe><key name="k" qpos="1e10 0"/></keyframe>'
    with pytest.raises(DescriptionError, match=r"too large to compute with.*of the model as URDF") as caught:
        read(model(PAIR, far))
    assert caught.value.line is None
    for lost in ('\n<include file="no.xml"/>', '<asset>\n<mesh name="m" file="file:///no.stl"/></asset>'):
        with pytest.raises(DescriptionError, match="MuJoCo refuses the model") as caught:
            read(model(PAIR, lost))
        assert caught.value.line == 2
    assert all(each.line is None for each in (*read(model(PAIR)).links, *read(model(PAIR)).joints))
    gear = '<equality>\n<joint name="g" joint1="ja" joint2="jb" polycoef="0 1 2 0 0"/></equality>'
    with pytest.raises(UnsupportedError, match=r"<string>:2: .*not linear"):
        read(model(PAIR, gear))


SOLID = '<geom size=".1"/>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f'<worldbody>\n<replicate count="1000000000" offset="1 0 0">{SOLID}</replicate></worldbody>', "1e.09 copies"),
        (
            '<worldbody><replicate count="200">\n<replicate count="200"><body/></replicate></replicate></worldbody>',
            "40000 copies",
        ),
        ('<worldbody><replicate count="2001">\n<body/></replicate></worldbody>', "more than 2000 bodies"),
        ('<asset>\n<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>', "1e.10 cells.*nrow"),
        ('<asset>\n<texture type="2d" builtin="flat" width="100000" height="100000"/></asset>', "1e.10 cells.*width"),
        ('\n<size memory="1000G"/>', "memory.*bytes"),
        *((f'\n<size {name}="1000000000"/>', f"{name} of <size> is 1e.09") for name in ("njmax", "nconmax", "nkey")),
        ('\n<include file="/etc/passwd"/>', "'/etc/passwd' of <include> is outside"),
        ('\n<include file="../../../../etc/passwd"/>', "is outside"),
        ('<asset>\n<mesh name="m" file="../../other/m.stl"/></asset>', "is outside.*put the file"),
        ('\n<compiler meshdir="/etc"/>', "meshdir '/etc'"),
    ],
)
def test_what_mujoco_could_not_bear_does_not_reach_it(text, message, tmp_path, monkeypatch):
    monkeypatch.setattr(mjcf_reader, "_compiled", None)
    path = tmp_path / "leg.xml"
    path.write_text(f"<mujoco>{text}</mujoco>", encoding="utf-8")
    with pytest.raises(DescriptionError, match=message) as caught:
        read(path)
    assert caught.value.line == 2


def test_included_files_are_checked_too_and_named(tmp_path):
    part = tmp_path / "part.xml"
    part.write_text('<mujocoinclude>\n\n<replicate count="99999"><geom/></replicate></mujocoinclude>', encoding="utf-8")
    path = tmp_path / "leg.xml"
    path.write_text(model('<include file="part.xml"/>'), encoding="utf-8")
    with pytest.raises(DescriptionError, match="99999 copies") as caught:
        read(path)
    assert (caught.value.file, caught.value.line) == (str(part), 3)


def test_files_may_lie_in_a_folder_beside_the_models(tmp_path):
    for name in ("parts", "mjcf"):
        (tmp_path / name).mkdir()
    (tmp_path / "parts" / "part.xml").write_text(f"<mujocoinclude>{PAIR}</mujocoinclude>", encoding="utf-8")
    path = tmp_path / "mjcf" / "leg.xml"
    path.write_text(model('<include file="../parts/part.xml"/>'), encoding="utf-8")
    assert len(read(path).moving_joints) == 3


def hinge(joint="", inertial=GEOM, attributes=""):
    return f'<body name="a" {attributes}><joint name="h" {joint}/>{inertial}</body>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (model(hinge(attributes='pos="NaN 0 0"')), "pos of <body> 'a' must be finite"),
        (model(hinge('ref="nan"')), "ref of <joint> 'h' must be finite"),
        (model(hinge(), option='<option gravity="nan 0 0"/>'), "gravity of <option> must be finite"),
        (model(hinge('ref="inf"')), "joint 'h' in the file's pose .ref. is not finite"),
        (model(hinge('damping="inf"')), "damping of joint 'h' is not finite"),
        (model(hinge(inertial='<inertial mass="inf" pos="0 0 0" diaginertia="1 1 1"/>')), "mass of body 'a'"),
        (model(hinge(), '<actuator><motor name="m" joint="h" gear="inf"/></actuator>'), "gear of actuator 'm'"),
        (model(hinge(), '<keyframe><key name="k" qpos="inf"/></keyframe>'), "qpos of keyframe 'k'"),
        (model(hinge('damping="-1"')), "negative damping -1 of <joint>"),
        (model(hinge(attributes='pos="1e308 0 0"')), "1e.308"),
    ],
)
def test_impossible_numbers_are_refused_by_name(text, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DescriptionError, match=message):
        read(text)
    assert not list(tmp_path.iterdir())


def test_an_effort_too_large_for_a_float_is_no_crash():
    rest = '<actuator><motor joint="h" gear="1e200" ctrlrange="-1e200 1e200"/></actuator>'
    assert read(model(hinge(), rest)).joint("h").limits.effort == np.inf


def test_a_name_of_blanks_is_none():
    assert read(model(hinge().replace('"h"', '"  "'))).joint("a_joint").type == "continuous"


def test_ranges_have_two_ends_or_none():
    assert read(model(hinge('range="-inf inf" limited="true"'))).joint("h").type == "continuous"
    with pytest.raises(UnsupportedError, match="range of joint 'h' has one end only"):
        read(model(hinge('range="-inf 1" limited="true"')))


def test_parameters_have_no_meaning():
    with pytest.raises(Exception, match="XML text has none"):
        read(model(PAIR), parameters={"a": 1.0})


# ---------------------------------------------------------------------- the tree


def test_bodies_and_sites_stand_where_mujoco_puts_them():
    inner = (
        '<body pos=".1 0 0" euler=".3 0 0"><joint name="p" type="slide" pos="1 1 1" axis="1 1 0" ref=".2"/>'
        '<joint name="q" pos=".1 .2 .3" axis="0 1 0" ref="-.4"/><joint name="b" type="ball" pos="0 .1 0"/>'
        f"{GEOM}<body name='deep' pos='.2 0 0' euler='0 0 .5'>{GEOM}<site name='tip' pos='.1 .2 .3' euler='1 0 .3'/>"
        "</body></body>"
    )
    text = model(f"<body name='stand' pos='0 0 1' euler='0 .3 0'>{GEOM}{body('a', inner)}</body>")
    oracle, description = Oracle(text), read(text)
    assert [joint.name for joint in description.moving_joints] == ["ja", "p", "q", "b_x", "b_y", "b_z"]
    generator = np.random.default_rng(2)
    for _ in range(5):
        plain, angles = generator.uniform(-1.5, 1.5, (2, 3))
        values = dict(zip(("ja", "p", "q", "b_x", "b_y", "b_z"), (*plain, *angles), strict=True))
        turn = np.eye(3)
        for axis, angle in enumerate(angles):
            quaternion, matrix = np.empty(4), np.empty(9)
            mujoco.mju_axisAngle2Quat(quaternion, np.eye(3)[axis], angle)
            mujoco.mju_quat2Mat(matrix, quaternion)
            turn = turn @ matrix.reshape(3, 3)
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, turn.ravel())
        oracle.at([*plain, *quaternion])
        placed = link_transforms(description, values)
        for name in ("stand", "a", "deep"):
            np.testing.assert_allclose(placed[name], oracle.body(name), atol=1e-13)
        np.testing.assert_allclose(placed["tip"][:3, 3], oracle.data.site("tip").xpos, atol=1e-13)
        np.testing.assert_allclose(placed["tip"][:3, :3].ravel(), oracle.data.site("tip").xmat, atol=1e-13)


@pytest.mark.parametrize(
    "euler", ["0 0 0", "0 1.5707963267948966 0", ".7 -1.5707963267948966 .2", "3 2 1", "0 0 3.14159265"]
)
def test_no_orientation_is_special(euler):
    text = model(body("a", attributes=f'euler="{euler}"'))
    oracle = Oracle(text)
    oracle.at([0.3])
    np.testing.assert_allclose(link_transforms(read(text), {"ja": 0.3})["a"], oracle.body("a"), atol=1e-14)


def test_mass_and_inertia_are_the_compiled_ones():
    text = model(
        '<body name="a"><joint/><inertial mass="2" pos=".1 .2 .3" fullinertia=".02 .03 .025 .001 -.002 .003"/></body>'
    )
    inertial = read(text).link("a").inertial
    turn = inertial.origin.rotation()
    assert inertial.mass == 2.0
    assert inertial.origin.xyz == (0.1, 0.2, 0.3)
    expected = [[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.025]]
    np.testing.assert_allclose(turn @ inertial.tensor() @ turn.T, expected, atol=1e-15)


def test_massless_bodies_have_no_inertial():
    text = model(f'<body name="a"><joint/><body name="empty"/>{GEOM}</body><body name="mark"/>')
    description = read(text)
    assert description.link("empty").inertial is None
    assert description.link("mark").inertial is None
    assert description.link("world").inertial is None
    assert description.joint("mark_fixed").type == "fixed"


def test_unnamed_things_get_the_same_names_each_time():
    inner = f"<body><joint/><joint type='slide'/>{GEOM}<body><joint type='ball'/>{GEOM}<site/></body></body>"
    text = model(f"{inner}<body name='body_1'><joint name='body_1_joint'/>{GEOM}</body>")
    description = read(text)
    assert description.urdf == read(text).urdf
    names = [joint.name for joint in description.moving_joints]
    assert names == [
        "body_1__joint_1",
        "body_1__joint_2",
        "body_2_joint_x",
        "body_2_joint_y",
        "body_2_joint_z",
        "body_1_joint",
    ]
    assert {"body_1_", "body_2", "body_1", "world"} <= {link.name for link in description.links}


def test_names_of_chains_give_way_to_names_of_the_file():
    text = model(
        body("hip_x_link", joint="hip_x")
        + f"<body name='a'><joint name='hip' type='ball'/>{GEOM}<site name='a'/><site name='a_site'/></body>"
    )
    description = read(text)
    assert [joint.name for joint in description.moving_joints] == ["hip_x", "hip__x", "hip__y", "hip__z"]
    assert description.has_link("a")
    assert description.has_link("a_site_")


def test_limits_losses_and_armature_come_along():
    text = model(
        f'<body name="a"><joint name="h" range="-1 2" damping=".3" frictionloss=".2" armature=".05"/>{GEOM}'
        f'<body name="b"><joint name="s" type="slide" range="-.1 .2" armature="3"/>{GEOM}'
        f'<body name="c"><joint name="u"/>{GEOM}</body></body></body>'
    )
    description = read(text)
    h, s, u = (description.joint(name) for name in "hsu")
    assert (h.type, s.type, u.type) == ("revolute", "prismatic", "continuous")
    assert (h.limits.lower, h.limits.upper, s.limits.lower, s.limits.upper) == (-1.0, 2.0, -0.1, 0.2)
    assert (h.damping, h.friction, h.armature, s.armature) == (0.3, 0.2, 0.05, 3.0)
    assert (u.damping, u.friction, u.armature) == (0.0, 0.0, 0.0)
    assert description.transmissions == ()


@pytest.mark.parametrize(
    ("flag", "joint", "field"),
    [
        ("limit", 'range="-1 2"', "limits"),
        ("frictionloss", 'frictionloss="2"', "friction"),
        ("damper", 'damping="2"', "damping"),
    ],
)
def test_what_the_file_switches_off_is_not_there(flag, joint, field):
    text = model(
        f'<body name="a"><joint name="h" {joint}/>{GEOM}</body>', option=f'<option><flag {flag}="disable"/></option>'
    )
    text_on = text.replace("disable", "enable")
    plain = read(model(f'<body name="a"><joint name="h"/>{GEOM}</body>')).joint("h")
    assert getattr(read(text).joint("h"), field) == getattr(plain, field)
    assert getattr(read(text_on).joint("h"), field) != getattr(plain, field)


def test_a_free_joint_is_a_floating_one_in_the_world():
    text = model(f'<body name="trunk" pos=".1 .2 .3" euler=".4 .5 .6"><freejoint name="root"/>{GEOM}</body>')
    description = read(text)
    joint = description.joint("root")
    assert (joint.type, joint.parent, joint.child) == ("floating", "world", "trunk")
    assert joint.origin.xyz == (0.0, 0.0, 0.0)
    oracle = Oracle(text)
    oracle.at(oracle.model.qpos0)
    lowered = single_coordinate(description)
    np.testing.assert_allclose(link_transforms(lowered, lowered.home.values)["trunk"], oracle.body("trunk"), atol=1e-15)


def test_mocap_bodies_are_fixed_with_a_warning():
    text = model(f'<body name="target" mocap="true" pos=".1 .2 .3">{GEOM}</body>{PAIR}')
    with pytest.warns(LegDynamicsWarning, match="body 'target' is moved by motion capture"):
        description = read(text)
    assert description.joint("target_fixed").origin.xyz == (0.1, 0.2, 0.3)


# ---------------------------------------------------------------------- actuators


@pytest.mark.parametrize(
    ("actuators", "effort"),
    [
        ('<motor joint="ja" gear="5" forcerange="-2 2"/>', 10.0),
        ('<motor joint="ja" gear="-5" forcerange="-2 2"/>', 10.0),
        ('<motor joint="ja" gear="5" ctrlrange="-3 3"/>', 15.0),
        ('<motor joint="ja" gear="5" ctrlrange="-3 3" forcerange="-2 2"/>', 10.0),
        ('<motor joint="ja" gear="5"/>', np.inf),
        ('<position joint="ja" gear="5" ctrlrange="-3 3"/>', np.inf),
        ('<position joint="ja" gear="5" ctrlrange="-3 3" forcerange="-2 2"/>', 10.0),
        ('<velocity joint="ja" forcerange="-2 2"/>', 2.0),
        ('<general joint="ja" gainprm="4" ctrlrange="-3 3"/>', 12.0),
        ('<general joint="ja" gainprm="-4" gear="2" ctrlrange="-3 3"/>', 24.0),
        ('<general joint="ja" dyntype="integrator" gainprm="4" ctrlrange="-3 3"/>', np.inf),
        ('<motor jointinparent="ja" gear="5" forcerange="-2 2"/>', 10.0),
    ],
)
def test_efforts_are_bounded_at_the_joint(actuators, effort):
    description = read(model(PAIR, f"<actuator>{actuators}</actuator>"))
    assert description.joint("ja").limits.effort == effort
    (transmission,) = description.transmissions
    assert (transmission.joint, transmission.actuator) == ("ja", "actuator_0")
    assert (transmission.reduction, transmission.rotor_inertia) == (1.0, 0.0)


@pytest.mark.parametrize(("most", "effort"), [("-7 7", 7.0), ("-20 20", 10.0)])
def test_a_joints_own_range_of_efforts_bounds_too(most, effort):
    bodies = f'<body name="a"><joint name="ja" actuatorfrcrange="{most}"/>{GEOM}</body>'
    actuators = '<actuator><motor name="m" joint="ja" gear="5" forcerange="-2 2"/></actuator>'
    assert read(model(bodies, actuators)).joint("ja").limits.effort == effort
    alone = read(model(bodies))
    assert alone.joint("ja").limits.effort == float(most.split()[1])
    assert alone.transmissions == ()


def test_an_unlimited_slide_keeps_its_effort_without_a_warning():
    bodies = f'<body name="a"><joint name="ja" type="slide" actuatorfrcrange="-7 7"/>{GEOM}</body>'
    limits = read(model(bodies)).joint("ja").limits
    assert (limits.lower, limits.upper, limits.effort) == (-np.inf, np.inf, 7.0)


UNEVEN = [
    ("", '<motor name="m" joint="ja" forcerange="-1 4"/>', -1.0, 4.0),
    ("", '<motor name="m" joint="ja" forcerange="-1 4" gear="-2"/>', -8.0, 2.0),
    ("", '<motor name="m" joint="ja" ctrlrange="-1 4" gear="3"/>', -3.0, 12.0),
    ("", '<motor name="m" joint="ja" forcerange="0 3"/>', 0.0, 3.0),
    ("", '<motor name="m" joint="ja" forcerange="0 3" gear="-1"/>', -3.0, 0.0),
    ('actuatorfrcrange="-4 5"', '<motor name="m" joint="ja"/>', -4.0, 5.0),
    ('actuatorfrcrange="-7 7"', '<motor name="m" joint="ja" forcerange="-9 2"/>', -7.0, 2.0),
    ('actuatorfrcrange="0 7"', '<motor name="m" joint="ja" forcerange="-9 2"/>', 0.0, 2.0),
    ("", '<motor joint="ja" forcerange="0 3"/><motor joint="ja" gear="-2" forcerange="-1 4"/>', -8.0, 5.0),
    ("", '<motor name="m" joint="ja" forcerange="1 3"/><motor name="n" joint="ja" forcerange="-2 2"/>', -1.0, 5.0),
    # Rounding alone moves the lower end above 0.
    ("", "".join(f'<motor joint="ja" forcerange="{lower} 1"/>' for lower in (0.1, 0.2, -0.3)), 0.0, 3.0),
]  # fmt: skip


def driven(joint, actuators):
    bodies = f'<body name="a"><joint name="ja" {joint}/>{GEOM}</body>'
    return model(bodies, f"<actuator>{actuators}</actuator>")


@pytest.mark.parametrize(("joint", "actuators", "lower", "upper"), UNEVEN)
def test_both_ends_of_uneven_efforts_are_those_of_mujocos_clamp(joint, actuators, lower, upper):
    mujoco = pytest.importorskip("mujoco")
    text = driven(joint, actuators)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*drive the same joint")
        limits = read(text).joint("ja").limits
    assert (limits.effort_lower, limits.effort) == (lower, upper)
    simulated = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(simulated)
    signs = np.sign(simulated.actuator_gear[:, 0])
    for side, end in ((-1.0, lower), (1.0, upper)):
        data.ctrl[:] = 1e6 * side * signs
        mujoco.mj_forward(simulated, data)
        assert data.qfrc_actuator[0] == pytest.approx(end, abs=1e-12)


@pytest.mark.parametrize(("joint", "actuators", "lower", "upper"), UNEVEN)
@pytest.mark.filterwarnings("ignore:.*drive the same joint")
def test_what_the_file_allows_is_feasible_and_nothing_else(joint, actuators, lower, upper):
    leg = ld.load(driven(joint, actuators))
    still = [0.0]
    for end, beyond in ((lower, lower - 1e-6), (upper, upper + 1e-6)):
        assert leg.feasible(still, still, still, torque=[end])
        assert leg.feasible(still, still, still, torque=[0.99 * end])
        assert not leg.feasible(still, still, still, torque=[beyond])


@pytest.mark.parametrize(
    ("joint", "actuators", "shown"),
    [
        ("", '<motor name="m" joint="ja" forcerange="1 3"/>', "1 to 3"),
        ("", '<motor name="m" joint="ja" forcerange="1 3" gear="-1"/>', "-3 to -1"),
        # MuJoCo clamps 6 ... 8 to 5.
        ('actuatorfrcrange="-4 5"', '<motor name="m" joint="ja" forcerange="6 8"/>', "5 to 5"),
    ],
)
def test_a_range_of_efforts_without_zero_is_a_limit_of_zero(joint, actuators, shown):
    text = driven(joint, actuators)
    with pytest.warns(LegDynamicsWarning, match=f"no effort of 0 is possible .{shown} at joint 'ja'"):
        leg = ld.load(text)
    limits = leg.description.joint("ja").limits
    assert (limits.effort_lower, limits.effort) == (0.0, 0.0)
    still = [0.0]
    for torque in (-2.0, 2.0):
        assert not leg.feasible(still, still, still, torque=[torque])


def test_an_end_that_is_too_large_for_a_float_is_no_limit():
    for gear, lower, upper in ((10, -10.0, np.inf), (-10, -np.finfo(float).max, 10.0)):
        limits = read(driven("", f'<motor joint="ja" gear="{gear}" forcerange="-1 1e308"/>')).joint("ja").limits
        assert (limits.effort_lower, limits.effort) == (lower, upper)


@pytest.mark.parametrize(
    ("actuators", "effort", "name"),
    [
        ('<motor name="m" joint="ja" forcerange="-3 3"/><motor name="n" joint="ja" gear="2" forcerange="-5 5"/>',
         13.0, "m+n"),
        ('<position name="p" joint="ja" forcerange="-3 3"/><velocity name="v" joint="ja" forcerange="-1 1"/>',
         4.0, "p+v"),
        ('<motor joint="ja" forcerange="-2 2"/><velocity joint="ja"/>', np.inf, "actuator_0+actuator_1"),
        # An antagonistic pair of muscles.
        ('<motor name="m" joint="ja" forcerange="0 3"/><motor name="n" joint="ja" gear="-1" forcerange="0 3"/>',
         3.0, "m+n"),
    ],
)  # fmt: skip
def test_several_actuators_of_one_joint_are_one_with_a_warning(actuators, effort, name):
    parts = ", ".join(map(repr, name.split("+")))
    with pytest.warns(LegDynamicsWarning) as caught:
        description = read(model(PAIR, f"<actuator>{actuators}</actuator>"))
    (said,) = (str(each.message) for each in caught)
    assert f"actuators {parts} drive the same joint 'ja': taken as one, {name!r}" in said
    (transmission,) = description.transmissions
    assert (transmission.joint, transmission.actuator) == ("ja", name)
    assert description.joint("ja").limits.effort == effort


def test_an_actuator_with_the_name_of_two_others_keeps_it():
    actuators = '<motor name="m+n" joint="jb"/><motor name="m" joint="ja"/><motor name="n" joint="ja"/>'
    with pytest.warns(LegDynamicsWarning, match="taken as one, 'm.n_'"):
        description = read(model(PAIR, f"<actuator>{actuators}</actuator>"))
    assert [(each.joint, each.actuator) for each in description.transmissions] == [("jb", "m+n"), ("ja", "m+n_")]


@pytest.mark.parametrize(
    ("option", "left"),
    [
        ('<option actuatorgroupdisable="1"/>', ["m"]),
        ('<option actuatorgroupdisable="0 1"/>', []),
        ('<option><flag actuation="disable"/></option>', []),
        ('<option actuatorgroupdisable="2"/>', ["m", "z"]),
    ],
)
def test_actuators_that_the_file_switches_off_drive_nothing(option, left):
    actuators = '<actuator><motor name="m" joint="ja"/><motor name="z" joint="jb" group="1"/></actuator>'
    text = model(PAIR, actuators, option=option)
    off = [name for name in ("m", "z") if name not in left]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        description = read(text)
    said = [str(each.message) for each in caught]
    assert [each.actuator for each in description.transmissions] == left
    assert description.driven == ("independent" if left else "none")
    assert any("switches them off" in each and all(f"actuator {name!r}" in each for name in off) for each in said) == (
        bool(off)
    )


def test_the_rotor_of_an_actuator_that_is_switched_off_still_turns():
    motor = '<actuator><motor name="m" joint="ja" gear="2" armature="0.5" damping="0.1"/></actuator>'
    text = model(PAIR, motor, option='<option><flag actuation="disable"/></option>')
    try:
        oracle = Oracle(text)
    except ValueError:
        pytest.skip("this release of MuJoCo has no armature of actuators")
    oracle.data.qvel[0], oracle.data.ctrl[0] = 2.0, 1.0
    mujoco.mj_forward(oracle.model, oracle.data)
    assert oracle.data.qfrc_actuator[0] == 0.0
    with pytest.warns(LegDynamicsWarning, match="switches them off: actuator 'm'"):
        joint = read(text).joint("ja")
    assert joint.armature == pytest.approx(2.0, rel=1e-14)
    assert joint.damping == pytest.approx(-oracle.data.qfrc_passive[0] / 2.0, rel=1e-14)


@pytest.mark.parametrize(
    "actuator",
    [
        '<motor name="m" tendon="t"/>',
        '<motor name="m" site="s"/>',
        '<motor name="m" joint="ball"/>',
        '<motor name="m" joint="ja" gear="0"/>',
    ],
    ids=["tendon", "site", "ball", "no gear"],
)
def test_actuators_on_no_single_joint_are_left_out_with_a_warning(actuator):
    bodies = PAIR + f'<body name="d"><joint name="ball" type="ball"/>{GEOM}<site name="s"/></body>'
    rest = '<tendon><fixed name="t"><joint joint="ja" coef="1"/><joint joint="jb" coef="2"/></fixed></tendon>'
    with pytest.warns(LegDynamicsWarning, match="left out.*actuator 'm'"):
        description = read(model(bodies, f"{rest}<actuator>{actuator}</actuator>"))
    assert description.transmissions == ()


def test_rotors_and_losses_of_actuators_are_felt_through_the_gear():
    text = model(PAIR, '<actuator><motor joint="jb" gear="3" armature=".02" damping=".1"/></actuator>')
    try:
        oracle = Oracle(text)
    except ValueError:
        pytest.skip("this release of MuJoCo has no armature of actuators")
    oracle.data.qvel[1] = 2.0
    mujoco.mj_forward(oracle.model, oracle.data)
    joint = read(text).joint("jb")
    assert joint.armature == pytest.approx(0.18, rel=1e-14)
    assert joint.damping == pytest.approx(-oracle.data.qfrc_passive[1] / 2.0, rel=1e-14)


# ---------------------------------------------------------------------- equalities


def ends_meet(description, values):
    """Largest difference between the two ends of each loop, in position and, of a fixed one, in rotation."""
    placed, worst = link_transforms(description, values), {}
    for loop in description.loops:
        first, second = (placed[end.link] @ end.origin.matrix() for end in (loop.predecessor, loop.successor))
        part = np.s_[:3, 3] if loop.type == "spherical" else np.s_[:3, :]
        worst[loop.name] = float(np.abs((first - second)[part]).max())
    return worst


SITES = body(
    "a", "<site name='sa' pos='.1 0 0' euler='.3 0 0'/>" + body("b", "<site name='sb' pos='0 .1 0' euler='0 .3 0'/>")
)


@pytest.mark.parametrize(
    ("equality", "kind"),
    [
        ('<connect name="e" body1="a" body2="b" anchor=".1 .2 .3"/>', "spherical"),
        ('<connect name="e" body1="b" anchor=".1 .2 .3"/>', "spherical"),
        ('<weld name="e" body1="a" body2="b"/>', "fixed"),
        ('<weld name="e" body1="b" anchor=".1 .2 .3"/>', "fixed"),
        ('<weld name="e" body1="a" body2="b" relpose=".1 .2 .3 .5 .5 -.5 .5" anchor=".2 .1 0"/>', "fixed"),
        ('<weld name="e" body1="a" body2="b" torquescale="0" anchor=".2 .1 0"/>', "spherical"),
        ('<connect name="e" site1="sa" site2="sb"/>', "spherical"),
        ('<weld name="e" site1="sa" site2="sb"/>', "fixed"),
    ],
)
def test_loops_are_closed_where_mujoco_says(equality, kind):
    text = model(SITES, f"<equality>{equality}</equality>")
    description = read(text)
    (loop,) = description.loops
    assert (loop.name, loop.type) == ("e", kind)
    # MuJoCo's own residual at another pose: positions of the two anchors, and rotation vectors.
    oracle = Oracle(text)
    qpos = np.array([0.4, -0.7])
    oracle.data.qpos[:] = qpos
    mujoco.mj_forward(oracle.model, oracle.data)
    residual = oracle.data.efc_pos[oracle.data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
    placed = link_transforms(description, {"ja": 0.4, "jb": -0.7})
    first, second = (placed[end.link] @ end.origin.matrix() for end in (loop.predecessor, loop.successor))
    np.testing.assert_allclose(first[:3, 3] - second[:3, 3], residual[:3], atol=1e-14)
    if kind == "fixed":
        turn = first[:3, :3].T @ second[:3, :3]
        angle = np.arccos((np.trace(turn) - 1.0) / 2.0)
        # Row i is the sine of half the angle along axis i.
        np.testing.assert_allclose(np.linalg.norm(residual[3:]), np.sin(angle / 2.0), atol=1e-12)


def test_the_pose_of_the_file_closes_loops_between_bodies():
    rest = '<equality><connect body1="a" body2="c" anchor=".1 .2 .3"/><weld body1="a" body2="b"/></equality>'
    description = read(model(PAIR, rest))
    assert ends_meet(description, description.home.values) == {
        "equality_0": pytest.approx(0.0, abs=1e-15),
        "equality_1": pytest.approx(0.0, abs=1e-15),
    }


def refs(text):
    return text.replace('name="ja"', 'name="ja" ref=".3"').replace('name="jb"', 'name="jb" ref="-.2"')


def mimics(description):
    return {
        joint.name: (joint.mimic.joint, joint.mimic.multiplier, joint.mimic.offset)
        for joint in description.joints
        if joint.mimic is not None
    }


def equality(first, second, coefficients, name="g"):
    other = f'joint2="{second}"' if second else ""
    return f'<joint name="{name}" joint1="{first}" {other} polycoef="{coefficients} 0 0 0"/>'


def gears(*equalities):
    return refs(model(PAIR, f"<equality>{''.join(equalities)}</equality>"))


def test_a_linear_joint_equality_is_a_mimic():
    text = gears(equality("jb", "ja", ".1 -2"))
    description = read(text)
    # b - (-0.2) = 0.1 - 2 (a - 0.3)
    assert mimics(description) == {"jb": ("ja", -2.0, pytest.approx(0.5, abs=1e-15))}
    oracle = Oracle(text)
    oracle.data.qpos[:] = (0.7, -2.0 * 0.7 + 0.5, 0.0)
    mujoco.mj_forward(oracle.model, oracle.data)
    np.testing.assert_allclose(oracle.data.efc_pos[0], 0.0, atol=1e-15)
    # qpos0 breaks the equality; home does not.
    assert description.home.values["jb"] == pytest.approx(-2.0 * 0.3 + 0.5, abs=1e-15)


def test_equalities_of_one_joint_make_a_forest():
    # c follows b twice: the second one makes b follow a by way of c.
    text = gears(equality("jc", "jb", "0 2", "one"), equality("jc", "ja", "0 3", "two"))
    assert {name: follows[0] for name, follows in mimics(read(text)).items()} == {"jc": "jb", "jb": "ja"}
    values = read(text).home.values
    oracle = Oracle(text)
    oracle.data.qpos[:] = [values[name] for name in ("ja", "jb", "jc")]
    mujoco.mj_forward(oracle.model, oracle.data)
    np.testing.assert_allclose(oracle.data.efc_pos, 0.0, atol=1e-14)


def test_what_others_say_already_is_left_out_and_what_contradicts_them_refused():
    first = equality("jb", "ja", "0 2", "one")
    with pytest.warns(LegDynamicsWarning, match="equality 'two' says what others say already"):
        description = read(gears(first, equality("ja", "jb", "0 .5", "two")))
    assert set(mimics(description)) == {"jb"}
    with pytest.raises(UnsupportedError, match="equality 'two' contradicts"):
        read(gears(first, equality("ja", "jb", "0 3", "two")))
    with pytest.raises(UnsupportedError, match="equality 'two' contradicts"):
        read(gears(first, equality("ja", "jb", ".1 .5", "two")))


@pytest.mark.parametrize(
    ("equalities", "held"),
    [
        ([equality("jb", None, ".4 0")], {"jb": 0.2}),
        ([equality("jb", "ja", ".4 0")], {"jb": 0.2}),
        ([equality("jb", None, ".4 0", "x"), equality("ja", "jb", "0 2", "y")], {"jb": 0.2, "ja": 1.1}),
        ([equality("jb", "ja", "0 2", "x"), equality("jb", None, ".4 0", "y")], {"jb": 0.2, "ja": 0.5}),
        ([equality("jb", "ja", "0 2", "x"), equality("ja", None, ".2 0", "y")], {"jb": 0.2, "ja": 0.5}),
    ],
    ids=["alone", "zero slope", "leader first", "leader last", "leader itself"],
)
def test_joints_that_equalities_hold_in_place_are_fixed_there(equalities, held):
    text = gears(*equalities)
    description = read(text)
    assert {joint.name for joint in description.joints if joint.type == "fixed"} == set(held)
    assert not set(held) & set(description.home.values)
    oracle = Oracle(text)
    free = {"ja": 0.6, "jb": 0.6, "jc": -0.9} | held
    oracle.at([free[name] for name in ("ja", "jb", "jc")])
    moving = {name: value for name, value in free.items() if name not in held}
    np.testing.assert_allclose(link_transforms(description, moving)["c"], oracle.body("c"), atol=1e-14)


def test_a_motor_on_a_joint_that_is_held_is_left_out():
    rest = f'<equality>{equality("jb", None, "0 0")}</equality><actuator><motor name="m" joint="jb"/></actuator>'
    with pytest.warns(LegDynamicsWarning, match="actuator 'm'"):
        assert read(model(PAIR, rest)).transmissions == ()


TENDON = '<tendon><fixed name="t"><joint joint="ja" coef="1"/><joint joint="jb" coef="2"/></fixed></tendon>'


@pytest.mark.parametrize(
    ("rest", "message"),
    [
        (
            '<equality><joint name="g" joint1="ja" joint2="jb" polycoef="0 1 .2 0 0"/></equality>',
            "equality 'g' is not linear",
        ),
        (f'{TENDON}<equality><tendon name="g" tendon1="t"/></equality>', "equality 'g' is of type tendon"),
    ],
    ids=["nonlinear", "tendon"],
)
def test_other_equalities_are_refused_by_name_unless_inactive(rest, message):
    with pytest.raises(UnsupportedError, match=message):
        read(model(PAIR, rest))
    for text in (
        model(PAIR, rest.replace('name="g"', 'name="g" active="false"')),
        model(PAIR, rest, option='<option><flag equality="disable"/></option>'),
    ):
        with pytest.warns(LegDynamicsWarning, match="inactive, so left out: equality 'g'"):
            description = read(text)
        assert mimics(description) == {}


def test_inactive_loops_are_left_out():
    text = model(PAIR, '<equality><connect body1="a" body2="c" anchor="0 0 0" active="false"/></equality>')
    with pytest.warns(LegDynamicsWarning, match="equality number 0"):
        assert read(text).loops == ()


# ---------------------------------------------------------------------- poses


def test_keyframes_are_configurations_and_home_comes_first():
    keys = '<keyframe><key qpos="1 2 3"/><key name="up" qpos=".1 .2 .3"/><key name="home" qpos=".4 .5 .6"/></keyframe>'
    description = read(model(PAIR, keys))
    assert [each.name for each in description.configurations] == ["home", "key_0", "up"]
    assert dict(description.home.values) == {"ja": 0.4, "jb": 0.5, "jc": 0.6}
    assert dict(description.configurations[1].values) == {"ja": 1.0, "jb": 2.0, "jc": 3.0}


def test_without_keyframes_home_is_where_the_file_puts_the_bodies():
    assert dict(read(refs(model(PAIR))).home.values) == {"ja": 0.3, "jb": -0.2, "jc": 0.0}
    assert read(model(f"<body name='a'>{GEOM}</body>")).configurations == ()


@pytest.mark.parametrize(
    "quaternion", ["1 0 0 0", ".5 .1 -.7 .2", "2 0 0 1", ".70710678118654757 0 .70710678118654757 0", "0 0 1 0"]
)
@pytest.mark.parametrize("kind", ["free", "ball"])
def test_quaternions_of_keyframes_become_angles(kind, quaternion):
    joint = '<freejoint name="k"/>' if kind == "free" else '<joint name="k" type="ball" pos=".1 0 .2"/>'
    position = ".3 -.4 .5 " if kind == "free" else ""
    text = model(
        f'<body name="a" pos=".1 .2 .3" euler=".3 .2 .1">{joint}{GEOM}</body>',
        f'<keyframe><key name="home" qpos="{position}{quaternion}"/></keyframe>',
    )
    oracle, description = Oracle(text), single_coordinate(read(text))
    oracle.at(oracle.model.key_qpos[0])
    placed = link_transforms(description, description.home.values)["a"]
    np.testing.assert_allclose(placed, oracle.body("a"), atol=1e-14)


# ---------------------------------------------------------------------- forces that a description cannot hold


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        ('<joint name="k" stiffness="3"/>', "springs .stiffness up to 3. act on joint 'k'"),
        ('<joint name="k" type="ball" damping="3"/>', "ball joint 'k' has damping 3"),
        ('<joint name="k" type="ball" armature="3"/>', "ball joint 'k' has armature 3"),
        ('<joint name="k" type="ball" frictionloss="3"/>', "ball joint 'k' has frictionloss 3"),
        ('<joint name="k" type="free" damping="3"/>', "free joint 'k' has damping 3.*<freejoint>"),
        ('<joint name="k" type="free" armature="3"/>', "free joint 'k' has armature 3.*<freejoint>"),
    ],
)
def test_springs_and_losses_of_several_coordinates_are_refused(joint, message):
    with pytest.raises(UnsupportedError, match=message):
        read(model(f'<body name="a">{joint}{GEOM}</body>'))
    assert read(model(f'<body name="a">{joint.replace("3", "0")}{GEOM}</body>'))


def test_springs_that_are_switched_off_do_no_harm():
    bodies = f'<body name="a"><joint stiffness="3"/>{GEOM}</body>'
    assert read(model(bodies, option='<option><flag spring="disable"/></option>'))


@pytest.mark.parametrize(
    ("bodies", "actuator"),
    [
        (f'<body name="a"><joint name="ja" damping="1 2"/>{GEOM}</body>', ""),
        (PAIR, '<motor name="m" joint="ja" damping="1 2"/>'),
        (PAIR, '<motor name="m" tendon="t" damping="1"/>'),
        (PAIR, '<motor name="m" tendon="t" armature="1"/>'),
    ],
)
def test_losses_that_no_joint_can_have_are_refused(bodies, actuator):
    tendon = '<tendon><fixed name="t"><joint joint="ja" coef="1"/></fixed></tendon>'
    text = model(bodies, f"{tendon}<actuator>{actuator}</actuator>")
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError:
        pytest.skip("this release of MuJoCo knows no such loss")
    with pytest.raises(UnsupportedError, match=r"not linear in the speed|drives no single joint and has"):
        read(text)


def test_flexible_bodies_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs what it thinks of the model in the current folder
    flex = '<flexcomp name="f" type="grid" count="3 3 1" spacing=".1 .1 .1" radius=".01" dim="2" mass="1"/>'
    with pytest.raises(UnsupportedError, match="flex"):
        read(model(PAIR + flex))


@pytest.mark.parametrize("attribute", ["stiffness", "damping", "frictionloss", "armature"])
def test_tendons_that_pull_are_refused(attribute):
    with pytest.raises(UnsupportedError, match=f"tendon 't' has {attribute} 2"):
        read(model(PAIR, TENDON.replace('name="t"', f'name="t" {attribute}="2"')))
    assert read(model(PAIR, TENDON))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (model(PAIR, option='<option gravity="0 0 -9.8"/>'), r"pass gravity=\(0, 0, -9.8\)"),
        (model(PAIR, option='<option><flag gravity="disable"/></option>'), r"pass gravity=\(0, 0, 0\)"),
        (model(PAIR, option='<option density="1.2"/>'), "fluid"),
        (model(PAIR.replace('name="b"', 'name="b" gravcomp=".5"')), "gravity compensation .gravcomp. of body 'b'"),
    ],
    ids=["gravity", "no gravity", "fluid", "gravcomp"],
)
def test_what_acts_on_all_bodies_is_warned_about(text, message):
    with pytest.warns(LegDynamicsWarning, match=message):
        read(text)


def test_a_usual_model_gives_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read(model(PAIR, '<actuator><motor joint="ja" ctrlrange="-1 1" gear="50"/></actuator>'))
