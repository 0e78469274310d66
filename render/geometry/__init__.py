"""Analytic shapes, instance transforms, bounds and polygon clipping. Makes helpers of kernels of the lane functions in shapes/ and lights/.

May import: lights, shapes, render.types, simd, jit, lanes.
Begin with `analytic_shapes.py`.
"""

from ... import lights, shapes  # noqa: F401 - whose modules fill HELPERS
from ...shapes.lanes import HELPERS
from ..jit.kernel import helper

for _function in HELPERS:
    helper(_function)
