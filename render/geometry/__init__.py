"""Analytic shapes, instance transforms and bounds: intersection, normals, uv.

May import: render.types, simd, jit, lanes.
Begin with `analytic_shapes.py`.
"""
