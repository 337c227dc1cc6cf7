"""Reading URDF+: what is kept, and the error with file and line for each thing that cannot be true."""

from __future__ import annotations

import gc
import itertools
import math
import pickle
import re
import time
import tracemalloc
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from leg_dynamics.description import Description, JointLimits, independent_joints, parse, read
from leg_dynamics.description.flags import with_independent
from leg_dynamics.errors import DescriptionError, LegDynamicsWarning, UnsafeXmlError

MODELS = Path(__file__).parents[2].parent / "shared" / "models"
LINES = """<?xml version="1.0"?>
<robot name="arm">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="base"/>
  <link name="upper">
    <inertial><origin xyz="0 0 0.5" rpy="0 0 0.1"/><mass value="2"/><inertia ixx="0.2" iyy="0.2" izz="0.01"/></inertial>
    <visual><origin xyz="1 2 3"/><geometry><cylinder radius="0.1" length="1"/></geometry><material name="red"/></visual>
  </link>
  <link name="lower"/>
  <link name="rod"/>
  <link name="gear"/>
  <joint name="shoulder" type="revolute" independent="TRUE">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 1" rpy="0.1 0.2 0.3"/>
    <axis xyz="0 3 4"/>
    <limit lower="-1" upper="2" effort="30" velocity="5"/>
    <dynamics damping="0.1" friction="0.2"/>
  </joint>
  <joint name="elbow" type="continuous" independent="False">
    <parent link="upper"/>
    <child link="lower"/>
    <limit effort="7" velocity="8" lower="-1" upper="1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="base"/>
    <child link="rod"/>
    <axis xyz="0 0 -2e-3"/>
    <mimic joint="shoulder" multiplier="-0.5" offset="0.25"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="lower"/>
    <child link="gear"/>
    <axis xyz="0 0 0"/>
  </joint>
  <loop name="closure" type="revolute">
    <predecessor link="lower"><origin xyz="0 0 1"/></predecessor>
    <successor link="rod"/>
    <axis xyz="0 0 9"/>
  </loop>
  <coupling name="mesh" type="rolling">
    <predecessor link="upper"/>
    <successor link="gear"/>
    <ratio value="-2"/>
  </coupling>
  <transmission name="drive">
    <type>transmission_interface/SimpleTransmission</type>
    <joint name="shoulder"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>
    <actuator name="M1">
      <mechanicalReduction>
        50
      </mechanicalReduction>
      <rotorInertia>1e-5</rotorInertia>
    </actuator>
  </transmission>
  <configuration name="bent">
    <joint name="shoulder" value="0.5"/>
    <joint name="elbow" value="-1"/>
  </configuration>
</robot>
"""
# The coupling's predecessor is an ancestor of its successor, which is legal and worth a warning.
ONE_SIDED = "ignore:.*moving joints on one side only"
pytestmark = pytest.mark.filterwarnings(ONE_SIDED)


def changed(old: str, new: str) -> str:
    assert LINES.count(old) == 1, old
    return LINES.replace(old, new)


def line_of(text: str, needle: str, occurrence: int = 0) -> int:
    lines = [number for number, line in enumerate(text.splitlines(), 1) if needle in line]
    return lines[occurrence]


def test_everything_in_the_file_is_in_the_description() -> None:
    arm = parse(LINES, file="arm.urdf")
    assert (arm.name, arm.file, arm.root, arm.urdf) == ("arm", "arm.urdf", "base", LINES)
    assert [link.name for link in arm.links] == ["base", "upper", "lower", "rod", "gear"]
    upper = arm.link("upper")
    assert upper.line == 5
    assert upper.inertial is not None
    assert upper.inertial.mass == 2.0
    assert upper.inertial.origin.rpy == (0.0, 0.0, 0.1)
    np.testing.assert_array_equal(upper.inertial.tensor(), np.diag([0.2, 0.2, 0.01]))
    (visual,) = upper.visuals
    assert (visual.geometry.kind, visual.geometry.size) == ("cylinder", (0.1, 1.0))
    assert (visual.rgba, visual.origin.xyz) == ((1.0, 0.0, 0.0, 1.0), (1.0, 2.0, 3.0))

    shoulder, elbow, slide, mount = arm.joints
    assert (shoulder.parent, shoulder.child, shoulder.origin.xyz) == ("base", "upper", (0.0, 0.0, 1.0))
    assert shoulder.origin.rpy == (0.1, 0.2, 0.3)
    assert shoulder.axis == pytest.approx((0.0, 0.6, 0.8), abs=1e-16)
    assert (shoulder.limits.lower, shoulder.limits.upper) == (-1.0, 2.0)
    assert (shoulder.limits.effort, shoulder.limits.velocity) == (30.0, 5.0)
    assert (shoulder.damping, shoulder.friction) == (0.1, 0.2)
    assert (shoulder.independent, shoulder.independent_is_stated, shoulder.unit) == (True, True, "rad")
    assert (elbow.independent, elbow.independent_is_stated) == (False, True)
    assert elbow.axis == (1.0, 0.0, 0.0)
    assert (elbow.limits.lower, elbow.limits.upper, elbow.limits.effort) == (-math.inf, math.inf, 7.0)
    assert slide.mimic is not None
    assert (slide.mimic.joint, slide.mimic.multiplier, slide.mimic.offset) == ("shoulder", -0.5, 0.25)
    assert (slide.axis, slide.unit, slide.independent, slide.independent_is_stated) == ((0, 0, -1), "m", False, False)
    assert slide.limits.upper == math.inf  # no <limit> at all is tolerated
    assert (mount.axis, mount.independent) == ((1.0, 0.0, 0.0), False)

    (loop,) = arm.loops
    assert (loop.type, loop.axis, loop.predecessor.link, loop.successor.link) == ("revolute", (0, 0, 1), "lower", "rod")
    assert (loop.predecessor.origin.xyz, loop.successor.origin.xyz) == ((0, 0, 1), (0, 0, 0))
    (coupling,) = arm.couplings
    assert (coupling.predecessor, coupling.successor, coupling.ratio) == ("upper", "gear", -2.0)
    (transmission,) = arm.transmissions
    assert (transmission.joint, transmission.actuator) == ("shoulder", "M1")
    assert (transmission.reduction, transmission.rotor_inertia) == (50.0, 1e-5)
    assert dict(arm.configurations[0].values) == {"shoulder": 0.5, "elbow": -1.0}
    assert arm.home == arm.configurations[0]


