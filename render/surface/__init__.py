"""Hit to shading point: normals, uv, normal maps, texture footprint.

May import: render.geometry, camera, texture, compiler.plan.
Begin with `interaction.py`.
"""
