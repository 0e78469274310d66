"""Mesh files of several parts with transforms and materials of their own: 3MF.

May import: compiler.mesh.
Begin with `assembly.py`.
"""
