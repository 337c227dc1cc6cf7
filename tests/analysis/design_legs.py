"""Legs with parameters whose indices have formulas, as xacro sources; and functions that other processes can find."""

from __future__ import annotations

import math

import numpy as np

import leg_dynamics as ld

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def _source(folder, name, parameters, body):
    lines = [f'{key}: {{value: {value}, unit: {unit}, source: "test"}}' for key, (value, unit) in parameters.items()]
    (folder / f"{name}.yaml").write_text("\n".join(lines))
    path = folder / f"{name}.urdf.xacro"
    path.write_text(
        f'<robot name="{name}" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        f'<xacro:arg name="parameters" default="{name}.yaml"/>'
        '<xacro:property name="p" value="${xacro.load_yaml(\'$(arg parameters)\')}" lazy_eval="false"/>'
        f'<link name="base"/>{body}</robot>'
    )
    return path


def _joint(name, kind, parent, child, axis, lower, upper, xyz="0 0 0"):
    return (
        f'<link name="{child}">{INERTIAL}</link>'
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint>'
    )


def planar(folder, route="symbolic"):
    """Two hinges about y, lengths l1 and l2, elbow from `bent` to 2.5 rad."""
    parameters = {"l1": (0.4, "m"), "l2": (0.3, "m"), "bent": (0.3, "rad")}
    body = (
        _joint("shoulder", "revolute", "base", "a", "0 1 0", -1.0, 1.0)
        + _joint("elbow", "revolute", "a", "b", "0 1 0", "${p.bent.value}", 2.5, "${p.l1.value} 0 0")
        + '<link name="foot"/><joint name="tip" type="fixed"><parent link="b"/><child link="foot"/>'
        '<origin xyz="${p.l2.value} 0 0"/></joint>'
        '<configuration name="home"><joint name="elbow" value="1.0"/></configuration>'
    )
    return ld.load(_source(folder, "planar", parameters, body), route=route, foot="foot")


def planar_indices(l1, l2, bent):
    """Area, mean and deviation of the condition number by quadrature over the elbow; the shoulder does not matter."""
    elbow = np.linspace(bent, 2.5, 20001)
    weight = l1 * l2 * np.sin(elbow)
    weight[[0, -1]] /= 2.0
    squares = l1**2 + 2.0 * l2**2 + 2.0 * l1 * l2 * np.cos(elbow)  # trace of J^T J
    product = (l1 * l2 * np.sin(elbow)) ** 2  # its determinant
    root = np.sqrt(squares**2 / 4.0 - product)
    k = np.sqrt((squares / 2.0 + root) / (squares / 2.0 - root))
    mean = (weight * k).sum() / weight.sum()
    deviation = math.sqrt((weight * (k - mean) ** 2).sum() / weight.sum())
    return 2.0 * l1 * l2 * (math.cos(bent) - math.cos(2.5)), mean, deviation


def cartesian(folder, route="symbolic"):
    """Three slides: the foot is where the coordinates say, in a box of half width `wide` and height `high`."""
    parameters = {"wide": (0.5, "m"), "high": (0.4, "m")}
    body = (
        _joint("x", "prismatic", "base", "a", "1 0 0", "${-p.wide.value}", "${2*p.wide.value}")
        + _joint("y", "prismatic", "a", "b", "0 1 0", -1.0, 1.0)
        + _joint("z", "prismatic", "b", "foot", "0 0 1", -0.5, "${p.high.value}")
    )
    return ld.load(_source(folder, "cartesian", parameters, body), route=route, foot="foot")


def weighed(folder, mass, length):
    """One hinge with a rod of any mass (kg) and length (m), texts of `p.size.value` and `p.weight.value`; and 1 kg."""
    parameters = {"size": (0.4, "m"), "weight": (2.0, "kg")}
    body = _joint("hinge", "revolute", "base", "a", "0 1 0", -1.0, 1.0) + (
        f'<xacro:property name="m" value="${{{mass}}}"/><xacro:property name="l" value="${{{length}}}"/>'
        '<link name="rod"><inertial><origin xyz="0.1 0 ${l/2}"/><mass value="${m}"/><inertia ixx="${m*l**2/12}" '
        'iyy="${m*l**2/12}" izz="${m*l**2/100}" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="hold" '
        'type="fixed"><parent link="a"/><child link="rod"/></joint>'
    )
    return ld.load(_source(folder, "weighed", parameters, body), route="symbolic", foot="rod")


def least_height(leg):
    """Least z of the strut directions' ends at home: any function of a leg."""
    home = leg.description.home.values
    return float(leg.foot_position([home[name] for name in leg.joint_names])[2])


def divides_by_zero(leg):
    return 1.0 / 0.0


def is_text(leg):
    return "long"
