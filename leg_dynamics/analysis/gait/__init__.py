"""Gaits of robots with any number of legs: foot targets, stability, foot forces, actuator speeds and efforts.

>>> import leg_dynamics as ld
>>> from leg_dynamics.description import read
>>> from leg_dynamics.analysis.gait import plan, robot_from, study
>>> robot = robot_from(read("hexapod"), ld.load("hexapod_leg"))
>>> walk = plan(robot, "tripod", period=4.0, stride=0.4, clearance=0.1)
>>> result = study(robot, walk)
>>> bool(result.margin.min() > 0.0)
True

`plan_walk` plans by what is known of a robot, `steadying_sway` finds the body motion with the greatest margin.
"""

from __future__ import annotations

from leg_dynamics.analysis.gait.forces import LoadSharing, share_load
from leg_dynamics.analysis.gait.laws import LAWS
from leg_dynamics.analysis.gait.limits import LimitMargin
from leg_dynamics.analysis.gait.phases import GAITS, PhaseTable, phase_table, swing_order
from leg_dynamics.analysis.gait.picture import Picture, picture
from leg_dynamics.analysis.gait.posture import splayed_homes
from leg_dynamics.analysis.gait.reading import robot_from
from leg_dynamics.analysis.gait.report import FILES, columns, summary, write
from leg_dynamics.analysis.gait.robot import GaitLeg, Limb, Robot
from leg_dynamics.analysis.gait.settings import Settings, WalkPlan, plan_walk, settings_for
from leg_dynamics.analysis.gait.stability import project, support_margin
from leg_dynamics.analysis.gait.steadying import margin_bound, steadying_sway
from leg_dynamics.analysis.gait.study import LOADS, Choice, GaitStudy, LimbMotion, Peaks, plan, static_margin, study
from leg_dynamics.analysis.gait.tracks import Tracks, tracks
from leg_dynamics.analysis.gait.walk import BodyMotion, FootMotion, Sway, Tilt, Twist, Walk

__all__ = [
    "FILES",
    "GAITS",
    "LAWS",
    "LOADS",
    "BodyMotion",
    "Choice",
    "FootMotion",
    "GaitLeg",
    "GaitStudy",
    "Limb",
    "LimbMotion",
    "LimitMargin",
    "LoadSharing",
    "Peaks",
    "PhaseTable",
    "Picture",
    "Robot",
    "Settings",
    "Sway",
    "Tilt",
    "Tracks",
    "Twist",
    "Walk",
    "WalkPlan",
    "columns",
    "margin_bound",
    "phase_table",
    "picture",
    "plan",
    "plan_walk",
    "project",
    "robot_from",
    "settings_for",
    "share_load",
    "splayed_homes",
    "static_margin",
    "steadying_sway",
    "study",
    "summary",
    "support_margin",
    "swing_order",
    "tracks",
    "write",
]
