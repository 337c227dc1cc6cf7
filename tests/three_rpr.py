"""A platform on three struts in a plane, the 3-RPR of Innocenti and Parenti-Castelli (1992).

In tenths of its lengths, doi:10.1016/0094-114X(92)90028-E. A pose is the direction of the first strut and of the
platform, rad; the first strut keeps its length here.
"""

from __future__ import annotations

import math

import numpy as np

BASE = np.array([[0.0, 0.0], [1.591, 0.0], [0.0, 1.0]])
STRUT = 1.498
SIDES = (1.704, 1.654, 2.084)
_CORNER = math.acos((SIDES[0] ** 2 + SIDES[2] ** 2 - SIDES[1] ** 2) / (2.0 * SIDES[0] * SIDES[2]))
PLATFORM = np.array([[0.0, 0.0], [SIDES[0], 0.0], [SIDES[2] * math.cos(_CORNER), SIDES[2] * math.sin(_CORNER)]])


def corners(pose):
    """The platform's corners, (3, 2) m."""
    strut, turn = pose
    R = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    return STRUT * np.array([math.cos(strut), math.sin(strut)]) + PLATFORM @ R.T


def struts(pose):
    """Lengths of the struts, (3,) m."""
    return np.linalg.norm(corners(pose) - BASE, axis=1)


def three_rpr(pose):
    """URDF+ text with its home at a pose."""
    directions = [math.atan2(*(corner - foot)[::-1]) for corner, foot in zip(corners(pose), BASE, strict=True)]
    parts, values = ['<robot name="platform"><link name="base"/>'], {}
    inertial = (
        '<inertial><origin xyz="{} {} 0"/><mass value="{}"/>'
        '<inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    for k, (x, y) in enumerate(BASE):
        parts.append(
            f'<link name="sleeve{k}">{inertial.format(0.2, 0, 0.5 + k)}</link>'
            f'<link name="rod{k}">{inertial.format(-0.2, 0, 0.4)}</link>'
            f'<joint name="turn{k}" type="continuous" independent="false"><parent link="base"/>'
            f'<child link="sleeve{k}"/><origin xyz="{x} {y} 0"/><axis xyz="0 0 1"/></joint>'
            f'<joint name="strut{k}" type="prismatic" independent="true"><parent link="sleeve{k}"/>'
            f'<child link="rod{k}"/><axis xyz="1 0 0"/><limit lower="0" upper="6" effort="30" velocity="20"/></joint>'
        )
        values |= {f"turn{k}": directions[k], f"strut{k}": struts(pose)[k]}
    values["tilt"] = pose[1] - directions[0]
    parts.append(
        f'<link name="platform">{inertial.format(0.5, 0.3, 1.2)}</link>'
        '<joint name="tilt" type="continuous" independent="false"><parent link="rod0"/><child link="platform"/>'
        '<axis xyz="0 0 1"/></joint>'
    )
    for k in (1, 2):
        x, y = PLATFORM[k]
        parts.append(
            f'<loop name="corner{k}" type="revolute"><predecessor link="platform"><origin xyz="{x} {y} 0"/>'
            f'</predecessor><successor link="rod{k}"/><axis xyz="0 0 1"/></loop>'
        )
    stated = "".join(f'<joint name="{name}" value="{float(value)!r}"/>' for name, value in values.items())
    return "".join(parts) + f'<configuration name="home">{stated}</configuration></robot>'
