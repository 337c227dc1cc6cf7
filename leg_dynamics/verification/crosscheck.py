"""Independent routes held against each other, and each against finite differences and energy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leg_dynamics.errors import RouteError
from leg_dynamics.leg import Leg
from leg_dynamics.routes import has_closed_form, load
from leg_dynamics.verification.perturbation import with_random_inertia
from leg_dynamics.verification.report import Check, CrosscheckReport
from leg_dynamics.verification.states import States, domain, sample_states

__all__ = ["crosscheck", "energy_drift"]

ROUTE_TOLERANCE = 1e-9
DIFFERENCE_TOLERANCE = 1e-6
ENERGY_TOLERANCE = 1e-9
DIFFERENCE_STEP = 1e-4
DIFFERENCE_SAMPLES = 50
SWING_SECONDS = 5.0

Progress = Callable[[str, float], None]


def _relative(first: np.ndarray, second: np.ndarray, axes: int) -> np.ndarray:
    """Largest |difference| of each row relative to 1 + the row's magnitude; NaN differences stay NaN."""
    first, second = np.asarray(first), np.asarray(second)
    over = tuple(range(-axes, 0)) if axes else ()
    difference = np.abs(first - second).max(axis=over) if axes else np.abs(first - second)
    size = np.maximum(np.abs(first), np.abs(second))
    return difference / (1.0 + (size.max(axis=over) if axes else size))


def _check(
    group: str, quantity: str, errors: np.ndarray, tolerance: float, leg: Leg, q: np.ndarray, measure: str | None = None
) -> Check:
    ranked = np.where(np.isnan(errors), np.inf, errors)
    row = int(np.argmax(ranked))
    at = {name: float(value) for name, value in zip(leg.joint_names, q[row], strict=True)}
    extra = {} if measure is None else {"measure": measure}
    return Check(group, quantity, float(errors[row]), tolerance, len(errors), at, **extra)


def compare(first: Leg, second: Leg, states: States, group: str, progress: Progress | None = None) -> list[Check]:
    """Every quantity of the interface by two routes at the same states."""
    q, v, a, force, gravity = states.q, states.v, states.a, states.foot_force, states.gravity
    tau = 10.0 * np.sin(np.arange(q.size, dtype=float)).reshape(q.shape)
    quantities: list[tuple[str, int, Callable[[Leg], np.ndarray]]] = [
        ("joint angles that close the loops", 1, lambda leg: np.stack([leg.assemble(q)[n] for n in first.tree_joint_names], -1)),
        ("foot position", 1, lambda leg: leg.foot_position(q)),
        ("foot Jacobian", 2, lambda leg: leg.jacobian(q)),
        ("Jacobian derivative", 2, lambda leg: leg.jacobian_derivative(q, v)),
        ("foot acceleration", 1, lambda leg: leg.foot_acceleration(q, v, a)),
        ("mass matrix", 2, lambda leg: leg.mass_matrix(q)),
        ("bias force", 1, lambda leg: leg.bias(q, v)),
        ("gravity torque, tilted", 1, lambda leg: leg.gravity_torque(q, gravity)),
        ("potential energy", 0, lambda leg: leg.potential_energy(q)),
        ("torque", 1, lambda leg: leg.torque(q, v, a)),
        ("torque with foot force, tilted", 1, lambda leg: leg.torque(q, v, a, force, gravity)),
        ("acceleration", 1, lambda leg: leg.acceleration(q, v, tau, force)),
    ]
    checks = []
    for number, (name, axes, evaluate) in enumerate(quantities):
        if progress is not None:
            progress(f"{group}: {name}", number / len(quantities))
        errors = _relative(evaluate(first), evaluate(second), axes)
        checks.append(_check(group, name, errors, ROUTE_TOLERANCE, first, q))
    return checks


def against_differences(leg: Leg, states: States) -> list[Check]:
    """One route against finite differences and the identities of mechanics."""
    q, v, a = states.q, states.v, states.a
    step = DIFFERENCE_STEP
    group = f"{leg.route}: first principles"
    units = np.eye(len(leg.joint_names))

    def slope(function: Callable[[np.ndarray], np.ndarray], direction: np.ndarray) -> np.ndarray:
        """Fourth-order central difference along a direction."""
        near = function(q + step * direction) - function(q - step * direction)
        far = function(q + 2 * step * direction) - function(q - 2 * step * direction)
        return (8.0 * near - far) / (12.0 * step)

    numeric_jacobian = np.stack([slope(leg.foot_position, unit) for unit in units], axis=-1)
    mass, mass_rate = leg.mass_matrix(q), slope(leg.mass_matrix, v)
    gravity = leg.gravity_torque(q)
    numeric_gravity = np.stack([slope(leg.potential_energy, unit) for unit in units], axis=-1)
    power = np.einsum("...i,...i->...", leg.torque(q, v, a), v)
    energy_rate = (
        np.einsum("...i,...ij,...j->...", v, mass, a)
        + 0.5 * np.einsum("...i,...ij,...j->...", v, mass_rate, v)
        + np.einsum("...i,...i->...", gravity, v)
    )
    # C(q, v) w is the polar form of the quadratic Coriolis force; Mdot - 2C skew means w.(Mdot v - 2 C v) has no
    # symmetric part, which at w = v is v.Mdot v = 2 v.(h - gravity).
    coriolis = leg.bias(q, v) - gravity
    skew = np.einsum("...i,...ij,...j->...", v, mass_rate, v) - 2.0 * np.einsum("...i,...i->...", coriolis, v)
    scale = 1.0 + np.abs(np.einsum("...i,...ij,...j->...", v, mass_rate, v))
    asymmetry = np.abs(mass - np.swapaxes(mass, -1, -2)).max(axis=(-2, -1))
    smallest = np.linalg.eigvalsh(mass)[..., 0]
    not_positive = np.where(smallest > 0.0, 0.0, np.inf)
    roundtrip = leg.acceleration(q, v, leg.torque(q, v, a, states.foot_force), states.foot_force)
    return [
        _check(group, "J against differences", _relative(leg.jacobian(q), numeric_jacobian, 2), DIFFERENCE_TOLERANCE, leg, q),
        _check(
            group,
            "Jdot against differences",
            _relative(leg.jacobian_derivative(q, v), slope(leg.jacobian, v), 2),
            DIFFERENCE_TOLERANCE,
            leg,
            q,
        ),
        _check(
            group, "gravity against potential", _relative(gravity, numeric_gravity, 1), DIFFERENCE_TOLERANCE, leg, q
        ),
        _check(group, "power balance", _relative(power, energy_rate, 0), DIFFERENCE_TOLERANCE, leg, q),
        _check(group, "Mdot - 2C skew", np.abs(skew) / scale, DIFFERENCE_TOLERANCE, leg, q),
        _check(group, "mass matrix symmetric", asymmetry, 1e-12, leg, q, "absolute"),
        _check(group, "mass matrix positive", not_positive, 0.0, leg, q, "0 where the smallest eigenvalue is positive"),
        _check(group, "acceleration of torque", _relative(roundtrip, a, 1), ROUTE_TOLERANCE, leg, q),
    ]


