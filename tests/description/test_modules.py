"""Assemblies of modules: what the reader accepts, and the error for each thing that cannot be true."""

from __future__ import annotations

import copy
import itertools
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import yaml

import leg_dynamics as ld
from leg_dynamics.description import link_transforms, read, render, shipped_xacro
from leg_dynamics.description.modules import Face, Mount, read_assembly
from leg_dynamics.errors import DescriptionError, LegDynamicsError, ParameterError, RenderError

CHAIN = {
    "modules": {"a": {}, "b": {}, "c": {}},
    "bonds": [{"faces": ["a.U", "b.L"]}, {"faces": ["b.U", "c.L"], "roll": 90}],
    "root": {"face": "a.L", "base": "fixed"},
    "home": {"a_upper": 20, "b_middle": -40, "c_lower": 35},
}


def write(folder: Path, content: object, name: str = "robot.yaml") -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def changed(**changes: object) -> dict[str, object]:
    """The chain with other sections; None leaves one out."""
    content = copy.deepcopy(CHAIN) | changes
    return {name: value for name, value in content.items() if value is not None}


def ring(count: int, angle: float, **more: object) -> dict[str, object]:
    names = [f"r{i}" for i in range(count)]
    bonds: list[dict[str, object]] = [{"faces": [f"{one}.U", f"{other}.L"]} for one, other in itertools.pairwise(names)]
    bonds.append({"faces": [f"{names[-1]}.U", f"{names[0]}.L"], "ring": True})
    home = {f"{name}_{kind}": angle for name in names for kind in ("lower", "upper")}
    root = {"module": names[0], "base": "floating"}
    return {"modules": {name: {} for name in names}, "bonds": bonds, "root": root, "home": home} | more


def test_a_chain_is_read_and_grows_from_its_root(tmp_path):
    assembly = read_assembly(write(tmp_path, CHAIN))
    assert assembly.name == "robot"
    assert assembly.mounts == (
        Mount("a", "L", None, 0),
        Mount("b", "L", Face("a", "U"), 0),
        Mount("c", "L", Face("b", "U"), 90),
    )
    from_the_end = read_assembly(write(tmp_path, changed(root={"face": "c.U", "base": "fixed"})))
    assert [(mount.module, mount.face) for mount in from_the_end.mounts] == [("c", "U"), ("b", "U"), ("a", "U")]
    assert assembly.joint("b", "middle").angle == -40
    assert assembly.modules["a"].genders == {"L": "passive", "U": "active", "S": "none"}


