"""A row's value does not depend on the rows before it, also where it is left to the numeric route."""

from __future__ import annotations

import math

import numpy as np
import pytest

import leg_dynamics as ld

BASE, CRANK, RODS, HOME = 0.5, 0.25, (0.6, 0.38), (1.7, 1.2)
# The straight way from home to the first pose crosses a region where the rods do not reach each other; from the second
# it does not.
HIDDEN, BESIDE = (-0.51017303, 2.57252281), (-0.54662971, 2.47853834)


def five_bar():
    """Two cranks of equal length and two rods of different ones, in a plane."""
    elbows = [np.array([x + CRANK * math.cos(t), CRANK * math.sin(t)]) for x, t in zip((0.0, BASE), HOME, strict=True)]
    between = elbows[1] - elbows[0]
    distance = float(np.linalg.norm(between))
    along = (distance**2 + RODS[0] ** 2 - RODS[1] ** 2) / (2.0 * distance)
    across = math.sqrt(RODS[0] ** 2 - along**2)
    unit = between / distance
    tip = elbows[0] + along * unit + across * np.array([-unit[1], unit[0]])
    passive = [
        math.remainder(math.atan2(*(tip - elbow)[::-1]) - t, math.tau) for elbow, t in zip(elbows, HOME, strict=True)
    ]
    body = (
        '<inertial><origin xyz="{x} 0 0"/><mass value="1"/>'
        '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
    )
    text = '<robot name="five_bar"><link name="base"/>'
    pose = ""
    for side, x in enumerate((0.0, BASE)):
        text += f'<link name="crank{side}">{body.format(x=CRANK / 2)}</link>'
        text += f'<link name="rod{side}">{body.format(x=RODS[side] / 2)}</link>'
        for name, flag, parent, child, at in (
            (f"a{side}", "true", "base", f"crank{side}", x),
            (f"b{side}", "false", f"crank{side}", f"rod{side}", CRANK),
        ):
            text += (
                f'<joint name="{name}" type="continuous" independent="{flag}"><parent link="{parent}"/>'
                f'<child link="{child}"/><origin xyz="{at} 0 0"/><axis xyz="0 0 1"/></joint>'
            )
        pose += f'<joint name="a{side}" value="{HOME[side]}"/><joint name="b{side}" value="{passive[side]!r}"/>'
    return (
        f'{text}<loop name="l" type="revolute"><predecessor link="rod0"><origin xyz="{RODS[0]} 0 0"/></predecessor>'
        f'<successor link="rod1"><origin xyz="{RODS[1]} 0 0"/></successor><axis xyz="0 0 1"/></loop>'
        f'<configuration name="home">{pose}</configuration></robot>'
    )


@pytest.mark.parametrize("order", [(0, 1), (1, 0), (1, 1, 0)])
def test_rows_of_a_batch_are_rows_of_their_own(order):
    rows = np.array([HIDDEN, BESIDE])
    zero = np.zeros(2)
    alone = [ld.load(five_bar(), route="symbolic").torque(row, zero, zero, on_error="nan") for row in rows]
    assert np.isnan(alone[0]).all()
    assert np.isfinite(alone[1]).all()
    found = ld.load(five_bar(), route="symbolic").torque(rows[list(order)], zero, zero, on_error="nan")
    for row, value in zip(order, found, strict=True):
        np.testing.assert_array_equal(value, alone[row])


def test_the_numeric_route_does_not_go_on_from_its_last_pose_either():
    leg = ld.load(five_bar(), route="pinocchio")
    zero = np.zeros(2)
    for _ in range(2):
        assert np.isnan(leg.torque(np.array(HIDDEN), zero, zero, on_error="nan")).all()
        leg.torque(np.array(BESIDE), zero, zero)