# (what is replaced, by what, a piece of the message, the line: of the first needle in the changed text)
BROKEN: dict[str, tuple[str, str, str, str | tuple[int]]] = {
    "unknown parent": (
        '<parent link="upper"/>',
        '<parent link="uper"/>',
        "unknown link 'uper'.*did you mean 'upper'",
        "uper",
    ),
    "unknown child": ('<child link="rod"/>', '<child link="nothing"/>', "unknown link 'nothing'", "nothing"),
    "unknown loop link": ('<successor link="rod"/>', '<successor link="Q"/>', "unknown link 'Q'", '"Q"'),
    "unknown coupling link": ('<predecessor link="upper"/>', '<predecessor link="Q"/>', "unknown link 'Q'", '"Q"'),
    "duplicate link": ('<link name="rod"/>', '<link name="lower"/>', "duplicate <link> name 'lower'.*line 9", (10,)),
    "duplicate joint": ('name="slide"', 'name="elbow"', "duplicate <joint> name 'elbow'", (25,)),
    "no successor": ('<successor link="rod"/>', "", "'closure' has no <successor>", "closure"),
    "no predecessor": (
        '<predecessor link="lower"><origin xyz="0 0 1"/></predecessor>',
        "",
        "no <predecessor>",
        "closure",
    ),
    "end without link": ('<successor link="rod"/>', "<successor/>", "<successor> has no link", "<successor/>"),
    "two successors": (
        '<successor link="rod"/>',
        '<successor link="rod"/>\n<successor link="rod"/>',
        "second <succ",
        (39,),
    ),
    "loop on one link": ('<successor link="rod"/>', '<successor link="lower"/>', "both ends.*'lower'", "closure"),
    "loop type": ('name="closure" type="revolute"', 'name="closure" type="helical"', "'helical'.*spherical", "closure"),
    "loop without type": ('name="closure" type="revolute"', 'name="closure"', "has no type", "closure"),
    "joint type": ('type="prismatic"', 'type="screw"', "unsupported type 'screw'", "screw"),
    "joint type case": ('type="prismatic"', 'type="Prismatic"', "unsupported type", "Prismatic"),
    "joint without type": ('name="slide" type="prismatic"', 'name="slide"', "'slide' has no type", "slide"),
    "zero axis": ('xyz="0 3 4"', 'xyz="0 0 0"', "'shoulder' has a zero axis", (16,)),
    "zero loop axis": ('xyz="0 0 9"', 'xyz="0 0 0.0"', "'closure' has a zero axis", "0 0 0.0"),
    "nan": ('xyz="0 3 4"', 'xyz="0 nan 4"', "finite", "nan"),
    "inf": ('lower="-1" upper="2"', 'lower="-inf" upper="2"', "lower.*finite", "-inf"),
    "overflow": ('mass value="2"', 'mass value="1e999"', "finite.*1e999", "1e999"),
    "hex": ('mass value="2"', 'mass value="0x2"', "not decimal: '0x2'", "0x2"),
    "underscore": ('mass value="2"', 'mass value="2_0"', "not decimal", "2_0"),
    "other digits": ('mass value="2"', 'mass value="٢"', "not decimal", "٢"),
    "word": ('mass value="2"', 'mass value="heavy"', "not decimal: 'heavy'", "heavy"),
    "comma": ('xyz="1 2 3"', 'xyz="1,2,3"', "3 numbers, got 1", "1,2,3"),
    "decimal comma": ('xyz="1 2 3"', 'xyz="1 2 3,5"', "not decimal", "3,5"),
    "count": ('xyz="1 2 3"', 'xyz="1 2 3 4"', "3 numbers, got 4", "1 2 3 4"),
    "empty vector": ('xyz="1 2 3"', 'xyz=""', "3 numbers, got 0", 'xyz=""'),
    "empty number": ('mass value="2"', 'mass value=" "', "value of <mass> is empty", 'value=" "'),
    "two in one": ('mass value="2"', 'mass value="2 3"', "1 number, got 2", "2 3"),
    "rgba": ('rgba="1 0 0 1"', 'rgba="1 0 0"', "4 numbers", "rgba"),
    "negative mass": ('mass value="2"', 'mass value="-2"', "negative mass -2", '"-2"'),
    "no mass": ('<mass value="2"/>', "", "no <mass>", "inertial"),
    "no inertia": ('<inertia ixx="0.2" iyy="0.2" izz="0.01"/>', "", "no <inertia>", "inertial"),
    "no izz": ('izz="0.01"', "", "no izz", "ixx"),
    "negative damping": ('damping="0.1"', 'damping="-0.1"', "negative damping", "damping"),
    "negative effort": ('effort="30"', 'effort="-30"', "negative effort", "-30"),
    "positive effort_lower": (
        'effort="30"',
        'effort="30" effort_lower="4"',
        "positive effort_lower 4 of <limit>",
        "30",
    ),
    "endless effort_lower": ('effort="30"', 'effort="30" effort_lower="-inf"', "effort_lower .* must be finite", "30"),
    "no effort_lower": ('effort="30"', 'effort="30" effort_lower="low"', "effort_lower .* not decimal", "30"),
    "negative radius": ('radius="0.1"', 'radius="-0.1"', "negative radius", "radius"),
    "two shapes": ("<geometry>", '<geometry><sphere radius="1"/>', "one shape, found 2", "sphere"),
    "lower over upper": ('lower="-1" upper="2"', 'lower="3" upper="2"', "lower limit 3.*upper limit 2", (17,)),
    "lower over default": ('lower="-1" upper="2"', 'lower="3"', "lower limit 3.*upper limit 0", (17,)),
    "independent": ('independent="TRUE"', 'independent="yes"', "true or false, got 'yes'", "yes"),
    "independent empty": ('independent="TRUE"', 'independent=""', "true or false", "shoulder"),
    "two roots": (
        '<link name="gear"/>',
        '<link name="gear"/><link name="stray"/>',
        "disconnected: 2 .*'base', 'stray'",
        "stray",
    ),
    "two parents": (
        '<child link="rod"/>',
        '<child link="upper"/>',
        "'upper' has two parents.*'shoulder'.*'slide'",
        "slide",
    ),
    "self joint": ('<parent link="upper"/>\n    <child', '<parent link="lower"/>\n    <child', "to itself", "elbow"),
    "cycle": (
        '<parent link="base"/>\n    <child link="upper"/>',
        '<parent link="gear"/>\n    <child link="upper"/>',
        "cycle: 'upper' <- 'gear' <- 'lower' <- 'upper'",
        "shoulder",
    ),
    "no ratio": ('<ratio value="-2"/>', "", "'mesh' has no <ratio>", "mesh"),
    "ratio without value": ('<ratio value="-2"/>', "<ratio/>", "<ratio> has no value", "<ratio/>"),
    "ratio zero": ('<ratio value="-2"/>', '<ratio value="0"/>', "ratio zero", '"0"'),
    "self coupling": ('<successor link="gear"/>', '<successor link="upper"/>', "'upper' to itself", "mesh"),
    "empty coupling": ('<predecessor link="upper"/>', '<predecessor link="lower"/>', "couples nothing", "mesh"),
    "mimic unknown": (
        'mimic joint="shoulder"',
        'mimic joint="sholder"',
        "unknown joint 'sholder'.*'shoulder'",
        "slide",
    ),
    "mimic itself": ('mimic joint="shoulder"', 'mimic joint="slide"', "mimics itself", "slide"),
    "mimic fixed": ('mimic joint="shoulder"', 'mimic joint="mount"', "'mount' is fixed", "slide"),
    "mimic cycle": (
        '<dynamics damping="0.1" friction="0.2"/>',
        '<mimic joint="slide"/>',
        "cycle: 'shoulder' -> 'slide' -> 'shoulder'",
        "shoulder",
    ),
    "actuated unknown": ('<joint name="shoulder"><hard', '<joint name="knee"><hard', "unknown joint 'knee'", "knee"),
    "actuated fixed": ('<joint name="shoulder"><hard', '<joint name="mount"><hard', "is fixed", 'mount"><hard'),
    "reduction": ("        50\n", "        fifty\n", "not decimal", "<mechanicalReduction>"),
    "reduction zero": ("        50\n", "        0\n", "'drive' is zero", "drive"),
    "reduction squared": (
        "        50\n",
        "        -1e200\n",
        "'drive' felt.*check the gear ratio",
        "drive",
    ),
    "reduction and rotor": ("1e-5", "1e306", "'drive' felt at its joint.*rotorInertia 1e\\+306", "drive"),
    "reduction empty": ("        50\n", "\n", "1 number, got 0", "<mechanicalReduction>"),
    "rotor inertia": ("1e-5", "-1e-5", "negative rotorInertia", "drive"),
    "actuator unnamed": ('actuator name="M1"', "actuator", "<actuator> has no name", "<actuator>"),
    "several actuators": (
        '<actuator name="M1">',
        '<actuator name="M2"/>\n<actuator name="M1">',
        "only one of each",
        "drive",
    ),
    "pose unknown": ('<joint name="elbow" value', '<joint name="elbw" value', "unknown joint 'elbw'.*'elbow'", "elbw"),
    "pose fixed": ('<joint name="elbow" value', '<joint name="mount" value', "'mount' is fixed", 'mount" value'),
    "pose twice": ('<joint name="elbow" value', '<joint name="shoulder" value', "two values", 'shoulder" value="-1"'),
    "pose without value": ('name="elbow" value="-1"', 'name="elbow"', "'elbow' has no value", 'name="elbow"/>'),
    "unnamed link": ('<link name="rod"/>', "<link/>", "<link> has no name", "<link/>"),
    "unnamed loop": ('<loop name="closure"', "<loop", "<loop> has no name", "<loop"),
    "unnamed robot": ('<robot name="arm">', "<robot>", "<robot> has no name", "<robot>"),
    "nested xacro": ('<child link="rod"/>', '<child link="rod"/><xacro:axis/>', "xacro.*render", "xacro"),
    "xacro": ('<link name="rod"/>', '<link name="rod"/><xacro:rod/>', "xacro.*render", "xacro"),
    "undefined entity": ('<link name="rod"/>', '<link name="rod"/>&boom;', "undefined entity", "boom"),
    "duplicate attribute": ('<link name="rod"/>', '<link name="rod" name="rod"/>', "duplicate attribute", "rod"),
}


