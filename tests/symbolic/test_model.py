"""What is found from samples: relations, merged inertia, explicit steps, and the seed."""

from __future__ import annotations

import numpy as np
import pytest

from leg_dynamics.description import parse, read
from leg_dynamics.errors import AssemblyError, DescriptionError
from leg_dynamics.symbolic import model as symbolic_model
from leg_dynamics.symbolic.closure import Closure
from leg_dynamics.symbolic.coordinates import reduce_coordinates
from leg_dynamics.symbolic.dynamics import Body, reduce_inertia
from leg_dynamics.symbolic.model import build_model
from leg_dynamics.symbolic.motion import Orientation, Position
from leg_dynamics.symbolic.numbers import Numbers
from leg_dynamics.symbolic.sampling import ClosureArrays
from leg_dynamics.symbolic.seed import find_seed, needs_seed
from leg_dynamics.symbolic.tree import BodyInertia, build_tree, characteristic_length


@pytest.fixture(scope="module")
def omnileg():
    return symbolic_model.build_model(read("omnileg"), "foot", "hip")


def test_omnileg_keeps_four_unknowns_and_finds_them_one_by_one(omnileg):
    assert omnileg.coordinates.names[3:] == ("theta12", "theta22", "cardan_A4_y", "cardan_A4_x")
    assert not omnileg.iterates
    forms = omnileg.coordinates.forms
    assert forms["phi_D2"].terms == ((2, -2.0),)
    assert forms["theta33"] == forms["theta12"]


def test_omnileg_inertia_merges_into_few_parameters(omnileg):
    values = [value for body in omnileg.bodies for value in body.inertia.values() if value != 0.0]
    assert len(values) < 20


def test_a_relation_that_is_not_exact_is_not_used(lab):
    text = lab.slider_crank()
    assert build_model(parse(text)).nz == 2


def test_relations_hold_for_one_geometry_and_merged_inertia_for_one_set_of_masses():
    model = build_model(read("omnileg"), "foot", "hip", parameters=["foot.mass"])
    assert model.nz == 4
    assert len(model.bodies) > 20
    model = build_model(read("omnileg"), "foot", "hip", parameters=["theta13.origin.z"])
    assert model.nz == 16
    assert model.iterates
    assert model.pattern.all()


def parts(description):
    coordinates = reduce_coordinates(description)
    numbers = Numbers.of(description)
    tree = build_tree(description, coordinates, numbers, None, characteristic_length(description))
    return coordinates, ClosureArrays(Closure(description, tree), coordinates.n, np.ones(len(coordinates.names)))


def test_rounded_configurations_are_corrected(lab):
    description = parse(lab.crank_rocker())
    coordinates, arrays = parts(description)
    rounded = {name: round(value, 3) for name, value in description.home.values.items()}
    exact = find_seed(description, coordinates, arrays)
    found = find_seed(description, coordinates, arrays, rounded)
    phi, _ = arrays.rows(found[None])
    assert np.abs(phi).max() < 1e-14
    assert np.abs(found - exact).max() < 5e-3


def test_an_open_or_mirrored_pose_is_no_seed(lab):
    text = lab.crank_rocker()
    description = parse(text)
    coordinates, arrays = parts(description)
    assert not needs_seed(description, coordinates, arrays)
    with pytest.raises(AssemblyError):
        find_seed(description, coordinates, arrays, {"crank": 0.0, "coupler": 0.0, "rocker": 1.0})
    bare = parse(text[: text.index("<configuration")] + "</robot>")
    assert needs_seed(bare, coordinates, arrays)
    with pytest.raises(AssemblyError):
        find_seed(bare, coordinates, arrays)


def test_flags_that_do_not_fit_the_mobility(lab):
    text = lab.crank_rocker()
    with pytest.raises(DescriptionError, match="mobility"):
        build_model(parse(text.replace('independent="false"', 'independent="true"', 1)))
    free = text[: text.index("<loop")] + text[text.index("<configuration") :]
    with pytest.raises(DescriptionError):
        build_model(parse(free))


@pytest.mark.filterwarnings("ignore:.*beyond its lower limit")
def test_joint_limits_that_leave_no_room_teach_no_coincidences(lab):
    # All samples in one pose: everything would seem constant, and any inertia as good as another.
    text = lab.crank_rocker()
    start = text.index("<limit ")
    pinned = text[:start] + text[start:].replace('lower="-2" upper="2"', 'lower="0.6" upper="0.6"')
    model = symbolic_model.build_model(parse(pinned), "foot")
    wide = symbolic_model.build_model(parse(text), "foot")
    assert model.nz == wide.nz
    assert np.ptp(model.samples[:, 0]) > 0.1


ROOT = Orientation(None, None, None, None)


def units(count):
    """Bodies (count) whose inertial parameters are 1, 2, ... each."""
    return [
        Body(ROOT, Position(0.0), BodyInertia(v[0], tuple(v[1:4]), tuple(v[4:])))
        for v in (np.arange(1.0, 11.0) + 10.0 * k for k in range(count))
    ]


def columns_of(generator, samples=60, coordinates=2):
    """Forces of 20 parameters of which every third is the sum of the two before, (S, n, 2, 10)."""
    columns = generator.standard_normal((samples, coordinates, 20))
    columns[..., 2::3] = columns[..., 0:-2:3] + columns[..., 1:-1:3]
    return columns


def parameters(bodies):
    return np.array([body.inertia.values() for body in bodies], dtype=float).reshape(-1)


@pytest.mark.parametrize("decades", [0.0, 3.0, 6.0])
def test_merged_inertia_has_its_digits_where_some_poses_weigh_much_more(decades):
    generator = np.random.default_rng(4)
    columns = columns_of(generator)
    # Beside a singular pose all forces are large.
    columns *= 10.0 ** generator.uniform(0.0, decades, (60, 1, 1))
    bodies = units(2)
    merged = reduce_inertia(bodies, columns.reshape(60, 2, 2, 10))
    assert len(merged) == 2
    theta, found = parameters(bodies), parameters(merged)
    assert np.count_nonzero(found) <= 14
    other = columns_of(generator)
    np.testing.assert_allclose(other @ found, other @ theta, rtol=1e-11, atol=1e-10)


@pytest.mark.parametrize(("apart", "merges"), [(0.0, True), (1e-7, False), (1e-3, True)])
def test_parameters_that_the_samples_hardly_tell_apart_are_not_merged(apart, merges):
    generator = np.random.default_rng(5)
    columns = columns_of(generator)
    columns[..., 4] = columns[..., 3] + apart * columns[..., 4]
    columns[..., 5] = columns[..., 3] + columns[..., 4]
    bodies = units(2)
    merged = reduce_inertia(bodies, columns.reshape(60, 2, 2, 10))
    assert (np.count_nonzero(parameters(merged)) < 20) == merges


@pytest.mark.parametrize(
    ("distinct", "spread", "varied"), [(240, 1.0, True), (240, 0.05, False), (39, 1.0, False), (1, 1.0, False)]
)
def test_samples_that_hardly_differ_tell_nothing_of_other_poses(distinct, spread, varied):
    y = spread * np.random.default_rng(6).uniform(-0.5, 0.5, (distinct, 3))
    assert symbolic_model._are_varied(np.resize(y, (240, 3))) == varied
