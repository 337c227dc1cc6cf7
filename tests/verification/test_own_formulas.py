"""Own formulas with an error planted in each: the report has to name the equation, the entry and what is wrong."""

from __future__ import annotations

import io
import json
import math
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

import leg_dynamics as ld
from leg_dynamics.errors import CrosscheckError, MissingFootError, ParameterError, ShapeError
from leg_dynamics.verification.own_formulas import METHODS

EXAMPLES = Path(__file__).parents[2] / "examples"


def example():
    loader = SourceFileLoader("own_formulas_example", str(EXAMPLES / "my_leg.py"))
    module = module_from_spec(spec_from_loader(loader.name, loader))
    loader.exec_module(module)
    return module


MyLeg = example().MyLeg


class Whole(MyLeg):
    """Every method of the interface, with loads."""

    def foot_velocity(self, q, v):
        return np.array(self.jacobian(q)) @ v

    def generalized_force(self, q, v, a, foot_force=None):
        return self.torque(q, v, a, foot_force)


@pytest.fixture(scope="module")
def leg():
    return ld.load(EXAMPLES / "my_leg.urdf", "symbolic")  # compiled once, and then the fastest


def held(own, leg, samples=60, **options):
    return ld.crosscheck(own, leg, samples=samples, **options)


def verdicts(report, group="against the file"):
    return {check.quantity: check.passed for check in report.checks if check.group == group}


def cause(report, method):
    """The only failing check that nothing explains."""
    (found,) = report.causes
    assert found.method == method
    assert not report.passed
    return found


def changed(method, change, base=Whole):
    """A class whose `method` passes through ``change(value, *arguments)``."""

    class Changed(base):
        pass

    original = getattr(base, method)

    def altered(self, *arguments, **options):
        return change(np.array(original(self, *arguments, **options), dtype=float), *arguments, **options)

    altered.__doc__ = original.__doc__
    altered.__signature__ = __import__("inspect").signature(original)
    setattr(Changed, method, altered)
    return Changed()


def test_right_formulas_agree_and_nothing_is_said_of_them(leg):
    told = []
    report = held(Whole(), leg, samples=80, progress=lambda what, share: told.append(share))
    report.raise_if_failed()
    assert report.passed
    assert report.causes == ()
    assert report.not_given == ()
    assert report.not_compared == {}
    assert report.notes == ()
    assert len(report.checks) == len(METHODS) + 2  # torque and generalized force with a foot force
    assert all(check.findings == () and check.follows_from == "" and check.share == 0.0 for check in report.checks)
    assert all(check.worst < 1e-12 for check in report.checks)
    assert {check.samples for check in report.checks if check.method != "inverse_kinematics"} == {80}
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_what_is_missing_is_listed(leg):
    report = held(SimpleNamespace(foot_position=MyLeg().foot_position, jacobian=MyLeg().jacobian), leg)
    assert report.passed
    assert [check.method for check in report.checks] == ["foot_position", "jacobian"]
    assert report.not_given == tuple(name for name in METHODS if name not in ("foot_position", "jacobian"))


def negated(*index):
    def change(value, *_, **__):
        value[index] *= -1.0
        return value

    return change


def exchanged(axis, *order):
    return lambda value, *_, **__: value.take(order, axis=axis)


def scaled(factor):
    return lambda value, *_, **__: factor * value


SLICE = slice(None)

# Method, planted error, what the report has to say.
PLANTED = [
    ("foot_position", negated(2), "foot z is the negative of the reference: a sign error"),
    ("foot_position", scaled(1000.0), "every entry is 1000 times (millimetres for metres) the reference"),
    ("foot_position", lambda p, *_: np.add(p, [0.0, 0.0, 0.02]), "foot z is off by the constant 0.02"),
    ("foot_position", exchanged(0, 2, 1, 0), "the entries x, z are exchanged"),
    ("jacobian", negated(SLICE, 1), "every entry of column theta2 is the negative of the reference: a sign error"),
    ("jacobian", negated(2, SLICE), "every entry of row z is the negative of the reference: a sign error"),
    ("jacobian", negated(2, 1), "d foot z / d theta2 is the negative of the reference: a sign error"),
    ("jacobian", scaled(2.0), "every entry is twice the reference"),
    ("jacobian", scaled(math.pi / 180.0), "every entry is pi/180 times (degrees for radians) the reference"),
    ("jacobian", scaled(-0.5), "every entry is minus half the reference"),
    ("jacobian", scaled(0.7), "every entry is 0.7 times the reference"),
    ("jacobian", scaled(0.0), "every entry is zero"),
    ("jacobian", exchanged(1, 1, 0), "the columns theta1, theta2 are exchanged"),
    ("jacobian", exchanged(0, 2, 1, 0), "the rows x, z are exchanged"),
    ("jacobian_derivative", negated(SLICE, 0), "every entry of column theta1 is the negative of the reference"),
    ("foot_velocity", scaled(-1.0), "every entry is the negative of the reference: a sign error"),
    ("mass_matrix", lambda M, q: np.add(M, [[0, q[0]], [-q[0], 0]]), "the symmetric part agrees"),
    ("mass_matrix", lambda M, q: np.add(M, [[0.01, 0], [0, 0]]), "M[theta1, theta1] is off by the constant 0.01"),
    ("kinetic_energy", scaled(2.0), "every value is twice the reference"),
    ("potential_energy", lambda V, q: V + 3.0, "every value is off by the constant 3"),
    ("potential_energy", scaled(1.0 / 9.81), "every value is 1/g times (g is missing) the reference"),
    ("gravity_torque", negated(0), "theta1 is the negative of the reference: a sign error"),
    ("gravity_torque", scaled(0.5), "every entry is half the reference"),
    ("bias", lambda h, q, v: h - MyLeg().gravity_torque(q), "every entry: without the gravity term"),
    ("bias", lambda h, q, v: np.array(MyLeg().gravity_torque(q)), "every entry: without the velocity terms"),
    ("bias", lambda h, q, v: h - 2.0 * np.array(MyLeg().gravity_torque(q)), "wrong sign of the gravity term"),
    ("bias", lambda h, q, v: h + v**3, "agrees at v = 0: the velocity terms are wrong"),
    ("torque", lambda t, q, v, a, foot_force=None: t + a**2, "agrees at a = 0: the inertia term is wrong"),
    ("torque", lambda t, q, v, a, foot_force=None: t + MyLeg().mass_matrix(q) @ a, "twice the inertia term M a"),
    ("acceleration", lambda a, q, v, tau: a + v**3, "agrees at v = 0: the velocity terms are wrong"),
    ("acceleration", lambda a, q, v, tau: MyLeg().acceleration(q, v, 0 * tau), "without the actuators' term"),
]


