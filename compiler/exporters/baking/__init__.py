"""Bakes patterns into pictures with texture coordinates of their own, for formats that have no formulas.

May import: compiler.exporters.
Begin with `patterns.py`.
"""
