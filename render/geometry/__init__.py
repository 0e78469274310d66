"""Analytic shapes, instance transforms, bounds and polygon clipping.

May import: render.types, simd, jit, lanes.
Begin with `analytic_shapes.py`.
"""
