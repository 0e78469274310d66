"""Tapes of texture graphs: formulas of the point, its coordinates u and v, its normal, and looked-up pictures.

May import: compiler.formula.
Begin with `opcodes.py` and `graph_builder.py`.
"""
