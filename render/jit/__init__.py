"""Compiles, caches and calls kernels; threads; temporary memory.

May import: render.simd, compiler.io.
Begin with `kernel.py`.
"""
