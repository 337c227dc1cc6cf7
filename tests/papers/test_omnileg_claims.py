"""Verdicts on the claims of the OmniLeg paper: computed facts against independent computations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from leg_dynamics.papers.framework import Context, Status
from leg_dynamics.papers.omnileg import claims, equations, printed


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
        assert verdict.figures, verdict.item
        assert all(math.isfinite(f.value) for f in verdict.figures), verdict.item
        assert "nan" not in verdict.finding, verdict.item
        assert verdict.finding.endswith("."), verdict.item


def test_a_second_run_gives_the_same(context, verdicts):
    again = Context("omnileg", samples=500, shared={"equations: assembled": equations.assembled(context)})
    for function in (claims.symmetry, claims.mobility_shank, claims.simplification_torque):
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


def test_a_turning_foot_would_be_noticed(context):
    tampered = Context("omnileg", samples=500)
    tampered.__dict__.update(leg=context.leg, pinocchio=context.pinocchio)
    facts = equations.Assembled(context.pinocchio, equations.states(context)[:5])
    turned = dict(facts.links)
    tilt = np.eye(4)
    tilt[:3, :3] = printed.rot(printed.X, 0.01)
    turned["foot"] = facts.links["foot"] @ tilt
    facts.links = turned
    tampered.shared["equations: assembled"] = facts
    assert claims.no_rotation(tampered).status is Status.NOT_REPRODUCIBLE


# ---------------------------------------------------------------------- mobility


@pytest.mark.parametrize(
    ("loops", "rows", "joints", "rank", "straight"),
    [
        (claims.THIGH, 12, 12, 10, 10),
        (claims.THIGH + claims.SHAFT, 18, 18, 15, 15),
        (claims.SHANK, 12, 9, 8, 6),
        (claims.THIGH + claims.SHAFT + claims.SHANK, 30, 27, 23, 21),
        (claims.THIGH + claims.SHAFT + claims.SHANK + claims.GEARS, 33, 27, 24, 24),
    ],
)
def test_rows_joints_and_ranks(context, loops, rows, joints, rank, straight):
    group = claims.group_mobility(context, loops)
    assert (group.rows, group.joints, group.rank, group.rank_straight) == (rows, joints, rank, straight)
    assert group.gruebler == joints - rows
    assert group.mobility == joints - rank
    assert group.redundant == rows - rank
    assert group.gap > 1e5


def test_loop_matrix_is_tangent_to_the_closed_mechanism(context):
    """Rates of the assembled tree's joints, the cut joints from the loops themselves, satisfy every row."""
    facts = equations.Assembled(context.pinocchio, context.q[:4])
    loops = claims.THIGH + claims.SHAFT + claims.SHANK + claims.GEARS
    K, members = claims.loop_matrix(context.leg.description, loops, claims.joint_twists(facts))
    step = 1e-6
    rates = np.zeros((4, len(members), 3))
    for k, unit in enumerate(np.eye(3)):
        ahead, behind = (context.pinocchio.assemble(facts.q + sign * step * unit) for sign in (1.0, -1.0))
        for joint in ahead:
            rates[:, members.index(joint), k] = (ahead[joint] - behind[joint]) / (2.0 * step)
    cut = [members.index(name) for name in members if name.startswith("loop_")]
    rest = -K @ rates
    for row in range(4):
        closing, *_ = np.linalg.lstsq(K[row][:, cut], rest[row], rcond=None)
        assert K[row][:, cut] @ closing == pytest.approx(rest[row], abs=1e-8)


def test_mobility_is_confirmed_by_count_and_by_the_numeric_route(context, verdicts):
    whole = verdicts["three degrees of freedom of the leg"]
    assert whole.status is Status.CONFIRMED
    assert figure(whole, "Grübler's count") == -6
    assert figure(whole, "redundant rows") == context.pinocchio.mobility_report(samples=5).redundant
    assert claims._mobility(context, "x", "x", claims.SHANK, 2).status is Status.NOT_REPRODUCIBLE


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
        assert found["lead or lag"] == pytest.approx(math.degrees(lead), abs=0.02)


def test_output_equals_input_but_not_as_a_vector(verdicts):
    assert verdicts["output shaft and gears turn as fast as the input"].status is Status.CONFIRMED
    gears = verdicts["the bevel gears have the angular velocity of the input"]
    assert gears.status is Status.CORRECTED
    assert figure(gears, "driven gear minus input shaft") == pytest.approx(1.0, abs=1e-6)


def test_the_simplification_is_small_only_in_torque(context, verdicts, monkeypatch):
    motion = verdicts["neglecting the shaft's ripple is small, as motion"]
    torque = verdicts["neglecting the shaft's ripple is small, as torque"]
    assert motion.status is Status.CORRECTED
    assert torque.status is Status.CONFIRMED
    for name in "αβγ":
        slow, fast = (figure(torque, f"{kind}, {name}") for kind in ("paper's simplification", "ten times as fast"))
        assert fast == pytest.approx(100.0 * slow, rel=1e-3)
        assert figure(torque, f"no rotary inertia, {name}") < slow
    facts = equations.assembled(context)
    monkeypatch.setattr(printed, "omega_cross_A4", lambda q: facts.omega("cross_A4"))
    monkeypatch.setattr(printed, "omega_cross_B4", lambda q: facts.omega("cross_B4"))
    monkeypatch.setattr(printed, "omega_shaft", lambda q: facts.omega("shaft_A4B4"))
    assert claims.simplification_kinematic(context).status is Status.CONFIRMED


