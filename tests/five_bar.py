"""A planar five-bar: two motors at the base, a pin at the tip; any of its four joints can be driven."""

from __future__ import annotations

import math

# Of the symmetric pose whose cranks stand 1.2 rad from the horizontal.
KNEE = math.pi - 1.2 - math.acos((0.1 + 0.2 * math.cos(1.2)) / 0.25)

HOME = (
    f'<configuration name="home"><joint name="ma" value="{math.pi - 1.2}"/><joint name="mb" value="1.2"/>'
    f'<joint name="ka" value="{-KNEE}"/><joint name="kb" value="{KNEE}"/></configuration>'
)
FOOT = (
    '<link name="foot"/><joint name="tip" type="fixed"><parent link="a2"/><child link="foot"/>'
    '<origin xyz="0.25 0 0"/></joint>'
)
# The cranks' angle at which both distal links are in line: the toggle point of the symmetric poses.
TOGGLE = math.acos(0.75)


def five_bar(motors=("ma", "mb"), effort=20.0, drive="", ratio=1.0, foot=False, home=True, effort_lower=None):
    """URDF+ text.

    `motors` drive joints, with an `effort` limit, both ways where `effort_lower` is None; `drive` is XML inside each
    actuator, `ratio` its gear. `foot` adds the link at the pin, `home` the configuration.
    """

    efforts = f'effort="{effort}"' + ("" if effort_lower is None else f' effort_lower="{effort_lower}"')

    def link(name):
        return (
            f'<link name="{name}"><inertial><origin xyz="0.1 0 0.01"/><mass value="1"/>'
            '<inertia ixx="0.001" iyy="0.01" izz="0.01"/></inertial></link>'
        )

    def joint(name, parent, child, x, independent):
        return (
            f'<joint name="{name}" type="revolute" independent="{independent}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{x} 0 0"/><axis xyz="0 1 0"/>'
            f'<limit lower="-4" upper="4" {efforts} velocity="10"/></joint>'
        )

    transmissions = "".join(
        f'<transmission name="t_{name}"><joint name="{name}"/><actuator name="M_{name}">'
        f"<mechanicalReduction>{ratio}</mechanicalReduction>{drive}</actuator></transmission>"
        for name in motors
    )
    return (
        '<robot name="five_bar"><link name="base"/>'
        + "".join(link(name) for name in ("a1", "a2", "b1", "b2"))
        + joint("ma", "base", "a1", -0.1, "true")
        + joint("ka", "a1", "a2", 0.2, "false")
        + joint("mb", "base", "b1", 0.1, "true")
        + joint("kb", "b1", "b2", 0.2, "false")
        + '<loop name="pin" type="revolute"><predecessor link="a2"><origin xyz="0.25 0 0"/></predecessor>'
        '<successor link="b2"><origin xyz="0.25 0 0"/></successor><axis xyz="0 1 0"/></loop>'
        + transmissions
        + (FOOT if foot else "")
        + (HOME if home else "")
        + "</robot>"
    )
