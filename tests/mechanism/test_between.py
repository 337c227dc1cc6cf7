"""What samples tell of the way between them: polynomials, sines, and rates that are none of the coordinates'."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import leg_dynamics as ld
from leg_dynamics.errors import AssemblyError
from leg_dynamics.mechanism.between import FITTING, QUINTIC, ROUNDING, SampledMotion, lead

from ..four_bar import HOME, four_bar, passive

UNIT = np.array([1.0, 0.2])
SHARES = np.linspace(0.0, 1.0, 41)


def sine(time, speed=1.0, size=1.0, phase=0.3):
    """Two coordinates at one frequency, with rates and accelerations; the second one in tenths."""
    size, angle = size * np.array([1.0, 0.1]), speed * time[:, None] + phase + np.array([0.0, 0.7])
    return size * np.sin(angle), size * speed * np.cos(angle), -size * speed**2 * np.sin(angle)


def off(way, motion):
    """Distance of the way to a motion, at `SHARES`."""
    found = np.array([way.coordinates(share) for share in SHARES])
    exact = motion(way.start + way.span * SHARES)[0]
    return np.linalg.norm((found - exact) / UNIT, axis=1)


@given(st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12), st.floats(0.01, 10.0))
def test_polynomials_of_degree_five_are_followed_exactly(numbers, span):
    curves = [np.polynomial.Polynomial(numbers[k::2], domain=[0.0, span], window=[0.0, 1.0]) for k in range(2)]
    time = np.array([0.0, 0.37, 0.61, 1.0]) * span

    def levels(at):
        return [np.stack([curve.deriv(m)(at) for curve in curves], axis=1) for m in range(3)]

    motion = SampledMotion(time, *levels(time), UNIT)
    for row in (1, 2, 3):
        way = motion.way(row)
        if way is None or way.guessed:
            # Such as a constant rate whose accelerations are rounding.
            continue
        assert off(way, levels).max() <= 1e-11
        for share in (0.0, 0.3, 1.0):
            _, v, a = (each[0] for each in levels(np.array([way.start + share * way.span])))
            found_v, found_a = way.rates(share)
            np.testing.assert_allclose(found_v * span, v * span, atol=1e-9)
            np.testing.assert_allclose(found_a * span**2, a * span**2, atol=1e-7)
        assert way.share(way.start + 0.25 * way.span) == pytest.approx(0.25)
        # Nothing but the share of what accelerations make that is never trusted, and what rounding makes in the other
        # polynomial.
        assert way.error <= QUINTIC * way.blur + 1e-9


@pytest.mark.parametrize("count", [6, 8, 12, 20, 50, 200])
@pytest.mark.parametrize("accelerations", [True, False])
@pytest.mark.parametrize("uneven", [False, True])
def test_the_error_of_a_sine_is_bounded(count, accelerations, uneven):
    """Of one turn, or the middle of it, on even and uneven grids."""
    time = np.linspace(0.0, 1.0, count)
    if uneven:
        time = time + 0.3 / count * np.sin(9.0 * time)
    speed = 2.0 * math.pi

    def motion(at):
        return sine(at, speed)

    q, v, a = motion(time)
    sampled = SampledMotion(time, q, v, a if accelerations else 0.0 * a, UNIT)
    for row in range(1, count):
        way = sampled.way(row)
        if way is None:
            # Coarse samples without accelerations tell nothing.
            assert count < 12
            assert not accelerations
            continue
        bounds = np.array([way.error_at(share) for share in SHARES])
        assert (off(way, motion) <= bounds + 1e-13).all()
        assert way.error_at(0.0) == way.error_at(1.0) == way.noise
        assert way.error_at(0.5) == max(way.error, way.noise)
        if count >= 50 and accelerations:
            # And it is no idle bound.
            assert way.error <= 10.0 * off(way, motion).max() + QUINTIC * way.blur + 1e-9


@pytest.mark.parametrize("accelerations", [True, False])
def test_accelerations_that_do_not_fit_are_guessed(accelerations):
    time = np.linspace(0.0, 1.0, 30)
    q, v, a = sine(time, 5.0)
    way = SampledMotion(time, q, v, a if accelerations else -3.0 * a, UNIT).way(4)
    assert way.guessed == (not accelerations)
    np.testing.assert_allclose(way.a, a[3:5], rtol=0.1, atol=0.05)
    np.testing.assert_array_equal(way.v, v[3:5])


@pytest.mark.parametrize(("factor", "fits"), [(1.0 + 0.9 * FITTING, True), (1.0 + 1.3 * FITTING, False), (0.0, False)])
def test_rates_that_are_none_of_the_coordinates_tell_no_way(factor, fits):
    time = np.linspace(0.0, 1.0, 30)
    q = np.stack([2.0 * time, -0.4 * time], axis=1)
    v = np.broadcast_to([2.0, -0.4], q.shape)
    assert (SampledMotion(time, q, factor * v, 0.0 * v, UNIT).way(7) is not None) == fits


def test_a_rest_is_a_way_and_its_error_is_rounding():
    time = np.linspace(0.0, 1.0, 5)
    still = np.broadcast_to([3.0, 0.2], (5, 2))
    way = SampledMotion(time, still, 0.0 * still, 0.0 * still, UNIT).way(2)
    np.testing.assert_array_equal(way.coordinates(0.4), [3.0, 0.2])
    assert way.error == way.blur == ROUNDING * 4.0


def test_two_samples_alone_have_a_way_too():
    time = np.array([0.0, 0.3])
    q, v, a = sine(time)
    way = SampledMotion(time, q, v, a, UNIT).way(1)
    assert off(way, sine).max() <= way.error


def test_the_way_leads_along_the_polynomial_until_the_mode_ends():
    leg = ld.load(four_bar(), route="pinocchio")
    mechanism = leg.backend.mechanism
    start = mechanism.close(leg.home)
    # The crank swings back and forth, and ends where it began.
    q, v = np.full((2, 1), HOME), np.array([[-2.0], [2.0]])
    way = SampledMotion(np.array([0.0, 1.0]), q, v, np.full((2, 1), 4.0), np.ones(1)).way(1)
    names = list(mechanism.tree.joint_names)
    for share in (0.25, 0.5, 1.0):
        led = lead(mechanism, way, start, 0.0, share)
        for name, angle in zip("bc", passive(way.coordinates(share)[0]), strict=True):
            assert math.remainder(led.q[names.index(name)] - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    beyond = SampledMotion(np.array([0.0, 1.0]), q, -v, np.full((2, 1), -4.0), np.ones(1)).way(1)
    with pytest.raises(AssemblyError):
        lead(mechanism, beyond, start, 0.0, 0.5)


@pytest.mark.parametrize("accelerations", [True, False])
@pytest.mark.parametrize(
    ("digits", "least", "most"), [(None, 0.0, 1e-9), (8, 1e-9, 2e-7), (6, 1e-7, 2e-5), (4, 1e-5, 2e-3)]
)
def test_samples_with_few_digits_are_as_far_off_as_their_digits(digits, least, most, accelerations):
    time = np.linspace(0.0, 1.0, 400)
    levels = [each if digits is None else np.round(each, digits) for each in sine(time, 5.0)]
    levels[2] = levels[2] * accelerations
    motion = SampledMotion(time, *levels, UNIT)
    noise = np.array([motion.way(row).noise for row in range(1, 400)])
    assert least <= np.median(noise) <= most


def test_rates_by_differences_are_seen():
    """Smooth, and yet wrong: told to its order."""
    time = np.linspace(0.0, 1.0, 60)
    q, _, _ = sine(time, 6.0)
    v = np.gradient(q, time, axis=0)
    motion = SampledMotion(time, q, v, np.gradient(v, time, axis=0), UNIT)
    for row in range(5, 55):
        way = motion.way(row)
        assert off(way, lambda at: sine(at, 6.0)).max() <= 10.0 * max(way.error, way.noise)


@pytest.mark.parametrize(("size", "known"), [(1e-2, True), (1.0, False)])
def test_rates_that_do_not_fit_may_tell_enough_of_a_short_way(size, known):
    time = np.linspace(0.0, 1.0, 5)
    q = size * np.stack([time, time], axis=1)
    v = np.broadcast_to([0.3 * size, 0.3 * size], q.shape)
    way = SampledMotion(time, q, v, 0.0 * v, UNIT).way(2)
    assert (way is not None) == known
    if known:
        # All that the rates leave open of the way.
        assert way.guessed
        assert way.error >= 0.25 * 0.7 * np.linalg.norm([size, 5.0 * size]) * 0.99