def test_exact_motion_of_the_shaft_neglects_nothing(context):
    """The replacement machinery itself, fed with the exact motions, changes no mass."""
    q = context.q[:4]
    motions = equations.motions(context, "transmission_motions", q)

    def exact(name):
        motion = motions[name]
        return equations.array(motion.turning.rotation, (4,)), equations.omega_of(motion, q)

    replaced = {name: (lambda q, name=name: exact(name)) for name in ("cross_A4", "shaft_A4B4", "cross_B4")}
    assert equations.mass_matrix_of(context, q, replaced=replaced) == pytest.approx(
        equations.mass_matrix_of(context, q), abs=1e-18
    )


def test_cause_of_the_error_on_m3(verdicts, context, monkeypatch):
    verdict = verdicts["5.2 mN·m on M3 come from the neglected ripple"]
    assert verdict.status is Status.NOT_REPRODUCIBLE
    assert figure(verdict, "reported over computed") == pytest.approx(5.2 / figure(verdict, "neglect on M3"))
    enough = dict(claims._neglected(context)) | {"paper 1": np.array([1.0, 1.0, 4.0])}
    monkeypatch.setitem(context.shared, "claims: neglected", enough)
    assert claims.cause_of_5_2(context).status is Status.CONFIRMED


# ---------------------------------------------------------------------- percentages


@pytest.mark.parametrize(
    ("item", "status"),
    [
        ("inverse kinematics simulation, position error", Status.CONFIRMED),
        ("inverse kinematics simulation, velocity error", Status.CONFIRMED),
        ("inverse kinematics simulation, acceleration error", Status.NOT_REPRODUCIBLE),
        ("forward kinematics simulation, position error", Status.NOT_REPRODUCIBLE),
        ("forward kinematics simulation, velocity error", Status.CONFIRMED),
        ("forward kinematics simulation, acceleration error", Status.NOT_REPRODUCIBLE),
        ("torque error of M2", Status.NOT_REPRODUCIBLE),
        ("inverse kinematics experiment, X error", Status.CONFIRMED),
        ("inverse kinematics experiment, Y error", Status.CORRECTED),
        ("inverse kinematics experiment, Z error", Status.CONFIRMED),
        ("forward kinematics experiment, Z error", Status.NOT_REPRODUCIBLE),
        ("torque errors of the gait", Status.OUT_OF_REACH),
        ("measured errors come from machining, assembly and friction", Status.OUT_OF_REACH),
        ("(52) neither starts nor ends at rest", Status.CONFIRMED),
        ("M1 needs no torque in the gait", Status.CONFIRMED),
    ],
)
def test_status(verdicts, item, status):
    assert verdicts[item].status is status


def test_percentages_by_hand(verdicts):
    y = verdicts["inverse kinematics experiment, Y error"]
    assert figure(y, "percentage by the span in Y") == pytest.approx(0.9)
    z = verdicts["forward kinematics experiment, Z error"]
    thigh = 150.0 * (1.0 - 1.0 / math.sqrt(5.0 / 3.0))
    for degrees, name in ((25.0, "span in Z"), (45.0, "span in Z with 45°")):
        span = thigh + 190.0 * (1.0 - math.cos(math.radians(degrees)))
        assert figure(z, f"percentage by the {name}") == pytest.approx(170.0 / span, rel=1e-4)


def test_the_amplitude_that_would_fit(verdicts):
    verdict = verdicts["amplitude of γ in (52)"]
    assert figure(verdict, "span of Z at 25 deg") == pytest.approx(51.6, abs=0.05)
    assert figure(verdict, "span of Z at 45 deg") == pytest.approx(89.46, abs=0.01)
    assert figure(verdict, "least amplitude that fits") == pytest.approx(42.9, abs=0.15)
    assert figure(verdict, "greatest amplitude that fits") == pytest.approx(47.1, abs=0.15)


@pytest.mark.parametrize(
    ("candidates", "corrected_by", "status", "words"),
    [
        ({"span": 50.0}, "", Status.CONFIRMED, "the span fits"),
        ({"span": 100.0}, "span", Status.CORRECTED, "nothing computed fits"),
        ({"span": 100.0}, "", Status.NOT_REPRODUCIBLE, "nothing computed fits"),
        ({"span": 100.0, "span with 45°": 50.0}, "", Status.NOT_REPRODUCIBLE, "only the span with 45° fits"),
        ({"span with 45°": 50.0, "peak": 49.0}, "", Status.CONFIRMED, "the peak fits"),
    ],
)
def test_a_share_is_judged_by_what_it_is_of(context, candidates, corrected_by, status, words):
    verdict = claims._share_verdict(context, "x", "x", "Fig. 15", "Y", candidates, corrected_by=corrected_by)
    assert verdict.status is status
    assert words in verdict.finding
    assert bool(verdict.corrected) == (status is Status.CORRECTED)
