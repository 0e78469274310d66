"""exp, log, power and hypot from polynomials, in float32 and float64.

exp is Cephes' (Moshier 1989). log is Cephes' in float32 and fdlibm's in float64 (Sun Microsystems 1993). A float32 power is evaluated in
float64, a float64 power from a double-double logarithm. docs/simd.md lists the largest measured errors.
"""

from __future__ import annotations

import math

from .llvm_expr import Value, fma, maximum, minimum, select
from .polynomials import fast_two_sum, from_integer, polynomial, power_of_two, to_integer, two_product, two_sum

_EXP_32 = (1.9875691500e-4, 1.3981999507e-3, 8.3334519073e-3, 4.1665795894e-2, 1.6666665459e-1, 5.0000001201e-1)
_EXP_64_P = (1.26177193074810590878e-4, 3.02994407707441961300e-2, 9.99999999999999999910e-1)
_EXP_64_Q = (3.00198505138664455042e-6, 2.52448340349684104192e-3, 2.27265548208155028766e-1, 2.0)
# ln 2 in two parts: products of the first with integer exponents are exact.
_LN2 = {32: (0.693359375, -2.12194440e-4), 64: (6.93145751953125e-1, 1.42860682030941723212e-6)}
_EXP_ENDS = {32: (-104.0, 88.8), 64: (-746.0, 709.8)}
"""Arguments at which exp rounds to 0 and ∞."""


def exp(x: Value) -> Value:
    return _exp_of_sum(x, None)


def _exp_of_sum(x: Value, tail: Value | None) -> Value:
    """exp(x + tail) for a tail small against x."""
    low, high = _EXP_ENDS[x.bits]
    clipped = minimum(maximum(x, x.constant(low)), x.constant(high))
    k = (clipped * (1.0 / math.log(2.0))).call("nearbyint")
    first, second = _LN2[x.bits]
    r = (clipped - k * first) - k * second
    if tail is not None:
        r = r + select(clipped == x, tail, tail.constant(0.0))
    if x.bits == 32:
        grown = 1.0 + fma(polynomial(r, _EXP_32), r * r, r)
    else:
        z = r * r
        p = r * polynomial(z, _EXP_64_P)
        grown = 1.0 + 2.0 * (p / (polynomial(z, _EXP_64_Q) - p))
    # Scale by half of the exponent twice: the power of two of a denormal result is not a normal number.
    k = to_integer(k)
    half = k >> 1
    result = grown * power_of_two(half) * power_of_two(k - half)
    return select(x == x, result, x)


_LOG_32 = (
    7.0376836292e-2, -1.1514610310e-1, 1.1676998740e-1, -1.2420140846e-1, 1.4249322787e-1, -1.6668057665e-1, 2.0000714765e-1,
    -2.4999993993e-1, 3.3333331174e-1,
)  # fmt: skip
_LOG_64 = (
    1.479819860511658591e-1, 1.531383769920937332e-1, 1.818357216161805012e-1, 2.222219843214978396e-1, 2.857142874366239149e-1,
    3.999999999940941908e-1, 6.666666666666735130e-1,
)  # fmt: skip
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-1, 1.90821492927058770002e-10  # fdlibm's: 32 bits and the rest
_LN2_LAST = 1.1612227229362532e-26  # the remainder after both


def split_exponent(x: Value) -> tuple[Value, Value]:
    """(m, k): x = m · 2ᵏ with √½ ≤ m < √2, for positive finite x, denormal or not."""
    mantissa, scale, tiny = (23, 25, 2.0**-126) if x.bits == 32 else (52, 54, 2.0**-1022)
    small = x < tiny
    bits = select(small, x * 2.0**scale, x).bitcast("i")
    root = 0x3F3504F3 if x.bits == 32 else 0x3FE6A09E667F3BCD  # √½
    k = (bits - root) >> mantissa
    m = (bits - (k << mantissa)).bitcast("f")
    return m, from_integer(k) - select(small, x.constant(scale), x.constant(0.0))


def log(x: Value) -> Value:
    m, k = split_exponent(x)
    f = m - 1.0
    if x.bits == 32:
        z = f * f
        y = polynomial(f, _LOG_32) * z * f
        y = fma(k, k.constant(_LN2[32][1]), y) - 0.5 * z
        result = fma(k, k.constant(_LN2[32][0]), f + y)
    else:
        s = f / (2.0 + f)
        z = s * s
        half = 0.5 * f * f
        result = k * _LN2_HIGH - ((half - (s * (half + polynomial(z, _LOG_64) * z) + k * _LN2_LOW)) - f)
    result = select(x == 0.0, x.constant(-math.inf), result)
    result = select(x == math.inf, x, result)
    return select(x >= 0.0, result, x.constant(math.nan))


