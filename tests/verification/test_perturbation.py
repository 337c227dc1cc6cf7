from __future__ import annotations

import numpy as np

from leg_dynamics.description import parse
from leg_dynamics.routes import with_text
from leg_dynamics.verification.perturbation import with_random_inertia

Q = np.radians([30.0, 20.0, 40.0])


def test_every_body_gets_another_physical_inertia(closed):
    before, after = closed.description, parse(with_random_inertia(closed.description, 0))
    bodies = [link.name for link in before.links if link.inertial is not None]
    assert len(bodies) >= 25
    for name in bodies:
        old, new = before.link(name).inertial, after.link(name).inertial
        assert new.mass != old.mass
        assert new.origin.xyz != old.origin.xyz
        moments = np.linalg.eigvalsh(new.tensor())
        assert moments[0] > 0.0
        # The triangle inequality, strict for a body with extent in all directions.
        assert moments[0] + moments[1] > moments[2]
        assert min(abs(new.ixy), abs(new.ixz), abs(new.iyz)) > 0.0
        assert np.abs(new.origin.rpy).min() > 0.0


def test_the_seed_decides(closed):
    texts = [with_random_inertia(closed.description, seed) for seed in (1, 1, 2)]
    assert texts[0] == texts[1] != texts[2]


def test_geometry_stays_and_dynamics_change(closed):
    other = with_text(closed, with_random_inertia(closed.description, 4))
    np.testing.assert_array_equal(other.foot_position(Q), closed.foot_position(Q))
    assert np.abs(other.mass_matrix(Q) - closed.mass_matrix(Q)).max() > 1e-2


def test_massless_links_stay_massless():
    text = """<robot name='r'><link name='a'/><link name='b'/>
      <joint name='j' type='fixed'><parent link='a'/><child link='b'/></joint></robot>"""
    after = parse(with_random_inertia(parse(text), 0))
    assert all(link.inertial is None for link in after.links)
