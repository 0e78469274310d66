"""Lane-generic arithmetic: one source for numpy arrays and kernels.

May import: render.types, simd, jit, compiler.ir.
Begin with `ops.py`.
"""
