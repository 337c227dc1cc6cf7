"""Design studies of any leg with named parameters: sweeps, Monte Carlo in stages, on one machine or a cluster."""

from __future__ import annotations

from leg_dynamics.analysis.design.motion import gait_path
from leg_dynamics.analysis.design.objectives import BUILT_IN, Objective
from leg_dynamics.analysis.design.ranges import Filter, Range
from leg_dynamics.analysis.design.result import StageResult, StudyResult
from leg_dynamics.analysis.design.running import run
from leg_dynamics.analysis.design.study import Plan, Resolution, Row, Stage, Study

__all__ = [
    "BUILT_IN",
    "Filter",
    "Objective",
    "Plan",
    "Range",
    "Resolution",
    "Row",
    "Stage",
    "StageResult",
    "Study",
    "StudyResult",
    "gait_path",
    "run",
]