@pytest.mark.filterwarnings("ignore:.*'shoulder' mimics 'slide'.*ignored")
@pytest.mark.parametrize("case", BROKEN)
def test_what_cannot_be_true_is_an_error_with_file_and_line(case: str) -> None:
    old, new, message, place = BROKEN[case]
    text = changed(old, new)
    with pytest.raises(DescriptionError, match=message) as caught:
        parse(text, file="broken.urdf")
    line = place[0] if isinstance(place, tuple) else line_of(text, place)
    assert (caught.value.file, caught.value.line) == ("broken.urdf", line)
    assert str(caught.value).startswith(f"broken.urdf:{line}: ")


@pytest.mark.parametrize(
    ("attributes", "lower", "upper"),
    [
        ('effort="30" effort_lower="-4"', -4.0, 30.0),
        ('effort="0" effort_lower="-4"', -4.0, 0.0),
        ('effort="30" effort_lower="0"', 0.0, 30.0),
        ('effort="30" effort_lower="-0"', 0.0, 30.0),
        ('effort="30"', -30.0, 30.0),
        ('effort="0"', 0.0, 0.0),
        ('effort_lower="-4"', -4.0, math.inf),
        ("", -math.inf, math.inf),
    ],
)
def test_efforts_are_limited_each_way(attributes: str, lower: float, upper: float) -> None:
    arm = parse(changed('effort="30"', attributes))
    limits = arm.joint("shoulder").limits
    assert (limits.effort_lower, limits.effort) == (lower, upper)
    assert math.copysign(1.0, limits.effort_lower) == (-1.0 if lower else 1.0)
    assert limits == JointLimits(-1.0, 2.0, upper, 5.0, lower)
    assert (f"effort_lower={lower!r}" in repr(limits), pickle.loads(pickle.dumps(limits))) == (True, limits)
    rewritten = with_independent(arm, {"shoulder"})
    assert rewritten is not arm
    assert rewritten.joint("shoulder").limits == limits


