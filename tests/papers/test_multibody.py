from __future__ import annotations

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.omnileg import multibody

needs_mujoco = pytest.mark.skipif(not multibody.has_mujoco(), reason="the optional extra mujoco is not installed")


@pytest.fixture(scope="module")
def context():
    return Context("omnileg", samples=multibody.STATES)


def test_without_mujoco_the_verdicts_say_so(monkeypatch, context):
    monkeypatch.setattr(multibody, "has_mujoco", lambda: False)
    for function in multibody.VERDICTS:
        verdict = function(context)
        assert verdict.status is Status.OUT_OF_REACH
        assert "optional extra is missing" in verdict.finding
    assert all(function(context).passed and "left out" in function(context).name for function in multibody.CHECKS)
    assert multibody.plots(context) == ()
    (section,) = multibody.sections(context)
    assert "not installed" in section.paragraphs[0]


@needs_mujoco
def test_terms_agree(context):
    check = multibody.terms_agree(context)
    assert check.passed
    assert 0.0 < check.value < 1e-11


@needs_mujoco
def test_the_end_of_fig_11s_force_is_followed_closely(context):
    motion = multibody.scenario(context, "Fig. 11", multibody.SOLVER.timestep, 0.1)
    assert motion.foot_force is not None
    found = multibody.compare(context, motion)
    assert found.position_error < 1e-7
    assert (found.torque_error < 2e-5).all()
    assert (found.torque_share < 1e-2).all()
    assert found.opening < 1e-6
    # Column order: at the start the force asks M2 (alpha) for -3 N·m and the others for nothing.
    np.testing.assert_allclose(found.torque[0], (0.0, -3.0, 0.0), atol=1e-4)


@needs_mujoco
@pytest.mark.slow
def test_every_run_stays_below_the_papers_figures(context):
    for function in multibody.VERDICTS:
        verdict = function(context)
        assert verdict.status is Status.CONFIRMED
        assert verdict.figures
    for function in multibody.CHECKS:
        assert function(context).passed
    errors = [found.position_error for _, found in multibody.settings(context)]
    used = [found.solver for _, found in multibody.settings(context)].index(multibody.SOLVER)
    assert errors[0] > 1e3 * errors[used]
    assert min(errors) == errors[-1]
    (section,) = multibody.sections(context)
    assert len(section.rows) == len(multibody.SOLVERS)
    assert [plot.name for plot in multibody.plots(context)] == list(section.plots)
    for plot in multibody.plots(context):
        assert plot.png(60).startswith(b"\x89PNG")
