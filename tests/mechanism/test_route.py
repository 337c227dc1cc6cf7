from __future__ import annotations

import math
import pickle
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse, read
from leg_dynamics.errors import (
    AssemblyError,
    DescriptionError,
    LegDynamicsWarning,
    NonFiniteError,
    OutOfReachError,
    RowFailures,
    SingularityError,
)
from leg_dynamics.mechanism.mechanism import Mechanism
from leg_dynamics.mechanism.route import PinocchioRoute
from leg_dynamics.routes import Recipe


@pytest.fixture(scope="module")
def leg():
    return ld.load("omnileg", route="pinocchio")


def route_of(text, foot=None, hip=None):
    return PinocchioRoute(parse(text.xml), foot, hip)


def test_golden_foot_position(leg):
    q = np.radians([30.0, 20.0, 40.0])
    a, b, g = q
    rod = np.array([math.tan(b), -math.tan(a), 1.0])
    expected = 0.15 * rod / np.linalg.norm(rod) + np.array([0, 0, 2 * 0.095 * math.cos(g) + 0.16])
    np.testing.assert_allclose(leg.foot_position(q), expected, atol=1e-12)


def test_golden_torques_of_the_audit(leg):
    """Its bodies are the shipped ones; eq. 52 at t = 0, 1, 1.5 s; the force acts on the foot until 1 s."""
    rate, amplitude = math.pi / 3, np.radians([30.0, 30.0, 25.0])
    golden = {0.0: (-3.0, -0.000002, 0.0), 1.0: (-0.781006, 2.275804, 1.634104), 1.5: (0.823331, 0.823327, 0.264922)}
    for t, expected in golden.items():
        s, c = math.sin(rate * t), math.cos(rate * t)
        force = [0.0, -20.0, 20.0] if t <= 1.0 else None
        tau = leg.torque(amplitude * s, amplitude * rate * c, -amplitude * rate**2 * s, foot_force=force)
        np.testing.assert_allclose(tau, expected, atol=1e-6)


def test_a_batch_is_its_rows_one_by_one(leg, omnileg_box):
    rng = np.random.default_rng(1)
    q = rng.uniform(*omnileg_box, (12, 3))
    v, a, force, gravity = (rng.normal(size=(12, 3)) for _ in range(4))
    together = {
        "torque": leg.torque(q, v, a, force, gravity),
        "generalized_force": leg.generalized_force(q, v, a, force, gravity),
        "acceleration": leg.acceleration(q, v, a, force, gravity),
        "bias": leg.bias(q, v, gravity),
        "mass_matrix": leg.mass_matrix(q),
        "potential_energy": leg.potential_energy(q, gravity),
        "jacobian": leg.jacobian(q),
        "jacobian_derivative": leg.jacobian_derivative(q, v),
        "foot_acceleration": leg.foot_acceleration(q, v, a),
    }
    for i in range(12):
        single = {
            "torque": leg.torque(q[i], v[i], a[i], force[i], gravity[i]),
            "generalized_force": leg.generalized_force(q[i], v[i], a[i], force[i], gravity[i]),
            "acceleration": leg.acceleration(q[i], v[i], a[i], force[i], gravity[i]),
            "bias": leg.bias(q[i], v[i], gravity[i]),
            "mass_matrix": leg.mass_matrix(q[i]),
            "potential_energy": leg.potential_energy(q[i], gravity[i]),
            "jacobian": leg.jacobian(q[i]),
            "jacobian_derivative": leg.jacobian_derivative(q[i], v[i]),
            "foot_acceleration": leg.foot_acceleration(q[i], v[i], a[i]),
        }
        for name, value in single.items():
            np.testing.assert_allclose(together[name][i], value, rtol=1e-9, atol=1e-10, err_msg=name)


def test_assembled_coordinates_are_the_papers(lab, leg, omnileg_box):
    q = np.random.default_rng(2).uniform(*omnileg_box, (50, 3))
    got = leg.assemble(q)
    for i in range(50):
        for name, value in lab.omnileg_tree(q[i]).items():
            assert got[name][i] == pytest.approx(value, abs=1e-11)


def test_failing_rows_are_named_and_the_others_computed(lab):
    linkage = lab.FourBar(ground=0.4, crank=0.3, coupler=0.25, rocker=0.2)
    leg = ld.load(linkage.text(0.9).xml, foot="coupler_link")
    q = np.array([[0.9], [2.5], [1.0], [3.0]])
    with pytest.raises(AssemblyError, match=r"2 of 4 rows failed. first row 1") as caught:
        leg.foot_position(q)
    assert caught.value.rows.tolist() == [1, 3]
    assert (caught.value.margin < 0).all()
    points = leg.foot_position(q, on_error="nan")
    assert np.isnan(points[[1, 3]]).all()
    assert np.isfinite(points[[0, 2]]).all()
    with pytest.raises(AssemblyError) as caught:
        leg.torque([2.5], [0.0], [0.0])
    assert caught.value.reached == pytest.approx([math.acos((0.25 - 0.45**2) / 0.24)], abs=1e-4)
    assert np.isnan(leg.torque([2.5], [0.0], [0.0], on_error="nan")).all()


