"""Implicit surfaces in kernels: interpreters, root isolation, packets.

May import: render.geometry and below, compiler.formula.
Begin with `intersect.py`.
"""
