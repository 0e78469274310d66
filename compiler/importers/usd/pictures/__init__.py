"""Pictures of USD in layouts of their own, read as one image: the tiles of UDIM textures.

May import: compiler.importers.
Begin with `udim.py`.
"""
