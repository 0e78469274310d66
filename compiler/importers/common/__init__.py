"""What readers of several formats share: the file and its parts, names of files, commas in numbers, colours, points without faces.

May import: compiler.ir, io, scene, mesh.
Begin with `mesh_parts.py`.
"""
