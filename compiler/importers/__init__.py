"""Mesh and image files to rows of the scene.

May import: compiler.ir, io, mesh, scene, importers.common, importers.assemblies.
Begin with `mesh_files.py`.
"""
