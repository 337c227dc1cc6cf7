"""Loop rows: they vanish on closed poses, and their derivatives are those of their values."""

from __future__ import annotations

import numpy as np
import pytest

from leg_dynamics.description import parse
from leg_dynamics.symbolic.closure import Closure, row_arrays, second_derivatives
from leg_dynamics.symbolic.coordinates import reduce_coordinates
from leg_dynamics.symbolic.motion import Motion
from leg_dynamics.symbolic.numbers import Numbers
from leg_dynamics.symbolic.tree import build_tree, characteristic_length


@pytest.fixture(params=["revolute", "continuous", "prismatic", "fixed", "planar", "spherical", "universal"])
def closure(request, lab):
    description = parse(lab.random_loop(request.param, 4))
    coordinates = reduce_coordinates(description)
    tree = build_tree(description, coordinates, Numbers.of(description), None, characteristic_length(description))
    home = np.array([description.home.values[name] for name in coordinates.names])
    return request.param, Closure(description, tree), home


def test_rows_vanish_on_the_closed_pose_and_have_the_pairs_rank(lab, closure):
    kind, rows, home = closure
    for each in (rows.basic, rows.candidates):
        phi, K = row_arrays(each, home[None])
        assert np.abs(phi).max() < 1e-13
        sigma = np.linalg.svd(K[0], compute_uv=False)
        assert (sigma > 1e-9 * sigma[0]).sum() == lab.LOOP_ROWS[kind]


def test_derivatives_off_the_closed_surface(closure):
    _, rows, home = closure
    generator = np.random.default_rng(1)
    u0, rates, accelerations = (
        home + 0.3 * generator.standard_normal(len(home)),
        *generator.standard_normal((2, len(home))),
    )
    step = 1e-4

    def at(t):
        return row_arrays(rows.candidates, (u0 + rates * t + 0.5 * accelerations * t * t)[None])

    (before, _), (here, K), (after, _) = at(-step), at(0.0), at(step)
    assert np.abs(K[0] @ rates - (after - before)[0] / (2 * step)).max() < 1e-5
    split = [[np.array([x]) for x in values] for values in (u0, rates, accelerations)]
    second = np.array([np.asarray(x).reshape(-1)[0] for x in second_derivatives(rows.candidates, Motion(*split))])
    change = (after - 2 * here + before)[0] / step**2
    assert np.abs(second - change).max() < 1e-4 * (1.0 + np.abs(change).max())
