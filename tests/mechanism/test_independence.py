"""Independent joints chosen where a file names none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse, read
from leg_dynamics.description.flags import states_flags, with_independent
from leg_dynamics.errors import LegDynamicsWarning
from leg_dynamics.mechanism.independence import independent_set

MODELS = Path(__file__).parents[3] / "shared" / "models" / "toolbox_yaml"

BODY = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def four_bar(motors=(), flags=""):
    def joint(name, parent, child, x):
        return (
            f'<joint name="{name}" type="continuous"{flags}><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/></joint>'
        )

    links = "".join(f'<link name="{name}">{BODY}</link>' for name in ("base", "a", "b", "c"))
    driven = "".join(
        f'<transmission name="t_{name}"><joint name="{name}"/><actuator name="m_{name}"/></transmission>'
        for name in motors
    )
    return (
        f'<robot name="four_bar">{links}{joint("one", "base", "a", 0)}{joint("two", "a", "b", 1)}'
        f"{joint('three', 'base', 'c', 2)}"
        '<loop name="l" type="revolute"><predecessor link="b"><origin xyz="2 0 0"/></predecessor>'
        '<successor link="c"><origin xyz="1.5 0 0"/></successor><axis xyz="0 0 1"/></loop>'
        f"{driven}</robot>"
    )


@pytest.mark.parametrize("motor", ["one", "two", "three"])
def test_the_driven_joint_is_independent(motor):
    assert independent_set(parse(four_bar([motor]))) == (motor,)


def test_more_motors_than_motions_share_the_independent_joints():
    (name,) = independent_set(parse(four_bar(["one", "three"])))
    assert name in ("one", "three")


def test_without_motors_one_joint_is_chosen_and_the_same_each_time():
    first = independent_set(parse(four_bar()))
    assert len(first) == 1
    assert independent_set(parse(four_bar())) == first


def test_flags_that_fit_stay():
    described = with_independent(parse(four_bar()), ["three"])
    assert states_flags(described)
    assert [joint.name for joint in described.joints if joint.independent] == ["three"]
    assert independent_set(described) is None


def test_loading_says_what_was_chosen():
    with pytest.warns(LegDynamicsWarning, match=r"leave 1 motion: taking three as independent; state the flags"):
        leg = ld.load(four_bar(["three"]))
    assert leg.joint_names == ("three",)
    assert leg.actuator_names == ("m_three",)


def test_stated_flags_that_fit_are_not_changed(recwarn):
    text = four_bar(["three"])
    for name in ("two", "three"):
        text = text.replace(f'name="{name}" type', f'name="{name}" independent="false" type')
    assert ld.load(text).joint_names == ("one",)
    assert not [each for each in recwarn if "independent" in str(each.message)]


@pytest.mark.parametrize(
    ("stated", "kept"),
    [
        ({"one": "false"}, ("three",)),  # two and three would be two motions; three is driven
        ({"one": "false", "two": "True"}, ("two",)),  # what is stated goes before what is driven
        ({"one": "false", "two": "false", "three": "false"}, ("three",)),
    ],
)
@pytest.mark.filterwarnings("ignore:.*gives no configuration")
def test_stated_flags_that_do_not_fit_are_corrected_with_a_warning(stated, kept):
    text = four_bar(["three"])
    for name, value in stated.items():
        text = text.replace(f'name="{name}" type', f'name="{name}" independent="{value}" type')
    with pytest.warns(LegDynamicsWarning, match=r"stated as independent, .*, do not fit, .*1 motion: taking"):
        leg = ld.load(text)
    assert leg.joint_names == kept
    assert np.isfinite(leg.generalized_force(leg.home, [0.0], [0.0])).all()


@pytest.mark.skipif(not MODELS.is_dir(), reason="the models of others are not there")
@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
@pytest.mark.parametrize(
    ("name", "mobility", "motors"),
    [
        ("5bar_linkage", 3, 2),
        ("5bar_linkage_iso3d", 2, 2),
        ("cassie_like", 7, 5),
        ("robot_delta", 5, 2),
        ("digit_like", 9, 6),
    ],
)
def test_models_of_others(name, mobility, motors):
    leg = ld.load(MODELS / name / "robot.urdf")
    assert leg.mobility_report(samples=2).mobility == mobility == len(leg.joint_names)
    assert len(leg.actuator_names) == motors
    assert {each.joint for each in read(MODELS / name / "robot.urdf").transmissions} <= set(leg.joint_names)
    seed = leg._route.mechanism.seeds[0]
    y = seed.y + 0.01 * np.random.default_rng(0).standard_normal(mobility)
    zero = np.zeros(mobility)
    assert np.isfinite(leg.generalized_force(y, zero, zero)).all()
