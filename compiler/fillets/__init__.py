"""Fillets between the parts of a solid: arcs, the seams where they lie, gradients of fields.

May import: compiler.formula.
Begin with `arcs.py`.
"""
