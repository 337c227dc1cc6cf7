from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from leg_dynamics.description import parse
from leg_dynamics.errors import DescriptionError
from leg_dynamics.mechanism.closure import Closure, cross_rows, rotation_from_z
from leg_dynamics.mechanism.tree import Tree

KINDS = ("revolute", "continuous", "prismatic", "fixed", "planar", "spherical", "universal")
finite = st.floats(-1e3, 1e3)


@given(st.integers(0, 6).flatmap(lambda r: st.tuples(*[arrays(float, (r, 3), elements=finite)] * 2)))
@settings(max_examples=60)
def test_cross_rows_is_the_cross_product(pair):
    a, b = pair
    expected = np.cross(a, b).reshape(-1, 3)
    np.testing.assert_array_equal(cross_rows(a, b), expected)
    out = np.full((len(a), 6), np.nan)
    cross_rows(a, b, out[:, 3:])
    np.testing.assert_array_equal(out[:, 3:], expected)


@given(arrays(float, 3, elements=st.floats(-1, 1)).filter(lambda a: np.linalg.norm(a) > 1e-3))
@settings(max_examples=100)
def test_rotation_from_z_is_a_rotation_onto_the_axis(axis):
    axis = axis / np.linalg.norm(axis)
    R = rotation_from_z(tuple(axis))
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_array_equal(R[:, 2], axis)


@pytest.mark.parametrize("axis", [s * e for s in (1, -1) for e in np.eye(3)])
def test_rotation_from_z_is_exact_along_coordinate_axes(axis):
    assert set(np.abs(rotation_from_z(tuple(axis))).ravel()) == {0.0, 1.0}


def central_difference(function, q, h=1e-6):
    return np.stack([(function(q + h * e) - function(q - h * e)) / (2 * h) for e in np.eye(len(q))], axis=1)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_is_the_derivative_of_the_residual_on_and_off_the_closed_surface(lab, kind, seed):
    bench = lab.Bench(lab.random_loop(kind, seed))
    rng = np.random.default_rng(seed)
    for q in (
        bench.home,
        bench.home + rng.normal(scale=0.3, size=len(bench.home)),
        rng.uniform(-2, 2, len(bench.home)),
    ):
        K = bench.rows(q).jacobian.copy()
        numeric = central_difference(lambda x: bench.rows(x).residual.copy(), q)
        np.testing.assert_allclose(K, numeric, atol=2e-8)


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_random_loops_are_closed_regular_and_as_stiff_as_their_type(lab, kind, seed):
    bench = lab.Bench(lab.random_loop(kind, seed))
    rows = bench.rows(bench.home)
    assert np.abs(rows.residual).max() < 1e-13
    assert bench.closure.points_the_same_way(bench.memory.rows())
    sigma = np.linalg.svd(rows.jacobian, compute_uv=False)
    assert len(sigma) == lab.LOOP_ROWS[kind] == bench.closure.rows
    assert sigma[-1] > 1e-3 * sigma[0]


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_drift_is_minus_the_second_derivative_along_closed_motions(lab, kind, seed):
    """Along q + qd t with K qd = 0, phi = -k t^2 / 2 + O(t^3); sliding pairs stand off and slide here."""
    bench = lab.Bench(lab.random_loop(kind, seed))
    rng = np.random.default_rng(seed + 10)
    K = bench.rows(bench.home).jacobian
    null = np.linalg.svd(K)[2][bench.closure.rows :]
    for _ in range(3):
        qd = null.T @ rng.normal(size=len(null))
        h = 2e-3

        def phi(t, qd=qd):
            return bench.rows(bench.home + t * qd).residual.copy()

        second = (-phi(2 * h) + 16 * phi(h) - 30 * phi(0) + 16 * phi(-h) - phi(-2 * h)) / (12 * h * h)
        k = bench.drift(bench.home, qd)
        assert np.abs(k).max() > 1e-3
        np.testing.assert_allclose(-second, k, atol=2e-8)


def test_drift_of_couplings_is_zero_and_of_no_loops_too(lab):
    bench = lab.Bench(lab.gears().xml)
    np.testing.assert_array_equal(bench.drift(bench.home, np.ones(3)), np.zeros(2))


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "fixed", "planar"])
def test_mirrored_pairs_have_the_same_rows_and_are_told_apart(lab, kind):
    """Half a turn about an axis of the loop frame zeroes the rows as well; that pair is not the joint."""
    text = lab.Text().joint("turn", "revolute", "base", "body", (1, 0, 0))
    text.loop(
        "closing",
        kind,
        ("base", lab.ZERO, lab.ZERO),
        ("body", lab.ZERO, lab.ZERO),
        None if kind == "fixed" else (0, 0, 1),
    )
    bench = lab.Bench(text.xml)
    for angle, right in ((0.0, True), (math.pi, False)):
        assert np.abs(bench.rows(np.array([angle])).residual).max() < 1e-15
        assert bench.closure.points_the_same_way(bench.memory.rows()) is right


