"""Lowers evaluated elements to rows of the scene.

May import: All compiler packages but exporters.
Begin with `lowering.py`.
"""
