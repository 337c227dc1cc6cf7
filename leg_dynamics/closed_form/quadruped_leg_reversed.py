"""The quadruped's legs whose modules are mounted in reverse order: the formulas of `quadruped_leg` under their name."""

from __future__ import annotations

from leg_dynamics.closed_form.quadruped_leg import *  # noqa: F403
