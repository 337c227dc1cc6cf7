"""What verdicts on the OmniLeg are computed from: the mechanism assembled from its file, and the formulas on arrays.

The two share nothing. Facts are poses by plain forward kinematics of the numerically assembled tree and differences of
poses; formulas are those of `closed_form.omnileg`, as corrected.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from leg_dynamics.papers.comparison import EXACT
from leg_dynamics.papers.framework import Context
from leg_dynamics.papers.mechanism import Assembled, array
from leg_dynamics.papers.omnileg import printed
from leg_dynamics.verification.first_principles import gradient, slope

__all__ = [
    "FEW",
    "FORCE_TOLERANCE",
    "POSITION_TOLERANCE",
    "RATE_TOLERANCE",
    "STATES",
    "TEST_POSE",
    "Assembled",
    "array",
    "assembled",
    "body_of",
    "centre_of",
    "com",
    "formula",
    "lagrange_torque",
    "mass_matrix_of",
    "motions",
    "omega_of",
    "states",
]

Array = np.ndarray

POSITION_TOLERANCE = EXACT
"""m, rad: both sides are exact, the numeric closure stops at about 1e-13."""

RATE_TOLERANCE = 1e-8
"""m/rad, 1: fourth-order differences of poses with a step of 1e-4 rad."""

FORCE_TOLERANCE = 1e-7
"""N·m, N: likewise."""

TEST_POSE = np.radians([30.0, 20.0, 40.0])
STATES = 160
FEW = 40
"""States for what the numeric route computes row by row."""


# The independent facts.


def states(context: Context) -> Array:
    """States of the verdicts: the test pose, the corners of the box of joint limits, then random ones, (N, 3) rad."""
    return np.concatenate([TEST_POSE[None], context.grid(2), context.q[:STATES]])


def assembled(context: Context) -> Assembled:
    """The assembled mechanism at `states`."""
    return context.once("equations: assembled", lambda: Assembled(context.pinocchio, states(context)))


def lagrange_torque(mass_matrix: Callable[[Array], Array], q: Array, v: Array, a: Array) -> Array:
    """Inertial torque of a kinetic energy 1/2 v'M(q)v by Lagrange's equations with numeric derivatives, (N, 3)."""
    M_rate = slope(mass_matrix, q, v)
    partial = gradient(mass_matrix, q)
    return (
        np.einsum("nij,nj->ni", mass_matrix(q), a)
        + np.einsum("nij,nj->ni", M_rate, v)
        - 0.5 * np.einsum("ni,nijk,nj->nk", v, partial, v)
    )


# The corrected formulas on arrays.


def formula(context: Context, name: str, q: Array, *others: Any, leg: bool = True) -> Array:
    """A formula of `closed_form.omnileg` at states q, as an array."""
    arguments = [tuple(np.moveaxis(other, -1, 0)) if isinstance(other, np.ndarray) else other for other in (q, *others)]
    function = getattr(context.formulas, name)
    return array(function(context.numbers, *arguments) if leg else function(*arguments), q.shape[:-1])


def motions(context: Context, name: str, q: Array) -> Any:
    """Motions of bodies by a formula of `closed_form.omnileg`, with unit rates zero."""
    return getattr(context.formulas, name)(context.numbers, tuple(np.moveaxis(q, -1, 0)), (0.0, 0.0, 0.0))


def omega_of(motion: Any, q: Array) -> Array:
    """Angular influence coefficients of a motion, (N, 3, 3)."""
    return np.swapaxes(array(motion.turning.columns, q.shape[:-1]), -1, -2)


def centre_of(context: Context, motion: Any, body: str, q: Array) -> tuple[Array, Array]:
    """Position and influence coefficients of a body's centre of mass."""
    centre = context.formulas.centre_of_mass(motion, body_of(context, body).com)
    shape = q.shape[:-1]
    return array(centre.position, shape), np.swapaxes(array(centre.columns, shape), -1, -2)


def body_of(context: Context, name: str) -> Any:
    """Mass, centre of mass and tensor of a body."""
    return next(body for body in context.numbers.bodies if body.name == name)


def com(context: Context, name: str) -> Array:
    """Centre of mass in the body's frame, m."""
    return np.array(body_of(context, name).com, dtype=float)


def mass_matrix_of(
    context: Context,
    q: Array,
    *,
    constant_tensors: bool = False,
    replaced: Mapping[str, Callable[[Array], tuple[Array, Array]]] | None = None,
) -> Array:
    """Mass matrix from the bodies' motions, (..., 3, 3).

    Parameters
    ----------
    context : Context
    q : (..., 3) array
    constant_tensors : bool
        Use each tensor as it is in the straight leg, in the hip frame, whatever the pose: (44) literally.
    replaced : dict
        For some bodies another rotation (..., 3, 3) and angular influence coefficients (..., 3, 3).
    """
    shape = q.shape[:-1]
    M = np.zeros((*shape, 3, 3))
    everything = motions(context, "body_motions", q)
    straight = motions(context, "body_motions", np.zeros(3))
    for body in context.numbers.bodies:
        motion = everything[body.name]
        rotation, omega = array(motion.turning.rotation, shape), omega_of(motion, q)
        if replaced and body.name in replaced:
            rotation, omega = replaced[body.name](q)
        if constant_tensors:
            rotation = array(straight[body.name].turning.rotation, ())
        _, v = centre_of(context, motion, body.name, q)
        tensor = rotation @ np.array(body.inertia, dtype=float) @ np.swapaxes(rotation, -1, -2)
        M += printed.mass_matrix([(float(body.mass), tensor, omega, v)])
    return M + np.diag(np.array(context.numbers.rotor_inertia, dtype=float))
