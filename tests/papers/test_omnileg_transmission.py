from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status, find_verdict
from leg_dynamics.papers.omnileg import transmission


@pytest.fixture(scope="module")
def context():
    return Context("omnileg")


def test_errors_at_the_printed_speed(context):
    found = transmission.study(context)
    np.testing.assert_allclose(1e3 * found.error["paper"][0], (0.0578, 0.0559, 0.0209), atol=1e-4)
    np.testing.assert_allclose(1e3 * found.error["none"][0], (0.0449, 0.0426, 0.0023), atol=1e-4)
    np.testing.assert_allclose(found.error["paper"][-1], 100.0 * found.error["paper"][0], rtol=1e-6)
    # The audit's torques of Fig. 11: M1 at the end of the force, M2 at the start.
    np.testing.assert_allclose(found.peak[0], (2.2758, 3.0, 1.6341), atol=1e-4)
    np.testing.assert_allclose(found.share("paper"), 100.0 * found.error["paper"] / found.peak, rtol=1e-15)
    np.testing.assert_allclose(found.speed_of(4.0 * found.error["none"][0], "none"), 2.0, rtol=1e-14)


def test_curves_are_those_of_the_printed_speed(context):
    found = transmission.study(context)
    assert set(found.curves) == set(transmission.MODELS)
    for name, curve in found.curves.items():
        assert curve.shape == (found.time.size, 3)
        np.testing.assert_allclose(np.abs(curve).max(axis=0), found.error[name][0], rtol=1e-15)


def test_verdicts(context):
    verdicts = [function(context) for function in transmission.VERDICTS]
    statuses = [verdict.status for verdict in verdicts]
    assert statuses == [Status.CONFIRMED, Status.CORRECTED, Status.NOT_REPRODUCIBLE]
    cause = find_verdict(verdicts, "claim: cause of Fig. 11's residual torques")
    ratios = [figure.value for figure in cause.figures if figure.name.startswith("reported over computed")]
    np.testing.assert_allclose(ratios, (36.3, 26.8, 249.0), rtol=5e-3)
    drives = [figure.value for figure in cause.figures if figure.name.startswith("inertia of PL")]
    np.testing.assert_allclose(drives, np.array([2.1e-3, 1.5e-3]) / (np.pi / 6 * (np.pi / 3) ** 2), rtol=1e-4)


def test_a_heavy_shaft_makes_the_neglect_matter(context):
    heavy = Context("omnileg")
    bodies = tuple(
        body._replace(inertia=tuple(tuple(1e4 * x for x in row) for row in body.inertia))
        if body.name == "shaft_A4B4"
        else body
        for body in context.numbers.bodies
    )
    heavy.__dict__["numbers"] = dataclasses.replace(context.numbers, bodies=bodies)
    assert transmission.neglect_is_small(heavy).status is Status.CORRECTED


def test_growth_check_table_and_plots(context):
    assert transmission.growth_is_quadratic(context).passed
    (section,) = transmission.sections(context)
    assert [row[0] for row in section.rows] == [str(speed) for speed in transmission.SPEEDS]
    for plot in transmission.plots(context):
        assert plot.name in section.plots
        assert plot.png(60).startswith(b"\x89PNG")
