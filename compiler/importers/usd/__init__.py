"""USD stages to rows of the scene.

May import: compiler.importers and whatever it may import.
Begin with `load.py`.
"""
