"""Analytic shapes, instance transforms, bounds and polygon clipping. Makes helpers of kernels of the lane functions in shapes/.

May import: shapes, render.types, simd, jit, lanes.
Begin with `analytic_shapes.py`.
"""

from ... import shapes  # noqa: F401 - whose modules fill HELPERS
from ...shapes.lanes import HELPERS
from ..jit.kernel import helper

for _function in HELPERS:
    helper(_function)
