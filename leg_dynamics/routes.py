"""The composition root: which file, which route, and the leg that they make."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from leg_dynamics.errors import RouteError
from leg_dynamics.leg import Leg, Route

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description

__all__ = ["ROUTES", "available", "load", "rebuild_with_parameters"]

ROUTES = ("closed_form", "pinocchio")


def available() -> tuple[str, ...]:
    """Names of the shipped legs and robots."""
    from leg_dynamics.description import shipped_names

    return shipped_names()


def has_closed_form(name: str) -> bool:
    """Whether hand-derived formulas of that leg exist."""
    return name.isidentifier() and importlib.util.find_spec(f"leg_dynamics.closed_form.{name}") is not None


def load(
    source: str,
    route: str | None = None,
    *,
    urdf: str | None = None,
    foot: str | None = None,
    parameters: Mapping[str, float] | None = None,
) -> Leg:
    """Load a leg.

    Parameters
    ----------
    source : str
        A shipped name (see `available`), a path to a .urdf or .xacro file, or XML text.
    route : {"closed_form", "pinocchio"}, optional
        What computes. Default: ``closed_form`` where the leg has formulas, else ``pinocchio``.
    urdf : str, optional
        With a shipped name: use that leg's formulas with this file's geometry, masses and inertias.
    foot : str, optional
        Link whose origin is the foot; default is the link named ``foot`` where there is one.
    parameters : mapping of str to float, optional
        Parameter overrides of an xacro source. Rendering xacro evaluates Python from the file: only render
        sources that you trust. Plain .urdf files are data.

    Returns
    -------
    Leg

    Raises
    ------
    LegNotFoundError
        Neither a shipped name nor a file.
    DescriptionError
        The file is not a valid mechanism; says where.
    RouteError
        The route does not exist for this leg.
    FormulaAssumptionError
        The file breaks an assumption of the leg's formulas.
    ParameterError
        A parameter is unknown or not a finite number.
    """
    from leg_dynamics.description import read, shipped_names

    named = str(source) if str(source) in shipped_names() else None
    if urdf is not None and named is None:
        raise RouteError(f"urdf= goes with a shipped name, one of {', '.join(shipped_names())}; got {source!r}")
    description = read(str(source) if urdf is None else str(urdf), parameters=parameters)
    formulas = named if named is not None and has_closed_form(named) else None
    if route is None:
        route = "closed_form" if formulas is not None else "pinocchio"
    if route not in ROUTES:
        raise RouteError(f"route {route!r} does not exist: choose one of {', '.join(ROUTES)}")
    if route == "closed_form" and formulas is None:
        raise RouteError(f"{source!r} has no closed-form formulas; use route='pinocchio'")
    return _build(description, route, formulas, foot)


def _build(description: Description, route: str, formulas: str | None, foot: str | None) -> Leg:
    if foot is None and description.has_link("foot"):
        foot = "foot"
    if foot is not None:
        description.link(foot)
    hip = "hip" if description.has_link("hip") else None
    backend: Route
    if route == "closed_form":
        from leg_dynamics.closed_form.route import ClosedFormRoute

        assert formulas is not None
        if foot != "foot":
            raise RouteError(f"the formulas of {formulas!r} know one foot, the link 'foot'; got {foot!r}")
        backend = ClosedFormRoute(formulas, description)
    else:
        from leg_dynamics.mechanism.route import PinocchioRoute

        backend = PinocchioRoute(description, foot, hip)
    return Leg(backend, description, foot, (_build, (description, route, formulas, foot)))


def rebuild_with_parameters(rebuild: tuple[Any, ...], parameters: Mapping[str, float]) -> Leg:
    """Return the leg that `rebuild` describes, rendered again with some parameters changed."""
    from leg_dynamics.description import read

    _, (description, route, formulas, foot) = rebuild
    changed = {name: p.value for name, p in description.parameters.items()} | dict(parameters)
    return _build(read(description.source, parameters=changed), route, formulas, foot)


def sibling(leg: Leg, route: str, formulas: str | None = None) -> Leg:
    """Return the same file by another route."""
    _, (description, _, own, foot) = leg.__reduce__()
    return _build(description, route, formulas if formulas is not None else own, foot)


def with_text(leg: Leg, urdf: str) -> Leg:
    """Return the same route and formulas on another mechanism text."""
    from leg_dynamics.description import parse

    _, (_, route, formulas, foot) = leg.__reduce__()
    return _build(parse(urdf), route, formulas, foot)
