"""Tapes of formulas: build, simplify, evaluate, bound, mesh.

May import: compiler.ir, lang.
Begin with `tape.py` and `builder.py`.
"""