BAD = {
    "same gender": (
        changed(bonds=[{"faces": ["a.U", "b.U"]}, {"faces": ["b.L", "c.L"]}]),
        r"robot\.yaml:6: a\.U and b\.U are both active: a bond needs an active and a passive face",
        ("a", "U"),
    ),
    "occupied by a bond": (
        changed(bonds=[{"faces": ["a.U", "b.L"]}, {"faces": ["a.U", "c.L"]}]),
        r":9: face a\.U is occupied: it holds the bond with b\.L and cannot hold the bond with c\.L",
        ("a", "U"),
    ),
    "occupied by the ground": (
        changed(modules={"a": {}, "b": {}}, bonds=[{"faces": ["b.U", "a.L"]}], home=None),
        r"face a\.L is occupied: it holds the bond with b\.U and cannot hold the ground as well",
        ("a", "L"),
    ),
    "occupied by a foot": (
        changed(feet={"foot": "b.U"}),
        r"face b\.U is occupied: it holds the bond with c\.L and cannot hold the foot 'foot'",
        ("b", "U"),
    ),
    "two feet on one face": (changed(feet={"one": "c.U", "two": "c.U"}), r"c\.U is occupied: .*'one'", ("c", "U")),
    "unknown module": (
        changed(bonds=[{"faces": ["a.U", "bb.L"]}]),
        r"names an unknown module 'bb'; did you mean 'b'\?",
        ("bb", "L"),
    ),
    "unknown face": (
        changed(bonds=[{"faces": ["a.U", "b.X"]}]),
        r"names an unknown face 'X' of module 'b': it has L, U, S",
        ("b", "X"),
    ),
    "no face at all": (
        changed(bonds=[{"faces": ["a.U", "b"]}]),
        r"must be MODULE\.FACE, such as m01\.U, got 'b'",
        None,
    ),
    "three faces": (changed(bonds=[{"faces": ["a.U", "b.L", "c.L"]}]), r"must be a list of 2, .*got a sequence", None),
    "self bond": (
        changed(bonds=[{"faces": ["a.U", "a.L"]}]),
        r"a bond joins a\.U and a\.L, two faces of one module 'a'",
        ("a", "U"),
    ),
    "missing third face": (
        changed(bonds=[{"faces": ["a.U", "b.L"]}, {"faces": ["b.S", "c.L"]}]),
        r"module 'b' has no face S, which its bond with c\.L needs: fit one with b: \{S: active\}",
        ("b", "S"),
    ),
    "foot on a missing face": (changed(feet={"foot": "c.S"}), r"'c' has no face S for the foot 'foot'", ("c", "S")),
    "root on a missing face": (
        changed(root={"face": "a.S", "base": "floating"}),
        r"'a' has no face S for the root",
        ("a", "S"),
    ),
    "disconnected": (
        changed(bonds=[{"faces": ["a.U", "b.L"]}]),
        r":4: module 'c' is disconnected from the root 'a': bond it to another module",
        ("c", None),
    ),
    "unintended ring": (
        changed(
            root={"module": "a", "base": "fixed"},
            bonds=[{"faces": ["a.U", "b.L"]}, {"faces": ["b.U", "c.L"]}, {"faces": ["c.U", "a.L"]}],
        ),
        r"the bond of c\.U and a\.L closes a ring c - b - a - c, which is not declared: say ring: true",
        ("c", "U"),
    ),
    "a ring of two": (
        changed(
            modules={"a": {}, "b": {}},
            root={"module": "a", "base": "fixed"},
            bonds=[{"faces": ["a.U", "b.L"]}, {"faces": ["b.U", "a.L"]}],
            home=None,
        ),
        r"closes a ring b - a - b",
        ("b", "U"),
    ),
    "a ring that is none": (
        changed(bonds=[{"faces": ["a.U", "b.L"]}, {"faces": ["b.U", "c.L"], "ring": True}]),
        r"'c' is disconnected from the root 'a': the bond of b\.U and c\.L closes no ring: drop its ring: true",
        ("c", "L"),
    ),
    "roll between quarters": (
        changed(bonds=[{"faces": ["a.U", "b.L"], "roll": 45}]),
        r"roll of entry 1 of bonds must be one of 0, 90, 180, 270 deg, a quarter turn, got 45",
        ("a", "U"),
    ),
    "roll as text": (
        changed(bonds=[{"faces": ["a.U", "b.L"], "roll": "half"}]),
        r"must be a number, got 'half'",
        ("a", "U"),
    ),
    "roll not finite": (
        changed(bonds=[{"faces": ["a.U", "b.L"], "roll": math.nan}]),
        r"must be a finite number",
        ("a", "U"),
    ),
    "ring neither true nor false": (
        changed(bonds=[{"faces": ["a.U", "b.L"], "ring": 1}]),
        r"must be true or false, got '1'",
        ("a", "U"),
    ),
    "unknown section": (changed(bond=[]), r"the file has an unknown key 'bond'; did you mean 'bonds'", None),
    "unknown key of a module": (
        changed(modules={"a": {"weight": 2}}),
        r"a of modules has an unknown key 'weight'",
        ("a", None),
    ),
    "unknown face of a module": (
        changed(modules={"a": {"X": "active"}}),
        r"a of modules names an unknown face 'X' of module 'a': it has L, U, S",
        ("a", "X"),
    ),
    "face not finite": (changed(modules={"a": {"U": math.nan}}), r"must be one of active, passive, none", ("a", "U")),
    "unknown key of a bond": (changed(bonds=[{"faces": ["a.U", "b.L"], "rol": 90}]), r"key 'rol'; did you mean", None),
    "no modules": (changed(modules=None), r"the file has no 'modules', which it needs", None),
    "empty modules": (changed(modules={}), r"there is no module", None),
    "no root": (changed(root=None), r"the file has no 'root'", None),
    "no base": (changed(root={"face": "a.L"}), r"root has no 'base'", None),
    "root of two kinds": (changed(root={"face": "a.L", "module": "a", "base": "fixed"}), r"either a face", None),
    "unknown root": (changed(root={"module": "d", "base": "fixed"}), r"root names an unknown module 'd'", ("d", None)),
    "unknown base": (changed(root={"face": "a.L", "base": "free"}), r"one of fixed, floating, got 'free'", None),
    "roll of a free base": (
        changed(root={"face": "a.L", "base": "floating", "roll": 90}),
        r"only where a fixed",
        ("a", "L"),
    ),
    "angles of the root not finite": (
        changed(root={"module": "a", "base": "fixed", "rpy": [0, math.nan, 0]}),
        r"entry 2 of rpy of root must be a finite number",
        ("a", None),
    ),
    "rpy of a free face": (
        changed(root={"face": "a.L", "base": "floating", "rpy": [0, 0, 1]}),
        r"is that face's frame",
        ("a", "L"),
    ),
    "unknown gender": (
        changed(modules={"a": {"U": "aktive"}}),
        r"must be one of active, passive, none, got 'aktive'; did you mean 'active'",
        ("a", "U"),
    ),
    "mass zero": (changed(modules={"a": {"mass": 0}}), r"mass of module 'a' must be positive, got 0 kg", ("a", None)),
    "mass infinite": (
        changed(modules={"a": {"mass": math.inf}}),
        r"mass of a of modules must be a finite",
        ("a", None),
    ),
    "mass as a flag": (changed(modules={"a": {"mass": True}}), r"must be a number, got 'true'", ("a", None)),
    "name with a blank": (changed(modules={"a b": {}}), r"'a b' cannot name a module", None),
    "name that xacro would run": (changed(modules={"${1/0}": {}}), r"cannot name a module", None),
    "joint name with a quote": (changed(joint_names={"x'": "a_lower"}), r"cannot name a joint", None),
    "hip named like a link": (
        changed(hips={"a_lower_half": "a.L"}),
        r"the hip at a\.L is named 'a_lower_half', which is a link of module 'a' name already",
        ("a", "L"),
    ),
    "foot named like a hip": (changed(hips={"x": "a.L"}, feet={"x": "c.U"}), r"foot at c\.U is named 'x'", ("c", "U")),
    "hip on the far side": (
        changed(hips={"hip": "b.U"}),
        r"hip 'hip' is at b\.U, but the base holds module 'b' by its face L",
        ("b", "U"),
    ),
    "hip where nothing is": (
        changed(root={"face": "a.L", "base": "floating"}, hips={"hip": "a.L"}),
        r"hip 'hip' is at a\.L, but nothing holds it there",
        ("a", "L"),
    ),
    "hip without a swing": (changed(hips={"hip": "a.S"}), r"'hip' is at a\.S, which has no swing", ("a", "S")),
    "two hips": (changed(hips={"x": "a.L", "y": "a.L"}), r"hips 'x' and 'y' are at one face a\.L", ("a", "L")),
    "two joints of one name": (
        changed(joint_names={"b_lower": "a_lower"}),
        r"joints 'a_lower' and 'b_lower' are both named 'b_lower'",
        None,
    ),
    "two names of one joint": (
        changed(joint_names={"x": "a_lower", "y": "a_lower"}),
        r"joint 'a_lower' has two names, 'x' and 'y'",
        ("a", None),
    ),
    "unknown joint renamed": (
        changed(joint_names={"x": "a_low"}),
        r"unknown joint 'a_low'; did you mean",
        ("a", None),
    ),
    "unknown joint at home": (
        changed(home={"a_uper": 1}),
        r"home names an unknown joint 'a_uper'; did you mean",
        ("a", None),
    ),
    "angle at home not finite": (
        changed(home={"a_upper": math.nan}),
        r"a_upper of home must be a finite number",
        ("a", None),
    ),
    "angle of a renamed joint not finite": (
        changed(joint_names={"x": "a_upper"}, home={"x": math.nan}),
        r"x of home \(of module 'a'\) must be a finite number",
        ("a", None),
    ),
    "frozen angle not finite": (changed(frozen={"c_upper": math.inf}), r"must be a finite number", ("c", None)),
    "limit not finite": (
        changed(limits={"b_upper": [math.nan, 30]}),
        r"entry 1 of b_upper of limits must be a finite number",
        ("b", None),
    ),
    "renamed joint at home": (
        changed(joint_names={"x": "a_upper"}),
        r"home names an unknown joint 'a_upper'; it is named 'x' here",
        ("a", None),
    ),
    "frozen and at home": (changed(frozen={"a_upper": 0}), r"'a_upper' is in frozen and in home", ("a", None)),
    "limits the wrong way": (
        changed(limits={"a_upper": [30, -30]}),
        r"a joint of module 'a': 30 deg must be below -30 deg",
        ("a", None),
    ),
    "modules as a list": (changed(modules=["a", "b"]), r"modules must be a mapping, .* got a sequence", None),
    "bonds as text": (changed(bonds="a.U-b.L"), r"bonds must be a list, .* got 'a\.U-b\.L'", None),
    "a list as the file": ([], r"the file must be a mapping", None),
    "nothing": ("", r"the file is empty", None),
    "module named twice": ("modules:\n  a: {}\n  a: {}\nroot: {module: a, base: fixed}\n", r":3: .*'a' twice", None),
    "malformed": ("modules: {a: {}\n", r"malformed YAML", None),
    "python tag": (
        "modules: {a: {mass: !!python/object/apply:os.getcwd []}}\nroot: {module: a, base: fixed}\n",
        r"mass of a of modules must be one value",
        None,
    ),
    "python name": (
        "modules: {a: {mass: !!python/name:os.getcwd x}}\nroot: {module: a, base: fixed}\n",
        r"mass of a of modules is not readable",
        None,
    ),
    "number as text": (
        "modules: {a: {mass: 1e-3}}\nroot: {module: a, base: fixed}\n",
        r"YAML reads 1e-3 as text, write 1\.0e-3",
        None,
    ),
    "deep": ("[" * 5000, r"nested too deep|malformed YAML", None),
}


