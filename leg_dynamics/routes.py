"""The composition root: which file, which route, and the leg that they make."""

from __future__ import annotations

import difflib
import functools
import operator
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from leg_dynamics.errors import (
    FormulaAssumptionError,
    LegDynamicsError,
    LegNotFoundError,
    MissingFootError,
    ParameterError,
    RouteError,
)
from leg_dynamics.leg import Leg, Route
from leg_dynamics.preparation import Preparation, mode_of

if TYPE_CHECKING:
    import numpy as np

    from leg_dynamics.description.model import Description
    from leg_dynamics.mechanism.route import PinocchioRoute

__all__ = ["ROUTES", "Recipe", "available", "load", "routes_of", "sibling", "with_text"]

ROUTES = ("closed_form", "pinocchio", "symbolic")


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
    threads : int or None
        Threads for large batches of the routes that are compiled.
    preparation : Preparation
        How `description` came from what the source says.
    """

    description: Description
    route: str
    formulas: str | None
    foot: str | None
    source: str | None = None
    overrides: tuple[tuple[str, float], ...] = ()
    transmission: str = "exact"
    threads: int | None = None
    preparation: Preparation = field(default_factory=lambda: Preparation(trusted=True))

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
            return ClosedFormRoute(self.formulas, self.description, self.threads, **options)
        if self.transmission != "exact":
            raise RouteError(
                f"transmission {self.transmission!r} is a model of the closed form only, and route {self.route!r} "
                "computes the mechanism as it is: leave transmission out, or use route='closed_form'"
            )
        hip = "hip" if self.description.has_link("hip") else None

        @functools.cache
        def numeric() -> PinocchioRoute:
            from leg_dynamics.mechanism.route import PinocchioRoute

            # A row that the kernels leave to it must not depend on the rows before.
            return PinocchioRoute(self.description, self.foot, hip, remembers=self.route == "pinocchio")

        if self.route == "pinocchio":
            return numeric()
        from leg_dynamics.symbolic.route import SymbolicRoute

        def seed() -> dict[str, float]:
            route = numeric()
            return dict(zip(route.tree_joint_names, route.mechanism.seeds[0].q.tolist(), strict=True))

        return SymbolicRoute(self.description, self.foot, hip, seed=seed, fallback=numeric, threads=self.threads)

    def build(self) -> Leg:
        """Make the leg."""
        return Leg(self.backend(), self.description, self.foot, self)

    def number_derivatives(self, parameters: tuple[str, ...], route: Any) -> tuple[tuple[str, ...], np.ndarray]:
        """Numbers that the route must differentiate by, and how they depend on parameters.

        Parameters
        ----------
        parameters : tuple of str
            Design parameters of the source, or names of the route's numbers.
        route : Route
            One that has `numbers_of`.

        Returns
        -------
        tuple of str, (numbers, parameters) array
            Names of k numbers, and the derivative of each by each parameter.

        Raises
        ------
        ParameterError
            A name is unknown, or a number does not depend smoothly on a design parameter.
        """
        import numpy as np

        if not parameters:
            return (), np.zeros((0, 0))
        own = route.numbers_of(self.description)
        columns: list[Mapping[str, float]] = []
        for name in parameters:
            if name in self.description.parameters and self.source is not None:
                columns.append(_design_derivative(self, name))
            elif name in own:
                columns.append({name: 1.0})
            else:
                raise _unknown_parameter(self, name, own)
        numbers = tuple(number for number in own if any(number in column for column in columns))
        return numbers, np.array([[column.get(number, 0.0) for column in columns] for number in numbers]).reshape(
            len(numbers), len(parameters)
        )

    def with_parameters(self, parameters: Mapping[str, float]) -> Recipe:
        """Return the recipe for the same source with some more parameters changed.

        Raises
        ------
        ParameterError
            A name is unknown, a value is not a finite number, or the source has no parameters.
        """
        if self.source is None or not self.description.parameters:
            raise ParameterError(
                f"{self.description.name!r} was read from plain URDF, which has no named parameters to change "
                f"({', '.join(map(str, parameters))}): edit the file, or load the xacro that generates it"
            )
        overrides = dict(self.overrides) | dict(parameters)
        from leg_dynamics.description import read

        changed = self.preparation.of(read(self.source, parameters=overrides))
        return replace(self, description=changed, overrides=tuple(overrides.items()))

    def read(self) -> Description:
        """What the source says, before anything was done to it."""
        from leg_dynamics.description import read

        return self.description if self.source is None else read(self.source, parameters=dict(self.overrides))

    def of_part(self, name: str, foot: str | None) -> Recipe:
        """Return the recipe for one leg of a robot.

        Raises
        ------
        DescriptionError
            The robot has no such leg, or its foot is not clear.
        """
        from leg_dynamics.description.legs import part_of

        whole = self.read()
        part = part_of(whole, name, foot)
        preparation = Preparation(self.preparation.trusted, part=name, foot=part.foot)
        route = "pinocchio" if self.route == "closed_form" else self.route
        return replace(
            self,
            description=preparation.of(whole),
            route=route,
            formulas=None,
            foot=part.foot,
            transmission="exact",
            preparation=preparation,
        )


# Seven points: weights of the derivative at the middle one (pairs), and at the first one; exact up to degree 6.
_CENTRAL = ((1, 45.0 / 60.0), (2, -9.0 / 60.0), (3, 1.0 / 60.0))
_FORWARD = ((1, 6.0), (2, -7.5), (3, 20.0 / 3.0), (4, -3.75), (5, 1.2), (6, -1.0 / 6.0))
# Share of a parameter's value between two points, and the distance where the value is zero.
_SPACING = 0.01
# The five inner points must give the same derivative: lengths to the fifth power in an inertia differ by less.
_SMOOTH = 1e-3


@functools.lru_cache(maxsize=128)
def _changed(source: str, overrides: tuple[tuple[str, float], ...], preparation: Preparation) -> Description:
    """The source read with other values; every route asks for the same ones."""
    from leg_dynamics.description import read

    return preparation.of(read(source, parameters=dict(overrides)))


@functools.lru_cache(maxsize=256)
def _design_derivative(recipe: Recipe, name: str) -> Mapping[str, float]:
    """Derivatives of the route's numbers by a design parameter, where they are not zero."""
    assert recipe.source is not None
    route: Any = recipe.backend()
    value = recipe.description.parameters[name].value
    h = _SPACING * abs(value) or _SPACING

    def numbers(k: int) -> dict[str, float]:
        overrides = dict(recipe.overrides) | {name: value + k * h}
        return route.numbers_of(_changed(recipe.source, tuple(overrides.items()), recipe.preparation))

    centre = route.numbers_of(recipe.description)
    try:
        samples = {k: numbers(k) for k in (-3, -2, -1, 1, 2, 3)}
    except LegDynamicsError:
        # the parameter ends here: a length or a mass of zero
        try:
            samples = {k: numbers(k) for k in range(1, 7)}
        except LegDynamicsError as error:
            raise ParameterError(
                f"{name} = {value:g} cannot be changed by {6 * h:g} without breaking the mechanism: {error}"
            ) from error
    derivatives = {}
    for number, middle in centre.items():
        if any(number not in sample for sample in samples.values()):
            raise ParameterError(f"{number} exists for some values of {name} only: differentiate by another parameter")
        if -1 in samples:
            slopes = [(samples[k][number] - samples[-k][number]) * weight for k, weight in _CENTRAL]
            rough = (8.0 * (samples[1][number] - samples[-1][number]) - samples[2][number] + samples[-2][number]) / 12.0
        else:
            slopes = [(samples[k][number] - middle) * weight for k, weight in _FORWARD]
            rough = sum(slopes)
        slope = sum(slopes)
        if abs(slope - rough) > _SMOOTH * max(abs(slope), abs(rough)) + 1e-12 * abs(middle):
            raise ParameterError(
                f"{number} does not depend smoothly on {name} near {value:g}: its derivative there is {rough / h:.6g} "
                f"by five points and {slope / h:.6g} by seven; differentiate by the numbers of the mechanism instead"
            )
        if abs(slope) > 1e-14 * abs(middle):
            derivatives[number] = slope / h
    return derivatives


