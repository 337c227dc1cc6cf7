"""Poses of a design study for pytest-benchmark: constraints and condition numbers, `extra_info` in poses a second."""

from __future__ import annotations

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.analysis.design import Range, Stage, Study
from leg_dynamics.analysis.design.graphs import OUTPUTS
from leg_dynamics.analysis.design.study import Plan

POSES = 8192
DESIGN = {"a": 0.15}


@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_poses_of_a_design(benchmark):
    leg = ld.load("hexapod_leg_preliminary")
    study = Study(leg, (Stage((Range("a", 0.1, 0.35), Range("l2_max", 0.45, 0.8)), 5),), objectives=("V", "kbar"))
    one = Plan.of(study).designs().at(DESIGN)
    q = one.lower + (one.upper - one.lower) * np.random.default_rng(0).random((POSES, 3))
    found = one.poses(q)[:, OUTPUTS.index("condition")]
    closed = np.flatnonzero(np.isfinite(found))[:500]
    expected = np.linalg.cond(leg.replace(**DESIGN).jacobian(q[closed]))
    np.testing.assert_allclose(found[closed], expected, rtol=1e-9)
    benchmark(one.poses, q)
    benchmark.extra_info["poses a second"] = POSES / benchmark.stats["median"] if benchmark.stats else None
