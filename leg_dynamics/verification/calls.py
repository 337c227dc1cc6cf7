"""Which of an object's methods a call of one of them calls: observed while it runs, not read from the source."""

from __future__ import annotations

import dis
import sys
from collections.abc import Callable, Mapping
from types import CodeType, FrameType, TracebackType
from typing import Any

__all__ = ["names_that_failed", "observed"]


def observed(call: Callable[[], Any], codes: Mapping[CodeType, str], tell: Callable[[str, Any], None]) -> Any:
    """Make a call and tell of each method that ends in it what it returned, those called by others first.

    Parameters
    ----------
    call : callable
        Without arguments; what it returns is returned, what it raises is raised.
    codes : mapping of code to str
        Names of the methods, by the code that they run.
    tell : callable
        Called with a name and a value, None for a method that raised. It must not raise.
    """

    def watch(frame: FrameType, event: str, value: Any) -> None:
        if event == "return" and (name := codes.get(frame.f_code)) is not None:
            tell(name, value)

    before: Any = sys.getprofile()
    if before is not None and not callable(before):  # a profiler in C could not be put back
        return call()
    sys.setprofile(watch)
    try:
        return call()
    finally:
        sys.setprofile(before)


def names_that_failed(trace: TracebackType | None) -> frozenset[str]:
    """Names in the expression that raised, of the innermost Python frame.

    Where the call in ``2 * self.jacobian(q)`` fails, they are ``self``, ``jacobian`` and ``q``. Python 3.10 does not
    know the expression; there it is the line.
    """
    if trace is None:
        return frozenset()
    while trace.tb_next is not None:
        trace = trace.tb_next
    code, at = trace.tb_frame.f_code, trace.tb_lasti
    instructions = list(dis.get_instructions(code))
    within = _of_expression(instructions, at) or _of_line(code, at)
    return frozenset(
        each.argval
        for each in instructions
        if each.opname.startswith("LOAD_") and each.opname != "LOAD_CONST" and isinstance(each.argval, str)
        if within(each)
    )


Within = Callable[[dis.Instruction], bool]


def _of_expression(instructions: list[dis.Instruction], at: int) -> Within | None:
    """Whether an instruction belongs to the expression of that at an offset; None where that is not known."""
    spans = {each.offset: _span(each) for each in instructions}
    whole = spans.get(at)
    if whole is None:
        return None
    first, last = whole

    def within(each: dis.Instruction) -> bool:
        span = spans[each.offset]
        return span is not None and first <= span[0] and span[1] <= last

    return within


def _span(instruction: dis.Instruction) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """Line and column of the beginning and the end of an instruction's source."""
    place = getattr(instruction, "positions", None)
    if place is None or None in place:
        return None
    return (place.lineno, place.col_offset), (place.end_lineno, place.end_col_offset)


def _of_line(code: CodeType, at: int) -> Within:
    starts = [offset for offset, line in dis.findlinestarts(code) if line is not None]
    first = max((offset for offset in starts if offset <= at), default=0)
    last = min((offset for offset in starts if offset > at), default=len(code.co_code))
    return lambda each: first <= each.offset < last
