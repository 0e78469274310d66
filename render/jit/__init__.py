"""Compiles, caches and calls kernels; thread pool; temporary memory.

May import: render.simd, compiler.io.
Begin with `kernel.py`.
"""
