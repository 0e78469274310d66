"""Implicit surfaces in kernels: tape interpreters and compiler, grids, root isolation, ray packets, closed forms.

May import: render.geometry and below, compiler.formula.
Begin with `intersect.py`.
"""
