"""BSDFs and participating media: evaluate, sample, pdf.

May import: materials, render.sampling, surface, light, compiler.plan.
Begin with `bsdf.py`. Makes helpers of kernels of the lane functions in materials/.
"""

from ... import materials  # noqa: F401 - whose modules fill HELPERS
from ...materials.lanes import HELPERS
from ..jit.kernel import helper

for _function in HELPERS:
    helper(_function)