@pytest.mark.parametrize("tag", ["loop", "coupling", "transmission", "configuration", "joint", "link"])
def test_each_kind_of_name_is_used_once(tag: str) -> None:
    # The first such element at the root, once more behind itself.
    element = re.search(rf"^  <{tag} name=[^>]*/>\n|^  <{tag} name=.*?^  </{tag}>\n", LINES, re.M | re.S)
    assert element is not None
    text = LINES[: element.end()] + element[0] + LINES[element.end() :]
    with pytest.raises(DescriptionError, match=f"duplicate <{tag}> name") as caught:
        parse(text)
    assert caught.value.line == line_of(text, element[0].splitlines()[0], 1)


def drive(joint: str, actuator: str) -> str:
    return f'<transmission name="more"><joint name="{joint}"/><actuator name="{actuator}"/></transmission></robot>'


def test_no_joint_is_driven_twice() -> None:
    with pytest.raises(DescriptionError, match=r"^[^:]+:60: joint .* has two transmissions, 'drive' and 'more'"):
        parse(changed("</robot>", drive("shoulder", "M2")))


def test_a_motor_of_two_joints_is_an_actuator_on_each() -> None:
    with pytest.warns(LegDynamicsWarning, match=r"'M1' has transmissions to several joints \(elbow, shoulder\)"):
        transmissions = parse(changed("</robot>", drive("elbow", "M1"))).transmissions
    assert [(each.joint, each.actuator) for each in transmissions] == [("shoulder", "shoulder"), ("elbow", "elbow")]
    # What is known of the first drive stays known.
    assert (transmissions[0].reduction, transmissions[0].rotor_inertia) == (50.0, 1e-5)


