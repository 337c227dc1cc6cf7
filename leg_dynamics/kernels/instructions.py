"""A CasADi graph as instructions in single-assignment form: each value is written once and named by its number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from leg_dynamics.errors import UnsupportedError

if TYPE_CHECKING:
    import casadi

__all__ = ["Instruction", "InstructionList", "instructions"]

_NAMES = (
    *("add", "sub", "mul", "div", "neg", "inv", "sq", "twice", "sqrt", "fabs", "sign", "copysign", "fmin", "fmax"),
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("exp", "expm1", "log", "log1p", "pow", "constpow", "hypot", "erf", "floor", "ceil", "fmod", "remainder"),
    *("lt", "le", "eq", "ne", "and", "or", "not", "if_else_zero", "assign"),
)
_COMMUTATIVE = frozenset({"add", "mul", "eq", "ne", "and", "or"})


class Instruction(NamedTuple):
    """One operation; operands are numbers of earlier values, `constant` the value of a ``const``."""

    operation: str
    operands: tuple[int, ...]
    constant: float = 0.0


class InstructionList(NamedTuple):
    """A graph's instructions in order; value k is the result of instruction k.

    ``input`` instructions have the input's number and the component as operands.
    """

    body: tuple[Instruction, ...]
    outputs: tuple[tuple[int, ...], ...]
    """For each output the value of every component."""

    @property
    def arithmetic(self) -> int:
        """Number of instructions that compute something."""
        return sum(step.operation not in ("input", "const") for step in self.body)


class _Builder:
    def __init__(self) -> None:
        self.body: list[Instruction] = []
        self._known: dict[tuple[object, ...], int] = {}

    def add(self, operation: str, operands: tuple[int, ...], constant: float = 0.0) -> int:
        if operation in _COMMUTATIVE:
            operands = (min(operands), max(operands))
        # repr tells 0.0 from -0.0, which compare equal
        key = (operation, operands, repr(constant))
        if key not in self._known:
            self._known[key] = len(self.body)
            self.body.append(Instruction(operation, operands, constant))
        return self._known[key]


def instructions(function: casadi.Function) -> InstructionList:
    """Instructions of an SX function, equal ones merged and unused ones left out.

    Parameters
    ----------
    function : casadi.Function
        SX, with dense inputs. Structural zeros of outputs become the constant 0.

    Raises
    ------
    UnsupportedError
        The graph has an operation that kernels do not know, for example a call of another function.
    """
    import casadi

    if not function.is_a("SXFunction"):
        raise UnsupportedError(
            f"the graph {function.name()!r} is not made of scalar operations: expand it (casadi.Function.expand), or "
            "build it from casadi.SX"
        )
    names = {getattr(casadi, f"OP_{name.upper()}"): name for name in _NAMES}
    builder = _Builder()
    slots: dict[int, int] = {}
    written: list[dict[int, int]] = [{} for _ in range(function.n_out())]
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        operands: Sequence[int] = function.instruction_input(k)
        targets: Sequence[int] = function.instruction_output(k)
        if code == casadi.OP_CONST:
            slots[targets[0]] = builder.add("const", (), function.instruction_constant(k))
        elif code == casadi.OP_INPUT:
            slots[targets[0]] = builder.add("input", (operands[0], operands[1]))
        elif code == casadi.OP_OUTPUT:
            written[targets[0]][targets[1]] = slots[operands[0]]
        elif code in names:
            name = names[code]
            if name == "assign":
                slots[targets[0]] = slots[operands[0]]
                continue
            slots[targets[0]] = builder.add(name, tuple(slots[operand] for operand in operands))
        else:
            raise UnsupportedError(
                f"the graph {function.name()!r} has an operation (CasADi number {code}) that kernels do not compute: "
                "expand it to scalar operations first (Function.expand)"
            )
    outputs = []
    for number, values in enumerate(written):
        sparsity = function.sparsity_out(number)
        rows = sparsity.row()
        dense = [-1] * sparsity.size1()
        for nonzero, value in values.items():
            dense[rows[nonzero]] = value
        outputs.append(tuple(builder.add("const", (), 0.0) if value < 0 else value for value in dense))
    return _without_unused(builder.body, tuple(outputs))


def _without_unused(body: list[Instruction], outputs: tuple[tuple[int, ...], ...]) -> InstructionList:
    used = [False] * len(body)
    for values in outputs:
        for value in values:
            used[value] = True
    for number in range(len(body) - 1, -1, -1):
        if used[number] and body[number].operation != "input":
            for operand in body[number].operands:
                used[operand] = True
    renumbered: dict[int, int] = {}
    kept: list[Instruction] = []
    for number, step in enumerate(body):
        if used[number]:
            renumbered[number] = len(kept)
            operands = step.operands if step.operation == "input" else tuple(renumbered[o] for o in step.operands)
            kept.append(step._replace(operands=operands))
    return InstructionList(tuple(kept), tuple(tuple(renumbered[v] for v in values) for values in outputs))
