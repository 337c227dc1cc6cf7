"""Xu et al. 2025, "Kinematics and Dynamics Modeling and Experiments of OmniLegs", reproduced and judged."""

from __future__ import annotations

from leg_dynamics.papers.framework import Context, PaperReport, Progress, whole
from leg_dynamics.papers.framework import reproduce as _reproduce

__all__ = ["LEAST_SAMPLES", "PAPER", "reproduce"]

LEAST_SAMPLES = 50
"""With fewer random states some verdicts would have too few bent legs to compare."""

PAPER = (
    "Xu Y., Lu Z., Zhu Y., Luo Z. (2025). Kinematics and Dynamics Modeling and Experiments of OmniLegs. "
    "China Mechanical Engineering 36(4), 811-820. doi:10.3969/j.issn.1004-132X.2025.04.018"
)


def reproduce(progress: Progress | None = None, *, seed: int = 0, samples: int = 2000) -> PaperReport:
    """Compute every verdict, plot and table.

    Parameters
    ----------
    progress : callable, optional
        Told what begins and the share that is done.
    seed : int
        Of the random states.
    samples : int
        Random states inside the joint limits, at least `LEAST_SAMPLES`.

    Returns
    -------
    PaperReport

    Raises
    ------
    ParameterError
        The seed or the number of samples is not usable.
    """
    samples = whole("samples", samples, LEAST_SAMPLES)
    from leg_dynamics.papers.omnileg import (
        claims,
        equations,
        mobility,
        multibody,
        percentages,
        scenarios,
        transmission,
    )

    return _reproduce(
        Context("omnileg", seed=seed, samples=samples),
        (equations, scenarios, claims, mobility, transmission, percentages, multibody),
        paper=PAPER,
        title="The OmniLeg of Xu et al. 2025, reproduced",
        progress=progress,
    )
