"""Imports USD stages into the scene builder.

May import: compiler.importers and its imports.
Begin with `load.py`.
"""