def _log_in_two(x: Value) -> tuple[Value, Value]:
    """log x as a double-double sum, of relative error about 2⁻⁶⁸, for positive finite x.

    log m = 2 artanh s = 2 s (1 + s²/3 + s⁴/5 + …) with s = (m − 1) / (m + 1); s and the first terms are double-double.
    """
    m, k = split_exponent(x)
    f = m - 1.0
    below, below_rest = fast_two_sum(m.constant(2.0), f)
    s = f / below
    p, p_rest = two_product(s, below)
    s_rest = ((f - p) - p_rest - s * below_rest) / below
    z, z_rest = two_product(s, s)
    z_rest = z_rest + 2.0 * s * s_rest
    tail = polynomial(z, [1 / n for n in range(27, 3, -2)])  # 1/5 + z/7 + …
    third = 1.0 / 3.0
    third_rest = 1.850371707708594e-17  # 1/3 minus its float64 value
    t, t_rest = two_product(z, z.constant(third))
    t_rest = t_rest + z * third_rest + z_rest * third + 2.0 * z * z_rest * 0.2
    # t + z² tail, the second at most 1/50 of the first
    q, q_rest = two_product(z * z, tail)
    t, lost = two_sum(t, q)
    t_rest = t_rest + lost + q_rest
    # 2 s (1 + t)
    g, g_rest = two_product(s, t)
    g_rest = g_rest + s * t_rest + s_rest * t
    a, a_rest = fast_two_sum(s, g)
    a_rest = a_rest + g_rest + s_rest
    # k ln 2 is exact in its first part
    h, h_rest = two_sum(k * _LN2_HIGH, 2.0 * a)
    low, low_rest = two_product(k, k.constant(_LN2_LOW))
    h, lost = two_sum(h, low)
    return fast_two_sum(h, h_rest + lost + low_rest + 2.0 * a_rest + k * _LN2_LAST)


def power(x: Value, y: Value) -> Value:
    """x to the y with numpy's special cases: NaN for negative x and non-integral y; x⁰ and 1ʸ are 1, also of NaN."""
    if x.bits == 32:
        wide = power_64(x.to("f", 64), y.to("f", 64), in_two=False).to("f", 32)
        return wide
    return power_64(x, y, in_two=True)


def power_64(x: Value, y: Value, in_two: bool) -> Value:
    """Power of float64 operands; `in_two` uses the double-double logarithm."""
    unit = x.constant(1.0)
    a = abs(x)
    usual = (a > 0.0) & (a < math.inf)
    base = select(usual, a, unit)
    if in_two:
        high, low = _log_in_two(base)
        # y is clamped to keep the product finite; products beyond exp's range stay beyond it
        cut = minimum(maximum(y, y.constant(-1e290)), y.constant(1e290))
        h, tail = two_product(cut, high)
        result = _exp_of_sum(h, fma(cut, low, tail))
    else:
        result = exp(y * log(base))
    rising = (y > 0.0) ^ (a == 0.0)  # of the bases 0 and ∞: whether the power is ∞
    result = select(usual, result, select(rising, x.constant(math.inf), x.constant(0.0)))
    is_whole = y.call("floor") == y
    half = 0.5 * y
    odd = is_whole & (half.call("floor") != half) & (abs(y) < math.inf)
    negative = x.bitcast("i") < 0
    result = select(negative & odd, -result, result)
    result = select((x < 0.0) & ~is_whole & (a < math.inf), x.constant(math.nan), result)
    # infinite exponents
    far = abs(y) == math.inf
    result = select(far, select(a == 1.0, unit, select((a > 1.0) ^ (y < 0.0), x.constant(math.inf), x.constant(0.0))), result)
    result = select((x == x) & (y == y), result, x + y)
    return select((y == 0.0) | (x == 1.0), unit, result)


def hypot(x: Value, y: Value) -> Value:
    """√(x² + y²) without intermediate overflow; ∞ if either operand is, also beside NaN."""
    a, b = abs(x), abs(y)
    large, small = maximum(a, b), minimum(a, b)
    ratio = small / select(large == 0.0, large.constant(1.0), large)
    result = large * fma(ratio, ratio, ratio.constant(1.0)).call("sqrt")
    result = select((x == x) & (y == y), result, x + y)
    return select((a == math.inf) | (b == math.inf), x.constant(math.inf), result)
