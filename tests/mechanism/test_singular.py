"""The kind of a pose that a motion cannot pass, told by which columns of the loop rows lose rank."""

from __future__ import annotations

import math

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.errors import AssemblyError, SingularityError

CRANK, LINK, BASE = 0.3, 0.2, 0.1
ENDS = [(0.829296, -3.99977), (0.344418, -3.52342), (0.647613, -3.88019), (0.191514, -3.32189)]


def pin(qa, qb):
    """Knees of both sides and the lower pin of a symmetric five-bar in the plane of x and z, angles about -y."""
    a = np.array([-BASE + CRANK * math.cos(qa), CRANK * math.sin(qa)])
    b = np.array([BASE + CRANK * math.cos(qb), CRANK * math.sin(qb)])
    way = b - a
    height = math.sqrt(max(LINK**2 - way @ way / 4.0, 0.0))
    return a, b, 0.5 * (a + b) - height * np.array([-way[1], way[0]]) / np.linalg.norm(way)


def rows(qa, qb):
    """Both loop rows by qa, qb, pa, pb."""
    a, b, tip = pin(qa, qb)

    def turning(point, center):
        return np.array([-(point - center)[1], (point - center)[0]])

    left, right = np.array([-BASE, 0.0]), np.array([BASE, 0.0])
    return np.stack([turning(tip, left), -turning(tip, right), turning(tip, a), -turning(tip, b)], axis=1)


def five_bar(home):
    a, b, tip = pin(*home)
    pa = math.atan2(*(tip - a)[::-1]) - home[0]
    pb = math.atan2(*(tip - b)[::-1]) - home[1]

    def link(name):
        return (
            f'<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>'
            '<inertia ixx="0.001" iyy="0.01" izz="0.01"/></inertial></link>'
        )

    def joint(name, parent, child, x, independent):
        return (
            f'<joint name="{name}" type="revolute" independent="{independent}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{x} 0 0"/><axis xyz="0 -1 0"/>'
            '<limit lower="-50" upper="50" effort="20" velocity="10"/></joint>'
        )

    values = zip(("qa", "qb", "pa", "pb"), (*home, pa, pb), strict=True)
    return (
        '<robot name="narrow"><link name="base"/>'
        + "".join(link(name) for name in ("a1", "a2", "b1", "b2"))
        + joint("qa", "base", "a1", -BASE, "true")
        + joint("qb", "base", "b1", BASE, "true")
        + joint("pa", "a1", "a2", CRANK, "false")
        + joint("pb", "b1", "b2", CRANK, "false")
        + f'<loop name="pin" type="revolute"><predecessor link="a2"><origin xyz="{LINK} 0 0"/></predecessor>'
        f'<successor link="b2"><origin xyz="{LINK} 0 0"/></successor><axis xyz="0 -1 0"/></loop>'
        + "".join(
            f'<transmission name="t_{name}"><joint name="{name}"/><actuator name="m_{name}"/></transmission>'
            for name in ("qa", "qb")
        )
        + '<configuration name="home">'
        + "".join(f'<joint name="{name}" value="{value!r}"/>' for name, value in values)
        + "</configuration></robot>"
    )


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("pieces", [1, 399])
def test_links_in_line_are_parallel_also_near_a_pose_where_all_four_are_in_line(end, pieces):
    """All rows keep their rank by plane geometry; only the columns of the passive joints lose it."""
    home = (math.radians(-100.0), math.radians(-80.0))
    leg = ld.load(five_bar(home), route="pinocchio")
    way = np.linspace(home, end, pieces + 1)
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        leg.backend.follow(way)
    error = caught.value
    K = rows(error.pose["qa"], error.pose["qb"])
    everything, passive = (np.linalg.svd(columns, compute_uv=False)[-1] for columns in (K, K[:, 2:]))
    assert passive < 0.05 * everything
    assert error.kind == "parallel"
    assert {name for name, x in error.direction.items() if abs(x) > 1e-3} == {"pa", "pb"}


def test_all_four_links_in_line_are_a_constraint_singularity():
    # Beyond the pose where both knees meet: the cranks cross.
    leg = ld.load(five_bar((-0.6, 0.6 - math.pi)), route="pinocchio")
    # The knees are 2 CRANK - 2 BASE = 2 LINK apart.
    flat = (0.0, -math.pi)
    assert np.linalg.svd(rows(*flat), compute_uv=False)[-1] < 1e-7
    with pytest.raises((AssemblyError, SingularityError)) as caught:
        leg.assemble(flat)
    assert caught.value.kind == "constraint"
