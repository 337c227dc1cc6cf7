"""One random mechanism by two routes at random states: what agrees, what is refused by name, and what must not be."""

from __future__ import annotations

import importlib.util
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings

import leg_dynamics as ld
from leg_dynamics.errors import LegDynamicsError, LegDynamicsWarning, RowError, SingularityError

ROUTES = ("pinocchio", "symbolic")
TOLERANCE = 1e-8
BATCH = 50
# Of the loops' rows in the test's own kinematics, m or rad.
CLOSED = 1e-8
# Condition of a mass matrix with unit diagonal.
MASSLESS = 1e12
# Of a sum of forces, relative to its largest term.
ROUNDING = 1e-12
ROWS = 3
# From home, rad or m.
SPREAD = {"m": 0.03, "rad": 0.2}
METHODS = ("assemble", "mass_matrix", "bias", "generalized_force", "acceleration", "torque")
# What a mechanism must have by both routes to count as computed; efforts exist for the right actuators only.
NEEDED = ("assemble", "mass_matrix", "bias", "generalized_force")
_SYMBOLIC = Path(__file__).parents[1] / "symbolic"


def _module(name: str) -> Any:
    """A helper of the symbolic route's tests, by the name under which they know each other."""
    full = f"symbolic_{name}"
    if full not in sys.modules:
        spec = importlib.util.spec_from_file_location(full, _SYMBOLIC / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[full] = module
        spec.loader.exec_module(module)
    return sys.modules[full]


oracle, mechanisms = map(_module, ("oracle", "mechanisms"))


def plans_of(batch: int, most: int = 3) -> list[Any]:
    """A batch's plans of at most so many blocks, always the same; without the first one, which is the simplest."""
    found: list[Any] = []

    @seed(batch)
    @settings(
        max_examples=BATCH + 1,
        phases=[Phase.generate],
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(mechanisms.wild_plans(most))
    def collect(plan: Any) -> None:
        found.append(plan)

    collect()
    assert len(found) > BATCH
    # Numbers of their own: Hypothesis is fond of a few.
    return [replace(plan, seed=BATCH * batch + k) for k, plan in enumerate(found[1 : BATCH + 1])]


class BrokenPromiseError(AssertionError):
    """Routes disagree, a number is not finite without an error, or an error is not one of the package's."""


@dataclass
class Verdict:
    """What became of a mechanism."""

    computed: bool = False
    """Whether both routes computed all that is `NEEDED`, at one state or more."""
    agreed: list[str] = field(default_factory=list)
    """Methods that were compared at one state or more."""
    refused: list[str] = field(default_factory=list)
    """``route method class`` of the errors."""
    alone: list[str] = field(default_factory=list)
    """``method class`` where one route refuses a state that the other computes."""
    left: bool = False
    """Whether the symbolic route left states to the numeric one, so that their agreement says nothing."""
    worst: float = 0.0
    """Largest disagreement, relative to 1 + magnitude; of `magnified` accelerations that of the forces."""
    magnified: int = 0
    """Accelerations that differ by what an almost singular mass matrix makes of rounding."""


def _load(text: str, foot: str | None, route: str) -> Any:
    try:
        return ld.load(text, route=route, foot=foot)
    except LegDynamicsError as error:
        return error


def _arguments(leg: Any, generator: np.random.Generator, y: np.ndarray) -> dict[str, tuple[Any, ...]]:
    count, n = y.shape
    v, a = generator.uniform(-2.0, 2.0, (count, n)), generator.uniform(-5.0, 5.0, (count, n))
    tau = generator.uniform(-3.0, 3.0, (count, len(leg.actuator_names)))
    force = generator.uniform(-10.0, 10.0, (count, 3)) if leg.foot else None
    gravity = generator.uniform(-10.0, 10.0, (count, 3))
    return {
        "assemble": (y,),
        "mass_matrix": (y,),
        "bias": (y, v, gravity),
        "generalized_force": (y, v, a, force, gravity),
        "acceleration": (y, v, tau, force, gravity),
        "torque": (y, v, a, force, gravity),
    }


def _row(arguments: tuple[Any, ...], row: int) -> tuple[Any, ...]:
    return tuple(None if each is None else each[row] for each in arguments)


def _array(leg: Any, result: Any) -> np.ndarray:
    if isinstance(result, dict):
        return np.stack([result[name] for name in sorted(result)], axis=-1)
    return np.asarray(result)


def _call(leg: Any, method: str, arguments: tuple[Any, ...]) -> tuple[np.ndarray | None, list[Exception | None]]:
    """A batch's result, and the error of each row; no result where the whole call is refused."""
    function = getattr(leg, method)
    count = len(arguments[0])
    try:
        result = _array(leg, function(*arguments, on_error="nan")).reshape(count, -1)
    except LegDynamicsError as error:
        return None, [error] * count
    errors: list[Exception | None] = [None] * count
    for row in range(count):
        finite = bool(np.isfinite(result[row]).all())
        if finite and row:
            continue
        try:
            single = _array(leg, function(*_row(arguments, row))).reshape(-1)
        except LegDynamicsError as error:
            if finite:
                raise BrokenPromiseError(
                    f"{method} by {leg.route}: row {row} is computed in a batch and refused alone: {error}"
                ) from error
            errors[row] = error
            continue
        if not np.isfinite(single).all():
            raise BrokenPromiseError(f"{method} by {leg.route}: row {row} is {single} without an error")
        if not finite:
            raise BrokenPromiseError(f"{method} by {leg.route}: row {row} is NaN in a batch and computed alone")
        if difference(single, result[row]) > TOLERANCE:
            raise BrokenPromiseError(f"{method} by {leg.route}: row {row} in a batch {result[row]}, alone {single}")
    return result, errors


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of two arrays, relative to 1 + magnitude."""
    return float(np.abs(one - other).max(initial=0.0) / (1.0 + np.abs(other).max(initial=0.0)))


def states_of(leg: Any, generator: np.random.Generator, count: int = ROWS) -> np.ndarray:
    """Independent coordinates near the file's home, (count, n)."""
    home = leg.description.home
    values = {} if home is None else home.values
    start = np.array([values.get(name, 0.0) for name in leg.joint_names])
    spread = np.array([SPREAD[unit] for unit in leg.units.joints])
    return start + spread * generator.uniform(-1.0, 1.0, (count, len(spread)))


def check(
    text: str,
    foot: str | None,
    number: int,
    change: Callable[[str, str, np.ndarray], np.ndarray] | None = None,
) -> Verdict:
    """Compare the routes on a mechanism.

    Parameters
    ----------
    text : str
        URDF+.
    foot : str or None
        Its foot link.
    number : int
        Of the random states.
    change : callable, optional
        Takes a route, a method and its result, and returns another: to prove that this test can fail.

    Raises
    ------
    BrokenPromiseError
        Something is wrong or silent; any other exception that is no `LegDynamicsError` passes through.
    """
    with warnings.catch_warnings():
        # NumPy's warnings are the errors of a library.
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", LegDynamicsWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        return _check(text, foot, number, change)


def _check(text: str, foot: str | None, number: int, change: Any) -> Verdict:
    verdict = Verdict()
    legs = [_load(text, foot, route) for route in ROUTES]
    for route, leg in zip(ROUTES, legs, strict=True):
        if isinstance(leg, Exception):
            verdict.refused.append(f"{route} load {type(leg).__name__}")
    working = [leg for leg in legs if not isinstance(leg, Exception)]
    if not working:
        return verdict
    if len(working) == 2 and working[0].joint_names != working[1].joint_names:
        raise BrokenPromiseError(f"independent joints {working[0].joint_names} and {working[1].joint_names}")
    _check_exact(working)
    generator = np.random.default_rng([number, 3])
    y = states_of(working[0], generator)
    arguments = _arguments(working[0], generator, y)
    for method in METHODS:
        results = []
        for leg in working:
            result, errors = _call(leg, method, arguments[method])
            if change is not None and result is not None:
                result = change(leg.route, method, result)
            if result is not None and (finite := np.isfinite(result).all(axis=1)).any() and method == "assemble":
                _check_closed(text, leg, arguments[method][0][finite])
            results.append((result, errors))
            verdict.refused += [
                f"{leg.route} {method} {name}" for name in sorted({type(e).__name__ for e in errors if e is not None})
            ]
        if len(working) == 2 and y.shape[0]:
            _compare(method, results, verdict, lambda row: _mass(working[0], y[row]))
    verdict.computed = set(NEEDED) <= set(verdict.agreed)
    symbolic = next((leg for leg in working if leg.route == "symbolic"), None)
    verdict.left = symbolic is not None and "fallback" in vars(symbolic.backend)
    return verdict


def _compare(method: str, results: list[Any], verdict: Verdict, mass_matrix: Callable[[int], np.ndarray]) -> None:
    (one, errors), (other, others) = results
    for row in range(len(errors)):
        refusals = [errors[row], others[row]]
        if all(error is None for error in refusals):
            worst = difference(one[row], other[row])
            if method == "acceleration" and worst > TOLERANCE:
                worst = _magnified(*mass_matrix(row), one[row], other[row])
                verdict.magnified += 1
            verdict.worst = max(verdict.worst, worst)
            if not worst <= TOLERANCE:
                raise BrokenPromiseError(
                    f"{method}: row {row} is {one[row]} by {ROUTES[0]} and {other[row]} by {ROUTES[1]}, "
                    f"{worst:.3g} apart"
                )
            if method not in verdict.agreed:
                verdict.agreed.append(method)
        elif any(error is None for error in refusals):
            if method == "acceleration" and any(isinstance(error, SingularityError) for error in refusals):
                _check_regular(*mass_matrix(row), ROUTES[refusals.index(None)])
            verdict.alone += [
                f"{route} {method} {type(error).__name__}"
                for route, error in zip(ROUTES, refusals, strict=True)
                if error is not None
            ]
        elif not all(isinstance(error, RowError) for error in refusals) and type(errors[row]) is not type(others[row]):
            verdict.alone.append(f"{method} {type(errors[row]).__name__} {type(others[row]).__name__}")


def _mass(leg: Any, y: np.ndarray) -> tuple[np.ndarray, float]:
    """The mass matrix at a pose, and how many times larger what cancels in it is than what is left."""
    mechanism = leg.backend.mechanism
    return leg.mass_matrix(y), mechanism.cancellation(mechanism.close(y))


def _magnified(M: np.ndarray, cancelled: float, one: np.ndarray, other: np.ndarray) -> float:
    """Difference of the forces that two accelerations need, relative to the largest of the sums' terms.

    Both solve their equations to rounding, and the mass matrix's condition, or what cancels in it, explains why they
    differ: else infinity.
    """
    sizes = np.maximum(np.abs(one), np.abs(other))
    forces = np.abs(M @ (one - other)).max() / (1.0 + (np.abs(M) @ sizes).max())
    explained = difference(one, other) <= ROUNDING * np.linalg.cond(M) * cancelled
    return float(forces) * TOLERANCE / ROUNDING if explained else np.inf


def _check_regular(M: np.ndarray, cancelled: float, route: str) -> None:
    """A mass matrix that one route calls singular may be nearly so; it must not have a motion without mass.

    Unless digits cancel in the numbers of one route that the other simplifies first.
    """
    if cancelled * ROUNDING > TOLERANCE:
        return
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / np.sqrt(np.diagonal(M))
        unit = M * np.outer(scale, scale)
    if not (np.isfinite(unit).all() and np.linalg.cond(unit) < MASSLESS):
        raise BrokenPromiseError(f"acceleration by {route} in spite of a singular mass matrix\n{M}")


def _check_exact(working: list[Any]) -> None:
    """Numbers with all digits are not taken for rounded ones."""
    for leg in working:
        # Of the other routes this would wake the numeric one.
        if leg.route == "pinocchio":
            try:
                gap = leg.loop_gap
            except LegDynamicsError:
                continue
            if gap:
                raise BrokenPromiseError(f"the loops are taken for rounded, with a gap of {gap:.3g}")


def _check_closed(text: str, leg: Any, y: np.ndarray) -> None:
    """The loops hold in kinematics that share nothing with the package, and the independent joints are where asked."""
    own = oracle.Oracle(text, leg.joint_names)
    tree = leg.assemble(y)
    q = np.stack([np.broadcast_to(tree[name], len(y)) for name in own.names], axis=-1)
    for row in range(len(y)):
        values, _ = own.rows(q[row])
        off = float(np.abs(values).max(initial=0.0))
        if not off <= CLOSED or own.opposed(q[row]):
            raise BrokenPromiseError(f"assemble by {leg.route}: loops are open by {off:.3g} at {y[row]}")
        if np.abs(q[row][own.y] - y[row]).max(initial=0.0) > CLOSED:
            raise BrokenPromiseError(f"assemble by {leg.route}: independent joints {q[row][own.y]}, asked {y[row]}")
