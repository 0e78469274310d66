"""Shapes and implicit surfaces to triangles.

May import: render.geometry, formula, compiler.mesh, exporters.
Begin with `analytic_shapes.py`.
"""
