"""Serial legs whose workspace has a formula, as mechanism files."""

from __future__ import annotations

import functools
import math

import leg_dynamics as ld

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'


def link(name):
    return f'<link name="{name}">{INERTIAL}</link>'


def joint(name, kind, parent, child, axis, lower=None, upper=None, xyz="0 0 0"):
    limits = "" if lower is None else f'<limit lower="{lower!r}" upper="{upper!r}" effort="1" velocity="1"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>{limits}</joint>'
    )


def robot(name, *parts):
    return f'<robot name="{name}"><link name="base"/>{"".join(parts)}</robot>'


def cartesian(*extra, x=(-1.0, 1.0), y=(-1.0, 1.0), z=(-1.0, 1.0)):
    """Three slides: the foot is where the coordinates say, V = product of the ranges."""
    return robot(
        "cartesian",
        *(link(name) for name in ("a", "b", "foot")),
        joint("x", "prismatic", "base", "a", "1 0 0", *x),
        joint("y", "prismatic", "a", "b", "0 1 0", *y),
        joint("z", "prismatic", "b", "foot", "0 0 1", *z),
        *extra,
    )


def ball(radius):
    """A ball about the origin that a point foot must stay out of."""
    capsule = f'<segment link="base" from="0 0 0" to="0 0 0" radius="{radius!r}"/>'
    return f'<clearance name="ball">{capsule}<segment link="foot" from="0 0 0" to="0 0 0" radius="0"/></clearance>'


def polar(*extra, azimuth=(-1.0, 1.0), elevation=(-1.0, 1.0), radius=(0.5, 1.0)):
    """Azimuth about z, elevation about -y, a slide along x: V = dA (sin e2 - sin e1) (r2^3 - r1^3) / 3."""
    return robot(
        "polar",
        *(link(name) for name in ("a", "b", "foot")),
        joint("azimuth", "revolute", "base", "a", "0 0 1", *azimuth),
        joint("elevation", "revolute", "a", "b", "0 -1 0", *elevation),
        joint("radius", "prismatic", "b", "foot", "1 0 0", *radius),
        *extra,
    )


def polar_volume(azimuth, elevation, radius):
    angle = (azimuth[1] - azimuth[0]) * (math.sin(elevation[1]) - math.sin(elevation[0]))
    return angle * (radius[1] ** 3 - radius[0] ** 3) / 3.0


def cone(half_angle):
    return (
        f'<cone name="tip" link="foot"><axis xyz="1 0 0"/><other link="base"><axis xyz="2 0 0"/></other>'
        f'<limit upper="{half_angle!r}"/></cone>'
    )


def planar(shoulder=(-1.0, 1.0), elbow=(0.3, 2.5), lengths=(0.4, 0.3)):
    """Two hinges about y: area = dq1 l1 l2 (cos e1 - cos e2) where the elbow keeps its sign."""
    return robot(
        "planar",
        *(link(name) for name in ("a", "b")),
        '<link name="foot"/>',
        joint("shoulder", "revolute", "base", "a", "0 1 0", *shoulder),
        joint("elbow", "revolute", "a", "b", "0 1 0", *elbow, xyz=f"{lengths[0]} 0 0"),
        joint("tip", "fixed", "b", "foot", "1 0 0", xyz=f"{lengths[1]} 0 0"),
    )


def articulated(yaw, shoulder, elbow, home, lengths=(0.4, 0.3)):
    """Yaw about z, then shoulder and elbow about -y: det J = l1 l2 sin(elbow) r, r the distance from the yaw axis."""
    return robot(
        "articulated",
        *(link(name) for name in ("a", "b", "c")),
        '<link name="foot"/>',
        joint("yaw", "revolute", "base", "a", "0 0 1", *yaw),
        joint("shoulder", "revolute", "a", "b", "0 -1 0", *shoulder),
        joint("elbow", "revolute", "b", "c", "0 -1 0", *elbow, xyz=f"{lengths[0]} 0 0"),
        joint("tip", "fixed", "c", "foot", "1 0 0", xyz=f"{lengths[1]} 0 0"),
        f'<configuration name="home"><joint name="elbow" value="{home!r}"/></configuration>',
    )


@functools.cache
def load(text, route="symbolic"):
    return ld.load(text, route=route, foot="foot")
