"""Sine, cosine, tangent and their inverses from polynomials, in float32 and float64.

Cody and Waite's subtraction of π/2 in parts reduces angles to ±π/4 (Software Manual for the Elementary Functions, 1980). Beyond the range
where that is exact the C library evaluates lane by lane. The polynomials are Cephes' (Moshier 1989); in float64, sine and cosine are
fdlibm's (Sun Microsystems 1993). docs/simd.md lists the largest measured errors in units of the last place.
"""

from __future__ import annotations

import math

from . import target
from .llvm_expr import Value, fma, maximum, minimum, select
from .polynomials import fast_two_sum, monic, polynomial, to_integer, two_product, two_sum

PI_LOW = 1.2246467991473532e-16  # π − math.pi
FARTHEST = {32: 1.0e5, 64: 1.6e6}
"""Largest angles of the polynomials; the C library evaluates larger ones, which are rare."""

# π/2 in parts. Three of 33 bits, whose products with integers below 2²⁰ are exact (fdlibm, e_rem_pio2.c), and the rest:
_PARTS_64 = (1.57079632673412561417e0, 6.07710050630396597660e-11, 2.02226624871116645580e-21, 8.4784276603689e-32)
# Three float32 numbers, for fused multiply-adds:
_PARTS_32 = (1.57079637050628662109375, -4.371138828673793e-08, -1.7151245100058819e-15)

_SIN_32 = (-1.9515295891e-4, 8.3321608736e-3, -1.6666654611e-1)
_COS_32 = (2.443315711809948e-5, -1.388731625493765e-3, 4.166664568298827e-2)
_TAN_32 = (9.38540185543e-3, 3.11992232697e-3, 2.44301354525e-2, 5.34112807005e-2, 1.33387994085e-1, 3.33331568548e-1)
_SIN_64 = (
    1.58969099521155010221e-10, -2.50507602534068634195e-8, 2.75573137070700676789e-6, -1.98412698298579493134e-4,
    8.33333333332248946124e-3,
)  # fmt: skip
_SIN_64_FIRST = -1.66666666666666324348e-1
_COS_64 = (
    -1.13596475577881948265e-11, 2.08757232129817482790e-9, -2.75573143513906633035e-7,
    2.48015872894767294178e-5, -1.38888888888741095749e-3, 4.16666666666666019037e-2,
)  # fmt: skip


def reduce_angle(x: Value) -> tuple[Value, Value, Value]:
    """(r, tail, quadrant): x = quadrant · π/2 + r + tail with |r| ≤ π/4."""
    if x.bits == 32:
        return _reduce_angle_32(x)
    k = (x * (2.0 / math.pi)).call("nearbyint")
    first, second, third, last = _PARTS_64
    r = x - k * first
    r, lost = two_sum(r, -(k * second))
    r, lost_too = two_sum(r, -(k * third))
    tail = (lost + lost_too) - k * last
    head = r + tail
    return head, (r - head) + tail, to_integer(k)


def _reduce_angle_32(x: Value) -> tuple[Value, Value, Value]:
    first, second, third = (x.constant(-part) for part in _PARTS_32)
    if target.FMA:
        k = (x * (2.0 / math.pi)).call("nearbyint")
        t = fma(k, first, x)  # exact
        product, product_tail = two_product(k, second)
        r, lost = two_sum(t, product)
        head, tail = fast_two_sum(r, fma(k, third, lost + product_tail))
        return head, tail, to_integer(k)
    wide = x.to("f", 64)
    k = (wide * (2.0 / math.pi)).call("nearbyint")
    precise = (wide - k * _PARTS_64[0]) - k * _PARTS_64[1]
    r = precise.to("f", 32)
    return r, (precise - r.to("f", 64)).to("f", 32), to_integer(k).to("i", 32)


def sin_of_small(r: Value, tail: Value) -> Value:
    """For |r| ≤ π/4."""
    z = r * r
    if r.bits == 32:
        return r + fma(polynomial(z, _SIN_32) * z, r, tail)
    v = z * r
    return r - ((z * (0.5 * tail - v * polynomial(z, _SIN_64)) - tail) - v * _SIN_64_FIRST)


def cos_of_small(r: Value, tail: Value) -> Value:
    """For |r| ≤ π/4."""
    z = r * r
    half = 0.5 * z
    w = 1.0 - half
    if r.bits == 32:
        return w + (((1.0 - w) - half) + (polynomial(z, _COS_32) * z * z - r * tail))
    return w + (((1.0 - w) - half) + (z * (z * polynomial(z, _COS_64)) - r * tail))


def _flip_sign(x: Value, flip: Value) -> Value:
    """x, negated where the integer `flip` is not 0."""
    return select(flip != 0, -x, x)


def is_far(x: Value) -> Value:
    """Mask of angles that the C library evaluates: large and infinite ones, not NaN."""
    return abs(x) > FARTHEST[x.bits]


def sincos(x: Value) -> tuple[Value, Value]:
    """Sine and cosine from one reduction."""
    r, tail, q = reduce_angle(x)
    s, c, odd = sin_of_small(r, tail), cos_of_small(r, tail), (q & 1) != 0
    sine = select(x == 0.0, x, _flip_sign(select(odd, c, s), q & 2))  # −0 too
    return sine, _flip_sign(select(odd, s, c), (q + 1) & 2)


