"""Chen & Dong 2021, "Kinematic analysis and simulation of a self-reconfigurable quadruped", reproduced and judged."""

from __future__ import annotations

from leg_dynamics.papers.framework import Context, PaperReport, Progress, whole
from leg_dynamics.papers.framework import reproduce as _reproduce

__all__ = ["PAPER", "reproduce"]

PAPER = (
    "Chen G., Dong H. (2021). The Kinematic Analysis and Simulation of Self-reconfigurable Four-legged Robot. "
    "Machine Building & Automation 2021(2), 95-98. Article 1671-5276(2021)02-0095-04"
)


def reproduce(progress: Progress | None = None, *, seed: int = 0, samples: int = 4000) -> PaperReport:
    """Compute every verdict, plot and table.

    Parameters
    ----------
    progress : callable, optional
        Told what begins and the share that is done.
    seed : int
        Of every random number.
    samples : int
        Random poses that the inverse kinematics is counted over; equations choose their own number.

    Returns
    -------
    PaperReport

    Raises
    ------
    ParameterError
        The seed or the number of samples is not usable.
    """
    samples = whole("samples", samples, 1)
    from leg_dynamics.papers.quadruped import claims, equations, figures, inverse, second, stability

    return _reproduce(
        Context("quadruped_leg", seed=seed, samples=samples),
        (equations, inverse, figures, claims, stability, second),
        paper=PAPER,
        title="The modular quadruped of Chen & Dong 2021, reproduced",
        progress=progress,
    )
