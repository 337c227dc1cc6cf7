"""Xu et al. 2025, "Kinematics and Dynamics Modeling and Experiments of OmniLegs", reproduced and judged."""

from __future__ import annotations

from leg_dynamics.papers.framework import Context, PaperReport, Progress
from leg_dynamics.papers.framework import reproduce as _reproduce

__all__ = ["PAPER", "reproduce"]

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
        Random states inside the joint limits.

    Returns
    -------
    PaperReport
    """
    from leg_dynamics.papers.omnileg import claims, equations, multibody, scenarios, transmission

    return _reproduce(
        Context("omnileg", seed=seed, samples=samples),
        (equations, scenarios, claims, multibody, transmission),
        paper=PAPER,
        title="The OmniLeg of Xu et al. 2025, reproduced",
        progress=progress,
    )
