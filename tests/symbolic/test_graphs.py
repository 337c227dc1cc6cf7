"""Programs against the pinocchio route and the closed form, and derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest

import leg_dynamics as ld
from leg_dynamics.description import parse, read
from leg_dynamics.errors import RowFailures
from leg_dynamics.symbolic import model as symbolic_model
from leg_dynamics.symbolic.graphs import Graphs
from leg_dynamics.symbolic.model import build_model
from leg_dynamics.verification.perturbation import with_random_inertia

TOLERANCE = 1e-9
METHODS = {
    "tree_coordinates": ("q",),
    "foot_position": ("q",),
    "foot_jacobian": ("q",),
    "foot_jacobian_derivative": ("q", "v"),
    "foot_bias_acceleration": ("q", "v"),
    "mass_matrix": ("q",),
    "bias": ("q", "v", "gravity"),
    "potential_energy": ("q", "gravity"),
    "generalized_force": ("q", "v", "a", "foot_force", "gravity"),
    "torque": ("q", "v", "a", "foot_force", "gravity"),
    "acceleration": ("q", "v", "tau", "foot_force", "gravity"),
}
LOOP_KINDS = dict.fromkeys(("revolute", "spherical"), ())
LOOP_KINDS |= dict.fromkeys(("continuous", "prismatic", "fixed", "planar", "universal"), pytest.mark.slow)
OMNILEG_SPREAD = np.radians([65.0, 65.0, 85.0])


def start(model):
    return (model.seed[: model.n], model.seed[model.n :]) if model.restarts else ()


def disagreement(result, reference, angles=False):
    count = len(reference)
    if angles:
        result, reference = np.exp(1j * result), np.exp(1j * reference)
    difference = np.abs(result - reference).reshape(count, -1).max(axis=1)
    size = 1.0 + np.abs(reference).reshape(count, -1).max(axis=1)
    return difference / size


def compare(lab, graphs, route, states, methods=METHODS, least=0.9):
    """Every method on rows that both compute; the symbolic one must compute nearly all that the other does."""
    model = graphs.model
    for method in methods:
        arguments = [states[name] for name in METHODS[method]]
        result = lab.evaluate.evaluator(getattr(graphs, method)())(*arguments, *start(model))
        if model.restarts:
            result = result[0]
        reference = getattr(route, method)(*arguments, RowFailures())
        if method == "tree_coordinates":
            order = [route.tree_joint_names.index(each.name) for each in model.tree.joints]
            reference = reference[:, order]
        count = len(reference)
        known = np.isfinite(reference.reshape(count, -1)).all(axis=1)
        both = known & np.isfinite(result.reshape(count, -1)).all(axis=1)
        assert both.sum() >= least * known.sum(), method
        assert both.sum() >= 5, method
        error = disagreement(result[both], reference[both], angles=method == "tree_coordinates")
        assert error.max() < TOLERANCE, (method, error.max())


def models(lab, text, foot="foot", hip=None, **options):
    """Graphs and the pinocchio route of a text or a path."""
    description = lab.quiet(parse if text.lstrip().startswith("<") else read, text)
    leg = lab.quiet(ld.load, text, route="pinocchio", foot=foot)
    seed = None
    if not description.configurations:
        seeds = lab.quiet(lambda: leg._route.mechanism.seeds)
        seed = dict(zip(leg.tree_joint_names, seeds[0].q, strict=True))
    model = lab.quiet(build_model, description, foot, hip, seed=seed, **options)
    return Graphs(model), leg._route


@pytest.fixture(scope="module")
def omnileg():
    return Graphs(symbolic_model.build_model(read("omnileg"), "foot", "hip"))


def test_omnileg_agrees_with_both_other_routes(lab, omnileg):
    states = lab.states(np.zeros(3), OMNILEG_SPREAD, 60, 3)
    states["q"][:5, 2] = [0.0, 1e-12, -1e-9, 1e-6, -1e-3]
    compare(lab, omnileg, ld.load("omnileg", route="pinocchio")._route, states, least=1.0)
    compare(lab, omnileg, ld.load("omnileg", route="closed_form")._route, states, least=1.0)


def test_omnileg_needs_no_iteration_and_few_instructions(omnileg):
    program = omnileg.torque()
    assert program.solver is None
    assert program.formula.n_instructions() < 1100


@pytest.mark.slow
def test_omnileg_body_by_body_without_relations(lab):
    graphs = Graphs(build_model(read("omnileg"), "foot", "hip", simplify=False))
    assert graphs.model.nz == 16
    states = lab.states(np.zeros(3), OMNILEG_SPREAD, 20, 3, seed=1)
    methods = ("tree_coordinates", "foot_jacobian", "mass_matrix", "torque", "acceleration")
    compare(lab, graphs, ld.load("omnileg", route="closed_form")._route, states, methods, least=1.0)


def test_omnileg_with_random_inertia(lab):
    text = with_random_inertia(read("omnileg"), seed=3)
    graphs, route = models(lab, text, hip="hip")
    states = lab.states(np.zeros(3), OMNILEG_SPREAD, 25, 3, seed=2)
    compare(lab, graphs, route, states, ("mass_matrix", "bias", "torque", "acceleration"), least=1.0)


@pytest.mark.slow
def test_omnileg_many_rows_in_the_right_assembly_mode(lab, omnileg):
    states = lab.states(np.zeros(3), OMNILEG_SPREAD, 200_000, 3, seed=5)
    reference = ld.load("omnileg", route="closed_form")._route
    result = lab.evaluate.evaluator(omnileg.tree_coordinates())(states["q"])
    wanted = reference.tree_coordinates(states["q"], RowFailures())
    order = [reference.tree_joint_names.index(each.name) for each in omnileg.model.tree.joints]
    assert np.abs(result - wanted[:, order]).max() < 1e-10


@pytest.mark.parametrize("name", ["crank_rocker", "slider", "guide", "gears"])
def test_small_mechanisms(lab, name):
    text = {
        "crank_rocker": lab.crank_rocker(damping=0.3, friction=0.2),
        "slider": lab.slider_crank(),
        "guide": lab.slider_crank("prismatic"),
        "gears": lab.gears(),
    }[name]
    graphs, route = models(lab, text)
    spread = np.full(graphs.model.n, 1.5)
    compare(lab, graphs, route, lab.states(graphs.model.seed[: graphs.model.n], spread, 40, 1))


def test_actuated_slider_that_is_not_independent(lab):
    graphs, route = models(lab, lab.slider_crank(actuated="slide"))
    states = lab.states(graphs.model.seed[:1], np.array([0.5]), 30, 1)
    compare(lab, graphs, route, states, ("generalized_force", "torque", "acceleration"))


def test_a_resting_joint_has_no_coulomb_friction(lab):
    graphs, route = models(lab, lab.crank_rocker(friction=0.2))
    states = lab.states(graphs.model.seed[:1], np.array([1.0]), 20, 1)
    states["v"][::2] = 0.0
    compare(lab, graphs, route, states, ("bias", "torque"))


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=marks) for kind, marks in LOOP_KINDS.items()])
def test_random_spatial_loops(lab, kind):
    graphs, route = models(lab, lab.random_loop(kind, 1), foot="link_b3")
    model = graphs.model
    states = lab.states(model.seed[: model.n], 0.25 * model.unit[: model.n], 25, len(model.actuated))
    compare(lab, graphs, route, states, least=0.8)


@pytest.mark.parametrize("name", ["four_bar", "six_bar", "mini_cheetah_leg", "revolute_rotor_chain"])
def test_files_of_others(lab, name):
    check_file_of_others(lab, name)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["parallel_chain_explicit_d5_l6", "parallel_chain_implicit_d5_l5"])
def test_longer_files_of_others(lab, name):
    check_file_of_others(lab, name)


def check_file_of_others(lab, name):
    path = lab.SHARED_MODELS / f"{name}.urdf"
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    text = str(path)
    foot = lab.quiet(read, text).links[-1].name
    graphs, route = models(lab, text, foot=foot)
    model = graphs.model
    spread = 0.3 * np.pi * model.unit[: model.n]
    states = lab.states(model.seed[: model.n], spread, 30, len(model.actuated))
    lab.quiet(compare, lab, graphs, route, states)


# ---------------------------------------------------------------------------------------------- derivatives


def differences(function, x, step):
    columns = []
    for k in range(x.shape[-1]):
        shift = np.zeros(x.shape[-1])
        shift[k] = step
        columns.append((function(x + shift) - function(x - shift)) / (2.0 * step))
    return np.stack(columns, axis=-1)


def assert_close(result, reference):
    scale = 1.0 + np.abs(reference).max()
    assert np.abs(result - reference).max() < 1e-6 * scale


@pytest.mark.parametrize("name", ["omnileg", "crank_rocker", "spherical", "full"])
def test_derivatives_against_differences(lab, omnileg, name):
    if name == "omnileg":
        graphs = omnileg
    elif name == "full":
        graphs = Graphs(lab.quiet(build_model, parse(lab.crank_rocker(damping=0.2)), "foot", simplify=False))
    elif name == "crank_rocker":
        graphs = Graphs(build_model(parse(lab.crank_rocker(damping=0.3, friction=0.1)), "foot"))
    else:
        graphs = Graphs(build_model(parse(lab.random_loop("spherical", 2)), "link_b3"))
    model = graphs.model
    states = lab.states(model.seed[: model.n], 0.2 * model.unit[: model.n], 4, len(model.actuated))
    q, v, a, tau = (states[key] for key in ("q", "v", "a", "tau"))
    rest = (states["foot_force"], states["gravity"], *start(model))
    call = lab.evaluate.evaluator(graphs.torque())
    torque = (lambda *x: call(*x)[0]) if model.restarts else call
    by_q, by_v, by_a = split(lab, graphs.torque_derivatives(), model, (q, v, a, *rest))
    assert_close(by_q, differences(lambda x: torque(x, v, a, *rest), q, 1e-5))
    assert_close(by_v, differences(lambda x: torque(q, x, a, *rest), v, 1e-4))
    assert_close(by_a, differences(lambda x: torque(q, v, x, *rest), a, 1e-3))
    call_forward = lab.evaluate.evaluator(graphs.acceleration())
    forward = (lambda *x: call_forward(*x)[0]) if model.restarts else call_forward
    by_q, by_v, by_tau = split(lab, graphs.acceleration_derivatives(), model, (q, v, tau, *rest))
    assert_close(by_q, differences(lambda x: forward(x, v, tau, *rest), q, 1e-5))
    assert_close(by_v, differences(lambda x: forward(q, x, tau, *rest), v, 1e-4))
    assert_close(by_tau, differences(lambda x: forward(q, v, x, *rest), tau, 1e-3))


def split(lab, program, model, arguments):
    """Blocks of a derivative by its three arguments."""
    whole = lab.evaluate.evaluator(program)(*arguments)
    whole = whole[0] if model.restarts else whole
    return np.split(whole, [model.n, 2 * model.n], axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["torque", "acceleration"])
def test_parameter_derivatives_against_changed_files(lab, kind):
    text = lab.slider_crank(actuated="slide")
    inertial = ("rod_link.mass", "rod_link.com.x", "foot.ixz", "crank_link.izz", "rod.damping", "drive_slide.reduction")
    geometric = ("rod.origin.x", "wrist.predecessor.x", "foot.mass")
    description = parse(text)
    for names in (inertial, geometric):
        graphs = Graphs(build_model(description, "foot", parameters=names))
        model = graphs.model
        assert model.iterates == (names is geometric)
        states = lab.states(model.seed[:1], np.array([0.4]), 5, 1)
        arguments = [states[key] for key in METHODS[kind]]
        call = lab.evaluate.evaluator(getattr(graphs, f"{kind}_parameter_derivatives")())
        derivative = call(*arguments, *start(model))
        derivative = derivative[0] if model.restarts else derivative
        step = 1e-5
        for column, name in enumerate(names):
            values = []
            for sign in (1.0, -1.0):
                changed = lab.quiet(build_model, changed_number(description, name, sign * step), "foot", simplify=False)
                call = lab.evaluate.evaluator(getattr(Graphs(changed), kind)())
                result = call(*arguments, *start(changed))
                values.append(result[0] if changed.restarts else result)
            assert_close(derivative[..., column], (values[0] - values[1]) / (2.0 * step))


def changed_number(description, name, change):
    """The same description with one number changed."""
    from dataclasses import replace

    element, *field = name.split(".")
    axis = "xyz".index(field[-1]) if field[-1] in "xyz" else None

    def shifted(pose):
        xyz = list(pose.xyz)
        xyz[axis] += change
        return replace(pose, xyz=tuple(xyz))

    links, joints, loops = list(description.links), list(description.joints), list(description.loops)
    for i, each in enumerate(links):
        if each.name == element:
            if field[0] == "com":
                inertial = replace(each.inertial, origin=shifted(each.inertial.origin))
            else:
                inertial = replace(each.inertial, **{field[0]: getattr(each.inertial, field[0]) + change})
            links[i] = replace(each, inertial=inertial)
    for i, each in enumerate(joints):
        if each.name == element:
            if field[0] == "damping":
                joints[i] = replace(each, damping=each.damping + change)
            else:
                joints[i] = replace(each, origin=shifted(each.origin))
    drives = [
        replace(each, reduction=each.reduction + change) if each.name == element else each
        for each in description.transmissions
    ]
    for i, each in enumerate(loops):
        if each.name == element:
            end = getattr(each, field[0])
            loops[i] = replace(each, **{field[0]: replace(end, origin=shifted(end.origin))})
    return replace(
        description, links=tuple(links), joints=tuple(joints), loops=tuple(loops), transmissions=tuple(drives)
    )


def test_nan_input_fails_its_row_only(lab, omnileg):
    states = lab.states(np.zeros(3), OMNILEG_SPREAD, 4, 3)
    states["v"][2, 1] = np.nan
    arguments = [states[key] for key in METHODS["torque"]]
    result = lab.evaluate.evaluator(omnileg.torque())(*arguments)
    assert np.isnan(result[2]).all()
    assert np.isfinite(result[[0, 1, 3]]).all()
