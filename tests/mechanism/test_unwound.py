"""Passive angles are those of the pose, whatever way the closure took to it."""

from __future__ import annotations

import math

import numpy as np
import pytest

import leg_dynamics as ld

from ..four_bar import HOME, four_bar, passive


def test_angles_do_not_depend_on_the_row_before():
    # From the first row to the second, Newton's method winds passive angles up by whole turns.
    q = np.array(
        [[0.6586896538, 0.5313366649, 0.8509924425], [0.778274542261016, 0.43613793628043485, 0.7109957191392426]]
    )
    leg, formulas = ld.load("hexapod_leg", route="pinocchio"), ld.load("hexapod_leg")
    together, alone, expected = leg.assemble(q), leg.assemble(q[1]), formulas.assemble(q)
    for name, angles in expected.items():
        np.testing.assert_allclose(together[name], angles, atol=1e-9)
        np.testing.assert_allclose(alone[name], angles[1], atol=1e-9)
    backend = leg.backend
    wound = backend.mechanism.close(q[0]).q + 2.0 * np.pi * np.array(
        [leg.description.joint(name).unit == "rad" for name in backend.tree_joint_names]
    )
    np.testing.assert_allclose(
        backend.mechanism.unwound(wound), [together[n][0] for n in backend.tree_joint_names], atol=1e-9
    )


@pytest.mark.parametrize("limits", [(-50.0, 50.0), (-2.5, 3.0)])
@pytest.mark.parametrize("route", ["pinocchio", "symbolic"])
def test_every_route_gives_the_same_turn(route, limits):
    """By trigonometry: within half a turn of home, or the turn that the limits leave."""
    leg = ld.load(four_bar(limits), route=route)
    crank = np.linspace(1.2, -1.2, 25)
    expected = passive(crank)[0]
    if limits[0] < -2.5:
        home = float(passive(HOME)[0])
        expected = home + np.remainder(expected - home + math.pi, 2.0 * math.pi) - math.pi
    # Both turns occur, and the two rules differ.
    assert expected.min() < (-3.0 if limits[0] < -2.5 else 0.0)
    assert expected.max() > 1.9
    np.testing.assert_allclose(leg.assemble(crank[:, None])["b"], expected, atol=1e-9)
    np.testing.assert_allclose([leg.assemble([a])["b"] for a in crank[::-3]], expected[::-3], atol=1e-9)