@pytest.mark.parametrize(("content", "message", "place"), BAD.values(), ids=BAD)
def test_what_cannot_be_true_has_its_error(tmp_path, content, message, place):
    path = write(tmp_path, content)
    with pytest.raises(DescriptionError, match=message) as caught:
        read_assembly(path)
    assert caught.value.file == str(path)
    if place is not None:
        assert (caught.value.evidence["module"], caught.value.evidence.get("face")) == place
        assert place[0] in str(caught.value)


def test_every_reader_gives_the_same_error(tmp_path):
    path = write(tmp_path, BAD["same gender"][0])
    for use in (read, render, ld.load):
        with pytest.raises(DescriptionError, match=r"a\.U and b\.U are both active"):
            use(path)


def test_a_file_name_that_could_run_code_is_refused(tmp_path):
    with pytest.raises(DescriptionError, match="cannot name a robot"):
        render(write(tmp_path, CHAIN, "${1}.yaml"))
    assert ET.fromstring(render(write(tmp_path, CHAIN, "my-robot.2.yaml"))).get("name") == "my-robot.2"


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"home": {"b_lower": 71}}, r"joint 'b_lower' of module 'b' is at home at 71 deg, 1 deg beyond its limits -70"),
        ({"frozen": {"b_lower": -80}}, r"'b_lower' of module 'b' is frozen at -80 deg, 10 deg beyond"),
        ({"limits": {"a_upper": [-10, 10]}}, r"'a_upper' .* at 20 deg, 10 deg beyond its limits -10 \.\.\. 10 deg"),
    ],
)
def test_home_and_frozen_angles_are_within_the_limits(tmp_path, sections, message):
    with pytest.raises(DescriptionError, match=message):
        render(write(tmp_path, changed(**sections)))


