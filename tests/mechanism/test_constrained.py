from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from leg_dynamics.description import parse
from leg_dynamics.errors import NonFiniteError, SingularityError, UnsupportedError
from leg_dynamics.mechanism.constrained import ConstrainedDynamics
from leg_dynamics.mechanism.mechanism import Mechanism

ALGORITHMS = ("constraintDynamics", "lcaba")
# Relative to 1 + the largest acceleration. Reached: OmniLeg 1e-11, regular synthetic loops 1e-13.
TIGHT = 1e-10


def worst(mechanism, states, algorithm, seed=0):
    rng = np.random.default_rng(seed)
    constrained = ConstrainedDynamics(mechanism)
    error = 0.0
    for y in states:
        state = mechanism.close(y)
        v, tau = rng.normal(scale=2, size=mechanism.n), rng.normal(scale=5, size=len(mechanism.actuated))
        force, gravity = rng.normal(scale=20, size=3), rng.normal(scale=9.81, size=3)
        expected = mechanism.acceleration(state, v, tau, force, gravity)
        got = constrained.acceleration(state, v, tau, force, gravity, algorithm)
        error = max(error, float(np.abs(got - expected).max() / (1 + np.abs(expected).max())))
    return error


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_omnileg(omnileg, omnileg_box, algorithm):
    rng = np.random.default_rng(1)
    states = [np.zeros(3), np.array([0.3, 0.2, 0.0]), *rng.uniform(*omnileg_box, (20, 3))]
    assert worst(omnileg, states, algorithm) < TIGHT


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("kind", ["revolute", "continuous", "spherical", "fixed"])
def test_random_loops(lab, kind, algorithm):
    mechanism = lab.closed_mechanism(kind, 0)
    assert worst(mechanism, [mechanism.seeds[0].y + step for step in (0.0, 0.01, -0.02)], algorithm) < TIGHT


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "gears", "open_chain", "rough"])
def test_synthetic_mechanisms(lab, name, algorithm):
    text, foot = {
        "four_bar": (lambda: lab.FourBar().text(kind="continuous").motor("rocker", 6.0, 1e-3), "coupler_link"),
        "rough": (lambda: lab.FourBar().text(damping=0.3, friction=0.2), "coupler_link"),
        "slider_crank": (lab.slider_crank, "rod_link"),
        "gears": (lab.gears, "foot"),
        "open_chain": (lab.open_chain, "foot"),
    }[name]
    mechanism = Mechanism(parse(text().xml), foot, "hip" if name == "open_chain" else None)
    assert worst(mechanism, [mechanism.seeds[0].y + step for step in (0.0, 0.1, 0.3)], algorithm) < TIGHT


@pytest.mark.parametrize("scale", [1e-2, 1e2])
def test_size_does_not_matter(lab, scale):
    mechanism = Mechanism(parse(lab.FourBar().text(scale=scale).xml), "coupler_link")
    for algorithm in ALGORITHMS:
        # The bodies keep their decimetre inertias: millimetre levers cost lcaba three digits.
        assert worst(mechanism, [np.array([0.9])], algorithm) < 1e-8


@pytest.mark.parametrize("kind", ["prismatic", "planar", "universal"])
def test_pairs_that_pinocchio_lacks_are_refused(lab, kind):
    with pytest.raises(UnsupportedError, match=f"'closing' is {kind}: .*use the projected"):
        ConstrainedDynamics(lab.closed_mechanism(kind, 0))


def test_unknown_algorithms_are_refused(omnileg):
    state = omnileg.close(np.zeros(3))
    with pytest.raises(UnsupportedError, match="'constraintDynamics' or 'lcaba', got 'magic'"):
        ConstrainedDynamics(omnileg).acceleration(state, np.zeros(3), np.zeros(3), algorithm="magic")


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_massless_motions_are_a_singularity_error(lab, algorithm):
    text = lab.Text().joint("a", "revolute", "base", "arm").joint("b", "revolute", "arm", "tip", (1, 0, 0), mass=0.0)
    mechanism = Mechanism(parse(text.xml))
    with pytest.raises(SingularityError, match="no finite acceleration"):
        ConstrainedDynamics(mechanism).acceleration(
            mechanism.close(np.zeros(2)), np.zeros(2), np.ones(2), algorithm=algorithm
        )


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_an_answer_that_opens_the_loops_is_not_returned(omnileg, monkeypatch, algorithm):
    from leg_dynamics.mechanism import constrained

    monkeypatch.setattr(constrained, "PROXIMAL_ITERATIONS", 1)
    monkeypatch.setattr(constrained, "PROXIMAL_SHARE", 1e4)
    state = omnileg.close(np.array([0.3, 0.2, 0.5]))
    with pytest.raises(SingularityError, match=r"did not converge .*open the loops"):
        ConstrainedDynamics(omnileg).acceleration(state, np.ones(3), np.ones(3), algorithm=algorithm)


def test_without_loops_the_interpreter_survives(lab):
    """A wrong order of pinocchio's calls ends the process, so another process tries it."""
    script = f"""
import numpy as np
from leg_dynamics.description import parse
from leg_dynamics.mechanism.constrained import ConstrainedDynamics
from leg_dynamics.mechanism.mechanism import Mechanism
for text in ({lab.open_chain().xml!r}, {lab.gears().xml!r}):
    mechanism = Mechanism(parse(text))
    constrained = ConstrainedDynamics(mechanism)
    state = mechanism.seeds[0]
    n = mechanism.n
    for algorithm in {ALGORITHMS!r}:
        print(constrained.acceleration(state, np.ones(n), np.ones(n), algorithm=algorithm))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split("\n")) == 5


def test_several_threads_share_one_object(omnileg, omnileg_box):
    constrained = ConstrainedDynamics(omnileg)
    states = [omnileg.close(y) for y in np.random.default_rng(2).uniform(*omnileg_box, (40, 3))]

    def solve(state):
        return constrained.acceleration(state, np.ones(3), state.y)

    alone = [solve(state) for state in states]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(solve, states))
    np.testing.assert_allclose(together, alone, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("v", "tau"), [(1e200, 0.0), (0.0, 1e308)])
def test_overflow_is_not_called_a_singularity(omnileg, v, tau):
    state = omnileg.close(np.array([0.1, 0.2, 0.3]))
    solver = ConstrainedDynamics(omnileg)
    with pytest.raises(NonFiniteError, match="too large"):
        solver.acceleration(state, np.full(3, v), np.full(3, tau))
    assert np.isfinite(solver.acceleration(state, np.full(3, min(v, 1.0)), np.full(3, min(tau, 1.0)))).all()
