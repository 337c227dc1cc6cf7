"""A leg that is wrong on purpose: what a verdict says about it shows whether the verdict was computed."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np


class Tampered:
    """A leg with its foot off, its passive angles stretched, a mobility of 5 and torques off by 1 N·m."""

    def __init__(self, leg, **changes):
        self._leg = leg
        self._changes = {"foot": 0.01, "angles": 1.2, "mobility": 5, "torque": 1.0} | changes

    def __getattr__(self, name):
        return getattr(self._leg, name)

    def foot_position(self, q, **options):
        p = np.array(self._leg.foot_position(q, **options))
        p[..., 0] += self._changes["foot"] * (1.0 + np.asarray(q)[..., 0])
        return p

    def mobility_report(self, **options):
        report = self._leg.mobility_report(**options)
        return SimpleNamespace(
            mobility=self._changes["mobility"],
            redundant=report.redundant,
            gruebler=report.gruebler,
            poses=report.poses,
        )

    def assemble(self, q, **options):
        factor = self._changes["angles"]
        values = {name: factor * value for name, value in self._leg.assemble(q, **options).items()}
        # Stretched alike, the angles of a U-rod-U chain would still keep the knee parallel.
        return values | {"theta13": factor * values["theta13"]}

    def torque(self, *state, **options):
        return self._leg.torque(*state, **options) + self._changes["torque"]

    def generalized_force(self, *state, **options):
        return self._leg.generalized_force(*state, **options) + self._changes["torque"]


def tamper(context, kind, **changes):
    """A new context whose legs, by both routes, are wrong."""
    wrong = kind("omnileg", samples=context.samples)
    wrong.__dict__.update(leg=Tampered(context.leg, **changes), pinocchio=Tampered(context.pinocchio, **changes))
    return wrong
