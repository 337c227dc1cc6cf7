"""The kinds of singular poses of legs that users bring, with the motion that each sets free."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.errors import AssemblyError, ParameterError, ShapeError, SingularityError

from ..five_bar import TOGGLE, five_bar
from ..four_bar import COUPLER, ROCKER, four_bar
from ..four_bar import TOGGLE as TOGGLE_CRANK

ROUTES = ("pinocchio", "symbolic")


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("foot", [True, False])
def test_a_five_bar_at_its_toggle_point(route, foot):
    leg = ld.load(five_bar(foot=foot), route=route)
    regular = ld.singularity(leg, [1.9, 1.1])
    assert regular.kinds == ()
    assert str(regular).startswith("regular")
    found = ld.singularity(leg, [math.pi - TOGGLE, TOGGLE])
    assert found.kinds == ("parallel",)
    direction = found.directions["parallel"]
    assert (abs(direction["ka"]), direction["ka"] + direction["kb"]) == pytest.approx((1.0, 0.0), abs=1e-5)
    assert "with the actuators locked can still move" in str(found)
    if foot:
        assert math.isnan(found.serial)
    else:
        assert found.serial == 1.0
    shown = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert shown["kinds"] == ["parallel"]


def test_a_stretched_arm_is_serial():
    """Crank and distal link in line: the pin cannot move along them."""
    leg = ld.load(five_bar(foot=True))
    # The pin on the circle of radius 0.45 about the left motor.
    pin = np.array([-0.1, 0.0]) + 0.45 * np.array([math.cos(1.0), -math.sin(1.0)])
    to_pin = pin - [0.1, 0.0]
    distance = np.linalg.norm(to_pin)
    inner = math.acos((0.2**2 + distance**2 - 0.25**2) / (2 * 0.2 * distance))
    mb = math.atan2(-to_pin[1], to_pin[0]) - inner
    mode = {"ma": 1.0, "ka": 0.0, "mb": mb, "kb": 1.0}
    leg = ld.load(five_bar(foot=True), mode=mode)
    found = ld.singularity(leg, [1.0, mb])
    # A planar leg moves in a plane: two of three directions are what it has.
    assert "serial" in found.kinds
    assert "parallel" not in found.kinds


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("before", [1e-3, 1e-5, 3e-7, 1e-7, 1e-8, 1e-10, 0.0])
def test_a_pose_that_the_methods_refuse_is_not_called_regular(route, before):
    leg, q = ld.load(four_bar(), route=route), [TOGGLE_CRANK - before]
    try:
        leg.mass_matrix(q)
        refused = None
    except (AssemblyError, SingularityError) as error:
        refused = error.kind
    assert (refused is None) == (before > 1e-6)
    found = ld.singularity(leg, q)
    assert found.kinds == (() if refused is None else ("parallel",))
    if refused is not None:
        direction = found.directions["parallel"]
        assert direction["c"] / direction["b"] == pytest.approx(-COUPLER / ROCKER, abs=1e-2)
        assert found.constraint > 0.1


@pytest.mark.parametrize("route", ROUTES)
def test_coordinates_that_do_not_determine_the_others(route):
    """The rocker's angle at its dead centre, where crank and coupler are in line, of a four-bar driven at the crank."""
    text = four_bar()
    for name, now, then in (("a", "true", "false"), ("c", "false", "true")):
        start = f'name="{name}" type="revolute" independent='
        text = text.replace(f'{start}"{now}"', f'{start}"{then}"')
    leg = ld.load(text, route=route)
    # Crank and coupler stretched: 1.1 from the origin to the pin, 0.7 from there to (1, 0).
    pin = math.acos((1.0 + 1.1**2 - 0.7**2) / 2.2)
    rocker = math.atan2(1.1 * math.sin(pin), 1.1 * math.cos(pin) - 1.0)
    found = ld.singularity(leg, [rocker])
    assert found.kinds == ("coordinates",)
    assert "coordinates singularity: the independent coordinates leave open the motion" in str(found)
    assert found.directions["coordinates"]["c"] == pytest.approx(0.0, abs=1e-9)
    assert min(found.parallel, found.constraint) > 1e-2
    json.dumps(found.to_dict(), allow_nan=False)


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_the_omnileg_without_gears_gains_motions_at_gamma_zero(route):
    text = re.sub(r"<coupling.*?</coupling>", "", ld.load("omnileg").description.urdf, flags=re.DOTALL)
    leg = ld.load(text, route=route)
    bent = ld.singularity(leg, [0.1, 0.2, 0.3, -0.6])
    assert bent.kinds == ()
    found = ld.singularity(leg, [0.0, 0.0, 0.0, 0.0])
    assert {"constraint", "parallel"} <= set(found.kinds)
    assert {"phi_D1", "phi_D3"} <= {name for name, x in found.directions["constraint"].items() if abs(x) > 0.05}
    with_gears = ld.singularity(ld.load("omnileg", route=route), [0.1, 0.2, 0.0])
    assert with_gears.kinds == ("serial",)
    assert with_gears.constraint > 1e-3


def test_idle_motions_are_no_singularity():
    leg = ld.load(five_bar(("mb",)))
    assert ld.singularity(leg, [1.9, 1.1]).kinds == ()
    redundant = ld.load(five_bar(("ma", "mb", "ka")))
    assert ld.singularity(redundant, [1.9, 1.1]).kinds == ()


def test_poses_that_do_not_close():
    with pytest.raises(AssemblyError):
        ld.singularity(ld.load(five_bar()), [math.pi, 0.0])


def test_bad_arguments():
    leg = ld.load(five_bar())
    with pytest.raises(ShapeError):
        ld.singularity(leg, [[1.9, 1.1]])
    with pytest.raises(ParameterError, match="characteristic_length"):
        ld.singularity(leg, [1.9, 1.1], characteristic_length=-1.0)
