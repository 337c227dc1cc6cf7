"""Every fix that is offered is applied, and does what it says."""

from __future__ import annotations

import re
import warnings

import pytest
import yaml

from leg_dynamics.description import read
from leg_dynamics.description.fixes import fixes_of
from leg_dynamics.errors import LegDynamicsWarning
from leg_dynamics.inspection import inspect

from ..five_bar import five_bar
from .test_toolbox import BODY, URDF, joint

pytestmark = pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")

# A foot on a universal ankle, which two cranks move by rods; the URDF file has a hinge for each universal joint.
ANKLE = (
    '<robot name="ankle">\n'
    + "\n".join(f'<link name="{name}">{BODY}</link>' for name in ("base", "sole", "c0", "r0", "c1", "r1"))
    + "".join(f'<link name="{name}"/>' for name in ("e0", "f0", "e1", "f1"))
    + joint("ankle", "base", "sole", "0 0 0.1")
    + joint("crank0", "base", "c0", "-0.05 0.05 0.35").replace("0 0 1", "0 1 0")
    + joint("rod0", "c0", "r0", "-0.05 0 0.01")
    + joint("end0", "r0", "e0", "0.01 -0.01 -0.28", "fixed")
    + joint("lug0", "sole", "f0", "-0.09 0.04 -0.02", "fixed")
    + joint("crank1", "base", "c1", "-0.05 -0.05 0.35").replace("0 0 1", "0 1 0")
    + joint("rod1", "c1", "r1", "-0.05 0 0.01")
    + joint("end1", "r1", "e1", "0.01 0.01 -0.28", "fixed")
    + joint("lug1", "sole", "f1", "-0.09 -0.04 -0.02", "fixed")
    + "</robot>\n"
)
# Two parallel slides carry one beam.
GANTRY = (
    '<robot name="gantry">\n'
    + "\n".join(f'<link name="{name}">{BODY}</link>' for name in ("base", "a", "b"))
    + "".join(f'<link name="{name}"/>' for name in ("beam_a", "beam_b"))
    + joint("slide_a", "base", "a", kind="prismatic")
    + joint("slide_b", "base", "b", "1 0 0", "prismatic")
    + joint("half_a", "a", "beam_a", "0.5 0 0", "fixed")
    + joint("half_b", "b", "beam_b", "-0.5 0 0", "fixed")
    + "</robot>\n"
)
LOOPS = {"closed_loop": [["e0", "f0"], ["e1", "f1"]], "type": ["3d", "3d"]}
CASES = {
    "no motors": (URDF, {"closed_loop": [["end_b", "end_d"]], "type": ["3d"]}),
    "part of a name": (URDF.replace("free_left", "yes"), {"closed_loop": [["end_b", "end_d"]], "type": ["3d"]}),
    "whole frames": (URDF, {"closed_loop": [["end_b", "end_d"]], "name_mot": ["mot_left", "mot_right"]}),
    "a type with fewer rows": (GANTRY, {"closed_loop": [["beam_a", "beam_b"]], "name_mot": ["slide_b"]}),
    "the same twice": (URDF, {"closed_loop": [["end_b", "end_d"], ["end_d", "end_b"]], "type": ["3d", "3d"]}),
    "universal": (
        ANKLE,
        LOOPS | {"name_mot": "crank", "joint_name": ["ankle", "rod0", "rod1"], "joint_type": ["UJOINT_xy"] * 3},
    ),
    "spherical and fixed": (
        ANKLE,
        {"closed_loop": [["e0", "f0"]], "name_mot": ["crank0"]}
        | {"type": ["3d"], "joint_name": ["rod0", "rod1", "crank1"], "joint_type": ["SPHERICAL", "FIXED", "FIXED"]},
    ),
    "no motors, spherical": (ANKLE, LOOPS | {"joint_name": ["ankle", "rod0", "rod1"], "joint_type": ["SPHERICAL"] * 3}),
}