def test_limits_and_frozen_joints_reach_the_file(tmp_path):
    sections = {
        "limits": {"a_middle": [-90, 45], "c_upper": [-10, 20]},
        "frozen": {"c_middle": 30},
        "joint_names": {"knee": "b_lower"},
    }
    mechanism = read(write(tmp_path, changed(**sections)))
    bounds = mechanism.joint("a_middle").limits
    assert mechanism.joint("a_middle").type == "revolute"
    assert np.degrees((bounds.lower, bounds.upper)) == pytest.approx((-90, 45))
    assert np.degrees(mechanism.joint("c_upper").limits.upper) == pytest.approx(20)
    assert mechanism.joint("c_middle").type == "fixed"
    assert mechanism.joint("b_middle").type == "continuous"
    assert mechanism.joint("knee").parent == "b_lower_bracket"
    assert "c_middle" not in mechanism.home.values
    assert mechanism.home.values["b_middle"] == math.radians(-40)


def test_masses_of_a_module_and_of_all(tmp_path):
    path = write(tmp_path, changed(modules={"a": {"mass": 2.0}, "b": {}, "c": {"S": "passive"}}, feet={"foot": "c.U"}))

    def mass(mechanism, name):
        return sum(
            link.inertial.mass for link in mechanism.links if link.inertial is not None and link.name.startswith(name)
        )

    mechanism = read(path)
    assert [mass(mechanism, f"{name}_") for name in "abc"] == pytest.approx([2.0, 1.2, 1.2])
    assert mass(mechanism, "foot") == pytest.approx(0.05)
    mechanism = read(path, parameters={"module_mass": 1.5, "side_face_mass": 0.1, "foot_mass": 0})
    assert [mass(mechanism, f"{name}_") for name in "abc"] == pytest.approx([2.0, 1.5, 1.6])
    assert mechanism.link("foot").inertial is None


