"""Tessellates analytic shapes and implicit surfaces.

May import: render.geometry, render.formula, render.texture, render.accel, compiler.mesh.
Begin with `view.py`, then `analytic_shapes.py`.
"""