def applied(fix, sidecar):
    """The YAML file with what a fix says about it."""
    entries = dict(sidecar)
    text = fix.removeprefix("in robot.yaml: ")
    assert text != fix
    if (deleted := re.match(r"delete entry (\d+) of closed_loop, and of type where that is given", text)) is not None:
        for key in ("closed_loop", "type"):
            if key in entries:
                entries[key] = [each for k, each in enumerate(entries[key], 1) if k != int(deleted[1])]
        return entries
    return entries | yaml.safe_load(text.partition(" leaves the same motion")[0])


@pytest.mark.parametrize("case", CASES)
def test_every_fix_for_a_urdf_with_its_yaml_file_works_when_applied(case, tmp_path):
    urdf, sidecar = CASES[case]
    path = tmp_path / "robot.urdf"
    path.write_text(urdf)

    def look(entries):
        path.with_suffix(".yaml").write_text(yaml.safe_dump(entries))
        return inspect(path, samples=3)

    before = look(sidecar)
    assert before.passed
    links = set(re.findall('<link name="([^"]+)"', urdf))
    tried = set()
    for each in before.findings:
        assert not re.search("<loop|<transmission|<configuration|<key|independent=", each.fix), each
        if each.code == "massless-links":
            named = re.search("no mass: (.*);", each.text)[1].split(", ")
            assert set(named) <= links
        if not each.fix.startswith("in robot.yaml: "):
            continue
        after = look(applied(each.fix, sidecar))
        assert after.passed, (each, after.errors)
        assert after.mobility.mobility == before.mobility.mobility
        assert (each.code, each.text) not in {(other.code, other.text) for other in after.findings}
        tried.add(each.code)
    assert {"no-home", "reading"} <= tried
    assert ("no-transmissions" in tried) == ("name_mot" not in sidecar)
    assert ("redundant-loop-rows" in tried) == (case in ("a type with fewer rows", "the same twice"))
    # All of them together leave nothing to say.
    entries = dict(sidecar)
    for each in before.findings:
        if each.fix.startswith("in robot.yaml: ") and each.code in ("no-home", "reading", "no-transmissions"):
            entries = applied(each.fix, entries)
    with warnings.catch_warnings():
        warnings.simplefilter("error", LegDynamicsWarning)
        after = look(entries)
    assert not {"no-home", "reading", "no-transmissions"} & {each.code for each in after.findings}
    assert after.leg.joint_names == before.leg.joint_names
    assert after.leg.actuator_names == before.leg.actuator_names or "name_mot" not in sidecar


def test_a_spherical_loop_keeps_the_types_of_the_others(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(URDF)
    path.with_suffix(".yaml").write_text("closed_loop: [[end_b, end_d], [a, c]]\ntype: [6d, 6d]\n")
    assert fixes_of(read(path)).spherical("loop_1") == "in robot.yaml: type: [3d, 6d] leaves the same motion"


def test_names_and_numbers_that_yaml_would_read_otherwise(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(URDF)
    path.with_suffix(".yaml").write_text("closed_loop: [[end_b, end_d]]\ntype: [3d]\n")
    values = {"on": 1e-09, "a: b": -2.5e20, "12": 1.0, "plain_1": 0.25, "\u00e4#": 1.5e-7}
    text = fixes_of(read(path)).home(values).removeprefix("in robot.yaml: ")
    assert yaml.safe_load(text) == {"home": values}


def test_flags_name_the_files_own_joints():
    text = five_bar().replace('independent="true"', "").replace('independent="false"', "")
    floating = text.replace("</robot>", '<link name="w"/><joint name="root" type="floating"><parent link="w"/>'
                            f'<child link="{read(text).root}"/></joint></robot>')  # fmt: skip
    fixes = fixes_of(read(floating))
    whole = [f"root_{each}" for each in ("x", "y", "z", "yaw", "pitch", "roll")]
    assert fixes.flags(["ma", *whole]).startswith('state independent="true" for ma, root and independent="false" for ')
    assert "of root only some coordinates are independent" in fixes.flags(["ma", "root_x"])