@pytest.mark.parametrize(("method", "change", "said"), PLANTED, ids=[f"{m}: {s[:40]}" for m, _, s in PLANTED])
def test_a_planted_error_is_found_and_named(leg, method, change, said):
    # Only what computes with the changed method may fail beside it.
    report = held(changed(method, change, MyLeg if method == "torque" else Whole), leg)
    found = [check for check in report.causes if check.method == method]
    assert found, [check.method for check in report.causes]
    assert any(said in text for text in found[0].findings), found[0].findings
    assert {check.method for check in report.causes} == {method}


def test_the_failing_row_has_all_evidence(leg):
    own = Whole("jacobian")
    found = cause(held(own, leg), "jacobian")
    assert found.label == "jacobian (4)"
    assert found.component == "d foot z / d theta2"
    q = [found.at["theta1"], found.at["theta2"]]
    assert found.own == own.jacobian(q)[2][1]
    assert found.reference == pytest.approx(leg.jacobian(q)[2, 1], abs=1e-14)
    assert found.share == 1.0
    assert found.worst == pytest.approx(abs(found.own - found.reference) / (1 + np.abs(leg.jacobian(q)).max()))
    assert "the foot Jacobian is not the derivative of the own position, although foot position agrees" in str(
        found.findings
    )


# ---------------------------------------------------------------------- upstream first


def test_a_wrong_length_is_found_in_the_position_and_not_in_what_follows(leg):
    class Longer(Whole):
        l2 = 0.25

    report = held(Longer(), leg)
    follows = {check.method: check.follows_from for check in report.checks if not check.passed and check.component}
    assert {check.method for check in report.causes} == {"foot_position"}
    for method in ("jacobian", "jacobian_derivative", "foot_velocity", "foot_acceleration", "torque"):
        assert follows[method] == "foot_position"
    assert follows["inverse_kinematics"] == "foot_position"
    own = verdicts(report, "own formulas among themselves")
    assert own["is the derivative of the own position"]
    assert own["is inverse to the own position"]


def test_an_error_of_its_own_beside_one_further_up(leg):
    class Both(Whole):
        l2 = 0.25

        def jacobian(self, q):
            J = np.array(super().jacobian(q))
            J[0, 0] *= -1.0
            return J

    report = held(Both(), leg)
    assert [check.method for check in report.causes][:2] == ["foot_position", "jacobian"]
    text = "; ".join(report.causes[1].findings)
    assert "is not the derivative of the own position, an error here beside that in foot position" in text


@pytest.mark.parametrize(
    ("fault", "method", "followers"),
    [
        ("mass", "mass_matrix", {"kinetic_energy", "bias", "generalized_force", "torque", "acceleration"}),
        ("coriolis", "bias", {"generalized_force", "torque", "acceleration"}),
        ("gravity", "gravity_torque", {"bias", "generalized_force", "torque", "acceleration"}),
    ],
)
def test_dynamics_upstream(leg, fault, method, followers):
    report = held(Whole(fault), leg)
    assert {check.method for check in report.causes} == {method}
    group = [check for check in report.checks if check.group == "against the file"]
    assert {check.method: check.follows_from for check in group if check.follows_from} == dict.fromkeys(
        followers, method
    )
    if fault == "coriolis":
        assert "wrong sign of the velocity terms" in str(report.causes[0].findings)


def test_an_energy_that_explains_the_gravity_torque(leg):
    class Heavier(Whole):
        def potential_energy(self, q):
            return 1.1 * super().potential_energy(q)

        def gravity_torque(self, q):
            return 1.1 * np.array(super().gravity_torque(q))

    assert {check.method for check in held(Heavier(), leg).causes} == {"potential_energy"}


def test_torque_against_the_bias_where_there_is_no_mass_matrix(leg):
    class Few:
        bias, torque = Whole("coriolis").bias, Whole("coriolis").torque

    report = held(Few(), leg)
    cause(report, "bias")
    assert verdicts(report, "own formulas among themselves") == {"is the bias force at a = 0": True}


def test_the_foot_force_with_the_opposite_sign(leg):
    report = held(MyLeg("foot_force"), leg)
    found = cause(report, "torque")
    assert found.quantity == "torque with foot force"
    text = "; ".join(found.findings)
    assert "wrong sign of the foot force's term" in text
    assert "own values differ by 2 J^T foot_force: foot_force is what the environment applies to the foot" in text
    assert "agrees without foot force" in text
    assert verdicts(report)["torque"]


def test_a_foot_force_that_nothing_is_done_with(leg):
    own = SimpleNamespace(torque=lambda q, v, a, foot_force: MyLeg().torque(q, v, a))
    found = cause(held(own, leg), "torque")
    assert "the argument foot_force changes nothing" in found.findings


# ---------------------------------------------------------------------- meaning of the angles


@pytest.mark.parametrize(
    ("angles", "said"),
    [
        (np.radians, "true if the angles were in degrees"),
        (lambda q: [q[0], -q[1]], "true if theta2 counted in the opposite direction"),
        (lambda q: [q[0], q[1] + q[0]], "true if theta2 were theta2 + theta1: absolute and relative angle"),
        (lambda q: [q[0], q[1] - q[0]], "true if theta2 were theta2 - theta1: absolute and relative angle"),
    ],
    ids=["degrees", "direction", "relative", "absolute"],
)
def test_angles_of_another_meaning(leg, angles, said):
    right = MyLeg()
    own = SimpleNamespace(foot_position=lambda q: right.foot_position(angles(q)))
    assert said in cause(held(own, leg), "foot_position").findings


def test_an_error_in_one_region(leg):
    right = MyLeg()

    def foot_position(q):
        x, y, z = right.foot_position(q)
        return [x + 0.1 * max(0.0, q[0] - 0.5) ** 2, y, z]

    found = cause(held(SimpleNamespace(foot_position=foot_position), leg), "foot_position")
    (text,) = [text for text in found.findings if "nowhere else" in text]
    assert text.startswith("disagrees at those where theta1 > 0.")
    assert "only foot x off, the other entries agree" in found.findings
    assert 0.2 < found.share < 0.8


# ---------------------------------------------------------------------- joint angles and inverse kinematics


def test_assemble(leg):
    right = MyLeg()
    whole_turn = SimpleNamespace(assemble=lambda q: right.assemble(q) | {"knee": q[1] - q[0] + 2 * math.pi})
    assert held(whole_turn, leg).passed
    some = SimpleNamespace(assemble=lambda q: {"knee": q[1] - q[0]})
    assert held(some, leg).passed
    wrong = SimpleNamespace(assemble=lambda q: right.assemble(q) | {"knee": q[0] - q[1]})
    found = cause(held(wrong, leg), "assemble")
    assert found.component == "knee"
    assert "knee is the negative of the reference: a sign error" in found.findings


