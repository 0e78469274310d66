"""Writes a scene as Mitsuba 3 XML.

May import: compiler.exporters.
Begin with `scene.py`.
"""
