"""Mesh and image files to rows of the scene.

May import: compiler.ir, io, mesh, scene.
Begin with `mesh_files.py`.
"""