def test_assemble_in_another_mode(leg):
    # Mirror the kite of thigh, shank stub, coupler and crank at its diagonal from knee to crank pin.
    right = MyLeg()

    def assemble(q):
        t1, t2 = q
        knee = np.array([right.l1 * math.sin(t1), -right.l1 * math.cos(t1)])
        pin = np.array([-right.b * math.sin(t2), right.b * math.cos(t2)])
        along = (pin - knee) / np.linalg.norm(pin - knee)
        end = knee + np.array([-right.b * math.sin(t2), right.b * math.cos(t2)])
        mirrored = knee + 2.0 * along * (along @ (end - knee)) - (end - knee)
        shank = math.atan2(-(mirrored - knee)[0], (mirrored - knee)[1])
        coupler = math.atan2((mirrored - pin)[0], -(mirrored - pin)[1])
        return {"theta1": t1, "theta2": t2, "knee": shank - t1, "crank_pin": coupler - t2}

    found = cause(held(SimpleNamespace(assemble=assemble), leg), "assemble")
    assert "another assembly mode than the file's configuration" in str(found.findings)


@pytest.mark.parametrize(
    ("returned", "said"),
    [
        ([0.0, 1.0], "returned list, expected a mapping of joint name to coordinate"),
        ({"elbow": 0.0}, "names elbow: the file's joints are"),
        ({"knee": "bent"}, "no array of numbers"),
        ({}, "returned a mapping without joints"),
    ],
)
def test_assemble_of_no_use(leg, returned, said):
    found = cause(held(SimpleNamespace(assemble=lambda q: returned), leg, samples=10), "assemble")
    assert said in found.detail


def test_inverse_kinematics(leg):
    right = MyLeg()
    elsewhere = SimpleNamespace(
        foot_position=right.foot_position,
        inverse_kinematics=lambda p: np.add(right.inverse_kinematics(p), [0.1, 0.0]),
    )
    found = cause(held(elsewhere, leg), "inverse_kinematics")
    assert "of the joint coordinates, theta1 is off by the constant 0.1" in str(found.findings)
    assert "the inverse kinematics is not inverse to the own position, although foot position agrees" in str(
        found.findings
    )
    lost = SimpleNamespace(inverse_kinematics=lambda p: [0.3, 0.3])
    assert "cannot be assembled at the joint coordinates found" in cause(held(lost, leg), "inverse_kinematics").detail


# ---------------------------------------------------------------------- what formulas do instead of returning numbers


def explode(q):
    raise RuntimeError("no such root")


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (explode, "raised RuntimeError: no such root (test_own_formulas.py:"),
        (lambda q: [math.nan, 0.0, 0.0], "returned NaN or infinity, at 12 of 12 states"),
        (lambda q: [math.inf, 0.0, 0.0], "returned NaN or infinity"),
        (lambda q: [0.0, 0.0], "returned shape (2,), expected (3,)"),
        (lambda q: np.zeros((3, 1)), "returned shape (3, 1), expected (3,): return a flat array, .ravel()"),
        (lambda q: None, "returned nothing: is a return missing?"),
        (lambda q: "down", "returned str that is no array of numbers"),
        (lambda q: [[1.0], [1.0, 2.0]], "no regular array of numbers"),
        (lambda q: [1j, 0.0, 0.0], "returned complex numbers"),
        (
            lambda q, extra: [0.0, 0.0, 0.0],
            "cannot be called as foot_position(q): missing a required argument: 'extra'",
        ),
        (lambda: [0.0, 0.0, 0.0], "cannot be called as foot_position(q): too many positional arguments"),
    ],
    ids=["raise", "nan", "inf", "shape", "column", "none", "text", "ragged", "complex", "extra", "no argument"],
)
def test_no_numbers(leg, function, said):
    report = held(SimpleNamespace(foot_position=function, mass_matrix=MyLeg().mass_matrix), leg, samples=12)
    found = cause(report, "foot_position")
    assert said in found.detail
    assert math.isnan(found.worst)
    assert found.share == 1.0
    assert verdicts(report) == {"foot position": False, "mass matrix": True}
    assert json.loads(report.to_json())["checks"][0]["own"] is None


def test_an_exception_at_some_states(leg):
    def foot_position(q):
        math.sqrt(0.4 - q[0])
        return MyLeg().foot_position(q)

    found = cause(held(SimpleNamespace(foot_position=foot_position), leg), "foot_position")
    # The text of a domain error differs between versions of Python.
    assert found.detail.startswith("raised ValueError: ")
    assert "all those where theta1 > 0." in found.detail
    assert 0.2 < found.share < 0.95
    assert f"at {round(60 * found.share)} of 60 states" in found.detail


def test_an_interrupt_is_not_swallowed(leg):
    def foot_position(q):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        held(SimpleNamespace(foot_position=foot_position), leg, samples=5)


def test_formulas_may_change_what_they_are_given_and_return_the_same_array(leg):
    result = np.zeros(3)

    def foot_position(q):
        result[:] = MyLeg().foot_position(q)
        q[:] = 0.0
        return result

    assert held(SimpleNamespace(foot_position=foot_position, mass_matrix=MyLeg().mass_matrix), leg).passed


# ---------------------------------------------------------------------- coordinates, gravity, names of equations


class Permuted:
    """A loaded leg with its coordinates in another order."""

    def __init__(self, leg, order, names=True):
        self.leg, self.order, self.back = leg, list(order), list(np.argsort(order))
        if names:
            self.joint_names = [leg.joint_names[i] for i in order]

    def foot_position(self, q):
        return self.leg.foot_position(q[self.back])

    def jacobian(self, q):
        return self.leg.jacobian(q[self.back])[:, self.order]

    def mass_matrix(self, q):
        return self.leg.mass_matrix(q[self.back])[np.ix_(self.order, self.order)]

    def bias(self, q, v):
        return self.leg.bias(q[self.back], v[self.back])[self.order]

    def torque(self, q, v, a, foot_force, gravity):
        return self.leg.torque(q[self.back], v[self.back], a[self.back], foot_force, gravity)[self.order]

    def acceleration(self, q, v, tau):
        return self.leg.acceleration(q[self.back], v[self.back], tau[self.back])[self.order]

    def inverse_kinematics(self, p):
        return self.leg.inverse_kinematics(p)[self.order]


def test_another_order_of_the_coordinates():
    # A cyclic order is not its own inverse.
    other, reference = ld.load("omnileg", "pinocchio"), ld.load("omnileg")
    report = held(Permuted(other, (1, 2, 0)), reference, samples=10)
    report.raise_if_failed()
    assert len(report.checks) == 9
    unsaid = held(Permuted(other, (1, 2, 0), names=False), reference, samples=10)
    assert not verdicts(unsaid)["foot Jacobian"]


