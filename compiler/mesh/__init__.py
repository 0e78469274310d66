"""Polygon meshes: triangulation, vertex normals, booleans; sweeps of profiles, tubes along curves, height grids.

May import: compiler.ir, formula, scene.
Begin with `polygon_mesh.py`.
"""
