"""Two routes at the same states, quantity by quantity."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leg_dynamics.description.topology import coupling_equations
from leg_dynamics.errors import RowError
from leg_dynamics.leg import Leg, OnError
from leg_dynamics.verification.report import Check
from leg_dynamics.verification.states import States

__all__ = ["ROUTE_TOLERANCE", "check", "compare", "on_one_sheet", "relative"]

ROUTE_TOLERANCE = 1e-9

Progress = Callable[[str, float], None]
Quantity = Callable[[Leg, States, OnError], np.ndarray]


def relative(first: np.ndarray, second: np.ndarray, axes: int) -> np.ndarray:
    """Largest |difference| over the last `axes` axes, relative to 1 + the largest magnitude there; NaN stays NaN."""
    over = tuple(range(-axes, 0))
    with np.errstate(invalid="ignore"):
        difference = np.abs(first - second).max(axis=over, initial=0.0)
        return difference / (1.0 + np.maximum(np.abs(first), np.abs(second)).max(axis=over, initial=0.0))


def on_one_sheet(leg: Leg, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tree coordinates (N, m) from two sources without whole turns between them, but where couplings count them."""
    coupled = {joint for equation in coupling_equations(leg.description) for joint in equation.coefficients}
    joints = [leg.description.joint(name) for name in leg.tree_joint_names]
    turns = np.array([joint.unit == "rad" and joint.name not in coupled for joint in joints])
    return first, second - 2.0 * np.pi * np.round((second - first) / (2.0 * np.pi)) * turns


def check(
    group: str,
    quantity: str,
    errors: np.ndarray,
    tolerance: float,
    leg: Leg,
    q: np.ndarray,
    measure: str | None = None,
    detail: str = "",
) -> Check:
    """The worst of many rows' errors as one check; NaN is worse than anything."""
    row = int(np.argmax(np.where(np.isnan(errors), np.inf, errors)))
    at = {name: float(value) for name, value in zip(leg.joint_names, q[row], strict=True)}
    extra = {} if measure is None else {"measure": measure}
    return Check(group, quantity, float(errors[row]), tolerance, len(errors), at, detail=detail, **extra)


def _efforts(states: States, leg: Leg) -> np.ndarray:
    """Some actuator efforts for each state, (N, m)."""
    return 10.0 * np.sin(np.arange(len(states) * len(leg.actuator_names), dtype=float)).reshape(len(states), -1)


def kinematic_quantities(has_foot: bool) -> list[tuple[str, int, Quantity]]:
    """Name, number of trailing axes and evaluation of what masses do not change."""
    if not has_foot:
        return []
    return [
        ("foot position", 1, lambda leg, s, e: leg.foot_position(s.q, on_error=e)),
        ("foot Jacobian", 2, lambda leg, s, e: leg.jacobian(s.q, on_error=e)),
        ("Jacobian derivative", 2, lambda leg, s, e: leg.jacobian_derivative(s.q, s.v, on_error=e)),
        ("foot acceleration", 1, lambda leg, s, e: leg.foot_acceleration(s.q, s.v, s.a, on_error=e)),
    ]


def dynamic_quantities(has_foot: bool, square: bool) -> list[tuple[str, int, Quantity]]:
    """Name, number of trailing axes and evaluation of what masses do change; efforts where actuators fix them."""

    def force(states: States) -> np.ndarray | None:
        return states.foot_force if has_foot else None

    quantities: list[tuple[str, int, Quantity]] = [
        ("mass matrix", 2, lambda leg, s, e: leg.mass_matrix(s.q, on_error=e)),
        ("bias force", 1, lambda leg, s, e: leg.bias(s.q, s.v, on_error=e)),
        ("gravity torque, tilted", 1, lambda leg, s, e: leg.gravity_torque(s.q, s.gravity, on_error=e)),
        ("potential energy", 0, lambda leg, s, e: leg.potential_energy(s.q, on_error=e)),
        ("acceleration", 1, lambda leg, s, e: leg.acceleration(s.q, s.v, _efforts(s, leg), force(s), on_error=e)),
    ]
    if not square:
        general: Quantity = lambda leg, s, e: leg.generalized_force(s.q, s.v, s.a, force(s), s.gravity, on_error=e)  # noqa: E731
        quantities.append(("generalized force, tilted", 1, general))
    else:
        quantities += [
            ("torque", 1, lambda leg, s, e: leg.torque(s.q, s.v, s.a, on_error=e)),
            (
                "torque with foot force, tilted",
                1,
                lambda leg, s, e: leg.torque(s.q, s.v, s.a, force(s), s.gravity, on_error=e),
            ),
        ]
    return quantities


def _reason(quantity: Quantity, legs: tuple[Leg, Leg], states: States, errors: np.ndarray) -> str:
    """Why the first row without a number has none."""
    row = int(np.argmax(np.isnan(errors)))
    for leg in legs:
        try:
            quantity(leg, states.take(np.array([row])), "raise")
        except RowError as error:
            return f"{leg.route}: {type(error).__name__}: {error}"
    return "a row fails in the batch and not alone"


def compare(
    first: Leg, second: Leg, states: States, group: str, progress: Progress | None = None, *, kinematics: bool = True
) -> list[Check]:
    """Every quantity of the interface by two routes at the same states.

    Parameters
    ----------
    first, second : Leg
    states : States
    group : str
        What the checks are listed under.
    progress : callable, optional
        Called with (what, share done).
    kinematics : bool
        Whether to compare also what does not depend on masses.
    """
    has_foot = first.foot is not None and second.foot is not None
    square = len(first.actuator_names) == len(first.joint_names)
    quantities = kinematic_quantities(has_foot) if kinematics else []
    quantities = quantities + dynamic_quantities(has_foot, square)
    checks = []
    for number, (name, axes, quantity) in enumerate(quantities):
        if progress is not None:
            progress(f"{group}: {name}", number / len(quantities))
        errors = relative(quantity(first, states, "nan"), quantity(second, states, "nan"), axes)
        detail = _reason(quantity, (first, second), states, errors) if np.isnan(errors).any() else ""
        checks.append(check(group, name, errors, ROUTE_TOLERANCE, first, states.q, detail=detail))
    return checks
