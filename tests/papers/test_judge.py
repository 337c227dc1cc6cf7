"""How a status follows from differences."""

from __future__ import annotations

import math

import pytest

from leg_dynamics.papers.framework import Status
from leg_dynamics.papers.judge import judge, text, within, worst


@pytest.mark.parametrize(
    ("off", "left", "explained", "status"),
    [
        (1e-12, None, None, Status.CONFIRMED),
        (1e-12, 1.0, 1.0, Status.CONFIRMED),
        (1e-9, 1.0, 1.0, Status.CONFIRMED),
        ([1e-12, -1e-12], None, None, Status.CONFIRMED),
        (1.0, 1e-12, 1e-12, Status.CORRECTED),
        ([0.0, math.nan], [0.0, 0.0], 0.0, Status.CORRECTED),
        # A form that merely differs is not understood.
        (1.0, 1e-12, None, Status.NOT_REPRODUCIBLE),
        (1.0, 1e-12, 1.0, Status.NOT_REPRODUCIBLE),
        (1.0, 1e-12, math.nan, Status.NOT_REPRODUCIBLE),
        (1.0, 1e-12, [], Status.NOT_REPRODUCIBLE),
        (1.0, None, 1e-12, Status.NOT_REPRODUCIBLE),
        (1.0, 1.0, 1e-12, Status.NOT_REPRODUCIBLE),
        ([0.0, -1.0], None, None, Status.NOT_REPRODUCIBLE),
        ([0.0, math.nan], [0.0, math.nan], 0.0, Status.NOT_REPRODUCIBLE),
        ([], None, None, Status.NOT_REPRODUCIBLE),
    ],
)
def test_judge(off, left, explained, status):
    assert judge(off, 1e-9, corrected=left, explained=explained) is status


def test_helpers():
    assert worst([0.1, -0.2]) == 0.2
    assert math.isnan(worst([0.1, math.nan]))
    assert within([-1.0, 1.0], 1.0)
    assert not within([], 1.0)
    assert text(1234.5) == "1.23e+03"
