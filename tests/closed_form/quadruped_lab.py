"""Quadruped legs to test with: two modules as URDF+ text, frozen joints being fixed ones, and random ones."""

from __future__ import annotations

import numpy as np

from leg_dynamics.closed_form import quadruped_leg as quadruped
from leg_dynamics.description import parse
from leg_dynamics.routes import Recipe

LIMIT = 1.2217304763960306
"""70 deg."""
HALF_TURN, QUARTER_TURN = 3.141592653589793, 1.5707963267948966


def inertial(mass, com, tensor):
    entries = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), tensor, strict=True)
    inertia = " ".join(f'{name}="{value}"' for name, value in entries)
    return (
        f'<inertial><origin xyz="{com[0]} {com[1]} {com[2]}" rpy="0.3 -0.2 0.5"/><mass value="{mass}"/>'
        f"<inertia {inertia}/></inertial>"
    )


def link(name, number):
    """A link with a mass, an off-centre centre of mass and a full tensor of its own."""
    com = (0.01 + 0.003 * number, 0.004 - 0.001 * number, -0.002 * number)
    tensor = (4e-4 + 1e-5 * number, 6e-4, 7e-4 - 1e-5 * number, 3e-5, -2e-5, 1e-5 * number)
    return f'<link name="{name}">{inertial(0.3 + 0.05 * number, com, tensor)}</link>'


def fixed(name, parent, child, xyz, rpy="0 0 0"):
    return (
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>'
    )


def swing(name, parent, child, xyz, rpy, axis, losses):
    return (
        f'<joint name="{name}" type="revolute" independent="true"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        f'<limit lower="{-LIMIT}" upper="{LIMIT}" effort="10" velocity="3"/>{losses}</joint>'
    )


def leg_text(l1=0.075, l2=0.075, l3=0.140, foot=0.0275, losses=True):
    """URDF+ text: frames of the links are turned, and moved along their joints' axes, as far as the formulas allow."""
    half = 0.5 * l2
    shank = l3 - foot - half
    loss = '<dynamics damping="0.05" friction="0.02"/>' if losses else ""
    drives = "".join(
        f'<transmission name="{name}_drive"><type>transmission_interface/SimpleTransmission</type>'
        f'<joint name="{name}"/><actuator name="{name}_motor"><mechanicalReduction>{ratio}</mechanicalReduction>'
        f"<rotorInertia>{inertia}</rotorInertia></actuator></transmission>"
        for name, ratio, inertia in (("theta1", 50, 2e-7), ("theta2", 80, 3e-7), ("theta3", 50, 1e-7))
    )
    parts = [
        '<link name="base"/>',
        link("hip", 1),
        fixed("base_to_hip", "base", "hip", "0 0 0.02"),
        link("m02_upper", 2),
        swing("theta1", "hip", "m02_upper", "0 0 0.03", "0 0 0", "0 0 1", loss),
        # module 2's middle joint frozen at a quarter turn
        link("m02_middle", 3),
        fixed("m02_mid", "m02_upper", "m02_middle", f"{0.6 * l1} 0 -0.03", f"{QUARTER_TURN} 0 0"),
        link("m02_lower", 4),
        swing("theta2", "m02_middle", "m02_lower", f"{0.4 * l1} 0 0.01", "0 0 0", "0 0 1", ""),
        link("m01_upper_face", 5),
        fixed("bond", "m02_lower", "m01_upper_face", f"{half} 0 -0.01", f"{HALF_TURN} 0 0"),
        link("m01_upper", 6),
        swing("theta3", "m01_upper_face", "m01_upper", f"{l2 - half} 0 0", "0 0 0", "0 0 -1", loss),
        link("m01_lower", 7),
        fixed("m01_rest", "m01_upper", "m01_lower", f"{half} 0 0", "0.4 0 0"),
        link("foot", 8),
        fixed("foot_mount", "m01_lower", "foot", f"{shank + foot} 0 0"),
    ]
    home = "".join(f'<joint name="theta{i}" value="{value}"/>' for i, value in ((1, 0.0), (2, -0.5), (3, -1.0)))
    return (
        f'<?xml version="1.0"?><robot name="quadruped_leg">{"".join(parts)}{drives}'
        f'<configuration name="home">{home}</configuration></robot>'
    )


def load(route="closed_form", text=None, **options):
    """The formulas, or another route, on a text."""
    return Recipe(parse(leg_text() if text is None else text), route, "quadruped_leg", "foot", **options).build()


def random_leg(seed=5):
    """Every body with its own mass, off-centre centre of mass and full tensor, with drives and losses."""
    rng = np.random.default_rng(seed)
    bodies = []
    for name in quadruped.BODY_NAMES:
        factor = rng.normal(scale=0.05, size=(3, 3))
        second_moment = factor @ factor.T
        tensor = np.trace(second_moment) * np.eye(3) - second_moment
        com = tuple(rng.uniform(-0.1, 0.1, 3).tolist())
        bodies.append(quadruped.Body(name, rng.uniform(0.3, 2.0), com, tuple(map(tuple, tensor.tolist()))))
    losses = tuple(quadruped.Dissipation(name, *rng.uniform(0.1, 0.6, 2)) for name in ("theta3", "theta1"))
    l1, l2, l3 = rng.uniform(0.05, 0.2, 3)
    drives = tuple(rng.uniform(1e-3, 1e-2, 3).tolist())
    return quadruped.QuadrupedLeg(l1, l2, l3, tuple(bodies), drive_inertia=drives, dissipation=losses)


def array(nested, count):
    """Nested tuples of arrays or numbers as one array, samples last."""
    if isinstance(nested, tuple):
        return np.array([array(part, count) for part in nested])
    return np.broadcast_to(nested, count)
