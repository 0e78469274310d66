"""Renderer classes, one a backend, and the data they prepare.

May import: All render packages.
Begin with `prepare.py`.
"""