def test_wrong_flags_are_no_rows_fault(lab):
    """Flags that fit at home and nowhere else: a file's mistake is an error even where rows may fail quietly."""
    description = parse(lab.FourBar().text(flags=(True, True, True)).xml)
    leg = Recipe(description, "pinocchio", None, None).build()
    with pytest.raises(DescriptionError, match="mobility is 1"):
        leg.torque(np.zeros((4, 3)), np.zeros(3), np.zeros(3), on_error="nan")


def test_loop_forces_and_report_through_the_leg(leg):
    forces = leg.loop_forces(np.zeros(3), np.zeros(3), np.zeros(3))
    assert (forces.redundant_rows, forces.unique) == (9, False)
    assert set(forces.wrenches) == {"loop_B2", "loop_B3", "loop_B4", "loop_E2", "loop_E3"}
    assert set(forces.couplings) == {"bevel_1", "bevel_2", "bevel_3"}
    assert leg.mobility_report(samples=2).mobility == 3


# ------------------------------------------------------------------------------------------------- inverse kinematics


def test_inverse_kinematics_returns_to_the_joints(leg):
    rng = np.random.default_rng(3)
    q = rng.uniform(np.radians([-60, -60, 2]), np.radians([60, 60, 84]), (20, 3))
    np.testing.assert_allclose(leg.inverse_kinematics(leg.foot_position(q)), q, atol=1e-9)


def test_inverse_kinematics_out_of_reach_says_how_far(leg):
    with pytest.raises(OutOfReachError, match="nearest point found") as caught:
        leg.inverse_kinematics([0.0, 0.0, 0.6])
    assert caught.value.margin[0] == pytest.approx(-0.1, abs=2e-3)


def test_a_branch_is_the_configuration_it_is_named_after(lab):
    linkage = lab.FourBar()
    text = linkage.text(0.6, 1.0)
    for name, theta, mode in (("high", 2.0, 1.0), ("flipped", 1.0, -1.0)):
        coupler, rocker = linkage.angles(theta, mode)
        text.configuration(name, {"crank": theta, "coupler": coupler, "rocker": rocker})
    route = route_of(text, foot="crank_link")
    assert route.branches == ("home", "high", "flipped")
    assert route._start("high").y == pytest.approx([2.0])
    with pytest.raises(AssemblyError, match="'flipped' lies in another assembly mode than the file's first"):
        route._start("flipped")
    failures = RowFailures()
    assert np.isnan(route.inverse_kinematics(np.zeros((2, 3)), "flipped", failures)).all()
    assert failures.rows.tolist() == [0, 1]


def test_a_rounded_branch_is_the_pose_it_means(lab):
    linkage = lab.FourBar()
    coupler, rocker = linkage.angles(2.0, 1.0)
    text = linkage.text(0.6).configuration(
        "high", {"crank": 2.0, "coupler": round(coupler, 2), "rocker": round(rocker, 2)}
    )
    assert route_of(text, foot="crank_link")._start("high").residual < 1e-12


def test_without_configurations_the_branch_is_home(lab):
    route = route_of(lab.open_chain(), "foot", "hip")
    assert route.branches == ("home",)
    q = np.array([0.4, 0.6, 0.1])
    p = route.foot_position(q, RowFailures())
    found = route.inverse_kinematics(p, "home", RowFailures())
    np.testing.assert_allclose(route.foot_position(found, RowFailures()), p, atol=1e-9)


# ------------------------------------------------------------------------------------------------ threads and pickles


def test_threads_and_pickles(leg, omnileg_box):
    rng = np.random.default_rng(5)
    batches = rng.uniform(*omnileg_box, (4, 50, 3))
    alone = [ld.load("omnileg", route="pinocchio").torque(q, q, q) for q in batches]
    fresh = ld.load("omnileg", route="pinocchio")
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda q: fresh.torque(q, q, q), batches))
    np.testing.assert_array_equal(together, alone)
    copy = pickle.loads(pickle.dumps(leg))
    np.testing.assert_allclose(copy.torque(batches[0], batches[0], batches[0]), alone[0], atol=1e-12)


# ------------------------------------------------------------------------------------------------------ foreign files


def foreign(lab):
    return sorted(lab.SHARED_MODELS.glob("*.urdf")) if lab.SHARED_MODELS.is_dir() else []