def _thread_count(threads: Any) -> int:
    try:
        count = 0 if isinstance(threads, bool) else operator.index(threads)
    except TypeError:
        count = 0
    if count < 1:
        raise ParameterError(f"threads must be a whole number, at least 1, got {threads!r}", parameter="threads")
    return count


def load(
    source: str | os.PathLike[str],
    route: str | None = None,
    *,
    urdf: str | os.PathLike[str] | None = None,
    foot: str | None = None,
    parameters: Mapping[str, float] | None = None,
    transmission: str = "exact",
    threads: int | None = None,
    mode: str | Mapping[str, float] | None = None,
) -> Leg:
    """Load a leg, or a robot with several.

    Parameters
    ----------
    source : str or path-like
        A shipped name (see `available`); the path of a .urdf, .xacro, .yaml (modules, or loops beside a .urdf) or .xml
        (MJCF) file; a name such as ``example-robot-data:solo12``; or XML text. A floating or planar joint becomes a
        chain of joints with one coordinate each.
    route : {"closed_form", "pinocchio", "symbolic"}, optional
        What computes: the leg's hand-derived formulas; numeric algorithms for any mechanism; or any mechanism's
        equations unrolled and compiled once, fast from then on. Default: ``closed_form`` where the leg has formulas,
        else ``pinocchio``.
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
    threads : int, optional
        Threads that a large batch is split over by the routes ``closed_form`` and ``symbolic``; by default as many as
        pay, at most one a processor. Results do not depend on it.
    mode : str or mapping of str to float, optional
        The assembly mode: a name that `Leg.assembly_modes` lists, the name of a configuration of the file that lies in
        it, or joint coordinates near one of its poses. Default: that of the file's configuration ``home``. Not for
        closed forms, which know their mode.

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
        A parameter or mode is unknown or not a finite number.
    AssemblyError
        There is no closed pose of such an assembly mode.
    """
    from leg_dynamics.description import read
    from leg_dynamics.description.parameters import checked_values

    origin = source_of(source)
    named = origin if origin in available() else None
    if urdf is not None and named is None:
        raise RouteError(f"urdf= goes with a shipped name, one of {', '.join(available())}; got {origin[:80]!r}")
    if route is not None and route not in ROUTES:
        raise RouteError(f"route {route!r} does not exist: choose one of {', '.join(ROUTES)}")
    if urdf is not None:
        origin = source_of(urdf)
    overrides = checked_values(parameters)
    preparation = Preparation(trusted=named is not None)
    description = preparation.of(read(origin, parameters=overrides))
    formulas = named if named is not None and has_closed_form(named) else None
    if mode is not None:
        if route == "closed_form":
            raise RouteError(
                f"mode={mode!r}: the formulas of {named!r} know one assembly mode; use route='pinocchio' or 'symbolic'"
            )
        # The formulas are of the file's own mode.
        formulas = None
        preparation = replace(preparation, mode=mode_of(description, mode))
        description = preparation.of(read(origin, parameters=overrides))
    if route is None:
        route = "closed_form" if formulas is not None else "pinocchio"
    threads = None if threads is None else _thread_count(threads)
    given = tuple(overrides.items())
    foot = _foot(description, foot)
    return Recipe(description, route, formulas, foot, origin, given, transmission, threads, preparation).build()


