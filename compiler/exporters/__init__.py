"""Exports a scene to the file formats of other programs.

May import: compiler.ir, scene, mesh, plan.
Begin with `export.py`.
"""