def test_the_name_that_a_shared_motor_leaves_its_joint_may_be_taken() -> None:
    taken = drive("elbow", "M1").replace("</robot>", drive("slide", "elbow").replace("more", "third"))
    with (
        pytest.warns(LegDynamicsWarning, match="several joints"),
        pytest.raises(DescriptionError, match="actuator 'elbow' has two transmissions"),
    ):
        parse(changed("</robot>", taken))


@pytest.mark.parametrize("joint", ["mount", "knee"])
def test_a_motor_of_a_joint_that_does_not_move_here_is_left_out(joint: str) -> None:
    with pytest.warns(LegDynamicsWarning, match=rf"^[^:]+:60: <transmission> 'more' is for joints .* \({joint}\)"):
        assert [each.joint for each in parse(changed("</robot>", drive(joint, "M2"))).transmissions] == ["shoulder"]


DIFFERENTIAL = """<transmission name="wrist">
  <actuator name="M2"><mechanicalReduction>3</mechanicalReduction></actuator><actuator name="M3"/>
  <joint name="elbow"><mechanicalReduction>2</mechanicalReduction></joint><joint name="slide"/>
</transmission></robot>"""
OLD_DIFFERENTIAL = """<transmission name="wrist" type="WristTransmission">
  <rightActuator name="M2" mechanicalReduction="60"/><leftActuator name="M3" mechanicalReduction="60"/>
  <flexJoint name="elbow" mechanicalReduction="-1"/><rollJoint name="slide" mechanicalReduction="1"/>
</transmission></robot>"""


def free_slide(text: str) -> str:
    """The text without the mimic, so that the slide may be driven."""
    return re.sub(r"<mimic [^>]*/>", "", text)


@pytest.mark.parametrize("text", [DIFFERENTIAL, OLD_DIFFERENTIAL], ids=["ros", "pr2"])
def test_a_differential_is_an_actuator_on_each_of_its_joints(text: str) -> None:
    with pytest.warns(LegDynamicsWarning, match=r"^[^:]+:60: <transmission> 'wrist' does not join one motor to one"):
        drives = parse(free_slide(changed("</robot>", text))).transmissions[1:]
    assert [(each.joint, each.actuator, each.reduction) for each in drives] == [
        ("elbow", "elbow", 1.0),
        ("slide", "slide", 1.0),
    ]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name="M3"/>', 'name="M3"><rotorInertia>1e-4</rotorInertia></actuator>', "has a rotorInertia"),
        ('<actuator name="M3"/>', "", "joins 2 joints and 1 actuators"),
        ('<joint name="slide"/>', "", "joins 1 joints and 2 actuators"),
        ('<joint name="slide"/>', '<joint name="mount"/>', "is fixed"),
        ('<joint name="slide"/>', '<joint name="knee"/>', "unknown joint 'knee'"),
    ],
)
def test_a_drive_of_several_joints_that_stays_refused(old: str, new: str, message: str) -> None:
    assert DIFFERENTIAL.count(old) == 1
    with pytest.raises(DescriptionError, match=message):
        parse(free_slide(changed("</robot>", DIFFERENTIAL.replace(old, new))))


def test_a_rotor_of_no_inertia_is_no_rotor() -> None:
    text = DIFFERENTIAL.replace('name="M3"/>', 'name="M3"><rotorInertia>0</rotorInertia></actuator>')
    with pytest.warns(LegDynamicsWarning, match="does not join one motor"):
        assert len(parse(free_slide(changed("</robot>", text))).transmissions) == 3


def test_a_fixed_joint_mimics_nothing() -> None:
    with pytest.warns(LegDynamicsWarning, match="'mount' is fixed and has a <mimic>, as have 0 more"):
        assert parse(changed('<axis xyz="0 0 0"/>', '<mimic joint="elbow"/>')).joint("mount").mimic is None


