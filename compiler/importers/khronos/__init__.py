"""Looks of glTF that other readers do not have: anisotropy and iridescence as slabs of OpenPBR.

May import: compiler.importers.common, materials, compiler.texture_graph.
Begin with `slabs.py`.
"""