def test_a_loaded_leg_is_an_object_with_the_methods_too(leg):
    report = held(ld.load(EXAMPLES / "my_leg.urdf"), leg, samples=12)
    report.raise_if_failed()
    assert report.not_given == ()
    assert "torque, tilted" in verdicts(report)


def test_actuator_names(leg):
    class Motors:
        actuator_names = ("crank_motor", "thigh_motor")

        def torque(self, q, v, a):
            return MyLeg().torque(q, v, a)[::-1]

    assert held(Motors(), leg).passed
    Motors.actuator_names = ("theta2", "theta1")
    assert held(Motors(), leg).passed
    Motors.actuator_names = ("thigh_motor", "crank_motor")
    assert "the entries thigh_motor, crank_motor are exchanged" in cause(held(Motors(), leg), "torque").findings


class Tilted(MyLeg):
    """Torque with any gravity in the plane."""

    def torque(self, q, v, a, gravity=None):
        tau = super().torque(q, v, a)
        if gravity is not None:
            tau = tau - self.gravity_torque(q) + self.pull(q, np.asarray(gravity))
        return tau

    def pull(self, q, gravity):
        moments = np.array(self.gravity_torque(q)) / (self.g * np.sin(q))
        return moments * (-gravity[2] * np.sin(q) - gravity[0] * np.cos(q))


def test_a_tilted_gravity(leg):
    report = held(Tilted(), leg)
    report.raise_if_failed()
    assert "torque, tilted" in verdicts(report)


def test_a_gravity_of_the_wrong_frame(leg):
    class Wrong(Tilted):
        def pull(self, q, gravity):
            return super().pull(q, gravity * [-1.0, 1.0, 1.0])

    found = cause(held(Wrong(), leg), "torque")
    assert found.quantity == "torque, tilted"
    assert "agrees with the file's gravity" in found.findings
    assert "agrees without gravity: the gravity term is wrong" in found.findings


def test_a_gravity_that_is_ignored(leg):
    class Ignoring(MyLeg):
        def torque(self, q, v, a, gravity=None):
            return super().torque(q, v, a)

    assert "the argument gravity changes nothing" in cause(held(Ignoring(), leg), "torque").findings


def test_a_gravity_argument_that_is_a_number(leg):
    class Scalar(MyLeg):
        def gravity_torque(self, q, gravity=9.81):
            return super().gravity_torque(q)

    report = held(Scalar(), leg)
    assert report.passed
    assert report.notes == ("gravity of gravity_torque is a number, so that it was not tilted",)


@pytest.mark.parametrize("given", [9.8, (0.0, 0.0, -9.8), np.float64(-9.8)])
def test_the_gravity_of_the_formulas(leg, given):
    class Lighter(Whole):
        g = 9.8
        gravity = given

    report = held(Lighter(), leg)
    report.raise_if_failed()
    assert "instead of the file's: (0, 0, -9.8) and (0, 0, -9.81) m/s²" in report.notes[0]
    Lighter.gravity = None
    assert not held(Lighter(), leg).passed


def test_names_of_equations(leg):
    class Named:
        def __init__(self):
            self.equations = {"jacobian": "(2.17)", "bias": 12}

        def jacobian(self, q):
            """Nothing to see (4)."""
            return MyLeg().jacobian(q)

        def bias(self, q, v):
            return MyLeg().bias(q, v)

        def mass_matrix(self, q):
            """Of Xu, eqs. (7)-(9).

            And not (10).
            """
            return MyLeg().mass_matrix(q)

        def torque(self, q, v, a):
            """Torque (11) at the motors."""
            return MyLeg().torque(q, v, a)

    labels = {check.method: check.equation for check in held(Named(), leg, samples=10).checks}
    assert labels == {"jacobian": "(2.17)", "bias": "12", "mass_matrix": "(7)-(9)", "torque": ""}


# ---------------------------------------------------------------------- refusals


def position(q):
    return MyLeg().foot_position(q)


