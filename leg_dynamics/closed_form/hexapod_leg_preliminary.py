"""The hexapod leg of the paper's section 4.1: the formulas of `hexapod_leg`, whose names it offers under its own."""

from __future__ import annotations

from leg_dynamics.closed_form.hexapod_leg import *  # noqa: F403
