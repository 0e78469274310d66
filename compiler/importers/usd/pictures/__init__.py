"""Pictures of USD in layouts of their own, read as one image: tiles of UDIM textures, layouts of dome pictures.

May import: compiler.importers.
Begin with `udim.py`.
"""
