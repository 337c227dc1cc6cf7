"""Rong et al. 2012, "Design of parallel mechanical leg of six-legged robot", reproduced and judged."""

from __future__ import annotations

from leg_dynamics.papers.framework import Context, PaperReport, Progress, whole
from leg_dynamics.papers.framework import reproduce as _reproduce

__all__ = ["PAPER", "reproduce"]

PAPER = (
    "Rong Y., Jin Z., Qu M. (2012). Design of parallel mechanical leg of six-legged robot. "
    "Optics and Precision Engineering 20(7), 1532-1541. doi:10.3788/OPE.20122007.1532"
)


def reproduce(progress: Progress | None = None, *, seed: int = 0, samples: int = 2000) -> PaperReport:
    """Compute every verdict, plot and table.

    Parameters
    ----------
    progress : callable, optional
        Told what begins and the share that is done.
    seed : int
        Of every random number.
    samples : int
        Random states for those who ask the context for them; workspaces choose their own number.

    Returns
    -------
    PaperReport

    Raises
    ------
    ParameterError
        The seed or the number of samples is not usable.
    """
    samples = whole("samples", samples, 1)
    from leg_dynamics.papers.hexapod_leg import claims, equations, figures, screws, second, study, trends

    return _reproduce(
        Context("hexapod_leg", seed=seed, samples=samples),
        (equations, figures, screws, claims, trends, study, second),
        paper=PAPER,
        title="The hexapod leg of Rong et al. 2012, reproduced",
        progress=progress,
    )
