"""Analytic shapes and instance transforms: intersect, normal, uv.

May import: render.types, simd, jit, lanes.
Begin with `analytic_shapes.py`.
"""
