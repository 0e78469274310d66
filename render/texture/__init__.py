"""Texture lookup, filtered checker, procedural textures.

May import: render.formula and below.
Begin with `textures.py`.
"""
