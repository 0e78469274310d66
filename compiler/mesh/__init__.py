"""Polygon meshes: triangulation, vertex normals, booleans.

May import: compiler.ir, formula, scene.
Begin with `polygon_mesh.py`.
"""
