"""Verdicts on the claims of the OmniLeg paper: computed facts against independent computations."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.omnileg import claims, facts, printed

from .tampered import tamper


@pytest.fixture(scope="module")
def context():
    return Context("omnileg", samples=500)


@pytest.fixture(scope="module")
def verdicts(context):
    return {
        verdict.item.removeprefix("claim: "): verdict for verdict in (function(context) for function in claims.VERDICTS)
    }


def figure(verdict, name):
    return next(f.value for f in verdict.figures if f.name == name)


def test_every_claim_has_its_own_verdict_with_finite_figures(verdicts):
    assert len(verdicts) == len(claims.VERDICTS)
    for verdict in verdicts.values():
        assert verdict.kind == "claim"
        assert verdict.item.startswith("claim: ")
        assert verdict.figures or verdict.status is not Status.CONFIRMED, verdict.item
        assert all(math.isfinite(f.value) for f in verdict.figures), verdict.item
        assert "nan" not in verdict.finding, verdict.item
        assert verdict.finding.endswith("."), verdict.item


def test_a_second_run_gives_the_same(context, verdicts):
    again = Context("omnileg", samples=500, shared={"equations: assembled": facts.assembled(context)})
    for function in (claims.symmetry, claims.shaft_ripple, claims.random_motions):
        verdict = function(again)
        assert verdict.to_dict() == verdicts[verdict.item.removeprefix("claim: ")].to_dict()


# ---------------------------------------------------------------------- Fig. 3


def test_the_workspace_has_the_symmetry_of_a_square(verdicts):
    verdict = verdicts["complete symmetry of the foot's workspace"]
    assert verdict.status is Status.CORRECTED
    assert figure(verdict, "symmetries of the workspace") == 8
    assert figure(verdict, "symmetries with unsigned ranges") == 2
    assert figure(verdict, "rim of the cone reached") == 1.0
    # The rods point to the square |tan alpha|, |tan beta| <= tan 65 deg; what 45 deg takes outside, by counting.
    generator = np.random.default_rng(5)
    tangents = np.tan(np.radians(generator.uniform(-64.35, 64.35, (20000, 2))))
    turned = tangents @ np.array([[1.0, 1.0], [-1.0, 1.0]]) / math.sqrt(2.0)
    outside = (np.abs(turned) > math.tan(math.radians(65.0))).any(axis=1).mean()
    assert figure(verdict, "outside after 45 deg") == pytest.approx(outside, abs=0.03)


def test_what_figure_3_shows(verdicts):
    for item in (
        "motors fixed in the hip",
        "the foot does not rotate",
        "two ways to lift the foot",
        "the thigh carries and drives",
        "thigh and shank move independently",
        "turning about X0 and Y0 replaces turning about Z0",
    ):
        assert verdicts[item].status is Status.CONFIRMED, item
    lift = verdicts["two ways to lift the foot"]
    assert figure(lift, "lift by the shank") == pytest.approx(0.19 * (1.0 - math.cos(math.radians(85.0))), abs=1e-12)
    assert figure(lift, "lift by the thigh") == pytest.approx(0.15 * (1.0 - math.cos(math.radians(65.0))), abs=1e-12)
    gap = figure(verdicts["the thigh carries and drives"], "least distance of two axes")
    assert gap == pytest.approx(0.075 * math.cos(math.radians(65.0)), abs=1e-9)
    free = figure(verdicts["the thigh carries and drives"], "least gap between two of them")
    # Two rods may come closer to each other than a rod to the thin shaft.
    assert 0.016 < free <= gap - 0.008 - 0.004
    # At mid-step Y is 0.05 m, and the thigh of 0.15 m leans by as much.
    from_thigh, from_shank = (figure(lift, f"lift of a step by the {part}") for part in ("thigh", "shank"))
    assert from_thigh == pytest.approx(0.15 - math.sqrt(0.15**2 - 0.05**2), abs=1e-12)
    assert from_thigh + from_shank == pytest.approx(0.05, abs=1e-12)


def test_a_turning_foot_would_be_noticed(context):
    tampered = Context("omnileg", samples=500)
    tampered.__dict__.update(leg=context.leg, pinocchio=context.pinocchio)
    mechanism = facts.Assembled(context.pinocchio, facts.states(context)[:5])
    turned = dict(mechanism.links)
    tilt = np.eye(4)
    tilt[:3, :3] = printed.rot(printed.X, 0.01)
    turned["foot"] = mechanism.links["foot"] @ tilt
    mechanism.links = turned
    tampered.shared["equations: assembled"] = mechanism
    assert claims.no_rotation(tampered).status is Status.NOT_REPRODUCIBLE


# ---------------------------------------------------------------------- transmission


def test_cardan_ratios(verdicts):
    verdict = verdicts["the shaft turns at a varying rate"]
    for alpha, beta in claims.CARDAN_POSES:
        a, b = math.radians(alpha), math.radians(beta)
        bend = math.acos(1.0 / math.sqrt(1.0 + math.tan(a) ** 2 + math.tan(b) ** 2))
        found = {f.name: f.value for f in verdict.figures if f.of == f"α = {alpha:g}, β = {beta:g} deg"}
        assert found["bend"] == pytest.approx(math.degrees(bend), abs=1e-6)
        assert found["least shaft/input"] == pytest.approx(math.cos(bend), abs=1e-4)
        assert found["greatest shaft/input"] == pytest.approx(1.0 / math.cos(bend), abs=1e-3)
        # tan(output) = cos(bend) tan(input): the greatest lead of one U joint.
        lead = math.asin((1.0 - math.cos(bend)) / (1.0 + math.cos(bend)))
        # A quarter turn between the yokes multiplies both joints' greatest ratios instead of cancelling them.
        assert found["greatest output/input with yokes 90 deg off"] == pytest.approx(math.cos(bend) ** -2, rel=1e-3)
        assert found["lead or lag"] == pytest.approx(math.degrees(lead), abs=0.02)


def test_output_equals_input_but_not_as_a_vector(verdicts):
    assert verdicts["output shaft and gears turn as fast as the input"].status is Status.CONFIRMED
    gears = verdicts["the bevel gears have the angular velocity of the input"]
    assert gears.status is Status.CORRECTED
    assert figure(gears, "driven gear minus input shaft") == pytest.approx(1.0, abs=1e-6)


def test_exact_motion_of_the_shaft_neglects_nothing(context):
    """The replacement machinery itself, fed with the exact motions, changes no mass."""
    q = context.q[:4]
    motions = facts.motions(context, "transmission_motions", q)

    def exact(name):
        motion = motions[name]
        return facts.array(motion.turning.rotation, (4,)), facts.omega_of(motion, q)

    replaced = {name: (lambda q, name=name: exact(name)) for name in ("cross_A4", "shaft_A4B4", "cross_B4")}
    assert facts.mass_matrix_of(context, q, replaced=replaced) == pytest.approx(
        facts.mass_matrix_of(context, q), abs=1e-18
    )


def test_parts_too_thick_for_the_thigh_would_be_noticed(context):
    class Thick:
        def __getattr__(self, name):
            return getattr(context.leg, name)

        parameters = context.leg.parameters | {"rod_outer_radius": SimpleNamespace(value=0.03)}

    wrong = Context("omnileg", samples=500, shared={"equations: assembled": facts.assembled(context)})
    wrong.__dict__.update(leg=Thick(), pinocchio=context.pinocchio)
    assert claims.bearing_and_driving(wrong).status is Status.NOT_REPRODUCIBLE


@pytest.mark.parametrize("height", [0.04, 0.2])
def test_a_lift_that_is_not_what_is_asked_for_would_be_noticed(context, monkeypatch, height):
    right = printed.path_53
    monkeypatch.setitem(printed.GAIT, "H", height)
    monkeypatch.setattr(printed, "path_53", lambda t, **gait: right(t, **(gait | {"H": 0.05})))
    assert claims.two_ways_to_lift(context).status is Status.NOT_REPRODUCIBLE


@pytest.mark.parametrize(
    "function",
    [
        claims.omnidirectional,
        claims.independent_motions,
        claims.centres_in_line,
        claims.two_ways_to_lift,
        claims.start_of_52,
        claims.m1_idle_in_gait,
        claims.kinematics_are_right,
    ],
)
def test_a_tampered_leg_confirms_no_claim(context, function):
    wrong = tamper(context, Context)
    # The straight leg has no angles to stretch: tilt it.
    assert function(context).status is Status.CONFIRMED
    if function is claims.start_of_52:
        wrong.__dict__["leg"] = SimpleNamespace(
            limits=context.leg.limits,
            foot_velocity=lambda q, v: 1.01 * context.leg.foot_velocity(q, v),
            description=context.leg.description,
            **vars_of(context.leg),
        )
    if function is claims.centres_in_line:
        mechanism = facts.Assembled(context.pinocchio, np.zeros((1, 3)))
        mechanism.links = mechanism.links | {"knee": mechanism.links["knee"] + 1e-3}
        wrong = Context("omnileg", samples=500)
        wrong.__dict__.update(leg=context.leg, pinocchio=context.pinocchio)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(claims, "Assembled", lambda leg, q: mechanism)
            assert function(wrong).status is Status.NOT_REPRODUCIBLE
        return
    assert function(wrong).status is Status.NOT_REPRODUCIBLE


def vars_of(leg):
    """What `start_of_52` asks of a leg beside its foot velocity."""
    return {"joint_names": leg.joint_names, "foot_position": leg.foot_position}


@pytest.mark.parametrize("torque", [2e-3, 0.01])
def test_a_small_torque_on_m1_is_not_idle(context, torque):
    assert claims.m1_idle_in_gait(tamper(context, Context, torque=torque)).status is Status.NOT_REPRODUCIBLE


def test_bodies_that_move_where_they_should_rest_would_be_noticed(context):
    mechanism = facts.assembled(context)
    for link, function in (
        ("cross_A1", claims.crosses_at_rest),
        ("cross_B1", claims.crosses_at_rest),
        ("driven_gear_2", claims.gears_at_rest),
        ("output_shaft", claims.gears_at_rest),
        ("link_C2D2", claims.isotropy_of_the_ring),
    ):
        moved = facts.Assembled.__new__(facts.Assembled)
        moved.__dict__.update(mechanism.__dict__)
        moved.rates = mechanism.rates | {link: mechanism.rates[link] + 1e-4}
        moved.links = mechanism.links | {link: mechanism.links[link] @ shift(1e-3)}
        wrong = Context("omnileg", samples=500, shared={"equations: assembled": moved})
        wrong.__dict__.update(leg=context.leg, pinocchio=context.pinocchio)
        assert function(context).status is Status.CONFIRMED
        assert function(wrong).status is Status.NOT_REPRODUCIBLE, link


def shift(distance):
    motion = np.eye(4)
    motion[0, 3] = distance
    return motion


def test_numbers_beside_the_claims(context, verdicts):
    q = facts.states(context)
    M = context.pinocchio.mass_matrix(q)
    coupling = max(abs(M[n, i, 2]) / math.sqrt(M[n, i, i] * M[n, 2, 2]) for n in range(len(q)) for i in (0, 1))
    assert figure(verdicts["thigh and shank move independently"], "coupling of the inertia") == pytest.approx(coupling)
    # 1.5 kg that move with the knee, about the axis of alpha.
    step = 1e-6
    knee = [
        facts.formula(context, "knee_position", q + sign * step * np.array([1.0, 0.0, 0.0])) for sign in (1.0, -1.0)
    ]
    speed = np.linalg.norm(knee[0] - knee[1], axis=1) / (2.0 * step)
    gain = (1.5 * speed**2 / M[:, 0, 0]).max()
    found = figure(verdicts["motors fixed in the hip"], "inertia added by motors at the knee")
    assert found == pytest.approx(gain, rel=1e-6)
    light = figure(verdicts["shaft and crosses are a small share of the mass"], "share of the moving mass")
    assert light == pytest.approx((0.059 + 2 * 0.025) / sum(float(body.mass) for body in context.numbers.bodies))
    swapped = context.pinocchio.mass_matrix(context.q[:100][:, [1, 0, 2]])
    straight = context.pinocchio.mass_matrix(context.q[:100])
    unlike = np.abs(1.0 - swapped[:, 1, 1] / straight[:, 0, 0]).max()
    symmetric = verdicts["complete symmetry of the foot's workspace"]
    assert figure(symmetric, "inertia of M2 beside M1 with α and β exchanged") == pytest.approx(unlike, abs=1e-10)
    # 0.1 mm in the thigh, in both shank links and in the knee's height: at most their sum.
    moved = figure(
        verdicts["measured errors come from machining, assembly and friction"], "foot moved by 0.1 mm in L1, L4 and L5"
    )
    assert 0.35e-3 < moved < 0.4e-3
    assert figure(verdicts["(52) neither starts nor ends at rest"], "speed of the foot at the start") == pytest.approx(
        0.116, abs=5e-4
    )
    random = verdicts["randomly given motions validate the model"]
    assert figure(random, "dimensions of the states of (52)") == 1
    assert figure(random, "difference with M1 and M2 exchanged") < 1e-15
    assert figure(random, "the same at random states") > 0.1


@pytest.mark.parametrize(
    ("item", "status"),
    [
        ("a ring of three shank chains is alike in all directions", Status.CONFIRMED),
        ("complete symmetry of the foot's workspace", Status.CORRECTED),
        ("O0, O0' and O0F are in line at the start", Status.CONFIRMED),
        ("the third universal joint U_E and its cross turn with the shafts", Status.NOT_REPRODUCIBLE),
        ("bodies are rigid and uniform, rods balanced in their middle", Status.OUT_OF_REACH),
        ("the kinematic model is right", Status.CONFIRMED),
        ("torque errors of the gait", Status.OUT_OF_REACH),
        ("0.1 N·m on M1 in the gait", Status.OUT_OF_REACH),
        ("measured errors come from machining, assembly and friction", Status.OUT_OF_REACH),
        ("measured accelerations fluctuate but follow the trend", Status.OUT_OF_REACH),
        ("deviations where swing and stance change", Status.OUT_OF_REACH),
        ("(52) neither starts nor ends at rest", Status.CONFIRMED),
        ("M1 needs no torque in the gait", Status.CONFIRMED),
        ("randomly given motions validate the model", Status.NOT_REPRODUCIBLE),
        ("several methods together make the modelling easier", Status.NOT_REPRODUCIBLE),
    ],
)
def test_status(verdicts, item, status):
    assert verdicts[item].status is status