@pytest.mark.parametrize(
    ("own", "said"),
    [
        (MyLeg, "MyLeg is a class: pass an object, MyLeg(...)"),
        (object(), "none of the interface's methods"),
        ("omnileg", "none of the interface's methods"),
        (SimpleNamespace(foot_position=[1.0, 2.0, 3.0]), "none of the interface's methods"),
        (SimpleNamespace(foot_position=position, joint_names=("a", "b")), "joint_names is (a, b)"),
        (SimpleNamespace(foot_position=position, joint_names=("theta1",)), "joint_names is (theta1)"),
        (SimpleNamespace(foot_position=position, joint_names="theta1"), "must be a list of names"),
        (SimpleNamespace(foot_position=position, actuator_names=("a", "b")), "actuator_names is (a, b)"),
        (SimpleNamespace(foot_position=position, equations={"jacobien": "(1)"}), "did you mean 'jacobian'?"),
        (SimpleNamespace(foot_position=position, equations=["(1)"]), "must be a mapping"),
        (SimpleNamespace(foot_position=position, gravity=(0.0, 9.81)), "gravity must be a vector (3,)"),
        (SimpleNamespace(foot_position=position, gravity=math.nan), "gravity must be a vector (3,)"),
        (SimpleNamespace(foot_position=position, gravity="down"), "gravity must be a vector (3,)"),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_objects_that_do_not_fit(leg, own, said):
    with pytest.raises(ParameterError) as caught:
        held(own, leg, samples=5)
    assert said in str(caught.value)


def test_a_property_that_fails(leg):
    class Broken:
        @property
        def joint_names(self):
            raise OSError("no file")

        foot_position = staticmethod(position)

    with pytest.raises(ParameterError, match="joint_names of Broken cannot be read: OSError: no file"):
        held(Broken(), leg, samples=5)


@pytest.mark.parametrize("number", [100, 3.0, np.int64(5), True])
def test_a_number_is_no_leg(number):
    with pytest.raises(ParameterError, match="write samples="):
        ld.crosscheck("omnileg", number)


def test_arguments(leg):
    with pytest.raises(ShapeError, match="samples"):
        ld.crosscheck(MyLeg(), leg, samples=0)
    with pytest.raises(ParameterError, match="loaded already"):
        ld.crosscheck(MyLeg(), leg, foot="foot")
    with pytest.raises(ParameterError, match="goes with own formulas"):
        ld.crosscheck("omnileg", tolerance=1e-6)
    for tolerance in (0.0, -1e-9, 1.0, math.nan, True, "1e-6"):
        with pytest.raises(ParameterError, match="tolerance must be a number"):
            ld.crosscheck(MyLeg(), leg, samples=5, tolerance=tolerance)
    report = ld.crosscheck(MyLeg(), EXAMPLES / "my_leg.urdf", samples=5, route="pinocchio")
    assert report.routes == ("own formulas", "pinocchio")
    assert report.passed
    text = (EXAMPLES / "my_leg.urdf").read_text(encoding="utf-8")
    assert ld.crosscheck(MyLeg(), text, samples=5).passed


def test_a_tolerance_for_rounded_constants(leg):
    class Rounded(MyLeg):
        g = 9.8100001

    assert not held(Rounded(), leg).passed
    assert held(Rounded(), leg, tolerance=1e-6).passed
    assert not held(MyLeg("gravity"), leg, tolerance=1e-6).passed


def test_a_leg_without_a_foot(pendulum):
    text = pendulum()
    reference = ld.load(text)
    with pytest.raises(MissingFootError, match="pass foot="):
        ld.crosscheck(SimpleNamespace(jacobian=position), text, samples=5)
    own = SimpleNamespace(mass_matrix=reference.mass_matrix, bias=reference.bias, torque=reference.torque)
    report = ld.crosscheck(own, text, samples=5)
    report.raise_if_failed()
    assert "torque with foot force" not in verdicts(report)
    with_foot = ld.load(text, foot="tip")
    report = ld.crosscheck(SimpleNamespace(torque=with_foot.torque), text, samples=5, foot="tip")
    assert report.passed
    assert "torque with foot force" in verdicts(report)


def test_friction_is_no_error_of_the_velocity_terms(pendulum):
    # The relation of bias and mass matrix is asked only where one of them fails: let M be wrong.
    text = pendulum(0.02, 0.01)
    reference = ld.load(text)
    own = SimpleNamespace(bias=reference.bias, mass_matrix=lambda q: reference.mass_matrix(q) + np.diag([0.1, 0.0]))
    report = ld.crosscheck(own, text, samples=60)
    cause(report, "mass_matrix")
    assert verdicts(report, "own formulas among themselves") == {
        "has the velocity terms that the derivatives of M give": True
    }


def test_torques_that_are_not_unique(pendulum):
    driven = '<transmission name="t"><joint name="first"/><actuator name="motor"/></transmission></robot>'
    text = pendulum().replace("</robot>", driven)
    reference = ld.load(text)
    own = SimpleNamespace(bias=reference.bias, torque=lambda q, v, a: reference.bias(q, v)[:1])
    report = ld.crosscheck(own, text, samples=5)
    assert report.passed
    assert "under-actuated" in report.not_compared["torque"]
    assert {check.method for check in report.checks} == {"bias"}


# ---------------------------------------------------------------------- the report


def test_the_report_as_text_json_and_error(leg):
    report = held(MyLeg("jacobian"), leg)
    stream = io.StringIO()
    Console(file=stream, width=150).print(report)
    shown = stream.getvalue()
    assert "MyLeg against my_leg by symbolic, seed 0" in shown
    assert "jacobian (4): foot Jacobian\n  d foot z / d theta2 is " in shown
    assert "follows from jacobian" in shown
    assert "not given: foot_velocity, generalized_force" in shown
    values = json.loads(report.to_json())
    assert values["not_given"] == ["foot_velocity", "generalized_force"]
    (failing,) = [
        each for each in values["checks"] if each["method"] == "jacobian" and each["group"] == "against the file"
    ]
    assert failing["component"] == "d foot z / d theta2"
    assert failing["equation"] == "(4)"
    assert any("sign error" in text for text in failing["diagnosis"])
    with pytest.raises(CrosscheckError, match=r"jacobian \(4\): foot Jacobian: d foot z / d theta2 is") as caught:
        report.raise_if_failed()
    assert "more follow from these" in str(caught.value)
    assert len(caught.value.checks) == sum(not check.passed for check in report.checks)


def test_the_same_seed_gives_the_same_report(leg):
    first, again, other = (held(MyLeg("mass"), leg, samples=20, seed=seed).to_dict() for seed in (4, 4, 5))
    assert first == again
    assert first["checks"] != other["checks"]


# ---------------------------------------------------------------------- formulas that end the process


@pytest.mark.parametrize("code", [0, 3, "no solution"])
def test_an_exit_is_a_failing_check(leg, code):
    def foot_position(q):
        sys.exit(code)

    report = held(SimpleNamespace(foot_position=foot_position, mass_matrix=MyLeg().mass_matrix), leg, samples=12)
    found = cause(report, "foot_position")
    assert found.detail.startswith(f"raised SystemExit: {code} (test_own_formulas.py:")
    assert found.share == 1.0
    assert verdicts(report) == {"foot position": False, "mass matrix": True}


def test_an_exit_in_assemble_and_in_a_property(leg):
    assert "raised SystemExit" in cause(held(SimpleNamespace(assemble=lambda q: sys.exit(0)), leg), "assemble").detail

    class Ending:
        foot_position = staticmethod(position)

        @property
        def gravity(self):
            sys.exit(0)

    with pytest.raises(ParameterError, match="gravity of Ending cannot be read: SystemExit: 0"):
        held(Ending(), leg, samples=5)


# ---------------------------------------------------------------------- foot forces by another name


def wrong_force(q, v, a, force):
    return MyLeg("foot_force").torque(q, v, a, force)


@pytest.mark.parametrize(
    ("torque", "arguments"),
    [
        (lambda q, v, a, force=None: wrong_force(q, v, a, force), "q, v, a, force"),
        (lambda q, v, a, F=(0.0, 0.0, 0.0): wrong_force(q, v, a, F), "q, v, a, F"),
        (lambda q, v, a: wrong_force(q, v, a, None), "q, v, a"),
        (lambda *given: wrong_force(*given, None), "*given"),
    ],
    ids=["force", "F", "none", "any number"],
)
@pytest.mark.parametrize("method", ["torque", "generalized_force"])
def test_a_foot_force_that_cannot_be_given_is_noted(leg, torque, arguments, method):
    report = held(SimpleNamespace(**{method: torque}), leg, samples=10)
    assert report.passed
    note = f"foot force was not compared in {method}: no argument of {method}({arguments}) is called foot_force"
    assert report.notes == (note,)
    stream = io.StringIO()
    Console(file=stream, width=200).print(report)
    assert note in stream.getvalue()


def test_a_foot_force_of_the_acceleration_by_another_name(leg):
    right = MyLeg()
    own = SimpleNamespace(acceleration=lambda q, v, tau, force=None: right.acceleration(q, v, tau))
    assert held(own, leg, samples=10).notes == (
        "foot force was not compared in acceleration: no argument of acceleration(q, v, tau, force) is called "
        "foot_force",
    )
    # Without any, forward dynamics is whole by itself.
    assert held(SimpleNamespace(acceleration=right.acceleration), leg, samples=10).notes == ()


def test_arguments_of_any_name_are_given_the_foot_force(leg):
    own = SimpleNamespace(torque=lambda q, v, a, **k: MyLeg("foot_force").torque(q, v, a, **k))
    found = cause(held(own, leg), "torque")
    assert found.quantity == "torque with foot force"
    assert "wrong sign of the foot force's term" in str(found.findings)
    own = SimpleNamespace(torque=lambda q, v, a, **k: MyLeg().torque(q, v, a, k.get("F")))
    assert "the argument foot_force changes nothing" in cause(held(own, leg), "torque").findings
    own = SimpleNamespace(torque=lambda q, v, a, **k: MyLeg().torque(q, v, a, **k))
    report = held(own, leg)
    report.raise_if_failed()
    assert verdicts(report) == {"torque": True, "torque with foot force": True}
    assert report.notes == ()


def test_arguments_of_any_name_that_are_handed_on_to_what_does_not_take_them(leg):
    own = SimpleNamespace(torque=lambda q, v, a, **k: wrong_force(q, v, a, None, **k))
    report = held(own, leg)
    assert report.passed
    (note,) = report.notes
    assert note.startswith("foot force was not compared in torque: called with foot_force, it raised TypeError: ")


def test_no_note_of_foot_forces_where_there_is_no_foot(pendulum):
    reference = ld.load(pendulum())
    own = SimpleNamespace(torque=lambda q, v, a: reference.bias(q, v) + reference.mass_matrix(q) @ a)
    assert ld.crosscheck(own, reference, samples=5).notes == ()


# ---------------------------------------------------------------------- the method that is blamed


class Upward(Whole):
    """Torque and accelerations from the generalized force."""

    def generalized_force(self, q, v, a, foot_force=None):
        return MyLeg.torque(self, q, v, a, foot_force)

    def torque(self, q, v, a, foot_force=None):
        return self.generalized_force(q, v, a, foot_force)

    def acceleration(self, q, v, tau, foot_force=None):
        efforts = np.subtract(tau, self.generalized_force(q, v, np.zeros(2), foot_force))
        return np.linalg.solve(self.mass_matrix(q), efforts)


def test_a_foot_force_that_is_wrong_further_up(leg):
    class Only(Upward):
        def acceleration(self, q, v, tau):
            return super().acceleration(q, v, tau)

    held(Upward(), leg).raise_if_failed()
    report = held(Only("foot_force"), leg)
    assert cause(report, "generalized_force").quantity == "generalized force with foot force"
    follows = {check.quantity: check.follows_from for check in report.checks if not check.passed}
    assert follows["torque with foot force"] == "generalized_force"

    class Beside(Only):
        def torque(self, q, v, a, foot_force=None):
            return self.generalized_force(q, v, a, None if foot_force is None else 3.0 * foot_force)

    report = held(Beside(), leg)
    text = str(cause(report, "torque").findings)
    assert "is not the generalized force with foot force, although generalized force with foot force agrees" in text
    report = held(Beside("foot_force"), leg)
    assert {check.method for check in report.causes} == {"generalized_force", "torque"}


def test_an_acceleration_with_foot_force_follows_from_what_it_computes_with(leg):
    for fault in ("jacobian", "mass"):
        report = held(Upward(fault), leg)
        assert {check.method for check in report.causes} == {{"mass": "mass_matrix"}.get(fault, fault)}
    report = held(
        changed("acceleration", lambda a, q, v, tau, foot_force=None: a + (foot_force is not None), Upward), leg
    )
    assert cause(report, "acceleration").quantity == "acceleration with foot force"


def test_a_tilt_that_is_wrong_further_up(leg):
    class Turned(Tilted):
        def pull(self, q, gravity):
            return super().pull(q, gravity * [-1.0, 1.0, 1.0])

        def generalized_force(self, q, v, a, gravity=None):
            return Tilted.torque(self, q, v, a, gravity)

        def torque(self, q, v, a, gravity=None):
            return self.generalized_force(q, v, a, gravity)

    assert cause(held(Turned(), leg), "generalized_force").quantity == "generalized force, tilted"


@pytest.mark.parametrize("error", [ZeroDivisionError, SystemExit])
def test_what_another_method_raises_follows_from_that(leg, error):
    class Raising(Whole):
        def jacobian(self, q):
            if q[0] > self.least:
                raise error("no Jacobian")
            return super().jacobian(q)

    for Raising.least in (-10.0, 0.3):
        report = held(Raising(), leg)
        found = cause(report, "jacobian")
        assert f"raised {error.__name__}: no Jacobian" in found.detail
        follows = {check.quantity: check for check in report.checks if not check.passed and check.follows_from}
        assert set(follows) == {
            "foot velocity",
            "foot acceleration",
            "generalized force with foot force",
            "torque with foot force",
        }
        assert {check.follows_from for check in follows.values()} == {"jacobian"}
        assert "raised by the own jacobian, which it calls" in follows["foot acceleration"].findings


def test_an_exception_of_its_own_follows_from_nothing(leg):
    class Two(Whole):
        def jacobian(self, q):
            raise ValueError("here")

        def foot_acceleration(self, q, v, a):
            raise ValueError("here")

        def foot_velocity(self, q, v):
            try:
                return super().foot_velocity(q, v)
            except ValueError:
                raise ValueError("there") from None

    report = held(Two(), leg)
    assert [check.method for check in report.causes] == ["jacobian", "foot_velocity", "foot_acceleration"]


def test_an_exception_beside_wrong_numbers_is_no_excuse(leg):
    class Beside(MyLeg):
        def jacobian(self, q):
            if q[0] > 0.3:
                raise ValueError("here")
            return super().jacobian(q)

        def foot_acceleration(self, q, v, a):
            return 2.0 * super().foot_acceleration(q, v, a)

    assert [check.method for check in held(Beside(), leg).causes] == ["jacobian", "foot_acceleration"]


def test_methods_that_call_each_other_do_not_excuse_each_other(leg):
    class Circle:
        def foot_position(self, q):
            return self.foot_velocity(q, q)

        def foot_velocity(self, q, v):
            return self.foot_position(q)

    assert held(Circle(), leg, samples=6).causes


def test_one_exception_with_and_without_loads_is_one_cause(leg):
    def torque(q, v, a, foot_force=None):
        raise ValueError("nothing yet")

    report = held(SimpleNamespace(torque=torque), leg, samples=10)
    assert cause(report, "torque").quantity == "torque"
    assert "raises the same as torque" in report.checks[1].findings


# ---------------------------------------------------------------------- statements that would be wrong


@pytest.mark.parametrize("method", ["mass_matrix", "bias", "torque"])
def test_nothing_is_said_of_numbers_that_agree_where_others_are_missing(leg, method):
    def partly(value, q, *_, **__):
        return np.full_like(value, np.nan) if q[0] > 0.5 else value

    found = cause(held(changed(method, partly, MyLeg), leg, samples=100), method)
    assert "returned NaN or infinity" in found.detail
    assert "all those where theta1 > 0." in found.detail
    assert found.diagnosis[0] == "agrees wherever there are numbers"
    assert not any(word in str(found.findings) for word in ("symmetric", "agrees at", "terms", "agrees without"))


def test_missing_numbers_of_its_own_do_not_follow_from_wrong_ones_further_up(leg):
    class Beside(MyLeg):
        def bias(self, q, v):
            if q[0] > 0.5:
                raise ValueError("not here")
            return super().bias(q, v)

    report = held(Beside("gravity"), leg, samples=100)
    assert [check.method for check in report.causes] == ["gravity_torque", "bias"]
    said = "gives no numbers where the own gravity torque does, an error here beside that one"
    assert said in report.causes[1].findings

    def torque(q, v, a, foot_force=None):
        return np.sqrt(0.5 - q[0] if foot_force is None else 0.5 + q[1]) * 0.0 + MyLeg().torque(q, v, a, foot_force)

    with np.errstate(invalid="ignore"):
        report = held(SimpleNamespace(torque=torque), leg, samples=100)
    assert [check.quantity for check in report.causes] == ["torque", "torque with foot force"]


def test_an_asymmetry_beside_missing_numbers(leg):
    def partly(M, q):
        return np.full((2, 2), np.nan) if q[0] > 0.5 else M + np.array([[0, q[0]], [-q[0], 0]])

    found = cause(held(changed("mass_matrix", partly, MyLeg), leg, samples=100), "mass_matrix")
    assert "the symmetric part agrees: the own matrix is not symmetric" in found.findings


def test_assemble_with_the_coordinates_mixed_up(leg):
    swapped = SimpleNamespace(assemble=MyLeg().assemble, joint_names=("theta2", "theta1"))
    found = cause(held(swapped, leg), "assemble")
    assert "assembly mode" not in str(found.findings)
    (text,) = found.diagnosis
    assert text.startswith("other independent coordinates than it was called with: theta1 = ")
    assert "the entries theta1, theta2 are exchanged" in text
    assert "it was called with q = (theta2, theta1)" in text
    assert "joint_names and the order in which it takes q do not fit together" in text
    negative = SimpleNamespace(assemble=lambda q: MyLeg().assemble([-q[0], q[1]]))
    (text,) = cause(held(negative, leg), "assemble").diagnosis
    assert "theta1 is the negative of the reference: a sign error" in text
    assert "joint_names" not in text


def test_a_foot_position_of_exchanged_coordinates(leg):
    right = MyLeg()
    own = SimpleNamespace(foot_position=lambda q: right.foot_position(q[::-1]))
    found = cause(held(own, leg), "foot_position")
    said = "agrees when the coordinates theta1, theta2 are exchanged: joint_names = ("
    assert f"{said}theta2, theta1) says so" in found.findings
    own.joint_names = ("theta2", "theta1")
    assert held(own, leg).passed
    own.foot_position = right.foot_position
    assert f"{said}theta1, theta2) says so" in cause(held(own, leg), "foot_position").findings


def test_a_foot_position_of_coordinates_in_another_order():
    reference = ld.load("omnileg")
    own = Permuted(reference, (1, 2, 0), names=False)
    position_only = SimpleNamespace(foot_position=own.foot_position)
    (text,) = [
        text for text in cause(held(position_only, reference, 20), "foot_position").findings if "joint_names" in text
    ]
    named = ", ".join(reference.joint_names[i] for i in (1, 2, 0))
    assert text.endswith(f"are in another order: joint_names = ({named}) says so")
    position_only.joint_names = [reference.joint_names[i] for i in (1, 2, 0)]
    assert held(position_only, reference, 20).passed


@pytest.mark.parametrize("seed", [-1, "x", 1.5, None, True, math.nan])
def test_a_seed_of_no_use(leg, seed):
    for arguments in ((MyLeg(), leg), ("omnileg",)):
        with pytest.raises(ParameterError, match="seed must be a whole number, at least 0, got ") as caught:
            ld.crosscheck(*arguments, samples=5, seed=seed)
        assert caught.value.parameter == "seed"
    assert ld.crosscheck(MyLeg(), leg, samples=5, seed=np.int64(3)).passed


# ---------------------------------------------------------------------- methods that give nothing of use


def following(report):
    return {check.quantity: check.follows_from for check in report.checks if not check.passed and check.follows_from}


OF_MASS = {"kinetic energy", "torque", "generalized force", "acceleration"}
OF_JACOBIAN = {"foot velocity", "foot acceleration"}
WITH_FORCE = {"torque with foot force", "generalized force with foot force"}


@pytest.mark.parametrize(
    ("method", "function", "followers"),
    [
        ("mass_matrix", lambda self, q: np.full((2, 2), np.nan), OF_MASS | WITH_FORCE),
        ("mass_matrix", lambda self, q: None, OF_MASS | WITH_FORCE),
        ("mass_matrix", lambda self, q: np.eye(3), OF_MASS | WITH_FORCE),
        # As a vector it goes on with numbers, which are wrong.
        ("mass_matrix", lambda self, q: np.array([0.03, 0.005]), OF_MASS | WITH_FORCE),
        ("mass_matrix", lambda self: np.eye(2), OF_MASS | WITH_FORCE),
        ("mass_matrix", 5, OF_MASS | WITH_FORCE),
        ("jacobian", lambda self, q: np.full((3, 2), np.nan), OF_JACOBIAN | WITH_FORCE),
        ("jacobian", lambda self, q: np.array(MyLeg().jacobian(q))[:2], OF_JACOBIAN | WITH_FORCE),
        ("jacobian", lambda self, q, v: MyLeg().jacobian(q), OF_JACOBIAN | WITH_FORCE),
        ("jacobian", 5, OF_JACOBIAN | WITH_FORCE),
        ("jacobian", None, OF_JACOBIAN | WITH_FORCE),
        ("gravity_torque", lambda self, q: [math.nan] * 2, {"bias force", "torque", "acceleration"} | WITH_FORCE),
    ],
)
def test_what_calls_a_method_of_no_use_follows_from_it(leg, method, function, followers):
    report = held(type("Own", (Whole,), {method: function})(), leg)
    found = cause(report, method)
    assert math.isnan(found.worst)
    assert found.share == 1.0
    follows = following(report)
    if method == "gravity_torque":
        followers = followers | {"generalized force"}
    assert followers <= set(follows)
    assert set(follows.values()) == {method}
    assert method not in report.not_given
    json.loads(report.to_json())
    Console(file=io.StringIO()).print(report)


def test_what_is_no_method_is_a_note_where_none_calls_it(leg):
    class Rated(MyLeg):
        kinetic_energy = 12.0

    report = held(Rated(), leg)
    report.raise_if_failed()
    assert report.notes == ("kinetic_energy is no method but float, and was left out",)
    report = held(type("Own", (Whole,), {"jacobian": 5})(), leg)
    assert report.causes[0].detail == "is no method but int, and foot_velocity calls it"
    assert report.notes == ()


def test_numbers_that_are_missing_somewhere_follow_where_they_are_missing_further_up(leg):
    class Partly(Whole):
        def mass_matrix(self, q):
            M = np.array(super().mass_matrix(q))
            return M * np.nan if q[0] > 0.5 else M

    report = held(Partly(), leg, samples=100)
    assert "all those where theta1 > 0." in cause(report, "mass_matrix").detail
    assert set(following(report).values()) == {"mass_matrix"}

    class Beside(Partly):
        def torque(self, q, v, a, foot_force=None):
            tau = super().torque(q, v, a, foot_force)
            return -tau if q[0] < 0.2 else tau

    assert {check.method for check in held(Beside(), leg, samples=100).causes} == {"mass_matrix", "torque"}


def test_a_useless_method_that_is_not_called_excuses_nothing(leg):
    class Apart(Whole):
        def mass_matrix(self, q):
            return np.full((2, 2), np.nan)

        def kinetic_energy(self, q, v):
            return math.nan

        def bias(self, q, v):
            return np.add(MyLeg().bias(q, v), 0.1)

    methods = [check.method for check in held(Apart(), leg).causes]
    assert methods == ["mass_matrix", "kinetic_energy", "bias"]


def test_a_wrong_assembly_that_others_call(leg):
    class Lost(Whole):
        def assemble(self, q):
            return super().assemble(q) | {"knee": math.nan}

        def foot_position(self, q):
            knee = self.assemble(q)["knee"]
            return [self.l1 * math.sin(q[0]) + self.l2 * math.sin(q[0] + knee), 0.0, 0.0]

    report = held(Lost(), leg)
    cause(report, "assemble")
    assert following(report)["foot position"] == "assemble"


def test_one_method_without_numbers_is_one_cause_with_and_without_loads(leg):
    own = SimpleNamespace(torque=lambda q, v, a, foot_force=None: [math.nan, 0.0])
    report = held(own, leg, samples=10)
    assert cause(report, "torque").quantity == "torque"
    assert "is as useless as torque" in report.checks[1].findings


def test_the_same_statement_with_and_without_loads_is_one_cause(leg):
    def torque(q, v, a, foot_force=None):
        return MyLeg().torque(q, v, a, foot_force)[::-1]

    report = held(SimpleNamespace(torque=torque), leg)
    found = cause(report, "torque")
    assert "the entries thigh_motor, crank_motor are exchanged" in found.findings
    assert "is wrong in the same way as torque" in report.checks[1].findings

    class NoInertia(Whole):
        def torque(self, q, v, a, foot_force=None):
            return super().torque(q, v, np.zeros(2), foot_force)

    assert cause(held(NoInertia(), leg), "torque").quantity == "torque"


# ---------------------------------------------------------------------- names that are exchanged


def test_exchanged_names_are_one_cause(leg):
    class Swapped(Whole):
        joint_names = ("theta2", "theta1")

    report = held(Swapped(), leg)
    found = cause(report, "assemble")
    said = "joint_names = (theta1, theta2) says so"
    exchanged = (
        f"agrees, as does all that is said to follow from it, when the coordinates theta1, theta2 are exchanged: {said}"
    )
    assert exchanged in found.findings
    follows = [check for check in report.checks if check.follows_from]
    assert {check.method for check in follows} == set(METHODS) - {"assemble"}
    assert {check.follows_from for check in follows} == {"assemble"}
    assert all(check.diagnosis == (f"agrees where {said}",) for check in follows)

    class Alone(Swapped):
        assemble = None

    found = cause(held(Alone(), leg), "foot_position")
    assert sum("joint_names" in text for text in found.findings) == 1
    only_mass = SimpleNamespace(mass_matrix=MyLeg().mass_matrix, joint_names=("theta2", "theta1"))
    assert (
        f"agrees when the coordinates theta1, theta2 are exchanged: {said}"
        in cause(held(only_mass, leg), "mass_matrix").findings
    )


def test_exchanged_names_of_three_joints():
    reference = ld.load("omnileg")
    own = Permuted(reference, (1, 2, 0))
    own.joint_names = [reference.joint_names[i] for i in (2, 0, 1)]
    report = held(own, reference, 12)
    found = cause(report, "foot_position")
    right = ", ".join(reference.joint_names[i] for i in (1, 2, 0))
    assert f"are in another order: joint_names = ({right}) says so" in str(found.findings)
    assert len(following(report)) == len(report.checks) - 1


def test_another_error_beside_exchanged_names(leg):
    class Both(Whole):
        joint_names = ("theta2", "theta1")

    report = held(Both("jacobian"), leg)
    assert [check.method for check in report.causes] == ["assemble", "jacobian"]
    text = "d foot z / d theta2 is the negative of the reference: a sign error"
    assert text in report.causes[1].findings
    follows = following(report)
    assert follows["foot acceleration"] == "jacobian"
    assert follows["mass matrix"] == "assemble"


def test_one_method_with_exchanged_coordinates_beside_right_ones_has_no_names_exchanged(leg):
    class One(MyLeg):
        def foot_position(self, q):
            return super().foot_position(q[::-1])

    found = cause(held(One(), leg), "foot_position")
    assert "agrees when the coordinates theta1, theta2 are exchanged" in found.findings
    assert "joint_names" not in str(found.findings)


# ---------------------------------------------------------------------- what assemble is compared in


def test_joints_that_assemble_does_not_give_are_named(leg):
    some = held(SimpleNamespace(assemble=lambda q: {"knee": q[1] - q[0]}), leg)
    (check,) = some.checks
    assert check.passed
    assert check.quantity == "joint angles that close the loops: knee"
    said = "compared: knee; not given: theta1, theta2, crank_pin"
    assert check.detail == said
    assert some.notes == (f"assemble: {said}",)
    stream = io.StringIO()
    Console(file=stream, width=200).print(some)
    assert said in stream.getvalue()
    independent = held(SimpleNamespace(assemble=lambda q: {"theta1": q[0], "theta2": q[1]}), leg)
    (check,) = independent.checks
    assert check.quantity == "independent coordinates alone: theta1, theta2"
    (note,) = independent.notes
    assert note.endswith("not given: knee, crank_pin, so that nothing shows how the loops close")
    whole = held(SimpleNamespace(assemble=MyLeg().assemble), leg)
    assert whole.checks[0].quantity == "joint angles that close the loops"
    assert (whole.checks[0].detail, whole.notes) == ("", ())
