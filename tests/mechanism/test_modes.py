"""Assembly modes: found, named, chosen; never switched in silence."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse
from leg_dynamics.errors import (
    AssemblyError,
    LegDynamicsWarning,
    ParameterError,
    RouteError,
    ShapeError,
    SingularityError,
    UnsupportedError,
)
from leg_dynamics.mechanism.mechanism import Mechanism
from leg_dynamics.mechanism.modes import find_modes

from ..five_bar import TOGGLE, five_bar

ROUTES = ("pinocchio", "symbolic")


def knees(ma, mb, side):
    """Knee angles of the five-bar in closed form: the pin below (side +1) or above (-1) the line of the elbows."""
    a = np.array([-0.1 + 0.2 * math.cos(ma), -0.2 * math.sin(ma)])
    b = np.array([0.1 + 0.2 * math.cos(mb), -0.2 * math.sin(mb)])
    middle, half = (a + b) / 2, np.linalg.norm(b - a) / 2
    along = (b - a) / np.linalg.norm(b - a)
    pin = middle + side * math.sqrt(0.25**2 - half**2) * np.array([along[1], -along[0]])
    angles = [math.atan2(-(pin - end)[1], (pin - end)[0]) for end in (a, b)]
    return [math.remainder(angle - crank, 2 * math.pi) for angle, crank in zip(angles, (ma, mb), strict=True)]


@pytest.mark.parametrize("route", ROUTES)
def test_both_modes_of_a_five_bar_are_those_of_its_circles(route):
    leg = ld.load(five_bar(), route=route)
    q = np.array([1.9, 1.1])
    modes = leg.assembly_modes(q)
    assert [mode.configurations for mode in modes] == [("home",), ()]
    assert len({mode.name for mode in modes}) == 2
    for mode, side in zip(modes, (1.0, -1.0), strict=True):
        found = [math.remainder(mode.coordinates[name], 2 * math.pi) for name in ("ka", "kb")]
        np.testing.assert_allclose(found, knees(*q, side), atol=1e-9)
        assert mode.regularity > 0.1
    for name, value in leg.assemble(q).items():
        assert modes[0].coordinates[name] == pytest.approx(float(value), abs=1e-12)


@pytest.mark.parametrize("route", ROUTES)
def test_a_chosen_mode_is_kept_by_every_method(route):
    text = five_bar(foot=True)
    own = ld.load(text, route=route)
    names = [mode.name for mode in own.assembly_modes()]
    other = ld.load(text, route=route, mode=names[1])
    q = np.array([1.9, 1.1])
    for leg, side in ((own, 1.0), (other, -1.0)):
        ka, _ = knees(*q, side)
        angle = q[0] + ka
        pin = [
            -0.1 + 0.2 * math.cos(q[0]) + 0.25 * math.cos(angle),
            0.0,
            -0.2 * math.sin(q[0]) - 0.25 * math.sin(angle),
        ]
        np.testing.assert_allclose(leg.foot_position(q), pin, atol=1e-10)
    # The names are the same whichever mode is in use, and however many are looked for.
    assert [mode.name for mode in other.assembly_modes(attempts=30, seed=3)] == names[::-1]
    assert ld.load(text, route=route, mode="home").assembly_modes()[0].name == names[0]
    again = pickle.loads(pickle.dumps(other))
    np.testing.assert_array_equal(again.torque(q, q, q), other.torque(q, q, q))
    near = dict(zip(("ka", "kb"), knees(math.pi - 1.2, 1.2, -1.0), strict=True))
    third = ld.load(text, route=route, mode={name: value + 0.05 for name, value in near.items()})
    np.testing.assert_allclose(third.torque(q, q, q), other.torque(q, q, q), rtol=1e-9)


def test_the_modes_are_the_same_each_time():
    mechanism = Mechanism(parse(five_bar()))
    first, again = find_modes(mechanism), find_modes(Mechanism(parse(five_bar())))
    assert first == again
    assert pickle.loads(pickle.dumps(first)) == first
    assert str(first[1]).startswith(f"{first[1].name} (ma ")
    assert first[1].to_dict()["name"] == first[1].name


def test_a_file_without_a_pose_gets_one_and_a_warning_that_names_the_others():
    leg = ld.load(five_bar(home=False))
    with pytest.warns(LegDynamicsWarning, match=r"gives no configuration; .*other assembly modes there: mode_\w+ \(ma"):
        modes = leg.assembly_modes()
    assert len(modes) == 2
    chosen = ld.load(five_bar(home=False), mode=modes[1].name)
    home = chosen.backend.home_coordinates()
    for name, value in modes[1].coordinates.items():
        assert float(chosen.assemble(home)[name]) == pytest.approx(value, abs=1e-9)


def test_a_tree_has_one_mode():
    leg = ld.load("quadruped_leg", route="pinocchio")
    assert [mode.configurations for mode in leg.assembly_modes()] == [("home",)]


def test_the_shipped_leg_has_its_mode_first():
    modes = ld.load("omnileg", route="pinocchio").assembly_modes([0.1, 0.2, 0.3], attempts=10)
    assert set(modes[0].configurations) == {"home", "bent"}


@pytest.mark.parametrize(
    ("mode", "error", "text"),
    [
        ("mode_9", ParameterError, "no assembly mode 'mode_9': those found .* are mode_"),
        ({"kk": 1.0}, ParameterError, "unknown joint 'kk'"),
        ({"ka": math.nan}, ParameterError, "not a finite number"),
        ({"ka": "1"}, ParameterError, "not a finite number"),
        ({"ma": 0.0, "mb": math.pi}, AssemblyError, "no regular closed pose .* within 0.5"),
        (3, ParameterError, "a name or joint coordinates"),
    ],
)
def test_modes_that_do_not_exist(mode, error, text):
    with pytest.raises(error, match=text):
        ld.load(five_bar(), mode=mode)


@pytest.mark.parametrize(("mode", "searches"), [("mirrored", 1), ("mode_9", 1), ("mode_00000", 3)])
def test_only_what_has_the_form_of_a_name_is_searched_for_long(monkeypatch, mode, searches):
    tried = []

    def counted(mechanism, *, attempts):
        tried.append(attempts)
        return find_modes(mechanism, attempts=10)

    monkeypatch.setattr("leg_dynamics.mechanism.modes.find_modes", counted)
    with pytest.raises(ParameterError, match=f"no assembly mode '{mode}': those found .* are mode_"):
        ld.load(five_bar(), mode=mode)
    assert len(tried) == searches
    assert tried == sorted(tried)


def test_formulas_know_one_mode():
    with pytest.raises(RouteError, match="know one assembly mode"):
        ld.load("omnileg", route="closed_form", mode="home")
    with pytest.raises(UnsupportedError, match="assembly_modes"):
        ld.load("omnileg").assembly_modes()
    # By another route a mode can be chosen of a leg that has formulas too.
    leg = ld.load("omnileg", mode="bent")
    assert leg.route == "pinocchio"


@pytest.mark.parametrize("arguments", [{"attempts": 0}, {"seed": -1}, {"attempts": 1.5}, {"q": [[1.9, 1.1]]}])
def test_bad_arguments(arguments):
    with pytest.raises(ShapeError):
        ld.load(five_bar()).assembly_modes(**arguments)


# ------------------------------------------------------------------------------------------------- where modes end


@pytest.mark.parametrize("route", ROUTES)
def test_the_toggle_point_is_typed_and_not_passed(route):
    leg = ld.load(five_bar(), route=route)
    before, at, beyond = ([math.pi - TOGGLE + d, TOGGLE - d] for d in (-1e-3, 0.0, 1e-2))
    inside = leg.assemble(before)
    np.testing.assert_allclose([inside["ka"], inside["kb"]], knees(*before, 1.0), atol=1e-7)
    for q in (at, beyond):
        with pytest.raises((AssemblyError, SingularityError), match="a parallel singularity") as caught:
            leg.torque(q, [0.0, 0.0], [0.0, 0.0])
        assert caught.value.kind == "parallel"
        moving = {name for name, x in caught.value.direction.items() if abs(x) > 1e-3}
        assert moving == {"ka", "kb"}
        assert set(caught.value.pose) == {"ma", "mb"}
    # Coming back, it is still the same mode.
    after = leg.assemble(before)
    assert float(after["ka"]) == pytest.approx(float(inside["ka"]), abs=1e-9)


def omnileg_without_gears():
    import re

    return re.sub(r"<coupling.*?</coupling>", "", ld.load("omnileg").description.urdf, flags=re.DOTALL)


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_the_omnileg_without_gears_at_gamma_zero_is_typed(route):
    """With the gears out, the shank's chains fold at gamma = 0: mobility 6 there, 4 elsewhere."""
    leg = ld.load(omnileg_without_gears(), route=route)
    assert leg.joint_names == ("alpha", "beta", "gamma", "phi_D2")
    assert leg.actuation.idle == ("phi_D2",)
    zero = np.zeros(4)
    for q in ([0.0, 0.0, 0.0, 0.0], [0.1, 0.2, 0.0, 0.0]):
        with pytest.raises(SingularityError, match="a constraint singularity") as caught:
            leg.generalized_force(q, zero, zero)
        assert caught.value.kind == "constraint"
        with pytest.raises(SingularityError):
            leg.mass_matrix(q)
    assert np.isfinite(leg.generalized_force([0.1, 0.2, 0.3, -0.6], zero, zero)).all()


@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_beside_a_bifurcation_the_mass_matrix_is_that_of_its_neighbours_or_refused():
    """Within rounding of the folded pose G is bounded noise: it must not be taken for a result."""
    leg = ld.load(omnileg_without_gears(), route="pinocchio")
    reference = leg.mass_matrix([0.1, 0.2, 1e-3, -1e-3])
    answered = 0
    for offset in 10.0 ** np.arange(-14.0, -1.9, 0.5):
        found = leg.mass_matrix([0.1, 0.2, 0.0, -offset], on_error="nan")
        if np.isfinite(found).all():
            np.testing.assert_allclose(found, reference, atol=2e-5)
            answered += 1
    assert 4 <= answered < 20