def tan(x: Value) -> Value:
    r, tail, q = reduce_angle(x)
    odd = (q & 1) != 0
    if x.bits == 32:
        z = r * r
        t = r + fma(polynomial(z, _TAN_32) * z, r, fma(tail, z, tail))
        above, below = select(odd, t.constant(-1.0), t), select(odd, t, t.constant(1.0))
    else:
        s, c = sin_of_small(r, tail), cos_of_small(r, tail)
        above, below = select(odd, -c, s), select(odd, s, c)
    return select(x == 0.0, x, above / below)


_ASIN_32 = (4.2163199048e-2, 2.4181311049e-2, 4.5470025998e-2, 7.4953002686e-2, 1.6666752422e-1)
_ASIN_64_P = (
    3.47933107596021167570e-5, 7.91534994289814532176e-4, -4.00555345006794114027e-2,
    2.01212532134862925881e-1, -3.25565818622400915405e-1, 1.66666666666666657415e-1,
)  # fmt: skip
_ASIN_64_Q = (7.70381505559019352791e-2, -6.88283971605453293030e-1, 2.02094576023350569471e0, -2.40339491173441421878e0, 1.0)


def _asin_series(z: Value) -> Value:
    """(asin √z − √z) / √z for z ≤ 1/4."""
    if z.bits == 32:
        return polynomial(z, _ASIN_32) * z
    return z * polynomial(z, _ASIN_64_P) / polynomial(z, _ASIN_64_Q)


def asin(x: Value) -> Value:
    a = abs(x)
    big = a > 0.5
    z = select(big, 0.5 * (1.0 - a), a * a)
    s = select(big, z.call("sqrt"), a)
    more = s * _asin_series(z)
    quarter, low = _HALF_PI[x.bits]
    return select(big, (quarter - 2.0 * s) - (2.0 * more - low), s + more).call("copysign", x)  # π/2 − 2 asin √z, the first exact


def acos(x: Value) -> Value:
    a = abs(x)
    big = a > 0.5
    z = select(big, 0.5 * (1.0 - a), a * a)
    s = select(big, z.call("sqrt"), x)
    result = fma(s, _asin_series(z), s)
    quarter, low = _HALF_PI[x.bits]
    middle = quarter - (result - low)
    beyond = 2.0 * (quarter - (result - low))
    return select(big, select(x < 0.0, beyond, 2.0 * result), middle)


_HALF_PI = {32: (1.57079637050628662109375, -4.37113900018624283e-8), 64: (math.pi / 2, PI_LOW / 2)}
"""π/2 rounded to each width, and the remainder."""

# Polynomial of SLEEF (Shibata, 2010–) for 0 … 1:
_ATAN_32 = (
    0.00282363896258175373077393, -0.0159569028764963150024414, 0.0425049886107444763183594, -0.0748900920152664184570312,
    0.106347933411598205566406, -0.142027363181114196777344, 0.199926957488059997558594, -0.333331018686294555664062,
)  # fmt: skip
_ATAN_64_P = (
    -8.750608600031904122785e-1, -1.615753718733365076637e1, -7.500855792314704667340e1, -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)  # fmt: skip
_ATAN_64_Q = (
    2.485846490142306297962e1, 1.650270098316988542046e2, 4.328810604912902668951e2, 4.853903996359136964868e2,
    1.945506571482613964425e2,
)  # fmt: skip


def _atan_fraction(above: Value, below: Value) -> Value:
    """atan(above / below) for 0 ≤ above ≤ below, below > 0."""
    if above.bits == 32:
        t = above / below
        z = t * t
        return fma(polynomial(z, _ATAN_32) * z, t, t)
    large = below > 1e300  # the sum would overflow
    above, below = select(large, above * 0.25, above), select(large, below * 0.25, below)
    steep = above > below * 0.66
    t = select(steep, above - below, above) / select(steep, above + below, below)
    z = t * t
    series = z * polynomial(z, _ATAN_64_P) / monic(z, _ATAN_64_Q)
    quarter, low = _HALF_PI[64]
    small = fma(t, series, t)
    return select(steep, 0.5 * quarter + (small + 0.5 * low), small)


def atan2(y: Value, x: Value) -> Value:
    """Angle of (x, y), with numpy's special cases for zeros and infinities."""
    ax, ay = abs(x), abs(y)
    infinite = (ax == math.inf) & (ay == math.inf)
    above, below = select(infinite, x.constant(1.0), minimum(ax, ay)), select(infinite, x.constant(1.0), maximum(ax, ay))
    below = select(below == 0.0, x.constant(1.0), below)
    result = _atan_fraction(above, below)
    quarter, low = _HALF_PI[x.bits]
    result = select(ay > ax, quarter - (result - low), result)
    negative = x.bitcast("i") < 0  # −0 too
    result = select(negative, 2.0 * quarter - (result - 2.0 * low), result)
    return select((x == x) & (y == y), result, x + y).call("copysign", y)


def atan(x: Value) -> Value:
    a = abs(x)
    unit = x.constant(1.0)
    steep = a > 1.0
    result = _atan_fraction(
        select(steep, select(a == math.inf, x.constant(0.0), unit), a), select(steep, select(a == math.inf, unit, a), unit)
    )
    quarter, low = _HALF_PI[x.bits]
    return select(x == x, select(steep, quarter - (result - low), result), x).call("copysign", x)
