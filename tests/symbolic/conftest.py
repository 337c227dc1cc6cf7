"""Small URDF+ mechanisms of every loop type, states to compare at, and the evaluator that stands for the compiler."""

from __future__ import annotations

import importlib.util
import math
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import qr
from scipy.spatial.transform import Rotation

from leg_dynamics.description import link_transforms, parse
from leg_dynamics.symbolic import model
from leg_dynamics.symbolic.closure import Closure, row_arrays
from leg_dynamics.symbolic.coordinates import Coordinates, Form
from leg_dynamics.symbolic.numbers import Numbers
from leg_dynamics.symbolic.tree import build_tree, characteristic_length

SHARED_MODELS = Path(__file__).resolve().parents[2].parent / "shared" / "models" / "urdf_plus"
FOREIGN = ("four_bar", "six_bar", "mini_cheetah_leg", "parallel_chain_explicit_d5_l6", "parallel_chain_implicit_d5_l5")
FOREIGN = (*FOREIGN, "revolute_rotor_chain")
LOOP_ROWS = {"revolute": 5, "continuous": 5, "prismatic": 5, "fixed": 6, "planar": 3, "spherical": 3, "universal": 4}


def _load(name):
    spec = importlib.util.spec_from_file_location(f"symbolic_{name}", Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules[f"symbolic_{name}"] = module
    spec.loader.exec_module(module)
    return module


# Not in the search path of modules: other rooms' tests have names of their own.
evaluate, oracle, mechanisms = map(_load, ("evaluate", "oracle", "mechanisms"))


def words(values) -> str:
    return " ".join(repr(float(value)) for value in values)


def link(name: str, seed: int | None = None) -> str:
    """A body with a random, physical inertia, or a massless one."""
    if seed is None:
        return f'<link name="{name}"/>'
    generator = np.random.default_rng(seed)
    points = generator.normal(scale=0.1, size=(8, 3))
    mass = generator.uniform(0.2, 1.0)
    second = points.T @ points / 8.0
    tensor = mass * (np.trace(second) * np.eye(3) - second)
    entries = " ".join(
        f'{key}="{float(value)!r}"'
        for key, value in zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), tensor[np.triu_indices(3)], strict=True)
    )
    pose = f'<origin xyz="{words(generator.normal(scale=0.05, size=3))}" rpy="{words(generator.uniform(-1, 1, 3))}"/>'
    return f'<link name="{name}"><inertial>{pose}<mass value="{mass!r}"/><inertia {entries}/></inertial></link>'


def joint(name, kind, parent, child, axis=(0, 0, 1), xyz=(0, 0, 0), rpy=(0, 0, 0), independent=None, extra="") -> str:
    flag = "" if independent is None else f' independent="{str(independent).lower()}"'
    limit = '<limit lower="-2" upper="2" effort="100" velocity="100"/>' if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"{flag}><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{words(xyz)}" rpy="{words(rpy)}"/><axis xyz="{words(axis)}"/>{limit}{extra}</joint>'
    )


def loop(name, kind, predecessor, successor, axis=(0, 0, 1)) -> str:
    ends = "".join(
        f'<{tag} link="{body}"><origin xyz="{words(xyz)}" rpy="{words(rpy)}"/></{tag}>'
        for tag, (body, xyz, rpy) in (("predecessor", predecessor), ("successor", successor))
    )
    line = "" if axis is None else f'<axis xyz="{words(axis)}"/>'
    return f'<loop name="{name}" type="{kind}">{ends}{line}</loop>'


def configuration(values, name="home") -> str:
    inner = "".join(f'<joint name="{key}" value="{float(value)!r}"/>' for key, value in values.items())
    return f'<configuration name="{name}">{inner}</configuration>'


def robot(name, *parts) -> str:
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def motor(name, reduction=1.0, rotor_inertia=0.0) -> str:
    return (
        f'<transmission name="drive_{name}"><type>transmission_interface/SimpleTransmission</type>'
        f'<joint name="{name}"/><actuator name="M_{name}"><mechanicalReduction>{reduction!r}</mechanicalReduction>'
        f"<rotorInertia>{rotor_inertia!r}</rotorInertia></actuator></transmission>"
    )


