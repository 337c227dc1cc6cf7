"""LLVM assembly for rows of vectors: arithmetic, and elementary functions without branches on values.

A value is the name of a vector of `width` doubles, one entry a row. Arithmetic is IEEE 754 as written: no fast-math
flag, no reassociation, and no fused multiply-add but in the polynomials below, where it is part of the method.

The polynomials for sine, cosine, inverse tangent and inverse sine are the minimax polynomials of FDLIBM (Sun
Microsystems 1993, as in the C libraries of today); the reduction of the argument, the selection between ranges and
the use of one division for the two-argument inverse tangent are arranged here for vectors.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable

__all__ = ["LARGEST_ANGLE", "VectorCode", "double"]

LARGEST_ANGLE = 1e5
"""Sines and cosines of larger angles (rad) are taken from the C library: the reduction loses digits beyond."""

_SINE = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
    -1.66666666666666324348e-01,
)
_COSINE = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-09,
    -2.75573143513906633035e-07,
    2.48015872894767294178e-05,
    -1.38888888888741095749e-03,
    4.16666666666666019037e-02,
)
_ARC_TANGENT = (
    1.62858201153657823623e-02,
    -3.65315727442169155270e-02,
    4.97687799461593236017e-02,
    -5.83357013379057348645e-02,
    6.66107313738753120669e-02,
    -7.69187620504482999495e-02,
    9.09088713343650656196e-02,
    -1.11111104054623557880e-01,
    1.42857142725034663711e-01,
    -1.99999999998764832476e-01,
    3.33333333333329318027e-01,
)
_ARC_SINE_NUMERATOR = (
    3.47933107596021167570e-05,
    7.91534994289814532176e-04,
    -4.00555345006794114027e-02,
    2.01212532134862925881e-01,
    -3.25565818622400915405e-01,
    1.66666666666666657415e-01,
)
_ARC_SINE_DENOMINATOR = (
    7.70381505559019352791e-02,
    -6.88283971605453293030e-01,
    2.02094576023350569471e00,
    -2.40339491173441421878e00,
    1.0,
)

_TWO_OVER_PI = 2.0 / math.pi
# pi/2 in positive parts, which leave the angle -0.0 as it is: three of full length, exact in a fused multiply-subtract;
# or four, the first three of 33 bits, so that a product with an integer below 2^20 is exact.
_HALF_PI_FUSED = (1.5707963267948966, 6.123233995736765e-17, 1.082856673921914e-32)
_HALF_PI_SPLIT = (
    1.57079632673412561417e00,
    6.07710050630396597660e-11,
    2.02226624871116645580e-21,
    8.47842766036889956997e-32,
)
# Adding it leaves the nearest integer in the last bits: 1.5 * 2^52.
_ROUNDER = 6755399441055744.0
_TAN_PI_8 = 0.41421356237309503
_HALF_PI_LOW = 6.123233995736766e-17

_COMPARISONS = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}
_LIBRARY = frozenset(
    (
        *("exp", "expm1", "log", "log1p", "pow", "hypot", "erf", "floor", "ceil", "fmod", "remainder"),
        *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    )
)


def double(value: float) -> str:
    """A double as LLVM writes it, to the bit."""
    return "0x" + struct.pack(">d", value).hex().upper()


class VectorCode:
    """Writes straight-line vector code, line by line.

    Parameters
    ----------
    width : int
        Doubles in a vector, a power of two.
    fused : bool
        Whether the machine multiplies and adds in one instruction.
    spared : str
        Calling convention of the helper that is hardly ever called: one that saves every register, where there is one.

    Attributes
    ----------
    lines : list of str
        The code so far.
    declarations : set of str
        Functions that it calls.
    """

    def __init__(self, width: int, fused: bool, spared: str = "preserve_allcc") -> None:
        self.width = width
        self.fused = fused
        self.spared = spared
        self.doubles = f"<{width} x double>"
        self.integers = f"<{width} x i64>"
        self.booleans = f"<{width} x i1>"
        self.lines: list[str] = []
        self.declarations: set[str] = set()
        self._count = 0
        self._block = "entry"
        self._sines: dict[str, tuple[str, str]] = {}
        self._masks: dict[str, str] = {}

    def name(self) -> str:
        """A fresh name."""
        self._count += 1
        return f"%t{self._count}"

    def emit(self, text: str) -> str:
        """Write an instruction and return the name of its result."""
        name = self.name()
        self.lines.append(f"  {name} = {text}")
        return name

    def start_block(self, label: str) -> None:
        """Begin a basic block; what was remembered of earlier ones is forgotten."""
        self.lines.append(f"{label}:")
        self._block = label
        self._sines.clear()
        self._masks.clear()

    @property
    def block(self) -> str:
        """Label of the block that is being written."""
        return self._block

    def declare(self, declaration: str) -> None:
        """Note a function that the code calls."""
        self.declarations.add(declaration)

    def constant(self, value: float) -> str:
        """The vector that holds `value` in every row."""
        return (
            "zeroinitializer" if value == 0.0 and math.copysign(1.0, value) > 0.0 else f"splat (double {double(value)})"
        )

    def integer(self, value: int) -> str:
        """The vector of 64-bit integers `value`."""
        return f"splat (i64 {value})"

    # ------------------------------------------------------------------ arithmetic

    def binary(self, instruction: str, x: str, y: str) -> str:
        """A floating-point instruction of two operands: fadd, fsub, fmul, fdiv."""
        return self.emit(f"{instruction} {self.doubles} {x}, {y}")

    def add(self, x: str, y: str) -> str:
        """x + y."""
        return self.binary("fadd", x, y)

    def sub(self, x: str, y: str) -> str:
        """x - y."""
        return self.binary("fsub", x, y)

    def mul(self, x: str, y: str) -> str:
        """x y."""
        return self.binary("fmul", x, y)

    def div(self, x: str, y: str) -> str:
        """x / y."""
        return self.binary("fdiv", x, y)

    def neg(self, x: str) -> str:
        """-x."""
        return self.emit(f"fneg {self.doubles} {x}")

    def multiply_add(self, x: str, y: str, z: str) -> str:
        """x y + z, rounded once where the machine can."""
        if not self.fused:
            return self.add(self.mul(x, y), z)
        return self._intrinsic("fma", x, y, z)

    def _intrinsic(self, function: str, *operands: str) -> str:
        name = f"@llvm.{function}.v{self.width}f64"
        self.declare(f"declare {self.doubles} {name}({', '.join([self.doubles] * len(operands))})")
        return self.emit(f"call {self.doubles} {name}({', '.join(f'{self.doubles} {x}' for x in operands)})")

    def sqrt(self, x: str) -> str:
        """Square root, correctly rounded; NaN of a negative number."""
        return self._intrinsic("sqrt", x)

    def fabs(self, x: str) -> str:
        """Absolute value."""
        return self._intrinsic("fabs", x)

    def compare(self, condition: str, x: str, y: str) -> str:
        """Vector of truth values of a floating-point comparison: olt, ole, oeq, une, uno ..."""
        return self.emit(f"fcmp {condition} {self.doubles} {x}, {y}")

    def select(self, mask: str, x: str, y: str) -> str:
        """x where the mask holds, else y."""
        return self.emit(f"select {self.booleans} {mask}, {self.doubles} {x}, {self.doubles} {y}")

    def combine(self, instruction: str, x: str, y: str) -> str:
        """`and`, `or`, `xor` of two vectors of truth values."""
        return self.emit(f"{instruction} {self.booleans} {x}, {y}")

    def negate_mask(self, mask: str) -> str:
        """The opposite truth values."""
        return self.combine("xor", mask, "splat (i1 true)")

    def any(self, mask: str) -> str:
        """Whether a truth value of the vector holds, as one i1."""
        packed = self.emit(f"bitcast {self.booleans} {mask} to i{self.width}")
        return self.emit(f"icmp ne i{self.width} {packed}, 0")

    def bits(self, x: str) -> str:
        """The doubles' bits as integers."""
        return self.emit(f"bitcast {self.doubles} {x} to {self.integers}")

    def from_bits(self, x: str) -> str:
        """Doubles of these bits."""
        return self.emit(f"bitcast {self.integers} {x} to {self.doubles}")

    def integer_op(self, instruction: str, x: str, y: str) -> str:
        """An instruction on integers: and, or, xor, add, shl ..."""
        return self.emit(f"{instruction} {self.integers} {x}, {y}")

    def is_negative(self, x: str) -> str:
        """Whether the sign bit is set: it is for -0.0."""
        return self.emit(f"icmp slt {self.integers} {self.bits(x)}, zeroinitializer")

    def copysign(self, x: str, y: str) -> str:
        """x with the sign of y."""
        return self._intrinsic("copysign", x, y)

    def polynomial(self, coefficients: Iterable[float], x: str) -> str:
        """Horner's rule, highest power first."""
        first, *others = coefficients
        result = self.constant(first)
        for coefficient in others:
            result = self.multiply_add(result, x, self.constant(coefficient))
        return result

    # ------------------------------------------------------------------ elementary functions

    def sine_cosine(self, x: str) -> tuple[str, str]:
        """Sine and cosine; the pair is computed once for each angle."""
        if x not in self._sines:
            self._sines[x] = self._sine_cosine(x)
        return self._sines[x]

    def _sine_cosine(self, x: str) -> tuple[str, str]:
        n_shifted = self.multiply_add(x, self.constant(_TWO_OVER_PI), self.constant(_ROUNDER))
        n = self.sub(n_shifted, self.constant(_ROUNDER))
        r = x
        for part in _HALF_PI_FUSED if self.fused else _HALF_PI_SPLIT:
            r = self.multiply_add(n, self.constant(-part), r)
        z = self.mul(r, r)
        odd = self.polynomial(_SINE, z)
        # the sign of a zero is that of the angle
        sine = self.copysign(self.multiply_add(self.mul(z, r), odd, r), r)
        even = self.mul(self.mul(z, z), self.polynomial(_COSINE, z))
        half = self.mul(z, self.constant(0.5))
        one = self.constant(1.0)
        w = self.sub(one, half)
        cosine = self.add(w, self.add(self.sub(self.sub(one, w), half), even))
        quadrant = self.bits(n_shifted)
        swapped_bit = self.integer_op("and", quadrant, self.integer(1))
        swapped = self.emit(f"icmp ne {self.integers} {swapped_bit}, zeroinitializer")
        sine_sign = self._sign_of_quadrant(quadrant)
        cosine_sign = self._sign_of_quadrant(self.integer_op("add", quadrant, self.integer(1)))
        sine, cosine = self.select(swapped, cosine, sine), self.select(swapped, sine, cosine)
        sine = self.from_bits(self.integer_op("xor", self.bits(sine), sine_sign))
        cosine = self.from_bits(self.integer_op("xor", self.bits(cosine), cosine_sign))
        large = self.any(self.compare("ogt", self.fabs(x), self.constant(LARGEST_ANGLE)))
        return self._library_sines_where(large, x, sine, cosine)

    def _sign_of_quadrant(self, quadrant: str) -> str:
        bit = self.integer_op("and", quadrant, self.integer(2))
        return self.integer_op("shl", bit, self.integer(62))

    def _library_sines_where(self, large: str, x: str, sine: str, cosine: str) -> tuple[str, str]:
        """A branch that is hardly ever taken; the helper saves the registers, so that it costs the others nothing.

        The helper replaces the large angles' results only: a row's result does not depend on the rows beside it.
        """
        size = 8 * self.width
        label = self.name()[1:]
        before, slow, after = self._block, f"slow_{label}", f"after_{label}"
        self.lines.append(f"  br i1 {large}, label %{slow}, label %{after}, !prof !0")
        self.lines.append(f"{slow}:")
        places = ["%scratch", *(self.emit(f"getelementptr i8, ptr %scratch, i64 {k * size}") for k in (1, 2))]
        for place, value in zip(places, (x, sine, cosine), strict=True):
            self.lines.append(f"  store {self.doubles} {value}, ptr {place}, align {size}")
        self.lines.append(f"  call {self.spared} void @library_sines(ptr %scratch)")
        slow_sine, slow_cosine = (self.emit(f"load {self.doubles}, ptr {place}, align {size}") for place in places[1:])
        self.lines.append(f"  br label %{after}")
        self.lines.append(f"{after}:")
        self._block = after
        results = []
        for fast, other in ((sine, slow_sine), (cosine, slow_cosine)):
            results.append(self.emit(f"phi {self.doubles} [ {fast}, %{before} ], [ {other}, %{slow} ]"))
        return results[0], results[1]

    def atan2(self, y: str, x: str) -> str:
        """Angle of the point (x, y), in [-pi, pi], with the C library's answers for zeros and infinities."""
        ax, ay = self.fabs(x), self.fabs(y)
        steep = self.compare("ogt", ay, ax)
        a, b = self.select(steep, ax, ay), self.select(steep, ay, ax)
        # equal infinities count as equal numbers; a zero times a keeps a NaN
        infinite = self.compare("oeq", b, self.constant(math.inf))
        both = self.combine("and", infinite, self.compare("oeq", a, b))
        zero = self.mul(a, self.constant(0.0))
        # a power of two keeps a + b from overflowing, and subnormal numbers from losing digits below
        scaling = self.select(
            self.compare("olt", b, self.constant(2.0**500)), self.constant(2.0**100), self.constant(2.0**-100)
        )
        a, b = self.mul(a, scaling), self.mul(b, scaling)
        a = self.select(both, self.constant(1.0), self.select(infinite, zero, a))
        b = self.select(infinite, self.constant(1.0), b)
        b = self.select(self.compare("oeq", b, self.constant(0.0)), self.constant(1.0), b)
        wide = self.compare("ogt", a, self.mul(b, self.constant(_TAN_PI_8)))
        numerator = self.select(wide, self.sub(a, b), a)
        denominator = self.select(wide, self.add(a, b), b)
        t = self.div(numerator, denominator)
        z = self.mul(t, t)
        angle = self.sub(t, self.mul(t, self.mul(z, self._arc_tangent_series(z))))
        # the low halves of pi/4, pi/2 and pi are added first
        base = self.select(wide, self.constant(math.pi / 4), self.constant(0.0))
        low = self.select(wide, self.constant(0.5 * _HALF_PI_LOW), self.constant(0.0))
        sign = self.select(steep, self.constant(-1.0), self.constant(1.0))
        angle, base, low = (self.mul(sign, part) for part in (angle, base, low))
        base = self.add(base, self.select(steep, self.constant(math.pi / 2), self.constant(0.0)))
        low = self.add(low, self.select(steep, self.constant(_HALF_PI_LOW), self.constant(0.0)))
        left = self.is_negative(x)
        sign = self.select(left, self.constant(-1.0), self.constant(1.0))
        angle, base, low = (self.mul(sign, part) for part in (angle, base, low))
        base = self.add(base, self.select(left, self.constant(math.pi), self.constant(0.0)))
        low = self.add(low, self.select(left, self.constant(2.0 * _HALF_PI_LOW), self.constant(0.0)))
        result = self.add(base, self.add(angle, low))
        return self.copysign(result, y)

    def _arc_tangent_series(self, z: str) -> str:
        """(t - atan(t)) / t^3 as a polynomial in z = t^2, for |t| <= 0.4375."""
        return self.polynomial(_ARC_TANGENT, z)

    def _arc_sine_parts(self, x: str) -> tuple[str, str]:
        """Angle y in [0, pi/4], and whether |x| < 0.5, where asin|x| = y; elsewhere asin|x| = pi/2 - 2 y."""
        magnitude = self.fabs(x)
        small = self.compare("olt", magnitude, self.constant(0.5))
        complement = self.mul(self.sub(self.constant(1.0), magnitude), self.constant(0.5))
        z = self.select(small, self.mul(x, x), complement)
        t = self.select(small, magnitude, self.sqrt(complement))
        numerator = self.mul(z, self.polynomial(_ARC_SINE_NUMERATOR, z))
        ratio = self.div(numerator, self.polynomial(_ARC_SINE_DENOMINATOR, z))
        return self.multiply_add(t, ratio, t), small

    def asin(self, x: str) -> str:
        """Inverse sine; NaN outside [-1, 1]."""
        y, small = self._arc_sine_parts(x)
        large = self.add(self.sub(self.constant(math.pi / 2), self.add(y, y)), self.constant(_HALF_PI_LOW))
        return self.copysign(self.select(small, y, self._poison_outside(x, large)), x)

    def acos(self, x: str) -> str:
        """Inverse cosine; NaN outside [-1, 1]."""
        y, small = self._arc_sine_parts(x)
        negative = self.is_negative(x)
        signed = self.copysign(y, x)
        middle = self.sub(self.constant(math.pi / 2), self.sub(signed, self.constant(_HALF_PI_LOW)))
        double_y = self.add(y, y)
        obtuse = self.sub(self.constant(math.pi), self.sub(double_y, self.constant(2.0 * _HALF_PI_LOW)))
        outer = self.select(negative, obtuse, double_y)
        return self.select(small, middle, self._poison_outside(x, outer))

    def _poison_outside(self, x: str, value: str) -> str:
        inside = self.compare("ole", self.fabs(x), self.constant(1.0))
        return self.select(inside, value, self.constant(math.nan))

    def library(self, function: str, *operands: str) -> str:
        """A function of the C library, row by row."""
        signature = ", ".join(["double"] * len(operands))
        self.declare(f"declare double @{function}({signature})")
        result = "poison"
        for row in range(self.width):
            entries = [self.emit(f"extractelement {self.doubles} {x}, i32 {row}") for x in operands]
            value = self.emit(f"call double @{function}({', '.join(f'double {entry}' for entry in entries)})")
            result = self.emit(f"insertelement {self.doubles} {result}, double {value}, i32 {row}")
        return result

    # ------------------------------------------------------------------ CasADi's operations

    def _mask(self, x: str) -> str:
        """Truth values of a value that CasADi treats as one: not zero."""
        if x not in self._masks:
            self._masks[x] = self.compare("une", x, self.constant(0.0))
        return self._masks[x]

    def _truth(self, mask: str) -> str:
        value = self.select(mask, self.constant(1.0), self.constant(0.0))
        self._masks[value] = mask
        return value

    def operation(self, name: str, operands: tuple[str, ...]) -> str:
        """One operation of a CasADi graph."""
        x = operands[0]
        match name:
            case "add" | "sub" | "mul" | "div":
                return self.binary(f"f{name}", *operands)
            case "neg" | "sqrt" | "fabs" | "asin" | "acos" | "copysign" | "atan2":
                return getattr(self, name)(*operands)
            case "sq":
                return self.mul(x, x)
            case "twice":
                return self.add(x, x)
            case "inv":
                return self.div(self.constant(1.0), x)
            case "sin":
                return self.sine_cosine(x)[0]
            case "cos":
                return self.sine_cosine(x)[1]
            case "tan":
                return self.div(*self.sine_cosine(x))
            case "atan":
                return self.atan2(x, self.constant(1.0))
            case "lt" | "le" | "eq" | "ne":
                return self._truth(self.compare(_COMPARISONS[name], *operands))
            case "and" | "or":
                return self._truth(self.combine(name, self._mask(x), self._mask(operands[1])))
            case "not":
                return self._truth(self.negate_mask(self._mask(x)))
            case "if_else_zero":
                return self.select(self._mask(x), operands[1], self.constant(0.0))
            case "fmin" | "fmax":
                # as in C, of a number and a NaN the number
                return self._intrinsic("minnum" if name == "fmin" else "maxnum", *operands)
            case "sign":
                # zeros and NaN are their own sign
                unit = self.copysign(self.constant(1.0), x)
                return self.select(self.compare("one", x, self.constant(0.0)), unit, x)
            case "constpow":
                return self.library("pow", *operands)
        if name in _LIBRARY:
            return self.library(name, *operands)
        raise NotImplementedError(f"operation {name!r}")

    def library_sines(self, attributes: str) -> str:
        """Definition of the helper for %scratch: angles, sines, cosines; large angles' from the C library."""
        self.declare("declare double @sin(double)")
        self.declare("declare double @cos(double)")
        self.declare("declare double @llvm.fabs.f64(double)")
        return f"""
define internal {self.spared} void @library_sines(ptr %scratch) noinline {attributes} {{
entry:
  br label %loop
loop:
  %row = phi i64 [ 0, %entry ], [ %next, %skip ]
  %at = getelementptr double, ptr %scratch, i64 %row
  %angle = load double, ptr %at
  %size = call double @llvm.fabs.f64(double %angle)
  %large = fcmp ogt double %size, {double(LARGEST_ANGLE)}
  br i1 %large, label %replace, label %skip
replace:
  %sine = call double @sin(double %angle)
  %cosine = call double @cos(double %angle)
  %second = add i64 %row, {self.width}
  %to = getelementptr double, ptr %scratch, i64 %second
  store double %sine, ptr %to
  %third = add i64 %second, {self.width}
  %into = getelementptr double, ptr %scratch, i64 %third
  store double %cosine, ptr %into
  br label %skip
skip:
  %next = add i64 %row, 1
  %more = icmp ult i64 %next, {self.width}
  br i1 %more, label %loop, label %done
done:
  ret void
}}
"""
