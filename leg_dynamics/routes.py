"""The composition root: which file, which route, and the leg that they make."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from leg_dynamics.errors import FormulaAssumptionError, LegNotFoundError, MissingFootError, ParameterError, RouteError
from leg_dynamics.leg import Leg, Route

if TYPE_CHECKING:
    from leg_dynamics.description.model import Description

__all__ = ["ROUTES", "Recipe", "available", "load", "routes_of", "sibling", "with_text"]

ROUTES = ("closed_form", "pinocchio")


def available() -> tuple[str, ...]:
    """Names of the shipped legs and robots."""
    from leg_dynamics.description import shipped_names

    return shipped_names()


def has_closed_form(name: str) -> bool:
    """Whether hand-derived formulas of that leg exist."""
    from leg_dynamics import closed_form

    return closed_form.find(name) is not None


@dataclass(frozen=True)
class Recipe:
    """What a leg is made of: enough to make it again in another process, by another route or from another file.

    Attributes
    ----------
    description : Description
        The mechanism.
    route : str
        One of `ROUTES`.
    formulas : str or None
        The leg whose formulas fit this mechanism; None where there are none.
    foot : str or None
        Name of the foot link.
    source : str or None
        What the description was read from, as `leg_dynamics.description.read` takes it; None for a bare text.
    overrides : tuple of (str, float)
        The parameter values it was read with.
    transmission : str
        Model of the transmission, one that the formulas offer; every other route knows ``exact`` only.
    """

    description: Description
    route: str
    formulas: str | None
    foot: str | None
    source: str | None = None
    overrides: tuple[tuple[str, float], ...] = ()
    transmission: str = "exact"

    def backend(self) -> Route:
        """The route object."""
        if self.route == "closed_form":
            from leg_dynamics.closed_form.route import ClosedFormRoute

            if self.formulas is None:
                raise RouteError(
                    f"{self.description.name!r} as read from {self.description.file} has no closed-form formulas: use "
                    "route='pinocchio', or load a shipped name with urdf= this file"
                )
            if self.foot is None:
                raise FormulaAssumptionError(
                    f"{self.description.file}: there is no link 'foot', which the formulas of {self.formulas!r} need: "
                    "give the file the leg's link names, or load it by its path with route='pinocchio'",
                    element="foot",
                )
            if self.foot != "foot":
                raise RouteError(
                    f"the formulas of {self.formulas!r} know one foot, the link 'foot', not {self.foot!r}: use "
                    "route='pinocchio'"
                )
            options = {} if self.transmission == "exact" else {"transmission": self.transmission}
            return ClosedFormRoute(self.formulas, self.description, **options)
        if self.transmission != "exact":
            raise RouteError(
                f"transmission {self.transmission!r} is a model of the closed form only, and route {self.route!r} "
                "computes the mechanism as it is: leave transmission out, or use route='closed_form'"
            )
        from leg_dynamics.mechanism.route import PinocchioRoute

        hip = "hip" if self.description.has_link("hip") else None
        return PinocchioRoute(self.description, self.foot, hip)

    def build(self) -> Leg:
        """Make the leg."""
        return Leg(self.backend(), self.description, self.foot, self)

    def with_parameters(self, parameters: Mapping[str, float]) -> Recipe:
        """Return the recipe for the same source with some more parameters changed.

        Raises
        ------
        ParameterError
            A name is unknown, a value is not a finite number, or the source has no parameters.
        """
        from leg_dynamics.description import read

        if self.source is None or not self.description.parameters:
            raise ParameterError(
                f"{self.description.name!r} was read from plain URDF, which has no named parameters to change "
                f"({', '.join(map(str, parameters))}): edit the file, or load the xacro that generates it"
            )
        overrides = dict(self.overrides) | dict(parameters)
        return replace(self, description=read(self.source, parameters=overrides), overrides=tuple(overrides.items()))


def load(
    source: str | os.PathLike[str],
    route: str | None = None,
    *,
    urdf: str | os.PathLike[str] | None = None,
    foot: str | None = None,
    parameters: Mapping[str, float] | None = None,
    transmission: str = "exact",
) -> Leg:
    """Load a leg.

    Parameters
    ----------
    source : str or path-like
        A shipped name (see `available`), the path of a .urdf or .xacro file, or XML text.
    route : {"closed_form", "pinocchio"}, optional
        What computes. Default: ``closed_form`` where the leg has formulas, else ``pinocchio``.
    urdf : str or path-like, optional
        With a shipped name: use that leg's formulas with this file's geometry, masses and inertias.
    foot : str, optional
        Link whose origin is the foot; default is the link named ``foot`` where there is one.
    parameters : mapping of str to float, optional
        Parameter overrides of an xacro source. Rendering xacro evaluates Python from the file: only render
        sources that you trust. Plain .urdf files are data.
    transmission : str
        Model of the drive train where the leg's formulas offer several: ``exact``, ``paper`` (as published) or ``none``
        (its rotary inertia left out) for the OmniLeg.

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
        The route, or the transmission model by this route, does not exist for this leg.
    FormulaAssumptionError
        The file breaks an assumption of the leg's formulas.
    MissingFootError
        `foot` is not a link of the mechanism.
    ParameterError
        A parameter is unknown or not a finite number.
    """
    from leg_dynamics.description import read

    origin = _source(source)
    named = origin if origin in available() else None
    if urdf is not None and named is None:
        raise RouteError(f"urdf= goes with a shipped name, one of {', '.join(available())}; got {origin[:80]!r}")
    if route is not None and route not in ROUTES:
        raise RouteError(f"route {route!r} does not exist: choose one of {', '.join(ROUTES)}")
    if urdf is not None:
        origin = _source(urdf)
    overrides = dict(parameters or {})
    description = read(origin, parameters=overrides)
    formulas = named if named is not None and has_closed_form(named) else None
    if route is None:
        route = "closed_form" if formulas is not None else "pinocchio"
    given = tuple(overrides.items())
    return Recipe(description, route, formulas, _foot(description, foot), origin, given, transmission).build()


def _source(source: Any) -> str:
    """A name, an absolute path or XML text: what later reads find again wherever the process has gone."""
    if not isinstance(source, (str, os.PathLike)):
        raise LegNotFoundError(f"a leg is a name, a path or XML text, not {type(source).__name__} {source!r}")
    text = os.fspath(source)
    if not isinstance(text, str):
        raise LegNotFoundError(f"a path must be text, got {text!r}")
    if not isinstance(source, str):
        return os.path.abspath(text)
    if text in available() or text.removeprefix("\ufeff").lstrip().startswith("<"):
        return text
    return os.path.abspath(text) if os.path.exists(text) else text


def _foot(description: Description, foot: str | None) -> str | None:
    if foot is None:
        return "foot" if description.has_link("foot") else None
    if not description.has_link(foot):
        raise MissingFootError(
            f"{description.name!r} has no link {foot!r} to be its foot; its links are "
            f"{', '.join(link.name for link in description.links)}",
            foot=foot,
        )
    return foot


def routes_of(leg: Leg) -> tuple[str, ...]:
    """Names of the routes that this leg's file and foot can be loaded with."""
    recipe = leg.recipe
    formulas = recipe.formulas is not None and recipe.foot == "foot"
    if recipe.transmission != "exact":
        return (leg.route,)
    return tuple(route for route in ROUTES if route != "closed_form" or formulas)


def sibling(leg: Leg, route: str) -> Leg:
    """Return the same file, foot and parameters by another route.

    Raises
    ------
    RouteError
        The route does not exist for this leg.
    """
    if route not in ROUTES:
        raise RouteError(f"route {route!r} does not exist: choose one of {', '.join(ROUTES)}")
    return replace(leg.recipe, route=route).build()


def with_text(leg: Leg, urdf: str) -> Leg:
    """Return the same route and formulas on another mechanism text.

    Raises
    ------
    DescriptionError, FormulaAssumptionError
        The text is not a mechanism that the route can serve.
    """
    from leg_dynamics.description import parse

    return replace(leg.recipe, description=parse(urdf), source=None, overrides=()).build()
