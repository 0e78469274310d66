"""Writes a scene as a POV-Ray file.

May import: compiler.exporters.
Begin with `scene.py`.
"""
