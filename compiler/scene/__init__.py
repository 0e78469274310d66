"""Builds, validates, saves and dumps an `ir.Scene`.

May import: compiler.ir, io, formula.
Begin with `builder.py`.
"""