def test_the_whole_module_is_a_homogeneous_box(tmp_path):
    path = write(tmp_path, {"modules": {"a": {}}, "root": {"module": "a", "base": "floating"}})
    for sizes in ({}, {"f": 0.03, "s": 0.09}, {"f": 0.055, "s": 0.04}):
        mechanism = read(path, parameters=sizes)
        places = link_transforms(mechanism, {})
        total, moment, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
        for link in mechanism.links:
            if link.inertial is not None:
                pose = places[link.name]
                centre = pose[:3, :3] @ link.inertial.origin.xyz + pose[:3, 3]
                total, moment = total + link.inertial.mass, moment + link.inertial.mass * centre
                steiner = link.inertial.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
                inertia += pose[:3, :3] @ link.inertial.tensor() @ pose[:3, :3].T + steiner
        box = 1.2 / 12 * np.diag([2 * 0.11**2, 0.15**2 + 0.11**2, 0.15**2 + 0.11**2])
        assert total == pytest.approx(1.2)
        np.testing.assert_allclose(moment, 0.0, atol=1e-15)
        np.testing.assert_allclose(inertia, box, atol=1e-15)


# ------------------------------------------------------------------ geometry


def rotation(axis: str, angle: float) -> np.ndarray:
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turn = np.eye(4)
    turn[i, i] = turn[j, j] = math.cos(angle)
    turn[i, j], turn[j, i] = -math.sin(angle), math.sin(angle)
    return turn