@pytest.mark.parametrize(
    ("text", "message", "line"),
    [
        ("", "empty", None),
        (" \n\t\n", "empty", None),
        ("no XML", "malformed XML", 1),
        (LINES[: LINES.index("</robot>")], "inside <robot> of line 2; the file seems truncated", 60),
        (LINES[: LINES.index('="prismatic')], "truncated", 25),
        (LINES + "<robot/>", "junk after document element", 61),
        ("<sdf version='1.7'/>", "root element is <sdf>", 1),
        ("<Robot name='x'/>", "root element is <Robot>", 1),
        ("<robot name='x'/>", "no <link>", 1),
        ("<robot name='\x00'/>", "malformed", 1),
        ("<robot>\n\ud800</robot>", "surrogate", 2),
    ],
)
def test_text_that_is_no_mechanism(text: str, message: str, line: int | None) -> None:
    with pytest.raises(DescriptionError, match=message) as caught:
        parse(text)
    assert caught.value.line == line


LAUGHS = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10}">' for n in range(1, 10))


@pytest.mark.parametrize(
    "prologue",
    [
        "<!DOCTYPE robot>",
        '<!DOCTYPE robot SYSTEM "robot.dtd">',
        '<!DOCTYPE robot PUBLIC "-//X//Y" "nowhere.dtd">',
        f'<!DOCTYPE robot [<!ENTITY l0 "ha">{LAUGHS}]>',
        '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE robot [<!ENTITY % x SYSTEM "file:///etc/passwd"> %x;]>',
        '<!DOCTYPE robot [<!ATTLIST robot name CDATA "default">]>',
    ],
)
def test_document_types_are_refused_before_anything_is_expanded(prologue: str) -> None:
    text = f'<?xml version="1.0"?>\n{prologue}\n<robot name="x"><link name="&l9;"/></robot>'
    tracemalloc.start()
    try:
        with pytest.raises(UnsafeXmlError, match="DOCTYPE") as caught:
            parse(text)
        assert tracemalloc.get_traced_memory()[1] < 2_000_000
    finally:
        tracemalloc.stop()
    assert caught.value.line == 2


@pytest.mark.parametrize("outer", ["link", "gazebo"])
def test_absurd_nesting_is_refused_everywhere(outer: str) -> None:
    def nested(depth: int) -> str:
        inside = "<a>" * depth + "</a>" * depth
        return f'<robot name="x"><link name="y"/><{outer} name="z">{inside}</{outer}></robot>'

    with pytest.raises(UnsafeXmlError, match="64 deep"):
        parse(nested(100_000))
    if outer == "gazebo":
        assert parse(nested(62)).name == "x"
        with pytest.raises(UnsafeXmlError):
            parse(nested(63))


def test_expanded_character_references_and_a_byte_order_mark_are_fine() -> None:
    assert parse('\ufeff<robot name="a&amp;&#98;"><link name="y"/></robot>').name == "a&b"


def with_inertia(**moments: float) -> str:
    values = " ".join(f'{key}="{value!r}"' for key, value in moments.items())
    return (
        f'<robot name="x">\n<link name="y"><inertial><mass value="1"/><inertia {values}/></inertial></link>\n</robot>'
    )