def energy_drift(leg: Leg, q0: np.ndarray, v0: np.ndarray, seconds: float = SWING_SECONDS) -> float:
    """Largest change of total energy over an undriven swing, relative to the energy exchanged.

    Integrated by scipy's DOP853 at a relative tolerance of 1e-12; what remains is the route's own inconsistency.

    Parameters
    ----------
    leg : Leg
    q0, v0 : (n,) array
    seconds : float
    """
    from scipy.integrate import solve_ivp

    n = len(leg.joint_names)
    idle = np.zeros(len(leg.actuator_names))

    def field(_: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[n:], leg.acceleration(state[:n], state[n:], idle)])

    solution = solve_ivp(field, (0.0, seconds), np.concatenate([q0, v0]), method="DOP853", rtol=1e-12, atol=1e-12)
    if not solution.success:
        return float("nan")
    q, v = solution.y[:n].T, solution.y[n:].T
    kinetic = leg.kinetic_energy(q, v)
    total = kinetic + leg.potential_energy(q)
    return float(np.abs(total - total[0]).max() / max(float(kinetic.max()), 1e-12))


def crosscheck(
    leg: str | Leg,
    samples: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
    **load_options: object,
) -> CrosscheckReport:
    """Hold the routes of a leg against each other and against first principles.

    Parameters
    ----------
    leg : str or Leg
        A shipped name or anything `leg_dynamics.load` takes, or a loaded leg.
    samples : int
        Random states, with the corners of the domain and near-zero coordinates among them.
    seed : int
    progress : callable, optional
        Called with (what is being checked, share done in 0..1).
    **load_options
        Passed to `leg_dynamics.load`.

    Returns
    -------
    CrosscheckReport
        ``.passed``, ``.worst``, ``.checks``; prints as a table with rich.

    Raises
    ------
    RouteError
        `samples` is not positive.
    """
    if samples < 1:
        raise RouteError(f"samples must be at least 1, got {samples}")

    def tell(what: str, share: float) -> None:
        if progress is not None:
            progress(what, share)

    source = leg if isinstance(leg, str) else None
    given = load(leg, **load_options) if isinstance(leg, str) else leg  # type: ignore[arg-type]
    name = source if source is not None else given.name
    legs = [given]
    if given.route != "pinocchio":
        from leg_dynamics.routes import sibling

        legs.append(sibling(given, "pinocchio"))
    elif has_closed_form(name) and given.foot == "foot":
        from leg_dynamics.routes import sibling

        legs.insert(0, sibling(given, "closed_form", name))

    states = sample_states(domain(legs[0]), samples, seed)
    checks: list[Check] = []
    if len(legs) == 2:
        first, second = legs
        group = f"{first.route} against {second.route}"
        checks += compare(first, second, states, group, lambda what, share: tell(what, 0.4 * share))
        text = with_random_inertia(first.description, seed)
        from leg_dynamics.routes import with_text

        checks += compare(
            with_text(first, text),
            with_text(second, text),
            states,
            f"{group}, random inertias",
            lambda what, share: tell(what, 0.4 + 0.4 * share),
        )
    for number, one in enumerate(legs):
        tell(f"{one.route}: first principles", 0.8 + 0.1 * number)
        checks += against_differences(one, states.first(min(samples, DIFFERENCE_SAMPLES)))
        lower, upper = domain(one)
        start = 0.5 * (lower + upper) + 0.2 * (upper - lower) * np.linspace(-1.0, 1.0, len(lower))
        drift = energy_drift(one, start, np.zeros(len(lower)))
        at = {joint: float(value) for joint, value in zip(one.joint_names, start, strict=True)}
        quantity = f"energy of a {SWING_SECONDS:g} s free swing"
        measure = "relative to the largest kinetic energy"
        checks.append(Check(f"{one.route}: first principles", quantity, drift, ENERGY_TOLERANCE, 1, at, measure))
    tell("done", 1.0)
    return CrosscheckReport(name, tuple(one.route for one in legs), samples, seed, tuple(checks))
