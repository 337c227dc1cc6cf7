"""Reduced words, positions, and their derivatives against plain forward kinematics and differences."""

from __future__ import annotations

import math

import numpy as np
import pytest

from leg_dynamics.description import link_transforms, parse, read
from leg_dynamics.symbolic.coordinates import Form, reduce_coordinates
from leg_dynamics.symbolic.motion import Frames, Motion, Orientation, Position
from leg_dynamics.symbolic.numbers import Numbers
from leg_dynamics.symbolic.scalars import axis_rotation, is_zero
from leg_dynamics.symbolic.tree import build_tree, characteristic_length


def angle(k, factor=1.0, constant=0.0):
    return Form(((k, factor),), constant)


@pytest.fixture
def root():
    return Orientation(None, None, None, None)


def test_turns_about_one_axis_add_and_cancel(root):
    one = root.turn(0, angle(0))
    assert one.turn(0, angle(0, -1.0)) is root
    assert one.turn(0, angle(1)) is root.turn(0, Form(((0, 1.0), (1, 1.0))))
    assert one.turn(1, angle(1)).turn(1, angle(1, -1.0)).turn(0, angle(0, -1.0)) is root


@pytest.mark.parametrize("tilt", [1e-7, 1e-9, 1e-12])
def test_axes_that_are_not_quite_parallel_stay_apart(root, tilt):
    tilted = axis_rotation(0, tilt)
    assert root.turn(1, angle(0)).constant(tilted).turn(1, angle(1)).depth == 2
    assert root.turn(1, angle(0)).constant(tilted).parent.depth == 1
    assert root.turn_about((0.0, math.cos(tilt), math.sin(tilt)), angle(0)) is not root.turn(1, angle(0))
    # Rounding is no tilt.
    assert root.turn(1, angle(0)).constant(axis_rotation(0, 1e-3 * tilt * 1e-9)).turn(1, angle(1)).depth == 1


def test_constants_move_left_through_turns_about_their_axis(root):
    half = axis_rotation(0, math.pi)
    # A half turn about x reverses y.
    assert root.turn(1, angle(0)).constant(half) is root.constant(half).turn(1, angle(0, -1.0))
    assert root.turn(1, angle(0)).constant(half).constant(half) is root.turn(1, angle(0))
    assert root.turn(2, angle(0, 1.0, 0.5)) is root.constant(axis_rotation(2, 0.5)).turn(2, angle(0))
    # Two hinges along one line in differently turned frames.
    quarter = axis_rotation(0, math.pi / 2)
    assert root.turn(2, angle(0)).constant(quarter).turn(1, angle(0, -1.0)) is root.constant(quarter)


def test_equal_terms_of_positions_cancel_and_components_along_the_axis_move_inwards(root):
    node = root.turn(2, angle(0))
    place = Position(1.0).plus(node, (0.3, 0.0, 0.2))
    assert place.terms == {(root, None): (0.0, 0.0, 0.2), (node, None): (0.3, 0.0, 0.0)}
    assert place.minus(place).terms == {}


def test_sines_of_sums_are_composed(root):
    u = [np.array([0.3]), np.array([1.1])]
    motion = Motion(u)
    for form in (angle(0, 2.0), angle(0, 3.0), angle(1, -1.0), Form(((0, 1.0), (1, -2.0))), angle(0, 0.7)):
        sine, cosine = motion.sincos(form)
        assert np.allclose([sine, cosine], [np.sin(form.of(u)), np.cos(form.of(u))], atol=1e-15)


@pytest.fixture(params=["omnileg", "revolute", "slider"])
def mechanism(request, lab):
    if request.param == "omnileg":
        return read("omnileg")
    return parse(lab.random_loop("revolute", 3) if request.param == "revolute" else lab.slider_crank())


@pytest.mark.parametrize("reference", [-1, 2])
def test_frames_against_forward_kinematics_and_differences(mechanism, reference):
    coordinates = reduce_coordinates(mechanism)
    tree = build_tree(mechanism, coordinates, Numbers.of(mechanism), None, characteristic_length(mechanism))
    frames = Frames(tree, reference)
    generator = np.random.default_rng(0)
    size = len(coordinates.names)
    u0, rates, accelerations = generator.uniform(-0.7, 0.7, (3, size))

    def at(t):
        return u0 + rates * t + 0.5 * accelerations * t * t

    def transforms(t):
        values = {name: form.of(at(t)) for name, form in coordinates.forms.items()}
        found = link_transforms(mechanism, values)
        base = found[mechanism.root if reference < 0 else mechanism.joint(tree.joints[reference].name).child]
        return {name: np.linalg.inv(base) @ value for name, value in found.items()}

    def motion(t):
        return Motion(
            [np.array([x]) for x in at(t)],
            [np.array([x]) for x in rates + accelerations * t],
            [np.array([x]) for x in accelerations],
        )

    def vector(value):
        return np.array([np.asarray(x).reshape(-1)[0] if not is_zero(x) else 0.0 for x in value])

    wanted, here, step = transforms(0.0), motion(0.0), 1e-4
    before, after = transforms(-step), transforms(step)
    for name, placement in tree.links.items():
        orientation, origin = frames.place(placement)
        matrix = np.array([vector(row) for row in here.matrix(orientation)])
        assert np.abs(matrix - wanted[name][:3, :3]).max() < 1e-13
        assert np.abs(vector(here.position(origin)) - wanted[name][:3, 3]).max() < 1e-13
        speed = (after[name][:3, 3] - before[name][:3, 3]) / (2 * step)
        assert np.abs(vector(here.velocity(origin)) - speed).max() < 1e-6
        change = (after[name][:3, 3] - 2 * wanted[name][:3, 3] + before[name][:3, 3]) / step**2
        assert np.abs(vector(here.acceleration(origin)) - change).max() < 2e-5
        columns = here.partials(origin)
        summed = sum((vector(column) * rates[k] for k, column in columns.items()), np.zeros(3))
        assert np.abs(summed - vector(here.velocity(origin))).max() < 1e-12
        spin = sum((vector(c) * rates[k] for k, c in here.spin_partials(orientation).items()), np.zeros(3))
        assert np.abs(spin - vector(here.spin(orientation))).max() < 1e-12
        local, local_rate = here.local_spin(orientation)
        assert np.abs(matrix @ vector(local) - vector(here.spin(orientation))).max() < 1e-12
        assert np.abs(matrix @ vector(local_rate) - vector(here.spin_rate(orientation))).max() < 1e-12


def test_arms_of_vectors_that_are_gone_are_not_taken_for_others(root):
    node = root.turn(2, angle(0))
    motion = Motion([np.array([0.0])])
    # Each vector is freed after its use, and the next takes its place in memory.
    for number in range(200):
        arm = motion.arm(node, (np.array([float(number)]), 0.0, 0.0))
        assert arm[0][0] == number