def shift(x: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x
    return pose


def module_transform(lower: float, middle: float, upper: float, f: float = 0.0375, s: float = 0.075) -> np.ndarray:
    """From the face L, x inwards, to the face U, x outwards."""
    half = shift(s / 2)
    first = shift(f) @ rotation("z", lower) @ half @ rotation("x", middle)
    return first @ half @ rotation("z", upper) @ shift(f)


def inwards(pose: np.ndarray) -> np.ndarray:
    return pose @ rotation("z", math.pi)


@pytest.mark.parametrize("root", ["a.L", "c.U"])
def test_a_chain_is_the_product_of_its_modules_from_either_end(tmp_path, root):
    mechanism = read(write(tmp_path, changed(root={"face": root, "base": "fixed"})))
    values = dict(zip((j.name for j in mechanism.moving_joints), np.linspace(-1.1, 1.2, 9), strict=True))
    places = link_transforms(mechanism, values)
    expected = np.eye(4)
    for name, roll in (("a", 0.0), ("b", 90.0), ("c", 0.0)):
        joints = [values[f"{name}_{kind}"] for kind in ("lower", "middle", "upper")]
        expected = expected @ module_transform(*joints) @ rotation("x", math.radians(roll))
    found = np.linalg.inv(inwards(places["a_face_L"])) @ places["c_face_U"]
    np.testing.assert_allclose(found, expected, atol=1e-15)
    ground = places["ground_face"]
    held = places[root.replace(".", "_face_")]
    np.testing.assert_allclose(np.linalg.inv(ground) @ held, rotation("z", math.pi), atol=1e-15)


@pytest.mark.parametrize("roll", [0, 90, 180, 270])
@pytest.mark.parametrize("faces", [("U", "L"), ("U", "U"), ("L", "L"), ("U", "S"), ("S", "L"), ("S", "S"), ("L", "U")])
@pytest.mark.parametrize("turned", [False, True])
def test_bonded_faces_are_opposite_and_turned_by_the_roll(tmp_path, faces, roll, turned):
    names = [f"{module}.{face}" for module, face in zip("ab", faces, strict=True)]
    content = {
        "modules": {"a": dict.fromkeys("LUS", "active"), "b": dict.fromkeys("LUS", "passive")},
        "bonds": [{"faces": names[::-1] if turned else names, "roll": roll}],
        "root": {"module": "a", "base": "floating"},
        "home": {f"{module}_{kind}": angle for module, angle in (("a", 33), ("b", -21)) for kind in ("lower", "upper")},
    }
    mechanism = read(write(tmp_path, content))
    places = link_transforms(mechanism, dict(mechanism.home.values))
    first, second = (places[name.replace(".", "_face_")] for name in names)
    bond = rotation("x", math.radians(roll)) @ rotation("z", math.pi)
    np.testing.assert_allclose(np.linalg.inv(first) @ second, bond, atol=1e-14)


def test_faces_stand_where_the_module_says(tmp_path):
    content = {"modules": {"a": {"S": "active"}}, "root": {"module": "a", "base": "floating"}}
    places = link_transforms(read(write(tmp_path, content)), {})
    for face, place, normal in (("L", (-0.075, 0, 0), (-1, 0, 0)), ("U", (0.075, 0, 0), (1, 0, 0))):
        np.testing.assert_allclose(places[f"a_face_{face}"][:3, 3], place, atol=1e-16)
        np.testing.assert_allclose(places[f"a_face_{face}"][:3, 0], normal, atol=1e-15)
    np.testing.assert_allclose(places["a_face_S"][:3, 3], (0, 0.055, 0), atol=1e-16)
    np.testing.assert_allclose(places["a_face_S"][:3, 0], (0, 1, 0), atol=1e-15)
    for face in "LUS":
        np.testing.assert_allclose(places[f"a_face_{face}"][:3, 2], (0, 0, 1), atol=1e-15)


@pytest.mark.parametrize("face", ["L", "U", "S"])
def test_a_free_base_at_a_face_is_that_faces_frame(tmp_path, face):
    content = {"modules": {"a": {"S": "active"}}, "root": {"face": f"a.{face}", "base": "floating"}}
    places = link_transforms(read(write(tmp_path, content)), {})
    np.testing.assert_allclose(places[f"a_face_{face}"], np.eye(4), atol=1e-15)


def test_the_base_in_a_modules_middle_turns_it(tmp_path):
    content = {"modules": {"a": {}}, "root": {"module": "a", "base": "fixed", "rpy": [20, -35, 140]}}
    places = link_transforms(read(write(tmp_path, content)), {})
    turn = rotation("z", math.radians(140)) @ rotation("y", math.radians(-35)) @ rotation("x", math.radians(20))
    np.testing.assert_allclose(places["a_face_U"], turn @ shift(0.075), atol=1e-15)


def test_hips_look_into_the_module_with_the_swing_positive_about_z(tmp_path):
    for side, swing in (("L", "lower"), ("U", "upper")):
        content = {
            "modules": {"a": {}},
            "root": {"face": f"a.{side}", "base": "fixed", "roll": 90},
            "hips": {"hip": f"a.{side}"},
        }
        mechanism = read(write(tmp_path, content))
        far = "a_face_U" if side == "L" else "a_face_L"
        straight, bent = (link_transforms(mechanism, {f"a_{swing}": angle}) for angle in (0.0, 0.3))
        into_hip = np.linalg.inv(straight["hip"])
        np.testing.assert_allclose((into_hip @ straight[far])[:3, 3], (0.1125, 0, 0), atol=1e-15)
        expected = 0.1125 * np.array([math.cos(0.3), math.sin(0.3), 0.0])
        np.testing.assert_allclose((into_hip @ bent[far])[:3, 3], expected, atol=1e-15)


# ------------------------------------------------------------------ parameters


def test_parameters_are_those_of_the_module_and_the_switches(tmp_path):
    leg = ld.load(write(tmp_path, CHAIN))
    assert leg.parameters["module_mass"].value == 1.2
    assert leg.parameters["freeze_b_middle"].value == 0
    assert "floating_joint" not in leg.parameters
    frozen = leg.replace(freeze_b_middle=1, module_mass=2)
    assert len(frozen.joint_names) == len(leg.joint_names) - 1
    assert "b_middle" not in frozen.joint_names
    assert sum(link.inertial.mass for link in frozen.description.links if link.inertial) == pytest.approx(6)
    assert "b_middle" in frozen.replace(frozen=0).joint_names
    origin = frozen.description.joint("b_middle").origin
    np.testing.assert_allclose(origin.rpy, (math.radians(-40), 0, 0))


def test_an_assembly_has_its_own_values(tmp_path):
    path = write(tmp_path, changed(parameters={"module_mass": 0.7, "freeze_a_lower": 1}))
    mechanism = read(path)
    assert mechanism.parameters["module_mass"].value == 0.7
    assert mechanism.joint("a_lower").type == "fixed"
    assert read(path, parameters={"module_mass": 0.8}).parameters["module_mass"].value == 0.8


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"f": 0.05},
            r"length 0\.15 m has 2 f \+ s = 0\.175 m, 0\.025 m too much: set f = 0\.05 together with s = 0\.05,",
        ),
        ({"s": 0.07}, r"0\.005 m too little"),
        ({"f": 0.08, "s": -0.01}, r"s must be positive, got -0\.01 m"),
        ({"module_mass": 0}, r"module_mass must be positive"),
        ({"module_mas": 1}, r"no parameter 'module_mas'; did you mean 'module_mass'"),
        ({"frozen": 0.5}, r"frozen must be 0 or 1, got 0\.5"),
        ({"freeze_a_lower": 2}, r"freeze_a_lower must be 0 or 1"),
        ({"freeze_a_low": 1}, r"no parameter 'freeze_a_low'; did you mean 'freeze_a_lower'"),
        ({"width": math.nan}, r"'width' must be a finite number"),
        ({"width": 10**400}, r"'width' must be a finite number"),
        ({"width": True}, r"'width' must be a finite number"),
        ({"floating_joint": 1}, r"no parameter 'floating_joint'"),
    ],
)
def test_a_wrong_parameter_has_its_error(tmp_path, values, message):
    with pytest.raises(ParameterError, match=message):
        render(write(tmp_path, CHAIN), values)


