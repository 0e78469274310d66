"""Writes a scene as a USD stage.

May import: compiler.exporters.
"""
