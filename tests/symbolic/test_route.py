"""The route over Programs: rows, warm starts, the fallback and its errors, threads."""

from __future__ import annotations

import re
import threading

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse, read
from leg_dynamics.errors import (
    ActuationError,
    AssemblyError,
    DescriptionError,
    ParameterError,
    RowFailures,
    SingularityError,
    UnsupportedError,
)
from leg_dynamics.mechanism.route import PinocchioRoute
from leg_dynamics.symbolic.route import SymbolicRoute


@pytest.fixture
def make(lab):
    def route(text, foot="foot", hip=None, **options):
        description = lab.quiet(parse if text.lstrip().startswith("<") else read, text)
        if options.pop("with_fallback", False):
            options["fallback"] = lambda: PinocchioRoute(description, foot, hip)
        return SymbolicRoute(description, foot, hip, lab.evaluate.evaluator, **options)

    return route


def test_what_the_interface_asks_for(make):
    route = make("omnileg", hip="hip")
    leg = ld.load("omnileg", route="pinocchio")
    assert route.joint_names == leg.joint_names
    assert route.actuator_joints == leg._route.actuator_joints
    assert set(route.tree_joint_names) == set(leg.tree_joint_names)
    assert route.branches == leg.branches
    assert np.allclose(route.gravity, leg.gravity, atol=1e-14)
    assert route.has_foot
    assert not route._models


def test_samples_batches_and_default_arguments(make, lab):
    route = make("omnileg", hip="hip")
    other = ld.load("omnileg", route="pinocchio")._route
    states = lab.states(np.zeros(3), np.full(3, 0.8), 6, 3)
    q, v, a, tau = (states[key] for key in ("q", "v", "a", "tau"))
    failures = RowFailures()
    batch = route.torque(q, v, a, None, None, failures)
    assert np.allclose(batch, other.torque(q, v, a, None, None, failures), atol=1e-10)
    assert np.allclose(route.torque(q[1], v[1], a[1], None, None, failures), batch[1], atol=1e-13)
    forward = route.acceleration(q, v, tau, states["foot_force"], states["gravity"], failures)
    wanted = other.acceleration(q, v, tau, states["foot_force"], states["gravity"], failures)
    assert np.allclose(forward, wanted, rtol=1e-9, atol=1e-9)
    assert route.potential_energy(q, None, failures).shape == (6,)
    assert route.torque(q[:0], v[:0], a[:0], None, None, failures).shape == (0, 3)
    assert not failures


def test_a_single_sample_continues_from_the_last_one(make, lab):
    # Within narrow limits no singular pose lies on the way, so that Newton may start anywhere.
    text = re.sub(r'lower="[^"]*" upper="[^"]*"', 'lower="-0.5" upper="0.5"', lab.random_loop("planar", 2))
    route = make(text, "link_b3")
    model = route.model
    assert model.iterates
    assert model.restarts
    failures = RowFailures()
    path = model.seed[: model.n] + np.linspace(0.0, 0.05, 9)[:, None] * model.unit[: model.n]
    along = np.array([route.tree_coordinates(q, failures) for q in path])
    # The next call starts from the last pose of this thread ...
    assert np.array_equal(route._last.poses[()][0], path[-1])
    # ... which changes rounding only, and a batch not at all.
    batch = route.tree_coordinates(path, failures)
    assert np.abs(along - batch).max() < 1e-11
    assert np.array_equal(batch, route.tree_coordinates(path, failures))
    seen = []
    thread = threading.Thread(target=lambda: seen.append(route._last.poses))
    thread.start()
    thread.join()
    assert seen == [{}]


def test_rows_that_fail_go_to_the_fallback_which_names_them(make, lab):
    text = lab.slider_crank(actuated="slide")
    route = make(text, with_fallback=True)
    bare = make(text)
    q = np.array([[0.7], [0.0], [0.3]])
    v = a = np.ones((3, 1))
    for each in (route, bare):
        failures = RowFailures()
        result = each.torque(q, v, a, None, None, failures)
        # At the dead centre the slider holds nothing.
        assert np.isnan(result[1]).all()
        assert np.isfinite(result[[0, 2]]).all()
        assert failures.rows.tolist() == [1]
        assert isinstance(failures.combined(3), SingularityError)


def test_out_of_reach_is_an_assembly_error(make, lab):
    route = make(lab.random_loop("planar", 1), "link_b3")
    q = route.model.seed[: route.model.n] + np.array([[0.0] * route.model.n, [50.0] * route.model.n])
    failures = RowFailures()
    result = route.mass_matrix(q, failures)
    assert np.isfinite(result[0]).all()
    assert np.isnan(result[1]).all()
    assert isinstance(failures.combined(2), AssemblyError)
    with_fallback = make(lab.random_loop("planar", 1), "link_b3", with_fallback=True)
    failures = RowFailures()
    with_fallback.mass_matrix(q, failures)
    assert failures.rows.tolist() == [1]


