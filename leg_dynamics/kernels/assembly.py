"""LLVM assembly of a whole kernel: NumPy's inner loop over rows, in blocks of one vector or two, around a `Program`.

Rows beyond the last are copies of it: the same code serves one row and a million, and a row's result depends neither
on its place nor on its neighbours.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from leg_dynamics.kernels.instructions import instructions
from leg_dynamics.kernels.machine_code import ENTRY
from leg_dynamics.kernels.row_call import has_row_call, row_assembly
from leg_dynamics.kernels.vector_code import VectorCode

if TYPE_CHECKING:
    import casadi

    from leg_dynamics.kernels.program import Argument, Program, Solver
    from leg_dynamics.kernels.target import Target

__all__ = ["assembly", "block_rows"]

# Two vectors side by side hide the latency of divisions, roots and series behind each other: a row then takes 5 to 20 %
# less where vectors have 256 bits, and a single one 10 % more. Longer formulas, and solvers, gain less than they lose
# in registers and in compilation. Wider vectors were not measured.
_INTERLEAVED_LEVEL = "avx2"
_MOST_INTERLEAVED = 700

# Widest rows that are turned between rows and vectors by shuffles; wider ones go through a buffer.
_MOST_SHUFFLED = 9


def assembly(program: Program, target: Target) -> str:
    """LLVM assembly of a kernel with the signature of NumPy's inner loops.

    The function's last argument points to an integer that counts the rows that failed.

    Parameters
    ----------
    program : Program
    target : Target
        The machine: its vector width and whether it has fused multiply-add.

    Returns
    -------
    str
        A module that exports `ENTRY` (char **args, intptr_t *dimensions, intptr_t *strides, int64_t *failures), and
        the function of `leg_dynamics.kernels.row_call` where the program has one.
    """
    return _Writer(program, target).module()


def block_rows(program: Program, target: Target) -> int:
    """Rows that a kernel computes side by side: those of one vector of the machine, or of two."""
    short = program.solver is None and program.formula.n_instructions() <= _MOST_INTERLEAVED
    return target.width * (2 if short and target.level == _INTERLEAVED_LEVEL else 1)


class _Writer:
    def __init__(self, program: Program, target: Target) -> None:
        self.program = program
        self.target = target
        self.width = block_rows(program, target)
        # LLVM's code for saving every register is wrong on aarch64
        self.code = VectorCode(self.width, target.fused, "preserve_allcc" if target.is_x86 else "ccc")
        self.lines = self.code.lines
        self.align = 8 * self.width
        self.vector = self.code.doubles

    # ------------------------------------------------------------------ text

    def _scalar(self, text: str) -> str:
        return self.code.emit(text)

    def module(self) -> str:
        body = self._function()
        helper = ""
        if any("@library_sines" in line for line in body):
            # LLVM ends a function with vzeroupper even where its convention promises to keep the upper halves.
            keep = ""
            if self.target.is_x86:
                features = ",".join(filter(None, (self.target.features, "-vzeroupper")))
                keep = f'"target-cpu"="{self.target.cpu}" "target-features"="{features}"'
            helper = self.code.library_sines(keep)
        sides = self.program.inputs, self.program.outputs
        row_call = row_assembly(ENTRY, *sides) if has_row_call(*sides) else ""
        declarations = "\n".join(sorted(self.code.declarations))
        return (
            f"{declarations}\n{helper}\n"
            f"define void @{ENTRY}(ptr noalias %args, ptr noalias %dimensions, ptr noalias %strides, ptr %failures) "
            "#0 {\n" + "\n".join(body) + "\n}\n"
            f"{row_call}"
            'attributes #0 = { nounwind "no-trapping-math"="true" }\n'
            '!0 = !{!"branch_weights", i32 1, i32 1048575}\n'
        )

    def _function(self) -> list[str]:
        code, lines = self.code, self.lines
        arguments = (*self.program.inputs, *self.program.outputs)
        lines.append("entry:")
        lines.append(f"  %scratch = alloca [{3 * self.width} x double], align {self.align}")
        unknowns = self.program.solver.size if self.program.solver else 0
        if unknowns:
            lines.append(f"  %unknowns = alloca [{unknowns * self.width} x double], align {self.align}")
        largest = max((argument.size for argument in arguments), default=1)
        lines.append(f"  %buffer = alloca [{max(largest, 1) * self.width} x double], align {self.align}")
        self._save_environment()
        lines.append("  %count = load i64, ptr %dimensions")
        self._pointers(arguments)
        lines.append("  %empty = icmp sle i64 %count, 0")
        lines.append("  br i1 %empty, label %finish, label %block")
        code.start_block("block")
        lines.append("  %start = phi i64 [ 0, %entry ], [ %following, %end_of_block ]")
        lines.append("  %left = sub i64 %count, %start")
        lines.append(f"  %is_whole = icmp sge i64 %left, {self.width}")
        lines.append("  %is_single = icmp eq i64 %left, 1")
        inputs = [self._load(number, argument) for number, argument in enumerate(self.program.inputs)]
        valid = self._finite(list(itertools.chain.from_iterable(inputs)))
        unknown_values: list[str] = []
        if self.program.solver is not None:
            unknown_values, converged = self._solve(self.program.solver, inputs)
            valid = code.combine("and", valid, converged)
        *outputs, guards = self._evaluate(
            self.program.formula, [*inputs, unknown_values] if self.program.solver else inputs
        )
        for guard in guards:
            valid = code.combine("and", valid, code.compare("oge", guard, code.constant(0.0)))
        valid = code.combine("and", valid, self._finite(list(itertools.chain.from_iterable(outputs))))
        outputs = self._poison(outputs, valid)
        for number, (argument, values) in enumerate(zip(self.program.outputs, outputs, strict=True)):
            self._store(len(inputs) + number, argument, values)
        lines.append("  br label %end_of_block")
        code.start_block("end_of_block")
        lines.append(f"  %following = add i64 %start, {self.width}")
        lines.append("  %more = icmp slt i64 %following, %count")
        lines.append("  br i1 %more, label %block, label %finish")
        code.start_block("finish")
        self._restore_environment()
        lines.append("  ret void")
        return lines

    def _save_environment(self) -> None:
        """Computing rows that then fail raises floating-point flags, which NumPy would turn into warnings."""
        if self.target.is_x86:
            self.code.declare("declare void @llvm.x86.sse.stmxcsr(ptr)")
            self.lines.append("  %control = alloca i32, align 4")
            self.lines.append("  call void @llvm.x86.sse.stmxcsr(ptr %control)")

    def _restore_environment(self) -> None:
        if self.target.is_x86:
            self.code.declare("declare void @llvm.x86.sse.ldmxcsr(ptr)")
            self.lines.append("  call void @llvm.x86.sse.ldmxcsr(ptr %control)")
        else:
            self.code.declare("declare i32 @feclearexcept(i32)")
            self.lines.append("  %cleared = call i32 @feclearexcept(i32 31)")

    # ------------------------------------------------------------------ rows in and out

    def _pointers(self, arguments: Sequence[Argument]) -> None:
        """Base addresses, outer strides, and the offsets of components, which do not change from block to block."""
        self.base: list[str] = []
        self.stride: list[str] = []
        self.offsets: list[list[str]] = []
        self.is_dense: list[str] = []
        core = len(arguments)
        for number, argument in enumerate(arguments):
            at = self._scalar(f"getelementptr ptr, ptr %args, i64 {number}")
            self.base.append(self._scalar(f"load ptr, ptr {at}"))
            at = self._scalar(f"getelementptr i64, ptr %strides, i64 {number}")
            stride = self._scalar(f"load i64, ptr {at}")
            self.stride.append(stride)
            steps = []
            for _ in argument.shape:
                at = self._scalar(f"getelementptr i64, ptr %strides, i64 {core}")
                steps.append(self._scalar(f"load i64, ptr {at}"))
                core += 1
            offsets = []
            for index in itertools.product(*map(range, argument.shape)):
                offset = "0"
                for i, step in zip(index, steps, strict=True):
                    if i:
                        product = self._scalar(f"mul i64 {step}, {i}")
                        offset = product if offset == "0" else self._scalar(f"add i64 {offset}, {product}")
                offsets.append(offset)
            self.offsets.append(offsets)
            dense = self._scalar(f"icmp eq i64 {stride}, {8 * argument.size}")
            expected = 8
            for step, length in zip(reversed(steps), reversed(argument.shape), strict=True):
                if length > 1:
                    same = self._scalar(f"icmp eq i64 {step}, {expected}")
                    dense = self._scalar(f"and i1 {dense}, {same}")
                expected *= length
            self.is_dense.append(dense)

    def _row_address(self, number: int, row: str) -> str:
        offset = self._scalar(f"mul i64 {self.stride[number]}, {row}")
        return self._scalar(f"getelementptr i8, ptr {self.base[number]}, i64 {offset}")

    def _component_address(self, row_address: str, offset: str) -> str:
        return row_address if offset == "0" else self._scalar(f"getelementptr i8, ptr {row_address}, i64 {offset}")

    def _load(self, number: int, argument: Argument) -> list[str]:
        """One vector a component: the same row everywhere, whole dense rows, or any rows through a buffer."""
        if not argument.size:
            return []
        code, lines, size = self.code, self.lines, argument.size
        first_row = self._row_address(number, "%start")
        still = self._scalar(f"icmp eq i64 {self.stride[number]}, 0")
        same = self._scalar(f"or i1 {still}, %is_single")
        labels = [f"{kind}_{number}" for kind in ("same", "other", "dense", "gather", "loaded")]
        same_label, other_label, dense_label, gather_label, loaded_label = labels
        lines.append(f"  br i1 {same}, label %{same_label}, label %{other_label}")
        lines.append(f"{same_label}:")
        splats = []
        for offset in self.offsets[number]:
            value = self._scalar(f"load double, ptr {self._component_address(first_row, offset)}")
            head = self._scalar(f"insertelement {self.vector} poison, double {value}, i32 0")
            splats.append(
                self._scalar(
                    f"shufflevector {self.vector} {head}, {self.vector} poison, <{self.width} x i32> zeroinitializer"
                )
            )
        lines.append(f"  br label %{loaded_label}")
        lines.append(f"{other_label}:")
        sources = [(splats, same_label)]
        if size <= _MOST_SHUFFLED:
            dense = self._scalar(f"and i1 {self.is_dense[number]}, %is_whole")
            lines.append(f"  br i1 {dense}, label %{dense_label}, label %{gather_label}")
            lines.append(f"{dense_label}:")
            sources.append((self._deinterleave(first_row, size), dense_label))
            lines.append(f"  br label %{loaded_label}")
        else:
            lines.append(f"  br label %{gather_label}")
        lines.append(f"{gather_label}:")
        self._gather(number, size)
        gathered = []
        for component in range(size):
            at = self._scalar(f"getelementptr double, ptr %buffer, i64 {component * self.width}")
            gathered.append(self._scalar(f"load {self.vector}, ptr {at}, align {self.align}"))
        sources.append((gathered, f"gathered_{number}"))
        lines.append(f"  br label %{loaded_label}")
        code.start_block(loaded_label)
        values = []
        for component in range(size):
            choices = ", ".join(f"[ {source[component]}, %{label} ]" for source, label in sources)
            values.append(code.emit(f"phi {self.vector} {choices}"))
        return values

    def _gather(self, number: int, size: int) -> None:
        """Copy rows into the buffer, component by component; rows beyond the last repeat it."""
        lines = self.lines
        before, loop, after = f"gather_{number}", f"row_{number}", f"gathered_{number}"
        lines.append("  br label %" + loop)
        lines.append(f"{loop}:")
        lane, following = f"%lane_{number}", f"%next_lane_{number}"
        lines.append(f"  {lane} = phi i64 [ 0, %{before} ], [ {following}, %{loop} ]")
        row = self._scalar(f"add i64 %start, {lane}")
        last = self._scalar("sub i64 %count, 1")
        beyond = self._scalar(f"icmp sgt i64 {row}, {last}")
        row = self._scalar(f"select i1 {beyond}, i64 {last}, i64 {row}")
        address = self._row_address(number, row)
        for component, offset in enumerate(self.offsets[number]):
            value = self._scalar(f"load double, ptr {self._component_address(address, offset)}")
            position = self._scalar(f"add i64 {lane}, {component * self.width}")
            at = self._scalar(f"getelementptr double, ptr %buffer, i64 {position}")
            lines.append(f"  store double {value}, ptr {at}")
        lines.append(f"  {following} = add i64 {lane}, 1")
        more = self._scalar(f"icmp ult i64 {following}, {self.width}")
        lines.append(f"  br i1 {more}, label %{loop}, label %{after}")
        lines.append(f"{after}:")

    def _deinterleave(self, address: str, size: int) -> list[str]:
        total = size * self.width
        if size == 1:
            return [self._scalar(f"load {self.vector}, ptr {address}, align 8")]
        rows = self._scalar(f"load <{total} x double>, ptr {address}, align 8")
        components = []
        for component in range(size):
            mask = ", ".join(f"i32 {lane * size + component}" for lane in range(self.width))
            components.append(
                self._scalar(
                    f"shufflevector <{total} x double> {rows}, <{total} x double> poison, <{self.width} x i32> <{mask}>"
                )
            )
        return components

    def _interleaved(self, values: list[str]) -> tuple[str, int]:
        """Vectors of components, joined and turned into rows."""
        joined, length = self._join([(value, self.width) for value in values])
        size = len(values)
        mask = ", ".join(
            f"i32 {component * self.width + lane}" for lane in range(self.width) for component in range(size)
        )
        total = size * self.width
        return (
            self._scalar(
                f"shufflevector <{length} x double> {joined}, <{length} x double> poison, <{total} x i32> <{mask}>"
            ),
            total,
        )

    def _shuffle(self, x: str, y: str, length: int, mask: Iterable[int | None]) -> str:
        kind = f"<{length} x double>"
        entries = ["i32 poison" if place is None else f"i32 {place}" for place in mask]
        return self._scalar(f"shufflevector {kind} {x}, {kind} {y}, <{len(entries)} x i32> <{', '.join(entries)}>")

    def _join(self, parts: list[tuple[str, int]]) -> tuple[str, int]:
        """Concatenate vectors; both operands of a shuffle have one type, so the shorter one is filled up."""
        while len(parts) > 1:
            joined = []
            for (x, m), (y, n) in itertools.zip_longest(parts[::2], parts[1::2], fillvalue=("", 0)):
                if not n:
                    joined.append((x, m))
                    continue
                filled = y if n == m else self._shuffle(y, "poison", n, [i if i < n else None for i in range(m)])
                joined.append((self._shuffle(x, filled, m, range(m + n)), m + n))
            parts = joined
        return parts[0]

    def _store(self, number: int, argument: Argument, values: list[str]) -> None:
        if not values:
            return
        lines, code = self.lines, self.code
        first_row = self._row_address(number, "%start")
        dense_label, scatter_label, stored_label = (f"{kind}_{number}" for kind in ("write", "scatter", "stored"))
        if argument.size <= _MOST_SHUFFLED:
            dense = self._scalar(f"and i1 {self.is_dense[number]}, %is_whole")
            lines.append(f"  br i1 {dense}, label %{dense_label}, label %{scatter_label}")
            lines.append(f"{dense_label}:")
            if argument.size == 1:
                lines.append(f"  store {self.vector} {values[0]}, ptr {first_row}, align 8")
            else:
                rows, total = self._interleaved(values)
                lines.append(f"  store <{total} x double> {rows}, ptr {first_row}, align 8")
            lines.append(f"  br label %{stored_label}")
        else:
            lines.append(f"  br label %{scatter_label}")
        lines.append(f"{scatter_label}:")
        for component, value in enumerate(values):
            at = self._scalar(f"getelementptr double, ptr %buffer, i64 {component * self.width}")
            lines.append(f"  store {self.vector} {value}, ptr {at}, align {self.align}")
        rows = self._scalar(f"select i1 %is_whole, i64 {self.width}, i64 %left")
        loop = f"out_{number}"
        lines.append(f"  br label %{loop}")
        lines.append(f"{loop}:")
        lane, following = f"%out_lane_{number}", f"%next_out_lane_{number}"
        lines.append(f"  {lane} = phi i64 [ 0, %{scatter_label} ], [ {following}, %{loop} ]")
        address = self._row_address(number, self._scalar(f"add i64 %start, {lane}"))
        for component, offset in enumerate(self.offsets[number]):
            position = self._scalar(f"add i64 {lane}, {component * self.width}")
            at = self._scalar(f"getelementptr double, ptr %buffer, i64 {position}")
            value = self._scalar(f"load double, ptr {at}")
            lines.append(f"  store double {value}, ptr {self._component_address(address, offset)}")
        lines.append(f"  {following} = add i64 {lane}, 1")
        more = self._scalar(f"icmp ult i64 {following}, {rows}")
        lines.append(f"  br i1 {more}, label %{loop}, label %{stored_label}")
        code.start_block(stored_label)

    # ------------------------------------------------------------------ the computation

    def _evaluate(self, function: casadi.Function, inputs: Sequence[Sequence[str]]) -> list[list[str]]:
        listing = instructions(function)
        values: list[str] = []
        for step in listing.body:
            if step.operation == "input":
                values.append(inputs[step.operands[0]][step.operands[1]])
            elif step.operation == "const":
                values.append(self.code.constant(step.constant))
            else:
                values.append(self.code.operation(step.operation, tuple(values[operand] for operand in step.operands)))
        return [[values[value] for value in output] for output in listing.outputs]

    def _finite(self, values: list[str]) -> str:
        """Rows in which every value is finite: zero times a finite number is zero, else NaN."""
        code = self.code
        if not values:
            return code.compare("oeq", code.constant(0.0), code.constant(0.0))
        zeros = [code.mul(value, code.constant(0.0)) for value in dict.fromkeys(values)]
        while len(zeros) > 1:
            pairs = itertools.zip_longest(zeros[::2], zeros[1::2])
            zeros = [x if y is None else code.add(x, y) for x, y in pairs]
        return code.compare("oeq", zeros[0], code.constant(0.0))

    def _poison(self, outputs: list[list[str]], valid: str) -> list[list[str]]:
        """NaN in the rows that failed, and their number added to the counter."""
        code, lines, width = self.code, self.lines, self.width
        failed = code.negate_mask(valid)
        some = code.any(failed)
        before = code.block
        lines.append(f"  br i1 {some}, label %failed, label %checked, !prof !0")
        lines.append("failed:")
        nan = code.constant(float("nan"))
        poisoned = [[code.select(valid, value, nan) for value in values] for values in outputs]
        lanes = "<" + ", ".join(f"i64 {lane}" for lane in range(width)) + ">"
        head = self._scalar(f"insertelement {code.integers} poison, i64 %left, i32 0")
        limit = self._scalar(
            f"shufflevector {code.integers} {head}, {code.integers} poison, <{width} x i32> zeroinitializer"
        )
        real = self._scalar(f"icmp slt {code.integers} {lanes}, {limit}")
        counted = code.combine("and", failed, real)
        packed = self._scalar(f"bitcast {code.booleans} {counted} to i{width}")
        code.declare(f"declare i{width} @llvm.ctpop.i{width}(i{width})")
        number = self._scalar(f"call i{width} @llvm.ctpop.i{width}(i{width} {packed})")
        number = self._scalar(f"zext i{width} {number} to i64")
        lines.append(f"  {code.name()} = atomicrmw add ptr %failures, i64 {number} monotonic")
        lines.append("  br label %checked")
        code.start_block("checked")
        merged = []
        for good, bad in zip(outputs, poisoned, strict=True):
            merged.append(
                [
                    code.emit(f"phi {self.vector} [ {x}, %{before} ], [ {y}, %failed ]")
                    for x, y in zip(good, bad, strict=True)
                ]
            )
        return merged

    def _solve(self, solver: Solver, inputs: list[list[str]]) -> tuple[list[str], str]:
        """Newton's method with continuation; each row freezes as soon as it has arrived or failed."""
        code, lines = self.code, self.lines
        one, zero = code.constant(1.0), code.constant(0.0)
        (start,) = self._evaluate(solver.start, inputs)
        ((wanted,),) = self._evaluate(solver.stages, inputs)
        addresses = [
            self._scalar(f"getelementptr double, ptr %unknowns, i64 {k * self.width}") for k in range(solver.size)
        ]
        for address, value in zip(addresses, start, strict=True):
            lines.append(f"  store {self.vector} {value}, ptr {address}, align {self.align}")
        code.declare(f"declare {self.vector} @llvm.ceil.v{self.width}f64({self.vector})")
        stages = self._scalar(f"call {self.vector} @llvm.ceil.v{self.width}f64({self.vector} {wanted})")
        most = code.constant(float(solver.most_stages))
        stages = code.select(code.compare("ogt", stages, one), stages, one)
        stages = code.select(code.compare("olt", stages, most), stages, most)
        numbered = code.compare("ord", wanted, wanted)
        no_row = "splat (i1 false)"
        entered = code.block
        lines.append("  br label %stage")
        code.start_block("stage")
        k = code.emit(f"phi {self.vector} [ {one}, %{entered} ], [ %next_k, %end_of_stage ]")
        finished = code.emit(f"phi {code.booleans} [ {no_row}, %{entered} ], [ %next_finished, %end_of_stage ]")
        reached = code.emit(f"phi {code.booleans} [ {no_row}, %{entered} ], [ %next_reached, %end_of_stage ]")
        last = code.compare("oge", k, stages)
        s = code.select(last, one, code.div(k, stages))
        lines.append("  br label %newton")
        stage_block = code.block
        code.start_block("newton")
        iteration = code.emit(f"phi i64 [ 0, %{stage_block} ], [ %next_iteration, %end_of_newton ]")
        done = code.emit(f"phi {code.booleans} [ {finished}, %{stage_block} ], [ %next_done, %end_of_newton ]")
        arrived = code.emit(f"phi {code.booleans} [ {no_row}, %{stage_block} ], [ %next_arrived, %end_of_newton ]")
        unknowns = [code.emit(f"load {self.vector}, ptr {address}, align {self.align}") for address in addresses]
        step, (residual,) = self._evaluate(solver.step, [*inputs, [s], unknowns])
        close = code.compare("ole", residual, code.constant(solver.tolerance))
        hopeless = code.compare("uno", residual, zero)
        active = code.negate_mask(done)
        for address, value, change in zip(addresses, unknowns, step, strict=True):
            moved = code.select(active, code.sub(value, change), value)
            lines.append(f"  store {self.vector} {moved}, ptr {address}, align {self.align}")
        now = code.combine("and", active, close)
        ended = code.combine("or", close, hopeless)
        lines.append(f"  %next_arrived = or {code.booleans} {arrived}, {now}")
        lines.append(f"  %next_done = or {code.booleans} {done}, {ended}")
        lines.append(f"  %next_iteration = add i64 {iteration}, 1")
        waiting = code.any(code.negate_mask("%next_done"))
        in_time = self._scalar(f"icmp ult i64 %next_iteration, {solver.iterations}")
        lines.append(f"  %again = and i1 {waiting}, {in_time}")
        lines.append("  br label %end_of_newton")
        code.start_block("end_of_newton")
        lines.append("  br i1 %again, label %newton, label %end_of_stage")
        code.start_block("end_of_stage")
        # a row that did not arrive at this stage has failed; one that arrived at the last is ready
        failed = code.negate_mask(code.combine("or", "%next_arrived", finished))
        ready = code.combine("and", "%next_arrived", last)
        lines.append(f"  %next_reached = or {code.booleans} {reached}, {ready}")
        over = code.combine("or", ready, failed)
        lines.append(f"  %next_finished = or {code.booleans} {finished}, {over}")
        lines.append(f"  %next_k = fadd {self.vector} {k}, {one}")
        more = code.any(code.negate_mask("%next_finished"))
        lines.append(f"  br i1 {more}, label %stage, label %solved")
        code.start_block("solved")
        found = [code.emit(f"load {self.vector}, ptr {address}, align {self.align}") for address in addresses]
        # a residual that leaves out an unknown does not see its NaN
        converged = code.combine("and", "%next_reached", numbered)
        return found, code.combine("and", converged, self._finite(found))
