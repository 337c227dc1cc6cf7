from __future__ import annotations

import dataclasses

import casadi
import numpy as np
import pytest

from leg_dynamics.kernels import Argument, Program, Solver, compile_program, differentiated


def graph(sizes, *outputs, guards=None):
    """A function of column vectors with outputs of these symbols or sizes."""
    symbols = [casadi.SX.sym(f"x{k}", *np.atleast_1d(size)) for k, size in enumerate(sizes)]
    values = [casadi.SX.ones(*np.atleast_1d(value)) for value in outputs]
    return casadi.Function("graph", symbols, [*values, casadi.SX(0, 1) if guards is None else guards])


def test_signature():
    program = Program(
        "p",
        (Argument("a", (3,)), Argument("b", ())),
        (Argument("c", (2, 3)), Argument("d", ())),
        graph([3, 1], 6, 1),
    )
    assert program.signature == "(3),()->(2,3),()"
    assert [argument.size for argument in (*program.inputs, *program.outputs)] == [3, 1, 6, 1]
    with pytest.raises(dataclasses.FrozenInstanceError):
        program.name = "q"


A, B = (Argument("a", (4,)),), (Argument("b", (2, 2)),)


UNFIT = {
    "input": graph([3], 4),
    "output": graph([4], 3),
    "too many outputs": graph([4], 4, 4),
    "too many inputs": graph([4, 1], 4),
    "nothing": casadi.Function("f", [casadi.SX.sym("x", 4)], []),
}


@pytest.mark.parametrize("formula", UNFIT.values(), ids=UNFIT)
def test_sizes_must_fit(formula):
    with pytest.raises(ValueError, match=r"maps \[.*\] numbers to \[.*\], expected \[4\] to \[4\] and guards"):
        Program("p", A, B, formula)


@pytest.mark.parametrize(
    "formula",
    [graph([(2, 2)], 4), graph([4], (2, 2)), graph([(1, 4)], 4), graph([4], (1, 4))],
    ids=["matrix in", "matrix out", "row in", "row out"],
)
def test_matrices_must_be_flattened(formula):
    """CasADi counts column by column and NumPy row by row: a matrix would be transposed without a word."""
    with pytest.raises(ValueError, match="flatten each to one column vector, row by row"):
        Program("p", A, B, formula)


def test_inputs_must_be_dense():
    x = casadi.SX.sym("x", casadi.Sparsity(4, 1, [0, 2], [0, 3]))
    with pytest.raises(ValueError, match="input with structural zeros"):
        Program("p", A, B, casadi.Function("f", [x], [casadi.SX.ones(4), casadi.SX(0, 1)]))


EMPTY_IN, EMPTY_OUT = (Argument("a", (0,)),), (Argument("b", (2, 0)),)


@pytest.mark.parametrize(("inputs", "outputs"), [((), B), (A, ()), (EMPTY_IN, B), (A, EMPTY_OUT)])
def test_a_row_has_numbers_in_and_out(inputs, outputs):
    formula = graph([a.size for a in inputs], *(b.size for b in outputs))
    with pytest.raises(ValueError, match="each of at least one number"):
        Program("p", inputs, outputs, formula)


def test_a_solver_must_fit():
    def solver(**changes):
        parts = {"start": ([4], [2]), "stages": ([4], [1]), "step": ([4, 1, 2], [2, 1])} | changes
        functions = {}
        for name, (sizes, results) in parts.items():
            symbols = [casadi.SX.sym(f"x{k}", size) for k, size in enumerate(sizes)]
            functions[name] = casadi.Function(name, symbols, [casadi.SX.ones(size) for size in results])
        return Solver(size=2, tolerance=1e-9, **functions)

    formula = graph([4, 2], 4)
    assert Program("p", A, B, formula, solver()).solver is not None
    for name, change in (
        ("start", ([4], [3])),
        ("stages", ([4], [2])),
        ("step", ([4, 2], [2, 1])),
        ("step", ([4, 1, 2], [2, 2])),
        ("step", ([4, 1, 2], [2])),
    ):
        with pytest.raises(ValueError, match=f"{name} maps"):
            Program("p", A, B, formula, solver(**{name: change}))
    with pytest.raises(ValueError, match="graph maps"):
        Program("p", A, B, graph([4], 4), solver())


# ---------------------------------------------------------------------- derivatives


@pytest.fixture
def product(lab):
    """(q, v, g) -> (2,), valid while q[0] < 2."""
    return lab.program(
        [(2,), (3,), ()],
        lambda q, v, g: casadi.vertcat(casadi.sin(q[0]) * v[1] * g, q[1] ** 2 + v[0] * v[2]),
        [(2,)],
        guards=lambda q, v, g: 2 - q[0],
    )


def exact(q, v, g):
    zero = np.zeros_like(g)
    by_q = [[np.cos(q[:, 0]) * v[:, 1] * g, zero], [zero, 2 * q[:, 1]]]
    by_v = [[zero, np.sin(q[:, 0]) * g, zero], [v[:, 2], zero, v[:, 0]]]
    return np.moveaxis(np.array([[*a, *b] for a, b in zip(by_q, by_v, strict=True)]), -1, 0)


def test_derivatives_are_those_of_calculus(product):
    generator = np.random.default_rng(0)
    q, v, g = generator.normal(size=(20, 2)), generator.normal(size=(20, 3)), generator.normal(size=20)
    q[:, 0] = np.minimum(q[:, 0], 1.9)
    program = differentiated(product, "slope", ["x0", "x1"])
    assert program.signature == "(2),(3),()->(2,5)"
    assert program.outputs == (Argument("slope", (2, 5)),)
    np.testing.assert_allclose(compile_program(program)(q, v, g), exact(q, v, g), rtol=1e-14, atol=1e-15)
    # in the order asked for
    swapped = compile_program(differentiated(product, "slope", ["x1", "x0"]))(q, v, g)
    np.testing.assert_array_equal(swapped, compile_program(program)(q, v, g)[..., [2, 3, 4, 0, 1]])


def test_derivatives_keep_the_guards(product):
    kernel = compile_program(differentiated(product, "slope", ["x1"]))
    assert np.isnan(kernel([[2.5, 1.0], [1.0, 1.0]], np.ones(3), 1.0)).all(axis=(1, 2)).tolist() == [True, False]


def test_held_inputs_are_no_longer_inputs(product):
    program = differentiated(product, "slope", ["x0"], fixed={"x1": casadi.DM([1.0, 2.0, 3.0])})
    assert [argument.name for argument in program.inputs] == ["x0", "x2"]
    q, g = np.array([[0.3, 0.4]]), np.array([2.0])
    found = compile_program(program)(q, g)
    np.testing.assert_allclose(found, exact(q, np.array([[1.0, 2.0, 3.0]]), g)[..., :2], rtol=1e-14)


def test_derivatives_at_held_values_are_taken_before_holding(product):
    program = differentiated(product, "slope", ["x1"], fixed={"x1": casadi.DM([1.0, 2.0, 3.0])})
    q, g = np.array([[0.3, 0.4]]), np.array([2.0])
    np.testing.assert_allclose(
        compile_program(program)(q, g), exact(q, np.array([[1.0, 2.0, 3.0]]), g)[..., 2:], rtol=1e-14
    )


def test_what_cannot_be_differentiated_is_refused(lab):
    with pytest.raises(ValueError, match="solver or several outputs"):
        differentiated(lab.program([()], lambda x: [x, x], [(), ()]), "slope", ["x0"])
