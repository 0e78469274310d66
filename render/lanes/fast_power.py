"""Fast power for bases in 0 … 1, for specular lobes."""

from __future__ import annotations

import numpy as np

from .. import simd
from ..jit.kernel import helper
from ..simd.registration import overload
from ..types import Lane

MAX_WHOLE_POWER = 256  # whole exponents up to this use squaring


def fast_pow(x: Lane, y: Lane) -> Lane:
    """x to the y for 0 < x ≤ 1 and y ≥ 0, faster than `ops.power`.

    The relative error is a few roundings of y log x or, for whole y, of y.
    """
    return np.power(x, y)


@overload(fast_pow)
def _fast_pow(x, y):
    if isinstance(y, simd.Vector):

        def of_vectors(x, y):
            exponent = simd.lane(y, 0)
            n = np.int64(min(exponent, 1e3))
            if n <= MAX_WHOLE_POWER and simd.all_of(y == n):
                return _whole_power(x, n)
            return np.exp(y * np.log(x))

        return of_vectors

    def of_scalars(x, y):
        n = np.int64(min(y, 1e3))
        return _whole_power(x, n) if n <= MAX_WHOLE_POWER and n == y else np.exp(y * np.log(x))

    return of_scalars


@helper
def _whole_power(x: Lane, n: int) -> Lane:
    """Power by repeated squaring: the product of x, x², x⁴ … over the set bits of n."""
    if n <= 0:
        return 0.0 * x + 1.0
    while n & 1 == 0:
        x = x * x
        n >>= 1
    product = x
    while n > 1:
        x = x * x
        n >>= 1
        if n & 1:
            product = product * x
    return product
