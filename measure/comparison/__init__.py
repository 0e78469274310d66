"""Comparison of two pictures or scenes: metrics, objects that differ, changed rows, difference images.

May import: measure, and the renderer.
Begin with `compare.py`.
"""