def test_a_wrong_parameter_of_the_file_names_the_file(tmp_path):
    path = write(tmp_path, changed(parameters={"mass": 1}))
    with pytest.raises(ParameterError, match=r"robot\.yaml: there is no parameter 'mass'"):
        render(path)


def test_what_xacro_cannot_render_points_at_the_assembly(tmp_path):
    with pytest.raises(RenderError) as caught:
        render(write(tmp_path, CHAIN), {"width": 1e200})
    assert str(tmp_path) in str(caught.value)
    assert "assembly.xacro" not in str(caught.value)


def test_rendering_is_deterministic_and_knows_no_place(tmp_path, monkeypatch):
    first = render(write(tmp_path, CHAIN))
    elsewhere = tmp_path / "else where [x]$y"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert render(write(elsewhere, CHAIN).name) == first
    assert str(tmp_path) not in first


# ------------------------------------------------------------------ rings


@pytest.mark.parametrize("count", [4, 6, 10])
def test_a_declared_ring_closes_and_has_its_mobility(tmp_path, count):
    leg = ld.load(write(tmp_path, ring(count, 180 / count)))
    assert [loop.type for loop in leg.description.loops] == ["fixed"]
    report = leg.mobility_report(samples=3)
    assert (report.mobility, report.gruebler, report.redundant) == (3 * count - 6, 3 * count - 6, 0)
    assert report.poses[0].residual < 1e-10
    assert len(leg.joint_names) == 3 * count - 6


