from __future__ import annotations

import sys

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context
from leg_dynamics.papers.omnileg import multibody

needs_mujoco = pytest.mark.skipif(not multibody.available(), reason="the optional extra mujoco cannot be used")


@pytest.fixture(scope="module")
def context():
    return Context("omnileg", samples=multibody.STATES)


def test_without_mujoco_checks_are_not_run_and_do_not_hold(monkeypatch, context):
    monkeypatch.setattr(multibody, "has_mujoco", lambda: False)
    checks = [function(context) for function in multibody.CHECKS]
    assert [(check.value, check.passed, check.state) for check in checks] == [(None, None, "not run")] * len(checks)
    assert all("needs the extra mujoco" in check.of for check in checks)
    assert not hasattr(multibody, "VERDICTS")
    assert multibody.plots(context) == ()
    (section,) = multibody.sections(context)
    assert "cannot be used" in section.paragraphs[0]
    assert "leg-dynamics[mujoco]" in section.paragraphs[0]


@pytest.mark.parametrize("error", [ImportError("libGL.so.1: cannot open shared object file"), OSError("broken")])
def test_a_mujoco_that_is_found_but_does_not_load_counts_as_missing(monkeypatch, context, error):
    class Broken:
        def find_spec(self, name, path=None, target=None):
            if name == "mujoco":
                raise error

    monkeypatch.setattr(multibody, "has_mujoco", lambda: True)
    monkeypatch.delitem(sys.modules, "mujoco", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    assert multibody.available() is False
    assert {function(context).state for function in multibody.CHECKS} == {"not run"}


def test_both_sides_are_differenced_alike():
    """A foot on a path with a corner in its acceleration, simulated without error: no error may be found."""
    t = 1e-3 * np.arange(101)
    path = np.where(t < 0.05, t**3, 0.05**3 - (t - 0.05) ** 3)[:, None] * np.ones(3)
    still = np.ones((101, 3))
    found = multibody.Comparison(t, path, path, still, still, (1.0, 1.0, 1.0), 0.0, multibody.SOLVER)
    assert (found.position_error, found.velocity_error, found.acceleration_error) == (0.0, 0.0, 0.0)
    wave = path + 1e-6 * np.sin(100.0 * t)[:, None] * np.array([1.0, 0.0, 0.0])
    off = multibody.Comparison(t, wave, path, 1.01 * still, still, (0.1, 0.2, 0.5), 0.0, multibody.SOLVER)
    assert off.position_error == pytest.approx(1e-6, rel=1e-3)
    assert off.velocity_error == pytest.approx(1e-4, rel=1e-2)
    assert off.acceleration_error == pytest.approx(1e-2, rel=1e-2)
    np.testing.assert_allclose(off.foot_shares, (1e-3, 5e-2, 2.0), rtol=1e-2)
    np.testing.assert_allclose(off.torque_error, 0.01, rtol=1e-12)
    np.testing.assert_allclose(off.torque_share, 1.0, rtol=1e-12)


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
def test_every_run_stays_below_its_tolerance_and_shrinks_with_the_step(context):
    for function in multibody.CHECKS:
        assert function(context).passed
    for name in ("(51)", "(52)"):
        found, half = multibody._run(context, name), multibody.finer(context, name)
        assert half.solver.timestep == 0.5 * found.solver.timestep
        for kind in ("position_error", "velocity_error", "acceleration_error"):
            assert getattr(half, kind) < 0.5 * getattr(found, kind)
        # Not the jerk's corner at 2.5 s, which differences alone see as 0.128 mm/s².
        assert found.acceleration_error < 1e-5
    errors = [found.position_error for _, found in multibody.settings(context)]
    used = [found.solver for _, found in multibody.settings(context)].index(multibody.SOLVER)
    assert errors[0] > 1e3 * errors[used]
    assert min(errors) == errors[-1]
    results, limits = multibody.sections(context)
    assert [row[-2] for row in results.rows] == [
        *("42.5 µm", "74 µm/s", "1.5 mm/s²", "45 µm", "63 µm/s", "2.89 mm/s²"),
        *("2.1 mN·m", "1.5 mN·m", "5.2 mN·m"),
    ]
    assert [row[-1] for row in results.rows[:6]] == ["0.04 %", "0.09 %", "1.8 %", "0.05 %", "0.08 %", "1.9 %"]
    assert "All 9 errors shrink" in results.paragraphs[1]
    assert len(limits.rows) == len(multibody.SOLVERS)
    assert [plot.name for plot in multibody.plots(context)] == list(results.plots)
    assert "M1 (β) at 0.27 s, M2 (α) at 0.31 s" in multibody.plots(context)[-1].caption
    for plot in multibody.plots(context):
        assert plot.png(60).startswith(b"\x89PNG")
