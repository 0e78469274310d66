"""Renderer classes, one a backend, and the data they prepare.

May import: all render packages.
Begin with `prepare.py`.
"""
