"""Sample sequences, pixel filters and warps.

May import: render.types, simd, jit, lanes.
Begin with `sobol.py`.
"""