@pytest.mark.parametrize(
    ("moments", "message"),
    [
        ({"ixx": 1.0, "iyy": 1.0, "izz": 2.1}, r"'y' breaks the triangle inequality.* 1, 1, 2.1 .*by 0.1"),
        ({"ixx": 1.0, "iyy": 1.0, "izz": -0.5}, r"'y' is not positive definite.* -0.5, 1, 1 "),
        ({"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "ixy": 1.5}, r"not positive definite.* -0.5, 1, 2.5 "),
        ({"ixx": 0.0, "iyy": 1.0, "izz": 1.0}, "not positive definite.* 0, 1, 1 "),
        ({"ixx": 1e-300, "iyy": 1e-300, "izz": 3e-300}, "triangle inequality"),
        ({"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "ixy": 0.9}, "triangle inequality.* 0.1, 1, 1.9 .*by 0.8"),
    ],
)
def test_inertia_of_no_rigid_body_is_warned_about_with_numbers(moments: dict[str, float], message: str) -> None:
    with pytest.warns(LegDynamicsWarning, match=f"^<string>:2: inertia.*{message}"):
        parse(with_inertia(**moments))


@given(masses=st.lists(st.floats(0.01, 10), min_size=4, max_size=12), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_the_inertia_of_any_set_of_points_is_accepted(masses: list[float], seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(len(masses), 3))
    tensor = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    parse(with_inertia(**dict(zip(names, np.asarray(tensor)[np.triu_indices(3)].tolist(), strict=True))))


def test_a_disc_and_a_point_mass_are_physical() -> None:
    parse(with_inertia(ixx=0.1, iyy=0.2, izz=0.1 + 0.2))
    parse(with_inertia(ixx=0.0, iyy=0.0, izz=0.0))


def test_every_bad_inertia_is_in_the_one_warning_not_only_the_first() -> None:
    text = with_inertia(ixx=1.0, iyy=1.0, izz=3.0)
    link = text.splitlines()[1]
    second = link.replace('"y"', '"z"')
    joint = '<joint name="j" type="fixed"><parent link="y"/><child link="z"/></joint>'
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        parse(text.replace(link, f"{link}\n{second}\n{joint}"))
    (warning,) = (str(each.message) for each in caught)
    assert warning.startswith("<string>:2: inertia of link 'y'")
    assert warning.endswith("; 1 more links have such an inertia: 'z'")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<link name="rod"/>', '<link name="rod"/><lop name="l"/>', "<lop> is not.*ignored; did you mean 'loop'"),
        ('<link name="rod"/>', '<link name="rod"/><Coupling/><Coupling/>', "<Coupling>.*did you mean 'coupling'"),
        ('rgba="1 0 0 1"', 'rgba="255 0 0 1"', "leaves 0..1"),
        ('<cylinder radius="0.1" length="1"/>', '<capsule radius="1" length="1"/>', "<capsule> is not drawn"),
        ('lower="-1" upper="2" ', "", "here and at 0 more joints: read as unlimited"),
        ('name="slide" type', 'name="slide" independent="true" type', "'slide' mimics 'shoulder'.*ignored"),
        ('name="closure" type="revolute"', 'name="closure" type="spherical"', "spherical and has no axis"),
    ],
)
def test_odd_input_with_one_safe_reading_is_warned_about(old: str, new: str, message: str) -> None:
    with pytest.warns(LegDynamicsWarning, match=message) as caught:
        description = parse(changed(old, new))
    assert len([each for each in caught if "one side only" not in str(each.message)]) == 1
    assert len(description.links) == 5


@pytest.mark.filterwarnings("default")
def test_a_coupling_that_holds_joints_at_zero_is_warned_about() -> None:
    with pytest.warns(LegDynamicsWarning, match="'mesh' has moving joints on one side only.*sum of elbow at zero"):
        parse(LINES)


def test_foreign_extensions_are_ignored_in_silence() -> None:
    parse(changed("</robot>", '<gazebo reference="rod"><mu1>1</mu1></gazebo><ros2_control name="r"/></robot>'))


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic", "fixed", "planar", "spherical", "universal"])
def test_loop_axes_by_type(kind: str) -> None:
    text = changed('name="closure" type="revolute"', f'name="closure" type="{kind}"').replace('<axis xyz="0 0 9"/>', "")
    expected = None if kind in ("fixed", "spherical", "universal") else (1.0, 0.0, 0.0)
    assert parse(text).loops[0].axis == expected


@given(st.tuples(*[st.floats(-1e300, 1e300)] * 3).filter(lambda axis: max(map(abs, axis)) > 1e-8))
@settings(deadline=None)
def test_any_axis_becomes_a_unit_vector_in_its_direction(axis: tuple[float, float, float]) -> None:
    text = LINES.replace('xyz="0 3 4"', 'xyz="{!r} {!r} {!r}"'.format(*axis))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        unit = np.array(parse(text).joints[0].axis)
    assert math.isclose(np.linalg.norm(unit), 1.0, rel_tol=1e-15)
    scaled = np.array(axis) / max(map(abs, axis))
    np.testing.assert_allclose(unit * np.linalg.norm(scaled), scaled, rtol=0, atol=1e-15)


def test_old_transmissions_and_missing_actuators() -> None:
    old = '<transmission name="t"><joint name="elbow"/><mechanicalReduction>3</mechanicalReduction></transmission>'
    transmission = parse(changed("</robot>", f"{old}</robot>")).transmissions[1]
    assert (transmission.actuator, transmission.reduction, transmission.rotor_inertia) == ("elbow", 3.0, 0.0)


def test_inline_materials_are_known_to_later_links() -> None:
    blue = '<visual><geometry><sphere radius="1"/></geometry><material name="{}">{}</material></visual>'
    inline = blue.format("blue", '<color rgba="0 0 1 1"/>')
    text = changed('<link name="rod"/>', f'<link name="rod">{blue.format("blue", "")}{blue.format("lost", "")}</link>')
    text = text.replace('<link name="gear"/>', f'<link name="gear">{inline}</link>')
    arm = parse(text)
    assert [visual.rgba for visual in arm.link("rod").visuals] == [(0, 0, 1, 1), None]
    assert arm.link("gear").visuals[0].rgba == (0, 0, 1, 1)


def test_absolute_meshes_are_warned_about_unless_they_lie_beside_the_file() -> None:
    mesh = '<visual><geometry><mesh filename="/home/me/robot/a.stl"/></geometry></visual>'
    text = f'<robot name="r"><link name="a">{mesh}</link></robot>'
    with pytest.warns(LegDynamicsWarning, match="absolute paths outside the file's folder"):
        parse(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parse(text, file="/home/me/robot/robot.urdf")


def test_meshes_and_boxes() -> None:
    shapes = ('<mesh filename="a.stl"/>', '<mesh filename="b.stl" scale="1 -1 2"/>', '<box size="1 2 3"/>')
    visuals = "".join(f"<visual><geometry>{shape}</geometry></visual>" for shape in shapes)
    first, second, box = parse(changed('<link name="rod"/>', f'<link name="rod">{visuals}</link>')).link("rod").visuals
    assert (first.geometry.filename, first.geometry.size) == ("a.stl", (1.0, 1.0, 1.0))
    assert (second.geometry.filename, second.geometry.size) == ("b.stl", (1.0, -1.0, 2.0))
    assert (box.geometry.kind, box.geometry.size, box.geometry.filename) == ("box", (1.0, 2.0, 3.0), None)


@given(position=st.integers(0, len(LINES) - 1), character=st.sampled_from(list("<>\"'&/=0.-ex \n\x00é")))
@settings(max_examples=300, deadline=None)
def test_a_damaged_file_is_read_or_refused_by_name(position: int, character: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        try:
            description = parse(LINES[:position] + character + LINES[position + 1 :])
        except DescriptionError:
            return
    assert isinstance(description, Description)


def test_parsing_leaves_the_garbage_collector_as_it_was() -> None:
    for state in (True, False):
        (gc.enable if state else gc.disable)()
        try:
            parse(LINES)
            with pytest.raises(DescriptionError):
                parse("<robot>")
            assert gc.isenabled() is state
        finally:
            gc.enable()


@pytest.mark.slow
def test_as_many_joints_as_are_read_take_seconds_not_minutes() -> None:
    box = '<visual><geometry><box size="1 2 3"/></geometry></visual>'
    link = (
        '<link name="l{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
        + 3 * box
        + "</link>\n"
        '<joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{0}"/><axis xyz="0 0 1"/></joint>\n'
    )
    count = 5_800  # as many elements as are read
    body = "".join(link.format(n, n - 1) for n in range(1, count))
    text = f'<robot name="big"><link name="l0"/>{body}</robot>'
    start = time.process_time()
    description = parse(text)
    # 0.6 s of processor time on the slowest machine seen; the bound catches anything quadratic.
    assert time.process_time() - start < 3.0
    assert len(description.links) == count


def urdf_plus_files() -> list[object]:
    folder = MODELS / "urdf_plus"
    if not folder.is_dir():
        return [pytest.param(None, marks=pytest.mark.skip(reason=f"{folder} is absent"))]
    return [pytest.param(path, id=path.stem) for path in sorted(folder.glob("*.urdf"))]


# name: links, joints, loops, couplings, independent joints
EXPECTED = {
    "four_bar": (4, 3, 1, 0, ("joint1",)),
    "mini_cheetah_leg": (7, 6, 0, 3, ("base_to_abduct", "abduct_to_thigh_j", "thigh_to_knee_j")),
    "parallel_chain_explicit_d5_l6": (11, 10, 0, 1, None),
    "parallel_chain_implicit_d5_l5": (12, 11, 1, 0, None),
    "revolute_rotor_chain": (7, 6, 0, 3, ("joint1", "joint2", "joint3")),
    "six_bar": (6, 5, 1, 0, ("joint1", "joint2", "joint3")),
}


@pytest.mark.parametrize("path", urdf_plus_files())
def test_files_that_others_wrote(path: Path) -> None:
    text = path.read_text()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        description = read(path)
        independent = independent_joints(description)
    links, joints, loops, couplings, names = EXPECTED[path.stem]
    assert len(description.links) == links == text.count("<link ")
    assert len(description.joints) == joints == text.count("<joint ")
    assert len(description.loops) == loops == text.count("<loop ")
    assert len(description.couplings) == couplings == text.count("<coupling ")
    if names is None:
        names = tuple(joint.name for joint in description.joints if joint.independent)
        assert len(names) == joints - text.lower().count('independent="false"')
    assert independent == names
    for link, other in itertools.pairwise(description.links):
        assert link.line is not None
        assert other.line is not None
        assert link.line < other.line
        assert f'name="{link.name}"' in text.splitlines()[link.line - 1]


@pytest.mark.parametrize("name", ["5bar_linkage", "5bar_linkage_iso3d", "cassie_like", "digit_like", "robot_delta"])
def test_plain_foreign_files(name: str) -> None:
    path = MODELS / "toolbox_yaml" / name / "robot.urdf"
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        description = read(path)
    assert len(description.links) == len(description.joints) + 1 == path.read_text().count("<link ")


@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_the_triangle_inequality_is_kept_to_a_tenth_of_a_percent_and_less(scale: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parse(with_inertia(ixx=scale, iyy=scale, izz=2.0 * scale))
    for excess in (1e-3, 1e-6):
        with pytest.warns(LegDynamicsWarning, match="breaks the triangle inequality"):
            parse(with_inertia(ixx=scale, iyy=scale, izz=2.0 * scale * (1.0 + excess)))
