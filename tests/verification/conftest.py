"""Routes with errors planted in them: a check is worth what it notices."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest

import leg_dynamics as ld
from leg_dynamics.routes import Recipe
from leg_dynamics.verification.states import domain, sample_states


class FaultyRoute:
    """A route whose results pass through a planted fault: ``fault(result, *arguments)``."""

    def __init__(self, route: Any, faults: Mapping[str, Callable[..., Any]]) -> None:
        self.route, self.faults = route, faults

    def __getattr__(self, name: str) -> Any:
        if name == "quick":  # a kernel called at once would pass the fault by
            raise AttributeError(name)
        method = getattr(self.route, name)
        if name not in self.faults:
            return method
        return lambda *arguments: self.faults[name](method(*arguments), *arguments)


@dataclass(frozen=True)
class FaultyRecipe(Recipe):
    """Builds legs on a `FaultyRoute`, also by another file or route."""

    faults: Mapping[str, Callable[..., Any]] = field(default_factory=dict)

    def backend(self) -> Any:
        return FaultyRoute(super().backend(), self.faults)


def plant(leg, **faults):
    values = {each.name: getattr(leg.recipe, each.name) for each in dataclasses.fields(Recipe)}
    return FaultyRecipe(**values, faults=faults).build()


@pytest.fixture(scope="session", name="plant")
def plant_fixture():
    return plant


@pytest.fixture(scope="session")
def closed():
    return ld.load("omnileg")


@pytest.fixture(scope="session")
def numeric():
    return ld.load("omnileg", "pinocchio")


@pytest.fixture(scope="session")
def states(closed):
    return sample_states(domain(closed), 40, 5)


BODY = """<inertial><origin xyz="0.1 0 0.02"/><mass value="0.5"/>
  <inertia ixx="2e-3" ixy="1e-4" ixz="0" iyy="2e-3" iyz="0" izz="3e-3"/></inertial>"""
LIMIT = '<limit lower="-2" upper="2" effort="10" velocity="10"/>'


@pytest.fixture(scope="session")
def pendulum():
    """A function of damping and friction: the text of a double pendulum about horizontal axes, no foot."""

    def text(damping=0.0, friction=0.0):
        dynamics = f'<dynamics damping="{damping}" friction="{friction}"/>'
        return f"""<robot name="pendulum"><link name="base"/>
          <link name="arm">{BODY}</link><link name="tip">{BODY}</link>
          <joint name="first" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>{LIMIT}
          {dynamics}</joint>
          <joint name="second" type="revolute"><parent link="arm"/><child link="tip"/><origin xyz="0.2 0 0"/>
          <axis xyz="0 1 0"/>{LIMIT}</joint></robot>"""

    return text


@pytest.fixture(scope="session")
def four_bar():
    """Text of a crank, coupler and rocker of 0.2 m on a ground of 0.3 m: the crank stops at 104.5 degrees."""
    # The symmetric pose: crank and rocker lean outward by the same angle, and the coupler is level.
    angle, rocking = 1.318116071652818, 1.8234765819369753
    return f"""<robot name="four_bar"><link name="ground"/><link name="crank">{BODY}</link>
      <link name="coupler">{BODY}</link><link name="rocker">{BODY}</link>
      <joint name="turning" type="revolute"><parent link="ground"/><child link="crank"/><axis xyz="0 0 1"/>
        {LIMIT}</joint>
      <joint name="joining" type="revolute" independent="false"><parent link="crank"/><child link="coupler"/>
        <origin xyz="0.2 0 0"/><axis xyz="0 0 1"/>{LIMIT}</joint>
      <joint name="rocking" type="revolute" independent="false"><parent link="ground"/><child link="rocker"/>
        <origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>{LIMIT}</joint>
      <loop name="pin" type="revolute"><predecessor link="coupler"><origin xyz="0.2 0 0"/></predecessor>
        <successor link="rocker"><origin xyz="0.2 0 0"/></successor><axis xyz="0 0 1"/></loop>
      <configuration name="home"><joint name="turning" value="{angle!r}"/>
        <joint name="joining" value="{-angle!r}"/><joint name="rocking" value="{rocking!r}"/></configuration>
      </robot>"""


@pytest.fixture(scope="session")
def rhombus(four_bar):
    """A function of the crank's limits: text of four bars of 0.2 m, whose modes cross where they lie on one line."""
    home = '<configuration name="home"><joint name="turning" value="1.2"/>'
    home += '<joint name="joining" value="-1.2"/><joint name="rocking" value="1.2"/></configuration>'
    text = four_bar.replace("0.3 0 0", "0.2 0 0")
    text = text[: text.index("<configuration")] + home + "</robot>"

    def limited(lower=0.0, upper=2.0):
        return text.replace('lower="-2" upper="2"', f'lower="{lower!r}" upper="{upper!r}"', 1)

    return limited
