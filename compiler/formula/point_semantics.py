"""Point semantics of opcodes: values and derivatives; one source for numpy and LLVM vectors.

The numeric backend `m` has where, sqrt, floor, sin …; operators are those of the numbers. NumpyMath is here, the LLVM backend in
render/formula/llvm_math.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...lang.noise import PERMUTATION
from .opcodes import LEAST_COSINE, Op

Number = Any  # a numpy array, or an LLVM vector


class NumpyMath:
    """Numeric backend on float64 arrays.

    `maybe` collects where intervals may be undefined; with `ways` operations that jump take one side (interval_arithmetic.one_side).
    """

    unit, tiny, big, most, lost, tells = 2.0**-52, 1e-300, 1e290, 1e300, False, False
    squares = (2.0**-400, 2.0**600), (2.0**500, 2.0**-600)  # numbers below and above are scaled before they are squared (hypotenuse)
    sqrt, floor, ceil, exp, log, power = np.sqrt, np.floor, np.ceil, np.exp, np.log, np.power
    sin, cos, tan, asin, acos, atan, atan2 = np.sin, np.cos, np.tan, np.arcsin, np.arccos, np.arctan, np.arctan2
    least, largest = np.minimum, np.maximum  # of numbers that are NaN only together

    def __init__(self, shape: tuple[int, ...] = (), ways: Any = None) -> None:
        self.maybe = np.zeros(shape, bool)  # where a value may be undefined
        self.forks, self.rest = ways is not None, ways

    def where(self, mask: Number, yes: Number, no: Number) -> Number:
        return np.where(mask, yes, no)

    def clipped(self, x: Number, low: float, high: float) -> Number:
        """A number clamped to [low, high]; NaN stays."""
        return np.minimum(np.maximum(x, low), high)

    def undefined(self, mask: Number) -> None:
        self.maybe = self.maybe | mask

    def unbounded(self, mask: Number) -> None:
        """Records bounds beyond `big`; float64 does not need it."""

    def was_undefined(self, like: Number) -> Number:
        return self.maybe

    def fork(self, mask: Number) -> Number:
        """Whether to take the second side of a jump: the next binary digit of `ways`; without one, `maybe` is set."""
        self.undefined(mask & (self.rest < 2))
        second = mask & (self.rest % 2 == 1)
        self.rest = np.where(mask & (self.rest >= 2), self.rest // 2, self.rest)
        return second

    def index(self, x: Number) -> Number:
        """The integer x modulo 256."""
        return np.where(np.isfinite(x), np.mod(x, 256.0), 0.0).astype(np.int64)

    def permuted(self, index: Number) -> Number:
        return _PERMUTATION[index & 255]

    def bit(self, index: Number, bits: int) -> Number:
        return (index & bits) != 0


_PERMUTATION = np.array(PERMUTATION, np.int64)


# --- points -------------------------------------------------------------------------------------------------------------


def point(m: Any, op: int, a: Number, b: Number = None, c: Number = None) -> Number:
    """The value of an operation."""
    match op:
        case Op.COPY:
            return a
        case Op.ADD:
            return a + b
        case Op.SUBTRACT:
            return a - b
        case Op.MULTIPLY:
            return a * b
        case Op.DIVIDE:
            return a / b
        case Op.NEGATE:
            return -a
        case Op.ABS:
            return abs(a)
        case Op.SQUARE:
            return a * a
        case Op.CUBE:
            return a * a * a
        case Op.HYPOT:
            return hypotenuse(m, a, b)
        case Op.MIN:
            return m.where(b != b, a, m.where(a < b, a, b))
        case Op.MAX:
            return m.where(a != a, a, m.where(a > b, a, b))
        case Op.MOD:
            return a - b * m.floor(a / b)
        case Op.SIGN:
            return m.where(a > 0.0, 1.0 + 0.0 * a, m.where(a < 0.0, -1.0 + 0.0 * a, a))
        case Op.CHOOSE:
            return m.where(a <= 0.0, b, c)
        case Op.ARC:
            within, _, large, part, _ = arc(m, a, b, c)
            return m.where(within, hypotenuse(m, large, part), large)
        case Op.QUARTER_ARC:
            _, large, small = ordered(m, a, b)
            return m.where(small > 0.0, hypotenuse(m, large, small), large)
        case Op.POWER:
            return m.power(a, b)
        case Op.ATAN2 | Op.ANGLE:
            return m.atan2(a + 0.0, b + 0.0)  # −0, as of ceil(−½), becomes 0: on the branch cut the angle is π
        case Op.NOISE:
            return noise(m, a, b, c)[0]
        case _:
            return getattr(m, _FUNCTION[Op(op)])(a)


_FUNCTION = {
    Op.SQRT: "sqrt", Op.EXP: "exp", Op.LOG: "log", Op.SIN: "sin", Op.COS: "cos", Op.TAN: "tan", Op.ASIN: "asin", Op.ACOS: "acos",
    Op.ATAN: "atan", Op.FLOOR: "floor", Op.CEIL: "ceil",
}  # fmt: skip


def slopes(m: Any, op: int, operands: list[Number], value: Number, turns: list[list[Number]]) -> list[Number]:
    """The derivatives of an operation along several directions; `turns` holds, for each operand, its derivatives along them."""
    ways = range(len(turns[0]))
    a = operands[0]
    match op:
        case Op.ADD:
            return [turns[0][k] + turns[1][k] for k in ways]
        case Op.SUBTRACT:
            return [turns[0][k] - turns[1][k] for k in ways]
        case Op.MULTIPLY:
            return [turns[0][k] * operands[1] + turns[1][k] * a for k in ways]
        case Op.MIN:
            first = (operands[1] != operands[1]) | (a < operands[1])
            return [m.where(first, turns[0][k], turns[1][k]) for k in ways]
        case Op.MAX:
            first = (a != a) | (a > operands[1])
            return [m.where(first, turns[0][k], turns[1][k]) for k in ways]
        case Op.CHOOSE:
            return [m.where(a <= 0.0, turns[1][k], turns[2][k]) for k in ways]
        case Op.ARC:
            within, first, large, part, (cosine, sine) = arc(m, *operands)
            more, less = (large - cosine * part / sine) / value, part / (sine * value)
            large_turns, small_turns = ([m.where(first, turns[n][k], turns[1 - n][k]) for k in ways] for n in (0, 1))
            bends = m.where((operands[2] > LEAST_COSINE) & (operands[2] < 1.0), more * less * value, 0.0 * value)
            found = [more * large_turns[k] + less * small_turns[k] - bends * turns[2][k] for k in ways]
            return [m.where(within, found[k], large_turns[k]) for k in ways]
        case Op.QUARTER_ARC:
            first, large, small = ordered(m, a, operands[1])
            found = [(a * turns[0][k] + operands[1] * turns[1][k]) / value for k in ways]
            return [m.where(small > 0.0, found[k], m.where(first, turns[0][k], turns[1][k])) for k in ways]
        case Op.MOD:
            turn = m.floor(a / operands[1])
            return [turns[0][k] - turns[1][k] * turn for k in ways]
        case Op.NOISE:
            _, gx, gy, gz = noise(m, *operands)
            return [gx * turns[0][k] + gy * turns[1][k] + gz * turns[2][k] for k in ways]
        case Op.FLOOR | Op.CEIL | Op.SIGN:
            return [0.0 * turns[0][k] for k in ways]
        case Op.COPY:
            return turns[0]
        case Op.NEGATE:
            return [-d for d in turns[0]]
    factors = _factors(m, op, operands, value)
    found = [d * factors[0] for d in turns[0]]
    return [f + turns[1][k] * factors[1] for k, f in enumerate(found)] if len(factors) > 1 else found


def hypotenuse(m: Any, a: Number, b: Number) -> Number:
    """√(a² + b²), scaled by a power of two where squares would overflow or underflow."""
    size = m.largest(abs(a), abs(b))
    (least, grow), (most, shrink) = m.squares
    small, large = size < least, size > most
    by = m.where(large, shrink, m.where(small, grow, 1.0))
    back = m.where(large, 1.0 / shrink, m.where(small, 1.0 / grow, 1.0))
    a, b = a * by, b * by
    return m.sqrt(a * a + b * b) * back


def arc(m: Any, a: Number, b: Number, c: Number) -> tuple[Number, Number, Number, Number, tuple[Number, Number]]:
    """ARC: (whether both components are needed, whether a is the larger, the larger, the part across it, cosine and sine).

    Of two half-spaces with unit normals n and m, n · v ≥ a and m · v ≥ b, it is the least |v| on both, with its sign where a and b are
    negative. The vector that satisfies the larger bound alone satisfies the other one where small ≤ c · large. Else v = λ n + μ m on
    both bounds, and |v|² = large² + ((small − c · large) / √(1 − c²))². It grows with a and b and falls with c. An undefined bound or
    cosine does not count.
    """
    cosine = m.clipped(c, LEAST_COSINE, 1.0)
    first, large, small = ordered(m, a, b)
    rise, square = small - cosine * large, 1.0 - cosine * cosine
    sine = m.sqrt(m.where(square > m.tiny, square, m.tiny + 0.0 * square))
    return rise > 0.0, first, large, rise / sine, (cosine, sine)


def ordered(m: Any, a: Number, b: Number) -> tuple[Number, Number, Number]:
    """(whether a is the larger operand of an arc, the larger one, the smaller one); an undefined one is the smaller one."""
    first = (b != b) | (a >= b)
    return first, m.where(first, a, b), m.where(first, b, a)


def _factors(m: Any, op: int, operands: list[Number], value: Number) -> tuple[Number, ...]:
    """The partial derivatives of an operation by its operands."""
    a = operands[0]
    least = m.tiny
    match op:
        case Op.DIVIDE:
            return 1.0 / operands[1], -value / operands[1]
        case Op.ABS:
            return (m.where(a < 0.0, -1.0 + 0.0 * a, 1.0 + 0.0 * a),)
        case Op.SQUARE:
            return (a + a,)
        case Op.CUBE:
            return (3.0 * (a * a),)
        case Op.SQRT:
            return (0.5 / m.where(value > least, value, least + 0.0 * value),)
        case Op.HYPOT:
            safe = m.where(value > least, value, 1.0 + 0.0 * value)
            return a / safe, operands[1] / safe
        case Op.EXP:
            return (value,)
        case Op.LOG:
            return (1.0 / a,)
        case Op.POWER:
            base = m.where(a > least, a, 1.0 + 0.0 * a)
            return operands[1] * m.power(a, operands[1] - 1.0), m.where(a > least, value * m.log(base), 0.0 * value)
        case Op.SIN:
            return (m.cos(a),)
        case Op.COS:
            return (-m.sin(a),)
        case Op.TAN:
            return (1.0 + value * value,)
        case Op.ASIN:
            return (1.0 / m.sqrt(1.0 - a * a),)
        case Op.ACOS:
            return (-1.0 / m.sqrt(1.0 - a * a),)
        case Op.ATAN:
            return (1.0 / (1.0 + a * a),)
        case Op.ATAN2 | Op.ANGLE:
            x = operands[1]
            square = a * a + x * x
            square = m.where(square > least, square, 1.0 + 0.0 * square)
            return x / square, -a / square
    raise ValueError(op)


# --- noise --------------------------------------------------------------------------------------------------------------


def noise(m: Any, x: Number, y: Number, z: Number) -> tuple[Number, Number, Number, Number]:
    """Perlin's improved noise (SIGGRAPH 2002; lang/noise.py) and its derivatives by x, y and z."""
    whole = [m.floor(p) for p in (x, y, z)]
    cell = [m.index(p) for p in whole]
    part = [p - w for p, w in zip((x, y, z), whole, strict=True)]
    fade = [t * t * t * (t * (t * 6.0 - 15.0) + 10.0) for t in part]
    steep = [30.0 * t * t * (t * (t - 2.0) + 1.0) for t in part]
    value: dict[tuple[int, int, int], Number] = {}
    ways: dict[tuple[int, int, int], list[Number]] = {}
    for i in (0, 1):
        first = m.permuted(cell[0] + i)
        for j in (0, 1):
            second = m.permuted(first + cell[1] + j)
            for k in (0, 1):
                way = _corner_way(m, m.permuted(second + cell[2] + k), x)
                value[i, j, k] = way[0] * (part[0] - i) + way[1] * (part[1] - j) + way[2] * (part[2] - k)
                ways[i, j, k] = way

    def mixed(of: Any, fixed: int = -1) -> Number:
        """Trilinear mixture; along axis `fixed` the difference instead."""

        def along(axis: int, low: Number, high: Number) -> Number:
            return high - low if axis == fixed else low + fade[axis] * (high - low)

        rows = [along(1, along(0, of(0, 0, k), of(1, 0, k)), along(0, of(0, 1, k), of(1, 1, k))) for k in (0, 1)]
        return along(2, *rows)

    found = mixed(lambda *c: value[c])
    turns = [mixed(lambda *c, n=n: ways[c][n]) + steep[n] * mixed(lambda *c: value[c], n) for n in range(3)]
    return found, turns[0], turns[1], turns[2]


def _corner_way(m: Any, hashed: Any, like: Number) -> list[Number]:
    """The gradient at a lattice corner: two of x, y and z, each with a sign."""
    eight, four, two, one = (m.bit(hashed, b) for b in (8, 4, 2, 1))
    first_x = ~eight
    second_y = ~eight & ~four
    second_x = eight & four & ~one  # 12 and 14
    nothing = 0.0 * like
    u, v = m.where(one, nothing - 1.0, nothing + 1.0), m.where(two, nothing - 1.0, nothing + 1.0)
    ux, uy = m.where(first_x, u, nothing), m.where(first_x, nothing, u)
    vx, vy = m.where(second_x, v, nothing), m.where(second_y, v, nothing)
    vz = m.where(second_x | second_y, nothing, v)
    return [ux + vx, uy + vy, vz]