def test_a_fixed_pair_a_third_of_a_turn_out_is_not_closed(lab):
    """A cyclic permutation of the axes zeroes x.y', y.z' and z.x' one way round: cosine 0 is refused, not only -1."""
    axis = np.ones(3) / math.sqrt(3)
    text = lab.Text().joint("turn", "revolute", "base", "body", axis)
    bench = lab.Bench(
        text.loop("closing", "fixed", ("base", lab.ZERO, lab.ZERO), ("body", lab.ZERO, lab.ZERO), None).xml
    )
    accepted = []
    for angle in (2 * math.pi / 3, -2 * math.pi / 3):
        bench.rows(np.array([angle]))
        accepted.append(bench.closure.points_the_same_way(bench.memory.rows()))
    assert accepted == [False, False]


def test_spherical_and_universal_pairs_have_no_wrong_way(lab):
    text = lab.Text().joint("turn", "revolute", "base", "body", (1, 0, 0))
    text.loop("closing", "spherical", ("base", lab.ZERO, lab.ZERO), ("body", lab.ZERO, lab.ZERO), None)
    bench = lab.Bench(text.xml)
    bench.rows(np.array([math.pi]))
    assert bench.closure.points_the_same_way(bench.memory.rows()) is True


def test_couplings_and_mimics_are_linear_rows(lab):
    bench = lab.Bench(lab.gears().xml)
    closure, names = bench.closure, bench.tree.joint_names
    assert closure.row_names == ("mesh", "rack")
    rows = bench.rows(bench.home)
    assert np.abs(rows.residual).max() < 1e-16
    q = dict.fromkeys(names, 0.0) | {"driver": 1.0}
    residual = bench.rows(np.array([q[name] for name in names])).residual * closure.row_unit
    # successor = ratio * predecessor; rack = 0.05 driver + 0.03
    assert residual == pytest.approx([2.5, -0.05 - 0.03])
    jacobian = rows.jacobian * closure.row_unit[:, None]
    assert dict(zip(names, jacobian[0], strict=True)) == pytest.approx({"driver": 2.5, "driven": 1.0, "rack": 0.0})
    assert dict(zip(names, jacobian[1], strict=True)) == pytest.approx({"driver": -0.05, "driven": 0.0, "rack": 1.0})


def test_rows_carry_names_and_owners(lab):
    closure = lab.Bench(lab.slider_crank(loop="prismatic").xml).closure
    assert closure.row_names == ("guide:x", "guide:y", "guide:x.y'", "guide:y.z'", "guide:z.x'")
    assert closure.row_owner == ("guide",) * 5
    assert closure.slices == (slice(0, 5),)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 2.0**10])
def test_rows_do_not_depend_on_the_mechanisms_size(lab, scale):
    """Rows are dimensionless, so every threshold means the same in millimetres."""
    bench = lab.Bench(lab.FourBar().text(scale=scale).xml)
    q = bench.home + 0.1
    reference = lab.Bench(lab.FourBar().text().xml).rows(q)
    rows = bench.rows(q)
    factor = bench.closure.length / (scale * 0.5)
    assert math.log2(bench.closure.length).is_integer()
    np.testing.assert_allclose(rows.residual[:3] * factor, reference.residual[:3], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(rows.residual[3:], reference.residual[3:], rtol=1e-9, atol=1e-12)


def test_the_characteristic_length_ignores_where_the_mechanism_stands(lab):
    def length(mount):
        text = lab.Text().joint("mount", "revolute", "base", "crank", xyz=mount)
        return lab.Bench(text.joint("rod", "prismatic", "crank", "rod_link", xyz=(0.26, 0, 0)).xml).closure.length

    assert length((100.0, 0, 0)) == length(lab.ZERO) == 0.25


def test_a_point_mechanism_and_one_without_joints_have_length_one(lab):
    assert lab.Bench(lab.Text().joint("turn", "revolute", "base", "body").xml).closure.length == 1.0


def test_a_description_without_moving_joints_has_no_rows(lab):
    description = parse(lab.Text().link("base").xml)
    assert Closure(description, Tree.from_description(description)).rows == 0


def test_an_unknown_loop_type_is_named(lab):
    import dataclasses

    description = parse(lab.FourBar().text().xml)
    odd = dataclasses.replace(description.loops[0], type="helical")
    changed = dataclasses.replace(description, loops=(odd,))
    with pytest.raises(DescriptionError, match="helical"):
        Closure(changed, Tree.from_description(changed))


def test_numpy_1_has_its_own_row_product():
    from leg_dynamics.mechanism import closure

    a, b = np.random.default_rng(0).normal(size=(2, 4, 3))
    out = np.empty(4)
    np.testing.assert_allclose(closure._einsum_rows(a, b, out), closure.dot_rows(a, b), rtol=1e-15)
