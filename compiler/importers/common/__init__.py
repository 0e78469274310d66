"""What readers of several formats share: names of files, commas in numbers, colours as numbers, points without faces.

May import: compiler.ir, io, mesh.
Begin with `file_names.py`.
"""