def _unknown_parameter(recipe: Recipe, name: object, numbers: Iterable[str]) -> ParameterError:
    listed = [*recipe.description.parameters, *numbers]
    near = difflib.get_close_matches(str(name), listed, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return ParameterError(
        f"{recipe.description.name!r} has no parameter {name!r}{hint}: see leg.parameters and leg.numbers",
        parameter=name,
    )


def source_of(source: Any) -> str:
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
    if not isinstance(foot, str):
        raise MissingFootError(f"foot is the name of a link, got {type(foot).__name__} {foot!r}", foot=foot)
    if not description.has_link(foot):
        raise MissingFootError(
            f"{description.name!r} has no link {foot!r} to be its foot; its links are "
            f"{', '.join(link.name for link in description.links)}",
            foot=foot,
        )
    return foot


def _recipe_of(leg: Leg) -> Recipe:
    recipe = leg.recipe
    if not isinstance(recipe, Recipe):
        raise RouteError(f"{leg.name!r} was not made by load: it has no other route")
    return recipe


def routes_of(leg: Leg) -> tuple[str, ...]:
    """Names of the routes that this leg's file and foot can be loaded with."""
    recipe = _recipe_of(leg)
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
    return replace(_recipe_of(leg), route=route).build()


def with_text(leg: Leg, urdf: str) -> Leg:
    """Return the same route and formulas on another mechanism text.

    Raises
    ------
    DescriptionError, FormulaAssumptionError
        The text is not a mechanism that the route can serve.
    """
    from leg_dynamics.description import parse

    return replace(_recipe_of(leg), description=parse(urdf), source=None, overrides=()).build()
