"""Writer of scenes in the language: readable source, with meshes and pictures in a folder beside it.

May import: compiler.exporters, catalogue, importers.
Begin with `scene.py`.
"""
