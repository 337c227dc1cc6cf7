"""A planar four-bar with a crank that cannot turn fully: ground 1, crank 0.6, coupler 0.5, rocker 0.7 m."""

from __future__ import annotations

import math

import numpy as np

GROUND, CRANK, COUPLER, ROCKER = 1.0, 0.6, 0.5, 0.7
# The crank's angle at which coupler and rocker are in line.
TOGGLE = math.acos((GROUND**2 + CRANK**2 - (COUPLER + ROCKER) ** 2) / (2.0 * GROUND * CRANK))
HOME = 1.2


def passive(a):
    """Coupler and rocker angles (b, c) of the mode of the home pose by trigonometry, each in (-pi, pi]."""
    tip = CRANK * np.stack([np.cos(a), np.sin(a)])
    way = np.array([GROUND, 0.0]).reshape(2, *(1,) * np.ndim(a)) - tip
    distance = np.hypot(*way)
    along = (COUPLER**2 - ROCKER**2 + distance**2) / (2.0 * distance)
    height = np.sqrt(np.maximum(COUPLER**2 - along**2, 0.0))
    pin = tip + (along * way + height * np.stack([-way[1], way[0]])) / distance
    b = np.arctan2(*(pin - tip)[::-1]) - a
    c = np.arctan2(pin[1], pin[0] - GROUND)
    return np.arctan2(np.sin(b), np.cos(b)), c


def four_bar(limits=(-50.0, 50.0)):
    """URDF+ text; `limits` are those of the coupler's joint b."""
    b, c = (float(angle) for angle in passive(HOME))

    def link(name, length):
        return (
            f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="1"/>'
            '<inertia ixx="0.001" iyy="0.01" izz="0.01"/></inertial></link>'
        )

    def joint(name, parent, child, x, independent, lower, upper):
        return (
            f'<joint name="{name}" type="revolute" independent="{independent}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>'
            f'<limit lower="{lower}" upper="{upper}" effort="20" velocity="10"/></joint>'
        )

    return (
        '<robot name="four_bar"><link name="base"/>'
        + link("crank", CRANK)
        + link("coupler", COUPLER)
        + link("rocker", ROCKER)
        + joint("a", "base", "crank", 0.0, "true", -7.0, 7.0)
        + joint("b", "crank", "coupler", CRANK, "false", *limits)
        + joint("c", "base", "rocker", GROUND, "false", -50.0, 50.0)
        + f'<loop name="pin" type="revolute"><predecessor link="coupler"><origin xyz="{COUPLER} 0 0"/></predecessor>'
        f'<successor link="rocker"><origin xyz="{ROCKER} 0 0"/></successor><axis xyz="0 0 1"/></loop>'
        '<transmission name="t"><joint name="a"/><actuator name="motor"/></transmission>'
        f'<configuration name="home"><joint name="a" value="{HOME}"/><joint name="b" value="{b!r}"/>'
        f'<joint name="c" value="{c!r}"/></configuration></robot>'
    )
