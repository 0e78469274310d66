"""Files of triangles in the world, for printing and for other programs: STL, OBJ, PLY and 3MF.

May import: compiler.exporters.
Begin with `triangle_files.py`.
"""
