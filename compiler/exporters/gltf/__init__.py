"""Writes a scene as a binary glTF 2.0 file.

May import: compiler.exporters.
"""
