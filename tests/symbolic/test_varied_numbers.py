"""Derivatives by angles, axes, ratios, multipliers and offsets against changed descriptions."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse
from leg_dynamics.errors import ParameterError, RowFailures
from leg_dynamics.symbolic.numbers import number_values, parameter_names
from leg_dynamics.symbolic.route import SymbolicRoute

STEP = 1e-5
ACCURACY = 1e-6


def shifted(values, keys, key, change):
    found = list(values)
    found[keys.index(key)] += change
    return tuple(found)


def turned(pose, angle, change):
    return replace(pose, rpy=shifted(pose.rpy, ["roll", "pitch", "yaw"], angle, change))


def aimed(axis, component, change):
    found = np.array(shifted(axis, ["x", "y", "z"], component, change))
    return tuple((found / np.linalg.norm(found)).tolist())


def changed(description, name, change):
    """The same description with an angle, an axis, a ratio, a multiplier or an offset changed."""
    element, *fields = name.split(".")

    def each(item):
        if item.name != element:
            return item
        if fields[0] == "origin":
            return replace(item, origin=turned(item.origin, fields[1], change))
        if fields[0] == "axis":
            return replace(item, axis=aimed(item.axis, fields[1], change))
        if fields[0] == "inertial":
            return replace(
                item, inertial=replace(item.inertial, origin=turned(item.inertial.origin, fields[1], change))
            )
        if fields[0] in ("predecessor", "successor"):
            end = getattr(item, fields[0])
            return replace(item, **{fields[0]: replace(end, origin=turned(end.origin, fields[1], change))})
        if fields[0] == "ratio":
            return replace(item, ratio=item.ratio + change)
        return replace(item, mimic=replace(item.mimic, **{fields[0]: getattr(item.mimic, fields[0]) + change}))

    kinds = ("links", "joints", "loops", "couplings")
    text = f"{description.urdf}<!-- {name} {change!r} -->"
    return replace(description, urdf=text, **{kind: tuple(map(each, getattr(description, kind))) for kind in kinds})


def check(lab, description, foot, names, q):
    route = SymbolicRoute(description, foot, None)
    n = len(q)
    generator = np.random.default_rng(3)
    v, a, force, gravity = generator.uniform(-2, 2, (4, max(n, 3)))
    v, a, force, gravity = v[:n], a[:n], 10.0 * force[:3], 9.0 * gravity[:3]
    failures = RowFailures()
    found = route.torque_derivatives(q, v, a, force, gravity, names, failures)[:, 3 * n :]
    tau = route.torque(q, v, a, force, gravity, failures)
    forward = route.acceleration_derivatives(q, v, tau, force, gravity, names, failures)[:, 2 * n + len(tau) :]
    assert not failures, failures.combined(None)
    for column, name in enumerate(names):
        sides = [
            SymbolicRoute(changed(description, name, sign * STEP), foot, None, lab.evaluate.evaluator)
            for sign in (1.0, -1.0)
        ]
        one, other = (side.torque(q, v, a, force, gravity, failures) for side in sides)
        wanted = (one - other) / (2.0 * STEP)
        assert np.abs(found[:, column] - wanted).max() < ACCURACY * (1.0 + np.abs(wanted).max()), name
        one, other = (side.acceleration(q, v, tau, force, gravity, failures) for side in sides)
        wanted = (one - other) / (2.0 * STEP)
        assert np.abs(forward[:, column] - wanted).max() < ACCURACY * (1.0 + np.abs(wanted).max()), name
    assert not failures, failures.combined(None)


def test_ratios_multipliers_offsets_and_axes_of_gears(lab):
    names = ("mesh.ratio", "rack.multiplier", "rack.offset", "driven.axis.x", "driven.origin.pitch", "rack.axis.z")
    check(lab, parse(lab.gears()), "foot", (*names, "foot.inertial.roll"), np.array([0.3]))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["spherical", "revolute"])
def test_angles_and_axes_around_a_spatial_loop(lab, kind):
    description = parse(lab.random_loop(kind, 1))
    names = ["a1.origin.roll", "b2.origin.yaw", "a2.axis.x", "b0.axis.y", "closing.predecessor.pitch"]
    names += ["closing.successor.roll", "closing.axis.x", "link_a2.inertial.pitch"]
    known = parameter_names(description)
    route = SymbolicRoute(description, "link_b3", None)
    check(
        lab, description, "link_b3", tuple(name for name in names if name in known), route.model.seed[: route.model.n]
    )


def test_every_number_can_be_varied_or_is_refused_by_name(lab):
    description = parse(lab.gears())
    assert set(parameter_names(description)) == set(number_values(description))
    route = SymbolicRoute(description, "foot", None)
    q = np.array([0.3])
    for name in ("nothing.ratio", "mesh.ratio.x", "foot"):
        with pytest.raises(ParameterError, match="no number"):
            route.torque_derivatives(q, q, q, None, None, (name,), RowFailures())


def test_a_coupling_that_others_imply_cannot_be_varied_alone(lab):
    twice = '<coupling name="again"><predecessor link="driver_link"/><successor link="driven_link"/>'
    text = lab.gears().replace("<configuration", f'{twice}<ratio value="-2.5"/></coupling><configuration', 1)
    description = parse(text)
    route = SymbolicRoute(description, "foot", None)
    q = np.array([0.3])
    with pytest.raises(ParameterError, match="alone"):
        route.torque_derivatives(q, q, q, None, None, ("again.ratio",), RowFailures())


@pytest.mark.slow
def test_omnileg_by_its_angles_agrees_with_the_closed_form_and_with_changed_legs():
    names = ("psi_1", "psi_2", "psi_3", "L1", "R_C", "foot_mass")
    legs = [ld.load("omnileg", route=route) for route in ("closed_form", "symbolic", "pinocchio")]
    q, v, a = np.array([0.3, -0.4, 0.6]), np.array([1.0, -2.0, 0.5]), np.array([3.0, 4.0, -5.0])
    for kind in ("torque", "acceleration"):
        one, other = (getattr(leg, f"{kind}_derivatives")(q, v, a, parameters=names).parameters for leg in legs[:2])
        assert np.abs(one - other).max() < 1e-9 * (1.0 + np.abs(one).max())
        more = getattr(legs[1], f"{kind}_derivatives")(q, v, a, parameters=(*names, "bevel_ratio")).parameters
        for column, name in enumerate((*names, "bevel_ratio")):
            value = legs[2].parameters[name].value
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                sides = [legs[2].replace(**{name: value + sign * STEP}) for sign in (1.0, -1.0)]
            high, low = (getattr(side, kind)(q, v, a) for side in sides)
            wanted = (high - low) / (2.0 * STEP)
            assert np.abs(more[:, column] - wanted).max() < ACCURACY * (1.0 + np.abs(wanted).max()), name