def test_a_ring_whose_middles_are_frozen_is_planar(tmp_path):
    middles = {f"freeze_r{i}_middle": 1 for i in range(6)}
    leg = ld.load(write(tmp_path, ring(6, 30)), parameters=middles)
    report = leg.mobility_report(samples=3)
    assert (report.mobility, report.gruebler, report.redundant) == (9, 6, 3)
    assert len(leg.joint_names) == 9


def test_two_rings_that_share_modules(tmp_path):
    """A square of four modules on each side of a middle pair is too tight; two hexagons share their third faces."""
    content = ring(6, 30)
    content["modules"] |= {name: {"S": "active"} for name in ("r0", "r1")}  # type: ignore[operator]
    two = [f"t{i}" for i in range(6)]
    content["modules"] |= {name: {} for name in two} | {name: {"S": "passive"} for name in ("t0", "t1")}  # type: ignore[operator]
    more = [{"faces": [f"{one}.U", f"{other}.L"]} for one, other in itertools.pairwise(two)]
    content["bonds"] += [*more, {"faces": ["t5.U", "t0.L"], "ring": True}, {"faces": ["r0.S", "t0.S"]}]  # type: ignore[operator]
    content["home"] |= {f"{name}_{kind}": 30 for name in two for kind in ("lower", "upper")}  # type: ignore[operator]
    leg = ld.load(write(tmp_path, content))
    report = leg.mobility_report(samples=2)
    assert (report.mobility, report.redundant) == (36 - 12, 0)
    assert report.poses[0].residual < 1e-10


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"home": {"r0_lower": 45}},
            r"r0\.L is [\d.]+ mm and [\d.]+ deg away from where its bond with r5\.U at roll 0",
        ),
        ({"roll": 90}, r"r0\.L is .* mm and 90 deg away .* at roll 90"),
        ({"home": {"r0_lower": 30.001}}, r"the ring does not close at home"),
    ],
)
def test_a_ring_that_stays_open_at_home_says_by_how_much(tmp_path, change, message):
    content = ring(6, 30)
    content["home"] |= change.get("home", {})  # type: ignore[operator]
    if "roll" in change:
        content["bonds"][-1]["roll"] = change["roll"]  # type: ignore[index]
    with pytest.raises(DescriptionError, match=message) as caught:
        render(write(tmp_path, content))
    assert (caught.value.evidence["module"], caught.value.evidence["face"]) == ("r0", "L")
    assert isinstance(caught.value, LegDynamicsError)


def test_home_angles_of_seven_decimals_close_a_ring(tmp_path):
    leg = ld.load(write(tmp_path, ring(7, round(180 / 7, 7))))
    assert leg.mobility_report(samples=0).poses[0].residual < 1e-10


def test_the_closing_bond_may_be_any(tmp_path):
    content = ring(6, 30)
    content["bonds"][-1].pop("ring")  # type: ignore[index]
    content["bonds"][2]["ring"] = True  # type: ignore[index]
    leg = ld.load(write(tmp_path, content))
    (loop,) = leg.description.loops
    assert (loop.predecessor.link, loop.successor.link) == ("r2_face_U", "r3_face_L")
    assert leg.mobility_report(samples=0).poses[0].residual < 1e-10


def test_every_shipped_assembly_says_where_its_numbers_come_from():
    for name in ("quadruped_leg", "quadruped_leg_reversed", "quadruped", "snake", "ring"):
        path = shipped_xacro(name)
        assert path.parent.name == "assemblies"
        assert path.read_text(encoding="utf-8").startswith("# ")
        assert read_assembly(path).name == name