def crank_rocker(extra="", theta=0.6, damping=0.0, friction=0.0) -> str:
    """A planar four-bar in a tilted plane: ground 0.4, crank 0.15, coupler 0.4, rocker 0.3 m."""
    pin = 0.15 * np.array([math.cos(theta), math.sin(theta)])
    reach = np.array([0.4, 0.0]) - pin
    distance = float(np.hypot(*reach))
    along = (0.4**2 - 0.3**2 + distance**2) / (2.0 * distance)
    height = math.sqrt(0.4**2 - along**2)
    u = reach / distance
    meeting = pin + along * u + height * np.array([-u[1], u[0]])
    coupler = math.atan2(*(meeting - pin)[::-1]) - theta
    rocker = math.atan2(meeting[1], meeting[0] - 0.4)
    dynamics = f'<dynamics damping="{damping!r}" friction="{friction!r}"/>' if damping or friction else ""
    return robot(
        "crank_rocker",
        link("world"),
        link("base"),
        *(link(f"{name}_link", seed) for seed, name in enumerate(("crank", "coupler", "rocker"))),
        link("foot", 7),
        joint("mount", "fixed", "world", "base", xyz=(1, -2, 0.5), rpy=(0.3, -0.5, 0.2)),
        joint("crank", "revolute", "base", "crank_link", independent=True, extra=dynamics),
        joint("coupler", "revolute", "crank_link", "coupler_link", xyz=(0.15, 0, 0), independent=False, extra=dynamics),
        joint("rocker", "continuous", "base", "rocker_link", xyz=(0.4, 0, 0), independent=False, extra=dynamics),
        joint("foot_mount", "fixed", "coupler_link", "foot", xyz=(0.2, 0.1, 0.05), rpy=(0.1, 0.2, 0.3)),
        loop("pin", "revolute", ("coupler_link", (0.4, 0, 0), (0, 0, 0)), ("rocker_link", (0.3, 0, 0), (0, 0, 0))),
        extra,
        configuration({"crank": theta, "coupler": coupler, "rocker": rocker}),
    )


def slider_crank(kind="revolute", actuated="crank") -> str:
    """A slider-crank: the slider a tree joint (loop `revolute`), or the loop itself (`prismatic`)."""
    theta, crank, rod = 0.7, 0.1, 0.3
    incline = -math.asin(crank / rod * math.sin(theta))
    parts = [
        *(link(name, seed) for seed, name in enumerate(("crank_link", "rod_link", "foot"))),
        joint("crank", "revolute", "base", "crank_link", independent=True),
        joint("rod", "revolute", "crank_link", "rod_link", xyz=(crank, 0, 0), independent=False),
    ]
    values = {"crank": theta, "rod": incline - theta}
    if kind == "prismatic":
        parts += [
            joint("wrist", "revolute", "rod_link", "foot", xyz=(rod, 0, 0), independent=False),
            loop("guide", "prismatic", ("base", (0.2, 0, 0), (0, 0, 0)), ("foot", (0, 0, 0), (0, 0, 0)), (1, 0, 0)),
        ]
        values["wrist"] = -incline
    else:
        parts += [
            joint("slide", "prismatic", "base", "foot", (1, 0, 0), xyz=(0.2, 0, 0), independent=False),
            loop("wrist", "revolute", ("rod_link", (rod, 0, 0), (0, 0, 0)), ("foot", (0, 0, 0), (0, 0, 0))),
        ]
        values["slide"] = crank * math.cos(theta) + rod * math.cos(incline) - 0.2
    drive = motor(actuated, 3.0, 1e-4)
    return robot("slider_crank", link("base"), *parts, drive, configuration(values))


def gears() -> str:
    """A gear pair, a rack that mimics with an offset, and a foot on the driven gear."""
    return robot(
        "gears",
        link("base"),
        *(link(name, seed) for seed, name in enumerate(("driver_link", "driven_link", "foot"))),
        joint("driver", "continuous", "base", "driver_link", independent=True),
        joint("driven", "revolute", "base", "driven_link", (0, 1, 0), (0.3, 0, 0), independent=False),
        joint(
            "rack",
            "prismatic",
            "driven_link",
            "foot",
            (1, 0, 0),
            (0.1, 0, 0.2),
            extra='<mimic joint="driver" multiplier="0.05" offset="0.03"/>',
        ),
        '<coupling name="mesh"><predecessor link="driver_link"/><successor link="driven_link"/>'
        '<ratio value="-2.5"/></coupling>',
        configuration({"driver": 0.4, "driven": -1.0, "rack": 0.05}),
    )


def _relative(kind, a, b, c):
    """Motion that a loop joint allows, (rotation, translation) in its aligned frame."""
    turn = Rotation.from_rotvec
    none = Rotation.identity()
    zero = np.zeros(3)
    return {
        "revolute": (turn([0, 0, a]), zero),
        "continuous": (turn([0, 0, a]), zero),
        "prismatic": (none, np.array([0, 0, 0.2 * a])),
        "fixed": (none, zero),
        "planar": (turn([0, 0, a]), np.array([0.2 * b, 0.2 * c, 0])),
        "spherical": (turn([a, b, c]), zero),
        "universal": (turn([a, 0, 0]) * turn([0, b, 0]), zero),
    }[kind]


