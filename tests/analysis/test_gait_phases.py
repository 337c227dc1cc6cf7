"""Phase tables: the classic gaits by their literature, and any table by its legs."""

from __future__ import annotations

import numpy as np
import pytest

from leg_dynamics.analysis.gait import Limb, PhaseTable, Robot, phase_table, swing_order
from leg_dynamics.errors import NonFiniteError, TrajectoryError

from .gait_robots import Telescope, toy_robot

CYCLES = np.linspace(0.0, 1.0, 997, endpoint=False) + 1e-4


def flying(table):
    return (~table.in_stance(CYCLES)).sum(axis=1)


def test_tripod_lifts_two_tripods_in_turns():
    robot = toy_robot(6)
    table = phase_table("tripod", robot)
    assert table.duty == 0.5
    assert dict(zip(robot.leg_names, table.phases, strict=True)) == {
        "L0": 0.0,
        "R0": 0.5,
        "L1": 0.5,
        "R1": 0.0,
        "L2": 0.0,
        "R2": 0.5,
    }
    assert (flying(table) == 3).all()


@pytest.mark.parametrize("count", [4, 6, 8])
def test_wave_has_one_leg_in_the_air_and_ripple_one_a_side(count):
    robot = toy_robot(count)
    wave, ripple = phase_table("wave", robot), phase_table("ripple", robot)
    assert wave.duty == pytest.approx(1.0 - 1.0 / count)
    assert (flying(wave) == 1).all()
    assert ripple.duty == pytest.approx(1.0 - 2.0 / count)
    left = np.array([name.startswith("L") for name in robot.leg_names])
    swing = ~ripple.in_stance(CYCLES)
    assert (swing[:, left].sum(axis=1) == 1).all()
    assert (swing[:, ~left].sum(axis=1) == 1).all()


def test_waves_run_from_the_rear_to_the_front():
    robot = toy_robot(6)
    for gait in ("wave", "ripple"):
        table = phase_table(gait, robot)
        lift = {name: (phase + table.duty) % 1.0 for name, phase in zip(robot.leg_names, table.phases, strict=True)}
        for side in "LR":
            after_rear = [(lift[f"{side}{m}"] - lift[f"{side}2"]) % 1.0 for m in (2, 1, 0)]
            assert after_rear == sorted(after_rear)


def test_four_legs_trot_and_crawl():
    robot = toy_robot(4)
    trot = dict(zip(robot.leg_names, phase_table("tripod", robot).phases, strict=True))
    assert trot["L0"] == trot["R1"] != trot["R0"] == trot["L1"]
    crawl = phase_table("wave", robot)
    # McGhee & Frank 1968: the one creeping order that is stable throughout is left front, right rear, right front, ...
    order = sorted(robot.leg_names, key=lambda name: crawl.phases[robot.leg_names.index(name)])
    assert order == ["L0", "R1", "R0", "L1"]


def test_a_wave_at_any_duty_lifts_a_leg_as_the_one_behind_touches_down():
    robot = toy_robot(6)
    table = phase_table("wave", robot, duty=0.8)
    phases = dict(zip(robot.leg_names, table.phases, strict=True))
    assert (phases["L0"] + 0.8) % 1.0 == pytest.approx(phases["L1"])
    # At one half, the wave is the tripod (Song & Waldron 1989).
    assert np.allclose(phase_table("wave", robot, duty=0.5).phases, phase_table("tripod", robot).phases)


def test_the_creep_of_chen_2021_swings_leg_four_from_10_to_15_seconds():
    names = dict(zip(("L0", "R0", "L1", "R1"), ("I", "II", "III", "IV"), strict=True))
    toy = toy_robot(4)
    limbs = [Limb(names[limb.name], limb.leg, limb.hip, limb.home, limb.mirror) for limb in toy.limbs]
    robot = Robot("quadruped", tuple(limbs), 12.0)
    table = swing_order(("III", "I", "IV", "II"), robot)
    assert table.name == "III-I-IV-II"
    time = np.linspace(0.0, 20.0, 2001)
    swing = ~table.in_stance(time / 20.0)
    leg = robot.leg_names.index("IV")
    assert time[swing[:, leg]].min() == pytest.approx(10.0, abs=0.011)
    assert time[swing[:, leg]].max() == pytest.approx(15.0, abs=0.011)
    assert (swing.sum(axis=1) <= 1).all()
    slow = swing_order(("III", "I", "IV", "II"), robot, duty=0.9)
    assert (slow.phases[leg] + slow.duty) % 1.0 == pytest.approx(0.5)


def test_touch_down_and_lift_off_count_as_stance():
    table = PhaseTable((0.0, 1.0 / 3.0), 0.6)
    assert table.in_stance([0.0, 0.6, 1.0])[:, 0].all()
    assert table.in_stance([1.0 / 3.0, 1.0 / 3.0 + 0.6])[:, 1].all()
    assert not table.in_stance([0.6 + 1e-6])[0, 0]
    assert np.allclose(table.switches(), [0.0, 1 / 3, 0.6, 1 / 3 + 0.6])


def test_tables_by_name_and_by_order_agree():
    robot = toy_robot(4)
    by_name = phase_table({"R1": 0.75, "L0": 0.0, "R0": 0.25, "L1": 0.5}, robot, 0.8)
    assert by_name == phase_table((0.0, 0.25, 0.5, 0.75), robot, 0.8)
    assert phase_table(by_name, robot) is by_name
    assert phase_table(by_name, robot, 0.9).duty == 0.9
    assert PhaseTable((1.25, -0.25, 1.0, -1e-20), 0.5).phases == (0.25, 0.75, 0.0, 0.0)


@pytest.mark.parametrize(
    ("gait", "duty", "error"),
    [
        ("gallop", None, TrajectoryError),
        ((0.0, 0.5), 0.5, TrajectoryError),
        ((0.0, 0.25, 0.5, 0.75), None, TrajectoryError),
        ((0.0, 0.25, 0.5, float("nan")), 0.5, NonFiniteError),
        ({"L0": 0.0}, 0.5, TrajectoryError),
        ("tripod", 1.5, TrajectoryError),
        ([], 0.5, TrajectoryError),
    ],
)
def test_bad_gaits_are_named(gait, duty, error):
    with pytest.raises(error):
        phase_table(gait, toy_robot(4), duty)


@pytest.mark.parametrize("order", [("L0", "R0", "L1"), ("L0", "L0", "R0", "R1"), "L0R0", ("L0", "R0", "L1", "X")])
def test_a_swing_order_names_every_leg_once(order):
    with pytest.raises(TrajectoryError, match="every leg once"):
        swing_order(order, toy_robot(4))


def test_a_leg_in_the_middle_has_no_side():
    hip = np.diag([1.0, -1.0, -1.0, 1.0])
    places = [(0.3, 0.2), (0.3, -0.2), (-0.4, 0.0)]
    limbs = [Limb(f"leg {k}", Telescope(), hip, (x, y, -0.5)) for k, (x, y) in enumerate(places)]
    with pytest.raises(TrajectoryError, match="leg 2"):
        phase_table("wave", Robot("tripod stool", tuple(limbs), 1.0))
    with pytest.raises(TrajectoryError, match="too few legs"):
        phase_table("ripple", toy_robot(2))