@pytest.mark.parametrize(
    ("file", "mobility"),
    [
        ("four_bar", 1),
        ("six_bar", 3),
        ("mini_cheetah_leg", 3),
        ("revolute_rotor_chain", 3),
        ("parallel_chain_explicit_d5_l6", 9),
        ("parallel_chain_implicit_d5_l5", 9),
    ],
)
def test_models_that_others_wrote_work(lab, file, mobility):
    path = lab.SHARED_MODELS / f"{file}.urdf"
    if not path.is_file():
        pytest.skip(f"{path} is not on this machine")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LegDynamicsWarning)
        leg = ld.load(str(path))
        mechanism = leg.backend.mechanism
        seed = mechanism.seeds[0]
    n = mechanism.n
    assert n == mobility == leg.mobility_report(samples=1).mobility
    v, a = np.full(n, 0.3), np.full(n, -0.7)
    tau = leg.generalized_force(seed.y, v, a)
    effort = np.zeros(mechanism.nv)
    effort[mechanism.independent] = tau
    qdd = lab.kkt_acceleration(mechanism, mechanism.close(seed.y), v, effort)
    np.testing.assert_allclose(qdd[mechanism.independent], a, atol=1e-8)


def test_every_shared_file_is_listed_above(lab):
    names = {path.stem for path in foreign(lab)}
    if not names:
        pytest.skip("the shared models are not on this machine")
    listed = {"four_bar", "six_bar", "mini_cheetah_leg", "revolute_rotor_chain"}
    assert names == listed | {"parallel_chain_explicit_d5_l6", "parallel_chain_implicit_d5_l5"}


def test_reading_the_shipped_file_and_its_text_is_the_same_route():
    description = read("omnileg")
    q = np.array([0.1, -0.2, 0.3])
    one, other = (PinocchioRoute(d, "foot", "hip") for d in (description, parse(description.urdf)))
    np.testing.assert_array_equal(one.foot_position(q, RowFailures()), other.foot_position(q, RowFailures()))


def test_singular_rows_are_reported_with_the_rest_of_the_batch(lab):
    leg = ld.load(lab.parallelogram(0.8, 2).xml, foot="coupler_link0")
    with pytest.raises((SingularityError, AssemblyError)) as caught:
        leg.torque([[0.5], [-0.5]], [1.0], [0.0])
    assert caught.value.rows.tolist() == [1]


def test_inverse_kinematics_reaches_the_corners_where_a_straight_descent_folds_the_shank(omnileg):
    corners = np.radians([(a, b, 85.0) for a in (-65, 65) for b in (-65, 65)])
    leg = ld.load("omnileg", route="pinocchio")
    np.testing.assert_allclose(leg.inverse_kinematics(leg.foot_position(corners)), corners, atol=1e-9)


@pytest.mark.parametrize(("v", "a"), [(1e200, 0.0), (0.0, 1e308)])
def test_overflow_stays_in_its_row_and_warns_of_nothing(leg, omnileg_description, v, a):
    route = PinocchioRoute(omnileg_description, "foot", "hip")
    q = np.full((2, 3), 0.2)
    speed, acceleration = np.array([[1.0] * 3, [v] * 3]), np.array([[1.0] * 3, [a] * 3])
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        failures = RowFailures()
        torque = route.torque(q, speed, acceleration, None, None, failures)
        assert not failures
        single = route.torque(q[1], speed[1], acceleration[1], None, None, failures)
        with pytest.raises(NonFiniteError):
            leg.torque(q, speed, acceleration)
        with pytest.raises(NonFiniteError):
            leg.loop_forces(q[1], speed[1], acceleration[1])
    assert np.isfinite(torque[0]).all()
    assert not np.isfinite(torque[1]).all()
    assert not np.isfinite(single).all()


def test_inverse_kinematics_of_one_joint(lab):
    text = lab.Text("one").joint("turn", "revolute", "base", "body", (0, 1, 0))
    route = route_of(text.joint("toe", "fixed", "body", "foot", xyz=(0.3, 0, 0)), "foot")
    reached = route.inverse_kinematics(0.3 * np.array([math.cos(0.4), 0.0, -math.sin(0.4)]), "home", RowFailures())
    assert reached == pytest.approx([0.4], abs=1e-9)


@pytest.mark.filterwarnings("ignore::leg_dynamics.errors.LegDynamicsWarning")
def test_a_closed_home_of_impossible_proportions_is_named_soon(monkeypatch):
    evaluations = 0
    plain = Mechanism.evaluate

    def counted(mechanism, q):
        nonlocal evaluations
        evaluations += 1
        return plain(mechanism, q)

    monkeypatch.setattr(Mechanism, "evaluate", counted)
    with pytest.raises(AssemblyError, match=r"given pose is closed .* nearly singular, smallest pivot 3\.\d+e-11"):
        ld.load("omnileg", route="pinocchio").replace(L1=1e9).torque(np.full(3, 0.1), np.zeros(3), np.zeros(3))
    assert evaluations < 60 * 2 * 100 + 2000