def random_loop(kind: str, seed: int) -> str:
    """Two random branches of four joints joined by a loop that a random pose closes, well-conditioned there."""
    generator = np.random.default_rng([seed, LOOP_ROWS[kind], len(kind)])
    specs, values = [], {}
    for branch in "ab":
        parent = "base"
        for number in range(4):
            name = f"{branch}{number}"
            kind_of_joint = ("revolute", "continuous", "revolute", "prismatic")[generator.integers(4)]
            axis = generator.normal(size=3)
            specs.append(
                (
                    name,
                    kind_of_joint,
                    parent,
                    f"link_{name}",
                    axis / np.linalg.norm(axis),
                    generator.normal(scale=0.2, size=3),
                    generator.uniform(-1, 1, 3),
                )
            )
            parent = f"link_{name}"
            values[name] = generator.uniform(-0.8, 0.8) * (0.2 if kind_of_joint == "prismatic" else 1.0)
    axis = generator.normal(size=3)
    axis /= np.linalg.norm(axis)
    has_axis = kind not in ("spherical", "universal", "fixed")
    align = Rotation.align_vectors([axis], [[0, 0, 1]])[0] if has_axis else Rotation.identity()
    first = (Rotation.from_euler("xyz", generator.uniform(-1, 1, 3)), generator.normal(scale=0.1, size=3))
    turn, shift = _relative(kind, *generator.uniform(-1, 1, 3))
    moved = first[0] * align * turn * align.inv(), first[1] + (first[0] * align).apply(shift)

    def text(flags, closing) -> str:
        joints = [joint(*spec, independent=flags.get(spec[0])) for spec in specs]
        bodies = [link(spec[3], number) for number, spec in enumerate(specs)]
        return robot(f"random_{kind}", link("base"), *bodies, *joints, closing, configuration(values))

    at = link_transforms(parse(text({}, "")), values)
    one, other = at["link_a3"], at["link_b3"]
    turned = Rotation.from_matrix(other[:3, :3].T @ one[:3, :3]) * moved[0]
    place = other[:3, :3].T @ (one[:3, :3] @ moved[1] + one[:3, 3] - other[:3, 3])
    closing = loop(
        "closing",
        kind,
        ("link_a3", first[1], first[0].as_euler("xyz")),
        ("link_b3", place, turned.as_euler("xyz")),
        axis if has_axis else None,
    )
    description = parse(text({}, closing))
    names = tuple(spec[0] for spec in specs)
    every = Coordinates(names, len(names), {name: Form(((k, 1.0),)) for k, name in enumerate(names)})
    numbers = Numbers.of(description)
    tree = build_tree(description, every, numbers, None, characteristic_length(description))
    _, K = row_arrays(Closure(description, tree).basic, np.array([[values[name] for name in names]]))
    _, _, order = qr(K[0], pivoting=True)
    dependent = {names[i] for i in order[: LOOP_ROWS[kind]]}
    return text({name: name not in dependent for name in names}, closing)


def states(q0: np.ndarray, spread: np.ndarray, count: int, actuators: int, seed: int = 0) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    n = len(q0)
    return {
        "q": q0 + spread * generator.uniform(-1, 1, (count, n)),
        "v": generator.uniform(-3, 3, (count, n)),
        "a": generator.uniform(-20, 20, (count, n)),
        "tau": generator.uniform(-5, 5, (count, actuators)),
        "foot_force": generator.uniform(-50, 50, (count, 3)),
        "gravity": generator.uniform(-10, 10, (count, 3)),
    }


def quiet(function, *arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return function(*arguments, **options)


@pytest.fixture(scope="session", autouse=True)
def shared_models():
    """Models are immutable and take seconds to make: what was made once serves all tests."""
    make = model.build_model
    made: dict = {}

    def build_model(description, foot=None, hip=None, *, seed=None, parameters=(), simplify=True):
        found = None if seed is None else tuple(sorted(seed.items()))
        key = (description.urdf, foot, hip, found, tuple(parameters), simplify)
        if key not in made:
            made[key] = make(description, foot, hip, seed=seed, parameters=parameters, simplify=simplify)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model, "build_model", build_model)
        yield


@pytest.fixture(scope="session")
def lab():
    """This file's builders, the evaluator, the oracle and the random mechanisms."""
    return sys.modules[__name__]