def test_a_fallback_computes_what_the_kernel_refuses(make, lab):
    text = lab.crank_rocker()
    refused = {"count": 0}

    def refusing(program):
        call = lab.evaluate.evaluator(program)

        def kernel(*arrays):
            result = np.array(call(*arrays))
            if arrays[0].ndim > 1:
                result[1] = np.nan
                refused["count"] += 1
            return result

        return kernel

    description = parse(text)
    route = SymbolicRoute(
        description, "foot", None, refusing, fallback=lambda: PinocchioRoute(description, "foot", None)
    )
    q = route.model.seed[:1] + np.array([[0.1], [0.2], [0.3]])
    failures = RowFailures()
    tree = route.tree_coordinates(q, failures)
    wanted = make(text).tree_coordinates(q, RowFailures())
    assert refused["count"] == 1
    assert not failures
    assert np.abs(tree - wanted).max() < 1e-10


def test_a_file_without_a_pose_needs_a_seed(make, lab):
    text = lab.crank_rocker()
    home = parse(text).home.values
    open_text = text[: text.index("<configuration")] + "</robot>"
    failures = RowFailures()
    q = np.array([[home["crank"]], [home["crank"] + 0.1]])
    assert np.isnan(make(open_text).foot_position(q, failures)).all()
    assert isinstance(failures.combined(2), AssemblyError)
    wanted = make(text).foot_position(q, RowFailures())
    found = make(open_text, seed=lambda: dict(home)).foot_position(q, RowFailures())
    assert np.allclose(found, wanted, atol=1e-12)


def test_a_file_with_a_pose_needs_no_search(make, lab):
    def search():
        raise AssertionError("the file defines its assembly mode")

    route = make(lab.crank_rocker(), seed=search)
    assert np.isfinite(route.foot_position(np.array([1.0]), RowFailures())).all()


def test_errors_that_are_no_rows(make, lab):
    route = make("omnileg", hip="hip")
    with pytest.raises(UnsupportedError):
        route.inverse_kinematics(np.zeros(3), "home", RowFailures())
    under = lab.gears().replace("</robot>", lab.motor("driver") + lab.motor("driven") + "</robot>")
    route = make(under)
    q = np.array([0.3])
    with pytest.raises(ActuationError):
        route.torque(q, q, q, None, None, RowFailures())
    assert route.generalized_force(q, q, q, None, None, RowFailures()).shape == (1,)
    with pytest.raises(DescriptionError):
        make(lab.crank_rocker().replace('independent="true"', 'independent="false"'))


def test_inverse_kinematics_is_the_fallbacks(make):
    route = make("omnileg", hip="hip", with_fallback=True)
    q = np.array([0.1, -0.2, 0.5])
    p = route.foot_position(q, RowFailures())
    found = route.inverse_kinematics(p, "bent", RowFailures())
    assert np.allclose(route.foot_position(found, RowFailures()), p, atol=1e-9)


def test_derivatives_side_by_side(make, lab):
    route = make("omnileg", hip="hip")
    states = lab.states(np.zeros(3), np.full(3, 0.5), 4, 3)
    q, v, a, tau = (states[key] for key in ("q", "v", "a", "tau"))
    failures = RowFailures()
    names = ("foot.mass", "knee.com.z")
    by_torque = route.torque_derivatives(q, v, a, None, None, names, failures)
    by_acceleration = route.acceleration_derivatives(q, v, tau, None, None, names, failures)
    assert by_torque.shape == by_acceleration.shape == (4, 3, 11)
    M = route.mass_matrix(q, failures)
    assert np.allclose(by_torque[..., 6:9], M, atol=1e-12)
    assert np.allclose(M @ by_acceleration[..., 6:9], np.eye(3), atol=1e-10)
    single = route.torque_derivatives(q[1], v[1], a[1], None, None, names, failures)
    assert np.allclose(single, by_torque[1], atol=1e-12)
    assert not failures


def test_numbers_and_those_that_cannot_be_varied(make):
    route = make("omnileg", hip="hip")
    numbers = route.numbers_of(read("omnileg"))
    assert numbers["foot.mass"] == 0.22
    assert numbers["gamma_C2.origin.yaw"] == pytest.approx(2.0943951)
    q = np.zeros(3)
    with pytest.raises(ParameterError):
        route.torque_derivatives(q, q, q, None, None, ("nothing",), RowFailures())
    columns = route.torque_derivatives(q, q, q, None, None, ("gamma_C2.origin.yaw", "bevel_1.ratio"), RowFailures())
    assert columns.shape == (3, 11)
    assert np.isfinite(columns).all()


def test_compiled_and_cached(tmp_path, monkeypatch, lab):
    monkeypatch.setenv("LEG_DYNAMICS_CACHE", str(tmp_path))
    description = parse(lab.crank_rocker())
    first = SymbolicRoute(description, "foot", None)
    q = np.linspace(0.0, 1.0, 5)[:, None]
    wanted = SymbolicRoute(description, "foot", None, lab.evaluate.evaluator).torque(q, q, q, None, None, RowFailures())
    assert np.allclose(first.torque(q, q, q, None, None, RowFailures()), wanted, atol=1e-10)
    again = SymbolicRoute(description, "foot", None)
    assert np.allclose(again.torque(q[2], q[2], q[2], None, None, RowFailures()), wanted[2], atol=1e-10)
